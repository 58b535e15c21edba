"""Files of measuring machines: points by the line, grids of heights, and what interferometers and profilers write."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..arguments import checked, file_name
from ..errors import OmnimirrorError
from ..files import read_text
from ..mirrors.measured.clouds import grid_points
from ..mirrors.measured.point_rows import parsed_points

Array = NDArray[np.float64]

Unit = Literal["mm", "um", "m", "inch"]
MM: dict[str, float] = {"mm": 1.0, "um": 1e-3, "m": 1e3, "inch": 25.4}
CLOUDS = (".csv", ".txt", ".xyz", ".asc", ".pts", ".tsv")
"""Suffixes of points by the line, x, y, z."""
MACHINES = (".x3p", ".datx", ".dat", ".opd", ".opdx", ".sur", ".plu", ".plux", ".al3d", ".zmg", ".sdf", ".nms")
"""Suffixes of grids of heights by machines; .dat is Zygo's MetroPro, or a grid sag file if it is text."""
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
    if suffix == ".dat" and _is_text(path):
        return grid_points(path)
    if suffix in MACHINES:
        return _of_machine(path)
    raise OmnimirrorError(f"{path} is no file of points that is known; valid are {', '.join((*CLOUDS, *MACHINES))}")


def _is_text(path: Path) -> bool:
    try:
        with path.open("rb") as file:
            return file.read(BEGINNING).isascii()
    except OSError:
        read_text(path, "points")  # says why
        raise


def _of_machine(path: Path) -> Array:
    if find_spec("SurfaceTopography") is None:
        raise OmnimirrorError(f"{path.suffix} files need SurfaceTopography: pip install 'omnimirror[metrology]'")
    if not path.is_file():
        raise OmnimirrorError(f"cannot read points {path}: there is no such file")
    from SurfaceTopography import read_topography

    try:
        grid = read_topography(str(path)).to_unit("mm")
        x, y, z = grid.positions_and_heights()
    except Exception as e:  # it names no common kind of its own
        raise OmnimirrorError(
            f"{path} cannot be read: {str(e).splitlines()[0] if str(e) else type(e).__name__}"
        ) from None
    z = np.ma.filled(np.ma.asarray(z, dtype=float), np.nan)
    points = np.stack([np.broadcast_to(x, z.shape), np.broadcast_to(y, z.shape), z], axis=-1).reshape(-1, 3)
    return np.asarray(points[np.isfinite(points).all(axis=1)])
