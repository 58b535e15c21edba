"""File import and export of the Design tab: sensors, requirements, reports, tables and rendered images."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from ...analysis.evaluation import evaluate
from ...base.errors import InvalidParameter, SpecError
from ...base.files import parse_toml
from ...base.logs import combine_steps
from ...base.toml_validation import SourceLocator
from ...optics.image_sensor import Imager
from ...optics.sensor import Sensor
from ...optics.sensor_files import format_sensor, sensor_of, tables_of
from ._design_requirements import lens_table, mirror_table, requirements_for
from ._design_sensors import aligned_sensor, sensor_from_tables, tables_from_sensor
from ._http_messages import framed
from ._uploads import encoded, safe_name
from .design_messages import FileRequest, ImportedFile, RenderHeader, RenderRequest, distance_of

ROWS = 361  # field angles of a table
JPEG_QUALITY = 86
MAX_SIDE_PX = 4096
"""Maximum width of a panorama and maximum longer side of the imager in a report, pixels."""
VERY_FAR = 1e12
"""Finite stand-in for an infinite distance in JSON, mm."""


class File(NamedTuple):
    """Downloadable file."""

    name: str
    kind: str
    data: bytes


def opened(name: str, data: bytes) -> ImportedFile:
    """Read an uploaded sensor file or requirement file (recognised by its ``[field]`` table).

    Raises
    ------
    OmnimirrorError
        If the file is unknown or invalid; the message contains the position.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SpecError(
            f"{name} must be a sensor file or a requirement file; got a file that is not UTF-8 text"
        ) from None
    tables = parse_toml(text, name)
    where = SourceLocator(text, name)
    if "field" in tables:
        return ImportedFile(sensor=None, requirements=_checked(tables, where))
    return ImportedFile(sensor=tables_from_sensor(sensor_of(tables, where)), requirements=None)


def _checked(tables: dict[str, Any], where: SourceLocator) -> dict[str, Any]:
    """Validate and return the tables of a requirement file."""
    from ...design.requirement_files import requirements_of

    requirements_of(tables, where)
    plain: dict[str, Any] = _replaced(tables, float("inf"), VERY_FAR)
    return plain


def _replaced(value: Any, old: float, new: float) -> Any:
    """Return the data with one number replaced and entries of value None removed."""
    if isinstance(value, dict):
        return {k: _replaced(v, old, new) for k, v in value.items() if v is not None}
    if isinstance(value, list):
        return [_replaced(v, old, new) for v in value]
    return new if value == old else value


def requirement_file(tables: dict[str, Any], sensor: Sensor) -> str:
    """Format a requirement file; missing entries are taken from the sensor.

    Raises
    ------
    SpecError
        If the requirements are invalid.
    InvalidParameter
        If they specify no mirror, and that of the sensor has neither a family nor a mapping.
    """
    sensor = aligned_sensor(sensor)
    requirements = requirements_for(tables, sensor)
    imager = tables_of(sensor)["imager"]
    own = {"name": requirements.name, "imager": imager, "lens": lens_table(sensor)}
    if "mirror" not in tables:
        own["mirror"] = mirror_table(sensor)
    return tomli_w.dumps(_replaced({**own, **tables}, VERY_FAR, float("inf")))


# -- download --------------------------------------------------------------------------------------


def design_file(requested: FileRequest) -> File:
    """Create a small file of a design, as written by ``omnimirror evaluate``.

    Raises
    ------
    OmnimirrorError
        If the sensor is invalid or has no such file.
    """
    sensor = sensor_from_tables(requested.tables)
    if requested.kind == "sensor":
        return File(f"{stem_of(sensor)}.toml", "application/toml", format_sensor(sensor).encode())
    return evaluation_table(sensor, distance_of(requested.object_distance_mm))


def evaluation_table(sensor: Sensor, object_distance_mm: float) -> File:
    """Return the evaluation at equidistant field angles as CSV.

    Raises
    ------
    InvalidParameter
        If the mirror is misaligned.
    """
    check_axial(sensor, "the evaluation")
    result = evaluate(
        sensor, np.linspace(*sensor.field_deg, ROWS), object_distance_mm=object_distance_mm
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{stem_of(sensor)}-evaluation.csv"
        result.to_csv(path)
        return File(path.name, "text/csv", path.read_bytes())


def sensor_report(sensor: Sensor, on_progress: Callable[[str, float], None]) -> File:
    """Return the report of ``omnimirror demo``; ``on_progress`` receives the current step and the
    completed fraction.

    Raises
    ------
    InvalidParameter
        If the mirror is misaligned or the imager is too large.
    """
    from ..reports import write_demo

    check_axial(sensor, "the report")
    width, height = sensor.imager.size
    if max(width, height) > MAX_SIDE_PX:
        raise InvalidParameter(
            f"the imager of a report must have at most {MAX_SIDE_PX} px per side; got "
            f"{width} x {height} px; omnimirror demo supports larger imagers"
        )
    with tempfile.TemporaryDirectory() as folder, combine_steps(on_progress) as report:
        data = write_demo(sensor, folder, on_progress=report).read_bytes()
    return File(f"{stem_of(sensor)}-report.html", "text/html", data)


def check_axial(sensor: Sensor, content: str) -> None:
    """Reject a misaligned sensor for files of quantities that are valid in any meridian."""
    if not sensor.is_axial:
        raise InvalidParameter(
            f"{content} requires an aligned mirror and cover; got a decentred or tilted one; align it first"
        )


def stem_of(sensor: Sensor) -> str:
    """Return the stem of the file names of a sensor."""
    return safe_name(sensor.name)


# -- images ----------------------------------------------------------------------------------------


def taken(message: RenderRequest) -> bytes:
    """Render the image of the room and its panorama at a reduced imager resolution.

    Raises
    ------
    OmnimirrorError
        If the sensor is invalid.
    """
    from ...dewarp import Dewarper, views
    from ...simulation.rendering import render_image
    from ...simulation.scenes.room import Room

    sensor = coarser(sensor_from_tables(message.tables), message.width_px)
    rendered = render_image(sensor, Room(), samples=message.samples)
    view = views.panorama(sensor)
    if view.size[0] > MAX_SIDE_PX:  # narrow vertical field
        view = views.panorama(sensor, (MAX_SIDE_PX, None))
    panorama = Dewarper(sensor, view)(rendered)
    files = [encoded(image, ".jpg", JPEG_QUALITY) for image in (rendered, panorama)]
    return framed(RenderHeader(image_bytes=len(files[0]), panorama_bytes=len(files[1])), *files)


def coarser(sensor: Sensor, max_side_px: int) -> Sensor:
    """Return the sensor with an imager of the same size and ``max_side_px`` pixels along its longer
    side.

    >>> import omnimirror as om
    >>> small = coarser(om.load_sensor("paper-spherical"), 256)
    >>> small.imager.size, round(small.rim_radius_px, 1)
    ((256, 256), 125.4)
    """
    i = sensor.imager
    share = max_side_px / max(i.size)
    centre = None if i.centre_px is None else tuple((c + 0.5) * share - 0.5 for c in i.centre_px)
    width, height = (max(1, round(side * share)) for side in i.size)
    return replace(sensor, imager=Imager(width, height, i.pixel_pitch_um / share, centre))  # type: ignore[arg-type]  # a tuple of two
