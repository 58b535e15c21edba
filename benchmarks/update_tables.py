"""Insert the benchmark tables into the documentation pages, between the marks with their names.

Tables that were not measured remain unchanged.

    python benchmarks/update_tables.py --tables out/benchmarks
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from omnimirror.base.files import write_text

DOCS = Path(__file__).parents[1] / "docs"


def filled(page: str, tables: Path) -> str:
    """Return the page with all available tables; table headings belong to the page."""

    def table(mark: re.Match[str]) -> str:
        path = tables / f"{mark['name']}.md"
        if not path.exists():
            return mark[0]
        text = re.sub(r"\A# .*\n+", "", path.read_text(encoding="utf-8"))
        return f"<!-- {mark['name']} -->\n\n{text.strip()}\n\n<!-- end -->"

    return re.sub(r"<!-- (?P<name>\w+) -->\n.*?<!-- end -->", table, page, flags=re.S)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--tables", type=Path, default=Path("out/benchmarks"))
    arguments = parser.parse_args()
    for path in sorted(DOCS.glob("*.md")):
        page = path.read_text(encoding="utf-8")
        if (new := filled(page, arguments.tables)) != page:
            write_text(path, new)


if __name__ == "__main__":
    main()
