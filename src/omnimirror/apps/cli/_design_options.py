"""Options of ``omnimirror design``: requirements, and settings of the optimisation."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from ...base.arguments import format_value, parse_float
from ...base.toml_validation import SourceLocator, merge_tables
from ...design.catalogue import TYPICAL
from ...design.designer import SearchOptions
from ...design.merits import DESIGN_MERITS
from ...design.mirror_construction import FAMILIES
from ...design.optimiser import Progress
from ...design.requirement_files import (
    PIXELS,
    load_requirements,
    requirements_of,
    tables_like,
)
from ...design.requirements import PAPER_IMAGER, WAYS, Range, Requirements
from ...optics.lenses import BlurMode
from ...optics.mirrors.mappings import MAPPINGS
from ...optics.sensor_files import load_sensor
from ._declarations import NUMBER, Options, number_or_range, option, setting

SECTIONS: dict[str, tuple[str, ...]] = {
    "field": ("omega_max_deg",),
    "mirror": ("mapping", "family", "optimise", "rim_radius_mm"),
    "lens": ("focal_length_mm", "theta_max_deg", "f_number"),
    "parts": ("catalogue",),
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

PAPER_PIXELS = {n: getattr(PAPER_IMAGER, n) for n in PIXELS}

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


@dataclass(frozen=True)
class RequirementOptions(Options):
    """Requirements, which override entries of a requirement file."""

    mapping: str | None = option(
        type=click.Choice([*MAPPINGS]), metavar="NAME", help="Mapping; see omnimirror mappings."
    )
    family: str | None = option(
        "--mirror",
        metavar="FAMILY",
        help=f"Mirror family instead: {', '.join(FAMILIES)} or polynomial:N.",
    )
    optimise: str | None = option(
        type=click.Choice([*DESIGN_MERITS]),
        metavar="MERIT",
        help="Minimise a merit with a freeform mirror; see docs/optimisation.md.",
    )
    like: str | None = option(
        metavar="SENSOR",
        help="Use the field, rim, lens and imager of a sensor.",
    )
    omega_max_deg: float | None = option(type=NUMBER, help="Field angle at the rim.")
    rim_radius_mm: Range | None = option(
        type=number_or_range, metavar="MM|LOW:HIGH", help="Rim radius of the mirror."
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
    at_most: tuple[LimitEntry, ...] = option(
        type=limit,
        multiple=True,
        metavar="Q=N[@[FROM:]TO]",
        default=(),
        show_default=False,
        help="Upper limit of a quantity, in a part of the field (repeatable).",
    )
    at_least: tuple[LimitEntry, ...] = option(
        type=limit,
        multiple=True,
        metavar="Q=N[@[FROM:]TO]",
        default=(),
        show_default=False,
        help="Lower limit of a quantity (repeatable).",
    )
    catalogue: tuple[Path, ...] = option(
        "--parts",
        type=click.Path(path_type=Path),
        multiple=True,
        metavar="CATALOGUE",
        default=(),
        show_default=False,
        help="Catalogue of lenses and imagers, or 'typical' (repeatable).",
    )

    def requirements(self, file: Path | None, changes: dict[str, Any]) -> Requirements:
        """Return the requirements of a file, overridden by options and ``changes``, or of these
        alone.
        """
        if file is not None and self.like is not None:
            raise click.UsageError("a requirement file and --like must not be given together")
        given = self.given | {
            "catalogue": [
                str(path) if str(path) == TYPICAL else str(path.absolute())
                for path in self.catalogue
            ]
        }
        entries = {
            section: {
                name: list(given[name]) if isinstance(given[name], tuple) else given[name]
                for name in names
                if name in given and given[name] != []
            }
            for section, names in SECTIONS.items()
        }
        changes = merge_tables({k: v for k, v in entries.items() if v}, changes)
        sides = (("at_most", self.at_most), ("at_least", self.at_least))
        limits = [_limit_table(*entry, side=side) for side, entries in sides for entry in entries]
        if file is not None:
            if "elevation_deg" in changes.get("field", {}):
                changes["field"] |= {"omega_min_deg": None, "omega_max_deg": None}
            return load_requirements(file, _without_other_mirrors(changes), limits)
        if not changes and self.like is None:
            raise click.UsageError("specify a requirement file, or a field and a mirror by options")
        data = self._tables(changes)
        return requirements_of(
            data | ({"limit": limits} if limits else {}), SourceLocator("", "the options"), Path()
        )

    def _tables(self, changes: dict[str, Any]) -> dict[str, Any]:
        """Return the tables of the reference sensor, or of the paper for a freeform mirror, with
        changes applied.
        """
        base = PAPER if "optimise" in changes.get("mirror", {}) else {}
        if self.like is not None:
            base = tables_like(load_sensor(self.like))
        data = merge_tables(base, changes)
        if data.get("lens", {}).get("kind") == "orthographic" and self.like is None:
            data["lens"] = {
                k: v for k, v in data["lens"].items() if k in changes["lens"] or k == "f_number"
            }
        if "imager" in data:
            data["imager"] = PAPER_PIXELS | data["imager"]
        return data


@dataclass(frozen=True)
class CatalogueOptions(Options):
    """Designs with off-the-shelf parts."""

    max_designs: int = setting("search", 10)
    price_front: bool = setting("search", False)
    processes: int = setting("search", 1)


@dataclass(frozen=True)
class OptimisationOptions(Options):
    """Optimisation, of a freeform mirror or a Pareto front."""

    terms: list[int] | None = setting("search", type=integers)
    starts: int = setting("search", 4)
    resume: Path | None = setting("search", type=Path)
    pick: int | None = setting("search")
    seed: int = setting("search", 0)
    mode: BlurMode = setting("search", "exact")
    image_radius_px: float | None = setting("search")
    population: int = setting("search", 120)
    generations: int = setting("search", 200)

    def search(self, on_iteration: Callable[[Progress], None]) -> SearchOptions:
        """Return the settings for the optimisation of one mirror."""
        return SearchOptions(
            self.starts, self.seed, self.resume, on_iteration, self.mode, self.image_radius_px
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
