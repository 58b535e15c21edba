"""Calibration report as one self-contained page, with figures of errors, residuals, coverage,
parameters and images."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ...analysis.figures import render, save_figure
from ...base.arguments import validate_arguments
from ...base.escaping import html_text
from ...base.files import write_text
from ...calibration.estimation.calibration_result import Calibration
from ..plot import CALIBRATION_KINDS, calibration_figure
from . import figure_html, page_html

CAPTIONS = {
    "coverage": "Boards and their corners, with the rings in which corners are counted. Darker areas "
    "have a higher uncertainty of direction.",
    "residuals": "Residual of each corner, from the detected to the projected position. Correlated "
    "neighbouring arrows indicate a systematic error of the model.",
    "residuals-by-radius": "Residuals along and across the image radius; means with their standard errors.",
    "residuals-by-image": "RMS of each image in the fit, and in a fit without this image.",
    "residual-histograms": "Residuals in both image directions, and a normal distribution with the same standard "
    "deviation.",
}


@validate_arguments
def write_calibration_report(calibration: Calibration, path: str | Path, command: str = "") -> Path:
    """Write a calibration as one self-contained page.

    Parameters
    ----------
    calibration
        Result of :func:`omnimirror.calibrate_camera`.
    path
        Page to be written, ``.html``.
    command
        Command line that created the calibration, for display.

    Returns
    -------
    Path
        Path of the page.

    Raises
    ------
    OmnimirrorError
        If the file cannot be written.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from omnimirror.cameras.models import Unified
    >>> camera = Unified(
    ...     xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> found = om.calibrate_camera(om.simulate_detections(camera, board, 5), board, model="unified")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_calibration_report(found, f"{folder}/calibration.html").name
    'calibration.html'
    """
    path = Path(path)
    write_text(path, calibration_html(calibration, command))
    return path


@validate_arguments
def write_calibration_figures(
    calibration: Calibration, folder: str | Path, kind: str = "svg"
) -> list[Path]:
    """Write the figures of a calibration to a folder.

    Parameters
    ----------
    calibration
        Result of :func:`omnimirror.calibrate_camera`.
    folder
        Output folder.
    kind
        ``"svg"``, ``"png"`` or ``"pdf"``.

    Returns
    -------
    list of Path
        Coverage, residuals over the image, residuals by radius, residuals by image, and their
        distribution.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from omnimirror.cameras.models import Unified
    >>> camera = Unified(
    ...     xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> found = om.calibrate_camera(om.simulate_detections(camera, board, 4), board, model="unified")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     [path.name for path in om.write_calibration_figures(found, folder)][:2]
    ['coverage.svg', 'residuals.svg']
    """
    return [
        save_figure(f, Path(folder) / f"{name}.{kind}")
        for name, f in calibration_figures(calibration).items()
    ]


def calibration_figures(calibration: Calibration) -> dict[str, Figure]:
    """Return the figures of a calibration by name."""
    return {kind: calibration_figure(calibration, kind) for kind in CALIBRATION_KINDS}


def calibration_html(calibration: Calibration, command: str = "") -> str:
    """Return the page."""
    drawn = {
        name: figure_html(render(figure, "svg"), "svg+xml", CAPTIONS[name], css="plot")
        for name, figure in calibration_figures(calibration).items()
    }
    heading = f"Calibration: {calibration.model.KIND}"
    return page_html(
        heading,
        "calibration",
        heading=html_text(heading),
        lead=html_text(_lead(calibration)),
        numbers=_numbers(calibration),
        notes="".join(f"<p>{html_text(note)}</p>" for note in calibration.notes),
        coverage=drawn.pop("coverage"),
        advice="".join(f"<p>{html_text(message)}</p>" for message in calibration.advice),
        residuals="".join(drawn.values()),
        candidates=_candidates(calibration),
        parameters=_parameters(calibration),
        free="".join(f"<p>Not determined: {html_text(str(c))}</p>" for c in calibration.free),
        images=_images(calibration),
        outliers=_outliers(calibration),
        command=html_text(command or "omnimirror calibrate"),
    )


def _lead(calibration: Calibration) -> str:
    board = f" of a board with {calibration.board}" if calibration.board is not None else ""
    used = sum(p.used for p in calibration.images)
    return f"From {calibration.measurement_kinds} in {used} of {len(calibration.images)} images{board}."


def _numbers(calibration: Calibration) -> str:
    fit = calibration.adjustment
    entries = {
        "RMS": f"{calibration.rms_px:.3f} px",
        "RMS of held-out images": f"{calibration.held_out_rms_px:.3f} px"
        if calibration.held_out
        else "-",
        "Corner noise per coordinate": f"{fit.noise_px:.3f} px",
        calibration.measurement_kinds.capitalize(): f"{calibration.corners}, {len(calibration.outliers)} rejected",
        "Images": f"{sum(p.used for p in calibration.images)} of {len(calibration.images)}",
        "Computation time": f"{calibration.seconds:.1f} s",
    }
    return "".join(
        f"<div><dt>{html_text(k)}</dt><dd>{html_text(v)}</dd></div>" for k, v in entries.items()
    )


def _candidates(calibration: Calibration) -> str:
    rows = [
        (c.kind, str(c.parameters), f"{c.rms_px:.3f}", _number(c.held_out_rms_px), c.why)
        for c in sorted(calibration.candidates, key=lambda c: c.rms_px)
    ]
    return _table(("model", "parameters", "RMS px", "held out px", ""), rows)


def _parameters(calibration: Calibration) -> str:
    rows = [
        (p.name, f"{p.value:.6g}", f"{p.sigma:.2g}" if p.sigma > 0 else "fixed", p.unit)
        for p in calibration.parameters
    ]
    return _table(("", "value", "sigma", "unit"), rows)


def _images(calibration: Calibration) -> str:
    rows = [
        (
            p.name,
            str(p.found),
            "-" if p.rms_px is None else f"{p.rms_px:.3f}",
            "-" if p.camera_at_mm is None else ", ".join(f"{x:.1f}" for x in p.camera_at_mm),
            "used" if p.used else p.reason or "",
        )
        for p in calibration.images
    ]
    return _table(("image", "corners", "RMS px", "camera position, mm", ""), rows)


def _outliers(calibration: Calibration) -> str:
    if not calibration.outliers:
        return "<p>None.</p>"
    rows = [(o.image, str(o.corner), f"{o.residual_px:.2f}") for o in calibration.outliers]
    return f'<div class="scroll">{_table(("image", "corner", "residual px"), rows)}</div>'


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else "-"


def _table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Format a table; the first column contains text, and so does the last if it has no heading."""
    text_columns = {0, len(headings) - 1} if not headings[-1] else {0}
    styles = [
        ' style="text-align: left; white-space: normal"' if i in text_columns else ""
        for i in range(len(headings))
    ]
    head = "".join(
        f"<th{style}>{html_text(h)}</th>" for h, style in zip(headings, styles, strict=True)
    )
    lines = []
    for row in rows:
        first, *others = (f"{style}>{html_text(c)}" for c, style in zip(row, styles, strict=True))
        lines.append(f"<tr><th{first}</th>{''.join(f'<td{cell}</td>' for cell in others)}</tr>")
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(lines)}</tbody></table>"
