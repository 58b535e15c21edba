"""MultiCol-SLAM camera YAML: OCamCalib's polynomials as ``Camera.a0 ...`` and ``Camera.pol0 ...``.

The affine matrix applies to (x, y): ``u = c X + d Y + u0``, ``v = e X + Y + v0``. The format is
read-only.
"""

from __future__ import annotations

import numpy as np

from ....cameras.models.consistency import inverse_doubts
from ..base import CameraFile, CameraFormat, Reading, Stored
from .matlab import Taylor, ocam_of


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of the file."""
    table = file.entries
    c, d, e, u, v = (table[f"Camera.{name}"].number() for name in ("c", "d", "e", "u0", "v0"))
    size = reading.size() if "Camera.Iw" not in table else (table["Camera.Iw"].whole(), table["Camera.Ih"].whole())
    direct = -np.array(table.polynomial("Camera.a"))
    camera = ocam_of(Taylor(direct, (u, v), np.array([[c, d], [e, 1.0]])), size, reading)
    inverse = table.polynomial("Camera.pol") if "Camera.pol0" in table else ()
    return [Stored("", camera, tuple(inverse_doubts(camera, c * np.array(inverse))))]


FORMAT = CameraFormat("MultiCol-SLAM YAML", lambda file: file.has("Camera.a0", "Camera.c"), read, {})
