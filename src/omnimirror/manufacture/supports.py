"""What holds the mirror in front of the lens, and what of the picture it hides.

Everything here is round about the axis, so it hides rings of field angle at every azimuth. What counts is the
chief ray: near the edge of a ring the picture fades over the width of the lens's aperture.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import InvalidParameter
from ..parameters import Parameter
from ..sensor import Sensor
from ..simulate.hardware import Hardware
from ..simulate.shells import Dome, Tube
from ..tracing.meridian import ChiefRays
from ..tracing.walls import wall_transmission
from .body import Body

Array = NDArray[np.float64]

KINDS = ("tube", "dome", "rod", "none")
CLEARANCE_MM = 3.0
"""Between the rim and a tube or a dome, where its diameter is not given."""
LENS_AT_RIMS = 2.5
"""How many rim radii before the vertex a telecentric lens is drawn; it may stand anywhere."""


@dataclass(frozen=True)
class Support:
    """A transparent tube or dome around the mirror, an opaque rod from its vertex towards the lens, or nothing.

    A tube is closed by opaque discs inside it, one in the plane of the lens and one at the mirror's back, and
    reaches past the mirror as far as the rim's ray needs. Around two mirrors it begins at the back of the second. A
    dome is a sphere cut off at an opaque disc in the plane of the lens.

    Parameters
    ----------
    kind : "tube", "dome", "rod" or "none"
    diameter_mm : optional
        Outer diameter. By default a tube or a dome leaves 3 mm around the rim or the flange, to the next full
        millimetre, and a rod has 4 mm.
    wall_mm
        Of a tube or a dome.
    gap_mm : optional
        From the foot of a rod to the lens; a quarter of the mirror distance by default. (The foot stands on
        a glass plate: a rod that reached the lens would hide everything.)
    refractive_index
        Of a tube or a dome; acrylic by default.
    camera_diameter_mm
        Of what stands in the plane of the lens and is seen in the mirror; not given by default.
    centre_mm : optional
        Height of a dome's centre over the mirror's vertex, away from the lens; by default midway between the lens
        and the mirror's back. A dome about the viewpoints bends the rays least.
    end_diameter_mm : optional
        Of a rod at the mirror, if it tapers; at its foot it has ``diameter_mm``.
    """

    kind: str = "tube"
    diameter_mm: float | None = None
    wall_mm: float = 3.0
    gap_mm: float | None = None
    refractive_index: float = 1.49
    camera_diameter_mm: float = 0.0
    centre_mm: float | None = None
    end_diameter_mm: float | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "kind": Parameter("", 0, 0, "what holds the mirror", KINDS),
        "diameter_mm": Parameter("mm", 1e-3, 1e5, "outer diameter of the rod, tube or dome"),
        "wall_mm": Parameter("mm", 1e-3, 1e3, "wall of the tube or dome"),
        "gap_mm": Parameter("mm", 0.0, 1e5, "from the foot of the rod to the lens"),
        "refractive_index": Parameter("", 1.0, 4.0, "of the tube or dome"),
        "camera_diameter_mm": Parameter("mm", 0.0, 1e5, "diameter of the camera in the plane of the lens"),
        "centre_mm": Parameter("mm", -1e5, 1e5, "height of the dome's centre over the mirror's vertex"),
        "end_diameter_mm": Parameter("mm", 0.0, 1e5, "diameter of the rod at the mirror"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            value = getattr(self, f.name)
            if value is not None:
                self.PARAMETERS[f.name].check(f.name, value)

    def fitted(self, sensor: Sensor, body: Body) -> Support:
        """The same support with the sizes that it takes from the sensor.

        Raises
        ------
        InvalidParameter
            A tube or a dome that the mirror does not fit in, a dome that does not reach the lens, a rod's foot
            beyond the mirror, or what a second mirror rules out.
        """
        self._check_beside(sensor)
        outer, distance = body.outer_radius_mm(sensor.mirror), -lens_height(sensor)
        if self.kind == "tube":
            least = 2 * (outer + self.wall_mm)
            diameter = self.diameter_mm or float(np.ceil(least + 2 * CLEARANCE_MM))
            if diameter < least:
                raise InvalidParameter(
                    f"a tube of {diameter:g} mm with a wall of {self.wall_mm:g} mm does not take in the mirror; its "
                    f"diameter is valid from {least:g} mm"
                )
            return replace(self, diameter_mm=diameter)
        if self.kind == "dome":
            return self._fitted_dome(outer, body.back_mm(sensor.mirror), -distance)
        gap = distance / 4 if self.gap_mm is None else self.gap_mm
        if self.kind == "rod" and not gap < distance:
            raise InvalidParameter(f"gap_mm = {gap:g} leaves no rod; it is valid below {distance:g} mm")
        diameter = self.diameter_mm or 4.0
        end = diameter if self.end_diameter_mm is None else self.end_diameter_mm
        return replace(self, diameter_mm=diameter, gap_mm=gap, end_diameter_mm=end)

    def _fitted_dome(self, rim: float, back: float, lens: float) -> Support:
        """A dome about a mirror of this radius and height, down to the lens."""
        centre = (back + lens) / 2 if self.centre_mm is None else self.centre_mm
        farther = max(abs(back - centre), abs(lens - centre))
        least = 2 * (float(np.hypot(rim, back - centre)) + self.wall_mm)
        diameter = self.diameter_mm or float(np.ceil(2 * (np.hypot(rim + CLEARANCE_MM, farther) + self.wall_mm)))
        if diameter < least:
            raise InvalidParameter(
                f"a dome of {diameter:g} mm about a centre at {centre:.4g} mm, its wall {self.wall_mm:g} mm thick, "
                f"does not take in the mirror; its diameter is valid from {least:.5g} mm"
            )
        if diameter / 2 - self.wall_mm <= abs(lens - centre):
            raise InvalidParameter(
                f"a dome of {diameter:g} mm about a centre at {centre:.4g} mm does not reach the plane of the lens, at "
                f"{lens:.4g} mm; its diameter is valid above {2 * (abs(lens - centre) + self.wall_mm):.5g} mm"
            )
        return replace(self, diameter_mm=diameter, centre_mm=centre)

    def _check_beside(self, sensor: Sensor) -> None:
        if sensor.secondary is None:
            return
        if self.kind == "rod":
            raise InvalidParameter("a rod would stand in the view of the secondary; valid supports are tube and none")
        if self.kind == "dome":
            raise InvalidParameter("a dome is for sensors of one mirror; beside a secondary valid are tube and none")
        if self.camera_diameter_mm:
            raise InvalidParameter(
                f"camera_diameter_mm = {self.camera_diameter_mm:g} is for sensors of one mirror; beside a "
                "secondary the camera's front is its bore_radius_mm"
            )


def tube_end_mm(sensor: Sensor, support: Support, body: Body) -> float:
    """Height z (mm) where the tube ends: at the mirror's back, or where the rim's ray has left the wall."""
    assert support.diameter_mm is not None
    rim = sensor.meridian.trace(np.array([sensor.mirror.rim_radius_mm]))
    return max(body.back_mm(sensor.mirror), float(_height_at(rim, support.diameter_mm / 2)[0]))


def lens_height(sensor: Sensor) -> float:
    """Height z (mm) of the lens below the vertex; a telecentric one is drawn 2.5 rim radii away."""
    m = sensor.meridian.m
    return -m if np.isfinite(m) else -LENS_AT_RIMS * sensor.mirror.rim_radius_mm


def base_height(sensor: Sensor, secondary_body: Body | None = None) -> float:
    """Height z (mm) where a tube begins: in the plane of the lens, or at the back of a second mirror."""
    if sensor.secondary is None:
        return lens_height(sensor)
    return -sensor.secondary.distance_mm - (secondary_body or Body()).back_mm(sensor.secondary.mirror)


@dataclass(frozen=True)
class Hidden:
    """A ring of the picture that a part hides, at every azimuth.

    Attributes
    ----------
    part : what hides it
    omega_deg : (low, high)
    picture_percent : its share of the image circle's area
    """

    part: str
    omega_deg: tuple[float, float]
    picture_percent: float


def obscuration(
    sensor: Sensor, support: Support, body: Body | None = None, secondary_body: Body | None = None
) -> list[Hidden]:
    """What the support, the camera, a second mirror and the mirror's own flange hide; rings may overlap.

    Examples
    --------
    >>> import omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> for ring in obscuration(sensor, Support("rod", diameter_mm=4)):
    ...     print(ring.part, [round(v, 2) for v in ring.omega_deg], round(ring.picture_percent, 2))
    rod [0.0, 21.04] 4.35
    """
    body = Body() if body is None else body
    support = support.fitted(sensor, body)
    clearances = _clearances(sensor, support, body, secondary_body).items()
    rings = [_middle(sensor), *(_ring(sensor, part, clear) for part, clear in clearances)]
    return [ring for found in rings for ring in found]


def hidden_percent(
    sensor: Sensor, support: Support, body: Body | None = None, secondary_body: Body | None = None
) -> float:
    """Share of the image circle that is hidden by anything, rings that overlap counted once."""
    body = Body() if body is None else body
    clearances = _clearances(sensor, support.fitted(sensor, body), body, secondary_body).values()
    everything = (
        _ring(sensor, "", lambda rays: np.min([clear(rays) for clear in clearances], axis=0)) if clearances else []
    )
    return sum(ring.picture_percent for ring in (*_middle(sensor), *everything))


def _middle(sensor: Sensor) -> list[Hidden]:
    """What two mirrors hide of their own field."""
    if sensor.secondary is None:
        return []
    start = sensor.meridian.trace(np.array([sensor.meridian.x_min]))
    share = float(sensor.image_height_px(start)[0] / sensor.rim_radius_px) ** 2
    return [Hidden("secondary, bore", (0.0, float(np.degrees(start.omega[0]))), 100 * share)]


def _clearances(
    sensor: Sensor, support: Support, body: Body, secondary_body: Body | None
) -> dict[str, Callable[[ChiefRays], Array]]:
    """For each part that may hide something: how far chief rays clear it, below 0 where it hides them."""
    lens, back = lens_height(sensor), body.back_mm(sensor.mirror)
    base = base_height(sensor, secondary_body)
    parts: dict[str, Callable[[ChiefRays], Array]] = {}
    if support.kind == "rod":
        assert support.diameter_mm is not None
        assert support.gap_mm is not None
        assert support.end_diameter_mm is not None
        ends = ((lens + support.gap_mm, support.diameter_mm / 2), (0.0, support.end_diameter_mm / 2))
        # between lens and mirror both the ray and the rod are straight: nearest at the foot, or at the mirror
        parts["rod"] = lambda rays: np.min([_inwards(rays, z, lens, sensor) - radius for z, radius in ends], axis=0)
    if support.kind == "dome":
        base = _base_radius_mm(shell_of(sensor, support, body))
        parts["dome's base"] = lambda rays: _height_at(rays, base) - lens
    if support.kind == "tube":
        assert support.diameter_mm is not None
        inner = support.diameter_mm / 2 - support.wall_mm  # base and cap are discs inside the tube
        parts["tube's base"] = lambda rays: _height_at(rays, inner) - base
        parts["tube's cap"] = lambda rays: back - _height_at(rays, inner)
    if support.camera_diameter_mm:
        camera = support.camera_diameter_mm / 2
        parts["camera"] = lambda rays: _height_at(rays, camera) - lens
    if body.flange_width_mm:
        front, edge = back - body.flange_thickness_mm, body.outer_radius_mm(sensor.mirror)
        parts["flange"] = lambda rays: front - _height_at(rays, edge)
    if sensor.secondary is not None and secondary_body is not None and secondary_body.flange_width_mm:
        top, brim = base + secondary_body.flange_thickness_mm, secondary_body.outer_radius_mm(sensor.secondary.mirror)
        parts["secondary's flange"] = lambda rays: _height_at(rays, brim) - top
    return parts


def _inwards(rays: ChiefRays, height: float, lens: float, sensor: Sensor) -> Array:
    """How far from the axis (n,) chief rays are at a height between lens and mirror."""
    distance: Array = rays.x - rays.x * (rays.z - height) / (rays.z - lens) * _narrowing(sensor)
    return distance


def _narrowing(sensor: Sensor) -> float:
    """1 for a lens that sees the mirror from a point, 0 for one that looks along the axis everywhere."""
    return 0.0 if sensor.lens.TELECENTRIC else 1.0


def _height_at(rays: ChiefRays, radius: float) -> Array:
    """Height z (mm) at which rays on their way into the world are this far from the axis."""
    with np.errstate(divide="ignore", invalid="ignore"):
        height = rays.z - (radius - rays.x) / np.tan(rays.omega)
    return np.where(rays.omega > 0, height, -np.inf)


def _ring(sensor: Sensor, part: str, clear: Callable[[ChiefRays], Array]) -> list[Hidden]:
    """Rings of the picture where a clearance is below 0, their edges to rounding."""
    from scipy.optimize import brentq

    x = np.linspace(sensor.meridian.x_min, sensor.mirror.rim_radius_mm, 2049)
    hidden = clear(sensor.meridian.trace(x)) < 0
    steps = np.flatnonzero(np.diff(hidden.astype(int)))
    edges = [
        float(brentq(lambda v: np.clip(clear(sensor.meridian.trace(np.array(v))), -1e9, 1e9), x[i], x[i + 1]))
        for i in steps
    ]
    edges = [*([x[0]] if hidden[0] else []), *edges, *([x[-1]] if hidden[-1] else [])]
    rim = sensor.rim_radius_px
    rings = []
    for pair in zip(edges[::2], edges[1::2], strict=True):
        rays = sensor.meridian.trace(np.array(pair))
        h = sensor.image_height_px(rays) / rim
        low, high = np.degrees(rays.omega)
        rings.append(Hidden(part, (float(low), float(high)), float(100 * (h[1] ** 2 - h[0] ** 2))))
    return rings


# -- in pictures -------------------------------------------------------------------------------------


def hardware_of(sensor: Sensor, support: Support, body: Body | None = None) -> Hardware:
    """What of a support stands in the light of pictures: the rod, or the base of a tube or a dome, and the camera.

    Their walls are :func:`shell_of`.

    >>> import omnimirror as om
    >>> hardware_of(om.load_sensor("paper-spherical"), Support("rod", diameter_mm=4)).rod_radius_mm
    2.0
    """
    body = Body() if body is None else body
    sensor = sensor.aligned()  # supports stand about the lens's axis, wherever the mirror is
    support = support.fitted(sensor, body)
    assert support.diameter_mm is not None
    telecentric = sensor.lens.TELECENTRIC
    lens, vertex = (lens_height(sensor), 0.0) if telecentric else (0.0, -lens_height(sensor))
    camera = support.camera_diameter_mm / 2
    if support.kind in ("tube", "dome"):
        camera = max(camera, _base_radius_mm(shell_of(sensor, support, body)))
    edge = body.flange_width_mm
    hardware = Hardware(camera_radius_mm=camera, camera_height_mm=lens, rim_width_mm=edge)
    if support.kind != "rod":
        return hardware
    assert support.gap_mm is not None
    assert support.end_diameter_mm is not None
    radius, end, foot = support.diameter_mm / 2, support.end_diameter_mm / 2, lens + support.gap_mm
    return replace(hardware, rod_from_mm=foot, rod_to_mm=vertex, rod_radius_mm=radius, rod_end_radius_mm=end)


def shell_of(sensor: Sensor, support: Support, body: Body | None = None) -> Tube | Dome:
    """The wall of a support that is a tube or a dome, for pictures through it.

    Raises
    ------
    InvalidParameter
        For a support without a wall.
    """
    if support.kind not in ("tube", "dome"):
        raise InvalidParameter(f"a support of kind {support.kind!r} has no wall; tube and dome have one")
    body = Body() if body is None else body
    sensor = sensor.aligned()
    support, lens = support.fitted(sensor, body), lens_height(sensor)
    assert support.diameter_mm is not None
    radius, wall, n = support.diameter_mm / 2, support.wall_mm, support.refractive_index
    if support.kind == "tube":
        return Tube(radius, wall, n, lids_mm=(lens, body.back_mm(sensor.mirror)))
    assert support.centre_mm is not None
    return Dome(radius, wall, n, support.centre_mm, lids_mm=(lens,))


def _base_radius_mm(shell: Tube | Dome) -> float:
    """Radius of the disc in the plane of the lens."""
    return shell.inner_radius_mm(shell.lids_mm[0])


# -- what a tube does to what it lets through --------------------------------------------------------


def tube_transmission(omega_deg: ArrayLike, refractive_index: float) -> Array:
    """Share of unpolarised light (n,) that passes the tube's wall in the meridian, all reflections added.

    Fresnel's formulas at an incidence of 90 deg - Omega on the wall; (1 - R)/(1 + R) for each polarisation
    sums the reflections between both sides.

    >>> tube_transmission([90.0, 135.0], 1.5).round(4)  # 12/13 straight through
    array([0.9231, 0.9073])
    """
    return wall_transmission(np.abs(np.radians(90.0 - np.asarray(omega_deg, dtype=float))), refractive_index)


def tube_shift_mm(omega_deg: ArrayLike, wall_mm: float, refractive_index: float) -> Array:
    """How far the tube's wall moves rays (n,) sideways in the meridian, mm; their direction stays.

    >>> tube_shift_mm([90.0, 135.0], 3.0, 1.5).round(3)
    array([0.   , 0.987])
    """
    incidence = np.abs(np.radians(90.0 - np.asarray(omega_deg, dtype=float)))
    sin = np.sin(incidence)
    shift: Array = wall_mm * sin * (1 - np.cos(incidence) / np.sqrt(refractive_index**2 - sin**2))
    return shift
