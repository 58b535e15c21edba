"""Generate images of mirrors with a known outline by four additional methods.

``taken``: a misaligned, decentred sensor renders a scene; the area outside the mirror is black, the directly visible
scene, or clutter. ``housed``: the same with frames and a defocused background. ``pasted``: a finished image of a
sensor, optionally with its black border, is rotated, stretched and pasted on clutter. ``drawn``: a panorama of blocks
is mapped to a disc without ray tracing. All contain saturated discs, outlines cut off by the image border, blur, noise
and JPEG compression. All values are derived from the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from mirror_photographs import Floats, ImageArray, Photograph, Rim, compose, coverage, environments
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.optics.housing import CameraBody, Housing, Rod
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors.as_built import MirrorPose
from omnimirror.simulation.radiometry import Radiometry

SIZES = ((640, 480), (640, 640), (960, 720), (1280, 720), (1024, 1024), (1280, 960))
STANDING = (
    "exact-equidistant",
    "paper-equidistant",
    "paper-hyperboloidal",
    "paper-spherical",
    "paraboloid-telecentric",
    "prototype-hyperboloidal",
    "prototype-spherical",
)
WHITE = np.ones((8, 16, 3), np.float32)


def taken(seed: int, folder: Path | None) -> Photograph:
    """Render an image with a sensor only."""
    rng = np.random.default_rng([1, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    sensor, words = _mounted(rng, width, height)
    past = bool(rng.random() < 0.4)
    radiometry = Radiometry(reflectivity=float(rng.uniform(0.6, 1.0)), direct_view=past)
    light = om.expose(sensor, _scene(rng, folder), samples=2, radiometry=radiometry).astype(float)
    picture = 255 * np.clip(light * rng.uniform(0.6, 1.6), 0, 1) ** (1 / 2.2)
    cover, rim = _mask(sensor)
    if past:
        words += " sees past"
    elif rng.random() < 0.6:
        picture = picture + _clutter(rng, width, height, folder) * (1 - cover[..., None])
        words += " clutter"
    else:
        picture = picture + rng.uniform(0, 25) * (1 - cover[..., None])
        words += " dark"
    return Photograph(_recorded(rng, _glared(rng, picture, rim)), rim, None, words)


def housed(seed: int, folder: Path | None) -> Photograph:
    """Render a mirror in one or two frames with a defocused background; lens images may be
    circular."""
    rng = np.random.default_rng([5, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    sensor, words = _mounted(rng, width, height)
    past = bool(rng.random() < 0.5)
    scene = _scene(rng, folder)
    light = om.expose(sensor, scene, samples=2, radiometry=Radiometry(direct_view=past)).astype(
        float
    )
    picture = 255 * np.clip(light * rng.uniform(0.6, 1.6), 0, 1) ** (1 / 2.2)
    cover, rim = _mask(sensor)
    cover = cover[..., None]
    behind = picture if past else _clutter(rng, width, height, folder)
    behind = cv2.GaussianBlur(behind, (0, 0), rng.uniform(2, 12)) * rng.uniform(0.4, 1.3)
    shares = 1 + np.cumsum(rng.uniform(0.02, 0.17, rng.integers(1, 3)))
    for share in shares[::-1]:
        outer = coverage(rim, share, width, height)[..., None]
        behind = behind * (1 - outer) + _frame(rng, rim, width, height) * outer
        words += f" frame {share:.2f}"
    picture = behind * (1 - cover) + picture * cover
    if rng.random() < 0.3:
        lens = Rim((width / 2, height / 2), (height * rng.uniform(0.65, 0.85),) * 2, 0.0)
        away = cv2.GaussianBlur(coverage(lens, 1.0, width, height), (0, 0), rng.uniform(1, 25))
        picture = picture * away[..., None]
        words += " lens"
    return Photograph(_recorded(rng, _glared(rng, picture, rim)), rim, None, words)


def pasted(seed: int, folder: Path | None) -> Photograph:
    """Rotate and stretch a square sensor image and paste it on clutter, with black, round or no
    surroundings."""
    rng = np.random.default_rng([2, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height)
    square, radius = _square(int(rng.integers(36)), folder)
    middle = (square.shape[0] - 1) / 2
    a, b = rim.semi_axes_px
    lean, turn = np.radians(rim.angle_deg), rng.uniform(0, 2 * np.pi)
    axes = np.array([[np.cos(lean), -np.sin(lean)], [np.sin(lean), np.cos(lean)]])
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    matrix = axes @ np.diag([a, b]) @ axes.T @ spin / radius
    shift = np.asarray(rim.centre_px) - matrix @ [middle, middle]
    affine = np.column_stack([matrix, shift])
    seen = cv2.warpAffine(square, affine, (width, height), flags=cv2.INTER_AREA).astype(float)
    picture, words = (
        _clutter(rng, width, height, folder),
        f"clutter of {rim.semi_axes_px[0]:.0f} px",
    )
    surround = rng.choice(["none", "square", "disc", "ring"], p=[0.35, 0.15, 0.3, 0.2])
    if surround == "square":
        cover = cv2.warpAffine(np.ones(square.shape[:2], np.float32), affine, (width, height))[
            ..., None
        ]
        picture = picture * (1 - cover)
    elif surround in ("disc", "ring"):
        share = rng.uniform(1.02, 1.3)
        cover = coverage(rim, share, width, height)[..., None]
        picture = (
            picture * (1 - cover)
            + (rng.uniform(0, 40) if surround == "disc" else rng.uniform(40, 250, 3)) * cover
        )
        words += f" {share:.2f}"
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + seen * rng.uniform(0.6, 1.3) * cover
    return Photograph(_recorded(rng, _glared(rng, picture, rim)), rim, None, f"{words} {surround}")


def drawn(seed: int, folder: Path | None) -> Photograph:
    """Map a panorama of blocks and lines to a disc."""
    rng = np.random.default_rng([3, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _placed(rng, width, height)
    picture, words = _clutter(rng, width, height, folder), "clutter"
    if rng.random() < 0.3:
        picture, words = np.full((height, width, 3), rng.uniform(0, 60)), "dark"
    if rng.random() < 0.4:
        share, level = rng.uniform(1.03, 1.25), rng.uniform(0, 120, 3)
        cover = coverage(rim, share, width, height)[..., None]
        picture = picture * (1 - cover) + level * cover
        words += f" frame {share:.2f}"
    cover = coverage(rim, 1.0, width, height)[..., None]
    picture = picture * (1 - cover) + _wound(rng, rim, width, height) * cover
    if rng.random() < 0.6:
        cover = coverage(rim, rng.uniform(0.08, 0.3), width, height)[..., None]
        picture = picture * (1 - cover) + rng.uniform(0, 50) * cover
    return Photograph(_recorded(rng, _glared(rng, picture, rim)), rim, None, words)


def nothing(seed: int, folder: Path | None) -> Photograph:
    """Return an image without a mirror: the clutter background only."""
    if seed % 2:
        return compose(100_000 + seed, folder, mirror=False)
    rng = np.random.default_rng([9, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    picture = _clutter(rng, width, height, folder)
    return Photograph(
        _recorded(rng, _glared(rng, picture, _placed(rng, width, height))), None, None, "clutter"
    )


WAYS: dict[str, Callable[[int, Path | None], Photograph]] = {
    "composed": compose,
    "taken": taken,
    "housed": housed,
    "pasted": pasted,
    "drawn": drawn,
}
"""Generators of mirror images by name."""


# -- mirrors -------------------------------------------------------------------------------


def _mounted(rng: np.random.Generator, width: int, height: int) -> tuple[om.Sensor, str]:
    """Return a sensor with a misaligned mirror and a decentred imager."""
    name = STANDING[rng.integers(len(STANDING))]
    sensor = om.load_sensor(name)
    seen = 0.0
    while seen < 0.55:
        radius = height * rng.uniform(0.28, 0.6)
        centre = tuple(
            side / 2 + rng.uniform(-0.5, 0.5) * max(0.12 * side, side - 2 * radius)
            for side in (width, height)
        )
        seen = _seen(width, height, centre, radius)
    pitch = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / radius
    pose = MirrorPose()
    if rng.random() < 0.5 and name != "paraboloid-telecentric":
        pose = MirrorPose(*rng.uniform(-1, 1, 2), 0.0, *rng.uniform(-5, 5, 2))
    housing = Housing(
        CameraBody(float(rng.uniform(20, 60))) if rng.random() < 0.6 else None,
        Rod(float(rng.uniform(2, 6))) if rng.random() < 0.2 and name.startswith("paper") else None,
    )
    imager = Imager(width, height, pitch, centre)
    return replace(sensor, imager=imager, mirror_pose=pose, housing=housing), name


def _frame(rng: np.random.Generator, rim: Rim, width: int, height: int) -> Floats:
    """Render a mostly dark frame with illumination from one side, one or two highlights, and
    optional screws."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    turn = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    light = 1 + rng.uniform(0, 0.7) * np.cos(turn - rng.uniform(0, 2 * np.pi))
    for _ in range(rng.integers(0, 3)):
        light = light + rng.uniform(0, 4) * np.exp(
            rng.uniform(5, 60) * (np.cos(turn - rng.uniform(0, 2 * np.pi)) - 1)
        )
    if rng.random() < 0.2:
        light = light + rng.uniform(0.2, 2) * (np.cos(rng.integers(3, 9) * turn) > 0.985)
    return light[..., None] * (
        rng.uniform(0, 35, 3) if rng.random() < 0.65 else rng.uniform(20, 200, 3)
    )


def _mask(sensor: om.Sensor) -> tuple[Floats, Rim]:
    """Return the mirror coverage of each pixel, and the ellipse at coverage 0.5, from the image of
    a white world."""
    white = om.expose(replace(sensor, housing=Housing()), om.Environment(WHITE), samples=4)[..., 1]
    cover = np.clip(white, 0, 1).astype(float)
    height, width = cover.shape
    large = cv2.resize(cover, None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR)
    contours, _ = cv2.findContours(
        (large > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    points = (max(contours, key=len)[:, 0] + 0.5) / 4 - 0.5
    free = ((points > 1.5) & (points < np.array([width, height]) - 2.5)).all(axis=1)
    (u, v), (a, b), angle = cv2.fitEllipseDirect(points[free].astype(np.float32))
    a, b = (
        (a + 0.125) / 2,
        (b + 0.125) / 2,
    )  # the contour passes through the centres of the outermost pixels
    if a < b:
        a, b, angle = b, a, angle + 90
    return cover, Rim((u, v), (a, b), angle % 180)


@cache
def _square(number: int, folder: Path | None) -> tuple[ImageArray, float]:
    """Return one of the square sensor images, and the radius of its outline."""
    rng = np.random.default_rng([4, number])
    names = om.bundled_sensors()
    sensor = om.load_sensor(names[number % len(names)])
    side = 800
    pitch = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / (0.48 * side)
    sensor = replace(sensor, imager=Imager(side, side, pitch))
    return om.render_image(sensor, _scene(rng, folder), samples=2), 0.48 * side


def _scene(rng: np.random.Generator, folder: Path | None) -> om.Scene:
    kind = rng.integers(4)
    if kind == 3:
        world = environments(folder)[rng.integers(len(environments(folder)))]
        return om.Environment(
            (np.roll(world, rng.integers(world.shape[1]), axis=1) / 255.0).astype(np.float32) ** 2.2
        )
    reach = (1200, 1500, 2000)[kind]
    x, y = rng.uniform(-reach, reach, 2)
    return om.PosedScene(
        _known(("room", "street", "hall")[kind]), om.Pose(x, y, 0.0, pan_deg=rng.uniform(0, 360))
    )


@cache
def _known(name: str) -> om.Scene:
    return om.load_scene(name, texel_mm=10.0)


def _wound(rng: np.random.Generator, rim: Rim, width: int, height: int) -> Floats:
    """Map a panorama to polar coordinates about the outline centre, with its top at the outside."""
    panorama = np.zeros((360, 1440, 3), np.uint8)
    panorama[:140] = rng.uniform(60, 255, 3)
    panorama[140:] = rng.uniform(20, 200, 3)
    for _ in range(rng.integers(15, 80)):
        x, y = int(rng.uniform(0, 1440)), int(rng.uniform(0, 360))
        w, h = int(rng.uniform(4, 160)), int(rng.uniform(4, 160))
        cv2.rectangle(
            panorama,
            (x, y),
            (x + w, y + h),
            tuple(rng.uniform(0, 255, 3)),
            int(rng.choice([-1, -1, 2])),
        )
    if rng.random() < 0.3:
        panorama[:140] = panorama[:140] // 4 + np.uint8(180)  # bright, low-contrast sky
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    lean = np.radians(rim.angle_deg)
    x, y = u - rim.centre_px[0], v - rim.centre_px[1]
    along = (x * np.cos(lean) + y * np.sin(lean)) / rim.semi_axes_px[0]
    across = (y * np.cos(lean) - x * np.sin(lean)) / rim.semi_axes_px[1]
    away, turn = np.hypot(along, across), np.arctan2(across, along) + lean
    row = 358 * (1 - np.clip(away, 0, 1.05) ** rng.uniform(0.8, 2.0))
    column = (turn / (2 * np.pi) % 1) * 1439
    return (
        cv2.remap(
            panorama,
            column.astype(np.float32),
            np.clip(row, 0, 359).astype(np.float32),
            cv2.INTER_LINEAR,
        )
        * 1.0
    )


# -- surroundings --------------------------------------------------------------------------


def _placed(rng: np.random.Generator, width: int, height: int) -> Rim:
    """Draw an ellipse inside the image, or cut on one or two sides, with more than half of its
    outline visible."""
    while True:
        radius = height * rng.uniform(0.25, 0.6)
        ratio = 1.0 if rng.random() < 0.5 else rng.uniform(0.93, 1.0)
        u, v = width * rng.uniform(0.15, 0.85), height * rng.uniform(0.15, 0.85)
        if _seen(width, height, (u, v), radius) > (0.999 if rng.random() < 0.5 else 0.68):
            return Rim((u, v), (radius, radius * ratio), float(rng.uniform(0, 180)))


def _seen(width: int, height: int, centre: tuple[float, float], radius: float) -> float:
    """Return the fraction of a circle inside the image."""
    turn = np.linspace(0, 2 * np.pi, 360)
    x, y = centre[0] + radius * np.cos(turn), centre[1] + radius * np.sin(turn)
    return float(np.mean((x > 0) & (x < width) & (y > 0) & (y < height)))


def _clutter(rng: np.random.Generator, width: int, height: int, folder: Path | None) -> Floats:
    """Return a crop of an environment, noise clouds, tiles, or blocks and rings."""
    kind = rng.integers(4)
    if kind == 0:
        world = environments(folder)[rng.integers(len(environments(folder)))]
        h = int(rng.uniform(0.2, 0.48) * world.shape[0])
        w = int(h * width / height)
        x, y = (
            rng.integers(0, world.shape[1] - w),
            rng.integers(world.shape[0] // 4, world.shape[0] // 2),
        )
        picture = cv2.resize(
            world[y : y + h, x : x + w], (width, height), interpolation=cv2.INTER_CUBIC
        ).astype(float)
    elif kind == 1:
        picture = np.full((height, width, 3), 110.0)
        for cells in (4, 9, 20, 50, 120):
            rough = rng.normal(0, rng.uniform(5, 45), (cells, int(cells * width / height), 3))
            picture += cv2.resize(rough, (width, height), interpolation=cv2.INTER_CUBIC)
    elif kind == 2:
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        turn, cell = rng.uniform(0, np.pi), rng.uniform(20, 120)
        x, y = u * np.cos(turn) + v * np.sin(turn), v * np.cos(turn) - u * np.sin(turn)
        odd = ((x // cell + y // (cell * rng.uniform(0.5, 1.5))) % 2)[..., None]
        picture = odd * rng.uniform(0, 255, 3) + (1 - odd) * rng.uniform(0, 255, 3)
    else:
        picture = np.full((height, width, 3), rng.uniform(0, 255))
    canvas = np.clip(picture, 0, 255).astype(np.uint8)
    for _ in range(rng.integers(0, 40 if kind == 3 else 10)):
        colour, at = (
            tuple(rng.uniform(0, 255, 3)),
            (int(rng.uniform(0, width)), int(rng.uniform(0, height))),
        )
        size = int(rng.uniform(0.02, 0.3) * height)
        line = int(rng.choice([-1, -1, 2, 6]))
        if rng.random() < 0.4:
            cv2.circle(canvas, at, size, colour, line, cv2.LINE_AA)
        elif rng.random() < 0.5:
            cv2.rectangle(
                canvas, at, (at[0] + size, at[1] + int(size * rng.uniform(0.3, 2))), colour, line
            )
        else:
            end = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
            cv2.line(canvas, at, end, colour, int(rng.uniform(1, 15)), cv2.LINE_AA)
    return canvas.astype(float) * rng.uniform(0.5, 1.0)


def _glared(rng: np.random.Generator, picture: NDArray, rim: Rim) -> Floats:
    """Add saturated discs, hard or with a halo, in the mirror and at its rim."""
    height, width, _ = picture.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    radius = rim.semi_axes_px[0]
    for _ in range(rng.integers(0, 6)):
        turn, out = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1.15)
        x, y = (
            rim.centre_px[0] + out * radius * np.cos(turn),
            rim.centre_px[1] + out * radius * np.sin(turn),
        )
        size = radius * rng.uniform(0.02, 0.18)
        away = np.hypot(u - x, v - y)
        shine = np.clip(size - away + 0.5, 0, 1) * 255 if rng.random() < 0.5 else 0.0
        halo = rng.uniform(50, 300) * np.exp(-((away / (1.3 * size)) ** 2))
        picture = picture + (shine + halo)[..., None]
    return picture


def _recorded(rng: np.random.Generator, picture: Floats) -> ImageArray:
    if rng.random() < 0.6:
        picture = cv2.GaussianBlur(np.clip(picture, 0, 400), (0, 0), rng.uniform(0.4, 2.0))
    noisy = np.clip(picture + rng.normal(0, rng.uniform(0, 9), picture.shape), 0, 255).astype(
        np.uint8
    )
    if rng.random() < 0.6:
        _, data = cv2.imencode(".jpg", noisy, [1, int(rng.uniform(50, 97))])
        noisy = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return noisy
