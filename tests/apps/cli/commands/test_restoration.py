"""Command-line options of restoration and bracketing."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

import omnimirror as om
from omnimirror.dewarp.restoration.blur_kernels import blur_sizes
from omnimirror.dewarp.restoration.deblurring import _exposure_words
from omnimirror.dewarp.restoration.focus_bracketing import focused_at
from omnimirror.io.exif import exposure_of, parse_exif
from omnimirror.optics.image_sensor import Imager
from tests.commands import omnimirror


@pytest.fixture
def small(tmp_path) -> om.Sensor:
    """A sensor with few pixels, its file and a matching image."""
    sensor = om.load_sensor("paper-hyperboloidal")
    sensor = replace(sensor, imager=Imager(128, 128, 41.6), lens=replace(sensor.lens, f_number=1.0))
    om.save_sensor(sensor, tmp_path / "small.toml")
    light = np.random.default_rng(1).random((32, 64, 3), np.float32)
    picture = om.take_picture(sensor, om.Environment(light), samples=16, blur=True)
    om.write_image(tmp_path / "raw.png", picture)
    om.write_image(tmp_path / "world.hdr", light)
    return sensor


@pytest.mark.long
def test_restoration_precedes_dewarping(small, tmp_path):
    options = ("--sensor", "small.toml", "--view", "panorama", "--size", "256x")
    assert (
        omnimirror("dewarp", "raw.png", *options, "-o", "given.png", cwd=tmp_path).returncode == 0
    )
    run = omnimirror(
        "dewarp",
        "raw.png",
        *options,
        "--restore",
        "--noise",
        "0.01",
        "-o",
        "sharp.png",
        cwd=tmp_path,
    )
    assert run.returncode == 0, run.stderr
    restored = om.restore(small, om.read_image(tmp_path / "raw.png"), noise=0.01)
    om.write_image(tmp_path / "restored.png", restored)
    assert (
        omnimirror("dewarp", "restored.png", *options, "-o", "both.png", cwd=tmp_path).returncode
        == 0
    )
    given, sharp, both = (
        om.read_image(tmp_path / f"{name}.png") for name in ("given", "sharp", "both")
    )
    np.testing.assert_array_equal(sharp, both)
    assert (sharp != given).any()


@pytest.mark.full
@pytest.mark.long
def test_restoration_of_nearby_objects(small, tmp_path):
    options = (
        "--sensor",
        "small.toml",
        "--view",
        "panorama",
        "--size",
        "256x",
        "--restore",
        "--noise",
        "0.01",
    )
    run = omnimirror(
        "dewarp", "raw.png", *options, "--object-distance-mm", "300", "-o", "near.png", cwd=tmp_path
    )
    assert run.returncode == 0, run.stderr
    raw = om.read_image(tmp_path / "raw.png")
    near, far = (
        om.restore(small, raw, noise=0.01, object_distance_mm=distance)
        for distance in (300.0, np.inf)
    )
    assert (near != far).any()
    om.write_image(tmp_path / "restored.png", near)
    assert (
        omnimirror(
            "dewarp", "restored.png", *options[:6], "-o", "both.png", cwd=tmp_path
        ).returncode
        == 0
    )
    np.testing.assert_array_equal(
        om.read_image(tmp_path / "near.png"), om.read_image(tmp_path / "both.png")
    )


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        (("--sensor", "small.toml", "--noise", "0.01"), "--noise requires --restore"),
        (
            ("--sensor", "small.toml", "--object-distance-mm", "300"),
            "--object-distance-mm requires --restore",
        ),
        (
            ("--sensor", "small.toml", "--restore", "--viewer", "v.html"),
            "--viewer and --restore must not be given together",
        ),
        (("--ball", "64,64,50,180", "--blur-px", "2"), "--blur-px requires --restore"),
        (
            ("--ball", "64,64,50,180", "--restore", "--blur-px", "1,2,3"),
            "--blur-px must be a diameter, T,S or a file; got 1,2,3",
        ),
        (
            ("--ball", "64,64,50,180", "--restore", "--blur-px", "no.csv"),
            "cannot read the blur no.csv",
        ),
        (
            ("--ball", "64,64,50,180", "--restore"),
            "to restore, the lens and the mirror must be known",
        ),
    ],
)
def test_invalid_restoration_prints_one_line(small, tmp_path, options, sentence):
    run = omnimirror("dewarp", "raw.png", *options, "-o", "out.png", cwd=tmp_path)
    assert run.returncode != 0
    assert sentence in run.stderr
    assert not (tmp_path / "out.png").exists()


@pytest.mark.long
def test_ball_restored_with_given_blur(small, tmp_path):
    """Blur values on the command line and in files over radius or field angle: equal results."""
    angles = np.array([0.0, 60.0, 120.0, 180.0])
    radii = 60 * np.sin(np.radians(angles) / 2)
    for name, column, places in (("a.csv", "omega_deg", angles), ("b.csv", "radius_px", radii)):
        lines = [f"{column},t_px,s_px", *(f"{place!r},3,2" for place in places.tolist())]
        (tmp_path / name).write_text("\n".join(lines))
    options = (
        "--ball",
        "63.5,63.5,60,360",
        "--view",
        "panorama",
        "--size",
        "128x",
        "--restore",
        "--noise",
        "0.02",
    )
    found = []
    for blur in ("3,2", "a.csv", "b.csv"):
        run = omnimirror(
            "dewarp", "raw.png", *options, "--blur-px", blur, "-o", "out.png", cwd=tmp_path
        )
        assert run.returncode == 0, run.stderr
        assert "restored at a noise of 2 % (told)" in run.stdout
        found.append(om.read_image(tmp_path / "out.png"))
    np.testing.assert_array_equal(found[0], found[1])
    np.testing.assert_array_equal(found[0], found[2])


@pytest.mark.long
def test_reduced_restoration_is_reported(small, tmp_path):
    """Texture stronger than the specified noise contains no information on blur, and the message is
    limited to that."""
    grain = 128 + 5 * np.random.default_rng(2).standard_normal((128, 128, 3))
    om.write_image(tmp_path / "grain.png", grain.astype(np.uint8))
    options = (
        "--sensor",
        "small.toml",
        "--view",
        "panorama",
        "--size",
        "128x",
        "--restore",
        "--noise",
        "0.015",
    )
    run = omnimirror("dewarp", "grain.png", *options, "-o", "out.png", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "85 % of the blur is removed, since it does not show how much blur it has" in run.stdout


@pytest.mark.parametrize(
    ("f_number", "metres", "words"),
    [
        ((40, 10), 0, ""),
        ((80, 10), 0, "EXIF has F/8, the sensor F/4: 50 % of its blur is assumed"),
        ((28, 10), 0, "EXIF has F/2.8, the sensor F/4: no more than its blur is assumed"),
        ((0, 0), 5, "EXIF has a focus distance of 5000 mm"),
    ],
)
def test_different_exif_reduces_assumed_blur(f_number, metres, words):
    """EXIF data written by Pillow, parsed from the file."""
    sensor = om.load_sensor("paper-hyperboloidal")
    exif = Image.Exif()
    details = exif.get_ifd(0x8769)
    details[0x829D] = IFDRational(*f_number) if f_number[1] else IFDRational(0, 1)
    if metres:
        details[0x9206] = IFDRational(metres, 1)
    exposure = exposure_of(parse_exif(exif.tobytes().removeprefix(b"Exif\0\0")))
    restorer = om.Restoration(noise=0.01).restorer(sensor, exposure)
    assert words in _exposure_words(restorer)
    assert bool(_exposure_words(restorer)) == bool(words)
    radii = np.linspace(0.0, 500.0, 20)
    known, assumed = blur_sizes(sensor, radii), restorer.known.sizes(radii)
    assert (assumed.sagittal <= known.sagittal + 1e-9).all()
    if f_number == (80, 10):
        smaller = replace(sensor, lens=replace(sensor.lens, f_number=8.0))
        np.testing.assert_allclose(assumed.sagittal, blur_sizes(smaller, radii).sagittal, rtol=0.01)


@pytest.mark.long
def test_bracket_plan_render_and_merge(small, tmp_path):
    run = omnimirror("bracket", "plan", "small.toml", "--max-blur-px", "3", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert ", ".join(f"{f:.1f}" for f in om.plan_bracket(small, 3.0).focus_mm) in run.stdout
    scene = ("--scene", "world.hdr", "--heading-deg", "20", "--pose", "0,0,0,20")
    take = (
        "bracket",
        "render",
        "small.toml",
        "--focus-mm",
        "175,207",
        "--samples",
        "16",
        "-o",
        "b",
        *scene,
    )
    run = omnimirror(*take, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    world = om.Environment.load(tmp_path / "world.hdr")
    straight = om.take_picture(
        focused_at(small, 175.0), world, samples=16, blur=True
    )  # heading and pose cancel
    assert np.abs(om.read_image(tmp_path / "b/175.0mm.png").astype(int) - straight).max() <= 2
    merge = (
        "bracket",
        "merge",
        "small.toml",
        "b/175.0mm.png",
        "b/207.0mm.png",
        "-o",
        "merged.png",
        "--focus-mm",
    )
    assert omnimirror(*merge, "175,207", cwd=tmp_path).returncode == 0
    assert om.read_image(tmp_path / "merged.png").shape == (128, 128, 3)
    run = omnimirror(*merge, "175", cwd=tmp_path)
    assert run.returncode == 2
    assert "2 pictures and 1 focus distances" in run.stderr


def test_restore_of_video_raises(small, tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"")
    run = omnimirror(
        "dewarp", "film.mp4", "--sensor", "small.toml", "--restore", "-o", "out.mp4", cwd=tmp_path
    )
    assert run.returncode == 2
    assert "got the video film.mp4; extract its frames to a folder and restore them" in " ".join(
        run.stderr.split()
    )
