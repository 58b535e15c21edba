"""Evaluation of a design as one binary message: curves, cross-section, grid squares, requirements and 3-D view."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...analysis.cross_section import (
    NEAR_OBJECTS,
    SectionCurve,
    focus_band,
    image_curves,
    is_undistorted,
    lens_half_width,
    lens_height,
    mirror_curve,
    paths_to_lens,
    secondary_curve,
)
from ...analysis.evaluation import Evaluation, evaluate, field_angles
from ...base.errors import OmnimirrorError
from ...base.typing import Array
from ...cameras.camera import inside_image, rotate_vectors
from ...optics.housing import Dome, FlatWindow, Housing, Shell
from ...optics.mirrors.mirror import MirrorPose
from ...optics.sensor import Sensor
from ...optics.tracing.obscuration import Obstructions, WindowFrame
from ...optics.tracing.shell_transmission import pose_of, transmit_rays
from ...optics.tracing.two_mirrors import FoldedMirror
from ...simulation.scenes.room import ROOM, SOLIDS
from ...simulation.scenes.scene import intersect_boxes
from ._design_requirements import UNCHECKED, check_evaluation
from ._design_sensors import (
    aligned_sensor,
    api_error_of,
    edited_sensor,
    remark_on,
    sensor_from_tables,
    tables_from_sensor,
    why_not_optimised,
)
from ._http_messages import framed
from .design_messages import (
    BlockValues,
    DesignRequest,
    DesignResponse,
    DesignSummary,
    columns_of,
    distance_of,
)

# -- 3-D view: parts, chief rays and the surrounding room ------------------------------------------
#
# Coordinates are in mm in the world frame, with the origin at the nominal mirror vertex.

TURNS = 12  # meridians with traced rays
SPACE_PROFILE_NODES = 37  # samples of a mirror profile, axis to rim
ARC = 33  # samples of a dome profile
BARREL = 1.2  # drawn length of the lens, in half-widths
OUTER_RAY_LENGTH = 12.0  # length of rays if the sensor is outside the room, in rim radii
FRAME_SHARE = 0.3  # drawn width of the opaque frame of a window, in window radii
RAY_NODES = ("lens", "second", "mirror", "wall", "end")
"""Nodes of a ray, from the lens outwards; non-finite if the ray skips a node."""
READINGS = (
    "omega_deg",
    "incidence_deg",
    "u_px",
    "v_px",
    "x_mm",
    "y_mm",
    "z_mm",
    "turn_deg",
    "is_hidden",
)
"""Readings of a ray; x, y and z are those of its mirror point in the mirror frame."""
RAYS = (*READINGS, *(f"{node}_{axis}" for node in RAY_NODES for axis in "xyz"))


class TurnedPart(NamedTuple):
    """Rotationally symmetric part: radii and heights of its profile, and its pose."""

    name: str
    radius_mm: Array
    height_mm: Array
    pose: MirrorPose = MirrorPose()


def space_blocks(sensor: Sensor, heights_px: Array) -> list[BlockValues]:
    """Return the parts of a sensor, chief rays of image heights (n,) in several meridians, and the
    boxes of a room.

    Parameters
    ----------
    sensor
        Sensor, possibly with a misaligned mirror, cover or imager.
    heights_px
        Image heights of the displayed field angles, computed for the aligned sensor.
    """
    world = _world_of(sensor)
    blocks = [b for part in _parts(sensor) for b in _blocks_of(part, world)]
    blocks.append(columns_of("rays", RAYS, _space_rays(sensor, heights_px, world)))
    boxes = np.array([(*box.low, *box.high) for box in (ROOM, *SOLIDS)]).T
    return [*blocks, columns_of("room", ("x0", "y0", "z0", "x1", "y1", "z1"), boxes)]


def _world_of(sensor: Sensor) -> Array:
    """Return the axes (3, 3) of the camera frame in world coordinates, as columns; a second mirror
    inverts the frame."""
    rotation = sensor.mount.rotation()
    world: Array = rotation * [1.0, 1.0, np.sign(-sensor.axis @ rotation[:, 2])]
    return world


def _blocks_of(part: TurnedPart, world: Array) -> Iterator[BlockValues]:
    """Yield the profile of a part and its pose: three axes and the origin, as columns."""
    yield columns_of(
        f"part {part.name}", ("r_mm", "z_mm"), np.stack([part.radius_mm, part.height_mm])
    )
    frame = np.column_stack([world @ part.pose.rotation(), world @ part.pose.shift])
    yield columns_of(f"frame {part.name}", ("x", "y", "z", "origin"), frame.T)


# -- Parts -----------------------------------------------------------------------------------------


def _parts(sensor: Sensor) -> Iterator[TurnedPart]:
    straight = aligned_sensor(sensor)
    yield from _bodies(sensor, straight)
    yield from _lens(straight)
    obstructions = sensor.obstructions
    if obstructions.rod is not None:
        (foot, wide), (top, narrow) = obstructions.rod.ends
        yield TurnedPart("rod", np.array([0.0, wide, narrow]), np.array([foot, foot, top]))
    for disc in obstructions.discs:
        if isinstance(disc, WindowFrame):
            inner, outer = disc.radius_mm, disc.radius_mm * (1 + FRAME_SHARE)
        else:
            inner, outer = 0.0, disc.radius_mm
        yield TurnedPart(disc.part, np.array([inner, outer]), np.full(2, disc.height_mm))
    if (shell := obstructions.housing.shell) is not None:
        yield _wall(
            shell,
            obstructions.envelope.base_mm,
            obstructions.envelope.back_mm,
            obstructions.envelope.outer_mm,
        )


def _bodies(sensor: Sensor, straight: Sensor) -> Iterator[TurnedPart]:
    """Yield both mirrors, and the body of the first with its rim."""
    curve, envelope = (
        mirror_curve(straight, 2 * SPACE_PROFILE_NODES - 1),
        sensor.obstructions.envelope,
    )
    half = (curve.x >= 0) & np.isfinite(curve.z)
    x, z = curve.x[half], curve.z[half]
    pose = sensor.mirror_pose
    yield TurnedPart("mirror", x, z, pose)
    rim = sensor.obstructions.rim
    front = z[-1] if rim is None else rim.height_mm
    edge = (
        [x[-1], x[-1], envelope.outer_mm, envelope.outer_mm, x[0]],
        [z[-1], front, front, *2 * (envelope.back_mm,)],
    )
    yield TurnedPart("body", np.array(edge[0]), np.array(edge[1]), pose)
    if (second := secondary_curve(straight, 2 * SPACE_PROFILE_NODES - 1)) is not None:
        half = second.x >= 0
        yield TurnedPart("second mirror", second.x[half], second.z[half])


def _lens(straight: Sensor) -> Iterator[TurnedPart]:
    """Yield the front surface and the barrel of the lens."""
    half, height = lens_half_width(straight), lens_height(straight)
    behind = height + (BARREL * half if straight.secondary is not None else -BARREL * half)
    yield TurnedPart("lens", np.array([0.0, half]), np.full(2, height))
    yield TurnedPart("barrel", np.array([half, half, 0.0]), np.array([height, behind, behind]))


def _wall(shell: Shell, base_mm: float, back_mm: float, outer_mm: float) -> TurnedPart:
    """Return the closed outline of a transparent wall."""
    pose = MirrorPose() if shell.is_axial else pose_of(shell)
    if isinstance(shell, FlatWindow):
        radius = (shell.diameter_mm or 2 * outer_mm) / 2
        inner, outer = shell.heights_mm
        return TurnedPart(
            "window",
            np.array([0.0, radius, radius, 0.0]),
            np.array([inner, inner, outer, outer]),
            pose,
        )
    inner, outer = shell.radii_mm
    if not isinstance(shell, Dome):
        return TurnedPart(
            "tube",
            np.array([inner, inner, outer, outer]),
            np.array([base_mm, back_mm, back_mm, base_mm]),
            pose,
        )
    sides = []
    for radius, centre in zip((inner, outer), shell.centres_mm, strict=True):
        angle = np.linspace(np.arcsin(np.clip((base_mm - centre) / radius, -1, 1)), np.pi / 2, ARC)
        sides.append((radius * np.cos(angle), centre + radius * np.sin(angle)))
    (r0, z0), (r1, z1) = sides
    return TurnedPart(
        "dome", np.concatenate([r0, [np.nan], r1]), np.concatenate([z0, [np.nan], z1]), pose
    )


# -- Rays ------------------------------------------------------------------------------------------


class _Legs(NamedTuple):
    """Rays (n, 3), mm, from the lens to the mirror in the camera frame; non-finite if vignetted."""

    lens: Array
    second: Array
    mirror: Array
    before: Array
    """Directions of incidence on the mirror."""
    after: Array
    """Directions after reflection."""
    normals: Array


def _space_rays(sensor: Sensor, heights_px: Array, world: Array) -> Array:
    """Return readings and nodes of rays (columns, n), by meridian, starting with the forward
    meridian."""
    turns = np.repeat(np.arange(TURNS) * 360 / TURNS, len(heights_px))
    azimuth = np.radians(sensor.mount.forward_azimuth_deg + turns)
    offsets_px = np.tile(heights_px, TURNS)[:, None] * np.stack(
        [np.cos(azimuth), np.sin(azimuth)], axis=-1
    )
    pixels = sensor.image_plane.pixels(sensor.imager.pitch_mm * offsets_px)
    pixels[~inside_image(pixels, sensor.image_size)] = np.nan
    legs = _legs(sensor, pixels)
    wall, end, outside, is_hidden = _exit_points(sensor, legs, world)
    cosines = -outside[:, 2], np.abs((legs.before * legs.normals).sum(axis=1))
    omega, incidence = np.degrees(
        np.arccos(np.clip(cosines, -1, 1))
    )  # rounding errors can exceed 1
    at = sensor.mirror_pose.to_mirror(legs.mirror)
    nodes = [rotate_vectors(node, world.T) for node in (legs.lens, legs.second, legs.mirror, wall)]
    return np.stack(
        [
            omega,
            incidence,
            *pixels.T,
            *at.T,
            turns,
            is_hidden,
            *(row for n in (*nodes, end) for row in n.T),
        ]
    )


def _legs(sensor: Sensor, pixels: Array) -> _Legs:
    """Trace the chief rays of pixels (n, 2) from the lens to the mirror."""
    bare = replace(sensor, housing=Housing())  # the tube is traced afterwards
    mirror = bare.optical_train.posed_mirror
    lens, towards = bare.lens_rays(pixels, np.zeros(2))
    reflection = mirror.trace(lens, towards)
    second, before = np.full_like(lens, np.nan), towards
    if isinstance(mirror, FoldedMirror):
        second, before = mirror.off_secondary(lens, towards)
        lens, towards = mirror.over(lens), towards * (1, 1, -1)
    if sensor.lens.TELECENTRIC:  # at an arbitrary axial position
        lens = (
            lens
            + ((lens_height(aligned_sensor(sensor)) - lens[:, 2]) / towards[:, 2])[:, None]
            * towards
        )
    lens = np.where(reflection.valid[:, None], lens, np.nan)
    unit = before / np.linalg.norm(before, axis=1, keepdims=True)
    return _Legs(lens, second, reflection.points, unit, reflection.directions, reflection.normals)


def _exit_points(
    sensor: Sensor, legs: _Legs, world: Array
) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return the exit points from a cover and the end points of rays (n, 3) in the world frame,
    with the next points and an obscuration mask."""
    obstructions, shell = sensor.obstructions, sensor.obstructions.housing.shell
    points, towards = legs.mirror, legs.after
    masks = obstructions.blocks(points, towards, -legs.before, sensor.mirror_pose).values()
    is_hidden = np.any([np.zeros(len(points), dtype=bool), *masks], axis=0)
    wall = np.full_like(points, np.nan)
    if shell is not None:
        visible = np.isfinite(points[:, 0]) & ~is_hidden
        exits = transmit_rays(shell, points[visible], towards[visible])
        wall[visible], towards = exits.points, towards.copy()
        towards[visible] = exits.directions
    start, direction = (
        rotate_vectors(np.where(np.isfinite(wall), wall, points), world.T),
        rotate_vectors(towards, world.T),
    )
    far = np.full(len(points), OUTER_RAY_LENGTH * sensor.mirror.rim_radius_mm)
    inside = ((start >= ROOM.low) & (start <= ROOM.high)).all(axis=1)
    far[inside] = intersect_boxes(ROOM, SOLIDS, start[inside], direction[inside]).distance
    stopped = _distance_to_disc(obstructions, points, towards)
    far = np.where(is_hidden, np.where(np.isfinite(stopped), stopped, 0.0), far)
    return wall, start + far[:, None] * direction, towards, is_hidden


def _distance_to_disc(obstructions: Obstructions, points: Array, towards: Array) -> Array:
    """Return the path length (n,), mm, to the first opaque disc; infinite without intersection."""
    way = np.full(len(points), np.inf)
    for disc in obstructions.discs:
        with np.errstate(invalid="ignore", divide="ignore"):
            steps = (disc.height_mm - points[:, 2]) / towards[:, 2]
        way = np.where(disc.clearance(points, towards) < 0, np.minimum(way, steps), way)
    return way


# -- Curves, cross-section, squares and requirements -----------------------------------------------

CURVES = (
    "omega_deg",
    "x_mm",
    "z_mm",
    "h_px",
    "dh_domega_px_per_deg",
    "viewpoint_z_mm",
    "area_px2",
    "aspect",
    "blur_t_px",
    "blur_s_px",
    "blur_t_deg",
    "blur_s_deg",
    "floored_area_deg2",
    "plane_t_mm_per_px",
    "cylinder_t_mm_per_px",
    "object_s_mm_per_px",
)
"""Columns of :class:`~omnimirror.analysis.Evaluation` that are plotted."""
SQUARES = (
    "omega_deg",
    "h_px",
    "dh_domega_px_per_deg",
    "width_px_per_deg",
    "blur_t_px",
    "blur_s_px",
    "blur_t_deg",
    "blur_s_deg",
)
CURVE_NODES = 361  # samples of a curve
MARKS_DEG = 15.0
SECTION_PROFILE_NODES = 121  # samples of a mirror profile, axis to rim
IMAGE_NODES = 3  # stride of field angles for the curves of virtual images


@dataclass(frozen=True)
class EvaluatedSensor:
    """Sensor of a request with its evaluations."""

    curve: Evaluation
    marks: Evaluation
    """Evaluation at multiples of :data:`MARKS_DEG`."""
    far: Evaluation
    """Evaluation for distant objects, regardless of the requested object distance."""


def answer(message: DesignRequest) -> bytes:
    """Evaluate the design of a request; an invalid design yields a message with the error."""
    try:
        current = sensor_from_tables(message.tables, message.follows_mapping)
        if message.edit is not None:
            current = edited_sensor(current, message.edit)
        sensor = aligned_sensor(current)
        design = _evaluated(sensor, distance_of(message.object_distance_mm))
        summary = _facts(design, why_not_optimised(current))
        blocks = [_block("curves", CURVES, design.curve)]
        blocks += _section(design) if message.include_section else []
        blocks += [_block("squares", SQUARES, design.marks)] if message.include_squares else []
        blocks += space_blocks(current, design.marks.h_px) if message.include_3d else []
    except OmnimirrorError as e:
        return framed(_answer(message, error=api_error_of(e)))
    checked = (
        check_evaluation(message.requirements, design.curve)
        if message.requirements is not None
        else UNCHECKED
    )
    blocks += checked.curves
    response = _answer(
        message,
        note=remark_on(current),
        summary=summary,
        rows=checked.rows,
        requirements_error=checked.error,
        blocks=tuple(values.block for values in blocks),
        edited=tables_from_sensor(current) if message.edit is not None else None,
    )
    return framed(response, *(b.values for b in blocks))


def _answer(message: DesignRequest, **fields: object) -> DesignResponse:
    empty = dict.fromkeys(("error", "note", "summary", "requirements_error", "edited")) | {
        "rows": (),
        "blocks": (),
    }
    return DesignResponse(slot=message.slot, number=message.number, **{**empty, **fields})  # type: ignore[arg-type]  # types of the keywords depend on their names


def _evaluated(sensor: Sensor, object_distance_mm: float) -> EvaluatedSensor:
    field, marks = np.linspace(*sensor.field_deg, CURVE_NODES), field_angles(sensor, MARKS_DEG)
    both = evaluate(sensor, np.concatenate([field, marks]), object_distance_mm=object_distance_mm)
    curve = both[:CURVE_NODES]
    return EvaluatedSensor(
        curve,
        both[CURVE_NODES:],
        curve if np.isinf(object_distance_mm) else evaluate(sensor, field),
    )


def _block(name: str, columns: tuple[str, ...], result: Evaluation) -> BlockValues:
    return columns_of(name, columns, np.stack([getattr(result, column) for column in columns]))


def _facts(design: EvaluatedSensor, not_optimised: str | None) -> DesignSummary:
    sensor, e = design.curve.sensor, design.curve
    near, far = e.depth_of_field_mm
    blurs = np.maximum(np.abs(e.blur_t_px), np.abs(e.blur_s_px))
    resolution = np.minimum(e.dh_domega_px_per_deg, e.width_px_per_deg)
    return DesignSummary(
        name=sensor.name,
        field_deg=sensor.field_deg,
        rim_radius_mm=sensor.mirror.rim_radius_mm,
        rim_radius_px=sensor.rim_radius_px,
        imager_radius_px=sensor.imager.inscribed_radius_px,
        mirror_distance_mm=finite(sensor.mirror_distance_mm),
        focus_mm=e.focus_mm,
        depth_of_field_mm=(near, finite(far)),
        airy_px=e.airy_px,
        length_mm=e.length_mm,
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
    curves = [_lines("mirror", mirror_curve(sensor, 2 * SECTION_PROFILE_NODES - 1))]
    if (second := secondary_curve(sensor, SECTION_PROFILE_NODES)) is not None:
        curves.append(_lines("secondary", second))
    half, lens = lens_half_width(sensor), lens_height(sensor)
    curves.append(_lines("lens", SectionCurve(np.array([-half, half]), np.array([lens, lens]))))
    curves += _chief_rays(design.marks)
    if is_undistorted(sensor):
        for name, curve in _virtual_images(design.far):
            curves.append(
                _lines(name, SectionCurve(curve.x[::IMAGE_NODES], curve.z[::IMAGE_NODES]))
            )
        curves.append(_lines("focus", SectionCurve(np.zeros(3), np.array(focus_band(design.far)))))
    return curves


def _virtual_images(far: Evaluation) -> list[tuple[str, SectionCurve]]:
    """Yield the virtual images of distant and of near objects."""
    (t_far, s_far), (t_near, s_near) = (
        image_curves(far),
        image_curves(far, NEAR_OBJECTS * far.sensor.mirror.rim_radius_mm),
    )
    return [
        ("T∞", t_far),
        (f"T{NEAR_OBJECTS:g}M", t_near),
        ("S∞", s_far),
        (f"S{NEAR_OBJECTS:g}M", s_near),
    ]


def _chief_rays(marks: Evaluation) -> list[BlockValues]:
    """Return the chief rays between mirror and lens every 15 deg."""
    ways = paths_to_lens(marks.sensor, marks.x_mm)
    rays = zip(marks.x_mm, marks.z_mm, marks.omega_deg, ways, strict=True)
    return [
        _lines(f"ray {omega:g}", SectionCurve(*np.array([(x, z), *way]).T))
        for x, z, omega, way in rays
    ]


def _lines(name: str, curve: SectionCurve) -> BlockValues:
    return columns_of(name, ("x_mm", "z_mm"), np.stack(curve))
