"""Value types of options shared by several commands; each parser serves as a click ``type``."""

from __future__ import annotations

import re
from typing import Any

import click
import numpy as np
from click.shell_completion import CompletionItem
from numpy.typing import NDArray

from ...base.arguments import format_value, parse_float
from ...base.errors import InvalidParameter

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
