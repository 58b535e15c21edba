"""Printed output of ``omnimirror design`` and ``check``: requirements, conflicts, merits and convergence."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping

from rich.console import Console
from rich.text import Text

from ....analysis.focus import FOCUS_MERITS
from ....base.quantities import QUANTITIES
from ....design.designer import Design
from ....design.merits import DESIGN_MERITS
from ....design.optimiser import Optimum
from ....design.reference_mirrors import known_sensors, merit_values
from ....design.relaxation import Conflict, Relaxation
from ....design.requirement_check import ROUNDING, RequirementCheck, Verdict
from ....optics.tracing.obscuration import obscuration_summary
from .._output import column_head, plain_table, print_line

OF_ELEVATIONS = {
    "omega_max_deg": "elevation at the rim",
    "omega_min_deg": "elevation at the inner end",
}
MAX_ALTERNATIVES = 3
"""Number of alternatives printed for each entry under each heading; the JSON file contains all."""
EXIT_MISSED = 3
"""Exit code for a sensor that misses a requirement."""


def print_design(console: Console, design: Design) -> None:
    """Print the notes of the design and the table of its requirements."""
    sensor = design.sensor
    lens_position = (
        ""
        if sensor.lens.TELECENTRIC
        else f", lens {_number(sensor.mirror_distance_mm)} mm from its vertex"
    )
    print_line((sensor.name, "bold"), f": {sensor.mirror.KIND}{lens_position}", console=console)
    for note in design.notes:
        console.print(f"  {note}", highlight=False, soft_wrap=True)
    console.print()
    print_verdict(console, design.verdict)


def print_verdict(console: Console, verdict: Verdict) -> None:
    """Print each requirement with its limit, the value reached, and the margin."""
    by_elevation = verdict.requirements.field.angles == "elevation"
    numbers = (
        "required",
        "reached",
        "margin",
        "at elevation" if by_elevation else f"at {QUANTITIES['omega_deg'].symbol}",
    )
    table = plain_table("requirement", *numbers, "", text_columns=("requirement", ""), tight=True)
    for row in verdict.rows:
        at, label = (
            _elevation_and_label(verdict, row) if by_elevation else (row.omega_deg, row.label)
        )
        met = Text("met") if row.is_met else Text("missed", style="bold red")
        margin = 0.0 if abs(row.margin) <= ROUNDING * row.scale else row.margin
        required = _format_limit(row.at_least, row.at_most, row.unit)
        where = "" if at is None else f"{at:.4g} deg"
        table.add_row(label, required, _number(row.reached), _number(margin), where, met)
    console.print(table)
    remarks = list(dict.fromkeys(remark for row in verdict.rows for remark in row.remarks))
    for remark in remarks:
        names = ", ".join(row.label for row in verdict.rows if remark in row.remarks)
        console.print(f"  {names}: {remark}", highlight=False, soft_wrap=True)
    sensor = verdict.sensor
    if sensor.obscured and not any(
        "obscured by" in remark for remark in remarks
    ):  # not yet reported
        obscurations = obscuration_summary(sensor.obscured, sensor.obscured_percent)
        console.print(f"  obscured: {obscurations}", highlight=False, soft_wrap=True)


def _elevation_and_label(verdict: Verdict, row: RequirementCheck) -> tuple[float | None, str]:
    """Return the elevation of the worst value of a row, or of a limit on the field itself; and its
    label.
    """
    mount = verdict.requirements.mount
    omega = row.reached if row.name in ("omega_max_deg", "omega_min_deg") else row.omega_deg
    at = None if omega is None else mount.elevations_deg((omega, omega))[0] + 0.0  # avoids -0
    if row.part_deg is None:
        return at, row.label
    low, high = (round(v, 9) + 0.0 for v in mount.elevations_deg(row.part_deg))
    return at, row.name + (
        f", elevation {low:g} deg" if low == high else f", elevations {low:g} to {high:g} deg"
    )


def _format_limit(low: float | None, high: float | None, unit: str) -> str:
    if low is not None and high is not None:
        text = _number(low) if low == high else f"{_number(low)} to {_number(high)}"
    else:
        text = f"at least {_number(low)}" if low is not None else f"at most {_number(high)}"
    return f"{text} {unit}".rstrip()


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.5g}"


def print_conflict(console: Console, conflict: Conflict, verdict: Verdict) -> None:
    """Print the missed requirements and the relaxations that make the others feasible."""
    labels = {}
    if verdict.requirements.field.angles == "elevation":
        labels = {
            row.label: _elevation_and_label(verdict, row)[1] for row in verdict.rows
        } | OF_ELEVATIONS
    missed = "; ".join(labels.get(label, label) for label in conflict.missed)
    console.print(f"\nInfeasible requirements: {missed}.", highlight=False, soft_wrap=True)
    helpful = [r for r in conflict.alone if r.needed is not None and r.needed != r.requested]
    if helpful:
        console.print("All requirements are met if one of these is relaxed:", highlight=False)
        for r in helpful:
            console.print(f"  {_change(r, verdict, labels)}", highlight=False, soft_wrap=True)
    elif conflict.is_complete:
        console.print(
            "No relaxation of a single requirement within the permitted range is sufficient.",
            highlight=False,
        )
    if conflict.joint_change is not None:
        console.print(
            f"Or if these are relaxed together by up to {conflict.joint_change:.2%}:",
            highlight=False,
        )
        for r in conflict.joint:
            console.print(f"  {_change(r, verdict, labels)}", highlight=False, soft_wrap=True)
    for others, heading in (
        (
            [a for a in conflict.alternatives if a.is_met],
            "All requirements are met with one of these alternatives:",
        ),
        (
            [a for a in conflict.alternatives if not a.is_met],
            "Alternatives with a smaller violation (largest violation):",
        ),
    ):
        if others:
            console.print(heading, highlight=False)
        counts = Counter[str]()
        for a in others:
            counts[a.entry] += 1
            if counts[a.entry] > MAX_ALTERNATIVES:
                continue
            violation = "" if a.is_met else f" ({a.worst:.2%})"
            text = f"  {a.entry}: {a.value} instead of {a.requested}{violation}"
            console.print(text, highlight=False, soft_wrap=True)
    if not conflict.is_complete:
        console.print("The search for relaxations was interrupted.", highlight=False)


def _change(r: Relaxation, verdict: Verdict, labels: Mapping[str, str]) -> str:
    """Format the relaxed value of a requirement, with labels as in the table of requirements."""
    unit, name = f" {r.unit}" if r.unit else "", labels.get(r.name, r.name)
    relative_change = f" ({r.relative_change:.2%})" if r.relative_change is not None else ""
    relaxed, required = r.needed, r.requested
    if name in OF_ELEVATIONS.values() and relaxed is not None:
        (required, relaxed), relative_change = (
            (
                verdict.requirements.mount.elevations_deg((v, v))[0] + 0.0
                for v in (required, relaxed)
            ),
            "",
        )
    return f"{name}: {_number(relaxed)}{unit} instead of {_number(required)}{unit}{relative_change}"


def print_convergence(console: Console, designs: dict[int, Design]) -> None:
    """Print the result for each number of terms."""
    merit = QUANTITIES[next(iter(designs.values())).requirements.mirror.optimise or ""]
    table = plain_table(
        "terms", "best start", "steps", f"{merit.name}\n{merit.unit}", column_head("focus_mm")
    )
    for count, design in designs.items():
        if (optimum := design.optimum) is None:
            table.add_row(str(count), "", "", "limits violated", "")
            continue
        run = min((r for r in optimum.runs if r.kept), key=lambda r: r.value)
        focus = f"{design.sensor.lens.focus_distance_mm:.2f}"
        table.add_row(
            str(count), run.start, str(len(run.history) - 1), f"{optimum.value:.5f}", focus
        )
    console.print(table)
    console.print()


def print_merits(console: Console, optimum: Optimum) -> None:
    """Print all merits of the optimised mirror next to those of the sphere for the same field."""
    sphere = next(iter(known_sensors(optimum.problem).values()))
    table = plain_table(
        "merit", "sphere", "optimised", "unit", "meaning", text_columns=("merit", "unit", "meaning")
    )
    focus_by = optimum.merit if optimum.merit in FOCUS_MERITS else "worst_floored_area_deg2"
    before_all = merit_values(sphere, list(DESIGN_MERITS), optimum.problem, focus_by)
    after_all = merit_values(optimum.sensor, list(DESIGN_MERITS), optimum.problem, None)
    for name, before, after in zip(DESIGN_MERITS, before_all, after_all, strict=True):
        table.add_row(
            name, f"{before:.4f}", f"{after:.4f}", QUANTITIES[name].unit, QUANTITIES[name].meaning
        )
    console.print()
    console.print(table)
    print_line(
        (f"the sphere for the same field, at its best focus by {focus_by}", "dim"), console=console
    )
    if optimum.problem.optics is not None:  # the bound holds for ideal lenses
        return
    bound, blur = optimum.bound.blur_deg, after_all[list(DESIGN_MERITS).index("worst_blur_deg")]
    if bound:
        console.print(
            "Lower bound of the worst single blur for this field, rim and lens: "
            f"{bound:.4f} deg; this mirror exceeds it by {blur / bound - 1:.2%}."
        )
