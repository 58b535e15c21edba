"""Measurement of angles and distances in the tab Look, compared with exact directions."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio._look_cameras import Cameras
from omnimirror.apps.studio.app import create_app
from omnimirror.base.parameters import Uncertainty
from omnimirror.io import write_image
from omnimirror.optics.sensor_files import save_sensor

from .browser import drop, open_page, set_state
from .images import pattern

PAN_DEG, TILT_DEG, HFOV_DEG = 20.0, -30.0, 80.0


@pytest.fixture
def page(browser, server, tmp_path):
    write_image(tmp_path / "picture.png", pattern((1024, 1024)))
    page = open_page(browser, server, 920, 700, reduced_motion="reduce", device_scale_factor=1)
    drop(page, tmp_path / "picture.png")
    page.wait_for_selector("#view:visible")
    set_state(page, mode="perspective", pan=PAN_DEG, tilt=TILT_DEG, hfov=HFOV_DEG)
    page.get_by_role("button", name="Measure", exact=True).click()
    page.locator("#measure-bar").wait_for()
    yield page
    assert page.problems == []
    page.context.close()


def directions_at(page, positions: np.ndarray) -> np.ndarray:
    """Return unit directions (n, 3) at positions on the screen, by the formula of the pinhole."""
    box = page.locator("#view").bounding_box()
    size = np.array([box["width"], box["height"]])
    x, y = (positions - [box["x"], box["y"]] - size / 2).T / (
        size[0] / 2 / np.tan(np.radians(HFOV_DEG / 2))
    )
    pan, tilt = np.radians([PAN_DEG, TILT_DEG])
    forward = np.array([np.cos(tilt) * np.cos(pan), -np.cos(tilt) * np.sin(pan), np.sin(tilt)])
    right = np.array([-np.sin(pan), -np.cos(pan), 0.0])
    directions = forward + x[:, None] * right + y[:, None] * np.cross(forward, right)
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def angle_deg(directions: np.ndarray) -> float:
    return float(np.degrees(np.arccos(directions[0] @ directions[1])))


def wait_for_result(page, pattern: str) -> re.Match[str]:
    """Wait for a result that matches, and return the match."""
    page.locator("#measured", has_text=re.compile(pattern)).wait_for()
    return re.search(pattern, page.locator("#measured").inner_text())


def wait_for_value(page, name: str, value: float, tolerance: float) -> None:
    """Wait for a result near the expected one."""
    page.wait_for_function(
        """([name, value, tolerance]) => {
          const [, number] = document.querySelector("#measured").textContent.split(`${name} `);
          return Math.abs(parseFloat(number) - value) < tolerance;
        }""",
        arg=[name, value, tolerance],
    )


def floor_distance(directions: np.ndarray, height: float) -> float:
    """Return the distance on the floor of the rays that have given directions."""
    sensor = om.load_sensor("paper-spherical")
    rays = sensor.backproject(sensor.project_directions(directions).pixels)
    lengths = (-height - rays.origins[:, 2]) / rays.directions[:, 2]
    points = rays.origins + lengths[:, None] * rays.directions
    return float(np.linalg.norm(points[1] - points[0]))


def handle_positions(page) -> np.ndarray:
    boxes = [page.locator("#measurement circle").nth(i).bounding_box() for i in (0, 1)]
    return np.array([[b["x"] + b["width"] / 2, b["y"] + b["height"] / 2] for b in boxes])


def test_two_points_are_measured(page):
    """Directions follow from the screen positions; a floor distance from their intersections."""
    box = page.locator("#view").bounding_box()
    corner, size = np.array([box["x"], box["y"]]), np.array([box["width"], box["height"]])
    positions = np.round(corner + np.array([[0.25, 0.6], [0.7, 0.75]]) * size)
    directions = directions_at(page, positions)
    for x, y in positions:
        page.mouse.click(x, y)
    wait_for_value(page, "Angle", angle_deg(directions), 0.05)
    page.wait_for_function("document.querySelector('#measurement text').textContent")
    np.testing.assert_allclose(handle_positions(page), positions, atol=0.2)
    page.locator("#measure-plane").select_option("floor")
    for height in (1200.0, 2400.0):
        page.locator("#measure-mm").fill(str(height))
        page.locator("#measure-mm").press("Tab")
        expected = floor_distance(directions, height)
        wait_for_value(page, "distance", expected, 0.005 * expected)
    wait_for_result(page, "uncertainty is known in the field of calibrated cameras only")
    page.locator("#measure-plane").select_option("wall")
    assert page.locator("#measure-pan").input_value() == f"{PAN_DEG:.1f}"
    page.locator("#measure-done").click()
    page.wait_for_selector("#measure-bar", state="hidden")
    assert page.locator("#measurement path").is_visible()


def test_points_are_added_and_moved_by_keyboard(page):
    page.keyboard.press("Tab")
    for _ in range(2):
        page.locator("#measure-add").press("Enter")
    page.wait_for_function("document.activeElement.ariaLabel.startsWith('Point 2')")
    before = float(wait_for_result(page, r"Angle ([\d.]+)°")[1])
    positions = handle_positions(page)
    assert before == pytest.approx(angle_deg(directions_at(page, positions)), abs=0.1)
    for _ in range(4):
        page.keyboard.press("Shift+ArrowRight")
    page.keyboard.press("ArrowUp")
    positions[1] += [40, -1]
    expected = angle_deg(directions_at(page, positions))
    wait_for_value(page, "Angle", expected, 0.1)
    assert abs(expected - before) > 1
    np.testing.assert_allclose(handle_positions(page), positions, atol=0.5)


def test_points_follow_view_and_cancel_removes_them(page):
    button = page.locator("#measure")
    for _ in range(2):
        page.locator("#measure-add").click()
    angle = wait_for_result(page, r"Angle ([\d.]+)°")[1]
    before = handle_positions(page)
    set_state(page, mode="panorama", pan=60.0)
    page.wait_for_function(
        "(x) => Math.abs(document.querySelector('#measurement circle').getBoundingClientRect().x - x) > 20",
        arg=before[0, 0],
    )
    box = page.locator("#view").bounding_box()
    pans = (handle_positions(page)[:, 0] - box["x"]) / box["width"] * 360.0 - 180.0 + 60.0
    np.testing.assert_allclose(pans.mean(), PAN_DEG, atol=0.5)  # symmetric about the centre
    assert wait_for_result(page, r"Angle ([\d.]+)°")[1] == angle
    page.keyboard.press("Escape")
    page.wait_for_selector("#measure-bar", state="hidden")
    page.wait_for_selector("#measurement", state="hidden")
    assert button.get_attribute("aria-pressed") == "false"
    assert page.evaluate("document.activeElement.id") == "measure"


def request_for(camera, pixels, **changes) -> dict:
    model = Cameras().find(camera).model()
    return {
        "id": camera,
        "mount": model.mount.model_dump(),
        "image_size": model.image_size,
        "centre_px": model.centre_px,
        "rim_radius_px": model.rim_radius_px,
        "is_fitted": False,
        "pixels": pixels,
        "height_mm": None,
        "wall_mm": None,
        "wall_pan_deg": 0.0,
        "plane_sigma_mm": 0.0,
        "plane_sigma_deg": 0.0,
        "pixel_sigma_px": 0.0,
    } | changes


@pytest.mark.parametrize("name", ["paper-spherical", "folded-spherical", "ball:340"])
def test_server_measures_with_all_cameras(name):
    """Back-projected directions are the reference; a circle fitted to an image of half size has
    the same directions."""
    camera = Cameras().find(name).camera
    centre = np.array(Cameras().find(name).model().centre_px)
    pixels = centre + 0.5 * Cameras().find(name).model().rim_radius_px * np.array(
        [[1, 0.2], [-0.3, 1]]
    )
    angle = angle_deg(camera.backproject(pixels).directions)
    with TestClient(create_app(), base_url="http://127.0.0.1") as client:
        message = request_for(name, pixels.tolist())
        answer = client.post("/api/measure", json=message).json()
        assert answer["angle_deg"] == pytest.approx(angle, abs=1e-6)
        assert answer["angle_sigma_deg"] is answer["distance_mm"] is None
        half = {
            "is_fitted": True,
            "image_size": [side // 2 for side in message["image_size"]],
            "centre_px": ((centre + 0.5) / 2 - 0.5).tolist(),
            "rim_radius_px": message["rim_radius_px"] / 2,
            "pixels": ((pixels + 0.5) / 2 - 0.5).tolist(),
        }
        answer = client.post("/api/measure", json=message | half).json()
        assert answer["angle_deg"] == pytest.approx(angle, abs=1e-3)
        answer = client.post("/api/measure", json=message | {"pixels": [[0, 0], [1, 1]]})
        assert answer.status_code == 400
        assert "field of view" in answer.text


def test_uncertainty_is_that_of_calibration(tmp_path):
    """The uncertainty of an uploaded camera is used, except for a circle fitted to the image."""
    model = om.SensorModel(om.load_sensor("paper-spherical"), ("focal",))
    sensor = replace(model.sensor, uncertainty=Uncertainty(("focal",), np.array([[0.0116**2]])))
    save_sensor(sensor, tmp_path / "calibrated.toml")
    pixels = [[711.5, 511.5], [511.5, 711.5]]
    plane = {"height_mm": 1500.0, "plane_sigma_mm": 2.0, "pixel_sigma_px": 0.5}
    expected = om.measure(sensor, pixels, **plane)
    assert expected.distance_sigma_mm > 3.0
    with TestClient(create_app(), base_url="http://127.0.0.1") as client:
        data = (tmp_path / "calibrated.toml").read_bytes()
        entry = client.post("/api/sensors", content=data).json()
        message = request_for("paper-spherical", pixels, id=entry["id"], **plane)
        answer = client.post("/api/measure", json=message).json()
        for name in ("angle_sigma_deg", "distance_mm", "distance_sigma_mm"):
            assert answer[name] == pytest.approx(getattr(expected, name), rel=1e-9)
        answer = client.post("/api/measure", json=message | {"is_fitted": True}).json()
        assert answer["distance_mm"] == pytest.approx(expected.distance_mm, rel=1e-9)
        assert answer["distance_sigma_mm"] is None
