"""What stands around the mirror: camera, rod, tube or dome, and the rim of the mirror's own body. Geometry, once.

All of it is round about the lens's axis. Heights are in mm over where the mirror's vertex is meant to be, away from the
lens, so those of what stands between mirror and lens are below 0. What it hides of the field,
:mod:`omnimirror.optics.tracing.obscuration` says.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar

from ...base.arguments import instance
from ...base.errors import InvalidParameter
from ...base.parameters import Parameter
from .base import Envelope, HousingPart
from .walls import Dome, FlatWindow, Shell, Tube

LENS_AT_RIMS = 2.5
"""How many rim radii before the vertex a telecentric lens is taken to stand; it may stand anywhere."""
GAP_SHARE = 0.25
"""Of the mirror distance that a rod leaves to the lens, where its gap is not given."""


@dataclass(frozen=True)
class CameraBody(HousingPart):
    """The camera's front, a disc that the mirror shows in the middle of the picture.

    Parameters
    ----------
    diameter_mm
    height_mm
        Of its front over the lens's principal point, towards the mirror.
    lens_diameter_mm
        Of the front ring of its lens, which simulated pictures make out on it.

    Raises
    ------
    InvalidParameter
        A number outside its range.
    """

    diameter_mm: float
    height_mm: float = 0.0
    lens_diameter_mm: float = 24.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "diameter_mm": Parameter("mm", 1e-3, 1e5, "diameter of the camera as the mirror shows it"),
        "height_mm": Parameter("mm", -1e5, 1e5, "height of the camera's front over the lens, towards the mirror"),
        "lens_diameter_mm": Parameter("mm", 1e-3, 1e5, "diameter of the front ring of the camera's lens"),
    }


@dataclass(frozen=True)
class Rod(HousingPart):
    """An opaque rod on the axis, from the mirror's vertex towards the lens.

    Parameters
    ----------
    diameter_mm
        At its foot, and all along unless it tapers.
    end_diameter_mm : optional
        At the mirror.
    gap_mm : optional
        From its foot to the lens; a quarter of the mirror distance by default. (The foot stands on a glass plate: a
        rod that reached the lens would hide everything.)

    Raises
    ------
    InvalidParameter
        A number outside its range.
    """

    diameter_mm: float = 4.0
    end_diameter_mm: float | None = None
    gap_mm: float | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "diameter_mm": Parameter("mm", 1e-3, 1e5, "diameter of the rod at its foot"),
        "end_diameter_mm": Parameter("mm", 0.0, 1e5, "diameter of the rod at the mirror"),
        "gap_mm": Parameter("mm", 0.0, 1e5, "from the foot of the rod to the lens"),
    }

    def fitted(self, envelope: Envelope) -> Rod:
        """The rod with the sizes that it takes from the sensor."""
        gap = -envelope.lens_mm * GAP_SHARE if self.gap_mm is None else self.gap_mm
        if not gap < -envelope.lens_mm:
            raise InvalidParameter(f"gap_mm = {gap:g} leaves no rod; it is valid below {-envelope.lens_mm:g} mm")
        end = self.diameter_mm if self.end_diameter_mm is None else self.end_diameter_mm
        if end > 2 * envelope.outer_mm:
            entry = "diameter_mm" if self.end_diameter_mm is None else "end_diameter_mm"
            raise InvalidParameter(
                f"{entry} = {end:g} makes a rod wider than the mirror that it holds; there it is valid up to "
                f"{2 * envelope.outer_mm:g} mm"
            )
        return replace(self, end_diameter_mm=end, gap_mm=gap)


@dataclass(frozen=True)
class Rim(HousingPart):
    """What the mirror's own body shows around and behind the mirror's rim, a flange or a dark edge; it moves with it.

    Parameters
    ----------
    width_mm
        How far it stands out over the rim.
    setback_mm
        How far its front lies behind the rim.
    thickness_mm
        From the highest point of the surface to the body's back, where a tube ends.

    Raises
    ------
    InvalidParameter
        A number outside its range.
    """

    width_mm: float = 0.0
    setback_mm: float = 0.0
    thickness_mm: float = 5.0

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "width_mm": Parameter("mm", 0.0, 1e4, "how far the rim's edge or flange stands out over the mirror"),
        "setback_mm": Parameter("mm", 0.0, 1e4, "how far the front of the edge or flange lies behind the rim"),
        "thickness_mm": Parameter("mm", 1e-3, 1e4, "from the mirror's surface to the back of its body"),
    }


@dataclass(frozen=True)
class Housing:
    """What stands around the mirror; by default nothing.

    Parameters
    ----------
    camera : CameraBody, optional
    rod : Rod, optional
    shell : Tube, Dome or FlatWindow, optional
    rim, secondary_rim : Rim, optional
        Of the mirror and of a second one; without them the bodies have 5 mm and no edge.

    Raises
    ------
    InvalidParameter
        A part that is no such part.

    Examples
    --------
    >>> import omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(60.0), Rod(4.0)))
    >>> for ring in sensor.obscurations:
    ...     print(ring.part, [round(v, 2) for v in ring.omega_deg], round(ring.picture_percent, 2))
    rod [0.0, 21.04] 4.35
    camera [0.0, 8.43] 0.71
    """

    camera: CameraBody | None = None
    rod: Rod | None = None
    shell: Shell | None = None
    rim: Rim | None = None
    secondary_rim: Rim | None = None

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = dict.fromkeys(("rim", "secondary_rim"), Rim)
        kinds |= {"camera": CameraBody, "rod": Rod, "shell": (Tube, Dome, FlatWindow)}
        for name, kind in kinds.items():
            if (part := getattr(self, name)) is not None:
                instance(name, part, kind, f"a part such as omnimirror.optics.housing.{_name_of(kind)} makes")

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing."""
        return self == Housing()

    def fitted(self, envelope: Envelope) -> Housing:
        """The same with the sizes that it takes from the sensor.

        Raises
        ------
        InvalidParameter
            A tube or a dome that the mirror does not fit in, a dome that does not reach the lens, a rod's foot beyond
            the mirror or its end wider than that, or what a second mirror rules out.
        """
        if envelope.has_secondary:
            self._check_beside_secondary()
        rod, shell = self.rod and self.rod.fitted(envelope), self.shell and self.shell.fitted(envelope)
        return replace(self, rod=rod, shell=shell)

    def _check_beside_secondary(self) -> None:
        if self.rod is not None:
            raise InvalidParameter("a rod would stand in the view of the secondary; valid supports are tube and none")
        if isinstance(self.shell, Dome | FlatWindow):
            raise InvalidParameter(
                f"a {self.shell.KIND} is for sensors of one mirror; beside a secondary valid are tube and none"
            )
        if self.camera is not None:
            raise InvalidParameter(
                f"a camera of diameter_mm = {self.camera.diameter_mm:g} is for sensors of one mirror; beside a "
                "secondary the camera's front is its bore_radius_mm"
            )


def _name_of(kind: Any) -> str:
    return " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
