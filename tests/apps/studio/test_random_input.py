"""Random input: clicks, keys, drags and values anywhere on the page raise no page error."""

from __future__ import annotations

import random
import time

import pytest

from omnimirror.io import write_image

from .browser import drop, open_page
from .images import pattern
from .test_design_page import WITHOUT_IMAGES

KEYS = (
    *("ArrowLeft", "ArrowRight", "ArrowUp", "ArrowDown", "Home", "End", "PageUp", "PageDown"),
    *("Tab", "Shift+Tab", "Enter", "Space", "Escape", "Delete", "Backspace"),
    *("Control+z", "Control+Shift+z", "+", "-", "0", "?", "f", "p"),
)
VALUES = ("", "0", "-1", "1e300", "nan", "5.6", "40", "abc", "<b>", "1,5", "é" * 40)
FIND = """() => {
  const all = document.querySelectorAll(
    "button, summary, select, input, textarea, canvas, [role=slider], [role=tab], [tabindex]",
  );
  window.targets = [...all].filter((e) => e.checkVisibility() && !e.disabled);
  return window.targets.map((e) => ({
    kind: e.localName,
    type: e.type ?? "",
    label: (e.ariaLabel || e.textContent || e.id || "").trim().slice(0, 40),
    options: e.localName === "select" ? [...e.options].map((o) => o.value) : [],
  }));
}"""
POSITION = """(index) => {
  const element = window.targets[index];
  element.scrollIntoView({ block: "nearest" });
  const { left, top, width, height } = element.getBoundingClientRect();
  return [left, top, width, height];
}"""
SET_VALUE = """([index, value]) => {
  const element = window.targets[index];
  element.value = value;
  for (const name of ["input", "change"]) element.dispatchEvent(new Event(name, { bubbles: true }));
}"""
ALIVE = """() => new Promise((resolve) => requestAnimationFrame(() => resolve(
  document.querySelectorAll("#tabs button").length)))"""


class RandomUser:
    """Perform reproducible random actions on a page, and record them."""

    def __init__(self, page, seed: int) -> None:
        self.page = page
        self.random = random.Random(seed)
        self.actions: list[str] = []

    def act(self) -> None:
        """Perform one action on a random visible element, or on the window."""
        elements = self.page.evaluate(FIND)
        if not elements or self.random.random() < 0.1:
            return self._use_window()
        index = self.random.randrange(len(elements))
        element = elements[index]
        self.actions.append(f"{element['kind']} {element['type']} {element['label']!r}")
        if element["kind"] == "select":
            value = self.random.choice(element["options"] or [""])
            return self.page.evaluate(SET_VALUE, [index, value])
        if element["type"] in ("number", "text", "range") and self.random.random() < 0.7:
            value = self.random.choice(VALUES)
            self.actions[-1] += f" = {value!r}"
            return self.page.evaluate(SET_VALUE, [index, value])
        self._point(self.page.evaluate(POSITION, index))

    def _point(self, box: list[float]) -> None:
        """Click, drag from, or turn the wheel over a random point of an element."""
        left, top, width, height = box
        mouse = self.page.mouse
        mouse.move(left + width * self.random.random(), top + height * self.random.random())
        kind = self.random.choice(("click", "click", "click", "drag", "wheel"))
        if kind == "click":
            mouse.down()
        elif kind == "drag":
            mouse.down()
            mouse.move(left + self.random.uniform(-90, 90), top + self.random.uniform(-90, 90))
        else:
            mouse.wheel(0, self.random.uniform(-400, 400))
        mouse.up()

    def _use_window(self) -> None:
        """Press a key, resize the window, move in the history, or reload the page."""
        kind = self.random.choice(("key",) * 8 + ("size", "back", "forward", "reload"))
        if kind == "key":
            key = self.random.choice(KEYS)
            self.actions.append(f"key {key}")
            self.page.keyboard.press(key)
            return
        self.actions.append(kind)
        if kind == "size":
            self.page.evaluate("document.fullscreenElement && document.exitFullscreen()")
            self.page.wait_for_function("!document.fullscreenElement")
            width, height = self.random.randint(320, 1600), self.random.randint(300, 1000)
            self.page.set_viewport_size({"width": width, "height": height})
        elif kind == "reload":
            self.page.reload()
        else:
            self.page.evaluate(f"history.{kind}()")
        self.page.wait_for_function("document.readyState === 'complete'")


def _use_at_random(browser, server, folder, seed: int, is_over) -> None:
    """Use a page until ``is_over(number of actions)``; no action raises an error of the page."""
    write_image(folder / "waves.png", pattern((500, 400)))
    page = open_page(browser, server, 1000, 800, WITHOUT_IMAGES, accept_downloads=False)
    page.on("dialog", lambda dialog: dialog.dismiss())
    page.on("filechooser", lambda chooser: None)  # no dialog of the system opens
    page.context.on("page", lambda popup: popup.close() if popup is not page else None)
    drop(page, folder / "waves.png")
    user = RandomUser(page, seed)
    while not is_over(len(user.actions)):
        try:
            user.act()
        except Exception as error:
            if "context was destroyed" not in str(error) and "navigat" not in str(error):
                raise AssertionError(f"after {user.actions[-12:]}") from error
        assert page.problems == [], "\n".join(user.actions[-12:])
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    assert page.evaluate(ALIVE) == 3
    assert page.problems == [], "\n".join(user.actions[-12:])
    page.context.close()


def test_random_input(browser, server, tmp_path):
    _use_at_random(browser, server, tmp_path, 1, lambda count: count >= 150)


@pytest.mark.full
def test_random_input_for_ten_minutes(browser, server, tmp_path):
    end = time.monotonic() + 600
    _use_at_random(browser, server, tmp_path, 2, lambda count: time.monotonic() > end)
