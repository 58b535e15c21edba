"""What can go wrong when a sensor is built: every error by its name, its unit, and what shops hold unasked.

A value is added to what is meant. Places and angles of the mirror are those of
:class:`omnimirror.mirrors.pose.MirrorPose`, form errors the Zernike terms of Noll over the rim's disk, in um along the
axis with an rms of 1; an imager is turned about its centre.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

from ...analysis.temperature import at_temperature
from ...arguments import WrongKind, checked, shown
from ...errors import InvalidParameter
from ...housing import Housing
from ...imagers import Imager
from ...lenses import Perspective
from ...mirrors import ConicAsphere, EvenPolynomial, Mirror
from ...mirrors.conics import Conic, Sphere
from ...mirrors.form import TERMS, MirrorForm
from ...sensor import Sensor

GRADES = ("coarse", "medium", "fine")
"""What a shop does: a printer or a file, a lathe, a diamond lathe with centring."""


@dataclass(frozen=True)
class ErrorKind:
    """What is known of an error.

    Attributes
    ----------
    name
        Of the part and what is wrong with it, with its unit: ``"mirror.decentre_x_mm"``.
    unit
        As people read it.
    meaning
        In one line.
    usual
        Its tolerance by grade, plus or minus, as shops hold it.
    """

    name: str
    unit: str
    meaning: str
    usual: Mapping[str, float]


def _kind(name: str, unit: str, meaning: str, coarse: float, medium: float, fine: float) -> ErrorKind:
    return ErrorKind(name, unit, meaning, dict(zip(GRADES, (coarse, medium, fine), strict=True)))


_PLACE = (
    _kind("mirror.decentre_x_mm", "mm", "the mirror sits to the right, in the image", 0.2, 0.05, 0.01),
    _kind("mirror.decentre_y_mm", "mm", "the mirror sits down, in the image", 0.2, 0.05, 0.01),
    _kind("mirror.displacement_mm", "mm", "the mirror sits farther from the lens", 0.3, 0.1, 0.02),
    _kind("mirror.tilt_x_deg", "deg", "the mirror is turned about the image's X", 0.3, 0.1, 0.02),
    _kind("mirror.tilt_y_deg", "deg", "the mirror is turned about the image's Y", 0.3, 0.1, 0.02),
)
_DISTORTION = (
    _kind("lens.k1", "", "distortion of the lens, r^2", 0.02, 0.005, 0.001),
    _kind("lens.k2", "", "distortion of the lens, r^4", 0.02, 0.005, 0.001),
    _kind("lens.k3", "", "distortion of the lens, r^6", 0.02, 0.005, 0.001),
    _kind("lens.p1", "", "tangential distortion of the lens", 0.002, 0.0005, 0.0001),
    _kind("lens.p2", "", "tangential distortion of the lens", 0.002, 0.0005, 0.0001),
)
_IMAGER = (
    _kind(
        "imager.shift_x_px",
        "px",
        "the lens's axis meets the imager to the right of where it was meant",
        40.0,
        20.0,
        5.0,
    ),
    _kind("imager.shift_y_px", "px", "the lens's axis meets the imager below where it was meant", 40.0, 20.0, 5.0),
    _kind("imager.rotation_deg", "deg", "the imager is turned in its plane", 1.0, 0.5, 0.1),
    _kind("imager.tilt_x_deg", "deg", "the imager leans about the image's X", 0.5, 0.2, 0.05),
    _kind("imager.tilt_y_deg", "deg", "the imager leans about the image's Y", 0.5, 0.2, 0.05),
    _kind("imager.pitch_ppm", "ppm", "pixels are farther apart", 50.0, 20.0, 5.0),
)
_SECONDARY = (
    _kind(
        "secondary.displacement_mm", "mm", "the second mirror sits farther from the first, on its axis", 0.3, 0.1, 0.02
    ),
)
_WARMTH = (
    _kind("temperature.warmer_k", "K", "all of it is warmer than [thermal] says its numbers are", 40.0, 20.0, 5.0),
)
FORM_SIZES = (5.0, 1.0, 0.15)
"""um rms of each Zernike term, by grade."""


MEASURED = _kind("mirror.measured", "", "so many times a form that was measured", 1.0, 1.0, 1.0)


def measured(name: str) -> str:
    """The error of a form that was measured.

    >>> measured("lathe")
    'mirror.measured[lathe]'
    """
    return f"{MEASURED.name}[{name}]"


PLACED = frozenset(f"mirror.zernike_{j}_um" for j in range(1, 4))
"""Piston and tilts: no tolerance is given to them, yet a measured form has some that its place does not explain."""


def errors_of(sensor: Sensor) -> dict[str, ErrorKind]:
    """The errors that a sensor can have, by name.

    Parameters
    ----------
    sensor
        What is meant.

    Returns
    -------
    dict
        Of kinds of errors, those of the mirror first.

    Examples
    --------
    >>> import omnimirror as om
    >>> [name for name in errors_of(om.load_sensor("paper-spherical")) if "radius" in name or "conic" in name]
    ['mirror.vertex_radius_mm', 'mirror.conic']
    """
    lens, has_two = sensor.lens, sensor.secondary is not None
    place = [kind for kind in _PLACE if kind.name == "mirror.displacement_mm"] if has_two else _PLACE
    kinds = [*place, *(_SECONDARY if has_two else ()), *_shape(sensor.mirror), *(() if has_two else _form())]
    kinds += [kind for kind in (*_of_lens(lens), *_DISTORTION) if kind.name.partition(".")[2] in lens.PARAMETERS]
    leans = isinstance(lens, Perspective)
    kinds += [kind for kind in _IMAGER if leans or not kind.name.startswith("imager.tilt")]
    kinds += [*_of_cover(sensor), *(_WARMTH if sensor.thermal is not None else ())]
    return {kind.name: kind for kind in kinds}


def _shape(mirror: Any) -> list[ErrorKind]:
    """Of shapes with a formula: vertex radius, conic constant, coefficients; forms stand for those of others."""
    kinds = []
    radius = mirror.vertex_radius if isinstance(mirror, Conic) else getattr(mirror, "vertex_radius_mm", None)
    if radius is not None:
        kinds += [
            _kind("mirror.vertex_radius_mm", "mm", "radius at the vertex", 5e-3 * radius, 1e-3 * radius, 2e-4 * radius),
            _kind("mirror.conic", "", "conic constant", 0.02, 0.005, 0.001),
        ]
    if isinstance(mirror, EvenPolynomial | ConicAsphere):
        for i, value in enumerate(mirror.coefficients):
            size = abs(value) or 1e-6
            words = f"coefficient {i} of the polynomial"
            kinds.append(_kind(f"mirror.coefficients[{i}]", "", words, 1e-2 * size, 2e-3 * size, 4e-4 * size))
    return kinds


def _form() -> list[ErrorKind]:
    words = "form error, Zernike term {} of Noll, rms"
    return [_kind(f"mirror.zernike_{j}_um", "um", words.format(j), *FORM_SIZES) for j in range(4, TERMS + 1)]


def _of_lens(lens: Any) -> list[ErrorKind]:
    """Of the numbers that lenses of any kind have; a lens known by its surfaces has few of them."""

    def size(name: str) -> float:
        return abs(float(getattr(lens, name, None) or 1.0))

    f, L0, F, Fw, mu = map(
        size, ("focal_length_mm", "focus_distance_mm", "f_number", "working_f_number", "magnification")
    )
    return [
        _kind("lens.focal_length_mm", "mm", "focal length", 0.03 * f, 0.01 * f, 0.002 * f),
        _kind("lens.magnification", "", "magnification", 0.03 * mu, 0.01 * mu, 0.002 * mu),
        _kind("lens.focus_distance_mm", "mm", "distance that the lens is set to", 0.03 * L0, 0.01 * L0, 0.003 * L0),
        _kind("lens.entrance_pupil_mm", "mm", "the entrance pupil stands nearer to the mirror", 0.5, 0.2, 0.05),
        _kind("lens.f_number", "", "F-number", 0.1 * F, 0.05 * F, 0.02 * F),
        _kind("lens.working_f_number", "", "F-number on the imager's side", 0.1 * Fw, 0.05 * Fw, 0.02 * Fw),
    ]


def _of_cover(sensor: Sensor) -> list[ErrorKind]:
    """Of the tube, dome or window."""
    if sensor.housing.shell is None:
        return []
    shell = sensor.obstructions.housing.shell
    kinds = [
        _kind("cover.wall_mm", "mm", "the wall is thicker, inwards", 0.3, 0.1, 0.02),
        _kind("cover.diameter_mm", "mm", "the cover is wider", 0.5, 0.2, 0.05),
        _kind("cover.refractive_index", "", "refractive index of the wall", 2e-3, 1e-3, 5e-4),
        _kind("cover.decentre_x_mm", "mm", "the cover sits to the right, in the image", 0.5, 0.2, 0.05),
        _kind("cover.decentre_y_mm", "mm", "the cover sits down, in the image", 0.5, 0.2, 0.05),
        _kind("cover.tilt_x_deg", "deg", "the cover is turned about the image's X", 0.5, 0.2, 0.05),
        _kind("cover.tilt_y_deg", "deg", "the cover is turned about the image's Y", 0.5, 0.2, 0.05),
        _kind("cover.centre_mm", "mm", "the dome sits higher", 0.5, 0.2, 0.05),
        _kind("cover.height_mm", "mm", "the window sits higher", 0.5, 0.2, 0.05),
        _kind("cover.inner_shift_mm", "mm", "the dome's inner sphere sits higher than the outer", 0.1, 0.05, 0.01),
    ]
    return [kind for kind in kinds if getattr(shell, kind.name.partition(".")[2], None) is not None]


GROUPS = {
    "mirror.decentre": "place of the mirror",
    "mirror.displacement": "place of the mirror",
    "mirror.tilt": "place of the mirror",
    "mirror.zernike": "form of the mirror",
    "mirror.measured": "form of the mirror",
    "mirror.": "shape of the mirror",
    "lens.k": "distortion",
    "lens.p": "distortion",
    "lens.": "lens",
    "imager.": "imager",
    "secondary.": "place of the second mirror",
    "cover.": "cover",
    "temperature.": "temperature",
}
"""Of errors that belong together, by how their names begin; the first that fits."""


def group_of(name: str) -> str:
    """The group of an error.

    >>> group_of("mirror.conic"), group_of("lens.k1")
    ('shape of the mirror', 'distortion')
    """
    return next(group for start, group in GROUPS.items() if name.startswith(start))


@checked
def perturbed(sensor: Sensor, values: Mapping[str, float]) -> Sensor:
    """A sensor with errors, as an ordinary sensor that a file holds.

    Parameters
    ----------
    sensor
        What is meant.
    values
        Of errors, by name, in their units.

    Returns
    -------
    Sensor
        With them, at the temperature that they say.

    Raises
    ------
    InvalidParameter
        An error that it cannot have, or one so large that it is no sensor.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = perturbed(om.load_sensor("paper-spherical"), {"mirror.decentre_x_mm": 0.1, "lens.k1": 0.01})
    >>> sensor.mirror_pose.decentre_x_mm, sensor.lens.k1
    (0.1, 0.01)
    """
    check_built_with(sensor, values)
    lens = _of_part(sensor.lens, "lens.", values)
    built = replace(
        sensor,
        mirror=_shaped(sensor.mirror, values),
        mirror_form=_formed(sensor.mirror_form, values),
        lens=replace(cast(Any, sensor.lens), **lens),
        imager=_placed(sensor.imager, values),
        imager_pose=replace(sensor.imager_pose, **_of_part(sensor.imager_pose, "imager.", values)),
        housing=_covered(sensor, values),
        **_standing(sensor, values),
    )
    if warmer := values.get("temperature.warmer_k", 0.0):
        assert sensor.thermal is not None, "no other has this error"
        return at_temperature(built, sensor.thermal.reference_c + warmer)
    return built


def _of_part(part: Any, start: str, values: Mapping[str, float]) -> dict[str, float]:
    """Those parameters of a part that err, with their errors."""
    named = {name.removeprefix(start): value for name, value in values.items() if name.startswith(start)}
    return {name: getattr(part, name) + value for name, value in named.items() if value and name in part.PARAMETERS}


def _standing(sensor: Sensor, values: Mapping[str, float]) -> dict[str, Any]:
    """Where its mirrors stand; the way from lens to mirror by a second one grows with both."""
    if (second := sensor.secondary) is None:
        return {"mirror_pose": replace(sensor.mirror_pose, **_of_part(sensor.mirror_pose, "mirror.", values))}
    first, farther = values.get("mirror.displacement_mm", 0.0), values.get("secondary.displacement_mm", 0.0)
    return {
        "secondary": replace(second, distance_mm=second.distance_mm + first + farther),
        "mirror_distance_mm": sensor.mirror_distance_mm + first + 2 * farther,
    }


def _covered(sensor: Sensor, values: Mapping[str, float]) -> Housing:
    """The housing with errors of its cover, whose sizes are those that were fitted to the sensor that was meant."""
    if sensor.housing.shell is None:
        return sensor.housing
    shell: Any = sensor.obstructions.housing.shell
    if values.get("cover.refractive_index"):
        shell = replace(shell, material=None, refractive_index=shell.index)
    return replace(sensor.housing, shell=replace(shell, **_of_part(shell, "cover.", values)))


def _formed(form: MirrorForm, values: Mapping[str, float]) -> MirrorForm:
    """The form error of the mirror, and more of it."""
    amounts = dict(zip(form.zernike, form.um, strict=True))
    for name, value in values.items():
        if value and name.startswith("mirror.zernike"):
            term = int(name.split("_")[1])
            amounts[term] = amounts.get(term, 0.0) + value
    return MirrorForm(tuple(amounts), tuple(amounts.values()))


def _placed(imager: Imager, values: Mapping[str, float]) -> Imager:
    """The imager with its pixels elsewhere, and farther apart."""
    shift = [values.get(f"imager.shift_{axis}_px", 0.0) for axis in "xy"]
    pitch = imager.pixel_pitch_um * (1 + 1e-6 * values.get("imager.pitch_ppm", 0.0))
    if not any(shift):
        return replace(imager, pixel_pitch_um=pitch)
    (u, v), (x, y) = imager.centre, shift
    return replace(imager, pixel_pitch_um=pitch, centre_px=(u + x, v + y))


def _shaped(mirror: Any, values: Mapping[str, float]) -> Mirror:
    """The mirror with errors of its shape."""
    radius, conic = values.get("mirror.vertex_radius_mm", 0.0), values.get("mirror.conic", 0.0)
    shaped: Mirror = mirror
    if isinstance(mirror, EvenPolynomial | ConicAsphere):
        new = tuple(c + values.get(f"mirror.coefficients[{i}]", 0.0) for i, c in enumerate(mirror.coefficients))
        shaped = replace(mirror, coefficients=new)
    if isinstance(shaped, ConicAsphere):
        return replace(shaped, vertex_radius_mm=shaped.vertex_radius_mm + radius, conic=shaped.conic + conic)
    if isinstance(mirror, Sphere) and not conic:
        return replace(mirror, radius_mm=mirror.radius_mm + radius)
    if isinstance(mirror, Conic) and (radius or conic):  # what is left of it has no word of its own
        return ConicAsphere(mirror.vertex_radius + radius, mirror.conic + conic, mirror.rim_radius_mm)
    return shaped


def check_built_with(sensor: Sensor, names: Iterable[str]) -> None:
    """Refuse errors that a sensor cannot have."""
    known = errors_of(sensor)
    for name in names:
        if name not in PLACED:
            check_name(name, known)


NEEDED = {
    "temperature.": "no [thermal] in its file",
    "cover.": "no tube, dome or window in [housing]",
    "secondary.": "no second mirror",
    "imager.tilt": "a lens whose exit pupil is not known",
}
"""What a sensor lacks that has no errors of some name."""


def check_name(name: str, known: Mapping[str, ErrorKind]) -> None:
    """Refuse a name of no error, with those that come near."""
    if not isinstance(name, str):
        raise WrongKind(f"{shown(name)} is not the name of an error")
    if name not in known:
        from difflib import get_close_matches

        near = get_close_matches(name, known, 3)
        advice = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(list(known)[:8])}, .."
        for start, needed in NEEDED.items():
            if name.startswith(start) and not any(other.startswith(start) for other in known):
                advice = f"it has {needed}"
        raise InvalidParameter(f"{name!r} is no error that this sensor can have; {advice}")
