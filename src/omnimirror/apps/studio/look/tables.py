"""Camera projection as lookup tables for the GPU, accurate to a few 0.001 px.

A rotationally symmetric camera is tabulated over sin(Omega/2), as in
:mod:`omnimirror.dewarp.maps.radial_table`, with fewer entries. Other cameras are sampled on a
lattice of pixels over the disk ``sin(Omega/2) (cos phi, sin phi)`` about their axis, which
resembles the image, with a table of the field boundary and, for mirrors, a lattice of ray origins.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ....base.typing import Array
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

ENTRIES = 2048  # texture width that every WebGL2 implementation supports
LATTICE = 513
LIMITS = 1024
STEP = 2e-7  # accuracy of the field boundary in sin(Omega/2)
FEW = 64  # azimuths of the initial boundary search
CALL = 1024  # number of points whose evaluation takes as long as the overhead of a call
NEAR = (STEP / 2, 2.0**-12)  # half-widths of the bracket around the interpolated boundary
MARGIN = 1.02


class CameraTables(NamedTuple):
    """Table values with their layout."""

    layout: TableLayout
    values: NDArray[np.float32]


class Frame(NamedTuple):
    """World directions (3,) of the camera axis and of the right and lower sides of the image."""

    axis: Array
    right: Array
    down: Array


def frame_of(camera: AnyCamera) -> Frame:
    """Return the frame of the tables of a camera."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return Frame(symmetry.axis, symmetry.right, symmetry.down)
    x, y, _ = camera.mount.rotation().T
    return Frame(camera.axis, -x if camera.mount.image_flipped else x, y)


@lru_cache(maxsize=32)
def camera_tables(camera: AnyCamera) -> CameraTables:
    """Compute the tables of a camera.

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
    """Return the description of a camera for the page, without its tables."""
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
    """Return the command-line option for a camera of this kind."""
    return "ocam" if isinstance(camera, OCam) else "ball" if isinstance(camera, MirrorBall) else "sensor"


def title_of(camera: AnyCamera) -> str:
    """Return a one-line description of a camera."""
    if isinstance(camera, Sensor):
        return (camera.notes.strip().splitlines() or [f"{camera.mirror.KIND} mirror"])[0]
    if isinstance(camera, OCam):
        return f"OCamCalib, {camera.optics}"
    if isinstance(camera, MirrorBall):
        return f"a ball seen from afar, field {camera.field_deg:g}°"
    return f"calibrated {camera.optics}, {camera.KIND.replace('-', ' ')} model"


def mount_message(mount: Mount) -> MountOf:
    """Convert a mount to a message."""
    return MountOf(
        camera_looks=mount.camera_looks,
        forward_azimuth_deg=mount.forward_azimuth_deg,
        image_flipped=mount.image_flipped,
        pitch_deg=mount.pitch_deg,
        roll_deg=mount.roll_deg,
    )


# -- cameras without rotational symmetry
# ------------------------------------------------------------


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
    """Wrap a function to skip points (n, 2) farther than a margin outside the field boundary."""

    def asked(places: Array) -> Array:
        end = np.interp(np.arctan2(*places.T[::-1]) % (2 * np.pi), _azimuths(), np.append(limits, limits[0]))
        near = np.hypot(*places.T) <= end + margin
        found = ask(places[near])
        values = np.full((len(places), found.shape[1]), np.nan)
        values[near] = found
        return values

    return asked


def _with_starts(camera: Sensor | ViewpointSpline, project: Exact) -> Exact:
    """Return a function of pixels and ray origins (n, 3), mm along axis, right and down; NaN
    outside the field."""
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
    """Return the same function for a sensor that is ray-traced; the tracer returns pixel and ray
    origin together."""
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
    """Return a function of the ray origin: mirror (0), beyond an end of the tube (1), tube (1);
    None without tube."""
    shell = camera.housing.shell if isinstance(camera, Sensor) else None
    if not isinstance(camera, Sensor) or not isinstance(shell, Tube):
        return None
    between = (camera.mirror.rim_radius_mm + shell.radii_mm[1]) / 2
    return lambda found: (np.hypot(found[..., 3], found[..., 4]) > between).astype(np.intp)


def _projection(camera: AnyCamera) -> Exact:
    """Return a function of pixels (n, 2) of points (n, 2) in the disk; NaN outside the field."""
    frame = np.stack(frame_of(camera))

    def project(places: Array) -> Array:
        pixels = np.full((len(places), 2), np.nan)
        inside, directions = _directions_of(places, frame)
        pixels[inside] = camera.project_directions(directions).pixels
        return pixels

    return project


def _directions_of(places: Array, frame: Array) -> tuple[NDArray[np.bool_], Array]:
    """Return the mask of points (n, 2) inside the disk, and their directions (k, 3)."""
    sine2 = np.einsum("ni,ni->n", places, places)  # sin^2 of half the angle
    inside = sine2 <= 1
    across = 2 * np.sqrt(1 - sine2[inside, None]) * places[inside]
    return inside, np.concatenate([1 - 2 * sine2[inside, None], across], axis=1) @ frame


def _limits(project: Exact) -> Array:
    """Return the field boundary, sin(Omega/2), at equidistant azimuths.

    The boundary is searched at some azimuths and interpolated at the others. There, two nearby
    points test if the boundary is between them, with the inner one visible; on failure the bracket
    is widened, and finally the whole range is searched.
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
    """Refine the boundary (n,) at azimuths (n,) within a bracket of given width to :data:`STEP`."""
    parts = min(max(CALL // max(len(phi), 1), 2), 16)  # simultaneous subdivisions of the bracket
    while width > STEP and len(phi):
        width /= parts
        tried = low + width * np.arange(1, parts)[:, None]
        seen = _seen(project, np.broadcast_to(phi, tried.shape).ravel(), tried.ravel()).reshape(tried.shape)
        low = low + width * np.where(seen.all(axis=0), parts - 1, seen.argmin(axis=0))
    return low


def _seen(project: Exact, phi: Array, sine: Array) -> NDArray[np.bool_]:
    """Check if directions at azimuths (n,) and sin(Omega/2) (n,) are in the field."""
    return np.asarray(np.isfinite(project(sine[:, None] * np.stack([np.cos(phi), np.sin(phi)], axis=-1))[:, 0]))


def _azimuths() -> Array:
    """Return the azimuths of the field boundary over one turn."""
    return np.linspace(0.0, 2 * np.pi, LIMITS + 1)


def _circle(camera: AnyCamera) -> tuple[tuple[float, float], float]:
    """Return the image of the axis and the radius of the field boundary, or of its best-fit circle."""
    symmetry = camera.symmetry
    if symmetry is not None:
        return symmetry.centre_px, float(symmetry.radius_px(np.array([symmetry.omega_max]))[0])
    if isinstance(camera, Sensor):
        return camera.imager.centre, camera.aligned().rim_radius_px
    return camera.centre_px, camera.field_radius_px


def _vector(v: Array) -> tuple[float, float, float]:
    return float(v[0]), float(v[1]), float(v[2])
