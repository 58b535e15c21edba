"""Rendering of the image of a scene captured by a camera.

Images are arrays (rows, columns, 3) of uint8 in sRGB and in **RGB order**, as usual in Python;
OpenCV requires BGR, ``picture[..., ::-1]``.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import checked
from ...base.colour import Light, Picture, srgb_bytes
from ...base.errors import InvalidParameter
from ...cameras.camera import Camera
from ...optics.image_sensor import Imager
from ...optics.sensor import Sensor
from ..radiometry import Radiometry
from ..scenes.contract import Scene
from .exposure import expose, exposed
from .tiles import BYTES, Progress

MOST_SAMPLES = 16
SHOWN_SAMPLES = 16
"""Rays per pixel of images for display."""


def take_picture(
    camera: Camera,
    scene: Scene,
    *,
    samples: int = 4,
    blur: bool = False,
    distant: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
    low_pass: bool = False,
) -> Picture:
    """Render the image (rows, columns, 3), uint8 sRGB in RGB order, of a scene captured by a
    camera.

    Without ``blur`` it is perfectly sharp: chief rays only, without defocus or diffraction. Each
    pixel is the mean of ``samples`` rays in linear light; it is black outside the field, and a
    pixel at the rim is dimmed by the fraction that is cut off. The parameters are those of
    :func:`~omnimirror.expose`, which returns the linear light.

    With ``low_pass`` there is an optical low-pass filter in front of the image sensor, as in most
    cameras: each pixel integrates light over a tent of twice its width. Adjacent pixels without
    filter alias edges and thin lines, which is visible in magnified views.

    Parameters
    ----------
    camera
        Sensor, or a calibrated camera.
    scene
        Scene, such as :class:`omnimirror.Room` or the result of :func:`omnimirror.load_scene`.
    samples
        Rays per pixel.
    blur
        Render defocus blur with the whole aperture of the lens.
    distant
        Render the scene as infinitely distant: no parallax.
    radiometry
        Reflectivity of the mirror, vignetting of the lens, and appearance of the housing.
    seed
        Random seed of the sample positions in a blurred image.
    progress
        Callback with the number of finished rows and the total.
    workers
        Number of threads; the number of processors by default.
    low_pass
        Simulate an optical low-pass filter in front of the image sensor.

    Returns
    -------
    (rows, columns, 3) array, uint8
        sRGB in RGB order.

    Raises
    ------
    InvalidParameter
        As in :func:`~omnimirror.expose`; or for a low-pass filter of a camera that is not a sensor.

    Examples
    --------
    >>> import omnimirror as om
    >>> picture = om.take_picture(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0), samples=1)
    >>> picture.shape, picture.dtype, picture[0, 0]
    ((1024, 1024, 3), dtype('uint8'), array([0, 0, 0], dtype=uint8))
    """
    if low_pass:
        fine = _finer(camera)
        light = expose(
            fine,
            scene,
            samples=-(-samples // 4),
            blur=blur,
            distant=distant,
            radiometry=radiometry,
            seed=seed,
            progress=progress,
            workers=workers,
        )
        return srgb_bytes(_low_passed(light))
    return exposed(
        camera, scene, BYTES, samples=samples, blur=blur, distant=distant, radiometry=radiometry, seed=seed,
        progress=progress, workers=workers,
    )  # fmt: skip


TENT = np.array([1.0, 3.0, 3.0, 1.0]) / 8
"""Weights of half-width pixels: a tent that extends one pixel to either side."""


def _finer(camera: Camera) -> Sensor:
    """Return the sensor with pixels of half the width."""
    if not isinstance(camera, Sensor):
        raise InvalidParameter(
            "only a sensor has a low-pass filter; a calibrated camera has taken its pictures already"
        )
    imager = camera.imager
    u, v = imager.centre
    finer = Imager(2 * imager.width_px, 2 * imager.height_px, imager.pixel_pitch_um / 2, (2 * u + 0.5, 2 * v + 0.5))
    return replace(camera, imager=finer)


def _low_passed(light: Light) -> Light:
    """Filter light (2 n, 2 m, 3) on half-width pixels to pixels (n, m, 3)."""
    for axis in (0, 1):
        padded = np.moveaxis(np.pad(light, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge"), axis, 0)
        count = light.shape[axis] // 2
        light = np.moveaxis(sum(w * padded[i : i + 2 * count : 2] for i, w in enumerate(TENT)), 0, axis)
    return np.ascontiguousarray(light, np.float32)


@checked
def pinhole_picture(scene: Scene, directions: ArrayLike, samples: int = 1) -> Picture:
    """Render the image of an ideal camera at the world origin: the reference for dewarped images.

    Parameters
    ----------
    scene
    directions : (rows * samples, columns * samples, 3) array
        World directions of any length; NaN results in black.
    samples
        Directions per pixel and side, averaged in linear light.

    Returns
    -------
    (rows, columns, 3) array, uint8 sRGB in RGB order.

    Raises
    ------
    InvalidParameter
        If the shape of the directions is inconsistent.

    Examples
    --------
    >>> from omnimirror.cameras.frames import pan_tilt_direction
    >>> from omnimirror import Room
    >>> pan, tilt = np.meshgrid(np.radians(np.arange(-60, 60, 2)), np.radians(np.arange(30, -30, -2)))
    >>> pinhole_picture(Room(texel_mm=40.0), pan_tilt_direction(pan, tilt)).shape
    (30, 60, 3)
    """
    _check_samples(samples)
    towards = np.asarray(directions, dtype=float)
    if towards.ndim != 3 or towards.shape[2] != 3 or towards.shape[0] % samples or towards.shape[1] % samples:
        raise InvalidParameter(
            f"directions have the shape {towards.shape}; it must be (rows, columns, 3), both a multiple of "
            f"samples = {samples}"
        )
    light = np.zeros(towards.shape, dtype=np.float32)
    valid = np.isfinite(towards).all(axis=2)
    light[valid] = scene.radiance(np.zeros((int(valid.sum()), 3)), towards[valid])
    return _develop(light, samples)


def _check_samples(samples: int) -> None:
    if not (1 <= samples <= MOST_SAMPLES and int(samples) == samples):
        raise InvalidParameter(f"samples = {samples} is not a whole number from 1 to {MOST_SAMPLES}")


def _develop(light: Light, samples: int) -> Picture:
    """Convert the light of samples (rows * samples, columns * samples, 3) to pixels."""
    rows, columns, _ = light.shape
    return srgb_bytes(light.reshape(rows // samples, samples, columns // samples, samples, 3).mean(axis=(1, 3)))
