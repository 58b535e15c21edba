"""Inputs of batch jobs: listing of files, shards, arrays and videos, and reading of one input.

Listing reads no pixels: names, sizes and modification times of files, the headers of tar files, the
shape of arrays, and the key frames of videos.
"""

from __future__ import annotations

import csv
import glob
import gzip
import io
import math
import os
import re
import tarfile
import zipfile
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import lru_cache
from importlib import import_module
from threading import Lock
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter, MediaError, OmnimirrorError, extra_remedy
from ...base.files import MAX_TEXT_BYTES, check_file
from ...dewarp.image_files import SourceImage
from ...io.batch import READABLE_IMAGE_SUFFIXES
from ...io.images import OPAQUE, ImageMetadata, decode_image_and_metadata
from .job import BatchJob, digest_of
from .manifest import parquet_rows
from .stores import MAX_OBJECT_BYTES, Store, is_remote

MAX_TABLE_BYTES = 4 << 30
MAX_SLAB_BYTES = 1 << 30
"""Maximum size of the images of an array that are read at a time, bytes."""


@dataclass(frozen=True, slots=True)
class BatchInput:
    """Input of a job.

    Attributes
    ----------
    url
        Absolute URL of the file.
    member
        Name in a tar or zip file, index in an array, start of a segment of a video (s), number of a
        rendered frame; empty for files.
    start, size
        Position in a tar file, after decompression, and size, bytes; -1 if unknown.
    stamp
        Modification time or ETag.
    camera
        Camera id; empty if unknown.
    time
        Time stamp, s since 1970 in UTC; None if unknown.
    duration_s
        Duration of a segment of a video; 0 up to the end.
    root
        Folder with a slash at its end that output names omit: the part of a pattern before the
        first wildcard.
    """

    url: str
    member: str = ""
    start: int = -1
    size: int = -1
    stamp: str = ""
    camera: str = ""
    time: float | None = None
    duration_s: float = 0.0
    root: str = ""

    @property
    def name(self) -> str:
        """Name for messages and the manifest."""
        return printable(f"{self.url}!{self.member}" if self.member else self.url)

    def identity(self, kind: str) -> list[Any]:
        """Return the data that identify the content: the name, and size and time of the file."""
        if kind == "name":
            return [self.name]
        return [self.name, self.start, self.size, self.stamp, self.duration_s]


def list_inputs(job: BatchJob) -> list[BatchInput]:
    """Return all inputs of a job in a fixed order, each once.

    Raises
    ------
    OmnimirrorError
        If a pattern matches nothing, a list, table, shard, array or video cannot be read, or there
        are no inputs.
    """
    table = job.inputs
    inputs: dict[str, BatchInput] = {}
    sources: list[Iterator[BatchInput]] = [_files(job, pattern) for pattern in table.files]
    if table.list_file is not None:
        sources.append(_listed(job, table.list_file))
    if table.table is not None:
        sources.append(_tabulated(job, table.table))
    sources += [_members(job, pattern) for pattern in table.shards]
    sources += [_indices(job, name) for name in table.arrays]
    sources += [_segments(job, pattern) for pattern in table.videos]
    label = Labels(job)
    for source in sources:
        for each in source:
            inputs.setdefault(each.name, label(each))
    if not inputs:
        raise MediaError("inputs must contain at least one image; got none")
    return list(inputs.values())


def printable(name: str) -> str:
    r"""Return a name with the bytes of other encodings than UTF-8 as text.

    >>> printable("caf\udce9.png")
    'caf\\udce9.png'
    """
    return name.encode("utf-8", "backslashreplace").decode()


# -- Camera and time -------------------------------------------------------------------------------

TIME_FIELDS = {"Y": r"\d{4}", "j": r"\d{3}", "f": r"\d{1,6}"} | dict.fromkeys("mdHMSy", r"\d{2}")


def time_pattern(form: str) -> re.Pattern[str]:
    r"""Return the regular expression of a time format.

    >>> time_pattern("%Y/%m/%d/img_%H%M").search("archive/2024/06/01/img_1230.jpg")[0]
    '2024/06/01/img_1230'

    Raises
    ------
    InvalidParameter
        If the format contains no, unknown or repeated fields.
    """
    parts = re.split(r"%(.)", form)
    fields = parts[1::2]
    is_valid = fields and len(set(fields)) == len(fields) and "%" not in "".join(parts[::2])
    if not is_valid or not set(fields) <= set(TIME_FIELDS):
        raise InvalidParameter(
            f"inputs.time must contain fields from %{', %'.join(TIME_FIELDS)}, each once; got {form!r}"
        )
    return re.compile(
        "".join(
            TIME_FIELDS[part] if number % 2 else re.escape(part)
            for number, part in enumerate(parts)
        )
    )


class Labels:
    """Camera id and time stamp of inputs, from their names."""

    def __init__(self, job: BatchJob) -> None:
        self.camera = re.compile(job.inputs.camera) if job.inputs.camera else None
        self.form = job.inputs.time or ""
        self.pattern = time_pattern(self.form) if self.form else None

    def __call__(self, each: BatchInput) -> BatchInput:
        """Return an input with camera and time; those of a table are kept."""
        changes: dict[str, Any] = {}
        if self.camera is not None and not each.camera and (m := self.camera.search(each.name)):
            changes["camera"] = m[1] or ""
        if self.pattern is not None and each.time is None and (m := self.pattern.search(each.name)):
            changes["time"] = parse_time(m[0], self.form)
        return replace(each, **changes) if changes else each


def parse_time(text: str, form: str = "") -> float | None:
    """Return a time in s since 1970, in UTC unless it contains a zone; None if it is invalid.

    >>> parse_time("20240601_1230", "%Y%m%d_%H%M"), parse_time("2024-06-01T12:30:00+02:00")
    (1717245000.0, 1717237800.0)
    """
    try:
        moment = datetime.strptime(text, form) if form else datetime.fromisoformat(text)
    except ValueError:
        return None
    return timestamp(moment)


def timestamp(moment: datetime) -> float | None:
    """Return the time in s since 1970, in UTC unless it contains a zone; None if its year is not 1
    to 9999 in UTC.
    """
    try:
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).astimezone(UTC).timestamp()
    except OverflowError:
        return None


# -- Files, lists and tables -----------------------------------------------------------------------


def _files(job: BatchJob, pattern: str) -> Iterator[BatchInput]:
    """Yield the files of a pattern; a folder stands for its images and those of its subfolders.

    Outputs are not inputs of the next run: files in an output folder inside the folder of the
    inputs are omitted.
    """
    url = _pattern_url(job, pattern)
    if not is_remote(url) and os.path.isdir(job.resolve(pattern)):
        url = os.path.join(url, "**")
    is_pattern = glob.escape(job.resolve(pattern)) != url
    root, outputs = root_of(url), f"{job.output_url.rstrip('/')}/"
    omitted = None if root.startswith(outputs) else outputs
    count = 0
    for each in job.store(url).glob(url):
        if omitted is not None and each.url.startswith(omitted):
            continue
        if not is_pattern or each.url.lower().endswith(READABLE_IMAGE_SUFFIXES):
            count += 1
            yield BatchInput(each.url, size=each.size, stamp=each.stamp, root=root)
    if not count:
        raise MediaError(f"inputs.files must match images; got none for {pattern}")


def _pattern_url(job: BatchJob, pattern: str) -> str:
    """Return the URL of a pattern in the file; the name of an existing file stands for itself."""
    url = job.resolve(pattern)
    if is_remote(url):
        return url
    if os.path.lexists(url):
        return glob.escape(url)
    return job.resolve(pattern, is_pattern=True)


def _listed(job: BatchJob, name: str) -> Iterator[BatchInput]:
    """Yield the files of a list; missing files are reported when they are read."""
    url = job.resolve(name)
    text = job.store(url).read(url, 0, MAX_TEXT_BYTES).decode("utf-8-sig", "replace")
    for line in text.splitlines():
        if line.strip() and not line.startswith("#"):
            yield _file(job, line.strip())


def _file(job: BatchJob, name: str, **labels: Any) -> BatchInput:
    url = job.resolve(name)
    labels["root"] = root_of(url) if is_remote(url) else f"{job.resolve('')}/"
    if is_remote(url):
        return BatchInput(url, **labels)
    try:
        status = os.stat(url)
    except (OSError, ValueError):  # missing, or a name with a null character
        return BatchInput(url, **labels)
    return BatchInput(url, size=status.st_size, stamp=str(status.st_mtime_ns), **labels)


def _tabulated(job: BatchJob, name: str) -> Iterator[BatchInput]:
    """Yield the rows of a CSV or Parquet table with the columns path, camera and time."""
    url = job.resolve(name)
    data = job.store(url).read(url, 0, MAX_TABLE_BYTES)
    if url.lower().endswith(".parquet"):
        try:
            rows = parquet_rows(data)
        except (ValueError, OSError) as e:
            raise MediaError(f"{url} must be a Parquet table: {e}") from None
    else:
        try:
            rows = list(csv.DictReader(io.StringIO(data.decode("utf-8-sig", "replace"))))
        except csv.Error as e:
            raise MediaError(f"{url} must be a CSV or Parquet table: {e}") from None
    for number, row in enumerate(rows, 1):
        if not row.get("path"):
            raise MediaError(f"{url} must have a column path with a name; row {number} has none")
        labels: dict[str, Any] = {"camera": _camera_id(row.get("camera"))}
        if (moment := row.get("time")) not in (None, ""):
            stamp = (
                timestamp(moment)
                if isinstance(moment, datetime)
                else parse_time(str(moment), job.inputs.time or "")
            )
            if stamp is None:
                raise MediaError(f"{url}, row {number}: time must be ISO 8601; got {moment!r}")
            labels["time"] = stamp
        yield _file(job, str(row["path"]), **labels)


def _camera_id(value: Any) -> str:
    """Return a camera id; a column of integers with gaps contains real numbers."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.17g}"
    return "" if value is None else str(value)


def _package(name: str, purpose: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise OmnimirrorError(f"{purpose} require {name}: {extra_remedy('cluster')}") from None


# -- Shards, arrays and videos ---------------------------------------------------------------------


def _matches(job: BatchJob, pattern: str) -> list[Any]:
    url = _pattern_url(job, pattern)
    matches = job.store(url).glob(url)
    if not matches:
        raise MediaError(f"inputs must match files; got none for {pattern}")
    return matches


def _members(job: BatchJob, pattern: str) -> Iterator[BatchInput]:
    """Yield the images in tar and zip files; those of tar files with their position."""
    for shard in _matches(job, pattern):
        with job.store(shard.url).open(shard.url) as file:
            try:
                if _is_zip(shard.url):
                    with zipfile.ZipFile(file) as archive:
                        members = [(m.filename, -1, m.file_size) for m in archive.infolist()]
                else:
                    plain: Any = gzip.GzipFile(fileobj=file) if _is_gzip(shard.url) else file
                    with tarfile.open(fileobj=plain, mode="r:") as tar:
                        members = [(m.name, m.offset_data, m.size) for m in tar if m.isfile()]
            except SHARD_ERRORS as e:
                raise MediaError(f"{shard.url} must be a tar, tar.gz or zip file: {e}") from None
        for name, start, size in members:
            if name.lower().endswith(READABLE_IMAGE_SUFFIXES):
                root = root_of(_pattern_url(job, pattern))
                yield BatchInput(shard.url, name, start, size, shard.stamp, root=root)


SHARD_ERRORS = (tarfile.TarError, zipfile.BadZipFile, gzip.BadGzipFile, zlib.error, EOFError)
GZIP_SUFFIXES = (".tar.gz", ".tgz")


def _is_gzip(url: str) -> bool:
    return url.lower().endswith(GZIP_SUFFIXES)


def _is_zip(url: str) -> bool:
    return url.lower().endswith(".zip")


def open_array(url: str, storage: Any) -> Any:
    """Open a Zarr array for reading.

    Raises
    ------
    OmnimirrorError
        If zarr is not installed, or there is no array.
    """
    zarr: Any = _package("zarr", "Zarr arrays")
    options = dict(storage) if is_remote(url) else None
    try:
        return zarr.open_array(url, mode="r", storage_options=options)
    except (OSError, ValueError, KeyError) as e:
        raise MediaError(f"cannot read the Zarr array {url}: {e}") from None


def _indices(job: BatchJob, name: str) -> Iterator[BatchInput]:
    """Yield the images of a Zarr array with the shape (n, h, w) or (n, h, w, c)."""
    url = job.resolve(name)
    array = open_array(url, job.storage)
    if array.ndim not in (3, 4):
        raise MediaError(f"{url} must have the shape (n, h, w) or (n, h, w, c); got {array.shape}")
    stamp = digest_of([list(array.shape), str(array.dtype)])
    for index in range(array.shape[0]):
        yield BatchInput(url, str(index), stamp=stamp, root=root_of(url))


def _segments(job: BatchJob, pattern: str) -> Iterator[BatchInput]:
    """Yield segments of videos that start at key frames; a damaged video is one segment, whose error
    is recorded when it is processed.
    """
    for video in _matches(job, pattern):
        if is_remote(video.url):
            raise MediaError(f"inputs.videos must be local files; got {video.url}; download it")
        try:
            starts = key_frame_times(video.url, job.inputs.segment_s)
        except MediaError:
            starts = [0.0]
        for start, end in zip(starts, [*starts[1:], math.inf], strict=True):
            duration = 0.0 if end == math.inf else round(end - start, 6)
            yield BatchInput(
                video.url,
                f"{start:.6f}",
                size=video.size,
                stamp=video.stamp,
                duration_s=duration,
                root=root_of(_pattern_url(job, pattern)),
            )


def key_frame_times(path: str, min_duration_s: float) -> list[float]:
    """Return the times (s) of key frames that divide a video into segments of a minimum duration.

    The packets are read without decoding.

    Raises
    ------
    MediaError
        If the file is not a video.
    """
    av: Any = _package("av", "videos")
    try:
        check_file(path)
        with av.open(path) as container:
            stream = container.streams.video[0]
            tick, origin = float(stream.time_base), stream.start_time or 0
            times = sorted(
                (packet.pts - origin) * tick
                for packet in container.demux(stream)
                if packet.is_keyframe and packet.pts is not None
            )
    except (OSError, IndexError, av.FFmpegError) as e:
        raise MediaError(f"cannot read the video {path}: {e}") from None
    starts = [0.0]
    for time in times:
        if time - starts[-1] >= min_duration_s:
            starts.append(time)
    return starts


# -- Reading ---------------------------------------------------------------------------------------


class InputReader:
    """Reader of the images of inputs.

    Parameters
    ----------
    job
        Job with the options of the stores.
    """

    def __init__(self, job: BatchJob) -> None:
        storage = job.storage
        self.stored_orientation = job.dewarp.stored_orientation
        self.store = lru_cache(maxsize=8)(job.store)
        self.archives: dict[str, tuple[Any, Any]] = {}
        self.lock = Lock()
        self.slab = lru_cache(maxsize=1)(self._slab)
        self.array = lru_cache(maxsize=4)(lambda url: open_array(url, storage))

    def data(self, each: BatchInput) -> bytes | np.ndarray[Any, Any]:
        """Return the bytes of an image file, or the pixels of an array.

        Raises
        ------
        MediaError
            If the input cannot be read.
        """
        if not each.member:
            return self._store_of(each.url).read(self._name(each.url))
        if _is_gzip(each.url):
            return self._decompressed(each)
        if each.start >= 0:
            store = self._store_of(each.url)
            data = store.read(self._name(each.url), each.start, each.start + each.size)
            if len(data) < each.size:
                raise MediaError(f"cannot read {each.name}: the file is truncated")
            return data
        if _is_zip(each.url):
            return self._unzipped(each)
        array = self.array(each.url)
        index, length = int(each.member), self._slab_length(array)
        pixels: np.ndarray[Any, Any] = self.slab(each.url, index // length)[index % length]
        return pixels

    def decode(self, each: BatchInput, data: bytes | np.ndarray[Any, Any]) -> SourceImage:
        """Decode an input."""
        if isinstance(data, np.ndarray):
            if data.dtype.name not in OPAQUE:
                raise MediaError(
                    f"{each.name} must have {', '.join(OPAQUE)} values; got {data.dtype.name}"
                )
            pixels = np.ascontiguousarray(data[..., 0] if data.shape[2:] == (1,) else data)
            return SourceImage(each.name, pixels, ImageMetadata())
        pixels, metadata = decode_image_and_metadata(
            each.name, data, stored_orientation=self.stored_orientation
        )
        return SourceImage(each.name, pixels, metadata)

    def _store_of(self, url: str) -> Store:
        root = url.rpartition("/")[0] if is_remote(url) else "/"
        store: Store = self.store(root)
        return store

    def _name(self, url: str) -> str:
        return url.rpartition("/")[2] if is_remote(url) else url

    def _archive(self, url: str) -> Any:
        if url not in self.archives:
            file = self._store_of(url).open(self._name(url))
            is_gzip = _is_gzip(url)
            self.archives[url] = (
                file,
                gzip.GzipFile(fileobj=file) if is_gzip else zipfile.ZipFile(file),
            )
        return self.archives[url][1]

    def close(self) -> None:
        """Close all compressed archives."""
        for file, archive in self.archives.values():
            archive.close()
            file.close()
        self.archives = {}

    def _unzipped(self, each: BatchInput) -> bytes:
        try:
            with self.lock:  # one file position for all threads that read ahead
                data: bytes = self._archive(each.url).read(each.member)
                return data
        except (OSError, KeyError, zipfile.BadZipFile, NotImplementedError, EOFError) as e:
            raise MediaError(f"cannot read {each.name}: {e}") from None
        except Exception as e:  # zlib.error, and errors of encrypted members
            raise MediaError(f"cannot read {each.name}: {e}") from None

    def _decompressed(self, each: BatchInput) -> bytes:
        """Return a member of a compressed tar file; positions in ascending order require no
        repeated decompression.
        """
        if each.size > MAX_OBJECT_BYTES:
            raise MediaError(f"{each.name} must have at most {MAX_OBJECT_BYTES} bytes")
        try:
            with self.lock:
                tar = self._archive(each.url)
                tar.seek(each.start)
                data: bytes = tar.read(each.size)
        except (*SHARD_ERRORS, OSError) as e:
            raise MediaError(f"cannot read {each.name}: {e}") from None
        if len(data) < each.size:
            raise MediaError(f"cannot read {each.name}: the file is truncated")
        return data

    def _slab_length(self, array: Any) -> int:
        """Return the number of images of an array that are read together: those of a chunk."""
        image_bytes = max(1, math.prod(array.shape[1:]) * array.dtype.itemsize)
        return int(max(1, min(array.chunks[0], MAX_SLAB_BYTES // image_bytes)))

    def _slab(self, url: str, number: int) -> np.ndarray[Any, Any]:
        array = self.array(url)
        length = self._slab_length(array)
        try:
            slab: np.ndarray[Any, Any] = array[number * length : (number + 1) * length]
        except Exception as e:  # any error of a codec or store
            raise MediaError(
                f"cannot read {url}, images {number * length} and following: {e}"
            ) from e
        return slab


def root_of(pattern: str) -> str:
    """Return the folder of a pattern before its first wildcard, with a slash at its end.

    >>> root_of("/raw/20*/*.jpg"), root_of("s3://b/raw/a.tar")
    ('/raw/', 's3://b/raw/')
    >>> root_of("/raw[[]1]/*.jpg")
    '/raw[1]/'
    """
    fixed = re.match(r"(?:\[[*?[]\]|[^*?[])*", pattern)
    assert fixed is not None
    text = re.sub(r"\[([*?[])\]", r"\1", fixed[0])
    return text[: text.rfind("/") + 1]


def stem_of(each: BatchInput) -> tuple[str, str]:
    """Return the folder below the root, with a slash at its end, and the stem of an input.

    >>> stem_of(BatchInput("/raw/2024/a.jpg", root="/raw/"))
    ('2024/', 'a')
    >>> stem_of(BatchInput("s3://b/s-0.tar", "x/7.png", 512, root="s3://b/"))
    ('s-0/x/', '7')
    >>> stem_of(BatchInput("/raw/s.zip", "../../x.png", root="/raw/"))
    ('s/', 'x')
    """
    path = printable(each.url.removeprefix(each.root))
    if each.member:
        path = f"{os.path.splitext(path)[0].removesuffix('.tar')}/{printable(each.member)}"
        if each.start < 0 and not _is_zip(each.url):
            return path.rpartition("/")[0] + "/", each.member.replace(".", "_")
    *folders, name = path.split("/")
    # Members of archives may have names outside their folder.
    folder = "".join(f"{each}/" for each in folders if each not in ("", ".", ".."))
    return folder, os.path.splitext(name)[0]
