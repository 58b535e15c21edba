"""Command-line options of restoration and bracketing."""

from dataclasses import replace

import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

import omnimirror as om
from omnimirror.base.errors import OmnimirrorWarning
from omnimirror.dewarp.restoration.blur_model import blur_sizes
from omnimirror.dewarp.restoration.focus_bracketing import focused_at
from omnimirror.io.image_metadata import exposure_of, parse_exif
from omnimirror.optics.image_sensor import Imager
from tests.commands import omnimirror


@pytest.fixture
def small(tmp_path) -> om.Sensor:
    """A sensor with few pixels, its file and a matching image."""
    sensor = om.load_sensor("paper-hyperboloidal")
    sensor = replace(sensor, imager=Imager(128, 128, 41.6), lens=replace(sensor.lens, f_number=1.0))
    om.save_sensor(sensor, tmp_path / "small.toml")
    light = np.random.default_rng(1).random((32, 64, 3), np.float32)
    image = om.render_image(sensor, om.Environment(light), samples=16, blur=True)
    om.write_image(tmp_path / "raw.png", image)
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
        "--set",
        "restoration.noise=0.01",
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
    plain, sharp, both = (
        om.read_image(tmp_path / f"{name}.png") for name in ("given", "sharp", "both")
    )
    np.testing.assert_array_equal(sharp, both)
    assert (sharp != plain).any()


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
        "--set",
        "restoration.noise=0.01",
    )
    run = omnimirror(
        "dewarp",
        "raw.png",
        *options,
        "--set",
        "restoration.object_distance_mm=300",
        "-o",
        "near.png",
        cwd=tmp_path,
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
    ("options", "message"),
    [
        (
            ("--sensor", "small.toml", "--set", "restoration.noise=0.01"),
            "--set restoration.noise requires --restore",
        ),
        (
            ("--sensor", "small.toml", "--set", "restoration.object_distance_mm=300"),
            "--set restoration.object_distance_mm requires --restore",
        ),
        (
            ("--sensor", "small.toml", "--restore", "-o", "v.html"),
            "--restore does not apply to the HTML viewer v.html",
        ),
        (
            ("--ball", "64,64,50,180", "--set", "restoration.blur_px=2"),
            "--set restoration.blur_px requires --restore",
        ),
        (
            ("--ball", "64,64,50,180", "--restore", "--set", "restoration.blur_px=1,2,3"),
            "restoration.blur_px must be a number or a tuple of 2 values",
        ),
        (
            ("--ball", "64,64,50,180", "--restore", "--set", "restoration.blur_px=no.csv"),
            "cannot read the blur table no.csv",
        ),
        (
            ("--ball", "64,64,50,180", "--restore"),
            "blur_px must be specified unless the camera is a sensor",
        ),
    ],
)
def test_invalid_restoration_prints_one_line(small, tmp_path, options, message):
    run = omnimirror("dewarp", "raw.png", *options, "-o", "out.png", cwd=tmp_path)
    assert run.returncode != 0
    assert message in run.stderr
    assert not (tmp_path / "out.png").exists()


@pytest.mark.long
def test_ball_restored_with_given_blur(small, tmp_path):
    """Blur values on the command line and in files over radius or field angle: equal results."""
    angles = np.array([0.0, 60.0, 120.0, 180.0])
    radii = 60 * np.sin(np.radians(angles) / 2)
    for name, column, positions in (("a.csv", "omega_deg", angles), ("b.csv", "radius_px", radii)):
        lines = [f"{column},t_px,s_px", *(f"{position!r},3,2" for position in positions.tolist())]
        (tmp_path / name).write_text("\n".join(lines))
    options = (
        "--ball",
        "63.5,63.5,60,360",
        "--view",
        "panorama",
        "--size",
        "128x",
        "--restore",
        "--set",
        "restoration.noise=0.02",
    )
    images = []
    for blur in ("3,2", "a.csv", "b.csv"):
        run = omnimirror(
            "dewarp",
            "raw.png",
            *options,
            "--set",
            f"restoration.blur_px={blur}",
            "-o",
            "out.png",
            cwd=tmp_path,
        )
        assert run.returncode == 0, run.stderr
        assert "restored with noise of 2 % (specified)" in run.stdout
        images.append(om.read_image(tmp_path / "out.png"))
    np.testing.assert_array_equal(images[0], images[1])
    np.testing.assert_array_equal(images[0], images[2])


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
        "--set",
        "restoration.noise=0.015",
    )
    run = omnimirror("dewarp", "grain.png", *options, "-o", "out.png", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert "85 % of the blur is removed because its blur cannot be estimated" in run.stdout


@pytest.mark.parametrize(
    ("f_number", "metres", "message"),
    [
        ((40, 10), 0, ""),
        ((80, 10), 0, "EXIF has F/8, the sensor F/4: 50 % of the blur is assumed"),
        ((28, 10), 0, "EXIF has F/2.8, the sensor F/4: the blur of the sensor is assumed"),
        (8.0, 0, "EXIF has F/8, the sensor F/4"),
        ("APEX", 0, "EXIF has F/8, the sensor F/4: 50 % of the blur is assumed"),
        ((0, 1), 5, "EXIF has a focus distance of 5000 mm"),
    ],
)
def test_different_exif_reduces_assumed_blur(f_number, metres, message):
    """EXIF data written by Pillow, parsed from the file."""
    sensor = om.load_sensor("paper-hyperboloidal")
    exif = Image.Exif()
    details = exif.get_ifd(0x8769)
    if f_number == "APEX":
        details[0x829D], details[0x9202], f_number = IFDRational(0, 1), IFDRational(6, 1), (80, 10)
    else:
        details[0x829D] = f_number if isinstance(f_number, float) else IFDRational(*f_number)
    if metres:
        details[0x9206] = IFDRational(metres, 1)
    exposure = exposure_of(parse_exif(exif.tobytes().removeprefix(b"Exif\0\0")))
    restorer = om.Restoration(noise=0.01).restorer(sensor, exposure)
    assert message in restorer.exposure_words
    assert bool(restorer.exposure_words) == bool(message)
    radii = np.linspace(0.0, 500.0, 20)
    nominal, assumed = blur_sizes(sensor, radii), restorer.known.sizes(radii)
    assert (assumed.sagittal <= nominal.sagittal + 1e-9).all()
    if f_number == (80, 10):
        smaller = replace(sensor, lens=replace(sensor.lens, f_number=8.0))
        np.testing.assert_allclose(assumed.sagittal, blur_sizes(smaller, radii).sagittal, rtol=0.01)


@pytest.mark.parametrize(("f_number", "is_other"), [(2.0, True), (1.02, False)])
def test_restore_compares_the_exif_data_of_a_file(small, tmp_path, f_number, is_other):
    """The result is that of a sensor with the aperture in the file, and the reason is reported."""
    exif = Image.Exif()
    exif[0x010F] = "Maker"
    exif.get_ifd(0x8769)[0x829D] = IFDRational(round(100 * f_number), 100)
    image = om.read_image(tmp_path / "raw.png")
    Image.fromarray(image).save(tmp_path / "stopped.png", exif=exif)
    notes = []
    restored = om.restore(small, tmp_path / "stopped.png", noise=0.003, on_note=notes.append)
    other_sensor = replace(small, lens=replace(small.lens, f_number=f_number if is_other else 1.0))
    expected, nominal = (
        om.restore(other_sensor, image, noise=0.003),
        om.restore(small, image, noise=0.003),
    )
    # The limit of small blur is estimated from the image with different kernels.
    assert np.abs(restored.astype(int) - expected).mean() <= 0.5
    assert (np.abs(restored.astype(int) - nominal).mean() > 1) == is_other
    assert [
        ("EXIF has F/2, the sensor F/1: 50 % of the blur is assumed" in note) for note in notes
    ] == [is_other]
    if is_other:
        with pytest.warns(OmnimirrorWarning, match=r"stopped\.png: .*EXIF has F/2"):
            om.restore(small, str(tmp_path / "stopped.png"), noise=0.01)


@pytest.mark.long
def test_bracket_plan_render_and_merge(small, tmp_path):
    run = omnimirror("bracket", "plan", "small.toml", "--max-blur-px", "3", cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    assert ", ".join(f"{f:.1f}" for f in om.plan_bracket(small, 3.0).focus_mm) in run.stdout
    scene = ("--scene", "world.hdr", "--set", "scene.heading_deg=20", "--pose", "0,0,0,20")
    render = (
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
    run = omnimirror(*render, cwd=tmp_path)
    assert run.returncode == 0, run.stderr
    world = om.Environment.load(tmp_path / "world.hdr")
    expected = om.render_image(
        focused_at(small, 175.0), world, samples=16, blur=True
    )  # heading and pose cancel
    assert np.abs(om.read_image(tmp_path / "b/175.0mm.png").astype(int) - expected).max() <= 2
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
    assert "focus_mm must have one distance per image; got 1 distances for 2 images" in run.stderr


def test_restore_of_video_raises(small, tmp_path):
    (tmp_path / "film.mp4").write_bytes(b"")
    run = omnimirror(
        "dewarp", "film.mp4", "--sensor", "small.toml", "--restore", "-o", "out.mp4", cwd=tmp_path
    )
    assert run.returncode == 2
    assert "got the video film.mp4; extract its frames to a folder and restore them" in " ".join(
        run.stderr.split()
    )
