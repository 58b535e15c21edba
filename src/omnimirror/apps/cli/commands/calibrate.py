"""``omnimirror calibrate``: camera calibration from images of a target."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ....base import interrupts
from ....base.arguments import format_value, parse_float
from ....base.errors import OmnimirrorError
from ....base.escaping import shell_command
from ....base.files import is_stream
from ....base.logs import OnProgress, forward_steps
from ....calibration.estimation import (
    Calibration,
    Prior,
    SurveyData,
    calibrate_camera,
    read_observations,
)
from ....calibration.estimation.model_sequence import KINDS
from ....calibration.sensor_model import SensorModel
from ....calibration.straight_edges import read_line_points
from ....calibration.targets import Board, Detection, select_frames
from ....calibration.targets.board_detection import find_boards
from ....cameras.camera import CameraLooks, Mount
from ....cameras.models.camera_model import CameraModel, Optics
from ....dewarp.request import is_video
from ....io.batch import READABLE_IMAGE_SUFFIXES, expand_inputs
from ....optics.camera_files import load_camera
from ....optics.sensor import Sensor
from .._board_options import OptionalBoardOptions
from .._camera_options import OrientationOptions
from .._declarations import (
    DocumentedCommand,
    Options,
    add_options,
    angle,
    distance,
    full_image_size,
    option,
    pixel,
    setting,
)
from .._output import (
    Output,
    output_console,
    plain_table,
    print_line,
    print_notice,
    print_written,
    progress_bar,
)

MAX_OUTLIERS = 12


def names(text: str) -> tuple[str, ...]:
    """Parse comma-separated names.

    >>> names("focal_px, centre_px")
    ('focal_px', 'centre_px')
    """
    return tuple(name.strip() for name in text.split(","))


def prior(text: str) -> Prior:
    """Parse prior knowledge of a parameter: ``NAME=VALUE+-SIGMA``, or ``NAME=VALUE`` to fix it.

    >>> prior("xi=0.97+-0.02")
    Prior(name='xi', value=0.97, sigma=0.02)
    """
    match = re.fullmatch(r"([\w.\[\]]+)=([^+±]+?|[^±]+?)(?:(?:\+-|±)(.+))?", text.strip())
    try:
        if match:
            name, value, sigma = match.groups()
            parsed = Prior(
                name,
                parse_float(value.strip()),
                0.0 if sigma is None else parse_float(sigma.strip()),
            )
            if np.isfinite(parsed[1:]).all() and parsed.sigma >= 0:
                return parsed
    except ValueError:
        pass
    raise click.BadParameter(
        f"must be NAME=VALUE+-SIGMA, such as lens.focal_length_mm=8+-0.1; got {format_value(text)}"
    )


@dataclass(frozen=True)
class CameraModelOptions(Options):
    """Camera model, with the parameters of :func:`omnimirror.calibrate_camera`."""

    model: str = option(
        default="auto",
        metavar="NAME|FILE",
        help=f"Model: auto, {', '.join(KINDS)}; or a sensor or camera as initial value.",
    )
    camera_looks: CameraLooks = option(
        default="up",
        type=click.Choice(["up", "down", "forward"]),
        metavar="DIRECTION",
        help="Orientation of the optical axis: up, down or forward.",
    )
    optics: Optics = setting("camera", "mirror")
    forward_azimuth_deg: float = setting("camera", -90.0, type=angle)
    image_flipped: bool = setting("camera", False)
    centre_px: tuple[float, float] | None = setting("camera", type=pixel)
    rim_radius_px: float | None = setting("camera")
    free: tuple[str, ...] | None = setting("camera", type=names)

    def initial_model(self) -> str | CameraModel | Sensor:
        """Return the kind of model, or the model that provides initial values."""
        if self.model == "auto" or self.model in KINDS:
            if self.free is not None:
                raise click.UsageError(
                    "camera.free requires a sensor as initial value; specify it with --model"
                )
            return self.model
        camera = load_camera(self.model)
        if isinstance(camera, Sensor):
            return SensorModel(camera) if self.free is None else SensorModel(camera, self.free)
        if self.free is not None:
            raise click.UsageError(
                f"camera.free requires a sensor; {self.model} is a {camera.KIND} camera"
            )
        return camera

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of :func:`omnimirror.calibrate_camera`."""
        mount = Mount(self.camera_looks, self.forward_azimuth_deg, self.image_flipped)
        return {
            "model": self.initial_model(),
            "optics": self.optics,
            "mount": mount,
            "centre_px": self.centre_px,
            "rim_radius_px": self.rim_radius_px,
        }


@dataclass(frozen=True)
class EstimationOptions(Options):
    """Camera model, fixed parameters and priors."""

    priors: tuple[Prior, ...] = option(
        "--prior",
        default=(),
        multiple=True,
        type=prior,
        metavar="NAME=VALUE+-SIGMA",
        show_default=False,
        help="Prior of a parameter, which is fixed without +-SIGMA (repeatable).",
    )
    fixed: tuple[str, ...] = setting("estimation", (), type=names)
    board_shape: bool = setting("estimation", True)
    seed: int = setting("estimation", 0)

    def arguments(self) -> dict[str, Any]:
        """Return the arguments of :func:`omnimirror.calibrate_camera`."""
        return {
            "fixed": self.fixed,
            "priors": self.priors,
            "board_shape": self.board_shape,
            "seed": self.seed,
        }


@dataclass(frozen=True)
class SurveyOptions(Options):
    """Survey data, with the parameters of :func:`omnimirror.read_observations`."""

    points: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Known points, CSV: u_px,v_px,x_mm,y_mm,z_mm (repeatable).",
    )
    directions: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Known directions, CSV: u_px,v_px,azimuth_deg,elevation_deg (repeatable).",
    )
    lines: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px (repeatable).",
    )
    image_size: tuple[int, int] | None = option(
        type=full_image_size,
        metavar="WxH",
        help="Image size, required if no image of a board is given.",
    )
    lines_distance_mm: float = setting("survey", np.inf, type=distance)


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=(
        "omnimirror calibrate *.jpg --board 11x7 --square-mm 30 -o camera.toml --report calibration.html",
        "omnimirror calibrate --points room.csv --directions stars.csv --image-size 1920x1080 -o camera.toml",
    ),
)
@click.argument("images", nargs=-1)
@add_options(OptionalBoardOptions, "target")
@add_options(SurveyOptions, "survey")
@add_options(CameraModelOptions, "camera")
@add_options(EstimationOptions, "estimation")
@add_options(OrientationOptions, "orientation")
@click.option(
    "--multiple-boards", is_flag=True, help="Detect several chessboards of this size in each image."
)
@click.option("-o", "--output", type=Output(), help="Output camera file, TOML.")
@click.option("--json", "json_path", type=Output(), help="Write all results as JSON.")
@click.option(
    "--report",
    type=Output(),
    help="Write an HTML report; to a folder, also the figures as SVG.",
)
def command(
    images: tuple[str, ...],
    target: OptionalBoardOptions,
    survey: SurveyOptions,
    camera: CameraModelOptions,
    estimation: EstimationOptions,
    orientation: OrientationOptions,
    multiple_boards: bool,
    output: Path | None,
    json_path: Path | None,
    report: Path | None,
) -> None:
    """Calibrate a camera from IMAGES of a target, or one video, without prior knowledge of the
    camera.

    IMAGES are files, folders or file patterns. Known points, directions and straight edges are
    used in addition to boards, and points or directions also without them.
    """
    page, figures = _report_files(report)
    board, model_arguments, console = target.target_board(), camera.arguments(), output_console()
    _check_input(images, board, survey)
    survey_data = read_observations(survey.points, survey.directions)
    detections, interruption = (
        ([], 0)
        if board is None
        else _detect_boards(console, images, board, multiple_boards, orientation)
    )
    with _steps(console) as progress, interrupts.deferred():
        try:
            calibration = calibrate_camera(
                detections,
                board,
                surveys=survey_data.observations,
                lines=read_line_points(survey.lines) if survey.lines else None,
                lines_distance_mm=survey.lines_distance_mm,
                image_size=survey.image_size,
                **model_arguments,
                **estimation.arguments(),
                on_progress=progress,
                should_stop=interrupts.is_pending,
            )
        except OmnimirrorError:
            if not (code := interrupts.exit_code() or interruption):
                raise
            print_notice("stopped before a camera was determined")
            sys.exit(code)
        code = interrupts.exit_code() or interruption
        _write(calibration, output, json_path, page, figures)
    _print(console, calibration, survey_data)
    print_written(output, json_path, page, console=console)
    if figures:
        print_line("Figures in ", (str(figures), "bold"), console=console)
    if code:
        print_line("Stopped: best camera so far", console=console)
        click.echo("omnimirror: stopped", err=True)
        sys.exit(code)


def _report_files(report: Path | None) -> tuple[Path | None, Path | None]:
    """Return the page and the folder of the figures."""
    if report is None or is_stream(report) or report.suffix == ".html":
        return report, None
    if report.suffix:
        raise click.UsageError(f"--report must be an .html file or a folder; got {report}")
    return report / "calibration.html", report


def _check_input(images: tuple[str, ...], board: Board | None, survey: SurveyOptions) -> None:
    """Raise UsageError if there is no input, or if an option has no effect on the given input."""
    if bool(images) != (board is not None):
        problem = (
            "--board requires IMAGES of the board"
            if board
            else "IMAGES require --board and --square-mm"
        )
        raise click.UsageError(
            f"{problem}; specify points and directions with --points and --directions"
        )
    if not (images or survey.points or survey.directions):
        hint = (
            "; to refine a known camera with --lines only, use omnimirror lines"
            if survey.lines
            else ""
        )
        raise click.UsageError(f"IMAGES of a board, --points or --directions must be given{hint}")


def _detect_boards(
    console: Console,
    images: tuple[str, ...],
    board: Board,
    multiple_boards: bool,
    orientation: OrientationOptions,
) -> tuple[list[Detection], int]:
    """Detect boards in images or video frames; also return the exit code of an interruption."""
    is_stored = orientation.stored_orientation
    with progress_bar(console) as bar, interrupts.deferred():
        task = bar.add_task("Detecting boards", total=None)

        def progress(done: int, count: int | None) -> None:
            activity = "Detecting boards" + (f", {done} of {count}" if count else "")
            bar.update(task, description=activity, completed=done, total=count)
            if interrupts.is_pending():  # between two images, which loses no partial result
                raise KeyboardInterrupt

        if len(images) == 1 and is_video(images[0]):
            orientation.report_video(images[0])
            detected = select_frames(
                images[0], board, stored_orientation=is_stored, on_progress=progress
            )
        else:
            files = expand_inputs(images, READABLE_IMAGE_SUFFIXES)
            orientation.report(files)
            detected = find_boards(
                files,
                board,
                several=multiple_boards,
                stored_orientation=is_stored,
                on_progress=progress,
            )
        return detected, interrupts.exit_code()


@contextmanager
def _steps(console: Console) -> Iterator[OnProgress]:
    """Show a progress bar with the current step and percentage, and yield its update function."""
    with progress_bar(console) as bar:
        task = bar.add_task("Calibrating", total=None)
        with forward_steps(lambda step: bar.update(task, description=step)):
            yield lambda done, total: bar.update(task, completed=done, total=total)


def _write(
    calibration: Calibration,
    output: Path | None,
    json_path: Path | None,
    report: Path | None,
    figures: Path | None,
) -> None:
    if output is not None:
        calibration.save(output)
    if json_path is not None:
        calibration.to_json(json_path)
    if report is not None:
        from ...reports.calibration import write_calibration_report

        write_calibration_report(calibration, report, _command_line())
    if figures is not None:
        from ...reports.calibration import write_calibration_figures

        write_calibration_figures(calibration, figures)


def _command_line() -> str:
    return shell_command(["omnimirror", *sys.argv[1:]])


# -- Printed output --------------------------------------------------------------------------------


def _print(console: Console, calibration: Calibration, survey_data: SurveyData) -> None:
    used, count = sum(p.used for p in calibration.images), len(calibration.images)
    held_out = (
        f", {calibration.held_out_rms_px:.3f} px in held-out images" if calibration.held_out else ""
    )
    inliers = calibration.corners - len(calibration.outliers)
    print_line(
        (f"{calibration.model.KIND}", "bold"),
        f": {calibration.rms_px:.3f} px RMS over {inliers} of {calibration.corners} "
        f"{calibration.measurement_kinds} in {used} of {count} "
        f"{'image' if count == 1 else 'images'}{held_out}",
        console=console,
    )
    if len(calibration.candidates) > 1:
        console.print(_models(calibration))
    console.print(_parameters(calibration))
    for image in calibration.images:
        if not image.used:
            reason = image.reason or ""
            print_line(
                ("Not used: ", "yellow"),
                reason if image.name in reason else f"{image.name}: {reason}",
                console=console,
            )
        elif image.name in survey_data.places and image.camera_at_mm is not None:
            position = ", ".join(f"{x:.1f}" for x in image.camera_at_mm)
            print_line(f"{image.name}: camera position {position} mm", console=console)
    if calibration.outliers:
        print_line(f"Rejected outliers: {_outliers(calibration, survey_data)}", console=console)
    for note in calibration.notes:
        print_line(("Note: ", "yellow"), note, console=console)
    for message in calibration.advice:
        print_line(("Next: ", "cyan"), message, console=console)


def _outliers(calibration: Calibration, survey_data: SurveyData) -> str:
    def location(image: str, corner: int) -> str:
        return (
            survey_data.places[image][corner]
            if image in survey_data.places
            else f"{image} corner {corner}"
        )

    listed = [
        f"{location(o.image, o.corner)} ({o.residual_px:.2f} px)"
        for o in calibration.outliers[:MAX_OUTLIERS]
    ]
    more = len(calibration.outliers) - len(listed)
    return ", ".join(listed) + (f" and {more} more" if more else "")


def _models(calibration: Calibration) -> Table:
    table = plain_table(
        "model", "parameters", "RMS\npx", "held out\npx", "", text_columns=("model", "")
    )
    for candidate in calibration.candidates:
        held_out = (
            f"{candidate.held_out_rms_px:.3f}" if np.isfinite(candidate.held_out_rms_px) else "-"
        )
        style = "bold" if candidate.kind == calibration.model.KIND else None
        table.add_row(
            candidate.kind,
            str(candidate.parameters),
            f"{candidate.rms_px:.3f}",
            held_out,
            candidate.why,
            style=style,
        )
    return table


def _parameters(calibration: Calibration) -> Table:
    table = plain_table("parameter", "value", "sigma", "", text_columns=("parameter", ""))
    for p in calibration.parameters:
        table.add_row(
            p.name, f"{p.value:.6g}", f"{p.sigma:.2g}" if p.sigma > 0 else "fixed", p.unit
        )
    return table
