"""Verdicts equal the evaluation, for sensors of any origin."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.design import requirement_check
from omnimirror.design.requirement_check import RequirementCheck, Verdict, _limit_row
from omnimirror.optics.housing import Housing, Rod

SPHERE = om.load_sensor("paper-spherical")
REQUIREMENTS = om.Requirements(
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


def test_rows_agree_with_sensor_and_evaluation():
    rows = rows_of(om.check_requirements(REQUIREMENTS, SPHERE))
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
def test_limit_equal_to_reached_value_is_met(name):
    """Limits on both sides of the value of the sensor."""
    sensor = om.load_sensor(name)
    requirements = replace(REQUIREMENTS, limits=(om.Limit("total_blur_px", 1.0),)).changed(
        omega_min_deg=30, omega_max_deg=100
    )
    (row_at_limit,) = om.check_requirements(requirements, sensor).limits
    for share, is_met in (
        (1.001, True),
        (1 - 1e-7, True),
        (1 - 1e-5, False),
        (0.999, False),
    ):  # 1e-6 is rounding
        variant = replace(
            requirements, limits=(om.Limit("total_blur_px", row_at_limit.reached * share),)
        )
        (row,) = om.check_requirements(variant, sensor).limits
        assert row.is_met == is_met
        margin = row_at_limit.reached * (share - 1)
        assert row.margin == pytest.approx(max(margin, 0.0) if is_met else margin, rel=1e-6)


@pytest.mark.parametrize(("at_least", "at_most"), [(0.0, None), (None, 0.0), (0.0, 0.0)])
def test_zero_limit_is_missed_in_its_own_unit(at_least, at_most):
    """No relative measure at 0: rounding and violation are absolute, in the unit of the quantity."""
    side = -1.0 if at_most is None else 1.0
    for violation, is_met in ((5e-7, True), (5e-6, False)):
        row = RequirementCheck("motion_px", "px", at_least, at_most, side * violation)
        assert row.is_met == is_met
        assert row.shortfall == pytest.approx(violation)
    assert RequirementCheck("motion_px", "px", at_least, at_most, 0.0).shortfall == 0.0


@pytest.mark.parametrize("largest", [True, False])
@pytest.mark.parametrize("worst", [5.0, -5.0, 0.0])
def test_smallest_angle_is_named_among_tied_distances(largest, worst):
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


def test_design_and_check_return_same_verdict():
    design = om.design_sensor(REQUIREMENTS.changed(theta_max_deg=None))
    verdict = om.check_requirements(design.requirements, design.sensor)
    assert verdict.rows == design.rows
    assert verdict.is_met == design.is_met


def test_required_focus_is_evaluated():
    at = SPHERE.lens.focus_distance_mm
    for focus_mm, is_met in ((at, True), ((at - 5, at + 5), True), ((at + 1, at + 5), False)):
        row = rows_of(om.check_requirements(REQUIREMENTS.changed(focus_mm=focus_mm), SPHERE))[
            "focus_mm"
        ]
        assert row.reached == at
        assert row.is_met == is_met


def test_end_of_field_is_evaluated_despite_rounding():
    """The same mirror with the same rim angle, computed in two ways that differ by rounding."""
    for direction in (-1, 0, 1):
        end = float(
            np.nextafter(SPHERE.field_deg[1], np.inf * direction)
            if direction
            else SPHERE.field_deg[1]
        )
        limit = om.Limit("resolution_px_per_deg", at_least=1.0, omega_deg=(end, end))
        requirements = replace(
            REQUIREMENTS, field=om.FieldRequirements(omega_max_deg=end), limits=(limit,)
        )
        (row,) = om.check_requirements(requirements, SPHERE).limits
        assert row.omega_deg == pytest.approx(end)
        evaluation = om.evaluate(SPHERE, [SPHERE.field_deg[1]])
        assert row.reached == pytest.approx(
            min(evaluation.dh_domega_px_per_deg[0], evaluation.width_px_per_deg[0]), rel=1e-6
        )


def test_first_of_equal_worst_angles_is_named():
    """A resolution that is constant except for rounding: the first angle is reported."""
    sensor = om.load_sensor("exact-equidistant")
    limit = om.Limit("dh_domega_px_per_deg", at_least=3.0, omega_deg=(40, 100))
    requirements = replace(
        REQUIREMENTS, limits=(limit,), field=replace(REQUIREMENTS.field, object_distance_mm=np.inf)
    )
    (row,) = om.check_requirements(requirements.changed(omega_max_deg=100), sensor).limits
    assert row.omega_deg == 40.0
    values = om.evaluate(sensor, np.linspace(40, 100, 1001)).dh_domega_px_per_deg
    assert row.reached == pytest.approx(values.min(), rel=1e-9)


def test_limits_use_1001_angles_by_default_and_at_most_100000():
    requirements, sensor = (
        replace(REQUIREMENTS, limits=(om.Limit("total_blur_px", at_least=1.0),)),
        om.load_sensor("paper-equidistant"),
    )
    default, same, other = (
        om.check_requirements(requirements, sensor, **n).rows
        for n in ({}, {"angles": 1001}, {"angles": 1000})
    )
    assert 30 < default[-1].omega_deg < 120  # between the ends, where the number of angles matters
    assert default == same != other
    assert om.check_requirements(requirements, sensor, angles=2).limits[0].omega_deg in (
        20.0,
        130.0,
    )
    for angles in (1, 100_001):
        with pytest.raises(
            InvalidParameter, match=f"angles must be an integer between 2 and 100000; got {angles}"
        ):
            om.check_requirements(REQUIREMENTS, SPHERE, angles=angles)


@pytest.mark.parametrize(("past_px", "is_met"), [(0.015, True), (0.025, False)])
def test_rim_may_exceed_imager_by_a_fiftieth_of_a_pixel(past_px, is_met):
    """The pixel edge has this accuracy; the margin of a satisfied requirement is never negative."""
    largest = REQUIREMENTS.largest_image_px
    pitch = SPHERE.imager.pixel_pitch_um * SPHERE.rim_radius_px / (largest + past_px)
    sensor = replace(SPHERE, imager=replace(SPHERE.imager, pixel_pitch_um=pitch))
    row = rows_of(om.check_requirements(REQUIREMENTS, sensor))["image_radius_px"]
    assert row.margin == pytest.approx(0.0 if is_met else -past_px, abs=1e-6)
    assert row.is_met == is_met


@pytest.mark.parametrize(("name", "is_blur"), [("total_blur_px", True), ("aspect", False)])
def test_blur_limit_below_airy_disk_is_reported(name, is_blur):
    airy = om.evaluate(SPHERE, [90.0]).airy_px
    for share in (0.9, 1.1):
        (row,) = om.check_requirements(
            replace(REQUIREMENTS, limits=(om.Limit(name, at_most=share * airy),)), SPHERE
        ).limits
        remarks = [
            remark
            for remark in row.remarks
            if remark.startswith(f"the Airy disc alone is {airy:.4g} px at F/4")
        ]
        assert len(remarks) == (is_blur and share < 1)
    (row,) = om.check_requirements(
        replace(REQUIREMENTS, limits=(om.Limit("resolution_px_per_deg", at_least=9e9),)), SPHERE
    ).limits
    assert not any("Airy" in remark for remark in row.remarks)


HOUSING = Housing(rod=Rod(6.0))


@pytest.mark.parametrize(
    ("own", "requested"), [(None, HOUSING), (HOUSING, None), (HOUSING, Housing())]
)
def test_sensor_without_housing_uses_housing_of_requirements(own, requested):
    """Three sensors that are equal with the housing; the housing of the sensor itself takes
    precedence."""
    sensor = SPHERE if own is None else replace(SPHERE, housing=own)
    verdict = om.check_requirements(
        REQUIREMENTS if requested is None else replace(REQUIREMENTS, housing=requested), sensor
    )
    assert verdict.sensor == replace(SPHERE, housing=HOUSING)


def test_worst_temperature_determines_verdict():
    """Each limit at its worst temperature, from an evaluation at each; at 20 C without a remark."""
    thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    requirements = replace(
        REQUIREMENTS,
        thermal=thermal,
        temperatures_c=(-30.0, 70.0),
        limits=(om.Limit("total_blur_px", at_most=9.0),),
    )
    sensor = replace(SPHERE, thermal=thermal)
    alone = replace(requirements, temperatures_c=None)
    (row,) = om.check_requirements(requirements, SPHERE).limits
    blurs = {
        c: om.check_requirements(alone, om.at_temperature(sensor, c)).limits[0].reached
        for c in (-30.0, 20.0, 70.0)
    }
    worst = max(blurs, key=blurs.get)
    assert row.reached == pytest.approx(blurs[worst], rel=1e-12)
    assert [remark for remark in row.remarks if remark.startswith("smallest margin at")] == (
        [] if worst == 20.0 else [f"smallest margin at {worst:g} C"]
    )
    reversed_limit = replace(requirements, limits=(om.Limit("total_blur_px", at_least=1.0),))
    (row,) = om.check_requirements(reversed_limit, SPHERE).limits
    blurs = {
        c: om.check_requirements(
            replace(reversed_limit, temperatures_c=None), om.at_temperature(sensor, c)
        )
        .limits[0]
        .reached
        for c in (-30.0, 20.0, 70.0)
    }
    assert row.reached == pytest.approx(min(blurs.values()), rel=1e-12)


def test_obscuration_at_the_centre_is_a_requirement_only_if_the_field_starts_outside():
    whole = replace(REQUIREMENTS, field=om.FieldRequirements(omega_max_deg=130.0))
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
    requirements = replace(REQUIREMENTS, limits=(om.Limit("total_blur_px", at_most=100.0),))
    requirements = replace(
        requirements,
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=(40.0, 50.0)),
        lens=om.LensRequirements(focal_length_mm=(5.0, 20.0), theta_max_deg=(5.0, 20.0)),
        field=om.FieldRequirements(omega_max_deg=100.0),
        imager=replace(SPHERE.imager, width_px=2000, height_px=2000),
    )
    limits = om.temperature_range(requirements, sensor)
    assert (limits.low_c, limits.high_c, limits.below, limits.above) == (-40.0, 85.0, (), ())


def test_only_field_dependent_limits_report_excluded_angles():
    """The central rod obscures the axis: a blur limit excludes it, whereas the length is a scalar."""
    requirements = replace(
        REQUIREMENTS,
        field=om.FieldRequirements(omega_max_deg=165),
        limits=(om.Limit("total_blur_px", at_most=9.0), om.Limit("length_mm", at_most=500.0)),
    )
    for angles in (2, 1001):
        blur, length = om.check_requirements(requirements, SPHERE, angles=angles).limits
        assert any("135" in remark for remark in blur.remarks)
        assert length.remarks == ()


def test_unevaluable_requirements_are_reported():
    with pytest.raises(
        InvalidParameter, match=r"the lens of the sensor must be perspective, .* got orthographic"
    ):
        om.check_requirements(REQUIREMENTS, om.load_sensor("paraboloid-telecentric"))
    limits = [om.Limit("aspect", 9.0, omega_deg=(150, 160))]
    beyond = replace(REQUIREMENTS, limits=limits, field=om.FieldRequirements(omega_max_deg=165))
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
            om.check_requirements(REQUIREMENTS, odd)
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
def test_filling_dimension_stays_within_range(focal, theta, radius_px, image_px):
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=120),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=40),
        lens=om.LensRequirements(focal_length_mm=focal, theta_max_deg=theta, f_number=4),
    )
    design = om.design_sensor(requirements)
    assert design.is_met, design.verdict.missed
    sensor = design.sensor
    if radius_px is not None:
        assert sensor.rim_radius_px == pytest.approx(radius_px, abs=0.02)
        return
    ends = {"theta": np.degrees(sensor.meridian.theta_max), "focal": sensor.lens.focal_length_mm}
    assert ends["theta" if isinstance(theta, tuple) else "focal"] == pytest.approx(
        image_px, rel=1e-9
    )
    assert sensor.rim_radius_px < 511
    assert any("the rim does not fill the imager" in note for note in design.notes)


# -- rows of a verdict ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("at_least", "at_most", "value", "margin", "scale"),
    [
        (1.0, 4.0, 4.5, -0.5, 4.0),
        (1.0, 4.0, 0.5, -0.5, 4.0),
        (1.0, 4.0, 1.5, 0.5, 4.0),
        (1.0, 4.0, 3.75, 0.25, 4.0),
        (-4.0, 1.0, 0.0, 1.0, 4.0),
        (2.0, None, 1.0, -1.0, 2.0),
        (None, 0.5, 0.75, -0.25, 0.5),
        (None, 0.0, 0.25, -0.25, 1.0),
    ],
)
def test_margin_is_the_distance_to_the_nearer_limit(at_least, at_most, value, margin, scale):
    row = RequirementCheck("rim_radius_mm", "mm", at_least, at_most, value)
    assert (row.margin, row.scale, row.shortfall) == (margin, scale, -margin / scale)
    assert row.is_met == (margin > 0)
    assert (row.omega_deg, row.part_deg, row.is_limit, row.remarks) == (None, None, False, ())
    assert row.label == "rim_radius_mm"
    assert replace(row, part_deg=(30.0, 60.0)).label == "rim_radius_mm, 30 to 60 deg"
    for tolerance in (0.9 * abs(margin), 1.1 * abs(margin)):
        tolerant = replace(row, tolerance=tolerance)
        assert tolerant.is_met == (margin > 0 or tolerance > -margin)
        assert tolerant.margin == (margin if margin > 0 or not tolerant.is_met else 0.0)


def test_worst_violation_of_missed_rows_only():
    feasible = RequirementCheck("a", "", 1.0, None, 3.0)
    tolerated = RequirementCheck("b", "px", None, 1.0, 1.5, tolerance=0.6, is_limit=True)
    violated = RequirementCheck("c", "", 4.0, None, 3.0, is_limit=True)
    worse = RequirementCheck("d", "", None, 2.0, 3.0)
    rows = (feasible, tolerated, violated, worse)
    for count, worst, names in (
        (1, 0.0, ()),
        (2, 0.0, ()),
        (3, 0.25, ("c",)),
        (4, 0.5, ("c", "d")),
    ):
        verdict = Verdict(REQUIREMENTS, SPHERE, rows[:count])
        assert (verdict.worst, verdict.missed, verdict.is_met) == (worst, names, not names)
    assert verdict.limits == (tolerated, violated)
    data = verdict.to_dict()
    assert (data["name"], data["is_met"]) == (SPHERE.name, False)
    assert [row["margin"] for row in data["requirements"]] == [2.0, 0.0, -1.0, -1.0]
    assert [row["is_met"] for row in data["requirements"]] == [True, True, False, False]


@pytest.mark.parametrize(
    ("start_deg", "low", "hidden", "value"),
    [
        (0.0, 0.0, 3.0, None),
        (0.5, 0.0, 0.0, 0.0),
        (0.5, 0.0, 3.0, 3.0),
        (0.0, 0.25, 0.0, 0.25),
        (0.0, 0.25, 3.0, 3.0),
        (20.0, 5.0, 3.0, 5.0),
    ],
)
def test_start_of_the_field_is_the_end_of_obscurations(start_deg, low, hidden, value, monkeypatch):
    evaluable = SimpleNamespace(obscured_to_deg=hidden, obscured_from_deg=128.0)
    monkeypatch.setattr(requirement_check, "evaluable_field", lambda field, sensor: evaluable)
    field = om.FieldRequirements(omega_max_deg=130.0, omega_min_deg=start_deg)
    end, *start = requirement_check._field_rows(
        SimpleNamespace(field=field), SimpleNamespace(field_deg=(low, 135.0))
    )
    assert end == RequirementCheck("omega_max_deg", "deg", 130.0, None, 128.0)
    expected = RequirementCheck("omega_min_deg", "deg", None, start_deg, value)
    assert start == ([] if value is None else [expected])


@pytest.mark.parametrize(
    ("focus_mm", "ends"),
    [
        (212.0, (212.0, 212.0)),
        ((100.0, 300.0), (100.0, 300.0)),
        ((100.0, np.inf), (100.0, None)),  # any distance from 100 mm
        (1e7, (1e7, 1e7)),  # at infinity
    ],
)
def test_farthest_focus_is_no_limit_of_a_range(focus_mm, ends):
    row = rows_of(om.check_requirements(REQUIREMENTS.changed(focus_mm=focus_mm), SPHERE))[
        "focus_mm"
    ]
    assert (row.at_least, row.at_most) == ends
    assert (row.unit, row.reached) == ("mm", SPHERE.lens.focus_distance_mm)


def test_rows_of_a_telecentric_lens():
    sensor = om.load_sensor("paraboloid-telecentric")
    lens = om.LensRequirements(kind="orthographic", magnification=(0.1, 0.11), f_number=(2.0, 8.0))
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=90.0),
        mirror=om.MirrorRequirements(family="paraboloid", rim_radius_mm=(1.0, 99.0)),
        lens=lens,
        imager=sensor.imager,
    )
    verdict = om.check_requirements(requirements, sensor)
    rows = rows_of(verdict)
    assert [*rows] == [
        "omega_max_deg",
        "rim_radius_mm",
        "image_radius_px",
        "f_number",
        "magnification",
    ]
    assert verdict.limits == ()
    assert (rows["magnification"].reached, rows["magnification"].unit) == (0.104, "")
    assert (rows["magnification"].at_least, rows["magnification"].at_most) == (0.1, 0.11)
    assert rows["f_number"].reached == sensor.lens.stop_number
    assert rows["rim_radius_mm"].unit == "mm"
    image = rows["image_radius_px"]
    assert (image.unit, image.at_least, image.tolerance) == ("px", None, 0.02)
    assert (image.at_most, image.reached) == (requirements.largest_image_px, sensor.rim_radius_px)


def test_limit_on_both_sides_has_the_row_of_the_smaller_margin():
    """Nearest to the lower limit or to the upper one, each with its own worst angle."""
    omega = np.linspace(20, 130, 1001)
    sensor = om.load_sensor("paper-equidistant")
    far = replace(REQUIREMENTS, field=om.FieldRequirements(omega_max_deg=130, omega_min_deg=20))
    values = om.evaluate(sensor, omega).aspect
    low, high = values.min(), values.max()
    for below, above in ((0.01, 0.03), (0.03, 0.01), (-0.01, -0.03), (-0.03, -0.01)):
        limit = om.Limit("aspect", at_least=low - below, at_most=high + above)
        (row,) = om.check_requirements(replace(far, limits=(limit,)), sensor).limits
        assert row.margin == pytest.approx(min(below, above), rel=1e-6)
        assert row.reached == pytest.approx(low if below < above else high, rel=1e-9)
        at = omega[values.argmin() if below < above else values.argmax()]
        assert row.omega_deg == pytest.approx(at, abs=0.2)
        assert (row.at_least, row.at_most, row.is_limit) == (low - below, high + above, True)


# -- temperature range ------------------------------------------------------------------------------

ALUMINIUM = om.Thermal(mirror_material="aluminium", spacer_material="aluminium")


@pytest.mark.parametrize(
    ("low", "high"), [(-12.34, 33.33), (-40.0, 20.04), (-29.97, 85.0), (19.99, 84.96)]
)
def test_ends_of_the_temperature_range_are_bracketed_in_steps_of_10_k(low, high, monkeypatch):
    temperatures = []

    def missed_rows(requirements, sensor, temperature):
        temperatures.append(temperature)
        return ("cold",) * (temperature < low) + ("warm",) * (temperature > high)

    monkeypatch.setattr(requirement_check, "_missed", missed_rows)
    limits = om.temperature_range(REQUIREMENTS, replace(SPHERE, thermal=ALUMINIUM))
    assert low <= limits.low_c + 0.05
    assert limits.low_c - low <= (0.15 if low > -40 else 0)
    assert high >= limits.high_c - 0.05
    assert high - limits.high_c <= (0.15 if high < 85 else 0)
    assert limits.below == (("cold",) if low > -40 else ())
    assert limits.above == (("warm",) if high < 85 else ())
    assert temperatures[:2] == [20.0, 10.0]
    downwards = [t for t in temperatures if t < 20]
    steps = [20 - 10 * k for k in range(1, 7) if 20 - 10 * (k - 1) >= low]
    assert downwards[: len(steps)] == [max(t, -40) for t in steps]
    upwards = [t for t in temperatures if t > 20]
    steps = [20 + 10 * k for k in range(1, 8) if 20 + 10 * (k - 1) <= high]
    assert upwards[: len(steps)] == [min(t, 85) for t in steps]
    assert len(temperatures) <= 1 + 6 + 7 + 2 * 7  # and bisection of 10 K to 0.1 K
    assert limits.to_dict() == {
        "low_c": limits.low_c,
        "high_c": limits.high_c,
        "below": list(limits.below),
        "above": list(limits.above),
    }


def test_requirements_missed_at_the_reference_leave_no_range():
    sensor = replace(SPHERE, thermal=ALUMINIUM)
    requirements = replace(REQUIREMENTS, limits=(om.Limit("total_blur_px", at_most=1.0),))
    limits = om.temperature_range(requirements, sensor)
    assert np.isnan([limits.low_c, limits.high_c]).all()
    assert limits.below == limits.above == ("theta_max_deg", "total_blur_px")


@pytest.mark.parametrize(
    ("coldest", "warmest", "is_valid"),
    [(20.0, 20.0, True), (20.5, 85.0, False), (-40.0, 19.5, False)],
)
def test_temperature_range_contains_the_reference(coldest, warmest, is_valid, monkeypatch):
    monkeypatch.setattr(requirement_check, "_missed", lambda *_: ())
    sensor, ends = replace(SPHERE, thermal=ALUMINIUM), {"coldest_c": coldest, "warmest_c": warmest}
    if is_valid:
        limits = om.temperature_range(REQUIREMENTS, sensor, **ends)
        assert (limits.low_c, limits.high_c) == (coldest, warmest)
        return
    with pytest.raises(
        InvalidParameter,
        match=f"reference temperature of the sensor, 20 C; got {coldest:g} and {warmest:g}",
    ):
        om.temperature_range(REQUIREMENTS, sensor, **ends)


def test_temperature_range_requires_thermal_properties():
    with pytest.raises(InvalidParameter, match="thermal"):
        om.temperature_range(REQUIREMENTS, SPHERE)


def test_sizes_that_expand_count_only_if_a_range_is_required(monkeypatch):
    """An acrylic mirror expands by 3 um per K: a given radius is that of manufacture, a range of radii
    holds at all temperatures. A sensor that is invalid at a temperature ends the range."""
    thermal = om.Thermal(mirror_material="acrylic", spacer_material="acrylic")
    sensor, rim = replace(SPHERE, thermal=thermal), SPHERE.mirror.rim_radius_mm
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=100.0),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=rim),
        lens=om.LensRequirements(theta_max_deg=(5.0, 20.0)),
        imager=replace(SPHERE.imager, width_px=2000, height_px=2000),
        limits=(om.Limit("total_blur_px", at_most=100.0),),
    )
    limits = om.temperature_range(requirements, sensor)
    assert (limits.low_c, limits.high_c) == (-40.0, 85.0)
    ranged = replace(
        requirements, mirror=replace(requirements.mirror, rim_radius_mm=(rim - 9.0, rim + 0.1))
    )
    limits = om.temperature_range(ranged, sensor)
    assert (limits.low_c, limits.above) == (-40.0, ("rim_radius_mm",))
    rim_mm = om.at_temperature(sensor, limits.high_c + 0.2).mirror.rim_radius_mm
    assert om.at_temperature(sensor, limits.high_c - 0.1).mirror.rim_radius_mm < rim + 0.1 < rim_mm

    def frozen(sensor, temperature):
        if temperature < 5.0:
            raise InvalidParameter("the lens must not freeze")
        return om.at_temperature(sensor, temperature)

    monkeypatch.setattr(requirement_check, "at_temperature", frozen)
    limits = om.temperature_range(requirements, sensor)
    assert limits.below == ("the lens must not freeze",)
    assert 5.0 <= limits.low_c <= 5.1
