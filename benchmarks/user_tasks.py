"""Count the interactions and seconds of four first-time users of the studio until their task is complete.

A photographer dewarps an image of a mirror ball, a student compares two mirrors of the paper, an
integrator watches four cameras, and an engineer designs a sensor from a requirement file and
analyses its tolerances. Each starts with the empty page (the integrator with the page of
``omnimirror view``). An interaction is a click, a selection, a file dialog or a drag; seconds are
wall time in a headless Chromium without a GPU. ``--screenshots`` stores an image of each step, on
three screen sizes and in both themes.

    python benchmarks/user_tasks.py -o out/benchmarks --screenshots out/user-tasks
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

import av
import numpy as np
from measurement_conditions import load_warning, processor_name
from page_load import FLAGS, chromium_path, start_studio
from playwright.sync_api import Browser, Locator, Page, sync_playwright

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.cameras.camera import Mount
from omnimirror.io import write_image

SCREENS = {"1280": (1280, 800), "360": (360, 740), "2560": (2560, 1440)}
THEMES = ("light", "dark")
CAMERA_COUNT = 4
ALL_VISIBLE = "window.omnimirror.look.layout.places.every((place) => place.cameraFeed)"
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
class Session:
    """Session of one user on one page: interactions, and the time of each completed step."""

    page: Page
    folder: Path
    screenshots: Path | None
    interactions: int = 0
    steps: list[tuple[str, int, float]] = field(default_factory=list)
    start_s: float = field(default_factory=time.perf_counter)

    def click(self, locator: Locator) -> None:
        locator.first.click()
        self.interactions += 1

    def button(self, name: str, within: str = "body") -> None:
        self.click(self.page.locator(within).get_by_role("button", name=name, exact=True))

    def select(self, label: str, value: str) -> None:
        self.page.get_by_label(label).select_option(value)
        self.interactions += 1

    def select_file(self, locator: str, path: Path) -> None:
        self.page.set_input_files(locator, path)
        self.interactions += 1

    def drag(self, fraction: float) -> None:
        """Drag the view to the left by a fraction of its width."""
        box = self.page.locator("#view").bounding_box()
        x, y = box["x"] + 0.75 * box["width"], box["y"] + 0.75 * box["height"]
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(x - fraction * box["width"], y, steps=5)
        self.page.mouse.up()
        self.interactions += 1

    def wait_until(self, condition: str) -> None:
        self.page.wait_for_function(condition)

    def complete_step(self, step: str) -> None:
        """Record a completed step, and save a screenshot."""
        self.steps.append((step, self.interactions, time.perf_counter() - self.start_s))
        if self.screenshots:
            self.page.wait_for_timeout(500)  # end of animations
            self.page.screenshot(path=self.screenshots / f"{len(self.steps)} {step}.png")


def photographer(session: Session) -> None:
    session.complete_step("the empty page")
    session.select_file("#file", session.folder / "ball.png")
    session.page.locator("#ask").wait_for(state="visible")
    session.complete_step("views of the image with each type of mirror")
    session.click(session.page.get_by_role("button", name="Mirror ball camera level"))
    session.wait_until("window.omnimirror.look.sensor.camera.model.id === 'ball:340'")
    session.page.locator("#notice.shown").filter(has_text="vertical edges").wait_for()
    session.complete_step("own image, dewarped and levelled")
    session.click(session.page.locator("#modes label").filter(has_text="Perspective"))
    session.drag(0.3)
    session.complete_step("panned view")
    with session.page.expect_download():
        session.button("Snapshot")
    session.complete_step("saved snapshot")


def student(session: Session) -> None:
    session.button("Design", "#tabs")
    session.page.wait_for_selector("#design .compare tbody td")
    session.complete_step("sphere of the paper in the Design tab")
    session.button("Pin")
    session.select("Start from a bundled sensor", "paper-hyperboloidal")
    session.page.locator(".compare tbody tr").nth(1).wait_for()
    session.complete_step("hyperboloid of the paper added to all plots")
    session.click(session.page.locator(".groups label").filter(has_text="3-D view"))
    session.wait_until("window.omnimirror.tabs.design.plotArea.space?.view?.frames > 0")
    session.complete_step("rays in the 3-D view")
    session.button("Use as camera")
    session.wait_until(
        "window.omnimirror.store.state.tab === 'look' && window.omnimirror.look.feed"
    )
    session.complete_step("rendered image of a room")


def integrator(session: Session) -> None:
    session.wait_until("window.omnimirror.look.feed")
    session.complete_step("first of four cameras")
    session.button("All views")
    session.wait_until(
        f"window.omnimirror.look.layout.places.length === {CAMERA_COUNT} && {ALL_VISIBLE}"
    )
    session.complete_step("four cameras side by side")
    (*_, last) = session.page.evaluate(
        "window.omnimirror.look.layout.places.map((p) => [p.left, p.top, p.width, p.height])"
    )
    box = session.page.locator("#view").bounding_box()
    session.page.mouse.click(box["x"] + last[0] + last[2] / 2, box["y"] + last[1] + last[3] / 2)
    session.interactions += 1
    session.wait_until(f"window.omnimirror.look.feed.name === 'camera{CAMERA_COUNT}.mp4'")
    session.click(session.page.locator("#modes label").filter(has_text="Perspective"))
    session.drag(0.1)
    session.complete_step("panned view of the last camera")
    session.button("Copy link")
    session.complete_step("link to the four views")


def engineer(session: Session) -> None:
    session.button("Design", "#tabs")
    session.page.wait_for_selector("#design .compare tbody td")
    session.select_file("#design-file", session.folder / "hall.toml")
    session.page.get_by_role("button", name="Design from requirements").wait_for()
    session.complete_step("requirements, and margins of the sphere")
    session.button("Design from requirements")
    session.page.get_by_text("All requirements are met").wait_for()
    session.complete_step("design that meets the requirements")
    session.button("Pin")
    session.complete_step("pinned design")
    session.button("Analyse tolerances")
    session.page.wait_for_selector("svg.tornado rect")
    session.complete_step("effect of each error")


USERS = (photographer, student, integrator, engineer)
User: TypeAlias = "Callable[[Session], None]"


def write_inputs(folder: Path) -> None:
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
    for number in range(1, CAMERA_COUNT + 1):
        room = om.PosedScene(om.Room(), om.Pose(pan_deg=90.0 * number))
        write_video(folder / f"camera{number}.mp4", om.render_image(sensor, room, samples=1))
    (folder / "hall.toml").write_text(REQUIREMENT)


def write_video(path: Path, image: np.ndarray) -> None:
    """Write a video of 2 s with a moving bright object."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=10)
        stream.height, stream.width, stream.pix_fmt = *image.shape[:2], "yuv420p"
        for i in range(20):
            frame = image.copy()
            frame[200:260, 300 + 20 * i : 360 + 20 * i] = 255
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode())


def run_session(
    browser: Browser,
    address: str,
    user,
    folder: Path,
    screenshots: Path | None,
    screen: str,
    theme: str,
) -> Session:
    """Run the session of one user."""
    width, height = SCREENS[screen]
    screenshot_folder = screenshots / user.__name__ / f"{screen}-{theme}" if screenshots else None
    if screenshot_folder:
        screenshot_folder.mkdir(parents=True, exist_ok=True)
    options = {
        "viewport": {"width": width, "height": height},
        "color_scheme": theme,
        "bypass_csp": True,
    }
    page = browser.new_context(**options, permissions=["clipboard-write"]).new_page()
    page.set_default_timeout(120_000)
    session = Session(page, folder, screenshot_folder)
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    user(session)
    page.context.close()
    return session


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument(
        "--screenshots",
        type=Path,
        help="folder for screenshots of each step, on all screens and in both themes",
    )
    parser.add_argument("--users", nargs="*", default=[user.__name__ for user in USERS])
    arguments = parser.parse_args()
    load_note = load_warning()
    rows = []
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        write_inputs(folder)
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        cameras = [folder / f"camera{number}.mp4" for number in range(1, CAMERA_COUNT + 1)]
        view = ("view", *cameras, "--sensor", "paper-spherical")
        with start_studio() as studio, start_studio(*view) as multi_camera:
            for user in (p for p in USERS if p.__name__ in arguments.users):
                address = multi_camera if user is integrator else studio
                session = run_session(browser, address, user, folder, None, "1280", "light")
                for step, interactions, seconds in session.steps[
                    1 if user is photographer else 0 :
                ]:
                    rows.append(f"| {user.__name__} | {step} | {interactions} | {seconds:.1f} |")
                    print(rows[-1], flush=True)
                for screen in SCREENS if arguments.screenshots else ():
                    for theme in THEMES:
                        run_session(
                            browser, address, user, folder, arguments.screenshots, screen, theme
                        )
        version = browser.version
        browser.close()
    header = (
        f"`{Path(__file__).name}` on {processor_name()}, {os.cpu_count()} cores, Chromium "
        f"{version} without a GPU.{load_note}"
    )
    lines = [
        "# User tasks",
        "",
        header,
        "",
        "| user | completed step | interactions | time, s |",
        "|---|---|---|---|",
        *rows,
    ]
    write_text(arguments.output / "user_tasks.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
