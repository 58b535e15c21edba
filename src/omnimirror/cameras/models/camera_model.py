"""Base class of calibrated camera models, and the uncertainty of their viewing directions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from typing import ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.notebook_card import Line, card, field_range, line_drawing, origin
from ...base.parameters import Uncertainty
from ...base.typing import Array, Mask
from ..camera import AxialSymmetry, Mount, Projection, Rays

# -- Base class --------------------------------------------------------------------------------------
#
# A model uses the right-handed camera frame (X right and Y down in the image, Z ahead). ``optics``
# defines the direction of the image centre: backwards past the lens (a mirror) or forwards (a fisheye).
# Centres and radii refer to the image as delivered; ``mount.image_flipped`` marks it as mirrored.

Optics = Literal["mirror", "fisheye"]


class ModelParameter(NamedTuple):
    """Model parameter with its scaling for estimation."""

    name: str
    value: float
    unit: str
    scale: float
    """Typical change, for conditioning."""


class PointImages(NamedTuple):
    """Image points with derivatives; NaN if invalid."""

    pixels: Array
    """(n, 2), px, inside or outside the image."""
    valid: Mask
    """(n,) False beyond the end of the model's field, or at its viewpoint."""
    d_points: Array
    """(n, 2, 3) derivatives with respect to the points, px/mm, or to the given directions, px."""
    d_parameters: Array
    """(n, 2, p) derivatives with respect to :attr:`CameraModel.parameters`, px per unit of each."""


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
    def image(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Project points (n, 3) in the camera frame, or directions if ``distant``, with
        derivatives.

        Image edges and rim are ignored.
        """

    def image_clamped(self, points_mm: ArrayLike, *, distant: bool = False) -> PointImages:
        """Project points, clamping points beyond the field to its end.

        Parameters
        ----------
        points_mm : (n, 3)
            Points in mm, or directions, in the camera frame.
        distant
            True for directions.

        Returns
        -------
        PointImages
            Pixels (n, 2), validity (n,), and derivatives (n, 2, 3) and (n, 2, p).

        Raises
        ------
        InvalidParameter
            If the points do not have the shape (n, 3).

        Examples
        --------
        >>> import omnimirror as om
        >>> camera = om.Unified(
        ...     xi=0.0,
        ...     focal_px=(100.0, 100.0),
        ...     centre_px=(319.5, 239.5),
        ...     image_size=(640, 480),
        ...     optics="fisheye",
        ... )  # a pinhole
        >>> behind = [[0.0, 100.0, -50.0]]
        >>> camera.image(behind).valid[0], camera.image_clamped(behind).valid[0]
        (np.False_, np.True_)
        """
        return self.image(points_mm, distant=distant)

    def _repr_html_(self) -> str:
        """Return an HTML card for notebooks."""
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
        """Return the pixels of world directions (n, 3), non-zero vectors of any length."""

    # -- Orientation -------------------------------------------------------------------------------

    @property
    def is_backward_facing(self) -> bool:
        """True if the image centre is directed backwards past the lens (-Z), as for a mirror."""
        return self.optics == "mirror"

    @property
    def axis(self) -> Array:
        """World direction (3,) of the image centre."""
        forward = -1.0 if self.is_backward_facing else 1.0
        return forward * self.mount.rotation()[:, 2]

    @property
    def is_image_reversed(self) -> bool:
        """True if the raw image is mirrored: text is reversed and markers are not detected."""
        return self.is_backward_facing != self.mount.image_flipped

    @property
    def _signs(self) -> Array:
        """Signs of image right, image down and axis, relative to camera X, Y, Z."""
        return np.array(
            [
                -1.0 if self.mount.image_flipped else 1.0,
                1.0,
                -1.0 if self.is_backward_facing else 1.0,
            ]
        )


# -- First-order propagation of parameter covariance to viewing directions -------------------------

FIELD_ROUNDING_DEG = 1e-6  # tolerance of the outermost measured direction, which defines the field


def direction_covariance(model: CameraModel, covariance: Array, directions: Array) -> Array:
    """Compute the covariance (n, 2, 2), rad^2, of directions (n, 3).

    The axes are two perpendicular to each direction. With a fixed pixel, parameters of covariance
    (p, p) give ``0 = (du/dd) dd + (du/dp) dp``, therefore ``dd = -(du/dd)^-1 (du/dp) dp`` in the
    plane across d. NaN outside the field of view.
    """
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    return direction_covariance_at(model, covariance, unit, _perpendicular_axes(unit), distant=True)


def direction_covariance_at(
    model: CameraModel, covariance: Array, targets: Array, axes: Array, *, distant: bool
) -> Array:
    """Compute the covariance (n, 2, 2) of targets (n, 3) with fixed pixels, along axes (n, 3, 2).

    Targets are in the camera frame.
    """
    spread = np.full((len(targets), 2, 2), np.nan)
    finite_rows = np.flatnonzero(np.isfinite(targets).all(axis=1))
    image = model.image(targets[finite_rows], distant=distant)
    moves = image.d_points @ axes[finite_rows]
    is_regular = (
        image.valid
        & np.isfinite(moves).all(axis=(1, 2))
        & np.isfinite(image.d_parameters).all(axis=(1, 2))
    )
    is_regular[is_regular] = np.abs(np.linalg.det(moves[is_regular])) > 0
    change = -np.linalg.solve(moves[is_regular], image.d_parameters[is_regular])
    spread[finite_rows[is_regular]] = change @ covariance @ change.transpose(0, 2, 1)
    return spread


def field_angles(model: CameraModel, directions: Array) -> Array:
    """Return angles (n,), deg, of directions (n, 3) from the image centre."""
    forward = -1.0 if model.is_backward_facing else 1.0
    return np.degrees(
        np.arctan2(np.hypot(directions[:, 0], directions[:, 1]), forward * directions[:, 2])
    )


def within_field(
    model: CameraModel, directions: Array, field_deg: float | None
) -> NDArray[np.bool_]:
    """Return which directions (n, 3) are in a calibrated field; all if it is None."""
    if field_deg is None:
        return np.ones(len(directions), dtype=bool)
    return field_angles(model, directions) <= field_deg + FIELD_ROUNDING_DEG


def direction_sigma_deg(
    model: CameraModel, covariance: Array, directions: ArrayLike, field_deg: float | None = None
) -> Array:
    """Return the standard deviation (n,), deg, of directions, along the larger axis.

    Parameters
    ----------
    model
        Calibrated model.
    covariance : (p, p)
        Covariance of its parameters.
    directions : (n, 3)
        Directions in the camera frame, of any length.
    field_deg : deg, optional
        Calibrated field; directions outside have an unknown uncertainty.

    Returns
    -------
    (n,) array
        NaN outside the field of view or the calibrated field.
    """
    vectors = np.asarray(directions, dtype=float)
    sigma = np.degrees(major_sigma(direction_covariance(model, covariance, vectors)))
    return np.where(within_field(model, vectors, field_deg), sigma, np.nan)


def major_sigma(spread: Array) -> Array:
    """Return the larger standard deviation (n,), along the major axis, of covariances (n, 2, 2).

    >>> major_sigma(np.array([[[4.0, 0.0], [0.0, 9.0]]]))
    array([3.])
    """
    a, b, c = spread[:, 0, 0], (spread[:, 0, 1] + spread[:, 1, 0]) / 2, spread[:, 1, 1]
    # larger eigenvalue of [[a, b], [b, c]]
    sigma: Array = np.sqrt(np.maximum((a + c) / 2 + np.hypot((a - c) / 2, b), 0.0))
    return sigma


def _perpendicular_axes(directions: Array) -> Array:
    """Return two unit vectors (n, 3, 2) orthogonal to unit vectors (n, 3)."""
    helper = np.where(np.abs(directions[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    first = np.cross(directions, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=2)


# -- Notebook card -----------------------------------------------------------

RING_STEP_DEG = 30.0
RING_POINTS = 61
MAX_PARAMETERS = 12


def camera_card(camera: CameraModel) -> str:
    """Return an HTML card: rings of constant field angle, and parameters with deviations."""
    width, height = camera.image_size
    symmetry = camera.symmetry
    field = (
        {} if symmetry is None else {"Field": field_range(symmetry.omega_min, symmetry.omega_max)}
    )
    sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
    displayed = camera.parameters[:MAX_PARAMETERS]
    parameters = {
        p.name: f"{p.value:.6g}{_format_sigma(sigmas.get(p.name))} {p.unit}" for p in displayed
    }
    omitted = len(camera.parameters) - len(displayed)
    more = {f"{omitted} more parameters": ""} if omitted else {}
    head = {
        "Optics": camera.optics,
        **field,
        "Image": f"{width} × {height} px",
        "Camera orientation": camera.mount.camera_looks,
    }
    drawing = line_drawing(
        list(_field_rings(camera)),
        f"Image with rings of constant field angle every {RING_STEP_DEG:g} degrees",
    )
    return card(
        camera.KIND,
        "calibrated camera",
        drawing,
        {**head, **parameters, **more},
        origin(getattr(camera, "notes", ""), len(sigmas)),
    )


def _format_sigma(sigma: float | None) -> str:
    return "" if sigma is None else f" ± {sigma:.2g}"


def _field_rings(camera: CameraModel) -> Iterator[Line]:
    """Yield the frame of the image and the images of rings about the axis."""
    width, height = camera.image_size
    yield Line(
        np.array([0, width, width, 0, 0.0]) - 0.5,
        0.5 - np.array([0, 0, height, height, 0.0]),
        "plain",
    )
    turn = np.linspace(0, 2 * np.pi, RING_POINTS)
    right, down = camera.mount.rotation()[:, 0], camera.mount.rotation()[:, 1]
    end = 180.0 if camera.symmetry is None else float(np.degrees(camera.symmetry.omega_max))
    rings = [*np.arange(RING_STEP_DEG, end - 1e-9, RING_STEP_DEG), end]
    for omega in np.radians(rings):
        around = np.outer(np.cos(turn), right) + np.outer(np.sin(turn), down)
        pixels, valid = camera.project_directions(
            np.cos(omega) * camera.axis + np.sin(omega) * around
        )
        if valid.any():
            yield Line(
                np.where(valid, pixels[:, 0], np.nan),
                -np.where(valid, pixels[:, 1], np.nan),
                "fine" if omega < np.radians(end) else "strong",
            )
