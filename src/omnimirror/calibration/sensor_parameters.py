"""Parameters of a mirror sensor for estimation: names, groups, priors and tolerances.

Names are those of sensor files: ``mirror.radius_mm``, ``imager.centre_px[0]``.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace
from typing import Any, NamedTuple

from ..base.arguments import InvalidType, format_value, number, validate_arguments
from ..base.errors import InvalidParameter
from ..optics.lenses import Perspective
from ..optics.sensor import Sensor

# -- Parameter names and locations -----------------------------------------------------------------

NAME_PATTERN = re.compile(r"(mirror|lens|imager|mirror_pose|mount)\.(\w+)(?:\[(\d+)\])?")
DISTANCE = "mount.mirror_distance_mm"


class ParameterLocation(NamedTuple):
    """Location of a sensor parameter: its section, its key, and its index in a list."""

    section: str
    key: str
    item: int | None = None

    @property
    def name(self) -> str:
        """Name as in sensor files and error messages."""
        return f"{self.section}.{self.key}" + ("" if self.item is None else f"[{self.item}]")

    def of(self, part: Any) -> float:
        """Return the value in a section."""
        value = part.centre if self.key == "centre_px" else getattr(part, self.key)
        return float(value if self.item is None else value[self.item])

    def change(self, part: Any, value: Any) -> dict[str, Any]:
        """Return the replacements in a section for another value."""
        if self.item is None:
            return {self.key: value}
        values = list(part.centre if self.key == "centre_px" else getattr(part, self.key))
        values[self.item] = value
        return {self.key: tuple(values)}


def parameter_location(sensor: Sensor, name: str) -> ParameterLocation:
    """Return the location of a named parameter of a sensor.

    >>> import omnimirror as om
    >>> parameter_location(om.load_sensor("paper-spherical"), "imager.centre_px[1]")
    ParameterLocation(section='imager', key='centre_px', item=1)
    """
    match = NAME_PATTERN.fullmatch(name)
    names = list(parameter_names(sensor))
    if match is None or name not in names:
        raise InvalidParameter(
            f"parameters of {sensor.name!r} must be among {', '.join(names)}; got {format_value(name)}"
        )
    section, key, index = match.groups()
    return ParameterLocation(section, key, None if index is None else int(index))


def parameter_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of all parameters that affect the image of a sensor."""
    yield from shape_names(sensor)
    yield from lens_names(sensor)
    yield from ("imager.centre_px[0]", "imager.centre_px[1]", "imager.pixel_pitch_um")
    if not sensor.lens.TELECENTRIC:
        yield DISTANCE
    yield from (f"mirror_pose.{key}" for key in sensor.mirror_pose.PARAMETERS)


NON_SHAPE_PARAMETERS = (
    "omega_min_deg",
    "rim_radius_mm",
    "normalization_radius_mm",
    "uncertainty_um",
    "x_mm",
    "height",
)
"""Parameters of the extent and the normalisation of a mirror, which do not affect its shape."""
LISTS_FROM_AXIS = ("slopes", "z_mm", "omega_deg")
"""Lists whose first element is on the axis, where it is fixed for a smooth mirror."""


def shape_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of the mirror's shape parameters."""
    for key, parameter in sensor.mirror.PARAMETERS.items():
        value = getattr(sensor.mirror, key)
        if parameter.choices or value is None or key in NON_SHAPE_PARAMETERS:
            continue
        if isinstance(value, tuple):
            first = 1 if key in LISTS_FROM_AXIS else 0
            yield from (f"mirror.{key}[{i}]" for i in range(first, len(value)))
        else:
            yield f"mirror.{key}"


def lens_names(sensor: Sensor) -> Iterable[str]:
    """Yield the names of lens parameters that affect image positions, not only blur."""
    if not isinstance(sensor.lens, Perspective):
        yield "lens.magnification"
        return
    yield "lens.focal_length_mm"
    yield from (f"lens.{key}" for key in ("k1", "k2", "k3", "p1", "p2"))


def value_of(sensor: Sensor, location: ParameterLocation) -> float:
    """Return the value of a parameter."""
    return location.of(sensor if location.section == "mount" else getattr(sensor, location.section))


def with_values(
    sensor: Sensor, locations: Iterable[ParameterLocation], values: Iterable[float]
) -> Sensor:
    """Return the sensor with other parameter values and without uncertainty.

    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with_values(sensor, [parameter_location(sensor, "mirror.radius_mm")], [51.0]).mirror.radius_mm
    51.0
    """
    parts: dict[str, dict[str, Any]] = {}
    for location, value in zip(locations, values, strict=True):
        entries = parts.setdefault(location.section, {})
        if location.item is not None and location.key in entries:
            values_so_far = list(entries[location.key])
            values_so_far[location.item] = float(value)
            entries[location.key] = tuple(values_so_far)
            continue
        part = sensor if location.section == "mount" else getattr(sensor, location.section)
        entries |= location.change(part, float(value))
    sensor_entries = parts.pop("mount", {})
    replacements = {
        section: replace(getattr(sensor, section), **entries) for section, entries in parts.items()
    }
    return replace(sensor, **replacements, **sensor_entries, uncertainty=None)


# -- Parameter groups and priors -------------------------------------------------------------------

GROUPS = ("shape", "focal", "centre", "distortion", "distance", "decentre", "tilt")
"""Names of parameter groups, in the order of the model."""
DEFAULT_GROUPS = ("focal", "distance", "decentre", "tilt")
"""Default free parameters: nominal mirror, mounted with manual accuracy."""


ARBITRARY_SIGMA = 0.5
"""Relative standard deviation of arbitrary initial values."""
CENTRE_SIGMA = 0.05
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


@validate_arguments
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
    for entry in free:
        if entry in GROUPS:
            names |= dict.fromkeys(group_names(sensor, entry))
        elif NAME_PATTERN.fullmatch(str(entry)):
            names[parameter_location(sensor, entry).name] = None
        else:
            raise InvalidParameter(
                f"free must contain groups ({', '.join(GROUPS)}) or parameter names "
                f"({', '.join(parameter_names(sensor))}); got {format_value(entry)}"
            )
    if not names:
        raise InvalidParameter(
            f"free must contain at least one parameter of {sensor.name!r}, for example of "
            f"the groups {', '.join(GROUPS)}; got none"
        )
    return tuple(names)


def default_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return typical workshop tolerances of parameters that images alone determine poorly.

    They are 5 % for focal length and distance, 1 % of the image width for the optical axis, and 3 %
    of its radius and 3 deg for the pose of the mirror. Shape and distortion have no priors.
    """
    width, rim = sensor.imager.width_px, sensor.mirror.rim_radius_mm
    sigma = {"imager.centre_px[0]": 0.01 * width, "imager.centre_px[1]": 0.01 * width}
    sigma |= {
        f"mirror_pose.{key}": 0.03 * rim
        for key in ("decentre_x_mm", "decentre_y_mm", "displacement_mm")
    }
    sigma |= {"mirror_pose.tilt_x_deg": 3.0, "mirror_pose.tilt_y_deg": 3.0}
    for name in (DISTANCE, "lens.focal_length_mm", "lens.magnification", "imager.pixel_pitch_um"):
        if name in names:
            sigma[name] = 0.05 * value_of(sensor, parameter_location(sensor, name))
    return tuple(
        ParameterPrior(name, value_of(sensor, parameter_location(sensor, name)), sigma[name])
        for name in names
        if name in sigma
    )


def unknown_mirror_priors(sensor: Sensor, names: Iterable[str]) -> tuple[ParameterPrior, ...]:
    """Return priors of an unknown mirror: usual pose tolerances, unknown distance and lens.

    Focal length and distance are arbitrary initial values. Images that do not determine them must
    report them as undetermined, rather than known to a workshop tolerance. The position of the
    optical axis is also unknown: a decentred mirror resembles a tilted one except at its rim. The
    shape is a conic with terms that are small relative to the mirror.
    """
    names = tuple(names)
    sigma = {
        name: ARBITRARY_SIGMA * value_of(sensor, parameter_location(sensor, name))
        for name in (DISTANCE, "lens.focal_length_mm")
    }
    sigma |= {"mirror.conic": ANY_CONIC}
    sigma |= {f"imager.centre_px[{i}]": CENTRE_SIGMA * sensor.imager.width_px for i in (0, 1)}
    sigma |= {
        name: TERM * sensor.mirror.rim_radius_mm
        for name in names
        if name.startswith("mirror.coefficients")
    }
    pose_priors = (prior for prior in default_priors(sensor, names) if prior.name not in sigma)
    shape_priors = (
        ParameterPrior(n, value_of(sensor, parameter_location(sensor, n)), sigma[n])
        for n in names
        if n in sigma
    )
    return (*shape_priors, *pose_priors)


@validate_arguments
def checked_priors(
    names: tuple[str, ...], priors: Iterable[ParameterPrior]
) -> tuple[ParameterPrior, ...]:
    """Return priors of free parameters after checks, each with a positive tolerance."""
    entries = tuple(priors)
    for prior in entries:
        if not (isinstance(prior, tuple) and len(prior) == len(ParameterPrior._fields)):
            raise InvalidType(
                f"priors must be tuples (name, value, standard deviation); got {format_value(prior)}"
            )
    result = tuple(ParameterPrior(*prior) for prior in entries)
    for prior in result:
        if prior.name not in names:
            raise InvalidParameter(
                f"priors must refer to free parameters ({', '.join(names)}); got {format_value(prior.name)}"
            )
        number(f"sigma of {prior.name}", prior.sigma, above=0.0)
    return result
