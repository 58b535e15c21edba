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
from ._declarations import Options, flag, option, refuse_inapplicable
from ._option_types import (
    IntegerRange,
    angle,
    angle_range,
    distance,
    factor,
    height,
    height_range,
    image_size,
    offset,
    viewpoint,
)

if TYPE_CHECKING:
    from ...optics.sensor_files import AnyCamera


# -- View ------------------------------------------------------------------------------------------

PLACE_OPTIONS = ("distance_mm", "offset_mm")
VIEW_OPTIONS: dict[str, tuple[str, ...]] = {
    "panorama": (
        "pan_deg",
        "span_deg",
        "elevation_deg",
        "omega_deg",
        "rows",
        "wall_mm",
        "zoom",
        *PLACE_OPTIONS,
    ),
    "perspective": ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg", "zoom", *PLACE_OPTIONS),
    "dome": ("pan_deg", "omega_deg", "pole", "zoom", *PLACE_OPTIONS),
    "sphere": ("pan_deg", "span_deg", "elevation_deg", "omega_deg", "zoom", *PLACE_OPTIONS),
    "ground": ("pan_deg", "height_mm", "mm_per_px", "zoom", "offset_mm"),
    "planet": ("pan_deg", "hfov_deg", "pole", "zoom", *PLACE_OPTIONS),
    "cube": ("pan_deg", "layout", *PLACE_OPTIONS),
    "mosaic": ("pan_deg", "tilt_deg", "hfov_deg", "elevation_deg", *PLACE_OPTIONS),
}
PRESET_OPTIONS = ("pan_deg", "tilt_deg", "zoom", *PLACE_OPTIONS)


@dataclass(frozen=True)
class ViewOptions(Options):
    """View, and its size."""

    view: str | None = option(
        type=click.Choice(list(views.VIEWS)), help="Type of view.  [default: panorama]"
    )
    preset: str | None = option(
        type=click.Choice(list(views.PRESETS)),
        help="Screen of the paper, 28, 90 or 180 deg wide, the last one curved; instead of --view.",
    )
    pan_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Azimuth of the view centre, right of forward; top of a round view.  [default: 0]",
    )
    tilt_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Elevation of the centre of a perspective view.  [default: 0]",
    )
    roll_deg: float | None = option(
        type=angle, metavar="DEG", help="Clockwise rotation of a perspective view.  [default: 0]"
    )
    hfov_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Horizontal field of a perspective or planet view.  [default: 90; the whole field for a planet]",
    )
    span_deg: float | None = option(
        type=angle, metavar="DEG", help="Width of a panorama.  [default: 360]"
    )
    elevation_deg: tuple[float, float] | None = option(
        type=angle_range,
        metavar="MIN:MAX",
        help="Elevation range of a panorama.  [default: the field of the camera; the full range for a sphere]",
    )
    omega_deg: tuple[float, float] | None = option(
        type=angle_range,
        metavar="MIN:MAX",
        help="Range of angles from the camera axis instead of elevations; for a dome, from its pole.",
    )
    rows: Rows | None = option(
        type=click.Choice(["tilt", "height"]),
        help="Rows of a panorama: linear in elevation, or in height on a vertical wall.  [default: tilt]",
    )
    wall_mm: tuple[float, float] | None = option(
        type=height_range,
        metavar="LOW:HIGH",
        help="Heights of a wall at --distance-mm above the mirror, for a panorama of the wall.",
    )
    distance_mm: float | None = option(
        type=distance,
        metavar="MM",
        help="Object distance at which the view is free of parallax.  [default: inf]",
    )
    offset_mm: tuple[float, float, float] | None = option(
        type=offset,
        metavar="X,Y,Z",
        help="Offset of the view centre from the mirror: forward, left and up.  [default: 0,0,0]",
    )
    viewpoint: Viewpoint | None = option(
        type=viewpoint,
        metavar="exact|single|MM",
        help="Viewpoint for near objects: exact reflection, or a single viewpoint on the axis.  [default: exact]",
    )
    height_mm: float | None = option(
        type=height, metavar="MM", help="Height of the mirror above the ground."
    )
    mm_per_px: float | None = option(
        type=distance,
        metavar="MM",
        help="Scale of a ground view.  [default: the resolution of the image]",
    )
    pole: Pole | None = option(
        type=click.Choice(["nadir", "zenith"]),
        help="Centre of a dome or planet view.  [default: the nearer pole]",
    )
    layout: Layout | None = option(
        type=click.Choice(list(LAYOUTS)), help="Layout of the faces of a cube.  [default: cross]"
    )
    zoom: float | None = option(
        type=factor, metavar="FACTOR", help="Magnification about the view centre.  [default: 1]"
    )
    allow_upsampling: bool | None = option(
        is_flag=True, help="Allow --zoom beyond the resolution of the camera."
    )
    size: PartialSize | None = option(
        type=image_size,
        metavar="WxH",
        help="Output size; 1440x, x360, or by default chosen from the resolution of the image.",
    )

    @property
    def is_near(self) -> bool:
        """True if the object distance is finite."""
        return self.distance_mm is not None and bool(np.isfinite(self.distance_mm))

    def check(self) -> None:
        """Raise UsageError for options that do not apply to the selected view or contradict each
        other.
        """
        if self.view and self.preset:
            raise click.UsageError("--preset and --view must not be given together")
        name = self.view or "panorama"
        chosen = f"--view {name}"
        owners = {f"--view {known}": names for known, names in VIEW_OPTIONS.items()} | {
            chosen: options_of(name)
        }
        if self.preset:
            chosen = "--preset"
            owners[chosen] = PRESET_OPTIONS
        refuse_inapplicable(self.given, owners, chosen)
        if self.elevation_deg and self.omega_deg:
            raise click.UsageError("--elevation-deg and --omega-deg must not be given together")
        if self.wall_mm:
            self._check_wall()
        if chosen == "--view ground" and self.height_mm is None:
            raise click.UsageError(
                "--view ground requires --height-mm, the height of the mirror above the ground"
            )
        if self.allow_upsampling and self.zoom is None:
            raise click.UsageError("--allow-upsampling requires --zoom")
        if self.viewpoint is not None and chosen != "--view ground" and not self.is_near:
            raise click.UsageError(
                "--viewpoint requires --distance-mm; it has no effect on a distant screen"
            )

    def _check_wall(self) -> None:
        if other := self.subset("elevation_deg", "omega_deg", "rows"):
            raise click.UsageError(
                f"--wall-mm and {flag(next(iter(other)))} must not be given together"
            )
        if not self.is_near:
            raise click.UsageError("--wall-mm requires --distance-mm, the distance of the wall")

    def of(self, camera: Camera) -> Shape:
        """Return the view of a camera; a limited zoom is reported on stderr."""
        view: Shape
        if self.preset:
            view = views.preset(
                self.preset, **self.subset("size", "pan_deg", "tilt_deg", *PLACE_OPTIONS)
            )
        else:
            name = self.view or "panorama"
            options = self.subset(
                "size", *(option for option in options_of(name) if option != "zoom")
            )
            view = _create_view(name, camera, options)
        return (
            view
            if self.zoom is None
            else _zoom(camera, view, self.zoom, bool(self.allow_upsampling))
        )


def options_of(view: str) -> tuple[str, ...]:
    """Return the options of a view; for a view of another package, those among its keyword
    arguments.
    """
    if view in VIEW_OPTIONS:
        return VIEW_OPTIONS[view]
    known = {f.name for f in fields(ViewOptions)} - {"view", "preset", "zoom"}
    return (*(name for name in signature(views.VIEWS[view]).parameters if name in known), "zoom")


def _create_view(name: str, camera: Camera, options: dict[str, Any]) -> Any:
    """Return the named view, with command-line options converted to its arguments."""
    if name in ("panorama", "sphere"):
        _elevations_of_omega(camera, options)
    if "wall_mm" in options:
        low, high = options.pop("wall_mm")
        if not low < high:
            raise click.UsageError(
                f"--wall-mm must be LOW:HIGH with LOW below HIGH; got {low:g}:{high:g}"
            )
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
        raise click.UsageError(
            "--omega-deg requires a camera that looks up or down for a panorama; use --elevation-deg"
        )
    low, high = sorted(up * (90 - omega) for omega in options.pop("omega_deg"))
    options["elevation_deg"] = (low, high)


def _zoom(camera: Camera, view: Shape, zoom: float, allow_upsampling: bool) -> Shape:
    maximum = views.max_zoom(camera, view)
    if zoom > maximum:
        magnification = zoom / views.resolution(camera, view)
        limited = (
            ""
            if allow_upsampling
            else f"; limited to {maximum:.3g}; use --allow-upsampling to remove the limit"
        )
        click.echo(
            f"omnimirror: zoom {zoom:g} exceeds the resolution of the sensor "
            f"({magnification:.1f} output pixels per source pixel){limited}",
            err=True,
        )
        zoom = zoom if allow_upsampling else maximum
    return view.zoomed(zoom)


# -- Resampling ------------------------------------------------------------------------------------


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

    interpolation: Interpolation = option(
        type=click.Choice(list(INTERPOLATIONS)),
        default="auto",
        help="Interpolation; auto: cubic, with averaging for minification; area: averaging everywhere.",
    )
    border: BorderColour | None = option(
        type=border,
        metavar="GREY|R,G,B|#rrggbb",
        help="Colour outside the field, in values of the image or as #rrggbb.  [default: see --transparent]",
    )
    threads: int | None = option(
        type=IntegerRange(1, MAX_THREADS),
        metavar="N",
        help="Number of dewarping threads.  [default: one per processor core]",
    )
