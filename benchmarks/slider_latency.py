"""Measure the latency from a slider of the studio's design tab to plots, simulated image and 3-D view.

A headless Chromium without a GPU controls the page; the server runs on the same machine. All plots are displayed; the
simulated image is updated when no slider moves. ``server`` is the processor time of the response without the
connection, ``page`` that of the page thread including painting. ``image`` is the wall time of the response with
image and panorama: small while a slider moves, and large afterwards.

    python benchmarks/slider_latency.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from measurement_conditions import describe_conditions
from page_load import chromium_path
from playwright.sync_api import sync_playwright

import omnimirror as om
from omnimirror.apps.studio._design_evaluation import answer
from omnimirror.apps.studio._design_files import taken
from omnimirror.apps.studio._design_sensors import changed, tables_from_sensor
from omnimirror.apps.studio._server_state import Studio
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.design_messages import (
    DesignChange,
    DesignRequest,
    DesignSensor,
    RenderRequest,
)
from omnimirror.base.files import write_text
from omnimirror.interop.http_server.server import Server, listen, server_config
from omnimirror.optics.sensor_files import tables_of

MIRROR_KINDS = (
    "sphere",
    "hyperboloid",
    "even-polynomial",
    "slope-spline",
    "equidistant",
    "equiareal",
    "tabulated-mapping",
)
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
RENDER_REQUESTS = (224, 1), (640, 2)  # pixels and rays of the two requests of the page
EMPTY = '{ "design": null, "past": [], "future": [], "pins": [], "switched": ["Image"] }'
MOVE_SCRIPT = """async (count) => {
  const { design: design_tab } = window.omnimirror.tabs;
  const slider = document.querySelector("#design input[type=range]");
  const start = Number(slider.value);
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  for (let i = 0; i < count; i++) {
    const before = design_tab.latencies;
    slider.value = String(start + 0.02 * Math.sin(i));
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    while (design_tab.latencies === before) await frame();
  }
  return design_tab.latencies.slice(-count);
}"""


VIEW_3D = "window.omnimirror.tabs.design.plotArea.space.view"
ROTATE_SCRIPT = f"""async (count) => {{
  const view = {VIEW_3D}, gl = view.canvas.getContext("webgl2"), pixel = new Uint8Array(4);
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  const found = [];
  for (let i = 0, before = await frame(); i < count; i++) {{
    view.orbit.around += 0.02;
    const begun = performance.now();
    view.draw();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    const drawn = performance.now() - begun, now = await frame();
    found.push([now - before, drawn]);
    before = now;
  }}
  return [found, view.canvas.width, view.canvas.height];
}}"""


@contextmanager
def serving() -> Iterator[str]:
    """Yield the address of a running studio."""
    server, listening = Server(server_config(create_app(Studio()), "error")), listen("127.0.0.1", 0)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    try:
        yield f"http://127.0.0.1:{listening.getsockname()[1]}/"
    finally:
        server.should_exit = True
        thread.join(10)


def server_ms(sensor: DesignSensor, runs: int) -> float:
    """Return the median processor time of a response in the server, ms."""
    request = DesignRequest(
        slot=0,
        number=0,
        tables=sensor.tables,
        follows_mapping=sensor.follows_mapping,
        object_distance_mm=None,
        include_section=True,
        include_squares=True,
        requirements=None,
    )
    times = []
    for _ in range(runs):
        start = time.thread_time()
        answer(request)
        times.append(time.thread_time() - start)
    return 1e3 * float(np.median(times))


def render_ms(sensor: DesignSensor, width_px: int, samples: int, runs: int) -> float:
    """Return the median time of a response with an image of a room, ms."""
    request = RenderRequest(tables=sensor.tables, width_px=width_px, samples=samples)
    times = []
    for _ in range(runs):
        start = time.perf_counter()
        taken(request)
        times.append(time.perf_counter() - start)
    return 1e3 * float(np.median(times))


def measure_rotation(page: Any, count: int) -> str:
    """Return the frame time of the 3-D view during rotation."""
    page.locator(".groups label").filter(has_text="3-D view").click()
    page.wait_for_function(f"{VIEW_3D}?.frames > 0 && {VIEW_3D}.rays.length > 0")
    page.evaluate(ROTATE_SCRIPT, 10)
    frame_times, width, height = page.evaluate(ROTATE_SCRIPT, count)
    (frame, drawn), (slow, _) = (
        np.median(frame_times, axis=0),
        np.percentile(frame_times, 95, axis=0),
    )
    return (
        f"3-D view of {width} x {height} px during rotation, without a GPU: frame interval "
        f"{frame:.1f} ms (95th percentile: {slow:.1f} ms), of which drawing takes {drawn:.1f} "
        "ms."
    )


def page_ms(page: Any, metrics: Any, kind: str, count: int) -> tuple[np.ndarray, float]:
    """Return the times (count,) from a change of the first mirror slider to the drawn plots, and
    the processor time of the page."""
    choice = page.get_by_label("Type of mirror")
    if choice.input_value() != kind:
        choice.select_option(kind)
        page.wait_for_function(
            f"window.omnimirror.tabs.design.history.now.tables.mirror.kind === '{kind}'"
        )
        page.wait_for_timeout(500)
    page.evaluate(MOVE_SCRIPT, 10)
    before = page_processor_s(metrics)
    delays = np.array(page.evaluate(MOVE_SCRIPT, count))
    return delays, 1e3 * (page_processor_s(metrics) - before) / count


def page_processor_s(metrics: Any) -> float:
    """Return the processor time of the main thread of the page."""
    values = metrics.send("Performance.getMetrics")["metrics"]
    return float(next(m["value"] for m in values if m["name"] == "TaskDuration"))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=100)
    arguments = parser.parse_args()
    conditions = describe_conditions(arguments.runs).replace("interleaved runs", "changes")
    first = tables_of(om.load_sensor("paper-spherical"))
    sensors = {
        kind: tables_from_sensor(
            changed(DesignChange(tables=first, target="mirror", to=kind, object_distance_mm=None))
        )
        for kind in MIRROR_KINDS
    }
    rows = []
    with serving() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        page = browser.new_context(
            viewport={"width": 1280, "height": 900}, bypass_csp=True
        ).new_page()
        page.add_init_script(f"localStorage.setItem('omnimirror-design', '{EMPTY}')")
        page.goto(f"{address}#tab=design")
        page.wait_for_selector("#design .compare tbody td")
        metrics = page.context.new_cdp_session(page)
        metrics.send("Performance.enable", {"timeDomain": "threadTicks"})
        for kind, sensor in sensors.items():
            drawn, page_time = page_ms(page, metrics, kind, arguments.runs)
            render_times = (
                render_ms(sensor, width, samples, 9) for width, samples in RENDER_REQUESTS
            )
            server = server_ms(sensor, arguments.runs)
            rows.append(
                (kind, server, page_time, np.median(drawn), np.percentile(drawn, 95), *render_times)
            )
        rotation = measure_rotation(page, arguments.runs)
        browser.close()
    lines = [
        f"| {kind} | " + " | ".join(f"{value:.1f}" for value in values) + " |"
        for kind, *values in rows
    ]
    sizes = " | ".join(f"image of {width} px, ms" for width, _ in RENDER_REQUESTS)
    header = (
        f"| mirror | server, ms | page, ms | slider to plots, ms | 95th percentile, ms | {sizes} |\n"
        + "| --- " * 7
        + "|"
    )
    text = "\n".join(["# Slider latency", "", conditions, "", header, *lines, "", rotation, ""])
    print(text)
    write_text(arguments.output / "slider_latency.md", text)


if __name__ == "__main__":
    main()
