"""Sobol indices against analytic results."""

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing.tolerancing.compensation import MERITS, merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.sensitivity import sobol_indices

NAMES = ("mirror.decentre_x_mm", "mirror.tilt_y_deg", "lens.k1", "imager.shift_x_px")
VARIANCES = {"uniform": 1 / 3, "normal": 1 / 4, "arcsine": 1 / 2}
"""Variances for a tolerance of 1."""


class Formula:
    """Evaluator whose motion is a formula of the errors."""

    names = merit_names()

    def __init__(self, formula):
        self.formula = formula

    def evaluate(self, values):
        merits = np.zeros((len(next(iter(values.values()))), MERITS))
        merits[:, merit_names().index("motion_px")] = self.formula(*values.values())
        return merits


@pytest.fixture(scope="module")
def sensor():
    return om.load_sensor("paper-spherical")


def shares_of(sensor, formula, bounds, correlations=None, **more):
    tolerances = om.Tolerances(sensor, dict(zip(NAMES, bounds, strict=False)), correlations or {})
    indices = sobol_indices(Formula(formula), tolerances, ("motion_px",), **more)
    return indices.groups, indices.indices["motion_px"]


def test_indices_of_a_linear_merit(sensor):
    """sum a_i e_i: first-order and total indices are both proportional to a_i^2 var_i."""
    laws, rates = ("uniform", "normal", "arcsine", "uniform"), np.array([3.0, -2.0, 1.0, 0.0])
    bounds = [om.Tolerance(1.0, law) for law in laws]
    groups, indices = shares_of(
        sensor, lambda *e: 7 + sum(a * v for a, v in zip(rates, e, strict=True)), bounds
    )
    exact = rates**2 * [VARIANCES[law] for law in laws]
    exact /= exact.sum()
    for name, share in zip(NAMES, exact, strict=True):
        assert indices[name].first == pytest.approx(share, abs=0.01)
        assert indices[name].total == pytest.approx(share, abs=0.01)
    assert groups == {"position of the mirror": NAMES[:2]}
    assert indices["position of the mirror"].total == pytest.approx(exact[:2].sum(), abs=0.01)


def test_indices_of_the_ishigami_function(sensor):
    """sin x + 7 sin^2 y + 0.1 z^4 sin x on the cube of +- pi (Ishigami and Homma, 1990)."""
    a, b, pi = 7.0, 0.1, np.pi
    variance = a**2 / 8 + b * pi**4 / 5 + b**2 * pi**8 / 18 + 0.5
    x, y, xz = 0.5 * (1 + b * pi**4 / 5) ** 2, a**2 / 8, b**2 * pi**8 * (1 / 18 - 1 / 50)
    bounds = [om.Tolerance(pi)] * 3
    _, indices = shares_of(
        sensor,
        lambda x, y, z: np.sin(x) + a * np.sin(y) ** 2 + b * z**4 * np.sin(x),
        bounds,
        draws=1024,
    )
    exact = {NAMES[0]: (x, x + xz), NAMES[1]: (y, y), NAMES[2]: (0.0, xz)}
    for name, (first, total) in exact.items():
        assert indices[name].first == pytest.approx(
            first / variance, abs=max(0.01, 4 * indices[name].first_error)
        )
        assert indices[name].total == pytest.approx(
            total / variance, abs=max(0.01, 4 * indices[name].total_error)
        )


def test_correlated_errors_have_one_index(sensor):
    bounds = [om.Tolerance(1.0, "normal")] * 3
    pair = {(NAMES[0], NAMES[2]): 0.8}
    groups, indices = shares_of(sensor, lambda x, y, z: x + y + z, bounds, pair)
    both = f"{NAMES[0]} + {NAMES[2]}"
    assert groups[both] == (NAMES[0], NAMES[2])
    assert not {NAMES[0], NAMES[2]} & indices.keys()
    assert indices[both].first == pytest.approx(3.6 / 4.6, abs=0.01)
    assert indices[NAMES[1]].total == pytest.approx(1 / 4.6, abs=0.01)


def test_decentre_and_tilt_of_a_sphere_form_one_group(sensor):
    """A tilted sphere is a decentred sphere: if both cancel, single indices are small and the group
    has all of it.
    """
    radius = sensor.mirror.radius_mm
    tilt = np.degrees(0.2 / radius)
    errors = {
        "mirror.decentre_x_mm": 0.2,
        "mirror.tilt_y_deg": float(tilt),
        "imager.shift_y_px": 0.3,
    }
    tolerances = om.Tolerances(
        sensor, {name: om.Tolerance(value) for name, value in errors.items()}
    )
    indices = sobol_indices(TrialEvaluator.of(sensor), tolerances, ("motion_px",)).indices[
        "motion_px"
    ]
    decentre, turn, group = (indices[n] for n in (*NAMES[:2], "position of the mirror"))
    assert decentre.total == pytest.approx(turn.total, abs=0.03)
    assert decentre.first + turn.first < 0.6 * group.first
    assert decentre.total + turn.total > 1.3 * group.total


def test_invalid_arguments_are_rejected(sensor):
    tolerances = om.Tolerances(sensor, {"lens.k1": om.Tolerance(0.1)})
    with pytest.raises(InvalidParameter, match="got 'blur'"):
        sobol_indices(TrialEvaluator.of(sensor), tolerances, ("blur",))
    invalid_tolerances = om.Tolerances(
        sensor, {"mirror.displacement_mm": om.Tolerance(1e6, "arcsine")}
    )
    with pytest.raises(
        InvalidParameter, match=r"at most half of the trials may lose rays; got 100 %"
    ):
        sobol_indices(TrialEvaluator.of(sensor), invalid_tolerances, ("motion_px",))
