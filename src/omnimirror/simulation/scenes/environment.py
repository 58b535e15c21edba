"""Environments at infinity: equirectangular images, indexed by direction."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import check_fields
from ...base.caching import cached_property
from ...base.colour import Light, linear_rgb
from ...base.errors import InvalidParameter, MediaError
from ...base.native import backend, kernel_array
from ...base.typing import Array
from ...cameras.camera import rotate_vectors
from ...dewarp.maps import PixelMap
from ...dewarp.sampling import remap
from ...io import read_image
from .scene import rays_from

MIN_ROWS = 4


@dataclass(frozen=True, eq=False)
class Environment:
    """Distant environment as an equirectangular image (HDR, EXR, JPEG, ...).

    Its middle column is ahead (pan 0) with columns to the right, and its first row is the zenith.
    Light is interpolated bilinearly between pixel centres, and periodic in pan.

    Parameters
    ----------
    light : (h, w, 3) array, float32
        Linear RGB.
    heading_deg : deg
        Pan of the image centre; positive to the right.

    Raises
    ------
    InvalidParameter
        If the array is not such an image, or contains invalid light values.

    Examples
    --------
    >>> bands = np.zeros((2, 4, 3), np.float32)
    >>> bands[0] = 1.0
    >>> sky = Environment(bands)
    >>> sky.radiance(np.zeros((2, 3)), [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])[:, 0].round(3)
    array([1. , 0.5], dtype=float32)
    """

    light: Light = field(repr=False)
    heading_deg: float = 0.0

    def __post_init__(self) -> None:
        check_fields(self)
        if (
            self.light.ndim != 3
            or self.light.shape[2] != 3
            or self.light.size == 0
            or self.light.dtype != np.float32
        ):
            raise InvalidParameter(
                f"light must be (height, width, 3) of float32; got {self.light.shape} of {self.light.dtype}"
            )
        if not (np.isfinite(self.light).all() and (self.light >= 0).all()):
            raise InvalidParameter("light must contain finite values from 0")

    @classmethod
    def load(cls, path: str | Path, heading_deg: float = 0.0, gain: float = 1.0) -> Environment:
        """Read an equirectangular image; integers are sRGB, floats linear light, multiplied by
        ``gain``.

        Parameters
        ----------
        path
            File name.
        heading_deg
            Pan of the image centre, deg.
        gain
            Factor of its light.

        Returns
        -------
        Environment
            Environment of the image.

        Raises
        ------
        MediaError
            If the file cannot be read, or its aspect is not about 2:1, as required for
            equirectangular images, or it has too few pixels.
        """
        image = read_image(path)
        height, width = image.shape[:2]
        if not 1.9 <= width / height <= 2.1:
            raise MediaError(
                f"{path}: an equirectangular image must have the aspect ratio 2:1; got {width} x {height} px"
            )
        if height < MIN_ROWS:
            raise MediaError(
                f"{path}: an environment must have at least {2 * MIN_ROWS} x {MIN_ROWS} px; got {width} x {height} px"
            )
        return cls(np.ascontiguousarray(gain * linear_rgb(image), np.float32), heading_deg)

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Return linear RGB (n, 3) in non-zero directions (n, 3), independent of the
        origins.

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.
        """
        _, towards = rays_from(origins_mm, directions)
        x, y, z = np.moveaxis(rotate_vectors(towards, self.heading().T), -1, 0)
        height, width = self.light.shape[:2]
        column = (0.5 - np.arctan2(y, x) / (2 * np.pi)) * width - 0.5
        row = np.arctan2(np.hypot(x, y), z) / np.pi * height - 0.5
        positions = np.stack([column + 1, row], axis=-1)[None]
        light: Light = remap(self._closed, PixelMap(positions, (width + 2, height)))[0]
        return light

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Return infinite distances (n,).

        Parameters
        ----------
        origins_mm : (n, 3)
            Origins of rays that are traced backwards, mm.
        directions : (n, 3)
            Directions of the rays, of any length.

        Returns
        -------
        (n,) array
            Distances, mm; infinite without a surface.
        """
        return np.full(len(rays_from(origins_mm, directions)[1]), np.inf)

    def heading(self) -> Array:
        """Return the rotation (3, 3) of world directions to the image frame, whose centre is along
        x.

        Returns
        -------
        (3, 3) array
            Rotation matrix.
        """
        c, s = np.cos(np.radians(self.heading_deg)), np.sin(np.radians(self.heading_deg))
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def _closed(self) -> Light:
        """Image with periodic margins: the last column before the first, and the first after the
        last.
        """
        return np.concatenate([self.light[:, -1:], self.light, self.light[:, :1]], axis=1)

    @cached_property
    def native(self) -> object:
        """Compiled environment, without its heading."""
        return backend.kernels.Environment(kernel_array(self.light))
