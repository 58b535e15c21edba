"""Meridional chief rays through a clear cover: Snell's law and astigmatic wavefront curvature.

Two quantities of a chief-ray pencil are traced in addition to position and direction, both per mm
of mirror: the transverse separation of neighbouring rays (``spread``) and their angular separation
(``rate``). Propagation over a distance t gives spread' = spread + t rate; refraction changes the
rate by the surface's curvature and the derivative of Snell's law (Coddington's tangential
equation). The sagittal equation uses the distance to the axis along the normal instead of the
radius of curvature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ...base.errors import InvalidParameter, SelfObstruction
from ...base.numerics.roots import sign_change
from ...base.typing import Array, Mask
from ..housing import Dome, FlatWindow, Shell, Tube

if TYPE_CHECKING:
    from .meridian import ChiefRays


PLACES = 257  # mirror points sampled to find the first ray past the base of a tube
ON_RAY = 1e-7  # relative distance within which a point is on a ray


class Refraction(NamedTuple):
    """Refraction of wavefronts: ``after vergence' = before vergence + power``, (n,)."""

    way: Any
    """Distance from the previous surface, mm."""
    before_t: Any
    after_t: Any
    power_t: Any
    before_s: Any
    after_s: Any
    power_s: Any


@dataclass(frozen=True)
class Outside:
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

    def seen_at(self, object_distance: Array) -> tuple[Array, Array]:
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
                f"object_distance_mm = {p:g} ends inside the cover; it is valid above {self.inside[i]:.5g} mm there"
            )
        with np.errstate(divide="ignore"):
            t, s = (1 / near for near in seen_inside(self.refractions, 1 / behind))
        return t, s


def seen_inside(refractions: tuple[Refraction, ...], near: Any) -> tuple[Any, Any]:
    """Convert 1/distance from the outer surface to that from the mirror, T and S."""
    vergence_t = vergence_s = -near
    for r in reversed(refractions):
        vergence_t = (r.after_t * vergence_t - r.power_t) / r.before_t
        vergence_s = (r.after_s * vergence_s - r.power_s) / r.before_s
        vergence_t, vergence_s = (v / (1 - r.way * v) for v in (vergence_t, vergence_s))
    return -vergence_t, -vergence_s


class Pencil(NamedTuple):
    """Chief rays with transverse and angular separation of their neighbours, per mm of mirror."""

    x: Any
    z: Any
    omega: Any
    spread: Any
    rate: Any


class Side(NamedTuple):
    """One surface of a wall about the axis; its numbers may be arrays over sensors."""

    kind: Literal["plane", "cylinder", "sphere"]
    radius: Any
    """Radius; not used for a plane."""
    height: Any
    """Height above the mirror vertex of a plane or a sphere's centre; not used for a cylinder."""

    def met_by(self, ray: Pencil) -> tuple[Any, Any]:
        """Return distances along rays from inside, and the angle of the normal."""
        sin, cos = np.sin(ray.omega), np.cos(ray.omega)
        if self.kind == "plane":
            return (ray.z - self.height) / cos, np.where(cos.real > 0, 0.0, np.nan)  # rising rays
        if self.kind == "cylinder":
            return (self.radius - ray.x) / sin, np.pi / 2 + 0 * ray.x
        dz = ray.z - self.height
        b, c = ray.x * sin - dz * cos, ray.x**2 + dz**2 - self.radius**2
        way = -b + np.sqrt(b * b - c)
        return way, _angle_of(ray.x + way * sin, way * cos - dz)

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


def sides_of(shell: Shell) -> tuple[Side, Side]:
    """Return inner and outer surface of a wall of known size."""
    if isinstance(shell, FlatWindow):
        inner, outer = (Side("plane", np.inf, height) for height in shell.heights_mm)
    elif isinstance(shell, Tube):
        inner, outer = (Side("cylinder", radius, 0.0) for radius in shell.radii_mm)
    else:
        inner, outer = (
            Side("sphere", radius, centre) for radius, centre in zip(shell.radii_mm, shell.centres_mm, strict=True)
        )
    return inner, outer


def through_sides(ray: Pencil, sides: tuple[Side, Side], indices: tuple[float, float]) -> Passed:
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
    foot = Pencil(ray.x - reach * sin, ray.z + reach * cos, ray.omega, ray.spread - reach * ray.rate, ray.rate)
    return Passed(foot, reach, through[0].way + through[1].way, tuple(through))


class Passed(NamedTuple):
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
    >>> rays = cover.left_by(trace_chief_rays(Sphere(50.0, 44.0), 180.0, [20.0, 40.0]))
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

    def left_by(self, rays: ChiefRays) -> ChiefRays:
        """Return chief rays outside the cover."""
        start = Pencil(rays.x, rays.z, rays.reflected, rays.spread(), rays.dreflected_dx())
        crosses = self.crosses(rays) if self.in_air else np.ones(rays.x.shape, dtype=bool)
        with np.errstate(all="ignore"):  # misses and total reflection: see below
            passed = through_sides(start, sides_of(self.shell), (self.shell.index, self.shell.outer_index))
        foot, through = passed.foot, passed.refractions
        found: tuple[Array, ...] = (*foot, passed.reach, passed.inside)
        if not crosses.all():
            nothing = np.zeros_like(start.x)
            bare = (*start, nothing, nothing)
            found = tuple(np.where(crosses, new, old) for new, old in zip(found, bare, strict=True))
            through = tuple(_only_where(crosses, r) for r in through)
        x, z, omega, spread, rate, reach, inside = found
        return replace(rays, omega=omega, outside=Outside(x, z, rate, spread, reach, inside, through))

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

    def first_seen(self, rays_at: Callable[[Array], ChiefRays], start: float, rim: float) -> float:
        """Return the distance from the axis of the first mirror point with outside view.

        Rays from smaller distances end at the base. In air, the inner rays are used.
        """
        if self.in_air or not isinstance(self.shell, Tube):
            return start

        def clear(x: Array | float) -> Array:
            height = self._wall_height(rays_at(np.atleast_1d(x)))
            return np.maximum(height - self.base_mm, -1e9)  # the axial ray never meets the wall

        x = np.linspace(start, rim, PLACES)
        height = clear(x)
        (passing,) = np.nonzero(height > 0)
        if not passing.size:
            raise SelfObstruction("no ray from the mirror passes the tube's wall: all of them end at its base")
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
        behind: Mask = (along >= outside.reach * (1 - ON_RAY)) & (np.abs(across) <= ON_RAY * np.abs(along))
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
        caught = ~np.isfinite(rays.omega)
        if caught.any() and isinstance(self.shell, FlatWindow):
            i = int(np.argmax(caught))
            raise SelfObstruction(
                f"the window is passed only by rays that lead back past the lens, and those from x = {rays.x[i]:.5g} mm"
                f" leave the mirror at {np.degrees(rays.reflected[i]):.5g} deg; a smaller rim_radius_mm is valid, or a "
                "tube or a dome"
            )
        if caught.any():
            raise SelfObstruction(
                f"the {self.shell.KIND} keeps in rays from x = {rays.x[np.argmax(caught)]:.5g} mm on: they meet its "
                "outer side so askew that they are reflected; a wider one lets them out"
            )
        crossing = (outside.rate <= 0) | (outside.spread + outside.reach * outside.rate <= 0)
        crossing[0] &= rays.slope[0] == 0  # as without a cover: at the apex of a pointed mirror
        if crossing.any():
            raise SelfObstruction(
                f"behind the {self.shell.KIND} neighbouring rays cross from x = {rays.x[np.argmax(crossing)]:.5g} mm "
                "on, so that the mapping is not one to one; a wider or thinner one keeps them apart"
            )


def _refracted(ray: Pencil, side: Side, before: float, after: float) -> tuple[Pencil, Refraction]:
    """Return rays behind a surface, and its effect on wavefronts."""
    sin, cos = np.sin(ray.omega), np.cos(ray.omega)
    way, normal = side.met_by(ray)
    curvature_t, curvature_s = side.curvatures
    i = ray.omega - normal
    cos_i, sin_behind = np.cos(i), before / after * np.sin(i)
    # Snell's law n sin(i) = n' sin(i'); its derivative n cos(i) di = n' cos(i') di' gives the rate,
    # with the rotation of the normal between neighbouring rays, curvature_t times their separation
    behind = np.arcsin(sin_behind)
    cos_behind = np.cos(behind)
    gain = after * cos_behind - before * cos_i
    along = (ray.spread + way * ray.rate) / cos_i  # separation of neighbours along the surface
    turn = curvature_t * along
    rate = turn + before * cos_i * (ray.rate - turn) / (after * cos_behind)
    left = Pencil(ray.x + way * sin, ray.z - way * cos, normal + behind, cos_behind * along, rate)
    one = np.ones_like(gain)
    return left, Refraction(
        way,
        before * cos_i**2,
        after * cos_behind**2,
        gain * curvature_t,
        before * one,
        after * one,
        gain * curvature_s,
    )


def _only_where(crosses: Mask, r: Refraction) -> Refraction:
    """Return the refraction, set to the identity for rays that do not cross."""
    nothing = (0.0, 1.0, 1.0, 0.0, 1.0, 1.0, 0.0)
    return Refraction(*(np.where(crosses, new, old) for new, old in zip(r, nothing, strict=True)))
