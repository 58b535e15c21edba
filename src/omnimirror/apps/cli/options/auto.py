"""Options for an uncalibrated camera: the outline of the mirror is detected in the images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import click
import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter
from ....cameras.models import MirrorBall
from .camera import OPTIONS_OF_SOURCE, CameraOptions
from .declared import Options, flag, option
from .orientation import OrientationOptions

if TYPE_CHECKING:
    from ....calibration.rim import FoundRim
    from ....optics.sensor import Sensor

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
        owned = {name: names for name, names in OPTIONS_OF_SOURCE.items() if camera.picked(name, *names)}
        if owned:
            given = next(iter(camera.picked(*(n for name, names in owned.items() for n in (name, *names)))))
            raise click.UsageError(f"--auto finds the camera, and {flag(given)} tells it; leave out one of them")

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
        from ....calibration.rim import DEFAULT, PRESETS, camera_from_rim, find_rim, mirror_of

        name = self.mirror or DEFAULT
        mirror_of(name)  # checked before the outline detection, which takes seconds
        pictures = _alike(sources, orientation)
        rim = find_rim(pictures)
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


def _other_tilt(rim: FoundRim, mirror: str) -> str:
    """Return a warning if the outline of a known sensor implies a mirror tilted to either side."""
    from ....calibration.rim import PRESETS, sensors_from_rim
    from ....optics.sensor_files import load_sensor

    if mirror in PRESETS or len(found := sensors_from_rim(rim, load_sensor(mirror))) == 1:
        return ""
    taken, other = (f"{one.mirror_pose.tilt_x_deg:.1f}, {one.mirror_pose.tilt_y_deg:.1f}" for one in found)
    return f"; tilted by {taken} deg about x and y, or by {other}, which its rim does not tell"


def _levelled(ball: MirrorBall, picture: NDArray[np.uint8]) -> tuple[MirrorBall, str]:
    """Return the ball levelled from vertical edges of its image, if reliable, and a report."""
    from ....calibration.lines import level_in

    looks = {"up": "up", "down": "down", "forward": "ahead"}[ball.mount.camera_looks]
    level = level_in(picture, ball, ball.mount, ball.centre_px, ball.rim_radius_px)
    if level is None or not level.is_sure:
        return ball, f"; the camera is taken to look {looks} and stand level (--camera-looks, --level)"
    lean = f"{level.pitch_deg:.1f},{level.roll_deg:.1f} deg, by {level.upright} upright edges"
    told = f"; the camera is taken to look {looks} (--camera-looks), and leaned {lean}"
    return replace(ball, mount=level.on(ball.mount)), told


def _alike(sources: tuple[str, ...], orientation: OrientationOptions) -> list[NDArray[np.uint8]]:
    """Return those of the first images that have the size, and thus the outline, of the first."""
    from ....io import read_image
    from ....io.batch import expand_inputs

    is_stored = orientation.stored_orientation
    pictures = [read_image(file, stored_orientation=is_stored) for file in expand_inputs(sources)[:LOOKED_AT]]
    return [picture for picture in pictures if picture.shape[:2] == pictures[0].shape[:2]]
