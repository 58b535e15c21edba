"""What calibrated central cameras share: one viewpoint at the world origin, and a radius for every field angle.

A model says how the image radius grows with the field angle Omega, and in which direction along the
optical axis its centre looks: back past the lens (a mirror) or ahead (a fisheye). Everything else,
from the mount to the edge of the picture, is decided here, once.

The numbers of a calibration belong to the picture it was made with. So centres and radii are those of
the picture *as delivered*, and ``mount.image_flipped`` only says that this picture is reversed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..arguments import finite
from ..cameras import AxialSymmetry, Projection, Rays, inside_image
from ..errors import InvalidParameter
from ..frames import Mount, turned

Array = NDArray[np.float64]

ROUNDING = 1e-12  # relative; an angle or radius this little past the rim is the rim
LARGEST_PICTURE_PX = 100_000


class CentralCamera(ABC):
    """A camera that sees every ray from one point, the world origin; satisfies the Camera contract."""

    centre_px: tuple[float, float]
    image_size: tuple[int, int]
    mount: Mount

    # -- what a model says ---------------------------------------------------------------------

    @property
    @abstractmethod
    def looks_back(self) -> bool:
        """Whether the centre of the picture looks back past the lens (-Z), as with a mirror."""

    @property
    @abstractmethod
    def field_radius_px(self) -> float:
        """Radius of the circle in the picture inside which the model is used."""

    @abstractmethod
    def omega_from_radius(self, radius_px: Array) -> Array:
        """Field angles (n,) in radians of radii (n,) in px, none beyond :attr:`field_radius_px`."""

    @abstractmethod
    def radius_from_omega(self, omega: Array) -> Array:
        """Radii (n,) in px of field angles (n,) in radians, none beyond :attr:`omega_max`."""

    @property
    def stretch(self) -> Array:
        """Matrix (2, 2) from the round picture to the real one, both (right, down)."""
        return np.eye(2)

    # -- what follows --------------------------------------------------------------------------

    @property
    def omega_max(self) -> float:
        """Largest field angle, radians from :attr:`axis`."""
        return float(self.omega_from_radius(np.array([self.field_radius_px]))[0])

    @property
    def axis(self) -> Array:
        """World direction (3,) that the centre of the picture sees."""
        return self._forward * self.mount.rotation()[:, 2]

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """The axis of symmetry; None when the picture is stretched."""
        if not np.array_equal(self.stretch, np.eye(2)):
            return None
        x, y, _ = self.mount.rotation().T
        right, down = self._handedness[0] * x, self._handedness[1] * y
        return AxialSymmetry(self.centre_px, self.axis, right, down, 0.0, self.omega_max, self.radius_from_omega)

    @property
    def is_picture_reversed(self) -> bool:
        """Whether the raw picture is a mirror image: text runs backwards and markers go undetected."""
        return self.looks_back != self.mount.image_flipped

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) px; every origin is the viewpoint, (0, 0, 0).

        Pixels outside the picture or the model's field are not valid and NaN.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and where they are valid (n,).
        """
        pixels = np.asarray(pixels, dtype=float)
        plane = turned(pixels - self.centre_px, np.linalg.inv(self.stretch).T)
        radius, sideways = _length_and_unit(plane)
        with np.errstate(invalid="ignore"):
            valid = inside_image(pixels, self.image_size) & (radius <= self.field_radius_px * (1 + ROUNDING))
        omega = self.omega_from_radius(np.minimum(radius[valid], self.field_radius_px))
        in_camera = np.empty((len(omega), 3))
        in_camera[:, :2] = np.sin(omega)[:, None] * sideways[valid] * self._handedness
        in_camera[:, 2] = self._forward * np.cos(omega)
        origins, directions = np.full((2, *radius.shape, 3), np.nan)
        origins[valid] = 0.0
        directions[valid] = turned(in_camera, self.mount.rotation().T)
        return Rays(origins, directions, valid)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points (n, 3) in mm: those of their directions from the one viewpoint.

        Parameters
        ----------
        points_mm : (n, 3)
            Points of the world, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).
        """
        return self.project_directions(points_mm)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of directions (n, 3) of any length but 0.

        Parameters
        ----------
        directions : (n, 3)
            World directions, of any length.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).
        """
        in_camera = turned(directions, self.mount.rotation())
        distance, sideways = _length_and_unit(in_camera[..., :2])
        ahead = self._forward * in_camera[..., 2]
        with np.errstate(invalid="ignore"):
            omega = np.arctan2(distance, ahead)
            seen = (omega <= self.omega_max * (1 + ROUNDING)) & (distance + np.abs(ahead) > 0)
        radius = self.radius_from_omega(np.minimum(omega[seen], self.omega_max))
        plane = radius[:, None] * sideways[seen] * self._handedness
        pixels = np.full((*distance.shape, 2), np.nan)
        pixels[seen] = self.centre_px + turned(plane, self.stretch.T)
        valid = inside_image(pixels, self.image_size)
        pixels[~valid] = np.nan
        return Projection(pixels, valid)

    @property
    def _forward(self) -> float:
        return -1.0 if self.looks_back else 1.0

    @property
    def _handedness(self) -> Array:
        """Signs of (right, down) in the picture as delivered, against the camera frame's X and Y."""
        return np.array([-1.0 if self.mount.image_flipped else 1.0, 1.0])

    # -- checks that every model makes in its constructor ----------------------------------------

    def _check_picture(self) -> None:
        if finite("image_size", self.image_size).shape != (2,) or finite("centre_px", self.centre_px).shape != (2,):
            raise InvalidParameter("image_size and centre_px are pairs of numbers: (width, height) and (u, v)")
        for name, length in zip(("width", "height"), self.image_size, strict=True):
            if not (1 <= length <= LARGEST_PICTURE_PX and int(length) == length):
                raise InvalidParameter(
                    f"image {name} = {length} is not a whole number of pixels from 1 to {LARGEST_PICTURE_PX}"
                )


def _length_and_unit(vectors: Array) -> tuple[Array, Array]:
    """Lengths (..., ) and unit vectors (..., 2) of vectors; the zero vector points right."""
    length = np.hypot(vectors[..., 0], vectors[..., 1])
    zero = length == 0
    with np.errstate(invalid="ignore"):  # infinite vectors become NaN, and are not seen
        unit = vectors / np.where(zero, 1.0, length)[..., None]
    unit[zero] = (1.0, 0.0)
    return length, unit
