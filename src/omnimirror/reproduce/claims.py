"""A number of the paper, and the verdict on it.

Nobody types a verdict in: it follows from the printed number, the computed one and a tolerance. A claim
only says which verdict is *expected*, so that a program that starts to compute something else is noticed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from .paper import Paper

Relation = Literal["=", "<=", ">="]

AGREES, AS_READ, ASSUMED, NOT_REPRODUCED = "agrees", "agrees as read", "assumed", "not reproduced"


@dataclass(frozen=True)
class Claim:
    """A statement of the paper that is a number, or that a number decides.

    Parameters
    ----------
    place
        Section, figure, table or equation of the paper.
    quantity
        What is stated.
    formula
        How it is computed here.
    printed
        The number as printed; for a printed formula, what that formula gives.
    tolerance
        By how much a computed number may differ and still agree: normally half a unit of the last
        printed digit.
    compute
        The same quantity by omnimirror, the paper's way where there is more than one.
    unit
    relation
        ``"<="`` and ``">="`` for claims such as "within one pixel".
    erratum, corrected, corrected_tolerance
        For a number known to be wrong: its number in the list of errata, and what is right instead.
        ``corrected`` was computed apart from omnimirror (in 30-digit arithmetic, by hand); it must agree
        to ``corrected_tolerance``, by default half a unit of its last digit as written.
    exact
        The same quantity without the paper's approximations, where they matter.
    reading
        How words such as "almost" are read, where the tolerance is wider than half a unit of the last digit; the
        verdict then says so.
    is_assumed
        Whether the number went into what is computed, so that it can only be found again.
    note
        Anything a reader needs to judge the row.
    """

    place: str
    quantity: str
    formula: str
    printed: float
    tolerance: float
    compute: Callable[[Paper], float]
    unit: str = ""
    relation: Relation = "="
    erratum: int | None = None
    corrected: float | None = None
    corrected_tolerance: float = 0.0
    exact: Callable[[Paper], float] | None = None
    reading: str = ""
    is_assumed: bool = False
    note: str = ""

    @property
    def expected(self) -> str:
        """The verdict that is known to be right."""
        return self._agreement if self.erratum is None else f"erratum {self.erratum}"

    @property
    def _agreement(self) -> str:
        return ASSUMED if self.is_assumed else AS_READ if self.reading else AGREES

    def verdict(self, computed: float) -> str:
        """What follows from a computed number.

        >>> claim = Claim("Sec. 3.3", "coverage", "", 0.8356, 5e-5, lambda paper: 0.0,
        ...               erratum=9, corrected=0.8536, corrected_tolerance=5e-5)
        >>> claim.verdict(0.85355), claim.verdict(0.83561), claim.verdict(0.9)
        ('erratum 9', 'agrees', 'not reproduced')
        """
        if self._holds(computed):
            return self._agreement
        if self.corrected is not None and _close(computed, self.corrected, self.corrected_tolerance):
            return f"erratum {self.erratum}"
        return NOT_REPRODUCED

    def _holds(self, computed: float) -> bool:
        if self.relation == "<=":
            return computed <= self.printed + self.tolerance
        if self.relation == ">=":
            return computed >= self.printed - self.tolerance
        return _close(computed, self.printed, self.tolerance)


def _close(a: float, b: float, tolerance: float) -> bool:
    slack = 1e-12 * max(abs(a), abs(b))  # so that half a unit rounds up
    return bool(np.isfinite(a) and abs(a - b) <= tolerance + slack)


@dataclass(frozen=True)
class CheckedClaim:
    """A claim, computed."""

    number: int
    claim: Claim
    computed: float
    exact: float | None
    verdict: str

    @property
    def as_expected(self) -> bool:
        return self.verdict == self.claim.expected

    @property
    def title(self) -> str:
        """How messages name the row."""
        return f"{self.number} ({self.claim.place}: {self.claim.quantity})"


def check_claims(claims: list[Claim], paper: Paper) -> list[CheckedClaim]:
    """Compute every claim, in order, numbered from 1."""
    rows = []
    for number, claim in enumerate(claims, start=1):
        computed = float(claim.compute(paper))
        exact = None if claim.exact is None else float(claim.exact(paper))
        rows.append(CheckedClaim(number, claim, computed, exact, claim.verdict(computed)))
    return rows
