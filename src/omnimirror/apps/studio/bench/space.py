"""3-D view of a design: profiles of its parts about their axes, traced chief rays, and the
surrounding room.

Coordinates are in mm in the world frame, with the origin at the nominal mirror vertex.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....analysis.section import lens_half_width, lens_height, mirror_curve, secondary_curve
from ....base.typing import Array
from ....cameras.camera import inside_image
from ....cameras.frames import turned
from ....optics.housing import Dome, FlatWindow, Housing, Shell
from ....optics.mirrors.pose import MirrorPose
from ....optics.sensor import Sensor
from ....optics.tracing.folded import FoldedMirror
from ....optics.tracing.obscuration import Obstructions, WindowFrame
from ....optics.tracing.walls import let_out, pose_of
from ....simulation.scenes.boxes import meet
from ....simulation.scenes.worlds.decor import ROOM
from ....simulation.scenes.worlds.room import SOLIDS
from .designs.sensors import in_place
from .messages import BlockValues, columns_of

TURNS = 12  # meridians with traced rays
PROFILE = 37  # samples of a mirror profile, axis to rim
ARC = 33  # samples of a dome profile
BARREL = 1.2  # drawn length of the lens, in half-widths
AWAY = 12.0  # length of rays if the sensor is outside the room, in rim radii
FRAME_SHARE = 0.3  # drawn width of the opaque frame of a window, in window radii
NODES = ("lens", "second", "mirror", "wall", "end")
"""Nodes of a ray, from the lens outwards; non-finite if the ray skips a node."""
READINGS = ("omega_deg", "incidence_deg", "u_px", "v_px", "x_mm", "y_mm", "z_mm", "turn_deg", "is_hidden")
"""Readings of a ray; x, y and z are those of its mirror point in the mirror frame."""
RAYS = (*READINGS, *(f"{node}_{axis}" for node in NODES for axis in "xyz"))


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
    blocks.append(columns_of("rays", RAYS, _rays(sensor, heights_px, world)))
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
    yield columns_of(f"part {part.name}", ("r_mm", "z_mm"), np.stack([part.radius_mm, part.height_mm]))
    frame = np.column_stack([world @ part.pose.rotation(), world @ part.pose.shift])
    yield columns_of(f"frame {part.name}", ("x", "y", "z", "origin"), frame.T)


# -- parts
# -----------------------------------------------------------------------------------------------


def _parts(sensor: Sensor) -> Iterator[TurnedPart]:
    straight = in_place(sensor)
    yield from _bodies(sensor, straight)
    yield from _lens(straight)
    standing = sensor.obstructions
    if standing.rod is not None:
        (foot, wide), (top, narrow) = standing.rod.ends
        yield TurnedPart("rod", np.array([0.0, wide, narrow]), np.array([foot, foot, top]))
    for disc in standing.discs:
        if isinstance(disc, WindowFrame):
            inner, outer = disc.radius_mm, disc.radius_mm * (1 + FRAME_SHARE)
        else:
            inner, outer = 0.0, disc.radius_mm
        yield TurnedPart(disc.part, np.array([inner, outer]), np.full(2, disc.height_mm))
    if (shell := standing.housing.shell) is not None:
        yield _wall(shell, standing.envelope.base_mm, standing.envelope.back_mm, standing.envelope.outer_mm)


def _bodies(sensor: Sensor, straight: Sensor) -> Iterator[TurnedPart]:
    """Yield both mirrors, and the body of the first with its rim."""
    curve, envelope = mirror_curve(straight, 2 * PROFILE - 1), sensor.obstructions.envelope
    half = (curve.x >= 0) & np.isfinite(curve.z)
    x, z = curve.x[half], curve.z[half]
    pose = sensor.mirror_pose
    yield TurnedPart("mirror", x, z, pose)
    rim = sensor.obstructions.rim
    front = z[-1] if rim is None else rim.height_mm
    edge = [x[-1], x[-1], envelope.outer_mm, envelope.outer_mm, x[0]], [z[-1], front, front, *2 * (envelope.back_mm,)]
    yield TurnedPart("body", np.array(edge[0]), np.array(edge[1]), pose)
    if (second := secondary_curve(straight, 2 * PROFILE - 1)) is not None:
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
        return TurnedPart("window", np.array([0.0, radius, radius, 0.0]), np.array([inner, inner, outer, outer]), pose)
    inner, outer = shell.radii_mm
    if not isinstance(shell, Dome):
        return TurnedPart(
            "tube", np.array([inner, inner, outer, outer]), np.array([base_mm, back_mm, back_mm, base_mm]), pose
        )
    sides = []
    for radius, centre in zip((inner, outer), shell.centres_mm, strict=True):
        angle = np.linspace(np.arcsin(np.clip((base_mm - centre) / radius, -1, 1)), np.pi / 2, ARC)
        sides.append((radius * np.cos(angle), centre + radius * np.sin(angle)))
    (r0, z0), (r1, z1) = sides
    return TurnedPart("dome", np.concatenate([r0, [np.nan], r1]), np.concatenate([z0, [np.nan], z1]), pose)


# -- rays
# ------------------------------------------------------------------------------------------------


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


def _rays(sensor: Sensor, heights_px: Array, world: Array) -> Array:
    """Return readings and nodes of rays (columns, n), by meridian, starting with the forward
    meridian."""
    turns = np.repeat(np.arange(TURNS) * 360 / TURNS, len(heights_px))
    azimuth = np.radians(sensor.mount.forward_azimuth_deg + turns)
    places = np.tile(heights_px, TURNS)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    pixels = sensor.image_plane.pixels(sensor.imager.pitch_mm * places)
    pixels[~inside_image(pixels, sensor.image_size)] = np.nan
    legs = _legs(sensor, pixels)
    wall, end, outside, is_hidden = _ways_out(sensor, legs, world)
    cosines = -outside[:, 2], np.abs((legs.before * legs.normals).sum(axis=1))
    omega, incidence = np.degrees(np.arccos(np.clip(cosines, -1, 1)))  # rounding errors can exceed 1
    at = sensor.mirror_pose.to_mirror(legs.mirror)
    nodes = [turned(node, world.T) for node in (legs.lens, legs.second, legs.mirror, wall)]
    return np.stack(
        [omega, incidence, *pixels.T, *at.T, turns, is_hidden, *(row for n in (*nodes, end) for row in n.T)]
    )


def _legs(sensor: Sensor, pixels: Array) -> _Legs:
    """Trace the chief rays of pixels (n, 2) from the lens to the mirror."""
    bare = replace(sensor, housing=Housing())  # the tube is traced afterwards
    mirror = bare.optical_train.posed_mirror
    lens, towards = bare.lens_rays(pixels, np.zeros(2))
    found = mirror.trace(lens, towards)
    second, before = np.full_like(lens, np.nan), towards
    if isinstance(mirror, FoldedMirror):
        second, before = mirror.off_secondary(lens, towards)
        lens, towards = mirror.over(lens), towards * (1, 1, -1)
    if sensor.lens.TELECENTRIC:  # at an arbitrary axial position
        lens = lens + ((lens_height(in_place(sensor)) - lens[:, 2]) / towards[:, 2])[:, None] * towards
    lens = np.where(found.valid[:, None], lens, np.nan)
    unit = before / np.linalg.norm(before, axis=1, keepdims=True)
    return _Legs(lens, second, found.points, unit, found.directions, found.normals)


def _ways_out(sensor: Sensor, legs: _Legs, world: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Return the exit points from a cover and the end points of rays (n, 3) in the world frame,
    with the next points and an obscuration mask."""
    standing, shell = sensor.obstructions, sensor.obstructions.housing.shell
    points, towards = legs.mirror, legs.after
    masks = standing.met_by(points, towards, -legs.before, sensor.mirror_pose).values()
    is_hidden = np.any([np.zeros(len(points), dtype=bool), *masks], axis=0)
    wall = np.full_like(points, np.nan)
    if shell is not None:
        seen = np.isfinite(points[:, 0]) & ~is_hidden
        left = let_out(shell, points[seen], towards[seen])
        wall[seen], towards = left.points, towards.copy()
        towards[seen] = left.directions
    start, direction = turned(np.where(np.isfinite(wall), wall, points), world.T), turned(towards, world.T)
    far = np.full(len(points), AWAY * sensor.mirror.rim_radius_mm)
    inside = ((start >= ROOM.low) & (start <= ROOM.high)).all(axis=1)
    far[inside] = meet(ROOM, SOLIDS, start[inside], direction[inside]).distance
    stopped = _stopped_after(standing, points, towards)
    far = np.where(is_hidden, np.where(np.isfinite(stopped), stopped, 0.0), far)
    return wall, start + far[:, None] * direction, towards, is_hidden


def _stopped_after(standing: Obstructions, points: Array, towards: Array) -> Array:
    """Return the path length (n,), mm, to the first opaque disc; infinite without intersection."""
    way = np.full(len(points), np.inf)
    for disc in standing.discs:
        with np.errstate(invalid="ignore", divide="ignore"):
            steps = (disc.height_mm - points[:, 2]) / towards[:, 2]
        way = np.where(disc.clearance(points, towards) < 0, np.minimum(way, steps), way)
    return way
