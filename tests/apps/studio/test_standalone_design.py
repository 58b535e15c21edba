"""Design tab of the page without a server: its numbers equal those of the evaluation."""

from __future__ import annotations

import json

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _standalone_page, standalone_page
from omnimirror.apps.studio._design_evaluation import answer
from omnimirror.apps.studio._standalone_page import KERNEL, standalone_design
from omnimirror.apps.studio.design_messages import DesignRequest
from omnimirror.optics.sensor_files import parse_sensor, tables_of

from .browser import open_page
from .test_axe import AXE, AXE_VIOLATIONS

DESIGN_TAB = "window.omnimirror.tabs.design"
EVALUATE_DESIGN = """(ask) => {
  const found = window.omnimirror.tabs.design.evaluator.evaluator.answer(ask, 0);
  const blocks = found.blocks.map(({ name, columns }) =>
    [name, Object.fromEntries(columns.map((c) => [c, [...found.block(name).column(c)]]))]);
  return JSON.stringify({ summary: found.summary, error: found.error, blocks: Object.fromEntries(blocks) });
}"""
ASPHERE = """
name = "asphere"
[mirror]
kind = "conic-asphere"
vertex_radius_mm = 38.0
conic = -1.7
rim_radius_mm = 40.0
coefficients = [0.2, -0.03]
normalization_radius_mm = 35.0
[lens]
kind = "perspective"
focal_length_mm = 8.0
f_number = 2.8
focus_distance_mm = 190.0
[imager]
width_px = 1280
height_px = 1024
pixel_pitch_um = 4.8
centre_px = [600.0, 520.0]
[mount]
mirror_distance_mm = 160.0
"""
ELLIPSOID = ASPHERE.replace(
    'kind = "conic-asphere"\nvertex_radius_mm = 38.0\nconic = -1.7\nrim_radius_mm = 40.0\n'
    "coefficients = [0.2, -0.03]\nnormalization_radius_mm = 35.0",
    'kind = "ellipsoid"\na_mm = 44.0\nb_mm = 60.0\nrim_radius_mm = 31.0',
)
DESIGNS = [
    *standalone_design().start.sensors,
    pytest.param(ASPHERE, id="asphere"),
    pytest.param(ELLIPSOID, id="ellipsoid"),
]


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("alone") / "look.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_standalone_page, "SHOWN_SAMPLES", 1)
        patch.setattr(_standalone_page, "Room", lambda: om.Room(texel_mm=40.0))
        path.write_text(standalone_page(["paper-spherical"]), encoding="utf-8")
    return path.as_uri()


@pytest.fixture(scope="module")
def design_tab(browser, address):
    page = open_page(browser, address, 1280, 900)
    page.get_by_role("button", name="Design", exact=True).click()
    page.wait_for_function(f"{DESIGN_TAB}?.evaluations?.[0]")
    yield page
    assert page.problems == []
    page.context.close()


def sensor_of(design: str) -> om.Sensor:
    return parse_sensor(design) if "\n" in design else om.load_sensor(design)


def design_request(sensor: om.Sensor, **changes) -> DesignRequest:
    defaults = {
        "slot": 0,
        "number": 1,
        "tables": tables_of(sensor),
        "follows_mapping": False,
        "object_distance_mm": None,
    }
    return DesignRequest.model_validate(
        {
            **defaults,
            "include_section": True,
            "include_squares": True,
            "requirements": None,
            **changes,
        }
    )


def page_response(design_tab, request: DesignRequest) -> dict:
    return json.loads(design_tab.evaluate(EVALUATE_DESIGN, request.model_dump()))


def server_response(request: DesignRequest) -> tuple[dict, dict[str, dict[str, np.ndarray]]]:
    """Return the response of the server, computed by the Python evaluation."""
    data = answer(request)
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])
    values, blocks, offset = np.frombuffer(data, "<f4", -1, 4 + length), {}, 0
    for block in header["blocks"]:
        shape = len(block["columns"]), block["rows"]
        rows = values[offset : offset + shape[0] * shape[1]].reshape(shape)
        offset += rows.size
        blocks[block["name"]] = dict(zip(block["columns"], rows, strict=True))
    return header["summary"], blocks


@pytest.mark.parametrize("distance", [None, 700.0])
@pytest.mark.parametrize("design", DESIGNS)
def test_values_match_evaluation(design_tab, design, distance):
    request = design_request(sensor_of(design), object_distance_mm=distance)
    response, (summary, blocks) = page_response(design_tab, request), server_response(request)
    assert response["error"] is None
    for name, value in summary.items():
        if name not in ("name", "not_optimised"):
            expected = [np.nan if v is None else v for v in np.atleast_1d(np.array(value, object))]
            result = [
                np.nan if v is None else v
                for v in np.atleast_1d(np.array(response["summary"][name], object))
            ]
            np.testing.assert_allclose(result, expected, rtol=1e-6, atol=1e-9, err_msg=name)
    assert set(response["blocks"]) == set(blocks)
    for name, columns in blocks.items():
        for column, expected in columns.items():
            result = np.array(response["blocks"][name][column], float)
            is_finite = np.isfinite(expected)
            np.testing.assert_array_equal(
                np.isfinite(result), is_finite, err_msg=f"{name} {column}"
            )
            scale = np.abs(expected[is_finite]).max(initial=0.0)
            np.testing.assert_allclose(
                result[is_finite], expected[is_finite], rtol=1e-6, atol=1e-6 * scale, err_msg=name
            )


@pytest.mark.parametrize("design", DESIGNS)
def test_best_focus_matches_evaluation(design_tab, design):
    sensor = sensor_of(design)
    find = "([tables, object]) => window.omnimirror.tabs.design.evaluator.evaluator.bestFocus(tables, object)"
    focus_mm = design_tab.evaluate(find, [tables_of(sensor), 900.0])
    expected = om.best_focus(sensor, object_distance_mm=900.0)
    area = om.evaluate(
        sensor,
        np.linspace(0, sensor.field_deg[1], 2001),
        focus_mm=focus_mm,
        object_distance_mm=900.0,
    )
    assert area.floored_area_deg2.max() == pytest.approx(expected.value, rel=1e-4)


@pytest.mark.parametrize(
    ("section", "entry", "value", "message"),
    [
        (
            "mirror",
            "radius_mm",
            1e9,
            "radius_mm must be between 0.001 and 1000000 mm; got 1000000000",
        ),
        (
            "mirror",
            "radius_mm",
            40.0,
            "rim_radius_mm must be less than 40 mm, where the sphere ends; got 43.905",
        ),
        (
            "lens",
            "focus_distance_mm",
            5.0,
            "focus_distance_mm must be greater than focal_length_mm = 11.6; got 5",
        ),
        (
            "lens",
            "k1",
            0.1,
            "k1 = 0.1: this page runs without a server and supports ideal lenses only",
        ),
        ("mirror", "kind", "cone", "mirror cone requires a server; this page supports sphere"),
    ],
)
def test_error_is_displayed_next_to_its_field(design_tab, section, entry, value, message):
    request = design_request(om.load_sensor("paper-spherical"))
    request.tables[section][entry] = value
    response = page_response(design_tab, request)
    assert message in response["error"]["message"]
    assert response["error"]["path"][0] == section


def test_slider_pin_and_best_focus_without_server(browser, address):
    page = open_page(browser, address, 1280, 900)
    page.get_by_role("button", name="Design", exact=True).click()
    page.wait_for_function(f"{DESIGN_TAB}?.evaluations?.[0]")
    for name in (
        "Calibrate",
        "Export…",
        "Use as camera",
        "Open sensor…",
        "Optimise",
        "Analyse tolerances",
    ):
        assert not page.get_by_text(name, exact=True).first.is_visible(), name
    page.get_by_role("button", name="Pin", exact=True).click()
    page.get_by_role("spinbutton", name="Radius", exact=True).fill("47")
    page.get_by_role("spinbutton", name="Radius", exact=True).press("Enter")
    page.wait_for_function(f"{DESIGN_TAB}.evaluations[0].summary.field_deg[1] > 140")
    page.get_by_role("button", name="Best focus").click()
    page.wait_for_function(f"{DESIGN_TAB}.history.now.tables.lens.focus_distance_mm !== 212")
    page.get_by_role("button", name="Undo").click()
    page.wait_for_function(f"{DESIGN_TAB}.history.now.tables.lens.focus_distance_mm === 212")
    page.get_by_label("Start from a bundled sensor").select_option("paraboloid-telecentric")
    page.wait_for_function(f"{DESIGN_TAB}.evaluations[0].summary.mirror_distance_mm === null")
    page.reload()
    page.wait_for_function(f"{DESIGN_TAB}?.evaluations?.[0]?.summary.mirror_distance_mm === null")
    assert page.problems == []
    page.context.close()


@pytest.mark.full
@pytest.mark.parametrize("width", [360, 1280])
def test_accessibility_without_server(browser, address, width):
    if not AXE.exists():
        pytest.skip("axe-core is not here: `npm ci` in web/, or `make node`, fetches it")
    page = open_page(
        browser, f"{address}#tab=design", width, 800, reduced_motion="reduce", device_scale_factor=1
    )
    page.wait_for_function(f"{DESIGN_TAB}?.evaluations?.[0]")
    page.add_script_tag(path=AXE)
    serious = {
        v["id"]: v["nodes"][0]["html"]
        for v in page.evaluate(AXE_VIOLATIONS)
        if v["impact"] in ("serious", "critical")
    }
    assert serious == {}
    page.context.close()


def test_evaluator_has_no_network_access():
    """The evaluator can write to its own memory only: imports of its library are stubs."""
    data = KERNEL.read_bytes()
    assert data[:4] == b"\0asm"
    assert len(data) < 60_000
    assert b"fd_open" not in data
    assert b"path_open" not in data
