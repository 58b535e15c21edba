"""Transparent tubes and domes around a sensor: what is seen through them, dimmed, bent, and with a ghost."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ..cameras import Camera
from ..errors import InvalidParameter
from ..frames import turned
from ..parameters import Parameter
from ..sensor import Sensor
from ..tracing.walls import Passage, through_dome, through_tube
from .colour import Light
from .scenes.contract import Array, Scene

AXIS = np.array([0.0, 0.0, 1.0])
GHOSTS = 2  # ghosts of ghosts of ghosts are less than a thousandth
START_MM = 1e-4  # a ray starts on what is this near: single precision
LIFT_MM = 1e-6  # by which a ray starts off the surface that it leaves


class Shell(Protocol):
    """A transparent wall about the axis of a sensor, in the camera frame, whose origin is the mirror's vertex."""

    def passage(self, points: Array, directions: Array) -> Passage:
        """Rays (n, 3), (n, 3) from inside, traced through the wall; InvalidParameter if one starts outside."""
        ...

    def inner_radius_mm(self, height_mm: float) -> float:
        """How wide it is inside at a height, mm."""
        ...

    @property
    def lids_mm(self) -> tuple[float, ...]:
        """Heights of opaque discs that close it."""
        ...


OUTER = Parameter("mm", 1e-3, 1e5, "outer radius")
WALL = Parameter("mm", 1e-3, 1e3, "thickness of the wall")
INDEX = Parameter("", 1.0, 4.0, "of the wall")


@dataclass(frozen=True)
class Tube:
    """A clear tube about the lens's axis.

    Parameters
    ----------
    outer_radius_mm, wall_mm
    refractive_index
        Acrylic by default.
    lids_mm
        Heights over the mirror's vertex (away from the lens) of opaque discs that close it; none by default.

    Raises
    ------
    InvalidParameter
        A number outside its range, or a wall that fills the tube.
    """

    outer_radius_mm: float
    wall_mm: float = 3.0
    refractive_index: float = 1.49
    lids_mm: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "outer_radius_mm": OUTER,
        "wall_mm": WALL,
        "refractive_index": INDEX,
        "lids_mm": Parameter("mm", -1e5, 1e5, "heights of lids"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if not self.wall_mm < self.outer_radius_mm:
            raise InvalidParameter(f"wall_mm = {self.wall_mm:g} fills a tube of radius {self.outer_radius_mm:g} mm")

    def inner_radius_mm(self, height_mm: float) -> float:
        """The same at all heights, mm."""
        return self.outer_radius_mm - self.wall_mm

    def passage(self, points: Array, directions: Array) -> Passage:
        """Rays (n, 3), (n, 3) from inside, traced through the wall."""
        _check_inside("tube's axis", np.hypot(points[:, 0], points[:, 1]), self.inner_radius_mm(0.0))
        return through_tube(points, directions, AXIS, self.outer_radius_mm, self.wall_mm, self.refractive_index)


@dataclass(frozen=True)
class Dome:
    """A clear dome: the space between two spheres whose centres lie on the lens's axis.

    Parameters
    ----------
    outer_radius_mm, wall_mm
        The wall is measured where the axis meets it, if the spheres had one centre.
    refractive_index
        Acrylic by default.
    centre_mm
        Height of the outer sphere's centre over the mirror's vertex, away from the lens.
    inner_shift_mm
        By how much the inner sphere's centre is higher; 0, one centre, by default.
    lids_mm
        Heights of opaque discs that close it.

    Raises
    ------
    InvalidParameter
        A number outside its range, a wall that fills the dome, or an inner sphere that breaks through it.
    """

    outer_radius_mm: float
    wall_mm: float = 3.0
    refractive_index: float = 1.49
    centre_mm: float = 0.0
    inner_shift_mm: float = 0.0
    lids_mm: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "outer_radius_mm": OUTER,
        "wall_mm": WALL,
        "refractive_index": INDEX,
        "centre_mm": Parameter("mm", -1e5, 1e5, "height of the centre over the mirror's vertex"),
        "inner_shift_mm": Parameter("mm", -1e3, 1e3, "by how much the inner sphere's centre is higher"),
        "lids_mm": Parameter("mm", -1e5, 1e5, "heights of lids"),
    }

    def __post_init__(self) -> None:
        for f in fields(self):
            self.PARAMETERS[f.name].check(f.name, getattr(self, f.name))
        if not self.wall_mm < self.outer_radius_mm:
            raise InvalidParameter(f"wall_mm = {self.wall_mm:g} fills a dome of radius {self.outer_radius_mm:g} mm")
        if not abs(self.inner_shift_mm) < self.wall_mm:
            raise InvalidParameter(
                f"inner_shift_mm = {self.inner_shift_mm:g} breaks through a wall of {self.wall_mm:g} mm"
            )

    @property
    def inner_centre_mm(self) -> float:
        """Height of the inner sphere's centre."""
        return self.centre_mm + self.inner_shift_mm

    def inner_radius_mm(self, height_mm: float) -> float:
        """How wide it is inside at a height, mm; 0 where it does not reach."""
        square = (self.outer_radius_mm - self.wall_mm) ** 2 - (height_mm - self.inner_centre_mm) ** 2
        return float(np.sqrt(max(square, 0.0)))

    def passage(self, points: Array, directions: Array) -> Passage:
        """Rays (n, 3), (n, 3) from inside, traced through the wall."""
        inner = AXIS * self.inner_centre_mm, self.outer_radius_mm - self.wall_mm
        outer = AXIS * self.centre_mm, self.outer_radius_mm
        _check_inside("dome's centre", np.linalg.norm(points - inner[0], axis=1), inner[1])
        return through_dome(points, directions, inner, outer, self.refractive_index)


def meets_lid(shell: Shell, points: Array, directions: Array) -> NDArray[np.bool_]:
    """Which rays (n, 3), (n, 3) from inside meet one of the discs that close a shell, before its wall."""
    meets = np.zeros(len(points), dtype=bool)
    for height in shell.lids_mm:
        meets |= _meets_disc(points, directions, height, shell.inner_radius_mm(height))
        meets |= (points[:, 2] - height) * np.sign(height) > -START_MM  # thrown back in the very corner
    return meets


def _meets_disc(points: Array, directions: Array, height: float, radius: float) -> NDArray[np.bool_]:
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (height - points[:, 2]) / directions[:, 2]
        across = points[:, :2] + t[:, None] * directions[:, :2]
        meets: NDArray[np.bool_] = (t * np.abs(directions[:, 2]) > START_MM) & (np.hypot(*across.T) < radius)
    return meets


def _check_inside(what: str, distances: Array, radius: float) -> None:
    if (distances > radius).any():
        raise InvalidParameter(
            f"a ray starts {distances.max():.4g} mm from the {what}, and its inner radius is {radius:g} mm"
        )


class _Ghosts(NamedTuple):
    """What a wall throws back."""

    points: Array
    directions: Array
    alive: NDArray[np.bool_]


@dataclass(frozen=True)
class ThroughShell:
    """A scene as a sensor sees it from inside a tube or a dome.

    Rays are bent at both sides of the wall by Snell's law and dimmed by Fresnel's. What the wall throws back is the
    ghost: where it meets the mirror it is reflected once more, where it meets the mirror's back or a lid it ends,
    and else it passes the wall and shows another part of the scene, or is thrown back once more. Of ghosts the mirror
    swallows nothing. Lids are black.

    Parameters
    ----------
    scene
    shell : Tube or Dome
    sensor
        That stands inside; rays start from its mirror.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.simulate import Environment
    >>> sensor = om.load_sensor("paper-spherical")
    >>> white = ThroughShell(Environment(np.ones((4, 8, 3), np.float32)), Tube(60.0), sensor)
    >>> white.radiance(np.array([[0, 0, -20.0]]), np.array([[1.0, 0, 0]])).round(4)  # all but a ghost's ghost's ghost
    array([[0.9996, 0.9996, 0.9996]], dtype=float32)
    """

    scene: Scene
    shell: Shell
    sensor: Sensor

    def radiance(self, origins_mm: Array, directions: Array) -> Light:
        """Linear RGB (n, 3) of rays (n, 3) of the sensor's world frame that start inside.

        Raises
        ------
        InvalidParameter
            If a ray starts outside.
        """
        turn = self.sensor.mount.rotation()
        points, towards = (turned(v, turn) for v in (origins_mm, directions))
        light = np.zeros(points.shape)
        left = np.flatnonzero(~meets_lid(self.shell, points, towards))
        points, towards, share = points[left], towards[left], np.ones(len(left))
        for _ in range(1 + GHOSTS):
            passage = self.shell.passage(points, towards)
            seen = self.scene.radiance(turned(passage.points, turn.T), turned(passage.directions, turn.T))
            light[left] += (share * passage.passed)[:, None] * seen
            ghosts = self._ghosts(passage)
            left, share = left[ghosts.alive], (share * (1 - passage.passed))[ghosts.alive]
            points, towards = ghosts.points[ghosts.alive], ghosts.directions[ghosts.alive]
        return light.astype(np.float32)

    def _ghosts(self, passage: Passage) -> _Ghosts:
        """Where what was thrown back goes next."""
        mirror = self.sensor.posed_mirror
        points, directions = passage.met + LIFT_MM * passage.thrown_back, passage.thrown_back
        again = mirror.trace(points, directions)
        points = np.where(again.valid[:, None], again.points + LIFT_MM * again.directions, points)
        directions = np.where(again.valid[:, None], again.directions, directions)
        rim = self.sensor.mirror.rim_radius_mm
        back = float(self.sensor.mirror.sag(np.array(rim))) + self.sensor.mirror_pose.displacement_mm
        alive = ~(_meets_disc(points, directions, back, rim) | meets_lid(self.shell, points, directions))
        return _Ghosts(points, directions, alive)


def seen_through(camera: Camera, scene: Scene, shell: Shell | None) -> Scene:
    """The scene as a camera sees it through a shell, or as it is where there is none.

    Raises
    ------
    InvalidParameter
        If the camera is no sensor, and so has no axis for a shell to stand about.
    """
    if shell is None:
        return scene
    if not isinstance(camera, Sensor):
        raise InvalidParameter("only a sensor has a tube or a dome about it; a calibrated camera says nothing of it")
    return ThroughShell(scene, shell, camera)
