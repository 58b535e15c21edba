"""The sharp picture that is looked for: its values on a fine grid, and a round of improving them.

Compiled where it can be, else with sparse matrices, more slowly; both do the same steps.
"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from ...native import backend
from .blurring import Blur

Values = NDArray[np.float32]

EDGE = np.float32(0.005)  # differences of roots below it cost their square, which keeps slopes from becoming stairs
DARK = np.float32(1e-4)  # light below it has no more weight than this
BRIGHTEST = np.float32(2)  # root of light, of white: brighter points would explain white surfaces, black between them
SATURATED = np.float32(0.995)  # such a pixel may have been brighter


class SharpPicture(Protocol):
    """Roots u of its light, of which the fine values that known pixels depend on are looked for."""

    def improve(self, costs: Values, steps: int) -> None:
        """Go towards what makes ``|sqrt(A u^2) - y|^2 / 2 + sum costs |grad u|`` least, A being the blur.

        Both terms are replaced by quadratic ones about u, and so many steps of conjugate gradients are made.

        Parameters
        ----------
        costs : (h, w)
        steps
        """

    def log_steepness(self) -> Values:
        """The mean logarithm (h, w) of the lengths of differences in each pixel, of all channels together; what is
        brighter than white counts as white."""

    def blurred(self) -> Values:
        """Light (n, channels) of the blurred picture, in the pixels that are known."""

    def light(self) -> Values:
        """Light (h, w, channels)."""


class Deblurring(Protocol):
    """What is prepared once for a blur."""

    def start(self, roots: Values) -> SharpPicture:
        """A sharp picture to begin with, from roots (h, w, 1 or 3) of the light of the blurred one."""


def deblurring_of(blur: Blur) -> Deblurring:
    """Compiled if it can be."""
    return CompiledDeblurring(blur) if backend.is_compiled else SparseDeblurring(blur)


class CompiledDeblurring:
    """In C++, on several threads."""

    def __init__(self, blur: Blur) -> None:
        self._known = len(blur.pixels)
        self._kernels = backend.kernels.BlurKernels(
            *blur.size, blur.fineness, blur.firsts, blur.offsets, blur.weights, blur.pixels, blur.kernels, blur.spans
        )

    def start(self, roots: Values) -> SharpPicture:
        return CompiledPicture(self._kernels, roots, self._known)


class CompiledPicture:
    """In C++, on several threads."""

    def __init__(self, kernels: object, roots: Values, known: int) -> None:
        self._sharp = backend.kernels.Sharpening(kernels, np.ascontiguousarray(roots))
        self._shape, self._known = roots.shape, known

    def improve(self, costs: Values, steps: int) -> None:
        self._sharp.improve(np.ascontiguousarray(costs), steps)

    def log_steepness(self) -> Values:
        logarithms = np.empty(self._shape[:2], np.float32)
        self._sharp.log_steepness(logarithms)
        return logarithms

    def blurred(self) -> Values:
        light = np.empty((self._known, self._shape[2]), np.float32)
        self._sharp.blurred(light)
        return light

    def light(self) -> Values:
        light = np.empty(self._shape, np.float32)
        self._sharp.light(light)
        return light


class SparseDeblurring:
    """By SciPy's sparse matrices and NumPy, on one thread."""

    def __init__(self, blur: Blur) -> None:
        self._blur = blur
        self._matrix = blur.matrix()
        self._back = self._matrix.T.tocsr()

    def start(self, roots: Values) -> SharpPicture:
        return SparsePicture(self._blur, self._matrix, self._back, roots)


class SparsePicture:
    """By SciPy's sparse matrices and NumPy, on one thread."""

    def __init__(self, blur: Blur, matrix: Any, back: Any, roots: Values) -> None:
        self._matrix, self._back, self._fineness = matrix, back, blur.fineness
        self._channels = roots.shape[2]
        self._seen = roots.reshape(-1, self._channels)[blur.pixels]
        self._fine = _refined(roots, blur.fineness)
        columns = np.arange(self._fine.shape[1])
        self._depends: Values = ((blur.spans[:, :1] <= columns) & (columns < blur.spans[:, 1:])).astype(np.float32)

    def improve(self, costs: Values, steps: int) -> None:
        steepness = np.exp(_log_steepness(self._fine))
        stiffness = np.asarray(_repeated(costs, self._fineness) / steepness * self._depends, np.float32)
        level = np.sqrt(np.maximum(self.blurred(), DARK))
        counted = (self._seen < SATURATED) | (level < self._seen)
        slope = (counted / level).astype(np.float32)  # of sqrt(A u^2), but for A and u
        pull = self._fine * self._spread(slope * (self._seen - level)) - smoothness(self._fine, stiffness)
        pull *= self._depends[..., None]
        scale = np.reciprocal(4 * stiffness + np.float32(0.5 / self._fineness**4))  # about the inverse of the diagonal
        step = self._conjugate_gradients(slope**2, stiffness, pull, scale[..., None], steps)
        self._fine = np.clip(self._fine + step, 0, BRIGHTEST)

    def log_steepness(self) -> Values:
        return _binned(_log_steepness(np.minimum(self._fine, 1))[..., None], self._fineness)[..., 0]

    def blurred(self) -> Values:
        return self._blurred(self._fine**2)

    def light(self) -> Values:
        return _binned(self._fine**2, self._fineness)

    def _conjugate_gradients(
        self, slope2: Values, stiffness: Values, residual: Values, scale: Values, steps: int
    ) -> Values:
        """Nearly the x whose product with the second derivative is the residual."""
        x = np.zeros_like(residual)
        d = scale * residual
        power = np.vdot(residual, d)
        for _ in range(steps):
            if power <= 0:  # solved already
                break
            product = self._fine * self._spread(slope2 * self._blurred(self._fine * d)) + smoothness(d, stiffness)
            product *= self._depends[..., None]
            step = power / np.vdot(d, product)
            x += step * d
            residual = residual - step * product
            power, before = np.vdot(residual, scale * residual), power
            d = scale * residual + power / before * d
        return x

    def _blurred(self, fine: Values) -> Values:
        return np.asarray(self._matrix @ fine.reshape(-1, self._channels))

    def _spread(self, blurred: Values) -> Values:
        return np.asarray(self._back @ blurred).reshape(self._fine.shape)


def smoothness(d: Values, stiffness: Values) -> Values:
    """The transpose of differences, times stiffness (rows, columns), times the differences of d (rows, columns, n)."""
    right, down = differences(d)
    right *= stiffness[..., None]
    down *= stiffness[..., None]
    back = -right - down
    back[:, 1:] += right[:, :-1]
    back[1:] += down[:-1]
    return back


def differences(picture: Values) -> tuple[Values, Values]:
    """To the neighbour on the right, and below; 0 at the end."""
    right, down = np.zeros_like(picture), np.zeros_like(picture)
    np.subtract(picture[:, 1:], picture[:, :-1], out=right[:, :-1])
    np.subtract(picture[1:], picture[:-1], out=down[:-1])
    return right, down


def _log_steepness(fine: Values) -> Values:
    """Logarithms (rows, columns) of the lengths of the differences, of all channels together."""
    right, down = differences(fine)
    squares = (right**2 + down**2).sum(axis=2)
    return np.asarray(np.log(squares + EDGE**2) / 2, np.float32)


def _refined(roots: Values, fineness: int) -> Values:
    """On a finer grid to begin with, without the stairs of pixels, which would be taken for edges."""
    fine = _repeated(roots, fineness)
    return np.asarray(cv2.blur(fine, (fineness, fineness)), np.float32).reshape(fine.shape)


def _repeated(values: Values, fineness: int) -> Values:
    """Every value of a picture, in each of its parts on the fine grid."""
    return np.repeat(np.repeat(values, fineness, axis=0), fineness, axis=1)


def _binned(fine: Values, fineness: int) -> Values:
    """Means (h, w, channels) of the values in each pixel."""
    rows, columns, channels = fine.shape
    means: Values = fine.reshape(rows // fineness, fineness, columns // fineness, fineness, channels).mean(axis=(1, 3))
    return means
