"""Interactive views in notebooks: the page without a server, in a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...base.arguments import number, shown
from ...base.errors import InvalidParameter
from ...base.files import write_text
from ...dewarp.restoration.noise import check_picture
from ...io import read_image
from ...optics.sensor import Sensor
from ...optics.sensor_files import AnyCamera
from .look.viewer import viewer_of

LOWEST_PX, HIGHEST_PX = 120, 4000


@dataclass(frozen=True)
class LookAround:
    """Interactive page, displayed as the last expression of a notebook cell.

    Attributes
    ----------
    page
        Self-contained HTML with image and camera.
    height_px
        Height of the frame, pixels.

    Examples
    --------
    >>> LookAround("<p>", 300)._repr_html_()
    '<iframe srcdoc="&lt;p&gt;" style="width: 100%; height: 300px; border: 0" allow="fullscreen; gyroscope"></iframe>'
    """

    page: str = field(repr=False)
    height_px: int

    def _repr_html_(self) -> str:
        """Return the page in a frame for notebooks."""
        look = f"width: 100%; height: {self.height_px}px; border: 0"
        return f'<iframe srcdoc="{escape(self.page)}" style="{look}" allow="fullscreen; gyroscope"></iframe>'

    def save(self, path: str | Path) -> None:
        """Write the page as an HTML file.

        Parameters
        ----------
        path
            HTML file.
        """
        write_text(path, self.page)


def show(
    picture: str | Path | NDArray[Any],
    camera: AnyCamera,
    *,
    height_px: int = 480,
    stored_orientation: bool = False,
) -> LookAround:
    """Display interactive views of an image in a notebook: pan, tilt and zoom, panoramas and other
    projections.

    Parameters
    ----------
    picture : (h, w), (h, w, 3) or (h, w, 4) array, or a file
        Image; colours are RGB.
    camera
        Camera of the image: a sensor, a calibrated camera or a mirror ball.
    height_px
        Height of the view, pixels.
    stored_orientation
        Use the pixels of a file as stored and ignore the orientation in its EXIF data.

    Returns
    -------
    LookAround
        Page that a notebook displays as the last expression of a cell; ``save`` writes it to a
        file.

    Raises
    ------
    InvalidParameter
        Unknown camera, or an image of another size than the camera's.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> ball = om.MirrorBall(centre_px=(31.5, 31.5), rim_radius_px=30.0, field_deg=300.0, image_size=(64, 64))
    >>> om.show(np.full((64, 64, 3), 90, np.uint8), ball)._repr_html_()[:15]
    '<iframe srcdoc='
    """
    if not isinstance(camera, AnyCamera):
        raise InvalidParameter(f"camera = {shown(camera)} is no camera; load_sensor and load_camera give some")
    height = number("height_px", height_px)
    if not LOWEST_PX <= height <= HIGHEST_PX:
        raise InvalidParameter(f"height_px = {height:g} is outside {LOWEST_PX} to {HIGHEST_PX}")
    path = Path(picture) if isinstance(picture, str | Path) else None
    image = read_image(picture, stored_orientation=stored_orientation) if isinstance(picture, str | Path) else picture
    check_picture(image)
    name = camera.name if isinstance(camera, Sensor) else camera.KIND
    return LookAround(viewer_of(camera, name, ("--sensor", f"{name}.toml"), path, image), round(height))
