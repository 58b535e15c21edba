"""A design in space: its parts as profiles about axes, its chief rays as they really run, and the room around it.

All places are in mm in the world's frame, whose origin is where the mirror's vertex is meant to be.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....analysis.section import lens_half_width, lens_height, mirror_curve, secondary_curve
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

Array = NDArray[np.float64]

TURNS = 12  # meridians in which rays run
PROFILE = 37  # points of a mirror from axis to rim
ARC = 33  # of a dome
BARREL = 1.2  # length of the lens that is drawn, in its half-widths
AWAY = 12.0  # rim radii that rays are followed where the sensor is not in the room
FRAME_SHARE = 0.3  # how wide the opaque surroundings of a window are drawn, in its radii
NODES = ("lens", "second", "mirror", "wall", "end")
"""Places that a ray goes by, from the lens outwards; not finite where it goes by none."""
READINGS = ("omega_deg", "incidence_deg", "u_px", "v_px", "x_mm", "y_mm", "z_mm", "turn_deg", "is_hidden")
"""What is read of a ray: x, y and z are of its mirror point in the mirror's own frame."""
RAYS = (*READINGS, *(f"{node}_{axis}" for node in NODES for axis in "xyz"))


class TurnedPart(NamedTuple):
    """A part that is round about an axis: radii and heights of its profile, and where the axis stands."""

    name: str
    radius_mm: Array
    height_mm: Array
    pose: MirrorPose = MirrorPose()


def space_blocks(sensor: Sensor, heights_px: Array) -> list[BlockValues]:
    """Parts of a sensor as it stands, chief rays of image heights (n,) in several meridians, and a room's boxes.

    Parameters
    ----------
    sensor
        Perhaps with a mirror, a cover or an imager out of place.
    heights_px
        Image heights of the field angles that are shown, as they are of the sensor in place.
    """
    world = _world_of(sensor)
    blocks = [b for part in _parts(sensor) for b in _blocks_of(part, world)]
    blocks.append(columns_of("rays", RAYS, _rays(sensor, heights_px, world)))
    boxes = np.array([(*box.low, *box.high) for box in (ROOM, *SOLIDS)]).T
    return [*blocks, columns_of("room", ("x0", "y0", "z0", "x1", "y1", "z1"), boxes)]


def _world_of(sensor: Sensor) -> Array:
    """World directions (3, 3), in columns, of the camera frame, which is turned over by a second mirror."""
    rotation = sensor.mount.rotation()
    world: Array = rotation * [1.0, 1.0, np.sign(-sensor.axis @ rotation[:, 2])]
    return world


def _blocks_of(part: TurnedPart, world: Array) -> Iterator[BlockValues]:
    """Its profile, and the frame that it stands in: three axes and the origin, in columns."""
    yield columns_of(f"part {part.name}", ("r_mm", "z_mm"), np.stack([part.radius_mm, part.height_mm]))
    frame = np.column_stack([world @ part.pose.rotation(), world @ part.pose.shift])
    yield columns_of(f"frame {part.name}", ("x", "y", "z", "origin"), frame.T)


# -- parts -----------------------------------------------------------------------------------------------


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
    """Both mirrors, and the body of the first with its rim."""
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
    """The front of the lens, and its barrel behind."""
    half, height = lens_half_width(straight), lens_height(straight)
    behind = height + (BARREL * half if straight.secondary is not None else -BARREL * half)
    yield TurnedPart("lens", np.array([0.0, half]), np.full(2, height))
    yield TurnedPart("barrel", np.array([half, half, 0.0]), np.array([height, behind, behind]))


def _wall(shell: Shell, base_mm: float, back_mm: float, outer_mm: float) -> TurnedPart:
    """The closed outline of a clear wall."""
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


# -- rays ------------------------------------------------------------------------------------------------


class _Legs(NamedTuple):
    """Rays (n, 3), mm, from the lens to the mirror, in the camera frame; not finite where there is none."""

    lens: Array
    second: Array
    mirror: Array
    before: Array
    """Directions in which they come to the mirror."""
    after: Array
    """And leave it."""
    normals: Array


def _rays(sensor: Sensor, heights_px: Array, world: Array) -> Array:
    """What is read of rays, and where they go by (columns, n): meridian by meridian, first that which looks forward."""
    turns = np.repeat(np.arange(TURNS) * 360 / TURNS, len(heights_px))
    azimuth = np.radians(sensor.mount.forward_azimuth_deg + turns)
    places = np.tile(heights_px, TURNS)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
    pixels = sensor.image_plane.pixels(sensor.imager.pitch_mm * places)
    pixels[~inside_image(pixels, sensor.image_size)] = np.nan
    legs = _legs(sensor, pixels)
    wall, end, outside, is_hidden = _ways_out(sensor, legs, world)
    cosines = -outside[:, 2], np.abs((legs.before * legs.normals).sum(axis=1))
    omega, incidence = np.degrees(np.arccos(np.clip(cosines, -1, 1)))  # rounded, one may exceed 1
    at = sensor.mirror_pose.to_mirror(legs.mirror)
    nodes = [turned(node, world.T) for node in (legs.lens, legs.second, legs.mirror, wall)]
    return np.stack(
        [omega, incidence, *pixels.T, *at.T, turns, is_hidden, *(row for n in (*nodes, end) for row in n.T)]
    )


def _legs(sensor: Sensor, pixels: Array) -> _Legs:
    """The chief rays of pixels (n, 2) from the lens to where they leave the mirror."""
    bare = replace(sensor, housing=Housing())  # what a tube does to the light follows
    mirror = bare.optical_train.posed_mirror
    lens, towards = bare.lens_rays(pixels, np.zeros(2))
    found = mirror.trace(lens, towards)
    second, before = np.full_like(lens, np.nan), towards
    if isinstance(mirror, FoldedMirror):
        second, before = mirror.off_secondary(lens, towards)
        lens, towards = mirror.over(lens), towards * (1, 1, -1)
    if sensor.lens.TELECENTRIC:  # which may stand anywhere
        lens = lens + ((lens_height(in_place(sensor)) - lens[:, 2]) / towards[:, 2])[:, None] * towards
    lens = np.where(found.valid[:, None], lens, np.nan)
    unit = before / np.linalg.norm(before, axis=1, keepdims=True)
    return _Legs(lens, second, found.points, unit, found.directions, found.normals)


def _ways_out(sensor: Sensor, legs: _Legs, world: Array) -> tuple[Array, Array, Array, NDArray[np.bool_]]:
    """Where rays (n, 3) leave a cover and, in the world's frame, end; whereto they lead, and which are hidden."""
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
    """After what way (n,), mm, rays end at a disc; infinite if at none."""
    way = np.full(len(points), np.inf)
    for disc in standing.discs:
        with np.errstate(invalid="ignore", divide="ignore"):
            steps = (disc.height_mm - points[:, 2]) / towards[:, 2]
        way = np.where(disc.clearance(points, towards) < 0, np.minimum(way, steps), way)
    return way
