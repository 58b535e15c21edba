"""Worker processes: results, exceptions, and termination with their client."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base import worker_processes
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.worker_processes import UnsentCall, WorkerDied, WorkerPool
from omnimirror.calibration.targets import board_detection


@pytest.fixture(autouse=True)
def _three_cores(monkeypatch):
    monkeypatch.setattr(worker_processes, "usable_cores", lambda: 3)


def worker_of(number: int, seconds: float) -> tuple[int, int]:
    """Return a job number and the process that ran it."""
    time.sleep(seconds)
    return number, os.getpid()


def refusing(number: int) -> int:
    if number % 3 == 2:
        raise InvalidParameter(f"{number} is not valid")
    return number


def process_killed_once(number: int, path: str) -> int:
    """End the first process that calls this, except the main one."""
    if os.getpid() != number:
        try:
            os.close(os.open(path, os.O_CREAT | os.O_EXCL))
        except FileExistsError:
            return 1
        os.kill(os.getpid(), signal.SIGKILL)
    return 0


def test_results_are_returned_in_order():
    with WorkerPool() as spread:
        results = spread.starmap(worker_of, [(i, 0.3) for i in range(12)])
        assert [number for number, _ in results] == list(range(12))
        processes = {process for _, process in results}
        assert len(processes) > 1
        assert os.getpid() in processes
        # The same processes are reused.
        refit = spread.starmap(worker_of, [(i, 0.0) for i in range(2)])
        assert {process for _, process in refit} <= processes
    for process in processes - {os.getpid()}:
        with pytest.raises(ProcessLookupError, match="No such process"):
            os.kill(process, 0)


def test_arrays_are_the_same_to_the_bit():
    values = [(np.random.default_rng(i).normal(size=(50, 50)),) for i in range(6)]
    with WorkerPool() as spread:
        for inverse, (matrix,) in zip(spread.starmap(np.linalg.inv, values), values, strict=True):
            assert (inverse == np.linalg.inv(matrix)).all()


def test_first_exception_is_raised():
    with WorkerPool() as spread, pytest.raises(InvalidParameter, match=r"^[25] is not valid$"):
        spread.starmap(refusing, [(i,) for i in range(6)])


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there are no signals that kill here")
def test_jobs_of_a_dead_worker_are_repeated(tmp_path):
    with WorkerPool() as spread:
        results = spread.starmap(process_killed_once, [(os.getpid(), str(tmp_path / "died"))] * 40)
    assert len(results) == 40
    assert None not in results


def test_unpicklable_jobs_run_in_parent():
    with WorkerPool() as spread:
        assert spread.starmap(lambda a: a + 1, [(1,), (2,), (3,)]) == [2, 3, 4]


def test_calls_fail_with_their_process_or_are_not_sent(tmp_path):
    with WorkerPool(1) as pool:
        assert pool.submit(divmod, 7, 2).result() == (3, 1)
        with pytest.raises(UnsentCall, match=r"cannot send a call to a worker process: .*pickle"):
            pool.submit(divmod, 7, lambda: 2).result()
        first, second = (
            pool.submit(process_killed_once, os.getpid(), str(tmp_path / "died")) for _ in range(2)
        )
        with pytest.raises(WorkerDied, match="a worker process was killed"):
            first.result()
        assert second.result() == 1  # on a new process


def test_exception_terminates_running_calls():
    started, calls = time.monotonic(), []

    def interrupted():
        with WorkerPool(2) as pool:
            calls.extend(pool.submit(worker_of, n, 300.0) for n in range(3))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert time.monotonic() - started < 100
    assert calls[2].cancelled()
    assert all(isinstance(call.exception(), WorkerDied) for call in calls[:2])


def test_interrupted_run_leaves_no_results():
    with WorkerPool() as spread:
        for number, _ in spread.each(worker_of, [(i, 0.2) for i in range(6)]):
            assert number >= 0
            break
        assert [
            number for number, _ in spread.starmap(worker_of, [(i + 10, 0.0) for i in range(6)])
        ] == list(range(10, 16))


def test_parent_runs_all_jobs_without_workers(monkeypatch):
    def none(*_, **__):
        raise OSError("too many processes")

    monkeypatch.setattr(subprocess, "Popen", none)
    with WorkerPool() as spread:
        assert spread.starmap(divmod, [(7, 2), (9, 4)]) == [(3, 1), (2, 1)]
    assert WorkerPool().starmap(divmod, []) == []


def chessboards(count: int) -> list[np.ndarray]:
    """Return boards of 5 x 4 corners of increasing size, and one empty image."""
    boards = [np.full((200, 240), 230, np.uint8) for _ in range(count - 1)]
    for side, image in enumerate(boards, 24):
        v, u = np.mgrid[: 5 * side, : 6 * side]
        image[20 : 20 + 5 * side, 20 : 20 + 6 * side] = np.where(
            (u // side + v // side) % 2, 200, 40
        )
    return [*boards, np.full((200, 240), 99, np.uint8)]


@pytest.mark.parametrize("long_s", [-1.0, 1e9])
def test_boards_are_independent_of_workers(long_s, monkeypatch, tmp_path):
    monkeypatch.setattr(board_detection, "LONG_S", long_s)
    board, images = om.Board("chessboard", 5, 4), chessboards(6)
    om.write_image(tmp_path / "a.png", images[0])
    progress = []
    detections = om.find_boards(
        [*images, tmp_path / "a.png", tmp_path / "missing.png"],
        board,
        on_progress=lambda done, _: progress.append(done),
    )
    assert progress == list(range(1, 9))
    assert [one.name for one in detections] == [
        *(f"image {i}" for i in range(1, 7)),
        "a.png",
        "missing.png",
    ]
    for one, image in zip(detections, images, strict=False):
        expected = om.find_board(image, board)
        assert (one.corners_px == expected.corners_px).all()
        assert one.ids.tolist() == expected.ids.tolist()
    assert [len(one.ids) for one in detections[:6]] == [20] * 5 + [0]
    assert (detections[6].corners_px == detections[0].corners_px).all()
    assert "does not exist" in detections[7].reason


@pytest.mark.parametrize("long_s", [-1.0, 1e9])
def test_stopped_search_keeps_partial_results(long_s, monkeypatch):
    monkeypatch.setattr(board_detection, "LONG_S", long_s)

    def stop(done: int, _: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    detections = om.find_boards(chessboards(8), om.Board("chessboard", 5, 4), on_progress=stop)
    assert len(detections) == 8
    assert sum("was stopped" in (one.reason or "") for one in detections) == 6
    assert detections[0].found


def test_unguarded_script_can_use_workers(tmp_path):
    """A script that multiprocessing would restart in each of its processes."""
    script = tmp_path / "script.py"
    script.write_text(
        "import omnimirror.base.worker_processes as h\nh.usable_cores = lambda: 2\n"
        "with h.WorkerPool() as spread:\n    print(spread.starmap(divmod, [(7, 2), (9, 4)]))\n"
    )
    run = subprocess.run([sys.executable, script], capture_output=True, text=True)
    assert (run.stdout, run.stderr, run.returncode) == ("[(3, 1), (2, 1)]\n", "", 0)
