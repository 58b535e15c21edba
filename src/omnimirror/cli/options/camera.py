"""The cameras that can be named on the command line, and the options that describe them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import click

from ...central import MirrorBall, OCam, load_ocam
from ...dewarp.camera_field import Array
from ...frames import Mount
from ...sensor import Sensor
from ...specs import load_sensor
from .common import NUMBER, angle, ball, flag, lean, refuse_other

Command = TypeVar("Command", bound=Callable[..., Any])
MountedCamera: TypeAlias = Sensor | OCam | MirrorBall

OPTIONS_OF_SOURCE: dict[str, tuple[str, ...]] = {"sensor": (), "ocam": ("optics", "rim_radius_px"), "ball": ()}

_OPTIONS = (
    click.option("--sensor", metavar="FILE|NAME", help="The camera: a sensor file, or a bundled sensor."),
    click.option("--ocam", metavar="FILE", help="The camera: OCamCalib's calib_results.txt."),
    click.option(
        "--ball",
        type=ball,
        metavar="CX,CY,R,FOV",
        help="The camera: a mirror ball, its circle in px and its full field in deg.",
    ),
    click.option(
        "--optics", type=click.Choice(["mirror", "fisheye"]), help="What --ocam calibrated.  [default: mirror]"
    ),
    click.option(
        "--rim-radius-px", type=NUMBER, metavar="PX", help="Where the field of --ocam ends.  [default: nowhere]"
    ),
    click.option(
        "--camera-looks",
        type=click.Choice(["up", "down", "forward"]),
        help="Where the optical axis points.  [default: the sensor's, or up]",
    ),
    click.option(
        "--forward-azimuth-deg",
        type=angle,
        metavar="DEG",
        help="Image direction that is forward, from image right towards image bottom.  [default: the sensor's, or -90]",
    ),
    click.option("--image-flipped/--not-image-flipped", default=None, help="The picture was reversed left to right."),
    click.option(
        "--level",
        type=lean,
        metavar="PITCH,ROLL",
        help="Level the view: the sensor leaned, its forward PITCH deg above the horizon, and ROLL deg clockwise.  "
        "[default: the sensor's, or 0,0]",
    ),
    click.option(
        "--keep-lean",
        is_flag=True,
        default=None,
        help="Draw the view as the sensor leans, not level; a panorama says by how much, for viewers to level it.",
    ),
)


def camera_options(command: Command) -> Command:
    """Give a click command all options that describe a camera and how it stands."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def check_camera_options(given: dict[str, Any]) -> None:
    """Refuse options that name no camera or several, or that belong to another kind of camera."""
    sources = [name for name in OPTIONS_OF_SOURCE if name in given]
    if len(sources) != 1:
        found = "none is given" if not sources else f"{' and '.join(map(flag, sources))} are given"
        raise click.UsageError(f"say which camera it was with exactly one of --sensor, --ocam and --ball; {found}")
    refuse_other(given, {flag(name): names for name, names in OPTIONS_OF_SOURCE.items()}, flag(sources[0]))


def camera_of(given: dict[str, Any], picture_size: tuple[int, int]) -> MountedCamera:
    """The camera that the options describe, standing as they say; a ball is seen in a picture of that size."""
    camera: MountedCamera
    if "sensor" in given:
        camera = load_sensor(given["sensor"])
    elif "ocam" in given:
        camera = load_ocam(given["ocam"], given.get("optics", "mirror"), rim_radius_px=given.get("rim_radius_px"))
    else:
        u, v, radius, full_field = given["ball"]
        camera = MirrorBall((u, v), radius, full_field, picture_size)
    stands = {f.name: given[f.name] for f in fields(Mount) if f.name in given}
    if "level" in given:
        stands |= dict(zip(("pitch_deg", "roll_deg"), given["level"], strict=True))
    return replace(camera, mount=replace(camera.mount, **stands))


def drawn_by(camera: MountedCamera, given: dict[str, Any]) -> MountedCamera:
    """The camera that draws the view: plumb, however it really leans, where the options keep the lean."""
    return replace(camera, mount=camera.mount.upright) if "keep_lean" in given else camera


def camera_words(given: dict[str, Any]) -> tuple[str, tuple[str, ...]]:
    """A name for the camera that the options describe, and these options as they stand on a command line."""
    kind = next(name for name in OPTIONS_OF_SOURCE if name in given)
    value = given[kind]
    text = ",".join(f"{x:.10g}" for x in value) if kind == "ball" else str(value)
    words = [flag(kind), text]
    for name in (*OPTIONS_OF_SOURCE[kind], "camera_looks", "forward_azimuth_deg"):
        if name in given:
            words += [flag(name), str(given[name])]
    if "image_flipped" in given:
        words.append("--image-flipped" if given["image_flipped"] else "--not-image-flipped")
    if "level" in given:
        words.append("--level={:.10g},{:.10g}".format(*given["level"]))
    if "keep_lean" in given:
        words.append("--keep-lean")
    return "mirror ball" if kind == "ball" else Path(text).name, tuple(words)


def axis_of(camera: MountedCamera) -> Array:
    """World direction (3,) that the centre of the picture sees."""
    return camera.axis
