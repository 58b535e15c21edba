"""Chief rays and their inversions against independent numbers and the law of reflection."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimirror.base.errors import (
    InvalidParameter,
    NotOneToOne,
    OutsideField,
    OutsideMirror,
    SelfObstruction,
)
from omnimirror.optics.mirrors import (
    Cone,
    Equidistant,
    EvenPolynomial,
    Hyperboloid,
    Paraboloid,
    Sphere,
)
from omnimirror.optics.tracing.meridian import Meridian, trace_chief_rays
from tests.conftest import MIRRORS
from tests.everyday import few

SPH = Meridian(Sphere(1.138, 43.905 / 43.9), 4.110)
EDI = Meridian(EvenPolynomial((0.6409, 0.1550, -0.01), 1.0), 3.919)
SVP = Meridian(Hyperboloid(0.7407, 1.698, 1.0), 1.698 + np.hypot(0.7407, 1.698))

# computed in 40 digits, independent of this program: mirror point and image height of the point (5,
# 0)
POINTS = [
    (SPH, 0.711503080814949, 383.88447949752),
    (EDI, 0.563824390300682, 320.50888807627),
    (SVP, 0.312424317987686, 198.87492215222),
]


@pytest.mark.parametrize(("meridian", "x", "h"), POINTS, ids=["SPH", "E-DI", "SVP"])
def test_near_point_image_matches_high_precision(meridian, x, h):
    x_image = meridian.x_from_point([5.0], [0.0])
    assert x_image[0] == pytest.approx(x, rel=1e-13)
    theta = meridian.trace(x_image).theta[0]
    assert 500 * np.tan(theta) / np.tan(np.radians(12)) == pytest.approx(h, rel=1e-12)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_law_of_reflection_in_vectors(kind):
    mirror, m = MIRRORS[kind]
    x = np.linspace(0.01, 1, 50) * mirror.rim_radius_mm
    rays = Meridian(mirror, m).trace(x)
    to_lens = np.stack([-x, -(m + rays.z)]) / np.hypot(x, m + rays.z)
    to_object = np.stack([np.sin(rays.omega), -np.cos(rays.omega)])
    normal = np.stack([rays.slope, -np.ones_like(x)]) / np.hypot(rays.slope, 1)
    np.testing.assert_allclose(
        2 * (to_lens * normal).sum(0) * normal - to_lens, to_object, atol=1e-14
    )
    np.testing.assert_allclose((to_object * normal).sum(0), np.cos(rays.gamma), atol=1e-14)


@pytest.mark.parametrize("omega_deg", [0.0, 90.0, 104.0, 120.0, 125.0, 135.0])
@pytest.mark.parametrize("meridian", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_angles_beyond_90_deg(meridian, omega_deg):
    """The ray that leaves the mirror point has that angle, and starts on the front."""
    rays = meridian.trace(meridian.x_from_omega(np.radians([omega_deg])))
    assert np.degrees(rays.omega[0]) == pytest.approx(omega_deg, abs=1e-12)
    assert np.cos(rays.gamma[0]) > 0
    assert 0 <= rays.x[0] <= meridian.mirror.rim_radius_mm


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "cone", "conic-asphere", "sampled"))
@given(fraction=st.floats(0, 1))
def test_inversions_return_mirror_point(kind, fraction):
    mirror, m = MIRRORS[kind]
    meridian, x = Meridian(mirror, m), np.array([fraction * mirror.rim_radius_mm])
    rays = meridian.trace(x)
    scale = 1e-13 * mirror.rim_radius_mm
    if kind != "cone" or fraction > 0.01:  # near the tip of a cone dOmega/dx vanishes from one side
        assert meridian.x_from_omega(rays.omega)[0] == pytest.approx(x[0], abs=20 * scale)
    assert meridian.x_from_tan_theta(x / rays.w)[0] == pytest.approx(x[0], abs=20 * scale)


@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "cone", "conic-asphere", "sampled"))
@given(fraction=st.floats(0.01, 1), distance=st.floats(1e-2, 1e6))
def test_point_on_ray_maps_to_mirror_point(kind, fraction, distance):
    mirror, m = MIRRORS[kind]
    meridian = Meridian(mirror, m)
    rays = meridian.trace([fraction * mirror.rim_radius_mm])
    x_t = rays.x + distance * np.sin(rays.omega)
    z_t = rays.z - distance * np.cos(rays.omega)
    assert meridian.x_from_point(x_t, z_t)[0] == pytest.approx(
        rays.x[0], abs=1e-10 * mirror.rim_radius_mm
    )


@pytest.mark.parametrize("meridian", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_points_behind_mirror_invalid(meridian):
    sag = float(meridian.mirror.sag(0.5))
    shadow = [
        (0.5, 7.0),
        (0.5, sag + 0.01),
        (0.0, 3.0),
        (2.0, 10.0),
        (0.9, 1.2),
        (np.nan, 0.0),
        (5.0, np.inf),
    ]
    assert np.isnan(meridian.x_from_point(*np.transpose(shadow))).all()
    visible = [(0.5, sag - 0.01), (0.0, -2.0), (5.0, 0.0), (3.0, 1.5)]
    assert np.isfinite(meridian.x_from_point(*np.transpose(visible))).all()


def test_points_outside_field_invalid():
    """Just inside and just outside the ray of the rim."""
    rays = SPH.trace([SPH.mirror.rim_radius_mm])
    for turn, is_visible in ((-1e-6, True), (1e-6, False)):
        omega = rays.omega + turn
        x = SPH.x_from_point(rays.x + 9 * np.sin(omega), rays.z - 9 * np.cos(omega))
        assert np.isfinite(x[0]) == is_visible


def test_axial_viewpoint_is_limit():
    m, R = 4.110, 1.138
    assert SPH.trace([0.0]).viewpoint_offset()[0] == pytest.approx(m * R / (2 * m + R), rel=1e-14)
    assert SPH.trace([1e-7]).viewpoint_offset()[0] == pytest.approx(m * R / (2 * m + R), rel=1e-9)
    assert trace_chief_rays(Sphere(2.0, 1.0), np.inf, [0.0]).viewpoint_offset()[0] == 1.0


def test_cone_viewpoints_on_pinhole_ring():
    """The lens reflected in the line z = x tan(beta) is the pinhole of that side."""
    beta, m = np.radians(50.0), 4.0
    rays = Meridian(Cone(50.0, 1.0), m).trace(np.linspace(0.1, 1, 5))
    lens, along = np.array([0.0, -m]), np.array([np.cos(beta), np.sin(beta)])
    ring = 2 * (lens @ along) * along - lens
    np.testing.assert_allclose(ring, [-m * np.sin(2 * beta), m * np.cos(2 * beta)], atol=1e-12)
    # every ray, extended backwards, passes through that image of the lens
    back = np.stack([rays.x - ring[0], rays.z - ring[1]])
    np.testing.assert_allclose(np.arctan2(back[0], -back[1]), rays.omega, atol=1e-12)


# -- error messages --------------------------------------------------------------------------------


def test_outside_field_error_contains_angle_and_field():
    with pytest.raises(
        OutsideField, match=r"omega must be 0 to 135\.00\d* deg, the field; got 140"
    ):
        SPH.x_from_omega(np.radians([10.0, 140.0]))
    with pytest.raises(OutsideField, match=r"omega must be 0 to .* got -1"):
        SPH.x_from_omega(np.radians([-1.0]))
    with pytest.raises(OutsideField, match=r"omega must be 100 to .* got 90"):
        Meridian(Cone(50.0, 1.0), 4.0).x_from_omega(np.radians([90.0]))
    with pytest.raises(OutsideField, match=r"theta must be at most .* got 13"):
        SPH.x_from_tan_theta(np.tan(np.radians([13.0])))
    with pytest.raises(OutsideMirror, match=r"x must be 0 to 1\.0\d* mm, .* got 1\.2"):
        SPH.trace([0.5, 1.2])
    with pytest.raises(OutsideField, match="nan"):
        SPH.x_from_omega([np.nan])


def test_non_monotonic_mapping_rejected():
    wavy = EvenPolynomial((0.7, -0.9, 0.4), 1.0)
    with pytest.raises(NotOneToOne, match=r"less than 0\.\d+ mm, where the field angle"):
        Meridian(wavy, 4.0).omega_max  # noqa: B018
    with pytest.raises(NotOneToOne, match="convex towards the lens"):
        Meridian(EvenPolynomial((-0.3,), 1.0), 4.0).omega_max  # noqa: B018


def test_edge_on_mirror_rejected():
    with pytest.raises(SelfObstruction, match="views the mirror edge-on"):
        Meridian(Sphere(1.0, 0.99), 2.0).omega_max  # noqa: B018
    with pytest.raises(InvalidParameter, match="mirror_distance_mm must be greater than 0; got -1"):
        Meridian(Paraboloid(1.0, 1.0), -1.0).omega_max  # noqa: B018


def test_equidistant_rejects_unreachable_field():
    with pytest.raises(InvalidParameter, match=r"omega_max_deg must be .* got 175"):
        Equidistant(175.0, 12.0, 1.0)
