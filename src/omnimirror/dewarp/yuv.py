"""Dewarping of video frames by planes in their coded format (planar YUV and NV12)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, TypeAlias

import numpy as np

from ..base.errors import InvalidParameter
from .interfaces import Border, Image, Interpolation, Map
from .maps import half
from .sampling import remap

# -- Planes of coded video frames ------------------------------------------------------------------

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
        raise InvalidParameter(
            f"planes must be all uint8 or all uint16; got {', '.join(sorted(map(str, kinds)))}"
        )
    low, high = (8, 8) if parts[0].dtype == np.uint8 else (9, 16)
    if not low <= bits <= high:
        raise InvalidParameter(
            f"bits must be between {low} and {high} for {parts[0].dtype} planes; got {bits}"
        )


def check_shapes(parts: Planes, size: tuple[int, int], like: Planes = ()) -> None:
    """Raise an error for planes that are not an image of a size, or are arranged differently from
    others.
    """
    (across, down), luma = half(size), (size[1], size[0])
    pairs: list[tuple[int, ...]] = [luma, (down, across, 2)]
    chroma_shapes = {(2, 2): (down, across), (2, 1): (size[1], across), (1, 1): luma}
    three: dict[tuple[int, int], list[tuple[int, ...]]] = {
        by: [luma, c, c] for by, c in chroma_shapes.items()
    }
    if not like:
        valid = [pairs, *three.values(), *([*part, luma] for part in three.values())]
    elif len(like) == 2:
        valid = [pairs]
    else:
        valid = [three[subsampling(like)] + [luma] * (len(like) - 3)]
    if [part.shape for part in parts] not in valid:
        shapes, expected = (
            ", ".join(str(part.shape) for part in parts),
            ", ".join(map(str, valid[0])),
        )
        opacity_shape = (
            ""
            if like
            else f", or three planes with chroma of {', '.join(map(str, chroma_shapes.values()))}"
        )
        raise InvalidParameter(
            f"planes must have the shapes {expected}{opacity_shape} for {size[0]} x {size[1]} px; got {shapes}"
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
            raise InvalidParameter(
                f"border must be a grey level or (y, u, v) for a 4:2:0 frame; got {border}"
            )
        return border[0], border[1], border[2]
    white = (1 << bits) - 1
    if not 0 <= border <= white:
        raise InvalidParameter(
            f"border must be between 0 and {white} for {bits} bits; got {border}"
        )
    y = border if full_range else (16 << (bits - 8)) + border * (219 << (bits - 8)) / white
    return round(y), 1 << (bits - 1), 1 << (bits - 1)


def empty_planes(like: Planes, size: tuple[int, int]) -> Planes:
    """Return uninitialised planes for an image of a size with the arrangement of given planes."""
    across, down = (-(-side // by) for side, by in zip(size, subsampling(like), strict=True))
    return tuple(
        np.empty((down, across, *part.shape[2:]) if i in (1, 2) else (size[1], size[0]), part.dtype)
        for i, part in enumerate(like)
    )


# -- Dewarping by planes ---------------------------------------------------------------------------
#
# In 4:2:0 a chroma sample belongs to 2 x 2 luma pixels at a position given by the siting; its map is
# that of luma, :meth:`halved <omnimirror.dewarp.interfaces.Map.halved>`.


def remap_planes(
    parts: Planes,
    luma: Map,
    chroma: Map,
    interpolation: Interpolation,
    out: Planes,
    border: tuple[float, float, float],
) -> Planes:
    """Fill the planes ``out`` from the 4:2:0 planes ``parts``; outside the field with the border as
    y, u and v.
    """
    y, u, v = border
    borders: tuple[Border, ...] = (y, u, v) if len(parts) == 3 else (y, (u, v))
    for i, (part, target, value) in enumerate(zip(parts, out, borders, strict=True)):
        remap(part, chroma if i else luma, interpolation, target, value)
    return out


def remap_whole_planes(
    parts: Planes,
    luma: Map,
    sitings: tuple[Siting, Siting],
    interpolation: Interpolation,
    out: Planes,
    border: tuple[float, float, float],
) -> Planes:
    """Fill the planes ``out`` from the 4:2:2 or 4:4:4 planes ``parts``, all with the map of luma.

    4:2:2 chroma is interpolated between columns first, and averaged to every second column of the
    view.
    """
    remap(parts[0], luma, interpolation, out[0], border[0])
    is_shared = subsampling(parts) == (2, 1)
    for part, target, value in zip(parts[1:3], out[1:3], border[1:], strict=True):
        if is_shared:
            full = remap(
                widened(part, parts[0].shape[1], sitings[0]), luma, interpolation, None, value
            )
            target[:] = narrowed(full, sitings[1])
        else:
            remap(part, luma, interpolation, target, value)
    return out


def widened(colours: Image, width: int, siting: Siting) -> Image:
    """Interpolate chroma (h, width/2) linearly to all columns (h, width).

    >>> widened(np.array([[10, 20]], np.uint8), 4, "left"), widened(np.array([[10, 20]], np.uint8), 4, "center")
    (array([[10, 15, 20, 20]], dtype=uint8), array([[10, 13, 18, 20]], dtype=uint8))
    """
    values = colours.astype(np.int32)
    before = np.concatenate([values[:, :1], values[:, :-1]], axis=1)
    after = np.concatenate([values[:, 1:], values[:, -1:]], axis=1)
    out = np.empty((len(values), 2 * values.shape[1]), colours.dtype)
    if siting == "center":
        out[:, ::2] = (3 * values + before + 2) >> 2
        out[:, 1::2] = (3 * values + after + 2) >> 2
    else:
        out[:, ::2] = values
        out[:, 1::2] = (values + after + 1) >> 1
    return out[:, :width]


def narrowed(colours: Image, siting: Siting) -> Image:
    """Average chroma of all columns (h, w) about the sample positions (h, w/2).

    >>> narrowed(np.array([[10, 15, 20, 20]], np.uint8), "left"), narrowed(np.array([[10, 20, 30]], np.uint8), "center")
    (array([[11, 19]], dtype=uint8), array([[15, 30]], dtype=uint8))
    """
    values = colours.astype(np.int32)
    if values.shape[1] % 2:
        values = np.concatenate([values, values[:, -1:]], axis=1)
    first, second = values[:, ::2], values[:, 1::2]
    if siting == "center":
        mean = (first + second + 1) >> 1
    else:
        mean = (
            np.concatenate([first[:, :1], second[:, :-1]], axis=1) + 2 * first + second + 2
        ) >> 2
    return mean.astype(colours.dtype)
