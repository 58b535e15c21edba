"""Source coordinates of the pixels of a view."""

from __future__ import annotations

import numpy as np

from ...base.typing import Array
from ...cameras.camera import AxialSymmetry, Camera
from ...cameras.frames import pan_tilt_direction
from ..camera_field import is_vertical
from ..screens import Panorama, Screen, View, parts_of
from ..screens.base import pixels_of_rows
from ..viewpoints import Viewpoint, centre_of_projection, projection_of
from .lattice import LatticeMap
from .polar import PolarMap
from .radial_table import RadialTable, radial_table
from .refine import lattice_map

STRIP_PX = 1 << 17  # output pixels per strip: their rays fit into the cache


def source_pixels(camera: Camera, view: View, viewpoint: Viewpoint = "exact", exact: bool = False) -> Array:
    """Return source pixels (height, width, 2) of a view as (u, v); NaN outside the field and
    between views of a mosaic.

    With ``exact`` every pixel is projected individually; otherwise most are interpolated, with
    errors of some 0.001 px.
    """
    of_screen = exact_pixels if exact else screen_pixels
    if isinstance(view, Screen):
        return of_screen(camera, view, viewpoint)
    pixels = np.full((view.size[1], view.size[0], 2), np.nan)
    for left, top, screen in parts_of(view):
        width, height = screen.size
        pixels[top : top + height, left : left + width] = of_screen(camera, screen, viewpoint)
    return pixels


def screen_pixels(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> Array:
    """Return source pixels (height, width, 2) of a screen with the fastest method."""
    if is_separable(camera, screen):
        return polar_map_of(camera, screen, viewpoint).pixels()
    return lattice_map_of(camera, screen, viewpoint).pixels().astype(np.float64)


def lattice_map_of(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> LatticeMap:
    """Return the lattice map of a screen."""
    table: RadialTable | None = radial_table(camera)  # type: ignore[arg-type]  # the cache asks for Hashable
    if table is None:
        return lattice_map(
            lambda u, v: _projected(camera, screen, viewpoint, screen.targets_at(u, v)), screen.size, camera.image_size
        )
    centre = centre_of_projection(camera, screen, viewpoint)

    def targets(u: Array, v: Array) -> Array:
        there = screen.targets_at(u, v)
        return there - centre if centre is not None and centre.any() else there

    return lattice_map(
        lambda u, v: table.pixels(targets(u, v), centre is None),
        screen.size,
        camera.image_size,
        with_excess=lambda u, v: table.pixels_and_excess(targets(u, v), centre is None),
    )


def exact_pixels(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> Array:
    """Return source pixels (height, width, 2) of a screen, projected individually in strips of
    rows.
    """
    width, height = screen.size
    pixels = np.empty((height, width, 2))
    step = max(1, STRIP_PX // width)
    for first in range(0, height, step):
        last = min(first + step, height)
        pixels[first:last] = rows_of_pixels(camera, screen, first, last, viewpoint)
    return pixels


def rows_of_pixels(
    camera: Camera, screen: Screen, first_row: int, last_row: int, viewpoint: Viewpoint = "exact"
) -> Array:
    """Return source pixels (rows, width, 2) of some rows of a screen, projected individually."""
    return _projected(camera, screen, viewpoint, screen.targets_at(*pixels_of_rows(screen.size, first_row, last_row)))


def _projected(camera: Camera, screen: Screen, viewpoint: Viewpoint, targets: Array) -> Array:
    """Return source pixels (..., 2) of screen targets (..., 3), flattened to the (n, 3) of the
    camera interface.
    """
    pixels = projection_of(camera, screen, viewpoint)(targets.reshape(-1, 3)).pixels
    return pixels.reshape(*targets.shape[:-1], 2)


# -- panoramas about the camera axis ---------------------------------------------------------------


def is_separable(camera: Camera, screen: Screen) -> bool:
    """Return True if rows are circles in the image: a panorama about the vertical axis of the
    camera.
    """
    if not isinstance(screen, Panorama) or camera.symmetry is None or not is_vertical(camera.symmetry):
        return False
    return screen.is_distant or not any(screen.offset_mm[:2])


def polar_map_of(camera: Camera, screen: Screen, viewpoint: Viewpoint = "exact") -> PolarMap:
    """Return the polar map of a separable screen."""
    symmetry = camera.symmetry
    assert isinstance(screen, Panorama)
    assert symmetry is not None
    across = pan_tilt_direction(screen.pans(), 0.0)
    angles = np.unwrap(np.arctan2(across @ symmetry.down, across @ symmetry.right))
    if screen.is_distant:
        return PolarMap(symmetry.centre_px, _radii_of_tilts(symmetry, screen.tilts()), angles, camera.image_size)
    centre = centre_of_projection(camera, screen, viewpoint)
    # One column is sufficient by symmetry
    points = screen.targets_at(np.zeros(1), np.arange(screen.size[1], dtype=float))
    points -= 0.0 if centre is None else centre
    table: RadialTable | None = radial_table(camera)  # type: ignore[arg-type]  # the cache asks for Hashable
    assert table is not None
    radii = table.radii_px(np.hypot(points[:, 0], points[:, 1]), points @ symmetry.axis, centre is None)
    return PolarMap(symmetry.centre_px, radii, angles, camera.image_size)


def _radii_of_tilts(symmetry: AxialSymmetry, tilts: Array) -> Array:
    """Return image radii (n,) in px for tilts (n,) in radians; NaN outside the field."""
    omega: Array = np.pi / 2 - symmetry.axis[2] * tilts
    radii = np.full_like(omega, np.nan)
    seen = (omega >= symmetry.omega_min) & (omega <= symmetry.omega_max)
    radii[seen] = symmetry.radius_px(omega[seen])
    return radii
