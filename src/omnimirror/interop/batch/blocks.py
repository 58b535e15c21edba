"""Blocks of a batch job: reading, dewarping and writing of a few inputs by one worker.

A block reads ahead and writes behind through bounded queues. An input that cannot be read or
processed is recorded in the manifest and skipped; an error of the output store fails the block,
which is then repeated.
"""

from __future__ import annotations

import hashlib
import json
import tempfile
import time
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ... import __version__
from ...base.block_runner import is_stopping
from ...base.caching import cached_property
from ...base.files import parse_json, read_bytes
from ...cameras.camera import Camera
from ...dewarp.image_files import DewarpedImage, ImageDewarper, SourceImage, as_stored
from ...dewarp.request import BorderColour, DewarpRequest, VideoSettings
from ...io.batch import error_message
from ...io.image_metadata import exposure_of
from ...io.images import format_of
from ...optics.camera_files import parse_camera
from ...simulation.datasets import TrainingSamples, write_samples
from ...simulation.scenes.scene_sources import SceneSource
from ...simulation.simulated_video import ImageSequence, load_path
from .inputs import GZIP_SUFFIXES, BatchInput, InputReader
from .job import BatchJob, digest_of
from .manifest import DONE, FAILED, ManifestRow, ManifestWriter, manifest_writer
from .stores import MAX_OBJECT_BYTES

MAX_PROCESSORS = 32
"""Maximum number of sensors whose maps a worker keeps."""
REMOTE_QUEUE = 8  # images read ahead and written behind for URLs
ARRAY_FORMAT = Path("image.bmp")  # 8 bits, grey or RGB


@dataclass(frozen=True, slots=True)
class PlannedOutput:
    """Output of one view of an input.

    Attributes
    ----------
    view, view_digest
        Name and digest of the view.
    key
        Key in the manifest.
    name
        Name of the file, shard, array or video relative to the output URL.
    """

    view: str
    view_digest: str
    key: str
    name: str


@dataclass(frozen=True, slots=True)
class PlannedItem:
    """Input with its sensor and outputs.

    Attributes
    ----------
    source
        Input.
    sensor, sensor_digest
        Name and digest of the sensor.
    outputs
        Outputs of the views.
    label
        Key of the sample in a shard, or index in an array.
    """

    source: BatchInput
    sensor: str
    sensor_digest: str
    outputs: tuple[PlannedOutput, ...]
    label: str = ""

    def row(
        self, output: PlannedOutput, status: str, data: bytes = b"", error: str = ""
    ) -> ManifestRow:
        """Return the row of an output in the manifest."""
        return ManifestRow(
            key=output.key,
            input=self.source.name,
            output=output.name,
            view=output.view,
            status=status,
            error=error,
            size=len(data),
            checksum=hashlib.blake2b(data, digest_size=16).hexdigest() if data else "",
            time=self.source.time,
            camera=self.source.camera,
            sensor=self.sensor,
            sensor_digest=self.sensor_digest,
            view_digest=output.view_digest,
            version=__version__,
            finished=time.time(),
        )


@dataclass(frozen=True)
class BatchBlock:
    """Block of a job.

    Attributes
    ----------
    number
        Number of the block.
    name
        Name of its output, or of its first one.
    job
        Job without its sensors.
    sensors
        Texts of the sensors of the block, by digest.
    items
        Inputs with their outputs.
    start
        Index of the first image in an array.
    run_id
        Identifier of the run, whose workers write separate parts of the manifest.
    """

    number: int
    name: str
    job: BatchJob
    sensors: Mapping[str, str]
    items: tuple[PlannedItem, ...]
    start: int = 0
    run_id: str = ""

    def run(self) -> str:
        """Write the outputs and their rows in the manifest; return the name of the manifest part."""
        kind = "segments" if self.job.inputs.videos else self.job.output.kind
        rows = manifest_writer(self.job.output_url, json.dumps(dict(self.job.storage)), self.run_id)
        context = _Context(self, rows)
        try:
            _WRITERS[kind](context)
        finally:
            context.reader.close()
        rows.flush()
        return rows.name

    @property
    def is_divisible(self) -> bool:
        """True if its inputs are independent files, without common decompression or output."""
        inputs = self.job.inputs
        is_gzip = any(name.lower().endswith(GZIP_SUFFIXES) for name in inputs.shards)
        is_segment_or_array = bool(inputs.videos or inputs.arrays)
        return self.job.output.kind == "files" and not is_segment_or_array and not is_gzip

    def fail(self, rows: ManifestWriter, message: str) -> None:
        """Record the failure of all outputs."""
        for item in self.items:
            for output in item.outputs:
                rows.add(item.row(output, FAILED, error=message))
        rows.flush()


MIN_DIVIDED_ITEMS = 4
"""Minimum number of inputs of a divided block."""


def balance_blocks(blocks: Sequence[BatchBlock], workers: int) -> Iterator[BatchBlock]:
    """Yield blocks of decreasing size, so that all workers finish at about the same time.

    A block of files has at most 1 / (2 workers) of the remaining inputs (guided self-scheduling);
    other blocks are not divided.
    """
    remaining = sum(len(block.items) for block in blocks)
    number = 0
    for block in blocks:
        items = block.items
        while items:
            size = len(items)
            if block.is_divisible:
                size = min(size, max(MIN_DIVIDED_ITEMS, remaining // (2 * workers)))
            name = items[0].outputs[0].name if block.is_divisible else block.name
            yield replace(block, number=number, name=name, items=items[:size])
            items = items[size:]
            remaining -= size
            number += 1


# -- Processing of one image -----------------------------------------------------------------------


class ImageProcessor:
    """Restoration and views of the images of one sensor."""

    def __init__(self, job: BatchJob, sensor_text: str) -> None:
        self.job, self.camera = job, parse_camera(sensor_text)
        options = job.dewarp.model_dump()
        transparent, border = options.pop("transparent"), options.pop("border")
        colour = None if border is None else BorderColour.of(border)
        self.dewarpers = {
            name: ImageDewarper(
                DewarpRequest(self.camera, view, border=colour, **options), transparent=transparent
            )
            for name, view in job.views.items()
        }
        self.restoration = None
        if job.restoration is not None:
            from ...dewarp.restoration.deblurring import Restoration

            self.restoration = Restoration(**job.restoration.model_dump())
        self.restorer = lru_cache(maxsize=4)(self._restorer)

    def _restorer(self, exposure: Any) -> Any:
        assert self.restoration is not None
        return self.restoration.restorer(self.camera, exposure)

    def restored(self, source: SourceImage) -> SourceImage:
        """Return the deblurred image; the image itself without restoration."""
        if self.restoration is None:
            return source
        restorer = self.restorer(exposure_of(source.metadata.exif))
        is_file = "!" not in source.name and "://" not in source.name
        file = Path(source.name) if is_file else None
        pixels, _ = restorer.restore_and_describe(source.pixels, self.restoration.noise, file)
        return SourceImage(source.name, pixels, source.metadata)

    def image(self, source: SourceImage, view: str, output: Path) -> DewarpedImage:
        """Return a view of a restored image, or the image itself, in the format of an output."""
        if view in self.dewarpers:
            return self.dewarpers[view].dewarp(source, output)
        converted = as_stored(source.pixels, format_of(output))
        metadata, _ = source.metadata.supported_by(output, converted, False)
        return DewarpedImage(converted, None, metadata, "")

    def view_size(self, view: str) -> tuple[int, int]:
        """Return the size (width, height) of a view in px."""
        if view not in self.dewarpers:
            return self.camera.image_size
        request = self.dewarpers[view].request
        camera: Camera = request.view_camera(self.camera)
        return request.view_of(camera).size


_processors: OrderedDict[str, ImageProcessor] = OrderedDict()


def processor_of(job: BatchJob, sensor_text: str) -> ImageProcessor:
    """Return the processor of a sensor, kept for later blocks of this process."""
    key = digest_of([sensor_text, job.view_digests])
    if key not in _processors:
        _processors[key] = ImageProcessor(job, sensor_text)
    _processors.move_to_end(key)
    while len(_processors) > MAX_PROCESSORS:
        _processors.popitem(last=False)
    return _processors[key]


@lru_cache(maxsize=4)
def _training_samples(text: str, sensor_text: str) -> TrainingSamples:
    table, folder = parse_json(text)
    path = load_path(Path(folder) / table["path"])
    file = Path(folder) / table["scene"]
    scene = SceneSource(str(file) if file.is_file() else table["scene"], table["texel_mm"]).load()
    sequence = ImageSequence(
        parse_camera(sensor_text),
        scene,
        path,
        frame_rate=table["frame_rate"],
        duration_s=table["duration_s"],
        samples=table["samples"],
        blur=table["blur"],
        seed=table["seed"],
    )
    return TrainingSamples(sequence)


def training_samples(job: BatchJob, sensor_text: str) -> TrainingSamples:
    """Return the training dataset of a rendering job."""
    assert job.render is not None
    record = [job.render.model_dump(), str(job.folder.absolute())]
    return _training_samples(json.dumps(record), sensor_text)


# -- Queues ----------------------------------------------------------------------------------------


class _Context:
    """Reader, store and queues of a running block."""

    def __init__(self, block: BatchBlock, rows: ManifestWriter) -> None:
        self.block, self.job, self.rows = block, block.job, rows
        execution = self.job.execution
        self.store = self.job.store()
        self.processors: dict[str, ImageProcessor] = {}
        default = REMOTE_QUEUE if self.store.is_remote else 0
        configured = execution.write_behind
        self.write_behind = default if configured is None else configured

    @cached_property
    def reader(self) -> InputReader:
        return InputReader(self.job)

    def processor(self, item: PlannedItem) -> ImageProcessor:
        """Return the processor of the sensor of an input."""
        digest = item.sensor_digest
        if digest not in self.processors:
            self.processors[digest] = processor_of(self.job, self.block.sensors[digest])
        return self.processors[digest]

    def sources(self) -> Iterator[tuple[PlannedItem, SourceImage | str]]:
        """Yield the restored image of each input, or its error message."""
        for item, read in self._read_ahead():
            if is_stopping():
                raise KeyboardInterrupt
            try:
                source = self.reader.decode(item.source, read())
                yield item, self.processor(item).restored(source)
            except Exception as e:
                yield item, error_message(e)

    def _read_ahead(self) -> Iterator[tuple[PlannedItem, Callable[[], Any]]]:
        """Yield inputs with functions that return their data, which is read in advance."""
        items = self.block.items
        configured = self.job.execution.read_ahead
        is_local = "://" not in items[0].source.url
        ahead = (0 if is_local else REMOTE_QUEUE) if configured is None else configured
        if self.job.inputs.arrays:
            ahead = min(ahead, 1)  # images of an array share a slab
        if not ahead:
            for item in items:
                yield item, lambda each=item: self.reader.data(each.source)  # type: ignore[misc]  # lambda with defaults
            return
        with ThreadPoolExecutor(ahead) as pool:
            reads: deque[Future[Any]] = deque()
            try:
                for number, item in enumerate(items):
                    for later in items[number + len(reads) : number + ahead + 1]:
                        reads.append(pool.submit(self.reader.data, later.source))
                    yield item, reads.popleft().result
            finally:
                pool.shutdown(wait=False, cancel_futures=True)

    @contextmanager
    def writes(self) -> Iterator[Callable[[PlannedItem, PlannedOutput, bytes], None]]:
        """Yield a function that writes an output and its row, in the background if configured."""

        def write(item: PlannedItem, output: PlannedOutput, data: bytes) -> None:
            self.store.write(output.name, data)
            self.rows.add(item.row(output, DONE, data))

        if not self.write_behind:
            yield write
            return
        pending: deque[Future[None]] = deque()
        with ThreadPoolExecutor(self.write_behind) as pool:

            def submit(item: PlannedItem, output: PlannedOutput, data: bytes) -> None:
                while len(pending) >= 2 * self.write_behind:
                    pending.popleft().result()
                pending.append(pool.submit(write, item, output, data))

            yield submit
            for future in pending:
                future.result()

    def fail(self, item: PlannedItem, message: str) -> None:
        """Record the failure of an input."""
        for output in item.outputs:
            self.rows.add(item.row(output, FAILED, error=message))

    def complete(self, done: Sequence[tuple[PlannedItem, PlannedOutput, bytes]]) -> None:
        """Record the outputs in a completed shard."""
        for item, output, data in done:
            self.rows.add(item.row(output, DONE, data))


# -- Outputs ---------------------------------------------------------------------------------------


def _write_files(context: _Context) -> None:
    """Write a file per input and view."""
    if context.job.render is not None:
        for item, files in _rendered(context):
            _write_rendered_files(context, item, files)
        return
    with context.writes() as write:
        for item, source in context.sources():
            if isinstance(source, str):
                context.fail(item, source)
                continue
            for output in item.outputs:
                try:
                    context.store.check_name(output.name)
                    image = context.processor(item).image(source, output.view, Path(output.name))
                    data = image.encoded(output.name)
                except Exception as e:
                    context.rows.add(item.row(output, FAILED, error=error_message(e)))
                else:
                    write(item, output, data)


def _rendered(context: _Context) -> Iterator[tuple[PlannedItem, dict[str, bytes]]]:
    """Yield the files of each rendered frame by suffix."""
    for item in context.block.items:
        if is_stopping():
            raise KeyboardInterrupt
        samples = training_samples(context.job, context.block.sensors[item.sensor_digest])
        try:
            files = samples.files(int(item.source.member))
        except Exception as e:
            context.fail(item, error_message(e))
        else:
            yield item, files


def _write_rendered_files(context: _Context, item: PlannedItem, files: Mapping[str, bytes]) -> None:
    """Write image, ground truth and metadata of a frame; the row is that of the image."""
    (output,) = item.outputs
    stem = output.name.rpartition(".")[0]
    for suffix, data in files.items():
        if suffix != "png":
            context.store.write(f"{stem}.{suffix}", data)
    context.store.write(output.name, files["png"])
    context.rows.add(item.row(output, DONE, files["png"]))


def _write_shard(context: _Context) -> None:
    """Write a WebDataset shard: a sample per input with a file per view and its metadata."""
    done: list[tuple[PlannedItem, PlannedOutput, bytes]] = []

    def samples() -> Iterator[tuple[str, dict[str, bytes]]]:
        for item, source in context.sources():
            if isinstance(source, str):
                context.fail(item, source)
                continue
            files, outputs = {}, []
            try:
                for output in item.outputs:
                    name = Path(f"{output.view}{context.job.output.format}")
                    image = context.processor(item).image(source, output.view, name)
                    files[name.name] = image.encoded(name)
                    outputs.append((item, output, files[name.name]))
            except Exception as e:
                context.fail(item, error_message(e))
                continue
            files["json"] = _sample_metadata(item)
            done.extend(outputs)
            yield item.label, files

    def rendered_samples() -> Iterator[tuple[str, dict[str, bytes]]]:
        for item, files in _rendered(context):
            done.append((item, item.outputs[0], files["png"]))
            yield item.label, files

    with tempfile.TemporaryFile() as file:
        write_samples(file, rendered_samples() if context.job.render else samples())
        file.seek(0)
        context.store.write(context.block.name, file.read())
    context.complete(done)


def _sample_metadata(item: PlannedItem) -> bytes:
    source = item.source
    record = {
        "input": source.name,
        "time": source.time,
        "camera": source.camera,
        "sensor": item.sensor,
    }
    return json.dumps(record).encode()


def _write_chunk(context: _Context) -> None:
    """Write a chunk of each view to its Zarr array, with time stamps and validity."""
    from .arrays import open_group

    block, job = context.block, context.job
    arrays = {
        output.view: open_group(job, output.name.rpartition("/")[0])
        for output in block.items[0].outputs
    }
    chunks: dict[str, NDArray[np.uint8]] = {}
    valid = np.zeros(len(block.items), bool)
    done: list[tuple[PlannedItem, PlannedOutput, bytes]] = []
    for number, (item, source) in enumerate(context.sources()):
        if isinstance(source, str):
            context.fail(item, source)
            continue
        try:
            images = {
                output.view: _rgb(context.processor(item).image(source, output.view, ARRAY_FORMAT))
                for output in item.outputs
            }
        except Exception as e:
            context.fail(item, error_message(e))
            continue
        for output in item.outputs:
            image = images[output.view]
            chunk = chunks.setdefault(
                output.view, np.zeros((len(block.items), *image.shape), np.uint8)
            )
            chunk[number] = image
            done.append((item, output, image.tobytes()))
        valid[number] = True
    part = slice(block.start, block.start + len(block.items))
    times = [np.nan if item.source.time is None else item.source.time for item in block.items]

    def write() -> None:
        for view, group in arrays.items():
            if view in chunks:
                group[view][part] = chunks[view]
            group["time"][part] = np.array(times)
            group["valid"][part] = valid

    context.store.call(write)
    context.complete(done)


def _rgb(image: DewarpedImage) -> NDArray[np.uint8]:
    pixels = image.pixels if image.pixels.ndim == 3 else image.pixels[..., None]
    return np.ascontiguousarray(np.broadcast_to(pixels[..., :3], (*pixels.shape[:2], 3)))


def _write_videos(context: _Context) -> None:
    """Write a video per view with a frame per input."""
    from ...io.video_frames import frame_of_image
    from ...io.video_writer import VideoWriter

    settings = _video_settings(context.job).encoding()
    frames: list[PlannedItem] = []
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder, ExitStack() as stack:
        writers: dict[str, tuple[Path, Any]] = {}
        for item, source in context.sources():
            if isinstance(source, str):
                context.fail(item, source)
                continue
            try:
                images = {
                    output.view: _rgb(
                        context.processor(item).image(source, output.view, ARRAY_FORMAT)
                    )
                    for output in item.outputs
                }
            except Exception as e:
                context.fail(item, error_message(e))
                continue
            for view, image in images.items():
                if view not in writers:
                    path = Path(folder) / f"{view}{context.job.output.format}"
                    size, rate = (image.shape[1], image.shape[0]), context.job.output.frame_rate
                    writer = stack.enter_context(VideoWriter(path, size, rate, **settings))
                    writers[view] = path, writer
                writers[view][1].write(frame_of_image(image))
            frames.append(item)
        stack.close()
        contents = {view: read_bytes(path, MAX_OBJECT_BYTES) for view, (path, _) in writers.items()}
        for output in frames[0].outputs if frames else ():
            context.store.write(output.name, contents[output.view])
    context.complete(
        [(item, output, contents[output.view]) for item in frames for output in item.outputs]
    )


def _write_segments(context: _Context) -> None:
    """Write a video per segment and view, with its sound, as ``omnimirror dewarp`` does."""
    from ...dewarp.video_files import dewarp_video

    for item in context.block.items:
        processor = context.processor(item)
        settings = _video_settings(
            context.job,
            start_s=float(item.source.member),
            duration_s=item.source.duration_s or None,
        )
        for output in item.outputs:
            request = processor.dewarpers[output.view].request
            with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
                path = Path(folder) / f"view{context.job.output.format}"
                try:
                    dewarp_video(
                        item.source.url,
                        path,
                        camera=request.camera,
                        view=request.view,
                        interpolation=request.interpolation,
                        viewpoint=request.viewpoint,
                        border=request.border,
                        keep_tilt=request.keep_tilt,
                        stored_orientation=request.stored_orientation,
                        settings=settings,
                    )
                except Exception as e:
                    context.rows.add(item.row(output, FAILED, error=error_message(e)))
                    continue
                data = read_bytes(path, MAX_OBJECT_BYTES)
            context.store.write(output.name, data)
            context.rows.add(item.row(output, DONE, data))


def _video_settings(job: BatchJob, **selection: Any) -> VideoSettings:
    output = job.output
    return VideoSettings(
        codec=output.codec, crf=output.crf, pixel_format=output.pixel_format, **selection
    )


_WRITERS: dict[str, Callable[[_Context], None]] = {
    "files": _write_files,
    "webdataset": _write_shard,
    "zarr": _write_chunk,
    "video": _write_videos,
    "segments": _write_segments,
}
