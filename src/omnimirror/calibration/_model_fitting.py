"""Fit of a camera model to the projection of another camera over its field.

Rays are sampled on a grid of pixels; linear least squares give initial models of each kind, which
nonlinear least squares refine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.numerics import damped_step, levenberg_marquardt
from ..base.typing import Array
from ..cameras.camera import Camera, Mount, rotate_vectors
from ..cameras.models import (
    CameraModel,
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    OCam,
    PointImages,
    RationalPinhole,
    ThinPrismFisheye,
    Unified,
)

# -- Sampled rays in the frame of camera files -----------------------------------------------------

N_OUTERMOST_PIXELS = 60  # number of pixels at the maximum field angle
SAME_DIRECTION_RAD = 1e-9  # radians
MIN_PIXELS = 20  # minimum number of pixels in a part of the field, for a fit
MAX_CENTRAL_OFFSET_MM = 1e-9  # maximum distance of rays from the origin for a central camera


@dataclass(frozen=True)
class Sample:
    """Pixels of a camera and their rays in the camera frame (X right, Y down, Z ahead).

    Attributes
    ----------
    pixels : (n, 2) px
        Pixels.
    origins : (n, 3) mm
        Ray origins.
    directions : (n, 3) unit vectors
        Ray directions.
    is_backward_facing
        Whether the image centre is directed towards -Z.
    mount
        Orientation of the camera.
    """

    pixels: Array
    origins: Array
    directions: Array
    is_backward_facing: bool
    mount: Mount

    @property
    def is_central(self) -> bool:
        """True if all rays start at the origin."""
        return not np.abs(self.origins).max() > MAX_CENTRAL_OFFSET_MM

    @property
    def omega(self) -> Array:
        """Field angles (n,), radians from the viewing direction at the image centre."""
        x, y, z = self.file_directions.T
        omega: Array = np.arctan2(np.hypot(x, y), z)
        return omega

    @property
    def file_directions(self) -> Array:
        """Directions (n, 3) in the frame of files: right, down, and central viewing direction."""
        file_directions: Array = self.directions * self.signs
        return file_directions

    @property
    def signs(self) -> Array:
        """Signs (3,) that convert directions from the camera frame to the frame of files."""
        return np.array(
            [
                -1.0 if self.mount.image_flipped else 1.0,
                1.0,
                -1.0 if self.is_backward_facing else 1.0,
            ]
        )

    def points(self, distance_mm: float) -> Array:
        """Return points (n, 3) mm on the rays at a distance from the origin.

        Directions are returned for an infinite distance.
        """
        if np.isinf(distance_mm):
            return self.directions
        along = np.sum(self.origins * self.directions, axis=1)
        discriminant = distance_mm**2 - np.sum(self.origins**2, axis=1) + along**2
        if discriminant.min() < 0:
            raise InvalidParameter(
                "distance_mm must be larger than the distances of the ray origins, up to "
                f"{np.linalg.norm(self.origins, axis=1).max():.4g} mm; got {distance_mm:g}"
            )
        # |o + t d| = distance: t = -o.d + sqrt(distance^2 - |o|^2 + (o.d)^2)
        points: Array = self.origins + (np.sqrt(discriminant) - along)[:, None] * self.directions
        return points

    def within(self, field_deg: float | None, inner_deg: float | None) -> Sample:
        """Return the part between two field angles; None for no limit.

        Raises
        ------
        InvalidParameter
            If no pixel of the camera is there.
        """
        bounds = {"inner_deg": inner_deg, "field_deg": field_deg}
        limits = [f"{name} = {value:g}" for name, value in bounds.items() if value is not None]
        if not limits:
            return self
        low, high = (
            0.0 if inner_deg is None else inner_deg,
            180.0 if field_deg is None else field_deg,
        )
        inside = (self.omega >= np.radians(low)) & (self.omega <= np.radians(high))
        if inside.sum() < MIN_PIXELS:
            raise InvalidParameter(
                "inner_deg and field_deg must include part of the field, "
                f"{np.degrees(self.omega.min()):.4g} to {np.degrees(self.omega.max()):.4g} "
                f"deg from the axis; got {' and '.join(limits)}"
            )
        return replace(
            self,
            pixels=self.pixels[inside],
            origins=self.origins[inside],
            directions=self.directions[inside],
        )

    def with_rim_of(self, other: Sample) -> Sample:
        """Return this sample with the outermost pixels of a denser one, to cover the whole field."""
        outermost = np.sort(other.omega)[-N_OUTERMOST_PIXELS:][0] - SAME_DIRECTION_RAD
        is_outermost = other.omega >= outermost
        return replace(
            self,
            pixels=np.concatenate([self.pixels, other.pixels[is_outermost]]),
            origins=np.concatenate([self.origins, other.origins[is_outermost]]),
            directions=np.concatenate([self.directions, other.directions[is_outermost]]),
        )


def sample(camera: Camera, mount: Mount, count: int) -> Sample:
    """Sample about ``count`` visible pixels over the whole image.

    Raises
    ------
    InvalidParameter
        If no pixel is visible.
    """
    width, height = camera.image_size
    step = np.sqrt(width * height / count)
    columns, rows = (np.linspace(0, n - 1, max(3, round(n / step))) for n in (width, height))
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    origins, directions, valid = camera.backproject(pixels)
    if not valid.any():
        raise InvalidParameter("camera must have at least one pixel with a ray; got none")
    to_camera = mount.rotation()
    return Sample(
        pixels[valid],
        rotate_vectors(origins[valid], to_camera),
        rotate_vectors(directions[valid], to_camera),
        _is_backward_facing(camera, pixels[valid], rotate_vectors(directions[valid], to_camera)),
        mount,
    )


def _is_backward_facing(camera: Camera, pixels: Array, directions: Array) -> bool:
    """Return whether the image centre is directed towards -Z, from the camera or its central
    pixels.
    """
    specified = getattr(camera, "is_backward_facing", None)
    if isinstance(specified, bool):
        return specified
    centre = np.array(
        camera.symmetry.centre_px if camera.symmetry else np.array(camera.image_size) / 2
    )
    nearest = np.argsort(np.linalg.norm(pixels - centre, axis=1))[: max(8, len(pixels) // 50)]
    outermost = np.argsort(np.linalg.norm(pixels - centre, axis=1))[-max(8, len(pixels) // 50) :]
    return bool(directions[nearest, 2].mean() < directions[outermost, 2].mean())


# -- Initial models by linear least squares --------------------------------------------------------

MAX_PINHOLE_ANGLE = np.radians(89.9)
ODD_POWERS = (1, 3, 5, 7)  # powers of the field angle in a smooth rotationally symmetric projection


@dataclass(frozen=True)
class RotationalProjection:
    """Projection as matrix, centre, and radius as a function of the field angle."""

    centre_px: tuple[float, float]
    matrix: Array
    """Matrix (2, 2) from the symmetric image to the real one, both (right, down), near identity."""
    omega: Array
    """Field angles (n,), radians."""
    radius: Array
    """Radii (n,) px in the symmetric image."""
    common: dict[str, Any]
    """Common arguments of all models: size, optics, mount."""

    def least_squares(self, radii: Array) -> tuple[float, float]:
        """Return the focal length of ``r = f law(Omega)`` and the rms residual in px."""
        f = float(radii @ self.radius / (radii @ radii))
        return f, float(np.sqrt(np.mean((f * radii - self.radius) ** 2)))


def rotational_projection(sample: Sample, image_size: tuple[int, int]) -> RotationalProjection:
    """Estimate centre, matrix and radii of a sample by two linear least-squares fits.

    The first fit is rotationally symmetric, the second includes the matrix.
    """
    x, y, _ = sample.file_directions.T
    omega = sample.omega
    length = np.maximum(np.hypot(x, y), 1e-300)
    side = np.stack([x / length, y / length], axis=-1)
    powers = (omega[:, None] / omega.max()) ** np.array(ODD_POWERS)
    n = len(omega)
    columns = np.zeros((n, 2, 2 + len(ODD_POWERS)))
    columns[:, 0, 0] = columns[:, 1, 1] = 1.0
    columns[:, :, 2:] = side[:, :, None] * powers[:, None, :]
    coefficients = np.linalg.lstsq(
        columns.reshape(2 * n, -1), sample.pixels.reshape(-1), rcond=None
    )[0]
    radius = powers @ coefficients[2:]
    flat = np.column_stack([radius[:, None] * side, np.ones(n)])
    solution = np.linalg.lstsq(flat, sample.pixels, rcond=None)[0]
    matrix, centre = solution[:2].T, solution[2]
    if not np.linalg.det(matrix) > 1e-3:
        raise InvalidParameter(
            "the image radius must increase with the field angle around a centre; no model fits this camera"
        )
    plane = (sample.pixels - centre) @ np.linalg.inv(matrix).T
    u, v = (float(x) for x in centre)
    common: dict[str, Any] = {
        "centre_px": (u, v),
        "image_size": image_size,
        "optics": "mirror" if sample.is_backward_facing else "fisheye",
        "mount": sample.mount,
    }
    return RotationalProjection((u, v), matrix, omega, np.sum(plane * side, axis=1), common)


def initial_models(
    kind: type[CameraModel], parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    """Yield initial models of a kind, simplest first.

    Parameters
    ----------
    kind
        Class of the camera model.
    parameters
        Names of parameters that may differ from 0; None for all.
    projection
        Projection to approximate.

    Raises
    ------
    InvalidParameter
        If the kind cannot cover the field; the message states the reason.
    """
    yield from INITIAL_MODELS[kind](parameters, projection)


def _focal(
    f: float, parameters: frozenset[str] | None, projection: RotationalProjection
) -> dict[str, Any]:
    (a, skew), (_, d) = projection.matrix
    arguments = {"focal_px": (float(a * f), float(d * f)), **projection.common}
    if parameters is None or "skew" in parameters:
        arguments["skew_px"] = float(skew * f)
    return arguments


def _kannala_brandt(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    """Yield the fit of ``r = f (Omega + k1 Omega^3 + ...)``, which is linear in f and f k."""
    scale = projection.omega.max()
    powers = 2 * np.arange(5) + 1
    coefficients = np.linalg.lstsq(
        (projection.omega / scale)[:, None] ** powers, projection.radius, rcond=None
    )[0]
    f, *rest = coefficients / scale**powers
    ks: dict[str, Any] = {f"k{i}": float(value / f) for i, value in enumerate(rest, start=1)}
    kind = ThinPrismFisheye if parameters is not None and "k6" in parameters else KannalaBrandt
    yield kind(**_focal(f, parameters, projection), **ks)


def _unified(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    """Yield models with the best xi below and above 1, or a pinhole if xi is fixed."""
    if parameters is not None and "xi" not in parameters:
        yield from _pinhole(Unified, {"xi": 0.0}, parameters, projection)
        return
    models: list[CameraModel] = []
    error = InvalidParameter("")
    for xi in (np.linspace(0.0, 1.0, 41), np.linspace(1.0, 3.0, 41)):
        try:
            models.append(
                Unified(
                    **_best(
                        projection,
                        parameters,
                        _unified_radius,
                        lambda o, xi: np.cos(o) + xi,
                        {"xi": xi},
                    )
                )
            )
        except InvalidParameter as e:
            error = e
    if not models:
        raise error
    yield from models


def _pinhole(
    kind: Any,
    fixed: dict[str, float],
    parameters: frozenset[str] | None,
    projection: RotationalProjection,
) -> Iterator[CameraModel]:
    """Yield the fit of ``r = f (t + k1 t^3 + k2 t^5 + k3 t^7)`` with ``t = tan(Omega)``.

    The number of terms is the maximum for which the projection does not fold within the field.
    """
    if not projection.omega.max() < MAX_PINHOLE_ANGLE:
        raise InvalidParameter(
            f"does not cover the field of {np.degrees(projection.omega.max()):.4g} deg "
            "from the axis: a pinhole projection is limited to less than 90 deg"
        )
    tan = np.tan(projection.omega)
    scale = tan.max()
    for terms in (4, 3, 2, 1):
        powers = 2 * np.arange(terms) + 1
        f, *rest = (
            np.linalg.lstsq((tan / scale)[:, None] ** powers, projection.radius, rcond=None)[0]
            / scale**powers
        )
        if f > 0:
            ks: dict[str, Any] = {
                f"k{i}": float(value / f) for i, value in enumerate(rest, start=1)
            }
            model: CameraModel = kind(**fixed, **_focal(float(f), parameters, projection), **ks)
            if model.image(_boundary_directions(projection), distant=True).valid.all():
                yield model
                return


def _boundary_directions(projection: RotationalProjection) -> Array:
    """Return directions (n, 3) around the boundary of the field, in the camera frame."""
    phi = np.linspace(0, 2 * np.pi, 16)
    ahead = -1.0 if projection.common["optics"] == "mirror" else 1.0
    omega = projection.omega.max()
    return np.stack(
        [
            np.sin(omega) * np.cos(phi),
            np.sin(omega) * np.sin(phi),
            np.full(16, ahead * np.cos(omega)),
        ],
        -1,
    )


def _unified_radius(omega: Array, xi: float) -> Array:
    return np.asarray(np.sin(omega) / (np.cos(omega) + xi))


def _rational(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    """Yield a pinhole model without denominator."""
    yield from _pinhole(RationalPinhole, {}, parameters, projection)


def _enhanced(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    def depth(o: Array, alpha: float, beta: float) -> Array:
        return np.asarray(
            alpha * np.sqrt(beta * np.sin(o) ** 2 + np.cos(o) ** 2) + (1 - alpha) * np.cos(o)
        )

    grid = {"alpha": np.linspace(0.02, 0.98, 25), "beta": np.geomspace(0.3, 4.0, 25)}
    yield EnhancedUnified(
        **_best(projection, parameters, lambda o, a, b: np.sin(o) / depth(o, a, b), depth, grid)
    )


def _double(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    def depth(o: Array, xi: float, alpha: float) -> Array:
        z = xi + np.cos(o)
        return np.asarray(alpha * np.hypot(np.sin(o), z) + (1 - alpha) * z)

    grid = {"xi": np.linspace(-0.9, 0.95, 25), "alpha": np.linspace(0.02, 0.98, 25)}
    yield DoubleSphere(
        **_best(projection, parameters, lambda o, xi, a: np.sin(o) / depth(o, xi, a), depth, grid)
    )


def _best(
    projection: RotationalProjection,
    parameters: frozenset[str] | None,
    radius_of: Callable[..., Array],
    depth: Callable[..., Array],
    grid: dict[str, Array],
) -> dict[str, Any]:
    """Return the arguments of the best fit among models with increasing radius over the field."""
    omega = np.linspace(0.0, projection.omega.max(), 200)
    best, arguments = np.inf, None
    for values in product(*grid.values()):
        with np.errstate(all="ignore"):
            is_increasing = (depth(omega, *values) > 1e-3).all() and (
                np.diff(radius_of(omega, *values)) > 0
            ).all()
        if is_increasing:
            f, residual = projection.least_squares(radius_of(projection.omega, *values))
            if residual < best:
                best = residual
                arguments = {
                    **dict(zip(grid, map(float, values), strict=True)),
                    **_focal(f, parameters, projection),
                }
    if arguments is None:
        raise InvalidParameter(
            f"does not cover the field of {np.degrees(projection.omega.max()):.4g} deg from the axis"
        )
    return arguments


def _ocam(
    parameters: frozenset[str] | None, projection: RotationalProjection
) -> Iterator[CameraModel]:
    """Yield fits of ``f(rho) sin(Omega) = -rho cos(Omega)``, linear in the coefficients."""
    (a, e), (d, c) = projection.matrix
    rho = a * projection.radius
    scale = rho.max()
    for degree in (4,) if parameters is not None else (4, 6, 8):
        powers = np.array([0, *range(2, degree + 1)])
        terms = (rho / scale)[:, None] ** powers * np.sin(projection.omega)[:, None]
        coefficients = (
            np.linalg.lstsq(terms, -rho * np.cos(projection.omega), rcond=None)[0] / scale**powers
        )
        polynomial = (float(coefficients[0]), 0.0, *map(float, coefficients[1:]))
        is_round = parameters is not None and "c" not in parameters
        affine = (1.0, 0.0, 0.0) if is_round else (float(c / a), float(d / a), float(e / a))
        yield OCam(polynomial=polynomial, affine=affine, **projection.common)


INITIAL_MODELS: dict[
    type[Any], Callable[[frozenset[str] | None, RotationalProjection], Iterator[CameraModel]]
] = {
    KannalaBrandt: _kannala_brandt,
    ThinPrismFisheye: _kannala_brandt,
    RationalPinhole: _rational,
    Unified: _unified,
    EnhancedUnified: _enhanced,
    DoubleSphere: _double,
    OCam: _ocam,
}


# -- Nonlinear least-squares fit -------------------------------------------------------------------

MAX_STEPS = 80
RELATIVE_TOLERANCE = 1e-10  # relative decrease of the sum of squares that ends the iteration
EXACT_PX = 1e-8  # rms error that ends the iteration


class Cost(NamedTuple):
    """Reprojection error of a fitted model for points at one distance."""

    distance_mm: float
    """Distance from the camera's origin; infinite for distant points."""
    rms_px: float
    largest_px: float
    at_px: tuple[float, float]
    """Pixel of the maximum error."""
    at_deg: float
    """Field angle there, deg from the axis."""


@dataclass(frozen=True)
class FittedModel:
    """Fitted model, with its viewpoint in the camera frame of the original camera, mm."""

    model: CameraModel
    viewpoint_mm: Array


def fit_model(
    start: CameraModel, sample: Sample, free: list[bool], distances_mm: tuple[float, ...]
) -> FittedModel:
    """Fit a model's parameters to the pixels of a sample for points at several distances.

    Levenberg-Marquardt iteration with the analytic derivatives of the model. For a camera without a
    single viewpoint, the viewpoint of the model is also estimated.

    Parameters
    ----------
    start
        Initial value.
    sample
        Pixels and rays of the camera.
    free
        Mask of free parameters of ``start``.
    distances_mm
        Distances with equal weights; irrelevant for a central camera.
    """
    problem = _Problem(start, sample, np.flatnonzero(free), distances_mm)

    def linearise(state: _FitState) -> Callable[[float], _FitState]:
        return lambda damping: problem.evaluate(
            state.x + damped_step(state.normal, state.gradient, damping)
        )

    exact_cost = EXACT_PX**2 * len(sample.pixels)
    start_state = problem.evaluate(np.zeros(problem.count))
    fitted = levenberg_marquardt(start_state, linearise, MAX_STEPS, RELATIVE_TOLERANCE, exact_cost)
    return problem.at(fitted.x)


class _FitState(NamedTuple):
    """Sum of squares (infinite for invalid cameras) with its normal equations after a step x."""

    x: Array
    cost: float
    gradient: Array
    normal: Array


class _Problem:
    """Sum of squares of a fit, in units of typical parameter changes.

    The free parameters are followed by the viewpoint for a non-central camera, and by a rotation
    about the axis for models without such a parameter (OCamCalib's e, which calibration assigns to
    the camera pose). Formats without the affine matrix have no rotation.
    """

    def __init__(
        self,
        start: CameraModel,
        sample: Sample,
        free: NDArray[np.intp],
        distances_mm: tuple[float, ...],
    ) -> None:
        self.start, self.sample, self.free = start, sample, free
        self.values = np.array([p.value for p in start.parameters])
        self.scale = np.array([p.scale for p in start.parameters])
        self.distances = (np.inf,) if sample.is_central else distances_mm
        self.moves = not sample.is_central and bool(np.isfinite(distances_mm).any())
        self.turns = isinstance(start, OCam) and "d" in {start.parameters[i].name for i in free}
        self.first = sample.origins.mean(axis=0) if self.moves else np.zeros(3)
        self.count = len(free) + 3 * self.moves + self.turns

    def at(self, x: Array) -> FittedModel:
        """Return the model after a step."""
        p = len(self.free)
        values = self.values.copy()
        values[self.free] += self.scale[self.free] * x[:p]
        model = self.start.with_parameters(values)
        if self.turns:
            assert isinstance(model, OCam)
            model = replace(model, affine=_rotated_stretch(model.affine, float(x[-1])))
        return FittedModel(model, self.first + (x[p : p + 3] if self.moves else 0.0))

    def evaluate(self, x: Array) -> _FitState:
        """Return the sum of squares and its normal equations after a step."""
        invalid = _FitState(x, np.inf, np.zeros(self.count), np.eye(self.count))
        try:
            model, viewpoint = (fitted := self.at(x)).model, fitted.viewpoint_mm
        except OmnimirrorError:
            return invalid
        total, gradient, normal = 0.0, np.zeros(self.count), np.zeros((self.count, self.count))
        for distance in self.distances:
            distant = bool(np.isinf(distance))
            points = self.sample.points(distance) - (0.0 if distant else viewpoint)
            image = model.image(points, distant=distant)
            if not image.valid.all():
                return invalid
            residual = (image.pixels - self.sample.pixels).reshape(-1)
            slopes = self._slopes(image, points, distant)
            total += float(residual @ residual)
            gradient += slopes.T @ residual
            normal += slopes.T @ slopes
        return _FitState(x, total, gradient, normal)

    def _slopes(self, image: PointImages, points: Array, distant: bool) -> Array:
        """Return the derivatives (2 n, count) of the pixels."""
        n, p = len(points), len(self.free)
        slopes = np.zeros((n, 2, self.count))
        slopes[:, :, :p] = image.d_parameters[:, :, self.free] * self.scale[self.free]
        if self.moves and not distant:
            slopes[:, :, p : p + 3] = -image.d_points
        if self.turns:
            signs = self.sample.signs
            x, y, _ = (points * signs).T
            slopes[:, :, -1] = (
                image.d_points[:, :, 0] * (-y * signs[0])[:, None]
                + image.d_points[:, :, 1] * x[:, None]
            )
        return slopes.reshape(2 * n, self.count)


def _rotated_stretch(
    affine: tuple[float, float, float], angle: float
) -> tuple[float, float, float]:
    """Return OCamCalib's c, d, e after a prior image rotation (radians), up to scale."""
    c, d, e = affine
    cos, sin = np.cos(angle), np.sin(angle)
    (a, upper), (lower, last) = np.array([[1.0, e], [d, c]]) @ [[cos, -sin], [sin, cos]]
    return float(last / a), float(lower / a), float(upper / a)


def reprojection_errors(fitted: FittedModel, sample: Sample, distance_mm: float) -> Cost:
    """Return the reprojection error of a model at a distance; infinite for invisible points."""
    distant = bool(np.isinf(distance_mm))
    points = sample.points(distance_mm)
    image = fitted.model.image(points if distant else points - fitted.viewpoint_mm, distant=distant)
    error = np.where(image.valid, np.hypot(*(image.pixels - sample.pixels).T), np.inf)
    return _cost_summary(error, sample, distance_mm)


def nearest_point_to_rays(origins: Array, directions: Array) -> Array:
    """Return the point (3,) with the minimum sum of squared distances from rays (n, 3).

    It is the viewpoint of a panorama.

    >>> nearest_point_to_rays(np.array([[1.0, 0, 0], [0, 2.0, 0]]), np.array([[1.0, 0, 0], [0, 1.0, 0]])).round(12)
    array([0., 0., 0.])
    """
    across = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    # normal equations of sum |(I - d d^T)(x - o)|^2
    return np.linalg.solve(across.sum(axis=0), np.einsum("nij,nj->i", across, origins))


def parallax(
    sample: Sample, viewpoint_mm: Array, distance_mm: float, pixels_per_degree: float
) -> Cost:
    """Return the parallax error of near points in a panorama with the directions of distant points."""
    towards = sample.points(distance_mm) - (0.0 if np.isinf(distance_mm) else viewpoint_mm)
    across = np.linalg.norm(np.cross(towards, sample.directions), axis=1)
    angle = np.arctan2(across, np.sum(towards * sample.directions, axis=1))
    error = np.degrees(angle) * pixels_per_degree
    return _cost_summary(error, sample, distance_mm)


def _cost_summary(error: Array, sample: Sample, distance_mm: float) -> Cost:
    """Return the summary of errors (n,) px."""
    index = int(np.argmax(error))
    u, v = sample.pixels[index]
    return Cost(
        distance_mm,
        float(np.sqrt(np.mean(error**2))),
        float(error[index]),
        (float(u), float(v)),
        float(np.degrees(sample.omega[index])),
    )
