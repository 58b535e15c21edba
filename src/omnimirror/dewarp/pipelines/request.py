"""How pictures and videos are to be straightened, before their size is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, TypeAlias, TypeVar

from ...base.arguments import check_fields, instance
from ...base.errors import InvalidParameter
from ...cameras.camera import Camera
from ...cameras.frames import Mount
from ...io import GPano
from ...io.batch import VIDEOS
from ...io.video.sequences import is_sequence
from .. import Dewarper, views
from ..contracts import Border, Interpolation
from ..screens import Cylinder, Sphere, View
from ..viewpoints import Viewpoint
from .border import BorderColour

C = TypeVar("C", bound=Camera)
Size: TypeAlias = tuple[int, int]
PipeFormat: TypeAlias = Literal["y4m", "rawvideo"]


@dataclass(frozen=True)
class Straightening:
    """How pictures of any size are straightened.

    Parameters
    ----------
    camera
        Which took them; or a function of the picture's (width, height) in px that gives it, as for a mirror ball.
    view
        A screen; or a function that gives one for a camera, such as those of :mod:`omnimirror.views`.
    interpolation, viewpoint
        As for :class:`omnimirror.Dewarper`.
    border
        The colour outside the field; black where not given.
    keep_lean
        Draw the view as the camera leans, not level; a panorama says by how much, for viewers to level it.
    stored_orientation
        Take pixels as stored, without the orientation in EXIF data or in the display matrix of a video.
    """

    camera: Camera | Callable[[Size], Camera]
    view: View | Callable[[Camera], View] = views.panorama
    interpolation: Interpolation = "auto"
    viewpoint: Viewpoint = "exact"
    border: BorderColour | None = None
    keep_lean: bool = False
    stored_orientation: bool = False

    def camera_of(self, size: Size) -> Camera:
        """The camera of pictures of a size (width, height), standing as it really does."""
        found = self.camera if isinstance(self.camera, Camera) else self.camera(size)
        return instance("the camera of the pictures", found, Camera, "a camera")

    def drawing(self, camera: Camera) -> Camera:
        """The camera that draws the view: plumb, however it really leans, where the lean is kept."""
        return plumb(camera) if self.keep_lean else camera

    def view_of(self, camera: Camera) -> View:
        """The view that the camera draws."""
        return self.view(camera) if callable(self.view) else self.view

    def dewarper(self, camera: Camera, view: View, border: Border, keep_map: bool = False) -> Dewarper:
        """What straightens the pictures of a camera that draws the view."""
        return Dewarper(camera, view, self.interpolation, self.viewpoint, border, keep_map)

    def panorama_of(self, camera: Camera, view: View) -> GPano | None:
        """What viewers of panoramas must know of the view; None for one that is no distant panorama linear in tilt."""
        if not isinstance(view, Cylinder | Sphere) or not view.is_distant or getattr(view, "rows", "tilt") != "tilt":
            return None
        mount = _mount_of(camera) if self.keep_lean else None
        lean = (0.0, 0.0) if mount is None else mount.lean_of_view(view.pan_deg)
        return GPano.of_view(view.size, (view.tilt_min_deg, view.tilt_max_deg), view.span_deg, lean_deg=lean)


@dataclass(frozen=True)
class Recording:
    """What is taken of a video, and how it is written.

    Parameters
    ----------
    start_s, duration_s
        What is taken, seconds; all of it by default.
    frame_rate
        Of numbered pictures, frames a second; 25 by default.
    codec, crf, pixel_format
        As for :class:`omnimirror.io.video.writer.VideoWriter`; by the file's suffix and the source by default.
    pipe_format
        What ``-`` writes: ``"y4m"`` or ``"rawvideo"``.
    keyframes
        A CSV or TOML file of pan, tilt, roll, field and distance over time.
    preview
        Show the view in a window, too.
    skip_existing
        Of numbered pictures to write: leave out those that are there already.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.Recording(start_s=2.0, crf=20).encoding()
    {'crf': 20}
    """

    start_s: float | None = None
    duration_s: float | None = None
    frame_rate: float | None = None
    codec: str | None = None
    crf: int | None = None
    pixel_format: str | None = None
    pipe_format: PipeFormat | None = None
    keyframes: str | Path | None = None
    preview: bool = False
    skip_existing: bool = False

    def __post_init__(self) -> None:
        check_fields(self)

    def encoding(self) -> dict[str, Any]:
        """How files and streams are encoded, where it was said.

        Returns
        -------
        dict
            Keywords of the writer.
        """
        names = ("codec", "crf") if self.pipe_format == "rawvideo" else ("codec", "crf", "pixel_format")
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def is_video(source: str) -> bool:
    """Whether a source is a video file, a camera or a stream, going by its name.

    >>> [is_video(s) for s in ("room.MP4", "0", "/dev/video2", "rtsp://door/1", "room.png", "*.jpg", "١٢٣")]
    [True, True, True, True, False, False, False]
    """
    is_live = (source.isascii() and source.isdigit()) or source.startswith("/dev/video") or "://" in source
    return is_live or source == "-" or is_sequence(source) or Path(source).suffix.lower() in VIDEOS


def plumb(camera: C) -> C:
    """The camera as it would stand without a lean.

    Raises
    ------
    InvalidParameter
        It has no mount that could lean.
    """
    if (mount := _mount_of(camera)) is None:
        raise InvalidParameter("this camera has no mount, so nothing is known of how it leans")
    upright: C = replace(camera, mount=mount.upright)  # type: ignore[type-var]
    return upright


def _mount_of(camera: Camera) -> Mount | None:
    mount = getattr(camera, "mount", None)
    return mount if isinstance(mount, Mount) else None
