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


class Compared(NamedTuple):
    """One comparison: deviation and tolerance."""

    program: str
    what: str
    off: float
    within: float
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


def page(found: Iterable[Compared], before: str) -> str:
    """Return the page; sections of programs that were not compared are kept from the previous page."""
    kept = dict(SECTION.findall(before))
    by_program: dict[str, list[Compared]] = {}
    for one in found:
        by_program.setdefault(one.program, []).append(one)
    for program, rows in by_program.items():
        kept[program] = section(rows)
    return HEAD + "\n".join(
        f"## {name}\n{kept[name].rstrip()}\n" for name in PROGRAMS if name in kept
    )


def section(rows: list[Compared]) -> str:
    """Return the table of one program with the largest deviation of each quantity."""
    lines = [
        f"\nVersion {rows[0].version}, {datetime.now(UTC):%d %B %Y}.\n",
        "| quantity | cases | maximum deviation | tolerance |",
        "|---|--:|--:|--:|",
    ]
    for what in dict.fromkeys(row.what for row in rows):
        cases = [row for row in rows if row.what == what]
        worst = max(cases, key=lambda row: row.off / row.within)
        unit = f" {worst.unit}" if worst.unit else ""
        lines.append(
            f"| {what} | {len(cases)} | {worst.off:.2g}{unit} | {worst.within:.3g}{unit} |"
        )
    return "\n".join(lines) + "\n"


def write(path: Path, found: Iterable[Compared]) -> None:
    """Write the page if there are any comparisons."""
    rows = list(found)
    if rows:
        path.write_text(page(rows, path.read_text() if path.exists() else ""))
