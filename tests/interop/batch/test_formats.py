"""Inputs from shards, arrays and videos; outputs to shards, arrays and videos."""

import gzip
import io
import json
import tarfile
import zipfile

import av
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import xarray
import zarr

import omnimirror as om
from omnimirror.base.errors import MediaError, OmnimirrorError
from omnimirror.interop.batch.blocks import BatchBlock
from omnimirror.interop.batch.inputs import InputReader, key_frame_times, list_inputs
from omnimirror.io.video_reader import VideoReader
from tests.interop.batch.archives import (
    CAMERA,
    SENSOR,
    VIEWS,
    contents,
    image,
    job_of,
    write_archive,
)


def expected(job, number, view="north"):
    """Return a view of an image in RGB."""
    return om.Dewarper(CAMERA, job.views[view](CAMERA))(image(number), False)


def shard(path, names, paths):
    """Write images to a tar or zip file."""
    if path.suffix.lower() == ".zip":
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, file in zip(names, paths, strict=True):
                archive.write(file, name)
    else:
        with tarfile.open(path, "w" if path.suffix == ".tar" else "w:gz") as tar:
            for name, file in zip(names, paths, strict=True):
                tar.add(file, name)
                entry = tarfile.TarInfo(name.replace(".png", ".json"))
                tar.addfile(entry, io.BytesIO())


@pytest.mark.parametrize("suffix", [".tar", ".tar.gz", ".tgz", ".zip"])
def test_shards_as_inputs(tmp_path, suffix):
    paths = write_archive(tmp_path, 6)
    names = [f"day/{number}.png" for number in range(6)]
    shard(tmp_path / f"a{suffix}", names[:4], paths[:4])
    shard(tmp_path / f"b{suffix}", names[4:], paths[4:])
    job = job_of(
        tmp_path, f'shards = ["*{suffix}"]', 'name = "{folder}{stem}-{view}"\nformat = ".bmp"'
    )
    assert om.batch.run(job, scheduler="threads").done == 12
    for number in range(6):
        name = f"{'a' if number < 4 else 'b'}/day/{number}-north.bmp"
        np.testing.assert_array_equal(om.read_image(tmp_path / "out" / name), expected(job, number))


def test_damaged_shards_are_reported(tmp_path):
    write_archive(tmp_path, 1)
    damaged = b"no archive" * 100
    truncated = gzip.compress(np.random.default_rng(0).bytes(9999))[:500]
    for name, data in (
        ("a.tar", damaged),
        ("b.zip", damaged),
        ("c.tgz", damaged),
        ("d.tar.gz", truncated),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(OmnimirrorError, match=r"must be a tar, tar\.gz or zip file"):
            om.batch.plan(job_of(tmp_path, f'shards = ["{name}"]'))


def test_compressed_shard_damaged_after_planning_is_reported(tmp_path):
    shard(tmp_path / "a.tar.gz", ["0.png", "1.png"], write_archive(tmp_path, 2))
    job = job_of(tmp_path, 'shards = ["a.tar.gz"]')
    reader = InputReader(job)
    first, second = list_inputs(job)
    assert reader.data(second) == (tmp_path / "raw" / "0001.png").read_bytes()
    assert (
        reader.data(first) == (tmp_path / "raw" / "0000.png").read_bytes()
    )  # reads from the start
    reader.close()
    data = (tmp_path / "a.tar.gz").read_bytes()
    (tmp_path / "a.tar.gz").write_bytes(data[: len(data) // 4])
    with pytest.raises(MediaError, match=r"cannot read .*a\.tar\.gz!1\.png"):
        reader.data(second)
    reader.close()


@pytest.mark.parametrize("suffix", [".tar", ".TGZ", ".ZIP"])
def test_members_with_names_outside_their_folder(tmp_path, suffix):
    paths = write_archive(tmp_path, 3)
    shard(tmp_path / f"a{suffix}", ["../../x.png", "/y.png", "z/./z.png"], paths)
    job = job_of(tmp_path, f'shards = ["a{suffix}"]', 'name = "{folder}{stem}-{view}"')
    plan = om.batch.plan(job)
    assert [item.outputs[0].name for item in plan.items] == [
        "a/x-north.png",
        "a/y-north.png",
        "a/z/z-north.png",
    ]
    assert om.batch.run(job, scheduler="threads").done == 6


def test_samples_of_equal_stems_have_different_keys(tmp_path):
    """Readers of WebDataset would join a.png and a.jpg to one sample."""
    write_archive(tmp_path, 1)
    for name in ("a.png", "a.jpg", "b.c.png", "b_c.png"):
        om.write_image(tmp_path / "raw" / name, image(1))
    om.batch.run(job_of(tmp_path, output='kind = "webdataset"'), scheduler="threads")
    (path,) = (tmp_path / "out").glob("*.tar")
    with tarfile.open(path) as tar:
        names = tar.getnames()
    assert len(names) == len(set(names)) == 15
    keys = {name.partition(".")[0] for name in names}
    assert len(keys) == 5
    assert "0000" in keys


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", "path\n" + 200_000 * "a", "must be a CSV or Parquet table: field larger than"),
        ("a.csv", "path,time\na.png,0001-01-01T00:00:00+14:00", "row 1: time must be ISO 8601"),
        ("a.csv", "path,time\na.png,9999-12-31T23:00:00-02:00", "row 1: time must be ISO 8601"),
        ("a.csv", "path\n", "inputs must contain at least one image; got none"),
        ("a.PARQUET", "path\na.png", "must be a Parquet table"),
    ],
)
def test_invalid_tables_are_rejected(tmp_path, name, content, message):
    write_archive(tmp_path, 1)
    (tmp_path / name).write_text(content)
    with pytest.raises(OmnimirrorError, match=message):
        om.batch.plan(job_of(tmp_path, f'table = "{name}"'))


def test_names_with_null_characters_are_recorded(tmp_path):
    write_archive(tmp_path, 1)
    (tmp_path / "a.csv").write_bytes(b"path\nraw/\0.png\nraw/0000.png\n")
    result = om.batch.run(job_of(tmp_path, 'table = "a.csv"'), scheduler="threads")
    assert (result.done, result.failed) == (2, 2)
    assert "must not contain null characters" in next(iter(result.errors.values()))


def test_camera_ids_of_a_column_with_gaps(tmp_path):
    """Pandas stores integers with gaps as real numbers."""
    write_archive(tmp_path, 2)
    table = pa.table({"path": ["raw/0000.png", "raw/0001.png"], "camera": [7.0, float("nan")]})
    pq.write_table(table, tmp_path / "a.parquet")
    inputs = list_inputs(job_of(tmp_path, 'table = "a.parquet"'))
    assert [each.camera for each in inputs] == ["7", ""]


@pytest.mark.parametrize("form", ["%Y%m%Y", "%Y%", "%q", "year"])
def test_invalid_time_formats_are_rejected(tmp_path, form):
    write_archive(tmp_path, 1)
    with pytest.raises(
        OmnimirrorError, match=r"inputs\.time must contain fields .* each once; got"
    ):
        om.batch.plan(job_of(tmp_path, f'files = ["raw"]\ntime = "{form}"'))


@pytest.mark.parametrize("kind", ["float64", "int16", "bool"])
def test_arrays_of_other_types_are_recorded(tmp_path, kind):
    write_archive(tmp_path, 0)
    zarr.create_array(tmp_path / "a.zarr", data=np.zeros((1, 48, 64), kind))
    result = om.batch.run(job_of(tmp_path, 'arrays = ["a.zarr"]'), scheduler="threads")
    (message,) = result.errors.values()
    assert message.endswith(f"must have uint8, uint16, float32 values; got {kind}")


@pytest.mark.parametrize("kind", ["csv", "parquet"])
def test_tables_as_inputs(tmp_path, kind):
    paths = write_archive(tmp_path, 3)
    columns = {
        "path": [f"raw/{path.name}" for path in paths],
        "camera": ["a", "b", "a"],
        "time": [f"2024-06-0{n}T12:00:00+00:00" for n in (1, 2, 3)],
    }
    if kind == "parquet":
        pq.write_table(pa.table(columns), tmp_path / "t.parquet")
    else:
        rows = [columns, *zip(*columns.values(), strict=True)]
        (tmp_path / "t.csv").write_text("".join(",".join(row) + "\n" for row in rows))
    plan = om.batch.plan(job_of(tmp_path, f'table = "t.{kind}"'))
    assert [item.source.camera for item in plan.items] == ["a", "b", "a"]
    assert np.diff([item.source.time for item in plan.items]).tolist() == [86400.0] * 2


@pytest.mark.parametrize("chunk", [1, 4])
def test_arrays_as_inputs(tmp_path, chunk):
    write_archive(tmp_path, 0)
    images = np.stack([image(number) for number in range(6)])
    zarr.create_array(tmp_path / "frames.zarr", data=images, chunks=(chunk, *images.shape[1:]))
    job = job_of(tmp_path, 'arrays = ["frames.zarr"]', 'name = "{stem}-{view}"\nformat = ".bmp"')
    assert om.batch.run(job, scheduler="threads").done == 12
    for number in range(6):
        output = om.read_image(tmp_path / "out" / f"{number}-north.bmp")
        np.testing.assert_array_equal(output, expected(job, number))


def test_webdataset_outputs(tmp_path):
    paths = write_archive(tmp_path, 7)
    paths[3].write_bytes(b"broken")
    job = job_of(tmp_path, output='kind = "webdataset"\nper_shard = 3')
    result = om.batch.run(job, scheduler="threads")
    assert (result.done, result.failed) == (12, 2)
    shards = sorted((tmp_path / "out").glob("*.tar"))
    assert [path.name[:13] for path in shards] == [f"camera-00000{n}" for n in range(3)]
    keys = []
    for path in shards:
        with tarfile.open(path) as tar:
            for member in tar:
                key, _, suffix = member.name.partition(".")
                data = tar.extractfile(member).read()
                if suffix == "json":
                    keys.append(key)
                    assert json.loads(data)["input"].endswith(f"{key}.png")
                else:
                    assert suffix in ("north.png", "around.png")
    assert keys == [f"{n:04d}" for n in range(7) if n != 3]
    before = contents(tmp_path / "out")
    om.batch.run(job_of(tmp_path, output='kind = "webdataset"\nper_shard = 3\nurl = "again"'))
    assert contents(tmp_path / "again") == before


def test_new_inputs_replace_the_last_shard_only(tmp_path):
    write_archive(tmp_path, 5)
    job = job_of(tmp_path, output='kind = "webdataset"\nper_shard = 3')
    om.batch.run(job, scheduler="threads")
    before = contents(tmp_path / "out")
    om.write_image(tmp_path / "raw" / "0005.png", image(5))
    assert om.batch.run(job, scheduler="threads").done == 12
    after = contents(tmp_path / "out")
    assert len(after) == 2
    assert sorted(before)[0] in after
    assert sorted(before)[1] not in after


def test_zarr_outputs_open_with_xarray(tmp_path):
    paths = write_archive(tmp_path, 7, "raw/20240601_12{:02d}00.png")
    paths[2].write_bytes(b"broken")
    output = 'kind = "zarr"\nchunk = 3'
    job = job_of(tmp_path, 'files = ["raw"]\ntime = "%Y%m%d_%H%M%S"', output)
    for part in ((2, 2), (1, 2)):
        om.batch.run(job, scheduler="threads", part=part)
    with xarray.open_zarr(tmp_path / "out" / "images.zarr", consolidated=False) as data:
        assert dict(data.north.sizes) == {
            "time": 7,
            "north_y": 16,
            "north_x": 24,
            "channel": 3,
        }
        assert data.north.chunks[0] == (3, 3, 1)
        assert str(data.time.values[1])[:19] == "2024-06-01T12:01:00"
        assert data.valid.values.tolist() == [number != 2 for number in range(7)]
        for number in (0, 1, 3, 6):
            frame = data.north.isel(time=number).values
            np.testing.assert_array_equal(frame, expected(job, number))
        noon = data.around.sel(time="2024-06-01T12:03:00")
        np.testing.assert_array_equal(noon.values, expected(job, 3, "around"))
    # a later image extends the arrays; only its chunk is written
    om.write_image(tmp_path / "raw" / "20240601_120700.png", image(7))
    numbers = []
    original = BatchBlock.run

    def count_run(self):
        numbers.append(self.start)
        return original(self)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(BatchBlock, "run", count_run)
        om.batch.run(job, scheduler="threads")
    assert numbers == [6]
    array = zarr.open_array(tmp_path / "out" / "images.zarr" / "north", mode="r")
    np.testing.assert_array_equal(array[7], expected(job, 7))


def test_removed_inputs_are_removed_from_arrays(tmp_path):
    """Instead of remaining valid at the end of the time series."""
    paths = write_archive(tmp_path, 7, "raw/20240601_12{:02d}00.png")
    job = job_of(tmp_path, 'files = ["raw"]\ntime = "%Y%m%d_%H%M%S"', 'kind = "zarr"\nchunk = 3')
    om.batch.run(job, scheduler="threads")
    om.write_image(tmp_path / "raw" / "20240601_115900.png", image(9))
    for numbers in ((9, 0, 1, 2, 4), (9, 0, 1)):
        for number in {*range(7)} - {*numbers}:
            paths[number].unlink(missing_ok=True)
        result = om.batch.run(job, scheduler="threads")
        assert (result.total, result.done) == (2 * len(numbers), 2 * len(numbers))
        with xarray.open_zarr(tmp_path / "out" / "images.zarr", consolidated=False) as data:
            assert data.valid.values.tolist() == [True] * len(numbers)
            assert np.all(np.diff(data.time.values) > np.timedelta64(0))
            for index, number in enumerate(numbers):
                frame = data.north.isel(time=index).values
                np.testing.assert_array_equal(frame, expected(job, number))


def test_zarr_outputs_have_a_group_per_camera(tmp_path):
    write_archive(tmp_path, 4, "raw/cam-{:d}/a.png")
    inputs = 'files = ["raw"]\ncamera = "cam-(\\\\d)"'
    om.batch.run(job_of(tmp_path, inputs, 'kind = "zarr"'), scheduler="threads")
    group = zarr.open_group(tmp_path / "out" / "images.zarr", mode="r")
    assert sorted(group.group_keys()) == ["0", "1", "2", "3"]
    assert group["2/north"].shape == (1, 16, 24, 3)


def test_zarr_outputs_of_another_size_are_rejected(tmp_path):
    write_archive(tmp_path, 2)
    om.batch.run(job_of(tmp_path, output='kind = "zarr"'), scheduler="threads")
    wider = job_of(tmp_path, output='kind = "zarr"', more=SENSOR + VIEWS.replace("24", "26"))
    with pytest.raises(OmnimirrorError, match="contains images of 24 x 16 px"):
        om.batch.run(wider, scheduler="threads")


def write_video(path, count=50):
    """Write a video with a key frame per second."""
    with av.open(path, "w") as container:
        stream = container.add_stream(
            "libx264", 10, options={"x264-params": "keyint=10:scenecut=0"}
        )
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for number in range(count):
            frame = av.VideoFrame.from_ndarray(image(number // 10), "rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))


def test_videos_are_split_at_key_frames(tmp_path):
    write_archive(tmp_path, 0)
    write_video(tmp_path / "a.mp4")
    starts = key_frame_times(str(tmp_path / "a.mp4"), 2.0)
    assert starts == pytest.approx([0.0, 2.0, 4.0], abs=0.02)
    output = 'kind = "video"\nformat = ".mp4"\nname = "{stem}-{view}"'
    job = job_of(tmp_path, 'videos = ["*.mp4"]\nsegment_s = 2.0', output)
    assert om.batch.run(job, scheduler="threads").done == 6
    paths = sorted((tmp_path / "out").glob("*north.mp4"))
    frames = [sum(1 for _ in VideoReader(path).frames()) for path in paths]
    assert frames == [20, 20, 10]
    whole = om.dewarp_video(
        tmp_path / "a.mp4", tmp_path / "whole.mp4", camera=CAMERA, view=job.views["north"]
    )
    assert whole.outcome.frames == sum(frames)


@pytest.mark.parametrize("content", [b"", b"no video", b"\0\0\0\x18ftypisom" + bytes(40)])
def test_damaged_videos_are_recorded(tmp_path, content):
    write_archive(tmp_path, 0)
    (tmp_path / "a.mp4").write_bytes(content)
    with pytest.raises(MediaError, match=r"cannot read the video .*a\.mp4"):
        key_frame_times(str(tmp_path / "a.mp4"), 1.0)
    job = job_of(tmp_path, 'videos = ["*.mp4"]', 'kind = "video"\nformat = ".mkv"')
    result = om.batch.run(job, scheduler="threads")
    assert (result.total, result.done, result.failed) == (2, 0, 2)
    assert all("a.mp4" in message for message in result.errors.values())


def test_videos_of_images(tmp_path):
    paths = write_archive(tmp_path, 7)
    paths[5].write_bytes(b"broken")
    output = 'kind = "video"\nformat = ".mp4"\nper_shard = 4\nframe_rate = 5.0'
    job = job_of(tmp_path, output=output, more=SENSOR + "[view.a]\nsize = [32, 16]\n")
    result = om.batch.run(job, scheduler="threads")
    assert (result.done, result.failed) == (6, 1)
    videos = sorted((tmp_path / "out").glob("*.mp4"))
    assert [sum(1 for _ in VideoReader(path).frames()) for path in videos] == [4, 2]
    assert VideoReader(videos[0]).frame_rate == 5


RENDER = """
[[sensor]]
file = "camera.toml"
[render]
path = "walk.csv"
texel_mm = 40.0
frame_rate = 10.0
samples = 1
"""


def test_rendering_in_two_parts(tmp_path):
    write_archive(tmp_path, 0)
    (tmp_path / "walk.csv").write_text("time_s,x_mm\n0,0\n0.5,300\n")
    output = 'kind = "webdataset"\nper_shard = 2'
    job = job_of(tmp_path, "", output, RENDER)
    assert [om.batch.run(job, scheduler="threads", part=(i, 2)).done for i in (1, 2)] == [4, 6]
    shards = sorted((tmp_path / "out").glob("*.tar"))
    path = om.load_path(tmp_path / "walk.csv")
    sequence = om.ImageSequence(CAMERA, om.Room(texel_mm=40.0), path, frame_rate=10.0, samples=1)
    dataset = om.write_training_dataset(sequence, tmp_path / "set", per_shard=2)
    for path, other in zip(shards, dataset, strict=True):
        with tarfile.open(path) as one, tarfile.open(other) as two:
            for a, b in zip(one, two, strict=True):
                assert a.name.endswith(b.name)
                assert one.extractfile(a).read() == two.extractfile(b).read()
