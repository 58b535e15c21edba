"""Heights of perturbed mirrors over (x, y), with first and second derivatives: conic, polynomial, table and form.

``z = conic + sum p_i (s/N^2)^i + table(r) + sum f_ij (x/N)^i (y/N)^j`` with ``s = r^2 = x^2 + y^2`` and N the rim
radius. Each trial has conic, polynomial and form of its own; the table, of mirrors without a formula, is one for all.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from ...lenses import Perspective
from ...mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...mirrors.conics import Conic
from ...mirrors.form import LARGEST_ORDER, MM_PER_UM, TERMS, SurfaceHeights
from ...numerics.zernike import noll, terms_of, zernike_powers
from ...sensor import Sensor
from ...thermal import Thermal

Array = NDArray[np.float64]

NODES = 1024  # of the table; quintic pieces of .001 of a rim radius are exact to 1e-12 of it
LEAST_RADIUS = 1e-9  # of the rim radius: on the axis, derivatives are taken so far beside it
ORDERS = {terms_of(order): order for order in range(LARGEST_ORDER + 1)}
"""Order of a form by how many powers it has."""


@dataclass(frozen=True)
class MeridianTable:
    """A meridian in quintic pieces, as smooth as the mirror: sag, slope and curvature are right at every node.

    Parameters
    ----------
    pieces : (n, 6)
        Coefficients of powers of the share t in [0, 1] of a piece; the last one goes on beyond the rim.
    step_mm
        Length of a piece.
    """

    pieces: Array
    step_mm: float

    @classmethod
    def of(cls, mirror: Mirror) -> MeridianTable:
        """Of any mirror.

        >>> from omnimirror.mirrors import Cone
        >>> table = MeridianTable.of(Cone(30.0, 20.0))
        >>> bool(np.allclose(table.profile(np.array([5.0]))[1], Cone(30.0, 20.0).slope([5.0])))
        True
        """
        nodes = np.linspace(0.0, mirror.rim_radius_mm, NODES)
        h = float(nodes[1])
        z, slope, bend = mirror.profile(nodes)
        slope, bend = slope * h, bend * h * h
        a0, a1, a2 = z[:-1], slope[:-1], bend[:-1] / 2
        rise, turn, curl = z[1:] - a0 - a1 - a2, slope[1:] - a1 - 2 * a2, bend[1:] - 2 * a2
        a3 = 10 * rise - 4 * turn + curl / 2
        a4 = -15 * rise + 7 * turn - curl
        a5 = 6 * rise - 3 * turn + curl / 2
        return cls(np.ascontiguousarray(np.stack([a0, a1, a2, a3, a4, a5], axis=-1)), h)

    def profile(self, r: Array) -> tuple[Array, Array, Array]:
        """Sag, slope and curvature at radii."""
        piece = np.minimum((r / self.step_mm).astype(np.intp), len(self.pieces) - 1)
        t, a = r / self.step_mm - piece, self.pieces[piece]
        z, slope, bend = a[..., 5], np.zeros_like(t), np.zeros_like(t)
        for power in range(4, -1, -1):
            bend = bend * t + slope
            slope = slope * t + z
            z = z * t + a[..., power]
        return z, slope / self.step_mm, 2 * bend / self.step_mm**2


@dataclass(frozen=True)
class MirrorSurfaces:
    """Mirrors of trials (t,), each with errors of its own.

    Parameters
    ----------
    rim_radius_mm
        N.
    curvature, conic : (t,)
        At the vertex, 1/mm, and k; 0 where a table says the shape.
    polynomial : (t, terms)
        p_i of (s/N^2)^i, i = 1, 2, .., mm.
    form : (t, powers)
        f_ij, mm, in the order of ``numerics.zernike.power_place``; as many as whole orders have.
    table : MeridianTable, optional
        What is one for all.
    """

    rim_radius_mm: float
    curvature: Array
    conic: Array
    polynomial: Array
    form: Array
    table: MeridianTable | None = None

    def heights(self, x: Array, y: Array) -> SurfaceHeights:
        """Over points (t, n) mm; NaN where a conic has ended."""
        value, first, second = self._meridian(x * x + y * y)
        formed = self._form(x, y)
        return SurfaceHeights(
            value + formed.z,
            2 * x * first + formed.gx,
            2 * y * first + formed.gy,
            2 * first + 4 * x * x * second + formed.hxx,
            4 * x * y * second + formed.hxy,
            2 * first + 4 * y * y * second + formed.hyy,
        )

    def meridian(self, r: Array) -> Array:
        """Heights (t, n) mm at distances (t, n) or (1, n) from the axis, without form errors."""
        return self._meridian(np.broadcast_to(r * r, (len(self.curvature), r.shape[1])))[0]

    def _meridian(self, s: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative by s = r^2."""
        c, k = self.curvature[:, None], self.conic[:, None]
        root = np.sqrt(1 - (1 + k) * c * c * s)
        value, first, second = c * s / (1 + root), c / (2 * root), (1 + k) * c**3 / (4 * root**3)
        for part in (self._polynomial(s), self._of_table(s)):
            value, first, second = value + part[0], first + part[1], second + part[2]
        return value, first, second

    def _polynomial(self, s: Array) -> tuple[Array, Array, Array]:
        """Value, first and second derivative by s."""
        unit = self.rim_radius_mm**2
        u = s / unit
        value, first, second = (np.zeros_like(u) for _ in range(3))
        for coefficient in (*self.polynomial.T[::-1], np.zeros(len(u))):
            second = second * u + first
            first = first * u + value
            value = value * u + coefficient[:, None]
        return value, first / unit, 2 * second / unit**2

    def _of_table(self, s: Array) -> tuple[Array, Array, Array] | tuple[float, float, float]:
        """The same of the table: f' = z'/2r, f'' = (z'' - z'/r)/4r^2."""
        if self.table is None:
            return 0.0, 0.0, 0.0
        r = np.maximum(np.sqrt(s), LEAST_RADIUS * self.rim_radius_mm)
        z, slope, bend = self.table.profile(r)
        return z, slope / (2 * r), (bend - slope / r) / (4 * r * r)

    def _form(self, x: Array, y: Array) -> SurfaceHeights:
        """By Horner's rule in y of polynomials in x."""
        order, unit = ORDERS[self.form.shape[1]], self.rim_radius_mm
        u, v = x / unit, y / unit
        zero = np.zeros_like(u)
        z, by_y, by_yy, by_x, by_xy, by_xx = (zero for _ in range(6))
        for j in range(order, -1, -1):
            q, dq, ddq = zero, zero, zero
            for i in range(order - j, -1, -1):
                coefficient = self.form[:, (i + j) * (i + j + 1) // 2 + j]
                ddq = ddq * u + dq
                dq = dq * u + q
                q = q * u + coefficient[:, None]
            by_yy = by_yy * v + by_y
            by_y = by_y * v + z
            z = z * v + q
            by_xy = by_xy * v + by_x
            by_x = by_x * v + dq
            by_xx = by_xx * v + 2 * ddq
        return SurfaceHeights(z, by_x / unit, by_y / unit, by_xx / unit**2, by_xy / unit**2, 2 * by_yy / unit**2)


Values = Mapping[str, Array]
"""Values (t,) of errors by their names, all of one length."""

WARMER = "temperature.warmer_k"


@dataclass(frozen=True)
class States:
    """Sensors of trials (t,), each with errors of its own, in numbers that rays are traced with.

    Attributes
    ----------
    surfaces
        Their mirrors.
    rotation : (t, 3, 3)
        From the mirror's frame to the camera's.
    shift : (t, 3)
        Vertex in the camera frame, mm.
    pupil : (t, 3)
        Centre of the entrance pupil in the camera frame, mm.
    aperture_mm : (t,)
        Its diameter.
    vergence : (t,)
        In focus, at the entrance pupil, 1/mm.
    brown : (t, 5)
        Distortion k1, k2, k3, p1, p2 of the lens.
    imager : (t, 3, 3)
        From tangents of the viewing angle (x, y, 1) to offsets in px, of a plane that may be shifted, turned and
        tilted; the principal distance is in it.
    breathing_mm : (t,)
        f - e, of focal length and entrance pupil: the principal distance is ``f / (1 - (f - e) v)``.
    focal_mm : (t,)
        f.
    pitch_mm : (t,)
        Of the pixels.
    """

    surfaces: MirrorSurfaces
    rotation: Array
    shift: Array
    pupil: Array
    aperture_mm: Array
    vergence: Array
    brown: Array
    imager: Array
    breathing_mm: Array
    focal_mm: Array
    pitch_mm: Array

    def __len__(self) -> int:
        return len(self.shift)


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
