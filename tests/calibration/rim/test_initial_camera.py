"""Initial cameras from an outline, against the misaligned sensor that rendered the image."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from mirror_composites import environments

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.rim import PRESETS, CameraImage
from omnimirror.optics.mirrors.mirror import MirrorPose


@cache
def sky() -> om.Environment:
    return om.Environment((environments(None)[0] / 255.0).astype(np.float32))


def large(name: str, pose: MirrorPose | None = None) -> om.Sensor:
    """Return a bundled sensor with an imager that contains the whole rim, and a given mirror pose."""
    sensor = om.load_sensor(name)
    imager = replace(sensor.imager, width_px=1100, height_px=1100, centre_px=None)
    return replace(sensor, imager=imager, mirror_pose=pose or MirrorPose())


@pytest.mark.parametrize(
    ("name", "pose"),
    [
        pytest.param("paper-spherical", MirrorPose(1.5, -1.0), marks=pytest.mark.full),
        pytest.param(
            "paper-spherical", MirrorPose(1.5, -1.0, 0.0, 3.0, 4.0), marks=pytest.mark.full
        ),
        ("prototype-hyperboloidal", MirrorPose(0.5, 1.0, 0.0, -5.0, 2.0)),
    ],
)
def test_mirror_pose_is_estimated_from_one_image(name, pose):
    image = om.render_image(large(name, pose), sky(), samples=2)
    estimate = om.sensor_from_rim(om.detect_mirror_outline(image), large(name)).mirror_pose
    assert estimate.shift[:2] == pytest.approx(pose.shift[:2], abs=0.3)
    assert (estimate.tilt_x_deg, estimate.tilt_y_deg) == (
        pytest.approx(pose.tilt_x_deg, abs=0.4),
        pytest.approx(pose.tilt_y_deg, abs=0.4),
    )


def rim_of(sensor: om.Sensor) -> om.MirrorOutline:
    """Return the rim projected by a pinhole, and its ellipse by linear least squares, without image
    processing."""
    turn = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim_mm, sag_mm = (
        sensor.mirror.rim_radius_mm,
        float(sensor.mirror.sag(np.array([sensor.mirror.rim_radius_mm]))[0]),
    )
    circle = np.stack([rim_mm * np.cos(turn), rim_mm * np.sin(turn), np.full(400, sag_mm)], axis=1)
    points = sensor.mirror_pose.to_camera(circle) + np.array([0, 0, sensor.mirror_distance_mm])
    focal_px = sensor.lens.image_distance / sensor.imager.pitch_mm
    pixels = focal_px * points[:, :2] / points[:, 2:] + sensor.imager.centre
    u, v = (pixels - pixels.mean(axis=0)).T
    p = np.linalg.lstsq(np.stack([u * u, u * v, v * v, u, v], axis=1), np.ones(400), rcond=None)[0]
    shape = np.array([[p[0], p[1] / 2], [p[1] / 2, p[2]]])
    middle = -np.linalg.solve(shape, p[3:]) / 2
    sizes, axes = np.linalg.eigh(shape / (1 + middle @ shape @ middle))
    angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])) % 180)
    centre = tuple(middle + pixels.mean(axis=0))
    return om.MirrorOutline(centre, tuple(sizes**-0.5), angle, 1.0, sensor.image_size)


def projected_camera_image(sensor: om.Sensor) -> CameraImage:
    """Return the reflection of the camera: pixels whose finite rays return to the lens, every
    second pixel."""
    u, v = np.meshgrid(*(np.arange(c - 200, c + 200, 2.0) for c in sensor.imager.centre))
    rays = sensor.backproject(np.stack([u, v], axis=-1))
    to_lens = sensor.optical_train.lens_offset - rays.origins
    incidence_cosine = np.einsum("...i,...i->...", to_lens, rays.directions) / np.linalg.norm(
        to_lens, axis=-1
    )
    k = np.unravel_index(np.argmax(np.where(rays.valid, incidence_cosine, -1.0)), u.shape)
    return CameraImage((float(u[k]), float(v[k])), 40.0)


def test_tilted_mirror_pose_from_rim():
    pose, sensor = MirrorPose(2.0, 1.0, 0.0, 4.0, -6.0), large("paper-spherical")
    estimate = om.sensor_from_rim(rim_of(replace(sensor, mirror_pose=pose)), sensor)
    assert estimate.mirror_pose.shift[:2] == pytest.approx(pose.shift[:2], abs=0.02)
    assert estimate.mirror_pose.tilt_x_deg == pytest.approx(4.0, abs=0.02)
    assert estimate.mirror_pose.tilt_y_deg == pytest.approx(-6.0, abs=0.02)
    assert estimate.imager.pixel_pitch_um == pytest.approx(sensor.imager.pixel_pitch_um, rel=1e-3)


def test_camera_image_resolves_tilt_ambiguity():
    """A pose that the solution of smaller decentre does not reproduce."""
    pose, sensor = MirrorPose(6.0, -5.0, 0.0, -3.0, -3.0), large("paper-spherical")
    true = replace(sensor, mirror_pose=pose)
    rim = rim_of(true)
    both = om.sensors_from_rim(rim, sensor)
    tilts = [(one.mirror_pose.tilt_x_deg, one.mirror_pose.tilt_y_deg) for one in both]
    assert len(tilts) == 2
    assert tilts[0] != pytest.approx((-3.0, -3.0), abs=1.0)
    assert tilts[1] == pytest.approx((-3.0, -3.0), abs=0.02)
    assert rim_of(both[0]).semi_axes_px == pytest.approx(rim.semi_axes_px, rel=2e-4)
    (resolved,) = om.sensors_from_rim(
        replace(rim, camera_image=projected_camera_image(true)), sensor
    )
    assert (resolved.mirror_pose.tilt_x_deg, resolved.mirror_pose.tilt_y_deg) == pytest.approx(
        (-3.0, -3.0), abs=0.02
    )
    wrong_image = CameraImage((rim.centre_px[0] + 250.0, rim.centre_px[1] + 250.0), 40.0)
    assert len(om.sensors_from_rim(replace(rim, camera_image=wrong_image), sensor)) == 2


RIM = om.MirrorOutline((420.0, 290.0), (250.0, 249.9), 0.0, 0.99, (800, 600))


@pytest.mark.parametrize("preset", PRESETS)
def test_field_of_preset_is_inside_rim(preset):
    camera = om.camera_from_rim(RIM, preset)
    ends = np.array([[420.0 + 249.8, 290.0], [420.0, 290.0 - 249.8], [420.0 + 251, 290.0]])
    assert list(camera.backproject(ends).valid) == [True, True, False]
    assert camera.image_size == (800, 600)


@pytest.mark.parametrize(("radii", "max_error_deg"), [(30.0, 1.0), (12.0, 3.3), (6.0, 7.5)])
def test_distant_mirror_ball_agrees_with_preset(radii, max_error_deg):
    """Finite ray: its angle of incidence on the ball is i, ``sin i = D / A sin a``, and it leaves
    at 2 i - a."""
    ball = om.camera_from_rim(RIM, "ball")
    share = np.linspace(0, 0.9, 50)
    from_axis = np.arctan(share * np.tan(np.arcsin(1 / radii)))
    field = 2 * np.arcsin(radii * np.sin(from_axis)) - from_axis
    difference_deg = np.degrees(np.abs(ball.omega_from_radius(share * RIM.radius_px) - field))
    assert difference_deg.max() < max_error_deg
    assert difference_deg.max() > 0.8 * max_error_deg  # the number on the page is correct


def test_cropped_image_keeps_mirror_aligned():
    sensor = om.sensor_from_rim(RIM, om.load_sensor("paper-spherical"))
    assert sensor.mirror_pose == MirrorPose()
    assert sensor.imager.centre == pytest.approx((420.0, 290.0))
    assert sensor.rim_radius_px == pytest.approx(250.0, rel=1e-3)


def test_unreliable_rim_raises_with_remedy():
    with pytest.raises(
        InvalidParameter, match=r"at least 0\.6; got 0\.20; use more images .* --ball"
    ):
        om.camera_from_rim(replace(RIM, confidence=0.2))


def test_unknown_mirror_raises_with_presets():
    with pytest.raises(InvalidParameter, match="one-shot, ball"):
        om.camera_from_rim(RIM, "no-such-mirror")
