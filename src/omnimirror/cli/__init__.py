"""The command line: one module per command, imported when its command runs."""

from __future__ import annotations

import os
import sys
from importlib import import_module

import click

from .. import __version__
from ..errors import OmnimirrorError

COMMANDS = {
    "sensors": "List the sensors that come with omnimirror.",
    "init": "Write a commented sensor file to start from.",
    "design": "Design a sensor from requirements, optimise it, and say what conflicts.",
    "mappings": "List the mappings that a mirror can be generated for.",
    "evaluate": "Evaluate a sensor: mapping, viewpoints, virtual images, blur.",
    "export": "Write CAD files, lens files, tables and a drawing of a sensor.",
    "spots": "Spot diagrams by real rays through the whole aperture.",
    "psf": "Point-spread functions and encircled energy.",
    "mtf": "Tangential and sagittal MTF over the field.",
    "illumination": "Relative illumination over the field.",
    "compare": "Put up to six sensors side by side.",
    "simulate": "Take the picture that a sensor would take of a scene.",
    "dewarp": "Straighten a picture taken with a mirror or fisheye.",
    "view": "Look around in a picture, video or stream, in the browser.",
    "studio": "Open the workbench in the browser.",
    "apertures": "Find the F-number and focus with the least blur and diffraction.",
    "bracket": "Plan pictures at several focus distances, and merge them into a sharp one.",
    "parts": "Choose a lens and an imager that can be bought.",
    "reproduce": "Redraw the paper's figures and check its numbers.",
    "demo": "Evaluate, simulate and straighten, and write a report.",
}
"""Every command with its one line of help; the module of the same name holds ``command``."""


class LazyGroup(click.Group):
    """Imports a command's module only when the command is asked for, so that ``--help`` is instant."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = import_module(f".{cmd_name}", __name__).command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.group(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="omnimirror")
def app() -> None:
    """Omnidirectional mirror sensors: evaluate them, and straighten the pictures they take."""


def main(args: list[str] | None = None) -> None:
    """Entry point: every error a user can cause ends as one sentence and a non-zero exit code."""
    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # see omnimirror.frames.turned; commands have threads of their own
    try:
        app.main(args=args, prog_name="omnimirror", standalone_mode=False)
    except click.exceptions.Abort:
        _fail("stopped", 130)
    except click.UsageError as e:
        where = f" (see '{e.ctx.command_path} --help')" if e.ctx else ""
        _fail(f"{e.format_message().rstrip('.')}{where}", 2)
    except click.ClickException as e:
        _fail(e.format_message(), 1)
    except OmnimirrorError as e:
        _fail(str(e), 1)
    except BrokenPipeError:  # the reader (head, less) has seen enough
        sys.stderr.close()
        sys.exit(0)
    except OSError as e:
        _fail(f"{e.filename or 'the operating system'}: {e.strerror or e}", 1)


def _fail(sentence: str, code: int) -> None:
    click.echo(f"omnimirror: {sentence}", err=True)
    sys.exit(code)
