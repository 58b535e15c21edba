"""Requirements that reproduce the field, rim, lens, imager and housing of a sensor."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.arguments import checked
from ...optics.lenses import Perspective
from ...optics.sensor import Sensor, check_sensor
from ...optics.sensor_files import housing_tables, lens_table
from .requirement_file import requirements_of
from .requirements import Requirements

PIXELS = ("width_px", "height_px", "pixel_pitch_um")


def tables_like(sensor: Sensor) -> dict[str, Any]:
    """Return the properties of a single-mirror sensor as tables of a requirement file."""
    check_sensor(sensor)
    sensor.check("designing one like it", "one mirror")
    low, high = sensor.field_deg
    imager = sensor.imager
    return {
        "field": {"omega_max_deg": high, "omega_min_deg": low},
        "mirror": {"rim_radius_mm": sensor.mirror.rim_radius_mm},
        "lens": lens_like(sensor),
        "housing": housing_tables(sensor.housing),
        "imager": {n: getattr(imager, n) for n in PIXELS}
        | ({"centre_px": list(imager.centre_px)} if imager.centre_px else {}),
    }


def lens_like(sensor: Sensor) -> dict[str, Any]:
    """Return the lens of a sensor as an entry of a requirement file; the focus remains free.

    >>> import omnimirror as om
    >>> lens_like(om.load_sensor("paraboloid-telecentric"))
    {'kind': 'orthographic', 'f_number': 4.0}
    """
    lens = sensor.lens
    if lens.TELECENTRIC:
        return {"kind": lens.KIND, "f_number": lens.stop_number}
    theta = float(np.degrees(sensor.meridian.theta_max))
    if isinstance(lens, Perspective):
        own = {"kind": lens.KIND, "f_number": lens.stop_number, "focal_length_mm": lens.focal_length_mm}
        return {**own, "theta_max_deg": theta}
    return {"optics": lens_table(lens), "theta_max_deg": theta}


@checked
def requirements_like(sensor: Sensor, **mirror: Any) -> Requirements:
    """Return requirements with the field, rim, lens, imager and housing of a sensor, as
    ``omnimirror design --like``.

    Parameters
    ----------
    sensor
        Sensor with one mirror; the focus of its lens remains free.
    mirror
        Construction of the new mirror: entries of :class:`omnimirror.MirrorRequirements`.

    Returns
    -------
    Requirements

    Raises
    ------
    InvalidParameter
        Sensor with two mirrors.
    SpecError
        Missing construction method, or invalid entry.

    Examples
    --------
    >>> import omnimirror as om
    >>> sphere = om.load_sensor("paper-spherical")
    >>> requirements = om.requirements_like(sphere, optimise="worst_blur_deg", shape="polynomial:3")
    >>> requirements.lens.focal_length_mm, requirements.mirror.rim_radius_mm
    (11.6, 43.905)
    """
    tables = tables_like(sensor)
    return requirements_of({**tables, "mirror": tables["mirror"] | mirror})
