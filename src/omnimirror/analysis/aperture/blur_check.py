"""Validation of the blur formula by real rays through the whole aperture, for several F-numbers."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from ...base.arguments import row
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.lenses import GaussianLens
from ...optics.sensor import Sensor, check_sensor
from ..evaluation import evaluate, field_angles
from .pupil import Pupil
from .spot_diagrams import spots

FAN = 81  # rays across a fan
CLEAR = 0.5  # deg; distance of the field angles from the rim, which would vignette bundles


@dataclass(frozen=True)
class BlurCheck:
    """Blur of real rays minus the evaluation, k field angles, j F-numbers; arrays (j, k), px."""

    f_number: Array
    """F-numbers (j,)."""
    omega_deg: Array
    """Field angles (k,)."""
    blur_t_px: Array
    """Tangential blur of the evaluation, unsigned."""
    blur_s_px: Array
    edge_t_px: Array
    """Distance of the two marginal rays of the tangential fan minus the blur."""
    edge_s_px: Array
    extent_t_px: Array
    """Full width of the tangential fan minus the blur."""
    extent_s_px: Array

    def worst(self, name: str) -> Array:
        """Return the largest magnitude (j,) of a column over the field."""
        found: Array = np.abs(getattr(self, name)).max(axis=1)
        return found


def check_blur(
    sensor: Sensor, f_numbers: ArrayLike, *, omega_deg: ArrayLike | None = None, object_distance_mm: float = np.inf
) -> BlurCheck:
    """Compare the blur of Eq. 28 with real rays, for an aligned sensor and several F-numbers.

    The formula includes the two curvatures of the mirror at the chief ray only. The variation of
    the curvature across a larger aperture causes coma, then spherical aberration.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    f_numbers : (k,)
        F-numbers of the lens to evaluate.
    omega_deg : (n,), optional
        Field angles, deg; by default over the whole field.
    object_distance_mm
        Object distance from the mirror, mm.

    Returns
    -------
    BlurCheck
        Blur by Eq. 28 and differences of real rays from it, (k, n) px.

    Raises
    ------
    InvalidParameter, OutsideField
        Field angle outside the field of view, or invalid numbers.

    Examples
    --------
    >>> import omnimirror as om
    >>> found = om.check_blur(om.load_sensor("paper-spherical"), [4.0])
    >>> bool(found.worst("edge_t_px")[0] < 0.002)
    True
    """
    check_sensor(sensor)
    numbers = row("f_numbers", f_numbers)
    name = "f_number" if isinstance(sensor.lens, GaussianLens) else "working_f_number"
    low, high = sensor.field_deg
    angles = field_angles(sensor) if omega_deg is None else row("omega_deg", omega_deg)
    angles = angles[(angles >= low) & (angles <= high - CLEAR)] if omega_deg is None else angles
    if not angles.size:
        raise InvalidParameter("there is no field angle to check; give some as omega_deg")
    u = np.linspace(-1, 1, FAN)
    fans = Pupil(np.concatenate([np.outer(u, [1, 0]), np.outer(u, [0, 1])]), np.full(2 * FAN, 0.5 / FAN))
    rows = []
    for F in numbers:
        seen = replace(sensor, lens=replace(sensor.lens, **{name: float(F)}))  # type: ignore[type-var]
        result = evaluate(seen, angles, object_distance_mm=object_distance_mm)
        spot = spots(seen, angles, pupil=fans, object_distance_mm=object_distance_mm)
        t, s = spot.t_px[:, 0, :FAN], spot.s_px[:, 0, FAN:]
        blur_t, blur_s = np.abs(result.blur_t_px), np.abs(result.blur_s_px)
        edges = (np.abs(a[:, -1] - a[:, 0]) for a in (t, s))
        rows.append([blur_t, blur_s, *edges, np.ptp(t, axis=1), np.ptp(s, axis=1)])
    blur_t, blur_s, edge_t, edge_s, extent_t, extent_s = np.array(rows).transpose(1, 0, 2)
    return BlurCheck(
        numbers, angles, blur_t, blur_s, edge_t - blur_t, edge_s - blur_s, extent_t - blur_t, extent_s - blur_s
    )
