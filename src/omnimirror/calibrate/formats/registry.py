"""Every format by name: reading a file of any of them, and finding what can be written."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

from ...arguments import WrongKind, choice, shown
from ...errors import InvalidParameter, SpecError
from ...files import LARGEST_TEXT, read_bytes
from ...numerics.registry import Registry
from ...specs.camera_file import NUMBERS_OF_A_CALIBRATION
from . import colmap, kalibr, opencv_fisheye, opencv_omnidir, own, ros
from .base import CameraFormat, Layout, Reading, Stored
from .scaramuzza import matlab, ocamcalib, py_ocamcalib, py_omnicalib

OURS = {
    "ocamcalib": ocamcalib.FORMAT,
    "py-ocamcalib": py_ocamcalib.FORMAT,
    "py-omnicalib": py_omnicalib.FORMAT,
    "matlab": matlab.FORMAT,
    "opencv-omnidir": opencv_omnidir.FORMAT,
    "opencv-fisheye": opencv_fisheye.FORMAT,
    "kalibr": kalibr.FORMAT,
    "ros": ros.FORMAT,
    "colmap": colmap.FORMAT,
    "omnimirror": own.FORMAT,
}


def _check_format(name: str, kind: Any) -> None:
    if not isinstance(kind, CameraFormat):
        raise WrongKind(f"{shown(kind)} is no omnimirror.calibrate.formats.CameraFormat")
    taken = [layout for layout in kind.layouts for f in OURS.values() if layout in f.layouts]
    if taken:
        raise InvalidParameter(f"{taken[0]} is written by another format; choose another name")


FORMATS: Registry[CameraFormat] = Registry("omnimirror.camera_formats", "a camera format", OURS, _check_format)
"""Every format of cameras by the word that names it."""


def register_camera_format(name: str, kind: CameraFormat) -> None:
    """Make a format of cameras known to :func:`omnimirror.convert` and ``omnimirror convert``.

    An installed package does the same without a call, by an entry point in its ``pyproject.toml``:
    ``[project.entry-points."omnimirror.camera_formats"]`` with ``mine = "my_package:FORMAT"``.

    Parameters
    ----------
    name
        Such as ``"mine"``.
    kind
        How a file is recognised, read and written.

    Raises
    ------
    InvalidParameter
        Another format has this name, or writes what one of these is called.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.calibrate.formats import FORMATS, CameraFormat, Layout
    >>> two = Layout(om.OCam, lambda camera, name: "{} {}".format(*camera.centre_px), "the centre alone")
    >>> om.register_camera_format("docs", CameraFormat("centre", lambda n, d: False, lambda d, r: [], {"docs": two}))
    >>> FORMATS["docs"].layouts["docs"].write(om.OCam((-100.0,), (5.0, 4.0), (11, 9)), "")
    '5.0 4.0'
    >>> FORMATS.withdraw("docs")
    """
    FORMATS.register(name, kind)


# -- reading -------------------------------------------------------------------------------------------


def read_cameras(path: str | Path, reading: Reading, name: str | None = None) -> tuple[str, list[Stored]]:
    """The cameras of a file, and the name of its format.

    Parameters
    ----------
    path
    reading
        What files do not say.
    name : optional
        The format, of :data:`FORMATS`; otherwise it is recognised.

    Returns
    -------
    str, list of Stored

    Raises
    ------
    SpecError
        The file cannot be read, or is of no known format; the message says where and what would be valid.
    """
    if name is not None:
        choice("from_", name, FORMATS)
    try:
        data = read_bytes(path, LARGEST_TEXT)
    except FileNotFoundError:
        raise SpecError(f"there is no camera file {path}") from None
    except OSError as e:
        raise SpecError(f"cannot read the camera file {path}: {e.strerror or e}") from None
    if name is None:
        name = next((n for n, f in FORMATS.items() if f.recognises(Path(path).name, data)), None)
    if name is None and NUMBERS_OF_A_CALIBRATION.encode() in data:
        raise SpecError(
            f"{path} holds the numbers of a calibration, and not its camera, which is in the file of its -o"
        )
    if name is None:
        known = "; ".join(f"{n} ({f.title})" for n, f in FORMATS.items())
        raise SpecError(f"{path} is not recognised as a camera file; say which it is, of {known}")
    return name, FORMATS[name].read(data, reading)


# -- writing -------------------------------------------------------------------------------------------


class Target(NamedTuple):
    """Something that can be written."""

    name: str
    """Of the layout."""
    format: CameraFormat
    layout: Layout


def targets_of(path: str | Path, to: str | None) -> list[Target]:
    """What may be written to a file, the preferred first: one layout, or all of a format.

    Parameters
    ----------
    path
        Its name says the format where ``to`` does not.
    to
        Of :data:`FORMATS`, or of the layouts of one.

    Raises
    ------
    InvalidParameter
        There is none of this name, or the file's name says nothing.
    """
    named = {t.name: t for t in _all_targets()}
    known = ", ".join(dict.fromkeys([*FORMATS, *named]))
    if to is not None:
        if not isinstance(to, str):
            raise WrongKind(f"to = {shown(to)} is no name of a format; valid are {known}")
        if to in named and to not in FORMATS:
            return [named[to]]
        if to in FORMATS:
            return _of_path(FORMATS[to], path)
        raise InvalidParameter(f"to = {shown(to)} is not known; valid are {known}")
    for kind in FORMATS.values():
        if any(fnmatch(Path(path).name.lower(), pattern) for pattern in kind.names):
            return _of_path(kind, path)
    raise InvalidParameter(f"{Path(path).name} does not say which format is wanted; give to, one of {known}")


def _all_targets() -> Iterator[Target]:
    for kind in FORMATS.values():
        for name, layout in kind.layouts.items():
            yield Target(name, kind, layout)


def _of_path(kind: CameraFormat, path: str | Path) -> list[Target]:
    """All layouts of a format; of those that differ by the file's suffix, the one that has it."""
    suffix = Path(path).suffix.lower()
    all_of_it = [Target(name, kind, layout) for name, layout in kind.layouts.items() if not layout.is_panorama]
    fitting = [t for t in all_of_it if suffix in t.layout.suffixes]
    return fitting or [t for t in all_of_it if not t.layout.suffixes] or all_of_it
