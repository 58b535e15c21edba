"""py-omnicalib's YAML: Scaramuzza's polynomial with Z towards the scene, its inverse, and the centre.

Pixels are square and the picture is round: there is no affine matrix. The file does not say how large the picture is;
ours adds ``image_size``, which py-omnicalib passes over.
"""

from __future__ import annotations

import numpy as np

from ....camera_models import OCam
from ..base import CameraFormat, Layout, Reading, Stored, row, text_of
from ..entries import read_yaml
from .matlab import Taylor, ocam_of, taylor_of
from .ocamcalib import MOST_TERMS, inverse_polynomial

PLACES = frozenset({"cx", "cy", *(f"a{power}" for power in range(MOST_TERMS))})


def read(data: bytes, reading: Reading) -> list[Stored]:
    """The camera of a ``calibration.yml``, without the pictures' poses."""
    table = read_yaml(text_of(data, reading.source), reading.source)
    coefficients = np.array(table["poly_radius_to_z"].numbers())
    u, v = table["principal_point"].numbers(2)
    if "image_size" in table:
        if len(table["image_size"].entries()) != 2:
            table["image_size"].refuse("is valid as two numbers, width and height")
        width, height = (entry.whole() for entry in table["image_size"].entries())
    else:
        width, height = reading.size()
    return [Stored("", ocam_of(Taylor(coefficients, (u, v), np.eye(2)), (width, height), reading))]


def write(camera: OCam, name: str = "") -> str:
    """The text of a ``calibration.yml``, without the pictures' poses."""
    taylor = taylor_of(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    width, height = camera.image_size
    return (
        "extrinsics: []\n"
        f"poly_incident_angle_to_radius: [{row(inverse)}]\n"
        f"poly_radius_to_z: [{row(taylor.coefficients)}]\n"
        f"principal_point: [{row(taylor.centre_px)}]\n"
        f"image_size: [{width}, {height}]\n"
    )


FORMAT = CameraFormat(
    "py-omnicalib YAML",
    lambda name, data: b"poly_radius_to_z" in data,
    read,
    {"py-omnicalib": Layout(OCam, write, "Scaramuzza's polynomial of a round picture", PLACES)},
)
