"""Ray bundles from objects via the mirror through the sampled aperture to the imager."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import distances, finite, row
from ..base.errors import InvalidParameter, OutsideField
from ..base.typing import Array, Mask
from ..cameras.camera import camera_direction
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.reflection import RayEndpoints, ReflectionPoints

# -- Sampling of the aperture ----------------------------------------------------------------------
#
# The x and y axes of the aperture are those of the unflipped image, right and down.

MAX_RINGS = 500


class Pupil(NamedTuple):
    """Points of the unit disc with their relative areas."""

    points: Array
    """Points (n, 2)."""
    weights: Array
    """Weights (n,), normalised to the sum 1."""


def hexapolar(rings: int) -> Pupil:
    """Return the centre and 6, 12, 18 ... points on rings, for spot diagrams.

    >>> pupil = hexapolar(2)
    >>> len(pupil.points), pupil.weights.sum().round(12)
    (19, np.float64(1.0))
    """
    _check(rings)
    azimuths = np.repeat(np.arange(rings + 1), [1, *(6 * np.arange(1, rings + 1))])
    index = np.concatenate([[0.0], *(np.arange(6 * j) / (6 * j) for j in range(1, rings + 1))])
    radius, phi = azimuths / rings, 2 * np.pi * index
    borders = np.clip(
        (np.arange(rings + 2) - 0.5) / rings, 0, 1
    )  # halfway to the neighbouring rings
    area = np.diff(borders**2) / np.maximum(6 * np.arange(rings + 1), 1)
    return Pupil(np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1), area[azimuths])


def fibonacci(count: int) -> Pupil:
    """Return points on a spiral with equal areas, for densities.

    >>> fibonacci(100).points.shape
    (100, 2)
    """
    if not 1 <= count <= 10_000_000:
        raise InvalidParameter(
            f"the number of points of a pupil must be 1 to 10000000; got {count}"
        )
    i = np.arange(count) + 0.5
    radius, phi = np.sqrt(i / count), i * np.pi * (3 - 5**0.5)
    points = np.stack([radius * np.cos(phi), radius * np.sin(phi)], axis=-1)
    return Pupil(points, np.full(count, 1 / count))


def gaussian(rings: int) -> Pupil:
    """Return rings and spokes for exact integration of polynomials (Gauss in the squared radius).

    >>> x, y = gaussian(4).points.T
    >>> float(gaussian(4).weights @ (x**4 * y**2)).__round__(12)  # 1/64
    0.015625
    """
    _check(rings)
    u, weight = np.polynomial.legendre.leggauss(rings)
    radius, spokes = np.sqrt((u + 1) / 2), 4 * rings
    phi = 2 * np.pi * (np.arange(spokes) + 0.5) / spokes
    points = np.stack(
        [np.outer(radius, np.cos(phi)), np.outer(radius, np.sin(phi))], axis=-1
    ).reshape(-1, 2)
    return Pupil(points, np.repeat(weight / 2 / spokes, spokes))


def unvignetted_fraction(
    pupil: Pupil, clearances: Sequence[Array], passes: NDArray[np.bool_]
) -> float:
    """Return the fraction of the aperture inside all edges, from clearances (n,) at the points of a
    pupil.

    Counting rays as passing or blocked is a sum over a step function, with an error of the order of the
    ray spacing (0.016 for 12 rings). The clearance is continuous; it is interpolated linearly in the
    triangles between the points, and the area with positive clearance is exact there. The error is of
    the order of the squared spacing, below 0.003 for 12 rings.

    Parameters
    ----------
    passes
        Mask (n,) of the passing rays, which determines the unvignetted fraction of triangles with
        undefined clearances.

    Examples
    --------
    A straight edge at 0.3 of the radius of the aperture:

    >>> pupil = hexapolar(12)
    >>> clearance = pupil.points[:, 0] - 0.3
    >>> truth = (np.arccos(0.3) - 0.3 * np.sqrt(1 - 0.3**2)) / np.pi
    >>> bool(abs(unvignetted_fraction(pupil, [clearance], clearance >= 0) - truth) < 0.001)
    True
    """
    from scipy.spatial import Delaunay, QhullError

    if passes.all():
        return 1.0
    try:
        corners = Delaunay(pupil.points).simplices
    except QhullError:  # too few points for triangles
        return float(passes @ pupil.weights)
    a, b, c = pupil.points[corners].transpose(1, 0, 2)
    areas = np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
    fraction = np.ones(len(corners))
    is_known = np.zeros(len(pupil.points), dtype=bool)
    for edge in clearances:
        fraction = np.minimum(fraction, _positive_fraction(edge[corners]))
        is_known |= edge < 0
    is_lost = ~passes & ~is_known  # rays that no edge blocks and that reach no imager
    fraction = np.minimum(fraction, 1 - is_lost[corners].mean(axis=1))
    return float(fraction @ areas / areas.sum())


def _positive_fraction(values: Array) -> Array:
    """Return the fraction of the area of triangles in which linear functions are positive, from
    their
    values (n, 3) at the corners; infinite values are those of rays that never meet the edge.
    """
    finite = np.isfinite(values)
    largest = np.max(np.abs(values), axis=1, where=finite, initial=0.0, keepdims=True)
    low, middle, high = np.sort(
        np.where(finite, values, np.where(values < 0, -largest, largest)), axis=1
    ).T
    with np.errstate(divide="ignore", invalid="ignore"):
        one_in = high**2 / (
            (high - middle) * (high - low)
        )  # the corner of the positive value is cut off
        one_out = 1 - low**2 / ((middle - low) * (high - low))
    return np.select([low >= 0, high <= 0, middle <= 0], [1.0, 0.0, one_in], one_out)


def _check(rings: int) -> None:
    if not (1 <= rings <= MAX_RINGS and int(rings) == rings):
        raise InvalidParameter(f"rings must be an integer from 1 to {MAX_RINGS}; got {rings}")


# -- Ray bundles through the aperture --------------------------------------------------------------
#
# The mirror point of each aperture point is solved from object and pupil point (Fermat's principle);
# therefore the sampling of the aperture is independent of the pose of the mirror. For an ideal lens,
# a ray is imaged to the conjugate of its intersection with the plane in focus; a lens made of
# surfaces is traced. One bundle is valid for any focus.

NEARLY_INFINITE_MM = 1e6  # mm, replaces an infinite distance if a finite one is required
DIFFERENCE_STEP = 1e-4  # radians; the error of the central differences is then 1e-8


@dataclass(frozen=True)
class Bundles:
    """Rays of k objects through n points of the aperture, in the camera frame.

    Lengths in mm; the azimuth is measured from image right towards image bottom.
    """

    sensor: Sensor
    omega_deg: Array
    """Field angles (k,) of the chief rays, from the direction back past the lens."""
    azimuth_deg: Array
    """Azimuths (k,)."""
    object_distance_mm: Array
    """Distances (k,) from the mirror point of the chief ray to the object."""
    pupil: Pupil
    """Sampling with n points of the unit disc."""
    points: Array
    """Mirror points (k, n, 3), beyond the rim on the smooth extension of the mirror."""
    to_pupils: Array
    """Unit vectors (k, n, 3) from the mirror to the lens."""
    path: Array
    """Optical path lengths (k, n) from the object to the aperture (see :class:`ReflectionPoints`)."""
    density: Array
    """Light (k, n) of a point object through equal areas of the aperture, with mean 1."""
    passes: Mask
    """Mask (k, n), False for vignetted rays: see :meth:`clearances`."""
    chief: ReflectionPoints
    """Chief rays (k,)."""
    facing_points: Array
    """Points (k, n, 3) on the last mirror before the lens."""
    to_targets: Array
    """Unit vectors (k, n, 3) from the mirror points towards the objects."""

    def focused_at(self, focus_mm: float) -> Sensor:
        """Return the sensor with its lens at another focus."""
        return replace(self.sensor, lens=self.sensor.lens.focused_at(focus_mm))

    def clearances(self) -> dict[str, Array]:
        """Return the clearances (k, n), mm, of the rays at each edge, by edge name."""
        shape = self.path.shape
        flat = (
            a.reshape(-1, 3)
            for a in (self.facing_points, self.points, self.to_pupils, self.to_targets)
        )
        return {
            name: edge.reshape(shape)
            for name, edge in self.sensor.optical_train.clearances(*flat).items()
        }

    def image_mm(self, sensor: Sensor) -> Array:
        """Return ray positions (k, n, 2) on the imager, mm from the axis, for a focused sensor."""
        return sensor.lens.image_of(self.facing_points - sensor.lens_offset, self.to_pupils)

    def chief_mm(self, sensor: Sensor) -> Array:
        """Return the chief ray positions (k, 2) on the imager, mm from the optical axis."""
        return sensor.lens.image_of(
            self.chief.facing_points - sensor.lens_offset, self.chief.to_pupils
        )

    def chief_path(self) -> Array:
        """Return the optical path lengths (k,) of the chief rays, defined like :attr:`path`."""
        path: Array = self.chief.path.copy()  # the chief rays refer to a distant object
        is_finite = np.isfinite(self.object_distance_mm)
        if is_finite.any():
            distances = np.where(is_finite, self.object_distance_mm, NEARLY_INFINITE_MM)
            objects = self.sensor.optical_train.effective_mirror.objects_at(self.chief, distances)[
                is_finite
            ]
            path[is_finite] = self.sensor.optical_train.chief_rays_to(RayEndpoints(objects)).path
        return path

    def axes(self) -> Array:
        """Return tangential (outward) and sagittal unit vectors (k, 2, 2) in the image."""
        chief = self.chief_mm(self.sensor)
        away = np.hypot(*chief.T)
        azimuth = np.radians(self.azimuth_deg)
        on_axis = away < 1e-9 * self.sensor.imager.pitch_mm
        safe = np.where(on_axis, 1.0, away)
        t = np.where(
            on_axis[:, None],
            np.stack([np.cos(azimuth), np.sin(azimuth)], -1),
            chief / safe[:, None],
        )
        return np.stack([t, np.stack([-t[:, 1], t[:, 0]], axis=-1)], axis=1)

    def px_per_deg(self) -> tuple[Array, Array]:
        """Return the image size (k,), (k,) of one degree, px: Dh and Dw."""
        omega, azimuth = np.radians(self.omega_deg), np.radians(self.azimuth_deg)
        towards = camera_direction(omega, azimuth)
        outwards = camera_direction(omega + np.pi / 2, azimuth)
        steps = (outwards, np.cross(towards, outwards))
        scales = []
        for step in steps:
            neighbours = [
                self.sensor.optical_train.chief_rays_to(
                    RayEndpoints.of(towards + s * DIFFERENCE_STEP * step, True)
                )
                for s in (1, -1)
            ]
            lens, offset = self.sensor.lens, self.sensor.lens_offset
            a, b = (lens.image_of(e.facing_points - offset, e.to_pupils) for e in neighbours)
            angle = np.degrees(2 * np.arctan(DIFFERENCE_STEP))
            scales.append(np.hypot(*(a - b).T) / self.sensor.imager.pitch_mm / angle)
        return scales[0], scales[1]


def trace_bundles(
    sensor: Sensor,
    omega_deg: ArrayLike,
    pupil: Pupil,
    azimuth_deg: ArrayLike = 0.0,
    object_distance_mm: ArrayLike = np.inf,
) -> Bundles:
    """Trace bundles of objects at field angles (k,) and azimuths, through the points of a pupil.

    Raises
    ------
    OutsideField
        If an object is outside the field of view, or not visible through the whole aperture even
        without the rim.
    InvalidParameter
        If the distance is not positive, or the imager is tilted.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.analysis.ray_bundles import hexapolar
    >>> bundles = trace_bundles(om.load_sensor("paper-spherical"), [0.0, 90.0], hexapolar(3))
    >>> bundles.points.shape, bundles.passes.all()
    ((2, 37, 3), np.True_)
    """
    check_sensor(sensor)
    sensor.check("ray tracing through the whole aperture (spots, PSF, MTF)", "perpendicular imager")
    angles, azimuths = (
        finite("omega_deg", row("omega_deg", omega_deg)),
        finite("azimuth_deg", row("azimuth_deg", azimuth_deg)),
    )
    p = row("object_distance_mm", distances("object_distance_mm", object_distance_mm))
    if len({len(a) for a in (angles, azimuths, p)} - {1}) > 1:
        raise InvalidParameter(
            "omega_deg, azimuth_deg and object_distance_mm must have one value, or "
            f"equally many; got {len(angles)}, {len(azimuths)} and {len(p)}"
        )
    omega, azimuth, p = np.broadcast_arrays(angles, azimuths, p)
    towards = camera_direction(np.radians(omega), np.radians(azimuth))
    chief = sensor.optical_train.chief_rays_to(RayEndpoints(towards, True))
    if not chief.valid.all():
        raise OutsideField(
            f"{_named(omega, azimuth, chief.valid)} must be in the field of {sensor.name!r}"
        )
    k, n = len(omega), len(pupil.points)
    reflections, density = _aperture(sensor, pupil, chief, towards, p)
    is_complete: Mask = np.logical_and.reduce(reflections.reflects.reshape(k, n), axis=1)
    if not is_complete.all():
        raise OutsideField(
            f"{_named(omega, azimuth, is_complete)} must be visible through the whole "
            "aperture; the aperture is too wide for the mirror"
        )
    mean = density @ pupil.weights
    bundles = Bundles(
        sensor,
        omega,
        azimuth,
        p,
        pupil,
        reflections.points.reshape(k, n, 3),
        reflections.to_pupils.reshape(k, n, 3),
        reflections.path.reshape(k, n),
        density / mean[:, None],
        reflections.valid.reshape(k, n),
        chief,
        reflections.facing_points.reshape(k, n, 3),
        reflections.to_targets.reshape(k, n, 3),
    )
    clear = [edge >= 0 for edge in bundles.clearances().values()]
    return replace(bundles, passes=np.logical_and.reduce([bundles.passes, *clear]))


def _aperture(
    sensor: Sensor, pupil: Pupil, chief: ReflectionPoints, towards: Array, p: Array
) -> tuple[ReflectionPoints, Array]:
    """Return mirror points (k n,) and light (k, n) through the aperture."""
    k, n = len(p), len(pupil.points)
    train, mirror = sensor.optical_train, sensor.optical_train.effective_mirror
    parts: list[ReflectionPoints] = []
    density = np.empty((k, n))
    objects = mirror.objects_at(chief, np.where(np.isfinite(p), p, NEARLY_INFINITE_MM))
    for i in range(k):
        target = (
            RayEndpoints(towards[i : i + 1], True)
            if np.isinf(p[i])
            else RayEndpoints(objects[i : i + 1])
        )
        slopes = chief.chief_slopes[i : i + 1]
        ends = train.entrance_pupil_points(pupil.points, slopes)
        reflections = mirror.specular(ends, target, chief.points[i])
        motion = sensor.lens.entrance_pupil_motion(pupil.points, slopes)
        density[i] = mirror.beam(ends, target, reflections, motion)
        parts.append(reflections)
    return ReflectionPoints(
        *(np.concatenate(columns) for columns in zip(*parts, strict=True))
    ), density


def _named(omega: Array, azimuth: Array, fine: Mask) -> str:
    """Return a description of the first invalid field point."""
    i = int(np.argmin(fine))
    return f"omega = {omega[i]:.10g} deg at azimuth {azimuth[i]:.10g} deg"
