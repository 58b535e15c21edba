"""Maps of views: to the picture and back."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.dewarp.screens import parts_of
from omnimirror.dewarp.viewpoints import centre_of_projection
from omnimirror.errors import InvalidParameter, OutsideField
from omnimirror.frames import Mount
from omnimirror.interop.maps import bending
from omnimirror.interop.maps.bending import bent_pixels, ends_of
from omnimirror.mirrors.pose import MirrorPose
from tests.everyday import few

SENSOR = om.load_sensor("paper-spherical")
SMALL = replace(SENSOR, imager=replace(SENSOR.imager, width_px=128, height_px=128, pixel_pitch_um=41.6))
CAMERAS = {
    "up": SMALL,
    "down, misaligned": replace(SMALL, mount=Mount("down", 30.0), mirror_pose=MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)),
    "fisheye": om.Unified(0.9, (55.0, 55.0), (63.5, 63.5), (128, 128)),
}
VIEWS = {
    "panorama": lambda c: om.views.panorama(c, (360, None)),
    "panorama of a wall": lambda c: om.views.panorama(c, (360, None), distance_mm=900.0),
    "perspective": lambda c: om.screens.Plane((200, 150), pan_deg=140.0, tilt_deg=-20.0, roll_deg=10.0, hfov_deg=80.0),
    "near wall": lambda c: om.screens.Plane((200, 150), distance_mm=400.0, hfov_deg=80.0),
    "dome": lambda c: om.views.dome(c, (220, 220)),
    "planet": lambda c: om.views.planet(c, (220, 220)),
    "ground": lambda c: om.views.ground(c, height_mm=800.0, size=(200, 200)),
    "cube": lambda c: om.views.cube(c, (192, 128), layout="3x2"),
    "mosaic": lambda c: om.views.mosaic(c, (400, None)),
}


def there_and_back(camera, view, viewpoint="exact"):
    """How far off (px) pixels of a view are that are straightened and bent back."""
    places = om.view_map(camera, view, viewpoint).straighten
    off = []
    for left, top, screen in parts_of(view):
        width, height = screen.size
        v, u = np.mgrid[1 : height - 2 : 7, 1:width:7]
        seen = places[v + top, u + left]
        there = np.isfinite(seen).all(-1)
        rays = camera.backproject(seen[there])
        centre = centre_of_projection(camera, screen, viewpoint)
        origins = rays.origins if centre is None else np.broadcast_to(centre, rays.origins.shape)
        again = ends_of(screen, origins[rays.valid], rays.directions[rays.valid])
        pixels = np.stack([u, v], axis=-1)[there][rays.valid].astype(float)
        # by what a pixel covers there: a pole of a panorama is one point of the picture, and many of the view
        scale = np.linalg.norm(np.gradient(places[top : top + height, left : left + width], axis=1), axis=-1)
        off.append(np.linalg.norm(again - pixels, axis=-1) * np.fmin(scale[v, u][there][rays.valid], 1.0))
    return np.concatenate(off)


@pytest.mark.parametrize("camera", few(CAMERAS, "up"))
@pytest.mark.parametrize("view", VIEWS)
def test_there_and_back(view, camera):
    """What is straightened and bent back is where it was, within .02 px."""
    camera = CAMERAS[camera]
    try:
        off = there_and_back(camera, VIEWS[view](camera))
    except (OutsideField, InvalidParameter):
        pytest.skip("this camera does not see this view")
    assert len(off) > 100
    assert np.isfinite(off).mean() > 0.97  # the outermost may end beside the view, and a pole anywhere
    assert np.nanmax(off) < 0.02


@pytest.mark.parametrize("camera", CAMERAS)
def test_pixels_are_bent_to_where_the_screen_shows_them(camera):
    """By the screen's own formula and the camera's projection, with nothing between pixels."""
    camera = CAMERAS[camera]
    for view in (VIEWS["perspective"](camera), VIEWS["near wall"](camera)):
        bend = om.view_map(camera, view).bend
        rows, columns = np.nonzero(np.isfinite(bend).all(-1))
        u, v = bend[rows, columns].T
        assert len(u) > 200
        targets = np.stack(
            [view.targets_at(np.array([a]), np.array([b])).reshape(3) for a, b in zip(u[::40], v[::40], strict=True)]
        )
        seen = camera.project_directions(targets) if view.is_distant else camera.project(targets)
        assert np.abs(seen.pixels - np.stack([columns, rows], -1)[::40]).max() < 1e-5


@pytest.mark.parametrize("width", [171, 200, 360, 428])
@pytest.mark.parametrize("distance_mm", [np.inf, 900.0])
def test_what_lies_below_is_bent_back_too(width, distance_mm):
    """A pole of a panorama is one point of the picture: no hole about it, whatever its size."""
    view = om.screens.Sphere((width, width // 2), distance_mm=distance_mm)
    away, turn = np.meshgrid([0.02, 0.1, 0.3, 0.7, 1.5, 4.0], np.radians(np.arange(0.0, 360.0, 7.0)))
    pixels = 63.5 + np.stack([away * np.cos(turn), away * np.sin(turn)], axis=-1).reshape(-1, 2)
    rays = SMALL.backproject(pixels)
    ends = ends_of(view, rays.origins, rays.directions)
    assert np.isfinite(ends).all()
    looked_at = view.targets_at(ends[:, 0], ends[:, 1]) - (0.0 if view.is_distant else rays.origins)
    looked_at /= np.linalg.norm(looked_at, axis=-1, keepdims=True)
    np.testing.assert_allclose(looked_at, rays.directions, atol=1e-7)


FLAT = {
    "distant": om.screens.Plane((60, 40), pan_deg=140.0, tilt_deg=-20.0, roll_deg=10.0, hfov_deg=80.0),
    "near": om.screens.Plane((60, 40), distance_mm=400.0, hfov_deg=80.0),
    "upright": om.screens.Plane((40, 60), pan_deg=-70.0, hfov_deg=50.0),
    "part of a cylinder": om.screens.Cylinder((60, 40), -20.0, 25.0, pan_deg=30.0, span_deg=120.0),
}


@pytest.mark.parametrize("name", FLAT)
def test_rays_that_miss_a_view_end_nowhere(name):
    """Rays are drawn to places in and around the view by its own formula, and turned round."""
    view = FLAT[name]
    width, height = view.size
    at = [
        np.concatenate(
            [[-0.5 + 1e-3, -0.5 - 1e-3, side - 0.5 - 1e-3, side - 0.5 + 1e-3], np.linspace(-5, side + 5, 31)]
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
    np.testing.assert_allclose(ends_of(view, origins, directions), expected, atol=1e-6)
    assert np.isnan(ends_of(view, origins, -directions)).all()
    assert ends_of(view, origins[:0], directions[:0]).shape == (0, 2)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3)])
def test_rays_along_the_axes_of_the_frame_end_where_they_point(axis):
    x, y, z = axis
    view = om.screens.Plane((41, 31), pan_deg=-np.degrees(np.arctan2(y, x)), tilt_deg=90.0 * z, hfov_deg=60.0)
    ends = ends_of(view, np.zeros((2, 3)), np.stack([axis, -axis]))
    np.testing.assert_allclose(ends, [[20.0, 15.0], [np.nan, np.nan]], atol=1e-6)


@pytest.mark.parametrize("distance_mm", [np.inf, 900.0])
def test_rays_on_both_sides_of_a_seam_end_at_their_own_side(distance_mm):
    view = om.screens.Cylinder((90, 40), -40.0, 30.0, distance_mm=distance_mm)
    u, v = (a.ravel() for a in np.meshgrid([-0.499, -0.3, 0.0, 0.2, 45.0, 88.8, 89.0, 89.3, 89.499], [0.0, 20.0, 39.0]))
    origins = np.random.default_rng(4).uniform(-20.0, 20.0, (len(u), 3))
    directions = view.targets_at(u, v).reshape(-1, 3) - (0.0 if view.is_distant else origins)
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    np.testing.assert_allclose(ends_of(view, origins, directions), np.stack([u, v], axis=-1), atol=1e-6)


def test_every_pixel_is_bent_and_alone_as_among_others(monkeypatch):
    """A fisheye sees to its corners, the first pixel too; rays are taken in several stretches."""
    camera = om.Unified(0.9, (55.0, 55.0), (31.5, 23.5), (64, 48), optics="fisheye")
    view = om.screens.Sphere((180, 90))
    whole = bent_pixels(camera, view, "exact")
    assert np.isfinite(whole).all()
    monkeypatch.setattr(bending, "AT_ONCE", 1000)
    np.testing.assert_allclose(bent_pixels(camera, view, "exact"), whole, atol=1e-6)


def test_all_of_a_view_comes_back():
    """No holes: a panorama all around covers the whole ring of the picture, its seam too."""
    fixed = om.view_map(SMALL, om.views.panorama(SMALL, (360, None)))
    rays = SMALL.backproject(np.stack(np.meshgrid(np.arange(128), np.arange(128)), -1).reshape(-1, 2).astype(float))
    low, high = fixed.view.tilt_min_deg, fixed.view.tilt_max_deg
    tilt = np.degrees(np.arcsin(rays.directions[:, 2]))
    inside = rays.valid & (tilt > low + 1.5) & (tilt < high - 0.5)
    assert np.isfinite(fixed.bend).all(-1).ravel()[inside].all()


def test_a_single_viewpoint_is_kept():
    wall = om.screens.Plane((200, 150), distance_mm=400.0, hfov_deg=80.0)
    single, exact = (om.view_map(SMALL, wall, viewpoint).bend for viewpoint in ("single", "exact"))
    assert np.nanmax(np.abs(single - exact)) > 0.5
    assert np.nanmax(there_and_back(SMALL, wall, "single")) < 0.02


def test_a_view_that_sees_nothing_is_refused():
    with pytest.raises(OutsideField, match=r"the perspective view .* sees nothing of the camera's field"):
        om.view_map(SMALL, om.screens.Plane((64, 48), tilt_deg=89.0, hfov_deg=10.0))
