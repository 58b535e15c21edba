"""Evaluation of a sensor: one row per field angle, one column per quantity of the paper."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base import quantities
from ..base.arguments import choice, image_radius, number, numbers, validate_arguments
from ..base.errors import InvalidParameter
from ..base.files import write_text
from ..base.quantities import QUANTITIES, document_attributes
from ..base.results import Columns, FieldResult, Fields, column_fields, write_columns
from ..base.typing import Array
from ..optics.housing import NO_HOUSING
from ..optics.lenses import BLUR_MODES, BlurMode, DepthOfField, FieldLens, GaussianLens
from ..optics.mirrors import Mirror, SampledProfile
from ..optics.sensor import Sensor, check_sensor
from .focus import FocusStudy, best_focus, distance_per_angle, viewpoint_z, virtual_images

# -- Standard deviations from the scatter of a measured profile ------------------------------------

PERTURBATION = 1e-4  # perturbation of the profile relative to a standard deviation


def standard_deviations(
    mirror: Mirror, columns_of: Callable[[Mirror], dict[str, Array]]
) -> dict[str, Array]:
    """Return standard deviations (n,) of columns (n,) computed from a measured mirror.

    The smoothed curve is linear in the heights; therefore the effects of its independent deviations
    are computed one at a time and added in quadrature.
    """
    if not (isinstance(mirror, SampledProfile) and len(mirror.fit.deviations)):
        return {}
    nominal, *moved = (columns_of(m) for m in mirror.deviated(PERTURBATION))
    with np.errstate(invalid="ignore"):  # lengths per pixel of distant objects are infinite
        return {
            name: np.sqrt(sum((m[name] - nominal[name]) ** 2 for m in moved)) / PERTURBATION
            for name in nominal
        }


# -- Evaluation of a sensor ------------------------------------------------------------------------

MIN_STEP_DEG = 1e-5  # equivalent to about 1e7 field angles
COLUMNS = tuple(q.name for q in quantities.FIELD_QUANTITIES if q.name != "floored_area_deg2")
"""Columns of files, in order: ``omega_deg`` to ``blur_area_deg2``, then lengths per pixel."""
UNCERTAIN = (*COLUMNS, "floored_area_deg2")
"""Columns with a standard deviation."""

READ_COLUMNS = (
    "omega_deg",
    "x_mm",
    "theta_deg",
    "h_px",
    "dh_domega_px_per_deg",
    "width_px_per_deg",
    "aspect",
    "viewpoint_z_mm",
    "distance_t_mm",
    "distance_s_mm",
    "blur_t_px",
    "blur_s_px",
    "blur_t_deg",
    "blur_s_deg",
    "floored_area_deg2",
)
"""Columns of printed tables, in order; files contain all columns."""


@document_attributes(quantities.FIELD_QUANTITIES)
@dataclass(frozen=True)
class Evaluation(FieldResult):
    """Results of a sensor at n field angles; each column is an array (n,) named with its unit.

    Lengths are measured from the mirror vertex (``z``) and the axis (``x``), except ``distance_*``,
    which are measured from the reference point of the lens (its principal point; the vertex for an
    orthographic lens). With a second mirror, ``theta_deg``, ``distance_*`` and dependent quantities
    refer to the image formed by both mirrors; slope, radii and virtual images are those of the
    first mirror.
    """

    omega_deg: Array
    x_mm: Array
    z_mm: Array
    beta_deg: Array
    theta_deg: Array
    gamma_deg: Array
    h_px: Array
    dh_domega_px_per_deg: Array
    width_px_per_deg: Array
    area_px2: Array
    aspect: Array
    viewpoint_z_mm: Array
    radius_t_mm: Array
    radius_s_mm: Array
    q_t_mm: Array
    q_s_mm: Array
    image_t_x_mm: Array
    image_t_z_mm: Array
    image_s_x_mm: Array
    image_s_z_mm: Array
    distance_t_mm: Array
    distance_s_mm: Array
    blur_t_px: Array
    blur_s_px: Array
    blur_t_deg: Array
    blur_s_deg: Array
    blur_area_deg2: Array
    floored_area_deg2: Array
    plane_t_mm_per_px: Array
    cylinder_t_mm_per_px: Array
    object_s_mm_per_px: Array
    sensor: Sensor
    """Evaluated sensor, including its focus."""
    object_distance_mm: float | Array
    mode: BlurMode
    wavelength_nm: float
    image_radius_px: float | None
    tolerance_px: float

    def _table(self) -> Columns:
        return self.columns()

    def _fields(self) -> Fields:
        names = ("focus_mm", "mode", "wavelength_nm", "image_radius_px", "tolerance_px")
        attributes = {"sensor": self.sensor.name, **{name: getattr(self, name) for name in names}}
        result = column_fields(self.columns(), attributes)
        distance = np.asarray(self.object_distance_mm)
        dimension = ("omega_deg",) if distance.ndim else ()
        coordinates = {**result.coordinates, "object_distance_mm": (dimension, distance)}
        return result._replace(coordinates=coordinates)

    def __len__(self) -> int:
        return len(self.omega_deg)

    def __getitem__(self, which: slice | NDArray[np.integer] | NDArray[np.bool_]) -> Evaluation:
        """Return the evaluation at selected field angles.

        >>> from omnimirror.optics.sensor_files import load_sensor
        >>> evaluate(load_sensor("paper-spherical"), omega_deg=[0, 90, 135])[1:].omega_deg
        array([ 90., 135.])
        """
        p = self.object_distance_mm
        columns = {name: getattr(self, name)[which] for name in UNCERTAIN}
        return replace(
            self, object_distance_mm=p[which] if isinstance(p, np.ndarray) else p, **columns
        )

    @property
    def focus_mm(self) -> float:
        """Object distance L0 in focus."""
        return self.sensor.lens.focus_distance_mm

    @property
    def airy_px(self) -> float:
        """Diameter of the Airy disc, px."""
        return self.sensor.lens.airy_diameter(self.wavelength_nm) / self.sensor.imager.pitch_mm

    @property
    def length_mm(self) -> float:
        """Axial distance from the lens or vertex to the highest mirror point, mm."""
        (_, _), (_, top) = self.sensor.mirror.bounds
        m = self.sensor.mirror_distance_mm
        return top + (m if np.isfinite(m) else 0.0)

    @property
    def depth_of_field_mm(self) -> DepthOfField:
        """Depth of field for a blur of ``tolerance_px`` pixels (Eqs. 30, 31)."""
        return self.sensor.lens.depth_of_field(
            self.tolerance_px * self.sensor.imager.pitch_mm, self.mode
        )

    def columns(self) -> dict[str, Array]:
        """Return the columns of the table in fixed order, followed by those of a real lens."""
        return {name: getattr(self, name) for name in COLUMNS} | self.of_lens

    @property
    def of_lens(self) -> dict[str, Array]:
        """Columns of a real lens alone at each field angle, (n,), by the names of
        :data:`LENS_QUANTITIES`; otherwise empty.
        """
        lens, pitch = self.sensor.lens, self.sensor.imager.pitch_mm
        if not isinstance(lens, FieldLens):
            return {}
        tangent = np.tan(np.radians(self.theta_deg))
        t, s = lens.own_blur(lens.principal_distance * tangent)
        colour = lens.field.odd(tangent)
        values = (
            t / pitch,
            s / pitch,
            lens.field.at(tangent).illumination,
            (colour["short"] - colour["long"]) / pitch,
            lens.pupil.position(tangent),
        )
        return {
            q.name: column for q, column in zip(quantities.LENS_QUANTITIES, values, strict=True)
        }

    @validate_arguments
    def texts(self, names: Iterable[str] = READ_COLUMNS) -> dict[str, list[str]]:
        """Return the named columns as formatted text, one list of cells each."""
        names, of_lens = list(names), self.of_lens
        for name in names:
            choice("names", name, (*UNCERTAIN, *of_lens))
        values = {name: of_lens[name] if name in of_lens else getattr(self, name) for name in names}
        return {name: [QUANTITIES[name].text(v) for v in column] for name, column in values.items()}

    def summary(self) -> dict[str, Any]:
        """Return scalar results and settings: focus, depth of field, diffraction and methods."""
        near, far = self.depth_of_field_mm
        values: dict[str, Any] = {
            "sensor": self.sensor.name,
            "field_deg": list(self.sensor.field_deg),
            "rim_radius_px": self.sensor.rim_radius_px,
            "focus_mm": self.focus_mm,
            "object_distance_mm": np.asarray(self.object_distance_mm).tolist(),
            "blur_mode": self.mode,
            "depth_of_field_near_mm": near,
            "depth_of_field_far_mm": far,
            "depth_of_field_tolerance_px": self.tolerance_px,
            "wavelength_nm": self.wavelength_nm,
            "airy_px": self.airy_px,
            "image_radius_px": self.image_radius_px,
        }
        if isinstance(self.sensor.lens, GaussianLens):
            values["hyperfocal_mm"] = self.sensor.lens.hyperfocal_distance(
                self.tolerance_px * self.sensor.imager.pitch_mm
            )
        if self.sensor.housing != NO_HOUSING:
            values["obscurations"] = [ring._asdict() for ring in self.sensor.obscurations]
            values["clear_field_deg"] = list(self.sensor.clear_field_deg)
        return values

    def standard_deviations(self) -> dict[str, Array]:
        """Return the standard deviation of each column, (n,), due to the scatter of a measured
        profile; otherwise empty.

        One standard deviation, to first order; :attr:`SampledProfile.fit` contains the scatter of
        the points.
        """
        return standard_deviations(self.sensor.mirror, partial(_columns_of_mirror, self))

    @validate_arguments
    def to_csv(self, path: str | Path, deviations: bool = False) -> None:
        """Write the table as CSV with 17 significant digits, exact for double precision.

        With ``deviations``, each column affected by a measured profile is followed by its standard
        deviation, ``..._sd``.
        """
        columns = self.columns()
        if deviations:
            columns |= {f"{k}_sd": v for k, v in self.standard_deviations().items() if k in columns}
        write_columns(path, columns)

    def to_json(self, path: str | Path) -> None:
        """Write summary and columns as JSON; non-finite numbers become "inf", "-inf" and "nan"."""
        data = {
            "summary": self.summary(),
            "columns": {k: v.tolist() for k, v in self.columns().items()},
        }
        if deviations := self.standard_deviations():
            data["standard_deviations"] = {k: v.tolist() for k, v in deviations.items()}
        write_text(path, json.dumps(_finite(data), indent=1) + "\n")


def evaluate(
    sensor: Sensor,
    omega_deg: ArrayLike | None = None,
    *,
    x_mm: ArrayLike | None = None,
    h_px: ArrayLike | None = None,
    pixels: ArrayLike | None = None,
    object_distance_mm: ArrayLike = np.inf,
    focus_mm: float | Literal["auto"] | None = None,
    merit: str = "worst_floored_area_deg2",
    mode: BlurMode = "exact",
    wavelength_nm: float = 550.0,
    image_radius_px: float | None = None,
    tolerance_px: float = 1.0,
) -> Evaluation:
    """Evaluate a sensor at field angles, mirror points, image heights or pixels.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    omega_deg : (n,), optional
        Field angles; by default every 5 deg of the field.
    x_mm, h_px, pixels : (n,), (n,), (n, 2), optional
        Alternatives to field angles: distances of the mirror points from the axis, image heights,
        or pixels (u, v).
    object_distance_mm : scalar or (n,)
        Distance p from the reflection point to the object along the optical path. Resolution and
        angular blur refer to objects at this distance: one degree is the length p pi/180
        perpendicular to the ray.
    focus_mm
        Object distance L0 in focus; by default that of the sensor, for ``"auto"`` the optimum of
        ``merit``.
    merit
        Merit minimised by ``"auto"`` focus, one of the focus merits of
        :mod:`omnimirror.base.quantities`.
    mode
        ``"exact"`` blur (Eq. 28), or ``"paper"`` (Eq. 29).
    wavelength_nm
        Wavelength of the Airy disc.
    image_radius_px
        Radius of the rim image to which the image is scaled, including ``h_px``, ``pixels`` and the
        results; by default the real radius, from lens and pixel pitch.
    tolerance_px
        Permissible blur of the depth of field.

    Returns
    -------
    Evaluation
        Columns (n,), one for each quantity of the paper, and common values.

    Raises
    ------
    OutsideField, OutsideMirror
        If an angle, pixel or mirror point is outside the field or the mirror; the message contains its
        value.
    NotOneToOne, SelfObstruction
        If the mirror cannot be used.
    InvalidParameter
        If another argument is invalid.

    Examples
    --------
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> result = evaluate(load_sensor("paper-spherical"), omega_deg=[0, 90, 135])
    >>> result.viewpoint_z_mm.round(3)
    array([ 21.941,  11.82 , -17.784])
    """
    check_sensor(sensor)
    choices = {"omega_deg": omega_deg, "x_mm": x_mm, "h_px": h_px, "pixels": pixels}
    specified = {k: v for k, v in choices.items() if v is not None}
    if len(specified) > 1:
        raise InvalidParameter(f"{' and '.join(specified)} must not be given together; remove one")
    choice("mode", mode, BLUR_MODES)
    tolerance_px = number("tolerance_px", tolerance_px, above=0.0, unit="px")
    if image_radius_px is not None:
        image_radius_px = image_radius(image_radius_px)
    if isinstance(focus_mm, str) and focus_mm == "auto":
        distance = _scalar_distance(object_distance_mm)
        focus_mm = best_focus(
            sensor,
            merit,
            omega_deg=None,
            object_distance_mm=distance,
            mode=mode,
            image_radius_px=image_radius_px,
            wavelength_nm=wavelength_nm,
        ).focus_mm
    if focus_mm is not None:
        sensor = replace(sensor, lens=sensor.lens.focused_at(number("focus_mm", focus_mm)))
    field_angles_deg, x = _mirror_points(sensor, specified, image_radius_px)
    rays, p = sensor.meridian.trace(x), distance_per_angle(object_distance_mm, x)
    study = FocusStudy(sensor, rays, virtual_images(rays, p), mode, image_radius_px, wavelength_nm)
    columns = _columns(study)
    if field_angles_deg is not None:  # preserve the given values exactly
        columns["omega_deg"] = field_angles_deg
    return Evaluation(
        **columns,
        sensor=sensor,
        object_distance_mm=float(p) if p.ndim == 0 else p,
        mode=mode,
        wavelength_nm=wavelength_nm,
        image_radius_px=image_radius_px,
        tolerance_px=tolerance_px,
    )


def _columns(study: FocusStudy) -> dict[str, Array]:
    """Return all columns of an evaluation, (n,)."""
    rays, images, blur = study.rays, study.images, study.at(study.sensor.lens.focus_distance_mm)
    L_t, L_s = study.distances
    return {
        "omega_deg": np.degrees(rays.omega),
        "x_mm": rays.x,
        "z_mm": rays.z,
        "beta_deg": np.degrees(rays.beta),
        "theta_deg": np.degrees(rays.first.theta),
        "gamma_deg": np.degrees(rays.gamma),
        "h_px": study.heights(study.sensor)[0],
        "dh_domega_px_per_deg": blur.imaging.height,
        "width_px_per_deg": blur.imaging.width,
        "area_px2": blur.imaging.area,
        "aspect": blur.imaging.aspect,
        "viewpoint_z_mm": viewpoint_z(rays),
        "radius_t_mm": rays.radius_t(),
        "radius_s_mm": rays.radius_s(),
        "q_t_mm": images.q_t,
        "q_s_mm": images.q_s,
        "image_t_x_mm": images.x_t,
        "image_t_z_mm": images.z_t,
        "image_s_x_mm": images.x_s,
        "image_s_z_mm": images.z_s,
        "distance_t_mm": L_t,
        "distance_s_mm": L_s,
        "blur_t_px": blur.t_px,
        "blur_s_px": blur.s_px,
        "blur_t_deg": blur.t_deg,
        "blur_s_deg": blur.s_deg,
        "blur_area_deg2": blur.product(),
        "floored_area_deg2": blur.floored_area(),
        **object_sizes(blur.imaging.height, blur.imaging.width, rays.omega, images.object_distance),
    }


PARALLEL = 1e-12
"""Cosine limit of an edge-on plane, with infinite lengths per pixel."""


def object_sizes(dh: Array, dw: Array, omega: Array, object_distance_mm: Array) -> dict[str, Array]:
    """Return the lengths (n,), mm per pixel, on a plane and a cylinder at an object distance.

    Parameters
    ----------
    dh, dw : (n,)
        Resolution at that distance, px per degree.
    omega : (n,)
        Field angles, radians.
    object_distance_mm : () or (n,)
        Distance from the mirror points; all sizes are infinite for infinite distances.

    Examples
    --------
    >>> object_sizes(np.array([5.0]), np.array([4.0]), np.array([np.pi / 2]), np.array(100.0))["object_s_mm_per_px"]
    array([0.43633231])
    """
    across = np.asarray(object_distance_mm) * (np.pi / 180)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # One degree is p pi/180 perpendicular to the ray; on a plane or a cylinder, inclined to it
        # by Omega, the tangential length is larger by 1/cos(Omega) or 1/sin(Omega).
        t = across / dh
        cosine = np.abs(np.cos(omega))
        return {
            "plane_t_mm_per_px": np.where(cosine < PARALLEL, np.inf, t / cosine),
            "cylinder_t_mm_per_px": t / np.sin(omega),
            "object_s_mm_per_px": across / dw,
        }


def _columns_of_mirror(result: Evaluation, mirror: Mirror) -> dict[str, Array]:
    """Return the columns of an evaluation, (n,), with another mirror; NaN outside its field."""
    sensor = replace(result.sensor, mirror=mirror)
    in_field = sensor.meridian.is_in_field(np.radians(result.omega_deg))
    p, radius = np.asarray(result.object_distance_mm), result.image_radius_px
    evaluation = evaluate(
        sensor,
        result.omega_deg[in_field],
        object_distance_mm=p[in_field] if p.size > 1 else p,
        mode=result.mode,
        wavelength_nm=result.wavelength_nm,
        image_radius_px=None
        if radius is None
        else radius * sensor.rim_radius_px / result.sensor.rim_radius_px,
    )
    columns = {name: np.full(len(result), np.nan) for name in UNCERTAIN}
    for name, column in columns.items():
        column[in_field] = getattr(evaluation, name)
    return columns


@validate_arguments
def field_angles(sensor: Sensor, step_deg: float = 5.0) -> Array:
    """Return the multiples of ``step_deg`` in the field, (n,) deg, or its ends if there are none.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    step_deg
        Step of the field angles, deg.

    Returns
    -------
    (n,) array
        deg

    Raises
    ------
    InvalidParameter
        If the step is below :data:`MIN_STEP_DEG`.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.field_angles(om.load_sensor("paper-spherical"), 45.0)
    array([  0.,  45.,  90., 135.])
    """
    number("step_deg", step_deg, low=MIN_STEP_DEG, unit="deg")
    low, high = sensor.field_deg
    angles = (
        step_deg * np.arange(np.ceil(low / step_deg - 1e-9), np.floor(high / step_deg + 1e-9) + 1)
        + 0.0
    )  # no -0
    return angles if angles.size else np.array([low, high])


def _mirror_points(
    sensor: Sensor, specified: dict[str, ArrayLike], image_radius_px: float | None
) -> tuple[Array | None, Array]:
    """Return the given field angles, or None, and the mirror points, (n,) mm.

    Heights and pixels refer to the image scaled to ``image_radius_px``.
    """
    kind, values = next(iter(specified.items()), ("omega_deg", field_angles(sensor)))
    if kind == "omega_deg":
        omega = numbers(kind, values).ravel()
        return omega, sensor.meridian.x_from_omega(np.radians(omega))
    if kind == "x_mm":
        return None, numbers(kind, values).ravel()
    scale = 1.0 if image_radius_px is None else image_radius_px / sensor.rim_radius_px
    if kind == "h_px":
        return None, sensor.x_from_height_px(numbers(kind, values).ravel() / scale)
    pixels = np.atleast_1d(numbers(kind, values))
    if pixels.shape[-1] != 2:
        raise InvalidParameter(f"pixels must be pairs (u, v) of shape (n, 2); got {pixels.shape}")
    unscaled = sensor.imager.centre + (pixels.reshape(-1, 2) - sensor.imager.centre) / scale
    return None, sensor.x_from_height_px(sensor.radius_from_centre_px(unscaled))


def _scalar_distance(distance: ArrayLike) -> float:
    p = np.unique(np.asarray(distance, dtype=float))
    if p.size != 1:
        raise InvalidParameter(
            "focus 'auto' requires one object_distance_mm for all field angles; got several"
        )
    return float(p[0])


def _finite(value: Any) -> Any:
    """Convert numbers without a JSON representation to strings."""
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list):
        return [_finite(v) for v in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value
