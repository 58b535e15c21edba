"""Chief rays over a second mirror, and obscuration by that mirror and the camera.

The secondary has chief rays of its own; the point of the primary on which a ray ends is an object
at a finite distance for it. All lengths are in mm, angles in radians. The secondary's frame has its
vertex as origin and its z axis away from the lens, downwards from the primary.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from ...base.errors import NotOneToOne, SelfObstruction
from ...base.numerics.lazy import cached_property
from ...base.numerics.roots import increasing_root, sign_change
from ...base.typing import Array
from ..mirrors import Mirror, Secondary
from .edges import past_circle
from .meridian import NODES, ChiefRays, Meridian, checked
from .reflection.limits import RIM_SLACK

PROFILE = 129  # points of the secondary's profile tested for clearance
CHUNK = 1 << 12
NEAR_EDGE = 0.5  # of the secondary's radius: rays farther away are not compared with its profile


def clearances(
    mirror: Mirror,
    secondary: Secondary,
    mirror_distance_mm: float,
    from_lens: Array,
    second: Array,
    first: Array,
    outgoing: Array,
    slack: float = RIM_SLACK,
) -> dict[str, Array]:
    """Return the clearance (n,), mm, of rays at both mirrors, bore and camera, and past the
    secondary.

    Parameters
    ----------
    mirror, secondary
        The primary, and the mirror in which the lens sees it.
    mirror_distance_mm
        Path from the lens to the primary over the secondary.
    from_lens, second, first, outgoing : (n, 3) arrays
        Directions from the lens, points of the secondary and of the primary, mm, and directions
        into the world, all in the frame of the primary.
    slack
        Relative tolerance of every edge, for grazing rays.
    """
    bore, lens = secondary.bore_radius_mm, secondary.lens_height(mirror_distance_mm)
    share = (np.minimum(first[:, 2], lens) - second[:, 2]) / (first[:, 2] - second[:, 2])
    at_camera = (second + share[:, None] * (first - second))[:, :2]
    found = {
        "mirror": -past_circle(first[:, :2], mirror.rim_radius_mm * (1 + slack)),
        "secondary mirror": -past_circle(second[:, :2], secondary.mirror.rim_radius_mm * (1 + slack)),
        "bore or camera": past_circle(at_camera, bore * (1 - slack)),
        "secondary": _past_secondary(secondary, first, outgoing, slack),
    }
    edge = float(mirror.sag(min(bore, mirror.rim_radius_mm)))
    if lens > edge:
        at_bore = (second + ((edge - second[:, 2]) / from_lens[:, 2])[:, None] * from_lens)[:, :2]
        found["bore"] = -past_circle(at_bore, bore * (1 + slack)) if bore else -np.hypot(*at_bore.T)
    return found


def _past_secondary(secondary: Secondary, points: Array, outgoing: Array, slack: float) -> Array:
    """Return the clearance (n,), mm, of rays from the primary into the world at the secondary.

    Far from the secondary, the distance from its cylinder is returned; near it, the minimum over
    its profile.
    """
    x = np.linspace(0.0, secondary.mirror.rim_radius_mm, PROFILE)
    heights = secondary.height(x)
    p, d = points[:, :2], outgoing[:, :2]
    low, high = ((h - points[:, 2]) / outgoing[:, 2] for h in (heights.min(), heights.max()))
    nearest = np.clip(-(p * d).sum(axis=1) / (d * d).sum(axis=1), np.minimum(low, high), np.maximum(low, high))
    clearance: Array = np.hypot(*(p + nearest[:, None] * d).T) - x[-1]
    clearance[(low <= 0) & (high <= 0)] = np.inf
    close = np.flatnonzero(~(clearance > NEAR_EDGE * x[-1]))
    for begin in range(0, len(close), CHUNK):
        part = close[begin : begin + CHUNK]
        along = (heights - points[part, 2:]) / outgoing[part, 2:]
        radius = np.hypot(*(p[part, :, None] + along[:, None] * d[part, :, None]).transpose(1, 0, 2))
        clearance[part] = np.where(along <= 0, np.inf, radius - x * (1 - slack)).min(axis=1)
    return clearance


@dataclass(frozen=True)
class TwoMirrorMeridian(Meridian):
    """Mirror seen by the lens in a second mirror; ``m`` is the path from lens to vertex over both.

    A ray of viewing angle theta leaves the secondary at ``theta' = theta + 2 beta_2`` from the axis
    (beta_2: its slope angle on the lens side) and meets the primary; ``Omega = 2 beta_1 + theta'``.

    >>> from omnimirror.optics.mirrors import Flat, Sphere
    >>> sphere = Sphere(50.0, 44.0)
    >>> folded = TwoMirrorMeridian(sphere, 180.0, secondary=Secondary(Flat(25.0), 90.0, 5.0))
    >>> bool(np.isclose(folded.omega_max, Meridian(sphere, 180.0).omega_max, rtol=1e-14))
    True
    """

    secondary: Secondary = field(kw_only=True)

    @cached_property
    def seen(self) -> Meridian:
        """Meridian of the secondary as seen by the lens."""
        return Meridian(self.secondary.mirror, self.m - self.secondary.distance_mm, self.pupil)

    def _check_between_nodes(self) -> None:
        self._check_finer_table()

    def _rays(self, x: Array) -> ChiefRays:
        z, slope, curvature = self.mirror.profile(x)
        below = -self.secondary.distance_mm - z  # the mirror point in the secondary's frame
        second = self.seen._rays(self.seen.x_from_point(x, below))
        beta, theta = np.arctan(slope), second.omega
        gamma = beta + theta
        path = np.hypot(x - second.x, below - second.z)
        rays = ChiefRays(
            x, z, slope, curvature, self.m, self.m + z, beta, theta, gamma, beta + gamma, path, seen_in=second
        )
        return self._through_cover(rays)

    def x_from_first(self, x_mm: ArrayLike) -> Array:
        second = self.seen.trace(x_mm)
        sin, cos = np.sin(second.omega), np.cos(second.omega)
        height = -self.secondary.distance_mm - second.z

        def difference(x: Array) -> tuple[Array, Array]:
            z, slope, _ = self.mirror.profile(x)
            return (x - second.x) * cos - (z - height) * sin, cos - slope * sin

        rim = self.mirror.rim_radius_mm
        zero = np.zeros_like(second.x)
        guess = second.x - height * np.tan(second.omega)  # for a flat mirror
        return increasing_root(difference, zero, zero + rim, guess, rim)

    def x_from_tan_theta(self, tan_theta: ArrayLike) -> Array:
        return self.x_from_first(self.seen.x_from_tan_theta(tan_theta))

    # -- obscuration -----------------------------------------------------------------------------

    @cached_property
    def x_min(self) -> float:
        """First mirror point whose rays pass bore, camera and secondary."""
        self._check_secondary()
        rim = self.mirror.rim_radius_mm
        x = np.linspace(float(self.x_from_first([0.0])[0]), rim, NODES)
        rays = self._rays(x)
        self._check_shows_all(rays)
        checked(rays)
        self._check_bore(rays)
        start = self._first_past_mirrors(x)
        if start >= rim:
            raise SelfObstruction(
                f"secondary and camera hide the whole mirror, whose rim_radius_mm is {rim:g}; the secondary's rim and "
                "bore_radius_mm must be smaller, or distance_mm larger"
            )
        return self._first_outside(start)

    def _first_past_mirrors(self, x: Array) -> float:
        """Return the first mirror point (n,), mm, whose rays pass bore, camera and secondary."""
        return max(self._first_clear(x, part) for part in ("bore or camera", "secondary"))

    @property
    def middle_hidden_by(self) -> str:
        x = np.linspace(float(self.x_from_first([0.0])[0]), self.mirror.rim_radius_mm, NODES)
        mirrors_alone = self.cover is None or self.x_min <= self._first_past_mirrors(x)
        return "secondary, bore" if mirrors_alone else super().middle_hidden_by

    def _first_clear(self, x: Array, part: str) -> float:
        """Return the smallest mirror point with all rays beyond it past a part."""

        def clearance(x: Array) -> Array:
            return np.clip(self._clearances(self._rays(x))[part], -1e9, 1e9)

        blocked = np.flatnonzero(clearance(x) < 0)
        if not blocked.size:
            return float(x[0])
        last = int(blocked[-1])
        if last == len(x) - 1:
            return float(x[-1])
        return sign_change(lambda x: float(clearance(np.array([x]))[0]), float(x[last]), float(x[last + 1]), 1e-12)

    def _clearances(self, rays: ChiefRays) -> dict[str, Array]:
        """Return the clearance (n,), mm, of chief rays; see :func:`clearances`."""
        second = rays.first

        def flat(across: Array, along: Array) -> Array:
            return np.stack([across, np.zeros_like(across), along], axis=-1)

        points, seen_at = flat(rays.x, rays.z), flat(second.x, -self.secondary.distance_mm - second.z)
        from_lens = flat(np.sin(second.theta), -np.cos(second.theta))
        outwards = flat(np.sin(rays.reflected), -np.cos(rays.reflected))
        with np.errstate(all="ignore"):
            return clearances(self.mirror, self.secondary, self.m, from_lens, seen_at, points, outwards, 0.0)

    # -- validity checks -------------------------------------------------------------------------

    def _check_secondary(self) -> None:
        self.secondary.check_before(self.mirror, self.m)
        try:
            self.seen.omega_max  # noqa: B018 - proves that it can be used
        except SelfObstruction as e:
            raise SelfObstruction(f"as the secondary, {e}") from None
        except NotOneToOne:
            if np.isinf(self.m):
                raise NotOneToOne(
                    "a telecentric lens needs a convex secondary: another one sends back a beam no wider than it gets"
                ) from None
            raise NotOneToOne(
                f"the secondary bends the lens's rays back across the axis: the lens stands {self.seen.m:g} mm from "
                "it, beyond its focus; a secondary must be convex, flat, or concave with its focus behind the lens"
            ) from None

    def _check_shows_all(self, rays: ChiefRays) -> None:
        missing = ~np.isfinite(rays.omega)
        if missing.any():
            shown = float(rays.x[np.argmax(missing) - 1])
            raise SelfObstruction(
                f"the secondary shows the mirror only to x = {shown:.4g} mm, and its rim stands at {rays.x[-1]:g} mm; "
                "make the secondary's rim_radius_mm larger or the mirror's smaller"
            )

    def _check_bore(self, rays: ChiefRays) -> None:
        """Check that the bore is large enough for the camera's chief rays."""
        second, bore = rays.first, self.secondary.bore_radius_mm
        lens = self.secondary.lens_height(self.m)
        widest = float(second.x[-1])
        if np.isinf(lens):
            needed = widest
        elif lens <= 0:
            return
        else:
            tangent = widest / float(second.w[-1])

            def room(radius: float) -> float:
                return radius - max(lens - float(self.mirror.sag(radius)), 0.0) * tangent

            rim = self.mirror.rim_radius_mm
            if room(rim) < 0:
                raise SelfObstruction(
                    f"the view of the camera behind the mirror is wider than the mirror, rim_radius_mm = {rim:g}; "
                    "reduce the secondary's rim_radius_mm or move the lens"
                )
            needed = sign_change(room, 0.0, rim, 1e-12)
        if bore < needed:
            raise SelfObstruction(
                f"bore_radius_mm = {bore:g} cuts off the view of the camera behind the mirror; it is valid above "
                f"{needed:.4g}"
            )
