"""How errors are distributed within their tolerances, and how trials draw them."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

Array = NDArray[np.float64]
Distribution = Literal["uniform", "normal", "truncated", "end-heavy", "always"]
DISTRIBUTIONS: tuple[Distribution, ...] = get_args(Distribution)
"""Within plus and minus the tolerance: all alike; normal, the tolerance two sigma; the same and nothing beyond it; and
as parts come that were machined until they just pass, most at the ends; and always the tolerance itself."""

SIGMAS = 2.0  # that a tolerance is of a normal distribution
UNLIKELY = float(ndtr(-SIGMAS))


def drawn(distribution: Distribution, share: Array) -> Array:
    """Errors in units of the tolerance, for shares in (0, 1) of all that are smaller.

    Parameters
    ----------
    distribution
        Of them.
    share : array
        In (0, 1).

    Returns
    -------
    array
        Quantiles.

    Examples
    --------
    >>> share = np.array([0.25, 0.5, 0.975])
    >>> for name in DISTRIBUTIONS:
    ...     print(name, drawn(name, share).round(3) + 0.0)
    uniform [-0.5   0.    0.95]
    normal [-0.337  0.     0.98 ]
    truncated [-0.32   0.     0.839]
    end-heavy [-0.707  0.     0.997]
    always [1. 1. 1.]
    """
    if distribution == "always":
        return np.ones_like(share)
    if distribution == "uniform":
        return 2 * share - 1
    if distribution == "normal":
        return np.asarray(ndtri(share) / SIGMAS)
    if distribution == "truncated":
        return np.asarray(ndtri(UNLIKELY + share * (1 - 2 * UNLIKELY)) / SIGMAS)
    return -np.cos(np.pi * share)  # the arcsine law


def sigma_of(distribution: Distribution) -> float:
    """Standard deviation in units of the tolerance.

    >>> [round(sigma_of(name), 3) for name in DISTRIBUTIONS]
    [0.577, 0.5, 0.44, 0.707, 0.0]
    """
    if distribution == "truncated":
        density = np.exp(-(SIGMAS**2) / 2) / np.sqrt(2 * np.pi)
        return float(np.sqrt(1 - 2 * SIGMAS * density / (1 - 2 * UNLIKELY)) / SIGMAS)
    sigmas: dict[str, float] = {"uniform": 3**-0.5, "normal": 1 / SIGMAS, "end-heavy": 0.5**0.5, "always": 0.0}
    return sigmas[distribution]
