"""py-OCamCalib's JSON: Scaramuzza's polynomial with Z towards the scene, its inverse, a centre and a stretch matrix.

Its ``cam2world`` is followed. Where the matrix's third number e is not 0, its ``world2cam`` puts the column that it
has stretched already into the row, and so differs from its own ``cam2world`` by ``e (c - 1)`` of the distance. The file
does not say how large the picture is; ours adds ``image_size``, which py-OCamCalib passes over.
"""

from __future__ import annotations

import json

import numpy as np

from ....cameras.models import OCam
from ....cameras.models.consistency import inverse_doubts
from ..base import CameraFile, CameraFormat, Layout, Reading, Stored
from .matlab import Taylor, ocam_of, taylor_of
from .ocamcalib import inverse_polynomial


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """The camera of a calibration file."""
    table = file.entries
    coefficients = np.array(table["taylor_coefficient"].numbers())
    u, v = table["distortion_center"].numbers(2)
    stretch = table["stretch_matrix"].matrix(2, 2)
    if "image_size" in table and len(table["image_size"].entries()) == 2:
        width, height = (entry.whole() for entry in table["image_size"].entries())
    else:
        width, height = reading.size()
    name = table["camera_name"].word() if "camera_name" in table else ""
    camera = ocam_of(Taylor(coefficients, (u, v), stretch), (width, height), reading)
    inverse = table["inverse_poly"].numbers() if "inverse_poly" in table else ()
    return [Stored(name, camera, tuple(inverse_doubts(camera, stretch[0, 0] * np.array(inverse[::-1]), 0.0)))]


def write(camera: OCam, name: str = "") -> str:
    """The text of a calibration file, without the pictures' poses."""
    taylor = taylor_of(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    scale = 1.0 / taylor.stretch[0, 0]  # the round picture of ours to theirs
    values = {
        "camera_name": name or "camera",
        "taylor_coefficient": taylor.coefficients.tolist(),
        "distortion_center": list(taylor.centre_px),
        "stretch_matrix": taylor.stretch.tolist(),
        "inverse_poly": (inverse * scale)[::-1].tolist(),
        "image_size": list(camera.image_size),
    }
    return json.dumps(values, indent=4) + "\n"


FORMAT = CameraFormat(
    "py-OCamCalib JSON",
    lambda file: file.has("taylor_coefficient"),
    read,
    {"py-ocamcalib": Layout(OCam, write, "Scaramuzza's polynomial")},
    (),
)
