"""Designs: tables agree with the evaluation, and relaxations are sufficient."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SpecError
from omnimirror.design import parse_requirements
from omnimirror.design._parameter_search import RangeSearch, ranges_of
from omnimirror.design.designer import design_sensor
from omnimirror.design.requirement_check import evaluable_field
from omnimirror.optics.housing import CameraBody, Housing, Tube
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from tests.design.answers import best, row

COMMON = """
field.omega_max_deg = 135
[mirror]
mapping = "equidistant"
rim_radius_mm = 43.9
[lens]
theta_max_deg = 12
"""


def test_default_design_is_bundled_exact_sensor():
    design = design_sensor(
        parse_requirements(COMMON.replace("[lens]", "[lens]\nfocal_length_mm = 11.6"))
    )
    bundled = om.load_sensor("exact-equidistant")
    assert design.is_met
    assert design.conflict is None
    assert design.sensor.mirror == bundled.mirror
    assert design.sensor.mirror_distance_mm == pytest.approx(bundled.mirror_distance_mm, rel=1e-14)
    assert design.sensor.lens.focal_length_mm == 11.6
    best = om.best_focus(design.sensor)
    assert design.sensor.lens.focus_distance_mm == pytest.approx(best.focus_mm, abs=0.05)
    assert parse_sensor(format_sensor(design.sensor)) == design.sensor


@pytest.mark.parametrize("entry", ["theta_max_deg = 12", "focal_length_mm = 9.5"])
def test_free_lens_parameter_makes_rim_fill_imager(entry):
    text = (
        COMMON.replace("theta_max_deg = 12", entry)
        + "[imager]\nwidth_px = 1600\nheight_px = 1200\npixel_pitch_um = 3.0"
    )
    design = design_sensor(parse_requirements(text))
    assert design.is_met
    assert design.sensor.rim_radius_px == pytest.approx(600.0, abs=0.02)
    omega = np.linspace(1, 135, 60)
    h = om.evaluate(design.sensor, omega).h_px
    np.testing.assert_allclose(h / design.sensor.rim_radius_px, omega / 135, rtol=1e-9)


@pytest.mark.full
def test_rim_outside_imager_is_reported_with_relaxations():
    text = COMMON.replace("[lens]", "[lens]\nfocal_length_mm = 14.0")
    design = design_sensor(parse_requirements(text))
    image = row(design, "image_radius_px")
    assert not image.is_met
    assert image.reached == pytest.approx(design.sensor.rim_radius_px)
    alone = {r.name: r for r in design.conflict.alone}
    for name, requested in (("theta_max_deg", "12"), ("focal_length_mm", "14.0")):
        needed = alone[name].needed  # the value at which the imager is filled
        verdicts = [
            best(parse_requirements(text.replace(f"{name} = {requested}", f"{name} = {value}")))
            for value in (needed, needed * 1.005)
        ]
        assert [verdict.is_met for verdict in verdicts] == [True, False]
    far_px = (
        14.0 * np.tan(np.radians(12)) / (design.sensor.imager.pixel_pitch_um * 1e-3)
    )  # focused at infinity
    assert far_px < alone["image_radius_px"].needed <= image.reached


LIMITED = """
[field]
omega_max_deg = 130
object_distance_mm = [600, inf]
[mirror]
family = "sphere"
rim_radius_mm = 40
[lens]
theta_max_deg = 12
[[limit]]
quantity = "total_blur_px"
at_most = 4.0
[[limit]]
quantity = "resolution_px_per_deg"
at_least = 2.0
omega_deg = [20, 120]
[[limit]]
quantity = "viewpoint_spread_mm"
at_most = 60
"""


@pytest.fixture(scope="module")
def limited():
    return design_sensor(parse_requirements(LIMITED))


def test_table_agrees_with_evaluation(limited):
    omega = np.linspace(0, 130, 2000)
    near, far = (om.evaluate(limited.sensor, omega, object_distance_mm=d) for d in (600.0, np.inf))
    worst = max(np.abs([e.blur_t_px, e.blur_s_px]).max() for e in (near, far))
    assert row(limited, "total_blur_px").reached == pytest.approx(
        np.hypot(worst, near.airy_px), rel=1e-4
    )
    part = om.evaluate(
        limited.sensor, np.linspace(20, 120, 2000), object_distance_mm=600.0
    )  # the coarser
    finest = np.minimum(part.dh_domega_px_per_deg, part.width_px_per_deg)
    resolution = row(limited, "resolution_px_per_deg")
    assert resolution.reached == pytest.approx(finest.min(), rel=1e-4)
    assert resolution.omega_deg == pytest.approx(part.omega_deg[finest.argmin()], abs=0.2)
    assert resolution.margin == pytest.approx(resolution.reached - 2.0)
    assert row(limited, "viewpoint_spread_mm").reached == pytest.approx(
        np.ptp(far.viewpoint_z_mm), rel=1e-6
    )


def test_single_relaxation_is_sufficient_and_minimal(limited):
    """Each relaxation is inserted in the requirements: feasible with it, infeasible with slightly
    less."""
    requirements, numbers = limited.requirements, ranges_of(limited.requirements)
    assert limited.conflict.missed == ("total_blur_px",)
    count = 0
    for relaxation in limited.conflict.alone:
        if (
            relaxation.needed is None
            or relaxation.needed == relaxation.requested
            or relaxation.name not in numbers
        ):
            continue
        count += 1
        assert best(requirements.changed(**{relaxation.name: relaxation.needed})).is_met, relaxation
        less = relaxation.requested + 0.97 * (relaxation.needed - relaxation.requested)
        assert not best(requirements.changed(**{relaxation.name: less})).is_met, relaxation
    assert count >= 2
    blur = next(r for r in limited.conflict.alone if r.name == "total_blur_px")
    blur_px = row(limited, "total_blur_px").reached
    assert blur_px <= blur.needed == pytest.approx(blur_px, rel=1e-4)


def test_joint_relaxation_is_sufficient(limited):
    requirements = limited.requirements
    assert (
        0
        < limited.conflict.joint_change
        < max(r.relative_change for r in limited.conflict.alone if r.relative_change)
    )
    numbers, limits = ranges_of(requirements), list(requirements.limits)
    for relaxation in limited.conflict.joint:
        if relaxation.name in numbers:
            requirements = requirements.changed(**{relaxation.name: relaxation.needed})
        elif relaxation.name == "total_blur_px":
            limits[0] = replace(limits[0], at_most=relaxation.needed)
    assert best(replace(requirements, limits=tuple(limits))).is_met


def test_range_is_used_where_it_improves_margin():
    design = design_sensor(
        parse_requirements(
            LIMITED.replace("theta_max_deg = 12", "theta_max_deg = 12\nf_number = [2, 16]")
        )
    )
    assert design.is_met
    search = RangeSearch(design.requirements)
    blurs = [
        search.evaluated(search.middle().changed(f_number=float(F))).cost
        for F in np.linspace(2, 16, 5)
    ]
    assert max(r.shortfall for r in design.rows if r.is_limit) <= min(blurs) + 1e-3


def test_free_ellipsoid_has_minimum_blur_of_family():
    design = design_sensor(
        parse_requirements(COMMON.replace('mapping = "equidistant"', 'family = "ellipsoid"'))
    )
    search = RangeSearch(design.requirements)
    conic = design.sensor.mirror.conic
    cost = search.evaluated(search.middle().changed(conic=conic)).cost
    for step in (-0.05, 0.05):
        assert search.evaluated(search.middle().changed(conic=conic + step)).cost > cost
    assert any("conic" in note for note in design.notes)


def test_telecentric_lens_is_as_wide_as_mirror():
    design = design_sensor(
        parse_requirements(
            'field.omega_max_deg = 120\n[mirror]\nmapping = "equiareal"\nrim_radius_mm = '
            '20\n[lens]\nkind = "orthographic"'
        )
    )
    assert design.is_met
    assert design.sensor.lens.magnification == pytest.approx(512 * 5.2e-3 / 20)
    areas = om.evaluate(design.sensor, np.linspace(1, 119, 30)).area_px2
    np.testing.assert_allclose(areas, areas[0], rtol=1e-9)


def test_field_that_begins_outside_obscuration():
    """The camera obscures the centre: a smooth mirror images it nevertheless, a pointed one
    excludes it."""
    text = COMMON.replace(
        "field.omega_max_deg = 135",
        "field = {omega_max_deg = 135, omega_min_deg = 30}\nhousing.camera.diameter_mm = 60",
    )
    smooth = design_sensor(parse_requirements(text))
    pointed = design_sensor(parse_requirements(text.replace("[lens]", 'apex = "pointed"\n[lens]')))
    assert smooth.is_met
    assert pointed.is_met
    assert smooth.sensor.field_deg[0] == 0
    assert pointed.sensor.field_deg[0] == pytest.approx(30)
    rates = [om.evaluate(d.sensor, [80.0]).dh_domega_px_per_deg[0] for d in (smooth, pointed)]
    assert rates[1] / rates[0] == pytest.approx(135 / 105, rel=1e-6)
    hidden = best(parse_requirements(text.replace("omega_min_deg = 30", "omega_min_deg = 5")))
    assert not row(hidden, "omega_min_deg").is_met


def test_obscuration_by_camera_agrees_with_real_rays():
    sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    angle = evaluable_field(om.FieldRequirements(omega_max_deg=130), sensor).obscured_to_deg
    for omega, clears in ((angle - 0.05, False), (angle + 0.05, True)):
        rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega])))
        fall = (rays.z[0] + sensor.mirror_distance_mm) / np.cos(rays.omega[0])
        assert (rays.x[0] + fall * np.sin(rays.omega[0]) > 30.0) == clears


def test_field_obscured_by_tube_is_missed_or_excluded():
    """Its cap obscures the last degrees: the required field is not reached, and limits end at the
    obscuration."""
    limit = '[[limit]]\nquantity = "total_blur_px"\nat_most = 100.0\n'
    design = best(parse_requirements(COMMON + limit + "[housing.tube]\ndiameter_mm = 130.0\n"))
    sensor = design.sensor
    assert sensor.housing == Housing(shell=Tube(130.0))
    start_deg = next(ring.omega_deg[0] for ring in sensor.obscurations if ring.part == "tube's cap")
    reached_deg = row(design, "omega_max_deg").reached
    assert reached_deg == pytest.approx(start_deg, abs=2e-9)
    assert reached_deg < 130
    assert not row(design, "omega_max_deg").is_met
    assert any(
        "obscured by the housing" in remark for remark in row(design, "total_blur_px").remarks
    )


@pytest.mark.full
def test_cone_reports_inner_field_limit():
    design = design_sensor(
        parse_requirements(COMMON.replace('mapping = "equidistant"', 'family = "cone"'))
    )
    assert design.conflict.missed == ("omega_min_deg",)
    assert [r.needed for r in design.conflict.alone if r.name == "omega_min_deg"] == [
        pytest.approx(123)
    ]


def test_fit_deviation_is_reported_in_pixels():
    design = design_sensor(
        parse_requirements(COMMON.replace("[lens]", 'fit = "polynomial:4"\n[lens]'))
    )
    omega = np.linspace(1, 135, 1500)
    result = om.evaluate(design.sensor, omega)
    b0, pitch = design.sensor.lens.image_distance, 5.2e-3
    expected = omega / 135 * b0 * np.tan(np.radians(12)) / pitch
    deviation_px = next(float(n.split()[-2]) for n in design.notes if "deviation" in n)
    assert np.abs(result.h_px - expected).max() == pytest.approx(deviation_px, rel=0.02)


def test_infeasible_designs_raise():
    with pytest.raises(InvalidParameter, match="omega_max_deg must be between 50 and 130 deg"):
        design_sensor(
            parse_requirements(COMMON.replace("theta_max_deg = 12", "theta_max_deg = 50"))
        )
    with pytest.raises(
        SpecError, match="line 4: the ground-plane mapping requires plane_distance_mm"
    ):
        design_sensor(
            parse_requirements(COMMON.replace("equidistant", "ground-plane").replace("135", "70"))
        )


def test_unreachable_mapping_names_line():
    common = COMMON.replace("field.omega", "[field]\nomega")
    ground = common.replace('"equidistant"', '"ground-plane"\nplane_distance_mm = 800')
    with pytest.raises(
        SpecError,
        match=r"line \d+: omega_max_deg must be less than 90 deg for the ground-plane mapping; got 135",
    ):
        parse_requirements(ground)
    rows = "omega_deg = [0, 20, 40, 60, 80, 100]\nheight = [{}, 1, 2, 3, 4, 5]"
    for first, message in (
        (0, "omega_max_deg must be the last angle of the mapping table, 100 deg; got 135"),
        (0.5, "height must start with 0"),
    ):
        table = common.replace('"equidistant"', '"tabulated-mapping"\n' + rows.format(first))
        with pytest.raises(SpecError, match=rf"line \d+: {message}"):
            parse_requirements(table)
