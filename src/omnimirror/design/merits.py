"""What a design can be good at: one number of a whole field, from what happens at each field angle.

A merit is the largest of many smooth rows, such as the blur at each angle, so that a sequence of linear
programmes can press the largest one down; or their mean. All are the better the smaller they are.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter

Array = NDArray[Any]

PROJECTIONS = 8


class Field(NamedTuple):
    """What merits look at; arrays (.., k) over k field angles, and (.., 1) where one number holds for all."""

    t_deg: Array
    """Signed tangential blur in degrees of the object (Eq. 36)."""
    s_deg: Array
    """Signed sagittal blur (Eq. 37)."""
    log_area: Array
    """Logarithm of the floored blur area in square degrees."""
    log_density: Array
    """Logarithm of Ds: pixels on a square degree of the object (Eq. 11)."""
    log_aspect: Array
    """Logarithm of Dw/Dh (Eq. 12)."""
    viewpoint_z: Array
    """Height of the viewpoint over the vertex, mm (Eq. 6)."""
    length: Array
    """From imager to rim along the axis, mm."""
    solid_angle: Array
    """Share of the solid angle that belongs to each field angle, up to a factor."""


def field_of(result: Any, length_mm: ArrayLike) -> Field:
    """What merits look at, from the columns of an :class:`~omnimirror.analysis.Evaluation` or of a batch of designs.

    Field angles have to grow along the last axis; ``length_mm`` is from imager to rim, (..).
    """
    dh, dw = result.dh_domega_px_per_deg, result.width_px_per_deg
    omega = np.radians(result.omega_deg)
    with np.errstate(all="ignore"):
        steps = np.diff(omega, axis=-1) / 2
        share = np.sin(omega)
        share = np.concatenate([share[..., :-1] * steps, np.zeros_like(share[..., :1])], -1) + np.concatenate(
            [np.zeros_like(share[..., :1]), share[..., 1:] * steps], -1
        )
        return Field(
            result.blur_t_px / dh, result.blur_s_px / dw, np.log(result.floored_area_deg2), np.log(dh * dw),
            np.log(dw / dh), result.viewpoint_z_mm, np.asarray(length_mm, dtype=float)[..., None], share,
        )  # fmt: skip


@dataclass(frozen=True)
class Merit:
    """One merit: its rows, and what the largest of them means.

    Attributes
    ----------
    rows
        Parts whose largest element is to be small; each of the shape of a field's arrays.
    shown, hidden
        The number shown, from the largest element; and the way back.
    is_spread
        Whether the rows count from a level that is free: the merit is then half of largest minus least.
    is_sharpness
        Whether it depends on where the lens is focused, other than through the scale of the image.
    is_mean
        Whether the mean over the solid angle counts, and not the largest.
    """

    name: str
    unit: str
    meaning: str
    rows: Callable[[Field], tuple[Array, ...]]
    shown: Callable[[Array], Array]
    hidden: Callable[[Array], Array]
    is_spread: bool = False
    is_mean: bool = False
    is_sharpness: bool = True

    def value(self, field: Field, counts: NDArray[np.bool_] | None = None) -> Array:
        """The merit (..) of fields (.., k), over the angles that count."""
        with np.errstate(all="ignore"):
            rows = np.stack(np.broadcast_arrays(*self.rows(field)))
            if self.is_mean:
                weights = np.broadcast_to(field.solid_angle, rows.shape[1:])
                weights = weights if counts is None else np.where(counts, weights, 0.0)
                return self.shown((np.where(weights > 0, np.exp(rows[0]), 0.0) * weights).sum(-1) / weights.sum(-1))
            keep = np.ones(rows.shape[1:], bool) if counts is None else np.broadcast_to(counts, rows.shape[1:])
            largest = np.where(keep, rows, -np.inf).max(axis=(0, -1))
            if self.is_spread:
                largest = (largest - np.where(keep, rows, np.inf).min(axis=(0, -1))) / 2
            return self.shown(largest)


def _either_sign(*parts: Callable[[Field], Array]) -> Callable[[Field], tuple[Array, ...]]:
    return lambda f: tuple(sign * part(f) for part in parts for sign in (1, -1))


def _same(value: Array) -> Array:
    return value


def _length_of(t: Array, s: Array) -> tuple[Array, ...]:
    """The length of (t, s), and its projections, which never exceed it: straight rows that tell a linear programme
    how the length bends."""
    directions = 2 * np.pi * np.arange(PROJECTIONS) / PROJECTIONS
    return (np.sqrt(t * t + s * s), *(t * np.cos(a) + s * np.sin(a) for a in directions))


MERITS: dict[str, Merit] = {
    m.name: m
    for m in (
        Merit("blur_area", "deg2", "worst floored blur area", lambda f: (f.log_area,), np.exp, np.log),
        Merit("mean_blur_area", "deg2", "mean floored blur area over the solid angle", lambda f: (f.log_area,),
              _same, _same, is_mean=True),
        Merit("blur", "deg", "worst single blur, tangential or sagittal",
              _either_sign(lambda f: f.t_deg, lambda f: f.s_deg), _same, _same),
        Merit("blur_rss", "deg", "worst root of the squares of both blurs",
              lambda f: _length_of(f.t_deg, f.s_deg), _same, _same),
        Merit("blur_t", "deg", "worst tangential blur", _either_sign(lambda f: f.t_deg), _same, _same),
        Merit("blur_s", "deg", "worst sagittal blur", _either_sign(lambda f: f.s_deg), _same, _same),
        Merit("uniformity", "", "most over fewest pixels per square degree; 1 is equiareal",
              lambda f: (f.log_density,), lambda t: np.exp(2 * t), lambda t: np.log(t) / 2, is_spread=True,
              is_sharpness=False),
        Merit("aspect", "", "worst ratio of width to height, or of height to width; 1 is conformal",
              _either_sign(lambda f: f.log_aspect), np.exp, np.log, is_sharpness=False),
        Merit("viewpoint_spread", "mm", "highest minus lowest viewpoint", lambda f: (f.viewpoint_z,),
              lambda t: 2 * t, lambda t: t / 2, is_spread=True, is_sharpness=False),
        Merit("length", "mm", "imager to rim", lambda f: (f.length,), _same, _same, is_sharpness=False),
    )
}  # fmt: skip
"""Every merit by its name."""


def merit_named(name: str) -> Merit:
    """The merit of that name.

    Raises
    ------
    InvalidParameter
        There is none.
    """
    if name not in MERITS:
        raise InvalidParameter(f"merit {name!r} is not known; valid are {', '.join(MERITS)}")
    return MERITS[name]
