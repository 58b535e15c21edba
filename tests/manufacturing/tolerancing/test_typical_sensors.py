"""Typical sensors as files."""

import numpy as np
import pytest
from click.testing import CliRunner

import omnimirror as om
from omnimirror.apps.cli import app
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing.tolerancing.compensation import merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator


@pytest.fixture(scope="module")
def sensor():
    return om.load_sensor("paper-hyperboloidal")


def plan_of(sensor, **sizes):
    names = {name.replace("__", "."): om.Tolerance(size) for name, size in sizes.items()}
    return om.TolerancePlan(om.Tolerances(sensor, names))


def test_quantile_of_trials(sensor):
    plan = plan_of(
        sensor, mirror__decentre_x_mm=0.1, imager__shift_y_px=2.0, imager__rotation_deg=0.2
    )
    merits = TrialEvaluator.of(sensor).evaluate(plan.tolerances.drawn(3, 0, 2000))[
        :, merit_names().index("motion_px")
    ]
    for typical in om.typical_sensors(
        sensor, plan, quantiles=(0.05, 0.5, 0.95), trials=2000, seed=3
    ):
        assert (merits <= typical.merit).mean() == pytest.approx(typical.quantile, abs=1e-9)
        assert merits[typical.trial] == pytest.approx(typical.merit)


def test_typical_sensor_has_its_merit(sensor, tmp_path):
    parts = {
        "mirror__decentre_x_mm": 0.1,
        "mirror__tilt_y_deg": 0.1,
        "mirror__zernike_8_um": 20.0,
        "lens__k1": 0.01,
    }
    plan = plan_of(sensor, **parts, imager__rotation_deg=0.2, imager__tilt_y_deg=0.5)
    (worst,) = om.typical_sensors(sensor, plan, quantiles=(0.95,), trials=500)
    om.save_sensor(worst.sensor, tmp_path / "worst.toml")
    built, field = om.load_sensor(tmp_path / "worst.toml"), TrialEvaluator.of(sensor).field
    world = field.targets @ sensor._axes.T
    motion = built.project_directions(world).pixels - sensor.project_directions(world).pixels
    assert np.hypot(*motion.T).max() == pytest.approx(worst.merit, rel=1e-9)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"merit": "blur"}, "'blur' is not a merit"),
        ({"quantiles": (1.5,)}, "quantiles must be between 0 and 1; got 1.5"),
        ({"quantiles": (1.0,)}, "at the quantile 1 lose rays"),
    ],
)
def test_invalid_arguments_are_rejected(sensor, more, message):
    with pytest.raises(InvalidParameter, match=message):
        om.typical_sensors(
            sensor, plan_of(sensor, mirror__decentre_x_mm=1000.0), trials=200, **more
        )


def test_command_writes_sensors_and_images(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    small = om.load_sensor("paper-spherical")
    text = om.optics.sensor_files.format_sensor(small).replace("1024", "128").replace("5.2", "41.6")
    (tmp_path / "small.toml").write_text(text)
    (tmp_path / "t.toml").write_text(
        "".join(
            f"[[error]]\nname = '{part}.tilt_x_deg'\ntolerance = 0.5\n"
            for part in ("mirror", "imager")
        )
    )
    arguments = [
        "tolerance",
        "small.toml",
        "t.toml",
        "--trials",
        "200",
        "--set",
        "analysis.typical_sensors=true",
    ]
    failure = CliRunner().invoke(app, arguments)
    assert "analysis.typical_sensors requires --output" in failure.output
    result = CliRunner().invoke(app, [*arguments, "-o", "o"], catch_exceptions=False)
    assert result.exit_code == 0
    assert "sensor 95 %: trial" in result.output
    for name in ("05", "50", "95"):
        built = om.load_sensor(tmp_path / "o" / f"sensor-{name}.toml")
        assert built.mirror_pose.tilt_x_deg != 0
        assert built.imager_pose.tilt_x_deg != 0
        assert om.read_image(tmp_path / "o" / f"image-{name}.png").shape == (128, 128, 3)
