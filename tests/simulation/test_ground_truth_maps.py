"""Ground truth against an independent tracer: rays by bisection and Snell's law by angles, in
double precision.

It shares only the sensor parameters with the package: lens, sphere, mount.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.datasets import visible_corners_px
from omnimirror.simulation.ground_truth_maps import ground_truth
from omnimirror.simulation.pixel_rays import project_visible
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.scene import Pose
from tests.analysis.test_huygens_mtf import out_of
from tests.everyday import few

SIZE = 96
FULL = Housing(CameraBody(60.0, height_mm=4.0), Rod(12.0, 4.0, gap_mm=45.0), rim=Rim(1.5))


def sensor_of(pixels=SIZE, shift=(0.0, 0.0, 0.0), housing=FULL):
    sensor = om.load_sensor("paper-spherical")
    imager = replace(
        sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=1.02 * 5.2 * 1024 / pixels
    )
    return replace(sensor, imager=imager, mirror_pose=MirrorPose(*shift), housing=housing)


# -- tracer
# ------------------------------------------------------------------------------------------


class Tracer:
    """Sensor as plain numbers; its frame has the origin at the vertex and z from the lens to the
    mirror."""

    def __init__(self, sensor):
        self.m, lens = sensor.mirror_distance_mm, sensor.lens
        self.b = 1 / (1 / lens.focal_length_mm - 1 / lens.focus_distance_mm)
        self.pitch, self.size = 1e-3 * sensor.imager.pixel_pitch_um, sensor.imager.width_px
        self.radius, self.rim = sensor.mirror.vertex_radius, sensor.mirror.rim_radius_mm
        pose = sensor.mirror_pose
        self.shift = np.array([pose.decentre_x_mm, pose.decentre_y_mm, pose.displacement_mm])
        self.housing, self.top = sensor.housing, self.radius - np.sqrt(self.radius**2 - self.rim**2)

    def trace(self, pixels):
        """Return origins and directions (n, 3) of pixels (n, 2) outside the sensor, with visibility
        and obscuration."""
        across = (pixels - (self.size - 1) / 2) * self.pitch
        d = np.concatenate([across, np.full((len(pixels), 1), self.b)], axis=1)
        d /= np.sqrt((d**2).sum(axis=1))[:, None]
        lens = np.broadcast_to([0.0, 0.0, -self.m], d.shape)
        centre = self.shift + np.array([0, 0, self.radius])
        # the near intersection with the sphere is half a chord before the point closest to its
        # centre
        along = ((centre - lens) * d).sum(axis=1)
        apart = ((lens + along[:, None] * d - centre) ** 2).sum(axis=1)
        with np.errstate(invalid="ignore"):
            p = lens + (along - np.sqrt(self.radius**2 - apart))[:, None] * d
            hit = np.hypot(*(p - self.shift)[:, :2].T) <= self.rim
        normal = (centre - p) / self.radius
        out = d - 2 * (d * normal).sum(axis=1)[:, None] * normal
        hidden = hit & (
            self.on_camera(p, out)
            | self.on_rod(p, out)
            | self.on_rod(lens, p - lens)
            | self.on_lids(p, out)
        )
        hidden |= self.on_edge(np.where(hit[:, None], p, lens), np.where(hit[:, None], out, d))
        is_visible = hit & ~hidden
        p, out = p[is_visible], out[is_visible]
        if self.housing.shell is not None:
            p, out = trace_through_shell(self.housing.shell, p, out)
        return p, out, is_visible, hidden

    def on_disc(self, p, d, height, radius):
        t = (height - p[:, 2]) / d[:, 2]
        return (t > 0) & (np.hypot(*(p + t[:, None] * d)[:, :2].T) < radius)

    def on_camera(self, p, d):
        camera = self.housing.camera
        return camera is not None and self.on_disc(
            p, d, camera.height_mm - self.m, camera.diameter_mm / 2
        )

    def on_lids(self, p, d):
        """Return hits on the discs in a tube, in the lens plane and at the back of the mirror, and
        on that in a dome."""
        shell, rim = self.housing.shell, self.housing.rim
        if shell is None:
            return np.zeros(len(p), dtype=bool)
        inner = shell.diameter_mm / 2 - shell.wall_mm
        if isinstance(shell, Dome):
            z_mm = -self.m - shell.centre_mm - shell.inner_shift_mm
            return self.on_disc(p, d, -self.m, np.sqrt(inner**2 - z_mm**2))
        back = self.top + (rim.thickness_mm if rim else 5.0)
        return self.on_disc(p, d, -self.m, inner) | self.on_disc(p, d, back, inner)

    def on_edge(self, p, d):
        if self.housing.rim is None:
            return np.zeros(len(p), dtype=bool)
        t = (self.top + self.shift[2] - p[:, 2]) / d[:, 2]
        r = np.hypot(*(p + t[:, None] * d - self.shift)[:, :2].T)
        return (t > 0) & (r > self.rim) & (r < self.rim + self.housing.rim.width_mm)

    def on_rod(self, p, d):
        """Return the minimum distance from the axis minus the rod radius between its ends; it is
        convex along a ray."""
        rod = self.housing.rod
        if rod is None:
            return np.zeros(len(p), dtype=bool)
        ends, foot, top = (
            np.array([rod.gap_mm - self.m, 0.0]),
            rod.diameter_mm / 2,
            rod.end_diameter_mm / 2,
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            t = np.sort((ends - p[:, 2:]) / d[:, 2:], axis=1)
        low, high = np.maximum(t[:, 0], 0.0), t[:, 1]
        crosses = high >= low

        def gap(t):
            at = p + t[:, None] * d
            share = (at[:, 2] - ends[0]) / (ends[1] - ends[0])
            return np.hypot(at[:, 0], at[:, 1]) - foot - share * (top - foot)

        for _ in range(160):
            a, b = low + (high - low) / 3, high - (high - low) / 3
            left = gap(a) < gap(b)
            low, high = np.where(left, low, a), np.where(left, b, high)
        return crosses & (gap((low + high) / 2) < 0)


def trace_through_shell(shell, p, d):
    """Trace rays out through a shell: bisection to each surface, and Snell's law for the angles
    there."""
    n = shell.refractive_index
    if isinstance(shell, Tube):
        flat, inner, outer = np.array([1.0, 1.0, 0.0]), np.zeros(3), np.zeros(3)
    else:
        flat = np.ones(3)
        outer = np.array([0.0, 0.0, shell.centre_mm])
        inner = outer + np.array([0, 0, shell.inner_shift_mm])
    for centre, radius, before, behind in (
        (inner, shell.diameter_mm / 2 - shell.wall_mm, 1.0, n),
        (outer, shell.diameter_mm / 2, n, 1.0),
    ):
        low, high = np.zeros(len(p)), np.full(len(p), 1e4)
        for _ in range(80):
            t = (low + high) / 2
            beyond = np.linalg.norm((p + t[:, None] * d - centre) * flat, axis=1) > radius
            low, high = np.where(beyond, low, t), np.where(beyond, t, high)
        p = p + low[:, None] * d
        normal = (p - centre) * flat
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        cosine = (d * normal).sum(axis=1)
        tangent = d - cosine[:, None] * normal
        angle = np.arcsin(before / behind * np.linalg.norm(tangent, axis=1))
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-300)[:, None]
        d = np.cos(angle)[:, None] * normal + np.sin(angle)[:, None] * tangent
    return p, d


def to_world(sensor, vectors):
    return vectors @ sensor.mount.rotation().T


@dataclass(frozen=True)
class Ball:
    """Ball about the sensor, observed from inside: its distance is a single root."""

    radius_mm: float = 500.0

    def radiance(self, origins_mm, directions):
        return np.ones(origins_mm.shape, np.float32)

    def distance_mm(self, origins_mm, directions):
        length = np.linalg.norm(directions, axis=1)
        along = (origins_mm * directions).sum(axis=1) / length
        left = (origins_mm**2).sum(axis=1) - self.radius_mm**2
        return (np.sqrt(along**2 - left) - along) / length


def grid(size=SIZE):
    return (
        np.stack(np.meshgrid(np.arange(size), np.arange(size)), axis=-1)
        .reshape(-1, 2)
        .astype(float)
    )


# -- labels ------------------------------------------------------------------------------------------

SHELLS = [None, Tube(110.0, 5.0), Dome(260.0, 5.0, centre_mm=-74.0, inner_shift_mm=1.0)]


@pytest.mark.parametrize("shift", [(0.0, 0.0, 0.0), (1.5, -1.0, 0.7)], ids=["aligned", "decentred"])
@pytest.mark.parametrize("shell", few(SHELLS, SHELLS[2]), ids=["open", "tube", "dome"])
def test_hidden_pixels_match_ray_trace(shell, shift):
    """Obscured, visible or neither for all pixels; and their points to 0.01 um."""
    sensor = sensor_of(shift=shift, housing=replace(FULL, shell=shell))
    truth = ground_truth(sensor, Ball())
    p, d, is_visible, hidden = Tracer(sensor).trace(grid())
    np.testing.assert_array_equal(truth.hidden.ravel(), hidden)
    np.testing.assert_array_equal(np.isfinite(truth.depth_mm).ravel(), is_visible)
    assert hidden.sum() > 300
    assert not (truth.hidden & np.isfinite(truth.directions[..., 0])).any()
    p, d = to_world(sensor, p), to_world(sensor, d)
    points = p + Ball().distance_mm(p, d)[:, None] * d
    np.testing.assert_allclose(truth.points_mm[np.isfinite(truth.depth_mm)], points, atol=1e-5)
    np.testing.assert_allclose(truth.directions[np.isfinite(truth.depth_mm)], d, atol=1e-9)


def test_hidden_pixels_are_dark():
    sensor = sensor_of(256)
    light = expose(
        sensor,
        Environment(np.ones((4, 8, 3), np.float32)),
        samples=1,
        radiometry=Radiometry(housing_light=0.0),
    )
    truth = ground_truth(sensor, Ball())
    assert ((light[..., 0] > 0.5) != np.isfinite(truth.depth_mm)).sum() <= 2, (
        "single precision, at edges"
    )


@pytest.mark.parametrize("width", [1.5, 10.0])
def test_rim_obscures_rays(width, uncompiled):
    """Rays that leave the mirror near its rim with a steeper slope than that towards the edge."""
    sensor, dark = sensor_of(64, housing=Housing(rim=Rim(width))), Radiometry(housing_light=0.0)
    sky = Environment(np.ones((4, 8, 3), np.float32))
    fast = expose(sensor, sky, samples=9, radiometry=dark)
    uncompiled()
    np.testing.assert_allclose(fast, expose(sensor, sky, samples=9, radiometry=dark), atol=1e-4)
    assert fast.sum() < expose(sensor_of(64, housing=Housing()), sky, samples=9).sum() - 10


def test_direct_view_rays_start_at_lens():
    sensor = sensor_of(housing=Housing())
    truth = ground_truth(sensor, Ball(), Radiometry(direct_view=True))
    np.testing.assert_allclose(
        truth.origins_mm[0, 0], to_world(sensor, np.array([0, 0, -sensor.mirror_distance_mm]))
    )
    np.testing.assert_allclose(np.linalg.norm(truth.points_mm[0, 0]), 500.0)


def test_lid_obscures_pixels():
    """A wide cap of the tube, level with the rim, blocks rays steeper than those to the wall."""
    sensor = sensor_of(housing=Housing(shell=Tube(400.0), rim=Rim(thickness_mm=1.0)))
    truth = ground_truth(sensor, Ball())
    p, d, is_visible, _ = Tracer(replace(sensor, housing=Housing())).trace(grid())
    back = float(sensor.mirror.sag(np.array(sensor.mirror.rim_radius_mm))) + 1.0
    t = (back - p[:, 2]) / d[:, 2]
    below_cap = (t > 0) & (np.hypot(*(p + t[:, None] * d)[:, :2].T) < 197.0)
    assert 100 < below_cap.sum() < is_visible.sum()
    np.testing.assert_array_equal(
        (truth.hidden.ravel()[is_visible])[d[:, 2] > 0], below_cap[d[:, 2] > 0]
    )
    light = expose(sensor, Ball(), samples=1, radiometry=Radiometry(housing_light=0.0))
    assert not light[truth.hidden].any()


def test_radiometry_requires_one_mirror():
    with pytest.raises(InvalidParameter, match="housing must be empty"):
        ground_truth(
            replace(om.load_sensor("folded-spherical"), housing=Housing(shell=Tube())), Ball()
        )


# -- corners -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("shell", few(SHELLS, SHELLS[2]), ids=["open", "tube", "dome"])
def test_visible_corners_match_ray_trace(shell):
    sensor, hall = sensor_of(1024, housing=replace(FULL, shell=shell)), Hall(texel_mm=50.0)
    tracer, bare, count, hidden = Tracer(sensor), replace(sensor, housing=Housing()), 0, 0
    for pose in (Pose(), Pose(400.0, -300.0, -500.0, 40.0, 5.0)):
        corners_px = visible_corners_px(sensor, hall, pose)
        plain = visible_corners_px(bare, hall, pose)
        for name, pixels in corners_px.items():
            corners = pose.to_sensor(hall.board_corners_mm(name).reshape(-1, 3))
            visible = np.isfinite(pixels[..., 0]).ravel()
            p, d, is_visible, _ = tracer.trace(pixels.reshape(-1, 2)[visible])
            assert is_visible.all()
            offset = corners[visible] - to_world(sensor, p)
            miss = np.linalg.norm(np.cross(offset, to_world(sensor, d)), axis=1)
            assert (miss < 1e-4).all()
            count += visible.sum()
            occluded = np.isfinite(plain[name][..., 0]).ravel() & ~visible
            if shell is None and occluded.any():
                assert tracer.trace(plain[name].reshape(-1, 2)[occluded])[3].all()
            hidden += occluded.sum()
    assert count > 1200
    assert hidden > 20


def test_points_visible_by_refraction_only():
    """Just outside the rim field without the dome, and inside it with a dome that refracts
    outwards."""
    sensor = sensor_of(1024, housing=Housing(shell=Dome(330.0, 8.0, centre_mm=-40.0)))
    turns = np.linspace(0, 6, 9)
    edge = 511.5 + 0.9999 * sensor.rim_radius_px * np.stack([np.cos(turns), np.sin(turns)], axis=-1)
    p, d, is_visible, _ = Tracer(sensor).trace(edge)
    assert is_visible.all()
    points = to_world(sensor, p + 2000.0 * d)
    assert not replace(sensor, housing=Housing()).project(points).valid.any()
    for pixels, valid in (project_visible(sensor, points), sensor.project(points)):
        assert valid.all()
        np.testing.assert_allclose(pixels, edge, atol=1e-6)


FOLDED_HIDES = {"folded-spherical": 840, "folded-hyperboloidal": 400}
"""Pixels of the primary obscured by the secondary, the bore and the camera, in images of a quarter
of the size."""


@pytest.mark.parametrize("name", FOLDED_HIDES)
def test_two_mirror_obscuration_matches_ray_trace(name):
    sensor = om.load_sensor(name)
    imager, lens = sensor.imager, sensor.lens
    size = {"width_px": imager.width_px // 4, "height_px": imager.height_px // 4}
    sensor = replace(
        sensor, imager=replace(imager, **size, pixel_pitch_um=4 * imager.pixel_pitch_um)
    )
    truth = ground_truth(sensor, Ball())
    u, v = np.meshgrid(np.arange(size["width_px"]), np.arange(size["height_px"]))
    image = (
        np.stack([u, v], axis=-1).reshape(-1, 2) - sensor.imager.centre
    ) * sensor.imager.pitch_mm
    behind = 1 / (1 / lens.focal_length_mm - 1 / lens.focus_distance_mm)
    rays = np.column_stack([image / behind, np.ones(len(image))])
    with np.errstate(all="ignore"):
        _, hit, out, blocked = out_of(
            sensor, np.zeros_like(rays), rays / np.linalg.norm(rays, axis=1)[:, None]
        )
        reached_secondary = np.isfinite(out).all(axis=1) & (
            np.hypot(hit[:, 0], hit[:, 1]) <= sensor.mirror.rim_radius_mm
        )
    np.testing.assert_array_equal(truth.hidden.ravel(), reached_secondary & blocked)
    np.testing.assert_array_equal(
        np.isfinite(truth.directions[..., 0]).ravel(), reached_secondary & ~blocked
    )
    assert truth.hidden.sum() == FOLDED_HIDES[name]
