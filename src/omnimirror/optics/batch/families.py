"""Families of meridians that are linear in their coefficients, for batch evaluation.

A family provides sag, slope and curvature of its terms at fractions u = x/M of the rim radius; a
mirror is a sum of terms, added to a conic in the case of the even asphere. Lengths are in units of
the rim radius M.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ..mirrors import ConicAsphere, EvenPolynomial, Mirror, SlopeSpline
from ..mirrors.splines import spline_of_slopes


class Basis(NamedTuple):
    """Terms of a family at n points: sag/M, slope, and curvature times M; each (terms, n)."""

    sag: Array
    slope: Array
    curvature: Array


@dataclass(frozen=True)
class Family:
    """Meridians that are sums of ``terms`` terms.

    Attributes
    ----------
    name
        Kind of mirror of its members.
    terms
        Number of coefficients, without those of a conic.
    """

    name: str
    terms: int
    has_conic: bool
    _basis: Callable[[int, Array], Basis]
    _mirror: Callable[[Array, float, float, float], Mirror]

    def basis(self, u: Array) -> Basis:
        """Compute the terms at fractions (n,) of the rim radius."""
        return self._basis(self.terms, u)

    def mirror(
        self,
        coefficients: Array,
        rim_radius_mm: float,
        vertex_radius_mm: float = np.inf,
        conic: float = 0.0,
    ) -> Mirror:
        """Create the mirror of coefficients (terms,), added to a conic if the family has one."""
        return self._mirror(coefficients, rim_radius_mm, vertex_radius_mm, conic)

    def slope_places(self) -> Array:
        """Return the fractions (terms,) of the rim radius for :meth:`from_slopes`."""
        if self.name == SlopeSpline.KIND:
            return np.arange(1, self.terms + 1) / self.terms
        return np.sin(
            np.pi / 2 * (2 * np.arange(1, self.terms + 1) - 1) / (2 * self.terms - 1)
        )  # Chebyshev, odd

    def from_slopes(self) -> Array:
        """Return the matrix (terms, terms) from slopes at :meth:`slope_places` to coefficients."""
        matrix: Array = np.linalg.inv(self.basis(self.slope_places()).slope.T).astype(float)
        return matrix


def family(name: str, terms: int) -> Family:
    """Return the family of a kind of mirror.

    Raises
    ------
    InvalidParameter
        If the kind has no family, or the number of terms is not supported.

    Examples
    --------
    >>> family("even-polynomial", 3).basis(np.array([0.5])).slope.ravel()  # 2 u, 4 u^3, 6 u^5
    array([1.    , 0.5   , 0.1875])
    """
    if name not in _FAMILIES:
        raise InvalidParameter(
            f"the family of meridians must be one of {', '.join(_FAMILIES)}; got {name!r}"
        )
    min_terms, max_terms, has_conic, basis, mirror = _FAMILIES[name]
    if not min_terms <= terms <= max_terms:
        raise InvalidParameter(f"terms must be {min_terms} to {max_terms} for {name}; got {terms}")
    return Family(name, terms, has_conic, basis, mirror)


def _even_powers(first: int) -> Callable[[int, Array], Basis]:
    """Return a basis of powers u^(2i), starting at i = first."""

    def basis(terms: int, u: Array) -> Basis:
        n = 2 * np.arange(first, first + terms)[:, None]
        return Basis(u**n, n * u ** (n - 1), n * (n - 1) * u ** (n - 2))

    return basis


def _spline_basis(terms: int, u: Array) -> Basis:
    slope = spline_of_slopes(np.vstack([np.zeros(terms), np.eye(terms)]))
    sag = slope.antiderivative()
    return Basis(
        (sag(u) - sag(0.0)).T, np.where(u == 0.0, 0.0, slope(u).T), slope.derivative()(u).T
    )


_FAMILIES = {
    EvenPolynomial.KIND: (
        1,
        12,
        False,
        _even_powers(1),
        lambda c, M, _R, _k: EvenPolynomial(tuple(c), M, M),
    ),
    ConicAsphere.KIND: (
        0,
        10,
        True,
        _even_powers(2),
        lambda c, M, R, k: ConicAsphere(R, k, M, tuple(c), M),
    ),
    SlopeSpline.KIND: (3, 60, False, _spline_basis, lambda c, M, _R, _k: SlopeSpline((0.0, *c), M)),
}


class FreeformFamily(NamedTuple):
    """``spline:N``, ``polynomial:N`` or ``asphere:N``: freeform family and number of
    coefficients."""

    name: str
    terms: int

    @classmethod
    def parse(cls, text: str) -> FreeformFamily:
        """Parse a freeform family, for example ``spline:12``.

        >>> FreeformFamily.parse("spline:12")
        FreeformFamily(name='slope-spline', terms=12)
        >>> FreeformFamily.parse("polynomial")
        FreeformFamily(name='even-polynomial', terms=8)
        """
        word, colon, count = text.strip().partition(":")
        if word not in FREEFORM_FAMILIES or (colon and not (count.isascii() and count.isdigit())):
            term_ranges = (
                f"{w}:N with N from {_FAMILIES[n][0]} to {_FAMILIES[n][1]}"
                for w, (n, _) in FREEFORM_FAMILIES.items()
            )
            raise InvalidParameter(
                f"the freeform family must be {', '.join(term_ranges)}; got {text!r}"
            )
        name, default_terms = FREEFORM_FAMILIES[word]
        return cls(name, family(name, int(count) if colon else default_terms).terms)


FREEFORM_FAMILIES = {
    "spline": (SlopeSpline.KIND, 12),
    "polynomial": (EvenPolynomial.KIND, 8),
    "asphere": (ConicAsphere.KIND, 6),
}
"""Families by their names on the command line, with the default number of coefficients."""
