"""OCamCalib ``calib_results.txt``: polynomial in the radius, its inverse, and an affine matrix.

The model is described in :mod:`omnimirror.cameras.models.ocam`. The direct polynomial may have
any degree; the inverse, which OCamCalib's ``world2cam`` uses for projection, is fitted when a
file is written.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
from numpy.polynomial import Polynomial

from ....base.typing import Array
from ....cameras.models import OCam
from ....cameras.models.consistency import inverse_doubts
from ....cameras.models.ocam import parse_polynomials
from ..base import CameraFile, CameraFormat, Layout, Reading, Stored, row

CLOSE_PX = 0.01  # tolerance of the inverse polynomial, as in OCamCalib's findinvpoly
MOST_TERMS = 30
SAMPLES = 2000


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of a ``calib_results.txt``."""
    camera, inverse = parse_polynomials(file.text, reading.source)
    camera = replace(camera, **reading.told)
    return [Stored("", camera, tuple(inverse_doubts(camera, inverse)))]


def write(camera: OCam, name: str = "") -> str:
    """Return the text of a ``calib_results.txt``."""
    (u, v), (width, height) = camera.centre_px, camera.image_size
    inverse, _ = inverse_polynomial(camera, np.pi / 2)
    return (
        "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). "
        "These are used by cam2world\n\n"
        f"{len(camera.polynomial)} {row(camera.polynomial, ' ')}\n\n"
        "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). "
        "These are used by world2cam\n\n"
        f"{len(inverse)} {row(inverse, ' ')}\n\n"
        '#center: "row" and "column", starting from 0 (C convention)\n\n'
        f"{row((v, u), ' ')}\n\n"
        '#affine parameters "c", "d", "e"\n\n'
        f"{row(camera.affine, ' ')}\n\n"
        '#image size: "height" and "width"\n\n'
        f"{height} {width}\n"
    )


def inverse_polynomial(camera: OCam, start: float) -> tuple[Array, float]:
    """Return the radius in px as a polynomial of the field angle minus ``start``.

    Coefficients are in order of increasing powers.

    The degree is increased until the error is below :data:`CLOSE_PX`, as in OCamCalib's
    ``findinvpoly``.

    Parameters
    ----------
    camera
        Camera to approximate.
    start : radians
        Field angle of the origin: OCamCalib counts from the plane across the axis, py-OCamCalib
        from the axis.

    Returns
    -------
    (n,) array, px; and the largest error, px
    """
    omega = np.linspace(0.0, camera.omega_max, SAMPLES)
    radius = camera.radius_from_omega(omega)
    coefficients, error = np.zeros(1), np.inf
    for terms in range(2, MOST_TERMS + 1):
        fitted = Polynomial.fit(omega - start, radius, terms - 1)
        coefficients = np.asarray(fitted.convert().coef, dtype=float)
        error = float(np.abs(Polynomial(coefficients)(omega - start) - radius).max())
        if error < CLOSE_PX:
            break
    return coefficients, error


def recognises(file: CameraFile) -> bool:
    """Check that the first non-empty line is a count followed by that many numbers."""
    for line in file.data[:4000].decode("utf-8-sig", "replace").splitlines():
        words = line.split("#")[0].split()
        if words:
            return bool(re.fullmatch(r"\d{1,3}", words[0])) and len(words) == int(words[0]) + 1
    return False


FORMAT = CameraFormat(
    "OCamCalib calib_results.txt",
    recognises,
    read,
    {"ocamcalib": Layout(OCam, write, "Scaramuzza's polynomial")},
    ("calib_results*.txt",),
)
