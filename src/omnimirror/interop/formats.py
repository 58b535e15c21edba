"""What every format of another program's files is, and how its files are written: all that were asked for, or none."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from contextlib import ExitStack
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from string import Template
from tempfile import TemporaryDirectory
from typing import Any, Generic, Literal, TypeAlias, TypeVar

from ..arguments import WrongKind, file_name, shown
from ..errors import InvalidParameter, OmnimirrorError
from ..escaping import c_comment, file_stem, line_comment, python_docstring, visible
from ..files import is_stream, replacing
from ..numerics.registry import Registry

T = TypeVar("T")
Unit: TypeAlias = Literal["px", "deg"]


@dataclass(frozen=True)
class Deviation:
    """By how much at most what a program makes of its files differs from ours.

    Attributes
    ----------
    size
        0 where all that is lost is the rounding of 32-bit floats.
    unit
    why
        What takes it, in a few words; empty where nothing does.
    """

    size: float = 0.0
    unit: Unit = "px"
    why: str = ""

    def __str__(self) -> str:
        return f"{self.size:.2g} {self.unit}: {self.why}" if self.size else "exact"


@dataclass(frozen=True)
class HandedOver:
    """The files of a format that were written, what they hold, and what is lost.

    Attributes
    ----------
    paths
    what
    deviation
    """

    paths: tuple[Path, ...]
    what: str
    deviation: Deviation


@dataclass(frozen=True)
class ProgramFormat(Generic[T]):
    """How a thing is written for another program.

    Attributes
    ----------
    write
        Writes the files, whose names are those of the endings; returns in a few words what they hold, and by how much
        it deviates from ours. Files may name one another: they stay side by side.
    endings
        What is put after the name that was asked for, one for each file.
    program
        What reads them.
    packages
        What must be installed to write them.
    """

    write: Callable[[T, tuple[Path, ...]], tuple[str, Deviation]]
    endings: tuple[str, ...]
    program: str
    packages: tuple[str, ...] = ()

    @property
    def suffix(self) -> str:
        """Of its first file."""
        return Path(f"a{self.endings[0]}").suffix


Formats: TypeAlias = Registry[ProgramFormat[T]]


def registry(group: str, what: str, ours: dict[str, ProgramFormat[T]]) -> Formats[T]:
    """The formats of a kind of thing; other packages bring theirs by entry points of a group.

    >>> plain = ProgramFormat(lambda thing, paths: ("a word", Deviation()), (".txt",), "an editor")
    >>> list(registry("omnimirror.docs", "a format", {"plain": plain}))
    ['plain']
    """

    def check(name: str, kind: Any) -> None:
        if not isinstance(kind, ProgramFormat):
            raise WrongKind(f"{shown(kind)} is no omnimirror.interop.formats.ProgramFormat")

    return Registry(group, what, ours, check)


def hand_over(
    thing: T, known: Formats[T], name: str, path: str | Path, formats: Iterable[str] | str | None
) -> list[HandedOver]:
    """Write a thing for other programs.

    Parameters
    ----------
    thing
        Such as a ray table.
    known
        Its formats.
    name
        Of the files in a folder.
    path
        A folder; or a file, whose suffix says the format unless that is named. Of a format of several files, its stem
        is the name of all.
    formats
        Some of the known; needed for a folder.

    Returns
    -------
    list of HandedOver
        One for each format.

    Raises
    ------
    InvalidParameter
        A format that is not known, several in one file, or a file of another kind.
    OmnimirrorError
        A package is missing, or a file cannot be written.
    """
    path = file_name("path", path)
    names = _names(formats, known)
    targets = _targets(known, name, path, names)
    _check_packages({name: known[name].packages for name in targets})
    with TemporaryDirectory() as folder, ExitStack() as stack:
        done = []
        for number, (kind, paths) in enumerate(targets.items()):
            made = tuple(Path(folder, str(number), p.name) for p in paths)
            made[0].parent.mkdir()
            what, deviation = known[kind].write(thing, made)
            done.append(HandedOver(paths, what, deviation))
        for number, paths in enumerate(targets.values()):
            for target in paths:
                copyfile(Path(folder, str(number), target.name), stack.enter_context(replacing(target)))
    return done


def _names(formats: Iterable[str] | str | None, known: Formats[T]) -> list[str] | None:
    """The formats that are asked for, each once."""
    if formats is None:
        return None
    if not isinstance(formats, Iterable):
        raise WrongKind(f"formats = {shown(formats)} is not a list of names, of {', '.join(known)}")
    names = list(dict.fromkeys([formats] if isinstance(formats, str) else formats))
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise InvalidParameter(f"there is no format {shown(name)}; valid are {', '.join(known)}")
    if not names:
        raise InvalidParameter(f"formats is empty; it is valid with at least one of {', '.join(known)}")
    return names


def _targets(known: Formats[T], name: str, path: Path, names: list[str] | None) -> dict[str, tuple[Path, ...]]:
    """The files to write, by format."""
    if path.suffix and not path.is_dir():
        kind = _of_file(known, path, names)
        endings = known[kind].endings
        if len(endings) == 1:
            return {kind: (path,)}
        if is_stream(path):
            raise InvalidParameter(f"{kind} is {len(endings)} files, and {path} is one stream; give a file or a folder")
        return {kind: tuple(path.with_name(path.stem + ending) for ending in endings)}
    if names is None:
        raise InvalidParameter(f"{path} is a folder; say which formats go there, of {', '.join(known)}")
    stem = file_stem(name, "camera")
    return {kind: tuple(path / f"{stem}-{kind}{ending}" for ending in known[kind].endings) for kind in names}


def _of_file(known: Formats[T], path: Path, names: list[str] | None) -> str:
    """The format of one file: the one that is named, else the first of its suffix."""
    suffix = path.suffix.lower()
    if names is None:
        names = [kind for kind, f in known.items() if f.suffix == suffix][:1]
        if not names:
            valid = dict.fromkeys(f.suffix for f in known.values())
            raise InvalidParameter(
                f"{path.name} has no suffix that is known; valid are {', '.join(valid)}, or a folder and --format"
            )
    if len(names) > 1:
        raise InvalidParameter(f"{path.name} is one file, and {', '.join(names)} are several formats; give a folder")
    if known[names[0]].suffix != suffix:
        raise InvalidParameter(f"{names[0]} is written to {known[names[0]].suffix} files; {path.name} is none")
    return names[0]


def _check_packages(packages: dict[str, Collection[str]]) -> None:
    for name, needed in packages.items():
        if missing := [p for p in needed if find_spec(p) is None]:
            raise OmnimirrorError(
                f"{name} needs {', '.join(missing)}: pip install 'omnimirror[interop]', or choose another format"
            )


class Code(str):
    """Text that is source code of the target language already."""


COMMENTS: dict[str, Callable[[str], str]] = {".py": python_docstring, ".sh": line_comment}
"""Escaping of text in the comments of scripts, by the suffix of the script; :func:`c_comment` for all others."""


def filled(script: str, **values: object) -> str:
    """Fill in all ``${names}`` of a script in the folder ``scripts``.

    Text is escaped for a comment (in Python, for a docstring). Numbers and :class:`Code` are inserted unchanged.

    Examples
    --------
    >>> filled("view.hlsl.in", view='a\\n#error', camera="b", table="c", width=4, height=3, source_width=2,
    ...     source_height=1).splitlines()[0]
    '// a #error, of the pictures of b.'
    """
    text = (Path(__file__).parent / "scripts" / script).read_text(encoding="utf-8")
    escape = COMMENTS.get(Path(script).with_suffix("").suffix, c_comment)
    plain = (int, float, Code)
    return Template(text).substitute({k: str(v) if isinstance(v, plain) else escape(str(v)) for k, v in values.items()})


def write_script(path: Path, text: str) -> None:
    """Write a script in UTF-8; names of files that are not UTF-8 keep their bytes."""
    path.write_text(text, encoding="utf-8", errors="surrogateescape")


def quotable(path: Path) -> str:
    """Return the name of a file for an include directive of C, in which nothing can be escaped.

    Raises
    ------
    InvalidParameter
        The name holds a quotation mark, a backslash, ``??`` or a control character.
    """
    name = path.name
    if visible(name) != name or any(word in name for word in ('"', "\\", "??")):
        raise InvalidParameter(
            f"the file name must not contain quotation marks, backslashes, '??' or control characters for an #include "
            f"directive; got {shown(name)}"
        )
    return name
