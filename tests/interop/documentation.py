"""Code and commands for other programs in docs/interoperability.md, which the tests execute."""

from __future__ import annotations

import re
from pathlib import Path

PAGE = Path(__file__).parents[2] / "docs" / "interoperability.md"


def section(heading: str, level: str = "###") -> str:
    """Return the text below a heading of the page."""
    text = PAGE.read_text(encoding="utf-8").split(f"\n{level} {heading}\n")[1]
    return re.split(r"^#{2,3} ", text, maxsplit=1, flags=re.MULTILINE)[0]


def unmarked_code(heading: str, level: str = "###") -> str:
    """Return the only block without a language below a heading of the page."""
    blocks = re.findall(r"(?ms)^```(\w*)\n(.*?)^```", section(heading, level))
    (code,) = (text for language, text in blocks if not language)
    return code


def shell_command(heading: str) -> str:
    """Return the only indented command line below a heading of the page."""
    (line,) = re.findall(r"^    (\S.*)$", section(heading), re.MULTILINE)
    return line
