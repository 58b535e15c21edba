"""Obscurations of the field, shared by drawings, simulated images, evaluation and requirements.

Obscuration is defined by the chief ray: near its edge the image fades over the width of the lens
aperture. Parts about the axis of an aligned sensor obscure rings of field angle at every azimuth
(:func:`mirror_obscurations`); for any sensor they block rays in space (:meth:`Obstructions.blocks`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...base.numerics import sign_change
from ...base.typing import Array, Mask
from ..housing import TELECENTRIC_LENS_DISTANCE_RIMS, CameraBody, Envelope, FlatWindow, Housing, Rim
from ..mirrors import Mirror, Secondary
from ..mirrors.mirror import MirrorPose
from .meridian import ChiefRays, Cover, Meridian
from .reflection import circle_clearance

PLACES = 2049  # mirror points sampled to locate the edges of rings
TOUCHES_DEG = 1e-6  # distance at which a ring is merged with an end of the field
CLEARANCE_DEG = 1e-9  # distance from a ring to the ends of the clear field, above rounding errors


def disc_clearance(distance: Any, cosine: Any, radius: Any) -> Any:
    """Return the clearance (n,), mm, of rays at a disc perpendicular to the axis.

    A disc of radius a seen at an angle Omega has the half-width a cos(Omega) in the meridian.
    Accepts complex arrays, whose imaginary parts carry derivatives.

    Parameters
    ----------
    distance : (n,) mm
        Distance of the ray from the centre of the disc, in the meridian.
    cosine : (n,)
        Cosine of the angle between ray and axis.
    radius : mm

    Examples
    --------
    >>> disc_clearance(np.array([10.0, 30.0]), np.cos(np.radians([0.0, 60.0])), 20.0)
    array([-10.,  20.])
    """
    return distance - radius * cosine


class Disc(NamedTuple):
    """Opaque disc perpendicular to the axis, for descending or for rising rays."""

    part: str
    height_mm: float
    radius_mm: float
    stops_rising: bool = False

    def crossing(self, points: Array, directions: Array) -> tuple[Array, Mask]:
        """Return the crossings (n, 2), mm, of rays with its plane, and their validity."""
        along = directions[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            steps = (self.height_mm - points[:, 2]) / along
            across: Array = points[:, :2] + steps[:, None] * directions[:, :2]
            towards = along > 0 if self.stops_rising else along < 0
            meets: Mask = towards & (steps > 0)
        return across, meets

    def clearance(self, points: Array, directions: Array) -> Array:
        """Return the clearance (n,), mm, of rays; infinite for those that do not cross its
        plane."""
        across, meets = self.crossing(points, directions)
        with np.errstate(invalid="ignore"):
            return np.where(meets, circle_clearance(across, self.radius_mm), np.inf)

    def blocks(self, points: Array, directions: Array) -> tuple[Mask, Array]:
        """Return which rays it blocks, and their crossings (n, 2), mm, of its plane."""
        return self.clearance(points, directions) < 0, self.crossing(points, directions)[0]


class WindowFrame(NamedTuple):
    """Opaque surround of a window: it blocks rays that descend outside the clear opening."""

    part: str
    height_mm: float
    radius_mm: float

    def clearance(self, points: Array, directions: Array) -> Array:
        """Return the clearance (n,), mm, of rays; infinite for those that do not cross its
        plane."""
        across, meets = Disc(self.part, self.height_mm, self.radius_mm).crossing(points, directions)
        with np.errstate(invalid="ignore"):
            return np.where(meets, -circle_clearance(across, self.radius_mm), np.inf)


class TaperedRod(NamedTuple):
    """Cylindrical or tapered rod: a frustum about the axis."""

    foot_mm: float
    top_mm: float
    foot_radius_mm: float
    top_radius_mm: float

    @property
    def ends(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Height and radius of both ends."""
        return (self.foot_mm, self.foot_radius_mm), (self.top_mm, self.top_radius_mm)

    @property
    def taper(self) -> float:
        """Change of the radius with height, mm/mm."""
        return (self.top_radius_mm - self.foot_radius_mm) / (self.top_mm - self.foot_mm)

    def clearance(self, points: Array, directions: Array) -> Array:
        """Return the clearance (n,), mm, of rays; infinite for those above or below the rod.

        Between foot and top, the difference of squares ``r^2 - radius^2`` is a quadratic in the
        distance t along the ray: its minimum is at its vertex, or at the entry into or exit from
        the rod's heights.
        """
        (x, y, z), (dx, dy, dz) = points.T, directions.T
        with np.errstate(divide="ignore", invalid="ignore"):
            ends = np.sort([(h - z) / dz for h in (self.foot_mm, self.top_mm)], axis=0)
            level = dz == 0
            between = (z >= self.foot_mm) & (z <= self.top_mm)
            first = np.where(level, np.where(between, 0.0, np.inf), np.maximum(ends[0], 0.0))
            last = np.where(level, np.where(between, np.inf, -np.inf), ends[1])
            radius, widening = (
                self.foot_radius_mm + self.taper * (z - self.foot_mm),
                self.taper * dz,
            )
            a = dx**2 + dy**2 - widening**2
            b = x * dx + y * dy - radius * widening
            closest = np.where(a > 0, np.clip(-b / a, first, last), first)
            squares = [
                (x + t * dx) ** 2 + (y + t * dy) ** 2 - (radius + t * widening) ** 2
                for t in (first, closest, last)
            ]
            min_square = np.fmin.reduce(squares)
            clearance = min_square / (2 * max(self.foot_radius_mm, self.top_radius_mm))
            return np.where(first <= last, clearance, np.inf)

    def blocks(self, points: Array, directions: Array) -> Mask:
        """Return which rays (n, 3), (n, 3) it blocks, including those that start inside."""
        mask: Mask = self.clearance(points, directions) < 0
        return mask


@dataclass(frozen=True)
class Obstructions:
    """Opaque parts of a housing fitted to its sensor; heights in mm above the nominal vertex.

    The wall of a tube or dome is clear; ``discs`` close it. The flange of the mirror's body,
    ``rim``, is in the frame of the mirror and moves with it.
    """

    housing: Housing
    envelope: Envelope
    discs: tuple[Disc | WindowFrame, ...]
    rod: TaperedRod | None
    rim: Disc | None

    @classmethod
    def of(
        cls,
        housing: Housing,
        mirror: Mirror,
        secondary: Secondary | None,
        mirror_distance_mm: float,
    ) -> Obstructions:
        """Create the obstructions of a housing around a mirror, or two mirrors, at a lens distance.

        Raises
        ------
        InvalidParameter
            As :meth:`omnimirror.optics.housing.Housing.fitted`.
        """
        envelope = envelope_of(housing, mirror, secondary, mirror_distance_mm)
        fitted = housing.fitted(envelope)
        rod, edge = fitted.rod, housing.rim or Rim()
        cone = None
        if rod is not None:
            assert rod.gap_mm is not None
            assert rod.end_diameter_mm is not None
            cone = TaperedRod(
                envelope.lens_mm + rod.gap_mm, 0.0, rod.diameter_mm / 2, rod.end_diameter_mm / 2
            )
        front = float(mirror.sag(np.array(mirror.rim_radius_mm))) + edge.setback_mm
        rim = Disc("rim", front, envelope.outer_mm, stops_rising=True) if edge.width_mm else None
        discs = (*_lids(fitted, envelope), *_before_mirror(fitted, envelope, secondary))
        return cls(fitted, envelope, discs, cone, rim)

    @property
    def lids(self) -> tuple[Disc, ...]:
        """Discs that close a tube or dome."""
        shell = self.housing.shell
        if shell is None:
            return ()
        return tuple(
            disc
            for disc in self.discs
            if isinstance(disc, Disc) and disc.part.startswith(shell.KIND)
        )

    @property
    def camera(self) -> Disc | None:
        """Disc that blocks rays to the camera: its front, or its base if wider."""
        lens = self.envelope.lens_mm
        fronts = [disc for disc in self.discs if isinstance(disc, Disc) and disc.part == "camera"]
        level = fronts[0].height_mm if fronts else lens
        fronts += [disc for disc in self.lids if disc.height_mm == level == lens]
        return max(fronts, key=lambda disc: disc.radius_mm, default=None)

    @property
    def front_ring_mm(self) -> float:
        """Diameter of the ring about the lens on the camera's front."""
        return (self.housing.camera or CameraBody(1.0)).lens_diameter_mm

    def clearances(
        self, points: Array, directions: Array, towards_lens: Array, pose: MirrorPose
    ) -> dict[str, Array]:
        """Return the clearance (n,), mm, of reflected rays at each part.

        Parameters
        ----------
        points, directions : (n, 3) arrays
            Points on the mirror, mm, and directions of the rays into the world, in the camera frame.
        towards_lens : (n, 3) array
            Directions from these points to the lens, or to the second mirror that images them.
        pose
            Pose of the mirror.
        """
        clearances_by_part = {}
        if self.rod is not None:
            rod_clearances = (
                self.rod.clearance(points, direction) for direction in (directions, towards_lens)
            )
            clearances_by_part["rod"] = np.fmin.reduce([*rod_clearances])
        clearances_by_part |= {disc.part: disc.clearance(points, directions) for disc in self.discs}
        if self.rim is not None:
            clearances_by_part["rim"] = self._past_rim(self.rim, points, directions, pose)
        return clearances_by_part

    def meridian_clearances(self, rays: ChiefRays, shift_mm: float = 0.0) -> dict[str, Array]:
        """Return the clearance (n,), mm, of meridional chief rays at each part.

        ``shift_mm`` is the displacement of the mirror along the axis.
        """
        x, z, theta, reflected = np.atleast_1d(
            rays.x, rays.z + shift_mm, rays.theta, rays.reflected
        )
        zeros = np.zeros_like(x)
        points, outwards, back = (
            np.stack([across, zeros, along], axis=-1)
            for across, along in (
                (x, z),
                (np.sin(reflected), -np.cos(reflected)),
                (-np.sin(theta), -np.cos(theta)),
            )
        )
        clearances_by_part = self.clearances(
            points, outwards, back, MirrorPose(displacement_mm=shift_mm)
        )
        return {
            part: clearance.reshape(np.shape(rays.x))
            for part, clearance in clearances_by_part.items()
        }

    def blocks(
        self, points: Array, directions: Array, towards_lens: Array, pose: MirrorPose
    ) -> dict[str, Mask]:
        """Return which reflected rays (n,) each part blocks; see :meth:`clearances`."""
        return {
            part: clearance < 0
            for part, clearance in self.clearances(points, directions, towards_lens, pose).items()
        }

    def meets_rim(self, points: Array, directions: Array, pose: MirrorPose) -> Mask:
        """Return which reflected or outer rays the edge of the rim blocks."""
        if self.rim is None:
            return np.zeros(len(points), dtype=bool)
        mask: Mask = self._past_rim(self.rim, points, directions, pose) < 0
        return mask

    def _past_rim(self, rim: Disc, points: Array, directions: Array, pose: MirrorPose) -> Array:
        """Return the clearance (n,), mm, at the ring around the mirror, which starts at its
        edge."""
        across, meets = rim.crossing(pose.to_mirror(points), pose.rotate_to_mirror(directions))
        inner = rim.radius_mm - (self.housing.rim or Rim()).width_mm
        with np.errstate(invalid="ignore"):
            clearance = np.maximum(
                circle_clearance(across, rim.radius_mm), -circle_clearance(across, inner)
            )
            return np.where(meets, clearance, np.inf)

    def meets_front(self, points: Array, directions: Array, towards_lens: Array) -> Mask:
        """Return which reflected rays (n,) end at the camera or rod in front of the mirror."""
        meets = np.zeros(len(points), dtype=bool)
        if self.camera is not None:
            meets |= self.camera.blocks(points, directions)[0]
        if self.rod is not None:
            meets |= self.rod.blocks(points, directions) | self.rod.blocks(points, towards_lens)
        return meets


def cover_of(obstructions: Obstructions) -> Cover | None:
    """Return the tube or dome of a fitted housing, in the meridian; None without one."""
    shell, envelope = obstructions.housing.shell, obstructions.envelope
    return None if shell is None else Cover(shell.centred(), envelope.base_mm, envelope.back_mm)


def envelope_of(
    housing: Housing, mirror: Mirror, secondary: Secondary | None, mirror_distance_mm: float
) -> Envelope:
    """Return the envelope to which a housing is fitted."""
    rim = housing.rim or Rim()
    lens = (
        -mirror_distance_mm
        if np.isfinite(mirror_distance_mm)
        else -TELECENTRIC_LENS_DISTANCE_RIMS * mirror.rim_radius_mm
    )
    back, outer = highest_mm(mirror) + rim.thickness_mm, mirror.rim_radius_mm + rim.width_mm
    if secondary is None:
        return Envelope(lens, lens, back, outer)
    second = housing.secondary_rim or Rim()
    base = -secondary.distance_mm - highest_mm(secondary.mirror) - second.thickness_mm
    return Envelope(lens, base, back, outer, has_secondary=True)


def highest_mm(mirror: Mirror) -> float:
    """Return the height of the highest surface point of a mirror above its vertex, mm."""
    return float(mirror.sag(np.linspace(0.0, mirror.rim_radius_mm, 513)).max())


def _lids(housing: Housing, envelope: Envelope) -> tuple[Disc | WindowFrame, ...]:
    """Return the discs that close a tube or dome, and the opaque surround of a window."""
    shell = housing.shell
    if shell is None:
        return ()
    if isinstance(shell, FlatWindow):
        return (
            ()
            if shell.diameter_mm is None
            else (WindowFrame("window's frame", shell.heights_mm[0], shell.diameter_mm / 2),)
        )
    base = Disc(f"{shell.KIND}'s base", envelope.base_mm, shell.inner_radius_mm(envelope.base_mm))
    if shell.KIND == "dome":
        return (base,)
    return base, Disc(
        "tube's cap", envelope.back_mm, shell.inner_radius_mm(envelope.back_mm), stops_rising=True
    )


def _before_mirror(
    housing: Housing, envelope: Envelope, secondary: Secondary | None
) -> tuple[Disc, ...]:
    """Return the discs of the camera and of the rim of a second mirror."""
    discs: list[Disc] = []
    if (camera := housing.camera) is not None:
        discs.append(Disc("camera", envelope.lens_mm + camera.height_mm, camera.diameter_mm / 2))
    if secondary is not None and (rim := housing.secondary_rim) is not None and rim.width_mm:
        edge = (
            float(secondary.mirror.sag(np.array(secondary.mirror.rim_radius_mm))) + rim.setback_mm
        )
        radius = secondary.mirror.rim_radius_mm + rim.width_mm
        discs.append(Disc("secondary's rim", -secondary.distance_mm - edge, radius))
    return tuple(discs)


# -- rings of field angle --------------------------------------------------------------------------


class Obscuration(NamedTuple):
    """Ring of the field obscured by a part, at every azimuth."""

    part: str
    """Name of the obscuring part."""
    omega_deg: tuple[float, float]
    """Range of field angles, degrees."""
    image_percent: float
    """Fraction of the area of the image circle, %."""


def obscuration_summary(rings: tuple[Obscuration, ...], percent: float) -> str:
    """Describe the obscured rings of the field and the obscured fraction of the image.

    >>> obscuration_summary((Obscuration("camera", (0.0, 8.43), 0.71),), 0.71)
    'camera 0 to 8.43 deg; total 0.71 % of the image'
    """
    parts = [
        f"{ring.part} {ring.omega_deg[0]:.4g} to {ring.omega_deg[1]:.4g} deg" for ring in rings
    ]
    return f"{', '.join(parts)}; total {percent:.2f} % of the image" if parts else "none"


class MirrorObscuration(NamedTuple):
    """Ring of the mirror in which a part blocks the chief rays."""

    part: str
    x_mm: tuple[float, float]
    """Range of distances from the axis, mm."""


def mirror_obscurations(
    meridian: Meridian, obstructions: Obstructions, shift_mm: float = 0.0, *, merged: bool = False
) -> tuple[MirrorObscuration, ...]:
    """Return the rings of the mirror that each part obscures; they may overlap unless merged.

    Parameters
    ----------
    meridian
        Meridian of the mirror at its actual distance.
    obstructions
    shift_mm
        Axial displacement of the mirror from its nominal position.
    """

    def clearances(x: Array) -> dict[str, Array]:
        clearances_by_part = obstructions.meridian_clearances(meridian.trace(x), shift_mm)
        if merged and clearances_by_part:
            return {"anything": np.min([*clearances_by_part.values()], axis=0)}
        return clearances_by_part

    def clearance(part: str, x: Array) -> Array:
        return clearances(x)[part]

    x = np.linspace(meridian.x_min, meridian.mirror.rim_radius_mm, PLACES)
    return tuple(
        MirrorObscuration(part, ends)
        for part, clear in clearances(x).items()
        for ends in _hidden_between(x, clear, partial(clearance, part))
    )


def obscured_rings(
    meridian: Meridian,
    hidden: tuple[MirrorObscuration, ...],
    image_fraction: Callable[[ChiefRays], Array],
) -> tuple[Obscuration, ...]:
    """Return the obscured rings of the field, given image-area fractions (n,)."""
    rings = [_central_obscuration(meridian, image_fraction)] if meridian.x_min > 0 else []
    for part, ends in hidden:
        rays = meridian.trace(np.array(ends))
        (low, high), (inner, outer) = np.degrees(rays.omega), image_fraction(rays)
        rings.append(Obscuration(part, (float(low), float(high)), float(100 * (outer - inner))))
    return tuple(rings)


def _central_obscuration(
    meridian: Meridian, image_fraction: Callable[[ChiefRays], Array]
) -> Obscuration:
    """Return the ring below the first unobscured mirror point."""
    start = meridian.trace(np.array([meridian.x_min]))
    return Obscuration(
        meridian.centre_obscured_by,
        (0.0, float(np.degrees(start.omega[0]))),
        float(100 * image_fraction(start)[0]),
    )


def _hidden_between(
    x: Array, clear: Array, clearance: Callable[[Array], Array]
) -> list[tuple[float, float]]:
    """Return the intervals of the mirror with negative clearance, with exact ends."""
    hidden = clear < 0
    edges = [
        sign_change(
            lambda v: float(np.clip(clearance(np.array(v)), -1e9, 1e9)),
            float(x[i]),
            float(x[i + 1]),
            2e-12,
        )
        for i in np.flatnonzero(np.diff(hidden.astype(int)))
    ]
    edges = [*([float(x[0])] if hidden[0] else []), *edges, *([float(x[-1])] if hidden[-1] else [])]
    return list(zip(edges[::2], edges[1::2], strict=True))


def clear_field_deg(
    field_deg: tuple[float, float], rings: tuple[Obscuration, ...]
) -> tuple[float, float]:
    """Return the range (low, high) of a field, degrees, between the merged rings at its ends.

    Ends at a ring are :data:`CLEARANCE_DEG` outside it, so that rays at the ends are clear in spite
    of rounding. Both angles are equal if the entire field is obscured.

    >>> clear_field_deg((0.0, 135.0), (Obscuration("anything", (0.0, 12.0), 1.0),))
    (12.000000001, 135.0)
    """
    low, high = field_deg
    for ring in rings:
        if ring.omega_deg[0] <= low + TOUCHES_DEG and ring.omega_deg[1] > low:
            low = min(ring.omega_deg[1] + CLEARANCE_DEG, high)
    for ring in reversed(rings):
        if ring.omega_deg[1] >= high - TOUCHES_DEG and ring.omega_deg[0] > low:
            high = max(ring.omega_deg[0] - CLEARANCE_DEG, low)
    return low, high
