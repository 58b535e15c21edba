"""Forms of requirements: elevations, one angle, surfaces, contrast, light, an off-the-shelf lens."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli._design_options import limit
from omnimirror.base.errors import OmnimirrorError
from omnimirror.cameras.camera import Mount
from omnimirror.design import parse_requirements
from omnimirror.design._candidates import focusing
from omnimirror.design._design_problem import DesignSpace
from omnimirror.design.freeform import problem_of
from omnimirror.design.limits import contrast
from omnimirror.design.merits import values_of_evaluation
from omnimirror.design.requirement_check import cut_off, distances_of, evaluations
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Sphere
from tests.everyday import few

SPHERE = om.load_sensor("paper-spherical")
MIRROR = om.MirrorRequirements(family="sphere", rim_radius_mm=30)
TEXT = """
[field]
{field}
[mount]
camera_looks = "{looks}"
[mirror]
family = "sphere"
rim_radius_mm = 30
[lens]
{lens}
[[limit]]
quantity = "total_blur_px"
at_most = 40
{part}
"""


def requirements_for(
    field="elevation_deg = [-60, 20]",
    looks="up",
    lens="focal_length_mm = 6",
    part="elevation_deg = 0",
):
    return parse_requirements(TEXT.format(field=field, looks=looks, lens=lens, part=part))


# -- elevations ------------------------------------------------------------------------------------


@pytest.mark.parametrize(("looks", "field"), [("up", (30.0, 110.0)), ("down", (70.0, 150.0))])
def test_elevations_agree_with_directions_of_sensor(looks, field):
    requirements = requirements_for(looks=looks)
    assert (requirements.field.omega_min_deg, requirements.field.omega_max_deg) == field
    assert requirements.limits[0].omega_deg == (90.0, 90.0)
    sensor = replace(SPHERE, mount=Mount(looks))
    for elevation, omega in zip(
        (-40.0, 20.0), sorted(Mount(looks).field_angles_deg((-40.0, 20.0))), strict=True
    ):
        tilt = np.radians(elevation if looks == "up" else -20.0 - elevation)
        (pixel,), visible = sensor.project_directions([[np.cos(tilt), 0.0, np.sin(tilt)]])
        assert visible.all()
        evaluation = om.evaluate(sensor, pixels=[pixel])
        assert evaluation.omega_deg[0] == pytest.approx(omega, abs=1e-9)


def test_elevations_round_trip_through_file():
    requirements = requirements_for("elevation_deg = [-60.3, 20.7]")
    assert "elevation_deg = [\n    -60.3,\n    20.7,\n]" in om.format_requirements(requirements)
    assert parse_requirements(om.format_requirements(requirements)) == requirements


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"looks": "forward"}, r"line 3: camera_looks must be .* for elevations; got \"forward\""),
        (
            {"field": "elevation_deg = [20, -60]"},
            r"line 3: field.elevation_deg must be \[LOW, HIGH\] in the field",
        ),
        (
            {"field": "elevation_deg = [-60, 99]"},
            "line 3: field.elevation_deg.* less than or equal to 90",
        ),
        ({"field": "elevation_deg = 20"}, "line 3: field.elevation_deg must be a valid list"),
        (
            {"field": "elevation_deg = [-60, 20]\nomega_max_deg = 100"},
            "field.elevation_deg and field.omega_max_deg must not be given together",
        ),
        (
            {"part": "elevation_deg = 0\nomega_deg = 90"},
            "limit.elevation_deg and limit.omega_deg must not be given together",
        ),
        ({"part": "elevation_deg = 30"}, r"limit.omega_deg must be \[FROM, TO\]"),
        ({"part": "elevation_deg = [10, 0]"}, r"limit.0.elevation_deg must be \[LOW, HIGH\]"),
    ],
)
def test_invalid_elevations_are_rejected(change, message):
    with pytest.raises(OmnimirrorError, match=message) as e:
        requirements_for(**change)
    assert "\n" not in str(e.value)


def test_tilted_sensor_rejects_elevations():
    with pytest.raises(OmnimirrorError, match="pitch_deg and roll_deg must be 0 for elevations"):
        Mount("down", pitch_deg=5.0).field_angles_deg((0.0, 1.0))


# -- one angle, and the command line ---------------------------------------------------------------


def test_command_line_limits_accept_range_and_frequency():
    assert limit("mtf:0.25=0.3@90") == (
        "mtf",
        0.3,
        {"cycles_per_px": 0.25, "omega_deg": [90.0, 90.0]},
    )
    assert limit("aspect=2@elevation=-10:20") == ("aspect", 2.0, {"elevation_deg": [-10.0, 20.0]})


def test_limit_at_single_angle_is_evaluated_only_there():
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=135),
        mirror=MIRROR,
        lens=om.LensRequirements(focal_length_mm=11.6),
        limits=[om.Limit("resolution_px_per_deg", at_least=1.0, omega_deg=(90, 90))],
    )
    (row,) = om.check_requirements(requirements, SPHERE).limits
    evaluation = om.evaluate(SPHERE, [90.0])
    assert row.label == "resolution_px_per_deg, at 90 deg"
    assert row.reached == pytest.approx(
        min(evaluation.dh_domega_px_per_deg[0], evaluation.width_px_per_deg[0])
    )


# -- object surfaces -------------------------------------------------------------------------------

ROOM = om.FieldRequirements(
    omega_max_deg=130, object_plane_distance_mm=700, object_cylinder_radius_mm=900
)


@pytest.mark.parametrize("name", ["paper-spherical", "paraboloid-telecentric"])
def test_object_distance_is_to_first_surface_hit(name):
    sensor = om.load_sensor(name)
    omega = np.linspace(1.0, sensor.field_deg[1], 60)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    (p,) = distances_of(ROOM, rays)
    x, z = rays.x + p * np.sin(rays.omega), rays.z - p * np.cos(rays.omega)
    on_floor, on_wall = np.isclose(z, -700, atol=1e-6), np.isclose(x, 900, atol=1e-6)
    assert (on_floor | on_wall).all()
    assert on_floor.any()
    assert on_wall.any()
    assert (z > -700 - 1e-6).all()
    assert (x < 900 + 1e-6).all()


def test_floor_has_no_points_above_horizon():
    floor = om.FieldRequirements(omega_max_deg=130, object_plane_distance_mm=700)
    rays = SPHERE.meridian.trace(SPHERE.meridian.x_from_omega(np.radians([60.0, 120.0])))
    (p,) = distances_of(floor, rays)
    assert np.isfinite(p[0])
    assert np.isinf(p[1])


def test_surface_behind_cover_is_hit_by_refracted_ray():
    sensor = replace(SPHERE, housing=Housing(shell=Dome()))
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([60.0, 110.0])))
    (p,) = distances_of(replace(ROOM, object_plane_distance_mm=None), rays)
    outer_x, _ = rays.last
    beyond = p - rays.outside.inside
    assert outer_x + beyond * np.sin(rays.omega) == pytest.approx(900.0)


PIPE = {"object_cylinder_radius_mm": 150.0}
FLOOR = {"object_plane_distance_mm": 300.0}
TUBE, DOME = (
    Housing(shell=Tube(60.0, 2.0, material="sapphire", medium="water")),
    Housing(shell=Dome(160.0, 3.0, 1.49, centre_mm=-25.0)),
)


def finite_resolution(sensor, h, surface):
    """Return field angle and resolution, px/deg along and around, by rays of neighbouring pixels
    refracted with Snell's law: size on the object surface, across the ray, over the length of the
    optical path from the mirror."""
    shell, A, m = sensor.housing.shell, sensor.mirror.radius_mm, sensor.mirror_distance_mm
    b = 1 / (1 / sensor.lens.focal_length_mm - 1 / sensor.lens.focus_distance_mm)
    middle = shell.centres_mm[1] if isinstance(shell, Dome) else None

    def intersection(point, ray, radius, centre):
        """Return the intersection with a sphere about (0, centre) or with the cylinder, and its
        unit normal."""
        weights = np.array([1.0, 0.0 if centre is None else 1.0])
        start = (point - [0.0, centre or 0.0]) * weights
        a, half, c = (ray * weights) @ ray, start @ ray, start @ start - radius**2
        hit = point + (np.sqrt(half**2 - a * c) - half) / a * ray
        return hit, (hit - [0.0, centre or 0.0]) * weights / radius

    def trace(h):
        theta = np.arctan(h * sensor.imager.pitch_mm / b)
        ray, start = np.array([np.sin(theta), np.cos(theta)]), np.array([0.0, -m - A])
        half = start @ ray
        point = [0.0, -m] - (half + np.sqrt(half**2 - start @ start + A**2)) * ray
        normal = (point - [0.0, A]) / A
        ray, path = ray - 2 * (ray @ normal) * normal, 0.0
        indices = (1.0, shell.index, shell.outer_index)
        for radius, before, after in zip(shell.radii_mm, indices, indices[1:], strict=False):
            hit, normal = intersection(point, ray, radius, middle)
            path, point = path + np.linalg.norm(hit - point), hit
            ratio, cosine = before / after, ray @ normal
            ray = ratio * ray + (np.sqrt(1 - ratio**2 * (1 - cosine**2)) - ratio * cosine) * normal
        distance = (150.0 - point[0]) / ray[0] if surface is PIPE else (-300.0 - point[1]) / ray[1]
        return point + distance * ray, ray, path + distance

    hit, ray, p = trace(h)
    step = trace(h + 0.01)[0] - trace(h - 0.01)[0]
    across = np.linalg.norm(step - (step @ ray) * ray)
    omega = np.degrees(np.arctan2(ray[0], -ray[1]))
    return omega, 0.02 / np.degrees(across / p), h / np.degrees(hit[0] / p)


@pytest.mark.parametrize(
    ("housing", "surface", "height"),
    [
        (TUBE, PIPE, 590.0),
        (TUBE, PIPE, 300.0),
        (TUBE, PIPE, 130.0),
        (DOME, PIPE, 400.0),
        (DOME, FLOOR, 250.0),
    ],
)
def test_resolution_on_object_surface_agrees_with_finite_rays(housing, surface, height):
    sensor = om.Sensor(
        Sphere(28.384, 22.0),
        Perspective(6.0, 4.0, 79.46),
        Imager(1920, 1200, 3.0),
        Mount(),
        68.874,
        housing=housing,
    )
    omega, along, around = finite_resolution(sensor, height, surface)
    limits = [
        om.Limit(f"{name}_px_per_deg", at_least=1.0, omega_deg=(omega, omega))
        for name in ("dh_domega", "width")
    ]
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=110, **surface),
        mirror=MIRROR,
        lens=om.LensRequirements(focal_length_mm=6.0),
        limits=limits,
    )
    assert [
        row.reached for row in om.check_requirements(requirements, sensor).limits
    ] == pytest.approx([along, around], rel=1e-5)
    optics = focusing(requirements, sensor).at(np.full((1, 1), 1 / 79.46), limits[0])
    assert [optics.dh[0, 0], optics.dw[0, 0]] == pytest.approx([along, around], rel=1e-5)


def test_design_for_wall_is_focused_on_wall():
    """Blur by the evaluation with the distance of each angle, against all other focus settings."""
    requirements = om.Requirements(
        field=om.FieldRequirements(
            omega_max_deg=120, omega_min_deg=40, object_cylinder_radius_mm=60
        ),
        mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=20),
        lens=om.LensRequirements(focal_length_mm=8, f_number=8),
        limits=[om.Limit("total_blur_px", at_most=30.0)],
    )
    sensor = om.design_sensor(requirements).sensor
    omega = np.linspace(40.0, sensor.field_deg[1], 181)

    def worst(focus_mm):
        (result,) = evaluations(
            requirements, sensor.with_lens(sensor.lens.focused_at(focus_mm)), omega
        )
        return np.hypot(
            np.maximum(abs(result.blur_t_px), abs(result.blur_s_px)), result.airy_px
        ).max()

    focus = sensor.lens.focus_distance_mm
    assert om.check_requirements(requirements, sensor).limits[0].reached == pytest.approx(
        worst(focus), rel=1e-3
    )
    assert all(worst(focus * factor) > worst(focus) for factor in (0.97, 0.99, 1.01, 1.03))


@pytest.mark.parametrize(
    ("field", "mirror", "message"),
    [
        (
            {"object_distance_mm": 500},
            {},
            "object_distance_mm must not be given together with an object plane",
        ),
        (
            {},
            {"rim_radius_mm": 1000},
            "object_cylinder_radius_mm must be greater than rim_radius_mm = 1000; got 900",
        ),
        (
            {},
            {"optimise": "worst_blur_deg", "family": None},
            "must not be given together with an object plane or cylinder",
        ),
    ],
)
def test_invalid_object_surfaces_are_rejected(field, mirror, message):
    with pytest.raises(OmnimirrorError, match=message):
        om.Requirements(
            field=replace(ROOM, **field),
            mirror=replace(MIRROR, **mirror),
            lens=om.LensRequirements(theta_max_deg=10),
        )


# -- contrast and light ----------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant", "paraboloid-telecentric"])
@pytest.mark.parametrize("cycles", few([0.1, 0.25, 0.5], 0.25))
def test_mtf_agrees_with_diffraction_integral(name, cycles):
    """Except for aberrations omitted in the closed form: coma and others, largest in radial
    direction."""
    sensor = om.load_sensor(name)
    omega = np.linspace(10.0, 0.99 * sensor.field_deg[1], 5)
    waves, evaluation = om.mtf(sensor, omega, cycles_per_px=[cycles]), om.evaluate(sensor, omega)
    for blur, contrasts, near in (
        (evaluation.blur_t_px, waves.tangential, 0.013),
        (evaluation.blur_s_px, waves.sagittal, 0.002),
    ):
        assert np.abs(contrast(blur, evaluation.airy_px, cycles)) == pytest.approx(
            contrasts[:, 0], abs=near
        )


def test_mtf_has_exact_derivatives():
    for real in (
        lambda v: contrast(v, np.array([1.09]), 0.3),
        lambda v: contrast(np.array([2.0]), v, 0.3),
    ):
        at = np.array([1.7])
        slope = real(at + 1e-30j).imag / 1e-30
        assert slope == pytest.approx((real(at + 1e-6) - real(at - 1e-6)) / 2e-6, rel=1e-6)


def test_mtf_is_zero_above_cutoff():
    assert contrast(np.array([0.0]), np.array([2.44]), 1.001)[0] == 0.0
    assert contrast(np.array([0.0]), np.array([2.44]), 0.9)[0] > 0.0


@pytest.mark.parametrize("name", ["paper-spherical", "paraboloid-telecentric"])
def test_illumination_agrees_with_rays_through_aperture(name):
    sensor = om.load_sensor(name)
    omega = np.linspace(*sensor.field_deg, 6)[1:-1]
    light = values_of_evaluation(om.evaluate(sensor, omega)).light
    assert light == pytest.approx(om.illumination(sensor, omega).relative, rel=0.003)


def test_freeform_mirror_meets_mtf_and_illumination_limits():
    mirror = om.MirrorRequirements(
        optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=43.9
    )
    limits = [
        om.Limit("mtf_t", at_least=0.5, cycles_per_px=0.25, omega_deg=(20, 130)),
        om.Limit("lens_illumination", at_least=0.9),
    ]
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=135),
        mirror=mirror,
        lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12, f_number=8),
        limits=limits,
    )
    space = DesignSpace(problem_of(requirements))
    design = om.design_sensor(requirements, search=om.SearchOptions(starts=1))
    assert design.is_met
    assert space.problem.limits == requirements.limits
    waves = om.mtf(design.sensor, np.linspace(20, 130, 12), cycles_per_px=[0.25])
    assert waves.tangential.min() >= 0.5 - 0.013


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ({"quantity": "mtf", "at_least": 0.3}, "requires a spatial frequency"),
        (
            {"quantity": "mtf", "at_least": 0.3, "cycles_per_px": 0.0},
            r"limit\.cycles_per_px must be greater than 0 and at most 10; got 0\.0",
        ),
        (
            {"quantity": "mtf", "at_least": 1.3, "cycles_per_px": 0.2},
            "at_least must be at most 1; got 1.3",
        ),
        (
            {"quantity": "aspect", "at_least": 0.3, "cycles_per_px": 0.2},
            "cycles_per_px requires the quantity mtf",
        ),
    ],
)
def test_invalid_frequencies_are_rejected(entries, message):
    with pytest.raises(OmnimirrorError, match=message):
        om.Limit(**entries)


def test_mtf_limits_at_two_frequencies_do_not_conflict():
    fine, coarse = (
        om.Limit("mtf", 0.3, cycles_per_px=0.4),
        om.Limit("mtf", at_least=0.5, cycles_per_px=0.1),
    )
    assert fine.contradicts(coarse) is None
    assert "at least 0.5 and at most 0.3" in replace(fine, cycles_per_px=0.1).contradicts(coarse)


# -- lens and imager -------------------------------------------------------------------------------


@pytest.mark.parametrize("magnification", [0.02, 0.05, (0.02, 0.05)])
def test_catalogue_telecentric_lens_keeps_magnification(magnification):
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=90),
        mirror=om.MirrorRequirements(family="paraboloid", rim_radius_mm=30),
        lens=om.LensRequirements(kind="orthographic", magnification=magnification, f_number=8),
    )
    design = om.design_sensor(requirements)
    mu = design.sensor.lens.magnification
    assert 0.02 <= mu <= 0.05
    assert design.sensor.rim_radius_px == pytest.approx(mu * 30 / 0.0052)
    assert design.is_met


@pytest.mark.full
def test_excessive_magnification_is_reported():
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=90),
        mirror=om.MirrorRequirements(family="paraboloid", rim_radius_mm=30),
        lens=om.LensRequirements(kind="orthographic", magnification=0.2, f_number=8),
    )
    verdict = om.design_sensor(requirements).verdict
    assert verdict.missed == ("image_radius_px",)


def test_freeform_mirror_under_catalogue_telecentric_lens():
    requirements = om.Requirements(
        field=om.FieldRequirements(omega_max_deg=90),
        mirror=om.MirrorRequirements(
            optimise="worst_blur_deg", shape="polynomial:3", rim_radius_mm=(20, 30)
        ),
        lens=om.LensRequirements(kind="orthographic", magnification=0.1, f_number=8),
    )
    design = om.design_sensor(requirements, search=om.SearchOptions(starts=1))
    assert design.is_met
    assert design.sensor.lens.magnification == 0.1
    assert design.sensor.mirror.rim_radius_mm <= 512 * 0.0052 / 0.1 * 1.001


def strip(**lens):
    return om.Requirements(
        field=om.FieldRequirements(omega_max_deg=130),
        mirror=MIRROR,
        lens=om.LensRequirements(focal_length_mm=6, **lens),
        imager=Imager(1920, 1080, 3.0),
    )


def test_long_side_may_be_filled_and_cropped_field_is_reported():
    sensor = om.design_sensor(strip(fills="long-side")).sensor
    assert sensor.rim_radius_px == pytest.approx(960, abs=0.02)
    (message,) = cut_off(sensor)
    v, u = np.mgrid[:1200, :1920]  # the circle, pixel by pixel, on an imager of sufficient height
    inside = np.hypot(u - 959.5, v + 0.5) < 960  # its lower half
    share = 1 - 2 * inside[:540].sum() / (np.pi * 960**2)
    assert float(message.rsplit("; ", 1)[1].split("%")[0]) == pytest.approx(100 * share, abs=0.06)
    edge = om.evaluate(sensor, h_px=[540.0]).omega_deg[0]
    assert f"the field ends at {edge:.4g} deg" in message
    whole = float(message.split("for ")[1].split("%")[0])
    assert whole == pytest.approx(100 * 2 * np.arcsin(540 / 960) / np.pi, abs=0.15)
    assert cut_off(om.design_sensor(strip()).sensor) == ()


def test_small_image_circle_limits_rim():
    sensor = om.design_sensor(strip(image_circle_mm=2.4)).sensor
    assert sensor.rim_radius_px == pytest.approx(400, abs=0.02)


def test_minimum_focus_of_lens_bounds_range():
    requirements = requirements_for(
        "omega_max_deg = 110", lens="focal_length_mm = 6\nfocus_mm = [200, inf]", part=""
    )
    verdict = om.design_sensor(requirements).verdict
    (row,) = (row for row in verdict.rows if row.name == "focus_mm")
    assert row.reached >= 200 - 1e-6
    assert (row.at_least, row.at_most) == (200.0, None)


@pytest.mark.parametrize(
    ("lens", "message"),
    [
        (
            "focal_length_mm = 6\nmagnification = 0.1",
            "lens.magnification requires an orthographic lens",
        ),
        ('kind = "orthographic"\nmagnification = 0', "lens.magnification must be a number"),
        ('focal_length_mm = 6\nfills = "all"', "lens.fills must be one of"),
        ("focal_length_mm = 6\nimage_circle_mm = -1", "lens.image_circle_mm must be .*; got -1"),
    ],
)
def test_invalid_lenses_are_rejected(lens, message):
    with pytest.raises(OmnimirrorError, match=message):
        requirements_for(lens=lens)
