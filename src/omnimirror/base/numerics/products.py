"""Products with small matrices that stay in the thread that asks for them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGEST = 1 << 17
"""Multiplications of one product; from twice as many on OpenBLAS shares them out."""


def product(rows: NDArray[Any], matrix: NDArray[Any]) -> NDArray[Any]:
    """``rows @ matrix`` of many rows (n, d) and a matrix (d, k), k at least 2, in pieces.

    OpenBLAS shares large products out among threads of its own. Those wait busily for more, a tenth of a second long,
    and it mixes up the rows of several callers now and then (0.3.31, some rows in one call of forty with three).

    >>> product(np.ones((3, 2)), np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[4., 6.],
           [4., 6.],
           [4., 6.]])
    """
    result = np.empty((len(rows), matrix.shape[1]), np.result_type(rows, matrix))
    count = max(1, LARGEST // matrix.size)
    for first in range(0, len(rows), count):
        piece = slice(first, first + count)
        np.matmul(rows[piece], matrix, out=result[piece])
    return result
