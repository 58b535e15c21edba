"""Requirement by requirement: what was asked, what is reached, and the margin."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...analysis import Evaluation, evaluate
from ...lenses import Perspective
from ...tracing.meridian import Meridian
from ..construct.rim import Rim
from ..criteria.field_angles import JudgedRange
from ..criteria.limits import Limit
from ..criteria.merits import FieldValues, values_of_evaluation
from ..criteria.ranges import ends, ends_or_none
from ..criteria.requirements import Requirements
from .candidates import Choice, Made, imager_radius_mm, wanted_mirror

Array = NDArray[np.float64]

ROUNDING = 1e-6  # relative; a margin this little below 0 is none
EDGE_PX = 0.02  # past the last pixel is still its edge: lens and focus are settled to this
SEARCHED, REPORTED = 181, 1001  # field angles


@dataclass(frozen=True)
class Row:
    """One requirement.

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
    slack: float = 0.0
    """What may be missing without anyone's noticing."""
    remarks: tuple[str, ...] = ()

    @property
    def margin(self) -> float:
        """How far it is kept; below 0 by how much it is missed."""
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
        return self.margin >= -max(ROUNDING * self.scale, self.slack)

    @property
    def shortfall(self) -> float:
        """By what share of what was asked it is missed; below 0 by what share it is kept."""
        return -self.margin / self.scale

    @property
    def label(self) -> str:
        """Name, with the part of the field."""
        part = f", {self.part_deg[0]:g} to {self.part_deg[1]:g} deg" if self.part_deg else ""
        return f"{self.name}{part}"


def unit_of(name: str) -> str:
    """The unit in the name of an entry.

    >>> unit_of("rim_radius_mm"), unit_of("f_number")
    ('mm', '')
    """
    return next((unit for unit in ("deg", "mm", "px") if name.endswith(f"_{unit}")), "")


def assess(requirements: Requirements, choice: Choice, made: Made, angles: int = REPORTED) -> list[Row]:
    """Every requirement of a made sensor: the field, the imager, the parts given, then the limits."""
    return [*given_rows(requirements, choice, made), *limit_rows(requirements, made, angles)]


def given_rows(requirements: Requirements, choice: Choice, made: Made) -> list[Row]:
    """What is not a limit: the field, the imager, the parts given."""
    return [*_field_rows(requirements, choice, made), *_part_rows(requirements, made)]


def _field_rows(requirements: Requirements, choice: Choice, made: Made) -> list[Row]:
    low, high = made.sensor.field_deg
    rows = [Row("omega_max_deg", "deg", choice.omega_max_deg, None, high)]
    if choice.omega_min_deg > 0 or low > 0:  # otherwise what the camera hides is taken as it comes
        begin = max(low, made.counted.hidden_deg)
        rows.append(Row("omega_min_deg", "deg", None, choice.omega_min_deg, begin))
    return rows


def _part_rows(requirements: Requirements, made: Made) -> list[Row]:
    """What the requirements say of mirror, lens and imager."""
    sensor, lens = made.sensor, requirements.lens
    rim = imager_radius_mm(requirements) / requirements.imager.pitch_mm
    rows = [
        Row("rim_radius_mm", "mm", *ends(requirements.mirror.rim_radius_mm), sensor.mirror.rim_radius_mm),
        Row("image_radius_px", "px", None, rim, sensor.rim_radius_px, slack=EDGE_PX),
    ]
    optics = sensor.lens
    if isinstance(optics, Perspective):
        reached = {"focal_length_mm": optics.focal_length_mm, "f_number": optics.f_number}
        reached["theta_max_deg"] = float(np.degrees(sensor.meridian.theta_max))
    else:
        reached = {"f_number": optics.image_f_number()}
    for name, value in reached.items():
        span = ends_or_none(getattr(lens, name))
        if span is not None:
            rows.append(Row(name, unit_of(name), span[0], span[1], value))
    return rows


def limit_rows(requirements: Requirements, made: Made, angles: int) -> list[Row]:
    """The limits, each by its worst field angle and object distance."""
    parts = {limit.omega_deg: made.counted.part(limit.omega_deg) for limit in requirements.limits}
    omega = [np.linspace(part.low_deg, part.high_deg, angles) for part in parts.values()]
    results = evaluated(requirements, made, np.concatenate(omega)) if omega else []
    where = {part: slice(i * angles, (i + 1) * angles) for i, part in enumerate(parts)}
    fields = [values_of_evaluation(result) for result in results]
    rows = []
    for limit in requirements.limits:
        own = [(field.part(where[limit.omega_deg]), r.omega_deg[where[limit.omega_deg]])
               for field, r in zip(fields, results, strict=True)]  # fmt: skip
        rows.append(_limit_row(limit, own, _remarks(limit, own, made, parts[limit.omega_deg])))
    return rows


def _limit_row(limit: Limit, fields: list[tuple[FieldValues, Array]], remarks: tuple[str, ...]) -> Row:
    """One limit, from what each object distance gives at some field angles."""
    sides = [(True, limit.at_most)] if limit.at_most is not None else []
    sides += [(False, limit.at_least)] if limit.at_least is not None else []
    rows = []
    for largest, _ in sides:
        found = [(*limit.of.extreme(field, largest), omega) for field, omega in fields]
        value, i, omega = (max if largest else min)(found, key=lambda v: v[0])
        at = None if i is None else float(omega[i])
        asked = (limit.at_least, limit.at_most)
        rows.append(Row(limit.quantity, limit.of.unit, *asked, value, at, limit.omega_deg, True, remarks=remarks))
    return min(rows, key=lambda row: row.margin)


def _remarks(limit: Limit, fields: list[tuple[FieldValues, Array]], made: Made, part: JudgedRange) -> tuple[str, ...]:
    """What is not judged, of what differs from angle to angle; and what by itself is too much."""
    is_of_the_field = any(values.shape[-1] > 1 for values in limit.of.parts(fields[0][0]))
    return (*(part.left_out if is_of_the_field else ()), *_diffraction(limit, fields, made))


def _diffraction(limit: Limit, fields: list[tuple[FieldValues, Array]], made: Made) -> list[str]:
    """That no focus helps, where the Airy disk by itself is more than a limit of blur allows."""
    if limit.at_most is None or not limit.of.is_blur:
        return []
    sharp = (field._replace(t_px=0 * field.t_px, s_px=0 * field.s_px) for field, _ in fields)
    least = max(limit.of.extreme(field, True)[0] for field in sharp)
    lens = made.sensor.lens
    f_number = lens.f_number if isinstance(lens, Perspective) else lens.image_f_number()
    said = f"the Airy disk alone is {least:.4g} {limit.of.unit} at F/{f_number:.4g}"
    return [said] if least > limit.at_most else []


def evaluated(requirements: Requirements, made: Made, omega_deg: Array) -> list[Evaluation]:
    """The evaluation for the nearest and the farthest object."""
    return [
        evaluate(made.sensor, omega_deg, object_distance_mm=distance)
        for distance in sorted(set(ends(requirements.field.object_distance_mm)))
    ]


def mapping_deviation_px(requirements: Requirements, choice: Choice, made: Made) -> float | None:
    """Largest difference of the image height from that of the mapping asked for, px; None where none was asked for.

    The mapping is taken with the viewing angle and the focused lens of the sensor as made.
    """
    table, sensor = requirements.mirror, made.sensor
    if table.fit is None and (table.family is None or ":" not in table.family):
        return None
    rim = Rim(choice.omega_max_deg, float(np.degrees(sensor.meridian.theta_max)), choice.rim_radius_mm)
    if table.family is not None and ":" in table.family:
        table = replace(table, mapping="equidistant", family=None)
    wanted = wanted_mirror(table, rim, choice)
    target = Meridian(wanted.mirror, wanted.distance_mm)
    omega = np.radians(np.linspace(0.0, choice.omega_max_deg, REPORTED)[1:])
    ours, theirs = (m.trace(m.x_from_omega(np.minimum(omega, m.omega_max))) for m in (sensor.meridian, target))
    h = [sensor.lens.image_height(r.x, r.w) / sensor.imager.pitch_mm for r in (ours, theirs)]
    return float(np.abs(h[0] - h[1]).max())
