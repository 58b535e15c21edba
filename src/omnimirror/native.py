"""The compiled samplers, if they are there: whether, which instructions, how many threads.

The environment variable ``OMNIMIRROR_NATIVE`` set to ``0`` leaves them alone; set to ``plain``, ``avx2`` or
``neon`` it chooses their instructions instead of the machine's best.
"""

from __future__ import annotations

import logging
import os
from functools import cache
from importlib import import_module
from types import ModuleType

import cv2

from .errors import InvalidParameter

MOST_THREADS = 1024


@cache
def compiled() -> ModuleType | None:
    """The compiled module, or None where it was not built or is not wanted. Asked once.

    Where it was not built, the log says so once: pictures come out the same, several times slower.
    """
    wanted = os.environ.get("OMNIMIRROR_NATIVE", "")
    if wanted == "0":
        return None
    try:
        _native = import_module("omnimirror._native")  # by name: the package as a whole is above this room
    except ImportError as e:
        log = logging.getLogger("omnimirror")
        log.warning(
            "the compiled samplers are missing: pictures are straightened by OpenCV, several times slower; "
            "to have them, install omnimirror where a C++20 compiler works"
        )
        log.info("%s", e)
        return None
    if wanted:
        try:
            _native.use_instructions(wanted)
        except ValueError:
            raise InvalidParameter(f"OMNIMIRROR_NATIVE = {wanted!r} names no instructions of this machine") from None
    return _native


def sampler() -> str:
    """Who samples: ``"avx2"``, ``"neon"`` or ``"plain"`` of the compiled samplers, or ``"opencv"``."""
    module = compiled()
    return "opencv" if module is None else str(module.instructions())


def set_threads(count: int) -> None:
    """Sample on so many threads, the caller's among them; they sleep between pictures.

    Raises
    ------
    InvalidParameter
        Unless from 1 to 1024.
    """
    if not 1 <= count <= MOST_THREADS:
        raise InvalidParameter(f"{count} threads are not valid; valid are 1 to {MOST_THREADS}")
    module = compiled()
    if module is None:
        cv2.setNumThreads(count)
    else:
        module.set_threads(count)


def threads() -> int:
    """How many threads sample: at first, as many as the process may use cores."""
    module = compiled()
    return int(cv2.getNumThreads() if module is None else module.get_threads())
