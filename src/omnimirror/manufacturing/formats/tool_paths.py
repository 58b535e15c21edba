"""Tool paths of a round-nosed tool for turning a mirror, as G-code or as a list of points.

If a tool of nose radius r touches the surface at x, its centre is at distance r along the surface
normal. Machines move the tool in straight lines between points; the distance of the moving centre
from the offset curve is the form error of the cut surface and determines the point spacing.

Machine frame: X is the distance from the spindle axis, Z increases from the workpiece to the tool,
and (0, 0) is the contact at the vertex. X and Z refer to the lowest point of the nose, as is usual
for lathes: the centre minus r in Z.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np

from ... import __version__
from ...base.arguments import check_fields, integer, validate_arguments
from ...base.errors import InvalidParameter
from ...base.escaping import gcode_comment, line_comment
from ...base.parameters import Parameter
from ...base.typing import Array
from ...optics.mirrors import Mirror
from ..surface_approximation import step_density

FINE = 8193  # samples of the meridian for step selection
SHARE = 0.8  # share of the tolerance for steps; the rest is for rounding and curvature variation
STEP_FRACTIONS = np.linspace(0.0, 1.0, 9)[:, None]  # positions of distance checks along each step
MIN_STEPS = 8


@dataclass(frozen=True)
class Tool:
    """Round-nosed tool and its cutting parameters.

    Parameters
    ----------
    radius_mm
        Nose radius.
    feed_um
        Feed along the surface per revolution.
    tolerance_nm
        Maximum distance of the path from the offset curve of the mirror.
    spindle_rpm
        Spindle speed.
    clearance_mm
        Distance between tool and workpiece before and after the cut.
    x_is_diameter
        Whether the machine interprets X as a diameter.

    Raises
    ------
    InvalidParameter
        If a value is out of range.

    Examples
    --------
    >>> Tool(0.5, feed_um=2.0).cusp_nm(0.0)
    1.0
    """

    radius_mm: float = 0.5
    feed_um: float = 2.0
    tolerance_nm: float = 5.0
    spindle_rpm: float = 1000.0
    clearance_mm: float = 1.0
    x_is_diameter: bool = False

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "radius_mm": Parameter("mm", 1e-3, 100.0, "nose radius of the tool"),
        "feed_um": Parameter("um", 1e-3, 1e3, "feed along the surface per revolution"),
        "tolerance_nm": Parameter("nm", 0.1, 1e5, "maximum form error of the cut surface"),
        "spindle_rpm": Parameter("1/min", 1.0, 1e5, "spindle speed"),
        "clearance_mm": Parameter("mm", 0.0, 1e3, "clearance before and after the cut"),
    }

    def __post_init__(self) -> None:
        check_fields(self)
        for name, parameter in self.PARAMETERS.items():
            parameter.check(name, getattr(self, name))

    def cusp_nm(self, curvature_per_mm: float) -> float:
        """Compute the peak-to-valley height of cusps for a meridional curvature, f^2 / 8 (1/r +
        1/R).
        """
        return 1e6 * (1e-3 * self.feed_um) ** 2 / 8 * (1 / self.radius_mm + curvature_per_mm)


@dataclass(frozen=True)
class ToolPath:
    """Points (n,) of the tool from the rim to the axis.

    Attributes
    ----------
    contact_mm : (n,)
        Radii of the points of contact.
    x_mm, z_mm : (n,)
        Lowest point of the nose in the machine frame.
    deviation_nm
        Maximum distance of the cut surface from the mirror.
    edge_deg : (minimum, maximum)
        Angular range of the used cutting edge, from Z.
    cusp_nm
        Maximum peak-to-valley height of cusps.
    length_mm
        Length of the path over the surface.
    """

    tool: Tool
    contact_mm: Array
    x_mm: Array
    z_mm: Array
    deviation_nm: float
    edge_deg: tuple[float, float]
    cusp_nm: float
    length_mm: float

    @property
    def minutes(self) -> float:
        """Duration of one cut in minutes."""
        return self.length_mm / (1e-3 * self.tool.feed_um * self.tool.spindle_rpm)

    @property
    def words(self) -> str:
        """Summary of the path."""
        low, high = self.edge_deg
        return (
            f"{len(self.x_mm)} points, nose radius {self.tool.radius_mm:g} mm, edge from {low:.1f} to {high:.1f} deg, "
            f"cusps of {self.cusp_nm:.2g} nm, {self.minutes:.0f} min per cut"
        )


@validate_arguments
def tool_path(mirror: Mirror, tool: Tool | None = None, *, digits: int = 6) -> ToolPath:
    """Compute the path of the tool nose over a mirror, from the rim to the axis.

    Parameters
    ----------
    mirror
    tool : optional
        Tool, by default ``Tool()``.
    digits
        Decimals of a millimetre in the machine file.

    Returns
    -------
    ToolPath

    Raises
    ------
    InvalidParameter
        If the nose radius exceeds a concave radius of the mirror, or the decimals are too few for the
        tolerance.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> path = tool_path(Sphere(50.0, 40.0), Tool(0.5))
    >>> path.deviation_nm < 5, path.edge_deg
    (True, (0.0, 53.13))
    >>> bool(np.abs(np.hypot(path.x_mm, path.z_mm + 50.5) - 50.5).max() < 5e-6)  # centres on a sphere
    True
    """
    tool, digits = tool or Tool(), integer("digits", digits, 3, 12)
    rounding_nm = 1e6 * 10.0**-digits / np.sqrt(2)  # combined error of X and Z
    if rounding_nm > (1 - SHARE) * tool.tolerance_nm:
        raise InvalidParameter(
            f"tolerance_nm must be at least {rounding_nm / (1 - SHARE):.2g} for digits = {digits}, which rounds "
            "by up to "
            f"{rounding_nm:.2g} nm; got {tool.tolerance_nm:g}; increase digits or the tolerance"
        )
    fine = np.linspace(0.0, mirror.rim_radius_mm, FINE)
    _, slope, bend = mirror.profile(fine)
    curvature = bend / (1 + slope**2) ** 1.5
    _check_hollows(tool, fine, curvature)
    contact = _contacts(tool, fine, slope, curvature)[::-1]
    x, z = (np.round(v, digits) for v in _lowest(mirror, tool.radius_mm, contact))
    beta = np.degrees(np.arctan(slope))
    return ToolPath(
        tool,
        contact,
        x,
        z,
        _worst_nm(mirror, tool.radius_mm, contact, x, z),
        (round(float(beta.min()), 2), round(float(beta.max()), 2)),
        tool.cusp_nm(float(curvature.max())),
        float(np.hypot(np.diff(x), np.diff(z)).sum()),
    )


def _check_hollows(tool: Tool, x: Array, curvature: Array) -> None:
    """Raise an error if the nose is larger than a concave radius of curvature of the meridian.

    A nose that fits the smallest concave radius fits everywhere, as it then curves away from the
    surface on both sides.
    """
    deepest = int(np.argmin(curvature))
    if -curvature[deepest] * tool.radius_mm >= 1:
        raise InvalidParameter(
            f"radius_mm must be less than the concave radius {-1 / curvature[deepest]:.4g} mm of the mirror at x = "
            f"{x[deepest]:.4g} mm; got {tool.radius_mm:g}"
        )


def _contacts(tool: Tool, x: Array, slope: Array, curvature: Array) -> Array:
    """Return increasing radii between which the tool centre can move in straight lines.

    A chord of length c deviates by c^2 / (8 R) from a curve of radius R. The offset curve has the
    radius R + r, and its arcs are longer by (R + r) / R. A pointed apex is an ordinary point.
    """
    per_arc = np.sqrt(
        np.abs(curvature) * (1 + tool.radius_mm * curvature) / (8e-6 * SHARE * tool.tolerance_nm)
    )
    total, share = step_density(x, np.sqrt(1 + slope**2) * per_arc)
    steps: Array = np.interp(np.linspace(0.0, 1.0, max(total, MIN_STEPS) + 1), share, x)
    return steps


def _lowest(mirror: Mirror, radius: float, x: Array) -> tuple[Array, Array]:
    """Return X and Z of the lowest point of the nose for contacts at radii x (n,)."""
    sag, slope, _ = mirror.profile(x)
    up = 1 / np.sqrt(1 + slope**2)
    return x + radius * slope * up, radius * (up - 1) - sag


def _worst_nm(mirror: Mirror, radius: float, contact: Array, x: Array, z: Array) -> float:
    """Compute the maximum distance of straight segments between points (n,) from the offset curve, nm.

    Along the normal at a point of contact, the distance is stationary in this point. Contacts
    interpolated along each step are therefore sufficient: within 2e-5 of the result for a tolerance
    of 1 um, and within 0.2 % for the largest one.
    """
    at_x, at_z = x[:-1] + STEP_FRACTIONS * np.diff(x), z[:-1] + STEP_FRACTIONS * np.diff(z) + radius
    t = contact[:-1] + STEP_FRACTIONS * np.diff(contact)
    sag, slope, _ = mirror.profile(t)
    up = 1 / np.sqrt(1 + slope**2)
    return 1e6 * float(np.abs((at_x - t) * slope * up + (at_z + sag) * up - radius).max())


# -- files -----------------------------------------------------------------------------------------------


def format_gcode(path: ToolPath, name: str, digits: int = 6) -> str:
    """Format the path as G-code: tangential approach at the rim, cut to the axis, retraction.

    Parameters
    ----------
    path
    name
        Name of the part for the header.
    digits
        Decimals of a millimetre.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> lines = format_gcode(tool_path(Sphere(50.0, 40.0)), "ball (small)").splitlines()
    >>> lines[1], lines[-5]
    ('(omnimirror tool path of ball [small])', 'G1 X0.000000 Z0.000000')
    """
    tool, twice = path.tool, 2 if path.tool.x_is_diameter else 1
    inward = np.array([path.x_mm[1] - path.x_mm[0], path.z_mm[1] - path.z_mm[0]])
    start = np.array([path.x_mm[0], path.z_mm[0]]) - tool.clearance_mm * inward / np.hypot(*inward)
    start = np.round(start, digits) + 0.0  # no negative zeros
    top = tool.clearance_mm + max(path.z_mm.max(), start[1], 0.0)

    def place(x: float, z: float) -> str:
        return f"X{twice * x:.{digits}f} Z{z + 0.0:.{digits}f}"

    counted = "diameter" if tool.x_is_diameter else "radius"
    head = [
        "%",
        f"(omnimirror tool path of {gcode_comment(name)})",
        f"(omnimirror {__version__})",
        f"(nose radius {tool.radius_mm:g} mm; X and Z of its lowest point; X is a {counted})",
        "(Z increases from the workpiece to the tool; 0 at the contact with the vertex)",
        f"(edge used from {path.edge_deg[0]:g} to {path.edge_deg[1]:g} deg from Z)",
        f"(cut surface within {path.deviation_nm:.3g} nm of the mirror; cusps of {path.cusp_nm:.3g} nm)",
        f"(one finishing cut of {path.minutes:.3g} min; roughing, tool wear and spindle error are not included)",
        "G21 G18 G90",
        f"G97 S{tool.spindle_rpm:g} M3",
        f"G0 Z{top:.{digits}f}",
        f"G0 X{twice * start[0]:.{digits}f}",
        f"G0 Z{start[1]:.{digits}f}",
        f"G95 F{1e-3 * tool.feed_um:.6f}",
    ]
    way = [f"G1 {place(x, z)}" for x, z in zip(path.x_mm, path.z_mm, strict=True)]
    return "\n".join([*head, *way, f"G0 Z{top:.{digits}f}", "M5", "M30", "%"]) + "\n"


def format_points(path: ToolPath, name: str, digits: int = 6) -> str:
    """Format the path as tab-separated points of contact and of the lowest point of the nose.

    Parameters
    ----------
    path
    name
        Name of the part for the header.
    digits
        Decimals of a millimetre.

    Examples
    --------
    >>> from omnimirror.optics.mirrors import Sphere
    >>> format_points(tool_path(Sphere(50.0, 40.0)), "ball").splitlines()[-1].split("\\t")
    ['0.000000', '0.000000', '0.000000']
    """
    head = [
        f"# omnimirror tool path of {line_comment(name)}",
        f"# nose radius {path.tool.radius_mm:g} mm, largest distance from the mirror {path.deviation_nm:.3g} nm",
        "\t".join(("contact_mm", "tool_x_mm", "tool_z_mm")),
    ]
    rows = zip(path.contact_mm, path.x_mm, path.z_mm, strict=True)
    return (
        "\n".join([*head, *("\t".join(f"{v + 0.0:.{digits}f}" for v in row) for row in rows)])
        + "\n"
    )


def write_tool_path(
    path: Path, mirror: Mirror, tool: Tool, name: str, digits: int, listed: bool
) -> ToolPath:
    """Write G-code, or the list of points if ``listed``."""
    way = tool_path(mirror, tool, digits=digits)
    text = (format_points if listed else format_gcode)(way, name, digits)
    path.write_text(text, encoding="utf-8", newline="")
    return way
