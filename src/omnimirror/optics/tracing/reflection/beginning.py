"""Initial values from compiled kernels, which use a table of the meridian.

They are accurate to the table's interpolation error: one or two Newton steps on the actual surface
complete the solution.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ....base.native import backend, kernel_array
from ....base.typing import Array
from ...mirrors import Mirror
from ...mirrors.form import MirrorForm
from ..space import hollowness
from .ends import Ends
from .limits import LONGEST_STEP, RIM_SLACK
from .tables import BEYOND, CELLS, MirrorTables

SETTLED = 1e-7  # relative to the rim radius: convergence is quadratic from here
NOT_SEEN, SEEN, NOT_SETTLED = 0, 1, 2
STEPS, FIRST_STEPS = 24, 6
FIRST_CLOSE = 3e-5  # relative to the rim radius: limit of the first search
REACH = (CELLS + BEYOND) / CELLS
FEWEST = 200  # pairs below which the tables do not pay off
NEAREST = 1e-3  # minimum lens distance from the vertex, relative to the rim radius


class Search(NamedTuple):
    """Limits of a kernel search: Newton steps in space and in the meridian, tolerances, extent."""

    steps: int
    first_steps: int
    first_close: float
    reach: float

    def until(self, close: float, aside: float = 0.0) -> tuple[float, ...]:
        """Return kernel arguments, with a tolerance limited by the decentring."""
        return (self.steps, self.first_steps, close, max(self.first_close, aside), LONGEST_STEP, self.reach, RIM_SLACK)


SEARCH = Search(STEPS, FIRST_STEPS, FIRST_CLOSE, REACH)


def compiled_places(mirror: Mirror, form: MirrorForm, pupils: Ends, targets: Ends) -> Array | None:
    """Return the points (n, 2), mm, of a convex mirror that image targets in one pupil.

    NaN without convergence; None if kernels do not apply.
    """
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
    """Return the tables of a smooth convex mirror with increasing field angle."""
    if mirror.is_pointed or hollowness(mirror) > 0:
        return None
    tables = MirrorTables.of(mirror, distance)
    rises = np.isfinite(tables.by_omega).all() and tables.omegas[1] > tables.omegas[0]
    return tables if rises and (tables.by_omega[:, 1] >= 0).all() else None
