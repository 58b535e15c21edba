"""``omnimirror design``: sensor design from requirements, with margins.

A catalogue restricts the design to off-the-shelf parts; ``--pareto`` computes a Pareto front of merits.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NoReturn

import click
import numpy as np
from rich.console import Console
from rich.table import Table

from ....base.files import write_json
from ....base.logs import forward_steps
from ....base.quantities import QUANTITIES
from ....design.catalogue import Component
from ....design.designer import Design, design_sensor
from ....design.freeform import SHAPE
from ....design.off_the_shelf import PartsDesign, PartsSearch, design_from_parts
from ....design.optimiser import Progress
from ....design.pareto_front import Front, pareto
from ....design.reference_mirrors import EXACTLY, known_sensors, merit_values
from ....design.requirement_files import REQUIREMENT_ENTRIES
from ....design.requirements import Requirements
from ....optics.batch.families import FreeformFamily
from ....optics.sensor_files import save_sensor
from .._declarations import (
    DocumentedCommand,
    add_options,
    file_entries,
    given_settings,
    refuse_inapplicable,
)
from .._design_options import (
    CatalogueOptions,
    OptimisationOptions,
    RequirementOptions,
    merit_list,
)
from .._output import (
    column_head,
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_written,
    progress_bar,
)
from .._process_state import interrupted_exit_code
from ._design_report import (
    EXIT_MISSED,
    print_conflict,
    print_convergence,
    print_design,
    print_merits,
    print_verdict,
)

# -- Design with a catalogue -----------------------------------------------------------------------


def design_with_catalogue(
    console: Console,
    requirements: Requirements,
    catalogue: CatalogueOptions,
    out: Path | None,
    json_file: Path | None,
) -> NoReturn:
    """Design with off-the-shelf parts, print the result, write the cheapest design, and exit."""
    with (
        console.status("Designing") as status,
        forward_steps(lambda step: status.update(f"Designing: {step}"), "omnimirror.design"),
    ):
        search = design_from_parts(
            requirements,
            max_designs=catalogue.max_designs,
            front=catalogue.price_front,
            processes=catalogue.processes,
        )
    if search.found:
        console.print(_parts_table(search.found))
        console.print()
    cheapest = search.found[0] if search.found else search.nearest
    if cheapest is not None:
        console.print(
            f"{'Cheapest' if search.found else 'Smallest violation'}: {cheapest.combination.name}",
            highlight=False,
        )
        print_verdict(console, cheapest.design.verdict)
    _print_counts(console, search)
    if out and cheapest is not None:
        save_sensor(cheapest.design.sensor, out)
    if json_file:
        write_json(json_file, search.to_dict())
    print_written(out if cheapest is not None else None, json_file, console=console)
    sys.exit(0 if search.is_met else EXIT_MISSED)


def _parts_table(designs: tuple[PartsDesign, ...]) -> Table:
    area = QUANTITIES["worst_floored_area_deg2"]
    kinds = [
        kind for kind in ("lens", "imager", "ball", "dome") if _component_name(designs[0], kind)
    ]
    numbers = (
        column_head("f_number"),
        "Θ\ndeg",
        column_head("focus_mm"),
        "ring\nmm",
        "rim\npx",
        f"{area.title}\n{area.unit}",
        "mass\ng",
    )
    table = plain_table("price", *kinds, *numbers, text_columns=tuple(kinds))
    for d in designs:
        sensor, lens = d.design.sensor, d.design.sensor.lens
        theta = 0.0 if lens.TELECENTRIC else float(np.degrees(sensor.meridian.theta_max))
        table.add_row(
            "" if d.price is None else f"{d.price:g}",
            *(_component_name(d, kind) for kind in kinds),
            f"{lens.stop_number:.3g}",
            f"{theta:.1f}",
            f"{lens.focus_distance_mm:.1f}",
            f"{d.ring_mm:g}",
            f"{sensor.rim_radius_px:.0f}",
            area.text(d.worst_floored_area_deg2),
            "" if d.mass_g is None else f"{d.mass_g:.0f}",
        )
    return table


def _component_name(design: PartsDesign, kind: str) -> str:
    parts: tuple[Component, ...] = design.combination.parts
    return next((part.name for part in parts if kind == part.KIND), "")


def _print_counts(console: Console, search: PartsSearch) -> None:
    """Print the number of combinations by result."""
    console.print(
        f"\n{search.combinations} combinations; {len(search.found)} of them listed above",
        highlight=False,
    )
    for outcome, counts in (
        ("excluded before the mirror design", search.cut),
        ("designed, requirements missed", search.missed),
    ):
        if counts:
            reasons = ", ".join(
                f"{count} {name}" for name, count in sorted(counts.items(), key=lambda c: -c[1])
            )
            console.print(
                f"  {sum(counts.values())} {outcome}: {reasons}", highlight=False, soft_wrap=True
            )
    if search.left:
        console.print(f"  {search.left} more expensive combinations not evaluated", highlight=False)


# -- Pareto front ----------------------------------------------------------------------------------


def compute_front(
    console: Console,
    requirements: Requirements,
    merits: list[str],
    settings: OptimisationOptions,
    figures: Path | None,
) -> Front:
    """Compute, draw and print the Pareto front."""
    with progress_bar(console) as bar:
        task = bar.add_task("Generations", total=settings.generations)
        front = pareto(
            requirements,
            merits,
            population=settings.population,
            generations=settings.generations,
            seed=settings.seed,
            resume=settings.resume,
            on_progress=lambda done, _: bar.update(task, completed=done),
            mode=settings.mode,
            image_radius_px=settings.image_radius_px,
        )
    if settings.pick is not None:
        front.sensor(settings.pick)  # raises if the design does not exist
    problem = front.space.problem
    reference_values = {
        name: merit_values(s, front.merits, problem) for name, s in known_sensors(problem).items()
    }
    if figures and len(merits) == 2:
        _draw_front(front, reference_values, figures)
    _print_front(console, front, reference_values)
    if settings.pick is not None:
        console.print()
    if not front.is_complete:
        resume = (
            f"; repeat the command to continue from {settings.resume}" if settings.resume else ""
        )
        console.print(
            f"Stopped before generation {settings.generations}{resume}",
            highlight=False,
            soft_wrap=True,
        )
    return front


def _print_front(
    console: Console, front: Front, reference_values: dict[str, Any], rows: int = 12
) -> None:
    table = plain_table(
        "number", *(f"{m}\n{QUANTITIES[m].unit}" for m in front.merits), column_head("focus_mm")
    )
    for i in np.unique(np.linspace(0, len(front) - 1, min(rows, len(front))).round().astype(int)):
        table.add_row(str(i), *(f"{v:.4f}" for v in front.values[i]), f"{front.focus_mm[i]:.2f}")
    for name, values in reference_values.items():
        table.add_row(name, *(f"{v:.4f}" for v in values), "", style="dim")
    console.print(table)


def _draw_front(front: Front, reference_values: dict[str, Any], folder: Path) -> None:
    from ....analysis.figures.sensor_comparison import front as drawing
    from ....analysis.figures.style import FORMATS, axis_title, save_figure, styled

    points = {name: (float(v[0]), float(v[1])) for name, v in reference_values.items()}
    groups = [
        {n: v for n, v in points.items() if n.startswith(EXACTLY) == exact}
        for exact in (False, True)
    ]
    a, b = (axis_title(m) for m in front.merits)
    with styled():
        figure = drawing(front.values, (a, b), *groups)
        for kind in FORMATS:
            save_figure(figure, folder / f"front.{kind}")


def check_pick(pick: int | None, outputs: dict[str, Path | None]) -> None:
    """Raise UsageError for outputs of a single design if none is selected with search.pick."""
    given = [f"--{name}" for name, path in outputs.items() if path]
    if pick is None and given:
        raise click.UsageError(
            f"{given[0]} requires one design of the front; select it with --set search.pick=NUMBER"
        )


# -- Command ---------------------------------------------------------------------------------------

SEARCH_OPTIONS = ("seed", "resume", "mode", "image_radius_px")
ONLY = {
    "--optimise": ("starts", "terms", *SEARCH_OPTIONS),
    "--pareto": ("population", "generations", "pick", *SEARCH_OPTIONS),
    "--parts": ("max_designs", "price_front", "processes"),
}


@click.command(
    cls=DocumentedCommand,
    page="design",
    examples=(
        "omnimirror design panorama.toml -o sensor.toml",
        "omnimirror design --mapping equidistant --omega-max-deg 135 --theta-max-deg 12 --rim-radius-mm 44 -o eq.toml",
        "omnimirror design --like paper-spherical --optimise worst_floored_area_deg2 -o sharper.toml",
    ),
)
@click.argument("requirements", required=False, type=click.Path(path_type=Path))
@add_options(RequirementOptions, "options")
@click.option(
    "--pareto",
    "merits",
    type=merit_list,
    metavar="MERIT,MERIT",
    help="Compute the Pareto front of these merits.",
)
@add_options(OptimisationOptions, "settings")
@add_options(CatalogueOptions, "catalogue")
@output_option("-o", "--output", "out", help="Output sensor file.")
@json_option("Write the table and the relaxations.")
@click.option(
    "--figures",
    type=click.Path(path_type=Path, file_okay=False),
    help="Folder for the figures of the paper, and of a Pareto front of two merits.",
)
@file_entries("requirement file", REQUIREMENT_ENTRIES)
@click.pass_context
def command(
    ctx: click.Context,
    /,
    requirements: Path | None,
    merits: list[str] | None,
    options: RequirementOptions,
    settings: OptimisationOptions,
    out: Path | None,
    json_file: Path | None,
    figures: Path | None,
    catalogue: CatalogueOptions,
    changes: dict[str, Any],
) -> None:
    """Design a sensor that meets REQUIREMENTS, a TOML file, or the requirements given as options.

    For infeasible requirements, the necessary relaxations are printed, and the exit code is 3.
    """
    # More than 60 lines: the options of the command and its dispatch by request.
    if merits:
        options = replace(options, optimise=merits[0])
    loaded = options.requirements(requirements, changes)
    method = (
        "--pareto"
        if merits
        else "--optimise"
        if loaded.mirror.optimise
        else "a mapping or a family"
    )
    method = "--parts" if loaded.parts is not None else method
    given = [
        n
        for n in ctx.params
        if ctx.get_parameter_source(n) is click.core.ParameterSource.COMMANDLINE
    ]
    refuse_inapplicable([*given, *given_settings()], ONLY, method)
    console = output_console()
    if loaded.parts is not None:
        design_with_catalogue(console, loaded, catalogue, out, json_file)
    if merits:
        single = {"output": out, "json": json_file}
        check_pick(settings.pick, single if len(merits) == 2 else single | {"figures": figures})
        pareto_front = compute_front(console, loaded, merits, settings, figures)
        design = None if settings.pick is None else pareto_front.design(settings.pick)
        is_complete = pareto_front.is_complete
    elif loaded.mirror.optimise:
        design = _optimised(
            console, loaded, settings, lambda design: _write(console, design, out, json_file)
        )
        is_complete = design.optimum is None or design.optimum.is_complete
        is_complete = is_complete and (design.conflict is None or design.conflict.is_complete)
    else:
        with (
            console.status("Designing") as status,
            forward_steps(lambda step: status.update(f"Designing: {step}"), "omnimirror.design"),
        ):
            design = design_sensor(
                loaded,
                on_design=lambda design: _write(console, design, out, json_file),
            )
        is_complete = design.conflict is None or design.conflict.is_complete
    if design is not None:
        if merits:
            _write(console, design, out, json_file)
        _finish(console, design, out, json_file, figures)
    if design is None:
        print_written(figures, console=console)
    if settings.resume and settings.resume.exists():
        print_written(settings.resume, console=console)
    if not is_complete:
        click.echo("omnimirror: stopped", err=True)
        sys.exit(interrupted_exit_code())
    sys.exit(EXIT_MISSED if design and not design.is_met else 0)


def _write(console: Console, design: Design, out: Path | None, json_file: Path | None) -> None:
    """Write the sensor file and the table, and print the table, before searching relaxations."""
    if out:
        save_sensor(design.sensor, out)
    if json_file:
        write_json(json_file, design.to_dict())
    print_design(console, design)


def _finish(
    console: Console, design: Design, out: Path | None, json_file: Path | None, figures: Path | None
) -> None:
    """Print relaxations and merits, write the relaxations, and draw the figures."""
    if design.conflict is not None:
        print_conflict(console, design.conflict, design.verdict)
        if json_file:
            write_json(json_file, design.to_dict())
    if design.optimum:
        print_merits(console, design.optimum)
        if not design.optimum.is_complete:
            print_line(("Stopped: best result of the completed starts", "bold"), console=console)
    if figures:
        _draw(console, design, figures)
    print_written(out, json_file, figures, console=console)


def _optimised(
    console: Console,
    requirements: Requirements,
    settings: OptimisationOptions,
    on_design: Callable[[Design], None],
) -> Design:
    """Return the best design of one or several numbers of terms, with a progress bar.

    ``on_design`` receives the design before the search for relaxations; with several numbers of
    terms, the best design after the table of convergence.
    """
    shape = requirements.mirror.shape or SHAPE
    counts = settings.terms or [FreeformFamily.parse(shape).terms]
    if settings.resume and len(counts) > 1:
        raise click.UsageError("search.resume requires a single value of search.terms")
    starts, designs = settings.starts, {}
    with progress_bar(console) as bar:
        task = bar.add_task("", total=starts * len(counts))
        for i, count in enumerate(counts):

            def on_iteration(p: Progress, i: int = i) -> None:
                bar.update(
                    task,
                    completed=i * starts + p.run,
                    description=f"{requirements.mirror.optimise} {p.value:.5g}",
                )

            with forward_steps(
                lambda step: bar.update(task, description=step), "omnimirror.design"
            ):
                designs[count] = design_sensor(
                    requirements.changed(shape=f"{shape.partition(':')[0]}:{count}"),
                    search=settings.search(on_iteration),
                    on_design=on_design if len(counts) == 1 else None,
                )
    optimum = min(designs.values(), key=lambda d: d.optimum.value if d.optimum else float("inf"))
    if len(counts) > 1:
        print_convergence(console, designs)
        on_design(optimum)
    return optimum


def _draw(console: Console, design: Design, folder: Path) -> None:
    from ....analysis.figures import save_all

    with console.status("Drawing figures"):
        save_all([design.sensor], folder)
