"""Pictures of the studio for its documentation, taken in a headless Chromium: docs/images/studio-*.webp.

    python web/screenshots.py

Each sheet holds one view of the page in light and in dark, or all kinds of views in one of them.
"""

from __future__ import annotations

import argparse
import io
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

IMAGES = Path(__file__).parents[1] / "docs" / "images"
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
SCHEMES = ("light", "dark")
LAPTOP, PHONE, LARGE = (1280, 800), (360, 780), (3840, 2160)
GAP = 12
LARGEST = 200_000  # bytes

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
    """The address of a studio of its own."""
    words = [sys.executable, "-m", "omnimirror", "studio", "--no-open"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as server:
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
    """The page at an address, once it has drawn what it shows and something was done to it."""
    context = browser.new_context(
        viewport=dict(zip(("width", "height"), size, strict=True)),
        color_scheme=scheme,
        bypass_csp=True,
    )
    page = context.new_page()
    page.set_default_timeout(300_000)  # a busy machine takes its time
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    if "source=room" in address:
        page.wait_for_function("window.omnimirror.look.feed")
    act(page)
    page.wait_for_timeout(600)
    picture = Image.open(io.BytesIO(page.screenshot(full_page=size == PHONE))).convert("RGB")
    context.close()
    return picture


def fit_the_circle(page: Page) -> None:
    page.get_by_role("button", name="Fit circle").click()


def sheet(pictures: list[Image.Image], columns: int, width: int) -> Image.Image:
    """Pictures beside and under each other, each so wide."""
    scaled = [
        p.resize((width, round(p.height * width / p.width)), Image.Resampling.LANCZOS)
        for p in pictures
    ]
    height = max(p.height for p in scaled)
    rows = -(-len(scaled) // columns)
    whole = Image.new(
        "RGB", (columns * (width + GAP) - GAP, rows * (height + GAP) - GAP), (128, 128, 128)
    )
    for i, picture in enumerate(scaled):
        whole.paste(picture, (i % columns * (width + GAP), i // columns * (height + GAP)))
    return whole


def save(picture: Image.Image, name: str, folder: Path) -> None:
    """As WebP, as good as its size allows."""
    for quality in (88, 80, 70, 60, 50):
        data = io.BytesIO()
        picture.save(data, "WEBP", quality=quality, method=6)
        if data.tell() < LARGEST:
            break
    (folder / f"studio-{name}.webp").write_bytes(data.getvalue())
    print(
        f"studio-{name}.webp: {picture.width} x {picture.height} px, {data.tell() // 1000} kB, quality {quality}"
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
        rim = [
            shot(browser, room + MODES["perspective"], scheme, LAPTOP, fit_the_circle)
            for scheme in SCHEMES
        ]
        save(sheet(rim, 2, 800), "rim", folder)
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
