"""Conversion errors, rejected conversions, and accuracy of the reported errors."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError, SpecError
from omnimirror.calibration.conversion import convert
from omnimirror.calibration.formats import FORMATS
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import KannalaBrandt, OCam, Unified, ViewpointSpline
from omnimirror.optics.mirrors.mirror import MirrorPose
from tests.everyday import few

SAMPLE = Path(__file__).parents[3] / "shared/data/ocamcalib_cpp_sample"
needs_sample = pytest.mark.skipif(not SAMPLE.exists(), reason=f"no sample files at {SAMPLE}")
F, C, SIZE = (260.0, 261.3), (515.32, 380.29), (1024, 768)
MIRROR = OCam(
    polynomial=(-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10),
    centre_px=C,
    image_size=SIZE,
    affine=(0.9998, 4.4e-4, 8e-5),
)
FISHEYE = OCam(
    polynomial=(-551.8, 0.0, 8.4e-4, -6.5e-7, 1.2e-9),
    centre_px=(505.5, 381.8),
    image_size=SIZE,
    optics="fisheye",
)
SENSOR = om.load_sensor("paper-spherical")
FITTED = [
    name
    for kind in FORMATS.values()
    for name in kind.layouts
    if name not in ("camera", "sensor") and "equirect" not in name
]


def errors_px(camera, other, distance_mm=np.inf, viewpoint_mm=(0.0, 0.0, 0.0), count=40000):
    """Return the image distance of two cameras for the same points, px, over random pixels of the
    first."""
    pixels = np.random.default_rng(9).uniform(0, np.array(camera.image_size) - 1, (count, 2))
    origins, directions, valid = camera.backproject(pixels)
    origins, directions = origins[valid], directions[valid]
    if np.isinf(distance_mm):
        projection = other.project_directions(directions)
    else:
        along = np.sum(origins * directions, axis=1)
        s = np.sqrt(distance_mm**2 - np.sum(origins**2, axis=1) + along**2) - along
        projection = other.project(
            origins + s[:, None] * directions - camera.mount.rotation() @ viewpoint_mm
        )
    error = np.hypot(*(projection.pixels - pixels[valid]).T)
    return error[projection.valid], projection.valid.mean()


@needs_sample
@pytest.mark.parametrize(("name", "optics"), [("catadioptric", "mirror"), ("fisheye", "fisheye")])
def test_ocamcalib_files_round_trip_through_all_formats(tmp_path, name, optics):
    source = SAMPLE / f"calib_results_{name}.txt"
    camera = om.load_ocam(source, optics)
    for to, file in (
        ("ocamcalib", "a.txt"),
        ("py-ocamcalib", "a.json"),
        ("matlab", "a.m"),
        ("camera", "a.toml"),
    ):
        conversion = om.convert(source, tmp_path / file, to=to, optics=optics)
        assert conversion.exact
        restored = om.convert(tmp_path / file, tmp_path / "back.txt", to="ocamcalib", optics=optics)
        refit = om.load_ocam(tmp_path / "back.txt", optics)
        error, share = errors_px(camera, refit)
        assert (restored.exact, share) == (True, 1.0)
        assert error.max() < 1e-9
        np.testing.assert_allclose(refit.polynomial, camera.polynomial, rtol=1e-9)


@pytest.mark.parametrize("to", FITTED)
@pytest.mark.parametrize("camera", few([MIRROR, FISHEYE], MIRROR), ids=["mirror", "fisheye"])
def test_conversion_reports_true_error(tmp_path, to, camera):
    """At other pixels, from the file as read back: at most the reported error, and only slightly
    less."""
    is_pinhole = to in ("ros-plumb-bob", "ros-rational", "opencv-pinhole", "opencv-rational")
    field = {"field_deg": 60.0} if is_pinhole else {}
    conversion = convert(camera, tmp_path / "a.txt", to=to, tolerance_px=30.0, **field)
    if conversion.exact:
        return
    image = replace(conversion.camera, rim_radius_px=None)
    error, share = errors_px(camera, image)
    if not field:
        assert error.max() <= conversion.largest_px * 1.05 + 1e-9
        assert np.sqrt(np.mean(error**2)) == pytest.approx(conversion.rms_px, rel=0.1)
        assert share > 0.98
    restored = convert(tmp_path / "a.txt", tmp_path / "again.txt", to=to, optics=camera.optics)
    assert restored.exact
    assert (tmp_path / "again.txt").read_bytes() == (tmp_path / "a.txt").read_bytes()


def test_conversion_finds_equivalent_model(tmp_path):
    """xi = 1 without distortion is a paraboloid: exactly f(rho) = (rho^2/f - f) / 2 of OCamCalib."""
    camera = Unified(xi=1.0, focal_px=(200.0, 200.0), centre_px=(511.5, 383.5), image_size=SIZE)
    conversion = convert(camera, tmp_path / "a.txt", to="ocamcalib", tolerance_px=1e-6)
    assert conversion.largest_px < 1e-6
    np.testing.assert_allclose(
        conversion.camera.polynomial[:3], [-100.0, 0.0, 1 / 400], rtol=1e-7, atol=1e-12
    )


def test_conversion_preserves_directions_of_skewed_image(tmp_path):
    """A skew is a rotation combined with d of OCamCalib; the frame of the file must not be rotated
    by it."""
    camera = Unified(xi=0.9, focal_px=F, centre_px=C, image_size=SIZE, skew_px=6.0)
    conversion = convert(camera, tmp_path / "a.txt", to="ocamcalib", tolerance_px=0.1)
    assert conversion.largest_px < 0.1


def test_conversion_without_tolerance_raises_with_error(tmp_path):
    with pytest.raises(
        InvalidParameter, match=r"opencv-omnidir stores .*; this camera is ocam; .* px rms"
    ) as e:
        convert(MIRROR, tmp_path / "a.yaml", to="opencv-omnidir")
    largest = float(re.search(r"at most ([\d.]+) px", str(e.value))[1])
    assert not list(tmp_path.iterdir())
    with pytest.raises(InvalidParameter, match=r"at most tolerance_px"):
        convert(MIRROR, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=largest * 0.98)
    assert (
        convert(
            MIRROR, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=largest * 1.02
        ).largest_px
        <= largest * 1.02
    )


def test_pinhole_rejects_field_of_90_deg(tmp_path):
    with pytest.raises(InvalidParameter, match=r"plumb_bob.* 90 deg.*field_deg"):
        convert(MIRROR, tmp_path / "camera_info.yaml", to="ros-plumb-bob", tolerance_px=100.0)
    conversion = convert(
        MIRROR, tmp_path / "camera_info.yaml", to="ros-plumb-bob", tolerance_px=1.0, field_deg=60.0
    )
    assert conversion.largest_px < 1.0


def test_format_selects_best_model(tmp_path):
    mirror = KannalaBrandt(
        focal_px=F,
        centre_px=C,
        image_size=SIZE,
        k1=-0.02,
        k2=0.003,
        skew_px=0.1,
        optics="mirror",
        rim_radius_px=420.0,
    )
    best = convert(mirror, tmp_path / "camchain.yaml", tolerance_px=5.0)
    costs = {
        to: convert(mirror, tmp_path / "b.yaml", to=f"kalibr-{to}", tolerance_px=50.0).largest_px
        for to in ("omni", "eucm", "ds", "equi")
    }
    assert best.largest_px == min(cost for to, cost in costs.items() if to != "equi")
    assert costs["equi"] < best.largest_px  # more accurate, but limited to 90 deg
    exact = convert(
        KannalaBrandt(focal_px=F, centre_px=C, image_size=SIZE, k1=0.02, optics="fisheye"),
        tmp_path / "camchain.yaml",
    )
    assert (exact.target, exact.exact) == ("kalibr-equi", True)


@pytest.mark.parametrize(
    "to",
    [
        "ocamcalib",
        *(pytest.param(to, marks=pytest.mark.full) for to in ("opencv-omnidir", "kalibr-ds")),
    ],
)
def test_sensor_without_viewpoint_error_depends_on_distance(tmp_path, to):
    """Real rays of the sensor at each distance, against the single viewpoint of the file."""
    far = (500, 3000, np.inf)
    conversion = convert(SENSOR, tmp_path / "a.yaml", to=to, tolerance_px=20.0, distance_mm=far)
    assert [c.distance_mm for c in conversion.costs] == list(far)
    for c in conversion.costs:
        error, share = errors_px(
            SENSOR, conversion.camera, c.distance_mm, conversion.viewpoint_mm, 20000
        )
        assert error.max() == pytest.approx(c.largest_px, rel=0.1, abs=0.01)
        assert np.sqrt(np.mean(error**2)) == pytest.approx(c.rms_px, rel=0.05, abs=0.005)
        assert share > 0.95
    distant = convert(SENSOR, tmp_path / "a.yaml", to=to, tolerance_px=20.0, distance_mm=np.inf)
    assert distant.rms_px < conversion.costs[-1].rms_px


@pytest.mark.full
def test_the_viewpoint_of_a_hyperboloid_is_its_focus(tmp_path):
    """Foci of z = -B + B/A sqrt(A^2 + x^2): one is the lens, the other is sqrt(A^2 + B^2) - B
    behind the vertex."""
    sensor = om.load_sensor("prototype-hyperboloidal")
    conversion = convert(sensor, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=0.001)
    a, b = sensor.mirror.a_mm, sensor.mirror.b_mm
    np.testing.assert_allclose(conversion.viewpoint_mm, [0, 0, np.hypot(a, b) - b], atol=1e-4)


def test_panorama_format_error_depends_on_distance(tmp_path):
    """COLMAP's formula for the pixels of the panorama; and real rays of a near point against those
    of the panorama."""
    conversion = convert(
        SENSOR, tmp_path / "cameras.txt", to="colmap-equirectangular", distance_mm=(800.0, np.inf)
    )
    _, model, width, height, *numbers = (
        (tmp_path / "cameras.txt").read_text().splitlines()[-1].split()
    )
    assert (model, float(width), float(height)) == ("EQUIRECTANGULAR", *map(float, numbers))
    sphere = om.views.sphere(SENSOR)
    assert sphere.size == (int(width), int(height))
    u, v = np.random.default_rng(1).uniform(0, 1, (2, 200)) * np.array(
        [[sphere.size[0] - 1], [sphere.size[1] - 1]]
    )
    x, y, z = sphere.targets_at(u, v).T
    right, down, ahead = -y, -z, x
    theta, phi = np.arctan2(right, ahead), np.arctan2(-down, np.hypot(right, ahead))
    np.testing.assert_allclose((theta / (2 * np.pi) + 0.5) * sphere.size[0] - 0.5, u, atol=1e-9)
    np.testing.assert_allclose((0.5 - phi / np.pi) * sphere.size[1] - 0.5, v, atol=1e-9)
    near, far = conversion.costs
    assert far.largest_px < 1e-6
    assert 0.01 < near.rms_px <= near.largest_px
    origins, directions, valid = SENSOR.backproject(np.array([near.at_px]))
    origin, direction = (a[valid][0] for a in (origins, directions))
    along = origin @ direction
    point = origin + (np.sqrt(800.0**2 - origin @ origin + along**2) - along) * direction
    towards = point - SENSOR.mount.rotation() @ conversion.viewpoint_mm
    angle = np.degrees(np.arccos(towards @ direction / np.linalg.norm(towards)))
    assert angle * sphere.size[0] / 360 == pytest.approx(near.largest_px, rel=1e-6)
    assert any("omnimirror dewarp --view sphere" in note for note in conversion.notes)
    assert convert(MIRROR, tmp_path / "cameras.bin", to="colmap-bin-equirectangular").exact


def test_note_reports_handedness_of_frame(tmp_path):
    plain = convert(MIRROR, tmp_path / "a.json", to="py-ocamcalib")
    assert any("left-handed" in note for note in plain.notes)
    flipped = convert(MIRROR, tmp_path / "b.json", to="py-ocamcalib", flip=True)
    assert not any("left-handed; flip" in note for note in flipped.notes)
    assert not any(
        "left-handed" in n for n in convert(FISHEYE, tmp_path / "c.json", to="py-ocamcalib").notes
    )
    restored = convert(
        tmp_path / "b.json",
        tmp_path / "d.json",
        to="py-ocamcalib",
        flip=True,
        mount=Mount(image_flipped=True),
    )
    a, d = (om.convert(tmp_path / n, tmp_path / "x.toml").camera for n in ("a.json", "d.json"))
    assert restored.camera.is_image_reversed
    assert errors_px(a, d)[0].max() < 1e-9


@pytest.mark.parametrize(("flip", "right_handed"), [(False, -1), (True, 1)])
def test_boards_require_a_right_handed_mirror_frame(tmp_path, flip, right_handed):
    """Three world directions, right-handed, as located in the image by a program without mirror
    models."""
    conversion = convert(MIRROR, tmp_path / "a.json", to="py-ocamcalib", flip=flip)
    corner = np.array([[1.0, 0.1, -0.6], [0.9, 0.25, -0.6], [0.95, 0.1, -0.45]])
    assert np.linalg.det(corner) > 0
    pixels = MIRROR.project_directions(corner).pixels
    pixels[:, 0] = SIZE[0] - 1 - pixels[:, 0] if flip else pixels[:, 0]
    plain = om.convert(tmp_path / "a.json", tmp_path / "a.toml", optics="fisheye").camera
    assert np.sign(np.linalg.det(plain.backproject(pixels).directions)) == right_handed
    assert conversion.camera.is_image_reversed != flip


def test_rig_file_returns_requested_camera(tmp_path):
    for i, camera in enumerate(
        (
            KannalaBrandt(focal_px=F, centre_px=C, image_size=SIZE),
            Unified(xi=0.9, focal_px=F, centre_px=C, image_size=SIZE),
        )
    ):
        convert(camera, tmp_path / f"{i}.yaml", to="kalibr")
    second = (tmp_path / "1.yaml").read_text().replace("cam0", "cam1")
    (tmp_path / "rig.yaml").write_text((tmp_path / "0.yaml").read_text() + second)
    kinds = [
        convert(tmp_path / "rig.yaml", tmp_path / "a.toml", camera=c).camera.KIND
        for c in (0, 1, "cam0", "cam1")
    ]
    assert kinds == ["kannala-brandt", "unified", "kannala-brandt", "unified"]
    with pytest.raises(InvalidParameter, match="index from 0 to 1"):
        convert(tmp_path / "rig.yaml", tmp_path / "a.toml", camera=2)
    with pytest.raises(InvalidParameter, match="must be one of cam0, cam1"):
        convert(tmp_path / "rig.yaml", tmp_path / "a.toml", camera="left")


CHAIN, OMNI, COLMAP, JSON = "camchain.yaml", "a.yaml", "cameras.txt", "a.json"
MATRIX = "camera_matrix:\n  data: [9,0,2,0,9,2,0,0,1]\n"
INVALID_ARGUMENTS = [
    (CHAIN, "cam0:\n  camera_model: fish\n", r"line 2: cam0.camera_model must be one of omni"),
    (
        CHAIN,
        "cam0:\n  camera_model: ds\n  intrinsics: [1, 2]\n  resolution: [4, 4]\n",
        r"line 3: cam0.intrinsics must have 6 numbers; got 2",
    ),
    (
        CHAIN,
        "cam0: [1\ncamera_model",
        r"camchain\.yaml line 2 must be valid YAML: did not find expected ',' or '\]'",
    ),
    (
        OMNI,
        "camera_matrix: &a [1]\nxi: *a\n",
        r"a\.yaml line 2: aliases \(\*a\) are not supported; repeat the value",
    ),
    (
        OMNI,
        "camera_matrix:\n  rows: 3\n  data: [1, 2]\nxi: 1\n",
        r"line 3: camera_matrix.data must have 9 numbers; got 2",
    ),
    (
        OMNI,
        MATRIX + "xi: x\ndistortion_coefficients: [0,0,0,0]\n",
        r"line 3: xi must be a finite number; got 'x'",
    ),
    (
        OMNI,
        MATRIX + "xi: 1\ndistortion_coefficients: [0,0,0,0]\n",
        r"does not contain the image size",
    ),
    (COLMAP, "# c\n1 EUCM 640 480 1 2\n", r"line 2: EUCM must have 6 parameters, fx fy"),
    (COLMAP, "1 FISHY 640 480 1 2\n", r"not recognised"),
    (COLMAP, "1 EQUIRECTANGULAR 640 320 640 320\n", r"EQUIRECTANGULAR describes a panorama"),
    (
        JSON,
        '{"taylor_coefficient": [300, 0, -0.001],\n "distortion_center": [1, 2}',
        r"line 2 is not valid JSON",
    ),
    (
        JSON,
        '{"taylor_coefficient": [300, 0, -0.001], "distortion_centre": [1, 2]}',
        r"must contain distortion_center; did you mean distortion_centre",
    ),
    (
        "a.m",
        "x = 1;\ni = fisheyeIntrinsics([1 2 3], [4 4]);",
        r"line 2: fisheyeIntrinsics must have 3 or 4 arguments in brackets",
    ),
    (JSON, '{"rms_px": 0.1, "held_out_rms_px": 0.1}', r"contains the results of a calibration"),
    ("a.txt", "what is this", r"is not recognised as a camera file"),
]


@pytest.mark.parametrize(("name", "text", "message"), INVALID_ARGUMENTS)
def test_invalid_file_raises_with_line(tmp_path, name, text, message):
    (tmp_path / name).write_text(text)
    with pytest.raises(SpecError, match=message) as e:
        convert(tmp_path / name, tmp_path / "out.toml")
    assert name in str(e.value)
    assert "\n" not in str(e.value)
    assert not (tmp_path / "out.toml").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"to": "kalibre"}, "to must be one of ocamcalib"),
        ({"to": None}, "cannot be inferred from its name"),
        ({"optics": "lens"}, "optics must be one of mirror, fisheye; got 'lens'"),
        ({"tolerance_px": -1.0}, r"tolerance_px must be greater than 0 px and finite; got -1\.0"),
        ({"distance_mm": [0.0]}, "distance_mm must be at least 1e-09 mm, or inf; got 0"),
        ({"distance_mm": "far"}, "distance_mm"),
        (
            {"field_deg": 200.0},
            r"field_deg must be greater than 0 deg and at most 180 deg; got 200\.0",
        ),
        (
            {"inner_deg": -1.0},
            r"inner_deg must be greater than 0 deg and at most 180 deg; got -1\.0",
        ),
        (
            {"inner_deg": 179.0, "tolerance_px": 1.0},
            "inner_deg and field_deg must include part of the field",
        ),
        ({"inner_deg": 50.0, "field_deg": 40.0}, "got inner_deg = 50 and field_deg = 40"),
        ({"rim_radius_px": 0.0}, r"rim_radius_px must be greater than 0 px and finite; got 0\.0"),
        ({"image_size": (3,)}, "image_size"),
    ],
)
def test_invalid_arguments_raise(tmp_path, changes, message):
    with pytest.raises(OmnimirrorError, match=message):
        convert(MIRROR, tmp_path / "a.what", **{"to": "kalibr-omni", **changes})


CALIBRATED = """
[mirror]
kind = "conic-asphere"
vertex_radius_mm = 6.32
conic = -8.91
rim_radius_mm = 42.8
coefficients = [0.904, -0.957, 0.701, -0.197]
normalization_radius_mm = 40.0
[lens]
kind = "perspective"
focal_length_mm = 14.19
f_number = 8.0
focus_distance_mm = 240.0
[imager]
width_px = 640
height_px = 480
pixel_pitch_um = 5.0
[mount]
mirror_distance_mm = 570.0
"""
"""Camera with a mirror, calibrated with its own reflection within 54 px, about 45 deg, of the image
centre."""


def test_central_obscuration_can_be_excluded(tmp_path):
    (tmp_path / "sensor.toml").write_text(CALIBRATED)
    sensor = om.load_sensor(tmp_path / "sensor.toml")
    complete, outside = (
        convert(sensor, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=1e3, **more)
        for more in ({}, {"inner_deg": 60.0})
    )
    assert complete.largest_px > 4 * outside.largest_px
    assert all(cost.at_deg >= 60.0 for cost in outside.costs)
    pixels = np.array([[320.0, 90.0], [490.0, 260.0], [230.0, 380.0]])
    rays = sensor.backproject(pixels)
    points = rays.origins + 3000.0 * rays.directions
    projected, is_valid = outside.camera.project(points - rays.origins.mean(axis=0))
    assert is_valid.all()
    assert np.linalg.norm(projected - pixels, axis=1).max() <= 1.1 * outside.largest_px


def test_distance_inside_sensor_raises(tmp_path):
    with pytest.raises(InvalidParameter, match="larger than the distances of the ray origins"):
        convert(
            SENSOR, tmp_path / "a.yaml", to="opencv-omnidir", tolerance_px=99.0, distance_mm=5.0
        )


def test_viewpoint_motion_is_reported_by_distance(tmp_path):
    camera = ViewpointSpline.from_model(
        Unified(xi=0.95, focal_px=(120.0, 120.0), centre_px=(319.5, 239.5), image_size=(640, 480)),
        6,
        200.0,
    )
    values = [
        p.value + (3.0 if p.unit == "mm" and p.name.endswith(("5", "6")) else 0.0)
        for p in camera.parameters
    ]
    conversion = convert(
        camera.with_parameters(values), tmp_path / "a.txt", to="ocamcalib", tolerance_px=50.0
    )
    near, *_, far = conversion.costs
    assert (near.distance_mm, far.distance_mm) == (500.0, np.inf)
    assert near.largest_px > 0.05


def test_misaligned_sensor_is_converted(tmp_path):
    """Tilted mirror without rotational symmetry of the image, flipped too; the error is that of
    real rays."""
    pose = MirrorPose(1.5, -0.8, 0.6, 1.2, -2.0)
    sensor = replace(SENSOR, mirror_pose=pose, mount=replace(SENSOR.mount, image_flipped=True))
    for camera in (sensor, om.SensorModel(sensor)):
        conversion = convert(
            camera, tmp_path / "a.yaml", to="colmap-rad-tan-thin-prism-fisheye", tolerance_px=30.0
        )
        error, share = errors_px(sensor, conversion.camera, 1000.0, conversion.viewpoint_mm, 4000)
        (cost,) = (c for c in conversion.costs if c.distance_mm == 1000.0)
        assert error.max() <= cost.largest_px * 1.1
        assert np.sqrt(np.mean(error**2)) == pytest.approx(cost.rms_px, rel=0.1)
        assert share > 0.95
    assert convert(om.SensorModel(sensor), tmp_path / "a.toml").target == "sensor"


@pytest.mark.parametrize(
    "name", ["folded-hyperboloidal", "paraboloid-telecentric", "paper-hyperboloidal"]
)
def test_single_viewpoint_sensors_convert_exactly(tmp_path, name):
    conversion = convert(name, tmp_path / "a.txt", to="ocamcalib", tolerance_px=0.01)
    assert conversion.camera.is_backward_facing == (name != "folded-hyperboloidal")
    np.testing.assert_allclose(conversion.viewpoint_mm[:2], 0, atol=1e-4)
