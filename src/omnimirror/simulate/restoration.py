"""Pictures sharpened by what is known of their blur.

Looked for is the sharp picture, on a grid finer than the pixels, that explains the blurred one within its noise and
has little total variation (Rudin, Osher and Fatemi, 1992). Blur adds light, and noise is even in a picture as files
hold it; so the unknown u is the root of the light, which is near to what files hold, and

    |sqrt(A u^2) - y|^2 / 2 + weight TV(u)

is made small, A being the blur. Both terms are replaced by quadratic ones a few times (Gauss-Newton, and lagged
diffusivity: Vogel and Oman, 1996), each solved by conjugate gradients.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..sensor import Sensor
from .blurring import BlurMatrix, BlurSize, blur_matrix, blur_sizes, offsets_from_axis, whole_radius_px
from .colour import Light, linear_from_srgb, srgb_from_linear

Values = NDArray[np.float32]
Picture = NDArray[Any]

REGULARITY = 0.35  # the weight of the total variation over the noise; tuned on the room alone
ROUNDS, STEPS = 5, 8  # replacements by quadratic terms, and conjugate gradients in each
EDGE = np.float32(0.008)  # differences of u below it cost their square, which keeps slopes from becoming stairs
DARK = np.float32(1e-4)  # light below it has no more weight than this
SATURATED = np.float32(0.995)  # such a pixel may have been brighter
ASTIGMATIC_PX = 1.0
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
        sRGB in uint8 or uint16, or linear light in float32; channels in any order, a fourth one is left as it is.
    noise
        Standard deviation in the sRGB picture, as a share of full scale (0.01 is 2.6 of 255); estimated from the
        picture by default.
    object_distance_mm
        From the mirror to what is seen.

    Returns
    -------
    Picture of the same kind. Where the blur is under half a pixel (a pixel, on a coarse grid), and within some
    pixels of the rim, it is the picture given.

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
        sharp = _binned(solve(self.blur, np.sqrt(light), max(noise, LEAST_NOISE)), self.blur.fineness)
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
    def fineness(self) -> int:
        """Pixels of the sharp picture along the side of a pixel: 2 where one direction is blurred and the other not.

        A picture blurred in one direction is still aliased in the other, and what aliasing folded must have its place.
        """
        sizes = self._sizes
        return 2 if np.max(np.abs(sizes.tangential - sizes.sagittal)) > ASTIGMATIC_PX else 1

    @cached_property
    def blur(self) -> BlurMatrix:
        """The blur of every pixel."""
        return blur_matrix(self.sensor, self.fineness, self.object_distance_mm)

    @cached_property
    def share(self) -> Values:
        """How much of a pixel (h, w) is restored, 0 to 1: nothing where it is sharp, or near the rim."""
        threshold = 0.5 if self.fineness > 1 else 1.0
        blurred = _smooth(self._sizes.larger / threshold - 1)
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


def solve(blur: BlurMatrix, roots: Values, noise: float) -> Values:
    """Roots of the light (rows, columns, channels) of the sharp picture, on its fine grid.

    Parameters
    ----------
    blur
    roots : (h, w, channels)
        Roots of the light of the blurred picture.
    noise
        Standard deviation of the roots.
    """
    fine = _refined(roots, blur.fineness)
    seen = roots.reshape(-1, roots.shape[2])[blur.pixels]
    matrix, back = blur.matrix, blur.matrix.T.tocsr()
    weight = np.float32(REGULARITY * noise)
    typical = np.float32(0.5 / blur.fineness**4)  # of the diagonal of A^T A, for the preconditioner
    for _ in range(ROUNDS):
        flat = fine.reshape(-1, fine.shape[2])
        level = np.sqrt(np.maximum(matrix @ flat**2, DARK))
        counted = (seen < SATURATED) | (level < seen)
        slope = (counted / level).astype(np.float32)  # of sqrt(A u^2), but for A and u
        right, down = _differences(fine)
        steepness = np.sqrt((right**2).sum(axis=2) + (down**2).sum(axis=2) + EDGE**2)
        quadratic = _Quadratic(matrix, back, flat, slope, (weight / steepness)[..., None])
        pull = flat * (back @ (slope * (seen - level))) - quadratic.smoothness(flat)
        scale = (1 / (4 * quadratic.stiffness.reshape(-1, 1) + typical)).astype(np.float32)
        step = _conjugate_gradients(quadratic.__call__, pull, scale, STEPS)
        fine = np.maximum(flat + step, 0).reshape(fine.shape)
    return fine


class _Quadratic(NamedTuple):
    """The second derivative of what is made small, about values ``flat`` (n, channels) of the fine grid."""

    matrix: Any
    back: Any
    flat: Values
    slope: Values
    stiffness: Values
    """(rows, columns, 1): weight over steepness."""

    def __call__(self, d: Values, /) -> Values:
        """Times (n, channels): of what explains the picture by Gauss and Newton, and of the smoothness."""
        explained: Values = self.flat * (self.back @ (self.slope**2 * (self.matrix @ (self.flat * d))))
        return explained + self.smoothness(d)

    def smoothness(self, d: Values) -> Values:
        """The derivative of the total variation, with the steepness as it is."""
        rows, columns, _ = self.stiffness.shape
        right, down = _differences(d.reshape(rows, columns, -1))
        return _undifferences(self.stiffness * right, self.stiffness * down).reshape(d.shape)


def _conjugate_gradients(apply: Callable[[Values], Values], b: Values, scale: Values, steps: int) -> Values:
    """Nearly the x with ``apply(x) = b``; ``scale`` is about the inverse of the diagonal."""
    x, residual = np.zeros_like(b), b
    direction = scale * residual
    power = float(np.vdot(residual, direction))
    for _ in range(steps):
        if power <= 0:  # solved already
            break
        turned = apply(direction)
        step = np.float32(power / float(np.vdot(direction, turned)))
        x += step * direction
        residual = residual - step * turned
        scaled = scale * residual
        power, before = float(np.vdot(residual, scaled)), power
        direction = scaled + np.float32(power / before) * direction
    return x


def _refined(roots: Values, fineness: int) -> Values:
    """On a finer grid to begin with, without the stairs of pixels, which would be taken for edges."""
    if fineness == 1:
        return roots
    import cv2

    fine = np.repeat(np.repeat(roots, fineness, axis=0), fineness, axis=1)
    return np.asarray(cv2.blur(fine, (fineness, fineness)), np.float32).reshape(fine.shape)


def _differences(picture: Values) -> tuple[Values, Values]:
    """To the neighbour on the right, and below; 0 at the end."""
    right, down = np.zeros_like(picture), np.zeros_like(picture)
    np.subtract(picture[:, 1:], picture[:, :-1], out=right[:, :-1])
    np.subtract(picture[1:], picture[:-1], out=down[:-1])
    return right, down


def _undifferences(right: Values, down: Values) -> Values:
    """The transpose of the differences."""
    picture = -right - down
    picture[:, 1:] += right[:, :-1]
    picture[1:] += down[:-1]
    return picture


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
