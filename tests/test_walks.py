"""Code walks of docs/architecture.md: the listed files in this order, in few packages."""

from __future__ import annotations

import re
import shutil
import sys
import threading
from collections.abc import Callable
from dataclasses import replace
from functools import _lru_cache_wrapper
from importlib import import_module
from pathlib import Path
from types import FrameType

import numpy as np
import pytest
from click.testing import CliRunner

import omnimirror as om
from omnimirror.optics.image_sensor import Imager
from tests.everyday import few

PAGE = Path(__file__).parents[1] / "docs" / "architecture.md"
MAX_PACKAGES, MAX_RETURNS = 7, 2

REQUIREMENTS = """
[field]
omega_max_deg = 130

[mirror]
rim_radius_mm = 30
family = "hyperboloid"

[lens]
kind = "perspective"
focal_length_mm = 8.0
f_number = 4.0

[imager]
width_px = 1024
height_px = 1024
pixel_pitch_um = 5.2
"""


def walks() -> dict[str, list[str]]:
    """Return the modules of each walk, as listed on the page."""
    part = PAGE.read_text().split("<!-- walks -->")[1].split("<!-- end -->")[0]
    rows = re.findall(r"^\| ([a-z ]+) \| (`.*`) \|$", part, flags=re.M)
    return {
        name: [f.removesuffix(".py").replace("/", ".") for f in re.findall(r"`([^`]+)`", files)]
        for name, files in rows
    }


def counts() -> dict[str, int]:
    """Return the documented number of modules of each walk."""
    counts_text = PAGE.read_text().split("In the order of the table it is ")[1].split(".\n")[0]
    return dict(zip(walks(), map(int, re.findall(r"\d+", counts_text)), strict=True))


def sensor_file_to_table() -> None:
    from omnimirror.apps.cli import app

    result = CliRunner().invoke(app, ["evaluate", "paper-spherical", "--omega-deg", "0:135:45"])
    assert result.exit_code == 0, result.output


def image_to_view() -> None:
    screen = om.screens.Plane(size=(64, 48), pan_deg=30, hfov_deg=60)
    om.Dewarper(om.load_sensor("paper-spherical"), screen)(np.zeros((1024, 1024, 3), np.uint8))


def requirements_to_sensor() -> None:
    from omnimirror.design import parse_requirements

    om.design_sensor(parse_requirements(REQUIREMENTS))


def scene_to_image() -> None:
    om.render_image(om.load_sensor("paper-spherical"), om.Room(texel_mm=20.0), samples=1)


def slider_to_plot() -> None:
    from omnimirror.apps.studio._design_evaluation import answer
    from omnimirror.apps.studio._design_sensors import tables_from_sensor
    from omnimirror.apps.studio.design_messages import DesignRequest

    sensor = tables_from_sensor(om.load_sensor("paper-spherical"))
    answer(
        DesignRequest(
            slot=0,
            number=0,
            tables=sensor.tables,
            follows_mapping=sensor.follows_mapping,
            object_distance_mm=None,
            include_section=True,
            include_squares=True,
            requirements=None,
        )
    )


def command(*arguments: object) -> None:
    from omnimirror.apps.cli import app

    result = CliRunner().invoke(app, [str(word) for word in arguments])
    assert result.exit_code == 0, result.output


def board_images() -> None:
    from tests.apps.studio.boards import COMPLETE_COUNT, png

    for number in range(COMPLETE_COUNT):
        Path(f"{number}.png").write_bytes(png(number))


def board_images_to_camera_file() -> None:
    images = sorted(path.name for path in Path().glob("*.png"))
    command("calibrate", *images, "--board", "7x5", "--square-mm", 40, "-o", "camera.toml")


TOLERANCES = """
[objects]
angles = 1
azimuths = 3

[[error]]
name = "lens.k1"
tolerance = 0.1

[[limit]]
quantity = "motion_px"
at_most = 1.0
"""


def tolerance_file() -> None:
    Path("tolerances.toml").write_text(TOLERANCES)


def tolerances_to_yield() -> None:
    command("tolerance", "paper-spherical", "tolerances.toml", "--trials", 50)


def small_image() -> np.ndarray:
    """Return an image of the room with 256 px."""
    sensor = om.load_sensor("prototype-hyperboloidal")
    imager = Imager(256, 256, sensor.imager.pixel_pitch_um * sensor.image_size[0] / 256)
    return om.render_image(replace(sensor, imager=imager), om.Room(texel_mm=20.0), samples=1)


def bag() -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store, image = get_typestore(Stores.ROS2_HUMBLE), small_image()
    types = store.types
    header = types["std_msgs/msg/Header"](
        stamp=types["builtin_interfaces/msg/Time"](1_700_000_000, 0), frame_id="camera"
    )
    kind = "sensor_msgs/msg/Image"
    message = types[kind](header, 256, 256, "rgb8", 0, 3 * 256, image.ravel())
    shutil.rmtree("drive", ignore_errors=True)
    with Writer(Path("drive"), version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        topic = writer.add_connection("/image_raw", kind, typestore=store)
        writer.write(topic, 1_700_000_000 * 10**9, store.serialize_cdr(message, kind))


def bag_to_dewarped_bag() -> None:
    Path("dewarped.mcap").unlink(missing_ok=True)
    command(
        "dewarp", "drive", "--ball", "128,128,120,270", "--view", "panorama", "-o", "dewarped.mcap"
    )


def photograph() -> None:
    om.write_image("photograph.png", small_image())


def unknown_photograph_to_panorama() -> None:
    command("dewarp", "photograph.png", "--auto", "--view", "panorama", "-o", "panorama.png")


def sensor_to_step() -> None:
    command("export", "paper-spherical", "-o", "workshop", "--formats", "step")


FUNCTIONS: dict[str, Callable[[], None]] = {
    "sensor file to table": sensor_file_to_table,
    "image to view": image_to_view,
    "requirements to sensor": requirements_to_sensor,
    "scene to image": scene_to_image,
    "slider to plot": slider_to_plot,
    "board images to camera file": board_images_to_camera_file,
    "tolerances to yield": tolerances_to_yield,
    "bag to dewarped bag": bag_to_dewarped_bag,
    "unknown photograph to panorama": unknown_photograph_to_panorama,
    "sensor to step": sensor_to_step,
}
INPUTS: dict[str, Callable[[], None]] = {
    "board images to camera file": board_images,
    "tolerances to yield": tolerance_file,
    "bag to dewarped bag": bag,
    "unknown photograph to panorama": photograph,
}
"""Functions that write the input files of walks."""


def modules_of(order: list[str]) -> set[str]:
    """Return the modules that docs/architecture.md counts for a walk."""
    return {module for module in order if module.split(".")[0] not in ("base", "io")}


def forget() -> None:
    """Clear caches of earlier calls in other tests, which would shorten the walk."""
    for name, module in list(sys.modules.items()):
        if name.startswith("omnimirror."):
            for member in vars(module).values():
                if isinstance(member, _lru_cache_wrapper):
                    member.cache_clear()


def entered(walk: Callable[[], None]) -> list[str]:
    """Return the modules of the package in the order of their calls, without immediate repetitions."""
    forget()
    order: list[str] = []

    def note(frame: FrameType, event: str, _: object) -> None:
        name = frame.f_globals.get("__name__", "")
        is_written = not frame.f_code.co_filename.startswith("<")  # methods of dataclasses are not
        if event == "call" and is_written and name.startswith("omnimirror."):
            short = name.removeprefix("omnimirror.")
            if not order or order[-1] != short:
                order.append(short)

    threading.setprofile(note)
    sys.setprofile(note)
    try:
        walk()
    finally:
        sys.setprofile(None)
        threading.setprofile(None)
    return order


def visited(order: list[str], files: list[str]) -> list[str]:
    """Return the listed modules that are called in this order."""
    calls = iter(order)
    return [module for module in files if module in calls]


def test_every_walk_is_executed():
    assert walks().keys() == FUNCTIONS.keys()


@pytest.mark.parametrize(
    "name", few(FUNCTIONS, *list(FUNCTIONS)[:3], "slider to plot", "tolerances to yield")
)
def test_walk_uses_documented_modules(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    files = walks()[name]
    for module in files:
        import_module(f"omnimirror.{module}")
    INPUTS.get(name, lambda: None)()
    FUNCTIONS[name]()  # fills caches and imports, as a preceding test may do
    order = entered(FUNCTIONS[name])
    assert visited(order, files) == files
    assert len(modules_of(order)) <= counts()[name]


@pytest.mark.parametrize("name", FUNCTIONS)
def test_walk_uses_limited_number_of_modules(name):
    rooms = [module.rpartition(".")[0] for module in walks()[name]]
    stays = [room for before, room in zip([None, *rooms], rooms, strict=False) if room != before]
    assert len(set(stays)) <= MAX_PACKAGES
    assert len(stays) - len(set(stays)) <= MAX_RETURNS
