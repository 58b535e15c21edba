"""Options that specify a scene and the rendering of its images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import click

from ...cameras.camera import Camera
from ...optics.sensor import Sensor
from ...simulation.detector import Detector
from ...simulation.radiometry import Radiometry
from ...simulation.scenes.moving_objects import MovingBox, load_bodies
from ...simulation.scenes.scene import Pose
from ...simulation.scenes.scene_sources import BUNDLED, SceneSource
from ._declarations import INTEGER, Options, _numbers, flag, option, setting


def pose(text: str) -> Pose:
    """Parse a pose ``X,Y,Z``, ``X,Y,Z,PAN``, ... up to ``X,Y,Z,PAN,TILT,ROLL``, in mm and degrees.

    >>> pose("500,0,-200,30")
    Pose(x_mm=500.0, y_mm=0.0, z_mm=-200.0, pan_deg=30.0, tilt_deg=0.0, roll_deg=0.0)
    """
    count = min(max(3, text.count(",") + 1), 6)
    return Pose(*_numbers(text, count, ",", "a pose X,Y,Z[,PAN[,TILT[,ROLL]]] in mm and deg"))


def reflectivity(text: str) -> Any:
    """Parse a reflectivity: a fraction, the name of a metal or its index, or three comma-separated
    values.

    >>> reflectivity("0.9"), reflectivity("gold"), reflectivity("0.96+6.69j,0.9,1")
    (0.9, 'gold', ((0.96+6.69j), 0.9, 1.0))
    """
    if "," in text:
        return tuple(reflectivity(part) for part in text.split(","))
    for kind in (float, complex):
        try:
            return kind(text)
        except ValueError:
            continue
    return text.strip()


@dataclass(frozen=True)
class SceneOptions(Options):
    """Scene."""

    scene: str = option(
        default="room",
        metavar="NAME|FILE",
        help=f"Scene: {', '.join(BUNDLED)}, an equirectangular image (HDR, EXR, JPEG, ...), or "
        "a mesh (GLB, glTF, OBJ, PLY, STL).",
    )
    heading_deg: float | None = setting("scene")
    unit_mm: float | None = setting("scene")
    up: Literal["y", "z"] | None = setting("scene")
    background: str | None = setting("scene")

    def source(self) -> SceneSource:
        """Return the source of the scene."""
        source = SceneSource(
            self.scene, **self.subset("heading_deg", "unit_mm", "up", "background")
        )
        if not source.is_mesh and (given := self.subset("unit_mm", "up", "background")):
            raise click.UsageError(
                f"{flag(next(iter(given)))} requires a mesh; got the scene {self.scene}"
            )
        if self.heading_deg is not None and not (source.is_environment or self.background):
            raise click.UsageError(
                "scene.heading_deg requires an environment image; rotate other scenes with --pose"
            )
        return source


RADIOMETRY = ("reflectivity", "vignetting", "direct_view")
DETECTOR = ("exposure", "full_well_e", "read_noise_e", "black_level_dn", "bits", "curve", "bayer")


@dataclass(frozen=True)
class RenderingOptions(Options):
    """Rendering."""

    blur: bool | None = option(
        "--blur/--no-blur",
        help="Render through the whole aperture.  [default: on; off for a calibrated camera]",
    )
    samples: int = option("--samples", "--spp", type=INTEGER, default=16, help="Rays per pixel.")
    seed: int = setting("rendering", 0)
    wavelengths_nm: tuple[float, float, float] | None = setting("rendering")
    reflectivity: float | str | tuple[float | str, ...] | None = setting("radiometry")
    vignetting: float | None = setting("radiometry")
    direct_view: bool | None = setting("radiometry")
    exposure: float | None = setting("detector")
    full_well_e: float | None = setting("detector")
    read_noise_e: float | None = setting("detector")
    black_level_dn: float | None = setting("detector")
    bits: int | None = setting("detector")
    curve: str | None = setting("detector")
    bayer: str | None = setting("detector")

    def is_blurred(self, camera: Camera) -> bool:
        """Return whether images of a camera are rendered through its whole aperture."""
        return isinstance(camera, Sensor) if self.blur is None else self.blur

    def radiometry(self) -> Radiometry | None:
        """Return the radiometric settings; None without options."""
        given = self.subset(*RADIOMETRY)
        if not given:
            return None
        if isinstance(value := self.reflectivity, tuple):
            if len(value) != 3:
                raise click.UsageError(
                    "radiometry.reflectivity must be one value, or three for red, green and blue; "
                    f"got {len(value)}"
                )
            given["reflectivity"] = tuple(reflectivity(str(part)) for part in value)
        elif value is not None:
            given["reflectivity"] = reflectivity(str(value))
        return Radiometry(**given)

    def detector(self) -> Detector:
        """Return the detector model."""
        return Detector(**self.subset(*DETECTOR))


@dataclass(frozen=True)
class TrajectoryOptions(Options):
    """Video along poses."""

    path: Path | None = option(
        type=click.Path(path_type=Path), help="Videos: poses over time, a CSV or TOML file."
    )
    bodies: Path | None = setting("video", type=Path)
    fps: float | None = setting("video")
    duration_s: float | None = setting("video")

    @property
    def frame_rate(self) -> float:
        """Frames per second."""
        return 25.0 if self.fps is None else self.fps

    def moving(self) -> tuple[MovingBox, ...]:
        """Return the moving boxes of the scene."""
        return () if self.bodies is None else load_bodies(self.bodies)
