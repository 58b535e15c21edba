"""Colour profiles and EXIF data against Pillow."""

import io
import struct

import numpy as np
import pytest
from PIL import Image, ImageCms
from PIL.TiffImagePlugin import IFDRational

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.io.image_metadata import ImageMetadata, read_metadata
from omnimirror.io.images import read_image_and_metadata

PROFILE = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
SUFFIXES = [".jpg", ".png", ".webp", ".tif"]
BALL = ("--ball", "31.5,31.5,30,280", "--size", "64x", "--set=image.transparent=false")


def notes() -> Image.Exif:
    """EXIF data as written by a camera, including tags that do not apply to a dewarped image."""
    exif = Image.Exif()
    exif[0x010F], exif[0x0112], exif[0x011A] = "Maker", 6, IFDRational(300, 1)
    exif[0x8298] = "someone"
    exposure = exif.get_ifd(0x8769)
    exposure[0x829A], exposure[0x8827], exposure[0x9003] = (
        IFDRational(1, 250),
        400,
        "2024:05:06 07:08:09",
    )
    exposure[0xA002], exposure[0xA003], exposure[0x927C] = 64, 64, b"offsets of the maker's own"
    exif.get_ifd(0x8825)[2] = (IFDRational(51, 1), IFDRational(29, 1), IFDRational(123, 10))
    return exif


def pillow_file(path, mode="RGB", profile=PROFILE):
    if (
        path.suffix == ".tif"
    ):  # Pillow writes no exposure to TIFF, and reads the written one (see below)
        image, metadata = read_image_and_metadata(pillow_file(path.with_suffix(".png")))
        om.write_image(path, image, metadata=metadata)
        return path
    Image.new(mode, (64, 64), 128 if mode == "L" else (200, 100, 50)).save(
        path, exif=notes(), icc_profile=profile
    )
    return path


def assert_invariants(path):
    with Image.open(path) as image:
        assert image.info["icc_profile"] == PROFILE
        exif = image.getexif()
        exposure, position = exif.get_ifd(0x8769), exif.get_ifd(0x8825)
    assert (exif[0x010F], exif[0x8298]) == ("Maker", "someone")
    assert exif.get(0x0112, 1) == 1, "a view is drawn upright"
    assert (exposure[0x829A], exposure[0x8827], exposure[0x9003]) == (
        1 / 250,
        400,
        "2024:05:06 07:08:09",
    )
    assert not {0xA002, 0xA003, 0x927C} & set(exposure), "of the stored pixels"
    assert [float(x) for x in position[2]] == [51, 29, 12.3]


@pytest.mark.parametrize("target", SUFFIXES)
@pytest.mark.parametrize("source", SUFFIXES)
def test_dewarped_images_keep_profile_and_valid_exif(tmp_path, source, target, capsys):
    pillow_file(tmp_path / f"in{source}")
    main(["dewarp", str(tmp_path / f"in{source}"), *BALL, "-o", str(tmp_path / f"out{target}")])
    assert "without" not in capsys.readouterr().out
    assert_invariants(tmp_path / f"out{target}")
    with Image.open(
        tmp_path / f"out{target}"
    ) as image:  # panorama metadata and pixels are still written
        packet = image.tag_v2[700] if target == ".tif" else image.info["xmp"]
        assert b"GPano" in bytes(packet)
        assert (
            np.abs(np.asarray(image.convert("RGB"))[20, 32].astype(int) - [200, 100, 50]).max() < 8
        )


def test_exif_in_big_endian_order(tmp_path):
    exif = notes()
    exif.endian = ">"
    Image.new("RGB", (64, 64)).save(tmp_path / "in.png", exif=exif, icc_profile=PROFILE)
    image, metadata = read_image_and_metadata(tmp_path / "in.png")
    om.write_image(tmp_path / "out.jpg", image, metadata=metadata)
    assert_invariants(tmp_path / "out.jpg")


def test_long_jpeg_profile_is_split_into_segments(tmp_path):
    long = PROFILE + np.random.default_rng(1).bytes(150_000)
    pillow_file(tmp_path / "in.jpg", profile=long)
    image, metadata = read_image_and_metadata(tmp_path / "in.jpg")
    assert metadata.profile == long
    om.write_image(tmp_path / "out.jpg", image, metadata=metadata)
    with Image.open(tmp_path / "out.jpg") as output:
        assert output.info["icc_profile"] == long


def test_unsupported_metadata_is_reported(tmp_path, capsys):
    pillow_file(tmp_path / "a.png")
    main(["dewarp", str(tmp_path / "a.png"), *BALL, "-o", str(tmp_path / "a.bmp")])
    assert (
        "without the colour profile and EXIF, which .bmp does not support"
        in capsys.readouterr().out
    )
    pillow_file(tmp_path / "b.png", "L")  # grey, with a colour profile
    main(["dewarp", str(tmp_path / "b.png"), *BALL, "-o", str(tmp_path / "b.jpg")])
    assert "without the colour profile, whose colour space is RGB" in capsys.readouterr().out
    image, metadata = read_image_and_metadata(tmp_path / "a.png")
    with pytest.raises(om.base.errors.MediaError, match="a colour profile or EXIF requires"):
        om.write_image(tmp_path / "c.bmp", image, metadata=metadata)


def test_damaged_exif_is_ignored(tmp_path):
    """Truncation at every position, and noise at every position: no exception, and no result longer
    than the file."""
    whole = {}
    for suffix in SUFFIXES:
        data = io.BytesIO()
        Image.new("RGB", (8, 8)).save(
            data, suffix[1:].replace("jpg", "jpeg").replace("tif", "tiff"), exif=notes()
        )
        whole[suffix] = data.getvalue()
    rng = np.random.default_rng(2)
    for data in whole.values():
        for _ in range(300):
            broken = bytearray(data[: rng.integers(1, len(data) + 1)])
            broken[rng.integers(0, len(broken))] = rng.integers(0, 256)
            metadata = read_metadata(bytes(broken))
            assert metadata.exif is None or len(metadata.exif.block()) < 10 * len(data)
    assert read_metadata(b"II*\0" + struct.pack("<I", 8) + b"\xff\xff") == ImageMetadata()
