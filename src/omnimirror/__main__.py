"""Program ``omnimirror``, also available as ``python -m omnimirror``."""

import os
import sys


def run() -> None:
    """Run the command line as a separate program.

    Unlike :func:`omnimirror.apps.cli.main`, which restores the process state for its caller, it may
    configure the process.
    """
    # Must be set before NumPy is imported; see omnimirror.cameras.camera.rotate_vectors. Commands use their
    # own threads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        from .apps.cli import main

        main()
    except KeyboardInterrupt:  # during imports, or at exit
        sys.stderr.write("omnimirror: stopped\n")
        sys.exit(130)
    finally:
        # If Ctrl-C arrives while text is executed, as for each dataclass definition, `python -m`
        # ends with SIGINT instead of the exit code although the exception was handled. Another
        # execution of text resets this state.
        exec("")


if __name__ == "__main__":
    run()
