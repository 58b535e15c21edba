"""Estimation of the sharp image that explains a blurred one within its noise.

On a grid finer than the pixels, the sharp image explains the blurred image and has small total
variation (Rudin, Osher and Fatemi, 1992). Blur adds light, and noise is uniform in gamma-coded
images; the unknown u is therefore the square root of the light, which is close to the coded values,
and

    |sqrt(A u^2) - y|^2 / 2 + sum weight |grad u|

is minimised, with the blur operator A. Both terms are approximated by quadratic ones a few times
(Gauss-Newton, and lagged diffusivity: Vogel and Oman, 1996), each solved by conjugate gradients.

For large blur, most rounds are performed on the pixel grid, at 1/4 of the cost, and the fine grid
only restores the aliased components: one round fewer for tiles with large blur throughout.

The weight is adaptive in the Bayesian sense: lower in textured regions, because variation is
likely, and higher in uniform regions. It decreases with the blur, which damps noise itself.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .blurring import Whole
from .sharp_picture import Deblurring, SharpPicture

Values = NDArray[np.float32]

# Tuned on the scenes of `benchmarks/restoration_gain.py --tuning` (room, street, noise clouds)
# only, except for the maximum brightness, which was chosen for lamps among leaves and windows in a
# photograph.
REGULARITY = 1.5  # weight relative to the noise, without blur and texture
# Weight of :func:`fit`: the residual is then unexplained by the blur rather than a cost of the variation
FIT_REGULARITY = 0.5
BLUR_PX = 0.7  # widening of pixels that halves it
TEXTURE = 2.0  # differences that halve it, relative to the noise

LARGE_PX = 3.0  # median widening of pixels from which the blur is large
UNEVEN_PX = 3.0  # widening anywhere that requires more steps
SPARED_PX = 4.0  # minimum widening of a tile for which the last round on the fine grid has no visible effect
COARSE = 3.0  # weight factor on the pixel grid: 2 to 4 differ by 0.2 dB; rooms and streets gain most with 2
WINDOW_PX = 16  # window of the texture measure
UNJUDGED = np.float32(0.7)  # assumed texture in the first round


class Effort(NamedTuple):
    """Numbers of quadratic approximations on the pixel grid and on the fine grid, and of steps in
    each.
    """

    coarse_rounds: int
    rounds: int
    steps: int
    """Conjugate gradient steps."""


# By blur. An initial estimate on the pixel grid costs the equidistant sensor 0.5 dB for small blur.
SMALL, UNEVEN, LARGE = Effort(0, 4, 4), Effort(0, 5, 5), Effort(coarse_rounds=6, rounds=2, steps=6)


def solve(
    deblurrings: tuple[Deblurring | None, Deblurring],
    widening_px: Values,
    roots: Values,
    noise: Values,
    visible: Values,
    effort: Effort,
) -> SharpPicture:
    """Compute the sharp image.

    Parameters
    ----------
    deblurrings
        Deblurring operators on the pixel grid, if rounds are performed on it, and on the fine grid.
    widening_px : (h, w)
        Widening of a pixel by the blur, mean of both directions.
    roots : (h, w, 1 or 3)
        Square roots of the light of the blurred image.
    noise : (h, w)
        Standard deviation of the roots.
    visible : (h, w)
        Visible part of the standard deviation: larger differences are texture.
    effort
        Rounds and steps.
    """
    costs = (REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32)
    coarse, fine = deblurrings
    guess = roots if coarse is None else _begun(coarse, np.float32(COARSE) * costs, roots, visible, effort)
    sharp = fine.start(roots, guess)
    steps = np.full(len(fine.tiles), effort.steps, np.int32)
    for n in range(effort.rounds):
        is_judged = n > 0 or coarse is not None
        if coarse is not None and n == effort.rounds - 1:
            steps[_least(fine.tiles, widening_px) > SPARED_PX] = 0
        sharp.improve(costs * (_plain(sharp, visible) if is_judged else UNJUDGED), steps)
    return sharp


def _least(tiles: Whole, values: Values) -> Values:
    """Return the minima (n,) of values (h, w) over the kept pixels of each tile."""
    return np.array([values[top:bottom, left:right].min() for top, bottom, left, right in tiles[:, 0]], np.float32)


def _begun(coarse: Deblurring, costs: Values, roots: Values, visible: Values, effort: Effort) -> Values:
    """Return the square roots (h, w, channels) of the light of the sharp image at the resolution of
    the pixel grid.
    """
    return np.sqrt(_improved(coarse, costs, roots, visible, effort).light())


def _improved(coarse: Deblurring, costs: Values, roots: Values, visible: Values, effort: Effort) -> SharpPicture:
    sharp = coarse.start(roots, roots)
    steps = np.full(len(coarse.tiles), effort.steps, np.int32)
    for n in range(effort.coarse_rounds):
        sharp.improve(costs * (_plain(sharp, visible) if n else UNJUDGED), steps)
    return sharp


def fit(
    coarse: Deblurring, widening_px: Values, roots: Values, noise: Values, visible: Values, effort: Effort
) -> SharpPicture:
    """Return a weakly regularised sharp image on the pixel grid that explains as much as the blur
    permits.

    Parameters are as in :func:`solve`.
    """
    costs = (FIT_REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32)
    return _improved(coarse, costs, roots, visible, effort)


def texture_of(sharp: SharpPicture, noise: Values) -> Values:
    """Return the texture measure (h, w) of a sharp image, 0 to 1.

    It is 0.5 for differences that halve the weight, relative to the noise (h, w) of the root of the
    blurred image.
    """
    return np.asarray(1 - _plain(sharp, noise), np.float32)


def _plain(sharp: SharpPicture, noise: Values) -> Values:
    """Return a value near 1 for uniform regions, and 0.5 or less for textured ones.

    Texture is measured with the geometric mean of the differences, which is insensitive to single
    edges. Saturated pixels are far brighter than their surroundings, which are not counted as
    textured.
    """
    texture = np.exp(cv2.boxFilter(sharp.log_steepness(), cv2.CV_32F, (WINDOW_PX, WINDOW_PX)))
    return np.asarray(1 / (1 + texture / (np.float32(TEXTURE) * noise)), np.float32)
