"""Measure the latency from a slider of the Look tab to the drawn view, against the page of another revision.

One server serves both pages, and one headless Chromium displays them: the current page and the built page of the
given revision, both with WebGL2. The pan slider of each page is moved in turn. A latency begins with the input event
and ends when the view is drawn; frames are not limited to the rate of a screen. Without a GPU, the shaders run on the
processor.

    python benchmarks/view_latency.py --revision v0.1.0 -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import subprocess
from pathlib import Path

import numpy as np
from measurement_conditions import load_warning, processor_name
from page_load import FLAGS, chromium_path, start_studio
from playwright.sync_api import Browser, Page, Route, sync_playwright

from omnimirror.apps.studio.pages import PAGE, SCRIPTS
from omnimirror.base.files import write_text

UNLIMITED = ["--disable-frame-rate-limit", "--disable-gpu-vsync"]
SIZE = {"width": 640, "height": 480}
VIEWS = {
    "panorama": "mode=panorama&zoom=2",
    "perspective": "mode=perspective&hfov=80",
    "wall at 1 m": "mode=perspective&hfov=80&distance=1000",
}
MOVES = 12  # of the slider per round
MOVE_SCRIPT = """async (count) => {
  const { renderer } = window.omnimirror.look;
  const slider = document.querySelector("#pan");
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const gl = renderer.canvas.getContext("webgl2");
  const delays = [];
  for (let i = 0; i < count; i++) {
    await frame();
    const start = performance.now();
    slider.value = String((Number(slider.value) + 190) % 360 - 180);
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    await frame(); // after the page, which requested the frame before
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
    delays.push(performance.now() - start);
  }
  return delays;
}"""


def serve_revision(route: Route, revision: str) -> None:
    """Answer a request with the built page of a revision."""
    name = route.request.url.split("?")[0].rpartition("/")[2] or PAGE.name
    path = PAGE.with_name(name).relative_to(Path.cwd())
    text = subprocess.run(["git", "show", f"{revision}:{path}"], capture_output=True, text=True)
    kind = "text/html" if name == PAGE.name else "text/javascript"
    route.fulfill(status=404 if text.returncode else 200, body=text.stdout, content_type=kind)


def open_page(browser: Browser, address: str, revision: str, state: str) -> Page:
    """Return a page that displays the demo room with WebGL2."""
    context = browser.new_context(viewport=SIZE, bypass_csp=True, reduced_motion="reduce")
    page = context.new_page()
    if revision:
        for name in ("", *SCRIPTS):
            page.route(f"{address}{name}", lambda route: serve_revision(route, revision))
            page.route(f"{address}{name}?*", lambda route: serve_revision(route, revision))
    page.goto(f"{address}?renderer=webgl2#sensor=paper-spherical&source=room&{state}")
    page.wait_for_selector("#view:visible")
    page.evaluate(MOVE_SCRIPT, MOVES)
    return page


def measure_view(browser: Browser, address: str, revision: str, name: str, runs: int) -> list[str]:
    """Return table rows of one view: median latencies, and ratios to the other revision."""
    labels = {f"page of {revision[:12]}": revision, "current page": ""}
    before = next(iter(labels))
    pages = {
        label: open_page(browser, address, served, VIEWS[name]) for label, served in labels.items()
    }
    delays: dict[str, list[float]] = {label: [] for label in pages}
    for run in range(runs):
        order = list(pages) if run % 2 else list(pages)[::-1]
        for label in order:
            delays[label].append(float(np.median(pages[label].evaluate(MOVE_SCRIPT, MOVES))))
    rows = []
    for label, values in delays.items():
        ratios = np.divide(values, delays[before])
        low, ratio, high = np.percentile(ratios, (25, 50, 75))
        canvas = "(({ width, height }) => `${width} x ${height}`)(window.omnimirror.look.renderer.canvas)"
        size = pages[label].evaluate(canvas)
        pages[label].context.close()
        rows.append(
            f"| {name} | {label} | {size} | {np.median(values):.1f} | {ratio:.3f} | {low:.3f} to {high:.3f} |"
        )
        print(rows[-1], flush=True)
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--revision", default="HEAD", help="Git revision of the other page")
    parser.add_argument("--runs", type=int, default=15)
    arguments = parser.parse_args()
    load_note = load_warning()
    with start_studio() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium_path(), args=[*FLAGS, *UNLIMITED]
        )
        lines = [
            "# Latency of the view",
            "",
            f"`{Path(__file__).name}` on {processor_name()}, {os.cpu_count()} cores, Chromium "
            f"{browser.version} without a GPU; {arguments.runs} interleaved runs of {MOVES} moves of "
            f"the pan slider.{load_note}",
            "",
            "| view | page | size, px | median, ms | ratio to the other revision | quartiles |",
            "|---|---|---|---|---|---|",
        ]
        for name in VIEWS:
            lines += measure_view(browser, address, arguments.revision, name, arguments.runs)
        browser.close()
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "view_latency.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
