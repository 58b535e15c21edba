"""The mirror sensor itself as a camera model: parameters of mirror, lens and mounting, some of them free."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal, Self, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import vectors
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...base.parameters import Uncertainty
from ...cameras.camera import AxialSymmetry, Projection, Rays
from ...cameras.frames import Mount
from ...cameras.models.base import CameraModel, Image, ModelParameter
from ...optics.sensor import Sensor, check_sensor
from .covered_image import image_through_cover
from .imaging import image_of_points
from .names import NamedNumber, changed, place_of, value_of
from .starting import RIM_TO_DISTANCE, fitted, radial_law, shaped_like, unknown_sensor
from .tolerances import USUAL, ParameterPrior, checked_priors, free_names, group_names, guessed_priors, usual_priors

Array = NDArray[np.float64]

PROBES = 96
"""Points over which the size of a parameter's effect is taken."""
PROBED = 10.0
"""Their distance, in rim radii: there is no parameter that does nothing to near points."""


@dataclass(frozen=True)
class SensorModel(CameraModel):
    """A sensor whose chosen parameters are free to be estimated, and everything else as designed.

    It is no approximation: every point, near or far, is seen in its own mirror point, wherever the mirror sits.

    Parameters
    ----------
    sensor
        As designed, or as estimated so far.
    free
        Names of parameters as the sensor file has them (``"lens.focal_length_mm"``, ``"mirror.coefficients[0]"``), or
        groups of them: ``"shape"`` of the mirror, ``"focal"`` length, ``"centre"`` of the picture, ``"distortion"``
        of the lens, ``"distance"`` of the mirror, its ``"decentre"`` and ``"tilt"``. By default what was estimated of a
        calibrated sensor; of any other focal length, distance, decentre and tilt.
    priors
        What is known of free parameters from the drawing: name, value, standard deviation. By default the tolerances
        of an ordinary workshop for those that pictures hardly tell apart.

    Raises
    ------
    InvalidParameter
        A name that the sensor does not have, a prior on what is not free, or a sensor of two mirrors.

    Examples
    --------
    >>> import omnimirror as om
    >>> model = om.SensorModel(om.load_sensor("paper-spherical"), free=("focal", "decentre"))
    >>> [p.name for p in model.parameters]
    ['lens.focal_length_mm', 'mirror_pose.decentre_x_mm', 'mirror_pose.decentre_y_mm']
    >>> image = model.image([[1000.0, 0.0, 0.0]])  # 1 m to the right of the mirror's vertex
    >>> image.pixels.round(2), image.d_parameters[0, 0].round(1)  # by mm of focal length and of decentring
    (array([[905.38, 511.5 ]]), array([35.9, 11.4,  0. ]))
    """

    sensor: Sensor
    free: tuple[str, ...] = None  # type: ignore[assignment]  # None only until they are chosen
    priors: tuple[ParameterPrior, ...] = None  # type: ignore[assignment]  # None only until they are made

    KIND: ClassVar[str] = "sensor"

    def __post_init__(self) -> None:
        check_sensor(self.sensor)
        self.sensor.check("a model with free parameters", "one mirror", "thin lens", "ideal but for poses")
        if self.sensor.housing.shell is not None:  # it stays as it is while the sensor's numbers change
            object.__setattr__(self, "sensor", replace(self.sensor, housing=self.sensor.obstructions.housing))
        known, asked = self.sensor.uncertainty, cast("tuple[str, ...] | None", self.free)
        free = asked if asked is not None else USUAL if known is None else known.names
        object.__setattr__(self, "free", free_names(self.sensor, free))
        given: tuple[ParameterPrior, ...] | None = self.priors
        priors = usual_priors(self.sensor, self.free) if given is None else checked_priors(self.free, given)
        object.__setattr__(self, "priors", priors)

    # -- as a model -----------------------------------------------------------------------------

    @property
    def optics(self) -> Literal["mirror"]:  # type: ignore[override]  # a field of other models
        """``"mirror"``: the centre of the picture looks back past the lens."""
        return "mirror"

    @cached_property
    def parameters(self) -> tuple[ModelParameter, ...]:
        """The free parameters: name, value, unit, and the change that moves the picture by about a pixel."""
        return tuple(
            ModelParameter(place.name, value_of(self.sensor, place), unit, scale)
            for place, unit, scale in zip(self._places, self._units, self._scales, strict=True)
        )

    def with_parameters(self, values: ArrayLike) -> Self:
        """The same model with other values of its free parameters.

        Parameters
        ----------
        values : (n,)
            One for each parameter, in the units of :attr:`parameters`.

        Returns
        -------
        SensorModel
            With the same parameters free and the same priors.

        Raises
        ------
        InvalidParameter
            As many values as parameters are needed, and each in its range: one that no such part can have is refused.
        """
        wanted = np.asarray(values, dtype=float)
        if wanted.shape != (len(self.free),) or not np.isfinite(wanted).all():
            raise InvalidParameter(f"values has shape {wanted.shape}; it is valid as ({len(self.free)},), all finite")
        other = object.__new__(type(self))  # what is free, and its priors, have been checked
        other.__dict__["sensor"] = changed(self.sensor, self._places, wanted)
        for kept in ("free", "priors", "_places", "_scales"):  # the same for a whole estimation
            other.__dict__[kept] = getattr(self, kept)
        return other

    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> Image:
        """Image of points (n, 3) mm in the camera frame, whose origin is the vertex as designed.

        Parameters
        ----------
        points_mm : (n, 3)
            X right and Y down in the picture, Z from the lens to the mirror.
        distant
            Whether they are directions, of any length.

        Returns
        -------
        Image
            Pixels (n, 2), valid (n,), and derivatives (n, 2, 3) by the points and (n, 2, p) by the free parameters.
            Nothing is clipped at the edge of the picture; a little past its rim the mirror goes on smoothly.

        Raises
        ------
        InvalidParameter
            Points of another shape.
        """
        image_of = image_of_points if self.sensor.housing.shell is None else image_through_cover
        return image_of(self.sensor, vectors("points_mm", points_mm, 3, is_list=True), distant, self._places)

    @classmethod
    def start_from(
        cls,
        central: CameraModel,
        sensor: Sensor | None = None,
        *,
        free: Iterable[str] | None = None,
        priors: Iterable[ParameterPrior] | None = None,
        omega_max_deg: float = 170.0,
        rim_radius_mm: float = 40.0,
        distance_mm: float | None = None,
    ) -> Self:
        """A model of a sensor that shows distant things as a central model does: where an estimation can begin.

        What is known stays, a shape that is free becomes the one that turns the lens's rays as the central model has
        them, and the other free parameters follow by least squares within their tolerances. Boards that were placed
        for the central model have to be moved by :attr:`viewpoint_mm`.

        Parameters
        ----------
        central
            Estimated, of one viewpoint.
        sensor
            As designed; without one the mirror is a conic with four terms of which nothing is known but its size.
        free, priors
            As for the class; without a sensor the shape is free, too.
        omega_max_deg
            Up to which field angle the central model has seen anything.
        rim_radius_mm
            Size of the unknown mirror: in what it sees of near things alone does it differ from a larger one.
        distance_mm
            From it to the lens; four rim radii by default.

        Returns
        -------
        SensorModel
            To begin with.

        Examples
        --------
        >>> import omnimirror as om
        >>> ball = om.MirrorBall((319.5, 239.5), 230.0, 250.0, (640, 480))
        >>> model = om.SensorModel.start_from(ball)
        >>> both = [m.image([[3.0, 2.0, 0.5]], distant=True).pixels for m in (model, ball)]
        >>> bool(abs(both[1] - both[0]).max() < 0.1)
        True
        """
        law = radial_law(central, omega_max_deg)
        distance = RIM_TO_DISTANCE * rim_radius_mm if distance_mm is None else distance_mm
        known = unknown_sensor(central, law, rim_radius_mm, distance) if sensor is None else sensor
        words = tuple(free) if free is not None else USUAL if sensor is not None else ("shape", *USUAL, "centre")
        names = free_names(known, words)
        typical = guessed_priors if sensor is None else usual_priors
        tolerances = typical(known, names) if priors is None else tuple(priors)
        if set(group_names(known, "shape")) <= set(names):
            known = shaped_like(law, known, rim_is_known=sensor is not None)
        model = cls(known, names, tolerances)
        return fitted(model, central, model.priors, omega_max_deg)

    @property
    def viewpoint_mm(self) -> Array:
        """Where (3,) mm of the camera frame one viewpoint would have to be, that the sensor has not.

        The mean over what its pixels see. A pose found by a central model, whose viewpoint is its origin, becomes one
        of this model by adding this to the points.

        Examples
        --------
        >>> import omnimirror as om
        >>> om.SensorModel(om.load_sensor("paper-spherical")).viewpoint_mm.round(1)
        array([ 0. ,  0. , 12.8])
        """
        meridian = self.sensor.aligned().meridian
        x = np.sqrt(np.linspace(0.01, 1.0, PROBES)) * self.sensor.mirror.rim_radius_mm
        rays = meridian.trace(x[x >= meridian.x_min])
        return np.array([0.0, 0.0, float(np.median(rays.z + rays.viewpoint_offset()))])

    @cached_property
    def _places(self) -> tuple[NamedNumber, ...]:
        return tuple(place_of(self.sensor, name) for name in self.free)

    @property
    def _units(self) -> list[str]:
        parts: dict[str, Any] = {"mirror": self.sensor.mirror, "lens": self.sensor.lens, "imager": self.sensor.imager}
        parts["mirror_pose"] = self.sensor.mirror_pose
        return ["mm" if p.section == "mount" else parts[p.section].PARAMETERS[p.key].unit for p in self._places]

    @cached_property
    def _scales(self) -> tuple[float, ...]:
        turn = np.pi * (1 + np.sqrt(5)) * np.arange(PROBES)
        height = 2 * (np.arange(PROBES) + 0.5) / PROBES - 1
        across = np.sqrt(1 - height**2)
        sphere = np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=-1)
        image = self.image(PROBED * self.sensor.mirror.rim_radius_mm * sphere)
        moved = image.d_parameters[image.valid]
        if not len(moved):
            return (1.0,) * len(self.free)
        size = np.median(np.linalg.norm(moved, axis=1), axis=0)  # near the tip of a cone there is no end of it
        return tuple(float(s) for s in 1 / np.where(size > 0, size, 1.0))

    # -- as a camera ----------------------------------------------------------------------------

    @property
    def image_size(self) -> tuple[int, int]:  # type: ignore[override]
        """(width, height) in pixels."""
        return self.sensor.image_size

    @property
    def mount(self) -> Mount:  # type: ignore[override]
        """How it stands."""
        return self.sensor.mount

    @property
    def uncertainty(self) -> Uncertainty | None:  # type: ignore[override]
        """Covariance of the parameters that a calibration has estimated."""
        return self.sensor.uncertainty

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """The sensor's axis of symmetry, None if its mirror or lens has none."""
        return self.sensor.symmetry

    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) into the world, from their mirror points.

        Parameters
        ----------
        pixels : (n, 2)
            Pixels (u, v), integers at their centres.

        Returns
        -------
        Rays
            Origins (n, 3) in mm, unit directions (n, 3) and where they are valid (n,).
        """
        return self.sensor.backproject(pixels)

    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points of the world, clipped at rim and picture.

        Parameters
        ----------
        points_mm : (n, 3)
            Points of the world, mm.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).
        """
        return self.sensor.project(points_mm)

    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of directions of the world, clipped at rim and picture.

        Parameters
        ----------
        directions : (n, 3)
            World directions, of any length but 0.

        Returns
        -------
        Projection
            Pixels (n, 2) and where they are valid (n,).
        """
        return self.sensor.project_directions(directions)
