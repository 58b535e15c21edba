"""Pictures sharpened by what is known of their blur."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...arguments import checked, instance
from ...cameras import Camera
from ...errors import InvalidParameter
from ...numerics.lazy import cached_property
from ..colour import Light, linear_from_srgb, srgb_from_linear
from .blur_problem import BlurProblem
from .blur_scale import BlurScale
from .noise import FULL, Noise, check_picture, estimate_noise, told_noise
from .round_blur import RoundBlur, ToldBlur, round_blur_of

Values = NDArray[np.float32]
Picture = NDArray[Any]


@checked
def restore(
    camera: Camera,
    image: Picture,
    *,
    noise: float | Noise | None = None,
    object_distance_mm: float = np.inf,
    blur: ToldBlur | None = None,
) -> Picture:
    """The picture of a camera without the blur that its optics left in it.

    For many pictures of one camera keep a :class:`Restorer`.

    Parameters
    ----------
    camera
        Which took the picture: a sensor at its own focus, with its mirror on the axis of the lens, or any other whose
        ``blur`` is told.
    image : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB or grey, a fourth channel is left as it is.
    noise
        Standard deviation in the sRGB picture, as a share of full scale (0.01 is 2.6 of 255), or what
        :func:`~omnimirror.estimate_noise` found; estimated from the picture by default.
    object_distance_mm
        From a sensor's mirror to what is seen.
    blur
        Blur diameters in px instead of those of the sensor: one number, a pair (tangential, sagittal), a table (n, 3)
        of radius, tangential and sagittal, or a function of radii (n,) that returns both.

    Returns
    -------
    (h, w), (h, w, 3) or (h, w, 4) array
        Of the same kind. Where the blur is under a quarter of a pixel, and within some pixels of the rim, it is the
        picture given. Where the picture shows less blur than is known or told, so much is taken out of it, and 0.85
        where it shows too little to say.

    Raises
    ------
    InvalidParameter
        If picture, camera and noise do not fit together, the picture holds values that are not finite, nothing is
        known of the blur, or a sensor's mirror is decentred or tilted.

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
    """Sharpens the pictures of one camera; what it needs to know of the blur is prepared once.

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.imagers import Imager
    >>> sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(128, 128, 41.6))
    >>> restorer = Restorer(replace(sensor, lens=replace(sensor.lens, f_number=0.5)))
    >>> restorer(np.full((128, 128), 90, np.uint8), noise=0.01).shape
    (128, 128)
    """

    camera: Camera
    object_distance_mm: float = np.inf
    told: ToldBlur | None = None

    def __call__(self, image: Picture, noise: float | Noise | None = None, share: float | None = None) -> Picture:
        """As :func:`restore`; ``share`` of the blur is taken out, by default what the picture shows."""
        found = self._noise_of(image, noise)
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        light = _light(colours)
        if share is None:
            share = self._scale.shown_share(np.sqrt(light), found)
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
        """The noise of a picture within the rim, as :func:`~omnimirror.estimate_noise` finds it."""
        self._check(image)
        return estimate_noise(image, file, where=self.radius < self.known.whole_radius_px)

    def shown_share(self, image: Picture, noise: float | Noise | None = None) -> float:
        """The share of the known blur that a picture shows: 1 unless it is sharper than that, or shows too little."""
        found = self._noise_of(image, noise)
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        return self._scale.shown_share(np.sqrt(_light(colours)), found)

    @cached_property
    def known(self) -> RoundBlur:
        """What is known of the blur."""
        return round_blur_of(self.camera, self.object_distance_mm, self.told)

    @cached_property
    def _scale(self) -> BlurScale:
        return BlurScale(self.known)

    @cached_property
    def problem(self) -> BlurProblem:
        """Of taking out all of the blur."""
        return BlurProblem(self.known)

    @property
    def share(self) -> Values:
        """How much of a pixel (h, w) is restored, 0 to 1: nothing where it is sharp, or near the rim."""
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
    """Linear light of a picture; what is below 0 is noise."""
    if colours.dtype == np.float32:
        return np.maximum(colours, 0)
    full = np.float32(FULL[colours.dtype.name])
    of_level = linear_from_srgb(np.arange(full + 1, dtype=np.float32) / full)
    return of_level[colours]
