"""Processing of many files."""

import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from omnimirror.base import interrupts
from omnimirror.base.errors import MediaError
from omnimirror.io import read_image
from omnimirror.io.batch import (
    IMAGE_SUFFIXES,
    READABLE_IMAGE_SUFFIXES,
    BatchResult,
    Job,
    expand_inputs,
    output_for,
    outputs_for,
    run_parallel,
)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    for name in ("b.jpg", "a.jpg", "c.PNG", "notes.txt", "[x].jpg"):
        (tmp_path / name).write_text(name)
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "a.jpg").write_text("another")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    ("patterns", "names"),
    [
        (["a.jpg"], ["a.jpg"]),
        (["?.jpg"], ["a.jpg", "b.jpg"]),
        (["b.jpg", "?.jpg"], ["b.jpg", "a.jpg"]),
        (["."], ["[x].jpg", "a.jpg", "b.jpg", "c.PNG"]),
        (["[x].jpg"], ["[x].jpg"]),
        (["notes.txt"], ["notes.txt"]),
        (["sub", "a.jpg"], ["sub/a.jpg", "a.jpg"]),
    ],
)
def test_expand_inputs(folder, patterns, names):
    assert [path.as_posix() for path in expand_inputs(patterns)] == names


@pytest.mark.parametrize("suffix", [s for s in READABLE_IMAGE_SUFFIXES if s not in IMAGE_SUFFIXES])
def test_expand_inputs_with_readable_suffixes(tmp_path, suffix):
    """Calibration datasets have various formats: those of OCamCalib are GIFs."""
    pattern = np.kron([[10, 200, 10], [200, 10, 200]], np.ones((24, 24))).astype(np.uint8)
    of_kind = {".ppm": "RGB"}.get(suffix, "L")
    Image.fromarray(pattern).convert(of_kind).save(tmp_path / f"a{suffix}")
    (file,) = expand_inputs([tmp_path], READABLE_IMAGE_SUFFIXES)
    image = read_image(file)
    assert np.abs(image.reshape(48, 72, -1).astype(int) - pattern[..., None]).max() <= 1
    with pytest.raises(MediaError, match="must contain files with a suffix of"):
        expand_inputs([tmp_path])


@pytest.mark.parametrize("pattern", ["z.jpg", "*.tif"])
def test_expand_inputs_without_match_raises(folder, pattern):
    with pytest.raises(MediaError, match="source must be an existing file or match one"):
        expand_inputs(["a.jpg", pattern])
    (folder / "empty").mkdir()
    with pytest.raises(MediaError, match="the folder empty must contain files"):
        expand_inputs(["empty"])


def test_output_names_are_unique(folder):
    sources = expand_inputs(["?.jpg"])
    assert outputs_for(sources, "out", ".png") == [Path("out/a.png"), Path("out/b.png")]
    assert outputs_for(sources, "out") == [Path("out/a.jpg"), Path("out/b.jpg")]
    with pytest.raises(MediaError, match="outputs must be different files"):
        outputs_for([Path("a.jpg"), Path("sub/a.jpg")], "out")
    with pytest.raises(MediaError, match="output must differ from the input"):
        output_for("a.jpg", ".")
    with pytest.raises(MediaError, match=r"output must differ from the input; got a\.jpg"):
        outputs_for([Path("sub/c.jpg"), Path("a.jpg")], ".", ".jpg")


def test_failed_job_does_not_affect_others():
    done, updates, lock = [], [], threading.Lock()

    def job(n):
        def run():
            if n == 3:
                raise MediaError("3.jpg is empty")
            if n == 5:
                raise ZeroDivisionError("by zero\nand more")
            if n == 6:
                raise OSError(28, "No space left on device", "6.jpg")
            with lock:
                done.append(n)

        return Job(f"{n}.jpg", run)

    results = run_parallel(
        [job(n) for n in range(20)], 4, lambda count, total: updates.append((count, total))
    )
    assert sorted(done) == [n for n in range(20) if n not in (3, 5, 6)]
    assert results.done == [f"{n}.jpg" for n in sorted(done)]
    assert results.failed == {
        "3.jpg": "3.jpg is empty",
        "5.jpg": "unexpected ZeroDivisionError: by zero",
        "6.jpg": "6.jpg: No space left on device",
    }
    assert (results.exit_code, results.not_started, updates[-1]) == (1, [], (20, 20))
    assert run_parallel([]) == BatchResult([], {}, [], 0)
    assert BatchResult().stopped_by == 0
    assert BatchResult(not_started=["a.jpg"], stopped_by=143).exit_code == 143
    assert BatchResult(failed={"a.jpg": "empty"}, stopped_by=143).exit_code == 1


def test_progress_is_reported_once_per_finished_job():
    """Each job waits for the report of the preceding one, longer than a polling period."""
    updates = []

    def job(n):
        def run():
            end = time.monotonic() + 300
            while len(updates) < n and time.monotonic() < end:
                time.sleep(0.01)
            time.sleep(1.5 * interrupts.POLL_S)

        return Job(str(n), run)

    run_parallel([job(n) for n in range(4)], 1, lambda count, total: updates.append((count, total)))
    assert updates == [(1, 4), (2, 4), (3, 4), (4, 4)]


def test_single_worker_runs_sequentially():
    lock, clashes = threading.Lock(), []

    def run():
        clashes.append(not lock.acquire(blocking=False))
        time.sleep(0.01)
        if not clashes[-1]:
            lock.release()

    assert run_parallel([Job(str(n), run) for n in range(5)], 1).exit_code == 0
    assert clashes == [False] * 5


def test_jobs_run_in_parallel():
    together = threading.Barrier(3, timeout=300)
    assert run_parallel([Job(str(n), together.wait) for n in range(3)], 3).exit_code == 0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_and_sigterm_complete_running_jobs(tmp_path, number):
    code = f"""
import time, pathlib
from omnimirror.base import interrupts
from omnimirror.io.batch import Job, run_parallel
def job(n):
    def run():
        print("begun\\n", end="", flush=True)  # in one piece: another thread prints too
        while not interrupts.is_pending():
            time.sleep(0.01)
        pathlib.Path({str(tmp_path)!r}, str(n)).touch()
    return Job(str(n), run)
results = run_parallel([job(n) for n in range(20)], 2)
print(len(results.done), len(results.not_started), results.exit_code, flush=True)
"""
    run = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, text=True)
    assert [run.stdout.readline() for _ in range(2)] == ["begun\n"] * 2
    run.send_signal(number)
    assert run.communicate()[0].split() == ["2", "18", str(128 + number)]
    assert len(list(tmp_path.iterdir())) == 2
