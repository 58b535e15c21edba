"""Tolerances, their distributions and correlations, and the random errors of trials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from scipy.special import ndtr, ndtri

from ...base.arguments import check_fields, choice, format_value, number
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.mirrors.mirror import MirrorForm
from ...optics.sensor import Sensor
from .perturbation import MEASURED, check_name, error_sources, measured

Distribution = Literal["uniform", "normal", "truncated-normal", "arcsine", "constant"]
DISTRIBUTIONS: tuple[Distribution, ...] = get_args(Distribution)
"""Distributions within the tolerance t: uniform; normal with t = 2 sigma; the same, truncated at t;
arcsine, with a maximum at both ends, as for parts machined until they pass; constant t."""

SIGMAS = 2.0  # tolerance of a normal distribution in standard deviations
UNLIKELY = float(ndtr(-SIGMAS))


def drawn(distribution: Distribution, probability: Array) -> Array:
    """Compute quantiles of a distribution in units of the tolerance.

    Parameters
    ----------
    distribution
        Name of the distribution.
    probability : array
        Probabilities in (0, 1).

    Returns
    -------
    array
        Quantiles.

    Examples
    --------
    >>> probability = np.array([0.25, 0.5, 0.975])
    >>> for name in DISTRIBUTIONS:
    ...     print(name, drawn(name, probability).round(3) + 0.0)
    uniform [-0.5   0.    0.95]
    normal [-0.337  0.     0.98 ]
    truncated-normal [-0.32   0.     0.839]
    arcsine [-0.707  0.     0.997]
    constant [1. 1. 1.]
    """
    if distribution == "constant":
        return np.ones_like(probability)
    if distribution == "uniform":
        return 2 * probability - 1
    if distribution == "normal":
        return np.asarray(ndtri(probability) / SIGMAS)
    if distribution == "truncated-normal":
        return np.asarray(ndtri(UNLIKELY + probability * (1 - 2 * UNLIKELY)) / SIGMAS)
    return -np.cos(np.pi * probability)  # arcsine distribution


BLOCK = 8192
"""Number of trials per block; each block has its own random numbers, independent of execution
order."""
MIN_TOLERANCE, MAX_TOLERANCE = 1e-50, 1e6
"""Range of a nonzero tolerance in any unit, which avoids underflow and overflow of squares."""
MIN_PROBABILITY = 2.0**-54  # avoids infinite quantiles at 0


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one error: half-width and distribution.

    Parameters
    ----------
    value
        Half-width in the unit of the error: 0, or between 1e-50 and 1e6.
    distribution
        Distribution of the error.

    Raises
    ------
    InvalidParameter
        If the value is out of range or the distribution is unknown.

    Examples
    --------
    >>> Tolerance(0.1, "normal")
    Tolerance(value=0.1, distribution='normal')
    """

    value: float
    distribution: Distribution = "uniform"

    def __post_init__(self) -> None:
        check_fields(self)
        choice("distribution", self.distribution, DISTRIBUTIONS)
        value = number("tolerance", self.value)
        if value != 0 and not MIN_TOLERANCE <= value <= MAX_TOLERANCE:
            raise InvalidParameter(
                f"tolerance must be 0, or between {MIN_TOLERANCE:g} and {MAX_TOLERANCE:g}; got {value:g}"
            )


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of a sensor.

    Parameters
    ----------
    sensor
        Nominal sensor.
    errors
        Tolerances by error source
        (:func:`omnimirror.manufacturing.tolerancing.perturbation.error_sources`).
    correlations
        Correlation coefficients of pairs of errors, between -1 and 1, of the underlying normal
        variables.
    forms
        Form errors by name: the error ``mirror.measured[NAME]`` is a multiple of that form.

    Raises
    ------
    InvalidParameter
        If an error source is unknown or the correlations are inconsistent.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> tolerances = Tolerances(sensor, {"mirror.decentre_x_mm": Tolerance(0.1)})
    >>> values = tolerances.drawn(seed=1, block=0, count=1000)["mirror.decentre_x_mm"]
    >>> bool(np.abs(values).max() <= 0.1), len(values)
    (True, 1000)
    """

    sensor: Sensor
    errors: Mapping[str, Tolerance]
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)
    forms: Mapping[str, MirrorForm] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        sources = error_sources(self.sensor) | {measured(name): MEASURED for name in self.forms}
        for name in self.errors:
            check_name(name, sources)
        if not self.errors:
            raise InvalidParameter("errors must contain at least one error; got none")
        self._mixing()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the errors, in order."""
        return tuple(self.errors)

    def drawn(self, seed: int, block: int, count: int = BLOCK) -> dict[str, Array]:
        """Draw the errors of a block of trials; the result is reproducible.

        Parameters
        ----------
        seed
            Random seed.
        block
            Block number, from 0.
        count
            Number of trials of the block.

        Returns
        -------
        dict of (n,) arrays
            Errors of n trials by name, in their units.

        Raises
        ------
        InvalidParameter
            If count exceeds the size of a block.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": Tolerance(0.01)})
        >>> again = [tolerances.drawn(seed=3, block=5, count=10)["lens.k1"] for _ in range(2)]
        >>> bool((again[0] == again[1]).all())
        True
        """
        if not 0 <= count <= BLOCK:
            raise InvalidParameter(f"count must be between 0 and {BLOCK}; got {count}")
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, block])))
        return self.at(
            np.maximum(random.random((BLOCK, len(self.errors)))[:count], MIN_PROBABILITY)
        )

    def at(self, probabilities: Array) -> dict[str, Array]:
        """Transform probabilities (t, n) in (0, 1) to errors.

        Parameters
        ----------
        probabilities : (t, n)
            Independent probabilities, one per error.

        Returns
        -------
        dict of (n,) arrays
            Errors of n trials by name, in their units.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": Tolerance(0.01)})
        >>> tolerances.at(np.array([[0.5], [0.75]]))["lens.k1"]
        array([0.   , 0.005])
        """
        if self.correlations:
            from scipy.special import ndtri

            probabilities = ndtr(ndtri(probabilities) @ self._mixing().T)
        columns = zip(self.errors.items(), probabilities.T, strict=True)
        drawn_ = {
            name: t.value * drawn(t.distribution, np.ascontiguousarray(probability))
            for (name, t), probability in columns
        }
        return self.expand_forms(drawn_)

    def expand_forms(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Replace measured forms by their Zernike terms.

        Parameters
        ----------
        values : dict of (n,) arrays
            Errors by name.

        Returns
        -------
        dict of (n,) arrays
            Errors without measured forms.

        Examples
        --------
        >>> import omnimirror as om
        >>> forms = {"lathe": om.optics.mirrors.mirror.MirrorForm((5,), (0.3,))}
        >>> errors = {"mirror.measured[lathe]": Tolerance(1.0)}
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), errors, forms=forms)
        >>> tolerances.expand_forms({"mirror.measured[lathe]": np.array([2.0])})
        {'mirror.zernike_5_um': array([0.6])}
        """
        spelt = dict(values)
        for name, form in self.forms.items():
            amount = spelt.pop(measured(name), None)
            for j, um in zip(form.zernike, form.um, strict=True) if amount is not None else ():
                term = f"mirror.zernike_{int(j)}_um"
                spelt[term] = spelt.get(term, 0.0) + um * np.asarray(amount)
        return spelt

    def _mixing(self) -> Array:
        """Return the symmetric square root (n, n) of the correlation matrix; uncorrelated errors
        are unchanged.
        """
        matrix = np.eye(len(self.errors))
        for pair, value in self.correlations.items():
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise InvalidParameter(
                    f"keys of correlations must be pairs of error names; got {format_value(pair)}"
                )
            first, second = pair
            for name in (first, second):
                if name not in self.errors:
                    raise InvalidParameter(
                        f"the correlation of {first} and {second} requires a tolerance of {name}"
                    )
            if first == second:
                raise InvalidParameter(
                    f"correlations must be between two different errors; got {first} twice"
                )
            if not -1 <= value <= 1:
                raise InvalidParameter(
                    f"the correlation of {first} and {second} must be between -1 and 1; got {value:g}"
                )
            i, j = self.names.index(first), self.names.index(second)
            matrix[i, j] = matrix[j, i] = value
        values, vectors = np.linalg.eigh(matrix)
        if values[0] < -1e-9:
            raise InvalidParameter(
                "correlations must form a positive semidefinite matrix; reduce one of them"
            )
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
