"""Mirror sensor: mirror, lens, imager, mount and housing; implements the Camera protocol."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import finite, format_value, instance, numbers, positions, vectors
from ..base.caching import cached_property
from ..base.errors import InvalidParameter, NotOneToOne, OmnimirrorError
from ..base.parameters import Uncertainty
from ..base.results import Line, card, field_range, line_drawing, origin
from ..base.typing import Array
from ..cameras.camera import AxialSymmetry, Mount, Projection, Rays, inside_image, rotate_vectors
from .housing import NO_HOUSING, Housing
from .image_sensor import ImagePlane, Imager, ImagerPose
from .lenses import GaussianLens, Lens, Perspective
from .mirrors import Mirror, Secondary
from .mirrors.mirror import MirrorForm, MirrorPose
from .thermal import Thermal
from .tracing.meridian import ROUNDING, ChiefRays, Cover, Meridian
from .tracing.obscuration import (
    MirrorObscuration,
    Obscuration,
    Obstructions,
    clear_field_deg,
    cover_of,
    mirror_obscurations,
    obscured_rings,
)
from .tracing.optical_train import OpticalTrain
from .tracing.reflection import RayEndpoints
from .tracing.two_mirrors import TwoMirrorMeridian

# -- Sensor ----------------------------------------------------------------------------------------

MAX_MIRROR_DISTANCE_MM = 1e7  # in sensor files
MAX_PUPIL_COORDINATE = 1e3  # largest aperture coordinate, in pupil radii
MIRROR_PROPERTIES = ("meridian", "_hidden", "_hidden_merged")  # independent of the lens
SensorProperty = Literal["single mirror", "thin lens", "perpendicular imager", "ideal except poses"]


@dataclass(frozen=True)
class Sensor:
    """Catadioptric sensor: a mirror of revolution and a camera, coaxial or slightly misaligned.

    Parameters
    ----------
    mirror, lens, imager, mount
        Parts of the sensor.
    mirror_distance_mm : mm
        Distance m from the lens's reference point (its principal point; the lens defines its
        entrance pupil) to the mirror vertex; infinite (and omitted from files) for an orthographic
        lens, which does not depend on it. With a secondary, the path length over the secondary.
    name, notes
        Descriptive text.
    mirror_pose
        Pose of the mirror: decentring, displacement and tilt against lens and imager; aligned by
        default. The world origin remains at the nominal vertex.
    mirror_form
        Form error of the mirror over its disc; none by default.
    imager_pose
        Tilt and rotation of the imager against the lens; perpendicular to the axis by default.
    secondary
        Second mirror between primary and lens: flat, to fold the path, or curved.
    housing
        Parts around the mirror; none by default.
    uncertainty
        Uncertainty of a calibration; None for a design.
    thermal
        Thermal model; None if unknown.

    Raises
    ------
    InvalidParameter
        If a perspective lens has no finite mirror distance. The validity of the mirror (one-to-one
        mapping, no self-obstruction) is checked at the first evaluation.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> origins, directions, valid = sensor.backproject([[511.5, 11.5], [0.0, 0.0]])
    >>> directions.round(3)[0]  # 500 px above the centre: forward, and 44 deg up
    array([0.721, 0.   , 0.693])
    >>> valid
    array([ True, False])
    """

    mirror: Mirror
    lens: Lens
    imager: Imager
    mount: Mount = field(default_factory=Mount)
    mirror_distance_mm: float = np.inf
    name: str = "sensor"
    notes: str = ""
    mirror_pose: MirrorPose = field(default_factory=MirrorPose)
    secondary: Secondary | None = None
    housing: Housing = NO_HOUSING
    uncertainty: Uncertainty | None = None
    thermal: Thermal | None = None
    mirror_form: MirrorForm = field(default_factory=MirrorForm)
    imager_pose: ImagerPose = field(default_factory=ImagerPose)

    def __post_init__(self) -> None:
        for name, kind in (("mirror", Mirror), ("lens", Lens), ("imager", Imager)):
            instance(name, getattr(self, name), kind, f"an instance of {kind.__name__}")
        instance("housing", self.housing, Housing, "an instance of Housing")
        if numbers("mirror_distance_mm", self.mirror_distance_mm, "a number").ndim:
            raise InvalidParameter(
                f"mirror_distance_mm must be one number; got {format_value(self.mirror_distance_mm)}"
            )
        if self.lens.TELECENTRIC:
            object.__setattr__(self, "mirror_distance_mm", np.inf)
        elif not (np.isfinite(self.mirror_distance_mm) and self.mirror_distance_mm > 0):
            raise InvalidParameter(
                f"mirror_distance_mm must be finite and greater than 0 for a {self.lens.KIND} lens: "
                "the distance from its principal point to the mirror vertex; got "
                f"{self.mirror_distance_mm:g}"
            )
        if self.secondary is not None and self.mirror_pose != MirrorPose():
            raise InvalidParameter(
                "mirror_pose is not supported with a secondary: two mirrors are traced on one axis; remove one of them"
            )
        if self.secondary is not None and not self.mirror_form.is_empty:
            raise InvalidParameter(
                "mirror_form is not supported with a secondary; remove one of them"
            )
        if not self.imager_pose.is_perpendicular and (
            self.lens.TELECENTRIC or not self.lens.IS_THIN
        ):
            raise InvalidParameter(
                f"imager_pose must not have a tilt behind lenses of kind {self.lens.KIND}, whose exit "
                "pupil is unknown; remove the tilts or use a perspective lens"
            )

    # -- meridian ----------------------------------------------------------------------------------

    @cached_property
    def meridian(self) -> Meridian:
        """Chief rays, field and inversions for a mirror coaxial with the lens.

        Raises
        ------
        InvalidParameter
            If the mirror is decentred or tilted: the sensor then has no rotational symmetry.
        """
        if not self.is_axial:
            raise InvalidParameter(
                f"{self._misaligned_part} of {self.name!r} must be aligned for rotationally symmetric "
                "evaluation; got a decentred, tilted or deformed one; use sensor.aligned(), or "
                "three-dimensional computations (om.evaluate_camera of its om.SensorModel, rays, "
                "images, spots, MTF)"
            )
        m = self.mirror_distance_mm + self.mirror_pose.displacement_mm
        if self.secondary is None:
            return Meridian(self.mirror, m, self.lens.pupil, cover=self._cover)
        return TwoMirrorMeridian(
            self.mirror, m, self.lens.pupil, cover=self._cover, secondary=self.secondary
        )

    @property
    def _cover(self) -> Cover | None:
        """Tube or dome in the light path, in the frame of the mirror."""
        cover = cover_of(self.obstructions) if self.housing.shell is not None else None
        return None if cover is None else cover.moved(self.mirror_pose.displacement_mm)

    def with_lens(self, lens: Lens) -> Sensor:
        """Return the sensor with another lens at the same position.

        Parameters
        ----------
        lens
            New lens.

        Returns
        -------
        Sensor
            Sensor with this lens.
        """
        changed = replace(self, lens=lens)
        if lens.pupil == self.lens.pupil:
            changed.__dict__.update(
                (name, self.__dict__[name]) for name in MIRROR_PROPERTIES if name in self.__dict__
            )
        return changed

    @cached_property
    def is_axial(self) -> bool:
        """True if the sensor is rotationally symmetric: all parts are coaxial."""
        return self._misaligned_part is None

    @property
    def _misaligned_part(self) -> str | None:
        """Description of the misaligned parts, starting a sentence; None if aligned."""
        shell = self.housing.shell
        parts = {
            "the mirror": self.mirror_pose.is_axial,
            "the cover": shell is None or shell.is_axial,
            "the form error of the mirror": self.mirror_form.is_empty,
            "the imager": self.imager_pose == ImagerPose(),
        }
        return next((name for name, is_axial in parts.items() if not is_axial), None)

    @property
    def is_ideal_except_pose(self) -> bool:
        """True without form error and imager tilt; mirror and cover may be misaligned."""
        return self.mirror_form.is_empty and self.imager_pose == ImagerPose()

    def check(self, computation: str, *needs: SensorProperty) -> None:
        """Check that a sensor has the properties that a computation requires.

        Parameters
        ----------
        computation
            Name of the computation, for the message.
        needs
            ``"single mirror"``; ``"thin lens"``: not defined by a table or surfaces;
            ``"perpendicular imager"``: without tilt; ``"ideal except poses"``: without form error and
            imager misalignment.

        Raises
        ------
        InvalidParameter
            If a property is missing; the message names the supported alternatives.
        """
        lens, imager_pose = self.lens, self.imager_pose
        conditions: dict[SensorProperty, tuple[bool, str]] = {
            "single mirror": (
                self.secondary is None,
                f"a sensor without secondary mirror; got {self.name!r}, which has one; use the sensor "
                "without its secondary, or evaluation, spots, images and dewarping",
            ),
            "thin lens": (
                lens.IS_THIN,
                f"a perspective or orthographic lens; {self.name!r} has a lens given by its "
                f"{lens.KIND}; use a perspective lens of the same focal length and entrance pupil, or "
                "evaluation, focus, spots, illumination, images and dewarping",
            ),
            "perpendicular imager": (
                imager_pose.is_perpendicular,
                f"an imager perpendicular to the axis; that of {self.name!r} is tilted by "
                f"{imager_pose.tilt_x_deg:g} and {imager_pose.tilt_y_deg:g} deg; use images and "
                "tolerances",
            ),
            "ideal except poses": (
                self.is_ideal_except_pose,
                f"a sensor without [mirror_form] and [imager_pose]; {self.name!r} has one of them; "
                "use sensor.aligned(), or rays, images and dewarping",
            ),
        }
        for is_met, condition in (conditions[need] for need in needs):
            if not is_met:
                raise InvalidParameter(f"{computation} requires {condition}")

    def _repr_html_(self) -> str:
        """Return an HTML card for notebooks."""

        return sensor_card(self)

    def aligned(self) -> Sensor:
        """Return the nominal sensor, without form and alignment errors.

        Returns
        -------
        Sensor
            Aligned sensor.
        """
        shell = self.housing.shell
        housing = self.housing if shell is None else replace(self.housing, shell=shell.centred())
        return replace(
            self,
            mirror_pose=MirrorPose(),
            housing=housing,
            mirror_form=MirrorForm(),
            imager_pose=ImagerPose(),
        )

    @property
    def field_deg(self) -> tuple[float, float]:
        """Smallest and largest field angle Omega, degrees from the axis towards the lens."""
        return float(np.degrees(self.meridian.omega_min)), float(
            np.degrees(self.meridian.omega_max)
        )

    def image_height_px(self, rays: ChiefRays) -> Array:
        """Compute the image height h of chief rays, px (Eq. 7).

        Parameters
        ----------
        rays
            Chief rays (n,) of the meridian.

        Returns
        -------
        (n,) array
            Image heights, px.

        Raises
        ------
        InvalidParameter
            If the argument is not a bundle of chief rays.
        """
        rays = instance("rays", rays, ChiefRays, "chief rays of a meridian")
        return self.lens.image_height(rays.first.x, rays.first.w) / self.imager.pitch_mm

    def image_height_rate_px(self, rays: ChiefRays) -> Array:
        """Compute dh/dOmega of chief rays, px per radian (Eq. 8).

        It is infinite at an apex with square-root behaviour of the mapping.

        Parameters
        ----------
        rays
            Chief rays (n,) of the meridian.

        Returns
        -------
        (n,) array
            Derivative with respect to the field angle, px per radian.

        Raises
        ------
        InvalidParameter
            If the argument is not a bundle of chief rays.
        """
        first = instance("rays", rays, ChiefRays, "chief rays of a meridian").first
        rate = (
            self.lens.image_height_rate(first.x, first.w, first.slope, first.drift)
            * rays.dfirst_dx()
        )
        with np.errstate(divide="ignore"):
            return rate / rays.domega_dx() / self.imager.pitch_mm

    def x_from_height_px(self, h_px: ArrayLike) -> Array:
        """Return mirror points (mm) of image heights (n,), px.

        Parameters
        ----------
        h_px : (n,)
            Image heights, px.

        Returns
        -------
        (n,) array
            Distances of the mirror points from the axis, mm.

        Raises
        ------
        InvalidParameter
            If the heights are not numeric.
        OutsideField
            If a height exceeds the image radius of the rim.
        """
        h_mm = self.lens.undistorted_height(numbers("h_px", h_px) * self.imager.pitch_mm)
        return self._x_from_ideal_mm(h_mm)

    def _x_from_ideal_mm(self, h_mm: Array) -> Array:
        """Return mirror points (mm) of image heights (n,), mm, of the undistorted image."""
        if isinstance(self.lens, GaussianLens):
            return self.meridian.x_from_tan_theta(h_mm / self.lens.principal_distance)
        unit = self.lens.ideal_height(np.ones(1), np.full(1, np.inf))[0]
        return self.meridian.x_from_first(h_mm / unit)

    def radius_from_centre_px(self, pixels: Array) -> Array:
        """Compute image heights (n,), px, of pixels, without tangential distortion.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), with integers at pixel centres.

        Returns
        -------
        (n,) array
            Image heights, px.

        Raises
        ------
        InvalidParameter
            If the pixels have another shape.
        """
        image, _ = self.image_plane.flat_mm(vectors("pixels", pixels, 2))
        if self.lens.is_symmetric:
            return np.hypot(image[..., 0], image[..., 1]) / self.imager.pitch_mm
        ideal = self.lens.undistorted(image)
        return (
            self.lens.distorted_height(np.hypot(ideal[..., 0], ideal[..., 1]))
            / self.imager.pitch_mm
        )

    @property
    def rim_radius_px(self) -> float:
        """Image radius of the rim, px."""
        return float(self.lens.distorted_height(np.array(self._edges_mm[1])) / self.imager.pitch_mm)

    @cached_property
    def _edges_mm(self) -> tuple[float, float]:
        """Undistorted image heights of the ends of the field."""
        first = self.meridian.trace(
            np.array([self.meridian.x_min, self.mirror.rim_radius_mm])
        ).first
        inner, outer = self.lens.ideal_height(first.x, first.w)
        self.lens.distorted_height(np.array([outer]))  # checks that the distortion is monotonic
        return float(inner), float(outer)

    # -- obscuration -------------------------------------------------------------------------------

    @cached_property
    def obstructions(self) -> Obstructions:
        """Housing with its sizes, fitted to the nominal sensor.

        Raises
        ------
        InvalidParameter
            If the housing does not fit; the message states the valid range.
        """
        return Obstructions.of(self.housing, self.mirror, self.secondary, self.mirror_distance_mm)

    @cached_property
    def obscurations(self) -> tuple[Obscuration, ...]:
        """Rings of field angle obscured at every azimuth; they may overlap.

        Raises
        ------
        InvalidParameter
            If the mirror is decentred or tilted: use :meth:`obscured_by` for single pixels.
        """
        if self.housing == NO_HOUSING and self.secondary is None:
            return ()
        return obscured_rings(self.meridian, self._hidden, self._image_fraction)

    @cached_property
    def _hidden(self) -> tuple[MirrorObscuration, ...]:
        return self._hidden_parts(merged=False)

    @cached_property
    def _hidden_merged(self) -> tuple[MirrorObscuration, ...]:
        return self._hidden_parts(merged=True)

    @cached_property
    def obscured(self) -> tuple[Obscuration, ...]:
        """Obscured rings with overlapping ones merged; their image fractions are additive."""
        rings = tuple(sorted(self.obscurations, key=lambda ring: ring.omega_deg))
        is_disjoint = all(
            inner.omega_deg[1] < outer.omega_deg[0] for inner, outer in pairwise(rings)
        )
        return (
            rings
            if is_disjoint
            else obscured_rings(self.meridian, self._hidden_merged, self._image_fraction)
        )

    @property
    def clear_field_deg(self) -> tuple[float, float]:
        """Field without the obscured ends, degrees; both angles are equal if all is obscured."""
        return clear_field_deg(self.field_deg, self.obscured)

    @property
    def obscured_to_deg(self) -> float:
        """Upper field angle, degrees, of the obscured centre, or of the field's start."""
        return self.clear_field_deg[0]

    @property
    def obscured_percent(self) -> float:
        """Obscured fraction of the area of the image circle, %."""
        return sum(ring.image_percent for ring in self.obscured)

    def obscured_by(self, pixels: ArrayLike) -> dict[str, NDArray[np.bool_]]:
        """Return which pixels (n, 2) each part of the sensor obscures.

        Parts are those of the housing and, for two mirrors, the secondary, the bore and the camera.
        Pixels outside the mirror image are False for all parts.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).

        Returns
        -------
        dict of (n,) arrays
            Masks by part name, True for obscured pixels.

        Raises
        ------
        InvalidParameter
            If the pixels have another shape, or for two mirrors in a tube (use
            :attr:`obscurations`).

        Examples
        --------
        >>> import omnimirror as om
        >>> from omnimirror.optics.housing import CameraBody, Housing
        >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
        >>> sensor.obscured_by([[511.5, 511.5], [900.0, 511.5]])
        {'camera': array([ True, False])}
        """
        pixels = vectors("pixels", pixels, 2)
        start, towards = self.lens_rays(pixels.reshape(-1, 2), np.zeros(2))
        reflections, edges = self.optical_train.obstructed(start, towards)
        shape = pixels.shape[:-1]
        return {
            part: (reflections.valid & (edge < 0)).reshape(shape) for part, edge in edges.items()
        }

    def _hidden_parts(self, merged: bool) -> tuple[MirrorObscuration, ...]:
        return mirror_obscurations(
            self.meridian, self.obstructions, self.mirror_pose.displacement_mm, merged=merged
        )

    def _image_fraction(self, rays: ChiefRays) -> Array:
        """Return the fraction (n,) of the image circle's area within chief rays."""
        fraction: Array = (self.image_height_px(rays) / self.rim_radius_px) ** 2
        return fraction

    # -- camera interface --------------------------------------------------------------------------

    @property
    def image_size(self) -> tuple[int, int]:
        """Image size (width, height), px."""
        return self.imager.size

    @cached_property  # moving views read it several times per frame
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry about the mirror axis; None for a decentred or tilted mirror or lens."""
        if not (self.is_axial and self.lens.is_symmetric):
            return None
        u, v = self.imager.centre
        centre = (self.imager.width_px - 1 - u, v) if self.mount.image_flipped else (u, v)
        x, y, z = self._axes.T
        right = -x if self.mount.image_flipped else x
        angles = self.meridian.omega_min, self.meridian.omega_max
        # Bound methods, because sensors with a cached symmetry must support pickling.
        return AxialSymmetry(centre, -z, right, y, *angles, self._radius_px, self._origin_mm)

    def _rays_at(self, omega: Array) -> ChiefRays:
        return self.meridian.trace(self.meridian.x_from_omega(omega))

    def _radius_px(self, omega: Array) -> Array:
        return self.image_height_px(self._rays_at(omega))

    def _origin_mm(self, omega: Array) -> tuple[Array, Array]:
        x, z = self._rays_at(omega).start
        return x, -z - self.mirror_pose.displacement_mm

    @property
    def axis(self) -> Array:
        """World direction (3,) of field angle 0, from the mirror back to the camera."""
        return -self._axes[:, 2]

    @property
    def is_image_reversed(self) -> bool:
        """True if the raw image is mirrored: text is reversed and markers are not detected.

        A second reflection restores the orientation.
        """
        return (self.secondary is None) != self.mount.image_flipped

    @property
    def _axes(self) -> Array:
        """World directions (3, 3), in columns, of image right, image down and lens to mirror.

        A second mirror reverses the direction of the lens.
        """
        axes: Array = self.mount.rotation() * np.array(
            [1.0, 1.0, 1.0 if self.secondary is None else -1.0]
        )
        return axes

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Compute the rays of pixels (n, 2) from mirror or cover into the world.

        Pixels outside the image, or outside the image of the rim, are invalid and NaN.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), with integers at pixel centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the pixels have another shape.
        NotOneToOne
            If the mapping is not invertible, for aligned and misaligned sensors.
        """
        pixels = vectors("pixels", pixels, 2)
        if not self.is_axial:
            self._check_one_to_one()
            return self.aperture_rays(pixels, np.zeros(2))
        image, _ = self.image_plane.flat_mm(pixels)
        radius, cos, sin = _unit(*np.moveaxis(self.lens.undistorted(image), -1, 0))
        inner, outer = self._edges_mm
        valid = inside_image(pixels, self.image_size)
        with np.errstate(invalid="ignore"):  # a distorting lens may not reach some pixels
            valid &= (radius >= inner * (1 - ROUNDING)) & (radius <= outer * (1 + ROUNDING))
        origins, directions = np.full((2, *radius.shape, 3), np.nan)
        rays = self.meridian.trace(self._x_from_ideal_mm(np.clip(radius[valid], inner, outer)))
        cos, sin = cos[valid], sin[valid]
        s, (x, z) = np.sin(rays.omega), rays.last
        z = z + self.mirror_pose.displacement_mm
        rotation = self._axes.T
        origins[valid] = rotate_vectors(np.stack([x * cos, x * sin, z], axis=-1), rotation)
        directions[valid] = rotate_vectors(
            np.stack([s * cos, s * sin, -np.cos(rays.omega)], axis=-1), rotation
        )
        return Rays(origins, directions, valid)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Project points (n, 3), mm, by exact reflection (no single viewpoint is assumed).

        Parameters
        ----------
        points_mm : (n, 3)
            World points, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the points have another shape.
        """
        points = rotate_vectors(vectors("points_mm", points_mm, 3), self._axes)
        if not self.is_axial:
            return self._project_in_space(points, distant=False)
        x, y, z = np.moveaxis(points, -1, 0)
        distance, cos, sin = _unit(x, y)
        return self._image(
            self.meridian.x_from_point(distance, z - self.mirror_pose.displacement_mm), cos, sin
        )

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Project infinitely distant points in directions (n, 3), non-zero vectors of any length.

        Parameters
        ----------
        directions : (n, 3)
            World directions, of any non-zero length.

        Returns
        -------
        Projection
            Pixels (n, 2) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the directions have another shape.
        """
        towards = rotate_vectors(vectors("directions", directions, 3), self._axes)
        if not self.is_axial:
            return self._project_in_space(towards, distant=True)
        x, y, z = np.moveaxis(towards, -1, 0)
        distance, cos, sin = _unit(x, y)
        omega = np.arctan2(distance, -z)
        in_field = self.meridian.is_in_field(omega) & (distance + np.abs(z) > 0)
        x_mirror = np.full_like(omega, np.nan)
        x_mirror[in_field] = self.meridian.x_from_omega(omega[in_field])
        return self._image(x_mirror, cos, sin)

    def _image(self, x_mirror: Array, cos: Array, sin: Array) -> Projection:
        """Return the pixels of mirror points (n,) at azimuths; NaN points are invalid."""
        image = np.full((*x_mirror.shape, 2), np.nan)
        in_field = np.isfinite(x_mirror)
        first = self.meridian.trace(x_mirror[in_field]).first
        radius = self.lens.ideal_height(first.x, first.w)
        ideal = np.stack([radius * cos[in_field], radius * sin[in_field]], axis=-1)
        image[in_field] = self.lens.distorted(ideal)
        return self._to_projection(image)

    # -- skew rays ---------------------------------------------------------------------------------

    @property
    def lens_offset(self) -> Array:
        """Reference point (3,) of the lens, mm from the nominal mirror vertex."""
        second = 0.0 if self.secondary is None else self.secondary.distance_mm
        return self.lens.offset(self.mirror_distance_mm, second)

    @property
    def pupil_offset(self) -> Array:
        """Centre (3,) of the paraxial entrance pupil, mm from the nominal mirror vertex."""
        offset: Array = self.lens_offset + np.array([0.0, 0.0, self.lens.pupil.at_mm])
        return offset

    @cached_property
    def optical_train(self) -> OpticalTrain:
        """Mirrors and lens in their poses, for skew ray tracing.

        Raises
        ------
        InvalidParameter
            If the sensor has two mirrors in a tube.
        """
        if self.housing.shell is not None:
            self.check("ray tracing through a tube or dome", "single mirror")
        return OpticalTrain(
            self.mirror,
            self.lens,
            self.mirror_distance_mm,
            self.mirror_pose,
            self.mirror_form,
            self.secondary,
            None if self.housing == NO_HOUSING else self.obstructions,
        )

    @property
    def image_plane(self) -> ImagePlane:
        """Conversion between pixels and image points behind the lens."""
        distance = self.lens.principal_distance if isinstance(self.lens, Perspective) else np.inf
        return ImagePlane(self.imager, self.imager_pose, self.mount.image_flipped, distance)

    def lens_rays(self, pixels: ArrayLike, pupil: ArrayLike) -> tuple[Array, Array]:
        """Return the rays of pixels through aperture points to the mirror.

        Rays are in the camera frame. A thin lens is ideal except for its distortion; its aperture
        is the unit disc.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).
        pupil : (n, 2)
            Points of the entrance pupil, in pupil radii.

        Returns
        -------
        tuple of (n, 3) arrays
            Origins in mm and unit directions, in the camera frame.

        Raises
        ------
        InvalidParameter
            If the pixels or pupil points have another shape.
        """
        pixels, pupil = vectors("pixels", pixels, 2), positions("pupil", pupil)
        _check_pupil(pupil, pixels)
        flat, depth = self.image_plane.flat_mm(pixels)
        origins, directions = self.optical_train.rays_of_image(flat, pupil)
        if not self.imager_pose.is_perpendicular:  # each pixel is focused at its own distance
            assert isinstance(self.lens, Perspective)
            lens = self.lens
            behind, f = lens.image_distance + depth, lens.focal_length_mm
            vergence = 1 / (f * behind / (behind - f) - lens.pupil.at_mm)
            directions = directions.copy()
            directions[..., :2] += origins[..., :2] * (1 / lens.from_pupil - vergence)[..., None]
        return origins, directions

    def aperture_rays(self, pixels: ArrayLike, pupil: ArrayLike) -> Rays:
        """Trace rays of pixels (n, 2) through aperture points (n, 2), or one, into the world.

        Rays are traced in three dimensions from the imager: an ideal thin lens images a pixel,
        through every aperture point, to one point of the plane in focus; the mirror reflects these
        rays. The aperture point (0, 0) is the chief ray of :meth:`backproject`.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).
        pupil : (n, 2)
            Points of the entrance pupil, in pupil radii.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and validity (n,).

        Raises
        ------
        InvalidParameter
            If the pixels or pupil points have another shape.

        Examples
        --------
        The angular blur of a pixel is the angle between rays through opposite edges of the
        aperture:

        >>> import omnimirror as om
        >>> sensor = om.load_sensor("paper-spherical")
        >>> rays = sensor.aperture_rays([[811.5, 511.5]] * 2, [[-1.0, 0.0], [1.0, 0.0]])
        >>> round(float(np.degrees(np.arccos(rays.directions[0] @ rays.directions[1]))), 2)
        0.21
        >>> om.evaluate(sensor, h_px=[300.0]).blur_t_deg.round(2)
        array([-0.21])
        """
        pixels = vectors("pixels", pixels, 2)
        flat = pixels.reshape(-1, 2)
        pupil = (
            finite("pupil", pupil, -MAX_PUPIL_COORDINATE, MAX_PUPIL_COORDINATE, last=2)
            if flat.size
            else flat
        )
        _check_pupil(pupil, pixels)
        pupil = np.broadcast_to(pupil, pixels.shape).reshape(-1, 2)
        valid = inside_image(flat, self.image_size)
        origins, directions = np.full((2, *flat.shape[:-1], 3), np.nan)
        start, towards = self.lens_rays(flat[valid], pupil[valid])
        reflections = self.optical_train.effective_mirror.trace(start, towards)
        passes = reflections.valid & (
            self.optical_train.passes_lens(start, towards) if pupil.any() else True
        )
        rotation = self._axes.T
        origins[valid] = rotate_vectors(reflections.points, rotation)
        directions[valid] = rotate_vectors(reflections.directions, rotation)
        valid[valid] = passes
        shape = pixels.shape[:-1]
        return Rays(origins.reshape(*shape, 3), directions.reshape(*shape, 3), valid.reshape(shape))

    def _project_in_space(self, targets: Array, distant: bool) -> Projection:
        """Return the pixels of points or directions (n, 3) of the camera frame."""
        self._check_one_to_one()
        image = self.optical_train.image_of(RayEndpoints.of(targets.reshape(-1, 3), distant))
        return self._to_projection(image.reshape(*targets.shape[:-1], 2))

    def _check_one_to_one(self) -> None:
        """Raise NotOneToOne for a misaligned sensor whose mapping is not one-to-one when it is aligned.

        Such a sensor, for example a cone under a telecentric lens, has no inverse mapping: a tilt,
        however small, does not make it a camera.
        """
        _ = self._is_one_to_one

    @cached_property
    def _is_one_to_one(self) -> bool:
        try:
            return self.aligned().meridian.omega_max > 0
        except NotOneToOne:
            raise
        except OmnimirrorError:  # other reasons do not apply as-built
            return True

    def _to_projection(self, image_mm: Array) -> Projection:
        """Convert image points (n, 2), mm, of an untilted imager to pixels."""
        pixels = self.image_plane.pixels(image_mm)
        valid = inside_image(pixels, self.image_size)
        pixels[~valid] = np.nan
        return Projection(pixels, valid)


def _unit(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Return length, cosine and sine of vectors (x, y); the zero vector has azimuth 0."""
    length = np.hypot(x, y)
    safe = np.where(length > 0, length, 1.0)
    return length, np.where(length > 0, x / safe, 1.0), y / safe


def _check_pupil(pupil: Array, pixels: Array) -> None:
    if pupil.shape not in (pixels.shape, (2,)):
        raise InvalidParameter(
            f"pupil must have shape {pixels.shape}, or be one point; got {pupil.shape}"
        )


def check_sensor(value: Any, name: str = "sensor") -> None:
    """Check that a value is a sensor and not, for example, a name."""
    instance(name, value, Sensor, "a sensor (see om.load_sensor)")


# -- Notebook card ---------------------------------------------------------------------------------

PROFILE_POINTS = 61
CHIEF_RAYS = 7
TELECENTRIC_LENS_RADII = 2.5  # distance of a drawn telecentric lens from the vertex, in rim radii
OBJECT_RAY_RADII = 0.8  # length of rays in object space, in rim radii


def sensor_card(sensor: Sensor) -> str:
    """Return an HTML card with cross-section, chief rays and properties."""
    nominal = sensor.aligned()
    try:
        drawing, field = (
            line_drawing(list(_section(nominal)), f"Cross-section of {sensor.name}"),
            _field_properties(nominal),
        )
    except OmnimirrorError as e:
        drawing, field = "", {"Invalid": str(e)}
    lens, imager, mount = sensor.lens, sensor.imager, sensor.mount
    distance = (
        {}
        if lens.TELECENTRIC
        else {"Distance": f"{sensor.mirror_distance_mm:.4g} mm from lens to mirror"}
    )
    parts = {
        "Mirror": f"{sensor.mirror.KIND}, rim radius {sensor.mirror.rim_radius_mm:.4g} mm{_secondary(sensor)}",
        "Lens": f"{lens.KIND}, {_focal(lens)}F/{lens.image_f_number():.3g} at the image",
        **distance,
        "Imager": f"{imager.width_px} × {imager.height_px} px of {imager.pitch_mm * 1e3:.4g} µm",
        "Camera orientation": mount.camera_looks
        + (", image flipped" if mount.image_flipped else ""),
    }
    return card(
        sensor.name,
        "mirror sensor",
        drawing,
        {**field, **parts, **_misalignment(sensor)},
        origin(
            getattr(sensor, "notes", ""), len(sensor.uncertainty.names) if sensor.uncertainty else 0
        ),
    )


def _section(sensor: Sensor) -> Iterator[Line]:
    """Yield mirrors, lens and chief rays in the meridional plane, vertical direction up."""
    is_level = abs(sensor.axis[2]) < np.sqrt(0.5)
    sign = 1.0 if is_level or sensor.axis[2] < 0 else -1.0

    def line(x: Array, z: Array, style: str) -> Line:
        return Line(sign * z, x, style) if is_level else Line(x, sign * z, style)

    meridian, second, rim = sensor.meridian, sensor.secondary, sensor.mirror.rim_radius_mm
    x = np.linspace(-rim, rim, PROFILE_POINTS)
    yield line(x, sensor.mirror.sag(np.abs(x)), "strong")
    lens = -meridian.m if np.isfinite(meridian.m) else -TELECENTRIC_LENS_RADII * rim
    if second is not None:
        wide = np.linspace(
            -second.mirror.rim_radius_mm, second.mirror.rim_radius_mm, PROFILE_POINTS
        )
        yield line(wide, second.height(np.abs(wide)), "strong")
        lens = second.lens_height(meridian.m) if np.isfinite(meridian.m) else rim
    rays = meridian.trace(
        meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, CHIEF_RAYS))
    )
    first = rays.first.x
    end = first if sensor.lens.TELECENTRIC else np.zeros_like(first)
    half = float(end.max()) or 0.12 * rim
    yield line(np.array([-half, half]), np.full(2, lens), "plain")
    path = np.array([rays.x + OBJECT_RAY_RADII * rim * np.sin(rays.omega), rays.x, end])
    heights = np.array(
        [rays.z - OBJECT_RAY_RADII * rim * np.cos(rays.omega), rays.z, np.full_like(end, lens)]
    )
    if second is not None:
        path, heights = (
            np.insert(path, 2, first, axis=0),
            np.insert(heights, 2, second.height(first), axis=0),
        )
    for k in range(CHIEF_RAYS):
        for side in (-1, 1):
            yield line(side * path[:, k], heights[:, k], "fine")


def _field_properties(sensor: Sensor) -> dict[str, str]:
    """Return field, image size, resolution and obscuration."""
    meridian = sensor.meridian
    rays = meridian.trace(
        meridian.x_from_omega(np.linspace(meridian.omega_min, meridian.omega_max, PROFILE_POINTS))
    )
    rate = np.abs(sensor.image_height_rate_px(rays)) * np.pi / 180
    rate = rate[np.isfinite(rate)]
    properties = {
        "Field": field_range(meridian.omega_min, meridian.omega_max),
        "Image of the rim": f"{sensor.rim_radius_px:.4g} px radius",
        "Resolution": f"{rate.min():.3g} to {rate.max():.3g} px/° radial",
    }
    return (
        {**properties, "Obscuration": f"{sensor.obscured_percent:.3g} % of the image"}
        if sensor.obscured
        else properties
    )


def _secondary(sensor: Sensor) -> str:
    return f", with secondary ({sensor.secondary.mirror.KIND})" if sensor.secondary else ""


def _misalignment(sensor: Sensor) -> dict[str, str]:
    """Describe the misalignment of a sensor; the drawing is aligned."""
    if sensor.is_axial:
        return {}
    pose = sensor.mirror_pose
    if pose.is_axial:
        return {"Misaligned": "cover, imager or form of the mirror"}
    shift, tilt = (pose.decentre_x_mm, pose.decentre_y_mm), (pose.tilt_x_deg, pose.tilt_y_deg)
    return {
        "Misaligned": "mirror decentred by {:g} and {:g} mm, tilted by {:g} and {:g}°".format(
            *shift, *tilt
        )
    }


def _focal(lens: Lens) -> str:
    return f"{lens.focal_length_mm:.4g} mm, " if isinstance(lens, GaussianLens) else ""
