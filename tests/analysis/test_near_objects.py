"""Resolution, angular blur and object length per pixel at a finite object distance, against images
of real points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Sphere
from tests.conftest import sensor_of

SPH = om.load_sensor("paper-spherical")
SMALL = om.Sensor(  # a mirror of 6 mm in a pipe of 20 mm
    Sphere(3.5, 3.0), Perspective(8.0, 4.0, 30.0), SPH.imager, mirror_distance_mm=20.0
)
CASES = {
    "sphere": (SPH, 300.0),
    "small mirror": (SMALL, 7.0),
    "cone": (sensor_of("cone"), 200.0),
    "telecentric": (om.load_sensor("paraboloid-telecentric"), 150.0),
    "two mirrors": (om.load_sensor("folded-hyperboloidal"), 400.0),
    "tube": (replace(SPH, housing=Housing(shell=Tube(material="acrylic"))), 250.0),
    "dome": (replace(SPH, housing=Housing(shell=Dome(250.0, centre_mm=-80.0))), 500.0),
}
STEP = 1e-3  # mm


def object_of(sensor, omega_deg, distance_mm):
    """Return a point in the meridian plane (across, along the sensor axis) at a distance from the
    mirror point along its ray."""
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega_deg])))
    x, z, path_mm = float(rays.x[0]), float(rays.z[0]), distance_mm
    if rays.outside is not None:  # along the ray that leaves the cover, by optical path
        x, z = (float(v[0]) for v in rays.last)
        path_mm = distance_mm - float(rays.outside.inside[0])
    omega = np.radians(omega_deg)
    return np.array([x + path_mm * np.sin(omega), z - path_mm * np.cos(omega)])


def pixel_of(sensor, point, rotation_rad=0.0):
    """Return the image of a point of the meridian plane rotated about the axis."""
    x, y, z = sensor._axes.T  # image right, image down, towards the mirror
    lateral = np.cos(rotation_rad) * x + np.sin(rotation_rad) * y
    (pixel,), (valid,) = sensor.project([point[0] * lateral + point[1] * z])
    assert valid
    return pixel


@pytest.mark.parametrize("case", CASES)
def test_lengths_per_pixel_match_displaced_points(case):
    sensor, distance = CASES[case]
    low, high = sensor.field_deg
    omega = np.linspace(low + 0.15 * (high - low), low + 0.9 * (high - low), 4)
    result = om.evaluate(sensor, omega, object_distance_mm=distance)
    for i, angle in enumerate(omega):
        point = object_of(sensor, angle, distance)

        def px_per_mm(step, point=point):
            pixels = [pixel_of(sensor, point + s * np.array(step)) for s in (-STEP, STEP)]
            return np.linalg.norm(pixels[1] - pixels[0]) / (2 * STEP * np.linalg.norm(step))

        rotation_rad = STEP / point[0]
        azimuthal = np.linalg.norm(
            pixel_of(sensor, point, rotation_rad) - pixel_of(sensor, point, -rotation_rad)
        ) / (2 * STEP)
        assert result.plane_t_mm_per_px[i] == pytest.approx(1 / px_per_mm([1.0, 0.0]), rel=1e-5)
        assert result.cylinder_t_mm_per_px[i] == pytest.approx(1 / px_per_mm([0.0, 1.0]), rel=1e-5)
        assert result.object_s_mm_per_px[i] == pytest.approx(1 / azimuthal, rel=1e-5)
        transverse = np.array([np.cos(np.radians(angle)), np.sin(np.radians(angle))])
        per_deg = distance * np.pi / 180
        assert result.dh_domega_px_per_deg[i] == pytest.approx(
            per_deg * px_per_mm(transverse), rel=1e-5
        )
        assert result.width_px_per_deg[i] == pytest.approx(per_deg * azimuthal, rel=1e-5)


def test_pipe_wall_resolution_matches_points():
    """Wall at 10 mm from the axis: 1 deg is smaller in the image than for a distant object."""
    rays = SMALL.meridian.trace(SMALL.meridian.x_from_omega(np.radians([90.0])))
    distance = 10.0 - float(rays.x[0])
    near, far = (om.evaluate(SMALL, [90.0], object_distance_mm=p) for p in (distance, np.inf))
    assert near.width_px_per_deg[0] == pytest.approx(
        far.width_px_per_deg[0] * distance / 10.0, rel=1e-12
    )
    assert near.object_s_mm_per_px[0] == pytest.approx(10.0 / near.h_px[0], rel=1e-12)


@pytest.mark.parametrize("case", ["sphere", "small mirror"])
def test_angular_blur_is_cone_width_at_object(case):
    """Rays of one pixel through opposite edges of the aperture: their separation at the object,
    over its distance."""
    sensor, distance = CASES[case]
    sensor = replace(sensor, lens=replace(sensor.lens, f_number=60.0))
    omega = 70.0
    result = om.evaluate(sensor, [omega], object_distance_mm=distance)
    pixel = pixel_of(sensor, object_of(sensor, omega, distance))
    chief = sensor.aperture_rays([pixel], [[0.0, 0.0]])
    target = chief.origins[0] + distance * chief.directions[0]
    for pupil, blur in (([1.0, 0.0], result.blur_t_deg[0]), ([0.0, 1.0], result.blur_s_deg[0])):
        rays = sensor.aperture_rays([pixel] * 2, [pupil, [-pupil[0], -pupil[1]]])
        steps = (
            (target - rays.origins) @ chief.directions[0] / (rays.directions @ chief.directions[0])
        )
        points = rays.origins + steps[:, None] * rays.directions
        width = np.degrees(np.linalg.norm(points[0] - points[1]) / distance)
        assert abs(blur) == pytest.approx(width, rel=0.01)


@pytest.mark.parametrize("quantity", ["plane_mm_per_px", "cylinder_mm_per_px"])
def test_requirements_and_comparisons_include_lengths_per_pixel(quantity):
    sensor, distance = CASES["sphere"]
    result = om.evaluate(sensor, np.linspace(40.0, 60.0, 41), object_distance_mm=distance)
    surface = quantity.removesuffix("_mm_per_px")
    worst = np.maximum(getattr(result, f"{surface}_t_mm_per_px"), result.object_s_mm_per_px).max()
    from omnimirror.design.limits import LIMITABLE
    from omnimirror.design.merits import values_of_evaluation

    value, _ = LIMITABLE[quantity].extreme(values_of_evaluation(result), largest=True)
    assert value == pytest.approx(worst, rel=1e-12)
    row = om.compare([sensor], object_distance_mm=distance)[f"min_{quantity}"]
    assert 0 < row.values[0] <= worst
    assert np.isinf(om.compare([sensor])[f"min_{quantity}"].values[0])
