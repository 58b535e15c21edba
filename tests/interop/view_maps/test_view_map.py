"""View maps and inverse maps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OutsideField
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp.screens import parts_of
from omnimirror.dewarp.view_geometry import centre_of_projection
from omnimirror.interop.view_maps import _inverse_mapping
from omnimirror.interop.view_maps._inverse_mapping import intersect_screen, view_pixels
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.everyday import few

SENSOR = om.load_sensor("paper-spherical")
SMALL = replace(
    SENSOR, imager=replace(SENSOR.imager, width_px=128, height_px=128, pixel_pitch_um=41.6)
)
CAMERAS = {
    "up": SMALL,
    "down, misaligned": replace(
        SMALL, mount=Mount("down", 30.0), mirror_pose=MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)
    ),
    "fisheye": om.Unified(
        xi=0.9, focal_px=(55.0, 55.0), centre_px=(63.5, 63.5), image_size=(128, 128)
    ),
}
VIEWS = {
    "panorama": lambda c: om.views.panorama(c, (360, None)),
    "panorama of a wall": lambda c: om.views.panorama(c, (360, None), distance_mm=900.0),
    "perspective": lambda c: om.screens.Plane(
        (200, 150), pan_deg=140.0, tilt_deg=-20.0, roll_deg=10.0, hfov_deg=80.0
    ),
    "near wall": lambda c: om.screens.Plane((200, 150), distance_mm=400.0, hfov_deg=80.0),
    "dome": lambda c: om.views.dome(c, (220, 220)),
    "planet": lambda c: om.views.planet(c, (220, 220)),
    "ground": lambda c: om.views.ground(c, height_mm=800.0, size=(200, 200)),
    "cube": lambda c: om.views.cube(c, (192, 128), layout="3x2"),
    "mosaic": lambda c: om.views.mosaic(c, (400, None)),
}


def round_trip_errors(camera, view, viewpoint="exact"):
    """Return the errors, px, of pixels mapped to the image and back to the view."""
    positions = om.view_map(camera, view, viewpoint).dewarp_map
    errors = []
    for left, top, screen in parts_of(view):
        width, height = screen.size
        v, u = np.mgrid[1 : height - 2 : 7, 1:width:7]
        sources = positions[v + top, u + left]
        valid = np.isfinite(sources).all(-1)
        rays = camera.backproject(sources[valid])
        centre = centre_of_projection(camera, screen, viewpoint)
        origins = rays.origins if centre is None else np.broadcast_to(centre, rays.origins.shape)
        result = intersect_screen(screen, origins[rays.valid], rays.directions[rays.valid])
        pixels = np.stack([u, v], axis=-1)[valid][rays.valid].astype(float)
        # in source px: a pole of a panorama is one point of the image and many pixels of the view
        scale = np.linalg.norm(
            np.gradient(positions[top : top + height, left : left + width], axis=1), axis=-1
        )
        errors.append(
            np.linalg.norm(result - pixels, axis=-1) * np.fmin(scale[v, u][valid][rays.valid], 1.0)
        )
    return np.concatenate(errors)


@pytest.mark.parametrize("camera", few(CAMERAS, "up"))
@pytest.mark.parametrize("view", VIEWS)
def test_round_trip_error(view, camera):
    """The error is below 0.02 px for all views."""
    camera = CAMERAS[camera]
    try:
        errors = round_trip_errors(camera, VIEWS[view](camera))
    except (OutsideField, InvalidParameter):
        pytest.skip("the view is outside the field of this camera")
    assert len(errors) > 100
    assert (
        np.isfinite(errors).mean() > 0.97
    )  # border pixels can leave the view; poles are undefined
    assert np.nanmax(errors) < 0.02


@pytest.mark.parametrize("camera", CAMERAS)
def test_warp_map_agrees_with_the_projection(camera):
    """Project the targets of mapped pixels; no interpolation is involved."""
    camera = CAMERAS[camera]
    for name in ("perspective", "near wall", "cube"):
        view = VIEWS[name](camera)
        warp_map = om.view_map(camera, view).warp_map
        rows, columns = np.nonzero(np.isfinite(warp_map).all(-1))
        u, v = warp_map[rows, columns].T
        assert len(u) > 200
        checked = 0
        for left, top, screen in parts_of(view):
            width, height = screen.size
            a, b = u - left, v - top
            edge = 0.5 - 1e-6  # rays through an edge belong to either face
            own = (a > -edge) & (a < width - 1 + edge) & (b > -edge) & (b < height - 1 + edge)
            targets = screen.targets_at(a[own][::40], b[own][::40]).reshape(-1, 3)
            projected = (
                camera.project_directions(targets) if screen.is_distant else camera.project(targets)
            )
            expected = np.stack([columns, rows], -1)[own][::40]
            np.testing.assert_allclose(projected.pixels, expected, rtol=0, atol=1e-5)
            checked += own.sum()
        assert 0.98 * len(u) < checked <= len(u)


@pytest.mark.parametrize("width", [171, 200, 360, 428])
@pytest.mark.parametrize("distance_mm", [np.inf, 900.0])
def test_poles_of_panoramas_have_no_hole(width, distance_mm):
    """Rays around the nadir hit the screen for any size of the panorama."""
    view = om.screens.Equirectangular((width, width // 2), distance_mm=distance_mm)
    radius, azimuth = np.meshgrid(
        [0.02, 0.1, 0.3, 0.7, 1.5, 4.0], np.radians(np.arange(0.0, 360.0, 7.0))
    )
    pixels = 63.5 + np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth)], axis=-1).reshape(
        -1, 2
    )
    rays = SMALL.backproject(pixels)
    ends = intersect_screen(view, rays.origins, rays.directions)
    assert np.isfinite(ends).all()
    headings = view.targets_at(ends[:, 0], ends[:, 1]) - (0.0 if view.is_distant else rays.origins)
    headings /= np.linalg.norm(headings, axis=-1, keepdims=True)
    np.testing.assert_allclose(headings, rays.directions, atol=1e-7)


FLAT = {
    "distant": om.screens.Plane(
        (60, 40), pan_deg=140.0, tilt_deg=-20.0, roll_deg=10.0, hfov_deg=80.0
    ),
    "near": om.screens.Plane((60, 40), distance_mm=400.0, hfov_deg=80.0),
    "upright": om.screens.Plane((40, 60), pan_deg=-70.0, hfov_deg=50.0),
    "smaller than the parallax": om.screens.Plane((60, 40), distance_mm=400.0, hfov_deg=4.0),
    "part of a cylinder": om.screens.Cylinder((60, 40), -20.0, 25.0, pan_deg=30.0, span_deg=120.0),
}


@pytest.mark.parametrize("name", FLAT)
def test_rays_outside_the_view_are_nan(name):
    """Rays to targets in and around the view, and in opposite directions."""
    view = FLAT[name]
    width, height = view.size
    at = [
        np.concatenate(
            [
                [-0.5 + 1e-3, -0.5 - 1e-3, side - 0.5 - 1e-3, side - 0.5 + 1e-3],
                np.linspace(-5, side + 5, 31),
            ]
        )
        for side in (width, height)
    ]
    u, v = (a.ravel() for a in np.meshgrid(*at))
    origins = np.random.default_rng(4).uniform(-20.0, 20.0, (len(u), 3))
    directions = view.targets_at(u, v).reshape(-1, 3) - (0.0 if view.is_distant else origins)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
    assert 0.3 < inside.mean() < 0.9
    expected = np.where(inside[:, None], np.stack([u, v], axis=-1), np.nan)
    np.testing.assert_allclose(intersect_screen(view, origins, directions), expected, atol=1e-6)
    assert np.isnan(intersect_screen(view, origins, -directions)).all()
    assert intersect_screen(view, origins[:0], directions[:0]).shape == (0, 2)


@pytest.mark.parametrize("size", [(428, 171), (171, 428), (90, 40), (7, 4), (40, 1), (1, 1)])
def test_initial_values_are_a_grid_over_the_screen(size, monkeypatch):
    """From 0.25 px inside one edge to the other, in steps of one pixel or 1/160 of the longer side; a
    side of one pixel is covered too."""
    calls = []
    targets = _inverse_mapping._targets
    monkeypatch.setattr(
        _inverse_mapping, "_targets", lambda screen, at: (calls.append(at), targets(screen, at))[1]
    )
    view = om.screens.Plane(size, hfov_deg=60.0, distance_mm=500.0)
    centre = np.array(size) / 2 - 0.5
    pixels = centre + 0.499 * np.array([[0, 0], [1, 1], [-1, 1], [1, -1], [-1, -1]])
    points = view.targets_at(*pixels.T)
    directions = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.testing.assert_allclose(intersect_screen(view, 0 * points, directions), pixels, atol=1e-6)
    for axis, side in enumerate(size):
        positions = np.unique(calls[0][:, axis])
        assert (positions[0], positions[-1]) == (-0.25, side - 0.75)
        steps = np.diff(positions)
        np.testing.assert_allclose(steps, steps.mean(), rtol=1e-9)
        min_steps = (side - 0.5) / max(1, max(size) / 160)
        assert min_steps <= len(steps) < min_steps + 1
    assert len(calls[0]) == np.prod([len(np.unique(calls[0][:, axis])) for axis in (0, 1)])


@pytest.mark.parametrize(
    "view",
    [
        om.screens.Cylinder((20, 200), -8.0, 8.0),  # pixels of 18 by 0.08 deg
        om.screens.Cylinder((400, 10), -60.0, 60.0, span_deg=40.0),  # 0.1 by 12 deg
        om.screens.Cylinder((20, 200), -8.0, 8.0, distance_mm=900.0),
    ],
)
def test_elongated_pixels_are_sampled_uniformly(view):
    width, height = view.size
    u, v = (
        a.ravel()
        for a in np.meshgrid(np.linspace(0, width - 1, 67), np.linspace(0, height - 1, 71))
    )
    directions = view.targets_at(u, v).reshape(-1, 3)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(
        intersect_screen(view, 0 * directions, directions), np.stack([u, v], axis=1), atol=1e-5
    )


class Bowl:
    """Paraboloid z = (x^2 + y^2) / 20 mm whose vertex is pixel (20, 15)."""

    size = (41, 31)
    is_distant = False

    def targets_at(self, u, v):
        x, y = u - 20.0, v - 15.0
        return np.stack([x, y, (x**2 + y**2) / 20.0], axis=-1)


def test_node_at_the_origin_of_the_rays_has_no_direction():
    u, v = (
        a.ravel() for a in np.meshgrid(np.arange(0.0, 41.0, 4.0) + 0.3, np.arange(0.2, 31.0, 3.0))
    )
    directions = Bowl().targets_at(u, v)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    pixels = intersect_screen(Bowl(), 0 * directions, directions)
    np.testing.assert_allclose(pixels, np.stack([u, v], axis=1), atol=1e-6)


def test_large_images_are_mapped_in_chunks(monkeypatch):
    """At most 65536 rays are intersected at once, each pixel once."""
    counts = []

    def count_rays(screen, origins, directions):
        counts.append(len(directions))
        return np.zeros((len(directions), 2))

    monkeypatch.setattr(_inverse_mapping, "intersect_screen", count_rays)
    camera = om.Unified(
        xi=0.9, focal_px=(160.0, 160.0), centre_px=(149.5, 149.5), image_size=(300, 300)
    )
    rays = camera.backproject(
        np.stack(np.meshgrid(np.arange(300.0), np.arange(300.0)), axis=-1).reshape(-1, 2)
    )
    mapped = view_pixels(camera, om.screens.Equirectangular((40, 20)), "exact")
    assert sum(counts) == rays.valid.sum()
    assert max(counts) <= 65536
    assert len(counts) == 2
    assert (np.isfinite(mapped).all(-1).ravel() == rays.valid).all()


HALF = np.sqrt(0.5)
DIAGONALS = [
    np.array([x, y, z]) * HALF
    for x, y, z in [(1, 0, 1), (-1, 0, 1), (0, 1, 1), (0, -1, 1), (1, 1, 0), (1, -1, 0)]
]


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), *DIAGONALS])
def test_rays_along_coordinate_axes_and_diagonals(axis):
    x, y, z = axis
    view = om.screens.Plane(
        (41, 31),
        pan_deg=-np.degrees(np.arctan2(y, x)),
        tilt_deg=np.degrees(np.arcsin(z)),
        hfov_deg=60.0,
    )
    ends = intersect_screen(view, np.zeros((2, 3)), np.stack([axis, -axis]))
    np.testing.assert_allclose(ends, [[20.0, 15.0], [np.nan, np.nan]], atol=1e-6)


@pytest.mark.parametrize("distance_mm", [np.inf, 900.0])
def test_rays_at_the_seam_of_a_panorama(distance_mm):
    view = om.screens.Cylinder((90, 40), -40.0, 30.0, distance_mm=distance_mm)
    u, v = (
        a.ravel()
        for a in np.meshgrid(
            [-0.499, -0.3, 0.0, 0.2, 45.0, 88.8, 89.0, 89.3, 89.499], [0.0, 20.0, 39.0]
        )
    )
    origins = np.random.default_rng(4).uniform(-20.0, 20.0, (len(u), 3))
    directions = view.targets_at(u, v).reshape(-1, 3) - (0.0 if view.is_distant else origins)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    np.testing.assert_allclose(
        intersect_screen(view, origins, directions), np.stack([u, v], axis=-1), atol=1e-6
    )


def test_chunks_do_not_change_the_map(monkeypatch):
    """All pixels of a fisheye camera are mapped, in one chunk or several."""
    camera = om.Unified(
        xi=0.9, focal_px=(55.0, 55.0), centre_px=(31.5, 23.5), image_size=(64, 48), optics="fisheye"
    )
    view = om.screens.Equirectangular((180, 90))
    whole = view_pixels(camera, view, "exact")
    assert np.isfinite(whole).all()
    monkeypatch.setattr(_inverse_mapping, "CHUNK_RAYS", 1000)
    np.testing.assert_allclose(view_pixels(camera, view, "exact"), whole, atol=1e-6)


def test_panorama_covers_the_ring_of_the_image():
    """The inverse map has no holes, not even at the seam."""
    fixed = om.view_map(SMALL, om.views.panorama(SMALL, (360, None)))
    rays = SMALL.backproject(
        np.stack(np.meshgrid(np.arange(128), np.arange(128)), -1).reshape(-1, 2).astype(float)
    )
    low, high = fixed.view.tilt_min_deg, fixed.view.tilt_max_deg
    tilt = np.degrees(np.arcsin(rays.directions[:, 2]))
    inside = rays.valid & (tilt > low + 1.5) & (tilt < high - 0.5)
    assert np.isfinite(fixed.warp_map).all(-1).ravel()[inside].all()


def test_viewpoint_mode_of_the_warp_map():
    wall = om.screens.Plane((200, 150), distance_mm=400.0, hfov_deg=80.0)
    single, exact = (
        om.view_map(SMALL, wall, viewpoint).warp_map for viewpoint in ("single", "exact")
    )
    assert np.nanmax(np.abs(single - exact)) > 0.5
    assert np.nanmax(round_trip_errors(SMALL, wall, "single")) < 0.02


def test_view_outside_the_field_raises():
    with pytest.raises(
        OutsideField, match=r"must overlap the field of the camera, .*; got the perspective view"
    ):
        om.view_map(SMALL, om.screens.Plane((64, 48), tilt_deg=89.0, hfov_deg=10.0))
