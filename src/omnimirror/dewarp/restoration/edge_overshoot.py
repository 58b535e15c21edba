"""Overshoot at edges, an indicator of sharpened images.

Blur makes an isolated edge rise monotonically; an unsharp mask adds a brighter and a darker line
next to it. Restoration would amplify these lines, and the noise or texture amplified by sharpening.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Values = NDArray[np.float32]

MAX_OVERSHOOT = 0.016  # median, relative to the step; images without sharpening have -0.02 to 0.015
MAX_OVERSHOOT_UNCODED = 0.06  # same for uncoded images, which are rarely sharpened
MIN_STEP, MIN_STEP_OF_NOISE = 0.08, 8.0  # between adjacent pixels: of full scale, and of the noise
FLATNESS = 0.08  # range of the values beyond an isolated edge, relative to the step
NEAREST, FARTHEST = 4, 7  # px from the edge in which they are compared
MIN_EDGES = 30


def overshoot(image: Values, inside: NDArray[np.bool_], noise: float = 0.0) -> float:
    """Return the median overshoot at isolated edges relative to their step; NaN if there are too
    few.

    Parameters
    ----------
    image : (h, w)
        sRGB values as a fraction of full scale.
    inside : (h, w)
        Mask of valid pixels.
    noise
        Standard deviation as a fraction of full scale; steps must exceed it.

    Examples
    --------
    >>> edges = np.tile(np.repeat(np.float32([0.3, 0.6]), 10), (60, 4))
    >>> everywhere = np.ones(edges.shape, bool)
    >>> round(overshoot(edges, everywhere), 2)
    0.0
    >>> sharpened = edges + 0.6 * (edges - cv2.GaussianBlur(edges, (0, 0), 1.5))
    >>> overshoot(sharpened, everywhere) > MAX_OVERSHOOT
    True
    """
    found = [part for turned in ((image, inside), (image.T, inside.T)) for part in _overshoots(*turned, noise)]
    values = np.concatenate(found)
    return float(np.median(values)) if len(values) >= MIN_EDGES else float("nan")


def _overshoots(image: Values, inside: NDArray[np.bool_], noise: float) -> list[Values]:
    """Return overshoots (n,) on both sides of the isolated edges along rows."""
    reach = FARTHEST + 1
    if image.shape[1] <= 2 * reach:
        return []
    rise = np.ascontiguousarray(np.diff(image, axis=1))
    steep = np.abs(rise)
    is_edge = (steep > max(MIN_STEP, MIN_STEP_OF_NOISE * noise)) & inside[:, 1:]
    is_edge &= steep >= cv2.dilate(steep, np.ones((1, 7), np.uint8))
    is_edge[:, :reach] = is_edge[:, -reach:] = False
    row, column = np.nonzero(is_edge)
    sign = np.sign(rise[row, column])
    profile = sign[:, None] * image[row[:, None], column[:, None] + np.arange(1 - FARTHEST, FARTHEST + 1)]
    before, beyond = profile[:, :FARTHEST][:, ::-1], profile[:, FARTHEST:]  # outwards from the edge
    step = np.maximum(beyond[:, 2] - before[:, 2], 1e-3)
    far = slice(NEAREST - 1, FARTHEST)
    isolated = np.maximum(np.ptp(before[:, far], axis=1), np.ptp(beyond[:, far], axis=1)) < FLATNESS * step
    top = np.maximum(beyond[:, 1], beyond[:, 2]) - beyond[:, FARTHEST - 2 :].mean(axis=1)
    bottom = before[:, FARTHEST - 2 :].mean(axis=1) - np.minimum(before[:, 1], before[:, 2])
    return [(values / step)[isolated].astype(np.float32) for values in (top, bottom)]
