"""Lower bound of the blur: smallest worst single blur of any mirror for a field, rim and lens.

In terms of the mapping instead of the surface, both blurs have a simple form. With ``v = 1/rho``
the inverse distance from the lens to the mirror point, ``D = 1/L0``, ``e = rho/p`` and ``k = f/F``,
Eqs. 14-21, 28, 36 and 37 become, in degrees of the objects as seen from the mirror point,

    T = k cos^2(theta) (D W' - v/cos(theta) (W' - 1)),     W' = dOmega/dtheta + e
    S = k cos(theta) (D W' - v/cos(theta) (W' - 1)),     W' = sin(Omega)/sin(theta) + e

and the surface satisfies ``d ln v/d theta = -tan((Omega + theta)/2)``. At the rim Omega and v are
given; therefore S at the rim bounds the nearest focus, and ``T >= -t`` bounds the slope of the
mapping from the rim to the axis. If the steepest mapping does not reach the inner end of the field,
no mirror attains the blur t. The proof is in ``docs/blur-bound.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from ..base.arguments import choice, distances, image_radius, validate_arguments
from ..base.errors import InvalidParameter
from ..base.numerics import sign_change
from ..base.results import FieldResult, Fields, column_fields
from ..base.typing import Array
from ..optics.batch.closed_forms import PerspectiveCamera, TelecentricCamera
from ..optics.lenses import BLUR_MODES, BlurMode, Orthographic, Perspective
from ..optics.sensor import Sensor

MIN_BLUR_RAD, MAX_BLUR_RAD = 1e-6, 3.0  # radians; search interval of the bound
POINTS = 401
TOLERANCE = 1e-11  # relative, of the integration


@dataclass(frozen=True)
class BlurBound(FieldResult):
    """Lower bound of the blur for a field, rim and lens, with the extremal mirror.

    Attributes
    ----------
    blur_deg : deg
        Lower bound of the worst single blur, tangential or sagittal.
    focus_mm : mm
        Focus distance L0 of the bound; for a telecentric lens from the first point of the surface.
    x_mm, z_mm, slope : (n,) mm, mm and dimensionless
        Steepest permitted surface, from the inner end of the field to the rim; z is relative to the
        first point.
    omega_deg, t_deg, s_deg : (n,) deg
        Field angles and signed blurs of the surface.
    """

    blur_deg: float
    focus_mm: float
    x_mm: Array = field(repr=False)
    z_mm: Array = field(repr=False)
    slope: Array = field(repr=False)
    omega_deg: Array = field(repr=False)
    t_deg: Array = field(repr=False)
    s_deg: Array = field(repr=False)

    def _fields(self) -> Fields:
        columns = {name: getattr(self, name) for name in ("omega_deg", *self._table())}
        return column_fields(columns, {"blur_deg": self.blur_deg, "focus_mm": self.focus_mm})

    @property
    def is_reached(self) -> bool:
        """True if the extremal mirror also satisfies the bound sagittally."""
        return bool(np.abs(self.s_deg).max() <= self.blur_deg * (1 + 1e-6))


@validate_arguments
def blur_bound(
    sensor: Sensor,
    object_distance_mm: float = np.inf,
    *,
    omega_min_deg: float | None = None,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
) -> BlurBound:
    """Compute the minimum of the worst single blur of any mirror for the rim and lens of a sensor.

    The bound applies to all mirrors with the rim radius of the sensor, its field angle and viewing
    angle at the rim, for any focus. All objects have the same distance from the mirror, for which
    the blur is evaluated.

    Parameters
    ----------
    sensor
        Aligned sensor with one mirror and a distortion-free lens.
    object_distance_mm : mm
        Object distance p from the mirror.
    omega_min_deg : deg
        Inner end of the evaluated field; None for the whole field of the sensor.
    mode, image_radius_px
        As in :func:`omnimirror.evaluate`.

    Returns
    -------
    BlurBound

    Raises
    ------
    InvalidParameter
        If the sensor has two mirrors, the lens has distortion, the object distance is not positive,
        or the field is outside that of the sensor.

    Notes
    -----
    The proof in ``docs/blur-bound.md`` is based on Eqs. 2-5, 14-21, 28, 36 and 37.

    Examples
    --------
    Sphere of the paper, and the bound for any mirror with its field, rim and lens:

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> round(om.best_focus(sensor, "worst_blur_deg").value, 3)
    0.629
    >>> bound = blur_bound(sensor)
    >>> round(bound.blur_deg, 3), round(bound.focus_mm, 1), bound.is_reached
    (0.608, 221.3, True)
    """
    choice("mode", mode, BLUR_MODES)
    if image_radius_px is not None:
        image_radius(image_radius_px)
    sensor.check("the bound of blur", "single mirror", "thin lens")
    distances("object_distance_mm", object_distance_mm)
    low, high = sensor.field_deg
    if omega_min_deg is not None and not low <= omega_min_deg < high:
        raise InvalidParameter(
            f"omega_min_deg must be in the field, {low:.4g} to {high:.4g} deg; got {omega_min_deg:g}"
        )
    begin = low if omega_min_deg is None else omega_min_deg
    steepest = _steepest(
        sensor, np.radians((begin, high)), 1 / object_distance_mm, mode, image_radius_px
    )
    return steepest.bound()


def _steepest(
    sensor: Sensor, field: Array, near: float, mode: BlurMode, image_radius_px: float | None
) -> _Steepest:
    lens, M, pitch = sensor.lens, sensor.mirror.rim_radius_mm, sensor.imager.pitch_mm
    ends = float(field[0]), float(field[1]), M
    if isinstance(lens, Perspective):
        if any(lens.brown):
            raise InvalidParameter(
                f"the lens of {sensor.name!r} must be free of distortion for the bound of blur"
            )
        theta = float(sensor.meridian.theta_max)
        camera = PerspectiveCamera(
            lens.focal_length_mm, lens.f_number, np.tan(theta), pitch, mode, image_radius_px
        )
        return _UnderPerspective(
            *ends, theta, near, lambda D: camera.px_per_vergence(D) / camera.px_per_ray(D)
        )
    assert isinstance(lens, Orthographic)
    flat = TelecentricCamera(lens.magnification, lens.working_f_number, M, pitch, image_radius_px)
    k = float(flat.px_per_vergence(np.zeros(())) / flat.px_per_ray(np.zeros(())))
    return _UnderTelecentric(*ends, near, k)


class _Steepest(Protocol):
    """Steepest mapping permitted by a blur, from the rim to the inner end of the field."""

    def bound(self) -> BlurBound: ...


@dataclass(frozen=True)
class _UnderPerspective:
    """Steepest mapping for a perspective lens; radians and mm."""

    omega_min: float
    omega_max: float
    rim: float
    theta: float
    near: float
    """Inverse object distance 1/p."""
    scale: Callable[[Any], Any]
    """Function that returns k (mm) for a vergence D in focus."""

    def bound(self) -> BlurBound:
        t = _min_blur(self._too_steep)
        focus = self._focus(t)
        theta = np.linspace(self.theta, self._path(t, focus)[0], POINTS)
        omega, log_v = self._path(t, focus)[1](theta)
        omega, v = np.asarray(omega), np.exp(log_v)
        x, z = np.sin(theta) / v, np.cos(theta) / v
        blur_t, blur_s = self._blurs(theta, omega, v, t, focus)
        slope = np.tan((omega - theta) / 2)
        return _bound(t, 1 / focus, x, z, slope, omega, blur_t, blur_s)

    def _focus(self, t: float) -> float:
        """Return the nearest focus, as a vergence, with a sagittal blur below t at the rim."""
        v, k = (
            np.sin(self.theta) / self.rim,
            self.scale(np.cos(self.theta) * np.sin(self.theta) / self.rim),
        )
        W = np.sin(self.omega_max) / np.sin(self.theta) + self.near / v
        position = v / np.cos(self.theta) * (W - 1) / W
        D = position
        for _ in range(8):  # k depends weakly on the focus, in the exact form not at all
            # S = k cos(theta) (D W' - B (W' - 1)) = t at the rim, solved for D.
            D = position + t / (k * np.cos(self.theta) * W)
            k = self.scale(D)
        return float(D)

    def _rate(self, theta: float, v: float, t: float, D: float) -> float:
        """Return the largest dOmega/dtheta with a tangential blur of at least -t; inf if none."""
        allowed, B = t / (self.scale(D) * np.cos(theta) ** 2), v / np.cos(theta)
        # T = k cos^2(theta) (B - (B - D) W') = -t, solved for W' = dOmega/dtheta + e, e = near/v.
        return np.inf if B <= D else float((B + allowed) / (B - D) - self.near / v)

    def _path(self, t: float, D: float) -> tuple[float, Callable[[Array], Array]]:
        """Return the end of the steepest mapping, and Omega and ln v (2, n) as a function."""

        def rates(theta: float, state: Array) -> list[float]:
            omega, log_v = state
            return [self._rate(theta, float(np.exp(log_v)), t, D), -np.tan((omega + theta) / 2)]

        start = [self.omega_max, np.log(np.sin(self.theta) / self.rim)]
        return _followed(rates, self.theta, start, self.omega_min)

    def _too_steep(self, t: float) -> float:
        """Return the remaining field at the axis, positive if no mirror attains t."""
        D = self._focus(t)
        if not np.isfinite(self._rate(self.theta, np.sin(self.theta) / self.rim, t, D)):
            return -self.theta
        end, path = self._path(t, D)
        return -end if end > 0 else float(path(np.array([0.0]))[0, 0]) - self.omega_min

    def _blurs(
        self, theta: Array, omega: Array, v: Array, t: float, D: float
    ) -> tuple[Array, Array]:
        k, rate = (
            self.scale(D),
            np.array([self._rate(a, b, t, D) for a, b in zip(theta, v, strict=True)]),
        )
        around = _ratio(np.sin(omega), np.sin(theta), rate)

        def off(W: Array) -> Array:
            return np.asarray(k * np.cos(theta) * (D * W - v / np.cos(theta) * (W - 1)))

        return np.cos(theta) * off(rate + self.near / v), off(around + self.near / v)


@dataclass(frozen=True)
class _UnderTelecentric:
    """Steepest mapping for a telecentric lens.

    ``T = k (1 - y W')`` with W' = dOmega/dx + 1/p, and S with W' = sin(Omega)/x + 1/p. Here y is
    the distance of the focus behind the surface, and ``dy/dx = -tan(Omega/2)``.
    """

    omega_min: float
    omega_max: float
    rim: float
    near: float
    k: float

    def bound(self) -> BlurBound:
        t = _min_blur(self._too_steep)
        end, path = self._path(t)
        x = np.linspace(self.rim, end, POINTS)
        omega, y = path(x)
        rate = np.array([self._rate(b, t) for b in y])
        around = _ratio(np.sin(omega), x, rate)
        blur_t, blur_s = (self.k * (1 - y * (W + self.near)) for W in (rate, around))
        z = y[-1] - y
        return _bound(t, float(y[-1]), x, z, np.tan(omega / 2), omega, blur_t, blur_s)

    def _rate(self, y: float, t: float) -> float:
        return float((1 + t / self.k) / y - self.near)

    def _path(self, t: float) -> tuple[float, Callable[[Array], Array]]:
        y = (1 - t / self.k) / (np.sin(self.omega_max) / self.rim + self.near)

        def rates(x: float, state: Array) -> list[float]:
            return [self._rate(float(state[1]), t), -np.tan(state[0] / 2)]

        return _followed(rates, self.rim, [self.omega_max, y], self.omega_min)

    def _too_steep(self, t: float) -> float:
        if t >= self.k:
            return -self.rim
        end, path = self._path(t)
        return -end if end > 0 else float(path(np.array([0.0]))[0, 0]) - self.omega_min


def _followed(
    rates: Callable[[float, Array], list[float]], start: float, state: list[float], omega_min: float
) -> tuple[float, Callable[[Array], Array]]:
    """Integrate a mapping from the rim to the axis, or to the inner end of the field."""
    from scipy.integrate import solve_ivp

    def begins(_: float, state: Array) -> float:
        return float(state[0]) - omega_min

    begins.terminal = True  # type: ignore[attr-defined]  # attribute defined by SciPy
    with np.errstate(all="ignore"):  # a trial step may pass the horizon and is then reduced
        path = solve_ivp(
            rates,
            (start, 0.0),
            state,
            method="DOP853",
            rtol=TOLERANCE,
            atol=TOLERANCE,
            events=begins,
            dense_output=True,
        )
    return float(path.t[-1]), path.sol


def _min_blur(too_steep: Callable[[float], float]) -> float:
    """Return the smallest feasible blur (radians); all larger values are also feasible."""
    if too_steep(0.0) <= 0:  # a narrow field without a positive bound
        return 0.0
    if not too_steep(MIN_BLUR_RAD) > 0 or not too_steep(MAX_BLUR_RAD) <= 0:
        raise InvalidParameter(
            "the bound of blur for this field, rim, lens and object distance must be "
            f"between {np.degrees(MIN_BLUR_RAD):.2g} and {np.degrees(MAX_BLUR_RAD):.3g} deg"
        )
    return sign_change(too_steep, MIN_BLUR_RAD, MAX_BLUR_RAD, 1e-13)


def _ratio(over: Array, under: Array, limit: Array) -> Array:
    """Return a quotient (n,) with its limit on the axis, a zero of both terms."""
    on_axis = under < 1e-6 * under.max()
    return np.where(on_axis, limit, over / np.where(on_axis, 1.0, under))


def _bound(
    t: float,
    focus: float,
    x: Array,
    z: Array,
    slope: Array,
    omega: Array,
    blur_t: Array,
    blur_s: Array,
) -> BlurBound:
    x, z, slope, omega, blur_t, blur_s = (a[::-1] for a in (x, z, slope, omega, blur_t, blur_s))
    degrees = np.degrees(omega), np.degrees(blur_t), np.degrees(blur_s)
    return BlurBound(float(np.degrees(t)), focus, x, z - z[0], slope, *degrees)
