"""Count the interactions and seconds of four first-time users of the studio until their task is complete.

A photographer dewarps an image of a mirror ball, a student compares two mirrors of the paper, an integrator watches
four cameras, and an engineer designs a sensor from a requirement file and analyses its tolerances. Each starts with the
empty page (the integrator with the page of ``omnimirror view``). An interaction is a click, a selection, a file dialog
or a drag; seconds are wall time in a headless Chromium without a GPU. ``--pictures`` stores an image of each step, on
three screen sizes and in both themes.

    python benchmarks/first_minutes.py --out out/benchmarks --pictures out/first-minutes
"""

from __future__ import annotations

import argparse
import os
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import av
import numpy as np
from circumstances import other_load, processor
from page_load import FLAGS, served
from playwright.sync_api import Browser, Locator, Page, sync_playwright

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.cameras.frames import Mount
from omnimirror.io import write_image

SCREENS = {"1280": (1280, 800), "360": (360, 740), "2560": (2560, 1440)}
THEMES = ("light", "dark")
CAMERAS = 4
SEEN = "window.omnimirror.look.layout.places.every((place) => place.cameraFeed)"
REQUIREMENT = """\
name = "hall"

[field]
omega_max_deg = 80.0
object_distance_mm = [1000, 8000]

[mirror]
mapping = "equidistant"
rim_radius_mm = 30.0
fit = "asphere:4"

[lens]
theta_max_deg = 12.0
f_number = 8.0

[[limit]]
quantity = "total_blur_deg"
at_most = 0.8
"""


@dataclass
class Visit:
    """Session of one user on one page: interactions, and the time of each completed step."""

    page: Page
    folder: Path
    pictures: Path | None
    presses: int = 0
    steps: list[tuple[str, int, float]] = field(default_factory=list)
    begun: float = field(default_factory=time.perf_counter)

    def press(self, place: Locator) -> None:
        place.first.click()
        self.presses += 1

    def button(self, name: str, within: str = "body") -> None:
        self.press(self.page.locator(within).get_by_role("button", name=name, exact=True))

    def choose(self, label: str, value: str) -> None:
        self.page.get_by_label(label).select_option(value)
        self.presses += 1

    def file(self, place: str, path: Path) -> None:
        self.page.set_input_files(place, path)
        self.presses += 1

    def drag(self, share: float) -> None:
        """Drag the view to the left by a fraction of its width."""
        box = self.page.locator("#view").bounding_box()
        x, y = box["x"] + 0.75 * box["width"], box["y"] + 0.75 * box["height"]
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x - share * box["width"], y, steps=5)
        self.page.mouse.up()
        self.presses += 1

    def until(self, condition: str) -> None:
        self.page.wait_for_function(condition)

    def see(self, step: str) -> None:
        """Record a completed step, and save a screenshot."""
        self.steps.append((step, self.presses, time.perf_counter() - self.begun))
        if self.pictures:
            self.page.wait_for_timeout(500)  # end of animations
            self.page.screenshot(path=self.pictures / f"{len(self.steps)} {step}.png")


def photographer(visit: Visit) -> None:
    visit.see("the empty page")
    visit.file("#file", visit.folder / "ball.png")
    visit.page.locator("#ask").wait_for(state="visible")
    visit.see("prompt for the type of camera")
    visit.press(visit.page.get_by_role("button", name="A mirror ball"))
    visit.until("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
    visit.page.get_by_role("status").filter(has_text="vertical edges").wait_for()
    visit.see("own image, dewarped and levelled")
    visit.press(visit.page.locator("#modes label").filter(has_text="Perspective"))
    visit.drag(0.3)
    visit.see("panned view")
    with visit.page.expect_download():
        visit.button("Snapshot")
    visit.see("saved snapshot")


def student(visit: Visit) -> None:
    visit.button("Design", "#tabs")
    visit.page.wait_for_selector("#design .compare tbody td")
    visit.see("sphere of the paper in the design bench")
    visit.button("Pin")
    visit.choose("Start from a bundled sensor", "paper-hyperboloidal")
    visit.page.locator(".compare tbody tr").nth(1).wait_for()
    visit.see("hyperboloid of the paper added to all plots")
    visit.press(visit.page.locator(".groups label").filter(has_text="3-D view"))
    visit.until("window.omnimirror.tabs.design.plotArea.space?.view?.frames > 0")
    visit.see("rays in the 3-D view")
    visit.button("Use as camera")
    visit.until("window.omnimirror.store.state.tab === 'look' && window.omnimirror.look.feed")
    visit.see("rendered image of a room")


def integrator(visit: Visit) -> None:
    visit.until("window.omnimirror.look.feed")
    visit.see("first of four cameras")
    visit.button("All views")
    visit.until(f"window.omnimirror.look.layout.places.length === {CAMERAS} && {SEEN}")
    visit.see("four cameras side by side")
    (*_, last) = visit.page.evaluate(
        "window.omnimirror.look.layout.places.map((p) => [p.left, p.top, p.width, p.height])"
    )
    box = visit.page.locator("#view").bounding_box()
    visit.page.mouse.click(box["x"] + last[0] + last[2] / 2, box["y"] + last[1] + last[3] / 2)
    visit.presses += 1
    visit.until(f"window.omnimirror.look.feed.name === 'camera{CAMERAS}.mp4'")
    visit.press(visit.page.locator("#modes label").filter(has_text="Perspective"))
    visit.drag(0.1)
    visit.see("panned view of the last camera")
    visit.button("Copy link")
    visit.see("link to the four views")


def engineer(visit: Visit) -> None:
    visit.button("Design", "#tabs")
    visit.page.wait_for_selector("#design .compare tbody td")
    visit.file("#design-file", visit.folder / "hall.toml")
    visit.page.get_by_role("button", name="Design from requirements").wait_for()
    visit.see("requirements, and margins of the sphere")
    visit.button("Design from requirements")
    visit.page.get_by_text("All requirements are met").wait_for()
    visit.see("design that meets the requirements")
    visit.button("Pin")
    visit.see("pinned design")
    visit.button("Set errors")
    visit.page.wait_for_selector("svg.tornado rect")
    visit.see("effect of each error")


PEOPLE = (photographer, student, integrator, engineer)
Person: TypeAlias = "Callable[[Visit], None]"


def prepare(folder: Path) -> None:
    """Write the input files: a photographed mirror ball, recordings of four cameras, and a
    requirement file."""
    ball = om.MirrorBall(
        centre_px=(819.5, 760.0),
        rim_radius_px=690.0,
        field_deg=340.0,
        image_size=(1600, 1500),
        mount=Mount("forward", pitch_deg=-18.0, roll_deg=2.0),
    )
    write_image(folder / "ball.png", om.render_image(ball, om.Room(), samples=2))
    sensor = om.load_sensor("paper-spherical")
    for number in range(1, CAMERAS + 1):
        room = om.PosedScene(om.Room(), om.Pose(pan_deg=90.0 * number))
        film(folder / f"camera{number}.mp4", om.render_image(sensor, room, samples=1))
    (folder / "hall.toml").write_text(REQUIREMENT)


def film(path: Path, picture: np.ndarray) -> None:
    """Write a video of 2 s with a moving bright object."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=10)
        stream.height, stream.width, stream.pix_fmt = *picture.shape[:2], "yuv420p"
        for i in range(20):
            frame = picture.copy()
            frame[200:260, 300 + 20 * i : 360 + 20 * i] = 255
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode())


def visited(
    browser: Browser,
    address: str,
    person,
    folder: Path,
    pictures: Path | None,
    screen: str,
    theme: str,
) -> Visit:
    """Run the session of one user."""
    width, height = SCREENS[screen]
    where = pictures / person.__name__ / f"{screen}-{theme}" if pictures else None
    if where:
        where.mkdir(parents=True, exist_ok=True)
    options = {
        "viewport": {"width": width, "height": height},
        "color_scheme": theme,
        "bypass_csp": True,
    }
    page = browser.new_context(**options, permissions=["clipboard-write"]).new_page()
    page.set_default_timeout(120_000)
    visit = Visit(page, folder, where)
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    person(visit)
    page.context.close()
    return visit


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks"))
    parser.add_argument(
        "--pictures",
        type=Path,
        help="folder for screenshots of each step, on all screens and in both themes",
    )
    parser.add_argument("--people", nargs="*", default=[person.__name__ for person in PEOPLE])
    arguments = parser.parse_args()
    load = other_load()
    executable = (
        os.environ.get("CHROMIUM")
        or shutil.which("chromium")
        or shutil.which("chromium-headless-shell")
    )
    rows = []
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        prepare(folder)
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        cameras = [folder / f"camera{number}.mp4" for number in range(1, CAMERAS + 1)]
        view = ("view", *cameras, "--sensor", "paper-spherical")
        with served() as studio, served(*view) as wall:
            for person in (p for p in PEOPLE if p.__name__ in arguments.people):
                address = wall if person is integrator else studio
                visit = visited(browser, address, person, folder, None, "1280", "light")
                for step, presses, seconds in visit.steps[1 if person is photographer else 0 :]:
                    rows.append(f"| {person.__name__} | {step} | {presses} | {seconds:.1f} |")
                    print(rows[-1], flush=True)
                for screen in SCREENS if arguments.pictures else ():
                    for theme in THEMES:
                        visited(browser, address, person, folder, arguments.pictures, screen, theme)
        version = browser.version
        browser.close()
    head = (
        f"`{Path(__file__).name}` on {processor()}, {os.cpu_count()} cores, Chromium {version} without a "
        f"graphics card.{load}"
    )
    lines = [
        "# First minutes",
        "",
        head,
        "",
        "| user | result | presses | s |",
        "|---|---|---|---|",
        *rows,
    ]
    write_text(arguments.out / "first_minutes.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
