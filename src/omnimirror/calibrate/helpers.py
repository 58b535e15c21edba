"""Other processes that compute beside this one, where Python itself takes the time and threads would wait for another.

They are begun by themselves and not by :mod:`multiprocessing`: what forks must not have threads, and what spawns runs
again whatever script asked, unless that is guarded. A helper reads jobs from its input and writes what came out.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from threading import Thread
from typing import IO, Any, Self, TypeVar

from ..native import usable_cores

T = TypeVar("T")
MOST = 7  # helpers, of some 100 MB each


class Helpers:
    """Processes that share jobs with this one; begun when there are jobs, as many as cores are free at most.

    Examples
    --------
    >>> with Helpers() as spread:
    ...     spread.map(divmod, [(7, 2), (9, 4)])
    [(3, 1), (2, 1)]
    """

    def __init__(self) -> None:
        self._begun: list[subprocess.Popen[bytes]] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End all, whatever they are at."""
        for helper in self._begun:
            helper.kill()
            helper.wait()
            for stream in (helper.stdin, helper.stdout):
                with suppress(OSError):  # what it was told last may not have reached it
                    stream.close()  # type: ignore[union-attr]
        self._begun = []

    def begin(self) -> None:
        """Have them ready for jobs that will come, while this process does something else."""
        self._enough(usable_cores() - 1)

    def map(self, function: Callable[..., T], jobs: Sequence[tuple[Any, ...]]) -> list[T]:
        """What a function of a module gives for each of its arguments, in their order.

        Raises
        ------
        Exception
            That of the first job that raised one.
        """
        waiting, results = deque(enumerate(jobs)), [None] * len(jobs)
        failures: dict[int, Exception] = {}

        def work(compute: Callable[[tuple[Any, ...]], Any]) -> None:
            """Take jobs until there are none; what a helper that died had in hand is taken by another."""
            while waiting and not failures:
                try:
                    number, job = waiting.popleft()
                except IndexError:  # another was quicker
                    return
                try:
                    results[number] = compute(job)
                except _Dead:
                    waiting.appendleft((number, job))
                    return
                except Exception as e:
                    failures[number] = e

        others = [
            Thread(target=work, args=(lambda job, helper=helper: _asked(helper, function, job),), daemon=True)
            for helper in self._enough(min(len(jobs), usable_cores()) - 1)
        ]
        for other in others:
            other.start()
        work(lambda job: function(*job))
        for other in others:
            other.join()
        work(lambda job: function(*job))  # what helpers that died left over
        if failures:
            raise failures[min(failures)]
        return results  # type: ignore[return-value]

    def _enough(self, count: int) -> list[subprocess.Popen[bytes]]:
        """So many helpers that live, if they can be had."""
        count = min(count, MOST)
        self._begun = [helper for helper in self._begun if helper.poll() is None]
        with suppress(OSError):  # no more processes, or no interpreter to be named: then without
            while len(self._begun) < count and sys.executable:
                self._begun.append(_one_more())
        return self._begun[: max(count, 0)]


class _Dead(Exception):
    """A helper has ended."""


def _one_more() -> subprocess.Popen[bytes]:
    """A process that waits for jobs, finds modules as this one does, and does not hear Ctrl-C."""
    one_thread = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    where = {"PYTHONPATH": os.pathsep.join(filter(None, sys.path))}
    return subprocess.Popen(
        [sys.executable, "-m", __name__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, start_new_session=True,
        env=os.environ | where | one_thread,
    )  # fmt: skip


def _asked(helper: subprocess.Popen[bytes], function: Callable[..., Any], job: tuple[Any, ...]) -> Any:
    assert helper.stdin is not None
    assert helper.stdout is not None
    message = pickle.dumps((function, job))
    try:
        helper.stdin.write(len(message).to_bytes(8, "little") + message)
        helper.stdin.flush()
        found, failure = pickle.loads(_message(helper.stdout))
    except (OSError, EOFError, ValueError) as e:  # ValueError: its pipe was closed
        raise _Dead from e
    if failure is not None:
        raise failure
    return found


def _message(stream: IO[bytes]) -> bytes:
    head = stream.read(8)
    if len(head) < 8:
        raise EOFError
    return stream.read(int.from_bytes(head, "little"))


def _serve() -> None:
    """Do jobs until nobody asks any more."""
    answers, sys.stdout = sys.stdout.buffer, sys.stderr  # what a job prints is no answer
    with suppress(EOFError, BrokenPipeError):
        while True:
            function, job = pickle.loads(_message(sys.stdin.buffer))
            try:
                message = pickle.dumps((function(*job), None))
            except Exception as e:
                message = pickle.dumps((None, e))
            answers.write(len(message).to_bytes(8, "little") + message)
            answers.flush()


if __name__ == "__main__":
    _serve()
