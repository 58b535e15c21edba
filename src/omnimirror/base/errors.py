"""Errors that a user can cause, each a ``ValueError`` that names the value and the valid range."""

import re

MAX_VALUE_CHARACTERS = 100
"""Maximum number of characters of a value in a message."""
MAX_MESSAGE_CHARACTERS = 1000
TAIL_CHARACTERS = 40  # characters kept from the end, which contains the name of a file
LONG_WORD = re.compile(rf"\S{{{MAX_VALUE_CHARACTERS + 1},}}")
LONG_QUOTE = re.compile(rf"(?<!\w)(['\"])([^'\"]{{{MAX_VALUE_CHARACTERS + 1},}})\1(?!\w)")


def abbreviate(text: str, max_characters: int = MAX_VALUE_CHARACTERS) -> str:
    """Return a value or a file name for a message: one line, abbreviated in the middle if it is
    long.

    >>> abbreviate("room\\n1.toml"), len(abbreviate("x" * 5000))
    ('room 1.toml', 100)
    """
    text = "".join(
        c if c.isprintable() or c.isspace() or "\udc80" <= c <= "\udcff" else repr(c)[1:-1]
        for c in text
    )
    text = " ".join(text.split())
    if len(text) <= max_characters:
        return text
    return f"{text[: max_characters - TAIL_CHARACTERS - 3]}...{text[-TAIL_CHARACTERS:]}"


def one_line(text: str) -> str:
    """Return a message as one line of limited length, for any names and values in it.

    >>> one_line("cannot read a\\nb.png: " + "7, " * 3 + "x" * 300)  # doctest: +ELLIPSIS
    'cannot read a b.png: 7, 7, 7, xxx...xxx'
    """
    text = abbreviate(text, len(text))
    text = LONG_WORD.sub(lambda word: abbreviate(word[0]), text)
    text = LONG_QUOTE.sub(lambda quote: quote[1] + abbreviate(quote[2]) + quote[1], text)
    return abbreviate(text, MAX_MESSAGE_CHARACTERS)


class OmnimirrorError(ValueError):
    """Base class of the errors of the package; the command line prints their message.

    Parameters
    ----------
    *message
        The message, which becomes one line of bounded length.

    Examples
    --------
    >>> import omnimirror as om
    >>> try:
    ...     om.load_sensor("no-such-sensor.toml")
    ... except om.OmnimirrorError as problem:
    ...     print(type(problem).__name__)
    SpecError
    """

    def __init__(self, *message: object) -> None:
        super().__init__(*(one_line(str(part)) for part in message))


class OmnimirrorWarning(UserWarning):
    """Category of all warnings of the package: readable input that contains contradictory numbers.

    The command line prints them; ``warnings.simplefilter("error", om.OmnimirrorWarning)`` raises
    them as exceptions.

    Parameters
    ----------
    *message
        The message, which becomes one line of bounded length.

    Examples
    --------
    >>> import warnings
    >>> import omnimirror as om
    >>> with warnings.catch_warnings(record=True) as caught:
    ...     warnings.simplefilter("always", om.OmnimirrorWarning)
    ...     camera = om.parse_camera("3 -100 0 2.5e-3 \\n 2 100 50 \\n 239.5 319.5 \\n 1 0 0 \\n 480 640")
    >>> [str(warning.message) for warning in caught]
    []
    """

    def __init__(self, *message: object) -> None:
        super().__init__(*(one_line(str(part)) for part in message))


class InvalidParameter(OmnimirrorError):
    """Parameter outside its range, or incompatible parameters."""


class OutsideMirror(OmnimirrorError):
    """Point outside the surface of the mirror."""


class OutsideField(OmnimirrorError):
    """Field angle, pixel or mirror position outside the field of the sensor."""


class NotOneToOne(OmnimirrorError):
    """Field angle that is not monotonic in the mirror radius and has no inverse."""


class SelfObstruction(OmnimirrorError):
    """Mirror that obscures part of itself for the lens or the scene."""


class SpecError(OmnimirrorError):
    """Invalid sensor file or requirements; the message contains location and valid values."""


class MediaError(OmnimirrorError):
    """Image or video that cannot be read or written."""


class ReproductionError(OmnimirrorError):
    """Number of the paper without its expected verdict; the message names the row."""


def extra_remedy(*extras: str) -> str:
    """Return the command that installs extras of the package, for messages.

    Examples
    --------
    >>> extra_remedy("video")
    "run pip install '.[video]' in the repository"
    """
    return f"run pip install '.[{','.join(extras)}]' in the repository"


OPENCV_REMEDY = "pip install --force-reinstall --no-deps opencv-python-headless"


def explain_import_error(error: ImportError | AttributeError) -> Exception:
    """Return an error with a remedy if OpenCV is missing or incomplete, and other errors unchanged.

    All OpenCV packages of PyPI install the same folder ``cv2``. Uninstalling one of several of them
    removes the files of the others, although these remain registered as installed. If other files
    remain in the folder, Python imports it as an empty namespace package.

    Examples
    --------
    >>> explain_import_error(ModuleNotFoundError("No module named 'cv2'", name="cv2"))
    OmnimirrorError("cannot import OpenCV (No module named 'cv2'), for example because ...
    """
    module = getattr(error.obj, "__name__", "") if isinstance(error, AttributeError) else error.name
    if (module or "").partition(".")[0] != "cv2":
        return error
    return OmnimirrorError(
        f"cannot import OpenCV ({error}), for example because another OpenCV package was "
        f"uninstalled, which removes the common files; reinstall it: {OPENCV_REMEDY}"
    )
