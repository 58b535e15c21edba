"""Capture screenshots of the tab Design for the documentation: two colour schemes, 3-D view, tolerances.

python web/screenshots_design.py --out docs/images
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import uvicorn
from playwright.sync_api import sync_playwright

import omnimirror as om
from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio.app import create_app
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod
from omnimirror.optics.sensor_files import save_sensor

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SETTLING_MS = 3500
VALUES = {"Mirror decentre x": "0.06", "Mirror tilt y": "0.1"}
INFEASIBLE = """
[field]
omega_max_deg = 100
[mirror]
family = "sphere"
rim_radius_mm = 40
[lens]
theta_max_deg = 12
[[limit]]
quantity = "resolution_px_per_deg"
at_least = 4.5
"""
SPACE = "window.omnimirror.tabs.design.plotArea.space.view"
AT_REST = """() => {
  const t = window.omnimirror.tabs.design.tolerances;
  return t.all && t.last && t.errors.isAtRest && t.built.isAtRest && t.yields.isAtRest;
}"""


def compare_two(page: Any) -> None:
    """Compare the pinned paper-spherical sensor with an equidistant mirror, two requirements, cursor at 75 deg."""
    page.get_by_role("button", name="Pin", exact=True).click()
    page.get_by_label("Type of mirror").select_option("equidistant")
    page.wait_for_function(
        "window.omnimirror.tabs.design.history.now.tables.mirror.kind === 'equidistant'"
    )
    page.get_by_role("button", name="Add a requirement").click()
    page.get_by_role("button", name="Add a requirement").click()
    page.get_by_label("Quantity").last.select_option("resolution_px_per_deg")
    page.get_by_label("Resolution at most").fill("")
    page.get_by_label("Resolution at least").fill("3.5")
    page.keyboard.press("Enter")
    page.get_by_label("Resolution at most").fill("")
    page.keyboard.press("Enter")
    page.wait_for_timeout(SETTLING_MS)
    page.evaluate("window.omnimirror.tabs.design.plotArea.cursor.set(75, null)")
    page.wait_for_function("!document.querySelector('#notice').classList.contains('shown')")
    page.evaluate("document.activeElement.blur()")
    page.locator("#design aside").evaluate("(aside) => aside.scrollTo(0, 0)")
    page.wait_for_timeout(300)


def try_errors(page: Any) -> None:
    """Misalign the mirror and display the residual errors after calibration of its pose."""
    page.get_by_role("button", name="Analyse tolerances").click()
    page.wait_for_function(AT_REST)
    for name, value in VALUES.items():
        page.get_by_label(name, exact=True).fill(value)
    page.evaluate("document.activeElement.blur()")
    page.wait_for_function(AT_REST)
    page.locator("#design aside").evaluate(
        "(a) => a.scrollTo(0, a.querySelector('.groups-of-errors').offsetTop - 460)"
    )
    page.wait_for_timeout(SETTLING_MS)


def look_in_space(page: Any) -> None:
    """Load the paper-spherical sensor with a dome and select a ray in the 3-D view."""
    housing = Housing(CameraBody(50.0), Rod(4.0), Dome(), Rim(3.0))
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "sphere-in-dome.toml"
        save_sensor(
            replace(om.load_sensor("paper-spherical"), name="sphere-in-dome", housing=housing), file
        )
        page.set_input_files("#design-file", file)
        page.wait_for_function(
            "window.omnimirror.tabs.design.history.now.tables.name === 'sphere-in-dome'"
        )
    page.locator(".groups label").filter(has_text="3-D view").click()
    page.wait_for_function(f"{SPACE}?.rays.length > 0")
    page.evaluate(f"{SPACE}.read({SPACE}.rays.find((ray) => ray.index === 7))")
    page.wait_for_function("!document.querySelector('#notice').classList.contains('shown')")
    page.wait_for_timeout(SETTLING_MS)


def export_files(page: Any) -> None:
    """Open the export dialog with workshop data."""
    page.get_by_role("button", name="Export…").click()
    dialog = page.get_by_role("dialog", name="Export")
    entries = {"Drawing number": "OM-0042", "Legal owner": "Optics", "Material": "brass"}
    for name, value in entries.items():
        dialog.get_by_label(name).fill(value)
    with page.expect_download():
        dialog.get_by_role("button", name="Download Sag table").click()
    dialog.evaluate("(element) => element.scrollTo(0, 0)")


def relax(page: Any) -> None:
    """Design a sensor for infeasible requirements, and display the relaxations."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "requirements.toml"
        file.write_text(INFEASIBLE)
        page.set_input_files("#design-file", file)
        page.get_by_role("button", name="Design from requirements").click()
    page.locator(".relaxations li").first.wait_for(timeout=120_000)
    page.locator(".relaxations").scroll_into_view_if_needed()
    page.wait_for_timeout(SETTLING_MS)


SCREENSHOTS = {
    "studio-design-light": (compare_two, "light", 1120),
    "studio-design-dark": (compare_two, "dark", 1120),
    "studio-space-light": (look_in_space, "light", 800),
    "studio-tolerances-light": (try_errors, "light", 1000),
    "studio-export-light": (export_files, "light", 1000),
    "studio-relaxations-light": (relax, "light", 1000),
}
"""Actions before the screenshot, colour scheme, and height of the window (px)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/images"))
    parser.add_argument("--only", choices=SCREENSHOTS, nargs="+", default=list(SCREENSHOTS))
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    server = uvicorn.Server(
        uvicorn.Config(create_app(Studio()), port=0, log_level="error", ws="websockets-sansio")
    )
    threading.Thread(target=server.run, daemon=True).start()
    while not server.started:
        time.sleep(0.01)
    address = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}/#tab=design"
    chromium = (
        os.environ.get("CHROMIUM")
        or shutil.which("chromium")
        or shutil.which("chromium-headless-shell")
    )
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=FLAGS)
        for name in args.only:
            prepare, scheme, height = SCREENSHOTS[name]
            size = {"width": 1280, "height": height}
            page = browser.new_context(
                viewport=size, color_scheme=scheme, bypass_csp=True
            ).new_page()
            page.goto(address)
            page.wait_for_selector("#design .compare tbody td")
            prepare(page)
            page.screenshot(path=args.out / f"{name}.png")
            page.context.close()
        browser.close()
    server.should_exit = True


if __name__ == "__main__":
    main()
