"""Parameter uncertainty: covariance, standard deviations, weakly determined combinations."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from ...base.errors import OmnimirrorError
from ...base.results import Columns, Result
from ...base.typing import Array
from ...cameras.models.camera_model import CameraModel, RadialModel
from ...cameras.models.sphere_models import Unified
from ._bundle_adjustment import (
    BundleAdjustment,
    assembled,
    bundle_adjust,
    reduced_system,
    shared_values,
    with_priors,
)
from ._residuals import UNSEEN_PX, eliminate_line_positions

FREE_ABOVE = 0.02
"""Fraction of the larger image side.

Parameters are free if each may move the image by more than this, but not all of them together.
"""
FOLLOWED_PX = 1.0  # image motion by the weakest combination above which its valley is followed
FOLLOWED_TO = 9.0  # chi-square above that of the estimate at the end of a valley
MAX_FITS = 14  # in each direction of a valley
FIT_STEPS, FIT_SETTLED = 12, 1e-6  # per fit along a valley
GROWTH, SHRINKAGE = 1.6, 0.4  # factors of the step along a valley
OTHER_XIS = (0.5, 0.7, 0.85, 1.0, 1.15, 1.3, 1.5, 1.8)  # initial values for other minima
NEAR_XIS = (-0.1, -0.07, -0.04, 0.04, 0.07, 0.1)
"""Further initial values, relative to the estimate: the minima may be as close and as narrow."""
SAME_XI = 0.02
HELD_STEPS, FREE_STEPS, ROUGHLY = 8, 20, 1e-4  # steps of these fits, xi held and free; tolerance
HOPELESS = 500.0  # chi-square above that of the estimate, with xi held
GRID = 400  # samples of the likelihood along a valley
NAMED_ABOVE = 0.25  # fraction of the largest component of a combination
MIN_EIGENVALUE = 1e-13  # relative to the largest; smaller eigenvalues are rounding errors


class UndeterminedCombination(NamedTuple):
    """Combination of parameters that the images do not determine."""

    names: tuple[str, ...]
    """Parameter names, largest component first."""
    parts: tuple[float, ...]
    """Joint deviations (1 sigma) of the parameters, each in its own unit."""
    sigma_px: float
    """Image motion by the first parameter if the others did not compensate for it."""
    units: tuple[str, ...]

    def __str__(self) -> str:
        """Return the combination in words.

        >>> str(UndeterminedCombination(("lens.focal_length_mm", "xi"), (3.79, -1164.2), 90.0, ("mm", "")))
        'lens.focal_length_mm larger by 3.8 mm with xi smaller by 1200'
        """
        return " with ".join(map(_change_text, self.names, self.parts, self.units))


def _change_text(name: str, part: float, unit: str) -> str:
    """Return the change of a parameter in words, with two digits."""
    size = f"{float(f'{abs(part):.2g}'):g}"
    return f"{name} {'larger' if part > 0 else 'smaller'} by {size} {unit if unit != '1' else ''}".rstrip()


@dataclass(frozen=True)
class ParameterCovariance(Result):
    """Covariance of the parameters.

    Parameters
    ----------
    names
        Names of all shared parameters.
    covariance : (g, g)
        Covariance in parameter units; 0 for fixed parameters.
    free
        Weakly determined combinations.
    sigmas : (g,)
        Standard deviations of single parameters. Along a curved valley they differ from the square
        roots of the diagonal of the covariance, which applies to directions.
    """

    names: tuple[str, ...]
    covariance: Array
    free: tuple[UndeterminedCombination, ...]
    sigmas: Array

    def _table(self) -> Columns:
        return {"name": list(self.names), "sigma": self.sigmas} | {
            name: self.covariance[:, i] for i, name in enumerate(self.names)
        }

    @property
    def correlations(self) -> Array:
        """Correlation matrix (g, g); 0 for fixed parameters."""
        sigmas = np.sqrt(np.diag(self.covariance))
        inverse = np.divide(1.0, sigmas, out=np.zeros_like(sigmas), where=sigmas > 0)
        return np.asarray(self.covariance * inverse[:, None] * inverse)


def uncertainty(adjustment: BundleAdjustment) -> ParameterCovariance:
    """Estimate the covariance and the standard deviations of the parameters.

    The covariance is the inverse of the reduced normal equations, after elimination of the poses,
    times the noise variance. Standard deviations along a weakly determined combination follow from
    its valley.
    """
    names, free = adjustment.names, adjustment.problem.free
    covariance, scales, extents, vectors = _paraboloid(adjustment)
    sigmas = np.sqrt(np.diag(covariance))
    valleys = None
    if len(extents) and extents[0] > FOLLOWED_PX and isinstance(adjustment.model, RadialModel):
        weakest = int(np.flatnonzero(free)[np.argmax(np.abs(vectors[:, 0]))])
        valleys = _valleys(adjustment, weakest, float(sigmas[weakest]))
    if valleys is not None:
        conditional = (
            covariance
            - np.outer(covariance[weakest], covariance[weakest]) / covariance[weakest, weakest]
        )
        sigmas = np.sqrt(np.maximum(np.diag(conditional), 0.0) + np.diag(valleys))
        sizes, axes = np.linalg.eigh(valleys[np.ix_(free, free)] / scales[:, None] / scales)
        extents[0], vectors[:, 0] = np.sqrt(max(sizes[-1], 0.0)), axes[:, -1]
    limit = FREE_ABOVE * max(adjustment.model.image_size)
    free_parameters = [(n, u) for n, u, f in zip(names, adjustment.units, free, strict=True) if f]
    undetermined = [
        _combination(free_parameters, vectors[:, i], scales, float(extents[i]))
        for i in np.flatnonzero(extents > limit)
    ]
    return ParameterCovariance(names, covariance, tuple(undetermined), sigmas)


class _Paraboloid(NamedTuple):
    """Second-order expansion of the sum of squares around an estimate."""

    covariance: Array
    """Covariance (g, g); 0 for fixed parameters."""
    scales: Array
    """Changes (f,) of single free parameters that move the image by 1 px rms."""
    extents: Array
    """Standard deviations (f,) along the axes in these scales, largest first."""
    vectors: Array
    """Axes (f, f) as columns."""


def _paraboloid(adjustment: BundleAdjustment) -> _Paraboloid:
    """Return covariance and axes of the paraboloid that the normal equations describe."""
    problem, free = adjustment.problem, adjustment.problem.free
    linearised = eliminate_line_positions(adjustment.linearised)
    scales = _scales(linearised.d_shared[:, :, free][linearised.visible])
    weights = linearised.visible.astype(float) / adjustment.noise_px**2
    blocks = assembled(
        problem.stack,
        linearised.residuals,
        linearised.d_shared[:, :, free],
        linearised.d_pose,
        weights,
        problem.moving,
    )
    prior = problem.prior(shared_values(adjustment.estimate))
    matrix, _ = reduced_system(with_priors(blocks, prior.information, prior.pull))
    values, vectors = np.linalg.eigh(matrix * scales[:, None] * scales)
    values = np.maximum(values, max(MIN_EIGENVALUE * float(values.max(initial=0.0)), 1e-300))
    covariance = np.zeros((len(free), len(free)))
    covariance[np.ix_(free, free)] = (vectors / values) @ vectors.T * scales[:, None] * scales
    return _Paraboloid(covariance, scales, values**-0.5, vectors)


def _valleys(adjustment: BundleAdjustment, number: int, sigma: float) -> Array | None:
    """Return second moments (g, g) of the parameters along valleys of one parameter.

    All other parameters are fitted at values of this parameter on both sides of the estimate. The
    moments are those of the likelihood ``exp(-chi^2 / 2)`` over these fits and over those around
    other minima of similar depth. None if no fit succeeds.
    """
    start = _State(
        0.0,
        shared_values(adjustment.estimate),
        adjustment,
        _chi_square(adjustment, adjustment.noise_px),
    )
    minima = [start, *_other_minima(start, number)]
    min_chi_square = min(s.chi_square for s in minima)
    total, moments = 0.0, np.zeros((len(start.values),) * 2)
    for minimum in minima:
        step = (
            sigma if minimum is start else float(_paraboloid(minimum.fit)[0][number, number]) ** 0.5
        )
        states = [
            *reversed(_follow_valley(minimum, number, -step)),
            minimum,
            *_follow_valley(minimum, number, step),
        ]
        if len(states) < 2:
            continue
        offsets = np.array([s.at for s in states])
        grid = np.linspace(offsets[0], offsets[-1], GRID)
        chi_square = PchipInterpolator(offsets, [s.chi_square for s in states])(grid)
        likelihood = np.exp(-(chi_square - minimum.chi_square) / 2)
        deviations = PchipInterpolator(offsets, [s.values - start.values for s in states])(grid)
        # weights by depth: the noise splits a valley into narrow minima, whose widths mean little
        weight = float(np.exp(-(minimum.chi_square - min_chi_square) / 2))
        moments += (
            weight * np.einsum("t,tg,th->gh", likelihood, deviations, deviations) / likelihood.sum()
        )
        total += weight
    return moments / total if total > 0 else None


def _other_minima(start: _State, number: int) -> list[_State]:
    """Return fits of a unified model at other minima that are not significantly worse.

    With three radial terms, unified cameras with different xi may produce nearly the same image. A
    barrier separates these minima, and no sequence of fits passes it.
    """
    fit = start.fit
    if not isinstance(fit.model, Unified) or "xi" in fit.fixed or "k1" in fit.fixed:
        return []
    minima = [start]
    for xi in (*OTHER_XIS, *(fit.model.xi + offset for offset in NEAR_XIS)):
        focal = fit.model.scale_px * (1 + xi) / (1 + fit.model.xi)
        ratio = focal / fit.model.scale_px
        model = replace(
            fit.model,
            xi=xi,
            focal_px=(fit.model.focal_px[0] * ratio, fit.model.focal_px[1] * ratio),
            uncertainty=None,
        )
        options: dict[str, Any] = {
            "shape": fit.shape,
            "noise_px": fit.noise_px,
            "priors": fit.priors,
        }
        try:
            held = bundle_adjust(
                model,
                fit.observations,
                **options,
                fixed=(*fit.fixed, "xi"),
                max_steps=HELD_STEPS,
                relative_tolerance=ROUGHLY,
            )
            if _chi_square(held, fit.noise_px) > start.chi_square + HOPELESS:
                continue
            options |= {"shape": held.shape, "fixed": fit.fixed, "edges": fit.edges}
            candidate = bundle_adjust(
                held.model,
                held.observations,
                **options,
                max_steps=FREE_STEPS,
                relative_tolerance=ROUGHLY,
            )
            if _is_known(candidate.model, minima):
                continue
            candidate = candidate.refit(
                candidate.observations, noise_px=fit.noise_px, relative_tolerance=FIT_SETTLED
            )
        except OmnimirrorError:
            continue
        state = _State(
            shared_values(candidate.estimate)[number] - start.values[number],
            shared_values(candidate.estimate),
            candidate,
            _chi_square(candidate, fit.noise_px),
        )
        if state.chi_square < start.chi_square + FOLLOWED_TO and not _is_known(
            candidate.model, minima
        ):
            minima.append(state)
    return minima[1:]


def _is_known(model: CameraModel, minima: list[_State]) -> bool:
    """Return whether a unified model belongs to a known minimum."""
    xis = [m.fit.model.xi for m in minima if isinstance(m.fit.model, Unified)]
    return isinstance(model, Unified) and any(abs(model.xi - xi) < SAME_XI for xi in xis)


class _State(NamedTuple):
    """Fit with one parameter held."""

    at: float
    """Offset of the parameter from the estimate."""
    values: Array
    """Values (g,) of all shared parameters."""
    fit: BundleAdjustment
    chi_square: float


def _follow_valley(start: _State, number: int, step: float) -> list[_State]:
    """Return fits along a valley in one direction, up to a limit of chi-square."""
    states = [start]
    for _ in range(MAX_FITS):
        state = _fit_with_fixed(states, number, step, start.fit.noise_px)
        if state is None or state.chi_square > start.chi_square + 2 * FOLLOWED_TO:
            step *= SHRINKAGE
            continue
        states.append(state)
        if state.chi_square > start.chi_square + FOLLOWED_TO:
            break
        step *= GROWTH
    return states[1:]


def _fit_with_fixed(
    states: list[_State], number: int, step: float, noise_px: float
) -> _State | None:
    """Return the fit with a parameter moved by a step, None on failure.

    The initial value is extrapolated linearly from the last two fits.
    """
    last = states[-1]
    count, size = len(last.fit.model.parameters), len(last.values)
    extrapolation = np.zeros(size)
    if len(states) > 1:
        extrapolation = (last.values - states[-2].values) * (step / (last.at - states[-2].at))
    values = last.values + extrapolation
    values[number] = last.values[number] + step
    fit, shape = last.fit, last.fit.shape
    end = count + (len(shape.values) if shape else 0)
    try:
        fixed_fit = bundle_adjust(
            fit.model.with_parameters(values[:count]),
            fit.observations,
            shape=shape.with_values(values[count:end]) if shape else None,
            fixed=(*fit.fixed, fit.names[number]),
            priors=fit.priors,
            edges=fit.edges,
            noise_px=noise_px,
            max_steps=FIT_STEPS,
            relative_tolerance=FIT_SETTLED,
        )
    except OmnimirrorError:
        return None
    return _State(
        last.at + step,
        shared_values(fixed_fit.estimate),
        fixed_fit,
        _chi_square(fixed_fit, noise_px),
    )


def _chi_square(fit: BundleAdjustment, noise_px: float) -> float:
    """Return the sum of squared residuals over the noise variance, including priors."""
    prior = fit.problem.prior(shared_values(fit.estimate)).cost
    penalty = UNSEEN_PX**2 * int((~fit.visible).sum())
    return (
        float(np.sum(eliminate_line_positions(fit.linearised).residuals ** 2)) + penalty
    ) / noise_px**2 + prior


def _scales(derivatives: Array) -> Array:
    """Return changes (g,) of single parameters that move the image by 1 px rms.

    The input are derivatives (n, 2, g).
    """
    size = (
        np.sqrt(np.mean(np.sum(derivatives**2, axis=1), axis=0)) if len(derivatives) else np.ones(0)
    )
    return np.asarray(1 / np.where(size > 0, size, 1.0))


def _combination(
    parameters: list[tuple[str, str]], vector: Array, scales: Array, sigma: float
) -> UndeterminedCombination:
    order = [
        i
        for i in np.argsort(-np.abs(vector))
        if abs(vector[i]) > NAMED_ABOVE * np.abs(vector).max()
    ]
    vector = vector * np.sign(vector[order[0]])
    return UndeterminedCombination(
        tuple(parameters[i][0] for i in order),
        tuple(float(sigma * vector[i] * scales[i]) for i in order),
        sigma,
        tuple(parameters[i][1] for i in order),
    )
