"""Messages of the loggers ``omnimirror.*``.

Modules report the steps of long functions with the level INFO on ``logging.getLogger(__name__)``,
and problems that affect results with the level WARNING, which Python prints by default.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

OnProgress = Callable[[int, int | None], None]
"""Callback ``on_progress(done, total)`` of long functions; total is None if unknown."""


class _Forwarder(logging.Handler):
    """Handler that passes the messages of one thread to a function."""

    def __init__(self, function: Callable[[str], None]) -> None:
        super().__init__(logging.INFO)
        self._function, self._thread = function, threading.get_ident()

    def emit(self, record: logging.LogRecord) -> None:
        if record.thread == self._thread and record.levelno == logging.INFO:
            self._function(record.getMessage())


@contextmanager
def forward_steps(function: Callable[[str], None], name: str = "omnimirror") -> Iterator[None]:
    """Forward the steps that a logger reports in this thread to a function.

    Parameters
    ----------
    function
        Receives the text of each message with the level INFO.
    name
        Name of the logger; loggers below it are included.

    Examples
    --------
    >>> with forward_steps(print, "omnimirror.example"):
    ...     logging.getLogger("omnimirror.example").info("start %d of %d", 1, 4)
    start 1 of 4
    """
    logger, handler = logging.getLogger(name), _Forwarder(function)
    level = logger.level
    logger.addHandler(handler)
    if logger.getEffectiveLevel() > logging.INFO:
        logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        logger.setLevel(level)
        logger.removeHandler(handler)


@contextmanager
def combine_steps(
    function: Callable[[str, float], None], name: str = "omnimirror"
) -> Iterator[OnProgress]:
    """Combine logged steps and progress into calls with the current step and completed fraction.

    Parameters
    ----------
    function
        Receives the latest step and the completed fraction; 0 if the total is unknown.
    name
        Name of the logger; loggers below it are included.

    Yields
    ------
    on_progress
        Callback for the long function.

    Examples
    --------
    >>> with combine_steps(print, "omnimirror.example") as on_progress:
    ...     logging.getLogger("omnimirror.example").info("Rendering")
    ...     on_progress(1, 4)
    Rendering 0.25
    """
    step = ""

    def on_step(text: str) -> None:
        nonlocal step
        step = text

    def on_progress(done: int, total: int | None) -> None:
        function(step, done / total if total else 0.0)

    with forward_steps(on_step, name):
        yield on_progress
