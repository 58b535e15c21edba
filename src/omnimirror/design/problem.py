"""What is given and what is free when a mirror is optimised, and the space of designs that this leaves.

The field, the rim radius and the viewing angle at the rim are kept exactly by every design of the space:
the slope at the rim is ``tan((Omega_max - Theta)/2)`` and the lens stands at ``M/tan(Theta) - z(M)``.
What is left to choose are the slopes at some places between axis and rim, and what was given as a range.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..imagers import Imager
from ..lenses import BlurMode
from ..mirrors.conics import conic_profile
from ..sensor import Sensor
from .batch import Designs
from .freeform import Basis, Family, family
from .merits import Field
from .optics import DEGREE, Camera, NodeOptics, node_optics

Array = NDArray[Any]
STEP = 1e-30
"""The imaginary step; nothing is subtracted, so it may be as small as one likes."""

Range = float | tuple[float, float]


@dataclass(frozen=True)
class DesignProblem:
    """Field, size, lens and pixels of the sensors to choose from; ranges are left to the optimiser.

    Parameters
    ----------
    omega_max_deg, rim_radius_mm
        Field angle at the rim, and its radius M.
    theta_max_deg, f_number
        Viewing angle of the lens at the rim (which sets the distance m) and F-number: a number, or a range
        (low, high) to choose from.
    omega_min_deg
        Where the field begins that merits look at; what lies inside is taken up by the camera itself.
    mode, image_radius_px, wavelength_nm, object_distance_mm
        As :func:`omnimirror.evaluate` takes them.
    sag_max_mm, length_max_mm
        The highest sag of the rim, and the longest way from imager to rim.
    family, terms
        Kind of mirror, and how many numbers shape it.

    Raises
    ------
    InvalidParameter
        Numbers that no mirror can have, and empty ranges.
    """

    omega_max_deg: float = 135.0
    theta_max_deg: Range = 12.0
    rim_radius_mm: float = 43.9
    focal_length_mm: float = 11.6
    f_number: Range = 4.0
    imager: Imager = field(default_factory=lambda: Imager(1024, 1024, 5.2))
    omega_min_deg: float = 0.0
    object_distance_mm: float = np.inf
    mode: BlurMode = "exact"
    image_radius_px: float | None = None
    wavelength_nm: float = 550.0
    sag_max_mm: float = np.inf
    length_max_mm: float = np.inf
    family: str = "slope-spline"
    terms: int = 12

    def __post_init__(self) -> None:
        for name in ("theta_max_deg", "f_number"):
            low, high = ends(getattr(self, name))
            if not 0 < low <= high:
                raise InvalidParameter(f"{name} = {low:g} to {high:g} is no range; it needs 0 < low <= high")
        for name in ("rim_radius_mm", "focal_length_mm", "object_distance_mm", "sag_max_mm", "length_max_mm"):
            if not getattr(self, name) > 0:
                raise InvalidParameter(f"{name} = {getattr(self, name):g} is not valid; it must be above 0")
        most = ends(self.theta_max_deg)[1]
        if not most < self.omega_max_deg < 180 - most:
            raise InvalidParameter(
                f"omega_max_deg = {self.omega_max_deg:g} cannot be reached with theta_max_deg = {most:g}; it is "
                f"valid between {most:g} and {180 - most:g}, where the rim would be seen edge-on"
            )
        if not 0 <= self.omega_min_deg < self.omega_max_deg:
            raise InvalidParameter(
                f"omega_min_deg = {self.omega_min_deg:g} is not valid from 0 to below {self.omega_max_deg:g}"
            )
        family(self.family, self.terms)


def ends(value: Range) -> tuple[float, float]:
    """Low and high end of a range; a number is both.

    >>> ends(12.0), ends((8, 12))
    ((12.0, 12.0), (8.0, 12.0))
    """
    low, high = value if isinstance(value, tuple) else (value, value)
    return float(low), float(high)


class State(NamedTuple):
    """Designs (b, 1) and what their mirror points do (b, k); complex while derivatives are taken."""

    field: Field
    omega: Array
    turning: Array
    """dOmega/du, radians; above 0 where the mapping is one to one."""
    facing: Array
    """w - x z' over M; above 0 where the lens sees the front."""
    sag: Array
    """Sag of the rim, mm (b, 1)."""


@dataclass(frozen=True)
class DesignSpace:
    """The designs of a problem as points y (dim,), whose steps of .1 are all of one size.

    The coordinates: slopes at all of the family's places but the rim; curvature (times M) and conic constant of a
    conic; the vergence 1/L0 of the focus, times M/tan(Theta); and the logarithms of Theta and of the F-number
    where they are free.
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
        """What each coordinate is."""
        p = self.problem
        conic = ["curvature", "conic"] if self.family.has_conic else []
        free = [n for n in ("theta_max_deg", "f_number") if ends(getattr(p, n))[0] < ends(getattr(p, n))[1]]
        return [*(f"slope {u:.4f}" for u in self.family.slope_places()[:-1]), *conic, "focus", *free]

    @property
    def dim(self) -> int:
        return len(self.names)

    @cached_property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest value of each coordinate, (dim,)."""
        low, high = np.full(self.dim, -np.inf), np.full(self.dim, np.inf)
        low[: self.family.terms - 1] = 0.0
        for name, ends_of in (("curvature", (1e-3, 10.0)), ("conic", (-20.0, 20.0)), ("focus", (0.05, 3.0))):
            if name in self.names:
                low[self.names.index(name)], high[self.names.index(name)] = ends_of
        for name in ("theta_max_deg", "f_number"):
            if name in self.names:
                low[self.names.index(name)], high[self.names.index(name)] = np.log(ends(getattr(self.problem, name)))
        return low, high

    def _free(self, y: Array, name: str) -> Array:
        """Theta or F of designs (b, dim), (b, 1)."""
        if name in self.names:
            return np.exp(y[:, self.names.index(name), None])
        return np.full((len(y), 1), ends(getattr(self.problem, name))[0], dtype=y.dtype)

    def _shapes(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """Coefficients (b, terms), tan(Theta) (b, 1), vertex radius over M and conic constant (b, 1)."""
        theta = self._free(y, "theta_max_deg") * DEGREE
        rim = np.tan((self.problem.omega_max_deg * DEGREE - theta) / 2)
        slopes = np.concatenate([y[:, : self.family.terms - 1], rim], axis=1)
        R, k = np.full_like(rim, np.inf), np.zeros_like(rim)
        if self.family.has_conic:
            i = self.family.terms - 1
            R, k = 1 / y[:, i : i + 1], y[:, i + 1 : i + 2]
            slopes = slopes - conic_profile(self.family.slope_places(), R, k)[1]
        return slopes @ self._from_slopes.T, np.tan(theta), R, k

    def _profile(self, y: Array, u: Array, basis: Basis) -> tuple[Array, ...]:
        """Sag/M, slope and curvature times M (b, k), tan(Theta) (b, 1)."""
        coefficients, tangent, R, k = self._shapes(y)
        parts = tuple(coefficients @ part for part in basis)
        if self.family.has_conic:
            parts = tuple(a + b for a, b in zip(parts, conic_profile(u, R, k), strict=True))
        return (*parts, tangent)

    def basis(self, u: Array) -> Basis:
        """The family's terms at fractions of the rim radius; the last has to be 1, the rim."""
        return self.family.basis(u)

    def state(self, y: Array, u: Array, basis: Basis) -> State:
        """What the designs y (b, dim) do at fractions u (k,) of their rim radius."""
        with np.errstate(all="ignore"):  # what no mirror can do comes out as NaN
            return self._state(y, u, basis)

    def _state(self, y: Array, u: Array, basis: Basis) -> State:
        p = self.problem
        M = p.rim_radius_mm
        z, slope, curvature, tangent = self._profile(y, u, basis)
        m = M * (1 / tangent - z[:, -1:])
        slope_over_x = np.where(u > 0, slope / np.where(u > 0, u, 1.0), curvature) / M
        o = node_optics(u * M, z * M, slope, curvature / M, slope_over_x, m, 1 / p.object_distance_mm)
        camera = Camera(
            p.focal_length_mm, self._free(y, "f_number"), tangent, p.imager.pitch_mm, p.mode, p.image_radius_px,
            p.wavelength_nm,
        )  # fmt: skip
        v = y[:, self.names.index("focus"), None] * tangent / M
        length = camera.image_distance(v) + m + M * z[:, -1:]
        return State(self._field(o, camera, v, length, u), o.omega, o.turning * M, o.facing / M, M * z[:, -1:])

    def _field(self, o: NodeOptics, camera: Camera, v: Array, length: Array, u: Array) -> Field:
        tangent_px, blur_px = camera.px_per_tangent(v), camera.px_per_vergence(v)
        dh, dw = o.radial * tangent_px * DEGREE, o.around * tangent_px * DEGREE
        t, s = blur_px * (v - o.near_t), blur_px * (v - o.near_s)
        floor = 1 + camera.airy_px(v) ** 2
        log_density = np.log(dh * dw)
        width = np.gradient(u)
        width[[0, -1]] /= 2
        share = o.tangent / o.around * o.turning * width  # sin(Omega) dOmega
        return Field(
            t / dh, s / dw, np.log((t * t + floor) * (s * s + floor)) / 2 - log_density, log_density,
            np.log(dw / dh), o.viewpoint_z, length, share,
        )  # fmt: skip

    def derivatives(self, y: Array, u: Array, basis: Basis) -> State:
        """The state of one design y (dim,) and, as imaginary part over :data:`STEP`, its derivative by coordinate i
        in row i: complex steps, exact to rounding."""
        return self.state(y + 1j * STEP * np.eye(self.dim), u, basis)

    def designs(self, y: Array) -> Designs:
        """Designs (b, dim) for the batch evaluator, which finds their focus itself."""
        p, y = self.problem, np.atleast_2d(y)
        coefficients, tangent, R, k = self._shapes(y)
        sag = self._profile(y, np.ones(1), self.basis(np.ones(1)))[0]
        M, m = p.rim_radius_mm, p.rim_radius_mm * (1 / tangent - sag)
        return Designs(
            self.family, coefficients, m[:, 0], M, p.focal_length_mm, self._free(y, "f_number")[:, 0],
            p.imager.pixel_pitch_um, R[:, 0] * M, k[:, 0], p.mode, p.image_radius_px, p.wavelength_nm,
            p.object_distance_mm, p.omega_min_deg,
        )  # fmt: skip

    def rim_distance_mm(self, y: Array) -> Array:
        """From the lens to the rim along the axis, of designs (b, dim), (b,) mm."""
        distance: Array = self.problem.rim_radius_mm / self._shapes(y)[1][:, 0]
        return distance

    def focus_mm(self, y: Array) -> float:
        """The object distance L0 that a point (dim,) is focused at."""
        return float(self.rim_distance_mm(y[None])[0] / y[self.names.index("focus")])

    def with_focus(self, y: Array, focus_mm: float) -> Array:
        """The same point (dim,) focused elsewhere."""
        y = np.array(y)
        y[self.names.index("focus")] *= self.focus_mm(y) / focus_mm
        return y

    def sensor(self, y: Array, name: str = "design", notes: str = "") -> Sensor:
        """A point (dim,) as an ordinary sensor, focused as it says."""
        sensor = self.designs(y).sensor(0, self.problem.imager, self.focus_mm(y), name)
        return replace(sensor, notes=notes)
