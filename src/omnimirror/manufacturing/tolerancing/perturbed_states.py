"""Vectorised sensors with errors: perturbed mirror surfaces and ray-tracing parameters of all trials.

``z = conic + sum p_i (s/N^2)^i + table(r) + sum f_ij (x/N)^i (y/N)^j`` with ``s = r^2 = x^2 + y^2``
and the rim radius N. Conic, polynomial and form differ between trials; the table, of mirrors
without a formula, is common to all.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ...base.errors import InvalidParameter
from ...base.numerics import noll, zernike_powers, zernike_terms
from ...base.typing import Array
from ...optics.lenses import Perspective
from ...optics.mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...optics.mirrors.mirror import MAX_ORDER, MM_PER_UM, TERMS, Conic, SurfaceHeights
from ...optics.sensor import Sensor
from ...optics.thermal import Thermal

NODES = 1024  # nodes of the table; quintic pieces of 0.001 rim radii are accurate to 1e-12
MIN_RADIUS = 1e-9  # minimum radius for derivatives, in rim radii
ORDERS = {zernike_terms(order): order for order in range(MAX_ORDER + 1)}
"""Order of a form by its number of coefficients."""


@dataclass(frozen=True)
class MeridianTable:
    """Meridian in quintic pieces with exact sag, slope and curvature at every node.

    Parameters
    ----------
    pieces : (n, 6)
        Coefficients of powers of the local coordinate t in [0, 1]; the last piece extends beyond the
        rim.
    step_mm
        Length of a piece.
    """

    pieces: Array
    step_mm: float

    @classmethod
    def of(cls, mirror: Mirror) -> MeridianTable:
        """Tabulate the meridian of a mirror.

        >>> from omnimirror.optics.mirrors import Cone
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
        """Compute sag, slope and curvature at radii."""
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
    """Perturbed mirrors of trials (t,).

    Parameters
    ----------
    rim_radius_mm
        Rim radius N.
    curvature, conic : (t,)
        Vertex curvature in 1/mm and conic constant; 0 for tabulated mirrors.
    polynomial : (t, terms)
        Coefficients p_i of (s/N^2)^i, i = 1, 2, ..., mm.
    form : (t, powers)
        Coefficients f_ij in mm, in the order of ``numerics.zernike.power_place``, for complete orders.
    table : MeridianTable, optional
        Common meridian.
    """

    rim_radius_mm: float
    curvature: Array
    conic: Array
    polynomial: Array
    form: Array
    table: MeridianTable | None = None

    def heights(self, x: Array, y: Array) -> SurfaceHeights:
        """Compute heights and derivatives at points (t, n) in mm; NaN beyond the end of a conic."""
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
        """Compute heights (t, n) in mm at radii (t, n) or (1, n), without form errors."""
        return self._meridian(np.broadcast_to(r * r, (len(self.curvature), r.shape[1])))[0]

    def _meridian(self, s: Array) -> tuple[Array, Array, Array]:
        """Compute value, first and second derivative with respect to s = r^2."""
        c, k = self.curvature[:, None], self.conic[:, None]
        root = np.sqrt(1 - (1 + k) * c * c * s)
        value, first, second = c * s / (1 + root), c / (2 * root), (1 + k) * c**3 / (4 * root**3)
        for part in (self._polynomial(s), self._of_table(s)):
            value, first, second = value + part[0], first + part[1], second + part[2]
        return value, first, second

    def _polynomial(self, s: Array) -> tuple[Array, Array, Array]:
        """Evaluate the polynomial and its derivatives with respect to s by Horner's method."""
        unit = self.rim_radius_mm**2
        u = s / unit
        value, first, second = (np.zeros_like(u) for _ in range(3))
        for coefficient in (*self.polynomial.T[::-1], np.zeros(len(u))):
            second = second * u + first
            first = first * u + value
            value = value * u + coefficient[:, None]
        return value, first / unit, 2 * second / unit**2

    def _of_table(self, s: Array) -> tuple[Array, Array, Array] | tuple[float, float, float]:
        """Evaluate the table and its derivatives: f' = z'/2r, f'' = (z'' - z'/r)/4r^2."""
        if self.table is None:
            return 0.0, 0.0, 0.0
        r = np.maximum(np.sqrt(s), MIN_RADIUS * self.rim_radius_mm)
        z, slope, bend = self.table.profile(r)
        return z, slope / (2 * r), (bend - slope / r) / (4 * r * r)

    def _form(self, x: Array, y: Array) -> SurfaceHeights:
        """Evaluate the form by Horner's method in y, with polynomials in x as coefficients."""
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
        return SurfaceHeights(
            z, by_x / unit, by_y / unit, by_xx / unit**2, by_xy / unit**2, 2 * by_yy / unit**2
        )


Values = Mapping[str, Array]
"""Errors (t,) by name, all of equal length."""

WARMER = "temperature.warmer_k"


@dataclass(frozen=True)
class States:
    """Ray-tracing parameters of perturbed sensors (t,).

    Attributes
    ----------
    surfaces
        Mirror surfaces.
    rotation : (t, 3, 3)
        Rotation from the mirror frame to the camera frame.
    shift : (t, 3)
        Vertex in the camera frame, mm.
    pupil : (t, 3)
        Centre of the entrance pupil in the camera frame, mm.
    aperture_mm : (t,)
        Diameter of the entrance pupil.
    vergence : (t,)
        Vergence in focus at the entrance pupil, 1/mm.
    brown : (t, 5)
        Distortion coefficients k1, k2, k3, p1, p2.
    imager : (t, 3, 3)
        Homography from viewing tangents (x, y, 1) to offsets in px, including principal distance,
        shift, rotation and tilt of the imager.
    breathing_mm : (t,)
        f - e for focal length f and entrance pupil e: the principal distance is
        ``f / (1 - (f - e) v)``.
    focal_mm : (t,)
        Focal length f.
    pitch_mm : (t,)
        Pixel pitch.
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
    """Compute the ray-tracing parameters of sensors with errors.

    Parameters
    ----------
    sensor
        Nominal sensor with a perspective lens and one mirror.
    values
        Errors (t,) by name, in their units.
    count
        Number of trials if there are no errors.

    Returns
    -------
    States
        Parameters (t,); a physically impossible trial, such as one with a negative focal length, loses
        all rays.

    Raises
    ------
    InvalidParameter
        If the vectorised solver does not support the sensor; see :func:`is_vectorised`.
    """
    if not is_vectorised(sensor, values):
        raise InvalidParameter(
            f"{sensor.name!r} with these errors cannot be traced vectorised; use sequential_images"
        )
    trials = next((len(v) for v in values.values()), 1) if count is None else count
    error = _Errors(values, trials)
    lens, pose = cast(Perspective, sensor.lens), sensor.mirror_pose
    shift = (
        error.columns("mirror.decentre_x_mm", "mirror.decentre_y_mm", "mirror.displacement_mm")
        + pose.shift
    )
    tilts = error.columns("mirror.tilt_x_deg", "mirror.tilt_y_deg") + np.array(
        [pose.tilt_x_deg, pose.tilt_y_deg]
    )
    focal = lens.focal_length_mm + error("lens.focal_length_mm")
    focus = lens.focus_distance_mm + error("lens.focus_distance_mm")
    f_number = lens.f_number + error("lens.f_number")
    at = lens.entrance_pupil_mm + error("lens.entrance_pupil_mm")
    growth = _Growth.of(sensor, error)
    focal, focus = growth.lens(focal, focus)
    possible = (focal > 0) & (f_number > 0) & (focus > np.maximum(focal, at))
    brown = np.array(lens.brown) + error.columns(
        *(f"lens.{k}" for k in ("k1", "k2", "k3", "p1", "p2"))
    )
    pupil = np.zeros((trials, 3))
    surfaces = _surfaces(sensor, error)
    distance = growth.distance(sensor, surfaces)
    pupil[:, 2] = np.where(
        possible, at - distance, np.nan
    )  # physically impossible lenses lose all rays
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
    """Errors by name; 0 without an error."""

    def __init__(self, values: Values, count: int) -> None:
        self.values, self.count = values, count

    def __call__(self, name: str) -> Array:
        return np.asarray(self.values.get(name, np.zeros(self.count)), dtype=float)

    def columns(self, *names: str) -> Array:
        """Return errors as columns (t, n)."""
        return np.stack([self(name) for name in names], axis=-1)


def is_vectorised(sensor: Sensor, values: Collection[str] = ()) -> bool:
    """Return whether the vectorised solver supports a sensor: perspective lens, one mirror, no
    cover.

    The thermal expansion of tabulated mirrors requires sequential trials.

    >>> import omnimirror as om
    >>> is_vectorised(om.load_sensor("paper-spherical"))
    True
    """
    is_plain = (
        sensor.secondary is None
        and sensor.housing.shell is None
        and isinstance(sensor.lens, Perspective)
    )
    if WARMER not in values or not is_plain:
        return is_plain and sensor.is_ideal_except_pose
    assert sensor.thermal is not None, "temperature errors require a thermal model"
    has_formula = isinstance(sensor.mirror, Conic | ConicAsphere | EvenPolynomial)
    return sensor.is_ideal_except_pose and (
        has_formula or not sensor.thermal.expansion_ppm("mirror")
    )


@dataclass(frozen=True)
class _Growth:
    """Thermal expansion of trials (t,); formulas of :mod:`omnimirror.analysis.operating_conditions`."""

    thermal: Thermal | None
    warmer: Array

    @classmethod
    def of(cls, sensor: Sensor, error: _Errors) -> _Growth:
        return cls(sensor.thermal, error(WARMER))

    def _factor(self, ppm_per_k: float) -> Array:
        return 1 + 1e-6 * ppm_per_k * self.warmer

    def _part_factor(self, part: str) -> Array:
        return self._factor(0.0 if self.thermal is None else self.thermal.expansion_ppm(part))

    @property
    def spacer(self) -> Array:
        return self._part_factor("spacer")

    @property
    def mirror(self) -> Array:
        return self._part_factor("mirror")

    @property
    def imager(self) -> Array:
        return self._factor(0.0 if self.thermal is None else self.thermal.imager_ppm_per_k)

    def lens(self, focal: Array, focus: Array) -> tuple[Array, Array]:
        """Return focal lengths and focus distances with thermally displaced imagers."""
        if self.thermal is None:
            return focal, focus
        by_focal, by_mount = self.thermal.focal_ppm_per_k, self.thermal.expansion_ppm("mount")
        if not (by_focal or by_mount) or not self.warmer.any():
            return focal, focus
        behind = self._factor(by_mount) / (1 / focal - 1 / focus)
        focal = focal * self._factor(by_focal)
        return focal, 1 / (1 / focal - 1 / behind)

    def distance(self, sensor: Sensor, surfaces: MirrorSurfaces) -> Array:
        """Return the distance from lens to vertex, mm, including the mirror expansion if held at
        the rim.
        """
        held = np.zeros(len(self.warmer))
        if self.thermal is not None and self.thermal.held_at == "rim" and self.warmer.any():
            rim = np.full((1, 1), surfaces.rim_radius_mm)
            held = surfaces.meridian(rim)[:, 0]
        return (sensor.mirror_distance_mm + held) * self.spacer - held * self.mirror

    def grown(self, surfaces: MirrorSurfaces) -> MirrorSurfaces:
        """Scale the shapes by ``g z(x / g)``; form errors keep their heights, and the rim its
        nominal radius.
        """
        g = self.mirror
        if (g == 1).all():
            return surfaces
        powers = 1 - 2.0 * np.arange(1, surfaces.polynomial.shape[1] + 1)
        orders = np.concatenate(
            [np.full(k + 1, -k) for k in range(ORDERS[surfaces.form.shape[1]] + 1)]
        )
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
        radius, conic = (
            mirror.vertex_radius + error("mirror.vertex_radius_mm"),
            mirror.conic + error("mirror.conic"),
        )
    elif isinstance(mirror, ConicAsphere):
        radius, conic = (
            mirror.vertex_radius_mm + error("mirror.vertex_radius_mm"),
            mirror.conic + error("mirror.conic"),
        )
        polynomial = _coefficients(mirror, error, first=2)
    elif isinstance(mirror, EvenPolynomial):
        polynomial = _coefficients(mirror, error, first=1)
    else:
        table = MeridianTable.of(mirror)
    curvature = (
        zero if radius is None else 1 / np.where(radius > 0, radius, np.nan)
    )  # like impossible mirrors
    return MirrorSurfaces(rim, curvature, conic, polynomial, _form(error), table)


def _coefficients(mirror: EvenPolynomial | ConicAsphere, error: _Errors, first: int) -> Array:
    """Return polynomial coefficients (t, terms) of (r/rim)^2, (r/rim)^4, ..., mm."""
    N, rim = mirror.normalization_radius_mm, mirror.rim_radius_mm
    table = np.zeros((error.count, first - 1 + len(mirror.coefficients)))
    for i, coefficient in enumerate(mirror.coefficients):
        power = 2 * (first + i)
        table[:, first - 1 + i] = (
            (coefficient + error(f"mirror.coefficients[{i}]")) * N * (rim / N) ** power
        )
    return table


def _form(error: _Errors) -> Array:
    """Return form coefficients (t, n) in mm of all perturbed Zernike terms, for complete orders."""
    terms = [j for j in range(1, TERMS + 1) if f"mirror.zernike_{j}_um" in error.values]
    order = max((noll(j)[0] for j in terms), default=0)
    powers = np.zeros((error.count, (order + 1) * (order + 2) // 2))
    for j in terms:
        amplitude = MM_PER_UM * error(f"mirror.zernike_{j}_um")
        powers += amplitude[:, None] * zernike_powers(MAX_ORDER)[j - 1, : powers.shape[1]]
    return powers


def _rotations(tilts_deg: Array) -> Array:
    """Return rotations (t, 3, 3) about X, then Y, as in
    :class:`omnimirror.optics.mirrors.mirror.MirrorPose`.
    """
    (cx, cy), (sx, sy) = np.cos(np.radians(tilts_deg)).T, np.sin(np.radians(tilts_deg)).T
    zero = np.zeros_like(cx)
    rows = [[cy, sx * sy, cx * sy], [zero, cx, -sx], [-sy, sx * cy, cx * cy]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=1)


def _imagers(principal_distance: Array, pitch_mm: Array, error: _Errors) -> Array:
    """Return homographies (t, 3, 3) from viewing tangents to offsets in px.

    The imager plane is rotated about its centre by ``imager.tilt_x_deg``, ``imager.tilt_y_deg`` and
    ``imager.rotation_deg`` and then shifted. A pixel offset e is at ``shift + c z + R e``, on the ray
    of tangents (x, y, 1) times any length, so that ``(x, y, 1)`` is the matrix with the first two
    columns of R and ``c z``, times (e, 1).
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
