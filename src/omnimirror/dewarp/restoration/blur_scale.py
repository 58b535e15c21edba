"""Estimation of the fraction of a known blur that an image contains.

If the assumed blur is too small, restoration gains less; if it is too large, it harms. The latter
is detectable: the residual of the sharp image grows uniformly with the removed blur up to that of
the image, and faster beyond it. Several fractions of the blur are therefore tested on two strips
through the axis with few steps.

Large blur on few pixels, which resolve little of its shape, leaves larger residuals at some radii
as if it were too large: the median bend over the radii is used if the mean over all radii indicates
one. If all tested fractions are too large, the residual grows uniformly again, but strongly.

If the residual hardly grows and exceeds the noise, the image contains little more than noise and
equally faint texture. Such an image would not reveal an excessive blur, gains little from the
correct blur and is harmed by more; less is removed. A uniform image does not reveal it either, but
its residual is its noise, and no texture could be harmed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from ...base.typing import Array
from .blur_limit import BlurLimit
from .blur_problem import BlurProblem
from .deconvolution import Effort
from .noise import Noise
from .round_blur import RoundBlur

Values = NDArray[np.float32]

SHARES = (0.6, 0.7, 0.8, 0.9)
# Second difference of the residual, relative to that of the smallest fraction
BEND, BEND_OF_CODED = 0.012, 0.02
BEND_AGAIN = 0.02  # a second reduction requires a larger bend
# Sum of both second differences if neither is significant: the bend extends over all fractions
SPREAD = 0.018
LEAST_SHARE = 0.3
# Ratio of the residuals of the largest and smallest fraction of large blur: too large
MUCH, MUCH_OF_EXPLAINED = 1.3, 1.4
# Minimum growth of the residual from the smallest to the largest fraction; fraction used below it
GROWTH, UNSEEN_SHARE = 0.075, 0.85
EXPLAINED = 1.0  # residual of the smallest fraction in units of the noise: no undetected texture
FEW = Effort(coarse_rounds=0, rounds=2, steps=4)
LEAST_NOISE = np.float32(0.007)  # the error of the known blur; lower noise would expose this error instead
BANDS = 5  # radial bands
STRIP, LEAST_STRIP_PX, EDGE_PX = 1 / 32, 28, 9  # half width, relative to the image; edge region that is excluded


class BlurScale:
    """Estimator of the fraction of a known blur in images; image-independent data are prepared
    once.
    """

    def __init__(self, known: RoundBlur) -> None:
        self._known = known
        self._half = max(LEAST_STRIP_PX, round(STRIP * max(known.offsets.shape[:2])))
        self._strips = _strips(known, self._half)
        edges = [np.abs(known.offsets[strip]).min(axis=2) < self._half - EDGE_PX for strip in self._strips]
        self._limit = BlurLimit(known, self._strips, edges)
        self._prepared: dict[float, list[BlurProblem]] = {}

    def shown_share(self, roots: Values, noise: Noise) -> float:
        """Return the fraction of the known blur in an image: 1 unless it is sharper or has too
        little detail.

        Parameters
        ----------
        roots : (h, w, 1 or 3)
            Square roots of the light of the image.
        noise
            Noise of the image.

        Notes
        -----
        Accurate to 0.1 to 0.2 for images with edges; a blur given up to 20 % too large is not
        always detected. 0.85 for an image full of texture that conceals it.
        """
        noise = noise.at_least(LEAST_NOISE)
        limit = self._limit.share(roots, noise)
        return min(limit, self._bent_share(roots, noise)) if limit > 0 else 0.0

    def _bent_share(self, roots: Values, noise: Noise) -> float:
        """Return the fraction at the bend of the residual of the regularised image."""
        limit = BEND_OF_CODED if noise.kind == "JPEG" else BEND
        share = 1.0
        while share > LEAST_SHARE:
            left = np.array([self._left_over(share * part, roots, noise) for part in SHARES])
            seen = (left > 0).all(axis=0)
            if not seen.any():
                return share
            grown = (left / np.maximum(left[:1], 1e-9))[:, seen]
            is_explained = left[0, seen].mean() <= EXPLAINED
            much = MUCH_OF_EXPLAINED if is_explained else MUCH
            bend = self._bend(grown, limit, much, is_lowered=share < 1)
            if bend is None:
                is_unseen = grown[-1].mean() < 1 + GROWTH and (noise.kind == "JPEG" or not is_explained)
                return UNSEEN_SHARE if share == 1 and is_unseen else share
            share *= SHARES[1 + bend]
            limit = max(limit, BEND_AGAIN)
        return share

    def _bend(self, grown: Array, limit: float, much: float, *, is_lowered: bool) -> int | None:
        """Return the index of the middle fraction at the bend of the residual, (fractions, bands);
        None without bend.
        """
        mean, most = grown.mean(axis=1), np.median(grown, axis=1)
        if not self._is_large:
            return _bend_of(mean, limit, is_lowered)
        if is_lowered:
            first, second = np.diff(most, 2)
            is_undone = second < -first / 2  # the median alternates between radii
            bend = None if is_undone else _bend_of(most, limit, is_lowered)
            return 0 if bend is None and most[-1] > much else bend
        of_mean, of_most = (_bend_of(of, limit, is_lowered) for of in (mean, most))
        if of_mean is None:
            return 0 if mean[-1] > much else None
        return len(SHARES) - 2 if of_most is None else max(of_mean, of_most)

    @cached_property
    def _is_large(self) -> bool:
        return any(problem.is_large_anywhere for problem in self._problems(SHARES[-1]))

    def _left_over(self, share: float, roots: Values, noise: Noise) -> Array:
        """Return the RMS residual (bands,) relative to the noise for each radius; 0 for bands
        without pixels.
        """
        squares, counts = np.zeros(BANDS), np.zeros(BANDS)
        for strip, problem in zip(self._strips, self._problems(share), strict=True):
            if not problem.known_pixels.any():
                continue
            here = problem.within(roots[strip])
            of_strip = noise.window(*strip)
            left = problem.left_over(here, problem.solved(here, of_strip, FEW)) / of_strip.by_pixel[..., None]
            whole = problem.known_pixels & (np.abs(problem.known.offsets).min(axis=2) < self._half - EDGE_PX)
            band = np.minimum(BANDS * problem.known.radius / self._known.whole_radius_px, BANDS - 1).astype(int)[whole]
            squares += np.bincount(band, (left**2).mean(axis=2)[whole], BANDS)
            counts += np.bincount(band, minlength=BANDS)
        return np.asarray(np.sqrt(squares / np.maximum(counts, 1)))

    def _problems(self, share: float) -> list[BlurProblem]:
        """Return one problem per strip; those used for every image are cached."""
        found = self._prepared.get(share)
        if found is None:
            found = [BlurProblem(self._known.window(*strip).scaled(share)) for strip in self._strips]
            if share in SHARES:
                self._prepared[share] = found
        return found


def _bend_of(grown: Array, limit: float, is_lowered: bool) -> int | None:
    """Return the index of the middle fraction at the bend of values (fractions,)."""
    first, second = np.diff(grown, 2)
    bends = np.array([first, second + min(first, 0)])  # a preceding dip is not a bend
    is_spread = is_lowered and min(first, second) > 0 and first + second > SPREAD
    return int(np.argmax(bends)) if bends.max() >= limit or is_spread else None


def _strips(known: RoundBlur, half: int) -> list[tuple[slice, slice]]:
    """Return rows and columns of two strips through the axis, across and down."""
    across, down = known.offsets[0, :, 0], known.offsets[:, 0, 1]
    rows, columns = (np.flatnonzero(np.abs(offsets) <= half) for offsets in (down, across))
    strips = []
    if len(rows):
        strips.append((slice(rows[0], rows[-1] + 1), slice(None)))
    if len(columns):
        strips.append((slice(None), slice(columns[0], columns[-1] + 1)))
    return strips
