"""Skew rays through transparent shells: Fresnel transmission and refraction by tubes, domes and windows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.errors import InvalidParameter
from ...base.native import backend, kernel_array
from ...base.typing import Array, Mask
from ..housing import FlatWindow, Shell, Tube
from ..mirrors.mirror import MirrorPose

AXIS = np.array([0.0, 0.0, 1.0])


def wall_transmission(
    incidence: ArrayLike,
    refractive_index: float,
    behind: ArrayLike | None = None,
    medium_index: float = 1.0,
) -> Array:
    """Return the transmittance (n,) of a clear wall for unpolarised light, at angles in radians.

    Fresnel's equations with incoherent multiple reflections for each polarisation; the remainder is
    reflected. For a curved wall, or an outer medium other than air, the exit angle ``behind``
    differs from the angle of incidence.

    >>> wall_transmission(np.radians([0.0, 45.0]), 1.5).round(4)  # 12/13 straight through
    array([0.9231, 0.9073])
    """
    first = _fresnel(np.asarray(incidence, dtype=float), refractive_index)
    second = first
    if behind is not None:
        second = _fresnel(np.asarray(behind, dtype=float), refractive_index / medium_index)
    # incoherent sum over multiple reflections: T = (1 - R1)(1 - R2) / (1 - R1 R2)
    each = [
        (1 - a) * (1 - b) / np.maximum(1 - a * b, 1e-300)
        for a, b in zip(first, second, strict=True)
    ]
    passed: Array = (each[0] + each[1]) / 2
    return passed


def _fresnel(angle: Array, refractive_index: float) -> tuple[Array, Array]:
    """Return the reflectances of one surface for both polarisations, given its relative index."""
    n, cos_i = refractive_index, np.cos(angle)
    cos_t = np.sqrt(np.maximum(1 - (np.sin(angle) / n) ** 2, 0.0))
    return ((cos_i - n * cos_t) / (cos_i + n * cos_t)) ** 2, (
        (n * cos_i - cos_t) / (n * cos_i + cos_t)
    ) ** 2


class ShellTransit(NamedTuple):
    """Rays (n,) that leave a tube or dome from inside."""

    points: Array
    """(n, 3): exit points."""
    directions: Array
    """(n, 3): unit directions outside."""
    met: Array
    """(n, 3): intersections with the inner surface."""
    reflected: Array
    """(n, 3): unit directions of the internally reflected part."""
    passed: Array
    """(n,): transmittance; 1 for undeviated rays that do not meet the wall."""


def transmit_from_inside(shell: Shell, points: Array, directions: Array) -> ShellTransit:
    """Trace rays (n, 3), (n, 3) from inside a tube or dome through its wall.

    Coordinates are in the camera frame, whose origin is the nominal mirror vertex; sizes must be
    known.

    Raises
    ------
    InvalidParameter
        If a ray starts outside.
    """
    distances, reach = _radial_distances(shell, points)
    if (distances > reach).any():
        raise InvalidParameter(
            f"rays must start within {reach:g} mm of the "
            f"{'axis' if isinstance(shell, Tube) else 'centre'} of the {shell.KIND}, its "
            f"inner radius; got {distances.max():.4g} mm"
        )
    return transmit_rays(shell, points, directions)


class ShellExit(NamedTuple):
    """Paths of rays (n,) through a wall, without transmittance."""

    points: Array
    """(n, 3): exit points; the origins of rays that do not meet the wall."""
    directions: Array
    """(n, 3): unit directions outside."""
    met: Array
    """(n, 3): intersections with the inner surface."""
    incident: Array
    """(n, 3): unit directions inside."""
    inwards: Array
    """(n, 3): unit normals of the inner surface at the intersections."""
    lengths: tuple[Array, Array]
    """(n,): lengths up to the inner surface, and within the wall."""
    cosines: tuple[Array, Array]
    """(n,): cosines of the angles to the normals, inside and outside."""
    meets: Mask
    """(n,): False for rays along a tube, and for rays from the wrong side of a window."""
    passes: Mask
    """(n,): True if any light is transmitted."""


def transmit_rays(shell: Shell, points: Array, directions: Array) -> ShellTransit:
    """Trace rays as :func:`transmit_from_inside`, with zero transmittance for rays that start outside."""
    if not shell.is_axial:
        pose = pose_of(shell)
        transit = transmit_rays(
            shell.centred(), pose.to_mirror(points), pose.rotate_to_mirror(directions)
        )
        to_points, to_directions = pose.to_camera, pose.rotate_to_camera
        return ShellTransit(
            to_points(transit.points),
            to_directions(transit.directions),
            to_points(transit.met),
            to_directions(transit.reflected),
            transit.passed,
        )
    return _with_transmittance(
        shell_exit(shell, points, directions), shell.index, shell.outer_index
    )


def shell_exit(shell: Shell, points: Array, directions: Array) -> ShellExit:
    """Return the paths of :func:`transmit_rays` without transmittance."""
    if not shell.is_axial:
        pose = pose_of(shell)
        transit = shell_exit(
            shell.centred(), pose.to_mirror(points), pose.rotate_to_mirror(directions)
        )
        turn = pose.rotate_to_camera
        return transit._replace(
            points=pose.to_camera(transit.points),
            directions=turn(transit.directions),
            met=pose.to_camera(transit.met),
            incident=turn(transit.incident),
            inwards=turn(transit.inwards),
        )
    trace_exit = shell_exit_compiled if backend.is_compiled else shell_exit_numpy
    return trace_exit(shell, points, directions)


def shell_exit_compiled(shell: Shell, points: Array, directions: Array) -> ShellExit:
    """Trace rays as :func:`shell_exit_numpy`, by a compiled kernel, to rounding."""
    points, directions = (
        kernel_array(rays, np.float64) for rays in np.broadcast_arrays(points, directions)
    )
    count = len(points)
    vectors, numbers, flags = (
        np.empty((5, count, 3)),
        np.empty((4, count)),
        np.empty((2, count), np.bool_),
    )
    backend.kernels.shell_exit(
        shell_kernel_arguments(shell), points, directions, vectors, numbers, flags.view(np.uint8)
    )
    exit_points, outwards, met, incident, inwards = vectors
    before, within, cosine, behind = numbers
    return ShellExit(
        exit_points, outwards, met, incident, inwards, (before, within), (cosine, behind), *flags
    )


def shell_kernel_arguments(
    shell: Shell,
) -> tuple[int, tuple[float, float], tuple[float, float], float, float]:
    """Return the kernel arguments of a wall: kind, positions, radii, its index and that outside."""
    if isinstance(shell, FlatWindow):
        return 0, shell.heights_mm, (0.0, 0.0), shell.index, shell.outer_index
    if isinstance(shell, Tube):
        return 1, (0.0, 0.0), shell.radii_mm, shell.index, shell.outer_index
    return 2, shell.centres_mm, shell.radii_mm, shell.index, shell.outer_index


def shell_exit_numpy(shell: Shell, points: Array, directions: Array) -> ShellExit:
    """Trace rays (n, 3), (n, 3) through a wall about the axis, in NumPy."""
    indices = shell.index, shell.outer_index
    if isinstance(shell, FlatWindow):
        return through_window(points, directions, shell.heights_mm, *indices)
    inner, outer = shell.radii_mm
    if isinstance(shell, Tube):
        transit = through_tube(points, directions, outer, shell.wall_mm, *indices)
    else:
        inner_centre, outer_centre = (AXIS * height for height in shell.centres_mm)
        transit = through_dome(
            points, directions, (inner_centre, inner), (outer_centre, outer), *indices
        )
    return transit._replace(passes=transit.passes & (_radial_distances(shell, points)[0] <= inner))


def _with_transmittance(
    transit: ShellExit, refractive_index: float, medium_index: float
) -> ShellTransit:
    """Return transmitted and reflected parts; rays that do not meet the wall pass completely."""
    before, behind = (np.arccos(np.clip(cosine, 0, 1)) for cosine in transit.cosines)
    transmittance = np.where(
        transit.meets, wall_transmission(before, refractive_index, behind, medium_index), 1.0
    )
    back = transit.incident + 2 * (transit.cosines[0] * transit.meets)[:, None] * transit.inwards
    return ShellTransit(
        transit.points,
        transit.directions,
        transit.met,
        back,
        np.where(transit.passes, transmittance, 0.0),
    )


def pose_of(shell: Shell) -> MirrorPose:
    """Return the pose of a tube or dome as a mirror pose."""
    return MirrorPose(
        shell.decentre_x_mm, shell.decentre_y_mm, 0.0, shell.tilt_x_deg, shell.tilt_y_deg
    )


def _radial_distances(shell: Shell, points: Array) -> tuple[Array, float]:
    """Return distances (n,) from the tube axis or dome centre, and their limit.

    For a window, they are depths below its inner surface.
    """
    inside = points if shell.is_axial else pose_of(shell).to_mirror(points)
    if isinstance(shell, FlatWindow):
        return shell.heights_mm[0] - inside[:, 2], 0.0
    if isinstance(shell, Tube):
        return np.hypot(inside[:, 0], inside[:, 1]), shell.radii_mm[0]
    from_centre = inside - AXIS * shell.centres_mm[0]
    return np.sqrt(_dot(from_centre, from_centre)), shell.radii_mm[0]


def through_window(
    points: Array,
    directions: Array,
    heights: tuple[float, float],
    refractive_index: float,
    medium_index: float,
) -> ShellExit:
    """Refract descending rays at both surfaces of a pane perpendicular to the axis.

    Parameters
    ----------
    points, directions : (n, 3)
    heights
        Heights of the inner and the outer surface.
    refractive_index, medium_index
        Indices of the pane, and of the outer medium.
    """
    d = _unit(directions)
    up = np.broadcast_to(AXIS, d.shape)
    passes = (d[:, 2] < 0) & (points[:, 2] > heights[0])
    column = passes[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        before = (heights[0] - points[:, 2]) / d[:, 2]
        entry = points + before[:, None] * d
        inside = _refracted(d, up, 1 / refractive_index)
        within = (heights[1] - heights[0]) / inside[:, 2]
        exit_ = entry + within[:, None] * inside
        out = _refracted(inside, up, refractive_index / medium_index)
    return ShellExit(
        np.where(column, exit_, points),
        np.where(column, out, d),
        np.where(column, entry, points),
        d,
        up,
        (np.where(passes, before, 0.0), np.where(passes, within, 0.0)),
        (-d[:, 2], -out[:, 2]),
        passes,
        passes,
    )


def through_tube(
    points: Array,
    directions: Array,
    outer_radius: float,
    wall: float,
    refractive_index: float,
    medium_index: float,
) -> ShellExit:
    """Refract rays from inside a tube about the z axis through its wall.

    Parameters
    ----------
    points, directions : (n, 3)
    outer_radius, wall
        Outer radius and wall thickness, in the unit of the points.
    refractive_index, medium_index
        Indices of the wall, and of the outer medium.
    """
    d = _unit(directions)
    meets = np.hypot(d[:, 0], d[:, 1]) > 1e-9
    entry, inwards, before = _meet(points, d, outer_radius - wall)
    inside = _refracted(d, inwards, 1 / refractive_index)
    exit_, normal, within = _meet(entry, inside, outer_radius)
    out = _refracted(inside, normal, refractive_index / medium_index)
    cosines = -_dot(d, inwards), -_dot(out, normal)
    passes = (cosines[0] > 0) & (cosines[1] > 0)
    if not meets.all():
        column = meets[:, None]
        exit_, out, entry = (
            np.where(column, new, old) for new, old in ((exit_, points), (out, d), (entry, points))
        )
        before, within, passes = before * meets, within * meets, passes | ~meets
    return ShellExit(exit_, out, entry, d, inwards, (before, within), cosines, meets, passes)


def through_dome(
    points: Array,
    directions: Array,
    inner: tuple[Array, float],
    outer: tuple[Array, float],
    refractive_index: float,
    medium_index: float,
) -> ShellExit:
    """Refract rays from inside a dome through its two spheres.

    Parameters
    ----------
    points, directions : (n, 3)
    inner, outer
        Centre (3,) and radius of each sphere, in the unit of the points.
    refractive_index, medium_index
        Indices of the wall, and of the outer medium.

    Notes
    -----
    For concentric spheres, a ray that passes the centre at a distance s leaves at the same distance
    and is deviated by asin(s/a) - asin(s/(n a)) + asin(s/(n b)) - asin(s/b) for radii a and b.
    """
    d = _unit(directions)
    entry, inwards, before = _meet_sphere(points, d, *inner)
    inside = _refracted(d, inwards, 1 / refractive_index)
    exit_, normal, within = _meet_sphere(entry, inside, *outer)
    out = _refracted(inside, normal, refractive_index / medium_index)
    cosines = -_dot(d, inwards), -_dot(out, normal)
    passes = (cosines[0] > 0) & (cosines[1] > 0)
    return ShellExit(
        exit_, out, entry, d, inwards, (before, within), cosines, np.ones(len(d), bool), passes
    )


def _meet_sphere(
    points: Array, d: Array, centre: Array, radius: float
) -> tuple[Array, Array, Array]:
    """Return intersections with a sphere from inside, inward normals and lengths."""
    p = points - centre
    b, c = _dot(p, d), _dot(p, p) - radius**2
    distance = np.sqrt(np.maximum(b**2 - c, 0)) - b
    entry = points + distance[:, None] * d
    return entry, (centre - entry) / radius, distance


def _meet(points: Array, d: Array, radius: float) -> tuple[Array, Array, Array]:
    """Return intersections with a cylinder from inside, inward normals and lengths."""
    (x, y), (u, v) = points[:, :2].T, d[:, :2].T
    a, b, c = u * u + v * v, x * u + y * v, x * x + y * y - radius**2
    distance = (np.sqrt(np.maximum(b * b - a * c, 0)) - b) / np.maximum(a, 1e-18)
    met = points + distance[:, None] * d
    normals = met / -radius
    normals[:, 2] = 0.0
    return met, normals, distance


def _dot(a: Array, b: Array) -> Array:
    products: Array = np.einsum("ni,ni->n", a, b)
    return products


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.sqrt(_dot(vectors, vectors))[:, None]
    return unit


def _refracted(d: Array, normal: Array, ratio: float) -> Array:
    """Return unit directions after refraction; ``ratio`` is the index before over that behind."""
    cosine = -_dot(d, normal)
    behind = np.sqrt(np.maximum(1 - ratio**2 * (1 - cosine**2), 0))
    # t = r d + (r cos(i) - cos(t)) n, with cos(t)^2 = 1 - r^2 (1 - cos(i)^2)
    refracted: Array = ratio * d + (ratio * cosine - behind)[:, None] * normal
    return refracted
