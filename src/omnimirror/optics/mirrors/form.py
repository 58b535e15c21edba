"""Form error of a manufactured mirror over its disk, in Zernike terms."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.numerics.zernike import noll, power_place, terms_of, zernike_powers
from ...base.parameters import Parameter
from ...base.typing import Array

LARGEST_ORDER = 12
TERMS = terms_of(LARGEST_ORDER)
"""Number of Zernike terms up to the largest order, and exponents of ``x^i y^j``."""
MM_PER_UM = 1e-3


class SurfaceHeights(NamedTuple):
    """Heights of a surface, or of its form error, with derivatives; arrays of one shape."""

    z: Array
    """mm"""
    gx: Array
    gy: Array
    """First derivatives."""
    hxx: Array
    hxy: Array
    hyy: Array
    """Second derivatives, 1/mm."""


@dataclass(frozen=True)
class MirrorForm:
    """Form error along the axis, positive away from the lens, in the mirror frame; none by default.

    Parameters
    ----------
    zernike
        Noll indices of the Zernike terms over the disk of the rim; up to order 12.
    um
        Amplitude of each term, rms over the disk.

    Raises
    ------
    InvalidParameter
        If a term is invalid or repeated, or the number of amplitudes differs from that of terms.

    Examples
    --------
    >>> form = MirrorForm((5, 8), (0.3, -0.1))
    >>> bool(abs(form.heights(20.0, np.array([[20.0, 0.0]])).z[0] / 1e-3 + 0.1 * 8**0.5) < 1e-12)  # coma at the rim
    True
    """

    zernike: tuple[int, ...] = ()
    um: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "zernike": Parameter("", 1, TERMS, "Zernike terms of the form error, by Noll"),
        "um": Parameter("um", -1e4, 1e4, "rms of each over the disk of the rim, along the axis"),
    }

    def __post_init__(self) -> None:
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))
        terms = np.array(self.zernike, dtype=float)
        if (terms != np.round(terms)).any() or len(set(terms)) != len(terms):
            raise InvalidParameter(f"zernike = {list(self.zernike)} are not numbers of terms, each once")
        if len(self.um) != len(terms):
            raise InvalidParameter(f"um has {len(self.um)} amplitudes for {len(terms)} terms; it needs as many")
        object.__setattr__(self, "zernike", tuple(int(j) for j in terms))
        object.__setattr__(self, "um", tuple(float(v) for v in self.um))

    @property
    def is_empty(self) -> bool:
        """True without form error."""
        return not any(self.um)

    @cached_property
    def _powers(self) -> Array:
        """Coefficients (n, n), mm, of (x/rim)^i (y/rim)^j."""
        order = max(noll(j)[0] for j in self.zernike)
        rows = zernike_powers(order)
        mixed = MM_PER_UM * sum(um * rows[j - 1] for j, um in zip(self.zernike, self.um, strict=True))
        square = np.zeros((order + 1, order + 1))
        for i in range(order + 1):
            for j in range(order + 1 - i):
                square[i, j] = np.asarray(mixed)[power_place(i, j)]
        return square

    def heights(self, rim_mm: float, xy: Array) -> SurfaceHeights:
        """Compute heights and derivatives at points (n, 2), mm, for a rim radius."""
        count = len(xy)
        if self.is_empty:
            return SurfaceHeights(*np.zeros((6, count)))
        u, v = (xy / rim_mm).T
        size = len(self._powers)
        powers = np.arange(size)
        rows, columns = ([_derived(w, powers, k) for k in range(3)] for w in (u, v))

        def summed(a: int, b: int) -> Array:
            total: Array = np.einsum("ni,ij,nj->n", rows[a], self._powers, columns[b], optimize=True)
            return total / rim_mm ** (a + b)

        return SurfaceHeights(*(summed(a, b) for a, b in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))))


def _derived(w: Array, powers: NDArray[np.intp], times: int) -> Array:
    """Compute derivatives (n, k) of powers of w."""
    factor = np.ones(len(powers))
    for k in range(times):
        factor = factor * (powers - k)
    derived: Array = factor * w[:, None] ** np.maximum(powers - times, 0)
    return derived


NO_FORM = MirrorForm()
