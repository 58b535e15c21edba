"""Planes of coded video frames: arrangement, creation and validation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from ...base.errors import InvalidParameter
from ..contracts import Border, Image
from ..maps.halving import half

Siting: TypeAlias = Literal["left", "center", "topleft", "right", "top", "bottom"]
Planes: TypeAlias = tuple[Image, ...]
"""Planes (y, u, v) or (y, uv): (h, w), then (h/2, w/2) or (h/2, w/2, 2), rounded up; uint8 or
uint16. In 4:2:2 and 4:4:4 chroma is (h, w/2) and (h, w); an optional fourth plane (h, w) contains
the opacity.
"""

SITINGS: dict[str, tuple[float, float]] = {
    "left": (0.0, 0.5),
    "center": (0.5, 0.5),
    "topleft": (0.0, 0.0),
    "right": (1.0, 0.5),
    "top": (0.5, 0.0),
    "bottom": (0.5, 1.0),
}
"""Position of a chroma sample among its 2 x 2 luma pixels, right of and below the first one (ITU-T
H.273; "right" and "bottom" occur in rotated or mirrored frames).
"""


def check_planes(parts: Planes, size: tuple[int, int], bits: int) -> None:
    """Raise an error unless planes are a frame of the given (width, height).

    Raises
    ------
    InvalidParameter
        If planes are inconsistent, or have another depth.
    """
    check_shapes(parts, size)
    kinds = {part.dtype for part in parts}
    if len(kinds) != 1 or not kinds <= {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise InvalidParameter(f"planes hold {', '.join(sorted(map(str, kinds)))}; valid are uint8, or all uint16")
    low, high = (8, 8) if parts[0].dtype == np.uint8 else (9, 16)
    if not low <= bits <= high:
        raise InvalidParameter(f"bits = {bits} does not go with {parts[0].dtype} planes; valid are {low} to {high}")


def check_shapes(parts: Planes, size: tuple[int, int], like: Planes = ()) -> None:
    """Raise an error for planes that are not an image of a size, or are arranged differently from
    others.
    """
    (across, down), luma = half(size), (size[1], size[0])
    pairs: list[tuple[int, ...]] = [luma, (down, across, 2)]
    of_colours = {(2, 2): (down, across), (2, 1): (size[1], across), (1, 1): luma}
    three: dict[tuple[int, int], list[tuple[int, ...]]] = {by: [luma, c, c] for by, c in of_colours.items()}
    if not like:
        valid = [pairs, *three.values(), *([*part, luma] for part in three.values())]
    elif len(like) == 2:
        valid = [pairs]
    else:
        valid = [three[subsampling(like)] + [luma] * (len(like) - 3)]
    if [part.shape for part in parts] not in valid:
        found, wanted = ", ".join(str(part.shape) for part in parts), ", ".join(map(str, valid[0]))
        also = "" if like else f", or three, of which the last two are {', '.join(map(str, of_colours.values()))}"
        raise InvalidParameter(
            f"planes of shapes {found} are no picture of {size[0]} x {size[1]} px; valid are {wanted}{also}"
        )


def subsampling(parts: Planes) -> tuple[int, int]:
    """Return the number of pixels per chroma sample, across and down, in planes (y, u, v) or
    (y, uv).
    """
    (height, width), (down, across) = parts[0].shape[:2], parts[1].shape[:2]
    return (1 if across == width > 1 else 2), (1 if down == height > 1 else 2)


def border_of_planes(border: Border, full_range: bool, bits: int) -> tuple[float, float, float]:
    """Return the border as y, u and v, given in this form or as a full-range grey level.

    >>> border_of_planes(0, False, 8), border_of_planes(255, False, 8), border_of_planes(0, False, 10)
    ((16, 128, 128), (235, 128, 128), (64, 512, 512))

    Raises
    ------
    InvalidParameter
        If the border has another form.
    """
    if isinstance(border, Sequence):
        if len(border) != 3:
            raise InvalidParameter(f"border = {border} is no colour of a 4:2:0 frame; valid are a grey, or y, u and v")
        return border[0], border[1], border[2]
    most = (1 << bits) - 1
    if not 0 <= border <= most:
        raise InvalidParameter(f"border = {border} is no grey of {bits} bits; valid are 0 to {most}")
    y = border if full_range else (16 << (bits - 8)) + border * (219 << (bits - 8)) / most
    return round(y), 1 << (bits - 1), 1 << (bits - 1)


def empty_planes(like: Planes, size: tuple[int, int]) -> Planes:
    """Return uninitialised planes for an image of a size with the arrangement of given planes."""
    across, down = (-(-side // by) for side, by in zip(size, subsampling(like), strict=True))
    return tuple(
        np.empty((down, across, *part.shape[2:]) if i in (1, 2) else (size[1], size[0]), part.dtype)
        for i, part in enumerate(like)
    )
