"""Formats of the export and entries of the workshop data, as offered by the page."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from ...base.errors import InvalidParameter, extra_remedy
from ...manufacturing.exporter import DEFAULT_FORMATS, FORMATS, missing_packages
from ...manufacturing.workshop import TABLES, Workshop
from .design_messages import ExportableFile, ExportStart, WorkshopEntry, WorkshopSection

TITLES = {
    "step": "Solid model (STEP)",
    "stl": "Triangle mesh (STL)",
    "3mf": "Triangle mesh (3MF)",
    "dxf": "Half-section with dimensions (DXF)",
    "pdf": "Drawing (PDF)",
    "zmx": "OpticStudio lens file (ZMX)",
    "csv": "Sag table (CSV)",
    "gridsag": "OpticStudio grid sag (DAT)",
    "svg": "Drawing sheets (SVG)",
    "png": "Drawing sheets (PNG)",
    "gcode": "Tool path (G-code)",
    "points": "Tool path (TSV)",
}
DOCUMENTS = {
    "tolerances": "Tolerance report (HTML)",
    "requirements": "Requirements (TOML)",
    "sensor": "Sensor file (TOML)",
    "evaluation": "Evaluation (CSV)",
    "report": "Sensor report (HTML)",
}
"""Files in addition to the formats of ``omnimirror export``."""
MANUFACTURING_FILES = (*DEFAULT_FORMATS, "tolerances", "requirements", "sensor")
SECTIONS = {"title": "Title block", "mirror": "Mirror", "secondary": "Second mirror"}
LABELS = {
    "number": "Drawing number",
    "owner": "Legal owner",
    "density_g_per_cm3": "Density",
    "surface_roughness_nm": "Roughness Rq of the mirror surface",
    "roughness_um": "Roughness Ra of other surfaces",
    "form_um": "Form error (peak to valley)",
    "centring_deg": "Tilt of the mirror surface",
    "centring_mm": "Decentre of the mirror surface",
    "imperfections": "Imperfections (ISO 10110-7)",
    "chamfer_mm": "Chamfer",
    "diameter_tolerance_mm": "Diameter tolerance (±)",
    "thickness_tolerance_mm": "Thickness tolerance (±)",
    "back_flatness_mm": "Flatness of the back",
}
"""Labels of entries whose label is not their name."""
EXAMPLES = {
    "date": "2026-11-22; empty: today",
    "title": "empty: name of the sensor",
    "imperfections": "five of 0.16 mm: 5x0.16",
}


class InvalidEntry(InvalidParameter):
    """Error of an entry of the workshop data.

    Attributes
    ----------
    entry
        Section and name of the entry.
    """

    def __init__(self, message: str, entry: tuple[str, str]) -> None:
        super().__init__(message)
        self.entry = entry


def export_start() -> ExportStart:
    """Return all formats with their missing packages, and the entries of the workshop data."""
    missing = missing_packages(tuple(FORMATS))
    formats = {name: TITLES.get(name, name.upper()) for name in (*TITLES, *FORMATS)}
    return ExportStart(
        formats=tuple(
            ExportableFile(
                name=name,
                title=title,
                is_for_manufacturing=name in MANUFACTURING_FILES,
                missing=tuple(missing.get(name, ())),
            )
            for name, title in {**formats, **DOCUMENTS}.items()
        ),
        workshop=tuple(
            WorkshopSection(name=name, title=SECTIONS[name], entries=_entries(kind))
            for name, kind in TABLES.items()
        ),
        remedy=extra_remedy("cad") if any(missing.values()) else None,
    )


def _entries(kind: type[Any]) -> tuple[WorkshopEntry, ...]:
    entries = []
    for entry in fields(kind):
        parameter = kind.PARAMETERS.get(entry.name)
        default: Any = entry.default
        label = LABELS.get(entry.name, entry.name.replace("_", " ").capitalize())
        entries.append(
            WorkshopEntry(
                name=entry.name,
                label=label,
                unit=parameter.unit if parameter else "",
                description=parameter.description if parameter else EXAMPLES.get(entry.name, ""),
                default=default,
                max_length=kind.ROOM.get(entry.name),
                low=parameter.low if parameter else None,
                high=parameter.high if parameter else None,
            )
        )
    return tuple(entries)


def workshop_of(
    sections: Mapping[str, Mapping[str, str | float | None]], tolerances: Mapping[str, float]
) -> Workshop:
    """Return the workshop data of a filled form, with today's date by default.

    Raises
    ------
    InvalidEntry
        If an entry is unknown or invalid.

    Examples
    --------
    >>> workshop_of({"mirror": {"material": "brass", "form_um": None}}, {}).mirror.density
    8.5
    """
    tables = {}
    for section, entries in sections.items():
        kind = TABLES.get(section)
        names = [] if kind is None else [entry.name for entry in fields(kind)]
        filled = {name: value for name, value in entries.items() if value is not None}
        for name, value in filled.items():
            if kind is None or name not in names:
                raise InvalidEntry(
                    f"the workshop data has no entry {section}.{name}", (section, name)
                )
            try:
                kind(**{name: value})
            except InvalidParameter as e:
                raise InvalidEntry(str(e), (section, name)) from None
        if kind is not None:
            tables[section] = kind(**filled)
    return Workshop(**tables, tolerances=tolerances).dated()
