"""The imager's electronics: light into numbers, with the noise of photons and of reading out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..parameters import Parameter
from .colour import Light, srgb_from_linear

BAYER = ("none", "RGGB", "BGGR", "GRBG", "GBRG")
CURVES = ("srgb", "linear")


@dataclass(frozen=True)
class Detector:
    """How an imager turns light into numbers; by default without noise, to sRGB in 8 bits.

    Parameters
    ----------
    exposure
        Multiplies the light; what then is above 1 saturates.
    full_well_e
        Electrons of a pixel at saturation. Infinite: light is not counted, and there is no noise.
    read_noise_e
        Standard deviation of the noise of reading out, electrons; only with a full well.
    bits
        8 to 16; more than 8 are kept in uint16, from 0 to 2^bits - 1.
    curve
        ``"srgb"``, as pictures are shown, or ``"linear"``, as imagers count.
    bayer
        Colours of the first two rows, such as ``"RGGB"``: each pixel keeps one colour, and nothing is
        interpolated. ``"none"``: every pixel has all three.

    Raises
    ------
    InvalidParameter
        A value outside its range, or read noise without a full well.

    Examples
    --------
    >>> grey = np.full((200, 200, 3), 0.25, np.float32)
    >>> Detector().read(grey)[0, 0]
    array([137, 137, 137], dtype=uint8)
    >>> raw = Detector(full_well_e=10_000.0, bits=12, curve="linear", bayer="RGGB").read(grey, seed=1)
    >>> raw.shape, raw.dtype, round(float(raw.mean()), -1)
    ((200, 200), dtype('uint16'), 1020.0)
    >>> round(float(raw.std()), 0)  # 50 of 2500 electrons
    20.0
    """

    exposure: float = 1.0
    full_well_e: float = np.inf
    read_noise_e: float = 0.0
    bits: int = 8
    curve: str = "srgb"
    bayer: str = "none"

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "exposure": Parameter("", 1e-9, 1e9, "factor of the light"),
        "full_well_e": Parameter("electrons", 10.0, np.inf, "electrons at saturation"),
        "read_noise_e": Parameter("electrons", 0.0, 1e6, "noise of reading out"),
        "bits": Parameter("", 8, 16, "bits of a value"),
        "curve": Parameter("", 0, 0, "of the values", CURVES),
        "bayer": Parameter("", 0, 0, "colours of the first two rows", BAYER),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if int(self.bits) != self.bits:
            raise InvalidParameter(f"bits = {self.bits} is not a whole number from 8 to 16")
        if self.read_noise_e and not np.isfinite(self.full_well_e):
            raise InvalidParameter(
                f"read_noise_e = {self.read_noise_e:g} is counted in electrons; say how many fill a pixel, full_well_e"
            )

    def read(self, light: Light, seed: int = 0) -> NDArray[Any]:
        """Numbers of linear light (h, w, 3): (h, w, 3) in RGB order, or (h, w) of a Bayer mosaic.

        Parameters
        ----------
        light
        seed
            Of the noise.
        """
        signal = self.exposure * (light if self.bayer == "none" else mosaic(light, self.bayer))
        if np.isfinite(self.full_well_e):
            signal = noisy(signal, self.full_well_e, self.read_noise_e, seed)
        signal = np.clip(signal, 0, 1)
        shown = srgb_from_linear(signal) if self.curve == "srgb" else signal
        numbers: NDArray[Any] = np.rint((2**self.bits - 1) * shown).astype(np.uint8 if self.bits == 8 else np.uint16)
        return numbers


def noisy(light: Light, full_well_e: float, read_noise_e: float, seed: int) -> Light:
    """Light, saturated at 1, as electrons count it: their number is Poisson's, and reading adds Gauss's noise."""
    chance = np.random.default_rng(seed)
    electrons = chance.poisson(np.clip(light, 0, None).astype(float) * full_well_e).astype(float)
    np.minimum(electrons, full_well_e, out=electrons)
    electrons += read_noise_e * chance.standard_normal(electrons.shape)
    return (electrons / full_well_e).astype(np.float32)


def mosaic(light: Light, bayer: str) -> Light:
    """The one colour (h, w) that each pixel keeps.

    >>> mosaic(np.tile(np.float32([1, 2, 3]), (2, 4, 1)), "RGGB")
    array([[1., 2., 1., 2.],
           [2., 3., 2., 3.]], dtype=float32)
    """
    kept = np.empty(light.shape[:2], np.float32)
    for place, colour in enumerate(bayer):
        row, column = divmod(place, 2)
        kept[row::2, column::2] = light[row::2, column::2, "RGB".index(colour)]
    return kept
