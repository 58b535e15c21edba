"""A lens by what it does at each angle of its field: the functions that its table, or its surfaces, are made into.

All are smooth functions of the tangent t of the viewing angle, odd or even about the axis: splines of fifth degree,
whose derivatives are continuous to the fourth. Seen from where the entrance pupil stands at an angle, rays of one image
point go through a pupil point (y_t, y_s) with slopes ``t - y_t v_t`` and ``-y_s v_s``: v_t and v_s are the vergences in
focus, tangential and sagittal, which differ from that on the axis by the curvature of the field and by astigmatism.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.numerics.roots import increasing_root
from .pupil import ChiefAim, EntrancePupil

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Array = NDArray[np.float64]

DEGREE = 5
LEAST_NODES = 4
CHECKED = 513  # places at which a picture is proven to grow outwards
STEPS = 50
CLOSE = 1e-14


class FieldNodes(NamedTuple):
    """What a lens does at n field angles from the axis outwards; lengths in mm, vergences in 1/mm."""

    tangent: Array
    """(n,) of the viewing angles, from 0."""
    height: Array
    """(n,) image heights."""
    pupil: Array
    """(n,) places of the entrance pupil, towards the mirror from the reference point."""
    vergence_t: Array
    """(n,) in focus for the tangential fan, at the pupil, along the axis."""
    vergence_s: Array
    scale_t: Array
    """(n,) image of a change of slope through a point of the pupil."""
    scale_s: Array
    width_t: Array
    """(n,) half width of the pupil in the meridian, over that on the axis; vignetting makes it less."""
    width_s: Array
    shift_t: Array
    """(n,) by how much the middle of the pupil that is left lies off the chief ray, over its radius on the axis."""
    illumination: Array
    """(n,) of the imager, over that on the axis."""
    own_t: Array
    """(n,) blur of the lens alone in its own focus, mm: four times the standard deviation of its rays."""
    own_s: Array
    short: Array
    """(n,) by how much images of the shortest wavelength are higher than those of the middle one."""
    long: Array
    """(n,) the same of the longest."""
    stop_t: Array
    """(n,) half width in the meridian of the pupil without vignetting, over that on the axis."""
    stop_s: Array
    stop_shift: Array
    """(n,) distance of its middle from the chief ray, over its radius on the axis."""
    openness: Array
    """(n,) share of its area that vignetting leaves."""


class LensValues(NamedTuple):
    """The even functions of a field at k tangents, (k,) each; names as in :class:`FieldNodes`."""

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
    """An entrance pupil that moves with the viewing angle; ``at_mm`` is where it stands for rays near the axis."""

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
        """By Newton's rule: ``(depth - z(t)) t = x``."""
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
    """A spline through values (n, m) at tangents (n,) from 0, mirrored to the other side of the axis."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([values[:0:-1], values]), k=DEGREE)


def odd_spline(tangent: Array, values: Array) -> BSpline:
    """The same turned over on the other side."""
    from scipy.interpolate import make_interp_spline

    both = np.concatenate([-tangent[:0:-1], tangent])
    return make_interp_spline(both, np.concatenate([-values[:0:-1], values]), k=DEGREE)


class LensField:
    """The functions of a lens's field.

    Parameters
    ----------
    nodes
        Four or more.
    name
        Name of the lens in errors.
    at_fold, at_end
        Advice in the errors for image heights that stop growing at an angle, which replaces ``{angle}``, and for angles
        past the end of the field.

    Raises
    ------
    InvalidParameter
        Image heights that do not grow outwards.
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
        """Raise InvalidParameter for tangents past the end of the field, rounding forgiven."""
        past = tangent > self.end * (1 + 1e-12)
        if past.any():
            last, asked = (float(np.degrees(np.arctan(v))) for v in (self.end, np.max(tangent)))
            raise InvalidParameter(
                f"{self.name} ends at {last:.4g} deg from its axis, and the mirror reaches {asked:.4g} deg; use a "
                f"smaller or more distant mirror, or {self.at_end}"
            )

    def at(self, tangent: Array) -> LensValues:
        """The even functions at tangents (k,)."""
        return LensValues(*np.moveaxis(self._even(np.minimum(tangent, self.end)), -1, 0))

    def odd(self, tangent: Array) -> dict[str, Array]:
        """The odd functions at tangents (k,), by name."""
        values = np.where(np.asarray(tangent)[..., None] == 0.0, 0.0, self._odd(np.minimum(tangent, self.end)))
        return dict(zip(ODD, np.moveaxis(values, -1, 0), strict=True))

    def height(self, tangent: Array) -> tuple[Array, Array]:
        """Image heights (k,) mm and their derivatives by the tangent; straight on past the end of the field."""
        inside = np.minimum(tangent, self.end)
        rate = self._rate(inside)[..., 0]
        height = self._odd(inside)[..., 0] + rate * (tangent - inside)
        return np.where(tangent == 0.0, 0.0, height), rate  # but for the rounding of splines

    def tangent_of(self, height: Array) -> Array:
        """Tangents (k,) of image heights; NaN past the end of the field."""
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
