"""Rays of a camera on a grid of pixels, in the frame of camera files."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import Camera
from ...cameras.frames import Mount, turned

OUTERMOST = 60  # number of pixels at the maximum field angle
SAME = 1e-9  # radians
LEAST_PIXELS = 20  # minimum number of pixels in a part of the field, for a fit
CENTRAL_MM = 1e-9  # maximum distance of rays from the origin for a central camera


@dataclass(frozen=True)
class Sample:
    """Pixels of a camera and their rays in the camera frame (X right, Y down, Z ahead).

    Attributes
    ----------
    pixels : (n, 2) px
        Pixels.
    origins : (n, 3) mm
        Ray origins.
    directions : (n, 3) unit vectors
        Ray directions.
    looks_back
        Whether the image centre looks towards -Z.
    mount
        Orientation of the camera.
    """

    pixels: Array
    origins: Array
    directions: Array
    looks_back: bool
    mount: Mount

    @property
    def is_central(self) -> bool:
        """True if all rays start at the origin."""
        return not np.abs(self.origins).max() > CENTRAL_MM

    @property
    def omega(self) -> Array:
        """Field angles (n,), radians from the viewing direction at the image centre."""
        x, y, z = self.in_file.T
        omega: Array = np.arctan2(np.hypot(x, y), z)
        return omega

    @property
    def in_file(self) -> Array:
        """Directions (n, 3) in the frame of files: right, down, and central viewing direction."""
        in_file: Array = self.directions * self.signs
        return in_file

    @property
    def signs(self) -> Array:
        """Signs (3,) that convert directions from the camera frame to the frame of files."""
        return np.array([-1.0 if self.mount.image_flipped else 1.0, 1.0, -1.0 if self.looks_back else 1.0])

    def points(self, distance_mm: float) -> Array:
        """Return points (n, 3) mm on the rays at a distance from the origin.

        Directions are returned for an infinite distance.
        """
        if np.isinf(distance_mm):
            return self.directions
        along = np.sum(self.origins * self.directions, axis=1)
        room = distance_mm**2 - np.sum(self.origins**2, axis=1) + along**2
        if room.min() < 0:
            raise InvalidParameter(
                f"distance_mm = {distance_mm:g} lies inside the camera, whose rays begin up to "
                f"{np.linalg.norm(self.origins, axis=1).max():.4g} mm from its origin"
            )
        points: Array = self.origins + (np.sqrt(room) - along)[:, None] * self.directions
        return points

    def within(self, field_deg: float | None, inner_deg: float | None) -> Sample:
        """Return the part between two field angles; None for no limit.

        Raises
        ------
        InvalidParameter
            If no pixel of the camera is there.
        """
        given = {"inner_deg": inner_deg, "field_deg": field_deg}
        limits = [f"{name} = {value:g}" for name, value in given.items() if value is not None]
        if not limits:
            return self
        low, high = 0.0 if inner_deg is None else inner_deg, 180.0 if field_deg is None else field_deg
        inside = (self.omega >= np.radians(low)) & (self.omega <= np.radians(high))
        if inside.sum() < LEAST_PIXELS:
            raise InvalidParameter(
                f"{' with '.join(limits)} leaves nothing of the field, which is {np.degrees(self.omega.min()):.4g} to "
                f"{np.degrees(self.omega.max()):.4g} deg from the axis"
            )
        return replace(
            self, pixels=self.pixels[inside], origins=self.origins[inside], directions=self.directions[inside]
        )

    def with_rim_of(self, other: Sample) -> Sample:
        """Return this sample with the outermost pixels of a denser one, to cover the whole field."""
        outermost = np.sort(other.omega)[-OUTERMOST:][0] - SAME
        kept = other.omega >= outermost
        return replace(
            self,
            pixels=np.concatenate([self.pixels, other.pixels[kept]]),
            origins=np.concatenate([self.origins, other.origins[kept]]),
            directions=np.concatenate([self.directions, other.directions[kept]]),
        )


def sample(camera: Camera, mount: Mount, count: int) -> Sample:
    """Sample about ``count`` visible pixels over the whole image.

    Raises
    ------
    InvalidParameter
        If no pixel is visible.
    """
    width, height = camera.image_size
    step = np.sqrt(width * height / count)
    columns, rows = (np.linspace(0, n - 1, max(3, round(n / step))) for n in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    origins, directions, valid = camera.backproject(pixels)
    if not valid.any():
        raise InvalidParameter("the camera sees nothing in its picture, so there is nothing to convert")
    to_camera = mount.rotation()
    return Sample(
        pixels[valid], turned(origins[valid], to_camera), turned(directions[valid], to_camera),
        _looks_back(camera, pixels[valid], turned(directions[valid], to_camera)), mount,
    )  # fmt: skip


def _looks_back(camera: Camera, pixels: Array, directions: Array) -> bool:
    """Return whether the image centre looks towards -Z, from the camera or from its central pixels."""
    said = getattr(camera, "looks_back", None)
    if isinstance(said, bool):
        return said
    centre = np.array(camera.symmetry.centre_px if camera.symmetry else np.array(camera.image_size) / 2)
    nearest = np.argsort(np.linalg.norm(pixels - centre, axis=1))[: max(8, len(pixels) // 50)]
    outermost = np.argsort(np.linalg.norm(pixels - centre, axis=1))[-max(8, len(pixels) // 50) :]
    return bool(directions[nearest, 2].mean() < directions[outermost, 2].mean())
