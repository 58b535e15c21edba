"""The paper again: every number it states, with a verdict, and every figure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ..arguments import checked
from ..errors import InvalidParameter
from ..figures import FIGURES, PAPER, save_all, save_figure
from . import blur, shapes, tables
from .claims import CheckedClaim, Claim, check_claims
from .paper import Paper, paper_sensors

__all__ = [
    "ALL_FIGURES",
    "CheckedClaim",
    "Claim",
    "Reproduction",
    "all_claims",
    "check",
    "draw_figures",
    "paper_sensors",
    "reproduce_paper",
]

ALL_FIGURES = tuple(f"fig{number}" for number in range(1, 19))
"""Names of the figures: the curves of :data:`omnimirror.figures.FIGURES`, and diagrams and pictures."""


@dataclass(frozen=True)
class Reproduction:
    """What came out: the rows of the table, and the files written."""

    rows: list[CheckedClaim]
    files: list[Path]

    @property
    def unexpected(self) -> list[CheckedClaim]:
        """Rows whose verdict is not the one known to be right."""
        return [r for r in self.rows if not r.as_expected]


def all_claims() -> list[Claim]:
    """Every number of the paper, section by section."""
    return [*shapes.claims(), *blur.claims()]


def check(claims: Sequence[Claim] | None = None) -> list[CheckedClaim]:
    """Compute every claim and judge it.

    >>> rows = check(all_claims()[:1])
    >>> rows[0].verdict, round(rows[0].computed, 2)
    ('agrees', 134.98)
    """
    return check_claims(list(all_claims() if claims is None else claims), Paper())


def draw_figures(
    out_dir: str | Path,
    which: Iterable[str] | None = None,
    formats: Sequence[str] = ("svg", "png"),
    progress: Callable[[str], None] | None = None,
) -> list[Path]:
    """Draw the paper's figures, computed the paper's way.

    Raises
    ------
    InvalidParameter
        An unknown figure.
    OmnimirrorError
        A file cannot be written.
    """
    names = _figure_names(which)
    curves = [n for n in names if n in FIGURES]
    files = save_all(paper_sensors(), out_dir, formats, curves, PAPER, progress)
    for name in (n for n in names if n not in FIGURES):
        from .pictures import PICTURES

        if progress is not None:
            progress(name)
        figure = PICTURES[name]()
        files += [save_figure(figure, Path(out_dir) / f"{name}.{kind}") for kind in formats]
    return files


def _figure_names(which: Iterable[str] | None) -> list[str]:
    names = list(ALL_FIGURES if which is None else dict.fromkeys(which))
    if unknown := [n for n in names if n not in ALL_FIGURES]:
        raise InvalidParameter(f"figure {unknown[0]!r} is not known; valid are {', '.join(ALL_FIGURES)}")
    return names


@checked
def reproduce_paper(
    out: str | Path = "reproduced",
    *,
    figures: bool = True,
    only: Iterable[str] | None = None,
    progress: Callable[[str], None] | None = None,
) -> Reproduction:
    """Redraw the figures of Ohte and Tsuzuki (2012) and check every number they state.

    What ``omnimirror reproduce`` does.

    Parameters
    ----------
    out
        A folder, for ``numbers.csv``, ``numbers.md`` and the figures.
    figures
        Whether to draw at all.
    only
        Names of the figures to draw; all by default.
    progress
        Called with what is worked on, before it is.

    Returns
    -------
    Reproduction
        A row for each number, with its verdict, and the files written.

    Raises
    ------
    InvalidParameter
        An unknown figure; before anything is written.
    OmnimirrorError
        A file cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = om.reproduce_paper(folder, figures=False)
    >>> [path.name for path in result.files], result.unexpected
    (['numbers.csv', 'numbers.md'], [])
    """
    which = _figure_names(only)
    if progress is not None:
        progress("numbers")
    rows, folder = check(), Path(out)
    files = [folder / "numbers.csv", folder / "numbers.md"]
    tables.write_csv(rows, files[0])
    tables.write_markdown(rows, files[1])
    if figures:
        files += draw_figures(folder, which, progress=progress)
    return Reproduction(rows, files)
