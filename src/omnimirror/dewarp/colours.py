"""Colour pictures whose colours lie apart: each straightened as its own light was seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..base.arguments import shown
from ..base.errors import InvalidParameter
from ..base.numerics.lazy import cached_property
from ..cameras.camera import Camera, Mask
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
    """Straightens colour pictures each of whose colours was seen by a camera of its own.

    Glass refracts blue light more than red: behind a lens or a cover of one material colours part towards the rim, and
    lie on each other again where each is straightened by its own camera. It takes two to three times as long.

    Parameters
    ----------
    cameras : (red, green, blue)
        What took each colour, of one image size: a sensor at three wavelengths, or three calibrations.
    view, interpolation, viewpoint, border, keep_map
        As for :class:`omnimirror.Dewarper`.

    Raises
    ------
    InvalidParameter
        For other than three cameras, or of different sizes; and as a :class:`omnimirror.Dewarper`.

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
        """That of green light, which stands for all."""
        return self.cameras[GREEN]

    @property
    def valid(self) -> Mask:
        """(height, width), False outside the field of green light."""
        return self._colours[GREEN].valid

    def __call__(self, image: Image, transparent: bool = False, out: Image | None = None) -> Image:
        """The straightened picture, of the same depth.

        Parameters
        ----------
        image : (h, w, 3) or (h, w, 4) array, uint8, uint16 or float32
            A colour picture of the cameras' ``image_size``; its alpha goes with green.
        transparent
            Whether to add an alpha channel, 0 outside the field. A picture that comes with an alpha of its
            own has the border's there.
        out
            A picture of the view's size, with the channels and the depth of the result, to be filled and returned.

        Raises
        ------
        InvalidParameter
            For a picture without colours, of another size than the cameras', or an ``out`` of another than the view's.
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
