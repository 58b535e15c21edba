"""``omnimirror design`` with a catalogue: combinations of off-the-shelf parts by price, each with
its own mirror.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import NoReturn

import numpy as np
from rich.console import Console
from rich.table import Table

from .....base.files import write_json
from .....base.quantities import QUANTITIES
from .....design.catalogue.catalogue import Component
from .....design.criteria.requirements import Requirements
from .....design.parts.bought import BoughtDesign
from .....design.parts.search import PartsSearch, design_from_parts
from .....optics.sensor_files import save_sensor
from ...outputs import head, plain_table, say_written
from .tables import MISSED, print_verdict


def buy(
    console: Console,
    asked: Requirements,
    most: int,
    front: bool,
    processes: int,
    out: Path | None,
    json_file: Path | None,
) -> NoReturn:
    """Design with off-the-shelf parts, print the result, write the cheapest design, and exit."""
    with console.status("Designing") as status:
        found = design_from_parts(
            asked, most=most, front=front, processes=processes,
            on_step=lambda words: status.update(f"Designing: {words}"),
        )  # fmt: skip
    if found.found:
        console.print(_table(found.found))
        console.print()
    best = found.found[0] if found.found else found.nearest
    if best is not None:
        console.print(f"{'The cheapest' if found.found else 'Nearest'}: {best.combination.name}", highlight=False)
        print_verdict(console, best.design.verdict)
    _print_counts(console, found)
    if out and best is not None:
        save_sensor(best.design.sensor, out)
    if json_file:
        write_json(json_file, found.to_dict())
    say_written(out if best is not None else None, json_file, console=console)
    sys.exit(0 if found.is_met else MISSED)


def _table(designs: tuple[BoughtDesign, ...]) -> Table:
    area = QUANTITIES["worst_floored_area_deg2"]
    kinds = [kind for kind in ("lens", "imager", "ball", "dome") if _named(designs[0], kind)]
    numbers = (
        head("f_number"),
        "Θ\ndeg",
        head("focus_mm"),
        "ring\nmm",
        "rim\npx",
        f"{area.title}\n{area.unit}",
        "mass\ng",
    )
    table = plain_table("price", *kinds, *numbers, words=tuple(kinds))
    for d in designs:
        sensor, lens = d.design.sensor, d.design.sensor.lens
        theta = 0.0 if lens.TELECENTRIC else float(np.degrees(sensor.meridian.theta_max))
        table.add_row(
            "" if d.price is None else f"{d.price:g}", *(_named(d, kind) for kind in kinds), f"{lens.stop_number:.3g}",
            f"{theta:.1f}", f"{lens.focus_distance_mm:.1f}", f"{d.ring_mm:g}", f"{sensor.rim_radius_px:.0f}",
            area.text(d.worst_floored_area_deg2), "" if d.mass_g is None else f"{d.mass_g:.0f}",
        )  # fmt: skip
    return table


def _named(design: BoughtDesign, kind: str) -> str:
    parts: tuple[Component, ...] = design.combination.parts
    return next((part.name for part in parts if kind == part.KIND), "")


def _print_counts(console: Console, found: PartsSearch) -> None:
    """Print the number of combinations by result."""
    console.print(f"\n{found.combinations} combinations; {len(found.found)} of them above", highlight=False)
    for said, counts in (("cut, before any mirror was made", found.cut), ("designed, and missed", found.missed)):
        if counts:
            told = ", ".join(f"{count} {name}" for name, count in sorted(counts.items(), key=lambda c: -c[1]))
            console.print(f"  {sum(counts.values())} {said}: {told}", highlight=False, soft_wrap=True)
    if found.left:
        console.print(f"  {found.left} dearer ones not looked at", highlight=False)
