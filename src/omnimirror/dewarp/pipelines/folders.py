"""Folders of pictures straightened, as the command does."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ...base.arguments import checked, file_name
from ...cameras.camera import Camera
from .. import views
from ..contracts import Interpolation
from ..screens import View
from ..viewpoints import Viewpoint
from .border import AskedBorder, BorderColour
from .pictures import PictureStraightener, Straightened
from .request import Size, Straightening
from .restoring import Restoration


@checked
def dewarp_pictures(
    sources: str | Path | Iterable[str | Path],
    folder: str | Path,
    *,
    camera: Camera | Callable[[Size], Camera],
    view: View | Callable[[Camera], View] = views.panorama,
    interpolation: Interpolation = "auto",
    viewpoint: Viewpoint = "exact",
    border: AskedBorder | None = None,
    transparent: bool | None = None,
    restoration: Restoration | None = None,
    keep_lean: bool = False,
    stored_orientation: bool = False,
    wavelengths_nm: tuple[float, float, float] | None = None,
    skip_existing: bool = False,
    threads: int | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Straightened:
    """Straighten pictures into a folder, side by side, as ``omnimirror dewarp`` does.

    Each keeps its name, its depth as far as the file holds it, and what it carries (EXIF, colour profile). Panoramas
    say of themselves what viewers need.

    Parameters
    ----------
    sources
        Files, folders and patterns such as ``"raw/*.jpg"``.
    folder
        Where the straightened pictures go.
    camera
        Which took them; or a function of a picture's (width, height) in px that gives it.
    view
        A screen of :mod:`omnimirror.screens`; or a function of the camera, such as those of :mod:`omnimirror.views`.
    interpolation, viewpoint
        As for :class:`omnimirror.Dewarper`.
    border
        The colour outside the field: a grey level or (red, green, blue) in the picture's values, or ``"#rrggbb"``.
    transparent
        Whether the picture is transparent outside the field; by default where the file can be.
    restoration
        How pictures are sharpened first; not at all by default.
    keep_lean
        Draw the view as the camera leans, not level.
    stored_orientation
        Take pixels as stored, without the orientation in their EXIF data.
    wavelengths_nm
        Of red, green and blue light, where each is to be straightened as a sensor's lens and cover refract it.
    skip_existing
        Leave out what has been written already.
    threads
        How many pictures are worked on at once; by default as many as there are processor cores.
    progress
        Told how many are done, and of how many.

    Returns
    -------
    Straightened
        Which were done; those that failed, each with its sentence.

    Raises
    ------
    InvalidParameter
        The folder is a file, or a colour is none.
    MediaError
        A source is no file, or two would become one.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> from pathlib import Path
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/a.png", np.full((1024, 1024, 3), 90, np.uint8))
    ...     found = om.dewarp_pictures(
    ...         f"{folder}/*.png", f"{folder}/straight", camera=om.load_sensor("paper-spherical"),
    ...         view=lambda camera: om.views.panorama(camera, (360, None)),
    ...     )
    ...     om.read_image(f"{folder}/straight/a.png").shape, len(found.results.failed)
    ((135, 360, 4), 0)
    """
    colour = None if border is None else BorderColour.of(border)
    how = Straightening(camera, view, interpolation, viewpoint, colour, keep_lean, stored_orientation)
    names = [sources] if isinstance(sources, str | Path) else list(sources)
    straightener = PictureStraightener(
        how, transparent=transparent, restoration=restoration, wavelengths_nm=wavelengths_nm
    )
    return straightener.many(
        names, file_name("folder", folder), skip_existing=skip_existing, threads=threads, progress=progress
    )
