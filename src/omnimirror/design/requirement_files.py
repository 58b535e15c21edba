"""Requirement files in TOML format, and requirements that reproduce an existing sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tomli_w
from pydantic import Field

from ..base.arguments import file_name, instance, validate_arguments
from ..base.errors import SpecError
from ..base.files import parse_toml, read_text
from ..base.table_models import Table, table_model, validated
from ..base.toml_validation import NullLocator, SourceLocator, check_entries, merge_tables
from ..cameras.camera import Mount
from ..optics.housing import NO_HOUSING
from ..optics.image_sensor import Imager
from ..optics.lenses import Perspective
from ..optics.mirrors.measured import MAPPING_FILE
from ..optics.sensor import Sensor, check_sensor
from ..optics.sensor_files import housing_of, housing_tables, lens_of, lens_table
from ..optics.sensor_tables import MountTable
from ..optics.thermal import Thermal
from .catalogue import TYPICAL
from .limits import LIMITABLE, Limit
from .requirements import (
    PAPER_IMAGER,
    UPRIGHT,
    FieldRequirements,
    LensRequirements,
    MirrorRequirements,
    PartsRequirements,
    Requirements,
)

# -- Requirement files: requirements in TOML format, validated by entry like sensor files ----------

FORMAT = 1
ANY_F = (0.1, 1e3)
"""Default F-number range with off-the-shelf lenses."""

REQUIREMENT_ENTRIES: dict[str, type] = {
    "format": int,
    "name": str,
    "notes": str,
    "field": dict,
    "mirror": dict,
    "lens": dict,
    "imager": dict,
    "mount": dict,
    "housing": dict,
    "limit": list,
    "parts": dict,
    "thermal": dict,
}
"""Entries and tables of a requirement file with their types."""
REQUIRED_TABLES = ("field", "mirror")

Angle = Annotated[float, Field(ge=0, le=179)]
Elevation = Annotated[float, Field(ge=-90, le=90)]


class LimitTable(Table):
    """Limit of an evaluated quantity, over the whole field or a part of it."""

    quantity: str
    at_most: float | None = None
    at_least: float | None = None
    omega_deg: Angle | Annotated[list[Angle], Field(min_length=2, max_length=2)] | None = None
    elevation_deg: (
        Elevation | Annotated[list[Elevation], Field(min_length=2, max_length=2)] | None
    ) = None
    cycles_per_px: float | None = None


class ElevationTable(Table):
    """Lowest and highest elevation in ``[field]``, as an alternative to field angles."""

    elevation_deg: Annotated[
        list[Elevation], Field(min_length=2, max_length=2, description="[LOW, HIGH], deg")
    ]


def load_requirements(
    path: str | Path, changes: dict[str, Any] | None = None, limits: Sequence[dict[str, Any]] = ()
) -> Requirements:
    """Read a requirement file.

    Parameters
    ----------
    path
        File name.
    changes
        Replacements for entries of the file: ``{"lens": {"f_number": 5.6}}``; None removes an
        entry or a table.
    limits
        Tables of additional limits: ``{"quantity": "total_blur_px", "at_most": 4.0}``.

    Returns
    -------
    Requirements
        Requirements of the file.

    Raises
    ------
    SpecError
        If a file is missing, the TOML text or an entry is invalid. The message contains
        the file, the line and the valid values.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=120.0),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=40.0),
    ...     lens=om.LensRequirements(focal_length_mm=11.6, theta_max_deg=12.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/requirements.toml", "w") as file:
    ...         _ = file.write(om.format_requirements(requirements))
    ...     om.load_requirements(f"{folder}/requirements.toml").field.omega_max_deg
    120.0
    """
    path = file_name("path", path)
    text = read_text(
        path,
        "requirement file",
        SpecError,
        f"cannot read the requirement file {path}: the file does not exist",
    )
    return parse_requirements(text, str(path), path.parent, changes, limits)


def parse_requirements(
    text: str,
    source: str = "requirements",
    folder: Path | None = None,
    changes: dict[str, Any] | None = None,
    limits: Sequence[dict[str, Any]] = (),
) -> Requirements:
    """Parse requirements from text; ``folder`` is the base of relative file names.

    >>> requirements = parse_requirements('''
    ... field.omega_max_deg = 135
    ... [mirror]
    ... mapping = "equidistant"
    ... rim_radius_mm = 43.9
    ... [lens]
    ... theta_max_deg = [10, 14]
    ... ''')
    >>> requirements.lens.theta_max_deg, requirements.lens.f_number
    ((10.0, 14.0), 4.0)
    """
    text = text.removeprefix("\ufeff")  # byte order mark, written by some editors
    where = SourceLocator(text, source)
    data = parse_toml(text, source)
    data = merge_tables(data, changes or {})
    if limits and isinstance(data.get("limit", []), list):
        data["limit"] = [*data.get("limit", []), *limits]
    return requirements_of(data, where, folder)


def format_requirements(requirements: Requirements) -> str:
    """Format requirements as the text of a file; parsing it returns equal requirements.

    Parameters
    ----------
    requirements
        Requirements from :func:`omnimirror.load_requirements` or created in Python.

    Returns
    -------
    str
        Text of the file in TOML format.

    Raises
    ------
    InvalidParameter
        If the argument is not an :class:`omnimirror.Requirements`.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=120, object_distance_mm=(500, float("inf"))),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=40),
    ...     lens=om.LensRequirements(focal_length_mm=12),
    ... )
    >>> parse_requirements(format_requirements(requirements)) == requirements
    True
    """
    instance("requirements", requirements, Requirements, "requirements")
    return tomli_w.dumps({"format": FORMAT, **requirements.tables()})


def requirements_of(
    data: dict[str, Any], where: SourceLocator | None = None, folder: Path | None = None
) -> Requirements:
    """Return requirements from the tables of a file; ``where`` adds locations to errors."""
    where = where or NullLocator()
    _check_tables(data, where)
    mirror = where.wrap(
        ("mirror", MAPPING_FILE.entry), lambda: MAPPING_FILE.followed(data["mirror"], folder)
    )
    mount = UPRIGHT
    if "mount" in data:
        mount = Mount(**validated(MountTable, "mount", data["mount"], where).model_dump())
    parts: dict[str, Any] = {
        "field": FieldRequirements.read(_by_field_angles(data["field"], mount, where), where),
        "mirror": MirrorRequirements.read(mirror, where),
        "lens": LensRequirements.read(_with_optics(data.get("lens", {}), where, folder), where),
        "imager": _imager(data.get("imager", asdict(PAPER_IMAGER)), where),
        "mount": mount,
        "housing": housing_of(data["housing"], where) if "housing" in data else NO_HOUSING,
        "limits": tuple(
            limit_of(i, table, mount, where) for i, table in enumerate(data.get("limit", []))
        ),
    }
    if "thermal" in data:
        parts |= _thermal(data["thermal"], where)
    if "parts" in data:
        parts["parts"] = _parts(data["parts"], where, folder)
        if "f_number" not in data.get("lens", {}):
            parts["lens"] = replace(parts["lens"], f_number=ANY_F)
    names = {name: data[name] for name in ("name", "notes") if name in data}
    return where.wrap((), lambda: Requirements(**parts, **names))


def _check_tables(data: dict[str, Any], where: SourceLocator) -> None:
    check_entries(data, REQUIREMENT_ENTRIES, FORMAT, where)
    for key in REQUIRED_TABLES:
        if key not in data:
            raise where.error(
                (),
                f"the table [{key}] is missing; a requirement file requires [field] and [mirror]",
            )


class TemperatureTable(Table):
    """Temperature range of the limits."""

    range_c: (
        Annotated[list[float], Field(min_length=2, max_length=2, description="[LOW, HIGH], C")]
        | None
    ) = None


def _thermal(table: dict[str, Any], where: SourceLocator) -> dict[str, Any]:
    """Return the thermal properties of the sensor, and the temperature range of the limits."""
    span = validated(
        TemperatureTable, "thermal", {k: v for k, v in table.items() if k == "range_c"}, where
    ).range_c
    entries = {name: value for name, value in table.items() if name != "range_c"}
    properties = validated(table_model(Thermal), "thermal", entries, where).model_dump()
    thermal = where.wrap(("thermal",), lambda: Thermal(**properties))
    return {"thermal": thermal, "temperatures_c": None if span is None else tuple(span)}


def _parts(table: dict[str, Any], where: SourceLocator, folder: Path | None) -> PartsRequirements:
    """Return the parts requirements, with catalogue paths relative to the file."""
    parts = PartsRequirements.read(table, where)
    if folder is None and any(name != TYPICAL for name in parts.catalogue):
        raise where.error(
            ("parts", "catalogue"),
            "parts.catalogue must be omitted unless the requirements are in a file",
        )
    base = folder or Path()
    return replace(
        parts, catalogue=tuple(n if n == TYPICAL else str(base / n) for n in parts.catalogue)
    )


def _with_optics(
    table: dict[str, Any], where: SourceLocator, folder: Path | None
) -> dict[str, Any]:
    """Return the lens table with a real lens in place of its definition."""
    optics = table.get("optics")
    if not isinstance(optics, dict):
        return table
    if excess := [name for name in ("focal_length_mm", "f_number") if name in table]:
        raise where.error(
            ("lens", excess[0]), f"lens.{excess[0]} and lens.optics must not be given together"
        )
    lens = lens_of(optics, where, folder, "lens.optics")
    if lens.IS_THIN:
        raise where.error(
            ("lens.optics", "kind"),
            f"lens.optics.kind must be surfaces or table; got {lens.KIND!r}",
        )
    return {**table, "optics": lens}


def _imager(table: dict[str, Any], where: SourceLocator) -> Imager:
    entries = validated(table_model(Imager), "imager", table, where).model_dump()
    if entries["centre_px"] is not None:
        entries["centre_px"] = tuple(entries["centre_px"])
    return where.wrap(("imager",), lambda: Imager(**entries))


def _by_field_angles(table: dict[str, Any], mount: Mount, where: SourceLocator) -> dict[str, Any]:
    """Return the field table with elevations, if present, converted to field angles."""
    if "elevation_deg" not in table:
        return table
    if excess := [name for name in ("omega_min_deg", "omega_max_deg", "angles") if name in table]:
        raise where.error(
            ("field", excess[0]),
            f"field.elevation_deg and field.{excess[0]} must not be given together",
        )
    entries = validated(
        ElevationTable, "field", {"elevation_deg": table["elevation_deg"]}, where
    ).elevation_deg
    low, high = _field_angles(("field", "elevation_deg"), entries, mount, where)
    rest = {name: value for name, value in table.items() if name != "elevation_deg"}
    return {"omega_min_deg": low, "omega_max_deg": high, "angles": "elevation", **rest}


def _field_angles(
    location: tuple[str, ...], elevation_deg: list[float], mount: Mount, where: SourceLocator
) -> tuple[float, float]:
    low, high = elevation_deg
    if low > high:
        raise where.error(
            location, f"{'.'.join(location)} must be [LOW, HIGH] in the field; got {elevation_deg}"
        )
    return where.wrap(location, lambda: mount.field_angles_deg((low, high)))


def limit_of(index: int, table: dict[str, Any], mount: Mount, where: SourceLocator) -> Limit:
    """Return the limit of a ``[[limit]]`` table; ``where`` adds locations to errors."""
    section = f"limit.{index}"
    entries = validated(LimitTable, section, table, where)
    location = (section, "quantity") if entries.quantity not in LIMITABLE else (section,)
    part = _pair(entries.omega_deg)
    if entries.elevation_deg is not None:
        if part is not None:
            raise where.error(
                (section, "omega_deg"),
                "limit.elevation_deg and limit.omega_deg must not be given together",
            )
        part = _field_angles(
            (section, "elevation_deg"), [*_pair(entries.elevation_deg)], mount, where
        )
    elif part is not None and part[0] > part[1]:
        location = (section, "omega_deg")
    numbers = entries.at_most, entries.at_least, part, entries.cycles_per_px
    return where.wrap(location, lambda: Limit(entries.quantity, *numbers))


def _pair(part: float | list[float] | None) -> Any:
    """Return both ends of a part of the field, which are equal for one angle."""
    return None if part is None else (part[0], part[1]) if isinstance(part, list) else (part, part)


# -- Requirements that reproduce the field, rim, lens, imager and housing of a sensor --------------

PIXELS = ("width_px", "height_px", "pixel_pitch_um")


def tables_like(sensor: Sensor) -> dict[str, Any]:
    """Return the properties of a single-mirror sensor as tables of a requirement file."""
    check_sensor(sensor)
    sensor.check("designing one like it", "single mirror")
    low, high = sensor.field_deg
    imager = sensor.imager
    return {
        "field": {"omega_max_deg": high, "omega_min_deg": low},
        "mirror": {"rim_radius_mm": sensor.mirror.rim_radius_mm},
        "lens": lens_like(sensor),
        "housing": housing_tables(sensor.housing),
        "imager": {n: getattr(imager, n) for n in PIXELS}
        | ({"centre_px": list(imager.centre_px)} if imager.centre_px else {}),
    }


def lens_like(sensor: Sensor) -> dict[str, Any]:
    """Return the lens of a sensor as an entry of a requirement file; the focus remains free.

    >>> import omnimirror as om
    >>> lens_like(om.load_sensor("paraboloid-telecentric"))
    {'kind': 'orthographic', 'f_number': 4.0}
    """
    lens = sensor.lens
    if lens.TELECENTRIC:
        return {"kind": lens.KIND, "f_number": lens.stop_number}
    theta = float(np.degrees(sensor.meridian.theta_max))
    if isinstance(lens, Perspective):
        own = {
            "kind": lens.KIND,
            "f_number": lens.stop_number,
            "focal_length_mm": lens.focal_length_mm,
        }
        return {**own, "theta_max_deg": theta}
    return {"optics": lens_table(lens), "theta_max_deg": theta}


@validate_arguments
def requirements_like(sensor: Sensor, **mirror: Any) -> Requirements:
    """Return requirements with the field, rim, lens, imager and housing of a sensor, as
    ``omnimirror design --like``.

    Parameters
    ----------
    sensor
        Sensor with one mirror; the focus of its lens remains free.
    mirror
        Construction of the new mirror: entries of :class:`omnimirror.MirrorRequirements`.

    Returns
    -------
    Requirements

    Raises
    ------
    InvalidParameter
        If the sensor has two mirrors.
    SpecError
        If the construction method is missing, or an entry is invalid.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> requirements = om.requirements_like(sphere, optimise="worst_blur_deg", shape="polynomial:3")
    >>> requirements.lens.focal_length_mm, requirements.mirror.rim_radius_mm
    (11.6, 43.905)
    """
    tables = tables_like(sensor)
    return requirements_of({**tables, "mirror": tables["mirror"] | mirror})
