"""Common code of sampler tests: available instruction sets, and one-time sampling at given
positions."""

from __future__ import annotations

import numpy as np

from omnimirror.base.native import backend
from omnimirror.dewarp.maps import PixelMap
from omnimirror.dewarp.sampling import remap


def instructions() -> list[str]:
    """Return all instruction sets of this machine; empty without the compiled module."""
    if not backend.is_compiled:
        return []
    supported, before = [], backend.name
    for name in ("plain", "avx2", "avx512", "avx512-gather", "neon"):
        try:
            backend.kernels.set_instruction_set(name)
        except ValueError:
            continue
        supported.append(name)
    backend.kernels.set_instruction_set(before)
    return supported


def remap_at(image, positions, interpolation="linear", out=None, border=0) -> np.ndarray:
    """Return image values at positions (rows, columns, 2), by a temporary map."""
    return remap(image, PixelMap(positions, image.shape[1::-1]), interpolation, out, border)
