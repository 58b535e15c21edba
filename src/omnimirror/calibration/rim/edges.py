"""Edge detection with subpixel accuracy and direction, for rim detection."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.typing import Array

Image = NDArray[np.float32]

SHORT_SIDE_PX, FINER_PX = 360, 800
SMOOTHING_PX = 1.0
LEAST_STEP = 3.0  # levels of 255 per px; minimum step of an edge
NOISE_TIMES, NOISE_ROWS = 4.0, 3  # multiple of the noise, estimated from every third row
USUAL_STEP = 15.0  # levels per px; edges with larger steps have full weight
MOST_EDGES, CROWD_PX = 16_000, 25  # maximum number; excess edges are removed where they are dense


@dataclass(frozen=True)
class EdgePoints:
    """Edges of an image at working size."""

    points: Array
    """Edge positions (n, 2) px, (u, v)."""
    normals: Array
    """Unit normals (n, 2) towards the brighter side."""
    steps: Array
    """Steps (n,) in levels per px, of the steepest channel."""
    weights: Array
    """Weights (n,) from 0 to 1."""

    def among(self, chosen: NDArray[np.bool_] | NDArray[np.intp]) -> EdgePoints:
        """Return the edges selected by a mask (n,) or by indices."""
        return EdgePoints(self.points[chosen], self.normals[chosen], self.steps[chosen], self.weights[chosen])


@dataclass(frozen=True)
class Working:
    """Image at working size."""

    picture: Image
    """Levels (rows, columns, channels) from 0 to 255."""
    scale: float
    """Number of pixels of the original image per pixel; at least 1."""
    noise: float
    """Standard deviation of the gradient in uniform regions, levels per px."""

    @property
    def size(self) -> tuple[int, int]:
        """Image size (width, height)."""
        return self.picture.shape[1], self.picture.shape[0]


def at_working_size(picture: NDArray[Any], short_side_px: int = SHORT_SIDE_PX) -> Working:
    """Return an image (rows, columns[, channels]) of any type, with a limit on its short side."""
    import cv2

    levels = levels_of(picture)
    height, width = levels.shape[:2]
    scale = max(1.0, min(height, width) / short_side_px)
    if scale > 1:
        size = max(1, round(width / scale)), max(1, round(height / scale))
        levels = cv2.resize(levels, size, interpolation=cv2.INTER_AREA)
    image = levels.astype(np.float32).reshape(*levels.shape[:2], -1)
    smooth: Image = cv2.GaussianBlur(image, (0, 0), SMOOTHING_PX).reshape(image.shape)  # type: ignore[assignment]
    return Working(smooth, scale, _noise(smooth))


def edges_of(working: Working) -> EdgePoints:
    """Return the edges of an image at working size: maxima of the gradient of the steepest channel."""
    import cv2

    gx, gy, step = steepest(working.picture)
    rows, columns = np.indices(step.shape, dtype=np.float32)
    safe = np.maximum(step, 1e-6)
    nx, ny = gx / safe, gy / safe
    ahead = cv2.remap(step, columns + nx, rows + ny, cv2.INTER_LINEAR)
    behind = cv2.remap(step, columns - nx, rows - ny, cv2.INTER_LINEAR)
    least = max(LEAST_STEP, NOISE_TIMES * working.noise)
    found = (step > least) & (step >= ahead) & (step > behind)
    found[:2], found[-2:], found[:, :2], found[:, -2:] = False, False, False, False
    if found.sum() > MOST_EDGES:
        # relative to nearby edges: a strong pattern in one region must not suppress the rim in
        # another
        among = step / (cv2.blur(np.where(found, step, np.float32(0.0)), (CROWD_PX, CROWD_PX)) + np.float32(LEAST_STEP))
        found &= among >= np.partition(among[found], -MOST_EDGES)[-MOST_EDGES]
    v, u = np.nonzero(found)
    before, here, after = behind[v, u], step[v, u], ahead[v, u]
    offset = np.clip((after - before) / np.maximum(2 * (2 * here - before - after), 1e-6), -0.5, 0.5)
    normals = np.stack([nx[v, u], ny[v, u]], axis=1).astype(float)
    points = np.stack([u, v], axis=1) + offset[:, None] * normals
    return EdgePoints(points, normals, here.astype(float), np.minimum(here / USUAL_STEP, 1.0).astype(float))


def steepest(image: Image) -> tuple[Image, Image, Image]:
    """Return the gradient (right, down) and its length in levels per px, from the steepest channel."""
    import cv2

    gx: Any = cv2.Scharr(image, cv2.CV_32F, 1, 0, scale=1 / 32).reshape(image.shape)
    gy: Any = cv2.Scharr(image, cv2.CV_32F, 0, 1, scale=1 / 32).reshape(image.shape)
    length = gx * gx + gy * gy
    most, x, y = length[..., 0], gx[..., 0], gy[..., 0]
    for k in range(1, image.shape[2]):
        is_steeper = length[..., k] > most
        most, x, y = (np.where(is_steeper, a[..., k], b) for a, b in ((length, most), (gx, x), (gy, y)))
    return x, y, np.sqrt(most)


def strongest(channels: Image) -> Image:
    """Return the maximum (rows, columns) over the channels of each pixel (rows, columns, channels)."""
    most = channels[..., 0]
    for k in range(1, channels.shape[-1]):
        most = np.maximum(most, channels[..., k])
    return most


def levels_of(picture: NDArray[Any]) -> NDArray[Any]:
    """Return an image with 255 levels without opacity.

    The brightest 1 % of linear light is clipped.
    """
    if picture.ndim == 3 and picture.shape[2] in (2, 4):
        picture = picture[..., :-1]
    if picture.dtype == np.uint8:
        return picture
    if picture.dtype == np.uint16:
        return (picture / 257.0).astype(np.float32)
    light: Image = np.nan_to_num(picture.astype(np.float32), nan=0.0, posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(light, 99)), 1e-12)
    levels: Image = 255 * np.sqrt(np.clip(light / white, 0, 1))
    return levels


def _noise(smooth: Image) -> float:
    """Return the noise from second differences, whose median is insensitive to edges."""
    if min(smooth.shape[:2]) < 5:
        return 0.0
    rows = smooth[2:-2:NOISE_ROWS]
    second = rows[:, 4:] - 2 * rows[:, 2:-2] + rows[:, :-4]
    deviation = float(np.median(np.abs(second), axis=(0, 1)).max()) / 0.6745  # robust estimate
    return deviation / float(np.sqrt(6)) / 2


@lru_cache(maxsize=8)
def turns(count: int) -> Array:
    """Return angles (count,) over one revolution."""
    angles: Array = np.arange(float(count)) * (2 * np.pi / count)
    return angles
