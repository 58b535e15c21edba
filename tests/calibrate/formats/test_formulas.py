"""Our files, read without us and projected by each program's own formula, written out or called."""

import json
import re

import numpy as np
import pytest

import omnimirror as om
from omnimirror.camera_models import OCam, Unified
from omnimirror.frames import Mount

F, C, SIZE = (260.0, 261.3), (515.32, 380.29), (1024, 768)
OCAM = OCam((-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10), C, SIZE, (0.9998, 4.4e-4, 8e-5))
UNIFIED = Unified(0.93, F, C, SIZE, 0.0, -0.01, 0.002, p1=1e-3, p2=-2e-3)


def seen(camera, most_deg=180.0):
    """Pixels, and points that they see, in the frame of files: right, down, towards what the centre sees."""
    pixels = np.random.default_rng(5).uniform(0, np.array(camera.image_size) - 1, (400, 2))
    _, directions, valid = camera.backproject(pixels)
    turned = directions[valid] @ camera.mount.rotation()
    reversed_x = -1 if camera.mount.image_flipped else 1
    points = turned * [reversed_x, 1, -1 if camera.looks_back else 1]
    near = points[:, 2] > np.cos(np.radians(most_deg))
    return pixels[valid][near], points[near] * np.linspace(500, 3000, near.sum())[:, None]


def test_ocamcalibs_inverse_polynomial_projects_as_its_direct_one(tmp_path):
    """world2cam.m of OCamCalib, with the polynomial that we fitted: within its .01 px."""
    om.convert(OCAM, tmp_path / "calib_results.txt")
    rows = [[float(w) for w in line.split()] for line in (tmp_path / "calib_results.txt").read_text().splitlines()
            if line and not line.startswith("#")]  # fmt: skip
    (_, *_), (_, *inverse), (xc, yc), (c, d, e), size = rows
    assert size == [768, 1024]
    pixels, (right, down, z) = (found := seen(OCAM))[0], found[1].T
    norm = np.hypot(right, down)
    theta = np.arctan(-z / norm)
    rho = sum(a * theta**i for i, a in enumerate(inverse))
    x, y = down / norm * rho, right / norm * rho
    expected = np.stack([x * e + y + yc, x * c + y * d + xc], axis=-1)
    np.testing.assert_allclose(expected, pixels, atol=0.0101, rtol=0)


def test_py_ocamcalibs_json(tmp_path):
    """cam2world of py-OCamCalib, and the inverse polynomial of its world2cam_fast."""
    om.convert(OCAM, tmp_path / "a.json", to="py-ocamcalib")
    file = json.loads((tmp_path / "a.json").read_text())
    pixels, points = seen(OCAM)
    stretch = np.array(file["stretch_matrix"])
    plane = (pixels - file["distortion_center"]) @ np.linalg.inv(stretch).T
    rho = np.hypot(*plane.T)
    rays = np.column_stack([plane, np.polyval(file["taylor_coefficient"][::-1], rho)])
    cross = np.cross(rays / np.linalg.norm(rays, axis=1)[:, None], points / np.linalg.norm(points, axis=1)[:, None])
    assert np.abs(cross).max() < 1e-12
    assert (np.sum(rays * points, axis=1) > 0).all()
    assert stretch[1, 1] == 1
    theta = np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))
    np.testing.assert_allclose(np.polyval(file["inverse_poly"], theta), rho, atol=0.0101, rtol=0)


@pytest.mark.parametrize("name", ["camera.m", "camera.json"])
def test_matlabs_fisheye_intrinsics(tmp_path, name):
    """(u', v') = [c d; e 1] (u, v) + centre, rays (u, v, a0 + a2 r^2 + a3 r^3 + a4 r^4), the first pixel at (1, 1)."""
    om.convert(OCAM, tmp_path / name, to="matlab")
    text = (tmp_path / name).read_text()
    if name.endswith(".json"):
        file = json.loads(text)
        a, size, centre, stretch = (np.array(file[k]) for k in (
            "MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix"))  # fmt: skip
    else:
        code = re.sub(r"%.*", "", text).replace("...", "")
        a, size, centre, stretch = (
            np.array([[float(w) for w in re.split(r"[\s,]+", row.strip())] for row in part.split(";")]).squeeze()
            for part in re.findall(r"\[([^\]]*)\]", code)
        )
    assert size.tolist() == [768, 1024]
    pixels, points = seen(OCAM)
    plane = (pixels + 1 - centre) @ np.linalg.inv(stretch).T
    rho = np.hypot(*plane.T)
    rays = np.column_stack([plane, a[0] + a[1] * rho**2 + a[2] * rho**3 + a[3] * rho**4])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    np.testing.assert_allclose(rays, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-12)


@pytest.mark.parametrize("camera", [UNIFIED, OCAM])
def test_flipping_a_camera_mirrors_its_pixels(camera):
    from omnimirror.calibrate.conversion import flipped

    pixels = np.random.default_rng(6).uniform(0, np.array(SIZE) - 1, (300, 2))
    _, directions, valid = camera.backproject(pixels)
    mirrored = flipped(camera).project_directions(directions[valid])
    expected = pixels[valid] * [-1, 1] + [SIZE[0] - 1, 0]
    np.testing.assert_allclose(mirrored.pixels, expected, atol=1e-9, rtol=0)
    assert flipped(flipped(camera)) == camera
    assert flipped(camera).is_picture_reversed != camera.is_picture_reversed
    assert Mount() == camera.mount
