"""Interface of camera file formats: recognition, reading, writing, and supported camera models.

The parameters of a file apply to the calibrated image, as do those of the camera models here.
Information that files lack is given for reading (:class:`Reading`): the type of optics and
whether the image is flipped.

Files use one frame: right and down in the image, and a third axis along the viewing direction at
the image centre. In the camera frame here (X right, Y down, Z ahead of the lens), it is (X, Y, Z)
for a fisheye and (X, Y, -Z) for a mirror, which is left-handed because the image of a mirror is
reversed. For a flipped mirror image it is (-X, Y, -Z), right-handed again.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from ...base.errors import SpecError
from ...base.files import LARGEST_TEXT, decompressed
from ...base.numerics.lazy import cached_property
from ...cameras.camera import Camera
from ...cameras.frames import Mount
from ...cameras.models.base import Optics
from .entries import Node, read_json, read_xml, read_yaml

Content = str | bytes
GZIP = b"\x1f\x8b"
BYTE_ORDER_MARK = b"\xef\xbb\xbf"
NOTHING = 1e-9  # relative to a typical parameter change: rounding of a fit
ALIKE = {"c": 1.0}  # neutral values other than 0: OCamCalib's stretch


@dataclass(frozen=True)
class Reading:
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
    def told(self) -> dict[str, Any]:
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
            table[name].refuse("is valid as two numbers, width and height")
        return entries[0].whole(), entries[1].whole()

    def size(self) -> tuple[int, int]:
        """Return the given image size, for a file without it.

        Raises
        ------
        SpecError
            If no size was given.
        """
        if self.image_size is None:
            raise SpecError(
                f"{self.source} does not say how large the picture is; "
                "give its size (image_size, on the command line --image-size), such as 1024x768"
            )
        return self.image_size


class Stored(NamedTuple):
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
        if data.startswith(GZIP):
            try:
                data = decompressed(data, LARGEST_TEXT)
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
            case b"{":
                return [lambda: read_json(self.text, self.source), yaml]
        return [yaml]

    @cached_property
    def _documents(self) -> list[str]:
        """Documents of a YAML text separated by ``---``, as by ``ros2 topic echo``."""
        documents: list[list[str]] = [[]]
        has_begun = False
        for line in self.text.splitlines():
            if line.rstrip() in ("---", "...") and has_begun:
                documents.append([])
                has_begun = False
                continue
            documents[-1].append(line)
            has_begun = has_begun or bool(line.split("#")[0].strip("- ") and not line.startswith("%"))
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
        claims = self.name.endswith((".yaml", ".yml", ".json", ".xml", ".gz")) or self.data.lstrip()[:1] in b"{<%"
        return self._parsed if isinstance(self._parsed, SpecError) and claims else None

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes on ignored content."""
        several = not isinstance(self._parsed, SpecError) and self.text.lstrip()[:1] not in ("{", "<")
        count = len(self._documents) if several else 1
        return (f"the file holds {count} YAML documents; the first is read",) if count > 1 else ()


@dataclass(frozen=True)
class Layout:
    """Camera model of a format.

    Attributes
    ----------
    kind
        Camera model with the same formula.
    write
        Function that returns the content of a file for a camera and its name.
    places : optional
        Names of supported parameters; None: all. The others must have no effect, which is the value
        0 except for a stretch (:data:`ALIKE`) except for rounding.
    reach_deg : deg
        Field angle below which programs that read the file project points, independent of the
        formula.
    refuses
        Further reason for which it cannot store a camera of this kind, in words that follow "it";
        "" for none.
    is_panorama
        Whether it describes a panorama that must be rendered from the images first; selected by its
        own name only.
    suffixes
        File suffixes, if the same model has several encodings; empty for any.
    words
        Name of the model in its program.
    """

    kind: type[Any]
    write: Callable[[Any, str], Content]
    words: str
    places: frozenset[str] | None = None
    reach_deg: float = 180.0
    suffixes: tuple[str, ...] = ()
    is_panorama: bool = False
    refuses: Callable[[Any], str] = lambda camera: ""

    def lacks(self, camera: Camera) -> str:
        """Return the reason for which it cannot store a camera exactly, in words that follow "it".

        Empty if it can.
        """
        if self.is_panorama:
            return ""
        if not isinstance(camera, self.kind):
            name = getattr(camera, "KIND", f"a {type(camera).__name__.lower()}")
            return f"holds {self.words}, and this camera is {name}"
        if names := self.unplaced(camera):
            value = next(p.value for p in camera.parameters if p.name == names[0])
            return f"has no place for {names[0]} = {value:.6g}"
        return self.refuses(camera)

    def unplaced(self, camera: Any) -> tuple[str, ...]:
        """Return the names of a camera's parameters that have an effect but are not supported."""
        if self.places is None or not isinstance(camera, self.kind):
            return ()
        return tuple(
            p.name
            for p in camera.parameters
            if p.name not in self.places and abs(p.value - ALIKE.get(p.name, 0.0)) > NOTHING * p.scale
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
    read: Callable[[CameraFile, Reading], list[Stored]]
    layouts: Mapping[str, Layout]
    names: tuple[str, ...] = ()


def named(names: Iterable[str], numbers: Iterable[float]) -> dict[str, Any]:
    """Return numbers by name as arguments of a model; missing numbers are 0."""
    return dict(zip(names, numbers, strict=False))


def row(numbers: Any, separator: str = ", ") -> str:
    """Format numbers for files: the shortest text that reads back exactly, also in YAML 1.1.

    In YAML 1.1 ``1e-05`` is a string because it has no decimal point.

    >>> row([0.1, 2, 1e-5])
    '0.1, 2.0, 1.0e-05'
    """
    return separator.join(re.sub(r"^(-?\d+)e", r"\1.0e", repr(float(x))) for x in numbers)
