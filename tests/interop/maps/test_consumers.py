"""Every format of maps, used as its program uses it: what comes out beside what we straighten."""

from __future__ import annotations

import ctypes
import json
import runpy
import shutil
import subprocess
from dataclasses import replace
from functools import reduce
from itertools import accumulate

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.interop.maps import MAP_FORMATS
from omnimirror.mirrors.pose import MirrorPose
from tests.interop.maps.consumers import (
    by_micropython,
    compiled,
    compilers,
    drawn,
    drawn_by_obs,
    glsl_of,
    on_a_cortex_m7,
    piped,
    remapped,
    straightened,
    warped,
)
from tests.studio.browser import FLAGS

SENSOR = om.load_sensor("paper-spherical")
SENSOR = replace(
    SENSOR,
    imager=replace(SENSOR.imager, width_px=512, height_px=500, pixel_pitch_um=10.4),
    mirror_pose=MirrorPose(0.5, -0.3, 0.0, 0.5, -0.4),
)
AHEAD = om.screens.Plane((320, 240), pan_deg=20.0, tilt_deg=10.0, hfov_deg=100.0)  # above the field in its corners


@pytest.fixture(scope="module")
def picture():
    return om.take_picture(SENSOR, om.Room(texel_mm=20.0), samples=4, low_pass=True)


@pytest.fixture(scope="module")
def straight(picture):
    return om.Dewarper(SENSOR, AHEAD, "linear")(picture)


@pytest.fixture(scope="module")
def seen():
    """Where something is seen, less the outermost pixels, where ours mixes with what is outside."""
    there = np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)
    assert 0.7 < there.mean() < 0.99
    return cv2.erode(there.astype(np.uint8), np.ones((3, 3))).astype(bool)


def written(kind, folder):
    (done,) = om.write_maps(SENSOR, AHEAD, folder, formats=kind)
    assert all(path.stat().st_size for path in done.paths)
    return done


def off_by(ours, theirs, seen):
    return np.abs(ours.astype(int) - theirs.astype(int))[seen].max()


def sampled(picture, x, y):
    """The grey levels at places."""
    return np.rint(between(picture, x, y))


def between(picture, x, y):
    """Between four pixels, in floats; the picture goes on as its last pixels are."""
    padded = np.pad(picture.astype(float), ((2, 2), (2, 2), (0, 0)), mode="edge")
    x, y = np.clip(x + 2.0, 0, padded.shape[1] - 2), np.clip(y + 2.0, 0, padded.shape[0] - 2)
    i, j = np.floor(x).astype(int), np.floor(y).astype(int)
    a, b = (x - i)[..., None], (y - j)[..., None]
    top = (1 - a) * padded[j, i] + a * padded[j, i + 1]
    return (1 - b) * top + b * ((1 - a) * padded[j + 1, i] + a * padded[j + 1, i + 1])


def of_st(picture, channels):
    """As compositors read it: s to the right and t up, between the outer edges of the picture."""
    height, width = picture.shape[:2]
    return sampled(picture, channels[..., 0] * width - 0.5, (1 - channels[..., 1]) * height - 0.5)


def test_st_maps_straighten_and_bend_back(picture, straight, seen, tmp_path):
    there, back = (om.read_image(path) for path in written("stmap", tmp_path).paths)
    assert there.shape == (240, 320, 4)
    assert back.shape == (500, 512, 4)
    assert off_by(straight, of_st(picture, there), seen) <= 1
    assert (there[there[..., 3] == 0][:, :2] == -1).all()
    # the tables alone, read as pictures are: from the picture to the view, and on to the picture
    rows, columns = np.nonzero(back[..., 3])
    s, t = back[rows, columns, 0] * 320 - 0.5, (1 - back[rows, columns, 1]) * 240 - 0.5
    inside = (s > 1) & (s < 318) & (t > 1) & (t < 238)
    inside &= seen[np.clip(np.rint(t).astype(int), 0, 239), np.clip(np.rint(s).astype(int), 0, 319)]
    again = between(there[..., :2], s, t)
    off = np.hypot(again[:, 0] * 512 - 0.5 - columns, (1 - again[:, 1]) * 500 - 0.5 - rows)
    assert inside.sum() > 5000
    assert np.percentile(off[inside], 99) < 0.02


def test_openimageio_warps_by_st_maps(picture, straight, seen, tmp_path, beside):
    oiio = pytest.importorskip("OpenImageIO", reason="OpenImageIO is installed by `make test-full` only")
    theirs = warped(oiio, picture, written("stmap", tmp_path).paths[0])[..., :3]
    off = np.abs(theirs - straight)[seen].max()
    what = "a view by its st_warp with our ST map, largest difference in grey levels"
    beside("OpenImageIO", what, off, 1, "")


def test_opencv_maps_of_floats_and_of_fixed_points(picture, straight, seen, tmp_path, beside):
    maps = np.load(written("opencv", tmp_path).paths[0])
    floats = cv2.remap(picture, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)
    fixed = cv2.remap(picture, maps["fixed_map1"], maps["fixed_map2"], cv2.INTER_LINEAR)
    assert off_by(straight, sampled(picture, maps["map_x"], maps["map_y"]), seen) <= 1
    # OpenCV rounds places to 1/32 px when it samples, whichever map it is given: at hard edges that shows
    assert np.mean(np.abs(fixed.astype(float) - floats)[seen]) < 0.3
    off = np.mean(np.abs(straight.astype(float) - floats)[seen])
    beside("OpenCV", "a view by cv2.remap with our maps, mean difference in grey levels", off, 0.3, "")
    assert tuple(maps["source_size"]) == (512, 500)


def test_opencv_reads_its_yaml(tmp_path):
    npz, yml = (written(kind, tmp_path).paths[0] for kind in ("opencv", "opencv-yml"))
    maps, storage = np.load(npz), cv2.FileStorage(str(yml), cv2.FILE_STORAGE_READ)
    for name in ("map_x", "map_y", "fixed_map1", "fixed_map2"):
        assert (storage.getNode(name).mat() == maps[name]).all()


def test_ffmpeg_takes_the_nearest_pixel(picture, tmp_path, beside):
    pytest.importorskip("av")
    done = written("ffmpeg", tmp_path)
    theirs = remapped(done.paths, picture)
    places = om.view_map(SENSOR, AHEAD).straighten
    there = np.isfinite(places).all(-1)
    near = np.rint(np.nan_to_num(places)).astype(int)
    near = np.clip(near, 0, [511, 499])
    ours = np.where(there[..., None], picture[near[..., 1], near[..., 0]], 0)
    off = 100 * (theirs != ours).mean()
    beside("FFmpeg", "values of a view by its filter remap with our maps that differ", off, 0.1, "%")
    assert 0.5 < done.deviation.size <= np.sqrt(0.5)


def test_ffmpeg_loses_half_as_much_in_a_view_twice_as_large_that_is_scaled_down(picture, seen, tmp_path):
    pytest.importorskip("av")
    ours = om.Dewarper(SENSOR, AHEAD)(picture).astype(float)
    off = []
    for times in (1, 2):
        view = replace(AHEAD, size=(320 * times, 240 * times))
        (done,) = om.write_maps(SENSOR, view, tmp_path / f"{times}.pgm", formats="ffmpeg")
        theirs = cv2.resize(remapped(done.paths, picture), (320, 240), interpolation=cv2.INTER_AREA)
        off.append(np.sqrt(np.mean((theirs - ours)[seen] ** 2)))
    assert off[1] < 0.65 * off[0]


def test_vpi_gets_a_place_for_each_pixel(picture, straight, seen, tmp_path):
    warp = np.load(written("vpi", tmp_path).paths[0])
    assert warp.dtype == np.float32
    assert off_by(straight, sampled(picture, warp[..., 0], warp[..., 1]), seen) <= 1


# -- a shader, in a browser ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def page(launched):
    browser = launched(FLAGS)
    yield browser.new_page()
    browser.close()


@pytest.mark.long
def test_the_glsl_shader_draws_the_view(page, picture, straight, seen, tmp_path):
    paths = written("glsl", tmp_path).paths
    theirs = drawn(page, paths[0], picture, (320, 240), paths[1], (320, 240))
    assert off_by(straight, theirs, seen) <= 1
    assert (theirs[~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()
    larger = drawn(page, paths[0], picture, (640, 480), paths[1], (320, 240))  # between the pixels of the table
    ours = om.Dewarper(SENSOR, replace(AHEAD, size=(640, 480)), "linear")(picture)
    inside = cv2.resize(seen.astype(np.uint8), (640, 480), interpolation=cv2.INTER_NEAREST) > 0
    assert np.mean(np.abs(ours.astype(float) - larger)[inside]) < 0.5


def test_the_hlsl_shader_has_the_same_table(tmp_path):
    glsl, hlsl = (written(kind, tmp_path).paths for kind in ("glsl", "hlsl"))
    assert glsl[1].read_bytes() == hlsl[1].read_bytes()
    assert "float2(512.0, 500.0)" in hlsl[0].read_text()


@pytest.mark.full
def test_the_hlsl_shader_draws_the_view(page, picture, straight, seen, tmp_path):
    paths = written("hlsl", tmp_path).paths
    translated = glsl_of(paths[0])
    if translated is None:
        pytest.skip("there are no glslang and SPIRV-Cross here: make programs")
    theirs = drawn(page, translated, picture, (320, 240), paths[1], (320, 240))[::-1]  # Direct3D counts from the top
    assert off_by(straight, theirs, seen) <= 1
    assert (theirs[~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()


def test_obs_gets_a_picture_of_the_map(tmp_path):
    effect, table = written("obs", tmp_path).paths
    digits = om.read_image(table).astype(float)
    found = digits @ [256.0, 1.0, 1 / 256] - 1
    places, there = om.view_map(SENSOR, AHEAD).straighten, digits[:, :320].any(-1)
    assert (there == np.isfinite(places).all(-1)).all()
    assert np.abs(np.stack([found[:, :320], found[:, 320:]], -1) - places)[there].max() <= 1 / 512 + 1e-9
    assert f'"{table.name}"' in effect.read_text()


def test_obs_draws_the_view(picture, straight, seen, tmp_path, beside):
    theirs = drawn_by_obs(*written("obs", tmp_path).paths, picture, (320, 240), tmp_path)
    if theirs is None:
        pytest.skip("there is no libobs here: make programs")
    off = off_by(straight, theirs, seen)
    what = "a view by its library with our effect, largest difference in grey levels"
    beside("OBS Studio", what, off, 1, "", (tmp_path / "version.txt").read_text())
    assert (theirs[~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()


@pytest.mark.full
def test_glshaders_shader_holds_the_map_itself(page, picture, straight, seen, tmp_path):
    done = written("gstreamer", tmp_path)
    assert done.deviation.size < 0.03
    theirs = drawn(page, done.paths[1], picture, (320, 240))
    assert off_by(straight, theirs, seen) <= 1
    assert (theirs[~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()


def test_a_shader_that_would_be_too_long_has_fewer_nodes(tmp_path):
    """The rings that two mirrors hide bend the map, so that nodes every 4 px are wanted: more than a command holds."""
    sensor = om.load_sensor("folded-hyperboloidal")
    around = om.views.panorama(sensor, (640, None))
    (done,) = om.write_maps(sensor, around, tmp_path / "around.sh", formats="gstreamer")
    assert 0.02 < done.deviation.size < 0.1
    assert "every 8 px" in done.deviation.why
    assert done.paths[1].stat().st_size <= 120_000


def test_gstreamer_straightens(picture, straight, seen, tmp_path, beside):
    theirs = piped(written("gstreamer", tmp_path).paths[0], picture, tmp_path)
    if theirs is None:
        pytest.skip("there is no GStreamer with OpenGL here: make programs")
    off = off_by(straight, theirs, seen)
    version = subprocess.run(["gst-launch-1.0", "--version"], capture_output=True, text=True).stdout.split("\n")[1]
    beside(
        "GStreamer",
        "a view by its glshader with our shader, largest difference in grey levels",
        off,
        1,
        "",
        version.removeprefix("GStreamer "),
    )
    assert (theirs[~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()


def test_depthais_mesh_is_the_map_between_straight_lines(tmp_path):
    """Its points are asked for by another interpolation than the one that tells their deviation."""
    view, sensor = replace(AHEAD, tilt_deg=-25.0), replace(SENSOR, imager=replace(SENSOR.imager, width_px=528))
    (done,) = om.write_maps(sensor, view, tmp_path / "ahead.json")
    mesh = json.loads(done.paths[0].read_text())
    points = np.float32(mesh["points"]).reshape(mesh["mesh_height"], mesh["mesh_width"], 2)
    assert tuple(mesh["size"]) == (320, 240)
    assert points.shape == (16, 21, 2)
    rows, columns = np.mgrid[:240, :320].astype(np.float32) / 16
    places = om.view_map(sensor, view).straighten
    there = np.isfinite(places).all(-1)
    near = np.stack([between(points[..., k : k + 1], columns, rows)[..., 0] for k in (0, 1)], axis=-1)
    off = np.linalg.norm(near - places, axis=-1)[there].max()
    assert abs(off - done.deviation.size) < 0.01
    assert off < 2


@pytest.mark.parametrize(("width", "size"), [(512, (320, 250)), (500, (320, 240))])
def test_depthai_takes_multiples_of_sixteen(width, size, tmp_path):
    sensor = replace(SENSOR, imager=replace(SENSOR.imager, width_px=width))
    with pytest.raises(InvalidParameter, match="multiple"):
        om.write_maps(sensor, replace(AHEAD, size=size), tmp_path / "ahead.json")


# -- boards ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def c_file(tmp_path_factory):
    folder = tmp_path_factory.mktemp("c99")
    (done,) = om.write_maps(SENSOR, AHEAD, folder / "ahead.c", formats="c99")
    assert [p.name for p in done.paths] == ["ahead.c", "ahead.h"]
    assert done.deviation.size < 0.05
    return done.paths[0]


@pytest.fixture(scope="module")
def library(c_file):
    """The C file, compiled without a warning by all compilers that are here."""
    if not compilers():
        pytest.skip("there is no C compiler here")
    loaded = compiled(c_file)
    pointer = ctypes.POINTER(ctypes.c_float)
    loaded.ahead_place.argtypes = [ctypes.c_int, ctypes.c_int, pointer, pointer]
    loaded.ahead_floor_cm.argtypes = [ctypes.c_float, ctypes.c_float, ctypes.c_float, pointer, pointer]
    return loaded


@pytest.mark.parametrize("channels", [1, 3])
def test_c_straightens_as_we_do(library, picture, straight, seen, channels):
    source = np.ascontiguousarray(picture[..., :channels])
    view = np.full((240, 320 + 5, channels), 77, np.uint8)  # rows end with what is not the view's
    straightened(library, "ahead", source, view)
    assert off_by(straight[..., :channels], view[:, :320], seen) <= 1
    assert (view[:, 320:] == 77).all()
    assert (view[:, :320][~np.isfinite(om.view_map(SENSOR, AHEAD).straighten).all(-1)] == 0).all()


def test_c_knows_places_and_the_floor(library):
    u, v = ctypes.c_float(), ctypes.c_float()
    places = om.view_map(SENSOR, AHEAD).straighten
    for row, column in [(0, 0), (239, 319), (120, 160), (7, 311), (200, 3)]:
        there = np.isfinite(places[row, column]).all()
        assert library.ahead_place(column, row, u, v) == there
        assert not there or np.hypot(u.value - places[row, column, 0], v.value - places[row, column, 1]) < 0.03
    assert library.ahead_place(320, 0, u, v) == 0
    for pixel, found in floor_points(
        lambda a, b: (u.value, v.value) if library.ahead_floor_cm(a, b, 80.0, u, v) else None
    ):
        assert_on_floor(pixel, found)


def floor_points(floor):
    rng = np.random.default_rng(1)
    pixels = rng.uniform([100, 100], [400, 400], (200, 2)).astype(np.float32).astype(float)
    return [(pixel, floor(*pixel)) for pixel in pixels]


def assert_on_floor(pixel, found):
    """By the tracer's own ray; no farther than three heights."""
    (origin,), (way,), _ = SENSOR.backproject([pixel])
    far = (-800.0 - origin[2]) / way[2] if way[2] else -1.0
    point = (origin + far * way)[:2] / 10
    if far > 0 and np.hypot(*point) < 240:
        assert np.hypot(*(np.array(found) - point)) < 0.1
    if way[2] > 0:
        assert found is None


def test_micropython_knows_the_same(tmp_path):
    """Run by this Python: of the language it takes no more than MicroPython has."""
    (done,) = om.write_maps(SENSOR, AHEAD, tmp_path / "ahead.py", formats="openmv")
    module = runpy.run_path(str(done.paths[0]))
    try:
        places = om.view_map(SENSOR, AHEAD).straighten
        for row, column in [(120, 160), (200, 3), (100, 311)]:
            assert np.hypot(*(np.array(module["place"](column, row)) - places[row, column])) < 0.03
        assert module["place"](320, 0) is None
        for pixel, found in floor_points(lambda a, b: module["floor_cm"](a, b, 80.0)):
            assert_on_floor(pixel, found)
    finally:
        module["TABLES"].close()


def test_micropython_itself_knows_the_same(tmp_path):
    (done,) = om.write_maps(SENSOR, AHEAD, tmp_path / "ahead.py", formats="openmv")
    pixels = [pixel for pixel, _ in floor_points(lambda a, b: None)]
    floor = f"[view.floor_cm(u, v, 80) for u, v in {np.array(pixels).tolist()}]"
    found = by_micropython(done.paths, f"[view.place(160, 120), view.place(320, 0)] + {floor}")
    if found is None:
        pytest.skip("there is no MicroPython here: make programs")
    assert np.hypot(*(np.array(found[0]) - om.view_map(SENSOR, AHEAD).straighten[120, 160])) < 0.03
    assert found[1] is None
    for pixel, point in zip(pixels, found[2:], strict=True):
        assert_on_floor(pixel, point)


def test_a_cortex_m7_straightens_as_this_machine_does_and_in_time(c_file, library):
    """20 ms of an OpenMV H7's 480 MHz are 9.6 million clocks; in each that core starts up to two instructions."""
    found = on_a_cortex_m7(c_file)
    if found is None:
        pytest.skip("there is no qemu-system-arm with ziglang here: make programs")
    instructions, total = found
    noise = accumulate(range(512 * 500), lambda each, _: (1664525 * each + 1013904223) % 2**32, initial=1)
    source = (np.array(list(noise)[1:]) >> 24).astype(np.uint8).reshape(500, 512, 1)
    view = straightened(library, "ahead", source, np.zeros((240, 320, 1), np.uint8))
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
def test_a_view_of_320_x_240_costs_few_instructions(c_file):
    """20 ms of a core of 480 MHz, as an OpenMV H7 has, are 9.6 million instructions, one each clock."""
    if not (shutil.which("gcc") and shutil.which("valgrind")):
        pytest.skip("instructions are counted by gcc and valgrind, which are not both here")
    main = c_file.with_name("main.c")
    main.write_text(MAIN)
    subprocess.run(["gcc", "-std=c99", "-O2", main, c_file, "-o", main.with_suffix("")], check=True)
    counts = []
    for words in ([], ["1"]):
        run = ["valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", main.with_suffix(""), *words]
        said = subprocess.run(run, capture_output=True, text=True).stderr
        counts.append(int(said.split("Collected :")[1].split()[0]))
    print(f"{(counts[1] - counts[0]) / 1e6:.2f} million instructions")
    assert counts[1] - counts[0] < 9.6e6


# -- what cannot be ----------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["c99", "openmv", "gstreamer", "depthai"])
def test_few_nodes_hold_no_mosaic(kind, tmp_path):
    with pytest.raises(InvalidParameter, match="valid are single views"):
        om.write_maps(SENSOR, om.views.cube(SENSOR, (192, 128), layout="3x2"), tmp_path, formats=kind)
    assert not list(tmp_path.iterdir())


def test_every_format_is_tried_here():
    tried = {
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
    assert set(MAP_FORMATS) == tried
