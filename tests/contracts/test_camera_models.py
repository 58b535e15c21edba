"""Contract of all calibrated models in addition to that of cameras: parameters, derivatives and
field limits."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

from omnimirror.base.errors import InvalidParameter
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import (
    CameraModel,
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    MirrorBall,
    OCam,
    RadialSpline,
    RationalPinhole,
    ThinPrismFisheye,
    Unified,
    ViewpointSpline,
)

C, S = (322.0, 238.0), (640, 480)
RADII = (44.0, 92.0, 143.0, 191.0, 230.0)
MODELS = {
    "unified": Unified(
        xi=0.9,
        focal_px=(220.0, 223.0),
        centre_px=C,
        image_size=S,
        skew_px=0.4,
        k1=-0.08,
        k2=0.02,
        k3=-0.001,
        p1=0.003,
        p2=-0.002,
    ),
    "unified-paraboloid": Unified(xi=1.0, focal_px=(120.0, 120.0), centre_px=C, image_size=S),
    "unified-beyond-one": Unified(
        xi=1.4, focal_px=(330.0, 330.0), centre_px=C, image_size=S, k1=-0.05
    ),
    "unified-pinhole": Unified(
        xi=0.0, focal_px=(120.0, 120.0), centre_px=C, image_size=S, k1=-0.01, optics="fisheye"
    ),
    "enhanced-unified": EnhancedUnified(
        alpha=0.6, beta=1.1, focal_px=(180.0, 182.0), centre_px=C, image_size=S, skew_px=-0.3
    ),
    "enhanced-unified-flat": EnhancedUnified(
        alpha=0.4, beta=0.9, focal_px=(180.0, 182.0), centre_px=C, image_size=S, optics="fisheye"
    ),
    "double-sphere": DoubleSphere(
        xi=-0.2,
        alpha=0.6,
        focal_px=(180.0, 181.0),
        centre_px=C,
        image_size=S,
        skew_px=0.2,
        optics="fisheye",
    ),
    "double-sphere-ahead": DoubleSphere(
        xi=0.3, alpha=0.4, focal_px=(180.0, 181.0), centre_px=C, image_size=S
    ),
    "kannala-brandt": KannalaBrandt(
        focal_px=(170.0, 171.0),
        centre_px=C,
        image_size=S,
        k1=0.05,
        k2=-0.02,
        k3=0.003,
        k4=-0.0002,
        skew_px=0.5,
    ),
    "thin-prism-fisheye": ThinPrismFisheye(
        focal_px=(170.0, 171.0),
        centre_px=C,
        image_size=S,
        k1=0.05,
        k2=-0.02,
        k3=0.003,
        k4=-0.0002,
        skew_px=0.5,
        k5=1e-5,
        k6=-1e-6,
        p1=0.003,
        p2=-0.002,
        s1=0.002,
        s2=-3e-4,
        s3=-0.001,
        s4=4e-4,
    ),
    "rational-pinhole": RationalPinhole(
        focal_px=(300.0, 303.0),
        centre_px=C,
        image_size=S,
        k1=0.3,
        k2=-0.05,
        k3=0.01,
        k4=0.4,
        k5=0.02,
        k6=0.004,
        p1=0.003,
        p2=-0.002,
        skew_px=0.4,
    ),
    "ocam": OCam(
        polynomial=(-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10),
        centre_px=C,
        image_size=S,
        affine=(0.999, 4e-3, -2e-3),
    ),
    "ocam-fisheye": OCam(
        polynomial=(-151.7655, 0.0, 8.37e-04, -6.4e-07, 1.2e-09),
        centre_px=C,
        image_size=S,
        optics="fisheye",
    ),
    "ball": MirrorBall(centre_px=C, rim_radius_px=230.0, field_deg=300.0, image_size=S),
    "radial-spline": RadialSpline(
        radii_px=RADII,
        field_deg=230.0,
        centre_px=C,
        image_size=S,
        stretch_x=0.003,
        shear=-0.002,
        p1=1e-5,
        p2=-2e-5,
    ),
    "viewpoint-spline": ViewpointSpline(
        radii_px=RADII,
        viewpoints_mm=(-2.0, -1.5, 0.3, 2.5, 5.0),
        field_deg=230.0,
        centre_px=C,
        image_size=S,
        stretch_x=0.003,
        shear=-0.002,
        p1=1e-5,
        p2=-2e-5,
    ),
}
MOUNTS = [Mount(), Mount("forward", 20.0, image_flipped=True)]
CASES = [
    pytest.param(replace(model, mount=mount), id=f"{name}{'-flipped' * mount.image_flipped}")
    for name, model in MODELS.items()
    for mount in MOUNTS
]
NEAR_AXIS = np.array([[0.0, 0.0], [1e-7, 0.0], [-3e-6, 4e-6]])


def points_of(model, count=300, seed=3, inside=0.98):
    """Return points (n, 3) in mm in the field of the model at 30 to 3000 mm, including points on
    and near its axis."""
    rng = np.random.default_rng(seed)
    omega = rng.uniform(0.0, inside * model.model_end, count)
    phi = rng.uniform(-np.pi, np.pi, count)
    axis_sign = -1.0 if model.optics == "mirror" else 1.0
    directions = np.stack(
        [np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), axis_sign * np.cos(omega)],
        axis=-1,
    )
    near = np.column_stack([50 * NEAR_AXIS, np.full(len(NEAR_AXIS), axis_sign * 50.0)])
    points = np.concatenate([directions * np.geomspace(30, 3000, count)[:, None], near])
    return points[(np.abs(model.image(points).pixels - C) < 500).all(axis=1)]


def differences(function, step):
    """Return central differences of fourth order; the rounding error dominates."""
    one, two = (function(k * step) - function(-k * step) for k in (1, 2))
    return (8 * one - two) / (12 * step)


@pytest.mark.parametrize("model", CASES)
def test_derivatives_by_points_and_directions(model):
    points = points_of(model)
    assert len(points) > 150
    for distant in (False, True):
        projection = model.image(points, distant=distant)
        assert projection.valid.all()
        step = 1e-4
        for axis, unit in enumerate(np.eye(3)):
            expected = differences(
                lambda h, u=unit, d=distant: model.image(points + h * u, distant=d).pixels, step
            )
            size = (
                1e-6 * (1 + np.abs(expected))
                + 1e-6 * np.linalg.norm(projection.d_points, axis=(1, 2))[:, None]
            )
            assert (np.abs(projection.d_points[:, :, axis] - expected) < size)[
                np.isfinite(expected)
            ].all()


@pytest.mark.parametrize("model", CASES)
def test_derivatives_by_parameters(model):
    points = points_of(model, inside=0.95)
    projection = model.image(points)
    values = np.array([p.value for p in model.parameters])
    assert projection.d_parameters.shape == (len(points), 2, len(values))
    for i, parameter in enumerate(model.parameters):

        def moved(h, i=i):
            return (
                model.with_parameters(values + h * (np.arange(len(values)) == i))
                .image(points)
                .pixels
            )

        step = 1e-5 * parameter.scale
        if parameter.name == "xi" and values[i] == 0:  # a pinhole: one-sided only
            expected = (4 * moved(step) - moved(2 * step) - 3 * moved(0.0)) / (2 * step)
            tolerance = 1e-2
        else:
            expected, tolerance = differences(moved, step), 1e-6
        per_change = np.abs(projection.d_parameters[:, :, i] - expected) * parameter.scale
        size = tolerance * (1 + np.abs(expected) * parameter.scale)
        assert (per_change < size).all(), parameter.name


@pytest.mark.parametrize("model", CASES)
def test_parameters_have_unique_names_and_round_trip(model):
    parameters = model.parameters
    assert isinstance(model, CameraModel)
    assert len({p.name for p in parameters}) == len(parameters)
    assert all(p.scale > 0 for p in parameters)
    assert model.with_parameters([p.value for p in parameters]) == model
    other = model.with_parameters([p.value + 1e-3 * p.scale for p in parameters])
    assert type(other) is type(model)
    np.testing.assert_array_equal(
        [p.value for p in other.parameters], [p.value + 1e-3 * p.scale for p in parameters]
    )
    for invalid in ([1.0], np.full(len(parameters), np.nan)):
        with pytest.raises(InvalidParameter, match="values"):
            model.with_parameters(invalid)


@pytest.mark.parametrize("model", CASES)
def test_image_positions_agree_with_projection(model):
    """Projection to image coordinates; the world frame is the camera frame rotated by the mount."""
    points = points_of(model)
    turn = model.mount.rotation()
    for distant, project in ((False, model.project), (True, model.project_directions)):
        pixels, valid = project(points @ turn.T)
        assert valid.sum() > 30
        np.testing.assert_allclose(
            model.image(points, distant=distant).pixels[valid], pixels[valid], atol=1e-9, rtol=0
        )


@pytest.mark.parametrize("model", CASES)
def test_projection_outside_model_domain_is_nan(model):
    axis_sign = -1.0 if model.optics == "mirror" else 1.0
    for factor, is_visible in ((1 - 1e-6, True), (1 + 1e-6, False)):
        if not is_visible and model.model_end > 3.14159:
            continue  # full sphere
        omega = factor * model.model_end
        direction = [[np.sin(omega), 0.0, axis_sign * np.cos(omega)]]
        projection = model.image(direction, distant=True)
        assert projection.valid.tolist() == [is_visible]
        assert (
            np.isfinite(projection.pixels).all()
            == np.isfinite(projection.d_points).all()
            == is_visible
        )
    undefined = model.image([[0.0, 0.0, 0.0], [np.nan, 0.0, 1.0], [np.inf, 0.0, 1.0]])
    assert not undefined.valid.any()
    assert np.isnan(undefined.pixels).all()
    assert np.isnan(undefined.d_parameters).all()


@pytest.mark.parametrize("model", CASES)
def test_image_radius_increases_up_to_end_of_domain(model):
    """No pixel corresponds to two field angles."""
    omega = np.linspace(0.0, model.model_end, 4001)
    radius = model.radius_from_omega(omega[:-1])
    assert (np.diff(radius) > 0).all()
    np.testing.assert_allclose(model.omega_from_radius(radius), omega[:-1], atol=1e-6)


@pytest.mark.parametrize("model", CASES)
def test_distant_points_are_projected_as_directions(model):
    points = points_of(model)
    far, distant = model.image(1e9 * points), model.image(points, distant=True)
    np.testing.assert_allclose(far.pixels, distant.pixels, atol=1e-5)
    scaled = np.abs(distant.d_points).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(1e9 * far.d_points / scaled, distant.d_points / scaled, atol=1e-5)
    along = np.einsum("nij,nj->ni", distant.d_points, points)
    np.testing.assert_allclose(
        along / scaled[:, :, 0], 0.0, atol=1e-6
    )  # independent of the length of a direction


@pytest.mark.parametrize("model", CASES)
def test_pickle_and_repr_round_trip(model):
    assert pickle.loads(pickle.dumps(model)) == model
    assert hash(model) == hash(pickle.loads(pickle.dumps(model)))
    assert eval(repr(model)) == model
    model.image(points_of(model, 5))  # and cached values do not change the result
    assert pickle.loads(pickle.dumps(model)) == model


@pytest.mark.parametrize("model", CASES)
def test_projection_of_empty_arrays(model):
    projection = model.image(np.empty((0, 3)))
    assert projection.pixels.shape == (0, 2)
    assert projection.d_parameters.shape == (0, 2, len(model.parameters))
