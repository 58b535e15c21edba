"""Videos of a sensor that moves through a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import number, validate_arguments
from ..base.colour import Light
from ..base.errors import InvalidParameter, MediaError, extra_remedy
from ..cameras.camera import Camera
from ..io.keyframes import Keyframes
from .detector import Detector
from .radiometry import Radiometry
from .rendering import expose
from .scenes.moving_objects import MovingBox, with_bodies
from .scenes.scene import POSE_NAMES, Pose, PosedScene, Scene

MAX_FRAMES = 100_000
MIN_FRAME_RATE = 1e-3  # frames per second


@validate_arguments
def load_path(path: str | Path) -> Keyframes:
    """Read poses over time from a CSV or TOML file with ``time_s`` and any of ``x_mm``, ``y_mm``, ``pan_deg``, ...

    A value missing in the first keyframe is 0 there; one missing in a later keyframe is interpolated.

    Parameters
    ----------
    path
        File name.

    Returns
    -------
    Keyframes
        Poses over time.

    Raises
    ------
    MediaError
        If the file does not exist, or an entry is missing, unknown or invalid.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/path.csv", "w") as file:
    ...         _ = file.write("time_s,x_mm\\n0,0\\n0.04,100\\n")
    ...     om.load_path(f"{folder}/path.csv").at(0.02)
    {'x_mm': 50.0}
    """
    return Keyframes.load(path, POSE_NAMES)


def frame_times(path: Keyframes, frame_rate: float, duration_s: float | None = None) -> list[float]:
    """Return the times (s) of the frames of a video, from 0 to the last keyframe by default.

    Raises
    ------
    InvalidParameter
        If the frame rate or the duration is invalid.

    Examples
    --------
    >>> frame_times(Keyframes({"x_mm": ((0.0, 0.0), (1.0, 500.0))}), 4.0)
    [0.0, 0.25, 0.5, 0.75, 1.0]
    """
    number("frame_rate", frame_rate, low=MIN_FRAME_RATE, high=1e6)
    if duration_s is None:
        duration_s = max(time for track in path.tracks.values() for time, _ in track)
    count = (
        int(np.floor(duration_s * frame_rate + 1e-9)) + 1
        if duration_s >= 0 and frame_rate > 0
        else 0
    )
    if not 1 <= count <= MAX_FRAMES:
        raise InvalidParameter(
            f"the video must have 1 to {MAX_FRAMES} frames; got {duration_s:g} s at {frame_rate:g} frames/s"
        )
    return [i / frame_rate for i in range(count)]


def frame_at(
    camera: Camera,
    scene: Scene,
    path: Keyframes,
    time_s: float,
    samples: int = 4,
    blur: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    on_progress: Callable[[int, int], None] | None = None,
) -> Light:
    """Return the linear light (h, w, 3) at the time ``time_s``; the sensor is static during the
    exposure.

    Raises
    ------
    InvalidParameter
        As in :func:`~omnimirror.expose`, or if the path leads to a position that is impossible for
        a sensor.
    """
    posed_scene = PosedScene(scene, Pose(**path.at(time_s)))
    return expose(
        camera,
        posed_scene,
        samples=samples,
        blur=blur,
        radiometry=radiometry,
        seed=seed,
        on_progress=on_progress,
    )


class VideoFrame(NamedTuple):
    """Frame of a video after it is written."""

    number: int
    time_s: float
    pose: Pose
    light: Light
    """Linear light (h, w, 3)."""


@validate_arguments
def write_video(
    camera: Camera,
    scene: Scene,
    *,
    path: Keyframes,
    output: str | Path,
    bodies: Sequence[MovingBox] = (),
    frame_rate: float = 25.0,
    duration_s: float | None = None,
    samples: int = 4,
    blur: bool = False,
    radiometry: Radiometry | None = None,
    detector: Detector | None = None,
    seed: int = 0,
    on_frame: Callable[[VideoFrame, int], None] | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write the video of a camera along a path and return its number of frames.

    Parameters
    ----------
    camera
        Sensor, or a calibrated camera.
    scene
        Scene, such as :class:`omnimirror.Room` or the result of :func:`omnimirror.load_scene`.
    path
        Path returned by :func:`omnimirror.load_path`.
    output
        Output file.
    bodies
        Moving bodies, such as :class:`omnimirror.MovingBox` or those returned by
        :func:`omnimirror.load_bodies`.
    frame_rate
        Frames per second.
    duration_s
        Duration, s; up to the last pose by default.
    samples
        Rays per pixel.
    blur
        Render defocus blur with the whole aperture of the lens.
    radiometry
        Reflectivity of the mirror, vignetting of the lens, and appearance of the housing.
    detector
        Image sensor electronics; without noise by default.
    seed
        Random seed.
    on_frame
        Callback with each frame after it is written, and the total number.
    on_progress
        Callback of the number of written frames and the total number.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    InvalidParameter
        As in :func:`frame_times` and :func:`frame_at`.
    MediaError
        If PyAV is not installed, or the file cannot be written.
    KeyboardInterrupt
        On Ctrl-C; the video then contains the completed frames.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/path.csv", "w") as file:
    ...         _ = file.write("time_s,x_mm\\n0,0\\n0.04,100\\n")
    ...     om.write_video(
    ...         small, om.Room(texel_mm=40.0), path=om.load_path(f"{folder}/path.csv"), output=f"{folder}/film.mp4",
    ...         samples=1)
    2
    """
    check_video_can_be_written(output)
    times, detector = frame_times(path, frame_rate, duration_s), detector or Detector()

    def images() -> Iterator[NDArray[Any]]:
        for i, time in enumerate(times):
            posed_scene = with_bodies(scene, bodies, time)
            light = frame_at(camera, posed_scene, path, time, samples, blur, radiometry, seed + i)
            yield detector.read(light, seed + i)
            if on_frame is not None:
                on_frame(VideoFrame(i, time, Pose(**path.at(time)), light), len(times))
            if on_progress is not None:
                on_progress(i + 1, len(times))

    encode(output, camera.image_size, frame_rate, images())
    return len(times)


def encode(
    output: str | Path, size: tuple[int, int], frame_rate: float, images: Iterable[NDArray[Any]]
) -> None:
    """Write RGB images (h, w, 3) as a video."""
    from ..io.video_frames import frame_of_image
    from ..io.video_writer import VideoWriter

    rate = Fraction(frame_rate).limit_denominator(1001)
    with VideoWriter(output, size, rate) as video:
        for number, image in enumerate(images):
            frame = frame_of_image(image)
            frame.pts, frame.time_base = number, 1 / rate
            video.write(frame)


def check_video_can_be_written(output: str | Path) -> None:
    """Raise MediaError unless PyAV is installed."""
    if find_spec("av") is None:
        raise MediaError(f"writing the video {output} requires PyAV: {extra_remedy('video')}")
