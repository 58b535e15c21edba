"""Where the planes of a video frame look: luma by the view's map, colours at half the resolution by one made of it.

In 4:2:0 a colour sample belongs to 2 x 2 luma pixels. Column i of the colours lies over luma column
``2 i + x``, row j over ``2 j + y``, where (x, y) is the siting; so what a colour sample of the view shows is found
at ``(luma map there - siting of the source) / 2`` in the colour planes of the source. The luma map is taken
between its pixels, or between its nodes: nothing is projected again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ...cameras import Mask
from ...errors import InvalidParameter
from ..maps.polar import Rings
from ..sampling.footprints import Ring
from ..sampling.remapping import Border, FixedMap, Grid, Image, Interpolation, node_weights, remap_grid
from ..screens import Screen, View, parts_of

Siting = Literal["left", "center", "topleft"]
Planes = tuple[Image, ...]
"""(y, u, v), or (y, uv): (h, w), then (h/2, w/2) or (h/2, w/2, 2), halves rounded up; uint8 or uint16. In 4:2:2 and
4:4:4 colours are (h, w/2) and (h, w), and a fourth plane (h, w) may tell how opaque each pixel is."""
Where = FixedMap | Grid | Rings
Floats = NDArray[Any]

SITINGS: dict[str, tuple[float, float]] = {"left": (0.0, 0.5), "center": (0.5, 0.5), "topleft": (0.0, 0.0)}
"""Where a colour sample lies among its 2 x 2 luma pixels, right of and below the first one (ITU-T H.273)."""
SEEN = 2  # of the 4 luma pixels must show the scene for their colour to count


def half(size: tuple[int, int]) -> tuple[int, int]:
    """Size of the colour planes of a picture of a size.

    >>> half((63, 48))
    (32, 24)
    """
    return (size[0] + 1) // 2, (size[1] + 1) // 2


def check_planes(parts: Planes, size: tuple[int, int], sitings: tuple[str, str], bits: int) -> None:
    """Refuse what is no frame of the given (width, height).

    Raises
    ------
    InvalidParameter
        For planes that do not belong together, or another siting or depth.
    """
    for siting in sitings:
        if siting not in SITINGS:
            raise InvalidParameter(f"siting = {siting!r} is not one of {', '.join(SITINGS)}")
    check_shapes(parts, size)
    kinds = {part.dtype for part in parts}
    if len(kinds) != 1 or not kinds <= {np.dtype(np.uint8), np.dtype(np.uint16)}:
        raise InvalidParameter(f"planes hold {', '.join(sorted(map(str, kinds)))}; valid are uint8, or all uint16")
    low, high = (8, 8) if parts[0].dtype == np.uint8 else (9, 16)
    if not low <= bits <= high:
        raise InvalidParameter(f"bits = {bits} does not go with {parts[0].dtype} planes; valid are {low} to {high}")


def check_shapes(parts: Planes, size: tuple[int, int], like: Planes = ()) -> None:
    """Refuse planes that do not make up a picture of a size, or that are arranged otherwise than others."""
    (across, down), luma = half(size), (size[1], size[0])
    pairs: list[tuple[int, ...]] = [luma, (down, across, 2)]
    of_colours = {(2, 2): (down, across), (2, 1): (size[1], across), (1, 1): luma}
    three: dict[tuple[int, int], list[tuple[int, ...]]] = {by: [luma, c, c] for by, c in of_colours.items()}
    if not like:
        valid = [pairs, *three.values(), *([*part, luma] for part in three.values())]
    elif len(like) == 2:
        valid = [pairs]
    else:
        valid = [three[shared_by(like)] + [luma] * (len(like) - 3)]
    if [part.shape for part in parts] not in valid:
        found, wanted = ", ".join(str(part.shape) for part in parts), ", ".join(map(str, valid[0]))
        also = "" if like else f", or three, of which the last two are {', '.join(map(str, of_colours.values()))}"
        raise InvalidParameter(
            f"planes of shapes {found} are no picture of {size[0]} x {size[1]} px; valid are {wanted}{also}"
        )


def shared_by(parts: Planes) -> tuple[int, int]:
    """How many pixels share a colour, across and down, in planes (y, u, v) or (y, uv)."""
    (height, width), (down, across) = parts[0].shape[:2], parts[1].shape[:2]
    return (1 if across == width > 1 else 2), (1 if down == height > 1 else 2)


def border_of_planes(border: Border, full_range: bool, bits: int) -> tuple[float, float, float]:
    """The border as y, u and v: it is given so, or as a grey that counts from 0 to the largest value.

    >>> border_of_planes(0, False, 8), border_of_planes(255, False, 8), border_of_planes(0, False, 10)
    ((16, 128, 128), (235, 128, 128), (64, 512, 512))

    Raises
    ------
    InvalidParameter
        For anything else.
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
    """Planes for a picture of a size, arranged as others are; their values are undefined."""
    across, down = (-(-side // by) for side, by in zip(size, shared_by(like), strict=True))
    return tuple(
        np.empty((down, across, *part.shape[2:]) if i in (1, 2) else (size[1], size[0]), part.dtype)
        for i, part in enumerate(like)
    )


# -- colours from the luma map ---------------------------------------------------------------------


def chroma_of(
    luma: Where, view: View, sitings: tuple[Siting, Siting], source_size: tuple[int, int], kind: Interpolation
) -> Where:
    """What colours are sampled with, made of what luma is sampled with; sitings of the source and of the view."""
    if isinstance(luma, Grid):
        return chroma_grid(luma, sitings, source_size)
    ring = _halved(luma.ring, sitings[0])
    if isinstance(luma, FixedMap):
        pixels = chroma_coordinates(luma.coordinates, sitings, source_size, labels_of(view))
        return FixedMap(pixels, half(source_size), luma.interpolation, ring)
    if luma.lie_within(source_size):
        return replace(chroma_rings(luma, sitings), ring=ring)
    pixels = chroma_coordinates(luma.coordinates(source_size), sitings, source_size)
    return FixedMap(pixels, half(source_size), kind, ring)


def chroma_coordinates(
    luma: Floats,
    sitings: tuple[Siting, Siting],
    source_size: tuple[int, int],
    labels: NDArray[np.int32] | None = None,
) -> Floats:
    """Coordinates (.., ceil h/2, ceil w/2, 2) in the source's colour planes from those of luma (.., h, w, 2).

    Linear between luma pixels, which is wrong by an eighth of what the map bends from one output pixel to the
    next. At the end of the field a colour counts if at least two of its four luma pixels do.

    Parameters
    ----------
    sitings
        Of the source and of the view.
    labels : (h, w), optional
        Different numbers where one must not interpolate between.

    Examples
    --------
    >>> u, v = np.meshgrid(np.arange(4.0), np.arange(2.0))
    >>> chroma_coordinates(np.stack([u, v], axis=-1), ("left", "left"), (4, 2))  # the same picture
    array([[[0., 0.],
            [1., 0.]]])
    """
    site = np.array(SITINGS[sitings[0]])
    x, y = SITINGS[sitings[1]]
    blocks = _blocks(luma)
    rows = (1 - y) * blocks[..., 0, :, :] + y * blocks[..., 1, :, :]
    at = (1 - x) * rows[..., 0, :] + x * rows[..., 1, :]
    cut = np.isnan(at[..., 0]) & ((~np.isnan(blocks[..., 0])).sum(axis=(-2, -1)) >= SEEN)
    at[cut] = np.nanmean(blocks[cut], axis=(1, 2))
    if labels is not None:
        of_block = _blocks(labels[..., None])[..., 0]
        mixed = (of_block != of_block[..., :1, :1]).any(axis=(-2, -1))
        at[mixed] = blocks[mixed][:, 0, 0]
    return _within((at - site) / 2, source_size).astype(luma.dtype)


def _blocks(values: Floats) -> Floats:
    """Squares of 2 x 2 values (.., h/2, w/2, 2, 2, n) of (.., h, w, n); odd sides go on as they end."""
    for axis in (-3, -2):
        count = values.shape[axis]
        if count % 2:
            last = np.take(values, [-1], axis)
            before = np.take(values, [max(count - 2, 0)], axis)
            values = np.concatenate([values, 2 * last - before], axis)
    *more, height, width, n = values.shape
    return np.swapaxes(values.reshape(*more, height // 2, 2, width // 2, 2, n), -4, -3)


def _pairs(values: Floats) -> Floats:
    """Pairs (n/2, 2) of values (n,); an odd number goes on as it ends."""
    if len(values) % 2:
        values = np.append(values, 2 * values[-1] - values[max(len(values) - 2, 0)])
    return values.reshape(-1, 2)


def _within(pixels: Floats, source_size: tuple[int, int]) -> Floats:
    """Coordinates in a colour plane, those on the outermost luma pixels moved onto it."""
    return np.clip(pixels, -0.5, np.array(half(source_size)) - 0.5)


def labels_of(view: View) -> NDArray[np.int32] | None:
    """Which part of a mosaic each pixel shows, (h, w), 0 for none; None for a view that is no mosaic."""
    if isinstance(view, Screen):
        return None
    labels = np.zeros((view.size[1], view.size[0]), np.int32)
    for number, (left, top, screen) in enumerate(parts_of(view), start=1):
        width, height = screen.size
        labels[top : top + height, left : left + width] = number
    return labels


def chroma_rings(rings: Rings, sitings: tuple[Siting, Siting]) -> Rings:
    """The rings of the colours, between those of luma; at the end of the field one of two is enough."""
    site, (x, y) = (SITINGS[siting] for siting in sitings)
    radii, angles = _pairs(rings.radii), _pairs(rings.angles)
    at = (1 - y) * radii[:, 0] + y * radii[:, 1]
    at = np.where(np.isnan(at), np.where(np.isnan(radii[:, 0]), radii[:, 1], radii[:, 0]), at)
    centre = (rings.centre[0] - site[0]) / 2, (rings.centre[1] - site[1]) / 2
    return Rings(centre, at / 2, (1 - x) * angles[:, 0] + x * angles[:, 1])


def chroma_grid(grid: Grid, sitings: tuple[Siting, Siting], source_size: tuple[int, int]) -> Grid:
    """The lattice of the colours: that of luma at half the step, read between its pixels."""
    site, of_view = (np.array(SITINGS[siting]) for siting in sitings)
    nodes = ((grid.nodes - site[:, None, None]) / 2).astype(np.float32)
    fine = replace(
        grid,
        nodes=nodes,
        size=half(grid.size),
        step=grid.step // 2,
        patches=chroma_coordinates(grid.patches, sitings, source_size),
        shift=tuple(of_view / 2),
        ring=_halved(grid.ring, sitings[0]),
    )
    right, bottom = np.array(half(source_size)) - 0.5
    beyond = (nodes[0] > right) | (nodes[1] > bottom)
    if not beyond.any():
        return fine
    near = np.lib.stride_tricks.sliding_window_view(beyond, (4, 4)).any(axis=(2, 3)) & (grid.cells < 0)
    return _patched(fine, near, source_size) if near.any() else fine


def _halved(ring: Ring | None, siting: Siting) -> Ring | None:
    """Where colours are seen in their planes."""
    if ring is None:
        return None
    x, y = SITINGS[siting]
    return Ring((ring.u - x) / 2, (ring.v - y) / 2, ring.least / 2, ring.most / 2)


def _patched(grid: Grid, where: Mask, source_size: tuple[int, int]) -> Grid:
    """A lattice of colours some of whose cells are worked out here, and kept on the colour planes.

    Only luma on the last half pixel of the picture looks beyond them.
    """
    windows = np.lib.stride_tricks.sliding_window_view(grid.nodes, (4, 4), axis=(1, 2))[:, where]
    across, down = (node_weights(grid.step, shift) for shift in grid.shift)
    tiles = _within(np.einsum("cnij,ik,jl->nklc", windows, down, across), source_size)
    cells = grid.cells.copy()
    cells[where] = len(grid.patches) + np.arange(len(tiles))
    return replace(grid, cells=cells, patches=np.concatenate([grid.patches, tiles]).astype(np.float32))


# -- sampling --------------------------------------------------------------------------------------


def sample_planes(
    parts: Planes,
    luma: Where,
    chroma: Where,
    interpolation: Interpolation,
    out: Planes,
    border: tuple[float, float, float],
) -> Planes:
    """Fill the planes ``out`` with those of ``parts``; outside the field with the border's y, u and v."""
    y, u, v = border
    borders: tuple[Border, ...] = (y, u, v) if len(parts) == 3 else (y, (u, v))
    for i, (part, target, value) in enumerate(zip(parts, out, borders, strict=True)):
        sample(part, chroma if i else luma, interpolation, target, value)
    return out


def sample_whole(
    parts: Planes,
    luma: Where,
    sitings: tuple[Siting, Siting],
    interpolation: Interpolation,
    out: Planes,
    border: tuple[float, float, float],
) -> Planes:
    """Fill the planes ``out`` with those of ``parts`` in 4:2:2 or 4:4:4, where luma's map serves them all.

    Colours in 4:2:2 are interpolated between their columns first, and averaged to every second column of the view.
    """
    sample(parts[0], luma, interpolation, out[0], border[0])
    is_shared = shared_by(parts) == (2, 1)
    for part, target, value in zip(parts[1:3], out[1:3], border[1:], strict=True):
        if is_shared:
            whole = sample(widened(part, parts[0].shape[1], sitings[0]), luma, interpolation, None, value)
            target[:] = narrowed(whole, sitings[1])
        else:
            sample(part, luma, interpolation, target, value)
    return out


def widened(colours: Image, width: int, siting: Siting) -> Image:
    """Colours (h, width) of every pixel, from those (h, width/2) of pairs; between the columns linear.

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
    """Colours (h, w/2) of pairs of pixels, the mean about where they lie, from those (h, w) of every pixel.

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


def sample(image: Image, where: Where, interpolation: Interpolation, out: Image | None, border: Border) -> Image:
    """A picture's values, wherever they are; a map has its own interpolation."""
    if isinstance(where, Grid):
        return remap_grid(image, where, interpolation, out, border)
    if isinstance(where, Rings):
        return where.sample(image, interpolation, out, border)
    return where(image, out, border)
