"""Design merits: one number for a whole field, computed from values at the field angles.

A merit is the largest of many smooth rows, such as the blur at each angle, which a sequence of
linear programmes can minimise; or their mean. Smaller values are better. Overall dimensions and mass
of a sensor, of mirror, camera and housing, are merits as well.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..analysis.evaluation import Evaluation
from ..base.errors import InvalidParameter
from ..base.quantities import QUANTITIES, Quantity
from ..optics.batch.closed_forms import FocusedCamera, MirrorPointOptics, light_of
from ..optics.housing import Rim
from ..optics.lenses import FieldLens, GaussianLens, Perspective
from ..optics.mirrors import Mirror
from ..optics.sensor import Sensor
from ..optics.thermal import DENSITIES_G_PER_CM3
from .catalogue import BallComponent, Component

# -- Overall dimensions and mass -------------------------------------------------------------------

MATERIAL = "aluminium"
"""Default material of the mirror body."""
POINTS = 64  # nodes of the Gauss-Legendre quadrature


class OuterSize(NamedTuple):
    """Overall dimensions of a sensor."""

    diameter_mm: float
    height_mm: float
    """Height along the axis, from imager or camera back to the back of the mirror body."""


def outer_size(sensor: Sensor, parts: tuple[Component, ...] = ()) -> OuterSize:
    """Return the largest diameter and the height of a sensor, including parts of known dimensions.

    For a telecentric lens, whose distance is free, the height includes only the mirror and the
    parts.

    Examples
    --------
    >>> import omnimirror as om
    >>> [round(mm, 1) for mm in outer_size(om.load_sensor("paper-spherical"))]
    [87.8, 223.8]
    """
    housing, lens = sensor.housing, sensor.lens
    rim, (_, (_, top)) = housing.rim or Rim(), sensor.mirror.bounds
    widths = [
        2 * (sensor.mirror.rim_radius_mm + rim.width_mm),
        *(part.diameter_mm or 0.0 for part in parts),
    ]
    if housing.camera is not None:
        widths.append(housing.camera.diameter_mm)
    if housing.shell is not None:
        shell = sensor.obstructions.housing.shell
        assert shell is not None
        widths.append(shell.diameter_mm or 0.0)  # a window may be unbounded
    behind = sum(part.length_mm or 0.0 for part in parts if part.KIND == "imager")
    height = top + rim.thickness_mm + behind
    if isinstance(lens, GaussianLens):
        height += sensor.mirror_distance_mm + lens.imager_mm
    else:
        height += sum(part.length_mm or 0.0 for part in parts if part.KIND == "lens")
    return OuterSize(float(max(widths)), float(height))


def mirror_mass_g(
    mirror: Mirror, thickness_mm: float = Rim().thickness_mm, material: str | None = None
) -> float:
    """Return the mass of a mirror between its surface and a flat back behind its highest point.

    Examples
    --------
    Cylinder with a conical cavity:

    >>> from omnimirror.optics.mirrors import Cone
    >>> round(mirror_mass_g(Cone(45.0, 10.0), 5.0), 2), round(2.7e-3 * np.pi * 100 * (5 + 10 * 2 / 3 - 10 / 3), 2)
    (7.07, 7.07)
    """
    u, weight = gauss_nodes()
    x = mirror.rim_radius_mm * (u + 1) / 2
    (_, _), (_, top) = mirror.bounds
    depth = top + thickness_mm - mirror.sag(x)
    volume = np.pi * mirror.rim_radius_mm * float((x * depth * weight).sum())
    return density_of(material) * volume / 1000


def density_of(material: str | None) -> float:
    """Return the density of a mirror material, g/cm3; None selects the default material."""
    return DENSITIES_G_PER_CM3[material or MATERIAL]


@cache
def gauss_nodes() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return nodes (n,) in (-1, 1) and weights of the Gauss-Legendre quadrature for volumes."""
    u, weight = np.polynomial.legendre.leggauss(POINTS)
    return u, weight


def body_mass_g(sensor: Sensor) -> float:
    """Return the mass of the mirror of a sensor, with the material of its thermal properties.

    Examples
    --------
    >>> import omnimirror as om
    >>> round(body_mass_g(om.load_sensor("paper-spherical")))
    321
    """
    thickness = (sensor.housing.rim or Rim()).thickness_mm
    material = None if sensor.thermal is None else sensor.thermal.mirror_material
    return mirror_mass_g(sensor.mirror, thickness, material)


def mass_g(sensor: Sensor, parts: tuple[Component, ...]) -> float | None:
    """Return the mass of mirror (or mirror ball) and parts; None if a mass is unknown."""
    masses_g = [part.mass_g for part in parts]
    if any(mass is None for mass in masses_g):
        return None
    mirror_g = (
        0.0 if any(isinstance(part, BallComponent) for part in parts) else body_mass_g(sensor)
    )
    return mirror_g + sum(mass or 0.0 for mass in masses_g)


def price(parts: tuple[Component, ...]) -> float | None:
    """Return the total price of the parts; None if a price is unknown."""
    prices = [part.price for part in parts]
    return None if any(p is None for p in prices) else sum(p or 0.0 for p in prices)


# -- Values and merits -----------------------------------------------------------------------------

Array = NDArray[Any]

PROJECTIONS = 8


NO_VALUES: Array = np.zeros((1, 1))


class FieldValues(NamedTuple):
    """Field values for merits and limits, (..., k) over k field angles or (..., 1) if common."""

    t_px: Array
    """Signed tangential blur (Eq. 28)."""
    s_px: Array
    """Signed sagittal blur."""
    dh: Array
    """Radial resolution Dh, px/deg (Eq. 9)."""
    dw: Array
    """Azimuthal resolution Dw, px/deg (Eq. 10)."""
    log_area: Array
    """Logarithm of the floored blur area in square degrees."""
    viewpoint_z: Array
    """Height of the viewpoint above the vertex, mm (Eq. 6)."""
    solid_angle: Array
    """Solid-angle weight of each field angle, up to a factor."""
    image_distance: Array
    """Distance from the lens to the imager, mm; 0 for a telecentric lens."""
    length: Array
    """Axial distance from the lens (telecentric: vertex) to the farther of rim and vertex, mm."""
    sag: Array
    """Axial height of the mirror, mm."""
    airy_px: Array
    """Diameter of the Airy disc, px."""
    light: Array
    """Relative illumination of the lens."""
    own_t_px: Array
    """Tangential blur of the lens alone, px; 0 for an ideal lens."""
    own_s_px: Array
    obscured_to_deg: Array = NO_VALUES
    """Upper end of the central obscuration, deg; 0 during searches without this value."""
    obscured_percent: Array = NO_VALUES
    """Obscured percentage of the image circle."""
    overall_diameter_mm: Array = NO_VALUES
    """Diameter of mirror and housing; 0 during searches without this value."""
    overall_height_mm: Array = NO_VALUES
    mirror_body_mass_g: Array = NO_VALUES
    omega: Array = NO_VALUES
    """Field angles, radians."""
    near: Array = NO_VALUES
    """Inverse object distance from the mirror points, 1/mm."""

    @property
    def plane_t_mm_per_px(self) -> Array:
        """Tangential object length per pixel on a plane perpendicular to the axis."""
        cosine = np.cos(self.omega)
        return self.object_t_mm_per_px / np.where(cosine.real < 0, -cosine, cosine)

    @property
    def cylinder_t_mm_per_px(self) -> Array:
        """Tangential object length per pixel on a cylinder about the axis."""
        return self.object_t_mm_per_px / np.sin(self.omega)

    @property
    def object_t_mm_per_px(self) -> Array:
        """Tangential object length per pixel perpendicular to the ray."""
        return self._length(self.dh)

    @property
    def object_s_mm_per_px(self) -> Array:
        """Sagittal object length per pixel."""
        return self._length(self.dw)

    def _length(self, px_per_deg: Array) -> Array:
        with np.errstate(all="ignore"):
            length: Array = np.where(
                self.near == 0, np.inf, np.radians(1.0) / (self.near * px_per_deg)
            )
        return length

    @property
    def t_deg(self) -> Array:
        """Signed tangential blur in object degrees (Eq. 36)."""
        return self.t_px / self.dh

    @property
    def s_deg(self) -> Array:
        """Signed sagittal blur in object degrees (Eq. 37)."""
        return self.s_px / self.dw

    @property
    def disk_t_px(self) -> Array:
        """Focus-independent blur: Airy disc and tangential blur of the lens alone."""
        return _in_quadrature(self.airy_px, self.own_t_px)

    @property
    def disk_s_px(self) -> Array:
        return _in_quadrature(self.airy_px, self.own_s_px)

    @property
    def blur_t_px(self) -> Array:
        """Tangential blur including that of the lens; signed for an ideal lens."""
        return _in_quadrature(self.t_px, self.own_t_px)

    @property
    def blur_s_px(self) -> Array:
        return _in_quadrature(self.s_px, self.own_s_px)

    @property
    def log_density(self) -> Array:
        """Logarithm of Ds, the pixels per square degree of the object (Eq. 11)."""
        density: Array = np.log(self.dh * self.dw)
        return density

    @property
    def log_aspect(self) -> Array:
        """Logarithm of Dw/Dh (Eq. 12)."""
        aspect: Array = np.log(self.dw / self.dh)
        return aspect

    @property
    def total_track(self) -> Array:
        """Axial distance from imager to rim, mm."""
        return self.image_distance + self.length

    def part(self, which: slice) -> FieldValues:
        """Return the values at a slice of field angles."""
        return FieldValues(*(a if a.shape[-1] == 1 else a[..., which] for a in self))

    def at(self, which: NDArray[np.intp]) -> FieldValues:
        """Return the values at selected field angles (..., k), with weight 0 for repeated ones."""
        index = np.arange(which.shape[-1])
        selected = [
            a if a.shape[-1] == 1 else np.take_along_axis(a, _like(which, a), axis=-1) for a in self
        ]
        return FieldValues(*selected)._replace(
            solid_angle=np.where(which == index, self.solid_angle, 0.0)
        )


def _like(which: NDArray[np.intp], values: Array) -> NDArray[np.intp]:
    return np.broadcast_to(which, values.shape[:-1] + which.shape[-1:])


OF_THE_WHOLE: dict[str, Callable[[Sensor], float]] = {
    "obscured_to_deg": lambda sensor: sensor.obscured_to_deg,
    "obscured_percent": lambda sensor: sensor.obscured_percent,
    "overall_diameter_mm": lambda sensor: outer_size(sensor).diameter_mm,
    "overall_height_mm": lambda sensor: outer_size(sensor).height_mm,
    "mirror_body_mass_g": body_mass_g,
}
"""Quantities of the sensor as a whole, independent of the field angle."""


def with_whole(
    field: FieldValues, sensor: Sensor, names: Iterable[str] = tuple(OF_THE_WHOLE)
) -> FieldValues:
    """Return field values completed with quantities of the whole sensor."""
    return field._replace(**{name: np.array([OF_THE_WHOLE[name](sensor)]) for name in names})


def _in_quadrature(blur: Array, own: Array) -> Array:
    """Return the sum in quadrature; without lens blur, the signed blur."""
    both: Array = np.where(np.real(own) > 0, np.sqrt(blur * blur + own * own), blur)
    return both


def values_at(
    o: MirrorPointOptics, camera: FocusedCamera, v: Array, length: Array, sag: Array
) -> FieldValues:
    """Return field values of mirror points (..., k) for cameras focused at vergences v (..., 1)."""
    images = camera.at(o, v)
    floor = 1 + images.airy_px**2
    t, s, own_t, own_s = images.t_px, images.s_px, images.own_t_px, images.own_s_px
    log_area = np.log(
        (t * t + own_t * own_t + floor) * (s * s + own_s * own_s + floor)
    ) / 2 - np.log(images.dh * images.dw)
    b0 = camera.image_distance(v)
    return FieldValues(
        t,
        s,
        images.dh,
        images.dw,
        log_area,
        o.viewpoint_z,
        solid_angle(o.omega),
        b0,
        length,
        sag,
        images.airy_px,
        images.light,
        own_t,
        own_s,
        omega=o.omega,
        near=np.broadcast_to(o.near, np.shape(o.omega)),
    )


def values_of(
    result: Any,
    light: Array,
    image_distance: ArrayLike,
    length: ArrayLike,
    sag: ArrayLike,
    airy_px: ArrayLike,
    own_px: tuple[Array, Array] | None = None,
    object_distance_mm: ArrayLike = np.inf,
) -> FieldValues:
    """Return field values from an :class:`~omnimirror.analysis.Evaluation` or a batch of designs.

    Field angles must increase along the last axis; the other values (...) are those of
    :class:`FieldValues`. ``own_px`` (..., k) is the blur of a real lens alone,
    ``object_distance_mm`` the object distance or distances (k,).
    """
    omega = np.radians(result.omega_deg)
    b0, reach, height, airy = (
        np.asarray(v, dtype=float)[..., None] for v in (image_distance, length, sag, airy_px)
    )
    with np.errstate(all="ignore"):
        return FieldValues(
            result.blur_t_px,
            result.blur_s_px,
            result.dh_domega_px_per_deg,
            result.width_px_per_deg,
            np.log(result.floored_area_deg2),
            result.viewpoint_z_mm,
            solid_angle(omega),
            b0,
            reach,
            height,
            airy,
            light,
            *(own_px or (0 * airy, 0 * airy)),
            omega=omega,
            near=np.broadcast_to(1 / np.asarray(object_distance_mm), omega.shape),
        )


def values_of_evaluation(result: Evaluation) -> FieldValues:
    """Return the field values of one evaluated sensor."""
    lens = result.sensor.lens
    (_, _), (bottom, top) = result.sensor.mirror.bounds
    numbers = result.length_mm, top - bottom, result.airy_px
    if isinstance(lens, FieldLens):
        real = result.of_lens
        own = real["lens_blur_t_px"], real["lens_blur_s_px"]
        values = values_of(
            result,
            real["lens_illumination"],
            lens.imager_mm,
            *numbers,
            own,
            result.object_distance_mm,
        )
    else:
        b0 = lens.image_distance if isinstance(lens, Perspective) else 0.0
        tangent = np.tan(np.radians(result.theta_deg)) * (not lens.TELECENTRIC)
        values = values_of(result, light_of(tangent), b0, *numbers, None, result.object_distance_mm)
    return with_whole(values, result.sensor)


def solid_angle(omega: Array) -> Array:
    """Return solid-angle weights (..., k) of field angles in radians, up to a factor.

    A decrease of the field angle marks the next object distance.
    """
    steps = np.diff(omega, axis=-1) / 2
    steps = np.where(steps.real > 0, steps, 0.0)
    none = np.zeros_like(omega[..., :1])
    shares: Array = np.sin(omega) * (
        np.concatenate([steps, none], -1) + np.concatenate([none, steps], -1)
    )
    return shares


@dataclass(frozen=True)
class Merit:
    """Quantity to be minimised: its rows, and the value of the largest row.

    Attributes
    ----------
    rows
        Function of the field values that returns rows whose largest element is minimised, each with
        the shape of the field arrays.
    shown, hidden
        Conversion of the largest element to the reported value, and its inverse.
    is_spread
        True if the rows have a free offset; the minimised element is then half of largest minus
        smallest.
    is_sharpness
        True if it depends on the focus, except through the image scale.
    is_mean
        True for the mean over the solid angle instead of the maximum.
    """

    quantity: Quantity
    rows: Callable[[FieldValues], tuple[Array, ...]]
    shown: Callable[[Array], Array]
    hidden: Callable[[Array], Array]
    is_spread: bool = False
    is_mean: bool = False
    is_sharpness: bool = True

    @property
    def name(self) -> str:
        return self.quantity.name

    def value(self, field: FieldValues) -> Array:
        """Return the merit (...) of fields (..., k)."""
        with np.errstate(all="ignore"):
            rows = np.stack(np.broadcast_arrays(*self.rows(field)))
            if self.is_mean:
                weights = np.broadcast_to(field.solid_angle, rows.shape[1:])
                return self.shown(
                    (np.where(weights > 0, np.exp(rows[0]), 0.0) * weights).sum(-1)
                    / weights.sum(-1)
                )
            largest = rows.max(axis=(0, -1))
            if self.is_spread:
                largest = (largest - rows.min(axis=(0, -1))) / 2
            return self.shown(largest)


def _either_sign(
    *parts: Callable[[FieldValues], Array],
) -> Callable[[FieldValues], tuple[Array, ...]]:
    return lambda f: tuple(sign * part(f) for part in parts for sign in (1, -1))


def _same(value: Array) -> Array:
    return value


def _length_of(t: Array, s: Array) -> tuple[Array, ...]:
    """Return the length of (t, s) and its projections, which never exceed it: straight rows that
    represent its curvature in a linear programme.
    """
    directions = 2 * np.pi * np.arange(PROJECTIONS) / PROJECTIONS
    return (np.sqrt(t * t + s * s), *(t * np.cos(a) + s * np.sin(a) for a in directions))


def _merit(
    name: str,
    rows: Callable[[FieldValues], tuple[Array, ...]],
    display: Callable[[Array], Array] = _same,
    hidden: Callable[[Array], Array] = _same,
    **more: bool,
) -> Merit:
    return Merit(QUANTITIES[name], rows, display, hidden, **more)


DESIGN_MERITS: dict[str, Merit] = {
    merit.name: merit
    for merit in (
        _merit("worst_floored_area_deg2", lambda f: (f.log_area,), np.exp, np.log),
        _merit("mean_floored_area_deg2", lambda f: (f.log_area,), is_mean=True),
        _merit("worst_blur_deg", _either_sign(lambda f: f.t_deg, lambda f: f.s_deg)),
        _merit("worst_blur_rss_deg", lambda f: _length_of(f.t_deg, f.s_deg)),
        _merit("worst_blur_t_deg", _either_sign(lambda f: f.t_deg)),
        _merit("worst_blur_s_deg", _either_sign(lambda f: f.s_deg)),
        _merit(
            "inverse_area_ratio",
            lambda f: (f.log_density,),
            lambda t: np.exp(2 * t),
            lambda t: np.log(t) / 2,
            is_spread=True,
            is_sharpness=False,
        ),
        _merit(
            "worst_aspect", _either_sign(lambda f: f.log_aspect), np.exp, np.log, is_sharpness=False
        ),
        _merit(
            "viewpoint_spread_mm",
            lambda f: (f.viewpoint_z,),
            lambda t: 2 * t,
            lambda t: t / 2,
            is_spread=True,
            is_sharpness=False,
        ),
        _merit("total_track_mm", lambda f: (f.total_track,), is_sharpness=False),
    )
}
"""Merits by name."""


def merit_named(name: str) -> Merit:
    """Return the merit of a given name.

    Raises
    ------
    InvalidParameter
        If the name is unknown.
    """
    if name not in DESIGN_MERITS:
        raise InvalidParameter(f"merit must be one of {', '.join(DESIGN_MERITS)}; got {name!r}")
    return DESIGN_MERITS[name]
