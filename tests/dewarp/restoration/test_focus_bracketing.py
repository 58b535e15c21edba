"""Focus bracketing: plan against real rays, scale against projected points, merged image against
the scene."""

from dataclasses import replace

import numpy as np
import pytest
from restoration_gain import dead_leaves, with_fewer_pixels

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.dewarp.restoration.focus_bracketing import (
    focused_at,
    image_weights,
    merge_bracket,
    plan_bracket,
)


def test_bracket_blur_matches_ray_trace():
    sensor = om.load_sensor("paper-hyperboloidal")
    plan = plan_bracket(sensor, limit_px=2.0)
    assert not plan.astigmatic.any()
    omega = np.linspace(5, 130, 8)
    widths = np.max(
        [np.abs(e) for e in om.spots(sensor, omega, focus_mm=plan.focus_mm).extent_px()], axis=0
    )
    assert widths.min(axis=1).max() < 2.0 + 0.1, "coma adds some hundredths of a pixel"


def test_bracket_is_minimal():
    sensor = om.load_sensor("paper-hyperboloidal")
    plan = plan_bracket(sensor, limit_px=2.0)
    for k in range(len(plan.focus_mm)):
        left = np.delete(plan.focus_mm, k)
        blur = [om.evaluate(sensor, plan.omega_deg, focus_mm=f).blur_s_px for f in left]
        assert np.abs(blur).min(axis=0).max() > 2.0


@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant"])
def test_astigmatism_limits_bracket(name: str):
    """No focus is sharp there: the best one leaves half of the difference of the two blurs."""
    plan = plan_bracket(om.load_sensor(name))
    evaluation = om.evaluate(om.load_sensor(name), plan.omega_deg)
    half = np.abs(evaluation.blur_t_px - evaluation.blur_s_px) / 2
    np.testing.assert_allclose(plan.least_px[plan.astigmatic], half[plan.astigmatic], rtol=0.12)
    assert plan.blur_px[~plan.astigmatic].max() <= 1.0
    assert (plan.blur_px <= np.maximum(1.0, 1.25 * plan.least_px)).all()


def dots(pixels, size: int):
    """Return round dots with a standard deviation of 0.5 px at positions (n, 2)."""
    x, y = np.meshgrid(np.arange(size), np.arange(size))
    image = np.zeros((size, size), np.float32)
    for u, v in pixels:
        image += np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * 1.2**2)).astype(np.float32)
    return image


def centroid(image, u: float, v: float):
    left, top = round(u) - 6, round(v) - 6
    part = image[top : top + 13, left : left + 13].astype(float)
    y, x = np.mgrid[top : top + 13, left : left + 13]
    return np.array([(part * x).sum(), (part * y).sum()]) / part.sum()


@pytest.mark.parametrize("flipped", [False, True])
def test_bracket_images_are_aligned(flipped: bool):
    sensor = om.load_sensor("paper-spherical")
    sensor = replace(sensor, mount=replace(sensor.mount, image_flipped=flipped))
    points = np.array(
        [
            [3000.0, 500, -900],
            [900, -2500, 400],
            [-2000, 300, 1500],
            [200, 1500, -200],
            [400, 300, -900],
        ]
    )
    for focus in (190.0, 205.0):
        displaced, _ = focused_at(sensor, focus).project(points)
        expected, _ = sensor.project(points)
        assert np.hypot(*(displaced - expected).T).max() > 0.7
        merged = merge_bracket(sensor, [dots(displaced, 1024)], focus_mm=[focus])
        centroids = np.array([centroid(merged, u, v) for u, v in expected])
        assert np.hypot(*(centroids - expected).T).max() < 0.1


def test_merged_points_match_projection():
    """Rays through the focused lens, an environment and the merged image, against projected
    directions."""
    sensor, width = om.load_sensor("paper-spherical"), 4096
    pan, tilt = (
        np.radians(a).ravel() for a in np.meshgrid(np.arange(-170, 180, 40), [-60, -30, 0, 20, 38])
    )
    directions = np.stack(
        [np.cos(tilt) * np.cos(pan), -np.cos(tilt) * np.sin(pan), np.sin(tilt)], axis=-1
    )
    column, row = ((np.arange(n) + 0.5) / width * 2 * np.pi for n in (width, width // 2))
    light = np.zeros((width // 2, width), np.float32)
    for p, t in zip(pan, tilt, strict=True):
        rows = np.flatnonzero(np.abs(np.pi / 2 - row - t) < 0.05)
        near = np.cos(row[rows, None]) * np.sin(t) + np.sin(row[rows, None]) * np.cos(t) * np.cos(
            column - np.pi - p
        )
        light[rows] += np.exp((near - 1) / (1 - np.cos(np.radians(0.35))))
    lights = om.Environment(np.ascontiguousarray(np.repeat(light[..., None], 3, axis=2)))
    expected, visible = sensor.project_directions(directions)
    assert visible.all()
    shift = np.hypot(*(focused_at(sensor, 190.0).project_directions(directions)[0] - expected).T)
    assert shift.max() > 2
    for focus in (190.0, 240.0):
        image = om.expose(focused_at(sensor, focus), lights, samples=36)[..., 1]
        merged = merge_bracket(sensor, [np.ascontiguousarray(image)], focus_mm=[focus])
        centroids = np.array([centroid(merged, u, v) for u, v in expected])
        assert np.hypot(*(centroids - expected).T).max() < 0.1


def test_weights_are_smooth_and_sum_to_one():
    sensor = om.load_sensor("paper-spherical")
    radius = np.linspace(0, 520, 2000)
    weights = image_weights(sensor, plan_bracket(sensor).focus_mm, radius)
    np.testing.assert_allclose(weights.sum(axis=0), 1)
    assert np.abs(np.diff(weights, axis=1)).max() < 0.05


def test_merged_image_is_as_sharp_as_best_image():
    sensor = with_fewer_pixels(om.load_sensor("paper-hyperboloidal"), 256, 1.0)
    scene = dead_leaves(1024, 900, smallest_deg=2.1)
    focuses = plan_bracket(sensor, limit_px=2.0).focus_mm
    bracket = [
        om.render_image(focused_at(sensor, f), scene, samples=64, blur=True) for f in focuses
    ]
    sharp = om.render_image(sensor, scene, samples=16).astype(float)
    tenth = np.minimum(
        np.hypot(*(np.indices((256, 256)) - 127.5)) / sensor.rim_radius_px * 10, 10
    ).astype(int)

    def errors(image):
        return np.array([np.sqrt(((image - sharp)[tenth == k] ** 2).mean()) for k in range(10)])

    merged = errors(merge_bracket(sensor, bracket, focus_mm=focuses))
    alone = np.array(
        [
            errors(merge_bracket(sensor, [p], focus_mm=[f]))
            for p, f in zip(bracket, focuses, strict=True)
        ]
    )
    assert (merged < 1.1 * alone.min(axis=0)).all()
    assert (merged.mean() < 0.9 * alone.mean(axis=1)).all()


def test_inconsistent_bracket_raises():
    sensor = om.load_sensor("paper-spherical")
    with pytest.raises(InvalidParameter, match="got 2 distances for 1 images"):
        merge_bracket(sensor, [np.zeros((1024, 1024), np.uint8)], focus_mm=[200, 210])
    with pytest.raises(InvalidParameter, match="got 10 x 20 px"):
        merge_bracket(sensor, [np.zeros((20, 10), np.uint8)], focus_mm=[200])
    with pytest.raises(InvalidParameter, match=r"limit_px must be .*; got 0"):
        plan_bracket(sensor, limit_px=0)
