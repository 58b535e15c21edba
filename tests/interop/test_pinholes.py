"""Equivalent pinhole cameras against projections by the sensor."""

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OutsideField
from omnimirror.interop.pinholes import equivalent_pinhole

VIEWS = [
    om.screens.Plane((320, 240)),
    om.screens.Plane((321, 200), pan_deg=130.0, tilt_deg=-35.0, roll_deg=20.0, hfov_deg=50.0),
    om.screens.Plane(
        (320, 240), pan_deg=-60.0, hfov_deg=60.0, distance_mm=700.0, offset_mm=(20.0, -10.0, 15.0)
    ),
]


@pytest.mark.parametrize("view", VIEWS, ids=str)
@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_reprojection_error_is_at_most_the_reported_error(name, view):
    """Project world points with the pinhole and with the sensor; compare in pixels of the view."""
    sensor = om.load_sensor(name)
    pinhole = equivalent_pinhole(sensor, view)
    sources = om.Dewarper(sensor, view).coordinates(exact=True)
    rng = np.random.default_rng(5)
    rates = np.stack(np.gradient(sources, axis=(1, 0)), axis=-1)  # source px per px of the view
    for depth_mm in (700.0, 3000.0, 1e8):
        u, v = rng.integers([40, 40], np.subtract(view.size, 40), (40, 2)).T
        points = np.linalg.solve(pinhole.matrix, [u, v, np.ones(40)]).T * depth_mm
        projected = sensor.project(points @ pinhole.rotation.T + pinhole.position_mm).pixels
        reported_px = pinhole.error_px(depth_mm)
        error = np.linalg.norm(
            np.linalg.solve(rates[v, u], (projected - sources[v, u])[..., None]), axis=1
        )
        assert np.nanmax(error) < 1.2 * reported_px + 0.01, (
            depth_mm,
            reported_px,
        )  # the Jacobian varies


def test_error_vanishes_for_a_single_viewpoint_and_at_the_view_distance():
    central = equivalent_pinhole(om.load_sensor("paper-hyperboloidal"), VIEWS[1])
    assert max(central.error_px(d) for d in (300.0, 1e4, 1e9)) < 1e-6
    near = equivalent_pinhole(om.load_sensor("paper-spherical"), VIEWS[2])
    assert near.error_px(700.0) < 1e-6
    assert near.error_px(350.0) > 1.0


def test_pinhole_of_a_hyperboloid_is_at_its_focus():
    sensor = om.load_sensor("paper-hyperboloidal")
    radius_mm, x = 1 / sensor.mirror.curvature(np.zeros(1))[0], 30.0
    sag = sensor.mirror.sag(np.array([x]))[0]
    conic = (2 * radius_mm * sag - x**2) / sag**2 - 1  # of x^2 = 2 R s - (1 + k) s^2
    focus_mm = radius_mm / (1 + np.sqrt(-conic))
    assert np.allclose(
        equivalent_pinhole(sensor, VIEWS[0]).position_mm, [0, 0, focus_mm], atol=1e-6
    )


def test_position_minimises_the_distance_to_the_rays():
    """Shifts of 0.1 mm along all axes increase the sum of squared distances."""
    pinhole = equivalent_pinhole(om.load_sensor("paper-spherical"), VIEWS[1])
    _, origins, directions = pinhole.rays

    def squared_distances(position):
        offset = position - origins
        along = np.sum(offset * directions, axis=1, keepdims=True)
        return np.sum((offset - along * directions) ** 2)

    best = squared_distances(pinhole.position_mm)
    for axis in np.vstack([np.eye(3), -np.eye(3)]):
        assert squared_distances(pinhole.position_mm + 0.1 * axis) > best


def test_view_outside_the_field_raises():
    with pytest.raises(OutsideField, match="is outside the field of the camera"):
        equivalent_pinhole(
            om.load_sensor("paper-spherical"),
            om.screens.Plane((64, 48), tilt_deg=90.0, hfov_deg=30.0),
        )


def test_error_of_a_near_view_with_a_single_viewpoint():
    """The reported error equals the difference between the maps of both viewpoint modes."""
    sensor, view = (
        om.load_sensor("paper-spherical"),
        om.screens.Plane((640, 480), distance_mm=300.0),
    )
    exact, single = (
        om.Dewarper(sensor, view, viewpoint=v).coordinates(exact=True) for v in ("exact", "single")
    )
    rates = np.stack(np.gradient(exact, axis=(1, 0)), axis=-1)
    error = np.linalg.norm(np.linalg.solve(rates, (single - exact)[..., None]), axis=(-1, -2))
    assert equivalent_pinhole(sensor, view, "single").error_px(300.0) == pytest.approx(
        np.nanmax(error), rel=0.1
    )
