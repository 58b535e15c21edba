"""Blocked products compared with NumPy, without waking BLAS threads."""

import subprocess
import sys

import numpy as np
import pytest

from omnimirror.base.numerics import MAX_MULTIPLICATIONS, matrix_product


@pytest.mark.parametrize("kind", [np.float32, np.float64])
@pytest.mark.parametrize(
    ("rows", "shape"), [(0, (3, 3)), (1, (3, 3)), (40_000, (3, 3)), (2_000, (169, 2))]
)
def test_matrix_product_in_blocks(rows, shape, kind):
    rng = np.random.default_rng(rows)
    values, matrix = (
        rng.normal(size=(rows, shape[0])).astype(kind),
        rng.normal(size=shape).astype(kind),
    )
    product = matrix_product(values, matrix)
    assert product.dtype == kind
    np.testing.assert_allclose(
        product,
        values.astype(float) @ matrix.astype(float),
        rtol=0,
        atol=1e-4 if kind == np.float32 else 1e-12,
    )


@pytest.mark.parametrize("columns", [2, 500])
def test_matrix_larger_than_block_is_multiplied_by_rows(columns):
    rng = np.random.default_rng(columns)
    values, matrix = (
        rng.normal(size=(3, MAX_MULTIPLICATIONS // columns + 1)),
        rng.normal(size=(MAX_MULTIPLICATIONS // columns + 1, columns)),
    )
    np.testing.assert_allclose(matrix_product(values, matrix), values @ matrix, rtol=0, atol=1e-9)


IDLE = """
import os, threading
import numpy as np
from omnimirror.base.numerics import matrix_product

def others():
    mine, ticks = threading.get_native_id(), 0
    for thread in os.listdir("/proc/self/task"):
        if int(thread) != mine:
            with open(f"/proc/self/task/{thread}/stat") as stat:
                ticks += sum(map(int, stat.read().rsplit(")", 1)[1].split()[11:13]))
    return ticks

values, matrix = np.ones((300_000, 24)), np.ones((24, 2))
before = others()
for _ in range(20):
    matrix_product(values, matrix)
print(others() - before)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="threads are told by /proc")
def test_matrix_product_uses_no_other_thread():
    """The plain product would cause hundreds of ticks in busy-waiting threads."""
    run = subprocess.run([sys.executable, "-c", IDLE], capture_output=True, text=True, check=True)
    assert int(run.stdout) <= 1
