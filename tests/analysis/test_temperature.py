"""Sensors that get warm: beside lengths worked out by hand and rays through the parts as they then stand."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter, SpecError
from omnimirror.housing import Housing, Tube
from omnimirror.mirrors import Sphere
from omnimirror.specs.sensor_file import format_sensor
from omnimirror.thermal import EXPANSIONS_PPM
from tests.commands import omnimirror
from tests.conftest import MIRRORS, sensor_of

BALL = om.load_sensor("prototype-spherical")
ACRYLIC = om.Thermal(mirror_material="acrylic", spacer_material="aluminium", imager_ppm_per_k=0.0)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_a_mirror_grows_evenly(kind):
    mirror, factor = sensor_of(kind).mirror, 1.0028
    grown = mirror.scaled(factor)
    x = np.linspace(0.0, 0.999 * mirror.rim_radius_mm, 300)
    np.testing.assert_allclose(grown.sag(factor * x), factor * mirror.sag(x), atol=1e-12)
    np.testing.assert_allclose(grown.slope(factor * x), mirror.slope(x), atol=1e-12)
    np.testing.assert_allclose(grown.curvature(factor * x), mirror.curvature(x) / factor, rtol=1e-9, atol=1e-12)


def test_an_acrylic_ball_before_an_aluminium_spacer_moves_the_picture_by_three_quarters_of_a_pixel():
    warm = om.at_temperature(replace(BALL, thermal=ACRYLIC), 60.0)
    by_hand = replace(
        BALL,
        mirror=Sphere(BALL.mirror.radius_mm * (1 + 40 * 70e-6), BALL.mirror.rim_radius_mm * (1 + 40 * 70e-6)),
        mirror_distance_mm=BALL.mirror_distance_mm * (1 + 40 * 23.6e-6),
    )
    omega = np.radians(np.linspace(1.0, BALL.field_deg[1] - 0.5, 60))
    away = np.stack([np.sin(omega), 0 * omega, -np.cos(omega)], axis=-1) @ BALL._axes.T
    moved = by_hand.project_directions(away).pixels - BALL.project_directions(away).pixels
    worst = np.hypot(*moved.T).max()
    assert worst == pytest.approx(0.77, abs=0.01)
    np.testing.assert_allclose(
        warm.project_directions(away).pixels, by_hand.project_directions(away).pixels, atol=1e-9
    )  # fmt: skip
    assert om.thermal_motion_px(replace(BALL, thermal=ACRYLIC), 60.0) == pytest.approx(worst, rel=0.01)


def test_a_mirror_of_the_spacers_material_under_an_imager_of_it_moves_nothing():
    """All lengths grow alike: every ray keeps its direction, and the pixels grow with the picture."""
    names = ("mirror_ppm_per_k", "spacer_ppm_per_k", "mount_ppm_per_k", "imager_ppm_per_k", "focal_ppm_per_k")
    alike = replace(BALL, thermal=om.Thermal(**dict.fromkeys(names, 23.6)))
    assert om.thermal_motion_px(alike, 80.0) < 1e-9
    assert om.thermal_motion_px(replace(alike, thermal=replace(alike.thermal, focal_ppm_per_k=0.0)), 80.0) < 1e-9
    assert om.thermal_motion_px(replace(alike, thermal=replace(alike.thermal, mount_ppm_per_k=0.0)), 80.0) > 0.3


def test_a_rim_that_is_held_keeps_its_place():
    warm = om.at_temperature(replace(BALL, thermal=replace(ACRYLIC, held_at="rim", spacer_material=None)), 60.0)
    places = [s.mirror_distance_mm + float(s.mirror.sag(s.mirror.rim_radius_mm)) for s in (BALL, warm)]
    assert places[0] == pytest.approx(places[1], abs=1e-9)


def test_a_mount_moves_the_imager_and_the_focus():
    thermal = om.Thermal(mount_ppm_per_k=100.0, focal_ppm_per_k=30.0)
    warm = om.at_temperature(replace(BALL, thermal=thermal), 30.0).lens
    f = BALL.lens.focal_length_mm * (1 + 10 * 30e-6)
    behind = 1 / (1 / BALL.lens.focal_length_mm - 1 / BALL.lens.focus_distance_mm) * (1 + 10 * 100e-6)
    assert warm.focal_length_mm == pytest.approx(f, rel=1e-12)
    assert 1 / f - 1 / warm.focus_distance_mm == pytest.approx(1 / behind, rel=1e-12)


def test_a_wall_grows_and_refracts_less():
    housing = Housing(shell=Tube(diameter_mm=110.0, wall_mm=3.0, material="acrylic", medium="water"))
    tube = om.at_temperature(replace(BALL, housing=housing, thermal=om.Thermal()), 60.0).housing.shell
    assert tube.diameter_mm == pytest.approx(110.0 * (1 + 40 * 70e-6))
    assert tube.index == pytest.approx(1.4918 - 40 * 1.05e-4)
    assert tube.outer_index == pytest.approx(1.3331 - 40 * 1e-4)


def test_there_and_back_is_where_it_was():
    sensor = replace(BALL, thermal=replace(ACRYLIC, mount_material="brass", focal_ppm_per_k=20.0))
    back = om.at_temperature(om.at_temperature(sensor, 60.0), 20.0)
    assert back.mirror_distance_mm == pytest.approx(sensor.mirror_distance_mm, rel=2e-6)
    assert back.thermal == sensor.thermal
    assert om.at_temperature(sensor, 20.0) is sensor


def test_the_file_holds_it(tmp_path):
    sensor = replace(BALL, thermal=replace(ACRYLIC, held_at="rim", reference_c=0.0))
    again = om.parse_sensor(format_sensor(sensor))
    assert again.thermal == sensor.thermal
    assert om.parse_sensor(format_sensor(BALL)).thermal is None
    with pytest.raises(SpecError, match=r"mirror_material.*acrylic"):
        om.parse_sensor(format_sensor(sensor).replace('"acrylic"', '"cheese"'))


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (lambda: om.at_temperature(BALL, 60.0), r"nothing is said .* needs a table \[thermal\]"),
        (lambda: om.Thermal(mirror_material="acrylic", mirror_ppm_per_k=70.0), "were both given; give one of them"),
        (lambda: om.Thermal(mirror_material="cheese"), "mirror_material = 'cheese' is not one of abs, acrylic"),
        (lambda: om.at_temperature(replace(BALL, thermal=ACRYLIC), -300.0), "temperature_c = -300.0 is not valid"),
        (
            lambda: om.at_temperature(
                replace(BALL, thermal=om.Thermal(mount_ppm_per_k=-99.0, focal_ppm_per_k=5e3)), 60.0
            ),
            "where nothing is in focus",
        ),
        (
            lambda: om.at_temperature(
                replace(om.load_sensor("paraboloid-telecentric"), thermal=om.Thermal(mount_material="brass")), 60.0
            ),
            "of a orthographic lens are not changed|orthographic lens are not changed",
        ),
    ],
)
def test_what_cannot_be_is_one_sentence(make, sentence):
    with pytest.raises(InvalidParameter, match=sentence):
        make()


def test_requirements_are_kept_over_a_range_whose_ends_are_where_they_are_missed():
    sensor = replace(om.load_sensor("paper-spherical"), thermal=ACRYLIC)
    wanted = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=130.0),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.905),
        lens=om.LensRequirements(theta_max_deg=12.0),
        limits=(om.Limit("total_blur_px", at_most=7.9),),
    )
    at_50 = next(row for row in om.judge(wanted, om.at_temperature(sensor, 50.0)).rows if row.is_limit)
    wanted = replace(wanted, limits=(om.Limit("total_blur_px", at_most=at_50.reached),))
    found = om.temperature_range(wanted, sensor, coldest_c=-40.0, warmest_c=85.0)
    assert found.high_c == pytest.approx(50.0, abs=0.15)
    for c, met in ((found.high_c - 0.2, True), (found.high_c + 0.2, False), (-39.0, True)):
        blur = next(row for row in om.judge(wanted, om.at_temperature(sensor, c)).rows if row.is_limit)
        assert blur.is_met is met
    assert found.low_c == -40.0
    assert (found.below, found.above) == ((), ("total_blur_px",))
    missed = om.temperature_range(replace(wanted, limits=(om.Limit("total_blur_px", at_most=1.0),)), sensor)
    assert np.isnan(missed.low_c)
    with pytest.raises(InvalidParameter, match=r"from 30 to 40 C are not valid; they must hold the reference .* 20 C"):
        om.temperature_range(wanted, sensor, coldest_c=30.0, warmest_c=40.0)


def test_the_command_line_says_how_far_the_picture_moves(tmp_path):
    sensor = tmp_path / "warm.toml"
    om.save_sensor(replace(BALL, thermal=ACRYLIC), sensor)
    done = omnimirror(
        "evaluate", sensor, "--temperature-c", 60, "--omega-deg", "0:120:30", "--json", tmp_path / "a.json"
    )
    assert done.returncode == 0, done.stderr
    assert "at 60 C the picture lies up to 0.768 px from where it is at 20 C" in " ".join(done.stdout.split())
    assert json.loads((tmp_path / "a.json").read_text())
    refused = omnimirror("evaluate", "prototype-spherical", "--temperature-c", 60)
    assert refused.returncode not in (0, 70)
    assert "needs a table [thermal]" in refused.stderr


def test_every_material_of_a_wall_that_expands_is_known():
    assert {"acrylic", "polycarbonate", "bk7", "fused_silica"} <= EXPANSIONS_PPM.keys()
