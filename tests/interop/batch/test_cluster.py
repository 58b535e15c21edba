"""Batch jobs on a Dask cluster with killed workers and a restarted scheduler."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from tests.interop.batch.archives import SENSOR, VIEWS, contents, job_of, write_archive

ROOT = Path(__file__).parents[3]


def wait_for(state, seconds=240):
    end = time.monotonic() + seconds
    while not (value := state()):
        assert time.monotonic() < end, "the state was not reached"
        time.sleep(0.05)
    return value


class Cluster:
    """Scheduler and workers in separate processes."""

    def __init__(self, folder, port):
        self.folder, self.port = folder, port
        self.address = f"tcp://127.0.0.1:{port}"
        self.scheduler = None
        self.workers = []

    def start(self, *arguments):
        program = Path(sys.executable).with_name("dask")
        return subprocess.Popen(
            [program, *arguments, "--host", "127.0.0.1", "--no-dashboard"],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def start_scheduler(self):
        file = self.folder / f"scheduler-{time.monotonic_ns()}.json"
        self.scheduler = self.start(
            "scheduler", "--port", str(self.port), "--scheduler-file", str(file)
        )
        wait_for(lambda: file.exists() and json.loads(file.read_text() or "{}"))

    def start_worker(self):
        self.workers.append(self.start("worker", self.address, "--nthreads", "1", "--no-nanny"))

    def stop(self):
        for process in (*self.workers, self.scheduler):
            if process is not None:
                process.kill()
                process.wait()


@pytest.mark.long
@pytest.mark.parametrize("kills", [2, pytest.param(20, marks=pytest.mark.full)])
def test_killed_workers_and_a_restarted_scheduler_lose_nothing(tmp_path, kills):
    count = 60 * (kills + 2)
    write_archive(tmp_path, count)
    om.batch.run(job_of(tmp_path, output='url = "whole"'), scheduler="processes")
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    job = job_of(
        tmp_path,
        more=f"{SENSOR}{VIEWS}[execution]\nper_block = 4\nretries = 9\nretry_delay_s = 0.1\n",
    )
    out = tmp_path / "out"
    rng = np.random.default_rng(3)

    def outputs():
        return len(list(out.rglob("*.png")))

    with ExitStack() as stack, ThreadPoolExecutor(1) as executor:
        cluster = Cluster(tmp_path, port)
        stack.callback(cluster.stop)
        cluster.start_scheduler()
        for _ in range(2):
            cluster.start_worker()
        from distributed import Client

        with Client(cluster.address, set_as_default=False) as client:
            wait_for(lambda: len(client.nthreads()) == 2)
        run = executor.submit(om.batch.run, job, scheduler=cluster.address)
        kill_count = 0
        for number in range(kills):
            aim = (number + 1) * 2 * count // (kills + 2)
            wait_for(lambda: run.done() or outputs() >= aim)  # noqa: B023
            time.sleep(0.1 * rng.random())
            if run.done():
                break
            os.kill(cluster.workers[0].pid, signal.SIGKILL)
            cluster.workers.pop(0).wait()
            kill_count += 1
            cluster.start_worker()
            if number == kills // 2:
                cluster.scheduler.kill()
                cluster.scheduler.wait()
                for worker in cluster.workers:
                    worker.kill()
                    worker.wait()
                cluster.workers.clear()
                cluster.start_scheduler()
                for _ in range(2):
                    cluster.start_worker()
        status = run.result(timeout=400)
    assert kill_count >= 1
    assert (status.done, status.failed) == (2 * count, 0)
    assert contents(out) == contents(tmp_path / "whole")


def test_lost_scheduler_without_restart_is_reported(tmp_path):
    from distributed import LocalCluster

    write_archive(tmp_path, 40)
    job = job_of(tmp_path, more=f"{SENSOR}{VIEWS}[execution]\nper_block = 1\nreconnect_s = 0.5\n")
    quiet = {"processes": False, "n_workers": 1, "threads_per_worker": 1, "protocol": "tcp://"}
    started = threading.Event()
    with (
        ThreadPoolExecutor(1) as executor,
        LocalCluster(**quiet, dashboard_address="127.0.0.1:0") as cluster,
    ):
        address = cluster.scheduler_address
        run = executor.submit(
            om.batch.run,
            job,
            scheduler=address,
            on_progress=lambda done, total: started.set() if done else None,
        )
        assert started.wait(240)
        cluster.close()
        if run.exception(timeout=240) is None:
            pytest.skip("the run ended before the scheduler")
        with pytest.raises(OmnimirrorError, match="completed outputs are kept"):
            run.result()
    assert om.batch.run(job, scheduler="threads").done == 80
