"""Tolerances in the Design tab: server responses against trials, and interaction with the error sliders."""

from __future__ import annotations

import re
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio._http_messages import unframed
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.design_messages import AsBuiltResult
from omnimirror.manufacturing.tolerancing.compensation import CALIBRATIONS, after
from omnimirror.manufacturing.tolerancing.evaluator import TrialEvaluator
from omnimirror.manufacturing.tolerancing.tolerances import error_sources, perturbed
from omnimirror.optics.housing import Dome, Housing
from omnimirror.optics.sensor_files import parse_sensor, tables_of

from .browser import TIMEOUT_MS
from .test_design_page import AXE, WITHOUT_IMAGES, design_tab  # noqa: F401 - a fixture

LOCAL = "http://127.0.0.1"
SPH = om.load_sensor("paper-spherical")
VALUES = {"mirror.decentre_x_mm": 0.1, "mirror.tilt_y_deg": 0.2, "lens.k1": 0.01}
IS_IDLE = """() => {
  const t = window.omnimirror.tabs.design.tolerances;
  return t.all && t.last && t.errors.isAtRest && t.built.isAtRest && t.yields.isAtRest;
}"""
LAST_RESULT = "window.omnimirror.tabs.design.tolerances.last"


@pytest.fixture(scope="module")
def client():
    with TestClient(create_app(), base_url=LOCAL) as client:
        yield client


def post(path, client, **body):
    return client.post(f"/api/design/{path}", json={"tables": tables_of(SPH), **body})


def test_errors_match_sensor_except_finest_form(client):
    response = post("errors", client).json()
    names = [error["name"] for error in response["errors"]]
    assert names == [
        n
        for n in error_sources(SPH)
        if not n.startswith("mirror.zernike") or int(n.split("_")[1]) <= 11
    ]
    assert response["calibrations"] == list(CALIBRATIONS)
    first = error_sources(SPH)[names[0]]
    assert response["errors"][0]["medium"] == first.typical_tolerances["medium"]


def test_as_built_sensor_matches_trial(client):
    answer = post("built", client, values=VALUES, refocus="none")
    header, data = unframed(answer.content, AsBuiltResult)
    evaluator = TrialEvaluator.of(SPH)
    merits, motions = evaluator.evaluate_with_motions(
        {name: np.array([value]) for name, value in VALUES.items()}
    )
    for name, values in (
        ("motion_px", header.motion_px),
        ("direction_error_deg", header.direction_error_deg),
    ):
        for depth, value in zip(CALIBRATIONS, values, strict=True):
            assert value == pytest.approx(
                merits[0, evaluator.names.index(after(name, depth))], abs=1e-9
            )
    assert header.straightness_deg[0] > header.straightness_deg[3]
    columns = np.frombuffer(data, "<f4").reshape(1 + len(CALIBRATIONS), 2, header.objects)
    np.testing.assert_allclose(columns[0].T, evaluator.reference_px, atol=1e-3)
    np.testing.assert_allclose(columns[1].ravel(), motions[0], atol=1e-4)
    assert header.tables == tables_of(perturbed(SPH, VALUES))


def test_yield_matches_tolerance_analysis(client):
    errors = {"mirror.decentre_x_mm": 0.3, "mirror.tilt_x_deg": 0.1, "lens.k1": 0.0}
    body = {
        "errors": [{"name": n, "tolerance": t} for n, t in errors.items()],
        "refocus": "none",
        "seed": 3,
    }
    response = post("yield", client, merit="motion_px", limit=2.0, trials=1000, **body).json()
    tolerances = om.Tolerances(SPH, {name: om.Tolerance(size) for name, size in errors.items()})
    expected = om.tolerance(SPH, tolerances, limits={"motion_px": 2.0}, trials=1000, seed=3)
    yields = expected.statistics.yields
    assert (response["fraction"], response["low"], response["high"]) == pytest.approx(
        (yields.value, yields.low, yields.high)
    )
    max_tolerance = {row.name: row.merits for row in expected.sensitivities}
    assert [row["name"] for row in response["rows"]] == [
        "mirror.decentre_x_mm",
        "mirror.tilt_x_deg",
    ]
    for row in response["rows"]:
        format_limit = [
            max_tolerance[row["name"]][after("motion_px", depth)] for depth in CALIBRATIONS
        ]
        assert row["motion_px"] == pytest.approx(format_limit, abs=1e-9)


@pytest.mark.full
def test_sensors_with_sequential_tracing(client):
    covered = tables_of(replace(SPH, housing=Housing(shell=Dome(260.0, 5.0))))
    assert not client.post("/api/design/errors", json={"tables": covered}).json()["is_vectorised"]
    body = {"tables": covered, "values": {"cover.decentre_x_mm": 0.5}, "refocus": "none"}
    header, _ = unframed(client.post("/api/design/built", json=body).content, AsBuiltResult)
    assert header.lost == 0
    assert 0 < header.motion_px[0] < 5
    assert header.straightness_deg == (None,) * len(CALIBRATIONS)


@pytest.mark.parametrize(
    ("path", "body", "message"),
    [
        (
            "built",
            {"values": {"mirror.nonsense": 1.0}, "refocus": "none"},
            "not an error source of this sensor",
        ),
        ("yield", {"merit": "nonsense"}, "not a merit of trials"),
        ("yield", {"limit": -1.0}, "must be positive"),
        ("yield", {"errors": []}, "must contain at least one error"),
        ("errors", {"tables": {}}, "mirror"),
    ],
)
def test_invalid_tolerance_requests_are_rejected(client, path, body, message):
    defaults = {
        "errors": [{"name": "lens.k1", "tolerance": 0.1}],
        "refocus": "none",
        "merit": "motion_px",
        "limit": 1.0,
    }
    defaults |= {"trials": 10, "seed": 0}
    answer = post(path, client, **(defaults if path == "yield" else {}) | body)
    assert 400 <= answer.status_code < 500
    assert message in answer.json()["detail"]


def open_errors(page):
    page.get_by_role("button", name="Analyse tolerances").click()
    page.wait_for_function(IS_IDLE)


def test_error_slider_displaces_image_and_calibration_compensates(design_tab):  # noqa: F811 - a fixture
    open_errors(design_tab)
    assert design_tab.evaluate(f"{LAST_RESULT}.motion_px")[0] < 1e-6
    slider = design_tab.get_by_role("slider", name="Mirror decentre x")
    slider.fill("2")  # tolerances, set by the slider
    design_tab.wait_for_function(f"{LAST_RESULT}.motion_px[0] > 1")
    design_tab.wait_for_function(IS_IDLE)
    assert design_tab.get_by_label("Mirror decentre x", exact=True).input_value() == "0.1"
    motion_px, _, _, residual_px, _ = design_tab.evaluate(f"{LAST_RESULT}.motion_px")
    evaluator = TrialEvaluator.of(SPH)
    expected = evaluator.evaluate({"mirror.decentre_x_mm": np.array([0.1])})[0]
    assert motion_px == pytest.approx(expected[evaluator.names.index("motion_px")], rel=1e-6)
    assert residual_px < 1e-3
    displayed = parse_sensor_tables(design_tab.evaluate(f"{LAST_RESULT}.tables"))
    assert displayed.mirror_pose.decentre_x_mm == pytest.approx(0.1)
    lines = design_tab.locator("svg.moved").first.locator("line")
    assert lines.count() == len(evaluator.field)
    design_tab.get_by_role("button", name="Reset errors").click()
    design_tab.wait_for_function(f"{LAST_RESULT}.motion_px[0] < 1e-6")


def parse_sensor_tables(tables):
    import tomli_w

    return parse_sensor(tomli_w.dumps(tables))


def test_tolerances_display_yield_and_tornado_chart(design_tab):  # noqa: F811
    open_errors(design_tab)
    verdict = design_tab.locator(".tolerance-body .verdict")
    before = verdict.text_content()
    assert "4096 simulated sensors" in before
    assert design_tab.locator("svg.tornado rect").count() == 3 * 14
    assert "Imager shift" in design_tab.locator("svg.tornado").get_attribute("aria-label")
    design_tab.get_by_label("Tolerance grade").select_option("coarse")
    design_tab.wait_for_function(IS_IDLE)
    assert float(verdict.text_content().split()[0]) < float(before.split()[0])
    design_tab.get_by_label("Calibration", exact=True).select_option("none")
    design_tab.wait_for_function(IS_IDLE)
    assert verdict.text_content().startswith("0.0 %")


@pytest.mark.full
def test_errors_follow_design_and_end_with_panel(design_tab):  # noqa: F811
    open_errors(design_tab)
    assert design_tab.get_by_label("Mirror conic", exact=True).count() == 1
    design_tab.get_by_label("Start from a bundled sensor").select_option("paper-equidistant")
    design_tab.wait_for_function(
        "window.omnimirror.tabs.design.tolerances.tables.mirror.kind === 'even-polynomial'"
    )
    design_tab.wait_for_function(IS_IDLE)
    assert design_tab.get_by_label("Mirror conic", exact=True).count() == 0
    assert design_tab.get_by_label("Mirror coefficients[1]", exact=True).count() == 1
    design_tab.get_by_role("button", name="Close tolerances").click()
    assert design_tab.locator("figure.tolerances").is_hidden()


def panel_values(page):
    """Return the content of the panel: options, numbers and verdict."""
    page.wait_for_function(IS_IDLE)
    return page.evaluate("""() => {
      const body = document.querySelector(".tolerance-body");
      const values = [...body.querySelectorAll("select, input")].map((e) => e.value);
      return [...values, body.querySelector(".verdict").textContent];
    }""")


@pytest.mark.full
def test_link_contains_displayed_errors(design_tab, browser):  # noqa: F811
    open_errors(design_tab)
    initial = panel_values(design_tab)
    for title, choice in (("Tolerance grade", "fine"), ("Calibration", "affine"), ("Focus", "rms")):
        design_tab.get_by_label(title, exact=True).select_option(choice)
    design_tab.get_by_role("spinbutton", name="Maximum").fill("0.75")
    design_tab.get_by_label("Mirror tilt x", exact=True).fill("0.123")
    tolerance = design_tab.get_by_label(re.compile("Tolerance of Mirror tilt x"))
    tolerance.fill("0.3")
    tolerance.press("Tab")
    changed = panel_values(design_tab)
    assert changed != initial
    design_tab.wait_for_function(
        "/tilt_x_deg%22%3A0.123.*tilt_x_deg%22%3A0.3%7D/.test(location.hash)"
    )
    link = design_tab.url
    with closing(
        browser.new_context(viewport={"width": 1280, "height": 800}, bypass_csp=True)
    ) as context:
        page = context.new_page()
        page.set_default_timeout(TIMEOUT_MS)
        page.add_init_script(WITHOUT_IMAGES)
        page.goto(link)
        page.wait_for_function("window.omnimirror?.tabs?.design")
        assert panel_values(page) == changed
        page.reload()
        page.wait_for_function("window.omnimirror?.tabs?.design")
        assert panel_values(page) == changed
        page.evaluate(
            "location.hash = location.hash.replace('mirror.tilt_x_deg', 'mirror.nonsense')"
        )
        page.get_by_text("do not apply to this sensor: Mirror nonsense").wait_for()
        assert page.get_by_label("Mirror tilt x", exact=True).input_value() == "0"
        page.evaluate("location.hash = location.hash.replace('fine', 'finest')")
        page.get_by_text("The errors in the address are invalid").wait_for()
        page.get_by_role("button", name="Close tolerances").click()
        page.wait_for_function("!location.hash.includes('errors')")


@pytest.mark.full
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_of_tolerances(scheme, design_tab):  # noqa: F811
    if not AXE.exists():
        pytest.skip("axe-core is not here: npm install in web/")
    design_tab.emulate_media(color_scheme=scheme)
    open_errors(design_tab)
    design_tab.add_script_tag(path=AXE)
    violations = design_tab.evaluate(
        "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
    )
    serious = {
        v["id"]: v["nodes"][0]["html"] for v in violations if v["impact"] in ("serious", "critical")
    }
    assert serious == {}
