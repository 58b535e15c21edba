"""Count the clicks in the studio from an unknown image or video to its upright panorama.

The inputs are renderings of mirrors and mirror balls, videos of some of them, and photographs in a
folder (``--photographs``, with the subfolders ``mirrorball``, ``kaidan_omni``, ``omnidir_sample``
and ``ocamcalib_cpp_sample``). The simulated user confirms an uncertain outline, or corrects its
centre and edge by dragging if an error exceeds 3 % of the radius, and then selects the type of
mirror by its thumbnail. Opening the file is not counted; a drag counts as a click.

A panorama is upright if its vertical agrees with that of a reference dewarp within 15 deg (median
over the panorama up to 60 deg of elevation). The reference is the camera of the rendering, or the
known circle and field of the photograph, levelled by its vertical edges if these are reliable.

    python benchmarks/first_minutes.py -o out/benchmarks --photographs DATA
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import av
import numpy as np
from measurement_conditions import load_warning, processor_name
from page_load import FLAGS, chromium_path, start_studio
from playwright.sync_api import Browser, Page, sync_playwright

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.calibration.levelling import level_from_image
from omnimirror.cameras.camera import Mount
from omnimirror.io import read_image, write_image
from omnimirror.optics.image_sensor import Imager

MAX_CLICKS, MAX_CLICKS_MANUAL, SHARE = 3, 6, 0.9
MAX_TILT_DEG = 15.0
MAX_ELEVATION_DEG = 60.0
CIRCLE_TOLERANCE = 0.03  # fraction of the radius
TYPES = {  # names of the thumbnails
    "level ball": "Mirror ball camera level",
    "ball from above": "Mirror ball camera above it",
    "dome": "Mirror dome on the ceiling",
    "convex mirror": "Convex mirror on a wall or pole",
    "mirror above": "Panorama mirror above the camera",
    "mirror below": "Panorama mirror below the camera",
}
BALLS = {"fire_hydrant": "ball from above", "store": "dome", "store_hardware": "dome",
         "security_camera": "dome"}  # all others are level  # fmt: skip
LOOKS = {"level ball": "forward", "ball from above": "down", "dome": "up",
         "convex mirror": "forward", "mirror above": "up", "mirror below": "down"}  # fmt: skip
PANORAMA_SIZE = (90, 30)
COORDINATES = f"""async () => {{
  const {{ look }} = window.omnimirror;
  const {{ view }} = look.viewIn({PANORAMA_SIZE[0]}, {PANORAMA_SIZE[1]});
  const values = [...(await look.renderer.coordinates(view))];
  look.refresh();
  return [view.width, view.height, values];
}}"""
IS_ASKING = (
    """() => !document.querySelector("#ask").hidden || !document.querySelector("#fit").hidden"""
)
IS_IDLE = (
    """() => document.querySelector("#busy").hidden && document.querySelector("#ask").hidden"""
)
SCREEN_OF_PIXEL = """(pixels) => {
  const matrix = document.querySelector("#overlay").getScreenCTM();
  return pixels.map(([u, v]) => {
    const { x, y } = new DOMPoint(u, v).matrixTransform(matrix);
    return [x, y];
  });
}"""


@dataclass(frozen=True)
class Case:
    """Image or video with its reference camera."""

    path: Path
    type: str
    camera: Any
    circle: tuple[float, float, float]
    """Centre and radius of the mirror outline, px."""


@dataclass(frozen=True)
class Outcome:
    """Clicks until the panorama was upright, and its deviation from the reference."""

    name: str
    type: str
    is_corrected: bool
    clicks: int
    tilt_deg: float

    @property
    def is_upright(self) -> bool:
        return self.tilt_deg <= MAX_TILT_DEG

    @property
    def row(self) -> str:
        outline = "corrected" if self.is_corrected else "detected"
        return (
            f"| {self.name} | {self.type} | {outline} | {self.clicks} | {self.tilt_deg:.1f} | "
            f"{'yes' if self.is_upright else 'no'} |"
        )


# -- Inputs ----------------------------------------------------------------------------------------


def ball_case(path: Path, kind: str, circle, field_deg: float, size, **tilt: float) -> Case:
    ball = om.MirrorBall(
        centre_px=circle[:2],
        rim_radius_px=circle[2],
        field_deg=field_deg,
        image_size=size,
        mount=Mount(LOOKS[kind], **tilt),
    )
    return Case(path, kind, ball, circle)


def rendered_cases(folder: Path) -> Iterator[Case]:
    """Render images of mirrors off the image centre, in a room."""
    size = (800, 640)
    names = ("paper-spherical", "paper-hyperboloidal", "paper-equidistant",
             "paraboloid-telecentric", "prototype-hyperboloidal", "prototype-spherical")  # fmt: skip
    sensors = [(name, "mirror above") for name in names]
    sensors += [("paper-hyperboloidal", "mirror below"), ("prototype-spherical", "mirror below")]
    for number, (name, kind) in enumerate(sensors):
        sensor = om.load_sensor(name)
        circle = 405.0 + 5 * number, 330.0 - 6 * number, 235.0 + 5 * number
        pitch_um = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / circle[2]
        mount = replace(sensor.mount, camera_looks=LOOKS[kind])
        camera = replace(sensor, imager=Imager(*size, pitch_um, circle[:2]), mount=mount)
        yield Case(folder / f"{name} {LOOKS[kind]}.png", kind, camera, circle)
    balls = [
        ("level ball", 340.0, -12.0, 2.0),
        ("level ball", 300.0, 6.0, -3.0),
        ("dome", 260.0, 0.0, 0.0),
        ("dome", 220.0, 3.0, 2.0),
        ("ball from above", 330.0, 0.0, 0.0),
        ("convex mirror", 160.0, -5.0, 0.0),
    ]
    for number, (kind, field_deg, pitch_deg, roll_deg) in enumerate(balls):
        circle = 390.0 + 7 * number, 315.0 + 4 * number, 250.0 - 8 * number
        path = folder / f"{kind} {field_deg:g} deg.png"
        tilt = {"pitch_deg": pitch_deg, "roll_deg": roll_deg}
        yield ball_case(path, kind, circle, field_deg, size, **tilt)


def write_rendering(case: Case) -> np.ndarray:
    """Render the image of a case, and write it unless it is a video."""
    image = om.render_image(case.camera, om.Room(), samples=1)
    if case.path.suffix == ".png":
        write_image(case.path, image)
    return image


def write_video(path: Path, image: np.ndarray) -> None:
    """Write a WebM video of 2 s with a moving bright object."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libvpx", rate=10)
        stream.height, stream.width, stream.pix_fmt = *image.shape[:2], "yuv420p"
        stream.bit_rate = 4_000_000
        for i in range(20):
            frame = image.copy()
            frame[300:320, 300 + 5 * i : 320 + 5 * i] = 255
            out.mux(stream.encode(av.VideoFrame.from_ndarray(frame, format="rgb24")))
        out.mux(stream.encode())


def photographs(folder: Path) -> Iterator[Case]:
    """Yield the photographs of mirror balls and panorama mirrors."""
    entries = json.loads((folder / "mirrorball" / "crops_and_fov.json").read_text())
    for name, entry in entries.items():
        kind = BALLS.get(Path(name).stem, "level ball")
        crop, (width, height) = entry["crop_px"], entry["size"]
        left, right = crop["left"], width - crop["right"]
        top, bottom = crop["top"], height - crop["bottom"]
        circle = (
            (left + right - 1) / 2,
            (top + bottom - 1) / 2,
            (right - left + bottom - top) / 4,
        )
        path = folder / "mirrorball" / name
        case = ball_case(path, kind, circle, entry["sphere_fov_deg"], (width, height))
        level = level_from_image(
            read_image(path), case.camera, case.camera.mount, circle[:2], circle[2]
        )
        if level is not None and level.is_reliable:
            mount = replace(case.camera.mount, pitch_deg=level.pitch_deg, roll_deg=level.roll_deg)
            case = replace(case, camera=replace(case.camera, mount=mount))
        yield case
    panoramas = [
        ("kaidan_omni/KaidanOmni1.jpg", (325.0, 247.0, 223.0), (640, 480)),
        ("omnidir_sample/8.jpg", (630.0, 436.0, 529.0), (1280, 960)),
        ("ocamcalib_cpp_sample/test_catadioptric.jpg", (517.0, 384.0, 452.0), (1024, 768)),
    ]
    for name, circle, size in panoramas:
        sensor = om.load_sensor("exact-equidistant")
        pitch_um = sensor.imager.pixel_pitch_um * sensor.rim_radius_px / circle[2]
        camera = replace(sensor, imager=Imager(*size, pitch_um, circle[:2]))
        yield Case(folder / name, "mirror above", camera, circle)


# -- Sessions --------------------------------------------------------------------------------------


def tilt_of(page: Page, camera: Any) -> float:
    """Return the median angle between the verticals of the panorama and the reference, deg."""
    width, height, values = page.evaluate(COORDINATES)
    coordinates = np.reshape(values, (height, width, 4))
    rays = camera.backproject(coordinates[..., :2].reshape(-1, 2).astype(float))
    directions = rays.directions.reshape(height, width, 3)
    visible = (coordinates[..., 2] > 0.5) & rays.valid.reshape(height, width)
    upper, lower = directions[:-1], directions[1:]
    usable = (
        visible[:-1] & visible[1:] & (abs(upper[..., 2]) < np.sin(np.radians(MAX_ELEVATION_DEG)))
    )
    displayed_down = (lower - upper)[usable]
    middle = (lower + upper)[usable]
    middle /= np.linalg.norm(middle, axis=1)[:, None]
    down = np.array([0.0, 0.0, -1.0]) + middle[:, 2:] * middle
    cosine = np.sum(displayed_down * down, axis=1) / (
        np.linalg.norm(displayed_down, axis=1) * np.linalg.norm(down, axis=1)
    )
    return float(np.degrees(np.median(np.arccos(np.clip(cosine, -1, 1)))))


def correct_circle(page: Page, case: Case) -> int:
    """Drag centre and edge to the mirror if an error is visible; return the number of clicks."""
    u, v, radius = page.evaluate("window.omnimirror.store.state.rim")
    errors = np.subtract((u, v, radius), case.circle)
    if np.abs(errors).max() < CIRCLE_TOLERANCE * case.circle[2]:
        return 0
    drag(page, (u, v), case.circle[:2])
    half = np.sqrt(0.5)
    u, v, radius = page.evaluate("window.omnimirror.store.state.rim")
    edge = u + half * radius, v + half * radius
    target = case.circle[0] + half * case.circle[2], case.circle[1] + half * case.circle[2]
    drag(page, edge, target)
    return 2


def drag(page: Page, start, end) -> None:
    """Drag from one image pixel to another."""
    (x, y), target = page.evaluate(SCREEN_OF_PIXEL, [list(start), list(end)])
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(*target, steps=4)
    page.mouse.up()


def run_case(browser: Browser, address: str, case: Case) -> Outcome:
    """Open an image on an empty page, and answer the questions."""
    context = browser.new_context(
        viewport={"width": 1280, "height": 800}, bypass_csp=True, device_scale_factor=0.5
    )
    page = context.new_page()
    page.set_default_timeout(120_000)
    page.goto(address)
    page.wait_for_function("window.omnimirror?.look.sensor.camera")
    page.set_input_files("#file", case.path)
    page.wait_for_function(IS_ASKING)
    clicks, is_corrected = 0, False
    if page.locator("#fit").is_visible():
        corrections = correct_circle(page, case)
        is_corrected = corrections > 0
        page.click("#fit-done")
        clicks += corrections + 1
    page.locator("#ask").wait_for(state="visible")
    page.locator("#ask .answers").get_by_role("button", name=TYPES[case.type]).click()
    clicks += 1
    page.mouse.move(2, 2)
    page.wait_for_timeout(500)
    page.wait_for_function(IS_IDLE)
    tilt_deg = tilt_of(page, case.camera)
    if tilt_deg > MAX_TILT_DEG and not is_corrected:  # the detected outline is wrong
        page.click("#adjust")
        clicks += 2 + correct_circle(page, case)
        is_corrected = True
        page.click("#fit-done")
        page.wait_for_timeout(500)
        tilt_deg = tilt_of(page, case.camera)
    context.close()
    return Outcome(case.path.name, case.type, is_corrected, clicks, tilt_deg)


def report(outcomes: list[Outcome]) -> str:
    """Return the summary of all cases."""
    quick = [o.is_upright and o.clicks <= MAX_CLICKS for o in outcomes]
    possible = [o.is_upright and o.clicks <= MAX_CLICKS_MANUAL for o in outcomes]
    return (
        f"Upright within {MAX_CLICKS} clicks: {sum(quick)} of {len(quick)} "
        f"({np.mean(quick):.0%}, required {SHARE:.0%}); within {MAX_CLICKS_MANUAL} clicks with "
        f"manual correction of the outline: {sum(possible)} of {len(possible)}."
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--photographs", type=Path, help="folder of photographs")
    parser.add_argument("--names", nargs="*", help="cases to run; all by default")
    arguments = parser.parse_args()
    load_note = load_warning()
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        cases = list(rendered_cases(folder))
        cases += [
            replace(case, path=case.path.with_suffix(".webm")) for case in cases[:10:3]
        ]  # four videos
        cases += list(photographs(arguments.photographs)) if arguments.photographs else []
        browser = playwright.chromium.launch(executable_path=chromium_path(), args=FLAGS)
        outcomes = []
        with start_studio() as address:
            for case in cases:
                if arguments.names and not any(n in case.path.name for n in arguments.names):
                    continue
                if case.path.parent == folder:
                    image = write_rendering(case)
                    if case.path.suffix == ".webm":
                        write_video(case.path, image)
                outcomes.append(run_case(browser, address, case))
                print(outcomes[-1].row, flush=True)
        version = browser.version
        browser.close()
    header = (
        f"`{Path(__file__).name}` on {processor_name()}, {os.cpu_count()} cores, Chromium "
        f"{version} without a GPU.{load_note}"
    )
    lines = [
        "# First image",
        "",
        header,
        "",
        report(outcomes),
        "",
        "| image or video | mirror | outline | clicks | deviation of the vertical, deg | upright |",
        "|---|---|---|---|---|---|",
        *(outcome.row for outcome in outcomes),
    ]
    print(report(outcomes))
    write_text(arguments.output / "first_minutes.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
