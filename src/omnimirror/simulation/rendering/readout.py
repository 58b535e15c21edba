"""A detector that reads light as it falls, so that the light is never there as a whole."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from ...base.colour import Light
from ..detector import Detector, Electrons, kept_by, numbers_of
from .tiles import Medium


class Readout:
    """What a detector makes of one picture's light, the same as :meth:`Detector.read` of all of it.

    Parameters
    ----------
    detector
    seed
        Of the noise.

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
        """What the light falls on."""
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
        """The picture's numbers, of what was taken on :attr:`medium`, whose memory they may use."""
        return taken if self._electrons is None else self._electrons.read(taken)
