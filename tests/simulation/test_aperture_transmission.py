"""Light through the aperture: rendered, and by the common description of obstructions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.analysis.ray_bundles import fibonacci
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.lenses import Perspective, SurfaceLens
from omnimirror.optics.mirrors import Flat, Secondary, Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation import rendering
from omnimirror.simulation._compiled_rendering import is_for_kernels
from omnimirror.simulation.pixel_rays import intersects_lid, sample_positions, sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from tests.optics.lenses import prescriptions as own

SIDE = 96
SHARE = fibonacci(4000)


def coarse(sensor):
    """Return the sensor with few, large pixels."""
    imager = sensor.imager
    pitch = imager.pixel_pitch_um * imager.width_px / SIDE
    return replace(
        sensor, imager=replace(imager, width_px=SIDE, height_px=SIDE, pixel_pitch_um=pitch)
    )


def housed(housing, f_number=1.4, pose=None):
    sensor = om.load_sensor("paper-spherical")
    lens = replace(sensor.lens, f_number=f_number)
    return replace(sensor, lens=lens, housing=housing, mirror_pose=pose or MirrorPose())


def folded(bore):
    lens, imager = Perspective(14.77, 2.0, 170.0), om.load_sensor("paper-spherical").imager
    second = Secondary(Flat(30.0), 75.0, bore)
    return om.Sensor(Sphere(50.0, 40.0), lens, imager, mirror_distance_mm=152.0, secondary=second)


def glass(folder):
    path = folder / "triplet.zmx"
    path.write_text(own.zmx(per_surface={1: ["  CLAP 0 1.6 0"]}))
    lens = SurfaceLens.from_file(path, focus_distance_mm=own.FOCUS)
    imager = om.load_sensor("paper-spherical").imager
    return om.Sensor(Sphere(50.0, 44.0), lens, imager, mirror_distance_mm=182.0)


HOUSINGS = {
    "nothing but the mirror's edge": Housing(),
    "camera": Housing(CameraBody(60.0)),
    "rod": Housing(CameraBody(30.0), Rod(8.0, end_diameter_mm=4.0)),
    "rim": Housing(rim=Rim(12.0)),
    "rim, set back": Housing(rim=Rim(30.0, 4.0)),
    "lids of a tube": Housing(CameraBody(60.0), shell=Tube(120.0, refractive_index=1.001)),
    "base of a dome": Housing(CameraBody(60.0), shell=Dome(300.0, refractive_index=1.001)),
}
MISALIGNED = MirrorPose(
    decentre_x_mm=2.0, decentre_y_mm=1.0, tilt_x_deg=1.0, tilt_y_deg=-0.5, displacement_mm=1.0
)


def transmitted(sensor, plan, rows, columns, tracer):
    """Return the fraction of rays transmitted to pixels, from an image of a white world with black
    parts."""
    bundle = tracer(sensor, plan, Radiometry(), rows, columns)
    transmits = (bundle.outcome == rendering.REFLECTED).ravel()
    if (shell := sensor.obstructions.housing.shell) is not None:  # lids are part of the scene
        rotation = sensor.mount.rotation()
        rays = (
            v.reshape(-1, 3).astype(float) @ rotation.T for v in (bundle.origins, bundle.directions)
        )
        lids = tuple(lid.height_mm for lid in sensor.obstructions.lids)
        transmits &= ~intersects_lid(shell, lids, *rays)
    return transmits


@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize("part", HOUSINGS)
@pytest.mark.parametrize("blur", [True, False])
def test_rendering_matches_clearances(part, pose, blur):
    sensor, plan = coarse(housed(HOUSINGS[part], pose=pose)), sampling_plan(4, blur, 3)
    whole = slice(0, SIDE)
    pixels, pupil = sample_positions(plan, *np.meshgrid(np.arange(SIDE), np.arange(SIDE)))
    start, towards = sensor.lens_rays(pixels.reshape(-1, 2), pupil.reshape(-1, 2) * plan.blur)
    train = sensor.optical_train
    expected = train.passes(start, towards, train.posed_mirror.trace(start, towards))
    assert 0.2 < expected.mean() < 0.9
    tracers = [rendering._trace_sensor] + [rendering._trace_natively] * is_for_kernels(sensor)
    for tracer in tracers:
        transmits = transmitted(sensor, plan, whole, whole, tracer)
        assert np.mean(transmits != expected) < 1e-4  # single precision, at edges


SENSORS = {
    **{part: lambda _, part=part: housed(HOUSINGS[part]) for part in HOUSINGS},
    "narrow bore": lambda _: folded(2.0),
    "bore, where the field begins": lambda _: folded(3.1),
    "lens surface": glass,
}


@pytest.mark.parametrize("part", SENSORS)
def test_brightness_matches_aperture_fill(part, tmp_path):
    """Pixels right of the axis with partial vignetting: image, spots and illumination."""
    sensor, plan = SENSORS[part](tmp_path), sampling_plan(144, True)
    width, height = sensor.image_size
    first, row = int(sensor.imager.centre[0]) + 4, slice(height // 2, height // 2 + 1)
    shares = (
        transmitted(sensor, plan, row, slice(first, width), rendering.trace_bundle)
        .reshape(-1, 144)
        .mean(axis=1)
    )
    partial = np.flatnonzero((shares > 0.05) & (shares < 0.95))
    rows = []
    for column in first + partial[:: max(len(partial) // 6, 1)]:
        share = shares[column - first]
        chief = sensor.optical_train.obstructed(
            *sensor.lens_rays(np.array([[column, height // 2]]), np.zeros(2))
        )[0]
        omega = float(np.degrees(np.arccos(-chief.directions[0, 2])))
        azimuth = float(np.degrees(np.arctan2(chief.directions[0, 1], chief.directions[0, 0])))
        try:
            filled = om.spots(sensor, [omega], azimuth_deg=azimuth, pupil=SHARE).filled[0]
        except om.OmnimirrorError:  # the chief ray itself is blocked by a mirror
            continue
        if sensor.secondary is None:
            illuminated = om.illumination(sensor, [omega], azimuth_deg=azimuth).filled[0]
        else:
            pixels = np.full((len(SHARE.points), 2), (column, height // 2))
            illuminated = sensor.aperture_rays(pixels, SHARE.points)[2].mean()
        rows.append((share, illuminated, filled))
    share, illuminated, filled = np.transpose(rows)
    np.testing.assert_allclose(share, illuminated, atol=0.12)  # at edges across a pixel
    assert share.mean() == pytest.approx(illuminated.mean(), abs=0.05)
    # bundles of defocused objects are blocked at other angles than those of pixels, about the same
    # edge
    assert share.mean() == pytest.approx(filled.mean(), abs=0.12)
