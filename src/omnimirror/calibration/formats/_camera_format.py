"""Interface of camera file formats: parsed content, recognition, reading, writing, and camera models."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

import numpy as np

from ...base.arguments import format_value, parse_float
from ...base.caching import cached_property
from ...base.errors import SpecError
from ...base.files import (
    GZIP_MAGIC,
    MAX_TEXT_BYTES,
    compose_yaml,
    decompress,
    parse_json,
    parse_xml,
)
from ...base.toml_validation import did_you_mean
from ...base.typing import Array
from ...cameras.camera import Camera, Mount
from ...cameras.models.camera_model import Optics

# -- Parsed values ---------------------------------------------------------------------------------


@dataclass(frozen=True)
class Node:
    """Value in a file: a mapping or a list of entries, or a single word or number.

    Attributes
    ----------
    value
        Dict or list of entries, or text, number, boolean or None.
    source
        File name.
    name
        Path of the entry, such as ``cam0.intrinsics``.
    line
        Line number from 1; None if unknown.
    """

    value: Any
    source: str
    name: str = ""
    line: int | None = None

    def fail(self, message: str) -> NoReturn:
        """Raise an error at this entry."""
        location = f" line {self.line}" if self.line else ""
        raise SpecError(f"{self.source}{location}: {self.name}{' ' * bool(self.name)}{message}")

    # -- mappings ----------------------------------------------------------------------------------

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def names(self) -> list[str]:
        """Return the names in a mapping."""
        if not isinstance(self.value, dict):
            self.fail(f"must be a table of names and values; got {self._kind()}")
        return list(self.value)

    def __getitem__(self, name: str) -> Node:
        if name not in self.names():
            self.fail(f"must contain {name}{did_you_mean(name, self.value)}")
        entry: Node = self.value[name]
        return entry

    def polynomial(self, prefix: str) -> tuple[float, ...]:
        """Return the coefficients of a mapping named by their powers: p0, p1, ...; all are required."""
        named = re.compile(re.escape(prefix) + r"(0|[1-9]\d{0,2})")
        powers = [int(match[1]) for name in self.names() if (match := named.fullmatch(name))]
        return tuple(self[f"{prefix}{i}"].number() for i in range(max(powers, default=0) + 1))

    def label(self, name: str) -> str:
        """Return a name in a mapping, which has no effect on the camera; empty without one."""
        value = self[name].value if name in self else None
        return "" if isinstance(value, dict | list | None) else str(value)

    # -- values ------------------------------------------------------------------------------------

    def number(self) -> float:
        """Return a finite number."""
        value = self.value
        try:
            number = (
                np.nan if isinstance(value, bool | dict | list | None) else parse_float(str(value))
            )
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            self.fail(f"must be a finite number; got {self._kind()}")
        return number

    def integer(self) -> int:
        """Return an integer, such as a number of pixels."""
        number = self.number()
        if number != np.floor(number) or abs(number) > 2**31:
            self.fail(f"must be an integer; got {format_value(self.value)}")
        return int(number)

    def word(self) -> str:
        """Return a word."""
        if not isinstance(self.value, str):
            self.fail(f"must be a word; got {self._kind()}")
        return self.value

    def choice(self, *valid: str) -> str:
        """Return one of several words."""
        word = self.word()
        if word not in valid:
            self.fail(f"must be one of {', '.join(valid)}; got {format_value(word)}")
        return word

    def entries(self) -> list[Node]:
        """Return the entries of a list."""
        if not isinstance(self.value, list):
            self.fail(f"must be a list; got {self._kind()}")
        return self.value

    def numbers(self, *counts: int) -> tuple[float, ...]:
        """Return a list of numbers with one of the given lengths."""
        entries = self.entries()
        if counts and len(entries) not in counts:
            valid = " or ".join(map(str, counts))
            self.fail(f"must have {valid} numbers; got {len(entries)}")
        return tuple(entry.number() for entry in entries)

    def matrix(self, rows: int, columns: int) -> Array:
        """Return a matrix from nested lists, a list of all numbers by row, or ``data`` of both kinds
        with ``rows`` and ``cols``.
        """
        if "data" in self:
            matrix = self["data"].matrix(rows, columns)
            for name, valid in (("rows", rows), ("cols", columns)):
                if name in self and self[name].integer() != valid:
                    self[name].fail(f"must be {valid}; got {self[name].integer()}")
            return matrix
        if not any(isinstance(entry.value, list) for entry in self.entries()):
            return np.array(self.numbers(rows * columns)).reshape(rows, columns)
        if len(self.entries()) != rows:
            self.fail(f"must have {rows} rows of {columns} numbers; got {len(self.entries())} rows")
        return np.array([row.numbers(columns) for row in self.entries()])

    def row(self, *counts: int) -> tuple[float, ...]:
        """Return a row of numbers, from a list or a matrix with one row or column."""
        return self.flat().numbers(*counts)

    def flat(self) -> Node:
        """Return the numbers of a matrix with one row or column as a list; other lists unchanged."""
        if "data" in self:
            numbers = self["data"].flat()
            self._check_shape(numbers)
            return numbers
        rows = self.value if isinstance(self.value, list) else []
        if not rows or not all(isinstance(row.value, list) for row in rows):
            return self
        if len(rows) > 1 and any(len(row.value) != 1 for row in rows):
            return self
        return Node([n for row in rows for n in row.value], self.source, self.name, self.line)

    def _check_shape(self, numbers: Node) -> None:
        """Raise an error unless ``rows`` and ``cols`` agree with the numbers in ``data``."""
        if "rows" in self and "cols" in self and isinstance(numbers.value, list):
            shape = self["rows"].integer(), self["cols"].integer()
            if shape[0] * shape[1] != len(numbers.value):
                self.fail(
                    f"must have rows x cols = {shape[0]} x {shape[1]} numbers; got {len(numbers.value)}"
                )

    def _kind(self) -> str:
        match self.value:
            case dict():
                return "a table"
            case list():
                return "a list"
            case None:
                return "empty"
        return format_value(self.value)


# -- reading ----------------------------------------------------------------------------------


def read_yaml(text: str, source: str) -> Node:
    """Read the entries of a YAML text.

    OpenCV's dialect (``%YAML:1.0``, ``!!opencv-matrix``) is supported.

    Parameters
    ----------
    text
        YAML text.
    source
        File name, for error messages.

    Returns
    -------
    Node
        Whole document.

    Raises
    ------
    SpecError
        If it is not valid YAML, contains references, or is nested too deeply.

    Examples
    --------
    >>> read_yaml("cam0:\\n  resolution: [640, 480]\\n", "a.yaml")["cam0"]["resolution"].numbers(2)
    (640.0, 480.0)
    """
    # OpenCV's header, also after comments, becomes a comment: the numbers of lines are unchanged.
    text = re.sub(r"(?m)^(?=%YAML:)", "#", text, count=1)
    node = compose_yaml(text, source)
    return Node(None, source) if node is None else _entry(node, source, "")


def _entry(tree: Any, source: str, name: str) -> Node:
    """Convert a node of PyYAML's tree; words and numbers remain text."""
    line = tree.start_mark.line + 1
    if tree.id == "mapping":
        pairs = [(str(k.value) if k.id == "scalar" else "?", k, v) for k, v in tree.value]
        table: dict[str, Node] = {}
        for key, key_node, value in pairs:
            if key in table:
                raise SpecError(
                    f"{source} line {key_node.start_mark.line + 1}: {key} must not occur twice"
                )
            table[key] = _entry(value, source, f"{name}.{key}" if name else key)
        return Node(table, source, name, line)
    if tree.id == "sequence":
        items = [_entry(v, source, f"{name}[{i}]") for i, v in enumerate(tree.value)]
        return Node(items, source, name, line)
    is_empty = tree.style is None and tree.value in ("", "~", "null")
    return Node(None if is_empty else tree.value, source, name, line)


def read_json(text: str, source: str) -> Node:
    """Read the entries of a JSON text, which may contain comments as written by OpenCV.

    Raises
    ------
    SpecError
        If it is not valid JSON, contains a name twice, or is nested too deeply.

    Examples
    --------
    >>> read_json('{"distortion_center": [319.5, 239.5]}', "a.json")["distortion_center"].numbers(2)
    (319.5, 239.5)
    """
    try:
        return _plain(parse_json(_without_comments(text)), source, "")
    except json.JSONDecodeError as problem:
        raise SpecError(
            f"{source} line {problem.lineno} is not valid JSON: {problem.msg}"
        ) from None
    except ValueError as problem:
        raise SpecError(f"{source}: {problem}") from None


JSON_COMMENT = re.compile(r'"(?:[^"\\]|\\.)*"|//[^\n]*|/\*.*?\*/', re.DOTALL)


def _without_comments(text: str) -> str:
    """Replace the comments of a JSON text by spaces, so that the numbers of lines are unchanged.

    >>> _without_comments('{"a": "//", // b\\n"c": 1 /* d */}')
    '{"a": "//", \\n"c": 1 }'
    """

    def kept(match: re.Match[str]) -> str:
        return match[0] if match[0].startswith('"') else "\n" * match[0].count("\n")

    return JSON_COMMENT.sub(kept, text)


def _plain(value: Any, source: str, name: str) -> Node:
    if isinstance(value, dict):
        table = {k: _plain(v, source, f"{name}.{k}" if name else k) for k, v in value.items()}
        return Node(table, source, name)
    if isinstance(value, list):
        return Node([_plain(v, source, f"{name}[{i}]") for i, v in enumerate(value)], source, name)
    return Node(value, source, name)


def read_xml(text: str, source: str) -> Node:
    """Read the entries of an XML text written by OpenCV's ``FileStorage``.

    An element with child elements is a mapping, or a list if these are named ``_``. The content of
    ``data`` and several numbers in a row are lists; other content is a word or number.

    Raises
    ------
    SpecError
        If it is not valid XML, declares entities, or is nested too deeply.

    Examples
    --------
    >>> read_xml("<opencv_storage><xi>1.3</xi><size>4 3</size></opencv_storage>", "a.xml")["size"].numbers(2)
    (4.0, 3.0)
    """
    return _element(parse_xml(text, source), source, "")


def _element(element: Any, source: str, name: str) -> Node:
    """Convert an element of an XML tree."""
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return Node(
            [_element(c, source, f"{name}[{i}]") for i, c in enumerate(children)], source, name
        )
    if children:
        table: dict[str, Node] = {}
        for child in children:
            if child.tag in table:
                raise SpecError(
                    f"{source}: {child.tag} must not occur twice in {name or 'the file'}"
                )
            table[child.tag] = _element(child, source, f"{name}.{child.tag}" if name else child.tag)
        return Node(table, source, name)
    words = (element.text or "").split()
    if element.tag == "data" or (len(words) > 1 and all(map(_is_number, words))):
        return Node([Node(w, source, f"{name}[{i}]") for i, w in enumerate(words)], source, name)
    return Node(" ".join(words).strip('"') or None, source, name)


def _is_number(word: str) -> bool:
    try:
        parse_float(word)
    except ValueError:
        return False
    return True


# -- Formats and layouts ---------------------------------------------------------------------------
#
# The parameters of a file apply to the calibrated image, as do those of the camera models here.
# Information that files lack is given for reading (:class:`ReadOptions`): the type of optics and
# whether the image is flipped.
#
# Files use one frame: right and down in the image, and a third axis along the viewing direction at
# the image centre. In the camera frame here (X right, Y down, Z ahead of the lens), it is (X, Y, Z)
# for a fisheye and (X, Y, -Z) for a mirror, which is left-handed because the image of a mirror is
# reversed. For a flipped mirror image it is (-X, Y, -Z), right-handed again.

Content = str | bytes
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
RELATIVE_ROUNDING = 1e-9  # relative to a typical parameter change: rounding of a fit
NEUTRAL_VALUES = {"c": 1.0}  # neutral values other than 0: OCamCalib's stretch


@dataclass(frozen=True)
class ReadOptions:
    """Information that files of other programs do not contain.

    Attributes
    ----------
    source
        File name, for error messages.
    optics : "mirror" or "fisheye"
        Type of optics.
    mount
        Orientation of the camera; ``image_flipped`` states that the calibrated image was flipped.
    rim_radius_px : px, optional
        Boundary of the field.
    image_size : (width, height), optional
        Image size, for files without it.
    """

    source: str
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    image_size: tuple[int, int] | None = None

    @property
    def model_arguments(self) -> dict[str, Any]:
        """Arguments of all camera models that files do not contain."""
        return {"optics": self.optics, "mount": self.mount, "rim_radius_px": self.rim_radius_px}

    def size_in(self, table: Node, name: str) -> tuple[int, int]:
        """Return the image size from a table entry of width and height, or the given size.

        Raises
        ------
        SpecError
            If there is no size, or the entry is invalid.
        """
        if name not in table:
            return self.size()
        entries = table[name].entries()
        if len(entries) != 2:
            table[name].fail("must be two numbers, width and height")
        return entries[0].integer(), entries[1].integer()

    def size(self) -> tuple[int, int]:
        """Return the given image size, for a file without it.

        Raises
        ------
        SpecError
            If no size was given.
        """
        if self.image_size is None:
            raise SpecError(
                f"{self.source} does not contain the image size; specify image_size "
                "(--set camera.image_size), for example 1024x768"
            )
        return self.image_size


class CameraEntry(NamedTuple):
    """Camera in a file."""

    name: str
    """Name in the file: "cam0", "1"; "" without a name."""
    camera: Camera
    notes: tuple[str, ...] = ()
    """Assumptions made while reading, and contradictions in the file."""


@dataclass(frozen=True)
class CameraFile:
    """Content of a camera file, parsed once for all formats.

    Attributes
    ----------
    source
        File name, for error messages.
    data
        Content; gzip files are decompressed (:meth:`of`).
    """

    source: str
    data: bytes

    @classmethod
    def of(cls, source: str, data: bytes) -> CameraFile:
        """Create from the content of a file, decompressing gzip files such as OpenCV's ``.yml.gz``.

        Raises
        ------
        SpecError
            If the compressed content is damaged or too large.
        """
        if data.startswith(GZIP_MAGIC):
            try:
                data = decompress(data, MAX_TEXT_BYTES)
            except ValueError as problem:
                raise SpecError(f"cannot read {source}: {problem}") from None
        return cls(source, data)

    @property
    def name(self) -> str:
        """File name without its folder, in lower case."""
        return Path(self.source).name.lower()

    @property
    def is_binary(self) -> bool:
        """True if the content is binary."""
        return b"\0" in self.data

    @cached_property
    def text(self) -> str:
        """Text of the file.

        Raises
        ------
        SpecError
            If the content is not text.
        """
        try:
            return self.data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        except UnicodeDecodeError:
            raise SpecError(f"cannot read {self.source}: it is not a text file") from None

    @cached_property
    def _parsed(self) -> Node | SpecError:
        """Entries of JSON, XML or YAML content, or the parsing error."""
        if self.is_binary:
            return SpecError(f"cannot read {self.source}: it is not a text file")
        problem: SpecError | None = None
        for parse in self._parsers:
            try:
                return parse()
            except SpecError as reason:
                problem = problem or reason
        assert problem is not None
        return problem

    @property
    def _parsers(self) -> list[Callable[[], Node]]:
        """Parsers by the first character, in order; YAML mappings may start like JSON."""

        def yaml() -> Node:
            return read_yaml(self._documents[0], self.source)

        match self.data.removeprefix(BYTE_ORDER_MARK).lstrip()[:1]:
            case b"<":
                return [lambda: read_xml(self.text, self.source)]
            case b"{" | b"/":  # or a comment before it
                return [lambda: read_json(self.text, self.source), yaml]
        return [yaml]

    @cached_property
    def _documents(self) -> list[str]:
        """Documents of a YAML text separated by ``---``, as by ``ros2 topic echo``."""
        documents: list[list[str]] = [[]]
        has_content = False
        for line in self.text.splitlines():
            if re.fullmatch(r"(---|\.\.\.)\s*(#.*)?", line) and has_content:
                documents.append([])
                has_content = False
                continue
            documents[-1].append(line)
            has_content = has_content or bool(
                line.split("#")[0].strip("- ") and not line.startswith("%")
            )
        if len(documents) == 1:
            return [self.text]
        texts = ["\n".join(document) + "\n" for document in documents]
        return [text for i, text in enumerate(texts) if i == 0 or text.strip()]

    @property
    def entries(self) -> Node:
        """Entries of the file.

        Raises
        ------
        SpecError
            If the file is not valid JSON, XML or YAML.
        """
        if isinstance(self._parsed, SpecError):
            raise self._parsed
        return self._parsed

    @property
    def table(self) -> Node | None:
        """Entries, if the content is a mapping; otherwise None."""
        is_table = isinstance(self._parsed, Node) and isinstance(self._parsed.value, dict)
        return self.entries if is_table else None

    def has(self, *names: str) -> bool:
        """Return whether the file is a mapping with these names."""
        return self.table is not None and all(name in self.table for name in names)

    @property
    def problem(self) -> SpecError | None:
        """Parsing error of a file that is JSON, XML or YAML according to its start or its name."""
        claims = (
            self.name.endswith((".yaml", ".yml", ".json", ".xml", ".gz"))
            or self.data.lstrip()[:1] in b"{<%"
        )
        return self._parsed if isinstance(self._parsed, SpecError) and claims else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on ignored content."""
        several = not isinstance(self._parsed, SpecError) and self.text.lstrip()[:1] not in (
            "{",
            "<",
        )
        count = len(self._documents) if several else 1
        return (
            (f"the file contains {count} YAML documents; only the first is read",)
            if count > 1
            else ()
        )


@dataclass(frozen=True)
class Layout:
    """Camera model of a format.

    Attributes
    ----------
    kind
        Camera model with the same formula.
    write
        Function that returns the content of a file for a camera and its name.
    parameters : optional
        Names of supported parameters; None: all. The others must have no effect, which is the value
        0 except for a stretch (:data:`NEUTRAL_VALUES`) except for rounding.
    max_field_angle_deg : deg
        Field angle below which programs that read the file project points, independent of the
        formula.
    restriction
        Further reason why it cannot store a camera of this kind, in words that follow "it";
        "" for none.
    is_panorama
        Whether it describes a panorama that must be rendered from the images first; selected by its
        own name only.
    suffixes
        File suffixes, if the same model has several encodings; empty for any.
    description
        Name of the model in its program.
    """

    kind: type[Any]
    write: Callable[[Any, str], Content]
    description: str
    parameters: frozenset[str] | None = None
    max_field_angle_deg: float = 180.0
    suffixes: tuple[str, ...] = ()
    is_panorama: bool = False
    restriction: Callable[[Any], str] = lambda camera: ""

    def unsupported(self, camera: Camera) -> str:
        """Return the reason why it cannot store a camera exactly, in words that follow "it".

        Empty if it can.
        """
        if self.is_panorama:
            return ""
        if not isinstance(camera, self.kind):
            name = getattr(camera, "KIND", f"a {type(camera).__name__.lower()}")
            return f"stores {self.description}; this camera is {name}"
        if names := self.unsupported_parameters(camera):
            value = next(p.value for p in camera.parameters if p.name == names[0])
            return f"cannot store {names[0]} = {value:.6g}"
        return self.restriction(camera)

    def unsupported_parameters(self, camera: Any) -> tuple[str, ...]:
        """Return the names of a camera's parameters that have an effect but are not supported."""
        if self.parameters is None or not isinstance(camera, self.kind):
            return ()
        return tuple(
            p.name
            for p in camera.parameters
            if p.name not in self.parameters
            and abs(p.value - NEUTRAL_VALUES.get(p.name, 0.0)) > RELATIVE_ROUNDING * p.scale
        )


@dataclass(frozen=True)
class CameraFormat:
    """Camera file format of a program.

    Attributes
    ----------
    title
        Name in words: "Kalibr camchain YAML".
    recognises
        Whether a file has this format, from its parsed content; a file recognised by several
        formats is rejected.
    read
        Read the cameras of a file; raises :class:`SpecError` with the line.
    layouts
        Writable layouts by name, preferred first.
    names
        Patterns of file names that select this format by default.
    """

    title: str
    recognises: Callable[[CameraFile], bool]
    read: Callable[[CameraFile, ReadOptions], list[CameraEntry]]
    layouts: Mapping[str, Layout]
    names: tuple[str, ...] = ()


def named_numbers(names: Iterable[str], numbers: Iterable[float]) -> dict[str, Any]:
    """Return numbers by name as arguments of a model; missing numbers are 0."""
    return dict(zip(names, numbers, strict=False))


def number_row(numbers: Any, separator: str = ", ") -> str:
    """Format numbers for files: the shortest text that reads back exactly, also in YAML 1.1.

    In YAML 1.1 ``1e-05`` is a string because it has no decimal point.

    >>> number_row([0.1, 2, 1e-5])
    '0.1, 2.0, 1.0e-05'
    """
    return separator.join(re.sub(r"^(-?\d+)e", r"\1.0e", repr(float(x))) for x in numbers)
