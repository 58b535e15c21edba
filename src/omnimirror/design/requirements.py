"""Requirements on a sensor, as dataclasses with the tables and entries of a file.

An entry is a number, or a range with a free value between two ends.
"""

from __future__ import annotations

import dataclasses
from dataclasses import asdict, dataclass
from functools import cache, partial
from typing import Annotated, Any, ClassVar, Literal, Self, get_type_hints

import numpy as np
from pydantic import BeforeValidator, Field, WithJsonSchema, create_model
from pydantic_core import CoreSchema, PydanticCustomError
from pydantic_core.core_schema import no_info_plain_validator_function

from ..base.arguments import finite, format_value, instance, numbers
from ..base.errors import InvalidParameter
from ..base.table_models import Table, validated
from ..base.toml_validation import EntryError, NullLocator, SourceLocator, did_you_mean
from ..cameras.camera import Mount
from ..optics.batch.families import FreeformFamily
from ..optics.housing import NO_HOUSING, Housing
from ..optics.image_sensor import Imager
from ..optics.lenses import FieldLens
from ..optics.mirrors.mappings import MAPPINGS, check_rows
from ..optics.sensor_files import housing_tables, lens_table
from ..optics.thermal import Thermal
from .limits import Limit
from .merits import DESIGN_MERITS
from .mirror_construction import FAMILIES, check_entries
from .mirror_fits import FitForm

Range = float | tuple[float, float]
"""Number, or range (low, high) of a free value."""


def ends(value: Range) -> tuple[float, float]:
    """Return low and high end of a range; both are equal for a number.

    >>> ends(12.0), ends((8, 12))
    ((12.0, 12.0), (8.0, 12.0))
    """
    pair = np.atleast_1d(numbers("a range", value))
    if pair.shape not in ((1,), (2,)):
        raise InvalidParameter(
            f"must be a number or a range (low, high); got {format_value(value)}"
        )
    return float(pair[0]), float(pair[-1])


def ends_or_none(value: Range | None) -> tuple[float, float] | None:
    """Return the ends of an optional range."""
    return None if value is None else ends(value)


def is_free(value: Range | None) -> bool:
    """Return whether a value is free: a range with different ends.

    >>> is_free(12.0), is_free((8.0, 12.0)), is_free(None)
    (False, True, False)
    """
    return isinstance(value, tuple) and value[0] < value[1]


@dataclass(frozen=True)
class Between:
    """Annotation of entries that are a number or an increasing pair between low and high.

    ``endless`` permits inf as the high end.
    """

    low: float
    high: float
    endless: bool = False

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> CoreSchema:
        return no_info_plain_validator_function(self._check)

    def __get_pydantic_json_schema__(self, core: CoreSchema, handler: Any) -> dict[str, Any]:
        number = {"type": "number", "minimum": self.low}
        if not self.endless:
            number["maximum"] = self.high
        return {"anyOf": [number, {"type": "array", "items": number, "minItems": 2, "maxItems": 2}]}

    def _check(self, value: Any) -> Range:
        low, high = self.low, self.high
        try:
            first, last = np.broadcast_to(numbers("a range", value), 2).tolist()
        except ValueError:  # not numeric, or more than two values
            first, last = np.nan, np.nan
        if self.endless and last == np.inf:
            last = high
        if not low <= first <= last <= high:
            raise PydanticCustomError(
                "range",
                f"it should be a number from {low:g} to {high:g}, or a range [LOW, HIGH] of them",
            )
        return first if first == last else (first, last)


# -- Consistency checks between the entries and tables of requirements -----------------------------
#
# Each check raises :class:`~omnimirror.base.toml_validation.EntryError` with the path of the entry;
# the file reader adds its line.

WAYS = ("mapping", "family", "optimise")
"""Entries of ``[mirror]`` that select the construction method; exactly one is required."""
OF_PERSPECTIVE = ("focal_length_mm", "theta_max_deg")
OF_MAPPINGS = ("plane_distance_mm", "cylinder_radius_mm", "omega_deg", "height")
"""Entries of ``[mirror]`` required by some mappings."""
OF_CONIC = ("hyperboloid", "ellipsoid")
NOT_FOR_FREEFORM = ("fit", "conic", *OF_MAPPINGS)
SAME_DEG = 1e-9  # tolerance between the ends of a table and of the field
WIDEST_CAMERA = 5.0  # relative to the rim radius


def check_consistency(requirements: Requirements) -> None:
    """Check the consistency of requirements.

    Raises
    ------
    EntryError
        If the entry is inconsistent; the error contains its path and a message with valid values.
    """
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    if field.omega_min_deg >= field.omega_max_deg:
        raise EntryError(
            ("field", "omega_min_deg"),
            "field.omega_min_deg must be less than omega_max_deg = "
            f"{field.omega_max_deg:g}; got {field.omega_min_deg:g}",
        )
    _check_way(mirror)
    _check_forms(mirror)
    if mirror.mapping is not None:
        _check_mapping(mirror.mapping, mirror, field)
    _check_conic(mirror)
    _check_objects(requirements)
    _check_parts(requirements)
    _check_optics(requirements)
    _check_lens(lens, is_catalogue_lens=requirements.parts is not None)
    _check_camera(requirements)
    _check_temperatures(requirements)
    _check_limits(requirements.limits, field)


def _check_way(mirror: MirrorRequirements) -> None:
    """Check that the mirror has exactly one, known construction method."""
    ways = [name for name in WAYS if getattr(mirror, name) is not None]
    if len(ways) != 1:
        requested = " and ".join(ways) or "none"
        raise EntryError(
            ("mirror",),
            f"mirror must have exactly one of mapping, family and optimise; got {requested}",
        )
    (way,) = ways
    value = getattr(mirror, way)
    names = {
        "mapping": list(MAPPINGS),
        "family": [*FAMILIES, "polynomial:N"],
        "optimise": list(DESIGN_MERITS),
    }[way]
    if value not in names and not (way == "family" and value.startswith("polynomial:")):
        raise EntryError(
            ("mirror", way),
            f"mirror.{way} must be one of {', '.join(names)}; got {value!r}{did_you_mean(value, names)}",
        )


def _check_forms(mirror: MirrorRequirements) -> None:
    """Check fit and shape, and entries restricted to optimised mirrors."""
    for name in ("fit", "family"):
        text = getattr(mirror, name)
        if text is not None and (name == "fit" or ":" in text):
            NullLocator().wrap(("mirror", name), partial(FitForm.parse, text))
    if mirror.optimise is None:
        if mirror.shape is not None:
            raise EntryError(("mirror", "shape"), "mirror.shape requires mirror.optimise")
        return
    for name in NOT_FOR_FREEFORM:
        if getattr(mirror, name) is not None:
            raise EntryError(
                ("mirror", name), f"mirror.{name} must be omitted for an optimised mirror"
            )
    if mirror.apex == "pointed":
        raise EntryError(("mirror", "apex"), "mirror.apex must be smooth for an optimised mirror")
    if mirror.shape is not None:
        NullLocator().wrap(("mirror", "shape"), partial(FreeformFamily.parse, mirror.shape))


def _check_mapping(mapping: str, mirror: MirrorRequirements, field: FieldRequirements) -> None:
    """Check the parameters of a mapping: complete, applicable and within their ranges."""
    parameters = MAPPINGS[mapping].PARAMETERS
    specified = {
        name: value for name in OF_MAPPINGS if (value := getattr(mirror, name)) is not None
    }
    names = (
        [*specified, "omega_min_deg"]
        if mirror.is_pointed and field.omega_min_deg > 0
        else [*specified]
    )
    wrong = next((name for name in specified if name not in parameters), "mapping")
    NullLocator().wrap(("mirror", wrong), lambda: check_entries(mapping, names))
    for name, value in specified.items():
        NullLocator().wrap(("mirror", name), partial(parameters[name].check, name, value))
    if mirror.omega_deg is not None and mirror.height is not None:
        omega, height = mirror.omega_deg, mirror.height
        NullLocator().wrap(("mirror", "omega_deg"), lambda: check_rows(omega, height))
        if abs(omega[-1] - field.omega_max_deg) > SAME_DEG:
            raise EntryError(
                ("field", "omega_max_deg"),
                f"omega_max_deg must be the last angle of the mapping table, {omega[-1]:g} "
                f"deg; got {field.omega_max_deg:g}",
            )
    maximum = getattr(MAPPINGS[mapping], "MAX_OMEGA_DEG", 180.0)
    if field.omega_max_deg >= maximum:
        raise EntryError(
            ("field", "omega_max_deg"),
            f"omega_max_deg must be less than {maximum:g} deg for the {mapping} mapping; got {field.omega_max_deg:g}",
        )
    radius, rim = mirror.cylinder_radius_mm, ends(mirror.rim_radius_mm)[0]
    if radius is not None and radius <= rim:
        raise EntryError(
            ("mirror", "cylinder_radius_mm"),
            f"cylinder_radius_mm must be greater than rim_radius_mm = {rim:g}; got {radius:g}",
        )


def _check_conic(mirror: MirrorRequirements) -> None:
    """Reject an inapplicable conic constant, and mapping parameters for a family."""
    if mirror.optimise is not None:
        return
    way = f"the {mirror.mapping} mapping" if mirror.mapping else f"the family {mirror.family}"
    if mirror.conic is not None and mirror.family not in OF_CONIC:
        families = " and ".join(OF_CONIC)
        raise EntryError(
            ("mirror", "conic"), f"mirror.conic must be omitted for {way}; it applies to {families}"
        )
    if mirror.family is not None:
        for name in OF_MAPPINGS:
            if getattr(mirror, name) is not None:
                raise EntryError(
                    ("mirror", name),
                    f"mirror.{name} must be omitted for {way}; it applies to a mapping",
                )


def _check_camera(requirements: Requirements) -> None:
    """Reject a camera body that is inapplicable or too wide."""
    camera, maximum = (
        requirements.housing.camera,
        WIDEST_CAMERA * 2 * ends(requirements.mirror.rim_radius_mm)[1],
    )
    if camera is None:
        return
    if requirements.lens.is_telecentric:
        raise EntryError(
            ("housing.camera",),
            "housing.camera must be omitted for an orthographic lens, whose position is free; use omega_min_deg",
        )
    if camera.diameter_mm > maximum:
        raise EntryError(
            ("housing.camera", "diameter_mm"),
            f"housing.camera.diameter_mm must be at most {maximum:g}, {WIDEST_CAMERA:g} "
            f"times the diameter of the mirror; got {camera.diameter_mm:g}",
        )


def _check_temperatures(requirements: Requirements) -> None:
    """Check the temperature range: thermal properties, reference and limits are required."""
    thermal, span = requirements.thermal, requirements.temperatures_c
    if span is None:
        return
    if thermal is None:
        raise EntryError(
            ("thermal",),
            "a temperature range requires a table [thermal] with at least one material, such as mirror_material",
        )
    low, high = span
    if not low <= thermal.reference_c <= high:
        raise EntryError(
            ("thermal", "range_c"),
            f"thermal.range_c must contain reference_c = {thermal.reference_c:g}; got [{low:g}, {high:g}]",
        )
    if not requirements.limits:
        raise EntryError(("thermal", "range_c"), "thermal.range_c requires at least one [[limit]]")


def _check_objects(requirements: Requirements) -> None:
    """Check that the object distance or surface is unique and outside the mirror."""
    field, mirror = requirements.field, requirements.mirror
    if not field.has_surfaces:
        return
    if field.object_distance_mm != np.inf:
        raise EntryError(
            ("field", "object_distance_mm"),
            "field.object_distance_mm must not be given together with an object plane or cylinder",
        )
    if mirror.optimise is not None:
        raise EntryError(
            ("mirror", "optimise"),
            "mirror.optimise must not be given together with an object plane or cylinder; use a mapping or a family",
        )
    radius, rim = field.object_cylinder_radius_mm, ends(mirror.rim_radius_mm)[1]
    if radius is not None and radius <= rim:
        raise EntryError(
            ("field", "object_cylinder_radius_mm"),
            f"object_cylinder_radius_mm must be greater than rim_radius_mm = {rim:g}; got {radius:g}",
        )


def _check_parts(requirements: Requirements) -> None:
    """Check the off-the-shelf parts against the mirror and the housing."""
    parts, mirror, housing = requirements.parts, requirements.mirror, requirements.housing
    if parts is None:
        return
    if mirror.optimise is not None:
        raise EntryError(
            ("mirror", "optimise"),
            "mirror.optimise must not be given together with parts; use a mapping or a "
            "family, and optimise the mirror for the selected parts",
        )
    if parts.mirror == "ball" and (mirror.family != "sphere" or mirror.fit is not None):
        raise EntryError(
            ("parts", "mirror"),
            'parts.mirror = "ball" requires mirror.family = "sphere" without a fit',
        )
    if parts.dome and housing.shell is not None:
        raise EntryError(
            ("parts", "dome"), "parts.dome must not be given together with a cover in the housing"
        )


def _check_optics(requirements: Requirements) -> None:
    """Reject entries that conflict with a real lens."""
    lens = requirements.lens
    if lens.optics is None:
        return
    if lens.is_telecentric:
        raise EntryError(
            ("lens", "kind"), "lens.kind must be 'perspective' with lens.optics; got 'orthographic'"
        )
    if requirements.parts is not None:
        raise EntryError(("lens", "optics"), "lens.optics and parts must not be given together")


def _check_lens(lens: LensRequirements, is_catalogue_lens: bool = False) -> None:
    if lens.is_telecentric:
        for name in OF_PERSPECTIVE:
            if getattr(lens, name) is not None:
                raise EntryError(
                    ("lens", name), f"lens.{name} must be omitted for an orthographic lens"
                )
        return
    if lens.magnification is not None:
        raise EntryError(
            ("lens", "magnification"), "lens.magnification requires an orthographic lens"
        )
    if lens.focal_length_mm is None and lens.theta_max_deg is None and not is_catalogue_lens:
        raise EntryError(
            ("lens",), "lens requires focal_length_mm or theta_max_deg, a number or a range"
        )
    if lens.focus_mm is not None:
        minimum = 0.0 if lens.focal_length_mm is None else ends(lens.focal_length_mm)[0]
        low, high = ends(lens.focus_mm)
        if low <= 0 or high <= minimum:
            text = f"{low:g}" if low == high else f"[{low:g}, {high:g}]"
            raise EntryError(
                ("lens", "focus_mm"),
                f"lens.focus_mm must be greater than the focal length, {minimum:g} mm; got {text}",
            )


def _check_limits(limits: tuple[Limit, ...], field: FieldRequirements) -> None:
    """Reject limits for parts outside the field, and contradictory limits."""
    for i, limit in enumerate(limits):
        if limit.omega_deg is not None and limit.omega_deg[1] > field.omega_max_deg:
            raise EntryError(
                (f"limit.{i}", "omega_deg"),
                f"limit.omega_deg must be [FROM, TO] up to {field.omega_max_deg:g} deg; got {list(limit.omega_deg)}",
            )
        for j, other in enumerate(limits[:i]):
            if reason := limit.contradicts(other):
                raise EntryError(
                    (f"limit.{i}",), f"limit {i + 1} contradicts limit {j + 1}: {reason}"
                )


# -- Requirements on a sensor, as dataclasses with the tables and entries of a file ----------------
#
# An entry that may be a range accepts a number or a pair (low, high) of a free value. Invalid entries
# raise the same messages as in a file, where the line is added.

MAX_FOCUS = 1e7
"""Representation of a focus at infinity, mm."""
Radius = Annotated[Range, Between(0.1, 1e5)]
FocalLength = Annotated[Range, Between(1e-2, 1e5)]
Theta = Annotated[Range, Between(0.1, 60.0)]
FNumber = Annotated[Range, Between(0.1, 1e3)]
Focus = Annotated[Range, Between(-1e6, MAX_FOCUS, endless=True)]
Magnification = Annotated[Range, Between(1e-5, 1e3)]
Length = Annotated[float, Field(ge=1, le=1e7)]
Distances = Annotated[Range, Between(1.0, np.inf)]
Conic = Annotated[Range, Between(-1e3, 1e3)]


def _row(value: Any) -> Any:
    """Convert lists and arrays to tuples."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    return tuple(value) if isinstance(value, list) else value


Most = Annotated[float, Field(gt=0, le=1e9)]
Names = Annotated[
    tuple[str, ...],
    BeforeValidator(lambda value: (value,) if isinstance(value, str) else _row(value)),
    WithJsonSchema({"anyOf": [{"type": "string"}, {"type": "array", "items": {"type": "string"}}]}),
]
Column = Annotated[tuple[float, ...], BeforeValidator(_row)]


@dataclass(frozen=True, kw_only=True)
class Entries:
    """Table of requirements, validated at construction."""

    TABLE: ClassVar[str]

    def __post_init__(self) -> None:
        specified = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        for name, value in _checked(type(self), specified, NullLocator()).items():
            object.__setattr__(self, name, value)

    @classmethod
    def read(cls, table: dict[str, Any], where: SourceLocator) -> Self:
        """Create an instance from the table of a file.

        Parameters
        ----------
        table
            Entries by name.
        where
            Source locator for error messages.
        """
        return cls(**_checked(cls, table, where))


@cache
def entries_model(cls: type[Entries]) -> type[Table]:
    """Return the pydantic model that validates the entries of a table."""
    hints = get_type_hints(cls, include_extras=True)
    entries: dict[str, Any] = {
        f.name: (hints[f.name], ... if f.default is dataclasses.MISSING else f.default)
        for f in dataclasses.fields(cls)
    }
    model: type[Table] = create_model(cls.__name__, __base__=Table, **entries)
    return model


def _checked(cls: type[Entries], table: dict[str, Any], where: SourceLocator) -> dict[str, Any]:
    plain = {name: v.item() if isinstance(v, np.generic) else v for name, v in table.items()}
    return dict(validated(entries_model(cls), cls.TABLE, plain, where))  # type: ignore[arg-type]  # the cache requires Hashable


@dataclass(frozen=True, kw_only=True)
class FieldRequirements(Entries):
    """Requirements on the field: ``[field]``.

    Parameters
    ----------
    omega_max_deg
        Field angle at the rim, 1 to 179 deg.
    omega_min_deg
        Inner end of the required field, 0 to 170 deg; smaller angles are not evaluated.
    object_distance_mm
        Object distance from the mirror, or the nearest and the farthest distance; both are
        evaluated.
    object_plane_distance_mm, object_cylinder_radius_mm
        Alternatively, object surfaces: a plane perpendicular to the axis at this distance from the
        mirror vertex towards the lens, a cylinder about the axis, or both as a room, with the first
        intersection of each chief ray.
    angles
        ``"elevation"``: tables and files contain elevations, according to the mount, instead of
        field angles.

    Raises
    ------
    SpecError
        If the entry is invalid; the message contains the valid values.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.FieldRequirements(omega_max_deg=120.0).omega_max_deg
    120.0
    """

    TABLE: ClassVar[str] = "field"

    omega_max_deg: Annotated[float, Field(ge=1, le=179, description="field angle at the rim")]
    omega_min_deg: Annotated[
        float, Field(ge=0, le=170, description="minimum field angle of interest")
    ] = 0.0
    object_distance_mm: Distances = np.inf
    object_plane_distance_mm: Length | None = None
    object_cylinder_radius_mm: Length | None = None
    angles: Literal["field", "elevation"] = "field"

    @property
    def has_surfaces(self) -> bool:
        """True if the objects are on surfaces, with angle-dependent distances."""
        return (
            self.object_plane_distance_mm is not None or self.object_cylinder_radius_mm is not None
        )


@dataclass(frozen=True, kw_only=True)
class MirrorRequirements(Entries):
    """Requirements on the mirror, a mapping, a family or a freeform mirror: ``[mirror]``.

    Parameters
    ----------
    mapping, family, optimise
        Exactly one of them: a key of ``MAPPINGS``; a key of ``FAMILIES`` or ``"polynomial:N"``; a
        key of ``DESIGN_MERITS``.
    shape
        Shape of an optimised mirror, for example ``"spline:12"``.
    fit
        Fit of a mapping or family, for example ``"polynomial:4"`` or ``"asphere:3"``.
    apex
        ``"pointed"``: the field angle at the image centre is ``omega_min_deg``.
    rim_radius_mm
        Rim radius, a number or a range.
    conic
        Conic constant of a hyperboloid or an ellipsoid, a number or a range.
    plane_distance_mm, cylinder_radius_mm
        Parameters of the ground-plane and the cylinder mapping.
    omega_deg, height : (n,)
        Rows of a tabulated mapping.

    Raises
    ------
    SpecError
        If the entry is invalid; the message contains the valid values.

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
        """True if the field angle at the image centre is ``omega_min_deg`` instead of 0."""
        return self.apex == "pointed" or self.mapping == "cylinder"


@dataclass(frozen=True, kw_only=True)
class LensRequirements(Entries):
    """Requirements on the lens: ``[lens]``.

    Parameters
    ----------
    kind
        ``"perspective"`` or ``"orthographic"`` (telecentric, as wide as the mirror).
    focal_length_mm, theta_max_deg
        Focal length, and viewing angle at the rim, numbers or ranges. For a perspective lens one of
        them is sufficient; the other follows from a rim image that fills the imager.
    f_number
        F-number, a number or a range; for a telecentric lens the image-side working F-number.
    focus_mm
        Focus distance, a number or a range; by default chosen by the design. The minimum object
        distance of a lens is the low end of a range: ``(250, inf)``.
    magnification
        Magnification of an off-the-shelf telecentric lens, a number or a range; by default the rim
        image fills the imager.
    fills
        Imager side that limits the rim image: ``"short-side"`` for a complete image, or
        ``"long-side"``.
    image_circle_mm
        Diameter of the image circle of the lens, the upper limit of the rim image.
    optics
        Real lens, defined by surfaces or a table: ``[lens.optics]`` with the entries of ``[lens]``
        in a sensor file. Its focal length and F-number apply.

    Raises
    ------
    SpecError
        If the entry is invalid; the message contains the valid values.

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
                f"lens.focal_length_mm must be that of lens.optics, {focal:.5g} mm; got {self.focal_length_mm}",
            )
        object.__setattr__(self, "focal_length_mm", focal)
        object.__setattr__(self, "f_number", F)

    @property
    def is_telecentric(self) -> bool:
        return self.kind == "orthographic"

    @property
    def fills_imager(self) -> bool:
        """True if the missing lens parameter is chosen to fill the imager.

        A range limits this parameter.
        """
        if self.is_telecentric:
            return self.magnification is None
        return any(
            value is None or is_free(value) for value in (self.theta_max_deg, self.focal_length_mm)
        )


@dataclass(frozen=True, kw_only=True)
class PartsRequirements(Entries):
    """Off-the-shelf parts, and limits of the whole sensor: ``[parts]``.

    :func:`omnimirror.design_from_parts` uses the lenses, imagers, balls and domes of the catalogue,
    which determine focal length and imager.

    Parameters
    ----------
    catalogue
        File names; by default the bundled catalogue.
    mirror
        ``"made"`` for a mirror according to ``[mirror]``, or ``"ball"`` for a mirror ball of the
        catalogue, cut to the required cap.
    dome
        True for a dome of the catalogue around the mirror.
    extras
        Accessories by their use: ``("heater", "arm")``; the cheapest of each is included in price
        and mass.
    max_price, max_mass_g, max_diameter_mm, max_height_mm
        Limits of the whole sensor. Custom mirrors have no price and the density of aluminium.

    Raises
    ------
    SpecError
        If the entry is invalid; the message contains the valid values.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.PartsRequirements(max_price=200).mirror
    'made'
    """

    TABLE: ClassVar[str] = "parts"

    catalogue: Names = ()
    mirror: Literal["made", "ball"] = "made"
    dome: bool = False
    extras: Names = ()
    max_price: Most | None = None
    max_mass_g: Most | None = None
    max_diameter_mm: Most | None = None
    max_height_mm: Most | None = None


PAPER_IMAGER = Imager(1024, 1024, 5.2)
"""Imager of the prototype in the paper, the default."""
DIGITS = 12  # decimals of elevations, which preserve values such as 12.3 deg
UNNAMED = "design"
"""Default name of a design."""
UPRIGHT = Mount()


@dataclass(frozen=True, kw_only=True)
class Requirements:
    """Requirements on a sensor, with the tables of a requirement file.

    :func:`load_requirements` reads them from a file, :func:`format_requirements` formats a file,
    :func:`~omnimirror.design_sensor` designs a sensor for them, and :func:`~omnimirror.check_requirements`
    checks a sensor against them.

    Parameters
    ----------
    field, mirror, lens
    imager
        Imager; 1024 x 1024 pixels of 5.2 um by default.
    mount
        Orientation of the sensor.
    housing
        Housing of the mirror, which causes obscurations; empty by default.
    limits
        Limits, the ``[[limit]]`` tables of the file.
    parts
        Off-the-shelf parts; none by default.
    thermal
        Thermal properties of the sensor: ``[thermal]`` of the file, as in a sensor file.
    temperatures_c
        Lowest and highest temperature at which the limits apply, ``range_c`` of the file.
    name
        Name of the sensor.
    notes
        Notes on its purpose.

    Raises
    ------
    SpecError
        If the tables are inconsistent; the message contains the reason and the valid values.

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
    housing: Housing = NO_HOUSING
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
        object.__setattr__(
            self,
            "limits",
            tuple(instance("limits", self.limits, (list, tuple), "a list of limits")),
        )
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
        """Largest radius of the rim image permitted by imager and lens, px.

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
        return (
            side
            if lens.image_circle_mm is None
            else min(side, lens.image_circle_mm / 2 / imager.pitch_mm)
        )

    def changed(self, **entries: Any) -> Requirements:
        """Return a copy with other entries of field, mirror and lens.

        Parameters
        ----------
        entries
            New values by entry name.

        Returns
        -------
        Requirements

        Raises
        ------
        SpecError
            If an entry is invalid or inconsistent.
        InvalidParameter
            If the name is not an entry of the three tables.

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
                f"{min(unknown)} must be an entry of [field], [mirror] or [lens]{did_you_mean(min(unknown), ENTRIES)}"
            )
        changed = {
            table: dataclasses.replace(
                getattr(self, table), **{name: entries[name] for name in names & entries.keys()}
            )
            for table, names in NAMES.items()
            if names & entries.keys()
        }
        return dataclasses.replace(self, **changed)

    def tables(self) -> dict[str, Any]:
        """Return the equivalent tables of a requirement file as plain data.

        Returns
        -------
        dict
            Tables and entries of a file.
        """
        lens = dataclasses.replace(self.lens, optics=None)
        parts = {
            name: asdict(part)
            for name, part in {**vars(self), "lens": lens}.items()
            if name in TABLES
        }
        if (optics := self.lens.optics) is not None:
            parts["lens"] |= {
                "optics": lens_table(optics),
                "focal_length_mm": None,
                "f_number": None,
            }
        if self.field.angles == "elevation":
            parts["field"] = self._by_elevation(parts["field"])
        parts["housing"] = housing_tables(self.housing)
        if self.parts is not None:
            parts["parts"] = asdict(self.parts)
        if self.thermal is not None:
            parts["thermal"] = {**asdict(self.thermal), "range_c": self.temperatures_c}
        data = {
            "name": self.name,
            "notes": self.notes,
            **parts,
            "limit": [asdict(limit) for limit in self.limits],
        }
        plain: dict[str, Any] = _plain(data)
        return plain

    def _by_elevation(self, field: dict[str, Any]) -> dict[str, Any]:
        """Return the field table with elevations instead of field angles."""
        omega = field.pop("omega_min_deg"), field.pop("omega_max_deg")
        del field["angles"]
        return {
            "elevation_deg": [round(v, DIGITS) for v in self.mount.elevations_deg(omega)],
            **field,
        }


OF_OPTICS = ("focal_length_mm", "f_number")
"""Entries determined by a real lens."""
TABLES = ("field", "mirror", "lens", "imager", "mount")
NAMES = {
    cls.TABLE: {f.name for f in dataclasses.fields(cls)}
    for cls in (FieldRequirements, MirrorRequirements, LensRequirements)
}
"""Entries of each table; all names are unique."""
ENTRIES = frozenset[str]().union(*NAMES.values())

KINDS: dict[str, type[Any]] = {
    "field": FieldRequirements,
    "mirror": MirrorRequirements,
    "lens": LensRequirements,
    "imager": Imager,
    "mount": Mount,
    "housing": Housing,
    "name": str,
    "notes": str,
}


def _plain(value: Any) -> Any:
    """Convert to data for TOML: lists instead of tuples, without None."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items() if v is not None}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    return value
