"""The errors a user can cause, each a ``ValueError`` that names the value and what would be valid."""

import re

LONGEST_VALUE = 100
"""Characters of a value that a message repeats."""
LONGEST_SENTENCE = 1000
TAIL = 40  # characters kept of the end, where the name of a file stands
LONG_WORD = re.compile(rf"\S{{{LONGEST_VALUE + 1},}}")
LONG_QUOTE = re.compile(rf"(?<!\w)(['\"])([^'\"]{{{LONGEST_VALUE + 1},}})\1(?!\w)")


def shortened(text: str, most: int = LONGEST_VALUE) -> str:
    """A value or the name of a file as a message repeats it: one line, without its middle where it is long.

    >>> shortened("room\\n1.toml"), len(shortened("x" * 5000))
    ('room 1.toml', 100)
    """
    text = "".join(c if c.isprintable() or c.isspace() or "\udc80" <= c <= "\udcff" else repr(c)[1:-1] for c in text)
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - TAIL - 2]}..{text[-TAIL:]}"


def one_line(text: str) -> str:
    """A message as one line of bearable length, whatever stands in the names and values it holds.

    >>> one_line("cannot read a\\nb.png: " + "7, " * 3 + "x" * 300)  # doctest: +ELLIPSIS
    'cannot read a b.png: 7, 7, 7, xxx...xxx..xxx...xxx'
    """
    text = shortened(text, len(text))
    text = LONG_WORD.sub(lambda word: shortened(word[0]), text)
    text = LONG_QUOTE.sub(lambda quote: quote[1] + shortened(quote[2]) + quote[1], text)
    return shortened(text, LONGEST_SENTENCE)


class OmnimirrorError(ValueError):
    """Base class of all errors that the package raises on purpose; the command line prints their message.

    Parameters
    ----------
    *sentence
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

    def __init__(self, *sentence: object) -> None:
        super().__init__(*(one_line(str(part)) for part in sentence))


class OmnimirrorWarning(UserWarning):
    """A file is read although its numbers contradict each other; the command line prints the message."""


class InvalidParameter(OmnimirrorError):
    """A parameter is outside its range, or parameters do not fit each other."""


class OutsideMirror(OmnimirrorError):
    """A point was asked for where the mirror has no surface."""


class OutsideField(OmnimirrorError):
    """A field angle, pixel or mirror position lies outside what the sensor sees."""


class NotOneToOne(OmnimirrorError):
    """The field angle does not grow steadily with the mirror radius, so it has no inverse."""


class SelfObstruction(OmnimirrorError):
    """The mirror hides part of itself from the lens or from the scene."""


class SpecError(OmnimirrorError):
    """A sensor file or requirements are wrong; the message says where and what would be valid."""


class MediaError(OmnimirrorError):
    """A picture cannot be read or written."""


class NotReproduced(OmnimirrorError):
    """A number of the paper does not get the verdict that is known to be right; the message names the row."""


OPENCV_REMEDY = "pip install --force-reinstall --no-deps opencv-python-headless"


def explained_import_error(error: ImportError) -> Exception:
    """Return an error with a remedy if OpenCV cannot be imported, and other errors unchanged.

    All OpenCV packages of PyPI install the same folder ``cv2``. Uninstalling one of several of them
    removes the files of the others, although these remain registered as installed.

    Examples
    --------
    >>> explained_import_error(ModuleNotFoundError("No module named 'cv2'", name="cv2"))
    OmnimirrorError("OpenCV cannot be imported (No module named 'cv2'), for example because ...
    """
    if (error.name or "").partition(".")[0] != "cv2":
        return error
    return OmnimirrorError(
        f"OpenCV cannot be imported ({error}), for example because another OpenCV package was "
        f"uninstalled, which removes the common files; reinstall it: {OPENCV_REMEDY}"
    )
