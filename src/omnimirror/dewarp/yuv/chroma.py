"""Dewarping of video frames by planes: luma with the map of the view, chroma with a derived map.

In 4:2:0 a chroma sample belongs to 2 x 2 luma pixels at a position given by the siting; its map is
that of luma, :meth:`halved <omnimirror.dewarp.contracts.Map.halved>`.
"""

from __future__ import annotations

import numpy as np

from ..contracts import Border, Image, Interpolation, Map
from ..sampling.samplers import remap
from .planes import Planes, Siting, subsampling


def remap_planes(
    parts: Planes, luma: Map, chroma: Map, interpolation: Interpolation, out: Planes, border: tuple[float, float, float]
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
            whole = remap(widened(part, parts[0].shape[1], sitings[0]), luma, interpolation, None, value)
            target[:] = narrowed(whole, sitings[1])
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
        mean = (np.concatenate([first[:, :1], second[:, :-1]], axis=1) + 2 * first + second + 2) >> 2
    return mean.astype(colours.dtype)
