"""Blur against focus: what the lens and the imager make of the virtual images, and the best focus.

Signed blur diameters are positive where the image lies beyond the focus. In angle they are
``Delta_t / Dh`` and ``Delta_s / Dw`` (Eqs. 36, 37; Eq. 37 prints L_t where L_s is meant, erratum 7).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..lenses import BlurMode, Lens, Perspective
from ..sensor import Sensor
from ..tracing.meridian import ChiefRays
from .imaging import ImagingCharacteristics, imaging_characteristics
from .minimise import lowest
from .virtual_images import VirtualImages, distances_from_lens, virtual_images

Array = NDArray[np.float64]

POINTED_CENTRE = 0.1  # of the image radius


@dataclass(frozen=True)
class Blur:
    """Blur of n field angles at one focus.

    Attributes
    ----------
    t_px, s_px : (n,) px
        Signed tangential and sagittal blur diameters.
    imaging
        Image-forming characteristics, which turn pixels into degrees.
    omega : (n,) radians
    airy_px
        Diameter of the Airy disk.
    """

    t_px: Array
    s_px: Array
    imaging: ImagingCharacteristics
    omega: Array
    airy_px: float

    @property
    def t_deg(self) -> Array:
        """Tangential blur (n,) in degrees of the object (Eq. 36)."""
        return self.t_px / self.imaging.height

    @property
    def s_deg(self) -> Array:
        """Sagittal blur (n,) in degrees of the object (Eq. 37)."""
        with np.errstate(divide="ignore"):
            return self.s_px / self.imaging.width

    def product(self) -> Array:
        """The paper's blur area (n,), square degrees: a product without pi/4 (Fig. 9c), signed by its factors."""
        return self.t_deg * self.s_deg

    def floored_area(self) -> Array:
        """Blur area (n,), square degrees, with a pixel and the Airy disk added in quadrature to each side.

        What a user really gets: the bare product vanishes wherever one of its factors does.
        """
        floor = 1 + self.airy_px**2
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.sqrt((self.t_px**2 + floor) * (self.s_px**2 + floor)) / self.imaging.area


MERITS: dict[str, Callable[[Blur], float]] = {
    "floored-area": lambda b: float(b.floored_area().max()),
    "mean-floored-area": lambda b: float(np.average(b.floored_area(), weights=np.sin(b.omega) + 1e-9)),
    "product": lambda b: float(np.abs(b.product()).max()),
    "worst-px": lambda b: float(np.maximum(np.abs(b.t_px), np.abs(b.s_px)).max()),
    "worst-deg": lambda b: float(np.maximum(np.abs(b.t_deg), np.abs(b.s_deg)).max()),
    "rss-deg": lambda b: float(np.hypot(b.t_deg, b.s_deg).max()),
}
"""What a best focus can minimise over the field: the worst floored area (the default; square degrees),
its mean over solid angle, the worst of the paper's bare product, the worst single blur in pixels or
degrees, the worst root of the squares of both in degrees."""


@dataclass(frozen=True)
class FocusStudy:
    """Everything about n field angles that does not depend on where the lens is focused."""

    sensor: Sensor
    rays: ChiefRays
    images: VirtualImages
    mode: BlurMode
    image_radius_px: float | None
    wavelength_nm: float

    def distances(self) -> tuple[Array, Array]:
        """L_t and L_s (n,), mm: image distances from the lens's reference point (Eqs. 34, 35)."""
        L_t, L_s = distances_from_lens(self.rays, self.images)
        displaced = self.sensor.mirror_pose.displacement_mm if self.sensor.lens.TELECENTRIC else 0.0
        return L_t + displaced, L_s + displaced  # m itself holds it under a perspective lens

    def heights(self, sensor: Sensor) -> tuple[Array, Array]:
        """h (px) and dh/dOmega (px per radian), (n,), of the sensor as focused."""
        scale = 1.0 if self.image_radius_px is None else self.image_radius_px / sensor.rim_radius_px
        return sensor.image_height_px(self.rays) * scale, sensor.image_height_rate_px(self.rays) * scale

    def at(self, focus_mm: float) -> Blur:
        """Blur with the lens focused at an object distance in mm."""
        sensor = replace(self.sensor, lens=self.sensor.lens.focused_at(focus_mm))
        h, rate = self.heights(sensor)
        pitch, first = sensor.imager.pitch_mm, self.rays.first
        L_t, L_s = self.distances()
        wider_t, wider_s = sensor.lens.stretch(sensor.lens.ideal_height(first.x, first.w))
        return Blur(
            wider_t * sensor.lens.blur(L_t, mode=self.mode) / pitch,
            wider_s * sensor.lens.blur(L_s, mode=self.mode) / pitch,
            imaging_characteristics(self.rays.omega, h, rate),
            self.rays.omega,
            sensor.lens.airy_diameter(self.wavelength_nm) / pitch,
        )


class BestFocus(NamedTuple):
    """The focus that minimises a merit, and the merit there."""

    focus_mm: float
    value: float
    merit: str


def best_focus(
    sensor: Sensor,
    merit: str = "floored-area",
    omega_deg: ArrayLike | None = None,
    object_distance_mm: ArrayLike = np.inf,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
    wavelength_nm: float = 550.0,
) -> BestFocus:
    """The object distance L0 to focus at, over the whole field or the angles given.

    Parameters
    ----------
    merit
        One of :data:`MERITS`.
    omega_deg : (n,), optional
        Field angles; 1001 over the whole field by default, without the middle tenth of the image of a
        pointed mirror, where a degree of azimuth shrinks to nothing and no focus helps.
    mode, image_radius_px
        ``"paper"`` and 500 to compute as the paper does.

    Raises
    ------
    InvalidParameter
        An unknown merit, or a mirror without virtual images.

    Examples
    --------
    The paper's choice for its spherical mirror, L0 = 212 mm:

    >>> from omnimirror.specs import load_sensor
    >>> best = best_focus(load_sensor("paper-spherical"), "product", mode="paper", image_radius_px=500)
    >>> round(best.focus_mm, 1), round(best.value, 4)
    (212.4, 0.0751)
    """
    if merit not in MERITS:
        raise InvalidParameter(f"merit = {merit!r} is not known; valid are {', '.join(MERITS)}")
    omega = _focusable(sensor) if omega_deg is None else np.asarray(omega_deg, dtype=float)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    study = FocusStudy(sensor, rays, virtual_images(rays, object_distance_mm), mode, image_radius_px, wavelength_nm)
    L = np.concatenate(study.distances())
    limits = sensor.lens.PARAMETERS["focus_distance_mm"]

    def price(focus_mm: float) -> float:
        return MERITS[merit](study.at(focus_mm))

    if sensor.lens.TELECENTRIC:
        focus = lowest(price, *_around(L, limits.low, limits.high))
    else:  # by nearness 1/L0, in which blur is linear, and far images do not stretch the search
        nearest = max(limits.low, _closest(sensor.lens))
        with np.errstate(divide="ignore"):
            nearness = np.where(L < 0, 0.0, 1 / L)  # what lies behind the lens converges: beyond infinity
        low, high = _around(nearness, 1 / limits.high, 1 / nearest)
        focus = float(np.clip(1 / lowest(lambda v: price(1 / v), low, high), nearest, limits.high))
    return BestFocus(focus, price(focus), merit)


def _around(places: Array, least: float, most: float) -> tuple[float, float]:
    """An interval that holds the places of all images that a lens can be focused at, and a little more.

    Places past the last one are left out, unless there are no others; those before the first count as the first.
    """
    places = places[~np.isnan(places)]
    if not places.size:
        raise InvalidParameter("there are no virtual images, so there is no best focus")
    within = places[places < most] if (places < most).any() else places
    within = np.clip(within, least, most)
    margin = 0.05 * (float(np.ptp(within)) or abs(float(within[0])))
    return max(float(within.min()) - margin, least), min(float(within.max()) + margin, most)


def _closest(lens: Lens) -> float:
    """Nearest object distance (mm) that a lens could be focused at: a little beyond its focal length."""
    return 1.0001 * lens.focal_length_mm if isinstance(lens, Perspective) else 0.0


def _focusable(sensor: Sensor) -> Array:
    """The field angles (n,), deg, that the focus is chosen for."""
    low, high = sensor.field_deg
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px]))
        low = float(np.degrees(edge.omega[0]))
    return np.linspace(low, high, 1001)
