"""The solid behind the mirror surface: rim, back, flange and bore."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from ..housing import Rim
from ..mirrors import Mirror
from ..parameters import Parameter

Array = NDArray[np.float64]

TAP_DRILLS_MM = {
    "M2": 1.6,
    "M2.5": 2.05,
    "M3": 2.5,
    "M4": 3.3,
    "M5": 4.2,
    "M6": 5.0,
    "M8": 6.8,
    "M10": 8.5,
    "M12": 10.2,
}
"""Drill for each ISO metric coarse thread (ISO 2306), mm."""
DRILL_POINT = np.radians(59.0)
"""Half the angle of a twist drill's point, 118 degrees."""
LEAST_WALL_MM = 1.0
"""Material that must be left between a bore and the mirror surface."""

POINTS = 64  # of Gauss's rule


@dataclass(frozen=True)
class Body:
    """The part that carries the mirror surface; all of it lies behind the surface, where z is larger.

    Parameters
    ----------
    thickness_mm
        From the rim to the back, along the axis.
    bore_diameter_mm : optional
        Bore on the axis, drilled from the back; none by default.
    bore_depth_mm
        Its full diameter reaches this deep and ends in a drill point of 118 degrees; ``inf`` goes through.
    thread : optional
        An ISO metric thread such as ``"M6"`` instead of a bore diameter: the bore is its tap drill.
    flange_width_mm
        How far a flange at the back stands out over the rim; none by default.
    flange_thickness_mm
        Of the flange, from the back forwards.
    counterbore_diameter_mm : optional
        Of a wider bore from the back, where a camera that looks through the mirror has its place; none by default.
    counterbore_depth_mm
        How deep that is.

    Raises
    ------
    InvalidParameter
        A value outside its range, or parts that do not fit each other.

    Examples
    --------
    >>> Body(thread="M6").bore_mm
    5.0
    """

    thickness_mm: float = 5.0
    bore_diameter_mm: float = 0.0
    bore_depth_mm: float = 10.0
    thread: str = ""
    flange_width_mm: float = 0.0
    flange_thickness_mm: float = 2.0
    counterbore_diameter_mm: float = 0.0
    counterbore_depth_mm: float = 5.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "thickness_mm": Parameter("mm", 1e-3, 1e4, "from the rim to the back"),
        "bore_diameter_mm": Parameter("mm", 0.0, 1e4, "diameter of a bore on the axis, from the back"),
        "bore_depth_mm": Parameter("mm", 1e-3, np.inf, "depth of the bore's full diameter; inf goes through"),
        "thread": Parameter("", 0, 0, "ISO metric thread instead of a bore diameter", ("", *TAP_DRILLS_MM)),
        "flange_width_mm": Parameter("mm", 0.0, 1e4, "how far a flange at the back stands out over the rim"),
        "flange_thickness_mm": Parameter("mm", 1e-3, 1e4, "thickness of the flange"),
        "counterbore_diameter_mm": Parameter("mm", 0.0, 1e4, "diameter of a wider bore for the camera, from the back"),
        "counterbore_depth_mm": Parameter("mm", 1e-3, 1e4, "depth of the wider bore"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if self.thread and self.bore_diameter_mm:
            raise InvalidParameter(
                f"thread = {self.thread} says how wide the bore is; leave out bore_diameter_mm = "
                f"{self.bore_diameter_mm:g}"
            )
        if self.flange_width_mm and self.flange_thickness_mm > self.thickness_mm:
            raise InvalidParameter(
                f"flange_thickness_mm = {self.flange_thickness_mm:g} reaches past the rim; it is valid up to "
                f"thickness_mm = {self.thickness_mm:g}"
            )

        if self.counterbore_diameter_mm and not (
            self.bore_goes_through and self.counterbore_diameter_mm > self.bore_mm
        ):
            raise InvalidParameter(
                f"counterbore_diameter_mm = {self.counterbore_diameter_mm:g} widens a bore that goes through; it is "
                "valid above the diameter of one with bore_depth_mm = inf"
            )

    @property
    def bore_mm(self) -> float:
        """Diameter of the bore that is drilled, 0 for none."""
        return TAP_DRILLS_MM[self.thread] if self.thread else self.bore_diameter_mm

    @property
    def bore_goes_through(self) -> bool:
        return self.bore_mm > 0 and np.isinf(self.bore_depth_mm)

    def start_mm(self) -> float:
        """Distance from the axis where the mirror surface begins: 0, or the edge of a bore that goes through.

        Returns
        -------
        float
            mm
        """
        return self.bore_mm / 2 if self.bore_goes_through else 0.0

    def back_mm(self, mirror: Mirror) -> float:
        """Height z of the back over the vertex, mm.

        Parameters
        ----------
        mirror
            Whose surface the solid carries.

        Returns
        -------
        float
            mm over the vertex.
        """
        z = mirror.sag(np.linspace(0.0, mirror.rim_radius_mm, 513))
        return float(z.max()) + self.thickness_mm

    @classmethod
    def of(cls, rim: Rim | None, mirror: Mirror) -> Body:
        """The body that shows a housing's rim: its edge as a flange; ``Body()`` where nothing is said of it.

        Parameters
        ----------
        rim
            Of a sensor's housing.
        mirror
            Whose surface the solid carries.

        Returns
        -------
        Body
            The solid.

        Examples
        --------
        >>> from omnimirror.mirrors import Sphere
        >>> Body.of(Rim(4.0, setback_mm=3.0), Sphere(50.0, 30.0)).flange_thickness_mm
        2.0
        """
        if rim is None:
            return cls()
        body = cls(rim.thickness_mm)
        if not rim.width_mm:
            return body
        flange = body.back_mm(mirror) - float(mirror.sag(mirror.rim_radius_mm)) - rim.setback_mm
        return replace(body, flange_width_mm=rim.width_mm, flange_thickness_mm=flange)

    def rim(self, mirror: Mirror) -> Rim:
        """What the body shows around the mirror's rim, as a part of the sensor's housing.

        Parameters
        ----------
        mirror
            Whose surface the solid carries.

        Returns
        -------
        Rim
            For a sensor's housing.
        """
        front = self.back_mm(mirror) - (self.flange_thickness_mm if self.flange_width_mm else self.thickness_mm)
        setback = max(front - float(mirror.sag(mirror.rim_radius_mm)), 0.0)
        return Rim(self.flange_width_mm, setback, self.thickness_mm)

    def outer_radius_mm(self, mirror: Mirror) -> float:
        """Radius of the solid with its flange, mm.

        Parameters
        ----------
        mirror
            Whose surface the solid carries.

        Returns
        -------
        float
            mm
        """
        return mirror.rim_radius_mm + self.flange_width_mm

    def outline(self, mirror: Mirror) -> Array:
        """Corners (n, 2) of the section in mm, (x, z) from the rim of the surface on to where it begins.

        With the meridian they close the half-section, the axis being one of its sides where nothing goes through.

        Parameters
        ----------
        mirror
            Whose surface the solid carries.

        Returns
        -------
        (n, 2) array
            (x, z) in mm.

        Raises
        ------
        InvalidParameter
            The bore is wider than the back, or leaves less than 1 mm of wall to the surface.

        Examples
        --------
        >>> from omnimirror.mirrors import Sphere
        >>> Body(thickness_mm=5).outline(Sphere(50.0, 30.0))
        array([[30., 10.],
               [30., 15.],
               [ 0., 15.],
               [ 0.,  0.]])
        """
        rim, back = mirror.rim_radius_mm, self.back_mm(mirror)
        corners = [(rim, float(mirror.sag(rim)))]
        if self.flange_width_mm:
            front = back - self.flange_thickness_mm
            corners += [(rim, front), (rim + self.flange_width_mm, front), (rim + self.flange_width_mm, back)]
        else:
            corners += [(rim, back)]
        corners += self._bore(mirror, back) if self.bore_mm else [(0.0, back), (0.0, 0.0)]
        # the flange's front may lie at the rim itself
        return np.array([c for i, c in enumerate(corners) if i == 0 or c != corners[i - 1]])

    def _bore(self, mirror: Mirror, back: float) -> list[tuple[float, float]]:
        radius, rim = self.bore_mm / 2, mirror.rim_radius_mm
        if radius >= rim:
            raise InvalidParameter(
                f"a bore of {self.bore_mm:g} mm does not fit the mirror; its diameter is valid below {2 * rim:g} mm"
            )
        if self.bore_goes_through:
            edge = (radius, float(mirror.sag(radius)))
            return [*self._counterbore(mirror, back), edge] if self.counterbore_diameter_mm else [(radius, back), edge]
        point = radius / np.tan(DRILL_POINT)
        r = np.linspace(0.0, radius, 129)
        bottom = back - self.bore_depth_mm - point * (1 - r / radius)
        wall = float((bottom - mirror.sag(r)).min())
        if wall < LEAST_WALL_MM:
            deepest = self.bore_depth_mm + wall - LEAST_WALL_MM
            advice = f"it is valid up to {np.floor(100 * deepest) / 100:g}" if deepest > 0 else "the body is too thin"
            left = f"leaves {wall:.3g} mm of wall to" if wall > 0 else "breaks through"
            raise InvalidParameter(
                f"bore_depth_mm = {self.bore_depth_mm:g} {left} the mirror surface at the tip of the drill, and "
                f"{LEAST_WALL_MM:g} mm of wall is needed; {advice}, or inf to go through"
            )
        depth = back - self.bore_depth_mm
        return [(radius, back), (radius, depth), (0.0, float(depth - point)), (0.0, 0.0)]

    def _counterbore(self, mirror: Mirror, back: float) -> list[tuple[float, float]]:
        wide = self.counterbore_diameter_mm / 2
        deepest = deepest_counterbore_mm(self, mirror)
        if not wide < mirror.rim_radius_mm or self.counterbore_depth_mm > deepest:
            deep = f"; its depth is valid up to {np.floor(100 * deepest) / 100:g}" if deepest > 0 else ""
            raise InvalidParameter(
                f"a counterbore of {2 * wide:g} mm, {self.counterbore_depth_mm:g} mm deep, leaves less than "
                f"{LEAST_WALL_MM:g} mm of wall to the mirror surface{deep}"
            )
        floor = back - self.counterbore_depth_mm
        return [(wide, back), (wide, floor), (self.bore_mm / 2, floor)]

    def volume_mm3(self, mirror: Mirror) -> float:
        """Volume of the solid.

        Parameters
        ----------
        mirror
            Whose surface it carries.

        Returns
        -------
        float
            mm3

        Examples
        --------
        A cone on a cylinder:

        >>> from omnimirror.mirrors import Cone
        >>> round(Body(thickness_mm=5.0).volume_mm3(Cone(45.0, 10.0)), 3)
        2617.994
        >>> round(np.pi * 100 * (5 + 10 / 3), 3)
        2617.994
        """
        u, weight = np.polynomial.legendre.leggauss(POINTS)
        start, rim = self.start_mm(), mirror.rim_radius_mm
        x = start + (rim - start) * (u + 1) / 2
        behind = (rim - start) / 2 * float((x * (float(mirror.sag(rim)) - mirror.sag(x)) * weight).sum())
        # of the straight sides, by Green's theorem: the integral of x^2 / 2 along z
        (x0, z0), (x1, z1) = (np.array(c) for c in (self.outline(mirror)[:-1].T, self.outline(mirror)[1:].T))
        sides = float(((x0 * x0 + x0 * x1 + x1 * x1) / 6 * (z1 - z0)).sum())
        # the meridian closes the outline, from where it begins to the rim
        level = float(mirror.sag(rim)) - float(mirror.sag(start))
        return 2 * np.pi * (sides + behind + start * start / 2 * level)

    def words(self) -> str:
        """What the solid is, in a few words.

        Returns
        -------
        str
            For a drawing.

        Examples
        --------
        >>> Body(thread="M6", bore_depth_mm=12).words()
        '5 mm thick at the rim, M6 12 mm deep (drill 5 mm)'
        """
        parts = [f"{self.thickness_mm:g} mm thick at the rim"]
        if self.flange_width_mm:
            parts.append(f"flange {self.flange_width_mm:g} x {self.flange_thickness_mm:g} mm")
        if self.bore_mm:
            depth = "through" if self.bore_goes_through else f"{self.bore_depth_mm:g} mm deep"
            hole = f"{self.thread} {depth} (drill {self.bore_mm:g} mm)" if self.thread else ""
            parts.append(hole or f"bore {self.bore_mm:g} mm, {depth}")
        if self.counterbore_diameter_mm:
            parts.append(f"counterbore {self.counterbore_diameter_mm:g} x {self.counterbore_depth_mm:g} mm")
        return ", ".join(parts)


def deepest_counterbore_mm(body: Body, mirror: Mirror) -> float:
    """How deep a body's counterbore may be: so much wall is left as by other bores, and the bore keeps its edge."""
    r = np.linspace(body.bore_mm / 2, min(body.counterbore_diameter_mm / 2, mirror.rim_radius_mm), 129)
    return body.back_mm(mirror) - float(mirror.sag(r).max()) - LEAST_WALL_MM
