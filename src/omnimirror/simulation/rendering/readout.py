"""Readout of a detector during exposure, which avoids storing the light of the whole image."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ...base.colour import Light
from ..detector import Detector, Electrons, kept_by, numbers_of
from .tiles import Medium


class Readout:
    """Detector readout of one image, identical to :meth:`Detector.read` of its light.

    Parameters
    ----------
    detector
    seed
        Random seed of the noise.

    Examples
    --------
    >>> import numpy as np
    >>> detector, light = Detector(full_well_e=10_000.0, bayer="RGGB"), np.full((3, 4, 3), 0.25, np.float32)
    >>> readout = Readout(detector, seed=1)
    >>> taken = np.concatenate([readout.medium.read(light[:1]), readout.medium.read(light[1:])])
    >>> bool((readout.numbers(taken) == detector.read(light, seed=1)).all())
    True
    """

    def __init__(self, detector: Detector, seed: int = 0) -> None:
        self._detector = detector
        self._electrons = Electrons(detector, seed) if detector.counts else None
        self._rows = 0

    @property
    def medium(self) -> Medium:
        """Medium that receives the light."""
        detector, electrons = self._detector, self._electrons
        if detector.is_of_values:
            return Medium(detector.dtype, detector.read)
        dtype = detector.dtype if electrons is None else electrons.dtype
        return Medium(dtype, self._read, in_order=True, is_grey=detector.bayer != "none")

    def _read(self, light: Light) -> NDArray[Any]:
        kept = kept_by(self._detector, light, self._rows)
        self._rows += len(light)
        return numbers_of(self._detector, kept) if self._electrons is None else self._electrons.counted(kept)

    def numbers(self, taken: NDArray[Any]) -> NDArray[Any]:
        """Return the values of the image recorded on :attr:`medium`, possibly in its memory."""
        return taken if self._electrons is None else self._electrons.read(taken)
