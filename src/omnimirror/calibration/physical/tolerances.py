"""Free parameters of a sensor for estimation, and tolerances of the as-built sensor."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ...base.arguments import WrongKind, checked, number, shown
from ...base.errors import InvalidParameter
from ...optics.sensor import Sensor
from .names import DISTANCE, NAME, known_names, lens_names, place_of, shape_names, value_of

GROUPS = ("shape", "focal", "centre", "distortion", "distance", "decentre", "tilt")
"""Names of parameter groups, in the order of the model."""
USUAL = ("focal", "distance", "decentre", "tilt")
"""Default free parameters: nominal mirror, mounted with manual accuracy."""


MADE_UP = 0.5
"""Relative standard deviation of arbitrary initial values."""
OFF_AXIS = 0.05
"""Standard deviation of the optical axis from the image centre, relative to the image width."""
ANY_CONIC, TERM = 10.0, 0.1  # standard deviations: conic; sag of terms at the rim, rim radii


class ParameterPrior(NamedTuple):
    """Prior knowledge of a parameter, from a drawing and its tolerance."""

    name: str
    value: float
    sigma: float
    """Standard deviation, in the unit of the parameter."""


def group_names(sensor: Sensor, group: str) -> tuple[str, ...]:
    """Return the parameters of a sensor in a group of :data:`GROUPS`.

    >>> import omnimirror as om
    >>> group_names(om.load_sensor("paper-spherical"), "shape")
    ('mirror.radius_mm',)
    """
    lens, *distortion = lens_names(sensor)
    names: dict[str, Iterable[str]] = {
        "shape": shape_names(sensor),
        "focal": (lens,),
        "centre": ("imager.centre_px[0]", "imager.centre_px[1]"),
        "distortion": distortion,
        "distance": () if sensor.lens.TELECENTRIC else (DISTANCE,),
        "decentre": ("mirror_pose.decentre_x_mm", "mirror_pose.decentre_y_mm"),
        "tilt": ("mirror_pose.tilt_x_deg", "mirror_pose.tilt_y_deg"),
    }
    return tuple(names[group])


@checked
def free_names(sensor: Sensor, free: str | Iterable[str]) -> tuple[str, ...]:
    """Return the unique parameter names of groups and names.

    Raises
    ------
    InvalidParameter
        If a word is neither a group nor a parameter.
    """
    if isinstance(free, str):
        free = (free,)
    names: dict[str, None] = {}
    for word in free:
        if word in GROUPS:
            names |= dict.fromkeys(group_names(sensor, word))
        elif NAME.fullmatch(str(word)):
            names[place_of(sensor, word).name] = None
        else:
            raise InvalidParameter(
                f"{shown(word)} is no parameter; valid are the groups {', '.join(GROUPS)} and the names "
                f"{', '.join(known_names(sensor))}"
            )
    if not names:
        raise InvalidParameter(f"nothing of {sensor.name!r} is free; give one of {', '.join(GROUPS)} at least")
    return tuple(names)


def usual_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return typical workshop tolerances of parameters that images alone determine poorly.

    They are 5 % for focal length and distance, 1 % of the image width for the optical axis, and 3 %
    of its radius and 3 deg for the pose of the mirror. Shape and distortion have no priors.
    """
    width, rim = sensor.imager.width_px, sensor.mirror.rim_radius_mm
    sigma = {"imager.centre_px[0]": 0.01 * width, "imager.centre_px[1]": 0.01 * width}
    sigma |= {f"mirror_pose.{key}": 0.03 * rim for key in ("decentre_x_mm", "decentre_y_mm", "displacement_mm")}
    sigma |= {"mirror_pose.tilt_x_deg": 3.0, "mirror_pose.tilt_y_deg": 3.0}
    for name in (DISTANCE, "lens.focal_length_mm", "lens.magnification", "imager.pixel_pitch_um"):
        if name in names:
            sigma[name] = 0.05 * value_of(sensor, place_of(sensor, name))
    return tuple(
        ParameterPrior(name, value_of(sensor, place_of(sensor, name)), sigma[name]) for name in names if name in sigma
    )


def guessed_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return priors of an unknown mirror: usual pose tolerances, unknown distance and lens.

    Focal length and distance are arbitrary initial values. Images that do not determine them must
    report them as undetermined, rather than known to a workshop tolerance. The position of the
    optical axis is also unknown: a decentred mirror resembles a tilted one except at its rim. The
    shape is a conic with terms that are small relative to the mirror.
    """
    names = tuple(names)
    sigma = {name: MADE_UP * value_of(sensor, place_of(sensor, name)) for name in (DISTANCE, "lens.focal_length_mm")}
    sigma |= {"mirror.conic": ANY_CONIC}
    sigma |= {f"imager.centre_px[{i}]": OFF_AXIS * sensor.imager.width_px for i in (0, 1)}
    sigma |= {name: TERM * sensor.mirror.rim_radius_mm for name in names if name.startswith("mirror.coefficients")}
    mounted = (prior for prior in usual_priors(sensor, names) if prior.name not in sigma)
    made_up = (ParameterPrior(n, value_of(sensor, place_of(sensor, n)), sigma[n]) for n in names if n in sigma)
    return (*made_up, *mounted)


@checked
def checked_priors(names: tuple[str, ...], priors: Iterable[ParameterPrior]) -> tuple[ParameterPrior, ...]:
    """Return priors of free parameters after checks, each with a positive tolerance."""
    given = tuple(priors)
    for prior in given:
        if not (isinstance(prior, tuple) and len(prior) == len(ParameterPrior._fields)):
            raise WrongKind(f"{shown(prior)} among the priors is not a name, a value and its standard deviation")
    checked = tuple(ParameterPrior(*prior) for prior in given)
    for prior in checked:
        if prior.name not in names:
            raise InvalidParameter(f"a prior on {shown(prior.name)} needs it free; free are {', '.join(names)}")
        number(f"sigma of {prior.name}", prior.sigma, above=0.0)
    return checked
