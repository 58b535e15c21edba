"""The requirement file: what a sensor must do, as TOML, checked entry by entry like a sensor file.

An entry that may be a range takes a number, or ``[LOW, HIGH]``, within which the design is free.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field
from pydantic_core import PydanticCustomError

from ...arguments import file_name
from ...batch.bases import FreeForm
from ...errors import SpecError
from ...files import parse_toml, read_text
from ...frames import Mount
from ...imagers import Imager
from ...mirrors.measured.columns import MAPPING_FILE
from ...specs import Places, StandTable, Table, check_entries, did_you_mean, table_model, validated
from ..construct.families import FAMILIES
from ..construct.fits import FitForm
from ..construct.mappings import MAPPINGS
from .merits import MERITS
from .quantities import QUANTITIES, Limit

FORMAT = 1

Span = tuple[float, float]
"""Lowest and highest value allowed; both the same for a value that is given."""


def _span(low: float, high: float) -> BeforeValidator:
    """Takes a number or a pair that grows, between low and high."""

    def check(value: Any) -> Span:
        numbers = value if isinstance(value, (list, tuple)) else [value, value]
        good = len(numbers) == 2 and all(isinstance(n, (int, float)) and not isinstance(n, bool) for n in numbers)
        if not (good and low <= numbers[0] <= numbers[1] <= high):
            raise PydanticCustomError("span", f"it should be a number from {low:g} to {high:g}, or such a [LOW, HIGH]")
        return float(numbers[0]), float(numbers[1])

    return BeforeValidator(check)


Radius = Annotated[Span, _span(0.1, 1e5)]
Focal = Annotated[Span, _span(1e-2, 1e5)]
Theta = Annotated[Span, _span(0.1, 60.0)]
FNumber = Annotated[Span, _span(0.1, 1e3)]
Focus = Annotated[Span, _span(-1e6, 1e7)]
Endless = Annotated[float, Field(allow_inf_nan=True)]
Distances = Annotated[tuple[Endless, Endless], _span(1.0, np.inf)]
Conic = Annotated[Span, _span(-1e3, 1e3)]
CameraRadius = Annotated[float, Field(gt=0, description="of what stands at the lens and hides the view")]
Angle = Annotated[float, Field(ge=0, le=179)]


class FieldTable(Table):
    """What is looked at."""

    omega_max_deg: Annotated[float, Field(ge=1, le=179, description="field angle at the rim")]
    omega_min_deg: Annotated[float, Field(ge=0, le=170, description="where the field begins that matters")] = 0.0
    camera_radius_mm: (
        Annotated[float, Field(gt=0, description="of what stands at the lens and hides the view")] | None
    ) = None
    object_distance_mm: Distances = (np.inf, np.inf)


class MirrorTable(Table):
    """What mirror: by its mapping, by its family, or the best of free form by a merit."""

    mapping: str | None = None
    family: str | None = None
    optimise: str | None = None
    shape: str | None = None
    fit: str | None = None
    apex: Literal["smooth", "pointed"] = "smooth"
    rim_radius_mm: Radius
    conic: Conic | None = None
    plane_distance_mm: float | None = None
    cylinder_radius_mm: float | None = None
    omega_deg: list[float] | None = None
    height: list[float] | None = None


class LensTable(Table):
    """What lens."""

    kind: Literal["perspective", "orthographic"] = "perspective"
    focal_length_mm: Focal | None = None
    theta_max_deg: Theta | None = None
    f_number: FNumber = (4.0, 4.0)
    focus_mm: Focus | None = None


class LimitTable(Table):
    """A quantity of the evaluation and what it may be, over the whole field or a part of it."""

    quantity: str
    at_most: float | None = None
    at_least: float | None = None
    omega_deg: Annotated[list[Angle], Field(min_length=2, max_length=2, description="[FROM, TO], deg")] | None = None


@dataclass(frozen=True)
class Requirements:
    """What a sensor must do; from a file by :func:`load_requirements`."""

    name: str
    notes: str
    field: FieldTable
    mirror: MirrorTable
    lens: LensTable
    imager: Imager
    mount: Mount
    limits: tuple[Limit, ...]

    def tables(self) -> dict[str, Any]:
        """The tables of a requirement file that says the same; :func:`requirements_of` reads them."""
        parts = {name: getattr(self, name).model_dump() for name in ("field", "mirror", "lens")}
        parts |= {name: asdict(getattr(self, name)) for name in ("imager", "mount")}
        data = {"name": self.name, "notes": self.notes, **parts, "limit": [asdict(limit) for limit in self.limits]}
        plain: dict[str, Any] = _plain(data)
        return plain


def _plain(value: Any) -> Any:
    """The same data as TOML has it: lists for tuples, and nothing where there is nothing."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    return value


DEFAULT_IMAGER = {"width_px": 1024, "height_px": 1024, "pixel_pitch_um": 5.2}
"""The paper's prototype's; taken where no imager is stated."""


def load_requirements(
    path: str | Path, changes: dict[str, Any] | None = None, limits: Sequence[dict[str, Any]] = ()
) -> Requirements:
    """Read a requirement file.

    Parameters
    ----------
    changes
        Entries that take the place of the file's: ``{"lens": {"f_number": 5.6}}``; None takes one away.
    limits
        Tables of more limits: ``{"quantity": "blur_px", "at_most": 4.0}``.

    Raises
    ------
    SpecError
        No such file; not TOML; an unknown, missing or wrong entry. The message gives the file, the line and
        what would be valid.
    """
    path = file_name("path", path)
    text = read_text(path, "requirement file", SpecError, f"there is no requirement file {str(path)!r}")
    return parse_requirements(text, str(path), path.parent, changes, limits)


def parse_requirements(
    text: str,
    source: str = "requirements",
    folder: Path | None = None,
    changes: dict[str, Any] | None = None,
    limits: Sequence[dict[str, Any]] = (),
) -> Requirements:
    """Requirements from the text of a file; ``folder`` is where files named in it are looked for, if it may name any.

    >>> wanted = parse_requirements('''
    ... field.omega_max_deg = 135
    ... [mirror]
    ... mapping = "equidistant"
    ... rim_radius_mm = 43.9
    ... [lens]
    ... theta_max_deg = [10, 14]
    ... ''')
    >>> wanted.lens.theta_max_deg, wanted.lens.f_number
    ((10.0, 14.0), (4.0, 4.0))
    """
    text = text.removeprefix("\ufeff")  # a byte order mark, as some editors write
    where = Places(text, source)
    data = parse_toml(text, source)
    for section, entries in (changes or {}).items():
        if isinstance(entries, dict) and isinstance(data.get(section, {}), dict):
            merged = {**data.get(section, {}), **entries}
            entries = {name: value for name, value in merged.items() if value is not None}
        data[section] = entries
    if limits and isinstance(data.get("limit", []), list):
        data["limit"] = [*data.get("limit", []), *limits]
    return requirements_of(data, where, folder)


def requirements_of(data: dict[str, Any], where: Places, folder: Path | None = None) -> Requirements:
    """Requirements from the tables of a file; ``where`` gives errors their place."""
    _check_tables(data, where)
    mirror = where.wrap(("mirror", MAPPING_FILE.entry), lambda: MAPPING_FILE.followed(data["mirror"], folder))
    imager = validated(table_model(Imager), "imager", data.get("imager", DEFAULT_IMAGER), where).model_dump()
    if imager["centre_px"] is not None:
        imager["centre_px"] = tuple(imager["centre_px"])
    field = validated(FieldTable, "field", data["field"], where)
    wanted = Requirements(
        name=data.get("name", "design"),
        notes=data.get("notes", ""),
        field=field,
        mirror=validated(MirrorTable, "mirror", mirror, where),
        lens=validated(LensTable, "lens", data.get("lens", {}), where),
        imager=where.wrap(("imager",), lambda: Imager(**imager)),
        mount=Mount(**validated(StandTable, "mount", data.get("mount", {}), where).model_dump()),
        limits=tuple(_limit(i, table, field, where) for i, table in enumerate(data.get("limit", []))),
    )
    _check_together(wanted, where)
    return wanted


# -- checks ----------------------------------------------------------------------------------------


def _check_tables(data: dict[str, Any], where: Places) -> None:
    known: dict[str, type] = {
        "format": int, "name": str, "notes": str, "field": dict, "mirror": dict, "lens": dict, "imager": dict,
        "mount": dict, "limit": list,
    }  # fmt: skip
    check_entries(data, known, FORMAT, where)
    for key in ("field", "mirror"):
        if key not in data:
            raise where.error((), f"there is no [{key}] table; a requirement file needs [field] and [mirror]")


def _check_together(wanted: Requirements, where: Places) -> None:
    """What the tables alone cannot see."""
    field, mirror, lens = wanted.field, wanted.mirror, wanted.lens
    if field.omega_min_deg >= field.omega_max_deg:
        raise where.error(
            ("field", "omega_min_deg"),
            f"field.omega_min_deg = {field.omega_min_deg:g} is not below omega_max_deg = {field.omega_max_deg:g}",
        )
    ways = [name for name in ("mapping", "family", "optimise") if getattr(mirror, name) is not None]
    if len(ways) != 1:
        said = f"both {' and '.join(ways)}" if ways else "neither mapping nor family nor optimise"
        raise where.error(("mirror",), f"mirror has {said}; give one of them")
    for name, known in (
        ("mapping", list(MAPPINGS)), ("family", [*FAMILIES, "polynomial:N"]), ("optimise", list(MERITS))
    ):  # fmt: skip
        value = getattr(mirror, name)
        if value is not None and value not in known and not (name == "family" and value.startswith("polynomial:")):
            raise where.error(
                ("mirror", name),
                f"mirror.{name} = {value!r} is not known{did_you_mean(value, known)}; valid are {', '.join(known)}",
            )
    for name in ("fit", "family"):
        text = getattr(mirror, name)
        if text is not None and (name == "fit" or ":" in text):
            where.wrap(("mirror", name), partial(FitForm.parse, text))
    _check_free_form(mirror, where)
    _check_conic(mirror, where)
    _check_lens(lens, field, where)
    _check_camera(field, mirror, where)
    _check_limits(wanted.limits, where)


def _check_conic(mirror: MirrorTable, where: Places) -> None:
    """A conic constant where nothing is left for it to choose."""
    if mirror.conic is None or mirror.family in OF_CONIC or mirror.optimise is not None:
        return
    way = f"the {mirror.mapping} mapping" if mirror.mapping else f"the family {mirror.family}"
    raise where.error(
        ("mirror", "conic"), f"mirror.conic does not apply to {way}; it belongs to {' and '.join(OF_CONIC)}"
    )


def _check_camera(field: FieldTable, mirror: MirrorTable, where: Places) -> None:
    """A camera that is no part of such a sensor."""
    radius, most = field.camera_radius_mm, WIDEST_CAMERA * mirror.rim_radius_mm[1]
    if radius is not None and radius > most:
        raise where.error(
            ("field", "camera_radius_mm"),
            f"field.camera_radius_mm = {radius:g} is more than {WIDEST_CAMERA:g} times the rim radius of the mirror; "
            f"it is valid up to {most:g}",
        )


def _check_limits(limits: tuple[Limit, ...], where: Places) -> None:
    """Limits of which one cannot be kept if another is."""
    for i, limit in enumerate(limits):
        for j, other in enumerate(limits[:i]):
            if said := limit.contradicts(other):
                raise where.error((f"limit.{i}",), f"limit {i + 1} contradicts limit {j + 1}: {said}")


OF_CONIC = ("hyperboloid", "ellipsoid")
WIDEST_CAMERA = 5.0  # times the rim radius
NOT_OF_FREE_FORM = ("fit", "conic", "plane_distance_mm", "cylinder_radius_mm", "omega_deg")


def _check_free_form(mirror: MirrorTable, where: Places) -> None:
    """What belongs to an optimised mirror alone, and what does not."""
    if mirror.optimise is None:
        if mirror.shape is not None:
            raise where.error(("mirror", "shape"), "mirror.shape belongs to an optimised mirror; give optimise too")
        return
    for name in NOT_OF_FREE_FORM:
        if getattr(mirror, name) is not None:
            raise where.error(("mirror", name), f"mirror.{name} does not apply to an optimised mirror")
    if mirror.apex == "pointed":
        raise where.error(("mirror", "apex"), "an optimised mirror has a smooth apex")
    if mirror.shape is not None:
        where.wrap(("mirror", "shape"), partial(FreeForm.parse, mirror.shape))


def _check_lens(lens: LensTable, field: FieldTable, where: Places) -> None:
    if lens.kind == "orthographic":
        for name in ("focal_length_mm", "theta_max_deg"):
            if getattr(lens, name) is not None:
                raise where.error(("lens", name), f"lens.{name} does not apply to an orthographic lens")
        if field.camera_radius_mm is not None:
            raise where.error(
                ("field", "camera_radius_mm"),
                "field.camera_radius_mm does not apply to an orthographic lens, which may stand anywhere; "
                "give omega_min_deg",
            )
    elif lens.focal_length_mm is None and lens.theta_max_deg is None:
        raise where.error(
            ("lens",), "lens has neither focal_length_mm nor theta_max_deg; give one of them, a number or a range"
        )
    if lens.kind == "perspective" and lens.focus_mm is not None:
        least, (low, high) = lens.focal_length_mm[0] if lens.focal_length_mm else 0.0, lens.focus_mm
        if low <= 0 or high <= least:
            shown = f"{low:g}" if low == high else f"[{low:g}, {high:g}]"
            raise where.error(
                ("lens", "focus_mm"),
                f"lens.focus_mm = {shown} is nearer than the focal length; it is valid above {least:g}",
            )


def _limit(index: int, table: dict[str, Any], field: FieldTable, where: Places) -> Limit:
    section = f"limit.{index}"
    entries = validated(LimitTable, section, table, where)
    place = (section, "quantity") if entries.quantity not in QUANTITIES else (section,)
    part = entries.omega_deg
    if part is not None and not 0 <= part[0] <= part[1] <= field.omega_max_deg:
        raise where.error(
            (section, "omega_deg"),
            f"limit.omega_deg = {part} is no part of the field; it needs FROM up to TO, up to {field.omega_max_deg:g}",
        )
    return where.wrap(
        place,
        lambda: Limit(entries.quantity, entries.at_most, entries.at_least, (part[0], part[1]) if part else None),
    )
