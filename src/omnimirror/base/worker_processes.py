"""Worker processes for computations that are limited by the Python interpreter lock.

They are started directly rather than with :mod:`multiprocessing`, because forking requires a
process without threads, and spawning runs an unguarded main script again. A worker reads jobs
from its input and writes the results.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from queue import SimpleQueue
from threading import Lock, Thread, local
from typing import IO, Any, Generic, Self, TypeVar

from .errors import OmnimirrorError
from .interrupts import postponed
from .native import usable_cores

T = TypeVar("T")
MAX_PROCESSES = 8  # default; each requires about 100 MB


def start_process(
    module: str, environment: dict[str, str] | None = None
) -> subprocess.Popen[bytes]:
    """Start a module as a process with pipes, isolated from Ctrl-C in this process."""
    return subprocess.Popen(
        [sys.executable, "-m", module],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        start_new_session=True,
        env=os.environ | (environment or {}),
    )


def terminate_process(process: subprocess.Popen[bytes]) -> None:
    """Terminate a process and close its pipes."""
    process.kill()
    process.wait()  # short, because the process is killed
    for stream in (process.stdin, process.stdout):
        with suppress(OSError):  # the last message may be undelivered
            stream.close()  # type: ignore[union-attr]


class WorkerPool:
    """Pool of worker processes, started on demand; this process also computes.

    Parameters
    ----------
    processes
        Number of processes including this one; by default the number of available cores, at most 8.

    Examples
    --------
    >>> with WorkerPool() as spread:
    ...     spread.map(divmod, [(7, 2), (9, 4)])
    [(3, 1), (2, 1)]
    """

    def __init__(self, processes: int | None = None) -> None:
        self._processes = processes or min(usable_cores(), MAX_PROCESSES)
        self._workers: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._terminate()

    def _terminate(self) -> None:
        """Terminate all workers."""
        for worker in self._workers:
            terminate_process(worker)
        self._workers = []

    def begin(self) -> None:
        """Start workers in advance, while this process continues."""
        self._running_workers(self._processes - 1)

    def map(self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]]) -> list[T]:
        """Apply a module-level function to each set of arguments and return the results in order.

        Raises
        ------
        Exception
            If one of the calls raises an exception.
        """
        results: list[T | None] = [None] * len(jobs)
        for number, result in self.each(function, jobs):
            results[number] = result
        return results  # type: ignore[return-value]

    def each(
        self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, T]]:
        """Yield each result with its index, in order of completion."""
        pending, done = deque(enumerate(jobs)), SimpleQueue[_Result[T]]()
        for worker in self._running_workers(min(len(jobs), self._processes) - 1):
            Thread(
                target=_process_jobs, args=(worker, function, pending, done), daemon=True
            ).start()
        remaining = len(jobs)
        try:
            while remaining:
                try:
                    number, job = pending.popleft()
                except IndexError:  # the last jobs are with the workers
                    finished = [done.get()]
                else:
                    finished = [_Result(number, function(*job))]
                while not done.empty():
                    finished.append(done.get())
                for result in finished:
                    if result.failure is not None:
                        raise result.failure
                    if result.number is not None:
                        remaining -= 1
                        yield result.number, result.found  # type: ignore[misc]
        finally:
            pending.clear()
            if remaining:  # interrupted: discard the jobs of the workers
                self._terminate()

    def _running_workers(self, count: int) -> list[subprocess.Popen[bytes]]:
        """Return up to ``count`` running workers."""
        self._workers = [worker for worker in self._workers if worker.poll() is None]
        with suppress(OSError):  # process limit reached or no interpreter: continue without
            while len(self._workers) < count and sys.executable:
                with postponed():
                    self._workers.append(_start_worker())
        return self._workers[: max(count, 0)]


class WorkerDied(OmnimirrorError):
    """Error of a call whose worker process was killed."""


class ProcessExecutor(Executor):
    """Executor with worker processes; a killed process fails only its call and is replaced.

    Parameters
    ----------
    processes
        Number of processes.

    Examples
    --------
    >>> with ProcessExecutor(1) as executor:
    ...     executor.submit(divmod, 7, 2).result()
    (3, 1)
    """

    def __init__(self, processes: int) -> None:
        self._threads = ThreadPoolExecutor(processes, thread_name_prefix="worker-process")
        self._own, self._lock = local(), Lock()
        self._workers: list[subprocess.Popen[bytes]] = []
        self._is_cancelled = False

    def submit(  # type: ignore[override]
        self, function: Callable[..., T], /, *args: Any
    ) -> Future[T]:
        """Queue a call of a module-level function.

        The future raises the exception of the function, :class:`WorkerDied` if the process was
        killed, or the error of pickle for arguments that cannot be sent.
        """
        return self._threads.submit(self._call, function, args)

    def _call(self, function: Callable[..., T], args: tuple[Any, ...]) -> T:
        try:
            result: T = _compute(self._worker(), function, args)
        except _WorkerFailure as e:
            if isinstance(e.__cause__, OSError | EOFError | ValueError):
                raise WorkerDied("a worker process was killed; repeat the command") from None
            raise e.__cause__ or e from None
        return result

    def _worker(self) -> subprocess.Popen[bytes]:
        """Return the process of the current thread, which is started on demand."""
        worker: subprocess.Popen[bytes] | None = getattr(self._own, "worker", None)
        if worker is None or worker.poll() is not None:
            with self._lock:
                if self._is_cancelled:
                    raise WorkerDied("the workers were terminated; repeat the command")
                if worker is not None:
                    self._workers.remove(worker)
                    terminate_process(worker)
                worker = self._own.worker = _start_worker()
                self._workers.append(worker)
        return worker

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Terminate the processes, with ``cancel_futures`` during their calls."""
        if cancel_futures:
            self._threads.shutdown(wait=False, cancel_futures=True)
            with self._lock:
                self._is_cancelled = True
                for worker in self._workers:
                    worker.kill()
        self._threads.shutdown(wait=wait)
        with self._lock:
            for worker in self._workers:
                terminate_process(worker)
            self._workers = []


@dataclass(frozen=True)
class _Result(Generic[T]):
    """Result of a job."""

    number: int | None = None
    """None: a worker died, and its jobs may be pending."""
    found: T | None = None
    failure: Exception | None = None


class _WorkerFailure(Exception):
    """Failure of a worker process."""


def _process_jobs(
    worker: subprocess.Popen[bytes],
    function: Callable[..., T],
    pending: deque[tuple[int, Any]],
    done: SimpleQueue[_Result[T]],
) -> None:
    """Process jobs with a worker until none is pending.

    The job of a dead worker returns to the queue.
    """
    while True:
        try:
            number, job = pending.popleft()
        except IndexError:
            return
        try:
            done.put(_Result(number, _compute(worker, function, job)))
        except _WorkerFailure:
            pending.appendleft((number, job))
            return done.put(_Result())
        except Exception as e:
            return done.put(_Result(failure=e))


def _start_worker() -> subprocess.Popen[bytes]:
    """Start a worker with the same module search path and one thread."""
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    search_path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return start_process(__name__, search_path | one_thread)


def _compute(
    worker: subprocess.Popen[bytes], function: Callable[..., Any], job: tuple[Any, ...]
) -> Any:
    assert worker.stdin is not None
    assert worker.stdout is not None
    try:
        message = pickle.dumps((function, job))
    except Exception as e:  # for example, a class without a module-level name
        raise _WorkerFailure from e
    try:
        worker.stdin.write(len(message).to_bytes(8, "little") + message)
        worker.stdin.flush()
        result, failure = pickle.loads(_message(worker.stdout))
    except (OSError, EOFError, ValueError) as e:  # ValueError: its pipe was closed
        raise _WorkerFailure from e
    if failure is not None:
        raise failure
    return result


def _message(stream: IO[bytes]) -> bytes:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    return stream.read(int.from_bytes(head, "little"))


def _serve() -> None:
    """Process jobs until the input ends."""
    output, sys.stdout = sys.stdout.buffer, sys.stderr  # keep printed output out of results
    with suppress(BrokenPipeError):
        while True:
            try:
                function, job = pickle.loads(_message(sys.stdin.buffer))
            except Exception:  # end of input, or unknown class: the parent computes the job
                return
            try:
                message = pickle.dumps((function(*job), None))
            except Exception as e:
                message = pickle.dumps((None, e))
            output.write(len(message).to_bytes(8, "little") + message)
            output.flush()


if __name__ == "__main__":
    _serve()
