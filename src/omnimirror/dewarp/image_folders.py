"""Dewarping of image folders, as by the command ``omnimirror dewarp``."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ..base.arguments import file_name, validate_arguments
from ..cameras.camera import Camera
from . import views
from .image_files import DewarpedImages, ImageDewarper
from .interfaces import Interpolation
from .request import BorderArgument, BorderColour, DewarpRequest, Size
from .restoration.deblurring import Restoration
from .screens import View
from .view_geometry import Viewpoint


@validate_arguments
def dewarp_images(
    sources: str | Path | Iterable[str | Path],
    folder: str | Path,
    *,
    camera: Camera | Callable[[Size], Camera],
    view: View | Callable[[Camera], View] = views.panorama,
    interpolation: Interpolation = "auto",
    viewpoint: Viewpoint = "exact",
    border: BorderArgument | None = None,
    transparent: bool | None = None,
    restoration: Restoration | None = None,
    keep_tilt: bool = False,
    stored_orientation: bool = False,
    wavelengths_nm: tuple[float, float, float] | None = None,
    skip_existing: bool = False,
    threads: int | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> DewarpedImages:
    """Dewarp images to a folder in parallel, as ``omnimirror dewarp`` does.

    Each image keeps its name, its depth if the format supports it, and its metadata
    (EXIF, colour profile). Panoramas contain GPano metadata for viewers.

    Parameters
    ----------
    sources
        Files, folders and patterns such as ``"raw/*.jpg"``.
    folder
        Output folder.
    camera
        Camera, or a function that returns it for an image size (width, height) in px.
    view
        Screen of :mod:`omnimirror.screens`, or a function of the camera, such as those of
        :mod:`omnimirror.views`.
    interpolation, viewpoint
        As in :class:`omnimirror.Dewarper`.
    border
        Colour outside the field: a grey level or (red, green, blue) in image values, or
        ``"#rrggbb"``.
    transparent
        Transparency outside the field; by default if the file format supports it.
    restoration
        Deblurring before dewarping; none by default.
    keep_tilt
        Draw the view relative to the tilted camera, without levelling.
    stored_orientation
        Use pixels as stored, ignoring the orientation in the EXIF data.
    wavelengths_nm
        Wavelengths of red, green and blue light for the correction of lateral colour by the lens
        and cover of a sensor.
    skip_existing
        Skip images whose output exists.
    threads
        Number of images processed in parallel; by default the number of processor cores.
    on_progress
        Callback with the number of finished images and the total.

    Returns
    -------
    DewarpedImages
        Completed images, and failed ones with their error messages.

    Raises
    ------
    InvalidParameter
        If the folder is a file, or a colour is invalid.
    MediaError
        If a source is not a file, or two sources have the same output.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/a.png", np.full((1024, 1024, 3), 90, np.uint8))
    ...     found = om.dewarp_images(
    ...         f"{folder}/*.png", f"{folder}/straight", camera=om.load_sensor("paper-spherical"),
    ...         view=lambda camera: om.views.panorama(camera, (360, None)),
    ...     )
    ...     om.read_image(f"{folder}/straight/a.png").shape, len(found.results.failed)
    ((135, 360, 4), 0)
    """
    colour = None if border is None else BorderColour.of(border)
    request = DewarpRequest(
        camera, view, interpolation, viewpoint, colour, keep_tilt, stored_orientation
    )
    names = [sources] if isinstance(sources, str | Path) else list(sources)
    dewarper = ImageDewarper(
        request, transparent=transparent, restoration=restoration, wavelengths_nm=wavelengths_nm
    )
    return dewarper.dewarp_many(
        names,
        file_name("folder", folder),
        skip_existing=skip_existing,
        threads=threads,
        on_progress=on_progress,
    )
