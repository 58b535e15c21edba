"""py-OCamCalib JSON: Scaramuzza's polynomial, its inverse, centre and stretch matrix.

Z points towards the scene.

The conventions are those of its ``cam2world``. If the matrix's third element e is not 0, its
``world2cam`` inserts the already stretched column into the row equation, and differs from
``cam2world`` by ``e (c - 1)`` times the distance. The file does not contain the image size; this
module adds ``image_size``, which py-OCamCalib ignores.
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
    """Read the camera of a calibration file."""
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
    """Return the text of a calibration file, without poses."""
    taylor = taylor_of(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    scale = 1.0 / taylor.stretch[0, 0]  # to the symmetric image of py-OCamCalib
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
