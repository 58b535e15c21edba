"""Estimation of image noise from the image alone.

Noise is the residual of small blocks after removal of their slope, in the most uniform blocks: the
smallest variances of white noise follow from the chi-square distribution. JPEG images have little
noise in these blocks but contain coding errors, which :mod:`.jpeg_noise` estimates. The noise of
linear light increases with the light.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.typing import Array, Mask
from ...io.pictures.jpeg import BLOCK, coding_of
from .jpeg_noise import FINE, blocks_of, coefficients_of, detected_coding, error_of, most_noise

Picture = NDArray[Any]

FULL = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
LEAST_NOISE, MOST_NOISE = 1e-3, 0.2
LEAST_OF_CODED = 5e-3  # JPEG images were often coded or scaled before
BLACK, WHITE = 0.03, 0.97  # levels beyond them have clipped noise
PLAINEST, FINEST = 0.05, 0.02  # fraction of uniform blocks, and fraction with pure noise in fine detail
LEVELS, PLAINEST_OF_LEVEL, LEAST_BLOCKS = 8, 0.1, 20
RAMP = np.broadcast_to((np.arange(BLOCK) - 3.5) / np.sqrt(42 * BLOCK), (BLOCK, BLOCK))  # slope 1, normalised
PLANE_FREEDOM, FINE_FREEDOM = BLOCK**2 - 3, int(FINE.sum())
SITES = 1.15  # noise ratio of the 2 x 2 colour-filter sites: measured or interpolated
VISIBLE_OF_CODED = 0.25  # visible fraction of the standard deviation due to coding
SURVIVING = 0.8  # ratio of the noise that survives coding in uniform blocks to that in all blocks


class Noise(NamedTuple):
    """Noise of an image."""

    share: float
    """Standard deviation in sRGB as a fraction of full scale: RMS over the image."""
    by_pixel: Light
    """Standard deviations (h, w) of the square root of the light, which is close to sRGB values."""
    kind: str
    """Kind of noise: ``white``, ``demosaiced``, ``JPEG``, ``linear`` or ``told``."""
    missing_share: float = 0.0
    """Fraction of its power due to coding, which is mostly invisible because texture was removed.
    """

    @property
    def visible_share(self) -> float:
        """Visible fraction of the standard deviation."""
        return float(np.sqrt(1 - self.missing_share * (1 - VISIBLE_OF_CODED**2)))

    def at_least(self, by_pixel: Light | np.float32) -> Noise:
        """Return the noise with a lower bound for each pixel (h, w)."""
        return self._replace(by_pixel=np.maximum(self.by_pixel, by_pixel))

    def window(self, rows: slice, columns: slice) -> Noise:
        """Return the noise of an image window."""
        return self._replace(by_pixel=self.by_pixel[rows, columns])


@checked
def estimate_noise(picture: Picture, file: str | Path | None = None, *, where: Mask | None = None) -> Noise:
    """Estimate the noise of an image, or its coding error if that is larger.

    Parameters
    ----------
    picture : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB.
    file
        Source file: a JPEG file contains its quantisation steps. By default they are detected in
        the image.
    where : (h, w)
        Mask of valid pixels, which image the mirror.

    Returns
    -------
    Noise
        Fraction of full scale, and kind of noise.

    Raises
    ------
    InvalidParameter
        If the array is not such an image, or contains non-finite values.
    MediaError
        If the file cannot be read.

    Notes
    -----
    The error is some 10 to 25 % if 5 % of the image is uniform; for images with detail everywhere
    the estimate is too high. The coding error follows from the statistics of the coefficients, and
    that of subsampled chroma from its remaining frequencies.

    Examples
    --------
    >>> slope = np.linspace(0.2, 0.8, 256) + 0.01 * np.random.default_rng(0).standard_normal((256, 256))
    >>> round(estimate_noise((255 * slope).astype(np.uint8)).share, 3)
    0.01
    """
    check_picture(picture)
    inside = np.ones(picture.shape[:2], bool) if where is None else where
    if inside.shape != picture.shape[:2]:
        raise InvalidParameter(
            f"where has shape {inside.shape}, and the picture {picture.shape[:2]}; give one for each"
        )
    colours = picture[..., None] if picture.ndim == 2 else picture[..., :3]
    colours = (colours / FULL[picture.dtype.name]).astype(np.float32)
    if picture.dtype == np.float32:
        return _of_light(np.maximum(colours, 0), inside)
    if picture.dtype == np.uint8:
        coding = coding_of(file) if file is not None else None
        if coding := coding or detected_coding(picture, inside):
            values = 255 * colours.astype(float)
            like_noise = SURVIVING**2 * _white(colours, inside, True)
            left = min(like_noise, most_noise(values, coding, inside) / 255**2)
            found = error_of(values, coding, inside) / 255**2 + left
            # If most of the apparent noise is texture, the remainder may be texture, too
            visible = left * (left / max(like_noise, LEAST_NOISE**2)) ** 2
            variance = max(found, LEAST_OF_CODED**2)
            return _even(variance, inside.shape, "JPEG")._replace(missing_share=(found - visible) / variance)
    demosaiced = _is_demosaiced(colours, inside)
    return _even(_white(colours, inside, demosaiced), inside.shape, "demosaiced" if demosaiced else "white")


def check_picture(picture: Picture) -> None:
    """Raise an error unless an image can be restored."""
    if not isinstance(picture, np.ndarray) or picture.dtype.name not in FULL:
        kind = getattr(picture, "dtype", type(picture).__name__)
        raise InvalidParameter(f"a picture of {kind} is not valid; valid are arrays of {', '.join(FULL)}")
    if 0 in picture.shape or (picture.ndim != 2 and (picture.ndim != 3 or picture.shape[2] not in (1, 3, 4))):
        raise InvalidParameter(f"a picture of shape {picture.shape} is not valid; valid are 1, 3 or 4 channels")
    if picture.dtype == np.float32 and (lost := int((~np.isfinite(picture)).sum())):
        raise InvalidParameter(f"the picture holds {lost} values that are NaN or infinite; valid are finite ones")


def told_noise(share: float, shape: tuple[int, ...]) -> Noise:
    """Return uniform noise for all pixels of an image.

    Raises
    ------
    InvalidParameter
        If the fraction is not a number from 0 to 0.2.
    """
    if not 0 <= share <= MOST_NOISE:
        raise InvalidParameter(f"noise = {share:g} is outside 0 to {MOST_NOISE} of full scale")
    return _even(share**2, shape, "told")


def _even(variance: float, shape: tuple[int, ...], kind: str) -> Noise:
    share = float(np.clip(np.sqrt(variance), LEAST_NOISE, MOST_NOISE))
    return Noise(share, np.full(shape[:2], share, np.float32), kind)


def _of_light(light: Light, inside: Mask) -> Noise:
    """Estimate the variance of light as a linear function of the light, from the most uniform
    blocks of several levels.
    """
    from scipy.optimize import nnls

    level, plane, fine = _variances(light, inside)
    points = []
    for part in np.array_split(np.argsort(level), LEVELS):
        if len(part) >= LEAST_BLOCKS and WHITE > level[part].mean() > 0:
            plainest = part[np.argsort(plane[part])[: int(2 * PLAINEST_OF_LEVEL * len(part))]]
            points.append((level[plainest].mean(), _smallest(plane[part], fine[part], PLAINEST_OF_LEVEL)))
    bright = light.mean(axis=2, dtype=float)
    even, growing = LEAST_NOISE**2, 0.0
    if points:
        at, found = np.array(points).T
        weighed = np.stack([np.ones_like(at), at], axis=-1) / np.maximum(found, 1e-12)[:, None]
        (even, growing), _ = nnls(weighed, np.ones_like(at))
    spread = np.sqrt(even + growing * bright)
    # Standard deviation of the square root
    deviation = spread / (2 * np.sqrt(np.maximum(bright, np.maximum(spread, 1e-9))))
    clipped = np.clip(deviation, LEAST_NOISE, MOST_NOISE)
    return Noise(float(np.sqrt((clipped[inside] ** 2).mean())), clipped.astype(np.float32), "linear")


def _white(colours: Light, inside: Mask, is_correlated: bool) -> float:
    """Estimate the variance of sRGB noise (h, w, n), mainly from fine detail unless neighbours are
    correlated.
    """
    level, plane, fine = _variances(colours, inside)
    usable = (level > BLACK) & (level < WHITE)
    if not usable.any():
        return LEAST_NOISE**2
    return _smallest(plane[usable], np.inf if is_correlated else fine[usable], PLAINEST)


def _variances(colours: Light, inside: Mask) -> tuple[Array, Array, Array]:
    """Return level, variance without slope, and variance of fine detail for all blocks and colours
    in the mask.
    """
    found = []
    whole = blocks_of(inside).all(axis=(2, 3))
    for plane in np.moveaxis(colours, -1, 0):
        blocks = blocks_of(plane.astype(float))[whole]
        fine = (coefficients_of(plane.astype(float))[whole][:, FINE] ** 2).mean(axis=1)
        squares = (blocks**2).sum(axis=(1, 2)) - blocks.sum(axis=(1, 2)) ** 2 / BLOCK**2
        slopes = (blocks * RAMP).sum(axis=(1, 2)) ** 2 + (blocks * RAMP.T).sum(axis=(1, 2)) ** 2
        found.append((blocks.mean(axis=(1, 2)), np.maximum(squares - slopes, 0) / PLANE_FREEDOM, fine))
    level, plane, fine = (np.concatenate(parts) for parts in zip(*found, strict=True))
    return level, plane, fine


def _smallest(plane: Array, fine: Array | float, plainest: float) -> float:
    """Return the variance of white noise that has the variances of the most uniform blocks."""
    from scipy.stats import chi2

    found = np.quantile(plane, plainest) * PLANE_FREEDOM / chi2.ppf(plainest, PLANE_FREEDOM)
    if isinstance(fine, np.ndarray):
        finest = plainest * FINEST / PLAINEST
        found = min(found, np.quantile(fine, finest) * FINE_FREEDOM / chi2.ppf(finest, FINE_FREEDOM))
    return float(found)


def _is_demosaiced(colours: Light, inside: Mask) -> bool:
    """Return True if one colour-filter site is smoother than the others in uniform blocks."""
    if colours.shape[2] == 1:
        return False
    whole = blocks_of(inside).all(axis=(2, 3))
    for plane in np.moveaxis(colours, -1, 0):
        detail = plane - cv2.blur(plane, (3, 3))
        size = (blocks_of(detail)[whole] ** 2).reshape(-1, BLOCK // 2, 2, BLOCK // 2, 2)
        if len(size) < LEAST_BLOCKS:
            return False
        total = size.sum(axis=(1, 2, 3, 4))
        sites = size[total <= np.quantile(total, 0.25)].mean(axis=(0, 1, 3))
        if sites.max() <= SITES**2 * sites.min():
            return False
    return True
