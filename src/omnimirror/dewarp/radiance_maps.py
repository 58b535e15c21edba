"""HDR light probes: equirectangular radiance maps from images of a mirror, and merged exposures."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, rfft, rfftfreq

from ..base.arguments import integer, number, validate_arguments
from ..base.colour import Light, linear_rgb
from ..base.errors import InvalidParameter, MediaError, OutsideField
from ..base.results import Columns, FieldResult, Fields
from ..base.typing import Array, Mask
from ..cameras.camera import Camera
from ..cameras.models.camera_model import MAX_IMAGE_PX
from ..io.images import format_of
from . import Dewarper, views
from .interfaces import Image
from .maps import PixelMap
from .sampling import check_colours, check_image, remap, with_alpha
from .screens import Equirectangular
from .view_geometry import annulus_of, field_of

# -- Merged exposures ------------------------------------------------------------------------------

MIN_EXPOSURE_S, MAX_EXPOSURE_S = 1e-7, 1e5
SATURATION = 0.98
"""Saturated fraction of full scale: cameras clip slightly below it, after white balance."""
SHOULDER = 0.1
"""Range below saturation, as a fraction of full scale, in which the weight falls to 0."""


@validate_arguments
def merge_exposures(images: Sequence[Image], exposures_s: Sequence[float]) -> Light:
    """Merge images of one scene with different exposures into one radiance map.

    Integers are linearised from sRGB. Pixels with a saturated channel are omitted; pixels that are
    saturated in all images have the values of the shortest exposure.

    Parameters
    ----------
    images : sequence of (h, w), (h, w, 3) or (h, w, 4) arrays
        Images of uint8 or uint16, from the same position and with the same white balance.
    exposures_s : s
        Exposure time of each image; only their ratios have an effect.

    Returns
    -------
    (h, w, 3) array, float32
        Linear RGB on the scale of the first image, whose white is 1.

    Raises
    ------
    InvalidParameter
        If the images differ in size, are not uint8 or uint16, or have no exposure time each.

    Notes
    -----
    An exposure of t seconds estimates the radiance L as y / t from the linear pixel value y. Its
    error is proportional to 1 / t, and the least-squares estimate is L = sum(w t y) / sum(w t^2)
    with the weight w of unsaturated pixels.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> long = np.full((1, 1, 3), 255, np.uint8)
    >>> short = np.full((1, 1, 3), 188, np.uint8)  # half of the light of white
    >>> om.merge_exposures([long, short], [1 / 15, 1 / 60])[0, 0].round(2)
    array([2.01, 2.01, 2.01], dtype=float32)
    """
    times = [
        number("exposures_s", time, low=MIN_EXPOSURE_S, high=MAX_EXPOSURE_S, unit="s")
        for time in exposures_s
    ]
    if not times or len(times) != len(images):
        raise InvalidParameter(
            f"exposures_s must contain one time per image; got {len(times)} for {len(images)} images"
        )
    for image in images:
        check_colours(image)
        if image.dtype.kind != "u" or image.shape[:2] != images[0].shape[:2]:
            raise InvalidParameter(
                "images must be uint8 or uint16 and have one size; got "
                f"{image.shape[1]} x {image.shape[0]} px of {image.dtype} after "
                f"{images[0].shape[1]} x {images[0].shape[0]} px of {images[0].dtype}"
            )
    total = np.zeros((*images[0].shape[:2], 3), np.float32)
    weights = np.zeros((*images[0].shape[:2], 1), np.float32)
    for image, time in zip(images, times, strict=True):
        share = time / max(times)
        weight = _unsaturated(image) * np.float32(share)
        total += weight * linear_rgb(image)
        weights += weight * np.float32(share)
    shortest = int(np.argmin(times))
    clipped = linear_rgb(images[shortest]) * np.float32(max(times) / times[shortest])
    merged = np.where(weights > 0, total / np.maximum(weights, np.float32(1e-30)), clipped)
    return merged * np.float32(times[0] / max(times))


def _unsaturated(image: Image) -> NDArray[np.float32]:
    """Return the weight (h, w, 1) of each pixel: 0 if a channel is saturated, 1 below the shoulder."""
    colours = image[..., :3] if image.ndim == 3 else image[..., None]
    largest = colours.max(axis=-1, keepdims=True) / np.float32(np.iinfo(image.dtype).max)
    weight: NDArray[np.float32] = ((SATURATION - largest) / SHOULDER).clip(0, 1)
    return weight.astype(np.float32)


# -- Light probe -----------------------------------------------------------------------------------

CHANNELS = ("red", "green", "blue")
PROBE_SUFFIXES = (".hdr", ".exr")
"""File formats of radiance maps that programs read as environment maps."""
MIN_WIDTH_PX, MAX_DEFAULT_WIDTH_PX, MAX_WIDTH_PX = 8, 8192, 16_384
MIN_REFLECTANCE = 0.001
MAX_LIGHT = 1e30
"""Maximum absolute value of an image, whose sums and quotients are in the range of float32."""
SAMPLES = 2
"""Samples per pixel of the image along each side: adjacent samples include every image pixel."""
MIN_RIM_MARGIN_PX = 0.5
RIM_MARGIN = 0.0025
"""Excluded margin of the image of the mirror, relative to its radius: photographs are blurred, and
pixels near the edge contain light of the background."""
MIN_COVERAGE = 0.5
"""Minimum weight of the samples of a visible pixel that are on the mirror; others have no light."""
EDGE_PX = 5
"""Diameter of the neighbourhood of hidden pixels, whose visible pixels they are filled from."""
BAND_PIXELS = 1 << 18
"""Pixels in a band of rows for which rays are computed."""
BAND_SAMPLES = 1 << 22
"""Samples in a band of rows, which limits the memory to 64 MB."""


def check_probe_file(path: str | Path) -> None:
    """Raise MediaError unless a file can be a light probe.

    >>> check_probe_file("probe.hdr")
    """
    if Path(path).suffix.lower() not in PROBE_SUFFIXES:
        raise MediaError(
            f"the file of a light probe must be {' or '.join(PROBE_SUFFIXES)}, for values above 1; "
            f"got {path}"
        )
    format_of(path)  # the package for its format may be missing


@dataclass(frozen=True, eq=False, repr=False)
class LightProbe(FieldResult):
    """Equirectangular radiance map of the full sphere.

    Parameters
    ----------
    radiance : (h, 2 h, 3) array, float32
        Linear RGB. The image centre is forward (or at ``pan_deg``), pan increases to the right, and
        the first row is the zenith.
    visible : (h, 2 h) array, bool
        False where the mirror reflects no light to the camera, and the radiance is filled from the
        edge of the visible part.
    pan_deg
        Direction of the image centre, deg right of forward.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> sky = np.arange(8) < 4  # the upper half of 8 rows
    >>> om.LightProbe(np.ones((8, 16, 3), np.float32), np.tile(sky[:, None], 16)).visible_fraction
    0.5
    """

    radiance: Light
    visible: Mask
    pan_deg: float = 0.0

    def _fields(self) -> Fields:
        height, width = self.visible.shape
        elevation_deg = 90 - 180 * (np.arange(height) + 0.5) / height
        pan_deg = self.pan_deg + 360 * ((np.arange(width) + 0.5) / width - 0.5)
        maps = dict(zip(CHANNELS, np.moveaxis(self.radiance, -1, 0), strict=True))
        axes = ("elevation_deg", "pan_deg")
        return Fields(
            {name: (axes, values) for name, values in {**maps, "visible": self.visible}.items()},
            {
                name: ((name,), values)
                for name, values in zip(axes, (elevation_deg, pan_deg), strict=True)
            },
            {},
        )

    def _table(self) -> Columns:
        variables, coordinates, _ = self._fields()
        grid = np.meshgrid(*(values for _, values in coordinates.values()), indexing="ij")
        columns = dict(zip(coordinates, grid, strict=True))
        columns |= {name: values for name, (_, values) in variables.items()}
        return {name: values.ravel() for name, values in columns.items()}

    @property
    def visible_fraction(self) -> float:
        """Visible fraction of the sphere, by solid angle."""
        height = len(self.visible)
        weights = np.cos(np.pi * ((np.arange(height) + 0.5) / height - 0.5))
        return float(weights @ self.visible.mean(axis=1) / weights.sum())


@validate_arguments
def light_probe(
    image: Image,
    camera: Camera,
    *,
    width_px: int | None = None,
    pan_deg: float = 0.0,
    reflectance: float | tuple[float, float, float] = 1.0,
) -> LightProbe:
    """Convert an image of a mirror ball to an HDR light probe for image-based lighting.

    The result is an environment map as read by Blender, Unreal Engine and Mitsuba: equirectangular,
    full sphere, linear light. Every pixel is a mean of bilinear samples by solid angle, without the
    overshoot of cubic interpolation, so that small bright lights keep their energy. The directions
    that are not reflected to the camera, such as the blind cone behind a mirror ball, are filled
    smoothly from the edge of the visible part.

    Parameters
    ----------
    image : (h, w), (h, w, 3) or (h, w, 4) array
        Image of the camera: uint8 or uint16 in sRGB, or floats in linear light, to 1e30. Alpha is
        ignored.
    camera
        Camera of the image with its mount, such as :class:`omnimirror.MirrorBall` or a sensor.
    width_px
        Width of the map, an even number from 8 to 16384; its height is half of it. By default the
        mean resolution of the image, at most 8192 px.
    pan_deg
        Direction of the image centre, deg right of forward.
    reflectance
        Reflectance of the mirror, 0.001 to 1, or one for each of red, green and blue; the radiance
        is divided by it.

    Returns
    -------
    LightProbe
        Radiance map, and the mask of its visible part.

    Raises
    ------
    InvalidParameter
        If the image does not match the camera, contains values that are not finite, or an argument
        is outside its range.
    OutsideField
        If no pixel of the map is visible.

    Examples
    --------
    A mirror ball in a grey room, and its map as a file for Blender:

    >>> import numpy as np, omnimirror as om, tempfile
    >>> ball = om.MirrorBall(centre_px=(127.5, 127.5), rim_radius_px=120.0, field_deg=340.0, image_size=(256, 256))
    >>> probe = om.light_probe(np.full((256, 256, 3), 188, np.uint8), ball, width_px=128, reflectance=0.8)
    >>> probe.radiance.shape, probe.radiance[10, 10].round(2), round(probe.visible_fraction, 2)
    ((64, 128, 3), array([0.63, 0.63, 0.63], dtype=float32), 0.98)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_image(f"{folder}/probe.hdr", probe.radiance)
    """
    check_image(image, camera.image_size)
    if image.dtype.kind not in "uf":
        raise InvalidParameter(f"image must be uint8, uint16 or floats; got {image.dtype}")
    factors = np.ravel(reflectance).tolist()
    for factor in factors:
        number("reflectance", factor, low=MIN_REFLECTANCE, high=1.0)
    if width_px is None:
        natural_px = views.sphere(camera).size[0]
        width_px = min(max(natural_px, MIN_WIDTH_PX), MAX_DEFAULT_WIDTH_PX)
    elif integer("width_px", width_px, MIN_WIDTH_PX, MAX_WIDTH_PX) % 2:
        raise InvalidParameter(f"width_px must be even; got {width_px}")
    with np.errstate(over="ignore"):  # checked below
        light = with_alpha(linear_rgb(image))
    light[~_mirror_pixels(camera)] = 0.0
    if (invalid := light[~(abs(light) <= MAX_LIGHT)]).size:
        raise InvalidParameter(
            f"image must contain finite values up to {MAX_LIGHT:g} on the mirror; got {invalid[0]:g}"
        )
    means = _means(light, camera, (width_px, width_px // 2), pan_deg)
    coverage = means[..., 3:]
    visible = coverage[..., 0] >= MIN_COVERAGE
    if not visible.any():
        raise OutsideField(
            f"the mirror must cover at least one pixel of the map in the image; got none of "
            f"{width_px} x {width_px // 2} px; check the camera, or increase width_px"
        )
    divisors = np.maximum(coverage, MIN_COVERAGE) * np.asarray(factors, np.float32)
    radiance: Light = means[..., :3] / divisors
    if not visible.all():
        hidden = (~visible).astype(np.uint8)
        edge = visible & (cv2.dilate(hidden, np.ones((EDGE_PX, EDGE_PX), np.uint8)) > 0)
        radiance[~visible] = _filled(radiance, edge.astype(np.float32))[~visible]
    return LightProbe(radiance, visible, pan_deg)


def _means(light: Light, camera: Camera, size: tuple[int, int], pan_deg: float) -> Light:
    """Return means of bilinear samples (h, w, 4) over the pixels of a spherical map, by solid angle."""
    width, height = size
    side = int(np.ceil(SAMPLES * 360.0 * field_of(camera).pixels_per_degree / width))
    side = min(side, MAX_IMAGE_PX // width)
    # A row of samples covers the solid angle cos(elevation): at the poles, equal weights would
    # multiply the light of a small lamp.
    weights = np.cos(np.pi * ((np.arange(side * height) + 0.5) / (side * height) - 0.5))
    weights = weights.reshape(height, side)
    weights = (weights / weights.sum(axis=1, keepdims=True)).ravel().astype(np.float32)
    means = np.zeros((height, width, 4), np.float32)
    rows = max(1, BAND_SAMPLES // (side * width))
    for top in range(0, side * height, rows):
        bottom = min(top + rows, side * height)
        low, high = (90.0 - 180.0 * row / (side * height) for row in (bottom, top))
        screen = Equirectangular((side * width, bottom - top), low, high, pan_deg)
        with suppress(OutsideField):  # rows without visible pixels
            samples = Dewarper(camera, screen, "linear")(light)
            for row, values in enumerate(_area_means(samples, (width, bottom - top)), top):
                means[row // side] += weights[row] * values
    return means


def _mirror_pixels(camera: Camera) -> Mask:
    """Return the pixels (h, w) inside the image of the mirror, without those across its edge; for
    cameras without symmetry those with a ray.
    """
    width, height = camera.image_size
    annulus = annulus_of(camera)
    if annulus is None:
        has_ray = np.empty((height, width), np.bool_)
        count = max(1, BAND_PIXELS // width)
        for top in range(0, height, count):
            band = has_ray[top : top + count]
            v, u = np.mgrid[top : top + len(band), :width]
            rays = camera.backproject(np.stack([u, v], axis=-1).reshape(-1, 2).astype(float))
            band[:] = rays.valid.reshape(band.shape)
        return has_ray
    rows, columns = np.ogrid[:height, :width]
    radius = np.hypot(columns - annulus.u, rows - annulus.v)
    margin = max(MIN_RIM_MARGIN_PX, RIM_MARGIN * annulus.outer)
    first = annulus.inner + margin if annulus.inner > 0 else 0.0
    inside: Mask = (radius >= first) & (radius <= annulus.outer - margin)
    return inside


def _filled(light: Light, coverage: NDArray[np.float32]) -> Light:
    """Fill the pixels of an equirectangular map that are not fully covered, by a pyramid of means.

    Every level contains the means of the covered parts of 2 x 2 pixels, and is interpolated where
    the finer level is not covered (pull-push): the distance over which the edge is averaged
    increases with the distance from it.
    """
    height, width = coverage.shape
    weighted = light * coverage[..., None]
    if min(height, width) == 1:
        mean = weighted.sum(axis=(0, 1)) / max(float(coverage.sum()), 1e-30)
        return np.broadcast_to(mean, light.shape).astype(np.float32)
    size = max(1, width // 2), max(1, height // 2)
    parts, sums = _area_means(coverage, size), _area_means(weighted, size)
    means = sums / np.maximum(parts, np.float32(1e-30))[..., None]
    # An edge is a line, whose covered part of a pixel halves with each level: twice is complete.
    coarse = _filled(means.astype(np.float32, copy=False), np.minimum(2 * parts, 1))
    columns = (np.arange(width) + 0.5) * size[0] / width - 0.5
    rows = ((np.arange(height) + 0.5) * size[1] / height - 0.5).clip(0, size[1] - 1)
    closed = np.concatenate([coarse[:, -1:], coarse, coarse[:, :1]], axis=1)  # periodic in pan
    sigmas_px = 1 / np.cos(np.pi * ((np.arange(height) + 0.5) / height - 0.5))
    count = max(1, BAND_SAMPLES // width)
    for top in range(0, height, count):
        band = slice(top, top + count)
        positions = np.stack(np.meshgrid(columns + 1, rows[band]), axis=-1)
        values = remap(closed, PixelMap(positions, (size[0] + 2, size[1])))
        smooth = _smoothed_rows(values, sigmas_px[band])
        weighted[band] += (1 - coverage[band, :, None]) * smooth
    return weighted


def _area_means(image: NDArray[np.float32], size: tuple[int, int]) -> NDArray[np.float32]:
    """Reduce an image to a size (width, height) by means over areas."""
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.float32, copy=False)


def _smoothed_rows(light: Light, sigmas_px: Array) -> Light:
    """Smooth rows of an equirectangular map by Gaussians with the given standard deviations: one pixel
    at the horizon, and the same angle elsewhere, so that values converge at the poles.
    """
    width = light.shape[1]
    # Fourier transform of a Gaussian: exp(-2 pi^2 sigma^2 f^2) at the frequency f per pixel
    gains = np.exp(-2 * (np.pi * np.outer(sigmas_px, rfftfreq(width))) ** 2)
    spectrum = rfft(light, axis=1) * gains[..., None].astype(np.float32)
    smooth: Light = irfft(spectrum, width, axis=1)
    return smooth
