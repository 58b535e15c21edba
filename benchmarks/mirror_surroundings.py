"""Generate images of mirrors with a known outline in six types of realistic surroundings.

``bare``: a mirror on black that fills the image, or spokes. ``ball``: a mirror ball on a table, or in a dark double
frame. ``ridged``: a turned frame with several ridges. ``enclosed``: a mirror in a dark ring inside a bright, blurred
housing, with the circular border of the lens. ``cropped``: a grey image that cuts off the mirror at the top and bottom,
with dark and uneven surroundings. ``outdoors``: low contrast, with a bright sky in the mirror and behind it. The
content is an environment with a random projection function; no sensor is traced. ``rings`` contains no mirror: plates,
frames, a plain ball. All values are derived from the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from mirror_composites import Floats, ImageArray, LabelledImage, TrueOutline, coverage, environments
from numpy.typing import NDArray

SIZES = ((640, 480), (640, 640), (960, 720), (1280, 720), (1024, 1024), (800, 800), (320, 240))


def bare(seed: int, folder: Path | None) -> LabelledImage:
    """Return a plain mirror, or spokes, on black, mostly as large as the image."""
    rng = np.random.default_rng([21, seed])
    size_px = int(rng.integers(240, 1100))
    width = size_px if rng.random() < 0.6 else int(size_px * rng.uniform(1.0, 1.5))
    radius = size_px * (rng.uniform(0.44, 0.505) if rng.random() < 0.7 else rng.uniform(0.3, 0.44))
    shift = rng.normal(0, 0.1, 2) * max(size_px / 2 - radius, 0.01 * size_px)
    rim = TrueOutline(
        ((width - 1) / 2 + shift[0], (size_px - 1) / 2 + shift[1]), (radius, radius), 0.0
    )
    if has_spokes := rng.random() < 0.2:
        u, v = np.meshgrid(np.arange(width), np.arange(size_px))
        angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
        reflection = (
            rng.uniform(90, 150) + rng.uniform(20, 80) * np.sin(rng.integers(5, 24) * angle)
        )[..., None]
        reflection = reflection * np.ones(3)
    else:
        reflection = _render_reflection(rng, rim, width, size_px, folder)
        reflection, _ = _add_camera(rng, reflection, rim)
    mask = coverage(rim, 1.0, width, size_px)[..., None]
    image = reflection * mask + rng.choice([0.0, rng.uniform(0, 20)]) * (1 - mask)
    if rng.random() < 0.3:
        image = _add_glare(rng, image, rim)
    return LabelledImage(
        _degrade(rng, image, 3.0), rim, None, "spokes on black" if has_spokes else "on black"
    )


def ball(seed: int, folder: Path | None) -> LabelledImage:
    """Return a mirror ball on a table or a wall, optionally in a thin double frame."""
    rng = np.random.default_rng([22, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height, 0.28, 0.55)
    image, description = _background(rng, width, height, folder), "wall"
    if rng.random() < 0.6:
        image, description = _add_table(rng, image), "table"
    if rng.random() < 0.4:
        image = image * (1 - rng.uniform(0.2, 0.8) * _shadow(rng, rim, width, height))[..., None]
    scales = 1 + np.cumsum(rng.uniform(0.008, 0.05, rng.choice([0, 2, 3], p=[0.5, 0.3, 0.2])))
    image = _add_frames(rng, image, rim, scales)
    reflection = _render_reflection(rng, rim, width, height, folder, max_field_deg=(115.0, 175.0))
    if rng.random() < 0.3:  # transparent or grey low-contrast band along the rim
        scale = rng.uniform(0.8, 0.95)
        inner = cv2.GaussianBlur(coverage(rim, scale, width, height), (0, 0), rng.uniform(1, 12))[
            ..., None
        ]
        reflection = reflection * inner + (
            rng.uniform(30, 200, 3) + rng.uniform(0, 0.5) * (reflection - 120)
        ) * (1 - inner)
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + reflection * mask
    description += "".join(f" frame {scale:.3f}" for scale in scales)
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim), 6.0), rim, None, description)


def ridged(seed: int, folder: Path | None) -> LabelledImage:
    """Return a mirror in a turned frame with several ridges and a mostly dark outer part."""
    rng = np.random.default_rng([28, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height, 0.3, 0.5)
    image = _background(rng, width, height, folder) * rng.uniform(0.2, 1.0)
    scales = np.array([1 + rng.uniform(0.02, 0.1)])
    mask = coverage(rim, scales[0], width, height)[..., None]
    distance = _normalised_radius(rim, width, height)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    position = (distance - 1) / (scales[0] - 1)
    brightness = np.interp(
        position,
        np.linspace(0, 1, ridges := int(rng.integers(3, 14))),
        rng.uniform(0.15, 1.2, ridges),
    )
    brightness = brightness * (1 + rng.uniform(0, 0.7) * np.cos(angle - rng.uniform(0, 6.3)))
    brightness = brightness + rng.uniform(0, 1.5) * np.exp(
        20 * (np.cos(angle - rng.uniform(0, 6.3)) - 1)
    )
    colour = rng.uniform(40, 230) * rng.uniform(0.7, 1.1, 3)
    image = image * (1 - mask) + brightness[..., None] * colour * mask
    reflection = _render_reflection(rng, rim, width, height, folder, max_field_deg=(100.0, 170.0))
    inner = cv2.GaussianBlur(
        coverage(rim, rng.uniform(0.7, 0.95), width, height), (0, 0), rng.uniform(1, 15)
    )
    reflection = reflection * (rng.uniform(0.25, 1.0) * (1 - inner) + inner)[..., None]
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + reflection * mask
    return LabelledImage(
        _degrade(rng, _add_glare(rng, image, rim), 6.0), rim, None, f"ridged {scales[0]:.3f}"
    )


def enclosed(seed: int, folder: Path | None) -> LabelledImage:
    """Return a mirror in a dark ring, in a bright defocused housing, within the image circle of a
    lens."""
    rng = np.random.default_rng([23, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height, 0.3, 0.5)
    radius = rim.semi_axes_px[0]
    image = cv2.GaussianBlur(
        _background(rng, width, height, folder), (0, 0), rng.uniform(3, 25)
    ) * rng.uniform(0.4, 1.3)
    centre = (width / 2 + rng.normal(0, 4), height / 2 + rng.normal(0, 4))
    lens = TrueOutline(centre, (radius * rng.uniform(1.3, 1.7),) * 2, 0.0)
    circle = cv2.GaussianBlur(coverage(lens, 1.0, width, height), (0, 0), rng.uniform(0.5, 20))
    image = image * (circle * rng.uniform(0.5, 1) + rng.choice([0.0, 0.2]))[..., None]
    scales = 1 + np.cumsum(rng.uniform(0.03, 0.2, rng.integers(1, 3)))
    image = _add_frames(rng, image, rim, scales)
    reflection, scale = _add_camera(rng, _render_reflection(rng, rim, width, height, folder), rim)
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + reflection * mask
    description = "enclosed" + "".join(f" frame {scale:.2f}" for scale in scales)
    return LabelledImage(
        _degrade(rng, _add_glare(rng, image, rim), 6.0), rim, scale * radius, description
    )


def cropped(seed: int, folder: Path | None) -> LabelledImage:
    """Return a grey image of a mirror larger than the image height, with dark, unevenly lit
    surroundings."""
    rng = np.random.default_rng([24, seed])
    width, height = SIZES[rng.choice([0, 2, 3])]
    radius = height * rng.uniform(0.5, 0.66)
    stretch = rng.choice([1.0, rng.uniform(0.95, 1.0)])
    if radius > 0.5 * width:
        radius = 0.48 * width
    rim = TrueOutline(
        (width / 2 + rng.normal(0, 0.02) * width, height / 2 + rng.normal(0, 0.03) * height),
        (radius, radius * stretch),
        float(rng.uniform(0, 180)),
    )
    u = np.linspace(-1, 1, width)[None, :, None]
    dark = rng.uniform(2, 60) * (1 + rng.uniform(-0.8, 0.8) * u) * np.ones((height, 1, 3))
    if rng.random() < 0.4:
        dark = dark + 0.2 * cv2.GaussianBlur(
            _background(rng, width, height, folder), (0, 0), rng.uniform(2, 12)
        )
    scales = 1 + np.cumsum(rng.uniform(0.02, 0.1, rng.choice([0, 1, 2])))
    dark = _add_frames(rng, dark, rim, scales)
    reflection, _ = _add_camera(rng, _render_reflection(rng, rim, width, height, folder), rim)
    mask = cv2.GaussianBlur(coverage(rim, 1.0, width, height), (0, 0), rng.uniform(0.3, 1.5))[
        ..., None
    ]
    image = dark * (1 - mask) + reflection * mask
    if rng.random() < 0.6:
        image = np.repeat(image.mean(axis=2, keepdims=True), 3, axis=2)
    description = "cropped" + "".join(f" frame {scale:.2f}" for scale in scales)
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim), 8.0), rim, None, description)


def outdoors(seed: int, folder: Path | None) -> LabelledImage:
    """Return a low-contrast image with a bright sky in the outer part of the mirror and behind it."""
    rng = np.random.default_rng([25, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height, 0.25, 0.6)
    sky = rng.uniform(150, 250) * rng.uniform(0.85, 1.1, 3)
    v = np.linspace(0, 1, height)[:, None, None]
    horizon = rng.uniform(0.3, 1.0)
    ground = _background(rng, width, height, folder)
    image = np.where(v < horizon, sky * (1 - 0.3 * v) * rng.uniform(0.7, 1.1), ground)
    scales = 1 + np.cumsum(rng.uniform(0.015, 0.15, rng.choice([0, 1, 2], p=[0.5, 0.3, 0.2])))
    image = _add_frames(rng, image, rim, scales)
    reflection = _render_reflection(rng, rim, width, height, folder)
    distance = _normalised_radius(rim, width, height)
    angle = np.arctan2(
        *(np.indices((height, width)) - np.array(rim.centre_px[::-1])[:, None, None])
    )
    edge = np.full((height, width), rng.uniform(0.6, 0.9))
    for k in range(1, 40, 3):
        edge += rng.normal(0, 0.03) * np.cos(k * angle + rng.uniform(0, 6))
    above = np.clip((distance - edge) * rng.uniform(20, 200) + 0.5, 0, 1)[..., None]
    reflection = (
        reflection * (1 - above)
        + sky * rng.uniform(0.8, 1.05) * (1 + 0.1 * (distance[..., None] - 1)) * above
    )
    reflection, scale = _add_camera(rng, reflection, rim)
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + reflection * mask
    image = 128 + (image - 128) * rng.uniform(0.3, 1.0) + rng.uniform(-30, 30)
    description = "outdoors" + "".join(f" frame {scale:.2f}" for scale in scales)
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim), 4.0), rim, scale, description)


def rings(seed: int, folder: Path | None) -> LabelledImage:
    """Return an image without a mirror: plates, concentric rings, a plain ball or a wheel, on a
    wall or a table."""
    rng = np.random.default_rng([26, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height, 0.2, 0.55)
    image = _background(rng, width, height, folder)
    if rng.random() < 0.5:
        image = _add_table(rng, image)
    scales = np.sort(rng.uniform(0.2, 1.2, rng.integers(1, 5)))
    image = _add_frames(rng, image, rim, scales)
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim), 6.0), None, None, "rings")


SURROUNDINGS: dict[str, Callable[[int, Path | None], LabelledImage]] = {
    "bare": bare,
    "ball": ball,
    "ridged": ridged,
    "enclosed": enclosed,
    "cropped": cropped,
    "outdoors": outdoors,
}
"""Generators of mirror images by name."""


# -- mirror content ------------------------------------------------------------------------


def _normalised_radius(rim: TrueOutline, width: int, height: int) -> Floats:
    """Return the distance of each pixel from the centre, 1 on the outline."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.radians(rim.angle_deg)
    x, y = u - rim.centre_px[0], v - rim.centre_px[1]
    along, across = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
    return np.hypot(along / rim.semi_axes_px[0], across / rim.semi_axes_px[1])


def _render_reflection(
    rng: np.random.Generator,
    rim: TrueOutline,
    width: int,
    height: int,
    folder: Path | None,
    max_field_deg: tuple[float, float] = (65.0, 160.0),
) -> Floats:
    """Render an environment with a random orientation under a mapping from radius to field angle."""
    environment = _random_environment(rng, folder)
    distance = np.clip(_normalised_radius(rim, width, height), 0, 1.02)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    upper = np.radians(rng.uniform(*max_field_deg))
    if rng.random() < 0.5:  # slope that increases towards the rim, as for a ball
        upper = min(upper, np.radians(175))
        field = 2 * np.arcsin(np.clip(distance * np.sin(upper / 2), 0, 1))
    else:
        field = upper * distance ** rng.uniform(0.7, 1.6)
    rays = np.stack(
        [np.sin(field) * np.cos(angle), np.sin(field) * np.sin(angle), np.cos(field)], axis=-1
    )
    rays = rays @ _axes(rng).T
    longitude = np.arctan2(rays[..., 0], rays[..., 1]) * rng.choice([-1, 1]) + rng.uniform(0, 6)
    latitude = np.arcsin(np.clip(rays[..., 2], -1, 1))
    rows, columns, _ = environment.shape
    x = ((longitude / (2 * np.pi)) % 1 * (columns - 1)).astype(np.float32)
    y = ((0.5 - latitude / np.pi) * (rows - 1)).astype(np.float32)
    return cv2.remap(environment, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) * rng.uniform(
        0.5, 1.2
    )


def _axes(rng: np.random.Generator) -> NDArray:
    """Draw a rotation: optical axis down, up, or arbitrary."""
    if rng.random() < 0.6:
        return np.diag([1.0, rng.choice([-1.0, 1.0]), rng.choice([-1.0, 1.0])])
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q


def _random_environment(rng: np.random.Generator, folder: Path | None) -> ImageArray:
    """Return a photographed environment, a scene of the project, or blocks and checks."""
    kind = rng.integers(4)
    if kind == 0:
        return environments(None)[rng.integers(2)]
    if kind == 1:
        return _blocks(int(rng.integers(24)))
    return environments(folder)[rng.integers(len(environments(folder)))]


@cache
def _blocks(number: int) -> ImageArray:
    """Return a world of plain walls, blocks, lines and checks."""
    rng = np.random.default_rng([27, number])
    environment = np.zeros((512, 1024, 3), np.uint8)
    top = int(rng.uniform(100, 300))
    environment[:top], environment[top:] = rng.uniform(60, 255, 3), rng.uniform(20, 200, 3)
    if rng.random() < 0.5:
        cell = int(rng.uniform(15, 60))
        v, u = np.indices(environment.shape[:2])
        odd_tiles = ((u // cell + v // cell) % 2 == 1) & (v > rng.uniform(0, 400))
        environment[odd_tiles] = rng.uniform(0, 255, 3)
    for _ in range(rng.integers(10, 120)):
        x, y = int(rng.uniform(0, 1024)), int(rng.uniform(0, 512))
        w, h = (int(rng.uniform(3, 120)) for _ in range(2))
        colour = tuple(rng.uniform(0, 255, 3))
        cv2.rectangle(environment, (x, y), (x + w, y + h), colour, int(rng.choice([-1, -1, 2])))
    return environment


def _add_camera(
    rng: np.random.Generator, reflection: Floats, rim: TrueOutline
) -> tuple[Floats, float]:
    """Add, in most cases, the camera reflection in the centre; return its radius relative to the
    outline, 0 without."""
    if rng.random() < 0.35:
        return reflection, 0.0
    height, width, _ = reflection.shape
    scale = rng.uniform(0.05, 0.3)
    mask = coverage(rim, scale, width, height)[..., None]
    dark = rng.uniform(0, 60, 3)
    reflection = reflection * (1 - mask) + dark * mask
    if rng.random() < 0.5:  # lens of the camera
        mask = coverage(rim, scale * rng.uniform(0.2, 0.7), width, height)[..., None]
        reflection = reflection * (1 - mask) + rng.uniform(0, 120, 3) * mask
    return reflection, scale


# -- surroundings --------------------------------------------------------------------------


def _random_outline(
    rng: np.random.Generator, width: int, height: int, lower: float, upper: float
) -> TrueOutline:
    """Draw an ellipse that is mostly inside the image and near its centre."""
    while True:
        radius = height * rng.uniform(lower, upper)
        ratio = 1.0 if rng.random() < 0.6 else rng.uniform(0.94, 1.0)
        spread = rng.choice([0.02, 0.15])
        u, v = width * (0.5 + rng.normal(0, spread)), height * (0.5 + rng.normal(0, spread))
        angle = np.linspace(0, 2 * np.pi, 360)
        x, y = u + radius * np.cos(angle), v + radius * np.sin(angle)
        if np.mean((x > 0) & (x < width) & (y > 0) & (y < height)) > 0.65:
            return TrueOutline((u, v), (radius, radius * ratio), float(rng.uniform(0, 180)))


def _background(rng: np.random.Generator, width: int, height: int, folder: Path | None) -> Floats:
    """Return a crop of an environment, a plain wall lit from one side, bars, or checks."""
    kind = rng.integers(4)
    if kind == 0:
        environment = environments(folder)[rng.integers(len(environments(folder)))]
        rows, columns, _ = environment.shape
        h = int(rng.uniform(0.15, 0.5) * rows)
        w = min(int(h * width / height), columns)
        x, y = rng.integers(0, columns - w + 1), rng.integers(0, rows - h)
        return cv2.resize(
            environment[y : y + h, x : x + w], (width, height), interpolation=cv2.INTER_LINEAR
        ).astype(float)
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    orientation = rng.uniform(0, np.pi)
    along = u * np.cos(orientation) + v * np.sin(orientation)
    image = rng.uniform(10, 230, 3) * (1 + rng.uniform(0, 0.5) * along)[..., None]
    if kind == 1:
        bars = np.zeros((height, width))
        for _ in range(rng.integers(1, 6)):
            position, half_width = rng.uniform(-1, 1), rng.uniform(0.01, 0.15)
            bars = np.maximum(
                bars, np.abs((u if rng.random() < 0.5 else v) - position) < half_width
            )
        image = image * (1 - bars[..., None]) + rng.uniform(0, 255, 3) * bars[..., None]
    elif kind == 2:
        cell, across = rng.uniform(0.15, 1.0), v * np.cos(orientation) - u * np.sin(orientation)
        odd_tiles = ((along // cell + across // cell) % 2)[..., None]
        image = image * (1 - odd_tiles) + rng.uniform(0, 255, 3) * odd_tiles
    return image


def _add_table(rng: np.random.Generator, image: Floats) -> Floats:
    """Add a straight edge with one or two colours beyond it."""
    height, width, _ = image.shape
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    orientation = rng.normal(0, 0.4)
    distance = v * np.cos(orientation) - u * np.sin(orientation) - rng.uniform(-0.5, 0.9)
    for start in (0.0, rng.uniform(0.03, 0.5)):
        image = np.where(
            (distance > start)[..., None], rng.uniform(0, 250, 3) * (1 + 0.3 * u[..., None]), image
        )
    return image


def _shadow(rng: np.random.Generator, rim: TrueOutline, width: int, height: int) -> Floats:
    """Return a soft shadow next to the mirror."""
    shift = rng.uniform(-0.3, 0.3, 2) * rim.semi_axes_px[0]
    other = TrueOutline(
        (rim.centre_px[0] + shift[0], rim.centre_px[1] + shift[1]), rim.semi_axes_px, rim.angle_deg
    )
    return cv2.GaussianBlur(
        coverage(other, rng.uniform(0.95, 1.2), width, height), (0, 0), rng.uniform(2, 30)
    )


def _add_frames(
    rng: np.random.Generator, image: Floats, rim: TrueOutline, scales: NDArray
) -> Floats:
    """Add frames of one colour each, outermost first, lit from one side, with one or two
    highlights."""
    height, width, _ = image.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    for scale in scales[::-1]:
        brightness = 1 + rng.uniform(0, 0.8) * np.cos(angle - rng.uniform(0, 2 * np.pi))
        for _ in range(rng.integers(0, 3)):
            brightness = brightness + rng.uniform(0, 4) * np.exp(
                rng.uniform(5, 60) * (np.cos(angle - rng.uniform(0, 6.3)) - 1)
            )
        if rng.random() < 0.15:  # marks or screws
            brightness = brightness + rng.uniform(-0.8, 2) * (
                np.cos(rng.integers(3, 60) * angle) > 0.9
            )
        colour = (
            rng.uniform(0, 40, 3)
            if rng.random() < 0.6
            else rng.uniform(30, 230) * rng.uniform(0.8, 1.2, 3)
        )
        mask = coverage(rim, scale, width, height)[..., None]
        image = image * (1 - mask) + brightness[..., None] * colour * mask
    return image


def _add_glare(rng: np.random.Generator, image: Floats, rim: TrueOutline) -> Floats:
    """Add glare, mostly at the rim."""
    height, width, _ = image.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    for _ in range(rng.integers(0, 5)):
        angle, radius_ratio = (
            rng.uniform(0, 2 * np.pi),
            rng.choice([rng.uniform(0.9, 1.15), rng.uniform(0, 1.2)]),
        )
        x, y = (
            c + radius_ratio * rim.semi_axes_px[0] * f(angle)
            for c, f in zip(rim.centre_px, (np.cos, np.sin), strict=True)
        )
        orientation, size = rng.uniform(0, np.pi), rim.semi_axes_px[0] * rng.uniform(0.02, 0.15)
        a = ((u - x) * np.cos(orientation) + (v - y) * np.sin(orientation)) / size
        b = ((v - y) * np.cos(orientation) - (u - x) * np.sin(orientation)) / (
            size * rng.uniform(0.2, 1)
        )
        image = image + (rng.uniform(80, 500) * np.exp(-(a**2 + b**2) / 2))[..., None]
    return image


def _degrade(rng: np.random.Generator, image: Floats, noise: float) -> ImageArray:
    """Apply blur, noise, clipping and, mostly, JPEG compression."""
    image = np.clip(image, 0, 400)
    if rng.random() < 0.6:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.4, 1.6))
    noisy = np.clip(image + rng.normal(0, rng.uniform(0, noise), image.shape), 0, 255).astype(
        np.uint8
    )
    if rng.random() < 0.7:
        _, data = cv2.imencode(".jpg", noisy, [1, int(rng.uniform(60, 97))])
        noisy = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return noisy
