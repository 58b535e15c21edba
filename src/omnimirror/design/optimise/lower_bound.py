"""How sharp a mirror can be at all: the least worst single blur of any mirror of a field, rim and lens.

Written with the mapping instead of the surface, both blurs are simple. With ``v = 1/rho`` the inverse distance
from the lens to the mirror point, ``D = 1/L0``, ``e = rho/p`` and ``k = f/F``, Eqs. 14-21, 28, 36 and 37 become, in
degrees of the objects as seen from the mirror point,

    T = k cos^2(theta) (D W' - v/cos(theta) (W' - 1)),     W' = dOmega/dtheta + e
    S = k cos(theta) (D W' - v/cos(theta) (W' - 1)),     W' = sin(Omega)/sin(theta) + e

and the surface is ``d ln v/d theta = -tan((Omega + theta)/2)``. At the rim Omega and v are given, so that S there
says how near the lens may be focused, and ``T >= -t`` says how steep the mapping may be on the way from the rim to
the axis. If the steepest mapping does not come down to where the field begins, no mirror keeps t. The proof is in
``docs/blur-bound.md``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked, choice, distances, image_radius
from ...base.errors import InvalidParameter
from ...base.numerics.roots import sign_change
from ...optics.batch.optics import PerspectiveCamera, TelecentricCamera
from ...optics.lenses import BLUR_MODES, BlurMode, Orthographic, Perspective
from ...optics.sensor import Sensor

Array = NDArray[np.float64]

LEAST, MOST = 1e-6, 3.0  # radians; where the bound is looked for
POINTS = 401
TOLERANCE = 1e-11  # relative, of the integration


@dataclass(frozen=True)
class BlurBound:
    """What no mirror of a field, rim and lens does better than, and the mirror that does as well.

    Attributes
    ----------
    blur_deg : deg
        No such mirror has a worst single blur, tangential or sagittal, below this.
    focus_mm : mm
        Where the lens is focused then, L0; under a telecentric lens it counts from the surface's first point.
    x_mm, z_mm, slope : (n,) mm, mm and dimensionless
        The surface that is as steep as may be, from where the field begins to the rim; z counts from the first point.
    omega_deg, t_deg, s_deg : (n,) deg
        Its field angles, and its signed blurs there.
    """

    blur_deg: float
    focus_mm: float
    x_mm: Array = field(repr=False)
    z_mm: Array = field(repr=False)
    slope: Array = field(repr=False)
    omega_deg: Array = field(repr=False)
    t_deg: Array = field(repr=False)
    s_deg: Array = field(repr=False)

    @property
    def is_reached(self) -> bool:
        """Whether that mirror keeps the bound sagittally too, and so is the sharpest there is."""
        return bool(np.abs(self.s_deg).max() <= self.blur_deg * (1 + 1e-6))


@checked
def blur_bound(
    sensor: Sensor,
    object_distance_mm: float = np.inf,
    *,
    omega_min_deg: float | None = None,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
) -> BlurBound:
    """The least worst single blur that any mirror can have, of a sensor's field, rim, lens and place of the lens.

    Compared with are all mirrors that have the sensor's rim radius, its field angle and its lens's viewing angle at the
    rim, wherever they are focused. Objects are all at one distance from the mirror, at which blur is evaluated.

    Parameters
    ----------
    sensor
        Aligned, with one mirror, and a lens that does not distort.
    object_distance_mm : mm
        Distance p from the mirror to the objects.
    omega_min_deg : deg
        Where the field begins that counts; None for all that the sensor sees.
    mode, image_radius_px
        As :func:`omnimirror.evaluate` takes them.

    Returns
    -------
    BlurBound

    Raises
    ------
    InvalidParameter
        A sensor of two mirrors, a lens that distorts, an object distance that is not above 0, a field that does not
        begin within the sensor's.

    Notes
    -----
    See ``docs/blur-bound.md`` for the proof, from Eqs. 2-5, 14-21, 28, 36 and 37.

    Examples
    --------
    The paper's sphere, and what any mirror in its place could reach:

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
    sensor.check("the bound of blur", "one mirror", "thin lens")
    distances("object_distance_mm", object_distance_mm)
    low, high = sensor.field_deg
    if omega_min_deg is not None and not low <= omega_min_deg < high:
        raise InvalidParameter(f"omega_min_deg = {omega_min_deg:g} is not in the field of {low:.4g} to {high:.4g} deg")
    begin = low if omega_min_deg is None else omega_min_deg
    steepest = _steepest(sensor, np.radians((begin, high)), 1 / object_distance_mm, mode, image_radius_px)
    return steepest.bound()


def _steepest(sensor: Sensor, field: Array, near: float, mode: BlurMode, image_radius_px: float | None) -> _Steepest:
    lens, M, pitch = sensor.lens, sensor.mirror.rim_radius_mm, sensor.imager.pitch_mm
    ends = float(field[0]), float(field[1]), M
    if isinstance(lens, Perspective):
        if any(lens.brown):
            raise InvalidParameter(f"{sensor.name} has a lens that distorts; the bound of blur is of one that does not")
        theta = float(sensor.meridian.theta_max)
        camera = PerspectiveCamera(lens.focal_length_mm, lens.f_number, np.tan(theta), pitch, mode, image_radius_px)
        return _UnderPerspective(*ends, theta, near, lambda D: camera.px_per_vergence(D) / camera.px_per_ray(D))
    assert isinstance(lens, Orthographic)
    flat = TelecentricCamera(lens.magnification, lens.working_f_number, M, pitch, image_radius_px)
    k = float(flat.px_per_vergence(np.zeros(())) / flat.px_per_ray(np.zeros(())))
    return _UnderTelecentric(*ends, near, k)


class _Steepest(Protocol):
    """The steepest mapping that a blur allows, from the rim to where the field begins."""

    def bound(self) -> BlurBound: ...


@dataclass(frozen=True)
class _UnderPerspective:
    """Of mirrors before a perspective lens; radians and mm."""

    omega_min: float
    omega_max: float
    rim: float
    theta: float
    near: float
    """1/p of the objects."""
    scale: Callable[[Any], Any]
    """k (mm) of a vergence D that is in focus."""

    def bound(self) -> BlurBound:
        t = _least(self._too_steep)
        focus = self._focus(t)
        theta = np.linspace(self.theta, self._path(t, focus)[0], POINTS)
        omega, log_v = self._path(t, focus)[1](theta)
        omega, v = np.asarray(omega), np.exp(log_v)
        x, z = np.sin(theta) / v, np.cos(theta) / v
        blur_t, blur_s = self._blurs(theta, omega, v, t, focus)
        slope = np.tan((omega - theta) / 2)
        return _bound(t, 1 / focus, x, z, slope, omega, blur_t, blur_s)

    def _focus(self, t: float) -> float:
        """The nearest focus, as a vergence, that leaves the sagittal blur at the rim below t."""
        v, k = np.sin(self.theta) / self.rim, self.scale(np.cos(self.theta) * np.sin(self.theta) / self.rim)
        W = np.sin(self.omega_max) / np.sin(self.theta) + self.near / v
        place = v / np.cos(self.theta) * (W - 1) / W
        D = place
        for _ in range(8):  # k hardly depends on the focus, and in the exact form not at all
            D = place + t / (k * np.cos(self.theta) * W)
            k = self.scale(D)
        return float(D)

    def _rate(self, theta: float, v: float, t: float, D: float) -> float:
        """The largest dOmega/dtheta whose tangential blur is not below -t; inf where there is none."""
        allowed, B = t / (self.scale(D) * np.cos(theta) ** 2), v / np.cos(theta)
        return np.inf if B <= D else float((B + allowed) / (B - D) - self.near / v)

    def _path(self, t: float, D: float) -> tuple[float, Callable[[Array], Array]]:
        """Where the steepest mapping ends, and Omega and ln v (2, n) of viewing angles (n,) down to there."""

        def rates(theta: float, state: Array) -> list[float]:
            omega, log_v = state
            return [self._rate(theta, float(np.exp(log_v)), t, D), -np.tan((omega + theta) / 2)]

        start = [self.omega_max, np.log(np.sin(self.theta) / self.rim)]
        return _followed(rates, self.theta, start, self.omega_min)

    def _too_steep(self, t: float) -> float:
        """Above 0 where no mirror keeps t: what is left of the field at the axis."""
        D = self._focus(t)
        if not np.isfinite(self._rate(self.theta, np.sin(self.theta) / self.rim, t, D)):
            return -self.theta
        end, path = self._path(t, D)
        return -end if end > 0 else float(path(np.array([0.0]))[0, 0]) - self.omega_min

    def _blurs(self, theta: Array, omega: Array, v: Array, t: float, D: float) -> tuple[Array, Array]:
        k, rate = self.scale(D), np.array([self._rate(a, b, t, D) for a, b in zip(theta, v, strict=True)])
        around = _ratio(np.sin(omega), np.sin(theta), rate)

        def off(W: Array) -> Array:
            return np.asarray(k * np.cos(theta) * (D * W - v / np.cos(theta) * (W - 1)))

        return np.cos(theta) * off(rate + self.near / v), off(around + self.near / v)


@dataclass(frozen=True)
class _UnderTelecentric:
    """Mirrors before a telecentric lens.

    ``T = k (1 - y W')`` with W' = dOmega/dx + 1/p, S the same with W' = sin(Omega)/x + 1/p, where y is the distance of
    the focus behind the surface, and ``dy/dx = -tan(Omega/2)``.
    """

    omega_min: float
    omega_max: float
    rim: float
    near: float
    k: float

    def bound(self) -> BlurBound:
        t = _least(self._too_steep)
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
    """A mapping from the rim down to the axis, or to where the field begins."""
    from scipy.integrate import solve_ivp

    def begins(_: float, state: Array) -> float:
        return float(state[0]) - omega_min

    begins.terminal = True  # type: ignore[attr-defined]
    with np.errstate(all="ignore"):  # a step that is tried may lead past the horizon, and is made shorter
        path = solve_ivp(
            rates, (start, 0.0), state, method="DOP853", rtol=TOLERANCE, atol=TOLERANCE, events=begins,
            dense_output=True,
        )  # fmt: skip
    return float(path.t[-1]), path.sol


def _least(too_steep: Callable[[float], float]) -> float:
    """The least blur (radians) that is not too steep; a blur that is allowed allows all larger ones too."""
    if too_steep(0.0) <= 0:  # so narrow a field asks for none
        return 0.0
    if not too_steep(LEAST) > 0 or not too_steep(MOST) <= 0:
        raise InvalidParameter(
            f"this field, rim, lens and object distance have no bound of blur between {np.degrees(LEAST):.2g} and "
            f"{np.degrees(MOST):.3g} deg"
        )
    return sign_change(too_steep, LEAST, MOST, 1e-13)


def _ratio(over: Array, under: Array, limit: Array) -> Array:
    """A quotient (n,) that has a limit on the axis, where both vanish."""
    on_axis = under < 1e-6 * under.max()
    return np.where(on_axis, limit, over / np.where(on_axis, 1.0, under))


def _bound(
    t: float, focus: float, x: Array, z: Array, slope: Array, omega: Array, blur_t: Array, blur_s: Array
) -> BlurBound:
    x, z, slope, omega, blur_t, blur_s = (a[::-1] for a in (x, z, slope, omega, blur_t, blur_s))
    degrees = np.degrees(omega), np.degrees(blur_t), np.degrees(blur_s)
    return BlurBound(float(np.degrees(t)), focus, x, z - z[0], slope, *degrees)
