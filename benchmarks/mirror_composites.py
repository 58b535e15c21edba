"""Generate composite images of mirrors with a known outline.

The image of an environment in a sensor is transformed to an ellipse in a larger image, possibly beyond its border, with
or without a plain frame, on a dark, plain or cluttered background, with the image of the camera in its centre. Glare,
uneven illumination, blur, noise and JPEG compression are added. All values are derived from the seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

import omnimirror as om
from omnimirror.cameras.camera import pan_tilt_direction
from omnimirror.io import read_image
from omnimirror.simulation.rendering import render_pinhole_image

ImageArray = NDArray[np.uint8]
Floats = NDArray[np.float64]

SIZES = ((640, 480), (800, 600), (720, 720), (1024, 768), (1280, 720))
ENVIRONMENTS = ("pannellum_examplepano.jpg", "st_fagans_interior_1k.hdr", "venice_sunset_1k.hdr")


class TrueOutline(NamedTuple):
    """True mirror outline."""

    centre_px: tuple[float, float]
    semi_axes_px: tuple[float, float]
    angle_deg: float


@dataclass(frozen=True)
class LabelledImage:
    """Composed photograph with its ground truth."""

    image: ImageArray
    rim: TrueOutline | None
    inner_px: float | None
    description: str


@cache
def environments(folder: Path | None) -> tuple[ImageArray, ...]:
    """Return equirectangular images: photographs in a folder, or scenes of the project."""
    if folder is not None:
        return tuple(_to_uint8(read_image(folder / name)) for name in ENVIRONMENTS)
    pan, tilt = np.meshgrid(
        np.linspace(np.pi, -np.pi, 512), np.linspace(np.pi / 2, -np.pi / 2, 256)
    )
    scenes = (om.load_scene("room", texel_mm=20.0), om.load_scene("street", texel_mm=40.0))
    return tuple(render_pinhole_image(scene, pan_tilt_direction(pan, tilt)) for scene in scenes)


def compose(seed: int, folder: Path | None, *, mirror: bool = True) -> LabelledImage:
    """Compose the photograph of a seed; without a mirror, only its background."""
    rng = np.random.default_rng(seed)
    width, height = SIZES[rng.integers(len(SIZES))]
    environment = environments(folder)[rng.integers(len(environments(folder)))]
    image, description = _background(rng, width, height, environment)
    rim, inner = None, None
    if mirror:
        rim = _random_outline(rng, width, height)
        image, inner, mirror_description = _add_mirror(rng, image, rim, environment)
        description += mirror_description
    else:
        image = _add_glare(rng, image, _random_outline(rng, width, height))
        return LabelledImage(_degrade(rng, image), None, None, description)
    return LabelledImage(_degrade(rng, _add_glare(rng, image, rim)), rim, inner, description)


def outline_error(rim: om.MirrorOutline, true: TrueOutline) -> float:
    """Return the largest error of both semi-axes and of the centre, relative to the radius."""
    (a, b), (c, d) = rim.semi_axes_px, true.semi_axes_px
    distance = np.hypot(*np.subtract(rim.centre_px, true.centre_px)) / np.sqrt(c * d)
    return float(max(abs(a / c - 1), abs(b / d - 1), distance))


# -- components ---------------------------------------------------------------------------


def _random_outline(rng: np.random.Generator, width: int, height: int) -> TrueOutline:
    """Draw an ellipse with an axis ratio of 0.95 to 1 and at least 67 % of its outline inside the
    image."""
    while True:
        radius = height * rng.uniform(0.24, 0.62)
        ratio = rng.uniform(0.95, 1.0) if rng.random() < 0.6 else 1.0
        u, v = rng.uniform(0, width), rng.uniform(0, height)
        if rng.random() < 0.5:
            u, v = (
                width / 2 + rng.normal(0, 0.03 * width),
                height / 2 + rng.normal(0, 0.03 * height),
            )
        rim = TrueOutline((u, v), (radius, radius * ratio), float(rng.uniform(0, 180)))
        angle = np.linspace(0, 2 * np.pi, 360)
        x, y = u + radius * np.cos(angle), v + radius * np.sin(angle)
        if np.mean((x > 0) & (x < width) & (y > 0) & (y < height)) > 0.68:
            return rim


def _background(
    rng: np.random.Generator, width: int, height: int, environment: ImageArray
) -> tuple[Floats, str]:
    kind = rng.choice(["dark", "plain", "clutter"], p=[0.25, 0.1, 0.65])
    if kind == "dark":
        return np.full((height, width, 3), rng.uniform(0, 30)) + rng.uniform(0, 6, 3), "dark"
    if kind == "plain":
        return np.full((height, width, 3), 1.0) * rng.uniform(30, 230, 3), "plain"
    image = _random_view(rng, environment, width, height) * rng.uniform(0.4, 1.1)
    for _ in range(rng.integers(0, 12)):
        colour = tuple(rng.uniform(0, 255, 3))
        position = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
        size = int(rng.uniform(0.03, 0.25) * height)
        match rng.integers(3):
            case 0:
                cv2.circle(image, position, size, colour, int(rng.choice([-1, 2, 5])), cv2.LINE_AA)
            case 1:
                corner = (position[0] + size, position[1] + int(size * rng.uniform(0.3, 3)))
                cv2.rectangle(
                    image, position, corner, colour, int(rng.choice([-1, 3])), cv2.LINE_AA
                )
            case _:
                end = (int(rng.uniform(0, width)), int(rng.uniform(0, height)))
                cv2.line(image, position, end, colour, int(rng.uniform(1, 12)), cv2.LINE_AA)
    if rng.random() < 0.5:
        image = cv2.GaussianBlur(image, (0, 0), rng.uniform(0.5, 5))
    return image, "clutter"


def _random_view(
    rng: np.random.Generator, environment: ImageArray, width: int, height: int
) -> Floats:
    """Render a perspective view of the environment in a random direction."""
    rows, columns, _ = environment.shape
    half = np.tan(np.radians(rng.uniform(25, 50)))
    u, v = np.meshgrid(
        np.linspace(-half, half, width), np.linspace(-half, half, height) * height / width
    )
    tilt, pan = rng.uniform(-0.6, 0.6), rng.uniform(0, 2 * np.pi)
    up, forward = np.sin(tilt) - v * np.cos(tilt), np.cos(tilt) + v * np.sin(tilt)
    longitude = np.arctan2(u, forward) + pan
    latitude = np.arctan2(up, np.hypot(u, forward))
    x = (longitude / (2 * np.pi) % 1.0) * (columns - 1)
    y = (0.5 - latitude / np.pi) * (rows - 1)
    rendered = cv2.remap(
        environment,
        x.astype(np.float32),
        y.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )
    return rendered.astype(float)


def _add_mirror(
    rng: np.random.Generator, image: Floats, rim: TrueOutline, environment: ImageArray
) -> tuple[Floats, float | None, str]:
    height, width, _ = image.shape
    reflected = _render_reflection(rng, rim, environment, width, height)
    description = ""
    frames = rng.choice([0, 1, 2], p=[0.4, 0.4, 0.2])
    outer = 1.0 + np.cumsum(rng.uniform(0.02, 0.2, frames))
    for scale in outer[::-1]:
        shift = rng.normal(0, 0.003, 2) * rim.semi_axes_px[0]
        ring = TrueOutline(
            (rim.centre_px[0] + shift[0], rim.centre_px[1] + shift[1]),
            rim.semi_axes_px,
            rim.angle_deg,
        )
        mask = coverage(ring, scale, width, height)[..., None]
        image = image * (1 - mask) + _render_frame(rng, rim, width, height) * mask
        description += f" frame {scale:.2f}"
    mask = coverage(rim, 1.0, width, height)[..., None]
    image = image * (1 - mask) + reflected * mask
    inner = None
    if rng.random() < 0.7:
        scale = rng.uniform(0.06, 0.25)
        mask = coverage(rim, scale, width, height)[..., None]
        image = image * (1 - mask) + rng.uniform(0, 60) * mask
        inner = scale * float(np.mean(rim.semi_axes_px))
        description += f" camera {scale:.2f}"
    return image, inner, description


def _render_reflection(
    rng: np.random.Generator, rim: TrueOutline, environment: ImageArray, width: int, height: int
) -> Floats:
    """Render the environment with a bundled sensor, stretched to the given outline."""
    names = om.bundled_sensors()
    sensor = om.load_sensor(names[rng.integers(len(names))])
    size_px = int(min(2 * rim.semi_axes_px[0], 700))
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / size_px
    imager = replace(
        sensor.imager, width_px=size_px, height_px=size_px, pixel_pitch_um=pitch, centre_px=None
    )
    small = replace(sensor, imager=imager)
    rotated = np.roll(environment, rng.integers(environment.shape[1]), axis=1)
    scene = om.Environment((rotated / 255.0).astype(np.float32) ** 2.2)
    rendered = om.render_image(small, scene, samples=2).astype(float)
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    along, across = _ellipse_coordinates(rim, u, v)
    scale = small.rim_radius_px * 0.994  # excludes pixels at the rim, which are partly black
    centre = (size_px - 1) / 2
    angle = np.radians(rim.angle_deg)  # inverse rotation, keeps the image upright
    x, y = (
        along * np.cos(angle) - across * np.sin(angle),
        along * np.sin(angle) + across * np.cos(angle),
    )
    x, y = (centre + scale * x).astype(np.float32), (centre + scale * y).astype(np.float32)
    return cv2.remap(rendered, x, y, cv2.INTER_LINEAR) * rng.uniform(0.5, 1.2)


def _ellipse_coordinates(rim: TrueOutline, u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """Return pixels in coordinates of the ellipse axes, normalised to distance 1 on the outline."""
    angle = np.radians(rim.angle_deg)
    x, y = u - rim.centre_px[0], v - rim.centre_px[1]
    a, b = rim.semi_axes_px
    return (x * np.cos(angle) + y * np.sin(angle)) / a, (y * np.cos(angle) - x * np.sin(angle)) / b


def coverage(rim: TrueOutline, scale: float, width: int, height: int) -> Floats:
    """Return the coverage of each pixel by the ellipse, enlarged by a factor."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    along, across = _ellipse_coordinates(rim, u, v)
    distance = (scale - np.hypot(along, across)) * np.mean(rim.semi_axes_px)
    return np.clip(distance + 0.5, 0.0, 1.0)


def _render_frame(rng: np.random.Generator, rim: TrueOutline, width: int, height: int) -> Floats:
    """Render a frame of one colour with illumination from one side and a highlight."""
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    angle = np.arctan2(v - rim.centre_px[1], u - rim.centre_px[0])
    colour = rng.uniform(0, 50, 3) if rng.random() < 0.6 else rng.uniform(40, 220, 3)
    light = 1 + rng.uniform(0, 0.5) * np.cos(angle - rng.uniform(0, 2 * np.pi))
    shine = rng.uniform(0, 150) * np.exp(20 * (np.cos(angle - rng.uniform(0, 2 * np.pi)) - 1))
    return colour * light[..., None] + shine[..., None]


def _add_glare(rng: np.random.Generator, image: Floats, rim: TrueOutline) -> Floats:
    """Add glare, mostly at the rim, and illumination that decreases towards one side."""
    height, width, _ = image.shape
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    radius = rim.semi_axes_px[0]
    for _ in range(rng.integers(0, 5)):
        angle, radius_ratio = (
            rng.uniform(0, 2 * np.pi),
            rng.choice([rng.uniform(0.9, 1.1), rng.uniform(0, 1.3)]),
        )
        x, y = (
            rim.centre_px[0] + radius_ratio * radius * np.cos(angle),
            rim.centre_px[1] + radius_ratio * radius * np.sin(angle),
        )
        size = radius * rng.uniform(0.02, 0.15)
        blob = rng.uniform(100, 600) * np.exp(-((u - x) ** 2 + (v - y) ** 2) / (2 * size**2))
        image = image + blob[..., None]
    if rng.random() < 0.4:
        angle, gradient = rng.uniform(0, 2 * np.pi), rng.uniform(0.2, 0.7)
        along = (u / width - 0.5) * np.cos(angle) + (v / height - 0.5) * np.sin(angle)
        image = image * (1 - gradient * (along + 0.5))[..., None]
    return image


def _degrade(rng: np.random.Generator, image: Floats) -> ImageArray:
    """Apply blur, noise, clipping and JPEG compression."""
    if (blur := rng.uniform(0, 1.4)) > 0.3:
        image = cv2.GaussianBlur(image, (0, 0), blur)
    noisy = image + rng.normal(0, rng.uniform(0, 6), image.shape)
    _, data = cv2.imencode(
        ".jpg", np.clip(noisy, 0, 255).astype(np.uint8), [1, int(rng.uniform(60, 95))]
    )
    return cv2.imdecode(data, cv2.IMREAD_COLOR)


def _to_uint8(image: NDArray) -> ImageArray:
    """Convert an environment to 8 bits with the tone range of photographs."""
    if image.dtype == np.uint8:
        return cv2.resize(image, (2048, 1024), interpolation=cv2.INTER_AREA)
    light = np.clip(image / np.percentile(image, 97), 0, 1)
    return (255 * light ** (1 / 2.2)).astype(np.uint8)
