"""From a camera and a screen to a straightened picture."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from ..cameras import AxialSymmetry, Camera, Mask, inside_image
from ..errors import InvalidParameter, OutsideField
from .sampling import INTERPOLATIONS, Image, Interpolation, check_picture, sample
from .screens import Cylinder, Screen
from .views import field_of, is_vertical

Array = NDArray[np.float64]

STRIP_PX = 1 << 17  # output pixels worked on at a time: their rays stay in the cache


@dataclass(frozen=True)
class Dewarper:
    """Straightens pictures of a camera: made once for a view, called for every picture.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        A screen, such as those of :mod:`omnimirror.screens`.
    interpolation
        ``"nearest"``, ``"linear"`` or ``"cubic"``. Cubic is sharper where the view magnifies; where it
        shrinks the picture by more than 2, none of them averages enough.

    Raises
    ------
    InvalidParameter
        For an unknown interpolation, or a picture of another size or kind than the camera's.
    OutsideField
        At the first use, if the view sees nothing of the camera's field.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> dewarp = om.Dewarper(sensor, om.screens.Cylinder((360, 180), -90.0, 90.0))
    >>> panorama = dewarp(np.full((1024, 1024, 3), 200, np.uint8))
    >>> panorama.shape, panorama[0, 0], panorama[100, 0]  # nothing is seen of the sky above 45 deg
    ((180, 360, 3), array([0, 0, 0], dtype=uint8), array([200, 200, 200], dtype=uint8))
    """

    camera: Camera
    view: Screen
    interpolation: Interpolation = "linear"

    def __post_init__(self) -> None:
        if self.interpolation not in INTERPOLATIONS:
            raise InvalidParameter(f"interpolation = {self.interpolation!r} is not one of {', '.join(INTERPOLATIONS)}")

    def __call__(self, image: Image, transparent: bool = False) -> Image:
        """The straightened picture, of the same depth.

        Parameters
        ----------
        image : (h, w) or (h, w, 1) or (h, w, 3) or (h, w, 4) array, uint8, uint16 or float32
            A picture of the camera's ``image_size``.
        transparent
            Whether to add an alpha channel, 0 outside the field. Otherwise, as in a picture that comes
            with an alpha of its own, everything outside the field is 0 in all channels.
        """
        check_picture(image, self.camera.image_size)
        return sample(image, *self._maps, self.interpolation, transparent)

    def coordinates(self) -> Array:
        """Source pixels (height, width, 2) as (u, v); NaN outside the field."""
        if is_separable(self.camera, self.view):
            pixels = separable_coordinates(self.camera, self.view)
        else:
            pixels = general_coordinates(self.camera, self.view)
        if np.isnan(pixels[..., 0]).all():
            seen = field_of(self.camera)
            raise OutsideField(
                f"the {self.view} sees nothing of the camera's field, which reaches from "
                f"{seen.tilt_min_deg:.6g} to {seen.tilt_max_deg:.6g} deg of elevation"
            )
        return pixels

    @property
    def valid(self) -> Mask:
        """(height, width), False outside the field."""
        return self._maps[2]

    @cached_property
    def _maps(self) -> tuple[NDArray[np.float32], NDArray[np.float32], Mask]:
        """Columns and rows of the source pixels, 0 outside the field, and where inside; each (height, width)."""
        pixels = self.coordinates()
        valid: Mask = ~np.isnan(pixels[..., 0])
        columns, rows = np.where(valid, np.moveaxis(pixels, -1, 0), 0.0).astype(np.float32)
        return columns, rows, valid


def general_coordinates(camera: Camera, view: Screen) -> Array:
    """Source pixels (height, width, 2) of any camera and screen, in strips of rows."""
    width, height = view.size
    project = camera.project_directions if view.is_distant else camera.project
    pixels = np.empty((height, width, 2))
    step = max(1, STRIP_PX // width)
    for first in range(0, height, step):
        last = min(first + step, height)
        pixels[first:last] = project(view.targets(first, last).reshape(-1, 3)).pixels.reshape(-1, width, 2)
    return pixels


# -- panoramas about the camera's own axis ---------------------------------------------------------


def is_separable(camera: Camera, view: Screen) -> bool:
    """Whether rows of the view are circles in the picture: a panorama about the camera's vertical axis."""
    return isinstance(view, Cylinder) and camera.symmetry is not None and is_vertical(camera.symmetry)


def separable_coordinates(camera: Camera, view: Screen) -> Array:
    """Source pixels (height, width, 2) as centre + r(row) (cos, sin)(column)."""
    symmetry = camera.symmetry
    assert isinstance(view, Cylinder)
    assert symmetry is not None
    pans = view.pans()
    towards = np.stack([np.cos(pans), -np.sin(pans)], axis=-1) @ _picture_from_world(camera, symmetry).T
    radii = _radii_of_tilts(symmetry, view.tilts())
    pixels: Array = symmetry.centre_px + radii[:, None, None] * towards
    pixels[~inside_image(pixels, camera.image_size)] = np.nan
    return pixels


def _radii_of_tilts(symmetry: AxialSymmetry, tilts: Array) -> Array:
    """Image radii (n,) in px of tilts (n,) in radians; NaN outside the field."""
    omega: Array = np.pi / 2 - symmetry.axis[2] * tilts
    radii = np.full_like(omega, np.nan)
    seen = (omega >= symmetry.omega_min) & (omega <= symmetry.omega_max)
    radii[seen] = symmetry.radius_px(omega[seen])
    return radii


def _picture_from_world(camera: Camera, symmetry: AxialSymmetry) -> Array:
    """Matrix (2, 2) from horizontal world directions (x, y) to directions in the picture (right, down).

    A rotation, or a reflection where the picture is reversed. The camera is asked, in two pixels at right
    angles from the centre, since the contract does not tell the mount.
    """
    centre = np.array(symmetry.centre_px)
    steps = np.array([[1.0, 0.0], [0.0, 1.0]])
    reach = float(symmetry.radius_px(np.array([symmetry.omega_max]))[0])
    for radius in reach * np.geomspace(1.0, 1e-6, 25):
        for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
            in_picture = steps * np.array(signs)[:, None]
            rays = camera.backproject(centre + radius * in_picture)
            across = np.hypot(*rays.directions[:, :2].T)
            if rays.valid.all() and (across > 1e-6).all():
                in_world = rays.directions[:, :2] / across[:, None]
                picture_from_world: Array = in_picture.T @ np.linalg.inv(in_world.T)
                return picture_from_world
    raise OutsideField("the axis of the camera lies outside its picture, and nothing around it is seen")
