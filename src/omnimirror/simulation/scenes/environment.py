"""Environments infinitely far away: equirectangular pictures, looked up by direction."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import check_fields
from ...base.colour import Light, linear_from_srgb
from ...base.errors import InvalidParameter, MediaError
from ...base.native import backend, kernel_array
from ...base.numerics.lazy import cached_property
from ...cameras.frames import turned
from ...dewarp.maps.pixels import PixelMap
from ...dewarp.sampling.samplers import remap
from ...io import read_image
from .contract import Array, rays_from

FEWEST_ROWS = 4
FULL_OF_DEPTH = {"uint8": 255.0, "uint16": 65535.0}


@dataclass(frozen=True, eq=False)
class Environment:
    """What is seen in every direction from far away, as an equirectangular picture (HDR, EXR, JPEG, ..).

    Its middle column lies ahead (pan 0) and columns run to the right, its first row is the zenith; between
    the centres of its pixels light is interpolated linearly, all around.

    Parameters
    ----------
    light : (h, w, 3) array, float32
        Linear RGB.
    heading_deg : deg
        Pan in which the middle of the picture is seen; right is positive.

    Raises
    ------
    InvalidParameter
        If the array is no such picture, or holds what is no light.

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
        if self.light.ndim != 3 or self.light.shape[2] != 3 or self.light.size == 0 or self.light.dtype != np.float32:
            raise InvalidParameter(
                f"an environment is (height, width, 3) of float32, not {self.light.shape} of {self.light.dtype}"
            )
        if not (np.isfinite(self.light).all() and (self.light >= 0).all()):
            raise InvalidParameter("an environment holds values below 0 or that are no numbers, which is no light")

    @classmethod
    def load(cls, path: str | Path, heading_deg: float = 0.0, gain: float = 1.0) -> Environment:
        """Read an equirectangular picture; whole numbers are sRGB, floats linear light, ``gain`` multiplies it.

        Parameters
        ----------
        path
            Name of the file.
        heading_deg
            Pan in which the middle of the picture is seen, deg.
        gain
            Factor on its light.

        Returns
        -------
        Environment
            What it shows.

        Raises
        ------
        MediaError
            If the file cannot be read; or is not about twice as wide as high, and so cannot be equirectangular, or
            has but a few pixels.
        """
        image = read_image(path)
        height, width = image.shape[:2]
        if not 1.9 <= width / height <= 2.1:
            raise MediaError(f"{path} has {width} x {height} px; an equirectangular picture is twice as wide as high")
        if height < FEWEST_ROWS:
            raise MediaError(
                f"{path} has {width} x {height} px; an environment has at least {2 * FEWEST_ROWS} x {FEWEST_ROWS}"
            )
        return cls(np.ascontiguousarray(gain * _linear(image), np.float32), heading_deg)

    def radiance(self, origins_mm: ArrayLike, directions: ArrayLike) -> Light:
        """Linear RGB (n, 3) in directions (n, 3) of any length but 0; the origins do not matter.

        Parameters
        ----------
        origins_mm : (n, 3)
            Where rays of light begin that are followed backwards, mm.
        directions : (n, 3)
            Where they lead, of any length.

        Returns
        -------
        (n, 3) array, float32
            Linear RGB.
        """
        _, towards = rays_from(origins_mm, directions)
        x, y, z = np.moveaxis(turned(towards, self.heading().T), -1, 0)
        height, width = self.light.shape[:2]
        column = (0.5 - np.arctan2(y, x) / (2 * np.pi)) * width - 0.5
        row = np.arctan2(np.hypot(x, y), z) / np.pi * height - 0.5
        places = np.stack([column + 1, row], axis=-1)[None]
        light: Light = remap(self._closed, PixelMap(places, (width + 2, height)))[0]
        return light

    def distance_mm(self, origins_mm: ArrayLike, directions: ArrayLike) -> Array:
        """Infinite (n,).

        Parameters
        ----------
        origins_mm : (n, 3)
            Where rays of light begin that are followed backwards, mm.
        directions : (n, 3)
            Where they lead, of any length.

        Returns
        -------
        (n,) array
            mm; infinite where nothing is met.
        """
        return np.full(len(rays_from(origins_mm, directions)[1]), np.inf)

    def heading(self) -> Array:
        """Rotation (3, 3) of world directions into the picture's own, whose middle lies along x.

        Returns
        -------
        (3, 3) array
            The rotation.
        """
        c, s = np.cos(np.radians(self.heading_deg)), np.sin(np.radians(self.heading_deg))
        return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    @cached_property
    def _closed(self) -> Light:
        """With its last column again before the first, and the first behind the last."""
        return np.concatenate([self.light[:, -1:], self.light, self.light[:, :1]], axis=1)

    @cached_property
    def native(self) -> object:
        """The compiled environment, without its heading."""
        return backend.kernels.Environment(kernel_array(self.light))


def _linear(image: NDArray[Any]) -> Array | Light:
    """Linear RGB of a picture as files hold it."""
    rgb = image[..., :3] if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    if image.dtype.name in FULL_OF_DEPTH:
        return linear_from_srgb(rgb / FULL_OF_DEPTH[image.dtype.name])
    return np.asarray(rgb)
