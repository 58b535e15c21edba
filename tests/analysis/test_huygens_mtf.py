"""MTF of folded and vignetted sensors against a Huygens integral over independently traced rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import omnimirror as om
from omnimirror.optics.housing import CameraBody, Housing
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Flat, Hyperboloid, Secondary, Sphere
from tests.everyday import few

WAVE = 550e-6  # mm
PITCH = 5.2e-3
NU = np.array([0.1, 0.2, 0.4, 0.6])
PUPIL_SAMPLES = 241  # rays across the pupil
MAX_STEP = 1e-11


def conic(mirror):
    """Return curvature and conic constant of a sphere, a hyperboloid or a plane."""
    if isinstance(mirror, Sphere):
        return 1 / mirror.radius_mm, 0.0
    if isinstance(mirror, Hyperboloid):
        a, b = mirror.a_mm, mirror.b_mm
        return b / a**2, -1 - a**2 / b**2
    return 0.0, 0.0


def intersect(c, k, p, d):
    """Return the intersections (n, 3) of rays with z = sag(r) about the origin, and normals, by the
    quadratic equation."""
    a = c * (d[:, 0] ** 2 + d[:, 1] ** 2 + (1 + k) * d[:, 2] ** 2)
    b = c * (p[:, 0] * d[:, 0] + p[:, 1] * d[:, 1] + (1 + k) * p[:, 2] * d[:, 2]) - d[:, 2]
    e = c * (p[:, 0] ** 2 + p[:, 1] ** 2 + (1 + k) * p[:, 2] ** 2) - 2 * p[:, 2]
    root = np.sqrt(b**2 - a * e)
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # the second sheet of a hyperboloid, with inverted normals
        near, far = e / (root - b), (root - b) / a
        is_front = 1 - c * (1 + k) * (p[:, 2] + near * d[:, 2]) > 0
    q = p + np.where(is_front, near, far)[:, None] * d
    n = np.stack([-c * q[:, 0], -c * q[:, 1], 1 - c * (1 + k) * q[:, 2]], axis=-1)
    return q, n / np.linalg.norm(n, axis=1)[:, None]


def bounce(d, n):
    return d - 2 * (d * n).sum(1)[:, None] * n


def out_of(sensor, start, d):
    """Trace rays from the lens at (..., ..., 0), z towards its mirror: path, exit direction,
    obscuration.

    The world z axis points from the vertex of the primary to its back, opposite to the lens of a
    folded sensor.
    """
    m, second = sensor.mirror_distance_mm, sensor.secondary
    path, blocked = np.zeros(len(start)), np.zeros(len(start), bool)
    p = start
    if second is not None:
        to_second = m - second.distance_mm
        q, n = intersect(*conic(second.mirror), p - [0, 0, to_second], d)
        q[:, 2] += to_second
        blocked |= np.hypot(q[:, 0], q[:, 1]) > second.mirror.rim_radius_mm
        path, d2 = np.linalg.norm(q - p, axis=1), bounce(d, n)
        flip = np.array([1.0, 1.0, -1.0])
        lens_z = m - 2 * second.distance_mm  # of the lens above the vertex of the primary
        into_world = lambda a: (a - [0, 0, 0]) * flip + [0, 0, lens_z]  # noqa: E731
        p, q, d0, d = into_world(p), into_world(q), d * flip, d2 * flip
        r = np.hypot
        edge = float(sensor.mirror.sag(np.array(second.bore_radius_mm)))
        if lens_z > edge:
            point = p + ((edge - p[:, 2]) / d0[:, 2])[:, None] * d0
            blocked |= r(point[:, 0], point[:, 1]) > second.bore_radius_mm
        hit, n = intersect(*conic(sensor.mirror), q, d)
        point = q + ((np.minimum(hit[:, 2], lens_z) - q[:, 2]) / d[:, 2])[:, None] * d
        blocked |= r(point[:, 0], point[:, 1]) < second.bore_radius_mm
        rim = second.mirror.rim_radius_mm
        rim_z = -second.distance_mm - float(second.mirror.sag(np.array(rim)))
    else:
        q, d0 = p - [0, 0, m], d
        hit, n = intersect(*conic(sensor.mirror), q, d)
    path = path + np.linalg.norm(hit - q, axis=1)
    outgoing = bounce(d, n)
    blocked |= np.hypot(hit[:, 0], hit[:, 1]) > sensor.mirror.rim_radius_mm
    if second is not None:
        point = hit + ((rim_z - hit[:, 2]) / outgoing[:, 2])[:, None] * outgoing
        blocked |= (outgoing[:, 2] < 0) & (np.hypot(point[:, 0], point[:, 1]) < rim)
    if (camera := sensor.housing.camera) is not None:
        point = hit + ((camera.height_mm - m - hit[:, 2]) / outgoing[:, 2])[:, None] * outgoing
        blocked |= (outgoing[:, 2] < 0) & (
            np.hypot(point[:, 0], point[:, 1]) < camera.diameter_mm / 2
        )
    return path, hit, outgoing, blocked


def pupil_grid(reach=1.0):
    u = (np.arange(PUPIL_SAMPLES) + 0.5) / PUPIL_SAMPLES * 2 - 1
    disc = reach * np.stack(np.meshgrid(u, u, indexing="ij"), axis=-1).reshape(-1, 2)
    return disc, 2 * reach / PUPIL_SAMPLES


def object_directions(hit, target):
    """Return unit vectors (n, 3) from mirror points to an object: a direction, or with a distance a
    point."""
    if isinstance(target, tuple):
        to = target[0] - hit
        return to / np.linalg.norm(to, axis=1)[:, None]
    return np.broadcast_to(target, hit.shape)


def solve_slopes(sensor, points, target, initial_slope):
    """Return slopes (n, 2) of the rays from pupil points (n, 2) that leave towards an object, by
    Newton's method."""
    slopes = np.broadcast_to(initial_slope, points.shape).copy()
    start = np.column_stack([points, np.zeros(len(points))])

    def trace(s):
        d = np.column_stack([s, np.ones(len(s))])
        return out_of(sensor, start, d / np.linalg.norm(d, axis=1)[:, None])

    def residual(s):
        _, hit, outgoing, _ = trace(s)
        return outgoing - object_directions(hit, target)

    h = 1e-6
    for _ in range(30):
        derivatives = [
            (residual(slopes + h * e) - residual(slopes - h * e)) / (2 * h) for e in np.eye(2)
        ]
        a = np.stack(derivatives, axis=-1)
        error = residual(slopes)
        step = np.linalg.solve(
            np.einsum("nij,nik->njk", a, a), np.einsum("nij,ni->nj", a, error)[..., None]
        )[..., 0]
        slopes -= step
        if np.nanmax(np.abs(step)) < MAX_STEP:
            break
    return slopes, trace(slopes)


def flux(points, disc, step):
    """Return the beam cross-section (n,) of a distant object per pupil area, by differences on the
    square grid."""
    p = points.reshape(PUPIL_SAMPLES, PUPIL_SAMPLES, 3)
    by_u, by_v = np.gradient(p, step, axis=(0, 1))
    return by_u.reshape(-1, 3), by_v.reshape(-1, 3)


def line_mtf(light, phase, steps, nu, wave_mm=WAVE):
    """Return |OTF|, tangential and sagittal: sum of waves at image points, line spread function,
    Fourier transform.

    Light and phase (side, side) are given at direction cosines ``steps`` apart at the imager. The
    image points of the discrete transform span one period of the sampled pupil, which conserves the
    light.
    """
    side = len(light)
    wave = np.sqrt(light) * np.exp(2j * np.pi / wave_mm * phase)
    density = np.abs(np.fft.fft2(wave, (2 * side, 2 * side))) ** 2
    mtf = []
    for axis, step in enumerate(steps):
        otf = np.fft.ifft(density.sum(axis=1 - axis))[:side]
        cycles_per_mm = np.arange(side) * step / wave_mm
        mtf.append(np.abs(CubicSpline(cycles_per_mm, otf / otf[0])(nu / PITCH)))
    return np.array(mtf)


def huygens(sensor, omega_deg, nu=NU, distance=np.inf, focus=None):
    """Return the MTF of an ideal thin lens behind mirrors: path to each pupil point minus that from
    the chief-ray focus."""
    lens, omega = sensor.lens, np.radians(omega_deg)
    focus = lens.focus_distance_mm if focus is None else focus
    target = np.array([np.sin(omega), 0.0, -np.cos(omega)])
    radius = lens.focal_length_mm / lens.f_number / 2
    theta = np.linspace(0.001, 0.45, 4000)
    d = np.column_stack([np.sin(theta), 0 * theta, np.cos(theta)])
    with np.errstate(invalid="ignore"):
        deviation = np.linalg.norm(out_of(sensor, np.zeros((len(d), 3)), d)[2] - target, axis=1)
    initial_slope = np.array([np.tan(theta[np.nanargmin(deviation)]), 0.0])
    chief, chief_path = solve_slopes(sensor, np.zeros((1, 2)), target, initial_slope)
    to_object = target if np.isinf(distance) else (chief_path[1][0] + distance * target,)

    def path_of(chief_path):
        path, hit, _, _ = chief_path
        return path + (
            -hit @ target if np.isinf(distance) else np.linalg.norm(to_object[0] - hit, axis=1)
        )

    disc, step = pupil_grid()
    _, pupil_rays = solve_slopes(sensor, radius * disc, to_object, chief[0])
    _, hit, outgoing, blocked = pupil_rays
    assert np.abs(outgoing - object_directions(hit, to_object)).max() < 1e-8
    in_focus = focus * np.array([*chief[0], 1.0])
    start = np.column_stack([radius * disc, np.zeros(len(disc))])
    ideal = np.linalg.norm(start - in_focus, axis=1) - np.linalg.norm(in_focus)
    phase = path_of(pupil_rays) - path_of(chief_path)[0] - ideal
    by_u, by_v = flux(hit, disc, step)
    light = np.abs((np.cross(by_u, by_v) * outgoing).sum(axis=1))
    if np.isfinite(distance):
        light = light / np.linalg.norm(to_object[0] - hit, axis=1) ** 2
    is_clear = (np.hypot(*disc.T) <= 1) & ~blocked
    F = focus * lens.focal_length_mm / (focus - lens.focal_length_mm) / (2 * radius)
    cos = 1 / np.hypot(1.0, chief[0, 0])
    square = (PUPIL_SAMPLES, PUPIL_SAMPLES)
    steps = step * cos**3 / (2 * F), step * cos / (2 * F)
    mtf = line_mtf((light * is_clear).reshape(square), phase.reshape(square), steps, nu)
    return mtf * np.sinc(nu), is_clear.sum() / (np.hypot(*disc.T) <= 1).sum()


def folded(f_number, bore):
    lens, imager = Perspective(14.77, f_number, 170.0), om.load_sensor("paper-spherical").imager
    second = Secondary(Flat(30.0), 75.0, bore)
    return om.Sensor(Sphere(50.0, 40.0), lens, imager, mirror_distance_mm=152.0, secondary=second)


def sensor_at(name, f_number):
    sensor = om.load_sensor(name)
    return replace(sensor, lens=replace(sensor.lens, f_number=f_number))


CASES = {
    "narrow bore": (folded(2.0, 2.0), 50.0),
    "wide bore": (folded(2.0, 5.0), 50.0),
    "middle bore": (folded(2.0, 3.1), 75.0),
    "hyperboloidal": (sensor_at("folded-hyperboloidal", 2.0), 60.0),
    "hyperboloidal, fast": (sensor_at("folded-hyperboloidal", 1.4), 100.0),
    "spherical, fast": (sensor_at("folded-spherical", 1.0), 70.0),
    "spherical, where its field begins": (sensor_at("folded-spherical", 4.0), 13.3),
    "at the rim": (sensor_at("paper-spherical", 4.0), 134.8),
    "past the camera": (
        replace(sensor_at("paper-spherical", 2.8), housing=Housing(CameraBody(60.0))),
        8.5,
    ),
}

NEAR_CASES = {
    "narrow bore": (2.0, 300.0, 175.87),
    "wide bore": (5.0, 300.0, 175.87),
    "nearer": (2.0, 50.0, 176.5),
}


@pytest.mark.parametrize("case", few(NEAR_CASES, "narrow bore"))
def test_near_object_mtf_matches_huygens_integral(case):
    """The bore also vignettes waves of near objects, focused at the tangential image of one."""
    bore, distance, focus = NEAR_CASES[case]
    truth, _ = huygens(folded(2.0, bore), 50.0, distance=distance, focus=focus)
    result = om.mtf(
        folded(2.0, bore), [50.0], cycles_per_px=NU, object_distance_mm=distance, focus_mm=focus
    )
    np.testing.assert_allclose([result.tangential[0], result.sagittal[0]], truth, atol=0.005)


@pytest.mark.parametrize("case", few(CASES, "narrow bore", "hyperboloidal", "past the camera"))
def test_mtf_matches_huygens_integral(case):
    sensor, omega = CASES[case]
    truth, filled = huygens(sensor, omega)
    result = om.mtf(sensor, [omega], cycles_per_px=NU, wavelength_nm=WAVE * 1e6)
    np.testing.assert_allclose([result.tangential[0], result.sagittal[0]], truth, atol=0.005)
    assert om.spots(sensor, [omega]).filled[0] == pytest.approx(filled, abs=0.003)
    if case != "wide bore":
        assert filled < 0.999
