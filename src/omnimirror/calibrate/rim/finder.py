"""The rim of the mirror in one picture, or in several pictures of one sensor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import check_fields, checked
from ...errors import InvalidParameter
from ...numerics.lazy import cached_property
from .candidates import rings_of
from .choice import UNLISTED, confidence, odds
from .cues import Ring
from .edges import EdgePoints, Working, at_working_size, edges_of, levels_of
from .ellipses import Ellipse
from .middle import camera_image
from .placing import clearness, placed

Array = NDArray[np.float64]
Picture = NDArray[Any]

SURE = 0.6
"""Confidence from which a rim is taken for found."""
SAME_RIM = 0.015  # of the radius, by which rings differ that are one rim
CLOSE_ODDS = 2.0  # of the most probable one, from which on others of that rim are tried as well
SAME_SENSOR = 0.03  # of the radius, by which a rim may move from picture to picture
NOT_FOUND = -6.0  # log odds of a ring in a picture that does not show it
LEAST_SIDE_PX = 48
MOST_NAMED = 5  # pictures in a message


@dataclass(frozen=True)
class CameraImage:
    """The camera's own image in the middle, as a disc."""

    centre_px: tuple[float, float]
    radius_px: float


@dataclass(frozen=True)
class FoundRim:
    """The ellipse in which a mirror ends, in pixels of the picture; integers are pixel centres.

    Examples
    --------
    >>> rim = FoundRim((319.5, 239.5), (201.0, 199.0), 30.0, 0.97, (640, 480), CameraImage((320.5, 239.5), 40.0))
    >>> rim.annulus_px, rim.is_sure
    ((41.0, 199.0), True)
    """

    centre_px: tuple[float, float]
    """(u, v)."""
    semi_axes_px: tuple[float, float]
    """The longer and the shorter one."""
    angle_deg: float
    """Direction of the longer one, from image right towards image bottom, 0 to 180."""
    confidence: float
    """0 to 1: by how much it is more probable that this is the rim than another ring, or none; below :data:`SURE` it is
    not taken for found."""
    image_size: tuple[int, int]
    """(width, height) of the picture."""
    inner: CameraImage | None = None
    """The camera's own image; None where none is seen."""
    pictures: tuple[FoundRim, ...] = ()
    """The rim in every single picture, of several that were looked at together."""

    def __post_init__(self) -> None:
        check_fields(self)

    @property
    def radius_px(self) -> float:
        """Radius of the circle of the same area, px."""
        return float(np.sqrt(self.semi_axes_px[0] * self.semi_axes_px[1]))

    @property
    def is_sure(self) -> bool:
        """Whether the confidence is enough."""
        return self.confidence >= SURE

    @property
    def annulus_px(self) -> tuple[float, float]:
        """Radii about the centre between which the picture shows the world: of the camera's own image, and the rim."""
        inner = 0.0
        if self.inner is not None:
            away = float(np.hypot(*np.subtract(self.inner.centre_px, self.centre_px)))
            inner = self.inner.radius_px + away
        return inner, self.semi_axes_px[1]

    def points(self, count: int = 360) -> Array:
        """Points (count, 2) px on the ellipse, once round.

        Parameters
        ----------
        count
            How many.

        Returns
        -------
        (count, 2) array
            px
        """
        turn, lean = np.arange(count) * (2 * np.pi / count), np.radians(self.angle_deg)
        x, y = self.semi_axes_px[0] * np.cos(turn), self.semi_axes_px[1] * np.sin(turn)
        u, v = x * np.cos(lean) - y * np.sin(lean), x * np.sin(lean) + y * np.cos(lean)
        return np.stack([u + self.centre_px[0], v + self.centre_px[1]], axis=1)

    def to_json(self) -> dict[str, Any]:
        """As a file holds it.

        Returns
        -------
        dict
            Of numbers, lists and None.
        """
        inner = self.inner
        camera = None if inner is None else {"centre_px": list(inner.centre_px), "radius_px": inner.radius_px}
        found = {
            "centre_px": list(self.centre_px), "semi_axes_px": list(self.semi_axes_px), "angle_deg": self.angle_deg,
            "confidence": self.confidence, "camera_image": camera, "annulus_px": list(self.annulus_px),
            "image_size": list(self.image_size),
        }  # fmt: skip
        return found | ({"pictures": [rim.to_json() for rim in self.pictures]} if self.pictures else {})


@dataclass(frozen=True)
class _Seen:
    """What is seen in one picture."""

    picture: Picture
    working: Working
    edges: EdgePoints
    rings: list[Ring]
    odds: Array
    """(members, n)"""

    @cached_property
    def mean(self) -> Array:
        """Of the committee (n,)."""
        return np.asarray(self.odds.mean(axis=0))

    @cached_property
    def places(self) -> Array:
        """Centres and radii (n, 3) of its rings."""
        return np.array([(*ring.ellipse.centre, ring.ellipse.radius) for ring in self.rings]).reshape(-1, 3)

    def near(self, ellipse: Ellipse, share: float) -> NDArray[np.bool_]:
        """Which of its rings (n,) are an ellipse but for a share of its radius, shape aside."""
        away = np.abs(self.places - (*ellipse.centre, ellipse.radius)) / ellipse.radius
        return np.asarray((np.hypot(away[:, 0], away[:, 1]) < share) & (away[:, 2] < share))

    def like(self, ellipse: Ellipse) -> int | None:
        """The most probable of its rings at the place of one in another picture."""
        near = np.nonzero(self.near(ellipse, SAME_SENSOR))[0]
        return int(near[np.argmax(self.mean[near])]) if len(near) else None

    def alike(self, k: int) -> NDArray[np.intp]:
        """The rings that are the same as one, and about as probable: which of them is the rim, placing tells."""
        near = self.near(self.rings[k].ellipse, SAME_RIM) & (self.mean > self.mean[k] - CLOSE_ODDS)
        return np.nonzero(near)[0]


@checked
def find_rim(pictures: Picture | Sequence[Picture]) -> FoundRim:
    """The rim of the mirror in a picture, or in several pictures of one sensor, to a part of a pixel.

    Edges vote for circles; an ellipse is laid through the edges of each; what speaks for each being the rim is
    weighed (:mod:`omnimirror.calibrate.rim.choice`), and the best is placed in the full picture. The weights were
    learned from simulated photographs; the confidence is by how much the best answer is more probable than the next,
    as every member of the committee says at least.

    Parameters
    ----------
    pictures : (rows, columns[, channels]) array, or a sequence of them
        Pictures as they came from one camera, all of one size, in which the mirror stays at its place.

    Returns
    -------
    FoundRim
        The most probable one, however little probable: look at its ``confidence``.

    Raises
    ------
    InvalidParameter
        No picture, one that is too small, or several of different sizes.

    Examples
    --------
    A mirror under a bright sky, on black:

    >>> import omnimirror as om
    >>> v, u = np.mgrid[:240, :320]
    >>> inside = np.hypot(u - 170, v - 110) < 90
    >>> scene = 120 + 60 * np.sign(np.sin(9 * np.arctan2(v - 110, u - 170)))
    >>> rim = om.find_rim(np.where(inside, scene, 10.0).astype(np.uint8))
    >>> np.round(rim.centre_px), round(rim.radius_px)
    (array([170., 110.]), 90)
    """
    many = [pictures] if isinstance(pictures, np.ndarray) else list(pictures)
    _check(many)
    seen = [_seen(picture) for picture in many]
    size = (many[0].shape[1], many[0].shape[0])
    if not any(one.rings for one in seen):
        return _nothing(size)
    ellipse, together = _agreed(seen)
    singles = []
    for one in seen:
        k = one.like(ellipse)
        starts = [ellipse] if k is None else [one.rings[i].ellipse for i in one.alike(k)]
        alone = 0.0 if k is None else confidence(one.odds, one.near(one.rings[k].ellipse, SAME_RIM))
        singles.append((_rim(one, starts, alone if len(seen) > 1 else together, size), k is not None))
    if len(singles) == 1:
        return singles[0][0]
    return _pooled([rim for rim, is_there in singles if is_there], [rim for rim, _ in singles], together)


def _check(pictures: list[Picture]) -> None:
    if not pictures:
        raise InvalidParameter("there is no picture to look for a rim in; give at least one")
    for picture in pictures:
        if picture.ndim not in (2, 3) or min(picture.shape[:2]) < LEAST_SIDE_PX:
            raise InvalidParameter(
                f"a picture of the shape {picture.shape} holds no rim; valid are (rows, columns) or (rows, columns, "
                f"channels) of at least {LEAST_SIDE_PX} px each side"
            )
    check_alike(pictures, [f"picture {number}" for number in range(len(pictures))])


def check_alike(pictures: Sequence[Picture], names: Sequence[str]) -> None:
    """Refuse pictures of several sizes, which are not of one sensor, and name those of another size than most."""
    sizes = [(picture.shape[1], picture.shape[0]) for picture in pictures]
    usual = max(sizes, key=sizes.count, default=(0, 0))
    odd = [f"{name} is {width} x {height}" for name, (width, height) in zip(names, sizes, strict=True)
           if (width, height) != usual]  # fmt: skip
    if odd:
        told = ", ".join(odd[:MOST_NAMED]) + (f" and {len(odd) - MOST_NAMED} more" if len(odd) > MOST_NAMED else "")
        raise InvalidParameter(
            f"pictures of one sensor have one size: {names[sizes.index(usual)]} is {usual[0]} x {usual[1]} px, and "
            f"{told} px; look at those apart"
        )


def _seen(picture: Picture) -> _Seen:
    working = at_working_size(picture)
    edges = edges_of(working)
    found = rings_of(picture, working, edges)
    return _Seen(picture, working, edges, found, odds(found, working))


def _agreed(seen: list[_Seen]) -> tuple[Ellipse, float]:
    """The ring that all pictures together make the most probable, and how probable that is.

    Pictures of one sensor share their surroundings, so that n of them are worth the square root of n.
    """
    if len(seen) == 1:
        one = seen[0]
        ellipse = one.rings[int(np.argmax(one.mean))].ellipse
        return ellipse, confidence(one.odds, one.near(ellipse, SAME_RIM))
    every = [ring.ellipse for one in seen for i, ring in enumerate(one.rings) if one.mean[i] > UNLISTED]
    sums = np.zeros((len(seen[0].odds), len(every)))
    for one in seen:
        for i, ellipse in enumerate(every):
            k = one.like(ellipse)
            sums[:, i] += NOT_FOUND if k is None else np.maximum(one.odds[:, k], NOT_FOUND)
    sums /= np.sqrt(len(seen))
    mean = sums.mean(axis=0)
    best = int(np.argmax(mean))
    taken = [one.like(every[best]) for one in seen]
    distinct = [best]
    for i in np.argsort(-mean):
        is_best = any(k is not None and one.like(every[i]) == k for one, k in zip(seen, taken, strict=True))
        if not is_best and not any(every[j].is_near(every[i], SAME_SENSOR) for j in distinct):
            distinct.append(int(i))
    return every[best], confidence(sums[:, distinct], np.arange(len(distinct)) == 0)


def _rim(one: _Seen, starts: list[Ellipse], confidence: float, size: tuple[int, int]) -> FoundRim:
    """The clearest of rings placed in the full picture."""
    levels = levels_of(one.picture)
    levels = levels.reshape(*levels.shape[:2], -1)
    scale = one.working.scale
    tried = [placed(levels, start.scaled(scale), scale) for start in starts]
    ellipse = max(tried, key=lambda one: clearness(*one))[0]
    disc = camera_image(one.working, one.edges, ellipse.scaled(1 / scale))
    inner = None
    if disc is not None:
        large = disc.scaled(scale)
        inner = CameraImage(large.centre, large.radius)
    return FoundRim(ellipse.centre, ellipse.semi_axes, ellipse.angle_deg, confidence, size, inner)


def _pooled(good: list[FoundRim], every: list[FoundRim], confidence: float) -> FoundRim:
    """The middle of the rims of several pictures."""
    u, v = np.median([rim.centre_px for rim in good], axis=0)
    stretches = [np.log(rim.semi_axes_px[0] / rim.semi_axes_px[1]) / 2 for rim in good]
    angles = 2 * np.radians([rim.angle_deg for rim in good])
    stretch = float(np.median(stretches * np.cos(angles))), float(np.median(stretches * np.sin(angles)))
    middle = Ellipse((float(u), float(v)), float(np.median([rim.radius_px for rim in good])), stretch)
    discs = [rim.inner for rim in good if rim.inner is not None]
    inner = None
    if len(discs) > len(good) / 2:
        x, y, radius = np.median([(*disc.centre_px, disc.radius_px) for disc in discs], axis=0)
        inner = CameraImage((float(x), float(y)), float(radius))
    return FoundRim(
        middle.centre, middle.semi_axes, middle.angle_deg, confidence, every[0].image_size, inner, tuple(every)
    )  # fmt: skip


def _nothing(size: tuple[int, int]) -> FoundRim:
    """What is said of a picture without any ring: the largest circle in it, with no confidence."""
    width, height = size
    radius = min(size) / 2
    return FoundRim(((width - 1) / 2, (height - 1) / 2), (radius, radius), 0.0, 0.0, size)
