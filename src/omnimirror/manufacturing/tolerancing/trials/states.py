"""What errors do to a sensor: values of errors in, the numbers that trials are traced with out."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ....errors import InvalidParameter
from ....lenses import Perspective
from ....mirrors import ConicAsphere, EvenPolynomial
from ....mirrors.conics import Conic
from ....mirrors.form import LARGEST_ORDER, MM_PER_UM, TERMS
from ....numerics.zernike import noll, zernike_powers
from ....sensor import Sensor
from ....thermal import Thermal
from .surface import ORDERS, MeridianTable, MirrorSurfaces
from .tracing import States

Array = NDArray[np.float64]
Values = Mapping[str, Array]
"""Values (t,) of errors by their names, all of one length."""

WARMER = "temperature.warmer_k"


def states_of(sensor: Sensor, values: Values, count: int | None = None) -> States:
    """Sensors with errors.

    Parameters
    ----------
    sensor
        Without errors; its lens a perspective one, before one mirror.
    values
        Errors (t,) in their units, added to nominal values, by error name.
    count
        How many trials, if no error says so.

    Returns
    -------
    States
        (t,); with numbers that no sensor has, a focal length below 0 or a mirror that is hollow, it sees nothing.

    Raises
    ------
    InvalidParameter
        A sensor that is traced by itself: :func:`are_traced_together` says which.
    """
    if not are_traced_together(sensor, values):
        raise InvalidParameter(f"sensors like {sensor.name!r} are traced one by one, with these errors")
    trials = next((len(v) for v in values.values()), 1) if count is None else count
    error = _Errors(values, trials)
    lens, pose = cast(Perspective, sensor.lens), sensor.mirror_pose
    shift = error.columns("mirror.decentre_x_mm", "mirror.decentre_y_mm", "mirror.displacement_mm") + pose.shift
    tilts = error.columns("mirror.tilt_x_deg", "mirror.tilt_y_deg") + np.array([pose.tilt_x_deg, pose.tilt_y_deg])
    focal = lens.focal_length_mm + error("lens.focal_length_mm")
    focus = lens.focus_distance_mm + error("lens.focus_distance_mm")
    f_number = lens.f_number + error("lens.f_number")
    at = lens.entrance_pupil_mm + error("lens.entrance_pupil_mm")
    growth = _Growth.of(sensor, error)
    focal, focus = growth.lens(focal, focus)
    possible = (focal > 0) & (f_number > 0) & (focus > np.maximum(focal, at))
    brown = np.array(lens.brown) + error.columns(*(f"lens.{k}" for k in ("k1", "k2", "k3", "p1", "p2")))
    pupil = np.zeros((trials, 3))
    surfaces = _surfaces(sensor, error)
    distance = growth.distance(sensor, surfaces)
    pupil[:, 2] = np.where(possible, at - distance, np.nan)  # what is no lens loses all rays
    vergence = 1 / (focus - at)
    principal_distance = focal / (1 - (focal - at) * vergence)
    pitch_mm = sensor.imager.pitch_mm * growth.imager * (1 + 1e-6 * error("imager.pitch_ppm"))
    return States(
        growth.grown(surfaces),
        _rotations(tilts),
        shift * growth.spacer[:, None],
        pupil,
        focal / f_number,
        vergence,
        brown,
        _imagers(principal_distance, pitch_mm, error),
        focal - at,
        focal,
        pitch_mm,
    )


class _Errors:
    """Values by name; 0 of what has no error."""

    def __init__(self, values: Values, count: int) -> None:
        self.values, self.count = values, count

    def __call__(self, name: str) -> Array:
        return np.asarray(self.values.get(name, np.zeros(self.count)), dtype=float)

    def columns(self, *names: str) -> Array:
        """(t, n)"""
        return np.stack([self(name) for name in names], axis=-1)


def are_traced_together(sensor: Sensor, values: Collection[str] = ()) -> bool:
    """Whether trials of a sensor with these errors are traced by the thousand: a perspective lens, one bare mirror.

    A mirror known by a table grows with temperature as ordinary sensors do.

    >>> import omnimirror as om
    >>> are_traced_together(om.load_sensor("paper-spherical"))
    True
    """
    is_plain = sensor.secondary is None and sensor.housing.shell is None and isinstance(sensor.lens, Perspective)
    if WARMER not in values or not is_plain:
        return is_plain and sensor.is_ideal_but_for_pose
    assert sensor.thermal is not None, "no other has this error"
    has_formula = isinstance(sensor.mirror, Conic | ConicAsphere | EvenPolynomial)
    return sensor.is_ideal_but_for_pose and (has_formula or not sensor.thermal.expansion_ppm("mirror"))


@dataclass(frozen=True)
class _Growth:
    """By how much trials (t,) are warmer and their parts larger; formulas of :mod:`omnimirror.analysis.temperature`."""

    thermal: Thermal
    warmer: Array

    @classmethod
    def of(cls, sensor: Sensor, error: _Errors) -> _Growth:
        return cls(sensor.thermal or Thermal(), error(WARMER))

    def _factor(self, ppm_per_k: float) -> Array:
        return 1 + 1e-6 * ppm_per_k * self.warmer

    @property
    def spacer(self) -> Array:
        return self._factor(self.thermal.expansion_ppm("spacer"))

    @property
    def mirror(self) -> Array:
        return self._factor(self.thermal.expansion_ppm("mirror"))

    @property
    def imager(self) -> Array:
        return self._factor(self.thermal.imager_ppm_per_k)

    def lens(self, focal: Array, focus: Array) -> tuple[Array, Array]:
        """Focal lengths, and distances that are in focus on imagers that their mounts have moved."""
        by_focal, by_mount = self.thermal.focal_ppm_per_k, self.thermal.expansion_ppm("mount")
        if not (by_focal or by_mount) or not self.warmer.any():
            return focal, focus
        behind = self._factor(by_mount) / (1 / focal - 1 / focus)
        focal = focal * self._factor(by_focal)
        return focal, 1 / (1 / focal - 1 / behind)

    def distance(self, sensor: Sensor, surfaces: MirrorSurfaces) -> Array:
        """From the lens to the vertex, mm; of a mirror held at its rim, to where its vertex then is."""
        held = np.zeros(len(self.warmer))
        if self.thermal.held_at == "rim" and self.warmer.any():
            rim = np.full((1, 1), surfaces.rim_radius_mm)
            held = surfaces.meridian(rim)[:, 0]
        return (sensor.mirror_distance_mm + held) * self.spacer - held * self.mirror

    def grown(self, surfaces: MirrorSurfaces) -> MirrorSurfaces:
        """Shapes that have grown evenly, ``g z(x / g)``; form errors keep their heights, and the rim its number."""
        g = self.mirror
        if (g == 1).all():
            return surfaces
        powers = 1 - 2.0 * np.arange(1, surfaces.polynomial.shape[1] + 1)
        orders = np.concatenate([np.full(k + 1, -k) for k in range(ORDERS[surfaces.form.shape[1]] + 1)])
        return replace(
            surfaces,
            curvature=surfaces.curvature / g,
            polynomial=surfaces.polynomial * g[:, None] ** powers,
            form=surfaces.form * g[:, None] ** orders,
        )


def _surfaces(sensor: Sensor, error: _Errors) -> MirrorSurfaces:
    mirror: Any = sensor.mirror
    rim, zero = mirror.rim_radius_mm, np.zeros(error.count)
    conic, radius = zero, None
    polynomial, table = np.zeros((error.count, 0)), None
    if isinstance(mirror, Conic):
        radius, conic = mirror.vertex_radius + error("mirror.vertex_radius_mm"), mirror.conic + error("mirror.conic")
    elif isinstance(mirror, ConicAsphere):
        radius, conic = mirror.vertex_radius_mm + error("mirror.vertex_radius_mm"), mirror.conic + error("mirror.conic")
        polynomial = _coefficients(mirror, error, first=2)
    elif isinstance(mirror, EvenPolynomial):
        polynomial = _coefficients(mirror, error, first=1)
    else:
        table = MeridianTable.of(mirror)
    curvature = zero if radius is None else 1 / np.where(radius > 0, radius, np.nan)  # what is no mirror, too
    return MirrorSurfaces(rim, curvature, conic, polynomial, _form(error), table)


def _coefficients(mirror: EvenPolynomial | ConicAsphere, error: _Errors, first: int) -> Array:
    """Coefficients (t, terms) of powers 1, 2, .. of (r/rim)^2, mm."""
    N, rim = mirror.normalization_radius_mm, mirror.rim_radius_mm
    table = np.zeros((error.count, first - 1 + len(mirror.coefficients)))
    for i, coefficient in enumerate(mirror.coefficients):
        power = 2 * (first + i)
        table[:, first - 1 + i] = (coefficient + error(f"mirror.coefficients[{i}]")) * N * (rim / N) ** power
    return table


def _form(error: _Errors) -> Array:
    """Powers (t, n) mm of all Zernike terms that err; as many as whole orders need."""
    terms = [j for j in range(1, TERMS + 1) if f"mirror.zernike_{j}_um" in error.values]
    order = max((noll(j)[0] for j in terms), default=0)
    powers = np.zeros((error.count, (order + 1) * (order + 2) // 2))
    for j in terms:
        amplitude = MM_PER_UM * error(f"mirror.zernike_{j}_um")
        powers += amplitude[:, None] * zernike_powers(LARGEST_ORDER)[j - 1, : powers.shape[1]]
    return powers


def _rotations(tilts_deg: Array) -> Array:
    """(t, 3, 3) about X, then about Y, as :class:`omnimirror.mirrors.pose.MirrorPose` turns."""
    (cx, cy), (sx, sy) = np.cos(np.radians(tilts_deg)).T, np.sin(np.radians(tilts_deg)).T
    zero = np.zeros_like(cx)
    rows = [[cy, sx * sy, cx * sy], [zero, cx, -sx], [-sy, sx * cy, cx * cy]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def _imagers(principal_distance: Array, pitch_mm: Array, error: _Errors) -> Array:
    """Homographies (t, 3, 3) from tangents to offsets in px.

    The imager's plane is turned about its centre by ``imager.tilt_x_deg``, ``imager.tilt_y_deg`` and
    ``imager.rotation_deg`` and then shifted: what is at offset e lies at ``shift + c z + R e``, on the ray of the
    tangents (x, y, 1) times any length, so that ``(x, y, 1)`` is the first two columns of R and ``c z``, times
    (e, 1).
    """
    tilt = _rotations(error.columns("imager.tilt_x_deg", "imager.tilt_y_deg"))
    turn = np.radians(error("imager.rotation_deg"))
    plane = np.zeros((error.count, 3, 3))
    cos, sin = np.cos(turn), np.sin(turn)
    plane[:, :, 0] = tilt[:, :, 0] * cos[:, None] + tilt[:, :, 1] * sin[:, None]
    plane[:, :, 1] = tilt[:, :, 1] * cos[:, None] - tilt[:, :, 0] * sin[:, None]
    plane[:, 2, 2] = principal_distance
    offsets = np.asarray(np.linalg.inv(plane), dtype=float)
    offsets[:, :2] /= pitch_mm[:, None, None]
    shift = error.columns("imager.shift_x_px", "imager.shift_y_px")
    offsets[:, :2] += shift[:, :, None] * offsets[:, 2:]
    return offsets
