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
from ...base.logs import combine_steps
from ...calibration.estimation import Calibration, calibrate_camera
from ...calibration.targets import Board, Detection
from ...calibration.targets.board_detection import compared
from ...calibration.targets.frame_selection import select_distinct_frames
from ...cameras.camera import Mount
from ...optics.camera_files import format_camera
from ._board_detection_process import board_of
from ._calibration_boards import coverage_message, line_deviation_px, pose_of, taken
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

OnProgress = Callable[[CalibrationStatus], None]
LABELS = {
    "use --set camera.image_flipped=true": 'select "Camera driver flips images left to right"',
    "camera.image_flipped": '"Camera driver flips images left to right"',
    "camera.optics": '"Optics"',
    ": --prior NAME=VALUE+-SIGMA.": (
        "; specify it in the calibration on the command line, which the page displays."
    ),
}
"""Labels of the page for command-line options in messages."""


def perform(
    message: CalibrationRequest,
    images: Iterable[BoardDetection],
    on_progress: OnProgress,
    stop: Callable[[], bool],
) -> None:
    """Calibrate a camera and send progress, camera and report, or an error."""
    try:
        board = board_of(message.board)
        calibration = _calibrated(
            message,
            _usable([taken(detected, board) for detected in images], board),
            board,
            on_progress,
            stop,
        )
        on_progress(
            CalibrationStatus(
                state="done",
                message=_plain(calibration.summary),
                fraction=1.0,
                result=result_message(calibration),
            )
        )
        on_progress(
            CalibrationStatus(
                state="report",
                message="Report complete.",
                report=_report(calibration, message.command),
            )
        )
    except OmnimirrorError as e:
        on_progress(CalibrationStatus(state="failed", message=_plain(str(e))))


def _usable(detections: Sequence[Detection], board: Board) -> list[Detection]:
    """Mark inconsistent detections; select the distinct frames of a video."""
    checked = compared(detections, board)
    frames = [d for d in checked if d.time_s is not None]
    replies = {
        id(before): after
        for before, after in zip(frames, select_distinct_frames(frames, board), strict=True)
    }
    return [replies.get(id(d), d) for d in checked]


def _calibrated(
    message: CalibrationRequest,
    detections: Sequence[Detection],
    board: Board,
    on_progress: OnProgress,
    stop: Callable[[], bool],
) -> Calibration:
    def report(step: str, fraction: float) -> None:
        status = f"{step[:1].upper()}{step[1:]}"
        on_progress(CalibrationStatus(state="running", message=status, fraction=fraction))

    with combine_steps(report, "omnimirror.calibration") as progress:
        return calibrate_camera(
            detections,
            board,
            model=message.model,
            optics=message.optics,
            mount=Mount(message.camera_looks, image_flipped=message.image_flipped),
            centre_px=message.centre_px,
            rim_radius_px=message.rim_radius_px,
            board_shape=not message.flat_board,
            on_progress=progress,
            should_stop=stop,
        )


def _plain(message: str) -> str:
    """Convert a message of the command line to the labels of the page."""
    for option, label in LABELS.items():
        message = message.replace(option, label)
    return message


def _report(calibration: Calibration, command: str) -> str:
    from ..reports.calibration import calibration_html

    return calibration_html(calibration, command)


# -- messages --------------------------------------------------------------------------------------


def result_message(calibration: Calibration) -> CalibrationResult:
    """Convert a calibration to a message."""
    fit = calibration.adjustment
    used = {p.name for p in calibration.images if p.used}
    return CalibrationResult(
        kind=calibration.model.KIND,
        summary=calibration.summary,
        rms_px=calibration.rms_px,
        held_out_rms_px=finite(calibration.held_out_rms_px),
        corners=calibration.corners,
        seconds=calibration.seconds,
        is_complete=calibration.is_complete,
        image_size=fit.model.image_size,
        images=_image_entries(calibration),
        parameters=tuple(
            ParameterEstimate(name=p.name, value=p.value, sigma=p.sigma or None, unit=p.unit)
            for p in calibration.parameters
        ),
        models=tuple(
            ModelComparisonRow(
                kind=c.kind,
                parameters=c.parameters,
                rms_px=c.rms_px,
                held_out_rms_px=finite(c.held_out_rms_px),
                reason=c.why,
            )
            for c in sorted(calibration.candidates, key=lambda c: c.rms_px)
        ),
        outliers=tuple(
            OutlierCorner(image=o.image, corner=o.corner, residual_px=o.residual_px)
            for o in calibration.outliers
        ),
        notes=tuple(map(_plain, calibration.notes)),
        advice=tuple(map(_plain, calibration.advice)),
        coverage=coverage_message(calibration.coverage),
        poses=tuple(
            pose_of(s, calibration.model, calibration.board)
            for s in fit.observations
            if s.name in used
        ),
        camera_file=format_camera(calibration.camera, calibration.summary),  # type: ignore[arg-type]  # a calibrated camera has a file format
    )


def _image_entries(calibration: Calibration) -> tuple[CalibrationImage, ...]:
    fit = calibration.adjustment
    slices = dict(zip((s.name for s in fit.observations), fit.problem.stack.slices, strict=True))
    observations = {s.name: s for s in fit.observations}
    pixels, visible = fit.problem.stack.pixels, fit.visible
    images = []
    for entry in calibration.images:
        rows: tuple[tuple[float, float, float, float], ...] = ()
        held = off = None
        if entry.used:
            where = slices[entry.name]
            both = np.hstack([pixels[where], fit.residuals[where]])[visible[where]]
            rows = tuple(tuple(row) for row in np.round(both, 4).tolist())
            off = finite(
                line_deviation_px(observations[entry.name], calibration.model, calibration.board)
            )
            if calibration.held_out is not None:
                held = finite(
                    float(
                        np.sqrt(np.mean(np.sum(calibration.held_out.residuals[where] ** 2, axis=1)))
                    )
                )
        images.append(
            CalibrationImage(
                name=entry.name,
                corners=entry.found,
                used=entry.used,
                reason=entry.reason,
                rms_px=entry.rms_px,
                held_out_rms_px=held,
                line_deviation_px=off,
                residuals=rows,
            )
        )
    return tuple(images)


def finite(value: float) -> float | None:
    """Convert to a JSON-serialisable number: None for non-finite values."""
    return value if np.isfinite(value) else None


def main(stream: TextIO) -> None:
    """Run the calibration of the input."""
    message = CalibrationRequest.model_validate_json(stream.readline())
    images = [BoardDetection.model_validate_json(stream.readline()) for _ in range(message.images)]
    stopping = threading.Event()

    def listen() -> None:
        if stream.readline().strip() == STOP:
            stopping.set()

    threading.Thread(target=listen, daemon=True).start()
    perform(
        message, images, lambda news: print(news.model_dump_json(), flush=True), stopping.is_set
    )


if __name__ == "__main__":
    main(sys.stdin)
