"""Limits of obscuration in requirements, designs and comparisons, against single rays."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import CameraBody, Housing, Rim, Rod, Tube
from tests.commands import omnimirror
from tests.everyday import few

HOUSINGS = {
    "camera": Housing(CameraBody(60.0, height_mm=20.0)),
    "camera and rod": Housing(CameraBody(60.0), Rod(5.0)),
    "tube and flange": Housing(shell=Tube(), rim=Rim(width_mm=4.0, setback_mm=1.0)),
}


def requirements(*limits, rim=(20.0, 60.0), housing=None):
    return om.Requirements(
        field=om.FieldRequirements(omega_max_deg=120),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=rim),
        lens=om.LensRequirements(theta_max_deg=12, f_number=8),
        housing=housing or HOUSINGS["camera"],
        limits=limits,
    )


@pytest.mark.parametrize("name", few(HOUSINGS, "camera", "tube and flange"))
def test_obscured_fraction_agrees_with_rays_of_pixels(name):
    """Chief rays of a grid of pixels, each traced in space to the obscuring parts."""
    sensor = replace(om.load_sensor("paper-spherical"), housing=HOUSINGS[name])
    side = np.linspace(-1, 1, 241) * sensor.rim_radius_px
    u, v = np.meshgrid(side, side)
    is_inside = np.hypot(u, v) < sensor.rim_radius_px * (1 - 1e-9)
    pixels = np.stack([u[is_inside], v[is_inside]], axis=-1) + sensor.imager.centre
    hidden = np.any([*sensor.obscured_by(pixels).values()], axis=0)
    limit = om.Limit("obscured_percent", at_most=50.0)
    (row,) = om.check_requirements(requirements(limit, rim=43.9), sensor).limits
    assert row.reached == pytest.approx(100 * hidden.mean(), abs=0.15)
    assert row.reached == sensor.obscured_percent
    rows = {row.quantity.name: row.values for row in om.compare([sensor]).rows}
    assert rows["obscured_percent"] == (sensor.obscured_percent,)


def test_central_obscuration_agrees_with_rays():
    sensor = replace(om.load_sensor("paper-spherical"), housing=HOUSINGS["camera"])
    h = om.evaluate(sensor, [sensor.obscured_to_deg - 0.01, sensor.obscured_to_deg + 0.01]).h_px
    pixels = np.array(sensor.imager.centre) + np.array([[h[0], 0.0], [0.0, h[1]]])
    assert sensor.obscured_by(pixels)["camera"].tolist() == [True, False]
    bare = om.load_sensor("paper-spherical")
    assert (bare.obscured_to_deg, bare.obscured_percent) == (0.0, 0)


def test_design_meets_obscuration_limit():
    """Smaller mirrors have more obscuration: a length limit favours those, and the obscuration
    limit opposes it."""
    short = om.Limit("length_mm", at_most=200.0)
    obscured_percent = om.design_sensor(requirements(short)).sensor.obscured_percent
    design = om.design_sensor(
        requirements(short, om.Limit("obscured_percent", at_most=obscured_percent / 2))
    )
    assert design.is_met
    assert design.sensor.obscured_percent <= obscured_percent / 2 * (1 + 1e-6)
    (_, row) = design.verdict.limits
    assert row.reached == pytest.approx(design.sensor.obscured_percent, rel=1e-12)


def test_zero_obscuration_may_be_required():
    limit = om.Limit("obscured_to_deg", at_most=0.0)
    verdict = om.check_requirements(
        requirements(limit, rim=43.9, housing=Housing()), om.load_sensor("paper-spherical")
    )
    assert verdict.limits[0].is_met


def test_obscuration_limit_rejects_field_range():
    with pytest.raises(InvalidParameter, match="omega_deg must be omitted"):
        om.Limit("obscured_percent", at_most=3.0, omega_deg=(0.0, 20.0))


def test_design_without_limits_reports_obscuration():
    """The disc around the lens obscures light from a field angle on: by rays of the designed
    sphere."""
    arguments = (
        "--mirror",
        "sphere",
        "--omega-max-deg",
        110,
        "--rim-radius-mm",
        30,
        "--focal-length-mm",
        8,
    )
    stdout = omnimirror(
        "design", *arguments, "--f-number", 4, "--set", "housing.camera.diameter_mm=120"
    ).stdout
    assert "obscured: camera 0 to " in stdout
    angle_deg = float(re.search(r"camera 0 to ([\d.]+) deg", stdout)[1])
    distance = float(re.search(r"lens ([\d.]+) mm", stdout)[1])
    theta = float(re.search(r"theta_max_deg = ([\d.]+)", stdout)[1])
    slope_deg = (110 - theta) / 2  # of the rim: the normal bisects the angle
    radius = 30 / np.sin(np.radians(slope_deg))

    def point(a):
        return radius * np.sin(a), radius * (1 - np.cos(a))

    def omega(a):
        x, z = point(a)
        return 2 * a + np.arctan2(x, distance + z)

    x, z = point(brentq(lambda a: omega(a) - np.radians(angle_deg), 0, 1.2))
    assert x + (distance + z) * np.tan(np.radians(angle_deg)) == pytest.approx(60, rel=2e-3)
