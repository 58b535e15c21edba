"""Closed-form optics of mirror points, lenses and covers, for arrays of designs and complex steps."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..housing import (
    BEYOND_LENS_MM,
    TELECENTRIC_LENS_DISTANCE_RIMS,
    Dome,
    FlatWindow,
    Housing,
    Rim,
    Tube,
)
from ..lenses import BlurMode
from ..lenses._field_lens import FieldLens
from ..tracing.meridian import (
    CoverTransit,
    Pencil,
    RefractingSurface,
    distances_inside_cover,
    refract_through_shell,
    refracting_surfaces,
)
from ..tracing.obscuration import Obstructions

# -- Pinhole and bare mirror -----------------------------------------------------------------------
#
# The equations are those of :mod:`omnimirror.optics.tracing` and :mod:`omnimirror.analysis`,
# restricted to sums, products, roots and one form of arctangent. This allows exact complex-step
# derivatives in optimisation, and fast evaluation in blocks of thousands of designs. The quotient
# z'/x is an input: no limit is required on the axis.
#
# Both kinds of lens share the equations. The *vergence* of an image is the coordinate in which blur
# is linear: 1/L for a perspective lens (Eq. 28 is ``(f b0/F)(1/L0 - 1/L)``), and -L for a telecentric
# one, whose blur is ``mu^2 (L - L0)/F_w``. The *ray coordinate* is proportional to the image height:
# tan(theta) (Eq. 7), or x.

Array = NDArray[Any]
"""Real numbers, or complex ones for derivatives."""

DEGREE = np.pi / 180


class MirrorPointOptics(NamedTuple):
    """Camera-independent optics of mirror points; arrays like x, in mm and radians."""

    omega: Array
    """Field angle (Eq. 4)."""
    ray: Array
    """tan(theta) of the lens's viewing angle (Eq. 5); x for a telecentric lens."""
    magnification_t: Array
    """Tangential angular magnification: d ray per radian of object as seen from the mirror point.

    It gives Dh per radian and unit of the ray coordinate (Eqs. 8, 9), at the object distance.
    """
    magnification_s: Array
    """Sagittal angular magnification ray / (sin(Omega) + x/p): Dw in the same units (Eq. 10)."""
    vergence_t: Array
    """1/L_t (Eq. 34); -L_t for a telecentric lens."""
    vergence_s: Array
    """1/L_s (Eq. 35); -L_s for a telecentric lens."""
    viewpoint_z: Array
    """Intersection of the chief ray with the axis (Eq. 6)."""
    domega_dx: Array
    """dOmega/dx, 1/mm (Eq. 8); positive for a one-to-one mapping."""
    cos_incidence: Array
    """Cosine of the angle of incidence gamma (Eq. 3); positive on the front of the mirror."""
    visible: Any = True
    """False for points obscured by the base of a tube in another medium."""
    near: Any = 0.0
    """1/distance of the objects from the mirror points, 1/mm."""


class FocusedImage(NamedTuple):
    """Images of mirror points by a focused camera; arrays (..., k), or (..., 1) if constant."""

    t_px: Array
    """Signed tangential blur (Eq. 28)."""
    s_px: Array
    dh: Array
    """px per degree in the radial direction (Eq. 9)."""
    dw: Array
    """px per degree in the tangential direction (Eq. 10)."""
    airy_px: Array
    own_t_px: Array
    """Blur of the lens itself; 0 for an ideal one."""
    own_s_px: Array
    light: Array
    """Relative illumination of the imager by the lens."""


def node_optics(
    x: Array,
    z: Array,
    slope: Array,
    curvature: Array,
    slope_over_x: Array,
    m: Array,
    inverse_distance: Any = 0.0,
) -> MirrorPointOptics:
    """Compute the optics of mirror points for a perspective lens at distance m from the vertex.

    Parameters
    ----------
    slope_over_x
        z'/x, with the limit z'' on the axis.
    inverse_distance : 1/mm
        1/p of the object, 0 at infinity; or a function of x, z and field angle (radians) that
        returns it.
    """
    w = m + z
    steep = 1 + slope * slope
    root = np.sqrt(steep)
    to_lens = w * w + x * x
    rho = np.sqrt(to_lens)
    front = w - x * slope
    cos_gamma = front / (root * rho)
    sine = 2 * w * slope_over_x + 1 - slope * slope  # sin(Omega) steep rho / x
    omega = 2 * np.arctan(slope) + np.arctan(x / w)
    near = inverse_distance(x, z, omega) if callable(inverse_distance) else inverse_distance
    # Coddington's mirror equations (Eqs. 14, 18):
    # 1/q_t = 2/(R_t cos(gamma)) + 1/p, 1/q_s = 2 cos(gamma)/R_s + 1/p
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + near)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + near)
    # dOmega/dx = 2 dbeta/dx + dtheta/dx (Eq. 8)
    domega_dx = 2 * curvature / steep + front / to_lens
    return MirrorPointOptics(
        omega=omega,
        ray=x / w,
        # object motion perpendicular to the ray: p domega_dx + cos(gamma)/cos(beta);
        # around the axis: x + p sin(Omega)
        magnification_t=front / (w * w * (domega_dx + near * front / rho)),
        magnification_s=rho * steep / (w * (sine + near * rho * steep)),
        vergence_t=1 / (w * (1 + q_t / rho)),
        vergence_s=1 / (w * (1 + q_s / rho)),
        viewpoint_z=z + (w * (1 - slope * slope) - 2 * slope * x) / sine,
        domega_dx=domega_dx,
        cos_incidence=cos_gamma,
        near=near,
    )


def telecentric_optics(
    x: Array,
    z: Array,
    slope: Array,
    curvature: Array,
    slope_over_x: Array,
    inverse_distance: Any = 0.0,
) -> MirrorPointOptics:
    """Compute the optics as :func:`node_optics` for a telecentric lens."""
    # theta = 0: Omega = 2 beta (Eq. 4), and gamma = beta; the equations of node_optics for w -> inf.
    # 1/q_t = dOmega/dx + 1/p and 1/q_s = sin(Omega)/x + 1/p, both along the axis (cos(theta) = 1)
    steep = 1 + slope * slope
    domega_dx = 2 * curvature / steep
    omega = 2 * np.arctan(slope)
    near = inverse_distance(x, z, omega) if callable(inverse_distance) else inverse_distance
    return MirrorPointOptics(
        omega=omega,
        ray=x + 0 * slope,
        magnification_t=1 / (domega_dx + near),
        magnification_s=1 / (2 * slope_over_x / steep + near),
        vergence_t=-(z + 1 / (domega_dx + near)),
        vergence_s=-(z + 1 / (2 * slope_over_x / steep + near)),
        viewpoint_z=z + (1 - slope * slope) / (2 * slope_over_x),
        domega_dx=domega_dx,
        cos_incidence=1 / np.sqrt(steep),
        near=near,
    )


class FocusedCamera(Protocol):
    """Lens and pixels as functions of the vergence v in focus."""

    def image_distance(self, v: Array) -> Array:
        """Return the distance from lens to imager, mm; 0 for a telecentric lens."""
        ...

    def height_px(self, ray: Array, v: Array) -> Array:
        """Compute image heights of ray coordinates, px (Eq. 7)."""
        ...

    def at(self, o: MirrorPointOptics, v: Array) -> FocusedImage:
        """Compute the images of mirror points (..., k) at focus vergences (..., 1)."""
        ...

    def focus_mm(self, v: float) -> float:
        """Return the object distance in focus at a vergence."""
        ...

    def vergence(self, focus_mm: float) -> float:
        """Return the vergence of an object distance in focus."""
        ...

    def airy_px(self, v: Array) -> Array:
        """Compute the diameter of the Airy disc, px."""
        ...


class IdealCamera:
    """Base class of ideal cameras: uniform scales of image and blur over the field."""

    def px_per_ray(self, v: Array) -> Array:
        """Compute the image height per unit of the ray coordinate, px (Eq. 7)."""
        raise NotImplementedError

    def px_per_vergence(self, v: Array) -> Array:
        """Compute the blur per difference of vergences, px (Eqs. 28, 29)."""
        raise NotImplementedError

    def airy_px(self, v: Array) -> Array:
        raise NotImplementedError

    def light(self, ray: Array) -> Array:
        """Compute the natural falloff of rays, cos^4."""
        raise NotImplementedError

    def height_px(self, ray: Array, v: Array) -> Array:
        height: Array = ray * self.px_per_ray(v)
        return height

    def at(self, o: MirrorPointOptics, v: Array) -> FocusedImage:
        ray_px, blur_px, none = self.px_per_ray(v), self.px_per_vergence(v), 0 * v
        return FocusedImage(
            blur_px * (v - o.vergence_t),
            blur_px * (v - o.vergence_s),
            o.magnification_t * ray_px * DEGREE,
            o.magnification_s * ray_px * DEGREE,
            self.airy_px(v),
            none,
            none,
            self.light(o.ray),
        )


@dataclass(frozen=True)
class PerspectiveCamera(IdealCamera):
    """Perspective lens and pixels; vergences are v = 1/L0 (1/mm).

    Attributes
    ----------
    focal_length_mm, f_number, rim_ray
        Numbers, or arrays with one entry per design; ``rim_ray`` is tan(Theta).
    image_radius_px
        Scales the image to this rim radius; None for the actual radius.
    """

    focal_length_mm: Any
    f_number: Any
    rim_ray: Any
    pitch_mm: float
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        b: Array = 1 / (1 / self.focal_length_mm - v)  # b0, Eq. 25
        return b

    def px_per_ray(self, v: Array) -> Array:
        if self.image_radius_px is None:
            return self.image_distance(v) / self.pitch_mm
        scaled: Array = self.image_radius_px / self.rim_ray + 0 * v
        return scaled

    def px_per_vergence(self, v: Array) -> Array:
        b = self.image_distance(v) if self.mode == "exact" else self.focal_length_mm + 0 * v
        blur: Array = self.focal_length_mm * b / (self.f_number * self.pitch_mm)
        return blur

    def airy_px(self, v: Array) -> Array:
        working = self.f_number * self.image_distance(v) / self.focal_length_mm
        airy: Array = 2.44e-6 * self.wavelength_nm * working / self.pitch_mm
        return airy

    def light(self, ray: Array) -> Array:
        return light_of(ray)

    def focus_mm(self, v: float) -> float:
        return 1 / v

    def vergence(self, focus_mm: float) -> float:
        return 1 / focus_mm


@dataclass(frozen=True)
class TelecentricCamera(IdealCamera):
    """Telecentric lens and pixels; vergences are replaced by -L0 (mm), L0 from the mirror vertex.

    Attributes
    ----------
    magnification, f_number, rim_ray
        Numbers, or arrays with one entry per design; image-side F-number; ``rim_ray`` is the rim
        radius.
    """

    magnification: Any
    f_number: Any
    rim_ray: Any
    pitch_mm: float
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0

    def image_distance(self, v: Array) -> Array:
        return 0 * v

    def px_per_ray(self, v: Array) -> Array:
        if self.image_radius_px is None:
            plain: Array = self.magnification / self.pitch_mm + 0 * v
            return plain
        scaled: Array = self.image_radius_px / self.rim_ray + 0 * v
        return scaled

    def px_per_vergence(self, v: Array) -> Array:
        blur: Array = self.magnification**2 / (self.f_number * self.pitch_mm) + 0 * v
        return blur

    def airy_px(self, v: Array) -> Array:
        airy: Array = 2.44e-6 * self.wavelength_nm * self.f_number / self.pitch_mm + 0 * v
        return airy

    def light(self, ray: Array) -> Array:
        return light_of(0 * ray)

    def focus_mm(self, v: float) -> float:
        return -v

    def vergence(self, focus_mm: float) -> float:
        return -focus_mm


def light_of(tangent: Array) -> Array:
    """Compute cos^4 of viewing angles from their tangents."""
    squared: Array = tangent * tangent
    return 1 / (1 + squared) ** 2


# -- Real lenses: tables over viewing angle and focus ----------------------------------------------
#
# The focus parameter is ``q = f v / (1 - (f - e) v)``, with the vergence v in focus at the entrance
# pupil: the imager is ``f + f q`` behind the principal point, and the principal distance is
# ``f + (f - e) q``. Image quantities are linear in q except for vignetting and aberrations; a
# parabola through three focus settings represents them. Over the tangent of the viewing angle there
# are cubic pieces between equally spaced nodes, also used by the compiled evaluator. Imaginary parts
# of complex tangents carry derivatives.

CELLS = 512
MAX_DISTANCE_MM = 1e7
MIN_FOCUS_DISTANCE = 8.0  # focal lengths from the principal point: nearest focus of designs
AIM_STEPS = 6  # Newton steps for a moving pupil


class LensColumns(NamedTuple):
    """Lens properties at viewing angles; first axis (3, ...): powers 0, 1, 2 of q."""

    pupil_position: Array
    """(...) position of the entrance pupil, mm towards the mirror from the reference point."""
    motion: Array
    """(...) its derivative with respect to the tangent."""
    light: Array
    """(...) relative illumination of the imager, at the middle focus."""
    height: Array
    """(3, ...) image height, mm."""
    rate: Array
    """(3, ...) its derivative with respect to the tangent."""
    focused_t: Array
    """(3, ...) blur (mm) of a distant tangential image per radius of the pupil.

    The blur of an image of vergence V is this minus :attr:`spread_t` V, times two radii.
    """
    spread_t: Array
    focused_s: Array
    spread_s: Array
    own_t: Array
    """(3, ...) blur of the lens itself, mm."""
    own_s: Array


FOCUS_COLUMNS = LensColumns._fields[3:]
ROWS = 3 + 3 * len(FOCUS_COLUMNS)


@dataclass(frozen=True, eq=False)
class LensTables:
    """Tables of a real lens.

    Attributes
    ----------
    values : (CELLS + 1, 2, ROWS)
        Columns at the nodes, and their derivatives times the node spacing.
    end
        Tangent of the end of the field.
    focal_length_mm, f_number
    pupil_from_principal_mm
        Distance e of the paraxial entrance pupil from the principal point.
    pupil_mm
        Paraxial entrance pupil from the reference point: origin of vergences in focus.
    max_vergence
        Vergence of the nearest focus tabulated.
    imager_mm
        Distance from the reference point to the imager, focused at infinity.
    """

    values: Array
    end: float
    focal_length_mm: float
    f_number: float
    pupil_from_principal_mm: float
    pupil_mm: float
    max_vergence: float
    imager_mm: float

    @property
    def step(self) -> float:
        return self.end / CELLS

    @property
    def bounds(self) -> tuple[float, float]:
        """Vergences of the focus range."""
        return 1 / (MAX_DISTANCE_MM - self.pupil_mm), self.max_vergence

    def at(self, tangent: Array) -> LensColumns:
        """Evaluate the columns (...) at tangents (...), with linear extrapolation."""
        cell = np.clip((tangent.real / self.step).astype(int), 0, CELLS - 1)
        u = (tangent / self.step - cell)[..., None]
        (a, da), (b, db) = (np.moveaxis(self.values[cell + i], -2, 0) for i in (0, 1))
        values = a + u * (da + u * (3 * (b - a) - 2 * da - db + u * (2 * (a - b) + da + db)))
        rows = np.moveaxis(values, -1, 0)
        powers = [rows[3 + 3 * i : 6 + 3 * i] for i in range(len(FOCUS_COLUMNS))]
        return LensColumns(*rows[:3], *powers)

    def aimed(self, x: Array, depth: Array) -> Array:
        """Return tangents (...) of the chief rays to points at x from the axis and a depth.

        Solves ``w t = x`` for ``w = depth - place(t)`` by Newton's method.
        """
        tangent = x / (depth - self.pupil_mm)
        for _ in range(AIM_STEPS):
            columns = self.at(tangent)
            w = depth - columns.pupil_position
            tangent = tangent - (w * tangent - x) / (w - columns.motion * tangent)
        return tangent

    def defocus(self, v: Any) -> Any:
        """Compute q of vergences in focus."""
        f = self.focal_length_mm
        return f * v / (1 - (f - self.pupil_from_principal_mm) * v)

    def defocus_rate(self, v: Any) -> Any:
        """Compute the derivative of :meth:`defocus` with respect to v."""
        f = self.focal_length_mm
        return f / (1 - (f - self.pupil_from_principal_mm) * v) ** 2


def focus_powers(columns: Array, q: Any) -> Any:
    """Evaluate focus-dependent columns (3, ...) at q."""
    return columns[0] + q * (columns[1] + q * columns[2])


@lru_cache(maxsize=16)
def tables_of(lens: FieldLens) -> LensTables:
    """Create the tables of a lens, valid for any focus.

    Examples
    --------
    >>> from omnimirror.optics.lenses import TabulatedLens
    >>> angles = np.linspace(0, 30, 7)
    >>> ideal = tuple(12.0 * np.tan(np.radians(angles)))
    >>> tables = tables_of(TabulatedLens(12.0, 4.0, 1e7, tuple(angles), ideal, tuple(0 * angles)))
    >>> tables.at(np.array([0.25])).height[0].round(3)  # focused at infinity
    array([3.])
    """
    min_focus_mm = max(
        lens.principal_point_mm + MIN_FOCUS_DISTANCE * lens.focal_length_mm, lens.nearest_focus_mm
    )
    f, pupil_mm = lens.focal_length_mm, lens.pupil.at_mm
    tables = LensTables(
        np.empty(0),
        0.0,
        f,
        lens.f_number,
        lens.pupil_from_principal,
        pupil_mm,
        1 / (min_focus_mm - pupil_mm),
        0.0,
    )
    vergences = np.array(
        [1 / (MAX_DISTANCE_MM - pupil_mm), tables.max_vergence / 2, tables.max_vergence]
    )
    focused, q = (
        [lens.focused_at(float(1 / v + pupil_mm)) for v in vergences],
        tables.defocus(vergences),
    )
    end = min(focused_lens.field.end for focused_lens in focused)
    tangent = np.linspace(0.0, end, CELLS + 1)
    columns = np.stack(
        [_columns(focused_lens, tangent) for focused_lens in focused]
    )  # (3, 2, rows, nodes)
    position, motion, light = columns[1, :, :3].transpose(1, 0, 2)
    powers = np.linalg.solve(
        np.vander(q, increasing=True), columns[:, :, 3:].reshape(3, -1)
    ).reshape(3, *columns[:, :, 3:].shape[1:])
    rows = np.concatenate(
        [
            np.stack([position, motion, light]),
            powers.transpose(2, 0, 1, 3).reshape(-1, 2, CELLS + 1),
        ]
    )
    imager = focused[0].imager_mm - f * float(q[0])
    return replace(
        tables, imager_mm=imager, values=np.ascontiguousarray(rows.transpose(2, 1, 0)), end=end
    )


def _columns(lens: FieldLens, tangent: Array) -> Array:
    """Return all columns of a lens at its focus (2, rows, n): values, and derivatives per cell."""
    field, step = lens.field, tangent[1]

    def with_derivative(values: Any) -> Array:
        """Return values of a function of tangents, and its spline derivatives."""
        from scipy.interpolate import make_interp_spline

        spline = make_interp_spline(tangent, values, k=5)
        return np.stack([values, step * spline.derivative()(tangent)])

    values, (height, rate) = field.at(tangent), field.height(tangent)
    motion = lens.pupil.aim(tangent * 1.0, 1.0 + values.pupil).drift / (1 + tangent**2)
    wide_t, wide_s = values.scale_t * values.width_t, values.scale_s * values.width_s
    rows = (
        values.pupil,
        motion,
        values.illumination,
        height,
        rate,
        wide_t * values.vergence_t,
        wide_t,
        wide_s * values.vergence_s,
        wide_s,
        np.maximum(values.own_t, 0.0),
        np.maximum(values.own_s, 0.0),
    )
    return np.stack([with_derivative(row) for row in rows], axis=1)


# -- Lens with a moving pupil, and refracting cover ------------------------------------------------
#
# The equations are those of :mod:`omnimirror.optics.tracing`, for arrays of designs and for complex
# steps; the equations of a pinhole and a bare mirror are above.


class WallArrays(NamedTuple):
    """Clear walls of b designs, (b, 1) or scalars; heights above the vertices, mm."""

    sides: tuple[RefractingSurface, RefractingSurface]
    indices: tuple[float, float]
    """Refractive indices of the wall and of the outer medium."""
    ends: tuple[Any, Any] | None
    """Ends of a tube, which block rays; None for other walls."""
    fits: Any
    """True if mirror and lens fit inside."""


class ChiefRayGeometry(NamedTuple):
    """Chief-ray geometry of the lens at mirror points."""

    w: Array
    """Axial distance from the entrance pupil, mm."""
    tangent: Array
    """Tangents of the viewing angles."""
    drift: Array
    """Motion of the pupil, mm per radian."""


def walls_of(housing: Housing, m: Array, rim_sag: Array, M: Array) -> WallArrays | None:
    """Fit the wall of a housing to each design.

    The lenses are at m (b, 1) from the vertices, infinite for telecentric ones; the rims have
    heights and radii (b, 1).
    """
    shell, rim = housing.shell, housing.rim or Rim()
    if shell is None:
        return None
    lens = np.where(np.isfinite(m), -m, -TELECENTRIC_LENS_DISTANCE_RIMS * M)
    back, outer = rim_sag + rim.thickness_mm, M + rim.width_mm
    indices = shell.index, shell.outer_index
    if isinstance(shell, FlatWindow):
        inner = lens - BEYOND_LENS_MM if shell.height_mm is None else shell.height_mm + 0 * lens
        sides = (
            RefractingSurface("plane", np.inf, inner),
            RefractingSurface("plane", np.inf, inner - shell.wall_mm),
        )
        return WallArrays(sides, indices, None, np.real(inner) <= np.real(lens))
    if isinstance(shell, Tube):
        min_diameter, default_diameter = shell.diameters(outer)
        radius = (shell.diameter_mm or default_diameter) / 2 + 0 * lens
        sides = (
            RefractingSurface("cylinder", radius - shell.wall_mm, 0.0),
            RefractingSurface("cylinder", radius, 0.0),
        )
        return WallArrays(
            sides, indices, (lens, back), 2 * np.real(radius) >= np.real(min_diameter)
        )
    assert isinstance(shell, Dome)
    min_diameter, default_diameter = shell.diameters(lens, back, outer)
    radius, centre = (
        (shell.diameter_mm or default_diameter) / 2 + 0 * lens,
        shell.centre_between(lens, back) + 0 * lens,
    )
    sides = (
        RefractingSurface("sphere", radius - shell.wall_mm, centre + shell.inner_shift_mm),
        RefractingSurface("sphere", radius, centre),
    )
    encloses = (2 * np.real(radius) >= min_diameter) & (
        np.real(radius - shell.wall_mm) > np.abs(np.real(lens - centre))
    )
    return WallArrays(sides, indices, None, encloses)


def walls_around(obstructions: Obstructions) -> WallArrays | None:
    """Return the wall of one sensor, with known size."""
    shell, envelope = obstructions.housing.shell, obstructions.envelope
    if shell is None:
        return None
    ends = (envelope.base_mm, envelope.back_mm) if isinstance(shell, Tube) else None
    return WallArrays(refracting_surfaces(shell), (shell.index, shell.outer_index), ends, True)


def aim_of(x: Array, depth: Array, tables: LensTables | None) -> ChiefRayGeometry:
    """Return the chief rays of points at x from the axis and a depth from the lens.

    The depth is infinite for a telecentric lens; an ideal lens has its pupil in the reference
    point.
    """
    if tables is None:
        return ChiefRayGeometry(depth, x / depth, 0 * x)
    tangent = tables.aimed(x, depth)
    columns = tables.at(tangent)
    return ChiefRayGeometry(
        depth - columns.pupil_position, tangent, columns.motion * (1 + tangent * tangent)
    )


def built_optics(
    x: Array,
    z: Array,
    slope: Array,
    curvature: Array,
    slope_over_x: Array,
    aim: ChiefRayGeometry,
    near: Any,
    walls: WallArrays | None,
) -> MirrorPointOptics:
    """Compute the optics of mirror points as :func:`node_optics`.

    For a telecentric lens ``aim.w`` is infinite. If ``near`` is a function of points and field
    angles, it is evaluated at the exit of rays from the wall; distances are measured along the
    optical path.
    """
    w, t, telecentric = aim.w, aim.tangent, bool(np.isinf(np.real(aim.w)).all())
    steep = 1 + slope * slope
    root, cosine = np.sqrt(steep), 1 / np.sqrt(1 + t * t)  # cosine of the viewing angle
    cos_gamma = (1 - t * slope) * cosine / root
    # front/(rho^2 - drift x) of the meridian's equations, divided by w^2
    dtheta = (
        0 * slope if telecentric else (1 - t * slope) / (w * (1 / cosine**2 - aim.drift * t / w))
    )
    start = Pencil(
        x, z, 2 * np.arctan(slope) + np.arctan(t), cos_gamma * root, 2 * curvature / steep + dtheta
    )  # spread = cos(gamma)/cos(beta)
    foot, near, near_t, near_s, inside, visible, passes = _outside(start, near, walls)
    q_t = 1 / (2 * curvature / (steep * root * cos_gamma) + near_t)
    q_s = 1 / (2 * cos_gamma * slope_over_x / root + near_s)
    ray, dray = (x + 0 * slope, 1.0) if telecentric else (t, dtheta / cosine**2)
    on_axis = np.real(x) == 0
    sine = np.where(on_axis, 1.0, np.sin(foot.omega))
    # displacement of the object perpendicular to the ray and around the axis, divided by its
    # distance
    across = (1 - near * inside) * foot.rate + near * foot.spread
    around = sine + near * (foot.x - sine * inside)
    magnification_t = dray / across
    axis_z = foot.z + np.where(on_axis, foot.spread / foot.rate, foot.x * np.cos(foot.omega) / sine)
    return MirrorPointOptics(
        omega=foot.omega,
        ray=ray,
        magnification_t=magnification_t,
        magnification_s=np.where(on_axis, magnification_t, ray / np.where(on_axis, 1.0, around)),
        vergence_t=-(z + q_t * cosine) if telecentric else 1 / (w + q_t * cosine),
        vergence_s=-(z + q_s * cosine) if telecentric else 1 / (w + q_s * cosine),
        viewpoint_z=axis_z,
        domega_dx=np.where(passes, foot.rate, -1.0),
        cos_incidence=cos_gamma,
        visible=visible,
        near=near,
    )


def _outside(
    start: Pencil, near: Any, walls: WallArrays | None
) -> tuple[Pencil, Any, Any, Any, Any, Any, Any]:
    """Return rays outside the wall, and the vergences of objects.

    The values are: the pencil outside; 1/distance of objects from the mirror; 1/distance, as seen
    from the mirror, of their tangential and sagittal foci; the extra distance of objects from the
    mirror relative to the rays' origins; masks of mirror points with an unobstructed path to the
    outside, and of rays that the wall transmits.
    """
    if walls is None:
        near = near(start.x, start.z, start.omega) if callable(near) else near
        return start, near, near, near, 0.0, True, True
    passed = refract_through_shell(start, walls.sides, walls.indices)
    near, bare = (_behind_wall(near, passed), near(*start[:3])) if callable(near) else (near, near)
    behind = near / (1 - near * passed.inside)
    near_t, near_s = distances_inside_cover(passed.refractions, behind)
    inside = passed.inside - passed.reach
    outside = _is_transmitted(passed) & walls.fits & (np.real(near * passed.inside) < 1)
    if walls.ends is None:
        return passed.foot, near, near_t, near_s, inside, True, outside
    height = np.real(start.z - (walls.sides[0].radius - start.x) / np.tan(start.omega))
    base, cap = (np.real(end) for end in walls.ends)
    if walls.indices[1] != 1.0:
        visible = height > base
        return passed.foot, near, near_t, near_s, inside, visible, outside | ~visible
    crosses = (height > base) & (height < cap)
    foot = Pencil(
        *(np.where(crosses, new, old) for new, old in zip(passed.foot, start, strict=True))
    )
    near_t, near_s, near = (np.where(crosses, new, bare) for new in (near_t, near_s, near))
    return foot, near, near_t, near_s, np.where(crosses, inside, 0.0), True, outside | ~crosses


def _behind_wall(near: Any, passed: CoverTransit) -> Any:
    """Return 1/distance along the optical path from mirror points to objects behind a wall."""
    foot = passed.foot
    onward = near(
        foot.x + passed.reach * np.sin(foot.omega),
        foot.z - passed.reach * np.cos(foot.omega),
        foot.omega,
    )
    return onward / (1 + onward * passed.inside)


def as_rim(o: MirrorPointOptics) -> MirrorPointOptics:
    """Replace mirror points (n, k) without a path to the outside by the last one."""
    if o.visible is True:
        return o
    same = ("magnification_t", "magnification_s", "vergence_t", "vergence_s")
    return o._replace(
        **{n: np.where(o.visible, getattr(o, n), getattr(o, n)[:, -1:]) for n in same}
    )


def _is_transmitted(passed: CoverTransit) -> Any:
    """Check that rays leave the wall, and that neighbours do not cross behind it."""
    foot = passed.foot
    separated = np.real(foot.spread + passed.reach * foot.rate) > 0
    return np.isfinite(np.real(foot.omega)) & (np.real(foot.rate) > 0) & separated


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
        """Diameter of the Airy disc, px, as a linear function of q."""
        lens = self.tables
        axis = 2.44e-6 * self.wavelength_nm * lens.f_number / self.pitch_mm
        return axis, axis * (1 - lens.pupil_from_principal_mm / lens.focal_length_mm)

    def airy_px(self, v: Array) -> Array:
        axis, slope = self.airy_line
        airy: Array = axis + slope * self.tables.defocus(v)
        return airy

    def floor(self, q: Array) -> tuple[Array, Array]:
        """Return the squared pixel and Airy disc, px^2, and the derivative with respect to q."""
        axis, slope = self.airy_line
        airy = axis + slope * q
        return 1 + airy * airy, 2 * airy * slope

    def resolution(self, o: MirrorPointOptics, columns: LensColumns) -> tuple[Array, Array]:
        """Return Dh and Dw (3, ...), px/deg, by powers of q, at mirror points."""
        centre = np.real(o.ray) == 0
        over_ray = np.where(centre, columns.rate, columns.height / np.where(centre, 1.0, o.ray))
        scale = DEGREE / self.pitch_mm
        return columns.rate * o.magnification_t * scale, over_ray * o.magnification_s * scale

    def focus_mm(self, v: float) -> float:
        return 1 / v + self.tables.pupil_mm

    def vergence(self, focus_mm: float) -> float:
        return 1 / (focus_mm - self.tables.pupil_mm)

    def height_px(self, ray: Array, v: Array) -> Array:
        height: Array = (
            focus_powers(self.tables.at(ray).height, self.tables.defocus(v)) / self.pitch_mm
        )
        return height

    def at(self, o: MirrorPointOptics, v: Array) -> FocusedImage:
        """Compute the images of mirror points (..., k) at focus vergences (..., 1)."""
        columns, q = self.tables.at(o.ray), self.tables.defocus(v)
        far_t, spread_t, far_s, spread_s, own_t, own_s = (
            focus_powers(c, q) / self.pitch_mm for c in columns[5:]
        )
        dh, dw = (focus_powers(c, q) for c in self.resolution(o, columns))
        wide = self.tables.focal_length_mm / self.tables.f_number  # pupil diameter
        t, s = wide * (far_t - spread_t * o.vergence_t), wide * (far_s - spread_s * o.vergence_s)
        return FocusedImage(t, s, dh, dw, self.airy_px(v), own_t, own_s, columns.light)
