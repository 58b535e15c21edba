"""Rays through the aperture: compiled kernels against tracing in double precision, and conservation
of light."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import backend
from omnimirror.optics.housing import CameraBody, Housing, Rim, Rod
from omnimirror.optics.materials import METALS
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import bundled_sensors
from omnimirror.simulation import rendering as rays
from omnimirror.simulation._compiled_rendering import compiled_light
from omnimirror.simulation.pixel_rays import sample_positions, sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes._painting import Surroundings
from omnimirror.simulation.scenes.calibration_hall import Hall
from omnimirror.simulation.scenes.environment import Environment
from omnimirror.simulation.scenes.scene import DistantScene, Pose, PosedScene, facets
from omnimirror.simulation.scenes.street import HOUSES, Street
from tests.everyday import few

needs_native = pytest.mark.skipif(not backend.is_compiled, reason="requires the compiled module")
HOUSED = Housing(CameraBody(60.0, height_mm=10.0), Rod(8.0, 4.0), rim=Rim(3.0))
DIM = Radiometry(reflectivity=0.8, vignetting=1.0, direct_view=True)
MISALIGNED = MirrorPose(1.0, -0.7, 0.5, 1.5, -2.0)


def small(name: str, pixels: int = 100, **changes) -> om.Sensor:
    """Return the sensor with fewer, larger pixels."""
    sensor = om.load_sensor(name)
    factor = sensor.imager.width_px / pixels
    pitch = sensor.imager.pixel_pitch_um * factor
    imager = replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch)
    return replace(sensor, imager=imager, **changes)


def steps(height: int, width: int) -> Environment:
    light = np.random.default_rng(4).uniform(0, 1, (height, width, 3)).astype(np.float32)
    return Environment(light, heading_deg=33.0)


@needs_native
@pytest.mark.parametrize("flipped", few([False, True], True))
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize(
    "name",
    few(
        [n for n in bundled_sensors() if om.load_sensor(n).secondary is None],
        "exact-equidistant",
        "paper-hyperboloidal",
        "paraboloid-telecentric",
    ),
)
def test_compiled_rays_match_double_precision(name, pose, flipped):
    sensor = small(name, mirror_pose=pose, housing=HOUSED)
    sensor = replace(sensor, mount=replace(sensor.mount, image_flipped=flipped))
    plan, part = sampling_plan(16, blur=True, seed=3), (slice(0, 100), slice(10, 70))
    fast, slow = (
        rays._trace_natively(sensor, plan, DIM, *part),
        rays._trace_sensor(sensor, plan, DIM, *part),
    )
    assert {rays.REFLECTED, rays.DIRECT} <= set(np.unique(slow.outcome))
    assert np.mean(fast.outcome != slow.outcome) < 1e-4  # rays that graze an edge
    valid = (fast.outcome == slow.outcome) & (slow.outcome != rays.OBSCURED)
    np.testing.assert_allclose(fast.weight[valid], slow.weight[valid], atol=1e-6)
    hidden = (fast.outcome == slow.outcome) & (slow.outcome == rays.OBSCURED)
    assert (
        np.mean(np.abs(fast.weight[hidden] - slow.weight[hidden]) > 1e-5) < 2e-3
    )  # rays that graze a ring
    a, b = (
        d[valid] / np.linalg.norm(d[valid], axis=-1, keepdims=True)
        for d in (fast.directions, slow.directions)
    )
    assert np.degrees(np.linalg.norm(np.cross(a, b), axis=-1)).max() < 5e-4
    distances_mm = np.linalg.norm(np.cross(fast.origins[valid] - slow.origins[valid], b), axis=-1)
    assert distances_mm.max() < 2e-4  # mm, across the ray


@needs_native
@pytest.mark.parametrize(
    ("housing", "dim"), [(Housing(), Radiometry()), (HOUSED, DIM)], ids=["bare", "housed"]
)
def test_compiled_environment_matches_numpy(housing, dim):
    sensor, world = small("paper-equidistant", housing=housing), steps(64, 128)
    plan = sampling_plan(9, blur=True, seed=5)
    fast = expose(sensor, world, samples=9, blur=True, radiometry=dim, seed=5)
    bundle = rays.trace_bundle(sensor, plan, dim, slice(0, 100), slice(0, 100))
    slow = rays.gather_light(bundle, world, dim).mean(axis=2)
    assert np.abs(fast - slow).max() < 2e-3
    assert np.abs(fast - slow).mean() < 1e-5


def meadow() -> Surroundings:
    """Return semi-transparent leaves in front of a sky."""
    rng = np.random.default_rng(8)
    away = rng.normal(size=(300, 1, 3))
    away *= rng.uniform(300, 900, (300, 1, 1)) / np.linalg.norm(away, axis=2, keepdims=True)
    leaves = facets(
        away + 60 * rng.normal(size=(300, 3, 3)), rng.uniform(0, 1, (300, 3, 3)).astype(np.float32)
    )
    leaves.textures[0].texels[..., 3] = 0.25
    return Surroundings(leaves, steps(64, 128))


SCENES = {
    "room": om.Room(texel_mm=40.0),
    "room, turned": PosedScene(
        om.Room(texel_mm=40.0), Pose(700.0, -300.0, 100.0, 40.0, 10.0, -20.0)
    ),
    "hall, far": PosedScene(DistantScene(Hall(texel_mm=50.0)), Pose(0.0, 0.0, 0.0, 40.0)),
    "far street": DistantScene(PosedScene(Street(texel_mm=100.0), Pose(5000.0, 0.0, 0.0, 40.0))),
    "leaves": meadow(),
}


@needs_native
@pytest.mark.parametrize(
    ("housing", "dim"), [(Housing(), Radiometry()), (HOUSED, Radiometry(0.8, vignetting=1.0))]
)
@pytest.mark.parametrize("name", SCENES)
def test_compiled_surfaces_match_numpy(name, housing, dim, monkeypatch):
    sensor, scene = small("paper-equidistant", housing=housing), SCENES[name]
    fast = expose(sensor, scene, samples=9, blur=True, radiometry=dim, seed=5)
    assert (
        compiled_light(sensor, scene, sampling_plan(9, True, 5), dim, workers=1).tobytes()
        == fast.tobytes()
    )
    bundle = rays.trace_bundle(
        sensor, sampling_plan(9, blur=True, seed=5), dim, slice(0, 100), slice(0, 100)
    )
    slow = rays.gather_light(bundle, scene, dim).mean(axis=2)
    assert np.ptp(slow) > 0.3
    assert np.mean(np.abs(fast - slow) > 1e-4) < 1e-3  # rays that graze an edge
    assert np.abs(fast - slow).mean() < 1e-5


@needs_native
def test_kernels_reject_invalid_origins():
    sensor, dim, plan = small("paper-spherical"), Radiometry(), sampling_plan(1, blur=False)
    house, road = HOUSES[0].box.low, Pose(5000.0, 0.0, -1620.0)
    cases = (
        (om.Room(40.0), Pose(3400.0)),
        (Hall(50.0), Pose(5200.0)),
        (Street(100.0), Pose(*house)),
        (Street(100.0), road),
    )
    for scene, outside in cases:
        assert compiled_light(sensor, scene, plan, dim) is not None
        posed = PosedScene(scene, outside)
        assert compiled_light(sensor, posed, plan, dim) is None
        with pytest.raises(
            InvalidParameter, match=r"ray origins must be|the mirror must not intersect"
        ):
            expose(sensor, posed, samples=1)


def test_samples_fill_pixel_and_aperture():
    plan = sampling_plan(256, blur=True, seed=1)
    pixels, aperture = sample_positions(plan, np.array([7, 8]), np.array([5, 5]))
    assert np.abs(pixels - [[[7, 5]], [[8, 5]]]).max() <= 0.5
    np.testing.assert_allclose(pixels.mean(axis=1), [[7, 5], [8, 5]], atol=1.5e-2)
    radius = np.hypot(*np.moveaxis(aperture, -1, 0))
    assert radius.max() <= 1
    np.testing.assert_allclose((radius**2).mean(axis=1), 0.5, atol=1.5e-2)  # mean over a disc
    np.testing.assert_allclose(aperture.mean(axis=1), 0.0, atol=1e-2)
    assert np.abs(pixels[0] - pixels[1] + [1, 0]).max() > 0.1  # each pixel has its own shift


@needs_native  # 67 million rays
def test_rendered_blur_matches_evaluation():
    """The image of a small distant lamp: its width is the sagittal blur of the evaluation plus a
    pixel."""
    sensor = om.load_sensor("paper-spherical")
    sensor = replace(sensor, lens=replace(sensor.lens, f_number=1.4))
    omega = 100.0
    (u, v) = sensor.project_directions(
        [[np.sin(np.radians(omega)), 0.0, -np.cos(np.radians(omega))]]
    ).pixels[0]
    world = np.zeros((1800, 3600, 3), np.float32)
    world[1800 - 1000 - 1 : 1800 - 1000 + 1, 1799:1801] = 1.0  # 0.2 deg about pan 0 and 10 deg up
    light = expose(sensor, Environment(world), samples=64, blur=True)[..., 0]
    _, columns = np.nonzero(light > 1e-3 * light.max())
    assert abs(light.sum(axis=1) @ np.arange(1024) / light.sum() - v) < 0.3
    blur = om.evaluate(sensor, omega_deg=[omega])
    wide = np.ptp(columns) + 1
    across = abs(float(blur.blur_s_px[0])) + 0.2 * float(blur.width_px_per_deg[0])
    assert across - 1 <= wide <= across + 3
    assert abs(columns.mean() - u) < 1


def test_uniform_radiance_is_preserved():
    white = Environment(np.ones((4, 8, 3), np.float32))
    light = expose(
        small("paper-spherical"),
        white,
        samples=16,
        blur=True,
        radiometry=Radiometry(reflectivity=0.9, direct_view=False),
    )
    np.testing.assert_allclose(light[50, 50], 0.9, rtol=1e-5)
    assert light[0, 0].max() == 0
    image = expose(
        small("paper-spherical"),
        white,
        samples=16,
        blur=True,
        radiometry=Radiometry(direct_view=True),
    )
    np.testing.assert_allclose(image, 1.0, rtol=1e-5)


@needs_native
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize("metal", ["aluminium", "gold", 0.5 + 2.0j])
def test_metal_reflectance_matches_fresnel(metal, pose):
    sensor, plan = small("paper-spherical", mirror_pose=pose), sampling_plan(4, blur=True)
    part, dim = (slice(0, 100), slice(0, 100)), Radiometry(reflectivity=metal)
    fast, slow = (
        rays._trace_natively(sensor, plan, dim, *part),
        rays._trace_sensor(sensor, plan, dim, *part),
    )
    valid = (fast.outcome == rays.REFLECTED) & (slow.outcome == rays.REFLECTED)
    np.testing.assert_allclose(fast.weight[valid], slow.weight[valid], atol=5e-5)
    assert np.ptp(slow.weight[valid]) > 5e-3


def test_metal_reflectance_depends_on_incidence():
    sensor, white = om.load_sensor("paper-spherical"), Environment(np.ones((4, 8, 3), np.float32))
    light = expose(
        sensor, white, samples=1, radiometry=Radiometry(reflectivity=("gold", "silver", 0.7))
    )
    u, v = 911, 512
    radius = np.hypot(*(np.array([u, v]) - sensor.imager.centre))
    gamma = sensor.meridian.trace(sensor.x_from_height_px([radius])).gamma
    cos, inside = (
        np.cos(gamma),
        {m: np.sqrt(1 - (np.sin(gamma) / METALS[m]) ** 2) for m in ("gold", "silver")},
    )
    for channel, metal in enumerate(inside):
        n, t = METALS[metal], inside[metal]
        s, p = (cos - n * t) / (cos + n * t), (n * cos - t) / (n * cos + t)
        assert light[v, u, channel] == pytest.approx(
            float((abs(s) ** 2 + abs(p) ** 2)[0] / 2), abs=2e-5
        )
    assert light[v, u, 2] == pytest.approx(0.7)


def test_natural_vignetting_is_cos4():
    white = Environment(np.ones((4, 8, 3), np.float32))
    sensor = om.load_sensor("paper-spherical")
    light = expose(sensor, white, samples=1, radiometry=Radiometry(vignetting=1.0))
    u, v = sensor.imager.centre
    tangent = 400 * sensor.imager.pitch_mm / sensor.lens.image_distance
    expected = np.cos(np.arctan(tangent)) ** 4
    at = light[round(v), round(u - 400), 0]
    assert at == pytest.approx(expected, abs=2e-3)


def test_camera_reflection_is_central():
    """Its edge is at the mirror point that reflects the edge of the disc into the lens."""
    sensor = replace(om.load_sensor("paper-spherical"), housing=Housing(CameraBody(80.0)))
    white = Environment(np.ones((4, 8, 3), np.float32))
    light = expose(sensor, white, samples=1, radiometry=Radiometry(housing_light=0.0))[..., 0]
    edge = sensor.project([[40.0, 0.0, sensor.optical_train.lens_offset[2]]]).pixels[0]
    radius = sensor.radius_from_centre_px(edge[None])[0]
    dark = int((light == 0)[512, 256:768].sum())
    assert dark == pytest.approx(2 * radius, abs=2)


def test_blur_requires_sensor():
    ball = om.MirrorBall(
        centre_px=(100.0, 100.0), rim_radius_px=90.0, field_deg=360.0, image_size=(200, 200)
    )
    with pytest.raises(InvalidParameter, match="blur must be False unless the camera is a sensor"):
        expose(ball, steps(8, 16), blur=True)


@pytest.mark.parametrize(("samples", "seed"), [(0, 0), (2.5, 0), (1 << 17, 0), (4, -1)])
def test_invalid_samples_raise(samples, seed):
    with pytest.raises(InvalidParameter, match=r"^(samples|seed) "):
        sampling_plan(samples, blur=True, seed=seed)


@pytest.mark.parametrize("samples", [1, 2, 7, 8, 16])
def test_sharp_samples_are_centred(samples):
    """They are equal in all pixels: a nonzero mean would shift the whole image."""
    points = sampling_plan(samples, blur=False).points[:, :2]
    np.testing.assert_allclose(points.mean(axis=0), 0.5, atol=1e-6)
    assert len(np.unique(points.round(5), axis=0)) == samples


def test_too_large_imager_raises():
    sensor = om.load_sensor("paper-spherical")
    large = replace(
        sensor,
        imager=replace(sensor.imager, width_px=40_000, height_px=40_000, pixel_pitch_um=0.1331),
    )
    with pytest.raises(
        InvalidParameter, match="for example 32768 x 32768 px; got 40000 x 40000 px"
    ):
        om.render_image(large, om.Room(texel_mm=40.0), samples=1)
    with pytest.raises(InvalidParameter, match=r"between 1 and 100000 px; got 100001"):
        replace(sensor.imager, width_px=100_001)
