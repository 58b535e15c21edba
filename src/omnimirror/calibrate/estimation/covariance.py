"""How well it is known: covariance of the parameters, combinations that nothing determines."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .bundle.adjustment import Adjustment
from .bundle.linearisation import without_slides
from .bundle.normal_equations import assembled, reduced_system, with_priors
from .bundle.steps import shared_values

Array = NDArray[np.float64]

FREE_ABOVE = 0.03
"""Of the picture's larger side: parameters that may move it by so much, each alone, and together do not, are free."""
NAMED_ABOVE = 0.25  # of the largest part of a combination
LEAST_EIGENVALUE = 1e-13  # of the largest; below it rounding is all there is


class FreeCombination(NamedTuple):
    """A combination of parameters that the pictures do not determine."""

    names: tuple[str, ...]
    """largest part first"""
    parts: tuple[float, ...]
    """by how much they may be off together, each in its own unit: one sigma"""
    sigma_px: float
    """by how much the first might move the picture, were the others not to move it back"""
    units: tuple[str, ...]

    def __str__(self) -> str:
        """
        >>> str(FreeCombination(("lens.focal_length_mm", "xi"), (3.79, -1164.2), 90.0, ("mm", "")))
        'lens.focal_length_mm larger by 3.8 mm with xi smaller by 1200'
        """
        return " with ".join(map(_said, self.names, self.parts, self.units))


def _said(name: str, part: float, unit: str) -> str:
    """A change of a parameter in words, of two digits."""
    size = f"{float(f'{abs(part):.2g}'):g}"
    return f"{name} {'larger' if part > 0 else 'smaller'} by {size} {unit if unit != '1' else ''}".rstrip()


@dataclass(frozen=True)
class ParameterCovariance:
    """Covariance of the parameters.

    Parameters
    ----------
    names
        Of all shared parameters.
    covariance : (g, g)
        In their units; 0 for those that are fixed.
    free
        Combinations that are not determined.
    """

    names: tuple[str, ...]
    covariance: Array
    free: tuple[FreeCombination, ...]

    @property
    def sigmas(self) -> Array:
        """Standard deviations (g,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Array:
        """(g, g), 0 for what is fixed."""
        sigmas = self.sigmas
        inverse = np.divide(1.0, sigmas, out=np.zeros_like(sigmas), where=sigmas > 0)
        return np.asarray(self.covariance * inverse[:, None] * inverse)


def uncertainty(adjustment: Adjustment) -> ParameterCovariance:
    """Covariance at the least squares: the inverse of what pictures say when motions are free, times the noise."""
    question, names = adjustment.question, adjustment.names
    free = question.free
    found = without_slides(adjustment.linearised)
    scales = _scales(found.d_shared[:, :, free][found.seen])
    weights = found.seen.astype(float) / adjustment.noise_px**2
    blocks = assembled(
        question.stack, found.residuals, found.d_shared[:, :, free], found.d_motion, weights, question.moving
    )
    prior = question.prior(shared_values(adjustment.estimate))
    matrix, _ = reduced_system(with_priors(blocks, prior.information, prior.pull))
    values, vectors = np.linalg.eigh(matrix * scales[:, None] * scales)
    values = np.maximum(values, max(LEAST_EIGENVALUE * float(values.max(initial=0.0)), 1e-300))
    covariance = np.zeros((len(names), len(names)))
    covariance[np.ix_(free, free)] = (vectors / values) @ vectors.T * scales[:, None] * scales
    limit = FREE_ABOVE * max(adjustment.model.image_size)
    known = [(n, u) for n, u, f in zip(names, adjustment.units, free, strict=True) if f]
    loose = [
        _combination(known, vectors[:, i], scales, float(values[i] ** -0.5))
        for i in range(len(values))
        if values[i] ** -0.5 > limit
    ]
    return ParameterCovariance(names, covariance, tuple(loose))


def _scales(derivatives: Array) -> Array:
    """Changes (g,) of parameters that move the picture by 1 px rms each alone, from derivatives (n, 2, g)."""
    size = np.sqrt(np.mean(np.sum(derivatives**2, axis=1), axis=0)) if len(derivatives) else np.ones(0)
    return np.asarray(1 / np.where(size > 0, size, 1.0))


def _combination(named: list[tuple[str, str]], vector: Array, scales: Array, sigma: float) -> FreeCombination:
    order = [i for i in np.argsort(-np.abs(vector)) if abs(vector[i]) > NAMED_ABOVE * np.abs(vector).max()]
    vector = vector * np.sign(vector[order[0]])
    return FreeCombination(
        tuple(named[i][0] for i in order), tuple(float(sigma * vector[i] * scales[i]) for i in order), sigma,
        tuple(named[i][1] for i in order),
    )  # fmt: skip
