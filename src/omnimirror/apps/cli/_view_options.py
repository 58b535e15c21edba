"""Options that specify a view and its resampling."""

from __future__ import annotations

from dataclasses import dataclass, fields
from inspect import signature
from typing import TYPE_CHECKING, Any, cast

import click
import numpy as np

from ...base.errors import InvalidParameter
from ...base.native import MAX_THREADS
from ...cameras.camera import Camera
from ...dewarp import views
from ...dewarp.interfaces import INTERPOLATIONS, Interpolation
from ...dewarp.request import BorderColour, without_tilt
from ...dewarp.screens import LAYOUTS, Layout, Pole, Rows, Shape
from ...dewarp.viewpoints import Viewpoint
from ...dewarp.views import PartialSize
from ._declarations import Options, flag, option, refuse_other
from ._option_types import WholeRange, angle, angle_range, distance, factor, height, height_range, offset, picture_size, viewpoint

if TYPE_CHECKING:
    from ...optics.sensor_files import AnyCamera


# -- Options that specify a view -------------------------------------------------------------------

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


@dataclass(frozen=True)
class ViewOptions(Options):
    """View, and its size."""

    view: str | None = option(type=click.Choice(list(views.VIEWS)), help="Type of view.  [default: panorama]")
    preset: str | None = option(type=click.Choice(list(views.PRESETS)), help="Screen of the paper, 28, 90 or 180 deg wide, the last one curved; instead of --view.")
    pan_deg: float | None = option(type=angle, metavar="DEG", help="Azimuth of the view centre, right of forward; top of a round view.  [default: 0]")
    tilt_deg: float | None = option(type=angle, metavar="DEG", help="Elevation of the centre of a perspective view.  [default: 0]")
    roll_deg: float | None = option(type=angle, metavar="DEG", help="Clockwise rotation of a perspective view.  [default: 0]")
    hfov_deg: float | None = option(type=angle, metavar="DEG", help="Horizontal field of a perspective or planet view.  [default: 90; the whole field for a planet]")
    span_deg: float | None = option(type=angle, metavar="DEG", help="Width of a panorama.  [default: 360]")
    elevation_deg: tuple[float, float] | None = option(type=angle_range, metavar="MIN:MAX", help="Elevation range of a panorama.  [default: the field of the camera; the full range for a sphere]")
    omega_deg: tuple[float, float] | None = option(type=angle_range, metavar="MIN:MAX", help="Range of angles from the camera axis instead of elevations; for a dome, from its pole.")
    rows: Rows | None = option(type=click.Choice(["tilt", "height"]), help="Rows of a panorama: linear in elevation, or in height on a vertical wall.  [default: tilt]")
    wall_mm: tuple[float, float] | None = option(type=height_range, metavar="LOW:HIGH", help="Heights of a wall at --distance-mm above the mirror, for a panorama of the wall.")
    distance_mm: float | None = option(type=distance, metavar="MM", help="Object distance at which the view is free of parallax.  [default: inf]")
    offset_mm: tuple[float, float, float] | None = option(type=offset, metavar="X,Y,Z", help="Offset of the view centre from the mirror: forward, left and up.  [default: 0,0,0]")
    viewpoint: Viewpoint | None = option(type=viewpoint, metavar="exact|single|MM", help="Viewpoint for near objects: exact reflection, or a single viewpoint on the axis.  [default: exact]")
    height_mm: float | None = option(type=height, metavar="MM", help="Height of the mirror above the ground.")
    mm_per_px: float | None = option(type=distance, metavar="MM", help="Scale of a ground view.  [default: the resolution of the image]")
    pole: Pole | None = option(type=click.Choice(["nadir", "zenith"]), help="Centre of a dome or planet view.  [default: the nearer pole]")
    layout: Layout | None = option(type=click.Choice(list(LAYOUTS)), help="Layout of the faces of a cube.  [default: cross]")
    zoom: float | None = option(type=factor, metavar="FACTOR", help="Magnification about the view centre.  [default: 1]")
    past_resolution: bool | None = option(is_flag=True, help="Allow --zoom beyond the resolution of the camera.")
    size: PartialSize | None = option(type=picture_size, metavar="WxH", help="Output size; 1440x, x360, or by default chosen from the resolution of the image.")

    @property
    def is_near(self) -> bool:
        """True if the object distance is finite."""
        return self.distance_mm is not None and bool(np.isfinite(self.distance_mm))

    def check(self) -> None:
        """Raise UsageError for options that do not apply to the selected view or contradict each
        other.
        """
        if self.view and self.preset:
            raise click.UsageError("--preset is a view of its own; leave out --view")
        name = self.view or "panorama"
        chosen = f"--view {name}"
        owners = {f"--view {known}": names for known, names in OPTIONS_OF_VIEW.items()} | {chosen: options_of(name)}
        if self.preset:
            chosen = "--preset"
            owners[chosen] = OPTIONS_OF_PRESET
        refuse_other(self.given, owners, chosen)
        if self.elevation_deg and self.omega_deg:
            raise click.UsageError("--elevation-deg and --omega-deg say the same thing twice; give one of them")
        if self.wall_mm:
            self._check_wall()
        if chosen == "--view ground" and self.height_mm is None:
            raise click.UsageError("--view ground needs --height-mm, the height of the mirror over the ground")
        if self.past_resolution and self.zoom is None:
            raise click.UsageError("--past-resolution says how far --zoom may go; give a --zoom")
        if self.viewpoint is not None and chosen != "--view ground" and not self.is_near:
            raise click.UsageError("--viewpoint makes no difference to a distant screen; give it a --distance-mm")

    def _check_wall(self) -> None:
        if other := self.picked("elevation_deg", "omega_deg", "rows"):
            raise click.UsageError(f"--wall-mm says what {flag(next(iter(other)))} says too; give one of them")
        if not self.is_near:
            raise click.UsageError("--wall-mm needs --distance-mm, the distance of the wall")

    def of(self, camera: Camera) -> Shape:
        """Return the view of a camera; a limited zoom is reported on stderr."""
        view: Shape
        if self.preset:
            view = views.preset(self.preset, **self.picked("size", "pan_deg", "tilt_deg", *PLACE))
        else:
            name = self.view or "panorama"
            options = self.picked("size", *(option for option in options_of(name) if option != "zoom"))
            view = _made(name, camera, options)
        return view if self.zoom is None else _zoomed(camera, view, self.zoom, bool(self.past_resolution))


def options_of(view: str) -> tuple[str, ...]:
    """Return the options of a view; for a view of another package, those among its keyword
    arguments.
    """
    if view in OPTIONS_OF_VIEW:
        return OPTIONS_OF_VIEW[view]
    known = {f.name for f in fields(ViewOptions)} - {"view", "preset", "zoom"}
    return (*(name for name in signature(views.VIEWS[view]).parameters if name in known), "zoom")


def _made(name: str, camera: Camera, options: dict[str, Any]) -> Any:
    """Return the named view, with command-line options converted to its arguments."""
    if name in ("panorama", "sphere"):
        _elevations_of_omega(camera, options)
    if "wall_mm" in options:
        low, high = options.pop("wall_mm")
        if not low < high:
            raise click.UsageError(f"heights from {low:g} to {high:g} mm make no wall; the smaller one comes first")
        elevations = np.degrees(np.arctan2([low, high], options["distance_mm"]))
        options |= {"rows": "height", "elevation_deg": tuple(map(float, elevations))}
    return views.VIEWS[name](camera, **options)


def _elevations_of_omega(camera: Camera, options: dict[str, Any]) -> None:
    """Convert angles from the camera axis to elevations (deg); the axis must be vertical, apart
    from tilt.
    """
    if "omega_deg" not in options:
        return
    up = without_tilt(cast("AnyCamera", camera)).axis[2]
    if abs(up) < 0.5:
        raise click.UsageError("--omega-deg makes no panorama for a camera that looks forward; use --elevation-deg")
    low, high = sorted(up * (90 - omega) for omega in options.pop("omega_deg"))
    options["elevation_deg"] = (low, high)


def _zoomed(camera: Camera, view: Shape, zoom: float, past_resolution: bool) -> Shape:
    most = views.max_zoom(camera, view)
    if zoom > most:
        magnification = zoom / views.resolution(camera, view)
        limited = "" if past_resolution else f"; it is limited to {most:.3g}, and --past-resolution lifts the limit"
        click.echo(f"omnimirror: zoom {zoom:g} goes past what the sensor resolves ({magnification:.1f} output pixels per source pixel){limited}", err=True)
        zoom = zoom if past_resolution else most
    return view.zoomed(zoom)


# -- Resampling options: interpolation, colour outside the field, and threads ----------------------


def border(text: str) -> BorderColour:
    """Parse a grey level, ``R,G,B``, or ``#rrggbb``.

    >>> border("16").values, border("255,128,0").values, border("#ff8000").values
    ((16.0,), (255.0, 128.0, 0.0), (255.0, 128.0, 0.0))
    """
    try:
        return BorderColour.of(text)
    except InvalidParameter as e:
        raise click.BadParameter(str(e)) from None


@dataclass(frozen=True)
class SamplingOptions(Options):
    """Resampling."""

    interpolation: Interpolation = option(type=click.Choice(list(INTERPOLATIONS)), default="auto", help="Interpolation; auto: cubic, with averaging for minification; area: averaging everywhere.")
    border: BorderColour | None = option(type=border, metavar="GREY|R,G,B|#rrggbb", help="Colour outside the field, in values of the image or as #rrggbb.  [default: see --transparent]")
    threads: int | None = option(type=WholeRange(1, MAX_THREADS), metavar="N", help="Number of dewarping threads.  [default: one per processor core]")
