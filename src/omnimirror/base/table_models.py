"""Pydantic models of TOML tables, derived from the parameter descriptions of parts.

They are imported when a table requires them: plain tables of sensor files are accepted by
:func:`omnimirror.base.toml_validation.plain_values`, which is faster than importing pydantic.
"""

from __future__ import annotations

import dataclasses
import re
import types
import typing
from functools import cache
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from .arguments import format_value
from .parameters import Parameter
from .toml_validation import SourceLocator, did_you_mean


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


# -- Validation ------------------------------------------------------------------------------------


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
