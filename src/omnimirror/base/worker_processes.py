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
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress
from queue import SimpleQueue
from threading import Lock
from typing import IO, Any, TypeVar

from .errors import OmnimirrorError
from .interrupts import postponed
from .native import usable_cores

T = TypeVar("T")
MAX_PROCESSES = 8  # default including this process; each requires about 100 MB


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
            stream.close()  # type: ignore[union-attr]  # started with pipes


class WorkerDied(OmnimirrorError):
    """Error of a call whose worker process was killed."""


class UnsentCall(OmnimirrorError):
    """Error of a call that cannot be sent to a worker process."""


class WorkerPool(Executor):
    """Executor with worker processes, which are started on demand and replaced when killed.

    Parameters
    ----------
    processes
        Number of worker processes; by default one per available core besides this process, at most
        7. Without worker processes, :meth:`each` and :meth:`starmap` compute in this process.

    Examples
    --------
    >>> with WorkerPool() as pool:
    ...     pool.starmap(divmod, [(7, 2), (9, 4)])
    [(3, 1), (2, 1)]
    >>> with WorkerPool(1) as pool:
    ...     pool.submit(divmod, 7, 2).result()
    (3, 1)
    """

    def __init__(self, processes: int | None = None) -> None:
        if processes is None:
            processes = min(usable_cores(), MAX_PROCESSES) - 1
        self._processes = processes
        self._threads = ThreadPoolExecutor(max(processes, 1), thread_name_prefix="worker-process")
        self._lock = Lock()
        self._workers: list[subprocess.Popen[bytes]] = []
        self._idle: list[subprocess.Popen[bytes]] = []
        self._is_cancelled = False

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        self.shutdown(cancel_futures=error is not None)

    def begin(self) -> None:
        """Start worker processes in advance, while this process continues."""
        with suppress(OSError), postponed(), self._lock:  # process limit: continue without
            for _ in range(self._processes - len(self._workers)):
                self._idle.append(self._start())

    def submit(  # type: ignore[override]  # keyword arguments are not sent
        self, function: Callable[..., T], /, *args: Any
    ) -> Future[T]:
        """Queue a call of a module-level function.

        The future raises the exception of the function, :class:`WorkerDied` if the process was
        killed, or :class:`UnsentCall` for arguments that cannot be sent.
        """
        return self._threads.submit(self._call, function, args)

    def starmap(self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]]) -> list[T]:
        """Apply a function to each set of arguments and return the results in order.

        Raises
        ------
        Exception
            If one of the calls raises an exception.
        """
        results: list[T | None] = [None] * len(jobs)
        for number, result in self.each(function, jobs):
            results[number] = result
        return results  # type: ignore[return-value]  # each job has filled its place

    def each(
        self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]]
    ) -> Iterator[tuple[int, T]]:
        """Yield each result with its index, in order of completion.

        This process also computes, including calls that cannot be sent and those of killed
        processes.
        """
        done: SimpleQueue[Future[T]] = SimpleQueue()
        numbers: dict[Future[T] | None, int] = {}
        futures: list[Future[T] | None] = [None] * len(jobs)

        def finished() -> Iterator[tuple[int, T]]:
            future = done.get()
            number = numbers.pop(future, None)
            if number is not None:
                yield number, _result(future, function, jobs[number])

        try:
            # Signals are postponed while locks of the futures are held. The first call is kept, so
            # that a single one requires no worker.
            with postponed():
                for number in range(1, len(jobs)) if self._processes else ():
                    future = futures[number] = self.submit(function, *jobs[number])
                    numbers[future] = number
                    future.add_done_callback(done.put)
            for number, own in enumerate(futures):
                if own is None or _cancel(own):
                    numbers.pop(own, None)
                    yield number, function(*jobs[number])
                while not done.empty():
                    yield from finished()
            while numbers:
                yield from finished()
        finally:
            if numbers:  # interrupted: discard the calls of the workers
                with postponed():
                    for own in list(numbers):
                        if own is not None and own.cancel():
                            del numbers[own]
                    if numbers:
                        self._kill()

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Terminate the processes, with ``cancel_futures`` during their calls."""
        if cancel_futures:
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._is_cancelled = True
            self._kill()
        self._threads.shutdown(wait=wait)
        with self._lock:
            for worker in self._workers:
                terminate_process(worker)
            self._workers = []

    def _call(self, function: Callable[..., T], args: tuple[Any, ...]) -> T:
        try:
            message = pickle.dumps((function, args))
        except Exception as e:  # for example, a class without a module-level name
            raise UnsentCall(f"cannot send a call to a worker process: {e}") from None
        worker = self._take()
        try:
            answer = _exchange(worker, message)
        except (OSError, EOFError, ValueError):  # ValueError: its pipe was closed
            with self._lock:
                self._remove(worker)
            raise WorkerDied("a worker process was killed; repeat the command") from None
        with self._lock:
            self._idle.append(worker)
        result, failure = pickle.loads(answer)
        if failure is not None:
            raise failure
        return result  # type: ignore[no-any-return]  # unpickled

    def _take(self) -> subprocess.Popen[bytes]:
        """Return an idle process, which is started on demand."""
        with self._lock:
            while self._idle:
                worker = self._idle.pop()
                if worker.poll() is None:
                    return worker
                self._remove(worker)
            return self._start()

    def _start(self) -> subprocess.Popen[bytes]:
        if self._is_cancelled:
            raise WorkerDied("the workers were terminated; repeat the command")
        worker = _start_worker()
        self._workers.append(worker)
        return worker

    def _remove(self, worker: subprocess.Popen[bytes]) -> None:
        if worker in self._workers:
            self._workers.remove(worker)
            terminate_process(worker)

    def _kill(self) -> None:
        """Kill all processes, which fails their calls."""
        with self._lock:
            for worker in self._workers:
                worker.kill()


def _cancel(future: Future[Any]) -> bool:
    with postponed():
        return future.cancel()


def _result(future: Future[T], function: Callable[..., T], job: tuple[Any, ...]) -> T:
    """Return the result of a finished call, or compute it if no worker did.

    An OSError occurs at the process limit; one of the function itself is raised again.
    """
    if isinstance(future.exception(), WorkerDied | UnsentCall | OSError):
        return function(*job)
    return future.result()


def _start_worker() -> subprocess.Popen[bytes]:
    """Start a worker with the same module search path and one thread."""
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    if not sys.executable:
        raise OSError("the path of the Python interpreter is unknown")
    search_path = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return start_process(__name__, search_path | one_thread)


def _exchange(worker: subprocess.Popen[bytes], message: bytes) -> bytes:
    """Send a call to a worker and return the pickled pair of its result and exception."""
    assert worker.stdin is not None
    assert worker.stdout is not None
    worker.stdin.write(len(message).to_bytes(8, "little") + message)
    worker.stdin.flush()
    return _message(worker.stdout)


def _message(stream: IO[bytes]) -> bytes:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    size = int.from_bytes(head, "little")
    message = stream.read(size)
    if len(message) < size:
        raise EOFError
    return message


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
