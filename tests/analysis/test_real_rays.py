"""Evaluation against finite real rays, traced here from sag and the law of reflection only.

A fan of rays from the object hits the mirror close to both sides of the mirror point of the chief
ray, in the meridian plane (tangential) and perpendicular to it (sagittal). The intersection of the
reflected rays with the chief ray is a virtual image at finite spacing; Richardson extrapolation
yields the limit of zero spacing.
"""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from tests.conftest import MIRRORS, M, sensor_of
from tests.everyday import FEW_MIRRORS, few

WEIGHTS = np.array([4 / 5, -1 / 5, 4 / 105, -1 / 280])  # eighth-order central difference


def normal(mirror, x, y):
    """Return the unit normal towards the lens at (x, y), from finite differences of the sag."""
    r, h = np.hypot(x, y), 2e-3 * M
    k = np.arange(1, 5)
    slope = float(WEIGHTS @ (mirror.sag(np.abs(r + k * h)) - mirror.sag(np.abs(r - k * h)))) / h
    c, s = (x / r, y / r) if r > 0 else (1.0, 0.0)
    n = np.array([slope * c, slope * s, -1.0])
    return n / np.linalg.norm(n)


def reflect(mirror, point_from, direction, x, y):
    """Return the reflected ray (origin, direction) of light from an object (or direction) via
    mirror point (x, y)."""
    hit = np.array([x, y, float(mirror.sag(np.hypot(x, y)))])
    travel = (
        -direction if point_from is None else (hit - point_from) / np.linalg.norm(hit - point_from)
    )
    n = normal(mirror, x, y)
    return hit, travel - 2 * (travel @ n) * n


def extrapolated(estimate):
    """Return the limit of an even function of the spacing, from three spacings."""
    a, b, c = (estimate(s) for s in (0.04, 0.02, 0.01))
    ab, bc = (4 * b - a) / 3, (4 * c - b) / 3
    return (16 * bc - ab) / 15


def tangential_q(mirror, x, obj, d, hit, backward):
    def q(spacing):
        distances = []
        for side in (-1, 1):
            p, r = reflect(mirror, obj, d, x + side * spacing * M / 10, 0.0)
            # hit + q back = p + s r in the meridian plane
            q_s = np.linalg.solve(
                np.array([[backward[0], -r[0]], [backward[2], -r[2]]]), [(p - hit)[0], (p - hit)[2]]
            )
            distances.append(q_s[0])
        return float(np.mean(distances))

    return extrapolated(q)


def sagittal_q(mirror, x, obj, d, hit, backward):
    def q(spacing):
        psi = spacing / 2
        p, r = reflect(mirror, obj, d, x * np.cos(psi), x * np.sin(psi))
        crossing = p - p[1] / r[1] * r  # with its counterpart from -psi, in the meridian plane
        return float((crossing - hit) @ backward)

    return extrapolated(q)


@pytest.mark.parametrize("lens", ["perspective", "orthographic"])
@pytest.mark.parametrize("distance", [np.inf, 5 * M], ids=["infinite", "5M"])
@pytest.mark.parametrize("kind", few(sorted(MIRRORS), *FEW_MIRRORS))
def test_virtual_images_match_ray_intersections(kind, distance, lens):
    if lens == "orthographic" and kind in ("equidistant", "cone"):
        pytest.skip(
            "made for a perspective lens; under an orthographic one a cone sees a single field angle"
        )
    sensor = sensor_of(kind, lens)
    low, high = sensor.field_deg
    omega = np.array([a for a in range(0, 136, 15) if low <= a <= high])
    if omega.size < 3:  # the cone has a field of little more than 10 deg
        omega = np.linspace(low + 0.5, high - 0.5, 5)
    result = om.evaluate(sensor, omega, object_distance_mm=distance)
    for i, angle in enumerate(np.radians(omega)):
        x = result.x_mm[i]
        d = np.array([np.sin(angle), 0.0, -np.cos(angle)])
        hit = np.array([x, 0.0, float(sensor.mirror.sag(x))])
        obj = None if np.isinf(distance) else hit + distance * d
        _, to_lens = reflect(sensor.mirror, obj, d, x, 0.0)
        backward = -to_lens
        # the chief ray itself passes through the lens, or along the axis
        expected = (
            np.array([x, 0, sensor.mirror_distance_mm + hit[2]])
            if lens == "perspective"
            else np.array([0, 0, 1.0])
        )
        np.testing.assert_allclose(backward, expected / np.linalg.norm(expected), atol=1e-9)
        if not (
            kind == "cone" and np.isinf(distance)
        ):  # a straight meridian: image distance equals object distance
            q_t = tangential_q(sensor.mirror, x, obj, d, hit, backward)
            assert result.q_t_mm[i] == pytest.approx(q_t, rel=1e-6), f"tangential at {omega[i]} deg"
            assert result.image_t_x_mm[i] == pytest.approx(
                x + q_t * backward[0], rel=1e-6, abs=1e-9
            )
            assert result.image_t_z_mm[i] == pytest.approx(hit[2] + q_t * backward[2], rel=1e-6)
        else:
            assert np.isinf(result.q_t_mm[i])
        if x > 0:
            q_s = sagittal_q(sensor.mirror, x, obj, d, hit, backward)
            assert result.q_s_mm[i] == pytest.approx(q_s, rel=1e-6), f"sagittal at {omega[i]} deg"
            assert result.image_s_z_mm[i] == pytest.approx(hit[2] + q_s * backward[2], rel=1e-6)
        else:
            assert result.q_s_mm[i] == pytest.approx(result.q_t_mm[i], rel=1e-12)


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_mapping_rate_is_derivative(kind):
    """dh/dOmega against differences of the image heights of neighbouring field angles."""
    sensor = sensor_of(kind)
    low, high = sensor.field_deg
    omega, step = np.linspace(low + 1, high - 1, 23), 0.02
    h = {k: om.evaluate(sensor, omega + k * step).h_px for k in (-2, -1, 1, 2)}
    rate = (8 * (h[1] - h[-1]) - (h[2] - h[-2])) / (12 * step)
    np.testing.assert_allclose(om.evaluate(sensor, omega).dh_domega_px_per_deg, rate, rtol=1e-8)
