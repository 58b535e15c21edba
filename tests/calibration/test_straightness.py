"""Straightness of board lines in perspective views of a calibrated camera."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras.camera import Mount
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.rendering import render_pinhole_image
from omnimirror.simulation.scenes.scene import DistantScene
from tests.conftest import SHARED

BOARD = om.Board("chessboard", 11, 7, 30.0)
PHOTOGRAPHS = sorted((SHARED / "kaidan_omni").glob("*.jpg"))


def straightened(camera, corners_px):
    """Return corners (n, 2) px of a board in a perspective view centred on it, at the resolution of
    the image there."""
    rays = camera.backproject(corners_px).directions
    mean_direction = rays.mean(axis=0)
    mean_direction /= np.linalg.norm(mean_direction)
    right = np.cross(mean_direction, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(mean_direction, right), mean_direction])
    x, y, z = axes @ rays.T
    view = np.stack([x / z, y / z], axis=1)
    focal_px = np.linalg.norm(corners_px - corners_px.mean(axis=0)) / np.linalg.norm(
        view - view.mean(axis=0)
    )
    return focal_px * view


def straightness_px(camera, detection):
    """Return distances (k,) px of each corner from the best-fit lines of its row and column."""
    view = straightened(camera, detection.corners_px)
    rows, columns = np.divmod(np.asarray(detection.ids), BOARD.columns)
    distances_px = []
    for line in [view[rows == i] for i in range(BOARD.rows)] + [
        view[columns == i] for i in range(BOARD.columns)
    ]:
        if len(line) > 2:
            from_middle = line - line.mean(axis=0)
            distances_px.append(np.abs(from_middle @ np.linalg.svd(from_middle)[2][1]))
    return np.concatenate(distances_px)


@pytest.mark.full
@pytest.mark.long
def test_lines_of_boards_are_straight_for_a_misaligned_mirror():
    """Calibrated from noisy corners and evaluated with other, noise-free boards. Without the
    calibrated misalignment, the lines are bent four times as much."""
    nominal = om.load_sensor("paper-spherical")
    built = replace(nominal, mirror_pose=MirrorPose(0.8, -0.5, 0.0, 0.6, 0.0))
    detections = om.simulate_detections(built, BOARD, 8, noise_px=0.1, seed=1)
    others = om.simulate_detections(built, BOARD, 8, noise_px=0.0, seed=2)
    camera = om.calibrate_camera(detections, BOARD, model=nominal).camera
    error_px, nominal_error_px = (
        np.concatenate([straightness_px(c, d) for d in others]).max() for c in (camera, nominal)
    )
    assert error_px < 0.25 * nominal_error_px
    assert error_px < 1.0


@pytest.mark.full
@pytest.mark.long
@pytest.mark.skipif(not PHOTOGRAPHS, reason=f"the photographs are not in {SHARED}")
def test_lines_of_photographed_boards_are_straight():
    """Including boards that are held out of the calibration."""
    detections = om.find_boards(PHOTOGRAPHS[::2], BOARD)
    camera = om.calibrate_camera(
        detections[::2] + detections[1:4:2], BOARD, model="radial-spline"
    ).camera
    errors_px = [straightness_px(camera, d).max() for d in detections]
    assert max(errors_px) < 1.0


ROOM = om.Room(texel_mm=20.0)
CENTRE, SIZE, RIM = (161.0, 157.0), (320, 320), 150.0
NOMINAL = om.load_sensor("paper-equidistant")
CALIBRATED = {
    "unified": om.Unified(
        xi=0.9,
        focal_px=(130.0, 131.0),
        centre_px=CENTRE,
        image_size=SIZE,
        k1=-0.02,
        p1=1e-3,
        rim_radius_px=RIM,
    ),
    "enhanced-unified": om.EnhancedUnified(
        alpha=0.55,
        beta=1.1,
        focal_px=(60.0, 60.5),
        centre_px=CENTRE,
        image_size=SIZE,
        rim_radius_px=RIM,
    ),
    "double-sphere": om.DoubleSphere(
        xi=0.1,
        alpha=0.55,
        focal_px=(60.0, 60.0),
        centre_px=CENTRE,
        image_size=SIZE,
        rim_radius_px=RIM,
    ),
    "kannala-brandt": om.KannalaBrandt(
        focal_px=(66.0, 66.5), centre_px=CENTRE, image_size=SIZE, k1=-0.01, rim_radius_px=RIM
    ),
    "ocam": om.OCam(
        polynomial=(-80.0, 0.0, 0.002, 0.0, 1e-8),
        centre_px=CENTRE,
        image_size=SIZE,
        rim_radius_px=RIM,
    ),
    "radial-spline": om.RadialSpline(
        radii_px=(35.0, 72.0, 108.0, 140.0, 165.0),
        field_deg=270.0,
        centre_px=CENTRE,
        image_size=SIZE,
        rim_radius_px=RIM,
    ),
    "viewpoint-spline": om.ViewpointSpline(
        radii_px=(35.0, 72.0, 108.0, 140.0, 165.0),
        viewpoints_mm=(0.0, -2.0, -5.0, -9.0, -14.0),
        field_deg=270.0,
        centre_px=CENTRE,
        image_size=SIZE,
        rim_radius_px=RIM,
    ),
    "a fisheye": om.KannalaBrandt(
        focal_px=(90.0, 90.0),
        centre_px=CENTRE,
        image_size=SIZE,
        k1=0.01,
        optics="fisheye",
        mount=Mount("down"),
        rim_radius_px=RIM,
    ),
    "sensor": replace(
        NOMINAL,
        mirror_pose=MirrorPose(0.8, -0.5, 0.0, 0.6, -0.5),
        imager=replace(NOMINAL.imager, width_px=320, height_px=320, pixel_pitch_um=3.2 * 5.2),
    ),
}


EVERY_DAY = ("viewpoint-spline", "a fisheye")


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=() if n in EVERY_DAY else pytest.mark.full) for n in CALIBRATED]
)
def test_views_of_calibrated_camera_match_pinhole(name):
    """Dewarped image of distant objects against the scene itself in each direction, every ninth
    pixel."""
    camera, scene = CALIBRATED[name], DistantScene(ROOM)
    sizes = {"ground": (200, 200), "perspective": (320, 180)}
    image = om.render_image(camera, scene, samples=4)
    for kind in sorted({*om.views.VIEWS} - {"cube", "mosaic"}):  # which are composed of the others
        options = {"height_mm": 800.0} if kind == "ground" else {}
        options |= {"size": sizes[kind]} if kind in sizes else {}
        screen = om.views.VIEWS[kind](camera, **options)
        view = om.Dewarper(camera, screen, "linear")(image, transparent=True)[::3, ::3]
        u, v = np.meshgrid(*(np.arange(0.0, n, 3.0) for n in screen.size))
        is_valid = np.isfinite(
            camera.project_directions(screen.targets_at(u, v).reshape(-1, 3)).pixels[:, 0]
        )
        if (
            kind == "ground" and not screen.is_distant
        ):  # near points, displaced for a mirror without a single viewpoint
            is_valid &= name not in ("viewpoint-spline", "sensor")
        is_valid = is_valid.reshape(u.shape) & (view[..., 3] == 255)
        true = render_pinhole_image(scene, screen.targets_at(u, v))
        differences = np.abs(view[..., :3].astype(float) - true)[is_valid]
        assert is_valid.any() or (kind == "ground" and name in ("viewpoint-spline", "sensor"))
        if is_valid.any():
            assert np.median(differences) <= 3, kind
            assert differences.mean() < (11 if kind == "ground" else 7), kind
