"""Take the pictures of the design bench that the docs show: in light and dark.

python web/screenshots_bench.py --out docs/images
"""

from __future__ import annotations

import argparse
import os
import shutil
import threading
import time
from pathlib import Path
from typing import Any

import uvicorn
from playwright.sync_api import sync_playwright

from omnimirror.studio.app import create_app
from omnimirror.studio.studio import Studio

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCHEMES = ("light", "dark")
SIZE = {"width": 1280, "height": 1120}
SETTLING_MS = 2500


def compare_two(page: Any) -> None:
    """Pin the paper's sphere, make the exact equidistant mirror, ask two things of it, and read at 75 degrees."""
    page.get_by_role("button", name="Pin", exact=True).click()
    page.get_by_label("Kind of mirror").select_option("equidistant")
    page.wait_for_function("window.omnimirror.tabs.bench.history.now.tables.mirror.kind === 'equidistant'")
    page.get_by_role("button", name="Add a requirement").click()
    page.get_by_role("button", name="Add a requirement").click()
    page.get_by_label("Quantity").last.select_option("resolution_px_per_deg")
    page.get_by_label("resolution_px_per_deg at most").fill("")
    page.get_by_label("resolution_px_per_deg at least").fill("3.5")
    page.keyboard.press("Enter")
    page.get_by_label("resolution_px_per_deg at most").fill("")
    page.keyboard.press("Enter")
    page.wait_for_timeout(SETTLING_MS)
    page.evaluate("window.omnimirror.tabs.bench.desk.cursor.set(75, null)")
    page.wait_for_function("!document.querySelector('#said').classList.contains('shown')")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    out = parser.parse_args().out
    server = uvicorn.Server(uvicorn.Config(create_app(Studio()), port=0, log_level="error", ws="websockets-sansio"))
    threading.Thread(target=server.run, daemon=True).start()
    while not server.started:
        time.sleep(0.01)
    address = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/#tab=design"
    chromium = os.environ.get("CHROMIUM") or shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for scheme in SCHEMES:
            page = browser.new_context(viewport=SIZE, color_scheme=scheme, bypass_csp=True).new_page()
            page.goto(address)
            page.wait_for_selector("#bench .compare tbody td")
            compare_two(page)
            page.evaluate("document.activeElement.blur()")
            page.locator("#bench aside").evaluate("(aside) => aside.scrollTo(0, 0)")
            page.wait_for_timeout(300)
            page.screenshot(path=out / f"studio-design-{scheme}.png")
            page.context.close()
        browser.close()
    server.should_exit = True


if __name__ == "__main__":
    main()
