"""Consistency of the tolerances on a drawing: workshop file against allocated tolerances.

Each allocated tolerance is a budget for several entries of the workshop file: the tilt of the mirror,
its decentre, its spacing to the lens, and its form. An entry that uses the whole budget leaves no
tolerance for the mount.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import pairwise

import numpy as np

from ...base.arguments import validate_arguments
from ...optics.mirrors import Mirror
from ...optics.sensor import Sensor
from ..body import Body
from ..drawings.tables import form_rms_um
from ..workshop import PartSpecification, Workshop
from .tolerances import perturbed

LENGTHS_MM = (0.5, 3.0, 6.0, 30.0, 120.0, 400.0, 1000.0, 2000.0)
GENERAL_MM = {
    "f": (0.05, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5),
    "m": (0.1, 0.1, 0.2, 0.3, 0.5, 0.8, 1.2),
    "c": (0.2, 0.3, 0.5, 0.8, 1.2, 2.0, 3.0),
    "v": (np.inf, 0.5, 1.0, 1.5, 2.5, 4.0, 6.0),
}
"""Permissible deviations of linear sizes by ISO 2768-1 in the ranges of ``LENGTHS_MM``."""
PV_PER_RMS = 2 * np.sqrt(3)
"""Ratio of peak to valley and RMS of defocus, the smallest ratio of all Zernike terms."""
POINTS = 401


@validate_arguments
def tolerance_conflicts(
    sensor: Sensor, workshop: Workshop, body: Body | None = None, secondary_body: Body | None = None
) -> list[str]:
    """List the tolerances of a drawing that contradict each other.

    Parameters
    ----------
    sensor
        Sensor that is drawn.
    workshop
        Workshop file and allocated tolerances.
    body, secondary_body : optional
        Bodies of the mirrors, by default those of the sensor's housing.

    Returns
    -------
    list of str
        A sentence for each conflict, with both values and a remedy.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.manufacturing import PartSpecification, Workshop
    >>> workshop = Workshop(mirror=PartSpecification(centring_deg=0.2), tolerances={"mirror.tilt_x_deg": 0.1})
    >>> print(*tolerance_conflicts(om.load_sensor("paper-spherical"), workshop), sep="\\n")
    mirror.centring_deg = 0.2 uses 0.2 deg of the 0.1 deg allocated to the tilt of the mirror and leaves nothing for its
    mount; reduce it below 0.1 deg or allocate more
    """
    result = _of_mirror(sensor, workshop, body or Body.of(sensor.housing.rim, sensor.mirror))
    if sensor.secondary is not None:
        second = secondary_body or Body.of(sensor.housing.secondary_rim, sensor.secondary.mirror)
        tilt = _back_tilt_deg(workshop.secondary, second, sensor.secondary.mirror)
        result += _flatness_conflict("secondary", workshop.secondary, tilt)
    return result


def _of_mirror(sensor: Sensor, workshop: Workshop, body: Body) -> list[str]:
    specification, allocated, general = (
        workshop.mirror,
        workshop.tolerances,
        workshop.title.general_tolerances,
    )
    mirror = sensor.mirror
    back_tilt = _back_tilt_deg(specification, body, mirror)
    tilt = [
        (f"mirror.centring_deg = {specification.centring_deg:g}", specification.centring_deg)
        if specification.centring_deg
        else None,
        (f"mirror.back_flatness_mm = {specification.back_flatness_mm:g}", back_tilt)
        if back_tilt
        else None,
    ]
    diameter = _size(
        "diameter", 2 * body.outer_radius_mm(mirror), specification.diameter_tolerance_mm, general
    )
    decentre = [
        (f"mirror.centring_mm = {specification.centring_mm:g}", specification.centring_mm)
        if specification.centring_mm
        else None,
        diameter,
    ]
    thickness = _size("thickness", body.thickness_mm, specification.thickness_tolerance_mm, general)
    result = [
        *_flatness_conflict("mirror", specification, back_tilt),
        *_budget(
            "tilt of the mirror",
            "deg",
            _least(allocated, "mirror.tilt_x_deg", "mirror.tilt_y_deg"),
            tilt,
        ),
        *_budget(
            "decentre of the mirror",
            "mm",
            _least(allocated, "mirror.decentre_x_mm", "mirror.decentre_y_mm"),
            decentre,
        ),
        *_budget(
            "spacing of the mirror", "mm", _least(allocated, "mirror.displacement_mm"), [thickness]
        ),
    ]
    return result + (
        _form_conflicts(sensor, allocated, specification.form_um)
        if specification.form_um is not None
        else []
    )


def _least(allocated: Mapping[str, float], *names: str) -> float | None:
    return min((allocated[name] for name in names if allocated.get(name)), default=None)


def _budget(
    what: str, unit: str, total: float | None, parts: list[tuple[str, float] | None]
) -> list[str]:
    """Return a message if entries exceed an allocated budget."""
    used = [part for part in parts if part is not None]
    amount = sum(value for _, value in used)
    if total is None or not used or amount < total:
        return []
    them = "it" if len(used) == 1 else "them"
    return [
        f"{' and '.join(name for name, _ in used)} use{'s' * (len(used) == 1)} {amount:.3g} {unit} of the {total:.3g} "
        f"{unit} allocated to the {what} and leave{'s' * (len(used) == 1)} nothing for its mount; reduce {them} below "
        f"{total:.3g} {unit} or allocate more"
    ]


def _back_tilt_deg(specification: PartSpecification, body: Body, mirror: Mirror) -> float:
    """Return the tilt between back and mount that the flatness of the back permits, degrees."""
    flatness = specification.back_flatness_mm or 0.0
    return float(np.degrees(np.arctan(flatness / (2 * body.outer_radius_mm(mirror)))))


def _flatness_conflict(part: str, specification: PartSpecification, tilt_deg: float) -> list[str]:
    if specification.centring_deg is None or tilt_deg < specification.centring_deg:
        return []
    return [
        f"{part}.back_flatness_mm = {specification.back_flatness_mm:g} lets datum A tilt by {tilt_deg:.3g} deg, and "
        f"{part}.centring_deg = {specification.centring_deg:g} refers to it; reduce back_flatness_mm or allow a "
        "larger tilt"
    ]


def _size(
    name: str, length_mm: float, tolerance: float | None, general: str
) -> tuple[str, float] | None:
    """Return the tolerance of a size, its own or the general one of ISO 2768-1; None if neither is known."""
    if tolerance is not None:
        return f"mirror.{name}_tolerance_mm = {tolerance:g}", tolerance
    match = re.search(r"2768-([fmcv])", general)
    if match is None:
        return None
    for (low, high), value in zip(pairwise(LENGTHS_MM), GENERAL_MM[match[1]], strict=True):
        if low <= length_mm <= high and np.isfinite(value):
            return f"the general tolerance of the {name} (ISO 2768-{match[1]})", value
    return None


def _form_conflicts(sensor: Sensor, allocated: Mapping[str, float], form_um: float) -> list[str]:
    """Return messages for shape tolerances outside the profile zone and for a form above its RMS
    budget.
    """
    result = []
    rms = form_rms_um(allocated)
    steepest = float(
        np.abs(sensor.mirror.slope(np.linspace(0, sensor.mirror.rim_radius_mm, POINTS))).max()
    )
    permitted = form_um * float(np.hypot(1.0, steepest)) / PV_PER_RMS
    if rms is not None and permitted > rms:
        result.append(
            f"mirror.form_um = {form_um:g} permits an RMS of {permitted:.3g} um along z, and {rms:.3g} um are "
            f"allocated to the form; reduce form_um to {form_um * rms / permitted:.3g} or allocate more"
        )
    for name in (
        "mirror.vertex_radius_mm",
        "mirror.conic",
        *(n for n in allocated if n.startswith("mirror.coeff")),
    ):
        if not (tolerance := allocated.get(name)):
            continue
        departure = _departure_um(sensor.mirror, perturbed(sensor, {name: tolerance}).mirror)
        if departure > form_um:
            result.append(
                f"{name} ± {tolerance:.3g} departs by {departure:.3g} um P-V from the surface, and mirror.form_um = "
                f"{form_um:g} permits less; reduce it to ± {tolerance * form_um / departure:.2g} or increase form_um"
            )
    return result


def _departure_um(nominal: Mirror, other: Mirror) -> float:
    """Return the smallest profile zone (um) that contains another surface, free to shift along the
    axis.
    """
    from scipy.optimize import minimize_scalar

    x = np.linspace(0.0, nominal.rim_radius_mm, POINTS)
    up = 1 / np.sqrt(1 + nominal.slope(x) ** 2)
    away = 1e3 * (other.sag(x) - nominal.sag(x))
    span = float(np.abs(away).max()) or 1.0
    return float(
        minimize_scalar(
            lambda shift: 2 * float(np.abs((away - shift) * up).max()),
            bounds=(-span, span),
            method="bounded",
        ).fun
    )
