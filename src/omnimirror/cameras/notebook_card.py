"""Notebook card of a calibrated camera."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ..base.html_card import Line, card, field_range, line_drawing, origin

if TYPE_CHECKING:
    from .models.base import CameraModel

RING_STEP_DEG = 30.0
RING_POINTS = 61
MAX_PARAMETERS = 12


def camera_card(camera: CameraModel) -> str:
    """Return an HTML card: rings of constant field angle, and parameters with deviations."""
    width, height = camera.image_size
    symmetry = camera.symmetry
    field = {} if symmetry is None else {"Field": field_range(symmetry.omega_min, symmetry.omega_max)}
    sigmas = camera.uncertainty.sigmas if camera.uncertainty else {}
    displayed = camera.parameters[:MAX_PARAMETERS]
    parameters = {p.name: f"{p.value:.6g}{_deviation(sigmas.get(p.name))} {p.unit}" for p in displayed}
    omitted = len(camera.parameters) - len(displayed)
    more = {f"{omitted} more parameters": ""} if omitted else {}
    head = {
        "Optics": camera.optics,
        **field,
        "Image": f"{width} × {height} px",
        "Camera looks": camera.mount.camera_looks,
    }
    drawing = line_drawing(
        list(_field_rings(camera)), f"Rings of the field every {RING_STEP_DEG:g} degrees in the image"
    )
    return card(
        camera.KIND,
        "calibrated camera",
        drawing,
        {**head, **parameters, **more},
        origin(getattr(camera, "notes", ""), len(sigmas)),
    )


def _deviation(sigma: float | None) -> str:
    return "" if sigma is None else f" ± {sigma:.2g}"


def _field_rings(camera: CameraModel) -> Iterator[Line]:
    """Yield the frame of the image and the images of rings about the axis."""
    width, height = camera.image_size
    yield Line(np.array([0, width, width, 0, 0.0]) - 0.5, 0.5 - np.array([0, 0, height, height, 0.0]), "plain")
    turn = np.linspace(0, 2 * np.pi, RING_POINTS)
    right, down = camera.mount.rotation()[:, 0], camera.mount.rotation()[:, 1]
    end = 180.0 if camera.symmetry is None else float(np.degrees(camera.symmetry.omega_max))
    rings = [*np.arange(RING_STEP_DEG, end - 1e-9, RING_STEP_DEG), end]
    for omega in np.radians(rings):
        around = np.outer(np.cos(turn), right) + np.outer(np.sin(turn), down)
        pixels, valid = camera.project_directions(np.cos(omega) * camera.axis + np.sin(omega) * around)
        if valid.any():
            yield Line(
                np.where(valid, pixels[:, 0], np.nan),
                -np.where(valid, pixels[:, 1], np.nan),
                "fine" if omega < np.radians(end) else "strong",
            )
