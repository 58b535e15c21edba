"""Panorama metadata of images and videos, read back by other programs and a small parser."""

import struct
import xml.etree.ElementTree as ET

import av
import cv2
import numpy as np
import pytest
from PIL import Image

from omnimirror.base.errors import InvalidParameter, MediaError
from omnimirror.io._panorama import GPano
from omnimirror.io.images import can_be_panorama, read_image, write_image
from omnimirror.io.mp4 import can_be_spherical
from omnimirror.io.video_frames import frame_of_image
from omnimirror.io.video_reader import VideoReader
from omnimirror.io.video_writer import VideoWriter
from tests.io.synthetic import images_of

RNG = np.random.default_rng(5)
GPANO = "{http://ns.google.com/photos/1.0/panorama/}"
GSPHERICAL = "{http://ns.google.com/videos/1.0/spherical/}"
PART = GPano.of_view(
    (60, 40), (-70.0, 50.0), span_deg=120.0, heading_deg=-30.0, tilt_deg=(12.5, -3.25)
)

# -- geometry
# ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "elevation", "span", "full", "at"),
    [
        ((1440, 720), (-90, 90), 360, (1440, 720), (0, 0)),
        ((1440, 540), (-90, 45), 360, (1440, 720), (0, 180)),
        ((1440, 540), (-45, 90), 360, (1440, 720), (0, 0)),
        ((480, 240), (-30, 30), 120, (1440, 720), (480, 240)),
        ((1001, 333), (-33.3, 21.7), 360, (1001, 1090), (0, 414)),
    ],
)
def test_crop_position_matches_view(size, elevation, span, full, at):
    panorama = GPano.of_view(size, elevation, span)
    assert (panorama.full_size, panorama.cropped_size, panorama.cropped_at) == (full, size, at)


def test_crop_is_inside_full_panorama():
    for _ in range(500):
        low, high = np.sort(RNG.uniform(-90, 90, 2))
        size = tuple(int(n) for n in RNG.integers(1, 3000, 2))
        panorama = GPano.of_view(size, (low, high), RNG.uniform(1, 360))
        bounds = panorama.bounds
        assert min(bounds) >= 0
        # Rows are accurate to rounding to whole pixels, of which there may be few.
        assert abs(bounds.top - (90 - high) / 180) <= 1 / panorama.full_size[1]
        assert abs(bounds.bottom - (90 + low) / 180) <= 2 / panorama.full_size[1]


@pytest.mark.parametrize(
    ("elevation", "span"), [((10, 10), 360), ((-91, 0), 360), ((0, 10), 0), ((0, 10), 361)]
)
def test_invalid_panorama_raises(elevation, span):
    with pytest.raises(
        InvalidParameter,
        match="span_deg must be greater than 0 and at most 360 deg, and elevation_deg must increase from ",
    ):
        GPano.of_view((10, 10), elevation, span)
    with pytest.raises(
        InvalidParameter,
        match="the crop must be inside the panorama of 10 px width; got 5 px from 6 px",
    ):
        GPano((10, 10), (5, 5), (6, 0))


# -- images
# ------------------------------------------------------------------------------------------


def xmp_of(path):
    """Return the GPano fields found by Pillow."""
    with Image.open(path) as image:
        image.load()
        packet = image.tag_v2[700] if image.format == "TIFF" else image.info["xmp"]
    if isinstance(packet, tuple):
        packet = bytes(packet)
    start, end = packet.index(b"<x:xmpmeta"), packet.index(b"</x:xmpmeta>") + 12
    (description,) = ET.fromstring(packet[start:end]).iter(
        "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}Description"
    )
    return {
        key.removeprefix(GPANO): value
        for key, value in description.items()
        if key.startswith(GPANO)
    }


@pytest.mark.parametrize(
    ("suffix", "dtype", "channels"),
    [
        (".jpg", "uint8", 3),
        (".JPEG", "uint8", 1),
        (".png", "uint8", 3),
        (".png", "uint16", 4),
        (".webp", "uint8", 3),
        (".webp", "uint8", 4),
        (".tif", "uint8", 3),
        (".tiff", "float32", 1),
    ],
)
def test_panorama_metadata_is_read_by_pillow(tmp_path, suffix, dtype, channels):
    image = (RNG.random((40, 60, channels)) * (1 if dtype == "float32" else 255)).astype(dtype)
    if channels == 4:
        image[..., 3] = np.maximum(image[..., 3], 1)
    path, plain = tmp_path / f"a{suffix}", tmp_path / f"b{suffix}"
    write_image(path, image, panorama=PART)
    write_image(plain, image)
    assert xmp_of(path) == {
        "UsePanoramaViewer": "True",
        "ProjectionType": "equirectangular",
        "FullPanoWidthPixels": "180",
        "FullPanoHeightPixels": "60",
        "CroppedAreaImageWidthPixels": "60",
        "CroppedAreaImageHeightPixels": "40",
        "CroppedAreaLeftPixels": "60",
        "CroppedAreaTopPixels": "13",
        "PoseHeadingDegrees": "330",
        "PosePitchDegrees": "12.5",
        "PoseRollDegrees": "-3.25",
    }
    np.testing.assert_array_equal(read_image(path), read_image(plain))
    if channels == 3 and dtype == "uint8":
        with Image.open(path) as panorama_image, Image.open(plain) as other:
            np.testing.assert_array_equal(np.asarray(panorama_image), np.asarray(other))


def test_lossy_webp_stores_panorama(tmp_path):
    from omnimirror.io import image_metadata

    _, data = cv2.imencode(
        ".webp", RNG.integers(0, 255, (41, 63, 3)).astype(np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 50]
    )
    (tmp_path / "a.webp").write_bytes(image_metadata._xmp_in_webp(data.tobytes(), PART.xmp()))
    assert xmp_of(tmp_path / "a.webp")["CroppedAreaTopPixels"] == "13"
    with Image.open(tmp_path / "a.webp") as image:
        assert image.size == (63, 41)


def test_missing_heading_is_not_written(tmp_path):
    write_image(
        tmp_path / "a.png",
        np.zeros((40, 60), np.uint8),
        panorama=GPano.of_view((60, 40), (-70, 50)),
    )
    assert "PoseHeadingDegrees" not in xmp_of(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", [".bmp", ".hdr", ".exr"])
def test_image_format_without_panorama_support_raises(tmp_path, suffix):
    assert not can_be_panorama(f"a{suffix}")
    image = np.zeros((40, 60, 3), "uint8" if suffix == ".bmp" else "float32")
    with pytest.raises(
        MediaError, match=r"panorama metadata requires \.jpg, \.jpeg, \.png, \.webp, \.tif, \.tiff"
    ):
        write_image(tmp_path / f"a{suffix}", image, panorama=PART)
    with pytest.raises(
        MediaError, match=r"the image must have the size of panorama, 60 x 40 px; got 60 x 41 px"
    ):
        write_image(tmp_path / "a.png", np.zeros((41, 60), np.uint8), panorama=PART)
    assert not list(tmp_path.iterdir())


# -- videos ------------------------------------------------------------------------------------------

NESTED = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"sv3d", b"proj"}


def atoms(data, path=b"", start=0, end=None):
    """Yield all boxes of an MP4 as pairs of path and content."""
    end = len(data) if end is None else end
    while start < end:
        size, kind = struct.unpack_from(">I4s", data, start)
        head = 8
        if size == 1:
            (size,), head = struct.unpack_from(">Q", data, start + 8), 16
        assert head <= size <= end - start, (path, kind, size)
        yield path + b"/" + kind, data[start + head : start + size]
        inner = {b"stsd": 8, b"avc1": 78, b"hvc1": 78, b"hev1": 78}.get(
            kind, 0 if kind in NESTED else None
        )
        if inner is not None:
            yield from atoms(data, path + b"/" + kind, start + head + inner, start + size)
        start += size


def grey_video(path, panorama, **more):
    with VideoWriter(path, (60, 40), 25, panorama, **more) as video:
        for i in range(30):
            video.write(frame_of_image(np.full((40, 60, 3), 8 * i, np.uint8)))


@pytest.mark.parametrize(
    ("suffix", "codec", "entry"), [(".mp4", "libx264", b"avc1"), (".mov", "libx265", b"hev1")]
)
def test_both_spherical_versions_are_present(tmp_path, suffix, codec, entry):
    path = tmp_path / f"a{suffix}"
    grey_video(path, PART, codec=codec)
    boxes = dict(atoms(path.read_bytes()))
    text = boxes[b"/moov/trak/uuid"]
    assert text[:16].hex() == "ffcc8263f8554a938814587a02521fdd"
    fields = {
        element.tag.removeprefix(GSPHERICAL): element.text for element in ET.fromstring(text[16:])
    }
    assert fields["Spherical"] == fields["Stitched"] == "true"
    assert fields["ProjectionType"] == "equirectangular"
    names = (
        "FullPanoWidthPixels",
        "FullPanoHeightPixels",
        "CroppedAreaLeftPixels",
        "CroppedAreaTopPixels",
    )
    assert [fields[name] for name in names] == ["180", "60", "60", "13"]
    path_of_entry = b"/moov/trak/mdia/minf/stbl/stsd/" + entry
    assert boxes[path_of_entry + b"/st3d"] == bytes(5)
    assert boxes[path_of_entry + b"/sv3d/svhd"][4:] == b"omnimirror\0"
    assert struct.unpack(">3i", boxes[path_of_entry + b"/sv3d/proj/prhd"][4:]) == (
        30 << 16,
        12.5 * 65536,
        -3.25 * 65536,
    )
    bounds = struct.unpack(">4I", boxes[path_of_entry + b"/sv3d/proj/equi"][4:])
    assert np.array(bounds) / 2**32 == pytest.approx([13 / 60, 7 / 60, 1 / 3, 1 / 3])
    order = [
        name
        for name, _ in atoms(path.read_bytes())
        if name.startswith(path_of_entry + b"/") and name.count(b"/") == 8
    ]
    assert [name[-4:] for name in order[:3]] == [
        order[0][-4:],
        b"st3d",
        b"sv3d",
    ]  # after the box of the codec


def test_spherical_metadata_keeps_frames(tmp_path):
    grey_video(tmp_path / "a.mp4", PART)
    grey_video(tmp_path / "b.mp4", None)
    a, b = images_of(tmp_path / "a.mp4"), images_of(tmp_path / "b.mp4")
    assert len(a) == len(b) == 30
    for one, other in zip(a, b, strict=True):
        np.testing.assert_array_equal(one.to_ndarray(), other.to_ndarray())
    assert VideoReader(tmp_path / "a.mp4").expected_frames == 30


def test_ffmpeg_reads_spherical_version_2(tmp_path):
    grey_video(tmp_path / "a.mp4", PART)
    before = av.logging.get_level()
    av.logging.set_level(av.logging.INFO)  # FFmpeg prints the dump to its log
    try:
        with av.open(str(tmp_path / "a.mp4")) as container:
            dump = container.dumps_format()
    finally:
        av.logging.set_level(before)
    assert "tiled equirectangular (30.000000/12.500000/-3.250000) [60, 13, 60, 7]" in dump


def test_video_format_without_panorama_support_raises(tmp_path):
    assert not can_be_spherical("a.mkv")
    with pytest.raises(MediaError, match=r"panorama metadata requires \.mp4, \.m4v, \.mov"):
        VideoWriter(tmp_path / "a.mkv", (60, 40), 25, PART)
    with pytest.raises(
        MediaError, match=r"size must be that of panorama, 60 x 40 px; got 62 x 40 px"
    ):
        VideoWriter(tmp_path / "a.mp4", (62, 40), 25, PART)
    assert not list(tmp_path.iterdir())
