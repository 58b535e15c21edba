"""Tolerance report for manufacturers as one self-contained page."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ...analysis.figures.style import render, styled
from ...base.arguments import file_name, validate_arguments
from ...base.errors import InvalidParameter
from ...base.escaping import html_text, shell_word
from ...base.files import write_text
from ...manufacturing.drawings.tables import centring_code, form_code
from ...manufacturing.tolerancing.charts import curves, plot_tornado
from ...manufacturing.tolerancing.evaluator import TrialEvaluator, select_requirement_merits
from ...manufacturing.tolerancing.monte_carlo import (
    YieldEstimate,
    YieldStatistics,
    format_limit,
    format_motion,
    simulate_trials,
)
from ...manufacturing.tolerancing.sensitivity import ErrorSensitivity, sensitivities
from ...manufacturing.tolerancing.tolerance_analysis import ToleranceReport
from ...manufacturing.tolerancing.tolerances import MEASURED, Tolerances, error_sources, group_of
from ...manufacturing.workshop import PartSpecification
from . import figure_html, page_html

DISTRIBUTED = {
    "uniform": "uniform",
    "normal": "normal, two sigma",
    "truncated-normal": "normal, two sigma, truncated",
    "arcsine": "arcsine",
    "constant": "constant",
}


@dataclass(frozen=True)
class _Order:
    """Content of the report: tolerances and the statistics of sensors within them."""

    report: ToleranceReport
    tolerances: Tolerances
    statistics: YieldStatistics
    effects: Sequence[ErrorSensitivity]
    confirmed_yield: YieldEstimate

    @classmethod
    def of(cls, report: ToleranceReport) -> _Order:
        """Use the allocated tolerances with new trials, or the given ones."""
        plan, allocation = report.plan, report.allocation
        if allocation is None:
            return cls(
                report,
                plan.tolerances,
                report.statistics,
                report.sensitivities,
                report.statistics.yields,
            )
        errors = {
            name: replace(bound, value=allocation.tolerances.get(name, bound.value))
            for name, bound in plan.tolerances.errors.items()
        }
        chosen = replace(plan.tolerances, errors=errors)
        evaluator = TrialEvaluator.of(
            report.sensor, plan.refocus, select_requirement_merits(plan.limits), **plan.objects
        )
        statistics = simulate_trials(
            evaluator, chosen, plan.limits, trials=allocation.trials, seed=report.seed + 2
        )
        return cls(
            report,
            chosen,
            statistics,
            sensitivities(evaluator, chosen, plan.limits),
            allocation.confirmed_yield,
        )

    def cost(self, name: str) -> float:
        """Return the cost of a tolerance."""
        initial = self.report.plan.tolerances.errors[name].value
        allocated = self.tolerances.errors[name].value
        return self.report.plan.costs.get(name, 1.0) * (initial / allocated if allocated else 0.0)


@validate_arguments
def write_tolerances(report: ToleranceReport, path: str | Path) -> Path:
    """Write tolerances as one self-contained page for a purchase order.

    Parameters
    ----------
    report
        Result of :func:`omnimirror.tolerance`; with a target yield, the page lists the allocated
        tolerances.
    path
        Output file with the suffix .html.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InvalidParameter
        If the suffix is not supported.
    OmnimirrorError
        If the file cannot be written.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> sensor = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(sensor, {"mirror.tilt_x_deg": om.Tolerance(0.1)}), {"motion_px": 2.0})
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_tolerances(om.tolerance(sensor, plan, trials=100), f"{folder}/order.html").name
    'order.html'
    """
    path = page_name(path)
    write_text(path, tolerances_html(report))
    return path


def page_name(path: str | Path) -> Path:
    """Return the path of a report; raise InvalidParameter for another suffix."""
    path = file_name("path", path)
    if path.suffix.lower() != ".html":
        raise InvalidParameter(f"path must have the suffix .html; got {path.name}")
    return path


def tolerances_html(report: ToleranceReport) -> str:
    """Format the report as a self-contained page."""
    order, name = _Order.of(report), report.sensor.name
    with styled():
        bars, shares = (
            render(figure, "svg")
            for figure in (plot_tornado(order.effects), curves(order.statistics))
        )
    target_yield = (
        "" if report.allocation is None else f" --yield {order.confirmed_yield.value:.2f}"
    )
    return page_html(
        f"Tolerances of {name}",
        "tolerances",
        heading=f"Tolerances of {html_text(name)}",
        lead=_lead(order),
        numbers=_numbers(order),
        errors=_table(
            ("error", "tolerance", "distribution", "cost", "motion, px", "after pose, px"),
            _errors(order),
        ),
        indications=_table(("", "ISO 10110", "description"), indications(order.tolerances)),
        limits=_table(("limit", "good, %", "median", "95 %"), _limits(order)),
        conditions=_conditions(order),
        tornado=figure_html(
            bars, "svg+xml", "Image motion of each error at its tolerance.", "plot"
        ),
        curves=figure_html(shares, "svg+xml", f"{order.statistics.trials} trials.", "plot"),
        command=html_text(
            f"omnimirror tolerance {shell_word(name)} tolerances.toml --trials "
            f"{report.statistics.trials} --set analysis.seed={report.seed}{target_yield} --report "
            "order.html"
        ),
    )


def _lead(order: _Order) -> str:
    of = order.confirmed_yield
    return (
        f"Predicted yield within these tolerances: {100 * of.value:.1f} % (95 % confidence: "
        f"{100 * of.low:.1f} to {100 * of.high:.1f} %), from {order.statistics.trials} "
        "simulated sensors."
    )


def _numbers(order: _Order) -> str:
    allocation, of = order.report.allocation, order.confirmed_yield
    numbers = {
        "Yield": f"{100 * of.value:.2f} %",
        "95 % confidence": f"{100 * of.low:.2f} to {100 * of.high:.2f} %",
        "Errors": str(sum(bound.value > 0 for bound in order.tolerances.errors.values())),
        "Sensors with lost rays": f"{order.statistics.lost} of {order.statistics.trials}",
        "Cost": f"{sum(order.cost(name) for name in order.tolerances.names):.4g}",
    }
    if allocation is not None:
        numbers["Cost with uniform scaling"] = f"{allocation.uniform_cost:.4g}"
    return "".join(
        f"<div><dt>{html_text(k)}</dt><dd>{html_text(v)}</dd></div>" for k, v in numbers.items()
    )


def _errors(order: _Order) -> Iterable[tuple[str, ...]]:
    """Return a row per error, in groups, the most expensive first."""
    sources, effects = error_sources(order.report.sensor), {row.name: row for row in order.effects}
    groups: dict[str, list[str]] = {}
    for name in sorted(order.tolerances.names, key=order.cost, reverse=True):
        if order.tolerances.errors[name].value > 0:
            groups.setdefault(group_of(name), []).append(name)
    for group, names in groups.items():
        yield (f"**{group}",)
        for name in names:
            bound, kind, merits = (
                order.tolerances.errors[name],
                sources.get(name, MEASURED),
                effects[name].merits,
            )
            yield (
                f"{kind.meaning}|{name}",
                f"± {bound.value:.3g} {kind.unit}".rstrip(),
                DISTRIBUTED[bound.distribution],
                f"{order.cost(name):.3g}",
                format_motion(merits["motion_px"]),
                format_motion(merits["motion_px after pose"]),
            )


def indications(tolerances: Tolerances) -> list[tuple[str, str, str]]:
    """Return the indications of the mirror by ISO 10110: form (3/) and centring (4/), as in its drawing.

    >>> import omnimirror as om
    >>> errors = {"mirror.zernike_5_um": om.Tolerance(0.3), "mirror.tilt_x_deg": om.Tolerance(0.1)}
    >>> [code for _, code, _ in indications(om.Tolerances(om.load_sensor("paper-spherical"), errors))]
    ['3/- RMSt < 173 nm', "4/3'"]
    >>> indications(om.Tolerances(om.load_sensor("paper-spherical"), {"mirror.zernike_5_um": om.Tolerance(8.0)}))[0][1]
    '3/- RMSt < 4619 nm'
    """
    values = {name: bound.value for name, bound in tolerances.errors.items() if bound.value > 0}
    rows = [
        (
            "surface form",
            form_code(PartSpecification(), values),
            "rms of all form errors along the axis, uniformly distributed",
        ),
        (
            "centring",
            centring_code(PartSpecification(), values),
            "half of tilt and decentre; the other half is for the mount",
        ),
    ]
    named = {"mirror.vertex_radius_mm": "vertex radius, mm", "mirror.conic": "conic constant"}
    named |= {"mirror.displacement_mm": "distance from the lens, mm"}
    return rows + [
        (description, f"± {values[name]:.3g}", name)
        for name, description in named.items()
        if name in values
    ]


def _limits(order: _Order) -> Iterable[tuple[str, ...]]:
    statistics = order.statistics
    for name, limit in statistics.limits.items():
        good = 100 * statistics.passed_each.get(name, 0) / statistics.trials
        low, high = (f"{statistics.quantile(name, share):.3g}" for share in (0.5, 0.95))
        yield format_limit(name, limit), f"{good:.1f}", low, high


def _conditions(order: _Order) -> str:
    plan = order.report.plan
    focus = {"none": "has the nominal focus", "rms": "is refocused for minimum rms blur"}
    focused = focus.get(plan.refocus, "is refocused for minimum worst-case blur")
    return (
        "Image motions of objects over the field relative to the nominal sensor. Each sensor "
        f"{focused}. &ldquo;After&rdquo; denotes residuals after the calibration."
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Format a table; a row of one cell is a heading, and text after a bar is small."""
    body = []
    for row in rows:
        if len(row) == 1:
            body.append(
                f'<tr><th colspan="{len(head)}"><strong>{html_text(row[0].lstrip("*"))}</strong></th></tr>'
            )
            continue
        label, _, small = row[0].partition("|")
        first = html_text(label) + (f" <small>{html_text(small)}</small>" if small else "")
        cells = "".join(f"<td>{html_text(cell)}</td>" for cell in row[1:])
        body.append(f"<tr><th>{first}</th>{cells}</tr>")
    names = "".join(f"<th>{html_text(name)}</th>" for name in head)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{''.join(body)}</tbody></table>"
