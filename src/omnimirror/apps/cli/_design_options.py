"""Options of ``omnimirror design``: requirements, and settings of the optimisation."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import click
import numpy as np

from ...base.arguments import format_value, parse_float
from ...design.catalogue import TYPICAL
from ...design.designer import SearchOptions
from ...design.freeform import SHAPE
from ...design.merits import DESIGN_MERITS
from ...design.mirror_construction import FAMILIES
from ...design.optimiser import Progress
from ...design.ranges import Range
from ...design.requirement_files import load_requirements, requirements_of, tables_like
from ...design.requirements import PAPER_IMAGER, WAYS, Requirements
from ...optics.batch.families import FREEFORM_FAMILIES
from ...optics.lenses import BlurMode
from ...optics.mirrors.mappings import MAPPINGS
from ...optics.sensor_files import load_sensor
from ...optics.toml_validation import SourceLocator
from ._declarations import Options, option
from ._option_types import INTEGER, NUMBER, angle_range, number_or_range
from ._output import FIGURES, Output

SECTIONS: dict[str, tuple[str, ...]] = {
    "field": (
        "omega_max_deg",
        "omega_min_deg",
        "elevation_deg",
        "object_distance_mm",
        "object_plane_distance_mm",
        "object_cylinder_radius_mm",
    ),
    "mount": ("camera_looks",),
    "mirror": (
        "mapping",
        "family",
        "optimise",
        "shape",
        "fit",
        "apex",
        "rim_radius_mm",
        "conic",
        "plane_distance_mm",
        "cylinder_radius_mm",
        "mapping_csv",
    ),
    "lens": (
        "kind",
        "focal_length_mm",
        "theta_max_deg",
        "f_number",
        "focus_mm",
        "magnification",
        "fills",
        "image_circle_mm",
    ),
    "imager": ("width_px", "height_px", "pixel_pitch_um"),
    "parts": ("catalogue", "max_price", "max_mass_g", "max_diameter_mm", "max_height_mm"),
}
"""Options for entries of the requirement file, by table."""

MIRROR_OPTIONS = {
    "mapping": (
        "apex",
        "plane_distance_mm",
        "cylinder_radius_mm",
        "omega_deg",
        "height",
        "mapping_csv",
        "fit",
    ),
    "family": ("conic", "fit"),
    "optimise": ("shape",),
}
"""Alternative specifications of the mirror with their options; an option for one removes the others
of a file.
"""

PAPER_PIXELS = {n: getattr(PAPER_IMAGER, n) for n in SECTIONS["imager"]}

PAPER: dict[str, dict[str, Any]] = {
    "field": {"omega_max_deg": 135.0},
    "mirror": {"rim_radius_mm": 43.9},
    "lens": {"focal_length_mm": 11.6, "theta_max_deg": 12.0, "f_number": 4.0},
    "imager": PAPER_PIXELS,
}
"""Sensors of the paper: default requirements of an optimisation."""


def integers(text: str) -> list[int]:
    """Parse comma-separated integers above 0.

    >>> integers("4,8,16")
    [4, 8, 16]
    """
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isascii() and part.isdigit() and int(part) > 0 for part in parts):
        raise click.BadParameter(
            f"must be a list of integers above 0, such as 4,8,16; got {format_value(text)}"
        )
    return [int(part) for part in parts]


def merit_list(text: str) -> list[str]:
    """Parse comma-separated names of merits."""
    return [part.strip() for part in text.split(",")]


def distances(text: str) -> float | tuple[float, float]:
    """Parse a distance in mm or two of them, ``NEAR:FAR``; ``inf`` is allowed.

    >>> distances("inf"), distances("500:inf")
    (inf, (500.0, inf))
    """
    try:
        numbers = [parse_float(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(n > 0 for n in numbers):
        raise click.BadParameter(
            f"must be a distance in mm above 0, or NEAR:FAR, such as 500:inf; got {format_value(text)}"
        )
    return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])


LimitEntry = tuple[str, float, dict[str, Any]]
"""Quantity, value, and other entries of the limit: part of the field, spatial frequency."""


def limit(text: str) -> LimitEntry:
    """Parse a limit: quantity, value, and optionally a part of the field,
    ``QUANTITY=NUMBER[@FROM:TO]``.

    A single angle is used for both ends; elevations are allowed; an MTF has its frequency in cycles
    per pixel.

    >>> limit("total_blur_px=4"), limit("resolution_px_per_deg=3.5@30:120")
    (('total_blur_px', 4.0, {}), ('resolution_px_per_deg', 3.5, {'omega_deg': [30.0, 120.0]}))
    >>> limit("mtf:0.25=0.3@elevation=0")
    ('mtf', 0.3, {'cycles_per_px': 0.25, 'elevation_deg': [0.0, 0.0]})
    """
    match = re.fullmatch(
        r"\s*(\w+)(?::([^=]+))?\s*=\s*([^@]+)(?:@(elevation=)?([^:]+)(?::(.+))?)?", text
    )
    try:
        if match is None:
            raise ValueError
        entries: dict[str, Any] = (
            {} if match[2] is None else {"cycles_per_px": parse_float(match[2])}
        )
        if match[5]:
            ends = [parse_float(match[5]), parse_float(match[6] or match[5])]
            entries["elevation_deg" if match[4] else "omega_deg"] = ends
        return match[1], parse_float(match[3]), entries
    except ValueError:
        raise click.BadParameter(
            "must be QUANTITY=NUMBER, QUANTITY=NUMBER@ANGLE or QUANTITY=NUMBER@FROM:TO, "
            f"such as total_blur_px=4@20:120; got {format_value(text)}"
        ) from None


def focus_range(text: str) -> Range:
    """Parse a distance in mm, or ``LOW:HIGH`` with HIGH up to ``inf``.

    >>> focus_range("250:inf")
    (250.0, inf)
    """
    low, colon, high = text.partition(":")
    if colon and high.strip() == "inf":
        return cast(float, number_or_range(low)), np.inf
    return number_or_range(text)


@dataclass(frozen=True)
class RequirementOptions(Options):
    """Requirements, which override entries of a requirement file."""

    mapping: str | None = option(type=click.Choice([*MAPPINGS]), help="Mapping of the image.")
    family: str | None = option(
        "--mirror",
        metavar="FAMILY",
        help=f"Mirror family instead of a mapping: {', '.join(FAMILIES)} or polynomial:N.",
    )
    optimise: str | None = option(
        type=click.Choice([*DESIGN_MERITS]),
        help="Merit to minimise with a freeform mirror, instead of a mapping.",
    )
    shape: str | None = option(
        metavar="FORM[:N]",
        help=f"Shape for --optimise: {', '.join(FREEFORM_FAMILIES)}.  [default: {SHAPE}]",
    )
    fit: str | None = option(
        metavar="FORM:N",
        help="Fit a polynomial:N or an asphere:N with minimum deviation from the mapping.",
    )
    like: str | None = option(
        metavar="SENSOR",
        help="Use field, rim, lens and imager of a sensor file or a bundled sensor.",
    )
    omega_max_deg: float | None = option(type=NUMBER, help="Field angle at the rim.")
    omega_min_deg: float | None = option(type=NUMBER, help="Minimum field angle of interest.")
    elevation_deg: tuple[float, float] | None = option(
        type=angle_range,
        metavar="LOW:HIGH",
        help="Elevation range above the horizon for the mounted sensor, instead of field angles.",
    )
    camera_looks: str | None = option(
        type=click.Choice(["up", "down", "forward"]),
        help="Orientation of the optical axis.  [default: up]",
    )
    apex: str | None = option(
        type=click.Choice(["smooth", "pointed"]),
        help="Apex of the mirror; pointed: the image centre corresponds to omega-min-deg.",
    )
    object_distance_mm: Range | None = option(
        type=distances,
        metavar="MM|NEAR:FAR",
        help="Object distance from the mirror.  [default: inf]",
    )
    object_plane_distance_mm: float | None = option(
        type=NUMBER,
        help="Distance of an object plane from the mirror vertex, instead of an object distance.",
    )
    object_cylinder_radius_mm: float | None = option(
        type=NUMBER,
        help="Radius of an object cylinder around the axis, instead of or with an object plane.",
    )
    rim_radius_mm: Range | None = option(
        type=number_or_range, metavar="MM|LOW:HIGH", help="Rim radius of the mirror."
    )
    conic: Range | None = option(
        type=number_or_range,
        metavar="K|LOW:HIGH",
        help="Conic constant, if the family leaves it free.",
    )
    plane_distance_mm: float | None = option(
        type=NUMBER, help="Ground-plane mapping: distance from mirror vertex to plane."
    )
    cylinder_radius_mm: float | None = option(
        type=NUMBER, help="Cylinder mapping: radius of the cylinder."
    )
    mapping_csv: str | None = option(
        type=click.Path(), help="Tabulated mapping: CSV file with columns omega_deg, height."
    )
    kind: str | None = option(
        "--lens",
        type=click.Choice(["perspective", "orthographic"]),
        help="Kind of lens.  [default: perspective]",
    )
    focal_length_mm: Range | None = option(
        type=number_or_range, metavar="MM|LOW:HIGH", help="Focal length of the lens."
    )
    theta_max_deg: Range | None = option(
        type=number_or_range, metavar="DEG|LOW:HIGH", help="Viewing angle at the rim."
    )
    f_number: Range | None = option(
        type=number_or_range, metavar="F|LOW:HIGH", help="F-number of the lens.  [default: 4]"
    )
    focus_mm: Range | None = option(
        type=focus_range,
        metavar="MM|LOW:HIGH",
        help="Object distance in focus; HIGH may be inf.  [default: the optimum]",
    )
    magnification: Range | None = option(
        type=number_or_range,
        metavar="MU|LOW:HIGH",
        help="Magnification of a telecentric lens.  [default: the rim fills the imager]",
    )
    fills: str | None = option(
        type=click.Choice(["short-side", "long-side"]),
        help="Side of the imager that the rim may fill.",
    )
    image_circle_mm: float | None = option(
        type=NUMBER, help="Diameter of the image circle of the lens."
    )
    width_px: int | None = option(type=INTEGER, help="Width of the imager.  [default: 1024]")
    height_px: int | None = option(type=INTEGER, help="Height of the imager.  [default: 1024]")
    pixel_pitch_um: float | None = option(
        type=NUMBER, help="Pixel pitch of the imager.  [default: 5.2]"
    )
    at_most: tuple[LimitEntry, ...] = option(
        type=limit,
        multiple=True,
        metavar="QUANTITY=NUMBER[@[FROM:]TO]",
        default=(),
        show_default=False,
        help="Upper limit of a quantity, over a part of the field in degrees or the whole field (repeatable).",
    )
    at_least: tuple[LimitEntry, ...] = option(
        type=limit,
        multiple=True,
        metavar="QUANTITY=NUMBER[@[FROM:]TO]",
        default=(),
        show_default=False,
        help="Lower limit of a quantity, as for --at-most (repeatable).",
    )
    catalogue: tuple[Path, ...] = option(
        "--parts",
        type=click.Path(path_type=Path),
        multiple=True,
        metavar="CATALOGUE",
        default=(),
        show_default=False,
        help="Catalogue of lenses and imagers to design with, or 'typical' (repeatable).",
    )
    max_price: float | None = option("--max-price", type=NUMBER, help="Maximum price of the parts.")
    max_mass_g: float | None = option(
        "--max-mass-g", type=NUMBER, help="Maximum mass of the sensor."
    )
    max_diameter_mm: float | None = option(
        "--max-diameter-mm", type=NUMBER, help="Maximum diameter of the sensor."
    )
    max_height_mm: float | None = option(
        "--max-height-mm", type=NUMBER, help="Maximum height of the sensor."
    )
    name: str | None = option(help="Name of the sensor.")

    def requirements(self, file: Path | None) -> Requirements:
        """Return the requirements of a file, overridden by options, or of the options alone."""
        if file is not None and self.like is not None:
            raise click.UsageError("a requirement file and --like must not be given together")
        given = {k: list(v) if isinstance(v, tuple) else v for k, v in self.given.items()}
        given["catalogue"] = [
            str(path) if str(path) == TYPICAL else str(path.absolute()) for path in self.catalogue
        ]
        changes: dict[str, Any] = {
            section: entries
            for section, names in SECTIONS.items()
            if (entries := {k: v for k, v in given.items() if k in names and v != []})
        }
        title = {"name": self.name} if self.name else {}
        sides = (("at_most", self.at_most), ("at_least", self.at_least))
        limits = [_limit_table(*entry, side=side) for side, entries in sides for entry in entries]
        if file is not None:
            if self.elevation_deg is not None:
                changes["field"] |= {"omega_min_deg": None, "omega_max_deg": None}
            return load_requirements(file, _without_other_mirrors(changes) | title, limits)
        if not changes and self.like is None:
            raise click.UsageError("specify a requirement file, or a field and a mirror by options")
        data = self._tables(changes)
        return requirements_of(
            title | data | ({"limit": limits} if limits else {}),
            SourceLocator("", "the options"),
            Path(),
        )

    def _tables(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Return the tables of the reference sensor, or of the paper for a freeform mirror, with
        changes applied.
        """
        base = PAPER if self.optimise is not None else {}
        if self.like is not None:
            base = tables_like(load_sensor(self.like))
        data = {
            section: base.get(section, {}) | changes.get(section, {})
            for section in {**base, **changes}
        }
        if data.get("lens", {}).get("kind") == "orthographic" and self.like is None:
            data["lens"] = {
                k: v for k, v in data["lens"].items() if k in changes["lens"] or k == "f_number"
            }
        if "imager" in data:
            data["imager"] = PAPER_PIXELS | data["imager"]
        return data


@dataclass(frozen=True)
class OptimisationOptions(Options):
    """Optimisation, of a freeform mirror or a Pareto front."""

    terms: list[int] | None = option(
        type=integers,
        metavar="N[,N...]",
        help="Number of terms N of --shape; several values give a convergence table.",
    )
    starts: int = option(type=INTEGER, default=4, help="Number of starting mirrors.")
    seed: int = option(type=INTEGER, default=0, help="Random seed.")
    resume: Path | None = option(
        type=click.Path(path_type=Path),
        help="Save the state of the search to this file and resume from it: JSON; Parquet for a Pareto front.",
    )
    paper_mode: bool = option(
        is_flag=True,
        default=False,
        show_default=False,
        help="Compute blur merits with Eq. 29 of the paper instead of the exact form.",
    )
    image_radius_px: float | None = option(
        type=NUMBER, help="Image radius for the merits, 500 in the paper."
    )
    population: int = option(type=INTEGER, default=120, help="Population of the Pareto front.")
    generations: int = option(type=INTEGER, default=200, help="Generations of the Pareto front.")
    figure: Path | None = option(
        type=Output(FIGURES), help="Figure of the Pareto front with known mirrors."
    )
    pick: int | None = option(
        type=INTEGER, help="Index of the design to select from the Pareto front."
    )

    @property
    def mode(self) -> BlurMode:
        """Blur formula for merits and limits during the search."""
        return "paper" if self.paper_mode else "exact"

    def search(self, on_progress: Callable[[Progress], None]) -> SearchOptions:
        """Return the settings for the optimisation of one mirror."""
        return SearchOptions(
            self.starts, self.seed, self.resume, on_progress, self.mode, self.image_radius_px
        )


def _limit_table(
    quantity: str, number: float, entries: dict[str, Any], side: str
) -> dict[str, Any]:
    return {"quantity": quantity, side: number, **entries}


def _without_other_mirrors(changes: dict[str, Any]) -> dict[str, Any]:
    """Return the changes with None for alternative mirror specifications of a file."""
    mirror = changes.get("mirror", {})
    chosen = [way for way in WAYS if way in mirror]
    if not chosen:
        return changes
    applicable = {n for method in chosen for n in MIRROR_OPTIONS[method]}
    aside = {
        n for way in WAYS if way not in chosen for n in (way, *MIRROR_OPTIONS[way])
    } - applicable
    return changes | {"mirror": dict.fromkeys(sorted(aside)) | mirror}
