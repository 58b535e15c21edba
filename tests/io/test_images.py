"""Reading and writing of image files."""

import io
import struct
import subprocess
import sys
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import MediaError
from omnimirror.io import GPano, images
from omnimirror.io.images import FORMATS

RNG = np.random.default_rng(3)
FULL = {"uint8": 255, "uint16": 65535, "float32": 1}
LOSSLESS = [
    (suffix, dtype, channels)
    for suffix, kind in FORMATS.items()
    for dtype in kind.depths
    for channels in kind.channels
    if suffix not in (".jpg", ".jpeg", ".hdr")
]


def image_of(dtype="uint8", channels=3, size=(17, 23)):
    shape = size if channels == 1 else (*size, channels)
    values = RNG.random(shape) * FULL[dtype]
    return values.astype(dtype)


@pytest.mark.parametrize(("suffix", "dtype", "channels"), LOSSLESS)
def test_lossless_round_trip(tmp_path, suffix, dtype, channels):
    path = tmp_path / f"ünïcode name{suffix}"
    image = image_of(dtype, channels)
    if channels == 4:  # WebP discards the colour of transparent pixels
        image[..., 3][image[..., 3] == 0] = FULL[dtype]
    om.write_image(path, image)
    back = om.read_image(path)
    assert back.dtype == image.dtype
    np.testing.assert_array_equal(back, image)
    assert [p.name for p in tmp_path.iterdir()] == [path.name]


@pytest.mark.parametrize(
    ("suffix", "dtype", "tolerance"),
    [(".jpg", "uint8", 8), (".JPEG", "uint8", 8), (".hdr", "float32", 0.01)],
)
def test_lossy_round_trip(tmp_path, suffix, dtype, tolerance):
    smooth = cv2.GaussianBlur(image_of(dtype, 3, (60, 80)), (15, 15), 5)
    om.write_image(tmp_path / f"a{suffix}", smooth)
    back = om.read_image(tmp_path / f"a{suffix}")
    assert np.abs(back.astype(float) - smooth).mean() < tolerance


@pytest.mark.parametrize("missing", [True, False])
def test_truncated_jpeg_with_thumbnail_is_detected(missing, tmp_path):
    """A segment of 300 bytes, whose length needs both bytes, contains an end marker; another is
    filled with 0xff."""
    data = cv2.imencode(".jpg", np.full((32, 32), 90, np.uint8))[1].tobytes()
    thumbnail = b"\xff\xe1" + (300).to_bytes(2, "big") + b"\xff\xd9" + b"\0" * 296
    whole = data[:2] + thumbnail + b"\xff\xff\xe2\x00\x04ab" + data[2:]
    assert images._first_scan(whole) == whole.index(b"\xff\xda")
    assert images._is_truncated(whole[:-2] if missing else whole) == missing


def test_format_capabilities():
    capabilities = {suffix: (kind.depths, kind.channels) for suffix, kind in FORMATS.items()}
    assert capabilities[".exr"] == (("float32",), (1, 3, 4))
    assert capabilities[".png"] == (("uint8", "uint16"), (1, 3, 4))
    assert (
        capabilities[".tif"] == capabilities[".tiff"] == (("uint8", "uint16", "float32"), (1, 3, 4))
    )
    assert (
        capabilities[".jpg"]
        == capabilities[".jpeg"]
        == capabilities[".bmp"]
        == (("uint8",), (1, 3))
    )
    assert (capabilities[".webp"], capabilities[".hdr"]) == (
        (("uint8",), (3, 4)),
        (("float32",), (3,)),
    )
    assert images.OPAQUE == {"uint8": 2**8 - 1, "uint16": 2**16 - 1, "float32": 1.0}


def test_opencv_log_level_is_restored_after_threads():
    logging = cv2.utils.logging
    before = logging.getLogLevel()
    first, second = images._quiet(), images._quiet()
    first.__enter__()
    assert logging.getLogLevel() == logging.LOG_LEVEL_SILENT
    second.__enter__()  # of another thread, which ends after the first
    first.__exit__(None, None, None)
    assert logging.getLogLevel() == logging.LOG_LEVEL_SILENT
    second.__exit__(None, None, None)
    assert logging.getLogLevel() == before


def test_opencv_errors_are_media_errors(tmp_path, monkeypatch):
    def fail(*_):
        raise cv2.error("OpenCV(4.99) /source/file.cpp:12: error: (-2) no memory\nin function 'x'")

    path = tmp_path / "a.png"
    om.write_image(path, image_of())
    monkeypatch.setattr(cv2, "imdecode", fail)
    with pytest.raises(
        MediaError, match=r"OpenCV\(4\.99\) /source/file\.cpp:12: error: \(-2\) no memory"
    ):
        om.read_image(path)
    monkeypatch.setattr(cv2, "imencode", fail)
    with pytest.raises(MediaError, match=r"^cannot write .*b\.png: .*no memory$"):
        om.write_image(tmp_path / "b.png", image_of())
    monkeypatch.setattr(cv2, "imencode", lambda *_: (False, None))
    with pytest.raises(MediaError, match=r"cannot encode an image of 23 x 17 px as \.png"):
        om.write_image(tmp_path / "b.png", image_of())
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]


def test_single_channel_axis_is_grey(tmp_path):
    om.write_image(tmp_path / "a.png", image_of("uint8", 1)[..., None])
    assert om.read_image(tmp_path / "a.png").shape == (17, 23)


def test_values_outside_the_range_of_radiance_hdr_are_clipped(tmp_path):
    """Cubic interpolation produces values below 0, which the shared exponent cannot represent."""
    light = np.float32([[[-1, 2, 3], [-50, -1, -9], [np.nan, 1, 1], [np.inf, 0, 0], [3e38, 0, 0]]])
    om.write_image(tmp_path / "light.hdr", np.tile(light, (1, 2, 1)))
    expected = [[0, 2, 3], [0, 0, 0], [0, 1, 1], [2.0**127, 0, 0], [2.0**127, 0, 0]]
    np.testing.assert_allclose(
        om.read_image(tmp_path / "light.hdr"), np.tile([expected], (1, 2, 1)), rtol=0.01
    )


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif", ".webp", ".bmp", ".hdr", ".exr"])
@pytest.mark.parametrize("share", [0.02, 0.5, 0.9, 0.999])
def test_truncated_image_raises(tmp_path, suffix, share, capfd):
    image = cv2.GaussianBlur(
        image_of("float32" if suffix in (".hdr", ".exr") else "uint8", 3, (200, 300)), (5, 5), 2
    )
    om.write_image(tmp_path / f"whole{suffix}", image)
    data = (tmp_path / f"whole{suffix}").read_bytes()
    path = tmp_path / f"part{suffix}"
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(MediaError, match=r"part.*(truncated|undamaged)") as e:
        om.read_image(path)
    assert "\n" not in str(e.value)
    assert capfd.readouterr().err == ""


def _with_header(data: bytes, **fields) -> bytes:
    """Return a PNG with a modified header and a valid checksum."""
    names = ("width", "height", "depth", "colour", "packing", "filter", "interlace")
    header = dict(zip(names, struct.unpack(">IIBBBBB", data[16:29]), strict=True)) | fields
    chunk = b"IHDR" + struct.pack(">IIBBBBB", *header.values())
    return data[:12] + chunk + zlib.crc32(chunk).to_bytes(4, "big") + data[33:]


def test_png_header_exceeding_capacity_raises_before_decompression(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    om.write_image(path, image_of("uint16", 4, (40, 50)))
    data = path.read_bytes()
    assert _with_header(data) == data
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was unpacked"))
    path.write_bytes(_with_header(data, width=20_000, height=17_000))
    with pytest.raises(
        MediaError,
        match=f"20000 x 17000 px in the PNG header exceed the capacity of {len(data)} bytes",
    ):
        om.read_image(path)
    for damaged in (data[:18] + b"\x40" + data[19:], data[:20] + data[21:]):
        path.write_bytes(damaged)
        with pytest.raises(MediaError, match=r"damaged PNG header"):
            om.read_image(path)


ENCODED = {
    "grey.png": (image_of("uint8", 1, (20, 30)), ".png", ()),
    "deep.png": (image_of("uint16", 4, (20, 30)), ".png", ()),
    "grey.jpg": (image_of("uint8", 1, (20, 30)), ".jpg", ()),
    "colour.jpg": (image_of("uint8", 3, (20, 30)), ".jpg", (cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
    "grey.tif": (image_of("uint8", 1, (20, 30)), ".tif", ()),
    "deep.tif": (image_of("uint16", 3, (20, 30)), ".tif", ()),
    "float.tif": (image_of("float32", 3, (20, 30)), ".tif", ()),
    "colour.bmp": (image_of("uint8", 3, (20, 30)), ".bmp", ()),
    "colour.webp": (image_of("uint8", 3, (20, 30)), ".webp", ()),
    "deep.ppm": (image_of("uint16", 3, (20, 30)), ".ppm", ()),
    "colour.hdr": (image_of("float32", 3, (20, 30)), ".hdr", ()),
}


@pytest.mark.parametrize("name", ENCODED)
def test_decoded_size_equals_size_of_image(name, tmp_path, monkeypatch):
    image, suffix, parameters = ENCODED[name]
    path = tmp_path / name
    path.write_bytes(images.encoded(image, suffix, parameters))
    decoded = om.read_image(path)
    assert images.decoded_bytes(path.read_bytes()) == decoded.nbytes
    monkeypatch.setattr(images, "MAX_DECODED_BYTES", decoded.nbytes)
    assert om.read_image(path).shape == decoded.shape
    monkeypatch.setattr(images, "MAX_DECODED_BYTES", decoded.nbytes - 1)
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(
        MediaError, match=rf"{name} must have at most 0 MB after decoding; got 1 MB"
    ):
        om.read_image(path)


def test_decoded_size_of_exr_includes_all_channels(tmp_path):
    pytest.importorskip("OpenEXR", reason="pip install '.[exr]'")
    om.write_image(tmp_path / "a.exr", image_of("float32", 4, (20, 30)))
    data = (tmp_path / "a.exr").read_bytes()
    assert images.decoded_bytes(data) == 4 * 4 * 20 * 30
    wide = data.replace(struct.pack("<4i", 0, 0, 29, 19), struct.pack("<4i", 0, 0, 29_999, 29_999))
    (tmp_path / "a.exr").write_bytes(wide)
    with pytest.raises(MediaError, match=r"must have at most 2048 MB after decoding"):
        om.read_image(tmp_path / "a.exr")


def test_jpeg_declaring_gigabytes_raises_before_decoding(tmp_path, monkeypatch):
    data = images.encoded(image_of(size=(16, 16)), ".jpg")
    at = data.index(b"\xff\xc0") + 5
    (tmp_path / "a.jpg").write_bytes(
        data[:at] + struct.pack(">HH", 30_000, 30_000) + data[at + 4 :]
    )
    monkeypatch.setattr(cv2, "imdecode", lambda *_: pytest.fail("it was decoded"))
    with pytest.raises(MediaError, match=r"must have at most 2048 MB after decoding"):
        om.read_image(tmp_path / "a.jpg")


def test_png_at_maximum_compression_is_read(tmp_path):
    """An empty image, one bit per pixel, with maximum deflate compression."""
    _, data = cv2.imencode(".png", np.zeros((4000, 8000), np.uint8), [cv2.IMWRITE_PNG_BILEVEL, 1])
    packed = zlib.compress(bytes(4000 * 1001), 9)
    chunk = b"IDAT" + packed
    small = (
        data.tobytes()[:33]
        + len(packed).to_bytes(4, "big")
        + chunk
        + zlib.crc32(chunk).to_bytes(4, "big")
    )
    path = tmp_path / "a.png"
    path.write_bytes(small + b"\0\0\0\0IEND\xaeB`\x82")
    assert 4000 * 1000 / path.stat().st_size > 950
    assert not om.read_image(path).any()


def test_jpeg_with_end_of_thumbnail_only_is_truncated(tmp_path):
    """An end marker inside the header does not end the image."""
    _, data = cv2.imencode(".jpg", image_of(size=(100, 100)))
    data = data.tobytes()
    thumbnail = b"\xff\xe1" + (2 + 4).to_bytes(2, "big") + b"\xff\xd8\xff\xd9"
    path = tmp_path / "a.jpg"
    path.write_bytes(data[:2] + thumbnail + data[2:])
    assert om.read_image(path).shape == (100, 100, 3)
    path.write_bytes((data[:2] + thumbnail + data[2:])[:-500])
    with pytest.raises(MediaError, match=r"the file is truncated"):
        om.read_image(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, r"the file does not exist"),
        (b"", "is empty"),
        (b"hello, world" * 50, r"it must be an undamaged image file \(PNG, JPEG, TIFF, WebP, AV"),
        (b"\xff\xd8\xff", r"the file is truncated"),
        (
            b"\0\0\0\x24ftypheic\0\0\0\0mif1MiHBheic" + b"\0" * 90,
            r"HEIC is not supported; save it as JPEG \(iPhone: Camera, Forma",
        ),
        (
            b"\0\0\0\x18ftypmif1\0\0\0\0mif1heic" + b"\0" * 90,
            r"HEIC is not supported; save it as JPEG \(iPhone: Camera, Forma",
        ),
    ],
)
def test_invalid_image_file_raises(tmp_path, content, message):
    path = tmp_path / "a.png"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(MediaError, match=message):
        om.read_image(path)


@pytest.mark.parametrize("suffix", [".dng", ".NEF"])
def test_raw_file_raises_with_remedy(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    path.write_bytes(b"II*\0\x08\0\0\0" + b"\0" * 100)
    with pytest.raises(
        MediaError, match=r"raw files are not supported; convert it to \.tif or \.png"
    ):
        om.read_image(path)


def test_folder_as_image_raises(tmp_path):
    with pytest.raises(MediaError, match="it must be a file; got a folder"):
        om.read_image(tmp_path)


@pytest.mark.parametrize(
    ("name", "image", "message"),
    [
        (
            "a.gif",
            image_of(),
            r"the suffix must be one of \.png, \.jpg, \.jpeg, \.tif, \.tiff, \.webp, \.bmp,",
        ),
        (
            "a",
            image_of(),
            r"the suffix must be one of \.png, \.jpg, \.jpeg, \.tif, \.tiff, \.webp, \.bmp, \.hd",
        ),
        (
            "a.jpg",
            image_of("uint16"),
            r"\.jpg images must be uint8 with 1 or 3 channels; got uint16 with 3",
        ),
        (
            "a.jpg",
            image_of(channels=4),
            r"\.jpg images must be uint8 with 1 or 3 channels; got uint8 with 4",
        ),
        (
            "a.png",
            image_of("float32"),
            r"\.png images must be uint8 or uint16 with 1 or 3 or 4 channels; got float32 with 3",
        ),
        (
            "a.png",
            np.zeros((0, 5), np.uint8),
            r"image must have the shape \(h, w\) or \(h, w, c\); got shape \(0, 5\)",
        ),
        (
            "a.png",
            np.zeros((5, 5, 2), np.uint8),
            r"\.png images must be uint8 or uint16 with 1 or 3 or 4 channels; got uint8 with 2",
        ),
    ],
)
def test_unsupported_image_raises(tmp_path, name, image, message):
    with pytest.raises(MediaError, match=message):
        om.write_image(tmp_path / name, image)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("shape", [(1, 65501, 3), (65501, 1, 3)])
def test_image_exceeding_format_size_raises(shape, tmp_path):
    size = f"{shape[1]} x {shape[0]}"
    with pytest.raises(
        MediaError, match=f"images must have at most 65500 px per side; got {size} px"
    ):
        om.write_image(tmp_path / "a.jpg", np.zeros(shape, np.uint8))
    assert list(tmp_path.iterdir()) == []


def test_opencv_log_level_is_restored():
    logging = cv2.utils.logging
    before = logging.setLogLevel(logging.LOG_LEVEL_ERROR)
    try:
        with images._quiet():
            with images._quiet():
                assert logging.getLogLevel() == logging.LOG_LEVEL_SILENT
            assert logging.getLogLevel() == logging.LOG_LEVEL_SILENT
        assert logging.getLogLevel() == logging.LOG_LEVEL_ERROR
    finally:
        logging.setLogLevel(before)


def test_full_disk_keeps_existing_image(tmp_path, monkeypatch):
    path = tmp_path / "a.png"
    before = image_of()
    om.write_image(path, before)

    def full(self, data):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(MediaError, match=r"cannot write .*a.png: No space left on device"):
        om.write_image(path, image_of())
    np.testing.assert_array_equal(om.read_image(path), before)
    assert len(list(tmp_path.iterdir())) == 1


@pytest.mark.parametrize("compression", ["NO", "RLE", "ZIPS", "ZIP", "PIZ", "DWAA"])
def test_exr_of_other_programs(tmp_path, compression, capfd):
    """Half precision, additional channels, and all compression types."""
    library = pytest.importorskip("OpenEXR")
    red, green, blue = (RNG.random((70, 50)).astype(np.float16) for _ in range(3))
    header = {
        "compression": getattr(library, f"{compression}_COMPRESSION"),
        "type": library.scanlineimage,
    }
    path = tmp_path / "a.exr"
    with library.File(
        header, {"R": red, "G": green, "B": blue, "Z": RNG.random((70, 50), np.float32)}
    ) as file:
        file.write(str(path))
    image = om.read_image(path)
    assert image.dtype == np.float32
    tolerance = 0.1 if compression == "DWAA" else 0
    np.testing.assert_allclose(image, np.stack([red, green, blue], axis=-1), atol=tolerance)
    for share in (0.01, 0.3, 0.99):
        (tmp_path / "b.exr").write_bytes(path.read_bytes()[: int(share * path.stat().st_size)])
        with pytest.raises(MediaError, match="truncated"):
            om.read_image(tmp_path / "b.exr")
    assert capfd.readouterr() == ("", "")


def test_exr_is_decoded_from_its_bytes(tmp_path, monkeypatch):
    """Uploads have no file; another file of the same name in the working directory is not read."""
    pytest.importorskip("OpenEXR", reason="pip install '.[exr]'")
    monkeypatch.chdir(tmp_path)
    image, other = image_of("float32", 3, (20, 30)), np.zeros((20, 30, 3), np.float32)
    data = images.encode_image("a.exr", image)
    np.testing.assert_array_equal(images.decode_image_and_metadata("a.exr", data)[0], image)
    om.write_image("a.exr", other)
    np.testing.assert_array_equal(images.decode_image_and_metadata("a.exr", data)[0], image)


def test_exr_without_colour_channels_raises(tmp_path):
    library = pytest.importorskip("OpenEXR")
    header = {"compression": library.ZIP_COMPRESSION, "type": library.scanlineimage}
    with library.File(header, {"Z": np.zeros((7, 5), np.float32)}) as file:
        file.write(str(tmp_path / "a.exr"))
    with pytest.raises(MediaError, match=r"must have the channels R, G, B \(A\) or Y; got Z"):
        om.read_image(tmp_path / "a.exr")


def test_exr_without_package_raises_with_remedy(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "OpenEXR", None)
    with pytest.raises(
        MediaError, match=r"OpenEXR must be installed for .*: run pip install '\.\[exr\]'"
    ):
        om.write_image(tmp_path / "a.exr", image_of("float32"))
    assert not list(tmp_path.iterdir())


def test_full_disk_error_of_exr_names_output(tmp_path, monkeypatch):
    pytest.importorskip("OpenEXR")
    monkeypatch.chdir(tmp_path)
    script = (
        "import numpy as np, resource, signal, omnimirror as om\nsignal.signal(signal.SIGXFSZ, "
        "signal.SIG_IGN)\nresource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
        "om.write_image('view.exr', np.random.default_rng(0).random((64, 64, 3), np.float32))\n"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    last = run.stderr.splitlines()[-1]
    assert "cannot write view.exr: " in last
    assert ".omnimirror-" not in last
    assert list(tmp_path.iterdir()) == []


# -- Sizes declared by headers ----------------------------------------------------------------------


def png_header(width, height, depth=8, colour=2, name=b"IHDR", more=b""):
    chunk = name + struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0)
    start = images.PNG_SIGNATURE + (13).to_bytes(4, "big")
    return start + chunk + zlib.crc32(chunk).to_bytes(4, "big") + more


@pytest.mark.parametrize(
    ("colour", "samples", "decoded"),
    [(0, 1, 1), (2, 3, 3), (3, 1, 4), (4, 2, 2), (6, 4, 4)],  # PNG specification, 11.2.1
)
@pytest.mark.parametrize("depth", [8, 16])
def test_png_header_declares_size(colour, samples, decoded, depth):
    """Deflate packs 1032 bytes into one: 258 bytes into 2 bits."""
    header = png_header(30, 20, depth, colour)
    assert len(header) == 33
    assert images.decoded_bytes(header) == 600 * decoded * depth // 8
    assert images._png_damage(header) == ""
    assert images.decoded_bytes(png_header(30, 20, 1, 0)) == 600
    side = 8 * 1032 * 43 // depth  # samples in a file of 43 bytes
    for width in (side // samples, side // samples + 1):
        damage = images._png_damage(png_header(width, 1, depth, colour, more=bytes(10)))
        exceeds = width * samples > side
        assert damage == (
            f"{width} x 1 px in the PNG header exceed the capacity of 43 bytes" if exceeds else ""
        )


def test_damaged_png_headers():
    whole = png_header(30, 20)
    for damaged in (
        whole[:32],
        whole[:-1] + bytes([whole[-1] ^ 1]),
        png_header(30, 20, name=b"IHDX"),
    ):
        assert images._png_damage(damaged) == "damaged PNG header"
    assert images.decoded_bytes(whole[:20]) == 0


@pytest.mark.parametrize("marker", range(0xC0, 0xD0))
@pytest.mark.parametrize("depth", [8, 12])
def test_jpeg_frame_declares_size(marker, depth):
    """All frame headers of ITU-T T.81, table B.1; C4, C8 and CC are tables and reserved."""
    segment = b"\xff\xe1" + (300).to_bytes(2, "big") + bytes(298)
    frame = bytes([0xFF, marker]) + struct.pack(">HBHHB", 17, depth, 20, 31, 3) + bytes(9)
    data = b"\xff\xd8" + segment + b"\xff" + frame + b"\xff\xd9"
    is_frame = marker not in (0xC4, 0xC8, 0xCC)
    assert images.decoded_bytes(data) == (20 * 31 * 3 * (1 if depth == 8 else 2)) * is_frame
    assert images.decoded_bytes(data[:310]) == 0
    assert images.decoded_bytes(b"\xff\xd8\xff\xe1\0\4abX" + frame) == 0


def tiff(order, is_big, tags):
    """Return a TIFF or BigTIFF file with one directory of (tag, type, values), from its specification."""
    sign = {"<": b"II", ">": b"MM"}[order]
    kinds = {3: "H", 4: "I", 16: "Q"}
    count, offset, inline = ("Q", "Q", 8) if is_big else ("H", "I", 4)
    head = sign + struct.pack(
        order + ("HHHQ" if is_big else "HI"), *((43, 8, 0, 24) if is_big else (42, 16))
    )
    head = head.ljust(24 if is_big else 16, b"\0")
    size = 20 if is_big else 12
    after = len(head) + struct.calcsize(order + count) + size * len(tags) + 8
    entries, values = b"", b""
    for tag, kind, numbers in tags:
        packed = struct.pack(f"{order}{len(numbers)}{kinds.get(kind, 'B')}", *numbers)
        entries += struct.pack(order + ("HHQ" if is_big else "HHI"), tag, kind, len(numbers))
        if len(packed) > inline:
            entries += struct.pack(order + offset, after + len(values))
            values += packed
        else:
            entries += packed.ljust(inline, b"\0")
    return head + struct.pack(order + count, len(tags)) + entries + bytes(8) + values


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("is_big", [False, True])
@pytest.mark.parametrize(
    ("bits", "channels", "expected"),
    [
        ((8, 8, 8), (3,), 3),
        ((16, 16, 16, 16, 16), (5,), 10),
        ((32,), None, 4),
        ((1,), (1,), 1),
        ((12,), (1,), 2),
        ((0,), (1,), 1),
        (None, None, 1),  # the default of the specification
        ((8, 16), (2,), 4),  # of different depths: the largest
        ((8,) * 64, (64,), 64),
    ],
)
def test_tiff_directory_declares_size(order, is_big, bits, channels, expected):
    tags = [(254, 4, (0,)), (256, 3, (31,)), (257, 4, (20,))]
    tags += [(258, 3, bits)] if bits else []
    tags += [(277, 3, channels)] if channels else []
    assert images.decoded_bytes(tiff(order, is_big, tags)) == 31 * 20 * expected
    if is_big:
        wide = tiff(order, is_big, [(256, 16, (2**33,)), *tags[2:]])
        assert images.decoded_bytes(wide) == 2**33 * 20 * expected


def test_tiff_without_size_is_not_understood():
    size = [(256, 3, (31,)), (257, 3, (20,))]
    for tags in (size[:1], size[1:], [(256, 1, (31,)), size[1]], [(256, 3, (31,) * 65), size[1]]):
        assert images.decoded_bytes(tiff("<", False, tags)) == 0
    assert images.decoded_bytes(tiff("<", False, [(256, 3, ()), size[1]])) == 0
    assert images.decoded_bytes(tiff("<", False, [(999, 3, (7,))] * 4094 + size)) == 620
    assert images.decoded_bytes(tiff("<", False, [(999, 3, (7,))] * 4095 + size)) == 0
    assert images.decoded_bytes(b"II*\0\xff\0\0\0") == 0


def test_sizes_declared_by_other_headers():
    def radiance(comment, size=b"-Y 20 +X 30"):
        return b"#?RADIANCE\n" + b"#" * comment + b"\nFORMAT=32-bit_rle_rgbe\n\n" + size + b"\n"

    fixed = len(radiance(0))
    assert images.decoded_bytes(radiance(0)) == 20 * 30 * 3 * 4
    assert images.decoded_bytes(radiance(65536 - fixed)) == 20 * 30 * 3 * 4
    assert images.decoded_bytes(radiance(65536 - fixed + 1)) == 0
    assert images.decoded_bytes(radiance(0, b"-Y 20")) == 0
    # of Pillow: up to 16 bits except for bitmaps
    for head, expected in (
        (b"P1\n31 20\n", 1),
        (b"P4\n31 20\n", 1),
        (b"P5\n31 20\n255\n", 2),
        (b"P5\n31 20\n65535\n", 2),
        (b"P6\n31 20\n255\n", 6),
    ):
        assert images.decoded_bytes(head + bytes(31 * 20 * 6)) == 31 * 20 * expected
    assert images.decoded_bytes(b"hello, world") == images.decoded_bytes(b"") == 0


@pytest.mark.parametrize(
    ("suffix", "mode", "expected"),
    [("gif", "P", 4), ("bmp", "RGB", 3), ("webp", "RGBA", 4), ("jp2", "RGB", 6)],
)
def test_palettes_are_expanded_to_four_channels(suffix, mode, expected):
    from PIL import Image

    buffer = io.BytesIO()
    Image.new(mode, (31, 20)).save(buffer, {"jp2": "JPEG2000"}.get(suffix, suffix))
    assert images.decoded_bytes(buffer.getvalue()) == 31 * 20 * expected


def test_image_of_gigapixels_exceeds_the_limit(tmp_path):
    """Pillow rejects its header; its size is reported as just above the limit."""
    data = bytearray(images.encoded(image_of(size=(20, 31)), ".bmp"))
    data[18:26] = struct.pack("<ii", 30_000, 30_000)
    (tmp_path / "a.bmp").write_bytes(data)
    with pytest.raises(MediaError, match=r"at most 2048 MB after decoding; got 2049 MB"):
        om.read_image(tmp_path / "a.bmp")
    assert images.MAX_DECODED_BYTES == images.MAX_FILE_BYTES == 2 * 1024**3


@pytest.mark.parametrize(
    ("suffix", "largest"),
    [(".png", 2**20), (".tif", 2**20), (".jpg", 65_500), (".jpeg", 65_500), (".webp", 16_383)],
)
def test_largest_side_of_formats(suffix, largest):
    for size in ((largest, 1), (1, largest)):
        images.check_size(f"a{suffix}", size)
    for size in ((largest + 1, 1), (1, largest + 1)):
        with pytest.raises(MediaError, match=f"must have at most {largest} px per side"):
            images.check_size(f"a{suffix}", size)


@pytest.mark.parametrize(("at", "is_heic"), [(8, True), (60, True), (61, False)])
def test_heic_brand_is_among_the_first_64_bytes(at, is_heic, tmp_path):
    (tmp_path / "a.jpg").write_bytes((b"\0\0\0\x24ftyp".ljust(at, b"-") + b"hevc").ljust(200, b"-"))
    with pytest.raises(MediaError, match="HEIC is not" if is_heic else "must be an undamaged"):
        om.read_image(tmp_path / "a.jpg")


@pytest.mark.parametrize("shape", [(5,), (5, 5, 3, 1), (5, 0, 3), ()])
def test_arrays_that_are_no_image_raise(shape, tmp_path):
    with pytest.raises(MediaError, match=r"shape \(h, w\) or \(h, w, c\); got shape \("):
        om.write_image(tmp_path / "a.png", np.zeros(shape, np.uint8))


def test_orientation_is_applied_unless_stored_pixels_are_requested(tmp_path):
    """6: the first row of the file is the right edge of the image (EXIF 2.3, 4.6.4)."""
    from PIL import Image

    image = image_of("uint8", 3, (20, 30))
    exif = Image.Exif()
    exif[0x0112] = 6
    Image.fromarray(image).save(tmp_path / "a.png", exif=exif)
    om.write_image(tmp_path / "b.png", image)
    np.testing.assert_array_equal(om.read_image(tmp_path / "a.png"), np.rot90(image, -1))
    np.testing.assert_array_equal(om.read_image(tmp_path / "a.png", stored_orientation=True), image)
    for is_stored, expected in ((False, np.rot90(image, -1)), (True, image)):
        output, metadata = images.read_image_and_metadata(
            tmp_path / "a.png", **({"stored_orientation": True} if is_stored else {})
        )
        np.testing.assert_array_equal(output, expected)
        assert metadata.orientation == 6
    names = ("a.png", "b.png", "missing.png")
    assert [images.orientation_of(tmp_path / name) for name in names] == [6, 1, 1]


def test_panorama_and_metadata_require_a_format_and_size(tmp_path):
    panorama = GPano.of_view((40, 20), (-90.0, 90.0), 360.0)
    for size in ((20, 41), (21, 40), (40, 20)):
        with pytest.raises(
            MediaError,
            match=f"must have the size of panorama, 40 x 20 px; got {size[1]} x {size[0]} px",
        ):
            om.write_image(tmp_path / "a.png", image_of(size=size), panorama=panorama)
    with pytest.raises(MediaError, match="panorama metadata requires"):
        om.write_image(tmp_path / "a.bmp", image_of(size=(20, 40)), panorama=panorama)
    metadata = images.ImageMetadata(profile=b"profile")
    with pytest.raises(MediaError, match="a colour profile or EXIF requires"):
        om.write_image(tmp_path / "a.bmp", image_of(), metadata=metadata)
    assert not list(tmp_path.iterdir())
    for channels in (1, 3):
        image = image_of("uint8", channels, (20, 40))
        om.write_image(tmp_path / "a.png", image, panorama=panorama)
        np.testing.assert_array_equal(om.read_image(tmp_path / "a.png"), image)
        assert b"GPano" in (tmp_path / "a.png").read_bytes()
