"""Border of a view: a colour outside the field, or transparency."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from ...base.arguments import shown
from ...base.errors import InvalidParameter
from ...io.pictures.images import FULL
from ..contracts import Border, Image

LARGEST_VALUE = 1e30  # maximum magnitude of a colour


def check_border(border: Border) -> None:
    """Raise an error unless the border is a number or a sequence of numbers."""
    try:
        values = np.array(border, object)
    except ValueError:
        values = np.empty((0, 0), object)
    if values.ndim > 1 or not all(_is_value(value) for value in values.flat):
        raise InvalidParameter(f"border = {shown(border)} is no colour; valid are a number, or one for every channel")


def _is_value(value: Any) -> bool:
    if not isinstance(value, int | float | np.integer | np.floating):
        return False
    size: Any = abs(value)
    return not size > LARGEST_VALUE  # NaN is valid in floating-point images


def border_values(border: Border, image: Image) -> tuple[float, ...]:
    """Return the border value of each image channel; raise an error for invalid values."""
    check_border(border)
    channels = image.shape[2] if image.ndim == 3 else 1
    values = np.array(border, float)
    if values.ndim and len(values) != channels:
        raise InvalidParameter(
            f"border = {border} has {len(values)} values, and the picture {channels} channels; "
            "a single number stands for all of them"
        )
    full = FULL[image.dtype.name]
    if image.dtype.kind == "u" and not ((values >= 0) & (values <= full) & (values % 1 == 0)).all():
        raise InvalidParameter(
            f"border = {border} is no value of a picture of {image.dtype.name}; "
            f"valid are whole numbers from 0 to {full}"
        )
    return tuple(np.broadcast_to(values, channels).tolist())


def clear_border(border: Border, image: Image) -> tuple[float, ...]:
    """Return the border of an image with an alpha channel: a colour for programs that ignore alpha,
    and 0.
    """
    values = border_values(border, image)
    colours = values[:3] if len(values) > 1 else values * 3
    return (*colours, 0.0)


def with_alpha(image: Image) -> Image:
    """Return the image with four channels, opaque unless it has an alpha channel."""
    channels = image.shape[2:]
    if channels == (4,):
        return image
    rgb = image if channels == (3,) else cv2.cvtColor(image, cv2.COLOR_GRAY2RGB)
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2RGBA))
