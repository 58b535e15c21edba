"""Zarr v3 outputs: an array (time, VIEW_y, VIEW_x, channel) per view, chunked in time.

The groups are in ``images.zarr`` below the output URL, one per camera if there are several, and
open with ``xarray.open_zarr(url, consolidated=False)``. Chunks are written by one block
each and need no locks.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from typing import Any

from ...base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from .job import BatchJob
from .stores import join_url

ARRAYS = "images.zarr"
"""Name of the root group."""


def _zarr() -> Any:
    try:
        return import_module("zarr")
    except ImportError:
        raise OmnimirrorError(
            f"outputs in Zarr format require zarr: {extra_remedy('cluster')}"
        ) from None


def _options(job: BatchJob, url: str) -> dict[str, Any] | None:
    return dict(job.storage) if "://" in url else None


def open_group(job: BatchJob, name: str) -> Any:
    """Open a group of the output for writing."""
    url = join_url(job.output_url, name)
    return _zarr().open_group(url, mode="r+", storage_options=_options(job, url))


def prepare_group(
    job: BatchJob, name: str, count: int, sizes: Mapping[str, tuple[int, int]]
) -> None:
    """Create the arrays of a group, or change their length to a number of images.

    Parameters
    ----------
    job
        Job with Zarr output.
    name
        Name of the group: the root, or a group of a camera in it.
    count
        Number of images.
    sizes
        Size (width, height) of each view, px.

    Raises
    ------
    InvalidParameter
        If the group contains images of another size.
    """
    zarr = _zarr()
    for each in dict.fromkeys((ARRAYS, name)):
        url = join_url(job.output_url, each)
        group = zarr.open_group(url, mode="a", zarr_format=3, storage_options=_options(job, url))
    chunk = job.output.chunk
    for view, (width, height) in sizes.items():
        array = _array(
            group,
            view,
            shape=(count, height, width, 3),
            chunks=(chunk, height, width, 3),
            dtype="uint8",
            dimension_names=("time", f"{view}_y", f"{view}_x", "channel"),
        )
        if array.shape[1:] != (height, width, 3) or array.chunks[0] != chunk:
            raise InvalidParameter(
                f"{url} contains images of {array.shape[2]} x {array.shape[1]} px in chunks of "
                f"{array.chunks[0]}; the job has {width} x {height} px in chunks of {chunk}; "
                "use another output.url"
            )
        _resize(array, count)
    time = _array(
        group,
        "time",
        shape=(count,),
        chunks=(chunk,),
        dtype="float64",
        dimension_names=("time",),
        fill_value=float("nan"),
        attributes={"units": "seconds since 1970-01-01", "calendar": "proleptic_gregorian"},
    )
    valid = _array(
        group, "valid", shape=(count,), chunks=(chunk,), dtype="bool", dimension_names=("time",)
    )
    for array in (time, valid):
        _resize(array, count)


def _array(group: Any, name: str, **properties: Any) -> Any:
    if name in group:
        return group[name]
    try:
        return group.create_array(name, **properties)
    except (ValueError, OSError):  # another part created it
        return group[name]


def _resize(array: Any, count: int) -> None:
    """Change the number of images; those of removed inputs would remain valid at the end."""
    if array.shape[0] != count:
        array.resize((count, *array.shape[1:]))
