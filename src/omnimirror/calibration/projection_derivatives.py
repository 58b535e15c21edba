"""Projection of points by a mirror sensor, with derivatives with respect to points and all its
parameters.

The chain is: mirror shape, reflection, tube or dome, lens and imager.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..base.errors import OmnimirrorError
from ..base.typing import Array, Mask
from ..cameras.camera import rotate_vectors
from ..cameras.models.camera_model import PointImages
from ..optics.housing import Housing
from ..optics.lenses import Perspective
from ..optics.lenses.lens import TERMS, distorted_rates
from ..optics.mirrors import ConicAsphere, EvenPolynomial, Mirror, SlopeSpline
from ..optics.mirrors.mirror import Conic, MirrorPose
from ..optics.mirrors.splines import spline_of_slopes
from ..optics.sensor import Sensor
from ..optics.tracing.optical_train import CoveredMirror
from ..optics.tracing.reflection import (
    MirrorSurface,
    RayEndpoints,
    ReflectionPoints,
    specular_points,
)
from .sensor_parameters import DISTANCE, ParameterLocation

if TYPE_CHECKING:
    from scipy.interpolate import BSpline


# -- Mirror profile --------------------------------------------------------------------------------
#
# The formulas of conics and polynomials are analytic: complex-step differentiation is exact
# (Squire and Trapp, 1998). A spline of slopes is linear in its parameters. Other mirrors, generated
# or sampled, use finite differences.

ANALYTIC = (Conic, EvenPolynomial, ConicAsphere)
"""Mirrors whose profile is an analytic function of their parameters and accepts complex values."""
COMPLEX_STEP = 1e-30
DIFFERENCE_STEP = 1e-5
"""Step of finite differences, relative to the parameter or to 1 if larger."""


def profile_derivatives(
    mirror: Mirror, x: Array, locations: tuple[ParameterLocation, ...]
) -> Array:
    """Return derivatives (3, n, k) of sag, slope and curvature at x (n,) by k mirror parameters.

    Beyond the rim, they are those of the parabola that continues it
    (:func:`omnimirror.optics.tracing.reflection.continued_profile`).

    >>> from omnimirror.optics.mirrors import Sphere
    >>> radius = ParameterLocation("mirror", "radius_mm")
    >>> profile_derivatives(Sphere(50.0, 40.0), np.array([30.0]), (radius,))[0].round(9)  # 1 - 50 / 40
    array([[-0.25]])
    """
    derivatives = np.empty((3, len(x), len(locations)))
    inside = np.minimum(x, mirror.rim_radius_mm)
    if isinstance(mirror, SlopeSpline):
        derivatives[:] = _slope_derivatives(mirror, inside)[
            :, :, [location.item or 0 for location in locations]
        ]
    else:
        for column, location in enumerate(locations):
            derivatives[:, :, column] = _parameter_derivatives(mirror, inside, location)
    excess = (x - inside)[:, None]
    if excess.any():
        curvature = mirror.curvature(inside)[:, None]
        curvature_rate = np.where((excess > 0) & (curvature < 0), 0.0, derivatives[2])
        sag, slope = derivatives[0], derivatives[1]
        derivatives = np.stack(
            [
                sag + slope * excess + curvature_rate * excess**2 / 2,
                slope + curvature_rate * excess,
                curvature_rate,
            ]
        )
    return derivatives


def _parameter_derivatives(mirror: Mirror, x: Array, location: ParameterLocation) -> Array:
    """Return derivatives (3, n) with respect to one parameter."""
    if isinstance(mirror, ANALYTIC):
        perturbed = _with_complex_parameter(
            mirror, location, location.of(mirror) + 1j * COMPLEX_STEP
        )
        return np.imag(np.stack([np.asarray(a) for a in perturbed.profile(x)])) / COMPLEX_STEP
    value = location.of(mirror)
    step = DIFFERENCE_STEP * max(abs(value), 1.0)
    samples = []
    for sign in (1.0, -1.0):
        try:
            perturbed_mirror: Mirror = replace(
                mirror, **location.change(mirror, value + sign * step)
            )  # type: ignore[type-var]
            samples.append((sign, np.stack(perturbed_mirror.profile(x))))
        except OmnimirrorError:  # at the limit of its range: one-sided difference
            samples.append((0.0, np.stack(mirror.profile(x))))
    (after, high), (before, low) = samples
    derivatives: Array = (high - low) / ((after - before) * step)
    return derivatives


def _slope_derivatives(mirror: SlopeSpline, x: Array) -> Array:
    """Return derivatives (3, n, m) with respect to all m slopes, in which the profile is linear."""
    splines = _unit_splines(len(mirror.slopes), mirror.is_pointed)
    u, rim = x / mirror.rim_radius_mm, mirror.rim_radius_mm
    sag, slope, bend = (np.asarray(spline(u)) for spline in splines)
    derivatives: Array = np.stack([(sag - splines[0](0.0)) * rim, slope, bend / rim])
    return derivatives


@lru_cache(maxsize=8)
def _unit_splines(count: int, pointed: bool) -> tuple[BSpline, BSpline, BSpline]:
    """Return integral, value and derivative of the splines with one slope 1 and the others 0."""
    unit = np.eye(count)
    if not pointed:
        unit[0] = 0.0
    slope = spline_of_slopes(unit)
    return slope.antiderivative(), slope, slope.derivative()


def _with_complex_parameter(mirror: Mirror, location: ParameterLocation, value: complex) -> Mirror:
    """Return the mirror with a complex parameter, bypassing the checks of its constructor."""
    perturbed: Mirror = object.__new__(type(mirror))
    perturbed.__dict__.update(mirror.__getstate__() | location.change(mirror, value))
    return perturbed


# -- Lens and imager -------------------------------------------------------------------------------


def lens_image(
    sensor: Sensor, points: Array, locations: tuple[ParameterLocation, ...]
) -> tuple[Array, Mask, Array, Array]:
    """Return pixels (n, 2) of points (n, 3) mm in the camera frame, validity and derivatives.

    Returns
    -------
    tuple
        Pixels (n, 2); valid (n,); derivatives (n, 2, 3) in px per mm of the points; derivatives (n,
        2, k) in px per unit of k parameters of lens, imager and distance, for fixed points.
    """
    by_key: dict[str, Array]
    if isinstance(sensor.lens, Perspective):
        image, valid, by_point, by_key = _perspective(sensor, sensor.lens, points)
    else:
        image, valid, by_point, by_key = _telecentric(sensor, points)
    pitch, flip = (
        sensor.imager.pitch_mm,
        np.array([-1.0 if sensor.mount.image_flipped else 1.0, 1.0]),
    )
    offsets = image / pitch
    by_key["pixel_pitch_um"] = -image / sensor.imager.pixel_pitch_um
    by_key["centre_px"] = np.full_like(image, pitch)
    by_location = np.zeros((*image.shape, len(locations)))
    for k, location in enumerate(locations):
        if location.section in ("lens", "imager") or location.name == DISTANCE:
            rows = slice(None) if location.item is None else location.item
            by_location[:, rows, k] = by_key[location.key][:, rows] / pitch
    u, v = sensor.imager.centre
    start = np.array([sensor.imager.width_px - 1 - u if flip[0] < 0 else u, v])
    return (
        start + flip * offsets,
        valid,
        by_point / pitch * flip[:, None],
        by_location * flip[:, None],
    )


def _perspective(
    sensor: Sensor, lens: Perspective, points: Array
) -> tuple[Array, Mask, Array, dict[str, Array]]:
    """Return image points (n, 2) mm, and their derivatives with respect to points and parameters.

    Shapes of the derivatives are (n, 2, 3) and (n, 2).
    """
    c, brown = lens.principal_distance, lens.brown
    depth = points[:, 2] - sensor.optical_train.pupil_offset[2]
    tangent = points[:, :2] / depth[:, None]
    distorted, by_tangent, by_term = distorted_rates(tangent, brown)
    lateral = np.zeros((len(tangent), 2, 3))
    lateral[:, 0, 0] = lateral[:, 1, 1] = 1 / depth
    lateral[:, :, 2] = -tangent / depth[:, None]
    by_point = c * by_tangent @ lateral
    L0, f = lens.focus_distance_mm, lens.focal_length_mm
    by_focal = distorted * (lens.from_pupil * L0 / (L0 - f) ** 2)
    by_key = {"focal_length_mm": by_focal, "mirror_distance_mm": by_point[:, :, 2]}
    by_key |= {name: c * by_term[:, :, i] for i, name in enumerate(TERMS)}
    valid = np.asarray(np.isfinite(distorted).all(axis=1) & (depth > 0))
    return c * distorted, valid, by_point, by_key


def _telecentric(sensor: Sensor, points: Array) -> tuple[Array, Mask, Array, dict[str, Array]]:
    """Return the same for a telecentric lens."""
    mu = float(sensor.lens.ideal_height(np.ones(1), np.full(1, np.inf))[0])
    by_point = np.zeros((len(points), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = mu
    image = mu * points[:, :2]
    return (
        image,
        np.asarray(np.isfinite(image).all(axis=1)),
        by_point,
        {"magnification": points[:, :2].copy()},
    )


# -- Reflection ------------------------------------------------------------------------------------
#
# Light follows a path of stationary length from a point via the mirror to the lens (Fermat). The
# mirror point satisfies two equations ``g(x, y) = 0``, where g is the gradient of the path length.
# By the implicit function theorem its derivatives are ``-H^-1 dg``, with the second derivatives H
# of the length, for all quantities that g depends on: both ends of the path, and the shape of the
# surface. The remainder is the chain rule through pose, lens and imager.

RIM_EXTENSION = 1.25
"""Extension of the mirror surface beyond the rim, relative to the rim radius.

It retains points in estimates whose mirror is slightly too small.
"""
IDENTITY = np.eye(3)


class OpticalPath(NamedTuple):
    """Optical paths from n targets via the mirror to the lens, in the mirror frame.

    The gradient of the length has two components, with respect to x and y of the mirror point.
    """

    surface: MirrorSurface
    tangents: Array
    """Tangents (n, 2, 3) of the surface along x and y."""
    pull: Array
    """Sum (n, 3) of the unit vectors from both ends; its tangential components are the gradient."""
    by_pupil: Array
    """Derivative (n, 2, 3) of the gradient with respect to the pupil."""
    by_target: Array
    """Derivative (n, 2, 3) of the gradient with respect to the target."""
    by_point: Array
    """Derivative (n, 2, 3) of the gradient with respect to the mirror point at a constant normal.
    """

    def response(self) -> Array:
        """Return derivatives (n, 2, 2) of the mirror points with respect to the gradient."""
        second = (
            self.by_point @ self.tangents.transpose(0, 2, 1)
            + self.pull[:, 2, None, None] * self.surface.bend
        )
        a, b, c = second[:, 0, 0], second[:, 0, 1], second[:, 1, 1]
        inverse = np.stack([np.stack([c, -b], axis=-1), np.stack([-b, a], axis=-1)], axis=1)
        derivatives: Array = -inverse / (a * c - b * b)[:, None, None]
        return derivatives


def image_of_points(
    sensor: Sensor, points: Array, distant: bool, locations: tuple[ParameterLocation, ...]
) -> PointImages:
    """Compute the image of points (n, 3) mm, or directions, with derivatives with respect to k
    parameters.

    Parameters
    ----------
    sensor
        Sensor with one mirror.
    points : (n, 3)
        Points in the camera frame, whose origin is the nominal vertex.
    distant
        Whether the points are directions.
    locations
        Parameters of the derivatives.
    """
    pose = sensor.mirror_pose
    rotation = pose.rotation()
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        pupils, targets = _path_endpoints(sensor, pose, points, distant)
        reflection = specular_points(sensor.mirror, pupils, targets)
        path = _optical_path(sensor, pupils, targets, reflection, points if distant else None)
        pixels, valid, by_camera_point, by_location = lens_image(
            sensor, pose.to_camera(reflection.points), locations
        )
        by_point = by_camera_point @ rotation
        by_gradient = by_point @ path.tangents.transpose(0, 2, 1) @ path.response()
        for k, location in enumerate(locations):
            if location.section in ("mirror_pose", "mount"):
                disturbance, frame = _pose_effect(
                    sensor, path, reflection, points, distant, location
                )
                by_location[:, :, k] += np.einsum("nij,nj->ni", by_gradient, disturbance)
                by_location[:, :, k] += np.einsum("nij,nj->ni", by_camera_point, frame)
        _add_shape(sensor, path, by_gradient, by_point, locations, by_location)
        by_target = by_gradient @ (path.by_target @ rotation.T)
        r = np.hypot(reflection.points[:, 0], reflection.points[:, 1])
        valid = valid & reflection.reflects & (r <= RIM_EXTENSION * sensor.mirror.rim_radius_mm)
    for array in (pixels, by_target, by_location):
        array[~valid] = np.nan
    return PointImages(pixels, valid, by_target, by_location)


def _path_endpoints(
    sensor: Sensor, pose: MirrorPose, points: Array, distant: bool
) -> tuple[RayEndpoints, RayEndpoints]:
    """Return lens and targets in the mirror frame."""
    if sensor.lens.TELECENTRIC:
        pupils = RayEndpoints(pose.rotate_to_mirror(np.array([[0.0, 0.0, -1.0]])), distant=True)
    else:
        pupils = RayEndpoints(pose.to_mirror(sensor.optical_train.pupil_offset[None]))
    return pupils, RayEndpoints.of(
        pose.rotate_to_mirror(points) if distant else pose.to_mirror(points), distant
    )


def _optical_path(
    sensor: Sensor,
    pupils: RayEndpoints,
    targets: RayEndpoints,
    reflection: ReflectionPoints,
    directions: Array | None,
) -> OpticalPath:
    """Return the optical paths with the derivatives of their gradients."""
    surface = MirrorSurface(sensor.mirror, reflection.points[:, :2])
    from_pupil, by_pupil, pupil_on_point = _unit_vectors(pupils, surface.points)
    from_target, by_target, target_on_point = _unit_vectors(targets, surface.points)
    if directions is not None:  # of any length, inversely proportional to the rotation
        by_target = by_target / np.linalg.norm(directions, axis=1)[:, None, None]
    tangents = surface.tangents
    pull = from_pupil + from_target
    return OpticalPath(
        surface,
        tangents,
        pull,
        tangents @ by_pupil,
        tangents @ by_target,
        tangents @ (pupil_on_point + target_on_point),
    )


def _unit_vectors(ends: RayEndpoints, points: Array) -> tuple[Array, Array, Array]:
    """Return unit vectors (n, 3) from ends to points, and derivatives (n, 3, 3) with respect to
    ends and points.
    """
    if ends.distant:
        unit = np.broadcast_to(-ends.xyz, points.shape)
        across = IDENTITY - unit[:, :, None] * unit[:, None, :]
        return unit, -across, np.zeros_like(across)
    step = points - ends.xyz
    distance = np.sqrt(np.einsum("ni,ni->n", step, step))
    unit = step / distance[:, None]
    across = (IDENTITY - unit[:, :, None] * unit[:, None, :]) / distance[:, None, None]
    return unit, -across, across


def _pose_effect(
    sensor: Sensor,
    path: OpticalPath,
    reflection: ReflectionPoints,
    points: Array,
    distant: bool,
    location: ParameterLocation,
) -> tuple[Array, Array]:
    """Return the effect of a pose or distance parameter on the optical path.

    The results are changes of the gradient and of a fixed mirror point.

    Shapes are (n, 2) and (n, 3).
    """
    rotation, shift = sensor.mirror_pose.rotation(), sensor.mirror_pose.shift
    zeros = np.zeros((len(points), 3))
    if location.name == DISTANCE:
        return path.by_pupil @ (rotation.T @ [0.0, 0.0, -1.0]), zeros
    d_rotation, d_shift = _pose_derivatives(sensor.mirror_pose, location.key)
    pupil = (
        np.array([0.0, 0.0, -1.0])
        if sensor.lens.TELECENTRIC
        else sensor.optical_train.pupil_offset - shift
    )
    d_pupil = d_rotation.T @ pupil - (0.0 if sensor.lens.TELECENTRIC else rotation.T @ d_shift)
    d_target = rotate_vectors(points if distant else points - shift, d_rotation) - (
        0.0 if distant else rotation.T @ d_shift
    )
    disturbance = path.by_pupil @ d_pupil + np.einsum("nij,nj->ni", path.by_target, d_target)
    return disturbance, rotate_vectors(reflection.points, d_rotation.T) + d_shift


def _add_shape(
    sensor: Sensor,
    path: OpticalPath,
    by_gradient: Array,
    by_point: Array,
    locations: tuple[ParameterLocation, ...],
    by_location: Array,
) -> None:
    """Add the effect of surface height and slope to the derivatives (n, 2, k)."""
    columns = [k for k, location in enumerate(locations) if location.section == "mirror"]
    if not columns:
        return
    xy = path.surface.points[:, :2]
    r = np.hypot(xy[:, 0], xy[:, 1])
    sag, slope, _ = profile_derivatives(sensor.mirror, r, tuple(locations[k] for k in columns))
    radial = xy / np.where(r > 0, r, 1.0)[:, None]
    by_sag = np.einsum("nij,nj->ni", by_gradient, path.by_point[:, :, 2]) + by_point[:, :, 2]
    by_slope = path.pull[:, 2, None] * np.einsum("nij,nj->ni", by_gradient, radial)
    by_location[:, :, columns] += (
        by_sag[:, :, None] * sag[:, None] + by_slope[:, :, None] * slope[:, None]
    )


def _pose_derivatives(pose: MirrorPose, key: str) -> tuple[Array, Array]:
    """Return derivatives of a pose's rotation (3, 3) per deg and translation (3,) per mm."""
    (cx, cy), (sx, sy) = (
        f(np.radians([pose.tilt_x_deg, pose.tilt_y_deg])) for f in (np.cos, np.sin)
    )
    degree = np.pi / 180
    d_rotation, d_shift = np.zeros((3, 3)), np.zeros(3)
    if key == "tilt_x_deg":
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        d_rotation = about_y @ np.array([[0.0, 0.0, 0.0], [0.0, -sx, -cx], [0.0, cx, -sx]]) * degree
    elif key == "tilt_y_deg":
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        d_rotation = np.array([[-sy, 0.0, cy], [0.0, 0.0, 0.0], [-cy, 0.0, -sy]]) @ about_x * degree
    else:
        d_shift[("decentre_x_mm", "decentre_y_mm", "displacement_mm").index(key)] = 1.0
    return d_rotation, d_shift


# -- Tube or dome ----------------------------------------------------------------------------------
#
# The pixel of a point outside the cover is that of any two points on the inner ray, which the
# mirror without a cover projects with known derivatives. These give the motion of the inner ray at
# both points for changes of parameters and pixel. The cover maps it to the motion of the outer ray,
# which must continue to meet the point.

NEAR_POINT, FAR_POINT = (
    1.0,
    3.0,
)  # rim radii from the mirror point: points that define the inner ray
COVER_STEP = 1e-5  # rim radii; central differences with an error quadratic in the step


def image_through_cover(
    sensor: Sensor, points: Array, distant: bool, locations: tuple[ParameterLocation, ...]
) -> PointImages:
    """Compute the image of points through a tube or dome, as :func:`image_of_points`."""
    covered, rim = sensor.optical_train.effective_mirror, sensor.mirror.rim_radius_mm
    assert isinstance(covered, CoveredMirror)
    bare = replace(sensor, housing=Housing())
    with np.errstate(all="ignore"):  # non-finite results are marked invalid
        pupil = sensor.optical_train.entrance_pupil_points(np.zeros((1, 2)))
        reflection = covered.specular(pupil, RayEndpoints.of(points, distant))
        inner_points = [
            reflection.points + multiple * rim * reflection.to_targets
            for multiple in (NEAR_POINT, FAR_POINT)
        ]
        images = [
            image_of_points(bare, inner_point, False, locations) for inner_point in inner_points
        ]
        targets = points / np.linalg.norm(points, axis=1, keepdims=True) if distant else points
        normals, by_inner_point = _deviation_derivatives(
            covered, inner_points, targets, distant, COVER_STEP * rim
        )
        by_pixel = np.zeros((len(points), 2, 2))
        by_parameter = np.zeros((len(points), 2, len(locations)))
        for image, derivative in zip(images, by_inner_point, strict=True):
            d = image.d_points
            inverse = d.transpose(0, 2, 1) @ np.linalg.inv(
                d @ d.transpose(0, 2, 1)
            )  # perpendicular to the ray
            by_pixel += derivative @ inverse
            by_parameter += derivative @ inverse @ image.d_parameters
        by_target = (
            -normals / np.linalg.norm(points, axis=1)[:, None, None] if distant else -normals
        )
        valid = reflection.reflects & images[0].valid & images[1].valid
        valid &= np.isfinite(by_pixel).all(axis=(1, 2))
        pixel_by_deviation = np.linalg.inv(np.where(valid[:, None, None], by_pixel, np.eye(2)))
        d_points, d_parameters = -pixel_by_deviation @ by_target, pixel_by_deviation @ by_parameter
    pixels = images[0].pixels
    for array in (pixels, d_points, d_parameters):
        array[~valid] = np.nan
    return PointImages(pixels, valid, d_points, d_parameters)


def _deviation_derivatives(
    covered: CoveredMirror, inner_points: list[Array], targets: Array, distant: bool, step: float
) -> tuple[Array, list[Array]]:
    """Return directions (n, 2, 3) perpendicular to the outer rays, and derivatives of their misses.

    The miss is the offset of the ray from its target along these directions. Its derivatives
    (n, 2, 3) are with respect to the two points that define the inner ray.
    """

    def deviation(positions: list[Array]) -> tuple[Array, Array]:
        points, outer_directions = covered.outside_of(
            positions[0] - (positions[1] - positions[0]) * NEAR_POINT / (FAR_POINT - NEAR_POINT),
            positions[0],
        )
        if distant:
            return outer_directions - targets, outer_directions
        towards = targets - points
        return np.einsum("ni,ni->n", towards, outer_directions)[
            :, None
        ] * outer_directions - towards, outer_directions

    _, outer_directions = deviation(inner_points)
    reference = np.eye(3)[np.abs(outer_directions).argmin(axis=1)]
    e1 = np.cross(outer_directions, reference)
    e1 /= np.linalg.norm(e1, axis=1, keepdims=True)
    normals = np.stack([e1, np.cross(outer_directions, e1)], axis=1)
    changes = []
    for k in (0, 1):
        columns = []
        for axis in np.eye(3):
            perturbed = [
                [p + (sign * step * axis if i == k else 0.0) for i, p in enumerate(inner_points)]
                for sign in (1, -1)
            ]
            (up, _), (down, _) = map(deviation, perturbed)
            columns.append(np.einsum("nai,ni->na", normals, up - down) / (2 * step))
        changes.append(np.stack(columns, axis=-1))
    return normals, changes
