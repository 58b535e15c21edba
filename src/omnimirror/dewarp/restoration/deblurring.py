"""Deblurring of images with known blur and noise."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import check_fields, instance, validate_arguments
from ...base.caching import cached_property
from ...base.colour import Light, linear_from_srgb, srgb_from_linear
from ...base.errors import InvalidParameter, OmnimirrorWarning
from ...cameras.camera import Camera
from ...io.image_metadata import Exposure, exposure_of
from ...io.images import Image, read_image_and_metadata
from ...optics.sensor import Sensor
from ._blur_fraction import (
    COMPARED_FRACTION,
    MAX_CONTRADICTION,
    MIN_ASSUMED_NOISE,
    UNSEEN_SHARE,
    BlurProblem,
    BlurScale,
    contradiction,
)
from ._sharpness import blur_limit, overshoot, overshoot_limits
from .blur_model import BlurDiameters, RadialBlur, load_blur, radial_blur_of
from .noise import FULL, Noise, check_restorable, estimate_noise, specified_noise

LOGGER = logging.getLogger(__name__)

# -- Deblurring of images with known blur ----------------------------------------------------------

ImageArray = NDArray[Any]
Values = NDArray[np.float32]


class Decision(NamedTuple):
    """Removed fraction of the known blur, and the reason if it is not 1."""

    fraction: float
    """Fraction from 0 to 1; at 0 the image is unchanged."""
    reason: str = ""
    """Empty if all of the blur is removed."""


SHARPENED = "its edges overshoot as in sharpened images"
SLIGHTLY_SHARPENED = "its edges overshoot slightly as in weakly sharpened images"
MAX_SHARE_OF_DOUBTFUL = 0.45  # less than half of the blur does no harm to weakly sharpened images
FEW_EDGES = "it has too few isolated edges to detect sharpening"
MAX_SHARE_OF_CODED = 0.5  # if edges do not reveal whether a coded image was sharpened
SMALL_BLUR_REASON = "errors of this small blur would be amplified at the low noise"
MAX_SHARE_OF_SMALL, SMALL_PX = 0.5, 2.5  # limit for blur below this diameter everywhere
SHARPER = "it is sharper than the assumed blur"
UNSEEN = "its blur cannot be estimated"
NO_MORE = "it contains no further blur"
# Limits of the blur from edges and texture: estimates above the maximum are consistent with all of
# the known blur; below the minimum the image is returned unchanged
MAX_LIMIT, MAX_LIMIT_OF_LARGE, EDGE_SCALE, TEXTURE_SCALE = 0.85, 0.7, 0.9, 1.1
MIN_LIMIT, MIN_LIMIT_OF_CODED = 0.45, 0.3
# Diameter in px and minimum of blur that is smaller everywhere: its fractions resemble each other
MIN_LIMITS_OF_SMALL = ((1.25, 0.9), (2.5, 0.65))
# From this contradiction between image and full blur, none is removed; below it, from the maximum of
# the known blur, half of the estimated fraction
MIN_SHARP_CONTRADICTION, CONTRADICTED_SCALE = 0.105, 0.5
CERTAIN_LIMIT = 0.95  # above it, residuals that indicate less blur are ignored
F_TOLERANCE, FOCUS_TOLERANCE = (
    0.05,
    0.1,
)  # EXIF rounds F-numbers to two digits, and distances more coarsely
MAX_FOCUS_MM = 1e7


@validate_arguments
def restore(
    camera: Camera,
    image: ImageArray | str | Path,
    *,
    noise: float | Noise | None = None,
    object_distance_mm: float = np.inf,
    blur: BlurDiameters | None = None,
    stored_orientation: bool = False,
    on_note: Callable[[str], None] | None = None,
) -> ImageArray:
    """Remove the blur of the optics from an image of a camera.

    For several images of one camera use a :class:`Restorer`.

    Parameters
    ----------
    camera
        Camera of the image: a sensor at its own focus, with the mirror on the axis of the lens, or
        any camera with a specified ``blur``.
    image : (h, w), (h, w, 3) or (h, w, 4) array, or a file
        sRGB in uint8 or uint16, or linear light in float32; RGB or grey. A fourth channel is
        unchanged. The F-number and the focus distance in the EXIF data of a file are compared with
        those of a sensor; if they differ, the smaller blur is assumed.
    noise
        Standard deviation in the sRGB image as a fraction of full scale (0.01 is 2.6 of 255), or
        the result of :func:`~omnimirror.estimate_noise`; estimated from the image by default.
    object_distance_mm
        Object distance from the mirror of a sensor.
    blur
        Blur diameters in px instead of those of the sensor: one number, a pair
        (tangential, sagittal), a table (n, 3) of radius, tangential and sagittal diameters, or a
        function of radii (n,) that returns both.
    stored_orientation
        Use the pixels of a file as stored and ignore the orientation in its EXIF data.
    on_note
        Called with a sentence on the noise, the removed fraction of the blur and the effect of EXIF
        data. By default, EXIF data that differ from the sensor cause an
        :class:`~omnimirror.base.errors.OmnimirrorWarning`.

    Returns
    -------
    (h, w), (h, w, 3) or (h, w, 4) array
        Deblurred image of the same type. Pixels with a blur below 0.25 px or within a few pixels of
        the rim are unchanged. If the image contains less blur than is known or given, only that is
        removed; 0.85 of the known blur is removed if the image does not reveal its blur. Sharpened
        images, and images far sharper than the known blur, are returned unchanged.

    Raises
    ------
    InvalidParameter
        If image, camera and noise are inconsistent, the image contains non-finite values, the blur
        is unknown, or the mirror of a sensor is decentred or tilted.
    MediaError
        If the file cannot be read.

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=128, height_px=128, pixel_pitch_um=41.6))
    >>> om.restore(small, np.full((128, 128), 90, np.uint8), noise=0.01).shape
    (128, 128)
    """
    file, exposure = None, Exposure()
    if isinstance(image, str | Path):
        file = Path(image)
        image, metadata = read_image_and_metadata(file, stored_orientation=stored_orientation)
        exposure = exposure_of(metadata.exif)
    instance("image", image, np.ndarray, "an array of pixels or a file")
    restorer = Restorer.of_exposure(camera, exposure, object_distance_mm, blur)
    restored, report = restorer.restore_and_describe(image, noise, file)
    if on_note is not None:
        on_note(report)
    elif restorer.exposure_words:
        warnings.warn(f"{file}: {report}", OmnimirrorWarning, stacklevel=2)
    return restored


@dataclass(frozen=True, eq=False)
class Restorer:
    """Restorer for the images of one camera; blur data are prepared once.

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.optics.image_sensor import Imager
    >>> sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(128, 128, 41.6))
    >>> restorer = Restorer(replace(sensor, lens=replace(sensor.lens, f_number=0.5)))
    >>> restorer(np.full((128, 128), 90, np.uint8), noise=0.01).shape
    (128, 128)
    """

    camera: Camera
    object_distance_mm: float = np.inf
    specified: BlurDiameters | None = None
    f_number: float | None = None
    """F-number of the exposure if it differs from that of the sensor: a smaller aperture reduces
    the blur.
    """
    focus_distance_mm: float | None = None
    """Focus distance of the exposure; the smaller blur of this focus and that of the sensor is
    used.
    """

    def __call__(
        self, image: ImageArray, noise: float | Noise | None = None, fraction: float | None = None
    ) -> ImageArray:
        """Restore an image as :func:`restore`, removing ``fraction`` of the blur; by default that of
        :meth:`decide`.
        """
        estimate = self._noise_of(image, noise)
        if fraction is None:
            fraction = self.decide(image, estimate).fraction
        if fraction == 0:
            return image.copy()
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        light = _light(colours)
        problem = self._problem(fraction)
        sharp = problem.sharp_roots(np.sqrt(light), estimate) ** 2
        mixing = problem.fraction[..., None]
        full = FULL[image.dtype.name]
        if image.dtype == np.float32:
            mixed = light + mixing * (sharp - light)
        else:
            values = (colours / np.float32(full)).astype(np.float32)
            mixed = np.rint(
                full * np.clip(values + mixing * (srgb_from_linear(sharp) - values), 0, 1)
            )
        restored = image.copy()
        restored.reshape(*image.shape[:2], -1)[..., : mixed.shape[2]] = mixed
        return restored

    @classmethod
    def of_exposure(
        cls,
        camera: Camera,
        exposure: Exposure,
        object_distance_mm: float = np.inf,
        specified: BlurDiameters | None = None,
    ) -> Restorer:
        """Return the restorer for images with given lens settings.

        Settings that differ from those of a sensor by more than their rounding in EXIF data reduce
        its blur. A specified blur is used for all settings.
        """
        if specified is not None or not isinstance(camera, Sensor):
            return cls(camera, object_distance_mm, specified)
        lens = camera.lens
        f_number = (
            exposure.f_number
            if _differs(exposure.f_number, lens.stop_number, F_TOLERANCE)
            else None
        )
        focus = exposure.focus_distance_mm
        if (
            not _differs(focus, lens.focus_distance_mm, FOCUS_TOLERANCE)
            or focus <= lens.nearest_focus_mm
        ):
            focus = None
        return cls(
            camera,
            object_distance_mm,
            f_number=f_number,
            focus_distance_mm=None if focus is None else min(focus, MAX_FOCUS_MM),
        )

    @property
    def exposure_words(self) -> str:
        """Effect of lens settings that differ from those of the sensor, as a phrase; empty if there
        is none.
        """
        parts = []
        if self.f_number is not None:
            assert isinstance(self.camera, Sensor)
            f_number = self.camera.lens.stop_number
            fraction = f_number / self.f_number
            effect = (
                f"{100 * fraction:.0f} % of the blur is assumed"
                if fraction < 1
                else "the blur of the sensor is assumed"
            )
            parts.append(f"EXIF has F/{self.f_number:.3g}, the sensor F/{f_number:.3g}: {effect}")
        if self.focus_distance_mm is not None:
            assert isinstance(self.camera, Sensor)
            parts.append(
                f"EXIF has a focus distance of {self.focus_distance_mm:.4g} mm, the sensor "
                f"{self.camera.lens.focus_distance_mm:.4g} mm: the smaller blur is assumed"
            )
        return "; ".join(parts)

    def restore_and_describe(
        self, image: ImageArray, noise: float | Noise | None = None, file: str | Path | None = None
    ) -> tuple[ImageArray, str]:
        """Restore an image and describe its noise, the removed fraction of the blur and the effect
        of lens settings.

        ``file``, the source of the image, determines the coding noise of JPEG files.
        """
        LOGGER.info("Estimating the noise")
        estimate = (
            self.estimate_noise(image, file) if noise is None else self._noise_of(image, noise)
        )
        LOGGER.info("Estimating the blur")
        decision = self.decide(image, estimate)
        described = f"; {description}" if (description := self.exposure_words) else ""
        if decision.fraction == 0:
            return image.copy(), f"not restored because {decision.reason}{described}"
        text = (
            f"restored with noise of {100 * estimate.fraction:.2g} % ({estimate.kind}){described}"
        )
        if decision.fraction < 1:
            text += f", and {100 * decision.fraction:.0f} % of the blur is removed because {decision.reason}"
        LOGGER.info("Removing the blur")
        return self(image, estimate, decision.fraction), text

    def estimate_noise(self, image: ImageArray, file: str | Path | None = None) -> Noise:
        """Estimate the noise of an image inside the rim; see :func:`~omnimirror.estimate_noise`."""
        self._check(image)
        return estimate_noise(image, file, where=self.radius < self.known.whole_radius_px)

    def decide(self, image: ImageArray, noise: float | Noise | None = None) -> Decision:
        """Return the detectable fraction of the known blur in an image.

        The image is unchanged if its edges overshoot, or if it is sharper than 0.25 of the known
        blur.
        """
        estimate = self._noise_of(image, noise)
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        light = _light(colours)
        grey = srgb_from_linear(light.mean(axis=2))
        is_coded = estimate.kind == "JPEG"
        visible = 0.0 if is_coded else estimate.fraction
        inside = self.radius < self.known.whole_radius_px
        beyond = overshoot(np.asarray(grey, np.float32), inside, visible)
        doubtful, sharpened = overshoot_limits(estimate.fraction, is_coded=is_coded)
        if beyond > sharpened:
            return Decision(0.0, SHARPENED)
        limits = blur_limit(srgb_from_linear(light), self.known, self.problem.sizes, estimate)
        fraction = self._scale.blur_fraction(
            np.sqrt(light), estimate, may_be_sharper=not np.fmin(*limits) >= CERTAIN_LIMIT
        )
        if fraction > 0:
            fraction = min(fraction, self._sharpness_limit(*limits, is_coded=is_coded))
        if fraction > 0 and not self._scale.is_limited:
            fraction = self._reduce_contradicted(fraction, np.sqrt(light), estimate)
        if beyond > doubtful:
            return Decision(min(fraction, MAX_SHARE_OF_DOUBTFUL), SLIGHTLY_SHARPENED)
        if fraction == 0:
            return Decision(0.0, SHARPER)
        if is_coded and np.isnan(beyond) and fraction > MAX_SHARE_OF_CODED:
            return Decision(MAX_SHARE_OF_CODED, FEW_EDGES)
        if (
            estimate.fraction < MIN_ASSUMED_NOISE
            and self._largest_px < SMALL_PX
            and fraction > MAX_SHARE_OF_SMALL
        ):
            return Decision(MAX_SHARE_OF_SMALL, SMALL_BLUR_REASON)
        return Decision(
            fraction, "" if fraction == 1 else UNSEEN if fraction == UNSEEN_SHARE else NO_MORE
        )

    def _sharpness_limit(self, edges: float, texture: float, *, is_coded: bool) -> float:
        """Return the fraction of the blur from the limits of edges and texture; 0 if it is small.

        For uncoded images with blur of at least 3 px, the residuals are more accurate. Coding changes
        texture: it determines the fraction only of large blur without isolated edges, and otherwise
        reveals only sharp images.
        """
        is_large = self._scale.is_limited
        if is_large and not is_coded:
            return 1.0
        if is_large and not np.isnan(edges):
            texture = np.nan
        min_limit = next(
            (limit for px, limit in MIN_LIMITS_OF_SMALL if self._largest_px < px), MIN_LIMIT
        )
        min_texture = MIN_LIMIT_OF_CODED if is_coded and not is_large else min_limit
        if edges < min_limit or texture < min_texture:
            return 0.0
        if is_coded and not is_large:
            texture = np.nan
        max_limit = MAX_LIMIT_OF_LARGE if is_large else MAX_LIMIT
        shares = [
            scale * limit
            for limit, scale in ((edges, EDGE_SCALE), (texture, TEXTURE_SCALE))
            if limit < max_limit
        ]
        return min(shares, default=1.0)

    def _reduce_contradicted(self, fraction: float, roots: Values, noise: Noise) -> float:
        """Return an estimated fraction of the blur, or less if the image contradicts all of the
        blur and does not confirm a fraction of large blur.
        """
        excess = contradiction(self.problem, roots, noise, self._smaller_problem)
        if excess <= MAX_CONTRADICTION:
            return fraction
        if fraction < 1 and self._largest_px >= SMALL_PX:
            fraction_excess = contradiction(self._problem(fraction), roots, noise)
            if fraction_excess <= MAX_CONTRADICTION:
                return fraction
        return CONTRADICTED_SCALE * fraction if excess <= MIN_SHARP_CONTRADICTION else 0.0

    @cached_property
    def _smaller_problem(self) -> BlurProblem:
        return self._problem(COMPARED_FRACTION)

    @cached_property
    def _largest_px(self) -> float:
        """Largest diameter of the known blur inside the rim."""
        inside = self.radius < self.known.whole_radius_px
        return float(self.problem.sizes.larger[inside].max(initial=0))

    def blur_fraction(self, image: ImageArray, noise: float | Noise | None = None) -> float:
        """Return the fraction of the known blur that is removed from an image."""
        return self.decide(image, noise).fraction

    @cached_property
    def known(self) -> RadialBlur:
        """Known blur."""
        return radial_blur_of(
            self.camera,
            self.object_distance_mm,
            self.specified,
            f_number=self.f_number,
            focus_mm=self.focus_distance_mm,
        )

    @cached_property
    def _scale(self) -> BlurScale:
        return BlurScale(self.known)

    @cached_property
    def problem(self) -> BlurProblem:
        """Problem of removing all of the blur."""
        return BlurProblem(self.known)

    @property
    def fraction(self) -> Values:
        """Fraction (h, w) of restoration of each pixel, 0 to 1: 0 for sharp pixels and near the
        rim.
        """
        return self.problem.fraction

    @cached_property
    def radius(self) -> NDArray[np.float64]:
        """Distance (h, w) px of every pixel from the optical axis."""
        return self.known.radius

    def _problem(self, fraction: float) -> BlurProblem:
        return self.problem if fraction == 1 else BlurProblem(self.known.scaled(fraction))

    def _noise_of(self, image: ImageArray, noise: float | Noise | None) -> Noise:
        self._check(image)
        if noise is None:
            return self.estimate_noise(image)
        return noise if isinstance(noise, Noise) else specified_noise(noise, image.shape)

    def _check(self, image: ImageArray) -> None:
        check_restorable(image)
        width, height = self.camera.image_size
        if image.shape[:2] != (height, width):
            name = getattr(self.camera, "name", type(self.camera).__name__)
            raise InvalidParameter(
                f"the image must have the {width} x {height} px of {name!r}; got {image.shape[1]} x {image.shape[0]} px"
            )


def _differs(value: float | None, reference: float, tolerance: float) -> TypeGuard[float]:
    return value is not None and abs(np.log(value / reference)) > np.log1p(tolerance)


def _light(colours: ImageArray) -> Light:
    """Return the linear light of an image; negative values are noise."""
    if colours.dtype == np.float32:
        return np.maximum(colours, 0)
    full = np.float32(FULL[colours.dtype.name])
    of_level = linear_from_srgb(np.arange(full + 1, dtype=np.float32) / full)
    return of_level[colours]


# -- Deblurring of images before dewarping ---------------------------------------------------------

NO_EXPOSURE = Exposure()


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
    blur_px: BlurDiameters | str | Path | None = None

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
            raise InvalidParameter(
                f"blur_px must be specified unless the camera is a sensor; got a {type(camera).__name__}"
            )
        if self.blur_px is not None and self.object_distance_mm is not None:
            raise InvalidParameter(
                f"object_distance_mm must be omitted with blur_px; got {self.object_distance_mm:g}"
            )
        blur = (
            load_blur(self.blur_px, camera)
            if isinstance(self.blur_px, str | Path)
            else self.blur_px
        )
        distance = np.inf if self.object_distance_mm is None else self.object_distance_mm
        return Restorer.of_exposure(camera, exposure, distance, blur)

    def restored(self, image: Image, source: Path, restorer: Restorer) -> tuple[Image, str]:
        """Return the deblurred image and a description of its blur and noise.

        Parameters
        ----------
        image : (h, w) or (h, w, c) array
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
        restored, report = restorer.restore_and_describe(image, self.noise, source)
        return restored, f"; {report}"
