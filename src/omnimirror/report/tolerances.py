"""Tolerances on one self-contained page, to be sent with an order: what to hold, what that costs, how many are good."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..arguments import checked, file_name
from ..errors import InvalidParameter
from ..escaping import html_text, shell_word
from ..figures.style import render, styled
from ..files import write_text
from ..manufacturing.drawings.tables import centring_code, form_code
from ..manufacturing.tolerancing.charts import curves, plot_tornado
from ..manufacturing.tolerancing.evaluator import TrialEvaluator
from ..manufacturing.tolerancing.monte_carlo import (
    YieldEstimate,
    YieldStatistics,
    format_limit,
    format_motion,
    monte_carlo,
)
from ..manufacturing.tolerancing.perturbation import MEASURED, error_sources, group_of
from ..manufacturing.tolerancing.requirement_merits import requirement_merits
from ..manufacturing.tolerancing.sensitivity import ErrorSensitivity, sensitivities
from ..manufacturing.tolerancing.tolerance_analysis import ToleranceReport
from ..manufacturing.tolerancing.tolerances import Tolerances
from ..manufacturing.workshop import PartSpecification
from .pages import figure_html, page_html

DISTRIBUTED = {
    "uniform": "even",
    "normal": "normal, two sigma",
    "truncated-normal": "normal, two sigma, nothing beyond",
    "arcsine": "towards the ends",
    "constant": "the same of all",
}


@dataclass(frozen=True)
class _Order:
    """What the page says: tolerances to be held, and what becomes of sensors that hold them."""

    report: ToleranceReport
    tolerances: Tolerances
    statistics: YieldStatistics
    effects: Sequence[ErrorSensitivity]
    confirmed_yield: YieldEstimate

    @classmethod
    def of(cls, report: ToleranceReport) -> _Order:
        """Those that were allocated, traced anew, or those that were tried."""
        plan, found = report.plan, report.allocation
        if found is None:
            return cls(report, plan.tolerances, report.statistics, report.sensitivities, report.statistics.yields)
        errors = {
            name: replace(bound, value=found.tolerances.get(name, bound.value))
            for name, bound in plan.tolerances.errors.items()
        }
        chosen = replace(plan.tolerances, errors=errors)
        evaluator = TrialEvaluator.of(report.sensor, plan.refocus, requirement_merits(plan.limits), **plan.objects)
        statistics = monte_carlo(evaluator, chosen, plan.limits, trials=found.trials, seed=report.seed + 2)
        return cls(report, chosen, statistics, sensitivities(evaluator, chosen, plan.limits), found.confirmed_yield)

    def cost(self, name: str) -> float:
        """Of a tolerance as it is to be held."""
        asked = self.report.plan.tolerances.errors[name].value
        held = self.tolerances.errors[name].value
        return self.report.plan.costs.get(name, 1.0) * (asked / held if held else 0.0)


@checked
def write_tolerances(report: ToleranceReport, path: str | Path) -> Path:
    """Write tolerances as one self-contained page that a buyer sends with the order.

    Parameters
    ----------
    report
        From :func:`omnimirror.tolerance`; where a yield was asked for, the page shows the tolerances that reach it.
    path
        Ends in .html.

    Returns
    -------
    Path
        Of the file.

    Raises
    ------
    InvalidParameter
        Another ending.
    OmnimirrorError
        The file cannot be written.

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
    """The name of a page of tolerances; InvalidParameter for another ending."""
    path = file_name("path", path)
    if path.suffix.lower() != ".html":
        raise InvalidParameter(f"tolerances are written as .html, and {path.name} ends otherwise")
    return path


def tolerances_html(report: ToleranceReport) -> str:
    """The page with everything inside it."""
    order, name = _Order.of(report), report.sensor.name
    with styled():
        bars, shares = (render(figure, "svg") for figure in (plot_tornado(order.effects), curves(order.statistics)))
    wanted = "" if report.allocation is None else f" --yield {order.confirmed_yield.value:.2f}"
    return page_html(
        f"Tolerances of {name}",
        "tolerances",
        heading=f"Tolerances of {html_text(name)}",
        lead=_lead(order),
        numbers=_numbers(order),
        errors=_table(("error", "plus or minus", "distributed", "cost", "alone, px", "after pose, px"), _errors(order)),
        indications=_table(("", "ISO 10110", "that is"), indications(order.tolerances)),
        limits=_table(("within", "good, %", "median", "95 %"), _limits(order)),
        judged=_judged(order),
        tornado=figure_html(bars, "svg+xml", "How far each error alone moves the picture at its tolerance.", "plot"),
        curves=figure_html(shares, "svg+xml", f"Of {order.statistics.trials} sensors built so.", "plot"),
        command=html_text(
            f"omnimirror tolerance {shell_word(name)} tolerances.toml --trials {report.statistics.trials} "
            f"--seed {report.seed}{wanted} --report order.html"
        ),
    )


def _lead(order: _Order) -> str:
    of = order.confirmed_yield
    return (
        f"Of the sensors built within these tolerances {100 * of.value:.1f} % are good; with a confidence of 95 % "
        f"between {100 * of.low:.1f} and {100 * of.high:.1f} %, by {order.statistics.trials} sensors that were traced."
    )


def _numbers(order: _Order) -> str:
    found, of = order.report.allocation, order.confirmed_yield
    numbers = {
        "Good sensors": f"{100 * of.value:.2f} %",
        "between": f"{100 * of.low:.2f} and {100 * of.high:.2f} %",
        "Errors": str(sum(bound.value > 0 for bound in order.tolerances.errors.values())),
        "Rays lost by": f"{order.statistics.lost} of {order.statistics.trials}",
        "Price": f"{sum(order.cost(name) for name in order.tolerances.names):.4g}",
    }
    if found is not None:
        numbers["if all were scaled alike"] = f"{found.uniform_cost:.4g}"
    return "".join(f"<div><dt>{html_text(k)}</dt><dd>{html_text(v)}</dd></div>" for k, v in numbers.items())


def _errors(order: _Order) -> Iterable[tuple[str, ...]]:
    """A row for each error, in groups, the dearest first."""
    known, effects = error_sources(order.report.sensor), {row.name: row for row in order.effects}
    groups: dict[str, list[str]] = {}
    for name in sorted(order.tolerances.names, key=order.cost, reverse=True):
        if order.tolerances.errors[name].value > 0:
            groups.setdefault(group_of(name), []).append(name)
    for group, names in groups.items():
        yield (f"**{group}",)
        for name in names:
            bound, kind, merits = order.tolerances.errors[name], known.get(name, MEASURED), effects[name].merits
            yield (
                f"{kind.meaning}|{name}",
                f"± {bound.value:.3g} {kind.unit}".rstrip(),
                DISTRIBUTED[bound.distribution],
                f"{order.cost(name):.3g}",
                format_motion(merits["motion_px"]),
                format_motion(merits["motion_px after pose"]),
            )


def indications(tolerances: Tolerances) -> list[tuple[str, str, str]]:
    """What ISO 10110 has codes for, of the mirror: form (3/), and centring (4/), as its drawing has them.

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
            "rms of all form errors along the axis, spread within theirs",
        ),
        (
            "centring",
            centring_code(PartSpecification(), values),
            "half of tilt and decentre; the mount has the other half",
        ),
    ]
    named = {"mirror.vertex_radius_mm": "radius at the vertex, mm", "mirror.conic": "conic constant"}
    named |= {"mirror.displacement_mm": "distance from the lens, mm"}
    return rows + [(words, f"± {values[name]:.3g}", name) for name, words in named.items() if name in values]


def _limits(order: _Order) -> Iterable[tuple[str, ...]]:
    statistics = order.statistics
    for name, limit in statistics.limits.items():
        good = 100 * statistics.passed_each.get(name, 0) / statistics.trials
        low, high = (f"{statistics.quantile(name, share):.3g}" for share in (0.5, 0.95))
        yield format_limit(name, limit), f"{good:.1f}", low, high


def _judged(order: _Order) -> str:
    plan = order.report.plan
    focus = {"none": "as its file says", "rms": "anew, for the least rms of its blur"}
    focused = focus.get(plan.refocus, "anew, for its least worst blur")
    return (
        "Judged by objects all over the field against a sensor without errors; motions are of the picture. Each sensor "
        f"is focused {focused}. &ldquo;After&rdquo; is what a calibration of that depth leaves."
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table; a row of one cell heads those below it, and what follows a bar is small."""
    body = []
    for row in rows:
        if len(row) == 1:
            body.append(f'<tr><th colspan="{len(head)}"><strong>{html_text(row[0].lstrip("*"))}</strong></th></tr>')
            continue
        words, _, small = row[0].partition("|")
        first = html_text(words) + (f" <small>{html_text(small)}</small>" if small else "")
        cells = "".join(f"<td>{html_text(cell)}</td>" for cell in row[1:])
        body.append(f"<tr><th>{first}</th>{cells}</tr>")
    names = "".join(f"<th>{html_text(name)}</th>" for name in head)
    return f"<table><thead><tr>{names}</tr></thead><tbody>{''.join(body)}</tbody></table>"
