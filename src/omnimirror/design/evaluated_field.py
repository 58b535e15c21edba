"""Evaluated field of a sensor: field angles, object distances and truncation of the image circle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InvalidParameter
from ..optics.sensor import Sensor
from ..optics.tracing.meridian import ChiefRays
from .requirements import FieldRequirements, ends

# -- Evaluated field angles of a sensor, and the reasons for excluded ones -------------------------

POINTED_CENTRE = 0.1  # relative to the image radius; the azimuthal scale vanishes at the point
NO_PART = 1e-6  # deg; smaller exclusions are not reported


class EvaluatedRange(NamedTuple):
    """Evaluated field angles in degrees, and descriptions of the excluded ones."""

    low_deg: float
    high_deg: float
    left_out: tuple[str, ...]


@dataclass(frozen=True)
class EvaluableField:
    """Field of a sensor and its evaluable part.

    Attributes
    ----------
    low_deg, high_deg
        Field of view of the mirror.
    required_deg
        Required field.
    obscured_to_deg
        Upper end of the central obscuration by the housing; 0 without one.
    obscured_from_deg
        Lower end of the outer obscuration; the end of the field without one.
    point_deg
        Upper end of the excluded centre of a pointed mirror; 0 for a smooth mirror.
    obscuring_part
        Part that causes the central obscuration.
    """

    low_deg: float
    high_deg: float
    required_deg: tuple[float, float]
    obscured_to_deg: float
    obscured_from_deg: float
    point_deg: float
    obscuring_part: str

    def part(self, asked_deg: tuple[float, float] | None = None) -> EvaluatedRange:
        """Return the evaluated range of a part of the field, or of the whole required field.

        Raises
        ------
        InvalidParameter
            If the range is empty.
        """
        begins = [
            (self.low_deg, "outside the field of the mirror"),
            (self.obscured_to_deg, f"obscured by the {self.obscuring_part}"),
        ]
        begins += [(self.point_deg, "singular at the apex of a pointed mirror")]
        if asked_deg is None:
            begins += [(self.required_deg[0], "below omega_min_deg")]
        first, last = asked_deg or (0.0, self.required_deg[1])
        begin, reason = max(begins, key=lambda b: b[0])
        low, high = max(first, begin), min(last, self.obscured_from_deg)
        if high < low <= high + NO_PART:  # the end of the field, shifted by rounding
            low = high
        if asked_deg is None and begin > self.required_deg[0]:
            first = self.required_deg[0]  # angles below are not required
        left_out = (
            [f"{first:.4g} to {low:.4g} deg is not evaluated: {reason}"]
            if low > first + NO_PART
            else []
        )
        if high < last - NO_PART:
            left_out.append(f"{high:.4g} to {last:.4g} deg is not evaluated: {self._end}")
        if low > high or (low == high and first < last):
            part = f"from {first:g} to {last:g} deg" if asked_deg else "of the field"
            explanation = (
                f"{reason}, up to {begin:.4g} deg"
                if low > first
                else f"the field ends at {self.obscured_from_deg:.4g} deg"
            )
            raise InvalidParameter(f"no field angle {part} can be evaluated: {explanation}")
        return EvaluatedRange(low, high, tuple(left_out))

    @property
    def _end(self) -> str:
        """Reason for the upper end of the evaluated field."""
        hidden = self.obscured_from_deg < self.high_deg
        return "obscured by the housing" if hidden else "end of the field of the mirror"


def evaluable_field(field: FieldRequirements, sensor: Sensor) -> EvaluableField:
    """Return the evaluable field of a sensor, limited by the obscurations of its housing.

    Examples
    --------
    >>> from dataclasses import replace
    >>> from omnimirror.optics.housing import CameraBody, Housing
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> sensor = replace(load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
    >>> round(evaluable_field(FieldRequirements(omega_max_deg=135), sensor).obscured_to_deg, 2)
    8.43
    """
    low, high = sensor.field_deg
    clear, hidden_from = sensor.clear_field_deg
    point = 0.0
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(
            sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px])
        )
        point = float(np.degrees(edge.omega[0]))
    inner = [ring for ring in sensor.obscurations if ring.omega_deg[0] <= low]
    obscuring_part = max(inner, key=lambda ring: ring.omega_deg[1], default=None)
    return EvaluableField(
        low,
        high,
        (field.omega_min_deg, field.omega_max_deg),
        clear if obscuring_part else 0.0,
        hidden_from,
        point,
        obscuring_part.part if obscuring_part else "camera",
    )


# -- Object distances: fixed distances from the mirror, or intersections of rays with surfaces -----

Array = NDArray[Any]


def inverse_distances(field: FieldRequirements, x: Array, z: Array, omega: Array) -> Array:
    """Return inverse distances (1, k), 1/mm, to the first object surface.

    The rays start from points (k,) at field angles (k,) in radians. The distance of a ray without an
    intersection is infinite.

    >>> room = FieldRequirements(omega_max_deg=120, object_plane_distance_mm=700, object_cylinder_radius_mm=2000)
    >>> (1 / inverse_distances(room, np.zeros(3), np.zeros(3), np.radians([0.0, 60.0, 90.0]))).round(6)
    array([[ 700., 1400., 2000.]])
    """
    nearest = np.zeros_like(omega)
    for inverse in _surfaces(field, x, z, omega):
        nearest = np.where(inverse.real > nearest.real, inverse, nearest)
    return np.atleast_2d(nearest)


def distances_mm(field: FieldRequirements) -> tuple[float, ...]:
    """Return the distinct object distances."""
    return tuple(sorted(set(ends(field.object_distance_mm))))


def distances_of(field: FieldRequirements, rays: ChiefRays) -> list[Any]:
    """Return the distances from the mirror points of chief rays (k,) to the objects, mm: a number
    or an array (k,) for each object distance; with a cover, along the optical path.
    """
    if not field.has_surfaces:
        return list(distances_mm(field))
    x, z = rays.last
    with np.errstate(divide="ignore"):
        onward = 1 / inverse_distances(field, x, z, rays.omega)[0]
    return [onward + (0.0 if rays.outside is None else rays.outside.inside)]


def _surfaces(field: FieldRequirements, x: Array, z: Array, omega: Array) -> list[Array]:
    """Return 1/p for each surface; 0 or negative for a ray without an intersection."""
    surfaces = []
    if field.object_plane_distance_mm is not None:
        surfaces.append(np.cos(omega) / (field.object_plane_distance_mm + z))
    if field.object_cylinder_radius_mm is not None:
        surfaces.append(np.sin(omega) / (field.object_cylinder_radius_mm - x))
    return surfaces


# -- Truncation of the image circle by an imager smaller than the circle ---------------------------

AZIMUTHS = 7200
EDGE_PX = 0.02  # tolerance at the edge of the outermost pixel


def cut_off(sensor: Sensor) -> tuple[str, ...]:
    """Return a remark on the truncated part of the image circle; empty if the circle is complete.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.image_sensor import Imager
    >>> cut_off(replace(om.load_sensor("paper-spherical"), imager=Imager(1024, 576, 5.2)))[0]  # doctest: +ELLIPSIS
    'the rim is on the imager for 38.9% of the azimuths; ...'
    """
    rim, (u, v) = sensor.rim_radius_px, sensor.imager.centre
    width, height = sensor.imager.size
    edges = np.array([width - 1 - u, height - 1 - v, u, v]) + 0.5  # right, bottom, left, top
    if rim <= edges.min() + EDGE_PX:
        return ()
    azimuth = (np.arange(AZIMUTHS) + 0.5) * (2 * np.pi / AZIMUTHS)
    towards = np.stack([np.cos(azimuth), np.sin(azimuth), -np.cos(azimuth), -np.sin(azimuth)])
    with np.errstate(divide="ignore"):
        edge = np.where(towards > 0, edges[:, None] / towards, np.inf).min(axis=0)
    visible = np.minimum(edge, rim)
    mirror_x = sensor.x_from_height_px([max(float(visible.min()), _first_radius_px(sensor))])
    omega_deg = float(np.degrees(sensor.meridian.trace(mirror_x).omega[0]))
    whole = (edge >= rim - EDGE_PX).mean()
    return (
        f"the rim is on the imager for {whole:.1%} of the azimuths; at the nearest edge the field ends at "
        f"{omega_deg:.4g} deg; {1 - (visible**2).mean() / rim**2:.1%} of the circle is outside the imager",
    )


def _first_radius_px(sensor: Sensor) -> float:
    """Return the image radius of the inner end of the field."""
    return float(
        sensor.image_height_px(sensor.meridian.trace(np.array([sensor.meridian.x_min])))[0]
    )
