"""Measure the accuracy of detected corners, calibrated cameras and straight edges against a known truth.

Boards are rendered with a grid of rays per pixel; edges are extracted from an image of the simulated room. Only the
reported durations depend on the machine. Residuals of real photographs are included.

    python benchmarks/calibration.py --out out/benchmarks --data ../shared/data
    python benchmarks/tables_to_docs.py --tables out/benchmarks
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

from circumstances import processor

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.cameras.frames import Mount
from omnimirror.optics.mirrors.as_built import MirrorPose
from tests.calibration.targets.rendering import photographed, pose

BOARD = om.Board("chessboard", 9, 6, 30.0)
SENSORS = ("paper-spherical", "prototype-hyperboloidal")
AROUND = [
    (40, -30),
    (130, -30),
    (220, -20),
    (300, -20),
    (10, -45),
    (180, -10),
]  # azimuth, elevation, deg
TURNS = [(0, 15, 30), (0, -20, -20), (10, 0, 60)]
SIZE = 640


class Taken(NamedTuple):
    """Conditions of the rendered board images."""

    distance_mm: float
    blur_px: float
    noise: float
    quality: int


CONDITIONS = [
    Taken(330, 0.5, 2, 95),
    Taken(330, 2.0, 5, 80),
    Taken(800, 0.5, 6, 70),
    Taken(1100, 0.6, 3, 90),
]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument(
        "--data",
        type=Path,
        help="folder with kaidan_omni and ocamcalib_cpp_sample, for the rows of photographs",
    )
    arguments = parser.parse_args()
    tables = {
        "calibration_corners": corners,
        "calibration_lines": lines,
        "calibration_beside_boards": beside_boards,
    }
    if arguments.data:
        tables["calibration_photographs"] = photographs
    for name, table in tables.items():
        text = f"{table(arguments.data)}\n"
        write_text(arguments.out / f"{name}.md", text)
        print(f"{name}\n\n{text}", flush=True)


def corners(_: Path | None) -> str:
    """Return a table of corner detection errors."""
    rows = [
        "| squares | blur, noise, JPEG quality | corners found | RMS px in two dimensions "
        "| along the radius px | `cornerSubPix` RMS px, along the radius px |",
        "|---|---|---|---|---|---|",
    ]
    for taken in CONDITIONS:
        ours, theirs, spacings, looked_for = (
            np.concatenate(part) for part in zip(*_boards(taken), strict=True)
        )
        low, high = np.percentile(spacings, [5, 95])
        rows.append(
            f"| {low:.0f} to {high:.0f} px | {taken.blur_px:g} px, {taken.noise:g} of 255, "
            f"{taken.quality} | {len(ours)} of {looked_for.sum():.0f} | {_rms(ours):.3f} | "
            f"{ours[:, 2].mean():+.3f} | {_rms(theirs):.3f}, {theirs[:, 2].mean():+.3f} |"
        )
    return "\n".join(rows)


def _boards(taken: Taken) -> Iterator[tuple[np.ndarray, ...]]:
    """Yield for each board: errors (n, 3) of its corners in u, v and radially, those of OpenCV,
    corner spacing in px, and number of corners."""
    for name in SENSORS:
        sensor = om.load_sensor(name)
        for seed, (azimuth, elevation) in enumerate(AROUND):
            place = pose(BOARD, azimuth, elevation, taken.distance_mm, *TURNS[seed % len(TURNS)])
            shot = photographed(
                sensor,
                BOARD,
                place,
                seed=seed,
                **dict(zip(taken._fields[1:], taken[1:], strict=True)),
            )
            if not np.isfinite(shot.corners_px).all():
                continue
            found = om.find_board(shot.picture, BOARD)
            grid = shot.corners_px.reshape(BOARD.rows, BOARD.columns, 2)
            spacing = np.linalg.norm(np.diff(grid, axis=1), axis=2).ravel()
            window = (max(2, int(0.35 * spacing.min())),) * 2
            stop = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 40, 1e-3)
            start = np.ascontiguousarray(np.rint(shot.corners_px)[:, None], dtype=np.float32)
            refined = cv2.cornerSubPix(shot.picture, start, window, (-1, -1), stop)[:, 0].astype(
                float
            )
            centre = np.array(sensor.imager.centre)
            yield (
                _errors(found.corners_px, shot.corners_px, centre),
                _errors(refined, shot.corners_px, centre),
                spacing,
                np.array([len(grid) * BOARD.columns]),
            )


def _errors(found: np.ndarray, truth: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """Return errors relative to the nearest true corner, because detectors order the corners of a
    chessboard differently."""
    if len(found) == 0:
        return np.zeros((0, 3))
    nearest = truth[np.argmin(np.linalg.norm(found[:, None] - truth, axis=2), axis=1)]
    outwards = (nearest - centre) / np.linalg.norm(nearest - centre, axis=1)[:, None]
    error = found - nearest
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
    for words, truth, drawn in (
        ("simulated room, hyperboloid", hyperboloid, hyperboloid),
        ("simulated room, misaligned ball", ball, replace(ball, mirror_pose=MirrorPose())),
    ):
        picture = om.render_image(truth, om.Room(texel_mm=20.0), samples=4)
        drawn = replace(
            drawn, lens=replace(drawn.lens, focal_length_mm=1.03 * drawn.lens.focal_length_mm)
        )
        freed = om.SensorModel(replace(drawn, mount=Mount("up")), ("focal", "decentre"))
        where = {
            "centre_px": truth.imager.centre,
            "radius_px": truth.aligned().rim_radius_px,
            "inner_radius_px": 30.0,
        }
        pixels = np.random.default_rng(0).uniform(0, SIZE, (2000, 2))
        for kind, model in (
            (
                "nominal sensor with an error of the focal length of 3 %; focal length and decentre free",
                freed,
            ),
            ("unknown", None),
        ):
            found = om.calibrate_plumb_lines([picture], model=model, **where)
            rows.append(f"| {words} | {kind} | {_directions(truth, found.camera, pixels)} |")
    if data and (folder := data / "ocamcalib_cpp_sample").exists():
        known = om.load_ocam(folder / "calib_results_catadioptric.txt")
        picture = om.read_image(folder / "test_catadioptric.jpg")
        found = om.calibrate_plumb_lines(
            [picture], centre_px=known.centre_px, radius_px=370.0, inner_radius_px=80.0
        )
        phi = np.linspace(0, 2 * np.pi, 64, endpoint=False)
        rings = [
            r * np.stack([np.cos(phi), np.sin(phi)], axis=-1) for r in np.linspace(90.0, 350.0, 27)
        ]
        pixels = np.array(known.centre_px) + np.concatenate(rings)
        words = "OCamCalib's sample photograph, compared with its authors' calibration"
        rows.append(f"| {words} | unknown | {_directions(known, found.camera, pixels)} |")
    return "\n".join(rows)


def _sensor(name: str) -> om.Sensor:
    """Return a tilted sensor with a small imager."""
    sensor = om.load_sensor(name)
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / SIZE
    imager = replace(sensor.imager, width_px=SIZE, height_px=SIZE, pixel_pitch_um=pitch)
    return replace(sensor, imager=imager, mount=Mount("up", -90.0, False, 3.0, -2.0))


def _directions(truth: om.Camera, camera: om.Camera, pixels: np.ndarray) -> str:
    """Format the direction error in the camera frame, its predicted value, and the fraction within
    three sigma."""
    a, b = truth.backproject(pixels), camera.backproject(pixels)
    both = a.valid & b.valid
    true, found = (
        (rays.directions @ c.mount.rotation())[both] for rays, c in ((a, truth), (b, camera))
    )
    off = np.degrees(np.linalg.norm(np.cross(true, found), axis=1))
    said = om.direction_uncertainty(camera, pixels[both], field_deg=180.0)
    return f"{_deg(np.sqrt(np.mean(off**2)))} | {_deg(np.median(said))} | {100 * np.mean(off < 3 * said):.0f} %"


def _deg(angle: float) -> str:
    return f"{angle:.2g} deg"


def beside_boards(_: Path | None) -> str:
    """Measure the gain from adding 40 edges over the whole field to six boards in the right half of
    an image, over six image sets."""
    from tests.calibration.estimation.test_edges import BOARD as LARGER
    from tests.calibration.estimation.test_edges import boards_at_the_right, edges, errors_deg

    rows = ["| | RMS error of directions | RMS predicted standard deviation |", "|---|---|---|"]
    for words, with_edges in (
        ("six boards in the right half", False),
        ("the same boards, and forty edges at all azimuths", True),
    ):
        errors, said = [], []
        for seed in range(6):
            marked = {"room.jpg": edges(40, seed)} if with_edges else None
            found = om.calibrate_camera(
                boards_at_the_right(seed), LARGER, model="unified", lines=marked
            )
            off, sigma = errors_deg(found.camera)
            errors.append(np.mean(off**2))
            said.append(np.mean(sigma**2))
        rows.append(
            f"| {words} | {_deg(np.sqrt(np.mean(errors)))} | {_deg(np.sqrt(np.mean(said)))} |"
        )
    return "\n".join(rows)


def photographs(data: Path) -> str:
    """Return a table of models fitted to the photographs of a consumer mirror."""
    board = om.Board("chessboard", 11, 7, 30.0)
    paths = sorted(
        (data / "kaidan_omni").glob("*.jpg"), key=lambda path: (len(path.name), path.name)
    )
    began = time.perf_counter()
    detections = om.find_boards(paths, board)
    looking = time.perf_counter() - began
    rows = ["| | images | RMS px | held-out RMS px | seconds |", "|---|---|---|---|---|"]
    for model in ("unified", "radial-spline", "viewpoint-spline", "sensor", "auto"):
        began = time.perf_counter()
        found = om.calibrate_camera(detections, board, model=model)
        taken = time.perf_counter() - began
        used = sum(picture.used for picture in found.images)
        name = f"`{model}`" + (f", which takes `{found.model.KIND}`" if model == "auto" else "")
        rows.append(
            f"| {name} | {used} | {found.rms_px:.3f} | {found.held_out_rms_px:.3f} | {taken:.1f} |"
        )
    corners_found = sum(len(detection.ids) for detection in detections)
    return (
        "\n".join(rows) + f"\n\n{corners_found} corners, found in {looking:.1f} s ({processor()})."
    )


if __name__ == "__main__":
    main()
