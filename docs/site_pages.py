"""Assemble the pages of the documentation site in out/site-pages for `make docs`.

    python docs/site_pages.py

The site consists of the pages of docs/, the README as its index, CONTRIBUTING and CHANGELOG, and a
generated reference: signature and docstring of each public name, and the help of each command.
mkdocs.yml defines their order.
"""

from __future__ import annotations

import inspect
import re
import shutil
import textwrap
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from types import FunctionType
from typing import Any

import click

import omnimirror as om
from omnimirror.apps import studio
from omnimirror.apps.cli import app as program

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "out" / "site-pages"
OUTSIDE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "THIRD_PARTY.md": "third-party.md",
    "LICENSE": "licence.md",
    "native/README.md": "native.md",
    "web/README.md": "web.md",
    "release/README.md": "releases.md",
}
"""Pages outside docs/ with their names on the site."""
SECTION = re.compile(r"^([A-Z][A-Za-z ]+)\n-{3,}$", re.MULTILINE)
ROLE = re.compile(r":(?:class|func|meth|attr|data|mod|exc):`~?\.?([^`]+)`")


def copied() -> None:
    """Copy the pages with links adapted to the site."""
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.copytree(
        ROOT / "docs", PAGES, ignore=shutil.ignore_patterns("*.py", "*.txt", "__pycache__")
    )
    for page in PAGES.glob("*.md"):
        page.write_text(relinked(page.read_text(), ROOT / "docs"))
    for source, target in OUTSIDE.items():
        (PAGES / target).write_text(relinked((ROOT / source).read_text(), (ROOT / source).parent))


def relinked(text: str, folder: Path) -> str:
    """Convert links to files relative to ``folder`` to links between pages of the site."""

    def target(match: re.Match[str]) -> str:
        path, anchor = match.group(1), match.group(2) or ""
        if ":" in path:
            return match.group(0)
        inside = (folder / path).resolve().relative_to(ROOT).as_posix()
        if inside in OUTSIDE:
            return f"]({OUTSIDE[inside]}{anchor})"
        return f"]({inside.removeprefix('docs/')}{anchor})"

    return re.sub(r"\]\(([^)#\s]+)(#[^)\s]*)?\)", target, text)


# -- Python ------------------------------------------------------------------------------------------


def rooms() -> dict[str, list[str]]:
    """Return the public names by package."""
    found = defaultdict(list)
    for name in sorted(om.__all__):
        module = (
            getattr(om, name)
            if inspect.ismodule(getattr(om, name))
            else inspect.getmodule(getattr(om, name))
        )
        if module is not None:
            found[module.__name__.split(".")[1]].append(name)
    return dict(sorted(found.items()))


def reference() -> None:
    """Write one reference page per package."""
    folder = PAGES / "reference"
    folder.mkdir()
    lines = [
        "# Reference",
        "",
        "Every public name, from its docstring. `import omnimirror as om` opens them all.",
        "",
    ]
    for room, names in rooms().items():
        lines += [
            f"- [{room}]({room}.md): "
            + ", ".join(f"[`{n}`]({room}.md#om{n.lower()})" for n in names)
        ]
        documented = [part for name in names for part in entry(f"om.{name}", getattr(om, name), 2)]
        (folder / f"{room}.md").write_text("\n".join([f"# {room}", "", *documented]))
    (folder / "index.md").write_text("\n".join(lines) + "\n")


def entry(title: str, thing: Any, level: int) -> Iterator[str]:
    """Yield the documentation of one name: heading, signature, docstring, and methods of a class."""
    anchor = re.sub(r"\W", "", title.lower())
    yield f"{'#' * level} {title} {{ #{anchor} }}\n"
    if callable(thing):
        yield f"```python\n{signature(title, thing)}\n```\n"
    yield markdown(inspect.getdoc(thing) or "")
    if inspect.ismodule(thing):
        for name, member in vars(thing).items():
            is_own = getattr(member, "__module__", "").startswith(thing.__name__)
            if (
                is_own
                and not name.startswith("_")
                and inspect.isclass(member) | inspect.isfunction(member)
            ):
                yield from entry(f"{title}.{name}", member, level + 1)
    if inspect.isclass(thing):
        for name, member in vars(thing).items():
            documented = (
                isinstance(member, FunctionType | property | classmethod | staticmethod)
                and member.__doc__
            )
            if documented and not name.startswith("_"):
                yield from entry(f"{title}.{name}", inspect.getattr_static(thing, name), level + 1)


class Bare(str):
    """Annotation without quotes."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def signature(title: str, thing: Any) -> str:
    """Return the call signature, one parameter per line if long."""
    try:
        found = inspect.signature(getattr(thing, "__func__", thing))
    except (TypeError, ValueError):
        return title
    kept = [
        p.replace(annotation=Bare(p.annotation)) if isinstance(p.annotation, str) else p
        for p in found.parameters.values()
    ]
    returned = (
        Bare(found.return_annotation)
        if isinstance(found.return_annotation, str)
        else found.return_annotation
    )
    short = f"{title}{found.replace(parameters=kept, return_annotation=returned)}"
    return (
        short if len(short) <= 100 else f"{title}(\n    " + ",\n    ".join(map(str, kept)) + ",\n)"
    )


def markdown(doc: str) -> str:
    """Convert a NumPy docstring to Markdown: bold section titles, parameter lists, code examples."""
    doc = ROLE.sub(r"`\1`", doc).replace("``", "`")
    pieces = SECTION.split(doc)
    parts = [prose(pieces[0])]
    for name, body in zip(pieces[1::2], pieces[2::2], strict=True):
        parts += [
            f"**{name}**\n",
            prose(body) if name in ("Notes", "Examples", "References") else items(body),
        ]
    return "\n".join(parts) + "\n"


def prose(text: str) -> str:
    """Convert paragraphs; prompts and indented blocks after a double colon become code."""
    blocks = []
    for block in re.split(r"\n\s*\n", text.strip("\n")):
        if block.lstrip().startswith(">>>"):
            blocks.append(f"```pycon\n{textwrap.dedent(block)}\n```")
        else:
            blocks.append(block)
    return "\n\n".join(blocks).replace("::\n", ":\n") + "\n"


def items(body: str) -> str:
    """Convert `name : type` entries with indented descriptions to a list."""
    lines: list[str] = []
    for block in re.split(r"\n(?=\S)", body.strip("\n")):
        head, _, description = block.partition("\n")
        name, _, kind = head.partition(" : ")
        if not description and " : " not in head and " " in head:  # text after the list
            lines += ["", block, ""]
            continue
        told = " ".join(textwrap.dedent(description).split())
        lines.append(
            f"- **{name}**" + (f" (*{kind}*)" if kind else "") + (f": {told}" if told else "")
        )
    return "\n".join(lines) + "\n"


# -- commands ----------------------------------------------------------------------------------------


def commands(group: click.Command, words: tuple[str, ...]) -> Iterator[tuple[str, click.Command]]:
    """Yield all subcommands with the words of their call."""
    context = click.Context(group, info_name=words[-1])
    if isinstance(group, click.Group):
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            if command is not None:
                yield " ".join((*words, name)), command
                yield from commands(command, (*words, name))


def command_line() -> None:
    """Write the help of each command as printed."""
    lines = ["# Commands", "", "What `--help` says of each.", ""]
    for words, command in commands(program, ("omnimirror",)):
        context = click.Context(command, info_name=words, max_content_width=100, terminal_width=100)
        lines += [f"## {words}", "", "```text", command.get_help(context), "```", ""]
    (PAGES / "reference" / "commands.md").write_text("\n".join(lines))


def standalone_page() -> None:
    """Write the studio without a server, embedded in pages."""
    (PAGES / "straighten.html").write_text(studio.standalone_page(), encoding="utf-8")


if __name__ == "__main__":
    copied()
    standalone_page()
    reference()
    command_line()
    print(f"{len(list(PAGES.rglob('*.md')))} pages in {PAGES.relative_to(ROOT)}")
