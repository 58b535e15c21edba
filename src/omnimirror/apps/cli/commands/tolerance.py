"""``omnimirror tolerance``: tolerance analysis and manufacturing yield."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click
from rich.console import Console

from ....base.block_runner import WHOLE
from ....base.errors import InvalidParameter, OmnimirrorError
from ....base.escaping import shell_command
from ....base.files import display_name, is_stream, write_json, write_text
from ....design.requirement_files import load_requirements
from ....manufacturing.tolerancing.compensation import CALIBRATIONS, after
from ....manufacturing.tolerancing.evaluator import is_lower_limit, is_requirement_merit
from ....manufacturing.tolerancing.monte_carlo import format_motion
from ....manufacturing.tolerancing.sweep import SHARD_TRIALS, Sweep
from ....manufacturing.tolerancing.tolerance_analysis import (
    ToleranceReport,
    TypicalSensor,
    tolerance,
    typical_sensors,
    with_requirements,
)
from ....manufacturing.tolerancing.tolerance_file import (
    TolerancePlan,
    load_tolerances,
    tolerance_template,
)
from ....manufacturing.tolerancing.tolerances import GRADES
from ....optics.sensor_files import load_sensor
from .._declarations import (
    NUMBER,
    SENSOR,
    DocumentedCommand,
    IntegerRange,
    Options,
    add_options,
    file_entries,
    flag,
    option,
    part,
    setting,
)
from .._output import (
    json_option,
    output_console,
    output_option,
    plain_table,
    print_line,
    print_written,
    progress_bar,
)

INIT = "init"
TEMPLATE = "tolerances.toml"
SHARDS = "trials"
"""Subfolder of --output for trials."""
MAX_ROWS = 12


@dataclass(frozen=True)
class TrialOptions(Options):
    """Number of trials, limits and analyses."""

    trials: int = option(default=10_000, type=IntegerRange(1), help="Number of Monte Carlo trials.")
    target_yield: float | None = option(
        "--yield",
        type=NUMBER,
        metavar="YIELD",
        help="Target yield, for example 0.95; allocates tolerances at minimum cost.",
    )
    merits: tuple[str, ...] = option(
        "--merit",
        default=(),
        multiple=True,
        metavar="NAME=LIMIT",
        help="Limit instead of those of the file, 'motion_px after pose=0.5' or 'min aspect, 20 "
        "to 90 deg=0.8' (repeatable).",
    )
    requirements: str | None = option(
        metavar="FILE",
        help="Requirement file with limits and object distance, instead of those of TOLERANCES.",
    )
    seed: int = setting("analysis", 0, type=IntegerRange(0))
    variance: bool = setting("analysis", False)
    typical_sensors: bool = setting("analysis", False)

    def plan(self, plan: TolerancePlan) -> TolerancePlan:
        """Return the plan with the limits of the options."""
        if self.requirements is not None:
            plan = with_requirements(plan, load_requirements(self.requirements))
        limits = dict(_limit(text) for text in self.merits)
        if self.requirements is not None:
            limits = {**plan.limits, **limits}
        return replace(plan, limits=limits) if limits else plan


@dataclass(frozen=True)
class SweepOptions(Options):
    """Storage of trials in shards, and their execution."""

    part: str | None = option(
        metavar="I/N",
        help="Compute the I-th of N parts; run without this option to combine all parts.",
    )
    scheduler: str | None = setting("sweep")
    shard_trials: int | None = setting("sweep", type=IntegerRange(1))

    def of(self, trials: int, out: Path | None) -> Sweep | None:
        """Return the storage of the trials; None for a single shard without options."""
        size = self.shard_trials or SHARD_TRIALS
        if out is None:
            for name in self.changed:
                raise click.UsageError(f"{flag(name)} requires --output, the folder of the trials")
            return None
        if trials <= size and not self.changed:
            return None
        return Sweep(
            out / SHARDS,
            WHOLE if self.part is None else part(self.part),
            self.scheduler,
            size,
        )


@click.command(
    cls=DocumentedCommand,
    page="tolerance",
    examples=(
        "omnimirror tolerance init paper-spherical",
        "omnimirror tolerance paper-spherical tolerances.toml --trials 20000",
    ),
)
@click.argument("sensor", type=SENSOR)
@click.argument("tolerances", required=False)
@add_options(TrialOptions, "options")
@add_options(SweepOptions, "storage")
@click.option(
    "--grade",
    type=click.Choice(GRADES),
    default="medium",
    show_default=True,
    help="Manufacturing grade; with init.",
)
@file_entries("tolerance file", ("objects",))
@output_option(
    "-o",
    "--output",
    "out",
    help="Folder for charts, numbers and trials of long runs; repeating the command continues a "
    f"run. With init, tolerance file.  [default: {TEMPLATE}]",
)
@output_option(
    "--report", "report_file", formats=("html",), help="Write an HTML report for the manufacturer."
)
@json_option("Write all results as JSON.")
def command(
    sensor: str,
    tolerances: str | None,
    options: TrialOptions,
    storage: SweepOptions,
    grade: str,
    out: Path | None,
    report_file: Path | None,
    json_file: Path | None,
    changes: dict[str, Any],
) -> None:
    """Run a tolerance analysis of SENSOR with the TOML file TOLERANCES and predict the
    manufacturing yield.

    Prints the yield, the sensitivity to each error, and residuals after calibrations; with --yield,
    allocates tolerances of minimum cost.

    omnimirror tolerance init SENSOR writes a commented tolerance file.
    """
    # More than 60 lines: the options of the command, then one call each of analysis, report and output.
    if sensor == INIT:
        return _init(tolerances, grade, out)
    if tolerances is None:
        command = shell_command(["omnimirror", "tolerance", "init", sensor])
        raise click.UsageError(f"TOLERANCES is missing; write a template with: {command}")
    nominal = load_sensor(sensor)
    if out is not None and (out.is_file() or is_stream(out)):
        raise click.UsageError(f"--output must be a folder; {display_name(out)} is a file")
    plan = options.plan(load_tolerances(tolerances, nominal, changes))
    if options.typical_sensors and out is None:
        raise click.UsageError("analysis.typical_sensors requires --output")
    if report_file is not None:  # before any computation
        from ...reports.tolerances import page_name

        page_name(report_file)
    console, sweep = output_console(), storage.of(options.trials, out)
    with progress_bar(console) as bar:
        task = bar.add_task("Simulating", total=options.trials)
        report = tolerance(
            nominal,
            plan,
            trials=options.trials,
            seed=options.seed,
            target_yield=options.target_yield,
            variance=options.variance,
            sweep=sweep,
            on_progress=lambda done, all_: bar.update(task, completed=done, total=all_),
            on_warning=lambda message: print_line(message, console=console),
        )
    merit = next(iter(report.plan.limits), "motion_px")
    typical = (
        typical_sensors(nominal, report.plan, merit, trials=options.trials, seed=options.seed)
        if options.typical_sensors
        else []
    )
    _print(console, report)
    if sweep is not None:
        print_line(f"\nTrials stored in {sweep.folder}", console=console)
        if not sweep.is_whole:  # charts require all trials
            print_line(
                f"Part {storage.part} completed; when all parts are done, run without --part to combine them",
                console=console,
            )
            out = None
    written = _write(report, out, json_file)
    if report_file is not None:
        from ...reports.tolerances import write_tolerances

        written.append(write_tolerances(report, report_file))
    if typical and out is not None:
        written += _write_typical(typical, merit, out, console)
    print_written(*written, console=console)


def _init(name: str | None, grade: str, out: Path | None) -> None:
    if name is None:
        raise click.UsageError("SENSOR is missing: omnimirror tolerance init SENSOR")
    path = Path(TEMPLATE) if out is None else out
    if out is None and path.exists():
        raise OmnimirrorError(
            f"{path} already exists; rename it, or specify the file with --output"
        )
    write_text(path, tolerance_template(load_sensor(name), grade))
    if not is_stream(path):
        command = shell_command(["omnimirror", "tolerance", name, path])
        print_line(f"Wrote {path}; edit it, then run: {command}")


def _limit(text: str) -> tuple[str, float]:
    """Parse a limit such as ``motion_px after pose=0.3``."""
    name, _, value = text.rpartition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise InvalidParameter(
            f"--merit must be NAME=LIMIT, such as 'motion_px after pose=0.3'; got {text!r}"
        ) from None


def _print(console: Console, report: ToleranceReport) -> None:
    statistics, of = report.statistics, report.statistics.yields
    lost_trials = f", {statistics.lost} lose rays" if statistics.lost else ""
    console.print(f"{statistics.trials} trials{lost_trials}; seed {report.seed}\n")
    table = plain_table("merit", "limit", "median", "95 %", "99 %", "good %")
    usual = (
        *(after("motion_px", depth) for depth in CALIBRATIONS),
        "direction_error_deg",
        "blur_px",
    )
    for name in (*usual, *(name for name in statistics.limits if name not in usual)):
        limit = statistics.limits.get(name)
        good = (
            "" if limit is None else f"{100 * statistics.passed_each[name] / statistics.trials:.1f}"
        )
        digits = 6 if is_requirement_merit(name) else 3  # more digits: these merits may vary little
        values = [f"{statistics.quantile(name, share):.{digits}g}" for share in (0.5, 0.95, 0.99)]
        side = "" if limit is None else f"{'≥' if is_lower_limit(name) else '≤'} {limit:g}"
        table.add_row(name, side, *values, good)
    console.print(table)
    console.print(
        f"\nyield {100 * of.value:.2f} % (95 % confidence: {100 * of.low:.2f} to {100 * of.high:.2f} %)\n"
    )
    table = plain_table(
        "single error", "tolerance", "motion px", "after affine", "after pose", "max. tolerance"
    )
    ranked = sorted(report.sensitivities, key=lambda row: -row.merits["motion_px"])
    for row in ranked[:MAX_ROWS]:
        motions = [
            format_motion(row.merits[after("motion_px", depth)])
            for depth in ("none", "affine", "pose")
        ]
        alone = min(row.max_tolerance.values(), default=float("nan"))
        table.add_row(
            row.name,
            f"{row.tolerance:.3g}",
            *motions,
            "any" if alone == float("inf") else f"{alone:.3g}",
        )
    console.print(table)
    if len(ranked) > MAX_ROWS:
        console.print(
            f"... and {len(ranked) - MAX_ROWS} smaller ones; use --json or --output for all"
        )
    _print_variance(console, report)
    _print_allocation(console, report)


def _print_variance(console: Console, report: ToleranceReport) -> None:
    if (variance := report.variance) is None:
        return
    for merit, shares in variance.indices.items():
        console.print(f"\nSobol indices of {merit}\n")
        table = plain_table("error or group", "first order %", "total %", "+-")
        for name, share in sorted(shares.items(), key=lambda item: -item[1].total)[:MAX_ROWS]:
            label = f"{name} ({len(variance.groups[name])})" if name in variance.groups else name
            table.add_row(
                label,
                *(f"{100 * v:.1f}" for v in (share.first, share.total, 2 * share.total_error)),
            )
        console.print(table)


def _print_allocation(console: Console, report: ToleranceReport) -> None:
    if (allocation := report.allocation) is None:
        return
    of = allocation.confirmed_yield
    console.print(
        f"\nallocated tolerances: yield {100 * of.value:.2f} % ({100 * of.low:.2f} to "
        f"{100 * of.high:.2f} %) of {allocation.trials} independent trials\ncost "
        f"{allocation.cost:.4g}; {allocation.uniform_cost:.4g} with uniform scaling\n"
    )
    table = plain_table("error", "initial", "allocated", "factor")
    for name, value in allocation.tolerances.items():
        initial = report.plan.tolerances.errors[name].value
        table.add_row(name, f"{initial:.3g}", f"{value:.3g}", f"{value / initial:.2g}")
    console.print(table)
    if allocation.at_maximum:
        console.print(
            f"\nat their maximum (max_tolerance, or the coarse grade): {', '.join(allocation.at_maximum)}"
        )


def _write_typical(
    typical: list[TypicalSensor], merit: str, out: Path, console: Console
) -> list[Path]:
    from ....io.images import write_image
    from ....optics.sensor_files import save_sensor
    from ....simulation.rendering import render_image
    from ....simulation.scenes.room import Room

    written = []
    for trial in typical:
        name = f"{100 * trial.quantile:02.0f}"
        files = [out / f"sensor-{name}.toml", out / f"image-{name}.png"]
        save_sensor(trial.sensor, files[0])
        write_image(files[1], render_image(trial.sensor, Room(), blur=True))
        summary = f"sensor {name} %: trial {trial.trial}, {merit} {trial.merit:.3g}"
        print_line(summary, console=console)
        written += files
    return written


def _write(report: ToleranceReport, out: Path | None, json_file: Path | None) -> list[Path]:
    written = []
    if out is not None:
        from ....analysis.figures.style import save_figure, styled
        from ....manufacturing.tolerancing.charts import curves, plot_tornado, plot_variance

        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "tolerance.json", report.to_dict())
        with styled():
            save_figure(plot_tornado(report.sensitivities), out / "tornado.svg")
            save_figure(curves(report.statistics), out / "yield.svg")
            if report.variance is not None:
                save_figure(plot_variance(report.variance), out / "variance.svg")
        charts = (
            "tornado.svg",
            "yield.svg",
            *(() if report.variance is None else ("variance.svg",)),
        )
        written += [out / name for name in ("tolerance.json", *charts)]
    if json_file is not None:
        write_json(json_file, report.to_dict())
        written.append(json_file)
    return written
