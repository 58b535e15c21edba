"""Comparison with Optiland, with rays launched from the lens (its own field definition ends at 90
deg)."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om

pytestmark = pytest.mark.full
SPH, EDI, SVP = (
    om.load_sensor(f"paper-{n}") for n in ("spherical", "equidistant", "hyperboloidal")
)


@pytest.fixture(scope="module")
def optiland():
    pytest.importorskip("optiland", reason="Optiland is installed by `make test-full` only")
    import matplotlib as mpl

    mpl.use("Agg")
    from optiland import optic, rays

    return optic, rays


def surface_of(sensor):
    """Return the mirror as an Optiland surface."""
    mirror = sensor.mirror
    if mirror.KIND == "even-polynomial":
        N = mirror.normalization_radius_mm
        c = [a * N ** (1 - 2 * i) for i, a in enumerate(mirror.coefficients, start=1)]
        return {"surface_type": "even_asphere", "radius": np.inf, "conic": 0.0, "coefficients": c}
    return {"surface_type": "standard", "radius": mirror.vertex_radius, "conic": mirror.conic}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("sensor", [SPH, EDI, SVP], ids=["SPH", "E-DI", "SVP"])
def test_rays_from_the_lens_leave_the_mirror_at_the_field_angle(sensor, optiland, beside):
    optic, rays = optiland
    system = optic.Optic()
    system.add_surface(index=0, thickness=np.inf)
    system.add_surface(
        index=1, thickness=-100.0, material="mirror", is_stop=True, **surface_of(sensor)
    )
    system.add_surface(index=2)
    system.set_aperture("EPD", 1.0)
    system.set_field_type("angle")
    system.add_field(y=0)
    system.add_wavelength(0.55, is_primary=True)
    result = om.evaluate(sensor, [15.0, 45.0, 89.0, 90.0, 104.0, 120.0, 125.0, 135.0])
    theta = np.radians(result.theta_deg)
    n, zero, one = theta.size, np.zeros(theta.size), np.ones(theta.size)
    z = np.full(n, -sensor.mirror_distance_mm)
    fan = rays.RealRays(zero, zero, z, zero, np.sin(theta), np.cos(theta), one, one * 0.55)
    system.surface_group.surfaces[1].trace(fan)
    np.testing.assert_allclose(fan.y, result.x_mm, rtol=1e-7)
    np.testing.assert_allclose(
        fan.z, result.z_mm, atol=1e-6
    )  # its iteration ends at 1e-6 mm for aspheres
    omega = np.degrees(np.arctan2(np.asarray(fan.M), -np.asarray(fan.N)))
    off = np.abs(omega - result.omega_deg).max()
    beside(
        "Optiland",
        "field angles at which rays from the lens leave the mirror, 15 to 135 deg",
        off,
        1e-6,
        "deg",
    )
