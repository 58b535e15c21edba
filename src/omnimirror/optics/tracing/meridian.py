"""Meridional chief rays: reflection, refraction by covers, and inversion to the mirror point.

The mirror coordinate x is the parameter: all other quantities follow from it without a singularity
at 90 deg and without ray aiming. Angles are in radians; ``m`` is the distance from the lens's
reference point to the mirror vertex, infinite for an orthographic lens. Chief rays pass through the
entrance pupil, which may be displaced from the reference point.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from math import comb
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.caching import cached_property
from ...base.errors import (
    InvalidParameter,
    NotOneToOne,
    OutsideField,
    OutsideMirror,
    SelfObstruction,
)
from ...base.numerics import increasing_root, sign_change
from ...base.typing import Array, Mask
from ..housing import Dome, FlatWindow, Shell, Tube
from ..lenses.lens import IN_REFERENCE_POINT, EntrancePupil
from ..mirrors import Mirror
from ..mirrors.mirror import sagittal_radius, tangential_radius

# -- Monotonicity of the field angle between nodes -------------------------------------------------
#
# With w = m + z, the sign of dOmega/dx (Eq. 8) is that of
# ``2 z'' (w^2 + x^2) + (w - x z')(1 + z'^2)``, or of z'' for an orthographic lens: a polynomial on
# each piece. The Bernstein coefficients of a polynomial bound its range; the bounds converge as a
# piece is bisected.

MAX_BISECTIONS = 48
COEFFICIENT_ROUNDING = 1e-12  # relative to the coefficients of a piece


def first_non_increasing_x(mirror: Mirror, m: float) -> float | None:
    """Return the distance (mm) from the axis at which the field angle stops increasing.

    None if it increases everywhere, or if the sag is not piecewise polynomial.

    >>> from omnimirror.optics.mirrors import SampledProfile
    >>> x = np.linspace(0, 10, 11)
    >>> first_non_increasing_x(SampledProfile(tuple(x), tuple(0.01 * x**2)), np.inf) is None
    True
    >>> wavy = SampledProfile(tuple(x), tuple(0.01 * x**2 + 1e-2 * np.cos(3 * x)), uncertainty_um=0)
    >>> first_non_increasing_x(wavy, np.inf) < 10
    True
    """
    breaks = mirror.breaks
    if breaks is None:
        return None
    start, step = breaks[:-1], np.diff(breaks)
    z = _taylor(mirror, start, step)
    scale = step
    slope = _derivative(z) / scale
    curvature = _derivative(slope) / scale
    if np.isinf(m):
        growth = curvature
    else:
        w = z.copy()
        w[0] += m
        x = np.stack([start, step])
        one = np.ones((1, len(step)))
        growth = _sum(
            2 * _product(curvature, _sum(_product(w, w), _product(x, x))),
            _product(_sum(w, -_product(x, slope)), _sum(one, _product(slope, slope))),
        )
    return _first_not_positive(growth, start, step)


def _taylor(mirror: Mirror, start: Array, step: Array) -> Array:
    """Return the quintic coefficients (6, pieces) of the sag in t, 0 to 1."""
    sides = [mirror.profile(start), mirror.profile(start + step)]
    (z0, s0, c0), (z1, s1, c1) = ((z, s * step, c * step**2) for z, s, c in sides)
    dz, ds, dc = z1 - z0 - s0 - c0 / 2, s1 - s0 - c0, c1 - c0
    return np.stack(
        [
            z0,
            s0,
            c0 / 2,
            10 * dz - 4 * ds + dc / 2,
            -15 * dz + 7 * ds - dc,
            6 * dz - 3 * ds + dc / 2,
        ]
    )


def _derivative(a: Array) -> Array:
    return a[1:] * np.arange(1, len(a))[:, None]


def _product(a: Array, b: Array) -> Array:
    product = np.zeros((len(a) + len(b) - 1, a.shape[1]))
    for i, row in enumerate(a):
        product[i : i + len(b)] += row * b
    return product


def _sum(a: Array, b: Array) -> Array:
    total = np.zeros((max(len(a), len(b)), a.shape[1]))
    total[: len(a)] += a
    total[: len(b)] += b
    return total


def _first_not_positive(polynomials: Array, start: Array, step: Array) -> float | None:
    """Return the first place, mm, with a negative polynomial; None if none."""
    d = len(polynomials) - 1
    to_bernstein = np.array([[comb(i, k) / comb(d, k) for k in range(d + 1)] for i in range(d + 1)])
    halves = np.array([[comb(i, k) / 2**i for k in range(d + 1)] for i in range(d + 1)])
    b = to_bernstein @ polynomials
    slack = COEFFICIENT_ROUNDING * np.abs(polynomials).sum(axis=0)
    for _ in range(MAX_BISECTIONS):
        failed = (b[0] < -slack) | (b[-1] < -slack)
        if failed.any():
            position = np.where(b[0] < -slack, start, start + step)
            return float(position[failed].min())
        open_ = (b < -slack).any(axis=0)
        if not open_.any():
            return None
        b, start, step, slack = b[:, open_], start[open_], step[open_] / 2, slack[open_]
        left, right = halves @ b, (halves @ b[::-1])[::-1]
        b, start = np.concatenate([left, right], axis=1), np.concatenate([start, start + step])
        step, slack = np.concatenate([step, step]), np.concatenate([slack, slack])
    return None  # within rounding of 0


# -- Chief rays through a clear cover --------------------------------------------------------------
#
# Two quantities of a chief-ray pencil are traced in addition to position and direction, both per mm
# of mirror: the transverse separation of neighbouring rays (``spread``) and their angular separation
# (``rate``). Propagation over a distance t gives spread' = spread + t rate; refraction changes the
# rate by the surface's curvature and the derivative of Snell's law (Coddington's tangential
# equation). The sagittal equation uses the distance to the axis along the normal instead of the
# radius of curvature.

TUBE_SAMPLES = 257  # mirror points sampled to find the first ray past the base of a tube
RAY_TOLERANCE = 1e-7  # relative distance within which a point is on a ray


class Refraction(NamedTuple):
    """Refraction of wavefronts: ``after vergence' = before vergence + power``, (n,)."""

    path_mm: Any
    """Distance from the previous surface, mm."""
    before_t: Any
    after_t: Any
    power_t: Any
    before_s: Any
    after_s: Any
    power_s: Any


@dataclass(frozen=True)
class OutsideRays:
    """Chief rays (n,) outside a cover; lengths in mm, angles in radians.

    ``x``, ``z`` is the point on each ray's line closest to its mirror point; ``spread`` and
    ``rate`` are the transverse and the angular separation of neighbouring rays there, per mm of
    mirror. The ray leaves the cover at ``reach`` after that point and at the optical distance
    ``inside`` after the mirror.
    """

    x: Array
    z: Array
    rate: Array
    spread: Array
    reach: Array
    inside: Array
    refractions: tuple[Refraction, ...]

    def from_start(self, object_distance: Array) -> Array:
        """Convert optical distances from the mirror to distances from ``x``, ``z``."""
        return object_distance - self.inside + self.reach

    def apparent_distances(self, object_distance: Array) -> tuple[Array, Array]:
        """Return apparent distances (n,), (n,), mm, of tangential and sagittal foci.

        Converging pencils have negative distances.

        Raises
        ------
        InvalidParameter
            If an object is inside the cover.
        """
        behind = object_distance - self.inside
        if not np.all(behind > 0):
            i = int(np.argmin(np.broadcast_to(behind, self.inside.shape)))
            p = float(np.broadcast_to(object_distance, self.inside.shape)[i])
            raise InvalidParameter(
                f"object_distance_mm must be greater than {self.inside[i]:.5g} mm, outside the cover; got {p:g}"
            )
        with np.errstate(divide="ignore"):
            t, s = (1 / inverse for inverse in distances_inside_cover(self.refractions, 1 / behind))
        return t, s


def distances_inside_cover(
    refractions: tuple[Refraction, ...], inverse_distance: Any
) -> tuple[Any, Any]:
    """Convert 1/distance from the outer surface to that from the mirror, T and S."""
    vergence_t = vergence_s = -inverse_distance
    for r in reversed(refractions):
        vergence_t = (r.after_t * vergence_t - r.power_t) / r.before_t
        vergence_s = (r.after_s * vergence_s - r.power_s) / r.before_s
        vergence_t, vergence_s = (v / (1 - r.path_mm * v) for v in (vergence_t, vergence_s))
    return -vergence_t, -vergence_s


class Pencil(NamedTuple):
    """Chief rays with transverse and angular separation of their neighbours, per mm of mirror."""

    x: Any
    z: Any
    omega: Any
    spread: Any
    rate: Any


class RefractingSurface(NamedTuple):
    """One surface of a wall about the axis; its numbers may be arrays over sensors."""

    kind: Literal["plane", "cylinder", "sphere"]
    radius: Any
    """Radius; not used for a plane."""
    height: Any
    """Height above the mirror vertex of a plane or a sphere's centre; not used for a cylinder."""

    def intersection(self, ray: Pencil) -> tuple[Any, Any]:
        """Return distances along rays from inside, and the angle of the normal."""
        sin, cos = np.sin(ray.omega), np.cos(ray.omega)
        if self.kind == "plane":
            return (ray.z - self.height) / cos, np.where(cos.real > 0, 0.0, np.nan)  # rising rays
        if self.kind == "cylinder":
            return (self.radius - ray.x) / sin, np.pi / 2 + 0 * ray.x
        dz = ray.z - self.height
        b, c = ray.x * sin - dz * cos, ray.x**2 + dz**2 - self.radius**2
        distance = -b + np.sqrt(b * b - c)
        return distance, _angle_of(ray.x + distance * sin, distance * cos - dz)

    @property
    def curvatures(self) -> tuple[Any, Any]:
        """Tangential and sagittal curvature, 1/mm, relative to the normal to the axis."""
        if self.kind == "plane":
            return 0.0, 0.0
        return (1 / self.radius if self.kind == "sphere" else 0.0), 1 / self.radius


def _angle_of(sin: Any, cos: Any) -> Any:
    """Return angles of vectors of any length; imaginary parts carry derivatives."""
    angle = np.arctan2(sin.real, cos.real)
    if not np.iscomplexobj(sin):
        return angle
    return angle + 1j * (cos.real * sin.imag - sin.real * cos.imag) / (cos.real**2 + sin.real**2)


def refracting_surfaces(shell: Shell) -> tuple[RefractingSurface, RefractingSurface]:
    """Return inner and outer surface of a wall of known size."""
    if isinstance(shell, FlatWindow):
        inner, outer = (RefractingSurface("plane", np.inf, height) for height in shell.heights_mm)
    elif isinstance(shell, Tube):
        inner, outer = (RefractingSurface("cylinder", radius, 0.0) for radius in shell.radii_mm)
    else:
        inner, outer = (
            RefractingSurface("sphere", radius, centre)
            for radius, centre in zip(shell.radii_mm, shell.centres_mm, strict=True)
        )
    return inner, outer


def refract_through_shell(
    ray: Pencil, sides: tuple[RefractingSurface, RefractingSurface], indices: tuple[float, float]
) -> CoverTransit:
    """Refract rays through both surfaces of a wall; ``indices`` are those of wall and outer medium.

    Rays that miss a surface or are totally reflected are non-finite. Imaginary parts of complex
    numbers carry derivatives.
    """
    media, through = (1.0, *indices), list[Refraction]()
    start = ray
    for side, before, after in zip(sides, media, media[1:], strict=False):
        ray, refraction = _refracted(ray, side, before, after)
        through.append(refraction)
    sin, cos = np.sin(ray.omega), np.cos(ray.omega)
    reach = (ray.x - start.x) * sin - (ray.z - start.z) * cos
    foot = Pencil(
        ray.x - reach * sin, ray.z + reach * cos, ray.omega, ray.spread - reach * ray.rate, ray.rate
    )
    return CoverTransit(foot, reach, through[0].path_mm + through[1].path_mm, tuple(through))


class CoverTransit(NamedTuple):
    """Rays outside a wall, measured from the point of each line closest to its mirror point."""

    foot: Pencil
    reach: Any
    inside: Any
    refractions: tuple[Refraction, ...]


@dataclass(frozen=True)
class Cover:
    """Tube, dome or window of known size about the axis; heights in mm above the mirror vertex.

    A tube extends from ``base_mm`` to ``cap_mm``: rays that meet an end before the wall do not
    pass.

    >>> from omnimirror.optics.mirrors import Sphere
    >>> from omnimirror.optics.tracing.meridian import trace_chief_rays
    >>> cover = Cover(Tube(120.0, 3.0, 1.49, medium_index=1.333), -180.0, 20.0)
    >>> rays = cover.refracted(trace_chief_rays(Sphere(50.0, 44.0), 180.0, [20.0, 40.0]))
    >>> (np.cos(rays.reflected) / np.cos(rays.omega)).round(12)  # Snell's law at parallel walls
    array([1.333, 1.333])
    """

    shell: Shell
    base_mm: float
    cap_mm: float

    def moved(self, displacement_mm: float) -> Cover:
        """Return the cover relative to a mirror displaced away from the lens."""
        shell = self.shell
        if isinstance(shell, Dome):
            shell = replace(shell, centre_mm=shell.centres_mm[1] - displacement_mm)
        elif isinstance(shell, FlatWindow):
            shell = replace(shell, height_mm=shell.heights_mm[0] - displacement_mm)
        return Cover(shell, self.base_mm - displacement_mm, self.cap_mm - displacement_mm)

    @property
    def in_air(self) -> bool:
        """True if the media inside and outside have the same refractive index."""
        return self.shell.outer_index == 1.0

    def refracted(self, rays: ChiefRays) -> ChiefRays:
        """Return chief rays outside the cover."""
        start = Pencil(rays.x, rays.z, rays.reflected, rays.spread(), rays.dreflected_dx())
        crosses = self.crosses(rays) if self.in_air else np.ones(rays.x.shape, dtype=bool)
        with np.errstate(all="ignore"):  # misses and total reflection: see below
            transit = refract_through_shell(
                start, refracting_surfaces(self.shell), (self.shell.index, self.shell.outer_index)
            )
        foot, through = transit.foot, transit.refractions
        values: tuple[Array, ...] = (*foot, transit.reach, transit.inside)
        if not crosses.all():
            zeros = np.zeros_like(start.x)
            bare = (*start, zeros, zeros)
            values = tuple(
                np.where(crosses, new, old) for new, old in zip(values, bare, strict=True)
            )
            through = tuple(_identity_unless(crosses, r) for r in through)
        x, z, omega, spread, rate, reach, inside = values
        return replace(
            rays, omega=omega, outside=OutsideRays(x, z, rate, spread, reach, inside, through)
        )

    def crosses(self, rays: ChiefRays) -> Mask:
        """Return which rays (n,) reach the wall within the ends of a tube."""
        if not isinstance(self.shell, Tube):
            return np.ones(rays.x.shape, dtype=bool)
        height = self._wall_height(rays)
        return (height > self.base_mm) & (height < self.cap_mm)

    def _wall_height(self, rays: ChiefRays) -> Array:
        with np.errstate(divide="ignore"):
            height: Array = rays.z - (self.shell.radii_mm[0] - rays.x) / np.tan(rays.reflected)
        return height

    def first_visible_x(
        self, rays_at: Callable[[Array], ChiefRays], start: float, rim: float
    ) -> float:
        """Return the distance from the axis of the first mirror point with a path to the outside.

        Rays from smaller distances end at the base. In air, the inner rays are used.
        """
        if self.in_air or not isinstance(self.shell, Tube):
            return start

        def clear(x: Array | float) -> Array:
            height = self._wall_height(rays_at(np.atleast_1d(x)))
            return np.maximum(height - self.base_mm, -1e9)  # the axial ray never meets the wall

        x = np.linspace(start, rim, TUBE_SAMPLES)
        height = clear(x)
        (passing,) = np.nonzero(height > 0)
        if not passing.size:
            raise SelfObstruction(
                "at least one ray from the mirror must pass the wall of the tube; all of them end at its base"
            )
        if passing[0] == 0:
            return start
        if not height[passing[0] - 1] <= 0:  # NaN: outside the mirror surface
            return float(x[passing[0]])
        low, high = float(x[passing[0] - 1]), float(x[passing[0]])
        return sign_change(lambda v: float(clear(v)[0]), low, high, 1e-12 * rim)

    def leads_to(self, rays: ChiefRays, x: Array, z: Array) -> Mask:
        """Return which meridional points (n,), (n,) are outside and on these rays."""
        outside = rays.outside
        assert outside is not None
        sin, cos = np.sin(rays.omega), np.cos(rays.omega)
        dx, dz = x - outside.x, z - outside.z
        along, across = dx * sin - dz * cos, dx * cos + dz * sin
        behind: Mask = (along >= outside.reach * (1 - RAY_TOLERANCE)) & (
            np.abs(across) <= RAY_TOLERANCE * np.abs(along)
        )
        return behind

    def check(self, rays: ChiefRays) -> None:
        """Check that rays leave the cover, do not cross outside, and do not turn back.

        Raises
        ------
        SelfObstruction
            With the first mirror point that violates this.
        """
        outside = rays.outside
        assert outside is not None
        is_blocked = ~np.isfinite(rays.omega)
        if is_blocked.any() and isinstance(self.shell, FlatWindow):
            i = int(np.argmax(is_blocked))
            raise SelfObstruction(
                "rays from the mirror must be directed back past the lens to pass the "
                f"window; those from x = {rays.x[i]:.5g} mm leave at "
                f"{np.degrees(rays.reflected[i]):.5g} deg; reduce rim_radius_mm, or use a "
                "tube or dome"
            )
        if is_blocked.any():
            raise SelfObstruction(
                f"rays from the mirror must pass the {self.shell.KIND}; those from x = "
                f"{rays.x[np.argmax(is_blocked)]:.5g} mm are totally reflected at its "
                "outer surface; use a larger diameter"
            )
        crossing = (outside.rate <= 0) | (outside.spread + outside.reach * outside.rate <= 0)
        crossing[0] &= rays.slope[0] == 0  # as without a cover: at the apex of a pointed mirror
        if crossing.any():
            raise SelfObstruction(
                f"the mapping behind the {self.shell.KIND} must be one-to-one; "
                f"neighbouring rays cross from x = {rays.x[np.argmax(crossing)]:.5g} mm; "
                "use a larger diameter or a thinner wall"
            )


def _refracted(
    ray: Pencil, side: RefractingSurface, before: float, after: float
) -> tuple[Pencil, Refraction]:
    """Return rays behind a surface, and its effect on wavefronts."""
    sin, cos = np.sin(ray.omega), np.cos(ray.omega)
    distance, normal = side.intersection(ray)
    curvature_t, curvature_s = side.curvatures
    i = ray.omega - normal
    cos_i, sin_behind = np.cos(i), before / after * np.sin(i)
    # Snell's law n sin(i) = n' sin(i'); its derivative n cos(i) di = n' cos(i') di' gives the rate,
    # with the rotation of the normal between neighbouring rays, curvature_t times their separation
    behind = np.arcsin(sin_behind)
    cos_behind = np.cos(behind)
    gain = after * cos_behind - before * cos_i
    along = (ray.spread + distance * ray.rate) / cos_i  # separation of neighbours along the surface
    turn = curvature_t * along
    rate = turn + before * cos_i * (ray.rate - turn) / (after * cos_behind)
    outgoing = Pencil(
        ray.x + distance * sin, ray.z - distance * cos, normal + behind, cos_behind * along, rate
    )
    ones = np.ones_like(gain)
    return outgoing, Refraction(
        distance,
        before * cos_i**2,
        after * cos_behind**2,
        gain * curvature_t,
        before * ones,
        after * ones,
        gain * curvature_s,
    )


def _identity_unless(crosses: Mask, r: Refraction) -> Refraction:
    """Return the refraction, set to the identity for rays that do not cross."""
    identity = (0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0)
    return Refraction(*(np.where(crosses, new, old) for new, old in zip(r, identity, strict=True)))


# -- Chief rays and their inversion ----------------------------------------------------------------

BETWEEN = 8  # points per polynomial piece at which the mapping is checked
NODES = 1025  # nodes of the table used for initial values and for the proof of monotonicity
ROUNDING = 1e-12  # relative tolerance of angles at the rim


@dataclass(frozen=True)
class ChiefRays:
    """Chief rays through n mirror points; all arrays are (n,), lengths in mm, angles in radians.

    ``beta`` is the slope angle of the mirror, ``theta`` the angle between axis and ray on the
    viewing side (for a lens, its viewing angle), ``gamma`` the angle of incidence and reflection,
    ``omega`` the field angle from -z (Eqs. 1-5) and ``w`` the axial distance from entrance pupil to
    mirror point (m + z if the pupil is in the reference point). ``path`` is the distance to the
    pupil; ``secondary_rays`` are the chief rays of a second mirror in which the lens sees the first
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
    secondary_rays: ChiefRays | None = None
    drift: Array | float = 0.0
    outside: OutsideRays | None = None

    @property
    def first(self) -> ChiefRays:
        """Chief rays at the mirror facing the lens: these, or those at a second mirror."""
        return self if self.secondary_rays is None else self.secondary_rays

    def dfirst_dx(self) -> Array:
        """Compute the derivative, by x, of the coordinate on the mirror facing the lens."""
        return (
            np.ones_like(self.x)
            if self.secondary_rays is None
            else self._dtheta_dx() / self.secondary_rays.domega_dx()
        )

    def pupil_distance(self) -> Array:
        """Compute the distance (mm) to the focus of neighbouring chief rays.

        The distance is along the chief ray. The focus is the entrance pupil if it is fixed, the
        caustic of the chief rays if it moves with their angle, or its tangential image in a second
        mirror.
        """
        if self.secondary_rays is None:
            return self.path - self.drift * np.sin(self.theta)
        second = self.secondary_rays
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
        """Compute the derivative of :attr:`reflected` with respect to x, 1/mm."""
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
        return self.outside.x + reach * np.sin(self.omega), self.outside.z - reach * np.cos(
            self.omega
        )

    def spread(self) -> Array:
        """Compute the transverse separation of neighbouring rays at :attr:`start`, per mm of
        mirror."""
        return (
            np.cos(self.gamma) / np.cos(self.beta) if self.outside is None else self.outside.spread
        )

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


def trace_chief_rays(
    mirror: Mirror, m: float, x_mm: ArrayLike, pupil: EntrancePupil = IN_REFERENCE_POINT
) -> ChiefRays:
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
    return ChiefRays(
        x, z, slope, curvature, m, w, beta, theta, gamma, beta + gamma, np.hypot(x, w), drift=drift
    )


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
        x = first_non_increasing_x(self.mirror, self.m - self.pupil.at_mm)
        if x is not None:
            raise _not_one_to_one(
                x, float(np.degrees(self._rays(np.array([x])).omega[0])), self.mirror.rim_radius_mm
            )

    def _check_finer_table(self) -> None:
        """Check monotonicity with more nodes per piece, for two mirrors or a moving pupil."""
        if (breaks := self.mirror.breaks) is not None and len(breaks) > 2:
            x = np.concatenate(
                [np.linspace(a, b, BETWEEN, endpoint=False) for a, b in pairwise(breaks)]
            )
            checked(self._rays(np.append(x[x > self.x_min], breaks[-1])))

    @cached_property
    def x_min(self) -> float:
        """Distance from the axis, mm, of the first mirror point of the field."""
        return self._first_outside(0.0)

    @property
    def centre_obscured_by(self) -> str:
        """Part that blocks the rays below :attr:`x_min`."""
        assert self.cover is not None, "without a cover, a single mirror is visible from its axis"
        return f"{self.cover.shell.KIND}'s base"

    def _first_outside(self, start: float) -> float:
        """Return the first mirror point of the field with a path to the outside, from ``start``."""
        if self.cover is None:
            return start
        return self.cover.first_visible_x(self._rays, start, self.mirror.rim_radius_mm)

    def _rays(self, x: Array) -> ChiefRays:
        return self._through_cover(trace_chief_rays(self.mirror, self.m, x, self.pupil))

    def _through_cover(self, rays: ChiefRays) -> ChiefRays:
        return rays if self.cover is None else self.cover.refracted(rays)

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
                f"x must be {start:g} to {rim:g} mm, the visible part of the mirror; got {_first(x, ~inside):g}"
            )
        return self._rays(np.clip(x, start, rim))

    def x_from_omega(self, omega: ArrayLike) -> Array:
        """Return the mirror points (mm) of field angles (n,), radians."""
        omega = np.asarray(omega, dtype=float)
        inside = self.is_in_field(omega)
        if not inside.all():
            raise OutsideField(
                f"omega must be {np.degrees(self.omega_min):.6g} to "
                f"{np.degrees(self.omega_max):.6g} deg, the field; got "
                f"{np.degrees(_first(omega, ~inside)):.10g}"
            )
        return self._invert_omega(omega)

    def is_in_field(self, omega: Array) -> NDArray[np.bool_]:
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
            interpolated = t * (1 - t) * ((1 - t) * (rate[0] - step) + t * (step - rate[1]))
        x: Array = (
            a + t * step + np.where(np.isfinite(interpolated), interpolated, 0.0)
        )  # finite rates
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
                f"theta must be at most {np.degrees(self.theta_max):.6g} deg, the rim of "
                f"the mirror; got {np.degrees(np.arctan(_first(tangent, ~inside))):.10g}"
            )
        cell = np.clip(np.searchsorted(tangents, tangent) - 1, 0, NODES - 2)

        depth = self.m - self.pupil.position(tangent)

        def difference(x: Array) -> tuple[Array, Array]:
            z, slope, _ = self.mirror.profile(x)
            return x - (depth + z) * tangent, 1 - slope * tangent

        start = np.interp(tangent, tangents, table.x)
        return increasing_root(
            difference, table.x[cell], table.x[cell + 1], start, self.mirror.rim_radius_mm
        )

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
            in_field = (z_t < surface) & np.isfinite(x_t) & np.isfinite(z_t)
            in_field &= (difference(start, x_t, z_t)[0] <= 0) & (
                difference(edge, x_t, z_t)[0] >= -ROUNDING
            )
        x = np.full_like(x_t, np.nan)
        if in_field.any():
            xt, zt = x_t[in_field], z_t[in_field]
            x[in_field] = increasing_root(
                lambda x: difference(x, xt, zt),
                start[in_field],
                edge[in_field],
                self.first_guess(xt, zt),
                rim,
            )
            if self.cover is not None:
                x[in_field] = np.where(
                    self.cover.leads_to(self._rays(x[in_field]), xt, zt), x[in_field], np.nan
                )
        return x

    def first_guess(self, x_t: Array, z_t: Array) -> Array:
        """Return single-viewpoint estimates of the mirror points (n,), mm."""
        midpoint = self._table.z[NODES // 2] + self._table.viewpoint_offset()[NODES // 2]
        omega, _ = _direction(x_t, z_t - midpoint)
        return np.interp(omega, self._table.omega, self._table.x)


def _direction(dx: Array, dz: Array) -> tuple[Array, Array]:
    """Return angles from -z in (-pi/2, 3 pi/2), and lengths."""
    phi = np.arctan2(dx, -dz)
    return np.where(phi < -np.pi / 2, phi + 2 * np.pi, phi), np.hypot(dx, dz)


def _first(values: Array, mask: NDArray[np.bool_]) -> float:
    return float(np.atleast_1d(values)[np.atleast_1d(mask)][0])


# -- validity checks -------------------------------------------------------------------------------
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
        raise InvalidParameter(f"mirror_distance_mm must be greater than 0; got {rays.m:g}")
    if rays.w[0] <= 0:
        raise InvalidParameter(
            f"mirror_distance_mm must be greater than {rays.m - rays.w[0] + rays.z[0]:g} "
            "mm, the position of the lens's entrance pupil: it would be behind the "
            f"mirror; got {rays.m:g}"
        )
    hidden = (rays.w <= 0) | (np.cos(rays.theta) - rays.slope * np.sin(rays.theta) <= 0)
    if hidden.any():
        raise SelfObstruction(
            f"rim_radius_mm must be less than {_first(rays.x, hidden):.6g} mm, where the "
            "lens views the mirror edge-on and its outer part is obscured; got "
            f"{rays.x[-1]:g}"
        )


def _check_one_to_one(rays: ChiefRays) -> None:
    falling = rays.dreflected_dx() <= 0
    falling[0] &= rays.slope[0] == 0  # the mapping may have square-root behaviour at the apex
    if not falling.any():
        return
    i = int(np.argmax(falling))
    if i <= 1:
        raise NotOneToOne(
            "the field angle Omega(x) must increase away from the axis; the mirror must be "
            "convex towards the lens, and a cone requires a perspective lens"
        )
    raise _not_one_to_one(rays.x[i], float(np.degrees(rays.omega[i])), rays.x[-1])


def _not_one_to_one(x: float, omega_deg: float, rim: float) -> NotOneToOne:
    return NotOneToOne(
        f"rim_radius_mm must be less than {x:.6g} mm, where the field angle Omega(x) stops "
        f"increasing ({omega_deg:.5g} deg) and the mapping is no longer one-to-one; got "
        f"{rim:g}"
    )
