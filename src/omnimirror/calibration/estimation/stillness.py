"""Whether the mirror stayed where it was, and the pictures as they were: whether all agree where its centre lies."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter, OmnimirrorError
from .bundle.adjustment import Adjustment
from .bundle.linearisation import without_slides
from .bundle.normal_equations import assembled, reduced_system, with_priors
from .bundle.sides import ends_of, flipped
from .bundle.steps import shared_values
from .checks import FEWEST_PICTURES, listed

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOVED_PX = 1.5
"""A centre that lies nearer to the others' is called the same."""
CHANCE = 1e-3
"""That pictures in which nothing moved are said to fall into two groups."""
PLAUSIBLE = 0.05
"""The same, above which it is not looked at more closely."""
MOVED_GAIN = 100.0
"""Least gain of two centres, in the sum of squares over the noise's."""
FLIPPED_GAIN, CLEAN = 25.0, 2.0
"""The same of a picture that is flipped, with nothing more to adjust; and what centres may explain after all flips, a
number, for these to be believed."""
WORTH_A_FLIP, FLIPS_TRIED, MOSTLY = 8.0, 3, 0.6
"""Least gain of one picture's centre from side to side, to the first order; how many pictures are tried at once; and
the least share that two centres explain of what all do, where flips are to explain the rest."""
ROUNDS, ROUND_STEPS, AGREED_PX = 6, 20, 0.05
ROUNDING = 1e-9  # of the largest eigenvalue
CENTRE = {"mirror": "the mirror's centre", "fisheye": "the optical centre"}
MOVED = {
    "mirror": "the mirror moved against the camera",
    "fisheye": "the lens moved against the image sensor, as by zoom, focus or stabilisation",
}
SEVERAL = (
    "{centre} in each lies elsewhere than in the other pictures: {moved}, or pictures are flipped or cut; "
    "calibrate them apart"
)
ALONE = "{centre} in it lies {:.1f} px from that in the others: {moved}, or it is flipped or cut"
GROUPS = (
    "{centre} in {} lies {:.1f} px from that in {}: {moved} between them, or pictures are flipped or cut; "
    "calibrate them apart"
)
FLIPPED = "it fits the other pictures when it is flipped left to right, and not as it is: it was flipped"
HALF_FLIPPED = (
    "half of the pictures, {}, fit the others when they are flipped left to right, and not as they are: flip those "
    "that are not as the camera delivers them"
)


def check_still(adjustment: Adjustment) -> dict[str, str]:
    """Whether all pictures agree where the mirror's centre lies.

    One picture that does not agree with the others is returned, name to reason; if there are more, nobody knows which
    are right.

    Each picture is given a centre of its own, while camera, board and poses may follow. If two centres, of two groups
    of pictures, explain far more than what the others of these centres still explain then, something moved, or some
    pictures are flipped. How far centres scatter by errors of the model is part of that comparison.

    Raises
    ------
    InvalidParameter
        Two groups or more: the message names the smaller.
    """
    if len(adjustment.sightings) <= FEWEST_PICTURES:
        return {}
    apart = _two_centres(adjustment)
    if apart is None:
        return {}
    second, distance = apart
    names = np.array([s.name for s in adjustment.sightings])
    if second.sum() == 1:
        return {str(names[second][0]): reason(ALONE, adjustment, distance)}
    smaller, larger = listed(list(names[second])), listed(list(names[~second]))
    raise InvalidParameter(reason(GROUPS, adjustment, smaller, distance, larger))


def reason(sentence: str, adjustment: Adjustment, *values: object) -> str:
    """Fill in a sentence about centres that differ, for a mirror or for a fisheye."""
    optics = getattr(adjustment.model, "optics", "mirror")
    return sentence.format(*values, centre=CENTRE[optics], moved=MOVED[optics])


def flipped_pictures(adjustment: Adjustment) -> dict[str, str]:
    """Pictures that fit the others when they are flipped left to right: name to reason.

    Of boards whose mirror image is such a board too nothing else shows it. Pictures are flipped one after the other as
    long as much is gained, and believed if all pictures agree then, as far as the noise lets them, and begun with no
    other picture it ends as well.

    Raises
    ------
    InvalidParameter
        Half of the pictures: nobody knows which half.
    """
    count = len(adjustment.sightings)
    if count <= FEWEST_PICTURES:
        return {}
    own = OwnCentres.of(adjustment, np.zeros((count, 2)))
    (gained,), (explained, _) = own.of_groups(own.split()[None])[0], own.explained
    if gained < max(WORTH_A_FLIP, MOSTLY * explained):
        return {}
    ends = [_all_flips(*start) for start in _with_one_flipped(adjustment, np.zeros(count, dtype=bool))]
    if not ends:
        return {}
    fit, turned = min(ends, key=lambda one: float(np.sum(one[0].residuals ** 2)))
    rivals = [adjustment, *(other for other, those in ends if (those != turned).any())]
    left, numbers = OwnCentres.of(fit, np.zeros((count, 2))).explained
    if min(_gain(rival, fit) for rival in rivals) < FLIPPED_GAIN or left > CLEAN * numbers:
        return {}
    names = [s.name for s, is_turned in zip(adjustment.sightings, turned, strict=True) if is_turned]
    if 2 * len(names) == count:
        raise InvalidParameter(HALF_FLIPPED.format(listed(names)))
    return dict.fromkeys(names, FLIPPED)


@dataclass(frozen=True)
class OwnCentres:
    """What the residuals say of a centre of its own for each of m pictures, when everything else may follow.

    Parameters
    ----------
    information : (m, 2, m, 2)
        Of the offsets of the pictures' centres, 1/px^2.
    pull : (m, 2)
        Gradient of half of the sum of squares over the noise's, 1/px.
    """

    information: Array
    pull: Array

    @classmethod
    def of(cls, adjustment: Adjustment, applied: Array) -> OwnCentres:
        """By the derivatives of a fit in which centres (m, 2) px are moved already."""
        question, found = adjustment.question, without_slides(adjustment.linearised)
        count, points, free = len(question.stack.slices), len(question.stack.owner), int(question.free.sum())
        own = np.zeros((points, 2, count, 2))
        own[np.arange(points), :, question.stack.owner] = np.eye(2)
        shared = np.concatenate([found.d_shared[:, :, question.free], own.reshape(points, 2, -1)], axis=2)
        weights = found.seen / adjustment.noise_px**2
        blocks = assembled(question.stack, found.residuals, shared, found.d_motion, weights, question.moving)
        known, rest = question.prior(shared_values(adjustment.estimate)), (0, 2 * count)
        matrix, right = reduced_system(with_priors(blocks, np.pad(known.information, rest), np.pad(known.pull, rest)))
        scale = 1 / np.sqrt(np.maximum(np.diag(matrix)[:free], 1e-300))
        camera = np.linalg.pinv(matrix[:free, :free] * scale[:, None] * scale, rcond=ROUNDING, hermitian=True)
        taken_up = matrix[free:, :free] @ (camera * scale[:, None] * scale)
        information = matrix[free:, free:] - taken_up @ matrix[:free, free:]
        pull = right[free:] - taken_up @ right[:free] - information @ applied.ravel()
        return cls(information.reshape(count, 2, count, 2), pull.reshape(count, 2))

    @property
    def explained(self) -> tuple[float, int]:
        """What all centres together gain, in the sum of squares over the noise's, and how many numbers that takes."""
        values, vectors = self._eigen()
        return float(np.sum((vectors.T @ self.pull.ravel()) ** 2 / values)), len(values)

    @property
    def offsets(self) -> Array:
        """Of the centres (m, 2), px, as far as they are determined."""
        values, vectors = self._eigen()
        return np.asarray(-(vectors / values) @ (vectors.T @ self.pull.ravel())).reshape(-1, 2)

    def _eigen(self) -> tuple[Array, Array]:
        values, vectors = np.linalg.eigh(self.information.reshape(2 * len(self.pull), -1))
        known = values > ROUNDING * values[-1]
        return values[known], vectors[:, known]

    def of_groups(self, groups: NDArray[np.bool_]) -> tuple[Array, Array]:
        """What one offset for all of a group gains (k,), and the offset (k, 2), px, of groups (k, m)."""
        part = groups.astype(float)
        information = np.einsum("km,minj,kn->kij", part, self.information, part, optimize=True)
        information += ROUNDING * np.trace(information, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        pull = part @ self.pull
        offsets = -np.linalg.solve(information, pull[..., None])[..., 0]
        return -np.sum(pull * offsets, axis=1), offsets

    def split(self) -> Mask:
        """The group of pictures (m,) of which one offset gains the most.

        Begun with what came after one of the pictures, each picture alone, and what lies beyond each along the line on
        which the centres scatter most; then one picture at a time changes sides.
        """
        count = len(self.pull)
        scattered = self.offsets - np.median(self.offsets, axis=0)
        order = np.argsort(scattered @ np.linalg.svd(scattered, full_matrices=False)[2][0])
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


def _all_flips(fit: Adjustment, turned: Mask) -> tuple[Adjustment, Mask]:
    """The fit after flips of one picture after the other, and the smaller group (m,) of pictures that differ."""
    while True:
        better = min(_with_one_flipped(fit, turned), key=lambda one: float(np.sum(one[0].residuals ** 2)), default=None)
        if better is None or _gain(fit, better[0]) < FLIPPED_GAIN:
            break
        fit, turned = better
    is_first = 2 * turned.sum() == len(turned) and turned[0]  # of two halves that which lacks the first
    return fit.again(fit.sightings), ~turned if 2 * turned.sum() > len(turned) or is_first else turned


def _with_one_flipped(fit: Adjustment, turned: Mask) -> list[tuple[Adjustment, Mask]]:
    """Fits with one more picture flipped, and which are.

    A flip shifts the centre from side to side: pictures are tried that gain the most if they alone may shift so.
    """
    count, ends_mm, width = len(fit.sightings), ends_of(fit.sightings), fit.model.image_size[0]
    own = OwnCentres.of(fit, np.zeros((count, 2)))
    across = own.pull[:, 0] ** 2 / np.maximum(own.information[range(count), 0, range(count), 0], 1e-300)
    across[[s.is_surveyed for s in fit.sightings]] = 0.0
    tried = []
    for number in np.argsort(-across)[:FLIPS_TRIED]:
        if across[number] < WORTH_A_FLIP:
            break
        other = [flipped(s, ends_mm, width) if i == number else s for i, s in enumerate(fit.sightings)]
        with suppress(OmnimirrorError):  # where the flip leads to no camera at all
            tried.append((fit.again(other, most_steps=ROUND_STEPS), turned ^ (np.arange(count) == number)))
    return tried


def _gain(before: Adjustment, after: Adjustment) -> float:
    """What an adjustment is better than another, in the sum of squares over the noise's."""
    return float(np.sum(before.residuals**2) - np.sum(after.residuals**2)) / after.noise_px**2


def _two_centres(adjustment: Adjustment) -> tuple[Mask, float] | None:
    """The smaller of two groups of pictures, and how far its centre lies from that of the others, px."""
    count = len(adjustment.sightings)
    fit, applied = adjustment, np.zeros((count, 2))
    for number in range(ROUNDS):
        own = OwnCentres.of(fit, applied)
        second = own.split()
        (gain,), (offset,) = own.of_groups(second[None])
        explained, numbers = own.explained
        if number == 0 and _chance(float(gain), explained - float(gain), count, numbers) > PLAUSIBLE:
            return None
        step = offset * second[:, None] - applied
        applied = applied + step
        moved = [replace(s, pixels=s.pixels - o) for s, o in zip(fit.sightings, step, strict=True)]
        fit = fit.again(moved, most_steps=ROUND_STEPS)
        if np.abs(step).max() < AGREED_PX:
            break
    gained = _gain(adjustment, fit)
    left, numbers = OwnCentres.of(fit, np.zeros((count, 2))).explained
    distance = float(np.hypot(*offset))
    is_apart = distance > MOVED_PX and gained > MOVED_GAIN and _chance(gained, left, count, numbers) < CHANCE
    return (second, distance) if is_apart else None


def _chance(gain: float, left: float, count: int, numbers: int) -> float:
    """How probable it is that the best of all splits gains so much where centres scatter as they do within groups.

    Fisher's F with 2 degrees of freedom above is beyond x by chance ``(1 + 2 x / d)^(-d / 2)``. Pictures whose centres
    lie in a plane can be parted by a line in some ``count^2 / 2`` ways.
    """
    others = max(numbers - 2, 1)
    beyond = (1 + gain / others / max(left / others, 1.0)) ** (-others / 2)
    return float(min(beyond * count**2 / 2, 1.0))
