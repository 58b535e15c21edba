"""Correction of lateral colour: each colour channel is dewarped with its own camera model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arguments import shown
from ..base.errors import InvalidParameter
from ..base.numerics.lazy import cached_property
from ..base.typing import Mask
from ..cameras.camera import Camera
from .contracts import Border, Image, Interpolation
from .dewarper import Dewarper
from .sampling.borders import border_values, clear_border, with_alpha
from .sampling.checks import check_picture, checked_out
from .sampling.samplers import remap
from .screens import View
from .viewpoints import Viewpoint

GREEN = 1


@dataclass(frozen=True)
class ColourDewarper:
    """Dewarper for colour images with one camera model per colour channel.

    Glass refracts blue light more than red light: a lens or a cover of one material causes lateral
    colour that increases towards the rim. Dewarping each channel with its own camera removes it.
    Processing takes two to three times as long.

    Parameters
    ----------
    cameras : (red, green, blue)
        Camera of each colour channel, with a common image size: a sensor at three wavelengths, or
        three calibrations.
    view, interpolation, viewpoint, border, keep_map
        As in :class:`omnimirror.Dewarper`.

    Raises
    ------
    InvalidParameter
        If there are not three cameras of one image size, and as in :class:`omnimirror.Dewarper`.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import Dome, Housing
    >>> domed = replace(om.load_sensor("paper-spherical"), housing=Housing(shell=Dome(material="polycarbonate")))
    >>> colours = tuple(om.at_wavelength(domed, nm) for nm in (610.0, 540.0, 465.0))
    >>> dewarp = om.ColourDewarper(colours, om.views.panorama(domed, (360, None)))
    >>> dewarp(np.full((1024, 1024, 3), 200, np.uint8)).shape
    (135, 360, 3)
    """

    cameras: tuple[Camera, Camera, Camera]
    view: View
    interpolation: Interpolation = "auto"
    viewpoint: Viewpoint = "exact"
    border: Border = 0
    keep_map: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.cameras, tuple | list) or len(self.cameras) != 3:
            raise InvalidParameter(f"cameras = {shown(self.cameras)} are not three, of red, green and blue light")
        sizes = {dewarper.camera.image_size for dewarper in self._colours}
        if len(sizes) > 1:
            told = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
            raise InvalidParameter(f"the cameras of the colours have pictures of {told} px; valid is one size")

    @cached_property
    def _colours(self) -> tuple[Dewarper, ...]:
        return tuple(
            Dewarper(camera, self.view, self.interpolation, self.viewpoint, 0, self.keep_map) for camera in self.cameras
        )

    @property
    def camera(self) -> Camera:
        """Camera of the green channel, used as the reference."""
        return self.cameras[GREEN]

    @property
    def valid(self) -> Mask:
        """Mask (height, width), False outside the field of the green channel."""
        return self._colours[GREEN].valid

    def __call__(self, image: Image, transparent: bool = False, out: Image | None = None) -> Image:
        """Return the dewarped image with the same bit depth.

        Parameters
        ----------
        image : (h, w, 3) or (h, w, 4) array, uint8, uint16 or float32
            Colour image of the cameras' ``image_size``; alpha is dewarped with the green channel.
        transparent
            Add an alpha channel, 0 outside the field. An existing alpha channel has the border
            value there.
        out
            Output array of the view's size with the channels and data type of the result.

        Raises
        ------
        InvalidParameter
            If the image has no colours or the wrong size, or ``out`` does not match the view.
        """
        check_picture(image, self.camera.image_size)
        if image.ndim != 3 or image.shape[2] < 3:
            raise InvalidParameter(f"a picture of shape {image.shape} has no colours to be straightened apart")
        border: Border = self.border
        if transparent:
            border = clear_border(border, image)
            image = with_alpha(image)
        out = checked_out(out, image, self.view.size)
        for channel, value in enumerate(border_values(border, image)):
            where = self._colours[channel if channel < len(self._colours) else GREEN]._map
            remap(np.ascontiguousarray(image[..., channel]), where, self.interpolation, out[..., channel], value)
        return out
