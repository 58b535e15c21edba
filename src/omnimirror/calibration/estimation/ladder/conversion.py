"""Conversion between models: the initial value of a richer model reproduces a simpler one.

A richer model does not converge from a distant initial value. Therefore its projection is first
fitted to that of the simpler model, over the whole image and without corners. A model with
several viewpoints projects near points from another position than a central one: boards are then
shifted along the axis to minimise their residuals.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ....base.errors import InvalidParameter
from ....base.typing import Array
from ....cameras.camera import inside_image
from ....cameras.models.base import CameraModel
from ..bundle.adjustment import Adjustment, Prior, adjust
from ..bundle.linearisation import as_placed
from ..bundle.observations import Motion, Sighting

RINGS, SPOKES = 40, 24  # directions for the comparison of models
AGREEMENT_PX = 3.0  # typical parallax error of models fitted to near boards; weights priors
SHIFTS_MM = np.concatenate([-np.geomspace(600, 5, 20), [0.0], np.geomspace(5, 600, 20)])
"""Trial shifts of boards along the axis when a model with another viewpoint takes over."""


def converted(
    model: CameraModel,
    into: CameraModel,
    *,
    omega_max_deg: float = 170.0,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
) -> CameraModel:
    """Convert a model to another kind with the same projection of distant points.

    Parameters
    ----------
    model
        Reference model.
    into
        Initial value; parameters without effect on the agreement keep its values.
    omega_max_deg : deg
        Maximum field angle of the comparison.
    fixed, priors
        As for :func:`~omnimirror.calibration.estimation.adjustment.adjust`.

    Returns
    -------
    CameraModel
        Model of the kind of ``into``.
    """
    directions = directions_of_field(model, omega_max_deg)
    image = model.image(directions, distant=True)
    kept = image.valid.copy()
    kept[kept] = inside_image(image.pixels[kept], model.image_size)
    if kept.sum() < len(into.parameters):
        raise InvalidParameter(f"the model sees nothing of the {omega_max_deg:g} deg about its axis")
    sighting = Sighting("model", image.pixels[kept], directions[kept], Motion.none(), is_known=True, is_distant=True)
    return adjust(
        into, [sighting], fixed=fixed, priors=priors, loss="huber", noise_px=AGREEMENT_PX, most_steps=60
    ).model


def directions_of_field(model: CameraModel, omega_max_deg: float) -> Array:
    """Return directions (n, 3) in the camera frame on a uniform grid of field angle and azimuth."""
    omega = np.radians(np.linspace(1.0, omega_max_deg, RINGS))[:, None]
    phi = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)[None, :]
    forward = -1.0 if model.optics == "mirror" else 1.0
    parts = np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), forward * np.cos(omega) + 0 * phi
    return np.stack([p.ravel() for p in parts], axis=1)


def farthest_angle_deg(fit: Adjustment) -> float:
    """Return the maximum field angle of the observations, deg from the axis."""
    forward = -1.0 if fit.model.optics == "mirror" else 1.0
    largest = 0.0
    for sighting in fit.sightings:
        points = sighting.before(sighting.motion or Motion.none())
        ahead = forward * points[:, 2] / np.linalg.norm(points, axis=1)
        largest = max(largest, float(np.degrees(np.arccos(np.clip(ahead.min(), -1, 1)))))
    return largest


def is_central(model: CameraModel) -> bool:
    """Return whether a model has a single viewpoint (pixels independent of the object distance)."""
    directions = directions_of_field(model, 80.0)[::37]
    near, far = model.image(300.0 * directions), model.image(directions, distant=True)
    both = near.valid & far.valid
    return bool(both.any()) and bool(np.allclose(near.pixels[both], far.pixels[both], atol=1e-6))


def shifted_to_viewpoint(model: CameraModel, sightings: Sequence[Sighting]) -> tuple[Sighting, ...]:
    """Return near sightings shifted along the axis by the common distance of minimum residuals.

    The viewpoint of a central model is elsewhere in the frame of a mirror and its camera, often
    100 mm from the origin. Without this shift, a local search does not converge.
    """
    medians = []
    for shift in SHIFTS_MM:
        found = as_placed(model, [_along(s, shift) for s in sightings])
        lengths = np.where(found.seen, np.hypot(*found.residuals.T), np.inf)
        medians.append(float(np.median(lengths)))
    best = float(SHIFTS_MM[int(np.argmin(medians))])
    return tuple(_along(s, best) for s in sightings)


def _along(sighting: Sighting, shift_mm: float) -> Sighting:
    """Return a sighting shifted along Z, unless it is known or entirely distant."""
    if sighting.is_known or sighting.distant.all() or sighting.motion is None:
        return sighting
    rotation, place = sighting.motion
    return sighting.moved(Motion(rotation, place + np.array([0.0, 0.0, shift_mm])))
