"""Page without a server: its views equal those of the command line."""

from __future__ import annotations

import base64

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio import _standalone_page, standalone_page
from omnimirror.apps.studio._look_cameras import Cameras
from omnimirror.cameras.camera import Mount
from omnimirror.io import read_image, write_image
from tests.commands import fails

from .browser import command, drop, open_page, view_pixels
from .images import psnr, python_view

SENSORS = ("paper-spherical", "folded-spherical", "ball:260")


@pytest.fixture(scope="module")
def address(tmp_path_factory) -> str:
    path = tmp_path_factory.mktemp("alone") / "look.html"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_standalone_page, "SHOWN_SAMPLES", 1)
        patch.setattr(_standalone_page, "Room", lambda: om.Room(texel_mm=15.0))
        path.write_text(standalone_page(SENSORS), encoding="utf-8")
    return path.as_uri()


def test_demo_room_without_server_matches_command_line(browser, address, tmp_path):
    page = open_page(
        browser,
        f"{address}#mode=perspective&pan=60&tilt=20&hfov=50&looks=down&forward=30&pitch=8&roll=-4",
    )
    page.get_by_role("button", name="Try the demo room").click()
    page.wait_for_function("window.omnimirror.look.feed")
    room = page.evaluate("JSON.parse(document.getElementById('alone').textContent).cameras[0].room")
    (tmp_path / "circle.jpg").write_bytes(base64.b64decode(room.partition(",")[2]))
    line = command(page, 200, 150)
    assert all(
        phrase in line
        for phrase in (
            "circle.jpg",
            "--camera-looks down",
            "--set camera.forward_azimuth_deg=30",
            "--set camera.level=8,-4",
        )
    )
    expected = python_view(line, tmp_path)(read_image(tmp_path / "circle.jpg"))
    result = view_pixels(page, 200, 150)
    both = (result[..., 3] > 0) & (expected.max(axis=-1) > 0)
    assert both.mean() > 0.9
    assert psnr(result[..., :3], expected, both) > 40
    assert page.problems == []
    page.context.close()


def test_page_without_server_requests_camera_type_and_hides_server_functions(
    browser, address, tmp_path
):
    write_image(tmp_path / "mine.png", np.full((300, 400, 3), 90, np.uint8))
    page = open_page(browser, address, asks=True)
    for name in ("Calibrate", "Restore", "Detect circle", "Find level", "Load…"):
        assert not page.get_by_role("button", name=name, exact=True).is_visible(), name
    drop(page, tmp_path / "mine.png")
    page.get_by_text("The circle is assumed; drag").wait_for()
    page.get_by_role("button", name="Done").click()
    page.get_by_role("button", name="Mirror dome").click()
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.id === 'ball:260'")
    page.get_by_role("button", name="Fit circle").click()
    assert page.get_by_text("require the installed program").is_visible()
    page.get_by_label("Radius").fill("120")
    page.get_by_label("Radius").press("Enter")
    page.wait_for_function("window.omnimirror.look.camera.circle.radius === 120")
    page.get_by_role("button", name="Done").click()
    assert page.locator("#view").is_visible()
    assert page.problems == []
    page.context.close()


@pytest.mark.parametrize(
    "mount",
    [
        Mount("up"),
        Mount("down", 17.0, True),
        Mount("forward", -90.0, False, 20.0),
        Mount("up", 200.0, False, -30.0, 50.0),
        Mount("forward", 33.0, True, -70.0, -120.0),
    ],
    ids=str,
)
@pytest.mark.parametrize("sensor", SENSORS)
def test_page_without_server_applies_requested_mount(viewer, sensor, mount):
    """The page rotates the camera itself; the view is compared with the Python camera."""
    expected = Cameras().find(sensor).model(mount)
    state = {
        "sensor": sensor,
        "looks": mount.camera_looks,
        "forward": mount.forward_azimuth_deg,
        "flipped": mount.image_flipped,
        "pitch": mount.pitch_deg,
        "roll": mount.roll_deg,
    }
    values = viewer.evaluate(
        "async (s) => (await window.omnimirror.look.sensor.want(s), window.omnimirror.look.sensor.camera.model)",
        state,
    )
    for name in ("axis", "right", "down"):
        np.testing.assert_allclose(values[name], getattr(expected, name), atol=1e-12)
    assert values["pole"] == expected.pole
    result = [values["tilt_min_deg"], values["tilt_max_deg"]]
    np.testing.assert_allclose(result, [expected.tilt_min_deg, expected.tilt_max_deg], atol=0.05)
    assert values["mount"] == expected.mount.model_dump()


@pytest.fixture(scope="module")
def viewer(browser, address):
    page = open_page(browser, address)
    yield page
    assert page.problems == []
    page.context.close()


def test_page_without_server_rejects_unknown_sensor(tmp_path):
    with pytest.raises(
        om.base.errors.InvalidParameter,
        match=r"sensors must contain names from exact.*; got 'paper-sperical'",
    ):
        standalone_page(["paper-sperical"])
    assert "HTML" in fails("studio", "--page", tmp_path / "look.png")
