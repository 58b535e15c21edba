"""Ghost reflections against the components of a rendered image, and in closed form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.simulation.pixel_rays import scene_through_shell

SPH = om.load_sensor("paper-spherical")


class Asked:
    """Black scene that records the requested rays."""

    def __init__(self):
        self.directions = []

    def radiance(self, origins_mm, directions):
        self.directions.append(directions)
        return np.zeros((len(directions), 3), np.float32)


@pytest.mark.parametrize(
    "shell", [Tube(110.0, 4.0), Dome(), Dome(medium="water")], ids=["tube", "dome", "water"]
)
def test_ghosts_match_rendered_images(shell):
    sensor = replace(SPH, housing=Housing(shell=shell))
    omega = np.arange(np.ceil(sensor.clear_field_deg[0]) + 1, 130.0, 3.0)
    found = om.ghosts(sensor, omega)
    assert np.isfinite(found.ghost_omega_deg).any()
    for i, angle in enumerate(omega):
        x = sensor.meridian.x_from_omega(np.radians([angle]))
        rays = sensor.meridian.trace(x)
        inside = np.array([[np.sin(rays.reflected[0]), 0.0, -np.cos(rays.reflected[0])]])
        turn = sensor.mount.rotation()
        scene = Asked()
        scene_through_shell(sensor, scene).radiance(
            np.array([[x[0], 0.0, rays.z[0]]]) @ turn.T, inside @ turn.T
        )
        direct, ghost = scene.directions[0] @ turn, scene.directions[1] @ turn
        assert np.degrees(np.arctan2(direct[0, 0], -direct[0, 2])) == pytest.approx(angle, abs=1e-6)
        assert len(ghost) == np.isfinite(found.ghost_omega_deg[i])
        if len(ghost):
            assert np.degrees(np.arctan2(ghost[0, 0], -ghost[0, 2])) == pytest.approx(
                found.ghost_omega_deg[i], abs=1e-4
            )


def test_tube_reflectance_follows_fresnel():
    """At normal incidence on the wall: ((n - 1)/(n + 1))^2 per side, with the sum of all internal
    reflections."""
    n = 1.5
    side = ((n - 1) / (n + 1)) ** 2
    thrown = 1 - (1 - side) / (1 + side)
    sensor = replace(
        om.load_sensor("paraboloid-telecentric"),
        housing=Housing(shell=Tube(90.0, refractive_index=n)),
    )
    found = om.ghosts(sensor, [89.99])
    assert found.passed_percent[0] == pytest.approx(100 * (1 - thrown), abs=1e-4)
    found = om.ghosts(replace(SPH, housing=Housing(shell=Tube(120.0, refractive_index=n))), [60.0])
    assert found.ghost_omega_deg[0] == pytest.approx(-60.0, abs=1e-9)
    assert found.ghost_percent[0] == pytest.approx(100 - found.passed_percent[0], abs=1e-9)


def test_ghosts_require_wall():
    with pytest.raises(InvalidParameter, match="ghosts require a tube or a dome"):
        om.ghosts(SPH)
