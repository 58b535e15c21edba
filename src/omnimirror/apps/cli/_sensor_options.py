"""Options that override parts of a sensor file: housing and lens."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar

import click

from ...optics.housing import SHELLS, CameraBody, FlatWindow, Housing, Rim, Rod, Shell
from ...optics.lenses import SurfaceLens
from ...optics.materials import MATERIALS
from ...optics.sensor import Sensor
from ...optics.sensor_files import AnyCamera
from ._declarations import Options, flag, option
from ._option_types import NUMBER, distance, height

# -- Housing ---------------------------------------------------------------------------------------

CameraType = TypeVar("CameraType", bound=AnyCamera)

SUPPORTS = ("rod", "tube", "dome")
SIZES = {
    "support_diameter_mm": ("diameter_mm", SUPPORTS),
    "support_end_diameter_mm": ("end_diameter_mm", ("rod",)),
    "gap_mm": ("gap_mm", ("rod",)),
    "wall_mm": ("wall_mm", tuple(SHELLS)),
    "refractive_index": ("refractive_index", tuple(SHELLS)),
    "wall_material": ("material", tuple(SHELLS)),
    "medium": ("medium", tuple(SHELLS)),
    "dome_centre_mm": ("centre_mm", ("dome",)),
}
"""Options for sizes of a support: entry of its table, and the supports that have it."""


@dataclass(frozen=True)
class HousingOptions(Options):
    """Housing, with None for omitted options."""

    support: str | None = option(
        type=click.Choice([*SUPPORTS, "none"]),
        help="Support of the mirror: an opaque rod, a clear tube or dome.  [default: as in the sensor file]",
    )
    support_diameter_mm: float | None = option(
        type=distance,
        metavar="MM",
        help="Outer diameter of the support; of a rod at its foot.  [default: 4 for a rod, otherwise 3 mm "
        "clearance around the rim]",
    )
    support_end_diameter_mm: float | None = option(
        type=distance, metavar="MM", help="Diameter of a tapered rod at the mirror."
    )
    gap_mm: float | None = option(
        type=NUMBER,
        metavar="MM",
        help="Distance from the foot of the rod to the lens.  [default: 0.25 of the distance between mirror and lens]",
    )
    wall_mm: float | None = option(
        type=NUMBER, metavar="MM", help="Wall thickness of the tube or dome.  [default: 3]"
    )
    refractive_index: float | None = option(
        type=NUMBER, metavar="N", help="Refractive index of the tube or dome.  [default: 1.49]"
    )
    wall_material: str | None = option(
        type=click.Choice(list(MATERIALS)),
        help="Material of the tube, dome or window, instead of its refractive index.",
    )
    medium: str | None = option(
        type=click.Choice(list(MATERIALS)),
        help="Medium outside the tube, dome or window.  [default: air]",
    )
    dome_centre_mm: float | None = option(
        type=height,
        metavar="MM",
        help="Height of the centre of the dome above the vertex.  [default: midway to the lens]",
    )
    camera_diameter_mm: float | None = option(
        type=distance,
        metavar="MM",
        help="Diameter of the camera, which obscures the centre of the image.  [default: as in the sensor file]",
    )
    camera_height_mm: float | None = option(
        type=height,
        metavar="MM",
        help="Height of the camera front above the principal point of the lens.  [default: 0]",
    )
    rim_width_mm: float | None = option(
        type=NUMBER,
        metavar="MM",
        help="Width of a dark edge around the rim of the mirror.  [default: as in the sensor file]",
    )

    def on(self, camera: CameraType) -> CameraType:
        """Return the sensor with the housing options; a calibrated camera has no housing."""
        if not self.given:
            return camera
        if not isinstance(camera, Sensor):
            raise click.UsageError(
                f"{flag(next(iter(self.given)))} requires a sensor; a calibrated camera has no housing"
            )
        return replace(camera, housing=self.of(camera.housing))

    def of(self, housing: Housing) -> Housing:
        """Return a housing with the options applied.

        >>> HousingOptions("rod", 3.0, camera_diameter_mm=30.0).of(Housing())
        Housing(camera=CameraBody(diameter_mm=30.0, height_mm=0.0, lens_diameter_mm=24.0), rod=Rod(diameter_mm=3.0,
        end_diameter_mm=None, gap_mm=None), shell=None, rim=None, secondary_rim=None)
        """
        if self.support is not None:
            housing = _supported(housing, self.support)
        housing = self._sized(housing)
        camera, rim = housing.camera, housing.rim
        if self.camera_diameter_mm is not None:
            camera = replace(camera or CameraBody(1.0), diameter_mm=self.camera_diameter_mm)
        if self.camera_height_mm is not None:
            if camera is None:
                raise click.UsageError("--camera-height-mm requires --camera-diameter-mm")
            camera = replace(camera, height_mm=self.camera_height_mm)
        if self.rim_width_mm is not None:
            rim = replace(rim or Rim(), width_mm=self.rim_width_mm)
        return replace(housing, camera=camera, rim=rim)

    def _sized(self, housing: Housing) -> Housing:
        """Return the rod, tube or dome of the housing with the given sizes."""
        given = self.subset(*SIZES)
        if not given:
            return housing
        parts = {
            "rod": housing.rod,
            **({housing.shell.KIND: housing.shell} if housing.shell else {}),
        }
        kinds = [kind for kind, part in parts.items() if part is not None]
        for name in given:
            if not kinds:
                raise click.UsageError(f"{flag(name)} requires a --support; the sensor has none")
            fitting = [kind for kind in kinds if kind in SIZES[name][1]]
            if not fitting:
                supports = [kind for kind in SIZES[name][1] if kind in SUPPORTS]
                raise click.UsageError(f"{flag(name)} requires --support {' or '.join(supports)}")
            if len(fitting) > 1:
                raise click.UsageError(
                    f"the sensor has a {' and a '.join(fitting)}; select one with --support"
                )
            field = "rod" if fitting[0] == "rod" else "shell"
            housing = replace(
                housing,
                **{field: replace(getattr(housing, field), **{SIZES[name][0]: given[name]})},
            )
        return housing


def _supported(housing: Housing, kind: str) -> Housing:
    """Return the housing with only a support of this kind: as in the housing, or with default
    sizes.
    """
    rod: Rod | None = None
    shell: Shell | None = housing.shell if isinstance(housing.shell, FlatWindow) else None
    if kind == "rod":
        rod = housing.rod or Rod()
    elif kind in SHELLS:
        shell = housing.shell if isinstance(housing.shell, SHELLS[kind]) else SHELLS[kind]()
    return replace(housing, rod=rod, shell=shell)


# -- Lens ------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class LensOptions(Options):
    """Lens files; None for the lens of the sensor."""

    lens: Path | None = option(
        type=click.Path(path_type=Path),
        metavar="ZMX",
        help="Lens prescription that replaces the lens of the sensor, with the same first principal point and "
        "focus distance.",
    )
    glass_catalogue: Path | None = option(
        type=click.Path(path_type=Path),
        metavar="AGF",
        help="Glass catalogue of the lens, in addition to the bundled glasses.",
    )

    def on(self, sensor: Sensor) -> Sensor:
        """Return the sensor with the lens of the options."""
        if self.lens is None:
            return sensor
        entries: dict[str, Any] = {"focus_distance_mm": sensor.lens.focus_distance_mm}
        if self.glass_catalogue is not None:
            entries["glass_catalogue"] = str(self.glass_catalogue)
        return replace(sensor, lens=SurfaceLens.from_file(self.lens, **entries))
