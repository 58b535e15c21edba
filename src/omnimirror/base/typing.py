"""Types of arrays."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Array of double-precision numbers."""
Mask = NDArray[np.bool_]
"""Boolean array."""
