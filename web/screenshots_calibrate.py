"""Capture a screenshot of the tab Calibrate with a simulated calibration, in both colour schemes.

python web/screenshots_calibrate.py
"""

from __future__ import annotations

import argparse
import re
import shutil
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.sync_api import Browser, sync_playwright

sys.path.insert(0, str(Path(__file__).parents[1]))
from screenshots import FLAGS, IMAGES, SCHEMES, save, served, sheet

from tests.apps.studio.boards import BOARD_POSES, BOARD_REQUEST, png

SIZE = {"width": 1280, "height": 1640}


def board_images(folder: Path) -> list[Path]:
    """Write simulated images of a board around a mirror; return their paths."""
    paths = [folder / f"view {i + 1}.png" for i in range(len(BOARD_POSES))]
    for i, path in enumerate(paths):
        path.write_bytes(png(i))
    return paths


def screenshot(browser: Browser, address: str, paths: list[Path], scheme: str) -> bytes:
    """Return a screenshot of the tab with a calibrated camera and a selected image."""
    context = browser.new_context(viewport=SIZE, color_scheme=scheme, bypass_csp=True)
    page = context.new_page()
    page.set_default_timeout(300_000)  # for busy machines
    page.goto(f"{address}#tab=calibrate")
    for name, value in (
        ("Columns", BOARD_REQUEST["columns"]),
        ("Rows", BOARD_REQUEST["rows"]),
        ("Square, mm", BOARD_REQUEST["square_mm"]),
    ):
        page.get_by_label(name, exact=True).fill(str(value))
    page.set_input_files("#calibrate-files", paths)
    page.wait_for_function(
        f"window.omnimirror.tabs.calibrate.images.result.length === {len(paths)}"
    )
    page.locator("#calibrate aside").get_by_role("button", name="Calibrate", exact=True).click()
    page.wait_for_function("window.omnimirror.tabs.calibrate.report !== null")
    page.locator("#calibrate .shots button").first.click()
    page.get_by_text(re.compile("maximum deviation of corners")).wait_for()
    page.evaluate(
        "document.activeElement.blur(); document.querySelector('#calibrate .desk').scrollTo(0, 0)"
    )
    page.wait_for_function("!document.querySelector('#notice').classList.contains('shown')")
    return page.screenshot()


def main() -> None:
    import io

    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=IMAGES)
    folder = parser.parse_args().out
    executable = shutil.which("chromium") or shutil.which("chromium-headless-shell")
    with TemporaryDirectory() as image_folder, served() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        paths = board_images(Path(image_folder))
        shots = [
            Image.open(io.BytesIO(screenshot(browser, address, paths, s))).convert("RGB")
            for s in SCHEMES
        ]
        save(sheet(shots, 2, 800), "calibrate", folder)
        browser.close()


if __name__ == "__main__":
    main()
