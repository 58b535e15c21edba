"""Deblurring of images before dewarping."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...base.arguments import check_fields
from ...base.errors import InvalidParameter
from ...cameras.camera import Camera
from ...io.pictures.exif import Exposure
from ...io.pictures.images import Image
from ...optics.sensor import Sensor
from ..restoration.noise import told_noise
from ..restoration.round_blur import ToldBlur, load_blur
from ..restoration.sharpening import Restorer

NO_EXPOSURE = Exposure()
F_TOLERANCE, FOCUS_TOLERANCE = 0.05, 0.1  # EXIF rounds F-numbers to two digits, and distances more coarsely
MAX_FOCUS_MM = 1e7


@dataclass(frozen=True)
class Restoration:
    """Deblurring of images before dewarping.

    Parameters
    ----------
    noise
        Standard deviation as a fraction of full scale; estimated from each image by default.
    object_distance_mm
        Object distance from the mirror; infinite by default.
    blur_px
        Blur diameter, or (tangential, sagittal) diameters, or a CSV file of diameters over the
        field; that of the sensor by default.

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

    def restorer(self, camera: Camera, exposure: Exposure = NO_EXPOSURE) -> Restorer:
        """Return the restorer for the images of a camera.

        Parameters
        ----------
        camera
            A sensor, or a calibrated camera.
        exposure
            Lens settings from EXIF. If they differ from those of the sensor, they reduce its blur.

        Returns
        -------
        Restorer
            Restorer, called with an image and its noise.

        Raises
        ------
        InvalidParameter
            If the blur of the camera is unknown, or specified twice.
        """
        if self.blur_px is None and not isinstance(camera, Sensor):
            raise InvalidParameter("to restore, the lens and the mirror must be known (a sensor), or the blur told")
        if self.blur_px is not None and self.object_distance_mm is not None:
            raise InvalidParameter("the blur that is told holds at any distance; leave out the object's distance")
        blur = load_blur(self.blur_px, camera) if isinstance(self.blur_px, str | Path) else self.blur_px
        distance = np.inf if self.object_distance_mm is None else self.object_distance_mm
        if blur is not None or not isinstance(camera, Sensor):
            return Restorer(camera, distance, blur)
        f_number = exposure.f_number if _differs(exposure.f_number, camera.lens.stop_number, F_TOLERANCE) else None
        focus = _focus(camera, exposure)
        return Restorer(camera, distance, f_number=f_number, focus_distance_mm=focus)

    def restored(self, picture: Image, source: Path, restorer: Restorer) -> tuple[Image, str]:
        """Return the deblurred image and a description of its blur and noise.

        Parameters
        ----------
        picture : (h, w) or (h, w, c) array
            Image as read from the file.
        source
            Source file; for JPEG files it determines the coding noise.
        restorer
            Restorer of the camera.

        Returns
        -------
        (h, w) or (h, w, c) array, str
            Deblurred image; description of the noise and of the removed fraction of the blur.
        """
        told = self.noise
        noise = restorer.estimate_noise(picture, source) if told is None else told_noise(told, picture.shape)
        decision = restorer.decide(picture, noise)
        described = _exposure_words(restorer)
        if decision.share == 0:
            return picture, f"; not restored, since {decision.reason}{described}"
        found = f"; restored at a noise of {100 * noise.share:.2g} % ({noise.kind}){described}"
        if decision.share < 1:
            found += f", and {100 * decision.share:.0f} % of the blur is removed, since {decision.reason}"
        return restorer(picture, noise, decision.share), found


def _differs(value: float | None, known: float, tolerance: float) -> bool:
    return value is not None and abs(np.log(value / known)) > np.log1p(tolerance)


def _focus(sensor: Sensor, exposure: Exposure) -> float | None:
    """Return the focus distance (mm) of an exposure if it differs from that of the sensor and the
    lens supports it.
    """
    focus = exposure.focus_distance_mm
    if focus is None or not _differs(focus, sensor.lens.focus_distance_mm, FOCUS_TOLERANCE):
        return None
    return min(focus, MAX_FOCUS_MM) if focus > sensor.lens.nearest_focus_mm else None


def _exposure_words(restorer: Restorer) -> str:
    """Return a phrase that reports the effect of EXIF settings on the blur of the sensor; empty if
    there is none.
    """
    words = ""
    if restorer.f_number is not None:
        assert isinstance(restorer.camera, Sensor)
        known = restorer.camera.lens.stop_number
        share = known / restorer.f_number
        effect = f"{100 * share:.0f} % of its blur is assumed" if share < 1 else "no more than its blur is assumed"
        words += f"; EXIF has F/{restorer.f_number:.3g}, the sensor F/{known:.3g}: {effect}"
    if restorer.focus_distance_mm is not None:
        assert isinstance(restorer.camera, Sensor)
        words += (
            f"; EXIF has a focus distance of {restorer.focus_distance_mm:.4g} mm, the sensor "
            f"{restorer.camera.lens.focus_distance_mm:.4g} mm: the smaller blur of both is assumed"
        )
    return words
