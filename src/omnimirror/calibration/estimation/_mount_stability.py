"""Mount stability: consistency of the mirror centre over all images."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...base.errors import InvalidParameter, OmnimirrorError
from ...base.typing import Array, Mask
from ._bundle_adjustment import (
    BundleAdjustment,
    assembled,
    reduced_system,
    shared_values,
    with_priors,
)
from ._residuals import eliminate_line_positions
from .observation_checks import MIN_IMAGES, joined_names
from .observations import board_ends, flipped_observations

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
