"""Lens prescription in the format of an optical program, and an independent ray tracer for it.

The triplet is a textbook design (f = 50 mm, f/5, 20 deg), scaled to the focal length of the bundled
sensors.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import brentq

SCALE = 11.6 / 50
RADII = SCALE * np.array([22.01359, -435.76044, -22.21328, 20.29192, 79.68360, -18.39533])
GAPS = SCALE * np.array([3.25896, 6.00755, 0.99997, 4.75041, 2.95208, 42.20778])
GLASSES = ["N-SK16", "", "F2", "", "N-SK16", ""]
STOP = 4  # starting at 1: the back of the flint
F_NUMBER = 4.0
FOCUS = 212.0  # from the first surface


def sellmeier(wavelength_um, b, c):
    square = wavelength_um**2
    return np.sqrt(1 + sum(p * square / (square - q) for p, q in zip(b, c, strict=True)))


SCHOTT = {
    "N-SK16": ((1.34317774, 0.241144399, 0.994317969), (0.00704687339, 0.0229005000, 92.7508526)),
    "F2": ((1.34533359, 0.209073176, 0.937357162), (0.00997743871, 0.0470450767, 111.886764)),
}
"""Coefficients from SCHOTT data sheets."""


def indices(wavelength_um=0.5875618):
    """Return refractive indices before the first surface and after each."""
    return [1.0, *(sellmeier(wavelength_um, *SCHOTT[g]) if g else 1.0 for g in GLASSES)]


def zmx(stop=STOP, radii=RADII, gaps=GAPS, glasses=GLASSES, head="", per_surface=None):
    """Return the text of the file; ``per_surface`` contains additional lines by surface number."""
    lines = [
        "VERS 140124 258 36214",
        "MODE SEQ",
        "NAME Cooke triplet",
        "UNIT MM X W X CM MR CPMM",
        f"ENPD {11.6 / F_NUMBER!r}",
        "GCAT SCHOTT MISC",
        "FTYP 0 0 3 3 0 0 0",
        "XFLN 0 0 0",
        "YFLN 0 14 20",
        "WAVM 1 0.4861327 1",
        "WAVM 2 0.5875618 1",
        "WAVM 3 0.6562725 1",
        "PWAV 2",
        *head.splitlines(),
        "SURF 0",
        "  TYPE STANDARD",
        '  CURV 0.0 0 0 0 0 ""',
        "  DISZ INFINITY",
    ]
    for i, (radius, gap, glass) in enumerate(zip(radii, gaps, glasses, strict=True), start=1):
        lines += [f"SURF {i}", *(["  STOP"] if i == stop else []), "  TYPE STANDARD"]
        lines += [f'  CURV {float(1 / radius)!r} 0 0 0 0 ""', f"  DISZ {float(gap)!r}"]
        lines += [f"  GLAS {glass} 0 0 1.5 40 0 0 0"] if glass else []
        lines += (per_surface or {}).get(i, [])
    return (
        "\n".join([*lines, f"SURF {len(radii) + 1}", "  TYPE STANDARD", "  CURV 0", "  DISZ 0"])
        + "\n"
    )


# -- rays ------------------------------------------------------------------------------------------------------


def through(start, direction, n, to_imager, radii=RADII, gaps=GAPS, stop=STOP):
    """Trace one ray to stop and imager, (2,) and (2,): spheres by their centres, Snell's law by
    tangential components."""
    p, d = np.array(start, float), np.array(direction, float) / np.linalg.norm(direction)
    vertex, at_stop = 0.0, None
    for i, radius in enumerate(radii):
        centre = np.array([0.0, 0.0, vertex + radius])
        to = p - centre
        along = to @ d
        root = np.sqrt(along**2 - to @ to + radius**2)
        p = p + (-along - np.sign(radius) * root) * d
        if i + 1 == stop:
            at_stop = p[:2].copy()
        normal = (centre - p) / radius
        across = n[i] / n[i + 1] * (d - (d @ normal) * normal)
        d = across + np.sqrt(1 - across @ across) * normal
        vertex += gaps[i] if i < len(radii) - 1 else to_imager
    return at_stop, (p + (vertex - p[2]) / d[2] * d)[:2]


def imager_place(n, focus=FOCUS, radii=RADII, gaps=GAPS):
    """Return the paraxial image distance behind the last surface for an object at ``focus``."""
    h = 1e-7
    ends = [through([0, 0, -focus], [h, 0, focus], n, z, radii, gaps)[1][0] for z in (0.0, 1.0)]
    return ends[0] / (ends[0] - ends[1])


def point_of_sphere(omega, azimuth, at, radius, distance):
    """Reflect a ray from infinity at field angle omega on a ball at (x, y); in the lens frame, s
    from its vertex."""
    x, y = at
    centre = np.array(
        [0.0, 0.0, -distance - radius]
    )  # s is measured from the first lens vertex towards the imager
    s = centre[2] + np.sqrt(radius**2 - x * x - y * y)
    point = np.array([x, y, s])
    normal = (point - centre) / radius
    out = np.array(
        [np.sin(omega) * np.cos(azimuth), np.sin(omega) * np.sin(azimuth), np.cos(omega)]
    )
    incoming = -out
    return point, incoming - 2 * (incoming @ normal) * normal


def image_of_direction(omega, stop_at, n, radius, distance, to_imager):
    """Return the upright image point (2,) mm of the ray from a distant object through a point of
    the stop."""

    def deviation(at):
        return through(*point_of_sphere(omega, 0.0, at, radius, distance), n, to_imager)

    def passing(x):
        """Return the height in a plane within the lens, without the glass."""
        p, d = point_of_sphere(omega, 0.0, (x, 0.0), radius, distance)
        return (p + (2.5 - p[2]) / d[2] * d)[0]

    # the mirror slope is half of the angle between object and lens, whose viewing angle is within
    # 20 deg of the axis
    ends = radius * np.sin(omega / 2 - np.radians([10.0, 0.0]))
    near = brentq(passing, *ends) if omega else 0.0
    at, step = np.array([near, 0.0]), 1e-6
    for _ in range(8):  # Newton's method with slopes by differences
        slopes = [
            (deviation(at + step * e)[0] - deviation(at - step * e)[0]) / (2 * step)
            for e in np.eye(2)
        ]
        at = at - np.linalg.solve(np.transpose(slopes), deviation(at)[0] - stop_at)
    assert np.abs(deviation(at)[0] - stop_at).max() < 1e-10
    return -deviation(at)[1]
