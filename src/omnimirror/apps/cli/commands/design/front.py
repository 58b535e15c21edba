"""``omnimirror design --pareto``: Pareto front of merits, its table and figure, and one selected
design.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np
from rich.console import Console

from .....base.quantities import QUANTITIES
from .....design.criteria.requirements import Requirements
from .....design.optimise.references import EXACTLY, known_sensors, merit_values
from .....design.solve.front import Front, pareto
from ...options.design import SearchedOptions
from ...outputs import head, plain_table, progress_bar


def find_front(console: Console, asked: Requirements, merits: list[str], searched: SearchedOptions) -> Front:
    """Compute, draw and print the Pareto front."""
    if searched.figure and len(merits) != 2:
        raise click.UsageError(f"a figure shows two merits; {len(merits)} were given")
    with progress_bar(console) as bar:
        task = bar.add_task("generations", total=searched.generations)
        front = pareto(
            asked, merits, population=searched.population, generations=searched.generations, seed=searched.seed,
            resume=searched.resume, on_progress=lambda done, _: bar.update(task, completed=done),
            mode=searched.mode, image_radius_px=searched.image_radius_px,
        )  # fmt: skip
    if searched.pick is not None:
        front.sensor(searched.pick)  # raises if the design does not exist
    problem = front.space.problem
    known = {name: merit_values(s, front.merits, problem) for name, s in known_sensors(problem).items()}
    if searched.figure:
        _draw(front, known, searched.figure)
    _print_front(console, front, known)
    if searched.pick is not None:
        console.print()
    if not front.is_complete:
        kept = f"; the same command goes on from {searched.resume}" if searched.resume else ""
        console.print(f"Stopped before generation {searched.generations}{kept}", highlight=False, soft_wrap=True)
    return front


def _print_front(console: Console, front: Front, known: dict[str, Any], rows: int = 12) -> None:
    table = plain_table("number", *(f"{m}\n{QUANTITIES[m].unit}" for m in front.merits), head("focus_mm"))
    for i in np.unique(np.linspace(0, len(front) - 1, min(rows, len(front))).round().astype(int)):
        table.add_row(str(i), *(f"{v:.4f}" for v in front.values[i]), f"{front.focus_mm[i]:.2f}")
    for name, values in known.items():
        table.add_row(name, *(f"{v:.4f}" for v in values), "", style="dim")
    console.print(table)


def _draw(front: Front, known: dict[str, Any], path: Path) -> None:
    from .....analysis.figures.fronts import front as drawing
    from .....analysis.figures.labels import axis_title
    from .....analysis.figures.style import save_figure, styled

    places = {name: (float(v[0]), float(v[1])) for name, v in known.items()}
    groups = [{n: v for n, v in places.items() if n.startswith(EXACTLY) == exact} for exact in (False, True)]
    a, b = (axis_title(m) for m in front.merits)
    with styled():
        save_figure(drawing(front.values, (a, b), *groups), path)


def check_pick(pick: int | None, outputs: dict[str, Path | None]) -> None:
    """Raise UsageError for outputs of a single design if none is selected with --pick."""
    named = [f"--{name}" for name, path in outputs.items() if path]
    if pick is None and named:
        raise click.UsageError(f"{named[0]} is about one design of the front; name it with --pick NUMBER")
