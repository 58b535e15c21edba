"""All formats of view maps, evaluated by their programs and compared with the Dewarper."""

from __future__ import annotations

import contextlib
import ctypes
import json
import runpy
import shlex
import shutil
import subprocess
from dataclasses import replace
from functools import reduce
from itertools import accumulate

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.interop.view_maps import MAP_FORMATS
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.apps.studio.browser import FLAGS
from tests.interop.documentation import shell_command, unmarked_code
from tests.interop.view_maps.consumers import (
    by_micropython,
    compiled,
    compilers,
    dewarped_by_c,
    drawn,
    drawn_by_obs,
    glsl_of,
    on_a_cortex_m7,
    piped,
    remapped,
    warped,
)

SENSOR = om.load_sensor("paper-spherical")
SENSOR = replace(
    SENSOR,
    imager=replace(SENSOR.imager, width_px=512, height_px=500, pixel_pitch_um=10.4),
    mirror_pose=MirrorPose(0.5, -0.3, 0.0, 0.5, -0.4),
)
AHEAD = om.screens.Plane(
    (320, 240), pan_deg=20.0, tilt_deg=10.0, hfov_deg=100.0
)  # the corners are outside the field


@pytest.fixture(scope="module")
def image():
    return om.render_image(SENSOR, om.Room(texel_mm=20.0), samples=4, low_pass=True)


@pytest.fixture(scope="module")
def dewarped(image):
    return om.Dewarper(SENSOR, AHEAD, "linear")(image)


@pytest.fixture(scope="module")
def interior():
    """Pixels inside the field except its outermost ones, where the Dewarper blends with the border."""
    valid = np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)
    assert 0.7 < valid.mean() < 0.99
    return cv2.erode(valid.astype(np.uint8), np.ones((3, 3))).astype(bool)


def export(kind, folder):
    (exported,) = om.write_maps(SENSOR, AHEAD, folder, formats=kind)
    assert all(path.stat().st_size for path in exported.paths)
    return exported


def max_difference(image, reference, mask):
    return np.abs(image.astype(int) - reference.astype(int))[mask].max()


def sample(image, x, y):
    """Interpolate an image and round to grey levels."""
    return np.rint(interpolate(image, x, y))


def interpolate(image, x, y):
    """Interpolate bilinearly with replicated border pixels."""
    padded = np.pad(image.astype(float), ((2, 2), (2, 2), (0, 0)), mode="edge")
    x, y = np.clip(x + 2.0, 0, padded.shape[1] - 2), np.clip(y + 2.0, 0, padded.shape[0] - 2)
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - i)[..., None], (y - j)[..., None]
    top = (1 - a) * padded[j, i] + a * padded[j, i + 1]
    return (1 - b) * top + b * ((1 - a) * padded[j + 1, i] + a * padded[j + 1, i + 1])


def sample_st(image, channels):
    """Sample with an ST map: s to the right, t up, 0 to 1 between the outer edges."""
    height, width = image.shape[:2]
    return sample(image, channels[..., 0] * width - 0.5, (1 - channels[..., 1]) * height - 0.5)


def test_st_maps_in_both_directions(image, dewarped, interior, tmp_path):
    dewarp, warp = (om.read_image(path) for path in export("stmap", tmp_path).paths)
    assert dewarp.shape == (240, 320, 4)
    assert warp.shape == (500, 512, 4)
    assert max_difference(dewarped, sample_st(image, dewarp), interior) <= 1
    assert (dewarp[dewarp[..., 3] == 0][:, :2] == -1).all()
    # composition of both maps: from the image to the view and back to the image
    rows, columns = np.nonzero(warp[..., 3])
    s, t = warp[rows, columns, 0] * 320 - 0.5, (1 - warp[rows, columns, 1]) * 240 - 0.5
    inside = (s > 1) & (s < 318) & (t > 1) & (t < 238)
    inside &= interior[
        np.clip(np.rint(t).astype(int), 0, 239), np.clip(np.rint(s).astype(int), 0, 319)
    ]
    composed = interpolate(dewarp[..., :2], s, t)
    error = np.hypot(composed[:, 0] * 512 - 0.5 - columns, (1 - composed[:, 1]) * 500 - 0.5 - rows)
    assert inside.sum() > 5000
    assert np.percentile(error[inside], 99) < 0.02


def test_openimageio_st_warp(image, dewarped, interior, tmp_path, beside):
    oiio = pytest.importorskip(
        "OpenImageIO", reason="OpenImageIO is installed by `make test-full` only"
    )
    output = warped(oiio, image, export("stmap", tmp_path).paths[0])[..., :3]
    difference = np.abs(output - dewarped)[interior].max()
    label = "view by st_warp with the exported ST map, maximum difference in grey levels"
    beside("OpenImageIO", label, difference, 1, "")


def test_opencv_float_and_fixed_point_maps(image, dewarped, interior, tmp_path, beside):
    maps = np.load(export("opencv", tmp_path).paths[0])
    floats = cv2.remap(image, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)
    fixed = cv2.remap(image, maps["fixed_map1"], maps["fixed_map2"], cv2.INTER_LINEAR)
    assert max_difference(dewarped, sample(image, maps["map_x"], maps["map_y"]), interior) <= 1
    # OpenCV rounds coordinates of both kinds of maps to 1/32 px, which is visible at hard edges.
    assert np.mean(np.abs(fixed.astype(float) - floats)[interior]) < 0.3
    difference = np.mean(np.abs(dewarped.astype(float) - floats)[interior])
    beside(
        "OpenCV",
        "view by cv2.remap with exported maps, mean difference in grey levels",
        difference,
        0.3,
        "",
    )
    assert tuple(maps["source_size"]) == (512, 500)


def test_opencv_yaml_equals_npz(tmp_path):
    npz, yml = (export(kind, tmp_path).paths[0] for kind in ("opencv", "opencv-yml"))
    maps, storage = np.load(npz), cv2.FileStorage(str(yml), cv2.FILE_STORAGE_READ)
    for name in ("map_x", "map_y", "fixed_map1", "fixed_map2"):
        assert (storage.getNode(name).mat() == maps[name]).all()


def test_ffmpeg_samples_the_nearest_pixel(image, tmp_path, beside):
    pytest.importorskip("av")
    exported = export("ffmpeg", tmp_path)
    output = remapped(exported.paths, image)
    positions = om.view_map(SENSOR, AHEAD).dewarp_map
    valid = np.isfinite(positions).all(-1)
    near = np.rint(np.nan_to_num(positions)).astype(int)
    near = np.clip(near, 0, [511, 499])
    expected = np.where(valid[..., None], image[near[..., 1], near[..., 0]], 0)
    difference = 100 * (output != expected).mean()
    beside(
        "FFmpeg",
        "differing values of a view by the filter remap with exported maps",
        difference,
        0.1,
        "%",
    )
    assert 0.5 < exported.deviation.size <= np.sqrt(0.5)


def test_documented_ffmpeg_command(image, tmp_path):
    """Frames of a video by the program; H.264 changes edges by some grey levels."""
    pytest.importorskip("av")
    if not shutil.which("ffmpeg"):
        pytest.skip("FFmpeg is not installed: make programs")
    from omnimirror.io.video_frames import frame_of_image, image_of_frame
    from omnimirror.io.video_reader import VideoReader
    from omnimirror.io.video_writer import VideoWriter

    paths = export("ffmpeg", tmp_path).paths
    expected = remapped(paths, image)
    with VideoWriter(tmp_path / "ride.mp4", image.shape[1::-1], 25, crf=8) as video:
        for _ in range(5):
            video.write(frame_of_image(image))
    run = subprocess.run(
        shlex.split(shell_command("FFmpeg")), cwd=tmp_path, capture_output=True, text=True
    )
    assert run.returncode == 0, run.stderr
    frames = VideoReader(str(tmp_path / "view.mp4"), with_audio=False).frames()
    views = [image_of_frame(frame).astype(float) for frame in frames]
    assert len(views) == 5
    assert max(np.abs(view - expected).mean() for view in views) < 4


def test_ffmpeg_error_is_reduced_by_downscaling_a_larger_view(image, interior, tmp_path):
    pytest.importorskip("av")
    expected = om.Dewarper(SENSOR, AHEAD)(image).astype(float)
    difference = []
    for times in (1, 2):
        view = replace(AHEAD, size=(320 * times, 240 * times))
        (exported,) = om.write_maps(SENSOR, view, tmp_path / f"{times}.pgm", formats="ffmpeg")
        output = cv2.resize(
            remapped(exported.paths, image), (320, 240), interpolation=cv2.INTER_AREA
        )
        difference.append(np.sqrt(np.mean((output - expected)[interior] ** 2)))
    assert difference[1] < 0.65 * difference[0]


def test_vpi_map_has_one_control_point_per_pixel(image, dewarped, interior, tmp_path):
    warp = np.load(export("vpi", tmp_path).paths[0])
    assert warp.dtype == np.float32
    assert max_difference(dewarped, sample(image, warp[..., 0], warp[..., 1]), interior) <= 1


# -- border of the image ------------------------------------------------------------------------------

CROPPED = replace(SENSOR, imager=replace(SENSOR.imager, height_px=300))
"""Sensor whose views reach all four borders of the image."""
CROPPED_VIEWS = {
    "plane": om.screens.Plane((320, 240), tilt_deg=-10.0, hfov_deg=100.0),
    "panorama": om.screens.Cylinder((360, 120), -60.0, 30.0),
}


@pytest.fixture(scope="module")
def bright():
    """Smooth bright image, for which blending with black at the border would be visible."""
    noise = np.random.default_rng(0).integers(0, 256, (300, 512, 3), dtype=np.uint8)
    return (cv2.GaussianBlur(noise, (0, 0), 3) // 4 + 150).astype(np.uint8)


def documented_views(heading, folder, **names):
    """Run the code below a heading of the documentation; yield the value of ``view`` after each line."""
    with contextlib.chdir(folder):
        for line in unmarked_code(heading).splitlines():
            exec(line, names)
            if line.startswith("view = "):
                yield names["view"]


def border_errors(view, result, image):
    """Return the differences from the Dewarper at the border of the image and at all valid pixels."""
    sources = om.view_map(CROPPED, view).dewarp_map
    valid = np.isfinite(sources).all(-1)
    with np.errstate(invalid="ignore"):
        at_border = valid & ((sources < 0) | (sources > [511, 299])).any(-1)
    assert at_border.sum() > 50
    expected = om.Dewarper(CROPPED, view, "linear")(image).astype(float)
    difference = np.abs(np.asarray(result, float) - expected)
    assert (difference[~valid] == 0).all()
    return difference[at_border].max(), difference[valid].max()


@pytest.mark.parametrize("name", CROPPED_VIEWS)
def test_documented_opencv_lines_at_the_border(bright, name, tmp_path):
    view = CROPPED_VIEWS[name]
    om.write_maps(CROPPED, view, tmp_path / "ahead", formats="opencv")
    results = list(documented_views("OpenCV", tmp_path, np=np, cv2=cv2, image=bright))
    assert len(results) == 2
    for result in results:
        assert max(border_errors(view, result, bright)) <= 1


@pytest.mark.parametrize("name", CROPPED_VIEWS)
def test_vpi_map_at_the_border(bright, name, tmp_path):
    """Bilinear sampling with a constant border of 0, as in vpi.Border.ZERO."""
    view = CROPPED_VIEWS[name]
    (exported,) = om.write_maps(CROPPED, view, tmp_path / "ahead.npy")
    x, y = np.moveaxis(np.load(exported.paths[0]), -1, 0)
    padded = np.pad(bright, ((1, 1), (1, 1), (0, 0)))
    inside = (x > -1) & (y > -1)
    result = sample(padded, np.clip(x + 1, 0, 513), np.clip(y + 1, 0, 301)) * inside[..., None]
    assert max(border_errors(view, result, bright)) <= 1


@pytest.mark.parametrize("name", CROPPED_VIEWS)
def test_documented_st_warp_line_at_the_border(bright, name, tmp_path):
    oiio = pytest.importorskip(
        "OpenImageIO", reason="OpenImageIO is installed by `make test-full` only"
    )
    view = CROPPED_VIEWS[name]
    om.write_maps(CROPPED, view, tmp_path / "room.exr", formats="stmap")
    oiio.ImageBuf(bright.astype(np.float32)).write(str(tmp_path / "image.exr"))
    (result,) = documented_views("Compositors", tmp_path, oiio=oiio)
    values = result.get_pixels("float")[..., :3]
    valid = np.isfinite(om.view_map(CROPPED, view).dewarp_map).all(-1)
    assert max(border_errors(view, np.where(valid[..., None], values, 0.0), bright)) <= 1


# -- shaders ------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(launched):
    browser = launched(FLAGS)
    yield browser.new_page()
    browser.close()


@pytest.mark.long
def test_glsl_shader(page, image, dewarped, interior, tmp_path):
    paths = export("glsl", tmp_path).paths
    output = drawn(page, paths[0], image, (320, 240), paths[1], (320, 240))
    assert max_difference(dewarped, output, interior) <= 1
    assert (output[~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()
    larger = drawn(
        page, paths[0], image, (640, 480), paths[1], (320, 240)
    )  # interpolated between pixels of the map
    expected = om.Dewarper(SENSOR, replace(AHEAD, size=(640, 480)), "linear")(image)
    inside = cv2.resize(interior.astype(np.uint8), (640, 480), interpolation=cv2.INTER_NEAREST) > 0
    assert np.mean(np.abs(expected.astype(float) - larger)[inside]) < 0.5


def test_hlsl_and_glsl_maps_are_equal(tmp_path):
    glsl, hlsl = (export(kind, tmp_path).paths for kind in ("glsl", "hlsl"))
    assert glsl[1].read_bytes() == hlsl[1].read_bytes()
    assert "float2(512.0, 500.0)" in hlsl[0].read_text()


@pytest.mark.full
def test_hlsl_shader(page, image, dewarped, interior, tmp_path):
    paths = export("hlsl", tmp_path).paths
    translated = glsl_of(paths[0])
    if translated is None:
        pytest.skip("glslang and SPIRV-Cross are not installed: make programs")
    output = drawn(page, translated, image, (320, 240), paths[1], (320, 240))[
        ::-1
    ]  # rows of Direct3D start at the top
    assert max_difference(dewarped, output, interior) <= 1
    assert (output[~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()


def test_obs_map_image(tmp_path):
    effect, table = export("obs", tmp_path).paths
    digits = om.read_image(table).astype(float)
    decoded = digits @ [256.0, 1.0, 1 / 256] - 1
    positions, valid = om.view_map(SENSOR, AHEAD).dewarp_map, digits[:, :320].any(-1)
    assert (valid == np.isfinite(positions).all(-1)).all()
    assert (
        np.abs(np.stack([decoded[:, :320], decoded[:, 320:]], -1) - positions)[valid].max()
        <= 1 / 512 + 1e-9
    )
    assert f'"{table.name}"' in effect.read_text()


def test_obs_effect(image, dewarped, interior, tmp_path, beside):
    output = drawn_by_obs(*export("obs", tmp_path).paths, image, (320, 240), tmp_path)
    if output is None:
        pytest.skip("libobs is not installed: make programs")
    difference = max_difference(dewarped, output, interior)
    label = "view by libobs with the exported effect, maximum difference in grey levels"
    beside("OBS Studio", label, difference, 1, "", (tmp_path / "version.txt").read_text())
    assert (output[~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()


@pytest.mark.full
def test_glshader_in_the_browser(page, image, dewarped, interior, tmp_path):
    exported = export("gstreamer", tmp_path)
    assert exported.deviation.size < 0.03
    output = drawn(page, exported.paths[1], image, (320, 240))
    assert max_difference(dewarped, output, interior) <= 1
    assert (output[~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()


def test_long_shader_uses_a_coarser_grid(tmp_path):
    """The map of two mirrors requires nodes every 4 px, which exceed the length of a command."""
    sensor = om.load_sensor("folded-hyperboloidal")
    around = om.views.panorama(sensor, (640, None))
    (exported,) = om.write_maps(sensor, around, tmp_path / "around.sh", formats="gstreamer")
    assert 0.02 < exported.deviation.size < 0.1
    assert "every 8 px" in exported.deviation.reason
    assert exported.paths[1].stat().st_size <= 120_000


def test_gstreamer_pipeline(image, dewarped, interior, tmp_path, beside):
    output = piped(export("gstreamer", tmp_path).paths[0], image, tmp_path)
    if output is None:
        pytest.skip("GStreamer with OpenGL is not installed: make programs")
    difference = max_difference(dewarped, output, interior)
    version = subprocess.run(
        ["gst-launch-1.0", "--version"], capture_output=True, text=True
    ).stdout.split("\n")[1]
    beside(
        "GStreamer",
        "view by glshader with the exported shader, maximum difference in grey levels",
        difference,
        1,
        "",
        version.removeprefix("GStreamer "),
    )
    assert (output[~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()


def test_depthai_mesh_error(tmp_path):
    """Compare the mesh, interpolated independently, with the map."""
    view, sensor = (
        replace(AHEAD, tilt_deg=-25.0),
        replace(SENSOR, imager=replace(SENSOR.imager, width_px=528)),
    )
    (exported,) = om.write_maps(sensor, view, tmp_path / "ahead.json")
    mesh = json.loads(exported.paths[0].read_text())
    points = np.float32(mesh["points"]).reshape(mesh["mesh_height"], mesh["mesh_width"], 2)
    assert tuple(mesh["size"]) == (320, 240)
    assert points.shape == (16, 21, 2)
    rows, columns = np.mgrid[:240, :320].astype(np.float32) / 16
    positions = om.view_map(sensor, view).dewarp_map
    valid = np.isfinite(positions).all(-1)
    near = np.stack(
        [interpolate(points[..., k : k + 1], columns, rows)[..., 0] for k in (0, 1)], axis=-1
    )
    error = np.linalg.norm(near - positions, axis=-1)[valid].max()
    assert abs(error - exported.deviation.size) < 0.01
    assert error < 2


@pytest.mark.parametrize(("width", "size"), [(512, (320, 250)), (500, (320, 240))])
def test_depthai_sizes_are_multiples_of_16(width, size, tmp_path):
    sensor = replace(SENSOR, imager=replace(SENSOR.imager, width_px=width))
    with pytest.raises(InvalidParameter, match="multiple"):
        om.write_maps(sensor, replace(AHEAD, size=size), tmp_path / "ahead.json")


# -- microcontrollers ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def c_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c99")
    (exported,) = om.write_maps(SENSOR, AHEAD, folder / "ahead.c", formats="c99")
    assert [p.name for p in exported.paths] == ["ahead.c", "ahead.h"]
    assert exported.deviation.size < 0.05
    return exported.paths[0]


@pytest.fixture(scope="module")
def library(c_file):
    """The C file, compiled without warnings by all installed compilers."""
    if not compilers():
        pytest.skip("no C compiler is installed")
    loaded = compiled(c_file)
    pointer = ctypes.POINTER(ctypes.c_float)
    loaded.ahead_source_pixel.argtypes = [ctypes.c_int, ctypes.c_int, pointer, pointer]
    loaded.ahead_floor_cm.argtypes = [
        ctypes.c_float,
        ctypes.c_float,
        ctypes.c_float,
        pointer,
        pointer,
    ]
    return loaded


@pytest.mark.parametrize("channels", [1, 3])
def test_c_dewarp(library, image, dewarped, interior, channels):
    source = np.ascontiguousarray(image[..., :channels])
    view = np.full((240, 320 + 5, channels), 77, np.uint8)  # padded rows
    dewarped_by_c(library, "ahead", source, view)
    assert max_difference(dewarped[..., :channels], view[:, :320], interior) <= 1
    assert (view[:, 320:] == 77).all()
    assert (view[:, :320][~np.isfinite(om.view_map(SENSOR, AHEAD).dewarp_map).all(-1)] == 0).all()


def test_c_source_pixels_and_floor_points(library):
    u, v = ctypes.c_float(), ctypes.c_float()
    positions = om.view_map(SENSOR, AHEAD).dewarp_map
    for row, column in [(0, 0), (239, 319), (120, 160), (7, 311), (200, 3)]:
        is_valid = np.isfinite(positions[row, column]).all()
        assert library.ahead_source_pixel(column, row, u, v) == is_valid
        assert (
            not is_valid
            or np.hypot(u.value - positions[row, column, 0], v.value - positions[row, column, 1])
            < 0.03
        )
    assert library.ahead_source_pixel(320, 0, u, v) == 0
    for pixel, point in floor_points(
        lambda a, b: (u.value, v.value) if library.ahead_floor_cm(a, b, 80.0, u, v) else None
    ):
        assert_on_floor(pixel, point)


def floor_points(floor):
    rng = np.random.default_rng(1)
    pixels = rng.uniform([100, 100], [400, 400], (200, 2)).astype(np.float32).astype(float)
    return [(pixel, floor(*pixel)) for pixel in pixels]


def assert_on_floor(pixel, point):
    """Compare with the traced ray, up to three times the height."""
    (origin,), (direction,), _ = SENSOR.backproject([pixel])
    distance = (-800.0 - origin[2]) / direction[2] if direction[2] else -1.0
    expected = (origin + distance * direction)[:2] / 10
    if distance > 0 and np.hypot(*expected) < 240:
        assert np.hypot(*(np.array(point) - expected)) < 0.1
    if direction[2] > 0:
        assert point is None


def test_micropython_module(tmp_path):
    """The module, which is restricted to MicroPython, is run by CPython."""
    (exported,) = om.write_maps(SENSOR, AHEAD, tmp_path / "ahead.py", formats="openmv")
    module = runpy.run_path(str(exported.paths[0]))
    try:
        positions = om.view_map(SENSOR, AHEAD).dewarp_map
        for row, column in [(120, 160), (200, 3), (100, 311)]:
            assert (
                np.hypot(*(np.array(module["source_pixel"](column, row)) - positions[row, column]))
                < 0.03
            )
        assert module["source_pixel"](320, 0) is None
        for pixel, point in floor_points(lambda a, b: module["floor_cm"](a, b, 80.0)):
            assert_on_floor(pixel, point)
    finally:
        module["TABLES"].close()


def test_micropython_interpreter(tmp_path):
    (exported,) = om.write_maps(SENSOR, AHEAD, tmp_path / "ahead.py", formats="openmv")
    pixels = [pixel for pixel, _ in floor_points(lambda a, b: None)]
    floor = f"[view.floor_cm(u, v, 80) for u, v in {np.array(pixels).tolist()}]"
    result = by_micropython(
        exported.paths, f"[view.source_pixel(160, 120), view.source_pixel(320, 0)] + {floor}"
    )
    if result is None:
        pytest.skip("MicroPython is not installed: make programs")
    assert np.hypot(*(np.array(result[0]) - om.view_map(SENSOR, AHEAD).dewarp_map[120, 160])) < 0.03
    assert result[1] is None
    for pixel, point in zip(pixels, result[2:], strict=True):
        assert_on_floor(pixel, point)


def test_cortex_m7_result_and_instructions(c_file, library):
    """Same result as on this machine, in less than 9.6 million instructions (20 ms at 480 MHz)."""
    result = on_a_cortex_m7(c_file)
    if result is None:
        pytest.skip("qemu-system-arm and ziglang are not installed: make programs")
    instructions, total = result
    noise = accumulate(
        range(512 * 500), lambda each, _: (1664525 * each + 1013904223) % 2**32, initial=1
    )
    source = (np.array(list(noise)[1:]) >> 24).astype(np.uint8).reshape(500, 512, 1)
    view = dewarped_by_c(library, "ahead", source, np.zeros((240, 320, 1), np.uint8))
    assert total == reduce(lambda a, b: (31 * a + b) % 2**32, view.ravel().tolist())
    print(f"{instructions / 1e6:.2f} million instructions")
    assert instructions < 9.6e6


MAIN = """
#include "ahead.h"
static uint8_t source[AHEAD_SOURCE_WIDTH * AHEAD_SOURCE_HEIGHT], view[AHEAD_WIDTH * AHEAD_HEIGHT];
int main(int count, char **words)
{
    (void)words;
    if (count > 1) {
        ahead_dewarp(source, AHEAD_SOURCE_WIDTH, view, AHEAD_WIDTH, 1);
    }
    return view[0];
}
"""


@pytest.mark.full
def test_instructions_on_this_machine(c_file):
    """Less than 9.6 million instructions (20 ms at 480 MHz, one per cycle) by callgrind."""
    if not (shutil.which("gcc") and shutil.which("valgrind")):
        pytest.skip("gcc and valgrind are not installed")
    main = c_file.with_name("main.c")
    main.write_text(MAIN)
    subprocess.run(["gcc", "-std=c99", "-O2", main, c_file, "-o", main.with_suffix("")], check=True)
    counts = []
    for arguments in ([], ["1"]):
        run = [
            "valgrind",
            "--tool=callgrind",
            "--callgrind-out-file=/dev/null",
            main.with_suffix(""),
            *arguments,
        ]
        log = subprocess.run(run, capture_output=True, text=True).stderr
        counts.append(int(log.split("Collected :")[1].split()[0]))
    print(f"{(counts[1] - counts[0]) / 1e6:.2f} million instructions")
    assert counts[1] - counts[0] < 9.6e6


# -- errors -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["c99", "openmv", "gstreamer", "depthai"])
def test_discontinuous_views_raise(kind, tmp_path):
    with pytest.raises(InvalidParameter, match="single view"):
        om.write_maps(
            SENSOR, om.views.cube(SENSOR, (192, 128), layout="3x2"), tmp_path, formats=kind
        )
    assert not list(tmp_path.iterdir())


def test_all_formats_are_tested():
    tested = {
        "stmap",
        "opencv",
        "opencv-yml",
        "ffmpeg",
        "glsl",
        "hlsl",
        "vpi",
        "c99",
        "openmv",
        "gstreamer",
        "depthai",
        "obs",
    }
    assert set(MAP_FORMATS) == tested
