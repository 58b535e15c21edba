"""``omnimirror optimise``: the best mirror of free form by a merit, or the front of several merits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from ..design.merits import MERITS
from .design_search import (
    limit,
    merit_list,
    number_or_range,
    problem_like,
    run_optimise,
    run_pareto,
    whole_numbers,
)
from .options import distance, output_console, refuse_other

ONLY = {"--pareto": ("population", "generations", "front", "figure", "pick"), "--merit": ("starts", "checkpoint")}


@click.command()
@click.argument("sensor", required=False)
@click.option("--merit", type=click.Choice(list(MERITS)), default="blur_area", show_default=True,
              help="What to make least.")  # fmt: skip
@click.option("--pareto", "merits", type=merit_list, metavar="MERIT,MERIT", help="Instead: the front of these merits.")
@click.option("--limit", "limits", type=limit, metavar="MERIT=NUMBER", multiple=True,
              help="What another merit may not exceed; may be repeated.")  # fmt: skip
@click.option("--family", type=click.Choice(["slope-spline", "even-polynomial", "conic-asphere"]),
              help="Kind of mirror; slope-spline by default.")  # fmt: skip
@click.option("--terms", type=whole_numbers, metavar="N[,N..]",
              help="How many numbers shape it, 12 by default; several give a table of convergence.")  # fmt: skip
@click.option("--omega-max-deg", type=float, help="Field angle at the rim.")
@click.option("--omega-min-deg", type=float, help="Where the field that counts begins.")
@click.option("--theta-max-deg", type=number_or_range, metavar="DEG|LOW:HIGH", help="Viewing angle at the rim.")
@click.option("--rim-radius-mm", type=float, help="Radius of the mirror.")
@click.option("--focal-length-mm", type=float, help="Of the lens.")
@click.option("--f-number", type=number_or_range, metavar="F|LOW:HIGH", help="Of the lens.")
@click.option("--width-px", type=int, help="Of the imager.")
@click.option("--height-px", type=int, help="Of the imager.")
@click.option("--pixel-pitch-um", type=float, help="Of the imager.")
@click.option(
    "--object-distance-mm", type=distance, metavar="MM", help="From the mirror to the object; inf by default."
)
@click.option("--sag-max-mm", type=float, help="Highest sag of the rim.")
@click.option("--length-max-mm", type=float, help="Longest way from imager to rim.")
@click.option("--paper-mode", is_flag=True, help="Blur by the paper's Eq. 29 instead of the exact form.")
@click.option("--image-radius-px", type=float, help="Scale the image to this rim radius, as the paper does with 500.")
@click.option("--starts", type=int, default=4, show_default=True, help="From how many mirrors to start.")
@click.option("--seed", type=int, default=0, show_default=True, help="Of everything drawn.")
@click.option("--checkpoint", type=click.Path(path_type=Path), help="Keep finished starts here, and go on from them.")
@click.option("--population", type=int, default=120, show_default=True, help="Designs of a front.")
@click.option("--generations", type=int, default=200, show_default=True, help="Of the front's evolution.")
@click.option("--front", type=click.Path(path_type=Path), help="Keep the front here (Parquet), and go on from it.")
@click.option("--figure", type=click.Path(path_type=Path), help="Draw the front, the paper's mirrors marked.")
@click.option("--pick", type=int, help="Which design of the front to write.")
@click.option("-o", "--out", type=click.Path(path_type=Path), help="Write the mirror found as a sensor file.")
@click.pass_context
def command(ctx: click.Context, /, sensor: str | None, merit: str, merits: list[str] | None, **options: Any) -> None:
    """Find the mirror of free form with the least MERIT for a field, a size and a lens.

    They are those of the paper's sensors, or of SENSOR, a sensor file or the name of a bundled one; options change
    them. Example: omnimirror optimise paper-spherical --merit blur_area -o sharper.toml
    """
    given = [n for n in options if ctx.get_parameter_source(n) is click.core.ParameterSource.COMMANDLINE]
    refuse_other(given, ONLY, "--merit" if merits is None else "--pareto")
    terms = options.pop("terms") or [12]
    names = ("starts", "seed", "checkpoint", "population", "generations", "front", "figure", "pick", "out")
    o = {name: options.pop(name) for name in names}
    limits = dict(options.pop("limits"))
    options["mode"] = "paper" if options.pop("paper_mode") else None
    problem = problem_like(sensor, {**options, "terms": terms[0]})
    console = output_console()
    if merits is None:
        run_optimise(console, problem, merit, terms, limits, o["starts"], o["seed"], o["checkpoint"], o["out"])
    else:
        if len(terms) > 1:
            raise click.UsageError("a front has one number of --terms")
        run_pareto(
            console, problem, merits, limits, o["population"], o["generations"], o["seed"], o["front"], o["figure"],
            o["pick"], o["out"],
        )  # fmt: skip
