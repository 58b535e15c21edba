"""As-built mirror: pose relative to the lens, and form error in Zernike terms."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.caching import cached_property
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from ...base.polynomials import monomial_index, noll, zernike_powers, zernike_terms
from ...base.typing import Array
from ...cameras.camera import rotate_vectors

# -- Mirror pose -----------------------------------------------------------------------------------
#
# All values are in the camera frame (X right and Y down in the image, Z from the lens to the mirror),
# with its origin at the nominal mirror vertex. The mirror is first rotated about its own vertex, by
# ``tilt_x_deg`` about X and then by ``tilt_y_deg`` about Y (right-hand rule), and then translated by
# ``(decentre_x_mm, decentre_y_mm, displacement_mm)``.

SHIFT = (-1e4, 1e4)
TILT = (-60.0, 60.0)


@dataclass(frozen=True)
class MirrorPose:
    """Pose of a mirror relative to its lens; aligned by default.

    Parameters
    ----------
    decentre_x_mm, decentre_y_mm
        Shift of the vertex to the right and down in the image.
    displacement_mm
        Shift of the vertex away from the lens, added to the sensor's ``mirror_distance_mm``.
    tilt_x_deg, tilt_y_deg
        Rotation about the vertex: about X, then about Y. A small positive ``tilt_y_deg`` tilts the
        far end of the mirror axis to the right, a small positive ``tilt_x_deg`` upwards (to -Y).

    Raises
    ------
    InvalidParameter
        If a number is outside its range.

    Examples
    --------
    >>> pose = MirrorPose(decentre_x_mm=0.5, tilt_y_deg=90.0 / 2)
    >>> pose.to_camera([[0.0, 0.0, 1.0]]).round(4)  # a point of the mirror axis leans to the right
    array([[1.2071, 0.    , 0.7071]])
    >>> pose.to_mirror(pose.to_camera([[3.0, -2.0, 1.0]])).round(9)
    array([[ 3., -2.,  1.]])
    """

    decentre_x_mm: float = 0.0
    decentre_y_mm: float = 0.0
    displacement_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "decentre_x_mm": Parameter(
            "mm", *SHIFT, "decentring of the vertex to the right in the image"
        ),
        "decentre_y_mm": Parameter("mm", *SHIFT, "decentring of the vertex downwards in the image"),
        "displacement_mm": Parameter("mm", *SHIFT, "displacement of the vertex away from the lens"),
        "tilt_x_deg": Parameter(
            "deg",
            *TILT,
            "rotation about the X axis of the image, through the vertex; applied first",
        ),
        "tilt_y_deg": Parameter(
            "deg", *TILT, "rotation about the Y axis of the image, through the vertex"
        ),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))

    @property
    def is_axial(self) -> bool:
        """True if mirror and lens are coaxial: neither decentred nor tilted."""
        return not (self.decentre_x_mm or self.decentre_y_mm or self.tilt_x_deg or self.tilt_y_deg)

    @property
    def shift(self) -> Array:
        """Vertex (3,), mm, in the camera frame."""
        return np.array([self.decentre_x_mm, self.decentre_y_mm, self.displacement_mm])

    def rotation(self) -> Array:
        """Return the rotation (3, 3) from the mirror frame to the camera frame."""
        (cx, cy), (sx, sy) = (
            f(np.radians([self.tilt_x_deg, self.tilt_y_deg])) for f in (np.cos, np.sin)
        )
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        rotation: Array = about_y @ about_x
        return rotation

    def to_camera(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the mirror frame to the camera frame."""
        return self.rotate_to_camera(points) + self.shift

    def to_mirror(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the camera frame to the mirror frame."""
        return self.rotate_to_mirror(np.asarray(points, dtype=float) - self.shift)

    def rotate_to_camera(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the mirror frame to the camera frame."""
        return rotate_vectors(directions, self.rotation().T)

    def rotate_to_mirror(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the camera frame to the mirror frame."""
        return rotate_vectors(directions, self.rotation())


# -- Form error in Zernike terms -------------------------------------------------------------------

MAX_ORDER = 12
TERMS = zernike_terms(MAX_ORDER)
"""Number of Zernike terms up to the largest order, and exponents of ``x^i y^j``."""
MM_PER_UM = 1e-3


class SurfaceHeights(NamedTuple):
    """Heights of a surface, or of its form error, with derivatives; arrays of one shape."""

    z: Array
    """mm"""
    gx: Array
    gy: Array
    """First derivatives."""
    hxx: Array
    hxy: Array
    hyy: Array
    """Second derivatives, 1/mm."""


@dataclass(frozen=True)
class MirrorForm:
    """Form error along the axis, positive away from the lens, in the mirror frame; none by default.

    Parameters
    ----------
    zernike
        Noll indices of the Zernike terms over the disc of the rim; up to order 12.
    um
        Amplitude of each term, rms over the disc.

    Raises
    ------
    InvalidParameter
        If a term is invalid or repeated, or the number of amplitudes differs from that of terms.

    Examples
    --------
    >>> form = MirrorForm((5, 8), (0.3, -0.1))
    >>> bool(abs(form.heights(20.0, np.array([[20.0, 0.0]])).z[0] / 1e-3 + 0.1 * 8**0.5) < 1e-12)  # coma at the rim
    True
    """

    zernike: tuple[int, ...] = ()
    um: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "zernike": Parameter("", 1, TERMS, "Zernike terms of the form error (Noll indices)"),
        "um": Parameter(
            "um", -1e4, 1e4, "rms of each term over the disc of the rim, along the axis"
        ),
    }

    def __post_init__(self) -> None:
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))
        terms = np.array(self.zernike, dtype=float)
        if (terms != np.round(terms)).any() or len(set(terms)) != len(terms):
            raise InvalidParameter(
                f"zernike must contain different indices of terms; got {list(self.zernike)}"
            )
        if len(self.um) != len(terms):
            raise InvalidParameter(
                f"um must have one amplitude for each of the {len(terms)} terms; got {len(self.um)}"
            )
        object.__setattr__(self, "zernike", tuple(int(j) for j in terms))
        object.__setattr__(self, "um", tuple(float(v) for v in self.um))

    @property
    def is_empty(self) -> bool:
        """True without form error."""
        return not any(self.um)

    @cached_property
    def _powers(self) -> Array:
        """Coefficients (n, n), mm, of (x/rim)^i (y/rim)^j."""
        order = max(noll(j)[0] for j in self.zernike)
        rows = zernike_powers(order)
        mixed = MM_PER_UM * sum(
            um * rows[j - 1] for j, um in zip(self.zernike, self.um, strict=True)
        )
        square = np.zeros((order + 1, order + 1))
        for i in range(order + 1):
            for j in range(order + 1 - i):
                square[i, j] = np.asarray(mixed)[monomial_index(i, j)]
        return square

    def heights(self, rim_mm: float, xy: Array) -> SurfaceHeights:
        """Compute heights and derivatives at points (n, 2), mm, for a rim radius."""
        count = len(xy)
        if self.is_empty:
            return SurfaceHeights(*np.zeros((6, count)))
        u, v = (xy / rim_mm).T
        size = len(self._powers)
        powers = np.arange(size)
        rows, columns = ([_derived(w, powers, k) for k in range(3)] for w in (u, v))

        def summed(a: int, b: int) -> Array:
            total: Array = np.einsum(
                "ni,ij,nj->n", rows[a], self._powers, columns[b], optimize=True
            )
            return total / rim_mm ** (a + b)

        return SurfaceHeights(
            *(summed(a, b) for a, b in ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)))
        )


def _derived(w: Array, powers: NDArray[np.intp], times: int) -> Array:
    """Compute derivatives (n, k) of powers of w."""
    factor = np.ones(len(powers))
    for k in range(times):
        factor = factor * (powers - k)
    derived: Array = factor * w[:, None] ** np.maximum(powers - times, 0)
    return derived


NO_FORM = MirrorForm()
