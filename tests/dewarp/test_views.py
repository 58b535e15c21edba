"""Default screens of cameras."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp import views
from omnimirror.dewarp.view_geometry import field_of, pole_of
from omnimirror.dewarp.views import MAX_PLANET_DEG

from ..conftest import sensor_of

BALL = om.MirrorBall(
    centre_px=(499.5, 499.5), rim_radius_px=480.0, field_deg=260.0, image_size=(1000, 1000)
)
FISHEYE = om.OCam(
    polynomial=(-250.0, 0.0, 4e-4),
    centre_px=(319.5, 239.5),
    image_size=(640, 480),
    optics="fisheye",
)


@pytest.mark.parametrize(
    ("looks", "field"), [("up", (-90, 40)), ("down", (-40, 90)), ("forward", (-90, 90))]
)
def test_mirror_ball_elevations(looks, field):
    limits = field_of(replace(BALL, mount=Mount(looks)))
    np.testing.assert_allclose((limits.tilt_min_deg, limits.tilt_max_deg), field, atol=1e-9)


def test_level_fisheye_elevations():
    """The highest visible pixels are at the corners or the centre of the upper edge; both are
    computed here."""
    limits = field_of(replace(FISHEYE, mount=Mount("forward")))
    du = np.linspace(-320, 320, 641)
    rho = np.hypot(du, 240.0)
    forward = 250 - 4e-4 * rho**2
    highest = np.degrees(np.arctan2(240.0, np.hypot(du, forward))).max()
    assert limits.tilt_max_deg == pytest.approx(highest, abs=0.02)
    assert limits.tilt_min_deg == pytest.approx(-highest, abs=0.02)


def test_field_of_stretched_camera_is_sampled():
    dewarped, stretched = (replace(FISHEYE, affine=(c, 0.0, 0.0)) for c in (1.0, 1.0001))
    a, b = field_of(dewarped), field_of(stretched)
    assert stretched.symmetry is None
    assert b.tilt_min_deg == pytest.approx(a.tilt_min_deg, abs=0.05)
    assert b.tilt_max_deg == pytest.approx(a.tilt_max_deg, abs=0.05)


class Unsymmetric:
    """Camera without a known symmetry."""

    symmetry = None

    def __init__(self, camera: om.Sensor):
        self.image_size = camera.image_size
        self.project, self.project_directions = camera.project, camera.project_directions
        self.backproject = camera.backproject


@pytest.mark.parametrize(
    "kind", ["sphere", "cone", "paraboloid", "slope-spline", "equidistant", "tabulated-mapping"]
)
@pytest.mark.parametrize("looks", ["up", "down"])
def test_field_within_image_matches_sampled_rays(kind, looks):
    sensor = replace(sensor_of(kind), mount=Mount(looks))
    exact, traced = field_of(sensor), field_of(Unsymmetric(sensor))
    assert exact.pixels_per_degree == traced.pixels_per_degree
    assert exact.tilt_min_deg == pytest.approx(
        traced.tilt_min_deg, abs=1.5
    )  # to the distance of its samples
    assert exact.tilt_max_deg == pytest.approx(traced.tilt_max_deg, abs=1.5)
    assert (exact.pole, traced.pole) == (pole_of(sensor), pole_of(Unsymmetric(sensor)))


def test_resolution_is_mean():
    """A ball is exactly equal-area: pi 480^2 pixels for 2 pi (1 - cos 130 deg)."""
    expected = np.sqrt(480**2 / (2 * (1 - np.cos(np.radians(130))))) * np.pi / 180
    for mount in (Mount("up"), Mount("forward")):
        assert field_of(replace(BALL, mount=mount)).pixels_per_degree == pytest.approx(
            expected, rel=0.01
        )


def test_sizes_are_selected_or_completed():
    free = om.views.panorama(BALL)
    assert (free.tilt_min_deg, free.tilt_max_deg) == pytest.approx((-90, 40))
    assert free.size[0] / free.size[1] == pytest.approx(360 / 130, rel=0.01)
    assert om.views.panorama(BALL, (1440, None)).size == (1440, 520)
    assert om.views.panorama(BALL, (None, 520)).size == (1440, 520)
    assert om.views.panorama(BALL, (7, 9)).size == (7, 9)
    assert om.views.panorama(BALL, (600, None), span_deg=60, elevation_deg=(-10.0, 20.0)).size == (
        600,
        300,
    )
    assert om.views.perspective().size == (1280, 720)
    assert om.views.perspective((640, None)).size == (640, 360)
    assert om.views.dome(BALL, (None, 300)).size == (300, 300)


@pytest.mark.parametrize(
    ("looks", "pole", "end"),
    [("up", "nadir", 130), ("down", "zenith", 130), ("forward", "nadir", 180)],
)
def test_dome_pole_follows_field(looks, pole, end):
    camera = replace(BALL, mount=Mount(looks))
    dome = om.views.dome(camera)
    assert dome.pole == pole
    assert dome.omega_max_deg == pytest.approx(end)
    valid = om.Dewarper(camera, replace(dome, size=(200, 200))).valid
    if looks != "forward":
        assert valid.mean() == pytest.approx(np.pi / 4, abs=0.01)


def test_dome_of_upward_fisheye_uses_zenith():
    assert om.views.dome(FISHEYE).pole == "zenith"
    assert (
        om.views.dome(replace(FISHEYE, affine=(1.0001, 0.0, 0.0), mount=Mount("down"))).pole
        == "nadir"
    )


SPHERE = om.load_sensor("paper-spherical")


def test_default_view_sizes():
    scale = field_of(BALL).pixels_per_degree
    assert views.sphere(BALL).size == (2 * views.sphere(BALL).size[1], views.sphere(BALL).size[1])
    assert views.sphere(BALL).size[1] == pytest.approx(180 * scale, abs=2)
    assert views.sphere(BALL, (200, None)).size == (200, 100)
    assert views.sphere(BALL, (200, None), span_deg=90, elevation_deg=(-20.0, 10.0)).size == (
        200,
        67,
    )
    assert views.planet(BALL, (None, 300)).size == (300, 300)
    assert views.planet(BALL).hfov_deg == pytest.approx(260)
    assert views.planet(replace(BALL, mount=Mount("forward"))).hfov_deg == MAX_PLANET_DEG
    assert views.planet(BALL, pole="zenith").pole == "zenith"
    plan = views.ground(BALL, 1500.0)
    assert plan.mm_per_px == pytest.approx(1500 * np.radians(1) / scale)
    assert plan.size[0] * plan.mm_per_px == pytest.approx(6000, abs=2 * plan.mm_per_px)
    assert views.ground(BALL, 1500.0, mm_per_px=10.0).size == (600, 600)
    for layout, (columns, rows) in {"cross": (4, 3), "strip": (6, 1), "3x2": (3, 2)}.items():
        cube = views.cube(BALL, layout=layout)
        assert cube.face_px == pytest.approx(90 * scale, abs=2)
        assert cube.size == (columns * cube.face_px, rows * cube.face_px)
        assert views.cube(BALL, (columns * 50, None), layout=layout).face_px == 50
    wall = views.panorama(
        BALL, rows="height", elevation_deg=(-45.0, 45.0), size=(None, 200), span_deg=180.0
    )
    assert wall.size[0] == pytest.approx(200 * np.pi / 2, abs=1)  # square at the horizon


def test_mosaic_is_panorama_over_quarter_views():
    mosaic = views.mosaic(SPHERE, (1600, None), pan_deg=10.0, tilt_deg=-15.0, distance_mm=900.0)
    panorama, *quarters = mosaic.parts
    assert mosaic.size == (1600, panorama.view.size[1] + 300)
    assert isinstance(panorama.view, om.screens.Cylinder)
    for part in quarters:
        assert (part.view.size, part.view.tilt_deg, part.view.distance_mm) == (
            (400, 300),
            -15.0,
            900.0,
        )
        middle = panorama.view.pans()[part.left + 199 : part.left + 201].mean()
        assert np.cos(middle - np.radians(part.view.pan_deg)) == pytest.approx(1)
    assert [part.view.pan_deg for part in quarters] == [-80, 10, 100, 190]
    with pytest.raises(InvalidParameter, match=r"height of a mosaic must be None, .*; got 90 px"):
        views.mosaic(SPHERE, (None, 90))


def test_presets_place_one_screen():
    """Edges of the screen from the projector, in screen widths."""
    for name, away in (("distant", 2.0), ("wide", 0.5)):
        plane = views.preset(
            name,
            (640, 360),
            pan_deg=30.0,
            tilt_deg=-10.0,
            distance_mm=700.0,
            offset_mm=(1.0, 2.0, 3.0),
        )
        assert np.tan(np.radians(plane.hfov_deg / 2)) == pytest.approx(0.5 / away)
        assert (plane.pan_deg, plane.tilt_deg, plane.distance_mm) == (30.0, -10.0, 700.0)
    bent = views.preset("super-wide", (640, 360), pan_deg=30.0)
    assert bent.span_deg == pytest.approx(180)
    assert np.ptp(np.tan(np.radians([bent.tilt_min_deg, bent.tilt_max_deg]))) == pytest.approx(
        np.pi * 360 / 640
    )
    raised = views.preset("super-wide", (640, 360), tilt_deg=20.0)
    middle = np.tan(np.radians([raised.tilt_min_deg, raised.tilt_max_deg])).mean()
    assert middle == pytest.approx(np.tan(np.radians(20)))
    with pytest.raises(InvalidParameter, match="one of distant, wide, super-wide; got 'tele'"):
        views.preset("tele")


@pytest.mark.parametrize("factor", [1.0, 3.0])
def test_view_resolution_matches_image(factor):
    """Straight down, a ball has A/2 px per radian, and sideways equal area: sin(Omega/2) = r/A."""
    ball_px = 480 / np.sin(np.radians(65))
    plan = om.screens.Ground((101, 101), 1000.0, 1.0 / factor)
    assert views.resolution(BALL, plan) == pytest.approx(ball_px / 2 / 1000 / factor, rel=1e-3)
    view = om.screens.Plane((101, 101), hfov_deg=20.0).zoomed(factor)
    assert views.resolution(BALL, view) == pytest.approx(ball_px / 2 / view.focal_px, rel=1e-2)
    both = om.screens.Mosaic.stacked(
        [[plan, view, om.screens.Plane((9, 9), tilt_deg=90.0, hfov_deg=20.0)]]
    )
    assert views.resolution(BALL, both) == min(views.resolution(BALL, v) for v in (plan, view))


def test_resolution_is_measured_inside_field():
    half_visible = om.screens.Plane(
        (101, 201), tilt_deg=60.0, hfov_deg=60.0
    )  # the field ends at 40 deg
    assert 0 < views.resolution(BALL, half_visible) < 20
    assert np.isnan(
        views.resolution(BALL, om.screens.Plane((101, 101), tilt_deg=90.0, hfov_deg=30.0))
    )
    assert np.isnan(views.resolution(BALL, om.screens.Plane((1, 9))))


def test_max_zoom():
    view = om.screens.Plane((640, 480), hfov_deg=90.0)
    zoom = views.max_zoom(SPHERE, view)
    assert zoom > 1
    assert 1 / views.resolution(SPHERE, view.zoomed(zoom)) == pytest.approx(
        views.MAX_MAGNIFICATION, rel=1e-3
    )
    assert views.max_zoom(SPHERE, view.zoomed(50.0)) == 1.0
    assert views.max_zoom(SPHERE, om.screens.Plane((1, 1))) == np.inf


@pytest.mark.parametrize("radius", [98.0, 243.0, 255.5])
def test_equirectangular_aspect_ratio(radius):
    ball = om.MirrorBall(
        centre_px=(255.5, 255.5), rim_radius_px=radius, field_deg=300.0, image_size=(512, 512)
    )
    for side in (1, 7, 50, 333, 720, 899):
        assert om.views.sphere(ball, (2 * side, None)).size == (2 * side, side)
        assert om.views.sphere(ball, (None, side)).size == (2 * side, side)
    part = om.views.sphere(ball, (240, None), span_deg=120.0, elevation_deg=(-20.1, 39.9))
    assert part.size == (240, 120)
    width, height = om.views.sphere(ball).size
    assert width == 2 * height
    assert om.views.sphere(ball, (1441, 720)).size == (1441, 720), "as asked"
    with pytest.raises(
        InvalidParameter, match=r"width must be even for an equirectangular image .*; got 1441 px"
    ):
        om.views.sphere(ball, (1441, None))


@pytest.mark.parametrize("size", [(None, None), (64, None), (64, 48)])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"height_mm": 0.0}, "height_mm must not be 0"),
        ({"height_mm": 900.0, "mm_per_px": 0.0}, "mm_per_px must be .*above 0; got 0"),
        ({"height_mm": 900.0, "mm_per_px": -1.0}, "mm_per_px must be .*above 0; got -1"),
    ],
)
def test_zero_scales_of_plans_are_rejected(size, options, message):
    with pytest.raises(InvalidParameter, match=message):
        views.ground(BALL, size=size, **options)


def test_zero_sizes_are_rejected():
    """Zero is a value, not a missing one."""
    with pytest.raises(InvalidParameter, match="nonzero; got 0 x 0 px"):
        views.ground(BALL, 0.0, size=(64, None), mm_per_px=10.0)
    with pytest.raises(InvalidParameter, match="hfov_deg must be"):
        views.planet(BALL, (64, 64), hfov_deg=0.0)
