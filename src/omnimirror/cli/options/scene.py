"""The scenes that can be named on the command line, and the options of the pictures taken of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import click
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from ...simulate import Detector, Pose, Radiometry, Scene
from ...simulate.detector import BAYER, CURVES
from ...simulate.scenes import BUNDLED
from ...simulate.scenes.sources import SceneSource
from .common import NUMBER, WHOLE, _numbers, angle, distance, factor
from .declared import flag, takes
from .housing import HousingOptions

Command = TypeVar("Command", bound=Callable[..., Any])


def pose(text: str) -> Pose:
    """A pose as ``X,Y,Z``, ``X,Y,Z,PAN``, .. up to ``X,Y,Z,PAN,TILT,ROLL``, in mm and degrees.

    >>> pose("500,0,-200,30")
    Pose(x_mm=500.0, y_mm=0.0, z_mm=-200.0, pan_deg=30.0, tilt_deg=0.0, roll_deg=0.0)
    """
    count = min(max(3, text.count(",") + 1), 6)
    return Pose(*_numbers(text, count, ",", "a pose X,Y,Z[,PAN[,TILT[,ROLL]]] in mm and deg"))


def reflectivity(text: str) -> Any:
    """A reflectivity as a share, a metal's name or its index, or three of them with commas between.

    >>> reflectivity("0.9"), reflectivity("gold"), reflectivity("0.96+6.69j,0.9,1")
    (0.9, 'gold', ((0.96+6.69j), 0.9, 1.0))
    """
    if "," in text:
        return tuple(reflectivity(part) for part in text.split(","))
    for kind in (float, complex):
        try:
            return kind(text)
        except ValueError:
            continue
    return text.strip()


def _note_sharp(ctx: click.Context, _: click.Parameter, is_sharp: bool) -> None:
    ctx.meta["is_sharp"] = is_sharp


def _is_blurred(ctx: click.Context, _: click.Parameter, word: str) -> bool:
    return word == "on" and not ctx.meta["is_sharp"]


_SCENE = (
    click.option(
        "--scene",
        default="room",
        show_default=True,
        metavar="NAME|FILE",
        help=f"What to look at: {', '.join(BUNDLED)}, an equirectangular picture (HDR, EXR, JPEG, ..), or a mesh "
        "(GLB, glTF, OBJ, PLY, STL).",
    ),
    click.option(
        "--heading-deg", type=angle, metavar="DEG", help="Where the middle of an environment is seen.  [default: 0]"
    ),
    click.option("--unit-mm", type=factor, metavar="MM", help="Unit of a mesh.  [default: 1000; of an STL 1]"),
    click.option(
        "--up",
        type=click.Choice(["y", "z"]),
        help="Axis of a mesh that points up.  [default: y; of an STL z]",
    ),
    click.option("--background", metavar="FILE", help="Environment behind a mesh.  [default: nothing]"),
)
_PICTURE = (
    click.option(
        "--blur",
        type=click.Choice(["on", "off"]),
        is_flag=False,
        flag_value="on",
        default="on",
        show_default=True,
        callback=_is_blurred,
        help="Look through the whole aperture, or sharp.",
    ),
    click.option(
        "--no-blur",
        is_flag=True,
        is_eager=True,
        expose_value=False,
        callback=_note_sharp,
        help="The same as --blur off.",
    ),
    click.option("--samples", "--spp", type=WHOLE, default=16, show_default=True, help="Rays per pixel."),
    click.option("--seed", type=WHOLE, default=0, show_default=True, help="Of the rays' places and of the noise."),
)
_RADIOMETRY = (
    click.option(
        "--reflectivity",
        type=reflectivity,
        metavar="SHARE|METAL|N+Kj",
        help="Of the mirror: a share, a metal by Fresnel's formulas, or three of them for red, green and blue.  "
        "[default: 1]",
    ),
    click.option("--vignetting/--no-vignetting", default=None, help="The lens's natural one, cos^4.  [default: none]"),
    click.option("--sees-past/--black-past", default=None, help="What lies beside the mirror.  [default: black]"),
)
_DETECTOR = (
    click.option("--exposure", type=factor, metavar="FACTOR", help="Of the light; above 1 saturates.  [default: 1]"),
    click.option("--full-well-e", type=distance, metavar="N", help="Electrons at saturation.  [default: no noise]"),
    click.option("--read-noise-e", type=NUMBER, metavar="N", help="Noise of reading out, electrons.  [default: 0]"),
    click.option(
        "--black-level-dn",
        type=NUMBER,
        metavar="DN",
        help="Added to linear values, so that dark noise is not cut off.  [default: 5 deviations of reading]",
    ),
    click.option(
        "--bits", type=WHOLE, metavar="8..16", help="Depth of values; PNG and TIFF hold more than 8.  [default: 8]"
    ),
    click.option("--curve", type=click.Choice(CURVES), help="Of the values.  [default: srgb]"),
    click.option("--bayer", type=click.Choice(BAYER), help="One colour per pixel, not interpolated.  [default: none]"),
)
RADIOMETRY = ("reflectivity", "vignetting", "sees_past")
DETECTOR = ("exposure", "full_well_e", "read_noise_e", "black_level_dn", "bits", "curve", "bayer")


def scene_options(command: Command) -> Command:
    """Options that name a scene."""
    return _all(command, _SCENE)


def picture_options(command: Command) -> Command:
    """Options of how pictures are taken, and of what stands around the mirror."""
    return _all(takes(HousingOptions, "housing")(command), (*_PICTURE, *_RADIOMETRY, *_DETECTOR))


def _all(command: Command, options: tuple[Callable[[Command], Command], ...]) -> Command:
    for option in reversed(options):
        command = option(command)
    return command


def scene_of(name: str, given: dict[str, Any]) -> Scene:
    """The scene of a name or a file."""
    return source_of(name, given).load()


def source_of(name: str, given: dict[str, Any]) -> SceneSource:
    """Where the scene of a name or a file comes from, as the options say."""
    options = ("heading_deg", "unit_mm", "up", "background")
    source = SceneSource(name, **{option: given[option] for option in options if option in given})
    for option in ("unit_mm", "up", "background"):
        if option in given and not source.is_mesh:
            raise click.UsageError(f"{flag(option)} belongs to a mesh, and {name} is none")
    if "heading_deg" in given and not (source.is_environment or "background" in given):
        raise click.UsageError("--heading-deg turns an environment; turn other scenes with --pose")
    return source


def radiometry_of(given: dict[str, Any]) -> Radiometry | None:
    """How much light comes, as the options say; None if they say nothing."""
    asked: dict[str, Any] = {n: given[n] for n in RADIOMETRY if n in given}
    if not asked:
        return None
    if isinstance(asked.get("reflectivity"), tuple) and len(asked["reflectivity"]) != 3:
        raise click.UsageError("--reflectivity takes one value, or three for red, green and blue")
    return Radiometry(**asked | {"vignetting": float(asked.get("vignetting", 0.0))})


def detector_of(given: dict[str, Any]) -> Detector:
    """The imager's electronics, as the options say."""
    return Detector(**{n: given[n] for n in DETECTOR if n in given})


@contextmanager
def rows_bar(what: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on stderr, told of rows or frames done."""
    console = Console(stderr=True)
    bar = Progress(
        TextColumn(what, markup=False), BarColumn(), TextColumn("{task.percentage:.0f} %"), TimeRemainingColumn(),
        console=console, transient=True, disable=not console.is_terminal,
    )  # fmt: skip
    with bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
