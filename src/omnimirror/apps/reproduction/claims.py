"""Statements of the paper, the computed values, and the verdicts.

The verdict follows from the printed statement, the computed value and one tolerance rule
(:func:`printed_number`, :data:`WORDINGS`). A claim also records its known correct verdict, for the
detection of regressions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from .paper import Paper

Relation = Literal["=", "<=", ">="]
Compute = Callable[[Paper], float]

AGREES, AS_INTERPRETED, ASSUMED = "agrees", "agrees as interpreted", "assumed"
COMPUTED, NOT_REPRODUCED, DIFFERS = "computed", "not reproduced", "differs"

ROUNDING = 1e-9
"""Relative tolerance of identities."""

WORDINGS: dict[str, tuple[float, str]] = {
    "constant": (0.025, "'constant': half of the range is at most 2.5 % of the mean"),
    "proportional": (0.025, "'proportional': within 2.5 % of full scale"),
    "almost": (0.15, "'almost', 'approximately': within 15 % of the ideal value"),
}
"""Interpretation of words without a number: tolerance relative to the ideal value."""


def printed_number(text: str) -> tuple[float, float]:
    """Return a printed number and its tolerance, half a unit of the last printed digit.

    Trailing zeros of a whole number are place holders, not digits ("180" means 175 to 185).

    >>> printed_number("0.785"), printed_number("41253"), printed_number("180")
    ((0.785, 0.0005), (41253.0, 0.5), (180.0, 5.0))
    """
    whole, point, decimals = text.partition(".")
    zeros = 0 if point else len(whole) - len(whole.rstrip("0"))
    return float(text), 0.5 * 10.0 ** (zeros - len(decimals))


@dataclass(frozen=True)
class Claim:
    """One statement of the paper that a computed value confirms or refutes.

    Use :func:`printed`, :func:`worded`, :func:`ordered`, :func:`identity`, :func:`zero`, :func:`formula` and
    :func:`unprinted`, which derive ``target`` and ``tolerance`` from the statement.

    Parameters
    ----------
    place
        Section, figure, table or equation of the paper.
    quantity
        Computed quantity.
    method
        Formula of the computation.
    compute
        Computation with omnimirror, with the paper's approximations where it makes any.
    statement
        Statement of the paper: a number, a word or a relation; empty if the paper prints no value.
    target
        Value according to the statement; None if the paper prints no value.
    tolerance
        Largest accepted difference from ``target``.
    relation
        ``"<="`` and ``">="`` for statements such as "decreases".
    unit
        Unit of the value.
    erratum
        Number of the erratum in docs/errata.md that the row documents.
    correct
        Correct value as text, computed independently of omnimirror; required for errata, for statements that are not
        reproduced and for values that are not printed. Its tolerance is half a unit of its last digit.
    exact
        Computation without the paper's approximations.
    interpretation
        Interpretation of a word.
    is_assumed
        Whether the stated value is an input of the computation, which cannot confirm it.
    note
        Remark for the reader.
    """

    place: str
    quantity: str
    method: str
    compute: Compute
    statement: str = ""
    target: float | None = None
    tolerance: float = 0.0
    relation: Relation = "="
    unit: str = ""
    erratum: int | None = None
    correct: str | None = None
    exact: Compute | None = None
    interpretation: str = ""
    is_assumed: bool = False
    note: str = ""

    @property
    def expected(self) -> str:
        """Known correct verdict."""
        if self.target is None:
            return COMPUTED
        if self.erratum is not None:
            return f"erratum {self.erratum}"
        return self._agreement if self.correct is None else NOT_REPRODUCED

    @property
    def _agreement(self) -> str:
        return ASSUMED if self.is_assumed else AS_INTERPRETED if self.interpretation else AGREES

    def verdict(self, computed: float) -> str:
        """Return the verdict on a computed value.

        >>> claim = printed("Sec. 3.3", "coverage", "", "0.8356", lambda paper: 0.0, erratum=9, correct="0.8536")
        >>> claim.verdict(0.85355), claim.verdict(0.83561), claim.verdict(0.9)
        ('erratum 9', 'agrees', 'differs')
        """
        if self.target is not None and self._holds(computed, self.target):
            return self._agreement
        if self.correct is not None and _is_close(computed, *printed_number(self.correct)):
            return self.expected
        return DIFFERS

    def _holds(self, computed: float, target: float) -> bool:
        if self.relation == "<=":
            return computed <= target + self.tolerance
        if self.relation == ">=":
            return computed >= target - self.tolerance
        return _is_close(computed, target, self.tolerance)


def _is_close(a: float, b: float, tolerance: float) -> bool:
    slack = 1e-12 * max(abs(a), abs(b))  # half a unit itself is accepted despite rounding
    return bool(np.isfinite(a) and abs(a - b) <= tolerance + slack)


# -- kinds of statements ---------------------------------------------------------------------------


def printed(place: str, quantity: str, method: str, text: str, compute: Compute, unit: str = "", **more: Any) -> Claim:
    """Return the claim that a quantity has the printed number, to half a unit of its last digit."""
    target, tolerance = printed_number(text)
    return Claim(place, quantity, method, compute, text, target, tolerance, unit=unit, **more)


def worded(
    place: str, quantity: str, method: str, word: str, ideal: float, compute: Compute, unit: str = "", **more: Any
) -> Claim:
    """Return the claim that a word of :data:`WORDINGS` describes: a quantity is close to an ideal value."""
    relative, interpretation = WORDINGS[word]
    return Claim(place, quantity, method, compute, f"{ideal:g} ({word})", ideal, relative * ideal,
                 unit=unit, interpretation=interpretation, **more)  # fmt: skip


def ordered(
    place: str, quantity: str, method: str, relation: Relation, bound: float, compute: Compute, unit: str = "",
    **more: Any,
) -> Claim:  # fmt: skip
    """Return the claim that a quantity is on one side of a bound, without tolerance."""
    sign = {"<=": "≤", ">=": "≥", "=": "="}[relation]
    return Claim(place, quantity, method, compute, f"{sign} {bound:g}", bound, 0.0, relation, unit, **more)


def identity(place: str, quantity: str, method: str, compute: Compute, **more: Any) -> Claim:
    """Return the claim that an equation of the paper holds: the ratio of its two sides is 1 to rounding."""
    return Claim(place, quantity, method, compute, "1 (identity)", 1.0, ROUNDING, **more)


def zero(place: str, quantity: str, method: str, compute: Compute, unit: str = "", **more: Any) -> Claim:
    """Return the claim that a difference vanishes to rounding."""
    return Claim(place, quantity, method, compute, "0", 0.0, ROUNDING, unit=unit, **more)


def formula(
    place: str, quantity: str, method: str, value: float, compute: Compute, unit: str = "", **more: Any
) -> Claim:
    """Return the claim that a formula, evaluated as printed, is right to 1e-4 of its value."""
    return Claim(place, quantity, method, compute, f"{value:.6g} (printed formula)", value, 1e-4 * abs(value),
                 unit=unit, **more)  # fmt: skip


def unprinted(
    place: str, quantity: str, method: str, correct: str, compute: Compute, unit: str = "", **more: Any
) -> Claim:
    """Return a quantity of a figure or equation without a printed value in the paper."""
    return Claim(place, quantity, method, compute, unit=unit, correct=correct, **more)


# -- results ---------------------------------------------------------------------------------------


@dataclass(frozen=True)
class CheckedClaim:
    """A claim with its computed value and the verdict."""

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
        """Row number, place and quantity, for messages."""
        return f"{self.number} ({self.claim.place}: {self.claim.quantity})"


def check_claims(claims: list[Claim], paper: Paper) -> list[CheckedClaim]:
    """Compute all claims in order; rows are numbered from 1."""
    rows = []
    for number, claim in enumerate(claims, start=1):
        computed = float(claim.compute(paper))
        exact = None if claim.exact is None else float(claim.exact(paper))
        rows.append(CheckedClaim(number, claim, computed, exact, claim.verdict(computed)))
    return rows
