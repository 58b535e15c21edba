"""Reproduction of the paper: its statements with verdicts, and its figures."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from ...analysis.figures import FIGURES, PAPER, STYLES, save_all, save_figure
from ...analysis.figures.style import FORMATS, styled
from ...base.arguments import choice, validate_arguments
from ...base.errors import InvalidParameter
from ...base.logs import OnProgress
from ...base.results import Columns, Result
from . import _claims, _paper_claims
from ._claims import CheckedClaim, Claim, check_claims
from ._paper_sensors import Paper, paper_sensors

LOGGER = logging.getLogger(__name__)

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
"""Names of the figures: the curves of :data:`omnimirror.analysis.figures.FIGURES`, diagrams and images."""


@dataclass(frozen=True)
class Reproduction(Result):
    """Result of :func:`reproduce_paper`: rows of the table and written files."""

    rows: list[CheckedClaim]
    files: list[Path]

    def _table(self) -> Columns:
        return _claims.columns(self.rows)

    @property
    def unexpected(self) -> list[CheckedClaim]:
        """Rows whose verdict differs from the known one."""
        return [r for r in self.rows if not r.as_expected]


def all_claims() -> list[Claim]:
    """Return all checked statements of the paper, by section."""
    return [*_paper_claims.mirror_claims(), *_paper_claims.image_claims()]


def check(claims: Sequence[Claim] | None = None) -> list[CheckedClaim]:
    """Compute claims and return their verdicts.

    >>> rows = check(all_claims()[:1])
    >>> rows[0].verdict, round(rows[0].computed, 2)
    ('agrees', 134.98)
    """
    return check_claims(list(all_claims() if claims is None else claims), Paper())


def draw_figures(
    folder: str | Path,
    which: Iterable[str] | None = None,
    formats: Sequence[str] = ("svg", "png"),
    on_progress: OnProgress | None = None,
    style: str = "paper",
) -> list[Path]:
    """Draw the figures of the paper, computed with its approximations.

    Parameters
    ----------
    style
        Style as in :func:`omnimirror.analysis.figures.draw`.

    Raises
    ------
    InvalidParameter
        If the figure is unknown.
    OmnimirrorError
        If a file cannot be written.
    """
    names = _figure_names(which)
    curves = [n for n in names if n in FIGURES]
    report = on_progress or (lambda done, total: None)
    files = save_all(
        paper_sensors(),
        folder,
        formats,
        curves,
        PAPER,
        lambda done, total: report(done, len(names)),
        style,
    )
    for number, name in enumerate((n for n in names if n not in FIGURES), len(curves) + 1):
        from ._paper_figures import DIAGRAMS

        LOGGER.info("%s", name)
        with styled(style):
            figure = DIAGRAMS[name]()
        files += [save_figure(figure, Path(folder) / f"{name}.{kind}") for kind in formats]
        report(number, len(names))
    return files


def _figure_names(which: Iterable[str] | None) -> list[str]:
    names = list(ALL_FIGURES if which is None else dict.fromkeys(which))
    if unknown := [n for n in names if n not in ALL_FIGURES]:
        raise InvalidParameter(f"figures must be from {', '.join(ALL_FIGURES)}; got {unknown[0]!r}")
    return names


@validate_arguments
def reproduce_paper(
    folder: str | Path = "reproduced",
    *,
    figures: bool = True,
    only: Iterable[str] | None = None,
    formats: Sequence[str] = ("svg", "png"),
    style: str = "paper",
    on_progress: OnProgress | None = None,
) -> Reproduction:
    """Redraw the figures of Ohte and Tsuzuki (2012) and check the statements of the paper.

    Parameters
    ----------
    folder
        Folder for ``numbers.csv``, ``numbers.md`` and the figures.
    figures
        Whether to draw the figures.
    only
        Names of the figures to draw; all by default.
    formats
        Formats of the figures: ``"svg"``, ``"png"`` and ``"pdf"``.
    style
        ``"paper"`` for a journal, or ``"slides"`` with larger text and lines.
    on_progress
        Callback of the number of finished steps and their total number. The logger ``omnimirror``
        reports the steps.

    Returns
    -------
    Reproduction
        One row per statement with its verdict, and the written files.

    Raises
    ------
    InvalidParameter
        If a figure, format or style is unknown; raised before any file is written.
    OmnimirrorError
        If a file cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     result = om.reproduce_paper(folder, figures=False)
    >>> [path.name for path in result.files], result.unexpected
    (['numbers.csv', 'numbers.md'], [])
    """
    which = _figure_names(only)
    choice("style", style, STYLES)
    for name in formats:
        choice("formats", name, FORMATS)
    LOGGER.info("numbers")
    report, total = on_progress or (lambda done, total: None), 1 + figures * len(which)
    rows, folder = check(), Path(folder)
    files = [folder / "numbers.csv", folder / "numbers.md"]
    _claims.write_csv(rows, files[0])
    _claims.write_markdown(rows, files[1])
    report(1, total)
    if figures:
        files += draw_figures(
            folder, which, formats, lambda done, count: report(1 + done, total), style
        )
    return Reproduction(rows, files)
