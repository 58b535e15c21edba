"""Families solved for field, viewing angle and rim: Table 1 of the paper, and laws of optics at the
rim."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from omnimirror.base.errors import InvalidParameter
from omnimirror.design import FAMILIES, MAPPINGS, RimRay, generated_mirror
from omnimirror.optics.mirrors import Hyperboloid, Sphere
from omnimirror.optics.tracing.meridian import Meridian

M = 43.9


def test_coefficients_agree_with_table_1_of_paper():
    """Printed parameters, and more digits than printed."""
    rim = RimRay(135.0, 12.0, 1.0)
    sphere, hyperboloid = FAMILIES["sphere"](rim, None), FAMILIES["hyperboloid"](rim, None)
    assert sphere.mirror.radius_mm == pytest.approx(1.138, abs=5e-4)
    assert sphere.distance_mm == pytest.approx(4.110, abs=5e-4)
    assert (hyperboloid.mirror.a_mm, hyperboloid.mirror.b_mm) == pytest.approx(
        (0.7407, 1.698), abs=5e-4
    )
    assert hyperboloid.distance_mm == pytest.approx(3.55007544592, abs=6e-12)
    equidistant = generated_mirror("equidistant", rim)
    assert equidistant.distance_mm == pytest.approx(3.92426760151, abs=6e-12)


@given(
    family=st.sampled_from(sorted(FAMILIES)),
    omega=st.floats(20, 165),
    theta=st.just(0.0) | st.floats(0.5, 50),
    conic=st.floats(-0.95, 5),
)
def test_every_family_meets_rim_requirements(family, omega, theta, conic):
    if not theta + 2 < omega < 178 - theta or (theta == 0 and family in ("cone", "hyperboloid")):
        return
    mounted = FAMILIES[family](RimRay(omega, theta, M), conic if family == "ellipsoid" else None)
    meridian = Meridian(mounted.mirror, mounted.distance_mm)
    assert np.degrees(meridian.omega_max) == pytest.approx(omega, rel=1e-9)
    assert np.degrees(meridian.theta_max) == pytest.approx(theta, abs=1e-9)
    assert mounted.mirror.rim_radius_mm == M


@pytest.mark.parametrize("theta", [12.0, 0.0])
def test_free_conics_are_continuous_at_borders(theta):
    """An ellipsoid with constant 0 is the sphere; for a constant towards -1, both sides become the
    paraboloid."""
    rim, x = RimRay(120.0, theta, M), np.linspace(0, M, 50)
    sphere, paraboloid = FAMILIES["sphere"](rim, None), FAMILIES["paraboloid"](rim, None)
    np.testing.assert_allclose(
        FAMILIES["ellipsoid"](rim, 0.0).mirror.sag(x), sphere.mirror.sag(x), rtol=1e-12
    )
    for family, conic in (("ellipsoid", -1 + 1e-4), ("hyperboloid", -1 - 1e-4)):
        np.testing.assert_allclose(
            FAMILIES[family](rim, conic).mirror.sag(x), paraboloid.mirror.sag(x), rtol=2e-4
        )


def test_free_hyperboloid_has_single_viewpoint():
    mounted = FAMILIES["hyperboloid"](RimRay(110.0, 18.0, M), None)
    rays = Meridian(mounted.mirror, mounted.distance_mm).trace(np.linspace(0.01, 1, 30) * M)
    assert np.ptp(rays.z + rays.viewpoint_offset()) < 1e-10
    assert mounted.distance_mm == pytest.approx(mounted.mirror.single_viewpoint_distance, rel=1e-13)


@pytest.mark.parametrize(
    ("construct", "message"),
    [
        (lambda: RimRay(170.0, 12.0, M), "omega_max_deg must be between 12 and 168 .* got 170"),
        (lambda: RimRay(10.0, 12.0, M), "omega_max_deg must be between .* got 10"),
        (lambda: RimRay(100.0, 12.0, 0.0), "rim_radius_mm must be greater than 0; got 0"),
        (
            lambda: FAMILIES["sphere"](RimRay(135.0, 12.0, M), -0.5),
            "conic must be omitted for a sphere; got -0.5",
        ),
        (
            lambda: FAMILIES["ellipsoid"](RimRay(135.0, 12.0, M), None),
            "an ellipsoid requires conic",
        ),
        (
            lambda: FAMILIES["ellipsoid"](RimRay(135.0, 12.0, M), -1.2),
            "conic of an ellipsoid must be greater than -1; got -1.2",
        ),
        (
            lambda: FAMILIES["hyperboloid"](RimRay(135.0, 12.0, M), -0.2),
            "conic of a hyperboloid must be less than -1; got -0.2",
        ),
        (
            lambda: FAMILIES["hyperboloid"](RimRay(135.0, 12.0, M), -1.9),
            "conic must be greater than -1.29.* got -1.9",
        ),
        (
            lambda: FAMILIES["hyperboloid"](RimRay(135.0, 0.0, M), None),
            "no single viewpoint with an orthographic",
        ),
        (lambda: FAMILIES["cone"](RimRay(135.0, 0.0, M), None), "images a single field angle"),
    ],
)
def test_infeasible_family_parameters_are_rejected(construct, message):
    with pytest.raises(InvalidParameter, match=message):
        construct()


def test_conformal_mirror_is_returned_as_conic():
    assert isinstance(generated_mirror("conformal", RimRay(135.0, 12.0, M)).mirror, Hyperboloid)
    assert generated_mirror("conformal", RimRay(135.0, 0.0, M)).mirror.KIND == "paraboloid"


def test_function_is_accepted_as_mapping():
    rim = RimRay(135.0, 0.0, M)
    mounted = generated_mirror(lambda omega: np.sin(omega / 2), rim)
    sphere = Sphere(M / np.sin(np.radians(67.5)), M)
    x = np.linspace(0, M, 40)
    np.testing.assert_allclose(mounted.mirror.sag(x), sphere.sag(x), rtol=1e-9, atol=1e-12)
    assert np.isinf(mounted.distance_mm)


@pytest.mark.parametrize(
    ("mapping", "entries", "message"),
    [
        ("equidistent", {}, "mapping must be one of equidistant, equiangular.*; got 'equidistent'"),
        ("ground-plane", {}, "the ground-plane mapping requires plane_distance_mm"),
        ("cylinder", {"cylinder_radius_mm": 900.0}, "the cylinder mapping requires omega_min_deg"),
        (
            "equidistant",
            {"plane_distance_mm": 900.0},
            "for the equidistant mapping; it applies to ground",
        ),
        (
            "unit-aspect",
            {"omega_min_deg": 20.0},
            "field starts on the axis; pointed mirrors are possible for equidistant",
        ),
        (
            "tabulated-mapping",
            {"omega_deg": (0.0, 20, 40, 60, 80, 90), "height": (0.0, 1, 2, 3, 4, 5)},
            "last angle of the mapping table, 90 deg",
        ),
    ],
)
def test_incomplete_mapping_is_rejected(mapping, entries, message):
    with pytest.raises(InvalidParameter, match=message):
        generated_mirror(mapping, RimRay(75.0, 12.0, M), **entries)


def test_every_generated_mirror_is_available_as_mapping():
    from omnimirror.optics.mirrors import MIRRORS
    from omnimirror.optics.mirrors.prescribed_mapping import MappingMirror

    assert set(MAPPINGS) == {
        kind for kind, cls in MIRRORS.items() if issubclass(cls, MappingMirror)
    }
