"""Tilted sensors: their views, and levelling by dragging the horizon."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras.camera import Mount
from omnimirror.io import write_image

from .browser import command, coordinates, drop, open_page, set_state
from .images import pattern, python_view

SIZE = (120, 90)
TILT = {"pitch": 6.0, "roll": -4.0}


@pytest.fixture
def page(browser, server, tmp_path):
    write_image(tmp_path / "picture.png", pattern((1024, 1024)))
    page = open_page(browser, server, 920, 500, reduced_motion="reduce")
    drop(page, tmp_path / "picture.png")
    page.wait_for_selector("#view:visible")
    yield page
    assert page.problems == []
    page.context.close()


def tilted_sensor(pitch: float, roll: float) -> om.Sensor:
    return replace(om.load_sensor("paper-spherical"), mount=Mount(pitch_deg=pitch, roll_deg=roll))


def mount_of(page) -> tuple[float, float]:
    mount = page.evaluate("window.omnimirror.look.sensor.camera.model.mount")
    return mount["pitch_deg"], mount["roll_deg"]


def wait_for_tilt(page) -> None:
    """Wait until the server camera has the tilt of the dragged one."""
    page.wait_for_function("""() => {
      const { look: { sensor }, store: { state } } = window.omnimirror;
      return sensor.camera === sensor.loadedCamera && state.pitch === sensor.camera.model.mount.pitch_deg
        && state.roll === sensor.camera.model.mount.roll_deg;
    }""")


def screen_position(page, pan: float, tilt: float) -> list[float]:
    """Return the screen position of a direction in the displayed panorama."""
    return page.evaluate(
        """([pan, tilt]) => {
          const { look, store: { state } } = window.omnimirror;
          const { tilt_min_deg: low, tilt_max_deg: high } = look.sensor.camera.model;
          const box = document.querySelector("#view").getBoundingClientRect();
          const x = (((pan - state.pan) / 360 + 1.5) % 1);
          return [box.left + x * box.width, box.top + ((high - tilt) / (high - low)) * box.height];
        }""",
        [pan, tilt],
    )


@pytest.mark.full
@pytest.mark.parametrize("mode", ["panorama", "perspective"])
def test_views_of_tilted_sensor_match_command_line(mode, page, tmp_path):
    set_state(page, mode=mode, pan=40.0, hfov=70.0, **TILT)
    wait_for_tilt(page)
    line = command(page, *SIZE)
    assert "--set camera.level=6,-4" in line
    result, expected = coordinates(page, *SIZE), python_view(line, tmp_path).coordinates(exact=True)
    is_finite = np.isfinite(result[..., 0]) & np.isfinite(expected[..., 0])
    assert is_finite.mean() > 0.5
    assert np.linalg.norm(result - expected, axis=-1)[is_finite].max() < 0.02


@pytest.mark.long
def test_dragging_horizon_levels_tilted_sensor(page):
    """Points on the horizon of a tilted image are dragged to the line, twice ahead and to the
    right."""
    button = page.get_by_role("button", name="Drag horizon")
    button.click()
    page.wait_for_selector("#horizon:visible")
    truth = tilted_sensor(**TILT)
    for pan in (0.0, 90.0, 0.0, 90.0):
        direction = np.array([np.cos(np.radians(pan)), -np.sin(np.radians(pan)), 0.0])
        pixel = truth.project_directions(direction[None]).pixels  # horizon in the image
        view_direction = (
            tilted_sensor(*mount_of(page)).backproject(pixel).directions[0]
        )  # and in the current view
        pan_tilt = np.degrees(
            [np.arctan2(-view_direction[1], view_direction[0]), np.arcsin(view_direction[2])]
        )
        start, end = screen_position(page, *pan_tilt), screen_position(page, pan_tilt[0], 0.0)
        page.mouse.move(*start)
        page.mouse.down()
        for fraction in (0.3, 0.7, 1.0):
            page.mouse.move(*(np.array(start) + fraction * (np.array(end) - start)))
        page.mouse.up()
        wait_for_tilt(page)
    assert mount_of(page) == (
        pytest.approx(TILT["pitch"], abs=0.1),
        pytest.approx(TILT["roll"], abs=0.1),
    )
    state = page.evaluate("window.omnimirror.store.state")
    assert (state["pan"], state["tilt"]) == (0, 0)
    assert float(page.locator("#pitch").input_value()) == state["pitch"]
    arguments = shlex.split(command(page, *SIZE))
    assert f"camera.level={state['pitch']:g},{state['roll']:g}" in arguments
    page.wait_for_function("location.hash.includes('pitch=')")
    page.get_by_role("button", name="Reset tilt").click()
    page.wait_for_function("window.omnimirror.store.state.pitch === 0")
    wait_for_tilt(page)
    assert mount_of(page) == (0, 0)
    button.click()
    page.wait_for_selector("#horizon", state="hidden")


def test_cancel_restores_tilt_before_dragging(page):
    """Dragging by 8 deg is confirmed, then repeated and cancelled."""
    bar = page.get_by_role("region", name="Level")
    for end in ("Done", "Cancel"):
        page.get_by_role("button", name="Drag horizon").click()
        page.wait_for_selector("#horizon:visible")
        before = page.evaluate("window.omnimirror.store.state.pitch")
        page.mouse.move(*screen_position(page, 0.0, -12.0))
        page.mouse.down()
        page.mouse.move(*screen_position(page, 0.0, -4.0))
        page.mouse.up()
        page.wait_for_function("(p) => window.omnimirror.store.state.pitch !== p", arg=before)
        bar.get_by_text("Pitch ").wait_for()
        bar.get_by_role("button", name=end).click()
        bar.wait_for(state="hidden")
        page.wait_for_selector("#horizon", state="hidden")
    page.wait_for_function("(p) => window.omnimirror.store.state.pitch === p", arg=before)
    assert before == pytest.approx(8.0, abs=0.7)
    wait_for_tilt(page)
    assert mount_of(page)[0] == before


def test_horizon_line_is_at_horizon(page):
    page.get_by_role("button", name="Drag horizon").click()
    set_state(page, mode="perspective", tilt=10.0, hfov=60.0)
    page.wait_for_function("""() => {
      const view = document.querySelector("#view").getBoundingClientRect();
      const line = document.querySelector("#horizon").getBoundingClientRect();
      const focal = view.width / 2 / Math.tan(Math.PI / 6);
      const wanted = view.top + view.height / 2 + focal * Math.tan(Math.PI / 18);
      return line.width > 0 && Math.abs(line.top - wanted) < 2;
    }""")


@pytest.mark.full
def test_tilt_is_estimated_from_vertical_edges(page, tmp_path):
    """Room image of a tilted sensor, compared with the simulated tilt."""
    write_image(
        tmp_path / "leaned.png",
        om.render_image(tilted_sensor(**TILT), om.Room(texel_mm=15.0), samples=1),
    )
    drop(page, tmp_path / "leaned.png")
    page.wait_for_function("window.omnimirror.look.level.current?.feed.name === 'leaned.png'")
    page.get_by_role("button", name="Find level").click()
    page.wait_for_function("window.omnimirror.store.state.pitch !== null")
    wait_for_tilt(page)
    assert mount_of(page) == (
        pytest.approx(TILT["pitch"], abs=0.3),
        pytest.approx(TILT["roll"], abs=0.3),
    )
    page.get_by_role("status").filter(has_text="vertical edges").wait_for()


def test_too_few_vertical_edges(page):
    set_state(page, sensor="paper-hyperboloidal")
    page.wait_for_function(
        "window.omnimirror.look.level.current?.camera.model.id === 'paper-hyperboloidal'"
    )
    page.get_by_role("button", name="Find level").click()
    page.get_by_role("status").filter(has_text="too few vertical edges").wait_for()
