"""Dewarping of image files, individually or in parallel.

Sensors and deblurring are imported on demand: their import takes as long as dewarping a mirror-ball
image.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np

from ...base.errors import InvalidParameter
from ...base.files import is_same_file, name_of
from ...cameras.camera import Camera
from ...io import GPano, write_image
from ...io.batch import PICTURES, VIDEOS, Job, Results, expand_inputs, outputs_for, run_parallel
from ...io.pictures.exif import Exposure, exposure_of
from ...io.pictures.images import Image, can_be_panorama, check_size, format_of, read_picture
from ...io.pictures.orientation import QUARTER_TURNS, STORED, UPRIGHT, WORDS, applied
from .. import ColourDewarper, Dewarper
from ..contracts import Border
from .depths import as_held
from .request import Size, Straightening

if TYPE_CHECKING:
    from ...optics.sensor import Sensor
    from ..restoration.sharpening import Restorer
    from .restoring import Restoration


@dataclass(frozen=True)
class Straightened:
    """Result of dewarping several images."""

    results: Results
    """Completed, failed (with reasons) and unprocessed images."""
    was_there: int = 0
    """Number of skipped images with existing output."""
    left_out: Counter[str] = field(default_factory=Counter)
    """Metadata that the output formats cannot store, with the number of images."""
    oriented: Counter[str] = field(default_factory=Counter)
    """Orientations other than that of the stored pixels, in words, with the number of images."""


class PictureStraightener:
    """Dewarper of image files; images of one size share their map."""

    def __init__(
        self,
        how: Straightening,
        *,
        transparent: bool | None = None,
        restoration: Restoration | None = None,
        wavelengths_nm: tuple[float, float, float] | None = None,
    ) -> None:
        self.how, self.restoration, self.wavelengths_nm = how, restoration, wavelengths_nm
        self.transparent = False if how.border else transparent
        self.dewarper = cache(self._dewarper)
        self.inside = cache(self._inside)
        self.restorer = cache(self._restorer)
        self.alone = Lock()  # needs much memory
        self.left_out: Counter[str] = Counter()
        self.oriented: Counter[str] = Counter()

    def _dewarper(self, size: Size, border: Border) -> tuple[Dewarper | ColourDewarper, GPano | None]:
        """Return the dewarper for images of one size, and the GPano metadata of its panoramas."""
        stands = self.how.camera_of(size)
        camera = self.how.drawing(stands)
        view = self.how.view_of(camera)
        panorama = self.how.panorama_of(stands, view)
        if self.wavelengths_nm is None:
            return self.how.dewarper(camera, view, border), panorama
        how = (view, self.how.interpolation, self.how.viewpoint, border)
        return ColourDewarper(self._colours(camera), *how), panorama

    def _colours(self, camera: Camera) -> tuple[Sensor, Sensor, Sensor]:
        """Return the camera for red, green and blue light."""
        from ...analysis.wavelength import at_wavelength
        from ...optics.sensor import Sensor

        assert self.wavelengths_nm is not None
        if not isinstance(camera, Sensor):
            raise InvalidParameter(
                "what parts the colours is known of a sensor with a lens and a cover; straighten the pictures of this "
                "camera without wavelengths_nm, or by an om.ColourDewarper of three calibrations"
            )
        red, green, blue = (at_wavelength(camera, nm) for nm in self.wavelengths_nm)
        return red, green, blue

    def _inside(self, size: Size, border: Border) -> str:
        """Return a description of the fraction of the view inside the field for images of one size."""
        return _percent(self.dewarper(size, border)[0])

    def _restorer(self, camera: Camera, exposure: Exposure) -> Restorer:
        assert self.restoration is not None
        return self.restoration.restorer(camera, exposure)

    def _restored(self, picture: Image, source: Path, camera: Camera, exposure: Exposure) -> tuple[Image, str]:
        """Return the deblurred image and a description of its blur and noise."""
        assert self.restoration is not None
        with self.alone:
            return self.restoration.restored(picture, source, self.restorer(camera, exposure))  # type: ignore[arg-type]

    def __call__(self, source: Path, output: Path) -> str:
        """Read, dewarp and write one image; return a summary sentence."""
        if is_same_file(output, source):
            raise InvalidParameter(f"{output} is the picture to straighten; write to another name")
        kind = format_of(output)
        if self.transparent and not kind.has_alpha:
            raise InvalidParameter(
                f"{output.suffix} files hold no transparency; write .png, .tif or .webp, or black outside the field"
            )
        is_stored = self.how.stored_orientation
        picture, carried = read_picture(source, stored_orientation=is_stored)
        border = self.how.border.of_picture(picture) if self.how.border else 0
        same = (picture.shape[1], picture.shape[0]), border  # identical for all such images
        dewarp, panorama = self.dewarper(*same)
        _check_orientation(same[0], dewarp.camera.image_size, carried.orientation, is_stored)
        check_size(output, dewarp.view.size)
        restored = ""
        if self.restoration is not None:
            picture, restored = self._restored(picture, source, dewarp.camera, exposure_of(carried.exif))
        straight = dewarp(picture, kind.has_alpha if self.transparent is None else self.transparent)
        held = as_held(straight, kind)
        recoded = held.dtype != straight.dtype and np.float32 in (held.dtype, straight.dtype)
        kept, left_out = carried.that_fits(output, held, recoded)
        write_image(output, held, panorama=panorama if can_be_panorama(output) else None, carried=kept)
        height, width = straight.shape[:2]
        told = _change_of_depth(straight.dtype.name, held.dtype.name)
        if left_out:
            told += f", {left_out}"
            self.left_out[left_out] += 1
        if carried.orientation != UPRIGHT:
            turned = applied(carried.orientation, is_stored)
            told += f", {turned}"
            self.oriented[turned] += 1
        size = f"{width} x {height} px"
        return f"{name_of(output)}: {dewarp.view}, {size}, {self.inside(*same)} of it inside the field{told}{restored}"

    def many(
        self,
        sources: Iterable[str | Path],
        folder: Path,
        *,
        skip_existing: bool = False,
        threads: int | None = None,
        progress: Callable[[int, int], None] | None = None,
    ) -> Straightened:
        """Dewarp images, folders and patterns to a folder in parallel; failures are reported and do
        not stop the others.
        """
        if folder.exists() and not folder.is_dir():
            raise InvalidParameter(f"{folder} is a file, and several pictures need a folder")
        if not folder.is_dir() and folder.suffix.lower() in (*PICTURES, *VIDEOS):
            raise InvalidParameter(f"{folder} is the name of one file, and several pictures need a folder")
        paths = expand_inputs(sources)
        found = list(zip(paths, outputs_for(paths, folder), strict=True))
        pairs = [(s, o) for s, o in found if not (skip_existing and o.exists())]
        jobs = [Job(str(s), lambda s=s, o=o: self(s, o)) for s, o in pairs]  # type: ignore[misc]
        results = run_parallel(jobs, threads, progress)
        return Straightened(results, len(found) - len(pairs), self.left_out, self.oriented)


def _check_orientation(size: Size, of_camera: Size, orientation: int, is_stored: bool) -> None:
    """Raise an error that names the option if an image matches the camera only in its other
    orientation.
    """
    if orientation in QUARTER_TURNS and size != tuple(of_camera) == size[::-1]:
        remedy = "leave out --stored-orientation (stored_orientation=True in Python)" if is_stored else STORED
        raise InvalidParameter(
            f"the image must have the {of_camera[0]} x {of_camera[1]} px of the camera; got {size[0]} x {size[1]} px, "
            f"{'as stored' if is_stored else WORDS[orientation]}; {remedy}"
        )


def _change_of_depth(had: str, has: str) -> str:
    """Return a description of the loss or conversion caused by a change of depth."""
    words = {"uint8": "8 bits", "uint16": "16 bits", "float32": "light"}
    return "" if had == has else f", {words[had]} written as {words[has]}"


def _percent(dewarp: Dewarper | ColourDewarper) -> str:
    share = 100 * dewarp.valid.mean()
    return "all" if share == 100 else f"{share:.3g} %"
