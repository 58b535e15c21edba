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
from ...dewarp.screens import Layout, Pole, Rows, Shape
from ...dewarp.view_geometry import Viewpoint
from ...dewarp.views import PartialSize
from ._declarations import (
    IntegerRange,
    Options,
    angle,
    angle_range,
    distance,
    factor,
    flag,
    height,
    height_range,
    image_size,
    offset,
    option,
    refuse_inapplicable,
    setting,
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
    **dict.fromkeys(views.PRESETS, ("pan_deg", "tilt_deg", "zoom", *PLACE_OPTIONS)),
}


@dataclass(frozen=True)
class ViewOptions(Options):
    """View."""

    view: str | None = option(
        type=click.Choice([*views.VIEWS, *views.PRESETS]),
        metavar="NAME",
        help=f"View: {', '.join(views.VIEWS)}; of the paper: "
        f"{', '.join(views.PRESETS)}.  [default: panorama]",
    )
    pan_deg: float | None = option(
        type=angle, metavar="DEG", help="Azimuth of the centre, right of forward.  [default: 0]"
    )
    tilt_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Elevation of the centre of a perspective view.  [default: 0]",
    )
    hfov_deg: float | None = option(
        type=angle,
        metavar="DEG",
        help="Horizontal field, perspective or planet.  [default: 90; planet: all]",
    )
    elevation_deg: tuple[float, float] | None = option(
        type=angle_range,
        metavar="MIN:MAX",
        help="Elevations of a panorama.  [default: the field of the camera]",
    )
    distance_mm: float | None = option(
        type=distance, metavar="MM", help="Object distance without parallax.  [default: inf]"
    )
    size: PartialSize | None = option(
        type=image_size,
        metavar="WxH",
        help="Output size, also 1440x or x360.  [default: resolution of the image]",
    )
    roll_deg: float | None = setting("view", type=angle)
    span_deg: float | None = setting("view", type=angle)
    omega_deg: tuple[float, float] | None = setting("view", type=angle_range)
    rows: Rows | None = setting("view")
    wall_mm: tuple[float, float] | None = setting("view", type=height_range)
    offset_mm: tuple[float, float, float] | None = setting("view", type=offset)
    viewpoint: Viewpoint | None = setting("view", type=viewpoint)
    height_mm: float | None = setting("view", type=height)
    mm_per_px: float | None = setting("view", type=distance)
    pole: Pole | None = setting("view")
    layout: Layout | None = setting("view")
    zoom: float | None = setting("view", type=factor)
    allow_upsampling: bool | None = setting("view")

    @property
    def name(self) -> str:
        """Name of the view or preset."""
        return self.view or "panorama"

    @property
    def is_near(self) -> bool:
        """True if the object distance is finite."""
        return self.distance_mm is not None and bool(np.isfinite(self.distance_mm))

    def check(self) -> None:
        """Raise UsageError for options that do not apply to the selected view or contradict each
        other.
        """
        chosen = f"--view {self.name}"
        owners = {f"--view {view}": names for view, names in VIEW_OPTIONS.items()} | {
            chosen: options_of(self.name)
        }
        refuse_inapplicable(self.given, owners, chosen)
        if self.elevation_deg and self.omega_deg:
            raise click.UsageError(
                "--elevation-deg and --set view.omega_deg must not be given together"
            )
        if self.wall_mm:
            self._check_wall()
        if chosen == "--view ground" and self.height_mm is None:
            raise click.UsageError(
                "--view ground requires --set view.height_mm=MM, the height of the mirror above "
                "the ground"
            )
        if self.allow_upsampling and self.zoom is None:
            raise click.UsageError("--set view.allow_upsampling requires --set view.zoom")
        if self.viewpoint is not None and chosen != "--view ground" and not self.is_near:
            raise click.UsageError(
                "--set view.viewpoint requires --distance-mm; it has no effect on a distant screen"
            )

    def _check_wall(self) -> None:
        if other := self.subset("elevation_deg", "omega_deg", "rows"):
            raise click.UsageError(
                f"--set view.wall_mm and {flag(next(iter(other)))} must not be given together"
            )
        if not self.is_near:
            raise click.UsageError(
                "--set view.wall_mm requires --distance-mm, the distance of the wall"
            )

    def of(self, camera: Camera) -> Shape:
        """Return the view of a camera; a limited zoom is reported on stderr."""
        view: Shape
        options = self.subset(
            "size", *(option for option in options_of(self.name) if option != "zoom")
        )
        if self.name in views.PRESETS:
            view = views.preset(self.name, **options)
        else:
            view = _create_view(self.name, camera, options)
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
    option_names = {f.name for f in fields(ViewOptions)} - {"view", "zoom"}
    return (
        *(name for name in signature(views.VIEWS[view]).parameters if name in option_names),
        "zoom",
    )


def _create_view(name: str, camera: Camera, options: dict[str, Any]) -> Any:
    """Return the named view, with command-line options converted to its arguments."""
    if name in ("panorama", "sphere"):
        _elevations_of_omega(camera, options)
    if "wall_mm" in options:
        low, high = options.pop("wall_mm")
        if not low < high:
            raise click.UsageError(
                f"view.wall_mm must be LOW:HIGH with LOW below HIGH; got {low:g}:{high:g}"
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
            "--set view.omega_deg requires a camera that looks up or down for a panorama; use "
            "--elevation-deg"
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
            else f"; limited to {maximum:.3g}; use --set view.allow_upsampling=true to remove the limit"
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
        metavar="NAME",
        help=f"Interpolation: {', '.join(INTERPOLATIONS)}.",
    )
    border: BorderColour | None = option(
        type=border,
        metavar="COLOUR",
        help="Colour outside the field: a grey level, R,G,B or #rrggbb.",
    )
    threads: int | None = setting("resampling", type=IntegerRange(1, MAX_THREADS))
