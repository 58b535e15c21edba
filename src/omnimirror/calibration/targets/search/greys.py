"""A picture as finding a board needs it: grey, at several sizes, and how blurred it is."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter

Array = NDArray[np.float64]
Grey = NDArray[np.float32]

USUAL_PX = 900
"""Longer side of the picture in which a board is looked for first: squares have ten pixels or more in most."""
MOST_PIXELS = 128_000_000
"""Of a picture; the search takes up to 13 bytes of memory for each."""
SMALLEST_PX, LARGEST_PX = 200, 6000
LARGEST_ENLARGED_PX = 3000  # of a picture that is looked at twice as large as it is, for squares of few pixels
FULL = {"u": 255.0, "f": 1.0}


def grey(picture: NDArray[Any]) -> Grey:
    """Convert a picture (height, width) or (height, width, 1 to 4), RGB, to its brightness on a scale of 0 to 255.

    Raises
    ------
    InvalidParameter
        It is no picture, or has more than :data:`MOST_PIXELS`.
    """
    picture = np.asarray(picture)
    if picture.ndim not in (2, 3) or picture.dtype.kind not in "uf" or min(picture.shape[:2]) < 16:
        raise InvalidParameter(
            f"a picture of shape {picture.shape} and kind {picture.dtype} is not valid; it is valid as (height, width) "
            "or (height, width, 3), of whole numbers from 0 or floats, with at least 16 px a side"
        )
    height, width = picture.shape[:2]
    if height * width > MOST_PIXELS:
        raise InvalidParameter(
            f"a picture in which a board is searched for must not have more than {MOST_PIXELS / 1e6:.0f} megapixels; "
            f"got {width} x {height} px; reduce it"
        )
    full = 1.0 if picture.dtype.kind == "f" else float(np.iinfo(picture.dtype).max)
    values = picture.astype(np.float32)
    if values.ndim == 3:
        weights = np.array([0.299, 0.587, 0.114], np.float32) if values.shape[2] >= 3 else np.ones(1, np.float32)
        values = values[..., : len(weights)] @ weights
    if picture.dtype.kind == "f":  # of high dynamic range: what is above white is no brighter
        values = np.clip(np.nan_to_num(values), 0, max(1.0, float(np.percentile(values, 99.5))))
        full = max(1.0, float(values.max()))
    return np.ascontiguousarray(values * np.float32(255.0 / full))


def bytes_of(picture: Grey) -> NDArray[np.uint8]:
    """As OpenCV's detectors take it, the darkest and the brightest hundredth stretched to black and white."""
    low, high = np.percentile(picture[::4, ::4], [0.5, 99.5])
    return np.asarray(np.clip((picture - low) * (255 / max(high - low, 1.0)), 0, 255), np.uint8)


def scales(shape: tuple[int, ...]) -> list[float]:
    """Sizes of the picture in which a board is looked for, in turn."""
    longest = max(shape[:2])
    usual = min(1.0, 2.0 ** round(np.log2(USUAL_PX / longest)))
    sizes = [s for s in (usual, 2 * usual, usual / 2, 4 * usual) if s <= 2]
    largest = {True: LARGEST_ENLARGED_PX, False: LARGEST_PX}
    return [s for s in sizes if SMALLEST_PX <= s * longest <= largest[s > 1]] or [usual]


def scaled(picture: Grey, scale: float) -> Grey:
    """The picture at another size."""
    import cv2

    if scale == 1:
        return picture
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(cv2.resize(picture, None, fx=scale, fy=scale, interpolation=way), np.float32)


def unscaled_px(pixels: Array, scale: float) -> Array:
    """Pixels of the picture itself, of those of one at another size; pixel centres are whole numbers in both."""
    return np.asarray((pixels + 0.5) / scale - 0.5)


def upwards(scale: float) -> Iterator[float]:
    """Sizes from one up to the picture's own, doubled every time.

    >>> list(upwards(0.25)), list(upwards(2.0))
    ([0.5, 1.0], [1.0])
    """
    while scale < 1:
        scale = min(2 * scale, 1.0)
        yield scale
        if scale == 1:
            return
    if scale > 1:
        yield 1.0


def edge_blur_px(picture: Grey) -> float:
    """Standard deviation over which the stronger edges of a picture are spread, px.

    Where an edge is spread over s, its gradient's square sums to 1 / s; spread over b more it is 1 / sqrt(s^2 + b^2).
    So the ratio of both sums tells s, whatever the contrast. Noise hides in the half of the gradient that is left out.
    """
    import cv2

    more = 2.0
    energies = []
    for blur in (1.0, float(np.hypot(1.0, more))):
        smooth = cv2.GaussianBlur(picture, (0, 0), blur)
        energies.append(cv2.Sobel(smooth, cv2.CV_32F, 1, 0) ** 2 + cv2.Sobel(smooth, cv2.CV_32F, 0, 1) ** 2)
    strong = cv2.blur(energies[1], (15, 15))
    used = strong > np.percentile(strong, 90)
    ratio = float(energies[0][used].sum() / max(energies[1][used].sum(), 1e-6))
    spread = more**2 / max(ratio**2 - 1, 1e-3) - 1.0  # variance beyond the blur of the measurement
    return float(np.sqrt(np.clip(spread, 0.01, 1e3)))
