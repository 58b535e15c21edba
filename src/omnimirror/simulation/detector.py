"""The imager's electronics: light into numbers, with the noise of photons and of reading out."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import check_fields
from ..base.colour import Light, srgb_from_linear, stretches
from ..base.errors import InvalidParameter
from ..base.parameters import Parameter

BAYER = ("none", "RGGB", "BGGR", "GRBG", "GBRG")
CURVES = ("srgb", "linear")
MOST_ELECTRONS = 1e9  # a thousand times what pixels hold
DARK_DEVIATIONS = 5  # of the noise of reading, from the black level to 0
BEYOND = 20  # deviations past white are white for certain


@dataclass(frozen=True)
class Detector:
    """How an imager turns light into numbers; by default without noise, to sRGB in 8 bits.

    Parameters
    ----------
    exposure
        Multiplies the light; what then is above 1 saturates.
    full_well_e
        Electrons that light of 1 sets free in a pixel, which fill the range of values. Infinite: light is not counted,
        and there is no noise.
    read_noise_e
        Standard deviation of the noise of reading out, electrons; only with a full well.
    black_level_dn
        Added to linear values (EMVA 1288's dark offset), so that noise in the dark is not cut off at 0; by default
        five standard deviations of the noise of reading, :attr:`offset_dn`. From sRGB values it has been taken away,
        as cameras do, and what lies below it is black.
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

    Notes
    -----
    The linear model of EMVA 1288: of ``K = (2^bits - 1)/full_well_e`` values per electron, the mean of mu electrons is
    ``K mu + offset`` and the variance ``K^2 (mu + read_noise_e^2) + 1/12``. Values end at 0 and ``2^bits - 1``, after
    all noise is added.

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
    black_level_dn: float | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "exposure": Parameter("", 1e-9, 1e9, "factor of the light"),
        "full_well_e": Parameter("electrons", 10.0, MOST_ELECTRONS, "electrons at saturation"),
        "read_noise_e": Parameter("electrons", 0.0, 1e6, "noise of reading out"),
        "black_level_dn": Parameter("DN", 0.0, 65535.0, "what is added to linear values"),
        "bits": Parameter("", 8, 16, "bits of a value"),
        "curve": Parameter("", 0, 0, "of the values", CURVES),
        "bayer": Parameter("", 0, 0, "colours of the first two rows", BAYER),
    }

    def __post_init__(self) -> None:
        check_fields(self)
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None and not (f.name == "full_well_e" and value == np.inf):
                self.PARAMETERS[f.name].check(f.name, value)
        if int(self.bits) != self.bits:
            raise InvalidParameter(f"bits = {self.bits} is not a whole number from 8 to 16")
        if self.read_noise_e and not np.isfinite(self.full_well_e):
            raise InvalidParameter(
                f"read_noise_e = {self.read_noise_e:g} is counted in electrons; say how many fill a pixel, full_well_e"
            )
        if self.black_level_dn and self.curve != "linear":
            raise InvalidParameter(
                f"black_level_dn = {self.black_level_dn:g} belongs to values as imagers count; take the curve linear"
            )
        if self.offset_dn > self.largest_dn / 2:
            raise InvalidParameter(
                f"a black level of {self.offset_dn:g} DN leaves little of values that end at {self.largest_dn}; valid "
                f"are black_level_dn up to {self.largest_dn // 2} and a read_noise_e that needs no more"
            )

    @property
    def largest_dn(self) -> int:
        """The largest value, at which all saturate."""
        return int(2**self.bits - 1)

    @property
    def dtype(self) -> type[np.uint8 | np.uint16]:
        """Of its numbers."""
        return np.uint8 if self.bits == 8 else np.uint16

    @property
    def offset_dn(self) -> float:
        """The black level of linear values: as given, or five standard deviations of the noise of reading, rounded up.

        >>> Detector(full_well_e=10_000, read_noise_e=5, bits=12, curve="linear").offset_dn  # 2.05 DN each
        11.0
        """
        if self.black_level_dn is not None:
            return self.black_level_dn
        if self.curve != "linear":
            return 0.0
        return float(np.ceil(DARK_DEVIATIONS * self.read_noise_e / self.full_well_e * self.largest_dn))

    @property
    def counts(self) -> bool:
        """Whether light is counted as electrons, and so is noisy."""
        return bool(np.isfinite(self.full_well_e))

    @property
    def is_of_values(self) -> bool:
        """Whether each number is that of one value of light alone: nothing is drawn, and no colour left out."""
        return self.bayer == "none" and not self.counts

    def read(self, light: Light, seed: int = 0) -> NDArray[Any]:
        """Numbers of linear light (h, w, 3): (h, w, 3) in RGB order, or (h, w) of a Bayer mosaic.

        Parameters
        ----------
        light : (h, w, 3)
            Linear RGB, 1 at saturation of an exposure of 1.
        seed
            Of the noise.

        Returns
        -------
        (h, w, 3) or (h, w) array, uint8 or uint16
            RGB, or the Bayer mosaic.

        Raises
        ------
        InvalidParameter
            For light that is no picture or holds NaN, or a seed that is no whole number from 0 on.
        """
        kept = kept_by(self, light)
        if not self.counts:
            return numbers_of(self, kept)
        electrons = Electrons(self, seed)
        return electrons.read(electrons.counted(kept))


def kept_by(detector: Detector, light: Light, first_row: int = 0) -> Light:
    """What pixels keep of light (h, w, 3) whose first row is that row of the picture: the colour of a mosaic, or all.

    Raises
    ------
    InvalidParameter
        For light that is no picture or holds NaN.
    """
    light = _checked(light)
    if detector.bayer == "none":
        return light
    return mosaic(light, detector.bayer[2:] + detector.bayer[:2] if first_row % 2 else detector.bayer)


def numbers_of(detector: Detector, light: Light) -> NDArray[Any]:
    """The numbers of what pixels keep of light, in an array of its shape, without noise."""
    numbers: NDArray[Any] = np.empty(light.shape, detector.dtype)
    signals, read = light.reshape(-1), numbers.reshape(-1)
    for part in stretches(light.size):
        read[part] = _rounded(detector, detector.exposure * signals[part])
    return numbers


def _rounded(detector: Detector, signal: Light) -> Light:
    shown = srgb_from_linear(signal) if detector.curve == "srgb" else signal
    values: Light = np.rint(detector.largest_dn * shown + np.float32(detector.offset_dn))
    return np.clip(values, 0, detector.largest_dn)


class Electrons:
    """Exposed light as electrons count it: their number is Poisson's, and reading adds Gauss's noise.

    A seed's numbers are drawn pixel by pixel, those of all photons before those of reading, so that light may come in
    parts as long as they follow each other. What is far beyond white is counted as if it were less far, which no value
    shows.

    Parameters
    ----------
    detector
        With a full well.
    seed

    Raises
    ------
    InvalidParameter
        For a seed that is no whole number from 0 on.
    """

    def __init__(self, detector: Detector, seed: int) -> None:
        if not (seed >= 0 and int(seed) == seed):
            raise InvalidParameter(f"seed = {seed} is not a whole number from 0 on")
        self.detector = detector
        self._chance = np.random.default_rng(int(seed))
        full, noise = detector.full_well_e, detector.read_noise_e
        self._most = full + BEYOND * (np.sqrt(full) + noise + 1)

    @property
    def dtype(self) -> type[np.uint16 | np.uint32]:
        """That holds all counts, those beyond the most by chance too."""
        return np.uint16 if self._most + BEYOND * np.sqrt(self._most) < 2**16 else np.uint32

    def counted(self, light: Light) -> NDArray[Any]:
        """The electrons that light sets free, in an array of its shape."""
        electrons: NDArray[Any] = np.empty(light.shape, self.dtype)
        values, counts = light.reshape(-1), electrons.reshape(-1)
        for part in stretches(light.size):
            exposed = (self.detector.exposure * values[part]).astype(float)
            counts[part] = self._chance.poisson(np.clip(exposed * self.detector.full_well_e, 0, self._most))
        return electrons

    def read(self, electrons: NDArray[Any]) -> NDArray[Any]:
        """The numbers of electrons (an array of its own), in its memory; what of it they do not need is given back."""
        counts, detector, shape = electrons.reshape(-1), self.detector, electrons.shape
        numbers = counts.view(detector.dtype)[: counts.size]
        for part in stretches(counts.size):
            noise = detector.read_noise_e * self._chance.standard_normal(part.stop - part.start)
            signal = ((counts[part] + noise) / detector.full_well_e).astype(np.float32)
            numbers[part] = _rounded(detector, signal)
        size, needed = counts.size, -(-numbers.nbytes // counts.itemsize)
        electrons.resize(needed, refcheck=False)  # the two views of it above are not looked at any more
        return electrons.view(detector.dtype)[:size].reshape(shape)


def _checked(light: Light) -> Light:
    light = np.asarray(light)
    if light.ndim != 3 or light.shape[2] != 3 or light.dtype.kind not in "fiu":
        raise InvalidParameter(f"light is numbers (rows, columns, 3), not {light.shape} of {light.dtype}")
    if any(np.isnan(row).any() for row in light):
        raise InvalidParameter("light holds NaN; it is valid from 0 on")
    return light


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
