"""Default views for a camera: they cover its field at the resolution of its image."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..base.arguments import InvalidType, format_value, number, validate_arguments
from ..base.errors import InvalidParameter
from ..base.registry import Registry
from ..cameras.camera import Camera
from ._source_coordinates import rows_of_pixels
from .screens import (
    CubeMap,
    Cylinder,
    DomeMaster,
    Equirectangular,
    Ground,
    Layout,
    LittlePlanet,
    Mosaic,
    Plane,
    Pole,
    Rows,
    Screen,
    View,
    parts_of,
)
from .screens._projections import NO_OFFSET, Offset
from .view_geometry import FieldOfView, field_of, pole_of

__all__ = [
    "MAX_MAGNIFICATION",
    "PRESETS",
    "VIEWS",
    "Preset",
    "cube",
    "dome",
    "ground",
    "max_zoom",
    "mosaic",
    "panorama",
    "perspective",
    "planet",
    "preset",
    "register_view",
    "resolution",
    "sphere",
]


# -- Resolution, size and maximum zoom -------------------------------------------------------------

PartialSize = tuple[int | None, int | None]


UNKNOWN_SIZE: PartialSize = (None, None)


MAX_MAGNIFICATION = 4.0
"""Maximum magnification in output pixels per source pixel: cubic interpolation is still smooth,
without additional detail above about 1.
"""


SAMPLED_ROWS = 65


MAX_ASPECT_RATIO = 1e6  # maximum aspect of an image


@validate_arguments
def resolution(camera: Camera, view: View) -> float:
    """Return the number of source pixels per output pixel (linear) at the visible pixel nearest to
    the centre.

    For several views in one image, the coarsest resolution is returned. NaN if none is visible, or
    has fewer than 2 x 2 pixels.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        Screen of :mod:`omnimirror.screens`, or several screens in one image.

    Returns
    -------
    float
        Source pixels per output pixel.

    Examples
    --------
    >>> import omnimirror as om
    >>> view = om.views.perspective(hfov_deg=40.0)
    >>> print(f"{om.views.resolution(om.load_sensor('paper-spherical'), view):.3f}")
    0.154
    """
    resolutions = [screen_resolution(camera, part.screen) for part in parts_of(view)]
    return float(min((r for r in resolutions if np.isfinite(r)), default=np.nan))


@validate_arguments
def max_zoom(camera: Camera, view: View) -> float:
    """Return the maximum zoom factor within the resolution of the camera, at least 1.

    At this zoom, :data:`MAX_MAGNIFICATION` output pixels correspond to one source pixel;
    infinite if the resolution is unknown.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        Screen of :mod:`omnimirror.screens`, or several screens in one image.

    Returns
    -------
    float
        Factor of at least 1.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> print(f"{om.views.max_zoom(camera, om.views.perspective(hfov_deg=120.0)):.2f}")
    2.94
    """
    maximum = MAX_MAGNIFICATION * resolution(camera, view)
    return max(1.0, maximum) if np.isfinite(maximum) else np.inf


def screen_resolution(camera: Camera, screen: Screen) -> float:
    width, height = screen.size
    if width < 2 or height < 2:
        return np.nan
    middle = (height - 2) / 2
    rows = np.unique(np.linspace(0, height - 2, min(height - 1, SAMPLED_ROWS)).round().astype(int))
    nearest, resolution_at_middle = np.inf, np.nan
    for row in map(int, rows[np.argsort(abs(rows - middle), kind="stable")]):
        if abs(row - middle) >= nearest:
            break
        pixels = rows_of_pixels(camera, screen, row, row + 2)
        across, down = np.diff(pixels[0], axis=0), (pixels[1] - pixels[0])[:-1]
        area = abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
        distances = np.where(
            np.isnan(area), np.inf, np.hypot(np.arange(width - 1) - (width - 2) / 2, row - middle)
        )
        nearest_column = int(np.argmin(distances))
        if distances[nearest_column] < nearest:
            nearest, resolution_at_middle = (
                float(distances[nearest_column]),
                float(np.sqrt(area[nearest_column])),
            )
    return resolution_at_middle


def field_end(field: FieldOfView, pole: Pole) -> float:
    """Return the angle (deg) from a pole to the far end of the field."""
    return 90 - field.tilt_min_deg if pole == "zenith" else 90 + field.tilt_max_deg


def completed_size(size: PartialSize, natural: tuple[float, float]) -> tuple[int, int]:
    """Complete a size from a natural size: both sides, or the missing one from the aspect."""
    if not isinstance(size, Sequence) or isinstance(size, str) or len(size) != 2:
        raise InvalidType(
            f"size must be (width, height) in px, each a number or None; got {format_value(size)}"
        )
    width, height = (
        side if side is None else int(number("size", side, above=0.0, unit="px")) for side in size
    )
    if width is not None and height is not None:
        return width, height
    is_degenerate = 0 in natural or max(natural) > MAX_ASPECT_RATIO * min(natural) > 0
    if not np.isfinite(natural).all() or is_degenerate:
        raise InvalidParameter(
            "the size of the view at the resolution of the image must be finite and "
            f"nonzero; got {natural[0]:.3g} x {natural[1]:.3g} px; change the angles or "
            "specify both sides"
        )
    if width is None and height is None:
        return _even(natural[0]), _even(natural[1])
    if height is None:
        assert width is not None
        return width, max(1, round(width * natural[1] / natural[0]))
    return width if width is not None else max(1, round(height * natural[0] / natural[1])), height


def _even(length: float) -> int:
    """Round to an even number, as required for video."""
    return max(2, 2 * round(length / 2))


# -- Views of a camera -----------------------------------------------------------------------------

PERSPECTIVE_SIZE = (1280, 720)


MAX_PLANET_DEG = 270.0  # beyond it, the opposite pole fills most of the image


PLAN_HEIGHTS = 4.0  # side of a plan relative to the mirror height: down to 63 deg from the nadir


VIEWS_IN_MOSAIC = 4


@validate_arguments
def panorama(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    span_deg: float = 360.0,
    elevation_deg: tuple[float, float] | None = None,
    rows: Rows = "tilt",
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> Cylinder:
    """Create a panorama of the camera's elevation range, or a given range, at its mean resolution.

    With rows linear in height, the elevations are required unless the field excludes both poles.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    span_deg
        Horizontal extent, deg.
    elevation_deg : (low, high)
        Elevation range, deg; the field of the camera by default.
    rows
        ``"tilt"``: linear in elevation; ``"height"``: linear in height on an upright wall.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Cylinder
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> panorama(om.load_sensor("paper-spherical")).size  # 0.21 deg per pixel
    (1706, 640)
    """
    field = field_of(camera)
    low, high = elevation_deg or (field.tilt_min_deg, field.tilt_max_deg)
    tall = high - low
    if rows == "height" and -90 < low < high < 90:
        tall = float(np.degrees(np.ptp(np.tan(np.radians([low, high])))))
    natural = span_deg * field.pixels_per_degree, tall * field.pixels_per_degree
    return Cylinder(
        completed_size(size, natural), low, high, pan_deg, span_deg, rows, distance_mm, offset_mm
    )


@validate_arguments
def sphere(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    span_deg: float = 360.0,
    elevation_deg: tuple[float, float] = (-90.0, 90.0),
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> Equirectangular:
    """Create an equirectangular view of the sphere, or of a part of it, at the mean resolution of
    the camera.

    The sphere, and any part with a 2:1 aspect, has exactly two columns per row, as required by
    viewers, unless both sides are given.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    span_deg
        Horizontal extent, deg.
    elevation_deg : (low, high)
        Elevation range, deg; the field of the camera by default.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Equirectangular
        Screen.

    Raises
    ------
    InvalidParameter
        If only an odd width is given for a 2:1 aspect.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.sphere(camera).size
    (1708, 854)
    """
    low, high = elevation_deg
    scale = field_of(camera).pixels_per_degree
    natural = span_deg * scale, (high - low) * scale
    if np.isclose(span_deg, 2 * (high - low), rtol=1e-12):
        natural = 2.0 * _even(natural[1]), float(_even(natural[1]))
        width, height = size
        if height is None and width is not None and width % 2:
            raise InvalidParameter(
                "the width must be even for an equirectangular image with the aspect "
                f"ratio 2:1; got {width} px; use for example {width + 1} px, or specify "
                "the height also"
            )
    return Equirectangular(
        completed_size(size, natural), low, high, pan_deg, span_deg, distance_mm, offset_mm
    )


@validate_arguments
def perspective(
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    roll_deg: float = 0.0,
    hfov_deg: float = 90.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> Plane:
    """Create a perspective view, 1280 x 720 by default.

    Parameters
    ----------
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    tilt_deg
        Direction of the image centre, deg above the horizon.
    roll_deg
        Clockwise rotation, deg.
    hfov_deg
        Horizontal field of view, deg.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.views.perspective(hfov_deg=40.0).size
    (1280, 720)
    """
    return Plane(
        completed_size(size, PERSPECTIVE_SIZE),
        pan_deg,
        tilt_deg,
        roll_deg,
        hfov_deg,
        distance_mm,
        offset_mm,
    )


@validate_arguments
def dome(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    omega_deg: tuple[float, float] | None = None,
    pole: Pole | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> DomeMaster:
    """Create a dome about the pole nearest to the centre of the field, up to the end of the field.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    omega_deg : (first, last), optional
        Angles from the pole in the centre and at the edge, deg; up to the end of the field by
        default.
    pole
        ``"nadir"`` or ``"zenith"``; the nearest pole by default.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    DomeMaster
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.dome(camera).pole
    'nadir'
    """
    field = field_of(camera)
    pole = pole or pole_of(camera)
    first, last = omega_deg or (0.0, field_end(field, pole))
    diameter = 2 * last * field.pixels_per_degree
    return DomeMaster(
        completed_size(size, (diameter, diameter)),
        last,
        pole,
        pan_deg,
        first,
        distance_mm,
        offset_mm,
    )


@validate_arguments
def planet(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    hfov_deg: float | None = None,
    pole: Pole | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> LittlePlanet:
    """Create a little planet about the pole nearest to the centre of the field, up to the end of
    the field.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    hfov_deg
        Field across the image, deg; the whole field by default.
    pole
        ``"nadir"`` or ``"zenith"``; the nearest pole by default.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    LittlePlanet
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.planet(camera).hfov_deg
    270.0
    """
    field = field_of(camera)
    pole = pole or pole_of(camera)
    hfov = min(2 * field_end(field, pole), MAX_PLANET_DEG) if hfov_deg is None else hfov_deg
    diameter = hfov * field.pixels_per_degree
    return LittlePlanet(
        completed_size(size, (diameter, diameter)), hfov, pole, pan_deg, distance_mm, offset_mm
    )


@validate_arguments
def ground(
    camera: Camera,
    height_mm: float,
    *,
    size: PartialSize = UNKNOWN_SIZE,
    mm_per_px: float | None = None,
    pan_deg: float = 0.0,
    offset_mm: Offset = NO_OFFSET,
) -> Ground:
    """Create a plan of the ground with a width of 4 mirror heights at the mean resolution of the
    image.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    height_mm
        Height of the mirror over the ground, mm; negative for a ceiling.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    mm_per_px
        Scale of the plan; the resolution of the image by default.
    pan_deg
        Direction of the image centre, deg right of forward.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Ground
        Screen.

    Raises
    ------
    InvalidParameter
        If the scale or the size is not finite and above 0, or the height is 0 without a scale.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.ground(camera, 1200.0, mm_per_px=10.0).size
    (480, 480)
    """
    if mm_per_px is None:
        if height_mm == 0:
            raise InvalidParameter("height_mm must not be 0 without mm_per_px; got 0")
        mm_per_px = abs(height_mm) * np.radians(1) / field_of(camera).pixels_per_degree
    is_valid = 0 < mm_per_px < np.inf  # otherwise rejected below
    side = PLAN_HEIGHTS * abs(height_mm) / mm_per_px if is_valid else 1.0
    return Ground(
        completed_size(size, (side, side)), height_mm, float(mm_per_px), pan_deg, offset_mm
    )


@validate_arguments
def cube(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    layout: Layout = "cross",
    pan_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> CubeMap:
    """Create a cube map with faces of the mean resolution of the camera.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    layout
        ``"cross"``, ``"strip"`` or ``"3x2"``.
    pan_deg
        Direction of the image centre, deg right of forward.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    CubeMap
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.cube(camera).layout
    'cross'
    """
    face = _even(90 * field_of(camera).pixels_per_degree)
    columns, rows = CubeMap.grid(layout)
    return CubeMap(
        completed_size(size, (columns * face, rows * face)), layout, pan_deg, distance_mm, offset_mm
    )


@validate_arguments
def mosaic(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    hfov_deg: float = 90.0,
    elevation_deg: tuple[float, float] | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> Mosaic:
    """Create a panorama above four perspective views (left, ahead, right, behind) with an aspect of
    4:3.

    The panorama is rotated by 45 deg, with each view below its own quarter. The views have the
    given ``distance_mm`` and ``offset_mm``; the panorama is at infinity.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    tilt_deg
        Direction of the image centre, deg above the horizon.
    hfov_deg
        Horizontal field of each of the four views, deg.
    elevation_deg : (low, high), optional
        Elevation range of the panorama, deg; the field of the camera by default.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Mosaic
        Views in one image.

    Raises
    ------
    InvalidParameter
        If a height is given; it follows from the width.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.mosaic(camera, (800, None)).size[0]
    800
    """
    width, height = size
    if height is not None:
        raise InvalidParameter(
            f"the height of a mosaic must be None, as it follows from the width; got {height} px"
        )
    part = round(
        (width or panorama(camera, size, elevation_deg=elevation_deg).size[0]) / VIEWS_IN_MOSAIC
    )
    part_size = max(1, part), max(1, round(part * 3 / 4))
    over = panorama(
        camera,
        (VIEWS_IN_MOSAIC * part_size[0], None),
        pan_deg=pan_deg + 45,
        elevation_deg=elevation_deg,
    )
    pans = (pan_deg - 90, pan_deg, pan_deg + 90, pan_deg + 180)
    under = [Plane(part_size, pan, tilt_deg, 0.0, hfov_deg, distance_mm, offset_mm) for pan in pans]
    return Mosaic.panorama_over_views(over, under)


# -- Presets of the paper (Fig. 13) ----------------------------------------------------------------


class Preset(NamedTuple):
    """Placement of the virtual screen of the paper in front of the virtual projector (Fig. 13)."""

    distance_widths: float
    """Distance of the screen from the projector in screen widths."""
    is_curved: bool
    """True for a screen bent about the projector, False for a flat one."""
    description: str


PRESETS: dict[str, Preset] = {
    "distant": Preset(
        2.0, False, "plane screen at two screen widths: field of 28 deg, as with a telephoto lens"
    ),
    "wide": Preset(0.5, False, "plane screen at half a screen width: field of 90 deg, perspective"),
    "super-wide": Preset(
        1 / np.pi, True, "half-cylindrical screen around the projector: field of 180 deg"
    ),
}
"""Distant, wide-angle and super-wide-angle views of the paper: one screen at three positions.

The screen keeps its size and aspect; it is moved towards the projector, and then bent about it,
because a flat screen cannot cover 180 deg. On the bent screen, columns are linear in pan and rows
in height.
"""


@validate_arguments
def preset(
    name: str,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NO_OFFSET,
) -> Plane | Cylinder:
    """Create one of the views of :data:`PRESETS`; a bent screen is moved up instead of tilted.

    Parameters
    ----------
    name
        Name in :data:`PRESETS`.
    size : (width, height)
        Size in px; None for a side derived from the image resolution or from the other side.
    pan_deg
        Direction of the image centre, deg right of forward.
    tilt_deg
        Direction of the image centre, deg above the horizon.
    distance_mm
        Distance from the centre of the screen, mm; infinite by default.
    offset_mm : (3,)
        Centre of a screen at a finite distance: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane or Cylinder
        Screen.

    Raises
    ------
    InvalidParameter
        If the name is unknown, or the screen would reach the zenith.

    Examples
    --------
    >>> for name in PRESETS:
    ...     print(preset(name))
    perspective view (pan 0, tilt 0, hfov 28.0725 deg)
    perspective view (pan 0, tilt 0, hfov 90 deg)
    panorama (180 deg around pan 0, elevation -41.4629 to 41.4629 deg)
    """
    if name not in PRESETS:
        raise InvalidParameter(f"the preset must be one of {', '.join(PRESETS)}; got {name!r}")
    away, is_curved, _ = PRESETS[name]
    width, height = completed_size(size, PERSPECTIVE_SIZE)
    if not is_curved:
        hfov = float(2 * np.degrees(np.arctan(0.5 / away)))
        return Plane((width, height), pan_deg, tilt_deg, 0.0, hfov, distance_mm, offset_mm)
    end = float(np.degrees(np.arctan(height / width / 2 / away)))
    around = float(np.degrees(1 / away))
    bent = Cylinder((width, height), -end, end, pan_deg, around, "height", distance_mm, offset_mm)
    return bent.panned(0.0, tilt_deg)


# -- Registry of views -----------------------------------------------------------------------------


def _check_maker(name: str, make: Any) -> None:
    if not callable(make):
        raise InvalidType(
            f"the view {name!r} must be a function of a camera that returns a view; got {format_value(make)}"
        )


ViewMaker: TypeAlias = Callable[..., View]


VIEWS: Registry[ViewMaker] = Registry(
    "omnimirror.views",
    "a view",
    {
        "panorama": panorama,
        "perspective": lambda _, **options: perspective(**options),
        "dome": dome,
        "sphere": sphere,
        "ground": ground,
        "planet": planet,
        "cube": cube,
        "mosaic": mosaic,
    },
    _check_maker,
)
"""Views by command-line name, called as ``make(camera, **options)``."""


def register_view(name: str, make: ViewMaker) -> None:
    """Register a view under a name for ``omnimirror dewarp --view NAME``.

    Installed packages register views with an entry point in ``pyproject.toml``:
    ``[project.entry-points."omnimirror.views"]`` with ``fan = "my_package:fan"``. In Python no
    registration is required: :class:`omnimirror.Dewarper` accepts any screen.

    Parameters
    ----------
    name
        Name such as ``"fan"``.
    make
        Function called as ``make(camera, **options)``. Its keywords define the applicable options
        of ``omnimirror dewarp``: ``size`` (width, height) in px, each side possibly None,
        ``pan_deg``, ``hfov_deg`` ... It returns a screen
        (:class:`omnimirror.dewarp.screens.Screen`), or several in one image.

    Raises
    ------
    InvalidParameter
        If the name is taken by another view, or ``make`` is not a function.

    Examples
    --------
    >>> import omnimirror as om
    >>> def strip(camera, size=(720, 90), pan_deg=0.0):
    ...     return om.screens.Cylinder(size, -10.0, 10.0, pan_deg)
    >>> om.register_view("docs-strip", strip)
    >>> om.views.VIEWS["docs-strip"](om.load_sensor("paper-spherical")).size
    (720, 90)
    >>> om.views.VIEWS.withdraw("docs-strip")
    """
    VIEWS.register(name, make)
