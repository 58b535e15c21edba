"""Stage: full-size views, the image next to them, several views at once, and phones."""

from __future__ import annotations

import json
import shlex

import numpy as np
import pytest

from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.io import read_image, write_image

from .browser import command, coordinates, drop, open_page, serving, set_state
from .images import pattern, python_view
from .test_addresses import placeholder_rooms, placeholder_server  # noqa: F401

TOLERANCE_PX = 0.02  # px
HALVES = """() => {
  const box = (id) => { const { x, y, width, height } = document.querySelector(id).getBoundingClientRect(); return [x, y, width, height]; };
  return { view: box("#view"), pane: box("#pane"), circle: box("#circle") };
}"""  # noqa: E501
CELLS = (
    "() => window.omnimirror.look.layout.places"
    ".map(({ left, top, width, height }) => [left, top, width, height])"
)
VIEW_SHARE = """() => {
  const { width, height, y } = document.querySelector("#view").getBoundingClientRect();
  return y >= 0 && y + height <= innerHeight + 1 ? width * height / innerWidth / innerHeight : 0;
}"""
INITIAL_STATE = {
    "mode": "panorama",
    "pan": 0,
    "tilt": 0,
    "zoom": 1,
    "fit": None,
    "beside": False,
    "views": "",
    "view": -1,
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("stage")
    write_image(folder / "picture.png", pattern((1024, 1024)))
    return folder


@pytest.fixture(scope="module")
def shared(browser, server, folder):
    """One page for all tests."""
    page = open_page(browser, server, 1000, 900, reduced_motion="reduce")
    drop(page, folder / "picture.png")
    page.wait_for_selector("#view:visible")
    yield page
    assert page.problems == []
    page.context.close()


@pytest.fixture
def page(shared):
    """The page in its initial state."""
    set_state(shared, all=False, **INITIAL_STATE)
    return shared


def state(page) -> dict:
    return page.evaluate("window.omnimirror.store.state")


def wait_for_views(page, states: int = 1) -> None:
    """Wait until the given number of views fill the available space."""
    page.wait_for_function(
        """(states) => new Promise((resolve) => requestAnimationFrame(() => requestAnimationFrame(() => {
          resolve(window.omnimirror.look.layout?.places.length === states);
        })))""",
        arg=states,
    )


WIDE, TALL = (150, 80), (60, 110)


@pytest.mark.full
@pytest.mark.parametrize(
    ("mode", "size"),
    [
        ("panorama", TALL),
        ("panorama", WIDE),
        ("planet", TALL),
        ("planet", WIDE),
        ("ground", TALL),
        ("ground", WIDE),
    ],
)
def test_view_that_fills_stage_matches_its_command(mode, size, page, folder):
    set_state(page, mode=mode, fit="fill", pan=35, tilt=-12, zoom=1.2)
    line = command(page, *size)
    assert f"--size {size[0]}x{size[1]}" in line
    result, expected = coordinates(page, *size), python_view(line, folder).coordinates(exact=True)
    is_finite = np.isfinite(result[..., 0]) & np.isfinite(expected[..., 0])
    assert is_finite.mean() > 0.6
    assert np.linalg.norm(result - expected, axis=-1)[is_finite].max() < TOLERANCE_PX


def test_panorama_is_complete_or_fills_stage(page):
    wait_for_views(page)
    boxes = page.evaluate(HALVES)
    assert boxes["view"][3] < 0.8 * boxes["pane"][3]
    page.get_by_role("button", name="Fill").click()
    page.wait_for_function("window.omnimirror.look.layout.places[0].state.fit === 'fill'")
    boxes = page.evaluate(HALVES)
    assert boxes["view"] == pytest.approx(boxes["pane"], abs=1)
    x, y, width, height = boxes["view"]
    page.mouse.move(x + width / 2, y + height / 2)
    page.mouse.down()
    page.mouse.move(x + width / 2 - 50, y + height / 2)
    page.mouse.up()
    span_deg = float(
        command(page, round(width), round(height)).split("--set view.span_deg=")[1].split()[0]
    )
    assert span_deg < 300
    assert state(page)["pan"] == pytest.approx(50 / width * span_deg, rel=0.01)
    set_state(page, mode="dome")
    fill = page.get_by_role("button", name="Fill")
    assert fill.get_attribute("aria-disabled") == "true"
    fill.click(force=True)
    page.get_by_role("status").filter(has_text="A dome is circular").wait_for()
    assert state(page)["fit"] == "fill"


def test_raw_image_next_to_view(page):
    page.get_by_role("button", name="Raw image").click()
    page.wait_for_function(
        "document.querySelector('#frame').contains(document.querySelector('#circle'))"
    )
    wait_for_views(page)
    boxes = page.evaluate(HALVES)
    assert boxes["circle"][2] > 0.9 * boxes["pane"][2] > 250
    assert boxes["circle"][0] + boxes["circle"][2] <= boxes["view"][0]
    x, y, width, height = boxes["circle"]
    page.mouse.dblclick(x + 0.5 * width + 0.3 * min(width, height), y + 0.5 * height)
    page.wait_for_function("window.omnimirror.store.state.pan !== 0")
    page.get_by_role("button", name="Raw image").click()
    page.wait_for_function(
        "document.querySelector('#raw-place').contains(document.querySelector('#circle'))"
    )


def test_stored_views_are_displayed_together(page, folder):
    page.get_by_role("button", name="Store view").click()
    set_state(page, mode="perspective", pan=40, tilt=-10, hfov=60)
    page.get_by_role("button", name="Store view").click()
    name = page.get_by_label("Name of this view")
    name.fill("Door")
    name.press("Enter")
    page.get_by_role("button", name="Panorama", exact=True).click()
    assert state(page)["mode"] == "panorama"
    page.get_by_role("button", name="All views").click()
    wait_for_views(page, 2)
    left, top = page.evaluate(HALVES)["view"][:2]
    cell = page.evaluate(CELLS)[1]
    middle = left + cell[0] + cell[2] / 2, top + cell[1] + cell[3] / 2
    page.mouse.move(*middle)
    page.mouse.down()
    page.mouse.move(middle[0] - 60, middle[1])
    page.mouse.up()
    view_state = state(page)
    assert view_state["mode"] == "perspective"
    views = json.loads(view_state["views"])
    assert views[0] == {"name": "Panorama"}
    assert views[1]["name"] == "Door"
    assert views[1]["pan"] == pytest.approx(view_state["pan"], abs=1e-3)
    assert view_state["pan"] > 42
    page.wait_for_function("location.hash.includes('all=true')")
    wait_for_views(page, 2)
    check_cell(page, folder, 1)
    page.get_by_role("button", name="Remove Door").click()
    assert json.loads(state(page)["views"]) == [{"name": "Panorama"}]
    page.get_by_role("button", name="All views").click()
    wait_for_views(page)


def check_cell(page, folder, index: int) -> None:
    """Check that one of several views has the coordinates of its command line."""
    script = """async (index) => {
      const { look } = window.omnimirror;
      const { left, top, view } = look.layout.places[index];
      const values = await look.renderer.coordinates(look.layout.view);
      const [column, row] = [left, top].map((at) => Math.round(at * devicePixelRatio));
      const at = (x, y) => { const i = 4 * ((row + y) * look.layout.view.width + column + x); return [...values.slice(i, i + 3)]; };
      const places = [0.1, 0.5, 0.9].flatMap((a) => [0.2, 0.7].map((b) => [Math.floor(a * view.width), Math.floor(b * view.height)]));
      return { line: look.commands().split("\\n")[index], places, found: places.map(([x, y]) => at(x, y)) };
    }"""  # noqa: E501
    result = page.evaluate(script, index)
    expected = python_view(result["line"], folder).coordinates(exact=True)
    count = 0
    for (x, y), (u, v, valid) in zip(result["places"], result["found"], strict=True):
        if valid < 0.5 or not np.isfinite(expected[y, x]).all():
            continue
        assert [u, v] == pytest.approx(expected[y, x], abs=TOLERANCE_PX)
        count += 1
    assert count >= 3


@pytest.mark.full
def test_all_views_without_stored_views(page):
    page.get_by_role("button", name="All views").click()
    wait_for_views(page, 5)
    names = [view["name"] for view in json.loads(state(page)["views"])]
    assert names == ["Panorama", "Ahead", "Right", "Behind", "Left"]
    cells = page.evaluate(CELLS)
    for i, a in enumerate(cells):
        for b in cells[:i]:
            overlap = [min(a[k] + a[k + 2], b[k] + b[k + 2]) - max(a[k], b[k]) for k in (0, 1)]
            assert min(overlap) <= 0, (a, b)
    page.get_by_role("button", name="All views").click()
    wait_for_views(page)


@pytest.fixture(scope="module")
def two(folder):
    """The address of a server with two images; the second has the size and colours of another
    sensor."""
    write_image(folder / "yard.png", 255 - pattern((1024, 1024))[::-1])
    with serving(
        Studio(Sources([str(folder / "picture.png"), str(folder / "yard.png")]))
    ) as address:
        yield address


CELL_COLOURS = """(index) => {
  const { look } = window.omnimirror, { left, top, view } = look.layout.places[index];
  const copy = new OffscreenCanvas(look.layout.view.width, look.layout.view.height).getContext("2d");
  copy.drawImage(look.drawn(), 0, 0);
  const dots = [left, top].map((at) => Math.round(at * devicePixelRatio));
  const places = [0.1, 0.3, 0.5, 0.7, 0.9].flatMap((a) => [0.2, 0.45, 0.7].map((b) => [Math.floor(a * view.width), Math.floor(b * view.height)]));
  const colours = places.map(([x, y]) => [...copy.getImageData(dots[0] + x, dots[1] + y, 1, 1).data]);
  return { line: look.commands().split("\\n")[index], places, colours };
}"""  # noqa: E501


def check_colours(page, folder, index: int) -> None:
    """Check that one of several views has the colours of its command line, from its own image."""
    result = page.evaluate(CELL_COLOURS, index)
    dewarper = python_view(result["line"], folder)
    expected = dewarper(read_image(folder / shlex.split(result["line"])[2]))
    count = 0
    for (x, y), (r, g, b, opaque) in zip(result["places"], result["colours"], strict=True):
        if opaque == 255 and expected[y, x].any():
            assert [r, g, b] == pytest.approx(expected[y, x][:3], abs=4)
            count += 1
    assert count >= 8


def test_all_sources_side_by_side_with_own_sensors(browser, two, folder):
    page = open_page(browser, f"{two}#source=server%3Asource", 1000, 900, reduced_motion="reduce")
    page.wait_for_function("window.omnimirror.look.feed?.name === 'picture.png'")
    page.get_by_role("button", name="All views").click()
    condition = (
        "window.omnimirror.look.layout?.places.length === 2 && "
        "window.omnimirror.look.layout.places.every((p) => p.cameraFeed)"
    )
    page.wait_for_function(condition)
    assert [view["name"] for view in json.loads(state(page)["views"])] == [
        "picture.png",
        "yard.png",
    ]
    left, top, width, height = page.evaluate(CELLS)[1]
    box = page.locator("#view").bounding_box()
    page.mouse.click(box["x"] + left + width / 2, box["y"] + top + height / 2)
    page.wait_for_function("window.omnimirror.look.feed.name === 'yard.png'")
    page.locator("#sensor").select_option("paper-hyperboloidal")
    page.wait_for_function(
        "window.omnimirror.look.sensor.camera.model.id === 'paper-hyperboloidal'"
    )
    set_state(page, mode="dome", pan=30.0)
    page.wait_for_function("JSON.parse(window.omnimirror.store.state.views)[1].mode === 'dome'")
    page.get_by_role(
        "button", name="picture.png"
    ).click()  # the first is moved, the other is unchanged
    page.wait_for_function("window.omnimirror.look.feed.name === 'picture.png'")
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'paper-spherical'")
    set_state(page, pan=-20.0)
    page.wait_for_function(condition)
    for index in (0, 1):
        check_colours(page, folder, index)
    lines = page.evaluate("window.omnimirror.look.commands()").split("\n")
    terms = ("yard.png", "paper-hyperboloidal", "--view dome")
    assert [[term in line for term in terms] for line in lines] == [[False] * 3, [True] * 3]
    write_image(folder / "own.png", pattern((1024, 1024))[:, ::-1])
    drop(page, folder / "own.png")  # replaces the first
    page.get_by_role("button", name="yard.png").click()
    page.wait_for_function("window.omnimirror.look.feed.name === 'yard.png'")
    page.wait_for_function(condition)
    check_colours(page, folder, 0)
    page.wait_for_function("location.hash.includes('yard.png')")
    page.reload()  # the link contains the complete state
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    page.wait_for_function(condition)
    check_colours(page, folder, 1)
    page.get_by_role("button", name="All views").click()
    wait_for_views(page)
    page.wait_for_function("window.omnimirror.look.additional.feeds.size === 0")
    assert page.problems == []
    page.context.close()


def test_unavailable_camera_is_reported_in_its_cell(browser, tmp_path):
    for name in ("here.png", "gone.png"):
        write_image(tmp_path / name, pattern((200, 200)))
    with serving(
        Studio(Sources([str(tmp_path / "here.png"), str(tmp_path / "gone.png")]))
    ) as address:
        (tmp_path / "gone.png").unlink()
        page = open_page(
            browser, f"{address}#source=server%3Asource", 800, 700, reduced_motion="reduce"
        )
        page.wait_for_function("window.omnimirror.look.feed?.name === 'here.png'")
        page.get_by_role("button", name="All views").click()
        page.wait_for_function(
            "/gone.png: .*(no|not|cannot)/.test(document.querySelector('#cells').textContent)"
        )
        assert page.evaluate("window.omnimirror.look.layout.places.map((p) => !!p.cameraFeed)") == [
            True,
            False,
        ]
        assert page.problems == []
        page.context.close()


@pytest.mark.parametrize(
    "size",
    [
        pytest.param((390, 844), id="upright", marks=pytest.mark.full),
        pytest.param((844, 390), id="across"),
    ],
)
def test_phone_displays_image_first(size, browser, placeholder_server):  # noqa: F811
    page = open_page(browser, placeholder_server, *size, has_touch=True)
    page.get_by_role("button", name="Try the demo room").tap()  # one of three
    page.wait_for_function("window.omnimirror.look.feed")
    page.wait_for_selector("#view:visible")
    page.wait_for_function(f"({VIEW_SHARE})() >= 0.6")
    assert page.evaluate("document.scrollingElement.scrollWidth") == size[0]
    for mode in ("Dome", "Perspective"):
        page.locator("#modes label").filter(has_text=mode).tap()
        page.wait_for_function(f"window.omnimirror.store.state.mode === {mode.lower()!r}")
    assert page.problems == []
    page.context.close()


def test_disabled_button_displays_reason(browser, server):
    page = open_page(browser, server, 1000, 700)
    assert page.locator("#snapshot").get_attribute("aria-disabled") == "true"
    page.evaluate("document.querySelector('#snapshot').click()")
    page.get_by_role("status").filter(has_text="Open an image first.").wait_for()
    page.context.close()


def test_buttons_of_a_fitted_circle_and_a_tilt_are_within_the_panel(shared):
    set_state(shared, **INITIAL_STATE, rim=[500, 520, 400], pitch=3)
    for name in ("Reset circle", "Reset tilt"):
        button = shared.get_by_role("button", name=name)
        box, panel = (
            place.bounding_box() for place in (button, button.locator("xpath=ancestor::section"))
        )
        assert panel["x"] < box["x"]
        assert box["x"] + box["width"] < panel["x"] + panel["width"]
