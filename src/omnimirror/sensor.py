"""The mirror sensor: mirror + lens + imager + mount, a Camera."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .cameras import AxialSymmetry, Projection, Rays, inside_image
from .errors import InvalidParameter
from .frames import Mount
from .imagers import Imager
from .lenses import Lens, Perspective
from .mirrors import Mirror
from .tracing.meridian import ROUNDING, ChiefRays, Meridian

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Sensor:
    """A curved mirror of revolution seen by an ordinary camera on its axis.

    Parameters
    ----------
    mirror, lens, imager, mount
        Its parts.
    mirror_distance_mm : mm
        Distance m from the lens's principal point to the mirror vertex; infinite (and left out of
        files) under an orthographic lens, where it does not matter.
    name, notes
        For people.

    Raises
    ------
    InvalidParameter
        If a perspective lens has no finite mirror distance. Whether the mirror can be used at all
        (one-to-one mapping, no self-obstruction) is proven at the first question.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> origins, directions, valid = sensor.backproject([[511.5, 11.5], [0.0, 0.0]])
    >>> directions.round(3)[0]  # 500 px above the centre: forward, and 44 deg up
    array([0.721, 0.   , 0.693])
    >>> valid
    array([ True, False])
    """

    mirror: Mirror
    lens: Lens
    imager: Imager
    mount: Mount = field(default_factory=Mount)
    mirror_distance_mm: float = np.inf
    name: str = "sensor"
    notes: str = ""

    def __post_init__(self) -> None:
        if self.lens.TELECENTRIC:
            object.__setattr__(self, "mirror_distance_mm", np.inf)
        elif not (np.isfinite(self.mirror_distance_mm) and self.mirror_distance_mm > 0):
            raise InvalidParameter(
                f"mirror_distance_mm = {self.mirror_distance_mm:g} does not say where the mirror stands; a "
                f"{self.lens.KIND} lens needs a finite distance above 0 from its principal point to the mirror vertex"
            )

    # -- in the meridian -----------------------------------------------------------------------

    @cached_property
    def meridian(self) -> Meridian:
        """Its chief rays, field and inversions."""
        return Meridian(self.mirror, self.mirror_distance_mm)

    @property
    def field_deg(self) -> tuple[float, float]:
        """Smallest and largest field angle Omega, degrees from the direction back past the lens."""
        return float(np.degrees(self.meridian.omega_min)), float(np.degrees(self.meridian.omega_max))

    def image_height_px(self, rays: ChiefRays) -> Array:
        """Image height h of chief rays, px (Eq. 7)."""
        return self.lens.image_height(rays.x, rays.w) / self.imager.pitch_mm

    def image_height_rate_px(self, rays: ChiefRays) -> Array:
        """dh/dOmega of chief rays, px per radian (Eq. 8)."""
        rate = self.lens.image_height_rate(rays.x, rays.w, rays.slope)
        return rate / rays.domega_dx() / self.imager.pitch_mm

    def x_from_height_px(self, h_px: ArrayLike) -> Array:
        """Mirror point (mm) of image heights (n,) in px; OutsideField beyond the rim's image."""
        h_mm = np.asarray(h_px, dtype=float) * self.imager.pitch_mm
        if isinstance(self.lens, Perspective):
            return self.meridian.x_from_tan_theta(h_mm / self.lens.image_distance)
        unit = self.lens.image_height(np.ones(1), np.full(1, np.inf))[0]
        return self.meridian.trace(h_mm / unit).x

    def radius_from_centre_px(self, pixels: Array) -> Array:
        """Image heights (n,) of pixels (n, 2), px."""
        return np.hypot(*self._from_centre(pixels))

    @property
    def rim_radius_px(self) -> float:
        """Radius of the image of the rim, px."""
        return float(self.image_height_px(self.meridian.trace(self.mirror.rim_radius_mm)))

    # -- as a camera ---------------------------------------------------------------------------

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.imager.size

    @property
    def symmetry(self) -> AxialSymmetry:
        """The mirror axis, about which the sensor is symmetric."""

        def rays(omega: Array) -> ChiefRays:
            return self.meridian.trace(self.meridian.x_from_omega(omega))

        def radius_px(omega: Array) -> Array:
            return self.image_height_px(rays(omega))

        def origin_mm(omega: Array) -> tuple[Array, Array]:
            chief = rays(omega)
            return chief.x, -chief.z

        u, v = self.imager.centre
        centre = (self.imager.width_px - 1 - u, v) if self.mount.image_flipped else (u, v)
        x, y, z = self.mount.rotation().T
        right = -x if self.mount.image_flipped else x
        angles = self.meridian.omega_min, self.meridian.omega_max
        return AxialSymmetry(centre, -z, right, y, *angles, radius_px, origin_mm)

    @property
    def is_picture_reversed(self) -> bool:
        """Whether the raw picture is a mirror image: text runs backwards and markers go undetected."""
        return not self.mount.image_flipped

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) px into the world: from their mirror points (mm) to the object.

        Pixels outside the image of the rim or outside the picture are not valid and NaN.
        """
        pixels = np.asarray(pixels, dtype=float)
        du, dv = self._from_centre(pixels)
        radius = np.hypot(du, dv)
        rim = self.rim_radius_px
        valid = inside_image(pixels, self.image_size) & (radius <= rim * (1 + ROUNDING))
        origins, directions = np.full((2, *radius.shape, 3), np.nan)
        rays = self.meridian.trace(self.x_from_height_px(np.minimum(radius[valid], rim)))
        _, cos, sin = _unit(du[valid], dv[valid])
        s = np.sin(rays.omega)
        rotation = self.mount.rotation().T
        origins[valid] = np.stack([rays.x * cos, rays.x * sin, rays.z], axis=-1) @ rotation
        directions[valid] = np.stack([s * cos, s * sin, -np.cos(rays.omega)], axis=-1) @ rotation
        return Rays(origins, directions, valid)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points (n, 3) in mm, by the true reflection of each (no single viewpoint is assumed)."""
        x, y, z = np.moveaxis(np.asarray(points_mm, dtype=float) @ self.mount.rotation(), -1, 0)
        distance, cos, sin = _unit(x, y)
        return self._image(self.meridian.x_from_point(distance, z), cos, sin)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of infinitely distant points in directions (n, 3) of any length but 0."""
        x, y, z = np.moveaxis(np.asarray(directions, dtype=float) @ self.mount.rotation(), -1, 0)
        distance, cos, sin = _unit(x, y)
        omega = np.arctan2(distance, -z)
        seen = self.meridian.sees(omega) & (distance + np.abs(z) > 0)
        x_mirror = np.full_like(omega, np.nan)
        x_mirror[seen] = self.meridian.x_from_omega(omega[seen])
        return self._image(x_mirror, cos, sin)

    def _image(self, x_mirror: Array, cos: Array, sin: Array) -> Projection:
        """Pixels of mirror points (n,) at azimuths; NaN in, not valid out."""
        pixels = np.full((*x_mirror.shape, 2), np.nan)
        seen = np.isfinite(x_mirror)
        radius = self.image_height_px(self.meridian.trace(x_mirror[seen]))
        u, v = self.imager.centre
        columns = u + radius * cos[seen]
        if self.mount.image_flipped:
            columns = self.imager.width_px - 1 - columns
        pixels[seen] = np.stack([columns, v + radius * sin[seen]], axis=-1)
        valid = inside_image(pixels, self.image_size)
        pixels[~valid] = np.nan
        return Projection(pixels, valid)

    def _from_centre(self, pixels: Array) -> tuple[Array, Array]:
        """Offsets from the optical axis (px), right and down in the unflipped picture."""
        u, v = self.imager.centre
        columns = pixels[..., 0]
        if self.mount.image_flipped:
            columns = self.imager.width_px - 1 - columns
        return columns - u, pixels[..., 1] - v


def _unit(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Length, cosine and sine of vectors (x, y); the zero vector points along x."""
    length = np.hypot(x, y)
    safe = np.where(length > 0, length, 1.0)
    return length, np.where(length > 0, x / safe, 1.0), y / safe
