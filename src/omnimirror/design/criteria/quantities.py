"""The quantities that a requirement can set a limit to, and limits themselves.

A quantity is judged by its worst field angle in a part of the field. The same definition serves the table
of a finished design and the rows that an optimiser keeps within limits, real or complex.

A blur that is limited is what the imager gets of a point: the geometric blur (Eq. 28) and the Airy disk,
added in quadrature, ``sqrt(blur^2 + Airy^2)``; in angle both over Dh or Dw. Without the disk a lens that is
stopped down far enough would pass as sharp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...arguments import finite, number, shown
from ...errors import InvalidParameter
from ...specs import did_you_mean
from .merits import Field

Array = NDArray[Any]

REFERENCES = 16


@dataclass(frozen=True)
class Quantity:
    """A quantity by its name, with its unit and how it is had.

    Attributes
    ----------
    parts
        Arrays (.., k) over the field angles, or (.., 1).
    takes
        What counts at a field angle: the largest or the smallest of the parts. ``"spread"`` and ``"ratio"`` have one
        part and give one number for the whole part of the field: largest less smallest, smallest over largest.
    straight
        Arrays that are never above the largest part and bend less, which tell a linear model how that part bends.
    is_sharpness
        Whether it depends on where the lens is focused, other than through the scale of the image.
    is_blur
        Whether it is a blur with its Airy disk, and so depends on the F-number.
    is_scale
        Whether it grows with the image, whose scale follows from the focus too.
    """

    unit: str
    meaning: str
    parts: Callable[[Field], tuple[Array, ...]]
    takes: Literal["largest", "smallest", "spread", "ratio"]
    is_sharpness: bool = False
    is_blur: bool = False
    is_scale: bool = False
    straight: Callable[[Field], tuple[Array, ...]] = lambda field: ()

    def values(self, field: Field) -> Array:
        """What counts at each field angle (.., k); of a spread or a ratio for all of them (.., 1)."""
        parts = self.parts(field)
        if self.takes in ("largest", "smallest"):
            value = parts[0]
            for part in parts[1:]:
                is_other = part.real > value.real if self.takes == "largest" else part.real < value.real
                value = np.where(is_other, part, value)
            return value
        low, high = (_at(parts[0], where) for where in (parts[0].real.argmin(-1), parts[0].real.argmax(-1)))
        return high - low if self.takes == "spread" else low / high

    def extreme(self, field: Field, largest: bool) -> tuple[float, int | None]:
        """The largest or smallest value of one field (k,), and at which field angle."""
        values = self.values(field)
        if values.size == 1:
            return float(values[0]), None
        i = int(np.nanargmax(values) if largest else np.nanargmin(values))
        return float(values[i]), i

    def above(self, field: Field, limit: float) -> Array:
        """How far it is above a limit, as rows (.., r) of which each is smooth."""
        if self.takes == "largest":
            return _beside([part - limit for part in (*self.parts(field), *self.straight(field))])
        if self.takes == "spread":
            (part,) = self.parts(field)
            return _beside([part - one - limit for one in _references(part, part.real.argmin(-1))])
        return self.values(field) - limit

    def below(self, field: Field, limit: float) -> Array:
        """How far it is below a limit, as rows (.., r) of which each is smooth."""
        if self.takes == "smallest":
            return _beside([limit - part for part in self.parts(field)])
        if self.takes == "ratio":
            (part,) = self.parts(field)
            return _beside([limit - part / one for one in _references(part, part.real.argmax(-1))])
        return limit - self.values(field)


def _at(values: Array, where: Array) -> Array:
    """The values (.., 1) at some places (..)."""
    return np.take_along_axis(values, np.asarray(where)[..., None], axis=-1)


def _references(part: Array, extreme: Array) -> list[Array]:
    """Values (.., 1) that all others are compared with: the extreme one, and some that may become it.

    With the extreme one alone a linear model would not foresee that another takes its place.
    """
    some = np.linspace(0, part.shape[-1] - 1, REFERENCES).astype(int)
    return [_at(part, extreme), *(part[..., i : i + 1] for i in some)]


def _beside(rows: list[Array]) -> Array:
    return np.concatenate(np.broadcast_arrays(*rows), axis=-1)


Disk = Callable[[Field], tuple[Array, Array]]
"""A signed blur, and the Airy disk in the same unit."""


def _in_quadrature(blur: Array, airy: Array) -> Array:
    length: Array = np.sqrt(blur * blur + airy * airy)
    return length


def _blur(unit: str, meaning: str, *disks: Disk) -> Quantity:
    """The larger of some blurs with their Airy disks; straight are the blurs by themselves, by both signs."""
    return Quantity(
        unit,
        meaning,
        lambda f: tuple(_in_quadrature(*disk(f)) for disk in disks),
        "largest",
        is_sharpness=True,
        is_blur=True,
        straight=lambda f: tuple(sign * disk(f)[0] for disk in disks for sign in (1, -1)),
    )


T_PX: Disk = lambda f: (f.t_px, f.airy_px)  # noqa: E731 - a table of four
S_PX: Disk = lambda f: (f.s_px, f.airy_px)  # noqa: E731
T_DEG: Disk = lambda f: (f.t_deg, f.airy_px / f.dh)  # noqa: E731
S_DEG: Disk = lambda f: (f.s_deg, f.airy_px / f.dw)  # noqa: E731


QUANTITIES: dict[str, Quantity] = {
    "blur_px": _blur("px", "larger of tangential and sagittal blur, with the Airy disk", T_PX, S_PX),
    "blur_t_px": _blur("px", "tangential blur, with the Airy disk", T_PX),
    "blur_s_px": _blur("px", "sagittal blur, with the Airy disk", S_PX),
    "blur_deg": _blur("deg", "larger of both blurs in angle, with the Airy disk", T_DEG, S_DEG),
    "blur_t_deg": _blur("deg", "tangential blur in angle, with the Airy disk", T_DEG),
    "blur_s_deg": _blur("deg", "sagittal blur in angle, with the Airy disk", S_DEG),
    "floored_area_deg2": Quantity(
        "deg²", "blur area with a pixel and the Airy disk", lambda f: (np.exp(f.log_area),), "largest", True
    ),
    "resolution_px_per_deg": Quantity(
        "px/deg", "smaller of radial and tangential resolution", lambda f: (f.dh, f.dw), "smallest", is_scale=True
    ),
    "resolution_t_px_per_deg": Quantity("px/deg", "radial resolution Dh", lambda f: (f.dh,), "smallest", is_scale=True),
    "resolution_s_px_per_deg": Quantity(
        "px/deg", "resolution around the circle Dw", lambda f: (f.dw,), "smallest", is_scale=True
    ),
    "aspect": Quantity("", "width to height of a small square", lambda f: (f.dw / f.dh,), "smallest"),
    "viewpoint_spread_mm": Quantity("mm", "highest less lowest viewpoint", lambda f: (f.viewpoint_z,), "spread"),
    "area_ratio": Quantity("", "smallest to largest image of a square degree", lambda f: (f.dh * f.dw,), "ratio"),
    "length_mm": Quantity("mm", "from the lens to the farther of rim and vertex", lambda f: (f.reach,), "largest"),
    "sag_mm": Quantity("mm", "height of the mirror along its axis", lambda f: (f.sag,), "largest"),
}
"""What a ``[[limit]]`` can be set to, by its name."""

NEVER_ABOVE = {
    "blur_t_px": ("blur_px",),
    "blur_s_px": ("blur_px",),
    "blur_t_deg": ("blur_deg",),
    "blur_s_deg": ("blur_deg",),
    "resolution_px_per_deg": ("resolution_t_px_per_deg", "resolution_s_px_per_deg"),
    "sag_mm": ("length_mm",),
}
"""By a quantity those that it is never above, whatever the sensor: of whose parts it is one, or whose smaller it is."""


@dataclass(frozen=True)
class Limit:
    """What a quantity may be, over the whole field or from one field angle to another.

    Raises
    ------
    InvalidParameter
        An unknown quantity, no limit, or one that is empty.

    >>> Limit("blur_px", at_most=4.0).label
    'blur_px'
    >>> Limit("aspect", at_least=0.8, omega_deg=(20.0, 100.0)).label
    'aspect, 20 to 100 deg'
    """

    quantity: str
    at_most: float | None = None
    at_least: float | None = None
    omega_deg: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.quantity, str) or self.quantity not in QUANTITIES:
            hint = did_you_mean(str(self.quantity)[:60], QUANTITIES)
            raise InvalidParameter(
                f"limit.quantity = {shown(self.quantity)} is not known{hint}; valid are {', '.join(QUANTITIES)}"
            )
        if self.at_most is None and self.at_least is None:
            raise InvalidParameter(f"limit of {self.quantity} says neither at_most nor at_least")
        for side in ("at_most", "at_least"):
            if (value := getattr(self, side)) is not None:
                self._check_side(side, value)
        if self.at_most is not None and self.at_least is not None and self.at_least > self.at_most:
            raise InvalidParameter(f"limit of {self.quantity}: at_least is above at_most")
        if self.omega_deg is not None:
            low, high = finite("limit.omega_deg", self.omega_deg, last=2)
            object.__setattr__(self, "omega_deg", (float(low), float(high)))
            if not 0 <= low <= high:
                raise InvalidParameter(
                    f"limit.omega_deg = {list(self.omega_deg)} is no part of the field; it needs FROM up to TO"
                )

    def _check_side(self, side: str, value: float) -> None:
        number(f"{side} of {self.quantity}", value)
        if value < 0:
            raise InvalidParameter(
                f"limit of {self.quantity}: {side} = {value:g} is below 0, which no {self.quantity} is; "
                "it is valid from 0 up"
            )
        if side == "at_most" and value == 0 and self.of.takes != "spread":
            raise InvalidParameter(
                f"limit of {self.quantity}: at_most = 0 is kept by no sensor, whose {self.quantity} is above 0; "
                "it is valid above 0"
            )
        if side == "at_least" and self.of.takes == "ratio" and value > 1:
            raise InvalidParameter(
                f"limit of {self.quantity}: at_least = {value:g} is above 1, which no ratio of smallest to largest is"
            )

    def contradicts(self, other: Limit) -> str | None:
        """Why this limit and another cannot both be kept, if that is plain from their numbers."""
        for low, high in ((self, other), (other, self)):
            if low.at_least is None or high.at_most is None or low.at_least <= high.at_most:
                continue
            if not (high.quantity in (low.quantity, *NEVER_ABOVE.get(low.quantity, ())) and _are_comparable(low, high)):
                continue
            if low.quantity == high.quantity:
                return f"{low.quantity} at least {low.at_least:g} and at most {high.at_most:g}"
            return (
                f"{low.quantity} at least {low.at_least:g} and {high.quantity} at most {high.at_most:g}, "
                "which is never the smaller"
            )
        return None

    @property
    def of(self) -> Quantity:
        return QUANTITIES[self.quantity]

    @property
    def scale(self) -> float:
        """The size of what is asked, by which limits of different units are compared."""
        return max(abs(v) for v in (self.at_least, self.at_most) if v is not None) or 1.0

    @property
    def label(self) -> str:
        """The quantity, with the part of the field."""
        return self.quantity + (f", {self.omega_deg[0]:g} to {self.omega_deg[1]:g} deg" if self.omega_deg else "")

    def missed(self, field: Field) -> Array:
        """By what share (..) of what is asked fields (.., k) miss it at worst; below 0 by what share they keep it."""
        values = self.of.values(field)
        with np.errstate(invalid="ignore"):
            high = -np.inf if self.at_most is None else np.fmax.reduce(values, axis=-1) - self.at_most
            low = -np.inf if self.at_least is None else self.at_least - np.fmin.reduce(values, axis=-1)
        share: Array = np.maximum(high, low) / self.scale
        return share

    def excess(self, field: Field) -> Array:
        """By what share of what is asked it is missed, as rows (.., r) of which each is smooth; below 0 where kept."""
        rows = []
        if self.at_most is not None:
            rows.append(self.of.above(field, self.at_most))
        if self.at_least is not None:
            rows.append(self.of.below(field, self.at_least))
        return np.concatenate(rows, axis=-1) / self.scale


def _are_comparable(low: Limit, high: Limit) -> bool:
    """Whether what is at least so much, and what is at most so much, are of one field angle; a spread grows with its
    part of the field, a ratio falls."""
    (a, b), (c, d) = (limit.omega_deg or (0.0, 180.0) for limit in (low, high))
    match low.of.takes:
        case "spread":
            return c <= a and b <= d
        case "ratio":
            return a <= c and d <= b
        case _:
            return max(a, c) <= min(b, d)
