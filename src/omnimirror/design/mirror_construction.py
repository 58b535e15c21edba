"""Mirrors from design parameters: conic families, mappings, correction for lens and cover."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.results import Columns, Result, record_of, table_of
from ..base.typing import Array
from ..optics.housing import Housing, Tube
from ..optics.lenses import Lens
from ..optics.mirrors import (
    Cone,
    Conformal,
    CylinderMapping,
    Ellipsoid,
    Hyperboloid,
    Mirror,
    Paraboloid,
    Sphere,
    TabulatedMapping,
)
from ..optics.mirrors.mappings import MAPPINGS, conformal_conic
from ..optics.mirrors.prescribed_mapping import MappingMirror
from ..optics.tracing.meridian import ChiefRays, Cover, trace_chief_rays
from ..optics.tracing.obscuration import Obstructions, cover_of

# -- Rim ray and mounted mirror, the input and output of all construction methods ------------------


@dataclass(frozen=True)
class RimRay:
    """Requirements on the rim: field angle, viewing angle of the lens, and rim radius.

    ``theta_max_deg`` is 0 for an orthographic lens.

    >>> RimRay(135.0, 12.0, 43.9).slope_angle_deg
    61.5
    """

    omega_max_deg: float
    theta_max_deg: float
    rim_radius_mm: float

    def __post_init__(self) -> None:
        theta, omega = self.theta_max_deg, self.omega_max_deg
        if not 0 <= theta < 90:
            raise InvalidParameter(
                f"theta_max_deg must be at least 0 and less than 90 deg; got {theta:g}"
            )
        if not theta < omega < 180 - theta:
            raise InvalidParameter(
                f"omega_max_deg must be between {theta:g} and {180 - theta:g} deg for "
                f"theta_max_deg = {theta:g}; got {omega:g}"
            )
        if not self.rim_radius_mm > 0:
            raise InvalidParameter(
                f"rim_radius_mm must be greater than 0; got {self.rim_radius_mm:g}"
            )

    @property
    def slope_angle_deg(self) -> float:
        """Slope angle beta of the mirror at its rim (Eqs. 2-5)."""
        return (self.omega_max_deg - self.theta_max_deg) / 2

    @property
    def slope(self) -> float:
        """Slope dz/dx of the mirror at its rim."""
        return float(np.tan(np.radians(self.slope_angle_deg)))

    def distance_mm(self, rim_sag_mm: float) -> float:
        """Return the lens distance from the vertex, mm; infinite for an orthographic lens."""
        if self.theta_max_deg == 0:
            return float("inf")
        return self.rim_radius_mm / float(np.tan(np.radians(self.theta_max_deg))) - rim_sag_mm

    def place(self, mirror: Mirror, notes: tuple[str, ...] = ()) -> MountedMirror:
        """Return the mirror at the distance that gives the rim the viewing angle Theta."""
        return MountedMirror(
            mirror, self.distance_mm(float(mirror.sag(mirror.rim_radius_mm))), notes
        )


@dataclass(frozen=True)
class MountedMirror(Result):
    """Mirror with its lens distance from the vertex (mm; infinite if orthographic) and notes."""

    mirror: Mirror
    distance_mm: float
    notes: tuple[str, ...] = ()

    def _table(self) -> Columns:
        return table_of([{"mirror": self.mirror.KIND, **record_of(self)}])


# -- Mirror families in closed form, for given field, viewing angle and rim radius -----------------
#
# The closed forms replace the trial and error of the paper. A conic of vertex radius R and conic
# constant k has the slope ``tan(beta)`` at x = M for
#
#     R = M sqrt(cot(beta)^2 + 1 + k),   beta = (Omega_max - Theta)/2
#
# (Eqs. 2-5 at the rim). The lens distance follows from the viewing angle Theta of the rim, ``m =
# M/tan(Theta) - z(M)``.


def vertex_radius(rim: RimRay, conic: float) -> float:
    """Return the vertex radius R (mm) of the conic with the required slope at the rim.

    Raises
    ------
    InvalidParameter
        If the conic constant of a hyperboloid cannot reach the slope.

    Examples
    --------
    Sphere of Table 1, A = 1.138 M:

    >>> round(vertex_radius(RimRay(135.0, 12.0, 1.0), conic=0.0), 3)
    1.138
    """
    # Slope of a conic: z'(x) = x / sqrt(R^2 - (1 + k) x^2). Setting z'(M) = tan(beta) (Eqs. 2-5)
    # gives (R/M)^2 = cot(beta)^2 + 1 + k.
    square = 1 / rim.slope**2 + 1 + conic
    if square <= 0:
        raise InvalidParameter(
            f"conic must be greater than {-1 - 1 / rim.slope**2:.6g} for the slope of the "
            f"rim, {rim.slope_angle_deg:.4g} deg; got {conic:g}"
        )
    return rim.rim_radius_mm * float(np.sqrt(square))


def sphere(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the sphere ``A = M / sin(beta)``; it has no free parameter.

    >>> mounted = sphere(RimRay(135.0, 12.0, 1.0))
    >>> round(mounted.mirror.radius_mm, 3), round(mounted.distance_mm, 3)  # Table 1
    (1.138, 4.11)
    """
    _refuse_conic("sphere", conic)
    return rim.place(Sphere(vertex_radius(rim, 0.0), rim.rim_radius_mm))


def paraboloid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the paraboloid ``s = M / tan(beta)``; it has no free parameter. With an orthographic
    lens it has a single viewpoint.
    """
    _refuse_conic("paraboloid", conic)
    return rim.place(Paraboloid(vertex_radius(rim, -1.0), rim.rim_radius_mm))


def hyperboloid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the hyperboloid of a given conic constant k < -1, or with a single viewpoint.

    >>> mounted = hyperboloid(RimRay(135.0, 12.0, 1.0))
    >>> round(mounted.mirror.a_mm, 4), round(mounted.mirror.b_mm, 3), round(mounted.distance_mm, 3)  # Table 1
    (0.7407, 1.698, 3.55)
    """
    M = rim.rim_radius_mm
    if conic is None:
        if rim.theta_max_deg == 0:
            raise InvalidParameter(
                "a hyperboloid has no single viewpoint with an orthographic lens; use a "
                "paraboloid, or specify conic below -1"
            )
        mirror = conformal_conic(np.radians(rim.omega_max_deg), np.radians(rim.theta_max_deg), M)
        return rim.place(mirror, (f"conic = {mirror.conic:.6g}, chosen for a single viewpoint",))
    if conic >= -1:
        raise InvalidParameter(f"conic of a hyperboloid must be less than -1; got {conic:g}")
    R, ratio = vertex_radius(rim, conic), np.sqrt(-1 - conic)  # A/B
    return rim.place(Hyperboloid(float(R / ratio), float(R / ratio**2), M))


def ellipsoid(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the ellipsoid with a given conic constant k > -1: prolate below 0, oblate above 0."""
    if conic is None:
        raise InvalidParameter("an ellipsoid requires conic, greater than -1 (0 for a sphere)")
    if conic <= -1:
        raise InvalidParameter(f"conic of an ellipsoid must be greater than -1; got {conic:g}")
    R, ratio = vertex_radius(rim, conic), np.sqrt(1 + conic)  # A/B
    return rim.place(Ellipsoid(float(R / ratio), float(R / ratio**2), rim.rim_radius_mm))


def cone(rim: RimRay, conic: float | None = None) -> MountedMirror:
    """Return the cone of constant slope beta, with a field from Omega_max - Theta to Omega_max."""
    _refuse_conic("cone", conic)
    if rim.theta_max_deg == 0:
        raise InvalidParameter(
            "a cone with an orthographic lens images a single field angle; specify theta_max_deg above 0"
        )
    low = rim.omega_max_deg - rim.theta_max_deg
    return rim.place(
        Cone(rim.slope_angle_deg, rim.rim_radius_mm),
        (f"field of the cone: {low:g} to {rim.omega_max_deg:g} deg",),
    )


def _refuse_conic(family: str, conic: float | None) -> None:
    if conic is not None:
        raise InvalidParameter(f"conic must be omitted for a {family}; got {conic:g}")


FAMILIES: dict[str, Callable[[RimRay, float | None], MountedMirror]] = {
    "sphere": sphere,
    "hyperboloid": hyperboloid,
    "paraboloid": paraboloid,
    "ellipsoid": ellipsoid,
    "cone": cone,
}
"""Mirror families by name: functions of the rim and of the conic constant, if it is free."""


# -- Mirrors for a required mapping, given by name, function or table ------------------------------

OF_FIELD = ("omega_max_deg", "theta_max_deg", "rim_radius_mm")


def generated_mirror(
    mapping: str | Callable[[NDArray[np.float64]], ArrayLike],
    rim: RimRay,
    omega_min_deg: float = 0.0,
    **entries: object,
) -> MountedMirror:
    """Return the mirror with an exact mapping, and its lens distance.

    Parameters
    ----------
    mapping
        Key of :data:`MAPPINGS`, or a function of field angles (n,) in radians that returns image
        heights in any unit, 0 at ``omega_min_deg``.
    omega_min_deg
        Field angle at the image centre; values above 0 give a pointed mirror.
    entries
        Additional parameters of the mapping: ``plane_distance_mm`` of a ground plane,
        ``cylinder_radius_mm`` of a cylinder, ``omega_deg`` and ``height`` of a table.

    Raises
    ------
    InvalidParameter
        If the mapping is unknown, an entry is missing or inapplicable, or the field is beyond the
        range of the mapping.

    Examples
    --------
    The mirror of the conformal mapping is a hyperboloid, a conic:

    >>> mounted = generated_mirror("conformal", RimRay(135.0, 12.0, 1.0))
    >>> mounted.mirror.KIND, round(mounted.distance_mm, 11)
    ('hyperboloid', 3.55007544592)
    >>> import numpy as np
    >>> mounted = generated_mirror(lambda omega: np.sin(omega / 2), RimRay(135.0, 12.0, 1.0))  # equiareal
    >>> round(mounted.distance_mm, 9)
    4.072351768
    """
    if callable(mapping):
        tabulated = TabulatedMapping.from_function(
            mapping, rim.omega_max_deg, rim.theta_max_deg, rim.rim_radius_mm, omega_min_deg
        )
        return MountedMirror(tabulated, tabulated.design_distance)
    mirror = mapped_mirror(mapping, rim, omega_min_deg, **entries)
    if isinstance(mirror, Conformal):
        return MountedMirror(mirror.surface, mirror.design_distance)
    return MountedMirror(mirror, mirror.design_distance)


def mapped_mirror(
    mapping: str, rim: RimRay, omega_min_deg: float = 0.0, **entries: object
) -> MappingMirror:
    """Return the mirror of a named mapping, which converts image heights to field angles; arguments
    as :func:`generated_mirror`.
    """
    if mapping not in MAPPINGS:
        raise InvalidParameter(f"mapping must be one of {', '.join(MAPPINGS)}; got {mapping!r}")
    cls = MAPPINGS[mapping]
    parameters = {name: getattr(rim, name) for name in OF_FIELD if name in cls.PARAMETERS} | entries
    if omega_min_deg > 0 and cls is not TabulatedMapping:
        parameters["omega_min_deg"] = omega_min_deg
    check_entries(mapping, parameters)
    mirror: MappingMirror = cls(**parameters)
    if (
        isinstance(mirror, TabulatedMapping)
        and abs(mirror.omega_deg[-1] - rim.omega_max_deg) > 1e-9
    ):
        raise InvalidParameter(
            "omega_max_deg must be the last angle of the mapping table, "
            f"{mirror.omega_deg[-1]:g} deg; got {rim.omega_max_deg:g}"
        )
    return mirror


def check_entries(mapping: str, specified: Collection[str]) -> None:
    """Check the entries of a mapping for inapplicable and missing ones.

    Raises
    ------
    InvalidParameter
        If an entry is inapplicable or missing; the message contains its name.
    """
    cls = MAPPINGS[mapping]
    entries = (
        (*cls.PARAMETERS, "omega_min_deg") if cls is TabulatedMapping else cls.PARAMETERS
    )  # start of its table
    if wrong := [name for name in specified if name not in entries]:
        raise InvalidParameter(
            f"{wrong[0]} must be omitted for the {mapping} mapping{_instead(wrong[0])}"
        )
    if missing := [name for name in _needed(cls) if name not in (*specified, *OF_FIELD)]:
        raise InvalidParameter(f"the {mapping} mapping requires {' and '.join(missing)}")


def _needed(cls: type[Mirror]) -> list[str]:
    """Return the parameters without a default."""
    return [name for name in cls.PARAMETERS if name != "omega_min_deg" or cls is CylinderMapping]


def _instead(name: str) -> str:
    """Return advice on an inapplicable entry of a mapping."""
    if name != "omega_min_deg":
        return f"; it applies to {' and '.join(kind for kind, cls in MAPPINGS.items() if name in cls.PARAMETERS)}"
    pointed = [kind for kind, cls in MAPPINGS.items() if name in cls.PARAMETERS]
    return (
        f", whose field starts on the axis; pointed mirrors are possible for {', '.join(pointed)}"
    )


# -- Comparison of all mappings: the mirror of each for one field and lens -------------------------


@validate_arguments
def mappings(
    omega_max_deg: float = 75.0, theta_max_deg: float = 12.0
) -> dict[str, MountedMirror | OmnimirrorError]:
    """Compute the mirror of each mapping for a field and a lens, with lengths in rim radii.

    Used by ``omnimirror mappings``. The mirrors follow from the law of reflection, dz/dx =
    tan((Omega - theta)/2), with the Omega(theta) of the mapping.

    Parameters
    ----------
    omega_max_deg
        Field angle at the rim, deg.
    theta_max_deg
        Viewing angle of the lens at the rim, deg; 0 for an orthographic lens.

    Returns
    -------
    dict
        Mirror and lens distance by name of the mapping, or the error that prevents its
        construction.

    Raises
    ------
    InvalidParameter
        If the combination of angles is invalid.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.mappings(120.0)
    >>> print(f"{found['equidistant'].distance_mm:.3f} rim radii")
    4.090 rim radii
    >>> print(found["rectifying"])
    omega_max_deg must be less than 90 deg for the rectifying mapping; got 120
    """
    rim = RimRay(omega_max_deg, theta_max_deg, 1.0)
    mirrors: dict[str, MountedMirror | OmnimirrorError] = {}
    for name in MAPPINGS:
        try:
            mirrors[name] = generated_mirror(name, rim)
        except OmnimirrorError as e:
            mirrors[name] = e
    return mirrors


# -- Mirrors corrected for the real lens and cover: pupil aberration, distortion and refraction ----
#
# A mirror of a family is designed for the field angle inside the cover that refraction converts to
# the requested angle. For a mirror of a mapping, the mapping is corrected for lens and cover: the
# field angle of selected mirror points is compared with the nominal angle at their image height, and
# the angle inside is corrected iteratively.

NODES = 65  # mirror points of the mapping correction
STEPS = 12
CLOSE = 1e-10  # radians
ENDS_STEPS = 25  # maximum iterations for a pointed mirror behind a cover
MIN_CENTRE_DEG, MAX_STEP_DEG = 1.0, 10.0  # smallest inner field angle at the centre, largest step


@dataclass(frozen=True)
class LensAndCover:
    """Focused lens and housing of the mirror."""

    lens: Lens
    housing: Housing

    @property
    def are_ideal(self) -> bool:
        """True if the camera is an ideal pinhole without a cover."""
        return self.lens.IS_THIN and self.housing.shell is None

    @property
    def keep_mapping(self) -> bool:
        """True if all field angles of a mapping can be reached; a tube with another outer
        medium excludes those near the axis.
        """
        shell = self.housing.shell
        return not (isinstance(shell, Tube) and shell.outer_index != 1.0)

    def mounted(self, initial: MountedMirror, theta_max_deg: float) -> MountedMirror:
        """Return a mirror designed for a pinhole, at the lens distance of equal viewing angle."""
        position = float(self.lens.pupil.position(np.array([np.tan(np.radians(theta_max_deg))]))[0])
        return MountedMirror(initial.mirror, initial.distance_mm + position, initial.notes)

    def rays(self, mounted: MountedMirror, x: Array) -> ChiefRays:
        """Trace the chief rays (n,) of mirror points to the outside; not finite if blocked."""
        return self._tracer(mounted)(x)

    def _cover(self, mounted: MountedMirror) -> Cover | None:
        """Return the cover around a mirror; None without one."""
        if self.housing.shell is None:
            return None
        return cover_of(Obstructions.of(self.housing, mounted.mirror, None, mounted.distance_mm))

    def _tracer(self, mounted: MountedMirror) -> Callable[[Array], ChiefRays]:
        """Return the function that traces chief rays (n,) from one mirror to the outside."""
        with np.errstate(all="ignore"):
            cover = self._cover(mounted)

        def trace(x: Array) -> ChiefRays:
            with np.errstate(all="ignore"):
                rays = trace_chief_rays(mounted.mirror, mounted.distance_mm, x, self.lens.pupil)
                return rays if cover is None else cover.refracted(rays)

        return trace

    def heights(self, rays: ChiefRays) -> Array:
        """Return image heights (n,) relative to that of the last ray."""
        h = self.lens.image_height(rays.x, rays.w)
        relative_height: Array = h / h[-1]
        return relative_height

    def made_for_rim(self, make: Callable[[RimRay], MountedMirror], rim: RimRay) -> MountedMirror:
        """Return the mirror with the requested field angle at the rim outside the cover."""
        inside = rim.omega_max_deg
        for _ in range(STEPS):
            own = RimRay(inside, rim.theta_max_deg, rim.rim_radius_mm)
            mounted = self.mounted(make(own), rim.theta_max_deg)
            if self.housing.shell is None:
                return mounted
            rays = self.rays(mounted, np.array([rim.rim_radius_mm]))
            missed = rim.omega_max_deg - float(np.degrees(rays.omega[0]))
            _check_out(missed, rim, self.housing)
            if abs(missed) < np.degrees(CLOSE):
                return mounted
            inside += missed * float(_inside_rate(rays)[0])
        return mounted

    def made_for_ends(
        self, make: Callable[[RimRay, float], MountedMirror], rim: RimRay, low_deg: float
    ) -> MountedMirror:
        """Return the pointed mirror with a field from ``low_deg`` outside the cover.

        Parameters
        ----------
        make
            Function of the rim and of the field angle at the centre, both inside the cover, that
            returns a mirror.
        low_deg
            Smallest field angle outside, deg: at the centre or, if the base of a tube blocks the
            rays of the centre, at the first mirror point with rays through the wall. An angle
            excluded by refraction is approached as closely as possible.
        """
        target = np.array([low_deg, rim.omega_max_deg])
        shell = self.housing.shell
        index = 1.0 if shell is None else shell.outer_index
        # Snell's law at parallel walls is exact for a tube and the initial value for a dome.
        cosines = np.clip(
            index * np.cos(np.radians(target)), -1.0, np.cos(np.radians(MIN_CENTRE_DEG))
        )
        inside, before = np.degrees(np.arccos(cosines)), None
        for _ in range(ENDS_STEPS):
            own = RimRay(float(inside[1]), rim.theta_max_deg, rim.rim_radius_mm)
            mounted = self.mounted(make(own, float(inside[0])), rim.theta_max_deg)
            missed, rate = self._missed_at_ends(mounted, target)
            _check_out(float(np.abs(missed).max()), rim, self.housing)
            if np.abs(missed).max() < np.degrees(CLOSE):
                break
            step = missed * rate
            # The first point with rays through the wall depends on the angle at the centre; a
            # secant step accounts for this.
            if before is not None and (change := missed[0] - before[1]):
                step[0] = float(
                    np.clip(
                        -missed[0] * (inside[0] - before[0]) / change, -MAX_STEP_DEG, MAX_STEP_DEG
                    )
                )
            before = inside[0], missed[0]
            inside = inside + step
            is_settled = (
                abs(missed[1]) < np.degrees(CLOSE)
                and before[0] == MIN_CENTRE_DEG
                and inside[0] <= before[0]
            )
            if is_settled:  # the angle cannot be reached
                break
            inside[0] = np.clip(inside[0], MIN_CENTRE_DEG, inside[1] - MIN_CENTRE_DEG)
        return mounted

    def _missed_at_ends(self, mounted: MountedMirror, target_deg: Array) -> tuple[Array, Array]:
        """Return field angle errors at both ends of the field, deg, and d(inside)/d(outside)."""
        begin, rim, cover, trace = (
            0.0,
            mounted.mirror.rim_radius_mm,
            self._cover(mounted),
            self._tracer(mounted),
        )
        if cover is not None:
            begin = cover.first_visible_x(trace, 0.0, rim)
        rays = trace(np.array([begin, rim]))
        return target_deg - np.degrees(rays.omega), _inside_rate(rays)

    def made_for_mapping(self, exact: MappingMirror, rim: RimRay) -> MountedMirror:
        """Return the mirror that has a given mapping with lens and cover.

        Raises
        ------
        InvalidParameter
            If the cover blocks the rays.
        """
        x = rim.rim_radius_mm * np.linspace(0.0, 1.0, NODES)
        mirror: MappingMirror = exact
        inside: Array | None = None
        for _ in range(STEPS):
            mounted = MountedMirror(mirror, mirror.design_distance)
            tau = (
                x
                if rim.theta_max_deg == 0
                else x / (mounted.distance_mm + np.asarray(mirror.sag(x)))
            )
            tau = tau / tau[-1]
            inside = mirror.mapping(tau)[0]
            corrected = self.mounted(mounted, rim.theta_max_deg)
            rays = self.rays(corrected, x)
            missed = exact.mapping(self.heights(rays))[0] - rays.omega
            _check_out(float(np.abs(missed).max()), rim, self.housing)
            if np.abs(missed).max() < CLOSE:
                break
            target = np.degrees(inside + missed * _inside_rate(rays))
            mirror = TabulatedMapping.unchecked(target, tau, rim.theta_max_deg, rim.rim_radius_mm)
        if isinstance(corrected.mirror, TabulatedMapping):
            corrected.mirror.checked()
        return corrected


def _inside_rate(rays: ChiefRays) -> Array:
    """Return the derivative (n,) of the angle inside a cover with respect to the angle outside."""
    return rays.dreflected_dx() / rays.domega_dx()


def _check_out(missed: float, rim: RimRay, housing: Housing) -> None:
    if not np.isfinite(missed):
        kind = "cover" if housing.shell is None else housing.shell.KIND
        raise InvalidParameter(
            f"the {kind} must transmit the rays up to omega_max_deg = "
            f"{rim.omega_max_deg:g}; use a smaller field, or a larger diameter or thinner "
            "wall"
        )


def departure(
    lens_and_cover: LensAndCover, mounted: MountedMirror, exact: MappingMirror, angles: int
) -> float:
    """Return the largest deviation of the image height from a mapping, in rim heights."""
    x = mounted.mirror.rim_radius_mm * np.linspace(0.0, 1.0, angles)
    rays = lens_and_cover.rays(mounted, x)
    tau = lens_and_cover.heights(rays)
    target, rate = exact.mapping(tau)
    visible = np.isfinite(rays.omega) & (rate > 0)
    return float(np.abs((rays.omega - target) / np.where(rate > 0, rate, 1.0))[visible].max())
