"""Mirrors and limits edited on the plots of the Design tab, and feasible ranges of sliders."""

from __future__ import annotations

import re

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio._design_requirements import requirements_for, slider_violations
from omnimirror.apps.studio._design_sensors import (
    edited_sensor,
    sensor_from_tables,
    why_not_optimised,
)
from omnimirror.apps.studio._search_process import perform
from omnimirror.apps.studio.design_messages import (
    CurveEdit,
    SearchTask,
    SliderRequest,
    SliderValues,
)
from omnimirror.base.errors import OmnimirrorError
from omnimirror.design.requirement_check import check_requirements
from omnimirror.optics.sensor_files import bundled_sensors, tables_of

from .test_design_page import (
    CURRENT_DESIGN,
    design_tab,  # noqa: F401 - a fixture
    enter_value,
    plot_values,
    sensor_on,
    wait_for_response,
)

OPTIMISABLE = [
    name for name in bundled_sensors() if why_not_optimised(om.load_sensor(name)) is None
]
REQUIREMENTS = {
    "field": {"omega_max_deg": 130.0},
    "limit": [{"quantity": "total_blur_px", "at_most": 8.5}],
}


@pytest.mark.parametrize("name", OPTIMISABLE)
def test_dragged_profile_passes_through_point(name):
    sensor = om.load_sensor(name)
    rim = sensor.mirror.rim_radius_mm
    for fraction in (0.3, 0.75, 1.0):
        x = fraction * rim
        target_mm = float(sensor.mirror.sag(x)) - 0.002 * rim
        mirror = edited_sensor(sensor, CurveEdit(of="profile", at=x, to=target_mm)).mirror
        assert float(mirror.sag(x)) == pytest.approx(target_mm, abs=1e-9)
        shift = mirror.sag(np.linspace(0, rim, 50)) - sensor.mirror.sag(np.linspace(0, rim, 50))
        assert abs(shift[0]) < 1e-12
        assert np.all(
            np.diff(shift) < 2e-5 * rim
        )  # as a rod: all points move in the same direction


@pytest.mark.parametrize("name", OPTIMISABLE)
def test_dragged_mapping_passes_through_point(name):
    sensor = om.load_sensor(name)
    low, high = sensor.field_deg
    for fraction in (0.2, 0.5, 0.8):
        omega = low + fraction * (high - low)
        target_px = float(om.evaluate(sensor, [omega]).h_px[0]) * 1.02
        edited = edited_sensor(sensor, CurveEdit(of="mapping", at=omega, to=target_px))
        assert om.evaluate(edited, [omega]).h_px[0] == pytest.approx(target_px, abs=0.02)
        assert edited.rim_radius_px == pytest.approx(sensor.rim_radius_px, abs=1e-4)
        np.testing.assert_allclose(edited.field_deg, sensor.field_deg, atol=1e-4)


def test_infeasible_deformations_are_rejected():
    sphere = om.load_sensor("paper-spherical")
    with pytest.raises(OmnimirrorError, match="the image height must increase"):
        edited_sensor(sphere, CurveEdit(of="mapping", at=68.0, to=500.0))
    with pytest.raises(OmnimirrorError, match=r"can be dragged from 0.8781 to 43.905 mm"):
        edited_sensor(sphere, CurveEdit(of="profile", at=0.1, to=1.0))
    with pytest.raises(OmnimirrorError, match="this sensor has two"):
        edited_sensor(om.load_sensor("folded-spherical"), CurveEdit(of="profile", at=10.0, to=1.0))


def test_slider_range_agrees_with_verdicts():
    sphere = om.load_sensor("paper-spherical")
    values = tuple(np.linspace(2.0, 9.0, 9))
    slide = SliderValues(path=("lens", "f_number"), values=values)
    request = SliderRequest(
        tables=tables_of(sphere), follows_mapping=False, requirements=REQUIREMENTS, sliders=(slide,)
    )
    ((*violations,),) = slider_violations(request).violations
    assert max(violations[0]) > 0 > max(violations[-1])
    for value, shares in zip(values, violations, strict=True):
        tables = tables_of(sphere) | {"lens": tables_of(sphere)["lens"] | {"f_number": value}}
        sensor = sensor_from_tables(tables)
        verdict = check_requirements(requirements_for(REQUIREMENTS, sensor), sensor, angles=61)
        assert (max(shares) <= 0) == verdict.is_met


def drag(page, handle, right: float, down: float) -> tuple[float, float]:
    """Drag a handle and release it; return its distance from the pointer, px."""
    handle.scroll_into_view_if_needed()
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for share in np.linspace(0.2, 1.0, 5):
        page.mouse.move(x + share * right, y + share * down)
    wait_for_response(page)
    end_box = handle.bounding_box()
    page.mouse.up()
    page.wait_for_function("!window.omnimirror.tabs.design.curveEditing.isActive")
    wait_for_response(page)
    return end_box["x"] - box["x"] - right, end_box["y"] - box["y"] - down


def test_dragging_profile_updates_plots(design_tab):  # noqa: F811
    before = sensor_on(design_tab)
    offset = drag(design_tab, design_tab.locator(".handle.profile").first, 3, 0)
    assert np.hypot(*offset) < 1
    after = sensor_on(design_tab)
    assert after.mirror.KIND == "slope-spline"
    assert after.mirror.sag(21.95) - before.mirror.sag(21.95) > 1  # mm; 3 px correspond to 2 mm
    omega, height = plot_values(design_tab, "Image height")
    np.testing.assert_allclose(
        height, om.evaluate(after, np.linspace(*after.field_deg, len(omega))).h_px, atol=1e-2
    )
    design_tab.get_by_role("button", name="Undo").click()
    wait_for_response(design_tab)
    assert sensor_on(design_tab).mirror == before.mirror  # one undo step restores everything


@pytest.mark.full
def test_dragging_mapping_changes_mirror(design_tab):  # noqa: F811
    handle = design_tab.locator(".handle.point").nth(1)
    assert np.hypot(*drag(design_tab, handle, 0, -8)) < 1
    sensor = sensor_on(design_tab)
    assert sensor.mirror.KIND == "tabulated-mapping"
    omega, height = plot_values(design_tab, "Image height")
    np.testing.assert_allclose(
        height, om.evaluate(sensor, np.linspace(*sensor.field_deg, len(omega))).h_px, atol=1e-2
    )
    handle.focus()
    value = float(handle.get_attribute("aria-valuenow"))
    design_tab.keyboard.press("Shift+ArrowDown")
    design_tab.wait_for_function(
        f"Number(document.activeElement.getAttribute('aria-valuenow')) < {value}"
    )


def test_limits_are_plotted_and_draggable(design_tab):  # noqa: F811
    design_tab.get_by_role("button", name="Add a requirement").click()
    wait_for_response(design_tab)
    line = design_tab.locator(".handle.limit-line")
    assert np.hypot(*drag(design_tab, line, 0, -15)) < 1
    limit = design_tab.evaluate(f"{CURRENT_DESIGN}.requirements.limit[0]")
    assert limit["quantity"] == "total_blur_px"
    assert 5.5 < limit["at_most"] < 9
    assert design_tab.get_by_label("Total blur at most").input_value() == f"{limit['at_most']:g}"
    omega, blur = plot_values(design_tab, "Total blur")
    sensor = sensor_on(design_tab)
    result = om.evaluate(sensor, np.linspace(*sensor.field_deg, len(omega)))
    max_blur = np.hypot(np.maximum(abs(result.blur_t_px), abs(result.blur_s_px)), result.airy_px)
    np.testing.assert_allclose(blur, max_blur, rtol=1e-4)


@pytest.mark.full
def test_slider_displays_feasible_range(design_tab):  # noqa: F811
    design_tab.get_by_role("button", name="Add a requirement").click()
    wait_for_response(design_tab)
    enter_value(design_tab, "Total blur at most", "8.5")
    design_tab.wait_for_function("document.querySelector('#design .marks .met')")
    title = design_tab.get_by_label("F-number, slider", exact=True).get_attribute("title")
    low, high = map(float, re.search(r"are met at ([\d.]*\d) to ([\d.]*\d)", title).groups())
    for f_number, is_met in ((low - 0.2, False), (low + 0.2, True), (high - 0.2, True)):
        enter_value(design_tab, "F-number", f"{f_number:g}")
        assert ("All" in design_tab.locator("#design .verdict").first.inner_text()) == is_met


def test_search_enforces_limits_on_request():
    requirements = {
        "field": {"omega_max_deg": 130.0},
        "limit": [{"quantity": "resolution_px_per_deg", "at_least": 3.0}],
    }
    sphere = tables_of(om.load_sensor("paper-spherical"))
    values = []
    for enforces in (False, True):
        messages = []
        task = SearchTask(
            kind="optimise",
            tables=sphere,
            requirements=requirements,
            object_distance_mm=None,
            merit="worst_floored_area_deg2",
            shape="polynomial",
            terms=4,
            starts=1,
            keeps_limits=enforces,
        )
        perform(task, messages.append)
        sensor = sensor_from_tables(messages[-1].sensor.tables)
        result = om.evaluate(sensor, np.linspace(0.0, sensor.field_deg[1], 361))
        values.append(np.minimum(result.dh_domega_px_per_deg, result.width_px_per_deg).min())
    assert values[0] < 2.9
    assert values[1] > 3.0 - 1e-5
