"""Checks of observations: usable images, outliers, coverage, and recommended further images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.typing import Array
from ._bundle_adjustment import MEDIAN_OF_NOISE, Adjustment
from ._residuals import UNSEEN_PX
from .observations import Sighting

# -- Checks of calibration images, with error messages that name the affected images ---------------

MIN_IMAGES = 3
MIN_CORNERS_PER_IMAGE = 12  # per image
MAX_NAMED = 6
SAME_TILT_DEG, SAME_PLACE = 4.0, 0.06
"""Maximum tilt and relative position difference of boards that count as one pose."""
BOARD_REMEDY = "see whether the board is the one that was named, and flat"
SURVEY_REMEDY = (
    "see whether their axes are right-handed and their units those of the file, whether all of a picture were seen "
    "from one place, and whether the pictures are mirror images, as --optics and --flipped say"
)
WORST_MEDIAN = 0.01  # maximum initial median residual, fraction of the larger image side


def joined_names(names: Sequence[str]) -> str:
    """Return names joined for a sentence; a long list is truncated.

    >>> joined_names(["a", "b", "c"]), joined_names([str(i) for i in range(9)])
    ('a, b and c', '0, 1, 2, 3, 4, 5 and 3 more')
    """
    shown = list(names[:MAX_NAMED])
    if len(names) > MAX_NAMED:
        shown.append(f"{len(names) - MAX_NAMED} more")
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def check_detections(
    detections: Sequence[Any], board: Any, *, is_reversed: bool, fewest: int
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
    fewest
        Minimum number of images that show the board.
    """
    sizes = Counter(tuple(d.image_size) for d in detections if is_used(d))
    if len(sizes) > 1:
        (usual, _), *others = sizes.most_common()
        odd = [d.name for d in detections if is_used(d) and tuple(d.image_size) != usual]
        names = ", ".join(f"{w} x {h}" for (w, h), _ in others)
        raise InvalidParameter(
            f"{joined_names(odd)}: {names} px, where the other pictures have "
            f"{usual[0]} x {usual[1]} px; pictures of one "
            "calibration are all as the camera delivers them"
        )
    if not detections:
        raise InvalidParameter("there are no pictures; 10 or more of a board are usual")
    used = [d for d in detections if is_used(d)]
    if len(used) < fewest:
        missing = [d for d in detections if not is_used(d)]
        reasons = "; ".join(reason_of(d) for d in missing[:MAX_NAMED])
        raise InvalidParameter(
            f"the board ({board}) was found well enough in {len(used)} of {len(detections)} pictures"
            f"{f' ({joined_names([d.name for d in used])})' if used else ''}, and "
            f"{fewest} {'is' if fewest == 1 else 'are'} the fewest, 10 or more are usual"
            f"{': ' if reasons else ''}{reasons}"
        )
    wrong = [d.name for d in used if d.is_reversed is not None and d.is_reversed != is_reversed]
    if wrong:
        what = (
            "not mirror images, and a mirror's are"
            if is_reversed
            else "mirror images, and those of a fisheye are not"
        )
        whole = len(wrong) == sum(d.is_reversed is not None for d in used)
        remedy = (
            "say --flipped if the camera's driver reverses them, or choose the other --optics"
            if whole
            else "leave them out, or flip them as the others are"
        )
        raise InvalidParameter(f"{joined_names(wrong)}: the board's markers show {what}; {remedy}")
    return next(iter(sizes))


def is_used(detection: Any) -> bool:
    """Return whether a detection has enough corners and no reason against its use."""
    return detection.reason is None and len(detection.ids) >= MIN_CORNERS_PER_IMAGE


def reason_of(detection: Any) -> str:
    """Return the reason for which an image is not used, with its name."""
    if detection.reason is None:
        return f"{detection.name}: {len(detection.ids)} corners were found, and {MIN_CORNERS_PER_IMAGE} are the fewest"
    return (
        detection.reason
        if detection.name in detection.reason
        else f"{detection.name}: {detection.reason}"
    )


def check_start(median_px: float, image_size: tuple[int, int], *, boards: bool = True) -> None:
    """Check that a camera explains the corners of boards, or surveyed points."""
    if not median_px < WORST_MEDIAN * max(image_size):
        what, remedy = (
            ("corners", BOARD_REMEDY) if boards else ("points and directions", SURVEY_REMEDY)
        )
        raise InvalidParameter(
            f"no camera explains the {what}: with the best half of them lie more than {median_px:.1f} px from where "
            f"they should; {remedy}"
        )


def check_poses(sightings: Sequence[Sighting]) -> None:
    """Check that the board poses differ, unless there are surveyed points."""
    if any(s.is_surveyed for s in sightings):
        return
    motions = [s.motion for s in sightings if s.motion is not None]
    normals = np.array([m.rotation[:, 2] for m in motions])
    middles = np.array([m(s.points).mean(axis=0) for m, s in zip(motions, sightings, strict=True)])
    tilt = float(np.degrees(np.arccos(np.clip((normals @ normals.T).min(), -1, 1))))
    distance = float(np.linalg.norm(middles, axis=1).mean())
    spread = float(np.linalg.norm(middles[:, None] - middles[None], axis=2).max())
    if tilt < SAME_TILT_DEG and spread < SAME_PLACE * distance:
        raise InvalidParameter(
            f"the board is at the same place in all pictures ({joined_names([s.name for s in sightings])}); hold it at "
            "different places and angles, all around"
        )


def inconsistent_images(adjustment: Adjustment) -> dict[str, str]:
    """Return images without a consistent board pose, as a mapping of name to reason."""
    medians = np.array(
        [
            np.median(np.hypot(*adjustment.residuals_of(i).T))
            for i in range(len(adjustment.sightings))
        ]
    )
    unseen = np.array(
        [1 - adjustment.seen[where].mean() for where in adjustment.question.stack.slices]
    )
    usual = max(float(np.median(medians)), 0.05)
    limit = max(10 * usual, 1.0)
    return {
        s.name: (
            f"its corners lie {median:.1f} px from where a board can have them (the median), those of the other "
            f"pictures {usual:.2f} px"
            if hidden < 0.5
            else "the camera that fits the other pictures cannot see a board there"
        )
        for s, median, hidden in zip(adjustment.sightings, medians, unseen, strict=True)
        if median > limit or hidden >= 0.5
    }


# -- Outlier rejection with a limit on the number of rejected corners ------------------------------
#
# Rejection of all corners that a model does not fit makes any model appear good. Therefore at most
# 1 % are rejected, one at a time with an adjustment in between, by the best available model; the
# set is frozen before models are compared. Gross errors, 3 times beyond the noise limit, do not
# depend on the model: up to 5 % are rejected, together if several have similar size. Remaining
# corners beyond the noise are reported.

MAX_REJECTED, MAX_GROSS = 0.01, 0.05  # fraction of all corners
GROSS = 3.0  # multiple of the noise limit
ALIKE = 0.5  # fraction of the largest gross error above which others are rejected together with it
MAX_ABSORBED = 0.75  # maximum fraction of the noise absorbed by estimated parameters
DOUBT = 1.44  # two relative standard errors of the Rayleigh median, times sqrt(n)
CHANCE = 0.02  # probability that data without gross errors lose a corner
MIN_REJECTED_PX = 0.25  # corners with smaller residuals are never rejected
MIN_RETAINED_CORNERS = 6  # minimum number of corners retained per image


class Outlier(NamedTuple):
    """Rejected corner."""

    picture: str
    corner: int
    residual_px: float


def outlier_limit_px(adjustment: Adjustment) -> float:
    """Return the residual above which a corner is an outlier of normally distributed noise."""
    lengths = np.hypot(*adjustment.residuals[adjustment.seen].T)
    taken_up = 1 - min(
        adjustment.unknowns / max(2 * len(lengths), 1), MAX_ABSORBED
    )  # noise in parameters
    noise = float(np.median(lengths)) / MEDIAN_OF_NOISE / np.sqrt(taken_up) if len(lengths) else 0.0
    noise *= 1 + DOUBT / np.sqrt(max(len(lengths), 1))
    return max(
        float(noise) * float(np.sqrt(2 * np.log(max(len(lengths), 2) / CHANCE))), MIN_REJECTED_PX
    )


def without_outliers(
    adjustment: Adjustment, *, most: int | None = None
) -> tuple[Adjustment, tuple[Outlier, ...]]:
    """Reject the worst corner and adjust again until none is significant or the limit is reached.

    Parameters
    ----------
    adjustment
        Robust or least-squares fit to all corners.
    most
        Maximum number of rejected corners; by default 1 %, of gross errors 5 %, and at least 1.

    Returns
    -------
    adjustment
        Least-squares fit to the remaining corners.
    outliers
        Rejected corners, worst first.
    """
    count = len(adjustment.residuals)
    left, left_gross = (
        (max(1, int(s * count)) if most is None else most) for s in (MAX_REJECTED, MAX_GROSS)
    )
    found: list[Outlier] = []
    now = adjustment
    while True:
        lengths = np.where(now.seen, np.hypot(*now.residuals.T), UNSEEN_PX)
        at, limit = _worst(now, lengths), outlier_limit_px(now)
        if at is None or lengths[at] <= limit:
            break
        rejected = np.array([at])
        if lengths[at] > GROSS * limit:
            alike = np.flatnonzero(lengths > max(GROSS * limit, ALIKE * lengths[at]))
            rejected = _spared(now, alike[np.argsort(-lengths[alike])][: left_gross - len(found)])
        if len(found) + len(rejected) > (
            left_gross if lengths[at] > GROSS * limit else left
        ) or not len(rejected):
            break
        outliers = [_outlier(now, int(i), float(lengths[i])) for i in rejected]
        found += outliers
        now = now.again(
            without_rejected(now.sightings, tuple(outliers)),
            loss="cauchy",
            noise_px=now.question.noise_px,
            most_steps=2,
        )
    kept = now.again(now.sightings)
    return kept, tuple(sorted(found, key=lambda o: -o.residual_px))


def remaining_outliers(adjustment: Adjustment) -> tuple[Outlier, ...]:
    """Return corners of the final fit with residuals beyond the noise, worst first.

    They are outliers beyond the rejection limit, or corners of a board or an image that the model
    does not describe.
    """
    lengths = np.where(adjustment.seen, np.hypot(*adjustment.residuals.T), UNSEEN_PX)
    beyond = np.flatnonzero(lengths > outlier_limit_px(adjustment))
    return tuple(
        _outlier(adjustment, int(i), float(lengths[i]))
        for i in beyond[np.argsort(-lengths[beyond])]
    )


def _outlier(adjustment: Adjustment, at: int, length_px: float) -> Outlier:
    """Return a point of an adjustment with its image and number."""
    stack = adjustment.question.stack
    return Outlier(adjustment.sightings[int(stack.owner[at])].name, int(stack.ids[at]), length_px)


def _spared(adjustment: Adjustment, points: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the points, in order, that can be removed while each image retains the minimum."""
    owner = adjustment.question.stack.owner
    spare = np.bincount(owner) - MIN_RETAINED_CORNERS
    kept = []
    for point in points:
        spare[owner[point]] -= 1
        if spare[owner[point]] >= 0:
            kept.append(point)
    return np.array(kept, dtype=np.int64)


def _worst(adjustment: Adjustment, lengths: NDArray[np.float64]) -> int | None:
    """Return the point with the largest residual among images that can lose one."""
    counts = np.bincount(adjustment.question.stack.owner)
    spare = counts[adjustment.question.stack.owner] > MIN_RETAINED_CORNERS
    return int(np.argmax(np.where(spare, lengths, -1.0))) if spare.any() else None


def without_rejected(
    sightings: tuple[Sighting, ...], outliers: tuple[Outlier, ...]
) -> tuple[Sighting, ...]:
    """Return sightings without the given outliers."""
    named: dict[str, list[int]] = {}
    for outlier in outliers:
        named.setdefault(outlier.picture, []).append(outlier.corner)
    return tuple(
        s.only(~np.isin(s.ids, named[s.name])) if s.name in named and s.ids is not None else s
        for s in sightings
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
    """Number of corners (rings, sectors); sectors run from the right over the bottom."""
    tilts_deg: Array
    """Angles (m,) between each board's normal and the line of sight to its centre."""
    facing_deg: float
    """Largest angle between the normals of two boards; NaN if no pose is known."""


def coverage(
    sightings: Sequence[Sighting],
    centre_px: tuple[float, float],
    outer_radius_px: float | None = None,
) -> Coverage:
    """Return the distribution of corners, up to the rim or to the farthest corner if it is unknown.

    Boards without a pose contribute their corners only.
    """
    offsets = np.concatenate([s.pixels for s in sightings]) - centre_px
    radius, azimuth = np.hypot(*offsets.T), np.arctan2(offsets[:, 1], offsets[:, 0])
    outer = float(radius.max()) if outer_radius_px is None else outer_radius_px
    radii = outer * np.sqrt(np.linspace(0, 1, RINGS + 1))  # rings of equal areas
    ring = np.clip(np.searchsorted(radii, radius, side="right") - 1, 0, RINGS - 1)
    sector = np.round(azimuth / (2 * np.pi / SECTORS)).astype(int) % SECTORS
    counts = np.zeros((RINGS, SECTORS), dtype=np.int64)
    np.add.at(counts, (ring, sector), 1)
    placed = [(s.motion, s.points) for s in sightings if s.motion is not None and not s.is_surveyed]
    normals = np.array([motion.rotation[:, 2] for motion, _ in placed]).reshape(-1, 3)
    middles = np.array([motion(points).mean(axis=0) for motion, points in placed]).reshape(-1, 3)
    toward = np.sum(normals * middles, axis=1) / np.linalg.norm(middles, axis=1)
    cosines = np.clip(np.abs(normals @ normals.T), 0, 1)
    facing = float(np.degrees(np.arccos(cosines.min()))) if placed else float("nan")
    return Coverage(
        centre_px, radii, counts, np.degrees(np.arccos(np.clip(np.abs(toward), 0, 1))), facing
    )


def recommendations(found: Coverage, pictures: int) -> tuple[str, ...]:
    """Return recommendations for further images, most important first; empty if coverage suffices."""
    sentences = []
    if pictures < SUFFICIENT_IMAGES:
        sentences.append(
            f"Take more pictures: {pictures} {'is' if pictures == 1 else 'are'} used, and "
            f"{SUFFICIENT_IMAGES} to 20 with the board at different places are usual."
        )
    outer = np.flatnonzero(found.counts[-1] < MIN_CORNERS_PER_CELL)
    if len(outer):
        low, high = found.radii_px[-2:]
        sentences.append(
            f"Hold the board so that it reaches the edge of the picture at the {_listed(outer)}: few corners lie "
            f"{low:.0f} to {high:.0f} px from the centre there."
        )
    inner = np.flatnonzero(found.counts[:-1].sum(axis=0) < MIN_CORNERS_PER_CELL)
    if len(inner):
        sentences.append(
            f"Hold the board towards the {_listed(inner)} of the picture: hardly any corner lies there."
        )
    if found.counts[0].sum() < MIN_CORNERS_PER_CELL:
        sentences.append(
            f"Hold the board nearer to the axis: few corners lie within {found.radii_px[1]:.0f} px of the centre."
        )
    if pictures > 1 and found.facing_deg < MIN_TILT_DEG:
        sentences.append(
            f"Tilt the board more: its directions in the pictures differ by {found.facing_deg:.0f} deg only."
        )
    return tuple(sentences)


def _listed(sectors: NDArray[np.int64]) -> str:
    names = [SIDES[i] for i in sectors]
    if len(names) == SECTORS:
        return "whole rim"
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
