"""Chief rays in the meridional plane, and their inversion from angles and points to the mirror.

The mirror coordinate x is the parameter: all other quantities follow from it without a singularity
at 90 deg and without ray aiming. Angles are in radians; ``m`` is the distance from the lens's
reference point to the mirror vertex, infinite for an orthographic lens. Chief rays pass through the
entrance pupil, which may be displaced from the reference point.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.errors import InvalidParameter, NotOneToOne, OutsideField, OutsideMirror, SelfObstruction
from ...base.numerics.lazy import cached_property
from ...base.numerics.roots import increasing_root
from ...base.typing import Array
from ..lenses.pupil import IN_REFERENCE_POINT, EntrancePupil
from ..mirrors import Mirror
from ..mirrors.base import sagittal_radius, tangential_radius
from .covers import Cover, Outside
from .proofs import stops_growing

BETWEEN = 8  # points per polynomial piece at which the mapping is checked
NODES = 1025  # of the table used for initial values and for the proof of monotonicity
ROUNDING = 1e-12  # relative tolerance of angles at the rim


@dataclass(frozen=True)
class ChiefRays:
    """Chief rays through n mirror points; all arrays are (n,), lengths in mm, angles in radians.

    ``beta`` is the slope angle of the mirror, ``theta`` the angle between axis and ray on the
    viewing side (for a lens, its viewing angle), ``gamma`` the angle of incidence and reflection,
    ``omega`` the field angle from -z (Eqs. 1-5) and ``w`` the axial distance from entrance pupil to
    mirror point (m + z if the pupil is in the reference point). ``path`` is the distance to the
    pupil; ``seen_in`` are the chief rays of a second mirror in which the lens sees the first
    (:mod:`.two_mirrors`); ``drift`` is the pupil's motion, mm per radian of theta. Behind a cover,
    ``omega`` is the angle ``outside`` it.
    """

    x: Array
    z: Array
    slope: Array
    curvature: Array
    m: float
    w: Array
    beta: Array
    theta: Array
    gamma: Array
    omega: Array
    path: Array
    seen_in: ChiefRays | None = None
    drift: Array | float = 0.0
    outside: Outside | None = None

    @property
    def first(self) -> ChiefRays:
        """Chief rays at the mirror facing the lens: these, or those at a second mirror."""
        return self if self.seen_in is None else self.seen_in

    def dfirst_dx(self) -> Array:
        """Compute the derivative, by x, of the coordinate on the mirror facing the lens."""
        return np.ones_like(self.x) if self.seen_in is None else self._dtheta_dx() / self.seen_in.domega_dx()

    def pupil_distance(self) -> Array:
        """Compute the distance (mm) to the focus of neighbouring chief rays.

        The distance is along the chief ray. The focus is the entrance pupil if it is fixed, the
        caustic of the chief rays if it moves with their angle, or its tangential image in a second
        mirror.
        """
        if self.seen_in is None:
            return self.path - self.drift * np.sin(self.theta)
        second = self.seen_in
        return self.path + np.cos(second.gamma) / (np.cos(second.beta) * second.domega_dx())

    def domega_dx(self) -> Array:
        """Compute the derivative dOmega/dx, 1/mm."""
        return self._rate if self.outside is None else self.outside.rate

    @cached_property
    def _rate(self) -> Array:
        return self.dreflected_dx()

    @property
    def reflected(self) -> Array:
        """Angle (n,) from -z after reflection: omega, except with a cover."""
        return self.beta + self.gamma

    def dreflected_dx(self) -> Array:
        """Compute the derivative of :attr:`reflected` by x, 1/mm."""
        return 2 * self.curvature / (1 + self.slope**2) + self._dtheta_dx()

    def _dtheta_dx(self) -> Array:
        return (np.cos(self.theta) - self.slope * np.sin(self.theta)) / self.pupil_distance()

    @property
    def start(self) -> tuple[Array, Array]:
        """Origin (x, z) of the outgoing ray: at or, with a cover, near the mirror."""
        return (self.x, self.z) if self.outside is None else (self.outside.x, self.outside.z)

    @property
    def last(self) -> tuple[Array, Array]:
        """Last intersection (x, z) with the sensor: the mirror, or the outer surface of a cover."""
        if self.outside is None:
            return self.x, self.z
        reach = self.outside.reach
        return self.outside.x + reach * np.sin(self.omega), self.outside.z - reach * np.cos(self.omega)

    def spread(self) -> Array:
        """Compute the transverse separation of neighbouring rays at :attr:`start`, per mm of
        mirror."""
        return np.cos(self.gamma) / np.cos(self.beta) if self.outside is None else self.outside.spread

    def viewpoint_offset(self) -> Array:
        """Compute the axial distance z_v - z (mm) to the viewpoint, x / tan(Omega).

        On the axis the limit is m R/(2 m + R) for a smooth mirror, and 0 for a pointed one.
        """
        x, z = self.start
        with np.errstate(divide="ignore", invalid="ignore"):
            offset = x / np.tan(self.omega) + (z - self.z)
            on_axis = np.where(self.slope == 0.0, self.spread() / self.domega_dx(), 0.0)
        return np.where(self.x == 0.0, on_axis, offset)

    def radius_t(self) -> Array:
        """Compute the tangential radius of curvature, mm (Eq. 14)."""
        return tangential_radius(self.slope, self.curvature)

    def radius_s(self) -> Array:
        """Compute the sagittal radius of curvature, mm (Eq. 18)."""
        return sagittal_radius(self.x, self.slope, self.curvature)


def trace_chief_rays(mirror: Mirror, m: float, x_mm: ArrayLike, pupil: EntrancePupil = IN_REFERENCE_POINT) -> ChiefRays:
    """Trace chief rays through the mirror points at distances x from the axis (Eqs. 1-5).

    >>> from omnimirror.optics.mirrors import Sphere
    >>> rays = trace_chief_rays(Sphere(50.0, 44.0), np.inf, [30.0])
    >>> np.degrees(rays.omega).round(6)  # twice asin(30/50)
    array([73.739795])
    """
    x = np.asarray(x_mm, dtype=float)
    z, slope, curvature = mirror.profile(x)
    beta = np.arctan(slope)
    w, drift = pupil.aim(x, m + z)
    # law of reflection: gamma = beta + theta, Omega = beta + gamma = 2 beta + theta (Eqs. 3, 4)
    theta = np.arctan2(x, w)
    gamma = beta + theta
    return ChiefRays(x, z, slope, curvature, m, w, beta, theta, gamma, beta + gamma, np.hypot(x, w), drift=drift)


@dataclass(frozen=True)
class Meridian:
    """Mirror seen through a pupil at distance m: its field, and the mirror point of any ray.

    Evaluation is lazy; the first access checks that the mapping is one-to-one and raises
    :class:`NotOneToOne` or :class:`SelfObstruction` otherwise.
    """

    mirror: Mirror
    m: float
    pupil: EntrancePupil = IN_REFERENCE_POINT
    cover: Cover | None = field(default=None, kw_only=True)

    @cached_property
    def _table(self) -> ChiefRays:
        table = checked(self._rays(np.linspace(self.x_min, self.mirror.rim_radius_mm, NODES)))
        self._check_between_nodes()
        if self.cover is not None:
            self.cover.check(table)
        return table

    def _check_between_nodes(self) -> None:
        """Check monotonicity between the nodes, for polynomial mirrors."""
        if self.pupil.moves:
            self._check_finer_table()
            return
        x = stops_growing(self.mirror, self.m - self.pupil.at_mm)
        if x is not None:
            raise _not_one_to_one(x, float(np.degrees(self._rays(np.array([x])).omega[0])), self.mirror.rim_radius_mm)

    def _check_finer_table(self) -> None:
        """Check monotonicity with more nodes per piece, for two mirrors or a moving pupil."""
        if (breaks := self.mirror.breaks) is not None and len(breaks) > 2:
            x = np.concatenate([np.linspace(a, b, BETWEEN, endpoint=False) for a, b in pairwise(breaks)])
            checked(self._rays(np.append(x[x > self.x_min], breaks[-1])))

    @cached_property
    def x_min(self) -> float:
        """Distance from the axis, mm, of the first mirror point of the field."""
        return self._first_outside(0.0)

    @property
    def middle_hidden_by(self) -> str:
        """Part that blocks the rays below :attr:`x_min`."""
        assert self.cover is not None, "without a cover a single mirror is seen from its axis on"
        return f"{self.cover.shell.KIND}'s base"

    def _first_outside(self, start: float) -> float:
        """Return the first mirror point of the field that sees outside, from ``start``."""
        if self.cover is None:
            return start
        return self.cover.first_seen(self._rays, start, self.mirror.rim_radius_mm)

    def _rays(self, x: Array) -> ChiefRays:
        return self._through_cover(trace_chief_rays(self.mirror, self.m, x, self.pupil))

    def _through_cover(self, rays: ChiefRays) -> ChiefRays:
        return rays if self.cover is None else self.cover.left_by(rays)

    @property
    def omega_min(self) -> float:
        """Smallest field angle: 0 for a smooth mirror, larger for a pointed one."""
        return float(self._table.omega[0])

    @property
    def omega_max(self) -> float:
        """Field angle of the rim."""
        return float(self._table.omega[-1])

    @property
    def theta_max(self) -> float:
        """Viewing angle of the lens at the rim; 0 for an orthographic lens."""
        return float(self._table.first.theta[-1])

    def trace(self, x_mm: ArrayLike) -> ChiefRays:
        """Trace chief rays through mirror points given by their distance from the axis (n,), mm."""
        self._table  # noqa: B018 - proves that the mirror can be used
        x = np.asarray(x_mm, dtype=float)
        start, rim = self.x_min, self.mirror.rim_radius_mm
        inside = (x >= start * (1 - ROUNDING)) & (x <= rim * (1 + ROUNDING))
        if not inside.all():
            raise OutsideMirror(
                f"x = {_first(x, ~inside):g} mm is not on the mirror, which is seen from {start:g} to {rim:g} mm"
            )
        return self._rays(np.clip(x, start, rim))

    def x_from_omega(self, omega: ArrayLike) -> Array:
        """Return the mirror points (mm) of field angles (n,), radians."""
        omega = np.asarray(omega, dtype=float)
        inside = self.sees(omega)
        if not inside.all():
            raise OutsideField(
                f"omega = {np.degrees(_first(omega, ~inside)):.10g} deg is outside the field; it is valid from "
                f"{np.degrees(self.omega_min):.6g} to {np.degrees(self.omega_max):.6g} deg"
            )
        return self._invert_omega(omega)

    def sees(self, omega: Array) -> NDArray[np.bool_]:
        """Return which field angles are within the field, with a rounding tolerance."""
        slack = ROUNDING * self.omega_max
        return (omega >= self.omega_min - slack) & (omega <= self.omega_max + slack)

    def _invert_omega(self, omega: Array) -> Array:
        table, rim = self._table, self.mirror.rim_radius_mm
        omega = np.clip(omega, self.omega_min, self.omega_max)
        cell = np.clip(np.searchsorted(table.omega, omega) - 1, 0, NODES - 2)

        def difference(x: Array) -> tuple[Array, Array]:
            rays = self._rays(x)
            return rays.omega - omega, rays.domega_dx()

        a, b = table.x[cell], table.x[cell + 1]
        return increasing_root(difference, a, b, self._between(omega, cell, a, b), rim)

    def _between(self, omega: Array, cell: NDArray[np.intp], a: Array, b: Array) -> Array:
        """Interpolate between two nodes by cubic pieces, as initial values."""
        table = self._table
        low = table.omega[cell]
        width, step = table.omega[cell + 1] - low, b - a
        t = (omega - low) / width
        with np.errstate(divide="ignore", invalid="ignore"):
            rate = width / table.domega_dx()[np.stack([cell, cell + 1])]
            bent = t * (1 - t) * ((1 - t) * (rate[0] - step) + t * (step - rate[1]))
        x: Array = a + t * step + np.where(np.isfinite(bent), bent, 0.0)  # finite rates
        return x

    def x_from_first(self, x_mm: ArrayLike) -> Array:
        """Return mirror points (mm) for points (n,), mm, on the mirror facing the lens."""
        return self.trace(x_mm).x

    def x_from_tan_theta(self, tan_theta: ArrayLike) -> Array:
        """Return mirror points (mm) at viewing angles of the lens, given by their tangents (n,)."""
        tangent, table = np.asarray(tan_theta, dtype=float), self._table
        tangents = table.x / table.w
        inside = (tangent >= 0) & (tangent <= tangents[-1] * (1 + ROUNDING))
        if not inside.all():
            raise OutsideField(
                f"theta = {np.degrees(np.arctan(_first(tangent, ~inside))):.10g} deg looks past the mirror, "
                f"whose rim stands at {np.degrees(self.theta_max):.6g} deg"
            )
        cell = np.clip(np.searchsorted(tangents, tangent) - 1, 0, NODES - 2)

        depth = self.m - self.pupil.place(tangent)

        def difference(x: Array) -> tuple[Array, Array]:
            z, slope, _ = self.mirror.profile(x)
            return x - (depth + z) * tangent, 1 - slope * tangent

        start = np.interp(tangent, tangents, table.x)
        return increasing_root(difference, table.x[cell], table.x[cell + 1], start, self.mirror.rim_radius_mm)

    def x_from_point(self, x_t: ArrayLike, z_t: ArrayLike) -> Array:
        """Return the mirror points (mm) that image points of the meridional plane.

        Solves ``Omega(x) = phi(x)``, phi being the direction from mirror point to object. The root
        is unique: the difference increases at any root. Points in the mirror's shadow or inside it
        are NaN.
        """
        x_t, z_t = np.broadcast_arrays(np.asarray(x_t, dtype=float), np.asarray(z_t, dtype=float))
        rim = self.mirror.rim_radius_mm
        self._table  # noqa: B018 - proves that the mirror can be used

        def difference(x: Array, xt: Array, zt: Array) -> tuple[Array, Array]:
            rays = self._rays(x)
            x_start, z_start = rays.start
            phi, distance = _direction(xt - x_start, zt - z_start)
            with np.errstate(divide="ignore"):
                rate = rays.spread() / distance
            return rays.omega - phi, rays.domega_dx() + rate

        start, edge = np.full_like(x_t, self.x_min), np.full_like(x_t, rim)
        surface = np.where(x_t <= rim, self.mirror.sag(np.minimum(x_t, rim)), np.inf)
        with np.errstate(invalid="ignore"):  # non-finite points are not imaged
            seen = (z_t < surface) & np.isfinite(x_t) & np.isfinite(z_t)
            seen &= (difference(start, x_t, z_t)[0] <= 0) & (difference(edge, x_t, z_t)[0] >= -ROUNDING)
        x = np.full_like(x_t, np.nan)
        if seen.any():
            xt, zt = x_t[seen], z_t[seen]
            x[seen] = increasing_root(
                lambda x: difference(x, xt, zt), start[seen], edge[seen], self.first_guess(xt, zt), rim
            )
            if self.cover is not None:
                x[seen] = np.where(self.cover.leads_to(self._rays(x[seen]), xt, zt), x[seen], np.nan)
        return x

    def first_guess(self, x_t: Array, z_t: Array) -> Array:
        """Return single-viewpoint estimates of the mirror points (n,), mm."""
        middle = self._table.z[NODES // 2] + self._table.viewpoint_offset()[NODES // 2]
        omega, _ = _direction(x_t, z_t - middle)
        return np.interp(omega, self._table.omega, self._table.x)


def _direction(dx: Array, dz: Array) -> tuple[Array, Array]:
    """Return angles from -z in (-pi/2, 3 pi/2), and lengths."""
    phi = np.arctan2(dx, -dz)
    return np.where(phi < -np.pi / 2, phi + 2 * np.pi, phi), np.hypot(dx, dz)


def _first(values: Array, where: NDArray[np.bool_]) -> float:
    return float(np.atleast_1d(values)[np.atleast_1d(where)][0])


# -- validity checks ----------------------------------------------------------------------------- #
# A second reflection of a reflected ray needs no separate check: it requires a surface farther out
# that is flatter than the ray, beta' < Omega - 90 deg, and then gamma' = Omega' - beta' > Omega' -
# Omega + 90 deg exceeds 90 deg for increasing Omega: the lens would not see that surface.


def checked(rays: ChiefRays) -> ChiefRays:
    """Return chief rays ordered from the axis, checked to be on the front side and one-to-one."""
    _check_front_side(rays)
    _check_one_to_one(rays)
    return rays


def _check_front_side(rays: ChiefRays) -> None:
    if not rays.m > 0:
        raise InvalidParameter(f"mirror_distance_mm = {rays.m:g} is not a distance; it is valid above 0")
    if rays.w[0] <= 0:
        raise InvalidParameter(
            f"the lens's entrance pupil lies {rays.m - rays.w[0] + rays.z[0]:g} mm towards the mirror from where "
            f"mirror_distance_mm = {rays.m:g} begins: behind the mirror; the distance is valid above that"
        )
    hidden = (rays.w <= 0) | (np.cos(rays.theta) - rays.slope * np.sin(rays.theta) <= 0)
    if hidden.any():
        raise SelfObstruction(
            f"the mirror hides itself from the lens beyond x = {_first(rays.x, hidden):.6g} mm, where the lens "
            f"sees it edge-on; rim_radius_mm = {rays.x[-1]:g} is valid below that"
        )


def _check_one_to_one(rays: ChiefRays) -> None:
    falling = rays.dreflected_dx() <= 0
    falling[0] &= rays.slope[0] == 0  # the mapping may have square-root behaviour at the apex
    if not falling.any():
        return
    i = int(np.argmax(falling))
    if i <= 1:
        raise NotOneToOne(
            "the field angle Omega(x) does not grow away from the axis; the mirror must be convex towards "
            "the lens, and a cone needs a perspective lens"
        )
    raise _not_one_to_one(rays.x[i], float(np.degrees(rays.omega[i])), rays.x[-1])


def _not_one_to_one(x: float, omega_deg: float, rim: float) -> NotOneToOne:
    return NotOneToOne(
        f"the field angle Omega(x) stops growing at x = {x:.6g} mm ({omega_deg:.5g} deg), so the mapping is not one to "
        f"one; rim_radius_mm = {rim:g} is valid below {x:.6g}"
    )
