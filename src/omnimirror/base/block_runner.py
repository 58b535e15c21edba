"""Runner for blocks of work in threads, worker processes or on a Dask cluster.

A block is a picklable task with a number and the name of its output, which is a pure function of
the block. Blocks are submitted through a bounded queue, repeated after transient errors with
exponential back-off, and divided into parts for array jobs. The outputs are
the only state: a repeated run submits the blocks without output.
"""

from __future__ import annotations

import ctypes
import logging
import pickle
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    CancelledError,
    Executor,
    Future,
    ThreadPoolExecutor,
    wait,
)
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from itertools import islice
from typing import Any, Generic, Protocol, TypeVar

from . import interrupts
from .arguments import format_value
from .errors import InvalidParameter, OmnimirrorError, extra_remedy
from .native import backend, usable_cores
from .worker_processes import WorkerDied, WorkerPool

AHEAD = 3
"""Maximum number of submitted blocks per worker, including the running one."""
CONNECT_S = 10.0
"""Timeout of a connection to a scheduler, s."""
WHOLE = (1, 1)
"""Part that contains all blocks."""


class BlockTask(Protocol):
    """Unit of work, picklable for worker processes and clusters."""

    @property
    def number(self) -> int:
        """Number of the block, from 0."""

    @property
    def name(self) -> str:
        """Name of the output, for messages."""

    def run(self) -> Any:
        """Write the output; the result is returned to the caller."""


B = TypeVar("B", bound=BlockTask)
T = TypeVar("T")


@dataclass(frozen=True)
class Outcome(Generic[B]):
    """Result or error of a block."""

    block: B
    result: Any = None
    error: BaseException | None = None

    def value(self) -> Any:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error
        return self.result


@dataclass(frozen=True)
class Retries:
    """Repetition after transient errors: timeouts, lost connections, killed workers.

    Parameters
    ----------
    attempts
        Maximum number of attempts.
    delay_s
        Delay before the second attempt, s; it doubles with each attempt.
    max_delay_s
        Maximum delay, s.

    Examples
    --------
    >>> [Retries(attempts=5, delay_s=1.0, max_delay_s=5.0).delay_after(n) for n in (1, 2, 3, 4)]
    [1.0, 2.0, 4.0, 5.0]
    """

    attempts: int = 1
    delay_s: float = 0.5
    max_delay_s: float = 30.0

    def delay_after(self, attempts: int) -> float:
        """Return the delay after a number of failed attempts, s."""
        return min(self.delay_s * 2.0 ** (attempts - 1), self.max_delay_s)

    def call(self, function: Callable[[], T]) -> T:
        """Call a function until it succeeds or fails permanently.

        >>> failures = [TimeoutError(), ConnectionError()]
        >>> def read():
        ...     if failures:
        ...         raise failures.pop()
        ...     return "data"
        >>> Retries(attempts=3, delay_s=0.0).call(read)
        'data'
        """
        attempts = 1
        while True:
            try:
                return function()
            except Exception as e:
                if attempts >= self.attempts or not is_transient(e):
                    raise
            time.sleep(self.delay_after(attempts))
            attempts += 1


ONCE = Retries()
PERMANENT = (FileNotFoundError, PermissionError, IsADirectoryError, NotADirectoryError)


def is_transient(error: BaseException) -> bool:
    """Return whether the repetition of a block may succeed.

    >>> is_transient(TimeoutError()), is_transient(FileNotFoundError()), is_transient(ValueError())
    (True, False, False)
    """
    return isinstance(error, OSError | WorkerDied) and not isinstance(error, PERMANENT)


# -- Parts of array jobs ---------------------------------------------------------------------------


def check_part(part: tuple[int, int]) -> None:
    """Check a part (i, n).

    Raises
    ------
    InvalidParameter
        Unless 1 <= i <= n.
    """
    i, n = part
    if not 1 <= i <= n:
        raise InvalidParameter(
            f"part must be between 1/{max(n, 1)} and {max(n, 1)}/{max(n, 1)}; got {i}/{n}"
        )


def part_of(blocks: Sequence[T], part: tuple[int, int]) -> Sequence[T]:
    """Return the i-th of n parts (i, n), from 1; the parts are disjoint and complete.

    >>> [part_of("abcde", (i, 2)) for i in (1, 2)]
    ['ace', 'bd']
    """
    check_part(part)
    i, n = part
    return blocks[i - 1 :: n]


# -- Workers ---------------------------------------------------------------------------------------

_thread = threading.local()


def is_stopping() -> bool:
    """Return whether the run of the current block is being cancelled.

    Long blocks in threads check this and raise KeyboardInterrupt. Blocks in worker processes are
    cancelled with their process.
    """
    ended: threading.Event | None = getattr(_thread, "ended", None)
    return interrupts.is_pending() or (ended is not None and ended.is_set())


class BlockWorkers:
    """Executor of blocks with a number of workers."""

    def __init__(self, executor: Executor, count: int) -> None:
        self.executor, self.count = executor, count

    def submit(self, block: BlockTask) -> Future[Any]:
        """Queue a block."""
        return self.executor.submit(run_on_worker, block)

    def recover(self) -> bool:
        """Restore lost workers; return whether all submitted blocks must be submitted again."""
        return False

    def close(self) -> None:
        """Remove waiting blocks and release the workers."""
        self.executor.shutdown(cancel_futures=True)


class ThreadWorkers(BlockWorkers):
    """Threads of this process, for blocks that release the interpreter lock."""

    def __init__(self, count: int) -> None:
        super().__init__(ThreadPoolExecutor(count, thread_name_prefix="block"), count)
        self.ended = threading.Event()

    def submit(self, block: BlockTask) -> Future[Any]:
        """Queue a block, which is not started after an interruption."""
        return self.executor.submit(self._run, block)

    def _run(self, block: BlockTask) -> Any:
        _thread.ended = self.ended
        if is_stopping():
            raise KeyboardInterrupt
        return block.run()

    def close(self) -> None:
        """Stop running blocks that check :func:`is_stopping`, and wait for them."""
        self.ended.set()
        super().close()


class ClusterWorkers(BlockWorkers):
    """Threads of a Dask cluster.

    Parameters
    ----------
    address
        Address of the scheduler.
    noun
        Noun for the outputs in messages.
    reconnect_s
        Time during which a lost scheduler is awaited; its blocks are then submitted again.
    """

    def __init__(self, address: str, noun: str = "outputs", reconnect_s: float = 0.0) -> None:
        self.address, self.noun, self.reconnect_s = address, noun, reconnect_s
        try:
            self.distributed: Any = import_module("distributed")
        except ImportError:
            raise OmnimirrorError(
                f"a scheduler requires distributed: {extra_remedy('cluster')}"
            ) from None
        self._connect()

    def _connect(self) -> None:
        try:
            self.client = self.distributed.Client(
                self.address, timeout=CONNECT_S, set_as_default=False
            )
        except (OSError, ValueError):
            raise OmnimirrorError(
                f"no Dask scheduler responds at {self.address!r}; start one with: dask scheduler"
            ) from None
        threads = sum(self.client.nthreads().values())
        if not threads:
            self.client.close()
            raise OmnimirrorError(
                f"the scheduler at {self.address} has no workers; start some with: "
                f"dask worker {self.address}"
            )
        super().__init__(self.client.get_executor(pure=False), threads)

    def submit(self, block: BlockTask) -> Future[Any]:
        """Queue a block."""
        return self.executor.submit(run_on_cluster, block)

    def recover(self) -> bool:
        """Wait for a restarted scheduler with workers.

        Raises
        ------
        OmnimirrorError
            If there is none within the time.
        """
        with suppress(Exception):
            self.client.close(timeout=1)
        end, delays = time.monotonic() + self.reconnect_s, Retries(delay_s=0.5, max_delay_s=5.0)
        attempts = 0
        while time.monotonic() < end and not interrupts.is_pending():
            attempts += 1
            with suppress(OmnimirrorError):
                self._connect()
                return True
            time.sleep(delays.delay_after(attempts))
        raise OmnimirrorError(
            f"the connection to the scheduler at {self.address} was lost; completed {self.noun} are "
            "kept, repeat the command to continue"
        )

    def close(self) -> None:
        """Remove waiting blocks and close the connection."""
        with suppress(Exception):  # the scheduler may not respond
            self.client.close(timeout=CONNECT_S)


def run_on_worker(block: BlockTask) -> Any:
    """Run a block in a worker process with one thread.

    Errors that cannot be serialised would block the client of a cluster and become messages.
    """
    backend.set_threads(1)
    try:
        return block.run()
    except Exception as e:
        if isinstance(e, OmnimirrorError) or (isinstance(e, OSError) and _is_picklable(e)):
            raise
        raise OmnimirrorError(f"{block.name} failed on a worker: {type(e).__name__}: {e}") from None


def run_on_cluster(block: BlockTask) -> Any:
    """Run a block in a worker of a Dask cluster."""
    reuse_freed_memory()
    return run_on_worker(block)


MMAP_BYTES, TRIM_BYTES = 32 << 20, 64 << 20
"""Maximum thresholds, in bytes, of the automatic adjustment in glibc."""


@cache
def reuse_freed_memory() -> None:
    """Raise the limits below which the GNU C library retains freed memory for further images.

    Dask starts workers with MALLOC_TRIM_THRESHOLD_ = 64 kB: the memory of each image is requested
    from the operating system and returned to it, and dewarping takes 30 % more processor time.
    Other C libraries are unaffected.
    """
    mmap_threshold, trim_threshold = -3, -1  # constants of malloc.h
    with suppress(OSError, AttributeError, TypeError):
        set_option = ctypes.CDLL(None).mallopt
        set_option(mmap_threshold, MMAP_BYTES)
        set_option(trim_threshold, TRIM_BYTES)


def _is_picklable(error: Exception) -> bool:
    try:
        return type(pickle.loads(pickle.dumps(error))) is type(error)
    except Exception:
        return False


LOCAL_CLUSTER = "local"
"""Name of a Dask cluster of this machine that exists for the run."""
LOCAL_CLUSTER_SETTINGS = {
    "distributed.worker.profile.enabled": False,
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "5s",
}
"""Settings of a local cluster, without the diagnostics of its dashboard."""


@contextmanager
def workers_in_threads(count: int | None = None) -> Iterator[BlockWorkers]:
    """Use threads of this process; by default one per core."""
    yield from _closing(ThreadWorkers(count or usable_cores()))


@contextmanager
def workers_in_processes(count: int | None = None) -> Iterator[BlockWorkers]:
    """Use worker processes with one thread each; by default one per core."""
    count = count or usable_cores()
    yield from _closing(BlockWorkers(WorkerPool(count), count))


def check_scheduler(scheduler: str, *names: str) -> None:
    """Raise an error unless a scheduler is one of several names or the address of a Dask cluster."""
    valid = (*names, LOCAL_CLUSTER)
    if scheduler not in valid and ":" not in scheduler:
        raise InvalidParameter(
            f"scheduler must be {', '.join(valid)} or the address of a Dask scheduler, such as "
            f"tcp://127.0.0.1:8786; got {format_value(scheduler)}"
        )


@contextmanager
def workers_on_cluster(
    address: str, count: int | None = None, *, noun: str = "outputs", reconnect_s: float = 0.0
) -> Iterator[BlockWorkers]:
    """Use a Dask cluster with the given scheduler address, or a local one for the address
    ``"local"``.

    ``count`` is the number of worker processes of a local cluster. The log of the client is
    suppressed, because its errors are reported as exceptions.

    Raises
    ------
    OmnimirrorError
        If distributed is not installed, or the scheduler does not respond or has no workers.
    """
    check_scheduler(address)
    log = logging.getLogger("distributed")
    before = log.level
    log.setLevel(logging.CRITICAL)
    try:
        if address != LOCAL_CLUSTER:
            yield from _closing(ClusterWorkers(address, noun, reconnect_s))
            return
        try:
            distributed: Any = import_module("distributed")
            config: Any = import_module("dask.config")
        except ImportError:
            raise OmnimirrorError(
                f"a Dask cluster requires distributed: {extra_remedy('cluster')}"
            ) from None
        with (
            config.set(LOCAL_CLUSTER_SETTINGS),
            distributed.LocalCluster(
                n_workers=count or usable_cores(),
                threads_per_worker=1,
                dashboard_address="127.0.0.1:0",
                silence_logs=logging.CRITICAL,
            ) as cluster,
        ):
            yield from _closing(ClusterWorkers(cluster.scheduler_address, noun))
    finally:
        log.setLevel(before)


def _closing(workers: BlockWorkers) -> Iterator[BlockWorkers]:
    try:
        yield workers
    finally:
        workers.close()


# -- Runner ----------------------------------------------------------------------------------------


def run_blocks(
    blocks: Iterable[B],
    workers: BlockWorkers,
    retries: Retries = ONCE,
    *,
    is_in_order: bool = False,
) -> Generator[Outcome[B], None, None]:
    """Yield the outcome of each block, in order of completion.

    At most :data:`AHEAD` blocks per worker are submitted at a time. After Ctrl-C or SIGTERM no
    further block is started; in threads, running blocks are completed. The signal is then raised,
    unless the caller defers it with :func:`omnimirror.base.interrupts.deferred`.

    Parameters
    ----------
    blocks
        Blocks, taken as workers become available.
    workers
        Executor, from :func:`workers_in_threads`, :func:`workers_in_processes` or
        :func:`workers_on_cluster`.
    retries
        Repetition of blocks after transient errors.
    is_in_order
        Yield the outcomes in the order of the blocks; outcomes that are kept until then count as
        submitted blocks, which bounds the memory.

    Raises
    ------
    OmnimirrorError
        If a cluster is lost.

    Examples
    --------
    >>> from collections import namedtuple
    >>> class Square(namedtuple("Square", "number name")):
    ...     def run(self):
    ...         return self.number**2
    >>> with workers_in_threads(2) as workers:
    ...     sorted(each.value() for each in run_blocks((Square(n, "") for n in range(4)), workers))
    [0, 1, 4, 9]
    """
    with interrupts.postponed():
        run = _Run(iter(blocks), workers, retries, deque() if is_in_order else None)
        yield from run.outcomes() if run.order is None else run.outcomes_in_order(run.order)


class _Run(Generic[B]):
    """Submitted and delayed blocks of a run."""

    def __init__(
        self,
        blocks: Iterator[B],
        workers: BlockWorkers,
        retries: Retries,
        order: deque[int] | None,
    ) -> None:
        self.blocks, self.workers, self.retries, self.order = blocks, workers, retries, order
        self.submitted: dict[Future[Any], tuple[B, int]] = {}
        self.delayed: list[tuple[float, B, int]] = []
        self.kept: dict[int, Outcome[B]] = {}

    def outcomes_in_order(self, order: deque[int]) -> Iterator[Outcome[B]]:
        for outcome in self.outcomes():
            self.kept[outcome.block.number] = outcome
            while order and order[0] in self.kept:
                yield self.kept.pop(order.popleft())

    def outcomes(self) -> Iterator[Outcome[B]]:
        self._fill()
        while self.submitted or self.delayed:
            if interrupts.is_pending():
                yield from self._rest()
                return
            if not self.submitted:
                time.sleep(interrupts.POLL_S)
            for future in wait(self.submitted, interrupts.POLL_S, FIRST_COMPLETED).done:
                if future not in self.submitted:  # submitted again after the loss of a cluster
                    continue
                block, attempts = self.submitted.pop(future)
                outcome = self._outcome(future, block, attempts)
                self._fill()
                if outcome is not None:
                    yield outcome
            self._fill()

    def _rest(self) -> Iterator[Outcome[B]]:
        """Yield the outcomes of running blocks in threads; others are not waited for."""
        if not isinstance(self.workers, ThreadWorkers):
            return
        for future, (block, _) in self.submitted.items():
            if not future.cancel():
                error = future.exception()
                if not isinstance(error, KeyboardInterrupt):
                    yield Outcome(block, None if error else future.result(), error)

    def _fill(self) -> None:
        """Queue blocks whose delay has passed, and further blocks up to the limit."""
        now, limit = time.monotonic(), AHEAD * self.workers.count
        due = [entry for entry in self.delayed if entry[0] <= now]
        self.delayed = [entry for entry in self.delayed if entry[0] > now]
        for _, block, attempts in due:
            self._submit(block, attempts)
        used = len(self.submitted) + len(self.delayed) + len(self.kept)
        free = 0 if interrupts.is_pending() else limit - used
        for block in islice(self.blocks, max(free, 0)):
            if self.order is not None:
                self.order.append(block.number)
            self._submit(block, 1)

    def _submit(self, block: B, attempts: int) -> None:
        self.submitted[self.workers.submit(block)] = block, attempts

    def _outcome(self, future: Future[Any], block: B, attempts: int) -> Outcome[B] | None:
        """Return the outcome of a block; None if it is repeated."""
        try:
            return Outcome(block, future.result())
        except KeyboardInterrupt:  # the block was not started, or stopped
            return None
        except CancelledError:  # of a cluster whose scheduler was lost
            self._submit_again(block, attempts)
            return None
        except BaseException as error:
            if type(error).__name__ == "KilledWorker":
                noun = getattr(self.workers, "noun", "outputs")
                error = WorkerDied(
                    f"workers were killed repeatedly while computing {block.name}; completed {noun} "
                    "are kept, repeat the command to continue"
                )
            if attempts < self.retries.attempts and is_transient(error):
                due = time.monotonic() + self.retries.delay_after(attempts)
                self.delayed.append((due, block, attempts + 1))
                return None
            return Outcome(block, None, error)

    def _submit_again(self, block: B, attempts: int) -> None:
        blocks = [(block, attempts), *self.submitted.values()]
        self.submitted.clear()
        if self.workers.recover():
            for each, count in blocks:
                self._submit(each, count)
