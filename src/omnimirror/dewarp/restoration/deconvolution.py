"""The sharp picture that explains a blurred one within its noise.

Looked for on a grid finer than the pixels, it is what explains the blurred picture and has little total variation
(Rudin, Osher and Fatemi, 1992). Blur adds light, and noise is even in a picture as files hold it; so the unknown u is
the root of the light, which is near to what files hold, and

    |sqrt(A u^2) - y|^2 / 2 + sum weight |grad u|

is made small, A being the blur. Both terms are replaced by quadratic ones a few times (Gauss-Newton, and lagged
diffusivity: Vogel and Oman, 1996), each solved by conjugate gradients.

Where the blur is large, most of the way is gone on the grid of the pixels, which costs a quarter, and the fine grid has
only to give back what they alias: a round less of it where the blur is large throughout a tile.

The weight follows the picture, as Bayes asks for: where u is full of texture beyond the noise, variation is likely
and costs less, and where it is plain, more. It falls with the blur, which damps noise of its own accord.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .blurring import Whole
from .sharp_picture import Deblurring, SharpPicture

Values = NDArray[np.float32]

# Tuned on the scenes of `benchmarks/restoration_gain.py --tuning` (room, street, clouds of noise), and but for what is
# brightest, which lamps among leaves and windows of a photograph chose, on no others.
REGULARITY = 1.5  # the weight over the noise, where there is neither blur nor texture
FIT_REGULARITY = 0.5  # of :func:`fit`: what remains is then what the blur cannot explain, not what variation costs
BLUR_PX = 0.7  # widening of pixels that halves it
TEXTURE = 2.0  # differences that halve it, over the noise

LARGE_PX = 3.0  # widening of half of the pixels from which blur is large
UNEVEN_PX = 3.0  # widening anywhere from which the few steps are too few
SPARED_PX = 4.0  # widening all over a tile, from which the last round on the fine grid gains nothing that is seen
COARSE = 3.0  # times the weight on the grid of the pixels: 2 to 4 differ by .2 dB, rooms and streets gaining most by 2
WINDOW_PX = 16  # in which texture is judged
UNJUDGED = np.float32(0.7)  # of texture, in the first round


class Effort(NamedTuple):
    """Replacements by quadratic terms, on the grid of the pixels and on the fine one, and steps in each."""

    coarse_rounds: int
    rounds: int
    steps: int
    """Of conjugate gradients."""


# By the blur. Begun on the grid of the pixels, the equidistant sensor loses .5 dB where its blur is small.
SMALL, UNEVEN, LARGE = Effort(0, 4, 4), Effort(0, 5, 5), Effort(coarse_rounds=6, rounds=2, steps=6)


def solve(
    deblurrings: tuple[Deblurring | None, Deblurring],
    widening_px: Values,
    roots: Values,
    noise: Values,
    visible: Values,
    effort: Effort,
) -> SharpPicture:
    """The sharp picture.

    Parameters
    ----------
    deblurrings
        Of the blur, on the grid of the pixels, if there are rounds on it, and on the fine one.
    widening_px : (h, w)
        By how much the blur widens a pixel, in the mean of both directions.
    roots : (h, w, 1 or 3)
        Roots of the light of the blurred picture.
    noise : (h, w)
        Standard deviation of the roots.
    visible : (h, w)
        As much of it as the picture shows: differences over that are texture.
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
    """Of values (h, w), the least (n,) that each tile keeps."""
    return np.array([values[top:bottom, left:right].min() for top, bottom, left, right in tiles[:, 0]], np.float32)


def _begun(coarse: Deblurring, costs: Values, roots: Values, visible: Values, effort: Effort) -> Values:
    """Return the roots (h, w, channels) of the light of the sharp image as far as the pixel grid allows."""
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
    """Return a weakly regularised sharp image on the pixel grid, which explains whatever the blur can explain.

    Parameters as for :func:`solve`.
    """
    costs = (FIT_REGULARITY * noise / (1 + widening_px / BLUR_PX)).astype(np.float32)
    return _improved(coarse, costs, roots, visible, effort)


def texture_of(sharp: SharpPicture, noise: Values) -> Values:
    """How textured (h, w) a sharp picture is, 0 to 1: a half where its differences are those that cost half, by the
    noise (h, w) of the root of the blurred one."""
    return np.asarray(1 - _plain(sharp, noise), np.float32)


def _plain(sharp: SharpPicture, noise: Values) -> Values:
    """Near 1 where the picture is plain, a half where its differences are those that count as textured, or less.

    Texture is judged by the geometric mean of the differences, to which a single edge adds little. What saturates is
    far brighter than its surroundings, which are not textured for that.
    """
    texture = np.exp(cv2.boxFilter(sharp.log_steepness(), cv2.CV_32F, (WINDOW_PX, WINDOW_PX)))
    return np.asarray(1 / (1 + texture / (np.float32(TEXTURE) * noise)), np.float32)
