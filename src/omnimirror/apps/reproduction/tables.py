"""Table of the checked statements as CSV, as Markdown and for the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from ...base.files import write_text
from .claims import AGREES, AS_INTERPRETED, ASSUMED, COMPUTED, DIFFERS, NOT_REPRODUCED, CheckedClaim

HEADINGS = ("no", "place", "quantity", "printed", "computed", "exact", "unit", "tolerance", "correct", "verdict",
            "expected", "method", "interpretation", "note")  # fmt: skip
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


def write_csv(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """Write all columns as CSV, numbers with 12 significant digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADINGS)
    for r in rows:
        c = r.claim
        writer.writerow(
            [r.number, c.place, c.quantity, c.statement, number(r.computed, 12), number(r.exact, 12), c.unit,
             number(c.tolerance, 12), c.correct or "", r.verdict, c.expected, c.method, c.interpretation, c.note]
        )  # fmt: skip
    write_text(path, text.getvalue())


def write_markdown(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """Write the table with methods, interpretations and notes as Markdown."""
    head = ("", "Place", "Quantity", "Printed", "Computed", "Exact", "Unit", "Verdict", "Method", "Note")
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
        cells = (str(r.number), c.place, c.quantity, statement, number(r.computed), number(r.exact), c.unit, verdict,
                 c.method, note)  # fmt: skip
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
        cells = (str(r.number), c.place, c.quantity, c.statement, number(r.computed), number(r.exact), c.unit)
        table.add_row(*map(Text, cells), Text(r.verdict, style=style))
    return table
