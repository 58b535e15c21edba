"""Base classes of calibrated camera models, and the uncertainty of their viewing directions.

Radial models have a projection function, distortion and a camera matrix.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import (
    choice,
    finite,
    format_value,
    instance,
    number,
    optional_number,
    positions,
    vectors,
)
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Uncertainty
from ...base.results import Line, card, field_range, line_drawing, origin
from ...base.typing import Array, Mask
from ..camera import (
    AxialSymmetry,
    Mount,
    Projection,
    Rays,
    inside_image,
    perpendicular_axes,
    rotate_vectors,
)
from ._distortion import (
    MAX_COEFFICIENT,
    DistortedPoints,
    Distortion,
    DistortionModel,
    undistort_points,
    undistort_radius,
)

# -- Base class --------------------------------------------------------------------------------------
#
# A model uses the right-handed camera frame (X right and Y down in the image, Z ahead). ``optics``
# defines the direction of the image centre: backwards past the lens (a mirror) or forwards (a fisheye).
# Centres and radii refer to the image as delivered; ``mount.image_flipped`` marks it as mirrored.

Optics = Literal["mirror", "fisheye"]


class ModelParameter(NamedTuple):
    """Model parameter with its scaling for estimation."""

    name: str
    value: float
    unit: str
    scale: float
    """Typical change, for conditioning."""


class PointImages(NamedTuple):
    """Image points with derivatives; NaN if invalid."""

    pixels: Array
    """(n, 2), px, inside or outside the image."""
    valid: Mask
    """(n,) False beyond the end of the model's field, or at its viewpoint."""
    d_points: Array
    """(n, 2, 3) derivatives with respect to the points, px/mm, or to the given directions, px."""
    d_parameters: Array
    """(n, 2, p) derivatives with respect to :attr:`CameraModel.parameters`, px per unit of each."""


class CameraModel(ABC):
    """Camera that can be calibrated: Camera interface with parameters and derivatives."""

    KIND: ClassVar[str]
    """Name in files and on the command line."""
    image_size: tuple[int, int]
    optics: Optics
    mount: Mount
    uncertainty: Uncertainty | None = None
    """Covariance of the parameters, if estimated."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[ModelParameter, ...]:
        """Adjustable parameters, in the order of ``d_parameters``."""

    @abstractmethod
    def with_parameters(self, values: Sequence[float] | Array) -> Self:
        """Return the model with other values (p,) of its parameters."""

    @abstractmethod
    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Project points (n, 3) in the camera frame, or directions if ``distant``, with
        derivatives.

        Image edges and rim are ignored.
        """

    def image_clamped(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Project points, clamping points beyond the field to its end.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in mm, or directions, in the camera frame.
        distant
            True for directions.

        Returns
        -------
        PointImages
            Pixels (n, 2), validity (n,), and derivatives (n, 2, 3) and (n, 2, p).

        Raises
        ------
        InvalidParameter
            If the points do not have the shape (n, 3).

        Examples
        --------
        >>> import omnimirror as om
        >>> camera = om.Unified(
        ...     xi=0.0,
        ...     focal_px=(100.0, 100.0),
        ...     centre_px=(319.5, 239.5),
        ...     image_size=(640, 480),
        ...     optics="fisheye",
        ... )  # a pinhole
        >>> behind = [[0.0, 100.0, -50.0]]
        >>> camera.image(behind).valid[0], camera.image_clamped(behind).valid[0]
        (np.False_, np.True_)
        """
        return self.image(points_mm, distant=distant)

    def _repr_html_(self) -> str:
        """Return an HTML card for notebooks."""
        return camera_card(self)

    # -- Camera interface, in the world frame -----------------------------------------------------

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry; None without one."""
        return None

    @abstractmethod
    def backproject(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (n, 2), px."""

    @abstractmethod
    def project(self, points_mm: ArrayLike) -> Projection:
        """Return the pixels of world points (n, 3), mm."""

    @abstractmethod
    def project_directions(self, directions: ArrayLike) -> Projection:
        """Return the pixels of world directions (n, 3), non-zero vectors of any length."""

    # -- Orientation -------------------------------------------------------------------------------

    @property
    def is_backward_facing(self) -> bool:
        """True if the image centre is directed backwards past the lens (-Z), as for a mirror."""
        return self.optics == "mirror"

    @property
    def axis(self) -> Array:
        """World direction (3,) of the image centre."""
        forward = -1.0 if self.is_backward_facing else 1.0
        return forward * self.mount.rotation()[:, 2]

    @property
    def is_image_reversed(self) -> bool:
        """True if the raw image is mirrored: text is reversed and markers are not detected."""
        return self.is_backward_facing != self.mount.image_flipped

    @property
    def _signs(self) -> Array:
        """Signs of image right, image down and axis, relative to camera X, Y, Z."""
        return np.array(
            [
                -1.0 if self.mount.image_flipped else 1.0,
                1.0,
                -1.0 if self.is_backward_facing else 1.0,
            ]
        )


# -- First-order propagation of parameter covariance to viewing directions -------------------------

FIELD_ROUNDING_DEG = 1e-6  # tolerance of the outermost measured direction, which defines the field


def direction_covariance(model: CameraModel, covariance: Array, directions: Array) -> Array:
    """Compute the covariance (n, 2, 2), rad^2, of directions (n, 3).

    The axes are two perpendicular to each direction. With a fixed pixel, parameters of covariance
    (p, p) give ``0 = (du/dd) dd + (du/dp) dp``, therefore ``dd = -(du/dd)^-1 (du/dp) dp`` in the
    plane across d. NaN outside the field of view.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return direction_covariance_at(model, covariance, unit, perpendicular_axes(unit), distant=True)


def direction_covariance_at(
    model: CameraModel, covariance: Array, targets: Array, axes: Array, *, distant: bool
) -> Array:
    """Compute the covariance (n, 2, 2) of targets (n, 3) with fixed pixels, along axes (n, 3, 2).

    Targets are in the camera frame.
    """
    change, _ = target_changes(model, targets, axes, distant=distant)
    return change @ covariance @ change.transpose(0, 2, 1)


def target_changes(
    model: CameraModel, targets: Array, axes: Array, *, distant: bool
) -> tuple[Array, Array]:
    """Return derivatives of targets (n, 3) along axes (n, 3, 2), both in the camera frame.

    The first array, (n, 2, p), contains the derivatives with respect to the parameters with fixed
    pixels, ``-(du/dd)^-1 (du/dp)``; the second, (n, 2, 2), those with respect to the pixels,
    ``(du/dd)^-1``. NaN outside the field of view.
    """
    by_parameters = np.full((len(targets), 2, len(model.parameters)), np.nan)
    by_pixels = np.full((len(targets), 2, 2), np.nan)
    finite_rows = np.flatnonzero(np.isfinite(targets).all(axis=1))
    image = model.image(targets[finite_rows], distant=distant)
    moves = image.d_points @ axes[finite_rows]
    is_regular = (
        image.valid
        & np.isfinite(moves).all(axis=(1, 2))
        & np.isfinite(image.d_parameters).all(axis=(1, 2))
    )
    is_regular[is_regular] = np.abs(np.linalg.det(moves[is_regular])) > 0
    rows = finite_rows[is_regular]
    by_pixels[rows] = np.linalg.inv(moves[is_regular])
    by_parameters[rows] = -np.linalg.solve(moves[is_regular], image.d_parameters[is_regular])
    return by_parameters, by_pixels


def field_angles(model: CameraModel, directions: Array) -> Array:
    """Return angles (n,), deg, of directions (n, 3) from the image centre."""
    forward = -1.0 if model.is_backward_facing else 1.0
    return np.degrees(
        np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), forward * directions[:, 2])
    )


def measured_field_deg(model: CameraModel, pixels: Array) -> float | None:
    """Return the calibrated field of measured pixels (n, 2): their maximum field angle (deg)."""
    rays = model.backproject(pixels)
    directions = rotate_vectors(rays.directions[rays.valid], model.mount.rotation())
    return float(field_angles(model, directions).max()) if len(directions) else None


def within_field(
    model: CameraModel, directions: Array, field_deg: float | None
) -> NDArray[np.bool_]:
    """Return which directions (n, 3) are in a calibrated field; all if it is None."""
    if field_deg is None:
        return np.ones(len(directions), dtype=bool)
    return field_angles(model, directions) <= field_deg + FIELD_ROUNDING_DEG


def direction_sigma_deg(
    model: CameraModel, covariance: Array, directions: ArrayLike, field_deg: float | None = None
) -> Array:
    """Return the standard deviation (n,), deg, of directions, along the larger axis.

    Parameters
    ----------
    model
        Calibrated model.
    covariance : (p, p)
        Covariance of its parameters.
    directions : (n, 3)
        Directions in the camera frame, of any length.
    field_deg : deg, optional
        Calibrated field; directions outside have an unknown uncertainty.

    Returns
    -------
    (n,) array
        NaN outside the field of view or the calibrated field.
    """
    vectors = np.asarray(directions, dtype=float)
    sigma = np.degrees(major_sigma(direction_covariance(model, covariance, vectors)))
    return np.where(within_field(model, vectors, field_deg), sigma, np.nan)


def major_sigma(spread: Array) -> Array:
    """Return the larger standard deviation (n,), along the major axis, of covariances (n, 2, 2).

    >>> major_sigma(np.array([[[4.0, 0.0], [0.0, 9.0]]]))
    array([3.])
    """
    a, b, c = spread[:, 0, 0], (spread[:, 0, 1] + spread[:, 1, 0]) / 2, spread[:, 1, 1]
    # larger eigenvalue of [[a, b], [b, c]]
    sigma: Array = np.sqrt(np.maximum((a + c) / 2 + np.hypot((a - c) / 2, b), 0.0))
    return sigma


# -- Notebook card -----------------------------------------------------------

RING_STEP_DEG = 30.0
RING_POINTS = 61
MAX_PARAMETERS = 12


def camera_card(camera: CameraModel) -> str:
    """Return an HTML card: rings of constant field angle, and parameters with deviations."""
    width, height = camera.image_size
    symmetry = camera.symmetry
    field = (
        {} if symmetry is None else {"Field": field_range(symmetry.omega_min, symmetry.omega_max)}
    )
    sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
    displayed = camera.parameters[:MAX_PARAMETERS]
    parameters = {
        p.name: f"{p.value:.6g}{_format_sigma(sigmas.get(p.name))} {p.unit}" for p in displayed
    }
    omitted = len(camera.parameters) - len(displayed)
    more = {f"{omitted} more parameters": ""} if omitted else {}
    head = {
        "Optics": camera.optics,
        **field,
        "Image": f"{width} × {height} px",
        "Camera orientation": camera.mount.camera_looks,
    }
    drawing = line_drawing(
        list(_field_rings(camera)),
        f"Image with rings of constant field angle every {RING_STEP_DEG:g} degrees",
    )
    return card(
        camera.KIND,
        "calibrated camera",
        drawing,
        {**head, **parameters, **more},
        origin(getattr(camera, "notes", ""), len(sigmas)),
    )


def _format_sigma(sigma: float | None) -> str:
    return "" if sigma is None else f" ± {sigma:.2g}"


def _field_rings(camera: CameraModel) -> Iterator[Line]:
    """Yield the frame of the image and the images of rings about the axis."""
    width, height = camera.image_size
    yield Line(
        np.array([0, width, width, 0, 0.0]) - 0.5,
        0.5 - np.array([0, 0, height, height, 0.0]),
        "plain",
    )
    turn = np.linspace(0, 2 * np.pi, RING_POINTS)
    right, down = camera.mount.rotation()[:, 0], camera.mount.rotation()[:, 1]
    end = 180.0 if camera.symmetry is None else float(np.degrees(camera.symmetry.omega_max))
    rings = [*np.arange(RING_STEP_DEG, end - 1e-9, RING_STEP_DEG), end]
    for omega in np.radians(rings):
        around = np.outer(np.cos(turn), right) + np.outer(np.sin(turn), down)
        pixels, valid = camera.project_directions(
            np.cos(omega) * camera.axis + np.sin(omega) * around
        )
        if valid.any():
            yield Line(
                np.where(valid, pixels[:, 0], np.nan),
                -np.where(valid, pixels[:, 1], np.nan),
                "fine" if omega < np.radians(end) else "strong",
            )


# -- Radial models ---------------------------------------------------------------------------------
#
# The projection function of a model maps the field angle Omega of a point to the radius of its image,
# at the azimuth of the point; Brown's distortion is applied; a matrix and the centre convert to pixels.
# A model provides the projection function, its inverse and derivatives.

MAX_IMAGE_PX = 100_000
MAX_PX = 1e6  # maximum radius, focal length and centre coordinate
ROUNDING = 1e-12  # relative tolerance of angles and radii at the rim


class ParameterSlot(NamedTuple):
    """Location of a parameter in its model."""

    name: str
    field: str
    item: int | None
    """Index in the field; None for a scalar field."""
    unit: str
    scale: float


class RadialProjection(NamedTuple):
    """Radii of n field angles in the circular image, with derivatives."""

    radius: Array
    """(n,) in the unit of the model: px, or focal lengths."""
    rate: Array
    """(n,) derivative with respect to the field angle."""
    terms: Array
    """(n, q) derivatives with respect to the parameters of the projection function."""


class AngleRates(NamedTuple):
    """Derivatives of the field angles of points."""

    rho: Array
    """(n,) derivative with respect to the distance from the axis."""
    z: Array
    """(n,) derivative with respect to the position along the axis."""
    terms: Array | None = None
    """(n, q) derivatives with respect to the parameters of the viewpoint; None for a central
    model.
    """


@dataclass(frozen=True, kw_only=True)
class RadialModel(CameraModel):
    """Camera with a radial projection function, distortion and stretch.

    Parameters
    ----------
    image_size : (width, height)
    centre_px : (u, v)
        Image of the axis; integers are pixel centres.
    optics
        ``"mirror"`` or ``"fisheye"``: the image centre is directed backwards or forwards.
    mount
        Orientation of the camera.
    rim_radius_px : px, optional
        Radius of the field in the image.
    uncertainty : Uncertainty, optional
        Covariance of the calibrated parameters.

    Raises
    ------
    InvalidParameter
        If the parameters are invalid.
    """

    image_size: tuple[int, int]
    centre_px: tuple[float, float]
    optics: Optics = "mirror"
    mount: Mount = field(default_factory=Mount)
    rim_radius_px: float | None = None
    uncertainty: Uncertainty | None = field(default=None, repr=False)

    AFFINE: ClassVar[tuple[tuple[tuple[float, float], tuple[float, float]], ...]] = ()
    """Derivatives (2, 2) of :attr:`matrix` by its parameters."""
    LENS: ClassVar[Mapping[str, tuple[str, float]]] = {}
    """Supported ones of k1, k2, k3, p1 and p2, with unit and typical change."""

    # -- Interface of the models --------------------------------------------------------------

    @abstractmethod
    def _projection(self, omega: Array) -> RadialProjection:
        """Return the radii of field angles (n,), radians, up to :attr:`_projection_end`."""

    @abstractmethod
    def _projected_radius(self, omega: Array) -> Array:
        """Return the radii only."""

    @abstractmethod
    def _inverse_projection(self, radius: Array) -> Array:
        """Return the field angles of radii."""

    @property
    @abstractmethod
    def _projection_end(self) -> float:
        """Largest field angle (radians) of the projection function, which increases up to it."""

    @property
    @abstractmethod
    def _parameter_slots(self) -> tuple[tuple[ParameterSlot, ...], tuple[ParameterSlot, ...]]:
        """Parameters of the projection function, and of the matrix."""

    @property
    def matrix(self) -> Array:
        """Matrix (2, 2) from the circular image, in model units, to the image."""
        return np.eye(2)

    @property
    def scale_px(self) -> float:
        """Pixels per model unit."""
        return 1.0

    def _field_angle(self, rho: Array, z: Array, distant: bool) -> Array:
        """Return field angles of points by distance from the axis and height; else NaN."""
        with np.errstate(invalid="ignore"):
            return np.where(rho + np.abs(z) > 0, np.arctan2(rho, z), np.nan)

    def _angle_rates(self, omega: Array, rho: Array, z: Array, distant: bool) -> AngleRates:
        """Return the derivatives of the field angles."""
        square = rho * rho + z * z
        return AngleRates(z / square, -rho / square)

    def _ray_origins(self, omega: Array) -> tuple[Array, Array]:
        """Return the ray origins of field angles, from and along the axis, mm."""
        return np.zeros_like(omega), np.zeros_like(omega)

    def _viewpoint_mm(self, omega: Array) -> Array:
        """Return the positions of the rays' intersections with the axis."""
        return np.zeros_like(omega)

    @property
    def is_central(self) -> bool:
        """True if all rays start at the origin."""
        return True

    # -- Parameters --------------------------------------------------------------------------------

    @cached_property
    def parameters(self) -> tuple[ModelParameter, ...]:
        """Adjustable parameters of projection function, matrix, centre and distortion."""
        return tuple(
            ModelParameter(p.name, float(self._slot_value(p)), p.unit, p.scale)
            for p in self._all_slots
        )

    def with_parameters(self, values: Sequence[float] | Array) -> Self:
        """Return the model with other parameter values, without uncertainty.

        Parameters
        ----------
        values : (n,) numbers
            Values in the order of :attr:`parameters`.

        Returns
        -------
        CameraModel
            Model of the same class.

        Raises
        ------
        InvalidParameter
            If the values are invalid.
        """
        slots = self._all_slots
        array = finite("values", values)
        if array.shape != (len(slots),):
            raise InvalidParameter(
                f"values must have the shape ({len(slots)},) for the parameters of {self.KIND}; got shape {array.shape}"
            )
        changes: dict[str, Any] = {}
        for slot, value in zip(slots, array.tolist(), strict=True):
            if slot.item is None:
                changes[slot.field] = value
            else:
                changes.setdefault(slot.field, list(getattr(self, slot.field)))[slot.item] = value
        changes = {k: tuple(v) if isinstance(v, list) else v for k, v in changes.items()}
        return replace(self, **changes, uncertainty=None)

    @cached_property
    def _all_slots(self) -> tuple[ParameterSlot, ...]:
        projection, affine = self._parameter_slots
        centre = tuple(
            ParameterSlot(name, "centre_px", i, "px", 1.0) for i, name in enumerate(("cx", "cy"))
        )
        lens = tuple(
            ParameterSlot(name, name, None, unit, scale)
            for name, (unit, scale) in self.LENS.items()
        )
        return (*projection, *affine, *centre, *lens)

    def _slot_value(self, slot: ParameterSlot) -> float:
        value = getattr(self, slot.field)
        return value if slot.item is None else value[slot.item]  # type: ignore[no-any-return]  # the type depends on the argument

    @cached_property
    def distortion(self) -> DistortionModel:
        """Distortion of the model; zero if it has no such parameters."""
        return Distortion(**{name: getattr(self, name) for name in self.LENS})

    # -- Projection with derivatives ---------------------------------------------------------------

    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Project points or directions in the camera frame, with derivatives.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in mm (X right, Y down, Z ahead).
        distant
            True for directions, of any non-zero length, to infinitely distant points.

        Returns
        -------
        PointImages
            Pixels (n, 2), validity (n,), and derivatives (n, 2, 3) and (n, 2, p).

        Raises
        ------
        InvalidParameter
            If the points do not have the shape (n, 3).
        """
        return self._image(
            vectors("points_mm", points_mm, 3, is_list=True), distant, is_clamped=False
        )

    def image_clamped(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        # Continuous to first order: the projection function ends at a stationary radius.
        return self._image(
            vectors("points_mm", points_mm, 3, is_list=True), distant, is_clamped=True
        )

    def _image(self, points: Array, distant: bool, *, is_clamped: bool) -> PointImages:
        """Project points (n, 3), with optional clamping to the end of the field."""
        signs = self._signs
        x, y, z = (points * signs).T
        rho, (ux, uy) = _length_and_unit(x, y)
        omega = self._field_angle(rho, z, distant)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore", under="ignore"):
            inside = omega <= self.model_end
            valid = (np.isfinite(omega) if is_clamped else inside) & np.isfinite(ux)
            projection = self._projection(np.minimum(omega, self.model_end))
            if is_clamped:
                projection = projection._replace(rate=np.where(inside, projection.rate, 0.0))
            angle = self._angle_rates(omega, rho, z, distant)
            # With r(Omega) at the unit vector u of the azimuth, the derivative with respect to the
            # point across the axis is (dr/drho) u u^T + (r / rho) (1 - u u^T); on the axis r / rho
            # = dr/drho.
            meridional = projection.rate * angle.rho
            across = np.where(rho > ROUNDING * np.abs(z), projection.radius / rho, meridional)
            rx, ry = projection.radius * ux, projection.radius * uy
            at = self.distortion.distort(rx, ry)
            matrix = self.matrix
            to_pixels = _PixelDerivatives(matrix, at)
            extra = meridional - across
            d_points = np.empty((len(points), 2, 3))
            d_points[:, :, 0] = to_pixels.columns(
                signs[0] * (across + extra * ux * ux), signs[0] * extra * ux * uy
            )
            d_points[:, :, 1] = to_pixels.columns(extra * ux * uy, across + extra * uy * uy)
            along = signs[2] * projection.rate * angle.z
            d_points[:, :, 2] = to_pixels.columns(along * ux, along * uy)
            d_parameters = self._parameter_derivatives(
                to_pixels, (rx, ry), (at.x, at.y), (ux, uy), projection, angle
            )
            pixels = rotate_vectors(np.stack([at.x, at.y], axis=-1), matrix.T) + self.centre_px
        valid = valid & np.isfinite(pixels).all(axis=-1)  # excludes poles of rational models
        if not valid.all():
            pixels[~valid], d_points[~valid], d_parameters[~valid] = np.nan, np.nan, np.nan
        return PointImages(pixels, valid, d_points, d_parameters)

    def _parameter_derivatives(
        self,
        to_pixels: _PixelDerivatives,
        undistorted: tuple[Array, Array],
        distorted: tuple[Array, Array],
        azimuth: tuple[Array, Array],
        projection: RadialProjection,
        angle: AngleRates,
    ) -> Array:
        terms = (
            projection.terms
            if angle.terms is None
            else np.hstack([projection.terms, projection.rate[:, None] * angle.terms])
        )
        q = terms.shape[1]
        result = np.zeros((len(terms), 2, len(self._all_slots)))
        radial = to_pixels.of(azimuth[0], azimuth[1])
        for row in (0, 1):
            result[:, row, :q] = radial[row][:, None] * terms
        for i, direction in enumerate(self.AFFINE, start=q):
            for row in (0, 1):
                result[:, row, i] = (
                    direction[row][0] * distorted[0] + direction[row][1] * distorted[1]
                )
        first = q + len(self.AFFINE)
        result[:, 0, first] = result[:, 1, first + 1] = 1.0
        if names := self.LENS:
            derivatives = dict(
                zip(
                    self.distortion._fields,
                    self.distortion.parameter_derivatives(*undistorted),
                    strict=True,
                )
            )
            for i, name in enumerate(names, start=first + 2):
                dx, dy = derivatives[name]
                for row in (0, 1):
                    result[:, row, i] = (
                        to_pixels.matrix[row, 0] * dx + to_pixels.matrix[row, 1] * dy
                    )
        return result

    # -- Limits of the field -----------------------------------------------------------------------

    @cached_property
    def model_end(self) -> float:
        """Largest field angle (radians) of projection function and distortion."""
        end = self._projection_end
        if (limit := self.distortion.max_radius()) < np.inf:
            with np.errstate(over="ignore"):
                max_radius = float(self._projected_radius(np.array([end]))[0])
            if limit < max_radius:
                end = float(self._inverse_projection(np.array([limit]))[0])
        return end

    @cached_property
    def omega_max(self) -> float:
        """Largest field angle (radians), limited by rim, image corners and model."""
        end = self._plane_end
        x, y, is_solved = self._circular_image_points(self._corners, end)
        radii = [float(np.hypot(x, y).max()) if is_solved.all() else end]
        if self.rim_radius_px is not None:
            radii.append(
                float(
                    undistort_radius(
                        self.distortion, np.array([self.rim_radius_px / self.scale_px]), end
                    )[0]
                )
            )
        radius = min(radii)
        return (
            self.model_end
            if radius >= end
            else float(self._inverse_projection(np.array([radius]))[0])
        )

    @property
    def _corners(self) -> Array:
        width, height = self.image_size
        return np.array([[u, v] for u in (-0.5, width - 0.5) for v in (-0.5, height - 0.5)])

    def _max_corner_radius(self, into_plane: NDArray[np.floating]) -> float:
        """Return the largest corner distance from the centre, after a matrix (2, 2)."""
        return float(np.hypot(*((self._corners - self.centre_px) @ into_plane.T).T).max())

    @property
    def _plane_end(self) -> float:
        with np.errstate(over="ignore"):
            return float(self._projected_radius(np.array([self.model_end]))[0])

    @cached_property
    def field_radius_px(self) -> float:
        """Radius of the circle of validity, in the image before the stretch."""
        return float(self.radius_from_omega(np.array([self.omega_max]))[0])

    def radius_from_omega(self, omega: ArrayLike) -> Array:
        """Compute radii (n,), px, of field angles (n,), radians, up to :attr:`omega_max`.

        Parameters
        ----------
        omega : (n,)
            Field angles, radians.

        Returns
        -------
        (n,) array
            Distances from the centre before tangential distortion and stretch, px.

        Raises
        ------
        InvalidParameter
            If the angles are not one-dimensional.
        """
        return self.scale_px * self.distortion.radius(
            self._projected_radius(positions("omega", omega, is_row=True))
        )

    def mapping(self, omega: ArrayLike) -> tuple[Array, Array, Array]:
        """Compute radius, its rate and the viewpoint at field angles.

        Parameters
        ----------
        omega : (n,)
            Field angles, radians, up to :attr:`omega_max`.

        Returns
        -------
        tuple of (n,) arrays
            Radii as in :meth:`radius_from_omega`, px; derivatives, px per radian; and intersections
            of the rays with the axis, mm along the camera's Z from the origin of its frame.

        Raises
        ------
        InvalidParameter
            If the angles are not one-dimensional.
        """
        omega = positions("omega", omega, is_row=True)
        projection = self._projection(omega)
        rate = self.scale_px * self.distortion.rate(projection.radius) * projection.rate
        return (
            self.radius_from_omega(omega),
            rate,
            self._signs[2] * self._viewpoint_mm(omega) + 0.0,
        )  # avoids -0

    def omega_from_radius(self, radius_px: ArrayLike) -> Array:
        """Compute field angles (n,), radians, of radii (n,), px, up to :attr:`field_radius_px`.

        Parameters
        ----------
        radius_px : (n,)
            Distances from the centre before tangential distortion and stretch, px.

        Returns
        -------
        (n,) array
            Field angles, radians.

        Raises
        ------
        InvalidParameter
            If the radii are not one-dimensional.
        """
        radius = positions("radius_px", radius_px, is_row=True) / self.scale_px
        return self._inverse_projection(undistort_radius(self.distortion, radius, self._plane_end))

    @property
    def stretch(self) -> Array:
        """Matrix (2, 2) from the circular image, px, to the image, both (right, down)."""
        return self.matrix / self.scale_px

    # -- Camera interface --------------------------------------------------------------------------

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry; None with stretch or tangential distortion."""
        if not np.array_equal(self.stretch, np.eye(2)) or self.distortion.is_tangential:
            return None
        x, y, _ = self.mount.rotation().T
        right, down = self._signs[0] * x, self._signs[1] * y
        starts = None if self.is_central else self._ray_origins
        return AxialSymmetry(
            self.centre_px,
            self.axis,
            right,
            down,
            0.0,
            self.omega_max,
            self.radius_from_omega,
            starts,
        )

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Compute the rays of pixels (n, 2); a central model has the origin (0, 0, 0).

        Pixels outside the image or the model's field are invalid and NaN.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), with integers at pixel centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the pixels have another shape.
        """
        pixels = vectors("pixels", pixels, 2)
        end = float(self._projected_radius(np.array([self.omega_max]))[0])
        x, y, is_solved = self._circular_image_points(pixels, end * (1 + ROUNDING))
        radius, (ux, uy) = _length_and_unit(x, y)
        valid = inside_image(pixels, self.image_size) & is_solved
        omega = self._inverse_projection(np.minimum(radius[valid], end))
        signs = self._signs
        origins, directions = np.full((2, *radius.shape, 3), np.nan)
        for rays, (across, along) in (
            (directions, (np.sin(omega), np.cos(omega))),
            (origins, self._ray_origins(omega)),
        ):
            in_camera = np.stack([across * ux[valid], across * uy[valid], along], axis=-1) * signs
            rays[valid] = rotate_vectors(in_camera, self.mount.rotation().T)
        return Rays(origins, directions, valid)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Project points (n, 3), mm.

        Parameters
        ----------
        points_mm : (n, 3)
            World points, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the points have another shape.
        """
        return self._project_world(vectors("points_mm", points_mm, 3), distant=False)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Project directions (n, 3), non-zero vectors of any length.

        Parameters
        ----------
        directions : (n, 3)
            World directions, of any non-zero length.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the directions have another shape.
        """
        return self._project_world(vectors("directions", directions, 3), distant=True)

    def _project_world(self, world: Array, distant: bool) -> Projection:
        in_camera = rotate_vectors(world, self.mount.rotation()) * self._signs
        rho, (ux, uy) = _length_and_unit(in_camera[..., 0], in_camera[..., 1])
        omega = self._field_angle(rho, in_camera[..., 2], distant)
        with np.errstate(invalid="ignore"):
            in_field = (omega <= self.omega_max * (1 + ROUNDING)) & np.isfinite(ux)
        radius = self._projected_radius(np.minimum(omega[in_field], self.omega_max))
        at = self.distortion.distort(radius * ux[in_field], radius * uy[in_field])
        pixels = np.full((*rho.shape, 2), np.nan)
        pixels[in_field] = self.centre_px + rotate_vectors(
            np.stack([at.x, at.y], axis=-1), self.matrix.T
        )
        valid = inside_image(pixels, self.image_size)
        pixels[~valid] = np.nan
        return Projection(pixels, valid)

    def _circular_image_points(self, pixels: Array, end: float) -> tuple[Array, Array, Mask]:
        """Return points (n,), (n,) of the undistorted circular image, and validity."""
        plane = rotate_vectors(pixels - self.centre_px, np.linalg.inv(self.matrix).T)
        with np.errstate(invalid="ignore"):
            return undistort_points(self.distortion, plane[..., 0], plane[..., 1], end)

    # -- Validation ------------------------------------------------------------------------------

    def __post_init__(self) -> None:
        if finite("image_size", self.image_size).shape != (2,):
            raise InvalidParameter(
                f"image_size must be two numbers (width, height); got {format_value(self.image_size)}"
            )
        for name, length in zip(("width", "height"), self.image_size, strict=True):
            if not (1 <= length <= MAX_IMAGE_PX and int(length) == length):
                raise InvalidParameter(
                    f"image {name} must be an integer between 1 and {MAX_IMAGE_PX} px; got {length}"
                )
        choice("optics", self.optics, get_args(Optics))
        if finite("centre_px", self.centre_px, -MAX_PX, MAX_PX, unit="px").shape != (2,):
            raise InvalidParameter(
                f"centre_px must be two numbers (u, v); got {format_value(self.centre_px)}"
            )
        optional_number("rim_radius_px", self.rim_radius_px, above=0.0, high=MAX_PX, unit="px")
        instance("mount", self.mount, Mount, "a Mount")
        if self.uncertainty is not None:
            instance("uncertainty", self.uncertainty, Uncertainty, "an Uncertainty")
        for name, (unit, _) in self.LENS.items():
            number(name, getattr(self, name), low=-MAX_COEFFICIENT, high=MAX_COEFFICIENT, unit=unit)


class _PixelDerivatives:
    """Derivatives of pixels with respect to their positions in the undistorted circular image."""

    def __init__(self, matrix: Array, at: DistortedPoints) -> None:
        self.matrix = matrix
        (a, b), (c, d) = matrix
        self.rows = (
            (a * at.d_xx + b * at.d_yx, a * at.d_xy + b * at.d_yy),
            (c * at.d_xx + d * at.d_yx, c * at.d_xy + d * at.d_yy),
        )

    def of(self, dx: Array, dy: Array) -> tuple[Array, Array]:
        """Convert displacements in the circular image to the image, (of u, of v)."""
        (a, b), (c, d) = self.rows
        return a * dx + b * dy, c * dx + d * dy

    def columns(self, dx: Array, dy: Array) -> Array:
        """Convert displacements likewise, to (n, 2)."""
        return np.stack(self.of(dx, dy), axis=-1)


def _length_and_unit(x: Array, y: Array) -> tuple[Array, tuple[Array, Array]]:
    """Return lengths (..., ) and unit vectors; the zero vector points right."""
    length = np.hypot(x, y)
    zero = length == 0
    divisor = np.where(zero, 1.0, length)
    with np.errstate(invalid="ignore"):  # infinite vectors become NaN and invalid
        return length, (np.where(zero, 1.0, x / divisor), y / divisor)


# -- Radial models with a camera matrix K ----------------------------------------------------------

MIN_FOCAL_PX = 1e-6


@dataclass(frozen=True, kw_only=True)
class FocalModel(RadialModel):
    """Model with camera matrix: ``u = fx x + skew y + cx``, ``v = fy y + cy``.

    Parameters
    ----------
    focal_px : (fx, fy)
    skew_px
        OpenCV's alpha times fx.
    **others
        Parameters of :class:`RadialModel`.
    """

    focal_px: tuple[float, float]
    skew_px: float = 0.0

    AFFINE = (((1.0, 0.0), (0.0, 0.0)), ((0.0, 0.0), (0.0, 1.0)), ((0.0, 1.0), (0.0, 0.0)))

    @property
    def matrix(self) -> Array:
        """Matrix (2, 2) from the circular image, in focal lengths, to the image."""
        (fx, fy), skew = self.focal_px, self.skew_px
        return np.array([[fx, skew], [0.0, fy]])

    @property
    def scale_px(self) -> float:
        """Pixels per focal length: geometric mean of fx and fy."""
        fx, fy = self.focal_px
        return fx if fx == fy else float(np.sqrt(fx * fy))

    @property
    def _affine_slots(self) -> tuple[ParameterSlot, ...]:
        fx, fy = self.focal_px
        return (
            ParameterSlot("fx", "focal_px", 0, "px", 0.01 * fx),
            ParameterSlot("fy", "focal_px", 1, "px", 0.01 * fy),
            ParameterSlot("skew", "skew_px", None, "px", 0.01 * fx),
        )

    def __post_init__(self) -> None:
        super().__post_init__()
        focal = finite("focal_px", self.focal_px, high=MAX_PX, unit="px")
        if focal.shape != (2,) or not focal.min() >= MIN_FOCAL_PX:
            raise InvalidParameter(
                f"focal_px must be two numbers (fx, fy) greater than 0 px; got {format_value(self.focal_px)}"
            )
        number("skew_px", self.skew_px, low=-MAX_PX, high=MAX_PX, unit="px")
