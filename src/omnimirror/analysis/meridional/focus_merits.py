"""Merits of the best focus, and their dependence on the focus.

On the coordinate v of linear blur (1/L0; for a telecentric lens L0), a field angle with images at
v_t and v_s has the blurs ``s w_t (v - v_t)`` and ``s w_s (v - v_s)``, where w is the magnification
by lens distortion, and one degree of the object has the image size ``g Dh`` by ``g Dw``; s, g and
the Airy disk depend on v alone. Therefore the square of each merit is a sum of a few functions of
v, common to all field angles, with focus-independent coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from .imaging import ImagingCharacteristics


@dataclass(frozen=True)
class FocusedBlur:
    """Blur at n field angles for one focus.

    Attributes
    ----------
    t_px, s_px : (n,) px
        Signed tangential and sagittal blur diameters.
    imaging
        Image-forming characteristics for the conversion of pixels to degrees.
    omega : (n,) radians
    airy_px
        Diameter of the Airy disk.
    own_t_px, own_s_px : (n,) px
        Blur of the lens alone.
    """

    t_px: Array
    s_px: Array
    imaging: ImagingCharacteristics
    omega: Array
    airy_px: float
    own_t_px: Array | float = 0.0
    own_s_px: Array | float = 0.0

    @property
    def t_deg(self) -> Array:
        """Return the tangential blur (n,) in degrees of the object (Eq. 36)."""
        return self.t_px / self.imaging.height

    @property
    def s_deg(self) -> Array:
        """Return the sagittal blur (n,) in degrees of the object (Eq. 37)."""
        with np.errstate(divide="ignore", invalid="ignore"):  # a degree has no width at the tip of a cone
            return np.where(self.imaging.width == 0.0, np.copysign(np.inf, self.s_px), self.s_px / self.imaging.width)

    def product(self) -> Array:
        """Return the blur area of the paper (n,), deg^2: signed product without pi/4 (Fig. 9c)."""
        with np.errstate(invalid="ignore"):
            area = self.t_deg * self.s_deg
        return np.where(self.imaging.width == 0.0, np.copysign(np.inf, self.t_px * self.s_px), area)

    def floored_area(self) -> Array:
        """Return the blur area (n,), deg^2, with pixel, Airy disk and lens blur in quadrature.

        In contrast to the product of the blurs, it does not vanish with one of its factors.
        """
        # Sum of squares per direction, px^2; division by Ds converts to square degrees (Eq. 11).
        floor = 1 + self.airy_px**2
        with np.errstate(divide="ignore", invalid="ignore"):
            t, s = self.t_px**2 + floor + self.own_t_px**2, self.s_px**2 + floor + self.own_s_px**2
            return np.sqrt(t * s) / self.imaging.area


# -- merits as functions of the focus -------------------------------------------------------------


class Sides(NamedTuple):
    """Focus-independent quantities of n field angles, with lengths along v in units of a range."""

    t: Array
    """Focus coordinates of the tangential images (n,)."""
    s: Array
    w_t: Array
    """Magnification of the tangential blur by distortion (n,)."""
    w_s: Array
    Dh: Array
    """Radial resolution (n,), px per deg, at the scale g = 1."""
    Dw: Array
    own2: tuple[Array, Array] | None = None
    """Squared lens blur (n,), (n,), px^2, nearly independent of the focus; None if ideal."""


class Scales(NamedTuple):
    """Focus-dependent quantities: numbers, or arrays for m focus values."""

    u: Any
    """Focus coordinate."""
    s: Any
    """Blur, px, per unit of defocus."""
    g: Any
    """Image scale."""
    floor: Any
    """Sum of the squares of pixel and Airy disk, px^2."""
    has_own: bool = False
    """True for a lens with a blur of its own."""


@dataclass(frozen=True)
class FocusMerit:
    """Merit that a best focus can minimise over the field."""

    size: Callable[[FocusedBlur], Array]
    """Function that returns the local merit at each field angle (n,)."""
    coefficients: Callable[[Sides], Array]
    """Function that returns the coefficients (terms, k) of its square; k is n or 2 n."""
    functions: Callable[[Scales], list[Any]]
    """Function that returns the corresponding functions of the focus."""
    is_mean: bool = False
    """True for the mean over the solid angle instead of the maximum."""

    def value(self, blur: FocusedBlur) -> float:
        """Return the merit of n field angles."""
        size = self.size(blur)
        return float(size @ solid_angle_shares(blur.omega)) if self.is_mean else float(size.max())


def _square(coordinate: Array, weight: Array) -> Array:
    """Return the coefficients (3, n) of ``weight^2 (u - coordinate)^2`` for u^2, u, 1."""
    return weight**2 * np.stack([np.ones_like(coordinate), -2 * coordinate, coordinate**2])


def _product(x: Array, y: Array) -> Array:
    """Return the coefficients (5, n) of the product of two quadratics (3, n)."""
    return np.stack(
        [
            x[0] * y[0],
            x[0] * y[1] + x[1] * y[0],
            x[0] * y[2] + x[1] * y[1] + x[2] * y[0],
            x[1] * y[2] + x[2] * y[1],
            x[2] * y[2],
        ]
    )


def _product_area(c: Sides) -> Array:
    return _product(_square(c.t, c.w_t / c.Dh), _square(c.s, c.w_s / c.Dw))


def _floored_area(c: Sides) -> Array:
    t, s = _square(c.t, c.w_t), _square(c.s, c.w_s)
    one = np.ones((1, len(c.t)))
    rest = [t + s, one]
    if c.own2 is not None:
        own_t, own_s = c.own2
        rest += [t * own_s + s * own_t, one * (own_t + own_s), one * own_t * own_s]
    return np.concatenate([_product_area(c), np.concatenate(rest) / (c.Dh * c.Dw) ** 2])


def _powers(scale: Any, u: Any, degree: int) -> list[Any]:
    powers = [scale]
    for _ in range(degree):
        powers.append(powers[-1] * u)
    return powers[::-1]


def _floored_functions(f: Scales) -> list[Any]:
    s, g = f.s * f.s, f.g * f.g
    s, floor = s / g, f.floor / g
    found = [*_powers(s * s, f.u, 4), *_powers(s * floor, f.u, 2), floor * floor]
    return [*found, *_powers(s / g, f.u, 2), floor / g, 1 / (g * g)] if f.has_own else found


def _degrees(f: Scales) -> list[Any]:
    s = f.s / f.g
    return _powers(s * s, f.u, 2)


FOCUS_MERITS: dict[str, FocusMerit] = {
    "worst_floored_area_deg2": FocusMerit(FocusedBlur.floored_area, _floored_area, _floored_functions),
    "mean_floored_area_deg2": FocusMerit(FocusedBlur.floored_area, _floored_area, _floored_functions, is_mean=True),
    "worst_blur_area_deg2": FocusMerit(  # merit of the paper
        lambda b: np.abs(b.product()),
        _product_area,
        lambda f: _powers((f.s * f.s / (f.g * f.g)) ** 2, f.u, 4),
    ),
    "worst_blur_px": FocusMerit(
        lambda b: np.maximum(np.abs(b.t_px), np.abs(b.s_px)),
        lambda c: np.concatenate([_square(c.t, c.w_t), _square(c.s, c.w_s)], axis=1),
        lambda f: _powers(f.s * f.s, f.u, 2),
    ),
    "worst_blur_deg": FocusMerit(
        lambda b: np.maximum(np.abs(b.t_deg), np.abs(b.s_deg)),
        lambda c: np.concatenate([_square(c.t, c.w_t / c.Dh), _square(c.s, c.w_s / c.Dw)], axis=1),
        _degrees,
    ),
    "worst_blur_rss_deg": FocusMerit(
        lambda b: np.hypot(b.t_deg, b.s_deg),
        lambda c: _square(c.t, c.w_t / c.Dh) + _square(c.s, c.w_s / c.Dw),
        _degrees,
    ),
}
"""Focus merits by name."""

MOST_OF_ONE_THREAD = 150_000  # multiplications, below the threshold for BLAS threads
STEP = 1e-100  # imaginary step, without cancellation error


@dataclass(frozen=True)
class FocusFunction:
    """Merit of n field angles as a function of the focus."""

    merit: FocusMerit
    sides: Sides
    omega: Array
    scales: Callable[[Any], Scales]
    """Focus-dependent quantities at focus coordinates u."""

    @cached_property
    def coefficients(self) -> Array:
        """Return the coefficients (terms, k)."""
        with np.errstate(divide="ignore", invalid="ignore"):  # at the tip of a cone
            return self.merit.coefficients(self.sides)

    @cached_property
    def _shares(self) -> Array:
        return solid_angle_shares(self.omega)

    def __call__(self, u: Array) -> tuple[Array, Array, NDArray[np.intp]]:
        """Return the merit (squared for a maximum), its derivative and the worst angle; (m,)."""
        moved = self._functions(u + 1j * STEP)
        functions, rates = moved.real.T.copy(), moved.imag.T / STEP
        squares = self._squares(functions)
        if self.merit.is_mean:
            roots = np.sqrt(squares)
            slope = _times(_times(rates, self.coefficients) / roots, self._shares[:, None])[:, 0] / 2
            return _times(roots, self._shares[:, None])[:, 0], slope, np.zeros(len(u), dtype=np.intp)
        worst = squares.argmax(axis=1)
        slope = np.einsum("mt,tm->m", rates, self.coefficients[:, worst])
        return squares[np.arange(len(u)), worst], slope, worst

    def _squares(self, functions: Array) -> Array:
        """Return the squares at all angles, (m, k), in blocks too small for BLAS threads."""
        squares = np.empty((len(functions), self.coefficients.shape[1]))
        few = max(1, MOST_OF_ONE_THREAD // self.coefficients.size)
        for i in range(0, len(functions), few):
            np.matmul(functions[i : i + few], self.coefficients, out=squares[i : i + few])
        return squares

    def _functions(self, u: NDArray[Any]) -> NDArray[Any]:
        """Return the functions of the coefficients, (terms, m), with scalars for one focus."""
        at: Any = complex(u[0]) if len(u) == 1 else u
        functions = [f + 0 * at for f in self.merit.functions(self.scales(at))]
        return np.array(functions).reshape(-1, len(u))


def _times(a: Array, b: Array) -> Array:
    """Return the product of two small matrices without starting BLAS threads."""
    product: Array = np.einsum("mt,tk->mk", a, b)
    return product


def solid_angle_shares(omega: Array) -> Array:
    """Return normalised weights (n,) of a mean over the solid angle at field angles (n,).

    Linear interpolation in the angle is assumed between neighbours; equal angles share their
    weight.

    >>> omega = np.sort(np.random.default_rng(1).uniform(0, 2, 200))
    >>> omega[[0, -1]] = 0, 2
    >>> exact = (4 * np.sin(2) - 2 * np.cos(2) - 2) / (1 - np.cos(2))  # mean of omega^2
    >>> bool(abs(solid_angle_shares(omega) @ omega**2 / exact - 1) < 1e-3)
    True
    """
    angles, which, count = np.unique(omega, return_inverse=True, return_counts=True)
    if len(angles) == 1:
        return np.full(len(omega), 1 / len(omega))
    a, b = angles[:-1], angles[1:]
    step = b - a
    # integrals of sin(omega) (omega - a)/step and of sin(omega) (b - omega)/step over each step
    middle, half = (a + b) / 2, step / 2
    even = np.sin(middle) * np.sin(half)
    odd = np.cos(middle) * (np.sin(half) / half - np.cos(half))
    shares = np.zeros(len(angles))
    shares[1:] += even + odd
    shares[:-1] += even - odd
    shares /= shares.sum()
    mean: Array = (shares / count)[which]
    return mean
