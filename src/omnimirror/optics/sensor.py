"""The mirror sensor: mirror + lens + imager + mount + housing, a Camera."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..base.arguments import finite, instance, numbers, places, shown, vectors
from ..base.errors import InvalidParameter, NotOneToOne, OmnimirrorError
from ..base.numerics.lazy import cached_property
from ..base.parameters import Uncertainty
from ..cameras.camera import AxialSymmetry, Projection, Rays, inside_image
from ..cameras.frames import Mount, turned
from .housing import Housing
from .image_sensor import ImagePlane, Imager, ImagerPose
from .lenses import GaussianLens, Lens, Perspective
from .mirrors import Mirror, Secondary
from .mirrors.form import MirrorForm
from .mirrors.pose import MirrorPose
from .thermal import Thermal
from .tracing.covers import Cover
from .tracing.meridian import ROUNDING, ChiefRays, Meridian
from .tracing.obscuration import (
    HiddenPart,
    Obscuration,
    Obstructions,
    clear_field_deg,
    cover_of,
    hidden_parts,
    obscured_rings,
)
from .tracing.optical_train import OpticalTrain
from .tracing.reflection import Ends
from .tracing.two_mirrors import TwoMirrorMeridian

Array = NDArray[np.float64]

FARTHEST_PUPIL = 1e3  # radii of the aperture
OF_THE_MIRROR = ("meridian", "_hidden", "_hidden_merged")  # what a lens of the same pupil does not change
Need = Literal["one mirror", "thin lens", "square imager", "ideal but for poses"]


@dataclass(frozen=True)
class Sensor:
    """A curved mirror of revolution seen by an ordinary camera, on its axis or nearly so.

    Parameters
    ----------
    mirror, lens, imager, mount
        Its parts.
    mirror_distance_mm : mm
        Distance m from the lens's reference point (its principal point; the entrance pupil stands where the lens
        says) to the mirror vertex; infinite (and left out of files) under an orthographic lens, where it does not
        matter. With a secondary, the length of the
        way by it.
    name, notes
        For people.
    mirror_pose
        Where the mirror really sits, decentred, displaced or tilted against lens and imager; perfectly
        mounted by default. The world's origin stays where the vertex was meant to be.
    mirror_form
        What the mirror has beside its meridian: a form error over its disk; none by default.
    imager_pose
        How the imager leans and is turned against the lens; square to it by default.
    secondary
        A second mirror, in which the lens sees the first: flat, to fold the sensor, or curved.
    housing
        What stands around the mirror; nothing by default.
    uncertainty
        How well a calibration knows it; None of a design.
    thermal
        How temperature moves it; None if nothing is known of that.

    Raises
    ------
    InvalidParameter
        If a perspective lens has no finite mirror distance. Whether the mirror can be used at all
        (one-to-one mapping, no self-obstruction) is proven at the first question.

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
    housing: Housing = field(default_factory=Housing)
    uncertainty: Uncertainty | None = None
    thermal: Thermal | None = None
    mirror_form: MirrorForm = field(default_factory=MirrorForm)
    imager_pose: ImagerPose = field(default_factory=ImagerPose)

    def __post_init__(self) -> None:
        for name, kind in (("mirror", Mirror), ("lens", Lens), ("imager", Imager)):
            instance(name, getattr(self, name), kind, f"one of omnimirror's {name}s")
        instance("housing", self.housing, Housing, "a Housing of omnimirror.optics.housing")
        if numbers("mirror_distance_mm", self.mirror_distance_mm, "(it takes one)").ndim:
            raise InvalidParameter(f"mirror_distance_mm = {shown(self.mirror_distance_mm)} is not one number")
        if self.lens.TELECENTRIC:
            object.__setattr__(self, "mirror_distance_mm", np.inf)
        elif not (np.isfinite(self.mirror_distance_mm) and self.mirror_distance_mm > 0):
            raise InvalidParameter(
                f"mirror_distance_mm = {self.mirror_distance_mm:g} does not say where the mirror stands; a "
                f"{self.lens.KIND} lens needs a finite distance above 0 from its principal point to the mirror vertex"
            )
        if self.secondary is not None and self.mirror_pose != MirrorPose():
            raise InvalidParameter(
                "mirror_pose is not valid beside a secondary: two mirrors are traced on one axis; leave one of them out"
            )
        if self.secondary is not None and not self.mirror_form.is_empty:
            raise InvalidParameter("mirror_form is not valid beside a secondary; leave one of them out")
        if not self.imager_pose.is_square and (self.lens.TELECENTRIC or not self.lens.IS_THIN):
            raise InvalidParameter(
                f"imager_pose leans, which is valid behind a perspective lens; behind a {self.lens.KIND} one the "
                "place of the exit pupil, about which pictures stretch, is not known: leave its tilts out"
            )

    # -- in the meridian -----------------------------------------------------------------------

    @cached_property
    def meridian(self) -> Meridian:
        """Its chief rays, field and inversions, of a mirror on the lens's axis.

        Raises
        ------
        InvalidParameter
            If the mirror is decentred or tilted: what holds in one meridian then holds in none.
        """
        if not self.is_axial:
            raise InvalidParameter(
                f"{self._out_of_axis} of {self.name!r} is decentred or tilted, and field angles from axis to rim "
                "belong to an aligned one: take sensor.aligned(), which leaves its pose out, or what traces in space "
                "(evaluation by om.evaluate_camera of its om.SensorModel, rays, pictures, spots, MTF)"
            )
        m = self.mirror_distance_mm + self.mirror_pose.displacement_mm
        if self.secondary is None:
            return Meridian(self.mirror, m, self.lens.pupil, cover=self._cover)
        return TwoMirrorMeridian(self.mirror, m, self.lens.pupil, cover=self._cover, secondary=self.secondary)

    @property
    def _cover(self) -> Cover | None:
        """The tube or the dome that the light passes, in the frame of the mirror."""
        cover = cover_of(self.obstructions) if self.housing.shell is not None else None
        return None if cover is None else cover.moved(self.mirror_pose.displacement_mm)

    def with_lens(self, lens: Lens) -> Sensor:
        """The same sensor with another lens at the same place; what its mirrors do is not worked out anew.

        Parameters
        ----------
        lens
            In place of its own.

        Returns
        -------
        Sensor
            The same but for the lens.
        """
        other = replace(self, lens=lens)
        if lens.pupil == self.lens.pupil:
            other.__dict__.update((name, self.__dict__[name]) for name in OF_THE_MIRROR if name in self.__dict__)
        return other

    @property
    def is_axial(self) -> bool:
        """Whether mirror, lens, imager and cover share one axis, and the mirror is round about it."""
        return self._out_of_axis is None

    @property
    def _out_of_axis(self) -> str | None:
        """What is not on the axis, as a sentence begins; None where all is."""
        shell = self.housing.shell
        parts = {
            "the mirror": self.mirror_pose.is_axial,
            "the cover": shell is None or shell.is_axial,
            "the form error of the mirror": self.mirror_form.is_empty,
            "the imager": self.imager_pose == ImagerPose(),
        }
        return next((name for name, is_axial in parts.items() if not is_axial), None)

    @property
    def is_ideal_but_for_pose(self) -> bool:
        """Whether nothing but the pose of its mirror and cover is out of order: no form error, no leaning imager."""
        return self.mirror_form.is_empty and self.imager_pose == ImagerPose()

    def check(self, what: str, *needs: Need) -> None:
        """Refuse a sensor of which something does not know.

        Parameters
        ----------
        what
            What cannot be done otherwise, for the message.
        needs
            ``"one mirror"``; ``"thin lens"``: not known by its table or surfaces; ``"square imager"``: none that leans;
            ``"ideal but for poses"``: neither form error nor imager out of place.

        Raises
        ------
        InvalidParameter
            It has what is not known of; the message says what is valid for it all the same.
        """
        lens, leans = self.lens, self.imager_pose
        refusals: dict[Need, tuple[bool, str]] = {
            "one mirror": (
                self.secondary is None,
                f"sensors of one mirror, and the lens of {self.name!r} sees its mirror in a second one; evaluation, "
                "spots, pictures and straightening are valid for both, and the sensor without its secondary",
            ),
            "thin lens": (
                lens.IS_THIN,
                f"perspective and orthographic lenses, and that of {self.name!r} is known by its {lens.KIND}; "
                "evaluation, focus, spots, illumination, pictures and straightening are valid for it, and the sensor "
                "with a perspective lens of its focal length and entrance pupil",
            ),
            "square imager": (
                leans.is_square,
                f"imagers square to the axis, and that of {self.name!r} leans by {leans.tilt_x_deg:g} and "
                f"{leans.tilt_y_deg:g} deg; pictures and tolerances are valid for it",
            ),
            "ideal but for poses": (
                self.is_ideal_but_for_pose,
                f"sensors without [mirror_form] and [imager_pose], and {self.name!r} has one; rays, pictures and "
                "straightening are valid for it, and what is asked here of sensor.aligned()",
            ),
        }
        for is_met, sentence in (refusals[need] for need in needs):
            if not is_met:
                raise InvalidParameter(f"{what} is for {sentence}")

    def _repr_html_(self) -> str:
        """A card of it, as notebooks ask for it."""
        from .notebook_card import sensor_card  # for notebooks only

        return sensor_card(self)

    def aligned(self) -> Sensor:
        """The same sensor with its mirror, its tube or dome and its imager perfectly made and mounted.

        Returns
        -------
        Sensor
            With its mirror in place.
        """
        shell = self.housing.shell
        housing = self.housing if shell is None else replace(self.housing, shell=shell.centred())
        return replace(
            self, mirror_pose=MirrorPose(), housing=housing, mirror_form=MirrorForm(), imager_pose=ImagerPose()
        )

    @property
    def field_deg(self) -> tuple[float, float]:
        """Smallest and largest field angle Omega, degrees from the direction back past the lens."""
        return float(np.degrees(self.meridian.omega_min)), float(np.degrees(self.meridian.omega_max))

    def image_height_px(self, rays: ChiefRays) -> Array:
        """Image height h of chief rays, px (Eq. 7).

        Parameters
        ----------
        rays
            Chief rays (n,) of the meridian.

        Returns
        -------
        (n,) array
            px

        Raises
        ------
        InvalidParameter
            For what are no chief rays.
        """
        rays = instance("rays", rays, ChiefRays, "chief rays of a meridian")
        return self.lens.image_height(rays.first.x, rays.first.w) / self.imager.pitch_mm

    def image_height_rate_px(self, rays: ChiefRays) -> Array:
        """dh/dOmega of chief rays, px per radian (Eq. 8); infinite at a point where a mapping starts square.

        Parameters
        ----------
        rays
            Chief rays (n,) of the meridian.

        Returns
        -------
        (n,) array
            px per radian of the field angle.

        Raises
        ------
        InvalidParameter
            For what are no chief rays.
        """
        first = instance("rays", rays, ChiefRays, "chief rays of a meridian").first
        rate = self.lens.image_height_rate(first.x, first.w, first.slope, first.drift) * rays.dfirst_dx()
        with np.errstate(divide="ignore"):
            return rate / rays.domega_dx() / self.imager.pitch_mm

    def x_from_height_px(self, h_px: ArrayLike) -> Array:
        """Mirror point (mm) of image heights (n,) in px; OutsideField beyond the rim's image.

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
            Heights that are no numbers.
        OutsideField
            A height that the rim's image does not reach.
        """
        h_mm = self.lens.undistorted_height(numbers("h_px", h_px) * self.imager.pitch_mm)
        return self._x_from_ideal_mm(h_mm)

    def _x_from_ideal_mm(self, h_mm: Array) -> Array:
        """Mirror point (mm) of image heights (n,) mm without distortion."""
        if isinstance(self.lens, GaussianLens):
            return self.meridian.x_from_tan_theta(h_mm / self.lens.principal_distance)
        unit = self.lens.ideal_height(np.ones(1), np.full(1, np.inf))[0]
        return self.meridian.x_from_first(h_mm / unit)

    def radius_from_centre_px(self, pixels: Array) -> Array:
        """Image heights (n,) of pixels (n, 2), px; what a lens's tangential distortion adds is taken away.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        (n,) array
            px

        Raises
        ------
        InvalidParameter
            Pixels of another shape.
        """
        image, _ = self.image_plane.flat_mm(vectors("pixels", pixels, 2))
        if self.lens.is_symmetric:
            return np.hypot(image[..., 0], image[..., 1]) / self.imager.pitch_mm
        ideal = self.lens.undistorted(image)
        return self.lens.distorted_height(np.hypot(ideal[..., 0], ideal[..., 1])) / self.imager.pitch_mm

    @property
    def rim_radius_px(self) -> float:
        """Radius of the image of the rim, px."""
        return float(self.lens.distorted_height(np.array(self._edges_mm[1])) / self.imager.pitch_mm)

    @cached_property
    def _edges_mm(self) -> tuple[float, float]:
        """Image heights of the field's ends without distortion; the first is 0 unless something hides the middle."""
        first = self.meridian.trace(np.array([self.meridian.x_min, self.mirror.rim_radius_mm])).first
        inner, outer = self.lens.ideal_height(first.x, first.w)
        self.lens.distorted_height(np.array([outer]))  # proves that distortion does not fold the picture over
        return float(inner), float(outer)

    # -- what is hidden ------------------------------------------------------------------------

    @cached_property
    def obstructions(self) -> Obstructions:
        """The housing with its sizes, fitted to the sensor as designed.

        Raises
        ------
        InvalidParameter
            The housing does not fit: the error says what would.
        """
        return Obstructions.of(self.housing, self.mirror, self.secondary, self.mirror_distance_mm)

    @cached_property
    def obscurations(self) -> tuple[Obscuration, ...]:
        """Rings of field angle that the parts of the housing, and two mirrors, hide at every azimuth; they may overlap.

        Raises
        ------
        InvalidParameter
            If the mirror is decentred or tilted: :meth:`hidden_by` says what is hidden of single pixels.
        """
        if self.housing.is_empty and self.secondary is None:
            return ()
        return obscured_rings(self.meridian, self._hidden, self._image_share)

    @cached_property
    def _hidden(self) -> tuple[HiddenPart, ...]:
        return self._in_the_way(merged=False)

    @cached_property
    def _hidden_merged(self) -> tuple[HiddenPart, ...]:
        return self._in_the_way(merged=True)

    @cached_property
    def obscured(self) -> tuple[Obscuration, ...]:
        """The same rings, those that overlap as one; their shares of the picture add up."""
        rings = tuple(sorted(self.obscurations, key=lambda ring: ring.omega_deg))
        apart = all(one.omega_deg[1] < other.omega_deg[0] for one, other in pairwise(rings))
        return rings if apart else obscured_rings(self.meridian, self._hidden_merged, self._image_share)

    @property
    def clear_field_deg(self) -> tuple[float, float]:
        """The field less what is hidden at its ends, degrees; both are the same angle where all is hidden."""
        return clear_field_deg(self.field_deg, self.obscured)

    @property
    def hidden_to_deg(self) -> float:
        """Field angle, degrees, up to which the middle of the view is hidden; where the field begins, if nothing is."""
        return self.clear_field_deg[0]

    @property
    def hidden_percent(self) -> float:
        """Share of the image circle's area in which the view is hidden."""
        return sum(ring.picture_percent for ring in self.obscured)

    def hidden_by(self, pixels: ArrayLike) -> dict[str, NDArray[np.bool_]]:
        """Return which pixels (n, 2) each part of the sensor hides: their chief rays, traced in space, end at it.

        Parts are those of the housing and, of two mirrors, the secondary, the bore and the camera. Pixels that look
        past the mirror are False everywhere.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).

        Returns
        -------
        dict of (n,) arrays
            By the name of each part, True where it hides.

        Raises
        ------
        InvalidParameter
            Pixels of another shape, or two mirrors in a tube, whose :attr:`obscurations` are known.

        Examples
        --------
        >>> import omnimirror as om
        >>> from omnimirror.optics.housing import CameraBody, Housing
        >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0)))
        >>> sensor.hidden_by([[511.5, 511.5], [900.0, 511.5]])
        {'camera': array([ True, False])}
        """
        pixels = vectors("pixels", pixels, 2)
        start, towards = self.lens_rays(pixels.reshape(-1, 2), np.zeros(2))
        found, edges = self.optical_train.obstructed(start, towards)
        shape = pixels.shape[:-1]
        return {part: (found.valid & (edge < 0)).reshape(shape) for part, edge in edges.items()}

    def _in_the_way(self, merged: bool) -> tuple[HiddenPart, ...]:
        return hidden_parts(self.meridian, self.obstructions, self.mirror_pose.displacement_mm, merged=merged)

    def _image_share(self, rays: ChiefRays) -> Array:
        """Share (n,) of the image circle's area within chief rays."""
        share: Array = (self.image_height_px(rays) / self.rim_radius_px) ** 2
        return share

    # -- as a camera ---------------------------------------------------------------------------

    @property
    def image_size(self) -> tuple[int, int]:
        """(width, height) in pixels."""
        return self.imager.size

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """The mirror axis, about which the sensor is symmetric; None for a decentred or tilted mirror or lens."""
        if not (self.is_axial and self.lens.is_symmetric):
            return None

        def rays(omega: Array) -> ChiefRays:
            return self.meridian.trace(self.meridian.x_from_omega(omega))

        def radius_px(omega: Array) -> Array:
            return self.image_height_px(rays(omega))

        def origin_mm(omega: Array) -> tuple[Array, Array]:
            x, z = rays(omega).start
            return x, -z - self.mirror_pose.displacement_mm

        u, v = self.imager.centre
        centre = (self.imager.width_px - 1 - u, v) if self.mount.image_flipped else (u, v)
        x, y, z = self._axes.T
        right = -x if self.mount.image_flipped else x
        angles = self.meridian.omega_min, self.meridian.omega_max
        return AxialSymmetry(centre, -z, right, y, *angles, radius_px, origin_mm)

    @property
    def axis(self) -> Array:
        """World direction (3,) from the mirror back to what sees it, the direction of field angle 0."""
        return -self._axes[:, 2]

    @property
    def is_picture_reversed(self) -> bool:
        """Whether the raw picture is a mirror image: text runs backwards and markers go undetected.

        A second reflection puts right what the first has reversed.
        """
        return (self.secondary is None) != self.mount.image_flipped

    @property
    def _axes(self) -> Array:
        """World directions (3, 3), in columns, of image right, image down and from the lens's side to the mirror.

        A lens that sees the mirror in a second one looks the other way.
        """
        axes: Array = self.mount.rotation() * np.array([1.0, 1.0, 1.0 if self.secondary is None else -1.0])
        return axes

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) px into the world: from their mirror points (mm) to the object, or from the cover.

        Pixels outside the image of the rim or outside the picture are not valid and NaN.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and where they are valid (n,).

        Raises
        ------
        InvalidParameter
            Pixels of another shape.
        NotOneToOne
            A mapping that has no inverse, whether or not the sensor is aligned.
        """
        pixels = vectors("pixels", pixels, 2)
        if not self.is_axial:
            self._check_one_to_one()
            return self.aperture_rays(pixels, np.zeros(2))
        image, _ = self.image_plane.flat_mm(pixels)
        radius, cos, sin = _unit(*np.moveaxis(self.lens.undistorted(image), -1, 0))
        inner, outer = self._edges_mm
        valid = inside_image(pixels, self.image_size)
        with np.errstate(invalid="ignore"):  # a lens that distorts sends nothing to some pixels
            valid &= (radius >= inner * (1 - ROUNDING)) & (radius <= outer * (1 + ROUNDING))
        origins, directions = np.full((2, *radius.shape, 3), np.nan)
        rays = self.meridian.trace(self._x_from_ideal_mm(np.clip(radius[valid], inner, outer)))
        cos, sin = cos[valid], sin[valid]
        s, (x, z) = np.sin(rays.omega), rays.last
        z = z + self.mirror_pose.displacement_mm
        rotation = self._axes.T
        origins[valid] = turned(np.stack([x * cos, x * sin, z], axis=-1), rotation)
        directions[valid] = turned(np.stack([s * cos, s * sin, -np.cos(rays.omega)], axis=-1), rotation)
        return Rays(origins, directions, valid)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points (n, 3) in mm, by the true reflection of each (no single viewpoint is assumed).

        Parameters
        ----------
        points_mm : (n, 3)
            Points of the world, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).

        Raises
        ------
        InvalidParameter
            Points of another shape.
        """
        points = turned(vectors("points_mm", points_mm, 3), self._axes)
        if not self.is_axial:
            return self._project_in_space(points, distant=False)
        x, y, z = np.moveaxis(points, -1, 0)
        distance, cos, sin = _unit(x, y)
        return self._image(self.meridian.x_from_point(distance, z - self.mirror_pose.displacement_mm), cos, sin)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of infinitely distant points in directions (n, 3) of any length but 0.

        Parameters
        ----------
        directions : (n, 3)
            World directions, of any length.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).

        Raises
        ------
        InvalidParameter
            Directions of another shape.
        """
        towards = turned(vectors("directions", directions, 3), self._axes)
        if not self.is_axial:
            return self._project_in_space(towards, distant=True)
        x, y, z = np.moveaxis(towards, -1, 0)
        distance, cos, sin = _unit(x, y)
        omega = np.arctan2(distance, -z)
        seen = self.meridian.sees(omega) & (distance + np.abs(z) > 0)
        x_mirror = np.full_like(omega, np.nan)
        x_mirror[seen] = self.meridian.x_from_omega(omega[seen])
        return self._image(x_mirror, cos, sin)

    def _image(self, x_mirror: Array, cos: Array, sin: Array) -> Projection:
        """Pixels of mirror points (n,) at azimuths; NaN in, not valid out."""
        image = np.full((*x_mirror.shape, 2), np.nan)
        seen = np.isfinite(x_mirror)
        first = self.meridian.trace(x_mirror[seen]).first
        radius = self.lens.ideal_height(first.x, first.w)
        ideal = np.stack([radius * cos[seen], radius * sin[seen]], axis=-1)
        image[seen] = self.lens.distorted(ideal)
        return self._in_picture(image)

    # -- in space ------------------------------------------------------------------------------

    @cached_property
    def optical_train(self) -> OpticalTrain:
        """Its mirrors and lens where they stand, as rays in space meet them.

        Raises
        ------
        InvalidParameter
            For two mirrors in a tube.
        """
        if self.housing.shell is not None:
            self.check("tracing in space through a tube or a dome", "one mirror")
        return OpticalTrain(
            self.mirror,
            self.lens,
            self.mirror_distance_mm,
            self.mirror_pose,
            self.mirror_form,
            self.secondary,
            None if self.housing.is_empty else self.obstructions,
        )

    @property
    def image_plane(self) -> ImagePlane:
        """Its pixels as places behind the lens, and back."""
        distance = self.lens.principal_distance if isinstance(self.lens, Perspective) else np.inf
        return ImagePlane(self.imager, self.imager_pose, self.mount.image_flipped, distance)

    def lens_rays(self, pixels: ArrayLike, pupil: ArrayLike) -> tuple[Array, Array]:
        """Origins and directions (n, 3) of rays from pixels (n, 2) through aperture points (n, 2) to the mirror.

        In the camera frame; the lens is thin and ideal but for its distortion, and its aperture the unit disk.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).
        pupil : (n, 2)
            Points of the entrance pupil, in its radii.

        Returns
        -------
        tuple of (n, 3) arrays
            Origins in mm and unit directions, in the camera's frame.

        Raises
        ------
        InvalidParameter
            Pixels, or points of the pupil, of another shape.
        """
        pixels, pupil = vectors("pixels", pixels, 2), places("pupil", pupil)
        _check_pupil(pupil, pixels)
        flat, depth = self.image_plane.flat_mm(pixels)
        origins, directions = self.optical_train.rays_of_image(flat, pupil)
        if not self.imager_pose.is_square:  # each pixel is in focus at its own distance
            assert isinstance(self.lens, Perspective)
            lens = self.lens
            behind, f = lens.image_distance + depth, lens.focal_length_mm
            vergence = 1 / (f * behind / (behind - f) - lens.pupil.at_mm)
            directions = directions.copy()
            directions[..., :2] += origins[..., :2] * (1 / lens.from_pupil - vergence)[..., None]
        return origins, directions

    def aperture_rays(self, pixels: ArrayLike, pupil: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) through points (n, 2), or one, of the unit disk of the aperture, into the world.

        Traced in space from the imager outwards: an ideal thin lens sends a pixel through every point of
        its aperture to one point of the plane in focus; on the way the mirror reflects them. The aperture
        point (0, 0) is the chief ray of :meth:`backproject`.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v).
        pupil : (n, 2)
            Points of the entrance pupil, in its radii.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and where they are valid (n,).

        Raises
        ------
        InvalidParameter
            Pixels, or points of the pupil, of another shape.

        Examples
        --------
        How far apart a pixel looks through both edges of the aperture is its blur in angle:

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
        pupil = finite("pupil", pupil, -FARTHEST_PUPIL, FARTHEST_PUPIL, last=2) if flat.size else flat
        _check_pupil(pupil, pixels)
        pupil = np.broadcast_to(pupil, pixels.shape).reshape(-1, 2)
        valid = inside_image(flat, self.image_size)
        origins, directions = np.full((2, *flat.shape[:-1], 3), np.nan)
        start, towards = self.lens_rays(flat[valid], pupil[valid])
        found = self.optical_train.seen_mirror.trace(start, towards)
        passes = found.valid & (self.optical_train.passes_lens(start, towards) if pupil.any() else True)
        rotation = self._axes.T
        origins[valid] = turned(found.points, rotation)
        directions[valid] = turned(found.directions, rotation)
        valid[valid] = passes
        shape = pixels.shape[:-1]
        return Rays(origins.reshape(*shape, 3), directions.reshape(*shape, 3), valid.reshape(shape))

    def _project_in_space(self, targets: Array, distant: bool) -> Projection:
        """Return the pixels of points or directions (n, 3) of the camera frame."""
        self._check_one_to_one()
        image = self.optical_train.image_of(Ends.of(targets.reshape(-1, 3), distant))
        return self._in_picture(image.reshape(*targets.shape[:-1], 2))

    def _check_one_to_one(self) -> None:
        """Raise NotOneToOne for a misaligned sensor whose mapping is not one-to-one when it is aligned.

        Such a sensor, for example a cone under a telecentric lens, has no inverse mapping: a tilt, however small, does
        not make it a camera.
        """
        _ = self._is_one_to_one

    @cached_property
    def _is_one_to_one(self) -> bool:
        try:
            return self.aligned().meridian.omega_max > 0
        except NotOneToOne:
            raise
        except OmnimirrorError:  # aligned, it would not be a sensor for another reason, which does not concern this one
            return True

    def _in_picture(self, image_mm: Array) -> Projection:
        """Pixels of places (n, 2) mm on a square imager; NaN, or outside, is not valid."""
        pixels = self.image_plane.pixels(image_mm)
        valid = inside_image(pixels, self.image_size)
        pixels[~valid] = np.nan
        return Projection(pixels, valid)


def _unit(x: Array, y: Array) -> tuple[Array, Array, Array]:
    """Length, cosine and sine of vectors (x, y); the zero vector points along x."""
    length = np.hypot(x, y)
    safe = np.where(length > 0, length, 1.0)
    return length, np.where(length > 0, x / safe, 1.0), y / safe


def _check_pupil(pupil: Array, pixels: Array) -> None:
    if pupil.shape not in (pixels.shape, (2,)):
        raise InvalidParameter(f"pupil has shape {pupil.shape}; it is valid as {pixels.shape}, or as one point")


def check_sensor(value: Any, name: str = "sensor") -> None:
    """Refuse what is no sensor: a name alone, for one."""
    instance(name, value, Sensor, "a sensor, such as om.load_sensor gives")
