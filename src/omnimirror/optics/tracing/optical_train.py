"""Skew ray trace of mirrors and lens, from image to world and from world to lens.

All coordinates are in the camera frame, in mm: z points from the lens to the mirror; the origin is
the nominal vertex of the mirror. Pixels are handled by the sensor.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.numerics.lazy import cached_property
from ...base.typing import Array, Mask
from ..lenses import Lens
from ..mirrors import Mirror, Secondary
from ..mirrors.form import MirrorForm
from ..mirrors.pose import MirrorPose
from .covered import CoveredMirror
from .folded import FoldedMirror
from .obscuration import Obstructions
from .posed import PosedMirror
from .reflection import Ends, Specular
from .space import Reflections

PUPIL_STEPS = 12  # each reduces the residual to 1 % or less
PUPIL_CLOSE = 1e-13
MIRROR_EDGES = ("mirror", "secondary mirror")


@dataclass(frozen=True)
class OpticalTrain:
    """Optical elements between world and imager.

    ``mirror_distance_mm`` and ``secondary`` are as in :class:`omnimirror.Sensor`; ``obstructions``
    is the housing, None without one.

    >>> import omnimirror as om
    >>> train = om.load_sensor("paper-spherical").optical_train
    >>> origins, directions = train.rays_of_image(np.array([[2.6, 0.0]]), np.zeros(2))  # mm right of the axis
    >>> train.posed_mirror.trace(origins, directions).points.round(2)
    array([[43.67,  0.  , 25.7 ]])
    """

    mirror: Mirror
    lens: Lens
    mirror_distance_mm: float
    pose: MirrorPose
    form: MirrorForm
    secondary: Secondary | None = None
    obstructions: Obstructions | None = None

    @cached_property
    def posed_mirror(self) -> PosedMirror | FoldedMirror:
        """Posed mirror; with a second mirror, the lens side is in the unfolded frame."""
        if self.secondary is not None:
            return FoldedMirror(self.mirror, self.secondary, self.mirror_distance_mm, self.lens.pupil)
        return PosedMirror(self.mirror, self.pose, self.form)

    @cached_property
    def seen_mirror(self) -> PosedMirror | FoldedMirror | CoveredMirror:
        """Mirror as seen from outside: through the tube or dome, if present."""
        mirror, cover = self.posed_mirror, self.obstructions
        if cover is None or cover.housing.shell is None:
            return mirror
        assert isinstance(mirror, PosedMirror)
        ends = cover.envelope.base_mm, cover.envelope.back_mm
        return CoveredMirror(mirror, cover.housing.shell, ends, self.mirror_distance_mm, self.lens.pupil)

    @property
    def lens_offset(self) -> Array:
        """Reference point (3,) of the lens."""
        vertex = 0.0 if self.secondary is None else -self.secondary.distance_mm
        return np.array([0.0, 0.0, vertex if self.lens.TELECENTRIC else -self.mirror_distance_mm])

    @property
    def pupil_offset(self) -> Array:
        """Centre (3,) of the paraxial entrance pupil of the lens."""
        offset: Array = self.lens_offset + np.array([0.0, 0.0, self.lens.pupil.at_mm])
        return offset

    def clearances(self, seen_at: Array, points: Array, to_pupils: Array, to_targets: Array) -> dict[str, Array]:
        """Return the clearance (n,), mm, of rays at every edge between object and imager.

        Negative clearances mean blocked rays. This is the single definition of vignetting and
        obscuration: edges of mirrors and lens, bore, barrel, camera, rod, rims, lids and window
        frame. The stop itself is the unit disk in which rays are sampled.

        Parameters
        ----------
        seen_at, to_pupils : (n, 3) arrays
            Points on the mirror facing the lens, and directions from these to the lens.
        points, to_targets : (n, 3) arrays
            Points on the primary mirror, and directions of the reflected rays into the world.
        """
        with np.errstate(all="ignore"):
            found = self.seen_mirror.clearances(seen_at, points, to_pupils, to_targets)
            found |= self.lens.clearances(seen_at - self.lens_offset, -to_pupils)
            return found | self._housing_clearances(seen_at, points, to_pupils, to_targets)

    def _housing_clearances(
        self, seen_at: Array, points: Array, to_pupils: Array, to_targets: Array
    ) -> dict[str, Array]:
        if self.obstructions is None:
            return {}
        mirror, towards_lens = self.posed_mirror, to_pupils
        if isinstance(mirror, FoldedMirror):
            towards_lens = mirror.over(seen_at) - points
        return self.obstructions.clearances(points, to_targets, towards_lens, self.pose)

    def obstructed(self, origins: Array, directions: Array) -> tuple[Reflections, dict[str, Array]]:
        """Reflect unobstructed lens-side rays, and return their clearances (n,).

        Obstructions are the parts of the housing and those of two mirrors, without the edges of the
        mirrors and of the lens.
        """
        mirror, own = self.posed_mirror, {}
        to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        with np.errstate(all="ignore"):
            if isinstance(mirror, FoldedMirror):
                found, seen_at = mirror.unobstructed(origins, directions), mirror.seen_at(origins, directions)
                own = mirror.clearances(seen_at, found.points, to_pupils, found.directions)
                own = {part: edge for part, edge in own.items() if part not in MIRROR_EDGES}
            else:
                found = mirror.trace(origins, directions)
                seen_at = found.points
            return found, own | self._housing_clearances(seen_at, found.points, to_pupils, found.directions)

    def passes_lens(self, origins: Array, directions: Array) -> Mask:
        """Return which lens-side rays (n, 3), (n, 3) pass the edges of the lens."""
        with np.errstate(all="ignore"):
            edges = self.lens.clearances(origins - self.lens_offset, directions)
        passed = np.ones(len(origins), dtype=bool)
        for edge in edges.values():
            passed &= edge >= 0
        return passed

    def passes(self, origins: Array, directions: Array, found: Reflections) -> Mask:
        """Return which lens-side rays (n, 3), (n, 3), given their reflections, are transmitted."""
        to_pupils = -directions / np.linalg.norm(directions, axis=-1, keepdims=True)
        mirror = self.posed_mirror
        seen_at = mirror.seen_at(origins, directions) if isinstance(mirror, FoldedMirror) else found.points
        edges = self.clearances(seen_at, found.points, to_pupils, found.directions)
        passed: Mask = np.logical_and.reduce([found.valid, *(edge >= 0 for edge in edges.values())])
        return passed

    def entrance_pupil_points(self, pupil: Array, chief: Array | None = None) -> Ends:
        """Return entrance-pupil points for points (n, 2) of the unit disk of the aperture.

        ``chief`` are slopes (n, 2) of the chief rays, for a moving pupil; paraxial by default.
        """
        if self.lens.TELECENTRIC:
            return Ends(self.lens.entrance_pupil_points(pupil), distant=True)
        return Ends(self.lens.entrance_pupil_points(pupil, chief) + self.lens_offset)

    def chief_rays_to(self, targets: Ends) -> Specular:
        """Return the mirror points that image targets (n,) in the pupil centre.

        For a pupil that moves with the viewing angle, pupil and mirror point are found by
        iteration.
        """
        mirror, middle = self.seen_mirror, np.zeros((1, 2))
        found = mirror.specular(self.entrance_pupil_points(middle), targets)
        if not self.lens.pupil.moves:
            return found
        for _ in range(PUPIL_STEPS):
            slopes = found.chief_slopes
            found = mirror.specular(self.entrance_pupil_points(middle, slopes), targets, found.points)
            with np.errstate(invalid="ignore"):
                if not (np.abs(found.chief_slopes - slopes) > PUPIL_CLOSE).any():
                    break
        return found

    def image_of(self, targets: Ends) -> Array:
        """Return images (n, 2), mm, of targets (n,) on an untilted imager; NaN if not imaged.

        Coordinates are right of and below the optical axis.
        """
        return self._image_of(self.chief_rays_to(targets))

    def image_and_start_of(self, targets: Ends) -> tuple[Array, Array]:
        """Return these images, and the origins (n, 3), mm, of the outgoing rays."""
        found = self.chief_rays_to(targets)
        return self._image_of(found), self.seen_mirror.left_at(found)

    def _image_of(self, found: Specular) -> Array:
        image = self.lens.image_of(found.seen_at - self.lens_offset, found.to_pupils)
        image[~found.valid] = np.nan
        return image

    def rays_of_image(self, image_mm: Array, pupil: Array) -> tuple[Array, Array]:
        """Return origins and unit directions (n, 3) of rays from image points through the aperture.

        Image points (n, 2) are in mm right of and below the optical axis, in the image before any
        flip; aperture points (n, 2), or one, are in entrance-pupil radii.
        """
        origins, directions = self.lens.rays(image_mm, np.broadcast_to(pupil, image_mm.shape))
        origins = origins + self.lens_offset
        if self.lens.TELECENTRIC:  # from the plane in focus back to below the mirror
            bound = np.linalg.norm(self.pose.shift) + self.mirror.rim_radius_mm + self.mirror.bounds[1][1]
            bound += 2 * np.abs(self.lens_offset[2])
            origins = origins - (bound + np.abs(origins[:, 2:])) * directions
        return origins, directions
