"""Who makes shards: threads of this process, or the workers of a Dask cluster; both are asked alike."""

from __future__ import annotations

import logging
import threading
from collections.abc import Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from itertools import islice
from typing import Any

from ....errors import OmnimirrorError
from ....media import interrupts
from ....native import backend
from .shards import Shard

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
