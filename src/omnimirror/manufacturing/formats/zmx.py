"""OpticStudio: the sensor as a sequential .zmx file, traced from the imager through the lens to the mirror.

Sequential programs do not accept object-side field angles beyond 90 deg, so that the light path is
reversed. Surface 0 is the imager (object heights are image heights), 1 the stop and lens (a
paraxial surface), 2 the mirror, and 3 a dummy surface of the same shape, after which the ray
directions are the viewing directions of the sensor. A secondary mirror is inserted between 1 and
2, and the primary mirror is then traversed in the opposite direction. z points from the lens to
the mirror in both conventions, so that convex mirrors have positive radii. Mirrors that eight
terms do not represent are extended aspheres with extra data: number of terms, normalisation
radius, and coefficients in mm.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import cast

import numpy as np

from ... import __version__
from ...base.escaping import escape_invisible, label
from ...base.typing import Array
from ...optics.housing import wall_description
from ...optics.lenses import GaussianLens, Orthographic
from ...optics.sensor import Sensor
from ...optics.tracing.meridian import ChiefRays
from ..surface_approximation import Asphere, fit_asphere

FIELDS = 7
"""Number of field points, in equal steps of the field angle from the axis to the rim."""
WAVELENGTH_UM = 0.55


def format_zmx(sensor: Sensor, aspheres: Sequence[Asphere] | None = None) -> str:
    """Format the .zmx file; ``aspheres`` represent the mirrors, the primary mirror first.

    Examples
    --------
    >>> import omnimirror as om
    >>> text = format_zmx(om.load_sensor("paper-spherical"))
    >>> [line.split()[1] for line in text.splitlines() if line.startswith("  TYPE")]
    ['STANDARD', 'PARAXIAL', 'EVENASPH', 'EVENASPH']
    """
    aspheres = fit_aspheres(sensor) if aspheres is None else aspheres
    lines = [
        "VERS 181107 0 0 0 0",
        "MODE SEQ",
        f"NAME {label(sensor.name)}",
        *(f"NOTE 0 {escape_invisible(note)}" for note in _notes(sensor, aspheres)),
        "UNIT MM X W X CM MR CPMM",
        *_system(sensor),
        *_surfaces(sensor, aspheres),
    ]
    return "\n".join(lines) + "\n"


def write_zmx(path: Path, sensor: Sensor) -> list[Asphere]:
    """Write the file in UTF-16, as OpticStudio does, and return the aspheres, the primary mirror
    first.
    """
    aspheres = fit_aspheres(sensor)
    path.write_bytes(format_zmx(sensor, aspheres).replace("\n", "\r\n").encode("utf-16"))
    return aspheres


def fit_aspheres(sensor: Sensor) -> list[Asphere]:
    """Represent the primary mirror, and the secondary mirror if present, as aspheres."""
    second = [] if sensor.secondary is None else [sensor.secondary.mirror]
    return [fit_asphere(mirror) for mirror in (sensor.mirror, *second)]


def field_angles(sensor: Sensor) -> Array:
    """Return the field angles (n,) of the field points in deg, without the tip of a pointed mirror."""
    start = int(sensor.mirror.is_pointed)
    return np.linspace(*sensor.field_deg, FIELDS + start)[start:]


def _notes(sensor: Sensor, aspheres: Sequence[Asphere]) -> list[str]:
    two = sensor.secondary is not None
    mirrors = (sensor.mirror, sensor.secondary.mirror) if sensor.secondary else (sensor.mirror,)
    roles = ("mirror", "secondary")
    shapes = [
        f"{mirror.KIND} {role} as {asphere.words()}, {_deviation(asphere)}"
        for mirror, role, asphere in zip(mirrors, roles, aspheres, strict=False)
    ]
    way = "secondary, mirror" if two else "mirror"
    direction = (
        "angle of the ray to +z, after surface 3"
        if two
        else "180 deg - angle of the ray to +z, after surface 2"
    )
    rays = _field_rays(sensor)
    angles = _listed_deg(rays.reflected)
    shell = sensor.housing.shell
    rim = np.array([[sensor.rim_radius_px * sensor.imager.pitch_mm, 0.0]])
    distorts = not np.array_equal(sensor.lens.distorted(rim), rim)
    return [
        f"omnimirror {__version__}: {'; '.join(shapes)}.",
        f"Reversed light path: object = imager, stop = lens, {way}, then viewing directions.",
        f"Omega = {direction}. Omega of the fields, deg: {angles}.",
        *(
            [
                f"The {shell.KIND} ({wall_description(shell)}) is not included: angles are "
                "those between it and the mirror. Omega outside, deg: "
                f"{_listed_deg(rays.omega)}."
            ]
            if shell is not None
            else []
        ),
        *(["Lens distortion is not included."] if distorts and sensor.lens.IS_THIN else []),
        *(
            []
            if sensor.lens.IS_THIN
            else [
                "The lens is ideal, with the focal length, entrance pupil and focus of the sensor."
            ]
        ),
    ]


def _field_rays(sensor: Sensor) -> ChiefRays:
    """Trace the chief rays of the field points."""
    return sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(field_angles(sensor))))


def _listed_deg(angles: Array) -> str:
    return ", ".join(f"{a:.4g}" for a in np.degrees(angles))


def _deviation(asphere: Asphere) -> str:
    if not asphere.deviation_um:
        return "exact"
    return f"within {asphere.deviation_um:.2g} um of the mirror, its rays within {asphere.ray_deg:.2g} deg"


def _system(sensor: Sensor) -> list[str]:
    """Return the lines of aperture, field points and wavelength."""
    rays = _field_rays(sensor)
    if sensor.lens.TELECENTRIC:
        wide = cast(Orthographic, sensor.lens)  # light cone on the mirror side
        aperture = f"OBNA {_number(np.sin(np.arctan(wide.aperture_slope)))} 0"
        heights = rays.first.x
    else:
        aperture = f"ENPD {_number(2 * cast(GaussianLens, sensor.lens).aperture_radius)}"
        heights = -sensor.lens.ideal_height(
            rays.first.x, rays.first.w
        )  # the lens inverts the image; without distortion
    return [
        aperture,
        "ENVD 20 1 0",
        "GFAC 0 0",
        f"FTYP 1 {int(sensor.lens.TELECENTRIC)} {FIELDS} 1 0 0 0 1",
        "ROPD 2",
        "PICB 1",
        f"XFLN {' '.join(['0'] * 12)}",
        f"YFLN {' '.join([*map(_number, heights), *['0'] * (12 - FIELDS)])}",
        f"FWGN {' '.join(['1'] * 12)}",
        f"WAVM 1 {WAVELENGTH_UM} 1",
        "PWAV 1",
    ]


def _surfaces(sensor: Sensor, aspheres: Sequence[Asphere]) -> list[str]:
    second, m = sensor.secondary, sensor.meridian.m
    facing = sensor.mirror if second is None else second.mirror
    if sensor.lens.TELECENTRIC:
        # the object is the plane in focus, behind the vertex; the stop of a telecentric lens is at infinity
        to_mirror = 2 * facing.rim_radius_mm
        first = ["  COMM plane in focus", *_flat(-(sensor.lens.focus_distance_mm + to_mirror), 0.0)]
        stop = ["  COMM telecentric lens", "  STOP", *_flat(to_mirror, facing.rim_radius_mm)]
    else:
        lens = cast(GaussianLens, sensor.lens)
        to_mirror = (m if second is None else m - second.distance_mm) - lens.pupil.at_mm
        # equivalent thin lens at the entrance pupil with the same principal distance in focus
        c, focal = lens.principal_distance, lens.focal_length_mm
        if lens.pupil_from_principal:
            focal = 1 / (1 / c + 1 / lens.from_pupil)
        first = ["  COMM imager", *_flat(c, 0.0)]
        stop = ["  COMM lens", "  STOP", *_flat(to_mirror, lens.aperture_radius, "PARAXIAL")]
        stop.append(f"  PARM 1 {_number(focal)}")
    mirror, folds = aspheres[0], []
    if second is not None:
        folds = [
            _mirror("secondary", aspheres[1], -second.distance_mm, second.mirror.rim_radius_mm)
        ]
        mirror = aspheres[0].reversed()
    last = _mirror("mirror", mirror, 0.0, sensor.mirror.rim_radius_mm)
    end = ["  COMM directions", *_shape(mirror), "  DISZ 0", _diameter(sensor.mirror.rim_radius_mm)]
    surfaces = (first, stop, *folds, last, end)
    return [line for i, surface in enumerate(surfaces) for line in (f"SURF {i}", *surface)]


def _mirror(name: str, asphere: Asphere, to_next: float, rim: float) -> list[str]:
    return [
        f"  COMM {name}",
        *_shape(asphere),
        "  GLAS MIRROR 0 0 1.5 40",
        f"  DISZ {_number(to_next)}",
        _diameter(rim),
    ]


def _diameter(radius: float) -> str:
    return f"  DIAM {_number(radius)} 1 0 0 1"


def _shape(asphere: Asphere) -> list[str]:
    """Return the lines of a mirror shape, used by the mirror and the dummy surface."""
    lines = [f"  CURV {_number(asphere.curvature)} 0 0 0 0", f"  CONI {_number(asphere.conic)}"]
    if asphere.is_extended:
        data = (float(len(asphere.coefficients)), asphere.normalization_mm, *asphere.coefficients)
        kind = "XASPHERE" if asphere.kind == "even" else "XOSPHERE"
        rest = [f'  XDAT {i} {_number(a)} 0 0 1 0 0 ""' for i, a in enumerate(data, start=1)]
    else:
        kind = "EVENASPH" if asphere.kind == "even" else "ODDASPHE"
        rest = [f"  PARM {i} {_number(a)}" for i, a in enumerate(asphere.coefficients, start=1)]
    return [f"  TYPE {kind}", *lines, *rest]


def _flat(thickness: float, radius: float, kind: str = "STANDARD") -> list[str]:
    """Return the lines of a plane surface with the distance to the next one and its radius, mm."""
    return [f"  TYPE {kind}", "  CURV 0 0 0 0 0", f"  DISZ {_number(thickness)}", _diameter(radius)]


def _number(value: float) -> str:
    """Format a number so that it is restored exactly, and zero as 0."""
    return repr(float(value)) if value else "0"
