"""Triangles with uniform or interpolated colours, as surfaces, and tree crowns made of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light, hex_colour
from ...base.typing import Array
from .boxes import Box
from .surfaces import Surfaces, Texture


def facets(triangles: Array, colours: Light) -> Surfaces:
    """Return triangles (n, 3, 3), mm, with interpolated linear RGB (n, 3, 3) of their vertices.

    Each has four texels; the last one continues the plane of the others, for exact interpolation.

    >>> red_to_blue = facets(np.array([[[9.0, 3, -3], [9, -3, -3], [9, 3, 3]]]), np.eye(3)[None].astype(np.float32))
    >>> red_to_blue.seen(np.zeros((1, 3)), np.array([[9.0, 1.0, -1.0]])).light.round(3)
    array([[0.333, 0.333, 0.333]], dtype=float32)
    """
    count = len(triangles)
    columns = max(1, int(np.ceil(np.sqrt(count))))
    blocks = np.zeros((-(-count // columns), columns, 2, 2, 4), np.float32)
    row, column = np.divmod(np.arange(count), columns)
    a, b, c = np.moveaxis(np.asarray(colours, np.float32), 1, 0)
    for (i, j), light in {(0, 0): a, (0, 1): b, (1, 0): c, (1, 1): b + c - a}.items():
        blocks[row, column, i, j, :3] = light
    texels = blocks.transpose(0, 2, 1, 3, 4).reshape(2 * blocks.shape[0], 2 * columns, 4)
    at = np.empty((count, 3, 2), np.float32)
    at[:, 0], at[:, 1:] = 2 * np.stack([column, row], axis=-1), np.eye(2)
    return halves(triangles, at, Texture(texels))


def halves(triangles: Array, at: NDArray[np.floating], texture: Texture) -> Surfaces:
    """Return triangles (n, 3, 3), mm, with the texture position of the first vertex and the
    increments along both sides (n, 3, 2).
    """
    places = np.concatenate([triangles[:, :1], triangles[:, 1:] - triangles[:, :1]], axis=1)
    return Surfaces.of(places, at, 0, True, (texture,))


def combined(parts: Sequence[Surfaces]) -> Surfaces:
    """Combine several sets of surfaces."""
    records = np.concatenate([part.records for part in parts])
    firsts = np.cumsum([0, *(len(part.textures) for part in parts[:-1])])
    shifts = np.repeat(firsts, [len(part.records) for part in parts])
    records["kind"] += np.where(records["kind"] < 0, -shifts, shifts).astype(np.int32)
    return Surfaces(records, tuple(texture for part in parts for texture in part.textures))


RINGS, SPOKES = 7, 14


def crown(box: Box, colour: str, sun: Array) -> Surfaces:
    """Return the crown of a tree: an irregular ball that fills a box, lit by the sun."""
    low, high = np.array(box.low), np.array(box.high)
    chance = np.random.default_rng(int(abs(low).sum()))
    polar, turn = np.meshgrid(np.linspace(0, np.pi, RINGS), 2 * np.pi * np.arange(SPOKES) / SPOKES, indexing="ij")
    bumps = 1 + 0.14 * chance.standard_normal(polar.shape)
    bumps[[0, -1]] = 1.0
    ball = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1)
    points = (low + high) / 2 + (high - low) / 2 * bumps[..., None] * ball
    sunny, tone = np.clip(ball @ sun, 0, 1), 1 + 0.12 * chance.standard_normal(polar.shape)
    light = (0.25 + 0.2 * (ball[..., 2] + 1) / 2 + 0.8 * sunny) * tone
    colours = light[..., None] * hex_colour(colour)
    corners = (points, colours)
    quads = [[np.roll(a, shift, axis=1)[rows] for rows, shift in _QUAD] for a in corners]
    triangles, shades = (
        np.concatenate([np.stack([q[i] for i in order], axis=-2).reshape(-1, 3, 3) for order in ((0, 1, 2), (0, 2, 3))])
        for q in quads
    )
    return facets(triangles, shades.astype(np.float32))


_QUAD = ((slice(None, -1), 0), (slice(1, None), 0), (slice(1, None), -1), (slice(None, -1), -1))
"""Row and azimuth indices of the four vertices of the faces between two rings."""
