"""Error sources of a sensor, their tolerances, distributions and correlations, and random errors of trials."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, cast, get_args

import numpy as np
from scipy.special import ndtr, ndtri

from ...analysis.operating_conditions import at_temperature
from ...base.arguments import (
    InvalidType,
    check_fields,
    choice,
    format_value,
    number,
    validate_arguments,
)
from ...base.errors import InvalidParameter
from ...base.typing import Array
from ...optics.housing import Housing
from ...optics.image_sensor import Imager
from ...optics.lenses import Perspective
from ...optics.mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...optics.mirrors.mirror import TERMS, Conic, MirrorForm, Sphere
from ...optics.sensor import Sensor

GRADES = ("coarse", "medium", "fine")
"""Manufacturing grades: 3-D printing or filing, turning, diamond turning with centring."""


@dataclass(frozen=True)
class ErrorSource:
    """Error source of a sensor.

    Attributes
    ----------
    name
        Name with component, parameter and unit, for example ``"mirror.decentre_x_mm"``.
    unit
        Unit for display.
    meaning
        One-line description.
    typical_tolerances
        Symmetric tolerance of each manufacturing grade.
    """

    name: str
    unit: str
    meaning: str
    typical_tolerances: Mapping[str, float]


def _kind(
    name: str, unit: str, meaning: str, coarse: float, medium: float, fine: float
) -> ErrorSource:
    return ErrorSource(name, unit, meaning, dict(zip(GRADES, (coarse, medium, fine), strict=True)))


_PLACE = (
    _kind(
        "mirror.decentre_x_mm",
        "mm",
        "decentre of the mirror, to the right in the image",
        0.2,
        0.05,
        0.01,
    ),
    _kind(
        "mirror.decentre_y_mm",
        "mm",
        "decentre of the mirror, downwards in the image",
        0.2,
        0.05,
        0.01,
    ),
    _kind(
        "mirror.displacement_mm",
        "mm",
        "displacement of the mirror away from the lens",
        0.3,
        0.1,
        0.02,
    ),
    _kind("mirror.tilt_x_deg", "deg", "tilt of the mirror about the image X axis", 0.3, 0.1, 0.02),
    _kind("mirror.tilt_y_deg", "deg", "tilt of the mirror about the image Y axis", 0.3, 0.1, 0.02),
)
_DISTORTION = (
    _kind("lens.k1", "", "radial distortion, r^2", 0.02, 0.005, 0.001),
    _kind("lens.k2", "", "radial distortion, r^4", 0.02, 0.005, 0.001),
    _kind("lens.k3", "", "radial distortion, r^6", 0.02, 0.005, 0.001),
    _kind("lens.p1", "", "tangential distortion", 0.002, 0.0005, 0.0001),
    _kind("lens.p2", "", "tangential distortion", 0.002, 0.0005, 0.0001),
)
_IMAGER = (
    _kind(
        "imager.shift_x_px",
        "px",
        "principal point shifted to the right",
        40.0,
        20.0,
        5.0,
    ),
    _kind("imager.shift_y_px", "px", "principal point shifted downwards", 40.0, 20.0, 5.0),
    _kind("imager.rotation_deg", "deg", "rotation of the imager in its plane", 1.0, 0.5, 0.1),
    _kind("imager.tilt_x_deg", "deg", "tilt of the imager about the image X axis", 0.5, 0.2, 0.05),
    _kind("imager.tilt_y_deg", "deg", "tilt of the imager about the image Y axis", 0.5, 0.2, 0.05),
    _kind("imager.pitch_ppm", "ppm", "relative increase of the pixel pitch", 50.0, 20.0, 5.0),
)
_SECONDARY = (
    _kind(
        "secondary.displacement_mm",
        "mm",
        "displacement of the secondary mirror away from the primary",
        0.3,
        0.1,
        0.02,
    ),
)
_WARMTH = (
    _kind(
        "temperature.warmer_k", "K", "temperature above the reference of [thermal]", 40.0, 20.0, 5.0
    ),
)
FORM_SIZES = (5.0, 1.0, 0.15)
"""RMS of each Zernike term by grade, um."""


MEASURED = _kind("mirror.measured", "", "multiple of a measured form error", 1.0, 1.0, 1.0)


def measured(name: str) -> str:
    """Return the name of the error source of a measured form.

    >>> measured("lathe")
    'mirror.measured[lathe]'
    """
    return f"{MEASURED.name}[{name}]"


RIGID_TERMS = frozenset(f"mirror.zernike_{j}_um" for j in range(1, 4))
"""Piston and tilt: no tolerances apply to them, but a measured form may contain them."""


def error_sources(sensor: Sensor) -> dict[str, ErrorSource]:
    """Return the error sources of a sensor by name.

    Parameters
    ----------
    sensor
        Nominal sensor.

    Returns
    -------
    dict
        Error sources, those of the mirror first.

    Examples
    --------
    >>> import omnimirror as om
    >>> [name for name in error_sources(om.load_sensor("paper-spherical")) if "radius" in name or "conic" in name]
    ['mirror.vertex_radius_mm', 'mirror.conic']
    """
    lens, has_two = sensor.lens, sensor.secondary is not None
    location = (
        [kind for kind in _PLACE if kind.name == "mirror.displacement_mm"] if has_two else _PLACE
    )
    kinds = [
        *location,
        *(_SECONDARY if has_two else ()),
        *_shape(sensor.mirror),
        *(() if has_two else _form()),
    ]
    kinds += [
        kind
        for kind in (*_lens_sources(lens), *_DISTORTION)
        if kind.name.partition(".")[2] in lens.PARAMETERS
    ]
    leans = isinstance(lens, Perspective)
    kinds += [kind for kind in _IMAGER if leans or not kind.name.startswith("imager.tilt")]
    kinds += [*_cover_sources(sensor), *(_WARMTH if sensor.thermal is not None else ())]
    return {kind.name: kind for kind in kinds}


def _shape(mirror: Any) -> list[ErrorSource]:
    """Return errors of vertex radius, conic constant and coefficients of analytic mirrors."""
    kinds = []
    radius = (
        mirror.vertex_radius
        if isinstance(mirror, Conic)
        else getattr(mirror, "vertex_radius_mm", None)
    )
    if radius is not None:
        kinds += [
            _kind(
                "mirror.vertex_radius_mm",
                "mm",
                "vertex radius",
                5e-3 * radius,
                1e-3 * radius,
                2e-4 * radius,
            ),
            _kind("mirror.conic", "", "conic constant", 0.02, 0.005, 0.001),
        ]
    if isinstance(mirror, EvenPolynomial | ConicAsphere):
        for i, value in enumerate(mirror.coefficients):
            size = abs(value) or 1e-6
            description = f"coefficient {i} of the polynomial"
            kinds.append(
                _kind(
                    f"mirror.coefficients[{i}]",
                    "",
                    description,
                    1e-2 * size,
                    2e-3 * size,
                    4e-4 * size,
                )
            )
    return kinds


def _form() -> list[ErrorSource]:
    description = "form error, Noll Zernike term {}, rms"
    return [
        _kind(f"mirror.zernike_{j}_um", "um", description.format(j), *FORM_SIZES)
        for j in range(4, TERMS + 1)
    ]


def _lens_sources(lens: Any) -> list[ErrorSource]:
    """Return errors of the lens parameters; tabulated lenses have only some of them."""

    def size(name: str) -> float:
        return abs(float(getattr(lens, name, None) or 1.0))

    f, L0, F, Fw, mu = map(
        size,
        ("focal_length_mm", "focus_distance_mm", "f_number", "working_f_number", "magnification"),
    )
    return [
        _kind("lens.focal_length_mm", "mm", "focal length", 0.03 * f, 0.01 * f, 0.002 * f),
        _kind("lens.magnification", "", "magnification", 0.03 * mu, 0.01 * mu, 0.002 * mu),
        _kind("lens.focus_distance_mm", "mm", "focus distance", 0.03 * L0, 0.01 * L0, 0.003 * L0),
        _kind(
            "lens.entrance_pupil_mm",
            "mm",
            "displacement of the entrance pupil towards the mirror",
            0.5,
            0.2,
            0.05,
        ),
        _kind("lens.f_number", "", "F-number", 0.1 * F, 0.05 * F, 0.02 * F),
        _kind("lens.working_f_number", "", "working F-number", 0.1 * Fw, 0.05 * Fw, 0.02 * Fw),
    ]


def _cover_sources(sensor: Sensor) -> list[ErrorSource]:
    """Return errors of the tube, dome or window."""
    if sensor.housing.shell is None:
        return []
    shell = sensor.obstructions.housing.shell
    kinds = [
        _kind("cover.wall_mm", "mm", "increase of the wall thickness, inwards", 0.3, 0.1, 0.02),
        _kind("cover.diameter_mm", "mm", "increase of the cover diameter", 0.5, 0.2, 0.05),
        _kind("cover.refractive_index", "", "refractive index of the wall", 2e-3, 1e-3, 5e-4),
        _kind(
            "cover.decentre_x_mm",
            "mm",
            "decentre of the cover, to the right in the image",
            0.5,
            0.2,
            0.05,
        ),
        _kind(
            "cover.decentre_y_mm",
            "mm",
            "decentre of the cover, downwards in the image",
            0.5,
            0.2,
            0.05,
        ),
        _kind(
            "cover.tilt_x_deg", "deg", "tilt of the cover about the image X axis", 0.5, 0.2, 0.05
        ),
        _kind(
            "cover.tilt_y_deg", "deg", "tilt of the cover about the image Y axis", 0.5, 0.2, 0.05
        ),
        _kind("cover.centre_mm", "mm", "displacement of the dome upwards", 0.5, 0.2, 0.05),
        _kind("cover.height_mm", "mm", "displacement of the window upwards", 0.5, 0.2, 0.05),
        _kind(
            "cover.inner_shift_mm",
            "mm",
            "displacement of the inner sphere of the dome relative to the outer",
            0.1,
            0.05,
            0.01,
        ),
    ]
    return [kind for kind in kinds if getattr(shell, kind.name.partition(".")[2], None) is not None]


GROUPS = {
    "mirror.decentre": "position of the mirror",
    "mirror.displacement": "position of the mirror",
    "mirror.tilt": "position of the mirror",
    "mirror.zernike": "form of the mirror",
    "mirror.measured": "form of the mirror",
    "mirror.": "shape of the mirror",
    "lens.k": "distortion",
    "lens.p": "distortion",
    "lens.": "lens",
    "imager.": "imager",
    "secondary.": "position of the secondary mirror",
    "cover.": "cover",
    "temperature.": "temperature",
}
"""Groups of error sources by prefix; the first matching prefix applies."""


def group_of(name: str) -> str:
    """Return the group of an error source.

    >>> group_of("mirror.conic"), group_of("lens.k1")
    ('shape of the mirror', 'distortion')
    """
    return next(group for start, group in GROUPS.items() if name.startswith(start))


@validate_arguments
def perturbed(sensor: Sensor, values: Mapping[str, float]) -> Sensor:
    """Return a sensor with errors.

    Parameters
    ----------
    sensor
        Nominal sensor.
    values
        Errors by name, in their units.

    Returns
    -------
    Sensor
        Perturbed sensor, at the perturbed temperature.

    Raises
    ------
    InvalidParameter
        If the sensor does not have an error source, or the errors result in an invalid sensor.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = perturbed(om.load_sensor("paper-spherical"), {"mirror.decentre_x_mm": 0.1, "lens.k1": 0.01})
    >>> sensor.mirror_pose.decentre_x_mm, sensor.lens.k1
    (0.1, 0.01)
    """
    check_error_names(sensor, values)
    lens = _perturbed_parameters(sensor.lens, "lens.", values)
    built = replace(
        sensor,
        mirror=_shaped(sensor.mirror, values),
        mirror_form=_formed(sensor.mirror_form, values),
        lens=replace(cast(Any, sensor.lens), **lens),
        imager=_placed(sensor.imager, values),
        imager_pose=replace(
            sensor.imager_pose, **_perturbed_parameters(sensor.imager_pose, "imager.", values)
        ),
        housing=_covered(sensor, values),
        **_displaced_mirrors(sensor, values),
    )
    if warmer := values.get("temperature.warmer_k", 0.0):
        assert sensor.thermal is not None, "temperature errors require a thermal model"
        return at_temperature(built, sensor.thermal.reference_c + warmer)
    return built


def _perturbed_parameters(part: Any, start: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return the perturbed parameters of a component."""
    named = {
        name.removeprefix(start): value for name, value in values.items() if name.startswith(start)
    }
    return {
        name: getattr(part, name) + value
        for name, value in named.items()
        if value and name in part.PARAMETERS
    }


def _displaced_mirrors(sensor: Sensor, values: Mapping[str, float]) -> dict[str, Any]:
    """Return perturbed mirror positions; both displacements change the path of a folded sensor."""
    if (second := sensor.secondary) is None:
        return {
            "mirror_pose": replace(
                sensor.mirror_pose, **_perturbed_parameters(sensor.mirror_pose, "mirror.", values)
            )
        }
    first, farther = (
        values.get("mirror.displacement_mm", 0.0),
        values.get("secondary.displacement_mm", 0.0),
    )
    return {
        "secondary": replace(second, distance_mm=second.distance_mm + first + farther),
        "mirror_distance_mm": sensor.mirror_distance_mm + first + 2 * farther,
    }


def _covered(sensor: Sensor, values: Mapping[str, float]) -> Housing:
    """Return the housing with a perturbed cover, whose nominal dimensions are fitted to the nominal
    sensor.
    """
    if sensor.housing.shell is None:
        return sensor.housing
    shell: Any = sensor.obstructions.housing.shell
    if values.get("cover.refractive_index"):
        shell = replace(shell, material=None, refractive_index=shell.index)
    return replace(
        sensor.housing, shell=replace(shell, **_perturbed_parameters(shell, "cover.", values))
    )


def _formed(form: MirrorForm, values: Mapping[str, float]) -> MirrorForm:
    """Add form errors to the form of the mirror."""
    amounts = dict(zip(form.zernike, form.um, strict=True))
    for name, value in values.items():
        if value and name.startswith("mirror.zernike"):
            term = int(name.split("_")[1])
            amounts[term] = amounts.get(term, 0.0) + value
    return MirrorForm(tuple(amounts), tuple(amounts.values()))


def _placed(imager: Imager, values: Mapping[str, float]) -> Imager:
    """Return the imager with a shifted centre and a scaled pixel pitch."""
    shift = [values.get(f"imager.shift_{axis}_px", 0.0) for axis in "xy"]
    pitch = imager.pixel_pitch_um * (1 + 1e-6 * values.get("imager.pitch_ppm", 0.0))
    if not any(shift):
        return replace(imager, pixel_pitch_um=pitch)
    (u, v), (x, y) = imager.centre, shift
    return replace(imager, pixel_pitch_um=pitch, centre_px=(u + x, v + y))


def _shaped(mirror: Any, values: Mapping[str, float]) -> Mirror:
    """Return the mirror with shape errors."""
    radius, conic = values.get("mirror.vertex_radius_mm", 0.0), values.get("mirror.conic", 0.0)
    shaped: Mirror = mirror
    if isinstance(mirror, EvenPolynomial | ConicAsphere):
        new = tuple(
            c + values.get(f"mirror.coefficients[{i}]", 0.0)
            for i, c in enumerate(mirror.coefficients)
        )
        shaped = replace(mirror, coefficients=new)
    if isinstance(shaped, ConicAsphere):
        return replace(
            shaped, vertex_radius_mm=shaped.vertex_radius_mm + radius, conic=shaped.conic + conic
        )
    if isinstance(mirror, Sphere) and not conic:
        return replace(mirror, radius_mm=mirror.radius_mm + radius)
    if isinstance(mirror, Conic) and (radius or conic):  # the perturbed shape is a general conic
        return ConicAsphere(
            mirror.vertex_radius + radius, mirror.conic + conic, mirror.rim_radius_mm
        )
    return shaped


def check_error_names(sensor: Sensor, names: Iterable[str]) -> None:
    """Raise an error for error sources that a sensor does not have."""
    sources = error_sources(sensor)
    for name in names:
        if name not in RIGID_TERMS:
            check_name(name, sources)


NEEDED = {
    "temperature.": "no [thermal] table",
    "cover.": "no tube, dome or window in [housing]",
    "secondary.": "no secondary mirror",
    "imager.tilt": "a lens without a known exit pupil",
}
"""Missing component of sensors without the error sources of a prefix."""


def check_name(name: str, sources: Mapping[str, ErrorSource]) -> None:
    """Raise an error for an unknown error source, with similar names."""
    if not isinstance(name, str):
        raise InvalidType(f"error names must be strings; got {format_value(name)}")
    if name not in sources:
        from difflib import get_close_matches

        near = get_close_matches(name, sources, 3)
        advice = (
            f"did you mean {' or '.join(near)}?"
            if near
            else f"use {', '.join(list(sources)[:8])}, ..."
        )
        for start, needed in NEEDED.items():
            if name.startswith(start) and not any(other.startswith(start) for other in sources):
                advice = f"it has {needed}"
        raise InvalidParameter(f"{name!r} is not an error source of this sensor; {advice}")


# -- Tolerances ------------------------------------------------------------------------------------

Distribution = Literal["uniform", "normal", "truncated-normal", "arcsine", "constant"]
DISTRIBUTIONS: tuple[Distribution, ...] = get_args(Distribution)
"""Distributions within the tolerance t: uniform; normal with t = 2 sigma; the same, truncated at t;
arcsine, with a maximum at both ends, as for parts machined until they pass; constant t."""

SIGMAS = 2.0  # tolerance of a normal distribution in standard deviations
UNLIKELY = float(ndtr(-SIGMAS))


def drawn(distribution: Distribution, probability: Array) -> Array:
    """Compute quantiles of a distribution in units of the tolerance.

    Parameters
    ----------
    distribution
        Name of the distribution.
    probability : array
        Probabilities in (0, 1).

    Returns
    -------
    array
        Quantiles.

    Examples
    --------
    >>> probability = np.array([0.25, 0.5, 0.975])
    >>> for name in DISTRIBUTIONS:
    ...     print(name, drawn(name, probability).round(3) + 0.0)
    uniform [-0.5   0.    0.95]
    normal [-0.337  0.     0.98 ]
    truncated-normal [-0.32   0.     0.839]
    arcsine [-0.707  0.     0.997]
    constant [1. 1. 1.]
    """
    if distribution == "constant":
        return np.ones_like(probability)
    if distribution == "uniform":
        return 2 * probability - 1
    if distribution == "normal":
        return np.asarray(ndtri(probability) / SIGMAS)
    if distribution == "truncated-normal":
        return np.asarray(ndtri(UNLIKELY + probability * (1 - 2 * UNLIKELY)) / SIGMAS)
    return -np.cos(np.pi * probability)  # arcsine distribution


BLOCK = 8192
"""Number of trials per block; each block has its own random numbers, independent of execution
order."""
MIN_TOLERANCE, MAX_TOLERANCE = 1e-50, 1e6
"""Range of a nonzero tolerance in any unit, which avoids underflow and overflow of squares."""
MIN_PROBABILITY = 2.0**-54  # avoids infinite quantiles at 0


@dataclass(frozen=True)
class Tolerance:
    """Tolerance of one error: half-width and distribution.

    Parameters
    ----------
    value
        Half-width in the unit of the error: 0, or between 1e-50 and 1e6.
    distribution
        Distribution of the error.

    Raises
    ------
    InvalidParameter
        If the value is out of range or the distribution is unknown.

    Examples
    --------
    >>> Tolerance(0.1, "normal")
    Tolerance(value=0.1, distribution='normal')
    """

    value: float
    distribution: Distribution = "uniform"

    def __post_init__(self) -> None:
        check_fields(self)
        choice("distribution", self.distribution, DISTRIBUTIONS)
        value = number("tolerance", self.value)
        if value != 0 and not MIN_TOLERANCE <= value <= MAX_TOLERANCE:
            raise InvalidParameter(
                f"tolerance must be 0, or between {MIN_TOLERANCE:g} and {MAX_TOLERANCE:g}; got {value:g}"
            )


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of a sensor.

    Parameters
    ----------
    sensor
        Nominal sensor.
    errors
        Tolerances by error source
        (:func:`omnimirror.manufacturing.tolerancing.tolerances.error_sources`).
    correlations
        Correlation coefficients of pairs of errors, between -1 and 1, of the underlying normal
        variables.
    forms
        Form errors by name: the error ``mirror.measured[NAME]`` is a multiple of that form.

    Raises
    ------
    InvalidParameter
        If an error source is unknown or the correlations are inconsistent.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> tolerances = Tolerances(sensor, {"mirror.decentre_x_mm": Tolerance(0.1)})
    >>> values = tolerances.drawn(seed=1, block=0, count=1000)["mirror.decentre_x_mm"]
    >>> bool(np.abs(values).max() <= 0.1), len(values)
    (True, 1000)
    """

    sensor: Sensor
    errors: Mapping[str, Tolerance]
    correlations: Mapping[tuple[str, str], float] = field(default_factory=dict)
    forms: Mapping[str, MirrorForm] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_fields(self)
        sources = error_sources(self.sensor) | {measured(name): MEASURED for name in self.forms}
        for name in self.errors:
            check_name(name, sources)
        if not self.errors:
            raise InvalidParameter("errors must contain at least one error; got none")
        self._mixing()

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the errors, in order."""
        return tuple(self.errors)

    def drawn(self, seed: int, block: int, count: int = BLOCK) -> dict[str, Array]:
        """Draw the errors of a block of trials; the result is reproducible.

        Parameters
        ----------
        seed
            Random seed.
        block
            Block number, from 0.
        count
            Number of trials of the block.

        Returns
        -------
        dict of (n,) arrays
            Errors of n trials by name, in their units.

        Raises
        ------
        InvalidParameter
            If count exceeds the size of a block.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": Tolerance(0.01)})
        >>> again = [tolerances.drawn(seed=3, block=5, count=10)["lens.k1"] for _ in range(2)]
        >>> bool((again[0] == again[1]).all())
        True
        """
        if not 0 <= count <= BLOCK:
            raise InvalidParameter(f"count must be between 0 and {BLOCK}; got {count}")
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence([seed, block])))
        return self.at(
            np.maximum(random.random((BLOCK, len(self.errors)))[:count], MIN_PROBABILITY)
        )

    def at(self, probabilities: Array) -> dict[str, Array]:
        """Transform probabilities (t, n) in (0, 1) to errors.

        Parameters
        ----------
        probabilities : (t, n)
            Independent probabilities, one per error.

        Returns
        -------
        dict of (n,) arrays
            Errors of n trials by name, in their units.

        Examples
        --------
        >>> import omnimirror as om
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), {"lens.k1": Tolerance(0.01)})
        >>> tolerances.at(np.array([[0.5], [0.75]]))["lens.k1"]
        array([0.   , 0.005])
        """
        if self.correlations:
            from scipy.special import ndtri

            probabilities = ndtr(ndtri(probabilities) @ self._mixing().T)
        columns = zip(self.errors.items(), probabilities.T, strict=True)
        drawn_ = {
            name: t.value * drawn(t.distribution, np.ascontiguousarray(probability))
            for (name, t), probability in columns
        }
        return self.expand_forms(drawn_)

    def expand_forms(self, values: Mapping[str, Array]) -> dict[str, Array]:
        """Replace measured forms by their Zernike terms.

        Parameters
        ----------
        values : dict of (n,) arrays
            Errors by name.

        Returns
        -------
        dict of (n,) arrays
            Errors without measured forms.

        Examples
        --------
        >>> import omnimirror as om
        >>> forms = {"lathe": om.optics.mirrors.mirror.MirrorForm((5,), (0.3,))}
        >>> errors = {"mirror.measured[lathe]": Tolerance(1.0)}
        >>> tolerances = Tolerances(om.load_sensor("paper-spherical"), errors, forms=forms)
        >>> tolerances.expand_forms({"mirror.measured[lathe]": np.array([2.0])})
        {'mirror.zernike_5_um': array([0.6])}
        """
        spelt = dict(values)
        for name, form in self.forms.items():
            amount = spelt.pop(measured(name), None)
            for j, um in zip(form.zernike, form.um, strict=True) if amount is not None else ():
                term = f"mirror.zernike_{int(j)}_um"
                spelt[term] = spelt.get(term, 0.0) + um * np.asarray(amount)
        return spelt

    def _mixing(self) -> Array:
        """Return the symmetric square root (n, n) of the correlation matrix; uncorrelated errors
        are unchanged.
        """
        matrix = np.eye(len(self.errors))
        for pair, value in self.correlations.items():
            if not (isinstance(pair, tuple) and len(pair) == 2):
                raise InvalidParameter(
                    f"keys of correlations must be pairs of error names; got {format_value(pair)}"
                )
            first, second = pair
            for name in (first, second):
                if name not in self.errors:
                    raise InvalidParameter(
                        f"the correlation of {first} and {second} requires a tolerance of {name}"
                    )
            if first == second:
                raise InvalidParameter(
                    f"correlations must be between two different errors; got {first} twice"
                )
            if not -1 <= value <= 1:
                raise InvalidParameter(
                    f"the correlation of {first} and {second} must be between -1 and 1; got {value:g}"
                )
            i, j = self.names.index(first), self.names.index(second)
            matrix[i, j] = matrix[j, i] = value
        values, vectors = np.linalg.eigh(matrix)
        if values[0] < -1e-9:
            raise InvalidParameter(
                "correlations must form a positive semidefinite matrix; reduce one of them"
            )
        return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)) @ vectors.T)
