"""Files: complete or untouched outputs, and readers with limits of size, nesting and time for all inputs."""

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

from .errors import OmnimirrorError, SpecError, shortened
from .escaping import json_text

if sys.platform != "win32":  # there, what killed runs leave behind stays
    import fcntl

LARGEST_TEXT = 64 << 20
"""Bytes of a table, a sensor file or the like; a million points of a measured profile are half of it."""
SMALLEST_BUFFER = 1 << 20
LARGEST_TOML = 4 << 20
"""Characters of a TOML file, which are parsed in seconds; 200,000 numbers have room."""
LARGEST_YAML = 4 << 20
MOST_YAML_NODES = 100_000
"""Values and containers of a YAML file; PyYAML builds some 100,000 a second."""
MOST_NESTED = 32
"""Levels of tables and lists in a TOML, JSON or YAML file."""
TOO_DEEP = f"it must not be nested more than {MOST_NESTED} levels deep"
DEEP_KEY = re.compile(
    r"""(?:^[ \t]*\[{0,2}|[{,])[ \t]*(?:(?:[\w-]+|"[^"\n]*"|'[^'\n]*')[ \t]*\.[ \t]*)"""
    rf"{{{MOST_NESTED}}}", re.M
)  # fmt: skip
"""A dotted key of a TOML file that makes too many tables."""
NONBLOCKING = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0) | getattr(os, "O_CLOEXEC", 0)
MARK = ".omnimirror-"
"""In the name of every temporary file beside an output, so that the next run knows it for one of ours."""


# -- writing -----------------------------------------------------------------------------------------


def is_standard_output(path: str | Path) -> bool:
    """Whether a name stands for standard output: ``-``, or ``-.png`` where the suffix tells the format.

    >>> is_standard_output("-"), is_standard_output("-.png"), is_standard_output("./a/-")
    (True, True, False)
    """
    path = Path(path)
    return path.stem == "-" and path.name == str(path)


@contextmanager
def replacing(path: str | Path, rescue: Callable[[Path], Path | None] | None = None) -> Iterator[Path]:
    """A temporary name that takes the place of ``path`` when the block ends without an error.

    It stands beside ``path`` and keeps the suffix, which picture writers look at. Missing folders are made.
    A symbolic link stays, and the file that it leads to is replaced; a file that is replaced keeps its
    permissions. What cannot be replaced is written through once the block has ended: standard output
    (:func:`is_standard_output`), a pipe, a device such as ``/dev/null``.

    What killed runs left behind of the same output is removed, unless ``rescue``, which is asked about each of these
    files, gives a name that it shall have.

    Raises
    ------
    OmnimirrorError
        The folder cannot be written, or the disk is full; an earlier file at ``path`` is left as it was.
    """
    if not isinstance(path, str | Path) or "\0" in str(path):
        raise OmnimirrorError(f"{shortened(repr(path))} is not the name of a file")
    path = Path(path)
    try:
        if is_stream(path):
            with _through(path) as temporary:
                yield temporary
        else:
            with _in_place_of(path, rescue) as temporary:
                yield temporary
    except BrokenPipeError as e:
        if is_standard_output(path):  # its reader (head, less) has seen enough
            raise
        raise OmnimirrorError(f"cannot write {name_of(path)}: {e.strerror}") from None
    except OSError as e:
        raise OmnimirrorError(f"cannot write {name_of(path)}: {e.strerror or e}") from None


def write_text(path: str | Path, text: str) -> None:
    """Write a text file whole, or leave an earlier one as it was."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


def write_json(path: str | Path, data: Any) -> None:
    """Write data as JSON, made fit for it by :func:`json_plain`, at once or not at all."""
    write_text(path, json_text(json_plain(data), indent=1, allow_nan=False) + "\n")


def json_plain(value: Any) -> Any:
    """The same data as JSON can hold it: tuples and arrays as lists, infinity as a word, and nothing where a number is
    not known.

    >>> json_plain({"object_distance_mm": (600.0, float("inf")), "focus_mm": float("nan")})
    {'object_distance_mm': [600.0, 'inf'], 'focus_mm': None}
    """
    if isinstance(value, dict):
        return {k: json_plain(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # of NumPy, which this file does without
        return json_plain(value.tolist())
    if isinstance(value, list | tuple):
        return [json_plain(v) for v in value]
    if not isinstance(value, float) or math.isfinite(value):
        return value
    return None if math.isnan(value) else str(value)


def is_stream(path: str | Path) -> bool:
    """Whether what is written to a name flows away: standard output, a pipe, a device.

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
        raise OSError(errno.EINVAL, "its name holds a null character") from None
    return not (stat.S_ISREG(mode) or stat.S_ISDIR(mode))


def is_same_file(a: str | Path, b: str | Path) -> bool:
    """Whether two names lead to one file, there or not; links that lead in a circle lead nowhere, and to themselves.

    >>> is_same_file("a.png", "./b/../a.png")
    True
    """
    return os.path.realpath(a) == os.path.realpath(b)


def name_of(path: str | Path) -> str:
    """A file's name as people read it."""
    return "standard output" if is_standard_output(path) else str(path)


@contextmanager
def _in_place_of(path: Path, rescue: Callable[[Path], Path | None] | None) -> Iterator[Path]:
    target = Path(os.path.realpath(path)) if path.is_symlink() else path
    target.parent.mkdir(parents=True, exist_ok=True)
    if target.is_dir():
        raise IsADirectoryError(errno.EISDIR, "it is a folder, and a file name is needed")
    _remove_leftovers(target, rescue or (lambda leftover: None))
    temporary = target.with_name(f"{_prefix(target)}{os.urandom(4).hex()}{target.suffix}")
    handle = None
    try:  # from before it is there: a signal may come at any moment, and is raised as an exception
        handle = _made_and_locked(temporary)
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
def _through(path: Path) -> Iterator[Path]:
    """A file of its own, which writers may seek in; it is copied into the stream at the end."""
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        temporary = Path(folder) / f"output{path.suffix}"
        yield temporary
        with temporary.open("rb") as source, _stream(path) as sink:
            shutil.copyfileobj(source, sink)


@contextmanager
def _stream(path: Path) -> Iterator[BinaryIO]:
    """What takes the bytes; a descriptor of this process goes on where it stands, and is not emptied first."""
    number = 1 if is_standard_output(path) else _descriptor_of(path)
    if number is None:
        if stat.S_ISBLK(os.stat(path).st_mode):
            raise OSError(errno.EINVAL, "it is a disk, and a file name is needed")
        with open(os.open(path, os.O_WRONLY), "wb") as sink:
            yield sink
        return
    for stream in (sys.stdout, sys.stderr):  # what was said before comes before
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
    """The number of an open descriptor of this process that a name stands for: ``/dev/stdout``, ``/dev/fd/3``."""
    name = os.fspath(path)
    for _ in range(8):
        if match := re.fullmatch(r"/(?:dev|proc/(?:self|\d+))/fd/(\d{1,9})", name):
            is_ours = name.startswith(("/dev/", "/proc/self/", f"/proc/{os.getpid()}/"))
            return int(match[1]) if is_ours else None
        try:
            name = os.path.join(os.path.dirname(name), os.readlink(name))
        except OSError:
            return None
    return None


def _permissions(target: Path) -> int:
    """Those of the file that is replaced, or of any new one."""
    try:
        return stat.S_IMODE(os.stat(target).st_mode)
    except OSError:
        return 0o666 & ~_umask()


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def _prefix(target: Path) -> str:
    """How temporary names of one output begin: short, and plain enough for every library that writes to them."""
    return f".{target.stem.encode('ascii', 'ignore').decode()[:60]}{MARK}"


def _made_and_locked(temporary: Path) -> int | None:
    """Make a file that only its owner reads; it is locked for as long as the handle is open."""
    while True:
        handle = os.open(temporary, os.O_RDWR | os.O_CREAT | os.O_EXCL, 0o600)
        if sys.platform == "win32":  # where a file that is open cannot be renamed
            os.close(handle)
            return None
        with suppress(OSError):  # a file system without locks: see _remove_leftovers
            fcntl.flock(handle, fcntl.LOCK_EX)
        if os.path.exists(temporary):
            return handle
        os.close(handle)  # another run took it for a leftover before it was locked


def _remove_leftovers(target: Path, rescue: Callable[[Path], Path | None]) -> None:
    """Remove or rename temporary files of this output whose run is gone: nobody holds their lock any more."""
    if sys.platform == "win32":
        return
    pattern = re.compile(re.escape(_prefix(target)) + r"[a-z0-9_]{8}" + re.escape(target.suffix))
    with os.scandir(target.parent) as entries:
        names = [entry.path for entry in entries if pattern.fullmatch(entry.name)]
    for name in names:
        with suppress(OSError):
            handle = os.open(name, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
            try:
                found = os.fstat(handle)
                if stat.S_ISREG(found.st_mode) and found.st_uid == os.geteuid():
                    fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
                    if rescued := rescue(Path(name)):
                        os.chmod(name, _permissions(rescued))
                        os.rename(name, rescued)
                    else:
                        os.unlink(name)
            finally:
                os.close(handle)


# -- reading -----------------------------------------------------------------------------------------


def open_file(path: str | Path, most: int | None = None) -> BinaryIO:
    """Open an ordinary file for reading in binary mode.

    A FIFO would block the reader and a device may never end: both are rejected, before and after the file is opened.

    Parameters
    ----------
    path
    most
        Maximum size in bytes; None for files that are read piece by piece.

    Raises
    ------
    OSError
        The file does not exist, is not an ordinary file, or is too large; ``strerror`` gives the reason.
    """
    try:
        _check_ordinary(os.stat(path), most)
    except ValueError:  # a null character in the name
        raise OSError(errno.EINVAL, "no file can have that name") from None
    file = open(os.open(path, os.O_RDONLY | NONBLOCKING), "rb")  # noqa: SIM115
    try:
        _check_ordinary(os.fstat(file.fileno()), most)  # the name may lead to another file by now
    except BaseException:
        file.close()
        raise
    return file


def check_file(path: str | Path, most: int | None = None, most_unpacked: int | None = None) -> None:
    """Check a file that a library opens by its name: its kind, its size, and the declared size of a ZIP archive.

    Parameters
    ----------
    path
    most
        Maximum size in bytes.
    most_unpacked
        Maximum size in bytes of all members of an archive together; ``zipfile`` reads no more than is declared.

    Raises
    ------
    OSError
        As :func:`open_file`, or the members are too large; ``strerror`` gives the reason.
    """
    with open_file(path, most) as file:
        if most_unpacked is None or not zipfile.is_zipfile(file):
            return
        try:
            with zipfile.ZipFile(file) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
        except (zipfile.BadZipFile, NotImplementedError, ValueError) as e:
            raise OSError(errno.EINVAL, f"it is a damaged archive ({e})") from None
        if unpacked > most_unpacked:
            raise OSError(errno.EFBIG, f"its content must not be {_larger(most_unpacked, unpacked)}")


def read_bytes(path: str | Path, most: int) -> bytes:
    """Read an ordinary file of at most ``most`` bytes.

    Raises
    ------
    OSError
        As :func:`open_file`; ``strerror`` gives the reason.
    """
    with open_file(path, most) as file:
        # files generated while they are read, as in /proc, have a nominal size of 0
        room = min(most, max(os.fstat(file.fileno()).st_size, SMALLEST_BUFFER))
        data = file.read(room + 1)
    if len(data) > room:
        raise OSError(errno.EFBIG, f"it must not be {_larger(room)}")
    return data


def read_text(
    path: str | Path, noun: str, error: type[OmnimirrorError] = OmnimirrorError, absent: str | None = None
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
        The file does not exist, is not an ordinary file, is larger than :data:`LARGEST_TEXT`, or is not text.
    """
    try:
        return read_bytes(path, LARGEST_TEXT).decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except FileNotFoundError as e:
        raise error(absent or f"cannot read the {noun} {path}: {e.strerror}") from None
    except OSError as e:
        raise error(f"cannot read the {noun} {path}: {e.strerror or e}") from None
    except UnicodeDecodeError:
        raise error(f"cannot read the {noun} {path}: it is not a text file") from None


def _check_ordinary(found: os.stat_result, most: int | None) -> None:
    if stat.S_ISDIR(found.st_mode):
        raise IsADirectoryError(errno.EISDIR, "it is a folder")
    if not stat.S_ISREG(found.st_mode):
        raise OSError(errno.EINVAL, "it is a pipe or a device, and a file is needed")
    if most is not None and found.st_size > most:
        raise OSError(errno.EFBIG, f"it must not be {_larger(most, found.st_size)}")


def _larger(most: int, size: int | None = None) -> str:
    """Limit, actual size and remedy, for messages.

    >>> _larger(64 << 20, 100 << 20), _larger(1000)
    ('larger than 64 MB; got 100 MB; reduce or split it', 'larger than 1000 bytes; reduce or split it')
    """
    unit, name = (1 << 20, "MB") if most >= 1 << 20 else (1, "bytes")
    got = "" if size is None else f"; got {-(-size // unit)} {name}"
    return f"larger than {most // unit} {name}{got}; reduce or split it"


# -- parsing -----------------------------------------------------------------------------------------


def decompressed(data: bytes, most: int) -> bytes:
    """Decompress a zlib or gzip stream to at most ``most`` bytes.

    >>> decompressed(zlib.compress(bytes(5)), 5)
    b'\\x00\\x00\\x00\\x00\\x00'

    Raises
    ------
    ValueError
        The stream is damaged or cut short, or holds more.
    """
    stream = zlib.decompressobj(zlib.MAX_WBITS | 32)  # 32: the header tells zlib from gzip
    try:
        content = stream.decompress(data, most + 1)
    except zlib.error as e:
        raise ValueError(f"it is damaged: {e}") from None
    if len(content) > most:
        raise ValueError(f"its content must not be {_larger(most)}")
    if not stream.eof:
        raise ValueError("it is cut short")
    return content


def parse_json(text: str | bytes) -> Any:
    """Parse a JSON text.

    >>> parse_json("[" * 100_000)
    Traceback (most recent call last):
    ValueError: it must not be nested more than 32 levels deep

    Raises
    ------
    ValueError
        It is not valid JSON, or is nested too deeply.
    """
    try:
        data = json.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    for _ in _levels(data):
        pass
    return data


def parse_toml(text: str, source: str) -> dict[str, Any]:
    """Parse a TOML text.

    Raises
    ------
    SpecError
        It is not valid TOML, is larger than :data:`LARGEST_TOML`, is nested too deeply, or holds an integer beyond
        64 bits; the message begins with the source.
    """
    source = shortened(source)
    if len(text) > LARGEST_TOML:
        raise SpecError(f"{source} must not be {_larger(LARGEST_TOML, len(text))}; tables of numbers belong into CSV")
    if DEEP_KEY.search(text):  # which tomllib reads in a time that grows with the square of the depth
        raise SpecError(f"{source}: {TOO_DEEP}")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as e:
        raise SpecError(f"{source} is not valid TOML: {e}") from None
    except RecursionError:
        raise SpecError(f"{source}: {TOO_DEEP}") from None
    except ValueError:  # an integer of thousands of digits
        raise SpecError(f"{source} holds a whole number of more than 64 bits") from None
    try:
        for values in _levels(data):
            if any(isinstance(v, int) and not -(2**63) <= v < 2**63 for v in values):
                raise SpecError(f"{source} holds a whole number of more than 64 bits")
    except SpecError:
        raise
    except ValueError as e:
        raise SpecError(f"{source}: {e}") from None
    return data


def compose_yaml(text: str, source: str) -> Any:
    """Compose the tree of PyYAML's nodes of a YAML text; None for an empty document.

    The events are checked before the tree is built: an alias repeats what it refers to, so that a few lines can stand
    for gigabytes, and the depth of the tree is the depth of a recursion.

    Raises
    ------
    SpecError
        It is not valid YAML, uses aliases, or exceeds :data:`LARGEST_YAML`, :data:`MOST_YAML_NODES` or
        :data:`MOST_NESTED`; the message begins with the source.
    """
    import yaml

    source = shortened(source)
    if len(text) > LARGEST_YAML:
        raise SpecError(f"{source} must not be {_larger(LARGEST_YAML, len(text))}")
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = nodes = 0
    try:
        for event in yaml.parse(text, Loader=loader):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.AliasEvent):
                raise SpecError(f"{source} line {line}: references (*{event.anchor}) are not read; write the value out")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            nodes += isinstance(event, yaml.NodeEvent)
            if depth > MOST_NESTED:
                raise SpecError(f"{source} line {line}: {TOO_DEEP}")
            if nodes > MOST_YAML_NODES:
                raise SpecError(
                    f"{source} must not hold more than {MOST_YAML_NODES} values; got more up to line {line}"
                )
        return yaml.compose(text, Loader=loader)
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        last = text.count("\n") + 1
        where = f" line {min(mark.line + 1, last)}" if mark else ""
        raise SpecError(f"{source}{where} is not valid YAML: {problem.problem or problem.context}") from None
    except yaml.YAMLError as problem:
        raise SpecError(f"{source} is not valid YAML: {' '.join(str(problem).split())[:120]}") from None


def parse_xml(text: str, source: str) -> Any:
    """Parse an XML text into the root of an ``xml.etree`` tree.

    Entities are rejected, since a few lines of them can stand for gigabytes.

    Raises
    ------
    SpecError
        It is not valid XML, declares a document type, or exceeds :data:`LARGEST_YAML` or :data:`MOST_NESTED`; the
        message begins with the source.
    """
    from xml.etree import ElementTree

    source = shortened(source)
    if len(text) > LARGEST_YAML:
        raise SpecError(f"{source} must not be {_larger(LARGEST_YAML, len(text))}")
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise SpecError(f"{source} must not declare a document type or entities; remove <!DOCTYPE ...>")
    parser: Any = ElementTree.XMLPullParser(("start", "end"))
    depth = 0
    root = None
    try:
        # An error of feed() is raised by read_events(); after close() it would have a wrong line number.
        for step in (lambda: parser.feed(text), parser.close):
            step()
            for event, element in parser.read_events():
                root = element if root is None else root
                depth += 1 if event == "start" else -1
                if depth > MOST_NESTED:
                    raise SpecError(f"{source}: {TOO_DEEP}")
    except ElementTree.ParseError as problem:
        line = min(problem.position[0], text.rstrip("\n").count("\n") + 1)  # expat may count past the end
        raise SpecError(f"{source} line {line} is not valid XML: {str(problem).partition(':')[0]}") from None
    except ValueError as problem:  # a null character, a surrogate
        if isinstance(problem, SpecError):
            raise
        raise SpecError(f"{source} is not valid XML: {problem}") from None
    return root


def _levels(data: Any) -> Iterator[list[Any]]:
    """Yield the values of nested tables and lists level by level.

    Raises
    ------
    ValueError
        More than :data:`MOST_NESTED` tables and lists contain each other.
    """
    level = [data]
    for _ in range(MOST_NESTED + 1):
        yield level
        containers = [value for value in level if isinstance(value, dict | list)]
        level = [v for value in containers for v in (value.values() if isinstance(value, dict) else value)]
        if not containers:
            return
    raise ValueError(TOO_DEEP)


def read_tables(path: Path, each: str, all_of_them: str, most: int) -> dict[str, dict[str, Any]]:
    """The tables of a TOML file that holds one for each of several things, by their names.

    Parameters
    ----------
    path
    each, all_of_them
        What a table tells of, for messages: "view", "views".
    most
        How many there may be.

    Raises
    ------
    SpecError
        There is no such file, or it holds something else.
    """
    absent = f"there are no {all_of_them} {str(path)!r}"
    tables = parse_toml(read_text(path, all_of_them, SpecError, absent), str(path))
    if not 1 <= len(tables) <= most:
        raise SpecError(f"{path} holds {len(tables)} {all_of_them}; it is valid with 1 to {most}")
    for name, table in tables.items():
        if not isinstance(table, dict):
            found = shortened(repr(table))
            raise SpecError(f"{path}: {name} = {found} is no {each}; valid are tables such as [{name}]")
    return tables
