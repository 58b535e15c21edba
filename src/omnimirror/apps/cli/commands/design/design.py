"""``omnimirror design``: sensor design from requirements, with margins."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
from rich.console import Console

from .....base.files import write_json
from .....design.criteria.requirements import Requirements
from .....design.optimise.optimiser import Progress
from .....design.solve.designer import Design, design_sensor
from .....design.solve.freeform import SHAPE
from .....optics.batch.bases import FreeForm
from .....optics.sensor_files import save_sensor
from ...help_pages import DocumentedCommand
from ...options.common import WHOLE
from ...options.declared import refuse_other, takes
from ...options.design import RequirementOptions, SearchedOptions, merit_list
from ...options.housing import HousingOptions
from ...outputs import (
    FIGURES,
    format_option,
    json_option,
    output_console,
    output_option,
    progress_bar,
    say,
    say_written,
)
from ...process import stopped_code
from .bought import buy
from .front import check_pick, find_front
from .tables import MISSED, print_conflict, print_convergence, print_design, print_merits

FOR_BOTH = ("seed", "resume", "paper_mode", "image_radius_px")
ONLY = {
    "--optimise": ("starts", "terms", *FOR_BOTH),
    "--pareto": ("population", "generations", "figure", "pick", *FOR_BOTH),
    "--parts": ("most", "front", "processes"),
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
@takes(RequirementOptions, "options")
@click.option("--pareto", "merits", type=merit_list, metavar="MERIT,MERIT",
              help="Compute the Pareto front of these merits instead of a single design.")  # fmt: skip
@takes(SearchedOptions, "searched")
@click.option("--most", type=WHOLE, default=10, help="Stop after N feasible combinations; with a catalogue.")
@click.option("--front", is_flag=True, help="Return designs that are sharper than all cheaper ones; with a catalogue.")
@click.option("--processes", type=WHOLE, default=1, help="Number of parallel designs; with a catalogue.")
@format_option(FIGURES)
@output_option("-o", "--out", help="Output sensor file.")
@json_option("Write the table, and what conflicts.")
@click.option("--figures", type=click.Path(path_type=Path), help="Output folder for the figures of the paper.")
@takes(HousingOptions, "housing")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    requirements: Path | None,
    merits: list[str] | None,
    options: RequirementOptions,
    searched: SearchedOptions,
    out: Path | None,
    json_file: Path | None,
    figures: Path | None,
    housing: HousingOptions,
    most: int,
    front: bool,
    processes: int,
) -> None:
    """Design a sensor that meets REQUIREMENTS, a TOML file, or the requirements given as options.

    Options override entries of the file. Prints the requirements, the values reached and the
    margins; for infeasible requirements also the necessary relaxations, with exit code 3.
    """
    if merits:
        options = replace(options, optimise=merits[0])
    asked = options.requirements(requirements)
    asked = replace(asked, housing=housing.of(asked.housing))
    way = "--pareto" if merits else "--optimise" if asked.mirror.optimise else "a mapping or a family"
    way = "--parts" if asked.parts is not None else way
    given = [n for n in ctx.params if ctx.get_parameter_source(n) is click.core.ParameterSource.COMMANDLINE]
    refuse_other(given, ONLY, way)
    console = output_console()
    if asked.parts is not None:
        buy(console, asked, most, front, processes, out, json_file)
    if merits:
        check_pick(searched.pick, {"out": out, "json": json_file, "figures": figures})
        found = find_front(console, asked, merits, searched)
        design = None if searched.pick is None else found.design(searched.pick)
        is_complete = found.is_complete
    elif asked.mirror.optimise:
        design = _optimised(console, asked, searched, lambda design: _write(console, design, out, json_file))
        is_complete = design.optimum is None or design.optimum.is_complete
        is_complete = is_complete and (design.conflict is None or design.conflict.is_complete)
    else:
        with console.status("Designing") as status:
            design = design_sensor(
                asked,
                lambda words: status.update(f"Designing: {words}"),
                on_design=lambda design: _write(console, design, out, json_file),
            )
        is_complete = design.conflict is None or design.conflict.is_complete
    if design is not None:
        if merits:
            _write(console, design, out, json_file)
        _finish(console, design, out, json_file, figures)
    for path in (searched.figure, searched.resume):
        if path and path.exists():
            say_written(path, console=console)
    if not is_complete:
        click.echo("omnimirror: stopped", err=True)
        sys.exit(stopped_code())
    sys.exit(MISSED if design and not design.is_met else 0)


def _write(console: Console, design: Design, out: Path | None, json_file: Path | None) -> None:
    """Write the sensor file and the table, and print the table, before searching relaxations."""
    if out:
        save_sensor(design.sensor, out)
    if json_file:
        write_json(json_file, design.to_dict())
    print_design(console, design)


def _finish(console: Console, design: Design, out: Path | None, json_file: Path | None, figures: Path | None) -> None:
    """Print relaxations and merits, write the relaxations, and draw the figures."""
    if design.conflict is not None:
        print_conflict(console, design.conflict, design.verdict)
        if json_file:
            write_json(json_file, design.to_dict())
    if design.optimum:
        print_merits(console, design.optimum)
        if not design.optimum.is_complete:
            say(("Stopped: this is the best of the starts that were finished", "bold"), console=console)
    if figures:
        _draw(console, design, figures)
    say_written(out, json_file, figures, console=console)


def _optimised(
    console: Console, asked: Requirements, searched: SearchedOptions, on_design: Callable[[Design], None]
) -> Design:
    """Return the best design of one or several numbers of terms, with a progress bar.

    ``on_design`` receives the design before the search for relaxations; with several numbers of
    terms, the best design after the table of convergence.
    """
    shape = asked.mirror.shape or SHAPE
    counts = searched.terms or [FreeForm.parse(shape).terms]
    if searched.resume and len(counts) > 1:
        raise click.UsageError("a file to resume holds the search with one number of terms; give one")
    starts, designs = searched.starts, {}
    with progress_bar(console) as bar:
        task = bar.add_task("", total=starts * len(counts))
        for i, count in enumerate(counts):

            def told(p: Progress, i: int = i) -> None:
                bar.update(task, completed=i * starts + p.run, description=f"{asked.mirror.optimise} {p.value:.5g}")

            designs[count] = design_sensor(
                asked.changed(shape=f"{shape.partition(':')[0]}:{count}"),
                lambda words: bar.update(task, description=words),
                search=searched.search(told),
                on_design=on_design if len(counts) == 1 else None,
            )
    best = min(designs.values(), key=lambda d: d.optimum.value if d.optimum else float("inf"))
    if len(counts) > 1:
        print_convergence(console, designs)
        on_design(best)
    return best


def _draw(console: Console, design: Design, folder: Path) -> None:
    from .....analysis.figures import save_all

    with console.status("Drawing figures"):
        save_all([design.sensor], folder)
