"""Generate images of mirrors with a known outline in six types of realistic surroundings.

``bare``: a mirror on black that fills the image, or spokes. ``ball``: a mirror ball on a table, or in a dark double
frame. ``ridged``: a turned frame with several ridges. ``enclosed``: a mirror in a dark ring inside a bright, blurred
housing, with the circular border of the lens. ``cut``: a grey image that cuts off the mirror at the top and bottom,
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
from mirror_photographs import Floats, ImageArray, Photograph, Rim, coverage, environments
from numpy.typing import NDArray

SIZES = ((640, 480), (640, 640), (960, 720), (1280, 720), (1024, 1024), (800, 800), (320, 240))


def bare(seed: int, folder: Path | None) -> Photograph:
    """Return a plain mirror, or spokes, on black, mostly as large as the image."""
    rng = np.random.default_rng([21, seed])
    side = int(rng.integers(240, 1100))
    width = side if rng.random() < 0.6 else int(side * rng.uniform(1.0, 1.5))
    radius = side * (rng.uniform(0.44, 0.505) if rng.random() < 0.7 else rng.uniform(0.3, 0.44))
    shift = rng.normal(0, 0.1, 2) * max(side / 2 - radius, 0.01 * side)
    rim = Rim(((width - 1) / 2 + shift[0], (side - 1) / 2 + shift[1]), (radius, radius), 0.0)
    if spoked := rng.random() < 0.2:
        u, v = np.meshgrid(np.arange(width), np.arange(side))
        turn = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
        shown = (rng.uniform(90, 150) + rng.uniform(20, 80) * np.sin(rng.integers(5, 24) * turn))[
            ..., None
        ]
        shown = shown * np.ones(3)
    else:
        shown = _shown(rng, rim, width, side, folder)
        shown, _ = _with_camera(rng, shown, rim)
    cover = coverage(rim, 1.0, width, side)[..., None]
    picture = shown * cover + rng.choice([0.0, rng.uniform(0, 20)]) * (1 - cover)
    if rng.random() < 0.3:
        picture = _shone(rng, picture, rim)
    return Photograph(
        _recorded(rng, picture, 3.0), rim, None, "spokes on black" if spoked else "on black"
    )


def ball(seed: int, folder: Path | None) -> Photograph:
    """Return a mirror ball on a table or a wall, optionally in a thin double frame."""
    rng = np.random.default_rng([22, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height, 0.28, 0.55)
    picture, words = _wall(rng, width, height, folder), "wall"
    if rng.random() < 0.6:
        picture, words = _with_table(rng, picture), "table"
    if rng.random() < 0.4:
        picture = (
            picture * (1 - rng.uniform(0.2, 0.8) * _shadow(rng, rim, width, height))[..., None]
        )
    shares = 1 + np.cumsum(rng.uniform(0.008, 0.05, rng.choice([0, 2, 3], p=[0.5, 0.3, 0.2])))
    picture = _in_frames(rng, picture, rim, shares)
    shown = _shown(rng, rim, width, height, folder, widest=(115.0, 175.0))
    if rng.random() < 0.3:  # transparent or grey low-contrast band along the rim
        share = rng.uniform(0.8, 0.95)
        inner = cv2.GaussianBlur(coverage(rim, share, width, height), (0, 0), rng.uniform(1, 12))[
            ..., None
        ]
        shown = shown * inner + (rng.uniform(30, 200, 3) + rng.uniform(0, 0.5) * (shown - 120)) * (
            1 - inner
        )
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + shown * cover
    words += "".join(f" frame {share:.3f}" for share in shares)
    return Photograph(_recorded(rng, _shone(rng, picture, rim), 6.0), rim, None, words)


def ridged(seed: int, folder: Path | None) -> Photograph:
    """Return a mirror in a turned frame with several ridges and a mostly dark outer part."""
    rng = np.random.default_rng([28, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height, 0.3, 0.5)
    picture = _wall(rng, width, height, folder) * rng.uniform(0.2, 1.0)
    shares = np.array([1 + rng.uniform(0.02, 0.1)])
    cover = coverage(rim, shares[0], width, height)[..., None]
    away = _away(rim, width, height)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    turn = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    at = (away - 1) / (shares[0] - 1)
    light = np.interp(
        at, np.linspace(0, 1, ridges := int(rng.integers(3, 14))), rng.uniform(0.15, 1.2, ridges)
    )
    light = light * (1 + rng.uniform(0, 0.7) * np.cos(turn - rng.uniform(0, 6.3)))
    light = light + rng.uniform(0, 1.5) * np.exp(20 * (np.cos(turn - rng.uniform(0, 6.3)) - 1))
    colour = rng.uniform(40, 230) * rng.uniform(0.7, 1.1, 3)
    picture = picture * (1 - cover) + light[..., None] * colour * cover
    shown = _shown(rng, rim, width, height, folder, widest=(100.0, 170.0))
    inner = cv2.GaussianBlur(
        coverage(rim, rng.uniform(0.7, 0.95), width, height), (0, 0), rng.uniform(1, 15)
    )
    shown = shown * (rng.uniform(0.25, 1.0) * (1 - inner) + inner)[..., None]
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + shown * cover
    return Photograph(
        _recorded(rng, _shone(rng, picture, rim), 6.0), rim, None, f"ridged {shares[0]:.3f}"
    )


def enclosed(seed: int, folder: Path | None) -> Photograph:
    """Return a mirror in a dark ring, in a bright defocused housing, within the image circle of a
    lens."""
    rng = np.random.default_rng([23, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height, 0.3, 0.5)
    radius = rim.semi_axes_px[0]
    picture = cv2.GaussianBlur(
        _wall(rng, width, height, folder), (0, 0), rng.uniform(3, 25)
    ) * rng.uniform(0.4, 1.3)
    middle = (width / 2 + rng.normal(0, 4), height / 2 + rng.normal(0, 4))
    lens = Rim(middle, (radius * rng.uniform(1.3, 1.7),) * 2, 0.0)
    circle = cv2.GaussianBlur(coverage(lens, 1.0, width, height), (0, 0), rng.uniform(0.5, 20))
    picture = picture * (circle * rng.uniform(0.5, 1) + rng.choice([0.0, 0.2]))[..., None]
    shares = 1 + np.cumsum(rng.uniform(0.03, 0.2, rng.integers(1, 3)))
    picture = _in_frames(rng, picture, rim, shares)
    shown, share = _with_camera(rng, _shown(rng, rim, width, height, folder), rim)
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + shown * cover
    words = "enclosed" + "".join(f" frame {share:.2f}" for share in shares)
    return Photograph(_recorded(rng, _shone(rng, picture, rim), 6.0), rim, share * radius, words)


def cut(seed: int, folder: Path | None) -> Photograph:
    """Return a grey image of a mirror larger than the image height, with dark, unevenly lit
    surroundings."""
    rng = np.random.default_rng([24, seed])
    width, height = SIZES[rng.choice([0, 2, 3])]
    radius = height * rng.uniform(0.5, 0.66)
    stretch = rng.choice([1.0, rng.uniform(0.95, 1.0)])
    if radius > 0.5 * width:
        radius = 0.48 * width
    rim = Rim(
        (width / 2 + rng.normal(0, 0.02) * width, height / 2 + rng.normal(0, 0.03) * height),
        (radius, radius * stretch),
        float(rng.uniform(0, 180)),
    )
    u = np.linspace(-1, 1, width)[None, :, None]
    dark = rng.uniform(2, 60) * (1 + rng.uniform(-0.8, 0.8) * u) * np.ones((height, 1, 3))
    if rng.random() < 0.4:
        dark = dark + 0.2 * cv2.GaussianBlur(
            _wall(rng, width, height, folder), (0, 0), rng.uniform(2, 12)
        )
    shares = 1 + np.cumsum(rng.uniform(0.02, 0.1, rng.choice([0, 1, 2])))
    dark = _in_frames(rng, dark, rim, shares)
    shown, _ = _with_camera(rng, _shown(rng, rim, width, height, folder), rim)
    cover = cv2.GaussianBlur(coverage(rim, 1.0, width, height), (0, 0), rng.uniform(0.3, 1.5))[
        ..., None
    ]
    picture = dark * (1 - cover) + shown * cover
    if rng.random() < 0.6:
        picture = np.repeat(picture.mean(axis=2, keepdims=True), 3, axis=2)
    words = "cut" + "".join(f" frame {share:.2f}" for share in shares)
    return Photograph(_recorded(rng, _shone(rng, picture, rim), 8.0), rim, None, words)


def outdoors(seed: int, folder: Path | None) -> Photograph:
    """Return a low-contrast image with a bright sky in the outer part of the mirror and behind it."""
    rng = np.random.default_rng([25, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height, 0.25, 0.6)
    sky = rng.uniform(150, 250) * rng.uniform(0.85, 1.1, 3)
    v = np.linspace(0, 1, height)[:, None, None]
    horizon = rng.uniform(0.3, 1.0)
    ground = _wall(rng, width, height, folder)
    picture = np.where(v < horizon, sky * (1 - 0.3 * v) * rng.uniform(0.7, 1.1), ground)
    shares = 1 + np.cumsum(rng.uniform(0.015, 0.15, rng.choice([0, 1, 2], p=[0.5, 0.3, 0.2])))
    picture = _in_frames(rng, picture, rim, shares)
    shown = _shown(rng, rim, width, height, folder)
    away = _away(rim, width, height)
    turn = np.arctan2(*(np.indices((height, width)) - np.array(rim.centre_px[::-1])[:, None, None]))
    edge = np.full((height, width), rng.uniform(0.6, 0.9))
    for k in range(1, 40, 3):
        edge += rng.normal(0, 0.03) * np.cos(k * turn + rng.uniform(0, 6))
    above = np.clip((away - edge) * rng.uniform(20, 200) + 0.5, 0, 1)[..., None]
    shown = (
        shown * (1 - above)
        + sky * rng.uniform(0.8, 1.05) * (1 + 0.1 * (away[..., None] - 1)) * above
    )
    shown, share = _with_camera(rng, shown, rim)
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + shown * cover
    picture = 128 + (picture - 128) * rng.uniform(0.3, 1.0) + rng.uniform(-30, 30)
    words = "outdoors" + "".join(f" frame {share:.2f}" for share in shares)
    return Photograph(_recorded(rng, _shone(rng, picture, rim), 4.0), rim, share, words)


def rings(seed: int, folder: Path | None) -> Photograph:
    """Return an image without a mirror: plates, concentric rings, a plain ball or a wheel, on a
    wall or a table."""
    rng = np.random.default_rng([26, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height, 0.2, 0.55)
    picture = _wall(rng, width, height, folder)
    if rng.random() < 0.5:
        picture = _with_table(rng, picture)
    shares = np.sort(rng.uniform(0.2, 1.2, rng.integers(1, 5)))
    picture = _in_frames(rng, picture, rim, shares)
    return Photograph(_recorded(rng, _shone(rng, picture, rim), 6.0), None, None, "rings")


SURROUNDINGS: dict[str, Callable[[int, Path | None], Photograph]] = {
    "bare": bare,
    "ball": ball,
    "ridged": ridged,
    "enclosed": enclosed,
    "cut": cut,
    "outdoors": outdoors,
}
"""Generators of mirror images by name."""


# -- mirror content ------------------------------------------------------------------------


def _away(rim: Rim, width: int, height: int) -> Floats:
    """Return the distance of each pixel from the centre, 1 on the outline."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    turn = np.radians(rim.angle_deg)
    x, y = u - rim.centre_px[0], v - rim.centre_px[1]
    along, across = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    return np.hypot(along / rim.semi_axes_px[0], across / rim.semi_axes_px[1])


def _shown(
    rng: np.random.Generator,
    rim: Rim,
    width: int,
    height: int,
    folder: Path | None,
    widest: tuple[float, float] = (65.0, 160.0),
) -> Floats:
    """Render an environment with a random orientation under a mapping from radius to field angle."""
    world = _world(rng, folder)
    away = np.clip(_away(rim, width, height), 0, 1.02)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    turn = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    most = np.radians(rng.uniform(*widest))
    if rng.random() < 0.5:  # slope that increases towards the rim, as for a ball
        most = min(most, np.radians(175))
        field = 2 * np.arcsin(np.clip(away * np.sin(most / 2), 0, 1))
    else:
        field = most * away ** rng.uniform(0.7, 1.6)
    rays = np.stack(
        [np.sin(field) * np.cos(turn), np.sin(field) * np.sin(turn), np.cos(field)], axis=-1
    )
    rays = rays @ _axes(rng).T
    longitude = np.arctan2(rays[..., 0], rays[..., 1]) * rng.choice([-1, 1]) + rng.uniform(0, 6)
    latitude = np.arcsin(np.clip(rays[..., 2], -1, 1))
    rows, columns, _ = world.shape
    x = ((longitude / (2 * np.pi)) % 1 * (columns - 1)).astype(np.float32)
    y = ((0.5 - latitude / np.pi) * (rows - 1)).astype(np.float32)
    return cv2.remap(world, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP) * rng.uniform(
        0.5, 1.2
    )


def _axes(rng: np.random.Generator) -> NDArray:
    """Draw a rotation: optical axis down, up, or arbitrary."""
    if rng.random() < 0.6:
        return np.diag([1.0, rng.choice([-1.0, 1.0]), rng.choice([-1.0, 1.0])])
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    return q


def _world(rng: np.random.Generator, folder: Path | None) -> ImageArray:
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
    world = np.zeros((512, 1024, 3), np.uint8)
    top = int(rng.uniform(100, 300))
    world[:top], world[top:] = rng.uniform(60, 255, 3), rng.uniform(20, 200, 3)
    if rng.random() < 0.5:
        cell = int(rng.uniform(15, 60))
        v, u = np.indices(world.shape[:2])
        odd = ((u // cell + v // cell) % 2 == 1) & (v > rng.uniform(0, 400))
        world[odd] = rng.uniform(0, 255, 3)
    for _ in range(rng.integers(10, 120)):
        x, y = int(rng.uniform(0, 1024)), int(rng.uniform(0, 512))
        w, h = (int(rng.uniform(3, 120)) for _ in range(2))
        colour = tuple(rng.uniform(0, 255, 3))
        cv2.rectangle(world, (x, y), (x + w, y + h), colour, int(rng.choice([-1, -1, 2])))
    return world


def _with_camera(rng: np.random.Generator, shown: Floats, rim: Rim) -> tuple[Floats, float]:
    """Add, in most cases, the camera reflection in the centre; return its radius relative to the
    outline, 0 without."""
    if rng.random() < 0.35:
        return shown, 0.0
    height, width, _ = shown.shape
    share = rng.uniform(0.05, 0.3)
    cover = coverage(rim, share, width, height)[..., None]
    dark = rng.uniform(0, 60, 3)
    shown = shown * (1 - cover) + dark * cover
    if rng.random() < 0.5:  # lens of the camera
        cover = coverage(rim, share * rng.uniform(0.2, 0.7), width, height)[..., None]
        shown = shown * (1 - cover) + rng.uniform(0, 120, 3) * cover
    return shown, share


# -- surroundings --------------------------------------------------------------------------


def _placed(rng: np.random.Generator, width: int, height: int, least: float, most: float) -> Rim:
    """Draw an ellipse that is mostly inside the image and near its centre."""
    while True:
        radius = height * rng.uniform(least, most)
        ratio = 1.0 if rng.random() < 0.6 else rng.uniform(0.94, 1.0)
        spread = rng.choice([0.02, 0.15])
        u, v = width * (0.5 + rng.normal(0, spread)), height * (0.5 + rng.normal(0, spread))
        turn = np.linspace(0, 2 * np.pi, 360)
        x, y = u + radius * np.cos(turn), v + radius * np.sin(turn)
        if np.mean((x > 0) & (x < width) & (y > 0) & (y < height)) > 0.65:
            return Rim((u, v), (radius, radius * ratio), float(rng.uniform(0, 180)))


def _wall(rng: np.random.Generator, width: int, height: int, folder: Path | None) -> Floats:
    """Return a crop of an environment, a plain wall lit from one side, bars, or checks."""
    kind = rng.integers(4)
    if kind == 0:
        world = environments(folder)[rng.integers(len(environments(folder)))]
        rows, columns, _ = world.shape
        h = int(rng.uniform(0.15, 0.5) * rows)
        w = min(int(h * width / height), columns)
        x, y = rng.integers(0, columns - w + 1), rng.integers(0, rows - h)
        return cv2.resize(
            world[y : y + h, x : x + w], (width, height), interpolation=cv2.INTER_LINEAR
        ).astype(float)
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    lean = rng.uniform(0, np.pi)
    along = u * np.cos(lean) + v * np.sin(lean)
    picture = rng.uniform(10, 230, 3) * (1 + rng.uniform(0, 0.5) * along)[..., None]
    if kind == 1:
        bars = np.zeros((height, width))
        for _ in range(rng.integers(1, 6)):
            at, wide = rng.uniform(-1, 1), rng.uniform(0.01, 0.15)
            bars = np.maximum(bars, np.abs((u if rng.random() < 0.5 else v) - at) < wide)
        picture = picture * (1 - bars[..., None]) + rng.uniform(0, 255, 3) * bars[..., None]
    elif kind == 2:
        cell, across = rng.uniform(0.15, 1.0), v * np.cos(lean) - u * np.sin(lean)
        odd = ((along // cell + across // cell) % 2)[..., None]
        picture = picture * (1 - odd) + rng.uniform(0, 255, 3) * odd
    return picture


def _with_table(rng: np.random.Generator, picture: Floats) -> Floats:
    """Add a straight edge with one or two colours beyond it."""
    height, width, _ = picture.shape
    u, v = np.meshgrid(np.linspace(-1, 1, width), np.linspace(-1, 1, height))
    lean = rng.normal(0, 0.4)
    away = v * np.cos(lean) - u * np.sin(lean) - rng.uniform(-0.5, 0.9)
    for start in (0.0, rng.uniform(0.03, 0.5)):
        picture = np.where(
            (away > start)[..., None], rng.uniform(0, 250, 3) * (1 + 0.3 * u[..., None]), picture
        )
    return picture


def _shadow(rng: np.random.Generator, rim: Rim, width: int, height: int) -> Floats:
    """Return a soft shadow next to the mirror."""
    shift = rng.uniform(-0.3, 0.3, 2) * rim.semi_axes_px[0]
    other = Rim(
        (rim.centre_px[0] + shift[0], rim.centre_px[1] + shift[1]), rim.semi_axes_px, rim.angle_deg
    )
    return cv2.GaussianBlur(
        coverage(other, rng.uniform(0.95, 1.2), width, height), (0, 0), rng.uniform(2, 30)
    )


def _in_frames(rng: np.random.Generator, picture: Floats, rim: Rim, shares: NDArray) -> Floats:
    """Add frames of one colour each, outermost first, lit from one side, with one or two
    highlights."""
    height, width, _ = picture.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    turn = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    for share in shares[::-1]:
        light = 1 + rng.uniform(0, 0.8) * np.cos(turn - rng.uniform(0, 2 * np.pi))
        for _ in range(rng.integers(0, 3)):
            light = light + rng.uniform(0, 4) * np.exp(
                rng.uniform(5, 60) * (np.cos(turn - rng.uniform(0, 6.3)) - 1)
            )
        if rng.random() < 0.15:  # marks or screws
            light = light + rng.uniform(-0.8, 2) * (np.cos(rng.integers(3, 60) * turn) > 0.9)
        colour = (
            rng.uniform(0, 40, 3)
            if rng.random() < 0.6
            else rng.uniform(30, 230) * rng.uniform(0.8, 1.2, 3)
        )
        cover = coverage(rim, share, width, height)[..., None]
        picture = picture * (1 - cover) + light[..., None] * colour * cover
    return picture


def _shone(rng: np.random.Generator, picture: Floats, rim: Rim) -> Floats:
    """Add glare, mostly at the rim."""
    height, width, _ = picture.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    for _ in range(rng.integers(0, 5)):
        turn, out = (
            rng.uniform(0, 2 * np.pi),
            rng.choice([rng.uniform(0.9, 1.15), rng.uniform(0, 1.2)]),
        )
        x, y = (
            c + out * rim.semi_axes_px[0] * f(turn)
            for c, f in zip(rim.centre_px, (np.cos, np.sin), strict=True)
        )
        lean, size = rng.uniform(0, np.pi), rim.semi_axes_px[0] * rng.uniform(0.02, 0.15)
        a = ((u - x) * np.cos(lean) + (v - y) * np.sin(lean)) / size
        b = ((v - y) * np.cos(lean) - (u - x) * np.sin(lean)) / (size * rng.uniform(0.2, 1))
        picture = picture + (rng.uniform(80, 500) * np.exp(-(a**2 + b**2) / 2))[..., None]
    return picture


def _recorded(rng: np.random.Generator, picture: Floats, noise: float) -> ImageArray:
    """Apply blur, noise, clipping and, mostly, JPEG compression."""
    picture = np.clip(picture, 0, 400)
    if rng.random() < 0.6:
        picture = cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.4, 1.6))
    seen = np.clip(picture + rng.normal(0, rng.uniform(0, noise), picture.shape), 0, 255).astype(
        np.uint8
    )
    if rng.random() < 0.7:
        _, data = cv2.imencode(".jpg", seen, [1, int(rng.uniform(60, 97))])
        seen = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return seen
