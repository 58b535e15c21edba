"""A real lens in the place of the sensor's own, as options."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from ....optics.lenses import SurfaceLens
from ....optics.sensor import Sensor
from .declared import Options, option


@dataclass(frozen=True)
class LensOptions(Options):
    """Files of a lens; None where the sensor's own is taken."""

    lens: Path | None = option(
        type=click.Path(path_type=Path), metavar="ZMX",
        help="A lens by its surfaces in the place of the sensor's: its first surface stands where that has its "
        "principal point, and it is focused as far away.",
    )  # fmt: skip
    glass_catalogue: Path | None = option(
        type=click.Path(path_type=Path), metavar="AGF", help="Glasses of the lens that do not come with omnimirror."
    )

    def on(self, sensor: Sensor) -> Sensor:
        """The sensor with the lens of the options."""
        if self.lens is None:
            return sensor
        entries: dict[str, Any] = {"focus_distance_mm": sensor.lens.focus_distance_mm}
        if self.glass_catalogue is not None:
            entries["glass_catalogue"] = str(self.glass_catalogue)
        return replace(sensor, lens=SurfaceLens.from_file(self.lens, **entries))
