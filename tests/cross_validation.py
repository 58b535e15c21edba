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
    "Newton": "newton",
    "PyTorch": "torch",
    "GStreamer": "gstreamer",
    "VLC": "vlc",
    "OBS Studio": "libobs",
    "OpenImageIO": "openimageio",
}
"""Sections of the page in order, and the distribution that contains each program."""
HEAD = """# Cross-validation

Comparison of omnimirror with independent programs, each in its oldest and newest tested release. The tests generate
this page: `make test-full`, after `make programs`, for the installed releases, and `make test-releases` for the oldest
and the newest release of each program on the Python package index. Deviations are the largest of all cases; the tests
fail if they exceed the tolerance.

"""
SECTION = re.compile(r"^## (.+?)\n(.*?)(?=^## |\Z)", re.MULTILINE | re.DOTALL)
TESTED = re.compile(r"(\S+) \((\d+ \w+ \d{4})\)")
NOT_COMPARED = "-"


class Comparison(NamedTuple):
    """Deviation from another program, and its tolerance."""

    program: str
    quantity: str
    deviation: float
    tolerance: float
    unit: str
    version: str


class Row(NamedTuple):
    """Quantity of a table: number of cases, largest deviation and tolerance with their unit."""

    cases: str
    deviation: str
    tolerance: str


class Release(NamedTuple):
    """Comparisons with one release of a program."""

    date: str
    rows: dict[str, Row]


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


def order(version: str) -> list[int]:
    """Return the numbers of a version, by which releases are sorted."""
    return [int(number) for number in re.findall(r"\d+", version)]


def comparisons_by_release(comparisons: Iterable[Comparison]) -> dict[str, dict[str, Release]]:
    """Return the comparisons of this run by program and version."""
    cases: dict[tuple[str, str, str], list[Comparison]] = {}
    for each in comparisons:
        cases.setdefault((each.program, each.version, each.quantity), []).append(each)
    programs: dict[str, dict[str, Release]] = {}
    now = datetime.now(UTC)
    for (program, version, quantity), rows in cases.items():
        worst = max(rows, key=lambda row: (row.deviation / (row.tolerance or 1), row.deviation))
        unit = f" {worst.unit}" if worst.unit else ""
        new = Release(f"{now.day} {now:%B %Y}", {})
        release = programs.setdefault(program, {}).setdefault(version, new)
        release.rows[quantity] = Row(
            str(len(rows)), f"{worst.deviation:.2g}{unit}", f"{worst.tolerance:.3g}{unit}"
        )
    return programs


def parse_page(text: str) -> dict[str, dict[str, Release]]:
    """Return the comparisons of a page by program and version."""
    programs = {}
    for program, section in SECTION.findall(text):
        releases = {version: Release(date, {}) for version, date in TESTED.findall(section)}
        lines = [line for line in section.splitlines() if line.startswith("| ")]
        for quantity, *cells, tolerance in (line.strip("| ").split(" | ") for line in lines[1:]):
            for release, cell in zip(releases.values(), cells, strict=True):
                if cell != NOT_COMPARED:
                    deviation, cases = cell.rstrip(")").rsplit(" (", 1)
                    release.rows[quantity] = Row(cases, deviation, tolerance)
        programs[program] = releases
    return programs


def page(comparisons: Iterable[Comparison], before: str) -> str:
    """Return the page of this run and of the previous page, with the oldest and the newest release of each program.

    Quantities that are not compared in this run remain; delete a section to remove renamed ones.
    """
    programs = parse_page(before)
    for program, releases in comparisons_by_release(comparisons).items():
        known = programs.get(program, {})
        for version, (date, rows) in releases.items():
            earlier = known[version].rows if version in known else {}
            known[version] = Release(date, earlier | rows)
        versions = sorted(known, key=order)
        programs[program] = {version: known[version] for version in (versions[0], versions[-1])}
    names = [name for name in PROGRAMS if name in programs]
    return HEAD + "\n".join(
        [summary({name: programs[name] for name in names})]
        + [section(name, programs[name]) for name in names]
    )


def summary(programs: dict[str, dict[str, Release]]) -> str:
    """Return the table of all programs with the largest ratio of a deviation to its tolerance."""
    lines = [
        "| program | oldest release | newest release | quantities | largest deviation / tolerance |",
        "|---|---|---|--:|--:|",
    ]
    for name, releases in programs.items():
        rows = [row for release in releases.values() for row in release.rows.values()]
        quantities = {quantity for release in releases.values() for quantity in release.rows}
        ratio = max(value(row.deviation) / (value(row.tolerance) or 1) for row in rows)
        link = f"[{name}](#{name.lower().replace(' ', '-')})"
        oldest, newest = min(releases, key=order), max(releases, key=order)
        lines.append(f"| {link} | {oldest} | {newest} | {len(quantities)} | {ratio:.2g} |")
    return "\n".join(lines) + "\n"


def value(cell: str) -> float:
    """Return the number of a cell."""
    return float(cell.split()[0])


def section(program: str, releases: dict[str, Release]) -> str:
    """Return the table of one program with the largest deviation of each quantity by release."""
    tested = ", ".join(f"{version} ({release.date})" for version, release in releases.items())
    rows = {
        quantity: row for release in releases.values() for quantity, row in release.rows.items()
    }
    lines = [
        f"## {program}\n\nReleases: {tested}. Number of cases in parentheses.\n",
        f"| quantity | {' | '.join(releases)} | tolerance |",
        f"|---|{'--:|' * (len(releases) + 1)}",
    ]
    for quantity, row in rows.items():
        cells = [
            f"{each.deviation} ({each.cases})" if each else NOT_COMPARED
            for each in (release.rows.get(quantity) for release in releases.values())
        ]
        lines.append(f"| {quantity} | {' | '.join(cells)} | {row.tolerance} |")
    return "\n".join(lines) + "\n"


def write(path: Path, comparisons: Iterable[Comparison]) -> None:
    """Write the page if there are any comparisons."""
    rows = list(comparisons)
    if rows:
        path.write_text(page(rows, path.read_text() if path.exists() else ""))
