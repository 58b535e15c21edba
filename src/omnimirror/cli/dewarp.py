"""``omnimirror dewarp``: straighten a picture."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import click

from ..central import MirrorBall, OCam, load_ocam
from ..dewarp import Dewarper, views
from ..dewarp.sampling import INTERPOLATIONS
from ..dewarp.screens import Screen
from ..errors import InvalidParameter
from ..frames import Mount
from ..media.images import Image, format_of, read_image, write_image
from ..sensor import Sensor
from ..specs import load_sensor
from .options import angle, angle_range, ball, picture_size

MountedCamera = Sensor | OCam | MirrorBall

OPTIONS_OF_VIEW: dict[str, tuple[str, ...]] = {
    "panorama": ("pan_deg", "span_deg", "elevation_deg", "omega_deg"),
    "perspective": ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg"),
    "dome": ("pan_deg", "omega_deg"),
}
OPTIONS_OF_SOURCE: dict[str, tuple[str, ...]] = {"sensor": (), "ocam": ("optics", "rim_radius_px"), "ball": ()}


@click.command()
@click.argument("image", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), required=True, help="The picture to write.")
@click.option("--sensor", metavar="FILE|NAME", help="The camera: a sensor file, or a bundled sensor.")
@click.option("--ocam", metavar="FILE", help="The camera: OCamCalib's calib_results.txt.")
@click.option(
    "--ball",
    type=ball,
    metavar="CX,CY,R,FOV",
    help="The camera: a mirror ball, its circle in px and its full field in deg.",
)
@click.option("--optics", type=click.Choice(["mirror", "fisheye"]), help="What --ocam calibrated.  [default: mirror]")
@click.option("--rim-radius-px", type=float, metavar="PX", help="Where the field of --ocam ends.  [default: nowhere]")
@click.option("--view", type=click.Choice(list(OPTIONS_OF_VIEW)), default="panorama", show_default=True)
@click.option(
    "--pan-deg", type=angle, metavar="DEG", help="Centre of the view, right of forward; top of a dome.  [default: 0]"
)
@click.option(
    "--tilt-deg", type=angle, metavar="DEG", help="Centre of a perspective view, above the horizon.  [default: 0]"
)
@click.option("--roll-deg", type=angle, metavar="DEG", help="Turn a perspective view clockwise.  [default: 0]")
@click.option("--hfov-deg", type=angle, metavar="DEG", help="Width of a perspective view.  [default: 90]")
@click.option("--span-deg", type=angle, metavar="DEG", help="Width of a panorama.  [default: 360]")
@click.option(
    "--elevation-deg", type=angle_range, metavar="MIN:MAX", help="Height of a panorama.  [default: the camera's field]"
)
@click.option(
    "--omega-deg",
    type=angle_range,
    metavar="MIN:MAX",
    help="The same as angles from the axis of the camera; of a dome, from its pole.",
)
@click.option(
    "--size",
    type=picture_size,
    metavar="WxH",
    help="Output size; 1440x, x360 or nothing to choose by the picture's resolution.",
)
@click.option(
    "--camera-looks",
    type=click.Choice(["up", "down", "forward"]),
    help="Where the optical axis points.  [default: the sensor's, or up]",
)
@click.option(
    "--forward-azimuth-deg",
    type=angle,
    metavar="DEG",
    help="Image direction that is forward, from image right towards image bottom.  [default: the sensor's, or -90]",
)
@click.option("--image-flipped/--not-image-flipped", default=None, help="The picture was reversed left to right.")
@click.option("--interpolation", type=click.Choice(list(INTERPOLATIONS)), default="linear", show_default=True)
@click.option(
    "--transparent/--black",
    default=None,
    help="Outside the field.  [default: transparent where the file can: PNG, TIFF, WebP]",
)
def command(image: Path, output: Path, view: str, interpolation: Any, transparent: bool | None, **options: Any) -> None:
    """Straighten IMAGE, taken with a mirror sensor, a mirror ball or a fisheye.

    Say which camera it was with one of --sensor, --ocam and --ball. The result is drawn as seen from the
    camera's place: never reversed, forward in the middle of a panorama and at the top of a dome.
    """
    given = {name: value for name, value in options.items() if value is not None}
    source = _source(given)
    _refuse_other(given, OPTIONS_OF_VIEW, view, "--view {}")
    _refuse_other(given, OPTIONS_OF_SOURCE, source, "--{}")
    if "elevation_deg" in given and "omega_deg" in given:
        raise click.UsageError("--elevation-deg and --omega-deg say the same thing twice; give one of them")
    if output.resolve() == image.resolve():
        raise click.UsageError(f"{output} is the picture to straighten; write to another name")
    can_be_transparent = format_of(output).has_alpha
    if transparent and not can_be_transparent:
        raise click.UsageError(f"{output.suffix} files hold no transparency; write .png, .tif or .webp, or say --black")
    picture = read_image(image)
    camera = _mounted(_camera(source, given, picture), given)
    dewarp = Dewarper(camera, _screen(view, camera, given), interpolation)
    straight = dewarp(picture, can_be_transparent if transparent is None else transparent)
    write_image(output, straight)
    height, width = straight.shape[:2]
    click.echo(f"{output}: {dewarp.view}, {width} x {height} px, {_percent(dewarp)} of it inside the field")


def _source(given: dict[str, Any]) -> str:
    sources = [name for name in OPTIONS_OF_SOURCE if name in given]
    if len(sources) != 1:
        found = "none is given" if not sources else f"{' and '.join(map(_flag, sources))} are given"
        raise click.UsageError(f"say which camera it was with exactly one of --sensor, --ocam and --ball; {found}")
    return sources[0]


def _refuse_other(given: dict[str, Any], options_of: dict[str, tuple[str, ...]], chosen: str, flag: str) -> None:
    """Refuse options that belong to another view or source than the chosen one."""
    for name in given:
        owners = [owner for owner, names in options_of.items() if name in names]
        if owners and chosen not in owners:
            belongs = " and ".join(map(flag.format, owners))
            raise click.UsageError(f"{_flag(name)} does not apply to {flag.format(chosen)}; it belongs to {belongs}")


def _flag(name: str) -> str:
    return "--" + name.replace("_", "-")


def _camera(source: str, given: dict[str, Any], picture: Image) -> MountedCamera:
    if source == "sensor":
        return load_sensor(given["sensor"])
    if source == "ocam":
        return load_ocam(given["ocam"], given.get("optics", "mirror"), rim_radius_px=given.get("rim_radius_px"))
    u, v, radius, full_field = given["ball"]
    return MirrorBall((u, v), radius, full_field, (picture.shape[1], picture.shape[0]))


def _mounted(camera: MountedCamera, given: dict[str, Any]) -> MountedCamera:
    """The camera with what the mount options say instead of its own mount."""
    names = [f.name for f in fields(Mount)]
    return replace(camera, mount=replace(camera.mount, **{n: given[n] for n in names if n in given}))


def _screen(view: str, camera: MountedCamera, given: dict[str, Any]) -> Screen:
    options = {name: given[name] for name in ("size", *OPTIONS_OF_VIEW[view]) if name in given}
    if view == "perspective":
        return views.perspective(**options)
    if view == "dome":
        return views.dome(camera, **options)
    if "omega_deg" in options:
        options["elevation_deg"] = _elevations(camera, options.pop("omega_deg"))
    return views.panorama(camera, **options)


def _elevations(camera: MountedCamera, omega_deg: tuple[float, float]) -> tuple[float, float]:
    """Elevations (deg) of angles from the camera's axis, which must be vertical."""
    axis = camera.symmetry.axis if isinstance(camera, Sensor) else camera.axis
    if abs(axis[2]) < 0.5:
        raise InvalidParameter("--omega-deg makes no panorama for a camera that looks forward; use --elevation-deg")
    low, high = sorted(axis[2] * (90 - omega) for omega in omega_deg)
    return low, high


def _percent(dewarp: Dewarper) -> str:
    share = 100 * dewarp.valid.mean()
    return "all" if share == 100 else f"{share:.3g} %"
