"""User interaction with the Design tab, and the resulting page."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import tomli_w

import omnimirror as om
from omnimirror.apps.studio import _look_routes
from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio._uploads import encoded
from omnimirror.optics.mirrors import SlopeSpline
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import parse_sensor, save_sensor

from .browser import COARSE, TIMEOUT_MS, serving
from .images import pattern
from .test_page import AXE

PAGE = Path(om.__file__).parent / "apps" / "studio" / "page"
EMPTY = '{ "design": null, "past": [], "future": [], "pins": [], "switched": ["Image"] }'
WITHOUT_IMAGES = f"""
if (!localStorage.getItem("omnimirror-design")) localStorage.setItem("omnimirror-design", '{EMPTY}');
"""  # rendering them would use all processors
CURRENT_DESIGN = "window.omnimirror.tabs.design.history.now"
CANCEL_AT_FIRST_STEP = """
new MutationObserver((_, observer) => {
  const words = [...document.querySelectorAll("#design .words")].map((e) => e.textContent);
  const current = words.find((t) => / step \\d/.test(t));
  if (!current) return;
  observer.disconnect();
  window.seen = current;
  [...document.querySelectorAll("#design button")].find((b) => b.textContent === "Cancel").click();
}).observe(document.querySelector("#design"), { subtree: true, childList: true, characterData: true });
"""  # messages of a step last a few milliseconds only, so the click is made by a page script


@pytest.fixture
def design_tab(browser, server):
    """The Design tab with the spherical sensor of the paper; page errors fail the test."""
    viewport = {"width": 1280, "height": 800}
    context = browser.new_context(
        viewport=viewport, bypass_csp=True, accept_downloads=True, **COARSE
    )
    context.add_init_script(WITHOUT_IMAGES)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    problems = []
    page.on("pageerror", lambda e: problems.append(str(e)))
    page.goto(f"{server}#tab=design")
    wait_for_plots(page)
    yield page
    context.close()
    assert problems == []


def wait_for_plots(page) -> None:
    """Wait for the first drawing."""
    page.wait_for_selector("#design .compare tbody td")


def wait_for_response(page) -> None:
    """Wait until the response to the current design has been drawn."""
    page.wait_for_function("""() => {
      const { design } = window.omnimirror.tabs;
      return design.evaluator.waiting.size === 0 && design.evaluator.activeRequest === null;
    }""")


def sensor_on(page) -> om.Sensor:
    return parse_sensor(tomli_w.dumps(page.evaluate(f"{CURRENT_DESIGN}.tables")))


def plot_values(page, title: str) -> np.ndarray:
    """Return field angles and series values of a chart."""
    script = """(title) => {
      const { charts } = window.omnimirror.tabs.design.plotArea;
      return charts.find((c) => c.chart.title === title).plot.data.map((column) => Array.from(column));
    }"""
    return np.array(page.evaluate(script, title), float)


HANDLE_PX = 16


def handle_position(width: float, value: float) -> float:
    """Return the distance of the handle of a slider from its left end, px."""
    return HANDLE_PX / 2 + value * (width - HANDLE_PX)


def drag_slider(page, name: str, shift: float) -> None:
    """Drag a slider by a fraction of its width from its current position and release it."""
    slider = page.get_by_label(f"{name}, slider", exact=True)
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    y = box["y"] + box["height"] / 2
    start = float(slider.input_value())
    page.mouse.move(box["x"] + handle_position(box["width"], start), y)
    page.mouse.down()
    for position in np.linspace(start, start + shift, 6):
        page.mouse.move(box["x"] + handle_position(box["width"], position), y)
    page.mouse.up()
    wait_for_response(page)


def enter_value(page, name: str, value: str) -> None:
    page.get_by_label(name, exact=True).fill(value)
    page.keyboard.press("Enter")
    wait_for_response(page)


@pytest.mark.parametrize(
    "mirror",
    [
        "equidistant",
        *(pytest.param(kind, marks=pytest.mark.full) for kind in ("sphere", "even polynomial")),
    ],
)
def test_slider_updates_curves_to_evaluation(mirror, design_tab):
    if mirror != "sphere":
        design_tab.get_by_label("Type of mirror").select_option(mirror)
        design_tab.wait_for_function(
            f"{CURRENT_DESIGN}.tables.mirror.kind === '{mirror.replace(' ', '-')}'"
        )
    name = {"sphere": "Radius", "equidistant": "Ω max", "even polynomial": "Coefficient 1"}[mirror]
    before = design_tab.evaluate(f"JSON.stringify({CURRENT_DESIGN}.tables.mirror)")
    drag_slider(design_tab, name, 0.07)
    sensor = sensor_on(design_tab)
    assert design_tab.evaluate(f"JSON.stringify({CURRENT_DESIGN}.tables.mirror)") != before
    expected = om.evaluate(sensor, np.linspace(*sensor.field_deg, 361))
    charts = {
        "Image height": ["h_px"],
        "Viewpoint": ["viewpoint_z_mm"],
        "Blur in the image": ["blur_t_px", "blur_s_px"],
        "Floored blur area": ["floored_area_deg2"],
    }
    for title, columns in charts.items():
        omega, *series = plot_values(design_tab, title)
        np.testing.assert_allclose(omega, expected.omega_deg, rtol=1e-6)
        for column, values in zip(columns, series, strict=True):
            np.testing.assert_allclose(values, getattr(expected, column), rtol=1e-5, atol=1e-4)
    if mirror == "equidistant":
        assert np.ptp(expected.dh_domega_px_per_deg) < 1e-9  # the lens is adapted to the mirror


def test_cursor_is_shared_by_all_plots(design_tab):
    chart = design_tab.get_by_label(re.compile("^Image height against"))
    chart.wait_for()
    chart.hover(position={"x": 120, "y": 70})
    omega = design_tab.evaluate("window.omnimirror.tabs.design.plotArea.cursor.omega")
    expected = om.evaluate(om.load_sensor("paper-spherical"), [omega])
    figures = design_tab.locator("figure.plot")
    for title, value in (
        ("Image height, px", f"{expected.h_px[0]:.1f}"),
        ("Aspect", f"{expected.aspect[0]:.3f}"),
        ("Cross-section", f"x {expected.x_mm[0]:.2f} mm"),
    ):
        readout = figures.filter(has_text=title).first.locator("output").inner_text()
        assert readout.startswith(f"{omega:.1f}°")
        assert value in readout
    section = design_tab.locator("svg.section").first
    section.hover(position={"x": 300, "y": 70})
    omega = design_tab.evaluate("window.omnimirror.tabs.design.plotArea.cursor.omega")
    assert (
        figures.filter(has_text="Cross-section")
        .locator("output")
        .inner_text()
        .startswith(f"{omega:.1f}°")
    )
    marker = section.locator(".read circle")
    assert float(marker.get_attribute("cy")) == pytest.approx(
        70, abs=1.5
    )  # mirror point at the height of the pointer
    chart.focus()
    design_tab.keyboard.press("ArrowRight")
    assert design_tab.evaluate(
        "window.omnimirror.tabs.design.plotArea.cursor.omega"
    ) == pytest.approx(omega + 1)


def test_undo_redo_and_reload_preserve_state(design_tab):
    first = sensor_on(design_tab)
    drag_slider(design_tab, "Radius", 0.1)
    second = sensor_on(design_tab)
    enter_value(design_tab, "F-number", "5.6")
    third = sensor_on(design_tab)
    assert len({first, second, third}) == 3
    design_tab.keyboard.press("Control+z")
    assert sensor_on(design_tab) == second
    design_tab.keyboard.press("Control+z")
    assert sensor_on(design_tab) == first
    design_tab.keyboard.press("Control+Shift+z")
    assert sensor_on(design_tab) == second
    design_tab.get_by_role("button", name="Pin", exact=True).click()
    design_tab.get_by_role("button", name="Add a requirement").click()
    design_tab.wait_for_function("location.hash.includes('quantity')")
    design_tab.reload()
    wait_for_plots(design_tab)
    assert sensor_on(design_tab) == second
    design_tab.get_by_role(
        "button", name=re.compile("^Unpin")
    ).wait_for()  # with the response for the pinned design
    design_tab.get_by_label("Quantity").wait_for()
    design_tab.get_by_role("button", name="Undo", exact=True).click()  # removes the requirement
    design_tab.get_by_role("button", name="Undo", exact=True).click()
    assert sensor_on(design_tab) == first


def test_error_is_displayed_next_to_its_field_and_plots_remain(design_tab):
    before = plot_values(design_tab, "Image height")
    enter_value(design_tab, "Rim radius", "60")
    field = design_tab.locator(".field").filter(
        has=design_tab.get_by_label("Rim radius", exact=True)
    )
    assert "Rim radius must be less than 49.9582 mm" in field.locator(".problem").inner_text()
    assert design_tab.get_by_label("Rim radius", exact=True).get_attribute("aria-invalid") == "true"
    assert "last valid design" in design_tab.locator(".trouble").inner_text()
    np.testing.assert_array_equal(plot_values(design_tab, "Image height"), before)
    enter_value(design_tab, "Rim radius", "45")
    assert not field.locator(".problem").is_visible()
    assert not design_tab.locator(".trouble").is_visible()
    assert not np.array_equal(plot_values(design_tab, "Image height"), before)


@pytest.mark.long
def test_pinned_designs_are_compared_loaded_and_unpinned(design_tab):
    first = sensor_on(design_tab)
    design_tab.get_by_role("button", name="Pin", exact=True).click()
    drag_slider(design_tab, "Focal length", 0.15)
    rows = design_tab.locator(".compare tbody tr")
    rows.nth(1).wait_for()
    current, pinned = (rows.nth(i).locator("td").nth(2).inner_text() for i in (0, 1))
    assert float(current.split()[0]) == pytest.approx(sensor_on(design_tab).rim_radius_px, rel=1e-3)
    assert float(pinned) == pytest.approx(first.rim_radius_px, rel=1e-3)
    omega, old, _ = plot_values(design_tab, "Image height")
    is_plotted = np.isfinite(old)
    expected = om.evaluate(first, np.minimum(omega[is_plotted], first.field_deg[1])).h_px
    np.testing.assert_allclose(old[is_plotted], expected, rtol=1e-5, atol=1e-3)
    design_tab.get_by_role("button", name=re.compile("^Load")).click()
    wait_for_response(design_tab)
    assert sensor_on(design_tab) == first
    design_tab.get_by_role("button", name=re.compile("^Unpin")).click()
    assert rows.count() == 1
    assert len(plot_values(design_tab, "Image height")) == 2


def test_saved_sensor_round_trip(design_tab, tmp_path):
    drag_slider(design_tab, "Radius", 0.08)
    enter_value(design_tab, "Name", "mine")
    sensor = sensor_on(design_tab)
    design_tab.get_by_role("button", name="Export…").click()
    with design_tab.expect_download() as download:
        design_tab.get_by_role("button", name="Download Sensor file").click()
    design_tab.get_by_role("button", name="Close", exact=True).click()
    assert download.value.suggested_filename == "mine.toml"
    download.value.save_as(tmp_path / "mine.toml")
    assert om.load_sensor(tmp_path / "mine.toml") == sensor
    design_tab.get_by_label("Start from a bundled sensor").select_option("folded-hyperboloidal")
    design_tab.wait_for_function(f"{CURRENT_DESIGN}.tables.name === 'folded-hyperboloidal'")
    assert design_tab.get_by_role("heading", name="Second mirror").is_visible()
    design_tab.set_input_files("#design-file", tmp_path / "mine.toml")
    design_tab.wait_for_function(f"{CURRENT_DESIGN}.tables.name === 'mine'")
    assert sensor_on(design_tab) == sensor
    (tmp_path / "bad.toml").write_text("[mirror]\nkind = 'spher'\n[lens]\n[imager]\n")
    design_tab.set_input_files("#design-file", tmp_path / "bad.toml")
    design_tab.get_by_text("did you mean sphere?").first.wait_for()
    assert sensor_on(design_tab) == sensor


def test_unbounded_square_is_omitted(design_tab, tmp_path):
    """The centre of this mirror images the forward direction on a ring: 1 deg about the axis has
    unbounded width."""
    sphere = om.load_sensor("paper-spherical")
    slopes = sphere.mirror.profile(np.linspace(0, sphere.mirror.rim_radius_mm, 8))[1]
    ring = replace(
        sphere, name="ring", mirror=SlopeSpline((-1e-3, *slopes[1:]), sphere.mirror.rim_radius_mm)
    )
    save_sensor(ring, tmp_path / "ring.toml")
    sides = "[...document.querySelectorAll('#design .strip')[0].querySelectorAll('rect')].map((r) => r.height.baseVal)"
    before = design_tab.evaluate(f"{sides}.length")
    design_tab.set_input_files("#design-file", tmp_path / "ring.toml")
    design_tab.wait_for_function(f"{CURRENT_DESIGN}.tables.name === 'ring'")
    wait_for_response(design_tab)
    heights = design_tab.evaluate(f"{sides}.map((height) => height.value)")
    assert len(heights) == before - 1
    assert 0 < min(heights) <= max(heights) < 1000


@pytest.mark.long
def test_requirements_display_verdict_and_margin(design_tab, tmp_path):
    sensor = sensor_on(design_tab)
    e = om.evaluate(sensor, np.linspace(0, 135, 2001))
    blur = np.hypot(
        np.maximum(np.abs(e.blur_t_px), np.abs(e.blur_s_px)), e.airy_px
    )  # including the Airy disc
    worst = blur.max()
    design_tab.get_by_role("button", name="Add a requirement").click()
    wait_for_response(design_tab)
    mark = design_tab.locator(".limit").last.locator(".mark")
    assert "✗ not met" in mark.inner_text()
    assert f"margin −{worst - 5:.2f} px" in mark.inner_text()
    assert "at 135°" in mark.inner_text()
    assert design_tab.get_by_text("1 of 3 not met").is_visible()
    enter_value(design_tab, "Total blur at most", "10")
    assert "✓ met" in mark.inner_text()
    assert f"margin {10 - worst:.2f} px" in mark.inner_text()
    assert design_tab.get_by_text("All 3 met").is_visible()
    design_tab.get_by_role("button", name="partial field").click()
    enter_value(design_tab, "Maximum field angle of the limit, degrees", "60")
    part = e.omega_deg <= 60
    worst = blur[part].max()
    assert "✓ met" in mark.inner_text()
    assert f"margin {10 - worst:.2f} px" in mark.inner_text()
    (tmp_path / "wanted.toml").write_text(
        "[field]\nomega_max_deg = 90\nobject_distance_mm = [1000, 12000]\n"
        "[mirror]\nmapping = 'equiangular'\nrim_radius_mm = 40\n"
        "[lens]\ntheta_max_deg = 12\n[[limit]]\nquantity = 'aspect'\nat_least = 0.5\n"
    )
    design_tab.set_input_files("#design-file", tmp_path / "wanted.toml")
    max_distance = design_tab.get_by_label("Maximum object distance, mm; empty for infinity")
    # An empty one existed before the file was opened.
    design_tab.wait_for_function(
        "[...document.querySelectorAll('#design input')].some((input) => input.value === '12000')"
    )
    assert max_distance.input_value() == "12000"
    size = design_tab.viewport_size
    design_tab.set_viewport_size({"width": 1280, "height": 800})
    assert (
        max_distance.evaluate("(input) => input.scrollWidth - input.clientWidth") == 0
    )  # the number is fully visible
    design_tab.set_viewport_size(size)
    design_tab.get_by_role("button", name="Design from requirements").click()
    design_tab.wait_for_function(f"{CURRENT_DESIGN}.tables.mirror.kind === 'equiangular'")
    wait_for_response(design_tab)
    assert sensor_on(design_tab).field_deg[1] == pytest.approx(90)
    assert design_tab.locator(".compare tbody tr").count() == 1  # plots of the new design only
    omega, height = plot_values(design_tab, "Image height")
    np.testing.assert_allclose(height, om.evaluate(sensor_on(design_tab), omega).h_px, atol=2e-3)


@pytest.mark.long
def test_relaxation_is_applied_with_one_click(design_tab, tmp_path):
    (tmp_path / "infeasible.toml").write_text(
        "[field]\nomega_max_deg = 100\n[mirror]\nfamily = 'sphere'\nrim_radius_mm = 40\n"
        "[lens]\ntheta_max_deg = 12\n[[limit]]\nquantity = 'resolution_px_per_deg'\nat_least = 4.5\n"
    )
    design_tab.set_input_files("#design-file", tmp_path / "infeasible.toml")
    design_tab.get_by_role("button", name="Design from requirements").click()
    relaxation = design_tab.locator(".relaxations li").filter(has_text="Resolution 4.5")
    relaxation.first.get_by_role("button", name="Apply").click()
    design_tab.get_by_text("All requirements are met.").wait_for()
    limit = design_tab.evaluate(f"{CURRENT_DESIGN}.requirements.limit[0].at_least")
    assert 0 < limit < 4.5
    wait_for_response(design_tab)
    sensor = sensor_on(design_tab)
    e = om.evaluate(sensor, np.linspace(0, 100, 1001))
    reached = np.minimum(e.dh_domega_px_per_deg, e.width_px_per_deg).min()
    assert limit <= reached * (1 + 1e-6)


def test_key_presses_are_one_undo_step_and_ends_do_not_swap(design_tab):
    first = sensor_on(design_tab)
    slider = design_tab.get_by_label("Radius, slider", exact=True)
    field = design_tab.locator(".field", has=slider)
    assert field.locator(".ends span").all_inner_texts() == ["10.0", "100"]
    position = np.log(first.mirror.radius_mm / 10) / np.log(10)
    assert float(slider.input_value()) == pytest.approx(position, abs=2e-3)
    slider.focus()
    for _ in range(5):
        design_tab.keyboard.press("ArrowRight")
    wait_for_response(design_tab)
    assert sensor_on(design_tab).mirror.radius_mm > first.mirror.radius_mm + 0.4
    design_tab.get_by_role("button", name="Undo").click()
    wait_for_response(design_tab)
    assert sensor_on(design_tab).mirror == first.mirror
    enter_value(design_tab, "Radius", "-5")
    assert field.get_by_text("Radius must be").is_visible()
    low, high = (float(text) for text in field.locator(".ends span").all_inner_texts())
    assert low < high


def test_all_axes_have_labels_with_units(design_tab):
    script = """() => window.omnimirror.tabs.design.plotArea.charts
      .filter((c) => c.plot).map((c) => c.plot.axes.map((a) => a.label))"""
    labels = design_tab.evaluate(script)
    assert len(labels) >= 8
    assert {across for across, _ in labels} == {"Field angle Ω, °"}
    assert ["Field angle Ω, °", "h, px"] in labels
    texts = design_tab.locator("svg.section").first.locator("text.tick").all_text_contents()
    assert {"z, mm", "x, mm"} < set(texts)


def test_optimisation_is_cancelled_and_undone(design_tab):
    first = sensor_on(design_tab)
    design_tab.get_by_label("Minimise").select_option("worst_blur_deg")
    design_tab.get_by_label("Coefficients", exact=True).fill("24")
    design_tab.get_by_label("Number of starts").fill("8")
    design_tab.evaluate(CANCEL_AT_FIRST_STEP)
    design_tab.get_by_role("button", name="Optimise").click()
    design_tab.wait_for_function("window.seen")
    assert re.fullmatch(
        r"Start 1 of 8, step \d+: 0\.\d+ (deg|°)", design_tab.evaluate("window.seen")
    )
    assert design_tab.get_by_text("Cancelled; the design is unchanged.").is_visible()
    assert sensor_on(design_tab) == first
    design_tab.get_by_label("Freeform surface").select_option("polynomial")
    design_tab.get_by_label("Coefficients", exact=True).fill("3")
    design_tab.get_by_label("Number of starts").fill("1")
    design_tab.get_by_role("button", name="Optimise").click()
    design_tab.wait_for_function(f"{CURRENT_DESIGN}.tables.name === 'optimised-worst-blur-deg'")
    wait_for_response(design_tab)
    e, before = (
        om.evaluate(s, np.linspace(0, s.field_deg[1], 999)) for s in (sensor_on(design_tab), first)
    )
    blur, blur_before = (
        np.maximum(np.abs(x.blur_t_deg), np.abs(x.blur_s_deg)).max() for x in (e, before)
    )
    assert blur < 0.95 * blur_before
    design_tab.keyboard.press("Control+z")
    assert sensor_on(design_tab) == first


@pytest.mark.full
def test_misaligned_sensor_is_opened_reported_and_aligned(design_tab, tmp_path):
    pose = MirrorPose(decentre_x_mm=1.7, tilt_y_deg=-0.5)
    save_sensor(
        replace(om.load_sensor("paper-hyperboloidal"), mirror_pose=pose), tmp_path / "mine.toml"
    )
    before = plot_values(design_tab, "Image height")
    design_tab.set_input_files("#design-file", tmp_path / "mine.toml")
    design_tab.get_by_text("The mirror is misaligned").wait_for()
    assert "()" not in design_tab.locator(".desk").inner_text()  # no Python
    assert not np.array_equal(plot_values(design_tab, "Image height"), before)
    optimise = design_tab.get_by_role("button", name="Optimise")
    assert optimise.is_disabled()
    assert design_tab.get_by_text("requires an aligned mirror; this one is decentred").is_visible()
    enter_value(design_tab, "Decentre x", "2")
    assert sensor_on(design_tab).mirror_pose.decentre_x_mm == 2
    design_tab.get_by_role("button", name="Align the mirror").click()
    wait_for_response(design_tab)
    assert sensor_on(design_tab) == replace(
        om.load_sensor("paper-hyperboloidal"), name="design", notes=""
    )
    assert design_tab.get_by_text("The mirror is misaligned").is_hidden()
    assert optimise.is_enabled()


@pytest.mark.full
def test_unavailable_optimisations_are_not_offered(design_tab):
    design_tab.get_by_label("Start from a bundled sensor").select_option("folded-spherical")
    optimise = design_tab.get_by_role("button", name="Optimise")
    design_tab.get_by_text("this sensor has two").wait_for()
    assert optimise.is_disabled()
    assert design_tab.locator(f"#{optimise.get_attribute('aria-describedby')}").is_visible()
    design_tab.get_by_label("Start from a bundled sensor").select_option("paraboloid-telecentric")
    design_tab.get_by_text("this sensor has two").wait_for(state="hidden")
    assert optimise.is_enabled()


@pytest.mark.parametrize("width", [1280, pytest.param(360, marks=pytest.mark.full)])
def test_section_labels_do_not_overlap(width, design_tab):
    design_tab.set_viewport_size({"width": width, "height": 800})
    design_tab.wait_for_function(
        "(w) => Math.abs(document.querySelector('svg.section').getBoundingClientRect().width - "
        "document.querySelector('svg.section').viewBox.baseVal.width) < 1 && innerWidth === w",
        arg=width,
    )
    boxes = design_tab.evaluate(
        "[...document.querySelectorAll('svg.section')].map((s) => [...s.querySelectorAll('text')].map((t) => "
        "{ const b = t.getBBox(); return [b.x, b.y, b.x + b.width, b.y + b.height, t.textContent]; }))"
    )
    for section in boxes:
        for i, a in enumerate(section):
            for b in section[:i]:
                overlap = min(a[2], b[2]) - max(a[0], b[0]), min(a[3], b[3]) - max(a[1], b[1])
                assert min(overlap) < 2, (a, b)
    if width == 1280:
        assert {"105°", "120°", "135°"} <= {t[-1] for t in boxes[0]}


@pytest.mark.full
def test_designs_are_distinguishable_without_colour(design_tab):
    for value in ("12", "13"):
        design_tab.get_by_role("button", name="Pin", exact=True).click()
        enter_value(design_tab, "Focal length", value)
    design_tab.locator(".compare tbody tr").nth(2).wait_for()
    swatches = design_tab.locator(".swatch line")
    styles = [swatches.nth(i).get_attribute("stroke-dasharray") for i in range(3)]
    assert len(set(styles)) == 3
    dashes = design_tab.evaluate(
        "window.omnimirror.tabs.design.plotArea.charts[0].plot.series.slice(1)"
        ".map((s) => (s.dash ?? ['none']).join(' '))"
    )
    assert sorted(dashes) == sorted(styles)


def test_view_through_design_is_displayed(design_tab, monkeypatch):
    monkeypatch.setattr(
        _look_routes,
        "render_room",
        lambda look_sensor: encoded(pattern(look_sensor.camera.image_size), ".png"),
    )
    drag_slider(design_tab, "Radius", 0.05)
    sensor = sensor_on(design_tab)
    design_tab.get_by_role("button", name="Use as camera").click()
    design_tab.wait_for_function(
        "window.omnimirror.look.feed?.name === 'circle.png' && window.omnimirror.look.camera"
    )
    assert design_tab.locator("#view").is_visible()
    model = design_tab.evaluate("window.omnimirror.look.sensor.camera.model")
    assert model["rim_radius_px"] == pytest.approx(sensor.rim_radius_px)
    design_tab.get_by_role("button", name="Design", exact=True).click()
    assert sensor_on(design_tab) == sensor


def test_design_tab_reconnects_to_server(browser):
    with serving(Studio()) as address:
        page = browser.new_context(bypass_csp=True).new_page()
        page.add_init_script(WITHOUT_IMAGES)
        page.goto(f"{address}#tab=design")
        wait_for_plots(page)
    page.locator("#design").get_by_label("Radius", exact=True).fill("52")
    page.wait_for_function(
        "document.querySelector('#banner').textContent.includes('does not respond')"
    )
    before = plot_values(page, "Image height")
    with serving(Studio(), int(re.search(r":(\d+)/", address)[1])):
        page.wait_for_function("document.querySelector('#banner').hidden")
        wait_for_response(page)
        page.wait_for_function(
            "window.omnimirror.tabs.design.evaluations[0].summary.field_deg[1] < 130"
        )
        assert not np.array_equal(plot_values(page, "Image height"), before)
    page.context.close()


def test_design_tab_respects_content_security_policy(browser, server):
    context = browser.new_context()
    page = context.new_page()
    messages = []
    page.on("console", lambda m: messages.append(m.text))
    urls = []
    page.on("request", lambda r: urls.append(r.url))
    page.goto(server)
    page.get_by_text("Drop an image or video here").wait_for()
    assert not any(
        url.endswith("/design.js") for url in urls
    )  # the Design tab does not delay the first paint
    page.get_by_role("button", name="Design", exact=True).click()
    wait_for_plots(page)
    page.get_by_alt_text("Panorama of the room").wait_for()
    assert [text for text in messages if "Content Security Policy" in text] == []
    context.close()


@pytest.mark.parametrize("scheme", ["light", pytest.param("dark", marks=pytest.mark.full)])
def test_accessibility_of_design_tab(scheme, design_tab):
    if not AXE.exists():
        pytest.skip("axe-core is not here: npm install in web/")
    design_tab.emulate_media(color_scheme=scheme)
    design_tab.get_by_role("button", name="Pin", exact=True).click()
    design_tab.get_by_role("button", name="Add a requirement").click()
    enter_value(design_tab, "Rim radius", "60")
    design_tab.add_script_tag(path=AXE)
    violations = design_tab.evaluate(
        "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
    )
    serious = {
        v["id"]: v["nodes"][0]["html"] for v in violations if v["impact"] in ("serious", "critical")
    }
    assert serious == {}
