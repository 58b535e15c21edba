"""What a shop is told of a mirror beside its shape, and who asks for it: the workshop file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from datetime import date as calendar_date
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from ..arguments import check_fields, checked, file_name, shown
from ..errors import InvalidParameter, SpecError
from ..files import parse_toml, read_text
from ..parameters import Parameter
from ..specs import Places, check_entries, did_you_mean
from ..thermal import DENSITIES_G_PER_CM3

FORMAT = 1
T = TypeVar("T")


class _Sheeted:
    """A table of the file: numbers within their ranges, words that have room on the sheet."""

    PARAMETERS: ClassVar[dict[str, Parameter]] = {}
    ROOM: ClassVar[dict[str, int]] = {}

    def __post_init__(self) -> None:
        check_fields(self)
        for name, parameter in self.PARAMETERS.items():
            if (value := getattr(self, name)) is not None:
                parameter.check(name, value)
        for name, room in self.ROOM.items():
            words = getattr(self, name)
            if len(words) > room or not words.isprintable():
                raise InvalidParameter(f"{name} = {shown(words)} has no room on the sheet; valid are {room} letters")


@dataclass(frozen=True)
class TitleBlock(_Sheeted):
    """What the title block says (ISO 7200); what is empty stays to be filled in by hand.

    Parameters
    ----------
    number, revision, date
        Of the drawing; the date as 2026-11-22.
    title
        The sensor's name by default.
    owner, created_by, approved_by
        Whose it is, and who made and released it.
    general_tolerances
        Of all sizes without a tolerance of their own.

    Raises
    ------
    InvalidParameter
        Words that have no room on the sheet, or a date that is none.

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
        "number": 24, "revision": 3, "date": 10, "title": 48, "owner": 26, "created_by": 26, "approved_by": 26,
        "general_tolerances": 26,
    }  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            _ = self.date and calendar_date.fromisoformat(self.date)
        except ValueError:
            raise InvalidParameter(f"date = {self.date!r} is no date; valid is one such as 2026-11-22") from None


@dataclass(frozen=True)
class Making(_Sheeted):
    """How a mirror is made; what is not said falls under the general tolerances, and the sheet says so.

    Parameters
    ----------
    material, density_g_per_cm3
        In words, with its alloy; the density of a known one (:data:`omnimirror.thermal.DENSITIES_G_PER_CM3`) need not
        be said.
    coating
        Of the mirror surface.
    surface_roughness_nm, roughness_um
        Rq of the mirror surface, Ra of all others.
    form_um
        Form error of the mirror surface, P-V along its normal (ISO 10110-5: 3/).
    centring_deg, centring_mm
        Of its axis to the datums: tilt, and distance (ISO 10110-6: 4/).
    imperfections
        As ISO 10110-7 counts them, "5x0.16" for five of .16 mm.
    chamfer_mm
        Of edges.
    diameter_tolerance_mm, thickness_tolerance_mm
        Plus and minus.
    back_flatness_mm
        Of the back, which is datum A.

    Raises
    ------
    InvalidParameter
        A number outside its range, or words that have no room on the sheet.

    Examples
    --------
    >>> Making(material="aluminium EN AW-6061").density
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
        "centring_deg": Parameter("deg", 1e-6, 10.0, "tilt of the mirror surface's axis to the datums"),
        "centring_mm": Parameter("mm", 1e-6, 10.0, "distance of the mirror surface's axis from the datum axis"),
        "chamfer_mm": Parameter("mm", 0.0, 10.0, "of edges"),
        "diameter_tolerance_mm": Parameter("mm", 1e-6, 10.0, "of the rim, plus and minus"),
        "thickness_tolerance_mm": Parameter("mm", 1e-6, 10.0, "from rim to back, plus and minus"),
        "back_flatness_mm": Parameter("mm", 1e-6, 10.0, "flatness of the back"),
    }

    @property
    def density(self) -> float | None:
        """In g/cm3, said or that of the known material in its words; None of another."""
        if self.density_g_per_cm3 is not None:
            return self.density_g_per_cm3
        words = self.material.lower()
        known = sorted(DENSITIES_G_PER_CM3, key=len, reverse=True)  # stainless steel before steel
        return next((DENSITIES_G_PER_CM3[name] for name in known if name.replace("_", " ") in words), None)


@dataclass(frozen=True)
class Workshop:
    """What the drawing says beside shapes and places.

    Parameters
    ----------
    title
        Of its title block.
    mirror, secondary
        How each mirror is made.
    tolerances
        Of the errors of :func:`omnimirror.tolerance`, plus and minus, by their names.

    Raises
    ------
    InvalidParameter
        A part that is none, or a tolerance below 0.

    Examples
    --------
    >>> Workshop(mirror=Making(material="brass"), tolerances={"mirror.tilt_x_deg": 0.05}).missing(("mirror",))
    ['number', 'owner', 'approved_by', 'mirror.coating', 'mirror.surface_roughness_nm', 'mirror.imperfections']
    """

    title: TitleBlock = TitleBlock()
    mirror: Making = Making()
    secondary: Making = Making()
    tolerances: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        for name, value in self.tolerances.items():
            Parameter("", 0.0, 1e9).check(f"tolerance of {name}", value)

    def missing(self, parts: tuple[str, ...]) -> list[str]:
        """What a shop would ask for, as the file names it.

        Parameters
        ----------
        parts
            Of "mirror" and "secondary", those that there are.

        Returns
        -------
        list of str
            Names of entries.
        """
        names = [name for name in ("number", "owner", "approved_by") if not getattr(self.title, name)]
        for part in parts:
            making: Making = getattr(self, part)
            names += [
                f"{part}.{name}"
                for name in ("material", "coating", "surface_roughness_nm", "imperfections")
                if getattr(making, name) in ("", None)
            ]
            if making.material and making.density is None:
                names.append(f"{part}.density_g_per_cm3")
        return names


TABLES: dict[str, type[Any]] = {"title": TitleBlock, "mirror": Making, "secondary": Making}


@checked
def load_workshop(path: str | Path) -> Workshop:
    """Read a workshop file.

    Parameters
    ----------
    path
        Of a TOML file with the tables [title], [mirror] and [secondary].

    Returns
    -------
    Workshop
        What it says.

    Raises
    ------
    SpecError
        No such file; not TOML; an unknown or wrong entry, with file and line and what would be valid.

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
    text = read_text(path, "workshop file", SpecError, f"there is no workshop file {str(path)!r}")
    return parse_workshop(text, str(path))


def parse_workshop(text: str, source: str = "workshop file") -> Workshop:
    """A workshop file's text, as :func:`load_workshop` reads it; ``source`` is how errors name it."""
    where, data = Places(text, source), parse_toml(text, source)
    check_entries(data, {"format": int, **dict.fromkeys(TABLES, dict)}, FORMAT, where)
    return Workshop(**{name: _built(name, kind, data[name], where) for name, kind in TABLES.items() if name in data})


def _built(section: str, kind: type[T], table: dict[str, Any], where: Places) -> T:
    names = [f.name for f in fields(kind)]  # type: ignore[arg-type]  # both are dataclasses
    for name in table:
        if name not in names:
            hint = did_you_mean(name, names)
            raise where.error((section, name), f"{section}.{name} is not known{hint}; valid are {', '.join(names)}")
        # each by itself, so that its line is said
        where.wrap((section, name), lambda name=name: kind(**{name: table[name]}))  # type: ignore[misc]
    return kind(**table)
