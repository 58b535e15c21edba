"""Sensible views for a camera: they cover what it sees, at the resolution that its picture has."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from ..arguments import WrongKind, number, shown
from ..cameras import Camera
from ..errors import InvalidParameter
from ..numerics.registry import Registry
from .camera_field import FieldOfView, field_of, pole_of
from .maps.coordinates import rows_of_pixels
from .screens import (
    CubeMap,
    Cylinder,
    Dome,
    Ground,
    Layout,
    LittlePlanet,
    Mosaic,
    Plane,
    Pole,
    Rows,
    Screen,
    Sphere,
    View,
    parts_of,
)
from .screens.base import NOT_MOVED, Offset

__all__ = [
    "LARGEST_MAGNIFICATION",
    "PRESETS",
    "VIEWS",
    "Preset",
    "cube",
    "dome",
    "ground",
    "largest_zoom",
    "mosaic",
    "panorama",
    "perspective",
    "planet",
    "preset",
    "register_view",
    "resolution",
    "sphere",
]

PartialSize = tuple[int | None, int | None]

PERSPECTIVE_SIZE = (1280, 720)
UNKNOWN_SIZE: PartialSize = (None, None)
WIDEST_PLANET_DEG = 270.0  # beyond, most of the picture is the opposite pole
PLAN_HEIGHTS = 4.0  # side of a plan in heights of the mirror over the ground: down to 63 deg from the nadir
VIEWS_IN_MOSAIC = 4
LARGEST_MAGNIFICATION = 4.0
"""Output pixels per source pixel to which a zoom is limited: cubic interpolation still looks smooth, and
there has been nothing more to see since about 1."""
ROWS_EXAMINED = 65
LARGEST_RATIO = 1e6  # of the sides of a picture


def panorama(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    span_deg: float = 360.0,
    elevation_deg: tuple[float, float] | None = None,
    rows: Rows = "tilt",
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Cylinder:
    """A panorama that covers the camera's elevations, or those given, at its mean resolution.

    With rows linear in height, the elevations must be given unless the field leaves out both poles.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    span_deg
        Width, deg.
    elevation_deg : (low, high)
        Height, deg; the camera's field by default.
    rows
        ``"tilt"``: linear in elevation; ``"height"``: in height on an upright wall.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Cylinder
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> panorama(om.load_sensor("paper-spherical")).size  # .21 deg per pixel
    (1706, 640)
    """
    seen = field_of(camera)
    low, high = elevation_deg or (seen.tilt_min_deg, seen.tilt_max_deg)
    tall = high - low
    if rows == "height" and -90 < low < high < 90:
        tall = float(np.degrees(np.ptp(np.tan(np.radians([low, high])))))
    natural = span_deg * seen.pixels_per_degree, tall * seen.pixels_per_degree
    return Cylinder(_completed(size, natural), low, high, pan_deg, span_deg, rows, distance_mm, offset_mm)


def sphere(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    span_deg: float = 360.0,
    elevation_deg: tuple[float, float] = (-90.0, 90.0),
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Sphere:
    """An equirectangular picture of the whole sphere, or of a part of it, at the camera's mean resolution.

    The whole sphere, and any part that is twice as wide as high, has exactly two columns to each row, as viewers
    expect, unless both sides are given.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    span_deg
        Width, deg.
    elevation_deg : (low, high)
        Height, deg; the camera's field by default.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Sphere
        The screen.

    Raises
    ------
    InvalidParameter
        For an odd width alone, which has no half.

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
                f"{width} px of an equirectangular picture that is twice as wide as high have no half; give an even "
                f"width, such as {width + 1}, or the height too"
            )
    return Sphere(_completed(size, natural), low, high, pan_deg, span_deg, distance_mm, offset_mm)


def perspective(
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    roll_deg: float = 0.0,
    hfov_deg: float = 90.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Plane:
    """A perspective view, 1280 x 720 unless said otherwise.

    Parameters
    ----------
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    tilt_deg
        Where the middle looks, deg above the horizon.
    roll_deg
        Turn clockwise, deg.
    hfov_deg
        Width of the field, deg.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.views.perspective(hfov_deg=40.0).size
    (1280, 720)
    """
    return Plane(_completed(size, PERSPECTIVE_SIZE), pan_deg, tilt_deg, roll_deg, hfov_deg, distance_mm, offset_mm)


def dome(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    omega_deg: tuple[float, float] | None = None,
    pole: Pole | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Dome:
    """A dome about the pole nearer to the centre of the camera's field, reaching to the end of it.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    omega_deg : (first, last), optional
        Angles from the pole in the middle and at the edge, deg; to the end of the field by default.
    pole
        ``"nadir"`` or ``"zenith"``; the nearer one by default.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Dome
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.dome(camera).pole
    'nadir'
    """
    seen = field_of(camera)
    pole = pole or pole_of(camera)
    first, last = omega_deg or (0.0, _end(seen, pole))
    diameter = 2 * last * seen.pixels_per_degree
    return Dome(_completed(size, (diameter, diameter)), last, pole, pan_deg, first, distance_mm, offset_mm)


def planet(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    hfov_deg: float | None = None,
    pole: Pole | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> LittlePlanet:
    """A little planet about the pole nearer to the centre of the camera's field, reaching to the end of it.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    hfov_deg
        Across the picture, deg; all of the field by default.
    pole
        ``"nadir"`` or ``"zenith"``; the nearer one by default.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    LittlePlanet
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.planet(camera).hfov_deg
    270.0
    """
    seen = field_of(camera)
    pole = pole or pole_of(camera)
    hfov = hfov_deg or min(2 * _end(seen, pole), WIDEST_PLANET_DEG)
    diameter = hfov * seen.pixels_per_degree
    return LittlePlanet(_completed(size, (diameter, diameter)), hfov, pole, pan_deg, distance_mm, offset_mm)


def ground(
    camera: Camera,
    height_mm: float,
    *,
    size: PartialSize = UNKNOWN_SIZE,
    mm_per_px: float | None = None,
    pan_deg: float = 0.0,
    offset_mm: Offset = NOT_MOVED,
) -> Ground:
    """A plan of the ground, four times as wide as the mirror is high; as fine as the picture on average shows it.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    height_mm
        How high the mirror stands over the ground, mm; below 0 for a ceiling.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    mm_per_px
        Scale of the plan; the picture's resolution by default.
    pan_deg
        Where the middle looks, deg right of forward.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Ground
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.ground(camera, 1200.0, mm_per_px=10.0).size
    (480, 480)
    """
    scale = mm_per_px or abs(height_mm) * np.radians(1) / field_of(camera).pixels_per_degree
    side = PLAN_HEIGHTS * abs(height_mm) / scale if scale > 0 else 0.0
    return Ground(_completed(size, (side, side)), height_mm, float(scale), pan_deg, offset_mm)


def cube(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    layout: Layout = "cross",
    pan_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> CubeMap:
    """A cube map whose faces have the camera's mean resolution.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    layout
        ``"cross"``, ``"strip"`` or ``"3x2"``.
    pan_deg
        Where the middle looks, deg right of forward.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    CubeMap
        The screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.cube(camera).layout
    'cross'
    """
    face = _even(90 * field_of(camera).pixels_per_degree)
    columns, rows = CubeMap.grid(layout)
    return CubeMap(_completed(size, (columns * face, rows * face)), layout, pan_deg, distance_mm, offset_mm)


def mosaic(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    hfov_deg: float = 90.0,
    elevation_deg: tuple[float, float] | None = None,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Mosaic:
    """A panorama over four perspective views to the left, ahead, to the right and behind, 4 : 3 each.

    The panorama is turned by 45 deg, so that each view stands under its own quarter of it. The views
    stand at ``distance_mm``, all from the same ``offset_mm``; the panorama is a distant one.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    tilt_deg
        Where the middle looks, deg above the horizon.
    hfov_deg
        Width of each of the four views, deg.
    elevation_deg : (low, high), optional
        Of the panorama, deg; the camera's field by default.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Mosaic
        The views in one picture.

    Raises
    ------
    InvalidParameter
        If a height is given: it follows from the width.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.mosaic(camera, (800, None)).size[0]
    800
    """
    width, height = size
    if height is not None:
        raise InvalidParameter(f"the height of a mosaic, {height} px, follows from its width; give the width only")
    part = round((width or panorama(camera, size, elevation_deg=elevation_deg).size[0]) / VIEWS_IN_MOSAIC)
    part_size = max(1, part), max(1, round(part * 3 / 4))
    over = panorama(camera, (VIEWS_IN_MOSAIC * part_size[0], None), pan_deg=pan_deg + 45, elevation_deg=elevation_deg)
    pans = (pan_deg - 90, pan_deg, pan_deg + 90, pan_deg + 180)
    under = [Plane(part_size, pan, tilt_deg, 0.0, hfov_deg, distance_mm, offset_mm) for pan in pans]
    return Mosaic.panorama_over_views(over, under)


# -- by name ---------------------------------------------------------------------------------------


def _check_maker(name: str, make: Any) -> None:
    if not callable(make):
        raise WrongKind(f"{shown(make)} is no function of a camera that gives a view")


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
"""Every view by its name on the command line, called as ``make(camera, **options)``."""


def register_view(name: str, make: ViewMaker) -> None:
    """Make a view of one's own known by a name, such as ``omnimirror dewarp --view NAME`` takes.

    An installed package does the same without a call, by an entry point in its ``pyproject.toml``:
    ``[project.entry-points."omnimirror.views"]`` with ``fan = "my_package:fan"``. In Python no name is needed: a
    :class:`omnimirror.Dewarper` takes any screen.

    Parameters
    ----------
    name
        Such as ``"fan"``.
    make
        Called as ``make(camera, **options)``. Its keywords say which options belong to the view, among those of
        ``omnimirror dewarp``: ``size`` (width, height) in px, each perhaps None, ``pan_deg``, ``hfov_deg`` ... It
        returns a screen (:class:`omnimirror.dewarp.screens.Screen`), or several in one picture.

    Raises
    ------
    InvalidParameter
        Another view has this name, or ``make`` is no function.

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


# -- the paper's effects ---------------------------------------------------------------------------


class Preset(NamedTuple):
    """A placing of the paper's virtual screen before the virtual projector (Fig. 13)."""

    widths_away: float
    """Distance of the screen from the projector, in widths of the screen."""
    is_bent: bool
    """Whether it is bent about the projector, or flat."""
    description: str


PRESETS: dict[str, Preset] = {
    "distant": Preset(2.0, False, "flat, two widths away: 28 deg wide, as through a telephoto lens"),
    "wide": Preset(0.5, False, "the same screen moved up to half a width: 90 deg wide, still in perspective"),
    "super-wide": Preset(1 / np.pi, True, "the same screen bent half round the projector: 180 deg wide"),
}
"""The paper's distant, wide-angle and super-wide-angle views: one screen, three places.

The screen keeps its size and proportions; it is moved towards the projector, and then bent about it,
since a flat screen never reaches 180 deg. Bent, its columns are linear in pan and its rows in height.
"""


def preset(
    name: str,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    pan_deg: float = 0.0,
    tilt_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
) -> Plane | Cylinder:
    """One of the paper's effects, of :data:`PRESETS`; a bent screen is not tilted but moved up.

    Parameters
    ----------
    name
        One of :data:`PRESETS`.
    size : (width, height)
        In px, each perhaps None: taken from the picture's resolution, or from the other side.
    pan_deg
        Where the middle looks, deg right of forward.
    tilt_deg
        Where the middle looks, deg above the horizon.
    distance_mm
        From the screen's centre to the screen, mm; infinite for a distant one.
    offset_mm : (3,)
        Where a near screen's centre stands: forward, left and up from the mirror, mm.

    Returns
    -------
    Plane or Cylinder
        The screen.

    Raises
    ------
    InvalidParameter
        For an unknown name, or a screen that would reach the zenith.

    Examples
    --------
    >>> for name in PRESETS:
    ...     print(preset(name))
    perspective view (pan 0, tilt 0, hfov 28.0725 deg)
    perspective view (pan 0, tilt 0, hfov 90 deg)
    panorama (180 deg around pan 0, elevation -41.4629 to 41.4629 deg)
    """
    if name not in PRESETS:
        raise InvalidParameter(f"there is no preset {name!r}; there are {', '.join(PRESETS)}")
    away, is_bent, _ = PRESETS[name]
    width, height = _completed(size, PERSPECTIVE_SIZE)
    if not is_bent:
        hfov = float(2 * np.degrees(np.arctan(0.5 / away)))
        return Plane((width, height), pan_deg, tilt_deg, 0.0, hfov, distance_mm, offset_mm)
    end = float(np.degrees(np.arctan(height / width / 2 / away)))
    around = float(np.degrees(1 / away))
    bent = Cylinder((width, height), -end, end, pan_deg, around, "height", distance_mm, offset_mm)
    return bent.panned(0.0, tilt_deg)


# -- zoom ------------------------------------------------------------------------------------------


def resolution(camera: Camera, view: View) -> float:
    """Source pixels per output pixel, by length, where the view is seen next to its centre.

    Of several views in one picture the coarsest counts. NaN where none is seen, or has fewer than
    2 x 2 pixels.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        A screen of :mod:`omnimirror.screens`, or several in one picture.

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
    found = [_resolution(camera, part.screen) for part in parts_of(view)]
    return float(min((r for r in found if np.isfinite(r)), default=np.nan))


def largest_zoom(camera: Camera, view: View) -> float:
    """The factor up to which a view can be zoomed within what the camera resolves, 1 or more.

    It ends where :data:`LARGEST_MAGNIFICATION` output pixels show one source pixel; infinite where the
    resolution is not known.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        A screen of :mod:`omnimirror.screens`, or several in one picture.

    Returns
    -------
    float
        1 or more.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> print(f"{om.views.largest_zoom(camera, om.views.perspective(hfov_deg=120.0)):.2f}")
    2.94
    """
    within = LARGEST_MAGNIFICATION * resolution(camera, view)
    return max(1.0, within) if np.isfinite(within) else np.inf


def _resolution(camera: Camera, screen: Screen) -> float:
    width, height = screen.size
    if width < 2 or height < 2:
        return np.nan
    middle = (height - 2) / 2
    rows = np.unique(np.linspace(0, height - 2, min(height - 1, ROWS_EXAMINED)).round().astype(int))
    nearest, found = np.inf, np.nan
    for row in map(int, rows[np.argsort(abs(rows - middle), kind="stable")]):
        if abs(row - middle) >= nearest:
            break
        pixels = rows_of_pixels(camera, screen, row, row + 2)
        across, down = np.diff(pixels[0], axis=0), (pixels[1] - pixels[0])[:-1]
        area = abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
        distances = np.where(np.isnan(area), np.inf, np.hypot(np.arange(width - 1) - (width - 2) / 2, row - middle))
        best = int(np.argmin(distances))
        if distances[best] < nearest:
            nearest, found = float(distances[best]), float(np.sqrt(area[best]))
    return found


# -- sizes -----------------------------------------------------------------------------------------


def _end(seen: FieldOfView, pole: Pole) -> float:
    """Angle (deg) from a pole to the far end of the field."""
    return 90 - seen.tilt_min_deg if pole == "zenith" else 90 + seen.tilt_max_deg


def _completed(size: PartialSize, natural: tuple[float, float]) -> tuple[int, int]:
    """The size with what is missing taken from a natural size: all of it, or the proportion."""
    if not isinstance(size, Sequence) or isinstance(size, str) or len(size) != 2:
        raise WrongKind(f"size = {shown(size)} is not (width, height) in px, each perhaps None")
    width, height = (side if side is None else int(number("size", side, above=0.0, unit="px")) for side in size)
    if width is not None and height is not None:
        return width, height
    if not np.isfinite(natural).all() or max(natural) > LARGEST_RATIO * min(natural) >= 0:
        raise InvalidParameter(
            f"a view of {natural[0]:.3g} x {natural[1]:.3g} px, at the picture's resolution, is no picture; give it "
            "other angles, or both sides of its size"
        )
    if width is None and height is None:
        return _even(natural[0]), _even(natural[1])
    if height is None:
        assert width is not None
        return width, max(1, round(width * natural[1] / natural[0]))
    return width if width is not None else max(1, round(height * natural[0] / natural[1])), height


def _even(length: float) -> int:
    """Rounded to an even number, as video wants it."""
    return max(2, 2 * round(length / 2))
