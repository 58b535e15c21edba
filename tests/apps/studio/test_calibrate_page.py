"""User interaction with the Calibrate tab, and the resulting page."""

from __future__ import annotations

import base64
from pathlib import Path

import av
import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.optics.camera_files import parse_camera
from tests.conftest import SHARED

from .boards import BLANK, BOARD, CAMERA, photograph, png
from .browser import COARSE, TIMEOUT_MS
from .test_page import AXE

TAB = "window.omnimirror.tabs.calibrate"
KAIDAN = SHARED / "kaidan_omni"
CAMERA_OF_IMAGES = """
  const canvas = Object.assign(document.createElement("canvas"), { width: 480, height: 480 });
  window.show = async (base64) => {
    const blob = await (await fetch(`data:image/png;base64,${base64}`)).blob();
    const bitmap = await createImageBitmap(blob);
    window.shown = () => canvas.getContext("2d").drawImage(bitmap, 0, 0);
    window.shown();
  };
  setInterval(() => window.shown?.(), 50);  // a camera goes on giving pictures
  navigator.mediaDevices.getUserMedia = async () => {
    canvas.getContext("2d").fillRect(0, 0, 480, 480);
    return canvas.captureStream(20);
  };
"""


@pytest.fixture
def files(tmp_path) -> list[Path]:
    """Some of the photographs, as files."""
    paths = [tmp_path / f"view {i}.png" for i in range(4)]
    for i, path in enumerate(paths):
        path.write_bytes(png(i))
    return paths


@pytest.fixture
def page(browser, server):
    """The empty tab; page errors fail the test."""
    viewport = {"width": 1280, "height": 900}
    context = browser.new_context(
        viewport=viewport, bypass_csp=True, accept_downloads=True, **COARSE
    )
    page = context.new_page()
    page.set_default_timeout(TIMEOUT_MS)
    problems = []
    page.on("pageerror", lambda e: problems.append(str(e)))
    page.add_init_script(CAMERA_OF_IMAGES)
    page.goto(f"{server}#tab=calibrate")
    page.get_by_text("Drop images of a target here").wait_for()
    for name, value in (("Columns", 7), ("Rows", 5), ("Square, mm", 40)):
        page.get_by_label(name, exact=True).fill(str(value))
    page.get_by_label("Model").select_option("unified")
    yield page
    context.close()
    assert problems == []


def button(page, name: str):
    return page.get_by_role("button", name=name, exact=True)


def start_button(page):
    """Return the start button of a calibration; the tab has the same name."""
    return page.locator("#calibrate aside").get_by_role("button", name="Calibrate", exact=True)


def add(page, paths) -> None:
    """Add images, and wait for their individual and joint analysis."""
    page.set_input_files("#calibrate-files", paths)
    page.wait_for_function(
        f"""(count) => {{ const tab = {TAB};
        return tab.images.all.length >= count && tab.images.waiting === 0 && tab.images.all.every((s) => s.thumbnail)
          && tab.analysis?.reasons.length === tab.images.all.filter((s) => s.detection).length; }}""",
        arg=len(paths),
    )


def calibrate(page) -> dict:
    """Press the button, and wait for the report."""
    start_button(page).click()
    page.wait_for_function(f"{TAB}.report !== null")
    return page.evaluate(f"{TAB}.result")


def downloaded(page, name: str) -> str:
    with page.expect_download() as download:
        button(page, name).click()
    return Path(download.value.path()).read_text()


def test_calibration_workflow_with_reload(page, files):
    add(page, files[:3])
    corners = page.locator("#calibrate .shots path.corners")
    assert corners.count() == 3
    corners_px = page.evaluate(f"{TAB}.images.all[1].detection.corners_px")
    expected = om.find_board(photograph(1).image, BOARD).corners_px
    np.testing.assert_allclose(corners_px, expected, atol=1e-3)
    assert corners.nth(1).get_attribute("d").count("M") == 2 * len(expected)  # one cross each
    result = calibrate(page)
    headline = page.locator("#calibrate .headline").inner_text()
    assert f"{result['rms_px']:.3g}" in headline
    assert result["rms_px"] < 0.15
    camera = parse_camera(downloaded(page, "Camera file"))
    assert np.linalg.norm(np.subtract(camera.centre_px, CAMERA.centre_px)) < 0.5
    assert "Calibration: unified" in downloaded(page, "Report")
    page.reload()
    page.locator("#calibrate .headline").wait_for()
    assert page.evaluate(f"{TAB}.result") == result
    page.locator("#calibrate .shots button").nth(2).click()
    page.get_by_text("maximum deviation of corners").wait_for()
    assert (
        page.get_by_alt_text("Undistorted target").evaluate(
            "(i) => i.decode().then(() => i.naturalWidth)"
        )
        > 200
    )
    assert page.locator("#calibrate .whole .residuals").get_attribute("d").count("L") == 35
    button(page, "Use as camera").click()
    page.wait_for_function(
        "window.omnimirror.look.feed?.name === 'view_2.png' || window.omnimirror.look.feed?.name === 'view 2.png'"
    )
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id.startsWith('file:')")
    page.locator("#view").wait_for()
    centre = page.evaluate("window.omnimirror.look.sensor.camera.model.centre_px")
    np.testing.assert_allclose(centre, camera.centre_px, atol=0.01)


@pytest.mark.full
def test_reload_restores_result_and_changes_discard_it(page, files):
    add(page, files[:3])
    result = calibrate(page)
    page.reload()
    page.locator("#calibrate .headline").wait_for()
    assert page.evaluate(f"{TAB}.result") == result
    assert page.get_by_label("Columns", exact=True).input_value() == "7"
    assert [s["name"] for s in page.evaluate(f"{TAB}.images.all")] == [p.name for p in files[:3]]
    page.locator("#calibrate .shots button").first.click()
    button(page, "Remove image").click()
    page.locator("#calibrate .headline").wait_for(state="detached")
    assert page.evaluate(f"{TAB}.images.all.length") == 2
    button(page, "Clear").click()
    page.reload()
    page.get_by_text("Drop images of a target here").wait_for()


BLOCK_DATABASE = (
    """indexedDB.open = new Proxy(indexedDB.open, { apply: () => ({}) });"""  # never completes
)


@pytest.mark.full
def test_reload_before_storage_keeps_change(page, files):
    add(page, files[:3])
    keys = page.evaluate(f"{TAB}.images.all.map((s) => s.key)")
    page.reload()
    page.wait_for_function(f"{TAB}?.images.result.length === 3")
    page.evaluate(BLOCK_DATABASE)
    page.get_by_label("Square, mm").fill("31")
    page.get_by_label("Square, mm").blur()
    page.wait_for_function(f"{TAB}.images.waiting === 0")
    page.locator("#calibrate .shots button").first.click()
    button(page, "Remove image").click()
    page.set_input_files("#calibrate-files", files[3])
    page.wait_for_function(f"{TAB}.images.all.length === 3")
    page.reload()
    page.get_by_text(
        f"The page was closed before {files[3].name} was stored; add it again."
    ).wait_for()
    assert page.evaluate(f"{TAB}.images.all.map((s) => s.key)") == keys[1:]
    assert page.get_by_label("Square, mm").input_value() == "31"


FIELD_CHANGE_SHIFT = """() => {
  const picture = document.querySelector("#calibrate .shots button");
  const square = [...document.querySelectorAll("#calibrate label")].find((l) => l.innerText.includes("Square")).control;
  const before = picture.getBoundingClientRect();
  square.value = "31";
  square.dispatchEvent(new Event("change"));
  const after = picture.getBoundingClientRect();
  return [after.left - before.left, after.top - before.top];
}"""


@pytest.mark.full
def test_press_after_field_change_is_not_lost(page, files):
    """Leaving the field starts a new detection in all images, between press and release."""
    add(page, files[:3])
    page.wait_for_function(f"{TAB}.together !== null")
    page.locator("#calibrate .state").wait_for()
    assert page.evaluate(FIELD_CHANGE_SHIFT) == [0, 0]
    page.wait_for_function(f"{TAB}.images.result.length === 3")


@pytest.mark.full
def test_reasons_against_calibration_and_images_are_displayed(page, files, tmp_path):
    assert start_button(page).is_disabled()
    reason = page.locator(f"#{start_button(page).get_attribute('aria-describedby')}")
    assert "detected in no image; at least 3 are required" in reason.inner_text()
    (tmp_path / "dark.png").write_bytes(BLANK)
    (tmp_path / "notes.png").write_text("no picture")
    page.set_input_files(
        "#calibrate-files", [files[0], tmp_path / "dark.png", tmp_path / "notes.png"]
    )
    page.locator("#calibrate .shots").get_by_text(
        "notes.png: it must be an undamaged image file"
    ).wait_for()
    page.locator("#calibrate .shots").get_by_text("The image is blank").wait_for()
    page.get_by_text("detected in one image; at least 3 are required").wait_for()
    page.get_by_label("Columns", exact=True).fill("6")
    page.keyboard.press("Tab")
    page.locator("#calibrate .shots").get_by_text(
        "A board of 7 x 5 corners was detected instead of 6 x 5"
    ).wait_for()
    page.get_by_label("Columns", exact=True).fill("0")
    page.keyboard.press("Tab")
    page.get_by_text("Columns and rows must be 2 to 200").wait_for()
    assert reason.inner_text() == "Specify the target first."


@pytest.mark.full
def test_cancel_keeps_previous_and_stop_keeps_current_result(page, files):
    add(page, files)
    click_button = """(name) => new MutationObserver((_, observer) => {
      const words = [...document.querySelectorAll("#calibrate aside .words")].map((e) => e.textContent);
      if (!words.some((text) => /^Fitting/.test(text))) return;
      observer.disconnect();
      [...document.querySelectorAll("#calibrate button")].find((b) => b.textContent === name).click();
    }).observe(document.querySelector("#calibrate aside"), { subtree: true, childList: true, characterData: true })"""
    page.evaluate(click_button, "Cancel")
    start_button(page).click()
    page.get_by_text("Cancelled.").wait_for()
    assert page.evaluate(f"{TAB}.result") is None
    assert start_button(page).is_enabled()
    page.get_by_label("Model").select_option("auto")
    page.evaluate(click_button, "Stop and keep the result")
    result = calibrate(page)
    assert not result["is_complete"]
    page.get_by_text("The calibration was stopped early").wait_for()


@pytest.mark.long
def test_webcam_captures_new_positions_only(page):
    button(page, "Use the webcam").click()
    page.locator("#calibrate video").wait_for()
    image_count = f"{TAB}.images.result.length"
    advice = page.locator("#calibrate .webcam .advice")
    for count, number in enumerate((0, 4), 1):
        page.evaluate("(picture) => window.show(picture)", base64.b64encode(png(number)).decode())
        page.wait_for_function(f"{image_count} === {count}")
        page.wait_for_function(
            "document.querySelector('#calibrate .live path.corners')?.getAttribute('d')"
        )
    page.evaluate(
        "(picture) => window.show(picture)", base64.b64encode(png(0)).decode()
    )  # already present
    page.wait_for_function(
        "document.querySelector('#calibrate .webcam .advice').textContent.includes('Hold')"
    )
    assert page.evaluate(image_count) == 2
    target_path = page.locator("#calibrate .live path.wanted").get_attribute("d")
    assert target_path.count("Z") > 8  # uncovered parts of the field
    button(page, "Capture image").click()
    page.wait_for_function(f"{TAB}.images.all.length === 3")
    assert advice.inner_text()
    button(page, "Close webcam").click()
    assert page.locator("#calibrate video").count() == 0
    images = [photograph(n).image for n in (0, 4)]
    assert [om.find_board(p, BOARD).used for p in images] == [True, True]


DELAY_FRAMES = """() => {
  const draw = CanvasRenderingContext2D.prototype.drawImage;
  let late = 3;
  CanvasRenderingContext2D.prototype.drawImage = function (what, ...where) {
    if (!(what instanceof HTMLVideoElement) || late-- <= 0) draw.call(this, what, ...where);
  };
}"""


def test_video_frames_are_added(page, tmp_path):
    """Also if the browser cannot draw a frame immediately after a seek, as under load."""
    page.evaluate(DELAY_FRAMES)
    path = tmp_path / "ride.webm"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libvpx", rate=4, options={"crf": "4", "b": "6M"})
        stream.width, stream.height, stream.pix_fmt = 480, 480, "yuv420p"
        for number in (0, 4):
            image = cv2.cvtColor(photograph(number).image, cv2.COLOR_GRAY2RGB)
            for _ in range(2):
                container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())
    page.set_input_files("#calibrate-files", path)
    page.wait_for_function(f"{TAB}.images.all.length >= 2 && {TAB}.images.waiting === 0")
    images = page.evaluate(f"{TAB}.images.all")
    assert images[0]["name"] == "ride.webm at 0.25 s"
    assert [len(s["detection"]["ids"]) for s in images] == [35] * len(images)
    assert "ride.webm --board 7x5" in page.locator("#calibrate .command code").inner_text()


@pytest.mark.full
@pytest.mark.skipif(not KAIDAN.is_dir(), reason=f"the photographs are not in {SHARED}")
def test_outline_of_photograph_is_initial_value(page):
    for name, value in (("Columns", 11), ("Rows", 7), ("Square, mm", 30)):
        page.get_by_label(name, exact=True).fill(str(value))
    add(page, [KAIDAN / "KaidanOmni12.jpg"])
    page.get_by_text("Mirror rim: radius 22").wait_for()
    assert page.get_by_label("Use the mirror rim").is_checked()
    code = page.locator("#calibrate .command code").inner_text()
    assert "--set camera.rim_radius_px=22" in code
    page.locator("#calibrate .shots button").first.click()
    radius = float(page.locator("#calibrate .whole circle.rim").get_attribute("r"))
    assert 222.0 < radius < 225.0


def serious_violations(page) -> dict:
    """Return the findings of axe in both themes."""
    findings = {}
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        violations = page.evaluate(
            "axe.run({ rules: { 'target-size': { enabled: true } } }).then((r) => r.violations)"
        )
        findings |= {
            v["id"]: v["nodes"][0]["html"]
            for v in violations
            if v["impact"] in ("serious", "critical")
        }
    return findings


@pytest.fixture
def axe(page) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not here: npm install in web/")
    page.add_script_tag(path=AXE)


@pytest.mark.full
def test_accessibility(page, axe):
    assert serious_violations(page) == {}


@pytest.mark.full
def test_accessibility_of_result_and_no_horizontal_overflow(page, axe, files):
    add(page, files)
    calibrate(page)
    page.locator("#calibrate .shots button").nth(1).click()
    page.get_by_text("maximum deviation of corners").wait_for()
    assert serious_violations(page) == {}
    for width in (360, 900, 2560):
        page.set_viewport_size({"width": width, "height": 800})
        page.wait_for_function("(width) => innerWidth === width", arg=width)
        wide = page.evaluate(
            """() => [...document.querySelectorAll("#calibrate *")].filter((e) => !e.closest(".table, svg") &&
            e.getBoundingClientRect().right > innerWidth + 1).map((e) => e.outerHTML.slice(0, 120))"""
        )
        assert wide == []
        assert page.evaluate("document.documentElement.scrollWidth") <= width
