"""Fraction of a known blur that an image contains: deblurring problem, upper limit and estimate."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.caching import cached_property
from ...base.typing import Array
from ._deconvolution import (
    BLUR_PX,
    DARK,
    LARGE_BLUR_EFFORT,
    LARGE_PX,
    SATURATED,
    SMALL_BLUR_EFFORT,
    UNEVEN_PX,
    VARYING_BLUR_EFFORT,
    Deblurring,
    Effort,
    SharpImage,
    deblurring_of,
    fit,
    solve,
    texture_of,
)
from .blur_model import Blur, BlurSize, RadialBlur, blur_kernels
from .noise import Noise, specified_noise

# -- Deblurring problem: excludes light from beyond the rim and restores lost texture from the input

Values = NDArray[np.float32]

SHARP_PX = 0.25  # pixels with less blur are unchanged, those with twice as much fully restored
# An image blurred in one direction is aliased in the other; aliased components need the finer grid
FINENESS = 2
TEXTURE_PX = 9  # window in which the residual is compared with the noise
MEAN_OF_LOG = np.float32(
    np.exp(0.37)
)  # mean of three squares over the geometric mean of such means
BEYOND_PX = 5  # smoothing width of pixels mirrored beyond the rim, which must not add texture
CURED = 0.35  # removable fraction of the coding-error power; lost texture is in neither image
ERROR, ERROR_PX = 0.01, 0.5  # error of large blur (square root of light), widening at half of it
WRONG, WRONG_PX = 2.0, 0.5  # relative power error of small blur, and the widening at 1/4 of it
DOUBT = 4.0  # ratio of error power to residual power
COARSE = 0.25  # coding errors are coarse, and blur damps them less than noise: by this power
# The error of the known blur; lower noise would expose this error instead
MIN_ASSUMED_NOISE = np.float32(0.007)


class BlurProblem:
    """Prepared data for removing one blur from images."""

    def __init__(self, blur: RadialBlur) -> None:
        self.known = blur
        self.sizes: BlurSize = blur.by_pixel
        self.widening: Values = self.sizes.widening.astype(np.float32)
        self.error: Values = (
            np.float32(ERROR) * self.widening / (np.float32(ERROR_PX) + self.widening)
        )

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
        return blur_kernels(
            self.known.offsets, self.known.whole_radius_px, self.known.sizes, fineness
        )

    @property
    def effort(self) -> Effort:
        """Effective number of rounds, and of steps per round."""
        if not self.is_large_anywhere:
            return SMALL_BLUR_EFFORT
        return (
            LARGE_BLUR_EFFORT
            if np.median(self.widening[self.known_pixels]) > LARGE_PX
            else VARYING_BLUR_EFFORT
        )

    @cached_property
    def is_large_anywhere(self) -> bool:
        """True if the blur requires more than a few steps."""
        return bool(self.widening[self.known_pixels].max(initial=0) > UNEVEN_PX)

    @cached_property
    def fraction(self) -> Values:
        """Fraction (h, w) of restoration of each pixel, 0 to 1: 0 for sharp pixels and near the
        rim.
        """
        blurred = _smooth(self.sizes.larger / SHARP_PX - 1)
        inside = _smooth((self.known.whole_radius_px - self.known.radius) / 2)
        return (blurred * inside).astype(np.float32)

    def sharp_roots(self, roots: Values, noise: Noise) -> Values:
        """Return square roots (h, w, channels) of the light of the sharp image."""
        roots = self.within(roots)
        solution = self.solve(roots, noise, self.effort)
        sharp = np.sqrt(solution.light())
        residual = self.residual(roots, solution)
        fraction = self._texture(residual, noise) / (1 + self.widening)
        restored = np.maximum(sharp + fraction[..., None] * residual, 0)
        counts = (1 - _saturated(roots)) * (
            1 - self._input_weight(solution, sharp - roots + residual, residual, noise)
        )
        return np.asarray(roots + counts[..., None] * (restored - roots), np.float32)

    def solve(self, roots: Values, noise: Noise, effort: Effort) -> SharpImage:
        """Return the sharp image on the fine grid."""
        deviation, visible = self._deviations(noise)
        deblurrings = self.coarse_deblurring if effort.coarse_rounds else None, self.deblurring
        return solve(deblurrings, self.widening, roots, deviation, visible, effort)

    def fitted(self, roots: Values, noise: Noise, effort: Effort) -> SharpImage:
        """Return a weakly regularised sharp image on the pixel grid, for tests of the blur itself."""
        return fit(self.coarse_deblurring, self.widening, roots, *self._deviations(noise), effort)

    def _deviations(self, noise: Noise) -> tuple[Values, Values]:
        """Return the standard deviation (h, w) of the roots, including errors of the blur, and its
        visible part.
        """
        deviation = noise.at_least(self.error).by_pixel
        if noise.kind == "JPEG":
            deviation = deviation * (1 + self.widening / np.float32(BLUR_PX)) ** np.float32(COARSE)
        return deviation, np.asarray(noise.visible_fraction * deviation, np.float32)

    def residual(self, roots: Values, sharp: SharpImage) -> Values:
        """Return the residual of the sharp image (h, w, channels); 0 in unknown pixels."""
        level = sharp.blurred()
        np.sqrt(np.maximum(level, DARK, out=level), out=level)
        residual = np.subtract(roots, level, out=level)
        residual *= self.known_pixels[..., None] & ((roots < SATURATED) | (residual > 0))
        return residual

    def within(self, roots: Values) -> Values:
        """Return the image with its content mirrored at the rim, replacing arbitrary content beyond
        it.
        """
        beyond, mirrored = self._mirrored
        limited = roots.copy().reshape(-1, roots.shape[2])
        limited[beyond] = limited[mirrored]
        smooth = cv2.blur(limited.reshape(roots.shape), (BEYOND_PX, BEYOND_PX))
        limited[beyond] = smooth.reshape(limited.shape)[beyond]
        return limited.reshape(roots.shape)

    def _input_weight(
        self, sharp: SharpImage, removed: Values, residual: Values, noise: Noise
    ) -> Values:
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
        errs += DOUBT * np.maximum(_power(residual, noise) - 1, 0)
        own = 1 - np.float32(noise.coding_fraction * (1 - CURED))
        return np.asarray(errs / (errs + own + blurred), np.float32)

    def _texture(self, residual: Values, noise: Noise) -> Values:
        """Return the fraction (h, w) of the residual that is texture mistaken for noise.

        It is based on the geometric mean of the squares, which is insensitive to single edges.
        """
        is_known = self.known_pixels.astype(np.float32)
        window = (TEXTURE_PX, TEXTURE_PX)
        logarithm = cv2.blur(np.log(_mean_squares(residual) + np.float32(1e-8)) * is_known, window)
        power = MEAN_OF_LOG * np.exp(
            logarithm / np.maximum(cv2.blur(is_known, window), np.float32(1e-3))
        )
        expected = noise.visible_fraction * noise.by_pixel
        return np.asarray(np.clip(1 - expected**2 / power, 0, 1) * is_known, np.float32)

    @cached_property
    def _mirrored(self) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Pixels (n,) beyond the rim, and their mirror images: row * width + column."""
        radius, rim = self.known.radius, self.known.whole_radius_px
        height, width = radius.shape
        beyond = np.flatnonzero(radius > rim)
        radius = radius.ravel()[beyond]
        target = np.clip(
            2 * rim - radius, 0, rim - 1
        )  # offset by one pixel: the nearest one is inside
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


# -- Contradiction between an image and a blur ---------------------------------------------------
#
# No sharp image, blurred by more than the image contains, explains steep edges: next to them the
# residual is a large fraction of the removed blur, and a smaller blur leaves less. For the correct
# blur, the fraction is small; errors of the model, for example near lamps, are as large with a
# smaller blur.

COMPARED_FRACTION = 0.7  # of the blur, for the comparison of residuals
REMOVED_QUANTILE = 0.95  # quantile of the removed blur above which it is compared with the residual
MIN_REMOVED, NOISE_WEIGHT = 2.0, 0.5  # relative to the noise; expected residual of the fit
DECREASE = 1.5  # weight of the decrease of the residual from the full to the smaller blur
MAX_CONTRADICTION = 0.085  # of images of the known blur
COMPARED_WIDTH_PX, COMPARED_WIDTH = 1.5, 0.8  # minimum blur of the pixels: absolute, of the largest
MIN_COMPARED_PIXELS = 60
RESIDUAL_PX, REMOVED_PX = 3, 5  # side lengths of averaging windows
MIN_HIGHLIGHT_PX = 4.0  # minimum distance from pixels that are brighter than white


def contradiction(
    full: BlurProblem, roots: Values, noise: Noise, smaller: BlurProblem | None = None
) -> float:
    """Return the residual of a blur relative to the removed blur, or, if less, its weighted
    decrease with a smaller blur; 0 with too few pixels.

    The pixels with the largest removed blur are evaluated, except near pixels brighter than white.
    The result is at most :data:`MAX_CONTRADICTION` in images with the known blur, and usually 0.1
    to 0.3 in sharper images.

    Parameters
    ----------
    full
        Problem of the blur.
    roots : (h, w, 1 or 3)
        Square roots of the light of the image.
    noise
        Noise of the image.
    smaller
        Problem of a fraction of the blur.
    """
    sizes, known = full.sizes.larger, full.known_pixels
    here = full.within(roots)
    solution = full.solve(here, noise, full.effort)
    light, residual = solution.light(), full.residual(here, solution)
    dark = np.asarray(((roots < SATURATED) & (light <= 1)).all(axis=2), np.uint8)
    distance = cv2.distanceTransform(dark, cv2.DIST_C, 3)
    compared = known & (distance > np.maximum(sizes / 2 + 1, MIN_HIGHLIGHT_PX))
    compared &= sizes > min(COMPARED_WIDTH_PX, COMPARED_WIDTH * sizes[known].max(initial=0))
    if compared.sum() < MIN_COMPARED_PIXELS:
        return 0.0
    removed = _mean_squares(np.sqrt(light) + residual - here)
    removed = np.asarray(cv2.blur(removed, (REMOVED_PX, REMOVED_PX)), np.float32)
    variance = noise.at_least(MIN_ASSUMED_NOISE).by_pixel ** 2
    compared &= removed >= np.quantile(removed[compared], REMOVED_QUANTILE)
    compared &= removed > MIN_REMOVED**2 * variance
    if compared.sum() < MIN_COMPARED_PIXELS:
        return 0.0
    total = removed[compared].sum()

    def residual_ratio(residual: Values) -> float:
        squares = cv2.blur(_mean_squares(residual), (RESIDUAL_PX, RESIDUAL_PX)) - noise.by_pixel**2
        return float(np.sqrt(max(squares[compared].sum(), 0) / total))

    full_ratio = residual_ratio(residual)
    excess = full_ratio - NOISE_WEIGHT * float(np.sqrt(variance[compared].sum() / total))
    if smaller is None or excess <= MAX_CONTRADICTION:
        return excess
    smaller_ratio = residual_ratio(
        smaller.residual(here, smaller.solve(here, noise, smaller.effort))
    )
    return min(excess, DECREASE * (full_ratio - smaller_ratio))


# -- Upper limit of the fraction of a known blur that an image can contain -------------------------
#
# A sharp image blurred by a fraction of the known blur is explained, on the pixel grid and with weak
# regularisation, by every fraction up to that of the image. Beyond it the residual grows faster. The
# growth below it is a property of the blur: it is simulated once per camera, for pure noise and for a
# texture whose amplitudes are inversely proportional to the frequency. A measured growth above both
# indicates blur that the image does not contain.

LIMIT_FRACTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TOP = 0.8  # fraction from which the residual up to the full blur is compared first
EFFORT = Effort(coarse_rounds=3, rounds=0, steps=6)
MARGIN, MARGIN_OF_CODED = (
    1.3,
    2.0,
)  # relative to the expected growth; the noise of coded images is less certain
SLACK = 0.004  # tolerance of the log residual between consecutive fractions
STEEPER = 0.015  # excess growth of real textures over that of noise, near the full blur
MAX_GROWTH_RATIO = 1.6  # growth of real textures relative to the simulated one, for small fractions
# Residual of the smallest fraction, from that of noise (0) to that of the simulated texture (1)
PLAIN, TEXTURED = 0.5, 0.8
# Factor for fractions below 1: excessive blur harms, insufficient blur has little effect
CAUTION = 0.9
# Residual of the smallest fraction, relative to simulated noise: no fraction explains the image
MAX_RESIDUAL = 2.5
MAX_RESIDUAL_OF_ALL = 3.0  # same for the full blur: the image is far sharper
MIN_SHARE = 0.25  # below it the image is returned unchanged
MIN_BLUR_PX = (
    3.0  # minimum blur in both directions for a limit; smaller blur leaves too little residual
)
NOISE = 0.01  # noise of the simulated images
LEVEL, CONTRAST = 0.6, 0.2  # simulated texture, square root of light
SATURATED_PX = 15  # side of the squares around saturated pixels that are excluded


class BlurLimit:
    """Limit of the blur in images of one camera; the growth is simulated once."""

    def __init__(
        self, blur: RadialBlur, strips: list[tuple[slice, slice]], edges: list[NDArray[np.bool_]]
    ) -> None:
        self._known, self._strips, self._counted = blur, strips, edges
        self._problems: dict[float, list[BlurProblem]] = {}

    def fraction(self, roots: Values, noise: Noise) -> float:
        """Return the largest fraction of the blur that is consistent with an image; 0 if there is
        none.

        Parameters
        ----------
        roots : (h, w, 1 or 3)
            Square roots of the light of the image.
        noise
            Noise of the image.
        """
        if not self.is_blurred_both_ways:
            return 1.0
        parts = [(roots[strip], noise.window(*strip)) for strip in self._strips]
        lower, upper = (self._residual(fraction, parts) for fraction in (TOP, 1.0))
        if lower <= 0 or upper <= 0:
            return 1.0
        of_noise, of_texture = self._simulated
        steps = len(LIMIT_FRACTIONS) - 1 - LIMIT_FRACTIONS.index(TOP)
        is_coded = noise.kind == "JPEG"
        textured = 1.0 if is_coded else float(np.clip(1 - (of_noise[-1] / upper) ** 2, 0, 1))
        by_noise, by_texture = (float(np.log(of[-1] / of[-1 - steps])) for of in self._simulated)
        expected = by_noise + textured * (max(by_texture - by_noise, 0.0) + STEEPER * steps)
        if np.log(upper / lower) <= (
            MARGIN_OF_CODED if is_coded else MARGIN
        ) * expected + SLACK * steps and (upper <= MAX_RESIDUAL_OF_ALL * of_noise[-1]):
            return 1.0
        residuals = np.array([self._residual(fraction, parts) for fraction in LIMIT_FRACTIONS])
        if residuals[0] > MAX_RESIDUAL * of_noise[0]:
            return 0.0
        textured = 1.0 if is_coded else (of_noise[0] - residuals[0]) / (of_noise[0] - of_texture[0])
        textured = np.clip((textured - PLAIN) / (TEXTURED - PLAIN), 0, 1)
        noise_growth, texture_growth = (np.diff(np.log(of)) for of in self._simulated)
        limits = (
            MARGIN * (noise_growth + textured * (MAX_GROWTH_RATIO * texture_growth - noise_growth))
            + SLACK
        )
        fraction = (
            CAUTION
            * LIMIT_FRACTIONS[int(np.argmax([*(np.diff(np.log(residuals)) > limits), True]))]
        )
        return fraction if fraction >= MIN_SHARE else 0.0

    @cached_property
    def is_blurred_both_ways(self) -> bool:
        """True if the blur extends over pixels in both directions anywhere; otherwise most of the
        residual is aliasing.
        """
        for problem in self._problems_of(1.0):
            smaller = np.minimum(problem.sizes.tangential, problem.sizes.sagittal)[
                problem.known_pixels
            ]
            if smaller.max(initial=0) >= MIN_BLUR_PX:
                return True
        return False

    @cached_property
    def _simulated(self) -> tuple[Array, Array]:
        """Residuals (fractions,) of pure noise and of a blurred texture."""
        rng = np.random.default_rng(7)
        samples = []
        for contrast in (0.0, CONTRAST):
            parts = []
            for problem in self._problems_of(1.0):
                shape = problem.known_pixels.shape
                texture = np.stack([_texture(shape, rng)] * 3, axis=-1)
                sharp = np.clip(LEVEL + np.float32(contrast) * texture, 0.05, 0.97)
                light = (
                    problem.deblurring.start(sharp, sharp).blurred()
                    if problem.known_pixels.any()
                    else sharp**2
                )
                noisy = np.sqrt(light) + np.float32(NOISE) * rng.standard_normal(
                    sharp.shape
                ).astype(np.float32)
                parts.append(
                    (np.clip(noisy, 0, 0.99).astype(np.float32), specified_noise(NOISE, shape))
                )
            samples.append(
                np.array([self._residual(fraction, parts) for fraction in LIMIT_FRACTIONS])
            )
        return samples[0], samples[1]

    def _residual(self, fraction: float, parts: list[tuple[Values, Noise]]) -> float:
        """Return the RMS residual relative to the noise; 0 without valid pixels."""
        squares, count = 0.0, 0
        for (roots, noise), problem, counted in zip(
            parts, self._problems_of(fraction), self._counted, strict=True
        ):
            if not problem.known_pixels.any():
                continue
            here = problem.within(roots)
            residual = (
                problem.residual(here, problem.fitted(here, noise, EFFORT))
                / noise.by_pixel[..., None]
            )
            saturated = np.asarray((here >= SATURATED).any(axis=2), np.uint8)
            near = cv2.dilate(saturated, np.ones((SATURATED_PX, SATURATED_PX), np.uint8)) > 0
            whole = problem.known_pixels & counted & ~near
            squares += float((residual[whole] ** 2).mean(axis=1).sum())
            count += int(whole.sum())
        return float(np.sqrt(squares / max(count, 1)))

    def _problems_of(self, fraction: float) -> list[BlurProblem]:
        if fraction not in self._problems:
            blur = self._known.scaled(fraction)
            self._problems[fraction] = [BlurProblem(blur.window(*strip)) for strip in self._strips]
        return self._problems[fraction]


def _texture(shape: tuple[int, ...], rng: np.random.Generator) -> Values:
    """Return noise (h, w) of standard deviation 1 with amplitudes inversely proportional to the
    frequency.
    """
    height, width = shape
    frequency = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None])
    frequency[0, 0] = np.inf
    drawn = rng.standard_normal(frequency.shape) + 1j * rng.standard_normal(frequency.shape)
    grey = np.fft.irfft2(drawn / frequency, (height, width))
    return np.asarray(grey / grey.std(), np.float32)


# -- Estimation of the fraction of a known blur that an image contains -----------------------------
#
# If the assumed blur is too small, restoration gains less; if it is too large, it harms. The latter
# is detectable: the residual of the sharp image grows uniformly with the removed blur up to that of
# the image, and faster beyond it. Several fractions of the blur are therefore tested on two strips
# through the axis with few steps.
#
# Large blur on few pixels, which resolve little of its shape, leaves larger residuals at some radii
# as if it were too large: the median bend over the radii is used if the mean over all radii indicates
# one. If all tested fractions are too large, the residual grows uniformly again, but strongly.
#
# If the residual grows little and exceeds the noise, the image contains little more than noise and
# equally faint texture. Such an image would not reveal an excessive blur, gains little from the
# correct blur and is harmed by more; less is removed. A uniform image does not reveal it either, but
# its residual is its noise, and no texture could be harmed.

TESTED_FRACTIONS = (0.6, 0.7, 0.8, 0.9)
# Second difference of the residual, relative to that of the smallest fraction
BEND, BEND_OF_CODED = 0.012, 0.02
BEND_AGAIN = 0.02  # a second reduction requires a larger bend
# Sum of both second differences if neither is significant: the bend extends over all fractions
SPREAD = 0.018
MIN_FRACTION = 0.3
# Ratio of the residuals of the largest and smallest fraction of large blur: too large
MUCH, MUCH_OF_EXPLAINED = 1.3, 1.4
# Minimum growth of the residual from the smallest to the largest fraction; fraction used below it
GROWTH, UNSEEN_SHARE = 0.075, 0.85
EXPLAINED = 1.0  # residual of the smallest fraction in units of the noise: no undetected texture
TEST_EFFORT = Effort(coarse_rounds=0, rounds=2, steps=4)
BANDS = 5  # radial bands
STRIP, MIN_STRIP_PX, EDGE_PX = (
    1 / 32,
    28,
    9,
)  # half width, relative to the image; edge region that is excluded


class BlurScale:
    """Estimator of the fraction of a known blur in images; image-independent data are prepared
    once.
    """

    def __init__(self, blur: RadialBlur) -> None:
        self._known = blur
        self._half = max(MIN_STRIP_PX, round(STRIP * max(blur.offsets.shape[:2])))
        self._strips = _strips(blur, self._half)
        edges = [
            np.abs(blur.offsets[strip]).min(axis=2) < self._half - EDGE_PX for strip in self._strips
        ]
        self._limit = BlurLimit(blur, self._strips, edges)
        self._prepared: dict[float, list[BlurProblem]] = {}

    @property
    def is_limited(self) -> bool:
        """True if the residuals of an image limit the fraction of its blur."""
        return self._limit.is_blurred_both_ways

    def blur_fraction(self, roots: Values, noise: Noise, *, may_be_sharper: bool = True) -> float:
        """Return the fraction of the known blur in an image: 1 unless it is sharper or has too
        little detail.

        Parameters
        ----------
        roots : (h, w, 1 or 3)
            Square roots of the light of the image.
        noise
            Noise of the image.
        may_be_sharper
            False if edges and texture are known to be consistent with all of the blur.

        Notes
        -----
        Accurate to 0.1 to 0.2 for images with edges; a blur given up to 20 % too large is not
        always detected. 0.85 for an image full of texture that conceals it.
        """
        noise = noise.at_least(MIN_ASSUMED_NOISE)
        limit = self._limit.fraction(roots, noise) if may_be_sharper else 1.0
        return min(limit, self._fraction_at_bend(roots, noise)) if limit > 0 else 0.0

    def _fraction_at_bend(self, roots: Values, noise: Noise) -> float:
        """Return the fraction at the bend of the residual of the regularised image."""
        limit = BEND_OF_CODED if noise.kind == "JPEG" else BEND
        fraction = 1.0
        while fraction > MIN_FRACTION:
            residual = np.array(
                [
                    self._relative_residuals(fraction * part, roots, noise)
                    for part in TESTED_FRACTIONS
                ]
            )
            is_positive = (residual > 0).all(axis=0)
            if not is_positive.any():
                return fraction
            grown = (residual / np.maximum(residual[:1], 1e-9))[:, is_positive]
            is_explained = residual[0, is_positive].mean() <= EXPLAINED
            much = MUCH_OF_EXPLAINED if is_explained else MUCH
            bend = self._bend(grown, limit, much, is_lowered=fraction < 1)
            if bend is None:
                is_unseen = grown[-1].mean() < 1 + GROWTH and (
                    noise.kind == "JPEG" or not is_explained
                )
                return UNSEEN_SHARE if fraction == 1 and is_unseen else fraction
            fraction *= TESTED_FRACTIONS[1 + bend]
            limit = max(limit, BEND_AGAIN)
        return fraction

    def _bend(self, grown: Array, limit: float, much: float, *, is_lowered: bool) -> int | None:
        """Return the index of the middle fraction at the bend of the residual, (fractions, bands);
        None without bend.
        """
        mean, median = grown.mean(axis=1), np.median(grown, axis=1)
        if not self._is_large:
            return _bend_of(mean, limit, is_lowered)
        if is_lowered:
            first, second = np.diff(median, 2)
            is_undone = second < -first / 2  # the median alternates between radii
            bend = None if is_undone else _bend_of(median, limit, is_lowered)
            return 0 if bend is None and median[-1] > much else bend
        of_mean, of_most = (_bend_of(of, limit, is_lowered) for of in (mean, median))
        if of_mean is None:
            return 0 if mean[-1] > much else None
        return len(TESTED_FRACTIONS) - 2 if of_most is None else max(of_mean, of_most)

    @cached_property
    def _is_large(self) -> bool:
        return any(problem.is_large_anywhere for problem in self._problems(TESTED_FRACTIONS[-1]))

    def _relative_residuals(self, fraction: float, roots: Values, noise: Noise) -> Array:
        """Return the RMS residual (bands,) relative to the noise for each radius; 0 for bands
        without pixels.
        """
        squares, counts = np.zeros(BANDS), np.zeros(BANDS)
        for strip, problem in zip(self._strips, self._problems(fraction), strict=True):
            if not problem.known_pixels.any():
                continue
            here = problem.within(roots[strip])
            of_strip = noise.window(*strip)
            residual = (
                problem.residual(here, problem.solve(here, of_strip, TEST_EFFORT))
                / of_strip.by_pixel[..., None]
            )
            whole = problem.known_pixels & (
                np.abs(problem.known.offsets).min(axis=2) < self._half - EDGE_PX
            )
            band = np.minimum(
                BANDS * problem.known.radius / self._known.whole_radius_px, BANDS - 1
            ).astype(int)[whole]
            squares += np.bincount(band, (residual**2).mean(axis=2)[whole], BANDS)
            counts += np.bincount(band, minlength=BANDS)
        return np.asarray(np.sqrt(squares / np.maximum(counts, 1)))

    def _problems(self, fraction: float) -> list[BlurProblem]:
        """Return one problem per strip; those used for every image are cached."""
        problems = self._prepared.get(fraction)
        if problems is None:
            problems = [
                BlurProblem(self._known.window(*strip).scaled(fraction)) for strip in self._strips
            ]
            if fraction in TESTED_FRACTIONS:
                self._prepared[fraction] = problems
        return problems


def _bend_of(grown: Array, limit: float, is_lowered: bool) -> int | None:
    """Return the index of the middle fraction at the bend of values (fractions,)."""
    first, second = np.diff(grown, 2)
    bends = np.array([first, second + min(first, 0)])  # a preceding dip is not a bend
    is_spread = is_lowered and min(first, second) > 0 and first + second > SPREAD
    return int(np.argmax(bends)) if bends.max() >= limit or is_spread else None


def _strips(blur: RadialBlur, half: int) -> list[tuple[slice, slice]]:
    """Return rows and columns of two strips through the axis, across and down."""
    across, down = blur.offsets[0, :, 0], blur.offsets[:, 0, 1]
    rows, columns = (np.flatnonzero(np.abs(offsets) <= half) for offsets in (down, across))
    strips = []
    if len(rows):
        strips.append((slice(rows[0], rows[-1] + 1), slice(None)))
    if len(columns):
        strips.append((slice(None), slice(columns[0], columns[-1] + 1)))
    return strips
