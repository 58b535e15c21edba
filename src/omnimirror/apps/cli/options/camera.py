"""Options that specify a camera and its mounting."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Literal, TypeAlias

import click

from ....cameras.frames import CameraLooks, Mount
from ....cameras.models import MirrorBall, load_ocam
from ....cameras.models.base import Optics
from .common import NUMBER, SENSOR, angle, ball, lean
from .declared import Options, flag, option, refuse_other

if TYPE_CHECKING:
    from ....optics.sensor_files import AnyCamera

Source: TypeAlias = Literal["sensor", "ocam", "ball"]

OPTIONS_OF_SOURCE: dict[Source, tuple[str, ...]] = {"sensor": (), "ocam": ("optics", "rim_radius_px"), "ball": ()}


@dataclass(frozen=True)
class CameraOptions(Options):
    """Camera model, with its mounting."""

    sensor: str | None = option(
        type=SENSOR, metavar="FILE|NAME", help="Camera: a sensor file, a camera file, or the name of a bundled sensor."
    )
    ocam: str | None = option(metavar="FILE", help="Camera: calib_results.txt of OCamCalib.")
    ball: tuple[float, float, float, float] | None = option(
        type=ball, metavar="CX,CY,R,FOV",
        help="Camera: a mirror ball, with its circle in px and its full field in deg. The optical axis is assumed "
        "to point up; for a ball photographed horizontally, add --camera-looks forward.",
    )  # fmt: skip
    optics: Optics | None = option(
        type=click.Choice(["mirror", "fisheye"]), help="Type of optics of the --ocam camera.  [default: mirror]"
    )
    rim_radius_px: float | None = option(
        type=NUMBER, metavar="PX", help="Radius of the field of --ocam in the image.  [default: unlimited]"
    )
    camera_looks: CameraLooks | None = option(
        type=click.Choice(["up", "down", "forward"]),
        help="Orientation of the optical axis.  [default: as in the sensor file, or up, also for --ball; forward "
        "for --auto with --mirror ball or convex]",
    )
    forward_azimuth_deg: float | None = option(
        type=angle, metavar="DEG",
        help="Image direction of forward, from image right towards image bottom.  [default: as in the sensor file, "
        "or -90]",
    )  # fmt: skip
    image_flipped: bool | None = option(
        "--image-flipped/--not-image-flipped", help="Declare that the image is mirrored left to right."
    )
    level: tuple[float, float] | None = option(
        type=lean, metavar="PITCH,ROLL",
        help="Level the view of a tilted sensor: its forward direction is PITCH deg above the horizon, and it is "
        "rolled ROLL deg clockwise.  [default: as in the sensor file, or 0,0]",
    )  # fmt: skip
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
            found = "none is given" if not sources else f"{' and '.join(map(flag, sources))} are given"
            raise click.UsageError(f"say which camera it was with exactly one of --sensor, --ocam and --ball; {found}")
        refuse_other(self.given, {flag(name): names for name, names in OPTIONS_OF_SOURCE.items()}, flag(sources[0]))

    def camera(self, picture_size: tuple[int, int]) -> AnyCamera:
        """Return the camera with the mounting of the options; for a ball, in images of size (width,
        height).
        """
        camera: AnyCamera
        if self.sensor is not None:
            from ....optics.sensor_files import load_camera  # not required for a ball

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
