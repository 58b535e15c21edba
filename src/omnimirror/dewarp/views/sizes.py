"""Size of a view that preserves the image resolution, and maximum zoom."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...base.arguments import WrongKind, checked, number, shown
from ...base.errors import InvalidParameter
from ...cameras.camera import Camera
from ..camera_field import FieldOfView
from ..maps.coordinates import rows_of_pixels
from ..screens import (
    Pole,
    Screen,
    View,
    parts_of,
)

PartialSize = tuple[int | None, int | None]


UNKNOWN_SIZE: PartialSize = (None, None)


LARGEST_MAGNIFICATION = 4.0
"""Maximum magnification in output pixels per source pixel: cubic interpolation is still smooth,
without additional detail above about 1.
"""


ROWS_EXAMINED = 65


LARGEST_RATIO = 1e6  # maximum aspect of an image


@checked
def resolution(camera: Camera, view: View) -> float:
    """Return the number of source pixels per output pixel (linear) at the visible pixel nearest to
    the centre.

    For several views in one image, the coarsest resolution is returned. NaN if none is visible, or
    has fewer than 2 x 2 pixels.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        Screen of :mod:`omnimirror.screens`, or several screens in one image.

    Returns
    -------
    float
        Source pixels per output pixel.

    Examples
    --------
    >>> import omnimirror as om
    >>> view = om.views.perspective(hfov_deg=40.0)
    >>> print(f"{om.views.resolution(om.load_sensor('paper-spherical'), view):.3f}")
    0.154
    """
    found = [screen_resolution(camera, part.screen) for part in parts_of(view)]
    return float(min((r for r in found if np.isfinite(r)), default=np.nan))


@checked
def largest_zoom(camera: Camera, view: View) -> float:
    """Return the maximum zoom factor within the resolution of the camera, at least 1.

    At this zoom, :data:`LARGEST_MAGNIFICATION` output pixels correspond to one source pixel;
    infinite if the resolution is unknown.

    Parameters
    ----------
    camera
        A sensor, or a calibrated camera.
    view
        Screen of :mod:`omnimirror.screens`, or several screens in one image.

    Returns
    -------
    float
        Factor of at least 1.

    Examples
    --------
    >>> import omnimirror as om
    >>> camera = om.load_sensor("paper-spherical")
    >>> print(f"{om.views.largest_zoom(camera, om.views.perspective(hfov_deg=120.0)):.2f}")
    2.94
    """
    within = LARGEST_MAGNIFICATION * resolution(camera, view)
    return max(1.0, within) if np.isfinite(within) else np.inf


def screen_resolution(camera: Camera, screen: Screen) -> float:
    width, height = screen.size
    if width < 2 or height < 2:
        return np.nan
    middle = (height - 2) / 2
    rows = np.unique(np.linspace(0, height - 2, min(height - 1, ROWS_EXAMINED)).round().astype(int))
    nearest, found = np.inf, np.nan
    for row in map(int, rows[np.argsort(abs(rows - middle), kind="stable")]):
        if abs(row - middle) >= nearest:
            break
        pixels = rows_of_pixels(camera, screen, row, row + 2)
        across, down = np.diff(pixels[0], axis=0), (pixels[1] - pixels[0])[:-1]
        area = abs(across[:, 0] * down[:, 1] - across[:, 1] * down[:, 0])
        distances = np.where(np.isnan(area), np.inf, np.hypot(np.arange(width - 1) - (width - 2) / 2, row - middle))
        best = int(np.argmin(distances))
        if distances[best] < nearest:
            nearest, found = float(distances[best]), float(np.sqrt(area[best]))
    return found


def field_end(seen: FieldOfView, pole: Pole) -> float:
    """Return the angle (deg) from a pole to the far end of the field."""
    return 90 - seen.tilt_min_deg if pole == "zenith" else 90 + seen.tilt_max_deg


def completed(size: PartialSize, natural: tuple[float, float]) -> tuple[int, int]:
    """Complete a size from a natural size: both sides, or the missing one from the aspect."""
    if not isinstance(size, Sequence) or isinstance(size, str) or len(size) != 2:
        raise WrongKind(f"size = {shown(size)} is not (width, height) in px, each perhaps None")
    width, height = (side if side is None else int(number("size", side, above=0.0, unit="px")) for side in size)
    if width is not None and height is not None:
        return width, height
    if not np.isfinite(natural).all() or max(natural) > LARGEST_RATIO * min(natural) >= 0:
        raise InvalidParameter(
            f"a view of {natural[0]:.3g} x {natural[1]:.3g} px, at the picture's resolution, is no picture; give it "
            "other angles, or both sides of its size"
        )
    if width is None and height is None:
        return _even(natural[0]), _even(natural[1])
    if height is None:
        assert width is not None
        return width, max(1, round(width * natural[1] / natural[0]))
    return width if width is not None else max(1, round(height * natural[0] / natural[1])), height


def _even(length: float) -> int:
    """Round to an even number, as required for video."""
    return max(2, 2 * round(length / 2))
