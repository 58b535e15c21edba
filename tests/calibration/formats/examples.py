"""Cameras of the format tests, and their observations in the frame of other programs' files."""

import numpy as np

from omnimirror.cameras.models import (
    KannalaBrandt,
    OCam,
    RationalPinhole,
    ThinPrismFisheye,
    Unified,
)

F, C, SIZE = (260.0, 261.3), (515.32, 380.29), (1024, 768)
OCAM = OCam(
    polynomial=(-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10),
    centre_px=C,
    image_size=SIZE,
    affine=(0.9998, 4.4e-4, 8e-5),
)
UNIFIED = Unified(
    xi=0.93,
    focal_px=F,
    centre_px=C,
    image_size=SIZE,
    skew_px=0.31,
    k1=-0.01,
    k2=0.002,
    p1=1e-3,
    p2=-2e-3,
)
KANNALA_BRANDT = KannalaBrandt(
    focal_px=F, centre_px=C, image_size=SIZE, k1=0.02, k2=-0.003, k3=4e-4, k4=-1e-5
)
RATIONAL = RationalPinhole(
    focal_px=(600.0, 602.0),
    centre_px=C,
    image_size=SIZE,
    k1=0.3,
    k2=-0.05,
    k3=0.01,
    k4=0.4,
    k5=0.02,
    k6=0.004,
    p1=0.003,
    p2=-0.002,
)
THIN_PRISM = ThinPrismFisheye(
    focal_px=F,
    centre_px=C,
    image_size=SIZE,
    k1=0.05,
    k2=-0.02,
    k3=0.003,
    k4=-2e-4,
    k5=1e-5,
    k6=-1e-6,
    p1=3e-3,
    p2=-2e-3,
    s1=2e-3,
    s2=-3e-4,
    s3=-1e-3,
    s4=4e-4,
)


def projected_points(camera, max_angle_deg=180.0):
    """Return pixels and the points they observe, in the file frame: right, down, towards the
    observation of the centre."""
    pixels = np.random.default_rng(5).uniform(0, np.array(camera.image_size) - 1, (400, 2))
    _, directions, valid = camera.backproject(pixels)
    turned = directions[valid] @ camera.mount.rotation()
    reversed_x = -1 if camera.mount.image_flipped else 1
    points = turned * [reversed_x, 1, -1 if camera.is_backward_facing else 1]
    near = points[:, 2] > np.cos(np.radians(max_angle_deg))
    return pixels[valid][near], points[near] * np.linspace(500, 3000, near.sum())[:, None]
