"""Designs for a real lens and a cover: requirements are met behind them, by rays."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import SpecError
from omnimirror.design._design_problem import DesignSpace
from omnimirror.design.freeform import problem_of
from omnimirror.design.merits import body_mass_g, outer_size
from omnimirror.design.optimiser import described, problem_from, start
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import SurfaceLens
from tests.commands import omnimirror
from tests.optics.batch.test_built import Truth, from_stop
from tests.optics.lenses.prescriptions import imager_place, indices, zmx

FILE = """\
[field]
omega_max_deg = 120
[mirror]
mapping = "equidistant"
rim_radius_mm = 30
[lens.optics]
kind = "surfaces"
file = "triplet.zmx"
focus_distance_mm = 200
f_number = 5.6
[housing.dome]
material = "acrylic"
"""


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("built")
    (folder / "triplet.zmx").write_text(zmx())
    (folder / "asked.toml").write_text(FILE)
    return folder / "asked.toml"


@pytest.fixture(scope="module")
def requirements(file):
    return om.load_requirements(file)


def test_mapping_is_exact_behind_lens_and_dome(requirements):
    """Image heights of rays traced through the triplet, the mirror and both sides of the dome
    increase with the angle."""
    design = om.design_sensor(requirements)
    sensor = design.sensor
    assert design.is_met
    assert sensor.lens == requirements.lens.optics.focused_at(sensor.lens.focus_distance_mm)
    assert sensor.rim_radius_px == pytest.approx(512, abs=0.02)
    truth, to_imager = Truth(sensor), imager_place(indices(), sensor.lens.focus_distance_mm)

    def ray(t):
        y, height = from_stop(t, 0.0, to_imager)
        x, omega = truth.out(y, t)
        return x, omega, height / 5.2e-3

    end = np.tan(sensor.meridian.theta_max)
    rim = brentq(lambda t: ray(t)[0] - 30.0 * (1 - 1e-6), 0.9 * end, (1 - 1e-7) * end)
    rays = np.array([ray(t)[1:] for t in np.linspace(0.1, 1.0, 7) * rim])
    np.testing.assert_allclose(np.degrees(rays[-1, 0]), 120.0, atol=1e-3)
    np.testing.assert_allclose(rays[:, 1], rays[-1, 1] * rays[:, 0] / rays[-1, 0], atol=1e-3)


SHELLS = {
    "dome in water": Dome(medium="water"),
    "tube in water": Tube(medium="water"),
    "tube": Tube(),
}
EVERY_DAY = {("dome in water", False)}  # real lenses behind covers: the command below


@pytest.mark.parametrize(
    ("shell", "optics"),
    [
        pytest.param(
            shell,
            optics,
            id=f"{lens}-{name}",
            marks=() if (name, optics) in EVERY_DAY else pytest.mark.full,
        )
        for name, shell in SHELLS.items()
        for lens, optics in (("triplet", True), ("ideal lens", False))
    ],
)
def test_rim_reaches_required_angle_outside_cover(requirements, shell, optics):
    lens = (
        requirements.lens if optics else om.LensRequirements(focal_length_mm=11.6, focus_mm=160.0)
    )
    variant = replace(
        requirements.changed(mapping=None, family="sphere"), lens=lens, housing=Housing(shell=shell)
    )
    sensor = om.design_sensor(variant.changed(omega_min_deg=50.0)).sensor
    assert sensor.mirror.KIND == "sphere"
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-7)


def test_mapping_under_telecentric_lens_in_dome(requirements):
    lens = om.LensRequirements(kind="orthographic", focus_mm=30.0)
    sensor = om.design_sensor(replace(requirements, lens=lens)).sensor
    omega = np.linspace(10.0, 120.0 - 1e-9, 12)
    h = om.evaluate(sensor, omega).h_px
    np.testing.assert_allclose(h, h[-1] * omega / omega[-1], atol=1e-4)


def test_focus_is_optimal_for_real_lens(requirements):
    """Compared with om.best_focus of the sensor."""
    sensor = om.design_sensor(requirements).sensor
    omega = np.linspace(sensor.clear_field_deg[0], 120, 1001)
    best = om.best_focus(sensor, omega_deg=omega)
    area_deg2 = om.evaluate(sensor, omega).floored_area_deg2.max()
    assert area_deg2 <= best.value * 1.002


def test_blur_limits_include_aberrations_of_lens(requirements):
    limit = om.Limit("total_blur_px", at_most=1.0)
    verdict = om.check_requirements(
        replace(requirements, limits=(limit,)), om.design_sensor(requirements).sensor
    )
    result = om.evaluate(verdict.sensor, np.linspace(verdict.sensor.clear_field_deg[0], 120, 1001))
    variant = result.of_lens
    sides = (
        np.sqrt(result.blur_t_px**2 + variant["lens_blur_t_px"] ** 2 + result.airy_px**2),
        np.sqrt(result.blur_s_px**2 + variant["lens_blur_s_px"] ** 2 + result.airy_px**2),
    )
    assert verdict.limits[0].reached == pytest.approx(np.max(sides), rel=1e-9)
    assert "with the blur of the lens alone" in verdict.limits[0].remarks[-1]


def test_requirements_with_lens_round_trip(requirements, tmp_path):
    (tmp_path / "again.toml").write_text(
        om.format_requirements(requirements)
    )  # surfaces as numbers: no file required
    assert om.load_requirements(tmp_path / "again.toml") == requirements


def test_command_designs_with_lens_file(file, tmp_path):
    run = omnimirror("design", file, "-o", tmp_path / "sensor.toml")
    assert run.returncode == 0, run.stderr
    assert "maximum deviation of the mirror behind lens and cover from its mapping:" in run.stdout
    sensor = om.load_sensor(tmp_path / "sensor.toml")
    assert isinstance(sensor.lens, SurfaceLens)
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-6)


@pytest.mark.parametrize(
    ("assignment", "message"),
    [
        (
            "lens.focal_length_mm = 8",
            "lens.focal_length_mm and lens.optics must not be given together",
        ),
        ('lens.kind = "orthographic"', "lens.kind must be 'perspective' with lens.optics"),
        ('lens.optics.kind = "perspective"', "unknown entry lens.optics.file"),
    ],
)
def test_options_incompatible_with_real_lens_are_rejected(file, assignment, message):
    name, value = (part.strip() for part in assignment.split("="))
    *tables, entry = name.split(".")
    plain = {"8": 8.0}.get(value, value.strip('"'))
    lens = {entry: plain}
    if len(tables) > 1:
        lens = {
            "optics": {
                "kind": "perspective",
                "focal_length_mm": 8.0,
                "f_number": 2.0,
                "focus_distance_mm": 100.0,
            }
        }
    with pytest.raises(SpecError, match=message):
        om.load_requirements(file, {"lens": lens})


@pytest.mark.parametrize("medium", [None, "water"])
def test_freeform_model_agrees_with_sensors_behind_lens_and_dome(requirements, medium):
    """Field, image and blur of a point in the design space equal those of its evaluated sensor;
    derivatives equal differences."""
    housing = Housing(shell=Dome(medium=medium))
    mirror = om.MirrorRequirements(
        optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=30
    )
    space = DesignSpace(problem_of(replace(requirements, mirror=mirror, housing=housing)))
    _, y = start(space, 0, 0)
    sensor, u = space.sensor(y), np.linspace(0, 1, 7)

    def state(y):
        return space.state(y[None], u, space.basis(u))

    result, current = om.evaluate(sensor, x_mm=30 * u), state(y)
    assert sensor.field_deg[1] == pytest.approx(120.0, abs=1e-9)
    assert sensor.rim_radius_px == pytest.approx(512.0, abs=1e-6)
    np.testing.assert_allclose(np.degrees(current.omega[0]), result.omega_deg, atol=1e-9)
    np.testing.assert_allclose(current.field.dh[0], result.dh_domega_px_per_deg, rtol=1e-9)
    np.testing.assert_allclose(current.field.t_px[0], result.blur_t_px, atol=2e-3)
    for e in np.eye(space.dim):
        derivatives = (state(y + 1e-6 * e).field.t_px - state(y - 1e-6 * e).field.t_px) / 2e-6
        np.testing.assert_allclose(
            state(y + 1e-30j * e).field.t_px.imag / 1e-30, derivatives, rtol=1e-5, atol=1e-6
        )


SIZES = ("overall_diameter_mm", "overall_height_mm", "mirror_body_mass_g")


@pytest.mark.parametrize("kind", ["perspective", "telecentric", "triplet in a dome"])
def test_freeform_model_includes_overall_size(requirements, kind):
    """Size and mass of its points, in the search and in batches of thousands, equal those of their
    sensors."""
    limits = tuple(om.Limit(name, at_most=1e3) for name in SIZES)
    mirror = om.MirrorRequirements(
        optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=(20, 40)
    )
    plain = om.LensRequirements(focal_length_mm=8.0, f_number=8.0)
    telecentric = om.LensRequirements(kind="orthographic", f_number=8.0)
    lens = {"perspective": plain, "telecentric": telecentric}.get(kind, requirements.lens)
    rimmed = Housing(CameraBody(70.0), rim=Rim(width_mm=2.0, thickness_mm=8.0))
    housing = {"perspective": rimmed, "telecentric": replace(rimmed, camera=None)}.get(
        kind, requirements.housing
    )
    thermal = om.Thermal(mirror_material="acrylic")
    limited_requirements = replace(
        requirements, mirror=mirror, lens=lens, limits=limits, housing=housing, thermal=thermal
    )
    space = DesignSpace(problem_of(limited_requirements))
    _, y = start(space, 0, 0)
    sensor = replace(space.sensor(y), thermal=thermal)
    expected = [*outer_size(sensor), body_mass_g(sensor)]
    u = np.linspace(0, 1, 7)
    search_field = space.state(y[None], u, space.basis(u)).field
    many = space.field(y[None], space.evaluate(y[None], 7))
    for field in (search_field, many):
        np.testing.assert_allclose(
            [getattr(field, name).item() for name in SIZES], expected, rtol=1e-9
        )


def test_overall_size_limit_reduces_freeform_mirror():
    """Larger mirrors have less blur, and this one is as large as the height limit allows."""
    field, imager = om.FieldRequirements(omega_max_deg=110.0), Imager(1600, 1200, 4.5)
    mirror = om.MirrorRequirements(
        optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=(20, 40)
    )
    lens = om.LensRequirements(focal_length_mm=8.0, f_number=8.0)
    requirements = om.Requirements(field=field, mirror=mirror, lens=lens, imager=imager)
    one_start = om.SearchOptions(starts=1)
    free = om.design_sensor(requirements, search=one_start).sensor
    limited = om.design_sensor(
        replace(requirements, limits=(om.Limit("overall_height_mm", at_most=120.0),)),
        search=one_start,
    )
    assert outer_size(free).height_mm > 135
    assert limited.is_met
    assert outer_size(limited.sensor).height_mm == pytest.approx(120.0, rel=2e-3)


@pytest.mark.full
def test_freeform_mirror_is_optimal_behind_lens_and_dome(requirements):
    """Better than the sphere solved for them; its merit equals that of the evaluation."""
    mirror = om.MirrorRequirements(
        optimise="worst_floored_area_deg2", shape="polynomial:3", rim_radius_mm=30
    )
    design = om.design_sensor(
        replace(requirements, mirror=mirror), search=om.SearchOptions(starts=1)
    )
    sphere = om.design_sensor(requirements.changed(mapping=None, family="sphere")).sensor

    def worst(sensor):
        omega = np.linspace(sensor.clear_field_deg[0], 120 - 1e-9, 1001)
        return om.evaluate(sensor, omega).floored_area_deg2.max()

    assert design.is_met
    assert design.sensor.lens.KIND == "surfaces"
    assert worst(design.sensor) == pytest.approx(design.optimum.value, rel=2e-3)
    assert worst(design.sensor) < 0.6 * worst(sphere)
    assert (
        problem_from(json.loads(json.dumps(described(design.optimum.problem))))
        == design.optimum.problem
    )


@pytest.mark.full
@pytest.mark.parametrize(
    "options", [{"family": "sphere"}, {"optimise": "worst_blur_deg", "shape": "polynomial:3"}]
)
def test_infeasible_limits_are_reported_and_lens_is_kept(requirements, options):
    """A real lens has no free parameters; the advice concerns the other requirements."""
    limits = (om.Limit("length_mm", at_most=60.0), om.Limit("obscured_percent", at_most=90.0))
    mirror = om.MirrorRequirements(rim_radius_mm=30, **options)
    variant = replace(
        requirements,
        mirror=mirror,
        limits=limits,
        lens=replace(requirements.lens, theta_max_deg=12.0),
    )
    design = om.design_sensor(variant, search=om.SearchOptions(starts=1))
    assert "length_mm" in design.verdict.missed
    assert design.conflict is not None
    names = {change.name for change in (*design.conflict.alone, *design.conflict.joint)}
    assert names
    assert not names & {"focal_length_mm", "f_number"}
