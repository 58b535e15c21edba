"""What the commands that search for designs share: the problem from options, its run with a bar, its tables."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from ..design.merits import MERITS, merit_named
from ..design.optimise import Optimum, optimise
from ..design.pareto import Front, merit_values, pareto
from ..design.problem import DesignProblem
from ..errors import InvalidParameter, OmnimirrorError
from ..imagers import Imager
from ..lenses import Perspective
from ..sensor import Sensor
from ..specs import load_sensor, save_sensor

FOCUS_BY = {
    "blur_area": "floored-area",
    "mean_blur_area": "mean-floored-area",
    "blur": "worst-deg",
    "blur_rss": "rss-deg",
}
"""What a sphere is focused by to be compared with a mirror that has the least of a merit."""

MARKS = {
    "SPH": "paper-spherical",
    "E-DI": "paper-equidistant",
    "SVP": "paper-hyperboloidal",
    "exact equidistant": "exact-equidistant",
}
"""Sensors that a front's figure shows for comparison."""


def number_or_range(text: str) -> float | tuple[float, float]:
    """A number, or a range ``LOW:HIGH`` to choose from.

    >>> number_or_range("12"), number_or_range("10:14")
    (12.0, (10.0, 14.0))
    """
    try:
        numbers = [float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not np.isfinite(numbers).all():
        raise click.BadParameter(f"{text!r} is not a number or a range LOW:HIGH")
    return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])


def whole_numbers(text: str) -> list[int]:
    """Whole numbers above 0, parted by commas.

    >>> whole_numbers("4,8,16")
    [4, 8, 16]
    """
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdigit() and int(part) > 0 for part in parts):
        raise click.BadParameter(f"{text!r} is not a list of whole numbers above 0, such as 4,8,16")
    return [int(part) for part in parts]


def merit_list(text: str) -> list[str]:
    """Names of merits, parted by commas."""
    return [part.strip() for part in text.split(",")]


def limit(text: str) -> tuple[str, float]:
    """A merit and the number that it may not exceed, ``MERIT=NUMBER``.

    >>> limit("uniformity=1.5")
    ('uniformity', 1.5)
    """
    name, _, number = text.partition("=")
    try:
        return name.strip(), float(number)
    except ValueError:
        raise click.BadParameter(f"{text!r} is not a limit MERIT=NUMBER, such as uniformity=1.5") from None


def problem_like(sensor: str | None, changes: dict[str, Any]) -> DesignProblem:
    """The problem of a sensor's field, size, lens and imager (of the paper's by default), with changes."""
    pixels = {k: changes.pop(k) for k in ("width_px", "height_px", "pixel_pitch_um")}
    problem = DesignProblem() if sensor is None else _problem_of(load_sensor(sensor))
    imager = replace(problem.imager, **{k: v for k, v in pixels.items() if v is not None})
    return replace(problem, imager=imager, **{k: v for k, v in changes.items() if v is not None})


def _problem_of(sensor: Sensor) -> DesignProblem:
    lens = sensor.lens
    if not isinstance(lens, Perspective):
        raise InvalidParameter(f"{sensor.name} has a {lens.KIND} lens; mirrors are optimised for perspective lenses")
    i = sensor.imager
    return DesignProblem(
        omega_max_deg=sensor.field_deg[1],
        theta_max_deg=float(np.degrees(sensor.meridian.theta_max)),
        rim_radius_mm=sensor.mirror.rim_radius_mm,
        focal_length_mm=lens.focal_length_mm,
        f_number=lens.f_number,
        imager=Imager(i.width_px, i.height_px, i.pixel_pitch_um, i.centre_px),
    )


def run_optimise(
    console: Console,
    problem: DesignProblem,
    merit: str,
    terms: Sequence[int],
    limits: dict[str, float],
    starts: int,
    seed: int,
    checkpoint: Path | None,
    out: Path | None,
) -> Optimum:
    """Optimise with each number of terms, print how it went, and write the best sensor."""
    if checkpoint and len(terms) > 1:
        raise InvalidParameter("a checkpoint holds the search with one number of terms; give one")
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("terms", "best start", "steps", f"{merit} {merit_named(merit).unit}".rstrip(), "focus mm"):
        table.add_column(heading, justify="right")
    best: Optimum | None = None
    with _bar(console) as bar:
        task = bar.add_task(merit, total=starts * len(terms))
        for i, count in enumerate(terms):

            def told(p: Any, i: int = i) -> None:
                bar.update(task, completed=i * starts + p.run, description=f"{merit} {p.value:.5g}")

            found = optimise(
                replace(problem, terms=count), merit, limits=limits, starts=starts, seed=seed, checkpoint=checkpoint,
                on_progress=told,
            )  # fmt: skip
            run = min((r for r in found.runs if r.kept), key=lambda r: r.value)
            table.add_row(
                str(count), run.start, str(len(run.history) - 1), f"{found.value:.5f}",
                f"{found.sensor.lens.focus_distance_mm:.2f}",
            )  # fmt: skip
            best = found if best is None or found.value < best.value else best
        bar.update(task, completed=starts * len(terms))
    assert best is not None
    if out:
        save_sensor(best.sensor, out)
    console.print(table)
    _print_merits(console, best)
    if out:
        console.print(
            f"Wrote [bold]{out}[/]; look at it with: omnimirror evaluate {out}", highlight=False, soft_wrap=True
        )
    return best


def _print_merits(console: Console, best: Optimum) -> None:
    """All merits of the mirror found, beside those of the sphere for the same field."""
    from ..design.optimise import start
    from ..design.problem import DesignSpace

    space = DesignSpace(best.problem)
    sphere = space.sensor(start(space, 0, 0)[1])
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("merit", "sphere", "optimised", "unit", "meaning"):
        table.add_column(heading, justify="right" if heading in ("sphere", "optimised") else "left")
    focus_by = FOCUS_BY.get(best.merit, "floored-area")
    before_all = merit_values(sphere, list(MERITS), best.problem, focus_by)
    after_all = merit_values(best.sensor, list(MERITS), best.problem, None)
    for m, before, after in zip(MERITS.values(), before_all, after_all, strict=True):
        table.add_row(m.name, f"{before:.4f}", f"{after:.4f}", m.unit, m.meaning)
    console.print()
    console.print(table)
    console.print(f"[dim]the sphere for the same field, at its best focus by {focus_by}[/]")


def run_pareto(
    console: Console,
    problem: DesignProblem,
    merits: Sequence[str],
    limits: dict[str, float],
    population: int,
    generations: int,
    seed: int,
    file: Path | None,
    figure: Path | None,
    pick: int | None,
    out: Path | None,
) -> Front:
    """Find the front of some merits, print it, draw it, and write one of its designs as a sensor."""
    if figure and len(merits) != 2:
        raise InvalidParameter(f"a figure shows two merits; {len(merits)} were given")
    with _bar(console) as bar:
        task = bar.add_task("generations", total=generations)
        front = pareto(
            problem, merits, limits=limits, population=population, generations=generations, seed=seed, path=file,
            on_progress=lambda done, _: bar.update(task, completed=done),
        )  # fmt: skip
        bar.update(task, completed=generations)
    if out and pick is None:
        raise OmnimirrorError(f"the front has {len(front)} designs; name the one to write with --pick NUMBER")
    if out and pick is not None:
        save_sensor(front.sensor(pick), out)
    if figure:
        _draw(front, figure)
    _print_front(console, front)
    if figure:
        console.print(f"Wrote [bold]{figure}[/]", highlight=False, soft_wrap=True)
    if file:
        console.print(f"Wrote [bold]{file}[/]", highlight=False, soft_wrap=True)
    if out:
        console.print(f"Wrote [bold]{out}[/]", highlight=False, soft_wrap=True)
    return front


def _print_front(console: Console, front: Front, rows: int = 12) -> None:
    table = Table(box=None, pad_edge=False, header_style="bold")
    for heading in ("number", *(f"{m} {merit_named(m).unit}".rstrip() for m in front.merits), "focus mm"):
        table.add_column(heading, justify="right")
    for i in np.unique(np.linspace(0, len(front) - 1, min(rows, len(front))).round().astype(int)):
        table.add_row(str(i), *(f"{v:.4f}" for v in front.values[i]), f"{front.focus_mm[i]:.2f}")
    for name, values in marked(front).items():
        table.add_row(f"[dim]{name}[/]", *(f"[dim]{v:.4f}[/]" for v in values), "")
    console.print(table)


def marked(front: Front) -> dict[str, tuple[float, ...]]:
    """The merits of the paper's mirrors and of the exact equidistant one, each at its own best focus."""
    return {
        name: tuple(float(v) for v in merit_values(load_sensor(file), front.merits, front.problem))
        for name, file in MARKS.items()
    }


def _draw(front: Front, path: Path) -> None:
    from ..figures.fronts import front as drawing
    from ..figures.style import save_figure, styled

    a, b = (_axis_label(m) for m in front.merits)
    marks = {name: (values[0], values[1]) for name, values in marked(front).items()}
    with styled():
        save_figure(drawing(front.values, (a, b), marks), path)


def _axis_label(merit: str) -> str:
    m = merit_named(merit)
    words = m.meaning.partition(";")[0].capitalize()
    return f"{words} ({m.unit.replace('2', '²')})" if m.unit else words


def _bar(console: Console) -> Progress:
    return Progress(
        TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), console=console, transient=True,
        disable=not console.is_terminal,
    )  # fmt: skip
