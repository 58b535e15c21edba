"""Requests for dewarping images and videos of any size: camera, view, border colour, video options."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import check_fields, format_value, instance, parse_float
from ..base.errors import InvalidParameter
from ..cameras.camera import Camera, Mount
from ..io import GPano
from ..io.batch import VIDEO_SUFFIXES
from ..io.image_sequences import is_sequence
from ..io.images import OPAQUE
from . import Dewarper, views
from .interfaces import Border, Interpolation
from .screens import Cylinder, Equirectangular, View
from .view_geometry import Viewpoint

if TYPE_CHECKING:
    import av


# -- Border colour ---------------------------------------------------------------------------------

HEX_DIGITS = set("0123456789abcdefABCDEF")
VALID_COLOURS = "a grey level, R,G,B or #rrggbb"


@dataclass(frozen=True)
class BorderColour:
    """Grey level or RGB colour, in image values or as a hexadecimal colour.

    >>> BorderColour.of("#204080").for_image(np.zeros((1, 1, 3), np.uint8)), BorderColour.of(7).values
    ((32.0, 64.0, 128.0), (7.0,))
    """

    text: str
    values: tuple[float, ...]
    is_hex: bool
    """True for values from 0 to 255, independent of the data type of the image."""

    @classmethod
    def of(cls, border: BorderArgument) -> BorderColour:
        """Create a colour from a grey level, (red, green, blue), or text: ``"16"``, ``"255,128,0"``
        or ``"#rrggbb"``.

        >>> [BorderColour.of(b).values for b in ("16", "255,128,0", "#ff8000", (1, 2, 3))]
        [(16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0), (1.0, 2.0, 3.0)]

        Raises
        ------
        InvalidParameter
            If it is not a colour.
        """
        if isinstance(border, BorderColour):
            return border
        if isinstance(border, str):
            if border.startswith("#") and len(border) == 7 and set(border[1:]) <= HEX_DIGITS:
                return cls(
                    border, tuple(float(int(border[i : i + 2], 16)) for i in (1, 3, 5)), True
                )
            text, parts = border, border.split(",")
        else:
            parts = (
                [f"{part}" for part in border] if isinstance(border, Sequence) else [f"{border}"]
            )
            text = ",".join(parts)
        try:
            values = tuple(parse_float(part) for part in parts)
        except ValueError:
            values = ()
        if len(values) not in (1, 3) or not np.isfinite(values).all():
            raise InvalidParameter(f"border must be {VALID_COLOURS}; got {format_value(border)}")
        return cls(text, values, False)

    def for_image(self, image: NDArray[Any]) -> tuple[float, ...]:
        """Return one value per channel of a grey, RGB or RGBA image, opaque.

        Raises
        ------
        InvalidParameter
            If it is not a colour of the image.
        """
        values = self._scaled(image.dtype.name)
        full = OPAQUE[image.dtype.name]
        if image.dtype.kind == "u" and not all(
            0 <= value <= full and value % 1 == 0 for value in values
        ):
            raise InvalidParameter(
                f"border must contain integers from 0 to {full} for {image.dtype.name} images; got {self.text}"
            )
        channels = image.shape[2] if image.ndim == 3 else 1
        if channels == 1:
            if len(set(values)) > 1:
                raise InvalidParameter(
                    f"border must be one value for a grey image; got {self.text}"
                )
            return values[:1]
        colour = values if len(values) == 3 else values * 3
        return colour if channels == 3 else (*colour, float(full))

    def for_frame(self, frame: av.VideoFrame) -> tuple[int, int, int]:
        """Return y, u and v in the colour coding of a video frame.

        Raises
        ------
        InvalidParameter
            If it is not an 8-bit colour.
        """
        from ..io.video_frames import coded_colour

        return coded_colour(self.for_image(np.empty((1, 1, 3), np.uint8)), frame)

    def _scaled(self, depth: str) -> tuple[float, ...]:
        if not self.is_hex or depth == "uint8":
            return self.values
        if depth == "uint16":
            return tuple(257.0 * value for value in self.values)
        from ..base.colour import hex_colour  # floating-point images contain linear light

        return tuple(float(light) for light in hex_colour(self.text))


BorderArgument: TypeAlias = BorderColour | str | float | Sequence[float]


# -- Dewarping requests ----------------------------------------------------------------------------

C = TypeVar("C", bound=Camera)
Size: TypeAlias = tuple[int, int]
PipeFormat: TypeAlias = Literal["y4m", "rawvideo"]


@dataclass(frozen=True)
class DewarpRequest:
    """Request for dewarping images of any size.

    Parameters
    ----------
    camera
        Camera, or a function that returns it for an image size (width, height) in px, as for a
        mirror ball.
    view
        Screen, or a function that returns one for a camera, such as those of
        :mod:`omnimirror.views`.
    interpolation, viewpoint
        As in :class:`omnimirror.Dewarper`.
    border
        Colour outside the field; black by default.
    keep_tilt
        Draw the view relative to the tilted camera, without levelling; panoramas store the tilt for
        viewers.
    stored_orientation
        Use pixels as stored, ignoring the orientation in EXIF data or in the display matrix of a
        video.
    """

    camera: Camera | Callable[[Size], Camera]
    view: View | Callable[[Camera], View] = views.panorama
    interpolation: Interpolation = "auto"
    viewpoint: Viewpoint = "exact"
    border: BorderColour | None = None
    keep_tilt: bool = False
    stored_orientation: bool = False

    def camera_of(self, size: Size) -> Camera:
        """Return the camera for images of a size (width, height), with its actual tilt."""
        camera = self.camera if isinstance(self.camera, Camera) else self.camera(size)
        return instance("the result of camera(size)", camera, Camera, "a camera")

    def view_camera(self, camera: Camera) -> Camera:
        """Return the camera for the view: without tilt if the view is not levelled."""
        return without_tilt(camera) if self.keep_tilt else camera

    def view_of(self, camera: Camera) -> View:
        """Return the view drawn by a camera."""
        return self.view(camera) if callable(self.view) else self.view

    def dewarper(
        self, camera: Camera, view: View, border: Border, keep_map: bool = False
    ) -> Dewarper:
        """Return the dewarper for the images of a camera that draws the view."""
        return Dewarper(camera, view, self.interpolation, self.viewpoint, border, keep_map)

    def panorama_of(self, camera: Camera, view: View) -> GPano | None:
        """Return the GPano metadata of the view; None unless it is a distant panorama linear in
        tilt.
        """
        if (
            not isinstance(view, Cylinder | Equirectangular)
            or not view.is_distant
            or getattr(view, "rows", "tilt") != "tilt"
        ):
            return None
        mount = _mount_of(camera) if self.keep_tilt else None
        tilt = (0.0, 0.0) if mount is None else mount.view_tilt_deg(view.pan_deg)
        return GPano.of_view(
            view.size, (view.tilt_min_deg, view.tilt_max_deg), view.span_deg, tilt_deg=tilt
        )


@dataclass(frozen=True)
class VideoSettings:
    """Selection of a video and output settings.

    Parameters
    ----------
    start_s, duration_s
        Start and duration of the selection, seconds; all by default.
    frame_rate
        Frame rate of numbered images, frames per second; 25 by default.
    codec, crf, pixel_format
        As in :class:`omnimirror.io.video_writer.VideoWriter`; by default from the file suffix and
        the source.
    pipe_format
        Format written to ``-``: ``"y4m"`` or ``"rawvideo"``.
    keyframes
        CSV or TOML file with pan, tilt, roll, field and distance over time.
    preview
        Also show the view in a window.
    skip_existing
        Skip existing numbered images of the output.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.VideoSettings(start_s=2.0, crf=20).encoding()
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
        """Return the specified encoder settings of files and streams.

        Returns
        -------
        dict
            Keyword arguments of the writer.
        """
        names = (
            ("codec", "crf") if self.pipe_format == "rawvideo" else ("codec", "crf", "pixel_format")
        )
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def is_video(source: str) -> bool:
    """Return True if the name of a source is that of a video file, a camera or a stream.

    >>> [is_video(s) for s in ("room.MP4", "0", "/dev/video2", "rtsp://door/1", "room.png", "*.jpg", "١٢٣")]
    [True, True, True, True, False, False, False]
    """
    is_live = (
        (source.isascii() and source.isdigit())
        or source.startswith("/dev/video")
        or "://" in source
    )
    return (
        is_live
        or source == "-"
        or is_sequence(source)
        or Path(source).suffix.lower() in VIDEO_SUFFIXES
    )


def without_tilt(camera: C) -> C:
    """Return the camera without its tilt.

    Raises
    ------
    InvalidParameter
        If it has no mount that could be tilted.
    """
    if (mount := _mount_of(camera)) is None:
        raise InvalidParameter(
            f"the camera must have a mount to keep its tilt; got a {type(camera).__name__} without"
        )
    upright: C = replace(camera, mount=mount.levelled)  # type: ignore[type-var]  # all implementations are dataclasses
    return upright


def _mount_of(camera: Camera) -> Mount | None:
    mount = getattr(camera, "mount", None)
    return mount if isinstance(mount, Mount) else None
