"""Covered sensors against Mitsuba 3: its shapes and dielectrics, with transmitted rays traced
individually."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.housing import Dome, Housing, Tube
from tests.optics.tracing.test_mitsuba import lens_rays, mi  # noqa: F401 - a fixture

pytestmark = pytest.mark.full

WITHIN_PX = 0.02
SPH = om.load_sensor("paper-spherical")
SHELLS = {
    "tube": Tube(110.0, 4.0),
    "tube in water": Tube(110.0, 4.0, 1.5, medium_index=1.333),
    "dome": Dome(340.0, 6.0),
    "dome in water": Dome(340.0, 6.0, medium_index=1.333, inner_shift_mm=1.5),
}


def shape(shell, radius, centre_mm, inside, outside):
    glass = {"type": "dielectric", "int_ior": inside, "ext_ior": outside}
    if isinstance(shell, Tube):
        return {
            "type": "cylinder",
            "p0": [0, 0, -2000.0],
            "p1": [0, 0, 2000.0],
            "radius": radius,
            "bsdf": glass,
        }
    return {"type": "sphere", "center": [0, 0, centre_mm], "radius": radius, "bsdf": glass}


def let_through(mi, scene, origin, direction):  # noqa: F811
    hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*direction)))
    assert hit.is_valid()
    sample, _ = hit.bsdf().sample(
        mi.BSDFContext(), hit, 1.0, mi.Point2f(0.5, 0.5)
    )  # 1: transmitted
    assert mi.has_flag(sample.sampled_type, mi.BSDFFlags.DeltaTransmission)
    return np.array(hit.p, dtype=float), np.array(hit.to_world(sample.wo), dtype=float)


@pytest.mark.parametrize("name", SHELLS)
def test_dewarp_coordinates_match_mitsuba(mi, name):  # noqa: F811
    shell = SHELLS[name]
    sensor = replace(SPH, housing=Housing(shell=shell))
    fitted = sensor.obstructions.housing.shell
    inner, outer = fitted.radii_mm
    centres = (0.0, 0.0) if isinstance(shell, Tube) else fitted.centres_mm
    radius = float(sensor.mirror.radius_mm)
    mirror = mi.load_dict(
        {"type": "scene", "s": {"type": "sphere", "center": [0, 0, radius], "radius": radius}}
    )
    sides = [
        mi.load_dict({"type": "scene", "s": shape(shell, inner, centres[0], 1.0, shell.index)}),
        mi.load_dict(
            {"type": "scene", "s": shape(shell, outer, centres[1], shell.index, shell.outer_index)}
        ),
    ]
    random = np.random.default_rng(4)
    reach, turn = np.sqrt(random.uniform(0.15, 0.98, 60)), random.uniform(0, 2 * np.pi, 60)
    pixels = 511.5 + sensor.rim_radius_px * (reach * [np.cos(turn), np.sin(turn)]).T
    pixels = pixels[(np.abs(pixels - 511.5) < 511).all(axis=1)]
    to_world = sensor.mount.rotation()
    errors = []
    for pixel, origin, direction in zip(pixels, *lens_rays(sensor, pixels), strict=True):
        hit = mirror.ray_intersect(mi.Ray3f(mi.Point3f(*origin), mi.Vector3f(*direction)))
        n = np.array(hit.n, dtype=float)
        position, direction_out = np.array(hit.p, dtype=float), direction - 2 * (direction @ n) * n
        for side in sides:
            position, direction_out = let_through(mi, side, position, direction_out)
        projections = [
            sensor.project([to_world @ (position + s * direction_out)]) for s in (40.0, 3000.0)
        ]
        projections.append(sensor.project_directions([to_world @ direction_out]))
        assert all(projection.valid.all() for projection in projections)
        errors += [np.abs(projection.pixels - pixel).max() for projection in projections]
    assert max(errors) < WITHIN_PX
