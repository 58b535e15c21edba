"""Where to begin, by compiled kernels: they search in a table of the meridian and end within its rounding.

What they find is a beginning and no answer: from there the search in the surface itself is over in a step or two.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.native import backend, kernel_array
from ...mirrors import Mirror
from ...mirrors.form import MirrorForm
from ..space import hollowness
from .ends import Ends
from .limits import LONGEST_STEP, RIM_SLACK
from .tables import BEYOND, CELLS, MirrorTables

Array = NDArray[np.float64]

SETTLED = 1e-7  # of the rim radius: the step after it is as small as its square
NOT_SEEN, SEEN, NOT_SETTLED = 0, 1, 2
STEPS, FIRST_STEPS = 24, 6
FIRST_CLOSE = 3e-5  # of the rim radius: the step after it is as small as that
REACH = (CELLS + BEYOND) / CELLS
FEWEST = 200  # pairs, which take as long without tables as these do to be made
NEAREST = 1e-3  # of the rim radius: a lens is looked from as if no nearer to the vertex


class Search(NamedTuple):
    """How long is searched: steps of Newton's rule, and of it in the meridian, what ends these, how far out."""

    steps: int
    first_steps: int
    first_close: float
    reach: float

    def until(self, close: float, aside: float = 0.0) -> tuple[float, ...]:
        """As kernels take it; in the meridian no closer than a lens that is seen aside of the axis leaves it."""
        return (self.steps, self.first_steps, close, max(self.first_close, aside), LONGEST_STEP, self.reach, RIM_SLACK)


SEARCH = Search(STEPS, FIRST_STEPS, FIRST_CLOSE, REACH)


def compiled_places(mirror: Mirror, form: MirrorForm, pupils: Ends, targets: Ends) -> Array | None:
    """Where (n, 2) mm on a convex mirror one pupil sees targets, NaN where kernels have not found it; None where they
    do not serve."""
    xyz = pupils.xyz
    if len(xyz) < FEWEST or not backend.is_compiled or not form.is_empty or (xyz != xyz[0]).any():
        return None
    x, y, z = (float(part) for part in xyz[0])
    tables = _tables(mirror, np.inf if pupils.distant else max(-z, NEAREST * mirror.rim_radius_mm))
    if tables is None or z == 0:
        return None
    count = len(targets.xyz)
    asked, rows, states = kernel_array(targets.xyz.T), np.empty((8, count)), np.empty(count, np.uint8)
    backend.kernels.find_reflections(
        tables.surface((x, y, z), pupils.distant), SEARCH.until(SETTLED, float(np.hypot(x, y)) / abs(z)),
        tables.by_omega, tables.omegas, tables.middle_mm, targets.distant, asked, rows, states,
    )  # fmt: skip
    a, b, c = rows[5:]
    is_shortest = (states != NOT_SETTLED) & (a > 0) & (a * c > b * b)
    places: Array = np.where(is_shortest, rows[:2], np.nan).T.copy()
    return places


@lru_cache(maxsize=32)
def _tables(mirror: Mirror, distance: float) -> MirrorTables | None:
    """Of a mirror that is convex, without a tip, and shows ever larger angles towards its rim; None of another."""
    if mirror.is_pointed or hollowness(mirror) > 0:
        return None
    tables = MirrorTables.of(mirror, distance)
    rises = np.isfinite(tables.by_omega).all() and tables.omegas[1] > tables.omegas[0]
    return tables if rises and (tables.by_omega[:, 1] >= 0).all() else None
