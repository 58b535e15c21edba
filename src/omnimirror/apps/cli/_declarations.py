"""Declaration of commands and options: grouped help pages, options as fields of frozen dataclasses,
and value types.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Collection, Iterable
from dataclasses import Field, dataclass, field, fields
from functools import reduce, wraps
from operator import or_
from typing import Any, TypeVar, get_args

import click
import numpy as np
from click.shell_completion import CompletionItem
from numpy.typing import NDArray

from ...base.arguments import check_type, format_value, parse_float, type_hints
from ...base.errors import InvalidParameter, SpecError
from ...base.files import parse_toml
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

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        try:
            return super().parse_args(ctx, args)
        except click.NoSuchOption as e:
            if setting := _setting_of(self, e.option_name):
                message = f"{e.message} Use {setting}."
                raise click.NoSuchOption(e.option_name, message, ctx=ctx) from None
            raise

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
        """Options given on the command line, by field name."""
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


Group = TypeVar("Group", bound=Options)


def option(*flags: str, default: Any = None, **attributes: Any) -> Any:
    """Declare a field of :class:`Options` with the arguments of :func:`click.option`; named after
    the field by default.
    """
    return field(default=default, metadata={"flags": flags, "attributes": attributes})


def setting(table: str, default: Any = None, type: Any = None) -> Any:
    """Declare a field of :class:`Options` that is given as ``--set TABLE.FIELD=VALUE``.

    The value must match the annotation of the field; or ``type`` parses it, as that of an option.
    """
    return field(default=default, metadata={"table": table, "type": type})


def add_options(
    kind: type[Options], name: str, group: str | None = None
) -> Callable[[Command], Command]:
    """Add the options of a dataclass to a click command, which receives them as one argument.

    ``group`` is the heading of the options in ``--help``, that of the dataclass by default.
    """

    def decorate(function: Command) -> Command:
        @wraps(function)
        def gathered(*args: Any, **values: Any) -> Any:
            own = parsed_options(kind, click.get_current_context())
            own_names = {f.name for f in fields(kind) if "table" not in f.metadata}
            others = {key: value for key, value in values.items() if key not in own_names}
            return function(*args, **{name: own}, **others)

        command: Any = gathered
        for f in reversed(fields(kind)):
            if "table" in f.metadata:
                _set_option(command).settings[f"{f.metadata['table']}.{f.name}"] = f.name
                continue
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
                *declarations, cls=GroupedOption, group=group or heading(kind), **attributes
            )(command)
        return command  # type: ignore[no-any-return]  # the type depends on the argument

    return decorate


def parsed_options(kind: type[Group], context: click.Context) -> Group:
    """Return the options and settings of a dataclass in a parsed command line."""
    settings = context.meta.get(_SETTINGS, {})
    values = {
        f.name: _setting_value(kind, f, settings.get(f.name))
        if "table" in f.metadata
        else context.params[f.name]
        for f in fields(kind)
    }
    return kind(**values)


def _setting_value(kind: type[Options], f: Field[Any], value: Any) -> Any:
    """Return the validated value of a setting; its default for None."""
    key = f"{f.metadata['table']}.{f.name}"
    if value is None:
        return f.default
    if f.metadata["type"] is not None:
        try:
            return click.types.convert_type(f.metadata["type"])(format_setting(value))
        except click.BadParameter as e:
            space = " " if e.message.startswith("must") else ": "
            raise InvalidParameter(f"{key}{space}{e.message.rstrip('.')}") from None
    # mypy considers the hash of the instances, not that of the class
    hint = type_hints(kind)[f.name]  # type: ignore[arg-type]  # see above
    if parts := [part for part in get_args(hint) if part is not type(None)]:
        hint = reduce(or_, parts) if len(parts) < len(get_args(hint)) else hint
    try:
        check_type(key, value, hint)
    except InvalidParameter as e:
        raise InvalidParameter(str(e).replace("True or False", "true or false")) from None
    return value


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
        if isinstance(parameter, SetOption):
            for key, field_name in parameter.settings.items():
                if field_name == name:
                    return f"--set {key}"
        if parameter.name == name and isinstance(parameter, click.Option):
            return max(parameter.opts, key=len)
    return "--" + name.replace("_", "-")


# -- Entries of files and settings -----------------------------------------------------------------

_SETTINGS, _CHANGES = "omnimirror.settings", "omnimirror.changes"


class SetOption(GroupedOption):
    """Option ``--set`` for entries of a file and for settings without an option of their own.

    Values have the syntax of TOML; the quotes of a word and the brackets of a list may be omitted.
    An empty value removes an entry of a file, and selects the default of a setting.
    """

    MAX_LISTED = 16
    """Number of settings up to which the help lists them; otherwise it lists their tables."""

    def __init__(self) -> None:
        super().__init__(
            ["--set"],
            group="Options",
            multiple=True,
            expose_value=False,
            callback=lambda ctx, _, texts: self._store(ctx, texts),
            metavar="TABLE.KEY=VALUE",
        )
        self.settings: dict[str, str] = {}
        """Fields of option groups by their keys."""
        self.file = ""
        """Name of the file whose entries can be set."""
        self.tables: Collection[str] | None = ()
        """Tables of the file; None if they are known only when the file is read."""

    def get_help_record(self, ctx: click.Context) -> tuple[str, str]:
        names: dict[str, list[str]] = {}
        for key in self.settings:
            table, _, name = key.partition(".")
            names.setdefault(table, []).append(name)
        keys = [
            f"{table}.{entries[0]}"
            if len(entries) == 1
            else f"{table}.{{{', '.join(sorted(entries))}}}"
            for table, entries in sorted(names.items())
        ]
        files = [f"the {self.file}"] * bool(self.file)
        if len(self.settings) > self.MAX_LISTED:
            *tables, last = [*files, *sorted(names)]
            page = getattr(ctx.command, "page", "")
            targets = f"an entry of {', '.join(tables)} or {last}: docs/{page}.md"
        else:
            targets = ", ".join([*(f"an entry of {file}" for file in files), *keys])
        return f"--set {self.metavar}", f"Set {targets} (repeatable)."

    def _store(self, ctx: click.Context, texts: tuple[str, ...]) -> None:
        """Store the settings by field, and the changes of the file as nested tables."""
        settings = ctx.meta.setdefault(_SETTINGS, {})
        changes = ctx.meta.setdefault(_CHANGES, {})
        for text in texts:
            names, value = parse_entry(text)
            key = ".".join(names)
            if key in self.settings:
                settings[self.settings[key]] = _tuples(value)
                continue
            if self.tables is None:
                is_unknown = any(setting.startswith(f"{names[0]}.") for setting in self.settings)
            else:
                is_unknown = names[0] not in self.tables
            if is_unknown:
                raise self.unknown(ctx, names)
            table = changes
            for name in names[:-1]:
                if not isinstance(table.get(name), dict):
                    table[name] = {}
                table = table[name]
            table[names[-1]] = value

    def unknown(self, ctx: click.Context, names: list[str]) -> click.BadParameter:
        """Return the exception for an unknown entry, with a suggestion."""
        from ...base.toml_validation import did_you_mean

        key = ".".join(names)
        entries = [*sorted(self.settings), *(self.tables or ())]
        same = [entry for entry in entries if entry.startswith(f"{names[0]}.")]
        valid = same or entries
        if len(valid) > self.MAX_LISTED:
            valid = list(dict.fromkeys(entry.partition(".")[0] for entry in entries))
        for parameter in ctx.command.params:
            if same and parameter.name == names[-1] and parameter.opts:
                return click.BadParameter(
                    f"{key} is an option; use {max(parameter.opts, key=len)}", ctx, self
                )
        hint = did_you_mean(key, entries) or did_you_mean(names[0], entries)
        return click.BadParameter(f"unknown entry {key}{hint}; use {', '.join(valid)}", ctx, self)


def given_settings() -> list[str]:
    """Return the fields of option groups that are given with ``--set``."""
    return list(click.get_current_context().meta.get(_SETTINGS, {}))


def is_set() -> bool:
    """Return whether an entry is given with ``--set``."""
    meta = click.get_current_context().meta
    return bool(meta.get(_SETTINGS) or meta.get(_CHANGES))


def parse_entry(text: str) -> tuple[list[str], Any]:
    """Parse ``TABLE.KEY=VALUE``; the value is None if it is empty.

    >>> parse_entry("lens.f_number=5.6"), parse_entry("mirror.mapping=equidistant")
    ((['lens', 'f_number'], 5.6), (['mirror', 'mapping'], 'equidistant'))
    >>> parse_entry("field.elevation_deg=[-20, 40]"), parse_entry("housing.rod=")
    ((['field', 'elevation_deg'], [-20, 40]), (['housing', 'rod'], None))
    >>> parse_entry("camera.level=5,-2.5")
    (['camera', 'level'], [5, -2.5])
    """
    key, equals, value = text.partition("=")
    names = [name.strip() for name in key.split(".")]
    if not equals or not all(re.fullmatch(r"[A-Za-z0-9_-]+", name) for name in names):
        raise click.BadParameter(
            f"must be TABLE.KEY=VALUE, such as lens.f_number=5.6; got {text[:60]!r}"
        )
    if not value.strip():
        return names, None
    for text in (value, f"[{value}]") if "," in value else (value,):
        try:
            parsed = parse_toml(f"value = {text}", key)
        except SpecError:
            continue
        return names, parsed["value"] if len(parsed) == 1 else value
    return names, value.strip()  # a word without quotes


def format_setting(value: Any) -> str:
    """Format the value of a setting as :func:`parse_entry` reads it.

    >>> format_setting((5.0, -2.5)), format_setting(True), format_setting("single")
    ('5,-2.5', 'true', 'single')
    """
    match value:
        case bool():
            return str(value).lower()
        case tuple():
            return ",".join(map(format_setting, value))
        case float():
            text = f"{value:.10g}"
            return text if float(text) == value else repr(value)
    return str(value)


def _tuples(value: Any) -> Any:
    return tuple(map(_tuples, value)) if isinstance(value, list) else value


def _set_option(function: Any) -> SetOption:
    """Return the option ``--set`` of a decorated function; it is added if there is none."""
    parameters = function.__dict__.setdefault("__click_params__", [])
    option = next((p for p in parameters if isinstance(p, SetOption)), None)
    if option is None:
        option = SetOption()
        parameters.append(option)
    return option


def _setting_of(command: click.Command, option_name: str) -> str:
    """Return the setting whose name is that of an unknown option, as ``--set TABLE.KEY=VALUE``."""
    name = option_name.lstrip("-").removeprefix("no-").replace("-", "_")
    keys = {
        field_name: key
        for parameter in command.params
        if isinstance(parameter, SetOption)
        for key, field_name in parameter.settings.items()
    }
    similar = difflib.get_close_matches(name, keys, 1, cutoff=0.9)
    return f"--set {keys[similar[0]]}=VALUE" if similar else ""


def file_entries(
    file: str, tables: Collection[str] | None, given_by: str | None = None
) -> Callable[[Command], Command]:
    """Add ``--set`` for entries of a file; the command receives the ``changes`` as nested tables.

    With ``tables`` None the command checks their names when it reads the file. ``given_by`` is the
    parameter that names the file, without which entries are refused.
    """

    def decorate(function: Command) -> Command:
        @wraps(function)
        def gathered(*args: Any, **values: Any) -> Any:
            context = click.get_current_context()
            changes = context.meta.get(_CHANGES, {})
            if given_by is not None and context.params.get(given_by) is None:
                for table, entries in changes.items():
                    names = [table, *entries] if isinstance(entries, dict) else [table]
                    raise parameter.unknown(context, names[:2])
            return function(*args, changes=changes, **values)

        parameter = _set_option(gathered)
        parameter.file, parameter.tables = file, tables
        return gathered  # type: ignore[return-value]  # keeps the signature of the command

    return decorate


# -- Value types of options; each parser serves as a click `type` ----------------------------------

MAX_VALUES = 1_000_000


def _plain_number(value: Any) -> Any:
    """Parse a number in plain notation; Python underscores and digits of other scripts are
    rejected.
    """
    if isinstance(value, str) and (not value.isascii() or "_" in value):
        raise click.BadParameter(f"must be a number; got {format_value(value)}")
    return value


class SensorName(click.types.StringParamType):
    """Sensor file or name of a bundled sensor, with shell completion."""

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        from ...optics.sensor_files import bundled_sensors

        named = [CompletionItem(name) for name in bundled_sensors() if name.startswith(incomplete)]
        return [*named, CompletionItem(incomplete, type="file")]


SENSOR = SensorName()


class Number(click.types.FloatParamType):
    """Number."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return super().convert(_plain_number(value), param, ctx)


class Integer(click.types.IntParamType):
    """Integer."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return super().convert(_plain_number(value), param, ctx)


class IntegerRange(click.IntRange):
    """Integer between two bounds."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        return super().convert(_plain_number(value), param, ctx)


NUMBER, INTEGER = Number(), Integer()


def values(text: str) -> NDArray[np.float64]:
    """Parse numbers as ``START:STOP:STEP`` (ends included), or as a comma-separated list.

    >>> values("0:135:45"), values("90, 104")
    (array([  0.,  45.,  90., 135.]), array([ 90., 104.]))
    """
    try:
        parts = [parse_float(p) for p in text.split(":" if ":" in text else ",")]
    except ValueError:
        raise click.BadParameter(
            f"must be a range START:STOP:STEP or a list of numbers; got {format_value(text)}"
        ) from None
    if not np.isfinite(parts).all():
        raise click.BadParameter(f"must be finite numbers; got {format_value(text)}")
    if ":" not in text:
        return np.array(parts)
    if len(parts) != 3:
        raise click.BadParameter(
            f"must be START:STOP:STEP, such as 0:135:5; got {format_value(text)}"
        )
    start, stop, step = parts
    if step <= 0 or stop < start:
        raise click.BadParameter(
            f"START must be at most STOP, and STEP above 0; got {format_value(text)}"
        )
    count = int(np.floor((stop - start) / step + 1e-9)) + 1
    if count > MAX_VALUES:
        raise click.BadParameter(
            f"must be at most {MAX_VALUES} numbers; {format_value(text)} contains {count}"
        )
    return start + step * np.arange(count, dtype=np.float64)


def pixel(text: str) -> tuple[float, float]:
    """Parse a pixel ``U,V``.

    >>> pixel("511.5,11.5")
    (511.5, 11.5)
    """
    u, v = _numbers(text, 2, ",", "a pixel U,V")
    return u, v


def angle(text: str) -> float:
    """Parse a finite angle in degrees.

    >>> angle("-12.5")
    -12.5
    """
    return _numbers(text, 1, ",", "an angle in degrees")[0]


def angle_range(text: str) -> tuple[float, float]:
    """Parse two angles in degrees, ``MIN:MAX`` or ``MIN,MAX``.

    >>> angle_range("-30:45")
    (-30.0, 45.0)
    """
    low, high = _numbers(text, 2, ",:", "a range MIN:MAX in degrees")
    return low, high


def ball(text: str) -> tuple[float, float, float, float]:
    """Parse the circle of a mirror ball (px) and its full field (deg), ``CX,CY,R,FOV``."""
    u, v, radius, field = _numbers(
        text, 4, ",", "CX,CY,R,FOV: centre, radius and field of the ball"
    )
    return u, v, radius, field


def image_size(text: str) -> tuple[int | None, int | None]:
    """Parse ``WxH`` in integer pixels; a missing side is chosen later.

    >>> image_size("1440x360"), image_size("x360")
    ((1440, 360), (None, 360))
    """
    match = re.fullmatch(r"([0-9]{0,6})x([0-9]{0,6})", text.strip().lower())
    if not match:
        raise click.BadParameter(
            f"must be a size in pixels, such as 1440x360, 1440x or x360; got {format_value(text)}"
        )
    width, height = (int(side) if side else None for side in match.groups())
    return width, height


def full_image_size(text: str) -> tuple[int, int]:
    """Parse width and height of an image, both required.

    >>> full_image_size("1024x768")
    (1024, 768)
    """
    width, height = image_size(text)
    if width is None or height is None:
        raise click.BadParameter(
            f"must contain width and height, such as 1024x768; got {format_value(text)}"
        )
    return width, height


def three_wavelengths(text: str) -> Any:
    """Parse the wavelengths of red, green and blue light, nm.

    >>> three_wavelengths("610,540,465")
    (610.0, 540.0, 465.0)
    """
    return tuple(_numbers(text, 3, ",", "three wavelengths R,G,B in nm, such as 610,540,465"))


def _numbers(text: str, count: int, separators: str, what: str) -> list[float]:
    """Parse a given number of finite values with one of the separators."""
    try:
        numbers = [parse_float(part) for part in re.split(f"[{separators}]", text)]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise click.BadParameter(f"must be {what}; got {format_value(text)}")
    return numbers


def number_or_range(text: str) -> float | tuple[float, float]:
    """Parse a number, or a range ``LOW:HIGH`` to choose from.

    >>> number_or_range("12"), number_or_range("10:14")
    (12.0, (10.0, 14.0))
    """
    try:
        numbers = [parse_float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not np.isfinite(numbers).all():
        raise click.BadParameter(f"must be a number or a range LOW:HIGH; got {format_value(text)}")
    return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])


def distance(text: str) -> float:
    """Parse a length in mm above 0, ``inf`` allowed.

    >>> distance("inf")
    inf
    """
    try:
        number = parse_float(text)
    except ValueError:
        number = float("nan")
    if not number > 0:
        raise click.BadParameter(
            f"must be a distance in mm above 0, or 'inf'; got {format_value(text)}"
        )
    return number


def height(text: str) -> float:
    """Parse a finite length in mm, negative values allowed.

    >>> height("-300")
    -300.0
    """
    return _numbers(text, 1, ",", "a height in mm")[0]


def height_range(text: str) -> tuple[float, float]:
    """Parse two heights in mm, ``LOW:HIGH`` or ``LOW,HIGH``.

    >>> height_range("-1200:1800")
    (-1200.0, 1800.0)
    """
    low, high = _numbers(text, 2, ",:", "a range LOW:HIGH in mm")
    return low, high


def pitch_roll(text: str) -> tuple[float, float]:
    """Parse pitch and roll in degrees, ``PITCH,ROLL``.

    >>> pitch_roll("24,-1.5")
    (24.0, -1.5)
    """
    pitch, roll = _numbers(text, 2, ",", "PITCH,ROLL in degrees")
    return pitch, roll


def offset(text: str) -> tuple[float, float, float]:
    """Parse a position in the world frame in mm, ``X,Y,Z``.

    >>> offset("0,0,-500")
    (0.0, 0.0, -500.0)
    """
    x, y, z = _numbers(text, 3, ",", "X,Y,Z in mm")
    return x, y, z


def factor(text: str) -> float:
    """Parse a factor above 0.

    >>> factor("2.5")
    2.5
    """
    (number,) = _numbers(text, 1, ",", "a factor above 0")
    if number <= 0:
        raise click.BadParameter(f"must be a factor above 0; got {format_value(text)}")
    return number


def part(text: str) -> tuple[int, int]:
    """Parse a part of an array job.

    >>> part("2/8")
    (2, 8)
    """
    try:
        i, n = (int(word) for word in text.split("/"))
    except ValueError:
        raise InvalidParameter(f"--part must be I/N, such as 2/8; got {text!r}") from None
    return i, n


def viewpoint(text: str) -> float | str:
    """Parse ``exact``, ``single``, or a height above the mirror vertex in mm.

    >>> viewpoint("single"), viewpoint("11.3")
    ('single', 11.3)
    """
    if text in ("exact", "single"):
        return text
    return _numbers(text, 1, ",", "'exact', 'single' or a height above the mirror vertex in mm")[0]


def focus(text: str) -> float | str:
    """Parse a focus distance in mm, or ``auto``."""
    if text == "auto":
        return text
    try:
        return parse_float(text)
    except ValueError:
        raise click.BadParameter(
            f"must be a distance in mm, or 'auto'; got {format_value(text)}"
        ) from None
