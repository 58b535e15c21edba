"""Thermal analysis against lengths calculated by hand and rays through the expanded parts."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.optics.housing import Housing, Tube
from omnimirror.optics.materials import MATERIALS
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.sensor_files import format_sensor
from omnimirror.optics.thermal import DENSITIES_G_PER_CM3, EXPANSIONS_PPM, INDEX_RATES_PER_K
from tests.commands import omnimirror
from tests.conftest import MIRRORS, sensor_of

BALL = om.load_sensor("prototype-spherical")
ACRYLIC = om.Thermal(mirror_material="acrylic", spacer_material="aluminium", imager_ppm_per_k=0.0)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_mirror_expands_uniformly(kind):
    mirror, factor = sensor_of(kind).mirror, 1.0028
    expanded = mirror.scaled(factor)
    x = np.linspace(0.0, 0.999 * mirror.rim_radius_mm, 300)
    np.testing.assert_allclose(expanded.sag(factor * x), factor * mirror.sag(x), atol=1e-12)
    np.testing.assert_allclose(expanded.slope(factor * x), mirror.slope(x), atol=1e-12)
    np.testing.assert_allclose(
        expanded.curvature(factor * x), mirror.curvature(x) / factor, rtol=1e-9, atol=1e-12
    )


def test_acrylic_ball_on_aluminium_spacer_shifts_image():
    warm = om.at_temperature(replace(BALL, thermal=ACRYLIC), 60.0)
    by_hand = replace(
        BALL,
        mirror=Sphere(
            BALL.mirror.radius_mm * (1 + 40 * 70e-6), BALL.mirror.rim_radius_mm * (1 + 40 * 70e-6)
        ),
        mirror_distance_mm=BALL.mirror_distance_mm * (1 + 40 * 23.6e-6),
    )
    omega = np.radians(np.linspace(1.0, BALL.field_deg[1] - 0.5, 60))
    directions = np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1) @ BALL._axes.T
    shift = (
        by_hand.project_directions(directions).pixels - BALL.project_directions(directions).pixels
    )
    worst = np.hypot(*shift.T).max()
    assert worst == pytest.approx(0.77, abs=0.01)
    np.testing.assert_allclose(
        warm.project_directions(directions).pixels,
        by_hand.project_directions(directions).pixels,
        atol=1e-9,
    )
    assert om.thermal_motion_px(replace(BALL, thermal=ACRYLIC), 60.0) == pytest.approx(
        worst, rel=0.01
    )


def test_equal_expansion_leaves_image_unchanged():
    """All lengths scale equally: rays keep their directions, and pixels scale with the image."""
    names = (
        "mirror_ppm_per_k",
        "spacer_ppm_per_k",
        "mount_ppm_per_k",
        "imager_ppm_per_k",
        "focal_ppm_per_k",
    )
    uniform = replace(BALL, thermal=om.Thermal(**dict.fromkeys(names, 23.6)))
    assert om.thermal_motion_px(uniform, 80.0) < 1e-9
    assert (
        om.thermal_motion_px(
            replace(uniform, thermal=replace(uniform.thermal, focal_ppm_per_k=0.0)), 80.0
        )
        < 1e-9
    )
    assert (
        om.thermal_motion_px(
            replace(uniform, thermal=replace(uniform.thermal, mount_ppm_per_k=0.0)), 80.0
        )
        > 0.3
    )


def test_held_rim_keeps_position():
    warm = om.at_temperature(
        replace(BALL, thermal=replace(ACRYLIC, held_at="rim", spacer_material=None)), 60.0
    )
    heights = [
        s.mirror_distance_mm + float(s.mirror.sag(s.mirror.rim_radius_mm)) for s in (BALL, warm)
    ]
    assert heights[0] == pytest.approx(heights[1], abs=1e-9)


def test_mount_expansion_shifts_imager_and_focus():
    thermal = om.Thermal(mount_ppm_per_k=100.0, focal_ppm_per_k=30.0)
    warm = om.at_temperature(replace(BALL, thermal=thermal), 30.0).lens
    f = BALL.lens.focal_length_mm * (1 + 10 * 30e-6)
    image_distance = (
        1 / (1 / BALL.lens.focal_length_mm - 1 / BALL.lens.focus_distance_mm) * (1 + 10 * 100e-6)
    )
    assert warm.focal_length_mm == pytest.approx(f, rel=1e-12)
    assert 1 / f - 1 / warm.focus_distance_mm == pytest.approx(1 / image_distance, rel=1e-12)


def test_wall_expands_and_index_decreases():
    housing = Housing(
        shell=Tube(diameter_mm=110.0, wall_mm=3.0, material="acrylic", medium="water")
    )
    tube = om.at_temperature(
        replace(BALL, housing=housing, thermal=om.Thermal()), 60.0
    ).housing.shell
    assert tube.diameter_mm == pytest.approx(110.0 * (1 + 40 * 70e-6))
    assert tube.index == pytest.approx(1.4918 - 40 * 1.05e-4)
    assert tube.outer_index == pytest.approx(1.3331 - 40 * 1e-4)


def test_temperature_round_trip():
    sensor = replace(BALL, thermal=replace(ACRYLIC, mount_material="brass", focal_ppm_per_k=20.0))
    result = om.at_temperature(om.at_temperature(sensor, 60.0), 20.0)
    assert result.mirror_distance_mm == pytest.approx(sensor.mirror_distance_mm, rel=2e-6)
    assert result.thermal == sensor.thermal
    assert om.at_temperature(sensor, 20.0) is sensor


def test_thermal_file_round_trip(tmp_path):
    sensor = replace(BALL, thermal=replace(ACRYLIC, held_at="rim", reference_c=0.0))
    copy = om.parse_sensor(format_sensor(sensor))
    assert copy.thermal == sensor.thermal
    assert om.parse_sensor(format_sensor(BALL)).thermal is None
    with pytest.raises(SpecError, match=r"mirror_material.*acrylic"):
        om.parse_sensor(format_sensor(sensor).replace('"acrylic"', '"cheese"'))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda: om.at_temperature(BALL, 60.0),
            r"thermal model .* is missing; add a table \[thermal\]",
        ),
        (
            lambda: om.Thermal(mirror_material="acrylic", mirror_ppm_per_k=70.0),
            "must not both be given",
        ),
        (
            lambda: om.Thermal(mirror_material="cheese"),
            "mirror_material must be one of abs, acrylic, aluminium, bk7, brass, carbon_fibre, copper, ",
        ),
        (
            lambda: om.at_temperature(replace(BALL, thermal=ACRYLIC), -300.0),
            r"temperature_c must be between -273 and 1000 C; got -300\.0",
        ),
        (
            lambda: om.at_temperature(
                replace(BALL, thermal=om.Thermal(mount_ppm_per_k=-99.0, focal_ppm_per_k=5e3)), 60.0
            ),
            "where no object is in focus",
        ),
        (
            lambda: om.at_temperature(
                replace(
                    om.load_sensor("paraboloid-telecentric"),
                    thermal=om.Thermal(mount_material="brass"),
                ),
                60.0,
            ),
            "not supported for lenses of kind orthographic",
        ),
    ],
)
def test_invalid_conditions_rejected(call, message):
    with pytest.raises(InvalidParameter, match=message):
        call()


def test_temperature_range_ends_at_requirement_limit():
    sensor = replace(om.load_sensor("paper-spherical"), thermal=ACRYLIC)
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=130.0),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.905),
        lens=om.LensRequirements(theta_max_deg=12.0),
        limits=(om.Limit("total_blur_px", at_most=7.9),),
    )
    at_50 = next(
        row
        for row in om.check_requirements(requirements, om.at_temperature(sensor, 50.0)).rows
        if row.is_limit
    )
    requirements = replace(requirements, limits=(om.Limit("total_blur_px", at_most=at_50.reached),))
    result = om.temperature_range(requirements, sensor, coldest_c=-40.0, warmest_c=85.0)
    assert result.high_c == pytest.approx(50.0, abs=0.15)
    for c, is_met in ((result.high_c - 0.2, True), (result.high_c + 0.2, False), (-39.0, True)):
        blur = next(
            row
            for row in om.check_requirements(requirements, om.at_temperature(sensor, c)).rows
            if row.is_limit
        )
        assert blur.is_met is is_met
    assert result.low_c == -40.0
    assert (result.below, result.above) == ((), ("total_blur_px",))
    infeasible = om.temperature_range(
        replace(requirements, limits=(om.Limit("total_blur_px", at_most=1.0),)), sensor
    )
    assert np.isnan(infeasible.low_c)
    with pytest.raises(
        InvalidParameter,
        match=r"must enclose the reference temperature of the sensor, 20 C; got 30 and 40",
    ):
        om.temperature_range(requirements, sensor, coldest_c=30.0, warmest_c=40.0)


def test_command_line_reports_image_motion(tmp_path):
    sensor = tmp_path / "warm.toml"
    om.save_sensor(replace(BALL, thermal=ACRYLIC), sensor)
    done = omnimirror(
        "evaluate",
        sensor,
        "--temperature-c",
        60,
        "--omega-deg",
        "0:120:30",
        "--json",
        tmp_path / "a.json",
    )
    assert done.returncode == 0, done.stderr
    assert "image motion between 20 C and 60 C: up to 0.768 px" in " ".join(done.stdout.split())
    assert json.loads((tmp_path / "a.json").read_text())
    failure = omnimirror("evaluate", "prototype-spherical", "--temperature-c", 60)
    assert failure.returncode not in (0, 70)
    assert "add a table [thermal]" in failure.stderr


# Expansion near room temperature, 1e-6/K, and density, g/cm^3; a second copy of the table, which
# detects typing errors. Aluminium 6061, titanium grade 2, nickel 200, copper: ASM Handbook, volume
# 2; Carpenter Invar 36; Schott N-BK7; Corning 7980; Crystran sapphire, mean of both axes; silicon: CRC
# Handbook; Plexiglas GS. Other alloys and plastics, which vary by several per cent: mean values of data sheets.
HANDBOOK = {
    "abs": (90.0, 1.05),
    "acrylic": (70.0, 1.19),
    "aluminium": (23.6, 2.70),
    "bk7": (7.1, 2.51),
    "brass": (19.0, 8.5),
    "carbon_fibre": (1.0, 1.6),
    "copper": (16.7, 8.94),
    "fused_silica": (0.55, 2.20),
    "invar": (1.3, 8.05),
    "nickel": (13.3, 8.89),
    "pla": (68.0, 1.24),
    "polyamide": (80.0, 1.14),
    "polycarbonate": (66.0, 1.20),
    "sapphire": (5.3, 3.98),
    "silicon": (2.6, 2.33),
    "stainless_steel": (16.5, 7.98),
    "steel": (12.0, 7.86),
    "titanium": (8.6, 4.51),
}


@pytest.mark.parametrize(
    "material", sorted(EXPANSIONS_PPM.keys() | DENSITIES_G_PER_CM3.keys() | HANDBOOK.keys())
)
def test_material_properties_match_handbooks(material):
    expansion, density = HANDBOOK[material]
    assert EXPANSIONS_PPM[material] == pytest.approx(expansion, abs=0.1)
    assert DENSITIES_G_PER_CM3[material] == pytest.approx(density, abs=0.05)


def schott_rate(n, wavelength_um, coefficients, temperature_c):
    """Return dn/dT relative to air by Eqs. 3.19 to 3.21 of Hartmann, "Optical Glass" (Schott TIE-19)."""
    D0, D1, D2, E0, E1, wavelength_tk = coefficients
    warmer = temperature_c - 20.0
    in_vacuum = D0 + 2 * D1 * warmer + 3 * D2 * warmer**2
    in_vacuum += (E0 + 2 * E1 * warmer) / (wavelength_um**2 - wavelength_tk**2)
    in_vacuum *= (n**2 - 1) / (2 * n)
    return in_vacuum + n * 0.00367 * 2.71e-4 / (1 + 0.00367 * temperature_c)  # n - 1 of air at 20 C


N_BK7 = (1.86e-6, 1.31e-8, -1.37e-11, 4.34e-7, 6.27e-10, 0.170)  # Schott, data sheet


@pytest.mark.parametrize(
    ("material", "rate"),
    [
        ("acrylic", -1.05e-4),  # Waxler, Horowitz, Feldman, Applied Optics 18, 101 (1979)
        ("polycarbonate", -1.07e-4),  # the same
        ("bk7", schott_rate(1.51872, 0.54607, N_BK7, 30.0)),
        (
            "fused_silica",
            8.6e-6 + 1.46 * 0.92e-6,
        ),  # in vacuum: Leviton and Frey, Corning 7980, 589 nm
        ("sapphire", 13.1e-6),  # Crystran, ordinary ray, 546 nm
        ("water", (1.33192 - 1.33299) / 10),  # CRC Handbook, sodium D, 20 and 30 C
        (
            "sea_water",
            -1.02e-4,
        ),  # Quan and Fry, Applied Optics 34, 3477 (1995): 35 g/kg, 589 nm, 20 C
        ("mineral_oil", -3.8e-4),  # Cargille, immersion oil
    ],
)
def test_index_rates_match_literature(material, rate):
    assert INDEX_RATES_PER_K[material] == pytest.approx(rate, rel=0.08)


def test_wall_materials_have_expansions():
    liquids = {"air", "water", "sea_water", "mineral_oil"}
    assert MATERIALS.keys() - liquids <= EXPANSIONS_PPM.keys()
    assert INDEX_RATES_PER_K.keys() == MATERIALS.keys() - {"air"}


def test_default_expansions():
    thermal = om.Thermal()
    assert thermal.imager_ppm_per_k == 2.6
    assert thermal.focal_ppm_per_k == 0.0
    assert [thermal.expansion_ppm(part) for part in ("mirror", "spacer", "mount")] == [
        0.0,
        0.0,
        0.0,
    ]
    assert om.Thermal(mount_ppm_per_k=-2.5).expansion_ppm("mount") == -2.5
    assert om.Thermal(mount_material="fused_silica").expansion_ppm("mount") == 0.55
    with pytest.raises(
        InvalidParameter, match="part must be one of mirror, spacer, mount; got 'lens'"
    ):
        thermal.expansion_ppm("lens")


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("reference_c", -273.0, 1000.0),
        ("focal_ppm_per_k", -1e4, 1e4),
        *(
            (f"{part}_ppm_per_k", -100.0, 1000.0)
            for part in ("mirror", "spacer", "mount", "imager")
        ),
    ],
)
def test_temperature_and_expansion_ranges(name, low, high):
    for value in (low, high):
        assert getattr(om.Thermal(**{name: value}), name) == value
    for value in (low - 0.01, high + 0.01):
        with pytest.raises(InvalidParameter, match=f"{name} must be between"):
            om.Thermal(**{name: value})


@pytest.mark.parametrize("part", ["mirror", "spacer", "mount"])
def test_material_and_expansion_are_exclusive(part):
    with pytest.raises(
        InvalidParameter, match=f"{part}_material and {part}_ppm_per_k must not both be given"
    ):
        om.Thermal(**{f"{part}_material": "pla", f"{part}_ppm_per_k": 0.0})
