"""Measured and random form errors as error sources of trials."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.base.numerics import noll
from omnimirror.manufacturing.tolerancing.compensation import merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.mirror_form import RandomFigure, load_measured_form
from omnimirror.manufacturing.tolerancing.tolerance_file import load_tolerances, parse_tolerances
from omnimirror.optics.mirrors.mirror import MirrorForm

SENSOR = om.load_sensor("paper-spherical")
RIM = SENSOR.mirror.rim_radius_mm
MOTION = merit_names().index("motion_px")


def height(form, xy):
    return form.heights(RIM, xy).z * 1e3


@pytest.fixture
def measured_points(tmp_path):
    """Return noisy points of a mirror with astigmatism and a term of order 10."""
    form = MirrorForm((6, 64), (2.0, -0.5))
    rng = np.random.default_rng(3)
    r, phi = RIM * np.sqrt(rng.uniform(0, 1, 9000)), rng.uniform(0, 2 * np.pi, 9000)
    xy = np.stack([r * np.cos(phi), r * np.sin(phi)], axis=-1)
    z = SENSOR.mirror.sag(r) + 1e-3 * height(form, xy) + 5e-5 * rng.normal(size=9000)
    np.savetxt(tmp_path / "cmm.csv", np.column_stack([xy, z]), delimiter=",")
    return form


def test_measured_form_is_a_constant_error(measured_points, tmp_path):
    (tmp_path / "t.toml").write_text('[[measured]]\nname = "lathe"\nfile = "cmm.csv"\n')
    plan = load_tolerances(tmp_path / "t.toml", SENSOR)
    values = plan.tolerances.drawn(seed=0, block=0, count=50)
    amplitudes = {int(name.split("_")[1]): of[0] for name, of in values.items()}
    assert all((of == of[0]).all() for of in values.values())
    assert amplitudes[6] == pytest.approx(2.0, abs=0.01)
    assert amplitudes[64] == pytest.approx(-0.5, abs=0.01)
    # the motion equals that of a sensor whose file contains the form
    expected = TrialEvaluator.of(SENSOR).evaluate(
        {f"mirror.zernike_{j}_um": np.array([um]) for j, um in amplitudes.items()}
    )
    report = om.tolerance(SENSOR, plan, trials=50)
    assert report.statistics.mean("motion_px") == pytest.approx(expected[0, MOTION], rel=1e-6)
    assert report.sensitivities[0].name == "mirror.measured[lathe]"
    assert report.sensitivities[0].rates["motion_px"].first == pytest.approx(
        expected[0, MOTION], rel=0.02
    )


def test_random_figure_amplitudes_and_spectrum():
    grid = np.linspace(-1, 1, 61)
    xy = RIM * np.stack(np.meshgrid(grid, grid), axis=-1).reshape(-1, 2)
    xy = xy[np.hypot(*xy.T) <= RIM]
    cases = {"rms_um": 0.4, "peak_to_valley_um": 2.0, "slope_mrad": 0.05}
    for name, size in cases.items():
        sigmas = RandomFigure(2.0, (3, 9), **{name: size}).sigmas_um(RIM)
        assert {noll(j)[0] for j in sigmas} == set(range(3, 10))
        of_orders = {noll(j)[0]: sigma for j, sigma in sigmas.items()}
        assert of_orders[8] / of_orders[4] == pytest.approx(0.5)  # per octave, in amplitude
        rng, spectra = np.random.default_rng(7), []
        for _ in range(60):
            form = MirrorForm(
                tuple(sigmas), tuple(rng.normal() * sigma for sigma in sigmas.values())
            ).heights(RIM, xy)
            z, slope = 1e3 * form.z, 1e3 * np.hypot(form.gx, form.gy)
            spectra.append(
                {
                    "rms_um": z.std(),
                    "peak_to_valley_um": np.ptp(z),
                    "slope_mrad": np.sqrt((slope**2).mean()),
                }
            )
        mean = (
            np.sqrt(np.mean([f[name] ** 2 for f in spectra]))
            if name != "peak_to_valley_um"
            else np.mean([f[name] for f in spectra])
        )
        assert mean == pytest.approx(size, rel=0.08)


def test_figure_table_defines_zernike_errors():
    text = '[[error]]\nname = "lens.k1"\ntolerance = 0.01\n[[figure]]\nrms_um = 0.3\norders = [7, 9]\ncost = 2.0\n'
    plan = parse_tolerances(text, SENSOR)
    assert len(plan.tolerances.errors) == 1 + 8 + 9 + 10
    values = plan.tolerances.drawn(seed=1, block=0)
    power = sum(np.mean(of**2) for name, of in values.items() if "zernike" in name)
    assert np.sqrt(power) == pytest.approx(0.3, rel=0.02)
    assert plan.costs["mirror.zernike_40_um"] == 2.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[figure]]\norders = [3, 40]\nrms_um = 1.0", "orders must be between 2 and 12"),
        ("[[figure]]\norders = [3, 5]", "one of rms_um, peak_to_valley_um and slope_mrad"),
        (
            "[[figure]]\nrms_um = 1.0\nslope_mrad = 1.0",
            "one of rms_um, peak_to_valley_um and slope_mrad",
        ),
        (
            '[[error]]\nname = "mirror.zernike_5_um"\ntolerance = 1.0\n[[figure]]\nrms_um = 1.0',
            "mirror.zernike_5_um has two tolerances",
        ),
        (
            '[[measured]]\nname = "a"\nfile = "/etc/passwd"',
            "not supported in text without a folder",
        ),
    ],
)
def test_invalid_tables_are_rejected(text, message):
    with pytest.raises(SpecError, match=message):
        parse_tolerances(text, SENSOR)


def test_invalid_measurements_are_rejected(tmp_path):
    (tmp_path / "t.toml").write_text('[[measured]]\nname = "a"\nfile = "none.csv"\n')
    with pytest.raises(SpecError, match=r"none\.csv"):
        load_tolerances(tmp_path / "t.toml", SENSOR)
    x, y = (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-30, 30, 41)]))
    np.savetxt(
        tmp_path / "perfect.csv",
        np.stack([x, y, SENSOR.mirror.sag(np.hypot(x, y))], axis=-1),
        delimiter=",",
    )
    with pytest.raises(InvalidParameter, match="must exceed its noise"):
        load_measured_form(SENSOR.mirror, tmp_path / "perfect.csv")
