"""Which of a picture's rings is the rim, and how sure that is: odds of every ring, and of none of them.

A first look at few cues leaves a short list. A committee of small networks judges that on all cues; what it learned
from is told in ``committee.json``, which `python benchmarks/rim.py --learn` writes.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .bands import numbers_round
from .cues import Cues, Ring, cues_of
from .edges import Working
from .families import relations

Array = NDArray[np.float64]

COMMITTEE = Path(__file__).with_name("committee.json")
SHORT = 16  # rings on the short list
UNLISTED = -12.0  # log odds of the others
WIDEST = 3.0  # usual spreads, to which numbers are clipped: beyond nothing was learned
FLAT = -4.0  # logarithm of the texture, below which nothing is shown
FIRST_WEIGHTS = np.array([
    -4.618, -13.802, 37.574, 6.644, 2.612, -0.735, 2.376, 3.336, 15.435, -0.627, -8.214, 0.571, 3.825, -0.427,
    -0.112, -0.330, -8.023, 4.366, -1.375, 5.955, -7.839, -3.630,
])  # fmt: skip
FIRST_NONE = 19.886
SAME_RANK, LEAST_MARGIN, LEAST_ODDS = (-1.5, 0.4), (1.55, 0.04), (-1.7, 0.2)  # middles and widths, log odds
PARALLEL_WEIGHT, USUAL_PARALLEL, MOST_PARALLEL = 30.0, 0.1, 0.2  # of the share of the way round with parallel edges
FAINT_RING, CLEAR_RING, HOUSING_COST = 0.6, 0.75, 6.0  # shares of the way round of a ring within, and log odds
FIRST = -2  # place of what they say among the numbers


@dataclass(frozen=True)
class Member:
    """One of the committee: what is linear in the numbers, and a few bends."""

    linear: Array
    bias: float
    hidden: Array
    shift: Array
    out: Array

    def odds(self, numbers: Array) -> Array:
        """Logarithms of odds (n,) of numbers (n, count)."""
        found: Array = numbers @ self.linear + self.bias + np.tanh(numbers @ self.hidden + self.shift) @ self.out
        return found


@dataclass(frozen=True)
class Committee:
    """Members, and how the numbers that they are asked about are scaled."""

    middle: Array
    spread: Array
    members: tuple[Member, ...]
    trust: float
    """Times which the mean of their odds is believed, as other pictures tell."""
    first_share: float
    """Times which the first look is, which learned from fewer kinds of pictures: it holds where theirs end."""

    @classmethod
    def from_json(cls, told: dict[str, Any]) -> Committee:
        """As its file holds it."""
        members = [
            Member(*(np.array(one[name]) for name in ("linear", "bias", "hidden", "shift", "out")))  # type: ignore[arg-type]
            for one in told["members"]
        ]
        trust, first_share = float(told["trust"]), float(told["first_share"])
        return cls(np.array(told["middle"]), np.array(told["spread"]), tuple(members), trust, first_share)

    def scaled(self, rows: Array) -> Array:
        """Rows (n, count) of numbers in usual spreads about the middle, where they are not known 0."""
        found: Array = np.clip(np.nan_to_num((rows - self.middle) / self.spread), -WIDEST, WIDEST)
        return found

    def judged(self, rows: Array) -> Array:
        """What each of the members says (members, n) of rows (n, count) of numbers."""
        numbers = self.scaled(rows)
        return np.stack([member.odds(numbers) for member in self.members])

    def odds(self, rows: Array) -> Array:
        """Logarithms (members, n) of the odds of rows (n, count) of numbers against there being no rim."""
        return self.trust * self.judged(rows) + self.first_share * np.maximum(rows[:, FIRST], UNLISTED)


@cache
def committee() -> Committee:
    """The one that comes with the package."""
    return Committee.from_json(json.loads(COMMITTEE.read_text()))


def odds(rings: Sequence[Ring], working: Working) -> Array:
    """Logarithms (members, n) of the odds of every ring against there being no rim among them, by each of the
    committee."""
    every = np.full((len(committee().members), len(rings)), UNLISTED)
    if len(rings):
        listed, rows = listed_rows(list(rings), working)
        every[:, listed] = np.maximum(committee().odds(rows), UNLISTED)
    return every


def listed_rows(rings: list[Ring], working: Working) -> tuple[NDArray[np.intp], Array]:
    """The rings of the short list, best first, and a row of numbers for each."""
    size = working.size
    first = np.array([terms(cues) for cues in cues_of(rings, min(size))])
    found = first @ FIRST_WEIGHTS - FIRST_NONE
    listed = np.argsort(-found, kind="stable")[:SHORT]
    rows = []
    for i in listed:
        ellipse = rings[i].ellipse
        away = np.hypot(*np.subtract(ellipse.centre, np.divide(size, 2))) / min(size)
        place = [away, 10 * np.hypot(*ellipse.stretch), 2 * ellipse.radius / size[0]]
        rows.append(np.concatenate([first[i], numbers_round(working, ellipse), place]))
    ahead = np.stack([found[listed], found[listed] - found.max()], axis=1)
    return listed, np.hstack([np.array(rows), relations(rings, [int(i) for i in listed]), ahead])


def terms(cues: Cues) -> Array:
    """What is weighed first (22,): the cues within the ranges that were met, and what bends."""
    ends, near = np.clip([cues.ends, cues.ends_near], -3.0, 3.0)
    return np.array([
        cues.support, cues.support**2, cues.close, cues.close**2, cues.chance, np.clip(cues.step, -2.5, 1.0),
        np.clip(cues.differs, -2.0, 2.0), max(cues.continues, 0.0), cues.seen, cues.radius, cues.radius**2,
        cues.texture, min(cues.texture - FLAT, 0.0), ends, min(ends, 0.0), near, cues.calm_inside, cues.calm_outside,
        cues.framed, cues.frames, cues.within, cues.about,
    ])  # fmt: skip


def confidence(odds: Array, rivals: Array, chance: float, within: float = 0.0, *, evidence: float = 1.0) -> float:
    """Confidence that a ring is the mirror's outline, from its agreement between working resolutions.

    It is the product of three shares, each between 0 and 1:

    - The agreement: at how many resolutions the ring is the best one, by its margin over the best other ring. That of
      two of three resolutions is a third.
    - The mean margin over the best other ring.
    - The mean log odds against there being no mirror. A mirror compresses its surroundings towards its outline, so that
      edges parallel to the outline lie beside it; a plate or a lamp of one colour has none. Those edges count as well,
      unless a clear ring about the same centre lies within: then the mirror may be that, and this its housing.

    Parameters
    ----------
    odds, rivals : (resolutions,)
        Log odds of the ring at each resolution, and of the best other ring.
    chance
        Share of the way round with edges parallel to the ring beside it.
    within
        Share of the way round with edges of the clearest ring about the same centre within.
    evidence
        Factor of the odds: of several pictures of one sensor the square root of their number.
    """
    margin = odds - rivals
    agreement = float(np.mean(_share(margin, SAME_RANK)))
    parallel = PARALLEL_WEIGHT * (min(chance, MOST_PARALLEL) - USUAL_PARALLEL)
    housing = min(max((within - FAINT_RING) / (CLEAR_RING - FAINT_RING), 0.0), 1.0)
    mirror = evidence * float(np.mean(odds)) + (1 - housing) * parallel - housing * HOUSING_COST
    ranked = float(_share(np.float64(np.mean(margin)), LEAST_MARGIN))
    return max(0.0, 2 * agreement - 1) * ranked * float(_share(np.float64(mirror), LEAST_ODDS))


def _share(values: Array | np.float64, middle: tuple[float, float]) -> Array:
    """Logistic function with a middle and a width."""
    return np.asarray(1 / (1 + np.exp(-np.clip((values - middle[0]) / middle[1], -50, 50))))
