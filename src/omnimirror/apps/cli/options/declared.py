"""Options declared once: as fields of a frozen dataclass, which travels as that from the door on."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from functools import wraps
from typing import Any, TypeVar

import click

from ..help_pages import GroupedOption

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class Options:
    """A group of options; what was left out holds its default, mostly None."""

    @property
    def given(self) -> dict[str, Any]:
        """The options that say something, by their fields' names."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}

    @property
    def changed(self) -> list[str]:
        """The options that say something else than what holds anyway."""
        defaults = {f.name: f.default for f in fields(self)}
        given = {name: v for name, v in self.given.items() if not (isinstance(v, tuple) and not v)}  # given 0 times
        return [name for name, v in given.items() if defaults[name] is None or v != defaults[name]]

    def picked(self, *names: str) -> dict[str, Any]:
        """Those of some options that say something."""
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def option(*flags: str, default: Any = None, **attributes: Any) -> Any:
    """A field of :class:`Options`, and how it is asked for: as :func:`click.option`, by its own name unless said."""
    return field(default=default, metadata={"flags": flags, "attributes": attributes})


def takes(kind: type[Options], name: str) -> Callable[[Command], Command]:
    """Give a click command the options of a dataclass, which reach it as one argument of that name."""

    def decorate(function: Command) -> Command:
        @wraps(function)
        def gathered(*args: Any, **values: Any) -> Any:
            own = {f.name: values.pop(f.name) for f in fields(kind)}
            return function(*args, **{name: kind(**own)}, **values)

        command: Any = gathered
        for f in reversed(fields(kind)):
            attributes: dict[str, Any] = {"show_default": f.default is not None, **f.metadata["attributes"]}
            if not attributes.get("required"):  # click takes a default of None for an answer, where one is required too
                attributes["default"] = f"{f.default:g}" if isinstance(f.default, float) else f.default
            declarations = (*(f.metadata["flags"] or [flag(f.name)]), f.name)
            command = click.option(*declarations, cls=GroupedOption, group=heading(kind), **attributes)(command)
        return command  # type: ignore[no-any-return]

    return decorate


def heading(kind: type[Options]) -> str:
    """What stands above a group in ``--help``: the beginning of what its docstring says, to the first comma or stop."""
    return re.split("[,;.]", kind.__doc__ or kind.__name__, maxsplit=1)[0]


def refuse_other(given: Iterable[str], options_of: dict[str, tuple[str, ...]], chosen: str) -> None:
    """Refuse options that belong to other owners than the chosen one, each owner named by its flag."""
    for name in given:
        owners = [owner for owner, names in options_of.items() if name in names]
        if owners and chosen not in owners:
            *others, last = owners
            belongs = f"{', '.join(others)} and {last}" if others else last
            raise click.UsageError(f"{flag(name)} does not apply to {chosen}; it belongs to {belongs}")


def flag(name: str) -> str:
    """The option of a parameter."""
    return "--" + name.replace("_", "-")
