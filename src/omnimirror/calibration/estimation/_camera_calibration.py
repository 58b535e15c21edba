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

from ...base.arguments import WrongKind, checked, choice, instance, optional_number, shown
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...cameras.frames import Mount, turned
from ...cameras.models.camera_model import CameraModel
from ...cameras.models.radial_model import RadialModel
from ...cameras.models.sphere_models import Unified
from ...cameras.models.spline_models import ViewpointSpline
from ...optics.sensor import Sensor
from ..sensor_model import SensorModel
from ..straight_edges import StraightEdges
from ..targets import Board, Detection, find_boards
from ._bundle_adjustment import Adjustment, Prior
from ._covariance import ParameterCovariance, uncertainty
from ._pipeline import (
    CalibrationPlan,
    CalibrationStopped,
    FitState,
    ParameterPriors,
    ProgressReporter,
    run,
)
from ._residuals import SHAPE_NAMES, BoardShape
from .calibration_result import Calibration, EdgeResult, ParameterResult, PictureResult
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
from .observations import Motion, Sighting, rms_px

# -- Parallax error --------------------------------------------------------------------------------

MAX_PARALLAX_PIXELS = 1000
MIN_SIGNIFICANT_GAIN = 5.0  # minimum gain in squared noise per additional parameter; chance gains 1


class ViewpointCost(NamedTuple):
    """Parallax error of a single-viewpoint camera at one object distance."""

    distance_mm: float
    rms_px: float
    rms_deg: float


class ViewpointCosts(NamedTuple):
    """Parallax errors at object distances other than those of the boards."""

    boards_mm: tuple[float, float]
    """Distances of the nearest and the farthest corner."""
    near: ViewpointCost
    """Error at 0.5 times the minimum board distance."""
    far: ViewpointCost
    """Error at infinity."""


def viewpoint_costs(central: Adjustment, other: Adjustment) -> ViewpointCosts:
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
    ours, theirs = _board_corners(central, central), _board_corners(other, central)
    move = _rigid_transform(theirs, ours)
    pixels = np.concatenate([s.pixels for s in central.sightings])
    pixels = pixels[:: -(-len(pixels) // MAX_PARALLAX_PIXELS)]
    lengths = np.linalg.norm(theirs, axis=1)
    nearest, farthest = float(lengths.min()), float(lengths.max())
    near, far = (_parallax_at(central, other, pixels, move, d) for d in (nearest / 2, np.inf))
    return ViewpointCosts((nearest, farthest), near, far)


def has_several(central: Adjustment, other: Adjustment) -> bool:
    """Return whether a model with several viewpoints fits the images significantly better.

    Parameters
    ----------
    central, other
        Least-squares fits with one viewpoint and with several, on the same corners.
    """
    gain = float(np.sum(central.residuals**2) - np.sum(other.residuals**2)) / other.noise_px**2
    more = int(other.question.free.sum()) - int(central.question.free.sum())
    return gain > MIN_SIGNIFICANT_GAIN * max(more, 1)


def _board_corners(fit: Adjustment, of: Adjustment) -> Array:
    """Return the corners (n, 3) of all boards in one fit, limited to those of another fit."""
    motions = {s.name: s.motion for s in fit.sightings}
    return np.concatenate(
        [m(s.points[~s.distant]) for s in of.sightings if (m := motions.get(s.name)) is not None]
    )


def _rigid_transform(points: Array, others: Array) -> Motion:
    """Return the rigid transform between point sets (n, 3) by Kabsch's method."""
    middle, other_middle = points.mean(axis=0), others.mean(axis=0)
    u, _, vt = np.linalg.svd((others - other_middle).T @ (points - middle))
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    return Motion(rotation, other_middle - rotation @ middle)


def _parallax_at(
    central: Adjustment, other: Adjustment, pixels: Array, move: Motion, distance_mm: float
) -> ViewpointCost:
    rays, world = other.model.backproject(pixels), other.model.mount.rotation()
    starts, ways = (turned(a[rays.valid], world) for a in (rays.origins, rays.directions))
    is_far = np.isinf(distance_mm)
    seen = ways @ move.rotation.T if is_far else move(starts + distance_mm * ways)
    image = central.model.image(seen, distant=bool(is_far))
    off_px = np.linalg.norm((image.pixels - pixels[rays.valid])[image.valid], axis=1)
    looks = turned(
        central.model.backproject(pixels[rays.valid]).directions, central.model.mount.rotation()
    )
    off = np.linalg.norm(looks - seen / np.linalg.norm(seen, axis=1)[:, None], axis=1)
    rms_px, rms = (
        float(np.sqrt(np.nanmean(e**2))) if np.isfinite(e).any() else np.nan for e in (off_px, off)
    )
    return ViewpointCost(distance_mm, rms_px, float(np.degrees(rms)))


# -- Camera calibration ----------------------------------------------------------------------------

Picture = NDArray[Any]

FEW_PICTURES = 6
OVERFIT = 1.25  # ratio of held-out error to fit error that indicates overfitting
COSTLY = 2.0  # ratio to the corner noise; smaller single-viewpoint errors are not reported
TOGETHER = (
    "Do not use such parameters individually: many cameras fit these images equally well. The directions of "
    "the pixels are well determined. A measured or specified value separates the parameters: "
    "--prior NAME=VALUE+-SIGMA."
)
OWN_RIM = "The sensor model has its own rim radius; rim_radius_px = {rim:g} is not stored."


@checked
def calibrate_camera(
    pictures: Sequence[Detection] | Sequence[Picture | str | Path] = (),
    board: Board | None = None,
    *,
    surveys: Sequence[Sighting] = (),
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
    progress: Callable[[str, float], None] | None = None,
    stop: Callable[[], bool] | None = None,
) -> Calibration:
    """Calibrate a camera from images of a target, surveyed points and directions, or both.

    No initial value is required. Boards and surveys are placed with a stereographic camera, whose
    focal length is searched. A unified model is fitted robustly, and its result is the initial
    value of richer models. Outliers of the best model are rejected and listed: at most 1 % of the
    corners, and gross errors up to 5 %. A note reports remaining corners with residuals beyond the
    noise. The models are then compared by cross-validation.

    Parameters
    ----------
    pictures
        Files, images (height, width, 3), or detections in them (:func:`omnimirror.find_boards`),
        including those without a board.
    board
        Calibration target; None if there is none.
    surveys
        Surveyed points and directions of stars with their pixels, per image
        (:func:`omnimirror.read_surveys`). The camera poses are estimated.
    lines
        Marked straight edges (n, 2) px by image name (:func:`omnimirror.read_lines`). They
        complement boards and points in image regions without a board.
    lines_distance_mm
        Distance of the edges; relevant for mirrors with several viewpoints.
    image_size : (width, height), px
        Image size; required if no board determines it.
    model
        ``"auto"``, the name of a model, a camera model as the initial value, or a nominal sensor.
    optics
        ``"mirror"`` or ``"fisheye"``: the image centre looks back past the lens or ahead.
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
    progress
        Callback with the name of the current step and the completed fraction from 0 to 1.
    stop
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
    >>> camera = Unified(0.95, (160.0, 160.0), (319.5, 239.5), (640, 480))
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> detections = om.simulate_detections(camera, board, 8, noise_px=0.1)
    >>> found = om.calibrate_camera(detections, board, model="unified")
    >>> round(found.rms_px, 2), all(p.used for p in found.pictures)
    (0.14, True)
    """
    started = time.perf_counter()
    choice("optics", optics, ("mirror", "fisheye"))
    if isinstance(model, Sensor):
        model = SensorModel(model)
    if isinstance(model, CameraModel):
        mount, optics = model.mount, model.optics
    mount = Mount() if mount is None else mount
    rim = optional_number("rim_radius_px", rim_radius_px, above=0.0, unit="px")
    detections = _with_names(_found(pictures, board, stored_orientation))
    surveys = _surveyed(surveys)
    is_reversed = (optics == "mirror") != mount.image_flipped
    size = _size(detections, board, surveys, image_size, is_reversed=is_reversed)
    known = ParameterPriors(tuple(fixed), tuple(_prior(p) for p in priors))
    plan = CalibrationPlan(
        sightings=(
            *(_sighting(d, board) for d in detections if board is not None and is_used(d)),
            *surveys,
        ),
        image_size=size,
        centre_px=centre_px,
        empty=Unified(1.0, (100.0, 100.0), (0.0, 0.0), size, optics=optics, mount=mount),  # type: ignore[arg-type]
        wanted=_wanted(
            model,
            size,
            optics,
            is_near=bool(detections) or not all(s.distant.all() for s in surveys),
        ),
        known=known,
        shape=BoardShape.flat(board.points_mm) if board_shape and board is not None else None,
        is_mirrored_alike=board is not None and board.kind == "chessboard",
        seed=seed,
        edges=StraightEdges.of(lines, lines_distance_mm, size) if lines else None,
    )
    course = FitState()
    is_complete = True
    try:
        run(plan, ProgressReporter(progress, stop), course)
    except CalibrationStopped:
        is_complete = False
        if course.fit is None:
            raise InvalidParameter("the calibration was stopped before the first fit") from None
    if rim is not None and course.fit is not None and isinstance(course.fit.model, RadialModel):
        with_rim: CameraModel = replace(course.fit.model, rim_radius_px=rim)  # type: ignore[type-var]
        course.fit = replace(course.fit, model=with_rim)
    told = _told(
        course, detections, surveys, board, known, time.perf_counter() - started, is_complete
    )
    if plan.edges is not None and is_complete:
        told = _with_edges(told, plan.edges)
    if rim is not None and not isinstance(told.model, RadialModel):
        told = replace(told, notes=(*told.notes, OWN_RIM.format(rim=rim)))
    return told


def _found(
    pictures: Sequence[Any], board: Board | None, stored_orientation: bool
) -> Sequence[Detection]:
    """Return the given detections, or detect boards in images."""
    given = list(pictures)
    if board is None:
        if given:
            raise InvalidParameter(
                f"board must be specified for images; got {len(given)} images without a board"
            )
        return []
    if given and all(isinstance(p, Detection) for p in given):
        return given
    return find_boards(given, board, stored_orientation=stored_orientation)


def _surveyed(surveys: Sequence[Sighting]) -> tuple[Sighting, ...]:
    """Return the surveys marked as surveyed, with poses still to be estimated."""
    given = tuple(surveys)
    for number, survey in enumerate(given):
        instance(f"surveys[{number}]", survey, Sighting, "an Observation")
    names = [s.name for s in given]
    if len(set(names)) < len(names):
        raise InvalidParameter(
            f"surveys must have different names; got {joined_names(names)}; combine the points of one image"
        )
    return tuple(replace(s, is_surveyed=True) for s in given)


def _size(
    detections: Sequence[Detection],
    board: Board | None,
    surveys: Sequence[Sighting],
    said: tuple[int, int] | None,
    *,
    is_reversed: bool,
) -> tuple[int, int]:
    """Return the image size, from the detections or as specified."""
    size = said
    if detections or not surveys:
        fewest = 1 if surveys else MIN_IMAGES
        size = check_detections(detections, board, is_reversed=is_reversed, fewest=fewest)
        if said is not None and tuple(said) != tuple(size):
            (w, h), (width, height) = said, size
            raise InvalidParameter(
                f"image_size must be the size of the images, {width} x {height} px; got {w} x {h} px"
            )
    if size is None:
        raise InvalidParameter(
            "image_size (--image-size) must be specified for surveyed points without images"
        )
    if not detections and (count := sum(map(len, surveys))) < MIN_CORNERS_PER_IMAGE:
        raise InvalidParameter(
            f"surveys must contain at least {MIN_CORNERS_PER_IMAGE} points (recommended: 40 in all "
            f"directions); got {count}"
        )
    for survey in surveys:
        outside = np.any((survey.pixels < -0.5) | (survey.pixels > np.array(size) - 0.5), axis=1)
        if outside.any():
            (u, v), (width, height) = survey.pixels[outside][0], size
            raise InvalidParameter(
                f"{survey.name}: pixels must be inside the image of {width} x {height} px; got {u:g}, {v:g}"
            )
    return size


def _with_names(detections: Sequence[Detection]) -> list[Detection]:
    """Return detections with unique names; images in different folders may share a name."""
    names: dict[str, int] = {}
    renamed = []
    for detection in detections:
        count = names[detection.name] = names.get(detection.name, 0) + 1
        renamed.append(
            replace(detection, name=f"{detection.name} ({count})") if count > 1 else detection
        )
    return renamed


def _prior(given: Any) -> Prior:
    if not (isinstance(given, tuple) and len(given) == len(Prior._fields)):
        raise WrongKind(
            f"priors must be tuples (name, value, standard deviation); got {shown(given)}"
        )
    return Prior(*given)


def _sighting(detection: Detection, board: Board) -> Sighting:
    ids = np.asarray(detection.ids, dtype=np.int64)
    return Sighting(detection.name, detection.corners_px, board.points_mm[ids], ids=ids)


def _wanted(
    model: str | CameraModel, size: tuple[int, int], optics: str, *, is_near: bool
) -> tuple[str | CameraModel, ...]:
    """Return the models to fit.

    Distant points contain no parallax, so they do not determine models of several viewpoints.
    """
    if model == "auto":
        left = set() if is_near else {SensorModel.KIND, ViewpointSpline.KIND}
        if optics != "mirror":
            left.add(SensorModel.KIND)
        return tuple(kind for kind in KINDS if kind not in left)
    if isinstance(model, str):
        choice("model", model, ("auto", *KINDS))
        if model == SensorModel.KIND and optics != "mirror":
            raise InvalidParameter("model = 'sensor' requires optics = 'mirror'; got 'fisheye'")
        return (model,)
    if not isinstance(model, CameraModel):
        raise InvalidParameter(
            f"model must be a camera model or one of auto, {', '.join(KINDS)}; got {shown(model)}"
        )
    if tuple(model.image_size) != tuple(size):
        (w, h), (width, height) = model.image_size, size
        raise InvalidParameter(
            f"model must have the size of the images, {width} x {height} px; got {w} x {h} px"
        )
    return (model,)


def _with_edges(told: Calibration, edges: StraightEdges) -> Calibration:
    """Return the calibration with the result for each marked edge."""
    kept = told.adjustment.edges
    straight = {edge.name for edge in kept.edges} if kept else set()
    errors = edges.rms_px(told.model)
    found = tuple(
        EdgeResult(
            e.picture,
            e.number,
            len(e.pixels),
            e.name in straight and bool(np.isfinite(r)),
            float(r),
        )
        for e, r in zip(edges.edges, errors, strict=True)
    )
    used = np.array([edge.rms_px for edge in found if edge.used])
    bent = [f"edge {e.edge} of {e.picture} ({_off(e.rms_px)})" for e in found if not e.used]
    note = (
        f"{len(used)} of {len(found)} marked edges are straight with a residual of "
        f"{np.sqrt(np.mean(used**2)):.2f} px rms"
    )
    note += f"; not used: {joined_names(bent)}." if bent else "."
    return replace(told, edges=found, notes=(*told.notes, note))


def _off(rms_px: float) -> str:
    return f"{rms_px:.2g} px from a straight line" if np.isfinite(rms_px) else "not visible"


# -- result -----------------------------------------------------------------------------------


def _told(
    course: FitState,
    detections: Sequence[Detection],
    surveys: Sequence[Sighting],
    board: Board | None,
    known: ParameterPriors,
    seconds: float,
    is_complete: bool,
) -> Calibration:
    fit = course.fit
    assert fit is not None
    certain = uncertainty(fit)
    centre = _centre(fit)
    found = coverage(fit.sightings, centre, getattr(fit.model, "rim_radius_px", None))
    pictures = _pictures(fit, course, detections, surveys)
    parameters = [p.value for p in fit.model.parameters] + list(
        fit.shape.values if fit.shape else ()
    )
    return Calibration(
        model=fit.model,
        board=board,
        shape=fit.shape,
        rms_px=fit.rms_px,
        corners=sum(p.found for p in pictures if p.used),
        outliers=course.outliers,
        pictures=pictures,
        parameters=tuple(
            ParameterResult(n, float(v), float(s), u)
            for n, v, s, u in zip(certain.names, parameters, certain.sigmas, fit.units, strict=True)
        ),
        uncertainty=certain,
        candidates=course.candidates,
        notes=_notes(fit, course, certain, is_complete),
        advice=recommendations(found, boards)
        if (boards := sum(not s.is_surveyed for s in fit.sightings))
        else (),
        coverage=found,
        adjustment=fit,
        held_out=course.held,
        seconds=seconds,
        is_complete=is_complete,
    )


def _centre(fit: Adjustment) -> tuple[float, float]:
    """Return the pixel of the optical axis."""
    forward = -1.0 if fit.model.optics == "mirror" else 1.0
    image = fit.model.image(np.array([[1e-6, 0.0, forward]]), distant=True)
    if image.valid[0]:
        u, v = image.pixels[0]
        return float(u), float(v)
    width, height = fit.model.image_size
    return (width - 1) / 2, (height - 1) / 2


def _pictures(
    fit: Adjustment, course: FitState, detections: Sequence[Detection], surveys: Sequence[Sighting]
) -> tuple[PictureResult, ...]:
    errors = {s.name: rms_px(fit.residuals_of(i)) for i, s in enumerate(fit.sightings)}
    poses = {s.name: _pose_told(s) for s in fit.sightings}
    reasons = {
        d.name: course.strangers.get(d.name) if is_used(d) else reason_of(d) for d in detections
    }
    reasons |= {s.name: course.strangers.get(s.name) for s in surveys}
    counts = {d.name: len(d.ids) for d in detections} | {s.name: len(s) for s in surveys}
    results = []
    for name, reason in reasons.items():
        used = name in errors and reason is None
        pose = poses[name] if used else (None, None)
        results.append(
            PictureResult(name, counts[name], used, reason, errors[name] if used else None, *pose)
        )
    return tuple(results)


def _pose_told(sighting: Sighting) -> tuple[Array | None, Array | None]:
    """Return rotation and translation of a target; directions alone have no translation."""
    if sighting.motion is None:
        return None, None
    return sighting.motion.rotation, None if sighting.distant.all() else sighting.motion.shift_mm


def _notes(
    fit: Adjustment, course: FitState, certain: ParameterCovariance, is_complete: bool
) -> tuple[str, ...]:
    """Return notes for users of the camera."""
    notes = []
    if not is_complete:
        notes.append("The calibration was stopped early: this is the best fit so far.")
    if len(fit.sightings) < FEW_PICTURES and not any(s.is_surveyed for s in fit.sightings):
        notes.append(
            f"The fit error of {len(fit.sightings)} images is not representative of other images: check the "
            "error in held-out images, and take more images."
        )
    notes += [
        f"The images do not determine "
        f"{joined_names(free.names)}{' separately' if len(free.names) > 1 else ''}: a camera with "
        f"{free} (one standard deviation) fits nearly as well."
        for free in certain.free
    ]
    if certain.free:
        notes.append(TOGETHER)
    notes += _remaining_notes(remaining_outliers(fit), fit)
    held = course.held.rms_px if course.held else float("nan")
    moving = "lens" if getattr(fit.model, "optics", "mirror") == "fisheye" else "mirror"
    if held > OVERFIT * fit.rms_px:
        notes.append(
            f"The error in held-out images, {held:.3f} px, is well above the fit error, {fit.rms_px:.3f} px: the "
            f"model is too flexible for these images, or compensates for motion of the {moving} between them."
        )
    notes += _viewpoint_notes(fit, course.wandering)
    notes += [f"{kind} could not be fitted: {why}" for kind, why in course.failures.items()]
    if fit.shape is not None and fit.shape.is_flat_within(certain.sigmas[-len(SHAPE_NAMES) :]):
        notes.append("The board is flat within the uncertainty of the calibration.")
    return tuple(notes)


def _remaining_notes(remaining: tuple[Outlier, ...], fit: Adjustment) -> list[str]:
    """Return a note about corners with residuals beyond the noise that were not rejected."""
    if not remaining:
        return []
    counts = Counter(o.picture for o in remaining)
    names = joined_names([f"{name} ({count})" for name, count in counts.most_common()])
    share = 100 * len(remaining) / len(fit.residuals)
    return [
        f"{len(remaining)} of the used corners ({share:.2g} %) have residuals above the noise, up to "
        f"{remaining[0].residual_px:.2f} px, and were not rejected. Possible causes: wrong corners, a bent "
        f"board, or model errors. Images: {names}."
    ]


def _viewpoint_notes(fit: Adjustment, wandering: Adjustment | None) -> list[str]:
    """Return a note on the parallax error of a single-viewpoint model at other object distances."""
    if wandering is None or not is_central(fit.model) or not has_several(fit, wandering):
        return []
    (nearest, farthest), near, far = viewpoint_costs(fit, wandering)
    if not max(near.rms_px, far.rms_px) > COSTLY * wandering.question.noise_px:
        return []
    remedy = (
        "use the model sensor or viewpoint-spline"
        if fit.model.looks_back
        else "use the model viewpoint-spline"
    )
    return [
        f"{fit.model.KIND} has a single viewpoint, but the sensor has several: the camera is valid at the "
        f"distance of the boards, {nearest / 1000:.2g} to {farthest / 1000:.2g} m. Relative to "
        f"{wandering.model.KIND}, its parallax error is {far.rms_px:.1f} px ({far.rms_deg:.2g} deg) rms for "
        f"distant objects and {near.rms_px:.1f} px ({near.rms_deg:.2g} deg) rms at "
        f"{near.distance_mm / 1000:.2g} m. For other distances, {remedy} and images of boards there."
    ]
