"""Image preparation for board detection: greyscale, image sizes, blur, and dewarped local views."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.camera import Camera

# -- Greyscale conversion, image sizes and blur ----------------------------------------------------

Grey = NDArray[np.float32]

USUAL_PX = 900
"""Longer side of the first image size of the search, at which most squares have 10 px or more."""
MAX_PIXELS = 128_000_000
"""Maximum number of pixels; the search needs up to 13 bytes of memory per pixel."""
SMALLEST_PX, LARGEST_PX = 200, 6000
LARGEST_ENLARGED_PX = 3000  # for images enlarged by 2, to detect small squares
FULL = {"u": 255.0, "f": 1.0}


def grey(image: NDArray[Any]) -> Grey:
    """Convert an image (height, width) or (height, width, 1 to 4) to brightness, 0 to 255.

    Raises
    ------
    InvalidParameter
        If the image is invalid or has more than :data:`MAX_PIXELS` pixels.
    """
    image = np.asarray(image)
    if image.ndim not in (2, 3) or image.dtype.kind not in "uf" or min(image.shape[:2]) < 16:
        raise InvalidParameter(
            f"images must be arrays (height, width) or (height, width, 3) of unsigned integers or floats with at "
            f"least 16 px per side; got shape {image.shape} of {image.dtype}"
        )
    height, width = image.shape[:2]
    if height * width > MAX_PIXELS:
        raise InvalidParameter(
            f"images for board detection must have at most {MAX_PIXELS / 1e6:.0f} megapixels; "
            f"got {width} x {height} px; reduce the image size"
        )
    white_level = 1.0 if image.dtype.kind == "f" else float(np.iinfo(image.dtype).max)
    values = image.astype(np.float32)
    if values.ndim == 3:
        weights = (
            np.array([0.299, 0.587, 0.114], np.float32)
            if values.shape[2] >= 3
            else np.ones(1, np.float32)
        )
        values = values[..., : len(weights)] @ weights
    if image.dtype.kind == "f":  # high dynamic range: clip values above white
        values = np.clip(np.nan_to_num(values), 0, max(1.0, float(np.percentile(values, 99.5))))
        white_level = max(1.0, float(values.max()))
    return np.ascontiguousarray(values * np.float32(255.0 / white_level))


def bytes_of(image: Grey) -> NDArray[np.uint8]:
    """Convert to bytes for OpenCV's detectors, with stretched contrast.

    The 0.5 and 99.5 % percentiles become black and white.
    """
    low, high = np.percentile(image[::4, ::4], [0.5, 99.5])
    return np.asarray(np.clip((image - low) * (255 / max(high - low, 1.0)), 0, 255), np.uint8)


def scales(shape: tuple[int, ...]) -> list[float]:
    """Return the scales at which a board is searched, in order."""
    longest = max(shape[:2])
    usual = min(1.0, 2.0 ** round(np.log2(USUAL_PX / longest)))
    sizes = [s for s in (usual, 2 * usual, usual / 2, 4 * usual) if s <= 2]
    largest = {True: LARGEST_ENLARGED_PX, False: LARGEST_PX}
    return [s for s in sizes if SMALLEST_PX <= s * longest <= largest[s > 1]] or [usual]


def scaled(image: Grey, scale: float) -> Grey:
    """Return the image at another size."""
    import cv2

    if scale == 1:
        return image
    interpolation = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    return np.asarray(
        cv2.resize(image, None, fx=scale, fy=scale, interpolation=interpolation), np.float32
    )


def unscaled_px(pixels: Array, scale: float) -> Array:
    """Convert pixels of a scaled image to pixels of the full image.

    Pixel centres are integers in both.
    """
    return np.asarray((pixels + 0.5) / scale - 0.5)


def upwards(scale: float) -> Iterator[float]:
    """Yield scales from one scale to full size, doubled at each step.

    >>> list(upwards(0.25)), list(upwards(2.0))
    ([0.5, 1.0], [1.0])
    """
    while scale < 1:
        scale = min(2 * scale, 1.0)
        yield scale
        if scale == 1:
            return
    if scale > 1:
        yield 1.0


def edge_blur_px(image: Grey) -> float:
    """Return the standard deviation of the blur of the stronger edges of an image, px.

    The squared gradient of an edge with blur s sums to 1 / s; after an additional blur b to
    1 / sqrt(s^2 + b^2). The ratio of both sums gives s, independently of the contrast. Pixels with
    weak gradients, which are dominated by noise, are excluded.
    """
    import cv2

    added_blur = 2.0
    energies = []
    for blur in (1.0, float(np.hypot(1.0, added_blur))):
        smooth = cv2.GaussianBlur(image, (0, 0), blur)
        energies.append(
            cv2.Sobel(smooth, cv2.CV_32F, 1, 0) ** 2 + cv2.Sobel(smooth, cv2.CV_32F, 0, 1) ** 2
        )
    strong = cv2.blur(energies[1], (15, 15))
    used = strong > np.percentile(strong, 90)
    ratio = float(energies[0][used].sum() / max(energies[1][used].sum(), 1e-6))
    spread = (
        added_blur**2 / max(ratio**2 - 1, 1e-3) - 1.0
    )  # variance beyond the blur of the measurement
    return float(np.sqrt(np.clip(spread, 0.01, 1e3)))


# -- Local perspective views -----------------------------------------------------------------------

FIELD_DEG = 80.0
APART_DEG = 45.0
LONGEST_PX = 900


class LocalView(NamedTuple):
    """Perspective view of a part of the image."""

    image: Grey
    back: Callable[[Array], Array]
    """Mapping of view pixels (k, 2) to image pixels (k, 2); NaN outside the image."""


def local_views(image: Grey, camera: Camera) -> Iterator[LocalView]:
    """Yield perspective views that together cover the image at its resolution.

    Parameters
    ----------
    image : (height, width)
        Greyscale image of the camera's size.
    camera
        Camera accurate to a few degrees.
    """
    import cv2

    for direction, density in _directions(camera):
        focal = min(density, LONGEST_PX / 2 / np.tan(np.radians(FIELD_DEG / 2)))
        half = int(focal * np.tan(np.radians(FIELD_DEG / 2)))
        axes = _axes(direction)

        def back(
            pixels: Array, focal: float = focal, half: int = half, axes: Array = axes
        ) -> Array:
            flat = (pixels - half) / focal
            directions = axes[2] + flat[:, :1] * axes[0] + flat[:, 1:] * axes[1]
            return np.asarray(camera.project_directions(directions).pixels)

        steps = np.arange(2 * half + 1)
        pixels = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2).astype(float)
        source = (
            np.nan_to_num(back(pixels), nan=-10.0)
            .astype(np.float32)
            .reshape(len(steps), len(steps), 2)
        )
        view = cv2.remap(image, source[..., 0], source[..., 1], cv2.INTER_LINEAR)
        yield LocalView(np.asarray(view, np.float32), back)


def _directions(camera: Camera) -> Iterator[tuple[Array, float]]:
    """Yield separate directions (3,) with the image resolution there, pixels per radian."""
    width, height = camera.image_size
    grid = np.stack(
        np.meshgrid(np.linspace(0, width - 2, 25), np.linspace(0, height - 2, 25)), axis=-1
    ).reshape(-1, 2)
    here, right, below = (camera.backproject(grid + step) for step in ([0, 0], [1, 0], [0, 1]))
    valid = here.valid & right.valid & below.valid
    centre_directions, steps = (
        here.directions[valid],
        [r.directions[valid] - here.directions[valid] for r in (right, below)],
    )
    density = 1 / np.maximum(np.linalg.norm(np.stack(steps), axis=2).min(axis=0), 1e-6)
    selected: list[Array] = []
    for direction, resolution in zip(centre_directions, density, strict=True):
        if all(direction @ other < np.cos(np.radians(APART_DEG)) for other in selected):
            selected.append(direction)
            yield direction, float(resolution)


def _axes(direction: Array) -> Array:
    """Return the axes right, down and ahead (3, 3) of a view in a direction, upright in the world."""
    up = np.array([0.0, 0.0, 1.0]) if abs(direction[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    right = np.cross(direction, up)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(direction, right), direction])
