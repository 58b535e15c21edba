"""Sequence of camera models of increasing complexity, each started at the fit of a simpler one.

The first model starts at poses from a linear estimate and the stereographic projection.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...base.arguments import choice, instance
from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.typing import Array
from ...cameras.camera import Mount, inside_image, rotate_vectors
from ...cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    OCam,
    RadialSpline,
    Unified,
    ViewpointSpline,
)
from ...cameras.models.camera_model import CameraModel
from ..sensor_model import SensorModel, estimate_mirror_size
from ._bundle_adjustment import MAX_STEPS, BundleAdjustment, Prior, bundle_adjust
from .observation_checks import check_start, inconsistent_images
from .observations import UNSEEN_PX, BoardShape, Observation, RigidTransform, residuals_at_poses

# -- Initial poses without a prior -----------------------------------------------------------------

MIN_POINTS, MIN_DIRECTIONS = 6, 3  # minimum numbers of points and of directions of a target
PLANAR_DEPTH = 1e-3  # relative to its extent; a target with smaller depth is treated as planar


def linear_pose(observation: Observation, bearings: Array) -> RigidTransform | None:
    """Return the pose of a target observed at bearings (n, 3) in the camera frame.

    None if there are too few points, they are collinear or coincide in direction, or they are
    mirrored.
    """
    if not observation.is_surveyed:
        return board_pose(bearings, observation.points) if len(observation) >= MIN_POINTS else None
    is_distant = observation.distant
    candidates = []
    if is_distant.sum() >= MIN_DIRECTIONS:
        candidates.append(_among_directions(observation, bearings))
    if (~is_distant).sum() >= MIN_POINTS:
        candidates.append(_among_points(bearings[~is_distant], observation.points[~is_distant]))
    poses = [pose for pose in candidates if pose is not None]
    return min(poses, key=lambda pose: _median_error(observation, pose, bearings), default=None)


def _median_error(observation: Observation, pose: RigidTransform, bearings: Array) -> float:
    """Return the median sine of the angular residuals."""
    directions = observation.in_camera_frame(pose)
    directions = directions / np.linalg.norm(directions, axis=1)[:, None]
    return float(np.median(np.linalg.norm(directions - bearings, axis=1)))


def _among_directions(observation: Observation, bearings: Array) -> RigidTransform | None:
    """Return the rotation by Kabsch's method, and the translation that fits the points."""
    is_distant = observation.distant
    directions = (
        observation.points[is_distant]
        / np.linalg.norm(observation.points[is_distant], axis=1)[:, None]
    )
    u, size, vt = np.linalg.svd(bearings[is_distant].T @ directions)
    if not size[1] > 1e-6 * size[0]:
        return None
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    if is_distant.all():
        return RigidTransform(rotation, np.zeros(3))
    projectors = (
        np.eye(3) - bearings[~is_distant][:, :, None] * bearings[~is_distant][:, None, :]
    )  # (I - b b^T)(R p + t) = 0
    rotated = observation.points[~is_distant] @ rotation.T
    translation = -np.linalg.lstsq(
        projectors.sum(axis=0), np.einsum("nij,nj->i", projectors, rotated), rcond=None
    )[0]
    return RigidTransform(rotation, translation)


def _among_points(bearings: Array, points_mm: Array) -> RigidTransform | None:
    """Return the pose of points in space from ``b x (P p) = 0``, or from a homography if coplanar."""
    centroid = points_mm.mean(axis=0)
    _, extents, axes = np.linalg.svd(points_mm - centroid, full_matrices=False)
    if not extents[2] > PLANAR_DEPTH * extents[0]:
        frame = np.stack([axes[0], axes[1], np.cross(axes[0], axes[1])])
        board = board_pose(bearings, (points_mm - centroid) @ frame.T)
        return (
            None
            if board is None
            else RigidTransform(
                board.rotation @ frame, board.translation_mm - board.rotation @ frame @ centroid
            )
        )
    size = float(extents[0]) / np.sqrt(len(points_mm))
    p = np.column_stack([(points_mm - centroid) / size, np.ones(len(points_mm))])
    solution = _linear(bearings, p)
    if solution is None or np.linalg.det(solution[:, :3]) <= 0:
        return None
    u, scales, vt = np.linalg.svd(solution[:, :3])
    rotation = u @ vt
    return RigidTransform(rotation, solution[:, 3] * size / scales.mean() - rotation @ centroid)


def _linear(bearings: Array, p: Array) -> Array | None:
    """Return the matrix (3, k) that maps p (n, k) to bearings (n, 3), up to scale.

    Unlike for pinhole cameras, bearings may exceed 90 deg from the axis: the sign is the one for
    which the mapped points agree with the bearings.
    """
    zero = np.zeros_like(p)
    bx, by, bz = bearings.T[:, :, None]
    rows = np.concatenate(
        [
            np.concatenate([zero, -bz * p, by * p], axis=1),
            np.concatenate([bz * p, zero, -bx * p], axis=1),
            np.concatenate([-by * p, bx * p, zero], axis=1),
        ]
    )
    _, values, vectors = np.linalg.svd(rows.T @ rows)
    if not values[-2] > 1e-12 * values[0]:
        return None
    matrix = vectors[-1].reshape(3, -1)
    return np.asarray(
        -matrix if np.median(np.sum(bearings * (p @ matrix.T), axis=1)) < 0 else matrix
    )


def board_pose(bearings: Array, points_mm: Array) -> RigidTransform | None:
    """Estimate the pose of a flat board from bearings (n, 3) by a linear homography.

    ``b x (H p) = 0`` for all points. The columns of H are two axes of the board and its position,
    up to a common factor.

    Parameters
    ----------
    bearings : (n, 3)
        Unit vectors in the camera frame.
    points_mm : (n, 3)
        Points of the board with z = 0.

    Returns
    -------
    RigidTransform or None
        None if the points are collinear, or coincide in direction.
    """
    flat = points_mm[:, :2]
    centroid, size = flat.mean(axis=0), float(np.abs(flat - flat.mean(axis=0)).max())
    if not size > 0:
        return None
    h = _linear(bearings, np.column_stack([(flat - centroid) / size, np.ones(len(flat))]))
    if h is None:
        return None
    # h = (r1, r2, t) up to scale; the nearest orthonormal pair r1, r2 by SVD
    a, b = np.linalg.norm(h[:, 0]), np.linalg.norm(h[:, 1])
    if not min(a, b) > 0:
        return None
    u, _, vt = np.linalg.svd(np.column_stack([h[:, 0] / a, h[:, 1] / b]), full_matrices=False)
    axes = u @ vt
    rotation = np.column_stack([axes, np.cross(axes[:, 0], axes[:, 1])])
    translation = h[:, 2] * size * 2 / (a + b)
    return RigidTransform(rotation, translation - rotation[:, :2] @ centroid)


# -- Stereographic initial camera ------------------------------------------------------------------
#
# With xi = 1 the unified model is the stereographic projection ``r = f tan(Omega / 2)``, which
# approximates every mirror and fisheye sufficiently. For each of a series of focal lengths, corners
# are back-projected to the unit sphere, each target is placed by linear equations, and the median
# residuals in pixels are compared. (Angular residuals are unsuitable: they vanish for focal lengths
# so short that all corners coincide.)

FOCALS = 25
FOCAL_RANGE = (0.08, 1.6)  # relative to the larger image side


class StereographicStart(NamedTuple):
    """Stereographic camera with board poses."""

    focal_px: float
    centre_px: tuple[float, float]
    poses: tuple[RigidTransform | None, ...]
    """Poses; None for boards that could not be placed."""
    median_px: float
    """Median residual."""


def stereographic_start(
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    centre_px: tuple[float, float],
    signs: Array,
) -> StereographicStart:
    """Return the focal length and the board poses with the smallest median residual.

    ``signs`` (3,) are the signs of right, down and the viewing direction at the image centre along
    X, Y and Z of the camera.
    """
    larger = max(image_size)
    focals = np.geomspace(FOCAL_RANGE[0] * larger, FOCAL_RANGE[1] * larger, FOCALS)
    starts = [_start_at(float(f), observations, centre_px, signs) for f in focals]
    return min(starts, key=lambda s: s.median_px)


def _start_at(
    focal_px: float,
    observations: Sequence[Observation],
    centre_px: tuple[float, float],
    signs: Array,
) -> StereographicStart:
    poses: list[RigidTransform | None] = []
    lengths = []
    for observation in observations:
        bearings = stereographic_bearings(observation.pixels, focal_px, centre_px, signs)
        pose = linear_pose(observation, bearings)
        poses.append(pose)
        if pose is not None:
            pixels = stereographic_pixels(
                observation.in_camera_frame(pose), focal_px, centre_px, signs
            )
            lengths.append(np.hypot(*(pixels - observation.pixels).T))
    median = float(np.median(np.concatenate(lengths))) if lengths else np.inf
    return StereographicStart(focal_px, centre_px, tuple(poses), median)


def stereographic_bearings(
    pixels: Array, focal_px: float, centre_px: tuple[float, float], signs: Array
) -> Array:
    """Return unit directions (n, 3) in the camera frame of pixels (n, 2) of a stereographic camera.

    >>> stereographic_bearings(np.array([[200.0, 100.0]]), 100.0, (100.0, 100.0), np.array([1, 1, -1])).round(12) + 0.0
    array([[1., 0., 0.]])
    """
    x, y = (pixels - centre_px).T / focal_px
    s = x * x + y * y
    return np.asarray(
        np.stack([2 * x / (1 + s), 2 * y / (1 + s), (1 - s) / (1 + s)], axis=1) * signs
    )


def stereographic_pixels(
    points: Array, focal_px: float, centre_px: tuple[float, float], signs: Array
) -> Array:
    """Return pixels (n, 2) of points (n, 3) in a stereographic camera."""
    right, down, forward = (points * signs).T
    denominator = np.maximum(np.linalg.norm(points, axis=1) + forward, 1e-9)
    return np.asarray(centre_px + focal_px * np.stack([right, down], axis=1) / denominator[:, None])


# -- Model sequence --------------------------------------------------------------------------------

ModelConstructor = Callable[[Unified, float], CameraModel]
"""Constructor of a model that approximates a unified one up to a field angle in deg."""


def _unified(u: Unified, omega_max_deg: float) -> CameraModel:
    return u


def _enhanced(u: Unified, omega_max_deg: float) -> CameraModel:
    return EnhancedUnified(
        alpha=u.xi / (1 + u.xi),
        beta=1.0,
        focal_px=_focal(u),
        centre_px=u.centre_px,
        image_size=u.image_size,
        optics=u.optics,
        mount=u.mount,
    )


def _double(u: Unified, omega_max_deg: float) -> CameraModel:
    return DoubleSphere(
        xi=0.0,
        alpha=u.xi / (1 + u.xi),
        focal_px=_focal(u),
        centre_px=u.centre_px,
        image_size=u.image_size,
        optics=u.optics,
        mount=u.mount,
    )


def _kannala_brandt(u: Unified, omega_max_deg: float) -> CameraModel:
    return KannalaBrandt(
        focal_px=_focal(u),
        centre_px=u.centre_px,
        image_size=u.image_size,
        optics=u.optics,
        mount=u.mount,
    )


def _ocam(u: Unified, omega_max_deg: float) -> CameraModel:
    """Return an OCam model; stereographic: ``f(rho) = (rho^2 - f^2) / (2 f)``."""
    f = 2 * u.scale_px / (1 + u.xi)
    polynomial = (-f / 2, 0.0, 1 / (2 * f), 0.0, 0.0)
    return OCam(
        polynomial=polynomial,
        centre_px=u.centre_px,
        image_size=u.image_size,
        optics=u.optics,
        mount=u.mount,
    )


def _radial_spline(u: Unified, omega_max_deg: float) -> CameraModel:
    return RadialSpline.from_model(u, field_deg=2 * omega_max_deg)


def _viewpoint_spline(u: Unified, omega_max_deg: float) -> CameraModel:
    return ViewpointSpline.from_model(u, field_deg=2 * omega_max_deg)


def _mirror(u: Unified, omega_max_deg: float) -> CameraModel:
    return SensorModel.from_central_model(u, omega_max_deg=omega_max_deg)


def mirror_from_viewpoints(
    central: Unified, fit: BundleAdjustment, omega_max_deg: float
) -> SensorModel | None:
    """Return an initial mirror model with the size given by fitted viewpoints.

    None if the size is undetermined.

    Parameters
    ----------
    central
        Model of the projection of distant points.
    fit
        Fit of a :class:`~omnimirror.cameras.models.ViewpointSpline`, with corner positions.
    omega_max_deg
        Maximum field angle of the observations.
    """
    model = fit.model
    assert isinstance(model, ViewpointSpline)
    end = min(omega_max_deg, _degrees(central.model_end))
    corners = np.concatenate(
        [s.pose(s.points[~s.distant]) for s in fit.observations if s.pose is not None]
    )
    omega = np.arctan2(np.hypot(corners[:, 0], corners[:, 1]), -corners[:, 2])
    omega = np.sort(omega[omega < np.radians(end)])[:: max(1, len(omega) // MAX_SIZE_CORNERS)]
    try:
        guess = estimate_mirror_size(central, end, omega, -model._viewpoint_mm(omega))
    except OmnimirrorError:  # a mirror with such a mapping would fold before its rim
        return None
    if guess is None:
        return None
    rim, distance = guess
    return SensorModel.from_central_model(
        central, omega_max_deg=end, rim_radius_mm=rim, distance_mm=distance
    )


KINDS: dict[str, ModelConstructor] = {
    "unified": _unified,
    "enhanced-unified": _enhanced,
    "double-sphere": _double,
    "kannala-brandt": _kannala_brandt,
    "ocam": _ocam,
    "radial-spline": _radial_spline,
    "viewpoint-spline": _viewpoint_spline,
    "sensor": _mirror,
}
"""Constructors by name in files and on the command line; the physical mirror sensor is last."""
RIM_MM, FARTHER = 40.0, 6.0  # unknown mirror: rim radius; distance in rim radii (usual: 3 to 5)
MAX_SIZE_CORNERS = 300  # number of corners for the size estimate
REFERENCE_MODELS = ("unified", "radial-spline", "viewpoint-spline")
"""Reference models for outlier rejection.

They are the most flexible ones, and one for steep growth of the radius, which splines do not
follow.
"""


def initial_model(kind: str, central: Unified, omega_max_deg: float) -> CameraModel:
    """Return an initial model of a kind that approximates a unified model."""
    choice("model", kind, KINDS)
    instance("central", central, Unified, "a unified model")
    return KINDS[kind](central, min(omega_max_deg, _degrees(central.model_end)))


def distant_mirror_model(central: Unified, omega_max_deg: float) -> SensorModel:
    """Return an initial mirror model with a larger distance from its lens than usual."""
    end = min(omega_max_deg, _degrees(central.model_end))
    return SensorModel.from_central_model(
        central, omega_max_deg=end, distance_mm=FARTHER * RIM_MM, rim_radius_mm=RIM_MM
    )


def _focal(u: Unified) -> tuple[float, float]:
    """Return the focal lengths of models with ``r = f Omega`` near the centre."""
    return u.focal_px[0] / (1 + u.xi), u.focal_px[1] / (1 + u.xi)


def _degrees(radians: float) -> float:
    return radians * 57.29577951308232


# -- Conversion between model kinds ----------------------------------------------------------------
#
# A richer model does not converge from a distant initial value. Therefore its projection is first
# fitted to that of the simpler model, over the whole image and without corners. A model with
# several viewpoints projects near points from another position than a central one: boards are then
# shifted along the axis to minimise their residuals.

RINGS, SPOKES = 40, 24  # directions for the comparison of models
AGREEMENT_PX = 3.0  # typical parallax error of models fitted to near boards; weights priors
SHIFTS_MM = np.concatenate([-np.geomspace(600, 5, 20), [0.0], np.geomspace(5, 600, 20)])
"""Trial shifts of boards along the axis when a model with another viewpoint takes over."""


def convert_model(
    model: CameraModel,
    start: CameraModel,
    *,
    omega_max_deg: float = 170.0,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
) -> CameraModel:
    """Convert a model to another kind with the same projection of distant points.

    Parameters
    ----------
    model
        Reference model.
    start
        Initial value; parameters without effect on the agreement keep its values.
    omega_max_deg : deg
        Maximum field angle of the comparison.
    fixed, priors
        As for :func:`~omnimirror.calibration.estimation._bundle_adjustment.bundle_adjust`.

    Returns
    -------
    CameraModel
        Model of the kind of ``start``.
    """
    directions = directions_of_field(model, omega_max_deg)
    image = model.image(directions, distant=True)
    visible = image.valid.copy()
    visible[visible] = inside_image(image.pixels[visible], model.image_size)
    if visible.sum() < len(start.parameters):
        raise InvalidParameter(
            f"the model must project directions within {omega_max_deg:g} deg of its axis; got too few"
        )
    observation = Observation(
        "model",
        image.pixels[visible],
        directions[visible],
        RigidTransform.identity(),
        is_known=True,
        is_distant=True,
    )
    return bundle_adjust(
        start,
        [observation],
        fixed=fixed,
        priors=priors,
        loss="huber",
        noise_px=AGREEMENT_PX,
        max_steps=60,
    ).model


def directions_of_field(model: CameraModel, omega_max_deg: float) -> Array:
    """Return directions (n, 3) in the camera frame on a uniform grid of field angle and azimuth."""
    omega = np.radians(np.linspace(1.0, omega_max_deg, RINGS))[:, None]
    phi = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)[None, :]
    forward = -1.0 if model.optics == "mirror" else 1.0
    parts = (
        np.sin(omega) * np.cos(phi),
        np.sin(omega) * np.sin(phi),
        forward * np.cos(omega) + 0 * phi,
    )
    return np.stack([p.ravel() for p in parts], axis=1)


def farthest_angle_deg(fit: BundleAdjustment) -> float:
    """Return the maximum field angle of the observations, deg from the axis."""
    forward = -1.0 if fit.model.optics == "mirror" else 1.0
    largest = 0.0
    for observation in fit.observations:
        points = observation.in_camera_frame(observation.pose or RigidTransform.identity())
        ahead = forward * points[:, 2] / np.linalg.norm(points, axis=1)
        largest = max(largest, float(np.degrees(np.arccos(np.clip(ahead.min(), -1, 1)))))
    return largest


def is_central(model: CameraModel) -> bool:
    """Return whether a model has a single viewpoint (pixels independent of the object distance)."""
    directions = directions_of_field(model, 80.0)[::37]
    near, far = model.image(300.0 * directions), model.image(directions, distant=True)
    both = near.valid & far.valid
    return bool(both.any()) and bool(np.allclose(near.pixels[both], far.pixels[both], atol=1e-6))


def shifted_to_viewpoint(
    model: CameraModel, observations: Sequence[Observation]
) -> tuple[Observation, ...]:
    """Return near observations shifted along the axis by the common distance of minimum residuals.

    The viewpoint of a central model is elsewhere in the frame of a mirror and its camera, often
    100 mm from the origin. Without this shift, a local search does not converge.
    """
    medians = []
    for shift in SHIFTS_MM:
        linearised = residuals_at_poses(model, [_shifted(s, shift) for s in observations])
        lengths = np.where(linearised.visible, np.hypot(*linearised.residuals.T), np.inf)
        medians.append(float(np.median(lengths)))
    best = float(SHIFTS_MM[int(np.argmin(medians))])
    return tuple(_shifted(s, best) for s in observations)


def _shifted(observation: Observation, translation_mm: float) -> Observation:
    """Return an observation shifted along Z, unless it is known or entirely distant."""
    if observation.is_known or observation.distant.all() or observation.pose is None:
        return observation
    rotation, translation = observation.pose
    return observation.with_pose(
        RigidTransform(rotation, translation + np.array([0.0, 0.0, translation_mm]))
    )


# -- Stages ----------------------------------------------------------------------------------------

FIRST_FREE = (("xi", "fx", "fy", "cx", "cy"), ("fx", "fy", "cx", "cy", "k1", "k2"))
"""Alternative sets of parameters for the first adjustment; the better result is used.

With xi free, the search for mirrors may drift to solutions for which boards in any row of pixels
have similar images; with xi fixed, the search for fisheyes of 250 deg and more may diverge.
"""
ROUGH_TOLERANCE = 1e-4  # relative decrease that ends an iteration if better models follow
RADIUS_SIGMA = 0.02  # fraction of the largest radius
VIEWPOINT_SIGMA_MM = 30.0
ROUGH_START = {True: 2.0, False: 10.0}
"""Factor of the residual limit before adjustment, for boards and for surveys alone.

It is larger for surveys: boards are placed at the best pose for any camera, even a wrong one.
"""
UNPLACED = (
    "its pose cannot be estimated: at least 6 points that are not collinear, or 3 directions, "
    "are required, and their frame must be right-handed"
)
FIELD_MARGIN = (
    1.03  # maximum field angle of the model comparison relative to that of the farthest corner
)


class InitialFit(NamedTuple):
    """Result of the first stage."""

    fit: BundleAdjustment
    """Fit of a unified model."""
    inconsistent: dict[str, str]
    """Reasons for images without a consistent board pose, by name."""


def fit_first_model(
    observations: Sequence[Observation],
    image_size: tuple[int, int],
    centre_px: tuple[float, float] | None,
    optics: str,
    mount: Mount,
    *,
    fixed: tuple[str, ...] = (),
    priors: tuple[Prior, ...] = (),
) -> InitialFit:
    """Fit a unified model robustly to boards and surveyed points without poses.

    Fixed parameters keep the values of a stereographic camera without distortion.

    Raises
    ------
    InvalidParameter
        If no camera explains the corners.
    """
    width, height = image_size
    centre = centre_px or ((width - 1) / 2, (height - 1) / 2)
    model = Unified(
        xi=1.0,
        focal_px=(width / 4, width / 4),
        centre_px=centre,
        image_size=image_size,
        optics=optics,  # type: ignore[arg-type]  # checked by the model
        mount=mount,
    )
    start = stereographic_start(observations, image_size, centre, model._signs)
    boards = not all(s.is_surveyed for s in observations)
    check_start(start.median_px / ROUGH_START[boards], image_size, boards=boards)
    model = replace(model, focal_px=(start.focal_px,) * 2)
    inconsistent = {
        s.name: UNPLACED if s.is_surveyed else "its corners are collinear or coincide"
        for s, pose in zip(observations, start.poses, strict=True)
        if pose is None
    }
    posed = [
        s.with_pose(m) for s, m in zip(observations, start.poses, strict=True) if m is not None
    ]
    fit = min(
        (_fit_in_two_steps(model, posed, free, fixed, priors) for free in FIRST_FREE),
        key=lambda f: f.problem.noise_px,
    )
    check_start(_median_of(fit), image_size, boards=boards)
    inconsistent_names = inconsistent_images(fit)
    if inconsistent_names:
        inconsistent |= inconsistent_names
        consistent = [s for s in fit.observations if s.name not in inconsistent_names]
        if len(consistent) < min(2, len(observations)):
            raise InvalidParameter(
                "; ".join(f"{name}: {reason}" for name, reason in inconsistent_names.items())
            )
        fit = fit.refit(consistent, loss="cauchy", relative_tolerance=ROUGH_TOLERANCE)
    return InitialFit(fit, inconsistent)


def _fit_in_two_steps(
    model: Unified,
    observations: Sequence[Observation],
    first: tuple[str, ...],
    fixed: tuple[str, ...],
    priors: tuple[Prior, ...],
) -> BundleAdjustment:
    """Return a unified model after adjustment of some of its parameters, then of all."""
    fixed_names = (p.name for p in model.parameters if p.name not in first)
    rough = bundle_adjust(
        model,
        observations,
        fixed=(*fixed_names, *fixed),
        priors=priors,
        loss="cauchy",
        relative_tolerance=ROUGH_TOLERANCE,
    )
    return bundle_adjust(
        rough.model,
        relocate_boards(rough),
        fixed=fixed,
        priors=priors,
        loss="cauchy",
        relative_tolerance=ROUGH_TOLERANCE,
    )


def _median_of(fit: BundleAdjustment) -> float:
    """Return the median residual, px."""
    return float(np.median(np.where(fit.visible, np.hypot(*fit.residuals.T), UNSEEN_PX)))


def relocate_boards(fit: BundleAdjustment) -> tuple[Observation, ...]:
    """Return observations with boards placed through the model, if that reduces their residuals."""
    world = fit.model.mount.rotation()
    result = []
    for number, observation in enumerate(fit.observations):
        rays = fit.model.backproject(observation.pixels)
        pose = None
        if rays.valid.sum() >= len(observation) / 2 and not observation.is_known:
            pose = linear_pose(
                observation.subset(rays.valid), rotate_vectors(rays.directions[rays.valid], world)
            )
        median = _median_px(fit.model, observation, observation.pose)
        result.append(
            observation.with_pose(pose)
            if _median_px(fit.model, observation, pose) < median
            else fit.observations[number]
        )
    return tuple(result)


def _median_px(model: CameraModel, observation: Observation, pose: RigidTransform | None) -> float:
    if pose is None:
        return np.inf
    linearised = residuals_at_poses(model, [observation.with_pose(pose)])
    return float(
        np.median(np.where(linearised.visible, np.hypot(*linearised.residuals.T), UNSEEN_PX))
    )


def field_of(fit: BundleAdjustment) -> float:
    """Return the field angle (deg) of the model comparison, slightly beyond the farthest corner."""
    return min(FIELD_MARGIN * farthest_angle_deg(fit), 179.0)


def fit_next_model(
    fit: BundleAdjustment,
    start: CameraModel,
    *,
    shape: BoardShape | None = None,
    fixed: tuple[str, ...] = (),
    priors: tuple[Prior, ...] = (),
    max_steps: int = MAX_STEPS,
) -> BundleAdjustment:
    """Fit the next model: first to the projection of the previous model, then to the corners.

    Parameters
    ----------
    fit
        Fit of the previous model.
    start
        Initial value of the requested kind.
    shape
        Initial shape of the board.
    fixed, priors, max_steps
        As for :func:`~omnimirror.calibration.estimation._bundle_adjustment.bundle_adjust`.

    Returns
    -------
    BundleAdjustment
        Robust fit.
    """
    names = {p.name for p in start.parameters}
    model = convert_model(
        fit.model,
        start,
        omega_max_deg=field_of(fit),
        fixed=[n for n in fixed if n in names],
        priors=[p for p in priors if p.name in names],
    )
    observations = fit.observations
    if not is_central(model):
        observations = shifted_to_viewpoint(model, observations)
    relative_tolerance = bundle_adjust(
        model, observations, fixed=[p.name for p in model.parameters], loss="cauchy", max_steps=20
    )
    supported = (*priors, *(p for p in supports(model) if p.name not in fixed))
    return bundle_adjust(
        model,
        relative_tolerance.observations,
        shape=shape,
        fixed=fixed,
        priors=supported,
        loss="cauchy",
        relative_tolerance=ROUGH_TOLERANCE,
        max_steps=max_steps,
    )


def supports(model: CameraModel) -> tuple[Prior, ...]:
    """Return weak priors that hold splines near the previous model in regions without corners."""
    if not isinstance(model, RadialSpline | ViewpointSpline):
        return ()
    radius_sigma = RADIUS_SIGMA * model.radii_px[-1]
    sigmas = {"r": radius_sigma, "z": VIEWPOINT_SIGMA_MM}
    parameters = (p for p in model.parameters if p.name[0] in sigmas and p.name[1:].isdigit())
    return tuple(Prior(p.name, p.value, sigmas[p.name[0]]) for p in parameters)
