"""STL and 3MF files, read by trimesh: closed, oriented, within the tolerance, with the exact
volume.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Body
from omnimirror.manufacturing.formats.mesh import mesh_of, write_mesh
from omnimirror.manufacturing.surface_approximation import chords
from omnimirror.optics.mirrors import ConicAsphere
from tests.conftest import MIRRORS
from tests.everyday import few
from tests.manufacturing.formats.test_step import BODIES, exact_volume


def load(path):
    return trimesh.load(
        path, force="mesh", process=path.suffix == ".stl"
    )  # STL repeats the corners


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("suffix", [".stl", ".3mf"])
@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "cone", "sampled"))
def test_mesh_is_closed_and_within_the_tolerance(kind, suffix, body, tmp_path):
    mirror, _ = MIRRORS[kind]
    path = tmp_path / f"mirror{suffix}"
    stated, count = write_mesh(path, mirror, body, 20.0)
    mesh = load(path)
    assert len(mesh.faces) == count
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == (0 if body.bore_goes_through else 2)
    assert 0 < mesh.volume == pytest.approx(exact_volume(mirror, body), rel=2e-3)
    assert mesh.volume < exact_volume(mirror, body)  # chords of a convex part are inside
    np.testing.assert_allclose(
        mesh.bounds[1][0], mirror.rim_radius_mm + body.flange_width_mm, rtol=1e-6
    )

    # triangles of the optical surface face the lens; random points on them
    front = mesh.submesh([np.flatnonzero(mesh.face_normals[:, 2] < -1e-6)], append=True)
    points, _ = trimesh.sample.sample_surface(front, 20000, seed=1)
    r = np.minimum(np.hypot(points[:, 0], points[:, 1]), mirror.rim_radius_mm)
    on_surface = (
        points[:, 2] <= float(mirror.sag(mirror.rim_radius_mm)) - 1e-6 * mirror.rim_radius_mm
    )
    z, slope, _ = mirror.profile(r)
    distance = (1e3 * np.abs(points[:, 2] - z) / np.sqrt(1 + slope**2))[on_surface]
    assert distance.max() <= 1.005 * stated <= 20.0  # reported from 91 points per triangle
    if kind != "cone":
        assert stated > 10.0  # not finer than requested


def test_finer_tolerance_is_met():
    mirror, _ = MIRRORS["hyperboloid"]
    coarse, fine = (len(mesh_of(mirror, Body(), tolerance)[1]) for tolerance in (40.0, 1.0))
    assert fine == pytest.approx(
        40 * coarse, rel=0.2
    )  # the number of triangles is proportional to 1/tolerance


@settings(max_examples=40)
@given(
    radius=st.floats(50.0, 500.0),
    conic=st.floats(-5.0, 0.2),
    fourth=st.floats(-0.05, 0.05),
    tolerance=st.floats(0.1, 100.0),
)
def test_chords_stay_within_the_tolerance(radius, conic, fourth, tolerance):
    mirror = ConicAsphere(radius, conic, 40.0, (fourth,), 40.0)
    x = chords(mirror, tolerance)
    assert x[0] == 0.0
    assert x[-1] == 40.0
    t = np.linspace(0, 1, 9)[:, None]
    points, heights = x[:-1] + t * np.diff(x), mirror.sag(x[:-1]) + t * np.diff(mirror.sag(x))
    z, slope, _ = mirror.profile(np.minimum(points, 40.0))
    assert 1e3 * np.abs((heights - z) / np.sqrt(1 + slope**2)).max() <= tolerance


@pytest.mark.parametrize("tolerance", [0.0, -1.0, np.nan, 1e-5])
def test_invalid_tolerance_is_rejected(tolerance):
    with pytest.raises(InvalidParameter, match="chord_tolerance_um must"):
        mesh_of(MIRRORS["sphere"][0], Body(), tolerance)
