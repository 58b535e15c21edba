"""Spots, PSF, MTF and illumination against closed forms, reverse ray tracing, and each other."""

from __future__ import annotations

import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import j0, j1

import omnimirror as om
from omnimirror.analysis import ray_bundles
from omnimirror.analysis._wavefront import FITTED, wavefronts
from omnimirror.analysis.ray_bundles import trace_bundles
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.optics.housing import CameraBody, Housing
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.materials import reflectance
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import MIRRORS, M, sensor_of
from tests.everyday import FEW_MIRRORS, few

SPH, EDI, SVP = (
    om.load_sensor(f"paper-{n}") for n in ("spherical", "equidistant", "hyperboloidal")
)
TELECENTRIC = om.load_sensor("paraboloid-telecentric")
TILTED = replace(SPH, mirror_pose=MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0))
OMEGA = np.arange(0, 131, 10.0)


def in_focus(sensor, omega):
    """Return the distance of the tangential image as focus distance."""
    return float(om.evaluate(sensor, [omega]).distance_t_mm[0])


def diffraction_mtf(cycles_per_mm, wavelength_mm, f_number):
    """Return the textbook MTF of an ideal circular aperture."""
    x = np.clip(cycles_per_mm * wavelength_mm * f_number, 0, 1)
    return 2 / np.pi * (np.arccos(x) - x * np.sqrt(1 - x * x))


# -- pupil quadrature --------------------------------------------------------------------------


@pytest.mark.parametrize(
    "points", [ray_bundles.hexapolar(9), ray_bundles.fibonacci(400), ray_bundles.gaussian(8)]
)
def test_pupil_samplings_fill_disk(points):
    x, y = points.points.T
    r2 = x**2 + y**2
    assert r2.max() <= 1 + 1e-12
    assert points.weights.sum() == pytest.approx(1)
    assert points.weights @ r2 == pytest.approx(1 / 2, abs=0.01)
    assert points.weights @ (x * x - y * y) == pytest.approx(0, abs=0.01)
    assert points.weights @ x == pytest.approx(0, abs=0.01)


@given(st.integers(0, 9), st.integers(0, 9))
def test_gaussian_pupil_integrates_polynomials(i, j):
    from math import gamma

    x, y = ray_bundles.gaussian(10).points.T
    odd = i % 2 or j % 2
    # mean of x^i y^j over the disc
    truth = 0.0 if odd else gamma((i + 1) / 2) * gamma((j + 1) / 2) / gamma((i + j) / 2 + 2) / np.pi
    assert ray_bundles.gaussian(10).weights @ (x**i * y**j) == pytest.approx(truth, abs=1e-14)


# -- rays --------------------------------------------------------------------------------------


@pytest.mark.parametrize("object_distance", [np.inf, 5 * M])
@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_bundles_originate_at_object(kind, object_distance):
    """Each ray, traced in reverse from the imager through the lens and the mirror, reaches its
    object."""
    sensor = replace(sensor_of(kind), mirror_pose=TILTED.mirror_pose)
    low, high = sensor_of(kind).field_deg
    omega = np.linspace(low + 8, high - 8, 4) if high - low > 20 else [(low + high) / 2]
    bundles = trace_bundles(sensor, omega, ray_bundles.hexapolar(3), 25.0, object_distance)
    image = bundles.image_mm(sensor)
    for i in range(len(bundles.omega_deg)):
        hits = sensor.optical_train.posed_mirror.trace(
            *sensor.optical_train.rays_of_image(image[i], bundles.pupil.points)
        )
        np.testing.assert_allclose(hits.points, bundles.points[i], atol=1e-9)
        direction = bundles.chief.to_targets[i]
        if np.isfinite(object_distance):
            target = bundles.chief.points[i] + object_distance * direction
            direction = (target - hits.points) / np.linalg.norm(target - hits.points, axis=1)[
                :, None
            ]
        np.testing.assert_allclose(
            hits.directions, np.broadcast_to(direction, hits.directions.shape), atol=1e-10
        )


@pytest.mark.parametrize("sensor", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
@pytest.mark.parametrize("object_distance", few([np.inf, 5 * M], 5 * M))
def test_real_rays_confirm_blur_formula(sensor, object_distance):
    """Marginal rays agree within 0.002 px; the whole fan differs by 0.008 px near zero blur, and
    for SVP by 0.04 px."""
    result = om.check_blur(
        sensor, [4.0], omega_deg=np.arange(0, 131, 2.5), object_distance_mm=object_distance
    )
    assert result.max_abs("edge_t_px")[0] < 0.002
    assert result.max_abs("edge_s_px")[0] < 0.0025
    assert result.max_abs("extent_t_px")[0] < (0.042 if sensor is SVP else 0.0085)
    assert np.ptp(result.blur_t_px) > 1


def test_blur_formula_error_grows_with_aperture():
    """Coma increases with the square of the aperture, the marginal error (spherical aberration)
    with its cube."""
    result = om.check_blur(SVP, [8.0, 4.0, 2.0, 1.0])
    for name, power in (("extent_t_px", 2), ("edge_t_px", 3)):
        growth = result.max_abs(name)[1:] / result.max_abs(name)[:-1]
        np.testing.assert_allclose(growth, 2.0**power, rtol=0.15)


def test_defocus_spots_are_disks():
    """On the axis, the RMS radius is the blur over 2 sqrt(2), and the encircled energy increases
    with the squared radius."""
    spot = om.spots(SPH, [0.0], focus_mm=[190.0, 230.0], pupil=ray_bundles.fibonacci(4000))
    for j, focus in enumerate(spot.focus_mm):
        blur = abs(om.evaluate(SPH, [0.0], focus_mm=focus).blur_t_px[0])
        assert spot.rms_radius_px()[0, j] == pytest.approx(blur / 8**0.5, rel=2e-3)
        radius = np.array([0.2, 0.5, 0.8, 1.0]) * blur / 2
        np.testing.assert_allclose(
            spot.encircled_energy(radius)[0, j], (2 * radius / blur) ** 2, atol=2e-3
        )


def test_through_focus_spots_match_refocused_sensors():
    through = om.spots(TILTED, [30, 80], focus_mm=[200.0, 220.0], azimuth_deg=70.0)
    for j, focus in enumerate((200.0, 220.0)):
        single = om.spots(
            replace(TILTED, lens=TILTED.lens.focused_at(focus)), [30, 80], azimuth_deg=70.0
        )
        np.testing.assert_allclose(through.t_px[:, j], single.t_px[:, 0], atol=1e-9)
        np.testing.assert_allclose(through.chief_px[:, j], single.chief_px[:, 0], atol=1e-9)


@pytest.mark.parametrize("rings", few([8, 12, 20], 12))
@pytest.mark.parametrize("position", np.linspace(-0.97, 0.97, 9))
def test_open_fraction_of_aperture_equals_area_fraction(rings, position):
    """Straight edges have circular segments; an edge about the centre has the share of its radius squared."""
    disc = ray_bundles.hexapolar(rings)
    radius = np.hypot(*disc.points.T)
    for edge, truth in [
        (
            disc.points @ [0.8, 0.6] - position,
            (np.arccos(position) - position * np.sqrt(1 - position**2)) / np.pi,
        ),
        (radius - abs(position), 1 - position**2),
        (np.where(radius <= 1, position**2 - radius**2, np.inf), position**2),
    ]:
        assert ray_bundles.unvignetted_fraction(disc, [edge], edge >= 0) == pytest.approx(
            truth, abs=0.45 / rings**2
        )


def test_spot_at_rim_is_vignetted():
    spot = om.spots(SPH, [120.0, SPH.field_deg[1] - 1e-9])
    assert spot.filled == pytest.approx([1.0, 0.5], abs=0.01)
    assert spot.weights[1].min() == 0
    np.testing.assert_allclose(spot.weights.sum(axis=1), 1)


def test_light_density_matches_parallel_beam():
    """Equidistant rays across the beam, reflected forwards, are counted in the aperture plane."""
    omega, sensor = 100.0, replace(SVP, lens=replace(SVP.lens, f_number=0.8))
    chief = trace_bundles(sensor, [omega], ray_bundles.hexapolar(1)).chief
    d = chief.to_targets[0]
    e1 = np.cross(d, [0.0, 1.0, 0.0])
    e2 = np.cross(d, e1)
    steps = np.linspace(-3, 3, 501)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    starts = chief.points[0] + 200 * d + offsets @ [e1 / np.linalg.norm(e1), e2]
    hits = sensor.optical_train.posed_mirror.trace(starts, np.broadcast_to(-d, starts.shape))
    t = (-sensor.mirror_distance_mm - hits.points[:, 2]) / hits.directions[:, 2]
    positions = (hits.points + t[:, None] * hits.directions)[:, :2] / sensor.lens.aperture_radius
    positions = positions[hits.valid & (np.hypot(*positions.T) < 1)]
    assert len(positions) > 3000
    # moments of the density over the aperture
    fine = trace_bundles(sensor, [omega], ray_bundles.gaussian(8))
    weights, points = fine.density[0] * fine.pupil.weights, fine.pupil.points
    np.testing.assert_allclose(weights @ points, positions.mean(axis=0), atol=2e-3)
    assert abs(weights @ points[:, 0]) > 0.01  # non-uniform, with a significant effect
    np.testing.assert_allclose(weights @ points**2, (positions**2).mean(axis=0), rtol=5e-3)


# -- waves -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sensor", [SPH, SVP, TELECENTRIC, TILTED], ids=["SPH", "SVP", "telecentric", "tilted"]
)
@pytest.mark.parametrize("object_distance", [np.inf, 300.0])
def test_wavefront_slope_matches_transverse_aberration(sensor, object_distance):
    """Path lengths against ray intercepts, which share no formula: dW/d(rho) = -eps / (2 F)."""
    bundles = trace_bundles(sensor, [0.0, 40.0, 80.0], FITTED, [0.0, 30.0, 200.0], object_distance)
    points, h = 0.9 * ray_bundles.gaussian(5).points, 1e-4
    for wave in wavefronts(bundles, sensor.lens.focus_distance_mm + 6.0):
        _, positions, _ = wave.at(points)
        for axis, step in enumerate(h * np.eye(2)):
            slope = (wave.at(points + step)[0] - wave.at(points - step)[0]) / (2 * h)
            expected = -positions[:, axis] / (2 * wave.f_numbers[axis])
            # the working F-number varies slightly across the aperture
            np.testing.assert_allclose(slope, expected, atol=0.02 * abs(expected).max() + 1e-7)


@pytest.mark.parametrize(
    ("sensor", "omega"),
    few(
        [(SPH, 0.0), (SVP, 0.0), (SVP, 60.0), (SVP, 120.0), (TELECENTRIC, 50.0)],
        (SVP, 60.0),
        (TELECENTRIC, 50.0),
    ),
)
def test_in_focus_mtf_is_diffraction_times_pixel(sensor, omega):
    nu = np.linspace(0, 2.4, 49)
    focus = in_focus(sensor, omega)
    result = om.mtf(sensor, [omega], cycles_per_px=nu, focus_mm=focus)
    focused = sensor.lens.focused_at(focus)
    F, cos = focused.image_f_number(), np.cos(np.radians(om.evaluate(sensor, [omega]).theta_deg[0]))
    for mtf, f_number in ((result.tangential[0], F / cos**3), (result.sagittal[0], F / cos)):
        pitch = sensor.imager.pitch_mm
        truth = diffraction_mtf(nu / pitch, 550e-6, f_number) * np.abs(np.sinc(nu))
        np.testing.assert_allclose(mtf, truth, atol=1e-3)


@pytest.mark.parametrize(("sensor", "omega"), [(SPH, 0.0), (SPH, 60.0), (EDI, 90.0), (SVP, 30.0)])
@pytest.mark.parametrize("defocus", [0.9, 1.1])
def test_geometric_mtf_of_defocus_matches_disk(sensor, omega, defocus):
    nu = np.linspace(1e-6, 1, 51)
    focus = defocus * in_focus(sensor, omega)
    blur = om.evaluate(sensor, [omega], focus_mm=focus)
    result = om.mtf(
        sensor, [omega], cycles_per_px=nu, focus_mm=focus, kind="geometric", pixel=False
    )
    for mtf, diameter in (
        (result.tangential[0], blur.blur_t_px[0]),
        (result.sagittal[0], blur.blur_s_px[0]),
    ):
        z = np.pi * nu * abs(diameter)
        np.testing.assert_allclose(mtf, abs(2 * j1(z) / z), atol=5e-3)


def test_diffraction_converges_to_geometric_mtf():
    coarse = om.mtf(SPH, [100.0], focus_mm=190.0, wavelength_nm=100.0, pixel=False)
    rays = om.mtf(SPH, [100.0], focus_mm=190.0, kind="geometric", pixel=False)
    np.testing.assert_allclose(coarse.sagittal, rays.sagittal, atol=0.06)
    np.testing.assert_allclose(coarse.tangential, rays.tangential, atol=0.06)


@pytest.mark.parametrize(
    ("sensor", "omega", "azimuth"), [(SPH, 100.0, 0.0), (SVP, 135.0, 0.0), (TILTED, 90.0, 50.0)]
)
def test_mtf_is_fourier_transform_of_psf(sensor, omega, azimuth):
    """Two computations from the wave: autocorrelation of the pupil, and PSF; one bundle is
    vignetted by the rim."""
    spot = om.psf(sensor, omega, azimuth_deg=azimuth, width_px=60.0, step_px=0.24)
    nu = np.array([0.0, 0.05, 0.1, 0.2, 0.4])
    result = om.mtf(sensor, [omega], cycles_per_px=nu, azimuth_deg=azimuth, pixel=False)
    step = 0.24**2
    for axis, mtf in ((0, result.tangential[0]), (1, result.sagittal[0])):
        line = spot.density.sum(axis=axis) * step
        transform = abs(np.exp(-2j * np.pi * np.outer(nu, spot.offset_px)) @ line)
        np.testing.assert_allclose(transform, mtf, atol=0.02)
    assert 0.97 < spot.light_within <= 1.001


def test_in_focus_psf_is_airy_disk():
    sensor = replace(SVP, imager=Imager(1024, 1024, 5.2))
    focus = in_focus(sensor, 0.0)
    spot = om.psf(sensor, 0.0, focus_mm=focus, wavelength_nm=633.0)
    f_number = sensor.lens.focused_at(focus).image_f_number()
    r = np.hypot(spot.offset_px, spot.offset_px[:, None]) * 5.2e-3
    z = np.pi * np.maximum(r, 1e-9) / (633e-6 * f_number)
    truth = np.pi / (4 * (633e-6 * f_number) ** 2) * (2 * j1(z) / z) ** 2 * 5.2e-3**2
    np.testing.assert_allclose(spot.density, truth, atol=2e-3 * truth.max())
    assert spot.strehl == pytest.approx(1, abs=1e-3)
    radius = np.array([0.2, 0.5, 1.0, 2.0])
    z = np.pi * radius * 5.2e-3 / (633e-6 * f_number)
    np.testing.assert_allclose(
        spot.encircled_energy(radius), 1 - j0(z) ** 2 - j1(z) ** 2, atol=5e-3
    )


def test_geometric_psf_contains_spot_rays():
    spot = om.spots(EDI, [110.0], pupil=ray_bundles.fibonacci(3000))
    density = om.psf(EDI, 110.0, kind="geometric")
    assert density.light_within == pytest.approx(1, abs=1e-9)
    radius = np.array([0.5, 1.0, 1.5])
    np.testing.assert_allclose(
        density.encircled_energy(radius), spot.encircled_energy(radius)[0, 0], atol=0.02
    )


def test_psf_averaged_over_pixels():
    spot = om.psf(SPH, 60.0)
    step = spot.offset_px[1] - spot.offset_px[0]
    middle = abs(spot.offset_px) <= 0.5
    direct = spot.density[np.ix_(middle, middle)].sum() * step**2
    n = len(spot.offset_px) // 2
    assert spot.on_pixels()[n, n] == pytest.approx(direct, rel=0.1)


def test_frequency_units_and_wavelengths():
    nu = np.array([0.0, 0.25, 0.5])
    blue, red, both = (
        om.mtf(SPH, [90.0], cycles_per_px=nu, wavelength_nm=w)
        for w in (450.0, 650.0, [450.0, 650.0])
    )
    np.testing.assert_allclose(both.line_pairs_per_mm, nu / 0.0052)
    result = om.evaluate(SPH, [90.0])
    np.testing.assert_allclose(
        both.cycles_per_deg_t[0], nu * result.dh_domega_px_per_deg[0], rtol=1e-7
    )
    np.testing.assert_allclose(both.cycles_per_deg_s[0], nu * result.width_px_per_deg[0], rtol=1e-7)
    assert red.tangential[0, 2] < both.tangential[0, 2] < blue.tangential[0, 2]


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), *FEW_MIRRORS, "equidistant"))
def test_mtf_of_all_mirrors_and_poses(kind):
    sensor = sensor_of(kind)
    low, high = sensor.field_deg
    omega = [0.4 * low + 0.6 * high]
    aligned = om.mtf(sensor, omega, cycles_per_px=[0.0, 0.1, 0.3])
    misaligned = om.mtf(
        replace(sensor, mirror_pose=MirrorPose(0.5, 0.2, 0.1, 0.3, -0.4)),
        omega,
        cycles_per_px=[0.0, 0.1, 0.3],
    )
    for result in (aligned, misaligned):
        np.testing.assert_allclose(result.tangential[0, 0], 1, atol=1e-9)
        assert (np.diff(result.sagittal) < 0.02).all()
    assert abs(aligned.tangential - misaligned.tangential).max() < 0.5


# -- illumination ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "sensor", [SPH, EDI, SVP, TELECENTRIC], ids=["SPH", "E-DI", "SVP", "telecentric"]
)
def test_illumination_matches_formula(sensor):
    """Textbook formula, valid for a narrow aperture."""
    narrow = {"working_f_number" if sensor.lens.TELECENTRIC else "f_number": 60.0}
    sensor = replace(sensor, lens=replace(sensor.lens, **narrow))
    omega = np.arange(0, sensor.field_deg[1] - 1, 15.0)
    result = om.evaluate(sensor, omega)
    illumination = om.illumination(sensor, omega, reflectivity="aluminium", transmission=0.8)
    R = reflectance(np.radians(result.gamma_deg), 0.96 + 6.69j)
    cos = np.cos(np.radians(result.theta_deg))
    np.testing.assert_allclose(
        illumination.irradiance_sr,
        np.pi * 0.8 * R * cos**4 / (4 * sensor.lens.image_f_number() ** 2),
        rtol=2e-4,
    )
    np.testing.assert_allclose(illumination.filled, 1)
    assert illumination.relative[0] == pytest.approx(1, rel=1e-4)


def test_half_illumination_at_rim():
    result = om.illumination(SPH, [SPH.field_deg[1] - 1e-9])
    assert result.filled[0] == pytest.approx(0.5, abs=0.03)


def test_metal_reflectance_follows_fresnel():
    """Closed form at normal incidence, total reflection at grazing incidence, and Brewster's angle
    of a dielectric."""
    n = 0.96 + 6.69j
    assert reflectance([0.0], n)[0] == pytest.approx(abs((1 - n) / (1 + n)) ** 2)
    assert reflectance([np.pi / 2 - 1e-6], n)[0] == pytest.approx(1, abs=1e-4)
    s_only = reflectance([np.arctan(1.5)], 1.5 + 0j)[0]
    assert s_only == pytest.approx(((1 - 1.5**2) / (1 + 1.5**2)) ** 2 / 2)


# -- invalid arguments -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("call", "error", "message"),
    [
        (
            lambda: om.spots(SPH, [140.0]),
            OutsideField,
            "omega = 140 deg at azimuth 0 deg must be in the field of 'paper-spher",
        ),
        (
            lambda: om.spots(SPH, [10.0], object_distance_mm=-1.0),
            InvalidParameter,
            "object_distance_mm must be at least 1e-09 mm, or inf; got -1",
        ),
        (
            lambda: om.spots(SPH, [10.0], focus_mm=[5.0]),
            InvalidParameter,
            "focus_distance_mm must be greater than",
        ),
        (lambda: om.spots(TILTED), InvalidParameter, "got a decentred, tilted or deformed one"),
        (
            lambda: om.mtf(SPH, [10.0], kind="both"),
            InvalidParameter,
            "kind must be one of diffraction, geometric; got 'both'",
        ),
        (
            lambda: om.mtf(SPH, [10.0], cycles_per_px=[-0.1]),
            InvalidParameter,
            r"cycles_per_px\[0\] must be between 0 and 1e\+06; got -0\.1",
        ),
        (
            lambda: om.mtf(SPH, [10.0], wavelength_nm=5.0),
            InvalidParameter,
            "wavelength_nm must be 100 to 20000 nm; got 5",
        ),
        (
            lambda: om.mtf(SPH, [10.0], wavelength_nm=[500, 600], weights=[1]),
            InvalidParameter,
            "weights must have one value for each of the 2",
        ),
        (
            lambda: om.psf(SPH, 10.0, width_px=-3.0),
            InvalidParameter,
            r"width_px must be greater than 0 px and finite; got -3\.0",
        ),
        (lambda: om.psf(SPH, 10.0, width_px=1e5), InvalidParameter, "step_px must be at least 50"),
        (
            lambda: om.illumination(SPH, [10.0], reflectivity="tin"),
            InvalidParameter,
            "must be one of .* got 'tin'",
        ),
        (lambda: om.illumination(SPH, [10.0], reflectivity=1.2), InvalidParameter, "got 1.2"),
        (
            lambda: om.illumination(SPH, [10.0], transmission=0.0),
            InvalidParameter,
            "transmission must be greater than 0",
        ),
        (
            lambda: ray_bundles.hexapolar(0),
            InvalidParameter,
            "rings must be an integer from 1 .* got 0",
        ),
    ],
)
def test_invalid_aperture_arguments_rejected(call, error, message):
    with pytest.raises(error, match=message):
        call()


def test_obscured_object_rejected():
    sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = om.spots(sensor, [2.0, 60.0], focus_mm=[200.0, 212.0])
        records = result.records()
        for kind in ("diffraction", "geometric"):
            transfer = om.mtf(sensor, [2.0, 60.0], cycles_per_px=[0.0, 0.2], kind=kind)
            assert not transfer.tangential[0].any()
            assert transfer.tangential[1, 0] == pytest.approx(1.0)
            with pytest.raises(OutsideField, match="must not be obscured"):
                om.psf(sensor, 2.0, kind=kind)
    assert result.filled.tolist() == [0.0, pytest.approx(1.0)]
    np.testing.assert_array_equal(result.weights[0], 0.0)
    assert result.weights[1].sum() == pytest.approx(1.0)
    for values in (
        *result.extent_px(),
        *result.rms_px(),
        *result.centroid_px(),
        result.encircled_energy([100.0])[..., 0],
    ):
        np.testing.assert_array_equal(values[0], 0.0)
    assert all(np.isfinite(list(record.values())).all() for record in records)
