"""Parallel Monte Carlo sweeps: shards of trials in Parquet files, from threads or a Dask cluster.

A row of a shard is a trial: its number and its merits in single precision, which the statistics also
use. Plan digest and checksum of all columns are stored in the metadata of the file, which appears
under its name when complete. An interrupted run leaves complete shards only, and the next run
continues with the missing ones.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import check_fields
from ...base.block_runner import (
    WHOLE,
    check_part,
    is_stopping,
    part_of,
    run_blocks,
    workers_in_threads,
    workers_on_cluster,
)
from ...base.caching import cached_property
from ...base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from ...base.files import atomic_output, check_file, json_plain, parse_json, read_text, write_text
from ...base.native import backend
from ...optics.sensor_files import tables_of
from .compensation import LOST, merit_names
from .evaluator import TrialEvaluator
from .monte_carlo import Progress, YieldStatistics, check_limits, check_trials
from .tolerances import BLOCK, Tolerances
from .trial_images import Refocus

FORMAT = 1
MANIFEST = "_manifest.json"
"""Name of the manifest; readers of Parquet folders ignore files with an underscore."""


@dataclass(frozen=True)
class SweepPlan:
    """Definition of a sweep: all inputs that determine the trials, and their division into shards.

    Attributes
    ----------
    tolerances
        Tolerances of a sensor.
    refocus, objects
        As in :class:`omnimirror.TolerancePlan`.
    trials, seed
        Number of trials and random seed.
    shard_trials
        Trials per shard, a multiple of the block size.
    required
        Merits that limits require.
    """

    tolerances: Tolerances
    refocus: Refocus
    objects: Mapping[str, Any]
    trials: int
    seed: int
    shard_trials: int
    required: tuple[str, ...] = ()

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.trials // self.shard_trials)

    @property
    def merits(self) -> tuple[str, ...]:
        """Merit names in column order."""
        return (*merit_names()[:-1], *self.required, LOST)

    @cached_property
    def requested(self) -> dict[str, Any]:
        """Plan as stored in the manifest."""
        errors = {
            name: [bound.value, bound.distribution]
            for name, bound in self.tolerances.errors.items()
        }
        description = {
            "format": FORMAT,
            "sensor": tables_of(self.tolerances.sensor),
            "errors": errors,
            "correlations": [
                [*pair, value] for pair, value in self.tolerances.correlations.items()
            ],
            "forms": {
                name: [form.zernike, form.um] for name, form in self.tolerances.forms.items()
            },
            "refocus": self.refocus,
            "objects": dict(self.objects),
            "trials": self.trials,
            "seed": self.seed,
            "shard_trials": self.shard_trials,
            "block": BLOCK,
            "merits": self.merits,
        }
        return dict(json.loads(json.dumps(json_plain(description))))

    @cached_property
    def digest(self) -> str:
        """Digest of the plan, stored in each shard."""
        return hashlib.blake2b(json.dumps(self.requested).encode(), digest_size=16).hexdigest()


def is_claimed(folder: Path, plan: SweepPlan) -> bool:
    """Return whether the manifest of a folder matches a plan."""
    path = folder / MANIFEST
    return path.exists() and _requested_in(path) == plan.requested


def claim(folder: Path, plan: SweepPlan) -> None:
    """Write the manifest of a sweep to its folder unless present.

    Raises
    ------
    OmnimirrorError
        If the folder belongs to another sweep or cannot be written.
    """
    path = folder / MANIFEST
    if not path.exists():
        return write_manifest(folder, plan, {})
    matches = _requested_in(path)
    if matches != plan.requested:
        changed = ", ".join(
            name for name in plan.requested if matches.get(name) != plan.requested[name]
        )
        raise OmnimirrorError(
            f"{folder} contains trials of another sweep (different: {changed}); use another folder"
        )


def write_manifest(folder: Path, plan: SweepPlan, checksums: Mapping[str, str]) -> None:
    """Write the plan and, once complete, the checksums of all shards."""
    write_text(
        folder / MANIFEST,
        json.dumps({"requested": plan.requested, "shards": dict(checksums)}, indent=1) + "\n",
    )


def _requested_in(path: Path) -> dict[str, Any]:
    try:
        return dict(parse_json(read_text(path, "manifest"))["requested"])
    except (ValueError, KeyError, TypeError):
        raise OmnimirrorError(
            f"{path} is not a manifest of omnimirror; use another folder"
        ) from None


Rows = NDArray[np.float32]
KEY = "omnimirror"
TRIAL = "trial"


class CorruptShardError(OmnimirrorError):
    """Error of a shard whose content differs from the written data."""


@dataclass(frozen=True)
class Shard:
    """Shard of a sweep; its content is a pure function of these attributes.

    Attributes
    ----------
    plan
        Plan of the sweep.
    folder
        Folder of all shards.
    number
        Shard number, from 0.
    """

    plan: SweepPlan
    folder: Path
    number: int

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.folder / f"shard-{self.number:05}.parquet"

    @property
    def first(self) -> int:
        """Number of the first trial."""
        return self.number * self.plan.shard_trials

    @property
    def count(self) -> int:
        """Number of trials."""
        return min(self.plan.shard_trials, self.plan.trials - self.first)

    def merits(self) -> Iterator[Rows]:
        """Compute the merits (t, m) block by block."""
        evaluator = TrialEvaluator.of(
            self.plan.tolerances.sensor, self.plan.refocus, self.plan.required, **self.plan.objects
        )
        for trial in range(self.first, self.first + self.count, BLOCK):
            count = min(BLOCK, self.first + self.count - trial)
            yield evaluator.evaluate(
                self.plan.tolerances.drawn(self.plan.seed, trial // BLOCK, count)
            ).astype(np.float32)

    @property
    def name(self) -> str:
        """Path of the file, for messages."""
        return str(self.path)

    def run(self) -> None:
        """Compute the shard and write its file.

        Raises
        ------
        OmnimirrorError
            If the folder does not belong to the sweep on this machine or cannot be written.
        """
        if not is_claimed(self.folder, self.plan):
            raise OmnimirrorError(
                f"{self.folder / MANIFEST} of this sweep is missing on a worker, or belongs to another sweep; use a "
                "folder shared by all machines"
            )
        pa, pq = _parquet()
        types = [(TRIAL, pa.int64()), *((name, pa.float32()) for name in self.plan.merits)]
        digest, trial = _checksum(), self.first
        plain: Any = {"use_dictionary": False, "compression": "none", "write_statistics": False}
        with (
            atomic_output(self.path) as temporary,
            pq.ParquetWriter(temporary, pa.schema(types), **plain) as writer,
        ):
            for rows in self.merits():
                if is_stopping():
                    raise KeyboardInterrupt
                numbers = np.arange(trial, trial + len(rows))
                digest.update(_bytes_of(numbers, rows))
                columns = [numbers, *np.ascontiguousarray(rows.T)]
                writer.write_table(pa.table(columns, schema=pa.schema(types)))
                trial += len(rows)
            writer.add_key_value_metadata(
                {KEY: json.dumps(self._about | {"checksum": digest.hexdigest()})}
            )

    def checksum(self) -> str | None:
        """Return the stored checksum, or None without a file.

        Raises
        ------
        CorruptShardError
            If the file is unreadable or belongs to another shard.
        """
        if not self.path.exists():
            return None
        pa, pq = _parquet()
        try:
            check_file(self.path, self._largest)
            about = parse_json(pq.read_metadata(self.path).metadata[KEY.encode()])
            checksum = str(about.pop("checksum"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException):
            raise CorruptShardError(f"{self.path} is corrupt") from None
        if about != self._about:
            raise CorruptShardError(f"{self.path} contains another shard")
        return checksum

    def rows(self) -> Iterator[Rows]:
        """Read the merits (t, m) block by block.

        Raises
        ------
        CorruptShardError
            Before or after the last block, if the data are corrupt.
        """
        expected, digest, count = self.checksum(), _checksum(), 0
        pa, pq = _parquet()
        try:
            with pq.ParquetFile(self.path) as file:
                for batch in file.iter_batches(BLOCK, columns=[TRIAL, *self.plan.merits]):
                    numbers, *merits = (column.to_numpy() for column in batch.columns)
                    rows = np.stack(merits, axis=-1)
                    digest.update(_bytes_of(numbers, rows))
                    count += len(rows)
                    if count > self.count:
                        break
                    yield rows
        except (OSError, ValueError, pa.ArrowException):
            raise CorruptShardError(f"{self.path} is corrupt") from None
        if digest.hexdigest() != expected or count != self.count:
            raise CorruptShardError(f"{self.path} is corrupt: the checksum of its rows differs")

    @property
    def _largest(self) -> int:
        """Maximum file size in bytes, for uncompressed rows and block metadata."""
        return 2 * self.count * (8 + 4 * len(self.plan.merits)) + (1 << 20)

    @property
    def _about(self) -> dict[str, Any]:
        return {"requested": self.plan.digest, "shard": self.number, "trials": self.count}


def _bytes_of(numbers: NDArray[np.int64], rows: Rows) -> bytes:
    """Return the checksummed bytes of trials, row by row: numbers (t,) and merits (t, m).

    >>> len(_bytes_of(np.arange(3), np.zeros((3, 2), np.float32)))
    48
    """
    table = np.empty(len(rows), [("trial", "<i8"), ("merits", "<f4", rows.shape[1])])
    table["trial"], table["merits"] = numbers, rows
    return table.tobytes()


def _checksum() -> Any:
    return hashlib.blake2b(digest_size=16)


def _parquet() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise OmnimirrorError(f"shards require pyarrow: {extra_remedy('design')}") from None


SHARD_TRIALS = 64 * BLOCK
"""Default number of trials per shard: 5 to 10 s of one core, 50 MB."""
ROUNDS = 3  # attempts to recompute corrupt shards


@dataclass(frozen=True)
class Sweep:
    """Storage and execution of a sweep.

    Parameters
    ----------
    folder
        Folder of shards and manifest; existing shards of the same sweep are reused.
    part
        (i, n): compute only the i-th of n parts, from 1, as in array jobs; all by default.
    scheduler
        Address of a Dask scheduler whose workers write to the same folder; threads by default.
    shard_trials
        Trials per shard.

    Raises
    ------
    InvalidParameter
        If the part is invalid or the shard size is not a multiple of the block size.

    Examples
    --------
    >>> Sweep(Path("trials"), part=(2, 8)).part
    (2, 8)
    """

    folder: Path
    part: tuple[int, int] = WHOLE
    scheduler: str | None = None
    shard_trials: int = SHARD_TRIALS

    def __post_init__(self) -> None:
        check_fields(self)
        check_part(self.part)
        if self.shard_trials < 1 or self.shard_trials % BLOCK:
            raise InvalidParameter(
                f"shard_trials must be a positive multiple of {BLOCK}; got {self.shard_trials}"
            )

    @property
    def is_whole(self) -> bool:
        """True if all shards are computed."""
        return self.part == WHOLE


def run_sweep(
    sweep: Sweep,
    plan: SweepPlan,
    limits: Mapping[str, float],
    *,
    on_progress: Progress | None = None,
    on_warning: Callable[[str], None] | None = None,
) -> YieldStatistics:
    """Compute missing shards and accumulate the statistics of all trials.

    Parameters
    ----------
    sweep
        Storage and execution.
    plan
        Definition of the sweep, with the same shard size.
    limits
        Limits of a good sensor by merit name. They are applied when shards are read, so that existing
        shards also provide the yield for other limits.
    on_progress
        Callback with completed and total trials of the part.
    on_warning
        Callback with a message for each corrupt shard.

    Returns
    -------
    YieldStatistics
        Statistics of the part.

    Raises
    ------
    OmnimirrorError
        If the folder belongs to another sweep, cannot be written, or shards become corrupt repeatedly;
        completed shards are kept.
    """
    check_limits(limits)
    check_trials(plan.trials)
    numbers = part_of(range(plan.shards), sweep.part)
    shards = [Shard(plan, sweep.folder, number) for number in numbers]
    if not shards:
        i, n = sweep.part
        raise InvalidParameter(
            f"part must not exceed the number of shards, {plan.shards}; got {i}/{n}"
        )
    claim(sweep.folder, plan)
    for _ in range(ROUNDS):
        _make_missing(shards, sweep.scheduler, on_progress, on_warning)
        statistics, checksums = YieldStatistics(dict(limits), plan.merits), dict[str, str]()
        for shard in shards:
            try:
                for rows in shard.rows():
                    statistics.add(rows.astype(float))
                checksums[shard.path.name] = str(shard.checksum())
            except CorruptShardError as e:
                _discard(shard, e, on_warning)
        if len(checksums) < len(shards):
            continue
        if sweep.is_whole:
            write_manifest(sweep.folder, plan, checksums)
        return statistics
    raise OmnimirrorError(
        f"shards in {sweep.folder} become corrupt repeatedly; check the disk of this folder"
    )


def _make_missing(
    shards: list[Shard],
    scheduler: str | None,
    on_progress: Progress | None,
    on_warning: Callable[[str], None] | None,
) -> None:
    missing = []
    for shard in shards:
        try:
            if shard.checksum() is None:
                missing.append(shard)
        except CorruptShardError as e:
            _discard(shard, e, on_warning)
            missing.append(shard)
    trials = sum(shard.count for shard in shards)
    done = trials - sum(shard.count for shard in missing)
    if on_progress:
        on_progress(done, trials)
    if not missing:
        return
    pool = (
        workers_in_threads(backend.threads)
        if scheduler is None
        else workers_on_cluster(scheduler, noun="shards")
    )
    with pool as workers:
        for outcome in run_blocks(missing, workers):
            outcome.value()
            done += outcome.block.count
            if on_progress:
                on_progress(done, trials)


def _discard(
    shard: Shard, why: CorruptShardError, on_warning: Callable[[str], None] | None
) -> None:
    if on_warning:
        on_warning(f"{why}; the shard is computed again")
    try:
        shard.path.unlink(missing_ok=True)
    except OSError as e:
        raise OmnimirrorError(f"cannot remove {shard.path}: {e.strerror}") from None
