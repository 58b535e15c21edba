"""What is asked of a sweep, and the manifest that says so beside its shards."""

from __future__ import annotations

import hashlib
import json
import logging
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import check_fields
from ...errors import InvalidParameter, OmnimirrorError
from ...files import check_file, json_plain, parse_json, read_text, replacing, write_text
from ...media import interrupts
from ...native import backend
from ...numerics.lazy import cached_property
from ...specs import tables_of
from .compensation import LOST, merit_names
from .evaluator import Judge
from .monte_carlo import Progress, Tally, check_limits, check_trials
from .tolerances import BLOCK, Tolerances
from .trial_images import Refocus

FORMAT = 1
MANIFEST = "_manifest.json"
"""Begins so that what reads folders of Parquet files passes it over."""


@dataclass(frozen=True)
class SweepPlan:
    """All that the merits of trials follow from, and how they are cut into shards.

    Attributes
    ----------
    tolerances
        Of a sensor.
    refocus, judged
        As :class:`omnimirror.TolerancePlan` has them.
    trials, seed
        How many sensors are built, from which random numbers.
    shard_trials
        How many of them a shard has: whole blocks.
    required
        Names of merits that are worked out because limits ask for them.
    """

    tolerances: Tolerances
    refocus: Refocus
    judged: Mapping[str, Any]
    trials: int
    seed: int
    shard_trials: int
    required: tuple[str, ...] = ()

    @property
    def shards(self) -> int:
        """How many there are."""
        return -(-self.trials // self.shard_trials)

    @property
    def merits(self) -> tuple[str, ...]:
        """Names of what each trial is judged by, in the order of columns."""
        return (*merit_names()[:-1], *self.required, LOST)

    @cached_property
    def asked(self) -> dict[str, Any]:
        """As the manifest says it."""
        errors = {name: [bound.value, bound.distribution] for name, bound in self.tolerances.errors.items()}
        said = {
            "format": FORMAT,
            "sensor": tables_of(self.tolerances.sensor),
            "errors": errors,
            "correlations": [[*pair, value] for pair, value in self.tolerances.correlations.items()],
            "forms": {name: [form.zernike, form.um] for name, form in self.tolerances.forms.items()},
            "refocus": self.refocus,
            "judged": dict(self.judged),
            "trials": self.trials,
            "seed": self.seed,
            "shard_trials": self.shard_trials,
            "block": BLOCK,
            "merits": self.merits,
        }
        return dict(json.loads(json.dumps(json_plain(said))))

    @cached_property
    def digest(self) -> str:
        """Of what is asked; each shard bears it."""
        return hashlib.blake2b(json.dumps(self.asked).encode(), digest_size=16).hexdigest()


def is_asked(folder: Path, plan: SweepPlan) -> bool:
    """Whether the manifest in a folder is that of a sweep."""
    path = folder / MANIFEST
    return path.exists() and _asked_in(path) == plan.asked


def claim(folder: Path, plan: SweepPlan) -> None:
    """Write the manifest of a sweep into its folder, unless it is there.

    Raises
    ------
    OmnimirrorError
        The folder belongs to another sweep, or cannot be written.
    """
    path = folder / MANIFEST
    if not path.exists():
        return write_manifest(folder, plan, {})
    found = _asked_in(path)
    if found != plan.asked:
        changed = ", ".join(name for name in plan.asked if found.get(name) != plan.asked[name])
        raise OmnimirrorError(f"{folder} holds trials of something else ({changed} differ); name another folder")


def write_manifest(folder: Path, plan: SweepPlan, checksums: Mapping[str, str]) -> None:
    """What was asked, and the checksums of all shards by the names of their files, once all are there."""
    write_text(folder / MANIFEST, json.dumps({"asked": plan.asked, "shards": dict(checksums)}, indent=1) + "\n")


def _asked_in(path: Path) -> dict[str, Any]:
    try:
        return dict(parse_json(read_text(path, "manifest"))["asked"])
    except (ValueError, KeyError, TypeError):
        raise OmnimirrorError(f"{path} is not a manifest that omnimirror wrote; name another folder") from None


Rows = NDArray[np.float32]
KEY = "omnimirror"
TRIAL = "trial"


class CorruptShard(OmnimirrorError):
    """A shard does not hold what was written."""


@dataclass(frozen=True)
class Shard:
    """One file of a sweep, and what belongs into it; a pure function of this makes it, on any machine.

    Attributes
    ----------
    plan
        What was asked.
    folder
        Of all shards.
    number
        Of this one, from 0.
    """

    plan: SweepPlan
    folder: Path
    number: int

    @property
    def path(self) -> Path:
        """Of its file."""
        return self.folder / f"shard-{self.number:05}.parquet"

    @property
    def first(self) -> int:
        """Number of its first trial."""
        return self.number * self.plan.shard_trials

    @property
    def count(self) -> int:
        """How many trials it has."""
        return min(self.plan.shard_trials, self.plan.trials - self.first)

    def merits(self) -> Iterator[Rows]:
        """Merits (t, m) of its trials, block by block."""
        judge = Judge.of(self.plan.tolerances.sensor, self.plan.refocus, self.plan.required, **self.plan.judged)
        for trial in range(self.first, self.first + self.count, BLOCK):
            count = min(BLOCK, self.first + self.count - trial)
            yield judge.judged(self.plan.tolerances.drawn(self.plan.seed, trial // BLOCK, count)).astype(np.float32)

    def make(self, goes_on: Callable[[], bool] = lambda: True) -> None:
        """Compute it and write its file.

        Raises
        ------
        OmnimirrorError
            The folder is not that of this sweep on this machine, or cannot be written.
        """
        if not is_asked(self.folder, self.plan):
            raise OmnimirrorError(
                f"{self.folder / MANIFEST} of this sweep is not there, or another, on a machine that works for it; "
                "give a folder that all machines share"
            )
        pa, pq = _parquet()
        types = [(TRIAL, pa.int64()), *((name, pa.float32()) for name in self.plan.merits)]
        digest, trial = _checksum(), self.first
        plain: Any = {"use_dictionary": False, "compression": "none", "write_statistics": False}
        with replacing(self.path) as temporary, pq.ParquetWriter(temporary, pa.schema(types), **plain) as writer:
            for rows in self.merits():
                if not goes_on():
                    raise KeyboardInterrupt
                numbers = np.arange(trial, trial + len(rows))
                digest.update(_bytes_of(numbers, rows))
                columns = [numbers, *np.ascontiguousarray(rows.T)]
                writer.write_table(pa.table(columns, schema=pa.schema(types)))
                trial += len(rows)
            writer.add_key_value_metadata({KEY: json.dumps(self._about | {"checksum": digest.hexdigest()})})

    def checksum(self) -> str | None:
        """Return the checksum of its rows that its file holds; None if there is no file.

        Raises
        ------
        CorruptShard
            The file cannot be read, or is not this one.
        """
        if not self.path.exists():
            return None
        pa, pq = _parquet()
        try:
            check_file(self.path, self._largest)
            about = parse_json(pq.read_metadata(self.path).metadata[KEY.encode()])
            checksum = str(about.pop("checksum"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError, pa.ArrowException):
            raise CorruptShard(f"{self.path} is corrupt") from None
        if about != self._about:
            raise CorruptShard(f"{self.path} is not the shard that its name says")
        return checksum

    def rows(self) -> Iterator[Rows]:
        """Merits (t, m) of its trials, block by block, from its file.

        Raises
        ------
        CorruptShard
            After the last block, or before: they are not what was written.
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
            raise CorruptShard(f"{self.path} is corrupt") from None
        if digest.hexdigest() != expected or count != self.count:
            raise CorruptShard(f"{self.path} is corrupt: its rows are not those that were written")

    @property
    def _largest(self) -> int:
        """Bytes that its file may have: its rows are not compressed, and the rest describes each block of them."""
        return 2 * self.count * (8 + 4 * len(self.plan.merits)) + (1 << 20)

    @property
    def _about(self) -> dict[str, Any]:
        return {"asked": self.plan.digest, "shard": self.number, "trials": self.count}


def _bytes_of(numbers: NDArray[np.int64], rows: Rows) -> bytes:
    """Return what the checksum covers of some trials, row by row: numbers (t,) and merits (t, m).

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
        raise OmnimirrorError(
            "shards of trials need pyarrow, which is not installed: pip install 'omnimirror[design]'"
        ) from None


AHEAD = 3  # shards that wait, for each worker
CONNECT_S = 10.0


class Pool:
    """An executor that makes shards, and how many of them at a time."""

    def __init__(self, executor: Executor, workers: int, make: Any) -> None:
        self.executor, self.workers, self.make = executor, workers, make

    def made(self, shards: Iterable[Shard]) -> Iterator[Shard]:
        """Each shard as soon as its file is there.

        On Ctrl-C and SIGTERM what is under way is left, and the signal goes on.
        """
        left = iter(shards)
        with interrupts.postponed():
            waiting = {self._begin(shard): shard for shard in islice(left, AHEAD * self.workers)}
            while waiting and not interrupts.is_pending():
                for future in wait(waiting, interrupts.POLL_S, FIRST_COMPLETED).done:
                    shard = waiting.pop(future)
                    future.result()
                    waiting |= {self._begin(shard): shard for shard in islice(left, 1)}
                    yield shard

    def _begin(self, shard: Shard) -> Future[None]:
        return self.executor.submit(self.make, shard)


@contextmanager
def pool_of(scheduler: str | None) -> Iterator[Pool]:
    """Threads of this process, or an existing cluster by the address of its scheduler.

    Raises
    ------
    OmnimirrorError
        No scheduler answers there, or it has no workers; it or all that tried a shard were ended.
    """
    if scheduler is not None:
        with _cluster(scheduler) as pool:
            yield pool
        return
    ended = threading.Event()
    with ThreadPoolExecutor(backend.threads, thread_name_prefix="sweep") as executor:
        try:
            yield Pool(executor, backend.threads, partial(Shard.make, goes_on=lambda: not ended.is_set()))
        finally:
            ended.set()
            executor.shutdown(cancel_futures=True)


@contextmanager
def _cluster(address: str) -> Iterator[Pool]:
    try:
        distributed: Any = import_module("distributed")
    except ImportError:
        raise OmnimirrorError(
            "a scheduler needs distributed, which is not installed: pip install 'omnimirror[cluster]'"
        ) from None
    try:
        client = distributed.Client(address, timeout=CONNECT_S, set_as_default=False)
    except (OSError, ValueError):
        raise OmnimirrorError(f"no Dask scheduler answers at {address!r}; start one: dask scheduler") from None
    with _in_a_sentence(), client:
        threads = sum(client.nthreads().values())
        if not threads:
            raise OmnimirrorError(f"the scheduler at {address} has no workers; start some: dask worker {address}")
        try:
            yield Pool(client.get_executor(pure=False), threads, make_on_worker)
        except CancelledError:
            raise OmnimirrorError(
                f"the scheduler at {address} is gone; the shards that are done are kept, and the same command goes on"
            ) from None
        except distributed.KilledWorker:
            raise OmnimirrorError(
                "workers were killed again and again while they made one shard; those that are done are kept, and the "
                "same command goes on"
            ) from None


@contextmanager
def _in_a_sentence() -> Iterator[None]:
    """Leave it to errors to say what goes wrong: the client's log would say it before, in fifty lines."""
    log = logging.getLogger("distributed")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        log.setLevel(before)


def make_on_worker(shard: Shard) -> None:
    """Make a shard on one thread: a cluster has as many workers as it wants to keep busy.

    What goes wrong comes back as a sentence: a traceback that cannot be sent would leave the client waiting for ever.
    """
    backend.set_threads(1)
    try:
        shard.make()
    except OmnimirrorError:
        raise
    except Exception as e:
        raise OmnimirrorError(f"{shard.path} failed on a worker: {type(e).__name__}: {e}") from None


SHARD_TRIALS = 64 * BLOCK
"""Trials of a shard, unless said: 5 to 10 s of one core, 50 MB."""
ROUNDS = 3  # in which shards that turn out corrupt are made again
WHOLE = (1, 1)


@dataclass(frozen=True)
class Sweep:
    """Where the trials of a sweep are kept, and who makes them.

    Parameters
    ----------
    folder
        Of the shards and their manifest. What an earlier run left there, and other parts, is gone on with.
    part
        (i, n): make the i-th of n parts only, counted from 1, as jobs of an array do; all by default.
    scheduler
        Address of a Dask scheduler whose workers make the shards, into the same folder; threads of this process by
        default.
    shard_trials
        Trials of each shard.

    Raises
    ------
    InvalidParameter
        A part that is none, or shards that are no whole blocks.

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
        i, n = self.part
        if not 1 <= i <= n:
            raise InvalidParameter(f"part {i}/{n} is not valid; valid are 1/{max(n, 1)} to {max(n, 1)}/{max(n, 1)}")
        if self.shard_trials < 1 or self.shard_trials % BLOCK:
            raise InvalidParameter(
                f"shards of {self.shard_trials} trials are not valid; valid are multiples of {BLOCK}, which are drawn "
                "at a time"
            )

    @property
    def is_whole(self) -> bool:
        """Whether this is all of it."""
        return self.part == WHOLE


def run_sweep(
    sweep: Sweep,
    plan: SweepPlan,
    limits: Mapping[str, float],
    *,
    progress: Progress | None = None,
    say: Callable[[str], None] | None = None,
) -> Tally:
    """Make the shards that are missing, and count the trials of all.

    Parameters
    ----------
    sweep
        Where, and who makes them.
    plan
        What is asked; its shards are as large as the sweep's.
    limits
        What a good sensor stays within, by names of merits. Trials are judged by them as shards are read: the same
        shards tell the yield of other limits.
    progress
        Called with the trials that are done and all of them, of the part.
    say
        Called with a sentence for each shard that is corrupt.

    Returns
    -------
    Tally
        Of the trials of the part.

    Raises
    ------
    OmnimirrorError
        The folder belongs to another sweep or cannot be written, or shards do not last; what is done is kept.
    """
    check_limits(limits)
    check_trials(plan.trials)
    i, n = sweep.part
    shards = [Shard(plan, sweep.folder, number) for number in range(i - 1, plan.shards, n)]
    if not shards:
        raise InvalidParameter(
            f"part {i}/{n} has no trials: there are {plan.shards} shards; valid are up to as many parts"
        )
    claim(sweep.folder, plan)
    for _ in range(ROUNDS):
        _make_missing(shards, sweep.scheduler, progress, say)
        tally, checksums = Tally(dict(limits), plan.merits), dict[str, str]()
        for shard in shards:
            try:
                for rows in shard.rows():
                    tally.add(rows.astype(float))
                checksums[shard.path.name] = str(shard.checksum())
            except CorruptShard as e:
                _discard(shard, e, say)
        if len(checksums) < len(shards):
            continue
        if sweep.is_whole:
            write_manifest(sweep.folder, plan, checksums)
        return tally
    raise OmnimirrorError(f"shards in {sweep.folder} are corrupt again and again; its disk is not to be trusted")


def _make_missing(
    shards: list[Shard], scheduler: str | None, progress: Progress | None, say: Callable[[str], None] | None
) -> None:
    missing = []
    for shard in shards:
        try:
            if shard.checksum() is None:
                missing.append(shard)
        except CorruptShard as e:
            _discard(shard, e, say)
            missing.append(shard)
    trials = sum(shard.count for shard in shards)
    done = trials - sum(shard.count for shard in missing)
    if progress:
        progress(done, trials)
    if not missing:
        return
    with pool_of(scheduler) as pool:
        for shard in pool.made(missing):
            done += shard.count
            if progress:
                progress(done, trials)


def _discard(shard: Shard, why: CorruptShard, say: Callable[[str], None] | None) -> None:
    if say:
        say(f"{why}; it is made again")
    try:
        shard.path.unlink(missing_ok=True)
    except OSError as e:
        raise OmnimirrorError(f"cannot remove {shard.path}: {e.strerror}") from None
