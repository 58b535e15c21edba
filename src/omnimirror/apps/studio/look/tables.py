"""A camera as tables that a graphics card reads: pixels of directions and points, to some thousandths of a pixel.

A camera with an axis of symmetry is its tables over sin(Omega/2), as in :mod:`omnimirror.dewarp.maps.radial_table`,
but shorter.
One without is a lattice of pixels over the disk ``sin(Omega/2) (cos phi, sin phi)`` about its axis, which
looks much like the picture itself, a table of where the field ends and, of a mirror, a lattice of where the rays start.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....cameras.camera import inside_image
from ....cameras.frames import Mount, turned
from ....cameras.models import MirrorBall, OCam, ViewpointSpline
from ....dewarp.camera_field import field_of
from ....dewarp.maps.radial_table import tables_of
from ....optics.housing import Tube
from ....optics.sensor import Sensor
from ....optics.sensor_files import AnyCamera
from ....optics.tracing.reflection import Ends
from .lattices import TAPS, Exact, PartOf, continued, lattice_of, weights_between
from .messages import CameraShown, Kind, MountOf, TableLayout

Array = NDArray[np.float64]

ENTRIES = 2048  # what every WebGL2 texture can be wide
LATTICE = 513
LIMITS = 1024
STEP = 2e-7  # of sin(Omega/2), to which the end of the field is known
FEW = 64  # azimuths at which it is looked for first
CALL = 1024  # places that take as long as what every call takes besides
NEAR = (STEP / 2, 2.0**-12)  # to both sides of where the others tell it
MARGIN = 1.02


class CameraTables(NamedTuple):
    """What the values are, and the values."""

    layout: TableLayout
    values: NDArray[np.float32]


class Frame(NamedTuple):
    """World directions (3,) of the axis of a camera, and of the right and the lower side of its picture."""

    axis: Array
    right: Array
    down: Array


def frame_of(camera: AnyCamera) -> Frame:
    """The frame in which the tables of a camera are."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return Frame(symmetry.axis, symmetry.right, symmetry.down)
    x, y, _ = camera.mount.rotation().T
    return Frame(camera.axis, -x if camera.mount.image_flipped else x, y)


@lru_cache(maxsize=32)
def camera_tables(camera: AnyCamera) -> CameraTables:
    """The tables of a camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> layout, values = camera_tables(om.load_sensor("paper-spherical"))
    >>> layout.radii, layout.origins, values.shape
    (2048, 2048, (6144,))
    """
    symmetry = camera.symmetry
    if symmetry is None:
        return _lattice_tables(camera)
    t = tables_of(symmetry, ENTRIES, ENTRIES)
    layout = TableLayout(
        first=t.first, last=t.last, eye_mm=t.viewpoint, radii=len(t.radii), origins=len(t.origins),
        lattice=0, limits=0, starts=0,
    )  # fmt: skip
    return CameraTables(layout, np.concatenate([t.radii, *t.origins.T]).astype(np.float32))


@lru_cache(maxsize=64)
def camera_model(id: str, name: str, title: str, options: tuple[str, ...], camera: AnyCamera) -> CameraShown:
    """What the page must know of a camera, besides its tables."""
    seen, frame, layout = field_of(camera), frame_of(camera), camera_tables(camera).layout
    centre, radius = _circle(camera)
    return CameraShown(
        id=id,
        name=name,
        title=title,
        kind=kind_of(camera),
        options=options,
        mount=mount_message(camera.mount),
        mount_in_file=mount_message(camera.mount),
        image_size=camera.image_size,
        centre_px=centre,
        rim_radius_px=radius,
        axis=_vector(frame.axis),
        right=_vector(frame.right),
        down=_vector(frame.down),
        tilt_min_deg=seen.tilt_min_deg,
        tilt_max_deg=seen.tilt_max_deg,
        pixels_per_degree=seen.pixels_per_degree,
        pole=seen.pole,
        is_picture_reversed=camera.is_picture_reversed,
        is_adjustable=camera.symmetry is not None and isinstance(camera, Sensor | MirrorBall),
        tables=layout,
    )


def kind_of(camera: AnyCamera) -> Kind:
    """Which option of the command line names such a camera."""
    return "ocam" if isinstance(camera, OCam) else "ball" if isinstance(camera, MirrorBall) else "sensor"


def title_of(camera: AnyCamera) -> str:
    """What a camera is, in a line."""
    if isinstance(camera, Sensor):
        return (camera.notes.strip().splitlines() or [f"{camera.mirror.KIND} mirror"])[0]
    if isinstance(camera, OCam):
        return f"OCamCalib, {camera.optics}"
    if isinstance(camera, MirrorBall):
        return f"a ball seen from afar, field {camera.field_deg:g}°"
    return f"calibrated {camera.optics}, {camera.KIND.replace('-', ' ')} model"


def mount_message(mount: Mount) -> MountOf:
    """A mount, to be told."""
    return MountOf(
        camera_looks=mount.camera_looks,
        forward_azimuth_deg=mount.forward_azimuth_deg,
        image_flipped=mount.image_flipped,
        pitch_deg=mount.pitch_deg,
        roll_deg=mount.roll_deg,
    )


# -- cameras without an axis of symmetry -----------------------------------------------------------


def _lattice_tables(camera: AnyCamera) -> CameraTables:
    project = _projection(camera)
    limits = _limits(project)
    end = min(1.0, MARGIN * float(limits.max()))
    ask = _with_starts(camera, project) if isinstance(camera, Sensor | ViewpointSpline) else project
    ask = _within(limits, 2 * end / (LATTICE - 1), ask)
    found = continued(lattice_of(ask, np.linspace(-end, end, LATTICE), _sides_of_tube(camera)))
    pixels, starts = np.nan_to_num(found[..., :2], nan=-1e6), np.nan_to_num(found[..., 2:])
    layout = TableLayout(
        first=0.0, last=end, eye_mm=0.0, radii=0, origins=0, lattice=LATTICE, limits=LIMITS,
        starts=LATTICE if starts.size else 0,
    )  # fmt: skip
    return CameraTables(layout, np.concatenate([np.ravel(v) for v in (pixels, limits, starts)]).astype(np.float32))


def _within(limits: Array, margin: float, ask: Exact) -> Exact:
    """The same, without asking about places (n, 2) that lie farther than a margin beyond the end of the field."""

    def asked(places: Array) -> Array:
        end = np.interp(np.arctan2(*places.T[::-1]) % (2 * np.pi), _azimuths(), np.append(limits, limits[0]))
        near = np.hypot(*places.T) <= end + margin
        found = ask(places[near])
        values = np.full((len(places), found.shape[1]), np.nan)
        values[near] = found
        return values

    return asked


def _with_starts(camera: Sensor | ViewpointSpline, project: Exact) -> Exact:
    """Pixels of places, and where (n, 3) their rays start, mm along axis, right and down; NaN outside the field."""
    axes = np.stack(frame_of(camera), axis=-1)
    if isinstance(camera, Sensor) and not camera.is_axial and camera.secondary is None:
        return _traced_once(camera, axes)

    def traced(places: Array) -> Array:
        pixels = project(places)
        seen = np.isfinite(pixels[:, 0])
        starts = np.full((len(places), 3), np.nan)
        starts[seen] = turned(camera.backproject(pixels[seen]).origins, axes)
        return np.concatenate([pixels, starts], axis=1)

    return traced


def _traced_once(sensor: Sensor, axes: Array) -> Exact:
    """The same of a sensor that is traced in space, where what finds a pixel comes by where its ray starts."""
    train, rotation = sensor.optical_train, sensor.mount.rotation()

    def traced(places: Array) -> Array:
        values = np.full((len(places), 5), np.nan)
        inside, directions = _directions_of(places, axes.T)
        image, start = train.image_and_start_of(Ends.of(turned(directions, rotation), distant=True))
        pixels = sensor.image_plane.pixels(image)
        found = np.concatenate([pixels, turned(start, rotation.T @ axes)], axis=1)
        found[~inside_image(pixels, sensor.image_size)] = np.nan
        values[inside] = found
        return values

    return traced


def _sides_of_tube(camera: AnyCamera) -> PartOf | None:
    """Whether rays start on the mirror (0), past an end of the tube about it, or on the tube (1); None without one."""
    shell = camera.housing.shell if isinstance(camera, Sensor) else None
    if not isinstance(camera, Sensor) or not isinstance(shell, Tube):
        return None
    between = (camera.mirror.rim_radius_mm + shell.radii_mm[1]) / 2
    return lambda found: (np.hypot(found[..., 3], found[..., 4]) > between).astype(np.intp)


def _projection(camera: AnyCamera) -> Exact:
    """Pixels (n, 2) of places (n, 2) in the disk; NaN outside the field."""
    frame = np.stack(frame_of(camera))

    def project(places: Array) -> Array:
        pixels = np.full((len(places), 2), np.nan)
        inside, directions = _directions_of(places, frame)
        pixels[inside] = camera.project_directions(directions).pixels
        return pixels

    return project


def _directions_of(places: Array, frame: Array) -> tuple[NDArray[np.bool_], Array]:
    """Which of places (n, 2) lie in the disk, and the directions (k, 3) of these."""
    sine2 = np.einsum("ni,ni->n", places, places)  # of half the angle
    inside = sine2 <= 1
    across = 2 * np.sqrt(1 - sine2[inside, None]) * places[inside]
    return inside, np.concatenate([1 - 2 * sine2[inside, None], across], axis=1) @ frame


def _limits(project: Exact) -> Array:
    """Where the field ends, sin(Omega/2), in even steps of the azimuth.

    Some azimuths tell the others. Of each of these it is asked whether the field ends between two places close to each
    other, of which the inner one is seen; if not, between two farther apart; if not, it is looked for everywhere.
    """
    phi = _azimuths()[:-1]
    few = _narrowed(project, phi[:: LIMITS // FEW], np.zeros(FEW), 1.0)
    places = TAPS // 2 - 1 + np.arange(0.0, 1.0, FEW / LIMITS)
    beside = np.stack([np.roll(few, TAPS // 2 - 1 - k) for k in range(TAPS)], axis=1)
    told = (beside @ weights_between(places, np.zeros(len(places), int)).T).ravel()
    ends, unknown = np.zeros(LIMITS), np.arange(LIMITS)
    for near in NEAR:
        inner, outer = told[unknown] - near, np.minimum(told[unknown] + near, 1.0)
        is_there = _seen(project, phi[unknown], inner) & ~_seen(project, phi[unknown], outer)
        found, unknown = unknown[is_there], unknown[~is_there]
        ends[found] = _narrowed(project, phi[found], inner[is_there], 2 * near)
    ends[unknown] = _narrowed(project, phi[unknown], ends[unknown], 1.0)
    return ends


def _narrowed(project: Exact, phi: Array, low: Array, width: float) -> Array:
    """Ends (n,) of the field at azimuths (n,), which lie by no more than a width above others, to :data:`STEP`."""
    parts = min(max(CALL // max(len(phi), 1), 2), 16)  # into which a width is divided at once
    while width > STEP and len(phi):
        width /= parts
        tried = low + width * np.arange(1, parts)[:, None]
        seen = _seen(project, np.broadcast_to(phi, tried.shape).ravel(), tried.ravel()).reshape(tried.shape)
        low = low + width * np.where(seen.all(axis=0), parts - 1, seen.argmin(axis=0))
    return low


def _seen(project: Exact, phi: Array, sine: Array) -> NDArray[np.bool_]:
    """Whether directions at azimuths (n,) and sin(Omega/2) (n,) are seen."""
    return np.asarray(np.isfinite(project(sine[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1))[:, 0]))


def _azimuths() -> Array:
    """Of the ends of the field, once around."""
    return np.linspace(0.0, 2 * np.pi, LIMITS + 1)


def _circle(camera: AnyCamera) -> tuple[tuple[float, float], float]:
    """Image of the axis, and radius of the end of the field; their best circle where it is none."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return symmetry.centre_px, float(symmetry.radius_px(np.array([symmetry.omega_max]))[0])
    if isinstance(camera, Sensor):
        return camera.imager.centre, camera.aligned().rim_radius_px
    return camera.centre_px, camera.field_radius_px


def _vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
