"""Registry of camera file formats, with omnimirror's own camera and sensor files."""

from __future__ import annotations

from collections.abc import Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, NamedTuple

from ...base.arguments import InvalidType, choice, format_value
from ...base.errors import InvalidParameter, SpecError
from ...base.files import MAX_TEXT_BYTES, read_bytes
from ...base.registry import Registry
from ...cameras.models import RadialModel
from ...cameras.models.plausibility import plausibility_warnings
from ...optics.camera_files import CALIBRATION_MARK, format_camera, parse_camera
from ...optics.sensor import Sensor
from ...optics.sensor_files import format_sensor
from . import _basalt, _camodocal, _colmap, _kalibr, _opencv, _ros, _scaramuzza
from ._camera_format import CameraEntry, CameraFile, CameraFormat, Layout, ReadOptions

# -- omnimirror's own files ------------------------------------------------------------------------
#
# Camera files (TOML with a table ``[camera]``) and sensor files describe a camera completely.


def _read_omnimirror(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera or the sensor; mount and optics are stored in the file."""
    camera = parse_camera(file.text, reading.source, Path(reading.source).parent)
    return [CameraEntry(getattr(camera, "name", ""), camera)]


def write_camera(camera: RadialModel, name: str = "") -> str:
    """Return the text of a camera file."""
    return format_camera(camera)


def write_sensor(sensor: Sensor, name: str = "") -> str:
    """Return the text of a sensor file."""
    return format_sensor(sensor)


OMNIMIRROR = CameraFormat(
    "omnimirror camera or sensor TOML",
    lambda file: file.name.endswith(".toml"),
    _read_omnimirror,
    {
        "camera": Layout(RadialModel, write_camera, "a calibrated model"),
        "sensor": Layout(Sensor, write_sensor, "a sensor of mirror, lens and imager"),
    },
    ("*.toml",),
)


# -- Registry --------------------------------------------------------------------------------------

BUILT_IN_FORMATS = {
    "ocamcalib": _scaramuzza.OCAMCALIB,
    "py-ocamcalib": _scaramuzza.PY_OCAMCALIB,
    "py-omnicalib": _scaramuzza.PY_OMNICALIB,
    "matlab": _scaramuzza.MATLAB,
    "opencv-omnidir": _opencv.OMNIDIR,
    "opencv-fisheye": _opencv.FISHEYE,
    "opencv-pinhole": _opencv.PINHOLE,
    "camodocal": _camodocal.FORMAT,
    "multicol": _scaramuzza.MULTICOL,
    "basalt": _basalt.FORMAT,
    "kalibr": _kalibr.FORMAT,
    "ros": _ros.FORMAT,
    "colmap": _colmap.FORMAT,
    "omnimirror": OMNIMIRROR,
}


def _check_format(name: str, kind: Any) -> None:
    if not isinstance(kind, CameraFormat):
        raise InvalidType(
            f"a format must be an omnimirror.calibration.formats.CameraFormat; got {format_value(kind)}"
        )
    existing = [
        layout for layout in kind.layouts for f in BUILT_IN_FORMATS.values() if layout in f.layouts
    ]
    if existing:
        raise InvalidParameter(
            f"layouts must have new names; {existing[0]} belongs to another format"
        )


FORMATS: Registry[CameraFormat] = Registry(
    "omnimirror.camera_formats", "a camera format", BUILT_IN_FORMATS, _check_format
)
"""Camera file formats by name."""


def register_camera_format(name: str, kind: CameraFormat) -> None:
    """Register a camera file format for :func:`omnimirror.convert` and ``omnimirror convert``.

    Installed packages can instead declare an entry point in their ``pyproject.toml``:
    ``[project.entry-points."omnimirror.camera_formats"]`` with ``mine = "my_package:FORMAT"``.

    Parameters
    ----------
    name
        Name of the format, such as ``"mine"``.
    kind
        Functions for recognition, reading and writing.

    Raises
    ------
    InvalidParameter
        If another format has this name or one of its layout names.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.calibration.formats import FORMATS, CameraFormat, Layout
    >>> two = Layout(om.OCam, lambda camera, name: "{} {}".format(*camera.centre_px), "the centre alone")
    >>> om.register_camera_format("docs", CameraFormat("centre", lambda f: False, lambda f, r: [], {"docs": two}))
    >>> FORMATS["docs"].layouts["docs"].write(
    ...     om.OCam(polynomial=(-100.0,), centre_px=(5.0, 4.0), image_size=(11, 9)), ""
    ... )
    '5.0 4.0'
    >>> FORMATS.withdraw("docs")
    """
    FORMATS.register(name, kind)


# -- reading ----------------------------------------------------------------------------------


def read_cameras(
    path: str | Path, reading: ReadOptions, name: str | None = None
) -> tuple[str, list[CameraEntry]]:
    """Read the cameras of a file; return the name of its format and the cameras.

    Parameters
    ----------
    path
        Camera file.
    reading
        Information that files do not contain.
    name : optional
        Format from :data:`FORMATS`; by default recognised from the content.

    Returns
    -------
    str, list of CameraEntry
        Name of the format, and cameras.

    Raises
    ------
    SpecError
        If the file cannot be read or its format is unknown; the message names the location and
        valid values.
    """
    if name is not None:
        choice("from_", name, FORMATS)
    try:
        data = read_bytes(path, MAX_TEXT_BYTES)
    except FileNotFoundError:
        raise SpecError(f"cannot read the camera file {path}: the file does not exist") from None
    except OSError as e:
        raise SpecError(f"cannot read the camera file {path}: {e.strerror or e}") from None
    file = CameraFile.of(str(path), data)
    name = _recognise(file) if name is None else name
    stored = FORMATS[name].read(file, reading)
    return name, [
        one._replace(notes=(*file.notes, *one.notes, *_contradictions(name, one.camera, reading)))
        for one in stored
    ]


def _recognise(file: CameraFile) -> str:
    """Return the one format that recognises a file.

    Raises
    ------
    SpecError
        If no format, or more than one, recognises it.
    """
    matching = [name for name, kind in FORMATS.items() if kind.recognises(file)]
    if len(matching) == 1:
        return matching[0]
    if matching:
        titles = " or ".join(f"{name} ({FORMATS[name].title})" for name in matching)
        raise SpecError(
            f"{file.source} is ambiguous: it can be read as {titles}; specify its format (from_, --from)"
        )
    if file.has(CALIBRATION_MARK.strip('":')):
        raise SpecError(
            f"{file.source} contains the results of a calibration; use the camera file written with -o"
        )
    if file.problem:
        raise file.problem
    formats = "; ".join(f"{name} ({kind.title})" for name, kind in FORMATS.items())
    raise SpecError(
        f"{file.source} is not recognised as a camera file; specify its format, one of {formats}"
    )


def _contradictions(name: str, camera: Any, reading: ReadOptions) -> list[str]:
    """Return contradictions in the parameters of a file of another program, and with given values."""
    if name == "omnimirror" or not isinstance(camera, RadialModel):
        return []
    (width, height), specified = camera.image_size, reading.image_size
    unused = (
        []
        if specified in (None, (width, height))
        else [f"the image size of the file is used, {width}x{height}"]
    )
    return [*unused, *plausibility_warnings(camera)]


# -- writing ----------------------------------------------------------------------------------


class OutputLayout(NamedTuple):
    """Writable layout."""

    name: str
    """Name of the layout."""
    format: CameraFormat
    layout: Layout


def output_layouts(path: str | Path, to: str | None) -> list[OutputLayout]:
    """Return the candidate layouts for a file, preferred first: one layout, or all of a format.

    Parameters
    ----------
    path
        Output file; its name selects the format unless ``to`` does.
    to
        Name from :data:`FORMATS`, or of one of their layouts.

    Raises
    ------
    InvalidParameter
        If the name is unknown or belongs to a read-only format, or the file name does not
        determine the format.
    """
    named = {t.name: t for t in _all_targets()}
    writable = [name for name, kind in FORMATS.items() if kind.layouts]
    layouts = ", ".join(dict.fromkeys([*writable, *named]))
    if to is not None:
        if not isinstance(to, str):
            raise InvalidType(
                f"to must be the name of a format, one of {layouts}; got {format_value(to)}"
            )
        if to in named and to not in FORMATS:
            return [named[to]]
        if to in writable:
            return _layouts_for_path(FORMATS[to], path)
        read_only = ", a format that is supported for reading only" if to in FORMATS else ""
        raise InvalidParameter(f"to must be one of {layouts}; got {format_value(to)}{read_only}")
    for kind in FORMATS.values():
        if any(fnmatch(Path(path).name.lower(), pattern) for pattern in kind.names):
            return _layouts_for_path(kind, path)
    raise InvalidParameter(
        f"the format of {Path(path).name} cannot be inferred from its name; specify to, one of {layouts}"
    )


def _all_targets() -> Iterator[OutputLayout]:
    for kind in FORMATS.values():
        for name, layout in kind.layouts.items():
            yield OutputLayout(name, kind, layout)


def _layouts_for_path(kind: CameraFormat, path: str | Path) -> list[OutputLayout]:
    """Return all layouts of a format, or only those for the suffix of the file."""
    suffix = Path(path).suffix.lower()
    candidates = [
        OutputLayout(name, kind, layout)
        for name, layout in kind.layouts.items()
        if not layout.is_panorama
    ]
    matching = [t for t in candidates if suffix in t.layout.suffixes]
    return matching or [t for t in candidates if not t.layout.suffixes] or candidates
