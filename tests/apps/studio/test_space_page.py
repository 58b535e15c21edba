"""3-D view of the Design tab: loading, drawing, readings, and control by mouse, touch and keys."""

from __future__ import annotations

import base64
import re

import numpy as np
import pytest

import omnimirror as om

from .browser import BASE64, COARSE, TIMEOUT_MS
from .test_design_page import PAGE, WITHOUT_IMAGES, enter_value, wait_for_plots, wait_for_response
from .test_page import AXE

VIEW = "window.omnimirror.tabs.design.plotArea.space.view"
PIXELS = f"""() => {{
  const {{ canvas }} = {VIEW};
  {VIEW}.draw();
  const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
  copy.drawImage(canvas, 0, 0);
  const {{ data }} = copy.getImageData(0, 0, canvas.width, canvas.height);
  return {{ size: [canvas.width, canvas.height], values: ({BASE64})(data) }};
}}"""
ORBIT = f"JSON.stringify({VIEW}.orbit)"
MAX_TOTAL = 300_000  # bytes, compressed, without the 3-D view


@pytest.fixture
def design_tab(browser, server):
    viewport = {"width": 1280, "height": 900}
    context = browser.new_context(viewport=viewport, bypass_csp=True, has_touch=True, **COARSE)
    context.add_init_script(WITHOUT_IMAGES)
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    page.problems, page.fetched = [], []
    page.on("pageerror", lambda e: page.problems.append(str(e)))
    page.on("request", lambda r: page.fetched.append(r.url))
    page.goto(f"{server}#tab=design")
    wait_for_plots(page)
    yield page
    context.close()
    assert page.problems == []


def open_space_view(page) -> None:
    page.locator(".groups label").filter(has_text="3-D view").click()
    page.wait_for_function(f"{VIEW}?.frames > 0 && {VIEW}.rays.length > 0")
    wait_for_response(page)


def pixels(page) -> np.ndarray:
    result = page.evaluate(PIXELS)
    width, height = result["size"]
    return (
        np.frombuffer(base64.b64decode(result["values"]), np.uint8)
        .reshape(height, width, 4)[..., :3]
        .astype(int)
    )


def screen_position(page, node: str) -> tuple[float, float]:
    """Return the screen position of a ray node, px from the corner of the view; `node` is its
    expression."""
    return page.evaluate(
        f"""() => {{
          const view = {VIEW}, place = {node}, o = view.orbit;
          const level = Math.cos(o.above);
          const back = [level * Math.cos(o.around), level * Math.sin(o.around), Math.sin(o.above)];
          const right = [-Math.sin(o.around), Math.cos(o.around), 0];
          const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
          const up = [-back[2] * right[1], back[2] * right[0], back[0] * right[1] - back[1] * right[0]];
          const from = place.map((c, i) => c - o.target[i]);
          const {{ clientWidth: w, clientHeight: h }} = view.canvas;
          const zoom = h / 2 / Math.tan((17 * Math.PI) / 180) / (o.distance - dot(from, back));
          return [w / 2 + zoom * dot(from, right), h / 2 - zoom * dot(from, up)];
        }}"""
    )


def test_3d_view_is_loaded_on_demand_and_stays_open(design_tab):
    assert not any("space" in url for url in design_tab.fetched)
    open_space_view(design_tab)
    assert sum(url.endswith("/space.js") for url in design_tab.fetched) == 1
    design_tab.locator(
        '.space canvas[aria-label*="mirror, body, lens"][aria-label*="from 0° to 135.0°"]'
    ).wait_for()
    design_tab.reload()
    wait_for_plots(design_tab)
    design_tab.wait_for_function(f"{VIEW}?.frames > 0 && {VIEW}.rays.length > 0")
    design_tab.locator(".groups label").filter(has_text="3-D view").click()
    assert design_tab.locator(".space").is_hidden()


@pytest.mark.full
def test_colours_of_parts_rays_and_ground(design_tab):
    design_tab.emulate_media(color_scheme="light")
    open_space_view(design_tab)
    light = pixels(design_tab)
    np.testing.assert_array_equal(light[2, 2], [255, 255, 255])
    x, y = screen_position(
        design_tab, f"{VIEW}.rays[0].nodes[1].map((c, i) => c + (i === 2 ? 9 : 0))"
    )  # above the vertex
    scale = COARSE["device_scale_factor"]
    mirror = light[round(scale * y), round(scale * x)]
    assert np.ptp(mirror) < 40  # grey
    assert mirror.max() < 240
    green = (light[..., 1] > light[..., 0] + 40) & (light[..., 1] > light[..., 2])
    assert green.sum() > 1000 * scale**2  # rays
    design_tab.emulate_media(color_scheme="dark")
    design_tab.wait_for_function(
        "getComputedStyle(document.documentElement).getPropertyValue('--panel').includes('#1c1f20')"
    )
    np.testing.assert_array_equal(pixels(design_tab)[2, 2], [0x1C, 0x1F, 0x20])


def test_selected_ray_is_marked_in_all_plots(design_tab):
    open_space_view(design_tab)
    index = design_tab.evaluate(f"{VIEW}.rays.findIndex((r) => Math.abs(r.omega - 75) < 1e-3)")
    x, y = screen_position(
        design_tab,
        f"{VIEW}.rays[{index}].nodes[1].map((c, i) => c + 0.012 * ({VIEW}.rays[{index}].nodes[2][i] - c))",
    )
    design_tab.locator(".space canvas").click(position={"x": x, "y": y})
    summary = design_tab.locator(".space output").inner_text()
    sensor = om.load_sensor("paper-spherical")
    e = om.evaluate(sensor, [75.0])
    assert summary.startswith("Field angle 75.0°")
    match = re.search(
        r"x (\S+), y (\S+), z (\S+) mm · angle of incidence (\S+)° · pixel (\S+), (\S+)", summary
    )
    mx, my, mz, incidence, u, v = (float(text.replace("−", "-")) for text in match.groups())
    assert np.hypot(mx, my) == pytest.approx(e.x_mm[0], abs=0.01)
    assert mz == pytest.approx(e.z_mm[0], abs=0.01)
    assert incidence == pytest.approx(
        (75 + e.theta_deg[0]) / 2, abs=0.01
    )  # about the normal, half of the total
    assert np.hypot(u - 511.5, v - 511.5) == pytest.approx(e.h_px[0], abs=0.1)
    assert design_tab.evaluate(
        "window.omnimirror.tabs.design.plotArea.cursor.omega"
    ) == pytest.approx(75, abs=1e-3)
    design_tab.locator(".space canvas").click(position={"x": 3, "y": 3})
    assert design_tab.locator(".space output").inner_text().startswith("Click a ray")


@pytest.mark.full
def test_3d_view_follows_sliders_and_keeps_selected_ray(design_tab):
    open_space_view(design_tab)
    design_tab.get_by_role("button", name="Ray ›").click()
    design_tab.get_by_role("button", name="Ray ›").click()
    before, orbit = design_tab.locator(".space output").inner_text(), design_tab.evaluate(ORBIT)
    lens = design_tab.evaluate(f"{VIEW}.rays[0].nodes[0][2]")
    enter_value(design_tab, "Distance", "200")
    design_tab.wait_for_function(f"{VIEW}.rays[0].nodes[0][2] !== {lens}")
    assert design_tab.evaluate(f"{VIEW}.rays[0].nodes[0][2]") == pytest.approx(-200)
    assert design_tab.locator(".space output").inner_text() != before
    assert design_tab.evaluate(ORBIT) == orbit
    upright = design_tab.evaluate(f"{VIEW}.rays.length")
    design_tab.get_by_label("All azimuths").check()
    assert design_tab.evaluate(f"{VIEW}.rays.length") == 6 * upright
    design_tab.get_by_label("Start from a bundled sensor").select_option("folded-hyperboloidal")
    design_tab.wait_for_function(f"{VIEW}.rays[0].nodes.length === 4")  # via the second mirror
    assert design_tab.evaluate(ORBIT) != orbit  # new default camera


def test_3d_view_responds_to_mouse_touch_and_keys(design_tab):
    open_space_view(design_tab)
    canvas = design_tab.locator(".space canvas")
    canvas.scroll_into_view_if_needed()
    box = canvas.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    orbit = lambda: design_tab.evaluate(f"{VIEW}.orbit")  # noqa: E731
    first = orbit()

    def drag(offset: tuple[float, float]) -> None:
        design_tab.mouse.move(x, y)
        design_tab.mouse.down()
        design_tab.mouse.move(x + offset[0], y + offset[1], steps=4)
        design_tab.mouse.up()

    drag((60, 30))
    orbit_after_drag = orbit()
    assert orbit_after_drag["around"] < first["around"]
    assert orbit_after_drag["above"] > first["above"]
    assert orbit_after_drag["target"] == first["target"]
    design_tab.keyboard.down("Shift")
    drag((50, 0))
    design_tab.keyboard.up("Shift")
    orbit_after_pan = orbit()
    assert orbit_after_pan["target"] != first["target"]
    assert orbit_after_pan["around"] == orbit_after_drag["around"]
    canvas.focus()
    design_tab.mouse.move(x, y)
    design_tab.mouse.wheel(0, -300)
    design_tab.wait_for_function(f"{VIEW}.orbit.distance < {orbit_after_pan['distance']}")
    design_tab.keyboard.press("Home")
    fitted = orbit()["distance"]
    for key, changes in (
        ("ArrowLeft", "around"),
        ("ArrowUp", "above"),
        ("+", "distance"),
        ("Shift+ArrowRight", "target"),
    ):
        before = orbit()
        design_tab.keyboard.press(key)
        assert orbit()[changes] != before[changes], key
    design_tab.keyboard.press("PageDown")
    assert design_tab.locator(".space output").inner_text().startswith("Field angle")
    design_tab.keyboard.press("Home")
    assert orbit()["distance"] == pytest.approx(fitted)
    touch = """([dx, distance]) => {
      const canvas = document.querySelector(".space canvas"), box = canvas.getBoundingClientRect();
      const send = (type, id, x) => canvas.dispatchEvent(new PointerEvent(type, { pointerId: id, pointerType: "touch",
        clientX: box.left + x, clientY: box.top + 100, buttons: 1 }));
      canvas.setPointerCapture = () => {};
      send("pointerdown", 1, 100); send("pointerdown", 2, 200);
      send("pointermove", 2, 300); send("pointerup", 1, 100); send("pointerup", 2, 300);
    }"""
    design_tab.evaluate(touch, [0, 0])
    assert orbit()["distance"] == pytest.approx(fitted / 2)


@pytest.mark.full
@pytest.mark.parametrize(("width", "scheme"), [(1280, "light"), (360, "dark")])
def test_accessibility_of_3d_view(width, scheme, design_tab):
    if not AXE.exists():
        pytest.skip("axe-core is not here: `npm ci` in web/, or `make node`, fetches it")
    design_tab.set_viewport_size({"width": width, "height": 800})
    design_tab.emulate_media(color_scheme=scheme)
    open_space_view(design_tab)
    design_tab.get_by_role("button", name="Ray ›").click()
    design_tab.add_script_tag(path=AXE)
    violations = design_tab.evaluate(
        "axe.run('.space', { rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
    )
    assert [v["id"] for v in violations if v["impact"] in ("serious", "critical")] == []
    assert design_tab.evaluate("document.scrollingElement.scrollWidth") <= width


def test_missing_webgl2_is_reported(browser, server):
    context = browser.new_context(bypass_csp=True)
    context.add_init_script(WITHOUT_IMAGES + "HTMLCanvasElement.prototype.getContext = () => null;")
    page = context.new_page()
    page.goto(f"{server}#tab=design")
    wait_for_plots(page)
    page.locator(".groups label").filter(has_text="3-D view").click()
    page.get_by_text(
        "The 3-D view requires WebGL2, which this browser does not support."
    ).wait_for()
    context.close()


def test_page_loads_no_3d_code_by_default():
    import gzip

    parts = [path for path in PAGE.iterdir() if path.name != "space.js"]
    assert sum(len(gzip.compress(path.read_bytes(), 9)) for path in parts) < MAX_TOTAL
