"""STL and 3MF: triangle mesh of a body within a chord tolerance of the mirror."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ..body import Body
from ..surface_approximation import chords, deviation_um

Indices = NDArray[np.int64]

MAX_TRIANGLES = 8_000_000


def mesh_of(mirror: Mirror, body: Body, tolerance_um: float = 10.0) -> tuple[Array, Indices]:
    """Triangulate a body: vertices (n, 3) in mm and triangles (k, 3) of a closed, outward-oriented mesh.

    All vertices of the mirror surface are on it. Half of the tolerance is used along the meridian and
    half around the axis, where a chord at radius r deviates by ``r (1 - cos(pi/n)) sin(beta)``.

    Raises
    ------
    InvalidParameter
        If the tolerance is not positive or requires more than eight million triangles.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> vertices, triangles = mesh_of(Sphere(50.0, 40.0), Body(), tolerance_um=100)
    >>> len(triangles) == 2 * len(vertices) - 4  # Euler characteristic of a closed surface of genus 0
    True
    """
    if not tolerance_um > 0:
        raise InvalidParameter(f"chord_tolerance_um must be positive; got {tolerance_um:g}")
    x = chords(mirror, tolerance_um / 2, body.start_mm())
    # the outline ends at the start of the meridian
    profile = np.concatenate([np.stack([x, mirror.sag(x)], axis=-1), body.outline(mirror)[1:-1]])
    segments = _segments(mirror, tolerance_um / 2)
    if 2 * segments * len(profile) > MAX_TRIANGLES:
        raise InvalidParameter(
            f"chord_tolerance_um must result in at most {MAX_TRIANGLES} triangles; {tolerance_um:g} requires "
            f"{2 * segments * len(profile)}; use a larger value"
        )
    return turned(profile, segments, closed=body.bore_goes_through)


def _segments(mirror: Mirror, tolerance_um: float) -> int:
    """Return the number of steps around the axis, a multiple of four for exact extents in x and y."""
    x = np.linspace(0.0, mirror.rim_radius_mm, 1025)
    slope = np.abs(mirror.slope(x))
    reach = float((x * slope / np.sqrt(1 + slope**2)).max())  # r sin(beta)
    # the tolerance does not apply to cylinders: a flange may be coarser than the mirror
    minimum = 64
    if reach <= 1e-3 * tolerance_um:
        return minimum
    return max(
        minimum, 4 * int(np.ceil(np.pi / np.arccos(max(1 - 1e-3 * tolerance_um / reach, 0.0)) / 4))
    )


def turned(profile: Array, segments: int, closed: bool = False) -> tuple[Array, Indices]:
    """Revolve a profile (n, 2) of (x, z) about the axis, with its interior on the left.

    An open profile starts and ends on the axis; a closed one forms a ring.

    >>> vertices, triangles = turned(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]), 4)
    >>> vertices.shape, triangles.shape  # a square prism
    ((10, 3), (16, 3))
    """
    rings = profile if closed else profile[1:-1]
    angle = 2 * np.pi * np.arange(segments) / segments
    cos, sin = np.cos(angle), np.sin(angle)
    x, z = rings[:, :1], np.broadcast_to(rings[:, 1:], (len(rings), segments))
    vertices = np.stack([x * cos, x * sin, z], axis=-1).reshape(-1, 3)
    here = np.arange(segments)
    there = (here + 1) % segments
    below = segments * np.arange(len(rings))[:, None]
    above = np.roll(below, -1, axis=0) if closed else below[1:]
    below = below if closed else below[:-1]
    sides = [
        (below + here, below + there, above + there),
        (below + here, above + there, above + here),
    ]
    triangles = [
        np.stack(np.broadcast_arrays(*corners), axis=-1).reshape(-1, 3) for corners in sides
    ]
    if not closed:
        first, last = len(vertices), len(vertices) + 1
        vertices = np.concatenate(
            [vertices, [[0.0, 0.0, profile[0, 1]], [0.0, 0.0, profile[-1, 1]]]]
        )
        end = segments * (len(rings) - 1)
        triangles += [
            np.stack([np.full(segments, first), there, here], axis=-1),
            np.stack([np.full(segments, last), end + here, end + there], axis=-1),
        ]
    return vertices, np.concatenate(triangles).astype(np.int64)


def mesh_deviation_um(mirror: Mirror, vertices: Array, triangles: Indices, body: Body) -> float:
    """Compute the maximum distance of mesh triangles from the mirror, um, at 91 points per triangle.

    Triangles of the mirror surface are those with all corners on it. By symmetry, one step around the
    axis is sufficient.
    """
    r, rim = np.hypot(vertices[:, 0], vertices[:, 1]), mirror.rim_radius_mm
    azimuth = np.arctan2(vertices[:, 1], vertices[:, 0])
    step = azimuth[azimuth > 1e-6].min()
    inside = (r <= rim * (1 + 1e-6)) & (r >= body.start_mm() * (1 - 1e-6))
    on_surface = inside & (np.abs(deviation_um(mirror, r, vertices[:, 2])) < 0.1)
    slot = (azimuth > -1e-6) & (azimuth < 1.001 * step)
    corners = vertices[triangles[(on_surface & (slot | (r == 0)))[triangles].all(axis=1)]]
    parts = 12
    weights = (
        np.array([(i, j, parts - i - j) for i in range(parts + 1) for j in range(parts + 1 - i)])
        / parts
    )
    points = np.einsum("wc,kcd->kwd", weights, corners)
    return float(
        np.abs(deviation_um(mirror, np.hypot(points[..., 0], points[..., 1]), points[..., 2])).max()
    )


def write_mesh(path: Path, mirror: Mirror, body: Body, tolerance_um: float) -> tuple[float, int]:
    """Write .stl or .3mf in mm; return the deviation from the mirror (um) and the number of triangles.

    The deviation includes the rounding of STL files to single precision.
    """
    import trimesh
    from trimesh.exchange.stl import export_stl
    from trimesh.exchange.threemf import export_3MF

    vertices, triangles = mesh_of(mirror, body, tolerance_um)
    mesh = trimesh.Trimesh(vertices, triangles, process=False)
    if path.suffix == ".stl":
        path.write_bytes(export_stl(mesh))
        stored = vertices.astype(np.float32).astype(np.float64)
    else:
        write: Any = export_3MF  # the 3MF writer sets the unit millimetre
        path.write_bytes(write(mesh))
        stored = vertices
    return mesh_deviation_um(mirror, stored, triangles, body), len(triangles)
