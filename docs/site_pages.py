"""Assemble the pages of the documentation site in out/site-pages for `make docs`.

    python docs/site_pages.py

The site consists of the pages of docs/, the README as its index, CONTRIBUTING and CHANGELOG, and a
generated reference: signature and docstring of each public name, and the help of each command.
mkdocs.yml defines their order.
"""

from __future__ import annotations

import ast
import inspect
import json
import re
import shutil
import textwrap
import typing
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import FunctionType
from typing import Any

import click

import omnimirror as om
from omnimirror.apps import studio
from omnimirror.apps.cli import app as program
from omnimirror.interop import file_schemas

ROOT = Path(__file__).parents[1]
PAGES = ROOT / "out" / "site-pages"
EXTERNAL_PAGES = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "CODE_OF_CONDUCT.md": "code-of-conduct.md",
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


def copy_pages() -> None:
    """Copy the pages with links adapted to the site."""
    shutil.rmtree(PAGES, ignore_errors=True)
    shutil.copytree(
        ROOT / "docs", PAGES, ignore=shutil.ignore_patterns("*.py", "*.txt", "__pycache__")
    )
    for page in PAGES.glob("*.md"):
        page.write_text(adapt_links(page.read_text(), ROOT / "docs"))
    for source, target in EXTERNAL_PAGES.items():
        (PAGES / target).write_text(
            adapt_links((ROOT / source).read_text(), (ROOT / source).parent)
        )


def adapt_links(text: str, folder: Path) -> str:
    """Convert links to files relative to ``folder`` to links between pages of the site."""

    def target(match: re.Match[str]) -> str:
        path, anchor = match.group(1), match.group(2) or ""
        if ":" in path:
            return match.group(0)
        inside = (folder / path).resolve().relative_to(ROOT).as_posix()
        if inside in EXTERNAL_PAGES:
            return f"]({EXTERNAL_PAGES[inside]}{anchor})"
        return f"]({inside.removeprefix('docs/')}{anchor})"

    return re.sub(r"\]\(([^)#\s]+)(#[^)\s]*)?\)", target, text)


# -- Python ------------------------------------------------------------------------------------------


def package_of(item: Any) -> str:
    """Return the package of a module, class or function: the page of the reference."""
    module = item.__name__ if inspect.ismodule(item) else item.__module__
    return module.split(".")[1] if "." in module else "omnimirror"


def public_names() -> dict[str, list[str]]:
    """Return the public names by package."""
    names = defaultdict(list)
    for name in sorted(n for n in om.__all__ if not n.startswith("_")):
        names[package_of(getattr(om, name))].append(name)
    return dict(sorted(names.items()))


def classes_in(annotation: Any) -> Iterator[type]:
    """Yield the classes of the package in a type annotation."""
    if inspect.isclass(annotation) and annotation.__module__.startswith("omnimirror."):
        yield annotation
    for part in typing.get_args(annotation):
        yield from classes_in(part)


def hints(item: Any) -> dict[str, Any]:
    """Return the type hints of a function or class; empty if a name is defined for type checkers only."""
    try:
        return typing.get_type_hints(item)
    except (NameError, TypeError):
        return {}


def function_of(member: Any) -> Any:
    """Return the function of a method, class method or property; None for other members."""
    if isinstance(member, FunctionType):
        return member
    for attribute in ("__func__", "fget", "_compute"):
        if isinstance(function := getattr(member, attribute, None), FunctionType):
            return function
    return None


def members(cls: type) -> dict[str, Any]:
    """Return the public methods and properties that a class itself defines."""
    return {
        name: member
        for name, member in vars(cls).items()
        if not name.startswith("_") and function_of(member) is not None
    }


def fields(cls: type) -> dict[str, str]:
    """Return the types of the public annotated attributes that a class itself defines."""
    annotations = inspect.get_annotations(cls)
    return {name: str(kind) for name, kind in annotations.items() if not name.startswith("_")}


def bases(cls: type) -> list[type]:
    """Return the base classes of the package."""
    return [base for base in cls.__mro__[1:] if base.__module__.startswith("omnimirror.")]


def referenced_types(item: Any) -> Iterator[type]:
    """Yield the classes in the results of a function, or in the attributes of a class."""
    if inspect.isclass(item):
        own = hints(item)
        for name in fields(item):
            yield from classes_in(own.get(name))
        for member in members(item).values():
            yield from classes_in(hints(function_of(member)).get("return"))
        yield from bases(item)
    elif inspect.isfunction(item):
        yield from classes_in(hints(item).get("return"))


@cache
def public_objects() -> dict[str, Any]:
    """Return classes, functions and modules by the names under which they are documented."""
    objects = {}
    for name in (n for names in public_names().values() for n in names):
        objects[f"om.{name}"] = item = getattr(om, name)
        if inspect.ismodule(item):
            objects |= {f"om.{name}.{k}": member for k, member in module_members(item).items()}
    return objects


def module_members(module: Any) -> dict[str, Any]:
    """Return the public classes and functions of a module or package."""
    return {
        name: member
        for name, member in vars(module).items()
        if not name.startswith("_")
        and (inspect.isclass(member) or inspect.isfunction(member))
        and member.__module__.startswith(module.__name__)
    }


def reachable_types() -> dict[type, str]:
    """Return the types of results and attributes that have no public name, each with its origin."""
    named = public_objects()
    origin: dict[type, str] = {}
    queue = [(name, item) for name, item in named.items()]
    objects = set(map(id, named.values()))
    while queue:
        name, item = queue.pop(0)
        for cls in referenced_types(item):
            if id(cls) not in objects:
                objects.add(id(cls))
                origin[cls] = name
                queue.append((cls.__name__, cls))
    return origin


def reference() -> None:
    """Write one reference page per package: public names, then the types that their signatures refer to."""
    folder = PAGES / "reference"
    folder.mkdir()
    names, types = public_names(), defaultdict(list)
    for cls, origin in sorted(reachable_types().items(), key=lambda item: item[0].__name__):
        types[package_of(cls)].append((cls, origin))
    lines = [
        "# Reference",
        "",
        "Every public name, and the types of results and attributes, from their docstrings. "
        "`import omnimirror as om` provides all names with the prefix `om`.",
        "",
    ]
    for package in sorted({*names, *types}):
        links = [f"[`om.{n}`]({package}.md#om{n.lower()})" for n in names.get(package, [])]
        lines += [f"## [{package}]({package}.md)", "", ", ".join(links), ""]
        links = [f"[`{c.__name__}`]({package}.md#{c.__name__.lower()})" for c, _ in types[package]]
        lines += ["Types: " + ", ".join(links), ""] if links else []
        text = [f"# {package}", ""]
        for name in names.get(package, []):
            text += entry(f"om.{name}", getattr(om, name), 2)
        for cls, origin in types[package]:
            text += entry(cls.__name__, cls, 2, f"Type in `{cls.__module__}`, from `{origin}`.")
        (folder / f"{package}.md").write_text("\n".join(text))
    (folder / "index.md").write_text("\n".join(lines) + "\n")


def anchor_of(title: str) -> str:
    """Return the anchor of a documented name."""
    return re.sub(r"\W", "", title.lower())


def entry(title: str, item: Any, level: int, note: str = "") -> Iterator[str]:
    """Yield the documentation of one name: heading, signature, docstring, and members of a class."""
    yield f"{'#' * level} {title} {{ #{anchor_of(title)} }}\n"
    if callable(item):
        yield f"```python\n{signature(title, item)}\n```\n"
    doc = inspect.getdoc(item) or ""
    yield markdown(doc)
    if note:
        yield f"{note}\n"
    if inspect.ismodule(item):
        for name, member in module_members(item).items():
            yield from entry(f"{title}.{name}", member, level + 1)
    if inspect.isclass(item):
        yield from attributes(item, doc)
        for name, member in members(item).items():
            yield from entry(f"{title}.{name}", member, level + 1)
        yield from inherited(item)


def attributes(cls: type, doc: str) -> Iterator[str]:
    """Yield the annotated attributes that the docstring of a class does not describe."""
    described = set(
        re.findall(r"\w+", " ".join(re.findall(r"^[\w, *]+$|^[\w, ]+(?= : )", doc, re.M)))
    )
    explained = attribute_docs(cls)
    rows = [
        f"- **{name}** (*{kind}*)" + (f": {explained[name]}" if name in explained else "")
        for name, kind in fields(cls).items()
        if name not in described
    ]
    if rows:
        yield "**Attributes**\n\n" + "\n".join(rows) + "\n"


def attribute_docs(cls: type) -> dict[str, str]:
    """Return the docstrings below the annotated attributes of a class."""
    try:
        tree = ast.parse(textwrap.dedent(inspect.getsource(cls))).body[0]
    except (OSError, TypeError):
        return {}
    assert isinstance(tree, ast.ClassDef)
    docs = {}
    for field, following in zip(tree.body, tree.body[1:], strict=False):
        is_text = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
        if isinstance(field, ast.AnnAssign) and isinstance(field.target, ast.Name) and is_text:
            text = " ".join(str(following.value.value).split())
            docs[field.target.id] = ROLE.sub(r"`\1`", text).replace("``", "`")
    return docs


def inherited(cls: type) -> Iterator[str]:
    """Yield the members of base classes, with links to their documentation."""
    objects = {*members(cls), *fields(cls)}
    public = {id(item): name for name, item in public_objects().items()}
    for base in bases(cls):
        names = [n for n in (*fields(base), *members(base)) if n not in objects]
        objects |= set(names)
        title = public.get(id(base), base.__name__)
        target = f"{package_of(base)}.md#{anchor_of(title)}"
        if names:
            yield f"Inherited from [`{title}`]({target}): {', '.join(f'`{n}`' for n in names)}.\n"


class UnquotedAnnotation(str):
    """Annotation without quotes."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def signature(title: str, item: Any) -> str:
    """Return the call signature, one parameter per line if long."""
    try:
        parameters_of = inspect.signature(getattr(item, "__func__", item))
    except (TypeError, ValueError):
        return title
    parameters = [
        p.replace(annotation=UnquotedAnnotation(p.annotation))
        if isinstance(p.annotation, str)
        else p
        for p in parameters_of.parameters.values()
    ]
    returned = (
        UnquotedAnnotation(parameters_of.return_annotation)
        if isinstance(parameters_of.return_annotation, str)
        else parameters_of.return_annotation
    )
    short = f"{title}{parameters_of.replace(parameters=parameters, return_annotation=returned)}"
    return (
        short
        if len(short) <= 100
        else f"{title}(\n    " + ",\n    ".join(map(str, parameters)) + ",\n)"
    )


def markdown(doc: str) -> str:
    """Convert a NumPy docstring to Markdown: bold section titles, parameter lists, code examples."""
    doc = ROLE.sub(r"`\1`", doc).replace("``", "`")
    pieces = SECTION.split(doc)
    parts = [prose(pieces[0])]
    for name, body in zip(pieces[1::2], pieces[2::2], strict=True):
        parts += [
            f"**{name}**\n",
            prose(body) if name in ("Notes", "Examples", "References") else parameter_list(body),
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


def parameter_list(body: str) -> str:
    """Convert `name : type` entries with indented descriptions to a list."""
    lines: list[str] = []
    for block in re.split(r"\n(?=\S)", body.strip("\n")):
        head, _, description = block.partition("\n")
        name, _, kind = head.partition(" : ")
        if not description and " : " not in head and " " in head:  # text after the list
            lines += ["", block, ""]
            continue
        text = " ".join(textwrap.dedent(description).split())
        lines.append(
            f"- **{name}**" + (f" (*{kind}*)" if kind else "") + (f": {text}" if text else "")
        )
    return "\n".join(lines) + "\n"


# -- commands ----------------------------------------------------------------------------------------


def commands(
    group: click.Command, command_words: tuple[str, ...]
) -> Iterator[tuple[str, click.Command]]:
    """Yield all subcommands with the words of their call."""
    context = click.Context(group, info_name=command_words[-1])
    if isinstance(group, click.Group):
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            if command is not None:
                yield " ".join((*command_words, name)), command
                yield from commands(command, (*command_words, name))


def command_line() -> None:
    """Write the help of each command as printed."""
    lines = ["# Commands", "", "Output of `--help` for each command.", ""]
    for command_words, command in commands(program, ("omnimirror",)):
        context = click.Context(
            command, info_name=command_words, max_content_width=100, terminal_width=100
        )
        lines += [f"## {command_words}", "", "```text", command.get_help(context), "```", ""]
    (PAGES / "reference" / "commands.md").write_text("\n".join(lines))


def schemas() -> None:
    """Write the JSON Schema of each kind of file."""
    folder = PAGES / "schemas"
    folder.mkdir()
    for kind in file_schemas.KINDS:
        text = json.dumps(om.schema(kind), indent=2, allow_nan=False)
        (folder / f"{kind}.json").write_text(text, encoding="utf-8")


def write_standalone_page() -> None:
    """Write the studio without a server, embedded in pages."""
    (PAGES / "viewer.html").write_text(studio.standalone_page(), encoding="utf-8")


if __name__ == "__main__":
    copy_pages()
    write_standalone_page()
    reference()
    command_line()
    schemas()
    print(f"{len(list(PAGES.rglob('*.md')))} pages in {PAGES.relative_to(ROOT)}")
