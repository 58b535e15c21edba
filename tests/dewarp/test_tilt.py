"""Tilted sensors: a level world in all views."""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.cameras.camera import Mount
from omnimirror.dewarp._source_coordinates import is_separable
from omnimirror.dewarp.screens import parts_of
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.sensor_files import format_sensor, parse_sensor
from omnimirror.simulation.scenes.scene import Pose, PosedScene
from tests.dewarp.test_handedness import IMAGE_RIGHT_IS_FORWARD, shortest_path_pixel
from tests.everyday import few
from tests.io.test_panorama import xmp_of

PITCH, ROLL = 24.0, -7.0


def levelling(pitch_deg: float, roll_deg: float) -> np.ndarray:
    """Return the rotation from the sensor frame (forward, left, up) to the levelled one, written
    out: about forward, which lowers the right side, then about left, which raises forward."""
    (cp, sp), (cr, sr) = ((np.cos(a), np.sin(a)) for a in np.radians([pitch_deg, roll_deg]))
    pitch_rotation = np.array([[cp, 0, -sp], [0, 1, 0], [sp, 0, cp]])
    right_sinks = np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]])
    return pitch_rotation @ right_sinks


# -- the convention --------------------------------------------------------------------------------


def test_tilt_signs():
    assert (levelling(10, 0) @ [1, 0, 0])[2] == pytest.approx(np.sin(np.radians(10)))
    assert (levelling(0, 10) @ [0, -1, 0])[2] == pytest.approx(-np.sin(np.radians(10)))


@pytest.mark.parametrize("looks", ["up", "down", "forward"])
@pytest.mark.parametrize("angles", [(PITCH, ROLL), (-90.0, 0.0), (0.0, 180.0), (-3.3, 121.0)])
def test_mount_tilt_order(looks, angles):
    mount = Mount(looks, 33.0, pitch_deg=angles[0], roll_deg=angles[1])
    np.testing.assert_allclose(
        mount.rotation(), levelling(*angles) @ Mount(looks, 33.0).rotation(), atol=1e-15
    )
    assert mount.levelled == Mount(looks, 33.0)


@pytest.mark.parametrize("looks", ["up", "down"])
def test_tilted_projection_matches_shortest_path(looks):
    axes = [levelling(PITCH, ROLL) @ axis for axis in IMAGE_RIGHT_IS_FORWARD[looks]]
    sensor = replace(
        om.load_sensor("paper-spherical"), mount=Mount(looks, 0.0, pitch_deg=PITCH, roll_deg=ROLL)
    )
    for point in ([3000.0, 400.0, 0.0], [700.0, -900.0, 300.0], [-200.0, 300.0, -100.0]):
        expected = shortest_path_pixel(np.array(point), axes)
        np.testing.assert_allclose(sensor.project([point]).pixels[0], expected, atol=2e-3)


@pytest.mark.parametrize(
    "angles", [{"pitch_deg": 91.0}, {"roll_deg": -181.0}, {"pitch_deg": np.nan}]
)
def test_invalid_tilt_raises(angles):
    with pytest.raises(
        InvalidParameter, match=r"must be between -|pitch_deg must be a number; got nan"
    ):
        Mount(**angles)


# -- views -----------------------------------------------------------------------------------------

CAMERAS = {
    "sphere": om.load_sensor("paper-spherical"),
    "telecentric": om.load_sensor("paraboloid-telecentric"),
    "ocam": om.OCam(
        polynomial=(-131.0, 0.0, 1.7e-3, 1.7e-6),
        centre_px=(515.3, 382.3),
        image_size=(1024, 768),
        rim_radius_px=380.0,
    ),
    "stretched": om.OCam(
        polynomial=(-131.0, 0.0, 1.7e-3, 1.7e-6),
        centre_px=(515.3, 382.3),
        image_size=(1024, 768),
        affine=(0.99, 0.004, -0.003),
    ),
    "ball": om.MirrorBall(
        centre_px=(500.0, 500.0), rim_radius_px=499.0, field_deg=300.0, image_size=(1001, 1001)
    ),
}
NEAR = {"distance_mm": 700.0, "offset_mm": (60.0, -40.0, 30.0)}
VIEWS = {
    "panorama": om.screens.Cylinder((360, 120), -60.0, 45.0, pan_deg=20.0),
    "panorama near": om.screens.Cylinder((360, 120), -60.0, 45.0, distance_mm=700.0),
    "wall": om.screens.Cylinder((240, 120), -50.0, 30.0, 0.0, 200.0, "height", **NEAR),
    "sphere": om.screens.Equirectangular((240, 120)),
    "sphere near": om.screens.Equirectangular((240, 120), **NEAR),
    "perspective": om.screens.Plane((160, 120), 30.0, -35.0, 12.0, 80.0),
    "perspective near": om.screens.Plane((160, 120), 30.0, -35.0, 12.0, 80.0, **NEAR),
    "dome": om.screens.DomeMaster((160, 160), 110.0, "nadir", 15.0),
    "planet near": om.screens.LittlePlanet((160, 160), 200.0, "nadir", distance_mm=700.0),
    "ground": om.screens.Ground((160, 160), 600.0, 9.0, 10.0),
    "cube near": om.screens.CubeMap((240, 180), **NEAR),
    "mosaic": om.views.mosaic(CAMERAS["sphere"], (400, None), tilt_deg=-20.0, distance_mm=900.0),
}


@pytest.mark.parametrize("view", few(VIEWS, "panorama", "wall", "perspective near", "dome"))
@pytest.mark.parametrize("camera", CAMERAS)
def test_tilted_view_matches_rotated_scene(camera, view):
    """Both paths of a dewarper, with and without a map, against the projection of single points."""
    upright, screen = CAMERAS[camera], VIEWS[view]
    tilted = replace(upright, mount=replace(upright.mount, pitch_deg=PITCH, roll_deg=ROLL))
    coordinates = om.Dewarper(tilted, screen).coordinates()
    for left, top, part in parts_of(screen):
        width, height = part.size
        targets = part.targets_at(
            np.arange(width, dtype=float), np.arange(height, dtype=float)[:, None]
        )
        directions = targets.reshape(-1, 3) @ levelling(PITCH, ROLL)
        project = upright.project_directions if part.is_distant else upright.project
        expected = project(directions).pixels.reshape(height, width, 2)
        region = coordinates[top : top + height, left : left + width]
        differs = np.isnan(region[..., 0]) != np.isnan(expected[..., 0])
        assert differs.sum() <= 2, f"{differs.sum()} pixels are seen by one only"
        error = np.linalg.norm(region - expected, axis=-1)[
            ~np.isnan(region[..., 0]) & ~np.isnan(expected[..., 0])
        ]
        assert error.max(initial=0) < 0.01


def test_tilted_camera_is_not_separable():
    """Rows of a level panorama are circles for an upright camera only."""
    camera, view = CAMERAS["sphere"], VIEWS["panorama"]
    tilted = replace(camera, mount=replace(camera.mount, roll_deg=0.01))
    assert is_separable(camera, view)
    assert not is_separable(tilted, view)
    image = np.random.default_rng(1).integers(0, 256, (1024, 1024, 3), np.uint8)
    first, second = om.Dewarper(tilted, view, "linear"), om.Dewarper(tilted, view, "linear")
    second.coordinates()
    assert np.abs(first(image).astype(int) - second(image)).max() <= 2


def test_elevations_refer_to_horizon():
    """A field from -90 to 45 deg: forward is raised by 20, giving 65 deg ahead, and the nadir is
    still included."""
    sensor = om.load_sensor("paper-spherical")
    view = om.views.panorama(replace(sensor, mount=replace(sensor.mount, pitch_deg=20.0)))
    assert (view.tilt_min_deg, view.tilt_max_deg) == pytest.approx((-90.0, 65.0), abs=0.05)


# -- images ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def small() -> om.Sensor:
    return replace(om.load_sensor("paper-spherical"), imager=Imager(200, 200, 26.6))


@pytest.fixture(scope="module")
def world() -> om.Environment:
    x, y = np.meshgrid(np.linspace(0, 2 * np.pi, 128, endpoint=False), np.linspace(0, np.pi, 64))
    waves = 0.5 + 0.3 * np.sin(3 * x) * np.sin(y) + 0.2 * np.cos(4 * y)
    return om.Environment(np.repeat(waves[..., None], 3, axis=2).astype(np.float32))


def tilted_copy(sensor: om.Sensor) -> om.Sensor:
    return replace(sensor, mount=replace(sensor.mount, pitch_deg=PITCH, roll_deg=ROLL))


def test_tilted_sensor_matches_posed_sensor(small, world):
    image = om.render_image(tilted_copy(small), world, samples=1)
    placed = om.render_image(
        small, PosedScene(world, Pose(tilt_deg=PITCH, roll_deg=ROLL)), samples=1
    )
    assert np.abs(image.astype(int) - placed).max() <= 1
    assert (np.abs(image.astype(int) - om.render_image(small, world, samples=1)) > 20).mean() > 0.2


def test_tilted_sensor_image_is_levelled(small, world):
    """Its panorama of distant objects equals that of the levelled sensor; without the tilt it
    differs."""
    view = om.screens.Cylinder((240, 70), -50.0, 20.0)
    plumb = om.Dewarper(small, view)(om.render_image(small, world, samples=4)).astype(float)
    image = om.render_image(tilted_copy(small), world, samples=4)
    valid = om.Dewarper(tilted_copy(small), view).valid & om.Dewarper(small, view).valid
    assert valid.mean() > 0.8
    assert np.abs(om.Dewarper(tilted_copy(small), view)(image) - plumb)[valid].mean() < 1.0
    assert np.abs(om.Dewarper(small, view)(image) - plumb)[valid].mean() > 10


# -- panorama metadata -----------------------------------------------------------------------------


@pytest.mark.parametrize("pan", [0.0, 70.0, -135.0])
@pytest.mark.parametrize("angles", [(PITCH, ROLL), (-80.0, 150.0)])
def test_gpano_pose_levels_panorama(pan, angles):
    """GPano: pitch of the centre above the horizon, and a roll that rotates the horizon
    counter-clockwise."""
    pitch, roll = Mount(pitch_deg=angles[0], roll_deg=angles[1]).view_tilt_deg(pan)
    panned = (
        om.screens.Equirectangular((36, 18), pan_deg=pan).targets(0, 18).reshape(-1, 3)
    )  # directions of its tilted pixels
    forward_directions = (
        om.screens.Equirectangular((36, 18)).targets(0, 18).reshape(-1, 3)
    )  # ... relative to its centre
    truth, stored = panned @ levelling(*angles).T, forward_directions @ levelling(pitch, roll).T
    np.testing.assert_allclose(
        stored[:, 2], truth[:, 2], atol=1e-12
    )  # level; the heading requires a compass
    np.testing.assert_allclose(stored @ stored[40], truth @ truth[40], atol=1e-12)


@pytest.fixture
def folder(tmp_path, monkeypatch, small):
    monkeypatch.chdir(tmp_path)
    om.save_sensor(tilted_copy(small), "leaning.toml")
    om.save_sensor(small, "plumb.toml")
    om.write_image("a.png", np.random.default_rng(2).integers(0, 256, (200, 200, 3), np.uint8))
    return tmp_path


def dewarp(*args) -> np.ndarray:
    main(["dewarp", "a.png", *args, "--set=image.transparent=false", "-o", "out.png"])
    return om.read_image("out.png")


def estimated_pose() -> tuple[float, float]:
    metadata = xmp_of("out.png")
    return float(metadata["PosePitchDegrees"]), float(metadata["PoseRollDegrees"])


def test_command_line_levels_and_reports(folder):
    view = ("--elevation-deg=-60:40", "--size", "120x")
    by_file = dewarp("--sensor", "leaning.toml", *view)
    assert estimated_pose() == (0, 0)
    np.testing.assert_array_equal(
        dewarp("--sensor", "plumb.toml", f"--set=camera.level={PITCH},{ROLL}", *view), by_file
    )
    plumb = dewarp("--sensor", "plumb.toml", *view)
    assert (plumb != by_file).mean() > 0.5
    np.testing.assert_array_equal(
        dewarp("--sensor", "leaning.toml", "--set", "camera.level=0,0", *view), plumb
    )
    assert estimated_pose() == (0, 0)
    np.testing.assert_array_equal(
        dewarp("--sensor", "leaning.toml", "--set=camera.keep_tilt=true", *view), plumb
    )
    assert estimated_pose() == (PITCH, ROLL)
    dewarp("--sensor", "leaning.toml", "--set=camera.keep_tilt=true", "--pan-deg", "90", *view)
    assert estimated_pose() == pytest.approx(
        Mount(pitch_deg=PITCH, roll_deg=ROLL).view_tilt_deg(90.0), abs=1e-3
    )


def test_mirror_ball_and_omega_range_are_levelled(folder):
    ball = ("--ball", "99.5,99.5,98,260", "--elevation-deg=-60:40", "--size", "120x")
    assert (dewarp(*ball, "--set=camera.level=10,5") != dewarp(*ball)).mean() > 0.3
    upright = dewarp("--sensor", "plumb.toml", "--set", "view.omega_deg=30:130", "--size", "120x")
    tilted = dewarp("--sensor", "leaning.toml", "--set", "view.omega_deg=30:130", "--size", "120x")
    assert upright.shape == tilted.shape  # the same elevations


def test_invalid_tilt_on_command_line(folder, capsys):
    for text, message in (
        ("10", "must be PITCH,ROLL in degrees; got '10'"),
        ("95,0", "pitch_deg must be between -90 and 90 deg; got 95"),
    ):
        with pytest.raises(SystemExit, match=r"^[12]$"):
            main(
                [
                    "dewarp",
                    "a.png",
                    "--sensor",
                    "plumb.toml",
                    "--set",
                    f"camera.level={text}",
                    "-o",
                    "no.png",
                ]
            )
        assert message in " ".join(capsys.readouterr().err.split())


def test_tilt_in_sensor_file():
    sensor = tilted_copy(om.load_sensor("paper-spherical"))
    assert parse_sensor(format_sensor(sensor)) == sensor
    assert "pitch_deg" not in format_sensor(replace(sensor, mount=sensor.mount.levelled))
    with pytest.raises(OmnimirrorError, match=r"mount\.pitch_deg must be"):
        parse_sensor(format_sensor(sensor).replace("pitch_deg = 24.0", "pitch_deg = 100.0"))
