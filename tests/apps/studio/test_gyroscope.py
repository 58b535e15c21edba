"""View rotation by the orientation sensor of a phone, with simulated events."""

from __future__ import annotations

import pytest

from .browser import drop, open_page
from .test_stage import folder  # noqa: F401

PAN_TILT = "[window.omnimirror.store.state.pan, window.omnimirror.store.state.tilt]"
DISPATCH_ORIENTATION = (
    "(how) => dispatchEvent(new DeviceOrientationEvent('deviceorientation', how))"
)
PRESS_BUTTON = f"""async (how) => {{
  document.querySelector("#gyroscope").click();
  await new Promise((done) => setTimeout(done));
  ({DISPATCH_ORIENTATION})(how);
}}"""
COUNT_REQUESTS = """
window.asked = 0;
window.answer = 'granted';
DeviceOrientationEvent.requestPermission = () => { window.asked++; return Promise.resolve(window.answer); };
"""
NAME = "Follow device"


def rotate_phone(page, alpha: float, beta: float, gamma: float) -> list[float]:
    """Return pan and tilt after an orientation event."""
    page.evaluate(DISPATCH_ORIENTATION, {"alpha": alpha, "beta": beta, "gamma": gamma})
    return page.evaluate(PAN_TILT)


def press_button(page, alpha: float, beta: float, gamma: float) -> None:
    """Press the button on a phone of given orientation; its first event must follow shortly."""
    page.evaluate(PRESS_BUTTON, {"alpha": alpha, "beta": beta, "gamma": gamma})
    assert page.get_by_role("button", name=NAME).get_attribute("aria-pressed") == "true"


@pytest.fixture
def phone(browser, server, folder):  # noqa: F811
    pages = []

    def open_phone(script: str = COUNT_REQUESTS):
        address = f"{server}#sensor=ball:280&mode=perspective&pan=30"
        page = open_page(browser, address, 390, 760, script, has_touch=True)
        drop(page, folder / "picture.png")
        pages.append(page)
        return page

    yield open_phone
    for page in pages:
        assert page.problems == []
        page.context.close()


def test_view_follows_phone_until_switched_off(phone):
    page = phone()
    button = page.get_by_role("button", name=NAME)
    assert rotate_phone(page, 0, 100, 0) == [30, 0]  # not before permission
    press_button(page, 350, 90, 0)
    assert page.evaluate(PAN_TILT) == pytest.approx([30, 0])  # starts at the current view
    assert rotate_phone(page, 330, 110, 0) == pytest.approx([50, 20])  # 20 deg to the right, and up
    assert rotate_phone(page, 10, 60, 0) == pytest.approx([10, -30])  # across north
    page.evaluate("window.omnimirror.store.set({ pan: 100 })")  # dragged in between
    assert rotate_phone(page, 20, 90, 0) == pytest.approx([90, 0])
    assert rotate_phone(page, 200, 0.01, 0)[0] == pytest.approx(90)  # laid flat
    assert rotate_phone(page, 200, 90, 0) == pytest.approx([90, 0])
    button.click()
    assert rotate_phone(page, 100, 120, 0) == pytest.approx([90, 0])


@pytest.mark.full
def test_denied_motion_permission(phone):
    page = phone(f"{COUNT_REQUESTS} window.answer = 'denied';")
    button = page.get_by_role("button", name=NAME)
    button.click()
    page.get_by_text("Access to motion sensors was denied.").wait_for()
    assert button.get_attribute("aria-pressed") == "false"
    page.evaluate("window.answer = 'granted'")
    press_button(page, 0, 120, 0)
    assert page.evaluate("window.asked") == 2
    assert page.evaluate(PAN_TILT) == pytest.approx([30, 30])


@pytest.mark.full
@pytest.mark.parametrize(
    ("script", "reason"),
    [
        ("delete window.DeviceOrientationEvent;", "This device does not report its orientation."),
        (
            "Object.defineProperty(window, 'isSecureContext', { value: false });",
            "only to local pages and over https.",
        ),
    ],
)
def test_unavailable_orientation_is_explained(script, reason, phone):
    page = phone(script)
    button = page.get_by_role("button", name=NAME)
    assert button.get_attribute("aria-disabled") == "true"
    assert reason in button.get_attribute("title")
    button.click(force=True)
    page.locator("#notice.shown").filter(has_text=reason).wait_for()
    assert button.get_attribute("aria-pressed") == "false"


@pytest.mark.full
def test_device_without_orientation_events(phone):
    page = phone()
    page.get_by_role("button", name=NAME).click()
    page.wait_for_selector("#gyroscope[aria-disabled=true]")
    assert page.evaluate(PAN_TILT) == [30, 0]


def test_gyroscope_is_not_offered_without_touch(browser, server):
    page = open_page(browser, server)
    assert page.get_by_role("button", name=NAME).is_hidden()
    page.context.close()
