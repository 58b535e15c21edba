"""Accessibility check by axe of every state of the page: both themes, from phones to large screens."""

from __future__ import annotations

import pytest

from omnimirror.io import write_image

from .browser import drop, look, open_page
from .pictures import pattern
from .test_bench_page import WITHOUT_PICTURES
from .test_page import AXE

SIZES = [(360, 740), (768, 1024), (1280, 800), (2560, 1440), (844, 390)]
ASK = "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"


def empty(page, folder) -> None:
    page.get_by_role("button", name="Try the demo room").wait_for()


def asked(page, folder) -> None:
    drop(page, folder / "waves.png")
    page.locator("#ask").wait_for(state="visible")


def by_hand(page, folder) -> None:
    page.get_by_role("button", name="Fit it manually").click()
    page.wait_for_selector("#overlay .handle")


def beside(page, folder) -> None:
    page.get_by_role("button", name="Fit circle").click()
    look(page, beside=True, fit="whole")


def together(page, folder) -> None:
    look(page, beside=False, fit=None)
    page.get_by_role("button", name="All views").click()
    page.wait_for_function("window.omnimirror.look.layout.places.length === 5")


def explained(page, folder) -> None:
    page.locator("aside .glossary summary").click()
    page.get_by_role("button", name="Project").click()
    page.get_by_role("button", name="Save project").wait_for()


def designed(page, folder) -> None:
    page.keyboard.press("Escape")
    look(page, tab="design")
    page.wait_for_selector("#design .compare tbody td")


def compared(page, folder) -> None:
    page.get_by_role("button", name="Pin", exact=True).click()
    page.locator("#design").get_by_label("F-number", exact=True).fill("5.6")
    page.keyboard.press("Enter")
    page.locator(".compare tbody tr").nth(1).wait_for()
    page.locator(".groups .difference").click()


def calibrated(page, folder) -> None:
    look(page, tab="calibrate")
    page.wait_for_selector("#calibrate .desk")


STATES = (empty, asked, by_hand, beside, together, explained, designed, compared, calibrated)


@pytest.mark.full
@pytest.mark.parametrize("size", SIZES, ids=[str(w) for w, _ in SIZES])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_accessibility_of_all_states(scheme, size, browser, server, tmp_path):
    if not AXE.exists():
        pytest.skip("axe-core is not here: `npm ci` in web/, or `make node`, fetches it")
    write_image(tmp_path / "waves.png", pattern((500, 400)))
    page = open_page(
        browser, server, *size, color_scheme=scheme, reduced_motion="reduce", device_scale_factor=1
    )
    page.evaluate(WITHOUT_PICTURES)
    page.add_script_tag(path=AXE)
    serious = {}
    for state in STATES:
        state(page, tmp_path)
        for v in page.evaluate(ASK):
            if v["impact"] in ("serious", "critical"):
                serious[state.__name__, v["id"]] = [node["html"][:160] for node in v["nodes"][:4]]
        wide = page.evaluate("document.scrollingElement.scrollWidth")
        if wide > size[0]:
            serious[state.__name__, "sticks out"] = [str(wide)]
    assert serious == {}
    assert page.problems == []
    page.context.close()
