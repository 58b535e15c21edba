"""Detection of the mirror's rim, and of the camera's own image, in one or several images."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import check_fields, validate_arguments
from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.logs import OnProgress
from ...base.results import Columns, Result, record_of, table_of
from ...base.typing import Array
from ..edge_detection import (
    SHORT_SIDE_PX,
    EdgePoints,
    WorkingImage,
    at_working_size,
    edges_of,
    levels_of,
)
from ._candidates import candidate_rings, hough_circles_between, working_rings
from ._classifier import FAINT_RING, UNLISTED, confidence, odds
from ._ellipses import Ellipse, clearness, fit_ellipse, refine_ring
from ._features import Ring, ring_of

# -- Image of the camera ---------------------------------------------------------------------------

MIN_CAMERA_RADIUS, MAX_CAMERA_RADIUS = 0.04, 0.6  # fractions of the rim's radius
MIN_RADIUS_PX = 5.0
RADIUS_STEP = 1.06
OFFSET, VOTED_OFFSET = 0.12, 0.15  # fractions of the rim's radius, for disc and circle
MAX_TRIED_CIRCLES = 20  # circles
SUPPORT, CALM = 0.45, 0.4  # fraction of the circumference with an edge; ratio of texture
SCENE_TEXTURE = 0.08  # texture of a scene
STRETCH_COST = 4.0  # fraction of the circumference that a stretch must gain
REACHES_PX = (2.0, 1.2)


def find_camera_image(working: WorkingImage, edges: EdgePoints, rim: Ellipse) -> Ellipse | None:
    """Return the clearest disc at the centre of a rim, both at working size; None if there is none."""
    distances = np.linalg.norm(edges.points - np.asarray(rim.centre), axis=1) / rim.radius
    inner = edges.subset(distances < MAX_CAMERA_RADIUS + OFFSET)
    if not len(inner.points):
        return None
    radii = max(MIN_CAMERA_RADIUS * rim.radius, MIN_RADIUS_PX), MAX_CAMERA_RADIUS * rim.radius
    voted = hough_circles_between(inner, working.size, radii, RADIUS_STEP)
    best, best_clarity = None, SUPPORT
    for circle in islice(
        (one for one in voted if rim.offset_share(one) < VOTED_OFFSET), MAX_TRIED_CIRCLES
    ):
        disc = fit_ellipse(inner, circle, REACHES_PX)
        if (
            rim.offset_share(disc) < OFFSET
            and (clear := _disc_clarity(working, inner, disc)) > best_clarity
        ):
            best, best_clarity = disc, clear
    return best


def _disc_clarity(working: WorkingImage, edges: EdgePoints, disc: Ellipse) -> float:
    """Return the edge clarity of a round disc with little texture inside and much outside, else 0."""
    ring = ring_of(working, edges, disc)
    if ring is None:
        return 0.0
    inside, outside = ring.band(0.2, 0.9), ring.band(1.06, 1.4)
    if not inside < CALM * outside:
        return 0.0
    edge = (ring.support + ring.close - ring.chance) / 2 - STRETCH_COST * float(
        np.hypot(*disc.stretch)
    )
    return edge * min(1.0, outside / SCENE_TEXTURE)


# -- Mirror outline --------------------------------------------------------------------------------

ImageArray = NDArray[Any]

MIN_CONFIDENCE = 0.6
"""Minimum confidence of an accepted rim."""
OTHER_SIDES_PX = (240, 500)  # short sides of the other working resolutions
SAME_SCALES, SAME_SCALES_PX = (
    0.02,
    2.0,
)  # tolerance between them: fraction of the radius, working px
SAME_CENTRE, RING_RADII = 0.03, (0.55, 0.93)  # fractions of the radius, for a mirror in its housing
MAX_CANDIDATES = 3
SAME_RIM = 0.015  # fraction of the radius; rings within it are the same rim
CLOSE_ODDS = 4.0  # log odds below the best one for alternatives of the same rim
SAME_SENSOR = 0.03  # fraction of the radius; maximum motion of a rim between images
NOT_FOUND = -6.0  # log odds of a ring in an image without it
MIN_SIDE_PX = 48
MAX_NAMED = 5  # images in a message
CANDIDATE_ENTRIES = ("centre_px", "semi_axes_px", "angle_deg", "confidence")


@dataclass(frozen=True)
class CameraImage:
    """Image of the camera itself at the centre, as a disc."""

    centre_px: tuple[float, float]
    radius_px: float


@dataclass(frozen=True)
class MirrorOutline(Result):
    """Ellipse of the mirror's rim in pixels of the image, with integers at pixel centres.

    Examples
    --------
    >>> rim = MirrorOutline((319.5, 239.5), (201.0, 199.0), 30.0, 0.97, (640, 480), CameraImage((320.5, 239.5), 40.0))
    >>> rim.annulus_px, rim.is_accepted
    ((41.0, 199.0), True)
    """

    centre_px: tuple[float, float]
    """Centre (u, v)."""
    semi_axes_px: tuple[float, float]
    """Major and minor semi-axis."""
    angle_deg: float
    """Direction of the major axis, from image right towards image bottom, 0 to 180 deg."""
    confidence: float
    """Confidence from 0 to 1, from the agreement between working resolutions.

    Outlines below :data:`MIN_CONFIDENCE` are not accepted.
    """
    image_size: tuple[int, int]
    """Image size (width, height)."""
    camera_image: CameraImage | None = None
    """Image of the camera itself; None if not detected."""
    images: tuple[MirrorOutline, ...] = ()
    """Rim in each image, for a joint detection in several images."""
    candidates: tuple[Any, ...] = ()
    """Rejected outlines (:class:`MirrorOutline`), best first.

    The first is this one, if it is not accepted.
    """

    def _table(self) -> Columns:
        (u, v), (major, minor) = self.centre_px, self.semi_axes_px
        ellipse = {
            "centre_u_px": u,
            "centre_v_px": v,
            "semi_major_px": major,
            "semi_minor_px": minor,
        }
        return table_of([{**ellipse, **record_of(self), "is_accepted": self.is_accepted}])

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def radius_px(self) -> float:
        """Radius of the circle of equal area, px."""
        return float(np.sqrt(self.semi_axes_px[0] * self.semi_axes_px[1]))

    @property
    def is_accepted(self) -> bool:
        """True if the confidence is sufficient."""
        return self.confidence >= MIN_CONFIDENCE

    @property
    def annulus_px(self) -> tuple[float, float]:
        """Inner and outer radius about the centre of the annulus that shows the scene.

        The inner circle encloses the camera's own image.
        """
        inner = 0.0
        if self.camera_image is not None:
            centre_offset = float(
                np.hypot(*np.subtract(self.camera_image.centre_px, self.centre_px))
            )
            inner = self.camera_image.radius_px + centre_offset
        return inner, self.semi_axes_px[1]

    def points(self, count: int = 360) -> Array:
        """Return points (count, 2) px on the ellipse over one revolution.

        Parameters
        ----------
        count
            Number of points.

        Returns
        -------
        (count, 2) array
            Points in px.
        """
        azimuth, angle = np.arange(count) * (2 * np.pi / count), np.radians(self.angle_deg)
        x, y = self.semi_axes_px[0] * np.cos(azimuth), self.semi_axes_px[1] * np.sin(azimuth)
        u, v = x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle)
        return np.stack([u + self.centre_px[0], v + self.centre_px[1]], axis=1)

    def to_json(self) -> dict[str, Any]:
        """Convert to JSON-serialisable data.

        Returns
        -------
        dict
            Numbers, lists and None.
        """
        inner = self.camera_image
        camera = (
            None
            if inner is None
            else {"centre_px": list(inner.centre_px), "radius_px": inner.radius_px}
        )
        content = {
            "centre_px": list(self.centre_px),
            "semi_axes_px": list(self.semi_axes_px),
            "angle_deg": self.angle_deg,
            "confidence": self.confidence,
            "accepted": self.is_accepted,
            "camera_image": camera,
            "annulus_px": list(self.annulus_px),
            "image_size": list(self.image_size),
        }
        content["candidates"] = [
            {
                name: value
                for name, value in candidate.to_json().items()
                if name in CANDIDATE_ENTRIES
            }
            for candidate in self.candidates
        ]
        return content | ({"images": [rim.to_json() for rim in self.images]} if self.images else {})


@dataclass(frozen=True)
class _AnalysedImage:
    """Rings of one image at one working resolution."""

    image: ImageArray
    working: WorkingImage
    edges: EdgePoints
    rings: list[Ring]
    odds: Array
    """Log odds (members, n)."""
    others: tuple[_AnalysedImage, ...] = ()
    """Results at the other working resolutions."""

    @cached_property
    def mean(self) -> Array:
        """Mean log odds over the ensemble (n,)."""
        return np.asarray(self.odds.mean(axis=0))

    @cached_property
    def places(self) -> Array:
        """Centres and radii (n, 3) of the rings."""
        return np.array(
            [(*ring.ellipse.centre, ring.ellipse.radius) for ring in self.rings]
        ).reshape(-1, 3)

    def near(self, ellipse: Ellipse, tolerance: float) -> NDArray[np.bool_]:
        """Return the mask (n,) of rings equal to an ellipse, except for shape.

        The tolerance is a fraction of its radius.
        """
        differences = np.abs(self.places - (*ellipse.centre, ellipse.radius)) / ellipse.radius
        return np.asarray(
            (np.hypot(differences[:, 0], differences[:, 1]) < tolerance)
            & (differences[:, 2] < tolerance)
        )

    def like(self, ellipse: Ellipse) -> int | None:
        """Return the most probable ring at the position of a ring in another image."""
        near = np.nonzero(self.near(ellipse, SAME_SENSOR))[0]
        return int(near[np.argmax(self.mean[near])]) if len(near) else None

    def ranked(self, ellipse: Ellipse) -> tuple[Array, Array]:
        """Return log odds (resolutions,) of an ellipse and of the best other ring."""
        odds, rivals = [], []
        for analysed in (self, *self.others):
            scaled_ellipse = ellipse.scaled(self.working.scale / analysed.working.scale)
            is_near = analysed.near(
                scaled_ellipse,
                # its own resolution also separates it from rings next to it
                SAME_RIM
                if analysed is self
                else max(SAME_SCALES, SAME_SCALES_PX / scaled_ellipse.radius),
            )
            odds.append(float(analysed.mean[is_near].max(initial=NOT_FOUND)))
            rivals.append(float(analysed.mean[~is_near].max(initial=UNLISTED)))
        return np.array(odds), np.array(rivals)

    def pooled(self, ellipse: Ellipse) -> float:
        """Return the mean log odds of an ellipse over the resolutions."""
        return float(self.ranked(ellipse)[0].mean())

    def chance(self, ellipse: Ellipse) -> float:
        """Return the fraction of the circumference with parallel edges next to an ellipse."""
        near = [
            ring.chance
            for ring, is_near in zip(self.rings, self.near(ellipse, SAME_RIM), strict=True)
            if is_near
        ]
        return float(np.median(near)) if near else 0.0

    def within(self, ellipse: Ellipse) -> float:
        """Return the clarity of the clearest concentric inner ring, over the resolutions.

        It is the fraction of the circumference with close edges.
        """
        clearest = []
        for analysed in (self, *self.others):
            scaled_ellipse = ellipse.scaled(self.working.scale / analysed.working.scale)
            inner = [
                ring.close for ring in analysed.rings if _is_inner(ring.ellipse, scaled_ellipse)
            ]
            clearest.append(max(inner, default=0.0))
        return float(np.mean(clearest))

    def confidence(self, ellipse: Ellipse) -> float:
        """Return the confidence that an ellipse is the rim."""
        return confidence(*self.ranked(ellipse), self.chance(ellipse), self.within(ellipse))

    def distinct(self, ellipse: Ellipse, count: int) -> list[Ellipse]:
        """Return the most probable rings that differ from an ellipse and from each other."""
        selected: list[Ellipse] = []
        for i in np.argsort(-self.mean):
            candidate = self.rings[i].ellipse
            if self.mean[i] > UNLISTED and not any(
                other.is_near(candidate, SAME_SENSOR) for other in (ellipse, *selected)
            ):
                selected.append(candidate)
            if len(selected) == count:
                break
        return selected

    def similar(self, k: int) -> NDArray[np.intp]:
        """Return the rings equal to a given one with similar odds.

        Subpixel refinement selects among them.
        """
        near = self.near(self.rings[k].ellipse, SAME_RIM) & (self.mean > self.mean[k] - CLOSE_ODDS)
        return np.nonzero(near)[0]


@validate_arguments
def detect_mirror_outline(
    images: ImageArray | Sequence[ImageArray],
    *,
    on_progress: OnProgress | None = None,
) -> MirrorOutline:
    """Detect the mirror's rim in one or several images of a sensor, with subpixel accuracy.

    Edges vote for circles, and an ellipse is fitted to the edges of each. A classifier evaluates
    the features of each ellipse (:mod:`omnimirror.calibration.rim._classifier`), and the best one is
    refined in the full-size image. The classifier is trained on simulated photographs. Detection
    runs at three working resolutions with short sides of 240, 360 and 500 px: the confidence is
    high if the same circle is the best at all of them.

    Parameters
    ----------
    images : (rows, columns[, channels]) array, or a sequence of them
        Unmodified images of one camera with equal size and a fixed mirror position.
    on_progress
        Callback ``on_progress(done, total)`` with the number of completed steps, one for each working
        resolution of each image and one for the refinement.

    Returns
    -------
    MirrorOutline
        Most probable rim, whatever its confidence: check ``is_accepted``. Rejected ones are in
        ``candidates``.

    Raises
    ------
    InvalidParameter
        If there is no image, an image is too small, or sizes differ.

    Examples
    --------
    Mirror under a bright sky, on a black background:

    >>> import omnimirror as om
    >>> v, u = np.mgrid[:240, :320]
    >>> inside = np.hypot(u - 170, v - 110) < 90
    >>> scene = 120 + 60 * np.sign(np.sin(9 * np.arctan2(v - 110, u - 170)))
    >>> rim = om.detect_mirror_outline(np.where(inside, scene, 10.0).astype(np.uint8))
    >>> np.round(rim.centre_px), round(rim.radius_px)
    (array([170., 110.]), 90)
    """
    image_list = [images] if isinstance(images, np.ndarray) else list(images)
    _check(image_list)
    steps = (len(OTHER_SIDES_PX) + 1) * len(image_list) + 1  # the last one is the refinement
    completed = 0

    def on_step() -> None:
        nonlocal completed
        completed += 1
        if on_progress is not None:
            on_progress(completed, steps)

    analysed = [_analyse(image, on_step) for image in image_list]
    size = (image_list[0].shape[1], image_list[0].shape[0])
    if not any(item.rings for item in analysed):
        return _no_outline(size)
    ellipse, joint_confidence = _joint_ellipse(analysed)
    outlines = []
    for item in analysed:
        k = item.like(ellipse)
        starts = [ellipse] if k is None else [item.rings[i].ellipse for i in item.similar(k)]
        own_confidence = (
            joint_confidence
            if len(analysed) == 1
            else 0.0
            if k is None
            else item.confidence(item.rings[k].ellipse)
        )
        outlines.append((_refined_outline(item, starts, own_confidence, size), k is not None))
    if len(outlines) == 1:
        rim = outlines[0][0]
        others = [
            _candidate(analysed[0], other, rim.confidence, size)
            for other in analysed[0].distinct(ellipse, MAX_CANDIDATES)
        ]
        return replace(rim, candidates=(*(() if rim.is_accepted else (rim,)), *others))
    pooled = _median_outline(
        [rim for rim, is_visible in outlines if is_visible],
        [rim for rim, _ in outlines],
        joint_confidence,
    )
    return pooled if pooled.is_accepted else replace(pooled, candidates=(pooled,))


def _candidate(
    analysed: _AnalysedImage, ring: Ellipse, best: float, size: tuple[int, int]
) -> MirrorOutline:
    """Return a circle that was not selected, with its confidence limited by that of the best one."""
    ellipse = ring.scaled(analysed.working.scale)
    limited_confidence = min(
        analysed.confidence(ring), 1 - best, float(np.nextafter(MIN_CONFIDENCE, 0))
    )
    return MirrorOutline(
        ellipse.centre, ellipse.semi_axes, ellipse.angle_deg, limited_confidence, size
    )


def _check(images: list[ImageArray]) -> None:
    if not images:
        raise InvalidParameter("images must contain at least one image; got none")
    for image in images:
        if image.ndim not in (2, 3) or min(image.shape[:2]) < MIN_SIDE_PX:
            raise InvalidParameter(
                "images must be arrays (rows, columns) or (rows, columns, channels) with "
                f"at least {MIN_SIDE_PX} px per side; got shape {image.shape}"
            )
    check_image_sizes(images, [f"image {number}" for number in range(len(images))])


def check_image_sizes(images: Sequence[ImageArray], names: Sequence[str]) -> None:
    """Raise an error for images of different sizes, which are not from one sensor.

    The message names the images whose size differs from most.
    """
    sizes = [(image.shape[1], image.shape[0]) for image in images]
    usual = max(sizes, key=sizes.count, default=(0, 0))
    deviating = [
        f"{name} has {width} x {height} px"
        for name, (width, height) in zip(names, sizes, strict=True)
        if (width, height) != usual
    ]
    if deviating:
        listed = ", ".join(deviating[:MAX_NAMED]) + (
            f" and {len(deviating) - MAX_NAMED} more" if len(deviating) > MAX_NAMED else ""
        )
        raise InvalidParameter(
            f"images of one sensor must have one size; {names[sizes.index(usual)]} has "
            f"{usual[0]} x {usual[1]} px, {listed}; process them separately"
        )


def _analyse(image: ImageArray, on_step: Callable[[], None]) -> _AnalysedImage:
    """Detect the rings of an image at the main working resolution and at the others.

    Resolutions above that of the image are omitted. ``on_step`` is called after each one.
    """
    working = at_working_size(image)
    edges = edges_of(working)
    rings = candidate_rings(image, working, edges)
    sides = {min(side, *image.shape[:2]) for side in OTHER_SIDES_PX} - {
        min(working.size),
        SHORT_SIDE_PX,
    }
    main_odds = odds(rings, working)
    on_step()
    others = []
    for side in sorted(sides):
        others.append(_at_resolution(image, side))
        on_step()
    return _AnalysedImage(image, working, edges, rings, main_odds, tuple(others))


def _at_resolution(image: ImageArray, side: int) -> _AnalysedImage:
    """Detect the rings of an image at another working resolution."""
    working = at_working_size(image, side)
    edges = edges_of(working)
    rings = working_rings(working, edges)
    return _AnalysedImage(image, working, edges, rings, odds(rings, working))


def _joint_ellipse(analysed: list[_AnalysedImage]) -> tuple[Ellipse, float]:
    """Return the most probable ring of all images together, and its confidence.

    Images of one sensor share their surroundings: the evidence of n images grows with the square
    root of n.
    """
    if len(analysed) == 1:
        item = analysed[0]
        probable = np.nonzero(item.mean >= min(UNLISTED + 1, item.mean.max()))[0]
        candidates = [item.rings[i].ellipse for i in probable]
        ellipse = max(candidates, key=item.pooled)
        if item.confidence(ellipse) < MIN_CONFIDENCE and item.within(ellipse) > FAINT_RING:
            ellipse = _mirror_in_housing(item, ellipse, candidates)
        return ellipse, item.confidence(ellipse)
    ellipses = [
        ring.ellipse
        for item in analysed
        for i, ring in enumerate(item.rings)
        if item.mean[i] > UNLISTED
    ]
    sums = np.zeros((len(analysed[0].odds), len(ellipses)))
    for item in analysed:
        for i, ellipse in enumerate(ellipses):
            k = item.like(ellipse)
            sums[:, i] += NOT_FOUND if k is None else np.maximum(item.odds[:, k], NOT_FOUND)
    sums /= np.sqrt(len(analysed))
    mean = sums.mean(axis=0)
    best = int(np.argmax(mean))
    pairs = [
        item.ranked(item.rings[k].ellipse)
        for item in analysed
        if (k := item.like(ellipses[best])) is not None
    ]
    odds_of, rivals = (np.mean([pair[i] for pair in pairs], axis=0) for i in (0, 1))
    chance = float(np.median([item.chance(ellipses[best]) for item in analysed]))
    within = float(np.median([item.within(ellipses[best]) for item in analysed]))
    return ellipses[best], confidence(
        odds_of, rivals, chance, within, evidence=float(np.sqrt(len(pairs)))
    )


def _mirror_in_housing(
    item: _AnalysedImage, outline: Ellipse, candidates: list[Ellipse]
) -> Ellipse:
    """Return the best concentric ring inside an uncertain outline if it is probably a mirror.

    Otherwise the outline itself: its inner rings are then edges of the reflected scene.
    """
    inner = [ring for ring in candidates if _is_inner(ring, outline) and item.pooled(ring) > 0]
    return max(inner, key=item.pooled, default=outline)


def _is_inner(ring: Ellipse, outline: Ellipse) -> bool:
    """Return True for a concentric ring within an outline, as a mirror in its housing."""
    is_smaller = RING_RADII[0] < ring.radius / outline.radius < RING_RADII[1]
    return is_smaller and outline.offset_share(ring) < SAME_CENTRE


def _refined_outline(
    analysed: _AnalysedImage, starts: list[Ellipse], confidence: float, size: tuple[int, int]
) -> MirrorOutline:
    """Return the clearest of several rings after refinement in the full-size image."""
    levels = levels_of(analysed.image)
    levels = levels.reshape(*levels.shape[:2], -1)
    scale = analysed.working.scale
    refined = [refine_ring(levels, start.scaled(scale), scale) for start in starts]
    ellipse = max(refined, key=lambda analysed: clearness(*analysed))[0]
    disc = find_camera_image(analysed.working, analysed.edges, ellipse.scaled(1 / scale))
    inner = None
    if disc is not None:
        large = disc.scaled(scale)
        inner = CameraImage(large.centre, large.radius)
    return MirrorOutline(
        ellipse.centre, ellipse.semi_axes, ellipse.angle_deg, confidence, size, inner
    )


def _median_outline(
    detected: list[MirrorOutline], outlines: list[MirrorOutline], confidence: float
) -> MirrorOutline:
    """Return the median of the rims of several images."""
    u, v = np.median([rim.centre_px for rim in detected], axis=0)
    stretches = [np.log(rim.semi_axes_px[0] / rim.semi_axes_px[1]) / 2 for rim in detected]
    angles = 2 * np.radians([rim.angle_deg for rim in detected])
    stretch = (
        float(np.median(stretches * np.cos(angles))),
        float(np.median(stretches * np.sin(angles))),
    )
    middle = Ellipse(
        (float(u), float(v)), float(np.median([rim.radius_px for rim in detected])), stretch
    )
    discs = [rim.camera_image for rim in detected if rim.camera_image is not None]
    inner = None
    if len(discs) > len(detected) / 2:
        x, y, radius = np.median([(*disc.centre_px, disc.radius_px) for disc in discs], axis=0)
        inner = CameraImage((float(x), float(y)), float(radius))
    return MirrorOutline(
        middle.centre,
        middle.semi_axes,
        middle.angle_deg,
        confidence,
        outlines[0].image_size,
        inner,
        tuple(outlines),
    )


def _no_outline(size: tuple[int, int]) -> MirrorOutline:
    """Return the result for an image without rings: the largest circle in it, with confidence 0."""
    width, height = size
    radius = min(size) / 2
    return MirrorOutline(((width - 1) / 2, (height - 1) / 2), (radius, radius), 0.0, 0.0, size)
