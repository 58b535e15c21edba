"""Camera models for estimation, in order of complexity, with their initial values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....base.arguments import choice, instance
from ....base.errors import OmnimirrorError
from ....cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    OCam,
    RadialSpline,
    Unified,
    ViewpointSpline,
)
from ....cameras.models.base import CameraModel
from ...physical import SensorModel
from ...physical.starting import guessed_size
from ..bundle.adjustment import Adjustment

Maker = Callable[[Unified, float], CameraModel]
"""Constructor of a model that approximates a unified one up to a field angle in deg."""


def _unified(u: Unified, omega_max_deg: float) -> CameraModel:
    return u


def _enhanced(u: Unified, omega_max_deg: float) -> CameraModel:
    return EnhancedUnified(u.xi / (1 + u.xi), 1.0, _focal(u), u.centre_px, u.image_size, optics=u.optics, mount=u.mount)


def _double(u: Unified, omega_max_deg: float) -> CameraModel:
    return DoubleSphere(0.0, u.xi / (1 + u.xi), _focal(u), u.centre_px, u.image_size, optics=u.optics, mount=u.mount)


def _kannala_brandt(u: Unified, omega_max_deg: float) -> CameraModel:
    return KannalaBrandt(_focal(u), u.centre_px, u.image_size, optics=u.optics, mount=u.mount)


def _ocam(u: Unified, omega_max_deg: float) -> CameraModel:
    """Return an OCam model; stereographic: ``f(rho) = (rho^2 - f^2) / (2 f)``."""
    f = 2 * u.scale_px / (1 + u.xi)
    polynomial = (-f / 2, 0.0, 1 / (2 * f), 0.0, 0.0)
    return OCam(polynomial, u.centre_px, u.image_size, optics=u.optics, mount=u.mount)


def _radial_spline(u: Unified, omega_max_deg: float) -> CameraModel:
    return RadialSpline.like(u, field_deg=2 * omega_max_deg)


def _viewpoint_spline(u: Unified, omega_max_deg: float) -> CameraModel:
    return ViewpointSpline.like(u, field_deg=2 * omega_max_deg)


def _mirror(u: Unified, omega_max_deg: float) -> CameraModel:
    return SensorModel.start_from(u, omega_max_deg=omega_max_deg)


def mirror_like(central: Unified, fit: Adjustment, omega_max_deg: float) -> SensorModel | None:
    """Return an initial mirror model with the size given by fitted viewpoints.

    None if the size is undetermined.

    Parameters
    ----------
    central
        Model of the projection of distant points.
    fit
        Fit of a :class:`~omnimirror.cameras.models.ViewpointSpline`, with corner positions.
    omega_max_deg
        Maximum field angle of the observations.
    """
    model = fit.model
    assert isinstance(model, ViewpointSpline)
    end = min(omega_max_deg, _degrees(central.model_end))
    corners = np.concatenate([s.motion(s.points[~s.distant]) for s in fit.sightings if s.motion is not None])
    omega = np.arctan2(np.hypot(corners[:, 0], corners[:, 1]), -corners[:, 2])
    omega = np.sort(omega[omega < np.radians(end)])[:: max(1, len(omega) // SOME)]
    try:
        guess = guessed_size(central, end, omega, -model._viewpoint_mm(omega))
    except OmnimirrorError:  # a mirror with such a mapping would fold before its rim
        return None
    if guess is None:
        return None
    rim, distance = guess
    return SensorModel.start_from(central, omega_max_deg=end, rim_radius_mm=rim, distance_mm=distance)


KINDS: dict[str, Maker] = {
    "unified": _unified,
    "enhanced-unified": _enhanced,
    "double-sphere": _double,
    "kannala-brandt": _kannala_brandt,
    "ocam": _ocam,
    "radial-spline": _radial_spline,
    "viewpoint-spline": _viewpoint_spline,
    "sensor": _mirror,
}
"""Constructors by name in files and on the command line; the physical mirror sensor is last."""
RIM_MM, FARTHER = 40.0, 6.0  # unknown mirror: rim radius; distance in rim radii (usual: 3 to 5)
SOME = 300  # number of corners for the size estimate
JUDGES = ("unified", "radial-spline", "viewpoint-spline")
"""Reference models for outlier rejection.

They are the most flexible ones, and one for steep growth of the radius, which splines do not
follow.
"""


def begun_as(kind: str, central: Unified, omega_max_deg: float) -> CameraModel:
    """Return an initial model of a kind that approximates a unified model."""
    choice("model", kind, KINDS)
    instance("central", central, Unified, "a unified model")
    return KINDS[kind](central, min(omega_max_deg, _degrees(central.model_end)))


def mirror_farther(central: Unified, omega_max_deg: float) -> SensorModel:
    """Return an initial mirror model with a larger distance from its lens than usual."""
    end = min(omega_max_deg, _degrees(central.model_end))
    return SensorModel.start_from(central, omega_max_deg=end, distance_mm=FARTHER * RIM_MM, rim_radius_mm=RIM_MM)


def _focal(u: Unified) -> tuple[float, float]:
    """Return the focal lengths of models with ``r = f Omega`` near the centre."""
    return u.focal_px[0] / (1 + u.xi), u.focal_px[1] / (1 + u.xi)


def _degrees(radians: float) -> float:
    return radians * 57.29577951308232
