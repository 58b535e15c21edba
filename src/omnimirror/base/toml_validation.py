"""Validation of TOML tables: plain values, and errors with file, line, entry and valid values."""

from __future__ import annotations

import dataclasses
import difflib
import re
import typing
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import takewhile
from typing import Any

from .arguments import format_value
from .errors import OmnimirrorError, SpecError, abbreviate
from .parameters import Parameter

T = typing.TypeVar("T")


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


def plain_values(cls: type[Any], table: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return the entries of a part's table with its defaults, if all of them are plainly valid.

    Parameters
    ----------
    cls
        Dataclass with the parameter descriptions PARAMETERS.
    table
        Table of the part.

    Returns
    -------
    dict or None
        Values of all parameters, equal to those of the model of the part
        (:func:`omnimirror.base.table_models.table_model`). None if an entry is invalid, missing or
        neither a number nor a word; the model then validates the table.

    Examples
    --------
    >>> from omnimirror.optics.mirrors.mirror import MirrorPose
    >>> plain_values(MirrorPose, {"tilt_x_deg": 1})["tilt_x_deg"]
    1.0
    >>> plain_values(MirrorPose, {"tilt_x_deg": "1"}) is None
    True
    """
    parameters: dict[str, Parameter] = cls.PARAMETERS
    if not parameters.keys() >= table.keys():
        return None
    values = {}
    for field in dataclasses.fields(cls):
        name = field.name
        if name not in parameters:
            continue
        if name not in table:
            if field.default is dataclasses.MISSING:
                return None
            values[name] = field.default
            continue
        value = plain_value(table[name], str(field.type), parameters[name])
        if value is None:
            return None
        values[name] = value
    return {name: values[name] for name in parameters}


def plain_value(value: Any, annotation: str, parameter: Parameter) -> Any:
    """Return numbers within the range of a parameter, or one of its words; otherwise None."""
    kind = annotation.removesuffix(" | None")
    if kind.startswith("tuple[float,") and isinstance(value, list):
        numbers = tuple(plain_value(number, "float", parameter) for number in value)
        return None if None in numbers else numbers
    if kind == "str":
        return value if isinstance(value, str) and value in parameter.choices else None
    if type(value) not in ((int, float) if kind == "float" else (int,)):
        return None
    if kind not in ("float", "int") or not parameter.low <= value <= parameter.high:
        return None
    return float(value) if kind == "float" else int(value)
