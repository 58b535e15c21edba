"""Report for orders: self-contained, with the numbers of the tolerance analysis."""

from __future__ import annotations

import re

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.reports.tolerances import indications, write_tolerances
from omnimirror.base.errors import InvalidParameter
from tests.commands import omnimirror

SENSOR = om.load_sensor("paper-spherical")
ERRORS = {
    "mirror.tilt_x_deg": om.Tolerance(0.1),
    "mirror.tilt_y_deg": om.Tolerance(0.2),
    "mirror.decentre_x_mm": om.Tolerance(0.05),
    "mirror.zernike_5_um": om.Tolerance(0.3),
    "mirror.zernike_8_um": om.Tolerance(0.4),
    "mirror.conic": om.Tolerance(0.005),
    "lens.k1": om.Tolerance(0.01),
}
PLAN = om.TolerancePlan(
    om.Tolerances(SENSOR, ERRORS),
    {"motion_px after affine": 0.3},
    objects={"angles": 2, "azimuths": 6},
)


def test_iso_10110_indications():
    rows = {name: code for name, code, _ in indications(PLAN.tolerances)}
    assert rows["surface form"] == "3/- RMSt < 289 nm"  # of 0.3 and 0.4 um, uniform distribution
    assert rows["centring"] == "4/3' (0.025 mm)"
    assert rows["conic constant"] == "± 0.005"


@pytest.mark.parametrize("target_yield", [None, pytest.param(0.9, marks=pytest.mark.full)])
def test_page_contains_report(tmp_path, target_yield):
    result = om.tolerance(SENSOR, PLAN, trials=500, target_yield=target_yield)
    page = write_tolerances(result, tmp_path / "order.html").read_text(encoding="utf-8")
    assert page.count("data:image/svg+xml") == 2
    assert not re.search(r'(src|href)="(?!data:)', page)
    yields = (
        result.statistics.yields if result.allocation is None else result.allocation.confirmed_yield
    )
    assert f"{100 * yields.value:.2f} %" in page
    assert f"{100 * yields.low:.2f} to {100 * yields.high:.2f} %" in page
    tolerances = {name: bound.value for name, bound in ERRORS.items()}
    tolerances |= {} if result.allocation is None else dict(result.allocation.tolerances)
    rows = dict(re.findall(r"<small>([\w.]+)</small></th><td>± ([\d.e+-]+)", page))
    assert rows.keys() == ERRORS.keys()
    for name, value in rows.items():
        assert float(value) == pytest.approx(tolerances[name], rel=5e-3)
    prices = [float(p) for p in re.findall(r"<td>uniform</td><td>([\d.e+-]+)</td>", page)]
    total = sum(prices)
    assert total == pytest.approx(
        len(ERRORS) if result.allocation is None else result.allocation.cost, rel=1e-2
    )


def test_command_writes_page_and_other_suffixes_raise(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "t.toml").write_text('[[error]]\nname = "lens.k1"\ntolerance = 0.1\n')
    run = omnimirror(
        "tolerance", "paper-spherical", "t.toml", "--trials", "50", "--report", "order.html"
    )
    assert run.returncode == 0, run.stderr
    assert "Tolerances of paper-spherical" in (tmp_path / "order.html").read_text(encoding="utf-8")
    result = om.tolerance(SENSOR, PLAN, trials=10)
    with pytest.raises(InvalidParameter, match=r"suffix \.html; got order\.pdf"):
        write_tolerances(result, "order.pdf")
    assert np.isfinite(result.statistics.mean("motion_px"))
