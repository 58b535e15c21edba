"""How far the paper's blur can be trusted: against real rays through the whole aperture, F-number by F-number."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ...base.arguments import row
from ...base.errors import InvalidParameter
from ...optics.lenses import GaussianLens
from ...optics.sensor import Sensor, check_sensor
from ..evaluation import evaluate, field_angles
from .pupil import Pupil
from .spot_diagrams import spots

Array = NDArray[np.float64]

FAN = 81  # rays of a fan from edge to edge
CLEAR = 0.5  # degrees that the field angles keep from the rim, which would cut bundles


@dataclass(frozen=True)
class BlurCheck:
    """Blur by real rays less the evaluation's, at k field angles for j F-numbers; every array (j, k), px."""

    f_number: Array
    """(j,)"""
    omega_deg: Array
    """(k,)"""
    blur_t_px: Array
    """The evaluation's tangential blur, without sign."""
    blur_s_px: Array
    edge_t_px: Array
    """Distance of the two edge rays of the tangential fan, less the blur."""
    edge_s_px: Array
    extent_t_px: Array
    """Full width of the tangential fan, less the blur."""
    extent_s_px: Array

    def worst(self, name: str) -> Array:
        """Largest magnitude (j,) of a column over the field."""
        found: Array = np.abs(getattr(self, name)).max(axis=1)
        return found


def check_blur(
    sensor: Sensor, f_numbers: ArrayLike, *, omega_deg: ArrayLike | None = None, object_distance_mm: float = np.inf
) -> BlurCheck:
    """Compare the blur of Eq. 28 with real rays, for an aligned sensor and several F-numbers.

    The formula takes the mirror for its two curvatures in the chief ray's point. A wider aperture sees
    that they change across it: coma, then spherical aberration.

    Parameters
    ----------
    sensor
        Such as :func:`omnimirror.load_sensor` gives.
    f_numbers : (k,)
        F-numbers of the lens to try.
    omega_deg : (n,), optional
        Field angles, deg; over the whole field by default.
    object_distance_mm
        From the mirror to the object, mm.

    Returns
    -------
    BlurCheck
        Blur by Eq. 28 beside that of real rays, (k, n) px.

    Raises
    ------
    InvalidParameter, OutsideField
        A field angle that is not seen, or numbers that are not valid.

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
