"""``omnimirror calibrate``: the camera that took pictures of a board."""

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

from .....base.arguments import float_of, shown
from .....base.errors import OmnimirrorError
from .....base.escaping import shell_command
from .....calibration.estimation import Calibration, Prior, Surveys, calibrate_camera, read_surveys
from .....calibration.estimation.ladder.models import KINDS
from .....calibration.lines import read_lines
from .....calibration.physical import SensorModel
from .....calibration.targets import Board, Detection, choose_frames
from .....calibration.targets.finding import find_boards
from .....cameras.frames import CameraLooks, Mount
from .....cameras.models.base import CameraModel, Optics
from .....dewarp.pipelines.request import is_video
from .....io import interrupts
from .....io.batch import READABLE, expand_inputs
from .....optics.sensor import Sensor
from .....optics.sensor_files import load_camera
from ...help_pages import DocumentedCommand
from ...options.board import SoughtBoardOptions
from ...options.common import NUMBER, WHOLE, angle, distance, pixel, whole_size
from ...options.declared import Options, option, takes
from ...options.orientation import OrientationOptions
from ...outputs import Output, notice, output_console, plain_table, progress_bar, say, say_written

FEW_SHOWN = 12


def prior(text: str) -> Prior:
    """What is known of a parameter, as ``NAME=VALUE+-SIGMA``, or ``NAME=VALUE`` to fix it.

    >>> prior("xi=0.97+-0.02")
    Prior(name='xi', value=0.97, sigma=0.02)
    """
    match = re.fullmatch(r"([\w.\[\]]+)=([^+±]+?|[^±]+?)(?:(?:\+-|±)(.+))?", text.strip())
    try:
        if match:
            name, value, sigma = match.groups()
            found = Prior(name, float_of(value.strip()), 0.0 if sigma is None else float_of(sigma.strip()))
            if np.isfinite(found[1:]).all() and found.sigma >= 0:
                return found
    except ValueError:
        pass
    raise click.BadParameter(f"{shown(text)} is not NAME=VALUE+-SIGMA, such as lens.focal_length_mm=8+-0.1")


@dataclass(frozen=True)
class SoughtCameraOptions(Options):
    """What is known of the camera, as :func:`omnimirror.calibrate_camera` takes it."""

    model: str = option(
        default="auto", metavar="NAME|FILE",
        help=f"auto, {', '.join(KINDS)}; or the name or file of a sensor or camera to begin with.",
    )  # fmt: skip
    free: str | None = option(metavar="A,B,..", help="Of a sensor to begin with: what is estimated.")
    optics: Optics = option(
        default="mirror", type=click.Choice(["mirror", "fisheye"]), help="What the camera looks through."
    )
    camera_looks: CameraLooks = option(
        default="up", type=click.Choice(["up", "down", "forward"]), help="Where the optical axis points."
    )
    forward_azimuth_deg: float = option(
        default=-90.0, type=angle, metavar="DEG", help="Image direction that is forward, from right towards bottom."
    )
    flipped: bool = option(default=False, is_flag=True, help="The pictures were flipped left to right.")
    centre_px: tuple[float, float] | None = option(
        type=pixel, metavar="U,V", help="Where the search for the axis begins.  [default: the middle]"
    )
    rim_radius_px: float | None = option(
        type=NUMBER, metavar="PX",
        help="Where the field ends, as omnimirror rim tells.  [default: where picture or model do]",
    )  # fmt: skip

    def begun(self) -> str | CameraModel | Sensor:
        """The kind of model, or one to begin with."""
        if self.model == "auto" or self.model in KINDS:
            if self.free is not None:
                raise click.UsageError("--free belongs to a sensor to begin with; name it with --model")
            return self.model
        camera = load_camera(self.model)
        if isinstance(camera, Sensor):
            return SensorModel(camera) if self.free is None else SensorModel(camera, tuple(self.free.split(",")))
        if self.free is not None:
            raise click.UsageError(f"--free belongs to sensors, and {self.model} is a {camera.KIND} camera")
        return camera

    def asked(self) -> dict[str, Any]:
        """Arguments of :func:`omnimirror.calibrate_camera`."""
        mount = Mount(self.camera_looks, self.forward_azimuth_deg, self.flipped)
        return {
            "model": self.begun(), "optics": self.optics, "mount": mount, "centre_px": self.centre_px,
            "rim_radius_px": self.rim_radius_px,
        }  # fmt: skip


@dataclass(frozen=True)
class EstimationOptions(Options):
    """How it is estimated."""

    fixed: tuple[str, ...] = option(
        "--fix", default=(), multiple=True, metavar="NAME", show_default=False,
        help="Keep a parameter as the model begins with it; may be repeated.",
    )  # fmt: skip
    priors: tuple[Prior, ...] = option(
        "--prior", default=(), multiple=True, type=prior, metavar="NAME=VALUE+-SIGMA", show_default=False,
        help="What is known of a parameter; without +-SIGMA it is fixed to the value; may be repeated.",
    )  # fmt: skip
    flat_board: bool = option(default=False, is_flag=True, help="Take the board as flat and square.")
    seed: int = option(default=0, type=WHOLE, help="Of the groups in which more than 20 pictures are left out.")

    def asked(self) -> dict[str, Any]:
        """Arguments of :func:`omnimirror.calibrate_camera`."""
        return {"fixed": self.fixed, "priors": self.priors, "board_shape": not self.flat_board, "seed": self.seed}


@dataclass(frozen=True)
class SurveyOptions(Options):
    """What is known besides boards, as :func:`omnimirror.read_surveys` takes it."""

    points: tuple[str, ...] = option(
        default=(), multiple=True, metavar="FILE", show_default=False,
        help="Known points, CSV: u_px,v_px,x_mm,y_mm,z_mm, and picture if there are several; may be repeated.",
    )  # fmt: skip
    directions: tuple[str, ...] = option(
        default=(), multiple=True, metavar="FILE", show_default=False,
        help="Stars, the sun or far towers, CSV: u_px,v_px and x,y,z or azimuth_deg,elevation_deg; may be repeated.",
    )  # fmt: skip
    lines: tuple[str, ...] = option(
        default=(), multiple=True, metavar="FILE", show_default=False,
        help="Points marked on straight edges, CSV: line,u_px,v_px, and picture if there are several; may be repeated.",
    )  # fmt: skip
    lines_distance_mm: float = option(
        type=distance, metavar="MM", default=np.inf, help="Of these edges, for mirrors of many viewpoints."
    )
    image_size: tuple[int, int] | None = option(
        type=whole_size, metavar="WxH", help="Of the pictures, where none with a board tells it."
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
@click.option("--several", is_flag=True, help="Pictures show several such chessboards at once; each is used.")
@click.option("-o", "--output", type=Output(), help="The camera file to write, TOML.")
@click.option("--json", "json_path", type=Output(), help="All numbers, as JSON.")
@click.option("--report", type=Output(), help="A page with all of it, HTML.")
@click.option("--figures", type=click.Path(path_type=Path, file_okay=False), help="A folder for the figures, as SVG.")
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
    """Find out what camera took PICTURES of a board, or one video; nothing needs to be known of it.

    PICTURES are files, folders or patterns of them. With --points and --directions, pixels and what they are known to
    show, the camera is found with boards or without. Straight edges (--lines) count beside either.

    Hold the board at ten to twenty places all around, near the rim too, and tilted. Corners that no camera explains are
    left out and named, 1 % at most and gross errors up to 5 %; a note reports those that remain. Models are compared by
    their error in pictures that were left out. Ctrl-C keeps the best camera found until then.
    """
    board, asked, console = target.made(), camera.asked(), output_console()
    _check_asked(pictures, board, survey)
    known = read_surveys(survey.points, survey.directions)
    detections, stopped_by = ([], 0) if board is None else _found(console, pictures, board, several, orientation)
    with _steps(console) as progress, interrupts.deferred():
        try:
            found = calibrate_camera(
                detections, board, surveys=known.sightings, lines=read_lines(survey.lines),
                lines_distance_mm=survey.lines_distance_mm, image_size=survey.image_size, **asked, **estimation.asked(),
                progress=progress, stop=interrupts.is_pending,
            )  # fmt: skip
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
    """Whether there is something to calibrate from, and nothing that belongs to nothing."""
    if bool(pictures) != (board is not None):
        what = (
            "--board belongs to PICTURES of it" if board else "PICTURES show a board; say which: --board, --square-mm"
        )
        raise click.UsageError(f"{what}, and points and directions to --points and --directions")
    if not (pictures or survey.points or survey.directions):
        alone = "; --lines alone refine a camera that is known: omnimirror lines" if survey.lines else ""
        raise click.UsageError(f"there are no PICTURES of a board, and no --points or --directions{alone}")


def _found(
    console: Console, pictures: tuple[str, ...], board: Board, several: bool, orientation: OrientationOptions
) -> tuple[list[Detection], int]:
    """Boards in pictures, or in the frames of a video; and the exit code of who stopped the search, 0 if nobody did."""
    is_stored = orientation.stored_orientation
    with progress_bar(console) as bar, interrupts.deferred():
        task = bar.add_task("looking for boards", total=None)

        def progress(done: int, count: int | None) -> None:
            what = "looking for boards" + (f", {done} of {count}" if count else "")
            bar.update(task, description=what, completed=done, total=count)
            if interrupts.is_pending():  # between two pictures, where nothing of one is lost
                raise KeyboardInterrupt

        if len(pictures) == 1 and is_video(pictures[0]):
            orientation.report_video(pictures[0])
            found = choose_frames(pictures[0], board, stored_orientation=is_stored, progress=progress)
        else:
            files = expand_inputs(pictures, READABLE)
            orientation.report(files)
            found = find_boards(files, board, several=several, stored_orientation=is_stored, progress=progress)
        return found, interrupts.exit_code()


@contextmanager
def _steps(console: Console) -> Iterator[Callable[[str, float], None]]:
    """A bar that shows a word and a share."""
    with progress_bar(console) as bar:
        task = bar.add_task("calibrating", total=1.0)
        yield lambda what, share: bar.update(task, description=what, completed=share)


def _write(
    found: Calibration, output: Path | None, json_path: Path | None, report: Path | None, figures: Path | None
) -> None:
    if output is not None:
        found.save(output)
    if json_path is not None:
        found.to_json(json_path)
    if report is not None:
        from ....reports.calibration import write_calibration_report

        write_calibration_report(found, report, _command_line())
    if figures is not None:
        from ....reports.calibration import write_calibration_figures

        write_calibration_figures(found, figures)


def _command_line() -> str:
    return shell_command(["omnimirror", *sys.argv[1:]])


# -- what is printed -------------------------------------------------------------------------------------


def _print(console: Console, found: Calibration, known: Surveys) -> None:
    used, count = sum(p.used for p in found.pictures), len(found.pictures)
    held = f", {found.held_out_rms_px:.3f} px in pictures left out" if found.held_out else ""
    kept = found.corners - len(found.outliers)
    say(
        (f"{found.model.KIND}", "bold"), f": {found.rms_px:.3f} px RMS over {kept} of {found.corners} {found.seen} in "
        f"{used} of {count} {'picture' if count == 1 else 'pictures'}{held}", console=console,
    )  # fmt: skip
    if len(found.candidates) > 1:
        console.print(_models(found))
    console.print(_parameters(found))
    for picture in found.pictures:
        if not picture.used:
            why = picture.reason or ""
            say(("Not used: ", "yellow"), why if picture.name in why else f"{picture.name}: {why}", console=console)
        elif picture.name in known.places and picture.camera_at_mm is not None:
            place = ", ".join(f"{x:.1f}" for x in picture.camera_at_mm)
            say(f"{picture.name}: the camera was at {place} mm", console=console)
    if found.outliers:
        say(f"Left out as outliers: {_outliers(found, known)}", console=console)
    for note in found.notes:
        say(("Note: ", "yellow"), note, console=console)
    for sentence in found.advice:
        say(("Next: ", "cyan"), sentence, console=console)


def _outliers(found: Calibration, known: Surveys) -> str:
    def place(picture: str, corner: int) -> str:
        return known.places[picture][corner] if picture in known.places else f"{picture} corner {corner}"

    shown = [f"{place(o.picture, o.corner)} ({o.residual_px:.2f} px)" for o in found.outliers[:FEW_SHOWN]]
    more = len(found.outliers) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def _models(found: Calibration) -> Table:
    table = plain_table("model", "parameters", "RMS\npx", "left out\npx", "", words=("model", ""))
    for tried in found.candidates:
        held = f"{tried.held_out_rms_px:.3f}" if np.isfinite(tried.held_out_rms_px) else "-"
        style = "bold" if tried.kind == found.model.KIND else None
        table.add_row(tried.kind, str(tried.parameters), f"{tried.rms_px:.3f}", held, tried.why, style=style)
    return table


def _parameters(found: Calibration) -> Table:
    table = plain_table("parameter", "value", "sigma", "", words=("parameter", ""))
    for p in found.parameters:
        table.add_row(p.name, f"{p.value:.6g}", f"{p.sigma:.2g}" if p.sigma > 0 else "fixed", p.unit)
    return table
