"""``omnimirror design``: from requirements to a sensor file, and the margins."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ....batch.bases import FREE_FORMS
from ....design.construct.families import FAMILIES
from ....design.criteria.merits import DESIGN_MERITS
from ....design.criteria.requirements import Requirements
from ....design.solve.designer import Design, SearchOptions, design_of, design_sensor
from ....design.solve.freeform import SHAPE, free_form_notes, problem_of
from ....design.solve.verdict import judge
from ....errors import InvalidParameter
from ....files import write_text
from ....mirrors.generated import MAPPINGS
from ....specs import save_sensor
from ...options.common import NUMBER, WHOLE, number_or_range
from ...options.declared import refuse_other, takes
from ...options.design import distances, limit, merit_list, requirements_from, whole_numbers
from ...options.housing import HousingOptions
from ...outputs import FIGURES, format_option, output_console, output_option, progress_bar, say, say_written
from .front import check_pick, find_front
from .tables import print_convergence, print_design, print_merits

MISSED = 3
"""Exit code where a sensor was designed that misses a requirement."""

STOPPED = 130
"""Exit code of a search that Ctrl-C ended; what it had by then is written."""

FOR_BOTH = ("seed", "resume", "paper_mode", "image_radius_px")
ONLY = {
    "--optimise": ("starts", "terms", *FOR_BOTH),
    "--pareto": ("population", "generations", "figure", "pick", *FOR_BOTH),
}


@click.command()
@click.argument("requirements", required=False, type=click.Path(path_type=Path))
@click.option("--mapping", type=click.Choice([*MAPPINGS]), help="How the image is to be laid out.")
@click.option("--mirror", "family", metavar="FAMILY", help=f"Instead: {', '.join(FAMILIES)} or polynomial:N.")
@click.option("--optimise", type=click.Choice([*DESIGN_MERITS]),
              help="Instead: the mirror of free form with the least of it.")  # fmt: skip
@click.option("--pareto", "merits", type=merit_list, metavar="MERIT,MERIT",
              help="Instead: what these cost each other, as designs of which none is better by all.")  # fmt: skip
@click.option("--shape", metavar="FORM[:N]", help=f"What is optimised: {', '.join(FREE_FORMS)}; {SHAPE} by default.")
@click.option("--terms", type=whole_numbers, metavar="N[,N..]",
              help="The N of --shape; several give a table of convergence.")  # fmt: skip
@click.option("--fit", metavar="FORM:N", help="Make it a polynomial:N or an asphere:N that keeps the mapping best.")
@click.option("--like", metavar="SENSOR", help="Field, rim, lens and imager as of a sensor file or a bundled sensor.")
@click.option("--omega-max-deg", type=NUMBER, help="Field angle at the rim.")
@click.option("--omega-min-deg", type=NUMBER, help="Where the field begins that matters.")
@click.option("--apex", type=click.Choice(["smooth", "pointed"]), help="pointed: the image centre shows omega-min-deg.")
@click.option("--object-distance-mm", type=distances, metavar="MM|NEAR:FAR", help="From the mirror; inf by default.")
@click.option("--rim-radius-mm", type=number_or_range, metavar="MM|LOW:HIGH", help="Of the mirror.")
@click.option("--conic", type=number_or_range, metavar="K|LOW:HIGH", help="Conic constant, where the family leaves it.")
@click.option("--plane-distance-mm", type=NUMBER, help="Of a ground-plane mapping: mirror vertex to the plane.")
@click.option("--cylinder-radius-mm", type=NUMBER, help="Of a cylinder mapping.")
@click.option("--mapping-csv", type=click.Path(), help="Of a tabulated mapping: columns omega_deg, height.")
@click.option("--lens", "kind", type=click.Choice(["perspective", "orthographic"]), help="perspective by default.")
@click.option("--focal-length-mm", type=number_or_range, metavar="MM|LOW:HIGH", help="Of the lens.")
@click.option("--theta-max-deg", type=number_or_range, metavar="DEG|LOW:HIGH", help="Viewing angle at the rim.")
@click.option("--f-number", type=number_or_range, metavar="F|LOW:HIGH", help="Of the lens; 4 by default.")
@click.option("--focus-mm", type=number_or_range, metavar="MM|LOW:HIGH", help="In focus; the best by default.")
@click.option("--width-px", type=WHOLE, help="Of the imager; 1024 by default.")
@click.option("--height-px", type=WHOLE, help="Of the imager; 1024 by default.")
@click.option("--pixel-pitch-um", type=NUMBER, help="Of the imager; 5.2 by default.")
@click.option("--at-most", type=limit, multiple=True, metavar="QUANTITY=NUMBER[@FROM:TO]",
              help="A limit, over a part of the field in degrees or all of it; may be repeated.")  # fmt: skip
@click.option("--at-least", type=limit, multiple=True, metavar="QUANTITY=NUMBER[@FROM:TO]",
              help="Likewise; may be repeated.")  # fmt: skip
@click.option("--starts", type=WHOLE, default=4, show_default=True, help="From how many mirrors to optimise.")
@click.option("--seed", type=WHOLE, default=0, show_default=True, help="Of everything drawn.")
@click.option("--resume", type=click.Path(path_type=Path),
              help="Keep the search in this file, and go on from it: JSON; of a front, Parquet.")  # fmt: skip
@click.option("--paper-mode", is_flag=True, help="Merits of blur by the paper's Eq. 29 instead of the exact form.")
@click.option("--image-radius-px", type=NUMBER, help="Merits for an image of this radius, as the paper's 500.")
@click.option("--population", type=WHOLE, default=120, show_default=True, help="Designs of a front.")
@click.option("--generations", type=WHOLE, default=200, show_default=True, help="Of the front's evolution.")
@output_option("--figure", formats=FIGURES, help="Draw the front, known mirrors marked.")
@format_option(FIGURES)
@click.option("--pick", type=WHOLE, help="Which design of the front to take.")
@click.option("--name", help="Of the sensor.")
@output_option("-o", "--out", help="Write the sensor file.")
@output_option("--json", "json_file", help="Write the table, and what conflicts.")
@click.option("--figures", type=click.Path(path_type=Path), help="Draw the paper's figures into this folder.")
@takes(HousingOptions, "housing")
@click.pass_context
def command(
    ctx: click.Context,
    /,
    requirements: Path | None,
    merits: list[str] | None,
    like: str | None,
    name: str | None,
    out: Path | None,
    json_file: Path | None,
    figures: Path | None,
    housing: HousingOptions,
    at_most: Any,
    at_least: Any,
    **entries: Any,
) -> None:
    """Design a sensor that meets REQUIREMENTS, a TOML file; or what the options say, which go before the file.

    Prints what was asked, what is reached and the margins, and where not all can be met what would have to give.
    The exit code is then 3. Examples: omnimirror design --mapping equidistant --omega-max-deg 135 --theta-max-deg 12
    --rim-radius-mm 43.9 -o sensor.toml; omnimirror design --like paper-spherical --optimise worst_floored_area_deg2
    -o sharper.toml
    """
    given = [n for n in entries if ctx.get_parameter_source(n) is click.core.ParameterSource.COMMANDLINE]
    entries["optimise"] = merits[0] if merits else entries["optimise"]
    wanted = requirements_from(requirements, like, name, entries, at_most, at_least)
    wanted = replace(wanted, housing=housing.of(wanted.housing))
    way = "--pareto" if merits else "--optimise" if wanted.mirror.optimise else "a mapping or a family"
    refuse_other(given, ONLY, way)
    console = output_console()
    if merits:
        check_pick(entries["pick"], {"out": out, "json": json_file, "figures": figures})
        design, is_complete = _front(console, wanted, merits, entries)
    elif wanted.mirror.optimise:
        design = _optimised(console, wanted, entries)
        is_complete = design.optimum is None or design.optimum.is_complete
    else:
        with console.status("Designing") as status:
            design = design_sensor(wanted, lambda words: status.update(f"Designing: {words}"))
        is_complete = True
    if design is not None:
        _write(console, design, out, json_file, figures)
    for path in (entries["figure"], entries["resume"]):
        if path and path.exists():
            say_written(path, console=console)
    sys.exit(STOPPED if not is_complete else MISSED if design and not design.is_met else 0)


def _write(console: Console, design: Design, out: Path | None, json_file: Path | None, figures: Path | None) -> None:
    """Write what is asked for, then print the design."""
    if out:
        save_sensor(design.sensor, out)
    if json_file:
        write_text(json_file, json.dumps(design.to_dict(), indent=1, ensure_ascii=False) + "\n")
    print_design(console, design)
    if design.optimum:
        print_merits(console, design.optimum)
        if not design.optimum.is_complete:
            say(("Stopped: this is the best of the starts that were finished", "bold"), console=console)
    if figures:
        _draw(console, design, figures)
    say_written(out, json_file, figures, console=console)


def _optimised(console: Console, wanted: Requirements, options: dict[str, Any]) -> Design:
    """The best of one or several numbers of terms, with a bar; several are told of in a table."""
    shape = (wanted.mirror.shape or SHAPE).partition(":")[0]
    counts = options["terms"] or [problem_of(wanted).terms]
    if options["resume"] and len(counts) > 1:
        raise InvalidParameter("a file to resume holds the search with one number of terms; give one")
    starts, designs = options["starts"], {}
    with progress_bar(console) as bar:
        task = bar.add_task("", total=starts * len(counts))
        for i, count in enumerate(counts):

            def told(p: Any, i: int = i) -> None:
                bar.update(task, completed=i * starts + p.run, description=f"{wanted.mirror.optimise} {p.value:.5g}")

            search = SearchOptions(starts, options["seed"], options["resume"], told, **_as_paper(options))
            table = replace(wanted.mirror, shape=f"{shape}:{count}")
            designs[count] = design_sensor(
                replace(wanted, mirror=table), lambda words: bar.update(task, description=words), search=search
            )
    if len(counts) > 1:
        print_convergence(console, designs)
    return min(designs.values(), key=lambda d: d.optimum.value if d.optimum else float("inf"))


def _front(
    console: Console, wanted: Requirements, merits: list[str], options: dict[str, Any]
) -> tuple[Design | None, bool]:
    """The design picked from a front, if one is, and whether the front's evolution came to its end."""
    problem = problem_of(wanted, **_as_paper(options))
    own = {n: options[n] for n in ("figure", "pick", "population", "generations", "seed", "resume")}
    front = find_front(console, problem, merits, **own)
    if own["pick"] is None:
        return None, front.is_complete
    sensor = front.sensor(own["pick"])
    console.print()
    sensor = sensor if wanted.name == "design" else replace(sensor, name=wanted.name)
    return design_of(judge(wanted, sensor), free_form_notes(problem, sensor)), front.is_complete


def _as_paper(options: dict[str, Any]) -> dict[str, Any]:
    mode = "paper" if options["paper_mode"] else "exact"
    return {"mode": mode, "image_radius_px": options["image_radius_px"]}


def _draw(console: Console, design: Design, folder: Path) -> None:
    from ....figures import save_all

    with console.status("Drawing figures"):
        save_all([design.sensor], folder)
