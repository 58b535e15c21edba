"""Initial mirror sensor from a central model: the shape with the same projection of distant points."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.numerics import damped_step, levenberg_marquardt
from ..base.typing import Array
from ..cameras.camera import inside_image
from ..cameras.models.camera_model import CameraModel
from ..optics.image_sensor import Imager
from ..optics.lenses import Perspective
from ..optics.mirrors import ConicAsphere, SlopeSpline
from ..optics.sensor import Sensor
from ..optics.tracing.meridian import trace_chief_rays
from .sensor_parameters import (
    ParameterLocation,
    ParameterPrior,
    parameter_location,
    profile_derivatives,
    shape_names,
    value_of,
    with_values,
)

Item = TypeVar("Item")
Model = TypeVar("Model", bound=CameraModel)

RINGS, SPOKES = 60, 16
MIN_VISIBLE_FRACTION = 0.5  # minimum visible fraction of a ring with a mean radius
QUADRATURE = 2001
MAX_STEPS = 30
RELATIVE_TOLERANCE = 1e-9
RIM_TO_DISTANCE = 4.0
"""Typical distance of a mirror in rim radii (most products: 3 to 5)."""
DISTANCES = (3.0, 3.5, 4.0, 4.5, 5.0)
SIZES_MM = (4.0, 1000.0)  # rim radii of mirrors
MAX_RESIDUAL_MOTION = 0.9  # maximum residual viewpoint motion, relative to the motion itself


class MeridionalProjection(NamedTuple):
    """Mean radial projection of a central model."""

    centre_px: tuple[float, float]
    omega: Array
    """Field angles (k,), radians, increasing."""
    radius_px: Array
    """Radii (k,), px."""


def radial_projection(central: CameraModel, omega_max_deg: float) -> MeridionalProjection:
    """Return the centre and the mean radius of each field angle with a mostly visible ring.

    Raises
    ------
    InvalidParameter
        If the model has no such ring.
    """
    directions, omega = ring_directions(central, omega_max_deg)
    image = central.image(directions, distant=True)
    visible = image.valid.copy()
    visible[visible] = inside_image(image.pixels[visible], central.image_size)
    rings = np.where(visible[:, None], image.pixels, np.nan).reshape(RINGS, SPOKES, 2)
    is_complete = np.asarray(visible.reshape(RINGS, SPOKES).all(axis=1))
    if not is_complete[:2].all():
        raise InvalidParameter(
            "central must project all directions next to its axis; use another initial model"
        )
    u, v = rings[:2].mean(axis=(0, 1))
    fractions = visible.reshape(RINGS, SPOKES).mean(axis=1)
    retained = np.logical_and.accumulate(fractions >= MIN_VISIBLE_FRACTION)
    radius = np.nanmean(np.hypot(rings[retained, :, 0] - u, rings[retained, :, 1] - v), axis=1)
    increases = np.concatenate([[True], np.diff(radius) > 0])
    increasing = np.logical_and.accumulate(increases)
    return MeridionalProjection(
        (float(u), float(v)), omega[retained][increasing], radius[increasing]
    )


def ring_directions(central: CameraModel, omega_max_deg: float) -> tuple[Array, Array]:
    """Return directions (n, 3) on rings about the axis, and ring angles (k,) in radians."""
    omega = np.radians(np.linspace(1.0, omega_max_deg, RINGS))
    phi = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)
    forward = -1.0 if central.optics == "mirror" else 1.0
    o, p = (a.ravel() for a in np.meshgrid(omega, phi, indexing="ij"))
    return np.stack(
        [np.sin(o) * np.cos(p), np.sin(o) * np.sin(p), forward * np.cos(o)], axis=-1
    ), omega


def unknown_sensor(
    central: CameraModel, projection: MeridionalProjection, rim_radius_mm: float, distance_mm: float
) -> Sensor:
    """Return a sensor with an unknown mirror of given size and distance for a central model.

    The focal length follows from the radius of the field in the image.
    """
    distance, pitch_um = distance_mm, 5.0
    depth = distance + 0.3 * rim_radius_mm  # to the rim, for most mirrors
    b0 = projection.radius_px[-1] * pitch_um * 1e-3 * depth / rim_radius_mm
    width, height = central.image_size
    mount = central.mount
    u = width - 1 - projection.centre_px[0] if mount.image_flipped else projection.centre_px[0]
    return Sensor(
        ConicAsphere(rim_radius_mm, -1.0, rim_radius_mm, (0.0,) * 4, rim_radius_mm),
        Perspective(1 / (1 / b0 + 1 / distance), 8.0, distance),
        Imager(width, height, pitch_um, (u, projection.centre_px[1])),
        mount,
        distance,
        name="calibrated",
    )


def estimate_mirror_size(
    central: CameraModel, omega_max_deg: float, omega: Array, viewpoint_mm: Array
) -> tuple[float, float] | None:
    """Estimate rim radius and distance (mm) of an unknown mirror from the motion of its viewpoint.

    For each distance in rim radii, one mirror shape reproduces the projection of a central model;
    the motion of its viewpoint along the axis is proportional to its size. This motion is the only
    information on size and distance in images. None if the measured motion fits no such mirror, for
    example if it is negligible.

    Parameters
    ----------
    central
        Model with a single viewpoint.
    omega_max_deg
        Maximum field angle of its observations.
    omega, viewpoint_mm : (n,)
        Field angles (radians), and intersections of their rays with the axis along Z of the camera
        frame, with an arbitrary origin.
    """
    projection = radial_projection(central, omega_max_deg)
    measured = viewpoint_mm - viewpoint_mm.mean()
    guesses = []
    for distance in DISTANCES:
        sensor = with_prescribed_projection(
            projection, unknown_sensor(central, projection, 1.0, distance), rim_is_known=False
        )
        x = np.linspace(0.02, 1.0, RINGS) * sensor.mirror.rim_radius_mm
        rays = sensor.meridian.trace(x)
        predicted = np.interp(omega, rays.omega, rays.z + rays.viewpoint_offset())
        predicted -= predicted.mean()
        # least-squares scale of the predicted viewpoint motion: <p, m> / <p, p>
        size = float(predicted @ measured / max(predicted @ predicted, 1e-12))
        guesses.append((float(np.sum((measured - size * predicted) ** 2)), size, distance * size))
    residual, size, distance_mm = min(guesses)
    is_known = SIZES_MM[0] < size < SIZES_MM[1] and residual < MAX_RESIDUAL_MOTION**2 * float(
        measured @ measured
    )
    return (size, distance_mm) if is_known else None


def with_prescribed_projection(
    projection: MeridionalProjection, sensor: Sensor, rim_is_known: bool
) -> Sensor:
    """Return the sensor with the mirror shape that projects distant points as prescribed.

    An unknown rim is placed at the end of the prescribed projection.

    Raises
    ------
    InvalidParameter
        If no mirror of its kind is suitable.
    """
    x, slope = _prescribed_slopes(projection, sensor)
    mirror = sensor.mirror
    if rim_is_known:
        x, slope = x[x <= mirror.rim_radius_mm], slope[x <= mirror.rim_radius_mm]
    else:
        mirror = replace(mirror, rim_radius_mm=float(x[-1]))  # type: ignore[type-var]  # every mirror is a dataclass
    if isinstance(mirror, SlopeSpline):
        at = np.linspace(0.0, mirror.rim_radius_mm, len(mirror.slopes))
        return replace(
            sensor, mirror=SlopeSpline((0.0, *np.interp(at[1:], x, slope)), mirror.rim_radius_mm)
        )
    locations = tuple(parameter_location(sensor, name) for name in shape_names(sensor))
    initial = replace(sensor, mirror=mirror)
    return replace(initial, mirror=_fitted_slopes(initial, locations, x, slope).mirror)


def without_fold(sensor: Sensor) -> Sensor:
    """Return the sensor with a rim that excludes decreasing field angles beyond the measured field.

    Only polynomial mirrors are changed.
    """
    mirror = sensor.mirror
    if not isinstance(mirror, ConicAsphere):
        return sensor
    distance = sensor.mirror_pose.displacement_mm - sensor.pupil_offset[2]
    x = np.linspace(0.0, mirror.rim_radius_mm, QUADRATURE)[1:]
    decreasing = np.flatnonzero(trace_chief_rays(mirror, distance, x).domega_dx() <= 0)
    if not len(decreasing) or decreasing[0] < 2:
        return sensor
    return replace(sensor, mirror=replace(mirror, rim_radius_mm=float(x[decreasing[0] - 1])))


def _prescribed_slopes(projection: MeridionalProjection, sensor: Sensor) -> tuple[Array, Array]:
    """Return distances from the axis (n,) mm and slopes (n,) of the mirror for a radial projection."""
    height = sensor.lens.undistorted_height(projection.radius_px * sensor.imager.pitch_mm)
    height, angles = np.concatenate([[0.0], height]), np.concatenate([[0.0], projection.omega])
    if not isinstance(sensor.lens, Perspective):
        x = height / float(sensor.lens.ideal_height(np.ones(1), np.full(1, np.inf))[0])
        # parallel rays: the normal bisects them, so the slope is tan(Omega / 2)
        return x, np.tan(angles / 2)
    theta = np.arctan(height / sensor.lens.principal_distance)
    at = np.linspace(0.0, theta[-1], QUADRATURE)
    omega = np.interp(at, theta, angles)
    rate = np.tan((omega + at) / 2)
    # law of reflection along the meridian, rho the distance from the pupil:
    # d(ln rho) / d(theta) = tan((Omega + theta) / 2), integrated by the trapezoidal rule
    log_rho = np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(at))])
    x = -sensor.pupil_offset[2] * np.exp(log_rho) * np.sin(at)
    return x, np.tan((omega - at) / 2)


def _fitted_slopes(
    sensor: Sensor, locations: tuple[ParameterLocation, ...], x: Array, slope: Array
) -> Sensor:
    """Return the sensor whose mirror has slopes (n,) at x (n,), by damped least squares."""

    inside = np.minimum(x, sensor.mirror.rim_radius_mm)

    def evaluate(values: Array) -> _Candidate[Sensor] | None:
        try:
            trial = with_values(sensor, locations, values)
        except OmnimirrorError:
            return None
        trial_slope = trial.mirror.slope(inside)
        derivatives = profile_derivatives(trial.mirror, inside, locations)[1]
        return _Candidate(
            trial,
            values,
            np.arctan(trial_slope) - np.arctan(slope),
            derivatives / (1 + trial_slope**2)[:, None],
        )

    start = evaluate(np.array([value_of(sensor, location) for location in locations]))
    if start is None:
        raise InvalidParameter(
            f"the initial mirror must allow a radius of {x[-1]:.4g} mm; got {sensor.mirror.KIND}; use another mirror"
        )
    return _least_squares(evaluate, start)


def fit_to_central_model(
    model: Model, central: CameraModel, priors: tuple[ParameterPrior, ...], omega_max_deg: float
) -> Model:
    """Fit the free parameters to the projection of distant points by a central model, with priors."""
    directions = ring_directions(central, omega_max_deg)[0]
    target = central.image(directions, distant=True)
    visible = target.valid.copy()
    visible[visible] = inside_image(target.pixels[visible], central.image_size)
    directions, pixels = directions[visible], target.pixels[visible]
    names = [p.name for p in model.parameters]
    rows = np.zeros((len(priors), len(names)))
    for i, prior in enumerate(priors):
        rows[i, names.index(prior.name)] = 1 / prior.sigma
    means = np.array([p.value for p in priors])[:, None] * rows

    def evaluate(values: Array) -> _Candidate[Model] | None:
        try:
            candidate = model.with_parameters(values)
        except OmnimirrorError:
            return None
        image = candidate.image(directions, distant=True)
        residuals, derivatives = image.pixels - pixels, image.d_parameters
        weight = np.where(image.valid, 1 / np.sqrt(1 + np.nansum(residuals**2, axis=1)), 0.0)[
            :, None
        ]  # robust
        residuals, derivatives = (
            np.where(image.valid[:, None], residuals, 0.0),
            np.where(image.valid[:, None, None], derivatives, 0.0),
        )
        return _Candidate(
            candidate,
            values,
            np.concatenate([(weight * residuals).ravel(), rows @ values - means.sum(axis=1)]),
            np.concatenate([(weight[:, :, None] * derivatives).reshape(-1, len(names)), rows]),
        )

    start = evaluate(np.array([p.value for p in model.parameters]))
    assert start is not None
    return _least_squares(evaluate, start)


class _Candidate(NamedTuple, Generic[Item]):
    """Sensor or model with residuals (n,) and their derivatives (n, q) with respect to its values
    (q,).
    """

    item: Item
    values: Array
    residuals: Array
    derivatives: Array

    @property
    def cost(self) -> float:
        """Sum of squares."""
        return float(self.residuals @ self.residuals)


def _least_squares(
    evaluate: Callable[[Array], _Candidate[Item] | None], start: _Candidate[Item]
) -> Item:
    """Return the sensor or model with the minimum sum of squares."""

    def linearise(current: _Candidate[Item]) -> Callable[[float], _Candidate[Item] | None]:
        normal = current.derivatives.T @ current.derivatives
        gradient = current.derivatives.T @ current.residuals
        return lambda damping: evaluate(current.values + damped_step(normal, gradient, damping))

    return levenberg_marquardt(start, linearise, MAX_STEPS, RELATIVE_TOLERANCE).item
