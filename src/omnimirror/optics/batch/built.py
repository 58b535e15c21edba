"""Closed-form optics of as-built designs: a lens with a moving pupil, and a refracting cover.

The equations are those of :mod:`omnimirror.optics.tracing`, for arrays of designs and for complex
steps; :mod:`.optics` has them for a pinhole and a bare mirror.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..housing import LENS_AT_RIMS, Dome, FlatWindow, Housing, Rim, Tube
from ..housing.walls import BEYOND_LENS_MM
from ..tracing.covers import Passed, Pencil, Side, seen_inside, sides_of, through_sides
from ..tracing.obscuration import Obstructions
from .lens_tables import LensColumns, LensTables, focus_powers
from .optics import DEGREE, Look, NodeOptics

Array = NDArray[Any]


class Walls(NamedTuple):
    """Clear walls of b designs, (b, 1) or scalars; heights above the vertices, mm."""

    sides: tuple[Side, Side]
    indices: tuple[float, float]
    """Refractive indices of the wall and of the outer medium."""
    ends: tuple[Any, Any] | None
    """Ends of a tube, which block rays; None for other walls."""
    fits: Any
    """True if mirror and lens fit inside."""


class Aim(NamedTuple):
    """Chief-ray geometry of the lens at mirror points."""

    w: Array
    """Axial distance from the entrance pupil, mm."""
    tangent: Array
    """Tangents of the viewing angles."""
    drift: Array
    """Motion of the pupil, mm per radian."""


def walls_of(housing: Housing, m: Array, rim_sag: Array, M: Array) -> Walls | None:
    """Fit the wall of a housing to each design.

    The lenses are at m (b, 1) from the vertices, infinite for telecentric ones; the rims have
    heights and radii (b, 1).
    """
    shell, rim = housing.shell, housing.rim or Rim()
    if shell is None:
        return None
    lens = np.where(np.isfinite(m), -m, -LENS_AT_RIMS * M)
    back, outer = rim_sag + rim.thickness_mm, M + rim.width_mm
    indices = shell.index, shell.outer_index
    if isinstance(shell, FlatWindow):
        inner = lens - BEYOND_LENS_MM if shell.height_mm is None else shell.height_mm + 0 * lens
        sides = Side("plane", np.inf, inner), Side("plane", np.inf, inner - shell.wall_mm)
        return Walls(sides, indices, None, np.real(inner) <= np.real(lens))
    if isinstance(shell, Tube):
        least, usual = shell.diameters(outer)
        radius = (shell.diameter_mm or usual) / 2 + 0 * lens
        sides = Side("cylinder", radius - shell.wall_mm, 0.0), Side("cylinder", radius, 0.0)
        return Walls(sides, indices, (lens, back), 2 * np.real(radius) >= np.real(least))
    assert isinstance(shell, Dome)
    least, usual = shell.diameters(lens, back, outer)
    radius, centre = (shell.diameter_mm or usual) / 2 + 0 * lens, shell.centre_between(lens, back) + 0 * lens
    sides = Side("sphere", radius - shell.wall_mm, centre + shell.inner_shift_mm), Side("sphere", radius, centre)
    takes_in = (2 * np.real(radius) >= least) & (np.real(radius - shell.wall_mm) > np.abs(np.real(lens - centre)))
    return Walls(sides, indices, None, takes_in)


def walls_around(obstructions: Obstructions) -> Walls | None:
    """Return the wall of one sensor, with known size."""
    shell, envelope = obstructions.housing.shell, obstructions.envelope
    if shell is None:
        return None
    ends = (envelope.base_mm, envelope.back_mm) if isinstance(shell, Tube) else None
    return Walls(sides_of(shell), (shell.index, shell.outer_index), ends, True)


def aim_of(x: Array, depth: Array, tables: LensTables | None) -> Aim:
    """Return the chief rays of points at x from the axis and a depth from the lens.

    The depth is infinite for a telecentric lens; an ideal lens has its pupil in the reference
    point.
    """
    if tables is None:
        return Aim(depth, x / depth, 0 * x)
    tangent = tables.aimed(x, depth)
    found = tables.at(tangent)
    return Aim(depth - found.place, tangent, found.motion * (1 + tangent * tangent))


def built_optics(
    x: Array, z: Array, slope: Array, curvature: Array, slope_over_x: Array, aim: Aim, near: Any, walls: Walls | None
) -> NodeOptics:
    """Compute the optics of mirror points as :func:`.optics.node_optics`.

    For a telecentric lens ``aim.w`` is infinite. If ``near`` is a function of points and field
    angles, it is evaluated at the exit of rays from the wall; distances are measured along the
    optical path.
    """
    w, t, telecentric = aim.w, aim.tangent, bool(np.isinf(np.real(aim.w)).all())
    steep = 1 + slope * slope
    root, cosine = np.sqrt(steep), 1 / np.sqrt(1 + t * t)  # of the viewing angle
    cos_gamma = (1 - t * slope) * cosine / root
    # front/(rho^2 - drift x) of the meridian's equations, divided by w^2
    dtheta = 0 * slope if telecentric else (1 - t * slope) / (w * (1 / cosine**2 - aim.drift * t / w))
    start = Pencil(
        x, z, 2 * np.arctan(slope) + np.arctan(t), cos_gamma * root, 2 * curvature / steep + dtheta
    )  # spread = cos(gamma)/cos(beta)
    foot, near, near_t, near_s, inside, seen, passes = _outside(start, near, walls)
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + near_t)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + near_s)
    ray, dray = (x + 0 * slope, 1.0) if telecentric else (t, dtheta / cosine**2)
    on_axis = np.real(x) == 0
    sine = np.where(on_axis, 1.0, np.sin(foot.omega))
    # displacement of the object across the ray and around the axis, divided by its distance
    across = (1 - near * inside) * foot.rate + near * foot.spread
    around = sine + near * (foot.x - sine * inside)
    magnification_t = dray / across
    axis_z = foot.z + np.where(on_axis, foot.spread / foot.rate, foot.x * np.cos(foot.omega) / sine)
    return NodeOptics(
        omega=foot.omega,
        ray=ray,
        magnification_t=magnification_t,
        magnification_s=np.where(on_axis, magnification_t, ray / np.where(on_axis, 1.0, around)),
        vergence_t=-(z + q_t * cosine) if telecentric else 1 / (w + q_t * cosine),
        vergence_s=-(z + q_s * cosine) if telecentric else 1 / (w + q_s * cosine),
        viewpoint_z=axis_z,
        domega_dx=np.where(passes, foot.rate, -1.0),
        cos_incidence=cos_gamma,
        seen=seen,
        near=near,
    )


def _outside(start: Pencil, near: Any, walls: Walls | None) -> tuple[Pencil, Any, Any, Any, Any, Any, Any]:
    """Return rays outside the wall, and the vergences of objects.

    The values are: the pencil outside; 1/distance of objects from the mirror; 1/distance, as seen
    from the mirror, of their tangential and sagittal foci; the extra distance of objects from the
    mirror relative to the rays' origins; masks of mirror points that see the outside, and of rays
    the wall lets out.
    """
    if walls is None:
        near = near(start.x, start.z, start.omega) if callable(near) else near
        return start, near, near, near, 0.0, True, True
    passed = through_sides(start, walls.sides, walls.indices)
    near, bare = (_behind_wall(near, passed), near(*start[:3])) if callable(near) else (near, near)
    behind = near / (1 - near * passed.inside)
    near_t, near_s = seen_inside(passed.refractions, behind)
    inside = passed.inside - passed.reach
    outside = _let_out(passed) & walls.fits & (np.real(near * passed.inside) < 1)
    if walls.ends is None:
        return passed.foot, near, near_t, near_s, inside, True, outside
    height = np.real(start.z - (walls.sides[0].radius - start.x) / np.tan(start.omega))
    base, cap = (np.real(end) for end in walls.ends)
    if walls.indices[1] != 1.0:
        seen = height > base
        return passed.foot, near, near_t, near_s, inside, seen, outside | ~seen
    crosses = (height > base) & (height < cap)
    foot = Pencil(*(np.where(crosses, new, old) for new, old in zip(passed.foot, start, strict=True)))
    near_t, near_s, near = (np.where(crosses, new, bare) for new in (near_t, near_s, near))
    return foot, near, near_t, near_s, np.where(crosses, inside, 0.0), True, outside | ~crosses


def _behind_wall(near: Any, passed: Passed) -> Any:
    """Return 1/distance along the optical path from mirror points to objects behind a wall."""
    foot = passed.foot
    onward = near(foot.x + passed.reach * np.sin(foot.omega), foot.z - passed.reach * np.cos(foot.omega), foot.omega)
    return onward / (1 + onward * passed.inside)


def as_rim(o: NodeOptics) -> NodeOptics:
    """Replace mirror points (n, k) without outside view by the last one."""
    if o.seen is True:
        return o
    same = ("magnification_t", "magnification_s", "vergence_t", "vergence_s")
    return o._replace(**{n: np.where(o.seen, getattr(o, n), getattr(o, n)[:, -1:]) for n in same})


def _let_out(passed: Passed) -> Any:
    """Check that rays leave the wall, and that neighbours do not cross behind it."""
    foot = passed.foot
    apart = np.real(foot.spread + passed.reach * foot.rate) > 0
    return np.isfinite(np.real(foot.omega)) & (np.real(foot.rate) > 0) & apart


@dataclass(frozen=True)
class RealCamera:
    """Real lens and pixels; vergences refer to the paraxial entrance pupil."""

    tables: LensTables
    pitch_mm: float
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        imager: Array = self.tables.imager_mm + self.tables.focal_length_mm * self.tables.defocus(v)
        return imager

    @property
    def bounds(self) -> tuple[float, float]:
        """Vergences of the focus range."""
        return self.tables.bounds

    @property
    def airy_line(self) -> tuple[float, float]:
        """Diameter of the Airy disk, px, as a linear function of q."""
        lens = self.tables
        axis = 2.44e-6 * self.wavelength_nm * lens.f_number / self.pitch_mm
        return axis, axis * (1 - lens.pupil_from_principal_mm / lens.focal_length_mm)

    def airy_px(self, v: Array) -> Array:
        axis, slope = self.airy_line
        airy: Array = axis + slope * self.tables.defocus(v)
        return airy

    def floor(self, q: Array) -> tuple[Array, Array]:
        """Return the squared pixel and Airy disk, px^2, and the derivative by q."""
        axis, slope = self.airy_line
        airy = axis + slope * q
        return 1 + airy * airy, 2 * airy * slope

    def resolution(self, o: NodeOptics, found: LensColumns) -> tuple[Array, Array]:
        """Return Dh and Dw (3, ..), px/deg, by powers of q, at mirror points."""
        centre = np.real(o.ray) == 0
        over_ray = np.where(centre, found.rate, found.height / np.where(centre, 1.0, o.ray))
        scale = DEGREE / self.pitch_mm
        return found.rate * o.magnification_t * scale, over_ray * o.magnification_s * scale

    def focus_mm(self, v: float) -> float:
        return 1 / v + self.tables.pupil_mm

    def vergence(self, focus_mm: float) -> float:
        return 1 / (focus_mm - self.tables.pupil_mm)

    def height_px(self, ray: Array, v: Array) -> Array:
        height: Array = focus_powers(self.tables.at(ray).height, self.tables.defocus(v)) / self.pitch_mm
        return height

    def at(self, o: NodeOptics, v: Array) -> Look:
        """Compute the images of mirror points (.., k) at focus vergences (.., 1)."""
        found, q = self.tables.at(o.ray), self.tables.defocus(v)
        far_t, spread_t, far_s, spread_s, own_t, own_s = (focus_powers(c, q) / self.pitch_mm for c in found[5:])
        dh, dw = (focus_powers(c, q) for c in self.resolution(o, found))
        wide = self.tables.focal_length_mm / self.tables.f_number  # pupil diameter
        t, s = wide * (far_t - spread_t * o.vergence_t), wide * (far_s - spread_s * o.vergence_s)
        return Look(t, s, dh, dw, self.airy_px(v), own_t, own_s, found.light)
