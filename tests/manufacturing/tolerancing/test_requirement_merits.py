"""Quantities of requirement files for sensors with errors against evaluations, files and traced
lines.
"""

import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.base.quantities import QUANTITIES
from omnimirror.design.limits import LIMITABLE
from omnimirror.design.merits import OF_THE_WHOLE, values_of_evaluation
from omnimirror.manufacturing.tolerancing.evaluator import MeritName, TrialEvaluator, named
from omnimirror.manufacturing.tolerancing.requirement_values import (
    LINE_POINTS,
    lines_over,
    sequential_rims,
    sequential_views,
    vectorised_rims,
    vectorised_views,
)
from omnimirror.manufacturing.tolerancing.sensitivity import merit_rates
from omnimirror.manufacturing.tolerancing.tolerance_file import parse_tolerances
from omnimirror.manufacturing.tolerancing.tolerances import perturbed
from omnimirror.manufacturing.tolerancing.trial_images import directions_of, field_of
from omnimirror.optics.housing import Dome, Housing, Rod
from tests.everyday import few

SPH = om.load_sensor("paper-spherical")
SENSORS = ("paper-spherical", "paper-hyperboloidal", "exact-equidistant")
OTHERS = {
    "dome": replace(SPH, housing=Housing(shell=Dome(260.0, 5.0))),
    "telecentric": om.load_sensor("paraboloid-telecentric"),
    "two mirrors": om.load_sensor("folded-hyperboloidal"),
}
NO_ERRORS = {"imager.shift_x_px": np.zeros(1)}
MISALIGNED = {
    "mirror.decentre_x_mm": 0.1,
    "mirror.tilt_x_deg": 0.15,
    "lens.focal_length_mm": 0.05,
}
PART = (30.0, 100.0)


def names_of_all(sensor):
    """Return the merit names of all quantities with all sides of limits."""
    for name, of in LIMITABLE.items():
        if name.endswith("mm_per_px"):  # infinite for distant objects
            continue
        frequency = 0.1 if of.of_frequency else None
        part = None if name in OF_THE_WHOLE else PART
        if of.takes != "ratio":
            yield MeritName(name, False, part, frequency).text
        if of.takes != "spread":
            yield MeritName(name, True, part, frequency).text


def columns(values):
    return {name: np.array([value]) for name, value in values.items()}


def required(sensor, names, values, **field):
    evaluator = TrialEvaluator.of(sensor, "none", tuple(names), **field)
    return dict(zip(evaluator.names, evaluator.evaluate(values)[0].tolist(), strict=True))


@pytest.mark.parametrize("kind", few([*SENSORS, *OTHERS], *SENSORS, "telecentric"))
def test_nominal_values_match_the_design_evaluation(kind):
    """Compare with ``om.check_requirements`` at the same field angles."""
    sensor = OTHERS[kind] if kind in OTHERS else om.load_sensor(kind)
    names = list(names_of_all(sensor))
    low = max(PART[0], sensor.clear_field_deg[0] + 1)
    merits = required(sensor, names, NO_ERRORS, field_deg=(low, PART[1]), angles=4, azimuths=5)
    field = values_of_evaluation(om.evaluate(sensor, np.linspace(low, PART[1], 4)))
    for name in names:
        merit = named(name)
        values = merit.limit(1.0).of.values(field)
        expected = values.min() if merit.is_lower_limit else values.max()
        assert merits[name] == pytest.approx(
            expected, rel=2e-3 if kind in OTHERS else 1e-6, abs=2e-3
        ), name


@pytest.mark.parametrize("kind", SENSORS)
def test_resolution_matches_the_perturbed_sensor(kind):
    sensor = om.load_sensor(kind)
    built, field, step = perturbed(sensor, MISALIGNED), field_of(sensor), 1e-3
    _, perpendiculars = directions_of(field.omega_deg, field.azimuth_deg)
    view, _ = vectorised_views(field, columns(MISALIGNED), "none")
    for k, resolution in enumerate((view.values.dh[0], view.values.dw[0])):
        ends = []
        for sign in (1, -1):
            directions = field.targets + sign * np.radians(step) * perpendiculars[..., k]
            ends.append(built.project_directions(directions @ sensor._axes.T).pixels)
        np.testing.assert_allclose(
            resolution, np.linalg.norm(ends[0] - ends[1], axis=1) / (2 * step), rtol=1e-6
        )


@pytest.mark.parametrize("kind", SENSORS)
def test_viewpoints_match_the_perturbed_sensor(kind):
    sensor = om.load_sensor(kind)
    built, field = perturbed(sensor, MISALIGNED), field_of(sensor)
    pixels = built.project_directions(field.targets @ sensor._axes.T).pixels
    rays = built.backproject(pixels)
    origins, directions = rays.origins @ sensor._axes, rays.directions @ sensor._axes
    view, _ = vectorised_views(field, columns(MISALIGNED), "none")

    def miss(point):
        return np.linalg.norm(np.cross(directions, point - origins), axis=1)

    distance_sum = (miss(view.viewpoint[0]) ** 2).sum()
    for step in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
        assert (miss(view.viewpoint[0] + step) ** 2).sum() > distance_sum
    for k in (1, 40, 96):  # height at which a ray is closest to the axis through that point
        heights = view.viewpoint[0, 2] + np.linspace(-80, 80, 160_001)
        axis = np.stack(
            [np.full_like(heights, c) for c in view.viewpoint[0, :2]] + [heights], axis=-1
        )
        distance = np.linalg.norm(np.cross(axis - origins[k], directions[k]), axis=1)
        assert heights[distance.argmin()] == pytest.approx(view.values.viewpoint_z[0, k], abs=2e-3)


def test_single_viewpoint_is_preserved():
    merits = required(
        om.load_sensor("paper-hyperboloidal"),
        ("viewpoint_spread_mm", "viewpoint_shift_mm"),
        NO_ERRORS,
    )
    assert merits["viewpoint_spread_mm"] < 1e-6
    assert merits["viewpoint_shift_mm"] < 1e-9
    perturbed = columns({"mirror.decentre_x_mm": 0.2})
    assert (
        required(om.load_sensor("paper-hyperboloidal"), ("viewpoint_spread_mm",), perturbed)[
            "viewpoint_spread_mm"
        ]
        > 0.1
    )


@pytest.mark.parametrize("kind", SENSORS)
def test_vectorised_and_sequential_rims_agree(kind):
    sensor = om.load_sensor(kind)
    values = columns(MISALIGNED | {"imager.shift_x_px": 8.0})
    _, vergence = vectorised_views(field_of(sensor), values, "none")
    vectorised = vectorised_rims(sensor, values, vergence)
    sequential = sequential_rims(sensor, values, np.array([sensor.lens.focus_distance_mm]))
    assert vectorised.reach_px.max() == pytest.approx(sequential.reach_px.max(), abs=0.01)
    assert vectorised.field_to_deg.min() == pytest.approx(sequential.field_to_deg.min(), abs=0.01)
    assert np.ptp(vectorised.reach_px) > 10.0


@pytest.mark.parametrize("kind", ["paper-spherical", "paper-hyperboloidal"])
def test_vectorised_and_sequential_views_agree(kind):
    sensor = om.load_sensor(kind)
    field, values = field_of(sensor, angles=3, azimuths=5), columns(MISALIGNED)
    (view, _), (sequential, _) = (
        vectorised_views(field, values, "none"),
        sequential_views(field, values, "none"),
    )
    for name, of in view.values._asdict().items():
        other = getattr(sequential.values, name)
        assert np.shape(of) == np.shape(other), name
        if name != "image_distance":
            np.testing.assert_allclose(other, of, rtol=1e-4, atol=1e-4, err_msg=name)
    np.testing.assert_allclose(sequential.viewpoint, view.viewpoint, atol=1e-5)


@pytest.mark.parametrize("kind", SENSORS)
def test_straightness_matches_back_projection(kind):
    """Project points of great circles by the perturbed sensor and back-project them by the nominal
    one.
    """
    sensor = om.load_sensor(kind)
    values = {name: 0.1 * value for name, value in MISALIGNED.items()}
    straightness_deg = required(sensor, ("straightness_deg",), columns(values))["straightness_deg"]
    field = field_of(sensor)
    omega, azimuth, _ = lines_over(field.omega_deg.min(), field.omega_deg.max())
    towards, _ = directions_of(omega.ravel(), azimuth.ravel())
    lines = towards.reshape(-1, LINE_POINTS, 3)
    assert np.linalg.svd(lines, compute_uv=False)[:, 2].max() < 1e-12  # great circles
    pixels = perturbed(sensor, values).project_directions(towards @ sensor._axes.T).pixels
    directions = (sensor.backproject(pixels).directions @ sensor._axes).reshape(lines.shape)
    planes = np.linalg.svd(directions)[2][:, 2]
    crooked = np.degrees(np.arcsin(np.abs(np.einsum("lpi,li->lp", directions, planes)))).max()
    assert straightness_deg == pytest.approx(crooked, rel=0.02)
    assert straightness_deg > 1e-3


def test_calibration_restores_straight_lines():
    names = ("straightness_deg", "straightness_deg after pose")
    merits = required(SPH, names, columns({"mirror.decentre_x_mm": 0.2}))
    assert merits["straightness_deg"] > 0.1
    assert merits["straightness_deg after pose"] < 1e-6


@pytest.mark.parametrize("error", ["mirror.decentre_x_mm", "mirror.zernike_5_um", "lens.k1"])
def test_derivatives_match_small_errors(error):
    names = (
        "total_blur_px",
        "min resolution_px_per_deg",
        "area_ratio",
        "viewpoint_spread_mm",
        "straightness_deg",
        "viewpoint_shift_mm",
        "rim_reach_px",
        "min field_to_deg",
    )
    names = tuple(name if name != "area_ratio" else "min area_ratio" for name in names)
    evaluator = TrialEvaluator.of(SPH, "none", names)
    rates, step = merit_rates(evaluator, error, 0.01), 0.02
    sizes = step * np.array([0.0, 1.0, 2.0])
    at = evaluator.evaluate({error: sizes})
    for name in names:
        values, (first, second) = at[:, evaluator.names.index(name)], rates[name]
        expected = values[0] + first * sizes + second * sizes**2 / 2
        change = max(np.abs(values - values[0]).max(), 1e-6)
        np.testing.assert_allclose(values, expected, atol=0.02 * change, err_msg=name)


def test_obscurations_match_the_sensor():
    sensor = replace(SPH, housing=Housing(rod=Rod(4.0)))
    values = columns({"mirror.displacement_mm": 1.0})
    obscured_percent = required(sensor, ("obscured_percent",), values)["obscured_percent"]
    assert obscured_percent == pytest.approx(
        perturbed(sensor, {"mirror.displacement_mm": 1.0}).aligned().obscured_percent
    )


def test_yield_of_a_resolution_limit():
    """The resolution is proportional to the focal length: the yield is a fraction of a uniform
    distribution.
    """
    nominal = required(SPH, ("min resolution_px_per_deg",), NO_ERRORS)["min resolution_px_per_deg"]
    tolerances = om.Tolerances(SPH, {"lens.focal_length_mm": om.Tolerance(0.1)})
    limit = om.Limit("resolution_px_per_deg", at_least=nominal)
    analysis = om.tolerance(SPH, tolerances, limits=[limit], trials=2000)
    assert analysis.statistics.yields.low < 0.5 < analysis.statistics.yields.high
    data = analysis.to_dict()
    assert data["limits"][0]["at_least"] == nominal
    (row,) = data["sensitivities"]
    assert row["max_tolerance"]["min resolution_px_per_deg"] == 0.0
    low = analysis.statistics.quantile("min resolution_px_per_deg", 0.95)
    assert low < nominal < analysis.statistics.quantile("min resolution_px_per_deg", 0.05)


def test_quantiles_of_nearly_constant_merits():
    """The maximum field angle of 135 deg changes by 0.01 deg for a tilt of 0.01 deg."""
    tolerances = om.Tolerances(SPH, {"mirror.tilt_x_deg": om.Tolerance(0.005)})
    limits = {"min field_to_deg": 134.99}
    statistics = om.tolerance(SPH, tolerances, limits=limits, trials=400).statistics
    evaluator = TrialEvaluator.of(SPH, "none", tuple(limits))
    values = evaluator.evaluate(tolerances.drawn(0, 0, 400))[
        :, evaluator.names.index("min field_to_deg")
    ]
    for share in (0.05, 0.5, 0.95):
        assert statistics.quantile("min field_to_deg", share) == pytest.approx(
            np.quantile(values, 1 - share), abs=2e-4
        )
    curve, shares = statistics.curve("min field_to_deg")
    assert np.interp(np.median(values), curve, shares) == pytest.approx(0.5, abs=0.02)
    assert statistics.yields.value == pytest.approx((values >= 134.99).mean(), abs=0.01)


FILE = '[[error]]\nname = "mirror.tilt_x_deg"\ntolerance = 0.1\n[[limit]]\n'


@pytest.mark.parametrize(
    ("table", "limits"),
    [
        ('quantity = "motion_px"\nafter = "pose"\nat_most = 0.5', {"motion_px after pose": 0.5}),
        ('quantity = "aspect"\nat_most = 1.2\nat_least = 0.8', {"aspect": 1.2, "min aspect": 0.8}),
        (
            'quantity = "mtf"\nat_least = 0.3\nomega_deg = 90\ncycles_per_px = 0.25',
            {"min mtf at 0.25 cycles/px, at 90 deg": 0.3},
        ),
        (
            'quantity = "total_blur_px"\nat_most = 5\nelevation_deg = [-10, 10]',
            {"total_blur_px, 80 to 100 deg": 5.0},
        ),
        (
            'quantity = "straightness_deg"\nafter = "affine"\nat_most = 0.1',
            {"straightness_deg after affine": 0.1},
        ),
        ('quantity = "field_to_deg"\nat_least = 130', {"min field_to_deg": 130.0}),
    ],
)
def test_limits_have_the_format_of_requirement_files(table, limits):
    assert parse_tolerances(FILE + table, SPH).limits == limits


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ('quantity = "motion_px"', "line 4: limit of motion_px requires at_most or at_least"),
        (
            'quantity = "motion_px"\nat_most = 1\nomega_deg = 90',
            "line 7: omega_deg does not apply to motion_px",
        ),
        ('quantity = "motion_px"\nat_least = 1', "'min motion_px' is not a merit of trials"),
        (
            'quantity = "motion_px"\nat_most = -1',
            "the upper limit of motion_px must be positive; got -1",
        ),
        ('quantity = "aspect"\nafter = "pose"\nat_most = 1', "'aspect after pose' is not a merit"),
        ('quantity = "aspect"', "at_"),
        (
            'quantity = "field_to_deg"\nat_most = 1',
            "'field_to_deg' is not a merit of trials; use 'min field_to_deg'",
        ),
        ('quantity = "mtf"\nat_least = 0.3', "requires a spatial frequency"),
        ('quantity = "nonsense"\nat_most = 1', "'nonsense' is not a merit of trials"),
    ],
)
def test_invalid_limits_are_rejected(table, message):
    with pytest.raises(SpecError, match=re.escape(message)):
        parse_tolerances(FILE + table, SPH)


def test_range_outside_the_field_is_rejected():
    with pytest.raises(InvalidParameter, match="must overlap the evaluated field, 0 to 131 deg"):
        TrialEvaluator.of(SPH, "none", ("total_blur_px, 133 to 134 deg",))


def test_merit_names_round_trip():
    for name in names_of_all(SPH):
        assert named(name).text == name
        assert named(name).quantity in QUANTITIES


@pytest.mark.parametrize("distance_mm", [400.0, 2000.0])
def test_object_sizes_refer_to_the_object_distance_of_the_requirements(distance_mm):
    """Sizes of the nominal sensor agree with those of ``om.check_requirements``, which traces the meridian."""
    limits = [
        om.Limit("plane_mm_per_px", at_most=1.0, omega_deg=(20, 60)),
        om.Limit("cylinder_mm_per_px", at_most=1.0, omega_deg=(60, 120)),
    ]
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=130.0, object_distance_mm=distance_mm),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.9),
        lens=om.LensRequirements(theta_max_deg=(5.0, 20.0)),
        limits=limits,
    )
    expected = {row.label: row.reached for row in om.check_requirements(requirements, SPH).limits}
    tolerances = om.Tolerances(SPH, {"imager.rotation_deg": om.Tolerance(0.0)})
    report = om.tolerance(SPH, tolerances, limits=requirements, trials=1)
    assert report.plan.objects == {"object_distance_mm": distance_mm}
    for label, value in expected.items():
        assert report.statistics.mean(label) == pytest.approx(value, rel=1e-6)


def test_object_sizes_require_a_finite_distance():
    tolerances = om.Tolerances(SPH, {"lens.k1": om.Tolerance(0.01)})
    with pytest.raises(InvalidParameter, match="requires a finite object distance"):
        om.tolerance(SPH, tolerances, limits={"plane_mm_per_px": 1.0}, trials=1)
