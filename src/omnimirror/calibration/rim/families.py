"""Features of a ring relative to its concentric rings: number, clarity and bands between them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array
from .bands import FAINT
from .cues import FAMILY_OFFSET, Ring

STRETCH = 0.04  # maximum difference of the shapes of rings in a family
SHARES = ((0.2, 0.5), (0.5, 0.8), (0.8, 0.93), (0.93, 0.988), (1.012, 1.06), (1.06, 1.2), (1.2, 1.6))
"""Fractions of the ring's radius between which the clearest other ring is searched."""
WITHIN, ABOUT = (0.6, 0.988), (1.012, 1.5)  # fractions of the radius for the next ring
LEAST, CLEAR, NEXT = 0.4, 0.7, 0.55  # fraction of the circumference with a close edge


def relations(rings: Sequence[Ring], chosen: Sequence[int]) -> Array:
    """Return features (len(chosen), 23) of the chosen rings relative to their concentric rings."""
    centres = np.array([ring.ellipse.centre for ring in rings])
    radii = np.array([ring.ellipse.radius for ring in rings])
    shapes = np.array([ring.ellipse.stretch for ring in rings])
    close = np.array([ring.close for ring in rings])
    found = np.array([ring.support * ring.seen for ring in rings])
    rows = []
    for i in chosen:
        family = (np.hypot(*(centres - centres[i]).T) < FAMILY_OFFSET * radii[i]) & (
            np.hypot(*(shapes - shapes[i]).T) < STRETCH
        )
        shares = np.where(family, radii / radii[i], np.nan)
        clearest = [max(0.0, float(close[_in(shares, part)].max(initial=0.0)) - LEAST) for part in SHARES]
        clear = close > CLEAR
        outside, inside = np.log1p([(clear & (shares > ABOUT[0])).sum(), (clear & (shares < WITHIN[1])).sum()])
        rank = [
            close[i] - close.max(), found[i] - found.max(), close[i] - close[family].max(),
            np.log1p((close > close[i]).sum()),
        ]  # fmt: skip
        near = [_next(rings, i, shares, close, part) for part in (WITHIN, ABOUT)]
        rows.append([*clearest, outside, inside, *rank, *near[0], *near[1]])
    return np.array(rows)


def _in(shares: Array, part: tuple[float, float]) -> NDArray[np.bool_]:
    return (shares > part[0]) & (shares < part[1])


def _next(rings: Sequence[Ring], i: int, shares: Array, close: Array, part: tuple[float, float]) -> list[float]:
    """Return features of the next clear ring on one side.

    They are its clarity, distance, band texture, calmness and relative clarity.
    """
    others = np.nonzero(_in(shares, part) & (close > NEXT))[0]
    if not len(others):
        return [0.0, 0.0, 0.0, np.nan, 0.0]
    j = int(others[np.argmin(np.abs(np.log(shares[others])))])
    inner, outer = sorted((rings[i], rings[j]), key=lambda ring: ring.ellipse.radius)
    share = outer.ellipse.radius / inner.ellipse.radius
    gap = min(0.02, (share - 1) / 3)
    texture = inner.band(1 + gap, share - gap)
    return [
        close[j], float(np.log(np.log(share))), inner.calm(1 + gap, share - gap),
        float(np.log(FAINT + np.nan_to_num(texture))), close[j] - close[i],
    ]  # fmt: skip
