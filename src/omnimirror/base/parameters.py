"""Descriptions of parameters of sensor parts, and the uncertainty of estimated parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .arguments import finite, format_value, numbers, optional_number
from .errors import InvalidParameter


@dataclass(frozen=True)
class Parameter:
    """Description of one parameter for sensor files, sliders, optimisers and tolerances."""

    unit: str
    low: float
    high: float
    description: str = ""
    choices: tuple[str, ...] = field(default=())
    """Valid words, for a parameter that is a word."""

    def check(self, name: str, value: Any) -> None:
        """Raise InvalidParameter with the valid range unless all numbers in value are within it."""
        if self.choices:
            if not isinstance(value, str) or value not in self.choices:
                raise InvalidParameter(
                    f"{name} must be one of {', '.join(c or repr(c) for c in self.choices)}; "
                    f"got {format_value(value)}"
                )
            return
        if type(value) is float and self.low <= value <= self.high:
            return  # fast path
        if isinstance(value, list | tuple) and not value:
            return  # the number of values is checked by the part
        for i, number in enumerate(numbers(name, value).ravel()):
            if not self.low <= number <= self.high:
                label = f"{name}[{i}]" if np.ndim(value) else name
                unit = f" {self.unit}" if self.unit else ""
                raise InvalidParameter(
                    f"{label} must be between {self.low:g} and {self.high:g}{unit}; got {number:g}"
                )


MIN_RELATIVE_EIGENVALUE = (
    -1e-9
)  # eigenvalue of a covariance; smaller magnitudes are rounding errors


@dataclass(frozen=True)
class Uncertainty:
    """Covariance of estimated parameters; parameters without an entry are exact.

    Parameters
    ----------
    names
        Names of the parameters.
    covariance : (n, n)
        Covariance in the units of the parameters.
    field_deg : deg, optional
        Calibrated field: the largest field angle with measured points, from the image centre.
        Beyond it the model is an extrapolation without a valid covariance. None: unknown.
    marginal_sigmas : (n,), optional
        Standard deviations of the single parameters, if they differ from the square roots of
        the diagonal: along a curved valley of weakly determined parameters they are larger or
        smaller, while the covariance is valid for directions.

    Raises
    ------
    InvalidParameter
        If the matrix is not a covariance.

    Examples
    --------
    >>> Uncertainty(("cx", "cy"), ((0.04, 0.0), (0.0, 0.09))).sigmas
    {'cx': 0.2, 'cy': 0.3}
    """

    names: tuple[str, ...]
    covariance: tuple[tuple[float, ...], ...]
    field_deg: float | None = None
    marginal_sigmas: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(
            self, "covariance", tuple(tuple(float(x) for x in row) for row in self.covariance)
        )
        count = len(self.names)
        if not count or len(set(self.names)) != count:
            raise InvalidParameter(
                f"names must be different names of parameters; got {format_value(self.names)}"
            )
        if len(self.covariance) != count or any(len(row) != count for row in self.covariance):
            raise InvalidParameter(
                f"covariance must have the shape ({count}, {count}) for {count} names"
            )
        matrix = finite("covariance", self.covariance)
        scale = np.sqrt(np.abs(np.diag(matrix)))
        scale[scale == 0] = 1.0
        correlations = matrix / np.outer(scale, scale)
        if not np.allclose(correlations, correlations.T, rtol=0, atol=1e-9):
            raise InvalidParameter("covariance must be symmetric")
        values = np.linalg.eigvalsh(correlations)
        if values[0] < MIN_RELATIVE_EIGENVALUE * values[-1]:
            raise InvalidParameter("covariance must have no negative eigenvalues")
        optional_number("field_deg", self.field_deg, above=0.0, high=180.0, unit="deg")
        if self.marginal_sigmas is not None:
            marginal = finite("marginal_sigmas", self.marginal_sigmas, 0.0)
            if marginal.shape != (count,):
                raise InvalidParameter(
                    f"marginal_sigmas must have the shape ({count},) of names; got shape {marginal.shape}"
                )
            object.__setattr__(self, "marginal_sigmas", tuple(marginal.tolist()))

    @property
    def sigmas(self) -> dict[str, float]:
        """Standard deviation of each parameter."""
        if self.marginal_sigmas is not None:
            return dict(zip(self.names, self.marginal_sigmas, strict=True))
        return {
            name: float(row[i] ** 0.5)
            for i, (name, row) in enumerate(zip(self.names, self.covariance, strict=True))
        }

    def of(self, names: Sequence[str]) -> NDArray[np.float64]:
        """Return the covariance (n, n) of named parameters, 0 for exact ones.

        Raises
        ------
        InvalidParameter
            If the estimated parameters are not among the names.
        """
        if unknown := set(self.names) - set(names):
            raise InvalidParameter(
                f"the parameters of the uncertainty must be from {', '.join(names)}; got {', '.join(sorted(unknown))}"
            )
        indices = [list(names).index(name) for name in self.names]
        matrix = np.zeros((len(names), len(names)))
        matrix[np.ix_(indices, indices)] = self.covariance
        return matrix
