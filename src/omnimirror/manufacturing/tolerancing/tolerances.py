"""How errors are distributed within their tolerances, and how trials draw them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr, ndtri

from ...arguments import check_fields, choice, number, shown
from ...errors import InvalidParameter
from ...mirrors.form import MirrorForm
from ...sensor import Sensor
from .perturbation import MEASURED, check_name, errors_of, measured

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


BLOCK = 8192
"""Trials that are drawn at a time: each block has random numbers of its own, whoever computes it, and when."""
SMALLEST_BOUND, LARGEST_BOUND = 1e-50, 1e6
"""Range of a tolerance other than 0, in any unit: squares of finite differences neither vanish nor overflow."""
LEAST_SHARE = 2.0**-54  # no share is 0, which some distributions send to infinity


@dataclass(frozen=True)
class ErrorBound:
    """Tolerance of one error: half-width and distribution.

    Parameters
    ----------
    value
        Plus or minus, in the error's unit: 0 for none, or 1e-50 to 1e6.
    distribution
        Shape of the distribution within it.

    Raises
    ------
    InvalidParameter
        A value out of range, or an unknown distribution.

    Examples
    --------
    >>> ErrorBound(0.1, "normal")
    ErrorBound(value=0.1, distribution='normal')
    """

    value: float
    distribution: Distribution = "uniform"

    def __post_init__(self) -> None:
        check_fields(self)
        choice("distribution", self.distribution, DISTRIBUTIONS)
        value = number("tolerance", self.value)
        if value != 0 and not SMALLEST_BOUND <= value <= LARGEST_BOUND:
            raise InvalidParameter(
                f"tolerance must be 0, or between {SMALLEST_BOUND:g} and {LARGEST_BOUND:g}; got {value:g}"
            )


@dataclass(frozen=True)
class Tolerances:
    """What is known of a sensor before it is built.

    Parameters
    ----------
    sensor
        What is meant.
    errors
        Tolerances by the names of errors (:func:`omnimirror.manufacturing.tolerancing.perturbation.errors_of`).
    correlations
        Between pairs of errors, from -1 to 1; they are meant of the normal numbers behind each.
    forms
        Form errors by names: the error ``mirror.measured[NAME]`` is so many times that form.

    Raises
    ------
    InvalidParameter
        A name of no error, or correlations that no errors have.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> tolerances = Tolerances(sensor, {"mirror.decentre_x_mm": ErrorBound(0.1)})
    >>> values = tolerances.drawn(seed=1, block=0, count=1000)["mirror.decentre_x_mm"]
    >>> bool(np.abs(values).max() <= 0.1), len(values)
    (True, 1000)
    """

    sensor: Sensor
    errors: Mapping[str, ErrorBound]
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)
    forms: Mapping[str, MirrorForm] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        known = errors_of(self.sensor) | {measured(name): MEASURED for name in self.forms}
        for name in self.errors:
            check_name(name, known)
        if not self.errors:
            raise InvalidParameter("there is no error in the tolerances; name one at least")
        self._mixing()

    @property
    def names(self) -> tuple[str, ...]:
        """Of the errors, in their order."""
        return tuple(self.errors)

    def drawn(self, seed: int, block: int, count: int = BLOCK) -> dict[str, Array]:
        """Errors of the trials of a block, the same whenever they are drawn.

        Parameters
        ----------
        seed
            Of the whole.
        block
            Its number, from 0.
        count
            How many of its trials.

        Returns
        -------
        dict of (n,) arrays
            Of n trials by name, in their units.

        Raises
        ------
        InvalidParameter
            More trials than a block has.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": ErrorBound(0.01)})
        >>> again = [tolerances.drawn(seed=3, block=5, count=10)["lens.k1"] for _ in range(2)]
        >>> bool((again[0] == again[1]).all())
        True
        """
        if not 0 <= count <= BLOCK:
            raise InvalidParameter(f"a block has {BLOCK} trials, and {count} were asked for")
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, block])))
        return self.at(np.maximum(random.random((BLOCK, len(self.errors)))[:count], LEAST_SHARE))

    def at(self, shares: Array) -> dict[str, Array]:
        """Errors at shares (t, n) in (0, 1) of independent numbers, one for each error.

        Parameters
        ----------
        shares : (t, n)
            Uniform ones for trials.

        Returns
        -------
        dict of (n,) arrays
            Of n trials by name, in their units.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": ErrorBound(0.01)})
        >>> tolerances.at(np.array([[0.5], [0.75]]))["lens.k1"]
        array([0.   , 0.005])
        """
        if self.correlations:
            from scipy.special import ndtri

            shares = ndtr(ndtri(shares) @ self._mixing().T)
        columns = zip(self.errors.items(), shares.T, strict=True)
        drawn_ = {name: t.value * drawn(t.distribution, np.ascontiguousarray(share)) for (name, t), share in columns}
        return self.spelt_out(drawn_)

    def spelt_out(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Values (n,) by the names of errors, measured forms as the Zernike terms that they have.

        Parameters
        ----------
        values : dict of (n,) arrays
            By the names of errors.

        Returns
        -------
        dict of (n,) arrays
            The same, with no measured form among them.

        Examples
        --------
        >>> import omnimirror as om
        >>> forms = {"lathe": om.mirrors.form.MirrorForm((5,), (0.3,))}
        >>> errors = {"mirror.measured[lathe]": ErrorBound(1.0)}
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), errors, forms=forms)
        >>> tolerances.spelt_out({"mirror.measured[lathe]": np.array([2.0])})
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
        """Root (n, n) of the correlations, the symmetric one: errors without any keep their own numbers."""
        matrix = np.eye(len(self.errors))
        for pair, value in self.correlations.items():
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise InvalidParameter(f"correlations holds {shown(pair)}; valid are pairs of names of errors")
            first, second = pair
            for name in (first, second):
                if name not in self.errors:
                    raise InvalidParameter(f"the correlation of {first} and {second}: {name} has no tolerance")
            if first == second:
                raise InvalidParameter(f"{first} always comes with itself; a correlation is valid of two errors")
            if not -1 <= value <= 1:
                raise InvalidParameter(f"the correlation of {first} and {second} = {value:g} is valid from -1 to 1")
            i, j = self.names.index(first), self.names.index(second)
            matrix[i, j] = matrix[j, i] = value
        values, vectors = np.linalg.eigh(matrix)
        if values[0] < -1e-9:
            raise InvalidParameter(
                "the correlations contradict one another: no errors have all of them; make one smaller"
            )
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
