"""Straight edges combined with boards and points: gain against ground truth, and minimum of the
total cost."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.estimation import RigidTransform, StraightEdges
from omnimirror.calibration.estimation.observations import eliminate_line_positions
from tests.commands import fails, omnimirror

MIDDLE, RADIUS = np.array([322.0, 238.0]), 205.0
TRUTH = om.Unified(
    xi=0.9,
    focal_px=(150.0, 150.5),
    centre_px=(322.0, 238.0),
    image_size=(640, 480),
    k1=-0.03,
    p1=5e-4,
    rim_radius_px=220.0,
)
BOARD = om.Board("chessboard", 11, 7, 30.0)


def edges(count, seed=0, noise_px=0.2, points=12):
    """Return points on images of distant straight lines all around, as marked manually."""
    random, chains = np.random.default_rng(seed), []
    while len(chains) < count:
        across = np.linalg.svd(random.normal(size=(1, 3)))[2][1:]
        turn = random.uniform(0, 2 * np.pi) + np.linspace(
            0, np.radians(random.uniform(40, 110)), points
        )
        image = TRUTH.image(
            np.cos(turn)[:, None] * across[0] + np.sin(turn)[:, None] * across[1], distant=True
        )
        inside = image.valid & (np.abs(image.pixels - [319.5, 239.5]) < [318, 238]).all(axis=1)
        if inside.sum() >= 8:
            chains.append(image.pixels[inside] + random.normal(0, noise_px, (int(inside.sum()), 2)))
    return chains


def boards_at_the_right(seed):
    """Return four boards, none of them in the left half of the image."""
    detected = [
        d
        for s in (seed, seed + 100)
        for d in om.simulate_detections(TRUTH, BOARD, 8, noise_px=0.1, seed=s)
    ]
    right = [d for d in detected if d.corners_px[:, 0].mean() > MIDDLE[0]]
    return [replace(d, name=f"board {i}") for i, d in enumerate(right[:4])]


def errors_deg(camera):
    """Return direction errors (n,) after the best common rotation, and their predicted
    uncertainties."""
    pixels = np.stack(
        np.meshgrid(np.arange(20.0, 620.0, 15.0), np.arange(20.0, 470.0, 15.0)), axis=-1
    ).reshape(-1, 2)
    pixels = pixels[np.hypot(*(pixels - MIDDLE).T) < RADIUS]
    true, rays = TRUTH.backproject(pixels), camera.backproject(pixels)
    turn, _ = Rotation.align_vectors(true.directions, rays.directions)
    error_deg = np.degrees(np.linalg.norm(true.directions - turn.apply(rays.directions), axis=1))
    return error_deg, om.direction_uncertainty(camera, pixels, field_deg=180.0)


@cache
def board_calibration(seed):
    """Return the camera estimated from boards on the right."""
    return om.calibrate_camera(boards_at_the_right(seed), BOARD, model="unified").camera


@pytest.mark.full
def test_edges_extend_field_beyond_boards():
    """Against ground truth: direction error and predicted uncertainty decrease, and errors are
    within three sigma."""
    errors = []
    for seed in (0, 2):
        boards, rows = boards_at_the_right(seed), []
        with_edges = om.calibrate_camera(
            boards, BOARD, model="unified", lines={"room.jpg": edges(40, seed)}
        ).camera
        for camera in (board_calibration(seed), with_edges):
            error_deg, sigma = errors_deg(camera)
            assert (error_deg < 3 * sigma).mean() > 0.95
            rows.append((np.sqrt(np.mean(error_deg**2)), np.median(sigma)))
        assert rows[1][1] < 0.75 * rows[0][1]
        errors.append([error for error, _ in rows])
    boards_rms, joint_rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert joint_rms < 0.7 * boards_rms


def test_solution_minimises_points_and_edges():
    """Its gradient vanishes: large opposite contributions of points and edges balance."""
    points = np.random.default_rng(3).normal(0, 2000, (60, 3)) * [1, 1, 0.3]
    image = TRUTH.image(points)
    noise = np.random.default_rng(4).normal(0, 0.3, (int(image.valid.sum()), 2))
    observation = om.Observation(
        "room",
        image.pixels[image.valid] + noise,
        points[image.valid],
        RigidTransform.identity(),
        is_known=True,
    )
    marked = StraightEdges.of({"room.jpg": edges(20)}, np.inf, TRUTH.image_size)
    fit = om.bundle_adjust(TRUTH, [observation], edges=marked)
    linear, edge_information = (
        eliminate_line_positions(fit.linearised),
        marked.information(fit.model),
    )
    point_gradient = (
        np.einsum("nip,ni->p", linear.d_shared, linear.residuals) / fit.problem.noise_px**2
    )
    edge_gradient = edge_information.information @ (
        np.array([p.value for p in fit.model.parameters]) - edge_information.expected
    )
    scale = np.array([p.scale for p in fit.model.parameters])
    assert (
        np.abs(scale * (point_gradient + edge_gradient)).max()
        < 0.02 * np.abs(scale * point_gradient).max()
    )


def test_curved_edge_is_rejected():
    curved = edges(12)
    bend = np.linspace(-1, 1, len(curved[4])) ** 2
    curved[4] = curved[4] + 6.0 * bend[:, None]
    calibration = om.calibrate_camera(
        boards_at_the_right(1), BOARD, model="unified", lines={"room.jpg": curved}
    )
    assert [e.edge for e in calibration.edges if not e.used] == [5]
    assert "not used: edge 5 of room.jpg (" in calibration.notes[-1]
    assert calibration.to_dict()["edges"][4]["rms_px"] > 1.0
    error, sigma = errors_deg(calibration.camera)
    assert (error < 3 * sigma).mean() > 0.95


@pytest.mark.full
def test_edges_of_three_points_contribute():
    """Three points determine the distance of the middle one from the image of a line through the
    others."""
    lines = {"room.jpg": [edge[[0, len(edge) // 2, -1]] for edge in edges(40, noise_px=0.1)]}
    calibration = om.calibrate_camera(boards_at_the_right(0), BOARD, model="unified", lines=lines)
    assert sum(e.used for e in calibration.edges) >= 38
    error, _ = errors_deg(calibration.camera)
    boards_error, _ = errors_deg(board_calibration(0))
    assert np.sqrt(np.mean(error**2)) < np.sqrt(np.mean(boards_error**2))


def test_edges_and_surveyed_points_on_the_command_line(tmp_path):
    points = np.random.default_rng(3).normal(0, 2000, (60, 3)) * [1, 1, 0.3]
    image = TRUTH.project(points @ TRUTH.mount.rotation())
    rows = [
        f"{u:.3f},{v:.3f},{x},{y},{z}"
        for (u, v), (x, y, z) in zip(image.pixels[image.valid], points[image.valid], strict=True)
    ]
    (tmp_path / "room.csv").write_text("u_px,v_px,x_mm,y_mm,z_mm\n" + "\n".join(rows))
    marks = [f"wall.jpg,{i},{u:.3f},{v:.3f}" for i, edge in enumerate(edges(12)) for u, v in edge]
    (tmp_path / "edges.csv").write_text("image,line,u_px,v_px\n" + "\n".join(marks))
    arguments = ("--points", "room.csv", "--image-size", "640x480", "--model", "unified")
    run = omnimirror(
        "calibrate", *arguments, "--lines", "edges.csv", "--json", "found.json", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    assert "12 of 12 marked edges are straight with" in " ".join(run.stdout.split())
    report = json.loads((tmp_path / "found.json").read_text())["edges"]
    assert [(e["image"], e["edge"], e["used"]) for e in report] == [
        ("wall.jpg", i, True) for i in range(1, 13)
    ]
    output = fails("calibrate", "--lines", "edges.csv", "--image-size", "640x480", cwd=tmp_path)
    assert "to refine a known camera with --lines only, use omnimirror lines" in output


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        ({"a.jpg": edges(2)}, "lines must contain at least 3 edges; got 2"),
        (
            {"a.jpg": [*edges(3), np.zeros((2, 2))]},
            r"edge 4 of a.jpg must be an array \(n, 2\) with n >= 3; got shape \(2, 2\)",
        ),
        (
            {"a.jpg": edges(3), "b.jpg": [edges(1)[0] + [600, 0]]},
            "edge 1 of b.jpg: pixels must be inside the image of 640 x 480",
        ),
        (
            {"a.jpg": np.random.default_rng(0).uniform(0, 479, (9, 8, 2))},
            "edges must be straight for this camera",
        ),
    ],
)
def test_invalid_edges_raise(lines, message):
    with pytest.raises(InvalidParameter, match=message):
        om.calibrate_camera(boards_at_the_right(1), BOARD, model="unified", lines=lines)
