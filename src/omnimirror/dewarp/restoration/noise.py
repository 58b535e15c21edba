"""How much noise a picture has, from the picture alone.

Noise is what is left of small blocks without their slope, in the plainest of them: the smallest variances of white
noise follow from the chi-square distribution. Pictures coded as JPEG have little left there, and err all the same:
:mod:`.jpeg_noise` says by how much. The noise of linear light grows with the light.
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
from ...io.pictures.jpeg import BLOCK, coding_of
from .jpeg_noise import FINE, blocks_of, coefficients_of, detected_coding, error_of, most_noise

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Picture = NDArray[Any]

FULL = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
LEAST_NOISE, MOST_NOISE = 1e-3, 0.2
LEAST_OF_CODED = 5e-3  # what comes as a JPEG file was often coded, or scaled, before
BLACK, WHITE = 0.03, 0.97  # levels beyond lack a part of their noise
PLAINEST, FINEST = 0.05, 0.02  # share of the blocks that is plain, and that holds nothing but noise in fine detail
LEVELS, PLAINEST_OF_LEVEL, LEAST_BLOCKS = 8, 0.1, 20
RAMP = np.broadcast_to((np.arange(BLOCK) - 3.5) / np.sqrt(42 * BLOCK), (BLOCK, BLOCK))  # of slope 1, its square 1
PLANE_FREEDOM, FINE_FREEDOM = BLOCK**2 - 3, int(FINE.sum())
SITES = 1.15  # ratio of noise of the pixels of a colour filter's 2 x 2 sites: they were measured, or filled in
VISIBLE_OF_CODED = 0.25  # of the deviation that coding made
SURVIVING = 0.8  # share of what coding leaves of noise in plain blocks that it leaves in all


class Noise(NamedTuple):
    """The noise of a picture."""

    share: float
    """Standard deviation in sRGB, as a share of full scale: the root of the mean square over the picture."""
    by_pixel: Light
    """(h, w) standard deviations of the root of the light, which is near to what sRGB holds."""
    kind: str
    """``white``, ``demosaiced``, ``JPEG``, ``linear`` or ``told``."""
    missing_share: float = 0.0
    """How much of its power is that of coding, which is not there to be seen for the most part: texture is gone."""

    @property
    def visible_share(self) -> float:
        """How much of the deviation is there to be seen."""
        return float(np.sqrt(1 - self.missing_share * (1 - VISIBLE_OF_CODED**2)))

    def at_least(self, by_pixel: Light | np.float32) -> Noise:
        """With no less in any pixel (h, w)."""
        return self._replace(by_pixel=np.maximum(self.by_pixel, by_pixel))

    def window(self, rows: slice, columns: slice) -> Noise:
        """That of a part of the picture."""
        return self._replace(by_pixel=self.by_pixel[rows, columns])


@checked
def estimate_noise(picture: Picture, file: str | Path | None = None, *, where: Mask | None = None) -> Noise:
    """The noise of a picture, or the error that its coding made where that is larger.

    Parameters
    ----------
    picture : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB.
    file
        That the picture was read from: a JPEG file says how coarsely it was coded. Without one that is looked for in
        the picture, where it left its steps.
    where : (h, w)
        Pixels that count: those that see the mirror.

    Returns
    -------
    Noise
        Its share of full scale, and what kind it is.

    Raises
    ------
    InvalidParameter
        For an array that is not such a picture, or holds values that are not finite.
    MediaError
        If the file cannot be read.

    Notes
    -----
    Within some 10 to 25 % of the truth where 5 % of the picture is plain; a picture that is busy everywhere makes the
    estimate too high. The error of coding comes from the statistics of its coefficients, that of colours coarser than
    pixels from theirs at the frequencies that are left.

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
            # where most of what is like noise is texture, the rest may be, too
            visible = left * (left / max(like_noise, LEAST_NOISE**2)) ** 2
            variance = max(found, LEAST_OF_CODED**2)
            return _even(variance, inside.shape, "JPEG")._replace(missing_share=(found - visible) / variance)
    demosaiced = _is_demosaiced(colours, inside)
    return _even(_white(colours, inside, demosaiced), inside.shape, "demosaiced" if demosaiced else "white")


def check_picture(picture: Picture) -> None:
    """Refuse what is no picture that can be restored."""
    if not isinstance(picture, np.ndarray) or picture.dtype.name not in FULL:
        kind = getattr(picture, "dtype", type(picture).__name__)
        raise InvalidParameter(f"a picture of {kind} is not valid; valid are arrays of {', '.join(FULL)}")
    if 0 in picture.shape or (picture.ndim != 2 and (picture.ndim != 3 or picture.shape[2] not in (1, 3, 4))):
        raise InvalidParameter(f"a picture of shape {picture.shape} is not valid; valid are 1, 3 or 4 channels")
    if picture.dtype == np.float32 and (lost := int((~np.isfinite(picture)).sum())):
        raise InvalidParameter(f"the picture holds {lost} values that are NaN or infinite; valid are finite ones")


def told_noise(share: float, shape: tuple[int, ...]) -> Noise:
    """The same in all pixels of a picture.

    Raises
    ------
    InvalidParameter
        For a share that is no number from 0 to 0.2.
    """
    if not 0 <= share <= MOST_NOISE:
        raise InvalidParameter(f"noise = {share:g} is outside 0 to {MOST_NOISE} of full scale")
    return _even(share**2, shape, "told")


def _even(variance: float, shape: tuple[int, ...], kind: str) -> Noise:
    share = float(np.clip(np.sqrt(variance), LEAST_NOISE, MOST_NOISE))
    return Noise(share, np.full(shape[:2], share, np.float32), kind)


def _of_light(light: Light, inside: Mask) -> Noise:
    """The variance of light as a line over the light, from the plainest blocks of some levels."""
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
    deviation = spread / (2 * np.sqrt(np.maximum(bright, np.maximum(spread, 1e-9))))  # of the root
    clipped = np.clip(deviation, LEAST_NOISE, MOST_NOISE)
    return Noise(float(np.sqrt((clipped[inside] ** 2).mean())), clipped.astype(np.float32), "linear")


def _white(colours: Light, inside: Mask, is_correlated: bool) -> float:
    """Variance of the noise of sRGB colours (h, w, n); fine detail tells the more, unless neighbours agree."""
    level, plane, fine = _variances(colours, inside)
    usable = (level > BLACK) & (level < WHITE)
    if not usable.any():
        return LEAST_NOISE**2
    return _smallest(plane[usable], np.inf if is_correlated else fine[usable], PLAINEST)


def _variances(colours: Light, inside: Mask) -> tuple[Array, Array, Array]:
    """Of all blocks and colours inside: the level, the variance without the slope, and that of fine detail alone."""
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
    """The variance of white noise whose plainest blocks have these."""
    from scipy.stats import chi2

    found = np.quantile(plane, plainest) * PLANE_FREEDOM / chi2.ppf(plainest, PLANE_FREEDOM)
    if isinstance(fine, np.ndarray):
        finest = plainest * FINEST / PLAINEST
        found = min(found, np.quantile(fine, finest) * FINE_FREEDOM / chi2.ppf(finest, FINE_FREEDOM))
    return float(found)


def _is_demosaiced(colours: Light, inside: Mask) -> bool:
    """Whether the pixels of one site of a colour filter are smoother than those of the others, in plain blocks."""
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
