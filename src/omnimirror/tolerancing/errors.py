"""What can go wrong when a sensor is built: every error by its name, its unit, and what shops hold unasked.

A value is added to what is meant. Places and angles of the mirror are those of
:class:`omnimirror.mirrors.pose.MirrorPose`, form errors the Zernike terms of Noll over the rim's disk, in um along the
axis with an rms of 1; an imager is turned about its centre.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ..arguments import checked
from ..errors import InvalidParameter
from ..imagers import Imager
from ..lenses import Perspective
from ..mirrors import ConicAsphere, EvenPolynomial, Mirror
from ..mirrors.conics import Conic, Sphere
from ..sensor import Sensor
from .trials.zernike import TERMS

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
    in_sensor_file
        Whether a sensor file can say it.
    """

    name: str
    unit: str
    meaning: str
    usual: Mapping[str, float]
    in_sensor_file: bool = True


def _kind(
    name: str, unit: str, meaning: str, coarse: float, medium: float, fine: float, is_filed: bool = True
) -> ErrorKind:
    return ErrorKind(name, unit, meaning, dict(zip(GRADES, (coarse, medium, fine), strict=True)), is_filed)


_PLACE = (
    _kind("mirror.decentre_x_mm", "mm", "the mirror sits to the right, in the image", 0.2, 0.05, 0.01),
    _kind("mirror.decentre_y_mm", "mm", "the mirror sits down, in the image", 0.2, 0.05, 0.01),
    _kind("mirror.displacement_mm", "mm", "the mirror sits farther from the lens", 0.3, 0.1, 0.02),
    _kind("mirror.tilt_x_deg", "deg", "the mirror is turned about the image's X", 0.3, 0.1, 0.02),
    _kind("mirror.tilt_y_deg", "deg", "the mirror is turned about the image's Y", 0.3, 0.1, 0.02),
)
_LENS = (
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
    _kind("imager.tilt_x_deg", "deg", "the imager leans about the image's X", 0.5, 0.2, 0.05, False),
    _kind("imager.tilt_y_deg", "deg", "the imager leans about the image's Y", 0.5, 0.2, 0.05, False),
    _kind("imager.pitch_ppm", "ppm", "pixels are farther apart", 50.0, 20.0, 5.0),
)
FORM_SIZES = (5.0, 1.0, 0.15)
"""um rms of each Zernike term, by grade."""


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
    kinds = (*_PLACE, *_shape(sensor.mirror), *_form(), *_of_lens(sensor), *_LENS, *_IMAGER)
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
    return [_kind(f"mirror.zernike_{j}_um", "um", words.format(j), *FORM_SIZES, False) for j in range(4, TERMS + 1)]


def _of_lens(sensor: Sensor) -> list[ErrorKind]:
    f, L0, F = (getattr(sensor.lens, name, 1.0) for name in ("focal_length_mm", "focus_distance_mm", "f_number"))
    return [
        _kind("lens.focal_length_mm", "mm", "focal length", 0.03 * f, 0.01 * f, 0.002 * f),
        _kind("lens.focus_distance_mm", "mm", "distance that the lens is set to", 0.03 * L0, 0.01 * L0, 0.003 * L0),
        _kind("lens.entrance_pupil_mm", "mm", "the entrance pupil stands nearer to the mirror", 0.5, 0.2, 0.05),
        _kind("lens.f_number", "", "F-number", 0.1 * F, 0.05 * F, 0.02 * F),
    ]


GROUPS = {
    "mirror.decentre": "place of the mirror",
    "mirror.displacement": "place of the mirror",
    "mirror.tilt": "place of the mirror",
    "mirror.zernike": "form of the mirror",
    "mirror.": "shape of the mirror",
    "lens.k": "distortion",
    "lens.p": "distortion",
    "lens.": "lens",
    "imager.": "imager",
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
    """A sensor with errors, as an ordinary sensor that a file can hold.

    Parameters
    ----------
    sensor
        What is meant.
    values
        Of errors, by name, in their units.

    Returns
    -------
    Sensor
        With them.

    Raises
    ------
    InvalidParameter
        An error that it cannot have, or that a sensor file does not say: of form, and a tilt of the imager.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = perturbed(om.load_sensor("paper-spherical"), {"mirror.decentre_x_mm": 0.1, "lens.k1": 0.01})
    >>> sensor.mirror_pose.decentre_x_mm, sensor.lens.k1
    (0.1, 0.01)
    """
    known = errors_of(sensor)
    for name, value in values.items():
        check_name(name, known)
        if value and not known[name].in_sensor_file:
            raise InvalidParameter(
                f"{name} = {value:g} has no place in a sensor file; leave it out of sensors to be written"
            )
    pose = {n: getattr(sensor.mirror_pose, n) for n in sensor.mirror_pose.PARAMETERS}
    lens: dict[str, float] = {}
    for name, value in values.items():
        part, what = name.split(".", 1)
        if part == "lens":
            lens[what] = getattr(sensor.lens, what) + value
        elif what in pose:
            pose[what] += value
    built = replace(
        sensor,
        mirror=_shaped(sensor.mirror, values),
        mirror_pose=replace(sensor.mirror_pose, **pose),
        lens=replace(cast(Perspective, sensor.lens), **lens),
        imager=_placed(sensor.imager, values),
    )
    return _turned(built, values.get("imager.rotation_deg", 0.0))


def _placed(imager: Imager, values: Mapping[str, float]) -> Imager:
    """The imager with its pixels elsewhere, and farther apart."""
    shift = [values.get(f"imager.shift_{axis}_px", 0.0) for axis in "xy"]
    pitch = imager.pixel_pitch_um * (1 + 1e-6 * values.get("imager.pitch_ppm", 0.0))
    if not any(shift):
        return replace(imager, pixel_pitch_um=pitch)
    (u, v), (x, y) = imager.centre, shift
    return replace(imager, pixel_pitch_um=pitch, centre_px=(u + x, v + y))


def _turned(sensor: Sensor, angle_deg: float) -> Sensor:
    """A sensor whose imager is turned about the lens's axis: in the image's frame all others are turned back."""
    if not angle_deg:
        return sensor
    pose, lens, angle = sensor.mirror_pose, cast(Perspective, sensor.lens), np.radians(angle_deg)
    back = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    axis = pose.turned_to_camera(np.array([[0.0, 0.0, 1.0]]))[0]
    x, y = back @ axis[:2]
    decentre, tangential = back @ pose.shift[:2], back @ [lens.p2, lens.p1]
    return replace(
        sensor,
        mirror_pose=replace(
            pose,
            decentre_x_mm=float(decentre[0]),
            decentre_y_mm=float(decentre[1]),
            tilt_x_deg=float(np.degrees(-np.arcsin(y))),
            tilt_y_deg=float(np.degrees(np.arctan2(x, axis[2]))),
        ),
        lens=replace(lens, p1=float(tangential[1]), p2=float(tangential[0])),
        mount=replace(sensor.mount, forward_azimuth_deg=sensor.mount.forward_azimuth_deg - angle_deg),
    )


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


def check_name(name: str, known: Mapping[str, ErrorKind]) -> None:
    """Refuse a name of no error, with those that come near."""
    if name not in known:
        from difflib import get_close_matches

        near = get_close_matches(name, known, 3)
        advice = f"did you mean {' or '.join(near)}?" if near else f"there are {', '.join(list(known)[:8])}, .."
        raise InvalidParameter(f"{name!r} is no error that this sensor can have; {advice}")
