"""Planning, execution and status of batch jobs."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from ... import __version__
from ...base import interrupts
from ...base.arguments import validate_arguments
from ...base.block_runner import (
    WHOLE,
    BlockWorkers,
    check_part,
    check_scheduler,
    run_blocks,
    workers_in_processes,
    workers_in_threads,
    workers_on_cluster,
)
from ...base.errors import MediaError, OmnimirrorError
from ...base.files import parse_json
from ...base.results import Columns, Result, table_of
from ...base.worker_processes import WorkerDied
from ...io.batch import error_message
from .blocks import balance_blocks
from .job import BatchJob, load_job
from .manifest import DONE, FAILED, PLAN_NAME, REMOVED, BatchManifest, ManifestRow, ManifestWriter
from .planning import BatchPlan, plan_of, short_key, unassigned_key
from .stores import Store, remove_leftovers

RATE_PERIOD_S = 60.0
"""Period over which the rate is measured, s."""
MAX_ERRORS = 50
"""Maximum number of error messages in a status."""
PROCESSES, THREADS = "processes", "threads"


@dataclass(frozen=True)
class BatchStatus(Result):
    """State of a job.

    Attributes
    ----------
    total
        Number of outputs, one per input and view.
    done, failed
        Number of completed outputs, and of those whose input cannot be processed.
    rate_per_s
        Outputs per second during the last minute of the run.
    remaining_s
        Estimated remaining time, s; None without a rate.
    errors
        Messages of the first failed inputs by name.
    stopped_by
        Exit code of an interruption.

    Examples
    --------
    >>> BatchStatus(total=100, done=40, rate_per_s=2.0).remaining_s
    30.0
    """

    total: int
    done: int = 0
    failed: int = 0
    rate_per_s: float = 0.0
    errors: dict[str, str] = field(default_factory=dict)
    stopped_by: int = 0

    @property
    def pending(self) -> int:
        """Number of outputs that are not computed."""
        return self.total - self.done - self.failed

    @property
    def remaining_s(self) -> float | None:
        """Estimated remaining time, s."""
        if not self.pending:
            return 0.0
        return self.pending / self.rate_per_s if self.rate_per_s else None

    @property
    def exit_code(self) -> int:
        """Exit code: that of an interruption, 1 after failures, otherwise 0."""
        return self.stopped_by or int(self.failed > 0)

    def record(self) -> dict[str, Any]:
        """Return the state as JSON data."""
        return {
            "total": self.total,
            "done": self.done,
            "failed": self.failed,
            "pending": self.pending,
            "rate_per_s": self.rate_per_s,
            "remaining_s": self.remaining_s,
            "errors": self.errors,
        }

    def _table(self) -> Columns:
        return table_of([{"input": name, "error": text} for name, text in self.errors.items()])


@validate_arguments
def plan(job: BatchJob | str | Path) -> BatchPlan:
    """List the inputs of a job and compare its outputs with the manifest; no image is read.

    Parameters
    ----------
    job
        Job, or the name of a job file.

    Returns
    -------
    BatchPlan
        Inputs with sensors and outputs, and the number of pending ones.

    Raises
    ------
    OmnimirrorError
        If the job is invalid, inputs cannot be listed, or the manifest is damaged.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> from pathlib import Path
    >>> text = '''
    ... inputs.files = ["raw/*.png"]
    ... output.url = "views"
    ... view.north = {size = [64, 48]}
    ... [[sensor]]
    ... file = "paper-spherical"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/raw/a.png", np.zeros((1024, 1024), np.uint8))
    ...     _ = Path(f"{folder}/job.toml").write_text(text)
    ...     batch_plan = om.batch.plan(f"{folder}/job.toml")
    >>> batch_plan.total, batch_plan.pending
    (1, 1)
    """
    return plan_of(_job(job))


@validate_arguments
def run(
    job: BatchJob | str | Path,
    *,
    part: tuple[int, int] = WHOLE,
    scheduler: str = PROCESSES,
    retry_failed: bool = False,
    on_progress: Callable[[int, int], None] | None = None,
) -> BatchStatus:
    """Compute the pending outputs of a job; completed ones are kept.

    Parameters
    ----------
    job
        Job, or the name of a job file.
    part
        (i, n): compute only the i-th of n parts, as in array jobs.
    scheduler
        ``"processes"``, ``"threads"``, ``"local"`` for a local Dask cluster, or the address of a
        Dask scheduler.
    retry_failed
        Repeat failed inputs.
    on_progress
        Callback with the number of finished outputs and the total of the part.

    Returns
    -------
    BatchStatus
        State of the whole job, also after an interruption.

    Raises
    ------
    OmnimirrorError
        If the job is invalid, or an output cannot be written; completed outputs are kept.

    Examples
    --------
    >>> import numpy as np, omnimirror as om, tempfile
    >>> from pathlib import Path
    >>> text = '''
    ... inputs.files = ["raw/*.png"]
    ... output = {url = "views", name = "{stem}-{view}"}
    ... view.north = {size = [64, 48]}
    ... [[sensor]]
    ... file = "paper-spherical"
    ... '''
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/raw/a.png", np.zeros((1024, 1024), np.uint8))
    ...     _ = Path(f"{folder}/job.toml").write_text(text)
    ...     result = om.batch.run(f"{folder}/job.toml", scheduler="threads")
    ...     om.read_image(f"{folder}/views/a-north.png").shape
    (48, 64, 4)
    >>> result.done, result.failed
    (1, 0)
    """
    job = _job(job)
    check_part(part)
    check_scheduler(scheduler, PROCESSES, THREADS)
    store = job.store()
    if not store.is_remote:
        remove_leftovers(store.root)
    batch_plan = plan_of(job)
    batch_plan.write()
    planned, total, done = batch_plan.blocks(part, retry_failed)
    run_id = os.urandom(8).hex()
    blocks = [replace(block, run_id=run_id) for block in planned]
    own_rows = ManifestWriter(store)
    if part == WHOLE or part[0] == 1:
        _record_unassigned(batch_plan, own_rows)
    batch_plan.prepare()
    writers = {own_rows.name}
    if on_progress is not None:
        on_progress(done, total)
    stopped_by = 0
    if blocks:
        with interrupts.deferred(), _workers(job, scheduler) as workers:
            for outcome in run_blocks(balance_blocks(blocks, workers.count), workers, job.retries):
                if isinstance(outcome.error, WorkerDied):
                    outcome.block.fail(own_rows, str(outcome.error))
                elif outcome.error is not None:
                    raise OmnimirrorError(error_message(outcome.error))
                else:
                    writers.add(outcome.result)
                done += sum(len(item.outputs) for item in outcome.block.items)
                if on_progress is not None:
                    on_progress(done, total)
            stopped_by = interrupts.exit_code()
    batch_plan.manifest.merge(writers)
    batch_plan.manifest.refresh()
    _remove_stale(batch_plan, own_rows)
    batch_plan.manifest.merge([own_rows.name])
    batch_plan.manifest.refresh()
    batch_plan.manifest.write_table()
    return replace(_status(store, batch_plan.manifest), stopped_by=stopped_by)


@validate_arguments
def status(job: BatchJob | str | Path) -> BatchStatus:
    """Return the state of a job from its manifest, also while another process runs it.

    Parameters
    ----------
    job
        Job, or the name of a job file.

    Returns
    -------
    BatchStatus
        Number of outputs by state, rate, remaining time and errors.

    Raises
    ------
    OmnimirrorError
        If the job was not planned or run.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.batch.status("missing.toml")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.SpecError: path must be an existing job file; got 'missing.toml'
    """
    job = _job(job)
    store = job.store()
    return _status(store, BatchManifest(store))


def _job(job: BatchJob | str | Path) -> BatchJob:
    return job if isinstance(job, BatchJob) else load_job(job)


def _workers(job: BatchJob, scheduler: str) -> AbstractContextManager[BlockWorkers]:
    count = job.execution.workers
    if scheduler == PROCESSES:
        return workers_in_processes(count)
    if scheduler == THREADS:
        return workers_in_threads(count)
    return workers_on_cluster(scheduler, count, reconnect_s=job.execution.reconnect_s)


def _record_unassigned(batch_plan: BatchPlan, rows: ManifestWriter) -> None:
    for each in batch_plan.unassigned:
        rows.add(
            ManifestRow(
                key=unassigned_key(each),
                input=each.name,
                output="",
                view="",
                status=FAILED,
                error=batch_plan.job.missing_sensor_message(each.camera, each.time),
                time=each.time,
                camera=each.camera,
                version=__version__,
                finished=time.time(),
            )
        )
    rows.flush()


def _remove_stale(batch_plan: BatchPlan, rows: ManifestWriter) -> None:
    """Remove outputs of a former sensor, view or version whose replacement is complete."""
    stale = batch_plan.stale_rows()
    if not stale:
        return
    complete = {
        (item.source.name, output.view)
        for item in batch_plan.items
        for output in item.outputs
        if batch_plan.manifest.status(output.key, output.name) == DONE
    }
    used = {output.name for item in batch_plan.items for output in item.outputs}
    replaced = [row for row in stale if (row.input, row.view) in complete]
    retained = {row.output for row in stale if (row.input, row.view) not in complete}
    for name in {row.output for row in replaced} - used - retained:
        batch_plan.manifest.store.remove(name)
    for row in replaced:
        rows.add(replace(row, status=REMOVED, finished=time.time()))
    rows.flush()


def _status(store: Store, manifest: BatchManifest) -> BatchStatus:
    try:
        record = parse_json(store.read(PLAN_NAME))
        total, keys = int(record["total"]), set(record["keys"])
    except (MediaError, ValueError, TypeError, KeyError):
        raise OmnimirrorError(
            f"there is no plan in {store.root}; run omnimirror batch plan or run"
        ) from None
    latest: dict[str, ManifestRow] = {}
    for row in manifest.rows.values():
        before = latest.get(row.key)
        if row.status != REMOVED and (before is None or before.finished < row.finished):
            latest[row.key] = row
    rows = [row for row in latest.values() if short_key(row.key) in keys]
    failed = [row for row in rows if row.status == FAILED]
    done = [row.finished for row in rows if row.status == DONE]
    errors = {row.input: row.error for row in sorted(failed, key=lambda r: r.input)[:MAX_ERRORS]}
    return BatchStatus(total, len(done), len(failed), _rate(done), errors)


def _rate(finished: list[float]) -> float:
    """Return the rate in the last minute before the last output, per second.

    >>> round(_rate([float(n) / 10 for n in range(1000)]), 3)
    10.0
    """
    if len(finished) < 2:
        return 0.0
    end = max(finished)
    recent = [moment for moment in finished if moment >= end - RATE_PERIOD_S]
    return (len(recent) - 1) / max(end - min(recent), 1.0)
