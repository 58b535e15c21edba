"""Project files: saved in one browser, opened in another, equal pixels."""

from __future__ import annotations

import json

import numpy as np
import pytest

import omnimirror as om
from omnimirror.io import write_image
from omnimirror.optics.sensor_files import save_sensor

from .browser import drop, open_page, set_state, view_pixels
from .images import pattern
from .test_design_page import CURRENT_DESIGN, WITHOUT_IMAGES

STATE = {"mode": "perspective", "pan": 35, "tilt": -12, "hfov": 55, "rim": [250.0, 190.0, 150.0]}


def wait_for_image(page, name: str) -> None:
    page.wait_for_function(f"window.omnimirror?.look.feed?.name === {name!r}")
    page.wait_for_selector("#view:visible")
    page.wait_for_function(
        "window.omnimirror.look.sensor.camera.model.id === window.omnimirror.store.state.sensor"
    )


@pytest.fixture(scope="module")
def project(browser, server, tmp_path_factory):
    """A project with all content types, its pixels when saved, and its state."""
    folder = tmp_path_factory.mktemp("project")
    write_image(folder / "hall.png", pattern((500, 400)))
    save_sensor(om.load_sensor("paper-hyperboloidal"), folder / "mine.toml")
    page = open_page(browser, server, 900, 700)
    page.add_init_script(WITHOUT_IMAGES)
    page.set_input_files("#calibration", folder / "mine.toml")
    page.wait_for_function("window.omnimirror.store.state.sensor.startsWith('file:')")
    drop(page, folder / "hall.png")
    set_state(page, **STATE)
    page.get_by_role("button", name="Store view").click()
    page.get_by_role("button", name="Design", exact=True).click()
    page.wait_for_selector("#design .compare tbody td")
    page.get_by_role("button", name="Pin", exact=True).click()
    page.locator("#design").get_by_label("F-number", exact=True).fill(
        "5.5"
    )  # without pressing a key
    page.locator("#tabs").get_by_role("button", name="Look").click()
    wait_for_image(page, "hall.png")
    pixels = view_pixels(page, 160, 120)
    page.get_by_role("button", name="Project").click()
    with page.expect_download() as download:
        page.get_by_role("button", name="Save project").click()
    assert download.value.suggested_filename == "hall.omnimirror"
    download.value.save_as(folder / "hall.omnimirror")
    state = page.evaluate("window.omnimirror.store.state")
    assert page.problems == []
    page.context.close()
    return folder / "hall.omnimirror", pixels, state


def test_project_reproduces_pixels_on_another_page(project, browser, server):
    path, pixels, state = project
    page = open_page(browser, server, 900, 700)
    page.set_input_files("#file", path)  # opened or dropped like an image
    wait_for_image(page, "hall.png")
    result = page.evaluate("window.omnimirror.store.state")
    assert {**result, "design": ""} == {**state, "design": ""}
    np.testing.assert_array_equal(view_pixels(page, 160, 120), pixels)
    page.get_by_role("button", name="Design", exact=True).click()
    page.wait_for_selector("#design .compare tbody td")
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.lens.f_number") == 5.5
    page.get_by_role("button", name="Unpin").wait_for()
    page.get_by_role("button", name="Undo", exact=True).click()
    assert page.evaluate(f"{CURRENT_DESIGN}.tables.lens.f_number") == 4
    assert page.problems == []
    page.context.close()


def test_invalid_project_files_are_rejected(browser, server, tmp_path):
    page = open_page(browser, server, 900, 700)
    for text, message in (
        ("[mirror]", "The file must be a project file"),
        (json.dumps({"kind": "omnimirror project", "state": "", "version": 7}), "has version 7"),
    ):
        (tmp_path / "x.omnimirror").write_text(text)
        page.set_input_files("#project-file", tmp_path / "x.omnimirror")
        page.wait_for_function(
            f"document.querySelector('#banner').textContent.includes({message!r})"
        )
    assert page.evaluate("window.omnimirror.look.feed") is None
    page.context.close()
