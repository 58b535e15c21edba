"""Ray interface of Mitsuba 3, with meshes of the mirrors with smooth normals and its own sphere.

A mesh from the product's sag verifies the tracer only; sag and slope have separate tests. The lens
rays are built here from the parameters of the imager only.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.conftest import MIRRORS, sensor_of

MISALIGNED = MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0)
WITHIN_DEG, WITHIN_PX = 0.002, 0.01
FINE, FINEST = (350, 700), (700, 1400)  # rings and spokes


@pytest.fixture(scope="module")
def mi():
    mitsuba = pytest.importorskip("mitsuba", reason="Mitsuba is not installed")
    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def meshed(mi, sensor, rings, spokes):
    """Return the mirror as triangles with vertex normals, at its pose in the camera frame."""
    mirror, pose = sensor.mirror, sensor.mirror_pose
    spaced = (
        np.linspace if not mirror.is_pointed else np.geomspace
    )  # normals vary faster towards a tip
    r = spaced(mirror.rim_radius_mm / 5000, mirror.rim_radius_mm, rings)
    r, phi = np.meshgrid(r, 2 * np.pi * np.arange(spokes) / spokes, indexing="ij")
    sag, slope, _ = mirror.profile(r)
    points = np.stack([r * np.cos(phi), r * np.sin(phi), sag], -1).reshape(-1, 3)
    normals = np.stack([slope * np.cos(phi), slope * np.sin(phi), -np.ones_like(r)], -1).reshape(
        -1, 3
    )
    points = np.concatenate([[[0, 0, 0]], points])
    normals = np.concatenate(
        [[[0, 0, -1]], normals / np.linalg.norm(normals, axis=1, keepdims=True)]
    )
    spoke, ring = np.arange(spokes), np.arange(rings - 1)[:, None]
    inner, outer = 1 + ring * spokes + spoke, 1 + (ring + 1) * spokes + spoke
    next_inner, next_outer = np.roll(inner, -1, axis=1), np.roll(outer, -1, axis=1)
    quads = [
        np.stack([inner, next_outer, outer], -1),
        np.stack([inner, next_inner, next_outer], -1),
    ]
    fan = np.stack([np.zeros_like(spoke), 1 + np.roll(spoke, -1), 1 + spoke], -1)
    faces = np.concatenate([fan, *(q.reshape(-1, 3) for q in quads)])
    mesh = mi.Mesh("mirror", len(points), len(faces), has_vertex_normals=True)
    parameters = mi.traverse(mesh)
    parameters["vertex_positions"] = pose.to_camera(points).ravel().tolist()
    parameters["vertex_normals"] = pose.rotate_to_camera(normals).ravel().tolist()
    parameters["faces"] = faces.ravel().tolist()
    parameters.update()
    return mi.load_dict({"type": "scene", "mirror": mesh})


def lens_rays(sensor, pixels):
    """Return chief rays of pixels in the camera frame: through the principal point, or parallel to
    the axis."""
    image = (pixels - 511.5) * 5.2e-3
    if sensor.lens.TELECENTRIC:
        across = image / sensor.lens.magnification
        return np.column_stack([across, np.full(len(across), -30.0)]), np.tile(
            [0.0, 0.0, 1.0], (len(across), 1)
        )
    origins = np.tile([0.0, 0.0, -sensor.mirror_distance_mm], (len(image), 1))
    directions = np.column_stack([image, np.full(len(image), sensor.lens.image_distance)])
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def reflected(mi, scene, origins, directions):
    """Return ray directions after reflection by Mitsuba's shading normals; NaN without a hit, or
    for the back."""
    out = np.full(origins.shape, np.nan)
    for i, (o, d) in enumerate(zip(origins, directions, strict=True)):
        hit = scene.ray_intersect(mi.Ray3f(mi.Point3f(*o), mi.Vector3f(*d)))
        if hit.is_valid():
            n = np.array(hit.sh_frame.n, dtype=float)
            n /= np.linalg.norm(n)
            if d @ n < 0:
                out[i] = d - 2 * (d @ n) * n
    return out


DIRECTIONS = "directions of pixels, aligned and misaligned mirrors as meshes, perspective and telecentric lenses"
PIXELS = "pixels of these directions"


def pixels_within(sensor, count):
    """Return pixels over the whole mirror image except those near the rim."""
    pixels = np.random.default_rng(9).uniform(
        0, 1023, (12 * count, 2)
    )  # integer pixels would hit cracks at 45 deg
    around = np.concatenate(
        [pixels + 1.5 * np.array([np.cos(a), np.sin(a)]) for a in np.arange(0, 6.28, 0.7)]
    )
    inside = sensor.backproject(around).valid.reshape(-1, len(pixels)).all(axis=0)
    return pixels[inside][:count]


def differences(mi, sensor, scene, count):
    """Return the largest and RMS angle (deg) between both, and the largest image difference (px)."""
    pixels = pixels_within(sensor, count)
    expected = reflected(mi, scene, *lens_rays(sensor, pixels)) @ sensor.mount.rotation().T
    assert np.isfinite(expected).all()
    rays = sensor.backproject(pixels)
    assert rays.valid.all()
    apart = np.degrees(np.linalg.norm(expected - rays.directions, axis=1))
    back = sensor.project_directions(expected).pixels
    return apart.max(), np.sqrt(np.mean(apart**2)), np.nanmax(np.hypot(*(back - pixels).T))


def spherical(mi, sensor):
    """Return a scene with Mitsuba's own sphere as mirror."""
    A = sensor.mirror.radius_mm
    centre = sensor.mirror_pose.to_camera([[0.0, 0.0, A]])[0]
    return mi.load_dict(
        {"type": "scene", "ball": {"type": "sphere", "radius": A, "center": centre.tolist()}}
    )


@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
def test_reflection_on_mitsuba_sphere(mi, pose, beside):
    sensor = replace(sensor_of("sphere"), mirror_pose=pose)
    worst_deg, _, worst_px = differences(mi, sensor, spherical(mi, sensor), 1500)
    # the difference is single-precision rounding
    beside(
        "Mitsuba 3",
        "directions of pixels, analytic sphere of Mitsuba",
        worst_deg,
        WITHIN_DEG / 5,
        "deg",
    )
    beside(
        "Mitsuba 3",
        "pixels of these directions, analytic sphere of Mitsuba",
        worst_px,
        WITHIN_PX / 5,
        "px",
    )


@pytest.mark.full
@pytest.mark.parametrize(
    ("kind", "pose"),
    [("hyperboloid", MirrorPose()), ("conic-asphere", MISALIGNED)],
)
def test_reflection_on_fine_mesh(mi, kind, pose, beside):
    sensor = replace(sensor_of(kind), mirror_pose=pose)
    worst_deg, _, worst_px = differences(mi, sensor, meshed(mi, sensor, *FINE), 400)
    beside("Mitsuba 3", DIRECTIONS, worst_deg, WITHIN_DEG, "deg")
    beside("Mitsuba 3", PIXELS, worst_px, WITHIN_PX, "px")


@pytest.mark.full
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize("kind", sorted(MIRRORS))
def test_mesh_refinement_converges(mi, kind, pose, beside):
    """The difference is due to the mesh: it decreases with the squared step down to single
    precision."""
    sensor = replace(sensor_of(kind), mirror_pose=pose)
    errors = [differences(mi, sensor, meshed(mi, sensor, n, 2 * n), 4000) for n in (175, 350, 700)]
    coarse, middle, fine = (rms for _, rms, _ in errors)
    print(
        f"{kind}: worst deg and px on 175, 350, 700 rings:",
        [(f"{a:.2g}", f"{c:.2g}") for a, _, c in errors],
    )
    assert middle < coarse / 3
    assert fine < middle / 2
    worst_deg, _, worst_px = errors[-1]
    beside("Mitsuba 3", DIRECTIONS, worst_deg, WITHIN_DEG, "deg")
    beside("Mitsuba 3", PIXELS, worst_px, WITHIN_PX, "px")


@pytest.mark.full
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize("kind", ["sphere", "paraboloid"])
def test_telecentric_reflection_on_mesh(mi, kind, pose, beside):
    sensor = replace(sensor_of(kind, "orthographic"), mirror_pose=pose)
    worst_deg, _, worst_px = differences(mi, sensor, meshed(mi, sensor, *FINEST), 4000)
    beside("Mitsuba 3", DIRECTIONS, worst_deg, WITHIN_DEG, "deg")
    beside("Mitsuba 3", PIXELS, worst_px, WITHIN_PX, "px")
