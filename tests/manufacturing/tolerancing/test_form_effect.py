"""Effect of form errors on the image against sensors with sampled profiles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import eval_legendre

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from tests.manufacturing.metrology.clouds import on


@pytest.mark.parametrize("name", ["paper-spherical", "paper-hyperboloidal", "exact-equidistant"])
def test_motion_matches_a_sampled_profile(name):
    sensor = om.load_sensor(name)
    form = om.form_error(
        sensor.mirror, on(sensor.mirror, {11: 4.0, 22: -2.0}, 0.0, count=4000), order=2
    )
    effect, sensor_as_built = om.form_effect(sensor, form), om.as_built(sensor, form)
    objects = TrialEvaluator.of(sensor).field.targets @ sensor._axes.T
    motion = (
        sensor_as_built.project_directions(objects).pixels
        - sensor.project_directions(objects).pixels
    )
    assert effect.as_built["motion_px"] > 0.03
    assert effect.as_built["motion_px"] == pytest.approx(np.nanmax(np.hypot(*motion.T)), rel=0.03)
    assert effect.nominal["motion_px"] < 1e-9
    assert effect.lost_rays == 0


def test_radial_calibration_compensates_symmetric_form_only():
    sensor = om.load_sensor("paper-hyperboloidal")
    left = {}
    for term in (11, 6):
        merits = om.form_effect(
            sensor, om.form_error(sensor.mirror, on(sensor.mirror, {term: 2.0}, 0.0))
        ).as_built
        left[term] = merits["motion_px after radial"] / merits["motion_px"]
    assert left[11] < 0.05
    assert left[6] > 0.2


def test_untraced_terms_are_reported():
    sensor = om.load_sensor("paper-spherical")
    points = on(sensor.mirror, {}, 0.0, count=6000)
    r = np.hypot(points[:, 0], points[:, 1]) / sensor.mirror.rim_radius_mm
    for order in (6, 10, 14):  # 1 um RMS each, rotationally symmetric
        points[:, 2] += 1e-3 * np.sqrt(order + 1) * eval_legendre(order // 2, 2 * r**2 - 1)
    effect = om.form_effect(sensor, om.form_error(sensor.mirror, points))
    assert effect.untraced_um == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("name", ["paper-spherical", "folded-spherical", "paraboloid-telecentric"])
def test_as_built_sensor_is_saved_and_loaded(name, tmp_path):
    sensor = om.load_sensor(name)
    sensor_as_built = om.as_built(
        sensor, om.form_error(sensor.mirror, on(sensor.mirror, {11: 3.0}, 0.1))
    )
    om.save_sensor(sensor_as_built, tmp_path / "made.toml")
    reloaded = om.load_sensor(tmp_path / "made.toml")
    radii = [
        om.evaluate(each, np.linspace(40.0, 75.0, 9)).h_px
        for each in (sensor, sensor_as_built, reloaded)
    ]
    np.testing.assert_allclose(radii[2], radii[1], rtol=1e-9)
    assert np.abs(radii[1] - radii[0]).max() > 0.02


def test_form_error_of_another_mirror_is_rejected():
    sensor, other = om.load_sensor("paper-spherical"), om.load_sensor("paper-hyperboloidal")
    form = om.form_error(other.mirror, on(other.mirror, {}, 0.1))
    for use in (om.form_effect, om.as_built):
        with pytest.raises(
            InvalidParameter, match="must belong to the mirror of 'paper-spherical'"
        ):
            use(sensor, form)
