"""Videos of a sensor that moves through a scene."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import check_fields, number, validate_arguments
from ..base.caching import cached_property
from ..base.colour import Light
from ..base.errors import InvalidParameter, MediaError, extra_remedy
from ..io.keyframes import Keyframes
from ..optics.camera_files import AnyCamera
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


@dataclass(frozen=True)
class ImageSequence:
    """Images of a camera that moves along a path through a scene.

    Parameters
    ----------
    camera
        Sensor, or a calibrated camera.
    scene
        Scene, such as :class:`omnimirror.Room` or the result of :func:`omnimirror.load_scene`.
    path
        Path returned by :func:`omnimirror.load_path`.
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

    Raises
    ------
    InvalidParameter
        If the frame rate or the duration is invalid.

    Notes
    -----
    A frame is a pure function of its number, so that several processes render parts of a sequence.
    The camera is static during an exposure.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.io.keyframes import Keyframes
    >>> path = Keyframes({"x_mm": ((0.0, 0.0), (0.08, 60.0))})
    >>> camera = om.Unified(
    ...     xi=0.9, focal_px=(20.0, 20.0), centre_px=(15.5, 15.5), image_size=(32, 32)
    ... )
    >>> sequence = om.ImageSequence(camera, om.Room(texel_mm=40.0), path, samples=1)
    >>> len(sequence), sequence.image(1).shape
    (3, (32, 32, 3))
    """

    camera: AnyCamera
    scene: Scene
    path: Keyframes
    bodies: Sequence[MovingBox] = ()
    frame_rate: float = 25.0
    duration_s: float | None = None
    samples: int = 4
    blur: bool = False
    radiometry: Radiometry | None = None
    detector: Detector = field(default_factory=Detector)
    seed: int = 0

    def __post_init__(self) -> None:
        check_fields(self)
        frame_times(self.path, self.frame_rate, self.duration_s)

    @cached_property
    def times_s(self) -> tuple[float, ...]:
        """Times of the frames."""
        return tuple(frame_times(self.path, self.frame_rate, self.duration_s))

    def __len__(self) -> int:
        """Return the number of frames."""
        return len(self.times_s)

    def pose(self, number: int) -> Pose:
        """Return the pose of the camera in a frame.

        Parameters
        ----------
        number
            Number of the frame, from 0.

        Returns
        -------
        Pose
            Position, mm, and rotation, deg.
        """
        return Pose(**self.path.at(self.times_s[number]))

    def posed_scene(self, number: int) -> PosedScene:
        """Return the scene and its bodies in the frame of the camera.

        Parameters
        ----------
        number
            Number of the frame, from 0.

        Returns
        -------
        PosedScene
            Scene at the time of the frame.
        """
        scene = with_bodies(self.scene, self.bodies, self.times_s[number])
        return PosedScene(scene, self.pose(number))

    def light(self, number: int, *, on_progress: Callable[[int, int], None] | None = None) -> Light:
        """Return the linear light (h, w, 3) of a frame.

        Parameters
        ----------
        number
            Number of the frame, from 0.
        on_progress
            Callback with the number of rendered parts and the total.

        Returns
        -------
        light : (h, w, 3)
            Linear RGB, 1 at saturation for an exposure of 1.

        Raises
        ------
        InvalidParameter
            As in :func:`omnimirror.expose`, or if the path leads to a position that is impossible
            for a sensor.
        """
        return expose(
            self.camera,
            self.posed_scene(number),
            samples=self.samples,
            blur=self.blur,
            radiometry=self.radiometry,
            seed=self.seed + number,
            on_progress=on_progress,
        )

    def image(
        self,
        number: int,
        light: Light | None = None,
        *,
        on_progress: Callable[[int, int], None] | None = None,
    ) -> NDArray[Any]:
        """Return a frame read by the detector.

        Parameters
        ----------
        number
            Number of the frame, from 0.
        light : (h, w, 3)
            Linear light of the frame, if already rendered.
        on_progress
            Callback as in :meth:`light`.

        Returns
        -------
        image : (h, w, 3), or (h, w) for a Bayer mosaic
            Values of the detector.
        """
        if light is None:
            light = self.light(number, on_progress=on_progress)
        return self.detector.read(light, self.seed + number)


@validate_arguments
def write_video(
    sequence: ImageSequence,
    output: str | Path,
    *,
    on_progress: Callable[[int, int], None] | None = None,
) -> int:
    """Write an image sequence as a video and return its number of frames.

    Parameters
    ----------
    sequence
        Camera, scene, path and rendering parameters.
    output
        Output file.
    on_progress
        Callback with the number of written frames and the total number.

    Returns
    -------
    int
        Number of frames.

    Raises
    ------
    InvalidParameter
        As in :meth:`ImageSequence.light`.
    MediaError
        If PyAV is not installed, or the file cannot be written.
    KeyboardInterrupt
        On Ctrl-C; the video then contains the completed frames.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from omnimirror.io.keyframes import Keyframes
    >>> camera = om.Unified(
    ...     xi=0.9, focal_px=(40.0, 40.0), centre_px=(31.5, 31.5), image_size=(64, 64)
    ... )
    >>> path = Keyframes({"x_mm": ((0.0, 0.0), (0.04, 100.0))})
    >>> sequence = om.ImageSequence(camera, om.Room(texel_mm=40.0), path, samples=1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_video(sequence, f"{folder}/film.mp4")
    2
    """
    check_video_can_be_written(output)

    def images() -> Iterator[NDArray[Any]]:
        for k in range(len(sequence)):
            yield sequence.image(k)
            if on_progress is not None:
                on_progress(k + 1, len(sequence))

    encode(output, sequence.camera.image_size, sequence.frame_rate, images())
    return len(sequence)


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
