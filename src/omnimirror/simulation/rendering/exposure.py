"""Light on the image sensor: mean over rays of each pixel through the aperture, via the mirror, to
a scene.
"""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from ...analysis.wavelength import at_wavelength
from ...base.arguments import checked, finite, instance, whole
from ...base.colour import Light
from ...base.errors import InvalidParameter
from ...base.native import backend
from ...cameras.camera import Camera
from ...cameras.frames import turned
from ...optics.sensor import Sensor
from ..radiometry import Radiometry
from ..scenes.contract import Distant, Scene
from ..shells import ThroughShell, seen_through
from .compiled import compiled_light
from .kernel_sensor import is_for_kernels, native_optics
from .samples import Samples, places, spread
from .sight import DIRECT, HIDDEN, LOST, REFLECTED, check_clear, check_housing_is_shown, follow, front_shade
from .tiles import LIGHT, Medium, Progress, Tile, picture_of_tiles

MOST_ACROSS = 1 << 15  # maximum side of a square image, px, whose light requires 12 GB


class Bundle(NamedTuple):
    """Rays of some pixels, (rows, columns, n, ...)."""

    origins: NDArray[np.floating]
    """Origins (..., 3), mm, in the world frame."""
    directions: NDArray[np.floating]
    """Directions (..., 3) in the world frame."""
    weight: NDArray[np.floating]
    """Transmitted fraction of the light; for hidden rays, of the light of the housing."""
    fate: NDArray[np.uint8]
    """``LOST``, ``REFLECTED``, ``DIRECT`` past the mirror, or ``HIDDEN`` by camera, rod or edge."""


@checked
def expose(
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
        Render the scene as infinitely distant (:class:`~omnimirror.simulation.scenes.Distant`).
    radiometry
        Radiometry of a sensor and appearance of its housing; without losses by default.
    seed
        Random seed of the sample positions in a blurred image.
    progress
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
    return exposed(
        camera, scene, LIGHT, samples=samples, blur=blur, distant=distant, radiometry=radiometry, seed=seed,
        progress=progress, workers=workers, wavelengths_nm=wavelengths_nm,
    )  # fmt: skip


def exposed(
    camera: Camera,
    scene: Scene,
    medium: Medium,
    *,
    samples: int,
    blur: bool = False,
    distant: bool = False,
    radiometry: Radiometry | None = None,
    seed: int = 0,
    progress: Progress | None = None,
    workers: int | None = None,
    wavelengths_nm: tuple[float, float, float] | None = None,
) -> NDArray[Any]:
    """Return the response of a medium to the light, (rows, columns, 3); parameters as in
    :func:`expose`.
    """
    instance("camera", camera, Camera, "a camera, such as om.load_sensor gives")
    instance("scene", scene, Scene, "a scene, such as om.Room()")
    _check_size(camera)
    workers = None if workers is None else whole("workers", workers, 1)
    instance("blur", blur, bool, "True or False")
    instance("distant", distant, bool, "True or False")
    if blur and not isinstance(camera, Sensor):
        raise InvalidParameter("only a sensor has blur; a calibrated camera says nothing of its aperture")
    if radiometry is not None and not _has_one_mirror(camera):
        raise InvalidParameter(
            "only a sensor of one mirror has radiometry; a calibrated camera says nothing of it, and two mirrors dim "
            "nothing yet"
        )
    if isinstance(camera, Sensor):
        check_housing_is_shown(camera)
        camera.aligned().rim_radius_px  # noqa: B018 - proves that lens and mirror can be used
        if not distant:
            check_clear(camera, scene)
    plan = spread(samples, blur, seed)
    radiometry = radiometry or Radiometry()
    cameras, coloured = _of_colours(camera, wavelengths_nm), radiometry.of_colours()
    if cameras is not None or coloured is not None:
        plain = partial(
            exposed, scene=scene, medium=LIGHT if medium.in_order else medium, samples=samples, blur=blur,
            distant=distant, seed=seed, progress=progress, workers=workers,
        )  # fmt: skip
        seen_by: list[Any] = [camera] * 3 if cameras is None else [*cameras]
        each = zip(seen_by, coloured or [radiometry] * 3, strict=True)
        shares = [plain(seen, radiometry=light) for seen, light in each]
        stacked = np.stack([share[..., i] for i, share in enumerate(shares)], axis=-1)
        return medium.read(stacked) if medium.in_order else stacked
    seen = seen_through(camera, _distant(scene) if distant else scene)
    if _has_one_mirror(camera) and is_for_kernels(camera):
        picture = compiled_light(camera, seen, plan, radiometry, progress, workers, medium)
        if picture is not None:
            return picture
    return _of_scene(camera, seen, plan, radiometry, progress, workers, medium)


def _of_colours(camera: Camera, wavelengths_nm: tuple[float, float, float] | None) -> list[Sensor] | None:
    """Return the sensor for red, green and blue light; None if all colours are equal."""
    if wavelengths_nm is None:
        return None
    if not isinstance(camera, Sensor):
        raise InvalidParameter("only a sensor has colours; a calibrated camera says nothing of its lens")
    three = finite("wavelengths_nm", wavelengths_nm, last=3)
    return [at_wavelength(camera, float(nm)) for nm in three]


def _check_size(camera: Camera) -> None:
    width, height = camera.image_size
    if width * height > MOST_ACROSS**2:
        raise InvalidParameter(
            f"a picture of {width} x {height} px is too large to be simulated; valid are up to {MOST_ACROSS} x "
            f"{MOST_ACROSS} px, or as many in all"
        )


def _distant(scene: Scene) -> Scene:
    """Return the scene at infinity; a tube or a dome is unchanged."""
    return replace(scene, scene=_distant(scene.scene)) if isinstance(scene, ThroughShell) else Distant(scene)


def _has_one_mirror(camera: Camera) -> TypeGuard[Sensor]:
    return isinstance(camera, Sensor) and camera.secondary is None


def _of_scene(
    camera: Camera,
    scene: Scene,
    plan: Samples,
    radiometry: Radiometry,
    progress: Progress | None,
    workers: int | None,
    medium: Medium,
) -> NDArray[Any]:
    def light_of(tile: Tile) -> Light:
        light: Light = gather(trace(camera, plan, radiometry, *tile), scene, radiometry).mean(axis=2)
        return light

    return picture_of_tiles(light_of, camera.image_size, len(plan.points), progress, workers, medium)


def gather(bundle: Bundle, scene: Scene, radiometry: Radiometry) -> Light:
    """Return the light (rows, columns, n, 3) along the rays."""
    light = np.zeros(bundle.origins.shape, np.float32)
    seeing = (bundle.fate == REFLECTED) | (bundle.fate == DIRECT)
    light[seeing] = scene.radiance(bundle.origins[seeing], bundle.directions[seeing])
    light *= bundle.weight[..., None]
    hidden = bundle.fate == HIDDEN
    light[hidden] = radiometry.grey * bundle.weight[hidden, None]
    return light


def trace(camera: Camera, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice) -> Bundle:
    """Trace the rays of a tile of the image."""
    if not _has_one_mirror(camera):
        pixels, pupil = places(plan, *np.meshgrid(np.r_[columns], np.r_[rows]))
        shape, flat = pixels.shape[:-1], pixels.reshape(-1, 2)
        if isinstance(camera, Sensor) and plan.blur:
            origins, directions, valid = camera.aperture_rays(flat, pupil.reshape(-1, 2) * plan.blur)
        else:
            origins, directions, valid = camera.backproject(flat)
        fate = np.where(valid, REFLECTED, LOST).astype(np.uint8).reshape(shape)
        return Bundle(origins.reshape(*shape, 3), directions.reshape(*shape, 3), np.ones(shape), fate)
    trace_sensor = _trace_natively if is_for_kernels(camera) else _trace_sensor
    return trace_sensor(camera, plan, radiometry, rows, columns)


def _trace_natively(sensor: Sensor, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice) -> Bundle:
    shape = (rows.stop - rows.start, columns.stop - columns.start, len(plan.points))
    origins, directions = np.empty((2, *shape, 3), np.float32)
    weight, fate = np.empty(shape, np.float32), np.empty(shape, np.uint8)
    optics = native_optics(sensor, radiometry, plan.blur)
    backend.kernels.expose_rays(
        optics, plan.points, plan.blur, plan.seed, columns.start, rows.start, origins, directions, weight, fate
    )
    return Bundle(origins, directions, weight, fate)


def _trace_sensor(sensor: Sensor, plan: Samples, radiometry: Radiometry, rows: slice, columns: slice) -> Bundle:
    """Trace the same rays without the compiled module."""
    pixels, pupil = places(plan, *np.meshgrid(np.r_[columns], np.r_[rows]))
    shape = pixels.shape[:-1]
    pixels, pupil = pixels.reshape(-1, 2), pupil.reshape(-1, 2) * plan.blur
    points, directions, towards, hit, fate = follow(sensor, pixels, pupil, radiometry)
    along = np.einsum("ni,ni->n", towards, directions) / np.linalg.norm(towards, axis=1)
    gamma = np.pi / 2 - np.arccos(np.clip(along / np.linalg.norm(directions, axis=1), -1, 1)) / 2
    image = sensor.image_plane.flat_mm(pixels)[0]
    # Edges of a real lens vignette rays through its aperture; chief rays represent all of them
    clipped = plan.blur and not sensor.lens.IS_THIN
    weight = 1 - radiometry.vignetting * (1 - sensor.lens.falloff(image, pupil if clipped else None))
    weight *= np.where(hit, radiometry.returned(gamma), 1.0)
    weight[hit] *= front_shade(sensor, points[hit], directions[hit], -towards[hit])
    weight[fate == LOST] = 0.0
    rotation = sensor.mount.rotation().T
    return Bundle(
        turned(points, rotation).reshape(*shape, 3),
        turned(directions, rotation).reshape(*shape, 3),
        weight.reshape(shape),
        fate.reshape(shape),
    )
