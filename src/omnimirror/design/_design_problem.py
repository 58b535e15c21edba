"""Problem definition of a mirror optimisation, and its design space with size and mass."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import choice, image_radius
from ..base.caching import cached_property
from ..base.errors import InvalidParameter
from ..optics.batch.closed_forms import (
    DEGREE,
    LensTables,
    PerspectiveCamera,
    RealCamera,
    TelecentricCamera,
    aim_of,
    built_optics,
    focus_powers,
    node_optics,
    tables_of,
    telecentric_optics,
    walls_of,
)
from ..optics.batch.evaluate import BatchEvaluation, Designs, evaluate_designs
from ..optics.batch.families import Basis, Family, family
from ..optics.housing import Housing, Rim, Tube
from ..optics.image_sensor import Imager
from ..optics.lenses import BLUR_MODES, BlurMode, FieldLens
from ..optics.mirrors.mirror import conic_profile
from ..optics.sensor import Sensor
from ..optics.tracing.meridian import Pencil, refract_through_shell
from ..optics.tracing.obscuration import disc_clearance
from .limits import Limit
from .merits import FieldValues, density_of, gauss_nodes, values_at, values_of
from .requirements import Range, ends

# -- Overall dimensions and mass of designs, with derivatives, for limits in a search --------------

Array = NDArray[Any]


def with_size(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> FieldValues:
    """Return field values of designs (b, dim) with the limited overall quantities (b, 1)."""
    requested = {limit.quantity for limit in space.problem.limits}
    return field._replace(
        **{name: of(field, space, y, g) for name, of in SIZES.items() if name in requested}
    )


def _rim(space: DesignSpace) -> Rim:
    return space.problem.housing.rim or Rim()


def _diameter(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    camera = space.problem.housing.camera
    widest: Array = 2 * (g.M + _rim(space).width_mm)
    for other in (0.0 if camera is None else camera.diameter_mm, _cover(space, y, g)):
        widest = np.where(widest.real >= np.real(other), widest, other)
    return widest


def _cover(space: DesignSpace, y: Array, g: Given) -> Any:
    """Return the outer diameter of a tube or a dome fitted to a design, or of a bounded window."""
    housing = space.problem.housing
    if housing.shell is None or housing.shell.diameter_mm is not None:
        return 0.0 if housing.shell is None else housing.shell.diameter_mm
    rim = g.M * space.sags(y, g, np.ones(1))
    walls = walls_of(housing, space.reach(g) - rim, rim, g.M)
    assert walls is not None
    kind, radius, _ = walls.sides[1]
    return 0.0 if kind == "plane" else 2 * radius


def _height(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    height: Array = field.image_distance + field.length + _rim(space).thickness_mm
    return height


def _mass(field: FieldValues, space: DesignSpace, y: Array, g: Given) -> Array:
    nodes, weights = gauss_nodes()
    u = (nodes + 1) / 2
    z = g.M * space.sags(y, g, u)
    top = g.M * space.sags(y, g, np.ones(1))
    depth = np.where(top.real > 0, top, 0 * top) + _rim(space).thickness_mm - z
    # V = 2 pi integral of x depth dx with x = M u; the weights refer to 2 u - 1 in (-1, 1).
    volume = np.pi * g.M**2 * (u * depth * weights).sum(axis=-1, keepdims=True)
    mass: Array = density_of(space.problem.mirror_material) * volume / 1000
    return mass


SIZES: dict[str, Callable[[FieldValues, DesignSpace, Array, Given], Array]] = {
    "overall_diameter_mm": _diameter,
    "overall_height_mm": _height,
    "mirror_body_mass_g": _mass,
}


# -- Problem definition of a mirror optimisation: given values, free values and limits -------------

LENS_KINDS = ("perspective", "orthographic")
OF_LENS = ("theta_max_deg", "focal_length_mm")


@dataclass(frozen=True)
class DesignProblem:
    """Field, size, lens and pixels of the candidate sensors; ranges are free variables.

    Parameters
    ----------
    omega_max_deg, rim_radius_mm
        Field angle at the rim, and rim radius M.
    theta_max_deg, focal_length_mm
        Viewing angle of the lens at the rim, which determines the distance m, and focal length. One
        of them may be None and then follows from a rim image that fills the imager. A telecentric
        lens has neither; its magnification then follows from a rim image that fills the imager.
    f_number
        F-number; for a telecentric lens the image-side working F-number.
    magnification
        Magnification of a telecentric lens, if the imager is not to be filled.
    imager
        Pixels and their pitch.
    largest_image_px
        Largest radius of the rim image; by default that of the largest circle on the imager.
    lens
        ``"perspective"`` or ``"orthographic"`` (telecentric, as wide as the mirror).
    omega_min_deg
        Inner end of the evaluated field; the camera obscures smaller angles.
    housing
        Housing of the mirror. The evaluated field starts at the end of the obscuration by the
        camera, if this is beyond ``omega_min_deg``; for ``omega_min_deg`` above 0, an unobscured
        view from there is a constraint. Other parts of the housing are included in the requirement
        check, not in the search.
    object_distance_mm
        Object distance from the mirror, or the nearest and the farthest distance; both are
        evaluated.
    focus_mm
        Focus distance, or its range; None for a free focus.
    mode, image_radius_px, wavelength_nm
        As in :func:`omnimirror.evaluate`.
    family, terms
        Kind of mirror, and number of shape parameters.
    limits
        Additional limits. If theta or the focal length is a range, the size of the rim image is
        also a constraint.
    mirror_material
        Material of the mirror body, for limits of the mass; aluminium by default.
    optics
        Real lens, which determines focal length and F-number.

    Raises
    ------
    InvalidParameter
        If the values do not define a mirror, or a range is empty.

    Examples
    --------
    >>> DesignProblem(omega_max_deg=120.0, terms=8).free
    []
    """

    omega_max_deg: Range = 135.0
    theta_max_deg: Range | None = 12.0
    rim_radius_mm: Range = 43.9
    focal_length_mm: Range | None = 11.6
    magnification: Range | None = None
    f_number: Range = 4.0
    imager: Imager = field(default_factory=lambda: Imager(1024, 1024, 5.2))
    largest_image_px: float | None = None
    lens: str = "perspective"
    omega_min_deg: float = 0.0
    housing: Housing = field(default_factory=Housing)
    object_distance_mm: Range = np.inf
    focus_mm: Range | None = None
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0
    family: str = "slope-spline"
    terms: int = 12
    limits: tuple[Limit, ...] = ()
    mirror_material: str | None = None
    optics: FieldLens | None = None

    def __post_init__(self) -> None:
        if self.lens not in LENS_KINDS:
            raise InvalidParameter(
                f"lens must be one of {', '.join(LENS_KINDS)}; got {self.lens!r}"
            )
        if self.optics is not None:
            object.__setattr__(self, "focal_length_mm", self.optics.focal_length_mm)
            object.__setattr__(self, "f_number", self.optics.f_number)
            if self.is_telecentric or self.mode != "exact" or self.image_radius_px is not None:
                raise InvalidParameter(
                    "a real lens requires lens = 'perspective', mode = 'exact' and no "
                    f"image_radius_px; got lens = {self.lens!r}, mode = {self.mode!r}, "
                    f"image_radius_px = {self.image_radius_px}"
                )
        if self.is_telecentric:
            for name in OF_LENS:
                object.__setattr__(self, name, None)
        elif self.theta_max_deg is None and self.focal_length_mm is None:
            raise InvalidParameter(
                "a perspective lens requires theta_max_deg or focal_length_mm, a number or a range"
            )
        choice("mode", self.mode, BLUR_MODES)
        if self.image_radius_px is not None:
            image_radius(self.image_radius_px)
        self._check_ranges()
        self._check_focus()
        self._check_field()
        family(self.family, self.terms)

    @property
    def is_telecentric(self) -> bool:
        return self.lens == "orthographic"

    @property
    def distances_mm(self) -> tuple[float, ...]:
        """Distinct object distances."""
        return tuple(sorted(set(ends(self.object_distance_mm))))

    @property
    def free(self) -> list[str]:
        """Names of the ranges, the free variables in addition to shape and focus."""
        names = (
            "omega_max_deg",
            "theta_max_deg",
            "rim_radius_mm",
            "focal_length_mm",
            "magnification",
            "f_number",
        )
        return [n for n in names if (v := getattr(self, n)) is not None and ends(v)[0] < ends(v)[1]]

    @property
    def has_image_to_fit(self) -> bool:
        """True if the size of the rim image depends on free variables."""
        if self.is_telecentric:
            return self.magnification is not None
        return None not in (self.theta_max_deg, self.focal_length_mm) and any(
            n in self.free for n in OF_LENS
        )

    @property
    def image_radius_mm(self) -> float:
        """Largest radius of the rim image."""
        radius = (
            self.imager.inscribed_radius_px
            if self.largest_image_px is None
            else self.largest_image_px
        )
        return radius * self.imager.pitch_mm

    @property
    def has_view_to_clear(self) -> bool:
        """True if an unobscured view past the camera is required from a field angle on."""
        return (
            self.housing.camera is not None and self.omega_min_deg > 0 and not self.is_telecentric
        )

    def _check_ranges(self) -> None:
        for name in (
            "omega_max_deg",
            "theta_max_deg",
            "rim_radius_mm",
            "focal_length_mm",
            "magnification",
            "f_number",
            "object_distance_mm",
        ):
            if (value := getattr(self, name)) is None:
                continue
            low, high = ends(value)
            if not 0 < low <= high:
                text = f"{low:g}" if low == high else f"{low:g} to {high:g}"
                raise InvalidParameter(
                    f"{name} must be a number above 0, or a range with 0 < low <= high; got {text}"
                )

    def _check_focus(self) -> None:
        if self.focus_mm is None:
            return
        low, high = ends(self.focus_mm)
        object.__setattr__(self, "focus_mm", low if low == high else (low, high))
        if not (
            np.isfinite([low, high]).all() and low <= high and (low > 0 or self.is_telecentric)
        ):
            raise InvalidParameter(
                f"focus_mm must be a distance above 0, or a range with 0 < low <= high; got {low:g} to {high:g}"
            )

    def _check_field(self) -> None:
        omega_min, omega = ends(self.omega_max_deg)
        theta_max = 0.0 if self.theta_max_deg is None else ends(self.theta_max_deg)[1]
        if not (theta_max < omega_min and omega < 180 - theta_max):
            raise InvalidParameter(
                f"omega_max_deg must be between {theta_max:g} and {180 - theta_max:g} deg "
                f"for theta_max_deg = {theta_max:g}; got {omega:g}"
            )
        if not 0 <= self.omega_min_deg < omega_min:
            raise InvalidParameter(
                f"omega_min_deg must be at least 0 and less than {omega_min:g}; got {self.omega_min_deg:g}"
            )


# -- Design space of a problem: points for an optimiser, and their sensors -------------------------
#
# Every design of the space has exactly the given field, rim radius and viewing angle at the rim: the
# slope at the rim is ``tan((Omega_max - Theta)/2)`` and the lens distance is ``M/tan(Theta) - z(M)``.
# The free variables are slopes at nodes between axis and rim, the focus, and the ranges of the
# problem. For a telecentric lens Theta is 0 and there is no distance.

ROUNDS_OF_LENS = (
    10  # iterations for a real lens or a cover; each reduces the residual at least tenfold
)
ROUNDS = 6
"""Iterations for mutually dependent lens and focus; each gains one or two digits."""


class Given(NamedTuple):
    """Field, rim and lens of designs, (b, 1) each, complex for derivatives."""

    omega_max: Array
    M: Array
    theta: Array
    """0 for a telecentric lens."""
    tangent: Array
    """Tangent of Theta; NaN for a telecentric lens."""
    focal: Array
    """Focal length; magnification for a telecentric lens."""
    f_number: Array
    focus: Array
    """Vergence in focus: 1/L0 from the entrance pupil, or -L0 for a telecentric lens."""
    inside_max: Array
    """Field angle at the rim before refraction: omega_max without a cover."""


class State(NamedTuple):
    """State of designs (b, 1) and their mirror points (b, k); complex for derivatives."""

    field: FieldValues
    omega: Array
    domega_du: Array
    """Derivative dOmega/du, radians; positive for a one-to-one mapping."""
    cos_incidence: Array
    """Cosine of the angle of incidence; positive for the front of the mirror."""
    hidden: Array
    """Obscuration by the camera relative to its radius; 0 or negative for an unobscured view."""
    image: Array
    """Radius of the rim image relative to the largest permitted one (b, 1)."""


@dataclass(frozen=True)
class DesignSpace:
    """Designs of a problem as points y (dim,), with steps of 0.1 of comparable effect.

    Coordinates: slopes at all nodes of the family except the rim; curvature (times M) and conic
    constant of a conic with asphere terms, or the conic constant of a pure conic; the vergence in
    focus, unless it is given, relative to that of the rim (telecentric: to M), or for a range
    relative to that of its nearest end; and the logarithms of the free numbers.
    """

    problem: DesignProblem

    @cached_property
    def family(self) -> Family:
        return family(self.problem.family, self.problem.terms)

    @cached_property
    def _from_slopes(self) -> Array:
        return self.family.from_slopes()

    @cached_property
    def names(self) -> list[str]:
        """Names of the coordinates."""
        conic = (
            (["curvature", "conic"] if self.family.terms else ["conic"])
            if self.family.has_conic
            else []
        )
        focus = [] if isinstance(self.problem.focus_mm, float) else ["focus"]
        return [
            *(f"slope {u:.4f}" for u in self.family.slope_places()[:-1]),
            *conic,
            *focus,
            *self.problem.free,
        ]

    @property
    def dim(self) -> int:
        return len(self.names)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lower and upper bounds of the coordinates, (dim,)."""
        low, high = np.full(self.dim, -np.inf), np.full(self.dim, np.inf)
        low[: max(self.family.terms - 1, 0)] = 0.0
        focus = (-30.0, 30.0) if self.problem.is_telecentric else (0.05, 3.0)
        if isinstance(requested := self.problem.focus_mm, tuple):
            positions = sorted(self._place(mm) / self._focus_unit for mm in requested)
            focus = positions[0], positions[1]
        for name, ends_of in (
            ("curvature", (1e-3, 10.0)),
            ("conic", (-20.0, 20.0)),
            ("focus", focus),
        ):
            if name in self.names:
                low[self.names.index(name)], high[self.names.index(name)] = ends_of
        for name in self.problem.free:
            low[self.names.index(name)], high[self.names.index(name)] = np.log(
                ends(getattr(self.problem, name))
            )
        return low, high

    # -- field, rim and lens -----------------------------------------------------------------------

    def _number(self, y: Array, name: str) -> Array:
        """Return a number of the problem, free or fixed, for designs (b, dim), as (b, 1)."""
        if name in self.problem.free:
            return np.exp(y[:, self.names.index(name), None])
        return np.full((len(y), 1), ends(getattr(self.problem, name))[0], dtype=y.dtype)

    def given(self, y: Array) -> Given:
        """Return field, rim and lens of designs (b, dim)."""
        omega_max, M, F = (
            self._number(y, n) for n in ("omega_max_deg", "rim_radius_mm", "f_number")
        )
        omega_max = omega_max * DEGREE
        if self.tables is not None:
            return self._inside(y, self._given_real(y, omega_max, M, F, self.tables))
        if self.problem.is_telecentric:
            return self._inside(y, self._given_telecentric(y, omega_max, M, F))
        p, radius = self.problem, self.imager_radius_mm
        fixed = self._fixed(y, M)
        relative = 0 * M if fixed is not None else y[:, self.names.index("focus"), None]
        if p.theta_max_deg is not None:
            theta = self._number(y, "theta_max_deg") * DEGREE
            tangent = np.tan(theta)
        else:  # the rim fills the imager: tangent = radius/b0, and 1/b0 = 1/f - 1/L0
            near = self._number(y, "focal_length_mm")
            tangent = (
                radius / near / (1 + radius * relative / M)
                if fixed is None
                else radius * (1 / near - fixed)
            )
            theta = np.arctan(tangent)
        v = relative * tangent / M if fixed is None else fixed
        focal = (
            self._number(y, "focal_length_mm")
            if p.focal_length_mm is not None
            else 1 / (tangent / radius + v)
        )
        return self._inside(y, Given(omega_max, M, theta, tangent, focal, F, v, omega_max))

    def _given_real(
        self, y: Array, omega_max: Array, M: Array, F: Array, tables: LensTables
    ) -> Given:
        """Return the values for a real lens, at the focus of each design."""
        fixed = self._fixed(y, M)
        relative = 0 * M if fixed is not None else y[:, self.names.index("focus"), None]
        if self.problem.theta_max_deg is not None:
            tangent = np.tan(self._number(y, "theta_max_deg") * DEGREE)
        else:
            tangent = self.imager_radius_mm / tables.focal_length_mm + 0 * M
            for _ in range(ROUNDS_OF_LENS):
                q = tables.defocus(relative * tangent / M if fixed is None else fixed)
                result = tables.at(tangent)
                missed = self.imager_radius_mm - focus_powers(result.height, q)
                tangent = tangent + missed / focus_powers(result.rate, q)
        v = relative * tangent / M if fixed is None else fixed
        return Given(
            omega_max,
            M,
            np.arctan(tangent),
            tangent,
            tables.focal_length_mm + 0 * M,
            F,
            v,
            omega_max,
        )

    def _inside(self, y: Array, g: Given) -> Given:
        """Return the values with the angle inside the cover for the given field angle outside."""
        shell = self._bending.shell
        if shell is None or (isinstance(shell, Tube) and shell.outer_index == 1.0):
            return g
        one = np.ones(1)
        with np.errstate(all="ignore"):
            for _ in range(ROUNDS_OF_LENS):
                z = g.M * self.sags(y, g, one)
                walls = walls_of(self._bending, self.reach(g) - z, z, g.M)
                assert walls is not None
                rim = Pencil(g.M, z, g.inside_max, 0 * z, 1 + 0 * z)  # homocentric pencil
                out = refract_through_shell(rim, walls.sides, walls.indices).foot
                g = g._replace(inside_max=g.inside_max + (g.omega_max - out.omega) / out.rate)
        return g

    def reach(self, g: Given) -> Array:
        """Return the axial distance from the lens to the rim, mm; infinite if telecentric."""
        if self.problem.is_telecentric:
            return np.full(g.M.shape, np.inf)
        pupil_position = 0.0 if self.tables is None else self.tables.at(g.tangent).pupil_position
        reach: Array = g.M / g.tangent + pupil_position
        return reach

    @cached_property
    def tables(self) -> LensTables | None:
        """Tables of the real lens, or None."""
        return None if self.problem.optics is None else tables_of(self.problem.optics)

    @cached_property
    def _bending(self) -> Housing:
        """Refracting cover of the search; the verification alone includes a tube with
        another outer medium, which has no field near the axis.
        """
        shell = self.problem.housing.shell
        is_left_out = (
            shell is None
            or not shell.is_axial
            or (isinstance(shell, Tube) and shell.outer_index != 1.0)
        )
        return Housing() if is_left_out else Housing(shell=shell, rim=self.problem.housing.rim)

    def _given_telecentric(self, y: Array, omega_max: Array, M: Array, F: Array) -> Given:
        fixed = self._fixed(y, M)
        v = y[:, self.names.index("focus"), None] * M if fixed is None else fixed
        requested = self.problem.magnification
        magnification = (
            self.imager_radius_mm / M if requested is None else self._number(y, "magnification")
        )
        return Given(omega_max, M, 0 * M, np.nan * M, magnification, F, v, omega_max)

    def _place(self, focus_mm: Any) -> Any:
        if self.problem.is_telecentric:
            return -focus_mm
        return 1 / (focus_mm - (0.0 if self.tables is None else self.tables.pupil_mm))

    @property
    def _focus_unit(self) -> float:
        """Unit of the coordinate of a focus range: its largest vergence."""
        assert isinstance(self.problem.focus_mm, tuple)
        return float(max(abs(self._place(mm)) for mm in self.problem.focus_mm))

    def _fixed(self, y: Array, M: Array) -> Array | None:
        """Return the vergence in focus (b, 1), given or from its range; None if it is free."""
        requested = self.problem.focus_mm
        if requested is None:
            return None
        if isinstance(requested, tuple):
            chosen: Array = y[:, self.names.index("focus"), None] * self._focus_unit
            return chosen
        return np.full_like(M, self._place(requested))

    @property
    def imager_radius_mm(self) -> float:
        return self.problem.image_radius_mm

    def camera(self, g: Given) -> PerspectiveCamera | TelecentricCamera | RealCamera:
        """Return the model of lens and pixels of designs."""
        p = self.problem
        if self.tables is not None:
            return RealCamera(self.tables, p.imager.pitch_mm, p.wavelength_nm)
        if p.is_telecentric:
            return TelecentricCamera(
                g.focal, g.f_number, g.M, p.imager.pitch_mm, p.image_radius_px, p.wavelength_nm
            )
        return PerspectiveCamera(
            g.focal,
            g.f_number,
            g.tangent,
            p.imager.pitch_mm,
            p.mode,
            p.image_radius_px,
            p.wavelength_nm,
        )

    # -- shape and optics --------------------------------------------------------------------------

    def _shapes(self, y: Array, g: Given) -> tuple[Array, Array, Array]:
        """Return coefficients (b, terms), and vertex radius over M and conic constant (b, 1)."""
        rim = np.tan((g.inside_max - g.theta) / 2)
        R, k = np.full_like(rim, np.inf), np.zeros_like(rim)
        count = max(self.family.terms - 1, 0)
        slopes = np.concatenate([y[:, :count], rim], axis=1)[:, : self.family.terms]
        if self.family.has_conic:
            k = y[:, self.names.index("conic"), None]
            if (
                not self.family.terms
            ):  # pure conic, whose vertex radius follows from the slope at the rim
                return slopes[:, :0], np.sqrt(1 / rim**2 + 1 + k), k
            R = 1 / y[:, self.names.index("curvature"), None]
            slopes = slopes - conic_profile(self.family.slope_places(), R, k)[1]
        return slopes @ self._from_slopes.T, R, k

    def _profile(self, y: Array, g: Given, u: Array, basis: Basis) -> tuple[Array, ...]:
        """Return sag/M, slope and curvature times M (b, k)."""
        coefficients, R, k = self._shapes(y, g)
        parts = tuple(coefficients @ part for part in basis)
        if self.family.has_conic:
            parts = tuple(a + b for a, b in zip(parts, conic_profile(u, R, k), strict=True))
        return parts

    def sags(self, y: Array, g: Given, u: Array) -> Array:
        """Return sag/M (b, k) at fractions u (k,) of the rim radius."""
        return self._profile(y, g, u, self.basis(u))[0]

    def basis(self, u: Array) -> Basis:
        """Return the basis of the family at fractions of the rim radius, ending in 1."""
        return self.family.basis(u)

    def state(self, y: Array, u: Array, basis: Basis) -> State:
        """Return the state of designs y (b, dim) at fractions u (k,) of the rim radius: arrays (b,
        k times the number of object distances), concatenated over object distances.
        """
        with np.errstate(all="ignore"):  # impossible mirrors result in NaN
            return self._state(y, u, basis)

    def _state(self, y: Array, u: Array, basis: Basis) -> State:
        distances = self.problem.distances_mm
        g = self.given(y)
        profile = self._profile(y, g, u, basis)
        z, slope, curvature = (np.tile(part, len(distances)) for part in profile)
        u, near = np.tile(u, len(distances)), np.repeat(1 / np.array(distances), len(u))
        slope_over_x = np.where(u > 0, slope / np.where(u > 0, u, 1.0), curvature) / g.M
        rest = (u * g.M, z * g.M, slope, curvature / g.M, slope_over_x)
        rim = g.M * z[:, -1:]
        reach = rim if self.problem.is_telecentric else self.reach(g)
        if self.tables is not None or self._bending.shell is not None:
            m = self.reach(g) - rim
            aim, walls = (
                aim_of(rest[0], m + rest[1], self.tables),
                walls_of(self._bending, m, rim, g.M),
            )
            o = built_optics(*rest, aim, near, walls)
        elif self.problem.is_telecentric:
            o = telecentric_optics(*rest, near)
        else:
            o = node_optics(*rest, reach - rim, near)
        field = with_size(values_at(o, self.camera(g), g.focus, reach, rim), self, y, g)
        return State(
            field,
            o.omega,
            o.domega_dx * g.M,
            o.cos_incidence,
            self.hidden(field, o.omega),
            self.image(g),
        )

    def hidden(self, field: FieldValues, omega: Array) -> Array:
        """Return the obscuration by the camera at field angles (b, k), in camera radii.

        The chief ray intersects the axis at m + z_v from the lens; its distance from the centre of
        the camera front is sin(Omega) times the axial distance between them.
        """
        camera = self.problem.housing.camera
        if camera is None or self.problem.is_telecentric:
            return np.full(omega.shape, -1.0)
        cosine, radius = np.cos(omega), camera.diameter_mm / 2
        distance = (field.length - field.sag + field.viewpoint_z - camera.height_mm) * np.sin(omega)
        rows = -disc_clearance(distance, cosine, radius) / radius
        return np.where(cosine.real > 0, rows, -1.0)

    def hidden_from(self, omega: Array, hidden: Array) -> Array:
        """Return the obscuration (b, 1) at the angle from which the view must be clear,
        interpolated between nodes.
        """
        low = self.problem.omega_min_deg * DEGREE
        before = np.clip(
            (omega.real[:, : self._count(omega)] <= low).sum(axis=-1, keepdims=True) - 1, 0, None
        )
        nodes = np.concatenate([before, before + 1], axis=-1)
        (a, b), (h, k) = (np.take_along_axis(v, nodes, axis=-1).T for v in (omega, hidden))
        at: Array = h + (low - a) / (b - a) * (k - h)
        return at[:, None]

    def _count(self, omega: Array) -> int:
        """Return the number of field angles of one object distance."""
        return int(omega.shape[-1]) // len(self.problem.distances_mm)

    def counting(
        self, omega: Array, hidden: Array, low_deg: float | None = None, high_deg: float = 180.0
    ) -> NDArray[np.intp]:
        """Return the counted columns (b, n) of field angles (b, n) in radians, concatenated over
        object distances: those in view between two angles (by default from the inner end of the
        required field), and the next one beyond either end.

        The number of columns is constant: the ends are repeated in place of excluded columns.
        """
        n = self._count(omega)
        omega, hidden = omega[:, :n], hidden[:, :n]
        low = (self.problem.omega_min_deg if low_deg is None else low_deg) * DEGREE
        first = (omega <= low).sum(axis=-1, keepdims=True) - 1
        begin = self.problem.omega_min_deg * DEGREE
        if begin == 0 or low < begin:  # otherwise an unobscured view is a constraint
            first = np.maximum(first, np.argmax(hidden <= 0, axis=-1)[:, None])
        first = np.clip(first, 0, n - 1)
        last = np.clip((omega < high_deg * DEGREE).sum(axis=-1, keepdims=True), first, n - 1)
        which = np.clip(np.arange(n), first, last)
        return np.concatenate(
            [which + i * n for i in range(len(self.problem.distances_mm))], axis=-1
        )

    # -- designs and sensors -----------------------------------------------------------------------

    def designs(self, y: Array) -> Designs:
        """Return designs (b, dim) for the batch evaluator, focused for the farthest object."""
        p, y = self.problem, np.atleast_2d(y)
        g = self.given(y)
        coefficients, R, k = self._shapes(y, g)
        sag = self.sags(y, g, np.ones(1))
        M, m, focal, mu = (
            g.M[:, 0],
            (self.reach(g) - g.M * sag)[:, 0],
            g.focal[:, 0],
            np.zeros(len(y)),
        )
        if p.is_telecentric:
            m, focal, mu = np.full_like(mu, np.inf), np.full_like(mu, np.inf), focal
        return Designs(
            self.family,
            coefficients,
            m,
            M,
            focal,
            g.f_number[:, 0],
            p.imager.pixel_pitch_um,
            R[:, 0] * M,
            k[:, 0],
            mu,
            p.mode,
            p.image_radius_px,
            p.wavelength_nm,
            p.distances_mm[-1],
            p.omega_min_deg,
            p.optics,
            self._bending,
        )

    def evaluate(self, y: Array, angles: int) -> BatchEvaluation:
        """Evaluate designs (b, dim) for each object distance, with a common focus."""
        distances = np.array(self.problem.distances_mm)
        u = np.tile(np.linspace(0.0, 1.0, angles), distances.size)
        return evaluate_designs(
            replace(self.designs(y), object_distance_mm=np.repeat(distances, angles)), u
        )

    def field(self, y: Array, result: BatchEvaluation) -> FieldValues:
        """Return field values of designs (b, dim) evaluated at their own focus."""
        g = self.given(y)
        sag = g.M * self.sags(y, g, np.ones(1))
        reach = sag if self.problem.is_telecentric else self.reach(g)
        camera = self.camera(g)
        numbers = (camera.image_distance(g.focus), reach, sag, camera.airy_px(g.focus))
        b0, length, height, airy = (v[:, 0] for v in numbers)
        p = np.repeat(self.problem.distances_mm, self._count(result.h_px))
        if not isinstance(camera, RealCamera):
            light = camera.light(result.h_px / camera.px_per_ray(g.focus))
            return with_size(
                values_of(result, light, b0, length, height, airy, None, p), self, y, g
            )
        u = np.tile(np.linspace(0.0, 1.0, self._count(result.h_px)), len(self.problem.distances_mm))
        z = g.M * self.sags(y, g, u)
        values, q = (
            camera.tables.at(aim_of(u * g.M, reach - sag + z, camera.tables).tangent),
            camera.tables.defocus(g.focus),
        )
        own_t, own_s = (
            focus_powers(own, q) / camera.pitch_mm for own in (values.own_t, values.own_s)
        )
        field = values_of(result, values.light, b0, length, height, airy, (own_t, own_s), p)
        return with_size(field, self, y, g)

    def image(self, g: Given) -> Array:
        """Return the radius of the rim image relative to the largest permitted one (b, 1)."""
        rim_ray = g.M if self.problem.is_telecentric else g.tangent
        height = self.camera(g).height_px(rim_ray, g.focus)
        image: Array = height * (self.problem.imager.pitch_mm / self.imager_radius_mm)
        return image

    def at_best_focus(self, y: Array, angles: int) -> Array:
        """Return the points (b, dim) at the focus of minimum worst floored blur area."""
        if "focus" not in self.names:
            return y
        for _ in range(
            ROUNDS if None in (self.problem.theta_max_deg, self.problem.focal_length_mm) else 1
        ):
            y = self.with_focus(y, self.evaluate(y, angles).focus_mm)
        return y

    def focus_mm(self, y: Array) -> Array:
        """Return the focus distances L0 (b,) of points (b, dim)."""
        v = self.given(y).focus[:, 0]
        if self.problem.is_telecentric:
            return -v
        return 1 / v + (0.0 if self.tables is None else self.tables.pupil_mm)

    def with_focus(self, y: Array, focus_mm: Array) -> Array:
        """Return the points (b, dim) focused at L0 (b,)."""
        i, y = self.names.index("focus"), np.array(y)
        if isinstance(self.problem.focus_mm, tuple):
            y[:, i] = self._place(focus_mm) / self._focus_unit
            y[:, i] = np.clip(y[:, i], *(ends_of[i] for ends_of in self.bounds))
            return y
        for _ in range(
            ROUNDS if self.problem.theta_max_deg is None else 1
        ):  # theta may depend on the focus
            g = self.given(y)
            position = self._place(focus_mm)
            y[:, i] = (
                position / g.M[:, 0]
                if self.problem.is_telecentric
                else (g.M / g.tangent)[:, 0] * position
            )
        return y

    def sensor(self, y: Array, name: str = "design", notes: str = "") -> Sensor:
        """Return a point (dim,) as a sensor at its own focus."""
        sensor = self.designs(y).sensor(
            0, self.problem.imager, float(self.focus_mm(y[None])[0]), name
        )
        return replace(sensor, notes=notes, housing=self.problem.housing)
