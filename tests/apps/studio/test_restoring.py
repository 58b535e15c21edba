"""Restored image, and comparison with the original."""

from __future__ import annotations

import io
import json
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest
from PIL import Image
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio.app import create_app
from omnimirror.io import write_image
from omnimirror.optics.sensor_files import save_sensor

from .browser import BASE64, _values, drop, open_page, set_state
from .images import psnr, python_view

SENSOR = om.load_sensor("paper-spherical")
SMALL = replace(
    SENSOR,
    name="small",
    imager=replace(SENSOR.imager, width_px=192, height_px=192, pixel_pitch_um=27.7),
    lens=replace(SENSOR.lens, f_number=0.3),
)
"""Strong blur, fast restoration."""


@pytest.fixture(scope="module")
def image() -> np.ndarray:
    rng = np.random.default_rng(3)
    sharp = cv2.resize(
        rng.integers(0, 255, (32, 32, 3), np.uint8), (192, 192), interpolation=cv2.INTER_NEAREST
    )
    return cv2.GaussianBlur(sharp, (0, 0), 1.6)


@pytest.fixture(scope="module")
def restored(image) -> np.ndarray:
    """Restore an image by the library."""
    return om.restore(SMALL, image)


@pytest.mark.full
def test_server_restoration_matches_library(image, restored, tmp_path):
    save_sensor(SMALL, tmp_path / "small.toml")
    with TestClient(create_app(), base_url="http://127.0.0.1") as client:
        entry = client.post("/api/sensors", content=(tmp_path / "small.toml").read_bytes()).json()
        body = {
            "id": entry["id"],
            "mount": entry["mount"],
            "image_size": [192, 192],
            "name": "p.png",
            "centre_px": SMALL.imager.centre,
            "rim_radius_px": SMALL.rim_radius_px,
            "object_distance_mm": None,
        }
        png = cv2.imencode(".png", image[..., ::-1])[1].tobytes()

        def post(**changes):
            text = json.dumps({**body, **changes}).encode()
            return client.post("/api/restore", content=struct.pack("<I", len(text)) + text + png)

        lines, _, file = post().content.partition(b"\n\n")
        *steps, done = map(json.loads, lines.splitlines())
        assert [step["fraction"] for step in steps] == [0.0, 0.25, 0.5, 0.75]
        result = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        assert np.abs(restored.astype(int) - image).max() > 8
        assert np.abs(result.astype(int) - restored).max() <= 1
        assert done["state"] == "done"
        assert done["message"].startswith("restored with noise of")
        file = io.BytesIO()
        exif = Image.Exif()
        exif[0x010F] = "Maker"
        exif.get_ifd(0x8769)[0x829D] = 0.6
        Image.fromarray(image).save(file, "PNG", exif=exif)
        png = file.getvalue()
        lines, _, file = post().content.partition(b"\n\n")
        done = json.loads(lines.splitlines()[-1])
        assert "EXIF has F/0.6, the sensor F/0.3: 50 % of the blur is assumed" in done["message"]
        result = cv2.imdecode(np.frombuffer(file, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
        half = om.restore(replace(SMALL, lens=replace(SMALL.lens, f_number=0.6)), image)
        assert (
            5 * np.abs(result.astype(int) - half).mean()
            < np.abs(result.astype(int) - restored).mean()
        )
        converted_png = client.post("/api/convert", content=png, params={"name": "p.png"}).content
        assert Image.open(io.BytesIO(converted_png)).getexif().get_ifd(0x8769)[0x829D] == 0.6
        assert post(id="ball:300").status_code == 400
        failed = json.loads(post(image_size=[100, 100]).content.splitlines()[-1])
        assert failed["state"] == "failed"
        assert "must have the 100 x 100 px" in failed["message"]
        assert post(id="nope").status_code == 404


def test_given_and_restored_image_are_shown_side_by_side(
    browser, server, image, restored, tmp_path
):
    save_sensor(SMALL, tmp_path / "small.toml")
    write_image(tmp_path / "p.png", image)
    page = open_page(browser, server, 1000, 800, reduced_motion="reduce")
    restore = page.get_by_role("button", name="Restore")
    page.set_input_files("#calibration", tmp_path / "small.toml")
    page.wait_for_function("window.omnimirror.look.sensor.camera.model.name === 'small'")
    drop(page, tmp_path / "p.png")
    set_state(page, mode="dome")
    page.wait_for_selector("#restore[aria-disabled=false]")
    restore.click()
    page.locator("#wiper").wait_for(state="visible")
    page.get_by_label("Divider between the original").fill("0.25")
    page.wait_for_function("window.omnimirror.store.state.wipe === 0.25")
    script = f"""() => {{
      const canvas = window.omnimirror.look.drawn();
      const copy = new OffscreenCanvas(canvas.width, canvas.height).getContext("2d");
      copy.drawImage(canvas, 0, 0);
      const {{ data }} = copy.getImageData(0, 0, canvas.width, canvas.height);
      return {{ size: [canvas.width, canvas.height], values: ({BASE64})(data) }};
    }}"""
    pixels = _values(page.evaluate(script), np.uint8)
    side = pixels.shape[0]
    line = page.locator("#command-line").inner_text()
    assert f"--size {side}x{side}" in line
    dewarper = python_view(line, tmp_path)
    expected = [dewarper(p) for p in (image, restored)]
    both = (pixels[..., 3] > 0) & (expected[0].max(axis=-1) > 0)
    columns = np.arange(side)
    left, right = both & (columns < 0.25 * side - 1), both & (columns > 0.25 * side + 1)
    assert psnr(pixels[..., :3], expected[0], left) > 40
    assert psnr(pixels[..., :3], expected[1], right) > 40
    assert psnr(pixels[..., :3], expected[1], right) > psnr(pixels[..., :3], expected[0], right) + 5
    set_state(page, sensor="ball:300")
    page.wait_for_function("document.querySelector('#wiper').hidden")
    restore.click(force=True)
    page.get_by_role("status").filter(has_text="requires a sensor with known mirror").wait_for()
    assert page.problems == []
    page.context.close()


def test_restoration_is_cancelled(browser, server, image, tmp_path):
    """Cancel ends the worker: the next restoration does not wait for it."""
    large = cv2.resize(image, SENSOR.image_size, interpolation=cv2.INTER_CUBIC)
    write_image(tmp_path / "p.png", large)
    page = open_page(browser, server, 1000, 800, reduced_motion="reduce")
    drop(page, tmp_path / "p.png")
    page.wait_for_selector("#restore[aria-disabled=false]")
    for _ in range(2):
        page.locator("#restore").click()
        page.locator("#busy-text", has_text="Estimating the noise").wait_for()
        page.locator("#busy-fraction").wait_for()
        page.locator("#busy-cancel").click()
        page.locator("#busy").wait_for(state="hidden")
        page.wait_for_selector("#restore[aria-pressed=false]")
    assert page.locator("#banner").is_hidden()
    assert page.problems == []
    page.context.close()
