"""Fisheye polynomial against the OpenCV module fisheye."""

import cv2
import numpy as np
import pytest

from omnimirror.cameras.models import KannalaBrandt

COEFFICIENTS = (0.06, -0.02, 0.004, -0.0007)
CAMERA = KannalaBrandt(
    focal_px=(300.0, 310.0),
    centre_px=(322.0, 237.0),
    image_size=(640, 480),
    **dict(zip(("k1", "k2", "k3", "k4"), COEFFICIENTS, strict=True)),
    skew_px=3.0,
)
MATRIX = np.array([[300.0, 0.0, 322.0], [0.0, 310.0, 237.0], [0.0, 0.0, 1.0]])


def test_pixels_and_derivatives_equal_opencv():
    """Points in front of the camera; OpenCV has no projection beyond 90 deg."""
    rng = np.random.default_rng(2)
    points = np.column_stack([rng.uniform(-300, 300, (400, 2)), rng.uniform(20, 200, 400)])
    expected, jacobian = cv2.fisheye.projectPoints(
        points[:, None], np.zeros(3), np.zeros(3), MATRIX, np.array(COEFFICIENTS), alpha=3.0 / 300.0
    )
    projection = CAMERA.image(points)
    np.testing.assert_allclose(projection.pixels, expected[:, 0], atol=1e-9, rtol=0)
    names = [p.name for p in CAMERA.parameters]
    # OpenCV's columns: fx fy, cx cy, k1 to k4, then rotation (3) and translation (3), here those of
    # the points
    columns_of_names = [
        names.index(name) for name in ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4")
    ]
    expected = jacobian.reshape(-1, 2, 15)
    scale = np.abs(expected).max(axis=(0, 1))
    columns = [
        1,
        2,
        3,
        4,
        5,
        6,
        7,
    ]  # OpenCV's fx contains alpha fx; the skew of omnimirror is a separate parameter
    derivatives = projection.d_parameters[:, :, columns_of_names][:, :, columns] / scale[columns]
    np.testing.assert_allclose(derivatives, expected[:, :, columns] / scale[columns], atol=1e-9)
    np.testing.assert_allclose(projection.d_points, expected[:, :, 11:14], rtol=1e-8, atol=1e-8)


def test_projection_continues_behind_camera():
    """Radii of r = Omega (1 + ...), up to 180 deg."""
    omega = np.radians([100.0, 130.0, 170.0])
    camera = KannalaBrandt(
        focal_px=(100.0, 100.0), centre_px=(0.0, 0.0), image_size=(1000, 10), k1=0.01
    )
    directions = np.stack([np.sin(omega), 0 * omega, np.cos(omega)], axis=-1)
    np.testing.assert_allclose(
        camera.image(directions).pixels[:, 0], 100 * (omega + 0.01 * omega**3), rtol=1e-12
    )
    assert np.degrees(camera.model_end) == pytest.approx(180.0)


def test_projection_ends_at_polynomial_maximum():
    """1 - 3 k Omega^2 = 0.01 of r = Omega - k Omega^3."""
    camera = KannalaBrandt(
        focal_px=(100.0, 100.0), centre_px=(0.0, 0.0), image_size=(1000, 10), k1=-0.2
    )
    assert camera.model_end == pytest.approx(np.sqrt(0.99 / 0.6), rel=1e-12)
