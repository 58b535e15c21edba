"""What a sensor must do, as frozen dataclasses with the tables and entries of a requirement file.

An entry that may be a range takes a number, or a pair (low, high) within which the design is free. Wrong entries are
refused by the same sentences as in a file, which give its line there.
"""

from __future__ import annotations

import dataclasses
from dataclasses import asdict, dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Literal, Self, get_type_hints

import numpy as np
from pydantic import BeforeValidator, Field, create_model

from ...base.arguments import finite, instance
from ...base.errors import InvalidParameter
from ...cameras.frames import Mount
from ...optics.housing import Housing
from ...optics.image_sensor import Imager
from ...optics.lenses import FieldLens
from ...optics.sensor_files import (
    EntryError,
    NoFile,
    Places,
    Table,
    did_you_mean,
    housing_tables,
    lens_table,
    validated,
)
from ...optics.thermal import Thermal
from .consistency import check_consistency
from .limits import Limit
from .ranges import Range, between, is_free

FARTHEST_FOCUS = 1e7
"""mm; what a focus at infinity stands for."""
Radius = Annotated[Range, between(0.1, 1e5)]
FocalLength = Annotated[Range, between(1e-2, 1e5)]
Theta = Annotated[Range, between(0.1, 60.0)]
FNumber = Annotated[Range, between(0.1, 1e3)]
Focus = Annotated[Range, between(-1e6, FARTHEST_FOCUS, endless=True)]
Magnification = Annotated[Range, between(1e-5, 1e3)]
Length = Annotated[float, Field(ge=1, le=1e7)]
Distances = Annotated[Range, between(1.0, np.inf)]
Conic = Annotated[Range, between(-1e3, 1e3)]


def _row(value: Any) -> Any:
    """Lists and arrays as tuples."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(value) if isinstance(value, list) else value


Most = Annotated[float, Field(gt=0, le=1e9)]
Names = Annotated[tuple[str, ...], BeforeValidator(lambda value: (value,) if isinstance(value, str) else _row(value))]
Column = Annotated[tuple[float, ...], BeforeValidator(_row)]


@dataclass(frozen=True, kw_only=True)
class Entries:
    """A table of requirements: its entries are checked when it is made."""

    TABLE: ClassVar[str]

    def __post_init__(self) -> None:
        given = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name, value in _checked(type(self), given, NoFile()).items():
            object.__setattr__(self, name, value)

    @classmethod
    def read(cls, table: dict[str, Any], where: Places) -> Self:
        """From the table of a file; ``where`` gives errors their place.

        Parameters
        ----------
        table
            The entries, by name.
        where
            Gives errors their place in the file.
        """
        return cls(**_checked(cls, table, where))


@cache
def _model(cls: type[Entries]) -> type[Table]:
    """The pydantic model that checks a table's entries."""
    hints = get_type_hints(cls, include_extras=True)
    entries: dict[str, Any] = {
        f.name: (hints[f.name], ... if f.default is dataclasses.MISSING else f.default) for f in dataclasses.fields(cls)
    }
    model: type[Table] = create_model(cls.__name__, __base__=Table, **entries)
    return model


def _checked(cls: type[Entries], table: dict[str, Any], where: Places) -> dict[str, Any]:
    plain = {name: v.item() if isinstance(v, np.generic) else v for name, v in table.items()}
    return dict(validated(_model(cls), cls.TABLE, plain, where))  # type: ignore[arg-type]  # the cache asks for Hashable


@dataclass(frozen=True, kw_only=True)
class FieldRequirements(Entries):
    """What is looked at: ``[field]``.

    Parameters
    ----------
    omega_max_deg
        Field angle at the rim, 1 to 179.
    omega_min_deg
        Where the field begins that matters, 0 to 170; what lies inside is not judged.
    object_distance_mm
        From the mirror to the objects, or to the nearest and the farthest of them: both count.
    object_plane_distance_mm, object_cylinder_radius_mm
        Instead: objects on a plane across the axis, so far from the mirror's vertex towards the lens, on a cylinder
        around the axis, or in a room of both, where the surface counts that a chief ray meets first.
    angles
        ``"elevation"``: tables and files tell angles as elevations, as the mount has them.

    Raises
    ------
    SpecError
        An entry is wrong; the message says what would be valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.FieldRequirements(omega_max_deg=120.0).omega_max_deg
    120.0
    """

    TABLE: ClassVar[str] = "field"

    omega_max_deg: Annotated[float, Field(ge=1, le=179, description="field angle at the rim")]
    omega_min_deg: Annotated[float, Field(ge=0, le=170, description="where the field begins that matters")] = 0.0
    object_distance_mm: Distances = np.inf
    object_plane_distance_mm: Length | None = None
    object_cylinder_radius_mm: Length | None = None
    angles: Literal["field", "elevation"] = "field"

    @property
    def has_surfaces(self) -> bool:
        """Whether the objects are on surfaces, and their distances differ from angle to angle."""
        return self.object_plane_distance_mm is not None or self.object_cylinder_radius_mm is not None


@dataclass(frozen=True, kw_only=True)
class MirrorRequirements(Entries):
    """What mirror: by its mapping, by its family, or the best of free form by a merit: ``[mirror]``.

    Parameters
    ----------
    mapping, family, optimise
        One of them: a key of ``MAPPINGS``; a key of ``FAMILIES`` or ``"polynomial:N"``; a key of ``DESIGN_MERITS``.
    shape
        What is optimised, ``"spline:12"``.
    fit
        What a mapping or family is fitted by, ``"polynomial:4"`` or ``"asphere:3"``.
    apex
        ``"pointed"``: the image centre shows ``omega_min_deg``.
    rim_radius_mm
        A number or a range.
    conic
        Conic constant of a hyperboloid or an ellipsoid, a number or a range.
    plane_distance_mm, cylinder_radius_mm
        Of the ground-plane and the cylinder mapping.
    omega_deg, height : (n,)
        Of a tabulated mapping.

    Raises
    ------
    SpecError
        An entry is wrong; the message says what would be valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.MirrorRequirements(mapping="equidistant", rim_radius_mm=40.0).mapping
    'equidistant'
    """

    TABLE: ClassVar[str] = "mirror"

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
    omega_deg: Column | None = None
    height: Column | None = None

    @property
    def is_pointed(self) -> bool:
        """Whether the image centre shows ``omega_min_deg`` and not what is behind the camera."""
        return self.apex == "pointed" or self.mapping == "cylinder"


@dataclass(frozen=True, kw_only=True)
class LensRequirements(Entries):
    """What lens: ``[lens]``.

    Parameters
    ----------
    kind
        ``"perspective"`` or ``"orthographic"`` (telecentric, as wide as the mirror).
    focal_length_mm, theta_max_deg
        Focal length, and viewing angle at the rim, numbers or ranges. Of a perspective lens one of them is enough: the
        other is what makes the rim fill the imager.
    f_number
        A number or a range; of a telecentric lens that on the imager's side.
    focus_mm
        Where the lens is focused, a number or a range; the design chooses where there is none. The smallest focus
        distance of a lens is the low end of a range: ``(250, inf)``.
    magnification
        Of a telecentric lens that is bought, a number or a range; by default what makes the rim fill the imager.
    fills
        Which side of the imager the rim's image may fill: ``"short-side"``, which holds all of it, or ``"long-side"``.
    image_circle_mm
        Diameter that the lens covers; the rim's image stays within it.
    optics
        A real lens, by its surfaces or its table, that the mirror is made for: ``[lens.optics]`` with the entries that
        ``[lens]`` has in a sensor file. Focal length and F-number are its own.

    Raises
    ------
    SpecError
        An entry is wrong; the message says what would be valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.LensRequirements(focal_length_mm=(8.0, 16.0), theta_max_deg=12.0).focal_length_mm
    (8.0, 16.0)
    """

    TABLE: ClassVar[str] = "lens"

    kind: Literal["perspective", "orthographic"] = "perspective"
    focal_length_mm: FocalLength | None = None
    theta_max_deg: Theta | None = None
    f_number: FNumber = 4.0
    focus_mm: Focus | None = None
    magnification: Magnification | None = None
    fills: Literal["short-side", "long-side"] = "short-side"
    image_circle_mm: Annotated[float, Field(ge=0.1, le=1e3)] | None = None
    optics: Any = None

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.optics is None:
            return
        instance("optics", self.optics, FieldLens, "a lens by its surfaces or its table")
        focal, F = self.optics.focal_length_mm, self.optics.f_number
        if self.focal_length_mm not in (None, focal):
            raise EntryError(
                ("lens", "focal_length_mm"),
                f"lens.focal_length_mm does not apply beside optics, which have {focal:.5g} mm",
            )
        object.__setattr__(self, "focal_length_mm", focal)
        object.__setattr__(self, "f_number", F)

    @property
    def is_telecentric(self) -> bool:
        return self.kind == "orthographic"

    @property
    def fills_imager(self) -> bool:
        """Whether what is not given of the lens makes the rim fill the imager, as far as its range allows."""
        if self.is_telecentric:
            return self.magnification is None
        return any(value is None or is_free(value) for value in (self.theta_max_deg, self.focal_length_mm))


@dataclass(frozen=True, kw_only=True)
class PartsRequirements(Entries):
    """What is bought, and what the whole may be: ``[parts]``.

    :func:`omnimirror.design_from_parts` designs with the lenses, imagers, balls and domes of the catalogue; the focal
    length and the imager are theirs then.

    Parameters
    ----------
    catalogue
        Names of files; without any the catalogue that comes with the package.
    mirror
        ``"made"``, as ``[mirror]`` says; or ``"ball"``: one of the catalogue's, as large a cap of it as is needed.
    dome
        Whether the mirror stands in one of the catalogue's domes.
    extras
        What is bought besides, by its use: ``("heater", "arm")``; the cheapest of each counts in price and mass.
    most_price, most_mass_g, most_diameter_mm, most_height_mm
        Of the whole. Mirrors that are made cost nothing here, and weigh as much as aluminium.

    Raises
    ------
    SpecError
        An entry is wrong; the message says what would be valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.PartsRequirements(most_price=200).mirror
    'made'
    """

    TABLE: ClassVar[str] = "parts"

    catalogue: Names = ()
    mirror: Literal["made", "ball"] = "made"
    dome: bool = False
    extras: Names = ()
    most_price: Most | None = None
    most_mass_g: Most | None = None
    most_diameter_mm: Most | None = None
    most_height_mm: Most | None = None


PAPER_IMAGER = Imager(1024, 1024, 5.2)
"""The paper's prototype's; taken where no imager is stated."""
DIGITS = 12  # of elevations, so that 12.3 deg stays what it was
UNNAMED = "design"
"""The name of a design where none is given."""
UPRIGHT = Mount()
BARE = Housing()


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """What a sensor must do, with the tables of a requirement file.

    :func:`load_requirements` reads them from a file, :func:`format_requirements` writes one,
    :func:`~omnimirror.design_sensor` designs a sensor from them, :func:`~omnimirror.judge` compares one with them.

    Parameters
    ----------
    field, mirror, lens
    imager
        1024 x 1024 pixels of 5.2 um by default.
    mount
        How the sensor stands.
    housing
        What stands around its mirror and hides the view; nothing by default.
    limits
        What has to be kept besides: the file's ``[[limit]]``.
    parts
        What is bought; nothing by default.
    thermal
        How temperature moves the sensor: the file's ``[thermal]``, as in a sensor file; the sensor gets it.
    temperatures_c
        Lowest and highest temperature between which limits have to be kept, its ``range_c``.
    name
        Of the sensor.
    notes
        What it is for.

    Raises
    ------
    SpecError
        Tables that do not fit each other; the message says why and what would be valid.

    Examples
    --------
    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(mapping="equidistant", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(theta_max_deg=(10, 14)),
    ...     limits=[om.Limit("total_blur_px", at_most=4.0)],
    ... )
    >>> requirements.lens.theta_max_deg, requirements.lens.f_number
    ((10.0, 14.0), 4.0)
    """

    field: FieldRequirements
    mirror: MirrorRequirements
    lens: LensRequirements = LensRequirements()
    imager: Imager = PAPER_IMAGER
    mount: Mount = UPRIGHT
    housing: Housing = BARE
    limits: tuple[Limit, ...] = ()
    parts: PartsRequirements | None = None
    thermal: Thermal | None = None
    temperatures_c: tuple[float, float] | None = None
    name: str = UNNAMED
    notes: str = ""

    def __post_init__(self) -> None:
        for name, kind in KINDS.items():
            instance(name, getattr(self, name), kind, f"of kind {kind.__name__}")
        if self.parts is not None:
            instance("parts", self.parts, PartsRequirements, "of kind PartsRequirements")
        object.__setattr__(self, "limits", tuple(instance("limits", self.limits, (list, tuple), "a list of limits")))
        for limit in self.limits:
            instance("limits", limit, Limit, "a list of limits")
        if self.thermal is not None:
            instance("thermal", self.thermal, Thermal, "of kind Thermal")
        if self.temperatures_c is not None:
            low, high = finite("temperatures_c", self.temperatures_c, -273.0, 1000.0, last=2)
            object.__setattr__(self, "temperatures_c", (float(low), float(high)))
        check_consistency(self)

    @property
    def largest_image_px(self) -> float:
        """Largest radius of the rim's image that imager and lens allow, px.

        >>> import omnimirror as om
        >>> from omnimirror.optics.image_sensor import Imager
        >>> lens = om.LensRequirements(focal_length_mm=4, fills="long-side", image_circle_mm=5.0)
        >>> om.Requirements(
        ...     field=om.FieldRequirements(omega_max_deg=120),
        ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=20),
        ...     lens=lens,
        ...     imager=Imager(1920, 1080, 3.0),
        ... ).largest_image_px
        833.3333333333334
        """
        lens, imager = self.lens, self.imager
        side = imager.inscribed_radius_px if lens.fills == "short-side" else imager.long_radius_px
        return side if lens.image_circle_mm is None else min(side, lens.image_circle_mm / 2 / imager.pitch_mm)

    def changed(self, **entries: Any) -> Requirements:
        """The same with other entries of field, mirror and lens.

        Parameters
        ----------
        entries
            What they become, by their names.

        Returns
        -------
        Requirements

        Raises
        ------
        SpecError
            An entry is wrong, or does not fit the others.
        InvalidParameter
            None of the three tables has an entry of this name.

        Examples
        --------
        >>> import omnimirror as om
        >>> mirror = om.MirrorRequirements(family="sphere", rim_radius_mm=40)
        >>> requirements = om.Requirements(
        ...     field=om.FieldRequirements(omega_max_deg=120), mirror=mirror, lens=om.LensRequirements(theta_max_deg=12)
        ... )
        >>> requirements.changed(f_number=5.6, rim_radius_mm=(30, 40)).mirror.rim_radius_mm
        (30.0, 40.0)
        """
        if unknown := entries.keys() - ENTRIES:
            raise InvalidParameter(
                f"{min(unknown)} is no entry of [field], [mirror] or [lens]{did_you_mean(min(unknown), ENTRIES)}"
            )
        changed = {
            table: dataclasses.replace(getattr(self, table), **{name: entries[name] for name in names & entries.keys()})
            for table, names in NAMES.items()
            if names & entries.keys()
        }
        return dataclasses.replace(self, **changed)

    def tables(self) -> dict[str, Any]:
        """The tables of a requirement file that says the same, as plain data.

        Returns
        -------
        dict
            Tables and entries, as a file holds them.
        """
        lens = dataclasses.replace(self.lens, optics=None)
        parts = {name: asdict(part) for name, part in {**vars(self), "lens": lens}.items() if name in TABLES}
        if (optics := self.lens.optics) is not None:
            parts["lens"] |= {"optics": lens_table(optics), "focal_length_mm": None, "f_number": None}
        if self.field.angles == "elevation":
            parts["field"] = self._by_elevation(parts["field"])
        parts["housing"] = housing_tables(self.housing)
        if self.parts is not None:
            parts["parts"] = asdict(self.parts)
        if self.thermal is not None:
            parts["thermal"] = {**asdict(self.thermal), "range_c": self.temperatures_c}
        data = {"name": self.name, "notes": self.notes, **parts, "limit": [asdict(limit) for limit in self.limits]}
        plain: dict[str, Any] = _plain(data)
        return plain

    def _by_elevation(self, field: dict[str, Any]) -> dict[str, Any]:
        """The table of the field with the elevations of its angles."""
        omega = field.pop("omega_min_deg"), field.pop("omega_max_deg")
        del field["angles"]
        return {"elevation_deg": [round(v, DIGITS) for v in self.mount.elevations_deg(omega)], **field}


OF_OPTICS = ("focal_length_mm", "f_number")
"""What a real lens says itself."""
TABLES = ("field", "mirror", "lens", "imager", "mount")
NAMES = {
    cls.TABLE: {f.name for f in dataclasses.fields(cls)}
    for cls in (FieldRequirements, MirrorRequirements, LensRequirements)
}
"""The entries of each table; no name is of two tables."""
ENTRIES = frozenset[str]().union(*NAMES.values())

KINDS: dict[str, type[Any]] = {
    "field": FieldRequirements, "mirror": MirrorRequirements, "lens": LensRequirements, "imager": Imager,
    "mount": Mount, "housing": Housing, "name": str, "notes": str,
}  # fmt: skip


def _plain(value: Any) -> Any:
    """The same data as TOML has it: lists for tuples, and nothing where there is nothing."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
