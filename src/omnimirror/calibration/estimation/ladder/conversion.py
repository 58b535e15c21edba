"""From one model to another: the richer begins where it sees what the simpler one saw.

A richer model that begins far from the truth does not find it; one whose projection is first fitted to that of a
simpler model, over the whole picture and without any corner, does. A model with several viewpoints sees near things
from another place than a central one: boards then move along the axis, to where they look best.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from ....base.errors import InvalidParameter
from ....cameras.camera import inside_image
from ....cameras.models.base import CameraModel
from ..bundle.adjustment import Adjustment, Prior, adjust
from ..bundle.linearisation import as_placed
from ..bundle.observations import Motion, Sighting

Array = NDArray[np.float64]

RINGS, SPOKES = 40, 24  # directions that models are compared by
AGREEMENT_PX = (
    3.0  # about how far off models of near boards are for distant things: what is known beforehand counts more
)
SHIFTS_MM = np.concatenate([-np.geomspace(600, 5, 20), [0.0], np.geomspace(5, 600, 20)])
"""Along the axis, tried for boards when a model with another viewpoint takes over."""


def converted(
    model: CameraModel,
    into: CameraModel,
    *,
    omega_max_deg: float = 170.0,
    fixed: Iterable[str] = (),
    priors: Iterable[Prior] = (),
) -> CameraModel:
    """A model of the kind of ``into`` that sees distant things as ``model`` does.

    Parameters
    ----------
    model
        What to agree with.
    into
        Where the search begins; what it cannot agree in, it keeps.
    omega_max_deg : deg
        Field angle up to which they agree.
    fixed, priors
        As for :func:`~omnimirror.calibration.estimation.adjustment.adjust`.

    Returns
    -------
    CameraModel
        Of the kind of ``into``.
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
    """Directions (n, 3) of the camera frame, evenly over angles from the axis and about it."""
    omega = np.radians(np.linspace(1.0, omega_max_deg, RINGS))[:, None]
    phi = np.linspace(0, 2 * np.pi, SPOKES, endpoint=False)[None, :]
    forward = -1.0 if model.optics == "mirror" else 1.0
    parts = np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), forward * np.cos(omega) + 0 * phi
    return np.stack([p.ravel() for p in parts], axis=1)


def farthest_angle_deg(fit: Adjustment) -> float:
    """The largest field angle of what was seen, deg from the axis."""
    forward = -1.0 if fit.model.optics == "mirror" else 1.0
    largest = 0.0
    for sighting in fit.sightings:
        points = sighting.before(sighting.motion or Motion.none())
        ahead = forward * points[:, 2] / np.linalg.norm(points, axis=1)
        largest = max(largest, float(np.degrees(np.arccos(np.clip(ahead.min(), -1, 1)))))
    return largest


def is_central(model: CameraModel) -> bool:
    """Whether near and distant things in one direction are seen at one pixel."""
    directions = directions_of_field(model, 80.0)[::37]
    near, far = model.image(300.0 * directions), model.image(directions, distant=True)
    both = near.valid & far.valid
    return bool(both.any()) and bool(np.allclose(near.pixels[both], far.pixels[both], atol=1e-6))


def shifted_to_viewpoint(model: CameraModel, sightings: Sequence[Sighting]) -> tuple[Sighting, ...]:
    """Near sightings moved along the axis, all alike, to where the model sees them best.

    What a central model takes for its viewpoint lies elsewhere in the frame of a mirror and its camera, often 100 mm
    from the origin; unless boards are moved by that first, no search of small steps arrives.
    """
    medians = []
    for shift in SHIFTS_MM:
        found = as_placed(model, [_along(s, shift) for s in sightings])
        lengths = np.where(found.seen, np.hypot(*found.residuals.T), np.inf)
        medians.append(float(np.median(lengths)))
    best = float(SHIFTS_MM[int(np.argmin(medians))])
    return tuple(_along(s, best) for s in sightings)


def _along(sighting: Sighting, shift_mm: float) -> Sighting:
    """Moved along Z, unless all of it is distant, or it is known."""
    if sighting.is_known or sighting.distant.all() or sighting.motion is None:
        return sighting
    rotation, place = sighting.motion
    return sighting.moved(Motion(rotation, place + np.array([0.0, 0.0, shift_mm])))
