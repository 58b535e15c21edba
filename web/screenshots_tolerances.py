"""Take the pictures of the bench's tolerances that the docs show.

python web/screenshots_tolerances.py --out docs/images
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
SCHEMES = ("light",)
SIZE = {"width": 1280, "height": 1000}
SETTLING_MS = 3500
VALUES = {"Mirror decentre x": "0.06", "Mirror tilt y": "0.1"}
AT_REST = """() => {
  const t = window.omnimirror.tabs.bench.tolerances;
  return t.all && t.last && t.errors.isAtRest && t.built.isAtRest && t.yields.isAtRest;
}"""


def try_errors(page: Any) -> None:
    """Put the mirror out of its place, with what a calibration of its pose leaves beside it."""
    page.get_by_role("button", name="Try errors").click()
    page.wait_for_function(AT_REST)
    for name, value in VALUES.items():
        page.get_by_label(name, exact=True).fill(value)
    page.evaluate("document.activeElement.blur()")
    page.wait_for_function(AT_REST)
    page.locator("#bench aside").evaluate("(a) => a.scrollTo(0, a.querySelector('.groups-of-errors').offsetTop - 460)")
    page.wait_for_timeout(SETTLING_MS)


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
            try_errors(page)
            page.screenshot(path=out / f"studio-tolerances-{scheme}.png")
            page.context.close()
        browser.close()
    server.should_exit = True


if __name__ == "__main__":
    main()
