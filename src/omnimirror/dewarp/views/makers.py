"""Views of all types for a camera: they cover its field at the resolution of its image."""

from __future__ import annotations

import numpy as np

from ...base.arguments import checked
from ...base.errors import InvalidParameter
from ...cameras.camera import Camera
from ..camera_field import field_of, pole_of
from ..screens import (
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
    Sphere,
)
from ..screens.base import NOT_MOVED, Offset
from .sizes import UNKNOWN_SIZE, PartialSize, _even, completed, field_end

PERSPECTIVE_SIZE = (1280, 720)


WIDEST_PLANET_DEG = 270.0  # beyond it, the opposite pole fills most of the image


PLAN_HEIGHTS = 4.0  # side of a plan relative to the mirror height: down to 63 deg from the nadir


VIEWS_IN_MOSAIC = 4


@checked
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
    >>> panorama(om.load_sensor("paper-spherical")).size  # .21 deg per pixel
    (1706, 640)
    """
    seen = field_of(camera)
    low, high = elevation_deg or (seen.tilt_min_deg, seen.tilt_max_deg)
    tall = high - low
    if rows == "height" and -90 < low < high < 90:
        tall = float(np.degrees(np.ptp(np.tan(np.radians([low, high])))))
    natural = span_deg * seen.pixels_per_degree, tall * seen.pixels_per_degree
    return Cylinder(completed(size, natural), low, high, pan_deg, span_deg, rows, distance_mm, offset_mm)


@checked
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
    Sphere
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
                f"{width} px of an equirectangular picture that is twice as wide as high have no half; give an even "
                f"width, such as {width + 1}, or the height too"
            )
    return Sphere(completed(size, natural), low, high, pan_deg, span_deg, distance_mm, offset_mm)


@checked
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
    return Plane(completed(size, PERSPECTIVE_SIZE), pan_deg, tilt_deg, roll_deg, hfov_deg, distance_mm, offset_mm)


@checked
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
    Dome
        Screen.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.dome(camera).pole
    'nadir'
    """
    seen = field_of(camera)
    pole = pole or pole_of(camera)
    first, last = omega_deg or (0.0, field_end(seen, pole))
    diameter = 2 * last * seen.pixels_per_degree
    return Dome(completed(size, (diameter, diameter)), last, pole, pan_deg, first, distance_mm, offset_mm)


@checked
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
    seen = field_of(camera)
    pole = pole or pole_of(camera)
    hfov = hfov_deg or min(2 * field_end(seen, pole), WIDEST_PLANET_DEG)
    diameter = hfov * seen.pixels_per_degree
    return LittlePlanet(completed(size, (diameter, diameter)), hfov, pole, pan_deg, distance_mm, offset_mm)


@checked
def ground(
    camera: Camera,
    height_mm: float,
    *,
    size: PartialSize = UNKNOWN_SIZE,
    mm_per_px: float | None = None,
    pan_deg: float = 0.0,
    offset_mm: Offset = NOT_MOVED,
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

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> om.views.ground(camera, 1200.0, mm_per_px=10.0).size
    (480, 480)
    """
    scale = mm_per_px or abs(height_mm) * np.radians(1) / field_of(camera).pixels_per_degree
    side = PLAN_HEIGHTS * abs(height_mm) / scale if scale > 0 else 0.0
    return Ground(completed(size, (side, side)), height_mm, float(scale), pan_deg, offset_mm)


@checked
def cube(
    camera: Camera,
    size: PartialSize = UNKNOWN_SIZE,
    *,
    layout: Layout = "cross",
    pan_deg: float = 0.0,
    distance_mm: float = np.inf,
    offset_mm: Offset = NOT_MOVED,
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
    return CubeMap(completed(size, (columns * face, rows * face)), layout, pan_deg, distance_mm, offset_mm)


@checked
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
        raise InvalidParameter(f"the height of a mosaic, {height} px, follows from its width; give the width only")
    part = round((width or panorama(camera, size, elevation_deg=elevation_deg).size[0]) / VIEWS_IN_MOSAIC)
    part_size = max(1, part), max(1, round(part * 3 / 4))
    over = panorama(camera, (VIEWS_IN_MOSAIC * part_size[0], None), pan_deg=pan_deg + 45, elevation_deg=elevation_deg)
    pans = (pan_deg - 90, pan_deg, pan_deg + 90, pan_deg + 180)
    under = [Plane(part_size, pan, tilt_deg, 0.0, hfov_deg, distance_mm, offset_mm) for pan in pans]
    return Mosaic.panorama_over_views(over, under)
