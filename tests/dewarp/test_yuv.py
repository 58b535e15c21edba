"""4:2:0 frames against exact projections, and against dewarping in RGB."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.maps import PolarMap, halved_pixels, pairs
from omnimirror.dewarp.yuv import SITINGS
from tests.everyday import few

SIZE = (401, 400)  # odd and even
BALL = om.MirrorBall(
    centre_px=(199.7, 200.2), rim_radius_px=190.0, field_deg=270.0, image_size=SIZE
)
CUT = om.MirrorBall(
    centre_px=(203.0, 198.0), rim_radius_px=230.0, field_deg=270.0, image_size=(400, 400)
)  # with a field beyond all image borders
SENSOR = om.load_sensor("paper-spherical")
SCREENS = {
    "view": om.screens.Plane((320, 241), pan_deg=30.0, tilt_deg=-25.0, roll_deg=20.0),
    "wide view": om.screens.Plane(
        (183, 121), tilt_deg=-60.0, hfov_deg=140.0
    ),  # with a finer lattice
    "panorama": om.screens.Cylinder((721, 180), -70.0, 30.0),
    "near wall": om.screens.Cylinder(
        (400, 120), -40.0, 20.0, distance_mm=600.0, offset_mm=(100.0, 0.0, 0.0)
    ),
    "mosaic": om.screens.Mosaic(
        (301, 150),
        (
            (0, 0, om.screens.Plane((151, 150), tilt_deg=-30.0)),
            (151, 0, om.screens.Plane((150, 149), 90.0)),
        ),
    ),
}


def ramps(size, siting, bits=16):
    """Return three planes with the values 256 + 64 u, 256 + 64 u and 256 + 32 (u + v) at the luma
    position (u, v)."""
    width, height = size
    u = np.broadcast_to(np.arange(width), (height, width))
    x, y = SITINGS[siting]
    across, down = np.meshgrid(
        2 * np.arange((width + 1) // 2) + x, 2 * np.arange((height + 1) // 2) + y
    )
    values = [256 + 64 * u, 256 + 64 * across, 256 + 32 * (across + down)]
    return tuple(np.rint(value).astype(np.uint16) for value in values)


def exact(camera, screen, columns, rows):
    """Return source positions (h, w, 2) of columns (w,) and rows (h,) of a screen, also between
    pixels; NaN outside."""
    targets = screen.targets_at(*np.meshgrid(columns, rows))
    project = camera.project_directions if screen.is_distant else camera.project
    return project(targets.reshape(-1, 3)).pixels.reshape(*targets.shape[:2], 2)


def parts_of(view):
    return (
        [(p.left, p.top, p.view) for p in view.parts]
        if isinstance(view, om.screens.Mosaic)
        else [(0, 0, view)]
    )


def test_halved_row_with_one_visible_half():
    """At the inner and outer field boundaries; others are between pixels, by the sample offset of
    the view."""
    radii = np.array([np.nan, 10.0, 12.0, 14.0, 20.0, np.nan, np.nan, np.nan])
    circles = PolarMap((31.0, 30.0), radii, np.linspace(0.0, 0.7, 8), (64, 64))
    halved = circles.halved((0.5, 0.0), (0.25, 0.75))
    np.testing.assert_array_equal(halved.radii, [5.0, 6.75, 10.0, np.nan])
    np.testing.assert_allclose(halved.angles, 0.1 * np.array([0.25, 2.25, 4.25, 6.25]), rtol=1e-12)
    assert halved.centre == (15.25, 15.0)
    assert halved.source_size == (32, 32)


def test_halved_sample_at_mosaic_boundary():
    """3 x 4 pixels of two parts that meet in the second column, with labels; an odd row is
    extended."""
    u, v = np.meshgrid([0.0, 40.0, 44.0, 48.0], [0.0, 10.0, 30.0])
    labels = np.array([[1, 2, 2, 2]] * 3, np.int32)
    halved = halved_pixels(np.stack([u, v], axis=-1), (0.0, 0.0), (0.5, 0.5), (100, 100), labels)
    np.testing.assert_allclose(
        halved, [[[0.0, 0.0], [23.0, 2.5]], [[0.0, 15.0], [23.0, 20.0]]], atol=1e-12
    )
    rows = np.array([[1] * 4, [2] * 4, [2] * 4], np.int32)
    halved = halved_pixels(np.stack([u, v], axis=-1), (0.0, 0.0), (0.5, 0.5), (100, 100), rows)
    np.testing.assert_allclose(
        halved, [[[0.0, 0.0], [22.0, 0.0]], [[10.0, 20.0], [23.0, 20.0]]], atol=1e-12
    )


def test_odd_pairs_are_extrapolated():
    assert pairs(np.array([0.0, 1.0, 4.0, 9.0, 16.0])).tolist() == [
        [0.0, 1.0],
        [4.0, 9.0],
        [16.0, 23.0],
    ]
    assert pairs(np.array([3.0])).tolist() == [[3.0, 3.0]]
    assert pairs(np.array([3.0, 5.0])).tolist() == [[3.0, 5.0]]


@pytest.mark.parametrize(
    ("siting", "to_siting"),
    few(
        [*((s, s) for s in SITINGS), ("center", "left")], ("topleft", "topleft"), ("center", "left")
    ),
)
@pytest.mark.parametrize("name", SCREENS)
@pytest.mark.parametrize("camera", [BALL, CUT, SENSOR], ids=["ball", "cut", "sensor"])
def test_chroma_matches_exact_projection(camera, name, siting, to_siting):
    """Ramps yield the projection of their own positions, in the first frame and in later ones."""
    view = SCREENS[name]
    dewarp, other = (om.Dewarper(camera, view, "linear") for _ in range(2))
    planes = ramps(camera.image_size, siting)
    x, y = SITINGS[to_siting]
    last = np.array(camera.image_size) // 2 * 2 - 2 + np.array(SITINGS[siting])  # constant beyond
    for _ in range(2):
        luma, u, v = dewarp.planes(planes, None, siting, to_siting, full_range=True, bits=16)
        for left, top, screen in parts_of(view):
            width, height = screen.size
            columns, rows = (
                np.arange(-(-left // 2), (left + width) // 2),
                np.arange(-(-top // 2), (top + height) // 2),
            )
            at = exact(camera, screen, 2 * columns + x - left, 2 * rows + y - top)
            inner = ((at > 2) & (at < last - 1)).all(axis=-1)
            assert inner.mean() > 0.25
            for plane, expected in ((u, 256 + 64 * at[..., 0]), (v, 256 + 32 * at.sum(axis=-1))):
                error = np.abs(plane[np.ix_(rows, columns)] - expected)[inner]
                bend = (
                    np.nanmax(np.abs(np.diff(at, 2, axis=1))) / 8
                )  # error of linear interpolation
                assert error.max() < 1.5 + 64 * (0.02 + bend)
        np.testing.assert_array_equal(luma, other(planes[0]))


@pytest.mark.parametrize("camera", [BALL, CUT], ids=["ball", "cut"])
@pytest.mark.parametrize("siting", SITINGS)
@pytest.mark.parametrize("name", SCREENS)
def test_chroma_inside_and_outside_field(camera, name, siting):
    """Also on the last half pixel of the image, beyond the last chroma sample."""
    dewarp = om.Dewarper(camera, SCREENS[name])
    width, height = camera.image_size
    parts = [np.full((height, width), 200, np.uint8)]
    parts += [
        np.full(((height + 1) // 2, (width + 1) // 2), value, np.uint8) for value in (90, 170)
    ]
    for full_range in (False, True):
        y, u, v = dewarp.planes(tuple(parts), siting=siting, full_range=full_range)
        valid = dewarp.valid
        np.testing.assert_array_equal(y, np.where(valid, 200, 0 if full_range else 16))
        rows, columns = valid.shape
        quads = np.pad(valid, ((0, rows % 2), (0, columns % 2)), "edge").reshape(
            *u.shape[:1], 2, u.shape[1], 2
        )
        visible_count = quads.sum(axis=(1, 3))
        assert (u[visible_count == 4] == 90).all()
        assert (v[visible_count == 4] == 170).all()
        assert (u[visible_count == 0] == 128).all()
        assert (v[visible_count == 0] == 128).all()
        assert np.isin(u, (90, 128)).all()
        assert ((u == 90) == (v == 170)).all()


def test_black_of_high_bit_depths():
    dewarp = om.Dewarper(
        BALL, om.screens.Cylinder((720, 180), -90.0, 90.0)
    )  # the sky is outside the field
    for bits, full_range, expected in (
        (10, False, (64, 512)),
        (10, True, (0, 512)),
        (16, False, (4096, 32768)),
    ):
        y, u, v = dewarp.planes(ramps(SIZE, "left"), full_range=full_range, bits=bits)
        assert (y[~dewarp.valid] == expected[0]).all()
        for plane in (u, v):
            assert plane[0, 0] == expected[1]


def test_border_of_planes():
    view = om.screens.Cylinder((720, 180), -90.0, 90.0)
    parts = tuple(part.astype(np.uint8) for part in ramps(SIZE, "left", 8))
    for border, full_range, expected in (
        (255, False, (235, 128, 128)),
        (255, True, (255, 128, 128)),
        (0, True, (0, 128, 128)),
        ((90, 30, 200), False, (90, 30, 200)),
    ):
        dewarp = om.Dewarper(BALL, view, border=border)
        y, u, v = dewarp.planes(parts, full_range=full_range)
        luma, pairs = dewarp.planes((parts[0], np.dstack(parts[1:])), full_range=full_range)
        assert (y[0, 0], u[0, 0], v[0, 0]) == expected
        assert (luma[0, 0], *pairs[0, 0]) == expected
        assert (y[~dewarp.valid] == expected[0]).all()
    for border, message in (
        (256, "border must be between 0 and 255 for 8 bits; got 256"),
        ((1, 2), r"border must be a grey level or \(y, u, v\)"),
    ):
        with pytest.raises(InvalidParameter, match=message):
            om.Dewarper(BALL, view, border=border).planes(parts)


@pytest.mark.parametrize("interpolation", ["auto", "nearest", "linear", "cubic", "area"])
@pytest.mark.parametrize("name", SCREENS)
def test_nv12_matches_yuv420p(name, interpolation):
    dewarp = om.Dewarper(BALL, SCREENS[name], interpolation)
    y, u, v = (
        np.random.default_rng(i).integers(0, 256, p.shape, np.uint8)
        for i, p in enumerate(ramps(SIZE, "left"))
    )
    as_pairs = om.Dewarper(BALL, SCREENS[name], interpolation)
    for _ in range(2):
        luma, pairs = as_pairs.planes((y, np.dstack([u, v])))
        for one, other in zip(
            dewarp.planes((y, u, v)), (luma, pairs[..., 0], pairs[..., 1]), strict=True
        ):
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", SCREENS)
def test_planes_match_opencv(name, uncompiled):
    dewarp = om.Dewarper(BALL, SCREENS[name])
    smooth = [
        cv2.GaussianBlur(np.random.default_rng(1).integers(0, 256, s, np.uint8), (0, 0), 2)
        for s in ((400, 401), (200, 201), (200, 201))
    ]
    y, u, v = smooth
    outputs = [*dewarp.planes((y, u, v)), *dewarp.planes((y, np.dstack([u, v])))]
    uncompiled()
    for one, other in zip(
        outputs, [*dewarp.planes((y, u, v)), *dewarp.planes((y, np.dstack([u, v])))], strict=True
    ):
        assert np.abs(one.astype(int) - other).max() <= 1


def test_strided_planes_are_filled_in_place():
    dewarp = om.Dewarper(BALL, SCREENS["view"])
    parts = tuple(
        np.random.default_rng(0).integers(0, 256, p.shape, np.uint8) for p in ramps(SIZE, "left")
    )
    dewarp.planes(parts)
    for planes in (parts, (parts[0], np.dstack(parts[1:]))):
        apart = [np.full((p.shape[0], p.shape[1] + 31, *p.shape[2:]), 7, np.uint8) for p in planes]
        views = tuple(memory[:, : p.shape[1]] for memory, p in zip(apart, planes, strict=True))
        for view, plane in zip(views, planes, strict=True):
            view[:] = plane
        expected = dewarp.planes(planes)
        memories = [
            np.full((p.shape[0], p.shape[1] + 13, *p.shape[2:]), 99, np.uint8) for p in expected
        ]
        out = tuple(memory[:, : p.shape[1]] for memory, p in zip(memories, expected, strict=True))
        assert dewarp.planes(views, out) is out
        for one, other, memory in zip(out, expected, memories, strict=True):
            np.testing.assert_array_equal(one, other)
            assert (memory[:, other.shape[1] :] == 99).all()


@pytest.mark.parametrize(
    ("shapes", "dtype", "more", "message"),
    [
        (
            [(400, 401), (200, 200), (200, 200)],
            np.uint8,
            {},
            "planes must have the shapes .* for 401 x 400 px",
        ),
        ([(400, 401)], np.uint8, {}, "planes must have the shapes"),
        (
            [(400, 401), (200, 201, 2)],
            np.float32,
            {},
            "planes must be all uint8 or all uint16; got float32",
        ),
        (
            [(400, 401), (200, 201, 2)],
            np.uint8,
            {"bits": 10},
            "bits must be between 8 and 8 for uint8 planes; got 10",
        ),
        (
            [(400, 401), (200, 201, 2)],
            np.uint16,
            {},
            "bits must be between 9 and 16 for uint16 planes; got 8",
        ),
        (
            [(400, 401), (200, 201, 2)],
            np.uint8,
            {"siting": "above"},
            "siting must be one of left, center, topleft, right, top, bottom; got 'above'",
        ),
        (
            [(400, 401), (200, 201, 2)],
            np.uint8,
            {"out": (np.empty((9, 9), np.uint8),)},
            r"planes must have the shapes .*; got \(9, 9\)",
        ),
    ],
)
def test_invalid_planes_raise(shapes, dtype, more, message):
    with pytest.raises(InvalidParameter, match=message):
        om.Dewarper(BALL, SCREENS["view"]).planes(tuple(np.zeros(s, dtype) for s in shapes), **more)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_uniform_maps_are_exact(data):
    """The chroma map of an affine map between any sizes equals the definition of siting."""
    sitings = data.draw(st.tuples(*[st.sampled_from(list(SITINGS))] * 2))
    width, height = (data.draw(st.integers(2, 40)) for _ in range(2))
    matrix = np.array(data.draw(st.lists(st.floats(-1, 1), min_size=4, max_size=4))).reshape(2, 2)
    size, middle = (1000, 800), np.array([500.0, 400.0])

    def luma(u, v):
        return middle + np.stack(np.meshgrid(u, v), axis=-1) @ matrix.T

    site, to_site = (np.array(SITINGS[siting]) for siting in sitings)
    offsets = (SITINGS[siting] for siting in sitings)
    halved = halved_pixels(luma(np.arange(width), np.arange(height)), *offsets, size)
    columns, rows = (
        2 * np.arange((n + 1) // 2) + s for n, s in zip((width, height), to_site, strict=True)
    )
    np.testing.assert_allclose(halved, (luma(columns, rows) - site) / 2, atol=1e-9)


# -- comparison with dewarping in RGB --------------------------------------------------------------

TO_YUV = np.array(
    [[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]]
)  # BT.709


def yuv_of(rgb, full_range=False):
    """Return luma and chroma at full resolution, in float64."""
    scale = np.array([255, 255, 255]) if full_range else np.array([219, 224, 224])
    return rgb.astype(float) / 255 @ TO_YUV.T * scale + [0 if full_range else 16, 128, 128]


def coded_planes(image, full_range=False):
    """Return (y, u, v) in 4:2:0 with centred chroma, and the image that it represents."""
    yuv = yuv_of(image, full_range)
    height, width = image.shape[:2]
    u, v = (
        np.rint(yuv[..., k].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3)))
        for k in (1, 2)
    )
    y = np.rint(yuv[..., 0])
    whole = [
        y,
        *(cv2.resize(plane, (width, height), interpolation=cv2.INTER_LINEAR) for plane in (u, v)),
    ]
    scale = np.array([255, 255, 255]) if full_range else np.array([219, 224, 224])
    rgb = (np.dstack(whole) - [0 if full_range else 16, 128, 128]) / scale @ np.linalg.inv(TO_YUV).T
    return tuple(plane.astype(np.uint8) for plane in (y, u, v)), rgb.astype(np.float32)


def error_db(values, expected, valid):
    return 10 * np.log10(255**2 / np.mean((values.astype(float) - expected)[valid] ** 2))


@pytest.mark.parametrize("full_range", few([False, True], False), ids=["limited", "full"])
@pytest.mark.parametrize("scene", ["photograph", "room"])
def test_chroma_subsamplings_match(scene, full_range, request):
    """Luma to rounding; chroma to the difference of two methods of subsampling."""
    if scene == "photograph":
        image = om.read_image(request.getfixturevalue("shared_data") / "mirrorball" / "store.jpg")
        image = cv2.resize(image, (1000, 1000), interpolation=cv2.INTER_AREA)
        camera = om.MirrorBall(
            centre_px=(499.5, 499.5), rim_radius_px=480.0, field_deg=270.0, image_size=(1000, 1000)
        )
    else:
        image, camera = om.render_image(SENSOR, om.Room(), samples=2), SENSOR
    planes, whole = coded_planes(image, full_range)
    for screen in (
        om.screens.Cylinder((1440, 360), -70.0, 30.0),
        om.screens.Plane((640, 480), pan_deg=20.0, tilt_deg=-25.0),
    ):
        dewarp = om.Dewarper(camera, screen)
        width, height = screen.size
        expected = yuv_of(255 * dewarp(whole), full_range)
        quads = dewarp.valid.reshape(height // 2, 2, width // 2, 2).all(axis=(1, 3))
        for _ in range(2):
            y, u, v = dewarp.planes(planes, siting="center", full_range=full_range)
            assert error_db(y, expected[..., 0], dewarp.valid) > 54
            for k, plane in ((1, u), (2, v)):
                halved = expected[..., k].reshape(height // 2, 2, width // 2, 2).mean(axis=(1, 3))
                assert error_db(plane, halved, quads) > 44
