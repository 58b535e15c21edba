"""Calibration process: estimates a camera from detected boards and writes its report.

Run as ``python -m omnimirror.apps.studio._calibration_process``, it reads the request and one detection
per line from standard input and writes one progress message per line; the line ``stop`` ends it
early with the best camera.
"""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterable, Sequence
from typing import TextIO

import numpy as np

from ...base.errors import OmnimirrorError
from ...calibration.estimation import Calibration, calibrate_camera
from ...calibration.targets import Board, Detection
from ...calibration.targets.board_detection import compared
from ...calibration.targets.frame_selection import select_distinct_frames
from ...cameras.frames import Mount
from ...optics.sensor_files import format_camera
from ._board_detection_process import board_of
from ._calibration_boards import coverage_shown, line_deviation_px, place_of, taken
from .calibration_messages import (
    STOP,
    BoardDetection,
    CalibrationImage,
    CalibrationRequest,
    CalibrationResult,
    CalibrationStatus,
    ModelComparisonRow,
    OutlierCorner,
    ParameterEstimate,
)

Tell = Callable[[CalibrationStatus], None]
LABELS = {
    "use --set camera.image_flipped=true": 'select "Camera driver flips images left to right"',
    "camera.image_flipped": '"Camera driver flips images left to right"',
    "camera.optics": '"Optics"',
}
"""Labels of the page for command-line options in messages."""


def perform(
    ask: CalibrationRequest,
    pictures: Iterable[BoardDetection],
    tell: Tell,
    stop: Callable[[], bool],
) -> None:
    """Calibrate a camera and send progress, camera and report, or an error."""
    try:
        board = board_of(ask.board)
        found = _calibrated(
            ask, _usable([taken(seen, board) for seen in pictures], board), board, tell, stop
        )
        tell(
            CalibrationStatus(
                state="done", sentence=found.summary, share=1.0, found=found_message(found)
            )
        )
        tell(
            CalibrationStatus(
                state="reported", sentence="Report complete.", report=_report(found, ask.command)
            )
        )
    except OmnimirrorError as e:
        tell(CalibrationStatus(state="failed", sentence=_plain(str(e))))


def _usable(detections: Sequence[Detection], board: Board) -> list[Detection]:
    """Mark inconsistent detections; select the distinct frames of a video."""
    judged = compared(detections, board)
    frames = [d for d in judged if d.time_s is not None]
    told = {
        id(before): after
        for before, after in zip(frames, select_distinct_frames(frames, board), strict=True)
    }
    return [told.get(id(d), d) for d in judged]


def _calibrated(
    ask: CalibrationRequest,
    detections: Sequence[Detection],
    board: Board,
    tell: Tell,
    stop: Callable[[], bool],
) -> Calibration:
    def progress(what: str, share: float) -> None:
        tell(
            CalibrationStatus(
                state="running", sentence=f"{what[:1].upper()}{what[1:]}", share=share
            )
        )

    return calibrate_camera(
        detections,
        board,
        model=ask.model,
        optics=ask.optics,
        mount=Mount(ask.camera_looks, image_flipped=ask.image_flipped),
        centre_px=ask.centre_px,
        rim_radius_px=ask.rim_radius_px,
        board_shape=not ask.flat_board,
        on_progress=progress,
        should_stop=stop,
    )


def _plain(sentence: str) -> str:
    """Convert a message of the command line to the labels of the page."""
    for option, label in LABELS.items():
        sentence = sentence.replace(option, label)
    return sentence


def _report(found: Calibration, command: str) -> str:
    from ..reports.calibration import calibration_html

    return calibration_html(found, command)


# -- messages --------------------------------------------------------------------------------------


def found_message(found: Calibration) -> CalibrationResult:
    """Convert a calibration to a message."""
    fit = found.adjustment
    used = {p.name for p in found.images if p.used}
    return CalibrationResult(
        kind=found.model.KIND,
        summary=found.summary,
        rms_px=found.rms_px,
        held_out_rms_px=finite(found.held_out_rms_px),
        corners=found.corners,
        seconds=found.seconds,
        is_complete=found.is_complete,
        image_size=fit.model.image_size,
        pictures=_pictures(found),
        parameters=tuple(
            ParameterEstimate(name=p.name, value=p.value, sigma=p.sigma or None, unit=p.unit)
            for p in found.parameters
        ),
        models=tuple(
            ModelComparisonRow(**(c._asdict() | {"held_out_rms_px": finite(c.held_out_rms_px)}))
            for c in sorted(found.candidates, key=lambda c: c.rms_px)
        ),
        outliers=tuple(
            OutlierCorner(picture=o.image, corner=o.corner, residual_px=o.residual_px)
            for o in found.outliers
        ),
        notes=found.notes,
        advice=found.advice,
        coverage=coverage_shown(found.coverage),
        places=tuple(
            place_of(s, found.model, found.board) for s in fit.observations if s.name in used
        ),
        camera_file=format_camera(found.camera, found.summary),  # type: ignore[arg-type]
    )


def _pictures(found: Calibration) -> tuple[CalibrationImage, ...]:
    fit = found.adjustment
    slices = dict(zip((s.name for s in fit.observations), fit.problem.stack.slices, strict=True))
    observations = {s.name: s for s in fit.observations}
    pixels, seen = fit.problem.stack.pixels, fit.visible
    told = []
    for picture in found.images:
        rows: tuple[tuple[float, float, float, float], ...] = ()
        held = off = None
        if picture.used:
            where = slices[picture.name]
            both = np.hstack([pixels[where], fit.residuals[where]])[seen[where]]
            rows = tuple(tuple(row) for row in np.round(both, 4).tolist())
            off = finite(line_deviation_px(observations[picture.name], found.model, found.board))
            if found.held_out is not None:
                held = finite(
                    float(np.sqrt(np.mean(np.sum(found.held_out.residuals[where] ** 2, axis=1))))
                )
        told.append(
            CalibrationImage(
                name=picture.name,
                found=picture.found,
                used=picture.used,
                reason=picture.reason,
                rms_px=picture.rms_px,
                held_out_rms_px=held,
                line_deviation_px=off,
                residuals=rows,
            )
        )
    return tuple(told)


def finite(value: float) -> float | None:
    """Convert to a JSON-serialisable number: None for non-finite values."""
    return value if np.isfinite(value) else None


def main(given: TextIO) -> None:
    """Run the calibration of the input."""
    ask = CalibrationRequest.model_validate_json(given.readline())
    pictures = [BoardDetection.model_validate_json(given.readline()) for _ in range(ask.pictures)]
    stopping = threading.Event()

    def listen() -> None:
        if given.readline().strip() == STOP:
            stopping.set()

    threading.Thread(target=listen, daemon=True).start()
    perform(ask, pictures, lambda news: print(news.model_dump_json(), flush=True), stopping.is_set)


if __name__ == "__main__":
    main(sys.stdin)
