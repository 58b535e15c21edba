"""Output of commands: printed text and files; with ``-`` for standard output, text goes to standard
error.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from ...base.escaping import terminal_text
from ...base.files import is_same_file, is_standard_output
from ...base.logs import OnProgress
from ...base.quantities import QUANTITIES
from ._process_state import QUIET

if TYPE_CHECKING:
    from rich.progress import Progress, ProgressColumn

RATE_AVERAGING_S = 5.0
FIGURES = ("png", "svg", "pdf")
IMAGE_FORMATS = ("png", "jpg", "tif", "webp", "bmp", "hdr", "exr")
F = TypeVar("F", bound=Callable[..., Any])
_RESERVED, _FORMAT = "omnimirror.standard-output", "omnimirror.format"


class Output(click.Path):
    """Output file, or ``-`` for standard output, with a format such as ``svg:-``.

    Parameters
    ----------
    formats
        Binary formats for standard output; the first is that of ``-``.
    """

    def __init__(self, formats: tuple[str, ...] = ()) -> None:
        super().__init__(path_type=Path)
        self.formats = formats

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        path = super().convert(value, param, ctx)
        if not str(value):
            self.fail("the file name must not be empty", param, ctx)
        text = str(path)
        match = re.fullmatch(r"(\w+):-", text)
        if match and match[1] not in self.formats:
            valid = ", ".join(["-", *(f"{kind}:-" for kind in self.formats)])
            self.fail(f"standard output must be {valid}; got {text}", param, ctx)
        if ctx is None or not (match or text in ("-", "/dev/stdout")):
            return path
        option = max(param.opts, key=len) if param else "an output"
        if match:
            return take_standard_output(option, match[1], ctx=ctx)
        kind = ctx.meta.get(_FORMAT, self.formats[0]) if self.formats and text == "-" else ""
        return take_standard_output(option, kind, Path(text), ctx)


def take_standard_output(
    option: str, kind: str, path: Path = Path("-"), ctx: click.Context | None = None
) -> Path:
    """Reserve standard output for one output; return the name for an image of this kind.

    Raises
    ------
    click.UsageError
        If standard output is already reserved, or it is a terminal and the output an image.
    """
    meta = (ctx or click.get_current_context()).meta
    if meta.setdefault(_RESERVED, option) != option:
        raise click.UsageError(
            f"{meta[_RESERVED]} and {option} must not both be written to standard output"
        )
    if kind and kind != "csv" and sys.stdout.isatty():
        raise click.UsageError(
            "an image cannot be written to a terminal; redirect it to a file or another program"
        )
    return path.with_suffix(f".{kind}") if kind else path


def check_output_files(ctx: click.Context) -> None:
    """Raise an error for two outputs in one file, or for an output that overwrites an input.

    Raises
    ------
    click.UsageError
        If a file would be written twice, or an input overwritten.
    """
    written: dict[Path, str] = {}
    read: list[Path] = []
    for parameter in ctx.command.get_params(ctx):
        paths = _paths(ctx.params.get(parameter.name or ""))
        if not isinstance(parameter.type, Output):
            read += paths
            continue
        name = (
            parameter.opts[0]
            if isinstance(parameter, click.Argument)
            else max(parameter.opts, key=len)
        )
        for path in paths:
            if os.path.exists(path) and not os.path.isfile(path):  # devices and pipes
                continue
            if written.setdefault(path.absolute(), name) != name:
                raise click.UsageError(
                    f"{written[path.absolute()]} and {name} must not both be written to {path}"
                )
    for path, name in written.items():
        if os.path.isfile(path) and any(
            os.path.isfile(other) and is_same_file(path, other) for other in read
        ):
            raise click.UsageError(
                f"{name} must not overwrite the input {path.name}; specify another file"
            )


def _paths(value: Any) -> list[Path]:
    """Return possible file names among the values of an option or argument: any text, as for
    ``os.path``.
    """
    if isinstance(value, tuple | list):
        return [path for part in value for path in _paths(part)]
    return [Path(value)] if isinstance(value, str | Path) else []


def write_standard_output_as(kind: str) -> None:
    """Set the format of ``-``."""
    click.get_current_context().meta[_FORMAT] = kind


def output_option(*names: str, formats: tuple[str, ...] = (), **more: Any) -> Callable[[F], F]:
    """Return an option for an output file."""
    return click.option(*names, type=Output(formats), **more)


def json_option(help: str = "Write the table.") -> Callable[[F], F]:
    """Return the option ``--json`` for machine-readable numbers."""
    return output_option("--json", "json_file", help=help)


def is_standard_output_used() -> bool:
    """Return whether a file is written to standard output and text must go elsewhere."""
    context = click.get_current_context(silent=True)
    return context is not None and _RESERVED in context.meta


class Terminal(Console):
    """Console that leaves a closed pipe to the application."""

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def render_str(self, text: str, **options: Any) -> Text:
        """Render a string, such as a cell of a table, without control sequences."""
        return super().render_str(terminal_text(text), **options)


def is_quiet() -> bool:
    """Return whether only warnings and errors are printed."""
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(QUIET))


def output_console() -> Console:
    """Return the console: of normal width on a terminal, without wrapping for pipes and files.

    Text is printed without markup, including names with brackets or colons; styles are
    :class:`rich.text.Text`.
    """
    stream = sys.stderr if is_standard_output_used() else sys.stdout
    width = None if stream.isatty() else 200
    return Terminal(
        file=stream, width=width, markup=False, emoji=False, highlight=False, quiet=is_quiet()
    )


def print_line(*parts: str | tuple[str, str], console: Console | None = None) -> None:
    """Print a line without wrapping, parts of it styled: ``print_line("Wrote ", ("a.csv", "bold"))``."""
    plain = [
        terminal_text(part) if isinstance(part, str) else (terminal_text(part[0]), part[1])
        for part in parts
    ]
    (console or output_console()).print(Text.assemble(*plain), soft_wrap=True)


def print_remark(text: str) -> None:
    """Print a remark on standard error, unless ``--quiet`` is given."""
    if not is_quiet():
        click.echo(terminal_text(text), err=True)


def print_written(*paths: Path | None, console: Console | None = None) -> None:
    """Print the names of written files, except streams and outputs that were not requested."""
    for path in paths:
        if path and not is_standard_output(path):
            print_line("Wrote ", (str(path), "bold"), console=console)


def column_head(name: str, unit: str | None = None) -> str:
    """Return the head of a column: title above unit.

    >>> column_head("omega_deg"), column_head("filled", "%")
    ('Ω\\ndeg', 'unvignetted\\n%')
    """
    q = QUANTITIES[name]
    return f"{q.heading}\n{q.unit if unit is None else unit}"


def plain_table(*heads: str, text_columns: Collection[str] = (), tight: bool = False) -> Table:
    """Return a table without lines: right-aligned numbers, left-aligned text, no wrapped numbers or
    first column.
    """
    table = Table(box=None, pad_edge=False, header_style="bold", collapse_padding=tight)
    for i, heading in enumerate(heads):
        is_text = heading in text_columns
        table.add_column(
            heading, justify="left" if is_text else "right", no_wrap=i == 0 or not is_text
        )
    return table


def print_rows(
    console: Console, headings: Iterable[Iterable[str]], columns: Iterable[list[str]]
) -> None:
    """Print columns of numbers under multi-line headings, each row immediately after its
    computation.

    The output is that of a plain :class:`rich.table.Table` with right-aligned columns, for any
    number of rows.
    """
    lines, cells = [list(heading) for heading in headings], list(columns)
    widths = [
        max(map(len, (*heading, *column))) for heading, column in zip(lines, cells, strict=True)
    ]
    for line in zip(*lines, strict=True):
        row = " ".join(word.rjust(width) for word, width in zip(line, widths, strict=True))
        console.print(Text(row, style="bold"), soft_wrap=True)
    if console.quiet:
        return
    stream = console.file
    for numbers in zip(*cells, strict=True):
        stream.write(
            " ".join(word.rjust(width) for word, width in zip(numbers, widths, strict=True)) + "\n"
        )
    stream.flush()


def print_notice(message: object) -> None:
    """Print a status message on standard error, even with ``--quiet``."""
    click.echo(f"omnimirror: {terminal_text(str(message))}", err=True)


@contextmanager
def frame_rate_bar() -> Iterator[OnProgress]:
    """Show a progress bar of frames and frame rate on terminals, and yield its update function."""
    from rich.progress import MofNCompleteColumn, TextColumn

    column = TextColumn("{task.fields[rate]:.0f} frames/s")
    with _counting_bar("Dewarping", MofNCompleteColumn(), column) as bar:
        task = bar.add_task("", total=None, rate=0.0)
        recent = deque([(time.monotonic(), 0)])

        def update(done: int, total: int | None) -> None:
            recent.append((time.monotonic(), done))
            while len(recent) > 2 and recent[-1][0] - recent[0][0] > RATE_AVERAGING_S:
                recent.popleft()
            (start, first), (end, last) = recent[0], recent[-1]
            rate = (last - first) / max(end - start, 1e-9)
            bar.update(task, completed=done, total=total, rate=rate)

        yield update


@contextmanager
def count_bar(
    activity: str, count: ProgressColumn | None = None
) -> Iterator[Callable[[int, int], None]]:
    """Show a progress bar on terminals and yield its update function of (done, total).

    Parameters
    ----------
    activity
        Text before the bar.
    count
        Column after the bar; a percentage by default.
    """
    from rich.progress import TextColumn

    with _counting_bar(activity, count or TextColumn("{task.percentage:.0f} %")) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)


def _counting_bar(activity: str, *columns: ProgressColumn) -> Progress:
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True, quiet=is_quiet())
    return Progress(
        TextColumn(activity, markup=False),
        BarColumn(),
        *columns,
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


def progress_bar(console: Console) -> Progress:
    """Return a transient progress bar with a description, for terminals only."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TimeElapsedColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )
