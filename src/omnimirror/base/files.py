"""Files: atomic outputs, and readers with limits of size, nesting and time for all inputs."""

from __future__ import annotations

import errno
import json
import math
import os
import re
import shutil
import stat
import sys
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, BinaryIO

from .errors import OmnimirrorError, SpecError, abbreviate
from .escaping import json_text

if sys.platform != "win32":  # on Windows, leftovers of killed runs are not removed
    import fcntl

MAX_TEXT_BYTES = 64 << 20
"""Maximum size of text files in bytes; a measured profile of a million points has half of it."""
MIN_BUFFER_BYTES = 1 << 20
MAX_TOML_CHARACTERS = 4 << 20
"""Maximum characters of a TOML file, parsed in seconds; sufficient for 200,000 numbers."""
MAX_YAML_CHARACTERS = 4 << 20
"""Maximum characters of a YAML or XML file."""
MAX_YAML_NODES = 100_000
"""Maximum number of values and containers of a YAML file; PyYAML builds about 100,000 per second.
"""
MAX_NESTING = 32
"""Maximum nesting of tables and lists in a TOML, JSON or YAML file."""
NESTING_MESSAGE = f"tables and lists must be nested at most {MAX_NESTING} levels deep"
INTEGER_MESSAGE = "integers must have at most 64 bits"
DIGITS_LIMIT = "integer string conversion"  # in the message of ``int`` for thousands of digits
DEEP_KEY = re.compile(
    r"""(?:^[ \t]*\[{0,2}|[{,])[ \t]*(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*)"""
    rf"{{{MAX_NESTING}}}",
    re.M,
)
"""Dotted key of a TOML file that creates too many tables."""
NONBLOCKING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0)
TEMPORARY_MARK = ".omnimirror-"
"""Part of the names of all temporary files next to an output, by which the next run identifies
them.
"""


# -- Writing --------------------------------------------------------------------------------------


def is_standard_output(path: str | Path) -> bool:
    """Return whether a name means standard output: ``-``, or ``-.png`` with a suffix for the
    format.

    >>> is_standard_output("-"), is_standard_output("-.png"), is_standard_output("./a/-")
    (True, True, False)
    """
    path = Path(path)
    return path.stem == "-" and path.name == str(path)


@contextmanager
def atomic_output(
    path: str | Path, rescue: Callable[[Path], Path | None] | None = None
) -> Iterator[Path]:
    """Yield a temporary name that replaces ``path`` when the block ends without an error.

    The temporary file is in the folder of ``path`` and has its suffix, which image writers use to
    select the format. Missing folders are created. A symbolic link is kept, and its target is
    replaced; a replaced file keeps its permissions. Outputs that cannot be replaced are written at
    the end of the block: standard output (:func:`is_standard_output`), a pipe, a device such as
    ``/dev/null``.

    Leftovers of killed runs for the same output are removed, unless ``rescue``, which is called for
    each of these files, returns a new name for it.

    Raises
    ------
    OmnimirrorError
        If the folder is not writable, or the disk is full; an existing file at ``path`` is
        unchanged.
    """
    if not isinstance(path, str | Path) or "\0" in str(path):
        raise OmnimirrorError(f"path must be a file name; got {abbreviate(repr(path))}")
    path = Path(path)
    try:
        if is_stream(path):
            with _stream_output(path) as temporary:
                yield temporary
        else:
            with _file_output(path, rescue) as temporary:
                yield temporary
    except BrokenPipeError as e:
        if is_standard_output(path):  # the reader (head, less) closed the pipe
            raise
        raise OmnimirrorError(f"cannot write {display_name(path)}: {e.strerror}") from None
    except OSError as e:
        raise OmnimirrorError(f"cannot write {display_name(path)}: {e.strerror or e}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file atomically; an existing file is unchanged on errors."""
    with atomic_output(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def write_json(path: str | Path, data: Any) -> None:
    """Write data as JSON atomically, after conversion by :func:`json_plain`."""
    write_text(path, json_text(json_plain(data), indent=1) + "\n")


def json_plain(value: Any) -> Any:
    """Convert data to JSON-serialisable values: tuples and arrays to lists, infinity to a word,
    NaN to None.

    >>> json_plain({"object_distance_mm": (600.0, float("inf")), "focus_mm": float("nan")})
    {'object_distance_mm': [600.0, 'inf'], 'focus_mm': None}
    """
    if isinstance(value, dict):
        return {k: json_plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # NumPy, without importing it
        return json_plain(value.tolist())
    if isinstance(value, list | tuple):
        return [json_plain(v) for v in value]
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)


def is_stream(path: str | Path) -> bool:
    """Return whether a name is a stream that cannot be replaced: standard output, a pipe, a device.

    >>> is_stream("-"), is_stream("/dev/null"), is_stream("table.csv")
    (True, True, False)
    """
    if is_standard_output(path) or _descriptor_of(path) is not None:
        return True
    try:
        mode = os.stat(path).st_mode
    except FileNotFoundError:
        return False
    except ValueError:
        raise OSError(errno.EINVAL, "the name must not contain null characters") from None
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def is_same_file(a: str | Path, b: str | Path) -> bool:
    """Return whether two names refer to one file, existing or not; a circular link refers only to
    itself.

    >>> is_same_file("a.png", "./b/../a.png")
    True
    """
    return os.path.realpath(a) == os.path.realpath(b)


def display_name(path: str | Path) -> str:
    """Return the name of a file for messages."""
    return "standard output" if is_standard_output(path) else str(path)


@contextmanager
def _file_output(path: Path, rescue: Callable[[Path], Path | None] | None) -> Iterator[Path]:
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "the name must be that of a file; got a folder")
    _remove_leftovers(target, rescue or (lambda leftover: None))
    temporary = target.with_name(f"{_prefix(target)}{os.urandom(4).hex()}{target.suffix}")
    handle = None
    try:  # set before the file is created: a signal may raise at any moment
        handle = _create_locked(temporary)
        yield temporary
        os.chmod(temporary, _permissions(target))
        os.replace(temporary, target)
    except BaseException:
        with suppress(OSError):
            temporary.unlink()
        raise
    finally:
        if handle is not None:
            os.close(handle)


@contextmanager
def _stream_output(path: Path) -> Iterator[Path]:
    """Yield a seekable temporary file that is copied to the stream at the end."""
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        temporary = Path(folder) / f"output{path.suffix}"
        yield temporary
        with temporary.open("rb") as source, _open_stream(path) as sink:
            shutil.copyfileobj(source, sink)


@contextmanager
def _open_stream(path: Path) -> Iterator[BinaryIO]:
    """Yield a binary writer for a stream; an open descriptor continues at its position."""
    number = 1 if is_standard_output(path) else _descriptor_of(path)
    if number is None:
        if stat.S_ISBLK(os.stat(path).st_mode):
            raise OSError(errno.EINVAL, "the name must be that of a file; got a block device")
        with open(os.open(path, os.O_WRONLY), "wb") as sink:
            yield sink
        return
    for stream in (sys.stdout, sys.stderr):  # earlier text precedes the new output
        if stream is not None:
            stream.flush()
    buffer = getattr(sys.stdout, "buffer", None)
    if number == 1 and buffer is not None:
        yield buffer
        buffer.flush()
        return
    with open(os.dup(number), "wb") as sink:
        yield sink


def _descriptor_of(path: str | Path) -> int | None:
    """Return the open descriptor of this process that a name refers to: ``/dev/stdout``,
    ``/dev/fd/3``.
    """
    name = os.fspath(path)
    for _ in range(8):
        if match := re.fullmatch(r"/(?:dev|proc/(?:self|\d+))/fd/(\d{1,9})", name):
            is_own = name.startswith(("/dev/", "/proc/self/", f"/proc/{os.getpid()}/"))
            return int(match[1]) if is_own else None
        try:
            name = os.path.join(os.path.dirname(name), os.readlink(name))
        except (OSError, ValueError):  # no link, or null character in the name
            return None
    return None


def _permissions(target: Path) -> int:
    """Return the permissions of the replaced file, or those of a new file."""
    try:
        return stat.S_IMODE(os.stat(target).st_mode)
    except OSError:
        return 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _prefix(target: Path) -> str:
    """Return the prefix of temporary names of an output: short and in ASCII, for all libraries."""
    return f".{target.stem.encode('ascii', 'ignore').decode()[:60]}{TEMPORARY_MARK}"


def _create_locked(temporary: Path) -> int | None:
    """Create a file that is readable by its owner only, and locked while the handle is open."""
    while True:
        handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        if sys.platform == "win32":  # an open file cannot be renamed on Windows
            os.close(handle)
            return None
        with suppress(OSError):  # file systems without locks: see _remove_leftovers
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.path.exists(temporary):
            return handle
        os.close(handle)  # another run removed it before it was locked


def _remove_leftovers(target: Path, rescue: Callable[[Path], Path | None]) -> None:
    """Remove or rename unlocked temporary files of this output, left behind by killed runs."""
    if sys.platform == "win32":
        return
    pattern = re.compile(re.escape(_prefix(target)) + r"[a-z0-9_]{8}" + re.escape(target.suffix))
    with os.scandir(target.parent) as entries:
        names = [entry.path for entry in entries if pattern.fullmatch(entry.name)]
    for name in names:
        with suppress(OSError):
            handle = os.open(name, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                status = os.fstat(handle)
                if stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid():
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    if rescued := rescue(Path(name)):
                        os.chmod(name, _permissions(rescued))
                        os.rename(name, rescued)
                    else:
                        os.unlink(name)
            finally:
                os.close(handle)


# -- Reading --------------------------------------------------------------------------------------


def open_file(path: str | Path, max_bytes: int | None = None) -> BinaryIO:
    """Open an ordinary file for reading in binary mode.

    A FIFO would block the reader and a device may be endless: both are rejected, before and after
    opening.

    Parameters
    ----------
    path
    max_bytes
        Maximum size in bytes; None for files that are read in pieces.

    Raises
    ------
    OSError
        If the file does not exist, is not an ordinary file, or is too large; ``strerror`` states
        the reason.
    """
    try:
        _check_ordinary(os.stat(path), max_bytes)
    except ValueError:  # null character in the name
        raise OSError(errno.EINVAL, "the name must not contain null characters") from None
    file = open(os.open(path, os.O_RDONLY | NONBLOCKING), "rb")  # noqa: SIM115
    try:
        _check_ordinary(os.fstat(file.fileno()), max_bytes)  # the file may have been replaced
    except BaseException:
        file.close()
        raise
    return file


def check_file(
    path: str | Path, max_bytes: int | None = None, max_unpacked_bytes: int | None = None
) -> None:
    """Check a file that a library opens by name: its type, its size, and the declared size of a ZIP
    archive.

    Parameters
    ----------
    path
    max_bytes
        Maximum size in bytes.
    max_unpacked_bytes
        Maximum total size in bytes of all members of an archive; ``zipfile`` reads no more than
        declared.

    Raises
    ------
    OSError
        As :func:`open_file`, or the members are too large; ``strerror`` states the reason.
    """
    with open_file(path, max_bytes) as file:
        if max_unpacked_bytes is None or not zipfile.is_zipfile(file):
            return
        try:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as e:
            raise OSError(errno.EINVAL, f"damaged archive ({e})") from None
        if unpacked > max_unpacked_bytes:
            raise OSError(
                errno.EFBIG, f"the content must be {_size_limit(max_unpacked_bytes, unpacked)}"
            )


def read_bytes(path: str | Path, max_bytes: int) -> bytes:
    """Read an ordinary file of at most ``max_bytes`` bytes.

    Raises
    ------
    OSError
        As :func:`open_file`; ``strerror`` states the reason.
    """
    with open_file(path, max_bytes) as file:
        # generated files, as in /proc, have a nominal size of 0
        capacity = min(max_bytes, max(os.fstat(file.fileno()).st_size, MIN_BUFFER_BYTES))
        data = file.read(capacity + 1)
    if len(data) > capacity:
        raise OSError(errno.EFBIG, f"the file must be {_size_limit(capacity)}")
    return data


def read_text(
    path: str | Path,
    noun: str,
    error: type[OmnimirrorError] = OmnimirrorError,
    absent: str | None = None,
) -> str:
    """Read the text of an ordinary file in UTF-8, with or without a byte order mark.

    Parameters
    ----------
    path
    noun
        Kind of file, for messages: "sensor file".
    error
        Class of the exception raised if the file cannot be read.
    absent
        Message if the file does not exist, in place of that of the operating system.

    Raises
    ------
    OmnimirrorError
        If the file does not exist, is not an ordinary file, is larger than :data:`MAX_TEXT_BYTES`,
        or is not text.
    """
    try:
        return (
            read_bytes(path, MAX_TEXT_BYTES)
            .decode("utf-8-sig")
            .replace("\r\n", "\n")
            .replace("\r", "\n")
        )
    except FileNotFoundError as e:
        raise error(absent or f"cannot read the {noun} {path}: {e.strerror}") from None
    except OSError as e:
        raise error(f"cannot read the {noun} {path}: {e.strerror or e}") from None
    except UnicodeDecodeError:
        raise error(f"cannot read the {noun} {path}: the file must be text in UTF-8") from None


def _check_ordinary(status: os.stat_result, max_bytes: int | None) -> None:
    if stat.S_ISDIR(status.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it must be a file; got a folder")
    if not stat.S_ISREG(status.st_mode):
        raise OSError(errno.EINVAL, "it must be a file; got a pipe or a device")
    if max_bytes is not None and status.st_size > max_bytes:
        raise OSError(errno.EFBIG, f"the file must be {_size_limit(max_bytes, status.st_size)}")


def _size_limit(max_bytes: int, size: int | None = None) -> str:
    """Format limit, actual size and remedy for messages.

    >>> _size_limit(64 << 20, 100 << 20), _size_limit(1000)
    ('at most 64 MB; got 100 MB; reduce or split it', 'at most 1000 bytes; reduce or split it')
    """
    unit, name = (1 << 20, "MB") if max_bytes >= 1 << 20 else (1, "bytes")
    size_text = "" if size is None else f"; got {-(-size // unit)} {name}"
    return f"at most {max_bytes // unit} {name}{size_text}; reduce or split it"


# -- Parsing --------------------------------------------------------------------------------------


GZIP_MAGIC = b"\x1f\x8b"
MAX_GZIP_STREAMS = 1000
"""Maximum number of consecutive gzip streams; the time is quadratic in their number."""


def decompress(data: bytes, max_bytes: int) -> bytes:
    """Decompress a zlib stream, or all consecutive gzip streams, to at most ``max_bytes`` bytes.

    >>> decompress(zlib.compress(bytes(5)), 5)
    b'\\x00\\x00\\x00\\x00\\x00'

    Raises
    ------
    ValueError
        If a stream is damaged or truncated, or the content exceeds a limit.
    """
    content = b""
    for _ in range(MAX_GZIP_STREAMS):
        stream = zlib.decompressobj(zlib.MAX_WBITS | 32)  # 32: detect zlib or gzip from the header
        try:
            content += stream.decompress(data, max_bytes + 1 - len(content))
        except zlib.error as e:
            raise ValueError(f"damaged data: {e}") from None
        if len(content) > max_bytes:
            raise ValueError(f"the content must be {_size_limit(max_bytes)}")
        if not stream.eof:
            raise ValueError("truncated data")
        data = stream.unused_data
        if not data.startswith(GZIP_MAGIC):
            return content
    raise ValueError(f"the content must have at most {MAX_GZIP_STREAMS} gzip streams")


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text.

    >>> parse_json("[" * 100_000)
    Traceback (most recent call last):
    ValueError: tables and lists must be nested at most 32 levels deep

    Raises
    ------
    ValueError
        If the text is not valid JSON, contains a name twice in an object or an integer of thousands
        of digits, or is nested too deeply.
    """
    try:
        data = json.loads(text, object_pairs_hook=_unique_names)
    except RecursionError:
        raise ValueError(NESTING_MESSAGE) from None
    except ValueError as problem:
        if DIGITS_LIMIT in str(problem):
            raise ValueError(INTEGER_MESSAGE) from None
        raise
    for _ in _levels(data):
        pass
    return data


def _unique_names(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return the object of name and value pairs; the last of equal names would replace the others."""
    table = dict(pairs)
    if len(table) < len(pairs):
        names = [name for name, _ in pairs]
        repeated = next(name for name in names if names.count(name) > 1)
        raise ValueError(f"{repeated[:80]} must not occur twice in a table")
    return table


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises
    ------
    SpecError
        If the text is not valid TOML, is larger than :data:`MAX_TOML_CHARACTERS`, is nested too
        deeply, or contains an integer beyond 64 bits; the message starts with the source.
    """
    source = abbreviate(source)
    if len(text) > MAX_TOML_CHARACTERS:
        raise SpecError(
            f"{source} must be {_size_limit(MAX_TOML_CHARACTERS, len(text))}; store tables of numbers as CSV"
        )
    if DEEP_KEY.search(text):  # tomllib takes time quadratic in the depth of such a key
        raise SpecError(f"{source}: {NESTING_MESSAGE}")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as e:
        raise SpecError(f"{source} must be valid TOML: {e}") from None
    except RecursionError:
        raise SpecError(f"{source}: {NESTING_MESSAGE}") from None
    except ValueError:  # integer of thousands of digits
        raise SpecError(f"{source}: {INTEGER_MESSAGE}") from None
    try:
        for values in _levels(data):
            if any(isinstance(v, int) and not -(2**63) <= v < 2**63 for v in values):
                raise SpecError(f"{source}: {INTEGER_MESSAGE}")
    except SpecError:
        raise
    except ValueError as e:
        raise SpecError(f"{source}: {e}") from None
    return data


def compose_yaml(text: str, source: str) -> Any:
    """Compose the node tree of a YAML text with PyYAML; None for an empty document.

    The events are checked before the tree is built: aliases allow a few lines to expand to
    gigabytes, and the depth of the tree is the recursion depth.

    Raises
    ------
    SpecError
        If the text is not valid YAML, uses aliases, or exceeds :data:`MAX_YAML_CHARACTERS`,
        :data:`MAX_YAML_NODES` or :data:`MAX_NESTING`; the message starts with the source.
    """
    import yaml

    source = abbreviate(source)
    if len(text) > MAX_YAML_CHARACTERS:
        raise SpecError(f"{source} must be {_size_limit(MAX_YAML_CHARACTERS, len(text))}")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = nodes = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.AliasEvent):
                raise SpecError(
                    f"{source} line {line}: aliases (*{event.anchor}) are not supported; repeat the value"
                )
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(
                event, yaml.CollectionEndEvent
            )
            nodes += isinstance(event, yaml.NodeEvent)
            if depth > MAX_NESTING:
                raise SpecError(f"{source} line {line}: {NESTING_MESSAGE}")
            if nodes > MAX_YAML_NODES:
                raise SpecError(
                    f"{source} must contain at most {MAX_YAML_NODES} values; got more up to line {line}"
                )
        return yaml.compose(text, Loader=loader)
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        last = text.count("\n") + 1
        location = f" line {min(mark.line + 1, last)}" if mark else ""
        raise SpecError(
            f"{source}{location} must be valid YAML: {problem.problem or problem.context}"
        ) from None
    except yaml.YAMLError as problem:
        raise SpecError(f"{source} must be valid YAML: {' '.join(str(problem).split())}") from None


def parse_xml(text: str, source: str) -> Any:
    """Parse an XML text into the root of an ``xml.etree`` tree.

    Entities are rejected, since a few lines of them can expand to gigabytes.

    Raises
    ------
    SpecError
        If the text is not valid XML, declares a document type, or exceeds
        :data:`MAX_YAML_CHARACTERS` or :data:`MAX_NESTING`; the message starts with the source.
    """
    from xml.etree import ElementTree

    source = abbreviate(source)
    if len(text) > MAX_YAML_CHARACTERS:
        raise SpecError(f"{source} must be {_size_limit(MAX_YAML_CHARACTERS, len(text))}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise SpecError(
            f"{source} must not declare a document type or entities; remove <!DOCTYPE ...>"
        )
    parser: Any = ElementTree.XMLPullParser(("start", "end"))
    depth = 0
    root = None
    try:
        # read_events() raises errors of feed(); after close() the line number would be wrong.
        for step in (lambda: parser.feed(text), parser.close):
            step()
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                if depth > MAX_NESTING:
                    raise SpecError(f"{source}: {NESTING_MESSAGE}")
    except ElementTree.ParseError as problem:
        line = min(problem.position[0], text.rstrip("\n").count("\n") + 1)  # may exceed the text
        raise SpecError(
            f"{source} line {line} must be valid XML: {str(problem).partition(':')[0]}"
        ) from None
    except ValueError as problem:  # null character, surrogate
        if isinstance(problem, SpecError):
            raise
        raise SpecError(f"{source} must be valid XML: {problem}") from None
    return root


def _levels(data: Any) -> Iterator[list[Any]]:
    """Yield the values of nested tables and lists level by level.

    Raises
    ------
    ValueError
        If the nesting of tables and lists exceeds :data:`MAX_NESTING`.
    """
    level = [data]
    for _ in range(MAX_NESTING + 1):
        yield level
        containers = [value for value in level if isinstance(value, dict | list)]
        level = [
            v
            for value in containers
            for v in (value.values() if isinstance(value, dict) else value)
        ]
        if not containers:
            return
    raise ValueError(NESTING_MESSAGE)


def read_tables(
    path: Path, singular: str, plural: str, max_tables: int
) -> dict[str, dict[str, Any]]:
    """Read the tables of a TOML file that contains one table for each of several objects, by name.

    Parameters
    ----------
    path
    singular, plural
        Names of the objects, for messages: "view", "views".
    max_tables
        Maximum number of tables.

    Raises
    ------
    SpecError
        If the file does not exist or has other content.
    """
    absent = f"path must be an existing file of {plural}; got {str(path)!r}"
    tables = parse_toml(read_text(path, plural, SpecError, absent), str(path))
    if not 1 <= len(tables) <= max_tables:
        raise SpecError(f"{path} must contain 1 to {max_tables} {plural}; got {len(tables)}")
    for name, table in tables.items():
        if not isinstance(table, dict):
            raise SpecError(
                f"{path}: the {singular} {name} must be a table [{name}]; got {abbreviate(repr(table))}"
            )
    return tables
