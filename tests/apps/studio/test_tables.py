"""Tables of cameras without rotational symmetry: values, and number of traced rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio._camera_tables import camera_tables, continued, frame_of, lattice_of
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.mirrors import SlopeSpline
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.everyday import few

POSE = MirrorPose(0.7, -0.4, 0.5, 0.8, -0.5)
SPHERE = om.load_sensor("paper-spherical")
SENSORS = {
    "sphere": replace(SPHERE, mirror_pose=POSE),
    "even polynomial": replace(om.load_sensor("paper-equidistant"), mirror_pose=POSE),
    "a spline with kinks of its curvature": replace(
        SPHERE, mirror_pose=POSE, mirror=SlopeSpline((0.2, 0.42, 0.7, 1.1, 1.9), 44.0)
    ),
    "distortion that leans, in place": replace(
        SPHERE, lens=replace(SPHERE.lens, k1=-0.2, p1=1e-3, p2=-1e-3)
    ),
    "behind a dome": replace(SPHERE, mirror_pose=POSE, housing=Housing(shell=Dome())),
    "in a tube": replace(
        SPHERE, mirror_pose=POSE, housing=Housing(shell=Tube(120.0))
    ),  # some rays pass above it
    "in a picture that cuts the field": replace(
        SPHERE, mirror_pose=POSE, imager=replace(SPHERE.imager, width_px=700, height_px=500)
    ),
}


@pytest.mark.parametrize(
    "name", few(SENSORS, "sphere", "even polynomial", "in a picture that cuts the field")
)
def test_nodes_are_exact_and_few_rays_are_traced(name, monkeypatch):
    sensor, traced = SENSORS[name], []
    project = om.Sensor.project_directions
    monkeypatch.setattr(
        om.Sensor,
        "project_directions",
        lambda self, to: traced.append(len(to)) or project(self, to),
    )
    layout, values = camera_tables.__wrapped__(sensor)
    part = 2 if "kinks" in name else 3
    assert sum(traced) < layout.lattice**2 / part  # including the search of the field boundary

    nodes, n = values[: 2 * layout.lattice**2].reshape(-1, 2), layout.lattice
    starts = values[-3 * n**2 :].reshape(-1, 3)
    indices = np.random.default_rng(0).integers(0, n * n, 4000)
    x, y = (np.linspace(-layout.last, layout.last, n)[part] for part in (indices % n, indices // n))
    axis, right, down = frame_of(sensor)
    s = np.hypot(x, y)
    is_inside = s < 1
    cos = np.sqrt(np.maximum(1 - s * s, 0))
    directions = (
        np.outer(1 - 2 * s * s, axis) + np.outer(2 * cos * x, right) + np.outer(2 * cos * y, down)
    )
    pixels, is_visible = project(sensor, directions[is_inside])
    assert is_visible.sum() > 1000
    assert np.abs(nodes[indices][is_inside][is_visible] - pixels[is_visible]).max() <= np.spacing(
        np.float32(pixels[is_visible].max())
    )
    rays = sensor.backproject(pixels[is_visible])
    truth = rays.origins @ np.stack([axis, right, down], axis=-1)
    error, size = (
        np.abs(starts[indices][is_inside][is_visible] - truth)[rays.valid],
        np.abs(truth[rays.valid]).max(),
    )
    assert error.max() <= 1.5 * np.spacing(
        np.float32(size)
    )  # 0.5 for their storage, 1 for the polynomial


@pytest.mark.parametrize(
    "name", few(SENSORS, "sphere", "even polynomial", "in a picture that cuts the field")
)
def test_field_limit_agrees_with_bisection(name):
    sensor = SENSORS[name]
    layout, values = camera_tables(sensor)
    limits = values[2 * layout.lattice**2 :][: layout.limits].astype(float)
    axis, right, down = frame_of(sensor)
    phi = np.linspace(0, 2 * np.pi, layout.limits, endpoint=False)[::7]
    low, high = np.zeros(len(phi)), np.ones(len(phi))
    for _ in range(30):
        s = (low + high) / 2
        radial = 2 * s * np.sqrt(1 - s * s)
        directions = (
            np.outer(1 - 2 * s * s, axis)
            + np.outer(radial * np.cos(phi), right)
            + np.outer(radial * np.sin(phi), down)
        )
        is_visible = sensor.project_directions(directions).valid
        low, high = np.where(is_visible, s, low), np.where(is_visible, high, s)
    assert np.abs(limits[::7] - low).max() < 3e-7


def test_kink_between_nodes_is_resolved():
    """A kink of the interpolated function is computed exactly."""
    side = np.linspace(-1.0, 1.0, 65)

    def kinked(points):
        return np.stack([np.abs(points[:, 0] - 0.3), points[:, 1]], axis=-1)

    lattice = lattice_of(kinked, side)
    assert np.abs(lattice[..., 0] - np.abs(side - 0.3)).max() < 1e-7
    assert np.abs(lattice[..., 1] - side[:, None]).max() < 1e-7


def test_step_adds_nodes_only_along_its_edge():
    side, point_counts = np.linspace(-1.1, 1.1, 257), []

    def step_function(points):
        point_counts.append(len(points))
        x, y = points.T
        return np.stack(
            [
                np.where(np.hypot(x, y) < 1, np.sin(x + y), np.nan),
                0.0 + (np.hypot(x - 0.1, y) < 0.45),
            ],
            -1,
        )

    continuous, costs = lattice_of(step_function, side), [sum(point_counts)]
    point_counts.clear()
    piecewise = lattice_of(step_function, side, lambda values: (values[..., 1] > 0.5).astype(int))
    costs.append(sum(point_counts))
    expected = step_function(np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)).reshape(
        piecewise.shape
    )
    for lattice in (continuous, piecewise):
        is_finite = np.isfinite(lattice[..., 0])
        assert is_finite.sum() == np.isfinite(expected[..., 0]).sum()
        assert np.abs(lattice - expected)[is_finite].max() <= np.spacing(np.float32(1.0))
    assert costs[1] < 0.75 * costs[0]


def test_tables_extend_beyond_field_limit_by_few_nodes():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    cubic = np.stack([x**3 - 2 * x * y, y**2 + x], axis=-1)
    truncated = np.where((np.hypot(x - 15, y - 15) < 8)[..., None], cubic, np.nan)
    extended = continued(truncated)
    is_finite = np.isfinite(extended[..., 0])
    assert np.allclose(extended[is_finite], cubic[is_finite])
    assert is_finite[15, 15 + 11]
    assert not is_finite[15, 15 + 13]
