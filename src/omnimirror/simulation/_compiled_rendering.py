"""Rendering with compiled kernels: sensor parameters, environments and surfaces."""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.colour import Light
from ..base.native import backend
from ..base.typing import Array
from ..cameras.camera import rotate_vectors
from ..optics.housing import NO_HOUSING
from ..optics.lenses import Lens, Orthographic, Perspective
from ..optics.lenses.lens import fold
from ..optics.mirrors import Mirror
from ..optics.sensor import Sensor
from .image_tiles import LIGHT, PixelConversion, Progress, Tile, render_tiles
from .pixel_rays import Samples, mirror_grid
from .radiometry import Radiometry
from .scenes._painting import PaintedScene, Surroundings
from .scenes.environment import Environment
from .scenes.scene import DistantScene, PosedScene, Scene

# -- Sensor parameters for the compiled kernels ----------------------------------------------------

PROFILE_NODES = 2049  # nodes of the meridian; cubic interpolation of the sag is accurate to 1e-6 mm
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)
MAX_TANGENT = 1e3  # tangent; beyond the field
CONIC_TOLERANCE_MM = 1e-9  # tolerance of a mirror that equals a conic


def is_for_kernels(sensor: Sensor) -> bool:
    """Return True if the compiled kernels support the sensor: ideal lens, possibly distorted, and
    poses.
    """
    return backend.is_compiled and sensor.lens.IS_THIN and sensor.is_ideal_except_pose


class SceneFrame(NamedTuple):
    """Placement of a scene in the sensor world."""

    turn: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
    """Rotation (9,) from the world, row by row."""
    shift_mm: tuple[float, ...] = (0.0, 0.0, 0.0)
    """World origin (3,), mm."""
    distant: bool = False
    """True if all rays start at the world origin: the scene is at infinity."""


@lru_cache(maxsize=8)
def native_optics(
    sensor: Sensor,
    radiometry: Radiometry,
    blur: bool,
    frame: SceneFrame = SceneFrame(),  # noqa: B008
) -> object:
    """Create the compiled optics of a sensor with rays in the frame of a scene.

    The origin is the entrance pupil.
    """
    mirror, pose, lens = sensor.mirror, sensor.mirror_pose, sensor.lens
    m = -sensor.pupil_offset[2]
    curvature, conic, nodes = _surface(mirror)
    rotation = np.reshape(frame.turn, (3, 3)) @ sensor.mount.rotation()
    brown = lens.brown if isinstance(lens, Perspective) else NO_DISTORTION
    scale = sensor.imager.pitch_mm * _object_scale(lens)
    u, v = sensor.imager.centre
    if sensor.mount.image_flipped:
        u = sensor.imager.width_px - 1 - u
    return backend.kernels.Optics(
        telecentric=lens.TELECENTRIC,
        centre=(u, v),
        scale=(-scale if sensor.mount.image_flipped else scale, scale),
        distortion=brown,
        fold=min(fold(brown[:3]), MAX_TANGENT),
        focus=lens.focus_distance_mm - lens.pupil.at_mm,
        stop=_stop(lens) if blur else 0.0,
        vertex=tuple(pose.shift - sensor.pupil_offset),
        axes=tuple(pose.rotation().T.ravel()),
        aligned=pose.is_axial,
        curvature=curvature,
        conic=conic,
        rim=mirror.rim_radius_mm,
        nodes=nodes,
        reflectance=tuple(reflectance_series(radiometry, max_incidence(sensor))),
        natural_vignetting=radiometry.vignetting,
        **_obstruction_parameters(sensor, m),
        housing_light=(radiometry.housing_light,) * 3,
        direct_view=radiometry.direct_view,
        rotation=tuple(rotation.ravel()),
        shift=tuple(np.array(frame.shift_mm) - (0.0 if frame.distant else m) * rotation[:, 2]),
        distant=frame.distant,
    )


NO_OBSTRUCTIONS = {
    **dict.fromkeys(("body_z", "body_radius", "edge_z", "edge_radius"), 0.0),
    "lens_radius": 1.0,  # of the front ring on a body, here without effect
    "rod_z": (0.0, 0.0),
    "rod_radius": (0.0, 0.0),
}


def _obstruction_parameters(sensor: Sensor, m: float) -> dict[str, Any]:
    """Return the obstructions with heights from the entrance pupil; without the walls of tubes and
    domes.
    """
    if sensor.housing == NO_HOUSING:
        return NO_OBSTRUCTIONS
    obstructions = sensor.obstructions
    camera, rod, rim = obstructions.camera, obstructions.rod, obstructions.rim
    return {
        "body_z": m + camera.height_mm if camera else 0.0,
        "body_radius": camera.radius_mm if camera else 0.0,
        "lens_radius": obstructions.front_ring_mm / 2,
        "edge_z": rim.height_mm if rim else 0.0,
        "edge_radius": rim.radius_mm if rim else 0.0,
        "rod_z": (m + rod.foot_mm, m + rod.top_mm) if rod else (0.0, 0.0),
        "rod_radius": (rod.foot_radius_mm, rod.top_radius_mm) if rod else (0.0, 0.0),
    }


REFLECTANCE_TERMS = 8
INCIDENCE_MARGIN = np.radians(
    2.0
)  # margin of the angle of incidence for rays through the edge of the aperture


def max_incidence(sensor: Sensor) -> float:
    """Return the maximum angle of incidence on the mirror, radians, with a margin."""
    aligned, pose = sensor.aligned(), sensor.mirror_pose
    gamma = aligned.meridian.trace(np.linspace(0.0, sensor.mirror.rim_radius_mm, 257)).gamma
    tilt = np.radians(np.hypot(pose.tilt_x_deg, pose.tilt_y_deg))
    return float(min(np.max(gamma) + tilt + INCIDENCE_MARGIN, np.pi / 2))


def reflectance_series(radiometry: Radiometry, gamma_max: float) -> Array:
    """Return coefficients (8,) of a series in 1 - cos(gamma) for the reflectivity up to an angle.

    Least squares at Chebyshev points: for aluminium, silver and gold accurate to 2e-5 up to
    75.5 deg, which no bundled sensor exceeds, and to 1e-3 up to 89 deg.
    """
    top = 1 - np.cos(gamma_max)
    points = top * (0.5 - 0.5 * np.cos(np.pi * (np.arange(64) + 0.5) / 64))
    values = radiometry.returned(np.arccos(1 - points))
    fitted = (
        np.polynomial.Polynomial.fit(points, values, REFLECTANCE_TERMS - 1, domain=[0, top])
        .convert()
        .coef
    )
    series: Array = np.zeros(REFLECTANCE_TERMS)
    series[: len(fitted)] = fitted
    return series


def _object_scale(lens: Lens) -> float:
    """Return the tangent of the field angle (mm for a telecentric lens) per mm of the image sensor,
    without distortion.
    """
    return float(1 / lens.ideal_height(np.ones(1), np.ones(1))[0])


def _stop(lens: Lens) -> float:
    """Return the aperture radius, mm; for a telecentric lens, the negative tangent of the half
    angle of its cone.
    """
    if isinstance(lens, Orthographic):
        return -lens.aperture_slope
    assert isinstance(lens, Perspective)
    return lens.aperture_radius


def _surface(mirror: Mirror) -> tuple[float, float, NDArray[np.float32]]:
    """Return curvature and conic constant of the conic nearest to the mirror, and nodes if it is
    not that conic.
    """
    x = np.linspace(0.0, mirror.rim_radius_mm, PROFILE_NODES)
    profile = mirror.profile(x)
    z = profile[0]
    # Conic: c (x^2 + (1 + k) z^2) = 2 z
    (c, ck), *_ = np.linalg.lstsq(np.stack([x**2, z**2], axis=-1), 2 * z, rcond=None)
    conic = float(ck / c - 1) if c > 0 else -1.0
    with np.errstate(invalid="ignore"):
        fitted_sag = c * x**2 / (1 + np.sqrt(1 - (1 + conic) * c**2 * x**2))
    is_conic = bool(np.abs(fitted_sag - z).max() < CONIC_TOLERANCE_MM)
    nodes = np.zeros((0, 3)) if is_conic else np.stack(profile, axis=-1)
    return float(c), conic, nodes.astype(np.float32)


# -- Rendering with compiled kernels ---------------------------------------------------------------
#
# Rays are not stored, except those that reach the background.

ROWS_AT_ONCE = 64  # rows of an environment between progress reports
# Relative to the rim radius: maximum distance of ray origins from the box around the mirror grid
ORIGIN_MARGIN = 0.02


class _SceneTransform(NamedTuple):
    """Scene without its placement: directions are rotated, and points then shifted, or all moved to
    the shift.
    """

    scene: Scene
    turn: Array
    """Rotation (3, 3) from the sensor world."""
    shift_mm: Array
    """Sensor world origin (3,) in the scene, mm."""
    distant: bool

    def frame(self) -> SceneFrame:
        return SceneFrame(tuple(self.turn.ravel()), tuple(self.shift_mm), self.distant)


def _scene_transform(scene: Scene) -> _SceneTransform:
    if isinstance(scene, DistantScene):
        return _scene_transform(scene.scene)._replace(distant=True)
    if isinstance(scene, PosedScene):
        inner, pose = _scene_transform(scene.scene), scene.pose
        shift = inner.shift_mm if inner.distant else inner.turn @ pose.shift_mm + inner.shift_mm
        return inner._replace(turn=inner.turn @ pose.rotation(), shift_mm=shift)
    return _SceneTransform(scene, np.eye(3), np.zeros(3), False)


def compiled_light(
    sensor: Sensor,
    scene: Scene,
    plan: Samples,
    radiometry: Radiometry,
    on_progress: Progress | None = None,
    workers: int | None = None,
    conversion: PixelConversion = LIGHT,
) -> NDArray[Any] | None:
    """Render the image (rows, columns, 3) of a scene supported by the kernels; None for others.

    Parameters
    ----------
    sensor
        Sensor supported by the kernels
        (:func:`~omnimirror.simulation._compiled_rendering.is_for_kernels`).
    scene
    plan
    radiometry
    on_progress
    workers
    conversion
    """
    transform = _scene_transform(scene)
    if isinstance(transform.scene, Environment):
        return _render_environment(
            sensor, transform.scene, transform, plan, radiometry, on_progress, conversion
        )
    # Rays past the mirror have arbitrary origins
    if isinstance(transform.scene, PaintedScene) and not radiometry.direct_view:
        starts = (
            rotate_vectors(mirror_grid(sensor).reshape(-1, 3), transform.turn.T)
            + transform.shift_mm
        )
        starts = np.where(transform.distant, transform.shift_mm, starts)
        margin = 0.0 if transform.distant else ORIGIN_MARGIN * sensor.mirror.rim_radius_mm
        surroundings = transform.scene.surroundings_from(
            starts.min(axis=0) - margin, starts.max(axis=0) + margin
        )
        if surroundings is not None:
            optics = native_optics(sensor, radiometry, plan.blur, transform.frame())
            light_of = partial(_render_surfaces, optics, surroundings, plan)
            return render_tiles(
                light_of, sensor.image_size, len(plan.points), on_progress, workers, conversion
            )
    return None


def _render_environment(
    sensor: Sensor,
    world: Environment,
    transform: _SceneTransform,
    plan: Samples,
    radiometry: Radiometry,
    on_progress: Progress | None,
    conversion: PixelConversion,
) -> NDArray[Any]:
    frame = transform._replace(turn=world.heading() @ transform.turn).frame()
    optics = native_optics(sensor, radiometry, plan.blur, frame)
    width, height = sensor.image_size
    image = conversion.empty((width, height))
    for top in range(0, height, ROWS_AT_ONCE):
        light = np.empty((min(ROWS_AT_ONCE, height - top), width, 3), np.float32)
        backend.kernels.expose_environment(
            optics, world.native, plan.points, plan.blur, plan.seed, 0, top, light
        )
        image[top : top + len(light)] = conversion.read(light)
        if on_progress is not None:
            on_progress(top + len(light), height)
    return image


def _render_surfaces(
    optics: object, surroundings: Surroundings, plan: Samples, tile: Tile
) -> Light:
    rows, columns = tile
    light = np.empty((rows.stop - rows.start, columns.stop - columns.start, 3), np.float32)
    background = surroundings.background
    max_rays = 0 if background is None else light.size // 3 * len(plan.points)
    pixels, rays = np.empty(max_rays, np.int32), np.empty((max_rays, 7), np.float32)
    surfaces, start = surroundings.surfaces.native, (columns.start, rows.start)
    count = backend.kernels.expose_surfaces(
        optics, surfaces, plan.points, plan.blur, plan.seed, *start, light, pixels, rays
    )
    if background is not None and count:
        share, origins, directions = np.split(rays[:count].astype(float), (1, 4), axis=1)
        first = np.flatnonzero(
            np.diff(pixels[:count], prepend=-1)
        )  # rays of a pixel are consecutive
        sums = np.add.reduceat(share * background.radiance(origins, directions), first, axis=0)
        light.reshape(-1, 3)[pixels[first]] += sums.astype(np.float32)
    return light
