"""Camera model of a mirror sensor with free parameters of mirror, lens and mounting."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Generic, Literal, NamedTuple, Self, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..base.arguments import finite, number, validate_arguments, vectors
from ..base.caching import cached_property
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.numerics import damped_step, levenberg_marquardt
from ..base.parameters import Uncertainty
from ..base.typing import Array
from ..cameras.camera import AxialSymmetry, Mount, Projection, Rays, inside_image
from ..cameras.models.camera_model import CameraModel, ModelParameter, PointImages
from ..optics.image_sensor import Imager
from ..optics.lenses import Perspective
from ..optics.mirrors import ConicAsphere, SlopeSpline, Sphere
from ..optics.mirrors.mirror import MirrorPose
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.meridian import trace_chief_rays
from .sensor_parameters import (
    DEFAULT_GROUPS,
    ParameterLocation,
    ParameterPrior,
    checked_priors,
    default_priors,
    free_names,
    group_names,
    image_of_points,
    image_through_cover,
    parameter_location,
    profile_derivatives,
    shape_names,
    unknown_mirror_priors,
    value_of,
    with_values,
)

__all__ = [
    "RIM_TO_DISTANCE",
    "MeridionalProjection",
    "ParameterPrior",
    "SensorModel",
    "estimate_mirror_size",
    "fit_to_central_model",
    "mirror_ball_model",
    "radial_projection",
    "ring_directions",
    "unknown_sensor",
    "with_prescribed_projection",
    "without_fold",
]


# -- Sensor model ----------------------------------------------------------------------------------

N_PROBES = 96
"""Number of points for the estimate of a parameter's effect."""
PROBE_DISTANCE = 10.0
"""Their distance in rim radii; all parameters affect near points."""


@dataclass(frozen=True)
class SensorModel(CameraModel):
    """Sensor with selected free parameters for estimation; all others are fixed.

    The model is exact: each point, near or far, is projected via its own mirror point for any pose
    of the mirror.

    Parameters
    ----------
    sensor
        Nominal sensor or current estimate.
    free
        Names of parameters as in the sensor file (``"lens.focal_length_mm"``,
        ``"mirror.coefficients[0]"``), or groups: ``"shape"`` of the mirror, ``"focal"`` length,
        ``"centre"`` of the image, ``"distortion"`` of the lens, ``"distance"``, ``"decentre"`` and
        ``"tilt"`` of the mirror. By default the estimated parameters of a calibrated sensor,
        otherwise focal length, distance, decentre and tilt.
    priors
        Prior knowledge of free parameters from the drawing: name, value, standard deviation. By
        default typical workshop tolerances for parameters that images determine poorly.

    Raises
    ------
    InvalidParameter
        If the sensor does not have a parameter, a prior refers to a fixed parameter, or the sensor
        has two mirrors.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), free=("focal", "decentre"))
    >>> [p.name for p in model.parameters]
    ['lens.focal_length_mm', 'mirror_pose.decentre_x_mm', 'mirror_pose.decentre_y_mm']
    >>> image = model.image([[1000.0, 0.0, 0.0]])  # 1 m to the right of the mirror's vertex
    >>> image.pixels.round(2), image.d_parameters[0, 0].round(1)  # by mm of focal length and of decentring
    (array([[905.38, 511.5 ]]), array([35.9, 11.4,  0. ]))
    """

    sensor: Sensor
    free: tuple[str, ...] = None  # type: ignore[assignment]  # None only until chosen
    priors: tuple[ParameterPrior, ...] = None  # type: ignore[assignment]  # None only until created

    KIND: ClassVar[str] = "sensor"

    def __post_init__(self) -> None:
        check_sensor(self.sensor)
        self.sensor.check(
            "a model with free parameters", "single mirror", "thin lens", "ideal except poses"
        )
        if self.sensor.housing.shell is not None:  # constant during an estimation
            object.__setattr__(
                self, "sensor", replace(self.sensor, housing=self.sensor.obstructions.housing)
            )
        uncertainty, requested = self.sensor.uncertainty, cast("tuple[str, ...] | None", self.free)
        free = (
            requested
            if requested is not None
            else DEFAULT_GROUPS
            if uncertainty is None
            else uncertainty.names
        )
        object.__setattr__(self, "free", free_names(self.sensor, free))
        specified: tuple[ParameterPrior, ...] | None = self.priors
        priors = (
            default_priors(self.sensor, self.free)
            if specified is None
            else checked_priors(self.free, specified)
        )
        object.__setattr__(self, "priors", priors)

    # -- camera model interface ------------------------------------------------------------------

    @property
    def optics(self) -> Literal["mirror"]:  # type: ignore[override]  # a field of other models
        """Type of optics, ``"mirror"``: the image centre is directed back past the lens."""
        return "mirror"

    @cached_property
    def parameters(self) -> tuple[ModelParameter, ...]:
        """Free parameters: name, value, unit, and the change that moves the image by 1 px."""
        return tuple(
            ModelParameter(location.name, value_of(self.sensor, location), unit, scale)
            for location, unit, scale in zip(self._places, self._units, self._scales, strict=True)
        )

    def with_parameters(self, values: ArrayLike) -> Self:
        """Return the model with other values of its free parameters.

        Parameters
        ----------
        values : (n,)
            Values of the parameters, in the units of :attr:`parameters`.

        Returns
        -------
        SensorModel
            Model with the same free parameters and priors.

        Raises
        ------
        InvalidParameter
            If the number of values is wrong, or a value is out of range.
        """
        numbers = np.asarray(values, dtype=float)
        if numbers.shape != (len(self.free),) or not np.isfinite(numbers).all():
            raise InvalidParameter(
                f"values must be {len(self.free)} finite numbers; got shape {numbers.shape}"
            )
        other = object.__new__(type(self))  # free parameters and priors are already checked
        other.__dict__["sensor"] = with_values(self.sensor, self._places, numbers)
        for name in ("free", "priors", "_places", "_scales"):  # constant during an estimation
            other.__dict__[name] = getattr(self, name)
        return other

    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Compute the image of points (n, 3) mm in the camera frame.

        The origin of the frame is the nominal mirror vertex.

        Parameters
        ----------
        points_mm : (n, 3)
            Points: X right and Y down in the image, Z from the lens to the mirror.
        distant
            Whether they are directions, of any length.

        Returns
        -------
        Image
            Pixels (n, 2), valid (n,), and derivatives (n, 2, 3) with respect to the points and (n,
            2, p) by the free parameters. Pixels outside the image are not clipped, and the mirror
            continues smoothly slightly beyond its rim.

        Raises
        ------
        InvalidParameter
            If the shape of the points is wrong.
        """
        image_of = image_of_points if self.sensor.housing.shell is None else image_through_cover
        return image_of(
            self.sensor, vectors("points_mm", points_mm, 3, is_list=True), distant, self._places
        )

    @classmethod
    def from_central_model(
        cls,
        central: CameraModel,
        sensor: Sensor | None = None,
        *,
        free: Iterable[str] | None = None,
        priors: Iterable[ParameterPrior] | None = None,
        omega_max_deg: float = 170.0,
        rim_radius_mm: float = 40.0,
        distance_mm: float | None = None,
    ) -> Self:
        """Create an initial sensor model that reproduces a central model for distant points.

        Known parameters are fixed. A free shape is the one that deflects the rays of the lens as
        the central model does. The other free parameters follow by least squares within their
        tolerances. Boards placed with the central model must be shifted by :attr:`viewpoint_mm`.

        Parameters
        ----------
        central
            Estimated model with a single viewpoint.
        sensor
            Nominal sensor; by default the mirror is a conic with four aspheric terms of unknown
            shape and given size.
        free, priors
            As for the class; without a sensor, the shape is also free.
        omega_max_deg
            Maximum field angle of the observations of the central model.
        rim_radius_mm
            Size of the unknown mirror; it affects only the image of near points.
        distance_mm
            Distance of the mirror from the lens; by default four rim radii.

        Returns
        -------
        SensorModel
            Initial model.

        Examples
        --------
        >>> import omnimirror as om
        >>> ball = om.MirrorBall(
        ...     centre_px=(319.5, 239.5),
        ...     rim_radius_px=230.0,
        ...     field_deg=250.0,
        ...     image_size=(640, 480),
        ... )
        >>> model = om.SensorModel.from_central_model(ball)
        >>> both = [m.image([[3.0, 2.0, 0.5]], distant=True).pixels for m in (model, ball)]
        >>> bool(abs(both[1] - both[0]).max() < 0.1)
        True
        """
        projection = radial_projection(central, omega_max_deg)
        distance = RIM_TO_DISTANCE * rim_radius_mm if distance_mm is None else distance_mm
        nominal = (
            unknown_sensor(central, projection, rim_radius_mm, distance)
            if sensor is None
            else sensor
        )
        selection = (
            tuple(free)
            if free is not None
            else DEFAULT_GROUPS
            if sensor is not None
            else ("shape", *DEFAULT_GROUPS, "centre")
        )
        names = free_names(nominal, selection)
        prior_function = unknown_mirror_priors if sensor is None else default_priors
        tolerances = prior_function(nominal, names) if priors is None else tuple(priors)
        if set(group_names(nominal, "shape")) <= set(names):
            nominal = with_prescribed_projection(
                projection, nominal, rim_is_known=sensor is not None
            )
        model = cls(nominal, names, tolerances)
        return fit_to_central_model(model, central, model.priors, omega_max_deg)

    @property
    def viewpoint_mm(self) -> Array:
        """Mean viewpoint (3,) mm in the camera frame, over all pixels.

        Adding it to the points converts a pose of a central model, whose viewpoint is its origin,
        to one of this model.

        Examples
        --------
        >>> import omnimirror as om
        >>> om.SensorModel(om.load_sensor("paper-spherical")).viewpoint_mm.round(1)
        array([ 0. ,  0. , 12.8])
        """
        meridian = self.sensor.aligned().meridian
        x = np.sqrt(np.linspace(0.01, 1.0, N_PROBES)) * self.sensor.mirror.rim_radius_mm
        rays = meridian.trace(x[x >= meridian.x_min])
        return np.array([0.0, 0.0, float(np.median(rays.z + rays.viewpoint_offset()))])

    @cached_property
    def _places(self) -> tuple[ParameterLocation, ...]:
        return tuple(parameter_location(self.sensor, name) for name in self.free)

    @property
    def _units(self) -> list[str]:
        parts: dict[str, Any] = {
            "mirror": self.sensor.mirror,
            "lens": self.sensor.lens,
            "imager": self.sensor.imager,
        }
        parts["mirror_pose"] = self.sensor.mirror_pose
        return [
            "mm" if p.section == "mount" else parts[p.section].PARAMETERS[p.key].unit
            for p in self._places
        ]

    @cached_property
    def _scales(self) -> tuple[float, ...]:
        azimuth = np.pi * (1 + np.sqrt(5)) * np.arange(N_PROBES)
        height = 2 * (np.arange(N_PROBES) + 0.5) / N_PROBES - 1
        across = np.sqrt(1 - height**2)
        sphere = np.stack([across * np.cos(azimuth), across * np.sin(azimuth), height], axis=-1)
        image = self.image(PROBE_DISTANCE * self.sensor.mirror.rim_radius_mm * sphere)
        derivatives = image.d_parameters[image.valid]
        if not len(derivatives):
            return (1.0,) * len(self.free)
        size = np.median(
            np.linalg.norm(derivatives, axis=1), axis=0
        )  # unbounded near the tip of a cone
        return tuple(float(s) for s in 1 / np.where(size > 0, size, 1.0))

    # -- camera interface ------------------------------------------------------------------------

    @property
    def image_size(self) -> tuple[int, int]:  # type: ignore[override]  # a property replaces the field
        """Image size (width, height) in pixels."""
        return self.sensor.image_size

    @property
    def mount(self) -> Mount:  # type: ignore[override]  # a property replaces the field
        """Orientation of the camera."""
        return self.sensor.mount

    @property
    def uncertainty(self) -> Uncertainty | None:  # type: ignore[override]  # a property replaces the field
        """Covariance of the parameters estimated by a calibration."""
        return self.sensor.uncertainty

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axis of symmetry of the sensor; None if its mirror or lens is not symmetric."""
        return self.sensor.symmetry

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Return rays of pixels (n, 2) into the world, from their mirror points.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and validity (n,).
        """
        return self.sensor.backproject(pixels)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Return pixels of world points, clipped at rim and image.

        Parameters
        ----------
        points_mm : (n, 3)
            World points, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).
        """
        return self.sensor.project(points_mm)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Return pixels of world directions, clipped at rim and image.

        Parameters
        ----------
        directions : (n, 3)
            World directions of any nonzero length.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).
        """
        return self.sensor.project_directions(directions)


# -- Mirror ball at a finite distance --------------------------------------------------------------

GRAZING = 1 - 1e-6  # fraction of the outline's distance from the axis: grazing incidence
MAX_PX = 1e9
MIN_ANGULAR_RADIUS = 1e-6  # radians; minimum angular radius of a ball
PITCH_UM = 5.0  # arbitrary: an image determines only angles


@validate_arguments
def mirror_ball_model(
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    rim_radius_px: float,
    *,
    focal_px: float,
    ball_radius_mm: float = 40.0,
    mount: Mount | None = None,
) -> SensorModel:
    """Create a sensor model of a ball from its outline in the image.

    The outline of a ball of radius A at centre distance D has the angular radius
    ``sin(alpha) = A / D``. An image determines only the ratio of radius and distance: the radius is
    assumed known, and distance and position are estimated.

    Parameters
    ----------
    image_size : (width, height)
        Size of the image.
    centre_px : (u, v)
        Centre of the outline.
    rim_radius_px
        Radius of the outline.
    focal_px
        Focal length of the camera in pixels: ``width / 2 / tan(hfov / 2)``.
    ball_radius_mm
        Radius of the ball.
    mount
        Orientation of the camera; by default horizontal, as on a tripod.

    Returns
    -------
    SensorModel
        Model with free distance and position.

    Raises
    ------
    InvalidParameter
        If a number is not positive.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.mirror_ball_model((4000, 3000), (2050.0, 1480.0), 900.0, focal_px=6000.0)
    >>> round(model.sensor.mirror_distance_mm + 40.0)  # to the centre of the ball
    270
    >>> [p.name for p in model.parameters]
    ['mount.mirror_distance_mm', 'mirror_pose.decentre_x_mm', 'mirror_pose.decentre_y_mm']
    """
    number("rim_radius_px", rim_radius_px, low=1.0, high=MAX_PX)
    number("focal_px", focal_px, low=1.0, high=MAX_PX)
    number("ball_radius_mm", ball_radius_mm, low=1e-3, high=1e6)
    orientation = Mount("forward") if mount is None else mount
    (width, height), (u, v) = finite("image_size", image_size, 1.0), finite("centre_px", centre_px)
    across = np.array([u - (width - 1) / 2, v - (height - 1) / 2])
    if orientation.image_flipped:
        across[0] = -across[0]
    offset = float(np.hypot(*across))
    far, near = (
        np.arctan((offset + rim_radius_px) / focal_px),
        np.arctan((offset - rim_radius_px) / focal_px),
    )
    delta, alpha = (far + near) / 2, (far - near) / 2  # of the ball's centre; elongated off axis
    if not alpha > MIN_ANGULAR_RADIUS:
        raise InvalidParameter(
            f"rim_radius_px must be above {MIN_ANGULAR_RADIUS * focal_px:g} px for "
            f"focal_px = {focal_px:g}; got {rim_radius_px:g}"
        )
    towards = np.append(np.sin(delta) * across / (offset or 1.0), np.cos(delta))
    vertex = ball_radius_mm * (1 / np.sin(alpha) - 1) * towards
    distance, b0 = float(vertex[2]), focal_px * PITCH_UM * 1e-3
    pose = MirrorPose(
        decentre_x_mm=float(vertex[0]),
        decentre_y_mm=float(vertex[1]),
        tilt_x_deg=float(-np.degrees(np.arcsin(towards[1]))),
        tilt_y_deg=float(np.degrees(np.arctan2(towards[0], towards[2]))),
    )
    sensor = Sensor(
        Sphere(ball_radius_mm, float(ball_radius_mm * np.cos(alpha) * GRAZING)),
        Perspective(1 / (1 / b0 + 1 / distance), 8.0, distance),
        Imager(int(width), int(height), PITCH_UM),
        orientation,
        distance,
        name="mirror ball",
        mirror_pose=pose,
    )
    return SensorModel(sensor, ("distance", "decentre"))


# -- Initial sensor from a central model: the shape with the same projection of distant points -----


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
