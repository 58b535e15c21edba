"""Antialiased painting: each texel contains the coverage of a shape at any resolution."""

from __future__ import annotations

import numpy as np
import pytest

from omnimirror.base.colour import hex_colour, linear_from_srgb, srgb_bytes
from omnimirror.base.errors import InvalidParameter
from omnimirror.simulation.scenes._painting import CLEAR, EMISSION, Canvas, Paint, lettering

BLACK, WHITE = Paint("#000000"), Paint("#ffffff")


def painted_area(canvas: Canvas) -> float:
    return float(canvas.texels[..., 0].sum() * np.prod(canvas.texel))


@pytest.mark.parametrize("texel", [1.0, 3.0, 7.0])
def test_shapes_cover_area_at_any_texel_size(texel: float):
    canvas = Canvas(210.0, 126.0, texel, BLACK)
    canvas.rectangle(10.3, 20.7, 80.9, 100.2, WHITE)
    assert painted_area(canvas) == pytest.approx((80.9 - 10.3) * (100.2 - 20.7), rel=1e-6)
    canvas.disc(150.0, 60.0, 40.0, WHITE)
    assert painted_area(canvas) == pytest.approx(70.6 * 79.5 + np.pi * 40**2, rel=2e-3)


def test_shapes_are_clipped_at_edge():
    canvas = Canvas(100.0, 50.0, 1.0, BLACK)
    canvas.rectangle(-20.0, -20.0, 10.0, 10.0, WHITE)
    canvas.rectangle(200.0, 0.0, 300.0, 10.0, WHITE)
    canvas.disc(100.0, 50.0, 10.0, WHITE)
    assert painted_area(canvas) == pytest.approx(100 + np.pi * 100 / 4, rel=0.01)


@pytest.mark.parametrize("texel", [1.0, 5.0, 9.0])
def test_checkerboard_is_antialiased(texel: float):
    fine, coarse = Canvas(360.0, 360.0, 0.25, BLACK), Canvas(360.0, 360.0, texel, BLACK)
    for canvas in (fine, coarse):
        canvas.checkerboard(13.0, 21.5, 30.0, WHITE)
    n, k = coarse.texels.shape[0], fine.texels.shape[0] // coarse.texels.shape[0]
    mean = fine.texels[..., 0].reshape(n, k, n, k).mean(axis=(1, 3))
    np.testing.assert_allclose(coarse.texels[..., 0], mean, atol=1e-5)


def test_glass_and_lamp_channels():
    canvas = Canvas(20.0, 10.0, 10.0, Paint("#808080"))
    canvas.rectangle(0, 0, 10, 10, Paint("#ff0000", glow=2.0))
    canvas.rectangle(10, 0, 20, 10, Paint(clear=1.0))
    np.testing.assert_array_equal(canvas.texels[0, 0], [0, 0, 0, 2, 0, 0, 0])
    assert canvas.texels[0, 1, CLEAR] == 1
    assert not canvas.texels[0, 1, EMISSION].any()


def test_text_extent():
    canvas = Canvas(400.0, 100.0, 1.0, BLACK)
    extent = canvas.text("LID", 200.0, 50.0, 40.0, WHITE)
    rows, columns = np.nonzero(canvas.texels[..., 0])
    assert (columns.min(), columns.max() + 1) == (extent.left, extent.right)
    assert (rows.min(), rows.max() + 1) == (100 - extent.top, 100 - extent.bottom)
    assert (extent.left + extent.right) / 2 == pytest.approx(200, abs=0.5)
    assert extent.top - extent.bottom == pytest.approx(40, abs=1)


def test_text_orientation():
    ink = lettering("L", 64.0)
    rows, columns = ink.shape
    assert ink[:, : columns // 4].mean() > 0.9, "the stem is left"
    assert ink[-rows // 8 :].mean() > 0.9, "the foot is at the bottom"
    assert ink[: rows // 2, columns // 2 :].max() == 0
    assert lettering("O", 64.0)[32, lettering("O", 64.0).shape[1] // 2] == 0, "an O is open"


def test_blank_text_raises():
    with pytest.raises(InvalidParameter, match="at least one visible letter"):
        lettering(" ", 20.0)


def test_srgb_round_trip():
    every = np.arange(256)
    np.testing.assert_array_equal(srgb_bytes(linear_from_srgb(every / 255)), every)


def test_invalid_colour_raises():
    with pytest.raises(InvalidParameter, match="'#ff80'"):
        hex_colour("#ff80")
