"""Manifest of a batch job: one row per input and output, appended by workers and merged on read.

Workers append JSON lines to a file of their own; in object stores each block writes a small object.
A line is appended after its output is complete, so that a killed process loses no completed
output. A run replaces its lines by a Parquet file at its end. A row replaces earlier rows of its
key and output. ``manifest.parquet`` contains the merged rows for other programs and is never read.
"""

from __future__ import annotations

import json
import os
import socket
import time
import weakref
from collections.abc import Iterable
from dataclasses import dataclass, fields
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from threading import Lock
from typing import Any

from ...base.errors import MediaError, OmnimirrorError, extra_remedy
from ...base.files import parse_json
from .stores import Store

FOLDER = "_manifest"
PLAN_NAME = f"{FOLDER}/plan.json"
TABLE_NAME = "manifest.parquet"
DONE, FAILED, REMOVED = "done", "failed", "removed"


@dataclass(frozen=True, slots=True)
class ManifestRow:
    """State of one output of one input.

    Attributes
    ----------
    key
        Digest of input, sensor, view and version.
    input, output, view
        Name of the input, of the file or shard relative to the output URL, and of the view.
    status
        ``"done"``, ``"failed"``, or ``"removed"`` for outputs of a former sensor or view.
    error
        Message of a failed input.
    size, checksum
        Size in bytes and BLAKE2b digest (128 bits) of the encoded image, array or video.
    time
        Time stamp of the input, s since 1970; None if unknown.
    camera, sensor, sensor_digest, view_digest
        Camera id, name and digest of its sensor, and digest of the view and its settings.
    version
        Version of omnimirror.
    finished
        Completion time, s since 1970.
    """

    key: str
    input: str
    output: str
    view: str
    status: str
    error: str = ""
    size: int = 0
    checksum: str = ""
    time: float | None = None
    camera: str = ""
    sensor: str = ""
    sensor_digest: str = ""
    view_digest: str = ""
    version: str = ""
    finished: float = 0.0

    @property
    def identity(self) -> tuple[str, str]:
        """Key and output: a later row of the same identity replaces the row."""
        return self.key, self.output

    def line(self) -> bytes:
        """Return the row as a JSON line."""
        values = {name: getattr(self, name) for name in COLUMNS}
        return json.dumps(values, separators=(",", ":")).encode() + b"\n"


COLUMNS = tuple(f.name for f in fields(ManifestRow))


class ManifestWriter:
    """Writer of rows by one process.

    Parameters
    ----------
    store
        Store of the outputs.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.name = f"{FOLDER}/rows-{socket.gethostname()}-{os.getpid()}-{os.urandom(4).hex()}"
        self.handle: int | None = None
        self.rows: list[bytes] = []
        self.lock = Lock()

    def add(self, row: ManifestRow) -> None:
        """Append a row; in object stores it is written by :meth:`flush`."""
        if self.store.is_remote:
            with self.lock:
                self.rows.append(row.line())
            return
        with self.lock:
            if self.handle is None:
                self.handle = _open_to_append(Path(self.store.url(f"{self.name}.jsonl")))
                weakref.finalize(self, os.close, self.handle)
        os.write(self.handle, row.line())

    def flush(self) -> None:
        """Write the pending rows of all threads as an object."""
        with self.lock:
            rows, self.rows = self.rows, []
        if not rows:
            return
        try:
            self.store.write(f"{self.name}-{os.urandom(6).hex()}.jsonl", b"".join(rows))
        except BaseException:
            with self.lock:
                self.rows = rows + self.rows
            raise


def _open_to_append(path: Path) -> int:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o666)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {path}: {e.strerror or e}") from None


@lru_cache(maxsize=8)
def manifest_writer(root: str, storage: str, run: str) -> ManifestWriter:
    """Return the writer of this process for an output URL and a run; ``storage`` is JSON."""
    return ManifestWriter(Store(root, parse_json(storage)))


class BatchManifest:
    """Merged manifest of a job.

    Parameters
    ----------
    store
        Store of the outputs.
    """

    def __init__(self, store: Store) -> None:
        self.store = store
        self.rows: dict[tuple[str, str], ManifestRow] = {}
        self._read: dict[str, int] = {}
        self.refresh()

    def refresh(self) -> None:
        """Read new rows.

        Raises
        ------
        MediaError
            If a part of the manifest is damaged.
        """
        for _ in range(5):  # a part that disappeared was merged into another
            try:
                for entry in self.store.entries(FOLDER):
                    name = entry.url.rpartition("/")[2]
                    if name.endswith((".jsonl", ".parquet")) and self._read.get(name) != entry.size:
                        self._add(_rows_in(self.store.read(f"{FOLDER}/{name}"), name))
                        self._read[name] = entry.size
                return
            except MediaError as e:
                if "does not exist" not in str(e):
                    raise
        raise MediaError(
            f"the manifest in {self.store.root} changes continuously; repeat the command"
        )

    def _add(self, rows: Iterable[ManifestRow]) -> None:
        for row in rows:
            previous = self.rows.get(row.identity)
            if previous is None or previous.finished <= row.finished:
                self.rows[row.identity] = row

    def status(self, key: str, output: str) -> str:
        """Return the status of an output by key and name; empty without a row."""
        row = self.rows.get((key, output))
        return row.status if row else ""

    def merge(self, writers: Iterable[str]) -> None:
        """Replace the lines of ended writers, by name without suffix, by one Parquet file."""
        names = [
            name
            for entry in self.store.entries(FOLDER)
            if (name := entry.url.rpartition("/")[2]).endswith(".jsonl")
            and name.startswith(tuple(writer.rpartition("/")[2] for writer in writers))
        ]
        if not names:
            return
        latest: dict[tuple[str, str], ManifestRow] = {}
        for name in names:
            for row in _rows_in(self.store.read(f"{FOLDER}/{name}"), name):
                previous = latest.get(row.identity)
                if previous is None or previous.finished <= row.finished:
                    latest[row.identity] = row
        part = f"{FOLDER}/rows-{time.time_ns():x}-{os.urandom(4).hex()}.parquet"
        self.store.write(part, parquet_bytes(latest.values()))
        for name in names:
            self.store.remove(f"{FOLDER}/{name}")
        self.refresh()

    def write_table(self) -> None:
        """Write all rows to ``manifest.parquet``, in the order of inputs and views."""
        rows = sorted(self.rows.values(), key=lambda row: (row.input, row.view, row.finished))
        self.store.write(TABLE_NAME, parquet_bytes(rows))


def _rows_in(data: bytes, name: str) -> list[ManifestRow]:
    """Return the rows of a part; an incomplete last line of a killed process is omitted."""
    lines = data[: data.rfind(b"\n") + 1].splitlines()
    try:
        tables = parquet_rows(data) if name.endswith(".parquet") else map(json.loads, lines)
        rows = [ManifestRow(**table) for table in tables]
        is_valid = all(isinstance(row.finished, float | int) for row in rows)
    except (OSError, ValueError, TypeError):
        is_valid = False
    if not is_valid:
        raise MediaError(
            f"the part {name} of the manifest is damaged; remove it to compute its outputs again"
        )
    return rows


def parquet_rows(data: bytes) -> list[dict[str, Any]]:
    """Return the rows of a Parquet file.

    ``pyarrow.parquet.read_table`` starts threads that release the buffer after the call, which
    aborts a process that exits at the same time (apache/arrow#34314).

    Raises
    ------
    OSError, ValueError
        If the data are not a Parquet file.
    OmnimirrorError
        If pyarrow is missing.
    """
    pa, pq = _pyarrow()
    with pq.ParquetFile(pa.BufferReader(data)) as file:
        rows: list[dict[str, Any]] = file.read(use_threads=False).to_pylist()
    return rows


def parquet_bytes(rows: Iterable[ManifestRow]) -> bytes:
    """Return rows as a Parquet file."""
    pa, pq = _pyarrow()
    number, real = pa.int64(), pa.float64()
    types = {"size": number, "time": real, "finished": real}
    schema = pa.schema([(name, types.get(name, pa.string())) for name in COLUMNS])
    values = list(rows)
    columns = [[getattr(row, name) for row in values] for name in COLUMNS]
    into = pa.BufferOutputStream()
    pq.write_table(pa.table(columns, schema=schema), into, compression="zstd")
    data: bytes = into.getvalue().to_pybytes()
    return data


def _pyarrow() -> tuple[Any, Any]:
    try:
        return import_module("pyarrow"), import_module("pyarrow.parquet")
    except ImportError:
        raise OmnimirrorError(
            f"a Parquet table requires pyarrow: {extra_remedy('cluster')}"
        ) from None
