"""Plausibility checks of camera files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial.polynomial import polyval

from ...base.typing import Array
from .camera_model import RadialModel

MAX_CENTRE_OFFSET = 0.03
"""Distance of the centre from the image centre, relative to the shorter side, above which swapped
values are considered; covers well-mounted mirror cameras."""
MAX_SWAPPED_RATIO = 0.4
"""Factor by which swapping must reduce that distance."""
MAX_STRETCH = 0.02
"""Largest plausible difference of the two image scales; pixels are square within 0.1 %."""
MAX_ROTATION = 0.02
"""Largest plausible rotation of the pixel axes, in radians; it is 0 apart from noise, because the poses of
the target contain the rotation of the camera."""
MAX_DIFFERENCE_PX = 1.0
"""Largest plausible difference of direct and inverse polynomial; usual is 0.1 px."""
ROUNDING = 1e-9
EXCLUDED_FRACTION = 1 / 3
"""Fraction of the field around the axis excluded from the comparison."""
SAMPLES = 200


def plausibility_warnings(camera: RadialModel) -> list[str]:
    """List implausible parameters of a camera, each with its magnitude.

    Examples
    --------
    >>> import omnimirror as om
    >>> plausibility_warnings(
    ...     om.OCam(
    ...         polynomial=(-130.0, 0.0, 0.002), centre_px=(380.0, 510.0), image_size=(1024, 768)
    ...     )
    ... )[0]
    'the centre (380, 510) is 182 px from the centre of the 1024 x 768 px image, but ... with swapped coordinates ...'
    """
    messages = []
    (u, v), (width, height) = camera.centre_px, camera.image_size
    middle = np.array([width - 1, height - 1]) / 2
    offset, swapped = (float(np.hypot(*(np.array(uv) - middle))) for uv in ((u, v), (v, u)))
    centre, size = f"the centre ({u:.4g}, {v:.4g})", f"{width} x {height} px image"
    if offset > MAX_CENTRE_OFFSET * min(width, height) and swapped < MAX_SWAPPED_RATIO * offset:
        messages.append(
            f"{centre} is {offset:.3g} px from the centre of the {size}, but {swapped:.3g} "
            "px with swapped coordinates or swapped width and height; check their order "
            "in the file"
        )
    elif not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
        messages.append(f"{centre} is outside the {size}")
    radius = min(camera.field_radius_px, min(width, height) / 2)
    # Polar decomposition of the matrix: a rotation or reflection, and a symmetric stretch.
    left, (large, small), right = np.linalg.svd(camera.matrix)
    stretch = float(large / small) - 1
    if stretch > MAX_STRETCH:
        messages.append(
            f"the image is stretched by {100 * stretch:.3g} % in one direction "
            f"({_affine(camera)}), up to {stretch * radius:.3g} px; nearly all cameras have square "
            "pixels"
        )
    orthogonal = left @ right
    turn = float(np.arctan2(orthogonal[1, 0], orthogonal[1, 1]))
    if np.linalg.det(orthogonal) < 0:
        messages.append(f"the image is mirrored ({_affine(camera)}); check the signs in the file")
    elif abs(turn) > MAX_ROTATION and stretch <= MAX_STRETCH:
        messages.append(
            f"the pixel axes are rotated by {np.degrees(abs(turn)):.3g} deg ({_affine(camera)}), "
            f"up to {2 * np.sin(abs(turn) / 2) * radius:.3g} px; the affine terms d and e are nearly 0 "
            "for all cameras"
        )
    return messages


def inverse_polynomial_warnings(
    camera: RadialModel, inverse: Sequence[float] | Array, start: float = np.pi / 2
) -> list[str]:
    """Compare the inverse polynomial of a file with its direct one, up to the nearest image edge.

    Parameters
    ----------
    camera
        Camera with the direct polynomial.
    inverse
        Radius in px, in the camera's circular image, by powers of the field angle minus ``start``,
        lowest power first; empty for a file without one.
    start : radians
        Origin of the field angle.

    Returns
    -------
    list of str
        One sentence if they differ by more than :data:`MAX_DIFFERENCE_PX`.
    """
    if not len(inverse):
        return []
    max_radius = min(camera.field_radius_px, min(camera.image_size) / 2)
    end = float(camera.omega_from_radius(np.array([max_radius]))[0]) * (1 - ROUNDING)
    # An inverse with many terms deviates in unfitted regions, such as the centre of annular images.
    omega = np.linspace(EXCLUDED_FRACTION * end, end, SAMPLES)
    with np.errstate(over="ignore", invalid="ignore"):
        difference = np.abs(
            polyval(omega - start, np.asarray(inverse, dtype=float))
            - camera.radius_from_omega(omega)
        )
    largest = int(np.nanargmax(difference)) if np.isfinite(difference).any() else 0
    if difference[largest] <= MAX_DIFFERENCE_PX:
        return []
    return [
        "the inverse polynomial of the file differs from the direct one by up to "
        f"{difference[largest]:.3g} px ({np.degrees(omega[largest]):.3g} deg from the "
        "axis); the direct one is used"
    ]


def _affine(camera: RadialModel) -> str:
    """Return the parameters of the file that stretch the image."""
    if affine := getattr(camera, "affine", ()):
        return "c = {:.4g}, d = {:.4g}, e = {:.4g}".format(*affine)
    (fx, skew), (_, fy) = camera.matrix
    return f"fx = {fx:.4g}, fy = {fy:.4g}, skew = {skew:.4g}"
