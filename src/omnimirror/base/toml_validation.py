"""Validation of TOML tables: strict types, and errors with file, line, entry and valid values.

Tables of parts with parameter descriptions (a mirror, a lens) are derived from these.
"""

from __future__ import annotations

import dataclasses
import difflib
import re
import types
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import cache
from itertools import takewhile
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from .arguments import format_value
from .errors import OmnimirrorError, SpecError, abbreviate
from .parameters import Parameter

T = typing.TypeVar("T")


class Table(BaseModel):
    """Table of the file: strict types, no unknown keys, no infinities."""

    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)


M = typing.TypeVar("M", bound=Table)


@cache
def table_model(cls: type[Any]) -> type[Table]:
    """Create the pydantic model of a part from its PARAMETERS."""
    hints = typing.get_type_hints(cls)
    defaults = {
        f.name: ... if f.default is dataclasses.MISSING else f.default
        for f in dataclasses.fields(cls)
    }
    parameters: dict[str, Parameter] = cls.PARAMETERS
    entries: dict[str, Any] = {
        name: (_annotation(hints[name], p), Field(defaults[name], description=p.description))
        for name, p in parameters.items()
    }
    model: type[Table] = create_model(cls.__name__, __base__=Table, **entries)
    return model


def _annotation(hint: Any, p: Parameter) -> Any:
    """Return the annotation of one field, with numbers bounded by the parameter's range."""
    args = typing.get_args(hint)
    if isinstance(hint, types.UnionType):
        return _annotation(args[0], p) | None
    if typing.get_origin(hint) is tuple:
        return list[_annotation(args[0], p)]  # type: ignore[misc]  # type computed at run time
    if hint is str:
        return typing.Literal[p.choices]
    return Annotated[hint, Field(ge=p.low, le=p.high, json_schema_extra={"unit": p.unit})]


def merge_tables(data: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return tables with changed entries; None removes an entry or a table.

    >>> merge_tables({"lens": {"kind": "thin", "f_number": 4.0}}, {"lens": {"f_number": 8.0, "kind": None}})
    {'lens': {'f_number': 8.0}}
    """
    merged = dict(data)
    for name, value in changes.items():
        if value is None:
            merged.pop(name, None)
        elif isinstance(value, dict):
            table = merged.get(name, {})
            merged[name] = merge_tables(table if isinstance(table, dict) else {}, value)
        else:
            merged[name] = value
    return merged


# -- validation ------------------------------------------------------------------------------------


class EntryError(SpecError):
    """Invalid or inconsistent entry; ``path`` is its position among the tables."""

    def __init__(self, path: tuple[str, ...], message: str) -> None:
        super().__init__(message)
        self.path = path


KEY = r"""(?:[\w-]+|"[^"\n]*"|'[^'\n]*')"""
ENTRY = re.compile(rf"\s*(\[\[?)?\s*({KEY}(?:\s*\.\s*{KEY})*)\s*(?(1)\]|=)")
STRING_OR_COMMENT = re.compile(
    r"""\"{3}(?:\\.|[^\\])*?\"{3,5}|'{3}.*?'{3,5}|"(?:\\.|[^"\\\n])*"|'[^'\n]*'|\#[^\n]*""", re.S
)


def _entries(text: str) -> Iterator[tuple[int, list[str]]]:
    """Yield line numbers of a TOML text's tables and keys, with their names from the outermost."""
    plain = STRING_OR_COMMENT.sub(
        lambda m: m[0] if "\n" not in m[0] else "''" + "\n" * m[0].count("\n"), text
    )
    table: list[str] = []
    counts: Counter[str] = Counter()
    for number, line in enumerate(plain.splitlines(), start=1):
        if (entry := ENTRY.match(line)) is None:
            continue
        names = [name.strip("\"'") for name in re.findall(KEY, entry[2])]
        if entry[1] is None:
            yield number, [*table, *names]
            continue
        table = names
        if entry[1] == "[[":
            counts[entry[2]] += 1
            table = [*names, str(counts[entry[2]] - 1)]
        yield number, table


class SourceLocator:
    """Locator of entries in a file; formats errors as ``file line n: ...``."""

    def __init__(self, text: str, source: str) -> None:
        self.source = abbreviate(source)
        self.entries = list(_entries(text))

    def line(self, path: tuple[str, ...]) -> int | None:
        """Return the line number of an entry, or else of its table; None if there is neither.

        The tables of a list, ``[[limit]]``, are ``limit.0``, ``limit.1`` and so on. Among the lines
        with the longest common prefix with the path, the first is that of the entry or the start of
        its table, also for dotted keys.

        >>> SourceLocator('notes = "a"\\nmirror.kind = "cone"', "a.toml").line(("mirror", "kind"))
        2
        """
        target = ".".join(path).split(".")
        shared = [
            (
                len(
                    list(
                        takewhile(lambda pair: pair[0] == pair[1], zip(target, entry, strict=False))
                    )
                ),
                -number,
            )
            for number, entry in self.entries
        ]
        prefix_length, line = max(shared, default=(0, 0))
        return -line if prefix_length else None

    def error(self, path: tuple[str, ...], message: str) -> SpecError:
        line = self.line(path)
        return SpecError(f"{self.source}{f' line {line}' if line else ''}: {message}")

    def wrap(self, path: tuple[str, ...], make: Callable[[], T]) -> T:
        """Run ``make`` and add the location to its errors: their own path, or else ``path``."""
        try:
            return make()
        except OmnimirrorError as e:
            raise self.error(getattr(e, "path", path), str(e)) from None


class NullLocator(SourceLocator):
    """Locator without lines: errors report the path of their entry."""

    def __init__(self) -> None:
        super().__init__("", "")

    def error(self, path: tuple[str, ...], message: str) -> SpecError:
        return EntryError(path, message)


NOUNS = {dict: "a table", str: "a string in quotes", int: "an integer", list: "a list of tables"}


def check_entries(
    data: dict[str, Any], entry_types: dict[str, type], file_format: int, where: SourceLocator
) -> None:
    """Check that entries outside tables are known, of the right type and of this file format."""
    for key, value in data.items():
        if key not in entry_types:
            name = format_value(key)[1:-1]
            raise where.error(
                (key,),
                f"unknown entry {name}{did_you_mean(key, entry_types)}; use {', '.join(entry_types)}",
            )
        if not isinstance(value, entry_types[key]) or isinstance(value, bool):
            raise where.error(
                (key,), f"{key} must be {NOUNS[entry_types[key]]}; got {format_value(value)}"
            )
    if (version := data.get("format", file_format)) != file_format:
        raise where.error(
            ("format",),
            f"format must be {file_format} for this version of omnimirror; got {version}",
        )


def validated(model: type[M], section: str, table: dict[str, Any], where: SourceLocator) -> M:
    """Validate a table by its model; an error gives its line, the entry and the valid values."""
    try:
        return model.model_validate(table)
    except ValidationError as e:
        # a misspelt entry is the likely cause of a missing one: report it first
        problem = min(e.errors(), key=lambda p: p["type"] != "extra_forbidden")
        path = (section, *(str(p) for p in problem["loc"]))
        raise where.error(path[:2], _error_message(model, path, problem)) from None


def _error_message(model: type[Table], path: tuple[str, ...], problem: Any) -> str:
    """Convert a pydantic error to a message with the value and the valid values."""
    name, value = ".".join(path[:2]), problem["input"]
    index = next((f"[{p}]" for p in path[2:] if p.isdigit()), "")
    match problem["type"]:
        case "missing":
            return f"{name} is missing{_describe(model, path[1])}"
        case "extra_forbidden":
            names = list(model.model_fields)
            return f"unknown entry {name}{did_you_mean(path[1], names)}; use {', '.join(names)}"
        case "literal_error":
            return f"{name} must be one of {problem['ctx']['expected']}; got {format_value(value)}"
        case _:
            requirement = re.sub(r"^(Input|List|String|Tuple|it) should", "must", problem["msg"])
            requirement = re.sub(r" after validation, not \d+$", "", requirement)
            return (
                f"{name}{index} {requirement}; got "
                f"{format_value(value)}{_describe(model, path[1]) if path[1:] else ''}"
            )


def _describe(model: type[Table], name: str) -> str:
    description = model.model_fields[name].description
    return f" ({description})" if description else ""


def did_you_mean(word: str, names: Iterable[str]) -> str:
    close = difflib.get_close_matches(word, list(names), n=1, cutoff=0.5)
    return f"; did you mean {close[0]}?" if close else ""


def class_of(
    section: str, data: dict[str, Any], registry: Mapping[str, type[Any]], where: SourceLocator
) -> type[Any]:
    """Return the class named by the entry ``kind`` of a table."""
    kind = data[section].get("kind")
    if kind is None:
        raise where.error((section,), f"{section}.kind is missing; use {', '.join(registry)}")
    if not isinstance(kind, str) or kind not in registry:
        hint = did_you_mean(str(kind), registry)
        raise where.error(
            (section, "kind"),
            f"unknown {section}.kind {format_value(kind)}{hint}; use {', '.join(registry)}",
        )
    return registry[kind]
