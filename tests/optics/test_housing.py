"""Obscurations of a housing: equal angles in drawing, image, ground truth, evaluation and verdict."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.design.evaluated_field import counted_field
from omnimirror.manufacturing.body import parts_of, with_housing
from omnimirror.optics.housing import CameraBody, Dome, Envelope, FlatWindow, Housing, Rod, Tube
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors.as_built import MirrorPose
from omnimirror.simulation.pixel_rays import trace_pixels
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment

SPH = om.load_sensor("paper-spherical")
TELECENTRIC = om.load_sensor("paraboloid-telecentric")
CASES = {
    "camera": replace(SPH, housing=Housing(CameraBody(60.0, height_mm=4.0))),
    "rod": replace(SPH, housing=Housing(rod=Rod(6.0, 2.0, gap_mm=45.0))),
    "tube": replace(SPH, housing=Housing(shell=Tube(130.0))),
    "dome": replace(SPH, housing=Housing(shell=Dome())),
    "all": replace(SPH, housing=Housing(CameraBody(40.0), Rod(3.0), Tube(130.0))),
    "telecentric rod": replace(TELECENTRIC, housing=Housing(rod=Rod(5.0))),
    "telecentric tube": replace(TELECENTRIC, housing=Housing(shell=Tube(90.0))),
}
EDGE_DEG = 0.01
WIDTH = 61


WALLS = {
    "diameter_mm": (1e-3, 1e5), "wall_mm": (1e-3, 1e3), "refractive_index": (1.0, 4.0), "medium_index": (1.0, 4.0),
    "decentre_x_mm": (-1e4, 1e4), "decentre_y_mm": (-1e4, 1e4), "tilt_x_deg": (-45.0, 45.0),
    "tilt_y_deg": (-45.0, 45.0), "centre_mm": (-1e5, 1e5), "inner_shift_mm": (-1e3, 1e3), "height_mm": (-1e5, 1e5),
}  # fmt: skip


@pytest.mark.parametrize("name", WALLS)
def test_cover_sizes_out_of_bounds_rejected(name):
    kind = {"centre_mm": Dome, "inner_shift_mm": Dome, "height_mm": FlatWindow}.get(name, Tube)
    low, high = WALLS[name]
    for value in (low - 1e-4, high + 0.1):
        with pytest.raises(
            InvalidParameter, match=re.escape(f"must be between {low:g} and {high:g}")
        ):
            kind(**{name: value})


def test_cover_default_sizes():
    """Minimum diameters by Pythagoras, from the back of the mirror; default diameters have a
    clearance of 3 mm, rounded up to 1 mm."""
    envelope = Envelope(-180.0, -180.0, 20.0, 45.0)
    tube, dome = Tube(wall_mm=4.0), Dome(wall_mm=4.0, centre_mm=-50.0)
    assert tube.diameters(45.0) == (98.0, 104.0)
    assert dome.diameters(-180.0, 20.0, 45.0)[0] == pytest.approx(
        2 * (np.hypot(45.0, 70.0) + 4.0), rel=1e-12
    )
    assert dome.diameters(-180.0, 20.0, 45.0)[1] == np.ceil(2 * (np.hypot(48.0, 130.0) + 4.0))
    for shell, least in ((tube, 98.0), (dome, 2 * (np.hypot(45.0, 70.0) + 4.0))):
        with pytest.raises(InvalidParameter, match=f"diameter_mm .* must be at least {least:.4g}"):
            replace(shell, diameter_mm=least - 0.01).fitted(envelope)
    assert replace(tube, diameter_mm=98.0).fitted(envelope).diameter_mm == 98.0
    with pytest.raises(
        InvalidParameter, match=r"greater than 268 mm, to reach the plane of the lens at -180 mm"
    ):
        replace(dome, diameter_mm=268.0).fitted(envelope)


@pytest.mark.parametrize("shift", [0.0, 2.0])
def test_dome_inner_radius(shift):
    dome = Dome(200.0, 5.0, centre_mm=-40.0, inner_shift_mm=shift)
    for height in (-100.0, -40.0, 0.0, 30.0):
        assert dome.inner_radius_mm(height) == pytest.approx(
            np.sqrt(95.0**2 - (height + 40.0 - shift) ** 2), rel=1e-12
        )
    assert dome.inner_radius_mm(80.0) == 0.0


@pytest.fixture(params=CASES)
def sensor(request):
    return CASES[request.param]


def test_obscured_angles_consistent(sensor):
    low, high = sensor.clear_field_deg
    assert (low, high) != sensor.field_deg
    assert with_housing(parts_of(sensor)).clear_field_deg == pytest.approx((low, high), abs=1e-9)
    assert om.evaluate(sensor, [90.0]).summary()["clear_field_deg"] == [low, high]
    counted = counted_field(om.FieldRequirements(omega_max_deg=100.0), sensor)
    assert (counted.hidden_deg, counted.hidden_from_deg) == (low, high)


def magnified(sensor, omega_deg):
    """Return the sensor with a row of pixels of 0.002 deg, centred at a field angle."""
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega_deg])))
    height, rate = sensor.image_height_px(rays)[0], np.radians(sensor.image_height_rate_px(rays)[0])
    pitch = sensor.imager.pixel_pitch_um * rate * 0.002
    centre = WIDTH // 2 - height * sensor.imager.pixel_pitch_um / pitch, 0.0
    return replace(sensor, imager=Imager(WIDTH, 1, pitch, centre))


def test_image_dark_at_obscured_angles(sensor):
    """Agreement to 0.01 deg, in the compiled kernels and in the ground truth."""
    white, edges = (
        Environment(np.ones((4, 8, 3), np.float32)),
        set(sensor.clear_field_deg) - set(sensor.field_deg),
    )
    for edge in edges:
        near = magnified(sensor, edge)
        light = (
            expose(near, white, samples=1, radiometry=Radiometry(housing_light=0.0))[0, :, 0] > 0.3
        )
        dark_first = edge == sensor.clear_field_deg[0]
        hidden = trace_pixels(near, np.stack([np.arange(WIDTH), np.zeros(WIDTH)], axis=-1)).hidden
        for dark in (~light, hidden):
            assert dark[0] == dark_first
            (at,) = np.flatnonzero(np.diff(dark.astype(int)))
            assert abs(at + 0.5 - WIDTH // 2) * 0.002 < EDGE_DEG


@pytest.mark.parametrize("name", ["camera", "rod", "rod in mirror", "tube", "dome", "all"])
def test_misaligned_image_dark_at_obscured_pixels(name):
    rod = replace(SPH, housing=Housing(rod=Rod(0.5, 16.0, gap_mm=160.0)))
    sensor = replace(CASES.get(name, rod), mirror_pose=MirrorPose(1.5, -1.0, 0.7, 0.4, -0.6))
    if (
        name == "rod in mirror"
    ):  # the vertex is inside the rod end, from which rays pass the rest of it
        sensor = replace(sensor, mirror_pose=replace(sensor.mirror_pose, displacement_mm=-0.7))
    sensor = replace(sensor, imager=Imager(200, 200, 5.2 * 1024 / 200))
    pixels = (
        np.stack(np.meshgrid(np.arange(200), np.arange(200)), axis=-1).reshape(-1, 2).astype(float)
    )
    hidden = np.any([*sensor.hidden_by(pixels).values()], axis=0)
    np.testing.assert_array_equal(trace_pixels(sensor, pixels).hidden, hidden)
    light = expose(
        sensor,
        Environment(np.ones((4, 8, 3), np.float32)),
        samples=1,
        radiometry=Radiometry(housing_light=0.0),
    )
    sees = sensor.backproject(pixels).valid
    dark = light[..., 0].ravel() < 0.3
    assert hidden.sum() > 100
    assert (dark[sees] != hidden[sees]).sum() <= 2, "single precision, at edges"


@pytest.mark.parametrize("shell", [Tube(), Dome(), FlatWindow()])
def test_wall_defaults(shell):
    assert (shell.wall_mm, shell.outer_index) == (3.0, 1.0)
    assert shell.material is None
