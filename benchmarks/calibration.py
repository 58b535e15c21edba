"""Measure the accuracy of detected corners, calibrated cameras and straight edges against a known truth.

Boards are rendered with a grid of rays per pixel; edges are extracted from an image of the simulated room. Only the
reported durations depend on the machine. Residuals of real photographs are included.

    python benchmarks/calibration.py -o out/benchmarks --data DATA
    python benchmarks/update_tables.py --tables out/benchmarks
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from measurement_conditions import processor_name

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.cameras.camera import Camera, Mount
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.calibration.targets.rendering import photographed, pose

BOARD = om.Board("chessboard", 9, 6, 30.0)
SENSORS = ("paper-spherical", "prototype-hyperboloidal")
AZIMUTH_ELEVATION_DEG = [
    (40, -30),
    (130, -30),
    (220, -20),
    (300, -20),
    (10, -45),
    (180, -10),
]  # azimuth, elevation, deg
ROTATIONS_DEG = [(0, 15, 30), (0, -20, -20), (10, 0, 60)]
IMAGE_SIZE_PX = 640


class ImageConditions(NamedTuple):
    """Conditions of the rendered board images."""

    distance_mm: float
    blur_px: float
    noise: float
    quality: int


CONDITIONS = [
    ImageConditions(330, 0.5, 2, 95),
    ImageConditions(330, 2.0, 5, 80),
    ImageConditions(800, 0.5, 6, 70),
    ImageConditions(1100, 0.6, 3, 90),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument(
        "--data",
        type=Path,
        help="folder with kaidan_omni and ocamcalib_cpp_sample, for the rows of photographs",
    )
    arguments = parser.parse_args()
    tables = {
        "calibration_corners": corners,
        "calibration_lines": lines,
        "calibration_boards_and_edges": boards_and_edges,
    }
    if arguments.data:
        tables["calibration_photographs"] = photographs
    for name, table in tables.items():
        text = f"{table(arguments.data)}\n"
        write_text(arguments.output / f"{name}.md", text)
        print(f"{name}\n\n{text}", flush=True)


def corners(_: Path | None) -> str:
    """Return a table of corner detection errors."""
    rows = [
        "| size of squares | blur, noise, JPEG quality | detected corners | RMS error, px "
        "| mean radial error, px | `cornerSubPix`: RMS error, mean radial error, px |",
        "|---|---|---|---|---|---|",
    ]
    for conditions in CONDITIONS:
        omnimirror_errors, opencv_errors, spacings, corner_count = (
            np.concatenate(part) for part in zip(*_boards(conditions), strict=True)
        )
        low, high = np.percentile(spacings, [5, 95])
        rows.append(
            f"| {low:.0f} to {high:.0f} px | {conditions.blur_px:g} px, {conditions.noise:g} of 255, "
            f"{conditions.quality} | {len(omnimirror_errors)} of "
            f"{corner_count.sum():.0f} | {_rms(omnimirror_errors):.3f} | "
            f"{omnimirror_errors[:, 2].mean():+.3f} | {_rms(opencv_errors):.3f}, {opencv_errors[:, 2].mean():+.3f} |"
        )
    return "\n".join(rows)


def _boards(conditions: ImageConditions) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield for each board: errors (n, 3) of its corners in u, v and radially, those of OpenCV,
    corner spacing in px, and number of corners."""
    for name in SENSORS:
        sensor = om.load_sensor(name)
        for seed, (azimuth, elevation) in enumerate(AZIMUTH_ELEVATION_DEG):
            board_pose = pose(
                BOARD,
                azimuth,
                elevation,
                conditions.distance_mm,
                *ROTATIONS_DEG[seed % len(ROTATIONS_DEG)],
            )
            rendered = photographed(
                sensor,
                BOARD,
                board_pose,
                seed=seed,
                **dict(zip(conditions._fields[1:], conditions[1:], strict=True)),
            )
            if not np.isfinite(rendered.corners_px).all():
                continue
            result = om.find_board(rendered.image, BOARD)
            grid = rendered.corners_px.reshape(BOARD.rows, BOARD.columns, 2)
            spacing = np.linalg.norm(np.diff(grid, axis=1), axis=2).ravel()
            window = (max(2, int(0.35 * spacing.min())),) * 2
            stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
            start = np.ascontiguousarray(np.rint(rendered.corners_px)[:, None], dtype=np.float32)
            refined = cv2.cornerSubPix(rendered.image, start, window, (-1, -1), stop)[:, 0].astype(
                float
            )
            centre = np.array(sensor.imager.centre)
            yield (
                _errors(result.corners_px, rendered.corners_px, centre),
                _errors(refined, rendered.corners_px, centre),
                spacing,
                np.array([len(grid) * BOARD.columns]),
            )


def _errors(result: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return errors relative to the nearest true corner, because detectors order the corners of a
    chessboard differently."""
    if len(result) == 0:
        return np.zeros((0, 3))
    nearest = truth[np.argmin(np.linalg.norm(result[:, None] - truth, axis=2), axis=1)]
    outwards = (nearest - centre) / np.linalg.norm(nearest - centre, axis=1)[:, None]
    error = result - nearest
    return np.column_stack([error, (error * outwards).sum(axis=1)])


def _rms(errors: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(errors[:, :2] ** 2, axis=1))))


def lines(data: Path | None) -> str:
    """Return a table of cameras estimated from the straight edges of one image."""
    rows = [
        "| image | camera | RMS error of directions | median predicted standard deviation | within 3 sigma |",
        "|---|---|---|---|---|",
    ]
    hyperboloid, ball = (
        _sensor("paper-hyperboloidal"),
        replace(_sensor("paper-spherical"), mirror_pose=MirrorPose(0.5, -0.3, 0.4, 0.2)),
    )
    for label, truth, nominal in (
        ("simulated room, hyperboloid", hyperboloid, hyperboloid),
        ("simulated room, misaligned ball", ball, replace(ball, mirror_pose=MirrorPose())),
    ):
        image = om.render_image(truth, om.Room(texel_mm=20.0), samples=4)
        nominal = replace(
            nominal, lens=replace(nominal.lens, focal_length_mm=1.03 * nominal.lens.focal_length_mm)
        )
        free_model = om.SensorModel(replace(nominal, mount=Mount("up")), ("focal", "decentre"))
        outline = {
            "centre_px": truth.imager.centre,
            "radius_px": truth.aligned().rim_radius_px,
            "inner_radius_px": 30.0,
        }
        pixels = np.random.default_rng(0).uniform(0, IMAGE_SIZE_PX, (2000, 2))
        for camera_label, model in (
            (
                "nominal sensor with an error of the focal length of 3 %; focal length and decentre free",
                free_model,
            ),
            ("unknown", None),
        ):
            result = om.calibrate_plumb_lines([image], model=model, **outline)
            rows.append(
                f"| {label} | {camera_label} | {_directions(truth, result.camera, pixels)} |"
            )
    if data and (folder := data / "ocamcalib_cpp_sample").exists():
        reference = om.load_ocam(folder / "calib_results_catadioptric.txt")
        image = om.read_image(folder / "test_catadioptric.jpg")
        result = om.calibrate_plumb_lines(
            [image], centre_px=reference.centre_px, radius_px=370.0, inner_radius_px=80.0
        )
        phi = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        rings = [
            r * np.stack([np.cos(phi), np.sin(phi)], axis=-1) for r in np.linspace(90.0, 350.0, 27)
        ]
        pixels = np.array(reference.centre_px) + np.concatenate(rings)
        label = "OCamCalib's sample photograph, compared with its authors' calibration"
        rows.append(f"| {label} | unknown | {_directions(reference, result.camera, pixels)} |")
    return "\n".join(rows)


def _sensor(name: str) -> om.Sensor:
    """Return a tilted sensor with a small imager."""
    sensor = om.load_sensor(name)
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / IMAGE_SIZE_PX
    imager = replace(
        sensor.imager, width_px=IMAGE_SIZE_PX, height_px=IMAGE_SIZE_PX, pixel_pitch_um=pitch
    )
    return replace(sensor, imager=imager, mount=Mount("up", -90.0, False, 3.0, -2.0))


def _directions(truth: Camera, camera: Camera, pixels: np.ndarray) -> str:
    """Format the direction error in the camera frame, its predicted value, and the fraction within
    three sigma."""
    a, b = truth.backproject(pixels), camera.backproject(pixels)
    valid = a.valid & b.valid
    true, result = (
        (rays.directions @ c.mount.rotation())[valid] for rays, c in ((a, truth), (b, camera))
    )
    deviation = np.degrees(np.linalg.norm(np.cross(true, result), axis=1))
    predicted = om.direction_uncertainty(camera, pixels[valid], field_deg=180.0)
    return (
        f"{_deg(np.sqrt(np.mean(deviation**2)))} | {_deg(np.median(predicted))} "
        f"| {100 * np.mean(deviation < 3 * predicted):.0f} %"
    )


def _deg(angle: float) -> str:
    return f"{angle:.2g} deg"


def boards_and_edges(_: Path | None) -> str:
    """Measure the gain from adding 40 edges over the whole field to six boards in the right half of
    an image, over six image sets."""
    from tests.calibration.estimation.test_edges import BOARD as LARGE_BOARD
    from tests.calibration.estimation.test_edges import boards_at_the_right, edges, errors_deg

    rows = ["| | RMS error of directions | RMS predicted standard deviation |", "|---|---|---|"]
    for label, with_edges in (
        ("six boards in the right half", False),
        ("the same boards, and 40 edges at all azimuths", True),
    ):
        errors, predicted = [], []
        for seed in range(6):
            lines_by_image = {"room.jpg": edges(40, seed)} if with_edges else None
            result = om.calibrate_camera(
                boards_at_the_right(seed), LARGE_BOARD, model="unified", lines=lines_by_image
            )
            deviation, sigma = errors_deg(result.camera)
            errors.append(np.mean(deviation**2))
            predicted.append(np.mean(sigma**2))
        rows.append(
            f"| {label} | {_deg(np.sqrt(np.mean(errors)))} | {_deg(np.sqrt(np.mean(predicted)))} |"
        )
    return "\n".join(rows)


def photographs(data: Path) -> str:
    """Return a table of models fitted to the photographs of a consumer mirror."""
    board = om.Board("chessboard", 11, 7, 30.0)
    paths = sorted(
        (data / "kaidan_omni").glob("*.jpg"), key=lambda path: (len(path.name), path.name)
    )
    start = time.perf_counter()
    detections = om.find_boards(paths, board)
    detection_s = time.perf_counter() - start
    rows = ["| | images | RMS, px | held-out RMS, px | time, s |", "|---|---|---|---|---|"]
    for model in ("unified", "radial-spline", "viewpoint-spline", "sensor", "auto"):
        start = time.perf_counter()
        result = om.calibrate_camera(detections, board, model=model)
        duration_s = time.perf_counter() - start
        used = sum(image.used for image in result.images)
        name = f"`{model}`" + (f"; selected: `{result.model.KIND}`" if model == "auto" else "")
        rows.append(
            f"| {name} | {used} | {result.rms_px:.3f} | {result.held_out_rms_px:.3f} | {duration_s:.1f} |"
        )
    corner_count = sum(len(detection.ids) for detection in detections)
    return (
        "\n".join(rows)
        + f"\n\n{corner_count} corners, detected in {detection_s:.1f} s ({processor_name()})."
    )


if __name__ == "__main__":
    main()
