"""A view as other programs' pinhole camera: against points that are projected by the sensor itself."""

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import OutsideField
from omnimirror.interop.pinholes import pinhole_of

VIEWS = [
    om.screens.Plane((320, 240)),
    om.screens.Plane((321, 200), pan_deg=130.0, tilt_deg=-35.0, roll_deg=20.0, hfov_deg=50.0),
    om.screens.Plane((320, 240), pan_deg=-60.0, hfov_deg=60.0, distance_mm=700.0, offset_mm=(20.0, -10.0, 15.0)),
]


@pytest.mark.parametrize("view", VIEWS, ids=str)
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_a_point_is_where_the_pinhole_says_to_within_the_error_that_is_told(name, view):
    """Points of the world, through the pinhole into the view, and by the view's map into the picture."""
    sensor = om.load_sensor(name)
    pinhole = pinhole_of(sensor, view)
    found = om.Dewarper(sensor, view).coordinates(exact=True)
    rng = np.random.default_rng(5)
    rates = np.stack(np.gradient(found, axis=(1, 0)), axis=-1)  # of source px by px of the view
    for depth_mm in (700.0, 3000.0, 1e8):
        u, v = rng.integers([40, 40], np.subtract(view.size, 40), (40, 2)).T
        away = np.linalg.solve(pinhole.matrix, [u, v, np.ones(40)]).T * depth_mm
        seen = sensor.project(away @ pinhole.rotation.T + pinhole.position_mm).pixels
        told_px = pinhole.error_px(depth_mm)
        off = np.linalg.norm(np.linalg.solve(rates[v, u], (seen - found[v, u])[..., None]), axis=1)
        assert np.nanmax(off) < 1.2 * told_px + 0.01, (depth_mm, told_px)  # it may be seen where the rate is another


def test_the_error_is_nothing_where_there_is_one_viewpoint_and_where_a_view_stands():
    one = pinhole_of(om.load_sensor("paper-hyperboloidal"), VIEWS[1])
    assert max(one.error_px(d) for d in (300.0, 1e4, 1e9)) < 1e-6
    near = pinhole_of(om.load_sensor("paper-spherical"), VIEWS[2])
    assert near.error_px(700.0) < 1e-6
    assert near.error_px(350.0) > 1.0


def test_the_pinhole_of_a_hyperboloid_stands_in_its_focus():
    sensor = om.load_sensor("paper-hyperboloidal")
    radius_mm, x = 1 / sensor.mirror.curvature(np.zeros(1))[0], 30.0
    sag = sensor.mirror.sag(np.array([x]))[0]
    conic = (2 * radius_mm * sag - x**2) / sag**2 - 1  # of x^2 = 2 R s - (1 + k) s^2
    focus_mm = radius_mm / (1 + np.sqrt(-conic))
    assert np.allclose(pinhole_of(sensor, VIEWS[0]).position_mm, [0, 0, focus_mm], atol=1e-6)


def test_the_place_is_the_best_one():
    """No place a little beside it is nearer to the rays, in the mean."""
    pinhole = pinhole_of(om.load_sensor("paper-spherical"), VIEWS[1])
    _, origins, directions = pinhole.rays

    def misses(place):
        towards = place - origins
        return np.sum((towards - np.sum(towards * directions, axis=1, keepdims=True) * directions) ** 2)

    best = misses(pinhole.position_mm)
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert misses(pinhole.position_mm + 0.1 * axis) > best


def test_a_view_of_nothing_is_refused():
    with pytest.raises(OutsideField, match="sees nothing of the camera's field"):
        pinhole_of(om.load_sensor("paper-spherical"), om.screens.Plane((64, 48), tilt_deg=90.0, hfov_deg=30.0))


def test_a_near_view_from_a_single_viewpoint_is_not_exact_and_says_so():
    """By as much as its pixels differ from those of the view in which each point is seen where it is."""
    sensor, view = om.load_sensor("paper-spherical"), om.screens.Plane((640, 480), distance_mm=300.0)
    exact, single = (om.Dewarper(sensor, view, viewpoint=v).coordinates(exact=True) for v in ("exact", "single"))
    rates = np.stack(np.gradient(exact, axis=(1, 0)), axis=-1)
    off = np.linalg.norm(np.linalg.solve(rates, (single - exact)[..., None]), axis=(-1, -2))
    assert pinhole_of(sensor, view, "single").error_px(300.0) == pytest.approx(np.nanmax(off), rel=0.1)
