"""Evaluation of a design as one binary message: curves, cross-section, grid squares and
requirements."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....analysis.evaluation import Evaluation, evaluate, field_angles
from ....analysis.section import (
    NEAR_OBJECTS,
    SectionCurve,
    focus_band,
    image_curves,
    is_as_seen,
    lens_half_width,
    lens_height,
    mirror_curve,
    secondary_curve,
    ways_to_lens,
)
from ....base.errors import OmnimirrorError
from ....design.criteria.merits import length_mm
from ....optics.sensor import Sensor
from ..framing import framed
from .designs.judging import Judged, judged_by
from .designs.sensors import in_place, on_bench, remark_on, sensor_on_bench, trouble_of, why_not_optimised
from .designs.shaping import bent
from .messages import Answer, Ask, BlockValues, Facts, columns_of, distance_of
from .space import space_blocks

CURVES = (
    "omega_deg", "x_mm", "z_mm", "h_px", "dh_domega_px_per_deg", "viewpoint_z_mm", "area_px2", "aspect", "blur_t_px",
    "blur_s_px", "blur_t_deg", "blur_s_deg", "floored_area_deg2",
)  # fmt: skip
"""Columns of :class:`~omnimirror.analysis.Evaluation` that are plotted."""
SQUARES = (
    "omega_deg", "h_px", "dh_domega_px_per_deg", "width_px_per_deg", "blur_t_px", "blur_s_px", "blur_t_deg",
    "blur_s_deg",
)  # fmt: skip
NODES = 361  # samples of a curve
MARKS_DEG = 15.0
PROFILE = 121  # samples of a mirror profile, axis to rim
IMAGE_NODES = 3  # stride of field angles for the curves of virtual images


@dataclass(frozen=True)
class EvaluatedSensor:
    """Sensor of a request with its evaluations."""

    curve: Evaluation
    marks: Evaluation
    """Evaluation at multiples of :data:`MARKS_DEG`."""
    far: Evaluation
    """Evaluation for distant objects, regardless of the requested object distance."""


def answer(ask: Ask) -> bytes:
    """Evaluate the design of a request; an invalid design yields a message with the error."""
    try:
        stands = sensor_on_bench(ask.tables, ask.follows)
        if ask.bend is not None:
            stands = bent(stands, ask.bend)
        sensor = in_place(stands)
        design = _evaluated(sensor, distance_of(ask.object_distance_mm))
        facts = _facts(design, why_not_optimised(stands))
        blocks = [_block("curves", CURVES, design.curve)]
        blocks += _section(design) if ask.section else []
        blocks += [_block("squares", SQUARES, design.marks)] if ask.squares else []
        blocks += space_blocks(stands, design.marks.h_px) if ask.space else []
    except OmnimirrorError as e:
        return framed(_answer(ask, trouble=trouble_of(e)))
    judged = judged_by(ask.requirements, design.curve) if ask.requirements is not None else Judged()
    blocks += judged.curves
    told = _answer(
        ask,
        remark=remark_on(stands),
        facts=facts,
        rows=judged.rows,
        requirements_trouble=judged.trouble,
        blocks=tuple(values.block for values in blocks),
        bent=on_bench(stands) if ask.bend is not None else None,
    )
    return framed(told, *(b.values.astype("<f4").tobytes() for b in blocks))


def _answer(ask: Ask, **told: object) -> Answer:
    empty = dict.fromkeys(("trouble", "remark", "facts", "requirements_trouble", "bent")) | {"rows": (), "blocks": ()}
    return Answer(slot=ask.slot, number=ask.number, **{**empty, **told})  # type: ignore[arg-type]


def _evaluated(sensor: Sensor, object_distance_mm: float) -> EvaluatedSensor:
    field, marks = np.linspace(*sensor.field_deg, NODES), field_angles(sensor, MARKS_DEG)
    both = evaluate(sensor, np.concatenate([field, marks]), object_distance_mm=object_distance_mm)
    curve = both[:NODES]
    return EvaluatedSensor(curve, both[NODES:], curve if np.isinf(object_distance_mm) else evaluate(sensor, field))


def _block(name: str, columns: tuple[str, ...], result: Evaluation) -> BlockValues:
    return columns_of(name, columns, np.stack([getattr(result, column) for column in columns]))


def _facts(design: EvaluatedSensor, not_optimised: str | None) -> Facts:
    sensor, e = design.curve.sensor, design.curve
    near, far = e.depth_of_field_mm
    blurs = np.maximum(np.abs(e.blur_t_px), np.abs(e.blur_s_px))
    resolution = np.minimum(e.dh_domega_px_per_deg, e.width_px_per_deg)
    return Facts(
        name=sensor.name,
        field_deg=sensor.field_deg,
        rim_radius_mm=sensor.mirror.rim_radius_mm,
        rim_radius_px=sensor.rim_radius_px,
        imager_radius_px=sensor.imager.inscribed_radius_px,
        mirror_distance_mm=finite(sensor.mirror_distance_mm),
        focus_mm=e.focus_mm,
        depth_of_field_mm=(near, finite(far)),
        airy_px=e.airy_px,
        length_mm=length_mm(e),
        viewpoint_spread_mm=float(np.ptp(e.viewpoint_z_mm)),
        worst_blur_px=finite(float(blurs.max())),
        worst_floored_area_deg2=finite(float(e.floored_area_deg2.max())),
        resolution_px_per_deg=(float(resolution.min()), finite(float(resolution.max()))),
        not_optimised=not_optimised,
    )


def finite(value: float) -> float | None:
    """Convert to a JSON-serialisable number: None for non-finite values."""
    return value if np.isfinite(value) else None


def _section(design: EvaluatedSensor) -> list[BlockValues]:
    """Return the cross-section: mirrors, lens, chief rays in the sensor plane, virtual images,
    depth of field."""
    sensor = design.curve.sensor
    found = [_lines("mirror", mirror_curve(sensor, 2 * PROFILE - 1))]
    if (second := secondary_curve(sensor, PROFILE)) is not None:
        found.append(_lines("secondary", second))
    half, lens = lens_half_width(sensor), lens_height(sensor)
    found.append(_lines("lens", SectionCurve(np.array([-half, half]), np.array([lens, lens]))))
    found += _rays(design.marks)
    if is_as_seen(sensor):
        for name, curve in _virtual_images(design.far):
            found.append(_lines(name, SectionCurve(curve.x[::IMAGE_NODES], curve.z[::IMAGE_NODES])))
        found.append(_lines("focus", SectionCurve(np.zeros(3), np.array(focus_band(design.far)))))
    return found


def _virtual_images(far: Evaluation) -> list[tuple[str, SectionCurve]]:
    """Yield the virtual images of distant and of near objects."""
    (t_far, s_far), (t_near, s_near) = (
        image_curves(far),
        image_curves(far, NEAR_OBJECTS * far.sensor.mirror.rim_radius_mm),
    )
    return [("T∞", t_far), (f"T{NEAR_OBJECTS:g}M", t_near), ("S∞", s_far), (f"S{NEAR_OBJECTS:g}M", s_near)]


def _rays(marks: Evaluation) -> list[BlockValues]:
    """Return the chief rays between mirror and lens every 15 deg."""
    ways = ways_to_lens(marks.sensor, marks.x_mm)
    rays = zip(marks.x_mm, marks.z_mm, marks.omega_deg, ways, strict=True)
    return [_lines(f"ray {omega:g}", SectionCurve(*np.array([(x, z), *way]).T)) for x, z, omega, way in rays]


def _lines(name: str, curve: SectionCurve) -> BlockValues:
    return columns_of(name, ("x_mm", "z_mm"), np.stack(curve))
