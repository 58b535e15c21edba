"""Random figures: what a surface has of form errors that only their size and their power spectrum are known of.

A Zernike term of order n has about n/2 periods over the mirror. Of a power spectral density that falls as the
``exponent`` of the spatial frequency, in two dimensions, each term of order n has the variance ``A n^-exponent``; an
order has n + 1 terms. The whole is as large as its rms, its peak to valley, or the rms of its slope says.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....arguments import check_fields, number
from ....errors import InvalidParameter
from ....mirrors import Mirror
from ....mirrors.form import LARGEST_ORDER, MirrorForm
from ....numerics.zernike import noll, terms_of, zernike_values

Array = NDArray[np.float64]

LOWEST_ORDER = 2  # below, forms are places
GRID = 41  # points across the mirror, on which figures are measured
DRAWS = 200  # figures whose mean peak to valley is taken
MM_PER_UM = 1e-3


@dataclass(frozen=True)
class RandomFigure:
    """Form errors of a power spectrum.

    Parameters
    ----------
    exponent
        Of the spectral density over spatial frequency, which falls with it; 2 to 3 of turned and polished surfaces.
    orders
        First and last order of Zernike terms that it has; one period over the mirror is order 2.
    rms_um, peak_to_valley_um, slope_mrad
        One of them: of the whole figure over the disk of the rim, along the axis; the slope's is an rms of its length.

    Raises
    ------
    InvalidParameter
        Orders that are none, or not exactly one size.

    Examples
    --------
    >>> figure = RandomFigure(2.5, (4, 8), rms_um=0.5)
    >>> sigmas = figure.sigmas_um(44.0)
    >>> round(sum(um**2 for um in sigmas.values()) ** 0.5, 9), len(sigmas)
    (0.5, 35)
    """

    exponent: float = 2.5
    orders: tuple[int, int] = (LOWEST_ORDER, LARGEST_ORDER)
    rms_um: float | None = None
    peak_to_valley_um: float | None = None
    slope_mrad: float | None = None

    def __post_init__(self) -> None:
        check_fields(self)
        number("exponent", self.exponent, low=0.0, high=10.0)
        low, high = self.orders
        if not (LOWEST_ORDER <= low <= high <= LARGEST_ORDER and (low, high) == (int(low), int(high))):
            raise InvalidParameter(
                f"orders = {low:g} to {high:g} is valid from {LOWEST_ORDER} to {LARGEST_ORDER}; finer figures than "
                "that are not traced"
            )
        sizes = [self.rms_um, self.peak_to_valley_um, self.slope_mrad]
        given = [size for size in sizes if size is not None]
        if len(given) != 1 or not 0 < given[0] < np.inf:
            raise InvalidParameter(
                "one of rms_um, peak_to_valley_um and slope_mrad, above 0, says how large a random figure is"
            )

    def sigmas_um(self, rim_mm: float) -> dict[int, float]:
        """Standard deviation of each Zernike term, um rms, by Noll's number.

        Parameters
        ----------
        rim_mm
            Radius of the mirror's rim.

        Returns
        -------
        dict
            Of all terms of its orders.
        """
        low, high = self.orders
        terms = range(terms_of(low - 1) + 1, terms_of(high) + 1)
        shape = {j: float(noll(j)[0]) ** (-self.exponent / 2) for j in terms}
        whole = float(np.sqrt(sum(sigma**2 for sigma in shape.values())))
        if self.rms_um is not None:
            scale = self.rms_um / whole
        elif self.peak_to_valley_um is not None:
            scale = self.peak_to_valley_um / _peak_to_valley(shape)
        else:
            assert self.slope_mrad is not None, "one of the three"
            scale = self.slope_mrad / _slope_mrad(shape, rim_mm)
        return {j: scale * sigma for j, sigma in shape.items()}


def _places() -> Array:
    """Points (n, 2) of the unit disk."""
    x, y = (v.ravel() for v in np.meshgrid(*2 * [np.linspace(-1, 1, GRID)]))
    places: Array = np.stack([x, y], axis=-1)[np.hypot(x, y) <= 1]
    return places


def _peak_to_valley(sigmas: dict[int, float]) -> float:
    """Mean peak to valley (um) of figures with these standard deviations."""
    amounts = np.random.default_rng(0).normal(size=(DRAWS, len(sigmas))) * list(sigmas.values())
    x, y = _places().T
    heights = amounts @ zernike_values(x, y, list(sigmas)).T
    return float(np.ptp(heights, axis=1).mean())


def _slope_mrad(sigmas: dict[int, float], rim_mm: float) -> float:
    """Root of the mean square (mrad) of the slope of figures with these standard deviations."""
    squares = 0.0
    for j, sigma in sigmas.items():
        form = MirrorForm((j,), (1.0,)).heights(rim_mm, rim_mm * _places())
        squares += sigma**2 * float((form.gx**2 + form.gy**2).mean())
    return 1e3 * float(np.sqrt(squares))


def figure_of(mirror: Mirror, figure: RandomFigure) -> dict[str, float]:
    """Tolerances of a random figure of a mirror: normal ones, two sigma, by the names of their errors."""
    return {f"mirror.zernike_{j}_um": 2 * sigma for j, sigma in figure.sigmas_um(mirror.rim_radius_mm).items()}
