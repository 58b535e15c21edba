"""Yields, single-error tolerances and allocations against analytic results."""

import json
import math

import numpy as np
import pytest
from click.testing import CliRunner
from scipy import stats
from scipy.integrate import quad
from scipy.optimize import brentq, minimize_scalar

import omnimirror as om
from omnimirror.apps.cli import app
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.manufacturing.tolerancing.allocation import allocate
from omnimirror.manufacturing.tolerancing.compensation import merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.monte_carlo import (
    YieldStatistics,
    check_trials,
    clopper_pearson,
    format_motion,
    satisfies_limit,
    simulate_trials,
)
from omnimirror.manufacturing.tolerancing.sensitivity import sensitivities
from omnimirror.manufacturing.tolerancing.tolerance_file import parse_tolerances
from omnimirror.manufacturing.tolerancing.tolerances import BLOCK, DISTRIBUTIONS, drawn, perturbed

SHIFTS = ("imager.shift_x_px", "imager.shift_y_px")


@pytest.fixture(scope="module")
def sensor():
    return om.load_sensor("paper-spherical")


@pytest.fixture(scope="module")
def evaluator(sensor):
    """Evaluator with few objects, for which the analytic results also hold."""
    return TrialEvaluator.of(sensor, angles=2, azimuths=3)


def of(sensor, errors, correlations=None, distribution="normal"):
    bounds = {name: om.Tolerance(value, distribution) for name, value in errors.items()}
    return om.Tolerances(sensor, bounds, correlations or {})


def test_yield_of_shifts_is_a_rayleigh_distribution(sensor, evaluator):
    """Two normal shifts with one sigma: the motion is their hypotenuse."""
    statistics = simulate_trials(
        evaluator, of(sensor, dict.fromkeys(SHIFTS, 2.0)), {"motion_px": 2.0}, trials=20_000, seed=3
    )
    exact = 1 - np.exp(-2.0)
    assert statistics.yields.low < exact < statistics.yields.high
    assert statistics.yields.high - statistics.yields.low < 0.012
    assert statistics.quantile("motion_px", 0.5) == pytest.approx(np.sqrt(2 * np.log(2)), rel=0.02)


def test_yield_of_a_single_error(sensor, evaluator):
    tolerances = of(sensor, {"lens.focal_length_mm": 0.2})
    limit = {"direction_error_deg": 1.0}
    (row,) = sensitivities(evaluator, tolerances, limit)
    statistics = simulate_trials(evaluator, tolerances, limit, trials=8000, seed=1)
    sides = [
        brentq(
            lambda e: (
                evaluator.evaluate({"lens.focal_length_mm": np.array([e])})[
                    0, _at("direction_error_deg")
                ]
                - 1
            ),
            *ends,
        )
        for ends in ((1e-6, 1.0), (-1.0, -1e-6))
    ]
    assert min(np.abs(sides)) == pytest.approx(row.max_tolerance["direction_error_deg"], rel=0.02)
    assert (
        statistics.yields.low
        < np.diff(stats.norm.cdf(np.array(sides[::-1]) / 0.1))[0]
        < statistics.yields.high
    )


def _at(name):
    return merit_names().index(name)


def test_pose_calibration_compensates_decentre_of_a_sphere(sensor, evaluator):
    """Decentre and tilt of a sphere are a decentre, which a pose calibration compensates."""
    names = (
        "mirror.decentre_x_mm",
        "mirror.decentre_y_mm",
        "mirror.tilt_x_deg",
        "mirror.tilt_y_deg",
    )
    limits = {"motion_px": 0.5, "motion_px after pose": 0.01}
    statistics = simulate_trials(
        evaluator, of(sensor, dict.fromkeys(names, 0.3)), limits, trials=2000
    )
    assert statistics.passed_each["motion_px"] < 100
    assert statistics.passed_each["motion_px after pose"] == 2000


def test_trials_are_reproducible(sensor):
    tolerances = of(sensor, {"mirror.tilt_x_deg": 0.1, "lens.k1": 0.01})
    first, second = tolerances.drawn(5, 7, 100), tolerances.drawn(5, 7, BLOCK)
    other = tolerances.drawn(5, 8, 100)
    for name, values in first.items():
        assert (values == second[name][:100]).all()
        assert not np.isclose(values, other[name]).any()


@pytest.mark.parametrize("name", DISTRIBUTIONS)
def test_quantiles_of_distributions(name):
    laws = {
        "uniform": stats.uniform(-1, 2),
        "normal": stats.norm(scale=0.5),
        "truncated-normal": stats.truncnorm(-2, 2, scale=0.5),
        "arcsine": stats.arcsine(-1, 2),
    }
    share = np.linspace(0.01, 0.99, 99)
    if name == "constant":
        assert (drawn(name, share) == 1).all()
        return
    np.testing.assert_allclose(drawn(name, share), laws[name].ppf(share), atol=1e-12)


def test_correlations(sensor):
    pair = ("mirror.tilt_x_deg", "mirror.decentre_y_mm")
    values = of(sensor, dict.fromkeys(pair, 1.0), {pair: -0.7}).drawn(0, 0)
    correlation = np.corrcoef(values[pair[0]], values[pair[1]])[0, 1]
    assert correlation == pytest.approx(-0.7, abs=0.02)


def test_histogram_quantiles():
    rng = np.random.default_rng(0)
    merits = np.tile(rng.lognormal(size=(5000, 1)), (1, len(merit_names())))
    merits[:, -1] = 0
    statistics = YieldStatistics({})
    statistics.add(merits[:2000])
    statistics.add(merits[2000:])
    for share in (0.1, 0.5, 0.9):
        assert statistics.quantile("blur_px", share) == pytest.approx(
            np.quantile(merits[:, 0], share), rel=0.01
        )
    values, shares = statistics.curve("blur_px")
    assert np.interp(1.0, values, shares) == pytest.approx((merits[:, 0] < 1).mean(), abs=0.01)
    assert statistics.mean("blur_px") == pytest.approx(merits[:, 0].mean())


@pytest.mark.parametrize(
    ("name", "expected"), [("min aspect", [False, True, True]), ("blur_px", [True, True, False])]
)
def test_limit_is_inclusive(name, expected):
    assert satisfies_limit(np.array([1.0, 2.0, 3.0]), name, 2.0).tolist() == expected


def test_values_beyond_the_histogram_range():
    merits = np.zeros((4, len(merit_names())))
    merits[:, 0] = 1e30
    statistics = YieldStatistics({})
    statistics.add(merits)
    assert statistics.quantile(merit_names()[0], 0.5) == pytest.approx(1e9, rel=0.01)


def test_curve_without_valid_trials_is_empty():
    invalid = np.ones((3, len(merit_names())))
    for merits in (invalid[:0], invalid):
        statistics = YieldStatistics({})
        statistics.add(merits)
        assert [part.size for part in statistics.curve("blur_px")] == [0, 0]
        assert np.isnan(statistics.mean("blur_px"))
    assert statistics.lost == statistics.trials == 3
    assert statistics.quantile("blur_px", 0.5) == np.inf
    assert (statistics.passed, statistics.yields.value) == (0, 0.0)
    statistics = YieldStatistics({}, ("min aspect", "lost"))
    statistics.add(np.ones((3, 2)))
    assert statistics.quantile("min aspect", 0.5) == 0.0


@pytest.mark.parametrize("merit", ["blur_px", "min aspect"])
@pytest.mark.parametrize("limit", [None, 2.0])
def test_quantiles_are_accurate_to_a_quarter_percent(merit, limit):
    """Of the distance from the origin of the histogram: 0, or the limit of a merit that requires one."""
    origin = limit if limit and merit.startswith("min") else 0.0
    rng = np.random.default_rng(4)
    decades = 3.0 if origin else 8.9  # of single precision, as in shards
    away = 10 ** rng.uniform(-decades, decades, 400) * rng.choice([-1.0, 1.0], 400)
    values = (origin + away).astype(np.float32).astype(float)
    merits = np.column_stack([values, np.zeros(400)])
    statistics = YieldStatistics({merit: limit} if limit else {}, (merit, "lost"))
    statistics.add(merits[:150])
    statistics.add(merits[150:])
    ordered = np.sort(values)
    if merit.startswith("min"):
        ordered = ordered[::-1]
    for k in (0, 1, 7, 100, 200, 333, 398):
        quantile = statistics.quantile(merit, (k + 0.5) / 400)
        assert abs(quantile - ordered[k]) <= 2.3e-3 * abs(ordered[k] - origin)
    edges, shares = statistics.curve(merit)
    assert (np.diff(edges) >= 0).all()
    assert (shares[0], shares[-1]) == (1 / 400, 1.0)
    for k in (0, 10, 399):  # each bin ends at most 0.46 % beyond its values
        value = np.sort(values)[k]
        at = edges[np.searchsorted(shares, (k + 1) / 400 - 1e-9)]
        assert 0 <= at - value + 1e-5 * abs(value - origin) <= 4.7e-3 * abs(value - origin)
    assert statistics.mean(merit) == pytest.approx(values.mean())


def test_values_next_to_the_origin_count_as_the_origin():
    for value, expected in ((0.0, 0.0), (9e-10, 0.0), (-9e-10, 0.0), (2e-9, 2e-9), (-2e-9, -2e-9)):
        statistics = YieldStatistics({}, ("blur_px", "lost"))
        statistics.add(np.array([[value, 0.0]]))
        quantile = statistics.quantile("blur_px", 0.5)
        assert quantile == 0.0 if expected == 0 else quantile == pytest.approx(expected, rel=2.3e-3)
    for sign in (1.0, -1.0):
        statistics = YieldStatistics({}, ("blur_px", "lost"))
        statistics.add(np.array([[sign * 1e12, 0.0]]))
        assert statistics.quantile("blur_px", 0.5) == pytest.approx(sign * 1e9, rel=2.3e-3)


def test_lost_trials_count_in_quantiles_curves_and_yields():
    """Of 10 trials, 2 lose rays; limits on both merits."""
    blur, aspect = np.arange(1.0, 11.0), np.arange(10.0, 0.0, -1.0)
    loss = np.zeros(10)
    loss[[8, 9]] = 3.0
    limits = {"blur_px": 6.0, "min aspect": 7.0}
    statistics = YieldStatistics(limits, ("blur_px", "min aspect", "lost"))
    for part in (slice(0, 4), slice(4, 10)):
        statistics.add(np.column_stack([blur, aspect, loss])[part])
    assert (statistics.trials, statistics.lost, statistics.passed) == (10, 2, 4)
    assert statistics.passed_each == {"blur_px": 6, "min aspect": 4}
    assert statistics.yields == clopper_pearson(4, 10)
    for share, expected in ((0.05, 1.0), (0.75, 8.0), (0.8, 8.0), (0.85, np.inf)):
        assert statistics.quantile("blur_px", share) == pytest.approx(expected, rel=2.3e-3)
    for share, expected in ((0.05, 10.0), (0.75, 3.0), (0.85, 0.0)):
        assert statistics.quantile("min aspect", share) == pytest.approx(expected, rel=0.02)
    assert statistics.curve("blur_px")[1][-1] == 0.8
    assert statistics.mean("blur_px") == pytest.approx(4.5)
    assert statistics.mean("min aspect") == pytest.approx(6.5)


def test_trials_are_evaluated_in_blocks():
    calls, progress = [], []

    class Plan:
        def drawn(self, seed, block, count):
            calls.append((seed, block, count))
            return {"lens.k1": np.full(count, block)}

    class Blocks:
        names = ("blur_px", "lost")

        def evaluate(self, errors):
            return np.column_stack([1.0 + errors["lens.k1"], 0 * errors["lens.k1"]])

    count = 2 * BLOCK + 5
    statistics = simulate_trials(
        Blocks(), Plan(), {"blur_px": 2.0}, trials=count, seed=7,
        on_progress=lambda *done: progress.append(done),
    )  # fmt: skip
    assert calls == [(7, 0, BLOCK), (7, 1, BLOCK), (7, 2, 5)]
    assert progress == [(BLOCK, count), (2 * BLOCK, count), (count, count)]
    assert (statistics.trials, statistics.passed) == (count, 2 * BLOCK)
    calls.clear()
    assert simulate_trials(Blocks(), Plan(), {}).trials == 10_000
    assert {seed for seed, *_ in calls} == {0}
    assert sum(size for *_, size in calls) == 10_000
    for trials in (1, 10**10):
        check_trials(trials)
    for trials in (0, 10**10 + 1):
        with pytest.raises(
            InvalidParameter, match=f"trials must be between 1 and 10000000000; got {trials}$"
        ):
            check_trials(trials)


@pytest.mark.parametrize(
    ("px", "text"), [(4.9e-4, "< 0.001"), (5e-4, "0.0005"), (0.0, "< 0.001"), (12.345, "12.3")]
)
def test_small_motions_are_displayed_as_a_bound(px, text):
    assert format_motion(px) == text


@pytest.mark.parametrize("trials", [1, 7, 100])
def test_confidence_interval_by_the_binomial_distribution(trials):
    """Each end is exceeded by 2.5 % of experiments; one is 0 or 1 if no or all trials pass."""
    for passed in {0, 1, trials // 2, trials - 1, trials}:
        interval = clopper_pearson(passed, trials)
        assert interval.value == passed / trials
        if passed:
            assert stats.binom.sf(passed - 1, trials, interval.low) == pytest.approx(0.025)
        else:
            assert interval.low == 0.0
        if passed < trials:
            assert stats.binom.cdf(passed, trials, interval.high) == pytest.approx(0.025)
        else:
            assert interval.high == 1.0


def test_confidence_interval_coverage():
    """At least 0.95 minus three sigma of 400 experiments with 200 trials cover the truth."""
    passed = np.random.default_rng(1).binomial(200, 0.9, size=400)
    covered = [clopper_pearson(int(k), 200) for k in passed]
    assert np.mean([s.low <= 0.9 <= s.high for s in covered]) > 0.95 - 3 * np.sqrt(
        0.95 * 0.05 / 400
    )


@pytest.mark.full
def test_allocation_matches_the_analytic_minimum(sensor, evaluator):
    """Shifts with costs 8 and 1: the yield is an integral, and the minimum depends on one ratio."""
    costs = {"imager.shift_x_px": 8.0, "imager.shift_y_px": 1.0}
    allocation = allocate(
        evaluator, of(sensor, dict.fromkeys(SHIFTS, 2.0)), {"motion_px": 2.0}, 0.9, costs=costs
    )

    def good(x, y):
        def inner(u):
            return (
                math.exp(-((u / x) ** 2) / 2)
                / (x * math.sqrt(2 * math.pi))
                * math.erf(math.sqrt((4 - u * u) / 2) / y)
            )

        return quad(inner, -2, 2)[0]

    def cost(log_ratio):
        ratio = np.exp(log_ratio)
        size = brentq(lambda s: good(s, s * ratio) - 0.9, 0.05, 3)
        return 8 * 1 / size + 1 / (size * ratio)  # sigmas of 1 are requested

    best = minimize_scalar(cost, bounds=(-1.5, 0), method="bounded", options={"xatol": 1e-3})
    assert allocation.cost == pytest.approx(best.fun, rel=0.03)
    assert allocation.confirmed_yield.low - 0.005 < 0.9 < allocation.confirmed_yield.high + 0.005
    assert allocation.cost < allocation.uniform_cost


@pytest.mark.full
def test_allocation_respects_maximum_tolerances(sensor, evaluator):
    """Small distortions do not affect the limit: their tolerances are the maximum of the coarse
    grade or of the file.
    """
    errors = {"imager.shift_x_px": 2.0, "lens.k3": 1e-4, "lens.k2": 1e-4}
    allocation = allocate(
        evaluator,
        of(sensor, errors),
        {"motion_px": 2.0},
        0.9,
        max_tolerances={"lens.k2": 3e-4},
        trials=2000,
    )
    assert set(allocation.at_maximum) == {"lens.k2", "lens.k3"}
    assert allocation.tolerances["lens.k2"] == pytest.approx(3e-4)
    assert allocation.tolerances["lens.k3"] == pytest.approx(0.02)
    assert allocation.confirmed_yield.low - 0.01 < 0.9 < allocation.confirmed_yield.high + 0.01


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda s, j: simulate_trials(j, of(s, {"lens.k1": 0.1}), {"blurr_px": 1.0}), "blurr_px"),
        (
            lambda s, j: simulate_trials(j, of(s, {"lens.k1": 0.1}), {"blur_px": 0.0}),
            "must be positive; got 0",
        ),
        (
            lambda s, j: simulate_trials(j, of(s, {"lens.k1": 0.1}), {}, trials=0),
            "trials must be between 1 and",
        ),
        (lambda s, j: of(s, {"lens.k9": 0.1}), "did you mean lens.k"),
        (lambda s, j: of(s, {}), "at least one error"),
        (lambda s, j: of(s, {"temperature.warmer_k": 1.0}), r"it has no \[thermal\] table"),
        (lambda s, j: of(s, {"cover.wall_mm": 1.0}), "it has no tube, dome or window"),
        (
            lambda s, j: of(s, {"lens.k1": 1.0}, {("lens.k1", "lens.k1"): 0.5}),
            "two different errors; got lens.k1 twice",
        ),
        (lambda s, j: of(s, {"lens.k1": -1.0}), "tolerance must be 0, or between"),
        (
            lambda s, j: of(s, {"lens.k1": 1.0}, {("lens.k1", "lens.k2"): 0.5}),
            "requires a tolerance of lens.k2",
        ),
        (
            lambda s, j: allocate(j, of(s, {"lens.k1": 0.1}), {"blur_px": 0.1}, 0.9),
            "the nominal sensor must satisfy",
        ),
        (
            lambda s, j: allocate(j, of(s, {"lens.k1": 0.1}), {"blur_px": 20.0}, 1.5),
            "between 0 and 1",
        ),
        (
            lambda s, j: perturbed(s, {"mirror.zernike_500_um": 1.0}),
            "is not an error source of this sensor",
        ),
    ],
)
def test_invalid_arguments_are_rejected(sensor, evaluator, call, message):
    with pytest.raises(InvalidParameter, match=message):
        call(sensor, evaluator)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[[error]]\nname = 'mirror.tilt_z_deg'\ntolerance = 1",
            "line 2: 'mirror.tilt_z_deg' is not an error source",
        ),
        ("[[error]]\nname = 'lens.k1'\ntolerance = -1", "line 3: .*greater than or equal to 0"),
        (
            "[[error]]\nname = 'lens.k1'\ntolerance = 1\n[[error]]\nname = 'lens.k1'\ntolerance = 1",
            "line 5: .*two tolerances",
        ),
        (
            "[[error]]\nname = 'lens.k1'\ntolerance = 1\n[[limit]]\nquantity = 'blur'\nat_most = 1",
            "line 5: 'blur'",
        ),
        ("[[errors]]\nname = 'lens.k1'", "did you mean error"),
        (
            "[[error]]\nname = 'lens.k1'\ntolerance = 1\nmax_tolerance = 0.5",
            "line 4: max_tolerance must be at least the tolerance 1; got 0.5",
        ),
        ("format = 2", "format must be 1 for this version of omnimirror; got 2"),
        ("", "at least one error"),
    ],
)
def test_invalid_files_are_rejected_with_line(sensor, text, message):
    with pytest.raises(SpecError, match=message):
        parse_tolerances(text, sensor)


def test_command_and_python_agree(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    run = CliRunner().invoke
    assert (
        run(app, ["tolerance", "init", "paper-hyperboloidal"], catch_exceptions=False).exit_code
        == 0
    )
    arguments = [
        "tolerance",
        "paper-hyperboloidal",
        "tolerances.toml",
        "--trials",
        "500",
        "--set",
        "analysis.seed=4",
    ]
    merit = ["--merit", "motion_px after affine=2.5"]
    result = run(
        app, [*arguments, *merit, "--json", "a.json", "-o", "charts"], catch_exceptions=False
    )
    assert result.exit_code == 0
    numbers = json.loads((tmp_path / "a.json").read_text())
    sensor = om.load_sensor("paper-hyperboloidal")
    plan = om.load_tolerances("tolerances.toml", sensor)
    analysis = om.tolerance(
        sensor, plan, limits={"motion_px after affine": 2.5}, trials=500, seed=4
    )
    assert 0.05 < numbers["yield"] < 0.95
    assert numbers["yield"] == analysis.statistics.yields.value
    assert {
        "trials",
        "yield",
        "yield_low",
        "yield_high",
        "sensitivities",
        "seconds",
    } <= numbers.keys()
    assert f"yield {100 * numbers['yield']:.2f} %" in result.output
    for name in ("tornado.svg", "yield.svg", "tolerance.json"):
        assert (tmp_path / "charts" / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["paper-spherical"], "tolerance init paper-spherical"),
        (
            ["paper-spherical", "nothing.toml"],
            "cannot read the tolerance file nothing.toml: the file does not exist",
        ),
        (["init"], "SENSOR is missing"),
        (["paper-spherical", "t.toml", "--merit", "blur_px"], "NAME=LIMIT"),
        (["paper-spherical", "t.toml", "--trials", "0"], "0 is not in the range"),
        # raised before the trials
        (
            ["paper-spherical", "t.toml", "--trials", "2000000000", "--report", "a.pdf"],
            "suffix .html; got a.pdf",
        ),
        (
            [
                "paper-spherical",
                "t.toml",
                "--trials",
                "2000000000",
                "--merit",
                "blur_px=9",
                "--yield",
                "1",
            ],
            "target_yield must be between 0 and 1; got 1",
        ),
    ],
)
def test_invalid_command_prints_one_message(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text("[[error]]\nname = 'lens.k1'\ntolerance = 0.1\n")
    result = CliRunner().invoke(app, ["tolerance", *arguments])
    assert result.exit_code != 0
    assert message in str(result.exception) + result.output
