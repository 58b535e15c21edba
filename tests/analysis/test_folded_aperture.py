"""Whole aperture of two-mirror sensors against one mirror, Coddington's equations and real
reflections."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis._wavefront import FITTED, wavefronts
from omnimirror.analysis.ray_bundles import fibonacci, hexapolar, trace_bundles
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.lenses import Orthographic
from omnimirror.optics.tracing.reflection import RayEndpoints
from tests.analysis.test_two_mirrors import FOLDED, SENSORS, UNFOLDED, bounce, intersect
from tests.everyday import few

ANGLES_DEG = [35.0, 60.0, 90.0, 120.0]


@pytest.mark.parametrize("distance", [np.inf, 300.0])
def test_flat_fold_spots_match_single_mirror(distance):
    single, folded = (
        om.spots(
            s, ANGLES_DEG, focus_mm=[205.0, 212.0], object_distance_mm=distance, azimuth_deg=40.0
        )
        for s in (UNFOLDED, FOLDED)
    )
    assert folded.bundles.passes.all()
    for name in ("t_px", "s_px", "weights", "chief_px"):
        np.testing.assert_allclose(
            getattr(folded, name), getattr(single, name), atol=1e-9, err_msg=name
        )
    np.testing.assert_allclose(folded.bundles.path, single.bundles.path, rtol=1e-14)


@pytest.mark.full
def test_flat_fold_mtf_and_psf_match_single_mirror():
    single, folded = (om.mtf(s, ANGLES_DEG[1:]) for s in (UNFOLDED, FOLDED))
    np.testing.assert_allclose(folded.tangential, single.tangential, atol=1e-9)
    np.testing.assert_allclose(folded.sagittal, single.sagittal, atol=1e-9)
    assert om.psf(FOLDED, 60.0).strehl == pytest.approx(om.psf(UNFOLDED, 60.0).strehl, rel=1e-8)


def field_limit_points(sensor):
    """Return the mirror points at the limits of the field."""
    return sensor.meridian.x_min, sensor.mirror.rim_radius_mm


def small(sensor):
    """Return the sensor with an aperture small enough for second-order optics."""
    slower = (
        {"working_f_number": 40.0} if isinstance(sensor.lens, Orthographic) else {"f_number": 40.0}
    )
    return replace(sensor, lens=replace(sensor.lens, **slower))


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("distance", few([np.inf, 400.0], 400.0))
def test_spot_widths_match_coddington_blur(kind, distance):
    sensor = small(SENSORS[kind])
    low, high = sensor.field_deg
    omega = np.linspace(low + 4, high - 2, 6)
    result = om.spots(sensor, omega, pupil=hexapolar(6), object_distance_mm=distance)
    expected = om.evaluate(sensor, omega, object_distance_mm=distance)
    assert result.bundles.passes.all()
    np.testing.assert_allclose(result.chief_px[:, 0], expected.h_px, rtol=1e-12)
    for width, blur in zip(
        result.extent_px(), (expected.blur_t_px, expected.blur_s_px), strict=True
    ):
        np.testing.assert_allclose(width[:, 0], np.abs(blur), atol=2e-3)


@pytest.mark.parametrize("kind", SENSORS)
def test_rays_from_objects_match_rays_from_pixels(kind):
    """Stationary paths from an object through aperture points, and their reverse by reflection at
    the intercepts."""
    sensor = SENSORS[kind]
    low, high = sensor.field_deg
    pupil = fibonacci(30)
    bundles = trace_bundles(sensor, np.linspace(low + 4, high - 4, 4), pupil, azimuth_deg=70.0)
    pixels = bundles.image_mm(sensor) / sensor.imager.pitch_mm
    aperture = np.broadcast_to(pupil.points, pixels.shape)
    origins, directions = sensor.optical_train.rays_of_image(
        bundles.image_mm(sensor).reshape(-1, 2), aperture.reshape(-1, 2)
    )
    traced = sensor.optical_train.posed_mirror.trace(origins, directions)
    is_transmitted = bundles.passes.ravel()
    np.testing.assert_array_equal(traced.valid, is_transmitted)
    assert is_transmitted.mean() > 0.9
    to_targets = np.repeat(bundles.chief.to_targets, 30, axis=0)
    np.testing.assert_allclose(
        traced.directions[is_transmitted], to_targets[is_transmitted], atol=1e-9
    )
    np.testing.assert_allclose(
        traced.points[is_transmitted], bundles.points.reshape(-1, 3)[is_transmitted], atol=1e-7
    )


@pytest.mark.parametrize("kind", ["flat", "concave", "convex", "aspheric", "two-hyperboloids"])
def test_aperture_rays_reflect_twice(kind):
    """Intersection and reflection from the sag only, from aperture points towards the focal plane."""
    sensor = SENSORS[kind]
    second, b0, L0 = sensor.secondary, sensor.lens.image_distance, sensor.lens.focus_distance_mm
    to_secondary = sensor.mirror_distance_mm - second.distance_mm
    vertex = np.array([0.0, 0.0, to_secondary - second.distance_mm])
    rng = np.random.default_rng(5)
    inner, outer = (
        sensor.image_height_px(sensor.meridian.trace(x)) for x in field_limit_points(sensor)
    )
    radius = rng.uniform(inner + 20, min(outer, 511.0) - 20, 5)
    phi = rng.uniform(0, 2 * np.pi, 5)
    pixels = sensor.imager.centre + np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1)
    pupil = rng.uniform(-0.7, 0.7, (5, 2))
    origins, directions, valid = sensor.aperture_rays(pixels, pupil)
    assert valid.all()
    for pixel, pupil_point, origin, direction in zip(
        pixels, pupil, origins, directions, strict=True
    ):
        start = np.array([*(sensor.lens.aperture_radius * pupil_point), 0.0])
        in_focus = np.array(
            [*((pixel - sensor.imager.centre) * sensor.imager.pitch_mm / b0 * L0), L0]
        )
        ray = (in_focus - start) / np.linalg.norm(in_focus - start)
        hit = intersect(
            lambda r: to_secondary + second.mirror.sag(r), start, ray, 1.1 * to_secondary / ray[2]
        )
        ray = bounce(lambda r: to_secondary + second.mirror.sag(r), hit, ray)
        hit = intersect(
            lambda r: vertex[2] - sensor.mirror.sag(r), hit, ray, 1.5 * second.distance_mm / -ray[2]
        )
        ray = bounce(lambda r: vertex[2] - sensor.mirror.sag(r), hit, ray)
        rotation = sensor.mount.rotation()
        np.testing.assert_allclose(rotation @ (hit - vertex), origin, atol=1e-8)
        np.testing.assert_allclose(rotation @ ray, direction, atol=1e-9)


@pytest.mark.parametrize("kind", ["concave", "two-hyperboloids", "telecentric"])
@pytest.mark.parametrize("distant", [True, False])
def test_light_density_follows_footprint(kind, distant):
    """Area covered on the mirror by a small displacement of the pupil point, by central
    differences."""
    sensor, pupil_point, step = SENSORS[kind], np.array([[0.3, -0.5]]), 1e-4
    direction = np.array([[0.6, 0.5, -np.cos(1.0)]])
    target = RayEndpoints.of(direction if distant else 700.0 * direction, distant)
    mirror = sensor.optical_train.posed_mirror

    def mirror_point(pupil):
        return mirror.specular(sensor.optical_train.entrance_pupil_points(pupil), target).points[
            0, :2
        ]

    columns = [
        (mirror_point(pupil_point + step * e) - mirror_point(pupil_point - step * e)) / (2 * step)
        for e in np.eye(2)
    ]
    reflection = mirror.specular(sensor.optical_train.entrance_pupil_points(pupil_point), target)
    area = abs(np.linalg.det(np.stack(columns)))
    section = (
        area
        * float(reflection.normals[0] @ reflection.to_targets[0])
        / abs(reflection.normals[0, 2])
    )
    if not distant:
        section /= float(np.sum((target.xyz - reflection.points) ** 2))
    beam = mirror.beam(
        sensor.optical_train.entrance_pupil_points(pupil_point),
        target,
        reflection,
        sensor.lens.entrance_pupil_motion(pupil_point),
    )
    assert float(beam[0]) == pytest.approx(section, rel=1e-6)


def test_aperture_vignetted_at_field_start():
    """At the edge of the bore, the chief ray and about half of the aperture pass."""
    low, _ = FOLDED.field_deg
    filled = om.spots(FOLDED, [low + 0.01, low + 8.0]).filled
    assert 0.35 < filled[0] < 0.65
    assert filled[1] == pytest.approx(1.0)


def test_wavefront_vignetted_like_rays():
    """At the bore, by the fitted distance from its edge, with a few points on the edge itself."""
    bundles = trace_bundles(FOLDED, [FOLDED.field_deg[0] + 0.4], FITTED)
    (wave,) = wavefronts(bundles, 212.0)
    _, _, light = wave.at(FITTED.points)
    assert wave.is_vignetted
    assert 0.2 < bundles.passes.mean() < 0.98
    assert np.mean((light > 0) != bundles.passes[0]) < 0.01


def test_blurred_image_preserves_brightness():
    room = om.Room(texel_mm=40.0)
    small_image = replace(
        FOLDED, imager=replace(FOLDED.imager, width_px=96, height_px=96, pixel_pitch_um=55.0)
    )
    sharp, blurred = (om.expose(small_image, room, samples=16, blur=blur) for blur in (False, True))
    u, v = np.meshgrid(np.arange(96.0), np.arange(96.0))
    inner, outer = (
        small_image.image_height_px(small_image.meridian.trace(x))
        for x in field_limit_points(small_image)
    )
    radius = np.hypot(u - 47.5, v - 47.5)
    ring = (radius > inner + 4) & (radius < outer - 4)
    assert np.abs(blurred - sharp)[ring].max() > 0.01
    np.testing.assert_allclose(blurred[ring].mean(axis=0), sharp[ring].mean(axis=0), rtol=0.01)


def test_single_mirror_functions_reject_secondary():
    with pytest.raises(
        InvalidParameter, match="illumination requires a sensor without secondary mirror"
    ):
        om.illumination(FOLDED, [60.0])
