"""Write docs/cross-validation.md from the comparisons with other programs (`make test-full`)."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

PROGRAMS = {
    "Optiland": "optiland",
    "Mitsuba 3": "mitsuba",
    "OpenCV": "opencv-contrib-python-headless",
    "FFmpeg": "av",
    "COLMAP": "pycolmap",
    "Blender": "bpy",
    "GStreamer": "gstreamer",
    "OBS Studio": "libobs",
    "OpenImageIO": "openimageio",
}
"""Sections of the page in order, and the distribution that contains each program."""
HEAD = """# Cross-validation

Comparison of omnimirror with independent programs. The tests generate this page (`make test-full`, after `make
programs` for Blender, GStreamer and OBS). *Maximum deviation* is the largest of all cases; the tests fail if it exceeds
*tolerance*.

"""
SECTION = re.compile(r"^## (.+?)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)


class Comparison(NamedTuple):
    """Deviation from another program, and its tolerance."""

    program: str
    quantity: str
    deviation: float
    tolerance: float
    unit: str
    version: str


Compare = Callable[..., None]


def version_of(program: str) -> str:
    """Return the version of an installed program."""
    if program == "FFmpeg":
        import av

        return str(av.ffmpeg_version_info)
    for name in (PROGRAMS[program], "opencv-python-headless"):
        try:
            return metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return "?"


def page(comparisons: Iterable[Comparison], before: str) -> str:
    """Return the page; sections of programs without comparisons are copied from the previous page."""
    tables = dict(SECTION.findall(before))
    by_program: dict[str, list[Comparison]] = {}
    for comparison in comparisons:
        by_program.setdefault(comparison.program, []).append(comparison)
    for program, rows in by_program.items():
        tables[program] = section(rows)
    return HEAD + "\n".join(
        f"## {name}\n{tables[name].rstrip()}\n" for name in PROGRAMS if name in tables
    )


def section(rows: list[Comparison]) -> str:
    """Return the table of one program with the largest deviation of each quantity."""
    lines = [
        f"\nVersion {rows[0].version}, {datetime.now(UTC):%d %B %Y}.\n",
        "| quantity | cases | maximum deviation | tolerance |",
        "|---|--:|--:|--:|",
    ]
    for quantity in dict.fromkeys(row.quantity for row in rows):
        cases = [row for row in rows if row.quantity == quantity]
        worst = max(cases, key=lambda row: row.deviation / row.tolerance)
        unit = f" {worst.unit}" if worst.unit else ""
        lines.append(
            f"| {quantity} | {len(cases)} | {worst.deviation:.2g}{unit} | {worst.tolerance:.3g}{unit} |"
        )
    return "\n".join(lines) + "\n"


def write(path: Path, comparisons: Iterable[Comparison]) -> None:
    """Write the page if there are any comparisons."""
    rows = list(comparisons)
    if rows:
        path.write_text(page(rows, path.read_text() if path.exists() else ""))
