"""Interrupted, killed, divided and distributed sweeps agree with a run in memory."""

import errno
import json
import os
import pickle
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

import omnimirror as om
from omnimirror.apps.cli import app
from omnimirror.base import block_runner
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.manufacturing.tolerancing.compensation import merit_names
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.sweep import Shard, Sweep
from omnimirror.manufacturing.tolerancing.tolerances import BLOCK
from tests.everyday import few

TRIALS = 4 * BLOCK + 100  # five shards, the last one incomplete
LIMITS = {"motion_px": 1.0, "blur_px": 12.0}
ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="module")
def plan():
    """Plan with few objects, as only the number of trials matters here."""
    sensor = om.load_sensor("paper-spherical")
    errors = {
        name: om.Tolerance(0.05)
        for name in ("mirror.decentre_x_mm", "mirror.tilt_y_deg", "lens.k1")
    }
    return om.TolerancePlan(
        om.Tolerances(sensor, errors), LIMITS, objects={"angles": 1, "azimuths": 3}
    )


def trial_statistics(plan, folder=None, messages=None, trials=TRIALS, **sweep):
    options = (
        None
        if folder is None
        else Sweep(folder, shard_trials=sweep.pop("shard_trials", BLOCK), **sweep)
    )
    on_warning = None if messages is None else messages.append
    return om.tolerance(
        plan.tolerances.sensor, plan, trials=trials, seed=7, sweep=options, on_warning=on_warning
    ).statistics


@pytest.fixture(scope="module")
def expected(plan):
    return trial_statistics(plan)


def assert_same(statistics, expected):
    assert (statistics.trials, statistics.passed, statistics.lost) == (
        expected.trials,
        expected.passed,
        expected.lost,
    )
    assert statistics.passed_each == expected.passed_each
    assert 0 < statistics.passed < statistics.trials
    np.testing.assert_array_equal(statistics.sums, expected.sums)
    np.testing.assert_array_equal(statistics.counts, expected.counts)


def stamps(folder):
    return {path.name: path.stat().st_mtime_ns for path in folder.glob("shard-*.parquet")}


def wait_for(state, seconds=120):
    end = time.monotonic() + seconds
    while not (result := state()):
        assert time.monotonic() < end, "it never came to this"
        time.sleep(0.02)
    return result


def test_shards_match_a_run_in_memory(plan, expected, tmp_path):
    assert_same(trial_statistics(plan, tmp_path), expected)
    table = pq.read_table(tmp_path)
    assert sorted(table["trial"].to_pylist()) == list(range(TRIALS))
    manifest = json.loads((tmp_path / "_manifest.json").read_text())
    assert manifest["requested"]["trials"] == TRIALS
    assert sorted(manifest["shards"]) == sorted(stamps(tmp_path))
    block = table.filter((pc.field("trial") >= 3 * BLOCK) & (pc.field("trial") < 3 * BLOCK + 10))
    merits = TrialEvaluator.of(plan.tolerances.sensor, **plan.objects).evaluate(
        plan.tolerances.drawn(7, 3, 10)
    )
    stored = np.stack([block[name].to_numpy() for name in merit_names()], axis=-1)
    np.testing.assert_array_equal(stored, merits.astype(np.float32))


def test_existing_shards_are_reused(plan, expected, tmp_path):
    trial_statistics(plan, tmp_path)
    before = stamps(tmp_path)
    assert_same(trial_statistics(plan, tmp_path), expected)
    other = om.TolerancePlan(plan.tolerances, {"motion_px": 0.5}, objects=plan.objects)
    assert trial_statistics(other, tmp_path).passed == trial_statistics(other).passed
    assert stamps(tmp_path) == before


def flipped(path):
    data = bytearray(path.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data)


def cut(path):
    path.write_bytes(path.read_bytes()[:-1000])


def of_another_number(path):
    path.write_bytes(path.with_name("shard-00003.parquet").read_bytes())


def of_other_trials(path):
    """Exchange the trial numbers of two rows."""
    table = pq.read_table(path)
    numbers = table["trial"].to_numpy().copy()
    numbers[[3, 4]] = numbers[[4, 3]]
    table = table.set_column(0, table.schema.field(0), pa.array(numbers))
    pq.write_table(table, path, use_dictionary=False, compression="none", write_statistics=False)


@pytest.mark.parametrize(
    "harm", few([flipped, cut, of_another_number, of_other_trials], cut, of_other_trials)
)
def test_corrupt_shard_is_recomputed(plan, expected, tmp_path, harm):
    trial_statistics(plan, tmp_path)
    before, messages = stamps(tmp_path), []
    harm(tmp_path / "shard-00001.parquet")
    assert_same(trial_statistics(plan, tmp_path, messages), expected)
    assert len(messages) == 1
    assert re.search(r"shard-00001\.parquet (is corrupt|contains another shard)", messages[0])
    assert [name for name, stamp in stamps(tmp_path).items() if stamp != before[name]] == [
        "shard-00001.parquet"
    ]


def test_full_disk_keeps_completed_shards(plan, expected, tmp_path, monkeypatch):
    write, room = pq.ParquetWriter.write_table, [2]

    def full(*arguments):
        room[0] -= 1
        if room[0] < 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(pq.ParquetWriter, "write_table", full)
        with pytest.raises(
            OmnimirrorError, match=r"cannot write .*shard-0000\d.parquet: No space left on device"
        ):
            trial_statistics(plan, tmp_path)
    stamps_before = stamps(tmp_path)
    assert len(stamps_before) <= 2
    assert {path.suffix for path in tmp_path.iterdir()} <= {".parquet", ".json"}
    assert not list(tmp_path.glob(".*"))
    assert_same(trial_statistics(plan, tmp_path), expected)
    assert stamps(tmp_path).items() >= stamps_before.items()


def test_parts_combine_to_the_whole(plan, expected, tmp_path, monkeypatch):
    parts = [trial_statistics(plan, tmp_path, part=(i, 3)) for i in (3, 1, 2)]
    assert sum(part.trials for part in parts) == TRIALS
    assert sum(part.passed for part in parts) == expected.passed
    monkeypatch.setattr(Shard, "run", lambda *_, **__: pytest.fail("all are there"))
    assert_same(trial_statistics(plan, tmp_path), expected)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (
            lambda plan, folder: trial_statistics(plan, folder, trials=BLOCK),
            "trials of another sweep .different: trials",
        ),
        (
            lambda plan, folder: trial_statistics(plan, folder, part=(9, 9)),
            "must not exceed the number of shards, 5; got 9/9",
        ),
        (
            lambda plan, folder: trial_statistics(plan, folder, part=(0, 9)),
            "part must be between 1/9 and 9/9; got 0/9",
        ),
        (
            lambda plan, folder: trial_statistics(plan, folder, shard_trials=1000),
            "multiple of 8192",
        ),
        (lambda plan, folder: trial_statistics(plan, folder / "_manifest.json"), "cannot write"),
        (
            lambda plan, folder: trial_statistics(
                plan, folder / "other", scheduler="tcp://127.0.0.1:1"
            ),
            "no Dask scheduler",
        ),
    ],
)
def test_invalid_sweeps_are_rejected(plan, tmp_path, call, message, monkeypatch):
    monkeypatch.setattr(block_runner, "CONNECT_S", 0.5)
    trial_statistics(plan, tmp_path)
    with pytest.raises((InvalidParameter, OmnimirrorError), match=message):
        call(plan, tmp_path)


def test_foreign_manifest_is_not_overwritten(plan, tmp_path):
    (tmp_path / "_manifest.json").write_text("[]")
    with pytest.raises(OmnimirrorError, match="not a manifest of omnimirror"):
        trial_statistics(plan, tmp_path)


# -- killed processes
# --------------------------------------------------------------------------------

RUN = """
import sys, pickle
from pathlib import Path
import tests.manufacturing.tolerancing.gate
from tests.manufacturing.tolerancing.test_sweep import trial_statistics
trial_statistics(pickle.loads(Path(sys.argv[1]).read_bytes()), Path(sys.argv[2]))
"""


@pytest.fixture
def gates(tmp_path, monkeypatch):
    folder = tmp_path / "gates"
    folder.mkdir()
    monkeypatch.setenv("SWEEP_GATES", str(folder))
    return folder


@contextmanager
def process(*arguments):
    """Start a process that is killed at the end."""
    run = subprocess.Popen(
        arguments, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        yield run
    finally:
        run.kill()
        run.wait()


@pytest.mark.full
@pytest.mark.long
def test_killed_run_continues(plan, expected, tmp_path, gates):
    """A run killed within a shard loses and repeats nothing and leaves no temporary files."""
    folder = tmp_path / "trials"
    (tmp_path / "plan").write_bytes(pickle.dumps(plan))
    (gates / "shut-2").touch()
    with process(sys.executable, "-c", RUN, tmp_path / "plan", folder) as run:
        wait_for((gates / "at-2").exists)
        run.send_signal(signal.SIGKILL)
        run.wait()
    assert list(folder.glob(".shard-00002*"))
    stamps_before = stamps(folder)
    assert "shard-00002.parquet" not in stamps_before
    assert_same(trial_statistics(plan, folder), expected)
    assert stamps(folder).items() >= stamps_before.items()
    assert len(list(folder.iterdir())) == 6  # five shards and the manifest


@contextmanager
def dask(command, *arguments):
    program = Path(sys.executable).with_name("dask")
    with process(program, command, *arguments, "--host", "127.0.0.1", "--no-dashboard") as run:
        yield run


def scheduler(stack, file):
    """Start a scheduler and return its process and address."""
    run = stack.enter_context(dask("scheduler", "--port", "0", "--scheduler-file", file))
    wait_for(lambda: file.exists() and file.read_text().strip().endswith("}"))
    return run, json.loads(file.read_text())["address"]


def worker(stack, address):
    return stack.enter_context(
        dask(
            "worker",
            address,
            "--nthreads",
            "1",
            "--no-nanny",
            "--preload",
            str(Path(__file__).with_name("gate.py")),
        )
    )


def workers_at(address):
    from distributed import Client

    with Client(address, set_as_default=False) as client:
        return len(client.nthreads())


def test_cluster_matches_a_run_in_memory(plan, expected, tmp_path):
    from distributed import LocalCluster

    quiet = {"processes": False, "n_workers": 0, "threads_per_worker": 1, "dashboard_address": None}
    with LocalCluster(**quiet) as cluster:
        with pytest.raises(OmnimirrorError, match="has no workers"):
            trial_statistics(plan, tmp_path, scheduler=cluster.scheduler_address)
        cluster.scale(1)
        cluster.wait_for_workers(1)
        assert_same(trial_statistics(plan, tmp_path, scheduler=cluster.scheduler_address), expected)
    assert len(stamps(tmp_path)) == 5


@pytest.mark.full  # four processes that import all modules
@pytest.mark.long
def test_killed_cluster_processes_lose_no_trials(plan, expected, tmp_path, gates):
    folder = tmp_path / "trials"
    with ThreadPoolExecutor(1) as executor, ExitStack() as stack:
        ended, address = scheduler(stack, tmp_path / "first.json")
        with pytest.raises(OmnimirrorError, match="has no workers"):
            trial_statistics(plan, folder, scheduler=address)
        pair = [worker(stack, address) for _ in range(2)]
        wait_for(lambda: workers_at(address) == 2)
        (gates / "shut-1").touch()
        run, at = executor.submit(trial_statistics, plan, folder, scheduler=address), gates / "at-1"
        wait_for(lambda: run.done() or at.exists())  # a worker within a shard
        first = int(at.read_text())
        os.kill(first, signal.SIGKILL)
        wait_for(
            lambda: run.done() or int(at.read_text()) != first
        )  # the other one, in the same shard
        assert sum(process.poll() is None for process in pair) == 1
        stamps_before = stamps(folder)
        assert "shard-00001.parquet" not in stamps_before
        ended.kill()
        with pytest.raises(
            OmnimirrorError,
            match=r"the connection to the scheduler at .* was lost; completed shards are kept",
        ):
            run.result()
        (gates / "shut-1").unlink()
        _, address = scheduler(stack, tmp_path / "second.json")
        worker(stack, address)
        wait_for(lambda: workers_at(address) == 1)
        assert_same(trial_statistics(plan, folder, scheduler=address), expected)
        assert stamps(folder).items() >= stamps_before.items()
    assert len(stamps(folder)) == 5


# -- command
# -----------------------------------------------------------------------------------------


def test_command_combines_parts(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text(
        "[objects]\nangles = 1\nazimuths = 3\n[[error]]\nname = 'lens.k1'\ntolerance = 0.1\n"
        "[[limit]]\nquantity = 'motion_px'\nat_most = 1.0\n"
    )
    arguments = [
        "tolerance",
        "paper-spherical",
        "t.toml",
        "--trials",
        "20000",
        "--set",
        "analysis.seed=7",
        "-o",
        "sweep",
    ]

    def run(*more):
        result = CliRunner().invoke(
            app, [*arguments, "--set", "sweep.shard_trials=8192", *more], catch_exceptions=False
        )
        assert result.exit_code == 0
        return result.output

    numbers = run("--part", "2/2")
    assert "8192 trials" in numbers
    assert "run without --part to combine them" in numbers
    assert not (tmp_path / "sweep" / "tolerance.json").exists()
    run("--part", "1/2", "--json", "a.json")
    assert json.loads((tmp_path / "a.json").read_text())["trials"] == 20000 - 8192
    run()
    result = json.loads((tmp_path / "sweep" / "tolerance.json").read_text())
    plan = om.load_tolerances("t.toml", om.load_sensor("paper-spherical"))
    one = om.tolerance(plan.tolerances.sensor, plan, trials=20000, seed=7)
    assert {k: v for k, v in result.items() if k != "seconds"} == json.loads(
        json.dumps({k: v for k, v in one.to_dict().items() if k != "seconds"}).replace(
            "Infinity", '"inf"'
        )
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--part", "2/8"], "--part requires --output"),
        (["--part", "x", "-o", "o"], "got 'x'"),
        (["--part", "3/2", "-o", "o"], "part must be between 1/2 and 2/2; got 3/2"),
        (["--set", "sweep.shard_trials=10", "-o", "o"], "multiple of 8192"),
    ],
)
def test_invalid_command_prints_one_message(tmp_path, monkeypatch, arguments, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text("[[error]]\nname = 'lens.k1'\ntolerance = 0.1\n")
    result = CliRunner().invoke(app, ["tolerance", "paper-spherical", "t.toml", *arguments])
    assert result.exit_code != 0
    assert message in str(result.exception) + result.output
