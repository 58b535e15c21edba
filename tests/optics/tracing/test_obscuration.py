"""Obscurations of a housing: reported rings and pixels against rays marched through the parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rim, Rod, Tube
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.everyday import few

SPH = om.load_sensor("paper-spherical")
M, LENS = SPH.mirror.rim_radius_mm, -SPH.mirror_distance_mm
RIM = SPH.mirror.radius_mm - np.sqrt(SPH.mirror.radius_mm**2 - M**2)
EDGE_DEG = 0.005
STEPS = np.linspace(0.0, 1.0, 20_001)[1:]

# each housing with its solids written explicitly: discs (height, inner and outer radius), rods
# (heights, radii)
BACK_EDGE = RIM + 5.0
HOUSINGS = {
    "camera": (Housing(CameraBody(60.0, height_mm=4.0)), [("camera", LENS + 4.0, 0.0, 30.0)], []),
    "rod": (Housing(rod=Rod(6.0, 2.0, gap_mm=45.0)), [], [("rod", LENS + 45.0, 0.0, 3.0, 1.0)]),
    "wide rod": (Housing(rod=Rod(3.0, 16.0)), [], [("rod", 0.75 * LENS, 0.0, 1.5, 8.0)]),
    "tube": (
        Housing(shell=Tube(130.0)),
        [("tube's base", LENS, 0.0, 62.0), ("tube's cap", BACK_EDGE, M, 62.0)],
        [],
    ),
    "dome": (
        Housing(shell=Dome(250.0, centre_mm=-80.0)),
        [("dome's base", LENS, 0.0, np.sqrt(122.0**2 - (LENS + 80.0) ** 2))],
        [],
    ),
    "rim": (Housing(rim=Rim(10.0, setback_mm=0.5)), [("rim", RIM + 0.5, M, M + 10.0)], []),
    "all": (
        Housing(CameraBody(70.0), Rod(4.0, gap_mm=60.0), Tube(130.0), Rim(3.0)),
        [
            ("camera", LENS, 0.0, 35.0),
            ("tube's base", LENS, 0.0, 62.0),
            ("tube's cap", BACK_EDGE, M + 3.0, 62.0),
            ("rim", RIM, M, M + 3.0),
        ],
        [("rod", LENS + 60.0, 0.0, 2.0, 2.0)],
    ),
}


def points_along(start, direction, length):
    """Return points (k, 3) along a ray with a spacing below 0.05 mm."""
    return start + length * STEPS[:, None] * direction / np.linalg.norm(direction)


def crosses(leg, height, inner, outer):
    """Check if points (k, 3) along a ray pass a height between two radii."""
    z, r = leg[:, 2], np.hypot(leg[:, 0], leg[:, 1])
    (at,) = np.nonzero(np.diff(np.sign(z - height)))
    radii = r[at] + (height - z[at]) / (z[at + 1] - z[at]) * (r[at + 1] - r[at])
    return bool(((inner < radii) & (radii < outer)).any())


def parts_hit(discs, rods, point, out, lens):
    """Return the names of obstructions between mirror point and lens, or along the exit ray."""
    legs = (
        points_along(point, out, 900.0),
        points_along(point, lens - point, np.linalg.norm(lens - point)),
    )
    names = {name for name, height, inner, outer in discs if crosses(legs[0], height, inner, outer)}
    for name, foot, top, low, high in rods:
        for leg in legs:
            inside = (leg[:, 2] > foot) & (leg[:, 2] < top)
            radius = low + (high - low) * (leg[:, 2] - foot) / (top - foot)
            if (inside & (np.hypot(leg[:, 0], leg[:, 1]) < radius)).any() or crosses(
                leg, foot, 0.0, low
            ):
                names.add(name)
    return names


def parts_on_path(sensor, discs, rods, omega_deg):
    """Return the obstructions of a field angle of the sensor."""
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians([omega_deg])))
    point = np.array([rays.x[0], 0.0, rays.z[0]])
    slope = np.arctan(sensor.mirror.slope(rays.x[0]))
    inside = 2 * slope + np.arctan2(
        rays.x[0], rays.z[0] - LENS
    )  # obscured rays do not reach the wall of a dome
    out = np.array([np.sin(inside), 0.0, -np.cos(inside)])
    return parts_hit(discs, rods, point, out, np.array([0.0, 0.0, LENS]))


def housed(name):
    housing, discs, rods = HOUSINGS[name]
    return replace(SPH, housing=housing), discs, rods


@pytest.mark.parametrize("name", few(HOUSINGS, "all", "dome", "rod"))
def test_obscured_rings_match_marched_rays(name):
    sensor, discs, rods = housed(name)
    high = sensor.field_deg[1]
    assert {ring.part for ring in sensor.obscurations} == {solid[0] for solid in (*discs, *rods)}
    for omega in np.arange(0.35, high, 2.9):
        parts = {r.part for r in sensor.obscurations if r.omega_deg[0] <= omega <= r.omega_deg[1]}
        assert parts == parts_on_path(sensor, discs, rods, omega)
    for ring in sensor.obscurations:
        for edge, sign in zip(ring.omega_deg, (1, -1), strict=True):
            if 0.01 < edge < high - 0.01:
                assert ring.part in parts_on_path(sensor, discs, rods, edge + sign * EDGE_DEG)
                assert ring.part not in parts_on_path(sensor, discs, rods, edge - sign * EDGE_DEG)


@pytest.mark.parametrize("name", HOUSINGS)
def test_obscured_pixels_match_rings(name):
    sensor = housed(name)[0]
    omega = np.linspace(0.3, sensor.field_deg[1] - 0.01, 700)
    rays = sensor.meridian.trace(sensor.meridian.x_from_omega(np.radians(omega)))
    height, turn = sensor.image_height_px(rays), np.radians(37.0)
    pixels = 511.5 + np.stack([height * np.cos(turn), height * np.sin(turn)], axis=-1)
    for part, hidden in sensor.obscured_by(pixels).items():
        rings = [r.omega_deg for r in sensor.obscurations if r.part == part]
        edges = np.array(rings).ravel()
        clear = (np.abs(omega[:, None] - edges) > EDGE_DEG).all(axis=1)
        inside = np.any([(low < omega) & (omega < high) for low, high in rings], axis=0)
        np.testing.assert_array_equal(hidden[clear], inside[clear])


DISPLACED_POSE = MirrorPose(1.5, -1.0, 0.7, 0.4, -0.6)
INTO_ROD = replace(
    DISPLACED_POSE, displacement_mm=-0.7
)  # whose end then contains the mirror vertex


@pytest.mark.parametrize(
    ("name", "pose"),
    few(
        [*((name, DISPLACED_POSE) for name in HOUSINGS), ("wide rod", INTO_ROD)],
        ("wide rod", INTO_ROD),
    ),
)
def test_misaligned_obscured_pixels_match_marched_rays(name, pose):
    aligned, discs, rods = housed(name)
    sensor = replace(aligned, mirror_pose=pose)
    pixels = np.random.default_rng(1).uniform(40.0, 983.0, (150, 2))
    pixels = np.concatenate([pixels, 511.5 + np.random.default_rng(2).normal(0.0, 60.0, (100, 2))])
    start, lens_directions = sensor.lens_rays(pixels, np.zeros(2))
    rays = sensor.optical_train.posed_mirror.trace(start, lens_directions)
    obscured = sensor.obscured_by(pixels)
    count = 0
    for i in np.flatnonzero(rays.valid):
        rim_discs = [d for d in discs if d[0] == "rim"]
        names = parts_hit(
            [d for d in discs if d[0] != "rim"], rods, rays.points[i], rays.directions[i], start[i]
        )
        mirror_point = pose.to_mirror(rays.points[i])
        names |= parts_hit(
            rim_discs,
            [],
            mirror_point,
            pose.rotate_to_mirror(rays.directions[i]),
            mirror_point - [0.0, 0.0, 1.0],
        )
        assert {part for part, hidden in obscured.items() if hidden[i]} == names
        count += bool(names)
    assert count > 5


@pytest.mark.parametrize("shift", [-0.7, 0.7])
def test_displaced_rod_ring_matches_pixels(shift):
    sensor = replace(housed("wide rod")[0], mirror_pose=MirrorPose(displacement_mm=shift))
    ((_, (low, high), _),) = sensor.obscurations
    edges = sensor.meridian.trace(
        sensor.meridian.x_from_omega(np.radians([high - 1e-6, high + 1e-6]))
    )
    pixels = [[511.5 + height, 511.5] for height in sensor.image_height_px(edges)]
    assert low == 0.0
    assert sensor.obscured_by(pixels)["rod"].tolist() == [True, False]


def test_overlapping_rings_merged():
    sensor = housed("all")[0]
    low, high = sensor.obscured
    assert low.omega_deg == (
        0.0,
        max(r.omega_deg[1] for r in sensor.obscurations if r.omega_deg[0] == 0.0),
    )
    assert high.omega_deg[1] == pytest.approx(sensor.field_deg[1])
    assert sensor.clear_field_deg == pytest.approx((low.omega_deg[1], high.omega_deg[0]), abs=2e-9)
    assert SPH.clear_field_deg == SPH.field_deg


@pytest.mark.parametrize("diameter_mm", np.linspace(120.0, 200.0, 9))
def test_quantities_are_continuous_at_ends_of_clear_field(diameter_mm):
    """Rays at the ends pass through the tube, not through its base."""
    sensor = replace(SPH, housing=Housing(shell=Tube(float(diameter_mm))))
    low, high = sensor.clear_field_deg
    viewpoints_mm = om.evaluate(sensor, [low, low + 1e-5, high - 1e-5, high]).viewpoint_z_mm
    np.testing.assert_allclose(np.diff(viewpoints_mm)[[0, 2]], 0.0, atol=1e-4)


def test_full_obscuration_leaves_no_clear_field():
    small = replace(SPH.mirror, rim_radius_mm=15.0)
    sensor = replace(SPH, mirror=small, housing=Housing(CameraBody(900.0)))
    assert sensor.clear_field_deg == (pytest.approx(sensor.field_deg[1]),) * 2


def test_displaced_mirror_keeps_housing():
    """The camera obscuration equals that of a mirror at a correspondingly larger distance."""
    housing = Housing(CameraBody(60.0))
    moved = replace(SPH, housing=housing, mirror_pose=MirrorPose(displacement_mm=2.0))
    farther = replace(SPH, housing=housing, mirror_distance_mm=SPH.mirror_distance_mm + 2.0)
    assert moved.obscurations[0].omega_deg == pytest.approx(
        farther.obscurations[0].omega_deg, abs=1e-9
    )


def test_tilted_mirror_obscuration_by_pixels():
    tilted = replace(SPH, housing=Housing(CameraBody(60.0)), mirror_pose=MirrorPose(tilt_x_deg=1.0))
    with pytest.raises(InvalidParameter, match="aligned"):
        tilted.obscurations  # noqa: B018


def test_two_mirror_obscuration_and_supports():
    folded = om.load_sensor("folded-spherical")
    assert [ring.part for ring in folded.obscurations] == ["secondary, bore"]
    assert folded.clear_field_deg == folded.field_deg
    with pytest.raises(InvalidParameter, match="not supported with a secondary"):
        replace(folded, housing=Housing(rod=Rod())).obscurations  # noqa: B018
    (ring,) = folded.obscurations
    rays = folded.backproject([[511.5, 511.5 + r] for r in (0.0, 60.0, 70.0)])
    hidden = np.any(
        [*folded.obscured_by([[511.5, 511.5 + r] for r in (0.0, 60.0, 70.0)]).values()], axis=0
    )
    assert hidden.tolist() == (~rays.valid).tolist() == [True, True, False]
    truth = om.ground_truth(folded, om.Room(texel_mm=40.0))
    share = 100 * truth.hidden.sum() / (np.pi * folded.rim_radius_px**2)
    assert share == pytest.approx(ring.image_percent, abs=0.02)
    assert not np.isfinite(truth.depth_mm[truth.hidden]).any()


@pytest.mark.parametrize(("width", "setback"), [(5.0, 3.0), (5.0, 0.5), (12.0, 6.0)])
def test_flange_ring_starts_at_outer_edge(width, setback):
    """Rays from the lens, reflected on the sphere by its centre, to the flange plane; the first
    that clears it."""
    sensor = replace(SPH, housing=Housing(rim=Rim(width, setback)))
    radius, plane = SPH.mirror.radius_mm, RIM + setback

    def past_edge(x):
        z = radius - np.sqrt(radius**2 - x**2)
        d = np.array([x, z - LENS]) / np.hypot(x, z - LENS)
        n = np.array([-x, radius - z]) / radius
        out = d - 2 * (d @ n) * n
        return x + (plane - z) * out[0] / out[1] - (M + width), np.degrees(
            np.arctan2(out[0], -out[1])
        )

    (ring,) = sensor.obscurations
    at = brentq(lambda x: past_edge(x)[0], 0.8 * M, M - 1e-9)
    assert ring.part == "rim"
    assert ring.omega_deg == pytest.approx((past_edge(at)[1], SPH.field_deg[1]), abs=1e-4)
