"""Tool paths: the cut surface against the mirror, by distances of its points from the driven lines."""

from __future__ import annotations

import re

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Tool, format_gcode, format_points, tool_path
from omnimirror.optics.mirrors import Cone, EvenPolynomial, Sphere
from tests.commands import omnimirror
from tests.conftest import MIRRORS, sensor_of

NUMBER = r"(-?\d+\.\d+)"


def driven(program: str) -> np.ndarray:
    """Return X and Z (n, 2) of the cuts in a program."""
    return np.array(
        [
            [float(v) for v in m]
            for m in re.findall(rf"^G1 X{NUMBER} Z{NUMBER}$", program, re.MULTILINE)
        ]
    )


def nearest(points: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Return distances of points (n, 2) from the nearest line between points (m, 2)."""
    from scipy.spatial import KDTree

    near = KDTree(ends).query(points, k=4)[1]
    best = np.full(len(points), np.inf)
    for first in (*near.T, *(near.T - 1)):
        a = ends[np.clip(first, 0, len(ends) - 2)]
        along = ends[np.clip(first, 0, len(ends) - 2) + 1] - a
        share = np.clip(((points - a) * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(points - a - share[:, None] * along).T))
    return best


@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_cut_surface_matches_the_mirror(kind):
    mirror, tool = sensor_of(kind).mirror, Tool(0.4, tolerance_nm=8.0)
    path = tool_path(mirror, tool)
    centres = driven(format_gcode(path, kind)) + np.array([0.0, tool.radius_mm])
    x = np.random.default_rng(1).uniform(0.0, mirror.rim_radius_mm, 4000)
    left = 1e6 * (nearest(np.stack([x, -mirror.sag(x)], axis=-1), centres) - tool.radius_mm)
    assert np.abs(left).max() < 8.0
    assert np.abs(left).max() <= path.deviation_nm * 1.001
    assert np.abs(left).max() > 0.5 * path.deviation_nm or path.deviation_nm < 1.0
    assert centres[0, 0] >= mirror.rim_radius_mm
    assert (np.diff(centres[:, 0]) < 0).all()


def test_path_of_a_sphere_is_an_arc_with_tolerance_dependent_spacing():
    coarse, fine = (
        tool_path(Sphere(30.0, 20.0), Tool(1.0, tolerance_nm=nm), digits=8) for nm in (40.0, 10.0)
    )
    for path in (coarse, fine):
        assert np.abs(np.hypot(path.x_mm, path.z_mm + 31.0) - 31.0).max() * 1e6 < 0.05
    assert fine.deviation_nm < 10.0 < coarse.deviation_nm < 40.0
    assert len(fine.x_mm) == pytest.approx(2 * len(coarse.x_mm), rel=0.05)
    for path, nm in ((coarse, 40.0), (fine, 10.0)):
        chords = np.hypot(np.diff(path.x_mm), np.diff(path.z_mm))
        assert path.deviation_nm == pytest.approx(1e6 * chords.max() ** 2 / (8 * 31.0), rel=2e-3)
        longest = np.sqrt(8 * 31.0 * 0.8e-6 * nm)  # 80 % of the tolerance
        assert len(chords) == np.ceil(31.0 * np.arcsin(2 / 3) / longest)
    assert fine.cusp_nm == pytest.approx(fine.tool.cusp_nm(1 / 30.0), rel=1e-9)
    assert fine.length_mm == pytest.approx(31.0 * np.arcsin(20.0 / 30.0), rel=1e-6)
    assert fine.minutes == pytest.approx(
        fine.length_mm / (0.002 * 1000), rel=1e-12
    )  # 2 um per revolution, 1000 rpm
    assert fine.edge_deg == (0.0, pytest.approx(np.degrees(np.arcsin(20.0 / 30.0)), abs=0.01))


def test_cusp_height_matches_geometry():
    tool, R = Tool(0.5, feed_um=20.0), 10.0
    step = 1e-3 * tool.feed_um / R
    between = np.array([np.sin(step / 2), np.cos(step / 2)])
    along = (
        np.linspace(R - 1e-3, R + 1e-3, 20001)[:, None] * between
    )  # cusp between two tool-nose arcs
    touched = np.hypot(*(along - [0.0, R + tool.radius_mm]).T) <= tool.radius_mm
    crest = np.hypot(*along[np.argmax(touched)]) - R
    assert tool.cusp_nm(1 / R) == pytest.approx(1e6 * crest, rel=2e-3)


def test_nose_larger_than_concave_radius_is_rejected():
    hollow = EvenPolynomial((0.01, -8e-6), 24.0)  # concave inwards from 14.4 mm on
    x = np.linspace(0.0, 24.0, 20001)
    slope = 0.02 * x - 3.2e-5 * x**3
    sharpest = ((9.6e-5 * x**2 - 0.02) / (1 + slope**2) ** 1.5).max()
    assert tool_path(hollow, Tool(0.99 / sharpest), digits=8).deviation_nm < 5.0
    with pytest.raises(
        InvalidParameter,
        match=rf"less than the concave radius {1 / sharpest:.4g} mm of the mirror at x = 24 mm; got",
    ):
        tool_path(hollow, Tool(1.01 / sharpest))
    bowl = EvenPolynomial((-0.25,), 1.0, 1.0)  # with a radius of 2 mm at the vertex
    with pytest.raises(InvalidParameter, match="radius 2 mm of the mirror at x = 0 mm; got 2"):
        tool_path(bowl, Tool(2.0))
    assert tool_path(bowl, Tool(1.99)).edge_deg == (-26.57, 0.0)  # of a slope of -1/2


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"radius_mm": 0.0}, r"radius_mm must be between 0\.001 and 100 mm; got 0"),
        *(
            (
                {name: value * (1 + excess)},
                rf"{name} must be between {low:g} and {high:g} {unit}; got",
            )
            for name, unit, low, high in (
                ("radius_mm", "mm", 1e-3, 100.0),
                ("feed_um", "um", 1e-3, 1e3),
                ("tolerance_nm", "nm", 0.1, 1e5),
                ("spindle_rpm", "1/min", 1.0, 1e5),
            )
            for value, excess in ((low, -1e-6), (high, 1e-6))
        ),
        ({"clearance_mm": -1e-6}, "clearance_mm must be between 0 and 1000 mm; got -1e-06"),
        ({"clearance_mm": 1001.0}, "clearance_mm must be between 0 and 1000 mm; got 1001"),
        ({"x_is_diameter": 2}, "x_is_diameter must be True or False; got 2"),
    ],
)
def test_invalid_tool_is_rejected(options, message):
    with pytest.raises(InvalidParameter, match=message):
        Tool(**options)


@pytest.mark.parametrize("bound", [0, 1])
def test_parameter_bounds_are_valid(bound):
    limits = {
        "radius_mm": (1e-3, 100.0),
        "feed_um": (1e-3, 1e3),
        "tolerance_nm": (0.1, 1e5),
        "spindle_rpm": (1.0, 1e5),
        "clearance_mm": (0.0, 1e3),
    }
    values = {name: pair[bound] for name, pair in limits.items()}
    assert {name: getattr(Tool(**values), name) for name in values} == values


def test_insufficient_digits_are_rejected():
    with pytest.raises(
        InvalidParameter, match=r"at least 35 for digits = 5, which rounds by up to 7.1 nm"
    ):
        tool_path(Sphere(30.0, 20.0), digits=5)
    assert tool_path(Sphere(30.0, 20.0), Tool(tolerance_nm=35.4), digits=5).deviation_nm < 35.4
    for digits in (2, 13):
        with pytest.raises(InvalidParameter, match="digits must be an integer between 3 and 12"):
            tool_path(Sphere(30.0, 20.0), Tool(tolerance_nm=1e5), digits=digits)


@pytest.mark.parametrize("digits", [3, 12])
def test_points_have_the_decimals_of_the_file(digits):
    path = tool_path(Sphere(30.0, 20.0), Tool(tolerance_nm=1e5), digits=digits)
    for values in (path.x_mm, path.z_mm):
        assert (np.round(values, digits) == values).all()
        assert (np.round(values, digits - 1) != values).any()
    usual = tool_path(Sphere(30.0, 20.0))
    assert usual.tool == Tool(0.5, 2.0, 5.0, 1000.0, 1.0, x_is_diameter=False)
    assert (np.round(usual.x_mm, 6) == usual.x_mm).all()
    assert (np.round(usual.x_mm, 5) != usual.x_mm).any()


def test_nearly_flat_mirror_has_eight_steps_without_negative_zeros():
    path = tool_path(EvenPolynomial((1e-9,), 20.0, 1.0))
    assert len(path.x_mm) == 9
    for text in (format_gcode(path, "flat"), format_points(path, "flat")):
        assert "0.000000" in text
        assert "-0.000000" not in text


def test_point_list_contains_contacts_and_diameter_option_doubles_x():
    path = tool_path(Sphere(30.0, 20.0), Tool(1.0))
    text = format_points(path, "ball")
    contact, x, z = np.loadtxt(text.splitlines(), skiprows=3, delimiter="\t", unpack=True)
    assert np.abs(x - contact * 31.0 / 30.0).max() < 2e-6
    twice = tool_path(Sphere(30.0, 20.0), Tool(1.0, x_is_diameter=True))
    assert np.array_equal(driven(format_gcode(twice, "ball")), np.stack([2 * x, z], axis=-1))


@pytest.mark.parametrize(
    "mirror",
    [Sphere(30.0, 20.0), EvenPolynomial((-2e-3,), 24.0), Cone(30.0, 20.0)],
    ids=["ball", "hollow", "cone"],
)
@pytest.mark.parametrize("x_is_diameter", [False, True])
def test_program_approaches_tangentially_and_retracts(mirror, x_is_diameter):
    """The approach is tangential at the rim; concave mirrors require a higher retraction; X may be
    a diameter.
    """
    path = tool_path(mirror, Tool(1.0, x_is_diameter=x_is_diameter))
    lines = format_gcode(path, "a (ball); 50% µ\n").splitlines()
    assert lines[1] == r"(omnimirror tool path of a [ball], 50\x25 \xb5)"
    assert all(re.fullmatch(r"%|\([^()]*\)|[GMXZFS0-9. -]+", line) for line in lines)
    low, high = path.edge_deg
    assert f"(edge used from {low:g} to {high:g} deg from Z)" in lines
    assert f"X is a {'diameter' if x_is_diameter else 'radius'})" in lines[3]
    quick = [line for line in lines if line.startswith("G0")]
    assert quick[0] == quick[-1]
    assert {"G97 S1000 M3", "G95 F0.002000"} <= set(lines)
    start = np.array([float(quick[1].split("X")[1]), float(quick[2].split("Z")[1])])
    cuts = driven("\n".join(lines))
    if x_is_diameter:
        start[0], cuts[:, 0] = start[0] / 2, cuts[:, 0] / 2
    np.testing.assert_allclose(cuts, np.stack([path.x_mm, path.z_mm], axis=-1), rtol=0, atol=1e-9)
    away, tangent = start - cuts[0], cuts[0] - cuts[1]
    np.testing.assert_allclose(
        away, tangent / np.hypot(*tangent), rtol=0, atol=1e-5
    )  # 1 mm, the clearance
    assert float(quick[0].split("Z")[1]) == pytest.approx(
        1.0 + max(0.0, cuts[:, 1].max(), start[1]), abs=1e-6
    )


def test_command_writes_program_and_list(tmp_path):
    done = omnimirror(
        "export",
        "folded-spherical",
        "-o",
        tmp_path,
        "--formats",
        "gcode,points",
        "--set",
        "tool.radius_mm=0.2",
        "--set",
        "tool.tolerance_nm=20",
    )
    assert done.returncode == 0, done.stderr
    assert {p.name for p in tmp_path.iterdir()} == {
        f"folded-spherical{mirror}-path.{suffix}"
        for mirror in ("", "-secondary")
        for suffix in ("nc", "tsv")
    }
    mirror = om.load_sensor("folded-spherical").mirror
    centres = driven((tmp_path / "folded-spherical-path.nc").read_text()) + np.array([0.0, 0.2])
    x = np.linspace(0.0, mirror.rim_radius_mm, 999)
    assert np.abs(nearest(np.stack([x, -mirror.sag(x)], axis=-1), centres) - 0.2).max() < 20e-6
    run = omnimirror(
        "export", "folded-spherical", "-o", tmp_path / "a.nc", "--set", "tool.radius_mm=-1"
    )
    assert run.returncode != 0
    assert "radius_mm must be between 0.001 and 100 mm; got -1" in run.stderr
    assert not (tmp_path / "a.nc").exists()
