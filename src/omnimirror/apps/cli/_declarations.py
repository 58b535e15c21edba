"""Declaration of commands and options: grouped help pages, and options as fields of frozen dataclasses."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields
from functools import wraps
from typing import Any, TypeVar

import click

from ._output import check_output_files

# -- Commands --------------------------------------------------------------------------------------


class GroupedOption(click.Option):
    """Option that is listed under the heading of its group."""

    def __init__(self, *declarations: Any, group: str, **attributes: Any) -> None:
        super().__init__(*declarations, **attributes)
        self.group = group


class DocumentedCommand(click.Command):
    """Command with a documentation page and at least one example.

    Parameters
    ----------
    page
        Page in docs/, without ``.md``.
    examples
        Examples as complete command lines.
    """

    def __init__(self, *args: Any, page: str, examples: tuple[str, ...], **attributes: Any) -> None:
        super().__init__(*args, **attributes)
        self.page, self.examples = page, examples

    def invoke(self, ctx: click.Context) -> Any:
        check_output_files(ctx)
        return super().invoke(ctx)

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        groups: dict[str, list[tuple[str, str]]] = {"Options": []}
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
            if record is not None:
                groups.setdefault(getattr(option, "group", "Options"), []).append(record)
        if len(groups) == 2 and len(groups["Options"]) <= 2:  # only -o and -h
            groups = {
                "Options": [record for records in reversed(groups.values()) for record in records]
            }
        for title, records in groups.items():
            with formatter.section(title):
                formatter.write_dl(records)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        super().format_epilog(ctx, formatter)
        with formatter.section("Examples" if len(self.examples) > 1 else "Example"):
            for example in self.examples:  # unwrapped, for copying
                formatter.write(f"{'':>{formatter.current_indent}}{example}\n")
        formatter.write(f"\nMore: docs/{self.page}.md\n")


# -- Groups of options -----------------------------------------------------------------------------

Command = TypeVar("Command", bound=Callable[..., Any])


@dataclass(frozen=True)
class Options:
    """Group of options; omitted options have their default, mostly None."""

    @property
    def given(self) -> dict[str, Any]:
        """Options that are given, by field name."""
        return {f.name: value for f in fields(self) if (value := getattr(self, f.name)) is not None}

    @property
    def changed(self) -> list[str]:
        """Options that differ from their defaults."""
        defaults = {f.name: f.default for f in fields(self)}
        given = {name: v for name, v in self.given.items() if not (isinstance(v, tuple) and not v)}
        return [name for name, v in given.items() if defaults[name] is None or v != defaults[name]]

    def subset(self, *names: str) -> dict[str, Any]:
        """Return those of the named options that are given."""
        return {name: value for name in names if (value := getattr(self, name)) is not None}


def option(*flags: str, default: Any = None, **attributes: Any) -> Any:
    """Declare a field of :class:`Options` with the arguments of :func:`click.option`; named after
    the field by default.
    """
    return field(default=default, metadata={"flags": flags, "attributes": attributes})


def add_options(kind: type[Options], name: str) -> Callable[[Command], Command]:
    """Add the options of a dataclass to a click command, which receives them as one argument."""

    def decorate(function: Command) -> Command:
        @wraps(function)
        def gathered(*args: Any, **values: Any) -> Any:
            own = {f.name: values.pop(f.name) for f in fields(kind)}
            return function(*args, **{name: kind(**own)}, **values)

        command: Any = gathered
        for f in reversed(fields(kind)):
            attributes: dict[str, Any] = {
                "show_default": f.default is not None,
                **f.metadata["attributes"],
            }
            if not attributes.get("required"):  # None would satisfy a required option
                attributes["default"] = (
                    f"{f.default:g}" if isinstance(f.default, float) else f.default
                )
            declarations = (*(f.metadata["flags"] or [flag(f.name)]), f.name)
            command = click.option(
                *declarations, cls=GroupedOption, group=heading(kind), **attributes
            )(command)
        return command  # type: ignore[no-any-return]

    return decorate


def heading(kind: type[Options]) -> str:
    """Return the heading of a group in ``--help``: its docstring up to the first comma, semicolon
    or stop.
    """
    return re.split("[,;.]", kind.__doc__ or kind.__name__, maxsplit=1)[0]


def refuse_inapplicable(
    given: Iterable[str], options_of: dict[str, tuple[str, ...]], chosen: str
) -> None:
    """Raise UsageError for options of owners other than the chosen one, each owner named by its
    flag.
    """
    for name in given:
        owners = [owner for owner, names in options_of.items() if name in names]
        if owners and chosen not in owners:
            *others, last = owners
            required = f"{', '.join(others)} or {last}" if others else last
            raise click.UsageError(
                f"{flag(name)} requires {required}; it does not apply to {chosen}"
            )


def flag(name: str) -> str:
    """Return the option of a parameter as it is written on the command line."""
    context = click.get_current_context(silent=True)
    for parameter in context.command.params if context else ():
        if parameter.name == name and isinstance(parameter, click.Option):
            return max(parameter.opts, key=len)
    return "--" + name.replace("_", "-")
