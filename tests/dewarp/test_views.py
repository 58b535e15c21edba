"""The screens chosen for a camera."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.dewarp import views
from omnimirror.frames import Mount

BALL = om.MirrorBall((499.5, 499.5), 480.0, 260.0, (1000, 1000))
FISHEYE = om.OCam((-250.0, 0.0, 4e-4), (319.5, 239.5), (640, 480), optics="fisheye")


@pytest.mark.parametrize(("looks", "field"), [("up", (-90, 40)), ("down", (-40, 90)), ("forward", (-90, 90))])
def test_elevations_of_a_ball(looks, field):
    seen = views.field_of(replace(BALL, mount=Mount(looks)))
    np.testing.assert_allclose((seen.tilt_min_deg, seen.tilt_max_deg), field, atol=1e-9)


def test_elevations_of_a_level_fisheye_are_those_of_its_picture():
    """The highest pixels seen are in the corners or the middle of the upper edge: both computed here."""
    seen = views.field_of(replace(FISHEYE, mount=Mount("forward")))
    du = np.linspace(-320, 320, 641)
    rho = np.hypot(du, 240.0)
    forward = 250 - 4e-4 * rho**2
    highest = np.degrees(np.arctan2(240.0, np.hypot(du, forward))).max()
    assert seen.tilt_max_deg == pytest.approx(highest, abs=0.02)
    assert seen.tilt_min_deg == pytest.approx(-highest, abs=0.02)


def test_the_field_of_a_stretched_camera_is_sampled():
    straight, stretched = (replace(FISHEYE, affine=(c, 0.0, 0.0)) for c in (1.0, 1.0001))
    a, b = views.field_of(straight), views.field_of(stretched)
    assert stretched.symmetry is None
    assert b.tilt_min_deg == pytest.approx(a.tilt_min_deg, abs=0.05)
    assert b.tilt_max_deg == pytest.approx(a.tilt_max_deg, abs=0.05)


def test_resolution_is_the_mean_one():
    """A ball is exactly equal in area: pi 480^2 pixels for 2 pi (1 - cos 130 deg)."""
    expected = np.sqrt(480**2 / (2 * (1 - np.cos(np.radians(130))))) * np.pi / 180
    for mount in (Mount("up"), Mount("forward")):
        assert views.field_of(replace(BALL, mount=mount)).pixels_per_degree == pytest.approx(expected, rel=0.01)


def test_sizes_are_chosen_or_completed():
    free = om.views.panorama(BALL)
    assert (free.tilt_min_deg, free.tilt_max_deg) == pytest.approx((-90, 40))
    assert free.size[0] / free.size[1] == pytest.approx(360 / 130, rel=0.01)
    assert om.views.panorama(BALL, (1440, None)).size == (1440, 520)
    assert om.views.panorama(BALL, (None, 520)).size == (1440, 520)
    assert om.views.panorama(BALL, (7, 9)).size == (7, 9)
    assert om.views.panorama(BALL, (600, None), span_deg=60, elevation_deg=(-10.0, 20.0)).size == (600, 300)
    assert om.views.perspective().size == (1280, 720)
    assert om.views.perspective((640, None)).size == (640, 360)
    assert om.views.dome(BALL, (None, 300)).size == (300, 300)


@pytest.mark.parametrize(
    ("looks", "pole", "end"), [("up", "nadir", 130), ("down", "zenith", 130), ("forward", "nadir", 180)]
)
def test_a_dome_is_drawn_about_the_pole_that_is_seen(looks, pole, end):
    camera = replace(BALL, mount=Mount(looks))
    dome = om.views.dome(camera)
    assert dome.pole == pole
    assert dome.omega_max_deg == pytest.approx(end)
    valid = om.Dewarper(camera, replace(dome, size=(200, 200))).valid
    if looks != "forward":
        assert valid.mean() == pytest.approx(np.pi / 4, abs=0.01)


def test_a_dome_of_a_fisheye_looking_up_is_about_the_zenith():
    assert om.views.dome(FISHEYE).pole == "zenith"
    assert om.views.dome(replace(FISHEYE, affine=(1.0001, 0.0, 0.0), mount=Mount("down"))).pole == "nadir"
