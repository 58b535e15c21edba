"""Export of the tab Look: original images at full resolution and bit depth, and light probes."""

from __future__ import annotations

import shlex
from dataclasses import replace

import numpy as np
import pytest
from starlette.testclient import TestClient

import omnimirror as om
from omnimirror.apps.studio._http_messages import framed
from omnimirror.apps.studio._image_export import MAX_EXPORTED_PIXELS, full_size_view
from omnimirror.apps.studio._server_state import Sources, Studio
from omnimirror.apps.studio.app import create_app
from omnimirror.apps.studio.look_messages import (
    ImageExportRequest,
    MountInfo,
    ViewRequest,
)
from omnimirror.cameras.camera import Mount
from omnimirror.io import read_image, write_image
from omnimirror.io.images import encode_image

from .browser import drop, open_page, serving, set_state
from .images import pattern
from .test_server import LOCAL

SENSOR = om.load_sensor("paper-spherical")
MOUNT = MountInfo(camera_looks="up", forward_azimuth_deg=-90.0, image_flipped=False)
VIEW = ViewRequest(view="perspective", size=(40, 30), pan_deg=20.0, tilt_deg=-30.0, hfov_deg=60.0)
FINE = np.arange(1024) % 257  # low bytes of 16 bits


def deep_image() -> np.ndarray:
    return (pattern((1024, 1024)).astype(np.uint16) * 256 + FINE[:, None]).astype(np.uint16)


def radiance() -> np.ndarray:
    """Return linear light far above white."""
    return (pattern((1024, 1024)) / np.float32(2)).astype(np.float32)


def request(name: str, format: str, view: ViewRequest | None, **changes) -> ImageExportRequest:
    message = ImageExportRequest(
        id="paper-spherical",
        mount=MOUNT,
        image_size=(1024, 1024),
        centre_px=(511.5, 511.5),
        rim_radius_px=500.0,
        is_fitted=False,
        name=name,
        format=format,
        view=view,
    )
    return message.model_copy(update=changes)


@pytest.fixture
def client():
    with TestClient(create_app(Studio()), base_url=LOCAL) as client:
        yield client


def exported(client, message: ImageExportRequest, data: bytes, path):
    """Return the exported image, and its description."""
    answer = client.post("/api/export", content=framed(message, data))
    assert answer.status_code == 200, answer.text
    path.write_bytes(answer.content)
    return read_image(path), answer.headers["omnimirror-note"]


def natural(camera=SENSOR) -> om.screens.Plane:
    """Return the view with one image pixel per output pixel at its centre."""
    coarse = om.views.perspective((40, 30), pan_deg=20.0, tilt_deg=-30.0, hfov_deg=60.0)
    scale = om.views.resolution(camera, coarse)
    assert scale > 4
    return replace(coarse, size=(round(40 * scale), round(30 * scale)))


@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_16_bits_are_exported_at_full_resolution(client, suffix, tmp_path):
    image = deep_image()
    result, note = exported(
        client,
        request("deep.png", suffix, VIEW),
        encode_image("deep.png", image),
        tmp_path / f"view.{suffix}",
    )
    assert result.dtype == np.uint16
    np.testing.assert_array_equal(result, om.Dewarper(SENSOR, natural())(image, transparent=True))
    assert note.endswith("16 bits")


def test_linear_light_is_exported_without_clipping(client, tmp_path):
    light = radiance()
    file = encode_image("light.exr", light)
    result, note = exported(client, request("light.exr", "exr", VIEW), file, tmp_path / "view.exr")
    expected = om.Dewarper(SENSOR, natural())(light, transparent=True)
    assert expected[..., :3].max() > 50
    np.testing.assert_array_equal(result, expected)
    assert note.endswith("linear light")
    clipped, note = exported(client, request("light.exr", "jpg", VIEW), file, tmp_path / "view.jpg")
    assert clipped.dtype == np.uint8
    assert "converted from linear light to 8 bits" in note


@pytest.mark.parametrize("suffix", ["hdr", "exr"])
def test_light_probe_is_that_of_python(client, suffix, tmp_path):
    light = radiance()
    result, note = exported(
        client,
        request("light.exr", suffix, None),
        encode_image("light.exr", light),
        tmp_path / f"probe.{suffix}",
    )
    probe = om.light_probe(light, SENSOR)
    error = abs(result - probe.radiance).max(axis=-1)
    assert (error <= (2**-7 if suffix == "hdr" else 0) * probe.radiance.max(axis=-1)).all()
    assert note.startswith(f"light probe, {result.shape[1]} x {result.shape[0]} px, 84.8 %")


def test_fitted_ball_is_used(client, tmp_path):
    ball = om.MirrorBall(
        centre_px=(500.0, 520.0), rim_radius_px=400.0, field_deg=340.0, image_size=(1024, 1024)
    )
    message = request(
        "light.exr",
        "exr",
        None,
        id="ball:340",
        centre_px=ball.centre_px,
        rim_radius_px=400.0,
        is_fitted=True,
    )
    light = radiance()
    result, _ = exported(client, message, encode_image("a.exr", light), tmp_path / "probe.exr")
    np.testing.assert_array_equal(result, om.light_probe(light, ball).radiance)


@pytest.mark.parametrize(
    ("message", "status", "words"),
    [
        (request("a.png", "png", VIEW, id="unknown"), 404, "unknown camera"),
        (
            request("a.png", "png", VIEW.model_copy(update={"height_mm": 5.0})),
            400,
            "height_mm does not apply to the view perspective",
        ),
        (
            request("a.png", "png", ViewRequest(view="ground", size=(40, 30), pan_deg=0.0)),
            400,
            "height_mm is required for the view ground",
        ),
        (request("a.png", "png", None), 400, "must be .hdr or .exr"),
        (
            request("a.png", "png", VIEW.model_copy(update={"tilt_deg": 89.0, "hfov_deg": 5.0})),
            400,
            "the view must overlap the field of the camera",
        ),
    ],
)
def test_invalid_requests_are_rejected(client, message, status, words):
    answer = client.post(
        "/api/export", content=framed(message, encode_image("a.png", pattern((1024, 1024))))
    )
    assert answer.status_code == status
    assert words in answer.json()["detail"]


def test_size_of_other_camera_is_rejected(client):
    small = encode_image("a.png", pattern((64, 64)))
    answer = client.post("/api/export", content=framed(request("a.png", "png", VIEW), small))
    assert answer.status_code == 400
    assert "1024 x 1024 px of the camera" in answer.json()["detail"]


def test_exported_views_keep_scale_and_limit():
    """A plan keeps its area; magnified views keep their size; none exceeds the maximum size."""
    ground = ViewRequest(view="ground", size=(30, 20), pan_deg=0.0, height_mm=900.0, mm_per_px=60.0)
    plan = full_size_view(SENSOR, ground)
    assert plan.size[0] > 60
    assert plan.mm_per_px * plan.size[0] == pytest.approx(1800.0)
    narrow = VIEW.model_copy(update={"size": (800, 600), "hfov_deg": 5.0})
    assert full_size_view(SENSOR, narrow).size == (800, 600)
    mosaic = ViewRequest(view="mosaic", size=(64, None), pan_deg=0.0, tilt_deg=0.0, hfov_deg=90.0)
    assert full_size_view(SENSOR, mosaic).size[0] > 128
    imager = replace(SENSOR.imager, width_px=40960, height_px=40960, centre_px=(20479.5, 20479.5))
    large = replace(SENSOR, imager=replace(imager, pixel_pitch_um=imager.pixel_pitch_um / 40))
    width, height = full_size_view(large, VIEW.model_copy(update={"hfov_deg": 120.0})).size
    assert 0.99 * MAX_EXPORTED_PIXELS < width * height < 1.01 * MAX_EXPORTED_PIXELS
    largest = full_size_view(SENSOR, VIEW.model_copy(update={"size": (16384, 16384)})).size
    assert 0.99 * MAX_EXPORTED_PIXELS < np.prod(largest) < 1.01 * MAX_EXPORTED_PIXELS


# -- page ------------------------------------------------------------------------------------------


def download(page, item: str, path):
    """Select an item of the export menu, and return the saved file."""
    page.locator("#export summary").click()
    with page.expect_download() as download:
        page.locator("#export").get_by_role("button", name=item).click()
    download.value.save_as(path / download.value.suggested_filename)
    return download.value.suggested_filename


def test_server_images_are_exported_and_searched_at_their_depth(browser, tmp_path, monkeypatch):
    """The page displays an 8-bit preview; export and outline search use the original file."""
    folder = tmp_path / "in"
    folder.mkdir()
    write_image(folder / "deep.png", deep_image())
    studio, searched = Studio(Sources(folders=[folder])), []
    search = studio.outline_searches.run
    monkeypatch.setattr(
        studio.outline_searches,
        "run",
        lambda request, data: searched.append(data) or search(request, data),
    )
    with serving(studio) as address:
        page = open_page(browser, f"{address}#source=server:0/deep.png&mode=perspective&hfov=60")
        page.wait_for_selector("#view:visible")
        name = download(page, "View as PNG", tmp_path)
        assert name == "deep-perspective.png"
        page.get_by_text("16 bits").wait_for()
        result = read_image(tmp_path / name)
        line = shlex.split(page.locator("#command-line").text_content())
        shown = [int(side) for side in line[line.index("--size") + 1].split("x")]
        assert result.shape[1] / result.shape[0] == pytest.approx(shown[0] / shown[1], rel=0.01)
        view = om.views.perspective((result.shape[1], result.shape[0]), hfov_deg=60.0)
        expected = om.Dewarper(SENSOR, view)(deep_image(), transparent=True)
        np.testing.assert_array_equal(result, expected)
        with page.expect_response("**/api/outline**"):
            page.get_by_role("button", name="Detect circle").click()
        assert searched == [(folder / "deep.png").read_bytes()]
        page.context.close()


def test_light_probe_of_a_dropped_image(browser, server, tmp_path):
    write_image(tmp_path / "ball.hdr", radiance())
    page = open_page(browser, server, 1000, 800)
    drop(page, tmp_path / "ball.hdr")
    set_state(page, sensor="ball:340", rim=[511.5, 511.5, 480])
    page.wait_for_function(
        "window.omnimirror.look.sensor.camera.model.id === 'ball:340'"
        " && window.omnimirror.look.displayed()?.camera.circle.radius === 480"
    )
    name = download(page, "Light probe as HDR", tmp_path)
    assert name == "ball-light-probe.hdr"
    looks = page.evaluate("window.omnimirror.look.sensor.camera.model.mount.camera_looks")
    ball = om.MirrorBall(
        centre_px=(511.5, 511.5),
        rim_radius_px=480.0,
        field_deg=340.0,
        image_size=(1024, 1024),
        mount=Mount(looks),
    )
    expected = om.light_probe(read_image(tmp_path / "ball.hdr"), ball).radiance
    error = abs(read_image(tmp_path / name) - expected).max(axis=-1)
    assert (error <= 2**-7 * expected.max(axis=-1)).all()
    assert page.problems == []
    page.context.close()


def test_rejected_export_is_reported(browser, server, tmp_path):
    """The message remains, and the image and its view are unchanged."""
    write_image(tmp_path / "waves.png", pattern((1024, 1024)))
    page = open_page(browser, server, 1000, 800)
    drop(page, tmp_path / "waves.png")
    page.wait_for_selector("#view:visible")
    page.route("**/api/export", lambda route: route.fulfill(status=503, json={"detail": "busy"}))
    page.locator("#export summary").click()
    page.locator("#export").get_by_role("button", name="View as TIFF").click()
    page.locator("#banner", has_text="busy").wait_for()
    assert page.locator("#busy").is_hidden()
    assert page.locator("#view").is_visible()
    page.context.close()
