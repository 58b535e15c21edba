"""Tubes and domes in chief rays, images and projection, against an independent tracer.

Surfaces are implicit functions here: a ray intersects one at a sign change, and the normal is a
difference quotient.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.optimize import brentq, root

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, SelfObstruction
from omnimirror.base.native import backend
from omnimirror.dewarp._source_coordinates import source_pixels
from omnimirror.optics.housing import Dome, FlatWindow, Housing, Tube
from omnimirror.optics.materials import MATERIALS
from omnimirror.optics.mirrors import SlopeSpline
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.tracing import optical_train as covered_mirror
from omnimirror.optics.tracing.reflection import RayEndpoints
from omnimirror.optics.tracing.shell_transmission import shell_exit_compiled, shell_exit_numpy
from omnimirror.simulation.pixel_rays import trace_pixels
from tests.everyday import few

SPH = om.load_sensor("paper-spherical")
HYP = om.load_sensor("paper-hyperboloidal")
TELECENTRIC = om.load_sensor("paraboloid-telecentric")
COVERS = {
    "tube": (SPH, Tube(110.0, 4.0)),
    "tube in water": (SPH, Tube(110.0, 4.0, material="polycarbonate", medium="water")),
    "dome": (HYP, Dome(360.0, 6.0, material="acrylic")),
    "dome in oil": (SPH, Dome(340.0, 5.0, medium="mineral_oil")),
    "dome of two centres": (SPH, Dome(340.0, 5.0, inner_shift_mm=2.0)),
    "high dome": (SPH, Dome(310.0, 5.0, centre_mm=-40.0)),
    "telecentric dome": (TELECENTRIC, Dome(130.0, 3.0, centre_mm=-20.0, medium_index=1.2)),
}
NARROW = replace(SPH, mirror=replace(SPH.mirror, rim_radius_mm=28.0))  # field to 81 deg
COVERS |= {
    "window": (NARROW, FlatWindow(wall_mm=6.0, material="bk7")),
    "window to water": (
        NARROW,
        FlatWindow(wall_mm=6.0, material="acrylic", medium="water", height_mm=-200.0),
    ),
}
MISALIGNED = {
    "tilted tube": (SPH, Tube(110.0, 4.0, tilt_x_deg=1.5, decentre_y_mm=0.7), MirrorPose()),
    "tilted tube in water": (SPH, Tube(112.0, 4.0, medium="water", tilt_y_deg=-1.0), MirrorPose()),
    "decentred dome": (
        SPH,
        Dome(340.0, 5.0, inner_shift_mm=1.0, decentre_x_mm=3.0, tilt_y_deg=4.0),
        MirrorPose(),
    ),
    "tilted window": (
        NARROW,
        FlatWindow(wall_mm=6.0, medium="sea_water", tilt_x_deg=2.0),
        MirrorPose(0.4),
    ),
    "mirror out of place": (
        HYP,
        Dome(360.0, 6.0, medium="water"),
        MirrorPose(1.0, -0.6, 0.4, 0.5, -0.8),
    ),
}
INNER_PIXELS = 511.5 + np.array(
    [[0.0, 180.0], [210.0, -60.0], [-190.0, 130.0], [20.0, 260.0], [-150.0, -190.0]]
)
PIXELS = 511.5 + np.array(
    [[0.0, 180.0], [240.0, -60.0], [-310.0, 130.0], [20.0, 400.0], [-330.0, -330.0]]
)


def covered(name):
    if name in COVERS:
        sensor, shell = COVERS[name]
        return replace(sensor, housing=Housing(shell=shell))
    sensor, shell, pose = MISALIGNED[name]
    return replace(sensor, housing=Housing(shell=shell), mirror_pose=pose)


@pytest.mark.parametrize("name", few(COVERS, "tube", "dome in oil"))
def test_points_inside_cover_or_off_ray_rejected(name):
    meridian = covered(name).meridian
    x = np.linspace(0.3, 0.9, 5) * meridian.mirror.rim_radius_mm
    rays = meridian.trace(x)
    (start_x, start_z), sin, cos = rays.start, np.sin(rays.omega), np.cos(rays.omega)
    for further, aside, is_on in (
        (50, 0, True),
        (0, 0, True),
        (50, 0.01, False),
        (50, -0.01, False),
        (-0.1, 0, False),
    ):
        along = rays.outside.reach + further
        at = start_x + along * sin + aside * cos, start_z - along * cos + aside * sin
        assert meridian.cover.leads_to(rays, *at).tolist() == [is_on] * len(x), (further, aside)


# -- reference, in the camera frame
# -----------------------------------------------------------------------


def turning(x_deg, y_deg):
    a, b = np.radians([x_deg, y_deg])
    about_x = np.array([[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]])
    about_y = np.array([[np.cos(b), 0, np.sin(b)], [0, 1, 0], [-np.sin(b), 0, np.cos(b)]])
    return about_y @ about_x


def surfaces(sensor):
    """Return the mirror and both sides of the cover as functions of a point, each with the index
    behind it."""
    pose, shell = sensor.mirror_pose, sensor.obstructions.housing.shell
    turn = turning(pose.tilt_x_deg, pose.tilt_y_deg)
    moved = np.array([pose.decentre_x_mm, pose.decentre_y_mm, pose.displacement_mm])

    def mirror(p):
        x, y, z = turn.T @ (p - moved)
        return z - float(sensor.mirror.sag(np.hypot(x, y)))

    rotation = turning(shell.tilt_x_deg, shell.tilt_y_deg)
    shift = np.array([shell.decentre_x_mm, shell.decentre_y_mm, 0.0])
    wall = MATERIALS[shell.material].index_d if shell.material else shell.refractive_index
    around = MATERIALS[shell.medium].index_d if shell.medium else shell.medium_index

    def pane(height):
        return lambda p: height - (rotation.T @ (p - shift))[2]

    if isinstance(shell, FlatWindow):
        return (
            mirror,
            (pane(shell.height_mm), wall),
            (pane(shell.height_mm - shell.wall_mm), around),
        )
    outer = shell.diameter_mm / 2

    def side(radius, centre):
        def inside_out(p):
            x, y, z = rotation.T @ (p - shift)
            return (
                np.hypot(x, y) - radius
                if isinstance(shell, Tube)
                else np.linalg.norm([x, y, z - centre]) - radius
            )

        return inside_out

    centre = 0.0 if isinstance(shell, Tube) else shell.centre_mm
    lift = 0.0 if isinstance(shell, Tube) else shell.inner_shift_mm
    return (
        mirror,
        (side(outer - shell.wall_mm, centre + lift), wall),
        (side(outer, centre), around),
    )


def intersection(surface, start, direction, first, last):
    """Return the first point of a ray at which a function changes sign from negative."""
    steps = np.linspace(first, last, 801)
    i = next(i for i, s in enumerate(steps) if surface(start + s * direction) > 0)
    assert i > 0
    position = (
        start
        + brentq(
            lambda s: surface(start + s * direction), steps[i - 1], steps[i], xtol=1e-13, rtol=1e-15
        )
        * direction
    )
    normal = np.array(
        [surface(position + 1e-4 * e) - surface(position - 1e-4 * e) for e in np.eye(3)]
    )
    return position, normal / np.linalg.norm(normal)


def traced(sensor, start, direction):
    """Return the exit point and direction of a ray from the lens behind the cover."""
    mirror, *walls = surfaces(sensor)
    position, normal = intersection(mirror, start, direction, 1e-3, 3 * np.linalg.norm(start) + 50)
    direction = direction - 2 * (direction @ normal) * normal
    index = 1.0
    for surface, behind in walls:
        position, normal = intersection(surface, position, direction, 1e-6, 1000.0)
        across = (direction - (direction @ normal) * normal) * index / behind
        direction, index = across + np.sqrt(1 - across @ across) * normal, behind
    return position, direction


def lens_ray(sensor, pixel):
    image = (np.asarray(pixel) - 511.5) * sensor.imager.pixel_pitch_um * 1e-3
    if sensor.lens.TELECENTRIC:
        return np.array([*(image / sensor.lens.magnification), -30.0]), np.array([0.0, 0.0, 1.0])
    direction = np.array([*image, sensor.lens.image_distance])
    return np.array([0.0, 0.0, -sensor.mirror_distance_mm]), direction / np.linalg.norm(direction)


def truth(sensor, pixel):
    return traced(sensor, *lens_ray(sensor, pixel))


@pytest.mark.parametrize("name", [*COVERS, *MISALIGNED])
def test_covered_sensor_projection_round_trip(name):
    sensor = covered(name)
    turn = sensor.mount.rotation()
    pixels = INNER_PIXELS if "window" in name else PIXELS
    origins, directions, valid = sensor.backproject(pixels)
    assert valid.all()
    for pixel, origin, direction in zip(pixels, origins, directions, strict=True):
        exit_point, exit_direction = truth(sensor, pixel)
        origin_in_mirror, direction_in_mirror = turn.T @ origin, turn.T @ direction
        assert np.linalg.norm(direction_in_mirror - exit_direction) < 2e-9
        assert np.linalg.norm(origin_in_mirror - exit_point) < 1e-6
        points = np.array([turn @ (exit_point + s * exit_direction) for s in (30.0, 5000.0)])
        projection = sensor.project(points)
        assert projection.valid.all()
        assert np.abs(projection.pixels - pixel).max() < 1e-5
        assert (
            np.abs(sensor.project_directions([turn @ exit_direction]).pixels - pixel).max() < 1e-5
        )


@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
@pytest.mark.parametrize(
    "name", few(["tilted tube", "decentred dome", "mirror out of place"], "tilted tube")
)
def test_compiled_solution_needs_one_verification_ray(monkeypatch: pytest.MonkeyPatch, name):
    """It verifies the result of a kernel that interpolates the mirror in a table."""
    sensor, traced = covered(name), []
    pixels = 511.5 + 300 * np.random.default_rng(5).uniform(-1, 1, (2000, 2))
    rays = sensor.backproject(pixels)
    is_valid, shell_exit = rays.valid, covered_mirror.shell_exit
    monkeypatch.setattr(
        covered_mirror,
        "shell_exit",
        lambda shell, p, d: traced.append(len(p)) or shell_exit(shell, p, d),
    )
    projection = sensor.project_directions(rays.directions[is_valid])
    assert projection.valid.all()
    np.testing.assert_allclose(projection.pixels, pixels[is_valid], atol=1e-6)
    assert is_valid.sum() > 1000
    assert sum(traced) < 1.5 * is_valid.sum()


START_CASES = {name: covered(name) for name in ("tilted tube", "decentred dome")} | {
    "bare": replace(HYP, mirror_pose=MirrorPose(1.0, -0.6, 0.4, 0.5, -0.8)),
    "seen in a second mirror": om.load_sensor("folded-hyperboloidal"),
}


@pytest.mark.parametrize("name", START_CASES)
def test_ray_origins_match_image_rays(name):
    """Solved from outside, and traced from inside."""
    train = START_CASES[name].optical_train
    directions = np.random.default_rng(9).normal(size=(900, 3))
    image, start = train.image_and_start_of(RayEndpoints.of(directions, distant=True))
    is_visible = np.isfinite(image[:, 0])
    assert is_visible.sum() > 200
    reflection = train.effective_mirror.trace(*train.rays_of_image(image[is_visible], np.zeros(2)))
    assert np.abs(reflection.points - start[is_visible]).max() < 1e-7


POINTED_SENSOR = replace(SPH, mirror=SlopeSpline((0.2, 0.42, 0.7, 1.1, 1.9), 44.0))
SEARCHED = {
    name: covered(name) for name in (*MISALIGNED, "dome of two centres", "telecentric dome")
} | {
    "pointed, tube in water": replace(
        POINTED_SENSOR,
        housing=Housing(shell=Tube(120.0, medium="water")),
        mirror_pose=MirrorPose(0.7, -0.4, 0.5, 0.8, -0.5),
    ),
    "pointed, dome": replace(
        POINTED_SENSOR,
        housing=Housing(shell=Dome()),
        mirror_pose=MirrorPose(1.5, 1.0, 0.0, 2.0, 1.0),
    ),
}


@pytest.mark.skipif(not backend.is_compiled, reason="nothing is compiled here")
@pytest.mark.parametrize("name", SEARCHED)
def test_kernels_match_numpy(monkeypatch: pytest.MonkeyPatch, name):
    """Near and far targets all around; if a kernel does not converge, NumPy does not either."""
    directions = np.random.default_rng(6).normal(size=(1500, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]
    near = directions * np.random.default_rng(7).uniform(400, 4000, (1500, 1))

    def evaluate():
        sensor = replace(SEARCHED[name])
        return sensor.project_directions(directions), sensor.project(near)

    by_kernels = evaluate()
    monkeypatch.setattr(covered_mirror.CoveredMirror, "_is_compiled", False)
    for compiled, plain in zip(by_kernels, evaluate(), strict=True):
        assert compiled.valid.sum() > (200 if "window" in name else 700)
        both = compiled.valid & plain.valid
        np.testing.assert_allclose(compiled.pixels[both], plain.pixels[both], atol=1e-8)
        assert not (plain.valid & ~compiled.valid).any()
        assert (compiled.valid & ~plain.valid).sum() <= 0.01 * compiled.valid.sum()


@pytest.mark.parametrize("name", [name for name in SEARCHED if "pointed" in name])
def test_pointed_mirror_tip_projection(name):
    """Rays from pixels near the tip lead to directions that are observed there."""
    sensor = SEARCHED[name]
    about = np.random.default_rng(8).normal(size=(400, 2))
    pixels = sensor.imager.centre + 30 * about / np.linalg.norm(about, axis=1)[:, None]
    rays = sensor.backproject(pixels)
    assert rays.valid.sum() > 200
    projection = sensor.project_directions(rays.directions[rays.valid])
    assert np.abs(projection.pixels - pixels[rays.valid]).max() < 1e-5


@pytest.mark.parametrize(
    ("name", "distance"),
    few(
        product(
            ["tube in water", "dome", "dome in oil", "high dome", "window to water"],
            [np.inf, 500.0],
        ),
        ("tube in water", 500.0),
        ("dome", np.inf),
    ),
)
def test_virtual_images_behind_cover_match_rays(name, distance):
    """Rays from both sides of the pupil, aimed by the reference tracer at one object; tangential,
    then sagittal."""
    sensor = covered(name)
    h = 260.0 if "window" in name else 330.0
    table = om.evaluate(sensor, h_px=[h], object_distance_mm=distance)
    start, chief_direction = lens_ray(sensor, [511.5 + h, 511.5])
    chief_exit, out = traced(sensor, start, chief_direction)
    bounce = intersection(surfaces(sensor)[0], start, chief_direction, 1e-3, 400.0)[0]
    mirror, *walls = surfaces(sensor)
    normal = intersection(mirror, start, chief_direction, 1e-3, 400.0)[1]
    wall_point = intersection(
        walls[0][0], bounce, chief_direction - 2 * (chief_direction @ normal) * normal, 1e-6, 1000.0
    )[0]
    inside = np.linalg.norm(wall_point - bounce) + np.linalg.norm(chief_exit - wall_point)
    target = chief_exit + (distance - inside) * out if np.isfinite(distance) else None

    def direction_error(across, pupil):
        direction = np.array([*(chief_direction[:2] / chief_direction[2] + across), 1.0])
        exit_point, exit_direction = traced(sensor, pupil, direction / np.linalg.norm(direction))
        expected = (
            out if target is None else (target - exit_point) / np.linalg.norm(target - exit_point)
        )
        return (exit_direction - expected)[[0, 1] if abs(out[2]) > 0.5 else [1, 2]]

    for axis, distances in ((0, table.distance_t_mm), (1, table.distance_s_mm)):
        step = 0.02 * np.eye(3)[axis]
        aims = []
        for side in (1, -1):
            pupil_point = start + side * step
            initial_aim = -side * 0.02 / distances[0] * np.eye(2)[axis]
            aims.append(
                root(
                    direction_error,
                    initial_aim,
                    (pupil_point,),
                    options={"xtol": 1e-10, "eps": 1e-9},
                ).x[axis]
            )
        assert 2 * 0.02 / (aims[1] - aims[0]) == pytest.approx(distances[0], rel=3e-5)


@pytest.mark.parametrize(
    "shell", [Tube(110.0, refractive_index=1.0), Dome(340.0, 5.0, refractive_index=1.0)]
)
def test_air_wall_has_no_effect(shell):
    bare, clear = SPH, replace(SPH, housing=Housing(shell=shell))
    for distance in (np.inf, 400.0):
        a, b = (om.evaluate(s, object_distance_mm=distance).columns() for s in (bare, clear))
        for column in a:
            np.testing.assert_allclose(b[column], a[column], rtol=1e-9, atol=1e-9, err_msg=column)
    # the base of the dome, a disc of 127 mm at the lens, obscures field angles below 40 deg
    a, b = (om.spots(s, [45.0, 90.0], object_distance_mm=500.0) for s in (bare, clear))
    np.testing.assert_allclose(b.t_px, a.t_px, atol=1e-8)
    np.testing.assert_allclose(b.weights, a.weights, rtol=1e-4)


@pytest.mark.parametrize("name", ["tube", "dome in oil", "decentred dome"])
def test_views_and_images_use_equal_rays(name):
    sensor = covered(name)
    screen = om.screens.Plane((60, 40), tilt_deg=10.0, hfov_deg=70.0)
    quick, exact = (source_pixels(sensor, screen, exact=e) for e in (False, True))
    both = np.isfinite(quick).all(axis=-1) & np.isfinite(exact).all(axis=-1)
    assert both.mean() > 0.5
    assert np.abs(quick - exact)[both].max() < 5e-3
    view_rays, image_rays = sensor.backproject(PIXELS), trace_pixels(sensor, PIXELS)
    np.testing.assert_allclose(image_rays.directions, view_rays.directions, atol=1e-12)
    np.testing.assert_allclose(image_rays.origins, view_rays.origins, atol=1e-9)


def test_water_tube_field_starts_at_base():
    sensor = covered("tube in water")
    low, high = sensor.field_deg
    x = sensor.meridian.x_min
    rays = sensor.meridian.trace([x])
    wall = rays.z - (51.0 - x) / np.tan(rays.reflected)
    assert wall[0] == pytest.approx(-sensor.mirror_distance_mm, abs=1e-6)
    assert np.cos(np.radians(low)) == pytest.approx(
        np.cos(rays.reflected[0]) / MATERIALS["water"].index_d, abs=1e-12
    )
    assert high < SPH.field_deg[1]


def test_window_field_limits():
    window = FlatWindow(120.0, medium="water")
    sensor = replace(NARROW, housing=Housing(shell=window))
    (ring,) = sensor.obscurations
    assert ring.part == "window's frame"
    assert ring.omega_deg[1] == pytest.approx(sensor.field_deg[1])
    x = sensor.meridian.x_from_omega(np.radians([ring.omega_deg[0]]))
    rays = sensor.meridian.trace(x)
    inner = -sensor.mirror_distance_mm - 5.0
    assert x[0] + (rays.z[0] - inner) * np.tan(rays.reflected[0]) == pytest.approx(60.0, abs=1e-6)
    assert np.sin(rays.omega[0]) == pytest.approx(
        np.sin(rays.reflected[0]) / MATERIALS["water"].index_d, abs=1e-12
    )
    white = om.Environment(np.ones((4, 8, 3), np.float32))
    light = om.expose(sensor, white, samples=1)[512, 512:, 0]
    assert (light > 0.5).sum() == pytest.approx(sensor.image_height_px(rays)[0], abs=1.5)
    with pytest.raises(
        SelfObstruction, match="must be directed back past the lens to pass the window"
    ):
        om.evaluate(replace(SPH, housing=Housing(shell=FlatWindow())))
    with pytest.raises(
        InvalidParameter, match="a window between lens and mirror is in the optical path twice"
    ):
        om.evaluate(replace(NARROW, housing=Housing(shell=FlatWindow(height_mm=-50.0))))


def test_invalid_covers_rejected():
    with pytest.raises(
        InvalidParameter, match=r"material must not both be given; got 1.5 and 'bk7'"
    ):
        Tube(110.0, refractive_index=1.5, material="bk7")
    with pytest.raises(InvalidParameter, match="medium must not both be given"):
        Dome(medium="water", medium_index=1.3)
    with pytest.raises(
        InvalidParameter,
        match="material must be one of air, acrylic, polycarbonate, bk7, fused_silica, sapphire, water, s",
    ):
        Tube(material="jelly")
    with pytest.raises(InvalidParameter, match=r"object_distance_mm must be greater than \d"):
        om.evaluate(covered("dome"), [90.0], object_distance_mm=20.0)
    with pytest.raises(InvalidParameter, match="the cover of 'paper-spherical' must be aligned"):
        om.evaluate(covered("tilted tube"))
    enclosed = Dome(
        1040.0, 240.0, 2.4, centre_mm=-240.0, inner_shift_mm=235.0
    )  # 240/520 of the radius, times 2.4
    with pytest.raises(SelfObstruction, match="are totally reflected at its outer surface"):
        om.evaluate(replace(SPH, housing=Housing(shell=enclosed)))


# -- materials ----------------------------------------------------------------------------------------------


def sellmeier(*terms):
    return lambda um: np.sqrt(1 + sum(b * um**2 / (um**2 - c) for b, c in terms))


def quan_fry(salinity, t=20.0):
    def n(um):
        nm = um * 1e3
        salinity_term = (1.779e-4 - 1.05e-6 * t + 1.6e-8 * t**2) * salinity
        return (
            1.31405
            + salinity_term
            - 2.02e-6 * t**2
            + (15.868 + 0.01155 * salinity - 0.00423 * t) / nm
            - 4382 / nm**2
            + 1.1455e6 / nm**3
        )

    return n


PUBLISHED = {
    "bk7": sellmeier(
        (1.03961212, 0.00600069867), (0.231792344, 0.0200179144), (1.01046945, 103.560653)
    ),
    "fused_silica": sellmeier(
        (0.6961663, 0.0684043**2), (0.4079426, 0.1162414**2), (0.8974794, 9.896161**2)
    ),
    "sapphire": sellmeier(
        (1.4313493, 0.0726631**2), (0.65054713, 0.1193242**2), (5.3414021, 18.028251**2)
    ),
    "water": quan_fry(0.0),
    "sea_water": quan_fry(35.0),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_material_indices_match_literature(name):
    material, n = MATERIALS[name], PUBLISHED[name]
    assert material.index_d == pytest.approx(n(0.58756), abs=1e-4)
    assert material.abbe_number == pytest.approx(
        (n(0.58756) - 1) / (n(0.48613) - n(0.65627)), rel=2e-3
    )
    for um in (0.45, 0.55, 0.7):
        assert material.index_at(1e3 * um) == pytest.approx(n(um), abs=3e-4)
    tube = Tube(material=name).at_wavelength(450.0)
    assert tube.index == material.index_at(450.0)


@pytest.mark.skipif(not backend.is_compiled, reason="not built")
@pytest.mark.parametrize("name", COVERS)
def test_compiled_walls_match_numpy(name):
    """Rays from inside and outside, along the axis, from the wrong side: to the last digits, with
    equal validity."""
    shell, rng = covered(name).obstructions.housing.shell, np.random.default_rng(5)
    reach = 70.0 if "window" in name else 1.2 * shell.radii_mm[0]
    points, directions = rng.uniform(-reach, reach, (3000, 3)), rng.normal(size=(3000, 3))
    directions[:40] = [[0, 0, 1], [0, 0, -2]] * 20
    directions[40] = 0.0, np.nan, 1.0
    with np.errstate(all="ignore"):
        exits = [
            result(shell, points, directions) for result in (shell_exit_compiled, shell_exit_numpy)
        ]
    for kind in ("meets", "passes"):
        np.testing.assert_array_equal(*(getattr(result, kind) for result in exits))
    out = exits[0].passes & exits[0].meets
    assert 300 < out.sum() < 2700
    for one, other in zip(
        *(result[:5] + result.lengths + result.cosines for result in exits), strict=True
    ):
        np.testing.assert_allclose(one[out], other[out], rtol=0, atol=1e-11)
    free = exits[0].passes & ~exits[0].meets
    np.testing.assert_array_equal(exits[0].points[free], points[free])
    assert not exits[0].lengths[0][free].any()
