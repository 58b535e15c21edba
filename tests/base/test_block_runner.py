"""Blocks in threads, worker processes and on a Dask cluster."""

import os
import platform
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from omnimirror.base import block_runner
from omnimirror.base.block_runner import (
    AHEAD,
    Retries,
    is_stopping,
    is_transient,
    part_of,
    run_blocks,
    workers_in_processes,
    workers_in_threads,
    workers_on_cluster,
)
from omnimirror.base.errors import InvalidParameter, MediaError, OmnimirrorError
from omnimirror.base.worker_processes import WorkerDied


@dataclass(frozen=True)
class Square:
    """Block that returns a square and its process, or fails as many times as requested."""

    number: int
    folder: Path | None = None
    failures: int = 0
    error: type[BaseException] = TimeoutError
    kills: bool = False

    @property
    def name(self):
        return f"square-{self.number}"

    def run(self):
        if self.folder is not None:
            attempts = len(list(self.folder.glob(f"{self.number}-*")))
            (self.folder / f"{self.number}-{attempts}").touch()
            if attempts < self.failures:
                if self.kills:
                    os.kill(os.getpid(), signal.SIGKILL)
                raise self.error("busy")
        return self.number**2, os.getpid()


def squares(outcomes):
    return sorted(outcome.value()[0] for outcome in outcomes)


POOLS = {
    "threads": lambda: workers_in_threads(2),
    "processes": lambda: workers_in_processes(2),
    "cluster": lambda: workers_on_cluster("local", 2),
}
QUICK = Retries(attempts=3, delay_s=0.01)


@pytest.mark.parametrize("kind", POOLS)
def test_every_block_has_one_outcome(kind, tmp_path):
    blocks = [Square(n, tmp_path, failures=n % 3) for n in range(9)]
    with POOLS[kind]() as workers:
        outcomes = list(run_blocks(blocks, workers, QUICK))
    assert squares(outcomes) == [n * n for n in range(9)]
    assert len(list(tmp_path.iterdir())) == sum(1 + n % 3 for n in range(9))
    is_own_process = {outcome.result[1] for outcome in outcomes} == {os.getpid()}
    assert is_own_process == (kind == "threads")


@pytest.mark.parametrize("kind", POOLS)
def test_permanent_and_repeated_errors_are_reported(kind, tmp_path):
    blocks = [
        Square(0, tmp_path, failures=9),
        Square(1, tmp_path, failures=9, error=MediaError),
        Square(2, tmp_path, failures=9, error=ZeroDivisionError),
    ]
    with POOLS[kind]() as workers:
        errors = {o.block.number: o.error for o in run_blocks(blocks, workers, QUICK)}
    assert [type(errors[n]) for n in (0, 1)] == [TimeoutError, MediaError]
    if kind == "threads":
        assert isinstance(errors[2], ZeroDivisionError)
    else:
        assert str(errors[2]) == "square-2 failed on a worker: ZeroDivisionError: busy"
    assert [len(list(tmp_path.glob(f"{n}-*"))) for n in range(3)] == [3, 1, 1]


def test_killed_worker_process_is_replaced(tmp_path):
    blocks = [Square(n, tmp_path, failures=int(n == 3), kills=True) for n in range(8)]
    with workers_in_processes(2) as workers:
        assert squares(run_blocks(blocks, workers, QUICK)) == [n * n for n in range(8)]
    with workers_in_processes(1) as workers:
        (outcome,) = run_blocks([Square(9, tmp_path, failures=9, kills=True)], workers)
    assert isinstance(outcome.error, WorkerDied)


def test_unpicklable_block_is_reported():
    block = Square(1)
    object.__setattr__(block, "folder", threading.Lock())
    with workers_in_processes(1) as workers:
        (outcome,) = run_blocks([block], workers, QUICK)
    assert "pickle" in str(outcome.error)


def test_number_of_prefetched_blocks_is_limited():
    numbers, gate = [], threading.Event()

    @dataclass(frozen=True)
    class Waiting:
        number: int
        name: str = ""

        def run(self):
            gate.wait(300)

    def source():
        for number in range(50):
            numbers.append(number)
            yield Waiting(number)

    with workers_in_threads(2) as workers:
        outcomes = run_blocks(source(), workers)
        first = threading.Thread(target=lambda: next(outcomes))
        first.start()
        time.sleep(3 * block_runner.interrupts.POLL_S)
        assert len(numbers) == 2 * AHEAD
        gate.set()
        first.join()
        assert len(list(outcomes)) == 49


def test_number_of_blocks_ahead_of_ordered_outcomes_is_limited():
    numbers, gate = [], threading.Event()

    @dataclass(frozen=True)
    class Waiting:
        number: int
        name: str = ""

        def run(self):
            if not self.number:
                gate.wait(300)
            return self.number

    def source():
        for number in range(40):
            numbers.append(number)
            yield Waiting(number)

    with workers_in_threads(2) as workers:
        outcomes = run_blocks(source(), workers, is_in_order=True)
        opening = threading.Timer(3 * block_runner.interrupts.POLL_S, gate.set)
        opening.start()
        results = [next(outcomes).value()]
        assert len(numbers) <= 2 * AHEAD + 1  # the others waited for the first one
        results += [outcome.value() for outcome in outcomes]
    assert results == list(range(40))


def test_closed_run_stops_blocks_in_threads():
    started, stopped = threading.Event(), []

    @dataclass(frozen=True)
    class Long:
        number: int
        name: str = ""

        def run(self):
            if self.number == 0:
                started.wait(300)
                return
            started.set()
            while not is_stopping():
                time.sleep(0.01)
            stopped.append(self.number)

    with workers_in_threads(2) as workers:
        next(run_blocks([Long(0), Long(1)], workers))
    assert stopped == [1]


def test_parts_are_disjoint_and_complete():
    numbers = range(10)
    assert sorted(n for i in (1, 2, 3) for n in part_of(numbers, (i, 3))) == list(numbers)
    with pytest.raises(InvalidParameter, match="part must be between 1/3 and 3/3; got 4/3"):
        part_of(numbers, (4, 3))


def test_delays_double_up_to_a_limit(monkeypatch):
    delays = []
    monkeypatch.setattr(block_runner.time, "sleep", delays.append)

    def fail():
        raise ConnectionError("reset")

    with pytest.raises(ConnectionError):
        Retries(attempts=6, delay_s=1.0, max_delay_s=5.0).call(fail)
    assert delays == [1.0, 2.0, 4.0, 5.0, 5.0]
    assert not is_transient(PermissionError())


def test_scheduler_must_respond(monkeypatch):
    monkeypatch.setattr(block_runner, "CONNECT_S", 0.5)
    with (
        pytest.raises(OmnimirrorError, match="no Dask scheduler responds"),
        workers_on_cluster("tcp://127.0.0.1:1"),
    ):
        pass


@pytest.mark.long
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_worker_processes_and_is_raised(number):
    code = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs inherit an ignored SIGINT
import time
from omnimirror.base.block_runner import run_blocks, workers_in_processes
from tests.base.test_block_runner import Square
blocks = [Square(n) for n in range(10**6)]
with workers_in_processes(1) as workers:
    for outcome in run_blocks(blocks, workers):
        print(outcome.result[1], flush=True)
"""
    root = Path(__file__).parents[2]
    run = subprocess.Popen(
        [sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, cwd=root
    )
    worker = int(run.stdout.readline())
    run.send_signal(number)
    run.communicate(timeout=120)
    assert run.returncode in (-number, 128 + number, 1)
    end = time.monotonic() + 60
    while Path(f"/proc/{worker}").exists() and time.monotonic() < end:
        time.sleep(0.05)
    assert not Path(f"/proc/{worker}").exists()


PAGE_FAULTS = """
import resource
from omnimirror.base.block_runner import reuse_freed_memory

def page_faults():
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range(20):
        bytearray(4 << 20)
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before

before = page_faults()
reuse_freed_memory()
print(before, page_faults())
"""


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="requires the GNU C library")
def test_cluster_workers_reuse_the_memory_of_images():
    program = subprocess.run(
        [sys.executable, "-c", PAGE_FAULTS],
        env=os.environ | {"MALLOC_TRIM_THRESHOLD_": "65536"},
        capture_output=True,
        text=True,
        check=True,
    )
    before, after = map(int, program.stdout.split())
    assert after < before / 5
