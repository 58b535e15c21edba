"""Accessibility check by axe of every state of the page: both themes, from phones to large screens."""

from __future__ import annotations

import pytest

from omnimirror.io import write_image

from .browser import drop, open_page, set_state
from .images import pattern
from .test_design_page import WITHOUT_IMAGES
from .test_page import AXE

SIZES = [(360, 740), (768, 1024), (1280, 800), (2560, 1440), (844, 390)]
AXE_VIOLATIONS = (
    "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
)


def show_start(page, folder) -> None:
    page.get_by_role("button", name="Try the demo room").wait_for()


def fit_by_hand(page, folder) -> None:
    drop(page, folder / "waves.png")
    page.get_by_text("Is this the edge of the mirror?").wait_for()
    page.wait_for_selector("#overlay .handle")


def select_mirror_type(page, folder) -> None:
    page.get_by_role("button", name="Done").click()
    page.locator("#ask").wait_for(state="visible")


def show_side_by_side(page, folder) -> None:
    page.locator("#ask").get_by_role("button", name="Cancel").click()
    set_state(page, beside=True, fit="whole")


def show_all_views(page, folder) -> None:
    set_state(page, beside=False, fit=None)
    page.get_by_role("button", name="All views").click()
    page.wait_for_function("window.omnimirror.look.layout.places.length === 5")


def measure_points(page, folder) -> None:
    page.locator("#measure").click()
    for _ in range(2):
        page.locator("#measure-add").click()
    page.locator("#measure-plane").select_option("wall")
    page.locator("#measured", has_text="Angle").wait_for()


def drag_horizon(page, folder) -> None:
    page.locator("#measure-done").click()
    page.locator("#level").click()
    page.wait_for_selector("#horizon:visible")


def open_image_export(page, folder) -> None:
    page.locator("#export summary").click()
    page.get_by_role("button", name="Light probe as HDR").wait_for()


def show_help(page, folder) -> None:
    page.locator("aside .glossary summary").click()
    page.get_by_role("button", name="Project").click()
    page.get_by_role("button", name="Save project").wait_for()


def open_design(page, folder) -> None:
    page.keyboard.press("Escape")
    set_state(page, tab="design")
    page.wait_for_selector("#design .compare tbody td")


def compare_designs(page, folder) -> None:
    page.get_by_role("button", name="Pin", exact=True).click()
    page.locator("#design").get_by_label("F-number", exact=True).fill("5.6")
    page.keyboard.press("Enter")
    page.locator(".compare tbody tr").nth(1).wait_for()
    page.locator(".groups .difference").click()


def export_design(page, folder) -> None:
    page.get_by_role("button", name="Export…").click()
    page.get_by_role("dialog", name="Export").wait_for()


def open_calibration(page, folder) -> None:
    page.keyboard.press("Escape")
    set_state(page, tab="calibrate")
    page.wait_for_selector("#calibrate .desk")


STATES = (
    show_start,
    fit_by_hand,
    select_mirror_type,
    show_side_by_side,
    show_all_views,
    measure_points,
    drag_horizon,
    open_image_export,
    show_help,
    open_design,
    compare_designs,
    export_design,
    open_calibration,
)


@pytest.mark.full
@pytest.mark.parametrize("size", SIZES, ids=[str(w) for w, _ in SIZES])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_of_all_states(scheme, size, browser, server, tmp_path):
    if not AXE.exists():
        pytest.skip("axe-core is not here: `npm ci` in web/, or `make node`, fetches it")
    write_image(tmp_path / "waves.png", pattern((500, 400)))
    page = open_page(
        browser,
        server,
        *size,
        asks=True,
        color_scheme=scheme,
        reduced_motion="reduce",
        device_scale_factor=1,
    )
    page.evaluate(WITHOUT_IMAGES)
    page.add_script_tag(path=AXE)
    violations = {}
    for state in STATES:
        state(page, tmp_path)
        for v in page.evaluate(AXE_VIOLATIONS):
            violations[state.__name__, v["id"]] = [node["html"][:160] for node in v["nodes"][:4]]
        wide = page.evaluate("document.scrollingElement.scrollWidth")
        if wide > size[0]:
            violations[state.__name__, "sticks out"] = [str(wide)]
    assert violations == {}
    assert page.problems == []
    page.context.close()
