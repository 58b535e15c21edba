"""Requirement by requirement: what was asked, what is reached, and the margin."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...analysis.evaluation import Evaluation, evaluate
from ...analysis.temperature import at_temperature
from ...base.arguments import instance, whole
from ...base.errors import InvalidParameter
from ...base.files import json_plain
from ...optics.lenses import GaussianLens
from ...optics.sensor import Sensor, check_sensor
from ..criteria.field_angles import JudgedRange, counted_field
from ..criteria.image_circle import cut_off
from ..criteria.limits import SHARED, Limit, told_part
from ..criteria.merits import FieldValues, values_of_evaluation
from ..criteria.objects import distances_of
from ..criteria.ranges import ends, ends_or_none
from ..criteria.requirements import FARTHEST_FOCUS, Requirements

Array = NDArray[np.float64]

ROUNDING = 1e-6  # relative; a margin this little below 0 is none
EDGE_PX = 0.02  # past the last pixel is still its edge
REPORTED, MOST_ANGLES = 1001, 100_000  # field angles


@dataclass(frozen=True)
class Judgement:
    """One requirement, and what a sensor reaches of it.

    Attributes
    ----------
    name
        The quantity, or the entry of the requirement file.
    unit
    at_least, at_most
        What was asked; None where it was not.
    reached
    omega_deg
        Field angle where the worst value is, if there is one.
    part_deg
        Part of the field over which it is judged, if it is not all of it.
    is_limit
        Whether it is a ``[[limit]]``, not an entry that is simply given.
    tolerance
        Amount by which the limit may be exceeded: the edge of the outermost pixel is known to this.
    remarks
        What of the field asked for is not judged, and why; what by itself is too much.
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
        """Distance to the limit; negative only where the requirement is missed, by how much."""
        return max(self._difference, 0.0) if self.is_met else self._difference

    @property
    def _difference(self) -> float:
        """The margin without the tolerance."""
        sides = [self.reached - self.at_least] if self.at_least is not None else []
        sides += [self.at_most - self.reached] if self.at_most is not None else []
        return min(sides)

    @property
    def scale(self) -> float:
        """The size of what was asked, by which margins of different units are compared."""
        asked = [abs(v) for v in (self.at_least, self.at_most) if v is not None]
        return max(asked) or 1.0

    @property
    def is_met(self) -> bool:
        return self._difference >= -max(ROUNDING * self.scale, self.tolerance)

    @property
    def shortfall(self) -> float:
        """By what share of what was asked it is missed; below 0 by what share it is kept."""
        return -self._difference / self.scale

    @property
    def label(self) -> str:
        """Name, with the part of the field."""
        return self.name + told_part(self.part_deg)


@dataclass(frozen=True)
class Verdict:
    """A sensor by its requirements.

    Attributes
    ----------
    rows
        Requirement by requirement; the limits last, in their order.
    """

    requirements: Requirements
    sensor: Sensor
    rows: tuple[Judgement, ...]

    @property
    def is_met(self) -> bool:
        """Whether every requirement is met."""
        return not self.missed

    @property
    def missed(self) -> tuple[str, ...]:
        """The labels of the requirements that are not met."""
        return tuple(row.label for row in self.rows if not row.is_met)

    @property
    def limits(self) -> tuple[Judgement, ...]:
        """The rows of the limits."""
        return tuple(row for row in self.rows if row.is_limit)

    @property
    def worst(self) -> float:
        """The largest share by which a requirement is missed; 0 where all are met."""
        return max((row.shortfall for row in self.rows if not row.is_met), default=0.0)

    def to_dict(self) -> dict[str, Any]:
        """The table as plain data, for JSON."""
        rows = [{**asdict(row), "margin": row.margin, "is_met": row.is_met} for row in self.rows]
        data: dict[str, Any] = json_plain({"name": self.sensor.name, "is_met": self.is_met, "requirements": rows})
        return data


def unit_of(name: str) -> str:
    """The unit in the name of an entry.

    >>> unit_of("rim_radius_mm"), unit_of("f_number")
    ('mm', '')
    """
    return next((unit for unit in ("deg", "mm", "px") if name.endswith(f"_{unit}")), "")


def judge(requirements: Requirements, sensor: Sensor, *, angles: int = REPORTED) -> Verdict:
    """Any sensor, requirement by requirement, at its own focus.

    What the sensor does is judged, not how its mirror came about: mapping, family and fit are no rows.

    Parameters
    ----------
    requirements, sensor
        What is asked, and of what; a sensor without a housing, or of which nothing is said of temperatures, is judged
        with those of the requirements.
    angles
        How many field angles, 2 to 100000, each limit is looked at, in each part of the field that limits name.

    Returns
    -------
    Verdict
        One row for the field, the imager, each number given of mirror and lens, and each limit, in this order.

    Raises
    ------
    InvalidParameter
        The lens is of another kind, or nothing can be seen of the part of the field that a limit names.

    Examples
    --------
    The paper's sphere looks to 135 deg, and is not as sharp as that:

    >>> import omnimirror as om
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=135),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=(40, 50)),
    ...     lens=om.LensRequirements(focal_length_mm=11.6),
    ...     limits=[om.Limit("total_blur_px", at_most=3.0)],
    ... )
    >>> verdict = om.judge(requirements, om.load_sensor("paper-spherical"))
    >>> verdict.is_met, verdict.missed
    (False, ('total_blur_px',))
    >>> blur = verdict.limits[0]
    >>> round(blur.reached, 2), round(blur.margin, 2), round(blur.omega_deg)
    (8.96, -5.96, 135)
    """
    instance("requirements", requirements, Requirements, "requirements")
    check_sensor(sensor)
    angles = whole("angles", angles, 2, MOST_ANGLES)
    if requirements.lens.is_telecentric != sensor.lens.TELECENTRIC:
        raise InvalidParameter(
            f"the lens of the sensor is {sensor.lens.KIND}, and the requirements are about one that is "
            f"{requirements.lens.kind}"
        )
    if sensor.housing.is_empty:
        sensor = replace(sensor, housing=requirements.housing)
    if sensor.thermal is None:
        sensor = replace(sensor, thermal=requirements.thermal)
    rows = [*given_rows(requirements, sensor), *_limits_over_temperatures(requirements, sensor, angles)]
    return Verdict(requirements, sensor, tuple(rows))


def given_rows(requirements: Requirements, sensor: Sensor) -> list[Judgement]:
    """What is not a limit: the field, the imager, the numbers given."""
    return [*_field_rows(requirements, sensor), *_part_rows(requirements, sensor)]


def _field_rows(requirements: Requirements, sensor: Sensor) -> list[Judgement]:
    field, counted = requirements.field, counted_field(requirements.field, sensor)
    low, high = sensor.field_deg[0], counted.hidden_from_deg
    rows = [Judgement("omega_max_deg", "deg", field.omega_max_deg, None, high)]
    if field.omega_min_deg > 0 or low > 0:  # otherwise what the housing hides is taken as it comes
        begin = max(low, counted.hidden_deg)
        rows.append(Judgement("omega_min_deg", "deg", None, field.omega_min_deg, begin))
    return rows


def _part_rows(requirements: Requirements, sensor: Sensor) -> list[Judgement]:
    """What the requirements say of mirror, lens and imager."""
    lens, largest = requirements.lens, requirements.largest_image_px
    rows = [
        Judgement("rim_radius_mm", "mm", *ends(requirements.mirror.rim_radius_mm), sensor.mirror.rim_radius_mm),
        Judgement(
            "image_radius_px", "px", None, largest, sensor.rim_radius_px, tolerance=EDGE_PX, remarks=cut_off(sensor)
        ),
    ]
    optics = sensor.lens
    if isinstance(optics, GaussianLens):
        reached = {"focal_length_mm": optics.focal_length_mm, "f_number": optics.stop_number}
        reached["theta_max_deg"] = float(np.degrees(sensor.meridian.theta_max))
    else:
        reached = {"f_number": optics.stop_number, "magnification": float(getattr(optics, "magnification", np.nan))}
    reached["focus_mm"] = optics.focus_distance_mm
    for name, value in reached.items():
        span = ends_or_none(getattr(lens, name))
        if span is not None:
            most = None if span[0] < span[1] == FARTHEST_FOCUS else span[1]
            rows.append(Judgement(name, unit_of(name), span[0], most, value))
    return rows


def _limits_over_temperatures(requirements: Requirements, sensor: Sensor, angles: int) -> list[Judgement]:
    """The limits, each where it is kept worst: as the sensor is made, or at an end of the range of temperatures."""
    rows = _limit_rows(requirements, sensor, angles)
    for temperature in requirements.temperatures_c or ():
        there = _limit_rows(requirements, at_temperature(sensor, temperature), angles)
        remark = f"worst at {temperature:g} C"
        rows = [
            replace(moved, remarks=(*moved.remarks, remark)) if moved.margin < row.margin else row
            for row, moved in zip(rows, there, strict=True)
        ]
    return rows


def _limit_rows(requirements: Requirements, sensor: Sensor, angles: int) -> list[Judgement]:
    """The limits, each by its worst field angle and object distance."""
    counted = counted_field(requirements.field, sensor)
    parts = {limit.omega_deg: counted.part(limit.omega_deg) for limit in requirements.limits}
    omega = [np.linspace(part.low_deg, part.high_deg, angles) for part in parts.values()]
    results = evaluations(requirements, sensor, np.concatenate(omega)) if omega else []
    where = {part: slice(i * angles, (i + 1) * angles) for i, part in enumerate(parts)}
    fields = [values_of_evaluation(result) for result in results]
    rows = []
    for limit in requirements.limits:
        own = [(field.part(where[limit.omega_deg]), r.omega_deg[where[limit.omega_deg]])
               for field, r in zip(fields, results, strict=True)]  # fmt: skip
        rows.append(_limit_row(limit, own, _remarks(limit, own, sensor, parts[limit.omega_deg])))
    return rows


def _limit_row(limit: Limit, fields: list[tuple[FieldValues, Array]], remarks: tuple[str, ...]) -> Judgement:
    """One limit, from what each object distance gives at some field angles."""
    sides = [(True, limit.at_most)] if limit.at_most is not None else []
    sides += [(False, limit.at_least)] if limit.at_least is not None else []
    rows = []
    for largest, _ in sides:
        found = [(*limit.of.extreme(field, largest), omega) for field, omega in fields]
        value = (max if largest else min)(v for v, _, _ in found)
        where = [omega[i] for v, i, omega in found if i is not None and abs(v - value) <= SHARED * abs(value)]
        at = float(min(where)) if where else None
        asked = (limit.at_least, limit.at_most)
        rows.append(Judgement(limit.name, limit.of.unit, *asked, value, at, limit.omega_deg, True, remarks=remarks))
    return min(rows, key=lambda row: row.margin)


def _remarks(
    limit: Limit, fields: list[tuple[FieldValues, Array]], sensor: Sensor, part: JudgedRange
) -> tuple[str, ...]:
    """What is not judged, of what differs from angle to angle; and what by itself is too much."""
    is_of_the_field = any(values.shape[-1] > 1 for values in limit.of.parts(fields[0][0]))
    return (*(part.left_out if is_of_the_field else ()), *_diffraction(limit, fields, sensor))


def _diffraction(limit: Limit, fields: list[tuple[FieldValues, Array]], sensor: Sensor) -> list[str]:
    """That no focus helps, where the Airy disk by itself is more than a limit of blur allows."""
    if limit.at_most is None or not limit.of.is_blur:
        return []
    sharp = (field._replace(t_px=0 * field.t_px, s_px=0 * field.s_px) for field, _ in fields)
    least = max(limit.of.extreme(field, True)[0] for field in sharp)
    real = "" if sensor.lens.IS_THIN else " with the lens's own blur"
    said = f"the Airy disk{real} alone is {least:.4g} {limit.of.unit} at F/{sensor.lens.stop_number:.4g}"
    return [said] if least > limit.at_most else []


def evaluations(requirements: Requirements, sensor: Sensor, omega_deg: Array) -> list[Evaluation]:
    """The evaluation for the nearest and the farthest object, or for those on surfaces."""
    field = requirements.field
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega_deg)))
    return [evaluate(sensor, omega_deg, object_distance_mm=distance) for distance in distances_of(field, rays)]
