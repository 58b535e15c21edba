"""Values of a YAML, JSON or XML file with their locations, for errors that name the line."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Any, NoReturn

import numpy as np

from ...base.arguments import float_of, shown
from ...base.errors import SpecError
from ...base.files import TOO_DEEP, compose_yaml, parse_json, parse_xml
from ...base.typing import Array
from ...optics.sensor_files.tables import did_you_mean


@dataclass(frozen=True)
class Node:
    """Value in a file: a mapping or a list of entries, or a single word or number.

    Attributes
    ----------
    value
        Dict or list of entries, or text, number, boolean or None.
    source
        File name.
    name
        Path of the entry, such as ``cam0.intrinsics``.
    line
        Line number from 1; None if unknown.
    """

    value: Any
    source: str
    name: str = ""
    line: int | None = None

    def refuse(self, message: str) -> NoReturn:
        """Raise an error at this entry."""
        where = f" line {self.line}" if self.line else ""
        raise SpecError(f"{self.source}{where}: {self.name}{' ' * bool(self.name)}{message}")

    # -- mappings ----------------------------------------------------------------------------------

    def __contains__(self, name: str) -> bool:
        return isinstance(self.value, dict) and name in self.value

    def names(self) -> list[str]:
        """Return the names in a mapping."""
        if not isinstance(self.value, dict):
            self.refuse(f"is valid as a table of names and values, and is {self._kind()}")
        return list(self.value)

    def __getitem__(self, name: str) -> Node:
        if name not in self.names():
            self.refuse(f"has no {name}, which is needed{did_you_mean(name, self.value)}")
        entry: Node = self.value[name]
        return entry

    def polynomial(self, prefix: str) -> tuple[float, ...]:
        """Return the coefficients of a mapping named by their powers: p0, p1, ..."""
        numbers = [self[f"{prefix}0"].number()]
        while f"{prefix}{len(numbers)}" in self:
            numbers.append(self[f"{prefix}{len(numbers)}"].number())
        return tuple(numbers)

    # -- values ------------------------------------------------------------------------------------

    def number(self) -> float:
        """Return a finite number."""
        value = self.value
        try:
            number = np.nan if isinstance(value, bool | dict | list | None) else float_of(str(value))
        except ValueError:
            number = np.nan
        if not np.isfinite(number):
            self.refuse(f"= {self._kind()} is not valid; it is valid as one finite number")
        return number

    def whole(self) -> int:
        """Return an integer, such as a number of pixels."""
        number = self.number()
        if number != np.floor(number) or abs(number) > 2**31:
            self.refuse(f"= {shown(self.value)} is not valid; it is valid as a whole number")
        return int(number)

    def word(self) -> str:
        """Return a word."""
        if not isinstance(self.value, str):
            self.refuse(f"= {self._kind()} is not valid; it is valid as a word")
        return self.value

    def choice(self, *valid: str) -> str:
        """Return one of several words."""
        word = self.word()
        if word not in valid:
            self.refuse(f"= {shown(word)} is not known; valid are {', '.join(valid)}")
        return word

    def entries(self) -> list[Node]:
        """Return the entries of a list."""
        if not isinstance(self.value, list):
            self.refuse(f"is valid as a list, and is {self._kind()}")
        return self.value

    def numbers(self, *counts: int) -> tuple[float, ...]:
        """Return a list of numbers with one of the given lengths."""
        entries = self.entries()
        if counts and len(entries) not in counts:
            valid = " or ".join(map(str, counts))
            self.refuse(f"has {len(entries)} numbers; it is valid with {valid}")
        return tuple(entry.number() for entry in entries)

    def matrix(self, rows: int, columns: int) -> Array:
        """Return a matrix from nested lists, or from ``rows``, ``cols`` and ``data``."""
        if "data" in self:
            flat = self["data"].numbers(rows * columns)
            for name, valid in (("rows", rows), ("cols", columns)):
                if name in self and self[name].whole() != valid:
                    self[name].refuse(f"= {self[name].whole()} is not valid; it is valid as {valid}")
            return np.array(flat).reshape(rows, columns)
        if len(self.entries()) != rows:
            self.refuse(f"has {len(self.entries())} rows; it is valid with {rows} of {columns} numbers")
        return np.array([row.numbers(columns) for row in self.entries()])

    def row(self, *counts: int) -> tuple[float, ...]:
        """Return a row of numbers, from a list or a matrix with one row or column."""
        return self.flat().numbers(*counts)

    def flat(self) -> Node:
        """Return the data list of a matrix with ``data``; other lists unchanged."""
        return self["data"] if "data" in self else self  # noqa: SIM401

    def _kind(self) -> str:
        match self.value:
            case dict():
                return "a table"
            case list():
                return "a list"
            case None:
                return "empty"
        return shown(self.value)


# -- reading ----------------------------------------------------------------------------------


def read_yaml(text: str, source: str) -> Node:
    """Read the entries of a YAML text.

    OpenCV's dialect (``%YAML:1.0``, ``!!opencv-matrix``) is supported.

    Parameters
    ----------
    text
        YAML text.
    source
        File name, for error messages.

    Returns
    -------
    Node
        Whole document.

    Raises
    ------
    SpecError
        If it is not valid YAML, contains references, or is nested too deeply.

    Examples
    --------
    >>> read_yaml("cam0:\\n  resolution: [640, 480]\\n", "a.yaml")["cam0"]["resolution"].numbers(2)
    (640.0, 480.0)
    """
    if text.startswith("%YAML:"):  # OpenCV's header; the line is kept for correct line numbers
        text = "#" + text
    node = compose_yaml(text, source)
    return Node(None, source) if node is None else _entry(node, source, "")


def _entry(tree: Any, source: str, name: str) -> Node:
    """Convert a node of PyYAML's tree; words and numbers remain text."""
    line = tree.start_mark.line + 1
    if tree.id == "mapping":
        pairs = [(str(k.value) if k.id == "scalar" else "?", k, v) for k, v in tree.value]
        table: dict[str, Node] = {}
        for key, key_node, value in pairs:
            if key in table:
                raise SpecError(f"{source} line {key_node.start_mark.line + 1}: {key} stands here a second time")
            table[key] = _entry(value, source, f"{name}.{key}" if name else key)
        return Node(table, source, name, line)
    if tree.id == "sequence":
        items = [_entry(v, source, f"{name}[{i}]") for i, v in enumerate(tree.value)]
        return Node(items, source, name, line)
    is_empty = tree.style is None and tree.value in ("", "~", "null")
    return Node(None if is_empty else tree.value, source, name, line)


def read_json(text: str, source: str) -> Node:
    """Read the entries of a JSON text.

    Raises
    ------
    SpecError
        If it is not valid JSON, or is nested too deeply.

    Examples
    --------
    >>> read_json('{"distortion_center": [319.5, 239.5]}', "a.json")["distortion_center"].numbers(2)
    (319.5, 239.5)
    """
    try:
        return _plain(parse_json(text), source, "")
    except json.JSONDecodeError as problem:
        raise SpecError(f"{source} line {problem.lineno} is not valid JSON: {problem.msg}") from None
    except ValueError as problem:
        reason = f": {problem}" if str(problem) == TOO_DEEP else " holds a whole number of thousands of digits"
        raise SpecError(f"{source}{reason}") from None


def _plain(value: Any, source: str, name: str) -> Node:
    if isinstance(value, dict):
        table = {k: _plain(v, source, f"{name}.{k}" if name else k) for k, v in value.items()}
        return Node(table, source, name)
    if isinstance(value, list):
        return Node([_plain(v, source, f"{name}[{i}]") for i, v in enumerate(value)], source, name)
    return Node(value, source, name)


def read_xml(text: str, source: str) -> Node:
    """Read the entries of an XML text written by OpenCV's ``FileStorage``.

    An element with child elements is a mapping, or a list if these are named ``_``. The content of
    ``data`` and several numbers in a row are lists; other content is a word or number.

    Raises
    ------
    SpecError
        If it is not valid XML, declares entities, or is nested too deeply.

    Examples
    --------
    >>> read_xml("<opencv_storage><xi>1.3</xi><size>4 3</size></opencv_storage>", "a.xml")["size"].numbers(2)
    (4.0, 3.0)
    """
    return _element(parse_xml(text, source), source, "")


def _element(element: Any, source: str, name: str) -> Node:
    """Convert an element of an XML tree."""
    children = list(element)
    if children and all(child.tag == "_" for child in children):
        return Node([_element(c, source, f"{name}[{i}]") for i, c in enumerate(children)], source, name)
    if children:
        table: dict[str, Node] = {}
        for child in children:
            if child.tag in table:
                raise SpecError(f"{source}: {child.tag} stands in {name or 'the file'} a second time")
            table[child.tag] = _element(child, source, f"{name}.{child.tag}" if name else child.tag)
        return Node(table, source, name)
    words = (element.text or "").split()
    if element.tag == "data" or (len(words) > 1 and all(map(_is_number, words))):
        return Node([Node(w, source, f"{name}[{i}]") for i, w in enumerate(words)], source, name)
    return Node(" ".join(words).strip('"') or None, source, name)


def _is_number(word: str) -> bool:
    try:
        float_of(word)
    except ValueError:
        return False
    return True
