"""Export formats: declaration, selection and atomic writing of files for other programs.

An :class:`ExportFormat` writes one object (a ray table or a view map) as one or several files and
states the deviation of the result. :func:`write_formats` writes all requested formats or none.
"""

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

from ..base.arguments import InvalidType, file_name, format_value
from ..base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from ..base.escaping import c_comment, escape_invisible, file_stem, line_comment, python_docstring
from ..base.files import atomic_output, is_stream
from ..base.registry import Registry
from ..base.results import Columns, Result, table_of

T = TypeVar("T")
Unit: TypeAlias = Literal["px", "deg"]

# -- declaration of a format ---------------------------------------------------------------------


@dataclass(frozen=True)
class Deviation:
    """Maximum deviation of an export from the internal representation.

    Attributes
    ----------
    size
        Magnitude in ``unit``; 0 if only rounding to 32-bit floats is lost.
    unit
        ``"px"`` or ``"deg"``.
    reason
        Cause of the deviation; empty if ``size`` is 0.
    """

    size: float = 0.0
    unit: Unit = "px"
    reason: str = ""

    def __str__(self) -> str:
        return f"{self.size:.2g} {self.unit}: {self.reason}" if self.size else "exact"


@dataclass(frozen=True)
class ExportedFiles(Result):
    """Files written in one export format.

    Attributes
    ----------
    paths
        Written files.
    description
        Summary of the contents.
    deviation
        Maximum deviation of the export.
    """

    paths: tuple[Path, ...]
    description: str
    deviation: Deviation

    def _table(self) -> Columns:
        common = {"description": self.description, "deviation": str(self.deviation)}
        return table_of({"path": path, **common} for path in self.paths)


@dataclass(frozen=True)
class ExportFormat(Generic[T]):
    """Export of an object to the file format of another program.

    Attributes
    ----------
    write
        Writes the object to the given files, one per entry of ``endings``, and returns a
        description and the deviation. Files may refer to each other by name; they are always
        written to the same folder.
    endings
        Ending of each file, appended to the common stem.
    program
        Programs that read the format.
    packages
        Python packages required for writing.
    """

    write: Callable[[T, tuple[Path, ...]], tuple[str, Deviation]]
    endings: tuple[str, ...]
    program: str
    packages: tuple[str, ...] = ()

    @property
    def suffix(self) -> str:
        """Suffix of the first file, such as ``".exr"``."""
        return Path(f"a{self.endings[0]}").suffix


ExportFormats: TypeAlias = Registry[ExportFormat[T]]


def format_registry(group: str, kind: str, builtin: dict[str, ExportFormat[T]]) -> ExportFormats[T]:
    """Return a registry of export formats that other packages extend through entry points.

    Parameters
    ----------
    group
        Entry-point group, such as ``"omnimirror.map_formats"``.
    kind
        Noun phrase for error messages, such as ``"a format of ray tables"``.
    builtin
        Formats of this package by name.

    Examples
    --------
    >>> plain = ExportFormat(lambda thing, paths: ("text", Deviation()), (".txt",), "an editor")
    >>> list(format_registry("omnimirror.docs", "a format", {"plain": plain}))
    ['plain']
    """

    def check(name: str, value: Any) -> None:
        if not isinstance(value, ExportFormat):
            raise InvalidType(
                f"{name} must be an omnimirror.interop.export_formats.ExportFormat; got {format_value(value)}"
            )

    return Registry(group, kind, builtin, check)


# -- writing -------------------------------------------------------------------------------------


def write_formats(
    value: T,
    registry: ExportFormats[T],
    name: str,
    path: str | Path,
    formats: Iterable[str] | str | None,
) -> list[ExportedFiles]:
    """Write an object in one or several export formats: all files or none.

    Parameters
    ----------
    value
        Object to write, such as a ray table.
    registry
        Available formats.
    name
        Stem of the files in a folder.
    path
        Folder, or a file whose suffix selects the format unless ``formats`` does. For a format of
        several files, the stem of ``path`` is common to all of them.
    formats
        Names of formats; required for a folder.

    Returns
    -------
    list of ExportedFiles
        One entry per format.

    Raises
    ------
    InvalidParameter
        If a format is unknown, several formats are requested for one file, or the suffix belongs
        to another format.
    OmnimirrorError
        If a required package is missing or a file cannot be written.
    """
    path = file_name("path", path)
    targets = _targets(registry, name, path, _requested_formats(formats, registry))
    _check_packages({kind: registry[kind].packages for kind in targets})
    with TemporaryDirectory() as folder, ExitStack() as stack:
        exported = []
        for number, (kind, paths) in enumerate(targets.items()):
            temporary = tuple(Path(folder, str(number), p.name) for p in paths)
            temporary[0].parent.mkdir()
            description, deviation = registry[kind].write(value, temporary)
            exported.append(ExportedFiles(paths, description, deviation))
        for number, paths in enumerate(targets.values()):
            for target in paths:
                source = Path(folder, str(number), target.name)
                copyfile(source, stack.enter_context(atomic_output(target)))
    return exported


def _requested_formats(
    formats: Iterable[str] | str | None, registry: ExportFormats[T]
) -> list[str] | None:
    """Return the requested formats without duplicates; None if the suffix selects the format."""
    if formats is None:
        return None
    valid = ", ".join(registry)
    if not isinstance(formats, Iterable):
        raise InvalidType(
            f"formats must be a list of names from {valid}; got {format_value(formats)}"
        )
    names = list(dict.fromkeys([formats] if isinstance(formats, str) else formats))
    for name in names:
        if not isinstance(name, str) or name not in registry:
            raise InvalidParameter(f"formats must be from {valid}; got {format_value(name)}")
    if not names:
        raise InvalidParameter(f"formats must contain at least one of {valid}; got none")
    return names


def _targets(
    registry: ExportFormats[T], name: str, path: Path, names: list[str] | None
) -> dict[str, tuple[Path, ...]]:
    """Return the files to write by format."""
    if path.suffix and not path.is_dir():
        kind = _format_of_file(registry, path, names)
        endings = registry[kind].endings
        if len(endings) == 1:
            return {kind: (path,)}
        if is_stream(path):
            raise InvalidParameter(
                f"{kind} consists of {len(endings)} files and cannot be written to the stream "
                f"{path}; specify a file or a folder"
            )
        return {kind: tuple(path.with_name(path.stem + ending) for ending in endings)}
    if names is None:
        raise InvalidParameter(
            f"formats must be given for the folder {path}; choose from {', '.join(registry)}"
        )
    stem = file_stem(name, "camera")
    return {
        kind: tuple(path / f"{stem}-{kind}{ending}" for ending in registry[kind].endings)
        for kind in names
    }


def _format_of_file(registry: ExportFormats[T], path: Path, names: list[str] | None) -> str:
    """Return the requested format of one file, or the first format with its suffix."""
    suffix = path.suffix.lower()
    if names is None:
        names = [kind for kind, f in registry.items() if f.suffix == suffix][:1]
        if not names:
            valid = ", ".join(dict.fromkeys(f.suffix for f in registry.values()))
            raise InvalidParameter(
                f"the suffix of {path.name} must be one of {valid}; alternatively specify a folder and --format"
            )
    if len(names) > 1:
        raise InvalidParameter(
            f"{path.name} is a single file and cannot contain {', '.join(names)}; specify a folder"
        )
    if registry[names[0]].suffix != suffix:
        raise InvalidParameter(
            f"the suffix of {names[0]} files must be {registry[names[0]].suffix}; got {path.name}"
        )
    return names[0]


def _check_packages(packages: dict[str, Collection[str]]) -> None:
    for name, required in packages.items():
        if missing := [package for package in required if find_spec(package) is None]:
            raise OmnimirrorError(
                f"{name} requires {', '.join(missing)}: {extra_remedy('interop')}, or choose another format"
            )


# -- templates of scripts ------------------------------------------------------------------------


class SourceCode(str):
    """Text that is already source code of the target language and needs no escaping."""


COMMENT_ESCAPES: dict[str, Callable[[str], str]] = {".py": python_docstring, ".sh": line_comment}
"""Escaping of text in comments by suffix of the script; :func:`c_comment` for other suffixes."""


def fill_template(template: str, **values: object) -> str:
    """Substitute all ``${names}`` of a file in the folder ``templates``.

    Text is escaped for a comment (in Python, for a docstring). Numbers and :class:`SourceCode`
    are inserted unchanged.

    Parameters
    ----------
    template
        File name of the template.
    **values
        Value of each placeholder.

    Examples
    --------
    >>> fill_template("view.hlsl.in", view='a\\n#error', camera="b", map_file="c", width=4,
    ...     height=3, source_width=2, source_height=1).splitlines()[0]
    '// a #error of the images of b.'
    """
    text = (Path(__file__).parent / "templates" / template).read_text(encoding="utf-8")
    escape = COMMENT_ESCAPES.get(Path(template).with_suffix("").suffix, c_comment)
    unescaped = (int, float, SourceCode)
    return Template(text).substitute(
        {k: str(v) if isinstance(v, unescaped) else escape(str(v)) for k, v in values.items()}
    )


def write_script(path: Path, text: str) -> None:
    """Write a script in UTF-8; file names that are not UTF-8 keep their bytes."""
    path.write_text(text, encoding="utf-8", errors="surrogateescape")


def include_name(path: Path) -> str:
    """Return the name of a file for a C include directive, which has no escape sequences.

    Raises
    ------
    InvalidParameter
        If the name contains a quotation mark, a backslash, ``??`` or a control character.
    """
    name = path.name
    if escape_invisible(name) != name or any(word in name for word in ('"', "\\", "??")):
        raise InvalidParameter(
            "the file name must not contain quotation marks, backslashes, '??' or control "
            f"characters for an #include directive; got {format_value(name)}"
        )
    return name
