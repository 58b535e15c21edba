"""Tubes and domes: against closed forms, Mitsuba, Snell's law and the conservation of light."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import Dome, Housing, Rod, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.tracing.shell_transmission import (
    through_dome,
    through_tube,
    wall_transmission,
)
from omnimirror.optics.tracing.shell_transmission import transmit_from_inside as passage_of
from omnimirror.simulation.pixel_rays import ThroughShell
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment
from tests.everyday import few
from tests.optics.tracing.test_mitsuba import mi  # noqa: F401 - a fixture
from tests.simulation.test_mitsuba_images import ball, compare_images, maps, render_mitsuba, small

UP = np.array([0.0, 0.0, 1.0])


def test_tube_shifts_meridional_rays():
    omega = np.radians([60.0, 90.0, 120.0, 135.0])
    points = np.stack([np.linspace(0, 40, 4), np.zeros(4), np.linspace(0, 10, 4)], axis=-1)
    directions = np.stack([np.sin(omega), np.zeros(4), -np.cos(omega)], axis=-1)
    transmit_from_inside = through_tube(points, directions, 60.0, 3.0, 1.49, 1.0)
    np.testing.assert_allclose(transmit_from_inside.directions, directions, atol=1e-12)
    shift = np.linalg.norm(np.cross(transmit_from_inside.points - points, directions), axis=1)
    i = np.abs(np.pi / 2 - omega)
    inside = np.arcsin(np.sin(i) / 1.49)
    np.testing.assert_allclose(shift, 3.0 / np.cos(inside) * np.sin(i - inside), atol=1e-12)


def test_tube_conserves_skew_invariants():
    """Snell's law at a cylinder conserves the axial component and, by symmetry, the moment about
    the axis."""
    chance = np.random.default_rng(2)
    points, directions = chance.uniform(-30, 30, (50, 3)), chance.normal(size=(50, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    transmit_from_inside = through_tube(points, directions, 60.0, 3.0, 1.49, 1.0)
    np.testing.assert_allclose(transmit_from_inside.directions[:, 2], directions[:, 2], atol=1e-12)
    moments = [
        np.cross(p, d)[:, 2]
        for p, d in (
            (points, directions),
            (transmit_from_inside.points, transmit_from_inside.directions),
        )
    ]
    np.testing.assert_allclose(*moments, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(transmit_from_inside.directions, axis=1), 1, atol=1e-12
    )
    np.testing.assert_allclose(np.hypot(*transmit_from_inside.points.T[:2]), 60.0)
    np.testing.assert_allclose(np.hypot(*transmit_from_inside.met.T[:2]), 57.0)


def test_ghost_radiance_matches_reflectance():
    half = np.zeros((64, 128, 3), np.float32)
    half[:, :64] = 1.0  # bright on the left, y > 0
    inside = ThroughShell(Environment(half), Tube(120.0), om.load_sensor("paper-spherical"))
    radiance = inside.radiance(
        np.full((2, 3), [0, 0, -20.0]), np.array([[0, 1.0, 0], [0, -1.0, 0]])
    )
    transmission = float(wall_transmission(0.0, 1.49))
    np.testing.assert_allclose(
        radiance[:, 0],
        [transmission + (1 - transmission) ** 2 * transmission, (1 - transmission) * transmission],
        atol=1e-6,
    )


@pytest.mark.parametrize("shell", [Tube(120.0), Dome(440.0)], ids=["tube", "dome"])
def test_ghosts_reflect_at_mirror_and_end_at_lids(shell):
    """Horizontal rays from a mirror that images the horizon return to it, and continue down to the
    lens."""
    sensor = om.load_sensor("paper-spherical")
    rays = sensor.backproject(sensor.project_directions([[1.0, 0, 0]]).pixels)
    below = np.zeros((64, 128, 3), np.float32)
    below[-8:] = 1.0  # only the region below the sensor is bright
    if isinstance(shell, Dome):
        shell = replace(
            shell, centre_mm=float(-rays.origins[0] @ sensor.axis)
        )  # horizontal rays pass its centre
    open_radiance, closed = (
        float(
            ThroughShell(Environment(below), shell, sensor, lids).radiance(
                rays.origins, rays.directions
            )[0, 0]
        )
        for lids in ((), (-sensor.mirror_distance_mm,))
    )
    assert open_radiance > 0.02  # it leaves through the wall below the lens, or the open end
    assert closed == 0


def test_axial_rays_and_invalid_origins():
    transmit_from_inside = passage_of(Tube(120.0), np.zeros((1, 3)), UP[None])
    np.testing.assert_array_equal(transmit_from_inside.directions, UP[None])
    assert transmit_from_inside.passed == 1
    world, sensor = Environment(np.ones((4, 8, 3), np.float32)), om.load_sensor("paper-spherical")
    for shell in (Tube(120.0), Dome(120.0, centre_mm=0.0)):
        with pytest.raises(InvalidParameter, match=r"within 57 mm of the (axis|centre)"):
            ThroughShell(world, shell, sensor).radiance(
                np.array([[58.0, 0, 0]]), np.array([[1.0, 0, 0]])
            )


@pytest.mark.parametrize(
    "housing",
    few(
        [
            Housing(rod=Rod(6.0)),
            Housing(rod=Rod(3.0, 16.0)),
            Housing(shell=Tube()),
            Housing(shell=Dome()),
        ],
        Housing(rod=Rod(3.0, 16.0)),
        Housing(shell=Dome()),
    ),
    ids=["rod", "wide rod", "tube", "dome"],
)
def test_rendered_housing_matches_obscured_angles(housing):
    sensor = replace(om.load_sensor("paper-spherical"), housing=housing)
    light = expose(sensor, Environment(np.ones((4, 8, 3), np.float32)), samples=1)
    (ring,) = sensor.obscurations
    dark = int((light[512, :, 0] < 0.5)[512 - 450 : 512 + 450].sum())
    assert dark == pytest.approx(
        2 * sensor.rim_radius_px * np.sqrt(ring.image_percent / 100), abs=2
    )


def test_misaligned_mirror_in_housing():
    for housing in (Housing(shell=Tube()), Housing(shell=Dome()), Housing(rod=Rod())):
        sensor = replace(om.load_sensor("paper-spherical"), housing=housing)
        misaligned = replace(sensor, mirror_pose=MirrorPose(1.0, 0.5, 0.3, 0.5, 0.5))
        assert misaligned.obstructions == sensor.obstructions


# -- domes -------------------------------------------------------------------------------------------


def random_rays(count, half_width):
    chance = np.random.default_rng(3)
    directions = chance.normal(size=(count, 3))
    return chance.uniform(-half_width, half_width, (count, 3)), directions / np.linalg.norm(
        directions, axis=1, keepdims=True
    )


def test_concentric_dome_matches_closed_form():
    a, b, n, centre = 97.0, 100.0, 1.49, np.array([0.0, 0.0, -20.0])
    points, directions = random_rays(200, 30.0)
    transmit_from_inside = through_dome(points, directions, (centre, a), (centre, b), n, 1.0)
    s, left = (
        np.linalg.norm(np.cross(p - centre, d), axis=1)
        for p, d in (
            (points, directions),
            (transmit_from_inside.points, transmit_from_inside.directions),
        )
    )
    deflection = (
        np.arcsin(s / a) - np.arcsin(s / (n * a)) + np.arcsin(s / (n * b)) - np.arcsin(s / b)
    )
    deflections = np.arctan2(
        np.linalg.norm(np.cross(directions, transmit_from_inside.directions), axis=1),
        np.einsum("ni,ni->n", directions, transmit_from_inside.directions),
    )
    np.testing.assert_allclose(left, s, atol=1e-9)
    np.testing.assert_allclose(deflections, deflection, atol=1e-12)
    assert np.degrees(deflection.max()) > 0.3


def test_dome_about_viewpoint_preserves_directions():
    sensor = om.load_sensor("paper-hyperboloidal")
    height = float(om.evaluate(sensor, omega_deg=[90.0]).viewpoint_z_mm[0])
    rays = sensor.backproject(np.random.default_rng(1).uniform(100, 900, (200, 2)))
    rotation = sensor.mount.rotation()
    origins, directions = (
        rays.origins[rays.valid] @ rotation,
        rays.directions[rays.valid] @ rotation,
    )
    transmit_from_inside = passage_of(Dome(160.0, 4.0, centre_mm=height), origins, directions)
    np.testing.assert_allclose(
        transmit_from_inside.directions, directions, atol=2e-6
    )  # to the precision of the file
    np.testing.assert_allclose(transmit_from_inside.passed, wall_transmission(0.0, 1.49), atol=1e-6)


def test_eccentric_dome_matches_mitsuba(mi):  # noqa: F811
    dome = Dome(200.0, 8.0, 1.6, centre_mm=-40.0, inner_shift_mm=4.0)
    points, directions = random_rays(100, 40.0)
    points[:, 2] -= 40.0
    transmit_from_inside = passage_of(dome, points, directions)
    spheres = [
        {"type": "sphere", "radius": 92.0, "center": [0, 0, -36.0], "bsdf": glass(1.0, 1.6)},
        {"type": "sphere", "radius": 100.0, "center": [0, 0, -40.0], "bsdf": glass(1.6, 1.0)},
    ]
    scenes = [mi.load_dict({"type": "scene", "sphere": sphere}) for sphere in spheres]
    for i, (point, towards) in enumerate(zip(points, directions, strict=True)):
        for scene in scenes:
            hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*point), mi.Vector3f(*towards)))
            sample, _ = hit.bsdf().sample(mi.BSDFContext(), hit, 0.9999, [0.5, 0.5])
            point, towards = np.array(hit.p), np.array(hit.to_world(sample.wo))
        np.testing.assert_allclose(transmit_from_inside.points[i], point, atol=1e-3)
        np.testing.assert_allclose(transmit_from_inside.directions[i], towards, atol=2e-5)


def glass(inside, outside):
    return {"type": "dielectric", "int_ior": inside, "ext_ior": outside}


@pytest.mark.full
def test_dome_image_matches_mitsuba(mi):  # noqa: F811
    """Mitsuba's paths include random reflections between two spheres and the mirror."""
    sensor, (texels, mitsuba_texels) = small("paper-spherical", 64, MirrorPose()), maps()
    dome = Dome(236.0, centre_mm=-75.0)
    image = expose(sensor, ThroughShell(Environment(texels), dome, sensor), samples=64, blur=True)
    plain = expose(sensor, Environment(texels), samples=64, blur=True)
    shells = {
        name: {"type": "sphere", "radius": r, "center": [0, 0, -75.0], "bsdf": glass(*indices)}
        for name, r, indices in (("inner", 115.0, (1.0, 1.49)), ("outer", 118.0, (1.49, 1.0)))
    }
    reference = render_mitsuba(mi, sensor, ball(sensor), mitsuba_texels, 2500, shells)
    decibels, shift = compare_images(sensor, image, reference)
    print(f"{decibels:.1f} dB, no sector shifted by more than {shift:.4f} px")
    assert decibels > compare_images(sensor, plain, reference)[0] + 8
    assert decibels > 45
    assert shift < 0.02
