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


class RayRecorder:
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
    result = om.ghosts(sensor, omega)
    assert np.isfinite(result.ghost_omega_deg).any()
    for i, angle in enumerate(omega):
        x = sensor.meridian.x_from_omega(np.radians([angle]))
        rays = sensor.meridian.trace(x)
        direction = np.array([[np.sin(rays.reflected[0]), 0.0, -np.cos(rays.reflected[0])]])
        rotation = sensor.mount.rotation()
        scene = RayRecorder()
        scene_through_shell(sensor, scene).radiance(
            np.array([[x[0], 0.0, rays.z[0]]]) @ rotation.T, direction @ rotation.T
        )
        direct, ghost = scene.directions[0] @ rotation, scene.directions[1] @ rotation
        assert np.degrees(np.arctan2(direct[0, 0], -direct[0, 2])) == pytest.approx(angle, abs=1e-6)
        assert len(ghost) == np.isfinite(result.ghost_omega_deg[i])
        if len(ghost):
            assert np.degrees(np.arctan2(ghost[0, 0], -ghost[0, 2])) == pytest.approx(
                result.ghost_omega_deg[i], abs=1e-4
            )


def test_tube_reflectance_follows_fresnel():
    """At normal incidence on the wall: ((n - 1)/(n + 1))^2 per side, with the sum of all internal
    reflections."""
    n = 1.5
    side = ((n - 1) / (n + 1)) ** 2
    reflected = 1 - (1 - side) / (1 + side)
    sensor = replace(
        om.load_sensor("paraboloid-telecentric"),
        housing=Housing(shell=Tube(90.0, refractive_index=n)),
    )
    result = om.ghosts(sensor, [89.99])
    assert result.passed_percent[0] == pytest.approx(100 * (1 - reflected), abs=1e-4)
    result = om.ghosts(replace(SPH, housing=Housing(shell=Tube(120.0, refractive_index=n))), [60.0])
    assert result.ghost_omega_deg[0] == pytest.approx(-60.0, abs=1e-9)
    assert result.ghost_percent[0] == pytest.approx(100 - result.passed_percent[0], abs=1e-9)


def test_ghosts_require_wall():
    with pytest.raises(InvalidParameter, match="ghosts require a tube or a dome"):
        om.ghosts(SPH)
