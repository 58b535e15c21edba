"""Housing of a mirror: camera body, rod, tube, dome or window, and the rim of the mirror's body.

All parts are surfaces of revolution about the lens axis. Heights are in mm above the nominal mirror
vertex, away from the lens; parts between mirror and lens have negative heights. Obscurations by
these parts are computed in :mod:`omnimirror.optics.tracing.obscuration`.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from ..base.arguments import check_fields, instance
from ..base.errors import InvalidParameter
from ..base.parameters import Parameter
from .materials import MATERIAL_NAMES, MATERIALS, Material, index_of

__all__ = [
    "CLEARANCE_MM",
    "DEFAULT_GAP_RATIO",
    "MATERIALS",
    "NO_HOUSING",
    "SHELLS",
    "TELECENTRIC_LENS_DISTANCE_RIMS",
    "CameraBody",
    "Dome",
    "Envelope",
    "FlatWindow",
    "Housing",
    "HousingPart",
    "Material",
    "Rim",
    "Rod",
    "Shell",
    "Tube",
    "index_of",
    "wall_description",
]


# -- Housing parts and envelope --------------------------------------------------------------------


class HousingPart:
    """Part of a housing: it validates its parameters; None values are fitted to the sensor."""

    PARAMETERS: ClassVar[dict[str, Parameter]]

    def __post_init__(self) -> None:
        check_fields(self)
        for f in fields(self):  # type: ignore[arg-type]  # every part is a dataclass
            value = getattr(self, f.name)
            if value is not None:
                self.PARAMETERS[f.name].check(f.name, value)


class Envelope(NamedTuple):
    """Dimensions of a sensor for fitting its housing. Heights above the vertex, mm."""

    lens_mm: float
    """Height of the plane of the lens, negative."""
    base_mm: float
    """Base of a tube: the plane of the lens, or the back of a second mirror."""
    back_mm: float
    """Height of the back of the mirror's body."""
    outer_mm: float
    """Outer radius of the mirror with its rim."""
    has_secondary: bool = False


# -- Clear walls: tube, dome and window ------------------------------------------------------------

CLEARANCE_MM = 3.0
"""Default clearance between rim and tube or dome."""
BEYOND_LENS_MM = 5.0
"""Default distance of a window from the lens."""
WALL = {
    "diameter_mm": Parameter("mm", 1e-3, 1e5, "outer diameter"),
    "wall_mm": Parameter("mm", 1e-3, 1e3, "wall thickness"),
    "refractive_index": Parameter("", 1.0, 4.0, "refractive index of the wall"),
    "material": Parameter(
        "", 0.0, 0.0, "material of the wall, instead of its index", MATERIAL_NAMES
    ),
    "medium": Parameter("", 0.0, 0.0, "outer medium, instead of its index", MATERIAL_NAMES),
    "medium_index": Parameter("", 1.0, 4.0, "refractive index of the outer medium"),
    "decentre_x_mm": Parameter("mm", -1e4, 1e4, "decentring to the right in the image"),
    "decentre_y_mm": Parameter("mm", -1e4, 1e4, "decentring downwards in the image"),
    "tilt_x_deg": Parameter(
        "deg",
        -45.0,
        45.0,
        "rotation about the X axis of the image, through the vertex; applied first",
    ),
    "tilt_y_deg": Parameter(
        "deg", -45.0, 45.0, "rotation about the Y axis of the image, through the vertex"
    ),
}
WALL_INDEX = 1.49
"""Default refractive index (acrylic)."""


class ClearWall(HousingPart):
    """Base class of clear covers between air inside and a medium outside.

    Misalignment is a rotation about the nominal mirror vertex followed by a translation, as for
    ``[mirror_pose]``; lids are not affected.
    """

    KIND: ClassVar[str]
    wall_mm: float
    diameter_mm: float | None
    refractive_index: float
    material: str | None
    medium: str | None
    medium_index: float
    decentre_x_mm: float
    decentre_y_mm: float
    tilt_x_deg: float
    tilt_y_deg: float

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.material is not None and self.refractive_index != WALL_INDEX:
            raise InvalidParameter(
                "refractive_index and material must not both be given; got "
                f"{self.refractive_index:g} and {self.material!r}"
            )
        if self.medium is not None and self.medium_index != 1.0:
            raise InvalidParameter(
                f"medium_index and medium must not both be given; got {self.medium_index:g} and "
                f"{self.medium!r}"
            )
        self._check_room()

    def _check_room(self) -> None:
        """Check that the wall leaves space inside."""
        if self.diameter_mm is not None and not self.wall_mm < self.diameter_mm / 2:
            raise InvalidParameter(
                f"wall_mm must be less than {self.diameter_mm / 2:g} mm, the outer radius of "
                f"the {self.KIND}; got {self.wall_mm:g}"
            )

    @property
    def index(self) -> float:
        """Refractive index of the wall."""
        return self.refractive_index if self.material is None else index_of(self.material)

    @property
    def outer_index(self) -> float:
        """Refractive index of the outer medium."""
        return self.medium_index if self.medium is None else index_of(self.medium)

    @property
    def is_axial(self) -> bool:
        """True if the cover is coaxial with the lens: neither decentred nor tilted."""
        return not (self.decentre_x_mm or self.decentre_y_mm or self.tilt_x_deg or self.tilt_y_deg)

    @property
    def radii_mm(self) -> tuple[float, float]:
        """Inner and outer radius of a cover of known size."""
        assert self.diameter_mm is not None, "the cover must be fitted to a sensor first"
        outer = self.diameter_mm / 2
        return outer - self.wall_mm, outer

    def centred(self) -> Self:
        """Return the cover in its nominal position."""
        pose_parameters = dict.fromkeys(
            ("decentre_x_mm", "decentre_y_mm", "tilt_x_deg", "tilt_y_deg"), 0.0
        )
        return replace(self, **pose_parameters)  # type: ignore[type-var]  # every part is a dataclass

    def at_wavelength(self, wavelength_nm: float) -> Self:
        """Return the cover with the indices of its named materials at a wavelength, nm."""
        indices: dict[str, Any] = {}
        if self.material is not None:
            indices |= {
                "material": None,
                "refractive_index": index_of(self.material, wavelength_nm),
            }
        if self.medium is not None:
            indices |= {"medium": None, "medium_index": index_of(self.medium, wavelength_nm)}
        return replace(self, **indices)  # type: ignore[type-var]  # every part is a dataclass


def wall_description(shell: ClearWall) -> str:
    """Return a description of wall material and outer medium, by name if available.

    >>> wall_description(Tube(material="polycarbonate", medium="water"))
    'polycarbonate, n = 1.5855, in water, n = 1.3331'
    >>> wall_description(Tube())
    'n = 1.49'
    """
    material = f"{_name(shell.material)}, " if shell.material else ""
    text = f"{material}n = {shell.index:g}"
    if shell.outer_index == 1.0:
        return text
    medium = f"{_name(shell.medium)}, " if shell.medium else "a medium of "
    return f"{text}, in {medium}n = {shell.outer_index:g}"


def _name(material: str) -> str:
    return material.replace("_", " ")


@dataclass(frozen=True)
class Tube(ClearWall):
    """Clear tube about the axis, closed by opaque discs in the lens plane and at the mirror's back.

    Around two mirrors, the tube starts at the back of the second.

    Parameters
    ----------
    diameter_mm : optional
        Outer diameter; by default the next full millimetre with 3 mm clearance around the mirror's
        rim.
    wall_mm, refractive_index
        Wall thickness and index; acrylic by default.
    material, medium : optional
        Names of :data:`~omnimirror.optics.materials.MATERIALS`: of the wall, instead of its index,
        and of the outer medium.
    medium_index
        Index of the outer medium; air by default.
    decentre_x_mm, decentre_y_mm, tilt_x_deg, tilt_y_deg
        Misalignment; see :class:`ClearWall`.

    Raises
    ------
    InvalidParameter
        If a number is outside its range, the wall fills the tube, or an index is given twice.
    """

    diameter_mm: float | None = None
    wall_mm: float = 3.0
    refractive_index: float = WALL_INDEX
    material: str | None = None
    medium: str | None = None
    medium_index: float = 1.0
    decentre_x_mm: float = 0.0
    decentre_y_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    KIND: ClassVar[str] = "tube"
    PARAMETERS: ClassVar[dict[str, Parameter]] = WALL

    def inner_radius_mm(self, height_mm: float) -> float:
        """Return the inner radius at a height, mm; it is constant."""
        return self.radii_mm[0]

    def fitted(self, envelope: Envelope) -> Tube:
        """Return the tube with dimensions fitted to the sensor."""
        min_diameter, default_diameter = self.diameters(envelope.outer_mm)
        diameter = self.diameter_mm or float(default_diameter)
        if diameter < min_diameter:
            raise InvalidParameter(
                f"diameter_mm of the tube must be at least {min_diameter:g} mm, to enclose the mirror "
                f"with a wall of {self.wall_mm:g} mm; got {diameter:g}"
            )
        return replace(self, diameter_mm=diameter)

    def diameters(self, outer_mm: Any) -> tuple[Any, Any]:
        """Return minimum and default outer diameter around mirrors of given radii."""
        min_diameter = 2 * (outer_mm + self.wall_mm)
        return min_diameter, np.ceil(np.real(min_diameter) + 2 * CLEARANCE_MM)


@dataclass(frozen=True)
class Dome(ClearWall):
    """Clear dome between two spheres, closed by an opaque disc in the lens plane.

    Parameters
    ----------
    diameter_mm : optional
        Outer diameter; by default the next full millimetre with 3 mm clearance around the mirror's
        rim.
    wall_mm
        Wall thickness on the axis, for concentric spheres.
    refractive_index
        Index of the wall; acrylic by default.
    centre_mm : optional
        Height of the outer sphere's centre; by default halfway between the lens and the mirror's
        back. Refraction is smallest for a dome centred on the viewpoints.
    inner_shift_mm
        Height of the inner sphere's centre above the outer one; 0 (concentric) by default.
    material, medium : optional
        Names of :data:`~omnimirror.optics.materials.MATERIALS`: of the wall, instead of its index,
        and of the outer medium.
    medium_index
        Index of the outer medium; air by default.
    decentre_x_mm, decentre_y_mm, tilt_x_deg, tilt_y_deg
        Misalignment; see :class:`ClearWall`.

    Raises
    ------
    InvalidParameter
        If a number is outside its range, the wall fills the dome, an index is given twice, or the
        inner sphere intersects the outer one.
    """

    diameter_mm: float | None = None
    wall_mm: float = 3.0
    refractive_index: float = WALL_INDEX
    centre_mm: float | None = None
    inner_shift_mm: float = 0.0
    material: str | None = None
    medium: str | None = None
    medium_index: float = 1.0
    decentre_x_mm: float = 0.0
    decentre_y_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    KIND: ClassVar[str] = "dome"
    PARAMETERS: ClassVar[dict[str, Parameter]] = WALL | {
        "centre_mm": Parameter("mm", -1e5, 1e5, "height of the centre above the mirror vertex"),
        "inner_shift_mm": Parameter(
            "mm", -1e3, 1e3, "height of the inner sphere's centre above the outer one's"
        ),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        if not abs(self.inner_shift_mm) < self.wall_mm:
            raise InvalidParameter(
                f"inner_shift_mm must be smaller in magnitude than wall_mm, {self.wall_mm:g} "
                f"mm; got {self.inner_shift_mm:g}"
            )

    @property
    def centres_mm(self) -> tuple[float, float]:
        """Heights of the centres of the inner and the outer sphere."""
        assert self.centre_mm is not None, "the dome must be fitted to a sensor first"
        return self.centre_mm + self.inner_shift_mm, self.centre_mm

    def inner_radius_mm(self, height_mm: float) -> float:
        """Return the inner radius at a height, mm; 0 outside the dome."""
        square = self.radii_mm[0] ** 2 - (height_mm - self.centres_mm[0]) ** 2
        return float(np.sqrt(max(square, 0.0)))

    def fitted(self, envelope: Envelope) -> Dome:
        """Return the dome with dimensions fitted to the sensor."""
        back, lens, rim = envelope.back_mm, envelope.lens_mm, envelope.outer_mm
        centre = float(self.centre_between(lens, back))
        min_diameter, default_diameter = self.diameters(lens, back, rim)
        diameter = self.diameter_mm or float(default_diameter)
        if diameter < min_diameter:
            raise InvalidParameter(
                f"diameter_mm of the dome must be at least {min_diameter:.5g} mm, to enclose the "
                f"mirror (centre at {centre:.4g} mm, wall of {self.wall_mm:g} mm); got "
                f"{diameter:g}"
            )
        if diameter / 2 - self.wall_mm <= abs(lens - centre):
            raise InvalidParameter(
                "diameter_mm of the dome must be greater than "
                f"{2 * (abs(lens - centre) + self.wall_mm):.5g} mm, to reach the plane of the "
                f"lens at {lens:.4g} mm (centre at {centre:.4g} mm); got {diameter:g}"
            )
        return replace(self, diameter_mm=diameter, centre_mm=centre)

    def centre_between(self, lens_mm: Any, back_mm: Any) -> Any:
        """Return the outer sphere's centre between lenses and mirror backs, numbers or arrays."""
        return (back_mm + lens_mm) / 2 if self.centre_mm is None else self.centre_mm

    def diameters(self, lens_mm: Any, back_mm: Any, outer_mm: Any) -> tuple[Any, Any]:
        """Return minimum and default outer diameter around mirrors, numbers or arrays."""
        lens, back, rim = (np.real(v) for v in (lens_mm, back_mm, outer_mm))
        centre = np.real(self.centre_between(lens, back))
        max_height = np.maximum(np.abs(back - centre), np.abs(lens - centre))
        min_diameter = 2 * (np.hypot(rim, back - centre) + self.wall_mm)
        return min_diameter, np.ceil(2 * (np.hypot(rim + CLEARANCE_MM, max_height) + self.wall_mm))


@dataclass(frozen=True)
class FlatWindow(ClearWall):
    """Flat clear pane beyond the lens, perpendicular to the axis, with an opaque surround.

    Only rays directed back past the lens reach it: the field is limited to less than 90 deg.

    Parameters
    ----------
    diameter_mm : optional
        Diameter of the clear opening; by default it passes the whole field.
    wall_mm, refractive_index
        Thickness and index of the pane; acrylic by default.
    height_mm : optional
        Height of its inner surface above the mirror vertex; by default 5 mm beyond the lens.
    material, medium : optional
        Names of :data:`~omnimirror.optics.materials.MATERIALS`: of the pane, instead of its index,
        and of the outer medium.
    medium_index
        Index of the outer medium; air by default.
    decentre_x_mm, decentre_y_mm, tilt_x_deg, tilt_y_deg
        Misalignment; see :class:`ClearWall`.

    Raises
    ------
    InvalidParameter
        If a number is outside its range, or an index is given twice.
    """

    diameter_mm: float | None = None
    wall_mm: float = 3.0
    refractive_index: float = WALL_INDEX
    height_mm: float | None = None
    material: str | None = None
    medium: str | None = None
    medium_index: float = 1.0
    decentre_x_mm: float = 0.0
    decentre_y_mm: float = 0.0
    tilt_x_deg: float = 0.0
    tilt_y_deg: float = 0.0

    KIND: ClassVar[str] = "window"
    PARAMETERS: ClassVar[dict[str, Parameter]] = WALL | {
        "diameter_mm": Parameter("mm", 1e-3, 1e5, "diameter of the clear opening"),
        "height_mm": Parameter(
            "mm", -1e5, 1e5, "height of the inner surface above the mirror vertex"
        ),
    }

    def _check_room(self) -> None:
        """Check the thickness only: a pane has no inner space."""

    @property
    def heights_mm(self) -> tuple[float, float]:
        """Heights of the inner and the outer surface of a window of known position."""
        assert self.height_mm is not None, "the window must be fitted to a sensor first"
        return self.height_mm, self.height_mm - self.wall_mm

    def fitted(self, envelope: Envelope) -> FlatWindow:
        """Return the window with its position fitted to the sensor."""
        height = envelope.lens_mm - BEYOND_LENS_MM if self.height_mm is None else self.height_mm
        if height > envelope.lens_mm:
            raise InvalidParameter(
                f"height_mm must be at most {envelope.lens_mm:g} mm, the plane of the lens: a "
                f"window between lens and mirror is in the optical path twice; got {height:g}"
            )
        return replace(self, height_mm=height)


Shell = Tube | Dome | FlatWindow
SHELLS: dict[str, type[Tube] | type[Dome] | type[FlatWindow]] = {
    kind.KIND: kind for kind in (Tube, Dome, FlatWindow)
}
"""Clear walls by their name in sensor files."""


# -- Opaque parts and housing ----------------------------------------------------------------------

TELECENTRIC_LENS_DISTANCE_RIMS = 2.5
"""Assumed distance of a telecentric lens from the vertex, in rim radii."""
DEFAULT_GAP_RATIO = 0.25
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
        "diameter_mm": Parameter(
            "mm", 1e-3, 1e5, "diameter of the camera, as reflected in the mirror"
        ),
        "height_mm": Parameter(
            "mm", -1e5, 1e5, "height of the camera's front above the lens, towards the mirror"
        ),
        "lens_diameter_mm": Parameter("mm", 1e-3, 1e5, "diameter of the lens's front ring"),
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
        "gap_mm": Parameter("mm", 0.0, 1e5, "distance from the foot of the rod to the lens"),
    }

    def fitted(self, envelope: Envelope) -> Rod:
        """Return the rod with dimensions fitted to the sensor."""
        gap = -envelope.lens_mm * DEFAULT_GAP_RATIO if self.gap_mm is None else self.gap_mm
        if not gap < -envelope.lens_mm:
            raise InvalidParameter(
                f"gap_mm must be less than {-envelope.lens_mm:g} mm, the distance from lens to "
                f"mirror; got {gap:g}"
            )
        end = self.diameter_mm if self.end_diameter_mm is None else self.end_diameter_mm
        if end > 2 * envelope.outer_mm:
            entry = "diameter_mm" if self.end_diameter_mm is None else "end_diameter_mm"
            raise InvalidParameter(
                f"{entry} must be at most {2 * envelope.outer_mm:g} mm at the mirror, the "
                f"diameter of the mirror; got {end:g}"
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
        "width_mm": Parameter("mm", 0.0, 1e4, "radial width of the edge or flange beyond the rim"),
        "setback_mm": Parameter(
            "mm", 0.0, 1e4, "axial distance from the rim back to the front of the edge or flange"
        ),
        "thickness_mm": Parameter(
            "mm", 1e-3, 1e4, "distance from the mirror surface to the back of its body"
        ),
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
    ...     print(ring.part, [round(v, 2) for v in ring.omega_deg], round(ring.image_percent, 2))
    rod [0.0, 21.04] 4.35
    camera [0.0, 8.43] 0.71
    """

    camera: CameraBody | None = None
    rod: Rod | None = None
    shell: Shell | None = None
    rim: Rim | None = None
    secondary_rim: Rim | None = None

    def __post_init__(self) -> None:
        types: dict[str, Any] = dict.fromkeys(("rim", "secondary_rim"), Rim)
        types |= {"camera": CameraBody, "rod": Rod, "shell": (Tube, Dome, FlatWindow)}
        for name, kind in types.items():
            if (part := getattr(self, name)) is not None:
                instance(
                    name,
                    part,
                    kind,
                    f"an instance of {_name_of(kind)} (omnimirror.optics.housing)",
                )

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
        rod, shell = (
            self.rod and self.rod.fitted(envelope),
            self.shell and self.shell.fitted(envelope),
        )
        return replace(self, rod=rod, shell=shell)

    def _check_beside_secondary(self) -> None:
        if self.rod is not None:
            raise InvalidParameter(
                "housing.rod is not supported with a secondary, whose view it obstructs; use a "
                "tube or no support"
            )
        if isinstance(self.shell, Dome | FlatWindow):
            raise InvalidParameter(
                f"housing.{self.shell.KIND} is not supported with a secondary; use a tube or no "
                "support"
            )
        if self.camera is not None:
            raise InvalidParameter(
                "housing.camera is not supported with a secondary; set bore_radius_mm of the "
                "secondary to the radius of the camera's front (diameter_mm = "
                f"{self.camera.diameter_mm:g})"
            )


NO_HOUSING = Housing()


def _name_of(kind: Any) -> str:
    return " or ".join(k.__name__ for k in (kind if isinstance(kind, tuple) else (kind,)))
