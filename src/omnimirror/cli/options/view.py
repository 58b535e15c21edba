"""The views that can be asked for on the command line, and the options that describe them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

import click
import numpy as np

from ...dewarp import views
from ...dewarp.screens import LAYOUTS, Shape
from ...errors import InvalidParameter
from .camera import MountedCamera, axis_of
from .common import (
    angle,
    angle_range,
    distance,
    factor,
    flag,
    height,
    height_range,
    offset,
    picture_size,
    refuse_other,
    viewpoint,
)

Command = TypeVar("Command", bound=Callable[..., Any])

PLACE = ("distance_mm", "offset_mm")
OPTIONS_OF_VIEW: dict[str, tuple[str, ...]] = {
    "panorama": ("pan_deg", "span_deg", "elevation_deg", "omega_deg", "rows", "wall_mm", "zoom", *PLACE),
    "perspective": ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg", "zoom", *PLACE),
    "dome": ("pan_deg", "omega_deg", "pole", "zoom", *PLACE),
    "sphere": ("pan_deg", "span_deg", "elevation_deg", "omega_deg", "zoom", *PLACE),
    "ground": ("pan_deg", "height_mm", "mm_per_px", "zoom", "offset_mm"),
    "planet": ("pan_deg", "hfov_deg", "pole", "zoom", *PLACE),
    "cube": ("pan_deg", "layout", *PLACE),
    "mosaic": ("pan_deg", "tilt_deg", "hfov_deg", "elevation_deg", *PLACE),
}
OPTIONS_OF_PRESET = ("pan_deg", "tilt_deg", "zoom", *PLACE)

_OPTIONS = (
    click.option("--view", type=click.Choice(list(OPTIONS_OF_VIEW)), help="What to show.  [default: panorama]"),
    click.option(
        "--preset",
        type=click.Choice(list(views.PRESETS)),
        help="Instead of --view: the paper's screen 28, 90 or 180 deg wide, the last one bent.",
    ),
    click.option(
        "--pan-deg",
        type=angle,
        metavar="DEG",
        help="Centre of the view, right of forward; top of a round one.  [default: 0]",
    ),
    click.option(
        "--tilt-deg", type=angle, metavar="DEG", help="Centre of a perspective view, above the horizon.  [default: 0]"
    ),
    click.option("--roll-deg", type=angle, metavar="DEG", help="Turn a perspective view clockwise.  [default: 0]"),
    click.option(
        "--hfov-deg",
        type=angle,
        metavar="DEG",
        help="Width of a perspective view, or of a planet.  [default: 90; of a planet, the field]",
    ),
    click.option("--span-deg", type=angle, metavar="DEG", help="Width of a panorama.  [default: 360]"),
    click.option(
        "--elevation-deg",
        type=angle_range,
        metavar="MIN:MAX",
        help="Height of a panorama.  [default: the camera's field; of a sphere, all]",
    ),
    click.option(
        "--omega-deg",
        type=angle_range,
        metavar="MIN:MAX",
        help="The same as angles from the axis of the camera; of a dome, from its pole.",
    ),
    click.option(
        "--rows",
        type=click.Choice(["tilt", "height"]),
        help="Rows of a panorama: linear in elevation, or in height on an upright wall.  [default: tilt]",
    ),
    click.option(
        "--wall-mm",
        type=height_range,
        metavar="LOW:HIGH",
        help="A panorama of the wall at --distance-mm between two heights over the mirror.",
    ),
    click.option(
        "--distance-mm",
        type=distance,
        metavar="MM",
        help="How far the screen stands from its centre: where things are seen without parallax.  [default: inf]",
    ),
    click.option(
        "--offset-mm",
        type=offset,
        metavar="X,Y,Z",
        help="Move the screen forward, left and up from the mirror.  [default: 0,0,0]",
    ),
    click.option(
        "--viewpoint",
        type=viewpoint,
        metavar="exact|single|MM",
        help="See near screens by the true reflection, or from one viewpoint on the axis.  [default: exact]",
    ),
    click.option("--height-mm", type=height, metavar="MM", help="How high the mirror stands over the ground."),
    click.option(
        "--mm-per-px", type=distance, metavar="MM", help="Scale of the ground.  [default: the picture's resolution]"
    ),
    click.option(
        "--pole", type=click.Choice(["nadir", "zenith"]), help="Middle of a dome or planet.  [default: nearer]"
    ),
    click.option("--layout", type=click.Choice(list(LAYOUTS)), help="Faces of a cube.  [default: cross]"),
    click.option("--zoom", type=factor, metavar="FACTOR", help="Enlarge the view about its middle.  [default: 1]"),
    click.option("--past-resolution", is_flag=True, default=None, help="Let --zoom go past what the camera resolves."),
    click.option(
        "--size",
        type=picture_size,
        metavar="WxH",
        help="Output size; 1440x, x360 or nothing to choose by the picture's resolution.",
    ),
)


def view_options(command: Command) -> Command:
    """Give a click command all options that describe a view."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


def check_view_options(given: dict[str, Any]) -> None:
    """Refuse options that do not apply to the view asked for, or that contradict each other."""
    if "view" in given and "preset" in given:
        raise click.UsageError("--preset is a view of its own; leave out --view")
    owners = {f"--view {name}": names for name, names in OPTIONS_OF_VIEW.items()}
    chosen = f"--view {given.get('view', 'panorama')}"
    if "preset" in given:
        chosen = "--preset"
        owners[chosen] = OPTIONS_OF_PRESET
    refuse_other(given, owners, chosen)
    if "elevation_deg" in given and "omega_deg" in given:
        raise click.UsageError("--elevation-deg and --omega-deg say the same thing twice; give one of them")
    if "wall_mm" in given:
        _check_wall(given)
    if chosen == "--view ground" and "height_mm" not in given:
        raise click.UsageError("--view ground needs --height-mm, the height of the mirror over the ground")
    if "past_resolution" in given and "zoom" not in given:
        raise click.UsageError("--past-resolution says how far --zoom may go; give a --zoom")
    if "viewpoint" in given and chosen != "--view ground" and np.isinf(given.get("distance_mm", np.inf)):
        raise click.UsageError("--viewpoint makes no difference to a distant screen; give it a --distance-mm")


def _check_wall(given: dict[str, Any]) -> None:
    other = [flag(name) for name in ("elevation_deg", "omega_deg", "rows") if name in given]
    if other:
        raise click.UsageError(f"--wall-mm says what {other[0]} says too; give one of them")
    if np.isinf(given.get("distance_mm", np.inf)):
        raise click.UsageError("--wall-mm needs --distance-mm, the distance of the wall")


def view_of(camera: MountedCamera, given: dict[str, Any]) -> Shape:
    """The view that the options describe; one sentence on stderr where its zoom is not as asked."""
    options = {name: given[name] for name in ("size", "pan_deg", "tilt_deg", *PLACE) if name in given}
    view: Shape
    if "preset" in given:
        view = views.preset(given["preset"], **options)
    else:
        name = given.get("view", "panorama")
        options = {option: given[option] for option in ("size", *OPTIONS_OF_VIEW[name]) if option in given}
        options.pop("zoom", None)
        view = _MAKERS[name](camera, options)
    return _zoomed(camera, view, given["zoom"], "past_resolution" in given) if "zoom" in given else view


def _panorama(camera: MountedCamera, options: dict[str, Any]) -> Shape:
    _elevations_of_omega(camera, options)
    if "wall_mm" in options:
        low, high = options.pop("wall_mm")
        if not low < high:
            raise InvalidParameter(f"heights from {low:g} to {high:g} mm make no wall; the smaller one comes first")
        elevations = np.degrees(np.arctan2([low, high], options["distance_mm"]))
        options |= {"rows": "height", "elevation_deg": tuple(map(float, elevations))}
    return views.panorama(camera, **options)


def _sphere(camera: MountedCamera, options: dict[str, Any]) -> Shape:
    _elevations_of_omega(camera, options)
    return views.sphere(camera, **options)


def _ground(camera: MountedCamera, options: dict[str, Any]) -> Shape:
    if "mm_per_px" in options:
        options["mm_per_pixel"] = options.pop("mm_per_px")
    return views.ground(camera, **options)


_MAKERS: dict[str, Callable[[MountedCamera, dict[str, Any]], Shape]] = {
    "panorama": _panorama,
    "perspective": lambda _, options: views.perspective(**options),
    "dome": lambda camera, options: views.dome(camera, **options),
    "sphere": _sphere,
    "ground": _ground,
    "planet": lambda camera, options: views.planet(camera, **options),
    "cube": lambda camera, options: views.cube(camera, **options),
    "mosaic": lambda camera, options: views.mosaic(camera, **options),
}


def _elevations_of_omega(camera: MountedCamera, options: dict[str, Any]) -> None:
    """Put elevations (deg) in the place of angles from the camera's axis, which must be upright but for its lean."""
    if "omega_deg" not in options:
        return
    up = axis_of(replace(camera, mount=camera.mount.upright))[2]
    if abs(up) < 0.5:
        raise InvalidParameter("--omega-deg makes no panorama for a camera that looks forward; use --elevation-deg")
    low, high = sorted(up * (90 - omega) for omega in options.pop("omega_deg"))
    options["elevation_deg"] = (low, high)


def _zoomed(camera: MountedCamera, view: Shape, zoom: float, past_resolution: bool) -> Shape:
    most = views.largest_zoom(camera, view)
    if zoom > most:
        magnification = zoom / views.resolution(camera, view)
        limited = "" if past_resolution else f"; it is limited to {most:.3g}, and --past-resolution lifts the limit"
        click.echo(
            f"omnimirror: zoom {zoom:g} goes past what the sensor resolves "
            f"({magnification:.1f} output pixels per source pixel){limited}",
            err=True,
        )
        zoom = zoom if past_resolution else most
    return view.zoomed(zoom)
