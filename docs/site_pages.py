"""The pages of the documentation's site, put together in out/site-pages for `make docs`.

    python docs/site_pages.py

The pages of docs/ as they are, the README as the first one, CONTRIBUTING and CHANGELOG beside them, and a reference
made from the code: of every public name its signature and docstring, of every command its help. Their order stands in
mkdocs.yml.
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
"""Pages that live beside docs/, and the names that they have on the site."""
SECTION = re.compile(r"^([A-Z][A-Za-z ]+)\n-{3,}$", re.MULTILINE)
ROLE = re.compile(r":(?:class|func|meth|attr|data|mod|exc):`~?\.?([^`]+)`")


def copied() -> None:
    """The pages as they stand, with links that lead where they are on the site."""
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.copytree(ROOT / "docs", PAGES, ignore=shutil.ignore_patterns("*.py", "*.txt", "__pycache__"))
    for page in PAGES.glob("*.md"):
        page.write_text(relinked(page.read_text(), ROOT / "docs"))
    for source, target in OUTSIDE.items():
        (PAGES / target).write_text(relinked((ROOT / source).read_text(), (ROOT / source).parent))


def relinked(text: str, folder: Path) -> str:
    """Links to files relative to ``folder``, as links between pages of the site."""

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
    """The public names by the room that they come from."""
    found = defaultdict(list)
    for name in sorted(om.__all__):
        module = getattr(om, name) if inspect.ismodule(getattr(om, name)) else inspect.getmodule(getattr(om, name))
        if module is not None:
            found[module.__name__.split(".")[1]].append(name)
    return dict(sorted(found.items()))


def reference() -> None:
    """One page a room, with each of its public names."""
    folder = PAGES / "reference"
    folder.mkdir()
    lines = ["# Reference", "", "Every public name, from its docstring. `import omnimirror as om` opens them all.", ""]
    for room, names in rooms().items():
        lines += [f"- [{room}]({room}.md): " + ", ".join(f"[`{n}`]({room}.md#om{n.lower()})" for n in names)]
        documented = [part for name in names for part in entry(f"om.{name}", getattr(om, name), 2)]
        (folder / f"{room}.md").write_text("\n".join([f"# {room}", "", *documented]))
    (folder / "index.md").write_text("\n".join(lines) + "\n")


def entry(title: str, thing: Any, level: int) -> Iterator[str]:
    """The documentation of one name: heading, signature, docstring, and of a class its methods."""
    anchor = re.sub(r"\W", "", title.lower())
    yield f"{'#' * level} {title} {{ #{anchor} }}\n"
    if callable(thing):
        yield f"```python\n{signature(title, thing)}\n```\n"
    yield markdown(inspect.getdoc(thing) or "")
    if inspect.ismodule(thing):
        for name, member in vars(thing).items():
            is_own = getattr(member, "__module__", "").startswith(thing.__name__)
            if is_own and not name.startswith("_") and inspect.isclass(member) | inspect.isfunction(member):
                yield from entry(f"{title}.{name}", member, level + 1)
    if inspect.isclass(thing):
        for name, member in vars(thing).items():
            documented = isinstance(member, FunctionType | property | classmethod | staticmethod) and member.__doc__
            if documented and not name.startswith("_"):
                yield from entry(f"{title}.{name}", inspect.getattr_static(thing, name), level + 1)


class Bare(str):
    """An annotation that prints without quotes."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def signature(title: str, thing: Any) -> str:
    """The call as one writes it, a parameter a line where it is long."""
    try:
        found = inspect.signature(getattr(thing, "__func__", thing))
    except (TypeError, ValueError):
        return title
    kept = [
        p.replace(annotation=Bare(p.annotation)) if isinstance(p.annotation, str) else p
        for p in found.parameters.values()
    ]
    returned = Bare(found.return_annotation) if isinstance(found.return_annotation, str) else found.return_annotation
    short = f"{title}{found.replace(parameters=kept, return_annotation=returned)}"
    return short if len(short) <= 100 else f"{title}(\n    " + ",\n    ".join(map(str, kept)) + ",\n)"


def markdown(doc: str) -> str:
    """A NumPy docstring as Markdown: sections as bold lines, parameters as a list, examples as code."""
    doc = ROLE.sub(r"`\1`", doc).replace("``", "`")
    pieces = SECTION.split(doc)
    parts = [prose(pieces[0])]
    for name, body in zip(pieces[1::2], pieces[2::2], strict=True):
        parts += [f"**{name}**\n", prose(body) if name in ("Notes", "Examples", "References") else items(body)]
    return "\n".join(parts) + "\n"


def prose(text: str) -> str:
    """Paragraphs; what stands at a prompt or is indented after a double colon becomes code."""
    blocks = []
    for block in re.split(r"\n\s*\n", text.strip("\n")):
        if block.lstrip().startswith(">>>"):
            blocks.append(f"```pycon\n{textwrap.dedent(block)}\n```")
        else:
            blocks.append(block)
    return "\n\n".join(blocks).replace("::\n", ":\n") + "\n"


def items(body: str) -> str:
    """`name : type` with an indented description each."""
    lines: list[str] = []
    for block in re.split(r"\n(?=\S)", body.strip("\n")):
        head, _, description = block.partition("\n")
        name, _, kind = head.partition(" : ")
        if not description and " : " not in head and " " in head:  # words after the list
            lines += ["", block, ""]
            continue
        told = " ".join(textwrap.dedent(description).split())
        lines.append(f"- **{name}**" + (f" (*{kind}*)" if kind else "") + (f": {told}" if told else ""))
    return "\n".join(lines) + "\n"


# -- commands ----------------------------------------------------------------------------------------


def commands(group: click.Command, words: tuple[str, ...]) -> Iterator[tuple[str, click.Command]]:
    """Every command below this one, by the words that call it."""
    context = click.Context(group, info_name=words[-1])
    if isinstance(group, click.Group):
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            if command is not None:
                yield " ".join((*words, name)), command
                yield from commands(command, (*words, name))


def command_line() -> None:
    """The help of every command, as it prints it."""
    lines = ["# Commands", "", "What `--help` says of each.", ""]
    for words, command in commands(program, ("omnimirror",)):
        context = click.Context(command, info_name=words, max_content_width=100, terminal_width=100)
        lines += [f"## {words}", "", "```text", command.get_help(context), "```", ""]
    (PAGES / "reference" / "commands.md").write_text("\n".join(lines))


def page_alone() -> None:
    """The studio without a server, which pages embed."""
    (PAGES / "straighten.html").write_text(studio.page_alone(), encoding="utf-8")


if __name__ == "__main__":
    copied()
    page_alone()
    reference()
    command_line()
    print(f"{len(list(PAGES.rglob('*.md')))} pages in {PAGES.relative_to(ROOT)}")
