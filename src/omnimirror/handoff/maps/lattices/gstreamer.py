"""A view in GStreamer: a pipeline for the shell, and the shader of its ``glshader``, which holds the map itself."""

from __future__ import annotations

import shlex
from pathlib import Path

import numpy as np

from ....errors import InvalidParameter
from ...formats import Deviation, ProgramFormat, filled
from ..fixed_views import ViewMap
from .lattice import MapLattice, finest_lattice, spans_of

STEPS = (64, 32, 16, 8, 4)
LONGEST_WORD = 120_000  # bytes of a command's argument, of which Linux takes 131,072
CARD_PX = 2.0**-9  # graphics cards know 256 places between pixels


def _write(view: ViewMap, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """glshader has one texture, the picture's: the map is constants of the shader, nodes with cubics between them."""
    script, shader = paths
    lattice = finest_lattice(view.straighten, STEPS)
    (width, height), (source_width, source_height) = view.size, view.source_size
    sizes = {"width": width, "height": height, "source_width": source_width, "source_height": source_height}
    words = filled("view-gst.frag.in", camera=view.name, view=view.view, **sizes, **_constants(lattice))
    if len(words) > LONGEST_WORD:
        raise InvalidParameter(
            f"the shader of this view takes {len(words)} bytes, and a command line holds {LONGEST_WORD} of them; "
            "valid are smaller views, without steps in them"
        )
    shader.write_text(words, encoding="utf-8")
    named = filled("view-gst.sh.in", camera=view.name, view=view.view, **sizes, shader=shlex.quote(shader.name))
    script.write_text(named, encoding="utf-8")
    why = f"cubics between nodes every {lattice.step} px, and 1/256 px of graphics cards"
    what = f"{width} x {height} px of {source_width} x {source_height}, {lattice.nodes[..., 0].size} nodes"
    return what, Deviation(float(np.hypot(*lattice.error)) + CARD_PX, "px", why)


def _constants(lattice: MapLattice) -> dict[str, object]:
    """What the template is filled with, as GLSL."""
    starts, runs = spans_of(lattice.spans)
    pairs = np.reshape(runs, (-1, 2))
    nodes = [f"vec2({u:.3f},{v:.3f})" for u, v in lattice.nodes.reshape(-1, 2)]
    return {
        "step": lattice.step, "columns": lattice.nodes.shape[1], "count": len(nodes), "nodes": _listed(nodes),
        "run_count": len(pairs), "runs": _listed([f"ivec2({first},{first + n})" for first, n in pairs.tolist()]),
        "start_count": len(starts), "starts": _listed([str(n) for n in starts]),
    }  # fmt: skip


def _listed(words: list[str]) -> str:
    """With commas between them, in lines."""
    return ",\n    ".join(",".join(words[i : i + 8]) for i in range(0, len(words), 8))


GSTREAMER: ProgramFormat[ViewMap] = ProgramFormat(_write, (".sh", ".frag"), "GStreamer's glshader")
