"""Capture screenshots of the studio in headless Chromium: docs/images/studio-*.webp.

    python web/screenshots.py

Each image contains one view of the page in both colour schemes, or all view modes in one scheme.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

import omnimirror as om

IMAGES = Path(__file__).parents[1] / "docs" / "images"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCHEMES = ("light", "dark")
LAPTOP, PHONE, LARGE = (1280, 800), (360, 780), (3840, 2160)
GAP = 12
MAX_BYTES = 200_000  # bytes

MODES = {
    "panorama": "mode=panorama",
    "perspective": "mode=perspective&tilt=8&hfov=80",
    "dome": "mode=dome",
    "planet": "mode=planet",
    "ground": "mode=ground",
    "mosaic": "mode=mosaic",
}


@contextmanager
def served() -> Iterator[str]:
    """Start a studio, yield its address, and terminate it."""
    command = [sys.executable, "-m", "omnimirror", "studio", "--no-open"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server:
        try:
            yield re.search(r"http://\S+", server.stdout.readline())[0]
        finally:
            server.terminate()


def shot(
    browser: Browser,
    address: str,
    scheme: str,
    size: tuple[int, int],
    act: Callable[[Page], None] = lambda page: None,
) -> Image.Image:
    """Return a screenshot of the page at an address after loading and an action."""
    context = browser.new_context(
        viewport=dict(zip(("width", "height"), size, strict=True)),
        color_scheme=scheme,
        bypass_csp=True,
    )
    page = context.new_page()
    page.set_default_timeout(300_000)  # for busy machines
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    if "source=room" in address:
        page.wait_for_function("window.omnimirror.look.feed")
    act(page)
    page.wait_for_timeout(600)
    image = Image.open(io.BytesIO(page.screenshot(full_page=size == PHONE))).convert("RGB")
    context.close()
    return image


def fit_the_circle(page: Page) -> None:
    page.get_by_role("button", name="Fit circle").click()


def open_the_export(page: Page) -> None:
    page.locator("#export summary").click()


def ask_for_the_mirror_type(page: Page) -> None:
    """Open an image of a spherical mirror, and point at the upright view."""
    sensor = om.load_sensor("paper-spherical")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.png"
        om.write_image(path, om.render_image(sensor, om.Room()))
        page.set_input_files("#file", path)
        page.locator("#ask").wait_for()
    page.locator("#ask .answers button", has_text="above the camera").hover()


def measure_on_the_floor(page: Page) -> None:
    page.get_by_role("button", name="Measure", exact=True).click()
    box = page.locator("#view").bounding_box()
    for x, y in ((0.25, 0.6), (0.65, 0.8)):
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
    page.locator("#measure-plane").select_option("floor")
    page.locator("#measured", has_text="distance").wait_for()


STEPS: dict[str, tuple[str, Callable[[Page], None]]] = {
    "rim": (MODES["perspective"], fit_the_circle),
    "mirror-type": ("", ask_for_the_mirror_type),
    "export": (MODES["panorama"], open_the_export),
    "measure": ("mode=perspective&tilt=-25&hfov=80", measure_on_the_floor),
}
"""State of the view of the room, or "" for the empty page, and action of each step."""


def sheet(images: list[Image.Image], columns: int, width: int) -> Image.Image:
    """Return images of equal width (px) in rows with a number of columns."""
    scaled = [
        p.resize((width, round(p.height * width / p.width)), Image.Resampling.LANCZOS)
        for p in images
    ]
    height = max(p.height for p in scaled)
    rows = -(-len(scaled) // columns)
    contact_sheet = Image.new(
        "RGB", (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP), (128, 128, 128)
    )
    for i, image in enumerate(scaled):
        contact_sheet.paste(image, (i % columns * (width + GAP), i // columns * (height + GAP)))
    return contact_sheet


def save(image: Image.Image, name: str, folder: Path) -> None:
    """Write an image as WebP with the highest quality below the maximum file size."""
    for quality in (88, 80, 70, 60, 50):
        data = io.BytesIO()
        image.save(data, "WEBP", quality=quality, method=6)
        if data.tell() < MAX_BYTES:
            break
    (folder / f"studio-{name}.webp").write_bytes(data.getvalue())
    print(
        f"studio-{name}.webp: {image.width} x {image.height} px, {data.tell() // 1000} kB, quality {quality}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=IMAGES)
    folder = parser.parse_args().out
    executable = shutil.which("chromium") or shutil.which("chromium-headless-shell")
    with served() as address, sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        room = f"{address}#source=room&"
        for scheme in SCHEMES:
            modes = [shot(browser, room + state, scheme, LAPTOP) for state in MODES.values()]
            save(sheet(modes, 2, 800), f"views-{scheme}", folder)
        empty = [shot(browser, address, scheme, LAPTOP) for scheme in SCHEMES]
        save(sheet(empty, 2, 800), "empty", folder)
        for name, (state, act) in STEPS.items():
            start = room + state if state else address
            images = [shot(browser, start, scheme, LAPTOP, act) for scheme in SCHEMES]
            save(sheet(images, 2, 800), name, folder)
        phone = [
            shot(browser, room + MODES[mode], scheme, PHONE)
            for mode in ("perspective", "dome")
            for scheme in SCHEMES
        ]
        save(sheet(phone, 4, 360), "phone", folder)
        save(
            sheet([shot(browser, room + MODES["panorama"], "dark", LARGE)], 1, 1600),
            "large",
            folder,
        )
        browser.close()


if __name__ == "__main__":
    main()
