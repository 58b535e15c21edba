"""Dewarping of image files, individually or in parallel, at the bit depth of their format."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.colour import linear_from_srgb, srgb_from_linear
from ..base.errors import InvalidParameter
from ..base.files import display_name, is_same_file
from ..base.results import Columns, Result
from ..cameras.camera import Camera
from ..io import GPano, write_image
from ..io.batch import (
    IMAGE_SUFFIXES,
    VIDEO_SUFFIXES,
    BatchResult,
    Job,
    expand_inputs,
    outputs_for,
    run_parallel,
)
from ..io.image_metadata import (
    ORIENTATION_NAMES,
    STORED_ORIENTATION_HINT,
    TRANSPOSING_ORIENTATIONS,
    UPRIGHT,
    Exposure,
    applied,
    exposure_of,
)
from ..io.images import (
    OPAQUE,
    Image,
    ImageFormat,
    ImageMetadata,
    can_be_panorama,
    check_size,
    encode_image,
    format_of,
    read_image_and_metadata,
)
from . import ColourDewarper, Dewarper
from .interfaces import Border
from .request import BorderColour, DewarpRequest, Size, VideoSettings, is_video

if TYPE_CHECKING:
    from ..optics.sensor import Sensor
    from .restoration.deblurring import Restoration, Restorer

__all__ = ["BorderColour", "DewarpRequest", "DewarpedImages", "VideoSettings", "is_video"]


# -- Conversion to file formats: integers are sRGB, floats linear light ----------------------------

ImageArray = NDArray[Any]


def depth_for(depth: str, kind: ImageFormat) -> str:
    """Return the nearest depth supported by a file format; for linear light stored as integers, the
    largest one.

    >>> from omnimirror.io.images import format_of
    >>> depth_for("uint16", format_of("a.jpg")), depth_for("float32", format_of("a.png"))
    ('uint8', 'uint16')
    """
    return depth if depth in kind.depths else kind.depths[-1]


def as_stored(image: ImageArray, kind: ImageFormat) -> ImageArray:
    """Convert an image to a depth and channels supported by a file format.

    16 bits are rounded to 8; floating-point light is converted to sRGB, clipped at white, and vice
    versa. A grey image becomes RGB if the format supports no grey images. Alpha is linear.

    >>> from omnimirror.io.images import format_of
    >>> as_stored(np.array([[0, 257, 65535]], np.uint16), format_of("a.jpg"))
    array([[  0,   1, 255]], dtype=uint8)
    >>> as_stored(np.array([[0.0, 0.214, 7.0]], np.float32), format_of("a.jpg"))
    array([[  0, 127, 255]], dtype=uint8)
    """
    depth = depth_for(image.dtype.name, kind)
    if depth != image.dtype.name:
        image = _in_depth(image, depth)
    channels = image.shape[2] if image.ndim == 3 else 1
    if channels == 1 and 1 not in kind.channels:
        image = np.repeat(image.reshape(*image.shape[:2], 1), 3, axis=2)
    return image


def _in_depth(image: ImageArray, depth: str) -> ImageArray:
    values = image.astype(np.float64) / OPAQUE[image.dtype.name]
    colours: ImageArray = values[..., :3] if image.ndim == 3 else values
    if image.dtype == np.float32:
        colours = srgb_from_linear(np.nan_to_num(colours))
    elif depth == "float32":
        colours = linear_from_srgb(colours)
    values[..., : colours.shape[-1]] = colours
    if depth == "float32":
        return values.astype(np.float32)
    return np.rint(values.clip(0, 1) * OPAQUE[depth]).astype(depth)


class SourceImage(NamedTuple):
    """Decoded image with its metadata."""

    name: str
    """File name, for messages."""
    pixels: Image
    metadata: ImageMetadata


class DewarpedImage(NamedTuple):
    """Dewarped image in the depth and with the metadata of its output format."""

    pixels: Image
    panorama: GPano | None
    metadata: ImageMetadata
    notes: str
    """Summary of the view and of conversions."""

    def encoded(self, output: str | Path) -> bytes:
        """Return the bytes of the output file."""
        return encode_image(output, self.pixels, panorama=self.panorama, metadata=self.metadata)


# -- Dewarping of image files ----------------------------------------------------------------------
#
# Sensors and deblurring are imported on demand: their import takes as long as dewarping a mirror-ball
# image.


@dataclass(frozen=True)
class DewarpedImages(Result):
    """Result of dewarping several images."""

    results: BatchResult
    """Completed, failed (with reasons) and unprocessed images."""
    skipped: int = 0
    """Number of skipped images with existing output."""
    dropped_metadata: Counter[str] = field(default_factory=Counter)
    """Metadata that the output formats cannot store, with the number of images."""
    oriented: Counter[str] = field(default_factory=Counter)
    """Orientations other than that of the stored pixels, in words, with the number of images."""

    def _table(self) -> Columns:
        return self.results._table()


class ImageDewarper:
    """Dewarper of image files; images of one size share their map."""

    def __init__(
        self,
        request: DewarpRequest,
        *,
        transparent: bool | None = None,
        restoration: Restoration | None = None,
        wavelengths_nm: tuple[float, float, float] | None = None,
    ) -> None:
        self.request, self.restoration, self.wavelengths_nm = request, restoration, wavelengths_nm
        self.transparent = False if request.border else transparent
        self.dewarper = cache(self._dewarper)
        self.inside = cache(self._inside)
        self.restorer = cache(self._restorer)
        self.restoration_lock = Lock()  # needs much memory
        self.dropped_metadata: Counter[str] = Counter()
        self.oriented: Counter[str] = Counter()

    def _dewarper(
        self, size: Size, border: Border
    ) -> tuple[Dewarper | ColourDewarper, GPano | None]:
        """Return the dewarper for images of one size, and the GPano metadata of its panoramas."""
        mounted = self.request.camera_of(size)
        camera = self.request.view_camera(mounted)
        view = self.request.view_of(camera)
        panorama = self.request.panorama_of(mounted, view)
        if self.wavelengths_nm is None:
            return self.request.dewarper(camera, view, border), panorama
        arguments = (view, self.request.interpolation, self.request.viewpoint, border)
        return ColourDewarper(self._colours(camera), *arguments), panorama

    def _colours(self, camera: Camera) -> tuple[Sensor, Sensor, Sensor]:
        """Return the camera for red, green and blue light."""
        from ..analysis.operating_conditions import at_wavelength
        from ..optics.sensor import Sensor

        assert self.wavelengths_nm is not None
        if not isinstance(camera, Sensor):
            raise InvalidParameter(
                "wavelengths_nm must be omitted unless the camera is a sensor; got a "
                f"{type(camera).__name__}; alternatively use an om.ColourDewarper of three "
                "calibrations"
            )
        red, green, blue = (at_wavelength(camera, nm) for nm in self.wavelengths_nm)
        return red, green, blue

    def _inside(self, size: Size, border: Border) -> str:
        """Return a description of the fraction of the view inside the field for images of one size."""
        return _percent(self.dewarper(size, border)[0])

    def _restorer(self, camera: Camera, exposure: Exposure) -> Restorer:
        assert self.restoration is not None
        return self.restoration.restorer(camera, exposure)

    def _restored(
        self, image: Image, source: Path, camera: Camera, exposure: Exposure
    ) -> tuple[Image, str]:
        """Return the deblurred image and a description of its blur and noise."""
        assert self.restoration is not None
        with self.restoration_lock:
            return self.restoration.restored(image, source, self.restorer(camera, exposure))  # type: ignore[arg-type]  # cameras are hashable

    def __call__(self, source: Path, output: Path) -> str:
        """Read, dewarp and write one image; return a summary sentence."""
        if is_same_file(output, source):
            raise InvalidParameter(f"the output must differ from the source image; got {output}")
        self.check_output(output)
        is_stored = self.request.stored_orientation
        image, metadata = read_image_and_metadata(source, stored_orientation=is_stored)
        dewarped = self.dewarp(SourceImage(str(source), image, metadata), output)
        write_image(output, dewarped.pixels, panorama=dewarped.panorama, metadata=dewarped.metadata)
        return f"{display_name(output)}: {dewarped.notes}"

    def check_output(self, output: Path) -> None:
        """Raise InvalidParameter if the format of an output has no required transparency."""
        kind = format_of(output)
        if self.transparent and not kind.has_alpha:
            raise InvalidParameter(
                "the output must be a .png, .tif or .webp file for transparency; got a "
                f"{output.suffix} file; alternatively use black outside the field"
            )

    def dewarp(self, source: SourceImage, output: Path) -> DewarpedImage:
        """Dewarp a decoded image for the format of an output."""
        kind, is_stored = format_of(output), self.request.stored_orientation
        image, orientation = source.pixels, source.metadata.orientation
        border = self.request.border.for_image(image) if self.request.border else 0
        key = (image.shape[1], image.shape[0]), border  # identical for all such images
        dewarp, panorama = self.dewarper(*key)
        _check_orientation(key[0], dewarp.camera.image_size, orientation, is_stored)
        check_size(output, dewarp.view.size)
        restored = ""
        if self.restoration is not None:
            exposure = exposure_of(source.metadata.exif)
            image, restored = self._restored(image, Path(source.name), dewarp.camera, exposure)
        dewarped = dewarp(image, kind.has_alpha if self.transparent is None else self.transparent)
        converted = as_stored(dewarped, kind)
        recoded = converted.dtype != dewarped.dtype and np.float32 in (
            converted.dtype,
            dewarped.dtype,
        )
        metadata, dropped = source.metadata.supported_by(output, converted, recoded)
        height, width = dewarped.shape[:2]
        notes = _change_of_depth(dewarped.dtype.name, converted.dtype.name)
        if dropped:
            notes += f", {dropped}"
            self.dropped_metadata[dropped] += 1
        if orientation != UPRIGHT:
            turned = applied(orientation, is_stored)
            notes += f", {turned}"
            self.oriented[turned] += 1
        return DewarpedImage(
            converted,
            panorama if can_be_panorama(output) else None,
            metadata,
            f"{dewarp.view}, {width} x {height} px, {self.inside(*key)} inside the field"
            f"{notes}{restored}",
        )

    def dewarp_many(
        self,
        sources: Iterable[str | Path],
        folder: Path,
        *,
        skip_existing: bool = False,
        threads: int | None = None,
        on_progress: Callable[[int, int], None] | None = None,
    ) -> DewarpedImages:
        """Dewarp images, folders and patterns to a folder in parallel; failures are reported and do
        not stop the others.
        """
        if folder.exists() and not folder.is_dir():
            raise InvalidParameter(
                f"the output must be a folder for several images; got the file {folder}"
            )
        if not folder.is_dir() and folder.suffix.lower() in (*IMAGE_SUFFIXES, *VIDEO_SUFFIXES):
            raise InvalidParameter(
                f"the output must be a folder for several images; got the file name {folder}"
            )
        paths = expand_inputs(sources)
        pairs_of_paths = list(zip(paths, outputs_for(paths, folder), strict=True))
        pairs = [(s, o) for s, o in pairs_of_paths if not (skip_existing and o.exists())]
        jobs = [Job(str(s), lambda s=s, o=o: self(s, o)) for s, o in pairs]  # type: ignore[misc]  # type of the default is not inferred
        results = run_parallel(jobs, threads, on_progress)
        return DewarpedImages(
            results, len(pairs_of_paths) - len(pairs), self.dropped_metadata, self.oriented
        )


def _check_orientation(size: Size, camera_size: Size, orientation: int, is_stored: bool) -> None:
    """Raise an error that names the option if an image matches the camera only in its other
    orientation.
    """
    if orientation in TRANSPOSING_ORIENTATIONS and size != tuple(camera_size) == size[::-1]:
        remedy = (
            "omit --set input.stored_orientation=true (stored_orientation=True in Python)"
            if is_stored
            else STORED_ORIENTATION_HINT
        )
        raise InvalidParameter(
            f"the image must have the {camera_size[0]} x {camera_size[1]} px of the "
            f"camera; got {size[0]} x {size[1]} px, "
            f"{'as stored' if is_stored else ORIENTATION_NAMES[orientation]}; {remedy}"
        )


def _change_of_depth(before: str, after: str) -> str:
    """Return a description of the loss or conversion caused by a change of depth."""
    names = {"uint8": "8 bits", "uint16": "16 bits", "float32": "linear light"}
    return "" if before == after else f", converted from {names[before]} to {names[after]}"


def _percent(dewarp: Dewarper | ColourDewarper) -> str:
    percent = 100 * dewarp.valid.mean()
    return "all pixels" if percent == 100 else f"{percent:.3g} % of the pixels"
