"""Sets of pictures that cannot be calibrated, and why: one sentence each, with the names of the pictures."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InvalidParameter
from .bundle.adjustment import Adjustment, adjust
from .bundle.observations import Sighting, rms_px

Array = NDArray[np.float64]

FEWEST_PICTURES = 3
FEWEST_POINTS = 12  # of a picture
MOST_NAMED = 6
SAME_TILT_DEG, SAME_PLACE = 4.0, 0.06
"""Boards that face directions so close, at places that differ by so much of their distance, are at the same pose."""
MOVED_SIGMAS, MOVED_PX, ROUNDS = 8.0, 1.5, 6
ODD = 1.5  # of the median error of pictures
HASTE = 1.5  # a centre moves by so much more than it says: poses follow it only in part
EXPLAINED = 1.5  # times less error that two centres leave
SEVERAL = (
    "the mirror's centre in each lies elsewhere than in the other pictures: the mirror moved against the camera, or "
    "pictures are flipped or cut; calibrate them apart"
)
ALONE = (
    "the mirror's centre in it lies {:.1f} px from that in the others: the mirror moved against the camera, or it is "
    "flipped or cut"
)
MOVED_GAIN = 100.0  # in the sum of squares over the noise's, for each picture that moved
BOARD_REMEDY = "see whether the board is the one that was named, and flat"
SURVEY_REMEDY = (
    "see whether their axes are right-handed and their units those of the file, whether all of a picture were seen "
    "from one place, and whether the pictures are mirror images, as --optics and --flipped say"
)
WORST_MEDIAN = 0.01  # of the picture's larger side; a start that leaves more is none


def listed(names: Sequence[str]) -> str:
    """Names as a sentence has them, the first few of many.

    >>> listed(["a", "b", "c"]), listed([str(i) for i in range(9)])
    ('a, b and c', '0, 1, 2, 3, 4, 5 and 3 more')
    """
    shown = list(names[:MOST_NAMED])
    if len(names) > MOST_NAMED:
        shown.append(f"{len(names) - MOST_NAMED} more")
    return shown[0] if len(shown) == 1 else f"{', '.join(shown[:-1])} and {shown[-1]}"


def check_detections(detections: Sequence[Any], board: Any, *, is_reversed: bool, fewest: int) -> tuple[int, int]:
    """The pictures' size, if there are enough of them that belong together.

    Parameters
    ----------
    detections
        Of all pictures.
    board
        That was looked for.
    is_reversed
        Whether a camera such as this delivers mirror images.
    fewest
        Of pictures that show the board.
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
    """Whether enough of a board was found, and nothing speaks against it."""
    return detection.reason is None and len(detection.ids) >= FEWEST_POINTS


def reason_of(detection: Any) -> str:
    """Why a picture is not used, with its name."""
    if detection.reason is None:
        return f"{detection.name}: {len(detection.ids)} corners were found, and {FEWEST_POINTS} are the fewest"
    return detection.reason if detection.name in detection.reason else f"{detection.name}: {detection.reason}"


def check_start(median_px: float, image_size: tuple[int, int], *, boards: bool = True) -> None:
    """Whether any camera explains the corners of boards, or surveyed points."""
    if not median_px < WORST_MEDIAN * max(image_size):
        what, remedy = ("corners", BOARD_REMEDY) if boards else ("points and directions", SURVEY_REMEDY)
        raise InvalidParameter(
            f"no camera explains the {what}: with the best half of them lie more than {median_px:.1f} px from where "
            f"they should; {remedy}"
        )


def check_poses(sightings: Sequence[Sighting]) -> None:
    """Whether boards were held differently at all, where nothing else is known."""
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


def check_still(adjustment: Adjustment) -> dict[str, str]:
    """Whether the mirror stayed where it was: whether all pictures agree where its centre lies.

    One picture that does not agree with the others is returned, name to reason; if there are more, nobody knows which
    are right.

    Each picture is given a centre of its own, in turn with the camera that they share; if these fall into two groups
    that lie farther apart than they scatter, and explain the corners far better than one centre does, something moved,
    or some pictures are flipped.
    """
    if not {"cx", "cy"} <= set(adjustment.names) or len(adjustment.sightings) <= FEWEST_PICTURES:
        return {}
    offsets = _own_centres(adjustment)
    if np.abs(offsets).max() < MOVED_PX:
        return {}
    shared, total = adjustment, np.zeros_like(offsets)
    for _ in range(ROUNDS):
        total += offsets
        back = [replace(s, pixels=s.pixels - o) for s, o in zip(shared.sightings, offsets, strict=True)]
        shared = shared.again(back, loss="cauchy", most_steps=20)
        offsets = _own_centres(shared)
    apart = two_groups(total)
    gain = np.sum(adjustment.residuals**2) - np.sum(shared.residuals**2)
    if apart is None or gain < MOVED_GAIN * apart[0].sum() * shared.question.noise_px**2:
        apart = _two_centres(adjustment, widest_gap(total))
    if apart is None:
        return _odd_one_out(adjustment)
    second, distance = apart
    moved = [s.name for s, far in zip(adjustment.sightings, second, strict=True) if far]
    others = [s.name for s, far in zip(adjustment.sightings, second, strict=True) if not far]
    if len(moved) == 1:
        return {moved[0]: ALONE.format(distance)}
    raise InvalidParameter(
        f"the mirror's centre in {listed(moved)} lies {distance:.1f} px from that in {listed(others)}: the mirror "
        "moved against the camera between them, or pictures are flipped or cut; calibrate them apart"
    )


def _two_centres(adjustment: Adjustment, second: NDArray[np.bool_]) -> tuple[NDArray[np.bool_], float] | None:
    """A group of pictures, and how far their centre lies from that of the others, if two centres explain far more.

    Where many moved, a centre of its own for each scatters as far as they moved: poses make up for it.
    """
    if min(second.sum(), (~second).sum()) < 2:
        return None
    shared, apart = adjustment, np.zeros(2)
    for _ in range(ROUNDS):
        offsets = _own_centres(shared)
        step = HASTE * (offsets[second].mean(axis=0) - offsets[~second].mean(axis=0))
        apart += step
        pictures = zip(shared.sightings, second, strict=True)
        shared = shared.again(
            [replace(s, pixels=s.pixels - step) if far else s for s, far in pictures], loss="cauchy", most_steps=20
        )
    distance = float(np.hypot(*apart))
    explained = adjustment.rms_px / shared.rms_px
    return (second, distance) if distance > MOVED_PX and explained > EXPLAINED else None


def _odd_one_out(adjustment: Adjustment) -> dict[str, str]:
    """The picture that fits worst, if the others alone agree much better and see its mirror's centre elsewhere.

    All together they may agree on something that is wrong for each.
    """
    errors = np.array([rms_px(adjustment.residuals_of(i)) for i in range(len(adjustment.sightings))])
    worst = int(np.argmax(errors))
    if len(errors) <= FEWEST_PICTURES + 1 or errors[worst] < ODD * np.median(errors):
        return {}
    odd = adjustment.sightings[worst]
    alone = adjustment.again([s for s in adjustment.sightings if s is not odd], loss="cauchy", most_steps=30)
    own = _with_own_centre(alone, odd)
    distance = float(np.hypot(*(_centre(own) - _centre(alone))))
    gain = (np.sum(adjustment.residuals**2) - np.sum(alone.residuals**2) - np.sum(own.residuals**2)) / alone.noise_px**2
    return {odd.name: ALONE.format(distance)} if gain > MOVED_GAIN and distance > MOVED_PX else {}


def _own_centres(adjustment: Adjustment) -> Array:
    """How far the centre (n, 2) of each picture lies from the middle one of all, px, if it alone were free."""
    centres = [_centre(_with_own_centre(adjustment, sighting)) for sighting in adjustment.sightings]
    return np.asarray(centres - np.median(centres, axis=0))


def _with_own_centre(adjustment: Adjustment, sighting: Sighting) -> Adjustment:
    """A picture whose pose and centre alone are free."""
    fixed = tuple(n for n in adjustment.names if n not in ("cx", "cy"))
    return adjust(
        adjustment.model, [sighting], shape=adjustment.shape, fixed=fixed, loss="cauchy",
        noise_px=adjustment.question.noise_px, most_steps=8,
    )  # fmt: skip


def _centre(adjustment: Adjustment) -> Array:
    values = {p.name: p.value for p in adjustment.model.parameters}
    return np.array([values["cx"], values["cy"]])


def two_groups(centres: Array) -> tuple[NDArray[np.bool_], float] | None:
    """Which of centres (n, 2) lie in the smaller of two groups that are far apart, and how far; None if they do not.

    >>> spread = np.random.default_rng(1).normal(0, 0.2, (8, 2))
    >>> two_groups(spread) is None
    True
    >>> two_groups(spread + np.array([[0.0, 0.0]] * 5 + [[6.0, 0.0]] * 3))[0].nonzero()[0]
    array([5, 6, 7])
    """
    upper = widest_gap(centres)
    distance = float(np.linalg.norm(centres[upper].mean(axis=0) - centres[~upper].mean(axis=0)))
    inside = np.concatenate([part - part.mean(axis=0) for part in (centres[upper], centres[~upper])])
    scatter = float(np.sqrt(np.sum(inside**2) / (2 * (len(centres) - 2))))
    if distance < max(MOVED_SIGMAS * scatter, MOVED_PX):
        return None
    return (upper if upper.sum() <= (~upper).sum() else ~upper), distance


def widest_gap(centres: Array) -> NDArray[np.bool_]:
    """Which of centres (n, 2) lie beyond the widest gap, along the line on which they scatter most."""
    offsets = centres - np.median(centres, axis=0)
    _, _, axes = np.linalg.svd(offsets, full_matrices=False)
    along = offsets @ axes[0]
    order = np.argsort(along)
    beyond = np.zeros(len(along), dtype=bool)
    beyond[order[int(np.argmax(np.diff(along[order]))) + 1 :]] = True
    return beyond


def without_strangers(adjustment: Adjustment) -> dict[str, str]:
    """Pictures that no pose of the board explains, with the reason: name to sentence."""
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
