"""The quantities that a requirement can set a limit to, and limits themselves.

A quantity is judged by its worst field angle in a part of the field. The same definition serves the table
of a finished design and the rows that an optimiser keeps within limits, real or complex.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..specs import did_you_mean
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
    is_sharpness
        Whether it depends on where the lens is focused, other than through the scale of the image.
    """

    unit: str
    meaning: str
    parts: Callable[[Field], tuple[Array, ...]]
    takes: Literal["largest", "smallest", "spread", "ratio"]
    is_sharpness: bool = False

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
            return _beside([part - limit for part in self.parts(field)])
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


def _blur(*names: str) -> Callable[[Field], tuple[Array, ...]]:
    """Signed blurs by both signs, so that the largest is a magnitude."""
    return lambda f: tuple(sign * getattr(f, name) for name in names for sign in (1, -1))


QUANTITIES: dict[str, Quantity] = {
    "blur_px": Quantity("px", "larger of tangential and sagittal blur", _blur("t_px", "s_px"), "largest", True),
    "blur_t_px": Quantity("px", "tangential blur", _blur("t_px"), "largest", True),
    "blur_s_px": Quantity("px", "sagittal blur", _blur("s_px"), "largest", True),
    "blur_deg": Quantity("deg", "larger of both blurs, in angle", _blur("t_deg", "s_deg"), "largest", True),
    "blur_t_deg": Quantity("deg", "tangential blur in angle", _blur("t_deg"), "largest", True),
    "blur_s_deg": Quantity("deg", "sagittal blur in angle", _blur("s_deg"), "largest", True),
    "floored_area_deg2": Quantity(
        "deg²", "blur area with a pixel and the Airy disk", lambda f: (np.exp(f.log_area),), "largest", True
    ),
    "resolution_px_per_deg": Quantity(
        "px/deg", "smaller of radial and tangential resolution", lambda f: (f.dh, f.dw), "smallest"
    ),
    "resolution_t_px_per_deg": Quantity("px/deg", "radial resolution Dh", lambda f: (f.dh,), "smallest"),
    "resolution_s_px_per_deg": Quantity("px/deg", "resolution around the circle Dw", lambda f: (f.dw,), "smallest"),
    "aspect": Quantity("", "width to height of a small square", lambda f: (f.dw / f.dh,), "smallest"),
    "viewpoint_spread_mm": Quantity("mm", "highest less lowest viewpoint", lambda f: (f.viewpoint_z,), "spread"),
    "area_ratio": Quantity("", "smallest to largest image of a square degree", lambda f: (f.dh * f.dw,), "ratio"),
    "length_mm": Quantity("mm", "from the lens to the farther of rim and vertex", lambda f: (f.reach,), "largest"),
    "sag_mm": Quantity("mm", "height of the mirror along its axis", lambda f: (f.sag,), "largest"),
}
"""What a ``[[limit]]`` can be set to, by its name."""


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
        if self.quantity not in QUANTITIES:
            hint = did_you_mean(self.quantity, QUANTITIES)
            raise InvalidParameter(
                f"limit.quantity = {self.quantity!r} is not known{hint}; valid are {', '.join(QUANTITIES)}"
            )
        if self.at_most is None and self.at_least is None:
            raise InvalidParameter(f"limit of {self.quantity} says neither at_most nor at_least")
        if self.at_most is not None and self.at_least is not None and self.at_least > self.at_most:
            raise InvalidParameter(f"limit of {self.quantity}: at_least is above at_most")
        if self.omega_deg is not None and not 0 <= self.omega_deg[0] < self.omega_deg[1]:
            raise InvalidParameter(
                f"limit.omega_deg = {list(self.omega_deg)} is no part of the field; it needs FROM below TO"
            )

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

    def excess(self, field: Field) -> Array:
        """By what share of what is asked it is missed, as rows (.., r) of which each is smooth; below 0 where kept."""
        rows = []
        if self.at_most is not None:
            rows.append(self.of.above(field, self.at_most))
        if self.at_least is not None:
            rows.append(self.of.below(field, self.at_least))
        return np.concatenate(rows, axis=-1) / self.scale
