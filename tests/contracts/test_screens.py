"""Contract of all screens with all cameras: world points are imaged at the expected pixel.

Pixel directions are written explicitly from the conventions; the position in a camera image is
checked in reverse, by the ray of its pixel.
"""

from __future__ import annotations

import math
import pickle
from dataclasses import replace

import numpy as np
import pytest
from numpy import inf

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp._source_coordinates import exact_pixels, source_pixels
from omnimirror.dewarp.screens import (
    LAYOUTS,
    Composite,
    CubeMap,
    Cylinder,
    DomeMaster,
    Equirectangular,
    Ground,
    LittlePlanet,
    Mosaic,
    Plane,
    Screen,
    ScreenPart,
    parts_of,
)
from tests.conftest import sensor_of
from tests.contracts.test_cameras import CATADIOPTRIC, SKEWED
from tests.dewarp.test_handedness import IMAGE_TOP_IS_FORWARD, sensor_with, shortest_path_pixel

OFFSET = (40.0, -60.0, 25.0)


def world(pan, tilt):
    """Return the direction for pan to the right and tilt up, both in degrees: x forward, y left, z
    up."""
    a, t = math.radians(pan), math.radians(tilt)
    return np.array([math.cos(t) * math.cos(a), -math.cos(t) * math.sin(a), math.sin(t)])


def perspective(W, H, pan, tilt, roll, hfov, u, v):
    f, a, r = world(pan, tilt), math.radians(pan), math.radians(roll)
    right = np.array([-math.sin(a), -math.cos(a), 0.0])
    down = np.cross(f, right)
    right, down = (
        math.cos(r) * right + math.sin(r) * down,
        -math.sin(r) * right + math.cos(r) * down,
    )
    F = W / 2 / math.tan(math.radians(hfov / 2))
    return f + (u - (W - 1) / 2) / F * right + (v - (H - 1) / 2) / F * down


def about_a_pole(omega, pan, up):
    """Return the direction at omega from the pole, at a pan."""
    return world(pan, omega - 90.0 if not up else 90.0 - omega)


def pan_in_circle(W, H, u, v, top, up):
    """Return the pan: ``top`` at the top; clockwise is to the right for views downwards, to the
    left for views upwards."""
    clockwise = math.degrees(math.atan2(u - (W - 1) / 2, (H - 1) / 2 - v))
    return top - clockwise if up else top + clockwise


# -- shapes: construction, and pixel targets in units of the distance
# ----------------------------------


def cylinder(u, v):
    tilt = 60 - (v + 0.5) / 14 * 140
    return world(10 + ((u + 0.5) / 24 - 0.5) * 300, tilt) / math.cos(math.radians(tilt))


def tall_cylinder(u, v):
    """Rows linear in height, between -1 and 0.75 radii."""
    x, y, _ = world(-20 + ((u + 0.5) / 21 - 0.5) * 360, 0)
    return np.array([x, y, 0.75 - (v + 0.5) / 13 * 1.75])


def sphere(u, v):
    return world(((u + 0.5) / 24 - 0.5) * 360, 90 - (v + 0.5) / 12 * 180)


def dome(u, v):
    omega = math.hypot(u - 9, v - 8.5) * 130 / 9
    return (
        about_a_pole(omega, pan_in_circle(19, 18, u, v, 25, False), False)
        if 10 <= omega <= 130
        else None
    )


def zenith_dome(u, v):
    omega = math.hypot(u - 8, v - 9) * 120 / 8.5
    return (
        about_a_pole(omega, pan_in_circle(17, 19, u, v, 25, True), True) if omega <= 120 else None
    )


def planet(u, v):
    omega = 2 * math.degrees(
        math.atan(math.hypot(u - 9.5, v - 7) * math.tan(math.radians(230 / 4)) / 10)
    )
    return about_a_pole(omega, pan_in_circle(20, 15, u, v, -70, False), False)


def zenith_planet(u, v):
    omega = 2 * math.degrees(
        math.atan(math.hypot(u - 7, v - 9.5) * math.tan(math.radians(300 / 4)) / 7.5)
    )
    return about_a_pole(omega, pan_in_circle(15, 20, u, v, -70, True), True)


TALL = math.degrees(math.atan(0.75))
SHAPES = {
    "cylinder": (Cylinder((24, 14), -80.0, 60.0, 10.0, 300.0), cylinder),
    "tall-cylinder": (Cylinder((21, 13), -45.0, TALL, -20.0, 360.0, "height"), tall_cylinder),
    "sphere": (Equirectangular((24, 12)), sphere),
    "plane": (
        Plane((16, 11), 35.0, -25.0, 20.0, 100.0),
        lambda u, v: perspective(16, 11, 35, -25, 20, 100, u, v),
    ),
    "plane-down": (
        Plane((9, 8), 35.0, -90.0, 0.0, 60.0),
        lambda u, v: perspective(9, 8, 35, -90, 0, 60, u, v),
    ),
    "dome": (DomeMaster((19, 18), 130.0, "nadir", 25.0, 10.0), dome),
    "zenith-dome": (DomeMaster((17, 19), 120.0, "zenith", 25.0), zenith_dome),
    "planet": (LittlePlanet((20, 15), 230.0, "nadir", -70.0), planet),
    "zenith-planet": (LittlePlanet((15, 20), 300.0, "zenith", -70.0), zenith_planet),
}
VIEWPOINTS = {
    "distant": (inf, (0.0, 0.0, 0.0)),
    "near": (300.0, (0.0, 0.0, 0.0)),
    "moved": (900.0, OFFSET),
}


def placed(shape, distance, offset):
    """Return a screen of a shape with offset, and the target of each of its pixels."""
    screen, direction_of = SHAPES[shape]

    def target(u, v):
        vector = direction_of(u, v)
        if vector is None or distance == inf:
            return vector
        return distance * vector + offset

    return replace(screen, distance_mm=distance, offset_mm=offset), target


def ground(u, v):
    """Pixels 50 mm apart; forward at the top, rotated by 30 deg to the right."""
    forward, right = world(30, 0), world(120, 0)
    return (7 - v) * 50 * forward + (u - 6.5) * 50 * right + [100, -50, -600 + 20]


SCREENS = {
    **{
        f"{shape}-{name}": placed(shape, *VIEWPOINTS[name])
        for shape in SHAPES
        for name in VIEWPOINTS
    },
    "ground": (Ground((14, 15), 600.0, 50.0, 30.0, (100.0, -50.0, 20.0)), ground),
    "ceiling": (
        Ground((3, 3), -600.0, 200.0),
        lambda u, v: np.array([(1 - v) * 200, (1 - u) * 200, 600]),
    ),
}
CAMERAS = {
    **{
        name: om.load_sensor(name)
        for name in ("paper-spherical", "paper-hyperboloidal", "paraboloid-telecentric")
    },
    **{kind: sensor_of(kind) for kind in ("cone", "equidistant", "ellipsoid")},
    "ocam": om.OCam(
        polynomial=CATADIOPTRIC,
        centre_px=(515.3, 382.3),
        image_size=(1024, 768),
        affine=SKEWED,
        rim_radius_px=452.0,
    ),
    "ball": om.MirrorBall(
        centre_px=(500.0, 500.0), rim_radius_px=499.0, field_deg=300.0, image_size=(1001, 1001)
    ),
}
MOUNTS = [Mount("up"), Mount("down", 20.0), Mount("forward"), Mount("up", 33.0, True, 4.0, -9.0)]
UPRIGHT = [
    pytest.param(
        replace(camera, mount=mount),
        id=f"{name}-{mount.camera_looks}{'-flipped' * mount.image_flipped}",
        marks=() if (n - m) % len(MOUNTS) == 0 else pytest.mark.full,
    )
    for n, (name, camera) in enumerate(CAMERAS.items())
    for m, mount in enumerate(MOUNTS)
]
"""Daily cases: each camera with one mount, another than that of the preceding camera."""


def all_targets(screen):
    return screen.targets(0, screen.size[1])


@pytest.mark.parametrize("name", SCREENS)
def test_pixel_directions_follow_conventions(name):
    screen, target = SCREENS[name]
    assert isinstance(screen, Screen)
    width, height = screen.size
    targets = all_targets(screen)
    assert targets.shape == (height, width, 3)
    scale = 1.0 if screen.is_distant else 1000.0
    for u in range(width):
        for v in range(height):
            expected = target(u, v)
            if expected is None:
                assert np.isnan(targets[v, u]).all()
            else:
                direction, expected = targets[v, u], np.asarray(expected, float)
                if screen.is_distant:
                    direction, expected = (
                        direction / np.linalg.norm(direction),
                        expected / np.linalg.norm(expected),
                    )
                np.testing.assert_allclose(direction, expected, atol=1e-12 * scale, rtol=1e-12)


@pytest.mark.parametrize("camera", UPRIGHT)
def test_projection_inverts_pixel_directions(camera):
    """The ray of every source pixel passes through the point, and points without a pixel are far
    from all rays."""
    width, height = camera.image_size
    grid = np.stack(np.meshgrid(np.arange(0, width, 12.0), np.arange(0, height, 12.0)), -1).reshape(
        -1, 2
    )
    margin = 22  # px: for a cone, whose angular resolution is at most that of its lens, 0.56 deg
    steps = margin * np.array([[1, 0], [-1, 0], [0, 1], [0, -1]])
    inside = np.all([camera.backproject(grid + s).valid for s in steps], 0)
    far_inside = camera.backproject(grid[inside])
    for name, (screen, _) in SCREENS.items():
        pixels = (
            om.Dewarper(camera, screen).coordinates(exact=True).reshape(-1, 2)
            if is_in_field(camera, screen)
            else None
        )
        if pixels is None:
            continue
        targets = all_targets(screen).reshape(-1, 3)
        is_visible = ~np.isnan(pixels[:, 0])
        origins, directions, valid = camera.backproject(pixels[is_visible])
        assert valid.all(), name
        expected = targets[is_visible] - (0.0 if screen.is_distant else origins)
        expected /= np.linalg.norm(expected, axis=1, keepdims=True)
        np.testing.assert_allclose(directions, expected, atol=1e-8, err_msg=name)
        for point in targets[~is_visible & ~np.isnan(targets[:, 0])][::7]:
            expected = point - (0.0 if screen.is_distant else far_inside.origins)
            expected = expected / np.linalg.norm(expected, axis=-1, keepdims=True)
            nearest = (far_inside.directions * expected).sum(axis=1).max()
            assert np.degrees(np.arccos(min(1.0, nearest))) > 0.5, name


def is_in_field(camera, screen):
    return not np.isnan(source_pixels(camera, screen, exact=True)[..., 0]).all()


@pytest.mark.parametrize("orientation", ["up", "down"])
@pytest.mark.parametrize(
    "name", [n for n in SCREENS if "near" in n or "moved" in n or n == "ground"]
)
def test_points_are_projected_along_shortest_path(name, orientation):
    """Compared with Fermat's principle for a sphere, without the optics of the package."""
    screen, target = SCREENS[name]
    sensor = sensor_with(orientation, -90.0)
    pixels = source_pixels(sensor, screen, exact=True)
    v, u = np.nonzero(~np.isnan(pixels[..., 0]))
    assert len(u) or orientation == "down"  # the ground is outside its field
    for i in np.random.default_rng(3).permutation(len(u))[:3]:
        expected = shortest_path_pixel(
            np.asarray(target(u[i], v[i])), IMAGE_TOP_IS_FORWARD[orientation]
        )
        np.testing.assert_allclose(pixels[v[i], u[i]], expected, atol=5e-3)


@pytest.mark.parametrize("name", SCREENS)
def test_axes_of_views_are_not_mirrored(name):
    """Right x down points away from the observer; for a ceiling plan, seen from above, towards the
    observer."""
    screen, _ = SCREENS[name]
    targets = all_targets(screen) - (0.0 if screen.is_distant else screen.offset_mm)
    target, right, down = targets[:-1, :-1], targets[:-1, 1:], targets[1:, :-1]
    turn = np.einsum("hwi,hwi->hw", target, np.cross(right - target, down - target))
    turn = turn[~np.isnan(turn)]
    assert len(turn)
    assert (turn < 0).all() if name == "ceiling" else (turn > 0).all()


@pytest.mark.parametrize("name", SCREENS)
def test_row_ranges_single_pixels_and_copies_agree(name):
    screen, _ = SCREENS[name]
    targets = all_targets(screen)
    np.testing.assert_array_equal(screen.targets(1, 3), targets[1:3])
    width, height = screen.size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    np.testing.assert_array_equal(screen.targets_at(u, v), targets)
    assert eval(repr(screen)) == screen
    assert pickle.loads(pickle.dumps(screen)) == screen
    assert len({screen, eval(repr(screen))}) == 1
    has_viewpoint = ", at " in str(screen)
    assert has_viewpoint == (not screen.is_distant and not isinstance(screen, Ground))
    assert ("offset by" in str(screen)) == any(screen.offset_mm)


@pytest.mark.parametrize("name", SCREENS)
def test_single_pixel_view_is_valid(name):
    screen = replace(SCREENS[name][0], size=(1, 1))
    targets = all_targets(screen)
    assert targets.shape == (1, 1, 3)
    if "dome" not in name or "zenith" in name:  # a dome can exclude its pole
        assert np.isfinite(targets).all()
    camera = om.OCam(
        polynomial=(-200.0, 0.0, 1e-4),
        centre_px=(320.0, 240.0),
        image_size=(640, 480),
        optics="fisheye",
    )
    assert exact_pixels(camera, screen).shape == (1, 1, 2)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["ocam", "ball"])
def test_single_viewpoint_views_are_independent_of_distance(name, shape):
    camera = CAMERAS[name]
    distant = exact_pixels(camera, SHAPES[shape][0])
    for distance in (1.0, 300.0, 1e9):
        near = replace(SHAPES[shape][0], distance_mm=distance)
        for viewpoint in ("exact", "single", 0.0):
            pixels = exact_pixels(camera, near, viewpoint)
            np.testing.assert_array_equal(np.isnan(pixels), np.isnan(distant))
            np.testing.assert_allclose(pixels, distant, atol=1e-9, rtol=0)


@pytest.mark.parametrize("shape", SHAPES)
def test_large_distance_equals_infinity(shape):
    camera = CAMERAS["paper-spherical"]
    far = exact_pixels(camera, replace(SHAPES[shape][0], distance_mm=1e11, offset_mm=OFFSET))
    distant = exact_pixels(camera, SHAPES[shape][0])
    both = ~np.isnan(far[..., 0]) & ~np.isnan(distant[..., 0])
    assert both.sum() > 0.95 * (~np.isnan(distant[..., 0])).sum()
    np.testing.assert_allclose(far[both], distant[both], atol=1e-5, rtol=0)


# -- zoom and pan
# ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SCREENS)
@pytest.mark.parametrize("factor", [2.0, 0.9, 1.0])
def test_zoom_magnifies_about_centre(name, factor):
    screen, _ = SCREENS[name]
    if factor < 1 and (isinstance(screen, Equirectangular) or screen.size == (21, 13)):
        return  # these already cover all azimuths and end at the boundary of the shape
    zoomed = screen.zoomed(factor)
    assert zoomed.size == screen.size
    width, height = screen.size
    u = (width - 1) / 2 + np.linspace(-0.4, 0.4, 5) * width / max(1, factor)
    v = ((height - 1) / 2 + np.linspace(-0.4, 0.4, 5) * height / max(1, factor))[:, None]
    far_u, far_v = (c + factor * (x - c) for x, c in ((u, (width - 1) / 2), (v, (height - 1) / 2)))
    direction, zoomed_direction = screen.targets_at(u, v), zoomed.targets_at(far_u, far_v)
    is_valid = ~np.isnan(direction) & ~np.isnan(
        zoomed_direction
    )  # the zoomed dome ends at its circle
    assert is_valid.mean() > 0.5
    np.testing.assert_allclose(
        zoomed_direction[is_valid], direction[is_valid], rtol=1e-9, atol=1e-9
    )


@pytest.mark.parametrize("name", SCREENS)
def test_pan_rotates_about_vertical(name):
    screen, _ = SCREENS[name]
    offset = (0.0, 0.0, 0.0)
    if not isinstance(screen, Ground) or not any(screen.offset_mm):
        offset = screen.offset_mm
        c, s = math.cos(math.radians(40)), math.sin(math.radians(40))
        turned = (all_targets(screen) - offset) @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]).T
        np.testing.assert_allclose(all_targets(screen.panned(40.0)) - offset, turned, atol=1e-9)
    assert screen.panned(0.0) == screen or isinstance(screen, Cylinder)


def test_tilt_shifts_view_upwards():
    plane = Plane((5, 5), 10.0, 20.0)
    assert plane.panned(5.0, 10.0) == Plane((5, 5), 15.0, 30.0)
    assert Equirectangular((8, 4), -40.0, 20.0).panned(0.0, 10.0) == Equirectangular(
        (8, 4), -30.0, 30.0
    )
    panned = Cylinder((8, 5), -45.0, 45.0, rows="height").panned(0.0, 45.0)
    assert (panned.tilt_min_deg, panned.tilt_max_deg) == pytest.approx(
        (0.0, math.degrees(math.atan(2)))
    )
    for screen in (
        DomeMaster((5, 5), 90.0),
        LittlePlanet((5, 5)),
        Ground((5, 5), 100.0, 1.0),
        CubeMap((6, 1), "strip"),
    ):
        with pytest.raises(InvalidParameter, match=r"tilt_deg must be 0 .*; got 5 deg"):
            screen.panned(0.0, 5.0)
    with pytest.raises(InvalidParameter, match="got -80 and 100 deg"):
        Cylinder((8, 5), -90.0, 90.0).panned(0.0, 10.0)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan, inf])
def test_invalid_zoom_is_rejected(factor):
    for screen, _ in SHAPES.values():
        with pytest.raises(InvalidParameter, match=r"^zoom "):
            screen.zoomed(factor)
    with pytest.raises(InvalidParameter, match="cannot be zoomed"):
        CubeMap((4, 3)).zoomed(2.0)


# -- mosaics of several views
# ----------------------------------------------------------------------------


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("viewpoint", VIEWPOINTS.values(), ids=VIEWPOINTS)
def test_cube_faces_are_perpendicular_views(layout, viewpoint):
    columns, rows = CubeMap.grid(layout)
    cube = CubeMap((columns * 6, rows * 6), layout, 20.0, *viewpoint)
    assert isinstance(cube, Composite)
    assert not isinstance(cube, Screen)
    assert eval(repr(cube)) == cube
    orientations = {
        "front": (20, 0),
        "right": (110, 0),
        "back": (200, 0),
        "left": (-70, 0),
        "up": (20, 90),
        "down": (20, -90),
    }
    camera = CAMERAS["ball"]
    pixels = source_pixels(camera, cube, exact=True)
    is_covered = np.zeros(pixels.shape[:2], bool)
    for name, (pan, tilt) in orientations.items():
        ((j, i),) = [
            (j, i) for j, row in enumerate(LAYOUTS[layout]) for i, n in enumerate(row) if n == name
        ]
        part = pixels[j * 6 : j * 6 + 6, i * 6 : i * 6 + 6]
        face = Plane((6, 6), pan, tilt, 0.0, 90.0, *viewpoint)
        np.testing.assert_array_equal(part, source_pixels(camera, face, exact=True))
        is_covered[j * 6 : j * 6 + 6, i * 6 : i * 6 + 6] = True
    assert np.isnan(pixels[~is_covered]).all()


def test_adjacent_cube_faces_are_continuous():
    """The last pixel of one face and the first of the next are 0.5 px to either side of their edge."""
    faces = {
        name: all_targets(CubeMap((400, 300)).face(name))
        for name in ("front", "right", "up", "down")
    }
    f = faces["front"]
    for edge, neighbour in (
        (f[:, -1], faces["right"][:, 0]),
        (f[0], faces["up"][-1]),
        (f[-1], faces["down"][0]),
    ):
        a, b = (x / np.linalg.norm(x, axis=-1, keepdims=True) for x in (edge, neighbour))
        angles = np.degrees(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))
        assert angles.max() < 0.6


def test_mosaic_consists_of_its_views():
    """Near and distant views, one of them a mosaic itself; later views cover earlier ones."""
    sensor = CAMERAS["paper-spherical"]
    near, far = Plane((8, 6), 20.0, -20.0, distance_mm=200.0), Plane((8, 6), 20.0, -20.0)
    cube = CubeMap((12, 2), "strip", distance_mm=500.0)
    mosaic = Mosaic(
        (20, 16), ((0, 0, near), (10, 0, far), (3, 7, cube), (1, 1, Equirectangular((4, 2))))
    )
    assert mosaic.parts[0] == ScreenPart(0, 0, near)
    assert len(parts_of(mosaic)) == 9
    assert eval(repr(mosaic)) == mosaic
    expected = np.full((16, 20, 2), np.nan)
    expected[:6, :8] = source_pixels(sensor, near, exact=True)
    expected[:6, 10:18] = source_pixels(sensor, far, exact=True)
    expected[7:9, 3:15] = source_pixels(sensor, cube, exact=True)
    expected[1:3, 1:5] = source_pixels(sensor, Equirectangular((4, 2)))
    np.testing.assert_allclose(
        om.Dewarper(sensor, mosaic).coordinates(exact=True), expected, atol=1e-9
    )
    assert not np.allclose(expected[0, :8], expected[0, 10:18], atol=2.0)
    image = np.full((1024, 1024), 255, np.uint8)
    straight = om.Dewarper(sensor, mosaic, "nearest")(image)
    np.testing.assert_array_equal(straight == 255, ~np.isnan(expected[..., 0]))


def test_mosaic_with_empty_view_contains_others():
    sensor = CAMERAS["paper-spherical"]
    sky = Plane((8, 6), tilt_deg=90.0, hfov_deg=30.0, distance_mm=500.0)
    mosaic = Mosaic.stacked([[sky, Plane((8, 6))]], gap_px=2)
    for viewpoint in ("exact", "single"):
        valid = om.Dewarper(sensor, mosaic, viewpoint=viewpoint).valid
        assert not valid[:, :10].any()
        assert valid[:, 10:].all()


def test_stacked_views_are_centred():
    rows = [[Plane((30, 10))], [Plane((8, 6)), Plane((8, 4))], [Plane((5, 5))]]
    mosaic = Mosaic.stacked(rows, gap_px=2)
    assert mosaic.size == (30, 25)
    assert [p[:2] for p in mosaic.parts] == [(0, 0), (6, 12), (16, 12), (12, 20)]
    zoomed = mosaic.zoomed(2.0).panned(10.0)
    assert [p.view for p in zoomed.parts] == [p.view.zoomed(2.0).panned(10.0) for p in mosaic.parts]


# -- invalid arguments
# -----------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", SHAPES)
def test_invalid_view_positions_are_rejected(shape):
    screen = SHAPES[shape][0]
    with pytest.raises(
        InvalidParameter,
        match=r"offset_mm must be \(0, 0, 0\) for a screen at infinity; got \(0, 0, 9.0\)",
    ):
        replace(screen, offset_mm=(0, 0, 9.0))
    for distance in (0.0, -5.0, np.nan):
        with pytest.raises(InvalidParameter, match="distance_mm must be above 0 mm or infinite"):
            replace(screen, distance_mm=distance)
    for offset in ((0.0, np.nan, 0.0), (0.0, 1.0)):
        with pytest.raises(InvalidParameter, match=r"offset_mm must be finite numbers \(x, y, z\)"):
            replace(screen, distance_mm=100.0, offset_mm=offset)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: Cylinder((5, 5), -90.0, 10.0, rows="height"),
            "above -90 and below 90 deg with rows = 'height'",
        ),
        (
            lambda: Cylinder((5, 5), -9.0, 10.0, rows="mm"),
            "rows must be one of tilt, height; got 'mm'",
        ),
        (
            lambda: Cylinder((5, 5), 10.0, 90.0, rows="height"),
            "above -90 and below 90 deg with rows = 'height'",
        ),
        (
            lambda: Cylinder.wall((5, 5), (100.0, -200.0), 500.0),
            "edge of the wall; got 100 and -200 mm",
        ),
        (lambda: Cylinder.wall((5, 5), (0.0, 9.0), 0.0), "distance_mm must be"),
        (
            lambda: Cylinder((5, 5), -45.0, 9.0, rows="height").panned(0.0, -90.0),
            "tilt_deg must be above -90 and below 90 deg; got -90",
        ),
        (
            lambda: Cylinder.wall((5, 5), (100.0, 100.0), 500.0),
            "edge of the wall; got 100 and 100 mm",
        ),
        (
            lambda: Cylinder((5, 5), -45.0, 9.0, rows="height").panned(0.0, 90.0),
            "tilt_deg must be above -90 and below 90 deg; got 90",
        ),
        (
            lambda: Equirectangular((5, 5), 10.0, -10.0),
            "increase within -90 to 90 deg; got 10 and -10 deg",
        ),
        (lambda: Ground((5, 5), np.nan, 1.0), "height_mm must be finite; got nan"),
        (lambda: Ground((5, 5), 100.0, 0.0), "mm_per_px must be finite and above 0; got 0"),
        (lambda: Ground((5, 5), 100.0, inf), "mm_per_px must be finite and above 0; got inf"),
        (
            lambda: LittlePlanet((5, 5), 360.0),
            "hfov_deg must be above 0 and below 360 deg; got 360",
        ),
        (
            lambda: LittlePlanet((5, 5), pole="south"),
            "pole must be one of nadir, zenith; got 'south'",
        ),
        (
            lambda: CubeMap((5, 5)),
            "4 n x 3 n px for square faces in the layout cross, for example 1024 x 768",
        ),
        (lambda: CubeMap((8, 8), "3x2"), "3 n x 2 n px for square faces in the layout 3x2"),
        (lambda: CubeMap((2, 1), "3x2"), "for square faces"),
        (lambda: CubeMap((6, 1), "row"), "layout must be one of cross, strip, 3x2; got 'row'"),
        (lambda: CubeMap((6, 1), "strip", offset_mm=(1.0, 0.0, 0.0)), "offset_mm must be"),
        (
            lambda: CubeMap((6, 1), "strip").face("top"),
            "one of right, left, up, down, front, back; got 'top'",
        ),
        (lambda: Mosaic((5, 5), ()), "at least one view"),
        (
            lambda: Mosaic((5, 5), ((0, 0, Plane((6, 5))),)),
            r"within the 5 x 5 px of the mosaic; got one from \(0, 0\) to \(6, 5\)",
        ),
        (lambda: Mosaic((9, 9), ((-1, 0, Plane((6, 5))),)), r"got \(-1, 0\)"),
        (lambda: Mosaic((9, 9), ((0, 0.5, Plane((6, 5))),)), r"got \(0, 0.5\)"),
        (lambda: Mosaic.stacked([]), "size"),
        (
            lambda: Mosaic.stacked([[Plane((5, 5))], []]),
            "each row of the mosaic must contain at least one view; got an empty row",
        ),
    ],
)
def test_invalid_screens_are_rejected(make, message):
    with pytest.raises(InvalidParameter, match=message):
        make()
