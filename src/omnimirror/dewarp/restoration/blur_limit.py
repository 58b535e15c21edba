"""Upper limit of the fraction of a known blur that an image can contain.

A sharp image blurred by a fraction of the known blur is explained, on the pixel grid and with weak
regularisation, by every fraction up to that of the image. Beyond it the residual grows faster. The
growth below it is a property of the blur: it is simulated once per camera, for pure noise and for a
texture whose amplitudes are inversely proportional to the frequency. A measured growth above both
indicates blur that the image does not contain.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from .blur_problem import BlurProblem
from .deconvolution import Effort
from .noise import Noise, told_noise
from .round_blur import RoundBlur
from .sharp_picture import SATURATED

Values = NDArray[np.float32]

SHARES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 1.0)
TOP = 0.8  # fraction from which the residual up to the full blur is compared first
EFFORT = Effort(coarse_rounds=3, rounds=0, steps=6)
MARGIN, MARGIN_OF_CODED = 1.3, 2.0  # relative to the expected growth; the noise of coded images is less certain
SLACK = 0.004  # tolerance of the log residual between consecutive fractions
STEEPER = 0.015  # excess growth of real textures over that of noise, near the full blur
STEEPEST = 1.6  # growth of real textures relative to the simulated one, for small fractions
# Residual of the smallest fraction, from that of noise (0) to that of the simulated texture (1)
PLAIN, TEXTURED = 0.5, 0.8
# Factor for fractions below 1: excessive blur harms, insufficient blur has little effect
CAUTION = 0.9
# Residual of the smallest fraction, relative to simulated noise: no fraction explains the image
MAX_RESIDUAL = 2.5
MAX_RESIDUAL_OF_ALL = 3.0  # same for the full blur: the image is far sharper
MIN_SHARE = 0.25  # below it the image is returned unchanged
MIN_BLUR_PX = 4.0  # minimum blur in both directions for a limit
NOISE = 0.01  # noise of the simulated images
LEVEL, CONTRAST = 0.6, 0.2  # simulated texture, square root of light
SATURATED_PX = 15  # side of the squares around saturated pixels that are excluded


class BlurLimit:
    """Limit of the blur in images of one camera; the growth is simulated once."""

    def __init__(self, known: RoundBlur, strips: list[tuple[slice, slice]], edges: list[NDArray[np.bool_]]) -> None:
        self._known, self._strips, self._counted = known, strips, edges
        self._problems: dict[float, list[BlurProblem]] = {}

    def share(self, roots: Values, noise: Noise) -> float:
        """Return the largest fraction of the blur that is consistent with an image; 0 if there is
        none.

        Parameters
        ----------
        roots : (h, w, 1 or 3)
            Square roots of the light of the image.
        noise
            Noise of the image.
        """
        if not self._is_blurred_both_ways:
            return 1.0
        parts = [(roots[strip], noise.window(*strip)) for strip in self._strips]
        least, most = (self._residual(share, parts) for share in (TOP, 1.0))
        if least <= 0 or most <= 0:
            return 1.0
        of_noise, of_texture = self._simulated
        steps = len(SHARES) - 1 - SHARES.index(TOP)
        is_coded = noise.kind == "JPEG"
        textured = 1.0 if is_coded else float(np.clip(1 - (of_noise[-1] / most) ** 2, 0, 1))
        by_noise, by_texture = (float(np.log(of[-1] / of[-1 - steps])) for of in self._simulated)
        expected = by_noise + textured * (max(by_texture - by_noise, 0.0) + STEEPER * steps)
        if np.log(most / least) <= (MARGIN_OF_CODED if is_coded else MARGIN) * expected + SLACK * steps and (
            most <= MAX_RESIDUAL_OF_ALL * of_noise[-1]
        ):
            return 1.0
        residuals = np.array([self._residual(share, parts) for share in SHARES])
        if residuals[0] > MAX_RESIDUAL * of_noise[0]:
            return 0.0
        textured = 1.0 if is_coded else (of_noise[0] - residuals[0]) / (of_noise[0] - of_texture[0])
        textured = np.clip((textured - PLAIN) / (TEXTURED - PLAIN), 0, 1)
        noise_growth, texture_growth = (np.diff(np.log(of)) for of in self._simulated)
        limits = MARGIN * (noise_growth + textured * (STEEPEST * texture_growth - noise_growth)) + SLACK
        share = CAUTION * SHARES[int(np.argmax([*(np.diff(np.log(residuals)) > limits), True]))]
        return share if share >= MIN_SHARE else 0.0

    @cached_property
    def _is_blurred_both_ways(self) -> bool:
        """True if the blur extends over pixels in both directions anywhere; otherwise most of the
        residual is aliasing.
        """
        for problem in self._problems_of(1.0):
            smaller = np.minimum(problem.sizes.tangential, problem.sizes.sagittal)[problem.known_pixels]
            if smaller.max(initial=0) >= MIN_BLUR_PX:
                return True
        return False

    @cached_property
    def _simulated(self) -> tuple[Array, Array]:
        """Residuals (fractions,) of pure noise and of a blurred texture."""
        rng = np.random.default_rng(7)
        found = []
        for contrast in (0.0, CONTRAST):
            parts = []
            for problem in self._problems_of(1.0):
                shape = problem.known_pixels.shape
                texture = np.stack([_texture(shape, rng)] * 3, axis=-1)
                sharp = np.clip(LEVEL + np.float32(contrast) * texture, 0.05, 0.97)
                light = problem.deblurring.start(sharp, sharp).blurred() if problem.known_pixels.any() else sharp**2
                noisy = np.sqrt(light) + np.float32(NOISE) * rng.standard_normal(sharp.shape).astype(np.float32)
                parts.append((np.clip(noisy, 0, 0.99).astype(np.float32), told_noise(NOISE, shape)))
            found.append(np.array([self._residual(share, parts) for share in SHARES]))
        return found[0], found[1]

    def _residual(self, share: float, parts: list[tuple[Values, Noise]]) -> float:
        """Return the RMS residual relative to the noise; 0 without valid pixels."""
        squares, count = 0.0, 0
        for (roots, noise), problem, counted in zip(parts, self._problems_of(share), self._counted, strict=True):
            if not problem.known_pixels.any():
                continue
            here = problem.within(roots)
            left = problem.left_over(here, problem.fitted(here, noise, EFFORT)) / noise.by_pixel[..., None]
            saturated = np.asarray((here >= SATURATED).any(axis=2), np.uint8)
            near = cv2.dilate(saturated, np.ones((SATURATED_PX, SATURATED_PX), np.uint8)) > 0
            whole = problem.known_pixels & counted & ~near
            squares += float((left[whole] ** 2).mean(axis=1).sum())
            count += int(whole.sum())
        return float(np.sqrt(squares / max(count, 1)))

    def _problems_of(self, share: float) -> list[BlurProblem]:
        if share not in self._problems:
            known = self._known.scaled(share)
            self._problems[share] = [BlurProblem(known.window(*strip)) for strip in self._strips]
        return self._problems[share]


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
