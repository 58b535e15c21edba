"""Pixel rays: sampling of pixel and aperture, reflection, obscurations, transparent housings."""

from __future__ import annotations

from dataclasses import dataclass
from math import isqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import integer
from ..base.colour import Light
from ..base.errors import InvalidParameter
from ..base.typing import Array, Mask
from ..cameras.camera import Camera, Projection, inside_image, rotate_vectors
from ..optics.housing import NO_HOUSING, FlatWindow, Shell
from ..optics.sensor import Sensor
from ..optics.tracing.shell_transmission import ShellTransit, transmit_from_inside
from .radiometry import Radiometry, camera_front
from .scenes.scene import MeasurableScene, Scene

# -- Sampling of pixel and aperture ----------------------------------------------------------------
#
# Rays are uniform in all four dimensions (an additive recurrence), with a different shift in each
# pixel, which turns the remaining error into fine grain without pattern. Sharp images need two
# dimensions only and use a regular grid.

MAX_SAMPLES = 1 << 16
PLASTIC_NUMBERS = {2: 1.32471795724474602596, 4: 1.16730397826141868426}
"""Roots of g^(d+1) = g + 1, whose powers are the steps of the recurrence (Roberts, 2018)."""


class Samples(NamedTuple):
    """Samples of every pixel."""

    points: NDArray[np.float32]
    """Points (n, 4) in [0, 1): across and down the pixel, and on the aperture."""
    blur: bool
    """True if samples are distributed over the aperture; each pixel then has its own cyclic shift.
    """
    seed: int


def sampling_plan(samples: int, blur: bool, seed: int = 0) -> Samples:
    """Return samples for each pixel.

    Parameters
    ----------
    samples
        Rays per pixel.
    blur
        True to sample the aperture, too; otherwise all rays pass through its centre.
    seed
        Random seed of the shifts.

    Raises
    ------
    InvalidParameter
        If the number of samples is out of range, or the seed is not a 32-bit integer.

    Examples
    --------
    >>> sampling_plan(4, blur=False).points[:, :2].tolist()
    [[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]
    """
    integer("samples", samples, 1, MAX_SAMPLES)
    integer("seed", seed, 0, 2**32 - 1)
    points = np.zeros((samples, 4))
    side = isqrt(samples)
    if blur:
        points[:] = _recurrence(samples, 4)
    elif side * side == samples:
        u = (np.arange(side) + 0.5) / side
        points[:, :2] = np.stack(np.meshgrid(u, u), axis=-1).reshape(-1, 2)
    else:  # identical in every pixel: half of the points, and their reflections at its centre, to avoid a shift
        half = _recurrence(samples // 2 + 1, 2)[1:]  # without the centre itself
        points[:, :2] = np.concatenate([half, 1 - half, np.full((samples % 2, 2), 0.5)])
    return Samples(np.minimum(points, 1 - 2.0**-24).astype(np.float32), blur, int(seed))


def _recurrence(count: int, dimensions: int) -> Array:
    steps = PLASTIC_NUMBERS[dimensions] ** -np.arange(1.0, dimensions + 1)
    points: Array = (0.5 + np.arange(count)[:, None] * steps) % 1.0
    return points


def sample_positions(samples: Samples, columns: ArrayLike, rows: ArrayLike) -> tuple[Array, Array]:
    """Return pixels (..., n, 2) and aperture points (..., n, 2) of the unit disc, for pixels given
    by column and row.

    Shifts are a hash of the pixel, as in the compiled kernels (Wellons, "lowbias32").
    """
    columns, rows = np.broadcast_arrays(np.asarray(columns, np.int64), np.asarray(rows, np.int64))
    p = samples.points.astype(float)
    if samples.blur:
        p = (p + _pixel_shifts(columns, rows, samples.seed)[..., None, :]) % 1.0
    else:
        p = np.broadcast_to(p, (*columns.shape, *p.shape))
    pixels = np.stack([columns, rows], axis=-1)[..., None, :] + p[..., :2] - 0.5
    radius, turn = np.sqrt(p[..., 2]), 2 * np.pi * (p[..., 3] - 0.5)
    aperture = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=-1)
    return pixels, aperture


def _pixel_shifts(columns: NDArray[np.int64], rows: NDArray[np.int64], seed: int) -> Array:
    h = _hash(np.uint32(seed) ^ _hash(columns.astype(np.uint32) + _hash(rows.astype(np.uint32))))
    shifts = []
    for _ in range(4):
        shifts.append((h >> np.uint32(8)) * 2.0**-24)
        h = _hash(h + np.uint32(0x9E3779B9))
    return np.stack(shifts, axis=-1)


def _hash(h: NDArray[np.uint32]) -> NDArray[np.uint32]:
    h = np.asarray(h, np.uint32)
    h = h ^ (h >> np.uint32(16))
    h = h * np.uint32(0x7FEB352D)
    h = h ^ (h >> np.uint32(15))
    h = h * np.uint32(0x846CA68B)
    mixed: NDArray[np.uint32] = h ^ (h >> np.uint32(16))
    return mixed


# -- Transparent housings: refraction, transmission and ghosts -------------------------------------

MAX_GHOST_ORDER = 2  # higher-order ghosts have less than 0.001 of the light
ORIGIN_TOLERANCE_MM = 1e-4  # tolerance of a ray origin on a surface: single precision
ORIGIN_OFFSET_MM = 1e-6  # offset of a ray origin from the surface that it leaves


def intersects_lid(
    shell: Shell, lids_mm: tuple[float, ...], points: Array, directions: Array
) -> NDArray[np.bool_]:
    """Return the mask of rays (n, 3), (n, 3) from inside that end at opaque parts of a shell before
    its wall.

    Opaque parts are the discs that close it at heights; for a window, all except its opening.
    """
    if isinstance(shell, FlatWindow):
        return ~_meets_disc(
            points, directions, shell.heights_mm[0], (shell.diameter_mm or np.inf) / 2
        )
    meets = np.zeros(len(points), dtype=bool)
    for height in lids_mm:
        meets |= _meets_disc(points, directions, height, shell.inner_radius_mm(height))
        # Reflected exactly in the corner
        meets |= (points[:, 2] - height) * np.sign(height) > -ORIGIN_TOLERANCE_MM
    return meets


def _meets_disc(
    points: Array, directions: Array, height: float, radius: float
) -> NDArray[np.bool_]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (height - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + t[:, None] * directions[:, :2]
        meets: NDArray[np.bool_] = (t * np.abs(directions[:, 2]) > ORIGIN_TOLERANCE_MM) & (
            np.hypot(*across.T) < radius
        )
    return meets


class _Ghosts(NamedTuple):
    """Rays reflected by a wall."""

    points: Array
    directions: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class ThroughShell:
    """Scene seen by a sensor through a tube or a dome.

    Rays are refracted at both sides of the wall by Snell's law and attenuated by Fresnel's
    equations. The light reflected by the wall is the ghost: at the mirror it is reflected again, at
    the back of the mirror or a lid it ends, and otherwise it passes the wall to another part of the
    scene, or is reflected again. Ghosts have no absorption at the mirror. Lids are black.

    Parameters
    ----------
    scene
    shell : Tube or Dome
        Shell with known dimensions.
    sensor
        Sensor inside; rays start from its mirror.
    lids_mm
        Heights over the mirror vertex (away from the lens) of opaque discs that close it.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.optics.housing import Tube
    >>> from omnimirror import Environment
    >>> sensor = om.load_sensor("paper-spherical")
    >>> white = ThroughShell(Environment(np.ones((4, 8, 3), np.float32)), Tube(120.0), sensor)
    >>> white.radiance(np.array([[0, 0, -20.0]]), np.array([[1.0, 0, 0]])).round(4)  # all but a ghost's ghost's ghost
    array([[0.9996, 0.9996, 0.9996]], dtype=float32)
    """

    scene: Scene
    shell: Shell
    sensor: Sensor
    lids_mm: tuple[float, ...] = ()

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Return linear RGB (n, 3) of rays (n, 3) of the sensor world frame that start inside.

        Raises
        ------
        InvalidParameter
            If a ray starts outside.
        """
        turn = self.sensor.mount.rotation()
        points, towards = (rotate_vectors(v, turn) for v in (origins_mm, directions))
        light = np.zeros(points.shape)
        active = np.flatnonzero(~intersects_lid(self.shell, self.lids_mm, points, towards))
        points, towards, share = points[active], towards[active], np.ones(len(active))
        for _ in range(1 + MAX_GHOST_ORDER):
            transit = transmit_from_inside(self.shell, points, towards)
            radiance = self.scene.radiance(
                rotate_vectors(transit.points, turn.T), rotate_vectors(transit.directions, turn.T)
            )
            light[active] += (share * transit.passed)[:, None] * radiance
            ghosts = self._ghosts(transit)
            active, share = active[ghosts.alive], (share * (1 - transit.passed))[ghosts.alive]
            points, towards = ghosts.points[ghosts.alive], ghosts.directions[ghosts.alive]
        return light.astype(np.float32)

    def _ghosts(self, transit: ShellTransit) -> _Ghosts:
        """Return the continuation of reflected rays."""
        mirror = self.sensor.optical_train.posed_mirror
        points, directions = (transit.met + ORIGIN_OFFSET_MM * transit.reflected, transit.reflected)
        reflected = mirror.trace(points, directions)
        points = np.where(
            reflected.valid[:, None],
            reflected.points + ORIGIN_OFFSET_MM * reflected.directions,
            points,
        )
        directions = np.where(reflected.valid[:, None], reflected.directions, directions)
        rim = self.sensor.mirror.rim_radius_mm
        back = (
            float(self.sensor.mirror.sag(np.array(rim))) + self.sensor.mirror_pose.displacement_mm
        )
        alive = ~(
            _meets_disc(points, directions, back, rim)
            | intersects_lid(self.shell, self.lids_mm, points, directions)
        )
        return _Ghosts(points, directions, alive)


def scene_through_shell(camera: Camera, scene: Scene) -> Scene:
    """Return the scene through the tube or dome of the housing of a camera; unchanged without one."""
    if not isinstance(camera, Sensor) or camera.housing.shell is None:
        return scene
    obstructions = camera.obstructions
    assert obstructions.housing.shell is not None
    return ThroughShell(
        scene, obstructions.housing.shell, camera, tuple(lid.height_mm for lid in obstructions.lids)
    )


# -- Pixel rays and obscurations -------------------------------------------------------------------

Outcomes = NDArray[np.uint8]

LOST, REFLECTED, DIRECT, OBSCURED = range(4)  # outcome of a ray; values of the compiled kernels
OUTLINE_LINES = 64  # lines from the vertex to the rim


class TracedRays(NamedTuple):
    """Rays (n,) traced from the lens, in the camera frame; as they leave the lens for rays that
    miss the mirror.
    """

    points: Array
    """Points (n, 3) on the mirror, mm."""
    directions: Array
    """Directions (n, 3)."""
    from_lens: Array
    """Directions (n, 3) at the lens."""
    hit: Mask
    """Mask (n,) of rays that meet the mirror."""
    outcome: Outcomes
    """Outcome (n,): ``LOST``, ``REFLECTED``, ``DIRECT`` past the mirror, or ``OBSCURED`` by camera, rod
    or rim.
    """


def trace_to_scene(
    sensor: Sensor, pixels: Array, pupil: Array, radiometry: Radiometry
) -> TracedRays:
    """Trace rays of pixels (n, 2) through points (n, 2) of the unit disc of the aperture, in double
    precision.
    """
    start, towards = sensor.lens_rays(pixels, pupil)
    reflection = sensor.optical_train.posed_mirror.trace(start, towards)
    hit = reflection.valid
    points, directions = (
        np.where(hit[:, None], reflection.points, start),
        np.where(hit[:, None], reflection.directions, towards),
    )
    outcome = np.where(hit, REFLECTED, DIRECT if radiometry.direct_view else LOST).astype(np.uint8)
    outcome[~np.isfinite(towards[:, 2])] = LOST  # beyond the fold of the distortion
    if pupil.any():  # chief rays alone use the vignetting of the lens as a weight
        outcome[~sensor.optical_train.passes_lens(start, towards)] = LOST
    obstructions = sensor.obstructions
    outcome[hit & obstructions.meets_front(points, directions, -towards)] = OBSCURED
    outcome[obstructions.meets_rim(points, directions, sensor.mirror_pose)] = OBSCURED
    return TracedRays(points, directions, towards, hit, outcome)


def front_shade(sensor: Sensor, points: Array, directions: Array, towards_lens: Array) -> Array:
    """Return the relative brightness (n,) of the targets of mirrored rays (n, 3): parts of the
    camera front; 1 elsewhere.
    """
    obstructions = sensor.obstructions
    if obstructions.camera is None:
        return np.ones(len(points))
    meets, across = obstructions.camera.blocks(points, directions)
    if obstructions.rod is not None:
        meets &= ~(
            obstructions.rod.blocks(points, directions)
            | obstructions.rod.blocks(points, towards_lens)
        )
    return np.where(meets, camera_front(2 * across / obstructions.front_ring_mm), 1.0)


def check_housing_is_rendered(sensor: Sensor) -> None:
    """Raise InvalidParameter for housings that are not rendered: those around two mirrors."""
    if sensor.secondary is not None and sensor.housing != NO_HOUSING:
        raise InvalidParameter(
            "the housing must be empty for rendering and ground truth of two mirrors; "
            f"{sensor.name!r} has both; use replace(sensor, housing=Housing())"
        )


def mirror_grid(sensor: Sensor) -> Array:
    """Return world points (lines from the vertex, lines around, 3) of the mirror, mm, including the
    rim.
    """
    x = np.linspace(0.0, sensor.mirror.rim_radius_mm, OUTLINE_LINES // 2 + 1)
    turn = np.linspace(0, 2 * np.pi, OUTLINE_LINES + 1)
    across = np.stack([x[:, None] * np.cos(turn), x[:, None] * np.sin(turn)], axis=-1)
    sag = np.broadcast_to(sensor.mirror.sag(x)[:, None, None], (*across.shape[:2], 1))
    rotation = sensor.mount.rotation()
    points = sensor.mirror_pose.to_camera(np.concatenate([across, sag], axis=-1).reshape(-1, 3))
    # A lens that views it via a second mirror has the opposite direction
    points[:, 2] *= np.sign(-sensor.axis @ rotation[:, 2])
    return rotate_vectors(points, rotation.T).reshape(*across.shape[:2], 3)


def check_clearance(sensor: Sensor, scene: Scene) -> None:
    """Raise InvalidParameter if a scene intersects the mirror, tested along lines from the vertex
    to the rim and around it.

    Scenes without distances are not tested.
    """
    scene = scene.scene if isinstance(scene, ThroughShell) else scene
    if not isinstance(scene, MeasurableScene):
        return
    grid = mirror_grid(sensor)
    start = np.concatenate([grid[:-1].reshape(-1, 3), grid[1:, :-1].reshape(-1, 3)])
    end = np.concatenate([grid[1:].reshape(-1, 3), grid[1:, 1:].reshape(-1, 3)])
    if (scene.distance_mm(start, end - start) < np.linalg.norm(end - start, axis=1)).any():
        raise InvalidParameter(
            "the mirror must not intersect the scene; change the pose, or check the unit of the mesh"
        )


class PixelRays(NamedTuple):
    """Lines of sight of pixels (n,) in the world frame of the sensor; NaN if not valid."""

    origins: Array
    """Origins (n, 3), mm: on the mirror, on the outer side of a tube or dome, or, past the mirror,
    at the lens.
    """
    directions: Array
    """Unit vectors (n, 3) of the directions."""
    valid: Mask
    """Mask (n,) of rays that leave the sensor."""
    hidden: Mask
    """Mask (n,) of rays that end at camera, rod, rim or a lid, or at the secondary or the bore of
    two mirrors.
    """


def trace_pixels(
    camera: Camera, pixels: ArrayLike, radiometry: Radiometry | None = None
) -> PixelRays:
    """Return the chief rays of pixels (n, 2) past obstructions and through a tube or a dome.

    Parameters
    ----------
    camera
    pixels
    radiometry
        Radiometry of a single-mirror sensor, which determines the visibility past its mirror.

    Raises
    ------
    InvalidParameter
        If radiometry is given for a camera that is not a sensor, or the housing has two mirrors.

    Examples
    --------
    In the centre, the sensor images its own camera:

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    >>> rays = trace_pixels(sensor, [[511.5, 511.5], [900.0, 511.5]])
    >>> rays.valid, rays.hidden
    (array([False,  True]), array([ True, False]))
    """
    pixels = np.asarray(pixels, dtype=float)
    if not isinstance(camera, Sensor) or camera.secondary is not None:
        if radiometry is not None:
            raise InvalidParameter(
                "radiometry must be omitted unless the camera is a sensor with one mirror"
            )
        if isinstance(camera, Sensor):
            check_housing_is_rendered(camera)
        rays, hidden = camera.backproject(pixels), np.zeros(len(pixels), dtype=bool)
        if isinstance(camera, Sensor):
            hidden |= np.logical_or.reduce([*camera.obscured_by(pixels).values()])
            hidden &= inside_image(pixels, camera.image_size) & ~rays.valid
        return PixelRays(rays.origins, _unit(rays.directions), rays.valid, hidden)
    traced, obstructions = (
        trace_to_scene(camera, pixels, np.zeros_like(pixels), radiometry or Radiometry()),
        camera.obstructions,
    )
    points, directions, hidden = (
        traced.points,
        _unit(traced.directions),
        traced.outcome == OBSCURED,
    )
    valid = (traced.outcome == REFLECTED) | (traced.outcome == DIRECT)
    if (shell := obstructions.housing.shell) is not None:
        for disc in obstructions.discs:  # lids and the frame of a window
            hidden |= valid & (disc.clearance(points, directions) < 0)
        transit = transmit_from_inside(shell, points[valid], directions[valid])
        points[valid], directions[valid] = transit.points, transit.directions
        valid &= ~hidden
    points[~valid] = directions[~valid] = np.nan
    rotation = camera.mount.rotation().T
    return PixelRays(
        rotate_vectors(points, rotation), rotate_vectors(directions, rotation), valid, hidden
    )


def project_visible(camera: Camera, points_mm: ArrayLike) -> Projection:
    """Return pixels (n, 2) of points (n, 3) mm in the camera world; for a sensor, via its mirror.

    Points hidden by the housing are not valid.

    Raises
    ------
    InvalidParameter
        As in :func:`trace_pixels`.
    """
    points = np.asarray(points_mm, dtype=float)
    pixels, valid = camera.project(points)
    if isinstance(camera, Sensor) and camera.housing != NO_HOUSING:
        valid[valid] = ~trace_pixels(camera, pixels[valid]).hidden
    pixels[~valid] = np.nan
    return Projection(pixels, valid)


def _unit(directions: Array) -> Array:
    unit: Array = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    return unit
