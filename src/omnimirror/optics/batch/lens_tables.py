"""Tables of real lenses over viewing angle and focus, for batch evaluation.

The focus parameter is ``q = f v / (1 - (f - e) v)``, with the vergence v in focus at the entrance
pupil: the imager is ``f + f q`` behind the principal point, and the principal distance is
``f + (f - e) q``. Image quantities are linear in q except for vignetting and aberrations; a
parabola through three focus settings represents them. Over the tangent of the viewing angle there
are cubic pieces between equally spaced nodes, also used by the compiled evaluator. Imaginary parts
of complex tangents carry derivatives.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..lenses.field_lens import FieldLens

Array = NDArray[Any]

CELLS = 512
FARTHEST_MM = 1e7
NEAREST = 8.0  # focal lengths from the principal point: nearest focus of designs
AIM_STEPS = 6  # Newton steps for a moving pupil


class LensColumns(NamedTuple):
    """Lens properties at viewing angles; first axis (3, ..): powers 0, 1, 2 of q."""

    place: Array
    """(..) position of the entrance pupil, mm towards the mirror from the reference point."""
    motion: Array
    """(..) its derivative by the tangent."""
    light: Array
    """(..) relative illumination of the imager, at the middle focus."""
    height: Array
    """(3, ..) image height, mm."""
    rate: Array
    """(3, ..) its derivative by the tangent."""
    focused_t: Array
    """(3, ..) blur (mm) of a distant tangential image per radius of the pupil.

    The blur of an image of vergence V is this minus :attr:`spread_t` V, times two radii.
    """
    spread_t: Array
    focused_s: Array
    spread_s: Array
    own_t: Array
    """(3, ..) blur of the lens itself, mm."""
    own_s: Array


OF_FOCUS = LensColumns._fields[3:]
ROWS = 3 + 3 * len(OF_FOCUS)


@dataclass(frozen=True, eq=False)
class LensTables:
    """Tables of a real lens.

    Attributes
    ----------
    values : (CELLS + 1, 2, ROWS)
        Columns at the nodes, and their derivatives times the node spacing.
    end
        Tangent of the end of the field.
    focal_length_mm, f_number
    pupil_from_principal_mm
        Distance e of the paraxial entrance pupil from the principal point.
    pupil_mm
        Paraxial entrance pupil from the reference point: origin of vergences in focus.
    most_vergence
        Vergence of the nearest focus tabulated.
    imager_mm
        Distance from the reference point to the imager, focused at infinity.
    """

    values: Array
    end: float
    focal_length_mm: float
    f_number: float
    pupil_from_principal_mm: float
    pupil_mm: float
    most_vergence: float
    imager_mm: float

    @property
    def step(self) -> float:
        return self.end / CELLS

    @property
    def bounds(self) -> tuple[float, float]:
        """Vergences of the focus range."""
        return 1 / (FARTHEST_MM - self.pupil_mm), self.most_vergence

    def at(self, tangent: Array) -> LensColumns:
        """Evaluate the columns (..) at tangents (..), with linear extrapolation."""
        cell = np.clip((tangent.real / self.step).astype(int), 0, CELLS - 1)
        u = (tangent / self.step - cell)[..., None]
        (a, da), (b, db) = (np.moveaxis(self.values[cell + i], -2, 0) for i in (0, 1))
        found = a + u * (da + u * (3 * (b - a) - 2 * da - db + u * (2 * (a - b) + da + db)))
        rows = np.moveaxis(found, -1, 0)
        powers = [rows[3 + 3 * i : 6 + 3 * i] for i in range(len(OF_FOCUS))]
        return LensColumns(*rows[:3], *powers)

    def aimed(self, x: Array, depth: Array) -> Array:
        """Return tangents (..) of the chief rays to points at x from the axis and a depth.

        Solves ``w t = x`` for ``w = depth - place(t)`` by Newton's method.
        """
        tangent = x / (depth - self.pupil_mm)
        for _ in range(AIM_STEPS):
            found = self.at(tangent)
            w = depth - found.place
            tangent = tangent - (w * tangent - x) / (w - found.motion * tangent)
        return tangent

    def defocus(self, v: Any) -> Any:
        """Compute q of vergences in focus."""
        f = self.focal_length_mm
        return f * v / (1 - (f - self.pupil_from_principal_mm) * v)

    def defocus_rate(self, v: Any) -> Any:
        """Compute its derivative by v."""
        f = self.focal_length_mm
        return f / (1 - (f - self.pupil_from_principal_mm) * v) ** 2


def focus_powers(columns: Array, q: Any) -> Any:
    """Evaluate focus-dependent columns (3, ..) at q."""
    return columns[0] + q * (columns[1] + q * columns[2])


@lru_cache(maxsize=16)
def tables_of(lens: FieldLens) -> LensTables:
    """Create the tables of a lens, valid for any focus.

    Examples
    --------
    >>> from omnimirror.optics.lenses import TabulatedLens
    >>> angles = np.linspace(0, 30, 7)
    >>> ideal = tuple(12.0 * np.tan(np.radians(angles)))
    >>> tables = tables_of(TabulatedLens(12.0, 4.0, 1e7, tuple(angles), ideal, tuple(0 * angles)))
    >>> tables.at(np.array([0.25])).height[0].round(3)  # focused at infinity
    array([3.])
    """
    nearest = max(lens.principal_point_mm + NEAREST * lens.focal_length_mm, lens.nearest_focus_mm)
    f, at = lens.focal_length_mm, lens.pupil.at_mm
    made = LensTables(np.empty(0), 0.0, f, lens.f_number, lens.pupil_from_principal, at, 1 / (nearest - at), 0.0)
    vergences = np.array([1 / (FARTHEST_MM - at), made.most_vergence / 2, made.most_vergence])
    focused, q = [lens.focused_at(float(1 / v + at)) for v in vergences], made.defocus(vergences)
    end = min(one.field.end for one in focused)
    tangent = np.linspace(0.0, end, CELLS + 1)
    each = np.stack([_columns(one, tangent) for one in focused])  # (3, 2, rows, nodes)
    place, motion, light = each[1, :, :3].transpose(1, 0, 2)
    powers = np.linalg.solve(np.vander(q, increasing=True), each[:, :, 3:].reshape(3, -1)).reshape(
        3, *each[:, :, 3:].shape[1:]
    )
    rows = np.concatenate([np.stack([place, motion, light]), powers.transpose(2, 0, 1, 3).reshape(-1, 2, CELLS + 1)])
    imager = focused[0].imager_mm - f * float(q[0])
    return replace(made, imager_mm=imager, values=np.ascontiguousarray(rows.transpose(2, 1, 0)), end=end)


def _columns(lens: FieldLens, tangent: Array) -> Array:
    """Return all columns of a lens at its focus (2, rows, n): values, and derivatives per cell."""
    field, step = lens.field, tangent[1]

    def both(values: Any) -> Array:
        """Return values of a function of tangents, and its spline derivatives."""
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(tangent, values, k=5)
        return np.stack([values, step * spline.derivative()(tangent)])

    found, (height, rate) = field.at(tangent), field.height(tangent)
    motion = lens.pupil.aim(tangent * 1.0, 1.0 + found.pupil).drift / (1 + tangent**2)
    wide_t, wide_s = found.scale_t * found.width_t, found.scale_s * found.width_s
    rows = (
        found.pupil, motion, found.illumination, height, rate, wide_t * found.vergence_t, wide_t,
        wide_s * found.vergence_s, wide_s, np.maximum(found.own_t, 0.0), np.maximum(found.own_s, 0.0),
    )  # fmt: skip
    return np.stack([both(row) for row in rows], axis=1)
