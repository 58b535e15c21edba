"""The table of numbers as CSV, Markdown and for the terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from pathlib import Path

from rich.table import Table
from rich.text import Text

from ..files import write_text
from .claims import AGREES, AS_READ, ASSUMED, NOT_REPRODUCED, CheckedClaim

HEADINGS = ("no", "place", "quantity", "printed", "computed", "exact", "unit", "tolerance", "corrected", "verdict",
            "expected", "formula", "reading", "note")  # fmt: skip
STYLES = {AGREES: "green", AS_READ: "green", ASSUMED: "dim"}
RELATIONS = {"=": "", "<=": "≤ ", ">=": "≥ "}


def number(value: float | None, digits: int = 6) -> str:
    """A number for people; rounding noise about zero is zero.

    >>> number(0.853553390593), number(-3e-17), number(6469.230769), number(None)
    ('0.853553', '0', '6469.23', '')
    """
    if value is None:
        return ""
    return "0" if abs(value) < 1e-12 else f"{value:.{digits}g}"


def printed(row: CheckedClaim) -> str:
    """The printed number with its relation: "≤ 1"."""
    return RELATIONS[row.claim.relation] + number(row.claim.printed)


def summary(rows: Sequence[CheckedClaim]) -> str:
    """One sentence: how many agree, how many are known errata, how many are not reproduced.

    >>> summary([])
    "0 numbers of the paper: 0 agree, 0 agree as words such as 'almost' are read, 0 are assumed, 0 are errata ..."
    """
    agree, read, assumed, failed = (
        sum(r.verdict == verdict for r in rows) for verdict in (AGREES, AS_READ, ASSUMED, NOT_REPRODUCED)
    )
    known = len(rows) - agree - read - assumed - failed
    return (
        f"{len(rows)} numbers of the paper: {agree} agree, {read} agree as words such as 'almost' are read, "
        f"{assumed} {'is' if assumed == 1 else 'are'} assumed, {known} are errata of the paper, {failed} are not "
        "reproduced"
    )


def write_csv(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """Every column, numbers with 12 significant digits."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(HEADINGS)
    for r in rows:
        c = r.claim
        relation = "" if c.relation == "=" else c.relation + " "
        writer.writerow(
            [r.number, c.place, c.quantity, relation + number(c.printed, 12), number(r.computed, 12),
             number(r.exact, 12), c.unit, number(c.tolerance, 12), number(c.corrected, 12), r.verdict, c.expected,
             c.formula, c.reading, c.note]
        )  # fmt: skip
    write_text(path, text.getvalue())


def write_markdown(rows: Sequence[CheckedClaim], path: str | Path) -> None:
    """The table for people, with formulas and notes."""
    head = ("", "Place", "Quantity", "Printed", "Computed", "Exactly", "Unit", "Verdict", "Computed from", "Note")
    lines = [
        "# The numbers of the paper",
        "",
        "Ohte and Tsuzuki, Optical Engineering 51(1), 013005 (2012). Computed the paper's way (Eq. 29 for the blur, an "
        "image circle of 1000 pixels) and, where that differs, also exactly.",
        "",
        summary(rows) + ".",
        "",
        "| " + " | ".join(head) + " |",
        "|--:|---|---|--:|--:|--:|---|---|---|---|",
    ]
    for r in rows:
        c = r.claim
        verdict = r.verdict if r.as_expected else f"**{r.verdict}** (expected: {c.expected})"
        said = printed(r) + (f" ± {number(c.tolerance)}" if c.tolerance else "")
        cells = (str(r.number), c.place, c.quantity, said, number(r.computed),
                 number(r.exact), c.unit, verdict, c.formula, "; ".join(filter(None, (c.reading, c.note))))  # fmt: skip
        lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    write_text(path, "\n".join(lines) + "\n")


def terminal_table(rows: Sequence[CheckedClaim]) -> Table:
    """The table for the terminal; formulas and notes are left to the files."""
    table = Table(box=None, header_style="bold", padding=(0, 1), pad_edge=False)
    table.add_column("", justify="right", style="dim")
    table.add_column("Place")
    table.add_column("Quantity")
    for name in ("Printed", "Computed", "Exactly"):
        table.add_column(name, justify="right")
    table.add_column("Unit")
    table.add_column("Verdict")
    for r in rows:
        c = r.claim
        style = STYLES.get(r.verdict, "yellow") if r.as_expected else "bold red"
        cells = (str(r.number), c.place, c.quantity, printed(r), number(r.computed), number(r.exact), c.unit)
        table.add_row(*map(Text, cells), Text(r.verdict, style=style))
    return table
