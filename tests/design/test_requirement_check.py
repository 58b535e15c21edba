"""Verdicts equal the evaluation, for sensors of any origin."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.design.requirement_check import RequirementCheck, _limit_row
from omnimirror.optics.housing import Housing, Rod

SPHERE = om.load_sensor("paper-spherical")
WANTED = om.Requirements(
    field=om.FieldRequirements(
        omega_max_deg=130, omega_min_deg=20, object_distance_mm=(500, np.inf)
    ),
    mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=(40, 45)),
    lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=(8, 11), f_number=4),
    imager=SPHERE.imager,
    limits=[
        om.Limit("total_blur_px", at_most=9.0),
        om.Limit("resolution_px_per_deg", at_least=3.0, omega_deg=(30, 90)),
    ],
)


def rows_of(verdict):
    return {row.label: row for row in verdict.rows}


def test_rows_are_the_numbers_of_the_sensor_and_of_its_evaluation():
    rows = rows_of(om.check_requirements(WANTED, SPHERE))
    assert [*rows] == [
        "omega_max_deg",
        "omega_min_deg",
        "rim_radius_mm",
        "image_radius_px",
        "focal_length_mm",
        "f_number",
        "theta_max_deg",
        "total_blur_px",
        "resolution_px_per_deg, 30 to 90 deg",
    ]
    assert rows["rim_radius_mm"].reached == SPHERE.mirror.rim_radius_mm
    assert rows["omega_max_deg"].margin == pytest.approx(SPHERE.field_deg[1] - 130)
    rim = SPHERE.mirror.rim_radius_mm
    theta = np.degrees(np.arctan(rim / (SPHERE.mirror_distance_mm + float(SPHERE.mirror.sag(rim)))))
    assert rows["theta_max_deg"].reached == pytest.approx(theta)
    assert not rows["theta_max_deg"].is_met  # 12 deg
    near, far = (
        om.evaluate(SPHERE, np.linspace(20, 130, 2001), object_distance_mm=d)
        for d in (500.0, np.inf)
    )
    worst = max(np.abs([e.blur_t_px, e.blur_s_px]).max() for e in (near, far))
    assert rows["total_blur_px"].reached == pytest.approx(np.hypot(worst, far.airy_px), rel=1e-4)
    parts = [
        om.evaluate(SPHERE, np.linspace(30, 90, 2001), object_distance_mm=d)
        for d in (500.0, np.inf)
    ]
    finest = min(
        np.minimum(part.dh_domega_px_per_deg, part.width_px_per_deg).min() for part in parts
    )
    assert rows["resolution_px_per_deg, 30 to 90 deg"].reached == pytest.approx(finest, rel=1e-4)


@pytest.mark.parametrize("name", ["paper-spherical", "exact-equidistant", "folded-hyperboloidal"])
def test_a_limit_is_met_from_what_is_reached_on(name):
    """Limits on both sides of the value of the sensor."""
    sensor = om.load_sensor(name)
    wanted = replace(WANTED, limits=(om.Limit("total_blur_px", 1.0),)).changed(
        omega_min_deg=30, omega_max_deg=100
    )
    (found,) = om.check_requirements(wanted, sensor).limits
    for share, is_met in (
        (1.001, True),
        (1 - 1e-7, True),
        (1 - 1e-5, False),
        (0.999, False),
    ):  # 1e-6 is rounding
        moved = replace(wanted, limits=(om.Limit("total_blur_px", found.reached * share),))
        (row,) = om.check_requirements(moved, sensor).limits
        assert row.is_met == is_met
        margin = found.reached * (share - 1)
        assert row.margin == pytest.approx(max(margin, 0.0) if is_met else margin, rel=1e-6)


@pytest.mark.parametrize(("at_least", "at_most"), [(0.0, None), (None, 0.0), (0.0, 0.0)])
def test_a_limit_of_zero_is_missed_in_its_own_unit(at_least, at_most):
    """No relative measure at 0: rounding and violation are absolute, in the unit of the quantity."""
    side = -1.0 if at_most is None else 1.0
    for missed, is_met in ((5e-7, True), (5e-6, False)):
        row = RequirementCheck("motion_px", "px", at_least, at_most, side * missed)
        assert row.is_met == is_met
        assert row.shortfall == pytest.approx(missed)
    assert RequirementCheck("motion_px", "px", at_least, at_most, 0.0).shortfall == 0.0


@pytest.mark.parametrize("largest", [True, False])
@pytest.mark.parametrize("worst", [5.0, -5.0, 0.0])
def test_of_object_distances_that_tie_the_smallest_angle_is_named(largest, worst):
    """Within 2e-5 of the worst value, independent of the order of distances; a scalar has no angle."""
    side = 1.0 if largest else -1.0
    of = SimpleNamespace(unit="px", extreme=lambda field, _: field)
    ends = {"at_most": 9.0, "at_least": None} if largest else {"at_most": None, "at_least": -9.0}
    limit = SimpleNamespace(name="blur", omega_deg=None, of=of, **ends)
    omega, near = np.array([10.0, 20.0, 30.0]), 1e-5 * abs(worst) * side
    fields = [((worst - 1e-3 * side, 0), omega), ((worst - near, 1), omega), ((worst, 2), omega)]
    for order in (fields, fields[::-1]):
        row = _limit_row(limit, order, ())
        assert (row.reached, row.omega_deg) == (worst, 20.0)
    assert _limit_row(limit, [((worst, None), omega)], ()).omega_deg is None


def test_a_design_and_its_sensor_get_the_same_verdict():
    design = om.design_sensor(WANTED.changed(theta_max_deg=None))
    again = om.check_requirements(design.requirements, design.sensor)
    assert again.rows == design.rows
    assert again.is_met == design.is_met


def test_a_focus_that_was_asked_for_is_judged():
    at = SPHERE.lens.focus_distance_mm
    for asked, is_met in ((at, True), ((at - 5, at + 5), True), ((at + 1, at + 5), False)):
        row = rows_of(om.check_requirements(WANTED.changed(focus_mm=asked), SPHERE))["focus_mm"]
        assert row.reached == at
        assert row.is_met == is_met


def test_the_end_of_the_field_is_judged_though_rounding_moves_it():
    """The same mirror with the same rim angle, computed in two ways that differ by rounding."""
    for off in (-1, 0, 1):
        end = float(np.nextafter(SPHERE.field_deg[1], np.inf * off) if off else SPHERE.field_deg[1])
        limit = om.Limit("resolution_px_per_deg", at_least=1.0, omega_deg=(end, end))
        wanted = replace(WANTED, field=om.FieldRequirements(omega_max_deg=end), limits=(limit,))
        (row,) = om.check_requirements(wanted, SPHERE).limits
        assert row.omega_deg == pytest.approx(end)
        there = om.evaluate(SPHERE, [SPHERE.field_deg[1]])
        assert row.reached == pytest.approx(
            min(there.dh_domega_px_per_deg[0], there.width_px_per_deg[0]), rel=1e-6
        )


def test_the_first_of_equally_bad_angles_is_named():
    """A resolution that is constant except for rounding: the first angle is reported."""
    sensor = om.load_sensor("exact-equidistant")
    limit = om.Limit("dh_domega_px_per_deg", at_least=3.0, omega_deg=(40, 100))
    wanted = replace(
        WANTED, limits=(limit,), field=replace(WANTED.field, object_distance_mm=np.inf)
    )
    (row,) = om.check_requirements(wanted.changed(omega_max_deg=100), sensor).limits
    assert row.omega_deg == 40.0
    values = om.evaluate(sensor, np.linspace(40, 100, 1001)).dh_domega_px_per_deg
    assert row.reached == pytest.approx(values.min(), rel=1e-9)


def test_limits_are_looked_at_by_default_at_1001_angles_and_at_most_at_100000():
    wanted, sensor = (
        replace(WANTED, limits=(om.Limit("total_blur_px", at_least=1.0),)),
        om.load_sensor("paper-equidistant"),
    )
    found, same, other = (
        om.check_requirements(wanted, sensor, **n).rows
        for n in ({}, {"angles": 1001}, {"angles": 1000})
    )
    assert 30 < found[-1].omega_deg < 120  # between the ends, where the number of angles matters
    assert found == same != other
    assert om.check_requirements(wanted, sensor, angles=2).limits[0].omega_deg in (20.0, 130.0)
    for angles in (1, 100_001):
        with pytest.raises(
            InvalidParameter, match=f"angles must be an integer between 2 and 100000; got {angles}"
        ):
            om.check_requirements(WANTED, SPHERE, angles=angles)


@pytest.mark.parametrize(("past_px", "is_met"), [(0.015, True), (0.025, False)])
def test_a_rim_may_reach_a_fiftieth_of_a_pixel_past_the_imager(past_px, is_met):
    """The pixel edge has this accuracy; the margin of a satisfied requirement is never negative."""
    largest = WANTED.largest_image_px
    pitch = SPHERE.imager.pixel_pitch_um * SPHERE.rim_radius_px / (largest + past_px)
    moved = replace(SPHERE, imager=replace(SPHERE.imager, pixel_pitch_um=pitch))
    row = rows_of(om.check_requirements(WANTED, moved))["image_radius_px"]
    assert row.margin == pytest.approx(0.0 if is_met else -past_px, abs=1e-6)
    assert row.is_met == is_met


@pytest.mark.parametrize(("name", "is_blur"), [("total_blur_px", True), ("aspect", False)])
def test_a_limit_of_blur_below_the_airy_disk_says_that_no_focus_helps(name, is_blur):
    airy = om.evaluate(SPHERE, [90.0]).airy_px
    for share in (0.9, 1.1):
        (row,) = om.check_requirements(
            replace(WANTED, limits=(om.Limit(name, at_most=share * airy),)), SPHERE
        ).limits
        said = [
            remark
            for remark in row.remarks
            if remark.startswith(f"the Airy disk alone is {airy:.4g} px at F/4")
        ]
        assert len(said) == (is_blur and share < 1)
    (row,) = om.check_requirements(
        replace(WANTED, limits=(om.Limit("resolution_px_per_deg", at_least=9e9),)), SPHERE
    ).limits
    assert not any("Airy" in remark for remark in row.remarks)


HOUSING = Housing(rod=Rod(6.0))


@pytest.mark.parametrize(("own", "asked"), [(None, HOUSING), (HOUSING, None), (HOUSING, Housing())])
def test_a_sensor_without_a_housing_is_judged_with_that_of_the_requirements(own, asked):
    """Three sensors that are equal with the housing; the housing of the sensor itself takes
    precedence."""
    sensor = SPHERE if own is None else replace(SPHERE, housing=own)
    verdict = om.check_requirements(
        WANTED if asked is None else replace(WANTED, housing=asked), sensor
    )
    assert verdict.sensor == replace(SPHERE, housing=HOUSING)


def test_over_a_range_of_temperatures_the_worst_counts():
    """Each limit at its worst temperature, from an evaluation at each; at 20 C without a remark."""
    thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    wanted = replace(
        WANTED,
        thermal=thermal,
        temperatures_c=(-30.0, 70.0),
        limits=(om.Limit("total_blur_px", at_most=9.0),),
    )
    sensor = replace(SPHERE, thermal=thermal)
    alone = replace(wanted, temperatures_c=None)
    (row,) = om.check_requirements(wanted, SPHERE).limits
    reached = {
        c: om.check_requirements(alone, om.at_temperature(sensor, c)).limits[0].reached
        for c in (-30.0, 20.0, 70.0)
    }
    worst = max(reached, key=reached.get)
    assert row.reached == pytest.approx(reached[worst], rel=1e-12)
    assert [remark for remark in row.remarks if remark.startswith("smallest margin at")] == (
        [] if worst == 20.0 else [f"smallest margin at {worst:g} C"]
    )
    fewest = replace(wanted, limits=(om.Limit("total_blur_px", at_least=1.0),))
    (row,) = om.check_requirements(fewest, SPHERE).limits
    reached = {
        c: om.check_requirements(replace(fewest, temperatures_c=None), om.at_temperature(sensor, c))
        .limits[0]
        .reached
        for c in (-30.0, 20.0, 70.0)
    }
    assert row.reached == pytest.approx(min(reached.values()), rel=1e-12)


def test_obscuration_at_the_centre_is_a_requirement_only_if_the_field_starts_outside():
    whole = replace(WANTED, field=om.FieldRequirements(omega_max_deg=130.0))
    assert "omega_min_deg" not in rows_of(om.check_requirements(whole, SPHERE))
    folded = om.load_sensor("folded-spherical")
    row = rows_of(om.check_requirements(replace(whole, imager=folded.imager), folded))[
        "omega_min_deg"
    ]
    assert row.reached == pytest.approx(folded.field_deg[0])


def test_temperature_range_is_searched_from_minus_40_to_85_c():
    sensor = replace(
        SPHERE, thermal=om.Thermal(mirror_material="aluminium", spacer_material="aluminium")
    )
    wanted = replace(WANTED, limits=(om.Limit("total_blur_px", at_most=100.0),))
    wanted = replace(
        wanted,
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=(40.0, 50.0)),
        lens=om.LensRequirements(focal_length_mm=(5.0, 20.0), theta_max_deg=(5.0, 20.0)),
        field=om.FieldRequirements(omega_max_deg=100.0),
        imager=replace(SPHERE.imager, width_px=2000, height_px=2000),
    )
    found = om.temperature_range(wanted, sensor)
    assert (found.low_c, found.high_c, found.below, found.above) == (-40.0, 85.0, (), ())


def test_only_what_differs_over_the_field_says_what_of_it_is_left_out():
    """The central rod obscures the axis: a blur limit excludes it, whereas the length is a scalar."""
    wanted = replace(
        WANTED,
        field=om.FieldRequirements(omega_max_deg=165),
        limits=(om.Limit("total_blur_px", at_most=9.0), om.Limit("length_mm", at_most=500.0)),
    )
    blur, length = om.check_requirements(wanted, SPHERE).limits
    assert any("135" in remark for remark in blur.remarks)
    assert length.remarks == ()


def test_what_cannot_be_judged_is_said():
    with pytest.raises(
        InvalidParameter, match=r"the lens of the sensor must be perspective, .* got orthographic"
    ):
        om.check_requirements(WANTED, om.load_sensor("paraboloid-telecentric"))
    limits = [om.Limit("aspect", 9.0, omega_deg=(150, 160))]
    beyond = replace(WANTED, limits=limits, field=om.FieldRequirements(omega_max_deg=165))
    with pytest.raises(
        InvalidParameter,
        match=r"no field angle from 150 to 160 deg can be evaluated: the field ends at 135",
    ):
        om.check_requirements(beyond, SPHERE)
    for odd in (None, "paper-spherical", 3):
        with pytest.raises(
            OmnimirrorError,
            match=rf"sensor must be a sensor \(see om\.load_sensor\); got {odd!r}",
        ):
            om.check_requirements(WANTED, odd)
        with pytest.raises(OmnimirrorError, match=r"must be .*; got"):
            om.check_requirements(odd, SPHERE)


@pytest.mark.parametrize(
    ("focal", "theta", "radius_px", "image_px"),
    [
        (11.6, (8.0, 11.0), None, 11.0),  # the imager would be filled at 12.1 deg
        (11.6, (8.0, 14.0), 512.0, None),
        ((8.0, 10.0), 12.0, None, 10.0),  # and at 12 deg by a focal length of 11.7 mm
        ((8.0, 20.0), 12.0, 512.0, None),
    ],
)
def test_what_fills_the_imager_stays_within_its_range(focal, theta, radius_px, image_px):
    asked = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=120),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=40),
        lens=om.LensRequirements(focal_length_mm=focal, theta_max_deg=theta, f_number=4),
    )
    found = om.design_sensor(asked)
    assert found.is_met, found.verdict.missed
    sensor = found.sensor
    if radius_px is not None:
        assert sensor.rim_radius_px == pytest.approx(radius_px, abs=0.02)
        return
    ends = {"theta": np.degrees(sensor.meridian.theta_max), "focal": sensor.lens.focal_length_mm}
    assert ends["theta" if isinstance(theta, tuple) else "focal"] == pytest.approx(
        image_px, rel=1e-9
    )
    assert sensor.rim_radius_px < 511
    assert any("the rim does not fill the imager" in note for note in found.notes)
