"""Illumination against Monte Carlo photons, arguments of PSF and MTF, and the neighbourhood of the
apex."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.lenses import Orthographic
from tests.conftest import sensor_of

SPH = om.load_sensor("paper-spherical")


def monte_carlo(sensor, omega_deg, count=60_000):
    """Return irradiance per radiance, sr: uniform directions about a pixel, cosine of those that
    reach glass and mirror.

    The pixel is at -(X, Y, b0) of the lens, upright image point (X, Y); its rays are refracted by a
    thin lens.
    """
    lens, rng = sensor.lens, np.random.default_rng(11)
    height = om.evaluate(sensor, [omega_deg]).h_px[0] * sensor.imager.pitch_mm
    b0, radius = lens.image_distance, lens.aperture_radius
    axis = np.array([height, 0.0, b0]) / np.hypot(height, b0)
    wide = np.arctan(1.05 * radius / b0)  # cone of directions that contains the aperture
    cos, phi = rng.uniform(np.cos(wide), 1.0, count), rng.uniform(0, 2 * np.pi, count)
    sin = np.sqrt(1 - cos**2)
    side = np.cross(axis, [0.0, 1.0, 0.0])
    directions = cos[:, None] * axis + sin[:, None] * (
        np.cos(phi)[:, None] * side + np.sin(phi)[:, None] * [0, 1, 0]
    )
    points = directions[:, :2] * (b0 / directions[:, 2:]) - [height, 0.0]
    is_in_aperture = np.hypot(*points.T) <= radius
    image = np.broadcast_to([height, 0.0], points.shape)
    trace = sensor.optical_train.posed_mirror.trace(
        *sensor.optical_train.rays_of_image(image, points / radius)
    )
    is_valid = is_in_aperture & trace.valid
    return 2 * np.pi * (1 - np.cos(wide)) * np.mean(directions[:, 2] * is_valid), is_valid.sum()


@pytest.mark.parametrize("f_number", [4.0, 2.8, 1.4])
@pytest.mark.parametrize("omega_deg", [0.0, 90.0, 130.0, 135.0])
def test_illumination_matches_traced_photons(f_number, omega_deg):
    """The flat-field formula deviates by 1.4 % at F/4, 11.4 % at F/1.4, and -3.6 % at the very rim."""
    sensor = replace(SPH, lens=replace(SPH.lens, f_number=f_number))
    truth, count = monte_carlo(sensor, omega_deg)
    result = om.illumination(sensor, [omega_deg]).irradiance_sr[0]
    assert result == pytest.approx(truth, rel=0.005 + 2 / np.sqrt(count))


@pytest.mark.parametrize("F", [1.4, 4.0])
def test_axial_illumination_matches_cone(F):
    sensor = replace(SPH, lens=replace(SPH.lens, f_number=F))
    u = np.arctan(1 / (2 * sensor.lens.image_f_number()))
    assert om.illumination(sensor, [0.0]).irradiance_sr[0] == pytest.approx(
        np.pi * np.sin(u) ** 2, rel=1e-9
    )
    telecentric = sensor_of("sphere", "orthographic")
    telecentric = replace(telecentric, lens=Orthographic(telecentric.lens.magnification, F, 20.0))
    result = om.illumination(telecentric, [30.0]).irradiance_sr[0]
    assert result == pytest.approx(np.pi * np.sin(np.arctan(1 / (2 * F))) ** 2, rel=1e-9)


@pytest.mark.parametrize("reflectivity", [0.0, -0.0])
def test_zero_reflectivity_rejected(reflectivity):
    with pytest.raises(InvalidParameter, match="must be greater than 0, up to 1"):
        om.illumination(SPH, [0.0], reflectivity=reflectivity)


def test_strehl_ratio_at_most_one():
    in_focus = om.evaluate(SPH, [0.0]).distance_t_mm[0]
    assert np.isnan(om.psf(SPH, 0.0, focus_mm=in_focus, kind="geometric").strehl)
    sharp = om.psf(SPH, 0.0, focus_mm=in_focus).strehl
    assert 0.99 < sharp <= 1.0
    assert om.psf(SPH, 0.0, focus_mm=in_focus + 5).strehl < sharp


@pytest.mark.parametrize(
    "call",
    [
        lambda: om.spots(SPH, []),
        lambda: om.mtf(SPH, []),
        lambda: om.illumination(SPH, []),
        lambda: om.check_blur(SPH, []),
        lambda: om.spots(SPH, [0.0], azimuth_deg=[]),
        lambda: om.spots(SPH, [0.0], focus_mm=[]),
        lambda: om.spots(SPH, [0.0, 1.0], azimuth_deg=[1.0, 2.0, 3.0]),
        lambda: om.spots(SPH, [[0.0, 1.0]]),
        lambda: om.spots(SPH, [10**400]),
        lambda: om.psf(SPH, [60.0]),
        lambda: om.psf(SPH, 10**400),
        lambda: om.psf(SPH, 0.0, width_px=1e308),
        lambda: om.psf(SPH, 0.0, step_px=1e-300),
        lambda: om.psf(SPH, 0.0, azimuth_deg=float("inf")),
        lambda: om.mtf(SPH, [0.0], cycles_per_px=1e308),
        lambda: om.mtf(SPH, [0.0], cycles_per_px=[]),
        lambda: om.mtf(SPH, [0.0], cycles_per_px=[-0.1]),
        lambda: om.mtf(SPH, [0.0], wavelength_nm=[]),
        lambda: om.mtf(SPH, [0.0], focus_mm=float("nan")),
    ],
)
def test_untraceable_rays_rejected(call):
    names = "omega_deg|azimuth_deg|wavelength_nm|focus_mm|f_numbers|cycles_per_px|step_px"
    with pytest.raises(InvalidParameter, match=names) as error:
        call()
    assert len(str(error.value)) < 250
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "name", ["sampled", "slope-spline", "tabulated-mapping", "sphere", "equidistant"]
)
def test_columns_continuous_at_axis(name):
    """Splines of slopes and angles round at 1e-18, which at 1e-12 deg was 1e-4 of the sagittal
    columns."""
    table = om.evaluate(sensor_of(name), [0.0, 1e-13, 1e-12, 1e-9, 1e-7, 1e-5])
    for column in (
        "width_px_per_deg",
        "aspect",
        "radius_s_mm",
        "q_s_mm",
        "distance_s_mm",
        "viewpoint_z_mm",
        "blur_s_px",
    ):
        values = getattr(table, column)
        np.testing.assert_allclose(values, values[0], rtol=1e-8, err_msg=column)


def test_cone_tip_sagittal_blur_is_infinite():
    cone = sensor_of("cone")
    tip = cone.field_deg[0]
    in_focus = om.evaluate(cone, [tip]).distance_s_mm[0]
    for focus in (in_focus, in_focus + 1, in_focus - 1):
        result = om.evaluate(cone, [tip], focus_mm=focus)
        assert np.isinf(result.blur_s_deg[0])
        for name, column in result.columns().items():
            assert not np.isnan(column).any(), name


@pytest.mark.parametrize("omega_deg", [40.0, 90.0, 130.0])
def test_cover_transmission_follows_fresnel(omega_deg):
    """The angle of incidence on a tube is 90 deg - Omega; in a narrow aperture all rays are the
    chief ray."""
    from omnimirror.optics.housing import Housing, Tube

    narrow = replace(SPH, lens=replace(SPH.lens, f_number=200.0))
    covered = replace(narrow, housing=Housing(shell=Tube(material="acrylic")))
    bare, covered_sr = (om.illumination(s, [omega_deg]).irradiance_sr[0] for s in (narrow, covered))
    n = covered.obstructions.housing.shell.index
    outside = abs(np.radians(90.0 - omega_deg))
    refraction_angle = np.arcsin(np.sin(outside) / n)
    if outside:
        parts = (
            (np.sin(outside - refraction_angle) / np.sin(outside + refraction_angle)) ** 2,
            (np.tan(outside - refraction_angle) / np.tan(outside + refraction_angle)) ** 2,
        )
    else:
        parts = (((n - 1) / (n + 1)) ** 2,) * 2
    assert covered_sr / bare == pytest.approx(np.mean([(1 - r) / (1 + r) for r in parts]), rel=1e-4)
