"""What the form error of a mirror that was made does to the picture, as it is and after calibrations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ....arguments import checked
from ....errors import InvalidParameter
from ....mirrors.form import TERMS, MirrorForm
from ....numerics.zernike import noll
from ....sensor import Sensor
from ...metrology.form_errors import FormError
from ..trials.judge import Judge
from ..trials.merits import merit_names


@dataclass(frozen=True)
class FormEffect:
    """What a form error does.

    Attributes
    ----------
    meant, made
        Merits of the sensor with the mirror that was meant, and with the one that was made, by name: motions of the
        picture, left after each calibration, and blur. NaN where rays are lost.
    lost_rays
        How many objects of the field the one that was made does not show.
    beyond_um
        rms of the terms that are too fine to be traced here (above order 12), along the axis.
    """

    meant: Mapping[str, float]
    made: Mapping[str, float]
    lost_rays: int
    beyond_um: float

    def to_dict(self) -> dict[str, Any]:
        """As JSON holds it."""
        return {
            "meant": dict(self.meant),
            "made": dict(self.made),
            "lost_rays": self.lost_rays,
            "beyond_um": self.beyond_um,
        }


@checked
def form_effect(sensor: Sensor, form: FormError) -> FormEffect:
    """What a form error does to the picture of a sensor.

    Parameters
    ----------
    sensor
        With the mirror that was meant.
    form
        Of the mirror that was made.

    Returns
    -------
    FormEffect
        By exactly traced rays to objects all over the field, as :func:`omnimirror.tolerance` traces them.

    Raises
    ------
    InvalidParameter
        The form error is that of another mirror, or the sensor is one that tolerances are not computed of.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> rng, mirror = np.random.default_rng(1), sensor.mirror
    >>> r, phi = mirror.rim_radius_mm * np.sqrt(rng.uniform(0, 1, 4000)), rng.uniform(0, 2 * np.pi, 4000)
    >>> x, y = r * np.cos(phi), r * np.sin(phi)
    >>> bump = 2e-3 * np.sqrt(6) * (x**2 - y**2) / mirror.rim_radius_mm**2
    >>> form = om.form_error(mirror, np.stack([x, y, mirror.sag(r) + bump], axis=-1))
    >>> effect = form_effect(sensor, form)
    >>> effect.made["motion_px"] > effect.made["motion_px after affine"] > 0.0
    True
    """
    _check_its_mirror(sensor, form)
    judge, names = Judge.of(sensor), merit_names()
    amounts = {term.noll: term.um for term in form.terms}
    values = {f"mirror.zernike_{j}_um": np.array([0.0, amounts.get(j, 0.0)]) for j in range(1, TERMS + 1)}
    meant, made = (dict(zip(names, row.tolist(), strict=True)) for row in judge.judged(values))
    lost, _ = int(made.pop("lost_rays")), meant.pop("lost_rays")
    beyond = float(np.sqrt(sum(um**2 for j, um in amounts.items() if j > TERMS)))
    return FormEffect(meant, made, lost, beyond)


@checked
def as_made(sensor: Sensor, form: FormError, *, whole: bool = False) -> Sensor:
    """The sensor with its mirror as it was made, to be saved, simulated and straightened with.

    Parameters
    ----------
    sensor
        With the mirror that was meant.
    form
        Of the one that was made.
    whole
        With what is not about the axis too, as its ``mirror_form``; such a sensor has no meridian any more, and rays,
        pictures and straightening are valid for it. By default only with the part about the axis.

    Returns
    -------
    Sensor
        Its mirror a sampled profile, its vertex as far away as the form says.

    Raises
    ------
    InvalidParameter
        The form error is that of another mirror; or the whole of it is asked of a sensor of two mirrors.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> x, y = np.meshgrid(np.linspace(-43, 43, 61), np.linspace(-43, 43, 61))
    >>> inside = np.hypot(x, y) < 43
    >>> points = np.stack([x, y, sensor.mirror.sag(np.minimum(np.hypot(x, y), 43))], axis=-1)[inside]
    >>> made = as_made(sensor, om.form_error(sensor.mirror, points))
    >>> made.mirror.KIND, bool(abs(made.mirror.sag(40.0) - sensor.mirror.sag(40.0)) < 1e-6)
    ('sampled', True)
    """
    _check_its_mirror(sensor, form)
    if whole:
        sensor.check("a mirror with all of its form error", "one mirror")
        beside = {t.noll: t.um for t in form.terms if noll(t.noll)[1] and t.noll <= TERMS}
        sensor = replace(sensor, mirror_form=MirrorForm(tuple(beside), tuple(beside.values())))
    away, pose, second = 1e-3 * form.vertex_um, sensor.mirror_pose, sensor.secondary
    if second is not None:  # two mirrors stand where their distances say
        farther = replace(second, distance_mm=second.distance_mm + away)
        distance = sensor.mirror_distance_mm + away
        return replace(sensor, mirror=form.corrected(), secondary=farther, mirror_distance_mm=distance)
    moved = replace(pose, displacement_mm=pose.displacement_mm + away)
    return replace(sensor, mirror=form.corrected(), mirror_pose=moved)


def _check_its_mirror(sensor: Sensor, form: FormError) -> None:
    if form.mirror != sensor.mirror:
        raise InvalidParameter(f"the form error is that of another mirror than {sensor.name!r} has")
