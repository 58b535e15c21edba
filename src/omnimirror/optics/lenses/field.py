"""Field functions of a lens, interpolated from its table or from traced surfaces.

All are smooth functions of the tangent t of the viewing angle, odd or even about the axis: quintic
splines with continuous fourth derivatives. Relative to the entrance pupil at a viewing angle, the
rays of one image point pass a pupil point (y_t, y_s) with slopes ``t - y_t v_t`` and ``-y_s v_s``.
The tangential and sagittal vergences in focus, v_t and v_s, differ from the axial one by field
curvature and astigmatism.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.numerics.roots import increasing_root
from ...base.typing import Array
from .pupil import ChiefAim, EntrancePupil

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


DEGREE = 5
LEAST_NODES = 4
CHECKED = 513  # points at which the image height is checked to be increasing
STEPS = 50
CLOSE = 1e-14


class FieldNodes(NamedTuple):
    """Lens properties at n field angles from the axis; in mm and 1/mm."""

    tangent: Array
    """(n,) tangents of the viewing angles, from 0."""
    height: Array
    """(n,) image heights."""
    pupil: Array
    """(n,) entrance-pupil positions, towards the mirror from the reference point."""
    vergence_t: Array
    """(n,) vergence in focus of the tangential fan, at the pupil, along the axis."""
    vergence_s: Array
    scale_t: Array
    """(n,) derivative of the image point by the slope, through a fixed pupil point."""
    scale_s: Array
    width_t: Array
    """(n,) half width of the vignetted pupil in the meridian, relative to the axis."""
    width_s: Array
    shift_t: Array
    """(n,) offset of the vignetted pupil from the chief ray, over the axial radius."""
    illumination: Array
    """(n,) relative illumination of the imager."""
    own_t: Array
    """(n,) blur of the lens in its own focus, mm: four times the standard deviation of its rays."""
    own_s: Array
    short: Array
    """(n,) lateral colour: image height at the shortest minus the middle wavelength."""
    long: Array
    """(n,) lateral colour of the longest wavelength."""
    stop_t: Array
    """(n,) half width in the meridian of the unvignetted pupil, relative to the axis."""
    stop_s: Array
    stop_shift: Array
    """(n,) distance of its centre from the chief ray, relative to the axial radius."""
    openness: Array
    """(n,) unvignetted fraction of its area."""


class LensValues(NamedTuple):
    """Even field functions at k tangents, (k,) each; names as in :class:`FieldNodes`."""

    pupil: Array
    vergence_t: Array
    vergence_s: Array
    scale_t: Array
    scale_s: Array
    width_t: Array
    width_s: Array
    illumination: Array
    own_t: Array
    own_s: Array
    stop_t: Array
    stop_s: Array
    openness: Array


ODD = ("height", "shift_t", "short", "long", "stop_shift")


@dataclass(frozen=True)
class MovingPupil(EntrancePupil):
    """Entrance pupil that moves with the viewing angle; ``at_mm`` is its paraxial position."""

    tangents: tuple[float, ...] = ()
    places_mm: tuple[float, ...] = ()

    @property
    def moves(self) -> bool:
        return True

    @cached_property
    def _spline(self) -> tuple[BSpline, BSpline]:
        spline = even_spline(np.array(self.tangents), np.array(self.places_mm)[:, None])
        return spline, spline.derivative()

    def place(self, tangent: Array) -> Array:
        return np.asarray(self._spline[0](self._inside(tangent))[..., 0])

    def _inside(self, tangent: Array) -> Array:
        return np.clip(tangent, -self.tangents[-1], self.tangents[-1])

    def aim(self, x: Array, depth: Array) -> ChiefAim:
        """Solve ``(depth - z(t)) t = x`` by Newton's method."""
        place, rate = self._spline
        tangent = x / (depth - self.at_mm)
        for _ in range(STEPS):
            t = self._inside(tangent)
            w, motion = depth - place(t)[..., 0], rate(t)[..., 0]
            step = (w * tangent - x) / (w - motion * tangent)
            tangent = tangent - step
            if not (np.abs(step) > CLOSE * (1 + np.abs(tangent))).any():
                break
        t = self._inside(tangent)
        return ChiefAim(depth - place(t)[..., 0], rate(t)[..., 0] * (1 + tangent**2))


def even_spline(tangent: Array, values: Array) -> BSpline:
    """Fit an even spline through values (n, m) at tangents (n,) from 0."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([values[:0:-1], values]), k=DEGREE)


def odd_spline(tangent: Array, values: Array) -> BSpline:
    """Fit an odd spline through values (n, m) at tangents (n,) from 0."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([-values[:0:-1], values]), k=DEGREE)


class LensField:
    """Field functions of a lens.

    Parameters
    ----------
    nodes
        Four or more nodes.
    name
        Name of the lens in errors.
    at_fold, at_end
        Hints in the errors for image heights that stop increasing at an angle, which replaces
        ``{angle}``, and for angles beyond the end of the field.

    Raises
    ------
    InvalidParameter
        If the image heights do not increase outwards.
    """

    def __init__(self, nodes: FieldNodes, name: str, at_fold: str, at_end: str) -> None:
        self.nodes, self.name, self.at_end = nodes, name, at_end
        self.end = float(nodes.tangent[-1])
        places = tuple(nodes.pupil.tolist())
        self.entrance_pupil = MovingPupil(places[0], tuple(nodes.tangent.tolist()), places)
        self._even = even_spline(nodes.tangent, np.stack([getattr(nodes, f) for f in LensValues._fields], axis=1))
        self._odd = odd_spline(nodes.tangent, np.stack([getattr(nodes, f) for f in ODD], axis=1))
        self._rate = self._odd.derivative()
        checked = np.linspace(0.0, self.end, CHECKED)
        falls = self._rate(checked)[:, 0] <= 0
        if falls.any():
            angle = float(np.degrees(np.arctan(checked[int(np.argmax(falls))])))
            raise InvalidParameter(
                f"{name}: image heights must grow with the viewing angle; they stop growing at {angle:.4g} deg from "
                f"the axis; {at_fold.format(angle=f'{angle:.4g}')}"
            )
        self._heights = self._odd(checked)[:, 0]
        self._tangents = checked

    def check(self, tangent: Array) -> None:
        """Check that tangents are within the field, with a rounding tolerance."""
        past = tangent > self.end * (1 + 1e-12)
        if past.any():
            last, asked = (float(np.degrees(np.arctan(v))) for v in (self.end, np.max(tangent)))
            raise InvalidParameter(
                f"{self.name} ends at {last:.4g} deg from its axis, and the mirror reaches {asked:.4g} deg; use a "
                f"smaller or more distant mirror, or {self.at_end}"
            )

    def at(self, tangent: Array) -> LensValues:
        """Evaluate the even functions at tangents (k,)."""
        return LensValues(*np.moveaxis(self._even(np.minimum(tangent, self.end)), -1, 0))

    def odd(self, tangent: Array) -> dict[str, Array]:
        """Evaluate the odd functions at tangents (k,), by name."""
        values = np.where(np.asarray(tangent)[..., None] == 0.0, 0.0, self._odd(np.minimum(tangent, self.end)))
        return dict(zip(ODD, np.moveaxis(values, -1, 0), strict=True))

    def height(self, tangent: Array) -> tuple[Array, Array]:
        """Return image heights (k,), mm, and derivatives by the tangent."""
        inside = np.minimum(tangent, self.end)
        rate = self._rate(inside)[..., 0]
        height = self._odd(inside)[..., 0] + rate * (tangent - inside)
        return np.where(tangent == 0.0, 0.0, height), rate  # removes the rounding of splines

    def tangent_of(self, height: Array) -> Array:
        """Return tangents (k,) of image heights; NaN beyond the end of the field."""
        height = np.asarray(height, dtype=float)
        flat = height.ravel()
        with np.errstate(invalid="ignore"):
            seen = (flat >= 0) & (flat <= self._heights[-1] * (1 + 1e-12))
        found = np.full_like(flat, np.nan)
        h = np.minimum(flat[seen], self._heights[-1])
        cell = np.clip(np.searchsorted(self._heights, h) - 1, 0, CHECKED - 2)

        def difference(t: Array) -> tuple[Array, Array]:
            value, rate = self.height(t)
            return value - h, rate

        start = np.interp(h, self._heights, self._tangents)
        found[seen] = increasing_root(difference, self._tangents[cell], self._tangents[cell + 1], start, self.end)
        return found.reshape(height.shape)
