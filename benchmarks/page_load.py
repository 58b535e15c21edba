"""Measure the size of the studio's page, its first paint, and the latency of the view after a drag.

The page runs in a headless Chromium. Without a GPU, the shaders run on the processor, and the latency increases
accordingly.

    python benchmarks/page_load.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import gzip
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from measurement_conditions import load_warning, processor_name
from playwright.sync_api import Browser, Page, sync_playwright

from omnimirror.apps.studio.pages import PAGE
from omnimirror.base.files import write_text

FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SIZE = {"width": 1280, "height": 800}
VIEWS = {"panorama": "mode=panorama", "perspective": "mode=perspective&hfov=80"}
DRAGS = 60
DELAY_SCRIPT = """() => {
  const gl = window.omnimirror.look.renderer.canvas.getContext("webgl2");
  window.delays = [];
  document.querySelector("#view").addEventListener("pointermove", (e) => requestAnimationFrame(() => {
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
    window.delays.push(performance.now() - e.timeStamp);
  }));
}"""


def row(label: str, values: list[float], unit: str, target: str) -> str:
    """Return a row of the table."""
    percentile_95 = f"{np.percentile(values, 95):.0f}" if len(values) > 1 else ""
    line = f"| {label} | {np.median(values):.0f} | {percentile_95} | {unit} | {target} |"
    print(line, flush=True)
    return line


def file_sizes() -> Iterator[str]:
    """Yield the size of each file of the page, compressed as by web servers."""
    for path in sorted(PAGE.parent.iterdir(), reverse=True):
        label = "page" if path == PAGE else f"`{path.name}`, loaded on demand"
        yield row(
            f"{label}, compressed",
            [len(gzip.compress(path.read_bytes(), 9)) / 1000],
            "kB",
            "300 in total",
        )


def first_paint(browser: Browser, address: str, runs: int) -> Iterator[str]:
    """Yield the time from the request to the first paint, with an empty browser cache."""
    times = []
    for _ in range(runs):
        page = open_page(browser, address)
        paint = "performance.getEntriesByName('first-contentful-paint')[0]?.startTime"
        times.append(page.wait_for_function(paint).json_value())
        page.context.close()
    yield row("first paint", times, "ms", "1000")


def drag_to_frame(browser: Browser, address: str) -> Iterator[str]:
    """Yield the delay from the pointer movement to the updated view."""
    for name, state in VIEWS.items():
        page = open_page(browser, f"{address}#source=room&{state}")
        page.wait_for_function("window.omnimirror.look.feed")
        page.wait_for_selector("#view:visible")
        box = page.locator("#view").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        page.mouse.down()
        page.evaluate(DELAY_SCRIPT)
        for i in range(DRAGS):
            page.mouse.move(x + 2 * (i + 1), y)
            page.wait_for_function(f"window.delays.length > {i}")
        width, height = page.evaluate(
            "(({ width, height }) => [width, height])(window.omnimirror.look.renderer.canvas)"
        )
        label = f"drag to frame, {name} of {width} x {height} px"
        yield row(label, page.evaluate("window.delays"), "ms", "")
        page.context.close()


def open_page(browser: Browser, address: str) -> Page:
    """Return a page that has loaded its first camera."""
    page = browser.new_context(viewport=SIZE, bypass_csp=True, reduced_motion="reduce").new_page()
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    return page


def chromium_path() -> str | None:
    """Return the path of Chromium: from the variable CHROMIUM, or on the path."""
    return (
        os.environ.get("CHROMIUM")
        or shutil.which("chromium")
        or shutil.which("chromium-headless-shell")
    )


@contextmanager
def start_studio(*command_arguments: str | Path) -> Iterator[str]:
    """Yield the address of a studio started by a command; an empty studio by default."""
    command = [sys.executable, "-m", "omnimirror", *(command_arguments or ("studio",)), "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://\S+", server.stdout.readline())[0]
        finally:
            server.terminate()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=9)
    arguments = parser.parse_args()
    load_note = load_warning()
    with start_studio() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        measurements = [
            file_sizes(),
            first_paint(browser, address, arguments.runs),
            drag_to_frame(browser, address),
        ]
        rows = [line for lines in measurements for line in lines]
        lines = [
            "# The studio's page",
            "",
            f"`{Path(__file__).name}` on {processor_name()}, "
            f"{os.cpu_count()} cores, Chromium {browser.version} without a "
            f"GPU.{load_note}",
            "",
            "| quantity | median | 95th percentile | unit | target |",
            "|---|---|---|---|---|",
            *rows,
        ]
        browser.close()
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "page_load.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
