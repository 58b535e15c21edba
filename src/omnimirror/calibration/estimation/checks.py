"""Checks of calibration images, with error messages that name the affected images."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...base.errors import InvalidParameter
from .bundle.adjustment import Adjustment
from .bundle.observations import Sighting

FEWEST_PICTURES = 3
FEWEST_POINTS = 12  # per image
MOST_NAMED = 6
SAME_TILT_DEG, SAME_PLACE = 4.0, 0.06
"""Maximum tilt and relative position difference of boards that count as one pose."""
BOARD_REMEDY = "see whether the board is the one that was named, and flat"
SURVEY_REMEDY = (
    "see whether their axes are right-handed and their units those of the file, whether all of a picture were seen "
    "from one place, and whether the pictures are mirror images, as --optics and --flipped say"
)
WORST_MEDIAN = 0.01  # maximum initial median residual, fraction of the larger image side


def listed(names: Sequence[str]) -> str:
    """Return names joined for a sentence; a long list is truncated.

    >>> listed(["a", "b", "c"]), listed([str(i) for i in range(9)])
    ('a, b and c', '0, 1, 2, 3, 4, 5 and 3 more')
    """
    shown = list(names[:MOST_NAMED])
    if len(names) > MOST_NAMED:
        shown.append(f"{len(names) - MOST_NAMED} more")
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def check_detections(detections: Sequence[Any], board: Any, *, is_reversed: bool, fewest: int) -> tuple[int, int]:
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
            f"{listed(odd)}: {names} px, where the other pictures have {usual[0]} x {usual[1]} px; pictures of one "
            "calibration are all as the camera delivers them"
        )
    if not detections:
        raise InvalidParameter("there are no pictures; 10 or more of a board are usual")
    used = [d for d in detections if is_used(d)]
    if len(used) < fewest:
        missing = [d for d in detections if not is_used(d)]
        reasons = "; ".join(reason_of(d) for d in missing[:MOST_NAMED])
        raise InvalidParameter(
            f"the board ({board}) was found well enough in {len(used)} of {len(detections)} pictures"
            f"{f' ({listed([d.name for d in used])})' if used else ''}, and "
            f"{fewest} {'is' if fewest == 1 else 'are'} the fewest, 10 or more are usual"
            f"{': ' if reasons else ''}{reasons}"
        )
    wrong = [d.name for d in used if d.is_reversed is not None and d.is_reversed != is_reversed]
    if wrong:
        what = (
            "not mirror images, and a mirror's are" if is_reversed else "mirror images, and those of a fisheye are not"
        )
        whole = len(wrong) == sum(d.is_reversed is not None for d in used)
        remedy = (
            "say --flipped if the camera's driver reverses them, or choose the other --optics"
            if whole
            else "leave them out, or flip them as the others are"
        )
        raise InvalidParameter(f"{listed(wrong)}: the board's markers show {what}; {remedy}")
    return next(iter(sizes))


def is_used(detection: Any) -> bool:
    """Return whether a detection has enough corners and no reason against its use."""
    return detection.reason is None and len(detection.ids) >= FEWEST_POINTS


def reason_of(detection: Any) -> str:
    """Return the reason for which an image is not used, with its name."""
    if detection.reason is None:
        return f"{detection.name}: {len(detection.ids)} corners were found, and {FEWEST_POINTS} are the fewest"
    return detection.reason if detection.name in detection.reason else f"{detection.name}: {detection.reason}"


def check_start(median_px: float, image_size: tuple[int, int], *, boards: bool = True) -> None:
    """Check that a camera explains the corners of boards, or surveyed points."""
    if not median_px < WORST_MEDIAN * max(image_size):
        what, remedy = ("corners", BOARD_REMEDY) if boards else ("points and directions", SURVEY_REMEDY)
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
            f"the board is at the same place in all pictures ({listed([s.name for s in sightings])}); hold it at "
            "different places and angles, all around"
        )


def without_strangers(adjustment: Adjustment) -> dict[str, str]:
    """Return images without a consistent board pose, as a mapping of name to reason."""
    medians = np.array([np.median(np.hypot(*adjustment.residuals_of(i).T)) for i in range(len(adjustment.sightings))])
    unseen = np.array([1 - adjustment.seen[where].mean() for where in adjustment.question.stack.slices])
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
