"""Smoothing of measured meridians: noise estimation, outlier rejection and spline fit.

The noise of a point is its residual from polynomials through 6, 8 or 10 neighbours on both sides,
provided that residuals alternate in sign as noise does; those of a smooth curve do not. The curve
is a quintic spline with a few more pieces than selected by the Bayesian information criterion
(Schwarz): many more pieces fit the noise, fewer underfit the shape by a similar amount. The fit is
linear in the heights; their uncertainty is propagated to all results.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ....base.errors import InvalidParameter
from ....base.typing import Array, Mask

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


DEGREE = 5  # quintic: the curvature is a smooth cubic spline
ORDERS = (6, 8, 10)  # neighbours that predict a point
NORMAL = 1.4826  # standard deviation over median absolute value of normal numbers
ALTERNATING = 0.6  # minimum fraction of sign changes of noise (expected 0.83)
ALIKE = 3.0  # maximum ratio of noise estimates of different orders (1 for noise)
FEWEST = 12  # points with neighbours on both sides, required for a noise estimate
ROUNDING = 1e-13  # of the profile height: smaller noise is rounding
LONELY = 7.0  # outlier threshold, in local standard deviations
WINDOW = 15  # points on each side of the local estimate
MOST_WRONG = 0.05  # maximum fraction of outliers
MOST_ROUNDS = 20
FAR = 5.0  # standard deviations from the smooth curve
PIECES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64, 80, 96, 128, 192, 256)
IN_A_PIECE = 2  # minimum number of points per piece
PATIENCE = 4  # steps without improvement that end the search
FINER = 3  # refinements beyond the minimum: bias becomes small relative to noise
TOO_ROUGH = 2.0  # maximum ratio of estimated to specified uncertainty


@dataclass(frozen=True)
class Fit:
    """Smooth curve through n points of a meridian.

    Attributes
    ----------
    spline
        Spline z(x) relative to its first height.
    uncertainty_mm
        Standard uncertainty of one height; 0 for exact points.
    used : (n,)
        False for outliers.
    deviations : (j, coefficients)
        Independent standard deviations of the spline coefficients; empty for exact points.
    """

    spline: BSpline
    uncertainty_mm: float
    used: Mask
    deviations: Array


class Scatter(NamedTuple):
    """Prediction residuals of n points, mm, scaled to one standard deviation."""

    residuals: Array
    is_noise: bool

    @property
    def sigma(self) -> float:
        """Robust standard deviation."""
        return NORMAL * float(np.median(np.abs(self.residuals)))


def fitted(x: Array, z: Array, smooth_apex: bool, uncertainty_mm: float | None) -> Fit:
    """Fit a curve through points (n,) that increase from 0.

    Parameters
    ----------
    smooth_apex
        True for a curve symmetric about the axis.
    uncertainty_mm
        Uncertainty of the heights; estimated if None, 0 for interpolation.

    Raises
    ------
    InvalidParameter
        If the points scatter far more than specified.
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
        far = size > max(FAR * max(noise, typical), size.max() / 2)  # the worst may bend the others
        if not far.any() or used.sum() - far.sum() < (1 - MOST_WRONG) * len(x):
            break
        used = used & ~far
    if uncertainty_mm is None and left > TOO_ROUGH * noise:  # points too sparse for fewer pieces
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
    """Extrapolate heights (m,) slightly beyond the points (n,) of a meridian by a smooth curve.

    The minimum number of pieces is used: a curve that follows the noise extrapolates poorly.
    """
    used = np.ones(len(x), dtype=bool)
    noise = max(_scatter(x, z).sigma, ROUNDING * float(np.ptp(z)))
    fit, residuals, _ = _smoothed(x, z, smooth_apex, used, noise)
    level = z[-1] - residuals[-1] - fit.spline(x[-1])  # of the apex
    return np.asarray(fit.spline(at) + level)


# -- noise and outliers ----------------------------------------------------------------------------


def _scatter(x: Array, z: Array) -> Scatter:
    """Return the smallest noise estimate over several polynomial degrees."""
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
    """Return prediction residuals (n,) from the ``order`` nearest neighbours."""
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
    """Return isolated outliers (n,): far from their neighbours, which agree without them."""
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
    """Return residuals (n,) in local (or given) standard deviations, and the latter, mm."""
    size = np.abs(_unforetold(x, z, ORDERS[0]))
    padded = np.pad(size, WINDOW, constant_values=np.nan)
    views = np.lib.stride_tricks.sliding_window_view(padded, 2 * WINDOW + 1).copy()
    views[:, WINDOW - ORDERS[0] // 2 : WINDOW + ORDERS[0] // 2 + 1] = np.nan  # the outlier's own
    everywhere = _scatter(x, z)
    least = max(ROUNDING * height, 0.7 * everywhere.sigma if everywhere.is_noise else 0.0)
    scatter = np.maximum(NORMAL * np.nanmedian(views, axis=1), least)
    return size / (scatter if about is None else about), scatter


# -- the smooth curve ------------------------------------------------------------------------------


def _smoothed(x: Array, z: Array, smooth_apex: bool, used: Mask, noise: float) -> tuple[Fit, Array, float]:
    """Return the fit of the points used, all residuals (n,), mm, and their sigma."""
    curves: list[_Curve] = []
    prices: list[float] = []
    for pieces in PIECES:
        if curves and pieces + DEGREE > used.sum() / 2:
            break
        curves.append(_least_squares(x, z, smooth_apex, used, pieces))
        count = curves[-1].basis.shape[1]
        missed = np.abs(curves[-1].residuals[used] / noise)
        missed = np.where(missed > FAR, FAR * (2 * missed - FAR), missed**2)  # Huber loss
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
    """Sum of squared residuals of the points used."""
    roots: Array
    """(j, j): its transpose times itself is the inverse of the normal equations."""
    expand: Array
    """(coefficients, j): expansion to the coefficients of the spline."""


def _least_squares(x: Array, z: Array, smooth_apex: bool, used: Mask, pieces: int) -> _Curve:
    from scipy.interpolate import BSpline

    breaks = _breaks(x[used], x[-1], pieces)
    if smooth_apex:
        breaks = np.concatenate([-breaks[:0:-1], breaks])
    knots = np.concatenate([[breaks[0]] * DEGREE, breaks, [breaks[-1]] * DEGREE])
    count = len(knots) - DEGREE - 1
    half = (count + 1) // 2
    expand = np.eye(count)
    if smooth_apex:  # even functions: mirrored coefficients are equal
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
    """Return the ends of equally long pieces, merged if they contain too few of the points (n,).

    Pieces of equal point count are unsuitable: clouds are sparse at the apex, with high curvature.
    """
    breaks = [0.0]
    held = 0
    for ahead in np.linspace(0.0, end, pieces + 1)[1:-1]:
        before = int(np.searchsorted(x, ahead))
        if before - held >= IN_A_PIECE and len(x) - before >= IN_A_PIECE:
            breaks.append(float(ahead))
            held = before
    return np.array([*breaks, end])
