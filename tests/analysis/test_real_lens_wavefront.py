"""PSF and MTF of real lenses against coherent sums of waves, traced ray by ray through mirror and
glass."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import RectBivariateSpline
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.lenses import SurfaceLens, TabulatedLens
from omnimirror.optics.mirrors import Flat, Secondary, Sphere
from tests.analysis.test_huygens_mtf import line_mtf
from tests.everyday import few
from tests.optics.lenses import prescriptions as own

A, RIM, M = 50.0, 44.0, 182.0
PITCH = 5.2e-3
WAVE = 587.5618e-6  # mm
NU = np.array([0.1, 0.2, 0.4])


CLEAR_RADII_MM = {1: 1.75, 6: 1.55}  # radii of vignetting surfaces


def sensor_of(folder, clear, key="CLAP", second=None):
    """Return a ball with the triplet and clear apertures, as OpticStudio writes them (CLAP) or as
    fixed semi-diameters (DIAM)."""
    aperture = "  CLAP 0 {} 0" if key == "CLAP" else '  DIAM {} 1 0 0 1 ""'
    path = folder / "triplet.zmx"
    path.write_text(
        own.zmx(per_surface={i: [aperture.format(radius)] for i, radius in clear.items()})
    )
    lens = SurfaceLens.from_file(path, focus_distance_mm=own.FOCUS)
    imager = om.load_sensor("paper-spherical").imager
    return om.Sensor(Sphere(A, RIM), lens, imager, mirror_distance_mm=M, secondary=second)


@pytest.fixture(scope="module")
def sensor(tmp_path_factory):
    return sensor_of(tmp_path_factory.mktemp("lens"), {})


class Rays:
    """Rays of a distant object via ball points through the triplet, with their optical path
    lengths."""

    def __init__(self, omega_deg, points, to_imager):
        """``places`` (n, 2) are ball points across its axis, mm; lens frame with s towards the
        imager."""
        n, omega = own.indices(), np.radians(omega_deg)
        x, y = points.T
        centre = np.array([0.0, 0.0, -M - A])
        p = np.stack([x, y, centre[2] + np.sqrt(A**2 - x**2 - y**2)], axis=-1)
        normal = (p - centre) / A
        d = np.broadcast_to(-np.array([np.sin(omega), 0.0, np.cos(omega)]), p.shape)
        cos = -(d * normal).sum(axis=1)
        self.light = cos / normal[:, 2]  # through an area across the axis
        path = (p * d).sum(axis=1)
        self.incoming, self.met = d, p
        d = d + 2 * cos[:, None] * normal
        self.towards_lens = d
        vertex, self.reach = 0.0, {}
        for i, radius in enumerate(own.RADII):
            to = p - np.array([0.0, 0.0, vertex + radius])
            projection = (to * d).sum(axis=1)
            step = -projection - np.sign(radius) * np.sqrt(
                projection**2 - (to**2).sum(axis=1) + radius**2
            )
            p, path = p + step[:, None] * d, path + n[i] * step
            self.reach[i + 1] = np.hypot(*p[:, :2].T)
            if i + 1 == own.STOP:
                self.stop = p[:, :2]
            normal = (np.array([0.0, 0.0, vertex + radius]) - p) / radius
            projection = (d * normal).sum(axis=1)[:, None]
            transverse = n[i] / n[i + 1] * (d - projection * normal)
            d = transverse + np.sqrt(1 - (transverse**2).sum(axis=1))[:, None] * normal
            vertex += own.GAPS[i] if i < len(own.RADII) - 1 else to_imager
        step = (vertex - p[:, 2]) / d[:, 2]
        self.image, self.cosines, self.path = (p + step[:, None] * d)[:, :2], d[:, :2], path + step


def blocked_by_fold(rays, distance, radius, bore):
    """Return the rays obscured by a flat second mirror and the bore of the ball, in the unfolded
    frame.

    Heights are measured from the vertex of the ball to its back: the lens is at M - 2 distance, the
    second mirror at -distance.
    """

    def distance_at(height, start, direction):
        step = (height - start[:, 2]) / direction[:, 2]
        return np.hypot(*(start + step[:, None] * direction)[:, :2].T)

    flip = np.array([1.0, 1.0, -1.0])
    start, direction = rays.met * flip - [0, 0, M], rays.towards_lens * flip
    lens, edge = M - 2 * distance, A - np.sqrt(A**2 - bore**2)
    blocked = distance_at(-distance, start, direction) > radius
    blocked |= (
        distance_at(np.minimum(start[:, 2], lens), start, direction) < bore
    )  # bore in front of the second mirror
    if lens > edge:  # through the bore after the second mirror
        blocked |= distance_at(-2 * distance - edge, start, direction) > bore
    outgoing = -rays.incoming * flip
    blocked |= (outgoing[:, 2] < 0) & (distance_at(-distance, start, outgoing) < radius)
    return blocked


def bundle(omega_deg, side, reach=1.15):
    """Return rays (side, side) of a grid on the ball wider than the stop, their chief ray, and the
    stop radius."""
    to_imager = own.imager_place(own.indices())
    radius = stop_radius(to_imager)
    omega, step = np.radians(omega_deg), 1e-6

    def height(x):
        """Return the height in a plane within the lens, without the glass."""
        p, d = own.point_of_sphere(omega, 0.0, (x, 0.0), A, M)
        return (p + (2.5 - p[2]) / d[2] * d)[0]

    middle = np.array(
        [brentq(height, *(A * np.sin(omega / 2 - np.radians([10.0, 0.0])))) if omega else 0.0, 0.0]
    )
    for _ in range(20):  # ball point of the stop centre
        three = Rays(omega_deg, middle + np.array([[0, 0], [step, 0], [0, step]]), to_imager).stop
        slopes = ((three[1:] - three[0]) / step).T
        middle = middle - np.linalg.solve(slopes, three[0])
    chief = Rays(omega_deg, middle[None], to_imager)
    assert np.abs(chief.stop).max() < 1e-9
    u = (np.arange(side) + 0.5) / side * 2 - 1
    disc = np.stack(np.meshgrid(u, u, indexing="ij"), axis=-1)
    rays = Rays(
        omega_deg,
        (middle + disc @ (reach * radius * np.linalg.inv(slopes)).T).reshape(-1, 2),
        to_imager,
    )
    assert (np.hypot(*rays.stop.T) <= radius).reshape(side, side)[[0, -1]].sum() == 0
    by_u, by_v = np.gradient(rays.cosines.reshape(side, side, 2), axis=(0, 1))
    rays.solid = np.abs(by_u[..., 0] * by_v[..., 1] - by_u[..., 1] * by_v[..., 0]).ravel()
    # path to the image point of the chief ray
    rays.path = rays.path - chief.path - (rays.cosines * (rays.image - chief.image)).sum(axis=1)
    return rays, chief, radius


def added_waves(omega_deg, side=161, grid=41, width_px=12.0):
    """Return the density (grid, grid) per px^2 about the chief-ray image, a sum of plane waves, one
    for each ray.

    A ray of flux w in a solid angle q has the amplitude sqrt(w/q); the total light is lambda^2
    sum(w).
    """
    rays, chief, radius = bundle(omega_deg, side)
    is_inside = np.hypot(*rays.stop.T) <= radius
    x = np.linspace(-width_px / 2, width_px / 2, grid)
    k = 2 * np.pi / WAVE
    amplitude = np.sqrt(rays.light * rays.solid) * np.exp(1j * k * rays.path)
    # the image is upright: outward in the image is reversed on the imager
    t, s = (
        np.exp(-1j * k * PITCH * np.outer(c - c0, x))
        for c, c0 in zip(rays.cosines.T, chief.cosines[0], strict=True)
    )
    wave = np.einsum("n,nt,ns->st", amplitude[is_inside], t[is_inside], s[is_inside], optimize=True)
    return (
        x,
        np.abs(wave) ** 2 / (WAVE**2 * rays.light[is_inside].sum()) * PITCH**2,
        is_inside.sum(),
    )


def mtf_of_waves(omega_deg, clear, fold=None, nu=NU, side=81, cells=241):
    """Return MTF (2, f) and clear fraction of the stop: rays as functions of direction cosines at
    the imager, on an even grid."""
    rays, _, radius = bundle(omega_deg, side)
    index = np.arange(side)

    def spline(values):
        return RectBivariateSpline(index, index, np.reshape(values, (side, side)))

    L = [spline(c) for c in rays.cosines.T]
    stop = np.hypot(*rays.stop.T) - radius
    edges = [stop, *(rays.reach[surface] - limit for surface, limit in clear.items())]
    near = stop < 0.1 * radius
    limits = [(c[near].min(), c[near].max()) for c in rays.cosines.T]
    axes = [np.linspace(*end, cells) for end in limits]
    targets = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    i, j = (np.full(len(targets), (side - 1) / 2) for _ in range(2))
    for _ in range(6):  # Newton's method: position of the cosines on the ray grid
        residual = np.stack([f.ev(i, j) for f in L], axis=-1) - targets
        a = np.stack([np.stack([f.ev(i, j, 1, 0), f.ev(i, j, 0, 1)], axis=-1) for f in L], axis=1)
        step = np.linalg.solve(a, residual[..., None])[..., 0]
        i, j = np.clip(i - step[:, 0], 0, side - 1), np.clip(j - step[:, 1], 0, side - 1)
    near = np.abs(np.stack([f.ev(i, j) for f in L], axis=-1) - targets).max(axis=1) < 1e-9
    area = np.abs(np.linalg.det(a))
    is_in_stop = near & (spline(stop).ev(i, j) <= 0)
    is_clear = is_in_stop & np.logical_and.reduce([spline(edge).ev(i, j) <= 0 for edge in edges])
    if fold is not None:
        corners = blocked_by_fold(rays, *fold).reshape(side, side)
        is_clear &= ~corners[np.rint(i).astype(int), np.rint(j).astype(int)]
    light = spline(rays.light).ev(i, j) / area
    square = (cells, cells)
    steps = [axis[1] - axis[0] for axis in axes]
    mtf = line_mtf(
        (light * is_clear).reshape(square),
        spline(rays.path).ev(i, j).reshape(square),
        steps,
        nu,
        WAVE,
    )
    return mtf, (light * is_clear).sum() / (light * is_in_stop).sum()


def stop_radius(to_imager):
    """Return the stop intercept of a ray from the axial object point in focus through the edge of
    the entrance pupil."""
    h, focal = 1e-6, 11.6

    def at_stop(height):
        return own.through([0, 0, -own.FOCUS], [height, 0, own.FOCUS], own.indices(), to_imager)[0][
            0
        ]

    # pupil position: rays through the stop centre aim at it
    a, b = (
        own.through([y, 0, 0], [u, 0, 1.0], own.indices(), to_imager)[0][0] / h
        for y, u in ((h, 0.0), (0.0, h))
    )
    pupil = b / a
    return at_stop(focal / own.F_NUMBER / 2 * own.FOCUS / (own.FOCUS + pupil))


@pytest.mark.parametrize("omega", [0.0, 60.0, 110.0])
def test_psf_matches_traced_waves(sensor, omega):
    x, truth, rays = added_waves(omega)
    assert rays > 10000
    result = om.psf(sensor, omega, wavelength_nm=WAVE * 1e6, width_px=12.0, step_px=0.3)
    np.testing.assert_allclose(result.offset_px, x, atol=1e-9)
    np.testing.assert_allclose(result.density, truth, atol=0.005 * truth.max())
    assert truth.max() < 0.7 * result.ideal_peak  # significant aberrations


VIGNETTED = {
    "whole aperture": ({}, "CLAP", None, 120.0),
    "two rims": (CLEAR_RADII_MM, "CLAP", None, 80.0),
    "two rims, off-centre": (CLEAR_RADII_MM, "CLAP", None, 120.0),
    "front": ({1: 1.5}, "DIAM", None, 110.0),
    "back, at the edge": ({6: 1.3}, "DIAM", None, 130.0),
    "within, narrower than the stop": ({3: 1.0}, "DIAM", None, 60.0),
    "behind a bore": ({}, "CLAP", (88.0, 36.0, 2.0), 60.0),
    "behind a bore, vignetted": ({6: 1.3}, "CLAP", (88.0, 36.0, 1.6), 75.0),
    "beside the second mirror": ({1: 1.6}, "DIAM", (88.0, 36.0, 4.0), 48.0),
}


@pytest.mark.parametrize("case", few(VIGNETTED, "two rims, off-centre", "behind a bore, vignetted"))
def test_mtf_of_vignetting_lens_matches_traced_waves(case, tmp_path):
    """Line spread function of waves from the mirror, through bore, glass and clear apertures."""
    clear, key, fold, omega = VIGNETTED[case]
    truth, filled = mtf_of_waves(omega, clear, fold)
    second = None if fold is None else Secondary(Flat(fold[1]), fold[0], fold[2])
    vignetted = sensor_of(tmp_path, clear, key, second)
    result = om.mtf(vignetted, [omega], cycles_per_px=NU, wavelength_nm=WAVE * 1e6, pixel=False)
    np.testing.assert_allclose([result.tangential[0], result.sagittal[0]], truth, atol=0.005)
    assert om.spots(vignetted, [omega]).filled[0] == pytest.approx(filled, abs=0.003)
    assert (filled < 0.999) == (case != "whole aperture")


def test_mtf_is_psf_transform(sensor):
    nu = np.array([0.0, 0.05, 0.1, 0.2, 0.3])
    for omega in (0.0, 90.0):
        spot = om.psf(sensor, omega, width_px=60.0, step_px=0.24)
        result = om.mtf(sensor, [omega], cycles_per_px=nu, pixel=False)
        for axis, mtf in ((0, result.tangential[0]), (1, result.sagittal[0])):
            line = spot.density.sum(axis=axis) * 0.24**2
            transform = np.abs(np.exp(-2j * np.pi * np.outer(nu, spot.offset_px)) @ line)
            np.testing.assert_allclose(transform, mtf, atol=0.02)


# -- tables
# ----------------------------------------------------------------------------------------------------


ANGLES = np.linspace(0, 20, 41)


def tabulated(lens, **columns):
    """Return a lens as a table, ideal except for the given columns."""
    height = lens.principal_distance * np.tan(np.radians(ANGLES))
    return TabulatedLens(
        lens.focal_length_mm,
        lens.f_number,
        lens.focus_distance_mm,
        tuple(ANGLES),
        tuple(height),
        tuple(np.full(len(ANGLES), lens.entrance_pupil_mm)),
        **columns,
    )


@pytest.mark.parametrize("pupil", few([0.0, 6.0], 6.0))
def test_ideal_table_wavefront_matches_thin_lens(pupil):
    sensor = om.load_sensor("paper-spherical")
    sensor = replace(sensor, lens=replace(sensor.lens, entrance_pupil_mm=pupil))
    table = replace(sensor, lens=tabulated(sensor.lens))
    nu = np.linspace(0, 1, 21)
    result, expected = (om.mtf(s, [0.0, 60.0, 120.0], cycles_per_px=nu) for s in (table, sensor))
    np.testing.assert_allclose(result.tangential, expected.tangential, atol=4e-3)
    np.testing.assert_allclose(result.sagittal, expected.sagittal, atol=4e-3)
    spots = [om.psf(s, 120.0, width_px=20.0, step_px=0.5).density for s in (table, sensor)]
    np.testing.assert_allclose(*spots, atol=0.02 * spots[1].max())


def test_curved_field_equals_refocused_lens():
    """An image slightly behind the imager over the whole field."""
    sensor = om.load_sensor("paper-spherical")
    shift_mm = 0.03
    shifts_mm = tuple(np.full(len(ANGLES), shift_mm))
    table = replace(
        sensor,
        lens=tabulated(sensor.lens, field_curvature_t_mm=shifts_mm, field_curvature_s_mm=shifts_mm),
    )
    f = sensor.lens.focal_length_mm
    focus_mm = 1 / (1 / f - 1 / (sensor.lens.image_distance - shift_mm))
    nu = np.linspace(0, 0.6, 13)
    result = om.mtf(table, [30.0, 90.0], cycles_per_px=nu)
    expected = om.mtf(sensor, [30.0, 90.0], cycles_per_px=nu, focus_mm=focus_mm)
    flat = om.mtf(sensor, [30.0, 90.0], cycles_per_px=nu)
    for name in ("tangential", "sagittal"):
        np.testing.assert_allclose(getattr(result, name), getattr(expected, name), atol=0.01)
        assert np.abs(getattr(result, name) - getattr(flat, name)).max() > 0.1


def test_lens_blur_without_wavefront_rejected():
    sensor = om.load_sensor("paper-spherical")
    table = replace(
        sensor, lens=tabulated(sensor.lens, own_blur_t_mm=tuple(np.full(len(ANGLES), 0.01)))
    )
    with pytest.raises(InvalidParameter, match="defines only the size of its blur"):
        om.mtf(table, [60.0])
