"""The solid behind the mirror surface: rim, back, flange and bore."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..housing import Housing, Rim
from ..lenses import GaussianLens
from ..mirrors import Mirror
from ..parameters import Parameter
from ..sensor import Sensor
from ..tracing.meridian import ROUNDING

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


LENS_HEAD_MM = 14.0
"""Diameter of the head of an M12 lens, for which a counterbore has room unless it is said."""
BEFORE_LENS_MM = 2.0
"""How far before the lens's principal point its counterbore reaches, where there is wall."""


@dataclass(frozen=True)
class Part:
    """A mirror of a sensor and the solid behind it.

    A secondary has a frame of its own: its vertex is the origin, and z leads away from the lens, as does that of
    a mirror without one; so every file of it reads like that of any mirror.
    """

    sensor: Sensor
    body: Body
    is_secondary: bool = False

    @property
    def mirror(self) -> Mirror:
        return mirror_of(self.sensor, self.is_secondary)

    @property
    def name(self) -> str:
        return f"{self.sensor.name} secondary" if self.is_secondary else self.sensor.name


def parts_of(sensor: Sensor, body: Body | None = None, secondary_body: Body | None = None) -> list[Part]:
    """The first mirror, with the bore through which a camera behind it looks, and the second one if there is one.

    Bodies that are not given are those that the rims of the sensor's housing say.

    Raises
    ------
    InvalidParameter
        A bore that is narrower than the camera needs, or a body for a second mirror that is not there.

    Examples
    --------
    >>> import omnimirror as om
    >>> [(part.name, part.body.bore_mm) for part in parts_of(om.load_sensor("folded-spherical"), Body())]
    [('folded-spherical', 10.0), ('folded-spherical secondary', 0.0)]
    """
    body = body or Body.of(sensor.housing.rim, sensor.mirror)
    if sensor.secondary is None:
        if secondary_body is not None:
            raise InvalidParameter(f"{sensor.name!r} has no secondary; leave out the thickness of one")
        return [Part(sensor, body)]
    second = secondary_body or Body.of(sensor.housing.secondary_rim, sensor.secondary.mirror)
    return [Part(sensor, bored(sensor, body)), Part(sensor, second, is_secondary=True)]


def housed(parts: list[Part], housing: Housing | None = None) -> Sensor:
    """Return the sensor with the housing that is drawn, by default its own; the rims are those of the parts' bodies."""
    first, *second = parts
    housing = replace(housing or first.sensor.housing, rim=first.body.rim(first.mirror))
    if second:
        housing = replace(housing, secondary_rim=second[0].body.rim(second[0].mirror))
    return replace(first.sensor, housing=housing)


def bored(sensor: Sensor, body: Body) -> Body:
    """The body of the first mirror, pierced where the camera looks through it.

    Raises
    ------
    InvalidParameter
        The body has another bore, which does not go through or is narrower.
    """
    if sensor.secondary is None:
        return body
    lens = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    to_imager = 0.0 if sensor.lens.TELECENTRIC else cast(GaussianLens, sensor.lens).imager_mm
    if not lens + to_imager > 0:  # the camera stands before the mirror
        return body
    needed = 2 * sensor.secondary.bore_radius_mm
    if not body.bore_mm:
        return _counterbored(sensor, replace(body, bore_diameter_mm=needed, bore_depth_mm=np.inf), lens)
    if not body.bore_goes_through or body.bore_mm < needed:
        raise InvalidParameter(
            f"the camera of {sensor.name!r} looks through a bore of {needed:g} mm in its mirror; a bore is valid from "
            "that diameter and all the way through, or leave it out"
        )
    return body


def _counterbored(sensor: Sensor, body: Body, lens: float) -> Body:
    """The body with room for a lens that stands inside it at a height (mm), from a little before the lens backwards."""
    if body.counterbore_diameter_mm or not lens < body.back_mm(sensor.mirror):
        return body
    imager = sensor.imager
    diagonal = imager.pitch_mm * float(np.hypot(imager.width_px, imager.height_px))
    wide = replace(body, counterbore_diameter_mm=max(LENS_HEAD_MM, body.bore_mm + 2, diagonal + 2))
    depth = min(body.back_mm(sensor.mirror) - lens + BEFORE_LENS_MM, deepest_counterbore_mm(wide, sensor.mirror))
    fits = depth > 0 and wide.counterbore_diameter_mm / 2 < sensor.mirror.rim_radius_mm
    return replace(wide, counterbore_depth_mm=float(np.floor(100 * depth) / 100)) if fits else body


def mirror_of(sensor: Sensor, secondary: bool = False) -> Mirror:
    """The first mirror, or the second one."""
    if not secondary:
        return sensor.mirror
    if sensor.secondary is None:
        raise InvalidParameter(f"{sensor.name!r} has no secondary")
    return sensor.secondary.mirror


def omega_of(sensor: Sensor, x_mm: ArrayLike, secondary: bool = False) -> Array:
    """Field angles (n,) in radians that are seen by way of points of a mirror; NaN where nothing is.

    The middle of a folded sensor is hidden, and the secondary may be wider than it need be.
    """
    x, meridian = np.asarray(x_mm, dtype=float), sensor.meridian
    ends = meridian.trace(np.array([meridian.x_min, sensor.mirror.rim_radius_mm]))
    low, high = ends.first.x if secondary else ends.x
    seen = (x >= low * (1 - ROUNDING)) & (x <= high * (1 + ROUNDING))
    omega = np.full(x.shape, np.nan)
    inside = np.clip(x[seen], low, high)
    on_mirror = meridian.x_from_first(inside) if secondary else inside
    omega[seen] = meridian.trace(np.clip(on_mirror, *ends.x)).omega
    return omega
