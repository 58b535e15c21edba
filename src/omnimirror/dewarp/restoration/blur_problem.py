"""A blur to be taken out of pictures: what lies beyond the rim kept out, and texture that is lost given back."""

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

SHARP_PX = 0.25  # pixels with less blur stay as they are, and those with twice as much are all restored
FINENESS = 2  # a picture blurred one way is aliased the other, and what aliasing folded must have its place
TEXTURE_PX = 9  # in which what is left over is compared with the noise
MEAN_OF_LOG = np.float32(np.exp(0.37))  # a mean of three squares over the geometric mean of such means
BEYOND_PX = 5  # in which what is mirrored beyond the rim is made even, texture there being none of the picture's
CURED = 0.35  # of the power of coding's error restoring can take away; texture that is gone is in no picture of both
ERROR, ERROR_PX = 0.01, 0.5  # of large blur as it is known, in the root of light, and the widening at which it is half
WRONG, WRONG_PX = 2.0, 0.5  # of the power of a small blur is wrongly known, and the widening at which a quarter of that
DOUBT = 4.0  # how often power that is left over is that of an error
COARSE = 0.25  # what coding leaves is coarse, and blur damps it less than noise: by this power


class BlurProblem:
    """What is needed to take one blur out of pictures."""

    def __init__(self, known: RoundBlur) -> None:
        self.known = known
        self.sizes: BlurSize = known.by_pixel
        self.widening: Values = self.sizes.widening.astype(np.float32)
        self.error: Values = np.float32(ERROR) * self.widening / (np.float32(ERROR_PX) + self.widening)

    @cached_property
    def blur(self) -> Blur:
        """The blur of every pixel."""
        return self._blur(FINENESS)

    @cached_property
    def known_pixels(self) -> NDArray[np.bool_]:
        """Those (h, w) whose whole light comes off the mirror."""
        return self.blur.known

    @cached_property
    def deblurring(self) -> Deblurring:
        """What takes it out."""
        return deblurring_of(self.blur)

    @cached_property
    def coarse_deblurring(self) -> Deblurring:
        """The same on the grid of the pixels, where it begins."""
        return deblurring_of(self._blur(1))

    def _blur(self, fineness: int) -> Blur:
        return blur_kernels(self.known.offsets, self.known.whole_radius_px, self.known.sizes, fineness)

    @property
    def effort(self) -> Effort:
        """Rounds, and steps in each, that pay."""
        if not self.is_large_anywhere:
            return SMALL
        return LARGE if np.median(self.widening[self.known_pixels]) > LARGE_PX else UNEVEN

    @cached_property
    def is_large_anywhere(self) -> bool:
        """Whether more is to be found than a few steps find."""
        return bool(self.widening[self.known_pixels].max(initial=0) > UNEVEN_PX)

    @cached_property
    def share(self) -> Values:
        """How much of a pixel (h, w) is restored, 0 to 1: nothing where it is sharp, or near the rim."""
        blurred = _smooth(self.sizes.larger / SHARP_PX - 1)
        inside = _smooth((self.known.whole_radius_px - self.known.radius) / 2)
        return (blurred * inside).astype(np.float32)

    def sharp_roots(self, roots: Values, noise: Noise) -> Values:
        """Roots (h, w, channels) of the light of the sharp picture."""
        roots = self.within(roots)
        found = self.solved(roots, noise, self.effort)
        sharp = np.sqrt(found.light())
        left = self.left_over(roots, found)
        share = self._texture(left, noise) / (1 + self.widening)
        restored = np.maximum(sharp + share[..., None] * left, 0)
        counts = (1 - _saturated(roots)) * (1 - self._given_share(found, sharp - roots + left, left, noise))
        return np.asarray(roots + counts[..., None] * (restored - roots), np.float32)

    def solved(self, roots: Values, noise: Noise, effort: Effort) -> SharpPicture:
        """The sharp picture on the fine grid."""
        deviation, visible = self._deviations(noise)
        deblurrings = self.coarse_deblurring if effort.coarse_rounds else None, self.deblurring
        return solve(deblurrings, self.widening, roots, deviation, visible, effort)

    def fitted(self, roots: Values, noise: Noise, effort: Effort) -> SharpPicture:
        """Return a weakly regularised sharp image on the pixel grid, for tests of the blur itself."""
        return fit(self.coarse_deblurring, self.widening, roots, *self._deviations(noise), effort)

    def _deviations(self, noise: Noise) -> tuple[Values, Values]:
        """Return the deviation (h, w) of the roots, errors of the blur included, and its visible part."""
        deviation = noise.at_least(self.error).by_pixel
        if noise.kind == "JPEG":
            deviation = deviation * (1 + self.widening / np.float32(BLUR_PX)) ** np.float32(COARSE)
        return deviation, np.asarray(noise.visible_share * deviation, np.float32)

    def left_over(self, roots: Values, sharp: SharpPicture) -> Values:
        """What the sharp picture leaves unexplained of the one given (h, w, channels); 0 where nothing is known."""
        level = sharp.blurred()
        np.sqrt(np.maximum(level, DARK, out=level), out=level)
        left = np.subtract(roots, level, out=level)
        left *= self.known_pixels[..., None] & ((roots < SATURATED) | (left > 0))
        return left

    def within(self, roots: Values) -> Values:
        """The picture with what it shows within the rim mirrored beyond it, where anything may stand."""
        beyond, mirrored = self._mirrored
        found = roots.copy().reshape(-1, roots.shape[2])
        found[beyond] = found[mirrored]
        smooth = cv2.blur(found.reshape(roots.shape), (BEYOND_PX, BEYOND_PX))
        found[beyond] = smooth.reshape(found.shape)[beyond]
        return found.reshape(roots.shape)

    def _given_share(self, sharp: SharpPicture, removed: Values, left: Values, noise: Noise) -> Values:
        """The share (h, w) of the picture given in the mean of both that errs least, their errors taken for unlike.

        All by their power in units of the noise. The one given errs by its noise, but for texture that coding took from
        both, and by the blur removed (h, w, channels). The sharp one errs in texture as noise does, and by a share of
        the blur where that is small: kernels on a grid widen every blur by as many square pixels. And what it leaves
        over beyond noise (h, w, channels) says that the blur is not the known one: beside lamps far brighter than
        white, or where it is larger than it is.
        """
        blurred = _power(removed, noise)
        wrong = WRONG / (1 + self.widening / WRONG_PX) ** 2
        errs = texture_of(sharp, noise.by_pixel) * (1 + wrong * blurred)
        errs += DOUBT * np.maximum(_power(left, noise) - 1, 0)
        own = 1 - np.float32(noise.missing_share * (1 - CURED))
        return np.asarray(errs / (errs + own + blurred), np.float32)

    def _texture(self, left: Values, noise: Noise) -> Values:
        """The share (h, w) of what is left over that is no noise: texture that looked like it.

        By the geometric mean of its squares, to which the surroundings of a single edge add little.
        """
        known = self.known_pixels.astype(np.float32)
        window = (TEXTURE_PX, TEXTURE_PX)
        logarithm = cv2.blur(np.log(_mean_squares(left) + np.float32(1e-8)) * known, window)
        power = MEAN_OF_LOG * np.exp(logarithm / np.maximum(cv2.blur(known, window), np.float32(1e-3)))
        expected = noise.visible_share * noise.by_pixel
        return np.asarray(np.clip(1 - expected**2 / power, 0, 1) * known, np.float32)

    @cached_property
    def _mirrored(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pixels (n,) beyond the rim, and those that stand for them: row * width + column."""
        radius, rim = self.known.radius, self.known.whole_radius_px
        height, width = radius.shape
        beyond = np.flatnonzero(radius > rim)
        radius = radius.ravel()[beyond]
        target = np.clip(2 * rim - radius, 0, rim - 1)  # a pixel off, so that the nearest one is within
        inwards = target / np.maximum(radius, 1) - 1
        right, down = self.known.offsets.reshape(-1, 2)[beyond].T
        row = np.clip(np.rint(beyond // width + inwards * down), 0, height - 1).astype(int)
        column = np.clip(np.rint(beyond % width + inwards * right), 0, width - 1).astype(int)
        return beyond, row * width + column


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 at 0 to 1 at 1 without a kink."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)


def _saturated(roots: Values) -> Values:
    """The share (h, w) of pixels about each that are saturated, and may have been anything brighter."""
    saturated = np.zeros(roots.shape[:2], np.float32)
    for channel in np.moveaxis(roots, -1, 0):
        saturated[channel >= SATURATED] = 1
    return np.asarray(cv2.blur(saturated, (TEXTURE_PX, TEXTURE_PX)), np.float32)


def _power(values: Values, noise: Noise) -> Values:
    """Mean squares (h, w) of values (h, w, channels) about each pixel, over those of the noise."""
    squares = cv2.blur(_mean_squares(values) / noise.by_pixel**2, (TEXTURE_PX, TEXTURE_PX))
    return np.asarray(np.maximum(squares, 0), np.float32)  # running sums of zeros come out below 0


def _mean_squares(values: Values) -> Values:
    """Of the channels (h, w), without an array of all squares."""
    return np.asarray(np.einsum("hwc,hwc->hw", values, values) / np.float32(values.shape[2]))
