"""Samplers, and their common entry point: image and map to image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...base.errors import InvalidParameter
from ...base.native import backend
from ..contracts import KERNELS, Border, Image, Interpolation, Map, RemapJob, Sampler
from .borders import border_values
from .checks import MOST_VALUES, adjoining, adjoins, check_interpolation, check_kind, check_largest, checked_out
from .opencv import LONGEST_SIDE_PX, remap_opencv


@dataclass(frozen=True)
class CompiledSampler:
    """Sampler with the kernels in native/src/sampling, one per map type."""

    longest_side_px: int = MOST_VALUES

    def sample(self, job: RemapJob, where: Map) -> None:
        where.sample_compiled(job)


@dataclass(frozen=True)
class OpenCVSampler:
    """Sampler with OpenCV, which requires coordinates of all pixels."""

    longest_side_px: int = LONGEST_SIDE_PX

    def sample(self, job: RemapJob, where: Map) -> None:
        remap_opencv(job, where.pixels())


def sampler() -> Sampler:
    """Return the active sampler."""
    return CompiledSampler() if backend.is_compiled else OpenCVSampler()


def remap(
    image: Image, where: Map, interpolation: Interpolation = "linear", out: Image | None = None, border: Border = 0
) -> Image:
    """Interpolate an image at the coordinates of a map.

    Parameters
    ----------
    image : (h, w) or (h, w, c) array, uint8, uint16 or float32, c from 1 to 4
        Image of the map's ``source_size``, with any strides.
    where
        A :class:`~omnimirror.dewarp.maps.pixels.PixelMap`,
        :class:`~omnimirror.dewarp.maps.lattice.LatticeMap` or :class:`~omnimirror.dewarp.maps.polar.PolarMap`.
    interpolation
        ``"auto"``, ``"nearest"``, ``"linear"``, ``"cubic"`` or ``"area"``.
    out : (rows, columns) or (rows, columns, c) array of the same depth, optional
        Output array that is filled and returned; with any strides.
    border
        Value outside the image, for all channels or for each channel.

    Raises
    ------
    InvalidParameter
        If the arrays are inconsistent, or the border is not a valid image value.

    Examples
    --------
    >>> from omnimirror.dewarp.maps.pixels import PixelMap
    >>> picture = np.array([[0, 100], [0, 100]], np.uint8)
    >>> remap(picture, PixelMap(np.array([[[0.25, 0.5], [1.5, 0.0], [1.6, 0.0]]]), (2, 2)), border=7)
    array([[ 25, 100,   7]], dtype=uint8)
    """
    chosen = sampler()
    check_kind(image)
    check_interpolation(interpolation)
    check_largest(image, chosen.longest_side_px)
    if image.shape[1::-1] != tuple(where.source_size):
        raise InvalidParameter(
            f"the picture has another size than the map: {image.shape[1::-1]}, not {where.source_size}"
        )
    out = checked_out(out, image, where.size)
    whole = out if out.ndim == 3 else out[..., None]
    is_direct = adjoins(whole) and not np.may_share_memory(image, out)
    target = whole if is_direct else np.empty(whole.shape, whole.dtype)
    source = adjoining(image if image.ndim == 3 else image[..., None])
    averages = where.averages(interpolation)
    chosen.sample(RemapJob(source, target, KERNELS[interpolation], border_values(border, image), averages), where)
    if not is_direct:
        whole[...] = target
    return out
