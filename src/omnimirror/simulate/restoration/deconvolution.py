"""The sharp picture that explains a blurred one within its noise.

Looked for on a grid finer than the pixels, it is what explains the blurred picture and has little total variation
(Rudin, Osher and Fatemi, 1992). Blur adds light, and noise is even in a picture as files hold it; so the unknown u is
the root of the light, which is near to what files hold, and

    |sqrt(A u^2) - y|^2 / 2 + sum weight |grad u|

is made small, A being the blur. Both terms are replaced by quadratic ones a few times (Gauss-Newton, and lagged
diffusivity: Vogel and Oman, 1996), each solved by conjugate gradients.

The weight follows the picture, as Bayes asks for: where u is full of texture beyond the noise, variation is likely
and costs less, and where it is plain, more. It falls with the blur, which damps noise of its own accord.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .operators import Operator, differences, smoothness

Values = NDArray[np.float32]

# Tuned on the scenes of `benchmarks/restoration_gain.py --tuning` (room, street, clouds of noise), and but for the
# brightest, which lamps among leaves and windows of a photograph chose, on no others.
REGULARITY = 1.5  # the weight over the noise, where there is neither blur nor texture
BLUR_PX = 0.7  # widening of pixels that halves it
TEXTURE = 2.0  # differences that halve it, over the noise
EDGE = np.float32(0.005)  # differences of u below it cost their square, which keeps slopes from becoming stairs

ROUNDS, STEPS = 6, 8  # replacements by quadratic terms, and conjugate gradients in each
WINDOW_PX = 16  # in which texture is judged
UNJUDGED = np.float32(0.7)  # of texture, in the first round
DARK = np.float32(1e-4)  # light below it has no more weight than this
BRIGHTEST = np.float32(2)  # root of light, of white: brighter points would explain white surfaces, black between them
SATURATED = np.float32(0.995)  # such a pixel may have been brighter


def solve(
    operator: Operator,
    pixels: NDArray[np.int32],
    widening_px: Values,
    roots: Values,
    noise: Values,
    visible: Values,
    rounds: int = ROUNDS,
    steps: int = STEPS,
) -> Values:
    """Roots of the light (rows, columns, channels) of the sharp picture, on its fine grid.

    Parameters
    ----------
    operator
        Of the blur.
    pixels : (n,)
        That it knows: row * width + column.
    widening_px : (h, w)
        By how much the blur widens a pixel, in the mean of both directions.
    roots : (h, w, 1 or 3)
        Roots of the light of the blurred picture.
    noise : (h, w)
        Standard deviation of the roots.
    visible : (h, w)
        As much of it as the picture shows: differences over that are texture.
    rounds, steps
        Replacements by quadratic terms, and steps of conjugate gradients in each.
    """
    channels = roots.shape[2]
    if channels == 3:  # operators take four
        roots = np.pad(roots, ((0, 0), (0, 0), (0, 1)))
    fineness = operator.shape[1] // roots.shape[1]
    seen = roots.reshape(-1, roots.shape[2])[pixels]
    costs = _repeated((REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32), fineness)
    texture = _repeated(TEXTURE * visible, fineness)
    flat = _refined(roots, fineness).reshape(-1, roots.shape[2])
    for n in range(rounds):
        fine = flat.reshape(*operator.shape, -1)
        steepness = _steepness(fine)
        # what saturates is far brighter than its surroundings, which are not textured for that
        plain = _plain(_steepness(np.minimum(fine, 1)), texture, fineness) if n else UNJUDGED
        stiffness = (costs * plain / steepness).ravel()
        flat = np.clip(flat + _step(operator, flat, seen, stiffness, fineness, steps), 0, BRIGHTEST)
    return flat.reshape(*operator.shape, -1)[..., :channels]


def texture_of(fine: Values, noise: Values) -> Values:
    """How textured (h, w) a sharp picture (rows, columns, channels) on a fine grid is, 0 to 1: a half where its
    differences are those that cost half, by the noise (h, w) of the root of the blurred one."""
    fineness = fine.shape[0] // noise.shape[0]
    plain = _plain(_steepness(np.minimum(fine, 1)), _repeated(TEXTURE * noise, fineness), fineness)
    return np.asarray(1 - cv2.resize(plain, noise.shape[::-1], interpolation=cv2.INTER_AREA), np.float32)


def _step(operator: Operator, flat: Values, seen: Values, stiffness: Values, fineness: int, steps: int) -> Values:
    """From values (places, channels) of the fine grid towards those that make the quadratic terms about them least."""
    level = np.sqrt(np.maximum(operator.blur(flat**2), DARK))
    counted = (seen < SATURATED) | (level < seen)
    slope = (counted / level).astype(np.float32)  # of sqrt(A u^2), but for A and u
    pull = flat * operator.spread(slope * (seen - level)) - smoothness(flat, stiffness, operator.shape)
    scale = np.reciprocal(4 * stiffness + np.float32(0.5 / fineness**4))  # about the inverse of the diagonal
    return _conjugate_gradients(operator, flat, slope**2, stiffness, pull, scale, steps)


def _conjugate_gradients(
    operator: Operator,
    fine: Values,
    slope2: Values,
    stiffness: Values,
    residual: Values,
    scale: Values,
    steps: int,
) -> Values:
    """Nearly the x whose product with the second derivative is the residual, which is used up."""
    x = np.zeros_like(residual)
    d = scale[:, None] * residual
    product = np.empty_like(d)
    power = float(np.vdot(residual, d))
    for _ in range(steps):
        if power <= 0:  # solved already
            break
        bend = operator.curvature_times(fine, slope2, stiffness, d, product)
        power, before = operator.advance(power / bend, d, product, scale, x, residual), power
        operator.turn(power / before, scale, residual, d)
    return x


def _steepness(fine: Values) -> Values:
    """Lengths (rows, columns) of the differences, of all channels together."""
    right, down = differences(fine)
    squares = np.einsum("...c,...c", right, right) + np.einsum("...c,...c", down, down)
    steepness: Values = np.sqrt(squares + EDGE**2)
    return steepness


def _plain(steepness: Values, textured: Values, fineness: int) -> Values:
    """Near 1 where the picture is plain, a half where its differences are those that count as textured, or less.

    Texture is judged by the geometric mean of the differences, to which a single edge adds little.
    """
    window = (WINDOW_PX * fineness,) * 2
    texture = np.exp(cv2.boxFilter(np.log(steepness), cv2.CV_32F, window))
    return np.asarray(1 / (1 + texture / textured), np.float32)


def _refined(roots: Values, fineness: int) -> Values:
    """On a finer grid to begin with, without the stairs of pixels, which would be taken for edges."""
    fine = _repeated(roots, fineness)
    return np.asarray(cv2.blur(fine, (fineness, fineness)), np.float32).reshape(fine.shape)


def _repeated(values: Values, fineness: int) -> Values:
    """Every value of a picture, in each of its parts on the fine grid."""
    return np.repeat(np.repeat(values, fineness, axis=0), fineness, axis=1)
