"""How pictures are sharpened before they are straightened."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arguments import check_fields
from ..cameras import Camera
from ..errors import InvalidParameter
from ..media.pictures.images import Image
from ..sensor import Sensor
from ..simulate.restoration.blur_scale import UNSEEN_SHARE
from ..simulate.restoration.noise import told_noise
from ..simulate.restoration.round_blur import ToldBlur, load_blur
from ..simulate.restoration.sharpening import Restorer


@dataclass(frozen=True)
class Restoration:
    """How pictures are sharpened before they are straightened.

    Parameters
    ----------
    noise
        Standard deviation as a share of full scale; estimated from each picture by default.
    object_distance_mm
        From the mirror to what is seen; infinite by default.
    blur_px
        Blur diameter or (tangential, sagittal) ones, or a CSV file of them over the field; the sensor's by default.

    Examples
    --------
    >>> import omnimirror as om
    >>> restorer = om.Restoration(noise=0.01).restorer(om.load_sensor("paper-spherical"))
    >>> restorer.camera.name
    'paper-spherical'
    """

    noise: float | None = None
    object_distance_mm: float | None = None
    blur_px: ToldBlur | str | Path | None = None

    def __post_init__(self) -> None:
        check_fields(self)

    def restorer(self, camera: Camera) -> Restorer:
        """What sharpens the pictures of a camera.

        Parameters
        ----------
        camera
            A sensor, or a calibrated camera.

        Returns
        -------
        Restorer
            Called with a picture and its noise.

        Raises
        ------
        InvalidParameter
            Nothing is known of the camera's blur, or it is told twice.
        """
        if self.blur_px is None and not isinstance(camera, Sensor):
            raise InvalidParameter("to restore, the lens and the mirror must be known (a sensor), or the blur told")
        if self.blur_px is not None and self.object_distance_mm is not None:
            raise InvalidParameter("the blur that is told holds at any distance; leave out the object's distance")
        blur = load_blur(self.blur_px, camera) if isinstance(self.blur_px, str | Path) else self.blur_px
        distance = np.inf if self.object_distance_mm is None else self.object_distance_mm
        return Restorer(camera, distance, blur)

    def restored(self, picture: Image, source: Path, restorer: Restorer) -> tuple[Image, str]:
        """A picture without its blur, and what was found, in words that go on.

        Parameters
        ----------
        picture : (h, w) or (h, w, c) array
            As it was read.
        source
            Its file, of which a JPEG tells of its noise.
        restorer
            Of its camera.

        Returns
        -------
        (h, w) or (h, w, c) array, str
            The sharpened picture; at what noise, and of how much of the blur.
        """
        told = self.noise
        noise = restorer.estimate_noise(picture, source) if told is None else told_noise(told, picture.shape)
        share = restorer.shown_share(picture, noise)
        found = f"; restored at a noise of {100 * noise.share:.2g} % ({noise.kind})"
        if share < 1:
            why = "does not show how much it has" if share == UNSEEN_SHARE else "shows no more"
            found += f", and {100 * share:.0f} % of the blur is taken out, since the picture {why}"
        return restorer(picture, noise, share), found
