"""Forbes polynomials of rotationally symmetric aspheres (Opt. Express 15, 5218; 18, 13851)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..typing import Array


def qbfs_values(u: ArrayLike, count: int) -> Array:
    """Compute ``u^2 (1 - u^2) Q_m(u^2)``, (n, count), at normalised radii u (n,), m from 0.

    These are the terms of an asphere relative to its best-fit sphere, along the normal of the
    sphere. The mean square slope over the angle asin(u) is the sum of the squared coefficients.

    >>> qbfs_values([0.5], 3).round(6)  # Q0 = 1, Q1 = (13 - 16 u^2)/sqrt(19)
    array([[0.1875  , 0.387139, 0.238047]])
    """
    # Recurrences of Forbes (Opt. Express 18, 13851), which make the slopes orthonormal, x = u^2:
    # P_m = (2 - 4 x) P_(m-1) - P_(m-2), Q_m = (P_m - g_(m-1) Q_(m-1) - h_(m-2) Q_(m-2)) / f_m.
    x = np.asarray(u, dtype=float) ** 2
    p, q = [2.0 + 0 * x, 6.0 - 8.0 * x], [1.0 + 0 * x, (13.0 - 16.0 * x) / np.sqrt(19.0)]
    f, g = [2.0, np.sqrt(19.0) / 2], [-0.5]
    for m in range(2, count):
        h = -m * (m - 1) / (2 * f[m - 2])
        g.append(-(1 + g[m - 2] * h) / f[m - 1])
        f.append(np.sqrt(m * (m + 1) + 3 - g[m - 1] ** 2 - h**2))
        p.append((2 - 4 * x) * p[m - 1] - p[m - 2])
        q.append((p[m] - g[m - 1] * q[m - 1] - h * q[m - 2]) / f[m])
    values: Array = (x * (1 - x))[:, None] * np.stack(q[:count], axis=1)
    return values
