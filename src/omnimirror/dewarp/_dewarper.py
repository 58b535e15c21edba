"""Dewarping of images for a camera and a screen, optionally with correction of lateral colour."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, overload

import numpy as np

from ..base.arguments import InvalidType, format_value, instance, validate_arguments
from ..base.caching import cached_property
from ..base.errors import InvalidParameter, OutsideField
from ..base.typing import Array, Mask
from ..cameras.camera import Camera
from ._source_coordinates import is_separable, lattice_map_of, polar_map_of, source_pixels
from .interfaces import (
    INTERPOLATIONS,
    Border,
    Image,
    Interpolation,
    Map,
    SupportsArray,
    TensorT,
    apply_to_images,
)
from .maps import PixelMap, Rectangle
from .sampling import (
    border_values,
    check_border,
    check_image,
    output_array,
    remap,
    transparent_border,
    with_alpha,
)
from .screens import View, parts_of
from .screens._projections import is_screen
from .view_geometry import Viewpoint, annulus_of, check_viewpoint, field_of
from .yuv import (
    SITINGS,
    Planes,
    Siting,
    border_of_planes,
    check_planes,
    check_shapes,
    empty_planes,
    remap_planes,
    remap_whole_planes,
    subsampling,
)

# -- Dewarper --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Dewarper:
    """Dewarper for the images of one camera: created once for a view, called for every image.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        Screen, such as those of :mod:`omnimirror.screens`, or a mosaic of several screens.
    interpolation
        ``"auto"``: cubic for magnified pixels, and the mean of several cubic samples for minified
        pixels to avoid aliasing. ``"nearest"``, ``"linear"`` and ``"cubic"``: one sample per pixel.
        ``"area"``: mean over the footprint of every pixel.
    viewpoint
        Viewpoint for screens at a finite distance. ``"exact"``: true reflection of each point.
        ``"single"``: single viewpoint on the axis as in the paper, with the minimum maximum error
        at the distance of the screen. A number: height (mm) of a single viewpoint over the mirror
        vertex. The choice has no effect on distant screens; ``"exact"`` and ``"single"`` are equal
        for a single-viewpoint camera.
    border
        Colour outside the field in image values: a number for all channels, or one for each
        channel. For frames as in :meth:`planes`: a grey level or (y, u, v).
    keep_map
        Compute a map of all pixels before the first image. This takes as long as about ten images
        and accelerates each image by up to 1.7 times, for a view of many images. Results with and
        without it differ by rounding; those of one dewarper are consistent.

    Instances can be pickled and copied; cached maps are recomputed.

    Raises
    ------
    InvalidParameter
        If an interpolation or viewpoint is unknown, an image does not match the camera, or the
        border is not a valid image value.
    OutsideField
        If, on first use, the view does not intersect the field of the camera.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> dewarp = om.Dewarper(sensor, om.screens.Cylinder((360, 180), -90.0, 90.0))
    >>> panorama = dewarp(np.full((1024, 1024, 3), 200, np.uint8))
    >>> panorama.shape, panorama[0, 0], panorama[100, 0]  # nothing is seen of the sky above 45 deg
    ((180, 360, 3), array([0, 0, 0], dtype=uint8), array([200, 200, 200], dtype=uint8))

    A wall at 30 cm, and the error of a single-viewpoint model:

    >>> wall = om.screens.Plane((640, 480), distance_mm=300.0)
    >>> exact, single = (om.Dewarper(sensor, wall, viewpoint=v).coordinates() for v in ("exact", "single"))
    >>> print(f"{np.nanmax(np.linalg.norm(exact - single, axis=-1)):.1f} px")
    4.5 px
    """

    camera: Camera
    view: View
    interpolation: Interpolation = "auto"
    viewpoint: Viewpoint = "exact"
    border: Border = 0
    keep_map: bool = False

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __post_init__(self) -> None:
        instance("camera", self.camera, Camera, "a camera, for example from om.load_sensor")
        # A string has the same attribute
        has_parts = hasattr(self.view, "targets_at") or hasattr(self.view, "parts")
        if not (has_parts and hasattr(self.view, "size")):
            raise InvalidType(
                f"view must be a view from om.screens or om.views; got {format_value(self.view)}"
            )
        if not isinstance(self.interpolation, str) or self.interpolation not in INTERPOLATIONS:
            names = ", ".join(INTERPOLATIONS)
            raise InvalidParameter(
                f"interpolation must be one of {names}; got {format_value(self.interpolation)}"
            )
        check_viewpoint(self.viewpoint)
        check_border(self.border)

    @overload
    def __call__(
        self, image: Image, transparent: bool = False, out: Image | None = None
    ) -> Image: ...

    @overload
    def __call__(self, image: TensorT, transparent: bool = False, out: None = None) -> TensorT: ...

    @overload
    def __call__(
        self, image: SupportsArray, transparent: bool = False, out: Image | None = None
    ) -> Image: ...

    def __call__(self, image: Any, transparent: bool = False, out: Image | None = None) -> Any:
        """Return the dewarped image with the same data type.

        Parameters
        ----------
        image : (h, w), (h, w, c) or (n, h, w, c) array, c = 1, 3 or 4
            Image of the camera's ``image_size``, or n such images: uint8, uint16, int16, float32,
            float64 or bool. Objects with ``__dlpack__`` or ``__array__``, for example tensors in
            the memory of the CPU, are read as well.
        transparent
            Add an alpha channel, 0 outside the field. An existing alpha channel has the border
            value there.
        out
            NumPy array of the view's size with the channels and data type of the result.

        Returns
        -------
        (rows, columns), (rows, columns, c) or (n, rows, columns, c) array
            Tensors of a library that reads DLPack yield tensors of that library; ``out``, if given,
            is returned.

        Raises
        ------
        InvalidParameter
            If an image does not match the camera in size or type, or ``out`` does not match the
            view.

        Notes
        -----
        Integers are rounded to the nearest and limited to the range of the type, which cubic
        interpolation otherwise exceeds at edges. A bool is True where the interpolated mean is
        above 0.5. float64 is sampled in float32: the relative error is below 1e-6 of the largest
        value nearby.
        """
        instance("transparent", transparent, bool, "True or False")

        def dewarp(frame: Image, target: Image | None) -> Image:
            check_image(frame, self.camera.image_size)
            border: Border = self.border
            if transparent:
                border = transparent_border(border, frame)
                frame = with_alpha(frame)
            return remap(frame, self._map, self.interpolation, target, border)

        return apply_to_images(image, out, dewarp)

    @validate_arguments
    def planes(
        self,
        parts: Planes,
        out: Planes | None = None,
        siting: Siting = "left",
        to_siting: Siting | None = None,
        full_range: bool = False,
        bits: int = 8,
    ) -> Planes:
        """Return the dewarped video frame, plane by plane in its coded format, without conversion.

        Parameters
        ----------
        parts : (y, u, v), (y, uv) as in NV12 and P010, or (y, u, v, opacity)
            Luma of the camera's ``image_size``; chroma of half the size, rounded up, (h, w) or
            (h, w, 2), or in three planes of half the width (4:2:2) or of full size (4:4:4). Opacity
            has the size of luma; outside the field it is 0 unless the border is a colour. uint8 or
            uint16, with any strides.
        out : planes as of the view, optional
            Output planes (h, w) of the view, such as those of a frame to be encoded; same
            arrangement as ``parts``.
        siting
            Position of chroma samples: ``"left"`` as in H.264 and MPEG-2, ``"center"`` as in JPEG
            and MPEG-1, or ``"topleft"``.
        to_siting
            Position of chroma samples in the result; by default the same.
        full_range
            True for full-range luma, from 0; False for limited range, from 16 (in 8 bits). A
            ``border`` given as a number is a full-range grey level in both cases.
        bits
            Bit depth of uint16 values: 10 for yuv420p10, 16 for P010, which stores values in the
            upper bits.

        Returns
        -------
        planes
            Arrays (h, w) of the view with the arrangement of ``parts``.

        Raises
        ------
        InvalidParameter
            If the planes are not a frame of the camera.

        Examples
        --------
        >>> import numpy as np, omnimirror as om
        >>> dewarp = om.Dewarper(om.load_sensor("paper-spherical"), om.screens.Plane((641, 480)))
        >>> y, uv = dewarp.planes((np.full((1024, 1024), 90, np.uint8), np.full((512, 512, 2), 130, np.uint8)))
        >>> y.shape, uv.shape, y[200, 300], uv[100, 150]
        ((480, 641), (240, 321, 2), np.uint8(90), array([130, 130], dtype=uint8))
        """
        sitings = (siting, to_siting or siting)
        check_planes(parts, self.camera.image_size, bits)
        if out is None:
            out = empty_planes(parts, self.view.size)
        check_shapes(out, self.view.size, parts)
        border = border_of_planes(self.border, full_range, bits)
        if len(parts) == 4:
            opacity = ((1 << bits) - 1) * isinstance(self.border, Sequence)
            remap(parts[3], self._map, self.interpolation, out[3], opacity)
        if subsampling(parts) != (2, 2):
            return remap_whole_planes(parts, self._map, sitings, self.interpolation, out, border)
        remap_planes(
            parts[:3], self._map, self._chroma_map(sitings), self.interpolation, out[:3], border
        )
        return out

    @validate_arguments
    def coordinates(self, exact: bool = False) -> Array:
        """Return source pixels (height, width, 2) as (u, v); NaN outside the field.

        Most coordinates are interpolated between exact ones, within 0.005 px in images of 1000 px
        (0.01 px at 4096); ``exact`` projects every pixel individually, which is many times slower.

        Parameters
        ----------
        exact
            Project every pixel individually.

        Returns
        -------
        (height, width, 2) array
            Source pixels (u, v).

        Raises
        ------
        OutsideField
            If the view does not intersect the field of the camera.
        """
        pixels = source_pixels(self.camera, self.view, self.viewpoint, exact)
        if np.isnan(pixels[..., 0]).all():
            raise self._sees_nothing()
        return pixels

    def _sees_nothing(self) -> OutsideField:
        field = field_of(self.camera)
        return OutsideField(
            "the view must overlap the field of the camera, elevation "
            f"{field.tilt_min_deg:.6g} to {field.tilt_max_deg:.6g} deg; got the {self.view}"
        )

    @property
    def valid(self) -> Mask:
        """Mask (height, width), False outside the field; sampled from an image of ones, which takes
        1/8 of the memory of a map.
        """
        width, height = self.camera.image_size
        return remap(np.ones((height, width), np.uint8), self._map, "nearest").view(np.bool_)

    @cached_property
    def _map(self) -> Map:
        """Map for all images: the pixel map if requested or if no other map applies."""
        return self.pixel_map if self.keep_map or self._quick_map is None else self._quick_map

    @cached_property
    def _quick_map(self) -> Map | None:
        """Map that is much faster to create than a pixel map and nearly as fast to sample; None if
        there is none.
        """
        if not is_screen(self.view):
            return None
        if is_separable(self.camera, self.view):
            polar = polar_map_of(self.camera, self.view, self.viewpoint)
            # A polar map without visible pixels is inconclusive: only a pixel map determines
            # visibility.
            return (
                replace(polar, annulus=annulus_of(self.camera))
                if polar.has_valid_pixels()
                else None
            )
        lattice = lattice_map_of(self.camera, self.view, self.viewpoint)
        if not lattice.has_valid_pixels():
            raise self._sees_nothing()
        return replace(lattice, annulus=annulus_of(self.camera))

    @cached_property
    def pixel_map(self) -> PixelMap:
        """Map with the source coordinates of all pixels, for samplers of other libraries."""
        annulus = annulus_of(self.camera)
        if self._quick_map is not None:
            return PixelMap.of(self._quick_map, annulus)
        views = [] if is_screen(self.view) else parts_of(self.view)
        rectangles = [Rectangle(left, top, *screen.size) for left, top, screen in views]
        return PixelMap(
            self.coordinates().astype(np.float32), self.camera.image_size, annulus, rectangles
        )

    def _chroma_map(self, sitings: tuple[Siting, Siting]) -> Map:
        """Return the map of 4:2:0 chroma for the siting of the source and of the view."""
        if sitings not in self._chroma_maps:
            image_offset, view_offset = (SITINGS[siting] for siting in sitings)
            self._chroma_maps[sitings] = self._map.halved(image_offset, view_offset)
        return self._chroma_maps[sitings]

    @cached_property
    def _chroma_maps(self) -> dict[tuple[Siting, Siting], Map]:
        return {}


# -- Correction of lateral colour ------------------------------------------------------------------

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
            raise InvalidParameter(
                f"cameras must be three cameras for red, green and blue light; got {format_value(self.cameras)}"
            )
        sizes = {dewarper.camera.image_size for dewarper in self._colours}
        if len(sizes) > 1:
            listed = ", ".join(f"{width} x {height}" for width, height in sorted(sizes))
            raise InvalidParameter(f"cameras must have the same image size; got {listed} px")

    @cached_property
    def _colours(self) -> tuple[Dewarper, ...]:
        return tuple(
            Dewarper(camera, self.view, self.interpolation, self.viewpoint, 0, self.keep_map)
            for camera in self.cameras
        )

    @property
    def camera(self) -> Camera:
        """Camera of the green channel, used as the reference."""
        return self.cameras[GREEN]

    @property
    def valid(self) -> Mask:
        """Mask (height, width), False outside the field of the green channel."""
        return self._colours[GREEN].valid

    @overload
    def __call__(
        self, image: Image, transparent: bool = False, out: Image | None = None
    ) -> Image: ...

    @overload
    def __call__(self, image: TensorT, transparent: bool = False, out: None = None) -> TensorT: ...

    @overload
    def __call__(
        self, image: SupportsArray, transparent: bool = False, out: Image | None = None
    ) -> Image: ...

    def __call__(self, image: Any, transparent: bool = False, out: Image | None = None) -> Any:
        """Return the dewarped image with the same data type.

        Parameters
        ----------
        image : (h, w, c) or (n, h, w, c) array, c = 3 or 4
            Colour image of the cameras' ``image_size``, or n such images, of the types of
            :class:`omnimirror.Dewarper`; alpha is dewarped with the green channel.
        transparent
            Add an alpha channel, 0 outside the field. An existing alpha channel has the border
            value there.
        out
            NumPy array of the view's size with the channels and data type of the result.

        Returns
        -------
        (rows, columns, c) or (n, rows, columns, c) array
            As in :class:`omnimirror.Dewarper`.

        Raises
        ------
        InvalidParameter
            If the image has no colours or the wrong size, or ``out`` does not match the view.
        """
        instance("transparent", transparent, bool, "True or False")

        def dewarp(frame: Image, target: Image | None) -> Image:
            return self._dewarp(frame, transparent, target)

        return apply_to_images(image, out, dewarp)

    def _dewarp(self, image: Image, transparent: bool, out: Image | None) -> Image:
        check_image(image, self.camera.image_size)
        if image.ndim != 3 or image.shape[2] < 3:
            raise InvalidParameter(
                f"the image must have 3 or 4 channels for a ColourDewarper; got shape {image.shape}"
            )
        border: Border = self.border
        if transparent:
            border = transparent_border(border, image)
            image = with_alpha(image)
        out = output_array(out, image, self.view.size)
        for channel, value in enumerate(border_values(border, image)):
            where = self._colours[channel if channel < len(self._colours) else GREEN]._map
            remap(
                np.ascontiguousarray(image[..., channel]),
                where,
                self.interpolation,
                out[..., channel],
                value,
            )
        return out
