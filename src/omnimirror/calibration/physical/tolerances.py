"""Which numbers of a sensor are free to be estimated, and how far the built one may be from the drawing."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ...base.arguments import WrongKind, checked, number, shown
from ...base.errors import InvalidParameter
from ...optics.sensor import Sensor
from .names import DISTANCE, NAME, known_names, lens_names, place_of, shape_names, value_of

GROUPS = ("shape", "focal", "centre", "distortion", "distance", "decentre", "tilt")
"""Words for several parameters at once, in the order in which the model has them."""
USUAL = ("focal", "distance", "decentre", "tilt")
"""What is free unless said otherwise: the mirror is as drawn, and mounted as well as hands can."""


MADE_UP = 0.5
"""How far off numbers may be that were made up, relative."""
OFF_AXIS = 0.05
"""How far off the middle of what a lens shows its axis may be, in widths of the picture."""
ANY_CONIC, TERM = 10.0, 0.1  # standard deviations: of a conic constant; of its terms' sag at the rim, in rim radii


class ParameterPrior(NamedTuple):
    """What is known of a parameter beforehand, from a drawing and its tolerance."""

    name: str
    value: float
    sigma: float
    """Standard deviation, in the parameter's unit."""


def group_names(sensor: Sensor, group: str) -> tuple[str, ...]:
    """The parameters of a sensor that a word of :data:`GROUPS` means.

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
    """Groups and names, as the names of parameters, each once.

    Raises
    ------
    InvalidParameter
        A word that is neither.
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
    """Tolerances of an ordinary workshop for those parameters that pictures alone hardly tell apart.

    Focal length and distance 5 %, the optical axis 1 % of the picture's width, the mirror's place 3 % of its radius
    and 3 deg. The shape has none, nor has distortion: whoever frees them wants to know.
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
    """What is known of a mirror of which nothing is: that it sits as usual, but not how far away, nor by which lens.

    Its focal length and its distance were made up to begin somewhere. What pictures do not say of them has to show as
    not determined, and not as known to a workshop's tolerance. Where the lens's axis meets the picture nobody knows
    either: a mirror beside it looks much like one that is tilted, but not to its rim. Its shape is some conic, with
    terms that are small beside the mirror.
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
    """Priors of free parameters, each with a tolerance above 0."""
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
