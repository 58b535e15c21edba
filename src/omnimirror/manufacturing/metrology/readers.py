"""Readers of measurement files: point lists, grids of heights, and formats of measuring
instruments.
"""

from __future__ import annotations

from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Literal

import numpy as np

from ...base.arguments import file_name, validate_arguments
from ...base.errors import OmnimirrorError, extra_remedy
from ...base.files import check_file, open_file, read_text
from ...base.typing import Array
from ...optics.mirrors.measured import grid_points, parsed_points

Unit = Literal["mm", "um", "m", "inch"]
MM: dict[str, float] = {"mm": 1.0, "um": 1e-3, "m": 1e3, "inch": 25.4}
CLOUDS = (".csv", ".txt", ".xyz", ".asc", ".pts", ".tsv")
"""Suffixes of point lists x, y, z."""
MACHINES = (
    ".x3p",
    ".datx",
    ".dat",
    ".opd",
    ".opdx",
    ".sur",
    ".plu",
    ".plux",
    ".al3d",
    ".zmg",
    ".sdf",
    ".nms",
)
"""Suffixes of instrument formats; .dat is Zygo MetroPro, or a grid sag file if it is text."""
MAX_MACHINE_FILE_BYTES = 256 << 20
"""Maximum size of a file and of its decompressed content, bytes."""
MAX_GRID_POINTS = 20_000_000
"""Maximum number of points of a grid, which require about 2 GB of memory."""
BEGINNING = 512  # bytes for the detection of text files


@validate_arguments
def read_points(path: str | Path, unit: Unit = "mm") -> Array:
    """Read points of a surface in mm from a measurement file.

    Values may be separated by blanks, tabs, semicolons or commas, use decimal points or commas, and
    exponents with E or D; row numbers and labels are accepted. Lines before the first row are a header.
    If it names x, y and z, these columns are used; otherwise the first three, or two for a profile.

    Parameters
    ----------
    path
        Rows of x, y, z, or of x, z for a profile (.csv, .txt, .xyz, ...), an OpticStudio grid sag
        (.dat), or an instrument file (ISO 25178-72 .x3p, Zygo .dat and .datx, Bruker .opd, ...; these
        require the package SurfaceTopography).
    unit
        Unit of point lists: mm, um, m or inch. Other formats contain their unit.

    Returns
    -------
    (n, 3) array, or (n, 2) for a profile
        Valid points.

    Raises
    ------
    OmnimirrorError
        If the file is missing, has an unknown format or another unit, or its package is not installed.

    Examples
    --------
    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(f"{folder}/a.xyz").write_text("1000 2000 3\\n1500 2000 4\\n")
    ...     read_points(f"{folder}/a.xyz", "um")
    array([[1.   , 2.   , 0.003],
           [1.5  , 2.   , 0.004]])
    """
    path = file_name("path", path)
    suffix = path.suffix.lower()
    if suffix in CLOUDS:
        return MM[unit] * parsed_points(read_text(path, "points"), path, unit)
    if suffix in MACHINES:
        try:
            check_file(path, MAX_MACHINE_FILE_BYTES, MAX_MACHINE_FILE_BYTES)
            is_grid = suffix == ".dat" and _is_text(path)
        except OSError as e:
            raise OmnimirrorError(f"cannot read the points {path}: {e.strerror or e}") from None
        return grid_points(path) if is_grid else _of_machine(path)
    raise OmnimirrorError(f"{path} must have one of the suffixes {', '.join((*CLOUDS, *MACHINES))}")


def _is_text(path: Path) -> bool:
    with open_file(path, MAX_MACHINE_FILE_BYTES) as file:
        return file.read(BEGINNING).isascii()


def _of_machine(path: Path) -> Array:
    """Read a grid of heights with SurfaceTopography after a check of its size."""
    if find_spec("SurfaceTopography") is None:
        raise OmnimirrorError(
            f"{path.suffix} files require SurfaceTopography: {extra_remedy('metrology')}"
        )
    from SurfaceTopography.IO import open_topography

    try:
        with open_topography(str(path)) as reader:
            count = prod(map(int, reader.default_channel.nb_grid_pts))
            if count > MAX_GRID_POINTS:
                raise OmnimirrorError(
                    f"{path} must not have more than {MAX_GRID_POINTS} points; got {count}; reduce its resolution"
                )
            x, y, z = reader.topography().to_unit("mm").positions_and_heights()
    except OmnimirrorError:
        raise
    except Exception as e:  # no common exception type
        raise OmnimirrorError(
            f"{path} cannot be read: {str(e).splitlines()[0] if str(e) else type(e).__name__}"
        ) from None
    z = np.ma.filled(np.ma.asarray(z, dtype=float), np.nan)
    points = np.stack(
        [np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1
    ).reshape(-1, 3)
    return np.asarray(points[np.isfinite(points).all(axis=1)])
