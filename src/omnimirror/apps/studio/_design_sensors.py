"""Sensors in the Design tab: slider metadata, tables of a sensor file, conversion between kinds of
parts, manual shape editing.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...analysis.evaluation import evaluate
from ...analysis.focus import best_focus
from ...base import quantities
from ...base.errors import InvalidParameter, OmnimirrorError, SpecError
from ...base.parameters import Parameter
from ...base.quantities import Quantity
from ...base.toml_validation import EntryError, NullLocator
from ...base.typing import Array
from ...design.limits import LIMITABLE
from ...design.merits import DESIGN_MERITS
from ...design.mirror_construction import FAMILIES, MountedMirror, RimRay
from ...design.mirror_fits import fit_mirror, similar_mirror
from ...optics.batch.families import FREEFORM_FAMILIES
from ...optics.image_sensor import Imager
from ...optics.lenses import LENSES, GaussianLens, Orthographic, Perspective, TabulatedLens
from ...optics.mirrors import (
    MIRRORS,
    SECONDARIES,
    ConicAsphere,
    EvenPolynomial,
    Mirror,
    SampledProfile,
    Secondary,
    SlopeSpline,
    TabulatedMapping,
)
from ...optics.mirrors.mappings import MAPPINGS
from ...optics.mirrors.mirror import MirrorPose
from ...optics.mirrors.prescribed_mapping import MappingMirror
from ...optics.mirrors.splines import spline_of_slopes
from ...optics.sensor import Sensor
from ...optics.sensor_files import bundled_sensors, sensor_of, tables_of
from .design_messages import (
    ApiError,
    CurveEdit,
    DesignChange,
    DesignSensor,
    DesignStart,
    ParameterInfo,
    PartInfo,
    QuantityInfo,
    distance_of,
)

# -- Slider metadata -------------------------------------------------------------------------------

DISTANCE = Parameter(
    "mm", 1e-3, 1e7, "distance from the principal point of the lens to the mirror vertex (m)"
)


def design_start() -> DesignStart:
    """Return all parts with their parameters, and the quantities available for requirements.

    Examples
    --------
    >>> sphere = next(part for part in design_start().mirrors if part.kind == "sphere")
    >>> [(p.name, p.unit) for p in sphere.parameters]
    [('radius_mm', 'mm'), ('rim_radius_mm', 'mm')]
    """
    distance = _parameter("mirror_distance_mm", DISTANCE, float, dataclasses.MISSING)
    mirrors = dict(MIRRORS.items())  # without mirrors of other packages that fail to load
    return DesignStart(
        mirrors=tuple(part_of(kind, cls) for kind, cls in mirrors.items()),
        secondaries=tuple(
            part_of(kind, SECONDARIES[kind])
            for kind in SECONDARIES
            if kind in mirrors or kind not in MIRRORS
        ),
        lenses=tuple(part_of(kind, cls) for kind, cls in LENSES.items()),
        imager=part_of("imager", Imager),
        secondary_position=part_of("place", Secondary),
        mount=PartInfo(kind="mount", parameters=(distance,)),
        pose=part_of("mirror_pose", MirrorPose),
        columns=tuple(map(_quantity, quantities.FIELD_QUANTITIES)),
        quantities=tuple(_quantity(limitable.quantity) for limitable in LIMITABLE.values()),
        of_frequency=tuple(
            name for name, limitable in LIMITABLE.items() if limitable.of_frequency is not None
        ),
        merits=tuple(_quantity(merit.quantity) for merit in DESIGN_MERITS.values()),
        shapes=tuple(FREEFORM_FAMILIES),
        sensors=tuple(bundled_sensors()),
    )


def _quantity(q: Quantity) -> QuantityInfo:
    return QuantityInfo(
        name=q.name,
        symbol=q.symbol,
        unit=q.unit,
        title=q.title,
        meaning=q.meaning,
        equation=q.equation,
    )


def part_of(kind: str, cls: type[Any]) -> PartInfo:
    """Describe a part from the metadata of its class."""
    hints = typing.get_type_hints(cls)
    fields = {f.name: f for f in dataclasses.fields(cls)}
    parameters: dict[str, Parameter] = cls.PARAMETERS
    matches = [
        _parameter(name, p, hints[name], fields[name].default) for name, p in parameters.items()
    ]
    return PartInfo(kind=kind, parameters=tuple(matches))


def _parameter(name: str, p: Parameter, hint: Any, default: Any) -> ParameterInfo:
    inner = typing.get_args(hint)[0] if isinstance(hint, types.UnionType) else hint
    return ParameterInfo(
        name=name,
        unit=p.unit,
        low=p.low,
        high=p.high,
        description=p.description,
        choices=p.choices,
        is_list=typing.get_origin(inner) is tuple,
        is_integer=inner is int,
        is_optional=default is not dataclasses.MISSING,
        default=float(default) if isinstance(default, int | float) else None,
    )


# -- Tables of a sensor file, and conversion between types of parts --------------------------------

NODES = 25  # samples of a profile, spline or table derived from another mirror
SLOPES = 13
ELLIPSOID_CONIC = -0.4
FITS: dict[type[Mirror], str] = {EvenPolynomial: "polynomial:5", ConicAsphere: "asphere:3"}
FIELD_REDUCTION_DEG = 15.0  # deg below the field angle that a mapping cannot reach
SURFACE_DISTANCE = 10.0  # distance from the mirror to a plane or cylinder, in rim radii
FOCUS_DIGITS = 3  # decimals of the focus distance in mm, finer than lenses can be set
TABLE_ROWS = 9
THETA_DEG = 12.0  # default viewing angle of the lens, deg
NAMED = re.compile(r"(\w+)(?:\[\d+\])? (?:=|has|must) ")
"""First entry that an error message names."""


class Form(NullLocator):
    """Locator of the form entry that an error concerns, also for errors that only name it in their
    message."""

    def error(self, path: tuple[str, ...], message: str) -> SpecError:
        named = NAMED.search(message)
        return EntryError((path[0], named[1]) if named and len(path) == 1 else path, message)


def api_error_of(error: OmnimirrorError) -> ApiError:
    """Return the message of an error with the entry that it concerns."""
    return ApiError(path=getattr(error, "path", ()), message=str(error))


def sensor_from_tables(tables: dict[str, Any], follows: bool = False) -> Sensor:
    """Build the sensor of the tables; ``follows`` adapts the lens to a mapping that requires it.

    Raises
    ------
    EntryError
        If the sensor is invalid; the error contains the entry.
    """
    form = Form()
    mount = tables.get("mount", {})
    if not follows or not isinstance(mount, dict):
        return sensor_of(tables, form)
    mount = {**mount, "mirror_distance_mm": 1.0}  # arbitrary value, replaced by that of the mirror
    sensor = sensor_of({**tables, "mount": mount}, form)
    if not isinstance(sensor.mirror, MappingMirror) or sensor.lens.TELECENTRIC:
        return sensor_of(tables, form)
    distance = sensor.mirror.design_distance
    return form.wrap(
        ("mirror", "theta_max_deg"), lambda: replace(sensor, mirror_distance_mm=distance)
    )


def aligned_sensor(sensor: Sensor) -> Sensor:
    """Return the sensor with mirror and cover aligned to the lens axis, for rotationally symmetric
    quantities."""
    return sensor if sensor.is_axial else sensor.aligned()


def remark_on(sensor: Sensor) -> str | None:
    """Return a remark on properties of a sensor that its plots do not include; None if complete."""
    pose = sensor.mirror_pose
    if pose.is_axial and sensor.is_ideal_except_pose:
        return None
    if pose.is_axial:
        return (
            "The file contains a form error of the mirror or a tilt of the imager. Only the image of the "
            "room includes them; cross-section, plots and requirements are those of the ideal sensor."
        )
    shift, tilt = (
        f"{a:g} and {b:g}"
        for a, b in ((pose.decentre_x_mm, pose.decentre_y_mm), (pose.tilt_x_deg, pose.tilt_y_deg))
    )
    return (
        f"The mirror is misaligned: decentred by {shift} mm, tilted by {tilt}°. Only the image of the room "
        "includes this; cross-section, plots and requirements are those of the aligned mirror."
    )


def why_not_optimised(sensor: Sensor) -> str | None:
    """Return the reason why the mirror cannot be optimised; None if it can."""
    if sensor.secondary is not None:
        return "Optimisation requires a sensor with one mirror; this sensor has two."
    if not sensor.mirror_pose.is_axial:
        return "Optimisation requires an aligned mirror; this one is decentred or tilted."
    if not sensor.is_ideal_except_pose:
        return (
            "Optimisation requires an ideal sensor; this one has a form error or a tilted imager."
        )
    return None


def tables_from_sensor(sensor: Sensor) -> DesignSensor:
    """Convert a sensor to its representation in the Design tab."""
    mirror = sensor.mirror
    is_mapped = (
        isinstance(mirror, MappingMirror)
        and sensor.secondary is None
        and not sensor.lens.TELECENTRIC
    )
    follows = is_mapped and np.isclose(mirror.design_distance, sensor.mirror_distance_mm, rtol=1e-9)  # type: ignore[attr-defined]  # is_mapped implies a MappingMirror
    return DesignSensor(tables=tables_of(sensor), follows_mapping=bool(follows))


def changed(change: DesignChange) -> Sensor:
    """Return the sensor with another kind of mirror or lens, or at its best focus.

    A new mirror keeps the radius and viewing angle of the rim, and the field if its kind can reach
    it; kinds with many parameters, and mirrors of other packages, approximate the previous shape.

    Raises
    ------
    OmnimirrorError
        If the kind is unknown, or does not support this field.
    """
    current, distance = sensor_from_tables(change.tables), distance_of(change.object_distance_mm)
    sensor = aligned_sensor(current)
    if change.target == "focus":
        best = best_focus(sensor, change.to, object_distance_mm=distance)
        focused = replace(sensor, lens=sensor.lens.focused_at(round(best.focus_mm, FOCUS_DIGITS)))
    else:
        changed_part = (
            _with_lens(sensor, change.to)
            if change.target == "lens"
            else _with_mirror(sensor, change.to)
        )
        focused = _focused(changed_part, distance)
    return replace(
        focused, mirror_pose=current.mirror_pose, housing=current.housing, thermal=current.thermal
    )


def _with_mirror(sensor: Sensor, kind: str) -> Sensor:
    if kind not in MIRRORS:
        raise InvalidParameter(f"mirror must be one of {', '.join(MIRRORS)}; got {kind!r}")
    mounted = recast(sensor, kind)
    distance = np.inf if sensor.lens.TELECENTRIC else mounted.distance_mm
    return replace(
        sensor,
        mirror=mounted.mirror,
        mirror_distance_mm=distance,
        secondary=None,
        name=kind,
        notes="",
    )


def recast(sensor: Sensor, kind: str) -> MountedMirror:
    """Return a mirror of another kind with the same rim.

    >>> import omnimirror as om
    >>> mounted = recast(om.load_sensor("paper-spherical"), "hyperboloid")
    >>> round(mounted.mirror.a_mm / 43.9, 3), round(mounted.distance_mm / 43.9, 3)  # Table 1: 0.7407, 3.550
    (0.741, 3.55)
    """
    rim = rim_of(sensor)
    cls = MIRRORS[kind]
    if kind in FAMILIES:
        return FAMILIES[kind](rim, ELLIPSOID_CONIC if kind == "ellipsoid" else None)
    if cls in AS_BEFORE:
        return rim.place(AS_BEFORE[cls](sensor, rim))
    if cls in FITS:
        return fit_mirror(rim.place(sensor.mirror), FITS[cls]).mounted
    if kind in MAPPINGS:
        mirror = _mapped(cls, rim)
        return MountedMirror(mirror, mirror.design_distance)
    return rim.place(similar_mirror(cls, sensor.mirror))


def rim_of(sensor: Sensor) -> RimRay:
    """Return field angle, viewing angle and radius of the rim of a sensor."""
    theta = 0.0 if sensor.lens.TELECENTRIC else float(np.degrees(sensor.meridian.theta_max))
    omega = sensor.field_deg[1]
    return RimRay(round(omega, 6), round(theta, 6), sensor.mirror.rim_radius_mm)


def _mapped(cls: type[Any], rim: RimRay) -> MappingMirror:
    """Return a prescribed-mapping mirror over the part of the field that its mapping reaches."""
    M, max_omega_deg = rim.rim_radius_mm, cls.MAX_OMEGA_DEG
    omega = (
        rim.omega_max_deg
        if rim.omega_max_deg < max_omega_deg
        else max_omega_deg - FIELD_REDUCTION_DEG
    )
    own = {
        "plane_distance_mm": SURFACE_DISTANCE * M,
        "cylinder_radius_mm": SURFACE_DISTANCE * M,
        "omega_min_deg": omega / 3,
    }
    needed = [
        name for name in ("plane_distance_mm", "cylinder_radius_mm") if name in cls.PARAMETERS
    ]
    if "cylinder_radius_mm" in needed:
        needed.append("omega_min_deg")
    mapped: MappingMirror = cls(
        omega, rim.theta_max_deg, rim_radius_mm=M, **{name: own[name] for name in needed}
    )
    return mapped


def _sampled(sensor: Sensor, rim: RimRay) -> Mirror:
    x = np.linspace(0.0, rim.rim_radius_mm, NODES)
    apex = "pointed" if sensor.mirror.is_pointed else "smooth"
    return SampledProfile(tuple(x), tuple(sensor.mirror.sag(x)), apex=apex)


def spline_like(sensor: Sensor) -> SlopeSpline:
    """Convert the mirror to a slope spline; a slope spline is returned unchanged."""
    mirror, rim = sensor.mirror, sensor.mirror.rim_radius_mm
    return (
        mirror
        if isinstance(mirror, SlopeSpline)
        else SlopeSpline(tuple(mirror.slope(np.linspace(0.0, rim, SLOPES))), rim)
    )


def mapping_like(sensor: Sensor) -> TabulatedMapping:
    """Convert the mapping to a table at equidistant image heights; a table is returned unchanged."""
    if isinstance(sensor.mirror, TabulatedMapping):
        return sensor.mirror
    rim = rim_of(sensor)
    top = sensor.rim_radius_px
    low = float(sensor.image_height_px(sensor.meridian.trace([sensor.meridian.x_min]))[0])
    rays = sensor.meridian.trace(sensor.x_from_height_px(np.linspace(low, top, NODES)))
    omega, height = np.degrees(rays.omega), np.linspace(0.0, 100.0, NODES)
    return TabulatedMapping(tuple(omega), tuple(height), rim.theta_max_deg, rim.rim_radius_mm)


AS_BEFORE: dict[type[Mirror], Callable[[Sensor, RimRay], Mirror]] = {
    SampledProfile: _sampled,
    SlopeSpline: lambda sensor, rim: spline_like(sensor),
    TabulatedMapping: lambda sensor, rim: mapping_like(sensor),
}
"""Functions of the freeform kinds that approximate the previous mirror."""


def _as_table(sensor: Sensor) -> TabulatedLens:
    """Return the lens as a table that extends slightly beyond the rim."""
    lens = sensor.lens
    if not isinstance(lens, GaussianLens):
        raise InvalidParameter(
            "a lens table requires a lens with an entrance pupil; choose perspective first"
        )
    angles = np.linspace(
        0.0, min(1.1 * float(np.degrees(sensor.meridian.theta_max)), 80.0), TABLE_ROWS
    )
    tangent = np.tan(np.radians(angles))
    heights = np.abs(lens.distorted_height(lens.principal_distance * tangent))
    return TabulatedLens(
        lens.focal_length_mm,
        lens.f_number,
        lens.focus_distance_mm,
        tuple(np.round(angles, 6)),
        tuple(np.round(heights, 6)),
        tuple(np.round(lens.pupil.position(tangent), 6)),
        principal_point_mm=lens.principal_point_mm,
    )


def _with_lens(sensor: Sensor, kind: str) -> Sensor:
    """Return the sensor with another kind of lens and the same image size of the rim."""
    if kind == sensor.lens.KIND:
        return sensor
    M, height = sensor.mirror.rim_radius_mm, sensor.rim_radius_px * sensor.imager.pitch_mm
    F = sensor.lens.image_f_number()
    if kind == "orthographic":
        telecentric = Orthographic(round(height / M, 6), round(F, 3), 0.0)
        return replace(sensor, lens=telecentric, mirror=_for_theta(sensor.mirror, 0.0))
    if kind == "table":
        return replace(sensor, lens=_as_table(sensor))
    if kind == "surfaces":
        raise InvalidParameter(
            "a lens defined by surfaces requires a .zmx file; open a sensor file that references it"
        )
    if kind != "perspective":
        raise InvalidParameter(f"lens must be one of {', '.join(LENSES)}; got {kind!r}")
    mirror = _for_theta(sensor.mirror, THETA_DEG)
    distance = M / np.tan(np.radians(THETA_DEG)) - float(mirror.sag(M))
    focal = 1 / (np.tan(np.radians(THETA_DEG)) / height + 1 / distance)
    f_number = F * focal / height * np.tan(np.radians(THETA_DEG))
    lens = Perspective(round(float(focal), 4), round(float(f_number), 3), float(distance))
    return replace(sensor, lens=lens, mirror=mirror, mirror_distance_mm=float(distance))


def _for_theta(mirror: Mirror, theta_deg: float) -> Mirror:
    """Solve a prescribed-mapping mirror for another viewing angle; other mirrors are returned
    unchanged."""
    if isinstance(mirror, MappingMirror):
        return replace(mirror, theta_max_deg=theta_deg)  # type: ignore[type-var]  # all implementations are dataclasses
    return mirror


def _focused(sensor: Sensor, object_distance_mm: float) -> Sensor:
    """Return the sensor at its best focus, or unchanged if none exists (the evaluation reports the
    reason)."""
    try:
        best = best_focus(sensor, object_distance_mm=object_distance_mm)
    except OmnimirrorError:
        return sensor
    return replace(sensor, lens=sensor.lens.focused_at(round(best.focus_mm, FOCUS_DIGITS)))


# -- Manual shape editing --------------------------------------------------------------------------

CLEAR = 0.02
"""Minimum distance from fixed curve ends, relative to the rim radius or the field."""


def edited_sensor(sensor: Sensor, edit: CurveEdit) -> Sensor:
    """Deform the mirror so that its profile or mapping passes through a given point.

    Deformations minimise curvature: the profile bends as a rod clamped at the vertex, the mapping
    as a beam supported at the image centre and the rim. The result is a freeform mirror or a
    tabulated mapping.

    Raises
    ------
    InvalidParameter
        If the sensor has two mirrors or a misaligned mirror, the point is too close to a fixed end,
        or no mirror is feasible.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> flatter = edited_sensor(sphere, CurveEdit(of="profile", at=30.0, to=9.9))
    >>> round(float(flatter.mirror.sag(30.0)), 9), round(float(sphere.mirror.sag(30.0)), 3)
    (9.9, 10.01)
    """
    if (reason := why_not_optimised(sensor)) is not None:
        raise InvalidParameter(reason)
    return (_profile if edit.of == "profile" else _mapping)(sensor, edit.at, edit.to)


def _profile(sensor: Sensor, x_mm: float, z_mm: float) -> Sensor:
    rim = sensor.mirror.rim_radius_mm
    if not CLEAR * rim <= x_mm <= rim * (1 + 1e-9):
        raise InvalidParameter(
            f"the profile can be dragged from {CLEAR * rim:.4g} to {rim:g} mm from the axis; got {x_mm:g} mm"
        )
    before = spline_like(sensor)
    slopes, held = np.array(before.slopes), min(x_mm / rim, 1.0)
    rod = _rod_slope(np.linspace(0.0, 1.0, len(slopes)), held)
    unit = _sag(slopes + rod, held) - _sag(slopes, held)  # the sag is linear in the slopes
    pulled = z_mm / rim - _sag(slopes, held)
    return replace(sensor, mirror=SlopeSpline(tuple(slopes + pulled / unit * rod), rim))


def _rod_slope(u: Array, held: float) -> Array:
    """Return the slope (n,), up to a factor, of a rod clamped at 0 and loaded at ``held``; straight
    beyond."""
    return np.where(u < held, u * (2 * held - u), held**2)


def _sag(slopes: Array, u: float) -> float:
    """Return the sag of the slope spline at u, in rim radii."""
    sag = spline_of_slopes(slopes).antiderivative()
    return float(sag(u) - sag(0.0))


def _mapping(sensor: Sensor, omega_deg: float, height_px: float) -> Sensor:
    low, high = sensor.field_deg
    first, last = (low + fraction * (high - low) for fraction in (CLEAR, 1 - CLEAR))
    if not first <= omega_deg <= last:
        raise InvalidParameter(
            f"the mapping can be dragged from {first:.4g} to {last:.4g} deg; got {omega_deg:g} deg"
        )
    rim_px = sensor.rim_radius_px
    if not 0 < height_px < rim_px:
        raise InvalidParameter(
            f"the image height must be between 0 and {rim_px:.4g} px; got {height_px:.4g} px"
        )
    table = mapping_like(sensor)
    omega, tau = np.array(table.omega_deg), np.array(table.height) / table.height[-1]
    beam = _beam(omega - low, omega_deg - low, high - low)
    x = [evaluate(sensor, [omega_deg]).x_mm[0], sensor.x_from_height_px(np.array([height_px]))[0]]
    now, target = _shares(sensor, np.array(x))
    _check_grows(np.diff(tau), np.diff(beam), target - now, omega_deg)
    mirror = replace(table, height=tuple(tau + (target - now) * beam))
    return replace(sensor, mirror=mirror, mirror_distance_mm=mirror.design_distance)


def _beam(x: Array, held: float, length: float) -> Array:
    """Return the deflection (n,) of a beam supported at 0 and ``length``, normalised to 1 at
    ``held``."""
    rest = length - held
    near = rest * x * (length**2 - rest**2 - x**2)
    far = held * (length - x) * (length**2 - held**2 - (length - x) ** 2)
    return np.where(x <= held, near, far) / (2 * held**2 * rest**2)


def _shares(sensor: Sensor, x_mm: Array) -> Array:
    """Return the relative image heights of mirror points (n,) as used by mappings: tan(theta) or x
    over the rim value."""
    if sensor.lens.TELECENTRIC:
        return x_mm / sensor.mirror.rim_radius_mm
    shares: Array = np.tan(sensor.meridian.trace(x_mm).first.theta) / np.tan(
        np.radians(rim_of(sensor).theta_max_deg)
    )
    return shares


def _check_grows(steps: Array, beam: Array, pulled: float, omega_deg: float) -> None:
    """Reject a deformation after which the image height no longer increases with the field angle."""
    if np.all(steps + pulled * beam > 0):
        return
    side = np.sign(pulled)
    against = side * beam < 0
    maximum = float(np.min(steps[against] / np.abs(beam[against])))
    raise InvalidParameter(
        f"the image height must increase with the field angle; a change of {pulled:+.3g} "
        f"times the image height of the rim at {omega_deg:.4g} deg violates this; the "
        f"limit is {side * maximum:+.3g}"
    )
