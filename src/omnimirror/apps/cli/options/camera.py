"""The cameras that can be named on the command line, and the options that describe them."""

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
    """Which camera it was, and how it stands."""

    sensor: str | None = option(
        type=SENSOR, metavar="FILE|NAME", help="The camera: a sensor file, a camera file, or a bundled sensor."
    )
    ocam: str | None = option(metavar="FILE", help="The camera: OCamCalib's calib_results.txt.")
    ball: tuple[float, float, float, float] | None = option(
        type=ball, metavar="CX,CY,R,FOV",
        help="The camera: a mirror ball, its circle in px and its full field in deg. The optical axis is assumed to "
        "point up; for a ball photographed horizontally, add --camera-looks forward.",
    )  # fmt: skip
    optics: Optics | None = option(
        type=click.Choice(["mirror", "fisheye"]), help="What --ocam calibrated.  [default: mirror]"
    )
    rim_radius_px: float | None = option(
        type=NUMBER, metavar="PX", help="Where the field of --ocam ends.  [default: nowhere]"
    )
    camera_looks: CameraLooks | None = option(
        type=click.Choice(["up", "down", "forward"]),
        help="Where the optical axis points.  [default: the sensor's, or up, also for --ball; forward for --auto with "
        "--mirror ball or convex]",
    )
    forward_azimuth_deg: float | None = option(
        type=angle, metavar="DEG",
        help="Image direction that is forward, from image right towards image bottom.  [default: the sensor's, or -90]",
    )  # fmt: skip
    image_flipped: bool | None = option(
        "--image-flipped/--not-image-flipped", help="The picture was reversed left to right."
    )
    level: tuple[float, float] | None = option(
        type=lean, metavar="PITCH,ROLL",
        help="Level the view: the sensor leaned, its forward PITCH deg above the horizon, and ROLL deg clockwise.  "
        "[default: the sensor's, or 0,0]",
    )  # fmt: skip
    keep_lean: bool | None = option(
        is_flag=True,
        help="Draw the view as the sensor leans, not level; a panorama says by how much, for viewers to level it.",
    )

    def check(self) -> None:
        """Refuse options that name no camera or several, or that belong to another kind of camera."""
        sources = [name for name in OPTIONS_OF_SOURCE if name in self.given]
        if len(sources) != 1:
            found = "none is given" if not sources else f"{' and '.join(map(flag, sources))} are given"
            raise click.UsageError(f"say which camera it was with exactly one of --sensor, --ocam and --ball; {found}")
        refuse_other(self.given, {flag(name): names for name, names in OPTIONS_OF_SOURCE.items()}, flag(sources[0]))

    def camera(self, picture_size: tuple[int, int]) -> AnyCamera:
        """The camera, standing as the options say; a ball is seen in a picture of that size (width, height)."""
        camera: AnyCamera
        if self.sensor is not None:
            from ....optics.sensor_files import load_camera  # which a mirror ball need not wait for

            camera = load_camera(self.sensor)
        elif self.ocam is not None:
            camera = load_ocam(self.ocam, self.optics or "mirror", rim_radius_px=self.rim_radius_px)
        elif self.ball is not None:
            u, v, radius, full_field = self.ball
            camera = MirrorBall((u, v), radius, full_field, picture_size)
        return replace(camera, mount=self.standing(camera.mount))

    def standing(self, mount: Mount) -> Mount:
        """How a camera stands, of which a mount tells what the options do not."""
        stands = {f.name: self.given[f.name] for f in fields(Mount) if f.name in self.given}
        if self.level is not None:
            stands |= dict(zip(("pitch_deg", "roll_deg"), self.level, strict=True))
        return replace(mount, **stands)

    def drawing(self, camera: AnyCamera) -> AnyCamera:
        """The camera that draws the view: plumb, however it really leans, where the options keep the lean."""
        return replace(camera, mount=camera.mount.upright) if self.keep_lean else camera

    def words(self) -> tuple[str, tuple[str, ...]]:
        """A name for the camera, and these options as they stand on a command line."""
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
