"""The projection of distant points as one table of the radius, for cameras symmetric about an axis.

Built once per camera, it costs no trigonometry and no root per pixel: the table is indexed by
``sin(Omega/2)``, which a square root gives from the direction (``cos Omega`` would have a kink on the
axis), and holds ``r / sin(Omega)``-like factors that turn a direction into a pixel by one product.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..cameras import AxialSymmetry, Camera, inside_image

Array = NDArray[np.float64]

ENTRIES = 1 << 15  # linear interpolation between so many errs by 1e-6 px at 1000 px of radius
SLACK = 1e-9  # radians; the rim itself is seen


@dataclass(frozen=True)
class RadialTable:
    """Pixels of directions for a camera with an axis of symmetry."""

    symmetry: AxialSymmetry
    image_size: tuple[int, int]

    @cached_property
    def _radii(self) -> tuple[float, float, Array]:
        """First index, spacing and image radii (px) over sin(Omega/2)."""
        s = self.symmetry
        half_sines = np.linspace(np.sin(s.omega_min / 2), np.sin(s.omega_max / 2), ENTRIES)
        omega = np.clip(2 * np.arcsin(np.clip(half_sines, 0, 1)), s.omega_min, s.omega_max)
        return half_sines[0], half_sines[1] - half_sines[0], s.radius_px(omega)

    def project_directions(self, directions: Array) -> Array:
        """Pixels (n, 2) of directions (n, 3) of any length; NaN outside the field or the picture."""
        s, (first, spacing, radii) = self.symmetry, self._radii
        along, right, down = (directions @ np.stack([s.axis, s.right, s.down]).T).T
        length = np.sqrt(along**2 + right**2 + down**2)
        across = np.hypot(right, down)
        with np.errstate(invalid="ignore", divide="ignore"):
            # sin(Omega/2) without cancellation on either side of 90 degrees
            half_sine = np.where(
                along > 0, across / np.sqrt(2 * length * (length + along)), np.sqrt((length - along) / (2 * length))
            )
            position = (half_sine - first) / spacing
            slack = SLACK / spacing
            outside = ~((position >= -slack) & (position <= ENTRIES - 1 + slack))
            position = np.where(outside, 0.0, np.clip(position, 0.0, ENTRIES - 1))
            cell = np.minimum(position.astype(int), ENTRIES - 2)
            radius = radii[cell] + (position - cell) * (radii[cell + 1] - radii[cell])
            scale = np.where(across > 0, radius / across, 0.0)
        u = np.where(across > 0, scale * right, radius)  # on the axis any azimuth is as good
        pixels = np.stack([s.centre_px[0] + u, s.centre_px[1] + scale * down], axis=-1)
        pixels[outside | ~inside_image(pixels, self.image_size)] = np.nan
        return pixels


@lru_cache(maxsize=32)
def radial_table(camera: Camera) -> RadialTable:
    """The table of a camera that has an axis of symmetry, built once."""
    assert camera.symmetry is not None
    return RadialTable(camera.symmetry, camera.image_size)
