"""Straight edges of a simulated room: edge chains, refined and levelled cameras, with ground truth."""

import re
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration import edge_detection
from omnimirror.calibration.edge_detection import edge_chains
from omnimirror.calibration.levelling import level_from_edges
from omnimirror.calibration.plumb_lines import draw_edges
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import Unified
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.commands import omnimirror

SIZE = (640, 640)


@cache
def scene():
    """A tilted hyperboloid, and its image of the room."""
    sensor = om.load_sensor("paper-hyperboloidal")
    imager = replace(
        sensor.imager, width_px=SIZE[0], height_px=SIZE[1], pixel_pitch_um=5.2 * 1024 / SIZE[0]
    )
    sensor = replace(sensor, imager=imager, mount=Mount("up", -90.0, False, 3.0, -2.0))
    return sensor, om.render_image(sensor, om.Room(texel_mm=20.0), samples=4)


def field(sensor):
    return {
        "centre_px": sensor.imager.centre,
        "radius_px": sensor.rim_radius_px,
        "inner_radius_px": 30.0,
    }


def errors_deg(truth, camera):
    """Return angles (n,) between true and estimated pixel directions in the camera frame, and
    predicted standard deviations."""
    pixels = np.random.default_rng(0).uniform(0, SIZE[0], (800, 2))
    a, b = truth.backproject(pixels), camera.backproject(pixels)
    both = a.valid & b.valid
    cosine = np.sum(
        (a.directions @ truth.mount.rotation()) * (b.directions @ camera.mount.rotation()), axis=1
    )[both]
    return np.degrees(np.arccos(np.clip(cosine, -1, 1))), om.direction_uncertainty(
        camera, pixels[both], field_deg=180.0
    )


def test_chains_match_edges_within_0_1_px():
    """A dark polygon drawn with coverage: each chain corresponds to one of its sides."""
    yy, xx = np.mgrid[0:300, 0:300].astype(float)
    corners = np.array([[60.3, 70.2], [240.7, 90.4], [200.1, 250.6], [80.9, 220.5]])
    coverage = np.ones((300, 300))
    sides = list(zip(corners, np.roll(corners, -1, axis=0), strict=True))
    for a, b in sides:
        along = (b - a) / np.linalg.norm(b - a)
        coverage *= np.clip(0.5 + (xx - a[0]) * -along[1] + (yy - a[1]) * along[0], 0, 1)
    edge_detection = edge_chains((200 - 150 * coverage).astype(np.uint8), radius_px=1e3)
    assert len(edge_detection) >= 4
    for chain in edge_detection:
        distances = [
            np.abs((chain - a) @ (np.array([a[1] - b[1], b[0] - a[0]]) / np.linalg.norm(b - a)))
            for a, b in sides
        ]
        inner = min(distances, key=np.median)[3:-3]
        assert np.sqrt((inner**2).mean()) < 0.1


@pytest.mark.full
def test_a_mirror_of_known_kind_is_refined_and_levelled():
    truth, image = scene()
    nominal = replace(truth, lens=replace(truth.lens, focal_length_mm=11.2), mount=Mount("up"))
    model = om.SensorModel(nominal, ("focal", "decentre"))
    calibration = om.calibrate_plumb_lines([image], model=model, **field(truth))
    error, sigma = errors_deg(truth, calibration.camera)
    assert np.sqrt((error**2).mean()) < 0.2
    assert (error < 3 * sigma).mean() > 0.95
    assert calibration.rms_px < 0.3
    (level,) = calibration.levels
    assert np.hypot(level.pitch_deg - 3.0, level.roll_deg + 2.0) < max(3 * level.sigma_deg, 0.15)
    assert calibration.camera.mount == level.on(nominal.mount)


def test_unknown_central_camera_is_estimated_within_uncertainty():
    truth, image = scene()
    calibration = om.calibrate_plumb_lines([image], **field(truth))
    error, sigma = errors_deg(truth, calibration.camera)
    assert np.sqrt((error**2).mean()) < 2.0
    assert (error < 3 * sigma).mean() > 0.95
    assert calibration.camera.KIND == "unified"


def test_undetermined_parameters_are_reported():
    """Focal length, size and distance of a mirror compensate each other."""
    truth, image = scene()
    model = om.SensorModel(replace(truth, mount=Mount("up")), ("focal", "shape", "distance"))
    calibration = om.calibrate_plumb_lines([image], model=model, **field(truth))
    assert any(
        "mirror.b_mm" in note and "lens.focal_length_mm" in note for note in calibration.free
    )
    error, _ = errors_deg(truth, calibration.camera)
    assert np.sqrt((error**2).mean()) < 0.5


def test_tilt_from_vertical_edges():
    mount = Mount("down", 40.0, pitch_deg=-7.0, roll_deg=4.0)
    up = mount.rotation().T @ [0.0, 0.0, 1.0]
    rng = np.random.default_rng(3)
    upright = np.cross(up, rng.normal(size=(12, 3))) + 0.001 * rng.normal(size=(12, 3))
    clutter = rng.normal(size=(20, 3))
    normals = np.concatenate([upright, clutter])
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    level = level_from_edges(normals, np.full(32, 30.0), Mount("down", 40.0))
    assert (level.pitch_deg, level.roll_deg) == (
        pytest.approx(-7.0, abs=0.15),
        pytest.approx(4.0, abs=0.15),
    )
    assert level.upright >= 12
    assert level_from_edges(normals[:2], np.ones(2), mount) is None


def test_random_edges_do_not_determine_tilt():
    rng = np.random.default_rng(5)
    for count in (12, 60, 360):
        for _ in range(40):
            normals = rng.normal(size=(count, 3))
            normals /= np.linalg.norm(normals, axis=1)[:, None]
            assert level_from_edges(normals, rng.uniform(5.0, 50.0, count), Mount("up")) is None


def test_edges_are_independent_of_alpha_and_bit_depth():
    image = np.zeros((200, 200, 3), np.uint8)
    image[:, 90:] = 200
    (expected,) = edge_chains(image)
    opaque = np.dstack([image, np.full((200, 200), 255, np.uint8)])
    for other in (opaque, image.astype(np.uint16) * 257, opaque[..., [0, 3]], image[..., :1]):
        (chain,) = edge_chains(other)
        assert chain == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("band", [1, 20_000, 50_000])
def test_edges_of_bands_equal_edges_of_whole_image(band, monkeypatch):
    random = np.random.default_rng(3)
    image = cv2.GaussianBlur(random.integers(0, 256, (301, 260, 3)).astype(np.uint8), (0, 0), 6.0)
    image = cv2.normalize(image, None, 0, 255, cv2.NORM_MINMAX)
    complete = edge_chains(image, min_length_px=12.0)
    monkeypatch.setattr(edge_detection, "BAND", band)
    assert len(complete) > 30
    for one, other in zip(complete, edge_chains(image, min_length_px=12.0), strict=True):
        np.testing.assert_array_equal(one, other)


def test_images_with_too_few_edges_raise():
    grey = np.full((200, 200, 3), 128, np.uint8)
    with pytest.raises(InvalidParameter, match="at least 8 long edges"):
        om.calibrate_plumb_lines([grey])
    with pytest.raises(InvalidParameter, match="2 different sizes"):
        om.calibrate_plumb_lines([grey, grey[:100]])
    truth, image = scene()
    other = Unified(
        xi=1.0,
        focal_px=(100.0, 100.0),
        centre_px=(99.5, 99.5),
        image_size=(200, 200),
        optics="mirror",
    )
    with pytest.raises(
        InvalidParameter, match="size of the images, 640 x 640 px; got 200 x 200 px"
    ):
        om.calibrate_plumb_lines([image], model=other, **field(truth))


@pytest.mark.full
def test_fixed_pose_of_misaligned_mirror_is_unchanged(tmp_path):
    """Command line: sensor file in, refined and levelled file with its uncertainty out."""
    truth, image = scene()
    nominal = replace(truth, mount=Mount("up"), mirror_pose=MirrorPose(0.2, 0.1))
    om.save_sensor(nominal, tmp_path / "drawn.toml")
    om.write_image(tmp_path / "room.png", image)
    rim = [*truth.imager.centre, truth.rim_radius_px]
    run = omnimirror(
        "lines",
        tmp_path / "room.png",
        "--camera",
        tmp_path / "drawn.toml",
        "--rim",
        *rim,
        "--set",
        "rim.inner_radius_px=30",
        "-o",
        tmp_path / "built.toml",
        "--figure",
        tmp_path / "edges.png",
    )
    assert run.returncode == 0, run.stderr
    built = om.load_sensor(tmp_path / "built.toml")
    assert built.uncertainty is not None
    assert built.mount.pitch_deg == pytest.approx(3.0, abs=0.5)
    assert om.read_image(tmp_path / "edges.png").shape == image.shape


def test_mirror_outline_is_detected_by_default(tmp_path):
    truth, image = scene()
    om.save_sensor(replace(truth, mount=Mount("up")), tmp_path / "drawn.toml")
    om.write_image(tmp_path / "room.png", image)
    om.write_image(
        tmp_path / "noise.png", np.random.default_rng(0).integers(0, 255, (200, 200, 3), np.uint8)
    )
    model, out = ("--camera", tmp_path / "drawn.toml"), ("-o", tmp_path / "built.toml")
    run = omnimirror("lines", tmp_path / "room.png", *model, *out)
    assert run.returncode == 0, run.stderr
    u, v, radius = (
        float(n)
        for n in re.search(
            r"detected rim: centre (\S+), (\S+) px, radius (\S+) px", run.stdout
        ).groups()
    )
    assert (u, v, radius) == pytest.approx(
        (*truth.imager.centre, truth.rim_radius_px), abs=0.01 * truth.rim_radius_px
    )
    assert om.load_sensor(tmp_path / "built.toml").mount.pitch_deg == pytest.approx(3.0, abs=0.5)
    failure = omnimirror("lines", tmp_path / "noise.png", *model)
    assert failure.returncode == 2
    assert "no rim detected" in " ".join(failure.stderr.split())
    assert "--rim U V R" in " ".join(failure.stderr.split())


def test_edges_are_drawn_on_image():
    image = np.full((50, 60), 100, np.uint8)
    drawing = draw_edges(image, [np.array([[10.0, 10.0], [40.0, 10.0]])], [True])
    assert drawing.shape == (50, 60, 3)
    assert drawing[10, 25, 1] > 200
    assert (drawing[30] == 50).all()


@pytest.mark.full
def test_photograph_of_room_identifies_mirror(shared_data):
    """OCamCalib sample, calibrated by its authors with many boards; no board is detected here."""
    folder = shared_data / "ocamcalib_cpp_sample"
    truth = om.load_ocam(folder / "calib_results_catadioptric.txt")
    image = om.read_image(folder / "test_catadioptric.jpg")
    calibration = om.calibrate_plumb_lines(
        [image], centre_px=truth.centre_px, radius_px=370.0, inner_radius_px=80.0
    )
    phi = np.linspace(0, 2 * np.pi, 16, endpoint=False)
    rings = [r * np.stack([np.cos(phi), np.sin(phi)], axis=-1) for r in (100.0, 200.0, 300.0)]
    pixels = np.array(truth.centre_px) + np.concatenate(rings)
    a, b = (
        c.backproject(pixels).directions @ c.mount.rotation() for c in (truth, calibration.camera)
    )
    error = np.degrees(np.arccos(np.clip((a * b).sum(axis=1), -1, 1)))
    assert np.sqrt((error**2).mean()) < 3.5
    assert (error < 3 * om.direction_uncertainty(calibration.camera, pixels)).all()


def marked_edges(camera, count: int = 24, noise_px: float = 0.2) -> list[np.ndarray]:
    """Return points of straight edges of a room at 2 to 4 m, a dozen on each, as marked manually."""
    random = np.random.default_rng(4)
    edges: list[np.ndarray] = []
    while len(edges) < count:
        middle = random.normal(size=3)
        middle *= random.uniform(2000, 4000) / np.linalg.norm(middle)
        along = np.eye(3)[len(edges) % 3] if len(edges) % 2 else random.normal(size=3)
        points = middle + np.linspace(-2500, 2500, 12)[:, None] * along / np.linalg.norm(along)
        projection = camera.project(points)
        if projection.valid.sum() >= 8:
            edges.append(
                projection.pixels[projection.valid]
                + random.normal(0, noise_px, (projection.valid.sum(), 2))
            )
    return edges


def test_camera_is_refined_by_marked_points(tmp_path):
    truth = scene()[0]
    lens = truth.lens
    nominal = replace(truth, lens=replace(lens, focal_length_mm=1.02 * lens.focal_length_mm))
    edges = marked_edges(truth)
    calibration = om.calibrate_plumb_lines(
        lines=[edges], image_size=truth.image_size, model=nominal, distance_mm=3000.0
    )
    error, sigma = errors_deg(truth, calibration.camera)
    before, _ = errors_deg(truth, replace(nominal, uncertainty=calibration.camera.uncertainty))
    assert np.sqrt(np.mean(error**2)) < 0.5 * np.sqrt(np.mean(before**2))
    assert np.mean(error < 3 * sigma) > 0.95
    assert calibration.rms_px == pytest.approx(0.2, rel=0.25)
    om.save_sensor(nominal, tmp_path / "drawn.toml")
    rows = [f"{i},{u:.3f},{v:.3f}" for i, edge in enumerate(edges) for u, v in edge]
    (tmp_path / "edges.csv").write_text("\n".join(["line,u_px,v_px", *rows]) + "\n")
    width, height = truth.image_size
    run = omnimirror(
        "lines",
        "--lines",
        "edges.csv",
        "--image-size",
        f"{width}x{height}",
        "--camera",
        "drawn.toml",
        "--set",
        "lines.distance_mm=3000",
        "-o",
        "built.toml",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    built = om.load_camera(tmp_path / "built.toml")
    assert built.lens.focal_length_mm == pytest.approx(
        calibration.camera.lens.focal_length_mm, rel=1e-4
    )


def curved_edges(truth, random, count, bend_px):
    """Return images of distant straight objects by finite rays, each with a curvature that no
    camera explains."""
    edges = []
    while len(edges) < count:
        middle, along = (v / np.linalg.norm(v) for v in random.normal(size=(2, 3)))
        projection = truth.project(1e6 * (middle + np.linspace(-0.5, 0.5, 60)[:, None] * along))
        points = projection.pixels[projection.valid]
        if len(points) < 20 or np.linalg.norm(points[-1] - points[0]) < 30:
            continue
        at = np.linspace(-1, 1, len(points))[:, None]
        across = np.gradient(points, axis=0)[:, ::-1] * [-1, 1]
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        curve = random.normal() * (at**2 - 1 / 3) + random.normal() * (at**3 - 0.6 * at)
        edges.append(points + (bend_px * curve + random.normal(0, 0.1, at.shape)) * across)
    return edges


@pytest.mark.parametrize("seeds", [5, pytest.param(16, marks=pytest.mark.full)])
def test_few_imperfect_edges_have_consistent_uncertainty(seeds):
    """Ten edges fit more closely than they are straight; with that scale, errors were 1.5 times the
    prediction."""
    truth = replace(scene()[0], mount=Mount("up"))
    nominal = replace(
        truth, lens=replace(truth.lens, focal_length_mm=1.02 * truth.lens.focal_length_mm)
    )
    ratios = []
    for seed in range(seeds):
        edges = curved_edges(truth, np.random.default_rng(seed), 10, 0.3)
        calibration = om.calibrate_plumb_lines(
            lines=[edges], image_size=SIZE, model=om.SensorModel(nominal, ("focal", "decentre"))
        )
        error, sigma = errors_deg(truth, calibration.camera)
        ratios.append(np.sqrt(np.mean((error / sigma) ** 2)))
    assert np.sqrt(np.mean(np.square(ratios))) < 1.2
    assert np.mean(np.array(ratios) < 3) >= 0.95


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("line,u_px,v_px\na,1,2\na,2,3\n", "line a of image must have at least 3 points; got 2"),
        ("line,u_px\na,1\n", "must be line,u_px,v_px, and image for several"),
        ("line,u_px,v_px\na,1,x\n", "edges.csv line 2: v_px must be a finite number; got 'x'"),
        ("line,u_px,v_px\na,1\n", "edges.csv line 2 must have 3 values, as the first line; got 2"),
        ("", "contains no points; its first line must be line,u_px,v_px"),
    ],
)
def test_invalid_edge_tables_raise(text, message, tmp_path):
    (tmp_path / "edges.csv").write_text(text)
    with pytest.raises(InvalidParameter, match=re.escape(message)):
        om.read_line_points([tmp_path / "edges.csv"])
