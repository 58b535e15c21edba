"""Options that specify the camera of images: file or parameters, mount, detected mirror
outline, orientation of the images.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import click
import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...cameras.frames import CameraLooks, Mount
from ...cameras.models import MirrorBall, load_ocam
from ...cameras.models.camera_model import Optics
from ...io.exif import UPRIGHT, applied
from ...io.images import orientation_of, read_image_and_metadata
from ._declarations import Options, flag, option, refuse_other
from ._option_types import NUMBER, SENSOR, angle, ball, lean
from ._output import remark

if TYPE_CHECKING:
    from ...calibration.rim import MirrorOutline
    from ...optics.sensor import Sensor
    from ...optics.sensor_files import AnyCamera


# -- Option for the orientation of images and videos, and reports of applied orientations ----------


@dataclass(frozen=True)
class OrientationOptions(Options):
    """Orientation of images and videos."""

    stored_orientation: bool = option(
        default=False,
        is_flag=True,
        help="Take pixels as stored, without the rotation in EXIF data (images) or in the display matrix (videos).",
    )

    def read(self, files: Sequence[Path]) -> list[NDArray[Any]]:
        """Return the images in files, and report the orientations that were applied."""
        found = [
            read_image_and_metadata(file, stored_orientation=self.stored_orientation)
            for file in files
        ]
        self._report([carried.orientation for _, carried in found])
        return [image for image, _ in found]

    def report(self, files: Sequence[Path]) -> None:
        """Report the orientations that are applied to the images in files."""
        self._report([orientation_of(file) for file in files])

    def report_video(self, video: str) -> None:
        """Report remarks on a video, such as the orientation applied to its frames."""
        from ...io.video_reader import VideoReader

        with VideoReader(
            video, with_sound=False, stored_orientation=self.stored_orientation
        ) as reader:
            for note in reader.notes:
                remark(f"omnimirror: {note}")

    def _report(self, orientations: Sequence[int]) -> None:
        for orientation, count in Counter(orientations).items():
            if orientation != UPRIGHT:
                words = applied(orientation, self.stored_orientation)
                remark(f"omnimirror: {count} of {len(orientations)} images {words}")


# -- Options that specify a camera and its mounting ------------------------------------------------

Source: TypeAlias = Literal["sensor", "ocam", "ball"]

OPTIONS_OF_SOURCE: dict[Source, tuple[str, ...]] = {
    "sensor": (),
    "ocam": ("optics", "rim_radius_px"),
    "ball": (),
}


@dataclass(frozen=True)
class CameraOptions(Options):
    """Camera model, with its mounting."""

    sensor: str | None = option(
        type=SENSOR,
        metavar="FILE|NAME",
        help="Camera: a sensor file, a camera file, or the name of a bundled sensor.",
    )
    ocam: str | None = option(metavar="FILE", help="Camera: calib_results.txt of OCamCalib.")
    ball: tuple[float, float, float, float] | None = option(
        type=ball,
        metavar="CX,CY,R,FOV",
        help="Camera: a mirror ball, with its circle in px and its full field in deg. The optical axis is assumed "
        "to point up; for a ball photographed horizontally, add --camera-looks forward.",
    )
    optics: Optics | None = option(
        type=click.Choice(["mirror", "fisheye"]),
        help="Type of optics of the --ocam camera.  [default: mirror]",
    )
    rim_radius_px: float | None = option(
        type=NUMBER,
        metavar="PX",
        help="Radius of the field of --ocam in the image.  [default: unlimited]",
    )
    camera_looks: CameraLooks | None = option(
        type=click.Choice(["up", "down", "forward"]),
        help="Orientation of the optical axis.  [default: as in the sensor file, or up, also for --ball; forward "
        "for --auto with --mirror ball or convex]",
    )
    forward_azimuth_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Image direction of forward, from image right towards image bottom.  [default: as in the sensor file, "
        "or -90]",
    )
    image_flipped: bool | None = option(
        "--image-flipped/--not-image-flipped",
        help="Declare that the image is mirrored left to right.",
    )
    level: tuple[float, float] | None = option(
        type=lean,
        metavar="PITCH,ROLL",
        help="Level the view of a tilted sensor: its forward direction is PITCH deg above the horizon, and it is "
        "rolled ROLL deg clockwise.  [default: as in the sensor file, or 0,0]",
    )
    keep_lean: bool | None = option(
        is_flag=True,
        help="Draw the view in the tilted frame of the sensor; panorama metadata contain the tilt for viewers.",
    )

    def check(self) -> None:
        """Raise UsageError unless exactly one camera is given, or for options of another kind of
        camera.
        """
        sources = [name for name in OPTIONS_OF_SOURCE if name in self.given]
        if len(sources) != 1:
            found = (
                "none is given" if not sources else f"{' and '.join(map(flag, sources))} are given"
            )
            raise click.UsageError(
                f"say which camera it was with exactly one of --sensor, --ocam and --ball; {found}"
            )
        refuse_other(
            self.given,
            {flag(name): names for name, names in OPTIONS_OF_SOURCE.items()},
            flag(sources[0]),
        )

    def camera(self, picture_size: tuple[int, int]) -> AnyCamera:
        """Return the camera with the mounting of the options; for a ball, in images of size (width,
        height).
        """
        camera: AnyCamera
        if self.sensor is not None:
            from ...optics.sensor_files import load_camera  # not required for a ball

            camera = load_camera(self.sensor)
        elif self.ocam is not None:
            camera = load_ocam(self.ocam, self.optics or "mirror", rim_radius_px=self.rim_radius_px)
        elif self.ball is not None:
            u, v, radius, full_field = self.ball
            camera = MirrorBall((u, v), radius, full_field, picture_size)
        return replace(camera, mount=self.standing(camera.mount))

    def standing(self, mount: Mount) -> Mount:
        """Return the mounting, with missing options taken from ``mount``."""
        stands = {f.name: self.given[f.name] for f in fields(Mount) if f.name in self.given}
        if self.level is not None:
            stands |= dict(zip(("pitch_deg", "roll_deg"), self.level, strict=True))
        return replace(mount, **stands)

    def drawing(self, camera: AnyCamera) -> AnyCamera:
        """Return the camera that draws the view: as if plumb if the options keep the tilt."""
        return replace(camera, mount=camera.mount.upright) if self.keep_lean else camera

    def words(self) -> tuple[str, tuple[str, ...]]:
        """Return a name for the camera, and these options as words of a command line."""
        given = self.given
        kind = next(name for name in OPTIONS_OF_SOURCE if name in given)
        text = ",".join(f"{x:.10g}" for x in self.ball) if self.ball else str(given[kind])
        words = [flag(kind), text]
        for name in (*OPTIONS_OF_SOURCE[kind], "camera_looks", "forward_azimuth_deg"):
            if name in given:
                words += [flag(name), str(given[name])]
        if self.image_flipped is not None:
            words.append("--image-flipped" if self.image_flipped else "--not-image-flipped")
        if self.level is not None:
            words.append("--level={:.10g},{:.10g}".format(*self.level))
        if self.keep_lean:
            words.append("--keep-lean")
        return "mirror ball" if kind == "ball" else Path(text).name, tuple(words)


# -- Options for an uncalibrated camera: the outline of the mirror is detected in the images -------

LOOKED_AT = 9  # images of a folder used for outline detection
FoundCamera: TypeAlias = "Callable[[tuple[int, int]], Sensor | MirrorBall]"


@dataclass(frozen=True)
class AutoOptions(Options):
    """Automatic camera, and its type of mirror."""

    auto: bool | None = option(
        is_flag=True,
        help="Detect the outline of the mirror in the images and use the mirror of --mirror; a ball is levelled "
        "from vertical edges.",
    )
    mirror: str | None = option(
        metavar="PRESET|FILE|NAME",
        help="Mirror for --auto: one-shot, ball, dome, convex, paraboloid, hyperboloid, sphere, or a sensor. The "
        "camera of ball and convex is assumed to look forward, that of dome up (--camera-looks).  [default: "
        "one-shot]",
    )

    def check(self, camera: CameraOptions) -> None:
        """Raise UsageError for --mirror without --auto, or for another camera with --auto."""
        if not self.auto:
            if self.mirror is not None:
                raise click.UsageError("--mirror belongs to --auto")
            camera.check()
            return
        owned = {
            name: names for name, names in OPTIONS_OF_SOURCE.items() if camera.picked(name, *names)
        }
        if owned:
            given = next(
                iter(camera.picked(*(n for name, names in owned.items() for n in (name, *names))))
            )
            raise click.UsageError(
                f"--auto finds the camera, and {flag(given)} tells it; leave out one of them"
            )

    def refuse_video(self, source: str) -> None:
        """Raise UsageError for --auto with a video."""
        if self.auto:
            raise click.UsageError(
                f"--auto looks for the rim in pictures, and {source} is none; 'omnimirror rim' finds it in one of its "
                "frames, for --ball"
            )

    def camera(
        self, sources: tuple[str, ...], options: CameraOptions, orientation: OrientationOptions
    ) -> tuple[FoundCamera, str]:
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
        pictures = _alike(sources, orientation)
        rim = detect_mirror_outline(pictures)
        found = camera_from_rim(rim, name)
        found = replace(found, mount=options.standing(found.mount))
        stood = ""
        if isinstance(found, MirrorBall) and options.level is None:
            found, stood = _levelled(found, pictures[0])

        def camera_of(size: tuple[int, int]) -> Sensor | MirrorBall:
            if size != rim.image_size:
                raise InvalidParameter(
                    f"it has {size[0]} x {size[1]} px, and the rim was found in pictures of {rim.image_size[0]} x "
                    f"{rim.image_size[1]} px; straighten pictures of each size by themselves"
                )
            return found

        (u, v), among = rim.centre_px, "" if len(pictures) == 1 else f" in {len(pictures)} pictures"
        words = f" ({PRESETS[name].words})" if name in PRESETS else ""
        default = "" if self.mirror else "; name another with --mirror"
        told = (
            f"rim of {rim.radius_px:.1f} px about {u:.1f}, {v:.1f}{among}, confidence {rim.confidence:.2f}; "
            f"taken for {name}{words}{default}{_other_tilt(rim, name)}{stood}"
        )
        return camera_of, told


def _other_tilt(rim: MirrorOutline, mirror: str) -> str:
    """Return a warning if the outline of a known sensor implies a mirror tilted to either side."""
    from ...calibration.rim import PRESETS, sensors_from_rim
    from ...optics.sensor_files import load_sensor

    if mirror in PRESETS or len(found := sensors_from_rim(rim, load_sensor(mirror))) == 1:
        return ""
    taken, other = (
        f"{one.mirror_pose.tilt_x_deg:.1f}, {one.mirror_pose.tilt_y_deg:.1f}" for one in found
    )
    return f"; tilted by {taken} deg about x and y, or by {other}, which its rim does not tell"


def _levelled(ball: MirrorBall, picture: NDArray[np.uint8]) -> tuple[MirrorBall, str]:
    """Return the ball levelled from vertical edges of its image, if reliable, and a report."""
    from ...calibration.levelling import level_from_image

    looks = {"up": "up", "down": "down", "forward": "ahead"}[ball.mount.camera_looks]
    level = level_from_image(picture, ball, ball.mount, ball.centre_px, ball.rim_radius_px)
    if level is None or not level.is_reliable:
        return (
            ball,
            f"; the camera is taken to look {looks} and stand level (--camera-looks, --level)",
        )
    lean = f"{level.pitch_deg:.1f},{level.roll_deg:.1f} deg, by {level.upright} upright edges"
    told = f"; the camera is taken to look {looks} (--camera-looks), and leaned {lean}"
    return replace(ball, mount=level.on(ball.mount)), told


def _alike(sources: tuple[str, ...], orientation: OrientationOptions) -> list[NDArray[np.uint8]]:
    """Return those of the first images that have the size, and thus the outline, of the first."""
    from ...io import read_image
    from ...io.batch import expand_inputs

    is_stored = orientation.stored_orientation
    pictures = [
        read_image(file, stored_orientation=is_stored)
        for file in expand_inputs(sources)[:LOOKED_AT]
    ]
    return [picture for picture in pictures if picture.shape[:2] == pictures[0].shape[:2]]
