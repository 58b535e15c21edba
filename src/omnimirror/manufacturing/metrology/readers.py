"""Files of measuring machines: points by the line, grids of heights, and what interferometers and profilers write."""

from __future__ import annotations

from importlib.util import find_spec
from math import prod
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ...arguments import checked, file_name
from ...errors import OmnimirrorError
from ...files import check_file, open_file, read_text
from ...mirrors.measured.clouds import grid_points
from ...mirrors.measured.point_rows import parsed_points

Array = NDArray[np.float64]

Unit = Literal["mm", "um", "m", "inch"]
MM: dict[str, float] = {"mm": 1.0, "um": 1e-3, "m": 1e3, "inch": 25.4}
CLOUDS = (".csv", ".txt", ".xyz", ".asc", ".pts", ".tsv")
"""Suffixes of points by the line, x, y, z."""
MACHINES = (".x3p", ".datx", ".dat", ".opd", ".opdx", ".sur", ".plu", ".plux", ".al3d", ".zmg", ".sdf", ".nms")
"""Suffixes of grids of heights by machines; .dat is Zygo's MetroPro, or a grid sag file if it is text."""
LARGEST_MACHINE_FILE = 256 << 20
"""Bytes of a file, and of what is packed in it."""
MOST_GRID_POINTS = 20_000_000
"""Points of a grid of heights, which take about 2 GB of memory."""
BEGINNING = 512  # bytes that tell text from numbers


@checked
def read_points(path: str | Path, unit: Unit = "mm") -> Array:
    """Read points of a surface, mm, from the file of a measuring machine.

    Rows may be separated by blanks, tabs, semicolons or commas, have decimal points or commas, exponents with E or D,
    and hold row numbers and labels. Lines before the first row are a header; if it names x, y and z, these columns are
    taken, otherwise the first three, or two of a profile.

    Parameters
    ----------
    path
        Rows of x, y, z, or of x, z of a profile (.csv, .txt, .xyz, ...), an OpticStudio grid sag (.dat), or a
        file of a machine (ISO 25178-72 .x3p, Zygo .dat and .datx, Bruker .opd, ...; by the package SurfaceTopography).
    unit
        Of points by the line: mm, um, m or inch. The other files say theirs.

    Returns
    -------
    (n, 3) array, or (n, 2) of a profile
        Without the places where nothing was measured.

    Raises
    ------
    OmnimirrorError
        The file is missing, is none of these, names another unit, or its package is not installed.

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
            check_file(path, LARGEST_MACHINE_FILE, LARGEST_MACHINE_FILE)
            is_grid = suffix == ".dat" and _is_text(path)
        except OSError as e:
            raise OmnimirrorError(f"cannot read the points {path}: {e.strerror or e}") from None
        return grid_points(path) if is_grid else _of_machine(path)
    raise OmnimirrorError(f"{path} is no file of points that is known; valid are {', '.join((*CLOUDS, *MACHINES))}")


def _is_text(path: Path) -> bool:
    with open_file(path, LARGEST_MACHINE_FILE) as file:
        return file.read(BEGINNING).isascii()


def _of_machine(path: Path) -> Array:
    """Read a grid of heights with SurfaceTopography; its size is checked before the heights are read."""
    if find_spec("SurfaceTopography") is None:
        raise OmnimirrorError(f"{path.suffix} files need SurfaceTopography: pip install 'omnimirror[metrology]'")
    from SurfaceTopography.IO import open_topography

    try:
        with open_topography(str(path)) as reader:
            count = prod(map(int, reader.default_channel.nb_grid_pts))
            if count > MOST_GRID_POINTS:
                raise OmnimirrorError(
                    f"{path} must not have more than {MOST_GRID_POINTS} points; got {count}; reduce its resolution"
                )
            x, y, z = reader.topography().to_unit("mm").positions_and_heights()
    except OmnimirrorError:
        raise
    except Exception as e:  # it names no common kind of its own
        raise OmnimirrorError(
            f"{path} cannot be read: {str(e).splitlines()[0] if str(e) else type(e).__name__}"
        ) from None
    z = np.ma.filled(np.ma.asarray(z, dtype=float), np.nan)
    points = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1).reshape(-1, 3)
    return np.asarray(points[np.isfinite(points).all(axis=1)])
