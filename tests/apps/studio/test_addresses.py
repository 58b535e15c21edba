"""Addresses: state restored by links, reload, Back and a second tab, and responses to invalid
addresses."""

from __future__ import annotations

import json
from urllib.parse import quote

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _look_routes
from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio._uploads import encoded
from omnimirror.io import write_image

from .browser import drop, open_page, serving, set_state
from .images import pattern
from .test_design_page import CURRENT_DESIGN, WITHOUT_IMAGES, enter_value, wait_for_response
from .test_design_page import wait_for_plots as wait_for_plots

SPHERE = om.load_sensor("paper-spherical")


def state(page) -> dict:
    return page.evaluate("window.omnimirror.store.state")


def set_address(page, part: str) -> None:
    """Change the address of the open page."""
    page.evaluate("(part) => { location.hash = part; }", part)


def banner(page) -> str:
    page.wait_for_selector("#banner:visible")
    return page.locator("#banner").inner_text()


@pytest.fixture(scope="module")
def images(tmp_path_factory):
    """Two different images of the same size."""
    folder = tmp_path_factory.mktemp("pictures")
    for name, is_rotated in (("one.png", False), ("two.png", True)):
        image = pattern((300, 300))
        write_image(folder / name, image[::-1].copy() if is_rotated else image)
    return folder


@pytest.fixture
def page(browser, server):
    page = open_page(browser, server)
    yield page
    assert page.problems == []
    page.context.close()


@pytest.fixture
def placeholder_rooms(monkeypatch) -> None:
    """Replace room rendering by an immediate placeholder; tests check the selection, not the
    content."""
    monkeypatch.setattr(
        _look_routes,
        "render_room",
        lambda sensor: encoded(pattern(sensor.camera.image_size), ".png"),
    )


@pytest.fixture
def placeholder_server(placeholder_rooms):
    """A server with such rooms only."""
    with serving(Studio()) as address:
        yield address


def design_tab_at(browser, address: str, context=None):
    """Return the page with the Design tab at an address, and its errors."""
    context = context or browser.new_context(
        viewport={"width": 1000, "height": 700}, bypass_csp=True
    )
    context.add_init_script(WITHOUT_IMAGES)
    page = context.new_page()
    page.problems = []
    page.on("pageerror", lambda e: page.problems.append(str(e)))
    page.goto(address)
    wait_for_plots(page)
    return page


# -- design_tab
# -------------------------------------------------------------------------------------------

SPHERE_TABLE = {"kind": "sphere", "radius_mm": 49.9, "rim_radius_mm": 43.9}


@pytest.mark.parametrize(
    ("design", "message"),
    [
        pytest.param('{"tables":{}}', "[mirror]", marks=pytest.mark.full),
        pytest.param(
            '{"tables":{"mirror":{"kind":"moon"},"lens":{},"imager":{}}}',
            "mirror.kind",
            marks=pytest.mark.full,
        ),
        pytest.param(
            json.dumps(
                {"tables": {"mirror": {**SPHERE_TABLE, "radius_mm": "w"}, "lens": {}, "imager": {}}}
            ),
            "mirror.radius_mm",
            marks=pytest.mark.full,
        ),
        ('{"tables":{"mirror":', "the link is incomplete"),
    ],
)
def test_invalid_design_in_address_is_reported_and_tab_works(design, message, browser, server):
    page = design_tab_at(browser, f"{server}#tab=design&design={quote(design)}")
    text = banner(page)
    assert message in text
    assert "server" not in text
    for _ in range(2):
        page.get_by_role("button", name="Look", exact=True).click()
        page.get_by_role("button", name="Design", exact=True).click()
    assert page.get_by_role("button", name="Undo", exact=True).count() == 1
    assert page.locator("#design > aside").count() == 1
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.name") == "paper-spherical"
    page.wait_for_function(
        "location.hash.includes('radius_mm')"
    )  # the address corresponds to the displayed design
    assert page.problems == []
    page.context.close()


def test_links_replace_design_unless_invalid(browser, server):
    page = design_tab_at(browser, f"{server}#tab=design")
    design = page.evaluate(f"JSON.parse(JSON.stringify({CURRENT_DESIGN}))")
    design["tables"]["mirror"]["radius_mm"] = 55.0
    set_address(page, f"tab=design&design={quote(json.dumps(design))}")
    page.wait_for_function(f"{CURRENT_DESIGN}.tables.mirror.radius_mm === 55")
    set_address(page, "tab=design&design=%7B%7D")
    assert "must contain the tables of a sensor" in banner(page)
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.mirror.radius_mm") == 55
    page.get_by_role("button", name="Undo", exact=True).click()
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.mirror.radius_mm") == SPHERE.mirror.radius_mm
    assert page.problems == []
    page.context.close()


def test_immediate_reload_keeps_change_and_undo_history(browser, server):
    page = design_tab_at(browser, f"{server}#tab=design")
    page.wait_for_function("location.hash.includes('design')")
    page.get_by_label("Focal length", exact=True).fill("12.5")
    page.evaluate("document.activeElement.blur(); location.reload()")
    page.wait_for_function("() => window.omnimirror?.tabs.design?.evaluations?.[0]")
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.lens.focal_length_mm") == 12.5
    page.get_by_role("button", name="Undo", exact=True).click()
    assert (
        page.evaluate(f"{CURRENT_DESIGN}.tables.lens.focal_length_mm")
        == SPHERE.lens.focal_length_mm
    )
    page.get_by_label("Focal length", exact=True).fill("12.75")  # without pressing a key
    page.reload()
    page.wait_for_function("() => window.omnimirror?.tabs.design?.evaluations?.[0]")
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.lens.focal_length_mm") == 12.75
    page.context.close()


@pytest.mark.full
def test_two_tabs_have_independent_designs_and_undo_histories(browser, server):
    first = design_tab_at(browser, f"{server}#tab=design")
    enter_value(first, "F-number", "5.6")
    second = design_tab_at(browser, f"{server}#tab=design", first.context)
    wait_for_response(second)
    enter_value(second, "F-number", "8")
    first.reload()
    wait_for_plots(first)
    assert first.evaluate(f"{CURRENT_DESIGN}.tables.lens.f_number") == 5.6
    first.get_by_role("button", name="Undo", exact=True).click()
    assert first.evaluate(f"{CURRENT_DESIGN}.tables.lens.f_number") == 4
    assert second.evaluate(f"{CURRENT_DESIGN}.tables.lens.f_number") == 8
    first.context.close()


@pytest.mark.full
def test_request_that_closes_connection_is_repeated_a_limited_number_of_times(browser, server):
    page = design_tab_at(browser, f"{server}#tab=design")
    count = page.evaluate("""() => new Promise((resolve) => {
      const { design } = window.omnimirror.tabs;
      let count = 0;
      const own = WebSocket.prototype.send;
      WebSocket.prototype.send = function (text) { count += text.includes('"slot":0'); own.call(this, text); };
      const answered = design.evaluator.onEvaluation;
      design.evaluator.onEvaluation = (found) => { answered(found); if (found.error) resolve(count); };
      design.evaluator.ask(0, { tables: "no tables" });
    })""")
    assert count == 1  # rejected by the server
    assert "cannot evaluate this design" in page.locator(".trouble").inner_text()
    enter_value(page, "F-number", "5.6")
    page.wait_for_function("document.querySelector('.trouble').hidden")
    assert page.locator("#banner").is_hidden()
    page.context.close()


# -- view
# --------------------------------------------------------------------------------------------


def test_back_and_forward_restore_tabs_views_and_images(page, images):
    drop(page, images / "one.png")
    set_state(page, pan=30)
    set_state(page, mode="dome")
    page.get_by_role("button", name="Design", exact=True).click()
    assert page.locator("#design").is_visible()
    page.go_back()
    page.wait_for_function("window.omnimirror.store.state.tab === 'look'")
    assert state(page)["mode"] == "dome"
    page.go_back()
    page.wait_for_function("window.omnimirror.store.state.mode === 'panorama'")
    assert state(page)["pan"] == 30
    page.go_back()
    page.wait_for_function("window.omnimirror.look.feed === null")
    assert page.get_by_text("Drop an image or video here").is_visible()
    page.go_forward()
    page.wait_for_function("window.omnimirror.look.feed?.name === 'one.png'")
    page.go_forward()
    page.wait_for_function("window.omnimirror.store.state.mode === 'dome'")


@pytest.mark.full
def test_link_displays_its_own_image_only(page, browser, server, images):
    drop(page, images / "one.png")
    set_state(page, mode="perspective", rim=[150.0, 140.0, 120.0])
    page.wait_for_function("location.hash.includes('rim')")
    link = page.evaluate("location.href")
    drop(page, images / "two.png")
    new_page = page.context.new_page()
    new_page.goto(link)
    new_page.wait_for_function("window.omnimirror?.look.feed?.name === 'one.png'")
    new_page.close()

    linked_page = open_page(browser, link)
    assert linked_page.get_by_text("Drop one.png here").is_visible()
    assert linked_page.get_by_text("links contain the view, not the image").is_visible()
    assert linked_page.evaluate("window.omnimirror.look.feed") is None
    drop(linked_page, images / "one.png")
    assert state(linked_page)["rim"] == [150, 140, 120]  # the same image, with the view of the link
    linked_page.context.close()

    other_page = open_page(browser, link)
    drop(other_page, images / "two.png")
    assert state(other_page)["rim"] is None
    other_page.context.close()


@pytest.mark.long
def test_second_link_in_same_page_is_opened(browser, placeholder_server, images):
    page = open_page(browser, placeholder_server)
    drop(page, images / "one.png")
    page.wait_for_function("location.hash.includes('kept')")
    set_address(page, "source=room&sensor=folded-spherical&mode=planet")
    page.wait_for_function("window.omnimirror.look.feed?.name === 'circle.png'")
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'folded-spherical'")
    assert state(page)["mode"] == "planet"
    assert page.problems == []
    page.context.close()


def test_invalid_parts_of_address_are_reported_and_rest_is_displayed(browser, server):
    page = open_page(browser, f"{server}#mode=cube&forward=1e9&tilt=high&pan=20&rim=1,2")
    text = banner(page)
    for entry in (
        "mode must be one of panorama, perspective, dome, planet, ground, mosaic; got cube",
        "forward must be between -360 and 360; got 1e9",
        "tilt must be between -90 and 90; got high",
        "rim must be u,v,radius in px; got 1,2",
    ):
        assert entry in text
    assert "422" not in text
    assert (state(page)["pan"], state(page)["mode"]) == (20, "panorama")
    page.get_by_role("button", name="Close").click()
    assert page.locator("#banner").is_hidden()
    set_address(page, "sensor=nope")
    assert "unknown camera 'nope'" in banner(page)
    page.wait_for_function("window.omnimirror.store.state.sensor === 'paper-spherical'")
    set_address(page, "source=server:nope")
    page.wait_for_function(
        "document.querySelector('#banner').textContent.includes('not available on this server')"
    )
    assert "does not respond" not in page.locator("#banner").inner_text()
    set_address(page, "source=kept")
    assert page.get_by_text("an unnamed image").is_visible()
    assert page.problems == []
    page.context.close()


def test_page_with_unknown_sensor_works(browser, server):
    page = open_page(browser, f"{server}#sensor=file:0123456789abcdef")
    assert "is not stored in this browser" in banner(page)
    assert page.evaluate("window.omnimirror.look.sensor.camera.model.id") == "paper-spherical"
    assert page.locator("#sensor").input_value() == "paper-spherical"
    page.context.close()


@pytest.mark.full
def test_link_to_sensor_and_view_works_without_server(browser, images):
    with serving(Studio()) as address:
        page = open_page(browser, address)
        drop(page, images / "one.png")
        view_names = []
        page.route("**/api/camera?*", lambda route: view_names.append(route))
        page.locator("#sensor").select_option("paper-hyperboloidal")
        while not view_names:
            page.wait_for_timeout(20)
        names = "[document.querySelector('#sensor').value, window.omnimirror.look.sensor.camera.model.id]"
        assert page.evaluate(names) == ["paper-spherical"] * 2  # its tables have not arrived
        assert (
            "paper-spherical" in page.locator("#sensor-words").inner_text()
            or "sphere" in page.content()
        )
        view_names[0].continue_()
        page.unroute("**/api/camera?*")
        page.wait_for_function("window.omnimirror.store.state.sensor === 'paper-hyperboloidal'")
        assert page.evaluate(names) == ["paper-hyperboloidal"] * 2
    page.locator("#sensor").select_option("paper-equidistant")  # not loaded before
    assert "does not respond" in banner(page)
    assert page.evaluate(names) == ["paper-hyperboloidal"] * 2
    assert state(page)["sensor"] == "paper-hyperboloidal"
    page.locator("#looks label").filter(has_text="down").click()
    page.wait_for_function(
        "document.querySelector('#looks input[value=up]').checked"
    )  # still oriented upwards
    page.context.close()


@pytest.mark.full
def test_link_restores_demo_room_of_sensor(browser, placeholder_server):
    page = open_page(browser, f"{placeholder_server}#source=room")
    page.wait_for_function("window.omnimirror.look.feed")
    same = """() => {
      const { feed, sensor } = window.omnimirror.look;
      window.pairs ??= new Set();
      window.pairs.add(`${sensor.camera.model.id} ${feed.width}`);
      requestAnimationFrame(window.watch);
    }"""
    page.evaluate(f"window.watch = {same}; window.watch()")
    page.locator("#sensor").select_option("folded-hyperboloidal")
    page.wait_for_function("window.omnimirror.store.state.sensor === 'folded-hyperboloidal'")
    width = om.load_sensor("folded-hyperboloidal").image_size[0]
    assert set(page.evaluate("[...window.pairs]")) <= {
        "paper-spherical 1024",
        f"folded-hyperboloidal {width}",
    }
    assert page.evaluate("window.omnimirror.look.sources.shown") == "room of folded-hyperboloidal"
    page.context.close()


def test_first_page_on_phone_shows_buttons(browser, server):
    page = open_page(browser, server, 360, 740, device_scale_factor=1)
    for name in ("Try the demo room", "Choose a file…"):
        button = page.get_by_role("button", name=name)
        box = button.bounding_box()
        assert box["y"] + box["height"] <= 740
        under = "([x, y]) => document.elementFromPoint(x, y).textContent"
        assert (
            page.evaluate(under, [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2])
            == name
        )
    page.context.close()


@pytest.mark.full
def test_images_differing_in_one_pixel_have_different_identifiers(page, tmp_path):
    image = np.full((64, 64, 3), 90, np.uint8)
    identifiers = set()
    for i in range(3):
        image[i, 5] = 91
        cv2.imwrite(str(tmp_path / "p.bmp"), image)
        drop(page, tmp_path / "p.bmp")
        page.wait_for_function(
            "(old) => !old.includes(window.omnimirror.store.state.source)", arg=[*identifiers, ""]
        )
        identifiers.add(state(page)["source"])
    assert len(identifiers) == 3
