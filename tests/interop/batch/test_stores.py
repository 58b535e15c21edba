"""Batch jobs on object stores, with faults of a local S3 server."""

from dataclasses import replace

import numpy as np
import pytest
import xarray

import omnimirror as om
from omnimirror.base.block_runner import Retries
from omnimirror.base.errors import MediaError, OmnimirrorError
from omnimirror.interop.batch.stores import Store
from omnimirror.io.images import decode_image_and_metadata, encode_image
from tests.interop.batch.archives import SENSOR, VIEWS, contents, image, job_of, write_archive
from tests.interop.batch.s3_server import (
    Faults,
    options,
    proxy,
    require_credentials,
    s3_server,
)


def stored(store, name=""):
    """Return the outputs in a store by name."""
    return {
        entry.url.rpartition("/")[2]: store.read(entry.url.rpartition("/")[2])
        for entry in store.entries(name)
        if entry.url.endswith((".png", ".tar"))
    }


def local_outputs(folder):
    """Return the outputs in a folder by name."""
    return {name: (folder / name).read_bytes() for name in contents(folder)}


@pytest.fixture
def fresh_memory():
    """Remove all objects in memory."""
    from fsspec.implementations.memory import MemoryFileSystem

    MemoryFileSystem.store.clear()
    MemoryFileSystem.pseudo_dirs[:] = [""]


@pytest.mark.usefixtures("fresh_memory")
@pytest.mark.parametrize("kind", ["files", "webdataset", "zarr"])
def test_memory_store(tmp_path, kind):
    paths = write_archive(tmp_path, 5)
    store = Store("memory://archive")
    for path in paths:
        store.write(path.name, path.read_bytes())
    names = f'kind = "{kind}"\nname = "{{stem}}-{{view}}"\nper_shard = 2\nchunk = 2\n'
    inputs = 'files = ["memory://archive/*.png"]\nidentity = "name"'
    job = job_of(tmp_path, inputs, f'{names}url = "memory://out"')
    result = om.batch.run(job, scheduler="threads")
    assert (result.done, result.failed) == (10, 0)
    assert om.batch.plan(job).pending == 0
    assert om.batch.status(job).done == 10
    om.batch.run(job_of(tmp_path, output=names), scheduler="threads")
    if kind == "files":
        assert stored(Store("memory://out")) == local_outputs(tmp_path / "out")
    elif kind == "webdataset":
        assert len(stored(Store("memory://out"))) == 3
    else:
        remote = xarray.open_zarr("memory://out/images.zarr", consolidated=False)
        local = xarray.open_zarr(tmp_path / "out" / "images.zarr", consolidated=False)
        np.testing.assert_array_equal(remote.north.values, local.north.values)
        local.close()


@pytest.fixture(scope="module")
def server():
    with s3_server() as address:
        yield address


@pytest.fixture(scope="module")
def bucket(server):
    """Create a bucket and upload images; return its name."""
    store = Store("s3://archive", options(server))
    store._fs.mkdir("archive")
    store._fs.mkdir("out")
    for number in range(12):
        data = encode_image("a.png", image(number))
        store.write(f"raw/{number:04d}.png", data)
    return "archive"


def s3_job(folder, address, name, more=""):
    """Return a job from and to the server, and the same job on local files."""
    write_archive(folder, 12)
    output = 'name = "{stem}-{view}"\nurl = '
    job = job_of(
        folder,
        'files = ["s3://archive/raw/*.png"]\nidentity = "name"',
        f'{output}"s3://out/{name}"',
        f"{SENSOR}{VIEWS}[execution]\nworkers = 2\nretry_delay_s = 0.01\nper_block = 4\n{more}",
    )
    local = job_of(folder, output=f'{output}"local"')
    om.batch.run(local, scheduler="threads")
    return replace(job, storage=options(address)), local_outputs(folder / "local")


@pytest.mark.long
@pytest.mark.parametrize(
    ("kind", "period", "delay_s"),
    [("503", 7, 0.0), ("drop", 7, 0.0), ("late", 9, 0.0), ("", 0, 0.05)],
)
def test_s3_outputs_with_faults_equal_local_ones(tmp_path, server, bucket, kind, period, delay_s):
    faults = Faults()
    with proxy(server, faults) as address:
        job, expected = s3_job(tmp_path, address, f"faults-{kind}", "retries = 8\n")
        faults.kind, faults.period, faults.delay_s = kind, period, delay_s
        result = om.batch.run(job, scheduler="threads")
    assert (result.done, result.failed) == (24, 0)
    assert faults.injected > 3 or not kind
    assert stored(Store(f"s3://out/faults-{kind}", options(server))) == expected
    repeated = om.batch.plan(replace(job, storage=options(server)))
    assert repeated.pending == 0


@pytest.mark.long
def test_s3_server_that_fails_continuously_is_reported(tmp_path, server, bucket):
    faults = Faults()
    with proxy(server, faults) as address:
        job, expected = s3_job(tmp_path, address, "down", "retries = 1\n")
        job = replace(job, storage=options(address))
        plan = om.batch.plan(job)
        assert plan.pending == 24
        faults.period = 1
        with pytest.raises(OmnimirrorError, match=r"s3://|503|Service"):
            om.batch.run(job, scheduler="threads")
        faults.period = 0
        assert om.batch.run(job, scheduler="threads", retry_failed=True).done == 24
    assert stored(Store("s3://out/down", options(server))) == expected


@pytest.mark.long
def test_wrong_credentials_are_reported_at_once(tmp_path):
    with s3_server() as address:
        Store("s3://archive", options(address))._fs.mkdir("archive")
        require_credentials(address)
        store = Store("s3://archive", options(address, "wrong"), Retries(attempts=9, delay_s=60.0))
        with pytest.raises(MediaError, match=r"cannot read s3://archive/a.png: .+"):
            store.read("a.png")
        with pytest.raises(OmnimirrorError, match=r"cannot write s3://archive/a.png: .+"):
            store.write("a.png", b"data")


def test_missing_objects_are_reported(server, bucket):
    store = Store("s3://archive", options(server), Retries(attempts=9, delay_s=60.0))
    with pytest.raises(MediaError, match="it does not exist"):
        store.read("missing.png")
    assert not store.exists("missing.png")
    assert store.entries("missing") == []
    store.remove("missing.png")


def test_unknown_protocol_is_reported():
    with pytest.raises(OmnimirrorError, match="nowhere:// requires fsspec and its package"):
        Store("nowhere://a")


def test_failed_write_keeps_the_old_file(tmp_path, monkeypatch):
    store = Store(str(tmp_path), retries=Retries())
    store.write("a.png", b"old")
    from omnimirror.interop.batch import stores

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(stores.os, "write", full)
    with pytest.raises(OmnimirrorError, match="No space left on device"):
        store.write("a.png", b"new")
    monkeypatch.undo()
    assert store.read("a.png") == b"old"
    assert not list((tmp_path / "_manifest" / "_temporary").iterdir())


def test_messages_contain_the_complete_url_of_a_damaged_input():
    with pytest.raises(OmnimirrorError, match=r"cannot read the image s3://archive/a\.png: "):
        decode_image_and_metadata("s3://archive/a.png", b"broken")
