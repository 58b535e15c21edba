"""Solid bodies of mirrors: rim, back, flange, bores, and the parts of a sensor."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import ClassVar, cast

import numpy as np
from numpy.typing import ArrayLike

from ..base.errors import InvalidParameter
from ..base.parameters import Parameter
from ..base.typing import Array
from ..optics.housing import Housing, Rim
from ..optics.lenses import GaussianLens
from ..optics.mirrors import Mirror
from ..optics.sensor import Sensor
from ..optics.tracing.meridian import ROUNDING

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
"""Tap drill diameter of each ISO metric coarse thread (ISO 2306), mm."""
DRILL_POINT = np.radians(59.0)
"""Half the point angle of a twist drill, 118 deg."""
MIN_WALL_MM = 1.0
"""Minimum wall thickness between a bore and the mirror surface, mm."""

POINTS = 64  # nodes of Gauss-Legendre quadrature


@dataclass(frozen=True)
class Body:
    """Solid that carries a mirror surface and lies entirely behind it, towards larger z.

    Parameters
    ----------
    thickness_mm
        Thickness from the rim to the back, along the axis.
    bore_diameter_mm : optional
        Diameter of a bore on the axis, drilled from the back; none by default.
    bore_depth_mm
        Depth of the full diameter, which ends in a drill point of 118 deg; ``inf`` for a through bore.
    thread : optional
        ISO metric thread such as ``"M6"`` instead of a bore diameter; the bore is its tap drill.
    flange_width_mm
        Radial width of a flange at the back, beyond the rim; none by default.
    flange_thickness_mm
        Thickness of the flange, from the back.
    counterbore_diameter_mm : optional
        Diameter of a counterbore from the back, for a camera behind the mirror; none by default.
    counterbore_depth_mm
        Depth of the counterbore.

    Raises
    ------
    InvalidParameter
        If a value is out of range or the dimensions are inconsistent.

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
        "thickness_mm": Parameter("mm", 1e-3, 1e4, "thickness from the rim to the back"),
        "bore_diameter_mm": Parameter(
            "mm", 0.0, 1e4, "diameter of a bore on the axis, from the back"
        ),
        "bore_depth_mm": Parameter(
            "mm", 1e-3, np.inf, "depth of the full diameter; inf for a through bore"
        ),
        "thread": Parameter(
            "", 0, 0, "ISO metric thread instead of a bore diameter", ("", *TAP_DRILLS_MM)
        ),
        "flange_width_mm": Parameter("mm", 0.0, 1e4, "radial width of a flange at the back"),
        "flange_thickness_mm": Parameter("mm", 1e-3, 1e4, "thickness of the flange"),
        "counterbore_diameter_mm": Parameter(
            "mm", 0.0, 1e4, "diameter of a counterbore for the camera, from the back"
        ),
        "counterbore_depth_mm": Parameter("mm", 1e-3, 1e4, "depth of the counterbore"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if self.thread and self.bore_diameter_mm:
            raise InvalidParameter(
                f"bore_diameter_mm must not be given with thread = {self.thread}; got {self.bore_diameter_mm:g}"
            )
        if self.flange_width_mm and self.flange_thickness_mm > self.thickness_mm:
            raise InvalidParameter(
                f"flange_thickness_mm must be at most thickness_mm = {self.thickness_mm:g}; got "
                f"{self.flange_thickness_mm:g}"
            )

        if self.counterbore_diameter_mm and not (
            self.bore_goes_through and self.counterbore_diameter_mm > self.bore_mm
        ):
            raise InvalidParameter(
                "counterbore_diameter_mm must be larger than the diameter of a through bore (bore_depth_mm = inf); got "
                f"{self.counterbore_diameter_mm:g}"
            )

    @property
    def bore_mm(self) -> float:
        """Diameter of the bore, mm; 0 without a bore."""
        return TAP_DRILLS_MM[self.thread] if self.thread else self.bore_diameter_mm

    @property
    def bore_goes_through(self) -> bool:
        """True if the bore is a through bore."""
        return self.bore_mm > 0 and np.isinf(self.bore_depth_mm)

    def start_mm(self) -> float:
        """Return the radius at which the mirror surface starts: 0, or the edge of a through bore.

        Returns
        -------
        float
            Radius in mm.
        """
        return self.bore_mm / 2 if self.bore_goes_through else 0.0

    def back_mm(self, mirror: Mirror) -> float:
        """Return the height z of the back above the vertex.

        Parameters
        ----------
        mirror
            Mirror surface on this body.

        Returns
        -------
        float
            Height in mm.
        """
        z = mirror.sag(np.linspace(0.0, mirror.rim_radius_mm, 513))
        return float(z.max()) + self.thickness_mm

    @classmethod
    def of(cls, rim: Rim | None, mirror: Mirror) -> Body:
        """Create the body that corresponds to the rim of a housing.

        The edge of the rim becomes a flange. Without a rim, the result is ``Body()``.

        Parameters
        ----------
        rim
            Rim in the housing of a sensor.
        mirror
            Mirror surface on this body.

        Returns
        -------
        Body
            Corresponding body.

        Examples
        --------
        >>> from omnimirror.optics.mirrors import Sphere
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
        """Return the rim of the body as a component of a housing.

        Parameters
        ----------
        mirror
            Mirror surface on this body.

        Returns
        -------
        Rim
            Visible edge around the mirror surface.
        """
        front = self.back_mm(mirror) - (
            self.flange_thickness_mm if self.flange_width_mm else self.thickness_mm
        )
        setback = max(front - float(mirror.sag(mirror.rim_radius_mm)), 0.0)
        return Rim(self.flange_width_mm, setback, self.thickness_mm)

    def outer_radius_mm(self, mirror: Mirror) -> float:
        """Return the outer radius of the body, including its flange.

        Parameters
        ----------
        mirror
            Mirror surface on this body.

        Returns
        -------
        float
            Radius in mm.
        """
        return mirror.rim_radius_mm + self.flange_width_mm

    def outline(self, mirror: Mirror) -> Array:
        """Return the corners of the half-section, from the rim to the start of the mirror surface.

        Together with the meridian, the corners close the half-section. Without a through bore, the axis
        is one of its sides.

        Parameters
        ----------
        mirror
            Mirror surface on this body.

        Returns
        -------
        (n, 2) array
            Corners (x, z) in mm.

        Raises
        ------
        InvalidParameter
            If the bore is wider than the back or leaves less than 1 mm of wall.

        Examples
        --------
        >>> from omnimirror.optics.mirrors import Sphere
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
            corners += [
                (rim, front),
                (rim + self.flange_width_mm, front),
                (rim + self.flange_width_mm, back),
            ]
        else:
            corners += [(rim, back)]
        corners += self._bore(mirror, back) if self.bore_mm else [(0.0, back), (0.0, 0.0)]
        # the front of the flange may coincide with the rim
        return np.array([c for i, c in enumerate(corners) if i == 0 or c != corners[i - 1]])

    def _bore(self, mirror: Mirror, back: float) -> list[tuple[float, float]]:
        """Return the corners of the bore, from the back to the axis or to the mirror surface."""
        radius, rim = self.bore_mm / 2, mirror.rim_radius_mm
        if radius >= rim:
            raise InvalidParameter(
                f"bore_diameter_mm must be less than the mirror diameter {2 * rim:g}; got {self.bore_mm:g}"
            )
        if self.bore_goes_through:
            edge = (radius, float(mirror.sag(radius)))
            return (
                [*self._counterbore(mirror, back), edge]
                if self.counterbore_diameter_mm
                else [(radius, back), edge]
            )
        point = radius / np.tan(DRILL_POINT)
        r = np.linspace(0.0, radius, 129)
        bottom = back - self.bore_depth_mm - point * (1 - r / radius)
        wall = float((bottom - mirror.sag(r)).min())
        if wall < MIN_WALL_MM:
            deepest = self.bore_depth_mm + wall - MIN_WALL_MM
            advice = (
                f"use at most {np.floor(100 * deepest) / 100:g}"
                if deepest > 0
                else "increase thickness_mm"
            )
            wall_text = f"{wall:.3g} mm" if wall > 0 else "a hole"
            raise InvalidParameter(
                f"bore_depth_mm = {self.bore_depth_mm:g} must leave a wall of {MIN_WALL_MM:g} mm to the mirror "
                "surface; "
                f"got {wall_text}; {advice}, or inf for a through bore"
            )
        depth = back - self.bore_depth_mm
        return [(radius, back), (radius, depth), (0.0, float(depth - point)), (0.0, 0.0)]

    def _counterbore(self, mirror: Mirror, back: float) -> list[tuple[float, float]]:
        """Return the corners of the counterbore."""
        wide = self.counterbore_diameter_mm / 2
        deepest = max_counterbore_depth_mm(self, mirror)
        if not wide < mirror.rim_radius_mm or self.counterbore_depth_mm > deepest:
            deep = (
                f"; use a depth of at most {np.floor(100 * deepest) / 100:g}" if deepest > 0 else ""
            )
            raise InvalidParameter(
                f"a counterbore must leave a wall of {MIN_WALL_MM:g} mm to the mirror surface; got {2 * wide:g} mm, "
                f"{self.counterbore_depth_mm:g} mm deep{deep}"
            )
        floor = back - self.counterbore_depth_mm
        return [(wide, back), (wide, floor), (self.bore_mm / 2, floor)]

    def volume_mm3(self, mirror: Mirror) -> float:
        """Compute the volume of the body.

        Parameters
        ----------
        mirror
            Mirror surface on this body.

        Returns
        -------
        float
            Volume in mm3.

        Examples
        --------
        Cone on a cylinder:

        >>> from omnimirror.optics.mirrors import Cone
        >>> round(Body(thickness_mm=5.0).volume_mm3(Cone(45.0, 10.0)), 3)
        2617.994
        >>> round(np.pi * 100 * (5 + 10 / 3), 3)
        2617.994
        """
        u, weight = np.polynomial.legendre.leggauss(POINTS)
        start, rim = self.start_mm(), mirror.rim_radius_mm
        x = start + (rim - start) * (u + 1) / 2
        behind = (
            (rim - start) / 2 * float((x * (float(mirror.sag(rim)) - mirror.sag(x)) * weight).sum())
        )
        # straight sides, by Green's theorem: volume = 2 pi times the integral of x^2 / 2 dz
        (x0, z0), (x1, z1) = (
            np.array(c) for c in (self.outline(mirror)[:-1].T, self.outline(mirror)[1:].T)
        )
        sides = float(((x0 * x0 + x0 * x1 + x1 * x1) / 6 * (z1 - z0)).sum())
        # the meridian closes the outline, from its start to the rim
        level = float(mirror.sag(rim)) - float(mirror.sag(start))
        return 2 * np.pi * (sides + behind + start * start / 2 * level)

    def words(self) -> str:
        """Describe the body in a short phrase for drawings.

        Returns
        -------
        str
            Dimensions of thickness, flange and bores.

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
            parts.append(
                f"counterbore {self.counterbore_diameter_mm:g} x {self.counterbore_depth_mm:g} mm"
            )
        return ", ".join(parts)


def max_counterbore_depth_mm(body: Body, mirror: Mirror) -> float:
    """Return the largest depth of the counterbore that leaves the minimum wall and the edge of the
    bore.
    """
    r = np.linspace(
        body.bore_mm / 2, min(body.counterbore_diameter_mm / 2, mirror.rim_radius_mm), 129
    )
    return body.back_mm(mirror) - float(mirror.sag(r).max()) - MIN_WALL_MM


LENS_HEAD_MM = 14.0
"""Diameter of the head of an M12 lens, the default clearance of a counterbore, mm."""
BEFORE_LENS_MM = 2.0
"""Distance from the principal point of the lens to the bottom of its counterbore, mm."""


@dataclass(frozen=True)
class Part:
    """Mirror of a sensor together with its body.

    The frame of a secondary mirror has its origin at the vertex and z away from the lens, as for a
    single mirror. Files of both mirrors therefore use the same conventions.
    """

    sensor: Sensor
    body: Body
    is_secondary: bool = False

    @property
    def mirror(self) -> Mirror:
        """Mirror surface of this part."""
        return mirror_of(self.sensor, self.is_secondary)

    @property
    def name(self) -> str:
        """Name of the part in files and drawings."""
        return f"{self.sensor.name} secondary" if self.is_secondary else self.sensor.name


def parts_of(
    sensor: Sensor, body: Body | None = None, secondary_body: Body | None = None
) -> list[Part]:
    """Return the primary mirror, and the secondary mirror if present, with their bodies.

    The body of a primary mirror with a camera behind it receives the required bore. Missing bodies
    follow from the rims in the housing of the sensor.

    Raises
    ------
    InvalidParameter
        If the bore is narrower than required, or a body is given for an absent secondary mirror.

    Examples
    --------
    >>> import omnimirror as om
    >>> [(part.name, part.body.bore_mm) for part in parts_of(om.load_sensor("folded-spherical"), Body())]
    [('folded-spherical', 10.0), ('folded-spherical secondary', 0.0)]
    """
    body = body or Body.of(sensor.housing.rim, sensor.mirror)
    if sensor.secondary is None:
        if secondary_body is not None:
            raise InvalidParameter(
                f"secondary_body must be None for {sensor.name!r}, which has one mirror; omit its thickness"
            )
        return [Part(sensor, body)]
    second = secondary_body or Body.of(sensor.housing.secondary_rim, sensor.secondary.mirror)
    return [Part(sensor, bored(sensor, body)), Part(sensor, second, is_secondary=True)]


def with_housing(parts: list[Part], housing: Housing | None = None) -> Sensor:
    """Return the sensor with the given housing, by default its own, and the rims of the parts'
    bodies.
    """
    first, *second = parts
    housing = replace(housing or first.sensor.housing, rim=first.body.rim(first.mirror))
    if second:
        housing = replace(housing, secondary_rim=second[0].body.rim(second[0].mirror))
    return replace(first.sensor, housing=housing)


def bored(sensor: Sensor, body: Body) -> Body:
    """Add the bore through which the camera observes the secondary mirror.

    Raises
    ------
    InvalidParameter
        If the body has another bore that is blind or too narrow.
    """
    if sensor.secondary is None:
        return body
    lens = sensor.secondary.lens_height(sensor.mirror_distance_mm)
    to_imager = 0.0 if sensor.lens.TELECENTRIC else cast(GaussianLens, sensor.lens).imager_mm
    if not lens + to_imager > 0:  # camera in front of the mirror
        return body
    needed = 2 * sensor.secondary.bore_radius_mm
    if not body.bore_mm:
        return _counterbored(
            sensor, replace(body, bore_diameter_mm=needed, bore_depth_mm=np.inf), lens
        )
    if not body.bore_goes_through or body.bore_mm < needed:
        raise InvalidParameter(
            f"bore_diameter_mm must be at least {needed:g}, with bore_depth_mm = inf, for the camera of "
            f"{sensor.name!r}; "
            f"got {body.bore_mm:g}; omit the bore to obtain it automatically"
        )
    return body


def _counterbored(sensor: Sensor, body: Body, lens: float) -> Body:
    """Add a counterbore for a lens inside the body, starting slightly in front of the lens."""
    if body.counterbore_diameter_mm or not lens < body.back_mm(sensor.mirror):
        return body
    imager = sensor.imager
    diagonal = imager.pitch_mm * float(np.hypot(imager.width_px, imager.height_px))
    wide = replace(body, counterbore_diameter_mm=max(LENS_HEAD_MM, body.bore_mm + 2, diagonal + 2))
    depth = min(
        body.back_mm(sensor.mirror) - lens + BEFORE_LENS_MM,
        max_counterbore_depth_mm(wide, sensor.mirror),
    )
    fits = depth > 0 and wide.counterbore_diameter_mm / 2 < sensor.mirror.rim_radius_mm
    return replace(wide, counterbore_depth_mm=float(np.floor(100 * depth) / 100)) if fits else body


def mirror_of(sensor: Sensor, secondary: bool = False) -> Mirror:
    """Return the primary or the secondary mirror of a sensor."""
    if not secondary:
        return sensor.mirror
    if sensor.secondary is None:
        raise InvalidParameter(
            f"secondary must be False for {sensor.name!r}, which has one mirror; got True"
        )
    return sensor.secondary.mirror


def omega_of(sensor: Sensor, x_mm: ArrayLike, secondary: bool = False) -> Array:
    """Compute the field angles (n,) in rad that are reflected at radii of a mirror; NaN without a ray.

    The centre of a folded sensor is obstructed, and its secondary mirror may extend beyond the used
    aperture.
    """
    x, meridian = np.asarray(x_mm, dtype=float), sensor.meridian
    ends = meridian.trace(np.array([meridian.x_min, sensor.mirror.rim_radius_mm]))
    low, high = ends.first.x if secondary else ends.x
    visible = (x >= low * (1 - ROUNDING)) & (x <= high * (1 + ROUNDING))
    omega = np.full(x.shape, np.nan)
    inside = np.clip(x[visible], low, high)
    on_mirror = meridian.x_from_first(inside) if secondary else inside
    omega[visible] = meridian.trace(np.clip(on_mirror, *ends.x)).omega
    return omega
