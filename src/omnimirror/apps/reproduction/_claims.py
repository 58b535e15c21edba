"""Statements of the paper: computed values, verdicts, and their table as CSV, Markdown and for the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from rich.table import Table
from rich.text import Text

from ...base.files import write_text
from ...base.results import table_of
from ._paper_sensors import Paper

# -- Claims and verdicts ---------------------------------------------------------------------------
#
# The verdict follows from the printed statement, the computed value and one tolerance rule
# (:func:`printed_number`, :data:`WORDINGS`). A claim also records its known correct verdict, for the
# detection of regressions.

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


# -- Kinds of claims -------------------------------------------------------------------------------


def printed(
    place: str, quantity: str, method: str, text: str, compute: Compute, unit: str = "", **more: Any
) -> Claim:
    """Return the claim that a quantity has the printed number, to half a unit of its last digit."""
    target, tolerance = printed_number(text)
    return Claim(place, quantity, method, compute, text, target, tolerance, unit=unit, **more)


def worded(
    place: str,
    quantity: str,
    method: str,
    word: str,
    ideal: float,
    compute: Compute,
    unit: str = "",
    **more: Any,
) -> Claim:
    """Return the claim that a word of :data:`WORDINGS` describes: a quantity is close to an ideal value."""
    relative, interpretation = WORDINGS[word]
    return Claim(
        place,
        quantity,
        method,
        compute,
        f"{ideal:g} ({word})",
        ideal,
        relative * ideal,
        unit=unit,
        interpretation=interpretation,
        **more,
    )


def ordered(
    place: str,
    quantity: str,
    method: str,
    relation: Relation,
    bound: float,
    compute: Compute,
    unit: str = "",
    **more: Any,
) -> Claim:
    """Return the claim that a quantity is on one side of a bound, without tolerance."""
    sign = {"<=": "≤", ">=": "≥", "=": "="}[relation]
    return Claim(
        place, quantity, method, compute, f"{sign} {bound:g}", bound, 0.0, relation, unit, **more
    )


def identity(place: str, quantity: str, method: str, compute: Compute, **more: Any) -> Claim:
    """Return the claim that an equation of the paper holds: the ratio of its two sides is 1 to rounding."""
    return Claim(place, quantity, method, compute, "1 (identity)", 1.0, ROUNDING, **more)


def zero(
    place: str, quantity: str, method: str, compute: Compute, unit: str = "", **more: Any
) -> Claim:
    """Return the claim that a difference vanishes to rounding."""
    return Claim(place, quantity, method, compute, "0", 0.0, ROUNDING, unit=unit, **more)


def formula(
    place: str,
    quantity: str,
    method: str,
    value: float,
    compute: Compute,
    unit: str = "",
    **more: Any,
) -> Claim:
    """Return the claim that a formula, evaluated as printed, is right to 1e-4 of its value."""
    return Claim(
        place,
        quantity,
        method,
        compute,
        f"{value:.6g} (printed formula)",
        value,
        1e-4 * abs(value),
        unit=unit,
        **more,
    )


def unprinted(
    place: str,
    quantity: str,
    method: str,
    correct: str,
    compute: Compute,
    unit: str = "",
    **more: Any,
) -> Claim:
    """Return a quantity of a figure or equation without a printed value in the paper."""
    return Claim(place, quantity, method, compute, unit=unit, correct=correct, **more)


# -- Results ---------------------------------------------------------------------------------------


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


# -- Output as CSV, Markdown and terminal table ----------------------------------------------------

HEADINGS = (
    "no",
    "place",
    "quantity",
    "printed",
    "computed",
    "exact",
    "unit",
    "tolerance",
    "correct",
    "verdict",
    "expected",
    "method",
    "interpretation",
    "note",
)
NUMBERS = ("computed", "exact", "tolerance")
STYLES = {AGREES: "green", AS_INTERPRETED: "green", COMPUTED: "dim", ASSUMED: "dim"}


def number(value: float | None, digits: int = 6) -> str:
    """Format a number; rounding noise around zero is printed as 0.

    >>> number(0.853553390593), number(-3e-17), number(6469.230769), number(None)
    ('0.853553', '0', '6469.23', '')
    """
    if value is None:
        return ""
    return "0" if abs(value) < 1e-12 else f"{value:.{digits}g}"


def summary(rows: Sequence[CheckedClaim]) -> str:
    """Return one sentence with the number of rows for each verdict.

    >>> summary([])
    '0 rows: 0 agree, 0 agree as interpreted, 0 are computed without a printed value, 0 are assumed, 0 show errata, ...'
    """
    agree, interpreted, computed, assumed, missed, wrong = (
        sum(r.verdict == verdict for r in rows)
        for verdict in (AGREES, AS_INTERPRETED, COMPUTED, ASSUMED, NOT_REPRODUCED, DIFFERS)
    )
    errata = len(rows) - agree - interpreted - computed - assumed - missed - wrong
    return (
        f"{len(rows)} rows: {agree} agree, {interpreted} agree as interpreted, {computed} are computed without a "
        f"printed value, {assumed} are assumed, {errata} show errata, {missed} are not reproduced, {wrong} differ "
        "from the known result"
    )


def columns(rows: Sequence[CheckedClaim]) -> dict[str, list[Any]]:
    """Return the columns of the table, :data:`HEADINGS`."""
    records = (
        (
            r.number,
            r.claim.place,
            r.claim.quantity,
            r.claim.statement,
            r.computed,
            r.exact,
            r.claim.unit,
            r.claim.tolerance,
            r.claim.correct or "",
            r.verdict,
            r.claim.expected,
            r.claim.method,
            r.claim.interpretation,
            r.claim.note,
        )
        for r in rows
    )
    return table_of(dict(zip(HEADINGS, record, strict=True)) for record in records)


def write_csv(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """Write all columns as CSV, numbers with 12 significant digits."""
    table = columns(rows)
    for name in NUMBERS:
        table[name] = [number(value, 12) for value in table[name]]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADINGS)
    writer.writerows(zip(*table.values(), strict=True))
    write_text(path, text.getvalue())


def write_markdown(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """Write the table with methods, interpretations and notes as Markdown."""
    head = (
        "",
        "Place",
        "Quantity",
        "Printed",
        "Computed",
        "Exact",
        "Unit",
        "Verdict",
        "Method",
        "Note",
    )
    lines = [
        "# Statements of the paper",
        "",
        "Ohte and Tsuzuki, Optical Engineering 51(1), 013005 (2012). Computed with the paper's approximations (Eq. 29 "
        "for the blur, an image circle of 1000 pixels) and, where the result differs, also exactly. Tolerance: half a "
        "unit of the last printed digit; for words, the stated interpretation.",
        "",
        summary(rows) + ".",
        "",
        "| " + " | ".join(head) + " |",
        "|--:|---|---|--:|--:|--:|---|---|---|---|",
    ]
    for r in rows:
        c = r.claim
        verdict = r.verdict if r.as_expected else f"**{r.verdict}** (expected: {c.expected})"
        statement = c.statement + (f" ± {number(c.tolerance)}" if c.tolerance else "")
        note = "; ".join(filter(None, (c.interpretation, c.note)))
        cells = (
            str(r.number),
            c.place,
            c.quantity,
            statement,
            number(r.computed),
            number(r.exact),
            c.unit,
            verdict,
            c.method,
            note,
        )
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    write_text(path, "\n".join(lines) + "\n")


def terminal_table(rows: Sequence[CheckedClaim]) -> Table:
    """Return the table for the terminal, without methods and notes."""
    table = Table(box=None, header_style="bold", padding=(0, 1), pad_edge=False)
    table.add_column("", justify="right", style="dim")
    table.add_column("Place")
    table.add_column("Quantity")
    for name in ("Printed", "Computed", "Exact"):
        table.add_column(name, justify="right")
    table.add_column("Unit")
    table.add_column("Verdict")
    for r in rows:
        c = r.claim
        style = STYLES.get(r.verdict, "yellow") if r.as_expected else "bold red"
        cells = (
            str(r.number),
            c.place,
            c.quantity,
            c.statement,
            number(r.computed),
            number(r.exact),
            c.unit,
        )
        table.add_row(*map(Text, cells), Text(r.verdict, style=style))
    return table
