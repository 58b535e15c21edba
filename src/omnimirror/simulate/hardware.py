"""What stands in the light: the camera under the mirror, and the rod that holds the two together."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..mirrors.reflectivity import Reflectivity, reflectance
from ..parameters import Parameter

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Hardware:
    """Camera and central rod about the lens's axis, and how the mirror and the lens dim the light.

    Heights count from the lens's principal point (the mirror's vertex under an orthographic lens) towards the
    mirror. By default nothing stands in the light and nothing is dimmed.

    Parameters
    ----------
    camera_radius_mm, camera_height_mm
        The camera as a disk that mirrored rays meet: it is seen in the middle of the picture.
    rod_from_mm, rod_to_mm, rod_radius_mm, rod_end_radius_mm
        A rod that tapers from the one height to the other; none where both are the same.
    lens_radius_mm
        The front ring of the camera's lens, which is made out on the disk: glass, rings, barrel, and a mark towards
        the picture's top.
    rim_width_mm
        A dark edge about the mirror's rim.
    grey
        Light that camera, rod and edge send out, linear, white at 1.
    reflectivity
        Share of the light that the mirror returns: a number, a metal's index ``n + 1j k`` or its name, which
        follow Fresnel's formulas (:func:`omnimirror.mirrors.reflectivity.reflectance`), or three of them, for
        red, green and blue.
    vignetting
        1: the natural one of a lens, with the fourth power of the cosine; 0: none.
    sees_past
        Whether the camera sees the world beside the mirror; else it is black there.

    Raises
    ------
    InvalidParameter
        A number outside its range.
    """

    camera_radius_mm: float = 0.0
    camera_height_mm: float = 0.0
    lens_radius_mm: float = 12.0
    rim_width_mm: float = 0.0
    rod_from_mm: float = 0.0
    rod_to_mm: float = 0.0
    rod_radius_mm: float = 0.0
    rod_end_radius_mm: float = 0.0
    grey: float = 0.02
    reflectivity: Reflectivity | tuple[Reflectivity, Reflectivity, Reflectivity] = 1.0
    vignetting: float = 0.0
    sees_past: bool = False

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "camera_radius_mm": Parameter("mm", 0.0, 1e5, "radius of the camera as the mirror shows it"),
        "camera_height_mm": Parameter("mm", -1e5, 1e5, "height of the camera's front"),
        "lens_radius_mm": Parameter("mm", 1e-3, 1e5, "radius of the front ring of the camera's lens"),
        "rim_width_mm": Parameter("mm", 0.0, 1e4, "width of a dark edge about the mirror's rim"),
        "rod_from_mm": Parameter("mm", -1e5, 1e5, "height at which the rod begins"),
        "rod_to_mm": Parameter("mm", -1e5, 1e5, "height at which the rod ends"),
        "rod_radius_mm": Parameter("mm", 0.0, 1e5, "radius of the rod where it begins"),
        "rod_end_radius_mm": Parameter("mm", 0.0, 1e5, "radius of the rod where it ends"),
        "grey": Parameter("", 0.0, 1e3, "light that camera, rod and edge send out"),
        "vignetting": Parameter("", 0.0, 1.0, "share of the natural vignetting of the lens"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            if f.name in self.PARAMETERS:
                self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        for each in self.reflectivity if isinstance(self.reflectivity, tuple) else (self.reflectivity,):
            reflectance(0.0, each)

    def returned(self, gamma: Array) -> Array:
        """Share (n,) of the light that the mirror returns at angles of incidence (n,), radians; of one colour."""
        assert not isinstance(self.reflectivity, tuple)
        return reflectance(gamma, self.reflectivity)

    def of_colours(self) -> tuple[Hardware, Hardware, Hardware] | None:
        """The same hardware as red, green and blue light meet it; None where that is all the same."""
        if not isinstance(self.reflectivity, tuple):
            return None
        red, green, blue = (replace(self, reflectivity=each) for each in self.reflectivity)
        return red, green, blue

    @property
    def has_rod(self) -> bool:
        """Whether there is a rod."""
        return self.rod_to_mm > self.rod_from_mm

    def hides(self, points: Array, directions: Array, towards_lens: Array) -> Mask:
        """Which mirrored rays (n,) camera or rod stop, on their way out or between lens and mirror.

        Parameters
        ----------
        points, directions : (n, 3) arrays
            Where rays leave the mirror, and their directions into the world, in the camera frame (right, down,
            towards the mirror) from the lens's principal point.
        towards_lens : (n, 3) array
            Directions from there back to the lens.
        """
        hidden = self._meets_camera(points, directions)[0]
        if self.has_rod:
            hidden |= self._meets_rod(points, directions) | self._meets_rod(points, towards_lens)
        return hidden

    def shade(self, points: Array, directions: Array, towards_lens: Array) -> Array:
        """How light (n,), against ``grey``, what mirrored rays meet is: the camera's front has parts, all else is 1."""
        meets, across = self._meets_camera(points, directions)
        if self.has_rod:
            meets &= ~(self._meets_rod(points, directions) | self._meets_rod(points, towards_lens))
        return np.where(meets, _front(across / self.lens_radius_mm), 1.0)

    def _meets_camera(self, points: Array, directions: Array) -> tuple[Mask, Array]:
        """Which rays (n,) meet the camera's disk, and where (n, 2) mm from the axis they cross its plane."""
        with np.errstate(divide="ignore", invalid="ignore"):
            down = (self.camera_height_mm - points[:, 2]) / directions[:, 2]
            across: Array = points[:, :2] + down[:, None] * directions[:, :2]
            meets: Mask = (directions[:, 2] < 0) & ((across**2).sum(axis=1) < self.camera_radius_mm**2)
        return meets, across

    def _meets_rod(self, points: Array, directions: Array) -> Mask:
        """Which rays (n,) meet the rod, a piece of a cone, on its side or its ends."""
        taper = (self.rod_end_radius_mm - self.rod_radius_mm) / (self.rod_to_mm - self.rod_from_mm)
        (x, y, z), (dx, dy, dz) = points.T, directions.T
        radius, widening = self.rod_radius_mm + taper * (z - self.rod_from_mm), taper * dz
        a = dx**2 + dy**2 - widening**2
        b = x * dx + y * dy - radius * widening
        disc = b**2 - a * (x**2 + y**2 - radius**2)
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (-b - np.sqrt(np.maximum(disc, 0))) / a
            at = z + t * dz
            meets: Mask = (disc > 0) & (t > 0) & (at >= self.rod_from_mm) & (at <= self.rod_to_mm)
            for height, end in ((self.rod_from_mm, self.rod_radius_mm), (self.rod_to_mm, self.rod_end_radius_mm)):
                t = (height - z) / dz
                meets |= (t >= 0) & ((x + t * dx) ** 2 + (y + t * dy) ** 2 < end**2)
        return meets


def _front(place: Array) -> Array:
    """How light (n,) a camera's front is at places (n, 2) in radii of its lens's front ring; as in the kernels."""
    x, y = place.T
    with np.errstate(invalid="ignore"):
        q = np.hypot(x, y)
        glint = np.hypot(x + 0.2, y + 0.25) < 0.12
        mark = (np.abs(x) < 0.12) & (y < 0) & (q > 1.15) & (q < 1.55)
        parts = [
            (glint & (q < 0.62), 12.0), (q < 0.55, 0.25), (q < 0.62, 1.0), (q < 0.74, 6.0), (q < 1.0, 1.5),
            (q < 1.06, 0.3), (mark, 12.0), (q < 2.2, 1.0),
        ]  # fmt: skip
    return np.select([where for where, _ in parts], [light for _, light in parts], 0.7)
