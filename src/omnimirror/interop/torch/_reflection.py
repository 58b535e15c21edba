"""Reflection points on tensors, found without gradients and recorded by one Newton step.

Let F(q, p) = 0 define the reflection point q of a sensor with parameters p. With the Jacobian J of F
by q as a constant, the step q - J^-1 F(q, p) does not move q and has the derivative -J^-1 dF/dp of
the implicit function theorem. Gradients are therefore exact, at the cost of one step. Along a ray
from the lens, F is the distance of a point from the surface. For a point in the world, F is the
gradient of the optical path length on the surface (Fermat; see
:mod:`omnimirror.optics.tracing.reflection`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np

from ...optics.mirrors import Mirror
from ...optics.tracing.reflection import (
    CELLS,
    FIRST_CLOSE,
    FIRST_STEPS,
    MAX_STEP_LENGTH,
    REACH,
    REFLECTION_TOLERANCE,
    RIM_SLACK,
    SEARCH,
    STEPS,
    MirrorTables,
    RayEndpoints,
    specular_points,
)
from ._library import Tensor, torch
from ._parameters import Components
from ._tables import (
    CompiledReflections,
    PiecewiseCubic,
    compiled_intersections,
    compiled_reflections,
    has_kernels,
)

TOLERANCE = 1e-9
"""Step relative to the rim radius before the recorded step, which leaves its square."""
AXIS_MM2 = 1e-24
"""Offset added to squared distances from the axis, so that they are differentiable on it."""
SAG, SLOPE = 0, 1
"""Functions in the tables of a meridian."""


class SurfacePoints(NamedTuple):
    """Points on the mirror in the mirror frame."""

    points: Components
    slopes: tuple[Tensor, Tensor]
    """dz/dx, dz/dy."""
    valid: Tensor


class FreeShapeParameter(NamedTuple):
    """Free parameter of the mirror shape."""

    value: Tensor
    derivatives: PiecewiseCubic
    """Derivatives of sag and slope."""


@dataclass(frozen=True)
class SurfaceTable:
    """Tables of a mirror surface on a device."""

    mirror: Mirror
    tables: MirrorTables
    """NumPy tables from which the others are copied."""
    meridian: PiecewiseCubic
    """Sag and slope by distance from the axis."""
    depth: PiecewiseCubic | None
    """Distance (mm) from the lens to the aligned mirror along the axis, indexed by the tangent;
    None if telecentric."""
    by_omega: PiecewiseCubic
    """Distance from the axis (mm) of the aligned mirror by field angle."""
    free: tuple[FreeShapeParameter, ...] = ()

    @classmethod
    def of(
        cls, mirror: Mirror, pupil_distance_mm: float, dtype: object, device: object
    ) -> SurfaceTable:
        """Return the tables of a mirror for the distance of the entrance pupil from its vertex.

        The distance is infinite for telecentric lenses.
        """
        tables = MirrorTables.of(mirror, pupil_distance_mm)
        cubic = partial(PiecewiseCubic, dtype=dtype, device=device)
        depth = None if tables.depth is None else cubic(tables.depth)
        return cls(mirror, tables, cubic(tables.meridian), depth, cubic(tables.by_omega))

    @property
    def cell_mm(self) -> float:
        """Width of the cells of the meridian."""
        return self.tables.cell_mm

    def sag(self, x: Tensor, y: Tensor) -> Tensor:
        """Return the sag (n,), mm, differentiable by position and free parameters."""
        return self._differentiable(_radius(x, y), SAG)

    def slopes(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor]:
        """Return dz/dx and dz/dy, differentiable by position and free parameters."""
        r = _radius(x, y)
        tilt = self._differentiable(r, SLOPE) / r
        return tilt * x, tilt * y

    def _differentiable(self, r: Tensor, function: int) -> Tensor:
        position = r * (1 / self.cell_mm)
        result = self.meridian.value(self.meridian.locate(position), function)
        for parameter in self.free if torch.is_grad_enabled() else ():
            location = parameter.derivatives.locate(position.detach())
            derivative = parameter.derivatives.value(location, function)
            # The factor is 0 and has the derivative 1.
            result = result + (parameter.value - parameter.value.detach()) * derivative
        return result

    def sag_and_slopes(self, x: Tensor, y: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Return sag and slopes without gradients of free parameters."""
        r = _radius(x, y)
        location = self.meridian.locate(r * (1 / self.cell_mm))
        tilt = self.meridian.value(location, SLOPE) / r
        return self.meridian.value(location, SAG), tilt * x, tilt * y

    def second_order(self, x: Tensor, y: Tensor) -> tuple[Tensor, ...]:
        """Return sag, slopes and second derivatives (xx, xy, yy) without gradients.

        With the slope s(r) of a surface of revolution, the Hessian is s/r I + (s' - s/r) e e^T,
        where e is the radial unit vector.
        """
        r = _radius(x, y)
        location = self.meridian.locate(r * (1 / self.cell_mm))
        slope, rate = self.meridian.value_and_derivative(location, SLOPE)
        radial, tangential = rate * (1 / self.cell_mm), slope / r
        cos, sin = x / r, y / r
        difference_x, difference_y = (radial - tangential) * cos, (radial - tangential) * sin
        return (
            self.meridian.value(location, SAG),
            slope * cos,
            slope * sin,
            tangential + difference_x * cos,
            difference_x * sin,
            tangential + difference_y * sin,
        )

    def needs_gradient(self, *parts: Tensor) -> bool:
        """Return whether gradients by the inputs or by free parameters are recorded."""
        tensors = (*parts, *(parameter.value for parameter in self.free))
        requires = any(getattr(tensor, "requires_grad", False) for tensor in tensors)
        return bool(torch.is_grad_enabled()) and requires

    def is_inside(self, x: Tensor, y: Tensor) -> Tensor:
        """Return whether points are within the rim."""
        return x * x + y * y <= (self.mirror.rim_radius_mm * (1 + RIM_SLACK)) ** 2


def _radius(x: Tensor, y: Tensor) -> Tensor:
    return torch.sqrt(x * x + y * y + AXIS_MM2)


# -- intersection of rays from the lens ----------------------------------------------------------


def intersect_rays(
    surface: SurfaceTable, start: Components, direction: Components
) -> SurfacePoints:
    """Intersect rays from the lens with the mirror, in the mirror frame."""
    rim = surface.mirror.rim_radius_mm
    has_pupil = surface.depth is not None
    if has_pupil and has_kernels(direction[0]) and not surface.needs_gradient(*start, *direction):
        return SurfacePoints(
            *compiled_intersections(surface.tables, SEARCH, start, direction, TOLERANCE)
        )
    with torch.no_grad():
        # Newton's method for z(t) - sag(x(t), y(t)) = 0 along the ray.
        t = _initial_distance(surface, start, direction)
        for _ in range(STEPS):
            x, y, z = (a + t * b for a, b in zip(start, direction, strict=True))
            sag, sx, sy = surface.sag_and_slopes(x, y)
            closing = direction[2] - sx * direction[0] - sy * direction[1]
            step = (z - sag) / closing
            converged = step.abs() <= _tolerance(t) * rim
            if bool(converged.all()):
                break
            t = t - step
        else:
            t = t + step
        valid = converged & (closing > 0) & (t > 0)
        if not bool(valid.all()):  # finite substitutes have zero gradients
            t = torch.where(valid, t, 0.0)
            closing = torch.where(valid, closing, 1.0)
            step = torch.where(valid, step, 0.0)
    if not torch.is_grad_enabled():  # the last step is too short to change the slopes
        x, y, z = (a + (t - step) * b for a, b in zip(start, direction, strict=True))
        return SurfacePoints((x, y, z), (sx, sy), valid & surface.is_inside(x, y))
    x, y, z = (a + t * b for a, b in zip(start, direction, strict=True))
    t = t - (z - surface.sag(x, y)) / closing
    x, y, z = (a + t * b for a, b in zip(start, direction, strict=True))
    return SurfacePoints((x, y, z), surface.slopes(x, y), valid & surface.is_inside(x, y))


def _initial_distance(surface: SurfaceTable, start: Components, direction: Components) -> Tensor:
    """Return initial distances along rays: the solutions for the aligned mirror."""
    if surface.depth is None:
        r = torch.sqrt(start[0] * start[0] + start[1] * start[1])
        position = r.clamp(max=surface.mirror.rim_radius_mm) * (1 / surface.cell_mm)
        sag = surface.meridian.value(surface.meridian.locate(position), SAG)
        return (sag - start[2]) / direction[2]
    across = torch.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    tangent = across / direction[2]
    position = (tangent * (CELLS / surface.tables.max_tangent)).clamp(0, CELLS)
    return surface.depth.value(surface.depth.locate(position)) / direction[2]


# -- reflection of targets -----------------------------------------------------------------------

Endpoints = tuple[tuple[Components, bool], tuple[Components, bool]]
"""Both ends of the optical path, each with True if it is at infinity."""
Solution = tuple[Tensor, Tensor, Components]
"""x and y of reflection points and the inverse Hessian (xx, xy, yy) of the path length."""


def reflect_targets(
    surface: SurfaceTable, pupil: Components, target: Components, telecentric: bool, distant: bool
) -> SurfacePoints:
    """Find the reflection points of targets in the mirror frame.

    Targets are points, or unit vectors if ``distant``.
    """
    ends = (pupil, telecentric), (target, distant)
    compiled = None
    if has_kernels(target[0]):
        compiled = compiled_reflections(surface.tables, SEARCH, *ends[0], *ends[1])
        is_complete = not bool(compiled.is_open.any())
        if is_complete and not surface.needs_gradient(*pupil, *target):
            return SurfacePoints(compiled.points, compiled.slopes, compiled.valid)
    with torch.no_grad():
        if compiled is None:
            x, y, inverse = _search(surface, ends)
        else:
            x, y, inverse = _complete(surface, compiled, ends)
    sag, (sx, sy) = surface.sag(x, y), surface.slopes(x, y)
    gx, gy = _path_gradient(x, y, (sag, sx, sy), ends)
    a, b, c = inverse
    x, y = x - (a * gx + b * gy), y - (b * gx + c * gy)
    sag = surface.sag(x, y)
    with torch.no_grad():  # the step was rounding only: slopes and gradient remain those before it
        facing = True
        for end, is_distant in ends:
            ux, uy, uz, _ = _unit_vectors((x, y, sag), end, is_distant)
            facing = facing & (uz - sx * ux - sy * uy > 0)
        stationary = gx * gx + gy * gy <= max(REFLECTION_TOLERANCE, _tolerance(gx)) ** 2
        valid = facing & stationary & surface.is_inside(x, y)
    return SurfacePoints((x, y, sag), (sx, sy), valid)


def _unit_vectors(
    point: Components, end: Components, distant: bool
) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Return unit vectors from an end to points and the inverse distances."""
    if distant:
        zero = 0 * point[0]
        return zero - end[0], zero - end[1], zero - end[2], zero
    dx, dy, dz = (p - e for p, e in zip(point, end, strict=True))
    inverse = torch.rsqrt(dx * dx + dy * dy + dz * dz)
    return dx * inverse, dy * inverse, dz * inverse, inverse


def _path_gradient(
    x: Tensor, y: Tensor, surface: Components, ends: Endpoints
) -> tuple[Tensor, Tensor]:
    """Return the gradient of the optical path length by x and y on the surface.

    For the sum u of both unit vectors, it is (ux + sx uz, uy + sy uz).
    """
    sag, sx, sy = surface
    (ax, ay, az, _), (bx, by, bz, _) = (
        _unit_vectors((x, y, sag), end, distant) for end, distant in ends
    )
    uz = az + bz
    return ax + bx + sx * uz, ay + by + sy * uz


def _newton_terms(
    surface: SurfaceTable, x: Tensor, y: Tensor, ends: Endpoints
) -> tuple[Tensor, ...]:
    """Return the path gradient and the inverse (xx, xy, yy) of its Hessian.

    With the tangent vectors t = (1, 0, sx) and (0, 1, sy), the Hessian is the sum over both ends
    of (t_i t_j - (u t_i)(u t_j)) / distance, plus uz times the Hessian of the sag.
    """
    sag, sx, sy, xx, xy, yy = surface.second_order(x, y)
    gx = gy = gz = 0.0
    hxx = hxy = hyy = 0.0
    for end, distant in ends:
        ux, uy, uz, inverse = _unit_vectors((x, y, sag), end, distant)
        gx, gy, gz = gx + ux, gy + uy, gz + uz
        if not distant:
            px, py = ux + sx * uz, uy + sy * uz
            hxx = hxx + (1 + sx * sx - px * px) * inverse
            hxy = hxy + (sx * sy - px * py) * inverse
            hyy = hyy + (1 + sy * sy - py * py) * inverse
    a, b, c = hxx + gz * xx, hxy + gz * xy, hyy + gz * yy
    det = a * c - b * b
    return gx + sx * gz, gy + sy * gz, c / det, -b / det, a / det


def _complete(surface: SurfaceTable, compiled: CompiledReflections, ends: Endpoints) -> Solution:
    """Return the solutions of the kernels, completed by NumPy where these did not converge."""
    x, y, _ = compiled.points
    if not bool(compiled.is_open.any()):
        return x, y, compiled.inverse_hessian
    _solve_by_numpy(surface, x, y, ends, compiled.is_open)
    _, _, a, b, c = _newton_terms(surface, x, y, ends)
    return _finite(surface, x, y, (a, b, c))


def _search(surface: SurfaceTable, ends: Endpoints) -> Solution:
    """Find stationary points of the path length by Newton's method."""
    x, y = _initial_point(surface, ends)
    rim = surface.mirror.rim_radius_mm
    max_step, tolerance = MAX_STEP_LENGTH * rim, _tolerance(x) * rim
    length = torch.zeros_like(x)
    for _ in range(STEPS):
        gx, gy, a, b, c = _newton_terms(surface, x, y, ends)
        dx, dy = a * gx + b * gy, b * gx + c * gy
        length = torch.sqrt(dx * dx + dy * dy)
        if not bool((length > tolerance).any()):
            break
        damping = (max_step / length).clamp(max=1.0)
        x, y = x - damping * dx, y - damping * dy
        shrink = (REACH * rim / torch.sqrt(x * x + y * y + AXIS_MM2)).clamp(max=1.0)
        x, y = x * shrink, y * shrink
    else:
        _solve_by_numpy(surface, x, y, ends, ~(length <= tolerance))
        *_, a, b, c = _newton_terms(surface, x, y, ends)
    return _finite(surface, x, y, (a, b, c))


def _finite(surface: SurfaceTable, x: Tensor, y: Tensor, inverse: Components) -> Solution:
    """Replace missing solutions by finite values, whose gradients are 0 instead of NaN."""
    exists = torch.isfinite(sum(inverse))
    a, b, c = (torch.where(exists, part, 0.0) for part in inverse)
    half_rim = surface.mirror.rim_radius_mm / 2
    return torch.where(exists, x, half_rim), torch.where(exists, y, 0.0), (a, b, c)


def _initial_point(surface: SurfaceTable, ends: Endpoints) -> tuple[Tensor, Tensor]:
    """Return the reflection points of the aligned mirror, in the meridian of each target."""
    ((_, _, pupil_z), telecentric), ((tx, ty, tz), distant) = ends
    across = torch.sqrt(tx * tx + ty * ty + AXIS_MM2)
    reference_mm = 0.0 if distant else surface.tables.middle_mm
    omega = torch.atan2(across, reference_mm - tz)
    low, high = surface.tables.omegas
    position = ((omega - low) * (CELLS / (high - low))).clamp(0, CELLS)
    r = surface.by_omega.value(surface.by_omega.locate(position))
    rim = surface.mirror.rim_radius_mm
    min_r = surface.tables.min_radius_mm
    meridian_ends = ((0.0, 0.0, pupil_z), telecentric), ((across, 0.0, tz), distant)
    if not distant:
        max_step = MAX_STEP_LENGTH * rim
        for _ in range(FIRST_STEPS):
            step = _meridional_step(surface, r, meridian_ends).clamp(-max_step, max_step)
            r = (r - step).clamp(min_r, REACH * rim)
            if not bool((step.abs() > FIRST_CLOSE * rim).any()):
                break
    r = r.clamp(min=min_r)
    return r * tx / across, r * ty / across


def _meridional_step(surface: SurfaceTable, r: Tensor, ends: Endpoints) -> Tensor:
    """Return Newton steps (n,) of the path length in the meridian at distances r, mm."""
    location = surface.meridian.locate(r * (1 / surface.cell_mm))
    sag = surface.meridian.value(location, SAG)
    slope, rate = surface.meridian.value_and_derivative(location, SLOPE)
    gradient, gz, hessian = 0.0, 0.0, 0.0
    for end, distant in ends:
        ux, _, uz, inverse = _unit_vectors((r, 0.0, sag), end, distant)
        along = ux + slope * uz
        gradient, gz = gradient + along, gz + uz
        hessian = hessian + (1 + slope * slope - along * along) * inverse
    return gradient / (hessian + gz * rate / surface.cell_mm)


def _solve_by_numpy(
    surface: SurfaceTable, x: Tensor, y: Tensor, ends: Endpoints, is_open: Tensor
) -> None:
    """Replace open solutions in place by those of the verified NumPy search."""
    which = torch.nonzero(is_open)[:, 0]
    pupil, target = (
        RayEndpoints.of(np.stack([_array(part, which) for part in end], axis=-1), distant)
        for end, distant in ends
    )
    solution = specular_points(surface.mirror, pupil, target)
    for coordinate, column in ((x, 0), (y, 1)):
        values = np.nan_to_num(solution.points[:, column], nan=surface.mirror.rim_radius_mm)
        coordinate[which] = torch.as_tensor(values, dtype=x.dtype, device=x.device)


def _array(part: Tensor, which: Tensor) -> np.ndarray:
    values = torch.as_tensor(part, dtype=torch.float64, device=which.device)
    selected = values[which] if values.ndim else values.expand(len(which))
    array: np.ndarray = selected.detach().cpu().numpy()
    return array


def _tolerance(like: Tensor) -> float:
    """Return the relative step that is rounding for the type of a tensor."""
    return max(TOLERANCE, 32 * float(torch.finfo(like.dtype).eps))
