"""Flat mirror: it displaces the image without changing its shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import coordinates
from ...base.parameters import Parameter
from ...base.typing import Array
from .base import RIM_RADIUS, Mirror


@dataclass(frozen=True)
class Flat(Mirror):
    """Flat mirror ``z = 0``, which folds the path between mirror and lens.

    >>> Flat(rim_radius_mm=20.0).sag([0.0, 10.0])
    array([0., 0.])
    """

    rim_radius_mm: float

    KIND: ClassVar[str] = "flat"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {"rim_radius_mm": RIM_RADIUS}

    def __post_init__(self) -> None:
        self._check()

    def profile(self, x_mm: ArrayLike) -> tuple[Array, Array, Array]:
        zero = np.zeros_like(coordinates("x_mm", x_mm))
        return zero, zero, zero
