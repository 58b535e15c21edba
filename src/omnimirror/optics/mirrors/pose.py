"""Mirror pose: decentring, displacement and tilt relative to the lens.

All values are in the camera frame (X right and Y down in the image, Z from the lens to the mirror),
with its origin at the nominal mirror vertex. The mirror is first rotated about its own vertex, by
``tilt_x_deg`` about X and then by ``tilt_y_deg`` about Y (right-hand rule), and then translated by
``(decentre_x_mm, decentre_y_mm, displacement_mm)``.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from ...base.parameters import Parameter
from ...base.typing import Array
from ...cameras.frames import turned

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
        "decentre_x_mm": Parameter("mm", *SHIFT, "shift of the vertex to the right in the image"),
        "decentre_y_mm": Parameter("mm", *SHIFT, "shift of the vertex down in the image"),
        "displacement_mm": Parameter("mm", *SHIFT, "shift of the vertex away from the lens"),
        "tilt_x_deg": Parameter("deg", *TILT, "rotation about the image's X, through the vertex; applied first"),
        "tilt_y_deg": Parameter("deg", *TILT, "rotation about the image's Y, through the vertex"),
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
        (cx, cy), (sx, sy) = (f(np.radians([self.tilt_x_deg, self.tilt_y_deg])) for f in (np.cos, np.sin))
        about_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
        about_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
        rotation: Array = about_y @ about_x
        return rotation

    def to_camera(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the mirror frame to the camera frame."""
        return self.turned_to_camera(points) + self.shift

    def to_mirror(self, points: ArrayLike) -> Array:
        """Convert points (n, 3), mm, from the camera frame to the mirror frame."""
        return self.turned_to_mirror(np.asarray(points, dtype=float) - self.shift)

    def turned_to_camera(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the mirror frame to the camera frame."""
        return turned(directions, self.rotation().T)

    def turned_to_mirror(self, directions: ArrayLike) -> Array:
        """Convert directions (n, 3) from the camera frame to the mirror frame."""
        return turned(directions, self.rotation())
