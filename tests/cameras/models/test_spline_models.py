"""Spline models against SciPy splines, finite rays of a sensor, and triangles."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.models import RadialSpline, Unified, ViewpointSpline

RADII = (44.0, 92.0, 143.0, 191.0, 230.0)
HEIGHTS = (-2.0, -1.5, 0.3, 2.5, 5.0)
CAMERA = ViewpointSpline(
    radii_px=RADII,
    viewpoints_mm=HEIGHTS,
    field_deg=230.0,
    centre_px=(320.0, 238.0),
    image_size=(640, 480),
)
KNOTS = np.radians(115.0) * np.arange(1, 6) / 5


def test_radius_is_odd_spline():
    """SciPy spline through knots mirrored about the axis."""
    mirrored = CubicSpline(
        np.concatenate([-KNOTS[::-1], [0], KNOTS]), [*np.negative(RADII)[::-1], 0, *RADII]
    )
    omega = np.linspace(0, KNOTS[-1], 200)
    projection = CAMERA.image(
        np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1), distant=True
    )
    np.testing.assert_allclose(projection.pixels[:-1, 0] - 320.0, mirrored(omega[:-1]), atol=1e-10)


def test_viewpoint_is_even_spline():
    mirrored = CubicSpline(np.concatenate([-KNOTS[::-1], KNOTS]), [*HEIGHTS[::-1], *HEIGHTS])
    symmetry = CAMERA.symmetry
    omega = np.linspace(0.01, symmetry.omega_max, 200)
    across, along = symmetry.origin_mm(omega)
    np.testing.assert_allclose(along - across / np.tan(omega), mirrored(omega), atol=1e-10)


@pytest.mark.parametrize("distance_mm", [15.0, 100.0, 1e4])
def test_points_on_ray_project_to_pixel(distance_mm):
    omega = np.linspace(0, 0.999 * CAMERA.model_end, 100)
    heights = CubicSpline(np.concatenate([-KNOTS[::-1], KNOTS]), [*HEIGHTS[::-1], *HEIGHTS])(omega)
    points = np.stack(
        [0 * omega, distance_mm * np.sin(omega), -heights - distance_mm * np.cos(omega)], axis=-1
    )
    projection = CAMERA.image(points)
    assert projection.valid.all()
    np.testing.assert_allclose(
        projection.pixels[:, 1] - 238.0, CAMERA.radius_from_omega(omega), atol=1e-9
    )


@pytest.mark.parametrize("kind", [RadialSpline, ViewpointSpline])
@pytest.mark.parametrize("xi", [0.0, 0.5, 0.95, 1.0])
def test_unbounded_model_is_fitted_within_image(xi, kind):
    camera = Unified(
        xi=xi, focal_px=(200.0, 200.0), centre_px=(320.0, 240.0), image_size=(640, 480)
    )
    m = np.hypot(320.5, 240.5) / 200.0  # of the corner: sin / (cos + xi)
    expected = np.degrees(np.arctan(m) + np.arcsin(xi * m / np.hypot(1, m)))
    spline = kind.from_model(camera)
    assert spline.field_deg / 2 == pytest.approx(expected, abs=0.5)
    omega = np.radians(np.linspace(0.1, 0.95 * expected, 50))
    directions = np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1)
    assert (
        np.abs(
            spline.image(directions, distant=True).pixels
            - camera.image(directions, distant=True).pixels
        ).max()
        < 0.6
    )


@pytest.mark.parametrize("kind", [RadialSpline, ViewpointSpline])
def test_fitted_spline_has_sufficient_knots(kind):
    """Radii of a single-viewpoint mirror increase progressively towards the rim; nearly linear ones
    need few knots."""
    steep = Unified(
        xi=1.0, focal_px=(400.0, 400.0), centre_px=(511.5, 511.5), image_size=(1024, 1024)
    )
    even = Unified(
        xi=4.0, focal_px=(1500.0, 1500.0), centre_px=(511.5, 511.5), image_size=(1024, 1024)
    )
    for camera, field, more in ((steep, 270.0, True), (even, 120.0, False)):
        spline = kind.from_model(camera, field_deg=field)
        omega = np.radians(np.linspace(0.1, field / 2, 500))
        directions = np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1)
        difference = (
            spline.image(directions, distant=True).pixels
            - camera.image(directions, distant=True).pixels
        )
        assert np.nanmax(np.abs(difference)) < 0.5
        assert (len(spline.radii_px) > 8) == more
        assert len(kind.from_model(camera, 5, field).radii_px) == 5


def test_points_within_caustic_are_invalid():
    assert 1.0 < CAMERA.nearest_mm < 15.0
    for factor in (0.99, 1.01):
        point = [[0.0, 0.0, -CAMERA._heights(np.zeros(1))[0] - factor * CAMERA.nearest_mm]]
        assert CAMERA.image(point).valid.tolist() == [factor > 1]


def test_constant_viewpoint_equals_central_model():
    central = RadialSpline(
        radii_px=RADII,
        field_deg=230.0,
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
        stretch_x=0.01,
        shear=-0.02,
        p1=1e-5,
        p2=2e-5,
    )
    shifted = ViewpointSpline(
        radii_px=RADII,
        viewpoints_mm=(3.0,) * 5,
        field_deg=230.0,
        centre_px=(320.0, 238.0),
        image_size=(640, 480),
        stretch_x=0.01,
        shear=-0.02,
        p1=1e-5,
        p2=2e-5,
    )
    points = np.random.default_rng(0).normal(size=(300, 3)) * 100
    a, b = central.image(points), shifted.image(points - 3.0 * np.eye(3)[2])
    np.testing.assert_allclose(a.pixels, b.pixels, atol=1e-9)
    np.testing.assert_allclose(a.d_points, b.d_points, atol=1e-9)


@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant"])
def test_viewpoint_spline_fits_noncentral_mirror(name):
    """Points at finite distances by the rays of the sensor: the spline of eight knots has small
    errors, a central one much larger ones."""
    sensor = om.load_sensor(name)
    symmetry = sensor.symmetry
    end = 0.995 * symmetry.omega_max
    knots = end * np.arange(1, 13) / 12
    across, along = symmetry.origin_mm(np.linspace(0.05, end, 400))
    heights = along - across / np.tan(np.linspace(0.05, end, 400))
    camera = ViewpointSpline(
        radii_px=tuple(symmetry.radius_px(knots)),
        viewpoints_mm=tuple(np.interp(knots, np.linspace(0.05, end, 400), heights)),
        field_deg=float(np.degrees(2 * end)),
        centre_px=symmetry.centre_px,
        image_size=sensor.image_size,
        mount=sensor.mount,
    )
    rng = np.random.default_rng(4)
    points = rng.normal(size=(2000, 3))
    points *= rng.uniform(200, 1000, (2000, 1)) / np.linalg.norm(points, axis=1, keepdims=True)
    truth, projection = sensor.project(points), camera.project(points)
    both = truth.valid & projection.valid
    assert both.sum() > 1000
    errors = np.linalg.norm(truth.pixels - projection.pixels, axis=1)[both]
    flat = replace(camera, viewpoints_mm=(float(heights.mean()),) * 12).project(points)
    central = np.linalg.norm(truth.pixels - flat.pixels, axis=1)[both & flat.valid]
    assert np.sqrt(np.mean(errors**2)) < 0.03
    assert np.sqrt(np.mean(central**2)) > 10 * np.sqrt(np.mean(errors**2))


def test_spline_from_model():
    unified = Unified(
        xi=0.95, focal_px=(220.0, 222.0), centre_px=(322.0, 238.0), image_size=(640, 480), k1=-0.05
    )
    for start in (
        RadialSpline.from_model(unified, 8, 220.0),
        ViewpointSpline.from_model(unified, 8, 220.0),
    ):
        omega = np.linspace(0, np.radians(109.0), 50)
        for phi in (0.0, 1.0, 2.0):
            d = np.stack(
                [np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), -np.cos(omega)], axis=-1
            )
            np.testing.assert_allclose(start.image(d).pixels, unified.image(d).pixels, atol=0.3)
    with pytest.raises(
        InvalidParameter,
        match=r"field_deg must be at most 262\.039 deg, the field of the model; got 359",
    ):
        RadialSpline.from_model(unified, 8, 359.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"radii_px": (10.0, 20.0)},
            r"radii_px must be at least 3 increasing radii greater than 0; got \(10\.0, 20\.0\)",
        ),
        (
            {"radii_px": (10.0, 20.0, 15.0, 30.0, 40.0)},
            "radii_px must be at least 3 increasing radii",
        ),
        (
            {"viewpoints_mm": (1.0, 2.0)},
            r"viewpoints_mm must have one value for each of the 5 knots; got \(1\.0, 2\.0\)",
        ),
        ({"field_deg": 361.0}, r"field_deg must be between 0\.001 and 360 deg; got 361\.0"),
        ({"stretch_x": 0.6}, r"stretch_x must be between -0\.5 and 0\.5; got 0\.6"),
        ({"p1": np.nan}, r"p1 must be between -1e\+12 and 1e\+12 1/px; got nan"),
    ],
)
def test_invalid_spline_raises(changes, message):
    with pytest.raises(InvalidParameter, match=message):
        replace(CAMERA, **changes)
