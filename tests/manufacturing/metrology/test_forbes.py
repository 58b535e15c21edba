"""Forbes aspheres: orthogonal slopes, closed forms, and fits of mirrors."""

from __future__ import annotations

import json

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.numerics import qbfs_values
from omnimirror.manufacturing.metrology.forbes import ForbesAsphere, forbes_asphere
from omnimirror.optics.mirrors import Cone, EvenPolynomial, Sphere
from tests.commands import omnimirror

from .clouds import on


def test_qbfs_slopes_are_orthogonal():
    """Integrate over psi, u = sin(psi), by a quadrature that is exact for these sums."""
    psi = (np.arange(400) + 0.5) / 400 * np.pi / 2
    h = 1e-5
    slopes = (qbfs_values(np.sin(psi) + h, 10) - qbfs_values(np.sin(psi) - h, 10)) / (2 * h)
    np.testing.assert_allclose(slopes.T @ slopes / 400, np.eye(10), atol=1e-6)


def test_first_polynomials_match_the_publication():
    x = np.linspace(0.1, 0.9, 9)
    u, front = np.sqrt(x), x * (1 - x)
    printed = [
        1 + 0 * x,
        (13 - 16 * x) / np.sqrt(19),
        np.sqrt(2 / 95) * (29 - 4 * x * (25 - 19 * x)),
        np.sqrt(2 / 2545) * (207 - 4 * x * (315 - x * (577 - 320 * x))),
    ]
    np.testing.assert_allclose(
        qbfs_values(u, 4), front[:, None] * np.stack(printed, axis=1), rtol=1e-9, atol=1e-12
    )


def test_known_terms_are_recovered():
    ball = forbes_asphere(Sphere(50.0, 40.0))
    assert ball.radius_mm == pytest.approx(50.0, rel=1e-12)
    assert np.abs(ball.um).max() < 1e-6
    assert forbes_asphere(Sphere(50.0, 4.0)).radius_mm == pytest.approx(50.0)  # 0.16 mm deep
    asphere = ForbesAsphere(50.0, 40.0, (12.0, -3.0, 0.7), 0.0)
    x = np.linspace(0, 40, 401)
    profile = om.mirrors.SampledProfile(tuple(x), tuple(asphere.sag(x)), uncertainty_um=0.0)
    fit = forbes_asphere(profile)
    assert fit.um[:3] == pytest.approx((12.0, -3.0, 0.7), abs=5e-3)
    assert fit.sag(x) == pytest.approx(asphere.sag(x), abs=1e-5)


def test_a_mirror_that_is_hard_to_describe_has_16_terms():
    """A 1 um ripple of 40 periods remains, with its RMS over the aperture."""
    x = np.linspace(0, 40, 2001)
    ripple = 1e-3 * np.cos(2 * np.pi * x)
    profile = om.mirrors.SampledProfile(
        tuple(x), tuple(Sphere(50.0, 40.0).sag(x) + ripple - ripple[0]), uncertainty_um=0.0
    )
    fit = forbes_asphere(profile)
    assert len(fit.um) == 16
    assert fit.rms_residual_um == pytest.approx(1 / np.sqrt(2), rel=0.1)


def test_terms_end_once_so_little_is_left():
    asphere = ForbesAsphere(50.0, 40.0, (12.0, -3.0, 0.7), 0.0)
    x = np.linspace(0, 40, 2001)
    profile = om.mirrors.SampledProfile(tuple(x), tuple(asphere.sag(x)), uncertainty_um=0.0)
    assert [len(forbes_asphere(profile, left_um).um) for left_um in (1e-2, 0.3, 2.0, 20.0)] == [
        3,
        2,
        1,
        1,
    ]
    exact = forbes_asphere(
        profile, 0.3
    ).rms_residual_um  # a residual equal to the permitted one is sufficient
    assert len(forbes_asphere(profile, exact).um) == 2
    assert len(forbes_asphere(profile).um) == 3  # 1 nm is permitted by default
    # RMS over the meridian of the omitted terms, at equal steps of the angle whose sine is x / M
    u = np.sin((np.arange(4000) + 0.5) / 4000 * np.pi / 2)
    left = forbes_asphere(profile, 0.3)
    departure = asphere.sag(40 * u) - left.sag(40 * u)
    assert left.rms_residual_um == pytest.approx(1e3 * np.sqrt(np.mean(departure**2)), rel=1e-3)


@pytest.mark.parametrize(
    ("mirror", "depth"),
    [
        (Cone(30.0, 20.0), "11.55 mm and a rim radius of 20 mm with a pointed apex"),
        (EvenPolynomial((1.0,), 20.0, 20.0), "20 mm and a rim radius of 20 mm"),
        (EvenPolynomial((-1.0,), 20.0, 20.0), "-20 mm and a rim radius of 20 mm"),
        (EvenPolynomial((1.0, -1.0), 20.0, 20.0), "0 mm and a rim radius of 20 mm"),
    ],
)
def test_unsupported_mirror_is_rejected(mirror, depth):
    """A pointed mirror, and depths of 0 and of the rim radius."""
    with pytest.raises(InvalidParameter, match=f"smooth mirror .*; got a depth of {depth}$"):
        forbes_asphere(mirror)


@pytest.mark.parametrize("depth_mm", [19.9, 0.01, -0.01, -19.9])
def test_radius_of_the_sphere_through_vertex_and_rim(depth_mm):
    fit = forbes_asphere(EvenPolynomial((depth_mm / 20.0,), 20.0, 20.0))
    x = np.array([0.0, 20.0])
    assert fit.sag(x) == pytest.approx([0.0, depth_mm], abs=1e-12)
    assert np.hypot(20.0, depth_mm - fit.radius_mm) == pytest.approx(abs(fit.radius_mm))
    assert forbes_asphere(Sphere(50.0, 49.99999)).radius_mm == pytest.approx(50.0)


def test_command_prints_the_asphere(tmp_path):
    """The sag of the printed asphere is that of the mirror with a symmetric form error."""
    mirror = om.load_sensor("paper-spherical").mirror
    np.savetxt(tmp_path / "cmm.csv", on(mirror, {11: 2.0}, 0.02, count=3000), delimiter=",")
    done = omnimirror(
        "form", "paper-spherical", tmp_path / "cmm.csv", "--json", tmp_path / "form.json"
    )
    assert done.returncode == 0, done.stderr
    assert "Forbes asphere (Qbfs): R = " in done.stdout
    data = json.loads((tmp_path / "form.json").read_text())["forbes_qbfs"]
    asphere = ForbesAsphere(
        data["radius_mm"], data["rim_radius_mm"], tuple(data["um"]), data["rms_residual_um"]
    )
    x = np.linspace(0, mirror.rim_radius_mm, 50)
    u = x / mirror.rim_radius_mm
    error = 2e-3 * np.sqrt(5) * (6 * u**4 - 6 * u**2)  # relative to its own vertex
    assert np.abs(asphere.sag(x) - mirror.sag(x) - error).max() < 1e-4
