"""A view in GStreamer: a pipeline for the shell, and the shader of its ``glshader``, which holds the map itself."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ....errors import InvalidParameter
from ....escaping import gstreamer_comment, shell_word
from ...formats import Code, Deviation, ProgramFormat, filled, write_script
from ..fixed_views import ViewMap
from ..shaders import CARD_PX
from .lattice import MapLattice, finest_lattice, listed, spans_of

STEPS = (64, 32, 16, 8, 4)
LONGEST_WORD = 120_000  # bytes of a command's argument, of which Linux takes 131,072


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """glshader has one texture, the picture's: the map is constants of the shader, nodes with cubics between them."""
    script, shader = paths
    comments = {key: Code(gstreamer_comment(str(view.words[key]))) for key in ("camera", "view")}
    for steps in (STEPS, STEPS[:-1]):  # where the finest is too long a coarser one is taken, and its cost is told
        lattice = finest_lattice(view.straighten, steps)
        words = filled("view-gst.frag.in", **view.words | comments, **_constants(lattice))
        if len(words) <= LONGEST_WORD:
            break
    else:
        raise InvalidParameter(
            f"the shader of this view takes {len(words)} bytes, and a command line holds {LONGEST_WORD} of them; "
            "valid are smaller views, without steps in them"
        )
    write_script(shader, words)
    write_script(script, filled("view-gst.sh.in", **view.words, shader=Code(shell_word(shader.name))))
    why = f"cubics between nodes every {lattice.step} px, and 1/256 px of graphics cards"
    what = f"{view.sizes}, {lattice.nodes[..., 0].size} nodes"
    return what, Deviation(float(np.hypot(*lattice.error)) + CARD_PX, "px", why)


def _constants(lattice: MapLattice) -> dict[str, object]:
    """What the template is filled with, as GLSL."""
    starts, runs = spans_of(lattice.spans)
    pairs = np.reshape(runs, (-1, 2))
    nodes = [f"vec2({u:.3f},{v:.3f})" for u, v in lattice.nodes.reshape(-1, 2)]
    return {
        "step": lattice.step, "columns": lattice.nodes.shape[1], "count": len(nodes), "nodes": listed(nodes),
        "run_count": len(pairs), "runs": listed([f"ivec2({first},{first + n})" for first, n in pairs.tolist()]),
        "start_count": len(starts), "starts": listed(starts),
    }  # fmt: skip


GSTREAMER: ProgramFormat[ViewMap] = ProgramFormat(_write, (".sh", ".frag"), "GStreamer's glshader")
