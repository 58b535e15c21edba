"""Housing of a mirror: camera body, rod, tube or dome, and the rim of the mirror's body.

All parts are surfaces of revolution about the lens axis. Heights are in mm above the nominal mirror
vertex, away from the lens; parts between mirror and lens have negative heights. Obscuration of the
field by these parts is computed in :mod:`omnimirror.optics.tracing.obscuration`.
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
"""Assumed distance of a telecentric lens from the vertex, in rim radii."""
GAP_SHARE = 0.25
"""Default gap between rod and lens, relative to the mirror distance."""


@dataclass(frozen=True)
class CameraBody(HousingPart):
    """Front of the camera, a disc reflected in the centre of the image.

    Parameters
    ----------
    diameter_mm
    height_mm
        Height of its front above the lens's principal point, towards the mirror.
    lens_diameter_mm
        Diameter of the lens's front ring, visible in simulated images.

    Raises
    ------
    InvalidParameter
        If a number is outside its range.
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
    """Opaque rod on the axis, from the mirror vertex towards the lens.

    Parameters
    ----------
    diameter_mm
        Diameter at its foot, and along its length unless it tapers.
    end_diameter_mm : optional
        Diameter at the mirror.
    gap_mm : optional
        Distance from its foot to the lens; 25 % of the mirror distance by default. (A glass plate
        supports the foot: a rod up to the lens would obscure the entire field.)

    Raises
    ------
    InvalidParameter
        If a number is outside its range.
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
        """Return the rod with dimensions fitted to the sensor."""
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
    """Flange or dark edge of the mirror's body around the rim; it moves with the mirror.

    Parameters
    ----------
    width_mm
        Radial width beyond the rim.
    setback_mm
        Axial distance of its front behind the rim.
    thickness_mm
        Distance from the highest surface point to the back of the body, the end of a tube.

    Raises
    ------
    InvalidParameter
        If a number is outside its range.
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
    """Parts around the mirror; none by default.

    Parameters
    ----------
    camera : CameraBody, optional
    rod : Rod, optional
    shell : Tube, Dome or FlatWindow, optional
    rim, secondary_rim : Rim, optional
        Rims of the mirror and of a second one; the default body is 5 mm thick without a rim.

    Raises
    ------
    InvalidParameter
        If a part has the wrong type.

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
        """True if the housing has no parts."""
        return self == Housing()

    def fitted(self, envelope: Envelope) -> Housing:
        """Return the housing with dimensions fitted to the sensor.

        Raises
        ------
        InvalidParameter
            If a tube or dome is too small for the mirror, a dome does not reach the lens, the foot
            of a rod is beyond the mirror or its end is wider than the mirror, or a second mirror
            excludes a part.
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
