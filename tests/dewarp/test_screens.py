"""Screens against the formulas of the conventions, written out pixel by pixel."""

import math

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.screens import Cylinder, DomeMaster, Equirectangular, Plane, Screen


def world(pan, tilt):
    """x forward, y left, z up; pan to the right."""
    return np.array(
        [math.cos(tilt) * math.cos(pan), -math.cos(tilt) * math.sin(pan), math.sin(tilt)]
    )


def whole(screen):
    return screen.targets(0, screen.size[1])


@pytest.mark.parametrize(
    "screen",
    [
        Cylinder((7, 5), -30.0, 45.0, 10.0, 300.0),
        Plane((7, 5), 20.0, -30.0, 40.0, 100.0),
        DomeMaster((7, 5), 120.0),
        DomeMaster((4, 8), 120.0, "zenith", 30.0, 20.0),
    ],
)
def test_screen_implements_protocol(screen):
    assert isinstance(screen, Screen)
    targets = whole(screen)
    assert targets.shape == (screen.size[1], screen.size[0], 3)
    np.testing.assert_array_equal(screen.targets(2, 4), targets[2:4])
    assert str(screen)
    assert eval(repr(screen), {**globals(), "inf": np.inf}) == screen


def test_panorama_columns_and_rows():
    W, H, centre, span, low, high = 9, 6, 25.0, 300.0, -40.0, 70.0
    targets = whole(Cylinder((W, H), low, high, centre, span))
    for u in range(W):
        for v in range(H):
            pan = centre + ((u + 0.5) / W - 0.5) * span
            tilt = high - (v + 0.5) / H * (high - low)
            np.testing.assert_allclose(
                targets[v, u], world(math.radians(pan), math.radians(tilt)), atol=1e-14
            )


def test_panorama_right_is_right_of_forward():
    targets = whole(om.screens.Cylinder((360, 2), -1.0, 1.0))
    assert targets[0, 181, 1] < 0 < targets[0, 178, 1]  # y is left
    assert targets[0, 0, 2] > 0 > targets[1, 0, 2]  # the upper row is directed upwards


def test_perspective_pixel_directions():
    W, H, pan, tilt, roll, hfov = (
        8,
        5,
        math.radians(35),
        math.radians(-20),
        math.radians(15),
        math.radians(80),
    )
    targets = whole(Plane((W, H), 35.0, -20.0, 15.0, 80.0))
    f = world(pan, tilt)
    right = np.array([-math.sin(pan), -math.cos(pan), 0.0])
    down = np.cross(f, right)
    turned_right = math.cos(roll) * right + math.sin(roll) * down
    turned_down = -math.sin(roll) * right + math.cos(roll) * down
    F = W / 2 / math.tan(hfov / 2)
    for u in range(W):
        for v in range(H):
            d = f + (u - (W - 1) / 2) / F * turned_right + (v - (H - 1) / 2) / F * turned_down
            np.testing.assert_allclose(targets[v, u], d, atol=1e-14)


def test_hfov_spans_outer_pixel_edges():
    plane = Plane((1000, 3), hfov_deg=120.0)
    row = whole(plane)[1]
    left, right = row[0] + (row[0] - row[1]) / 2, row[-1] + (row[-1] - row[-2]) / 2
    angle = np.degrees(np.arccos(left @ right / np.linalg.norm(left) / np.linalg.norm(right)))
    assert angle == pytest.approx(120.0)


@pytest.mark.parametrize(("pole", "side"), [("nadir", 1.0), ("zenith", -1.0)])
def test_dome_forward_is_at_top(pole, side):
    """Downwards, right is right; upwards, right is left (a star chart)."""
    dome = DomeMaster((101, 101), 120.0, pole)
    targets = whole(dome)
    up = -1.0 if pole == "nadir" else 1.0
    np.testing.assert_allclose(targets[50, 50], [0, 0, up], atol=1e-15)
    omega = math.radians(40 * 120.0 / 50.5)
    np.testing.assert_allclose(
        targets[10, 50], [math.sin(omega), 0, up * math.cos(omega)], atol=1e-14
    )
    np.testing.assert_allclose(
        targets[50, 90], [0, -side * math.sin(omega), up * math.cos(omega)], atol=1e-14
    )


def test_dome_is_equidistant_and_rotates_with_pan():
    targets = whole(DomeMaster((64, 64), 130.0, pan_deg=90.0, omega_min_deg=20.0))
    v, u = np.mgrid[:64, :64]
    radius = np.hypot(u - 31.5, v - 31.5)
    omega = np.degrees(np.arccos(-targets[..., 2]))
    visible = ~np.isnan(omega)
    np.testing.assert_allclose(omega[visible], radius[visible] * 130 / 32, rtol=1e-9)
    np.testing.assert_array_equal(visible, (radius <= 32) & (radius * 130 / 32 >= 20))
    top = targets[2, 32]
    assert top[1] < -0.9 * np.hypot(*top[:2])  # the top is to the right


@pytest.mark.parametrize(
    ("construct", "message"),
    [
        (lambda: Cylinder((0, 5), -10.0, 10.0), "size"),
        (lambda: Cylinder((5, 200_000), -10.0, 10.0), "size"),
        (lambda: Cylinder((5, 5), 10.0, 10.0), "increase within -90 to 90 deg; got 10 and 10 deg"),
        (lambda: Cylinder((5, 5), -91.0, 10.0), "-91 and 10"),
        (lambda: Cylinder((5, 5), -10.0, 90.5), "-10 and 90.5"),
        (
            lambda: Cylinder((5, 5), -10.0, 10.0, span_deg=1e-6),
            "span_deg must be above 1e-06 and up to 360 deg; got 1e-06",
        ),
        (lambda: Cylinder((5, 5), -np.nan, 10.0), "^tilt_min_deg .*nan"),
        (lambda: Cylinder((5, 5), -10.0, 10.0, span_deg=361.0), "span_deg must be .*; got 361"),
        (lambda: Cylinder((5, 5), -10.0, 10.0, span_deg=0.0), "span_deg must be .*; got 0"),
        (
            lambda: Cylinder((5, 5), -10.0, 10.0, pan_deg=np.inf),
            "pan_deg must be a finite number; got inf",
        ),
        (
            lambda: Plane((5, 5), hfov_deg=180.0),
            "hfov_deg must be above 0 and below 180 deg; got 180",
        ),
        (lambda: Plane((5, 5), tilt_deg=np.nan), "tilt_deg must be a finite number; got nan"),
        (lambda: DomeMaster((5, 5), 181.0), "within 0 to 180 deg; got 0 and 181 deg"),
        (lambda: DomeMaster((5, 5), 90.0, omega_min_deg=90.0), "got 90 and 90"),
        (
            lambda: DomeMaster((5, 5), 90.0, "north"),
            "pole must be one of nadir, zenith; got 'north'",
        ),
    ],
)
def test_invalid_screen_raises(construct, message):
    with pytest.raises(InvalidParameter, match=message):
        construct()


@pytest.mark.parametrize(
    ("layout", "ffmpeg", "size"), [("3x2", "c3x2", (300, 200)), ("strip", "c6x1", (600, 100))]
)
def test_cube_map_matches_ffmpeg(layout, ffmpeg, size):
    """The v360 filter of FFmpeg converts a cube map to the correct sphere and not to its mirror
    image."""
    av = pytest.importorskip("av")
    camera = om.MirrorBall(
        centre_px=(300.0, 300.0), rim_radius_px=290.0, field_deg=300.0, image_size=(601, 601)
    )
    v, u = np.mgrid[:601, :601]
    image = np.dstack([u / 3, v / 3, 100 + 90 * np.sin(u / 40) * np.sin(v / 60)]).astype(np.uint8)
    sphere = om.Dewarper(camera, om.screens.Equirectangular((400, 200)))
    cube = om.Dewarper(camera, om.screens.CubeMap(size, layout))(image)
    graph = av.filter.Graph()
    first = graph.add_buffer(width=size[0], height=size[1], format="rgb24", time_base=1)
    turn, last = graph.add("v360", f"input={ffmpeg}:output=e:w=400:h=200"), graph.add("buffersink")
    first.link_to(turn)
    turn.link_to(last)
    graph.configure()
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(cube), "rgb24")
    frame.pts, frame.time_base = 0, 1
    first.push(frame)
    output = last.pull().to_ndarray(format="rgb24").astype(int)
    inside = cv2.erode(sphere.valid.astype(np.uint8), np.ones((9, 9))) > 0
    expected = sphere(image)
    assert np.abs(output - expected)[inside].mean() < 2
    assert np.abs(output[:, ::-1] - expected)[inside].mean() > 20


@pytest.mark.parametrize("kind", [Cylinder, Equirectangular])
def test_panorama_zoom_is_limited_and_described(kind):
    part = kind((90, 40), -20.0, 25.0, pan_deg=30.0, span_deg=300.0)
    name = "panorama" if kind is Cylinder else "sphere"
    assert str(part) == f"{name} (300 deg around pan 30, elevation -20 to 25 deg)"
    closer, wider, whole = (part.zoomed(factor) for factor in (2.0, 0.8, 0.1))
    assert (closer.tilt_min_deg, closer.tilt_max_deg, closer.span_deg) == (-8.75, 13.75, 150.0)
    assert (wider.tilt_min_deg, wider.tilt_max_deg, wider.span_deg) == (-25.625, 30.625, 360.0)
    assert (whole.tilt_min_deg, whole.tilt_max_deg, whole.span_deg) == (-90.0, 90.0, 360.0)
    assert str(whole) == f"{name} (elevation -90 to 90 deg)"
    narrow = kind((9, 4), 0.0, 1e-6, span_deg=0.5)
    assert (narrow.tilt_max_deg, narrow.span_deg) == (1e-6, 0.5)
    for upper in (-20.0 + 1e-7, -20.0 + 1e-12):
        with pytest.raises(
            InvalidParameter, match=r"tilt_max_deg must be at least .*; got -20 and -20 deg"
        ):
            kind((90, 40), -20.0, upper)


def test_walls_are_complete_cylinders_by_default():
    wall = Cylinder.wall((40, 30), (-0.5, 0.5), distance_mm=0.5)
    assert wall == Cylinder((40, 30), -45.0, 45.0, 0.0, 360.0, "height", 0.5, (0.0, 0.0, 0.0))
    wall_from_joined_name = Cylinder(
        (40, 30), -45.0, 45.0, rows="".join(["hei", "ght"]), distance_mm=0.5
    )
    np.testing.assert_array_equal(whole(wall_from_joined_name), whole(wall))
    np.testing.assert_allclose(np.hypot(*whole(wall)[..., :2].T), 0.5)
    zoomed, lower = wall.zoomed(2.0), wall_from_joined_name.panned(30.0, -89.5)
    assert (zoomed.tilt_min_deg, zoomed.tilt_max_deg) == pytest.approx(
        (-math.degrees(math.atan(0.5)), math.degrees(math.atan(0.5)))
    )
    shift = math.tan(math.radians(-89.5))
    assert (lower.pan_deg, lower.tilt_max_deg) == pytest.approx(
        (30.0, math.degrees(math.atan(1 + shift)))
    )
    tilted = Cylinder((4, 4), -10.0, 10.0, rows="".join(["ti", "lt"])).panned(0.0, 5.0)
    assert (tilted.tilt_min_deg, tilted.tilt_max_deg) == (-5.0, 15.0)
