"""Reconstruction of a walk through the bundled room by COLMAP from an exported project."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.colmap import write_colmap

pytestmark = pytest.mark.full
SENSOR = om.load_sensor("paper-equidistant")
STEPS = 16


@pytest.mark.timeout(1500)
def test_reconstruction_of_a_walk(tmp_path, beside):
    pycolmap = pytest.importorskip(
        "pycolmap", reason="pycolmap is installed by `make test-full` only"
    )
    poses, project = walked(tmp_path)
    model = reconstructed(pycolmap, project.folder)
    lost = 100 * (1 - model.num_reg_images() / (STEPS * len(project.rig)))
    beside("COLMAP", "images of a camera path without a reconstructed pose", lost, 5.0, "%")
    stated = project.rig[0].errors_px[3000.0]  # the walls are about that far
    assert model.compute_mean_reprojection_error() < stated

    path, truth, points = in_the_room(model, poses, project)
    missed = np.linalg.norm(path - truth, axis=1)
    length = np.linalg.norm(np.diff(truth, axis=0), axis=1).sum()
    beside(
        "COLMAP",
        "relative deviation of this path",
        100 * missed.max() / length,
        1.0,
        "%",
    )

    nearest = truth[np.linalg.norm(points[:, None] - truth[None], axis=2).argmin(axis=1)]
    away = np.linalg.norm(points - nearest, axis=1)
    walls = (
        om.Room(texel_mm=40.0).distance_mm(1000 * nearest, (points - nearest) / away[:, None])
        / 1000
    )
    error_px = np.abs(walls - away) / away**2 * project.rig[0].parameters[0] * BASELINE
    assert np.median(error_px) < stated


BASELINE = 0.5
"""Distance between images of the same point, m, which converts depth errors to px."""


def walked(folder):
    """Return the poses of the images and the exported project."""
    poses = [
        om.Pose(
            2600 * t - 1400,
            500 * np.sin(2 * np.pi * t),
            60 * np.sin(5 * t),
            40 * np.sin(4 * t),
            2 * np.sin(9 * t),
        )
        for t in np.linspace(0, 1, STEPS)
    ]
    (folder / "walk").mkdir()
    for k, pose in enumerate(poses):
        om.write_image(
            folder / "walk" / f"{k:03d}.png",
            om.render_image(SENSOR, om.PosedScene(om.Room(), pose)),
        )
    return poses, write_colmap(SENSOR, folder / "walk", folder / "project")


def in_the_room(model, poses, project):
    """Return the estimated and the true path and the points (n, 3), m."""
    places = {
        int(i.name[-7:-4]): i.projection_center()
        for i in model.images.values()
        if i.name.startswith("view-000")
    }
    found = np.array([places[k] for k in sorted(places)])
    truth = np.array([poses[k].to_scene(project.rig[0].position_mm) for k in sorted(places)]) / 1000
    scale, turn, shift = aligned(found, truth)
    points = np.array([p.xyz for p in model.points3D.values()])
    return scale * found @ turn.T + shift, truth, scale * points @ turn.T + shift


def reconstructed(pycolmap, folder):
    """Run the steps of COLMAP with fixed cameras and rig."""
    database = folder / "database.db"
    shutil.copy(database, folder / "before.db")
    extraction, matching = pycolmap.FeatureExtractionOptions(), pycolmap.FeatureMatchingOptions()
    extraction.use_gpu = matching.use_gpu = False
    extraction.sift.max_num_features = 1500
    reading = pycolmap.ImageReaderOptions()
    reading.mask_path = str(folder / "masks")
    pycolmap.extract_features(
        database,
        folder / "images",
        camera_mode=pycolmap.CameraMode.PER_FOLDER,
        reader_options=reading,
        extraction_options=extraction,
        device=pycolmap.Device.cpu,
    )
    with pycolmap.Database.open(database) as base:
        assert (base.num_cameras(), base.num_rigs(), base.num_frames()) == (6, 1, STEPS)
    matching.rig_verification = matching.skip_image_pairs_in_same_frame = True
    pairing = pycolmap.SequentialPairingOptions(
        overlap=4, expand_rig_images=True, quadratic_overlap=False
    )
    pycolmap.match_sequential(
        database, matching_options=matching, pairing_options=pairing, device=pycolmap.Device.cpu
    )
    mapping = pycolmap.IncrementalPipelineOptions()
    mapping.ba_refine_focal_length = mapping.ba_refine_extra_params = (
        mapping.ba_refine_sensor_from_rig
    ) = False
    (folder / "sparse").mkdir()
    models = pycolmap.incremental_mapping(database, folder / "images", folder / "sparse", mapping)
    return max(models.values(), key=lambda model: model.num_reg_images())


def aligned(found, truth):
    """Return the least-squares similarity transformation between two point sets (Umeyama, 1991)."""
    a, b = found - found.mean(axis=0), truth - truth.mean(axis=0)
    u, s, vt = np.linalg.svd(b.T @ a)
    signs = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    turn, scale = u @ np.diag(signs) @ vt, float((s * signs).sum() / (a**2).sum())
    return scale, turn, truth.mean(axis=0) - scale * turn @ found.mean(axis=0)
