"""Parameters of a mirror sensor for estimation, and derivatives of its projection.

Parameters have names, groups, priors and tolerances. The projection of points is differentiated with
respect to the points and to all parameters.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..base.arguments import InvalidType, format_value, number, validate_arguments
from ..base.errors import InvalidParameter, OmnimirrorError
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

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

# -- Parameter names and locations -----------------------------------------------------------------

NAME_PATTERN = re.compile(r"(mirror|lens|imager|mirror_pose|mount)\.(\w+)(?:\[(\d+)\])?")
DISTANCE = "mount.mirror_distance_mm"


class ParameterLocation(NamedTuple):
    """Location of a sensor parameter: its section, its key, and its index in a list."""

    section: str
    key: str
    item: int | None = None

    @property
    def name(self) -> str:
        """Name as in sensor files and error messages."""
        return f"{self.section}.{self.key}" + ("" if self.item is None else f"[{self.item}]")

    def of(self, part: Any) -> float:
        """Return the value in a section."""
        value = part.centre if self.key == "centre_px" else getattr(part, self.key)
        return float(value if self.item is None else value[self.item])

    def change(self, part: Any, value: Any) -> dict[str, Any]:
        """Return the replacements in a section for another value."""
        if self.item is None:
            return {self.key: value}
        values = list(part.centre if self.key == "centre_px" else getattr(part, self.key))
        values[self.item] = value
        return {self.key: tuple(values)}


def parameter_location(sensor: Sensor, name: str) -> ParameterLocation:
    """Return the location of a named parameter of a sensor.

    >>> import omnimirror as om
    >>> parameter_location(om.load_sensor("paper-spherical"), "imager.centre_px[1]")
    ParameterLocation(section='imager', key='centre_px', item=1)
    """
    match = NAME_PATTERN.fullmatch(name)
    names = list(parameter_names(sensor))
    if match is None or name not in names:
        raise InvalidParameter(
            f"parameters of {sensor.name!r} must be among {', '.join(names)}; got {format_value(name)}"
        )
    section, key, index = match.groups()
    return ParameterLocation(section, key, None if index is None else int(index))


def parameter_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of all parameters that affect the image of a sensor."""
    yield from shape_names(sensor)
    yield from lens_names(sensor)
    yield from ("imager.centre_px[0]", "imager.centre_px[1]", "imager.pixel_pitch_um")
    if not sensor.lens.TELECENTRIC:
        yield DISTANCE
    yield from (f"mirror_pose.{key}" for key in sensor.mirror_pose.PARAMETERS)


NON_SHAPE_PARAMETERS = (
    "omega_min_deg",
    "rim_radius_mm",
    "normalization_radius_mm",
    "uncertainty_um",
    "x_mm",
    "height",
)
"""Parameters of the extent and the normalisation of a mirror, which do not affect its shape."""
LISTS_FROM_AXIS = ("slopes", "z_mm", "omega_deg")
"""Lists whose first element is on the axis, where it is fixed for a smooth mirror."""


def shape_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of the mirror's shape parameters."""
    for key, parameter in sensor.mirror.PARAMETERS.items():
        value = getattr(sensor.mirror, key)
        if parameter.choices or value is None or key in NON_SHAPE_PARAMETERS:
            continue
        if isinstance(value, tuple):
            first = 1 if key in LISTS_FROM_AXIS else 0
            yield from (f"mirror.{key}[{i}]" for i in range(first, len(value)))
        else:
            yield f"mirror.{key}"


def lens_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of lens parameters that affect image positions, not only blur."""
    if not isinstance(sensor.lens, Perspective):
        yield "lens.magnification"
        return
    yield "lens.focal_length_mm"
    yield from (f"lens.{key}" for key in ("k1", "k2", "k3", "p1", "p2"))


def value_of(sensor: Sensor, location: ParameterLocation) -> float:
    """Return the value of a parameter."""
    return location.of(sensor if location.section == "mount" else getattr(sensor, location.section))


def with_values(
    sensor: Sensor, locations: Iterable[ParameterLocation], values: Iterable[float]
) -> Sensor:
    """Return the sensor with other parameter values and without uncertainty.

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with_values(sensor, [parameter_location(sensor, "mirror.radius_mm")], [51.0]).mirror.radius_mm
    51.0
    """
    parts: dict[str, dict[str, Any]] = {}
    for location, value in zip(locations, values, strict=True):
        entries = parts.setdefault(location.section, {})
        if location.item is not None and location.key in entries:
            values_so_far = list(entries[location.key])
            values_so_far[location.item] = float(value)
            entries[location.key] = tuple(values_so_far)
            continue
        part = sensor if location.section == "mount" else getattr(sensor, location.section)
        entries |= location.change(part, float(value))
    sensor_entries = parts.pop("mount", {})
    replacements = {
        section: replace(getattr(sensor, section), **entries) for section, entries in parts.items()
    }
    return replace(sensor, **replacements, **sensor_entries, uncertainty=None)


# -- Parameter groups and priors -------------------------------------------------------------------

GROUPS = ("shape", "focal", "centre", "distortion", "distance", "decentre", "tilt")
"""Names of parameter groups, in the order of the model."""
DEFAULT_GROUPS = ("focal", "distance", "decentre", "tilt")
"""Default free parameters: nominal mirror, mounted with manual accuracy."""


ARBITRARY_SIGMA = 0.5
"""Relative standard deviation of arbitrary initial values."""
CENTRE_SIGMA = 0.05
"""Standard deviation of the optical axis from the image centre, relative to the image width."""
ANY_CONIC, TERM = 10.0, 0.1  # standard deviations: conic; sag of terms at the rim, rim radii


class ParameterPrior(NamedTuple):
    """Prior knowledge of a parameter, from a drawing and its tolerance."""

    name: str
    value: float
    sigma: float
    """Standard deviation, in the unit of the parameter."""


def group_names(sensor: Sensor, group: str) -> tuple[str, ...]:
    """Return the parameters of a sensor in a group of :data:`GROUPS`.

    >>> import omnimirror as om
    >>> group_names(om.load_sensor("paper-spherical"), "shape")
    ('mirror.radius_mm',)
    """
    lens, *distortion = lens_names(sensor)
    names: dict[str, Iterable[str]] = {
        "shape": shape_names(sensor),
        "focal": (lens,),
        "centre": ("imager.centre_px[0]", "imager.centre_px[1]"),
        "distortion": distortion,
        "distance": () if sensor.lens.TELECENTRIC else (DISTANCE,),
        "decentre": ("mirror_pose.decentre_x_mm", "mirror_pose.decentre_y_mm"),
        "tilt": ("mirror_pose.tilt_x_deg", "mirror_pose.tilt_y_deg"),
    }
    return tuple(names[group])


@validate_arguments
def free_names(sensor: Sensor, free: str | Iterable[str]) -> tuple[str, ...]:
    """Return the unique parameter names of groups and names.

    Raises
    ------
    InvalidParameter
        If a word is neither a group nor a parameter.
    """
    if isinstance(free, str):
        free = (free,)
    names: dict[str, None] = {}
    for entry in free:
        if entry in GROUPS:
            names |= dict.fromkeys(group_names(sensor, entry))
        elif NAME_PATTERN.fullmatch(str(entry)):
            names[parameter_location(sensor, entry).name] = None
        else:
            raise InvalidParameter(
                f"free must contain groups ({', '.join(GROUPS)}) or parameter names "
                f"({', '.join(parameter_names(sensor))}); got {format_value(entry)}"
            )
    if not names:
        raise InvalidParameter(
            f"free must contain at least one parameter of {sensor.name!r}, for example of "
            f"the groups {', '.join(GROUPS)}; got none"
        )
    return tuple(names)


def default_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return typical workshop tolerances of parameters that images alone determine poorly.

    They are 5 % for focal length and distance, 1 % of the image width for the optical axis, and 3 %
    of its radius and 3 deg for the pose of the mirror. Shape and distortion have no priors.
    """
    width, rim = sensor.imager.width_px, sensor.mirror.rim_radius_mm
    sigma = {"imager.centre_px[0]": 0.01 * width, "imager.centre_px[1]": 0.01 * width}
    sigma |= {
        f"mirror_pose.{key}": 0.03 * rim
        for key in ("decentre_x_mm", "decentre_y_mm", "displacement_mm")
    }
    sigma |= {"mirror_pose.tilt_x_deg": 3.0, "mirror_pose.tilt_y_deg": 3.0}
    for name in (DISTANCE, "lens.focal_length_mm", "lens.magnification", "imager.pixel_pitch_um"):
        if name in names:
            sigma[name] = 0.05 * value_of(sensor, parameter_location(sensor, name))
    return tuple(
        ParameterPrior(name, value_of(sensor, parameter_location(sensor, name)), sigma[name])
        for name in names
        if name in sigma
    )


def unknown_mirror_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return priors of an unknown mirror: usual pose tolerances, unknown distance and lens.

    Focal length and distance are arbitrary initial values. Images that do not determine them must
    report them as undetermined, rather than known to a workshop tolerance. The position of the
    optical axis is also unknown: a decentred mirror resembles a tilted one except at its rim. The
    shape is a conic with terms that are small relative to the mirror.
    """
    names = tuple(names)
    sigma = {
        name: ARBITRARY_SIGMA * value_of(sensor, parameter_location(sensor, name))
        for name in (DISTANCE, "lens.focal_length_mm")
    }
    sigma |= {"mirror.conic": ANY_CONIC}
    sigma |= {f"imager.centre_px[{i}]": CENTRE_SIGMA * sensor.imager.width_px for i in (0, 1)}
    sigma |= {
        name: TERM * sensor.mirror.rim_radius_mm
        for name in names
        if name.startswith("mirror.coefficients")
    }
    pose_priors = (prior for prior in default_priors(sensor, names) if prior.name not in sigma)
    shape_priors = (
        ParameterPrior(n, value_of(sensor, parameter_location(sensor, n)), sigma[n])
        for n in names
        if n in sigma
    )
    return (*shape_priors, *pose_priors)


@validate_arguments
def checked_priors(
    names: tuple[str, ...], priors: Iterable[ParameterPrior]
) -> tuple[ParameterPrior, ...]:
    """Return priors of free parameters after checks, each with a positive tolerance."""
    entries = tuple(priors)
    for prior in entries:
        if not (isinstance(prior, tuple) and len(prior) == len(ParameterPrior._fields)):
            raise InvalidType(
                f"priors must be tuples (name, value, standard deviation); got {format_value(prior)}"
            )
    result = tuple(ParameterPrior(*prior) for prior in entries)
    for prior in result:
        if prior.name not in names:
            raise InvalidParameter(
                f"priors must refer to free parameters ({', '.join(names)}); got {format_value(prior.name)}"
            )
        number(f"sigma of {prior.name}", prior.sigma, above=0.0)
    return result


# -- Projection of points and its derivatives ------------------------------------------------------
#
# The chain is: mirror shape, reflection, tube or dome, lens and imager.

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
            )  # type: ignore[type-var]  # every mirror is a dataclass
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
    depth = points[:, 2] - sensor.pupil_offset[2]
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
        pupils = RayEndpoints(pose.to_mirror(sensor.pupil_offset[None]))
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
    pupil = np.array([0.0, 0.0, -1.0]) if sensor.lens.TELECENTRIC else sensor.pupil_offset - shift
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
