"""F-number and focus that minimise combined defocus blur and diffraction over the field.

A large aperture increases defocus blur, a small one diffraction. The blur diameter on the imager is
proportional to 1/F and the Airy disk diameter to F; they are added in quadrature. For a given
focus, with the largest blur ``B/F`` over the field and the Airy disk ``a F``, the minimum of
``sqrt((B/F)^2 + (a F)^2)`` is ``sqrt(2 a B)``, at ``F = sqrt(B/a)``, the F-number of equal
contributions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...analysis.meridional.coddington import virtual_images
from ...analysis.meridional.focus import FocusStudy
from ...base.arguments import checked, distances
from ...base.errors import InvalidParameter
from ...base.numerics.minimisation import lowest
from ...optics.lenses import BlurMode, Lens, Perspective
from ...optics.sensor import Sensor

SIDES = ("tangential", "sagittal", "together")
ANGLES = 1001


@dataclass(frozen=True)
class BestAperture:
    """Optimal F-number and focus, with the remaining blur.

    Attributes
    ----------
    side
        Minimised blur: tangential, sagittal, or the larger of both.
    worst_px
        Root sum of squares of blur and Airy disk at the worst field angle.
    blur_px, airy_px
        Contributions of defocus and diffraction.
    """

    side: str
    f_number: float
    focus_mm: float
    worst_px: float
    blur_px: float
    airy_px: float


@checked
def best_apertures(
    sensor: Sensor,
    f_number: float | tuple[float, float] = (0.5, 64.0),
    *,
    object_distance_mm: float = np.inf,
    mode: BlurMode = "exact",
    wavelength_nm: float = 550.0,
    omega_min_deg: float = 0.0,
) -> list[BestAperture]:
    """Compute the optimal F-number and focus for tangential, sagittal and combined blur.

    The merit is the root sum of squares of defocus blur and Airy disk at the worst field angle, in
    pixels. For a focus with the largest blur B/F and the Airy disk a F, its minimum is sqrt(2 a B),
    at F = sqrt(B/a).

    Parameters
    ----------
    sensor
        Sensor; its own F-number and focus are ignored.
    f_number
        Available F-numbers, a single value or (low, high); for a telecentric lens the image-side
        working F-number.
    object_distance_mm
        Object distance from the mirror, mm.
    mode
        ``"exact"`` blur (Eq. 28), or ``"paper"`` (Eq. 29).
    wavelength_nm
        Wavelength of the Airy disk, nm.
    omega_min_deg
        Smallest field angle considered, deg.

    Returns
    -------
    list of BestAperture
        Results for the tangential, the sagittal and the combined blur.

    Raises
    ------
    InvalidParameter
        Empty range of F-numbers, or empty field.

    Examples
    --------
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> for best in best_apertures(load_sensor("paper-spherical")):
    ...     print(f"{best.side}: F/{best.f_number:.1f} at {best.focus_mm:.0f} mm leaves {best.worst_px:.2f} px")
    tangential: F/3.0 at 209 mm leaves 1.17 px
    sagittal: F/8.5 at 241 mm leaves 3.27 px
    together: F/8.5 at 241 mm leaves 3.27 px
    """
    low, high = f_number if isinstance(f_number, Sequence) else (f_number, f_number)
    if not 0 < low <= high:
        raise InvalidParameter(f"F-numbers {low:g} to {high:g} are no range; it needs 0 < low <= high")
    first, last = sensor.field_deg
    if not omega_min_deg < last:
        raise InvalidParameter(f"omega_min_deg = {omega_min_deg:g} leaves no field; it is valid below {last:.6g}")
    omega = np.radians(np.linspace(max(first, omega_min_deg), last, ANGLES))
    unit = replace(sensor, lens=_at_f_number(sensor.lens, 1.0))
    rays = unit.meridian.trace(unit.meridian.x_from_omega(omega))
    study = FocusStudy(
        unit, rays, virtual_images(rays, distances("object_distance_mm", object_distance_mm)), mode, None, wavelength_nm
    )
    return [_best(side, study, (low, high)) for side in SIDES]


def _best(side: str, study: FocusStudy, f_range: tuple[float, float]) -> BestAperture:
    """Optimise for one kind of blur; the sensor has F-number 1."""
    L_t, L_s = study.distances
    L = {"tangential": L_t, "sagittal": L_s, "together": np.concatenate([L_t, L_s])}[side]
    usable = L[np.isfinite(L) & (_nearest(study.sensor.lens) < L)]
    if not usable.size:
        raise InvalidParameter("the virtual images lie nowhere the lens could be focused at")

    def at(focus: float) -> BestAperture:
        blur = study.at(focus)
        t, s = float(np.abs(blur.t_px).max()), float(np.abs(blur.s_px).max())
        open_ = {"tangential": t, "sagittal": s, "together": max(t, s)}[side]
        # (B/F)^2 + (a F)^2 is stationary at F^2 = B/a; B and a are blur and Airy disk at F = 1.
        F = float(np.clip(np.sqrt(open_ / blur.airy_px), *f_range))
        return BestAperture(side, F, focus, float(np.hypot(open_ / F, blur.airy_px * F)), open_ / F, blur.airy_px * F)

    return at(lowest(lambda focus: at(focus).worst_px, float(usable.min()), float(usable.max())))


def _nearest(lens: Lens) -> float:
    return lens.focal_length_mm if isinstance(lens, Perspective) else -np.inf


def _at_f_number(lens: Lens, f_number: float) -> Lens:
    change: dict[str, Any] = {"f_number" if isinstance(lens, Perspective) else "working_f_number": f_number}
    return replace(lens, **change)  # type: ignore[type-var]
