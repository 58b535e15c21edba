"""Generate images of mirrors with a known outline by four additional methods.

``rendered``: a misaligned, decentred sensor renders a scene; the area outside the mirror is black,
the directly visible scene, or clutter. ``framed``: the same with frames and a defocused background.
``pasted``: a finished image of a sensor, optionally with its black border, is rotated, stretched
and pasted on clutter. ``synthetic``: a panorama of blocks is mapped to a disc without ray tracing.
All contain saturated discs, outlines cut off by the image border, blur, noise and JPEG compression.
All values are derived from the seed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
from mirror_composites import (
    Floats,
    ImageArray,
    LabelledImage,
    TrueOutline,
    compose,
    coverage,
    environments,
)
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.optics.housing import CameraBody, Housing, Rod
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.scenes.scene import Scene

SIZES = ((640, 480), (640, 640), (960, 720), (1280, 720), (1024, 1024), (1280, 960))
SENSORS = (
    "exact-equidistant",
    "paper-equidistant",
    "paper-hyperboloidal",
    "paper-spherical",
    "paraboloid-telecentric",
    "prototype-hyperboloidal",
    "prototype-spherical",
)
WHITE = np.ones((8, 16, 3), np.float32)


def rendered(seed: int, folder: Path | None) -> LabelledImage:
    """Render an image with a sensor only."""
    rng = np.random.default_rng([1, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    sensor, description = _misaligned_sensor(rng, width, height)
    direct_view = bool(rng.random() < 0.4)
    radiometry = Radiometry(reflectivity=float(rng.uniform(0.6, 1.0)), direct_view=direct_view)
    radiance = om.expose(sensor, _scene(rng, folder), samples=2, radiometry=radiometry).astype(
        float
    )
    image = 255 * np.clip(radiance * rng.uniform(0.6, 1.6), 0, 1) ** (1 / 2.2)
    mask, rim = _mask(sensor)
    if direct_view:
        description += " direct view"
    elif rng.random() < 0.6:
        image = image + _clutter(rng, width, height, folder) * (1 - mask[..., None])
        description += " clutter"
    else:
        image = image + rng.uniform(0, 25) * (1 - mask[..., None])
        description += " dark"
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim)), rim, None, description)


def framed(seed: int, folder: Path | None) -> LabelledImage:
    """Render a mirror in one or two frames with a defocused background; lens images may be
    circular."""
    rng = np.random.default_rng([5, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    sensor, description = _misaligned_sensor(rng, width, height)
    direct_view = bool(rng.random() < 0.5)
    scene = _scene(rng, folder)
    radiance = om.expose(
        sensor, scene, samples=2, radiometry=Radiometry(direct_view=direct_view)
    ).astype(float)
    image = 255 * np.clip(radiance * rng.uniform(0.6, 1.6), 0, 1) ** (1 / 2.2)
    mask, rim = _mask(sensor)
    mask = mask[..., None]
    background = image if direct_view else _clutter(rng, width, height, folder)
    background = cv2.GaussianBlur(background, (0, 0), rng.uniform(2, 12)) * rng.uniform(0.4, 1.3)
    scales = 1 + np.cumsum(rng.uniform(0.02, 0.17, rng.integers(1, 3)))
    for scale in scales[::-1]:
        outer = coverage(rim, scale, width, height)[..., None]
        background = background * (1 - outer) + _frame(rng, rim, width, height) * outer
        description += f" frame {scale:.2f}"
    image = background * (1 - mask) + image * mask
    if rng.random() < 0.3:
        lens = TrueOutline((width / 2, height / 2), (height * rng.uniform(0.65, 0.85),) * 2, 0.0)
        distance = cv2.GaussianBlur(coverage(lens, 1.0, width, height), (0, 0), rng.uniform(1, 25))
        image = image * distance[..., None]
        description += " lens"
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim)), rim, None, description)


def pasted(seed: int, folder: Path | None) -> LabelledImage:
    """Rotate and stretch a square sensor image and paste it on clutter, with black, round or no
    surroundings."""
    rng = np.random.default_rng([2, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height)
    source, radius = _square(int(rng.integers(36)), folder)
    centre = (source.shape[0] - 1) / 2
    a, b = rim.semi_axes_px
    orientation, angle = np.radians(rim.angle_deg), rng.uniform(0, 2 * np.pi)
    axes = np.array(
        [[np.cos(orientation), -np.sin(orientation)], [np.sin(orientation), np.cos(orientation)]]
    )
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    matrix = axes @ np.diag([a, b]) @ axes.T @ rotation / radius
    shift = np.asarray(rim.centre_px) - matrix @ [centre, centre]
    affine = np.column_stack([matrix, shift])
    visible = cv2.warpAffine(source, affine, (width, height), flags=cv2.INTER_AREA).astype(float)
    image, description = (
        _clutter(rng, width, height, folder),
        f"clutter of {rim.semi_axes_px[0]:.0f} px",
    )
    border = rng.choice(["none", "square", "disc", "ring"], p=[0.35, 0.15, 0.3, 0.2])
    if border == "square":
        mask = cv2.warpAffine(np.ones(source.shape[:2], np.float32), affine, (width, height))[
            ..., None
        ]
        image = image * (1 - mask)
    elif border in ("disc", "ring"):
        scale = rng.uniform(1.02, 1.3)
        mask = coverage(rim, scale, width, height)[..., None]
        image = (
            image * (1 - mask)
            + (rng.uniform(0, 40) if border == "disc" else rng.uniform(40, 250, 3)) * mask
        )
        description += f" {scale:.2f}"
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + visible * rng.uniform(0.6, 1.3) * mask
    return LabelledImage(
        _degrade(rng, _add_glare(rng, image, rim)), rim, None, f"{description} {border}"
    )


def synthetic(seed: int, folder: Path | None) -> LabelledImage:
    """Map a panorama of blocks and lines to a disc."""
    rng = np.random.default_rng([3, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    rim = _random_outline(rng, width, height)
    image, description = _clutter(rng, width, height, folder), "clutter"
    if rng.random() < 0.3:
        image, description = np.full((height, width, 3), rng.uniform(0, 60)), "dark"
    if rng.random() < 0.4:
        scale, level = rng.uniform(1.03, 1.25), rng.uniform(0, 120, 3)
        mask = coverage(rim, scale, width, height)[..., None]
        image = image * (1 - mask) + level * mask
        description += f" frame {scale:.2f}"
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + _polar_panorama(rng, rim, width, height) * mask
    if rng.random() < 0.6:
        mask = coverage(rim, rng.uniform(0.08, 0.3), width, height)[..., None]
        image = image * (1 - mask) + rng.uniform(0, 50) * mask
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim)), rim, None, description)


def without_mirror(seed: int, folder: Path | None) -> LabelledImage:
    """Return an image without a mirror: the clutter background only."""
    if seed % 2:
        return compose(100_000 + seed, folder, mirror=False)
    rng = np.random.default_rng([9, seed])
    width, height = SIZES[rng.integers(len(SIZES))]
    image = _clutter(rng, width, height, folder)
    return LabelledImage(
        _degrade(rng, _add_glare(rng, image, _random_outline(rng, width, height))),
        None,
        None,
        "clutter",
    )


GENERATORS: dict[str, Callable[[int, Path | None], LabelledImage]] = {
    "composite": compose,
    "rendered": rendered,
    "framed": framed,
    "pasted": pasted,
    "synthetic": synthetic,
}
"""Generators of mirror images by name."""


# -- mirrors -------------------------------------------------------------------------------


def _misaligned_sensor(rng: np.random.Generator, width: int, height: int) -> tuple[om.Sensor, str]:
    """Return a sensor with a misaligned mirror and a decentred imager."""
    name = SENSORS[rng.integers(len(SENSORS))]
    sensor = om.load_sensor(name)
    visible = 0.0
    while visible < 0.55:
        radius = height * rng.uniform(0.28, 0.6)
        centre = tuple(
            size_px / 2 + rng.uniform(-0.5, 0.5) * max(0.12 * size_px, size_px - 2 * radius)
            for size_px in (width, height)
        )
        visible = _visible_fraction(width, height, centre, radius)
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


def _frame(rng: np.random.Generator, rim: TrueOutline, width: int, height: int) -> Floats:
    """Render a mostly dark frame with illumination from one side, one or two highlights, and
    optional screws."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    radiance = 1 + rng.uniform(0, 0.7) * np.cos(angle - rng.uniform(0, 2 * np.pi))
    for _ in range(rng.integers(0, 3)):
        radiance = radiance + rng.uniform(0, 4) * np.exp(
            rng.uniform(5, 60) * (np.cos(angle - rng.uniform(0, 2 * np.pi)) - 1)
        )
    if rng.random() < 0.2:
        radiance = radiance + rng.uniform(0.2, 2) * (np.cos(rng.integers(3, 9) * angle) > 0.985)
    return radiance[..., None] * (
        rng.uniform(0, 35, 3) if rng.random() < 0.65 else rng.uniform(20, 200, 3)
    )


def _mask(sensor: om.Sensor) -> tuple[Floats, TrueOutline]:
    """Return the mirror coverage of each pixel, and the ellipse at coverage 0.5, from the image of
    a white world."""
    white = om.expose(replace(sensor, housing=Housing()), om.Environment(WHITE), samples=4)[..., 1]
    mask = np.clip(white, 0, 1).astype(float)
    height, width = mask.shape
    large = cv2.resize(mask, None, fx=4, fy=4, interpolation=cv2.INTER_LINEAR)
    contours, _ = cv2.findContours(
        (large > 0.5).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
    )
    points = (max(contours, key=len)[:, 0] + 0.5) / 4 - 0.5
    interior = ((points > 1.5) & (points < np.array([width, height]) - 2.5)).all(axis=1)
    (u, v), (a, b), angle = cv2.fitEllipseDirect(points[interior].astype(np.float32))
    a, b = (
        (a + 0.125) / 2,
        (b + 0.125) / 2,
    )  # the contour passes through the centres of the outermost pixels
    if a < b:
        a, b, angle = b, a, angle + 90
    return mask, TrueOutline((u, v), (a, b), angle % 180)


@cache
def _square(number: int, folder: Path | None) -> tuple[ImageArray, float]:
    """Return one of the square sensor images, and the radius of its outline."""
    rng = np.random.default_rng([4, number])
    names = om.bundled_sensors()
    sensor = om.load_sensor(names[number % len(names)])
    size_px = 800
    pitch = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / (0.48 * size_px)
    sensor = replace(sensor, imager=Imager(size_px, size_px, pitch))
    return om.render_image(sensor, _scene(rng, folder), samples=2), 0.48 * size_px


def _scene(rng: np.random.Generator, folder: Path | None) -> Scene:
    kind = rng.integers(4)
    if kind == 3:
        environment = environments(folder)[rng.integers(len(environments(folder)))]
        return om.Environment(
            (np.roll(environment, rng.integers(environment.shape[1]), axis=1) / 255.0).astype(
                np.float32
            )
            ** 2.2
        )
    max_offset_mm = (1200, 1500, 2000)[kind]
    x, y = rng.uniform(-max_offset_mm, max_offset_mm, 2)
    return om.PosedScene(
        _bundled_scene(("room", "street", "hall")[kind]),
        om.Pose(x, y, 0.0, pan_deg=rng.uniform(0, 360)),
    )


@cache
def _bundled_scene(name: str) -> Scene:
    return om.load_scene(name, texel_mm=10.0)


def _polar_panorama(rng: np.random.Generator, rim: TrueOutline, width: int, height: int) -> Floats:
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
    orientation = np.radians(rim.angle_deg)
    x, y = u - rim.centre_px[0], v - rim.centre_px[1]
    along = (x * np.cos(orientation) + y * np.sin(orientation)) / rim.semi_axes_px[0]
    across = (y * np.cos(orientation) - x * np.sin(orientation)) / rim.semi_axes_px[1]
    distance, angle = np.hypot(along, across), np.arctan2(across, along) + orientation
    row = 358 * (1 - np.clip(distance, 0, 1.05) ** rng.uniform(0.8, 2.0))
    column = (angle / (2 * np.pi) % 1) * 1439
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


def _random_outline(rng: np.random.Generator, width: int, height: int) -> TrueOutline:
    """Draw an ellipse inside the image, or cut on one or two sides, with more than half of its
    outline visible."""
    while True:
        radius = height * rng.uniform(0.25, 0.6)
        ratio = 1.0 if rng.random() < 0.5 else rng.uniform(0.93, 1.0)
        u, v = width * rng.uniform(0.15, 0.85), height * rng.uniform(0.15, 0.85)
        if _visible_fraction(width, height, (u, v), radius) > (
            0.999 if rng.random() < 0.5 else 0.68
        ):
            return TrueOutline((u, v), (radius, radius * ratio), float(rng.uniform(0, 180)))


def _visible_fraction(width: int, height: int, centre: tuple[float, float], radius: float) -> float:
    """Return the fraction of a circle inside the image."""
    angle = np.linspace(0, 2 * np.pi, 360)
    x, y = centre[0] + radius * np.cos(angle), centre[1] + radius * np.sin(angle)
    return float(np.mean((x > 0) & (x < width) & (y > 0) & (y < height)))


def _clutter(rng: np.random.Generator, width: int, height: int, folder: Path | None) -> Floats:
    """Return a crop of an environment, noise clouds, tiles, or blocks and rings."""
    kind = rng.integers(4)
    if kind == 0:
        environment = environments(folder)[rng.integers(len(environments(folder)))]
        h = int(rng.uniform(0.2, 0.48) * environment.shape[0])
        w = int(h * width / height)
        x, y = (
            rng.integers(0, environment.shape[1] - w),
            rng.integers(environment.shape[0] // 4, environment.shape[0] // 2),
        )
        image = cv2.resize(
            environment[y : y + h, x : x + w], (width, height), interpolation=cv2.INTER_CUBIC
        ).astype(float)
    elif kind == 1:
        image = np.full((height, width, 3), 110.0)
        for cells in (4, 9, 20, 50, 120):
            noise = rng.normal(0, rng.uniform(5, 45), (cells, int(cells * width / height), 3))
            image += cv2.resize(noise, (width, height), interpolation=cv2.INTER_CUBIC)
    elif kind == 2:
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        angle, cell = rng.uniform(0, np.pi), rng.uniform(20, 120)
        x, y = u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle)
        odd_tiles = ((x // cell + y // (cell * rng.uniform(0.5, 1.5))) % 2)[..., None]
        image = odd_tiles * rng.uniform(0, 255, 3) + (1 - odd_tiles) * rng.uniform(0, 255, 3)
    else:
        image = np.full((height, width, 3), rng.uniform(0, 255))
    canvas = np.clip(image, 0, 255).astype(np.uint8)
    for _ in range(rng.integers(0, 40 if kind == 3 else 10)):
        colour, position = (
            tuple(rng.uniform(0, 255, 3)),
            (int(rng.uniform(0, width)), int(rng.uniform(0, height))),
        )
        size = int(rng.uniform(0.02, 0.3) * height)
        thickness = int(rng.choice([-1, -1, 2, 6]))
        if rng.random() < 0.4:
            cv2.circle(canvas, position, size, colour, thickness, cv2.LINE_AA)
        elif rng.random() < 0.5:
            cv2.rectangle(
                canvas,
                position,
                (position[0] + size, position[1] + int(size * rng.uniform(0.3, 2))),
                colour,
                thickness,
            )
        else:
            end = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
            cv2.line(canvas, position, end, colour, int(rng.uniform(1, 15)), cv2.LINE_AA)
    return canvas.astype(float) * rng.uniform(0.5, 1.0)


def _add_glare(rng: np.random.Generator, image: NDArray, rim: TrueOutline) -> Floats:
    """Add saturated discs, hard or with a halo, in the mirror and at its rim."""
    height, width, _ = image.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    radius = rim.semi_axes_px[0]
    for _ in range(rng.integers(0, 6)):
        angle, radius_ratio = rng.uniform(0, 2 * np.pi), rng.uniform(0, 1.15)
        x, y = (
            rim.centre_px[0] + radius_ratio * radius * np.cos(angle),
            rim.centre_px[1] + radius_ratio * radius * np.sin(angle),
        )
        size = radius * rng.uniform(0.02, 0.18)
        distance = np.hypot(u - x, v - y)
        highlight = np.clip(size - distance + 0.5, 0, 1) * 255 if rng.random() < 0.5 else 0.0
        halo = rng.uniform(50, 300) * np.exp(-((distance / (1.3 * size)) ** 2))
        image = image + (highlight + halo)[..., None]
    return image


def _degrade(rng: np.random.Generator, image: Floats) -> ImageArray:
    if rng.random() < 0.6:
        image = cv2.GaussianBlur(np.clip(image, 0, 400), (0, 0), rng.uniform(0.4, 2.0))
    noisy = np.clip(image + rng.normal(0, rng.uniform(0, 9), image.shape), 0, 255).astype(np.uint8)
    if rng.random() < 0.6:
        _, data = cv2.imencode(".jpg", noisy, [1, int(rng.uniform(50, 97))])
        noisy = cv2.imdecode(data, cv2.IMREAD_COLOR)
    return noisy
