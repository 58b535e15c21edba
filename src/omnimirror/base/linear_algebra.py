"""Matrix products with small matrices in the thread of the caller."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_MULTIPLICATIONS = 1 << 17
"""Maximum number of multiplications per product; OpenBLAS uses threads from twice as many."""


def matrix_product(rows: NDArray[Any], matrix: NDArray[Any]) -> NDArray[Any]:
    """Compute ``rows @ matrix`` for many rows (n, d) and a matrix (d, k), k at least 2, in blocks.

    OpenBLAS distributes large products over its own threads. These spin for 0.1 s after each
    product, and occasionally mix up rows of concurrent callers (0.3.31, some rows in one of 40
    calls with three threads).

    >>> matrix_product(np.ones((3, 2)), np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[4., 6.],
           [4., 6.],
           [4., 6.]])
    """
    result = np.empty((len(rows), matrix.shape[1]), np.result_type(rows, matrix))
    count = max(1, MAX_MULTIPLICATIONS // matrix.size)
    for first in range(0, len(rows), count):
        piece = slice(first, first + count)
        np.matmul(rows[piece], matrix, out=result[piece])
    return result
