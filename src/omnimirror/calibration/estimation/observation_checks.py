"""Checks of observations: usable images, outliers, coverage, recommended further images, and mount stability.

The mount is stable if the centres of the mirror in all images are consistent.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.typing import Array, Mask
from ._bundle_adjustment import (
    MEDIAN_OF_NOISE,
    BundleAdjustment,
    assembled,
    reduced_system,
    shared_values,
    with_priors,
)
from .observations import (
    UNSEEN_PX,
    Observation,
    board_ends,
    eliminate_line_positions,
    flipped_observations,
)

# -- Images, outliers and coverage -----------------------------------------------------------------

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


# -- Mount stability, consistency of the mirror centre over all images -----------------------------

SAME_CENTRE_PX = 1.5
"""Maximum distance of centres that count as equal."""
MAX_SPLIT_PROBABILITY = 1e-3
"""Probability that images without motion are split into two groups."""
MIN_PLAUSIBLE_PROBABILITY = 0.05
"""Probability above which no further test is made."""
MIN_MOTION_GAIN = 100.0
"""Minimum gain of two centres in the sum of squares over the noise variance."""
MIN_SPLIT_FRACTION = 0.65
"""Minimum fraction of the gain of all centres above the noise.

The best split of any number of centres explains 2 / pi of a normal scatter along a line, and half of
that in the plane.
"""
MIN_FLIPPED_GAIN, MAX_REMAINING_GAIN = 25.0, 2.0
"""Minimum gain of a flip, and maximum remaining gain of separate centres.

A flip adds no parameters. The remaining gain is per parameter, after all flips.
"""
MIN_FLIP_GAIN, MAX_FLIP_TRIALS, MIN_EXPLAINED_FRACTION = 8.0, 3, 0.6
"""Limits of the search for flipped images.

They are the minimum first-order gain of one image's horizontal centre offset, the number of
images tried at once, and the minimum fraction of the gain of all centres that two centres
explain.
"""
ROUNDS, ROUND_STEPS, AGREED_PX = 6, 20, 0.05
ROUNDING = 1e-9  # relative to the largest eigenvalue
CENTRE = {"mirror": "the mirror centre", "fisheye": "the optical centre"}
MOVED = {
    "mirror": "the mirror moved relative to the camera",
    "fisheye": "the lens moved relative to the image sensor (zoom, focus or stabilisation)",
}
SEVERAL = (
    "{centre} in each differs from that in the other images: {moved}, or images are flipped or cropped; "
    "calibrate them separately"
)
ALONE = "{centre} is {:.1f} px from that in the other images: {moved}, or the image is flipped or cropped"
GROUPS = (
    "{centre} in {} is {:.1f} px from that in {}: {moved} between them, or images are flipped or cropped; "
    "calibrate them separately"
)
FLIPPED = "it fits the other images only after flipping left to right: it was flipped"
HALF_FLIPPED = (
    "half of the images, {}, fit the others only after flipping left to right; flip those that differ from "
    "the camera's output"
)


def check_mount_stability(adjustment: BundleAdjustment) -> dict[str, str]:
    """Check that the mirror centre is the same in all images.

    A single inconsistent image is returned as name and reason; with larger groups it is ambiguous
    which images are correct.

    Each image obtains its own centre, while camera, board and poses adapt. If two centres, of two
    groups of images, explain much more than separate centres within the groups, the mirror moved or
    images are flipped. The comparison (an F test) accounts for the scatter of centres caused by
    model errors.

    Raises
    ------
    InvalidParameter
        If there are two or more groups; the message names the smaller.
    """
    if len(adjustment.observations) <= MIN_IMAGES:
        return {}
    groups = _two_centres(adjustment)
    if groups is None:
        return {}
    second, distance = groups
    names = np.array([s.name for s in adjustment.observations])
    if second.sum() == 1:
        return {str(names[second][0]): reason(ALONE, adjustment, distance)}
    smaller, larger = joined_names(list(names[second])), joined_names(list(names[~second]))
    raise InvalidParameter(reason(GROUPS, adjustment, smaller, distance, larger))


def reason(message: str, adjustment: BundleAdjustment, *values: object) -> str:
    """Return the message about different centres, for a mirror or for a fisheye."""
    optics = getattr(adjustment.model, "optics", "mirror")
    return message.format(*values, centre=CENTRE[optics], moved=MOVED[optics])


def flipped_images(adjustment: BundleAdjustment) -> dict[str, str]:
    """Return images that fit the others only when flipped left to right, as name and reason.

    For boards that equal their mirror image no other evidence exists. Images are flipped one at a
    time while the gain is significant. The result is accepted if all images then agree within the
    noise and no other initial image leads to a similar fit.

    Raises
    ------
    InvalidParameter
        If half of the images are flipped, since the correct half is ambiguous.
    """
    count = len(adjustment.observations)
    if count <= MIN_IMAGES:
        return {}
    centres = ImageCentres.of(adjustment, np.zeros((count, 2)))
    (gain,), (explained, _) = centres.of_groups(centres.split()[None])[0], centres.explained
    if gain < max(MIN_FLIP_GAIN, MIN_EXPLAINED_FRACTION * explained):
        return {}
    fits = [
        _all_flips(*start) for start in _with_one_flipped(adjustment, np.zeros(count, dtype=bool))
    ]
    if not fits:
        return {}
    fit, is_flipped = min(fits, key=lambda candidate: float(np.sum(candidate[0].residuals ** 2)))
    rivals = [adjustment, *(other for other, mask in fits if (mask != is_flipped).any())]
    remaining_gain, degrees_of_freedom = ImageCentres.of(fit, np.zeros((count, 2))).explained
    if (
        min(_gain(rival, fit) for rival in rivals) < MIN_FLIPPED_GAIN
        or remaining_gain > MAX_REMAINING_GAIN * degrees_of_freedom
    ):
        return {}
    names = [
        s.name for s, flipped in zip(adjustment.observations, is_flipped, strict=True) if flipped
    ]
    if 2 * len(names) == count:
        raise InvalidParameter(HALF_FLIPPED.format(joined_names(names)))
    return dict.fromkeys(names, FLIPPED)


@dataclass(frozen=True)
class ImageCentres:
    """First-order estimate of a separate centre for each of m images, while all else adapts.

    Parameters
    ----------
    information : (m, 2, m, 2)
        Information matrix of the centre offsets, 1/px^2.
    pull : (m, 2)
        Gradient of 0.5 times the sum of squares over the noise variance, 1/px.
    """

    information: Array
    pull: Array

    @classmethod
    def of(cls, adjustment: BundleAdjustment, applied: Array) -> ImageCentres:
        """Compute from the derivatives of a fit with applied centre offsets (m, 2) px."""
        problem, linearised = adjustment.problem, eliminate_line_positions(adjustment.linearised)
        count, points, free = (
            len(problem.stack.slices),
            len(problem.stack.owner),
            int(problem.free.sum()),
        )
        d_centres = np.zeros((points, 2, count, 2))
        d_centres[np.arange(points), :, problem.stack.owner] = np.eye(2)
        shared = np.concatenate(
            [linearised.d_shared[:, :, problem.free], d_centres.reshape(points, 2, -1)], axis=2
        )
        weights = linearised.visible / adjustment.noise_px**2
        blocks = assembled(
            problem.stack, linearised.residuals, shared, linearised.d_pose, weights, problem.moving
        )
        prior, padding = problem.prior(shared_values(adjustment.estimate)), (0, 2 * count)
        matrix, right = reduced_system(
            with_priors(blocks, np.pad(prior.information, padding), np.pad(prior.pull, padding))
        )
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix)[:free], 1e-300))
        camera = np.linalg.pinv(
            matrix[:free, :free] * scale[:, None] * scale, rcond=ROUNDING, hermitian=True
        )
        absorbed = matrix[free:, :free] @ (camera * scale[:, None] * scale)
        information = matrix[free:, free:] - absorbed @ matrix[:free, free:]
        pull = right[free:] - absorbed @ right[:free] - information @ applied.ravel()
        return cls(information.reshape(count, 2, count, 2), pull.reshape(count, 2))

    @property
    def explained(self) -> tuple[float, int]:
        """Gain of all centres in the normalised sum of squares, and number of parameters."""
        values, vectors = self._eigen()
        return float(np.sum((vectors.T @ self.pull.ravel()) ** 2 / values)), len(values)

    @property
    def offsets(self) -> Array:
        """Offsets of the centres (m, 2) px, as far as they are determined."""
        values, vectors = self._eigen()
        return np.asarray(-(vectors / values) @ (vectors.T @ self.pull.ravel())).reshape(-1, 2)

    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self.information.reshape(2 * len(self.pull), -1))
        is_determined = values > ROUNDING * values[-1]
        return values[is_determined], vectors[:, is_determined]

    def of_groups(self, groups: NDArray[np.bool_]) -> tuple[Array, Array]:
        """Return the gain (k,) of a common offset of groups (k, m), and the offsets (k, 2) px."""
        part = groups.astype(float)
        information = np.einsum("km,minj,kn->kij", part, self.information, part, optimize=True)
        information += ROUNDING * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        pull = part @ self.pull
        offsets = -np.linalg.solve(information, pull[..., None])[..., 0]
        return -np.sum(pull * offsets, axis=1), offsets

    def split(self) -> Mask:
        """Return the group of images (m,) with the largest gain by a common offset.

        Initial groups are all images after one image, each image alone, and the images beyond each
        along the principal axis of the scatter of centres. Single images are then moved between the
        groups while the gain increases.
        """
        count = len(self.pull)
        centred = self.offsets - np.median(self.offsets, axis=0)
        order = np.argsort(centred @ np.linalg.svd(centred, full_matrices=False)[2][0])
        after = np.tri(count, count - 1, -1, dtype=bool).T
        beyond = np.zeros_like(after)
        beyond[:, order] = after
        groups = np.concatenate([after, np.eye(count, dtype=bool), beyond])
        gains, _ = self.of_groups(groups)
        best, gain = groups[np.argmax(gains)], float(gains.max())
        while True:
            changed = best ^ np.eye(count, dtype=bool)
            changed = changed[changed.any(axis=1) & ~changed.all(axis=1)]
            gains, _ = self.of_groups(changed)
            if gains.max() <= gain:
                return np.asarray(best if 2 * best.sum() <= count else ~best)
            best, gain = changed[np.argmax(gains)], float(gains.max())


def _all_flips(fit: BundleAdjustment, is_flipped: Mask) -> tuple[BundleAdjustment, Mask]:
    """Return the fit after successive flips and the smaller group (m,) of flipped images."""
    while True:
        best = min(
            _with_one_flipped(fit, is_flipped),
            key=lambda candidate: float(np.sum(candidate[0].residuals ** 2)),
            default=None,
        )
        if best is None or _gain(fit, best[0]) < MIN_FLIPPED_GAIN:
            break
        fit, is_flipped = best
    is_first = (
        2 * is_flipped.sum() == len(is_flipped) and is_flipped[0]
    )  # half without the first image
    return fit.refit(fit.observations), ~is_flipped if 2 * is_flipped.sum() > len(
        is_flipped
    ) or is_first else is_flipped


def _with_one_flipped(
    fit: BundleAdjustment, is_flipped: Mask
) -> list[tuple[BundleAdjustment, Mask]]:
    """Return fits with one more image flipped, and the flipped images.

    A flip shifts the centre horizontally: images with the largest gain by such a shift are tried.
    """
    count, ends_mm, width = (
        len(fit.observations),
        board_ends(fit.observations),
        fit.model.image_size[0],
    )
    centres = ImageCentres.of(fit, np.zeros((count, 2)))
    gains = centres.pull[:, 0] ** 2 / np.maximum(
        centres.information[range(count), 0, range(count), 0], 1e-300
    )
    gains[[s.is_surveyed for s in fit.observations]] = 0.0
    fits = []
    for number in np.argsort(-gains)[:MAX_FLIP_TRIALS]:
        if gains[number] < MIN_FLIP_GAIN:
            break
        other = [
            flipped_observations(s, ends_mm, width) if i == number else s
            for i, s in enumerate(fit.observations)
        ]
        with suppress(OmnimirrorError):  # the flip may lead to no valid camera
            fits.append(
                (fit.refit(other, max_steps=ROUND_STEPS), is_flipped ^ (np.arange(count) == number))
            )
    return fits


def _gain(before: BundleAdjustment, after: BundleAdjustment) -> float:
    """Return the decrease of the sum of squares between two fits over the noise variance."""
    return float(np.sum(before.residuals**2) - np.sum(after.residuals**2)) / after.noise_px**2


def _two_centres(adjustment: BundleAdjustment) -> tuple[Mask, float] | None:
    """Return the smaller of two groups of images and the distance of their centres in px."""
    count = len(adjustment.observations)
    fit, applied = adjustment, np.zeros((count, 2))
    for number in range(ROUNDS):
        centres = ImageCentres.of(fit, applied)
        second = centres.split()
        (gain,), (offset,) = centres.of_groups(second[None])
        explained, degrees_of_freedom = centres.explained
        if (
            number == 0
            and _chance(float(gain), explained - float(gain), count, degrees_of_freedom)
            > MIN_PLAUSIBLE_PROBABILITY
        ):
            return None
        step = offset * second[:, None] - applied
        applied = applied + step
        moved = [
            replace(s, pixels=s.pixels - o) for s, o in zip(fit.observations, step, strict=True)
        ]
        fit = fit.refit(moved, max_steps=ROUND_STEPS)
        if np.abs(step).max() < AGREED_PX:
            break
    total_gain = _gain(adjustment, fit)
    remaining_gain, degrees_of_freedom = ImageCentres.of(fit, np.zeros((count, 2))).explained
    distance = float(np.hypot(*offset))
    is_significant = (
        distance > SAME_CENTRE_PX
        and total_gain > MIN_MOTION_GAIN
        and total_gain * (1 - MIN_SPLIT_FRACTION)
        > MIN_SPLIT_FRACTION * (remaining_gain - degrees_of_freedom)
        and _chance(total_gain, remaining_gain, count, degrees_of_freedom) < MAX_SPLIT_PROBABILITY
    )
    return (second, distance) if is_significant else None


def _chance(gain: float, remaining_gain: float, count: int, degrees_of_freedom: int) -> float:
    """Return the probability that the best split gains as much by chance.

    The scatter of centres within groups is taken into account.

    Fisher's F distribution with 2 and d degrees of freedom exceeds x with probability
    ``(1 + 2 x / d)^(-d / 2)``. There are about ``count^2 / 2`` splits of points in a plane by a
    line.
    """
    others = max(degrees_of_freedom - 2, 1)
    beyond = (1 + gain / others / max(remaining_gain / others, 1.0)) ** (-others / 2)
    return float(min(beyond * count**2 / 2, 1.0))
