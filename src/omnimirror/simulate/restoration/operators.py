"""What solving for a sharp picture takes of a blur: its products, and those of the second derivative.

Values are float32 (places, channels), of 1 or 4 channels: of the fine grid, or of the pixels that the blur knows.
Compiled where they can be, else as sparse matrices, more slowly; both do the same steps.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from ...native import backend
from .blurring import Blur

Values = NDArray[np.float32]


class Operator(Protocol):
    """Products with a blur A of a fine grid of ``shape`` (rows, columns)."""

    shape: tuple[int, int]

    def blur(self, fine: Values) -> Values:
        """A times values of the fine grid."""

    def spread(self, blurred: Values) -> Values:
        """The transpose of A times values of pixels."""

    def curvature_times(self, fine: Values, slope2: Values, stiffness: Values, d: Values, product: Values) -> float:
        """``product`` becomes (fine A^T slope2 A fine + smoothness) d, and its scalar product with d is returned.

        The smoothness is the sum of the squares of differences, times the ``stiffness`` (places,) of the value
        that they start at.
        """

    def advance(self, step: float, d: Values, product: Values, scale: Values, x: Values, residual: Values) -> float:
        """A step of conjugate gradients: x grows, the residual shrinks; returns its square times ``scale``."""

    def turn(self, share: float, scale: Values, residual: Values, d: Values) -> None:
        """The next direction: ``scale`` (places,) times residual, and a share of the last."""


def operator_of(blur: Blur) -> Operator:
    """The products of a blur, compiled if they can be."""
    return CompiledOperator(blur) if backend.is_compiled else SparseOperator(blur)


class CompiledOperator:
    """In C++, on several threads."""

    def __init__(self, blur: Blur) -> None:
        self._kernels = backend.kernels.BlurKernels(
            *blur.size, blur.fineness, blur.firsts, blur.offsets, blur.weights, blur.pixels, blur.kernels
        )
        self._pixels = len(blur.pixels)
        self.shape = (blur.size[1] * blur.fineness, blur.size[0] * blur.fineness)

    def blur(self, fine: Values) -> Values:
        blurred = np.empty((self._pixels, fine.shape[1]), np.float32)
        self._kernels.blur(fine, blurred)
        return blurred

    def spread(self, blurred: Values) -> Values:
        fine = np.empty((self.shape[0] * self.shape[1], blurred.shape[1]), np.float32)
        self._kernels.spread(blurred, fine)
        return fine

    def curvature_times(self, fine: Values, slope2: Values, stiffness: Values, d: Values, product: Values) -> float:
        return self._kernels.curvature_times(fine, slope2, stiffness, d, product, np.empty_like(slope2))

    def advance(self, step: float, d: Values, product: Values, scale: Values, x: Values, residual: Values) -> float:
        return backend.kernels.advance_solution(step, d, product, scale, x, residual)

    def turn(self, share: float, scale: Values, residual: Values, d: Values) -> None:
        backend.kernels.turn_direction(share, scale, residual, d)


class SparseOperator:
    """By SciPy's sparse matrices and NumPy, on one thread."""

    def __init__(self, blur: Blur) -> None:
        self._matrix = blur.matrix()
        self._back = self._matrix.T.tocsr()
        self.shape = (blur.size[1] * blur.fineness, blur.size[0] * blur.fineness)

    def blur(self, fine: Values) -> Values:
        blurred: Values = self._matrix @ fine
        return blurred

    def spread(self, blurred: Values) -> Values:
        fine: Values = self._back @ blurred
        return fine

    def curvature_times(self, fine: Values, slope2: Values, stiffness: Values, d: Values, product: Values) -> float:
        product[...] = fine * self.spread(slope2 * self.blur(fine * d))
        product += smoothness(d, stiffness, self.shape)
        return float(np.vdot(d, product))

    def advance(self, step: float, d: Values, product: Values, scale: Values, x: Values, residual: Values) -> float:
        x += np.float32(step) * d
        residual -= np.float32(step) * product
        return float(np.vdot(residual, scale[:, None] * residual))

    def turn(self, share: float, scale: Values, residual: Values, d: Values) -> None:
        d *= np.float32(share)
        d += scale[:, None] * residual


def smoothness(d: Values, stiffness: Values, shape: tuple[int, int]) -> Values:
    """The transpose of differences, times stiffness, times the differences of d."""
    right, down = differences(d.reshape(*shape, -1))
    right *= stiffness.reshape(*shape, 1)
    down *= stiffness.reshape(*shape, 1)
    back = -right - down
    back[:, 1:] += right[:, :-1]
    back[1:] += down[:-1]
    return back.reshape(d.shape)


def differences(picture: Values) -> tuple[Values, Values]:
    """To the neighbour on the right, and below; 0 at the end."""
    right, down = np.zeros_like(picture), np.zeros_like(picture)
    np.subtract(picture[:, 1:], picture[:, :-1], out=right[:, :-1])
    np.subtract(picture[1:], picture[:-1], out=down[:-1])
    return right, down
