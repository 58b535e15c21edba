"""Lens with an entrance pupil away from its principal point, against two thin lenses with a stop.

The reference is traced here, lens by lens: a thin lens of focal length f changes the slope of a ray
by -y/f. Principal point and entrance pupil of the pair follow from its matrices, independent of the
package.
"""

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.lenses import Perspective
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.optics.sensor_files import format_sensor
from omnimirror.simulation.pixel_rays import sampling_plan
from omnimirror.simulation.radiometry import Radiometry
from omnimirror.simulation.rendering import _trace_natively, _trace_sensor

PITCH = 5.2e-3
A, RIM = 50.0, 44.0
ALIGNED = MirrorPose()
FOCUS = 212.0  # from the principal point


class Pair:
    """Two thin lenses with a stop in between, and the imager position for an object in focus."""

    def __init__(self, front, back, to_stop, from_stop):
        self.front, self.back, self.to_stop, self.from_stop = front, back, to_stop, from_stop
        d = to_stop + from_stop
        self.focal = front * back / (front + back - d)
        self.principal = -self.focal * d / back  # towards the mirror from the front lens
        self.principal_behind = -self.focal * d / front  # towards the imager from the back lens
        self.pupil = (
            to_stop * front / (to_stop - front)
        )  # image of the stop by the front lens, towards the mirror
        self.magnification = front / (front - to_stop)

    def out(self, image, stop, imager):
        """Return position (n, 2) at the front lens and slope (n, 2) of rays from image points
        through points of the stop."""
        # at the back lens at height y: from the image point, deflected by -y/f, to the stop
        y = (stop + self.from_stop * image / imager) / (
            1 + self.from_stop * (1 / imager - 1 / self.back)
        )
        slope = (stop - y) / self.from_stop
        at_front = stop + self.to_stop * slope
        return at_front, slope - at_front / self.front


PAIRS = {
    "pupil before the principal point": Pair(90.0, 13.0, 1.0, 9.0),
    "pupil behind it": Pair(30.0, 40.0, 9.0, 2.0),
    "front group that spreads": Pair(-40.0, 10.0, 6.0, 3.0),
}


def unit(v):
    return v / np.linalg.norm(v, axis=-1, keepdims=True)


def reflected(start, direction, vertex):
    """Return intersections and directions of rays reflected by the sphere of radius A with its
    vertex at ``vertex``."""
    d, centre = unit(direction), vertex + np.array([0.0, 0.0, A])
    to = start - centre
    along = (to * d).sum(-1)
    t = -along - np.sqrt(along**2 - (to**2).sum(-1) + A**2)
    points = start + t[:, None] * d
    normal = (points - centre) / A
    return points, d - 2 * (d * normal).sum(-1, keepdims=True) * normal


def truth(pair, sensor, pixels, pupil):
    """Return rays (n, 3), (n, 3) from image points through the stop of the pair and the mirror at
    the vertex of the pose."""
    lens = sensor.lens
    imager = 1 / (1 / pair.focal - 1 / FOCUS) + pair.principal_behind
    stop = pair.focal / lens.f_number / 2 / pair.magnification * pupil
    image = -(pixels - 511.5) * PITCH  # the lens inverts the image
    at, slope = pair.out(image, stop, imager)
    front = -sensor.mirror_distance_mm - pair.principal
    start = np.concatenate([at, np.full((len(at), 1), front)], axis=1)
    return reflected(
        start, np.concatenate([slope, np.ones((len(at), 1))], axis=1), sensor.mirror_pose.shift
    )


def sensor_of(pair, f_number=4.0, pose=ALIGNED):
    lens = Perspective(pair.focal, f_number, FOCUS, entrance_pupil_mm=pair.pupil - pair.principal)
    imager = om.load_sensor("paper-spherical").imager
    return om.Sensor(Sphere(A, RIM), lens, imager, mirror_distance_mm=180.0, mirror_pose=pose)


@pytest.fixture(params=PAIRS)
def pair(request):
    return PAIRS[request.param]


def pixels_and_pupil(sensor, seed=0):
    rng = np.random.default_rng(seed)
    turn, r = rng.uniform(0, 2 * np.pi, 60), np.sqrt(rng.uniform(0.01, 1, 60))
    pupil = np.sqrt(rng.uniform(0, 1, 60))[:, None] * unit(rng.normal(size=(60, 2)))
    reach = 0.97 * min(sensor.aligned().rim_radius_px, 505.0)
    return 511.5 + reach * (r * np.stack([np.cos(turn), np.sin(turn)])).T, pupil


def test_lens_pair_pupil_positions(pair):
    """Precondition of the following tests: both are several millimetres from the principal point,
    on opposite sides."""
    assert abs(pair.pupil - pair.principal) > 2
    assert {np.sign(p.pupil - p.principal) for p in PAIRS.values()} == {-1.0, 1.0}


def test_chief_rays_through_entrance_pupil(pair):
    sensor = sensor_of(pair)
    pixels, _ = pixels_and_pupil(sensor)
    points, directions = truth(pair, sensor, pixels, np.zeros((1, 2)))
    rays = sensor.backproject(pixels)
    assert rays.valid.all()
    to_camera = sensor.mount.rotation()
    assert np.abs(rays.origins @ to_camera - points).max() < 1e-9
    assert np.abs(rays.directions @ to_camera - directions).max() < 1e-11


@pytest.mark.parametrize(
    "pose", [MirrorPose(), MirrorPose(decentre_x_mm=0.7, displacement_mm=-1.0)]
)
def test_aperture_rays_through_entrance_pupil(pair, pose):
    sensor = sensor_of(pair, pose=pose)
    pixels, pupil = pixels_and_pupil(sensor)
    _, directions = truth(pair, sensor, pixels, pupil)
    rays = sensor.aperture_rays(pixels, pupil)
    to_camera = sensor.mount.rotation()
    valid = rays.valid
    assert valid.sum() > 50
    assert np.abs((rays.directions @ to_camera - directions)[valid]).max() < 1e-10


@pytest.mark.parametrize(
    "pose", [MirrorPose(), MirrorPose(decentre_x_mm=0.7, displacement_mm=-1.0)]
)
def test_projection_round_trip(pair, pose):
    sensor = sensor_of(pair, pose=pose)
    pixels, _ = pixels_and_pupil(sensor)
    points, directions = truth(pair, sensor, pixels, np.zeros((1, 2)))
    to_world = sensor.mount.rotation().T
    for projection in (
        sensor.project((points + 90.0 * directions) @ to_world),
        sensor.project_directions(directions @ to_world),
    ):
        assert projection.valid.sum() > 50
        assert np.abs((projection.pixels - pixels)[projection.valid]).max() < 1e-7


def test_blur_matches_thin_bundles(pair):
    """Both edges of an aperture of F/100, whose bundles have no coma."""
    sensor = sensor_of(pair, f_number=100.0)
    h = np.array([50.0, 200.0, 350.0])
    pixels = 511.5 + np.stack([h, 0 * h], axis=1)
    evaluation = om.evaluate(sensor, h_px=h)
    for edge, blur in (([1.0, 0.0], evaluation.blur_t_deg), ([0.0, 1.0], evaluation.blur_s_deg)):
        ends = [truth(pair, sensor, pixels, s * np.array([edge]))[1] for s in (1, -1)]
        apart = np.degrees(np.linalg.norm(np.cross(*ends), axis=1))
        # angle on the sky across the meridian, in the convention of the evaluation: per degree of
        # the object
        assert np.abs(blur) == pytest.approx(apart, rel=2e-4)


def test_rendered_rays_start_at_entrance_pupil(pair):
    """Compiled and NumPy rays pass the full aperture."""
    sensor = sensor_of(pair)
    plan, part = sampling_plan(8, True), (slice(300, 302), slice(200, 240))
    native, plain = (f(sensor, plan, Radiometry(), *part) for f in (_trace_natively, _trace_sensor))
    assert (native.outcome == plain.outcome).all()
    assert np.abs(unit(native.directions) - unit(plain.directions)).max() < 1e-5
    assert np.abs(native.origins - plain.origins).max() < 1e-3


def test_depth_of_field_at_one_pixel_blur(pair):
    lens = sensor_of(pair).lens
    near, far = lens.depth_of_field(PITCH)
    assert np.abs(lens.blur(np.array([near, far]))) == pytest.approx(PITCH, rel=1e-9)


def test_spots_match_blur(pair):
    check = om.check_blur(sensor_of(pair), [50.0], omega_deg=[20.0, 60.0, 90.0])
    assert check.max_abs("edge_t_px")[0] < 1e-4
    assert check.max_abs("edge_s_px")[0] < 1e-4


def test_distance_reference_point_matters():
    """The same mirror distance, from the principal point and from a pupil 5 mm before it.

    A displaced pupil alone scarcely changes the image: the scale of focused objects does not depend
    on it.
    """
    sensor = om.load_sensor("paper-spherical")
    lens, m, omega = (
        replace(sensor.lens, entrance_pupil_mm=5.0),
        sensor.mirror_distance_mm,
        np.linspace(0.0, 130.0, 27),
    )
    h = om.evaluate(sensor, omega).h_px
    from_pupil = om.evaluate(replace(sensor, lens=lens, mirror_distance_mm=m + 5.0), omega).h_px
    from_principal = om.evaluate(replace(sensor, lens=lens), omega).h_px
    assert 10 < np.abs(from_pupil - h).max() < 12.5
    assert 0.1 < np.abs(from_principal - h).max() < 0.3


def test_exported_lens_files_use_pupil(pair, tmp_path):
    """Its distance from the mirror is that of the pupil, with the same image points and focal
    plane."""
    sensor = sensor_of(pair)
    [export] = om.export(sensor, tmp_path, formats=["zmx"])
    lines = [line.split() for line in export.path.read_text(encoding="utf-16").splitlines()]
    to_lens, to_mirror = [float(fields[1]) for fields in lines if fields[0] == "DISZ"][:2]
    focal = next(float(fields[2]) for fields in lines if fields[:2] == ["PARM", "1"])
    imager = 1 / (1 / pair.focal - 1 / FOCUS) + pair.principal_behind
    _, slope = pair.out(
        np.array([[1.0, 0.0]]), np.zeros((1, 2)), imager
    )  # chief ray of 1 mm off the axis
    assert to_mirror == pytest.approx(180.0 - (pair.pupil - pair.principal), abs=1e-9)
    assert 1 / to_lens == pytest.approx(abs(slope[0, 0]), rel=1e-9)
    assert 1 / (1 / focal - 1 / to_lens) == pytest.approx(
        FOCUS - (pair.pupil - pair.principal), rel=1e-9
    )


def test_entrance_pupil_in_sensor_files():
    sensor = sensor_of(PAIRS["pupil behind it"])
    assert om.parse_sensor(format_sensor(sensor)) == sensor


@pytest.mark.parametrize(
    ("pupil", "distance", "message"),
    [
        (300.0, 180.0, "the position of the entrance pupil"),
        (190.0, 180.0, "mirror_distance_mm must be greater than"),
    ],
)
def test_invalid_pupil_positions_rejected(pupil, distance, message):
    sensor = om.load_sensor("paper-spherical")
    with pytest.raises(InvalidParameter, match=message):
        om.evaluate(
            replace(
                sensor,
                lens=replace(sensor.lens, entrance_pupil_mm=pupil),
                mirror_distance_mm=distance,
            )
        )
