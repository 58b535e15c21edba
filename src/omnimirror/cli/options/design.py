"""What ``omnimirror design`` makes of its options: requirements, and how an optimised mirror is searched for."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import click
import numpy as np

from ...arguments import float_of
from ...design.criteria.consistency import WAYS
from ...design.criteria.requirement_file import load_requirements, requirements_of
from ...design.criteria.requirements import PAPER_IMAGER, Requirements
from ...lenses import Perspective
from ...specs import Places, housing_tables, load_sensor

SECTIONS: dict[str, tuple[str, ...]] = {
    "field": ("omega_max_deg", "omega_min_deg", "object_distance_mm"),
    "mirror": (
        "mapping", "family", "optimise", "shape", "fit", "apex", "rim_radius_mm", "conic", "plane_distance_mm",
        "cylinder_radius_mm", "mapping_csv",
    ),
    "lens": ("kind", "focal_length_mm", "theta_max_deg", "f_number", "focus_mm"),
    "imager": ("width_px", "height_px", "pixel_pitch_um"),
}  # fmt: skip
"""The options that stand for entries of the requirement file, by their table."""

OF_WAYS = {
    "mapping": ("apex", "plane_distance_mm", "cylinder_radius_mm", "omega_deg", "height", "mapping_csv", "fit"),
    "family": ("conic", "fit"),
    "optimise": ("shape",),
}
"""Ways to say what mirror is wanted, and what belongs to each: an option for one puts a file's other ways aside."""

PAPER_PIXELS = {n: getattr(PAPER_IMAGER, n) for n in SECTIONS["imager"]}

PAPER: dict[str, dict[str, Any]] = {
    "field": {"omega_max_deg": 135.0},
    "mirror": {"rim_radius_mm": 43.9},
    "lens": {"focal_length_mm": 11.6, "theta_max_deg": 12.0, "f_number": 4.0},
    "imager": PAPER_PIXELS,
}
"""The paper's sensors: what is optimised where nothing else is said."""


def whole_numbers(text: str) -> list[int]:
    """Whole numbers above 0, parted by commas.

    >>> whole_numbers("4,8,16")
    [4, 8, 16]
    """
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdigit() and int(part) > 0 for part in parts):
        raise click.BadParameter(f"{text!r} is not a list of whole numbers above 0, such as 4,8,16")
    return [int(part) for part in parts]


def merit_list(text: str) -> list[str]:
    """Names of merits, parted by commas."""
    return [part.strip() for part in text.split(",")]


def distances(text: str) -> float | tuple[float, float]:
    """A distance in mm or two of them, ``NEAR:FAR``; ``inf`` is allowed.

    >>> distances("inf"), distances("500:inf")
    (inf, (500.0, inf))
    """
    try:
        numbers = [float_of(part) for part in text.split(":")]
    except ValueError:
        numbers = []
    if len(numbers) not in (1, 2) or not all(n > 0 for n in numbers):
        raise click.BadParameter(f"{text!r} is not a distance in mm above 0, or NEAR:FAR, such as 500:inf")
    return numbers[0] if len(numbers) == 1 else (numbers[0], numbers[1])


def limit(text: str) -> tuple[str, float, list[float] | None]:
    """A quantity, a number, and the part of the field if it is not all: ``QUANTITY=NUMBER[@FROM:TO]``.

    >>> limit("total_blur_px=4"), limit("resolution_px_per_deg=3.5@30:120")
    (('total_blur_px', 4.0, None), ('resolution_px_per_deg', 3.5, [30.0, 120.0]))
    """
    match = re.fullmatch(r"\s*(\w+)\s*=\s*([^@]+)(?:@([^:]+):(.+))?", text)
    try:
        if match is None:
            raise ValueError
        part = [float_of(match[3]), float_of(match[4])] if match[3] else None
        return match[1], float_of(match[2]), part
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not a limit QUANTITY=NUMBER or QUANTITY=NUMBER@FROM:TO, such as total_blur_px=4@20:120"
        ) from None


def requirements_from(
    file: Path | None,
    like: str | None,
    name: str | None,
    entries: dict[str, Any],
    at_most: tuple[tuple[str, float, list[float] | None], ...],
    at_least: tuple[tuple[str, float, list[float] | None], ...],
) -> Requirements:
    """The requirements of a file with the options in place of its entries, or of the options alone."""
    if file is not None and like is not None:
        raise click.UsageError("give a requirement file or --like, not both")
    given = {k: list(v) if isinstance(v, tuple) else v for k, v in entries.items() if v is not None}
    changes: dict[str, Any] = {
        section: found
        for section, names in SECTIONS.items()
        if (found := {k: v for k, v in given.items() if k in names})
    }
    title = {"name": name} if name else {}
    limits = [_limit_table(*x, side=side) for side, xs in (("at_most", at_most), ("at_least", at_least)) for x in xs]
    if file is not None:
        return load_requirements(file, _with_ways_aside(changes) | title, limits)
    if not changes and like is None:
        raise click.UsageError("give a requirement file, or a field and a mirror by options")
    base: dict[str, Any] = sensor_entries(like) if like is not None else PAPER if "optimise" in given else {}
    data = {section: base.get(section, {}) | changes.get(section, {}) for section in {**base, **changes}}
    if data.get("lens", {}).get("kind") == "orthographic" and like is None:
        data["lens"] = {k: v for k, v in data["lens"].items() if k in changes["lens"] or k == "f_number"}
    if "imager" in data:
        data["imager"] = PAPER_PIXELS | data["imager"]
    return requirements_of(title | data | ({"limit": limits} if limits else {}), Places("", "the options"), Path())


def _limit_table(quantity: str, number: float, part: list[float] | None, side: str) -> dict[str, Any]:
    return {"quantity": quantity, side: number} | ({"omega_deg": part} if part else {})


def _with_ways_aside(changes: dict[str, Any]) -> dict[str, Any]:
    """Changes that also take away (None) what a file says of other ways to a mirror than the one asked for."""
    mirror = changes.get("mirror", {})
    chosen = [way for way in WAYS if way in mirror]
    if not chosen:
        return changes
    kept = {n for way in chosen for n in OF_WAYS[way]}
    aside = {n for way in WAYS if way not in chosen for n in (way, *OF_WAYS[way])} - kept
    return changes | {"mirror": dict.fromkeys(sorted(aside)) | mirror}


def sensor_entries(name_or_path: str) -> dict[str, Any]:
    """Field, rim, lens and imager of a sensor, as entries of a requirement file."""
    sensor = load_sensor(name_or_path)
    sensor.check_one_mirror("designing one like it")
    low, high = sensor.field_deg
    lens: dict[str, Any] = {"kind": sensor.lens.KIND, "f_number": sensor.lens.stop_number}
    if isinstance(sensor.lens, Perspective):
        lens["focal_length_mm"] = sensor.lens.focal_length_mm
        lens["theta_max_deg"] = float(np.degrees(sensor.meridian.theta_max))
    imager = sensor.imager
    return {
        "field": {"omega_max_deg": high, "omega_min_deg": low},
        "mirror": {"rim_radius_mm": sensor.mirror.rim_radius_mm},
        "lens": lens,
        "housing": housing_tables(sensor.housing),
        "imager": {n: getattr(imager, n) for n in ("width_px", "height_px", "pixel_pitch_um")}
        | ({"centre_px": list(imager.centre_px)} if imager.centre_px else {}),
    }
