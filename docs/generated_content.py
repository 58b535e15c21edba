"""Generate documentation from the code: two package diagrams, and the quantities of the glossary.

    python docs/generated_content.py

Layers are those of the import rules in pyproject.toml. Each package is labelled with the first line
of its docstring. In the matrix, a dot marks an import of the package above by the package on the
left.
"""

from __future__ import annotations

import ast
import re
import textwrap
import tomllib
from html import escape
from pathlib import Path

import grimp

from omnimirror.base.quantities import QUANTITIES

ROOT = Path(__file__).parents[1]
PACKAGE = "omnimirror"
WIDTH, MARGIN, GAP = 1180, 16, 10
LINE_HEIGHT, TITLE_HEIGHT = 14, 20  # px
LETTER_WIDTH = 6.0  # mean width of a small letter, px
CELL_SIZE = 24  # of the matrix, px
TEXT_COLOUR, DETAIL_COLOUR, FILL_COLOUR, DOT_COLOUR = "#22303c", "#4a5b68", "#eef3f6", "#2b6cb0"


def package_layers() -> list[list[str]]:
    """Return the packages of each layer, from the top."""
    rules = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    layers = next(rule["layers"] for rule in rules if rule["type"] == "layers")
    rows = [
        [name.strip().removeprefix(f"{PACKAGE}.") for name in layer.split("|")] for layer in layers
    ]
    return [row for row in rows if row != ["__main__"]]


def summary(package: str) -> str:
    """Return the first line of the docstring of a package."""
    path = ROOT / "src" / PACKAGE / package
    file = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    doc = ast.get_docstring(ast.parse(file.read_text())) or ""
    return doc.split("\n\n")[0].replace("\n", " ").replace("`", "")


def imports() -> set[tuple[str, str]]:
    """Return pairs of packages; the first imports the second."""
    graph = grimp.build_graph(PACKAGE, cache_dir=None)
    pairs = set()
    for module in graph.modules:
        for other in graph.find_modules_directly_imported_by(module):
            if "." in module and "." in other:
                pairs.add((module.split(".")[1], other.split(".")[1]))
    return {(a, b) for a, b in pairs if a not in (b, "__main__")}


def svg(width: float, height: float, label: str, parts: list[str]) -> str:
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" font-family="sans-serif" '
        f'role="img" aria-label="{label}"><rect width="{width:g}" height="{height:g}" fill="white"/>'
    )
    return "\n".join([head, *parts, "</svg>", ""])


def text(x: float, y: float, content: str, size: int, colour: str, attributes: str = "") -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}"{attributes}>{escape(content)}</text>'


def layer_diagram() -> str:
    """Return the layer diagram: one row per layer, with the purpose of each package."""
    parts, top = [], float(MARGIN)
    for row in package_layers():
        width = (WIDTH - 2 * MARGIN - GAP * (len(row) - 1)) / len(row)
        lines = [
            textwrap.wrap(summary(package), int((width - 20) / LETTER_WIDTH)) for package in row
        ]
        height = TITLE_HEIGHT + LINE_HEIGHT * max(map(len, lines)) + 12
        for i, package in enumerate(row):
            left = MARGIN + i * (width + GAP)
            parts.append(
                f'<rect x="{left:.1f}" y="{top:.1f}" width="{width:.1f}" '
                f'height="{height:.1f}" rx="5" fill="{FILL_COLOUR}" '
                f'stroke="{TEXT_COLOUR}"/>'
            )
            parts.append(
                text(
                    left + 10,
                    top + TITLE_HEIGHT - 2,
                    package,
                    14,
                    TEXT_COLOUR,
                    ' font-weight="bold"',
                )
            )
            for j, line in enumerate(lines[i]):
                parts.append(
                    text(
                        left + 10,
                        top + TITLE_HEIGHT + LINE_HEIGHT * (j + 1) - 1,
                        line,
                        11,
                        DETAIL_COLOUR,
                    )
                )
        top += height + GAP
    return svg(WIDTH, top - GAP + MARGIN, "Layers and packages of omnimirror", parts)


def matrix() -> str:
    """Return the import matrix with packages from the top layer down on both axes; all dots are
    right of the diagonal."""
    packages = [package for row in package_layers() for package in row]
    imported, left, top = imports(), 110, 100
    parts = []
    for i, package in enumerate(packages):
        x, y = left + i * CELL_SIZE, top + i * CELL_SIZE
        if i % 2 == 0:
            parts.append(
                f'<rect x="0" y="{y}" width="{left + CELL_SIZE * len(packages)}" '
                f'height="{CELL_SIZE}" fill="{FILL_COLOUR}"/>'
            )
        parts.append(
            text(left - 8, y + CELL_SIZE / 2 + 4, package, 12, TEXT_COLOUR, ' text-anchor="end"')
        )
        rotation = f' transform="rotate(-60 {x + CELL_SIZE / 2:g} {top - 6})"'
        parts.append(text(x + CELL_SIZE / 2, top - 6, package, 12, TEXT_COLOUR, rotation))
        parts.append(
            f'<rect x="{x + 8}" y="{y + 8}" width="{CELL_SIZE - 16}" height="{CELL_SIZE - 16}" fill="#c5d0d8"/>'
        )
    for a, b in sorted(imported):
        x, y = (
            left + (packages.index(b) + 0.5) * CELL_SIZE,
            top + (packages.index(a) + 0.5) * CELL_SIZE,
        )
        parts.append(f'<circle cx="{x:g}" cy="{y:g}" r="5" fill="{DOT_COLOUR}"/>')
    side = CELL_SIZE * len(packages)
    return svg(left + side + 60, top + side + MARGIN, "Imports between packages", parts)


def quantities() -> str:
    """Return the glossary with its table of quantities."""
    page = (ROOT / "docs" / "glossary.md").read_text()
    rows = [
        re.sub(
            r"\|\s+(?=\|)",
            "| ",
            f"| `{q.name}` | {q.symbol} | {q.unit} | {q.meaning} | {q.equation} |",
        )
        for q in QUANTITIES.values()
    ]
    table = "\n".join(
        ["| name | symbol | unit | meaning | equation |", "|---|---|---|---|---|", *rows]
    )
    return re.sub(
        r"(<!-- quantities -->\n).*?(<!-- end -->)", rf"\1\n{table}\n\n\2", page, flags=re.S
    )


GENERATED = {
    "images/layers.svg": layer_diagram,
    "images/imports.svg": matrix,
    "glossary.md": quantities,
}
"""Generated files of this folder with their generators."""


if __name__ == "__main__":
    for name, generate in GENERATED.items():
        (ROOT / "docs" / name).write_text(generate())
