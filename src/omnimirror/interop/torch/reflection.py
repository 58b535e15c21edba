"""Reflection points on tensors, found without gradients and recorded by one step of Newton's rule.

Where F(q, p) = 0 tells a reflection point q of a sensor with parameters p, the step ``q - J^-1 F(q, p)``, J its
derivative by q and taken as a constant, stays at q and has the derivative ``-J^-1 dF/dp``: that of the theorem of
implicit functions. So gradients are exact, and cost as much as that step however many went before it. Along a ray from
the lens F is how far a point is from the surface; from a point of the world it is the gradient of the light's way
across the surface (Fermat; see :mod:`omnimirror.tracing.reflection`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ...mirrors import Mirror
from ...tracing.reflection import CELLS, LONGEST_STEP, REFLECTS, RIM_SLACK, Ends, MirrorTables, specular_points
from ...tracing.reflection.beginning import FIRST_CLOSE, FIRST_STEPS, REACH, SEARCH, STEPS
from .compiled import SeenPoints, meetings, reflections, serves
from .library import Tensor, torch
from .pieces import Pieces

Components = tuple[Tensor, Tensor, Tensor]

CLOSE = 1e-9  # of the rim radius: the step that is recorded leaves its square
AXIS = 1e-24  # mm^2, added to squared distances from the axis: there they have a derivative then


class Met(NamedTuple):
    """Where something meets the surface, in the mirror's frame."""

    points: Components
    slopes: tuple[Tensor, Tensor]
    """dz/dx, dz/dy."""
    valid: Tensor


class Learned(NamedTuple):
    """A parameter of the shape that is free."""

    value: Tensor
    rates: Pieces
    """Derivatives of sag and slope."""


SAG, SLOPE = 0, 1


@dataclass(frozen=True)
class SurfaceTable:
    """A mirror's surface on a device, with where to begin to look for reflection points."""

    mirror: Mirror
    tables: MirrorTables
    """From which the others are made."""
    pieces: Pieces
    """Sag and slope by the distance from the axis."""
    depth: Pieces | None
    """How far (mm) before the lens, along the axis, what it sees under a tangent lies, were the mirror in line."""
    by_omega: Pieces
    """Distance from the axis (mm), were the lens on it, by the field angle."""
    learned: tuple[Learned, ...] = ()

    @classmethod
    def of(cls, mirror: Mirror, pupil_distance: float, dtype: object, device: object) -> SurfaceTable:
        """A mirror as a lens sees it whose entrance pupil is so far (mm) from its vertex, infinitely if telecentric."""
        tables = MirrorTables.of(mirror, pupil_distance)
        on = partial(Pieces, dtype=dtype, device=device)
        depth = None if tables.depth is None else on(tables.depth)
        return cls(mirror, tables, on(tables.meridian), depth, on(tables.by_omega))

    @property
    def cell_mm(self) -> float:
        """Width of the pieces of its meridian."""
        return self.tables.cell_mm

    def sag(self, x: Tensor, y: Tensor) -> Tensor:
        """Height (n,) over places (n,) mm, with gradients by these and by what is learned."""
        return self._learned(_radius(x, y), SAG)

    def slopes(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """dz/dx and dz/dy, with gradients."""
        r = _radius(x, y)
        tilt = self._learned(r, SLOPE) / r
        return tilt * x, tilt * y

    def _learned(self, r: Tensor, which: int) -> Tensor:
        position = r * (1 / self.cell_mm)
        found = self.pieces.at(self.pieces.place(position), which)
        for number in self.learned if torch.is_grad_enabled() else ():
            rate = number.rates.at(number.rates.place(position.detach()), which)
            found = found + (number.value - number.value.detach()) * rate
        return found

    def flat(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Height and slopes, without what is learned."""
        r = _radius(x, y)
        place = self.pieces.place(r * (1 / self.cell_mm))
        tilt = self.pieces.at(place, SLOPE) / r
        return self.pieces.at(place, SAG), tilt * x, tilt * y

    def bent(self, x: Tensor, y: Tensor) -> tuple[Tensor, ...]:
        """Height, slopes and second derivatives (xx, xy, yy), without gradients."""
        r = _radius(x, y)
        place = self.pieces.place(r * (1 / self.cell_mm))
        slope, rate = self.pieces.with_rate(place, SLOPE)
        bend, hoop, cos, sin = rate * (1 / self.cell_mm), slope / r, x / r, y / r
        across, along = (bend - hoop) * cos, (bend - hoop) * sin
        sag = self.pieces.at(place, SAG)
        return sag, slope * cos, slope * sin, hoop + across * cos, across * sin, hoop + along * sin

    def records(self, *parts: Tensor) -> bool:
        """Whether gradients by these or by what is learned are wanted."""
        numbers = (*parts, *(number.value for number in self.learned))
        return bool(torch.is_grad_enabled()) and any(getattr(number, "requires_grad", False) for number in numbers)

    def inside(self, x: Tensor, y: Tensor) -> Tensor:
        """Whether places are within the rim."""
        return x * x + y * y <= (self.mirror.rim_radius_mm * (1 + RIM_SLACK)) ** 2


def _radius(x: Tensor, y: Tensor) -> Tensor:
    return torch.sqrt(x * x + y * y + AXIS)


# -- along a ray from the lens ------------------------------------------------------------------------


def met_by(surface: SurfaceTable, start: Components, way: Components) -> Met:
    """Where rays from the lens, components of origins and directions in the mirror's frame, meet the mirror."""
    rim = surface.mirror.rim_radius_mm
    if surface.depth is not None and serves(way[0]) and not surface.records(*start, *way):
        return Met(*meetings(surface.tables, SEARCH, start, way, CLOSE))
    with torch.no_grad():
        t = _first_reach(surface, start, way)
        for _ in range(STEPS):
            x, y, z = (a + t * b for a, b in zip(start, way, strict=True))
            sag, sx, sy = surface.flat(x, y)
            closing = way[2] - sx * way[0] - sy * way[1]
            step = (z - sag) / closing
            close = step.abs() <= _close(t) * rim
            if bool(close.all()):
                break
            t = t - step
        else:
            t = t + step
        valid = close & (closing > 0) & (t > 0)
        if not bool(valid.all()):  # what is finite has gradients of 0
            t, closing, step = (torch.where(valid, a, b) for a, b in ((t, 0.0), (closing, 1.0), (step, 0.0)))
    if not torch.is_grad_enabled():  # the last step is too short to turn the surface
        x, y, z = (a + (t - step) * b for a, b in zip(start, way, strict=True))
        return Met((x, y, z), (sx, sy), valid & surface.inside(x, y))
    x, y, z = (a + t * b for a, b in zip(start, way, strict=True))
    t = t - (z - surface.sag(x, y)) / closing
    x, y, z = (a + t * b for a, b in zip(start, way, strict=True))
    return Met((x, y, z), surface.slopes(x, y), valid & surface.inside(x, y))


def _first_reach(surface: SurfaceTable, start: Components, way: Components) -> Tensor:
    """How far along each ray to look first: as if the mirror were in line."""
    if surface.depth is None:
        r = torch.sqrt(start[0] * start[0] + start[1] * start[1]).clamp(max=surface.mirror.rim_radius_mm)
        sag = surface.pieces.at(surface.pieces.place(r * (1 / surface.cell_mm)), SAG)
        return (sag - start[2]) / way[2]
    tangent = torch.sqrt(way[0] * way[0] + way[1] * way[1]) / way[2]
    position = (tangent * (CELLS / surface.tables.most_tangent)).clamp(0, CELLS)
    return surface.depth.at(surface.depth.place(position)) / way[2]


# -- from a point of the world ------------------------------------------------------------------------


def seen_by(surface: SurfaceTable, pupil: Components, target: Components, telecentric: bool, distant: bool) -> Met:
    """Where the lens sees targets, components (n,) in the mirror's frame: points, or unit vectors if distant."""
    ends = (pupil, telecentric), (target, distant)
    seen = reflections(surface.tables, SEARCH, *ends[0], *ends[1]) if serves(target[0]) else None
    if seen and not bool(seen.is_open.any()) and not surface.records(*pupil, *target):
        return Met(seen.points, seen.slopes, seen.valid)
    with torch.no_grad():
        x, y, inverse = _found(surface, ends) if seen is None else _completed(surface, seen, ends)
    sag, (sx, sy) = surface.sag(x, y), surface.slopes(x, y)
    gx, gy = _gradient(x, y, (sag, sx, sy), ends)
    a, b, c = inverse
    x, y = x - (a * gx + b * gy), y - (b * gx + c * gy)
    sag = surface.sag(x, y)
    with torch.no_grad():  # the last step was rounding: slopes and gradient are those before it
        facing = True
        for end, is_distant in ends:
            ux, uy, uz, _ = _pull((x, y, sag), end, is_distant)
            facing = facing & (uz - sx * ux - sy * uy > 0)
        valid = facing & (gx * gx + gy * gy <= max(REFLECTS, _close(gx)) ** 2) & surface.inside(x, y)
    return Met((x, y, sag), (sx, sy), valid)


def _pull(point: Components, end: Components, distant: bool) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Unit vector from an end to points, and one over the distance."""
    if distant:
        zero = 0 * point[0]
        return zero - end[0], zero - end[1], zero - end[2], zero
    dx, dy, dz = (p - e for p, e in zip(point, end, strict=True))
    near = torch.rsqrt(dx * dx + dy * dy + dz * dz)
    return dx * near, dy * near, dz * near, near


Two = tuple[tuple[Components, bool], tuple[Components, bool]]


def _gradient(x: Tensor, y: Tensor, surface: Components, ends: Two) -> tuple[Tensor, Tensor]:
    """How the way of light grows with the place on the surface."""
    sag, sx, sy = surface
    (ax, ay, az, _), (bx, by, bz, _) = (_pull((x, y, sag), end, distant) for end, distant in ends)
    uz = az + bz
    return ax + bx + sx * uz, ay + by + sy * uz


def _newton(surface: SurfaceTable, x: Tensor, y: Tensor, ends: Two) -> tuple[Tensor, ...]:
    """Gradient of the way, and the inverse (xx, xy, yy) of its second derivatives."""
    sag, sx, sy, xx, xy, yy = surface.bent(x, y)
    gx = gy = gz = 0.0
    hxx = hxy = hyy = 0.0
    for end, distant in ends:
        ux, uy, uz, near = _pull((x, y, sag), end, distant)
        gx, gy, gz = gx + ux, gy + uy, gz + uz
        if not distant:
            px, py = ux + sx * uz, uy + sy * uz
            hxx, hxy = hxx + (1 + sx * sx - px * px) * near, hxy + (sx * sy - px * py) * near
            hyy = hyy + (1 + sy * sy - py * py) * near
    a, b, c = hxx + gz * xx, hxy + gz * xy, hyy + gz * yy
    det = a * c - b * b
    return gx + sx * gz, gy + sy * gz, c / det, -b / det, a / det


Found = tuple[Tensor, Tensor, tuple[Tensor, Tensor, Tensor]]


def _completed(surface: SurfaceTable, seen: SeenPoints, ends: Two) -> Found:
    """What kernels found, and NumPy where these did not settle."""
    x, y, _ = seen.points
    if not bool(seen.is_open.any()):
        return x, y, seen.inverse
    _settle(surface, x, y, ends, seen.is_open)
    return _finite(surface, x, y, _newton(surface, x, y, ends)[2:])


def _found(surface: SurfaceTable, ends: Two) -> Found:
    """Reflection points, and the inverse of the second derivatives there."""
    x, y = _first_place(surface, ends)
    rim = surface.mirror.rim_radius_mm
    longest, close = LONGEST_STEP * rim, _close(x) * rim
    size = torch.zeros_like(x)
    for _ in range(STEPS):
        gx, gy, a, b, c = _newton(surface, x, y, ends)
        dx, dy = a * gx + b * gy, b * gx + c * gy
        size = torch.sqrt(dx * dx + dy * dy)
        if not bool((size > close).any()):
            break
        short = (longest / size).clamp(max=1.0)
        x, y = x - short * dx, y - short * dy
        back = (REACH * rim / torch.sqrt(x * x + y * y + AXIS)).clamp(max=1.0)
        x, y = x * back, y * back
    else:
        _settle(surface, x, y, ends, ~(size <= close))
        *_, a, b, c = _newton(surface, x, y, ends)
    return _finite(surface, x, y, (a, b, c))


def _finite(surface: SurfaceTable, x: Tensor, y: Tensor, inverse: Components) -> Found:
    """Something finite where there is nothing: gradients are 0 there, which what is not finite would spoil."""
    found = torch.isfinite(sum(inverse))
    a, b, c = (torch.where(found, part, 0.0) for part in inverse)
    return torch.where(found, x, surface.mirror.rim_radius_mm / 2), torch.where(found, y, 0.0), (a, b, c)


def _first_place(surface: SurfaceTable, ends: Two) -> tuple[Tensor, Tensor]:
    """Where the lens would see targets if the mirror were in line: what light does in their meridian."""
    ((_, _, pupil_z), telecentric), ((tx, ty, tz), distant) = ends
    across = torch.sqrt(tx * tx + ty * ty + AXIS)
    omega = torch.atan2(across, (0.0 if distant else surface.tables.middle_mm) - tz)
    low, high = surface.tables.omegas
    r = surface.by_omega.at(surface.by_omega.place(((omega - low) * (CELLS / (high - low))).clamp(0, CELLS)))
    rim = surface.mirror.rim_radius_mm
    floor = surface.tables.least_mm
    pupil = (0.0, 0.0, pupil_z), telecentric
    target = (across, 0.0, tz), distant
    if not distant:
        for _ in range(FIRST_STEPS):
            step = _along_meridian(surface, r, (pupil, target)).clamp(-LONGEST_STEP * rim, LONGEST_STEP * rim)
            r = (r - step).clamp(floor, REACH * rim)
            if not bool((step.abs() > FIRST_CLOSE * rim).any()):
                break
    r = r.clamp(min=floor)
    return r * tx / across, r * ty / across


def _along_meridian(surface: SurfaceTable, r: Tensor, ends: Two) -> Tensor:
    """Newton's step (n,) from distances r (n,) mm from the axis."""
    place = surface.pieces.place(r * (1 / surface.cell_mm))
    sag, (slope, rate) = surface.pieces.at(place, SAG), surface.pieces.with_rate(place, SLOPE)
    g, gz, h = 0.0, 0.0, 0.0
    for end, distant in ends:
        ux, _, uz, near = _pull((r, 0.0, sag), end, distant)
        along = ux + slope * uz
        g, gz, h = g + along, gz + uz, h + (1 + slope * slope - along * along) * near
    return g / (h + gz * rate / surface.cell_mm)


def _settle(surface: SurfaceTable, x: Tensor, y: Tensor, ends: Two, open_: Tensor) -> None:
    """Have NumPy look for what Newton's rule has not found; it proves what it finds."""
    which = torch.nonzero(open_)[:, 0]
    pupil, target = (
        Ends.of(np.stack([_array(part, which) for part in end], axis=-1), distant) for end, distant in ends
    )
    found = specular_points(surface.mirror, pupil, target)
    for place, column in ((x, 0), (y, 1)):
        at = np.nan_to_num(found.points[:, column], nan=surface.mirror.rim_radius_mm)
        place[which] = torch.as_tensor(at, dtype=x.dtype, device=x.device)


def _array(part: Tensor, which: Tensor) -> np.ndarray:
    values = torch.as_tensor(part, dtype=torch.float64, device=which.device)
    picked: np.ndarray = (values[which] if values.ndim else values.expand(len(which))).detach().cpu().numpy()
    return picked


def _close(like: Tensor) -> float:
    """How small a step is rounding, of the type of a tensor."""
    return max(CLOSE, 32 * float(torch.finfo(like.dtype).eps))
