"""Batch jobs with file outputs: names, resumption, invalidation and failures."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
import zlib
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.interop.batch import manifest as manifest_module
from omnimirror.interop.batch.blocks import balance_blocks
from omnimirror.interop.batch.job import parse_job
from tests.commands import fails, omnimirror
from tests.interop.batch.archives import (
    CAMERA,
    SENSOR,
    VIEWS,
    contents,
    image,
    job_of,
    write_archive,
)

ROOT = Path(__file__).parents[3]


@pytest.mark.parametrize("scheduler", ["threads", "processes"])
def test_outputs_equal_those_of_dewarp(tmp_path, scheduler):
    write_archive(tmp_path, 5, "raw/2024/{:04d}.png")
    job = job_of(tmp_path, output='name = "{folder}{view}/{stem}"')
    updates = []
    result = om.batch.run(job, scheduler=scheduler, on_progress=lambda *n: updates.append(n))
    assert (result.total, result.done, result.failed, result.pending) == (10, 10, 0, 0)
    assert (updates[0], updates[-1]) == ((0, 10), (10, 10))
    for name, view in job.views.items():
        om.dewarp_images(tmp_path / "raw/2024", tmp_path / "one", camera=CAMERA, view=view)
        for path in (tmp_path / "one").iterdir():
            other = tmp_path / "out" / "2024" / name / path.name
            assert other.read_bytes() == path.read_bytes()


def test_manifest_has_a_row_per_output(tmp_path):
    write_archive(tmp_path, 3, "raw/cam-7/20240601_12{:02d}00.png")
    inputs = 'files = ["raw/**/*.png"]\ncamera = "cam-(\\\\d)"\ntime = "%Y%m%d_%H%M%S"'
    om.batch.run(job_of(tmp_path, inputs), scheduler="threads")
    rows = pq.read_table(tmp_path / "out" / "manifest.parquet").to_pylist()
    assert len(rows) == 6
    for row in rows:
        data = (tmp_path / "out" / row["output"]).read_bytes()
        assert row["size"] == len(data)
        assert row["checksum"] == __import__("hashlib").blake2b(data, digest_size=16).hexdigest()
        assert (row["camera"], row["status"], row["version"]) == ("7", "done", om.__version__)
        assert row["key"][:10] in row["output"]
    assert [row["time"] for row in rows[::2]] == [1717243200.0 + 60 * n for n in range(3)]


@pytest.mark.skipif(sys.platform != "linux", reason="counts threads in /proc")
def test_parquet_tables_are_read_without_threads():
    """Threads of Arrow that hold a Python buffer abort the process at its exit."""
    code = (
        "import os, pyarrow.parquet\n"
        "from omnimirror.interop.batch.manifest import ManifestRow, parquet_bytes, parquet_rows\n"
        "row = ManifestRow(**dict.fromkeys(ManifestRow.__dataclass_fields__))\n"
        "data = parquet_bytes([row] * 1000)\n"
        "before = len(os.listdir('/proc/self/task'))\n"
        "assert len(parquet_rows(data)) == 1000\n"
        "print(before, len(os.listdir('/proc/self/task')))\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    before, after = run.stdout.split()
    assert before == after


def test_repeated_run_computes_nothing(tmp_path, monkeypatch):
    write_archive(tmp_path, 4)
    job = job_of(tmp_path)
    om.batch.run(job, scheduler="threads")
    before = contents(tmp_path / "out")
    from omnimirror.interop.batch.blocks import BatchBlock

    monkeypatch.setattr(BatchBlock, "run", lambda self: pytest.fail("all outputs are complete"))
    assert om.batch.run(job, scheduler="threads").done == 8
    assert contents(tmp_path / "out") == before


def test_changed_sensor_and_view_invalidate_affected_outputs(tmp_path):
    write_archive(tmp_path, 4, "raw/cam-{:d}/a.png")
    om.save_camera(CAMERA, tmp_path / "other.toml")
    rules = '[[sensor]]\ncamera = "3"\nfile = "other.toml"\n' + SENSOR
    inputs = 'files = ["raw"]\ncamera = "cam-(\\\\d)"'
    om.batch.run(job_of(tmp_path, inputs, more=rules + VIEWS), scheduler="threads")
    before = contents(tmp_path / "out")
    text = (tmp_path / "camera.toml").read_text()
    (tmp_path / "camera.toml").write_text("# comments do not matter\n" + text)
    assert om.batch.plan(job_of(tmp_path, inputs, more=rules + VIEWS)).pending == 0
    other_camera = om.Unified(
        xi=0.95, focal_px=(20.0, 20.0), centre_px=(31.5, 23.5), image_size=(64, 48)
    )
    om.save_camera(other_camera, tmp_path / "other.toml")
    job = job_of(tmp_path, inputs, more=rules + VIEWS)
    plan = om.batch.plan(job)
    assert (plan.pending, len(plan.stale_rows())) == (2, 2)
    assert om.batch.run(job, scheduler="threads").done == 8
    after = contents(tmp_path / "out")
    assert len(after) == 8
    assert {name for name in before if "cam-3" not in name} <= after.keys()
    assert not {name for name in before if "cam-3" in name} & after.keys()
    wider = VIEWS.replace("[40, 10]", "[44, 10]")
    plan = om.batch.plan(job_of(tmp_path, inputs, more=rules + wider))
    assert (plan.pending, len(plan.stale_rows())) == (4, 4)


def test_changed_input_is_repeated(tmp_path):
    paths = write_archive(tmp_path, 3)
    om.batch.run(job_of(tmp_path), scheduler="threads")
    om.write_image(paths[1], image(9))
    assert om.batch.plan(job_of(tmp_path)).pending == 2
    named = job_of(tmp_path, 'files = ["raw"]\nidentity = "name"', 'url = "named"')
    om.batch.run(named, scheduler="threads")
    om.write_image(paths[1], image(1))
    assert om.batch.plan(named).pending == 0


def corrupt(path, kind):
    """Damage a file in one of ten ways."""
    data = path.read_bytes()
    if kind == 0:
        path.write_bytes(b"")
    elif kind == 1:
        path.write_bytes(data[: len(data) // 2])
    elif kind == 2:
        path.write_text("<html>503 Service Unavailable</html>")
    elif kind == 3:
        path.write_bytes(bytes(len(data)))
    elif kind == 4:
        path.write_bytes(data[:60] + bytes([data[60] ^ 255]) + data[61:])
    elif kind == 5:
        path.unlink()
        path.mkdir()
    elif kind == 6:
        om.write_image(path, np.zeros((48, 65, 3), np.uint8))  # another camera
    elif kind == 7:
        header = data[12:16] + (10**6).to_bytes(4, "big") * 2 + data[24:29]
        path.write_bytes(data[:12] + header + zlib.crc32(header).to_bytes(4, "big") + data[33:])
    elif kind == 8:
        path.unlink()
    else:
        path.unlink()
        path.symlink_to(path)


@pytest.mark.parametrize(
    "count", [40, pytest.param(1000, marks=[pytest.mark.full, pytest.mark.long])]
)
def test_corrupt_inputs_are_recorded_and_skipped(tmp_path, count):
    paths = write_archive(tmp_path, count)
    (tmp_path / "list.txt").write_text("".join(f"{path}\n" for path in paths))
    bad = paths[:: count // 50] if count >= 50 else paths[::4]
    for number, path in enumerate(bad):
        corrupt(path, number % 10)
    view = "[view.north]\nsize = [24, 16]\n"
    job = job_of(tmp_path, 'list_file = "list.txt"', more=SENSOR + view)
    result = om.batch.run(job, scheduler="threads")
    assert (result.done, result.failed) == (count - len(bad), len(bad))
    assert set(result.errors) == {str(path) for path in bad[:50]}
    assert all(len(text) > 20 and "unexpected" not in text for text in result.errors.values())
    assert result.exit_code == 1
    assert len(contents(tmp_path / "out")) == count - len(bad)
    # failed inputs are repeated on request only
    for path in bad[:1]:
        om.write_image(path, image(0))
    named = job_of(tmp_path, 'list_file = "list.txt"\nidentity = "name"', more=SENSOR + view)
    om.batch.run(named, scheduler="threads")
    om.write_image(bad[1], image(1))
    assert om.batch.run(named, scheduler="threads").failed == len(bad) - 1
    assert om.batch.run(named, scheduler="threads", retry_failed=True).failed == len(bad) - 2


def test_parts_are_disjoint_and_complete(tmp_path):
    write_archive(tmp_path, 7)
    whole = job_of(tmp_path, output='url = "whole"')
    om.batch.run(whole, scheduler="threads")
    done = [
        om.batch.run(job_of(tmp_path), scheduler="threads", part=(i, 3)).done for i in (3, 1, 2)
    ]
    assert done == [4, 10, 14]
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


@pytest.mark.parametrize("workers", [1, 2, 16])
def test_blocks_decrease_so_that_workers_end_together(tmp_path, workers):
    write_archive(tmp_path, 100)
    planned, _, _ = om.batch.plan(job_of(tmp_path)).blocks()
    blocks = list(balance_blocks(planned, workers))
    items = [item for block in blocks for item in block.items]
    assert items == [item for block in planned for item in block.items]
    assert [block.number for block in blocks] == list(range(len(blocks)))
    assert len(blocks) >= workers
    sizes = [len(block.items) for block in blocks]
    assert max(sizes) <= min(32, 100 // workers)
    assert sizes[-1] <= 4


def test_incomplete_line_of_a_killed_process_is_ignored(tmp_path):
    write_archive(tmp_path, 3)
    job = job_of(tmp_path)
    om.batch.run(job, scheduler="threads")
    folder = tmp_path / "out" / "_manifest"
    line = manifest_module.ManifestRow("k", "i", "o", "v", "done").line()
    (folder / "rows-other.jsonl").write_bytes(line + line[:20])
    assert ("k", "o") in om.batch.plan(job).manifest.rows
    (folder / "rows-worse.jsonl").write_bytes(b"{}{}\n")
    with pytest.raises(OmnimirrorError, match=r"part rows-worse\.jsonl of the manifest is damaged"):
        om.batch.plan(job)


KILLED = """
import sys
from pathlib import Path
import omnimirror as om
from tests.interop.batch.archives import job_of
om.batch.run(job_of(Path(sys.argv[1])), scheduler="processes")
"""


@pytest.mark.long
@pytest.mark.parametrize("kills", [3, pytest.param(50, marks=pytest.mark.full)])
def test_killed_runs_lose_and_repeat_nothing(tmp_path, kills):
    """Kill the process and its workers at random moments; outputs equal those of one run."""
    count = 100 * kills
    write_archive(tmp_path, count)
    om.batch.run(job_of(tmp_path, output='url = "whole"'), scheduler="processes")
    rng = np.random.default_rng(7)
    out = tmp_path / "out"
    for number in range(kills):
        run = subprocess.Popen(
            [sys.executable, "-c", KILLED, tmp_path], cwd=ROOT, start_new_session=True
        )
        aim = (number + 1) * 2 * count // (kills + 2)
        end = time.monotonic() + 600
        while len(list(out.rglob("*.png"))) < aim and run.poll() is None:
            assert time.monotonic() < end
            time.sleep(0.02)
        time.sleep(0.1 * rng.random())
        workers = subprocess.run(
            ["pgrep", "-P", str(run.pid)], capture_output=True, text=True
        ).stdout.split()
        for process in (run.pid, *map(int, workers)):
            try:
                os.kill(process, signal.SIGKILL)
            except ProcessLookupError:
                continue
        run.wait()
    status = om.batch.run(job_of(tmp_path), scheduler="processes")
    assert (status.done, status.failed, status.total) == (2 * count, 0, 2 * count)
    assert contents(out) == contents(tmp_path / "whole")
    rows = pq.read_table(out / "manifest.parquet").to_pylist()
    assert len({(row["input"], row["view"]) for row in rows}) == len(rows) == 2 * count
    om.batch.run(job_of(tmp_path), scheduler="threads")  # the last processes killed have ended
    assert list((out / "_manifest" / "_temporary").iterdir()) == []


def test_sensor_rules_select_by_camera_and_mounting_date(tmp_path):
    write_archive(tmp_path, 2, "raw/cam-1_2024-0{:d}-15.png")
    for name in ("old", "new", "any"):
        om.save_camera(CAMERA, tmp_path / f"{name}.toml")
    rules = (
        '[[sensor]]\nfile = "new.toml"\ncamera = "1"\nsince = 2024-02-01\n'
        '[[sensor]]\nfile = "old.toml"\ncamera = "1"\nuntil = 2024-02-01T00:00:00Z\n'
    )
    job = job_of(
        tmp_path, "list_file = 'l.txt'\ntime = '%Y-%m-%d'\ncamera = 'cam-(\\d)'", more=rules + VIEWS
    )
    names = [
        *("cam-1_2024-01-15.png", "cam-1_2024-02-15.png", "cam-2_2024-02-15.png"),
        "cam-1_2024-02-31.png",  # no date
    ]
    (tmp_path / "l.txt").write_text("".join(f"raw/{name}\n" for name in names))
    plan = om.batch.plan(job)
    assert [item.sensor for item in plan.items] == ["old", "new"]
    assert [each.camera for each in plan.unassigned] == ["2", "1"]
    result = om.batch.run(job, scheduler="threads")
    errors = {Path(name).name: text for name, text in result.errors.items()}
    assert errors["cam-2_2024-02-15.png"] == (
        "no [[sensor]] applies to camera '2' at 2024-02-15 00:00:00; add one"
    )
    assert (
        "contains none of the format %Y-%m-%d; correct inputs.time"
        in (errors["cam-1_2024-02-31.png"])
    )


def test_restoration_with_and_without_views(tmp_path):
    write_archive(tmp_path, 2)
    restoration = "[restoration]\nblur_px = 2.0\nnoise = 0.01\n"
    alone = job_of(tmp_path, more=SENSOR + restoration)
    om.batch.run(alone, scheduler="threads")
    name = next(n for n in contents(tmp_path / "out") if n.startswith("0000-restored"))
    expected = om.restore(CAMERA, image(0), noise=0.01, blur=2.0)
    np.testing.assert_array_equal(om.read_image(tmp_path / "out" / name), expected)
    both = job_of(
        tmp_path, output='url = "both"\nname = "{stem}-{view}"', more=SENSOR + restoration + VIEWS
    )
    om.batch.run(both, scheduler="threads")
    view_image = om.read_image(tmp_path / "both" / "0000-north.png")
    view = both.views["north"]
    np.testing.assert_array_equal(view_image, om.Dewarper(CAMERA, view(CAMERA))(expected, True))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("[inputs]", "[input]"), "unknown table input; did you mean inputs"),
        (('url = "out"', ""), "output.url is missing"),
        (("[output]", "[output]\nkind = 'zip'"), "output.kind must be one of"),
        (("[output]", "[output]\nformat = 'png'"), "output.format must be one of .png"),
        (("[output]", "[output]\nname = '{x}'"), "output.name must contain only"),
        (("[output]", "[output]\nname = '{stem.upper}'"), "output.name must contain only"),
        (("[output]", "[output]\nname = '{stem[a]}'"), "output.name must contain only"),
        (("[output]", "[output]\nname = '/{stem}'"), "output.name must be a relative name"),
        (("[output]", "[output]\nname = '../{stem}'"), "output.name must be a relative name"),
        (("[output]", "[output]\nname = '{stem}/'"), "output.name must be a relative name"),
        (("[inputs]", "[inputs]\ncamera = 'cam'"), "inputs.camera must contain a group"),
        (("[inputs]", "[inputs]\nvideos = ['a.mp4']"), "inputs.videos requires output.kind"),
        ((SENSOR, ""), r"\[\[sensor\]\] is missing"),
        (("camera.toml", "missing.toml"), "'missing.toml' does not exist"),
        (
            ('file = "camera.toml"', 'file = "camera.toml"\nsince = 2024-01-01'),
            "require inputs.time",
        ),
        (
            (SENSOR, SENSOR + "since = 2024-03-01\nuntil = 2024-03-01\n"),
            r"sensor\.0\.until must be after since; got 2024-03-01 and 2024-03-01",
        ),
        (("size = [24, 16]", "sise = [24, 16]"), "did you mean size"),
    ],
)
def test_invalid_jobs_are_rejected_in_one_message(tmp_path, change, message):
    write_archive(tmp_path, 1)
    text = f"[inputs]\nfiles = ['raw']\n[output]\nurl = \"out\"\n{SENSOR}{VIEWS}"
    assert change[0] in text
    with pytest.raises(OmnimirrorError, match=message):
        parse_job(text.replace(*change, 1), "job.toml", tmp_path)


def test_equal_output_names_are_rejected(tmp_path):
    write_archive(tmp_path, 2, "raw/{:d}/a.png")
    with pytest.raises(OmnimirrorError, match="outputs must have different names"):
        om.batch.plan(job_of(tmp_path, output='name = "{stem}-{view}"'))


def test_views_with_one_name_are_rejected(tmp_path):
    """Instead of overwriting one view by the other."""
    write_archive(tmp_path, 1)
    with pytest.raises(OmnimirrorError, match=r"0000\.png for view north .* add {view} to output"):
        om.batch.plan(job_of(tmp_path, output='name = "{stem}"'))


def test_empty_output_names_are_rejected(tmp_path):
    write_archive(tmp_path, 1)
    with pytest.raises(OmnimirrorError, match=r"output\.name must not be empty; got '\.png' for"):
        om.batch.plan(job_of(tmp_path, output='name = "{time}"', more=SENSOR + VIEWS))


UNUSUAL = ["a b.png", "-x.png", "#.png", "a[1].png", "q?.png", "{x}.png", "new\nline.png", "UP.PNG"]


def test_unusual_names(tmp_path):
    write_archive(tmp_path / "job[1]", 0)
    folder = tmp_path / "job[1]" / "raw[*]"
    for number, name in enumerate(UNUSUAL):
        om.write_image(folder / name, image(number))
    shutil.copy(folder / "UP.PNG", os.fsencode(folder) + b"/caf\xe9.png")
    om.write_image(folder / f"{'y' * 240}.png", image(20))
    job = job_of(tmp_path / "job[1]", 'files = ["raw[*]"]')
    result = om.batch.run(job, scheduler="threads")
    assert (result.total, result.done, result.failed) == (20, 18, 2)
    (message,) = result.errors.values()
    assert "the name must have at most 255 bytes; got 26" in message
    names = {name.rpartition("-north-")[0] for name in contents(tmp_path / "job[1]" / "out")}
    assert names >= {Path(name).stem for name in UNUSUAL} | {"caf\\udce9"}
    for files in (["raw[[][*]]/a[[]1].png"], ["raw[[][*]]/a*1*.png"], ["raw[*]/a[1].png"]):
        plan = om.batch.plan(job_of(tmp_path / "job[1]", f"files = {files}"))
        assert [item.source.url for item in plan.items] == [str(folder / "a[1].png")]


def test_links_to_own_folders_are_followed_once(tmp_path):
    """Instead of 40 times, or without end for two links."""
    write_archive(tmp_path, 2, "raw/{}/a.png")
    for name in ("0/up", "1/up", "1/again"):
        (tmp_path / "raw" / name).symlink_to(tmp_path / "raw", target_is_directory=True)
    (tmp_path / "raw" / "lost.png").symlink_to(tmp_path / "missing.png")
    (tmp_path / "raw" / "folder.png").mkdir()
    plan = om.batch.plan(job_of(tmp_path))
    assert [item.source.url for item in plan.items] == [
        str(tmp_path / "raw" / name / "a.png") for name in "01"
    ]
    elsewhere = tmp_path / "more"
    elsewhere.symlink_to(tmp_path / "raw" / "0", target_is_directory=True)
    plan = om.batch.plan(job_of(tmp_path, 'files = ["more/**/*.png"]'))
    assert {item.source.url for item in plan.items} == {
        str(elsewhere / name) for name in ("a.png", "up/1/a.png")
    }


@pytest.mark.parametrize(
    ("files", "url"), [("raw", "raw/out"), ("./raw/../raw", "raw/out"), ("raw", "raw")]
)
def test_outputs_are_no_inputs_of_the_next_run(tmp_path, files, url):
    write_archive(tmp_path, 2)
    job = job_of(tmp_path, f'files = ["{files}"]', f'url = "{url}"')
    for _ in range(2):
        result = om.batch.run(job, scheduler="threads")
        assert (result.total, result.done) == (4, 4)


def test_status_counts_current_inputs_only(tmp_path):
    paths = write_archive(tmp_path, 3)
    paths[0].write_bytes(b"broken")
    job = job_of(tmp_path)
    om.batch.run(job, scheduler="threads")
    for path in paths[:2]:
        path.unlink()
    for result in (om.batch.run(job, scheduler="threads"), om.batch.status(job)):
        assert (result.total, result.done, result.failed, result.pending) == (2, 2, 0, 0)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("rows-x.jsonl", b'{"a": 1}\n'),
        ("rows-x.jsonl", b"[1]\n"),
        ("rows-x.jsonl", b"\xff\n"),
        ("rows-x.parquet", b"PAR1"),
    ],
)
def test_damaged_parts_of_the_manifest_are_named(tmp_path, name, content):
    write_archive(tmp_path, 1)
    job = job_of(tmp_path)
    om.batch.run(job, scheduler="threads")
    (tmp_path / "out" / "_manifest" / name).write_bytes(content)
    for function in (om.batch.run, om.batch.status):
        with pytest.raises(
            OmnimirrorError, match=f"part {name} of the manifest is damaged; remove"
        ):
            function(job)


@pytest.mark.parametrize("content", ["{", "[]", '{"total": 1}', '{"total": "a", "keys": []}'])
def test_damaged_plan_is_reported(tmp_path, content):
    write_archive(tmp_path, 1)
    job = job_of(tmp_path)
    om.batch.plan(job).write()
    (tmp_path / "out" / "_manifest" / "plan.json").write_text(content)
    with pytest.raises(OmnimirrorError, match="there is no plan in"):
        om.batch.status(job)


def test_a_file_in_place_of_the_output_folder_is_reported(tmp_path):
    write_archive(tmp_path, 1)
    (tmp_path / "out").write_text("")
    with pytest.raises(OmnimirrorError, match=r"cannot write .*out/_manifest"):
        om.batch.run(job_of(tmp_path), scheduler="threads")


def test_camera_ids_are_names_of_folders(tmp_path):
    """Instead of locations outside the output folder; a group without a match is no id."""
    write_archive(tmp_path, 1, "raw/roof/{}.png")
    inputs = 'files = ["raw"]\ncamera = "{}"'
    output = 'name = "{camera}/{stem}-{view}"'
    plan = om.batch.plan(job_of(tmp_path, inputs.format("raw(/[a-z]+)/"), output))
    assert plan.items[0].outputs[0].name == "_roof/0-north.png"
    plan = om.batch.plan(
        job_of(tmp_path, inputs.format("raw|(roof)"), output='name = "{stem}-{view}"')
    )
    assert plan.items[0].source.camera == ""


@pytest.mark.parametrize("scheduler", ["process", "", "127.0.0.1"])
def test_unknown_schedulers_are_rejected_at_once(tmp_path, scheduler):
    write_archive(tmp_path, 1)
    message = "scheduler must be processes, threads, local or the address .*; got "
    with pytest.raises(OmnimirrorError, match=message):
        om.batch.run(job_of(tmp_path), scheduler=scheduler)


def test_inputs_must_exist(tmp_path):
    write_archive(tmp_path, 1)
    with pytest.raises(OmnimirrorError, match=r"inputs\.files must match images; got none"):
        om.batch.plan(job_of(tmp_path, 'files = ["raw/*.jpg"]'))


def test_command(tmp_path):
    write_archive(tmp_path, 4)
    (tmp_path / "raw" / "0002.png").write_bytes(b"broken")
    text = f"[inputs]\nfiles = ['raw']\n[output]\nurl = \"out\"\n{SENSOR}{VIEWS}"
    (tmp_path / "job.toml").write_text(text)
    assert (
        "4 inputs, 8 outputs, 8 pending"
        in omnimirror("batch", "plan", "job.toml", cwd=tmp_path).stdout
    )
    arguments = ("batch", "run", "job.toml", "--scheduler", "threads")
    run = omnimirror(*arguments, "--part", "1/2", "--json", "a.json", cwd=tmp_path)
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert json.loads((tmp_path / "a.json").read_text())["pending"] == 4
    run = omnimirror(*arguments, "--set", "execution.workers=1", cwd=tmp_path)
    assert "6 of 8 outputs done, 2 failed" in run.stdout
    om.write_image(tmp_path / "raw" / "0002.png", image(2))
    assert omnimirror(*arguments, "--retry-failed", cwd=tmp_path).returncode == 0
    status = omnimirror("batch", "status", "job.toml", cwd=tmp_path)
    assert "8 of 8 outputs done, 0 failed" in status.stdout
    assert "part must be between" in fails(*arguments, "--part", "3/2", cwd=tmp_path)
    assert "there is no plan" in fails(
        "batch", "status", "job.toml", "--set", "output.url=new", cwd=tmp_path
    )


@pytest.mark.long
@pytest.mark.parametrize(
    ("number", "scheduler", "code"),
    [
        (signal.SIGINT, "threads", 130),
        (signal.SIGINT, "processes", 130),
        (signal.SIGTERM, "processes", 143),
        (signal.SIGKILL, "processes", -signal.SIGKILL),
    ],
)
def test_interrupted_command_continues(tmp_path, number, scheduler, code):
    count = 200
    write_archive(tmp_path, count)
    text = f"[inputs]\nfiles = ['raw']\n[output]\nurl = \"out\"\n{SENSOR}{VIEWS}"
    (tmp_path / "job.toml").write_text(text + "[execution]\nper_block = 4\n")
    program = Path(sys.executable).with_name("omnimirror")
    arguments = [program, "batch", "run", "job.toml", "--scheduler", scheduler]
    run = subprocess.Popen(arguments, cwd=tmp_path, stderr=subprocess.PIPE, text=True)
    end = time.monotonic() + 120
    while len(list(tmp_path.glob("out/*.png"))) < 20 and run.poll() is None:
        assert time.monotonic() < end
        time.sleep(0.01)
    run.send_signal(number)
    _, error = run.communicate(timeout=120)
    assert run.returncode == code
    assert ("stopped; repeat the command to continue" in error) == (code > 0)
    assert "Traceback" not in error
    job = tmp_path / "job.toml"
    before = om.batch.status(job).done
    assert 20 <= before < 2 * count
    stamps = {path: path.stat().st_mtime_ns for path in tmp_path.glob("out/*.png")}
    again = subprocess.run(arguments, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert f"{2 * count} of {2 * count} outputs done" in again.stdout + again.stderr
    unchanged = sum(path.stat().st_mtime_ns == stamp for path, stamp in stamps.items())
    assert unchanged >= before
    om.batch.run(job_of(tmp_path, output='url = "whole"'), scheduler="threads")
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")


def test_core_loads_no_package_of_the_extra():
    code = (
        "import sys, omnimirror; from omnimirror.apps.cli import main\n"
        "try: main(['--help'])\nexcept SystemExit: pass\n"
        "print(sorted({'fsspec', 'zarr', 'pyarrow', 's3fs', 'distributed'} & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.splitlines()[-1] == "[]"
