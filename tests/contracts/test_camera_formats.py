"""Contract of all formats of camera files: round trip, and one-sentence errors."""

import re
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import SpecError
from omnimirror.calibration.formats import FORMATS, CameraFile, ReadOptions
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    KannalaBrandt,
    OCam,
    RadialSpline,
    Unified,
)
from tests.calibration.formats.examples import (
    KANNALA_BRANDT,
    OCAM,
    RATIONAL,
    SIZE,
    THIN_PRISM,
    UNIFIED,
    C,
    F,
)

FISHEYE = {"optics": "fisheye"}
CAMERAS = {
    "ocam": OCAM,
    "ocam-degree-7": OCam(
        polynomial=(-131.5, 0.0, 1.8e-3, 2e-7, -7e-10, 1e-13, 2e-16, 3e-19),
        centre_px=C,
        image_size=SIZE,
    ),
    "ocam-fisheye": OCam(
        polynomial=(-551.8, 0.0, 8.4e-4, -6.5e-7, 1.2e-9),
        centre_px=(505.5, 381.8),
        image_size=SIZE,
        **FISHEYE,
    ),
    "unified": UNIFIED,
    "unified-k3": replace(UNIFIED, k3=3e-4),
    "unified-no-skew": replace(UNIFIED, skew_px=0.0),
    "unified-fisheye": Unified(
        xi=1.4,
        focal_px=(900.0, 905.0),
        centre_px=C,
        image_size=SIZE,
        skew_px=0.2,
        k1=0.02,
        k2=0.003,
        **FISHEYE,
    ),
    "pinhole": Unified(
        xi=0.0,
        focal_px=(600.0, 602.0),
        centre_px=C,
        image_size=SIZE,
        skew_px=0.0,
        k1=-0.2,
        k2=0.05,
        k3=0.01,
        p1=1e-3,
        p2=-2e-3,
        **FISHEYE,
    ),
    "enhanced-unified": EnhancedUnified(
        alpha=0.6, beta=1.1, focal_px=F, centre_px=C, image_size=SIZE
    ),
    "double-sphere": DoubleSphere(xi=0.3, alpha=0.6, focal_px=F, centre_px=C, image_size=SIZE),
    "kannala-brandt": replace(KANNALA_BRANDT, skew_px=0.4, **FISHEYE),
    "kannala-brandt-no-skew": replace(KANNALA_BRANDT, **FISHEYE),
    "radial-spline": RadialSpline.from_model(
        Unified(xi=0.93, focal_px=F, centre_px=C, image_size=SIZE), 8, 230.0
    ),
    "rational": RATIONAL,
    "thin-prism": THIN_PRISM,
    "sensor": om.load_sensor("paper-spherical"),
    "kannala-brandt-mirror": KannalaBrandt(
        focal_px=F, centre_px=C, image_size=SIZE, k1=-0.02, k2=0.003
    ),
}
LAYOUTS = {
    name: x for kind in FORMATS.values() for name, x in kind.layouts.items() if not x.is_panorama
}
HOME = {name: kind for kind in FORMATS.values() for name in kind.layouts}
STORED_FIELDS = [
    pytest.param(layout, camera, id=f"{layout}-{camera}")
    for layout in LAYOUTS
    for camera in CAMERAS
    if not LAYOUTS[layout].unsupported(CAMERAS[camera])
]


def written_content(layout, camera):
    content = LAYOUTS[layout].write(camera, "front")
    return content.encode() if isinstance(content, str) else content


def file_name(layout):
    return (
        "camera"
        + (
            LAYOUTS[layout].suffixes[:1] or (".toml" if layout in ("camera", "sensor") else ".txt",)
        )[0]
    )


def read(layout, data, camera):
    reading = ReadOptions(file_name(layout), getattr(camera, "optics", "mirror"), camera.mount)
    return HOME[layout].read(CameraFile(reading.source, data), reading)


def test_every_format_stores_a_camera():
    assert {p.values[0] for p in STORED_FIELDS} == set(LAYOUTS)


@pytest.mark.parametrize(("layout", "name"), STORED_FIELDS)
def test_written_files_are_recognised_as_one_format(layout, name):
    data = written_content(layout, CAMERAS[name])
    formats = [
        kind for kind in FORMATS.values() if kind.recognises(CameraFile(file_name(layout), data))
    ]
    assert [kind.title for kind in formats] == [HOME[layout].title]


@pytest.mark.parametrize(("layout", "name"), STORED_FIELDS)
@pytest.mark.parametrize(
    "mount", [Mount(), Mount("forward", 20.0, image_flipped=True)], ids=["plain", "flipped"]
)
def test_stored_cameras_round_trip(layout, name, mount):
    camera = replace(CAMERAS[name], mount=mount)
    (stored,) = read(layout, written_content(layout, camera), camera)
    pixels = np.random.default_rng(3).uniform(0, np.array(camera.image_size) - 1, (300, 2))
    origins, directions, valid = camera.backproject(pixels)
    assert valid.sum() > 100
    points = origins[valid] + 2000.0 * directions[valid]
    projection = stored.camera.project(points)
    assert projection.valid.all()
    np.testing.assert_allclose(projection.pixels, pixels[valid], rtol=0, atol=1e-9)


def refusal(layout, data, camera):
    """Return the error message of a file; None if it is read."""
    try:
        read(layout, data, camera)
    except SpecError as e:
        return str(e)
    return None


@pytest.mark.parametrize(("layout", "name"), STORED_FIELDS)
def test_truncated_or_incomplete_files_are_rejected(layout, name):
    """Or read, for example with a missing comment; any other exception fails the test."""
    camera = CAMERAS[name]
    data = written_content(layout, camera)
    for i in range(10):
        a, b = len(data) * i // 10, len(data) * (i + 1) // 10
        for part in (data[:a], data[:a] + data[b:]):
            message = refusal(layout, part, camera)
            assert message is None or (
                message.startswith(("camera.", "cannot read camera.")) and "\n" not in message
            )
    assert refusal(layout, data[: len(data) // 4], camera) is not None


TOKENS = [
    b"nan",
    b"inf",
    b"-1e400",
    b"0",
    b"-1",
    b"x",
    b"[1,2]",
    b"{}",
    b"",
    b"1e308",
    b"!!int 3",
    b"*a",
    b"9" * 5000,
]


@given(st.sampled_from(STORED_FIELDS), st.integers(0, 40), st.sampled_from(TOKENS))
def test_files_with_one_changed_number_are_read_or_rejected(case, position, token):
    layout, name = case.values
    data = written_content(layout, CAMERAS[name])
    parts = re.split(rb"(?<![\w.])(-?\d+\.?\d*(?:e[-+]?\d+)?)", data)
    if b"\0" in data:
        parts = [data[i : i + 8] for i in range(0, len(data), 8)]
    parts[2 * (position % (len(parts) // 2)) + 1] = token
    message = refusal(layout, b"".join(parts), CAMERAS[name])
    assert message is None or "\n" not in message


@given(st.sampled_from(sorted(FORMATS)), st.binary(max_size=200))
def test_arbitrary_bytes_are_rejected(name, data):
    FORMATS[name].recognises(CameraFile("camera", data))
    with pytest.raises(SpecError, match=r"^(cannot read )?camera"):
        FORMATS[name].read(CameraFile("camera", data), ReadOptions("camera"))
