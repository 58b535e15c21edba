"""Base class of calibrated models: parameters, and images of points with derivatives.

A model uses the camera frame (X right and Y down in the image, Z ahead). ``optics`` defines the
direction of the image centre: backwards past the lens (a mirror) or forwards (a fisheye). The frame
is right-handed, and no other axis is negated "because of the mirror".

Calibrated parameters refer to the calibrated image: centres and radii are those of the image *as
delivered*, and ``mount.image_flipped`` only marks this image as mirrored.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal, NamedTuple, Self, get_args

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import choice, finite, shown
from ...base.errors import InvalidParameter
from ...base.parameters import Uncertainty
from ...base.typing import Array, Mask
from ..camera import AxialSymmetry, Projection, Rays
from ..frames import Mount

Optics = Literal["mirror", "fisheye"]

LARGEST_PICTURE_PX = 100_000


class ModelParameter(NamedTuple):
    """Model parameter with its scaling for estimation."""

    name: str
    value: float
    unit: str
    scale: float
    """Typical change, for conditioning."""


class Image(NamedTuple):
    """Image of points with derivatives; NaN if invalid."""

    pixels: Array
    """(n, 2), px, inside or outside the image."""
    valid: Mask
    """(n,) False beyond the end of the model's field, or at its viewpoint."""
    d_points: Array
    """(n, 2, 3) derivatives by the points, px/mm, or by the given directions, px."""
    d_parameters: Array
    """(n, 2, p) derivatives by :attr:`CameraModel.parameters`, px per unit of each."""


class CameraModel(ABC):
    """Camera that can be calibrated: Camera interface with parameters and derivatives."""

    KIND: ClassVar[str]
    """Name in files and on the command line."""
    image_size: tuple[int, int]
    optics: Optics
    mount: Mount
    uncertainty: Uncertainty | None = None
    """Covariance of the parameters, if estimated."""

    @property
    @abstractmethod
    def parameters(self) -> tuple[ModelParameter, ...]:
        """Adjustable parameters, in the order of ``d_parameters``."""

    @abstractmethod
    def with_parameters(self, values: Sequence[float] | Array) -> Self:
        """Return the model with other values (p,) of its parameters."""

    @abstractmethod
    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> Image:
        """Project points (n, 3) in the camera frame, with derivatives; ``distant``: directions.

        Image edges and rim are ignored.
        """

    def image_to_the_end(self, points_mm: ArrayLike, *, distant: bool = False) -> Image:
        """Project points, clamping points beyond the field to its end.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in mm, or directions, in the camera frame.
        distant
            True for directions.

        Returns
        -------
        Image
            Pixels (n, 2), validity (n,), and derivatives (n, 2, 3) and (n, 2, p).

        Raises
        ------
        InvalidParameter
            If the points do not have the shape (n, 3).

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
        """Return an HTML card for notebooks."""
        from ..notebook_card import camera_card  # for notebooks only

        return camera_card(self)

    # -- Camera interface, in the world frame -----------------------------------------------------

    @property
    def symmetry(self) -> AxialSymmetry | None:
        """Axial symmetry; None without one."""
        return None

    @abstractmethod
    def backproject(self, pixels: ArrayLike) -> Rays:
        """Return the rays of pixels (n, 2), px."""

    @abstractmethod
    def project(self, points_mm: ArrayLike) -> Projection:
        """Return the pixels of world points (n, 3), mm."""

    @abstractmethod
    def project_directions(self, directions: ArrayLike) -> Projection:
        """Return the pixels of world directions (n, 3) of any non-zero length."""

    # -- orientation -------------------------------------------------------------------------------

    @property
    def looks_back(self) -> bool:
        """True if the image centre is directed backwards past the lens (-Z), as for a mirror."""
        return self.optics == "mirror"

    @property
    def axis(self) -> Array:
        """World direction (3,) of the image centre."""
        forward = -1.0 if self.looks_back else 1.0
        return forward * self.mount.rotation()[:, 2]

    @property
    def is_picture_reversed(self) -> bool:
        """True if the raw image is mirrored: text is reversed and markers are not detected."""
        return self.looks_back != self.mount.image_flipped

    @property
    def _signs(self) -> Array:
        """Signs of image right, image down and axis, relative to camera X, Y, Z."""
        return np.array([-1.0 if self.mount.image_flipped else 1.0, 1.0, -1.0 if self.looks_back else 1.0])

    # -- validation in the constructors of all models --------------------------------------------

    def _check_camera(self) -> None:
        if finite("image_size", self.image_size).shape != (2,):
            raise InvalidParameter(f"image_size = {shown(self.image_size)} is no pair of numbers, (width, height)")
        for name, length in zip(("width", "height"), self.image_size, strict=True):
            if not (1 <= length <= LARGEST_PICTURE_PX and int(length) == length):
                raise InvalidParameter(
                    f"image {name} = {length} is not a whole number of pixels from 1 to {LARGEST_PICTURE_PX}"
                )
        choice("optics", self.optics, get_args(Optics))
