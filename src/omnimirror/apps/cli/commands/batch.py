"""``omnimirror batch``: batch processing of image archives."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click
from rich.progress import MofNCompleteColumn

from ....base.block_runner import WHOLE
from ....base.files import write_json
from ....interop.batch import BatchStatus, load_job, plan, run, status
from ....interop.batch.job import JOB_ENTRIES
from ....interop.batch.planning import sensor_table
from .._declarations import DocumentedCommand, file_entries, part
from .._output import (
    count_bar,
    json_option,
    output_console,
    plain_table,
    print_line,
    print_notice,
    print_written,
)

JOB = click.Path(path_type=Path, dir_okay=False)
MAX_PRINTED_ERRORS = 10


@click.group()
def command() -> None:
    """Dewarp, restore or render image archives, on one machine or a cluster."""


@command.command(
    "plan",
    cls=DocumentedCommand,
    page="batch",
    examples=("omnimirror batch plan job.toml",),
)
@click.argument("job", type=JOB)
@file_entries("job file", JOB_ENTRIES)
@json_option("Write sensors and numbers of outputs.")
def plan_command(job: Path, changes: dict[str, Any], json_file: Path | None) -> None:
    """List the inputs of JOB, assign sensors, and count pending outputs; reads no images."""
    batch_plan = plan(load_job(job, changes))
    batch_plan.write()
    console = output_console()
    table = plain_table("sensor", "camera", "inputs", text_columns=("sensor", "camera"))
    for row in batch_plan.sensor_counts():
        table.add_row(*map(str, row.values()))
    console.print(table)
    stale = len(batch_plan.stale_rows())
    record = {
        "inputs": len(batch_plan.items) + len(batch_plan.unassigned),
        "outputs": batch_plan.total,
        "pending": batch_plan.pending,
        "stale": stale,
        "unassigned": len(batch_plan.unassigned),
        "sensors": sensor_table(batch_plan.job),
    }
    print_line(
        f"{record['inputs']} inputs, {batch_plan.total} outputs, {batch_plan.pending} pending, {stale} stale",
        console=console,
    )
    for each in batch_plan.unassigned[:MAX_PRINTED_ERRORS]:
        reason = batch_plan.job.missing_sensor_message(each.camera, each.time)
        print_notice(f"{each.name}: {reason}")
    if json_file:
        write_json(json_file, record)
        print_written(json_file, console=console)


@command.command(
    "run",
    cls=DocumentedCommand,
    page="batch",
    examples=(
        "omnimirror batch run job.toml",
        "omnimirror batch run job.toml --part 3/16 --set execution.workers=4",
    ),
)
@click.argument("job", type=JOB)
@file_entries("job file", JOB_ENTRIES)
@click.option(
    "--part",
    "part_text",
    metavar="I/N",
    help="Compute the I-th of N parts, for array jobs without coordination.",
)
@click.option(
    "--scheduler",
    default="processes",
    show_default=True,
    metavar="NAME|ADDRESS",
    help="'processes', 'threads', 'local' for a local Dask cluster, or the address of a Dask "
    "scheduler.",
)
@click.option("--retry-failed", is_flag=True, help="Repeat failed inputs.")
@json_option("Write the numbers of outputs, and errors.")
def run_command(
    job: Path,
    changes: dict[str, Any],
    part_text: str | None,
    scheduler: str,
    retry_failed: bool,
    json_file: Path | None,
) -> None:
    """Compute the pending outputs of JOB; a repeated command continues."""
    own_part = WHOLE if part_text is None else part(part_text)
    with count_bar("Processing", MofNCompleteColumn()) as on_progress:
        result = run(
            load_job(job, changes),
            part=own_part,
            scheduler=scheduler,
            retry_failed=retry_failed,
            on_progress=on_progress,
        )
    _report(result, json_file)
    if result.exit_code:
        sys.exit(result.exit_code)


@command.command(
    "status",
    cls=DocumentedCommand,
    page="batch",
    examples=("omnimirror batch status job.toml",),
)
@click.argument("job", type=JOB)
@file_entries("job file", JOB_ENTRIES)
@json_option("Write the numbers of outputs, and errors.")
def status_command(job: Path, changes: dict[str, Any], json_file: Path | None) -> None:
    """Report the state of JOB, also while it runs: outputs, rate, remaining time and errors."""
    _report(status(load_job(job, changes)), json_file)


def _report(result: BatchStatus, json_file: Path | None) -> None:
    console = output_console()
    parts = [f"{result.done} of {result.total} outputs done", f"{result.failed} failed"]
    if result.rate_per_s:
        parts.append(f"{result.rate_per_s:.3g} per s")
    if result.pending and result.remaining_s is not None:
        parts.append(f"{_duration(result.remaining_s)} remaining")
    print_line(", ".join(parts), console=console)
    errors = list(result.errors.items())
    for name, error in errors[:MAX_PRINTED_ERRORS]:
        print_notice(error if name in error else f"{name}: {error}")
    if result.failed > MAX_PRINTED_ERRORS:
        print_notice(f"{result.failed - MAX_PRINTED_ERRORS} further errors in manifest.parquet")
    if result.stopped_by:
        print_notice("stopped; repeat the command to continue")
    if json_file:
        write_json(json_file, result.record())
        print_written(json_file, console=console)


def _duration(seconds: float) -> str:
    """Format a duration.

    >>> _duration(42.4), _duration(600), _duration(9000)
    ('42 s', '10 min', '2.5 h')
    """
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.1f} h"
