"""Stages of the model sequence: each model starts at the robust fit of a simpler one."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ....base.errors import InvalidParameter
from ....cameras.frames import Mount, turned
from ....cameras.models import RadialSpline, Unified, ViewpointSpline
from ....cameras.models.base import CameraModel
from ..bundle.adjustment import MOST_STEPS, Adjustment, Prior, adjust
from ..bundle.board_shape import BoardShape
from ..bundle.linearisation import UNSEEN_PX, as_placed
from ..bundle.observations import Motion, Sighting
from ..checks import check_start, without_strangers
from .conversion import converted, farthest_angle_deg, is_central, shifted_to_viewpoint
from .placing import placed
from .start import stereographic_start

FIRST_FREE = (("xi", "fx", "fy", "cx", "cy"), ("fx", "fy", "cx", "cy", "k1", "k2"))
"""Alternative sets of parameters for the first adjustment; the better result is used.

With xi free, the search for mirrors may drift to solutions for which boards in any row of pixels
have similar images; with xi fixed, the search for fisheyes of 250 deg and more may diverge.
"""
ROUGHLY = 1e-4  # relative decrease that ends an iteration if better models follow
RADIUS_SIGMA = 0.02  # fraction of the largest radius
VIEWPOINT_SIGMA_MM = 30.0
ROUGH_START = {True: 2.0, False: 10.0}
"""Factor of the residual limit before adjustment, for boards and for surveys alone.

It is larger for surveys: boards are placed at the best pose for any camera, even a wrong one.
"""
UNPLACED = (
    "what it shows cannot be placed before the camera: it takes 6 points that do not lie on a line, or 3 directions, "
    "and not mirror images of them"
)
BEYOND = 1.03  # maximum field angle of the model comparison relative to that of the farthest corner


class Begun(NamedTuple):
    """Result of the first stage."""

    fit: Adjustment
    """Fit of a unified model."""
    strangers: dict[str, str]
    """Reasons for images without a consistent board pose, by name."""


def begun(
    sightings: Sequence[Sighting],
    image_size: tuple[int, int],
    centre_px: tuple[float, float] | None,
    optics: str,
    mount: Mount,
    *,
    fixed: tuple[str, ...] = (),
    priors: tuple[Prior, ...] = (),
) -> Begun:
    """Fit a unified model robustly to boards and surveyed points without poses.

    Fixed parameters keep the values of a stereographic camera without distortion.

    Raises
    ------
    InvalidParameter
        If no camera explains the corners.
    """
    width, height = image_size
    centre = centre_px or ((width - 1) / 2, (height - 1) / 2)
    model = Unified(1.0, (width / 4, width / 4), centre, image_size, optics=optics, mount=mount)  # type: ignore[arg-type]
    start = stereographic_start(sightings, image_size, centre, model._signs)
    boards = not all(s.is_surveyed for s in sightings)
    check_start(start.median_px / ROUGH_START[boards], image_size, boards=boards)
    model = Unified(1.0, (start.focal_px,) * 2, centre, image_size, optics=optics, mount=mount)  # type: ignore[arg-type]
    strangers = {
        s.name: UNPLACED if s.is_surveyed else "its corners lie on a line, or in one point"
        for s, motion in zip(sightings, start.motions, strict=True)
        if motion is None
    }
    known = [s.moved(m) for s, m in zip(sightings, start.motions, strict=True) if m is not None]
    fit = min((_lowest(model, known, free, fixed, priors) for free in FIRST_FREE), key=lambda f: f.question.noise_px)
    check_start(_median_of(fit), image_size, boards=boards)
    found = without_strangers(fit)
    if found:
        strangers |= found
        kept = [s for s in fit.sightings if s.name not in found]
        if len(kept) < min(2, len(sightings)):
            raise InvalidParameter("; ".join(f"{name}: {why}" for name, why in found.items()))
        fit = fit.again(kept, loss="cauchy", settled=ROUGHLY)
    return Begun(fit, strangers)


def _lowest(
    model: Unified, known: Sequence[Sighting], first: tuple[str, ...], fixed: tuple[str, ...], priors: tuple[Prior, ...]
) -> Adjustment:
    """Return a unified model after adjustment of some of its parameters, then of all."""
    held = (p.name for p in model.parameters if p.name not in first)
    rough = adjust(model, known, fixed=(*held, *fixed), priors=priors, loss="cauchy", settled=ROUGHLY)
    return adjust(rough.model, again_placed(rough), fixed=fixed, priors=priors, loss="cauchy", settled=ROUGHLY)


def _median_of(fit: Adjustment) -> float:
    """Return the median residual, px."""
    return float(np.median(np.where(fit.seen, np.hypot(*fit.residuals.T), UNSEEN_PX)))


def again_placed(fit: Adjustment) -> tuple[Sighting, ...]:
    """Return sightings with boards placed through the model, if that reduces their residuals."""
    world = fit.model.mount.rotation()
    result = []
    for number, sighting in enumerate(fit.sightings):
        rays = fit.model.backproject(sighting.pixels)
        other = None
        if rays.valid.sum() >= len(sighting) / 2 and not sighting.is_known:
            other = placed(sighting.only(rays.valid), turned(rays.directions[rays.valid], world))
        here = _median_px(fit.model, sighting, sighting.motion)
        result.append(sighting.moved(other) if _median_px(fit.model, sighting, other) < here else fit.sightings[number])
    return tuple(result)


def _median_px(model: CameraModel, sighting: Sighting, motion: Motion | None) -> float:
    if motion is None:
        return np.inf
    found = as_placed(model, [sighting.moved(motion)])
    return float(np.median(np.where(found.seen, np.hypot(*found.residuals.T), UNSEEN_PX)))


def field_of(fit: Adjustment) -> float:
    """Return the field angle (deg) of the model comparison, slightly beyond the farthest corner."""
    return min(BEYOND * farthest_angle_deg(fit), 179.0)


def climbed(
    fit: Adjustment,
    into: CameraModel,
    *,
    shape: BoardShape | None = None,
    fixed: tuple[str, ...] = (),
    priors: tuple[Prior, ...] = (),
    most_steps: int = MOST_STEPS,
) -> Adjustment:
    """Fit the next model: first to the projection of the previous model, then to the corners.

    Parameters
    ----------
    fit
        Fit of the previous model.
    into
        Initial value of the requested kind.
    shape
        Initial shape of the board.
    fixed, priors, most_steps
        As for :func:`~omnimirror.calibration.estimation.bundle.adjustment.adjust`.

    Returns
    -------
    Adjustment
        Robust fit.
    """
    names = {p.name for p in into.parameters}
    model = converted(
        fit.model, into, omega_max_deg=field_of(fit), fixed=[n for n in fixed if n in names],
        priors=[p for p in priors if p.name in names],
    )  # fmt: skip
    sightings = fit.sightings
    if not is_central(model):
        sightings = shifted_to_viewpoint(model, sightings)
    settled = adjust(model, sightings, fixed=[p.name for p in model.parameters], loss="cauchy", most_steps=20)
    supported = (*priors, *(p for p in supports(model) if p.name not in fixed))
    return adjust(
        model, settled.sightings, shape=shape, fixed=fixed, priors=supported, loss="cauchy", settled=ROUGHLY,
        most_steps=most_steps,
    )  # fmt: skip


def supports(model: CameraModel) -> tuple[Prior, ...]:
    """Return weak priors that hold splines near the previous model in regions without corners."""
    if not isinstance(model, RadialSpline | ViewpointSpline):
        return ()
    reach = RADIUS_SIGMA * model.radii_px[-1]
    sigmas = {"r": reach, "z": VIEWPOINT_SIGMA_MM}
    held = (p for p in model.parameters if p.name[0] in sigmas and p.name[1:].isdigit())
    return tuple(Prior(p.name, p.value, sigmas[p.name[0]]) for p in held)
