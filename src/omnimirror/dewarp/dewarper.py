"""From a camera and a screen to a straightened picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import WrongKind, checked, instance, shown
from ..base.errors import InvalidParameter, OutsideField
from ..base.numerics.lazy import cached_property
from ..cameras.camera import Camera, Mask
from .camera_field import annulus_of, field_of
from .contracts import INTERPOLATIONS, Border, Image, Interpolation, Map
from .maps.coordinates import is_separable, lattice_map_of, polar_map_of, source_pixels
from .maps.pixels import PixelMap, Rectangle
from .sampling.borders import check_border, clear_border, with_alpha
from .sampling.checks import check_picture
from .sampling.samplers import remap
from .screens import Screen, View, parts_of
from .viewpoints import Viewpoint, check_viewpoint
from .yuv.chroma import remap_planes, remap_whole_planes
from .yuv.planes import (
    SITINGS,
    Planes,
    Siting,
    border_of_planes,
    check_planes,
    check_shapes,
    empty_planes,
    subsampling,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Dewarper:
    """Straightens pictures of a camera: made once for a view, called for every picture.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        A screen, such as those of :mod:`omnimirror.screens`, or a mosaic of several.
    interpolation
        ``"auto"``: cubic where the view magnifies, and where it shrinks the picture the mean of as many cubic
        samples as it takes, so that nothing aliases. ``"nearest"``, ``"linear"`` and ``"cubic"``: one
        sample for every pixel. ``"area"``: the mean over all that a pixel covers, everywhere.
    viewpoint
        How screens at a finite distance are seen. ``"exact"``: each point by its own reflection.
        ``"single"``: all from one viewpoint on the axis, as in the paper, the one whose largest error at
        the screen's distance is least. A number: from that height over the mirror vertex, mm. Distant
        screens are the same in all three, and before a camera with one viewpoint the first two are.
    border
        The colour outside the field, in the picture's own values: a number for all its channels, or one for
        each. Of frames as in :meth:`planes`, a grey level or (y, u, v).
    keep_map
        Whether a map of all pixels is made before the first picture, which takes as long as some ten pictures and
        makes each of them up to 1.7 times as quick: for a view that stays over many. Pictures with and without
        differ by rounding; of one dewarper, the first is like all others.

    It can be pickled and copied; what it prepared is then made again.

    Raises
    ------
    InvalidParameter
        For an unknown interpolation or viewpoint, for a picture of another size or kind than the camera's,
        or one that has no such values as the border's.
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

    A wall 30 cm ahead, and how far off it would be if the mirror had a single viewpoint:

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
        instance("camera", self.camera, Camera, "a camera, such as om.load_sensor gives")
        has_parts = hasattr(self.view, "targets_at") or hasattr(self.view, "parts")  # so has the name of a file
        if not (has_parts and hasattr(self.view, "size")):
            raise WrongKind(f"view = {shown(self.view)} is not one of om.screens or om.views")
        if not isinstance(self.interpolation, str) or self.interpolation not in INTERPOLATIONS:
            known = ", ".join(INTERPOLATIONS)
            raise InvalidParameter(f"interpolation = {shown(self.interpolation)} is not one of {known}")
        check_viewpoint(self.viewpoint)
        check_border(self.border)

    def __call__(self, image: Image, transparent: bool = False, out: Image | None = None) -> Image:
        """The straightened picture, of the same depth.

        Parameters
        ----------
        image : (h, w) or (h, w, 1) or (h, w, 3) or (h, w, 4) array, uint8, uint16 or float32
            A picture of the camera's ``image_size``.
        transparent
            Whether to add an alpha channel, 0 outside the field. A picture that comes with an alpha of its
            own has the border's there.
        out
            A picture of the view's size, with the channels and the depth of the result, to be filled and returned.

        Raises
        ------
        InvalidParameter
            For a picture of another size or kind than the camera's, or an ``out`` of another than the view's.
        """
        check_picture(image, self.camera.image_size)
        instance("transparent", transparent, bool, "True or False")
        if out is not None:
            instance("out", out, np.ndarray, "an array of pixels")
        border: Border = self.border
        if transparent:
            border = clear_border(border, image)
            image = with_alpha(image)
        return remap(image, self._map, self.interpolation, out, border)

    @checked
    def planes(
        self,
        parts: Planes,
        out: Planes | None = None,
        siting: Siting = "left",
        to_siting: Siting | None = None,
        full_range: bool = False,
        bits: int = 8,
    ) -> Planes:
        """The straightened frame of a video, plane by plane as it is coded, without any conversion.

        Parameters
        ----------
        parts : (y, u, v), (y, uv) as in NV12 and P010, or (y, u, v, opacity)
            Luma of the camera's ``image_size``; colours of half of it, rounded up, (h, w) or (h, w, 2), or in three
            planes of half the width (4:2:2), or of all of it (4:4:4). Opacity as luma; outside the field it is 0,
            unless the border is a colour. uint8 or uint16, with any strides.
        out : planes as of the view, optional
            Planes (h, w) of the view to be filled, such as those of a frame to be encoded; arranged as ``parts``.
        siting
            Where colour samples lie: ``"left"`` as in H.264 and MPEG-2, ``"center"`` as in JPEG and MPEG-1,
            or ``"topleft"``.
        to_siting
            Where they lie in the result; there too where not given.
        full_range
            Whether luma counts from 0, or from 16 (in 8 bits). A ``border`` that is a number is a grey level that
            counts from 0 either way.
        bits
            Of values in uint16: 10 for yuv420p10, 16 for P010, whose values stand in the upper bits.

        Returns
        -------
        planes
            Arrays (h, w) of the view, arranged as ``parts``.

        Raises
        ------
        InvalidParameter
            For planes that are no frame of the camera's.

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
        remap_planes(parts[:3], self._map, self._chroma_map(sitings), self.interpolation, out[:3], border)
        return out

    @checked
    def coordinates(self, exact: bool = False) -> Array:
        """Source pixels (height, width, 2) as (u, v); NaN outside the field.

        Most are interpolated between exact ones, to within .005 px in pictures of 1000 px (.01 px at 4096);
        ``exact`` projects every pixel by itself, many times slower.

        Parameters
        ----------
        exact
            Project every pixel by itself.

        Returns
        -------
        (height, width, 2) array
            Source pixels (u, v).

        Raises
        ------
        OutsideField
            The view sees nothing of the camera's field.
        """
        pixels = source_pixels(self.camera, self.view, self.viewpoint, exact)
        if np.isnan(pixels[..., 0]).all():
            raise self._sees_nothing()
        return pixels

    def _sees_nothing(self) -> OutsideField:
        seen = field_of(self.camera)
        return OutsideField(
            f"the {self.view} sees nothing of the camera's field, which reaches from "
            f"{seen.tilt_min_deg:.6g} to {seen.tilt_max_deg:.6g} deg of elevation"
        )

    @property
    def valid(self) -> Mask:
        """(height, width), False outside the field: seen of a picture of ones, an eighth of a map in memory."""
        width, height = self.camera.image_size
        return remap(np.ones((height, width), np.uint8), self._map, "nearest").view(np.bool_)

    @cached_property
    def _map(self) -> Map:
        """Where to sample, the same for all pictures: all pixels' places if asked for, or if there is nothing else."""
        return self._pixel_map if self.keep_map or self._quick_map is None else self._quick_map

    @cached_property
    def _quick_map(self) -> Map | None:
        """What is made much sooner than a map of all pixels, and sampled nearly as fast; None where there is none."""
        if not isinstance(self.view, Screen):
            return None
        if is_separable(self.camera, self.view):
            polar = polar_map_of(self.camera, self.view, self.viewpoint)
            # Where it does not seem to, only a map of all pixels tells whether anything is seen.
            return replace(polar, annulus=annulus_of(self.camera)) if polar.shows_something() else None
        lattice = lattice_map_of(self.camera, self.view, self.viewpoint)
        if not lattice.shows_something():
            raise self._sees_nothing()
        return replace(lattice, annulus=annulus_of(self.camera))

    @cached_property
    def _pixel_map(self) -> PixelMap:
        annulus = annulus_of(self.camera)
        if self._quick_map is not None:
            return PixelMap.of(self._quick_map, annulus)
        views = [] if isinstance(self.view, Screen) else parts_of(self.view)
        rectangles = [Rectangle(left, top, *screen.size) for left, top, screen in views]
        return PixelMap(self.coordinates().astype(np.float32), self.camera.image_size, annulus, rectangles)

    def _chroma_map(self, sitings: tuple[Siting, Siting]) -> Map:
        """Of colours in 4:2:0, sited so in the source and in the view."""
        if sitings not in self._chroma_maps:
            in_picture, in_view = (SITINGS[siting] for siting in sitings)
            self._chroma_maps[sitings] = self._map.halved(in_picture, in_view)
        return self._chroma_maps[sitings]

    @cached_property
    def _chroma_maps(self) -> dict[tuple[Siting, Siting], Map]:
        return {}
