"""The program ``omnimirror``, also as ``python -m omnimirror``."""

import os
import sys


def run() -> None:
    """Run the command line as a program of its own.

    Unlike :func:`omnimirror.apps.cli.main`, which restores the process for its caller, it may configure the process.
    """
    # Before NumPy reads it; see omnimirror.cameras.frames.turned. Commands have threads of their own.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from .apps.cli import main

        main()
    except KeyboardInterrupt:  # while modules are imported, or at the very end
        sys.stderr.write("omnimirror: stopped\n")
        sys.exit(130)
    finally:
        # `python -m` ends itself by SIGINT, without the exit code, if Ctrl-C came while text was executed, as for every
        # dataclass that is defined, although the exception was handled. Executing text once more resets this.
        exec("")


if __name__ == "__main__":
    run()
