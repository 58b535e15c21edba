"""How much of its known blur a picture shows.

Told too little blur, restoring gains less; told too much, it harms. Too much shows: what a sharp picture leaves
unexplained grows evenly with the blur that is taken out, up to that of the picture, and faster beyond. So a few shares
of the blur are tried, on two strips through the axis and with few steps.

Large blur on few pixels, which show little of its shape, leaves over more at some radii as if it were told too large:
the bend counts that half of the radii have, once the mean of all says that there is one. And where all shares are too
large, it grows evenly again, but much.

Where it hardly grows at all and is more than noise, there is little to be seen but noise and texture as faint: such a
picture would not show that its blur was told too large, gains little by the right one, and is harmed by more. There
less is taken out. A plain picture does not show it either, but what is left is its noise: no texture could be harmed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...base.numerics.lazy import cached_property
from .blur_limit import BlurLimit
from .blur_problem import BlurProblem
from .deconvolution import Effort
from .noise import Noise
from .round_blur import RoundBlur

Values = NDArray[np.float32]
Array = NDArray[np.float64]

SHARES = (0.6, 0.7, 0.8, 0.9)
BEND, BEND_OF_CODED = 0.012, 0.02  # second difference of what is left over, of that of the least share
BEND_AGAIN = 0.02  # it must be plain that even what was lowered once is too large
SPREAD = 0.018  # of both second differences together, where neither is plain: the bend goes over all shares
LEAST_SHARE = 0.3
MUCH, MUCH_OF_EXPLAINED = 1.3, 1.4  # times what the least share of large blur leaves over, by the most: too large
GROWTH, UNSEEN_SHARE = 0.075, 0.85  # of what is left over, from the least share to the most, under which none is seen
EXPLAINED = 1.0  # of the noise, left over by the least share: there is no texture that was not found
FEW = Effort(coarse_rounds=0, rounds=2, steps=4)
LEAST_NOISE = np.float32(0.007)  # blur as it is known errs as much, and less noise would show that instead
BANDS = 5  # of the radius
STRIP, LEAST_STRIP_PX, EDGE_PX = 1 / 32, 28, 9  # half its width, of the picture; what ends at its edge does not count


class BlurScale:
    """Finds the share of a known blur that pictures show; what does not depend on the picture is prepared once."""

    def __init__(self, known: RoundBlur) -> None:
        self._known = known
        self._half = max(LEAST_STRIP_PX, round(STRIP * max(known.offsets.shape[:2])))
        self._strips = _strips(known, self._half)
        edges = [np.abs(known.offsets[strip]).min(axis=2) < self._half - EDGE_PX for strip in self._strips]
        self._limit = BlurLimit(known, self._strips, edges)
        self._prepared: dict[float, list[BlurProblem]] = {}

    def shown_share(self, roots: Values, noise: Noise) -> float:
        """The share of its known blur that a picture shows: 1 unless it is sharper than that, or shows too little.

        Parameters
        ----------
        roots : (h, w, 1 or 3)
            Roots of the light of the picture.
        noise
            Of the picture.

        Notes
        -----
        Right to a tenth or two where there are edges; blur told up to a fifth too large is not always seen. For a
        picture full of texture that hides it, 0.85.
        """
        noise = noise.at_least(LEAST_NOISE)
        limit = self._limit.share(roots, noise)
        return min(limit, self._bent_share(roots, noise)) if limit > 0 else 0.0

    def _bent_share(self, roots: Values, noise: Noise) -> float:
        """Return the share at which the residual of the regularised image bends."""
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
        """Which of the middle shares what is left over, (shares, bands), bends at, if it does."""
        mean, most = grown.mean(axis=1), np.median(grown, axis=1)
        if not self._is_large:
            return _bend_of(mean, limit, is_lowered)
        if is_lowered:
            first, second = np.diff(most, 2)
            is_undone = second < -first / 2  # half of the radii are now these, now those
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
        """Root of the mean square (bands,) of what is left over, over noise, by the radius; 0 where none is seen."""
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
        """One for each strip; those that every picture asks for are kept."""
        found = self._prepared.get(share)
        if found is None:
            found = [BlurProblem(self._known.window(*strip).scaled(share)) for strip in self._strips]
            if share in SHARES:
                self._prepared[share] = found
        return found


def _bend_of(grown: Array, limit: float, is_lowered: bool) -> int | None:
    """Which of the middle shares one value (shares,) for each of them bends at."""
    first, second = np.diff(grown, 2)
    bends = np.array([first, second + min(first, 0)])  # a dip before is no bend
    is_spread = is_lowered and min(first, second) > 0 and first + second > SPREAD
    return int(np.argmax(bends)) if bends.max() >= limit or is_spread else None


def _strips(known: RoundBlur, half: int) -> list[tuple[slice, slice]]:
    """Rows and columns of two strips through the axis, across and down."""
    across, down = known.offsets[0, :, 0], known.offsets[:, 0, 1]
    rows, columns = (np.flatnonzero(np.abs(offsets) <= half) for offsets in (down, across))
    strips = []
    if len(rows):
        strips.append((slice(rows[0], rows[-1] + 1), slice(None)))
    if len(columns):
        strips.append((slice(None), slice(columns[0], columns[-1] + 1)))
    return strips
