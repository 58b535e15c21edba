"""What every calibrated model says of itself: its parameters, and the image of points with its derivatives.

A model works in the camera frame (X right and Y down in the picture, Z ahead). ``optics`` alone says which way the
centre of the picture looks, back past the lens (a mirror) or ahead (a fisheye); the frame stays right-handed, and
nothing else is negated "because of the mirror".

The numbers of a calibration belong to the picture it was made with. So centres and radii are those of
the picture *as delivered*, and ``mount.image_flipped`` only says that this picture is reversed.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import choice, finite, shown
from ...base.errors import InvalidParameter
from ...base.parameters import Uncertainty
from ..camera import AxialSymmetry, Projection, Rays
from ..frames import Mount

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Optics = Literal["mirror", "fisheye"]

LARGEST_PICTURE_PX = 100_000


class ModelParameter(NamedTuple):
    """A number of a model, as an estimator needs it."""

    name: str
    value: float
    unit: str
    scale: float
    """Typical change, for conditioning."""


class Image(NamedTuple):
    """Where points appear, and how that changes; NaN where not valid."""

    pixels: Array
    """(n, 2) px, wherever they fall, the picture's edge or not."""
    valid: Mask
    """(n,) False where the model says nothing: past the end of its field, or at its viewpoint."""
    d_points: Array
    """(n, 2, 3) derivatives to the points, px/mm; to the components of a direction as it was given, if distant."""
    d_parameters: Array
    """(n, 2, p) derivatives to :attr:`CameraModel.parameters`, px per unit of each."""


class CameraModel(ABC):
    """A camera that can be calibrated: satisfies the Camera contract, and has parameters and derivatives."""

    KIND: ClassVar[str]
    """Its name in files and on the command line."""
    image_size: tuple[int, int]
    optics: Optics
    mount: Mount
    uncertainty: Uncertainty | None = None
    """Covariance of its parameters, where they were estimated."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[ModelParameter, ...]:
        """What an estimator may change, in the order of ``d_parameters``."""

    @abstractmethod
    def with_parameters(self, values: Sequence[float] | Array) -> Self:
        """The same model with other values (p,) of its parameters."""

    @abstractmethod
    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> Image:
        """Pixels of points (n, 3) in the camera frame, with derivatives; ``distant``: they are directions.

        Neither the picture's edge nor a rim clips it.
        """

    def image_to_the_end(self, points_mm: ArrayLike, *, distant: bool = False) -> Image:
        """The same, what lies past the end of the field shown at its end: so that an estimate can go on from there.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in mm, or directions, of the camera frame.
        distant
            They are directions.

        Returns
        -------
        Image
            Pixels (n, 2), where they are valid (n,), and derivatives (n, 2, 3) and (n, 2, p).

        Raises
        ------
        InvalidParameter
            For what are no vectors (n, 3).

        Examples
        --------
        >>> import omnimirror as om
        >>> camera = om.Unified(0.0, (100.0, 100.0), (319.5, 239.5), (640, 480), optics="fisheye")  # a pinhole
        >>> behind = [[0.0, 100.0, -50.0]]
        >>> camera.image(behind).valid[0], camera.image_to_the_end(behind).valid[0]
        (np.False_, np.True_)
        """
        return self.image(points_mm, distant=distant)

    def _repr_html_(self) -> str:
        """A card of it, as notebooks ask for it."""
        from ..notebook_card import camera_card  # for notebooks only

        return camera_card(self)

    # -- the Camera contract, in the world frame --------------------------------------------------

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """The axis of symmetry; None where there is none."""
        return None

    @abstractmethod
    def backproject(self, pixels: ArrayLike) -> Rays:
        """Rays of pixels (n, 2) px."""

    @abstractmethod
    def project(self, points_mm: ArrayLike) -> Projection:
        """Pixels of points (n, 3) of the world, mm."""

    @abstractmethod
    def project_directions(self, directions: ArrayLike) -> Projection:
        """Pixels of directions (n, 3) of the world, of any length but 0."""

    # -- which way it looks ------------------------------------------------------------------------

    @property
    def looks_back(self) -> bool:
        """Whether the centre of the picture looks back past the lens (-Z), as with a mirror."""
        return self.optics == "mirror"

    @property
    def axis(self) -> Array:
        """World direction (3,) that the centre of the picture sees."""
        forward = -1.0 if self.looks_back else 1.0
        return forward * self.mount.rotation()[:, 2]

    @property
    def is_picture_reversed(self) -> bool:
        """Whether the raw picture is a mirror image: text runs backwards and markers go undetected."""
        return self.looks_back != self.mount.image_flipped

    @property
    def _signs(self) -> Array:
        """Signs of (right, down, along the axis) in the picture as delivered, against the camera frame's X, Y, Z."""
        return np.array([-1.0 if self.mount.image_flipped else 1.0, 1.0, -1.0 if self.looks_back else 1.0])

    # -- checks that every model makes in its constructor ----------------------------------------

    def _check_camera(self) -> None:
        if finite("image_size", self.image_size).shape != (2,):
            raise InvalidParameter(f"image_size = {shown(self.image_size)} is no pair of numbers, (width, height)")
        for name, length in zip(("width", "height"), self.image_size, strict=True):
            if not (1 <= length <= LARGEST_PICTURE_PX and int(length) == length):
                raise InvalidParameter(
                    f"image {name} = {length} is not a whole number of pixels from 1 to {LARGEST_PICTURE_PX}"
                )
        choice("optics", self.optics, get_args(Optics))
