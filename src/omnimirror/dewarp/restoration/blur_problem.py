"""Deblurring problem: excludes light from beyond the rim and restores lost texture from the input."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from .blurring import Blur, BlurSize, blur_kernels
from .deconvolution import BLUR_PX, LARGE, LARGE_PX, SMALL, UNEVEN, UNEVEN_PX, Effort, fit, solve, texture_of
from .noise import Noise
from .round_blur import RoundBlur
from .sharp_picture import DARK, SATURATED, Deblurring, SharpPicture, deblurring_of

Values = NDArray[np.float32]

SHARP_PX = 0.25  # pixels with less blur are unchanged, those with twice as much fully restored
# An image blurred in one direction is aliased in the other; aliased components need the finer grid
FINENESS = 2
TEXTURE_PX = 9  # window in which the residual is compared with the noise
MEAN_OF_LOG = np.float32(np.exp(0.37))  # mean of three squares over the geometric mean of such means
BEYOND_PX = 5  # smoothing width of pixels mirrored beyond the rim, which must not add texture
CURED = 0.35  # removable fraction of the coding-error power; lost texture is in neither image
ERROR, ERROR_PX = 0.01, 0.5  # error of large blur (square root of light), widening at half of it
WRONG, WRONG_PX = 2.0, 0.5  # relative power error of small blur, and the widening at 1/4 of it
DOUBT = 4.0  # ratio of error power to residual power
COARSE = 0.25  # coding errors are coarse, and blur damps them less than noise: by this power


class BlurProblem:
    """Prepared data for removing one blur from images."""

    def __init__(self, known: RoundBlur) -> None:
        self.known = known
        self.sizes: BlurSize = known.by_pixel
        self.widening: Values = self.sizes.widening.astype(np.float32)
        self.error: Values = np.float32(ERROR) * self.widening / (np.float32(ERROR_PX) + self.widening)

    @cached_property
    def blur(self) -> Blur:
        """Blur of every pixel."""
        return self._blur(FINENESS)

    @cached_property
    def known_pixels(self) -> NDArray[np.bool_]:
        """Pixels (h, w) that receive all of their light from the mirror."""
        return self.blur.known

    @cached_property
    def deblurring(self) -> Deblurring:
        """Deblurring operator on the fine grid."""
        return deblurring_of(self.blur)

    @cached_property
    def coarse_deblurring(self) -> Deblurring:
        """Deblurring operator on the pixel grid, for the initial estimate."""
        return deblurring_of(self._blur(1))

    def _blur(self, fineness: int) -> Blur:
        return blur_kernels(self.known.offsets, self.known.whole_radius_px, self.known.sizes, fineness)

    @property
    def effort(self) -> Effort:
        """Effective number of rounds, and of steps per round."""
        if not self.is_large_anywhere:
            return SMALL
        return LARGE if np.median(self.widening[self.known_pixels]) > LARGE_PX else UNEVEN

    @cached_property
    def is_large_anywhere(self) -> bool:
        """True if the blur requires more than a few steps."""
        return bool(self.widening[self.known_pixels].max(initial=0) > UNEVEN_PX)

    @cached_property
    def share(self) -> Values:
        """Fraction (h, w) of restoration of each pixel, 0 to 1: 0 for sharp pixels and near the
        rim.
        """
        blurred = _smooth(self.sizes.larger / SHARP_PX - 1)
        inside = _smooth((self.known.whole_radius_px - self.known.radius) / 2)
        return (blurred * inside).astype(np.float32)

    def sharp_roots(self, roots: Values, noise: Noise) -> Values:
        """Return square roots (h, w, channels) of the light of the sharp image."""
        roots = self.within(roots)
        found = self.solved(roots, noise, self.effort)
        sharp = np.sqrt(found.light())
        left = self.left_over(roots, found)
        share = self._texture(left, noise) / (1 + self.widening)
        restored = np.maximum(sharp + share[..., None] * left, 0)
        counts = (1 - _saturated(roots)) * (1 - self._given_share(found, sharp - roots + left, left, noise))
        return np.asarray(roots + counts[..., None] * (restored - roots), np.float32)

    def solved(self, roots: Values, noise: Noise, effort: Effort) -> SharpPicture:
        """Return the sharp image on the fine grid."""
        deviation, visible = self._deviations(noise)
        deblurrings = self.coarse_deblurring if effort.coarse_rounds else None, self.deblurring
        return solve(deblurrings, self.widening, roots, deviation, visible, effort)

    def fitted(self, roots: Values, noise: Noise, effort: Effort) -> SharpPicture:
        """Return a weakly regularised sharp image on the pixel grid, for tests of the blur itself."""
        return fit(self.coarse_deblurring, self.widening, roots, *self._deviations(noise), effort)

    def _deviations(self, noise: Noise) -> tuple[Values, Values]:
        """Return the standard deviation (h, w) of the roots, including errors of the blur, and its
        visible part.
        """
        deviation = noise.at_least(self.error).by_pixel
        if noise.kind == "JPEG":
            deviation = deviation * (1 + self.widening / np.float32(BLUR_PX)) ** np.float32(COARSE)
        return deviation, np.asarray(noise.visible_share * deviation, np.float32)

    def left_over(self, roots: Values, sharp: SharpPicture) -> Values:
        """Return the residual of the sharp image (h, w, channels); 0 in unknown pixels."""
        level = sharp.blurred()
        np.sqrt(np.maximum(level, DARK, out=level), out=level)
        left = np.subtract(roots, level, out=level)
        left *= self.known_pixels[..., None] & ((roots < SATURATED) | (left > 0))
        return left

    def within(self, roots: Values) -> Values:
        """Return the image with its content mirrored at the rim, replacing arbitrary content beyond
        it.
        """
        beyond, mirrored = self._mirrored
        found = roots.copy().reshape(-1, roots.shape[2])
        found[beyond] = found[mirrored]
        smooth = cv2.blur(found.reshape(roots.shape), (BEYOND_PX, BEYOND_PX))
        found[beyond] = smooth.reshape(found.shape)[beyond]
        return found.reshape(roots.shape)

    def _given_share(self, sharp: SharpPicture, removed: Values, left: Values, noise: Noise) -> Values:
        """Return the weight (h, w) of the input in the minimum-error mean of both images, with
        independent errors.

        All powers are in units of the noise. Errors of the input: noise, except for texture that
        coding removed from both images, and the removed blur (h, w, channels). Errors of the sharp
        image: noise in textures, and a fraction of small blur, because kernels on a grid widen
        every blur by the same number of square pixels. A residual (h, w, channels) above the noise
        indicates that the actual blur differs from the known one: next to lamps far brighter than
        white, or because the actual blur is larger or smaller.
        """
        blurred = _power(removed, noise)
        wrong = WRONG / (1 + self.widening / WRONG_PX) ** 2
        errs = texture_of(sharp, noise.by_pixel) * (1 + wrong * blurred)
        errs += DOUBT * np.maximum(_power(left, noise) - 1, 0)
        own = 1 - np.float32(noise.missing_share * (1 - CURED))
        return np.asarray(errs / (errs + own + blurred), np.float32)

    def _texture(self, left: Values, noise: Noise) -> Values:
        """Return the fraction (h, w) of the residual that is texture mistaken for noise.

        It is based on the geometric mean of the squares, which is insensitive to single edges.
        """
        known = self.known_pixels.astype(np.float32)
        window = (TEXTURE_PX, TEXTURE_PX)
        logarithm = cv2.blur(np.log(_mean_squares(left) + np.float32(1e-8)) * known, window)
        power = MEAN_OF_LOG * np.exp(logarithm / np.maximum(cv2.blur(known, window), np.float32(1e-3)))
        expected = noise.visible_share * noise.by_pixel
        return np.asarray(np.clip(1 - expected**2 / power, 0, 1) * known, np.float32)

    @cached_property
    def _mirrored(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pixels (n,) beyond the rim, and their mirror images: row * width + column."""
        radius, rim = self.known.radius, self.known.whole_radius_px
        height, width = radius.shape
        beyond = np.flatnonzero(radius > rim)
        radius = radius.ravel()[beyond]
        target = np.clip(2 * rim - radius, 0, rim - 1)  # offset by one pixel: the nearest one is inside
        inwards = target / np.maximum(radius, 1) - 1
        right, down = self.known.offsets.reshape(-1, 2)[beyond].T
        row = np.clip(np.rint(beyond // width + inwards * down), 0, height - 1).astype(int)
        column = np.clip(np.rint(beyond % width + inwards * right), 0, width - 1).astype(int)
        return beyond, row * width + column


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return a smooth step from 0 at 0 to 1 at 1."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _saturated(roots: Values) -> Values:
    """Return the local fraction (h, w) of saturated pixels, whose true values may be brighter."""
    saturated = np.zeros(roots.shape[:2], np.float32)
    for channel in np.moveaxis(roots, -1, 0):
        saturated[channel >= SATURATED] = 1
    return np.asarray(cv2.blur(saturated, (TEXTURE_PX, TEXTURE_PX)), np.float32)


def _power(values: Values, noise: Noise) -> Values:
    """Return local mean squares (h, w) of values (h, w, channels) relative to those of the noise."""
    squares = cv2.blur(_mean_squares(values) / noise.by_pixel**2, (TEXTURE_PX, TEXTURE_PX))
    # Running sums of zeros can be slightly negative
    return np.asarray(np.maximum(squares, 0), np.float32)


def _mean_squares(values: Values) -> Values:
    """Return the mean square over channels (h, w) without an array of all squares."""
    return np.asarray(np.einsum("hwc,hwc->hw", values, values) / np.float32(values.shape[2]))
