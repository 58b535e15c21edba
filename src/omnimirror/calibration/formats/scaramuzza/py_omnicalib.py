"""py-omnicalib YAML: Scaramuzza's polynomial with Z towards the scene, its inverse, and the centre.

Pixels are square and the image is rotationally symmetric: there is no affine matrix. The file
does not contain the image size; this module adds ``image_size``, which py-omnicalib ignores.
"""

from __future__ import annotations

import numpy as np

from ....cameras.models import OCam
from ....cameras.models.consistency import inverse_doubts
from ..base import CameraFile, CameraFormat, Layout, Reading, Stored, row
from .matlab import Taylor, ocam_of, taylor_of
from .ocamcalib import MOST_TERMS, inverse_polynomial

INVERSE = "poly_incident_angle_to_radius"
PLACES = frozenset({"cx", "cy", *(f"a{power}" for power in range(MOST_TERMS))})


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of a ``calibration.yml``, without poses."""
    table = file.entries
    coefficients = np.array(table["poly_radius_to_z"].numbers())
    u, v = table["principal_point"].numbers(2)
    camera = ocam_of(Taylor(coefficients, (u, v), np.eye(2)), reading.size_in(table, "image_size"), reading)
    inverse = table[INVERSE].numbers() if INVERSE in table else ()
    return [Stored("", camera, tuple(inverse_doubts(camera, inverse, 0.0)))]


def write(camera: OCam, name: str = "") -> str:
    """Return the text of a ``calibration.yml``, without poses."""
    taylor = taylor_of(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    width, height = camera.image_size
    return (
        "extrinsics: []\n"
        f"{INVERSE}: [{row(inverse)}]\n"
        f"poly_radius_to_z: [{row(taylor.coefficients)}]\n"
        f"principal_point: [{row(taylor.centre_px)}]\n"
        f"image_size: [{width}, {height}]\n"
    )


FORMAT = CameraFormat(
    "py-omnicalib YAML",
    lambda file: file.has("poly_radius_to_z"),
    read,
    {"py-omnicalib": Layout(OCam, write, "Scaramuzza's polynomial of a round picture", PLACES)},
)
