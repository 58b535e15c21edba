"""Measured meridians: how far their points scatter, which of them are wrong, and the smooth curve through the others.

The scatter is what the neighbours on both sides do not foretell of a point (polynomials through six, eight or ten of
them), as long as it changes its sign from point to point as noise does; what is left of a smooth curve does not. The
curve is a quintic spline of a few more pieces than Schwarz's criterion asks for: many more would follow the noise, and
fewer would miss the shape by as much as it. It is linear in the heights, so that their scatter is known in all that
follows.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

DEGREE = 5  # quintic: the curvature is then a smooth cubic, as good a spline as the sag has elsewhere
ORDERS = (6, 8, 10)  # neighbours that foretell a point
NORMAL = 1.4826  # standard deviation of normal numbers over the median of their magnitudes
ALTERNATING = 0.6  # share of changes of sign, .83 for noise, from which on a scatter is noise
ALIKE = 3.0  # ratio of scatters by different orders, 1 for noise, up to which they are one
FEWEST = 12  # points with neighbours on both sides, without which nothing is said of noise
ROUNDING = 1e-13  # of the height of the profile: a scatter below this is that of the numbers themselves
LONELY = 7.0  # times the scatter about it that a point must be off to be wrong
WINDOW = 15  # points on either side that are about it
MOST_WRONG = 0.05  # of the points
MOST_ROUNDS = 20
FAR = 5.0  # standard deviations from the smooth curve
PIECES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 192, 256)
IN_A_PIECE = 2  # points, at least
PATIENCE = 4  # steps of these that bring nothing end the search
FINER = 3  # steps past the fewest pieces that will do: what they miss is then small beside what scatter does
TOO_ROUGH = 2.0  # times the uncertainty that is stated


@dataclass(frozen=True)
class Fit:
    """A smooth curve through n points of a meridian.

    Attributes
    ----------
    spline
        z(x), its first height taken away.
    uncertainty_mm
        Standard uncertainty of one height; 0 for points taken as exact.
    used : (n,)
        False for points that are wrong.
    deviations : (j, coefficients)
        Independent standard deviations of the spline's coefficients; none for points taken as exact.
    """

    spline: BSpline
    uncertainty_mm: float
    used: Mask
    deviations: Array


class Scatter(NamedTuple):
    """What neighbours do not foretell of n points, mm, as much as one height scatters if it is noise."""

    residuals: Array
    is_noise: bool

    @property
    def sigma(self) -> float:
        """Standard deviation, deaf to single points that are wrong."""
        return NORMAL * float(np.median(np.abs(self.residuals)))


def fitted(x: Array, z: Array, smooth_apex: bool, uncertainty_mm: float | None) -> Fit:
    """The curve through points (n,) that grow from 0.

    Parameters
    ----------
    smooth_apex
        Whether the curve goes over to the other side of the axis evenly.
    uncertainty_mm
        Of the heights; estimated from them if None, and 0 to go through all of them.

    Raises
    ------
    InvalidParameter
        Points that scatter far more than was stated.
    """
    used = np.ones(len(x), dtype=bool)
    if uncertainty_mm == 0.0:
        return _interpolated(x, z, smooth_apex, used)
    used = ~_lonely(x, z)
    scatter = _scatter(x[used], z[used])
    noise = scatter.sigma if uncertainty_mm is None else uncertainty_mm
    if uncertainty_mm is None and (not scatter.is_noise or noise <= ROUNDING * float(np.ptp(z))):
        return _interpolated(x, z, smooth_apex, used)
    for _ in range(MOST_ROUNDS):
        fit, residuals, left = _smoothed(x, z, smooth_apex, used, noise)
        size = np.where(used, np.abs(residuals), 0.0)
        typical = NORMAL * float(np.median(size[used]))
        far = size > max(FAR * max(noise, typical), size.max() / 2)  # the others may be bent by the worst ones
        if not far.any() or used.sum() - far.sum() < (1 - MOST_WRONG) * len(x):
            break
        used = used & ~far
    if uncertainty_mm is None and left > TOO_ROUGH * noise:  # points too far apart for a curve of fewer pieces
        return _interpolated(x, z, smooth_apex, used)
    if uncertainty_mm is not None and left > TOO_ROUGH * uncertainty_mm:
        raise InvalidParameter(
            f"the points of the profile scatter by {left * 1e3:.3g} um about the smoothest curve that they allow, and "
            f"uncertainty_um = {uncertainty_mm * 1e3:g} is stated; it is valid from {left * 1e3 / TOO_ROUGH:.2g}, or "
            "left out to be estimated"
        )
    return fit


def _interpolated(x: Array, z: Array, smooth_apex: bool, used: Mask) -> Fit:
    from scipy.interpolate import make_interp_spline

    x, z = x[used], z[used] - z[used][0]
    if smooth_apex:
        x, z = np.concatenate([-x[:0:-1], x]), np.concatenate([z[:0:-1], z])
    spline = make_interp_spline(x, z, k=DEGREE)
    return Fit(spline, 0.0, used, np.zeros((0, len(spline.c))))


def extended(x: Array, z: Array, smooth_apex: bool, at: Array) -> Array:
    """Heights (m,) a little beyond the points (n,) of a meridian, by the smooth curve through them.

    By no more pieces than they ask for: a curve that follows their scatter is far off where it ends.
    """
    used = np.ones(len(x), dtype=bool)
    noise = max(_scatter(x, z).sigma, ROUNDING * float(np.ptp(z)))
    fit, residuals, _ = _smoothed(x, z, smooth_apex, used, noise)
    level = z[-1] - residuals[-1] - fit.spline(x[-1])  # of the apex
    return np.asarray(fit.spline(at) + level)


# -- scatter and wrong points ----------------------------------------------------------------------


def _scatter(x: Array, z: Array) -> Scatter:
    """The least scatter that polynomials of several degrees leave; of a smooth curve they leave ever less."""
    found = [_unforetold(x, z, order) for order in ORDERS if len(x) > order + 1]
    if not found:
        return Scatter(np.zeros(len(x)), False)
    sizes = [float(np.median(np.abs(r))) for r in found]
    least = found[int(np.argmin(sizes))]
    inner = least[ORDERS[-1] // 2 : -ORDERS[-1] // 2]
    changes = np.signbit(inner[1:]) != np.signbit(inner[:-1])
    is_noise = len(inner) >= FEWEST and changes.mean() > ALTERNATING and max(sizes) < ALIKE * min(sizes)
    return Scatter(least, bool(is_noise))


def _unforetold(x: Array, z: Array, order: int) -> Array:
    """What the ``order`` nearest neighbours of each point (n,) do not foretell of it, per standard deviation of z."""
    n, half = len(x), order // 2
    first = np.clip(np.arange(n) - half, 0, n - order - 1)
    window = first[:, None] + np.arange(order + 1)
    others = window[window != np.arange(n)[:, None]].reshape(n, order)
    at = x[others]
    gaps = at[:, :, None] - at[:, None, :] + np.eye(order)
    steps = x[:, None] - at
    ratio = steps[:, None, :] / gaps
    ratio[:, np.arange(order), np.arange(order)] = 1.0
    weights = ratio.prod(axis=2)
    residual: Array = (z - np.einsum("no,no->n", weights, z[others])) / np.sqrt(1 + (weights**2).sum(axis=1))
    return residual


def _lonely(x: Array, z: Array) -> Mask:
    """Points (n,) that alone are wrong: far off for what is about them, and their neighbours are fine without them."""
    wrong = np.zeros(len(x), dtype=bool)
    tried = np.zeros(len(x), dtype=bool)
    for _ in range(max(int(MOST_WRONG * len(x)), 1)):
        kept = np.flatnonzero(~wrong)
        if len(kept) <= 2 * ORDERS[0] + 2:
            break
        off, about = _off(x[kept], z[kept], float(np.ptp(z)))
        off[tried[kept]] = 0.0
        worst = int(np.argmax(off))
        if off[worst] <= LONELY:
            break
        without = np.delete(kept, worst)
        again, _ = _off(x[without], z[without], float(np.ptp(z)), about[worst])
        beside = again[max(worst - ORDERS[0] // 2, 0) : worst + ORDERS[0] // 2]
        tried[kept[worst]] = True
        wrong[kept[worst]] = bool((beside < max(LONELY, off[worst] / 8)).all())
    return wrong


def _off(x: Array, z: Array, height: float, about: float | None = None) -> tuple[Array, Array]:
    """How far (n,) points are off, in scatters of those about them (or in a given one), and these scatters, mm."""
    size = np.abs(_unforetold(x, z, ORDERS[0]))
    padded = np.pad(size, WINDOW, constant_values=np.nan)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1).copy()
    views[:, WINDOW - ORDERS[0] // 2 : WINDOW + ORDERS[0] // 2 + 1] = np.nan  # what a wrong point upsets itself
    everywhere = _scatter(x, z)
    least = max(ROUNDING * height, 0.7 * everywhere.sigma if everywhere.is_noise else 0.0)
    scatter = np.maximum(NORMAL * np.nanmedian(views, axis=1), least)
    return size / (scatter if about is None else about), scatter


# -- the smooth curve ------------------------------------------------------------------------------


def _smoothed(x: Array, z: Array, smooth_apex: bool, used: Mask, noise: float) -> tuple[Fit, Array, float]:
    """The fit of the points that are used, what it leaves of all (n,) mm, and their standard deviation."""
    curves: list[_Curve] = []
    prices: list[float] = []
    for pieces in PIECES:
        if curves and pieces + DEGREE > used.sum() / 2:
            break
        curves.append(_least_squares(x, z, smooth_apex, used, pieces))
        count = curves[-1].basis.shape[1]
        missed = np.abs(curves[-1].residuals[used] / noise)
        missed = np.where(missed > FAR, FAR * (2 * missed - FAR), missed**2)  # wrong points ask for few pieces
        prices.append(float(missed.sum() + np.log(used.sum()) * count))
        if len(curves) - int(np.argmin(prices)) > max(PATIENCE, FINER):
            break
    curve = curves[min(int(np.argmin(prices)) + FINER, len(curves) - 1)]
    left = float(np.sqrt(curve.left / max(used.sum() - curve.basis.shape[1], 1)))
    spread = max(noise, left) * curve.roots @ curve.expand.T
    return Fit(curve.spline, max(noise, left), used, spread), curve.residuals, left


class _Curve(NamedTuple):
    spline: BSpline
    basis: Array
    residuals: Array
    left: float
    """Sum of the squares of the residuals that count."""
    roots: Array
    """(j, j): its transpose times it is the inverse of the normal equations."""
    expand: Array
    """(coefficients, j): the spline's own coefficients."""


def _least_squares(x: Array, z: Array, smooth_apex: bool, used: Mask, pieces: int) -> _Curve:
    from scipy.interpolate import BSpline

    breaks = _breaks(x[used], x[-1], pieces)
    if smooth_apex:
        breaks = np.concatenate([-breaks[:0:-1], breaks])
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    count = len(knots) - DEGREE - 1
    half = (count + 1) // 2
    expand = np.eye(count)
    if smooth_apex:  # even functions: a coefficient and its mirror image are one
        expand = (expand + expand[::-1])[:, :half]
        expand[:, -1] /= expand[:, -1].max()
    basis = BSpline.design_matrix(x, knots, DEGREE).toarray() @ expand
    Q, R = np.linalg.qr(basis[used])
    c = np.linalg.solve(R, Q.T @ z[used])
    residuals = z - basis @ c
    spline = BSpline(knots, expand @ c, DEGREE)
    spline = BSpline(knots, spline.c - spline(0.0), DEGREE)
    return _Curve(
        spline, basis, residuals, float((residuals[used] ** 2).sum()), np.linalg.inv(R).T, expand
    )  # fmt: skip


def _breaks(x: Array, end: float, pieces: int) -> Array:
    """Ends of pieces that are equally long, but for those which too few of the points (n,) would hold.

    Not of equally many points: a cloud has few about the apex, where mirrors bend most.
    """
    breaks = [0.0]
    held = 0
    for ahead in np.linspace(0.0, end, pieces + 1)[1:-1]:
        before = int(np.searchsorted(x, ahead))
        if before - held >= IN_A_PIECE and len(x) - before >= IN_A_PIECE:
            breaks.append(float(ahead))
            held = before
    return np.array([*breaks, end])
