"""Checks of observations: usable images, outliers, coverage, and recommended further images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ._bundle_adjustment import MEDIAN_OF_NOISE, BundleAdjustment
from ._residuals import UNSEEN_PX
from .observations import Observation

# -- Image checks ----------------------------------------------------------------------------------

MIN_IMAGES = 3
MIN_CORNERS_PER_IMAGE = 12  # per image
MAX_NAMED = 6
SAME_TILT_DEG, SAME_PLACE = 4.0, 0.06
"""Maximum tilt and relative position difference of boards that count as one pose."""
BOARD_REMEDY = "check that the board is the specified one, and flat"
SURVEY_REMEDY = (
    "check that their axes are right-handed, that their units are those of the columns, that "
    "all points of an image were observed from one position, and that camera.optics and "
    "camera.image_flipped are correct"
)
WORST_MEDIAN = 0.01  # maximum initial median residual, fraction of the larger image side


def joined_names(names: Sequence[str]) -> str:
    """Return names joined for a sentence; a long list is truncated.

    >>> joined_names(["a", "b", "c"]), joined_names([str(i) for i in range(9)])
    ('a, b and c', '0, 1, 2, 3, 4, 5 and 3 more')
    """
    listed = list(names[:MAX_NAMED])
    if len(names) > MAX_NAMED:
        listed.append(f"{len(names) - MAX_NAMED} more")
    return listed[0] if len(listed) == 1 else f"{', '.join(listed[:-1])} and {listed[-1]}"


def check_detections(
    detections: Sequence[Any], board: Any, *, is_reversed: bool, min_images: int
) -> tuple[int, int]:
    """Return the common image size if enough images show the board.

    Parameters
    ----------
    detections
        Detections in all images.
    board
        Calibration target.
    is_reversed
        Whether this type of camera delivers mirror images.
    min_images
        Minimum number of images that show the board.
    """
    sizes = Counter(tuple(d.image_size) for d in detections if is_used(d))
    if len(sizes) > 1:
        (usual, _), *others = sizes.most_common()
        deviating = [d.name for d in detections if is_used(d) and tuple(d.image_size) != usual]
        names = ", ".join(f"{w} x {h}" for (w, h), _ in others)
        raise InvalidParameter(
            f"images of one calibration must have one size; {joined_names(deviating)}: "
            f"{names} px, the other images: {usual[0]} x {usual[1]} px"
        )
    if not detections:
        raise InvalidParameter(
            "at least one image is required (recommended: 10 or more of a board); got none"
        )
    used = [d for d in detections if is_used(d)]
    if len(used) < min_images:
        missing = [d for d in detections if not is_used(d)]
        reasons = "; ".join(reason_of(d) for d in missing[:MAX_NAMED])
        raise InvalidParameter(
            f"the board ({board}) was detected in {len(used)} of {len(detections)} "
            f"images{f' ({joined_names([d.name for d in used])})' if used else ''}; at "
            f"least {min_images} {'is' if min_images == 1 else 'are'} required, 10 or more "
            f"are recommended{': ' if reasons else ''}{reasons}"
        )
    mismatched = [
        d.name for d in used if d.is_reversed is not None and d.is_reversed != is_reversed
    ]
    if mismatched:
        mismatch = (
            "are not mirror images, unlike those of a mirror"
            if is_reversed
            else "are mirror images, unlike those of a fisheye"
        )
        is_common = len(mismatched) == sum(d.is_reversed is not None for d in used)
        remedy = (
            "use --set camera.image_flipped=true if the camera's driver flips the images, or the "
            "other camera.optics"
            if is_common
            else "remove them, or flip them"
        )
        raise InvalidParameter(
            f"according to the board's markers, {joined_names(mismatched)} {mismatch}; {remedy}"
        )
    return next(iter(sizes))


def is_used(detection: Any) -> bool:
    """Return whether a detection has enough corners and no reason against its use."""
    return detection.reason is None and len(detection.ids) >= MIN_CORNERS_PER_IMAGE


def reason_of(detection: Any) -> str:
    """Return the reason why an image is not used, with its name."""
    if detection.reason is None:
        return f"{detection.name}: at least {MIN_CORNERS_PER_IMAGE} corners are required; got {len(detection.ids)}"
    return (
        detection.reason
        if detection.name in detection.reason
        else f"{detection.name}: {detection.reason}"
    )


def check_start(median_px: float, image_size: tuple[int, int], *, boards: bool = True) -> None:
    """Check that a camera explains the corners of boards, or surveyed points."""
    if not median_px < WORST_MEDIAN * max(image_size):
        kind, remedy = (
            ("corners", BOARD_REMEDY) if boards else ("points and directions", SURVEY_REMEDY)
        )
        raise InvalidParameter(
            f"no camera explains the {kind}: the median residual of the best fit is {median_px:.1f} px; {remedy}"
        )


def check_poses(observations: Sequence[Observation]) -> None:
    """Check that the board poses differ, unless there are surveyed points."""
    if any(s.is_surveyed for s in observations):
        return
    poses = [s.pose for s in observations if s.pose is not None]
    normals = np.array([m.rotation[:, 2] for m in poses])
    centres = np.array([m(s.points).mean(axis=0) for m, s in zip(poses, observations, strict=True)])
    tilt = float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))
    distance = float(np.linalg.norm(centres, axis=1).mean())
    spread = float(np.linalg.norm(centres[:, None] - centres[None], axis=2).max())
    if tilt < SAME_TILT_DEG and spread < SAME_PLACE * distance:
        raise InvalidParameter(
            "the board must have different poses; it has the same in all images "
            f"({joined_names([s.name for s in observations])}); hold it at different "
            "positions and angles in all directions"
        )


def inconsistent_images(adjustment: BundleAdjustment) -> dict[str, str]:
    """Return images without a consistent board pose, as a mapping of name to reason."""
    medians = np.array(
        [
            np.median(np.hypot(*adjustment.residuals_of(i).T))
            for i in range(len(adjustment.observations))
        ]
    )
    invisible = np.array(
        [1 - adjustment.visible[part].mean() for part in adjustment.problem.stack.slices]
    )
    typical = max(float(np.median(medians)), 0.05)
    limit = max(10 * typical, 1.0)
    return {
        s.name: (
            f"the median residual of its corners is {median:.1f} px, that of the other images {typical:.2f} px"
            if fraction < 0.5
            else "a board at this position is not visible to the camera that fits the other images"
        )
        for s, median, fraction in zip(adjustment.observations, medians, invisible, strict=True)
        if median > limit or fraction >= 0.5
    }


# -- Outlier rejection -----------------------------------------------------------------------------
#
# Rejection of all corners that a model does not fit makes any model appear good. Therefore at most
# 1 % are rejected, one at a time with an adjustment in between, by the best available model; the
# set is frozen before models are compared. Gross errors, 3 times beyond the noise limit, do not
# depend on the model: up to 5 % are rejected, together if several have similar size. Remaining
# corners beyond the noise are reported.

MAX_REJECTED, MAX_GROSS = 0.01, 0.05  # fraction of all corners
GROSS = 3.0  # multiple of the noise limit
SIMILAR_FRACTION = (
    0.5  # fraction of the largest gross error above which others are rejected together with it
)
MAX_ABSORBED = 0.75  # maximum fraction of the noise absorbed by estimated parameters
DOUBT = 1.44  # two relative standard errors of the Rayleigh median, times sqrt(n)
CHANCE = 0.02  # probability that data without gross errors lose a corner
MIN_REJECTED_PX = 0.25  # corners with smaller residuals are never rejected
MIN_RETAINED_CORNERS = 6  # minimum number of corners retained per image


class Outlier(NamedTuple):
    """Rejected corner."""

    image: str
    corner: int
    residual_px: float


def outlier_limit_px(adjustment: BundleAdjustment) -> float:
    """Return the residual above which a corner is an outlier of normally distributed noise."""
    lengths = np.hypot(*adjustment.residuals[adjustment.visible].T)
    residual_fraction = 1 - min(
        adjustment.unknowns / max(2 * len(lengths), 1), MAX_ABSORBED
    )  # noise in parameters
    noise = (
        float(np.median(lengths)) / MEDIAN_OF_NOISE / np.sqrt(residual_fraction)
        if len(lengths)
        else 0.0
    )
    noise *= 1 + DOUBT / np.sqrt(max(len(lengths), 1))
    return max(
        float(noise) * float(np.sqrt(2 * np.log(max(len(lengths), 2) / CHANCE))), MIN_REJECTED_PX
    )


def without_outliers(
    adjustment: BundleAdjustment, *, max_rejected: int | None = None
) -> tuple[BundleAdjustment, tuple[Outlier, ...]]:
    """Reject the worst corner and adjust again until none is significant or the limit is reached.

    Parameters
    ----------
    adjustment
        Robust or least-squares fit to all corners.
    max_rejected
        Maximum number of rejected corners; by default 1 %, of gross errors 5 %, and at least 1.

    Returns
    -------
    adjustment
        Least-squares fit to the remaining corners.
    outliers
        Rejected corners, worst first.
    """
    count = len(adjustment.residuals)
    remaining, remaining_gross = (
        (max(1, int(s * count)) if max_rejected is None else max_rejected)
        for s in (MAX_REJECTED, MAX_GROSS)
    )
    outliers: list[Outlier] = []
    fit = adjustment
    while True:
        lengths = np.where(fit.visible, np.hypot(*fit.residuals.T), UNSEEN_PX)
        index, limit = _largest_residual(fit, lengths), outlier_limit_px(fit)
        if index is None or lengths[index] <= limit:
            break
        rejected = np.array([index])
        if lengths[index] > GROSS * limit:
            similar = np.flatnonzero(
                lengths > max(GROSS * limit, SIMILAR_FRACTION * lengths[index])
            )
            rejected = _removable(
                fit, similar[np.argsort(-lengths[similar])][: remaining_gross - len(outliers)]
            )
        if len(outliers) + len(rejected) > (
            remaining_gross if lengths[index] > GROSS * limit else remaining
        ) or not len(rejected):
            break
        rejected_outliers = [_outlier(fit, int(i), float(lengths[i])) for i in rejected]
        outliers += rejected_outliers
        fit = fit.refit(
            without_rejected(fit.observations, tuple(rejected_outliers)),
            loss="cauchy",
            noise_px=fit.problem.noise_px,
            max_steps=2,
        )
    final = fit.refit(fit.observations)
    return final, tuple(sorted(outliers, key=lambda o: -o.residual_px))


def remaining_outliers(adjustment: BundleAdjustment) -> tuple[Outlier, ...]:
    """Return corners of the final fit with residuals beyond the noise, worst first.

    They are outliers beyond the rejection limit, or corners of a board or an image that the model
    does not describe.
    """
    lengths = np.where(adjustment.visible, np.hypot(*adjustment.residuals.T), UNSEEN_PX)
    beyond = np.flatnonzero(lengths > outlier_limit_px(adjustment))
    return tuple(
        _outlier(adjustment, int(i), float(lengths[i]))
        for i in beyond[np.argsort(-lengths[beyond])]
    )


def _outlier(adjustment: BundleAdjustment, index: int, length_px: float) -> Outlier:
    """Return a point of an adjustment with its image and number."""
    stack = adjustment.problem.stack
    return Outlier(
        adjustment.observations[int(stack.owner[index])].name, int(stack.ids[index]), length_px
    )


def _removable(adjustment: BundleAdjustment, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the points, in order, that can be removed while each image retains the minimum."""
    owner = adjustment.problem.stack.owner
    removable_counts = np.bincount(owner) - MIN_RETAINED_CORNERS
    removable = []
    for point in points:
        removable_counts[owner[point]] -= 1
        if removable_counts[owner[point]] >= 0:
            removable.append(point)
    return np.array(removable, dtype=np.int64)


def _largest_residual(adjustment: BundleAdjustment, lengths: NDArray[np.float64]) -> int | None:
    """Return the point with the largest residual among images that can lose one."""
    counts = np.bincount(adjustment.problem.stack.owner)
    can_lose = counts[adjustment.problem.stack.owner] > MIN_RETAINED_CORNERS
    return int(np.argmax(np.where(can_lose, lengths, -1.0))) if can_lose.any() else None


def without_rejected(
    observations: tuple[Observation, ...], outliers: tuple[Outlier, ...]
) -> tuple[Observation, ...]:
    """Return observations without the given outliers."""
    rejected: dict[str, list[int]] = {}
    for outlier in outliers:
        rejected.setdefault(outlier.image, []).append(outlier.corner)
    return tuple(
        s.subset(~np.isin(s.ids, rejected[s.name]))
        if s.name in rejected and s.ids is not None
        else s
        for s in observations
    )


# -- Recommendations for further calibration images ------------------------------------------------

RINGS, SECTORS = 4, 8
MIN_CORNERS_PER_CELL = 5  # minimum number of corners in a cell
MIN_TILT_DEG = 25.0  # minimum angle between board normals
SUFFICIENT_IMAGES = 10
SIDES = ("right", "lower right", "bottom", "lower left", "left", "upper left", "top", "upper right")


class Coverage(NamedTuple):
    """Distribution of corners over the image."""

    centre_px: tuple[float, float]
    radii_px: Array
    """Radii of the ring boundaries (rings + 1,), px."""
    counts: NDArray[np.int64]
    """Number of corners (rings, sectors); sectors are clockwise from the right."""
    tilts_deg: Array
    """Angles (m,) between each board's normal and the line of sight to its centre."""
    facing_deg: float
    """Largest angle between the normals of two boards; NaN if no pose is known."""


def coverage(
    observations: Sequence[Observation],
    centre_px: tuple[float, float],
    outer_radius_px: float | None = None,
) -> Coverage:
    """Return the distribution of corners, up to the rim or to the farthest corner if it is unknown.

    Boards without a pose contribute their corners only.
    """
    offsets = np.concatenate([s.pixels for s in observations]) - centre_px
    radius, azimuth = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
    outer = float(radius.max()) if outer_radius_px is None else outer_radius_px
    radii = outer * np.sqrt(np.linspace(0, 1, RINGS + 1))  # rings of equal areas
    ring = np.clip(np.searchsorted(radii, radius, side="right") - 1, 0, RINGS - 1)
    sector = np.round(azimuth / (2 * np.pi / SECTORS)).astype(int) % SECTORS
    counts = np.zeros((RINGS, SECTORS), dtype=np.int64)
    np.add.at(counts, (ring, sector), 1)
    board_poses = [
        (s.pose, s.points) for s in observations if s.pose is not None and not s.is_surveyed
    ]
    normals = np.array([pose.rotation[:, 2] for pose, _ in board_poses]).reshape(-1, 3)
    centres = np.array([pose(points).mean(axis=0) for pose, points in board_poses]).reshape(-1, 3)
    cosines_to_centre = np.sum(normals * centres, axis=1) / np.linalg.norm(centres, axis=1)
    cosines = np.clip(np.abs(normals @ normals.T), 0, 1)
    facing = float(np.degrees(np.arccos(cosines.min()))) if board_poses else float("nan")
    return Coverage(
        centre_px,
        radii,
        counts,
        np.degrees(np.arccos(np.clip(np.abs(cosines_to_centre), 0, 1))),
        facing,
    )


def recommendations(coverage: Coverage, images: int) -> tuple[str, ...]:
    """Return recommendations for further images, most important first; empty if coverage suffices."""
    sentences = []
    if images < SUFFICIENT_IMAGES:
        sentences.append(
            f"Capture more images: {images} {'is' if images == 1 else 'are'} used; "
            f"{SUFFICIENT_IMAGES} to 20 with the board at different positions are "
            "recommended."
        )
    outer = np.flatnonzero(coverage.counts[-1] < MIN_CORNERS_PER_CELL)
    if len(outer):
        low, high = coverage.radii_px[-2:]
        sentences.append(
            f"Hold the board across the edge of the field at the {_side_names(outer)}: few "
            f"corners there are {low:.0f} to {high:.0f} px from the centre."
        )
    inner = np.flatnonzero(coverage.counts[:-1].sum(axis=0) < MIN_CORNERS_PER_CELL)
    if len(inner):
        sentences.append(
            f"Hold the board towards the {_side_names(inner)} of the image: few corners were detected there."
        )
    if coverage.counts[0].sum() < MIN_CORNERS_PER_CELL:
        sentences.append(
            f"Hold the board nearer to the axis: few corners are within {coverage.radii_px[1]:.0f} px of the centre."
        )
    if images > 1 and coverage.facing_deg < MIN_TILT_DEG:
        sentences.append(
            f"Tilt the board more: its orientations differ by only {coverage.facing_deg:.0f} deg."
        )
    return tuple(sentences)


def _side_names(sectors: NDArray[np.int64]) -> str:
    names = [SIDES[i] for i in sectors]
    if len(names) == SECTORS:
        return "entire rim"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
