"""Scenarios of docs/batch.md, each from its job file and its commands."""

import os
import re
import shlex
import tarfile
import tomllib
import warnings
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import pytest
import tomli_w
import xarray

import omnimirror as om
from omnimirror.interop.batch.manifest import parquet_rows
from omnimirror.interop.batch.stores import Store
from omnimirror.io.images import encode_image
from tests.commands import omnimirror
from tests.interop.batch.archives import CAMERA, image
from tests.interop.batch.s3_server import options, s3_server

PAGE = Path(__file__).parents[3] / "docs" / "batch.md"


def scenario(folder, name):
    """Write the job file of a scenario; return its commands, split into arguments."""
    text = PAGE.read_text()
    (block,) = re.findall(rf"^```toml\n(# {name}\n.*?)^```", text, re.M | re.S)
    (folder / name).write_text(block)
    lines = re.findall(rf"^    (omnimirror batch \w+ {name}.*)$", text, re.M)
    assert lines
    return [shlex.split(line)[1:] for line in lines]


def execute(arguments, folder):
    run = omnimirror(*arguments, cwd=folder)
    assert run.returncode == 0, run.stderr
    return run.stdout


def test_sky_imager_archive(tmp_path):
    moments = [datetime(2024, 2, 29, 12) + timedelta(hours=4 * n) for n in range(9)]
    for number, moment in enumerate(moments):
        om.write_image(tmp_path / f"archive/{moment:%Y/%m/%d/%H%M%S}.jpg", image(number))
    for name in ("first", "second"):
        om.save_camera(CAMERA, tmp_path / f"{name}.toml")
    plan, run = scenario(tmp_path, "sky.toml")
    printed = execute(plan, tmp_path)
    assert "9 inputs, 9 outputs, 9 pending" in printed
    assert [line.split() for line in printed.splitlines()[1:3]] == [["first", "3"], ["second", "6"]]
    execute(run, tmp_path)
    names = {str(p.relative_to(tmp_path / "domes")) for p in tmp_path.glob("domes/2024/*/*/*.jpg")}
    assert len(names) == 9
    assert all(re.match(r"2024/0[23]/\d\d/\d{6}-dome-\w{10}\.jpg", name) for name in names)
    om.write_image(tmp_path / "archive/2024/03/02/000000.jpg", image(9))
    assert "10 of 10 outputs done" in execute(run, tmp_path)
    other = om.Unified(xi=0.95, focal_px=(20.0, 20.0), centre_px=(31.5, 23.5), image_size=(64, 48))
    om.save_camera(other, tmp_path / "second.toml")
    assert "10 outputs, 7 pending, 7 stale" in execute(plan, tmp_path)
    execute(run, tmp_path)
    left = {str(p.relative_to(tmp_path / "domes")) for p in tmp_path.glob("domes/2024/*/*/*.jpg")}
    assert len(left) == 10
    assert {name for name in names if name in left} == {n for n in names if "2024/02" in n}


@pytest.mark.long
def test_warehouse(tmp_path, monkeypatch):
    """200 cameras: ids of aisles and gates; calibrations by 40 rules."""
    from distributed import LocalCluster

    run, part = scenario(tmp_path, "warehouse.toml")
    with s3_server() as address:
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "test")
        monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "test")
        job = tomllib.loads((tmp_path / "warehouse.toml").read_text())
        job["storage"]["client_kwargs"] = {"endpoint_url": address, "region_name": "eu-central-1"}
        rules = []
        for number in range(40):
            name = f"calibration-{number}.toml"
            shift = om.Unified(
                xi=0.8 + 0.005 * number,
                focal_px=(20.0, 20.0),
                centre_px=(31.5, 23.5),
                image_size=(64, 48),
            )
            om.save_camera(shift, tmp_path / name)
            rules += [{"camera": f"cam-{number:02d}?", "file": name}]
        assert all(rule["file"].endswith(".toml") for rule in job["sensor"])
        job["sensor"] = rules
        (tmp_path / "warehouse.toml").write_text(tomli_w.dumps(job))
        store = Store("s3://warehouse", options(address))
        store._fs.mkdir("warehouse")
        for number in range(200):
            data = encode_image("a.png", image(number % 7))
            store.write(f"raw/cam-{number // 5:02d}{number % 5}/a.png", data)
        execute(part, tmp_path)
        done = om.batch.status(tmp_path / "warehouse.toml").done
        assert done == 2 * 5 * 3  # 3 of 40 shards: numbers 2, 18 and 34
        quiet = {"processes": False, "n_workers": 1, "threads_per_worker": 2, "protocol": "tcp://"}
        with LocalCluster(**quiet, dashboard_address="127.0.0.1:0") as cluster:
            arguments = [w if "tcp://" not in w else cluster.scheduler_address for w in run]
            assert "400 of 400 outputs done" in execute(arguments, tmp_path)
        rows = parquet_rows(store._fs.cat_file("s3://warehouse/views/manifest.parquet"))
    assert len({row["sensor_digest"] for row in rows}) == 40
    assert all(row["sensor"] == f"calibration-{int(row['camera'][4:6])}" for row in rows)


def test_zarr_time_series(tmp_path):
    om.save_camera(CAMERA, tmp_path / "camera.toml")
    for hour in range(10):
        om.write_image(tmp_path / f"recording/20240601T{hour + 4:02d}0000.png", image(hour))
    (run,) = scenario(tmp_path, "series.toml")
    (tmp_path / "recording/20240601T080000.png").write_bytes(b"broken")
    assert omnimirror(*run, cwd=tmp_path).returncode == 1
    text = PAGE.read_text()
    (code,) = re.findall(r"^```text\n(import xarray.*?)^```", text, re.M | re.S)
    working_folder = os.getcwd()
    try:
        os.chdir(tmp_path)
        names = {}
        exec(code, names)
        morning = names["morning"].load()
    finally:
        os.chdir(working_folder)
    assert morning.sizes["time"] == 7
    hours = [6, 7, 8, 9, 10, 11, 12]
    assert np.isnan(morning.values).any(axis=(1, 2, 3)).tolist() == [h == 8 for h in hours]
    names["data"].close()
    assert isinstance(names["data"], xarray.Dataset)


@pytest.mark.parametrize(
    ("count", "per_shard"), [(10, 4), pytest.param(20_000, 100, marks=pytest.mark.full)]
)
def test_training_dataset(tmp_path, count, per_shard):
    small = om.Unified(xi=0.9, focal_px=(6.0, 6.0), centre_px=(7.5, 7.5), image_size=(16, 16))
    om.save_camera(small, tmp_path / "camera.toml")
    (tmp_path / "walk.csv").write_text(f"time_s,x_mm\n0,0\n{(count - 1) / 25},300\n")
    reduced = ["--set", f"output.per_shard={per_shard}", "--set", "render.samples=1"]
    first, second = scenario(tmp_path, "train.toml")
    execute([*first, *reduced, "--set", "render.texel_mm=40.0"], tmp_path)
    printed = execute([*second, *reduced, "--set", "render.texel_mm=40.0"], tmp_path)
    assert f"{count} of {count} outputs done" in printed
    keys = []
    for path in sorted((tmp_path / "dataset").glob("*.tar")):
        with tarfile.open(path) as tar:
            keys += [member.name for member in tar if member.name.endswith(".png")]
    assert keys == [f"room/{number:06d}.png" for number in range(count)]


def test_ray_recipe(tmp_path):
    ray = pytest.importorskip("ray", reason="Ray is optional")
    pytest.importorskip("ray.data", reason="Ray Data is optional")
    from tests.interop.batch.archives import SENSOR, VIEWS, contents, job_of, write_archive

    write_archive(tmp_path, 5)
    om.batch.run(job_of(tmp_path, output='url = "whole"'), scheduler="threads")
    (tmp_path / "job.toml").write_text(
        f'[inputs]\nfiles = ["raw"]\n[output]\nurl = "out"\n{SENSOR}{VIEWS}'
        "[execution]\nper_block = 2\n"
    )
    text = PAGE.read_text()
    (code,) = re.findall(r"^```text\n(import ray\n.*?)^```", text, re.M | re.S)
    working_folder = os.getcwd()
    try:
        os.chdir(tmp_path)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # deprecations within Ray
            ray.init(num_cpus=1, include_dashboard=False, log_to_driver=False)
            exec(code, {"__name__": "recipe"})
    finally:
        ray.shutdown()
        os.chdir(working_folder)
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
    assert om.batch.status(tmp_path / "job.toml").done == 10
