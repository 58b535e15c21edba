"""Manufacturing data of a drawing: title block, material, coating, texture and tolerances."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date as calendar_date
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from ..base.arguments import check_fields, file_name, format_value, validate_arguments
from ..base.errors import InvalidParameter, SpecError
from ..base.files import parse_toml, read_text
from ..base.parameters import Parameter
from ..base.toml_validation import SourceLocator, check_entries, did_you_mean
from ..optics.thermal import DENSITIES_G_PER_CM3

FORMAT = 1
T = TypeVar("T")


class _Sheeted:
    """Table of the workshop file with numeric ranges and text lengths that fit the sheet."""

    PARAMETERS: ClassVar[dict[str, Parameter]] = {}
    ROOM: ClassVar[dict[str, int]] = {}

    def __post_init__(self) -> None:
        check_fields(self)
        for name, parameter in self.PARAMETERS.items():
            if (value := getattr(self, name)) is not None:
                parameter.check(name, value)
        for name, room in self.ROOM.items():
            text = getattr(self, name)
            if len(text) > room or not text.isprintable():
                raise InvalidParameter(
                    f"{name} must be printable text of at most {room} characters; got {format_value(text)}"
                )


@dataclass(frozen=True)
class TitleBlock(_Sheeted):
    """Entries of the title block (ISO 7200); empty entries remain blank.

    Parameters
    ----------
    number, revision, date
        Identification of the drawing; the date has the format 2026-11-22.
    title
        Title, by default the name of the sensor.
    owner, created_by, approved_by
        Legal owner, author and approver.
    general_tolerances
        Standard for all sizes without an individual tolerance.

    Raises
    ------
    InvalidParameter
        If a text is too long for the sheet or the date is invalid.

    Examples
    --------
    >>> TitleBlock(number="OM-0042", date="2026-11-22").revision
    'A'
    """

    number: str = ""
    revision: str = "A"
    date: str = ""
    title: str = ""
    owner: str = ""
    created_by: str = ""
    approved_by: str = ""
    general_tolerances: str = "ISO 2768-mK"

    ROOM: ClassVar[dict[str, int]] = {
        "number": 24,
        "revision": 3,
        "date": 10,
        "title": 48,
        "owner": 26,
        "created_by": 26,
        "approved_by": 26,
        "general_tolerances": 26,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            _ = self.date and calendar_date.fromisoformat(self.date)
        except ValueError:
            raise InvalidParameter(
                f"date must have the format 2026-11-22; got {self.date!r}"
            ) from None


@dataclass(frozen=True)
class PartSpecification(_Sheeted):
    """Material, surface and tolerances of a mirror.

    Unspecified entries are subject to the general tolerances, which the sheet states.

    Parameters
    ----------
    material, density_g_per_cm3
        Material with its alloy; the density of known materials
        (:data:`omnimirror.optics.thermal.DENSITIES_G_PER_CM3`) is optional.
    coating
        Coating of the mirror surface.
    surface_roughness_nm, roughness_um
        Rq of the mirror surface, Ra of all other surfaces.
    form_um
        Form error of the mirror surface, peak to valley along the normal (ISO 10110-5, code 3/).
    centring_deg, centring_mm
        Tilt and decentre of the mirror surface relative to the datums (ISO 10110-6, code 4/).
    imperfections
        Surface imperfections by ISO 10110-7, for example "5x0.16" for five of 0.16 mm.
    chamfer_mm
        Chamfer of edges.
    diameter_tolerance_mm, thickness_tolerance_mm
        Symmetric tolerances.
    back_flatness_mm
        Flatness of the back, datum A.

    Raises
    ------
    InvalidParameter
        If a number is out of range or a text is too long for the sheet.

    Examples
    --------
    >>> PartSpecification(material="aluminium EN AW-6061").density
    2.7
    """

    material: str = ""
    density_g_per_cm3: float | None = None
    coating: str = ""
    surface_roughness_nm: float | None = None
    roughness_um: float = 3.2
    form_um: float | None = None
    centring_deg: float | None = None
    centring_mm: float | None = None
    imperfections: str = ""
    chamfer_mm: float = 0.2
    diameter_tolerance_mm: float | None = None
    thickness_tolerance_mm: float | None = None
    back_flatness_mm: float | None = None

    ROOM: ClassVar[dict[str, int]] = {"material": 26, "coating": 26, "imperfections": 16}
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "density_g_per_cm3": Parameter("g/cm3", 1e-3, 30.0, "density of the material"),
        "surface_roughness_nm": Parameter("nm", 1e-2, 1e5, "Rq of the mirror surface"),
        "roughness_um": Parameter("um", 1e-3, 100.0, "Ra of all other surfaces"),
        "form_um": Parameter("um", 1e-4, 1e4, "form error of the mirror surface, P-V"),
        "centring_deg": Parameter(
            "deg", 1e-6, 10.0, "tilt of the mirror surface's axis to the datums"
        ),
        "centring_mm": Parameter(
            "mm", 1e-6, 10.0, "distance of the mirror surface's axis from the datum axis"
        ),
        "chamfer_mm": Parameter("mm", 0.0, 10.0, "chamfer of edges"),
        "diameter_tolerance_mm": Parameter("mm", 1e-6, 10.0, "tolerance of the rim diameter"),
        "thickness_tolerance_mm": Parameter("mm", 1e-6, 10.0, "tolerance of the thickness"),
        "back_flatness_mm": Parameter("mm", 1e-6, 10.0, "flatness of the back"),
    }

    @property
    def density(self) -> float | None:
        """Density in g/cm3, given or that of the known material; None if unknown."""
        if self.density_g_per_cm3 is not None:
            return self.density_g_per_cm3
        material = self.material.lower()
        names = sorted(DENSITIES_G_PER_CM3, key=len, reverse=True)  # stainless steel before steel
        return next(
            (DENSITIES_G_PER_CM3[name] for name in names if name.replace("_", " ") in material),
            None,
        )


@dataclass(frozen=True)
class Workshop:
    """Content of a workshop file and allocated tolerances.

    Parameters
    ----------
    title
        Title block of the drawing.
    mirror, secondary
        Specification of each mirror.
    tolerances
        Symmetric tolerances by the error names of :func:`omnimirror.tolerance`.

    Raises
    ------
    InvalidParameter
        If an argument has the wrong type or a tolerance is negative.

    Examples
    --------
    >>> specification = PartSpecification(material="brass")
    >>> Workshop(mirror=specification, tolerances={"mirror.tilt_x_deg": 0.05}).missing(("mirror",))
    ['number', 'owner', 'approved_by', 'mirror.coating', 'mirror.surface_roughness_nm', 'mirror.imperfections']
    """

    title: TitleBlock = TitleBlock()
    mirror: PartSpecification = PartSpecification()
    secondary: PartSpecification = PartSpecification()
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        for name, value in self.tolerances.items():
            Parameter("", 0.0, 1e9).check(f"tolerance of {name}", value)

    def missing(self, parts: tuple[str, ...]) -> list[str]:
        """List missing entries that a manufacturer requires.

        Parameters
        ----------
        parts
            Present parts: "mirror" and optionally "secondary".

        Returns
        -------
        list of str
            Names of the entries in the workshop file.
        """
        names = [
            name for name in ("number", "owner", "approved_by") if not getattr(self.title, name)
        ]
        for part in parts:
            specification: PartSpecification = getattr(self, part)
            names += [
                f"{part}.{name}"
                for name in ("material", "coating", "surface_roughness_nm", "imperfections")
                if getattr(specification, name) in ("", None)
            ]
            if specification.material and specification.density is None:
                names.append(f"{part}.density_g_per_cm3")
        return names


TABLES: dict[str, type[Any]] = {
    "title": TitleBlock,
    "mirror": PartSpecification,
    "secondary": PartSpecification,
}


@validate_arguments
def load_workshop(path: str | Path) -> Workshop:
    """Read a workshop file.

    Parameters
    ----------
    path
        TOML file with the tables [title], [mirror] and [secondary].

    Returns
    -------
    Workshop
        Content of the file.

    Raises
    ------
    SpecError
        If the file is missing, is not TOML, or has an invalid entry; with file, line and valid values.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = pathlib.Path(folder, "workshop.toml")
    ...     _ = path.write_text('[mirror]\\nmaterial = "brass"\\n')
    ...     load_workshop(path).mirror.density
    8.5
    """
    path = file_name("path", path)
    text = read_text(
        path,
        "workshop file",
        SpecError,
        f"cannot read the workshop file {path}: the file does not exist",
    )
    return parse_workshop(text, str(path))


def parse_workshop(text: str, source: str = "workshop file") -> Workshop:
    """Parse the text of a workshop file; ``source`` names it in messages."""
    where, data = SourceLocator(text, source), parse_toml(text, source)
    check_entries(data, {"format": int, **dict.fromkeys(TABLES, dict)}, FORMAT, where)
    return Workshop(
        **{
            name: _built(name, kind, data[name], where)
            for name, kind in TABLES.items()
            if name in data
        }
    )


def _built(section: str, kind: type[T], table: dict[str, Any], where: SourceLocator) -> T:
    """Create the dataclass of one table; errors refer to the line of the entry."""
    names = [f.name for f in fields(kind)]  # type: ignore[arg-type]  # both are dataclasses
    for name in table:
        if name not in names:
            hint = did_you_mean(name, names)
            raise where.error(
                (section, name),
                f"unknown entry {section}.{name}{hint}; use {', '.join(names)}",
            )
        # validate single entries, so that errors refer to their line
        where.wrap((section, name), lambda name=name: kind(**{name: table[name]}))  # type: ignore[misc]  # type of the default is not inferred
    return kind(**table)
