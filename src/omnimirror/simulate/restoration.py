"""Pictures sharpened by what is known of their blur."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..sensor import Sensor
from .blurring import Blur, BlurSize, blur_of, blur_sizes, offsets_from_axis, whole_radius_px
from .colour import Light, linear_from_srgb, srgb_from_linear
from .deconvolution import solve
from .operators import Operator, operator_of

Values = NDArray[np.float32]
Picture = NDArray[Any]

FINENESS = 2  # a picture blurred one way is aliased the other, and what aliasing folded must have its place
SHARP_PX = 0.25  # pixels with less blur stay as they are, and those with twice as much are all restored
FULL = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
BLOCK_PX, PLAINEST, BLACK, WHITE = 8, 0.1, 0.03, 0.97  # of the estimate of noise
LEAST_NOISE, MOST_NOISE = 1e-3, 0.2


def restore(sensor: Sensor, image: Picture, noise: float | None = None, object_distance_mm: float = np.inf) -> Picture:
    """The picture of a sensor without the blur that its optics left in it.

    For many pictures of one sensor keep a :class:`Restorer`.

    Parameters
    ----------
    sensor
        Which took the picture, at its own focus, with its mirror on the axis of the lens.
    image : (h, w), (h, w, 3) or (h, w, 4) array
        sRGB in uint8 or uint16, or linear light in float32; RGB or grey, a fourth channel is left as it is.
    noise
        Standard deviation in the sRGB picture, as a share of full scale (0.01 is 2.6 of 255); estimated from the
        picture by default.
    object_distance_mm
        From the mirror to what is seen.

    Returns
    -------
    Picture of the same kind. Where the blur is under a quarter of a pixel, and within some pixels of the rim, it
    is the picture given.

    Raises
    ------
    InvalidParameter
        If picture, sensor and noise do not fit together, or the mirror is decentred or tilted.
    """
    return Restorer(sensor, object_distance_mm)(image, noise)


@dataclass(frozen=True, eq=False)
class Restorer:
    """Sharpens the pictures of one sensor; what it needs to know of the blur is prepared once.

    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> from omnimirror.imagers import Imager
    >>> sensor = replace(om.load_sensor("paper-spherical"), imager=Imager(128, 128, 41.6))
    >>> restorer = Restorer(replace(sensor, lens=replace(sensor.lens, f_number=0.5)))
    >>> restorer(np.full((128, 128), 90, np.uint8), noise=0.01).shape
    (128, 128)
    """

    sensor: Sensor
    object_distance_mm: float = np.inf

    def __call__(self, image: Picture, noise: float | None = None) -> Picture:
        """As :func:`restore`."""
        self._check(image, noise)
        colours = image[..., None] if image.ndim == 2 else image[..., :3]
        if noise is None:
            noise = self.estimate_noise(image)
        share = self.share[..., None]
        light = _light(colours)
        widening = self._sizes.widening.astype(np.float32)
        fine = solve(self.operator, self.blur.pixels, widening, np.sqrt(light), max(noise, LEAST_NOISE))
        sharp = _binned(fine, FINENESS)
        full = FULL[image.dtype.name]
        if image.dtype == np.float32:
            mixed = light + share * (sharp - light)
        else:
            given = (colours / np.float32(full)).astype(np.float32)
            mixed = np.rint(full * np.clip(given + share * (srgb_from_linear(sharp) - given), 0, 1))
        restored = image.copy()
        restored.reshape(*image.shape[:2], -1)[..., : mixed.shape[2]] = mixed
        return restored

    def estimate_noise(self, image: Picture) -> float:
        """Standard deviation of the noise in sRGB, as a share of full scale.

        From differences within squares of 2 x 2 pixels (the finest diagonal wavelet), which hold little but noise
        where the picture is plain: by their median in the plainest tenth of blocks, neither black nor saturated.
        """
        values = srgb_from_linear(_light(image[..., None] if image.ndim == 2 else image[..., :3]))
        height, width = (side // BLOCK_PX * BLOCK_PX for side in values.shape[:2])
        values = values[:height, :width]
        diagonal = (values[::2, ::2] - values[1::2, ::2] - values[::2, 1::2] + values[1::2, 1::2]) / 2
        inside = self.radius[:height, :width, None] < whole_radius_px(self.sensor)
        level = _blocks(np.where(inside, values, np.nan), BLOCK_PX).mean(axis=-1)
        plain = (level > BLACK) & (level < WHITE)
        if not plain.any():
            return LEAST_NOISE
        typical = np.median(np.abs(_blocks(diagonal, BLOCK_PX // 2)), axis=-1) / 0.6745  # of a normal distribution
        noise = np.quantile(typical[plain], PLAINEST)
        return float(np.clip(noise, LEAST_NOISE, MOST_NOISE))

    @cached_property
    def blur(self) -> Blur:
        """The blur of every pixel."""
        return blur_of(self.sensor, FINENESS, self.object_distance_mm)

    @cached_property
    def operator(self) -> Operator:
        """Products with the blur."""
        return operator_of(self.blur)

    @cached_property
    def share(self) -> Values:
        """How much of a pixel (h, w) is restored, 0 to 1: nothing where it is sharp, or near the rim."""
        blurred = _smooth(self._sizes.larger / SHARP_PX - 1)
        inside = _smooth((whole_radius_px(self.sensor) - self.radius) / 2)
        return (blurred * inside).astype(np.float32)

    @cached_property
    def radius(self) -> NDArray[np.float64]:
        """Distance (h, w) px of every pixel from the optical axis."""
        offsets = offsets_from_axis(self.sensor)
        return np.hypot(offsets[..., 0], offsets[..., 1])

    @cached_property
    def _sizes(self) -> BlurSize:
        """Blur of every pixel (h, w)."""
        radii = np.arange(int(self.radius.max()) + 2, dtype=float)
        known = blur_sizes(self.sensor, radii, self.object_distance_mm)
        return BlurSize(*(np.interp(self.radius, radii, size) for size in known))

    def _check(self, image: Picture, noise: float | None) -> None:
        width, height = self.sensor.image_size
        if image.shape[:2] != (height, width):
            raise InvalidParameter(
                f"the picture has {image.shape[1]} x {image.shape[0]} px, and those of {self.sensor.name!r} have "
                f"{width} x {height}"
            )
        if image.dtype.name not in FULL or (image.ndim != 2 and (image.ndim != 3 or image.shape[2] not in (1, 3, 4))):
            raise InvalidParameter(
                f"a picture of shape {image.shape} and {image.dtype} is not valid; valid are {', '.join(FULL)} with 1, "
                "3 or 4 channels"
            )
        if noise is not None and not 0 <= noise <= MOST_NOISE:
            raise InvalidParameter(f"noise = {noise:g} is outside 0 to {MOST_NOISE:g} of full scale")


def _light(colours: Picture) -> Light:
    """Linear light of a picture; what is below 0 is noise."""
    full = FULL[colours.dtype.name]
    return np.maximum(colours, 0) if colours.dtype == np.float32 else linear_from_srgb(colours / np.float32(full))


def _binned(fine: Values, fineness: int) -> Light:
    """Light of the pixels of a sensor from its roots on a fine grid."""
    rows, columns, channels = fine.shape
    light = (fine**2).reshape(rows // fineness, fineness, columns // fineness, fineness, channels)
    binned: Light = light.mean(axis=(1, 3))
    return binned


def _blocks(values: NDArray[np.floating], side: int) -> NDArray[np.floating]:
    """Values (rows, columns, n) of each of the square blocks."""
    rows, columns, channels = values.shape
    blocks = values.reshape(rows // side, side, columns // side, side, channels).swapaxes(1, 2)
    return blocks.reshape(rows // side, columns // side, -1)


def _smooth(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """From 0 at 0 to 1 at 1 without a kink."""
    x = np.clip(x, 0, 1)
    return x * x * (3 - 2 * x)
