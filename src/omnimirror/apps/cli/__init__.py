"""Command-line interface: one module per command, imported when its command runs."""

from __future__ import annotations

import difflib
import os
import re
import sys
import time
import traceback
from contextlib import suppress
from importlib import import_module
from typing import Any

import click

from ... import __version__
from ...base.errors import InvalidParameter, OmnimirrorError, explain_import_error, one_line
from ._process_state import (
    QUIET,
    Terminated,
    discard_output,
    interrupted_exit_code,
    process_state,
)

COMMANDS = {
    "sensors": "List the bundled sensors.",
    "init": "Write a commented sensor file as a template.",
    "schema": "Write the JSON Schema of sensor files and other TOML files.",
    "design": "Design a sensor from requirements; report margins and relaxations.",
    "check": "Check a sensor against requirements and report the margins.",
    "mappings": "List the mappings that a mirror can be designed for.",
    "evaluate": "Evaluate a sensor: mapping, viewpoints, virtual images, blur.",
    "export": "Export CAD files, lens files, tables and drawings of a sensor.",
    "rays": "Write a ray table for Blender, Mitsuba and other renderers.",
    "maps": "Write a view map for compositors, OpenCV, FFmpeg, shaders and boards.",
    "colmap": "Dewarp images to a COLMAP project with rig and masks.",
    "spots": "Compute spot diagrams with real rays through the whole aperture.",
    "psf": "Compute point-spread functions and encircled energy.",
    "mtf": "Compute the tangential and sagittal MTF over the field.",
    "illumination": "Compute the relative illumination over the field.",
    "form": "Analyse the form error of a manufactured mirror from measured points.",
    "compare": "Compare up to six sensors.",
    "simulate": "Render the images that a sensor would capture of a scene.",
    "dewarp": "Dewarp (undistort) images and videos of a mirror or fisheye camera.",
    "probe": "Convert images of a mirror ball to an HDR light probe.",
    "batch": "Dewarp, restore or render image archives, on one machine or a cluster.",
    "view": "View an image, video or stream in the browser.",
    "studio": "Start the studio: view images and design sensors in the browser.",
    "serve": "Serve views of a camera or stream as network cameras.",
    "board": "Write a calibration target for printing.",
    "calibrate": "Calibrate a camera from images of a target.",
    "rim": "Detect the outline of the mirror in images.",
    "lines": "Refine and level a camera from straight edges, without a target.",
    "uncertainty": "Estimate the uncertainty of directions measured with a calibrated camera.",
    "measure": "Measure angles and distances in an image, with uncertainty.",
    "convert": "Convert a camera model between file formats.",
    "apertures": "Find the F-number and focus with minimum blur and diffraction.",
    "bracket": "Plan a focus bracket, and merge its images.",
    "tolerance": "Run a tolerance analysis and predict the manufacturing yield.",
    "parts": "Select off-the-shelf lenses and imagers for a mirror.",
    "reproduce": "Reproduce the figures and numbers of the paper.",
    "demo": "Evaluate, simulate and dewarp a sensor, and write a report.",
}
"""Summary of each command for ``--help``; the module of the same name in
:mod:`omnimirror.apps.cli.commands` defines ``command``."""
SERVERS = {"serve", "studio", "view"}
"""Commands whose own messages, and those of their processes, pass unchanged to standard error."""


class LazyGroup(click.Group):
    """Command group that imports the module of a command only on use, for a fast ``--help``."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f".commands.{cmd_name}", __name__).command
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        if args[0] not in COMMANDS and not args[0].startswith("-"):
            close = difflib.get_close_matches(args[0], COMMANDS, 1, 0.5)
            hint = f"did you mean {close[0]}?" if close else f"available: {', '.join(COMMANDS)}"
            raise click.UsageError(f"unknown command {args[0]!r}; {hint}", ctx)
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        try:
            return super().invoke(ctx)
        except BrokenPipeError:  # without errno, for which click would exit with code 1
            raise BrokenPipeError("the reader closed the pipe") from None
        except Terminated as e:  # no ^C on the terminal line
            raise click.exceptions.Abort from e

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # Three rows instead of five, so that all commands fit on a screen
        rows = [
            ("-h, --help, --version", "Show this message, or the version, and exit."),
            ("--quiet", "Print warnings and errors only (all commands)."),
            (
                "--verbose, --debug",
                "Print timings and versions, or the traceback of errors (all commands).",
            ),
        ]
        with formatter.section("Options"):
            formatter.write_dl(rows)
        self.format_commands(ctx, formatter)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


def _set_quiet(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    """Apply ``--quiet``: omit tables, text and progress bars; keep files, warnings and errors."""
    ctx.meta[QUIET] = value


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(__version__, prog_name="omnimirror")
@click.option(
    "--quiet",
    is_flag=True,
    expose_value=False,
    callback=_set_quiet,
    is_eager=True,
    help="Print warnings and errors only.",
)
@click.option(
    "--verbose", is_flag=True, expose_value=False, help="Print timings, versions and the backend."
)
@click.option("--debug", is_flag=True, expose_value=False, help="Print the traceback of errors.")
def app() -> None:
    """Design, evaluate, simulate and calibrate omnidirectional sensors, and dewarp images."""


def main(args: list[str] | None = None) -> None:
    """Run a command; report every error as one sentence on standard error and a non-zero exit code.

    Signal handlers, environment, warning filters and streams of the process are restored.

    Parameters
    ----------
    args
        Arguments of the command line; ``sys.argv`` by default.

    Raises
    ------
    SystemExit
        If the command fails, or a signal stops it.
    """
    start = time.perf_counter()
    is_debugged, is_verbose, arguments = _split_global_options(
        list(sys.argv[1:] if args is None else args)
    )
    is_server = bool(SERVERS & set(arguments))
    with process_state(is_quiet=not is_debugged and not is_server):
        _run(arguments, is_debugged, is_verbose, start)


def _run(arguments: list[str], is_debugged: bool, is_verbose: bool, start: float) -> None:
    try:
        _check_encoding(arguments)
        app.main(args=arguments, prog_name="omnimirror", standalone_mode=False)
        sys.stdout.flush()
        if is_verbose:
            click.echo(_format_run_time(time.perf_counter() - start), err=True)
    except KeyboardInterrupt:  # before the command started, or after its end
        _print_error("stopped")
        sys.exit(interrupted_exit_code())
    except BrokenPipeError:  # the reader (head, less) closed the pipe
        discard_output()
        sys.exit(0)
    except Exception as e:
        if is_debugged:
            traceback.print_exc()
        if type(e).__name__ == "NoArgsIsHelpError":
            click.echo(str(e), err=True)
            sys.exit(2)
        message, code = error_message(e)
        _print_error(one_line(message))
        sys.exit(code)


def _check_encoding(arguments: list[str]) -> None:
    """Reject lone surrogates, which no file name on POSIX contains; os.stat() raises an exception."""
    for text in arguments:
        try:
            os.fsencode(text)
        except UnicodeEncodeError:
            raise click.UsageError(f"arguments must be valid text; got {text!a}") from None


def _print_error(message: str) -> None:
    with suppress(OSError):  # SIGHUP: the terminal is closed
        click.echo(f"omnimirror: {message}", err=True)


def _split_global_options(arguments: list[str]) -> tuple[bool, bool, list[str]]:
    """Split off global options: return ``--debug``, ``--verbose`` and the other arguments, ``--quiet``
    first.
    """
    end = arguments.index("--") if "--" in arguments else len(arguments)
    options, rest = arguments[:end], arguments[end:]
    is_given = [name in options for name in ("--debug", "--verbose", "--quiet")]
    remaining = [word for word in options if word not in ("--debug", "--verbose", "--quiet")]
    return is_given[0], is_given[1], ["--quiet"] * is_given[2] + remaining + rest


def _format_run_time(seconds: float) -> str:
    """Format the run time, the versions and the backend for a bug report."""
    import platform

    import numpy as np

    from ...base.native import backend

    by = f"omnimirror {__version__}, Python {platform.python_version()}, NumPy {np.__version__}"
    return f"{seconds:.2f} s, {time.process_time():.2f} s of processor time; {by}, samplers: {backend.name}"


def _is_interruption(error: BaseException) -> bool:
    """Return whether a signal caused an error.

    The interpreter wraps KeyboardInterrupt around ``__set_name__``, and C extensions convert it to
    ImportError.
    """
    chain: list[BaseException] = [error]
    for link in chain:
        if isinstance(link, KeyboardInterrupt):
            return True
        chain += [e for e in (link.__cause__, link.__context__) if e is not None and e not in chain]
    return False


def error_message(error: Exception) -> tuple[str, int]:
    """Return the message and the exit code of an error: 2 for wrong usage, 1 for other known
    errors.
    """
    if isinstance(error, click.exceptions.Abort) or _is_interruption(error):
        return "stopped", interrupted_exit_code()
    match error:
        case click.UsageError():
            where = f" (see '{error.ctx.command_path} --help')" if error.ctx else ""
            return f"{error.format_message().rstrip('.')}{where}", 2
        case click.ClickException():
            return error.format_message(), 1
        case InvalidParameter():
            return str(error), 2
        case OmnimirrorError():
            return str(error), 1
        case OSError():
            return f"{error.filename or 'the operating system'}: {error.strerror or error}", 1
        case MemoryError():
            return "not enough memory", 1
        case ImportError() | AttributeError() if isinstance(
            explain_import_error(error), OmnimirrorError
        ):
            return str(explain_import_error(error)), 1
        case UnicodeEncodeError() if re.search("[\udc80-\udcff]", error.object):
            return f"the name {error.object!r} must be UTF-8", 1
        case _:
            what = f"{type(error).__name__}: {error}".rstrip(": ")
            return f"internal error: {what}; use --debug for the traceback", 70
