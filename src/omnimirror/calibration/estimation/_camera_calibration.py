"""Camera calibration from images of boards and surveyed points, without an initial value.

Includes the parallax error of single-viewpoint models at other object distances.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import (
    InvalidType,
    choice,
    format_value,
    instance,
    optional_number,
    validate_arguments,
)
from ...base.errors import InvalidParameter
from ...base.logs import OnProgress
from ...base.typing import Array
from ...cameras.camera import Mount, rotate_vectors
from ...cameras.models.camera_model import CameraModel, RadialModel
from ...cameras.models.sphere_models import Unified
from ...cameras.models.spline_models import ViewpointSpline
from ...optics.sensor import Sensor
from ..sensor_model import SensorModel
from ..straight_edges import StraightEdges
from ..targets import Board, Detection, find_boards
from ._accuracy import ParameterCovariance, uncertainty
from ._bundle_adjustment import BundleAdjustment, Prior
from ._pipeline import (
    CalibrationCancelled,
    CalibrationPlan,
    FitState,
    ParameterPriors,
    ProgressReporter,
    run,
)
from .calibration_result import Calibration, EdgeResult, ImageResult, ParameterResult
from .model_sequence import KINDS, is_central
from .observation_checks import (
    MIN_CORNERS_PER_IMAGE,
    MIN_IMAGES,
    Outlier,
    check_detections,
    coverage,
    is_used,
    joined_names,
    reason_of,
    recommendations,
    remaining_outliers,
)
from .observations import SHAPE_NAMES, BoardShape, Observation, RigidTransform, rms_px

# -- Parallax error --------------------------------------------------------------------------------

MAX_PARALLAX_PIXELS = 1000
MIN_SIGNIFICANT_GAIN = 5.0  # minimum gain in squared noise per additional parameter; chance gains 1


class ParallaxError(NamedTuple):
    """Parallax error of a single-viewpoint camera at one object distance."""

    distance_mm: float
    rms_px: float
    rms_deg: float


class ParallaxErrors(NamedTuple):
    """Parallax errors at object distances other than those of the boards."""

    boards_mm: tuple[float, float]
    """Distances of the nearest and the farthest corner."""
    near: ParallaxError
    """Error at 0.5 times the minimum board distance."""
    far: ParallaxError
    """Error at infinity."""


def parallax_errors(central: BundleAdjustment, other: BundleAdjustment) -> ParallaxErrors:
    """Estimate the parallax error of a single-viewpoint camera near and far.

    A model with several viewpoints, fitted to the same boards, is the reference: for each pixel of
    a corner it gives the object point at another distance. The common boards determine the rigid
    transform between the frames of both models.

    Parameters
    ----------
    central
        Fit with one viewpoint.
    other
        Fit with several viewpoints.
    """
    central_corners, corners = _board_corners(central, central), _board_corners(other, central)
    transform = _rigid_transform(corners, central_corners)
    pixels = np.concatenate([s.pixels for s in central.observations])
    pixels = pixels[:: -(-len(pixels) // MAX_PARALLAX_PIXELS)]
    lengths = np.linalg.norm(corners, axis=1)
    nearest, farthest = float(lengths.min()), float(lengths.max())
    near, far = (_parallax_at(central, other, pixels, transform, d) for d in (nearest / 2, np.inf))
    return ParallaxErrors((nearest, farthest), near, far)


def has_several(central: BundleAdjustment, other: BundleAdjustment) -> bool:
    """Return whether a model with several viewpoints fits the images significantly better.

    Parameters
    ----------
    central, other
        Least-squares fits with one viewpoint and with several, on the same corners.
    """
    gain = float(np.sum(central.residuals**2) - np.sum(other.residuals**2)) / other.noise_px**2
    additional = int(other.problem.free.sum()) - int(central.problem.free.sum())
    return gain > MIN_SIGNIFICANT_GAIN * max(additional, 1)


def _board_corners(fit: BundleAdjustment, of: BundleAdjustment) -> Array:
    """Return the corners (n, 3) of all boards in one fit, limited to those of another fit."""
    poses = {s.name: s.pose for s in fit.observations}
    return np.concatenate(
        [m(s.points[~s.distant]) for s in of.observations if (m := poses.get(s.name)) is not None]
    )


def _rigid_transform(points: Array, others: Array) -> RigidTransform:
    """Return the rigid transform between point sets (n, 3) by Kabsch's method."""
    centroid, other_centroid = points.mean(axis=0), others.mean(axis=0)
    u, _, vt = np.linalg.svd((others - other_centroid).T @ (points - centroid))
    # Kabsch: R = U diag(1, 1, det(U V^T)) V^T of the cross-covariance, without reflection
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return RigidTransform(rotation, other_centroid - rotation @ centroid)


def _parallax_at(
    central: BundleAdjustment,
    other: BundleAdjustment,
    pixels: Array,
    transform: RigidTransform,
    distance_mm: float,
) -> ParallaxError:
    rays, world = other.model.backproject(pixels), other.model.mount.rotation()
    starts, directions = (
        rotate_vectors(a[rays.valid], world) for a in (rays.origins, rays.directions)
    )
    is_far = np.isinf(distance_mm)
    targets = (
        directions @ transform.rotation.T
        if is_far
        else transform(starts + distance_mm * directions)
    )
    image = central.model.image(targets, distant=bool(is_far))
    errors_px = np.linalg.norm((image.pixels - pixels[rays.valid])[image.valid], axis=1)
    central_directions = rotate_vectors(
        central.model.backproject(pixels[rays.valid]).directions, central.model.mount.rotation()
    )
    errors = np.linalg.norm(
        central_directions - targets / np.linalg.norm(targets, axis=1)[:, None], axis=1
    )
    rms_px, rms = (
        float(np.sqrt(np.nanmean(e**2))) if np.isfinite(e).any() else np.nan
        for e in (errors_px, errors)
    )
    return ParallaxError(distance_mm, rms_px, float(np.degrees(rms)))


# -- Camera calibration ----------------------------------------------------------------------------

ImageArray = NDArray[Any]

RECOMMENDED_IMAGES = 6
OVERFIT = 1.25  # ratio of held-out error to fit error that indicates overfitting
COSTLY = 2.0  # ratio to the corner noise; smaller single-viewpoint errors are not reported
JOINT_PARAMETERS_ADVICE = (
    "Do not use such parameters individually: many cameras fit these images equally well. The "
    "directions of the pixels are well determined. A measured or specified value separates the "
    "parameters: --prior NAME=VALUE+-SIGMA."
)
OWN_RIM = "The sensor model has its own rim radius; rim_radius_px = {rim:g} is not stored."


@validate_arguments
def calibrate_camera(
    images: Sequence[Detection] | Sequence[ImageArray | str | Path] = (),
    board: Board | None = None,
    *,
    surveys: Sequence[Observation] = (),
    lines: Mapping[str, Sequence[Array]] | None = None,
    lines_distance_mm: float = np.inf,
    image_size: tuple[int, int] | None = None,
    model: str | CameraModel | Sensor = "auto",
    optics: str = "mirror",
    mount: Mount | None = None,
    centre_px: tuple[float, float] | None = None,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
    board_shape: bool = True,
    rim_radius_px: float | None = None,
    seed: int = 0,
    stored_orientation: bool = False,
    on_progress: OnProgress | None = None,
    should_stop: Callable[[], bool] | None = None,
) -> Calibration:
    """Calibrate a camera from images of a target, surveyed points and directions, or both.

    No initial value is required. Boards and surveys are placed with a stereographic camera, whose
    focal length is searched. A unified model is fitted robustly, and its result is the initial
    value of richer models. Outliers of the best model are rejected and listed: at most 1 % of the
    corners, and gross errors up to 5 %. A note reports remaining corners with residuals beyond the
    noise. The models are then compared by cross-validation.

    Parameters
    ----------
    images
        Files, images (height, width, 3), or detections in them (:func:`omnimirror.find_boards`),
        including those without a board.
    board
        Calibration target; None if there is none.
    surveys
        Surveyed points and directions of stars with their pixels, per image
        (:func:`omnimirror.read_observations`). The camera poses are estimated.
    lines
        Marked straight edges (n, 2) px by image name (:func:`omnimirror.read_line_points`). They
        complement boards and points in image regions without a board.
    lines_distance_mm
        Distance of the edges; relevant for mirrors with several viewpoints.
    image_size : (width, height), px
        Image size; required if no board determines it.
    model
        ``"auto"``, the name of a model, a camera model as the initial value, or a nominal sensor.
    optics
        ``"mirror"`` or ``"fisheye"``: the image centre is directed back past the lens or ahead.
    mount
        Orientation of the camera, and whether its images are flipped; by default looking up and not
        flipped.
    centre_px : (u, v), optional
        Initial value of the axis position, such as the centre of the rim; by default the image
        centre.
    fixed
        Names of parameters held at their initial values.
    priors
        Prior knowledge of parameters: name, value, standard deviation (0: fixed).
    board_shape
        Whether bulge, twist, aspect and shear of the board are estimated.
    rim_radius_px : px, optional
        Radius of the image field about its centre; by default limited by the image or the model. A
        physical mirror has its own rim.
    seed
        Random seed of the cross-validation groups for more than 20 images.
    stored_orientation
        Use the pixels of files as stored, without the orientation in their EXIF data.
    on_progress
        Callback of the completed work and the total work, in percent. The logger
        ``omnimirror.calibration`` reports the steps.
    should_stop
        Callback; if it returns True, the calibration stops and returns the best result so far.

    Returns
    -------
    Calibration
        Camera, residuals, uncertainty, and the result for each image.

    Raises
    ------
    InvalidParameter
        If the images do not allow a calibration; the message names the images and the reason.

    Examples
    --------
    Simulated boards in images of a unified camera:

    >>> import omnimirror as om
    >>> from omnimirror.cameras.models import Unified
    >>> camera = Unified(
    ...     xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    ... )
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> detections = om.simulate_detections(camera, board, 8, noise_px=0.1)
    >>> found = om.calibrate_camera(detections, board, model="unified")
    >>> round(found.rms_px, 2), all(p.used for p in found.images)
    (0.14, True)
    """
    # More than 60 lines: 18 parameters to check and pass on; the steps are functions.
    started = time.perf_counter()
    choice("optics", optics, ("mirror", "fisheye"))
    if isinstance(model, Sensor):
        model = SensorModel(model)
    if isinstance(model, CameraModel):
        mount, optics = model.mount, model.optics
    mount = Mount() if mount is None else mount
    rim_radius = optional_number("rim_radius_px", rim_radius_px, above=0.0, unit="px")
    detections = _with_unique_names(_detections(images, board, stored_orientation))
    surveys = _survey_observations(surveys)
    is_reversed = (optics == "mirror") != mount.image_flipped
    size = _size(detections, board, surveys, image_size, is_reversed=is_reversed)
    prior_knowledge = ParameterPriors(tuple(fixed), tuple(_prior(p) for p in priors))
    plan = CalibrationPlan(
        observations=(
            *(_sighting(d, board) for d in detections if board is not None and is_used(d)),
            *surveys,
        ),
        image_size=size,
        centre_px=centre_px,
        empty=Unified(
            xi=1.0,
            focal_px=(100.0, 100.0),
            centre_px=(0.0, 0.0),
            image_size=size,
            optics=optics,  # type: ignore[arg-type]  # checked by the model
            mount=mount,
        ),
        models_to_fit=_models_to_fit(
            model,
            size,
            optics,
            is_near=bool(detections) or not all(s.distant.all() for s in surveys),
        ),
        known=prior_knowledge,
        shape=BoardShape.flat(board.points_mm) if board_shape and board is not None else None,
        is_mirror_symmetric=board is not None and board.kind == "chessboard",
        seed=seed,
        edges=StraightEdges.of(lines, lines_distance_mm, size) if lines else None,
    )
    state = FitState()
    is_complete = True
    try:
        run(plan, ProgressReporter(on_progress, should_stop), state)
    except CalibrationCancelled:
        is_complete = False
        if state.fit is None:
            raise InvalidParameter("the calibration was stopped before the first fit") from None
    if (
        rim_radius is not None
        and state.fit is not None
        and isinstance(state.fit.model, RadialModel)
    ):
        model_with_rim: CameraModel = replace(state.fit.model, rim_radius_px=rim_radius)
        state.fit = replace(state.fit, model=model_with_rim)
    calibration = _calibration_result(
        state,
        detections,
        surveys,
        board,
        prior_knowledge,
        time.perf_counter() - started,
        is_complete,
    )
    if plan.edges is not None and is_complete:
        calibration = _with_edges(calibration, plan.edges)
    if rim_radius is not None and not isinstance(calibration.model, RadialModel):
        calibration = replace(
            calibration, notes=(*calibration.notes, OWN_RIM.format(rim=rim_radius))
        )
    return calibration


def _detections(
    images: Sequence[Any], board: Board | None, stored_orientation: bool
) -> Sequence[Detection]:
    """Return the given detections, or detect boards in images."""
    inputs = list(images)
    if board is None:
        if inputs:
            raise InvalidParameter(
                f"board must be specified for images; got {len(inputs)} images without a board"
            )
        return []
    if inputs and all(isinstance(p, Detection) for p in inputs):
        return inputs
    return find_boards(inputs, board, stored_orientation=stored_orientation)


def _survey_observations(surveys: Sequence[Observation]) -> tuple[Observation, ...]:
    """Return the surveys marked as surveyed, with poses still to be estimated."""
    observations = tuple(surveys)
    for number, survey in enumerate(observations):
        instance(f"surveys[{number}]", survey, Observation, "an Observation")
    names = [s.name for s in observations]
    if len(set(names)) < len(names):
        raise InvalidParameter(
            f"surveys must have different names; got {joined_names(names)}; combine the points of one image"
        )
    return tuple(replace(s, is_surveyed=True) for s in observations)


def _size(
    detections: Sequence[Detection],
    board: Board | None,
    surveys: Sequence[Observation],
    specified: tuple[int, int] | None,
    *,
    is_reversed: bool,
) -> tuple[int, int]:
    """Return the image size, from the detections or as specified."""
    size = specified
    if detections or not surveys:
        min_images = 1 if surveys else MIN_IMAGES
        size = check_detections(detections, board, is_reversed=is_reversed, min_images=min_images)
        if specified is not None and tuple(specified) != tuple(size):
            (w, h), (width, height) = specified, size
            raise InvalidParameter(
                f"image_size must be the size of the images, {width} x {height} px; got {w} x {h} px"
            )
    if size is None:
        raise InvalidParameter(
            "image_size (--image-size) must be specified for surveyed points without images"
        )
    if not detections and (count := sum(map(len, surveys))) < MIN_CORNERS_PER_IMAGE:
        raise InvalidParameter(
            f"surveys must contain at least {MIN_CORNERS_PER_IMAGE} points (recommended: "
            f"40 in all directions); got {count}"
        )
    for survey in surveys:
        outside = np.any((survey.pixels < -0.5) | (survey.pixels > np.array(size) - 0.5), axis=1)
        if outside.any():
            (u, v), (width, height) = survey.pixels[outside][0], size
            raise InvalidParameter(
                f"{survey.name}: pixels must be inside the image of {width} x {height} px; got {u:g}, {v:g}"
            )
    return size


def _with_unique_names(detections: Sequence[Detection]) -> list[Detection]:
    """Return detections with unique names; images in different folders may share a name."""
    names: dict[str, int] = {}
    renamed = []
    for detection in detections:
        count = names[detection.name] = names.get(detection.name, 0) + 1
        renamed.append(
            replace(detection, name=f"{detection.name} ({count})") if count > 1 else detection
        )
    return renamed


def _prior(entry: Any) -> Prior:
    if not (isinstance(entry, tuple) and len(entry) == len(Prior._fields)):
        raise InvalidType(
            f"priors must be tuples (name, value, standard deviation); got {format_value(entry)}"
        )
    return Prior(*entry)


def _sighting(detection: Detection, board: Board) -> Observation:
    ids = np.asarray(detection.ids, dtype=np.int64)
    return Observation(detection.name, detection.corners_px, board.points_mm[ids], ids=ids)


def _models_to_fit(
    model: str | CameraModel, size: tuple[int, int], optics: str, *, is_near: bool
) -> tuple[str | CameraModel, ...]:
    """Return the models to fit.

    Distant points contain no parallax, so they do not determine models of several viewpoints.
    """
    if model == "auto":
        excluded = set() if is_near else {SensorModel.KIND, ViewpointSpline.KIND}
        if optics != "mirror":
            excluded.add(SensorModel.KIND)
        return tuple(kind for kind in KINDS if kind not in excluded)
    if isinstance(model, str):
        choice("model", model, ("auto", *KINDS))
        if model == SensorModel.KIND and optics != "mirror":
            raise InvalidParameter("model = 'sensor' requires optics = 'mirror'; got 'fisheye'")
        return (model,)
    if not isinstance(model, CameraModel):
        raise InvalidParameter(
            f"model must be a camera model or one of auto, {', '.join(KINDS)}; got {format_value(model)}"
        )
    if tuple(model.image_size) != tuple(size):
        (w, h), (width, height) = model.image_size, size
        raise InvalidParameter(
            f"model must have the size of the images, {width} x {height} px; got {w} x {h} px"
        )
    return (model,)


def _with_edges(calibration: Calibration, edges: StraightEdges) -> Calibration:
    """Return the calibration with the result for each marked edge."""
    used_edges = calibration.adjustment.edges
    straight = {edge.name for edge in used_edges.edges} if used_edges else set()
    errors = edges.rms_px(calibration.model)
    results = tuple(
        EdgeResult(
            e.image, e.number, len(e.pixels), e.name in straight and bool(np.isfinite(r)), float(r)
        )
        for e, r in zip(edges.edges, errors, strict=True)
    )
    used = np.array([edge.rms_px for edge in results if edge.used])
    rejected = [
        f"edge {e.edge} of {e.image} ({_deviation_text(e.rms_px)})" for e in results if not e.used
    ]
    note = (
        f"{len(used)} of {len(results)} marked edges are straight with a residual of "
        f"{np.sqrt(np.mean(used**2)):.2f} px rms"
    )
    note += f"; not used: {joined_names(rejected)}." if rejected else "."
    return replace(calibration, edges=results, notes=(*calibration.notes, note))


def _deviation_text(rms_px: float) -> str:
    return f"{rms_px:.2g} px from a straight line" if np.isfinite(rms_px) else "not visible"


# -- result -----------------------------------------------------------------------------------


def _calibration_result(
    state: FitState,
    detections: Sequence[Detection],
    surveys: Sequence[Observation],
    board: Board | None,
    prior_knowledge: ParameterPriors,
    seconds: float,
    is_complete: bool,
) -> Calibration:
    fit = state.fit
    assert fit is not None
    covariance = uncertainty(fit)
    centre = _centre(fit)
    corner_coverage = coverage(fit.observations, centre, getattr(fit.model, "rim_radius_px", None))
    images = _image_results(fit, state, detections, surveys)
    parameters = [p.value for p in fit.model.parameters] + list(
        fit.shape.values if fit.shape else ()
    )
    return Calibration(
        model=fit.model,
        board=board,
        shape=fit.shape,
        rms_px=fit.rms_px,
        corners=sum(p.found for p in images if p.used),
        outliers=state.outliers,
        images=images,
        parameters=tuple(
            ParameterResult(n, float(v), float(s), u)
            for n, v, s, u in zip(
                covariance.names, parameters, covariance.sigmas, fit.units, strict=True
            )
        ),
        uncertainty=covariance,
        candidates=state.candidates,
        notes=_notes(fit, state, covariance, is_complete),
        advice=recommendations(corner_coverage, boards)
        if (boards := sum(not s.is_surveyed for s in fit.observations))
        else (),
        coverage=corner_coverage,
        adjustment=fit,
        held_out=state.held,
        seconds=seconds,
        is_complete=is_complete,
    )


def _centre(fit: BundleAdjustment) -> tuple[float, float]:
    """Return the pixel of the optical axis."""
    forward = -1.0 if fit.model.optics == "mirror" else 1.0
    image = fit.model.image(np.array([[1e-6, 0.0, forward]]), distant=True)
    if image.valid[0]:
        u, v = image.pixels[0]
        return float(u), float(v)
    width, height = fit.model.image_size
    return (width - 1) / 2, (height - 1) / 2


def _image_results(
    fit: BundleAdjustment,
    state: FitState,
    detections: Sequence[Detection],
    surveys: Sequence[Observation],
) -> tuple[ImageResult, ...]:
    errors = {s.name: rms_px(fit.residuals_of(i)) for i, s in enumerate(fit.observations)}
    poses = {s.name: _pose_values(s) for s in fit.observations}
    reasons = {
        d.name: state.inconsistent.get(d.name) if is_used(d) else reason_of(d) for d in detections
    }
    reasons |= {s.name: state.inconsistent.get(s.name) for s in surveys}
    counts = {d.name: len(d.ids) for d in detections} | {s.name: len(s) for s in surveys}
    results = []
    for name, reason in reasons.items():
        used = name in errors and reason is None
        pose = poses[name] if used else (None, None)
        results.append(
            ImageResult(name, counts[name], used, reason, errors[name] if used else None, *pose)
        )
    return tuple(results)


def _pose_values(observation: Observation) -> tuple[Array | None, Array | None]:
    """Return rotation and translation of a target; directions alone have no translation."""
    if observation.pose is None:
        return None, None
    return (
        observation.pose.rotation,
        None if observation.distant.all() else observation.pose.translation_mm,
    )


def _notes(
    fit: BundleAdjustment, state: FitState, covariance: ParameterCovariance, is_complete: bool
) -> tuple[str, ...]:
    """Return notes for users of the camera."""
    notes = []
    if not is_complete:
        notes.append("The calibration was stopped early: this is the best fit so far.")
    if len(fit.observations) < RECOMMENDED_IMAGES and not any(
        s.is_surveyed for s in fit.observations
    ):
        notes.append(
            f"The fit error of {len(fit.observations)} images is not representative of "
            "other images: check the error in held-out images, and capture more images."
        )
    notes += [
        "The images do not determine "
        f"{joined_names(free.names)}{' separately' if len(free.names) > 1 else ''}: a "
        f"camera with {free} (one standard deviation) fits nearly as well."
        for free in covariance.free
    ]
    if covariance.free:
        notes.append(JOINT_PARAMETERS_ADVICE)
    notes += _remaining_notes(remaining_outliers(fit), fit)
    held_out_rms_px = state.held.rms_px if state.held else float("nan")
    moving_part = "lens" if getattr(fit.model, "optics", "mirror") == "fisheye" else "mirror"
    if held_out_rms_px > OVERFIT * fit.rms_px:
        notes.append(
            f"The error in held-out images, {held_out_rms_px:.3f} px, is well above the "
            f"fit error, {fit.rms_px:.3f} px: the model is too flexible for these images, "
            f"or compensates for motion of the {moving_part} between them."
        )
    notes += _viewpoint_notes(fit, state.multi_viewpoint)
    notes += [f"{kind} could not be fitted: {why}" for kind, why in state.failures.items()]
    if fit.shape is not None and fit.shape.is_flat_within(covariance.sigmas[-len(SHAPE_NAMES) :]):
        notes.append("The board is flat within the uncertainty of the calibration.")
    return tuple(notes)


def _remaining_notes(remaining: tuple[Outlier, ...], fit: BundleAdjustment) -> list[str]:
    """Return a note about corners with residuals beyond the noise that were not rejected."""
    if not remaining:
        return []
    counts = Counter(o.image for o in remaining)
    names = joined_names([f"{name} ({count})" for name, count in counts.most_common()])
    percentage = 100 * len(remaining) / len(fit.residuals)
    return [
        f"{len(remaining)} of the used corners ({percentage:.2g} %) have residuals above "
        f"the noise, up to {remaining[0].residual_px:.2f} px, and were not rejected. "
        f"Possible causes: wrong corners, a bent board, or model errors. Images: {names}."
    ]


def _viewpoint_notes(fit: BundleAdjustment, multi_viewpoint: BundleAdjustment | None) -> list[str]:
    """Return a note on the parallax error of a single-viewpoint model at other object distances."""
    if (
        multi_viewpoint is None
        or not is_central(fit.model)
        or not has_several(fit, multi_viewpoint)
    ):
        return []
    (nearest, farthest), near, distant = parallax_errors(fit, multi_viewpoint)
    if not max(near.rms_px, distant.rms_px) > COSTLY * multi_viewpoint.problem.noise_px:
        return []
    remedy = (
        "use the model sensor or viewpoint-spline"
        if fit.model.is_backward_facing
        else "use the model viewpoint-spline"
    )
    return [
        f"{fit.model.KIND} has a single viewpoint, but the sensor has several: the camera is valid at the "
        f"distance of the boards, {nearest / 1000:.2g} to {farthest / 1000:.2g} m. Relative to "
        f"{multi_viewpoint.model.KIND}, its parallax error is {distant.rms_px:.1f} px ({distant.rms_deg:.2g} deg) rms "
        f"for distant objects and {near.rms_px:.1f} px ({near.rms_deg:.2g} deg) rms at "
        f"{near.distance_mm / 1000:.2g} m. For other distances, {remedy} and images of boards there."
    ]
