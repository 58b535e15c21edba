"""Through-focus blur of the virtual images on the imager, and the best focus.

Signed blur diameters are positive for images beyond the focus. In angle they are ``Delta_t / Dh``
and ``Delta_s / Dw`` (Eqs. 36, 37; Eq. 37 contains L_t instead of L_s, erratum 7).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import choice, distances, image_radius, row
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.numerics.minimisation import lowest_with_slopes
from ...base.typing import Array
from ...optics.lenses import BLUR_MODES, BlurMode, Lens
from ...optics.sensor import Sensor, check_sensor
from ...optics.tracing.meridian import ChiefRays
from .coddington import VirtualImages, distances_from_lens, virtual_images
from .focus_merits import FOCUS_MERITS, FocusedBlur, FocusFunction, FocusMerit, Scales, Sides
from .imaging import ImagingCharacteristics, imaging_characteristics

POINTED_CENTRE = 0.1  # relative to the image radius


@dataclass(frozen=True)
class FocusStudy:
    """Focus-independent quantities at n field angles."""

    sensor: Sensor
    rays: ChiefRays
    images: VirtualImages
    mode: BlurMode
    image_radius_px: float | None
    wavelength_nm: float

    def __post_init__(self) -> None:
        choice("mode", self.mode, BLUR_MODES)
        if self.image_radius_px is not None:
            image_radius(self.image_radius_px)

    @cached_property
    def distances(self) -> tuple[Array, Array]:
        """Return L_t and L_s (n,), mm: image distances from the lens (Eqs. 34, 35)."""
        L_t, L_s = distances_from_lens(self.rays, self.images)
        displaced = self.sensor.mirror_pose.displacement_mm if self.sensor.lens.TELECENTRIC else 0.0
        return L_t + displaced, L_s + displaced  # already included in m for a perspective lens

    def heights(self, sensor: Sensor) -> tuple[Array, Array]:
        """Return h (px) and dh/dOmega (px per radian), (n,), of a focused sensor."""
        scale = 1.0 if self.image_radius_px is None else self.image_radius_px / sensor.rim_radius_px
        return sensor.image_height_px(self.rays) * scale, sensor.image_height_rate_px(self.rays) * scale

    def imaging(self, sensor: Sensor) -> ImagingCharacteristics:
        """Return the image (n,) of one object degree, seen from the mirror points."""
        return imaging_characteristics(self.rays.omega, *self.heights(sensor), *self._parallax)

    @cached_property
    def _parallax(self) -> tuple[Array, Array]:
        """Return the image motion (n,), (n,) of a finite object relative to a distant one.

        At a distance D from the start of the ray, ``spread + D Omega'`` and ``x + D sin(Omega)``
        per motion of the mirror point and per radian of azimuth, both divided by the distance p
        from the mirror point.
        """
        rays, p = self.rays, self.images.object_distance
        near = 1 / p
        offset = 0.0 if rays.outside is None else rays.outside.reach - rays.outside.inside
        further = 1 + near * offset
        with np.errstate(divide="ignore", invalid="ignore"):
            t = further + near * rays.spread() / rays.domega_dx()
            s = further + near * rays.start[0] / np.sin(rays.omega)
        return t, np.where(rays.omega == 0.0, t, s)

    def ideal_height(self, lens: Lens) -> Array:
        """Return image heights (n,) mm for a lens without distortion."""
        return lens.ideal_height(self.rays.first.x, self.rays.first.w)

    def stretch(self, lens: Lens) -> tuple[Array, Array]:
        """Return the off-axis magnification (n,), (n,) of the blur by a focused lens, nearly
        independent of the focus.
        """
        return lens.blur_stretch(self.ideal_height(lens))

    def own_px(self, lens: Lens) -> tuple[Array, Array]:
        """Return the blur (n,), (n,) px of the lens alone."""
        pitch = self.sensor.imager.pitch_mm
        t, s = lens.own_blur(self.ideal_height(lens))
        return t / pitch, s / pitch

    def coordinates(self, lens: Lens) -> tuple[Array, Array]:
        """Return the focus coordinates (n,), (n,) of the images."""
        return lens.image_coordinates(*self.distances, self.ideal_height(lens))

    @cached_property
    def own_coordinates(self) -> Array:
        """Return the focus coordinates (2, n) of the images for the lens at its current focus."""
        return np.stack(self.coordinates(self.sensor.lens))

    def scales(self, middle: float, unit: float) -> Callable[[Any], Scales]:
        """Return the focus-dependent quantities as a function of normalised focus coordinates u."""
        lens, pitch = self.sensor.lens, self.sensor.imager.pitch_mm
        own = lens.through_focus(lens.focus_coordinate(lens.focus_distance_mm))
        airy2 = (lens.airy_diameter(self.wavelength_nm) / pitch / own.f_number) ** 2

        def at(u: Any) -> Scales:
            there = lens.through_focus(middle + unit * u, self.mode)
            scale = there.image_scale / own.image_scale if self.image_radius_px is None else 1.0
            floor = 1 + airy2 * there.f_number**2
            return Scales(u, there.blur_rate * (unit / pitch), scale, floor, not lens.IS_THIN)

        return at

    def at(self, focus_mm: float) -> FocusedBlur:
        """Return the blur with the lens focused at an object distance in mm."""
        sensor = self.sensor
        if focus_mm != sensor.lens.focus_distance_mm:
            sensor = sensor.with_lens(sensor.lens.focused_at(focus_mm))
        pitch = sensor.imager.pitch_mm
        lens = sensor.lens
        focused = lens.focus_coordinate(focus_mm)
        rate = lens.through_focus(focused, self.mode).blur_rate / pitch
        t, s = (w * rate * (focused - v) for w, v in zip(self.stretch(lens), self.coordinates(lens), strict=True))
        imaging, airy = self.imaging(sensor), lens.airy_diameter(self.wavelength_nm) / pitch
        return FocusedBlur(t, s, imaging, self.rays.omega, airy, *self.own_px(lens))


class BestFocus(NamedTuple):
    """Optimal focus and value of the merit."""

    focus_mm: float
    value: float
    merit: str


def best_focus(
    sensor: Sensor,
    merit: str = "worst_floored_area_deg2",
    *,
    omega_deg: ArrayLike | None = None,
    object_distance_mm: ArrayLike = np.inf,
    mode: BlurMode = "exact",
    image_radius_px: float | None = None,
    wavelength_nm: float = 550.0,
) -> BestFocus:
    """Compute the focus distance L0 of minimum merit, over the whole field or given angles.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    merit
        Name of a merit in :data:`FOCUS_MERITS`.
    omega_deg : (n,), optional
        Field angles in any order and spacing; by default 1001 over the whole field. For a pointed
        mirror, the central 10 % of the image radius are excluded because the azimuthal image scale
        vanishes there.
    object_distance_mm : scalar or (n,)
        Distance from the reflection point to the object.
    mode, image_radius_px
        ``"paper"`` and 500 reproduce the method of the paper.
    wavelength_nm
        Wavelength of the Airy disk, nm.

    Returns
    -------
    BestFocus
        Focus L0 in mm, and the merit at this focus.

    Raises
    ------
    InvalidParameter
        Unknown merit or mode, invalid numbers, or a mirror without virtual images.
    OutsideField
        Field angle outside the field of view.

    Examples
    --------
    Focus of the spherical mirror in the paper, L0 = 212 mm:

    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> best = best_focus(load_sensor("paper-spherical"), "worst_blur_area_deg2", mode="paper", image_radius_px=500)
    >>> round(best.focus_mm, 1), round(best.value, 4)
    (212.4, 0.0751)
    """
    check_sensor(sensor)
    choice("merit", merit, FOCUS_MERITS)
    omega = _focusable(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    p = distance_per_angle(object_distance_mm, rays.x)
    study = FocusStudy(sensor, rays, virtual_images(rays, p), mode, image_radius_px, wavelength_nm)
    focus = _lowest(study, FOCUS_MERITS[merit])
    return BestFocus(focus, FOCUS_MERITS[merit].value(study.at(focus)), merit)


def distance_per_angle(object_distance_mm: ArrayLike, angles: Array) -> Array:
    """Return object distances as an array, one for all field angles or one for each (n,)."""
    p = distances("object_distance_mm", object_distance_mm)
    if p.shape not in ((), (1,), angles.shape):
        raise InvalidParameter(
            f"object_distance_mm has {p.size} values for {angles.size} field angles; give one, or as many"
        )
    return p


def _lowest(study: FocusStudy, merit: FocusMerit) -> float:
    """Return the focus (mm) of minimum merit."""
    lens = study.sensor.lens
    low, high = _searched(lens, study.own_coordinates)
    middle, half = (low + high) / 2, (high - low) / 2 or 1.0
    function = focus_function(study, merit, middle, half)
    if not np.isfinite(function.coefficients).all():
        bad = int(np.argmin(np.isfinite(function.coefficients).all(axis=0))) % len(study.rays.omega)
        raise InvalidParameter(
            f"omega_deg = {np.degrees(study.rays.omega[bad]):.6g} has no finite blur at any focus (a degree of object "
            "has no size in the picture there, or no image); leave it out"
        )
    coordinate = middle + half * lowest_with_slopes(function, (low - middle) / half, (high - middle) / half)
    limits = lens.PARAMETERS["focus_distance_mm"]
    return float(np.clip(lens.distance_of(coordinate), max(limits.low, lens.nearest_focus_mm), limits.high))


def focus_function(study: FocusStudy, merit: FocusMerit, middle: float, unit: float) -> FocusFunction:
    """Return a merit as a function of normalised :meth:`Lens.focus_coordinate` values."""
    sensor = study.sensor
    imaging = study.imaging(sensor)
    t, s = (study.own_coordinates - middle) / unit
    own_t, own_s = study.own_px(sensor.lens)
    own2 = None if sensor.lens.IS_THIN else (own_t**2, own_s**2)
    sides = Sides(t, s, *study.stretch(sensor.lens), imaging.height, imaging.width, own2)
    return FocusFunction(merit, sides, study.rays.omega, study.scales(middle, unit))


def _searched(lens: Lens, coordinates: Array) -> tuple[float, float]:
    """Return the search range of focus coordinates: those of all images, with a margin."""
    limits = lens.PARAMETERS["focus_distance_mm"]
    if lens.TELECENTRIC:
        return _around(coordinates, limits.low, limits.high)
    # vergences keep the range bounded for distant images; converging images are beyond infinity
    far, near = lens.focus_coordinate([limits.high, max(limits.low, lens.nearest_focus_mm)])
    return _around(np.maximum(coordinates, 0.0), float(far), float(near))


def _around(coordinates: Array, least: float, most: float) -> tuple[float, float]:
    """Return an interval of the focus coordinates of all focusable images, with a margin.

    Coordinates above the upper bound are excluded unless there are no others; those below the lower
    bound are clipped.
    """
    coordinates = coordinates[~np.isnan(coordinates)]
    if not coordinates.size:
        raise InvalidParameter("there are no virtual images, so there is no best focus")
    within = coordinates[coordinates < most] if (coordinates < most).any() else coordinates
    within = np.clip(within, least, most)
    margin = 0.05 * (float(np.ptp(within)) or abs(float(within[0])))
    return max(float(within.min()) - margin, least), min(float(within.max()) + margin, most)


def _focusable(sensor: Sensor) -> Array:
    """Return the field angles (n,), deg, used for focusing."""
    low, high = sensor.field_deg
    if sensor.mirror.is_pointed:
        edge = sensor.meridian.trace(sensor.x_from_height_px([POINTED_CENTRE * sensor.rim_radius_px]))
        low = float(np.degrees(edge.omega[0]))
    return np.linspace(low, high, 1001)
