"""Limits of size and mass, and temperature ranges of limits: in files, verdicts and designs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.design.merits import outer_size
from omnimirror.design.requirement_files import parse_requirements
from omnimirror.optics.housing import Dome, FlatWindow, Housing
from omnimirror.optics.lenses import SurfaceLens
from tests.optics.lenses import prescriptions

TEXT = """
[field]
omega_max_deg = 120

[mirror]
family = "sphere"
rim_radius_mm = [15, 60]

[lens]
theta_max_deg = 12.0
f_number = 8.0
"""


def limited(quantity, at_most):
    return f'\n[[limit]]\nquantity = "{quantity}"\nat_most = {at_most}\n'


def rows(requirements, sensor):
    return {row.name: row.reached for row in om.check_requirements(requirements, sensor).limits}


def test_sizes_and_mass_agree_with_solids():
    """Spherical cap with 5 mm behind it in a dome, by textbook formulas."""
    names = ("overall_diameter_mm", "overall_height_mm", "mirror_body_mass_g")
    requirements = parse_requirements(TEXT + "".join(limited(name, 1e3) for name in names))
    sensor = om.load_sensor("paper-spherical")
    M, A, m = sensor.mirror.rim_radius_mm, sensor.mirror.radius_mm, sensor.mirror_distance_mm
    height = A - np.sqrt(A**2 - M**2)
    cap = np.pi * height**2 * (A - height / 3)
    values = rows(requirements, sensor)
    assert values["overall_diameter_mm"] == pytest.approx(2 * M)
    assert values["overall_height_mm"] == pytest.approx(sensor.lens.image_distance + m + height + 5)
    body = np.pi * M**2 * (height + 5) - (np.pi * M**2 * height - cap)
    assert values["mirror_body_mass_g"] == pytest.approx(2.70e-3 * body, rel=1e-6)
    acrylic = replace(sensor, thermal=om.Thermal(mirror_material="acrylic"))
    assert rows(requirements, acrylic)["mirror_body_mass_g"] == pytest.approx(
        1.19e-3 * body, rel=1e-6
    )
    domed = replace(sensor, housing=Housing(shell=Dome(diameter_mm=320.0)))
    assert rows(requirements, domed)["overall_diameter_mm"] == pytest.approx(320.0)
    behind_a_window = replace(sensor, housing=Housing(shell=FlatWindow()))
    assert outer_size(behind_a_window).diameter_mm == pytest.approx(2 * M)


@pytest.mark.parametrize(
    ("quantity", "at_most"), [("mirror_body_mass_g", 40.0), ("overall_height_mm", 120.0)]
)
def test_design_meets_size_and_mass_limits(quantity, at_most):
    """Larger mirrors with this lens are sharper: a blur limit favours those, and size and mass
    limits oppose it."""
    blur = limited("total_blur_deg", 5.0)
    free = om.design_sensor(parse_requirements(TEXT + blur)).sensor
    requirements = parse_requirements(TEXT + blur + limited(quantity, at_most))
    assert rows(requirements, free)[quantity] > 1.5 * at_most
    design = om.design_sensor(requirements)
    assert design.is_met
    assert design.sensor.mirror.rim_radius_mm < free.mirror.rim_radius_mm


def test_overall_height_starts_at_imager_of_surface_lens(tmp_path):
    """Its principal points are inside, separated as determined by its glasses."""
    (tmp_path / "triplet.zmx").write_text(prescriptions.zmx())
    lens = SurfaceLens.from_file(tmp_path / "triplet.zmx", focus_distance_mm=200.0)
    sensor = replace(om.load_sensor("paper-spherical"), lens=lens)
    _, (_, top) = sensor.mirror.bounds
    to_imager = prescriptions.imager_place(prescriptions.indices(), 200.0)
    expected = sensor.mirror_distance_mm + sum(prescriptions.GAPS[:-1]) + to_imager + top + 5
    assert outer_size(sensor).height_mm == pytest.approx(expected, abs=1e-6)


def test_size_and_mass_limits_reject_field_range():
    with pytest.raises(
        OmnimirrorError,
        match="omega_deg must be omitted, since the quantity concerns the whole sensor",
    ):
        om.Limit("mirror_body_mass_g", at_most=40.0, omega_deg=(10.0, 20.0))
    assert outer_size(om.load_sensor("paper-spherical")).diameter_mm > 80


# -- temperatures ----------------------------------------------------------------------------------


WARM = (
    TEXT.replace("[15, 60]", "43.905")
    + limited("total_blur_px", 7.0)
    + """
[thermal]
mirror_material = "acrylic"
spacer_material = "aluminium"
range_c = [-20, 60]
"""
)


def test_limits_are_evaluated_at_both_temperatures():
    requirements = parse_requirements(WARM)
    assert requirements.temperatures_c == (-20.0, 60.0)
    assert parse_requirements(om.format_requirements(requirements)) == requirements
    sensor = om.load_sensor("paper-spherical")
    (row,) = om.check_requirements(requirements, sensor).limits
    thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    plain = replace(requirements, thermal=None, temperatures_c=None)
    thermal_sensor = replace(sensor, thermal=thermal)
    values = [
        rows(plain, om.at_temperature(thermal_sensor, c))["total_blur_px"]
        for c in (20.0, -20.0, 60.0)
    ]
    assert row.reached == pytest.approx(max(values), rel=1e-9)
    assert np.ptp(values) > 0.01
    assert "smallest margin at" in row.remarks[-1]


def test_design_reports_thermal_shift():
    design = om.design_sensor(parse_requirements(WARM))
    assert design.sensor.thermal == om.Thermal(
        mirror_material="acrylic", spacer_material="aluminium"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (WARM.replace("[-20, 60]", "[30, 60]"), "must contain reference_c = 20"),
        (WARM.replace("[-20, 60]", "[-20]"), "range_c"),
        (WARM.replace('"acrylic"', '"cheese"'), "mirror_material"),
        (WARM.replace('"acrylic"', '"acrylic"\nmirror_ppm_per_k = 3.0'), "must not both be given"),
        (
            WARM.replace(limited("total_blur_px", 7.0), ""),
            "requires at least one \\[\\[limit\\]\\]",
        ),
    ],
)
def test_invalid_entries_raise_one_message(text, message):
    with pytest.raises(OmnimirrorError, match=message) as error:
        parse_requirements(text)
    assert "\n" not in str(error.value)
