"""Requirement check of a sensor: requested value, reached value and margin of each requirement.

Requirements are checked over the evaluated field: field angles, object distances and truncation by
the image circle. The same check determines the temperature range in which a sensor meets all
requirements.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from ..analysis.evaluation import Evaluation, evaluate
from ..analysis.operating_conditions import at_temperature
from ..base.arguments import instance, integer, validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import json_plain
from ..base.quantities import format_part
from ..base.results import Columns, Result, table_of
from ..base.typing import Array
from ..optics.housing import NO_HOUSING
from ..optics.lenses import GaussianLens
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.meridian import ChiefRays
from .limits import SHARED, Limit
from .merits import FieldValues, values_of_evaluation
from .requirements import MAX_FOCUS, FieldRequirements, Requirements, ends, ends_or_none

# -- Evaluated field -------------------------------------------------------------------------------

POINTED_CENTRE = 0.1  # relative to the image radius; the azimuthal scale vanishes at the point
NO_PART = 1e-6  # deg; smaller exclusions are not reported


class EvaluatedRange(NamedTuple):
    """Evaluated field angles in degrees, and descriptions of the excluded ones."""

    low_deg: float
    high_deg: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class EvaluableField:
    """Field of a sensor and its evaluable part.

    Attributes
    ----------
    low_deg, high_deg
        Field of view of the mirror.
    required_deg
        Required field.
    obscured_to_deg
        Upper end of the central obscuration by the housing; 0 without one.
    obscured_from_deg
        Lower end of the outer obscuration; the end of the field without one.
    point_deg
        Upper end of the excluded centre of a pointed mirror; 0 for a smooth mirror.
    obscuring_part
        Part that causes the central obscuration.
    """

    low_deg: float
    high_deg: float
    required_deg: tuple[float, float]
    obscured_to_deg: float
    obscured_from_deg: float
    point_deg: float
    obscuring_part: str

    def part(self, asked_deg: tuple[float, float] | None = None) -> EvaluatedRange:
        """Return the evaluated range of a part of the field, or of the whole required field.

        Raises
        ------
        InvalidParameter
            If the range is empty.
        """
        begins = [
            (self.low_deg, "outside the field of the mirror"),
            (self.obscured_to_deg, f"obscured by the {self.obscuring_part}"),
        ]
        begins += [(self.point_deg, "singular at the apex of a pointed mirror")]
        if asked_deg is None:
            begins += [(self.required_deg[0], "below omega_min_deg")]
        first, last = asked_deg or (0.0, self.required_deg[1])
        begin, reason = max(begins, key=lambda b: b[0])
        low, high = max(first, begin), min(last, self.obscured_from_deg)
        if high < low <= high + NO_PART:  # the end of the field, shifted by rounding
            low = high
        if asked_deg is None and begin > self.required_deg[0]:
            first = self.required_deg[0]  # angles below are not required
        left_out = (
            [f"{first:.4g} to {low:.4g} deg is not evaluated: {reason}"]
            if low > first + NO_PART
            else []
        )
        if high < last - NO_PART:
            left_out.append(f"{high:.4g} to {last:.4g} deg is not evaluated: {self._end}")
        if low > high or (low == high and first < last):
            part = f"from {first:g} to {last:g} deg" if asked_deg else "of the field"
            explanation = (
                f"{reason}, up to {begin:.4g} deg"
                if low > first
                else f"the field ends at {self.obscured_from_deg:.4g} deg"
            )
            raise InvalidParameter(f"no field angle {part} can be evaluated: {explanation}")
        return EvaluatedRange(low, high, tuple(left_out))

    @property
    def _end(self) -> str:
        """Reason for the upper end of the evaluated field."""
        hidden = self.obscured_from_deg < self.high_deg
        return "obscured by the housing" if hidden else "end of the field of the mirror"


def evaluable_field(field: FieldRequirements, sensor: Sensor) -> EvaluableField:
    """Return the evaluable field of a sensor, limited by the obscurations of its housing.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> sensor = replace(load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    >>> round(evaluable_field(FieldRequirements(omega_max_deg=135), sensor).obscured_to_deg, 2)
    8.43
    """
    low, high = sensor.field_deg
    clear, hidden_from = sensor.clear_field_deg
    point = 0.0
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(
            sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px])
        )
        point = float(np.degrees(edge.omega[0]))
    inner = [ring for ring in sensor.obscurations if ring.omega_deg[0] <= low]
    obscuring_part = max(inner, key=lambda ring: ring.omega_deg[1], default=None)
    return EvaluableField(
        low,
        high,
        (field.omega_min_deg, field.omega_max_deg),
        clear if obscuring_part else 0.0,
        hidden_from,
        point,
        obscuring_part.part if obscuring_part else "camera",
    )


# -- Object distances: fixed distances from the mirror, or intersections of rays with surfaces -----


def inverse_distances(field: FieldRequirements, x: Array, z: Array, omega: Array) -> Array:
    """Return inverse distances (1, k), 1/mm, to the first object surface.

    The rays start from points (k,) at field angles (k,) in radians. The distance of a ray without an
    intersection is infinite.

    >>> room = FieldRequirements(omega_max_deg=120, object_plane_distance_mm=700, object_cylinder_radius_mm=2000)
    >>> (1 / inverse_distances(room, np.zeros(3), np.zeros(3), np.radians([0.0, 60.0, 90.0]))).round(6)
    array([[ 700., 1400., 2000.]])
    """
    nearest = np.zeros_like(omega)
    for inverse in _surfaces(field, x, z, omega):
        nearest = np.where(inverse.real > nearest.real, inverse, nearest)
    return np.atleast_2d(nearest)


def distances_mm(field: FieldRequirements) -> tuple[float, ...]:
    """Return the distinct object distances."""
    return tuple(sorted(set(ends(field.object_distance_mm))))


def distances_of(field: FieldRequirements, rays: ChiefRays) -> list[Any]:
    """Return the distances from the mirror points of chief rays (k,) to the objects, mm: a number
    or an array (k,) for each object distance; with a cover, along the optical path.
    """
    if not field.has_surfaces:
        return list(distances_mm(field))
    x, z = rays.last
    with np.errstate(divide="ignore"):
        onward = 1 / inverse_distances(field, x, z, rays.omega)[0]
    return [onward + (0.0 if rays.outside is None else rays.outside.inside)]


def _surfaces(field: FieldRequirements, x: Array, z: Array, omega: Array) -> list[Array]:
    """Return 1/p for each surface; 0 or negative for a ray without an intersection."""
    surfaces = []
    if field.object_plane_distance_mm is not None:
        surfaces.append(np.cos(omega) / (field.object_plane_distance_mm + z))
    if field.object_cylinder_radius_mm is not None:
        surfaces.append(np.sin(omega) / (field.object_cylinder_radius_mm - x))
    return surfaces


# -- Truncation of the image circle by an imager smaller than the circle ---------------------------

AZIMUTHS = 7200


def cut_off(sensor: Sensor) -> tuple[str, ...]:
    """Return a remark on the truncated part of the image circle; empty if the circle is complete.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.image_sensor import Imager
    >>> cut_off(replace(om.load_sensor("paper-spherical"), imager=Imager(1024, 576, 5.2)))[0]  # doctest: +ELLIPSIS
    'the rim is on the imager for 38.9% of the azimuths; ...'
    """
    rim, (u, v) = sensor.rim_radius_px, sensor.imager.centre
    width, height = sensor.imager.size
    edges = np.array([width - 1 - u, height - 1 - v, u, v]) + 0.5  # right, bottom, left, top
    if rim <= edges.min() + EDGE_PX:
        return ()
    azimuth = (np.arange(AZIMUTHS) + 0.5) * (2 * np.pi / AZIMUTHS)
    towards = np.stack([np.cos(azimuth), np.sin(azimuth), -np.cos(azimuth), -np.sin(azimuth)])
    with np.errstate(divide="ignore"):
        edge = np.where(towards > 0, edges[:, None] / towards, np.inf).min(axis=0)
    visible = np.minimum(edge, rim)
    mirror_x = sensor.x_from_height_px([max(float(visible.min()), _first_radius_px(sensor))])
    omega_deg = float(np.degrees(sensor.meridian.trace(mirror_x).omega[0]))
    whole = (edge >= rim - EDGE_PX).mean()
    return (
        f"the rim is on the imager for {whole:.1%} of the azimuths; at the nearest edge the field ends at "
        f"{omega_deg:.4g} deg; {1 - (visible**2).mean() / rim**2:.1%} of the circle is outside the imager",
    )


def _first_radius_px(sensor: Sensor) -> float:
    """Return the image radius of the inner end of the field."""
    return float(
        sensor.image_height_px(sensor.meridian.trace(np.array([sensor.meridian.x_min])))[0]
    )


# -- Requirements and their margins ----------------------------------------------------------------

ROUNDING = 1e-6  # relative tolerance of margins
EDGE_PX = 0.02  # tolerance at the edge of the outermost pixel
REPORTED, MAX_ANGLES = 1001, 100_000  # field angles


@dataclass(frozen=True)
class RequirementCheck:
    """Check of one requirement.

    Attributes
    ----------
    name
        Quantity, or entry of the requirement file.
    unit
    at_least, at_most
        Requested bounds; None if unbounded.
    reached
    omega_deg
        Field angle of the worst value, if applicable.
    part_deg
        Evaluated part of the field, if it is not the whole field.
    is_limit
        True for a ``[[limit]]``, False for a given entry.
    tolerance
        Permitted excess over the limit: the uncertainty of the edge of the outermost pixel.
    remarks
        Excluded parts of the field with reasons, and contributions that exceed the limit by
        themselves.
    """

    name: str
    unit: str
    at_least: float | None
    at_most: float | None
    reached: float
    omega_deg: float | None = None
    part_deg: tuple[float, float] | None = None
    is_limit: bool = False
    tolerance: float = 0.0
    remarks: tuple[str, ...] = ()

    @property
    def margin(self) -> float:
        """Distance to the limit; negative only for a missed requirement."""
        return max(self._difference, 0.0) if self.is_met else self._difference

    @property
    def _difference(self) -> float:
        """Margin without the tolerance."""
        sides = [self.reached - self.at_least] if self.at_least is not None else []
        sides += [self.at_most - self.reached] if self.at_most is not None else []
        return min(sides)

    @property
    def scale(self) -> float:
        """Magnitude of the requested value, the unit for comparing margins."""
        limits = [abs(v) for v in (self.at_least, self.at_most) if v is not None]
        return max(limits) or 1.0

    @property
    def is_met(self) -> bool:
        return self._difference >= -max(ROUNDING * self.scale, self.tolerance)

    @property
    def shortfall(self) -> float:
        """Relative violation; negative if the requirement is met."""
        return -self._difference / self.scale

    @property
    def label(self) -> str:
        """Name with the part of the field."""
        return self.name + format_part(self.part_deg)


@dataclass(frozen=True)
class Verdict(Result):
    """Requirement check of a sensor.

    Attributes
    ----------
    rows
        One row for each requirement; limits last, in their order.
    """

    requirements: Requirements
    sensor: Sensor
    rows: tuple[RequirementCheck, ...]

    def _table(self) -> Columns:
        rows = self.to_dict()["requirements"]
        return table_of(
            {name: value for name, value in row.items() if not isinstance(value, list)}
            for row in rows
        )

    @property
    def is_met(self) -> bool:
        """True if all requirements are met."""
        return not self.missed

    @property
    def missed(self) -> tuple[str, ...]:
        """Labels of the missed requirements."""
        return tuple(row.label for row in self.rows if not row.is_met)

    @property
    def limits(self) -> tuple[RequirementCheck, ...]:
        """Rows of the limits."""
        return tuple(row for row in self.rows if row.is_limit)

    @property
    def worst(self) -> float:
        """Largest relative violation; 0 if all requirements are met."""
        return max((row.shortfall for row in self.rows if not row.is_met), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain data for JSON."""
        rows = [{**asdict(row), "margin": row.margin, "is_met": row.is_met} for row in self.rows]
        data: dict[str, Any] = json_plain(
            {"name": self.sensor.name, "is_met": self.is_met, "requirements": rows}
        )
        return data


def unit_of(name: str) -> str:
    """Return the unit in the name of an entry.

    >>> unit_of("rim_radius_mm"), unit_of("f_number")
    ('mm', '')
    """
    return next((unit for unit in ("deg", "mm", "px") if name.endswith(f"_{unit}")), "")


def check_requirements(
    requirements: Requirements, sensor: Sensor, *, angles: int = REPORTED
) -> Verdict:
    """Check a sensor against requirements at its own focus.

    The check concerns the properties of the sensor, not its construction: mapping, family and fit
    have no rows.

    Parameters
    ----------
    requirements, sensor
        Requirements and sensor; a sensor without a housing or thermal properties is checked with
        those of the requirements.
    angles
        Number of field angles, 2 to 100000, for each limit in each part of the field.

    Returns
    -------
    Verdict
        One row for the field, the imager, each given number of mirror and lens, and each limit, in
        this order.

    Raises
    ------
    InvalidParameter
        If the lens is of another kind, or a limit applies to a part of the field without a view.

    Examples
    --------
    The sphere of the paper covers 135 deg but exceeds the limit of blur:

    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=(40, 50)),
    ...     lens=om.LensRequirements(focal_length_mm=11.6),
    ...     limits=[om.Limit("total_blur_px", at_most=3.0)],
    ... )
    >>> verdict = om.check_requirements(requirements, om.load_sensor("paper-spherical"))
    >>> verdict.is_met, verdict.missed
    (False, ('total_blur_px',))
    >>> blur = verdict.limits[0]
    >>> round(blur.reached, 2), round(blur.margin, 2), round(blur.omega_deg)
    (8.96, -5.96, 135)
    """
    instance("requirements", requirements, Requirements, "requirements")
    check_sensor(sensor)
    angles = integer("angles", angles, 2, MAX_ANGLES)
    if requirements.lens.is_telecentric != sensor.lens.TELECENTRIC:
        raise InvalidParameter(
            f"the lens of the sensor must be {requirements.lens.kind}, as in the requirements; got {sensor.lens.KIND}"
        )
    if sensor.housing == NO_HOUSING:
        sensor = replace(sensor, housing=requirements.housing)
    if sensor.thermal is None:
        sensor = replace(sensor, thermal=requirements.thermal)
    rows = [
        *given_rows(requirements, sensor),
        *_limits_over_temperatures(requirements, sensor, angles),
    ]
    return Verdict(requirements, sensor, tuple(rows))


def given_rows(requirements: Requirements, sensor: Sensor) -> list[RequirementCheck]:
    """Return the rows of all requirements except limits: field, imager and given numbers."""
    return [*_field_rows(requirements, sensor), *_part_rows(requirements, sensor)]


def _field_rows(requirements: Requirements, sensor: Sensor) -> list[RequirementCheck]:
    field, counted = requirements.field, evaluable_field(requirements.field, sensor)
    low, high = sensor.field_deg[0], counted.obscured_from_deg
    rows = [RequirementCheck("omega_max_deg", "deg", field.omega_max_deg, None, high)]
    if field.omega_min_deg > 0 or low > 0:  # otherwise obscuration by the housing is permitted
        begin = max(low, counted.obscured_to_deg)
        rows.append(RequirementCheck("omega_min_deg", "deg", None, field.omega_min_deg, begin))
    return rows


def _part_rows(requirements: Requirements, sensor: Sensor) -> list[RequirementCheck]:
    """Return the rows of mirror, lens and imager."""
    lens, largest = requirements.lens, requirements.largest_image_px
    rows = [
        RequirementCheck(
            "rim_radius_mm",
            "mm",
            *ends(requirements.mirror.rim_radius_mm),
            sensor.mirror.rim_radius_mm,
        ),
        RequirementCheck(
            "image_radius_px",
            "px",
            None,
            largest,
            sensor.rim_radius_px,
            tolerance=EDGE_PX,
            remarks=cut_off(sensor),
        ),
    ]
    optics = sensor.lens
    if isinstance(optics, GaussianLens):
        reached = {"focal_length_mm": optics.focal_length_mm, "f_number": optics.stop_number}
        reached["theta_max_deg"] = float(np.degrees(sensor.meridian.theta_max))
    else:
        reached = {
            "f_number": optics.stop_number,
            "magnification": float(getattr(optics, "magnification", np.nan)),
        }
    reached["focus_mm"] = optics.focus_distance_mm
    for name, value in reached.items():
        span = ends_or_none(getattr(lens, name))
        if span is not None:
            maximum = None if span[0] < span[1] == MAX_FOCUS else span[1]
            rows.append(RequirementCheck(name, unit_of(name), span[0], maximum, value))
    return rows


def _limits_over_temperatures(
    requirements: Requirements, sensor: Sensor, angles: int
) -> list[RequirementCheck]:
    """Return the rows of the limits at their smallest margins over the temperatures."""
    rows = _limit_rows(requirements, sensor, angles)
    for temperature in requirements.temperatures_c or ():
        there = _limit_rows(requirements, at_temperature(sensor, temperature), angles)
        remark = f"smallest margin at {temperature:g} C"
        rows = [
            replace(moved, remarks=(*moved.remarks, remark)) if moved.margin < row.margin else row
            for row, moved in zip(rows, there, strict=True)
        ]
    return rows


def _limit_rows(requirements: Requirements, sensor: Sensor, angles: int) -> list[RequirementCheck]:
    """Return the rows of the limits, each at its worst field angle and object distance."""
    counted = evaluable_field(requirements.field, sensor)
    parts = {limit.omega_deg: counted.part(limit.omega_deg) for limit in requirements.limits}
    omega = [np.linspace(part.low_deg, part.high_deg, angles) for part in parts.values()]
    results = evaluations(requirements, sensor, np.concatenate(omega)) if omega else []
    where = {part: slice(i * angles, (i + 1) * angles) for i, part in enumerate(parts)}
    fields = [values_of_evaluation(result) for result in results]
    rows = []
    for limit in requirements.limits:
        own = [
            (field.part(where[limit.omega_deg]), r.omega_deg[where[limit.omega_deg]])
            for field, r in zip(fields, results, strict=True)
        ]
        rows.append(_limit_row(limit, own, _remarks(limit, own, sensor, parts[limit.omega_deg])))
    return rows


def _limit_row(
    limit: Limit, fields: list[tuple[FieldValues, Array]], remarks: tuple[str, ...]
) -> RequirementCheck:
    """Return the row of one limit from the field values of each object distance."""
    sides = [(True, limit.at_most)] if limit.at_most is not None else []
    sides += [(False, limit.at_least)] if limit.at_least is not None else []
    rows = []
    for largest, _ in sides:
        extremes = [(*limit.of.extreme(field, largest), omega) for field, omega in fields]
        value = (max if largest else min)(v for v, _, _ in extremes)
        where = [
            omega[i]
            for v, i, omega in extremes
            if i is not None and abs(v - value) <= SHARED * abs(value)
        ]
        at = float(min(where)) if where else None
        limits = (limit.at_least, limit.at_most)
        rows.append(
            RequirementCheck(
                limit.name,
                limit.of.unit,
                *limits,
                value,
                at,
                limit.omega_deg,
                True,
                remarks=remarks,
            )
        )
    return min(rows, key=lambda row: row.margin)


def _remarks(
    limit: Limit, fields: list[tuple[FieldValues, Array]], sensor: Sensor, part: EvaluatedRange
) -> tuple[str, ...]:
    """Return remarks on excluded field angles and on the diffraction limit."""
    is_of_the_field = any(values.shape[-1] > 1 for values in limit.of.parts(fields[0][0]))
    return (*(part.left_out if is_of_the_field else ()), *_diffraction(limit, fields, sensor))


def _diffraction(
    limit: Limit, fields: list[tuple[FieldValues, Array]], sensor: Sensor
) -> list[str]:
    """Return a remark if the Airy disc alone exceeds a limit of blur."""
    if limit.at_most is None or not limit.of.is_blur:
        return []
    sharp = (field._replace(t_px=0 * field.t_px, s_px=0 * field.s_px) for field, _ in fields)
    minimum = max(limit.of.extreme(field, True)[0] for field in sharp)
    real = "" if sensor.lens.IS_THIN else " with the blur of the lens"
    remark = f"the Airy disc{real} alone is {minimum:.4g} {limit.of.unit} at F/{sensor.lens.stop_number:.4g}"
    return [remark] if minimum > limit.at_most else []


def evaluations(requirements: Requirements, sensor: Sensor, omega_deg: Array) -> list[Evaluation]:
    """Return the evaluation for the nearest and the farthest object, or for objects on surfaces."""
    field = requirements.field
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega_deg)))
    return [
        evaluate(sensor, omega_deg, object_distance_mm=distance)
        for distance in distances_of(field, rays)
    ]


# -- Temperature range of a sensor with all requirements met ---------------------------------------

STEP_K = 10.0  # step of the search before bisection
CLOSE_K = 0.1


@dataclass(frozen=True)
class TemperatureRange(Result):
    """Temperature range about the reference with all requirements met.

    Attributes
    ----------
    low_c, high_c
        Ends of the range, accurate to 0.1 K; NaN if requirements are missed at the reference.
    below, above
        Requirements missed beyond each end; empty at the ends of the searched range.
    """

    low_c: float
    high_c: float
    below: tuple[str, ...]
    above: tuple[str, ...]

    def to_dict(self) -> dict[str, Any]:
        """Return the range as plain data for JSON."""
        return {
            "low_c": self.low_c,
            "high_c": self.high_c,
            "below": list(self.below),
            "above": list(self.above),
        }


@validate_arguments
def temperature_range(
    requirements: Requirements, sensor: Sensor, *, coldest_c: float = -40.0, warmest_c: float = 85.0
) -> TemperatureRange:
    """Compute the temperature range of a sensor with all requirements met.

    Parameters
    ----------
    requirements
        Requirements as in :func:`omnimirror.check_requirements`.
    sensor
        Sensor with ``thermal`` properties.
    coldest_c, warmest_c
        Ends of the searched range, which includes the reference of ``thermal``.

    Returns
    -------
    TemperatureRange
        Contiguous range about the reference.

    Raises
    ------
    InvalidParameter
        If the sensor has no thermal properties, or its reference is outside the range.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=130.0),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.905),
    ...     lens=om.LensRequirements(theta_max_deg=12.0),
    ...     limits=(om.Limit("total_blur_px", at_most=7.9),),
    ... )
    >>> thermal = om.Thermal(mirror_material="acrylic", spacer_material="aluminium")
    >>> found = temperature_range(requirements, replace(om.load_sensor("paper-spherical"), thermal=thermal))
    >>> found.low_c, found.high_c, found.above
    (-40.0, 48.9, ('total_blur_px',))
    """
    if sensor.thermal is None:
        at_temperature(sensor, coldest_c)  # raises an error with the missing properties
    reference = sensor.thermal.reference_c  # type: ignore[union-attr]  # refused above
    if not coldest_c <= reference <= warmest_c:
        raise InvalidParameter(
            "coldest_c and warmest_c must enclose the reference temperature of the "
            f"sensor, {reference:g} C; got {coldest_c:g} and {warmest_c:g}"
        )
    if missed := _missed(requirements, sensor, reference):
        return TemperatureRange(np.nan, np.nan, missed, missed)
    (low, below), (high, above) = (
        _end(requirements, sensor, reference, end) for end in (coldest_c, warmest_c)
    )
    return TemperatureRange(low, high, below, above)


def _end(
    requirements: Requirements, sensor: Sensor, met: float, end: float
) -> tuple[float, tuple[str, ...]]:
    """Return the last temperature with all requirements met, and those missed beyond."""
    missed: tuple[str, ...] = ()
    step = float(np.copysign(STEP_K, end - met))
    while met != end:
        trial = end if abs(end - met) <= STEP_K else met + step
        if missed := _missed(requirements, sensor, trial):
            break
        met = trial
    else:
        return end, ()
    while abs(trial - met) > CLOSE_K:
        middle = (met + trial) / 2
        if violations := _missed(requirements, sensor, middle):
            trial, missed = middle, violations
        else:
            met = middle
    return round(met, 1), missed


def _missed(requirements: Requirements, sensor: Sensor, temperature_c: float) -> tuple[str, ...]:
    """Return the requirements missed at a temperature. Given sizes (rim, focal length) refer to
    manufacture and may expand.
    """
    try:
        rows = check_requirements(
            replace(requirements, temperatures_c=None), at_temperature(sensor, temperature_c)
        ).rows
    except OmnimirrorError as e:  # invalid sensor
        return (str(e),)
    return tuple(
        row.label
        for row in rows
        if not row.is_met and (row.is_limit or row.at_least != row.at_most)
    )
