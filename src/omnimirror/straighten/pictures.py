"""Pictures straightened from file to file, one or many side by side."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from threading import Lock

import numpy as np

from ..analysis.wavelength import at_wavelength
from ..arguments import check_fields, checked, file_name
from ..cameras import Camera
from ..dewarp import ColourDewarper, Dewarper, views
from ..dewarp.contracts import Border, Interpolation
from ..dewarp.screens import View
from ..dewarp.viewpoints import Viewpoint
from ..errors import InvalidParameter
from ..files import is_same_file, name_of
from ..media import GPano, write_image
from ..media.batch import PICTURES, Job, Results, expand_inputs, outputs_for, run_parallel
from ..media.pictures.images import Image, can_be_panorama, check_size, format_of, read_picture
from ..sensor import Sensor
from ..simulate.restoration.blur_scale import UNSEEN_SHARE
from ..simulate.restoration.noise import told_noise
from ..simulate.restoration.round_blur import ToldBlur, load_blur
from ..simulate.restoration.sharpening import Restorer
from .border import AskedBorder, BorderColour
from .depths import as_held
from .request import VIDEOS, Size, Straightening


@dataclass(frozen=True)
class Restoration:
    """How pictures are sharpened before they are straightened.

    Parameters
    ----------
    noise
        Standard deviation as a share of full scale; estimated from each picture by default.
    object_distance_mm
        From the mirror to what is seen; infinite by default.
    blur_px
        Blur diameter or (tangential, sagittal) ones, or a CSV file of them over the field; the sensor's by default.

    Examples
    --------
    >>> import omnimirror as om
    >>> restorer = om.Restoration(noise=0.01).restorer(om.load_sensor("paper-spherical"))
    >>> restorer.camera.name
    'paper-spherical'
    """

    noise: float | None = None
    object_distance_mm: float | None = None
    blur_px: ToldBlur | str | Path | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    def restorer(self, camera: Camera) -> Restorer:
        """What sharpens the pictures of a camera.

        Parameters
        ----------
        camera
            A sensor, or a calibrated camera.

        Returns
        -------
        Restorer
            Called with a picture and its noise.

        Raises
        ------
        InvalidParameter
            Nothing is known of the camera's blur, or it is told twice.
        """
        if self.blur_px is None and not isinstance(camera, Sensor):
            raise InvalidParameter("to restore, the lens and the mirror must be known (a sensor), or the blur told")
        if self.blur_px is not None and self.object_distance_mm is not None:
            raise InvalidParameter("the blur that is told holds at any distance; leave out the object's distance")
        blur = load_blur(self.blur_px, camera) if isinstance(self.blur_px, str | Path) else self.blur_px
        distance = np.inf if self.object_distance_mm is None else self.object_distance_mm
        return Restorer(camera, distance, blur)


@dataclass(frozen=True)
class Straightened:
    """What became of many pictures."""

    results: Results
    """Which were done, which failed and why, which were not begun."""
    was_there: int = 0
    """How many had been written already."""
    left_out: Counter[str] = field(default_factory=Counter)
    """What pictures carried that their files cannot hold, and of how many."""


class PictureStraightener:
    """Straightens pictures from file to file; those of one size share their map."""

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
        self.alone = Lock()  # it needs a lot of memory
        self.left_out: Counter[str] = Counter()

    def _dewarper(self, size: Size, border: Border) -> tuple[Dewarper | ColourDewarper, GPano | None]:
        """What straightens pictures of a size, and what its panoramas say of themselves."""
        stands = self.how.camera_of(size)
        camera = self.how.drawing(stands)
        view = self.how.view_of(camera)
        panorama = self.how.panorama_of(stands, view)
        if self.wavelengths_nm is None:
            return self.how.dewarper(camera, view, border), panorama
        how = (view, self.how.interpolation, self.how.viewpoint, border)
        return ColourDewarper(self._colours(camera), *how), panorama

    def _colours(self, camera: Camera) -> tuple[Sensor, Sensor, Sensor]:
        """The camera in red, green and blue light."""
        assert self.wavelengths_nm is not None
        if not isinstance(camera, Sensor):
            raise InvalidParameter(
                "what parts the colours is known of a sensor with a lens and a cover; straighten the pictures of this "
                "camera without wavelengths_nm, or by an om.ColourDewarper of three calibrations"
            )
        red, green, blue = (at_wavelength(camera, nm) for nm in self.wavelengths_nm)
        return red, green, blue

    def _inside(self, size: Size, border: Border) -> str:
        """How much of the view lies inside the field of pictures of a size: the same for all of them."""
        return _percent(self.dewarper(size, border)[0])

    def _restorer(self, camera: Camera) -> Restorer:
        assert self.restoration is not None
        return self.restoration.restorer(camera)

    def _restored(self, picture: Image, source: Path, camera: Camera) -> tuple[Image, str]:
        """The picture without its blur, and what was found."""
        assert self.restoration is not None
        told = self.restoration.noise
        with self.alone:
            restorer = self.restorer(camera)  # type: ignore[arg-type]
            noise = restorer.estimate_noise(picture, source) if told is None else told_noise(told, picture.shape)
            share = restorer.shown_share(picture, noise)
            found = f"; restored at a noise of {100 * noise.share:.2g} % ({noise.kind})"
            if share < 1:
                why = "does not show how much it has" if share == UNSEEN_SHARE else "shows no more"
                found += f", and {100 * share:.0f} % of the blur is taken out, since the picture {why}"
            return restorer(picture, noise, share), found

    def __call__(self, source: Path, output: Path) -> str:
        """Read, straighten and write one picture; what was done, in a sentence."""
        if is_same_file(output, source):
            raise InvalidParameter(f"{output} is the picture to straighten; write to another name")
        kind = format_of(output)
        if self.transparent and not kind.has_alpha:
            raise InvalidParameter(
                f"{output.suffix} files hold no transparency; write .png, .tif or .webp, or black outside the field"
            )
        picture, carried = read_picture(source)
        border = self.how.border.of_picture(picture) if self.how.border else 0
        same = (picture.shape[1], picture.shape[0]), border  # for all such pictures
        dewarp, panorama = self.dewarper(*same)
        check_size(output, dewarp.view.size)
        restored = ""
        if self.restoration is not None:
            picture, restored = self._restored(picture, source, dewarp.camera)
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
        """Pictures, folders and patterns into a folder, side by side; those that fail are named, the others done."""
        if folder.exists() and not folder.is_dir():
            raise InvalidParameter(f"{folder} is a file, and several pictures need a folder")
        if not folder.is_dir() and folder.suffix.lower() in (*PICTURES, *VIDEOS):
            raise InvalidParameter(f"{folder} is the name of one file, and several pictures need a folder")
        paths = expand_inputs(sources)
        found = list(zip(paths, outputs_for(paths, folder), strict=True))
        pairs = [(s, o) for s, o in found if not (skip_existing and o.exists())]
        jobs = [Job(str(s), lambda s=s, o=o: self(s, o)) for s, o in pairs]  # type: ignore[misc]
        return Straightened(run_parallel(jobs, threads, progress), len(found) - len(pairs), self.left_out)


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
    how = Straightening(camera, view, interpolation, viewpoint, colour, keep_lean)
    names = [sources] if isinstance(sources, str | Path) else list(sources)
    straightener = PictureStraightener(
        how, transparent=transparent, restoration=restoration, wavelengths_nm=wavelengths_nm
    )
    return straightener.many(
        names, file_name("folder", folder), skip_existing=skip_existing, threads=threads, progress=progress
    )


def _change_of_depth(had: str, has: str) -> str:
    """What was lost or found on the way into a file of another depth."""
    words = {"uint8": "8 bits", "uint16": "16 bits", "float32": "light"}
    return "" if had == has else f", {words[had]} written as {words[has]}"


def _percent(dewarp: Dewarper | ColourDewarper) -> str:
    share = 100 * dewarp.valid.mean()
    return "all" if share == 100 else f"{share:.3g} %"
