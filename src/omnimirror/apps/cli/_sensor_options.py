"""Options that replace the lens of a sensor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from ...optics.lenses import SurfaceLens
from ...optics.sensor import Sensor
from ._declarations import Options, option


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
