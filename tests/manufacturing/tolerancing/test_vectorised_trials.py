"""Vectorised trials against other tracers, finite rays, and a full calibration fit."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.manufacturing.tolerancing.compensation import (
    CALIBRATIONS,
    POSE,
    after,
    evaluate_numpy,
    merit_names,
)
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator, evaluate_compiled
from omnimirror.manufacturing.tolerancing.perturbed_states import states_of
from omnimirror.manufacturing.tolerancing.sensitivity import sensitivities
from omnimirror.manufacturing.tolerancing.tolerances import (
    Tolerance,
    Tolerances,
    error_sources,
    perturbed,
)
from omnimirror.manufacturing.tolerancing.trial_images import (
    REFOCUS,
    field_of,
    largest_diameter,
    trace_objects,
)
from tests.conftest import MIRRORS, sensor_of
from tests.everyday import few

SENSORS = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant", "exact-equidistant")
LENS = {
    "lens.focal_length_mm": 0.05,
    "lens.focus_distance_mm": 5.0,
    "lens.k1": 0.02,
    "lens.p2": 1e-3,
}
LENS |= {"lens.entrance_pupil_mm": 1.5, "lens.f_number": 0.1}


def errors(sensor, seed=0, size=0.2):
    """Case with errors of all kinds in a sensor file."""
    rng = np.random.default_rng(seed)
    shape = {"mirror.vertex_radius_mm": 0.1, "mirror.conic": 0.01, "mirror.coefficients[1]": 1e-3}
    sizes = (
        dict.fromkeys(POSE, size)
        | LENS
        | {name: v for name, v in shape.items() if name in error_sources(sensor)}
    )
    return {name: float(rng.normal() * value) for name, value in sizes.items()}


def columns(values):
    return {name: np.array([value]) for name, value in values.items()}


def world(sensor, vectors):
    return vectors @ sensor._axes.T


@pytest.fixture(params=SENSORS)
def sensor(request):
    return om.load_sensor(request.param)


@pytest.mark.parametrize("distance", [np.inf, 400.0])
def test_trial_matches_the_perturbed_sensor(sensor, distance):
    """``Sensor.project`` finds the mirror point by an independent method."""
    field, values = field_of(sensor, object_distance_mm=distance), errors(sensor)
    built = perturbed(sensor, values)
    targets = world(built, field.targets)
    projection = built.project_directions(targets) if field.distant else built.project(targets)
    offsets = built.image_plane.flat_mm(projection.pixels)[0] / built.imager.pitch_mm
    offsets_px = field.images(columns(values)).offsets_px[0]
    assert projection.valid.sum() > 80
    np.testing.assert_allclose(offsets_px[projection.valid], offsets[projection.valid], atol=1e-8)


def test_nominal_blur_matches_the_evaluation(sensor):
    field = field_of(sensor, azimuths=3)
    blur = field.images({}, count=1).blur_px[0]
    first = field.azimuth_deg == 0
    table = om.evaluate(sensor, omega_deg=np.maximum(field.omega_deg[first], 1e-6))
    worst = np.maximum(np.abs(table.blur_t_px), np.abs(table.blur_s_px))
    np.testing.assert_allclose(largest_diameter(blur[first]), worst, rtol=1e-6)
    np.testing.assert_allclose(
        np.linalg.det(blur[first]), table.blur_t_px * table.blur_s_px, rtol=1e-6, atol=1e-6
    )


def test_blur_matches_finite_rays(sensor):
    """Trace rays from an object through points of a small aperture by the forward projection of
    ``Sensor``.
    """
    values = errors(sensor, seed=3, size=0.5)
    small = 200.0  # F-number: the ellipse of a small aperture has no aberrations
    narrow = replace(sensor, lens=replace(sensor.lens, f_number=small))
    values["lens.f_number"] = 0.0
    field, built = field_of(narrow, angles=4, azimuths=5), perturbed(narrow, values)
    blur = field.images(columns(values)).blur_px[0]
    around = np.arange(16) * (2 * np.pi / 16)
    pupil = np.stack([np.cos(around), np.sin(around)], axis=-1)
    for target, matrix in zip(field.targets, blur, strict=True):
        ends = om.optics.tracing.reflection.RayEndpoints.of(
            np.broadcast_to(target, (16, 3)), distant=True
        )
        reflection = built.optical_train.posed_mirror.specular(
            built.optical_train.entrance_pupil_points(pupil), ends
        )
        points = (
            built.lens.image_of(
                reflection.facing_points - built.optical_train.lens_offset, reflection.to_pupils
            )
            / built.imager.pitch_mm
        )
        spread = points - points.mean(axis=0)
        expected = pupil @ matrix.T / 2
        assert np.abs(spread - expected).max() < 0.02 * np.abs(expected).max() + 1e-6


def test_form_error_obeys_the_law_of_reflection():
    """Normals of the surface from Zernike's formulas by differences."""
    sensor = om.load_sensor("paper-hyperboloidal")
    values = {
        "mirror.zernike_5_um": 40.0,
        "mirror.zernike_8_um": 30.0,
        "mirror.zernike_25_um": 20.0,
    }
    field = field_of(sensor)
    traced = trace_objects(
        states_of(sensor, columns(values)), field.targets, field.distant, field.start
    )
    rim = sensor.mirror.rim_radius_mm

    def height(x, y):
        r, phi = np.hypot(x, y) / rim, np.arctan2(y, x)
        form = 40.0 * np.sqrt(6) * r**2 * np.sin(2 * phi) + 30.0 * np.sqrt(8) * (
            3 * r**3 - 2 * r
        ) * np.cos(phi)
        form += 20.0 * np.sqrt(14) * (6 * r**6 - 5 * r**4) * np.sin(4 * phi)
        return sensor.mirror.sag(r * rim) + 1e-3 * form

    x, y = traced.mirror_points[0].T
    step = 1e-4
    normals = np.stack(
        [
            (height(x + step, y) - height(x - step, y)) / (2 * step),
            (height(x, y + step) - height(x, y - step)) / (2 * step),
            -np.ones_like(x),
        ],
        axis=-1,
    )
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    towards = np.stack([x, y, height(x, y) + sensor.mirror_distance_mm], axis=-1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    reflected = towards - 2 * (towards * normals).sum(axis=1, keepdims=True) * normals
    assert np.abs(reflected - field.targets).max() < 1e-7
    assert np.abs(traced.mirror_points[0] - field.start).max() > 1e-3


def test_imager_pose_is_a_plane_intersection():
    """Intersect the chief ray with the imager plane in three dimensions."""
    sensor = om.load_sensor("paper-spherical")
    field = field_of(sensor)
    names = (
        "imager.shift_x_px",
        "imager.shift_y_px",
        "imager.rotation_deg",
        "imager.tilt_x_deg",
        "imager.tilt_y_deg",
    )
    values = dict(
        zip((*names, "imager.pitch_ppm"), (12.0, -5.0, 1.5, 0.8, -0.6, 300.0), strict=True)
    )
    offsets_px = field.images(columns(values)).offsets_px[0]
    pitch = sensor.imager.pitch_mm
    c = sensor.lens.principal_distance
    rays = np.concatenate([field.offsets_px * pitch / c, np.ones((len(field), 1))], axis=1)
    a, b, turn = np.radians([0.8, -0.6, 1.5])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    about_z = np.array(
        [[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]]
    )
    axes = about_y @ about_x @ about_z
    middle = np.array([0.0, 0.0, c])
    intersections = rays * ((axes[:, 2] @ middle) / (rays @ axes[:, 2]))[:, None]
    expected = ((intersections - middle) @ axes[:, :2]) / (pitch * (1 + 300e-6)) + [12.0, -5.0]
    np.testing.assert_allclose(offsets_px, expected, atol=1e-9)


@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal"])
def test_pose_residual_matches_a_full_fit(name):
    """Fit pose and affine terms with exact rays in every step."""
    sensor = om.load_sensor(name)
    evaluator = TrialEvaluator.of(sensor, angles=5, azimuths=8)
    values = {
        "mirror.tilt_x_deg": 0.3,
        "mirror.decentre_x_mm": -0.2,
        "mirror.zernike_6_um": 3.0,
        "mirror.zernike_11_um": 1.0,
    }
    merits, motions = evaluator.evaluate_with_motions(columns(values))
    x, y = evaluator.reference_px.T
    one, zero = np.ones_like(x), np.zeros_like(x)
    affine = np.array(
        [np.append(c, zero) for c in (one, x, y)] + [np.append(zero, c) for c in (one, x, y)]
    )

    def residual(p):
        fit = (
            evaluator.field.images(columns(dict(zip(POSE, p, strict=True)))).offsets_px[0]
            - evaluator.reference_px
        )
        rest = motions[0] - fit.T.ravel()
        return rest - affine.T @ np.linalg.lstsq(affine.T, rest, rcond=None)[0]

    fitted = least_squares(residual, np.zeros(5), x_scale=0.1, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    expected = np.sqrt(2 * fitted.cost / len(x))
    residual_px = merits[0, merit_names().index(after("motion_rms_px", "pose"))]
    assert residual_px == pytest.approx(expected, rel=2e-3)
    assert residual_px < 0.3 * merits[0, merit_names().index(after("motion_rms_px", "affine"))]


def test_residuals_decrease_with_calibration_depth(sensor):
    rng = np.random.default_rng(1)
    values = {name: rng.normal(size=50) * 0.1 for name in POSE}
    values |= {f"mirror.zernike_{j}_um": rng.normal(size=50) for j in range(4, 16)}
    merits = TrialEvaluator.of(sensor).evaluate(values)
    left = merits[:, [merit_names().index(after("motion_rms_px", depth)) for depth in CALIBRATIONS]]
    assert (np.diff(left, axis=1) <= 1e-9).all()


@pytest.mark.parametrize("refocus", REFOCUS)
@pytest.mark.parametrize("distance", few([np.inf, 300.0], 300.0))
@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
def test_compiled_kernel_matches_numpy(sensor, refocus, distance):
    evaluator = TrialEvaluator.of(sensor, refocus, object_distance_mm=distance)
    rng = np.random.default_rng(2)
    for more in ([], [4, 9], [5, 26], [8, 60, 91]):
        values = {name: rng.normal(size=20) * 0.3 for name in (*POSE, "imager.tilt_x_deg")}
        values |= {name: rng.normal(size=20) * size for name, size in LENS.items()}
        values |= {f"mirror.zernike_{j}_um": rng.normal(size=20) for j in more}
        merits, compiled = evaluate_compiled(evaluator, states_of(sensor, values))
        expected, motions = evaluate_numpy(evaluator, values)
        close = 1e-4 if refocus == "worst" else 1e-8  # final interval of the golden section
        np.testing.assert_allclose(compiled, motions, atol=close / 10)
        np.testing.assert_allclose(merits, expected, atol=close, rtol=close)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_all_mirrors_are_supported(kind):
    """All mirror types, including pointed ones."""
    sensor = sensor_of(kind)
    low, high = sensor.field_deg
    field = field_of(
        sensor,
        field_deg=(low + 0.05 * (high - low), high - 0.05 * (high - low)),
        angles=4,
        azimuths=5,
    )
    values = {"mirror.decentre_x_mm": 0.05, "mirror.tilt_y_deg": 0.05}
    built = perturbed(sensor, values)
    projection = built.project_directions(world(built, field.targets))
    offsets = built.image_plane.flat_mm(projection.pixels)[0] / built.imager.pitch_mm
    offsets_px = field.images(columns(values)).offsets_px[0]
    assert np.abs(offsets_px - offsets)[projection.valid].max() < 1e-6


def test_lost_rays_are_counted():  # a decentre moves the rim away from its objects
    sensor = om.load_sensor("paper-spherical")
    evaluator = TrialEvaluator.of(sensor, field_deg=(10.0, sensor.field_deg[1]))
    merits = evaluator.evaluate({"mirror.decentre_x_mm": np.array([0.0, 0.5])})
    assert merits[0, -1] == 0
    assert np.isfinite(merits[0]).all()
    assert merits[1, -1] > 0
    assert np.isnan(merits[1, :-1]).all()


def test_impossible_sensors_lose_all_rays():
    evaluator = TrialEvaluator.of(om.load_sensor("paper-spherical"))
    n = len(evaluator.field)
    for name, value in (
        ("lens.f_number", -9.0),
        ("lens.focus_distance_mm", -205.0),
        ("mirror.vertex_radius_mm", -60.0),
    ):
        merits, motions = evaluator.evaluate_with_motions({name: np.array([0.0, value])})
        assert merits[:, -1].tolist() == [0, n]
        assert np.isnan(motions[1]).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"field_deg": (0.0, 179.0)}, "field_deg"),
        ({"angles": 0}, "angles"),
        ({"object_distance_mm": -1.0}, "object_distance_mm"),
    ],
)
def test_invalid_field_is_rejected(options, message):
    with pytest.raises(InvalidParameter, match=message):
        field_of(om.load_sensor("paper-spherical"), **options)


@pytest.mark.parametrize("value", [0.0, 1e-50, 1e6])
def test_extreme_tolerances_have_sensitivities(sensor, value):
    tolerances = Tolerances(sensor, {"mirror.decentre_x_mm": Tolerance(value)})
    (row,) = sensitivities(TrialEvaluator.of(sensor), tolerances, {"motion_px": 1.0})
    assert row.name == "mirror.decentre_x_mm"


@pytest.mark.parametrize("value", [-1e-50, 9e-51, 5e-324, 1.1e6, 1e308])
def test_out_of_range_tolerances_are_rejected(value):
    with pytest.raises(
        InvalidParameter, match=r"tolerance must be 0, or between 1e-50 and 1e\+06; got "
    ):
        Tolerance(value)
