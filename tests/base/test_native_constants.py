"""Constants defined in both Python and the compiled module: parsed from the C++ sources, and equal."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from omnimirror.cameras import camera as cameras
from omnimirror.dewarp.maps import radial_table
from omnimirror.dewarp.sampling import footprints
from omnimirror.optics.batch import best_focus, evaluate
from omnimirror.simulation.rendering import sight
from omnimirror.simulation.scenes import surfaces

SOURCES = Path(__file__).parents[2] / "native" / "src"
SHARED = {
    "sampling/footprint.hpp": {"JUMP2": footprints.JUMP2, "JUMP2_PX": footprints.JUMP2_PX},
    "sampling/job.hpp": {"MOST_TAPS": footprints.MOST_TAPS},
    "sampling/sides.cpp": {"EVERY": footprints.EVERY_PX},
    "sampling/axial.hpp": {"EDGE_PX": 0.5 + cameras.EDGE_SLACK},
    "sampling/axial_kernel.hpp": {
        name: getattr(radial_table, name) for name in ("SLACK", "CLOSE", "GAP", "MOST_STEPS")
    },
    "designs/designs.hpp": {
        "DESIGN_COLUMNS": len(evaluate.BATCH_COLUMNS), "DESIGN_NUMBERS": len(evaluate._NUMBERS),
    },
    "designs/workspace.hpp": {"DEGREE": np.pi / 180},
    "designs/focus.hpp": {"HOPE": best_focus.HOPE},
    "exposure/packets.hpp": {"BESIDE": surfaces.BESIDE},
    "exposure/exposure.hpp": {
        "LOST": sight.LOST, "REFLECTED": sight.REFLECTED, "DIRECT": sight.DIRECT, "HIDDEN": sight.HIDDEN,
    },
}  # fmt: skip


def constants_of(text: str) -> dict[str, float]:
    """Return the constants of a source that are numbers, or sums and quotients of numbers."""
    found = {}
    for names in re.findall(r"constexpr (?:int|float|double|int64_t) ([^;{}()]*);", text):
        for one in names.split(","):
            name, _, value = one.partition("=")
            if re.fullmatch(r"[\d\s.e+/*-]+f?", value):
                found[name.strip()] = float(eval(value.strip().removesuffix("f")))
    return found


@pytest.mark.parametrize("file", SHARED)
def test_constants_of_the_compiled_part_are_those_of_python(file):
    found = constants_of((SOURCES / file).read_text())
    for name, value in SHARED[file].items():
        assert found[name] == pytest.approx(value, rel=1e-15), name
