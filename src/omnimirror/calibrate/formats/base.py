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
from typing import Any, NamedTuple

from ...camera_models.base import Optics
from ...cameras import Camera
from ...errors import SpecError
from ...frames import Mount

Content = str | bytes
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
        for p in () if self.places is None else camera.parameters:
            off = abs(p.value - ALIKE.get(p.name, 0.0))
            if self.places is not None and p.name not in self.places and off > NOTHING * p.scale:
                return f"has no place for {p.name} = {p.value:.6g}"
        return self.refuses(camera)


@dataclass(frozen=True)
class CameraFormat:
    """A file of cameras, of one program.

    Attributes
    ----------
    title
        In words: "Kalibr camchain YAML".
    recognises
        Whether a file is one of these, by its name and content.
    read
        The cameras of a file's content; raises :class:`SpecError` with the line.
    layouts
        What can be written, the one that is preferred first, by the name that is asked for.
    names
        Patterns of file names that stand for this format where nothing else says which to write.
    """

    title: str
    recognises: Callable[[str, bytes], bool]
    read: Callable[[bytes, Reading], list[Stored]]
    layouts: Mapping[str, Layout]
    names: tuple[str, ...] = ()


def text_of(data: bytes, source: str) -> str:
    """The text of a file's content.

    Raises
    ------
    SpecError
        It is none.
    """
    try:
        return data.decode("utf-8-sig").replace("\r\n", "\n").replace("\r", "\n")
    except UnicodeDecodeError:
        raise SpecError(f"cannot read {source}: it is not a text file") from None


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
