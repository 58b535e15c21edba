"""Tables of cameras without rotational symmetry: values, and number of traced rays."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.studio._camera_tables import camera_tables, continued, frame_of, lattice_of
from omnimirror.optics.housing import Dome, Housing, Tube
from omnimirror.optics.mirrors import SlopeSpline
from omnimirror.optics.mirrors.as_built import MirrorPose
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
    chosen = np.random.default_rng(0).integers(0, n * n, 4000)
    x, y = (np.linspace(-layout.last, layout.last, n)[part] for part in (chosen % n, chosen // n))
    axis, right, down = frame_of(sensor)
    s = np.hypot(x, y)
    inside = s < 1
    cos = np.sqrt(np.maximum(1 - s * s, 0))
    directions = (
        np.outer(1 - 2 * s * s, axis) + np.outer(2 * cos * x, right) + np.outer(2 * cos * y, down)
    )
    pixels, seen = project(sensor, directions[inside])
    assert seen.sum() > 1000
    assert np.abs(nodes[chosen][inside][seen] - pixels[seen]).max() <= np.spacing(
        np.float32(pixels[seen].max())
    )
    rays = sensor.backproject(pixels[seen])
    truth = rays.origins @ np.stack([axis, right, down], axis=-1)
    off, size = (
        np.abs(starts[chosen][inside][seen] - truth)[rays.valid],
        np.abs(truth[rays.valid]).max(),
    )
    assert off.max() <= 1.5 * np.spacing(
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
        across = 2 * s * np.sqrt(1 - s * s)
        towards = (
            np.outer(1 - 2 * s * s, axis)
            + np.outer(across * np.cos(phi), right)
            + np.outer(across * np.sin(phi), down)
        )
        seen = sensor.project_directions(towards).valid
        low, high = np.where(seen, s, low), np.where(seen, high, s)
    assert np.abs(limits[::7] - low).max() < 3e-7


def test_kink_between_nodes_is_resolved():
    """A kink of the interpolated function is computed exactly."""
    side = np.linspace(-1.0, 1.0, 65)

    def bent(at):
        return np.stack([np.abs(at[:, 0] - 0.3), at[:, 1]], axis=-1)

    found = lattice_of(bent, side)
    assert np.abs(found[..., 0] - np.abs(side - 0.3)).max() < 1e-7
    assert np.abs(found[..., 1] - side[:, None]).max() < 1e-7


def test_step_adds_nodes_only_along_its_edge():
    side, asked = np.linspace(-1.1, 1.1, 257), []

    def stepped(at):
        asked.append(len(at))
        x, y = at.T
        return np.stack(
            [
                np.where(np.hypot(x, y) < 1, np.sin(x + y), np.nan),
                0.0 + (np.hypot(x - 0.1, y) < 0.45),
            ],
            -1,
        )

    whole, costs = lattice_of(stepped, side), [sum(asked)]
    asked.clear()
    in_parts = lattice_of(stepped, side, lambda values: (values[..., 1] > 0.5).astype(int))
    costs.append(sum(asked))
    true = stepped(np.stack(np.meshgrid(side, side), -1).reshape(-1, 2)).reshape(in_parts.shape)
    for found in (whole, in_parts):
        known = np.isfinite(found[..., 0])
        assert known.sum() == np.isfinite(true[..., 0]).sum()
        assert np.abs(found - true)[known].max() <= np.spacing(np.float32(1.0))
    assert costs[1] < 0.75 * costs[0]


def test_tables_extend_beyond_field_limit_by_few_nodes():
    x, y = np.meshgrid(np.arange(30.0), np.arange(30.0))
    cubic = np.stack([x**3 - 2 * x * y, y**2 + x], axis=-1)
    cut = np.where((np.hypot(x - 15, y - 15) < 8)[..., None], cubic, np.nan)
    found = continued(cut)
    told = np.isfinite(found[..., 0])
    assert np.allclose(found[told], cubic[told])
    assert told[15, 15 + 11]
    assert not told[15, 15 + 13]
