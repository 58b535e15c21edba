"""Deblurring of images with known blur."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...base.arguments import checked, instance
from ...base.colour import Light, linear_from_srgb, srgb_from_linear
from ...base.errors import InvalidParameter
from ...base.numerics.lazy import cached_property
from ...cameras.camera import Camera
from .blur_problem import BlurProblem
from .blur_scale import LEAST_NOISE, UNSEEN_SHARE, BlurScale
from .edge_overshoot import MAX_OVERSHOOT, MAX_OVERSHOOT_UNCODED, overshoot
from .noise import FULL, Noise, check_picture, estimate_noise, told_noise
from .round_blur import RoundBlur, ToldBlur, round_blur_of

Values = NDArray[np.float32]
Picture = NDArray[Any]


class Decision(NamedTuple):
    """Removed fraction of the known blur, and the reason if it is not 1."""

    share: float
    """Fraction from 0 to 1; at 0 the image is unchanged."""
    reason: str = ""
    """Empty if all of the blur is removed."""


SHARPENED = "its edges overshoot, as those of sharpened images do"
FEW_EDGES = "it has too few isolated edges to show whether it was sharpened"
MAX_SHARE_OF_CODED = 0.5  # if edges do not reveal whether a coded image was sharpened
SMALL = "with little noise, errors of a blur this small would be sharpened"
MAX_SHARE_OF_SMALL, SMALL_PX = 0.5, 2.5  # limit for blur below this diameter everywhere
SHARPER = "it is sharper than that blur"
UNSEEN = "it does not show how much blur it has"
NO_MORE = "it shows no more blur"


@checked
def restore(
    camera: Camera,
    image: Picture,
    *,
    noise: float | Noise | None = None,
    object_distance_mm: float = np.inf,
    blur: ToldBlur | None = None,
) -> Picture:
    """Remove the blur of the optics from an image of a camera.

    For several images of one camera use a :class:`Restorer`.

    Parameters
    ----------
    camera
        Camera of the image: a sensor at its own focus, with the mirror on the axis of the lens, or
        any camera with a specified ``blur``.
    image : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB or grey. A fourth channel is
        unchanged.
    noise
        Standard deviation in the sRGB image as a fraction of full scale (0.01 is 2.6 of 255), or
        the result of :func:`~omnimirror.estimate_noise`; estimated from the image by default.
    object_distance_mm
        Object distance from the mirror of a sensor.
    blur
        Blur diameters in px instead of those of the sensor: one number, a pair
        (tangential, sagittal), a table (n, 3) of radius, tangential and sagittal diameters, or a
        function of radii (n,) that returns both.

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

    Examples
    --------
    >>> import numpy as np, omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=128, height_px=128, pixel_pitch_um=41.6))
    >>> om.restore(small, np.full((128, 128), 90, np.uint8), noise=0.01).shape
    (128, 128)
    """
    instance("image", image, np.ndarray, "an array of pixels")
    return Restorer(camera, object_distance_mm, blur)(image, noise)


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
    told: ToldBlur | None = None
    f_number: float | None = None
    """F-number of the exposure if it differs from that of the sensor: a smaller aperture reduces
    the blur.
    """
    focus_distance_mm: float | None = None
    """Focus distance of the exposure; the smaller blur of this focus and that of the sensor is
    used.
    """

    def __call__(self, image: Picture, noise: float | Noise | None = None, share: float | None = None) -> Picture:
        """Restore an image as :func:`restore`, removing ``share`` of the blur; by default that of
        :meth:`decide`.
        """
        found = self._noise_of(image, noise)
        if share is None:
            share = self.decide(image, found).share
        if share == 0:
            return image.copy()
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        light = _light(colours)
        problem = self._problem(share)
        sharp = problem.sharp_roots(np.sqrt(light), found) ** 2
        mixing = problem.share[..., None]
        full = FULL[image.dtype.name]
        if image.dtype == np.float32:
            mixed = light + mixing * (sharp - light)
        else:
            given = (colours / np.float32(full)).astype(np.float32)
            mixed = np.rint(full * np.clip(given + mixing * (srgb_from_linear(sharp) - given), 0, 1))
        restored = image.copy()
        restored.reshape(*image.shape[:2], -1)[..., : mixed.shape[2]] = mixed
        return restored

    def estimate_noise(self, image: Picture, file: str | Path | None = None) -> Noise:
        """Estimate the noise of an image inside the rim; see :func:`~omnimirror.estimate_noise`."""
        self._check(image)
        return estimate_noise(image, file, where=self.radius < self.known.whole_radius_px)

    def decide(self, image: Picture, noise: float | Noise | None = None) -> Decision:
        """Return the detectable fraction of the known blur in an image.

        The image is unchanged if its edges overshoot, or if it is sharper than 0.25 of the known
        blur.
        """
        found = self._noise_of(image, noise)
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        light = _light(colours)
        grey = srgb_from_linear(light.mean(axis=2))
        visible = 0.0 if found.kind == "JPEG" else found.share
        inside = self.radius < self.known.whole_radius_px
        beyond = overshoot(np.asarray(grey, np.float32), inside, visible)
        if beyond > (MAX_OVERSHOOT if found.kind == "JPEG" else MAX_OVERSHOOT_UNCODED):
            return Decision(0.0, SHARPENED)
        share = self._scale.shown_share(np.sqrt(light), found)
        if share == 0:
            return Decision(0.0, SHARPER)
        if found.kind == "JPEG" and np.isnan(beyond) and share > MAX_SHARE_OF_CODED:
            return Decision(MAX_SHARE_OF_CODED, FEW_EDGES)
        if found.share < LEAST_NOISE and self._is_small and share > MAX_SHARE_OF_SMALL:
            return Decision(MAX_SHARE_OF_SMALL, SMALL)
        return Decision(share, "" if share == 1 else UNSEEN if share == UNSEEN_SHARE else NO_MORE)

    @cached_property
    def _is_small(self) -> bool:
        return bool(self.problem.sizes.larger[self.radius < self.known.whole_radius_px].max(initial=0) < SMALL_PX)

    def shown_share(self, image: Picture, noise: float | Noise | None = None) -> float:
        """Return the fraction of the known blur that is removed from an image."""
        return self.decide(image, noise).share

    @cached_property
    def known(self) -> RoundBlur:
        """Known blur."""
        return round_blur_of(
            self.camera, self.object_distance_mm, self.told, f_number=self.f_number, focus_mm=self.focus_distance_mm
        )

    @cached_property
    def _scale(self) -> BlurScale:
        return BlurScale(self.known)

    @cached_property
    def problem(self) -> BlurProblem:
        """Problem of removing all of the blur."""
        return BlurProblem(self.known)

    @property
    def share(self) -> Values:
        """Fraction (h, w) of restoration of each pixel, 0 to 1: 0 for sharp pixels and near the
        rim.
        """
        return self.problem.share

    @cached_property
    def radius(self) -> NDArray[np.float64]:
        """Distance (h, w) px of every pixel from the optical axis."""
        return self.known.radius

    def _problem(self, share: float) -> BlurProblem:
        return self.problem if share == 1 else BlurProblem(self.known.scaled(share))

    def _noise_of(self, image: Picture, noise: float | Noise | None) -> Noise:
        self._check(image)
        if noise is None:
            return self.estimate_noise(image)
        return noise if isinstance(noise, Noise) else told_noise(noise, image.shape)

    def _check(self, image: Picture) -> None:
        check_picture(image)
        width, height = self.camera.image_size
        if image.shape[:2] != (height, width):
            name = getattr(self.camera, "name", type(self.camera).__name__)
            raise InvalidParameter(
                f"the picture has {image.shape[1]} x {image.shape[0]} px, and those of {name!r} have {width} x {height}"
            )


def _light(colours: Picture) -> Light:
    """Return the linear light of an image; negative values are noise."""
    if colours.dtype == np.float32:
        return np.maximum(colours, 0)
    full = np.float32(FULL[colours.dtype.name])
    of_level = linear_from_srgb(np.arange(full + 1, dtype=np.float32) / full)
    return of_level[colours]
