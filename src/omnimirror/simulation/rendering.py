"""Rendering: light of a scene on the image sensor, and images captured by a camera.

The light of a pixel is the mean over rays through the pixel and the lens aperture, via the mirror,
to the scene. Images are arrays (rows, columns, 3) of uint8 in sRGB and in **RGB order**, as
usual in Python; OpenCV requires BGR, ``picture[..., ::-1]``.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..analysis.operating_conditions import at_wavelength
from ..base.arguments import finite, instance, integer, validate_arguments
from ..base.colour import Light, SrgbImage, srgb_bytes
from ..base.errors import InvalidParameter
from ..base.native import backend
from ..cameras.camera import Camera, rotate_vectors
from ..optics.image_sensor import Imager
from ..optics.sensor import Sensor
from ._compiled_rendering import compiled_light, is_for_kernels, native_optics
from .image_tiles import BYTES, LIGHT, PixelConversion, Progress, Tile, render_tiles
from .pixel_rays import (
    DIRECT,
    LOST,
    OBSCURED,
    REFLECTED,
    Samples,
    ThroughShell,
    check_clearance,
    check_housing_is_rendered,
    front_shade,
    sample_positions,
    sampling_plan,
    scene_through_shell,
    trace_to_scene,
)
from .radiometry import Radiometry
from .scenes.scene import DistantScene, Scene

# -- Radiance on the image sensor ------------------------------------------------------------------

MAX_SIDE_PX = 1 << 15  # maximum side of a square image, px, whose light requires 12 GB


class Bundle(NamedTuple):
    """Rays of some pixels, (rows, columns, n, ...)."""

    origins: NDArray[np.floating]
    """Origins (..., 3), mm, in the world frame."""
    directions: NDArray[np.floating]
    """Directions (..., 3) in the world frame."""
    weight: NDArray[np.floating]
    """Transmitted fraction of the light; for hidden rays, of the light of the housing."""
    outcome: NDArray[np.uint8]
    """``LOST``, ``REFLECTED``, ``DIRECT`` past the mirror, or ``OBSCURED`` by camera, rod or edge."""


@validate_arguments
def expose(
    camera: Camera,
    scene: Scene,
    *,
    samples: int = 4,
    blur: bool = False,
    distant: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    on_progress: Progress | None = None,
    workers: int | None = None,
    wavelengths_nm: tuple[float, float, float] | None = None,
) -> Light:
    """Compute the light (rows, columns, 3), linear RGB, on the pixels of a camera.

    Parameters
    ----------
    camera
        Any camera; rays of a mirror sensor start from their true reflection points.
    scene
    samples
        Rays per pixel, distributed over its area, and over the lens aperture with ``blur``.
    blur
        Render defocus blur with the lens aperture. Supported for sensors only.
    distant
        Render the scene as infinitely distant (:class:`~omnimirror.simulation.scenes.DistantScene`).
    radiometry
        Radiometry of a sensor and appearance of its housing; without losses by default.
    seed
        Random seed of the sample positions in a blurred image.
    on_progress
        Callback in the calling thread with the finished rows.
    workers
        Number of threads; the number of processors by default.
    wavelengths_nm
        Wavelengths of red, green and blue light for refraction by lens and cover
        (:func:`om.at_wavelength`); by default all colours at the middle of the spectrum.

    Returns
    -------
    (rows, columns, 3) array, float32
        Linear RGB.

    Raises
    ------
    InvalidParameter
        If the number of samples is out of range or there are too many pixels, if blur or radiometry
        are given for a camera that is not a sensor, or if the scene cannot be rendered from the
        position of the camera or intersects its mirror.

    Notes
    -----
    Light outside the mirror image is 0, and a pixel at the rim is dimmed by the fraction that is
    cut off. Without blur all rays are chief rays. Images of a sensor include its housing, and the
    effects of a tube or a dome.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2))
    >>> light = om.expose(small, om.Room(texel_mm=40.0), samples=1)
    >>> light.shape, light.dtype
    ((64, 64, 3), dtype('float32'))
    """
    return render_light(
        camera,
        scene,
        LIGHT,
        samples=samples,
        blur=blur,
        distant=distant,
        radiometry=radiometry,
        seed=seed,
        on_progress=on_progress,
        workers=workers,
        wavelengths_nm=wavelengths_nm,
    )


def render_light(
    camera: Camera,
    scene: Scene,
    conversion: PixelConversion,
    *,
    samples: int,
    blur: bool = False,
    distant: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    on_progress: Progress | None = None,
    workers: int | None = None,
    wavelengths_nm: tuple[float, float, float] | None = None,
) -> NDArray[Any]:
    """Return the converted light, (rows, columns, 3); parameters as in
    :func:`expose`.
    """
    # More than 60 lines: 11 parameters, and a choice between three renderers.
    instance("camera", camera, Camera, "a camera, for example from om.load_sensor")
    instance("scene", scene, Scene, "a scene, for example om.Room()")
    _check_size(camera)
    workers = None if workers is None else integer("workers", workers, 1)
    instance("blur", blur, bool, "True or False")
    instance("distant", distant, bool, "True or False")
    if blur and not isinstance(camera, Sensor):
        raise InvalidParameter(
            f"blur must be False unless the camera is a sensor; got a {type(camera).__name__}"
        )
    if radiometry is not None and not _has_one_mirror(camera):
        raise InvalidParameter(
            "radiometry must be omitted unless the camera is a sensor with one mirror"
        )
    if isinstance(camera, Sensor):
        check_housing_is_rendered(camera)
        camera.aligned().rim_radius_px  # noqa: B018 - proves that lens and mirror can be used
        if not distant:
            check_clearance(camera, scene)
    plan = sampling_plan(samples, blur, seed)
    radiometry = radiometry or Radiometry()
    cameras, coloured = _cameras_at_wavelengths(camera, wavelengths_nm), radiometry.by_colour()
    if cameras is not None or coloured is not None:
        plain = partial(
            render_light,
            scene=scene,
            conversion=LIGHT if conversion.in_order else conversion,
            samples=samples,
            blur=blur,
            distant=distant,
            seed=seed,
            on_progress=on_progress,
            workers=workers,
        )
        cameras_by_colour: list[Any] = [camera] * 3 if cameras is None else [*cameras]
        each = zip(cameras_by_colour, coloured or [radiometry] * 3, strict=True)
        shares = [plain(colour_camera, radiometry=light) for colour_camera, light in each]
        stacked = np.stack([share[..., i] for i, share in enumerate(shares)], axis=-1)
        return conversion.read(stacked) if conversion.in_order else stacked
    visible_scene = scene_through_shell(camera, _at_infinity(scene) if distant else scene)
    if _has_one_mirror(camera) and is_for_kernels(camera):
        image = compiled_light(
            camera, visible_scene, plan, radiometry, on_progress, workers, conversion
        )
        if image is not None:
            return image
    return _render_scene(camera, visible_scene, plan, radiometry, on_progress, workers, conversion)


def _cameras_at_wavelengths(
    camera: Camera, wavelengths_nm: tuple[float, float, float] | None
) -> list[Sensor] | None:
    """Return the sensor for red, green and blue light; None if all colours are equal."""
    if wavelengths_nm is None:
        return None
    if not isinstance(camera, Sensor):
        raise InvalidParameter(
            f"wavelengths_nm must be omitted unless the camera is a sensor; got a {type(camera).__name__}"
        )
    three = finite("wavelengths_nm", wavelengths_nm, last=3)
    return [at_wavelength(camera, float(nm)) for nm in three]


def _check_size(camera: Camera) -> None:
    width, height = camera.image_size
    if width * height > MAX_SIDE_PX**2:
        raise InvalidParameter(
            f"the image must have at most {MAX_SIDE_PX**2} px, for example {MAX_SIDE_PX} "
            f"x {MAX_SIDE_PX} px; got {width} x {height} px"
        )


def _at_infinity(scene: Scene) -> Scene:
    """Return the scene at infinity; a tube or a dome is unchanged."""
    return (
        replace(scene, scene=_at_infinity(scene.scene))
        if isinstance(scene, ThroughShell)
        else DistantScene(scene)
    )


def _has_one_mirror(camera: Camera) -> TypeGuard[Sensor]:
    return isinstance(camera, Sensor) and camera.secondary is None


def _render_scene(
    camera: Camera,
    scene: Scene,
    plan: Samples,
    radiometry: Radiometry,
    on_progress: Progress | None,
    workers: int | None,
    conversion: PixelConversion,
) -> NDArray[Any]:
    def light_of(tile: Tile) -> Light:
        light: Light = gather_light(
            trace_bundle(camera, plan, radiometry, *tile), scene, radiometry
        ).mean(axis=2)
        return light

    return render_tiles(
        light_of, camera.image_size, len(plan.points), on_progress, workers, conversion
    )


def gather_light(bundle: Bundle, scene: Scene, radiometry: Radiometry) -> Light:
    """Return the light (rows, columns, n, 3) along the rays."""
    light = np.zeros(bundle.origins.shape, np.float32)
    visible = (bundle.outcome == REFLECTED) | (bundle.outcome == DIRECT)
    light[visible] = scene.radiance(bundle.origins[visible], bundle.directions[visible])
    light *= bundle.weight[..., None]
    hidden = bundle.outcome == OBSCURED
    light[hidden] = radiometry.housing_light * bundle.weight[hidden, None]
    return light


def trace_bundle(
    camera: Camera, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice
) -> Bundle:
    """Trace the rays of a tile of the image."""
    if not _has_one_mirror(camera):
        pixels, pupil = sample_positions(plan, *np.meshgrid(np.r_[columns], np.r_[rows]))
        shape, flat = pixels.shape[:-1], pixels.reshape(-1, 2)
        if isinstance(camera, Sensor) and plan.blur:
            origins, directions, valid = camera.aperture_rays(
                flat, pupil.reshape(-1, 2) * plan.blur
            )
        else:
            origins, directions, valid = camera.backproject(flat)
        outcome = np.where(valid, REFLECTED, LOST).astype(np.uint8).reshape(shape)
        return Bundle(
            origins.reshape(*shape, 3), directions.reshape(*shape, 3), np.ones(shape), outcome
        )
    trace_sensor = _trace_natively if is_for_kernels(camera) else _trace_sensor
    return trace_sensor(camera, plan, radiometry, rows, columns)


def _trace_natively(
    sensor: Sensor, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice
) -> Bundle:
    shape = (rows.stop - rows.start, columns.stop - columns.start, len(plan.points))
    origins, directions = np.empty((2, *shape, 3), np.float32)
    weight, outcome = np.empty(shape, np.float32), np.empty(shape, np.uint8)
    optics = native_optics(sensor, radiometry, plan.blur)
    backend.kernels.expose_rays(
        optics,
        plan.points,
        plan.blur,
        plan.seed,
        columns.start,
        rows.start,
        origins,
        directions,
        weight,
        outcome,
    )
    return Bundle(origins, directions, weight, outcome)


def _trace_sensor(
    sensor: Sensor, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice
) -> Bundle:
    """Trace the same rays without the compiled module."""
    pixels, pupil = sample_positions(plan, *np.meshgrid(np.r_[columns], np.r_[rows]))
    shape = pixels.shape[:-1]
    pixels, pupil = pixels.reshape(-1, 2), pupil.reshape(-1, 2) * plan.blur
    points, directions, towards, hit, outcome = trace_to_scene(sensor, pixels, pupil, radiometry)
    along = np.einsum("ni,ni->n", towards, directions) / np.linalg.norm(towards, axis=1)
    gamma = np.pi / 2 - np.arccos(np.clip(along / np.linalg.norm(directions, axis=1), -1, 1)) / 2
    image = sensor.image_plane.flat_mm(pixels)[0]
    # Edges of a real lens vignette rays through its aperture; chief rays represent all of them
    clipped = plan.blur and not sensor.lens.IS_THIN
    weight = 1 - radiometry.vignetting * (
        1 - sensor.lens.falloff(image, pupil if clipped else None)
    )
    weight *= np.where(hit, radiometry.returned(gamma), 1.0)
    weight[hit] *= front_shade(sensor, points[hit], directions[hit], -towards[hit])
    weight[outcome == LOST] = 0.0
    rotation = sensor.mount.rotation().T
    return Bundle(
        rotate_vectors(points, rotation).reshape(*shape, 3),
        rotate_vectors(directions, rotation).reshape(*shape, 3),
        weight.reshape(shape),
        outcome.reshape(shape),
    )


# -- Rendered images -------------------------------------------------------------------------------
#
# Images are arrays (rows, columns, 3) of uint8 in sRGB and in **RGB order**, as usual in Python;
# OpenCV requires BGR, ``picture[..., ::-1]``.

MAX_SAMPLES = 16
SHOWN_SAMPLES = 16
"""Rays per pixel of images for display."""


def render_image(
    camera: Camera,
    scene: Scene,
    *,
    samples: int = 4,
    blur: bool = False,
    distant: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    on_progress: Progress | None = None,
    workers: int | None = None,
    low_pass: bool = False,
) -> SrgbImage:
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
    on_progress
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
    >>> picture = om.render_image(om.load_sensor("paper-spherical"), om.Room(texel_mm=40.0), samples=1)
    >>> picture.shape, picture.dtype, picture[0, 0]
    ((1024, 1024, 3), dtype('uint8'), array([0, 0, 0], dtype=uint8))
    """
    if low_pass:
        fine = _with_half_pixel_pitch(camera)
        light = expose(
            fine,
            scene,
            samples=-(-samples // 4),
            blur=blur,
            distant=distant,
            radiometry=radiometry,
            seed=seed,
            on_progress=on_progress,
            workers=workers,
        )
        return srgb_bytes(_low_pass_filtered(light))
    return render_light(
        camera,
        scene,
        BYTES,
        samples=samples,
        blur=blur,
        distant=distant,
        radiometry=radiometry,
        seed=seed,
        on_progress=on_progress,
        workers=workers,
    )


LOW_PASS_KERNEL = np.array([1.0, 3.0, 3.0, 1.0]) / 8
"""Weights of half-width pixels: a tent that extends one pixel to either side."""


def _with_half_pixel_pitch(camera: Camera) -> Sensor:
    """Return the sensor with pixels of half the width."""
    if not isinstance(camera, Sensor):
        raise InvalidParameter(
            f"low_pass must be False unless the camera is a sensor; got a {type(camera).__name__}"
        )
    imager = camera.imager
    u, v = imager.centre
    finer = Imager(
        2 * imager.width_px,
        2 * imager.height_px,
        imager.pixel_pitch_um / 2,
        (2 * u + 0.5, 2 * v + 0.5),
    )
    return replace(camera, imager=finer)


def _low_pass_filtered(light: Light) -> Light:
    """Filter light (2 n, 2 m, 3) on half-width pixels to pixels (n, m, 3)."""
    for axis in (0, 1):
        padded = np.moveaxis(
            np.pad(light, [(1, 1) if a == axis else (0, 0) for a in range(3)], mode="edge"), axis, 0
        )
        count = light.shape[axis] // 2
        light = np.moveaxis(
            sum(w * padded[i : i + 2 * count : 2] for i, w in enumerate(LOW_PASS_KERNEL)), 0, axis
        )
    return np.ascontiguousarray(light, np.float32)


@validate_arguments
def render_pinhole_image(scene: Scene, directions: ArrayLike, samples: int = 1) -> SrgbImage:
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
    >>> from omnimirror.cameras.camera import pan_tilt_direction
    >>> from omnimirror import Room
    >>> pan, tilt = np.meshgrid(np.radians(np.arange(-60, 60, 2)), np.radians(np.arange(30, -30, -2)))
    >>> render_pinhole_image(Room(texel_mm=40.0), pan_tilt_direction(pan, tilt)).shape
    (30, 60, 3)
    """
    _check_samples(samples)
    towards = np.asarray(directions, dtype=float)
    if (
        towards.ndim != 3
        or towards.shape[2] != 3
        or towards.shape[0] % samples
        or towards.shape[1] % samples
    ):
        raise InvalidParameter(
            "directions must have the shape (rows, columns, 3), with rows and columns "
            f"multiples of samples = {samples}; got {towards.shape}"
        )
    light = np.zeros(towards.shape, dtype=np.float32)
    valid = np.isfinite(towards).all(axis=2)
    light[valid] = scene.radiance(np.zeros((int(valid.sum()), 3)), towards[valid])
    return _averaged_srgb(light, samples)


def _check_samples(samples: int) -> None:
    if not (1 <= samples <= MAX_SAMPLES and int(samples) == samples):
        raise InvalidParameter(f"samples must be an integer from 1 to {MAX_SAMPLES}; got {samples}")


def _averaged_srgb(light: Light, samples: int) -> SrgbImage:
    """Convert the light of samples (rows * samples, columns * samples, 3) to pixels."""
    rows, columns, _ = light.shape
    return srgb_bytes(
        light.reshape(rows // samples, samples, columns // samples, samples, 3).mean(axis=(1, 3))
    )
