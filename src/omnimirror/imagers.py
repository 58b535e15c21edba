"""The pixel array: its size, its pitch, and where the mirror axis meets it."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

from .arguments import numbers
from .errors import InvalidParameter
from .parameters import Parameter


@dataclass(frozen=True)
class Imager:
    """A rectangular array of square pixels.

    Parameters
    ----------
    width_px, height_px
    pixel_pitch_um : micrometres
    centre_px : (u, v), optional
        Where the optical axis meets the array; integers are pixel centres. The middle by default.

    Raises
    ------
    InvalidParameter
        For a size or pitch outside its range.

    Examples
    --------
    >>> Imager(1024, 1024, 5.2).centre
    (511.5, 511.5)
    """

    width_px: int
    height_px: int
    pixel_pitch_um: float
    centre_px: tuple[float, float] | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "width_px": Parameter("px", 1, 100_000, "number of columns"),
        "height_px": Parameter("px", 1, 100_000, "number of rows"),
        "pixel_pitch_um": Parameter("um", 0.01, 1e4, "distance of neighbouring pixels"),
        "centre_px": Parameter("px", -1e6, 1e6, "where the optical axis meets the array, (u, v)"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None or f.name != "centre_px":
                self.PARAMETERS[f.name].check(f.name, value)
        for name in ("width_px", "height_px"):
            value = numbers(name, getattr(self, name), "(it takes one)")
            if value.ndim or int(value) != value:
                raise InvalidParameter(f"{name} = {getattr(self, name)} is not a whole number of pixels")
        if self.centre_px is not None:
            if len(self.centre_px) != 2:
                raise InvalidParameter(f"centre_px has {len(self.centre_px)} numbers; it needs two, u and v")
            object.__setattr__(self, "centre_px", (float(self.centre_px[0]), float(self.centre_px[1])))

    @property
    def pitch_mm(self) -> float:
        return self.pixel_pitch_um * 1e-3

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.width_px, self.height_px

    @property
    def centre(self) -> tuple[float, float]:
        """Where the optical axis meets the array, (u, v) in pixels."""
        return self.centre_px or ((self.width_px - 1) / 2, (self.height_px - 1) / 2)

    @property
    def inscribed_radius_px(self) -> float:
        """Radius of the largest circle about the optical axis that the array holds, pixels.

        >>> Imager(1280, 1024, 4.8).inscribed_radius_px
        512.0
        """
        u, v = self.centre
        return min(u, v, self.width_px - 1 - u, self.height_px - 1 - v) + 0.5

    @property
    def long_radius_px(self) -> float:
        """Radius of the largest circle about the optical axis that the array's long side holds, pixels.

        >>> Imager(1920, 1080, 3.0).long_radius_px
        960.0
        """
        u, v = self.centre
        return max(min(u, self.width_px - 1 - u), min(v, self.height_px - 1 - v)) + 0.5
