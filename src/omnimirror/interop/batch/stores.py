"""Local folders and object stores: reading, atomic writing and listing of objects by URL.

Local files are written under a temporary name and renamed. Object stores have no rename, but a
single PUT is atomic: an object has either its old or its new content. Other remote file systems
(SFTP, SMB) rename like local ones. All calls are repeated after transient errors.
"""

from __future__ import annotations

import glob
import json
import os
import re
import socket
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import lru_cache
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from ...base.block_runner import Retries
from ...base.errors import MediaError, OmnimirrorError, abbreviate, extra_remedy
from ...base.files import TEMPORARY_MARK, read_bytes

T = TypeVar("T")

OBJECT_STORES = ("s3", "s3a", "gs", "gcs", "az", "abfs", "abfss", "adl", "memory", "oci", "oss")
"""Protocols of stores in which writing an object is atomic."""
MAX_OBJECT_BYTES = 4 << 30
"""Maximum size of an object that is read as a whole, bytes."""
MAX_NAME_BYTES = 255
"""Maximum length of a file name in bytes in the usual file systems."""
TEMPORARY_FOLDER = "_temporary"


class StoredObject(NamedTuple):
    """Object in a listing."""

    url: str
    size: int
    stamp: str
    """Modification time or ETag; empty if the store provides none."""


def is_remote(url: str) -> bool:
    """Return whether a URL is not a local path.

    >>> is_remote("s3://bucket/a.png"), is_remote("archive/a.png"), is_remote("file:///a.png")
    (True, False, False)
    """
    return "://" in url and not url.startswith("file://")


def local_path(url: str) -> str:
    """Return the path of a local URL."""
    return url.removeprefix("file://")


def join_url(root: str, name: str) -> str:
    """Return the URL of a name below a root; an absolute name is unchanged.

    >>> join_url("s3://bucket/out", "a/b.png"), join_url("out", "/a.png")
    ('s3://bucket/out/a/b.png', '/a.png')
    """
    if is_remote(root) and not is_remote(name):
        return f"{root.rstrip('/')}/{name.lstrip('/')}"
    return name if is_remote(name) else os.path.join(local_path(root), local_path(name))


class Store:
    """Files or objects below a root URL.

    Parameters
    ----------
    root
        Local folder or fsspec URL.
    options
        Options of the fsspec file system, such as ``endpoint_url``.
    retries
        Repetition of calls after transient errors.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     store = Store(folder)
    ...     store.write("a/b.txt", b"text")
    ...     store.read("a/b.txt"), [each.size for each in store.entries("a")]
    (b'text', [4])
    """

    def __init__(
        self,
        root: str,
        options: Mapping[str, Any] | None = None,
        retries: Retries = Retries(attempts=4),  # noqa: B008 (frozen)
    ) -> None:
        self.root, self.retries = root, retries
        self.is_remote = is_remote(root)
        self._fs: Any = None
        if self.is_remote:
            self._fs = file_system(root.partition("://")[0], json.dumps(dict(options or {})))
            self.is_object_store = root.partition("://")[0] in OBJECT_STORES

    def url(self, name: str) -> str:
        """Return the URL of a name below the root."""
        return join_url(self.root, name)

    def call(self, function: Callable[[], T]) -> T:
        """Call a function of the file system; its errors become OSError."""

        def call() -> T:
            try:
                return function()
            except (OSError, OmnimirrorError):
                raise
            except Exception as e:  # errors of the client library of a store
                raise _os_error(e) from None

        return self.retries.call(call)

    def _access(self, url: str, function: Callable[[], T]) -> T:
        """Call a function of the file system; errors other than missing objects become messages."""
        try:
            return self.call(function)
        except FileNotFoundError:
            raise
        except OSError as e:
            raise MediaError(f"cannot access {url}: {e.strerror or e}") from None

    def read(self, name: str, start: int | None = None, stop: int | None = None) -> bytes:
        """Read an object, or its bytes from start to stop.

        Raises
        ------
        MediaError
            If the object does not exist, cannot be read, or is larger than
            :data:`MAX_OBJECT_BYTES`.
        """
        url = self.url(name)
        try:
            if self.is_remote:
                data: bytes = self.call(lambda: self._fs.cat_file(url, start=start, end=stop))
                return data
            if start is None:
                return read_bytes(url, MAX_OBJECT_BYTES)
            with open(url, "rb") as file:
                file.seek(start)
                return file.read(None if stop is None else stop - start)
        except FileNotFoundError:
            raise MediaError(f"cannot read {url}: it does not exist") from None
        except OSError as e:
            raise MediaError(f"cannot read {url}: {e.strerror or e}") from None
        except ValueError as e:  # null character in a name
            raise MediaError(f"cannot read {url!r}: {e}") from None

    def check_name(self, name: str) -> None:
        """Raise MediaError if a part of a name is longer than local file systems permit."""
        longest = max(name.split("/"), key=len)
        if not self.is_remote and len(longest.encode()) > MAX_NAME_BYTES:
            raise MediaError(
                f"cannot write {abbreviate(name)}: the name must have at most {MAX_NAME_BYTES} "
                f"bytes; got {len(longest.encode())}; shorten output.name"
            )

    def write(self, name: str, data: bytes) -> None:
        """Write an object atomically.

        Raises
        ------
        OmnimirrorError
            If it cannot be written.
        """
        url = self.url(name)
        try:
            if not self.is_remote:
                self.call(lambda: self._write_local(Path(url), data))
            elif self.is_object_store:
                self.call(lambda: self._fs.pipe_file(url, data))
            else:
                self.call(lambda: self._write_and_rename(url, data))
        except OSError as e:
            raise OmnimirrorError(f"cannot write {url}: {e.strerror or e}") from None

    def write_file(self, name: str, path: Path) -> None:
        """Write an object from a local file, atomically."""
        self.write(name, read_bytes(path, MAX_OBJECT_BYTES))

    def _write_local(self, path: Path, data: bytes) -> None:
        temporary = os.path.join(temporary_folder(self.root), f"{_own_mark()}{os.urandom(4).hex()}")
        try:
            handle = _create(temporary)
            try:
                view = memoryview(data)
                while view:
                    view = view[os.write(handle, view) :]
            finally:
                os.close(handle)
            try:
                os.replace(temporary, path)
            except FileNotFoundError:
                path.parent.mkdir(parents=True, exist_ok=True)
                os.replace(temporary, path)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise

    def _write_and_rename(self, url: str, data: bytes) -> None:
        folder, _, name = url.rpartition("/")
        temporary = f"{folder}/.{name}{TEMPORARY_MARK}{os.urandom(4).hex()}"
        self._fs.makedirs(folder, exist_ok=True)
        self._fs.pipe_file(temporary, data)
        self._fs.mv(temporary, url)

    def exists(self, name: str) -> bool:
        """Return whether an object exists."""
        url = self.url(name)
        if not self.is_remote:
            return os.path.exists(url)
        return bool(self._access(url, lambda: self._fs.exists(url)))

    def remove(self, name: str) -> None:
        """Remove an object if it exists."""
        url = self.url(name)
        with suppress(FileNotFoundError):
            if self.is_remote:
                self._access(url, lambda: self._fs.rm_file(url))
            else:
                os.unlink(url)

    def entries(self, name: str = "") -> list[StoredObject]:
        """Return the objects in a folder, without subfolders; none if it does not exist."""
        url = self.url(name)
        if not self.is_remote:
            return list(_local_objects(url))
        try:
            self._fs.invalidate_cache(url)
            entries = self._access(url, lambda: self._fs.ls(url, detail=True))
        except FileNotFoundError:
            return []
        return [
            _stored_object(self._fs.unstrip_protocol(entry["name"]), entry)
            for entry in entries
            if entry["type"] == "file"
        ]

    def glob(self, pattern: str) -> list[StoredObject]:
        """Return the objects that match a pattern, in order; ``**`` also matches subfolders."""
        url = self.url(pattern)
        if not self.is_remote:
            paths = sorted(set(_glob(url))) if glob.has_magic(url) else [url]
            return [entry for path in paths if (entry := _local_object(path)) is not None]
        if not glob.has_magic(url):
            return [_stored_object(url, self._access(url, lambda: self._fs.info(url)))]
        matches = self._access(url, lambda: self._fs.glob(url, detail=True))
        return [
            _stored_object(self._fs.unstrip_protocol(name), entry)
            for name, entry in sorted(matches.items())
            if entry["type"] == "file"
        ]

    def open(self, name: str) -> Any:
        """Open an object for reading with random access."""
        url = self.url(name)
        if self.is_remote:
            return self._access(url, lambda: self._fs.open(url, "rb"))
        return open(url, "rb")


@lru_cache(maxsize=64)
def file_system(protocol: str, options: str) -> Any:
    """Return the fsspec file system of a protocol; ``options`` is JSON.

    Raises
    ------
    OmnimirrorError
        If fsspec or the package of the protocol is not installed.
    """
    try:
        fsspec: Any = import_module("fsspec")
        return fsspec.filesystem(protocol, **json.loads(options))
    except (ImportError, ValueError) as e:
        raise OmnimirrorError(
            f"{protocol}:// requires fsspec and its package for {protocol} ({e}): "
            f"{extra_remedy('cluster')}"
        ) from None


def temporary_folder(root: str) -> str:
    """Return the folder of temporary files of a local store."""
    return os.path.join(local_path(root), "_manifest", TEMPORARY_FOLDER)


def remove_leftovers(root: str) -> None:
    """Remove temporary files of ended processes of this host.

    Raises
    ------
    OmnimirrorError
        If the folder cannot be created.
    """
    folder, own = temporary_folder(root), f"{socket.gethostname()}-"
    try:
        os.makedirs(folder, exist_ok=True)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {folder}: {e.strerror or e}") from None
    for name in os.listdir(folder):
        if name.startswith(own):
            process = name.removeprefix(own).partition("-")[0]
            if process.isdigit() and not _is_running(int(process)):
                with suppress(OSError):
                    os.unlink(os.path.join(folder, name))


def _create(temporary: str) -> int:
    """Create a file, and its folder if necessary; return its descriptor."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        return os.open(temporary, flags, 0o666)
    except FileNotFoundError:
        os.makedirs(os.path.dirname(temporary), exist_ok=True)
        return os.open(temporary, flags, 0o666)


def _own_mark() -> str:
    return f"{socket.gethostname()}-{os.getpid()}-"


def _is_running(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True


def _glob(pattern: str) -> Iterator[str]:
    """Yield the matches of a pattern; ``**`` follows links to folders, but not back to themselves."""
    recursive = re.search(r"(?:^|/)\*\*(?:/|$)", pattern)
    if recursive is None:
        yield from glob.iglob(pattern)
        return
    base, rest = pattern[: recursive.start()] or "/", pattern[recursive.end() :] or "*"
    for top in glob.iglob(base):
        for folder in _folders(top):
            yield from _glob(os.path.join(glob.escape(folder), rest))


def _folders(top: str, parents: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield a folder and those in it, without hidden ones."""
    real = os.path.realpath(top)
    if real in parents:
        return
    yield top
    with suppress(OSError), os.scandir(top) as entries:
        names = [each.name for each in entries if each.is_dir() and not each.name.startswith(".")]
        for name in sorted(names):
            yield from _folders(os.path.join(top, name), (*parents, real))


def _local_objects(folder: str) -> Iterator[StoredObject]:
    with suppress(FileNotFoundError, NotADirectoryError), os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda e: e.name):
            matches = _local_object(entry.path)
            if matches is not None:
                yield matches


def _local_object(path: str) -> StoredObject | None:
    """Return an ordinary file; None for folders, devices and missing files."""
    try:
        status = os.stat(path)
    except OSError:
        return None
    if not stat.S_ISREG(status.st_mode):
        return None
    return StoredObject(path, status.st_size, str(status.st_mtime_ns))


def _stored_object(url: str, entry: Mapping[str, Any]) -> StoredObject:
    stamp = next(
        (str(entry[k]) for k in ("ETag", "etag", "mtime", "LastModified", "created") if k in entry),
        "",
    )
    return StoredObject(url, int(entry.get("size") or 0), stamp)


def _os_error(error: Exception) -> OSError:
    """Return the OSError for an error of a client library: permanent for credentials."""
    text = f"{type(error).__name__}: {error}"
    if "Credential" in type(error).__name__ or "Auth" in type(error).__name__:
        return PermissionError(text)
    return ConnectionError(text)
