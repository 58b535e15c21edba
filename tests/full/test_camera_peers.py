"""Written camera files, read and projected by other programs: OpenCV omnidir and COLMAP."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras.models import EnhancedUnified, OCam
from tests.calibration.formats.examples import (
    KANNALA_BRANDT,
    SIZE,
    THIN_PRISM,
    UNIFIED,
    C,
    F,
    projected_points,
)

pytestmark = pytest.mark.full
CONTRIB = Path(sys.prefix) / "opencv-contrib"
SAMPLE = Path(__file__).parents[3] / "shared/data/ocamcalib_cpp_sample"
OMNIDIR = """
import sys, cv2, numpy as np
storage = cv2.FileStorage(sys.argv[1], cv2.FILE_STORAGE_READ)
K, D = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
points, zero = np.load(sys.argv[2]), np.zeros(3)
pixels, _ = cv2.omnidir.projectPoints(points[None], zero, zero, K, storage.getNode("xi").real(), D)
np.save(sys.argv[3], pixels[0])
"""


def omnidir(folder, points):
    """Project points with a written file by OpenCV omnidir, in a separate process unless the imported
    OpenCV contains it."""
    path = os.environ.get("PYTHONPATH", "") if hasattr(cv2, "omnidir") else str(CONTRIB)
    if not hasattr(cv2, "omnidir") and not CONTRIB.is_dir():
        pytest.skip(f"OpenCV with omnidir is put into {CONTRIB} by `make test-full` only")
    np.save(folder / "points.npy", points)
    subprocess.run(
        [
            sys.executable,
            "-c",
            OMNIDIR,
            *(str(folder / n) for n in ("a.yaml", "points.npy", "pixels.npy")),
        ],
        env={**os.environ, "PYTHONPATH": path},
        check=True,
    )
    return np.load(folder / "pixels.npy")


@pytest.mark.parametrize("flip", [False, True])
def test_projection_agrees_with_omnidir(tmp_path, flip, beside):
    made = om.convert(UNIFIED, tmp_path / "a.yaml", to="opencv-omnidir", flip=flip)
    pixels, points = projected_points(made.camera)
    assert made.exact
    off = np.abs(omnidir(tmp_path, points) - pixels).max()
    beside("OpenCV", "points projected by cv2.omnidir with exported camera files", off, 1e-6, "px")


def test_conversion_to_omnidir_has_reported_error(tmp_path):
    if not SAMPLE.exists():
        pytest.skip(f"no sample files at {SAMPLE}")
    camera = om.load_ocam(SAMPLE / "calib_results_catadioptric.txt")
    made = om.convert(camera, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=0.5)
    pixels, points = projected_points(camera)
    error = np.hypot(*(omnidir(tmp_path, points) - pixels).T)
    assert error.max() <= made.largest_px * 1.01
    assert np.sqrt(np.mean(error**2)) == pytest.approx(made.rms_px, rel=0.25)


COLMAP = {
    "colmap-opencv-fisheye": KANNALA_BRANDT,
    "colmap-rad-tan-thin-prism-fisheye": THIN_PRISM,
    "colmap-eucm": EnhancedUnified(
        alpha=0.6, beta=1.1, focal_px=F, centre_px=C, image_size=SIZE, optics="fisheye"
    ),
}


@pytest.mark.parametrize("to", COLMAP)
@pytest.mark.parametrize("name", ["cameras.txt", "cameras.bin"])
def test_colmap_reads_and_projects_written_cameras(tmp_path, to, name, beside):
    pycolmap = pytest.importorskip(
        "pycolmap", reason="pycolmap is installed by `make test-full` only"
    )
    to = to.replace("colmap", "colmap-bin") if name.endswith("bin") else to
    camera = COLMAP[to.replace("-bin", "")]
    om.convert(camera, tmp_path / name, to=to)
    theirs = colmap_camera(pycolmap, tmp_path, name)
    assert (theirs.width, theirs.height) == SIZE
    pixels, points = projected_points(camera, 85.0)
    projected = np.array([theirs.img_from_cam(point) for point in points])
    off = np.abs(projected - pixels - 0.5).max()
    beside(
        "COLMAP",
        "points projected with exported cameras, three models, text and binary",
        off,
        1e-6,
        "px",
    )


def colmap_camera(pycolmap, folder, name):
    """Return the camera of a written file, with an empty reconstruction in the same form."""
    end = Path(name).suffix
    reconstruction = pycolmap.Reconstruction()
    content = (folder / name).read_bytes()
    (reconstruction.write_text if end == ".txt" else reconstruction.write_binary)(str(folder))
    (folder / name).write_bytes(content)
    read = pycolmap.Reconstruction()
    (read.read_text if end == ".txt" else read.read_binary)(str(folder))
    return read.cameras[1]


def test_cameras_of_colmap_are_read(tmp_path, beside):
    """All COLMAP models with a formula in omnimirror."""
    pycolmap = pytest.importorskip(
        "pycolmap", reason="pycolmap is installed by `make test-full` only"
    )
    rng = np.random.default_rng(2)
    points = rng.uniform(-1, 1, (200, 3)) * [900, 700, 0] + [0, 0, 1500]
    for model in (
        "SIMPLE_PINHOLE",
        "PINHOLE",
        "SIMPLE_RADIAL",
        "RADIAL",
        "OPENCV",
        "OPENCV_FISHEYE",
        "SIMPLE_RADIAL_FISHEYE",
        "RADIAL_FISHEYE",
        "SIMPLE_FISHEYE",
        "FISHEYE",
        "EUCM",
        "FULL_OPENCV",
        "RAD_TAN_THIN_PRISM_FISHEYE",
    ):
        theirs = pycolmap.Camera.create_from_model_name(1, model, 500.0, 1024, 768)
        values = np.array(theirs.params)
        values[-4:] = values[-4:] + (
            np.array([0.02, -0.01, 0.003, 0.002]) if len(values) > 5 else 0.0
        )
        if model == "EUCM":
            values[-2:] = (0.55, 1.2)
        theirs.params = values
        (tmp_path / "cameras.txt").write_text(
            f"1 {model} 1024 768 {' '.join(map(repr, map(float, values)))}\n"
        )
        ours = om.convert(tmp_path / "cameras.txt", tmp_path / "a.toml", optics="fisheye").camera
        world = points @ ours.mount.rotation().T
        found = replace(ours, rim_radius_px=None).project(world)
        expected = np.array([theirs.img_from_cam(point) for point in points]) - 0.5
        assert found.valid.mean() > 0.5
        off = np.abs(found.pixels[found.valid] - expected[found.valid]).max()
        beside(
            "COLMAP",
            "points projected with imported COLMAP cameras, thirteen models",
            off,
            1e-6,
            "px",
        )


def test_conversion_of_wide_mirror_reports_lost_field_for_colmap(tmp_path):
    camera = OCam(
        polynomial=(-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10),
        centre_px=C,
        image_size=SIZE,
    )
    made = om.convert(
        camera, tmp_path / "cameras.txt", to="colmap-eucm", tolerance_px=20.0, field_deg=85.0
    )
    assert any("less than 90 deg" in note for note in made.notes)


def test_equirectangular_view_agrees_with_colmap(tmp_path, beside):
    pycolmap = pytest.importorskip(
        "pycolmap", reason="pycolmap is installed by `make test-full` only"
    )
    sensor = om.load_sensor("paper-spherical")
    om.convert(sensor, tmp_path / "cameras.txt", to="colmap-equirectangular")
    theirs = colmap_camera(pycolmap, tmp_path, "cameras.txt")
    sphere = om.views.sphere(sensor)
    u, v = np.random.default_rng(1).uniform(0, 1, (2, 200)) * (np.array(sphere.size)[:, None] - 1)
    x, y, z = sphere.targets_at(u, v).T
    projected = np.array([theirs.img_from_cam(point) for point in np.stack([-y, -z, x], axis=-1)])
    off = np.abs(projected - np.stack([u, v], axis=-1) - 0.5).max()
    beside("COLMAP", "points projected into the panorama of COLMAP (sphere view)", off, 1e-6, "px")
