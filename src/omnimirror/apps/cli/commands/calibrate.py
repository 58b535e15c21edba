"""``omnimirror calibrate``: camera calibration from images of a target."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ....base.arguments import float_of, shown
from ....base.errors import OmnimirrorError
from ....base.escaping import shell_command
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
from ....cameras.frames import CameraLooks, Mount
from ....cameras.models.camera_model import CameraModel, Optics
from ....dewarp.request import is_video
from ....io import interrupts
from ....io.batch import READABLE_IMAGE_SUFFIXES, expand_inputs
from ....optics.sensor import Sensor
from ....optics.sensor_files import load_camera
from .._camera_options import OrientationOptions
from .._declarations import DocumentedCommand, Options, option, takes
from .._option_types import NUMBER, WHOLE, angle, distance, pixel, whole_size
from .._output import Output, notice, output_console, plain_table, progress_bar, say, say_written
from .board import SoughtBoardOptions

FEW_SHOWN = 12


def prior(text: str) -> Prior:
    """Parse prior knowledge of a parameter: ``NAME=VALUE+-SIGMA``, or ``NAME=VALUE`` to fix it.

    >>> prior("xi=0.97+-0.02")
    Prior(name='xi', value=0.97, sigma=0.02)
    """
    match = re.fullmatch(r"([\w.\[\]]+)=([^+±]+?|[^±]+?)(?:(?:\+-|±)(.+))?", text.strip())
    try:
        if match:
            name, value, sigma = match.groups()
            found = Prior(
                name, float_of(value.strip()), 0.0 if sigma is None else float_of(sigma.strip())
            )
            if np.isfinite(found[1:]).all() and found.sigma >= 0:
                return found
    except ValueError:
        pass
    raise click.BadParameter(
        f"{shown(text)} is not NAME=VALUE+-SIGMA, such as lens.focal_length_mm=8+-0.1"
    )


@dataclass(frozen=True)
class SoughtCameraOptions(Options):
    """Camera model, with the parameters of :func:`omnimirror.calibrate_camera`."""

    model: str = option(
        default="auto",
        metavar="NAME|FILE",
        help=f"Model: auto, {', '.join(KINDS)}; or the name or file of a sensor or camera as initial value.",
    )
    free: str | None = option(
        metavar="A,B,..", help="Parameters to estimate if the initial value is a sensor."
    )
    optics: Optics = option(
        default="mirror",
        type=click.Choice(["mirror", "fisheye"]),
        help="Type of optics: mirror or fisheye lens.",
    )
    camera_looks: CameraLooks = option(
        default="up",
        type=click.Choice(["up", "down", "forward"]),
        help="Orientation of the optical axis.",
    )
    forward_azimuth_deg: float = option(
        default=-90.0,
        type=angle,
        metavar="DEG",
        help="Image direction of forward, from right towards bottom.",
    )
    flipped: bool = option(
        default=False, is_flag=True, help="Declare that the images are mirrored left to right."
    )
    centre_px: tuple[float, float] | None = option(
        type=pixel,
        metavar="U,V",
        help="Initial value of the image centre.  [default: the image centre]",
    )
    rim_radius_px: float | None = option(
        type=NUMBER,
        metavar="PX",
        help="Radius of the field in the image, as detected by omnimirror rim.  [default: limit of the image or of "
        "the model]",
    )

    def begun(self) -> str | CameraModel | Sensor:
        """Return the kind of model, or the model that provides initial values."""
        if self.model == "auto" or self.model in KINDS:
            if self.free is not None:
                raise click.UsageError(
                    "--free belongs to a sensor to begin with; name it with --model"
                )
            return self.model
        camera = load_camera(self.model)
        if isinstance(camera, Sensor):
            return (
                SensorModel(camera)
                if self.free is None
                else SensorModel(camera, tuple(self.free.split(",")))
            )
        if self.free is not None:
            raise click.UsageError(
                f"--free belongs to sensors, and {self.model} is a {camera.KIND} camera"
            )
        return camera

    def asked(self) -> dict[str, Any]:
        """Return the arguments of :func:`omnimirror.calibrate_camera`."""
        mount = Mount(self.camera_looks, self.forward_azimuth_deg, self.flipped)
        return {
            "model": self.begun(),
            "optics": self.optics,
            "mount": mount,
            "centre_px": self.centre_px,
            "rim_radius_px": self.rim_radius_px,
        }


@dataclass(frozen=True)
class EstimationOptions(Options):
    """Estimation."""

    fixed: tuple[str, ...] = option(
        "--fix",
        default=(),
        multiple=True,
        metavar="NAME",
        show_default=False,
        help="Hold a parameter at its initial value (repeatable).",
    )
    priors: tuple[Prior, ...] = option(
        "--prior",
        default=(),
        multiple=True,
        type=prior,
        metavar="NAME=VALUE+-SIGMA",
        show_default=False,
        help="Prior of a parameter; without +-SIGMA the parameter is fixed (repeatable).",
    )
    flat_board: bool = option(
        default=False, is_flag=True, help="Treat the board as flat and square."
    )
    seed: int = option(
        default=0,
        type=WHOLE,
        help="Random seed of the cross-validation groups for more than 20 images.",
    )

    def asked(self) -> dict[str, Any]:
        """Return the arguments of :func:`omnimirror.calibrate_camera`."""
        return {
            "fixed": self.fixed,
            "priors": self.priors,
            "board_shape": not self.flat_board,
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
        help="Known points, CSV: u_px,v_px,x_mm,y_mm,z_mm, and picture for several images (repeatable).",
    )
    directions: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Known directions (stars, sun, distant towers), CSV: u_px,v_px and x,y,z or azimuth_deg,elevation_deg "
        "(repeatable).",
    )
    lines: tuple[str, ...] = option(
        default=(),
        multiple=True,
        metavar="FILE",
        show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px, and image for several images (repeatable).",
    )
    lines_distance_mm: float = option(
        type=distance,
        metavar="MM",
        default=np.inf,
        help="Object distance of the straight edges, for mirrors without a single viewpoint.",
    )
    image_size: tuple[int, int] | None = option(
        type=whole_size, metavar="WxH", help="Image size, required if no image of a board is given."
    )


@click.command(
    cls=DocumentedCommand,
    page="calibrate",
    examples=(
        "omnimirror calibrate *.jpg --board 11x7 --square-mm 30 -o camera.toml --report calibration.html",
        "omnimirror calibrate --points room.csv --directions stars.csv --image-size 1920x1080 -o camera.toml",
    ),
)
@click.argument("pictures", nargs=-1)
@takes(SoughtBoardOptions, "target")
@takes(SurveyOptions, "survey")
@takes(SoughtCameraOptions, "camera")
@takes(EstimationOptions, "estimation")
@takes(OrientationOptions, "orientation")
@click.option("--several", is_flag=True, help="Detect several such chessboards in each image.")
@click.option("-o", "--output", type=Output(), help="Output camera file, TOML.")
@click.option("--json", "json_path", type=Output(), help="Write all numbers as JSON.")
@click.option("--report", type=Output(), help="Write an HTML report.")
@click.option(
    "--figures",
    type=click.Path(path_type=Path, file_okay=False),
    help="Output folder for figures, SVG.",
)
def command(
    pictures: tuple[str, ...],
    target: SoughtBoardOptions,
    survey: SurveyOptions,
    camera: SoughtCameraOptions,
    estimation: EstimationOptions,
    orientation: OrientationOptions,
    several: bool,
    output: Path | None,
    json_path: Path | None,
    report: Path | None,
    figures: Path | None,
) -> None:
    """Calibrate a camera from PICTURES of a target, or one video, without prior knowledge of the
    camera.

    PICTURES are files, folders or file patterns. Known points and directions (--points,
    --directions) are used in addition to boards or without them, and straight edges (--lines) in
    addition to either.

    Place the board at 10 to 20 positions over the whole field, also near the rim, and tilt it.
    Outlier corners are rejected and reported: at most 1 %, and gross errors up to 5 %; a note
    reports those that remain. Models are compared by the reprojection error in held-out images
    (cross-validation). Ctrl-C stops the calibration and keeps the best camera so far.
    """
    board, asked, console = target.made(), camera.asked(), output_console()
    _check_asked(pictures, board, survey)
    known = read_observations(survey.points, survey.directions)
    detections, stopped_by = (
        ([], 0) if board is None else _found(console, pictures, board, several, orientation)
    )
    with _steps(console) as progress, interrupts.deferred():
        try:
            found = calibrate_camera(
                detections,
                board,
                surveys=known.observations,
                lines=read_line_points(survey.lines),
                lines_distance_mm=survey.lines_distance_mm,
                image_size=survey.image_size,
                **asked,
                **estimation.asked(),
                on_progress=progress,
                should_stop=interrupts.is_pending,
            )
        except OmnimirrorError:
            if not (code := interrupts.exit_code() or stopped_by):
                raise
            notice("stopped before a camera was found")
            sys.exit(code)
        code = interrupts.exit_code() or stopped_by
        _write(found, output, json_path, report, figures)
    _print(console, found, known)
    say_written(output, json_path, report, console=console)
    if figures:
        say("Figures in ", (str(figures), "bold"), console=console)
    if code:
        say("Stopped: this is the best camera found so far", console=console)
        click.echo("omnimirror: stopped", err=True)
        sys.exit(code)


def _check_asked(pictures: tuple[str, ...], board: Board | None, survey: SurveyOptions) -> None:
    """Raise UsageError if there is no input, or if an option has no effect on the given input."""
    if bool(pictures) != (board is not None):
        what = (
            "--board belongs to PICTURES of it"
            if board
            else "PICTURES show a board; say which: --board, --square-mm"
        )
        raise click.UsageError(f"{what}, and points and directions to --points and --directions")
    if not (pictures or survey.points or survey.directions):
        alone = (
            "; --lines alone refine a camera that is known: omnimirror lines"
            if survey.lines
            else ""
        )
        raise click.UsageError(
            f"there are no PICTURES of a board, and no --points or --directions{alone}"
        )


def _found(
    console: Console,
    pictures: tuple[str, ...],
    board: Board,
    several: bool,
    orientation: OrientationOptions,
) -> tuple[list[Detection], int]:
    """Detect boards in images or video frames; also return the exit code of an interruption."""
    is_stored = orientation.stored_orientation
    with progress_bar(console) as bar, interrupts.deferred():
        task = bar.add_task("looking for boards", total=None)

        def progress(done: int, count: int | None) -> None:
            what = "looking for boards" + (f", {done} of {count}" if count else "")
            bar.update(task, description=what, completed=done, total=count)
            if interrupts.is_pending():  # between two images, which loses no partial result
                raise KeyboardInterrupt

        if len(pictures) == 1 and is_video(pictures[0]):
            orientation.report_video(pictures[0])
            found = select_frames(
                pictures[0], board, stored_orientation=is_stored, on_progress=progress
            )
        else:
            files = expand_inputs(pictures, READABLE_IMAGE_SUFFIXES)
            orientation.report(files)
            found = find_boards(
                files, board, several=several, stored_orientation=is_stored, on_progress=progress
            )
        return found, interrupts.exit_code()


@contextmanager
def _steps(console: Console) -> Iterator[Callable[[str, float], None]]:
    """Show a progress bar with description and percentage, and yield its update function."""
    with progress_bar(console) as bar:
        task = bar.add_task("calibrating", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


def _write(
    found: Calibration,
    output: Path | None,
    json_path: Path | None,
    report: Path | None,
    figures: Path | None,
) -> None:
    if output is not None:
        found.save(output)
    if json_path is not None:
        found.to_json(json_path)
    if report is not None:
        from ...reports.calibration import write_calibration_report

        write_calibration_report(found, report, _command_line())
    if figures is not None:
        from ...reports.calibration import write_calibration_figures

        write_calibration_figures(found, figures)


def _command_line() -> str:
    return shell_command(["omnimirror", *sys.argv[1:]])


# -- printed output ---------------------------------------------------------------------------


def _print(console: Console, found: Calibration, known: SurveyData) -> None:
    used, count = sum(p.used for p in found.images), len(found.images)
    held = f", {found.held_out_rms_px:.3f} px in pictures left out" if found.held_out else ""
    kept = found.corners - len(found.outliers)
    say(
        (f"{found.model.KIND}", "bold"),
        f": {found.rms_px:.3f} px RMS over {kept} of {found.corners} {found.measurement_kinds} in "
        f"{used} of {count} {'picture' if count == 1 else 'pictures'}{held}",
        console=console,
    )
    if len(found.candidates) > 1:
        console.print(_models(found))
    console.print(_parameters(found))
    for picture in found.images:
        if not picture.used:
            why = picture.reason or ""
            say(
                ("Not used: ", "yellow"),
                why if picture.name in why else f"{picture.name}: {why}",
                console=console,
            )
        elif picture.name in known.places and picture.camera_at_mm is not None:
            place = ", ".join(f"{x:.1f}" for x in picture.camera_at_mm)
            say(f"{picture.name}: the camera was at {place} mm", console=console)
    if found.outliers:
        say(f"Left out as outliers: {_outliers(found, known)}", console=console)
    for note in found.notes:
        say(("Note: ", "yellow"), note, console=console)
    for sentence in found.advice:
        say(("Next: ", "cyan"), sentence, console=console)


def _outliers(found: Calibration, known: SurveyData) -> str:
    def place(picture: str, corner: int) -> str:
        return (
            known.places[picture][corner]
            if picture in known.places
            else f"{picture} corner {corner}"
        )

    shown = [
        f"{place(o.image, o.corner)} ({o.residual_px:.2f} px)" for o in found.outliers[:FEW_SHOWN]
    ]
    more = len(found.outliers) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _models(found: Calibration) -> Table:
    table = plain_table("model", "parameters", "RMS\npx", "left out\npx", "", words=("model", ""))
    for tried in found.candidates:
        held = f"{tried.held_out_rms_px:.3f}" if np.isfinite(tried.held_out_rms_px) else "-"
        style = "bold" if tried.kind == found.model.KIND else None
        table.add_row(
            tried.kind, str(tried.parameters), f"{tried.rms_px:.3f}", held, tried.why, style=style
        )
    return table


def _parameters(found: Calibration) -> Table:
    table = plain_table("parameter", "value", "sigma", "", words=("parameter", ""))
    for p in found.parameters:
        table.add_row(
            p.name, f"{p.value:.6g}", f"{p.sigma:.2g}" if p.sigma > 0 else "fixed", p.unit
        )
    return table
