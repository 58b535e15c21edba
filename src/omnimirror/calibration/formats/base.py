"""What every format says of itself: how a file is recognised, read and written, and which camera models it holds.

The numbers of a file belong to the picture that was calibrated, and so do those of our models. What files do not say is
told when one is read (:class:`Reading`): whether the camera looks at a mirror, and whether the picture is reversed.

Files know one frame: right and down in the picture, and a third axis towards what the centre of the picture sees. In
our camera frame (X right, Y down, Z ahead of the lens) a fisheye's is (X, Y, Z), and a mirror's (X, Y, -Z), which is
left-handed since a mirror's picture is reversed; of a picture that was flipped it is (-X, Y, -Z), right-handed again.
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
NOTHING = 1e-9  # of a parameter's typical change: the rounding of a fit
ALIKE = {"c": 1.0}  # of what does nothing at another value than 0: OCamCalib's stretch


@dataclass(frozen=True)
class Reading:
    """What files of other programs do not say.

    Attributes
    ----------
    source
        The file's name, for errors.
    optics : "mirror" or "fisheye"
    mount
        How the camera stands; its ``image_flipped`` says that the picture which was calibrated had been flipped.
    rim_radius_px : px, optional
        Where the field ends.
    image_size : (width, height), optional
        For files that do not tell it.
    """

    source: str
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    image_size: tuple[int, int] | None = None

    @property
    def told(self) -> dict[str, Any]:
        """What every model of ours takes that no file says."""
        return {"optics": self.optics, "mount": self.mount, "rim_radius_px": self.rim_radius_px}

    def size_in(self, table: Node, name: str) -> tuple[int, int]:
        """Return the size that a table gives as two numbers, width and height, or the one that was given.

        Raises
        ------
        SpecError
            Neither gives it, or the table's is not valid.
        """
        if name not in table:
            return self.size()
        entries = table[name].entries()
        if len(entries) != 2:
            table[name].refuse("is valid as two numbers, width and height")
        return entries[0].whole(), entries[1].whole()

    def size(self) -> tuple[int, int]:
        """The size of the picture, of a file that does not tell it.

        Raises
        ------
        SpecError
            It was not given.
        """
        if self.image_size is None:
            raise SpecError(
                f"{self.source} does not say how large the picture is; "
                "give its size (image_size, on the command line --image-size), such as 1024x768"
            )
        return self.image_size


class Stored(NamedTuple):
    """A camera of a file."""

    name: str
    """What the file calls it: "cam0", "1"; "" where it has no name."""
    camera: Camera
    notes: tuple[str, ...] = ()
    """Assumptions that were made to read it, and contradictions in the file."""


@dataclass(frozen=True)
class CameraFile:
    """Content of a camera file, parsed once for all formats.

    Attributes
    ----------
    source
        The file's name, for errors.
    data
        Its content; that of a gzip file is decompressed (:meth:`of`).
    """

    source: str
    data: bytes

    @classmethod
    def of(cls, source: str, data: bytes) -> CameraFile:
        """Take a file's content, decompressed where it is a gzip file, such as OpenCV's ``.yml.gz``.

        Raises
        ------
        SpecError
            The compressed content is damaged or too large.
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
        """Whether the content is not text."""
        return b"\0" in self.data

    @cached_property
    def text(self) -> str:
        """The text.

        Raises
        ------
        SpecError
            It is none.
        """
        try:
            return self.data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
        except UnicodeDecodeError:
            raise SpecError(f"cannot read {self.source}: it is not a text file") from None

    @cached_property
    def _parsed(self) -> Node | SpecError:
        """The entries of JSON, XML or YAML, whichever it is, or the reason why there are none."""
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
        """Parsers by the first character, in this order; YAML's tables may begin as those of JSON do."""

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
        """Documents of a YAML text, which lines ``---`` separate, as after each message of ``ros2 topic echo``."""
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
        """The entries of the file.

        Raises
        ------
        SpecError
            It is not valid JSON, XML or YAML.
        """
        if isinstance(self._parsed, SpecError):
            raise self._parsed
        return self._parsed

    @property
    def table(self) -> Node | None:
        """The entries, if they have names; None of other content."""
        is_table = isinstance(self._parsed, Node) and isinstance(self._parsed.value, dict)
        return self.entries if is_table else None

    def has(self, *names: str) -> bool:
        """Whether the file is a table with these names."""
        return self.table is not None and all(name in self.table for name in names)

    @property
    def problem(self) -> SpecError | None:
        """Why a file that is JSON, XML or YAML by its beginning or by its name cannot be parsed."""
        claims = self.name.endswith((".yaml", ".yml", ".json", ".xml", ".gz")) or self.data.lstrip()[:1] in b"{<%"
        return self._parsed if isinstance(self._parsed, SpecError) and claims else None

    @property
    def notes(self) -> tuple[str, ...]:
        """What was passed over."""
        several = not isinstance(self._parsed, SpecError) and self.text.lstrip()[:1] not in ("{", "<")
        count = len(self._documents) if several else 1
        return (f"the file holds {count} YAML documents; the first is read",) if count > 1 else ()


@dataclass(frozen=True)
class Layout:
    """One camera model of a format.

    Attributes
    ----------
    kind
        The model of ours with the same formula.
    write
        The content of a file, of a camera and its name.
    places : optional
        Names of the parameters that there is a place for; the others have to do nothing, as 0 does but for a stretch
        (:data:`ALIKE`), apart from rounding. None: for all.
    reach_deg : deg
        Field angle below which programs that read the file project points, whatever the formula says.
    refuses
        What else it cannot hold of a camera of this kind, in words that follow "it"; "" for nothing.
    is_panorama
        Whether it is of a panorama that has to be made of the camera's pictures first; taken by its own name alone.
    suffixes
        Of file names, where the same is written in several ways; empty for any.
    words
        The model, as its program calls it.
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
        """Why it cannot hold a camera exactly, in words that follow "it"; "" where it can."""
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
        """Return the names of a camera's parameters that have an effect and no place in the file."""
        if self.places is None or not isinstance(camera, self.kind):
            return ()
        return tuple(
            p.name
            for p in camera.parameters
            if p.name not in self.places and abs(p.value - ALIKE.get(p.name, 0.0)) > NOTHING * p.scale
        )


@dataclass(frozen=True)
class CameraFormat:
    """A file of cameras, of one program.

    Attributes
    ----------
    title
        In words: "Kalibr camchain YAML".
    recognises
        Whether a file is one of these, by its parsed content; a file that several formats recognise is rejected.
    read
        Read the cameras of a file; raises :class:`SpecError` with the line.
    layouts
        What can be written, the one that is preferred first, by the name that is asked for.
    names
        Patterns of file names that stand for this format where nothing else says which to write.
    """

    title: str
    recognises: Callable[[CameraFile], bool]
    read: Callable[[CameraFile, Reading], list[Stored]]
    layouts: Mapping[str, Layout]
    names: tuple[str, ...] = ()


def named(names: Iterable[str], numbers: Iterable[float]) -> dict[str, Any]:
    """Numbers by their names, as a model takes them; numbers that are left out are 0."""
    return dict(zip(names, numbers, strict=False))


def row(numbers: Any, separator: str = ", ") -> str:
    """Numbers as files hold them: the shortest words that read as the same numbers, for YAML 1.1 too.

    There ``1e-05`` is a word and no number, since it has no point.

    >>> row([0.1, 2, 1e-5])
    '0.1, 2.0, 1.0e-05'
    """
    return separator.join(re.sub(r"^(-?\d+)e", r"\1.0e", repr(float(x))) for x in numbers)
