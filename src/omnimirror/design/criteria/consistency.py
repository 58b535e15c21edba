"""Consistency checks between the entries and tables of requirements.

Each check raises :class:`~omnimirror.optics.sensor_files.EntryError` with the path of the entry;
the file reader adds its line.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from ...optics.batch.bases import FreeForm
from ...optics.mirrors.generated import MAPPINGS
from ...optics.mirrors.generated.table import check_rows
from ...optics.sensor_files import EntryError, NoFile, did_you_mean
from ..construct.families import FAMILIES
from ..construct.fits import FitForm
from ..construct.mappings import check_entries
from .merits import DESIGN_MERITS
from .ranges import ends

if TYPE_CHECKING:
    from .limits import Limit
    from .requirements import FieldRequirements, LensRequirements, MirrorRequirements, Requirements

WAYS = ("mapping", "family", "optimise")
"""Entries of ``[mirror]`` that select the construction method; exactly one is required."""
OF_PERSPECTIVE = ("focal_length_mm", "theta_max_deg")
OF_MAPPINGS = ("plane_distance_mm", "cylinder_radius_mm", "omega_deg", "height")
"""Entries of ``[mirror]`` required by some mappings."""
OF_CONIC = ("hyperboloid", "ellipsoid")
NOT_OF_FREE_FORM = ("fit", "conic", *OF_MAPPINGS)
SAME_DEG = 1e-9  # tolerance between the ends of a table and of the field
WIDEST_CAMERA = 5.0  # relative to the rim radius


def check_consistency(requirements: Requirements) -> None:
    """Check the consistency of requirements.

    Raises
    ------
    EntryError
        Inconsistent entry; the error contains its path and a message with valid values.
    """
    field, mirror, lens = requirements.field, requirements.mirror, requirements.lens
    if field.omega_min_deg >= field.omega_max_deg:
        raise EntryError(
            ("field", "omega_min_deg"),
            f"field.omega_min_deg = {field.omega_min_deg:g} is not below omega_max_deg = {field.omega_max_deg:g}",
        )
    _check_way(mirror)
    _check_forms(mirror)
    if mirror.mapping is not None:
        _check_mapping(mirror.mapping, mirror, field)
    _check_conic(mirror)
    _check_objects(requirements)
    _check_parts(requirements)
    _check_optics(requirements)
    _check_lens(lens, is_bought=requirements.parts is not None)
    _check_camera(requirements)
    _check_temperatures(requirements)
    _check_limits(requirements.limits, field)


def _check_way(mirror: MirrorRequirements) -> None:
    """Check that the mirror has exactly one, known construction method."""
    ways = [name for name in WAYS if getattr(mirror, name) is not None]
    if len(ways) != 1:
        said = f"both {' and '.join(ways)}" if ways else "neither mapping nor family nor optimise"
        raise EntryError(("mirror",), f"mirror has {said}; give one of them")
    (way,) = ways
    value = getattr(mirror, way)
    known = {"mapping": list(MAPPINGS), "family": [*FAMILIES, "polynomial:N"], "optimise": list(DESIGN_MERITS)}[way]
    if value not in known and not (way == "family" and value.startswith("polynomial:")):
        raise EntryError(
            ("mirror", way),
            f"mirror.{way} = {value!r} is not known{did_you_mean(value, known)}; valid are {', '.join(known)}",
        )


def _check_forms(mirror: MirrorRequirements) -> None:
    """Check fit and shape, and entries restricted to optimised mirrors."""
    for name in ("fit", "family"):
        text = getattr(mirror, name)
        if text is not None and (name == "fit" or ":" in text):
            NoFile().wrap(("mirror", name), partial(FitForm.parse, text))
    if mirror.optimise is None:
        if mirror.shape is not None:
            raise EntryError(("mirror", "shape"), "mirror.shape belongs to an optimised mirror; give optimise too")
        return
    for name in NOT_OF_FREE_FORM:
        if getattr(mirror, name) is not None:
            raise EntryError(("mirror", name), f"mirror.{name} does not apply to an optimised mirror")
    if mirror.apex == "pointed":
        raise EntryError(("mirror", "apex"), "an optimised mirror has a smooth apex")
    if mirror.shape is not None:
        NoFile().wrap(("mirror", "shape"), partial(FreeForm.parse, mirror.shape))


def _check_mapping(mapping: str, mirror: MirrorRequirements, field: FieldRequirements) -> None:
    """Check the parameters of a mapping: complete, applicable and within their ranges."""
    parameters = MAPPINGS[mapping].PARAMETERS
    given = {name: value for name in OF_MAPPINGS if (value := getattr(mirror, name)) is not None}
    names = [*given, "omega_min_deg"] if mirror.is_pointed and field.omega_min_deg > 0 else [*given]
    wrong = next((name for name in given if name not in parameters), "mapping")
    NoFile().wrap(("mirror", wrong), lambda: check_entries(mapping, names))
    for name, value in given.items():
        NoFile().wrap(("mirror", name), partial(parameters[name].check, name, value))
    if mirror.omega_deg is not None and mirror.height is not None:
        omega, height = mirror.omega_deg, mirror.height
        NoFile().wrap(("mirror", "omega_deg"), lambda: check_rows(omega, height))
        if abs(omega[-1] - field.omega_max_deg) > SAME_DEG:
            raise EntryError(
                ("field", "omega_max_deg"),
                f"the table ends at {omega[-1]:g} deg and the field at omega_max_deg = {field.omega_max_deg:g}; "
                "they must agree",
            )
    most = getattr(MAPPINGS[mapping], "MOST_OMEGA_DEG", 180.0)
    if field.omega_max_deg >= most:
        raise EntryError(
            ("field", "omega_max_deg"),
            f"omega_max_deg = {field.omega_max_deg:g} cannot be reached by the {mapping} mapping; "
            f"it is valid below {most:g}",
        )
    radius, rim = mirror.cylinder_radius_mm, ends(mirror.rim_radius_mm)[0]
    if radius is not None and radius <= rim:
        raise EntryError(
            ("mirror", "cylinder_radius_mm"),
            f"cylinder_radius_mm = {radius:g} does not clear the mirror; it is valid above rim_radius_mm = {rim:g}",
        )


def _check_conic(mirror: MirrorRequirements) -> None:
    """Reject an inapplicable conic constant, and mapping parameters for a family."""
    if mirror.optimise is not None:
        return
    way = f"the {mirror.mapping} mapping" if mirror.mapping else f"the family {mirror.family}"
    if mirror.conic is not None and mirror.family not in OF_CONIC:
        belongs = " and ".join(OF_CONIC)
        raise EntryError(("mirror", "conic"), f"mirror.conic does not apply to {way}; it belongs to {belongs}")
    if mirror.family is not None:
        for name in OF_MAPPINGS:
            if getattr(mirror, name) is not None:
                raise EntryError(("mirror", name), f"mirror.{name} does not apply to {way}; it belongs to a mapping")


def _check_camera(requirements: Requirements) -> None:
    """Reject a camera body that is inapplicable or too wide."""
    camera, most = requirements.housing.camera, WIDEST_CAMERA * 2 * ends(requirements.mirror.rim_radius_mm)[1]
    if camera is None:
        return
    if requirements.lens.is_telecentric:
        raise EntryError(
            ("housing.camera",),
            "housing.camera does not apply to an orthographic lens, which may stand anywhere; give omega_min_deg",
        )
    if camera.diameter_mm > most:
        raise EntryError(
            ("housing.camera", "diameter_mm"),
            f"housing.camera.diameter_mm = {camera.diameter_mm:g} is more than {WIDEST_CAMERA:g} times the diameter of "
            f"the mirror; it is valid up to {most:g}",
        )


def _check_temperatures(requirements: Requirements) -> None:
    """Check the temperature range: thermal properties, reference and limits are required."""
    thermal, span = requirements.thermal, requirements.temperatures_c
    if span is None:
        return
    if thermal is None:
        raise EntryError(
            ("thermal",),
            "temperatures are asked for, and nothing is said of how they move the sensor; [thermal] needs a material, "
            "such as mirror_material",
        )
    low, high = span
    if not low <= thermal.reference_c <= high:
        raise EntryError(
            ("thermal", "range_c"),
            f"thermal.range_c = [{low:g}, {high:g}] does not hold reference_c = {thermal.reference_c:g}, at which the "
            "sensor is made; it is valid around that",
        )
    if not requirements.limits:
        raise EntryError(("thermal", "range_c"), "thermal.range_c is about limits, and there is none; give a [[limit]]")


def _check_objects(requirements: Requirements) -> None:
    """Check that the object distance or surface is unique and outside the mirror."""
    field, mirror = requirements.field, requirements.mirror
    if not field.has_surfaces:
        return
    if field.object_distance_mm != np.inf:
        raise EntryError(
            ("field", "object_distance_mm"),
            "field has both object_distance_mm and a surface on which the objects are; give one of them",
        )
    if mirror.optimise is not None:
        raise EntryError(
            ("mirror", "optimise"),
            "mirrors of free form are searched for objects at distances; objects on a surface are valid for a mapping "
            "or a family",
        )
    radius, rim = field.object_cylinder_radius_mm, ends(mirror.rim_radius_mm)[1]
    if radius is not None and radius <= rim:
        raise EntryError(
            ("field", "object_cylinder_radius_mm"),
            f"object_cylinder_radius_mm = {radius:g} does not clear the mirror; it is valid above rim_radius_mm = "
            f"{rim:g}",
        )


def _check_parts(requirements: Requirements) -> None:
    """Check the off-the-shelf parts against the mirror and the housing."""
    parts, mirror, housing = requirements.parts, requirements.mirror, requirements.housing
    if parts is None:
        return
    if mirror.optimise is not None:
        raise EntryError(
            ("mirror", "optimise"),
            "mirrors of free form are not designed for each combination of parts; a mapping or a family is valid, and "
            "free form for the parts that were chosen",
        )
    if parts.mirror == "ball" and (mirror.family != "sphere" or mirror.fit is not None):
        raise EntryError(("parts", "mirror"), 'a ball is valid for mirror.family = "sphere" without a fit')
    if parts.dome and housing.shell is not None:
        raise EntryError(("parts", "dome"), "the housing has a cover already; leave it out, or parts.dome")


def _check_optics(requirements: Requirements) -> None:
    """Reject entries that conflict with a real lens."""
    lens = requirements.lens
    if lens.optics is None:
        return
    if lens.is_telecentric:
        raise EntryError(("lens", "kind"), "lens.kind = 'orthographic' does not apply beside lens.optics, a real lens")
    if requirements.parts is not None:
        raise EntryError(("lens", "optics"), "lens.optics does not apply where lenses are chosen from a catalogue")


def _check_lens(lens: LensRequirements, is_bought: bool = False) -> None:
    if lens.is_telecentric:
        for name in OF_PERSPECTIVE:
            if getattr(lens, name) is not None:
                raise EntryError(("lens", name), f"lens.{name} does not apply to an orthographic lens")
        return
    if lens.magnification is not None:
        raise EntryError(("lens", "magnification"), "lens.magnification belongs to an orthographic lens")
    if lens.focal_length_mm is None and lens.theta_max_deg is None and not is_bought:
        raise EntryError(
            ("lens",), "lens has neither focal_length_mm nor theta_max_deg; give one of them, a number or a range"
        )
    if lens.focus_mm is not None:
        least = 0.0 if lens.focal_length_mm is None else ends(lens.focal_length_mm)[0]
        low, high = ends(lens.focus_mm)
        if low <= 0 or high <= least:
            shown = f"{low:g}" if low == high else f"[{low:g}, {high:g}]"
            raise EntryError(
                ("lens", "focus_mm"),
                f"lens.focus_mm = {shown} is nearer than the focal length; it is valid above {least:g}",
            )


def _check_limits(limits: tuple[Limit, ...], field: FieldRequirements) -> None:
    """Reject limits for parts outside the field, and contradictory limits."""
    for i, limit in enumerate(limits):
        if limit.omega_deg is not None and limit.omega_deg[1] > field.omega_max_deg:
            raise EntryError(
                (f"limit.{i}", "omega_deg"),
                f"limit.omega_deg = {list(limit.omega_deg)} is no part of the field; it needs FROM up to TO, up to "
                f"{field.omega_max_deg:g}",
            )
        for j, other in enumerate(limits[:i]):
            if said := limit.contradicts(other):
                raise EntryError((f"limit.{i}",), f"limit {i + 1} contradicts limit {j + 1}: {said}")
