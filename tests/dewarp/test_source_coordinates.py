"""Interpolated coordinates against the projection of every pixel, over random sensors and views."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import omnimirror as om
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp._source_coordinates import (
    exact_pixels,
    lattice_map,
    lattice_map_of,
    screen_pixels,
)
from omnimirror.dewarp.screens import (
    CubeMap,
    Cylinder,
    DomeMaster,
    Equirectangular,
    Ground,
    LittlePlanet,
    Plane,
    parts_of,
)
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Perspective
from tests.conftest import MIRRORS
from tests.everyday import few

BUNDLED = ("paper-spherical", "paper-hyperboloidal", "paraboloid-telecentric")


def random_camera(rng: np.random.Generator) -> Any:
    """Return a mirror sensor of any kind, or a ball, with 1000 or 4096 pixels and a random mount."""
    pixels = int(rng.choice([1000, 4096]))
    mount = Mount(
        str(rng.choice(["up", "down", "forward"])), rng.uniform(-180, 180), bool(rng.integers(2))
    )
    kind = str(rng.choice([*MIRRORS, *BUNDLED, "ball"]))
    if kind == "ball":
        return om.MirrorBall(
            centre_px=(pixels / 2, pixels / 2),
            rim_radius_px=pixels * 0.48,
            field_deg=rng.uniform(180, 340),
            image_size=(pixels, pixels),
            mount=mount,
        )
    if kind in BUNDLED:
        return replace(
            om.load_sensor(kind), imager=Imager(pixels, pixels, 5.2 * 1024 / pixels), mount=mount
        )
    mirror, m = MIRRORS[kind]
    return om.Sensor(
        mirror, Perspective(11.6, 4.0, 210.0), Imager(pixels, pixels, 5400 / pixels), mount, m
    )


def random_screen(rng: np.random.Generator) -> Any:
    """Return a view of random shape, width, position and (small) size, distant or near."""
    size = tuple(int(n) for n in rng.choice([1, 7, 33, 120, 321, 500], 2))
    distance = float(rng.choice([np.inf, np.inf, 150.0, 400.0, 3000.0]))
    offset_mm = (0.0, 0.0, 0.0) if np.isinf(distance) else tuple(rng.uniform(-60, 60, 3))
    position = {"distance_mm": distance, "offset_mm": offset_mm}
    pan, tilt, roll = rng.uniform(-180, 180), rng.uniform(-90, 60), rng.uniform(-180, 180)
    match rng.integers(7):
        case 0:
            return Plane(size, pan, tilt, roll, rng.uniform(5, 120), **position)
        case 1:
            return Plane(size, pan, tilt, roll, rng.uniform(120, 170), **position)
        case 2:
            return Cylinder(
                size,
                rng.uniform(-90, -10),
                rng.uniform(0, 60),
                pan,
                rng.uniform(20, 360),
                **position,
            )
        case 3:
            return Equirectangular(size, pan_deg=pan, **position)
        case 4:
            return DomeMaster(
                size, rng.uniform(60, 180), str(rng.choice(["nadir", "zenith"])), pan, **position
            )
        case 5:
            return LittlePlanet(size, rng.uniform(100, 300), "nadir", pan, **position)
        case _:
            return Ground(size, rng.uniform(-900, -150), rng.uniform(1, 20))


@pytest.mark.parametrize("seed", few(range(0, 120, 10), 30))
def test_random_views_match_exact_coordinates(seed):
    for s in range(seed, seed + 10):
        rng = np.random.default_rng(s)
        camera, screen = random_camera(rng), random_screen(rng)
        exact, quick = exact_pixels(camera, screen), screen_pixels(camera, screen)
        np.testing.assert_array_equal(
            np.isnan(quick), np.isnan(exact), err_msg=f"seed {s}: {screen}"
        )
        if np.isnan(exact).all():
            continue
        limit = 0.005 if camera.image_size[0] <= 1000 else 0.01
        assert np.nanmax(np.abs(quick - exact)) < limit, f"seed {s}: {screen}"


def error_of_parts(camera, view) -> float:
    """Return the largest distance (px) of map coordinates from the projection, at every seventh
    pixel."""
    worst = 0.0
    for part in parts_of(view):
        width, height = part.screen.size
        u, v = np.arange(0, width, 7), np.arange(0, height)
        exact = camera.project(
            part.screen.targets_at(u.astype(float), v[:, None].astype(float)).reshape(-1, 3)
        ).pixels
        quick = screen_pixels(camera, part.screen)[:, u].reshape(-1, 2)
        worst = max(worst, np.nanmax(np.linalg.norm(quick - exact, axis=1), initial=0.0))
    return worst


def test_cancelling_errors_are_detected():
    """Close to a displaced cube, both directions have errors while the cell centre is exact."""
    view = CubeMap((640, 480), distance_mm=300.0, offset_mm=(200.0, 100.0, 50.0))
    assert error_of_parts(om.load_sensor("paper-spherical"), view) < 0.005


@pytest.mark.parametrize("seed", range(6))
def test_random_offset_cubes_match_exact_coordinates(seed):
    rng = np.random.default_rng(seed)
    camera, side = random_camera(rng), int(rng.integers(60, 200))
    distance = np.exp(rng.uniform(np.log(100), np.log(1500)))
    offset = tuple(rng.uniform(-0.7, 0.7, 3) * min(distance, 400.0))
    view = CubeMap((3 * side, 2 * side), "3x2", rng.uniform(-180, 180), distance, offset)
    assert error_of_parts(camera, view) < (0.005 if camera.image_size[0] <= 1000 else 0.01)


@pytest.mark.parametrize(
    ("tilt_deg", "step"),
    [(-30.0, 32), pytest.param(30.0, 16, id="view across the field boundary")],
)
def test_large_views_use_coarse_lattice_within_the_field(tilt_deg, step):
    sensor = om.load_sensor("paper-spherical")
    view = Plane((1280, 720), tilt_deg=tilt_deg, hfov_deg=80.0)
    assert lattice_map_of(sensor, view).step == step
    error = np.abs(screen_pixels(sensor, view) - exact_pixels(sensor, view))
    assert np.nanmax(error) < 0.005


def test_number_of_projections():
    """A view of 250,000 pixels, all inside the field, requires about 1 projection per 100 pixels."""
    sensor = om.load_sensor("paper-spherical")
    count = 0

    def count_projections(u, v):
        nonlocal count
        count += np.broadcast(u, v).size
        return sensor.project_directions(
            Plane((640, 400), tilt_deg=-10, hfov_deg=70).targets_at(u, v)
        ).pixels

    lattice_map(count_projections, (640, 400), sensor.image_size)
    assert count < 0.015 * 640 * 400


def test_field_smaller_than_cell():
    """The whole sphere in 40 x 20 pixels: the field of a camera covers only a few of them."""
    ball = om.MirrorBall(
        centre_px=(500.0, 500.0), rim_radius_px=450.0, field_deg=30.0, image_size=(1001, 1001)
    )
    view = Equirectangular((40, 20))
    quick, exact = screen_pixels(ball, view), exact_pixels(ball, view)
    assert np.isfinite(exact).any()
    np.testing.assert_allclose(quick, exact, atol=2e-4)


@pytest.mark.parametrize("size", [(1, 500), (7, 120), (500, 3), (40, 20)])
def test_small_views_are_exact(size):
    """Neighbouring nodes of such views can be far apart, which precludes interpolation."""
    ball = om.MirrorBall(
        centre_px=(2048.0, 2048.0), rim_radius_px=1966.0, field_deg=258.8, image_size=(4096, 4096)
    )
    for view in (
        LittlePlanet(size, 231.0),
        Cylinder(size, -86.0, 28.0, distance_mm=400.0, offset_mm=(-41.0, 1.0, -60.0)),
    ):
        quick, exact = screen_pixels(ball, view), exact_pixels(ball, view)
        assert np.isfinite(exact).any()
        np.testing.assert_allclose(quick, exact, atol=5e-4)


def test_cells_outside_field_are_not_projected():
    """Half of the view is sky outside the field of the sensor; the boundary is accurate."""
    sensor = om.load_sensor("paper-spherical")
    view = Plane((1280, 720), tilt_deg=45, hfov_deg=90)
    grid = lattice_map_of(sensor, view)
    assert len(grid.patches) < 0.2 * grid.cells.size < 0.5 * (grid.cells >= 0).sum()
    np.testing.assert_array_equal(np.isnan(grid.pixels()), np.isnan(exact_pixels(sensor, view)))
