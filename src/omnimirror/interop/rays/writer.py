"""The formats of ray tables, and the one call that writes them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from ...arguments import checked
from ...cameras import Camera
from ..formats import Formats, HandedOver, hand_over, registry
from .arrays import NPZ
from .blender import BLENDER
from .exr import EXR
from .mitsuba import MITSUBA
from .newton import NEWTON
from .table import RayTable, ray_table

RAY_FORMATS: Formats[RayTable] = registry(
    "omnimirror.ray_formats",
    "a format of ray tables",
    {"exr": EXR, "npz": NPZ, "mitsuba": MITSUBA, "blender": BLENDER, "newton": NEWTON},
)
"""Every format of ray tables by the word that names it."""


@checked
def write_rays(
    camera: Camera, path: str | Path, *, formats: Iterable[str] | str | None = None, step: int = 1
) -> list[HandedOver]:
    """Write a camera's rays for other programs: all files, or none.

    Parameters
    ----------
    camera
        A sensor, aligned or not, or a calibrated camera.
    path
        A folder, or one file whose suffix says the format: .exr or .npz, or with ``formats`` the one that is named.
    formats : optional
        Of :data:`RAY_FORMATS`, for a folder.
    step
        Every n-th pixel only.

    Returns
    -------
    list of HandedOver
        The files of each format, what they hold and what is lost.

    Raises
    ------
    InvalidParameter
        A format or suffix that is not known, or a step outside the picture.
    OutsideField
        The picture shows nothing of the field.
    OmnimirrorError
        A package of ``omnimirror[interop]`` is missing, or a file cannot be written.

    Examples
    --------
    >>> import tempfile, numpy as np, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (done,) = om.write_rays(om.load_sensor("paper-spherical"), f"{folder}/rays.npz", step=16)
    ...     rays = np.load(done.paths[0])
    >>> rays["origins_mm"].shape, str(done.deviation)
    ((64, 64, 3), 'exact')
    """
    table = ray_table(camera, step)
    return hand_over(table, RAY_FORMATS, table.name, path, formats)
