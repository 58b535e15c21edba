"""Options that specify the camera of images: file or parameters, mount, detected mirror
outline, orientation of the images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click
import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...cameras.camera import CameraLooks, Mount
from ...cameras.models import MirrorBall
from ...cameras.models.camera_model import Optics
from ...io.image_metadata import UPRIGHT, applied
from ...io.images import orientation_of, read_image_and_metadata
from ._declarations import (
    SENSOR,
    Options,
    angle,
    ball,
    flag,
    format_setting,
    option,
    pitch_roll,
    setting,
)
from ._output import print_remark

if TYPE_CHECKING:
    from ...calibration.rim import MirrorOutline
    from ...optics.camera_files import AnyCamera
    from ...optics.sensor import Sensor


# -- Orientation of images and videos --------------------------------------------------------------


@dataclass(frozen=True)
class OrientationOptions(Options):
    """Orientation of images and videos."""

    stored_orientation: bool = setting("input", default=False)
    """Use pixels as stored, without the rotation in EXIF data or in the display matrix of videos."""

    def read(self, files: Sequence[Path]) -> list[NDArray[Any]]:
        """Return the images in files, and report the orientations that were applied."""
        loaded = [
            read_image_and_metadata(file, stored_orientation=self.stored_orientation)
            for file in files
        ]
        self._report([metadata.orientation for _, metadata in loaded])
        return [image for image, _ in loaded]

    def report(self, files: Sequence[Path]) -> None:
        """Report the orientations that are applied to the images in files."""
        self._report([orientation_of(file) for file in files])

    def report_video(self, video: str) -> None:
        """Report remarks on a video, such as the orientation applied to its frames."""
        from ...io.video_reader import VideoReader

        with VideoReader(
            video, with_audio=False, stored_orientation=self.stored_orientation
        ) as reader:
            for note in reader.notes:
                print_remark(f"omnimirror: {note}")

    def _report(self, orientations: Sequence[int]) -> None:
        for orientation, count in Counter(orientations).items():
            if orientation != UPRIGHT:
                description = applied(orientation, self.stored_orientation)
                print_remark(f"omnimirror: {count} of {len(orientations)} images {description}")


# -- Camera and mounting ---------------------------------------------------------------------------

SOURCES = ("sensor", "ball")
MODEL_ENTRIES = ("optics", "rim_radius_px")
"""Entries of the table [camera] of a camera file."""


@dataclass(frozen=True)
class CameraOptions(Options):
    """Camera."""

    sensor: str | None = option(
        type=SENSOR,
        metavar="FILE|NAME",
        help="Sensor or camera file, also calib_results.txt, or a bundled sensor.",
    )
    ball: tuple[float, float, float, float] | None = option(
        type=ball,
        metavar="CX,CY,R,FOV",
        help="Mirror ball: its circle (px) and full field (deg).",
    )
    camera_looks: CameraLooks | None = option(
        type=click.Choice(["up", "down", "forward"]),
        metavar="DIRECTION",
        help="Optical axis: up, down or forward.  [default: as in the file; up for --ball; "
        "forward for --mirror ball and convex]",
    )
    optics: Optics | None = setting("camera")
    rim_radius_px: float | None = setting("camera")
    forward_azimuth_deg: float | None = setting("camera", type=angle)
    image_flipped: bool | None = setting("camera")
    level: tuple[float, float] | None = setting("camera", type=pitch_roll)
    keep_tilt: bool | None = setting("camera")

    def check(self) -> None:
        """Raise UsageError unless exactly one camera is given, or for settings of another kind of
        camera.
        """
        if len(sources := self.subset(*SOURCES)) != 1:
            requested = " and ".join(map(flag, sources)) or "none"
            raise click.UsageError(
                f"exactly one of --sensor and --ball must be given; got {requested}"
            )
        if self.sensor is None and (given := list(self.subset(*MODEL_ENTRIES))):
            raise click.UsageError(
                f"{flag(given[0])} requires --sensor; it does not apply to --ball"
            )

    def camera(self, image_size: tuple[int, int]) -> AnyCamera:
        """Return the camera with the mounting of the options; for a ball, in images of size (width,
        height).
        """
        camera: AnyCamera
        if self.sensor is not None:
            from ...optics.camera_files import load_camera  # not required for a ball

            entries = self.subset(*MODEL_ENTRIES)
            camera = load_camera(self.sensor, {"camera": entries} if entries else None)
        elif self.ball is not None:
            u, v, radius, full_field = self.ball
            camera = MirrorBall(
                centre_px=(u, v), rim_radius_px=radius, field_deg=full_field, image_size=image_size
            )
        return replace(camera, mount=self.mount_of(camera.mount))

    def mount_of(self, mount: Mount) -> Mount:
        """Return the mounting, with missing options taken from ``mount``."""
        changes = {f.name: self.given[f.name] for f in fields(Mount) if f.name in self.given}
        if self.level is not None:
            changes |= dict(zip(("pitch_deg", "roll_deg"), self.level, strict=True))
        return replace(mount, **changes)

    def drawing(self, camera: AnyCamera) -> AnyCamera:
        """Return the camera that draws the view: as if plumb if the options keep the tilt."""
        return replace(camera, mount=camera.mount.levelled) if self.keep_tilt else camera

    def command_words(self) -> tuple[str, tuple[str, ...]]:
        """Return a name for the camera, and these options as words of a command line."""
        kind = next(name for name in SOURCES if name in self.given)
        text = ",".join(f"{x:.10g}" for x in self.ball) if self.ball else str(self.sensor)
        arguments = [flag(kind), text]
        if self.camera_looks is not None:
            arguments += [flag("camera_looks"), self.camera_looks]
        for f in fields(self):
            if "table" in f.metadata and f.name in self.given:
                value = format_setting(getattr(self, f.name))
                arguments += ["--set", f"{f.metadata['table']}.{f.name}={value}"]
        return "mirror ball" if kind == "ball" else Path(text).name, tuple(arguments)


# -- Uncalibrated camera ---------------------------------------------------------------------------

MAX_DETECTION_IMAGES = 9  # images of a folder used for outline detection
CameraOfSize: TypeAlias = "Callable[[tuple[int, int]], Sensor | MirrorBall]"


@dataclass(frozen=True)
class AutoOptions(Options):
    """Camera without calibration."""

    auto: bool | None = option(
        is_flag=True,
        help="Uncalibrated camera: detect the outline of the mirror in the images.",
    )
    mirror: str | None = option(
        metavar="NAME|FILE",
        help="Mirror for --auto: ball, dome, ... or a sensor.  [default: one-shot]",
    )

    def check(self, camera: CameraOptions) -> None:
        """Raise UsageError for --mirror without --auto, or for another camera with --auto."""
        if not self.auto:
            if self.mirror is not None:
                raise click.UsageError("--mirror requires --auto")
            camera.check()
            return
        if given := list(camera.subset(*SOURCES, *MODEL_ENTRIES)):
            raise click.UsageError(f"--auto and {flag(given[0])} must not be given together")

    def refuse_video(self, source: str) -> None:
        """Raise UsageError for --auto with a video."""
        if self.auto:
            raise click.UsageError(
                f"--auto requires images; got {source}; for a video, detect the outline in "
                "one of its frames with 'omnimirror rim', and specify it with --ball"
            )

    def camera(
        self, sources: tuple[str, ...], options: CameraOptions, orientation: OrientationOptions
    ) -> tuple[CameraOfSize, str]:
        """Return the detected camera with the mounting of the options, and a report of the
        detection.
        """
        from ...calibration.rim import (
            DEFAULT_PRESET,
            PRESETS,
            camera_from_rim,
            detect_mirror_outline,
            mirror_by_name,
        )

        name = self.mirror or DEFAULT_PRESET
        mirror_by_name(name)  # checked before the outline detection, which takes seconds
        images = _same_size_images(sources, orientation)
        rim = detect_mirror_outline(images)
        camera = camera_from_rim(rim, name)
        camera = replace(camera, mount=options.mount_of(camera.mount))
        levelling = ""
        if isinstance(camera, MirrorBall) and options.level is None:
            camera, levelling = _level_ball(camera, images[0])

        def camera_of(size: tuple[int, int]) -> Sensor | MirrorBall:
            if size != rim.image_size:
                raise InvalidParameter(
                    f"the image size must be {rim.image_size[0]} x {rim.image_size[1]} px, "
                    f"that of the images with the detected rim; got {size[0]} x {size[1]} "
                    "px; dewarp images of each size separately"
                )
            return camera

        (u, v), among = rim.centre_px, "" if len(images) == 1 else f" in {len(images)} images"
        description = f" ({PRESETS[name].words})" if name in PRESETS else ""
        default = "" if self.mirror else "; specify another with --mirror"
        report = (
            f"detected rim of radius {rim.radius_px:.1f} px at {u:.1f}, {v:.1f}{among}, "
            f"confidence {rim.confidence:.2f}; assumed mirror: "
            f"{name}{description}{default}{_tilt_ambiguity(rim, name)}{levelling}"
        )
        return camera_of, report


def _tilt_ambiguity(rim: MirrorOutline, mirror: str) -> str:
    """Return a warning if the outline of a known sensor implies a mirror tilted to either side."""
    from ...calibration.rim import PRESETS, sensors_from_rim
    from ...optics.sensor_files import load_sensor

    if mirror in PRESETS or len(sensors := sensors_from_rim(rim, load_sensor(mirror))) == 1:
        return ""
    assumed, other = (
        f"{one.mirror_pose.tilt_x_deg:.1f}, {one.mirror_pose.tilt_y_deg:.1f}" for one in sensors
    )
    return f"; tilt {assumed} deg about x and y assumed; {other} deg has the same outline"


def _level_ball(ball: MirrorBall, image: NDArray[np.uint8]) -> tuple[MirrorBall, str]:
    """Return the ball levelled from vertical edges of its image, if reliable, and a report."""
    from ...calibration.levelling import level_from_image

    orientations = {"up": "up", "down": "down", "forward": "forward"}[ball.mount.camera_looks]
    level = level_from_image(image, ball, ball.mount, ball.centre_px, ball.rim_radius_px)
    if level is None or not level.is_reliable:
        return (
            ball,
            f"; the camera is assumed to look {orientations} without tilt (--camera-looks, --set camera.level)",
        )
    tilt = f"{level.pitch_deg:.1f},{level.roll_deg:.1f} deg, from {level.upright} vertical edges"
    report = f"; the camera is assumed to look {orientations} (--camera-looks); tilt {tilt}"
    return replace(ball, mount=level.on(ball.mount)), report


def _same_size_images(
    sources: tuple[str, ...], orientation: OrientationOptions
) -> list[NDArray[np.uint8]]:
    """Return the images, among the first few, that have the size of the first image and thus its
    outline.
    """
    from ...io import read_image
    from ...io.batch import expand_inputs

    is_stored = orientation.stored_orientation
    images = [
        read_image(file, stored_orientation=is_stored)
        for file in expand_inputs(sources)[:MAX_DETECTION_IMAGES]
    ]
    return [image for image in images if image.shape[:2] == images[0].shape[:2]]
