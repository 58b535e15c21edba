"""Take the picture of the tab Calibrate that the docs show: a simulated mirror calibrated, in light and in dark.

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


def pictures(folder: Path) -> list[Path]:
    """Photographs of a board all around a mirror."""
    paths = [folder / f"view {i + 1}.png" for i in range(len(BOARD_POSES))]
    for i, path in enumerate(paths):
        path.write_bytes(png(i))
    return paths


def calibrated(browser: Browser, address: str, paths: list[Path], scheme: str) -> bytes:
    """The tab once a camera is found and a picture chosen."""
    context = browser.new_context(viewport=SIZE, color_scheme=scheme, bypass_csp=True)
    page = context.new_page()
    page.set_default_timeout(300_000)  # a busy machine takes its time
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
    page.wait_for_function("!document.querySelector('#said').classList.contains('shown')")
    return page.screenshot()


def main() -> None:
    import io

    from PIL import Image

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=IMAGES)
    folder = parser.parse_args().out
    executable = shutil.which("chromium") or shutil.which("chromium-headless-shell")
    with TemporaryDirectory() as pictures_in, served() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        paths = pictures(Path(pictures_in))
        shots = [
            Image.open(io.BytesIO(calibrated(browser, address, paths, s))).convert("RGB")
            for s in SCHEMES
        ]
        save(sheet(shots, 2, 800), "calibrate", folder)
        browser.close()


if __name__ == "__main__":
    main()
