"""Custom mappings: a table of field angles and image heights, or a sampled function."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ....base.arguments import WrongKind, coordinates, floats, number, shown
from ....base.errors import InvalidParameter
from ....base.numerics.lazy import cached_property
from ....base.parameters import Parameter
from ....base.typing import Array
from ..base import APEX, RIM_RADIUS, near_apex
from ..measured.columns import MAPPING_FILE
from .base import THETA_MAX, Mapped

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

DEGREE = 5  # quintic in tau, for a smooth curvature of the mirror
MOST_ROWS = 4096


def check_rows(omega_deg: Sequence[float], height: Sequence[float]) -> None:
    """Check the table of a mapping.

    Raises
    ------
    InvalidParameter
        If the columns differ in length, have too few rows, or do not increase from the image
        centre.
    """
    if len(omega_deg) != len(height):
        raise InvalidParameter(
            f"omega_deg has {len(omega_deg)} rows and height {len(height)}; they need the same number"
        )
    if len(omega_deg) <= DEGREE:
        raise InvalidParameter(f"omega_deg has {len(omega_deg)} rows; a table needs at least {DEGREE + 1}")
    if height[0] != 0.0:
        raise InvalidParameter(f"height starts at {height[0]:g}; it must start at the image centre, at 0")
    for name, column in (("omega_deg", omega_deg), ("height", height)):
        if not np.all(np.diff(column) > 0):
            i = int(np.argmin(np.diff(column) > 0))
            raise InvalidParameter(f"{name} does not grow after row {i + 1} ({column[i]:g} then {column[i + 1]:g})")


@dataclass(frozen=True)
class TabulatedMapping(Mapped):
    """Mirror with a tabulated mapping: image heights, in any unit, of increasing field angles.

    A quintic spline interpolates Omega as a function of height. The first height is 0, the image
    centre; the mirror is smooth if the field angle there is 0, and pointed otherwise. The last row
    is the rim.

    Raises
    ------
    InvalidParameter
        If there are too few rows, columns differ in length or do not increase, or the lens cannot
        see the rim.

    Examples
    --------
    >>> omega = np.linspace(0, 120, 41)
    >>> stereographic = TabulatedMapping(tuple(omega), tuple(np.tan(np.radians(omega) / 2)), 12.0, 40.0)
    >>> from omnimirror.optics.mirrors import UnitAspect
    >>> float(abs(stereographic.sag(30.0) - UnitAspect(120.0, 12.0, 40.0).sag(30.0))) < 1e-6
    True
    """

    omega_deg: tuple[float, ...]
    height: tuple[float, ...]
    theta_max_deg: float
    rim_radius_mm: float

    KIND: ClassVar[str] = "tabulated-mapping"
    FILES = (MAPPING_FILE,)
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "omega_deg": Parameter("deg", 0.0, 179.0, "field angles, growing from the image centre to the rim"),
        "height": Parameter("", 0.0, 1e9, "their image heights in any unit, growing from 0"),
        "theta_max_deg": THETA_MAX,
        "rim_radius_mm": RIM_RADIUS,
    }

    def __post_init__(self) -> None:
        self._take_columns(self.omega_deg, self.height)
        self._check_parameters()
        check_rows(self.omega_deg, self.height)
        self._check_reach(self.omega_deg[-1])
        self._check_surface()

    def _take_columns(self, omega_deg: ArrayLike, height: ArrayLike) -> None:
        object.__setattr__(self, "omega_deg", floats("omega_deg", omega_deg))
        object.__setattr__(self, "height", floats("height", height))

    @classmethod
    def sketched(cls, omega_deg: Array, height: Array, theta_max_deg: float, rim_radius_mm: float) -> TabulatedMapping:
        """Create a mirror without the costly check of its surface, for iterations."""
        mirror = object.__new__(cls)
        mirror._take_columns(omega_deg, height)
        object.__setattr__(mirror, "theta_max_deg", theta_max_deg)
        object.__setattr__(mirror, "rim_radius_mm", rim_radius_mm)
        check_rows(mirror.omega_deg, mirror.height)
        mirror._check_reach(mirror.omega_deg[-1])
        return mirror

    def checked(self) -> TabulatedMapping:
        """Return the mirror after the check that its surface extends to the rim."""
        self._check()
        return self

    @classmethod
    def from_function(
        cls,
        height: Callable[[Array], ArrayLike],
        omega_max_deg: float,
        theta_max_deg: float,
        rim_radius_mm: float,
        omega_min_deg: float = 0.0,
        tolerance: float = 1e-11,
    ) -> TabulatedMapping:
        """Create the mirror of a function from field angles (n,) to image heights.

        Rows are added until the spline agrees with the function halfway between rows, within
        ``tolerance`` relative to the height of the rim.

        Raises
        ------
        InvalidParameter
            If the function does not increase from 0 at the centre, or is not smooth enough for 4096
            rows.

        Examples
        --------
        >>> mirror = TabulatedMapping.from_function(lambda omega: np.sin(omega / 2), 135.0, 12.0, 1.0)
        >>> round(mirror.design_distance, 9)
        4.072351768
        """
        if not callable(height):
            raise WrongKind(f"height = {shown(height)} is no function of field angles (n,) in radians")
        low, high = number("omega_min_deg", omega_min_deg), number("omega_max_deg", omega_max_deg)
        tolerance = number("tolerance", tolerance, above=0.0)
        rows = 64
        while True:
            # sinusoidal spacing: denser at the rim, with steeper mappings
            share = np.sin(np.pi / 2 * np.linspace(0.0, 1.0, rows + 1))
            omega = np.radians(low + (high - low) * share)
            between = (omega[1:] + omega[:-1]) / 2
            h, wanted = (coordinates("height(omega)", height(a)) for a in (omega, between))
            if (h.shape, wanted.shape) != (omega.shape, between.shape):
                raise InvalidParameter(
                    f"the mapping function gives heights of shape {h.shape} for {len(omega)} field angles; "
                    f"it is valid with one for each, ({len(omega)},)"
                )
            if not (np.isfinite(h).all() and np.isfinite(wanted).all()):
                raise InvalidParameter("the mapping function gives heights that are not finite in the field")
            mirror = cls(tuple(np.degrees(omega)), tuple(h), theta_max_deg, rim_radius_mm)
            found, rate = mirror.mapping(wanted / h[-1])
            error = float(np.abs((found - between) / rate).max())
            if error <= tolerance:
                return mirror
            rows *= 2
            if rows > MOST_ROWS:
                raise InvalidParameter(
                    f"the mapping function is not smooth: {MOST_ROWS} rows still miss it by {error:.2g} of the rim's "
                    f"height; give it as a table, or a larger tolerance than {tolerance:g}"
                )

    @cached_property
    def _splines(self) -> tuple[BSpline, BSpline]:
        from scipy.interpolate import make_interp_spline

        tau, omega = np.array(self.height) / self.height[-1], np.radians(self.omega_deg)
        if self.omega_deg[0] == 0.0:  # smooth: symmetric continuation across the axis
            tau, omega = np.concatenate([-tau[:0:-1], tau]), np.concatenate([-omega[:0:-1], omega])
        spline = make_interp_spline(tau, omega, k=DEGREE)
        return spline, spline.derivative()

    def mapping(self, tau: ArrayLike) -> tuple[Array, Array]:
        tau = coordinates("tau", tau)
        return self.angles(tau), self.rates(tau)

    def angles(self, tau: Array) -> Array:
        tau = coordinates("tau", tau)
        omega = np.asarray(self._splines[0](tau))
        if self.omega_deg[0] == 0.0 and (np.abs(tau) < APEX).any():
            omega = near_apex(tau, tau * self.rates(tau), omega)
        return omega

    def rates(self, tau: Array) -> Array:
        return np.asarray(self._splines[1](coordinates("tau", tau)))
