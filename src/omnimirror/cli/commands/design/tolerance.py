"""``omnimirror tolerance``: how well a sensor must be built, and how many of those built will be good."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click
from rich.console import Console

from ....design.criteria.requirement_file import load_requirements
from ....errors import InvalidParameter, OmnimirrorError
from ....escaping import shell_command
from ....files import is_stream, write_json, write_text
from ....manufacturing.tolerancing.compensation import CALIBRATIONS, after
from ....manufacturing.tolerancing.monte_carlo import motion_words
from ....manufacturing.tolerancing.perturbation import GRADES
from ....manufacturing.tolerancing.requirement_merits import is_least, is_required
from ....manufacturing.tolerancing.sweep import SHARD_TRIALS, WHOLE, Sweep
from ....manufacturing.tolerancing.tolerance_analysis import (
    ToleranceReport,
    TypicalSensor,
    limits_of,
    tolerance,
    typical_sensors,
)
from ....manufacturing.tolerancing.tolerance_file import load_tolerances, tolerance_template
from ....specs import load_sensor
from ...help_pages import DocumentedCommand
from ...options.common import NUMBER, SENSOR, WholeRange
from ...options.declared import Options, flag, option, takes
from ...outputs import json_option, output_console, output_option, plain_table, progress_bar, say, say_written

INIT = "init"
SHARDS = "trials"
"""Folder of them in that of --out."""
MOST_ROWS = 12


@dataclass(frozen=True)
class TrialOptions(Options):
    """How trials are made, and what is looked for."""

    trials: int = option(default=10_000, type=WholeRange(1), help="How many sensors are built.")
    seed: int = option(default=0, type=WholeRange(0), help="Same seed, same sensors.")
    wanted_yield: float | None = option(
        "--yield", type=NUMBER, metavar="SHARE", help="Find the cheapest tolerances for it, 0.95 say."
    )
    merits: tuple[str, ...] = option(
        "--merit",
        default=(),
        multiple=True,
        metavar="NAME=LIMIT",
        help="A limit in place of the file's, 'motion_px after pose=0.5' or 'least aspect, 20 to 90 deg=0.8'; repeat.",
    )
    requirements: str | None = option(
        metavar="FILE", help="Judge by the limits of this requirement file, in place of the file's own."
    )

    shares: bool = option(
        default=False, is_flag=True, help="Say what each error has of the variance of what is limited."
    )

    @property
    def limits(self) -> dict[str, float] | None:
        """In place of the file's."""
        asked = {} if self.requirements is None else limits_of(load_requirements(self.requirements).limits)
        if self.requirements is not None and not asked:
            raise InvalidParameter(f"{self.requirements} has no limits, by which sensors could be judged")
        return (asked | dict(_limit(words) for words in self.merits)) or None


@dataclass(frozen=True)
class SweepOptions(Options):
    """How trials are kept in shards, and who makes them."""

    part: str | None = option(metavar="I/N", help="Build the I-th of N parts only; the same without it sums up.")
    scheduler: str | None = option(metavar="ADDRESS", help="Let the workers of this Dask scheduler build them.")
    shard_trials: int | None = option(
        type=WholeRange(1),
        help=f"Trials of a shard of DIR/{SHARDS}; more than that are kept.  [default: {SHARD_TRIALS}]",
    )

    def of(self, trials: int, out: Path | None) -> Sweep | None:
        """Where trials are kept; they are not where all fit into one shard, and nothing is asked for."""
        size = self.shard_trials or SHARD_TRIALS
        if out is None:
            for name in self.changed:
                raise click.UsageError(f"{flag(name)} needs --out, the folder that keeps the trials")
            return None
        if trials <= size and not self.changed:
            return None
        return Sweep(out / SHARDS, WHOLE if self.part is None else _part(self.part), self.scheduler, size)


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
@takes(TrialOptions, "asked")
@takes(SweepOptions, "kept")
@click.option("--grade", type=click.Choice(GRADES), default="medium", show_default=True, help="Of the shop; with init.")
@click.option("--force", is_flag=True, help="With init: replace a file that exists.")
@click.option(
    "--out",
    type=click.Path(path_type=Path, file_okay=False),
    help="Write charts and numbers there, and keep the trials of long sweeps: the same command goes on with them.",
)
@click.option(
    "--save-trials",
    is_flag=True,
    help="Write the sensors at 5, 50 and 95 % of the first limit, or of motion_px, and their pictures to --out.",
)
@output_option("--report", "report_file", formats=("html",), help="Write a page to send with the order.")
@json_option("Write all numbers.")
def command(
    sensor: str, tolerances: str | None, asked: TrialOptions, kept: SweepOptions, grade: str, force: bool,
    out: Path | None, save_trials: bool, report_file: Path | None, json_file: Path | None,
) -> None:  # fmt: skip
    """Build SENSOR many times with the errors of TOLERANCES, a TOML file, and count those that are good.

    Says the yield, what each error does alone, and what calibrations take away again; with --yield, the cheapest
    tolerances that reach it.

    omnimirror tolerance init SENSOR writes a commented tolerance file to tolerances.toml.
    """
    if sensor == INIT:
        return _init(tolerances, grade, force)
    if tolerances is None:
        command = shell_command(["omnimirror", "tolerance", "init", sensor])
        raise click.UsageError(f"the file of tolerances is missing; {command} writes one")
    meant = load_sensor(sensor)
    plan = load_tolerances(tolerances, meant)
    if save_trials and out is None:
        raise click.UsageError("--save-trials needs --out, the folder that they are written to")
    if report_file is not None:  # before anything is built
        from ....report.tolerances import page_name

        page_name(report_file)
    console, sweep = output_console(), kept.of(asked.trials, out)
    with progress_bar(console) as bar:
        task = bar.add_task("building sensors", total=asked.trials)
        found = tolerance(
            meant, plan, limits=asked.limits, trials=asked.trials, seed=asked.seed, wanted_yield=asked.wanted_yield,
            shares=asked.shares, sweep=sweep, progress=lambda done, all_: bar.update(task, completed=done, total=all_),
            say=lambda sentence: say(sentence, console=console),
        )  # fmt: skip
    merit = next(iter(found.plan.limits), "motion_px")
    typical = typical_sensors(meant, found.plan, merit, trials=asked.trials, seed=asked.seed) if save_trials else []
    _print(console, found)
    if sweep is not None:
        say(f"\nTrials are in {sweep.folder}", console=console)
        if not sweep.is_whole:  # charts are of all
            say(f"This was part {kept.part}; when all are done, the same without --part sums up", console=console)
            out = None
    written = _write(found, out, json_file)
    if report_file is not None:
        from ....report.tolerances import write_tolerances

        written.append(write_tolerances(found, report_file))
    if typical and out is not None:
        written += _write_typical(typical, merit, out, console)
    say_written(*written, console=console)


def _init(name: str | None, grade: str, force: bool) -> None:
    if name is None:
        raise click.UsageError("a sensor is missing: omnimirror tolerance init SENSOR")
    path = Path("tolerances.toml")
    if path.exists() and not (force or is_stream(path)):
        raise OmnimirrorError(f"{path} exists already; rename it or give --force to replace it")
    write_text(path, tolerance_template(load_sensor(name), grade))
    say(f"Wrote {path}; change it, then: omnimirror tolerance {shell_command([name, path])}")


def _limit(words: str) -> tuple[str, float]:
    """``motion_px after pose=0.3``."""
    name, _, value = words.rpartition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise InvalidParameter(f"--merit {words!r} is not NAME=LIMIT, such as 'motion_px after pose=0.3'") from None


def _part(words: str) -> tuple[int, int]:
    """``2/8``."""
    try:
        i, n = (int(word) for word in words.split("/"))
    except ValueError:
        raise InvalidParameter(f"--part {words!r} is not I/N, such as 2/8") from None
    return i, n


def _print(console: Console, found: ToleranceReport) -> None:
    tally, of = found.tally, found.tally.yields
    lost = f", {tally.lost} lose rays" if tally.lost else ""
    console.print(f"{tally.trials} sensors built{lost}; seed {found.seed}\n")
    table = plain_table("merit", "limit", "median", "95 %", "99 %", "good %")
    usual = (*(after("motion_px", depth) for depth in CALIBRATIONS), "direction_error_deg", "blur_px")
    for name in (*usual, *(name for name in tally.limits if name not in usual)):
        limit = tally.limits.get(name)
        good = "" if limit is None else f"{100 * tally.passed_each[name] / tally.trials:.1f}"
        digits = 6 if is_required(name) else 3  # those may vary by little
        values = [f"{tally.quantile(name, share):.{digits}g}" for share in (0.5, 0.95, 0.99)]
        side = "" if limit is None else f"{'≥' if is_least(name) else '≤'} {limit:g}"
        table.add_row(name, side, *values, good)
    console.print(table)
    console.print(f"\nyield {100 * of.value:.2f} %, between {100 * of.low:.2f} and {100 * of.high:.2f} %\n")
    table = plain_table("error alone", "tolerance", "moves px", "left by affine", "left by pose", "may be alone")
    ranked = sorted(found.sensitivities, key=lambda row: -row.merits["motion_px"])
    for row in ranked[:MOST_ROWS]:
        motions = [motion_words(row.merits[after("motion_px", depth)]) for depth in ("none", "affine", "pose")]
        alone = min(row.alone.values(), default=float("nan"))
        table.add_row(row.name, f"{row.tolerance:.3g}", *motions, "any" if alone == float("inf") else f"{alone:.3g}")
    console.print(table)
    if len(ranked) > MOST_ROWS:
        console.print(f".. and {len(ranked) - MOST_ROWS} that do less; --json or --out tells all")
    _print_variance(console, found)
    _print_allocation(console, found)


def _print_variance(console: Console, found: ToleranceReport) -> None:
    if (variance := found.variance) is None:
        return
    for merit, shares in variance.shares.items():
        console.print(f"\nshares of the variance of {merit}\n")
        table = plain_table("error or group", "alone %", "in all %", "+-")
        for name, share in sorted(shares.items(), key=lambda item: -item[1].total)[:MOST_ROWS]:
            label = f"{name} ({len(variance.groups[name])})" if name in variance.groups else name
            table.add_row(label, *(f"{100 * v:.1f}" for v in (share.first, share.total, 2 * share.total_error)))
        console.print(table)


def _print_allocation(console: Console, found: ToleranceReport) -> None:
    if (cheapest := found.allocation) is None:
        return
    of = cheapest.reached
    console.print(
        f"\ncheapest tolerances: yield {100 * of.value:.2f} % ({100 * of.low:.2f} to {100 * of.high:.2f} %) of "
        f"{cheapest.trials} other sensors\nprice {cheapest.price:.4g}; {cheapest.price_of_equal:.4g} if all are scaled "
        "alike\n"
    )
    table = plain_table("error", "asked", "cheapest", "times")
    for name, value in cheapest.tolerances.items():
        asked = found.plan.tolerances.errors[name].value
        table.add_row(name, f"{asked:.3g}", f"{value:.3g}", f"{value / asked:.2g}")
    console.print(table)
    if cheapest.at_widest:
        console.print(
            f"\nas wide as they may be, by the file or as a coarse shop holds them: {', '.join(cheapest.at_widest)}"
        )


def _write_typical(typical: list[TypicalSensor], merit: str, out: Path, console: Console) -> list[Path]:
    from ....media.pictures.images import write_image
    from ....simulate.rendering.picture import take_picture
    from ....simulate.scenes.worlds.room import Room
    from ....specs import save_sensor

    written = []
    for trial in typical:
        name = f"{100 * trial.share:02.0f}"
        files = [out / f"sensor-{name}.toml", out / f"picture-{name}.png"]
        save_sensor(trial.sensor, files[0])
        write_image(files[1], take_picture(trial.sensor, Room(), blur=True))
        words = f"sensor {name} %: trial {trial.trial}, {merit} {trial.merit:.3g}"
        say(words, console=console)
        written += files
    return written


def _write(found: ToleranceReport, out: Path | None, json_file: Path | None) -> list[Path]:
    written = []
    if out is not None:
        from ....figures.style import save_figure, styled
        from ....manufacturing.tolerancing.charts import curves, tornado, variance_chart

        out.mkdir(parents=True, exist_ok=True)
        write_json(out / "tolerance.json", found.to_dict())
        with styled():
            save_figure(tornado(found.sensitivities), out / "tornado.svg")
            save_figure(curves(found.tally), out / "yield.svg")
            if found.variance is not None:
                save_figure(variance_chart(found.variance), out / "variance.svg")
        charts = ("tornado.svg", "yield.svg", *(() if found.variance is None else ("variance.svg",)))
        written += [out / name for name in ("tolerance.json", *charts)]
    if json_file is not None:
        write_json(json_file, found.to_dict())
        written.append(json_file)
    return written
