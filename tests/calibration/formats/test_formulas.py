"""Written files, parsed independently and projected by the formula of each program, written out or
called."""

import json
import re
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

import omnimirror as om
from omnimirror.base.errors import SpecError
from omnimirror.calibration.formats import ReadOptions, _colmap, read_cameras
from omnimirror.calibration.formats._camera_format import CameraFile
from omnimirror.cameras.camera import Mount
from omnimirror.cameras.models import (
    DoubleSphere,
    EnhancedUnified,
    Unified,
)
from tests.calibration.formats.examples import (
    KANNALA_BRANDT,
    OCAM,
    RATIONAL,
    SIZE,
    UNIFIED,
    C,
    F,
    projected_points,
)

UNSKEWED = replace(UNIFIED, skew_px=0.0)
FISHEYE = replace(KANNALA_BRANDT, optics="fisheye")
SKEWED = replace(FISHEYE, skew_px=0.4)


def test_ocamcalibs_inverse_polynomial_projects_as_its_direct_one(tmp_path):
    """world2cam.m of OCamCalib, with the fitted polynomial: within its 0.01 px."""
    om.convert(OCAM, tmp_path / "calib_results.txt")
    rows = [
        [float(w) for w in line.split()]
        for line in (tmp_path / "calib_results.txt").read_text().splitlines()
        if line and not line.startswith("#")
    ]
    (_, *_), (_, *inverse), (xc, yc), (c, d, e), size = rows
    assert size == [768, 1024]
    pixels, (right, down, z) = (projected := projected_points(OCAM))[0], projected[1].T
    norm = np.hypot(right, down)
    theta = np.arctan(-z / norm)
    rho = sum(a * theta**i for i, a in enumerate(inverse))
    x, y = down / norm * rho, right / norm * rho
    expected = np.stack([x * e + y + yc, x * c + y * d + xc], axis=-1)
    np.testing.assert_allclose(expected, pixels, atol=0.0101, rtol=0)


def test_py_ocamcalibs_json(tmp_path):
    """cam2world of py-OCamCalib, and the inverse polynomial of its world2cam_fast."""
    om.convert(OCAM, tmp_path / "a.json", to="py-ocamcalib")
    file = json.loads((tmp_path / "a.json").read_text())
    pixels, points = projected_points(OCAM)
    stretch = np.array(file["stretch_matrix"])
    plane = (pixels - file["distortion_center"]) @ np.linalg.inv(stretch).T
    rho = np.hypot(*plane.T)
    rays = np.column_stack([plane, np.polyval(file["taylor_coefficient"][::-1], rho)])
    cross = np.cross(
        rays / np.linalg.norm(rays, axis=1)[:, None],
        points / np.linalg.norm(points, axis=1)[:, None],
    )
    assert np.abs(cross).max() < 1e-12
    assert (np.sum(rays * points, axis=1) > 0).all()
    assert stretch[1, 1] == 1
    theta = np.arccos(points[:, 2] / np.linalg.norm(points, axis=1))
    np.testing.assert_allclose(np.polyval(file["inverse_poly"], theta), rho, atol=0.0101, rtol=0)


def test_py_omnicalibs_yaml(tmp_path):
    """View vector (right, down, z) of py-omnicalib, and its projection polynomial."""
    camera = replace(OCAM, affine=(1.0, 0.0, 0.0))
    om.convert(camera, tmp_path / "calibration.yml", to="py-omnicalib")
    file = yaml.safe_load((tmp_path / "calibration.yml").read_text())
    pixels, points = projected_points(camera)
    plane = pixels - file["principal_point"]
    rho = np.hypot(*plane.T)
    rays = np.column_stack([plane, np.polynomial.polynomial.polyval(rho, file["poly_radius_to_z"])])
    unit = points / np.linalg.norm(points, axis=1)[:, None]
    np.testing.assert_allclose(rays / np.linalg.norm(rays, axis=1)[:, None], unit, atol=1e-12)
    inverse = np.polynomial.polynomial.polyval(
        np.arccos(unit[:, 2]), file["poly_incident_angle_to_radius"]
    )
    np.testing.assert_allclose(inverse, rho, atol=0.0101, rtol=0)


def test_file_written_by_py_omnicalib(shared_data):
    """The file contains the projection twice: the polynomial that is read, and its inverse fitted
    by py-omnicalib."""
    source = shared_data / "kaidan_omni" / "example_calibration.yml"
    name, (loaded,) = read_cameras(
        source, ReadOptions(source.name, rim_radius_px=223.0, image_size=(640, 480))
    )
    assert name == "py-omnicalib"
    file = yaml.safe_load(source.read_text())
    np.testing.assert_array_equal(loaded.camera.centre_px, file["principal_point"])
    omega = np.radians(np.linspace(10.0, 110.0, 51))
    expected = np.polynomial.polynomial.polyval(omega, file["poly_incident_angle_to_radius"])
    np.testing.assert_allclose(
        loaded.camera.radius_from_omega(omega), expected, atol=3.5
    )  # fourth degree only


@pytest.mark.parametrize("name", ["camera.m", "camera.json"])
def test_matlabs_fisheye_intrinsics(tmp_path, name):
    """(u', v') = [c d; e 1] (u, v) + centre, rays (u, v, a0 + a2 r^2 + a3 r^3 + a4 r^4), the first pixel at (1, 1)."""
    om.convert(OCAM, tmp_path / name, to="matlab")
    text = (tmp_path / name).read_text()
    if name.endswith(".json"):
        file = json.loads(text)
        a, size, centre, stretch = (
            np.array(file[k])
            for k in ("MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix")
        )
    else:
        code = re.sub(r"%.*", "", text).replace("...", "")
        a, size, centre, stretch = (
            np.array(
                [[float(w) for w in re.split(r"[\s,]+", row.strip())] for row in part.split(";")]
            ).squeeze()
            for part in re.findall(r"\[([^\]]*)\]", code)
        )
    assert size.tolist() == [768, 1024]
    pixels, points = projected_points(OCAM)
    plane = (pixels + 1 - centre) @ np.linalg.inv(stretch).T
    rho = np.hypot(*plane.T)
    rays = np.column_stack([plane, a[0] + a[1] * rho**2 + a[2] * rho**3 + a[3] * rho**4])
    rays /= np.linalg.norm(rays, axis=1)[:, None]
    np.testing.assert_allclose(rays, points / np.linalg.norm(points, axis=1)[:, None], atol=1e-12)


@pytest.mark.parametrize("camera", [FISHEYE, SKEWED], ids=["plain", "skewed"])
def test_opencv_reads_our_fisheye_and_projects_the_same_points(tmp_path, camera):
    om.convert(camera, tmp_path / "a.yaml", to="opencv-fisheye")
    storage = cv2.FileStorage(str(tmp_path / "a.yaml"), cv2.FILE_STORAGE_READ)
    K, D = (storage.getNode(name).mat() for name in ("camera_matrix", "distortion_coefficients"))
    assert storage.getNode("image_width").real() == 1024
    pixels, points = projected_points(camera, 89.0)
    alpha = K[0, 1] / K[0, 0]
    projected, _ = cv2.fisheye.projectPoints(
        points[None], np.zeros(3), np.zeros(3), K, D, alpha=alpha
    )
    np.testing.assert_allclose(projected[0], pixels, atol=1e-6, rtol=0)


def radtan(x, y, k1, k2, p1, p2):
    """Kalibr's RadialTangentialDistortion."""
    r = x * x + y * y
    radial = k1 * r + k2 * r * r
    return x + x * radial + 2 * p1 * x * y + p2 * (
        r + 2 * x * x
    ), y + y * radial + 2 * p2 * x * y + p1 * (r + 2 * y * y)


def kalibr(camera, points):
    """Kalibr's four projections, from the entries of its file."""
    x, y, z = points.T
    *law, fu, fv, pu, pv = camera["intrinsics"]
    k = camera["distortion_coeffs"]
    match camera["camera_model"], camera["distortion_model"]:
        case "omni", "radtan":
            depth = z + law[0] * np.sqrt(x * x + y * y + z * z)
            a, b = radtan(x / depth, y / depth, *k)
        case "eucm", "none":
            alpha, beta = law
            depth = alpha * np.sqrt(beta * (x * x + y * y) + z * z) + (1 - alpha) * z
            a, b = x / depth, y / depth
        case "ds", "none":
            xi, alpha = law
            d1 = np.sqrt(x * x + y * y + z * z)
            d2 = np.sqrt(x * x + y * y + (xi * d1 + z) ** 2)
            depth = alpha * d2 + (1 - alpha) * (xi * d1 + z)
            a, b = x / depth, y / depth
        case "pinhole", "equidistant":
            r = np.hypot(x / z, y / z)
            theta = np.arctan(r)
            scale = (
                theta
                * (1 + k[0] * theta**2 + k[1] * theta**4 + k[2] * theta**6 + k[3] * theta**8)
                / r
            )
            a, b = scale * x / z, scale * y / z
    return np.stack([fu * a + pu, fv * b + pv], axis=-1)


@pytest.mark.parametrize(
    ("to", "camera", "max_angle_deg"),
    [
        ("kalibr-omni", UNSKEWED, 180.0),
        (
            "kalibr-eucm",
            EnhancedUnified(alpha=0.6, beta=1.1, focal_px=F, centre_px=C, image_size=SIZE),
            180.0,
        ),
        (
            "kalibr-ds",
            DoubleSphere(xi=0.3, alpha=0.6, focal_px=F, centre_px=C, image_size=SIZE),
            180.0,
        ),
        ("kalibr-equi", FISHEYE, 89.0),
    ],
)
@pytest.mark.parametrize("flip", [False, True])
def test_kalibr_formulas(tmp_path, to, camera, max_angle_deg, flip):
    result = om.convert(camera, tmp_path / "camchain.yaml", to=to, flip=flip)
    assert result.exact
    file = yaml.safe_load((tmp_path / "camchain.yaml").read_text())["cam0"]
    assert file["resolution"] == [1024, 768]
    pixels, points = projected_points(result.camera, max_angle_deg)
    np.testing.assert_allclose(kalibr(file, points), pixels, atol=1e-9, rtol=0)


@pytest.mark.parametrize("model", ["equidistant", "plumb_bob", "rational_polynomial"])
def test_ros_camera_info(tmp_path, model):
    """OpenCV functions, which image_geometry of ROS calls with the matrix and coefficients of the
    file."""
    pinhole = Unified(
        xi=0.0,
        focal_px=(600.0, 602.0),
        centre_px=C,
        image_size=SIZE,
        skew_px=0.0,
        k1=-0.2,
        k2=0.05,
        k3=0.01,
        p1=1e-3,
        p2=-2e-3,
        optics="fisheye",
    )
    camera = {"equidistant": FISHEYE, "plumb_bob": pinhole, "rational_polynomial": RATIONAL}[model]
    om.convert(camera, tmp_path / "camera_info.yaml")
    file = yaml.safe_load((tmp_path / "camera_info.yaml").read_text())
    assert (file["distortion_model"], file["image_width"], file["image_height"]) == (
        model,
        1024,
        768,
    )
    K, D = (np.array(file[k]["data"]) for k in ("camera_matrix", "distortion_coefficients"))
    pixels, points = projected_points(camera, 80.0)
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    projected, _ = project(points[None], np.zeros(3), np.zeros(3), K.reshape(3, 3), D)
    np.testing.assert_allclose(projected.reshape(-1, 2), pixels, atol=1e-6, rtol=0)
    assert (
        np.array(file["projection_matrix"]["data"]).reshape(3, 4)[:, :3].tolist()
        == K.reshape(3, 3).tolist()
    )


def test_colmaps_cameras_have_pixel_centres_at_a_half(tmp_path):
    om.convert(FISHEYE, tmp_path / "cameras.txt")
    line = (tmp_path / "cameras.txt").read_text().splitlines()[-1].split()
    assert line[:4] == ["1", "OPENCV_FISHEYE", "1024", "768"]
    fx, fy, cx, cy, *ks = map(float, line[4:])
    assert (cx, cy) == (C[0] + 0.5, C[1] + 0.5)
    om.convert(FISHEYE, tmp_path / "cameras.bin")
    data = (tmp_path / "cameras.bin").read_bytes()
    assert struct.unpack("<QIiQQ", data[:32]) == (
        1,
        1,
        5,
        1024,
        768,
    )  # cameras; id, model and size of the first
    assert np.frombuffer(data[32:], dtype="<f8").tolist() == [fx, fy, cx, cy, *ks]


def test_all_cameras_of_a_file_of_colmap_are_read_and_numbered():
    """Written explicitly from its documentation: several cameras of several models."""
    first = struct.pack("<IiQQ4d", 7, 1, 640, 480, 500.0, 501.0, 320.5, 240.5)
    second = struct.pack("<IiQQ8d", 9, 5, 1024, 768, 300.0, 301.0, 512.5, 384.5, 0.1, 0.2, 0.3, 0.4)

    def read(name, data):
        return _colmap.read(CameraFile(name, data), ReadOptions(name))

    cameras = read("cameras.bin", struct.pack("<Q", 2) + first + second)
    assert [loaded.name for loaded in cameras] == ["7", "9"]
    assert [loaded.camera.image_size for loaded in cameras] == [(640, 480), (1024, 768)]
    assert cameras[1].camera.centre_px == (512.0, 384.0)
    with pytest.raises(
        SpecError, match=r"cameras\.bin camera 2: the model must be 0 to 17; got 99"
    ):
        read("cameras.bin", struct.pack("<Q", 2) + first + struct.pack("<IiQQ", 1, 99, 4, 4))
    for number, (name, parameters) in zip((7, 10, 12, 13, 17), UNSUPPORTED.items(), strict=True):
        count = len(parameters.split())
        other = struct.pack(f"<QIiQQ{count}d", 1, 2, number, 640, 480, *range(1, count + 1))
        with pytest.raises(SpecError, match=rf"^cameras\.bin camera 1: {name} (is not|describes)"):
            read("cameras.bin", other)
        with pytest.raises(
            SpecError, match=f"line 1: {name} must have {count} .*, {parameters}; got 1"
        ):
            read("cameras.txt", f"2 {name} 640 480 1".encode())
    with pytest.raises(SpecError, match=r"cameras\.bin ends in the middle of a camera"):
        read("cameras.bin", struct.pack("<Q", 2) + first + second[:-1])
    for line, message in (
        (
            f"{'x' * 50} PINHOLE 640",
            f"a camera must be CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got '{'x' * 40}'",
        ),
        ("1 PINHOLE 640 480", "PINHOLE must have 4 parameters, fx fy cx cy; got 0"),
        (
            "1 FOV 640 480 1 1 1 1 1",
            "FOV is not supported; the model must be one of SIMPLE_PINHOLE",
        ),
        ("one PINHOLE 640 480", "the id, the size and the parameters of a camera must be numbers"),
        ("1 PINHOLE", "a camera must be CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got '1'"),
        ("1 PINHOLE 640", "a camera must be CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got '1'"),
        (f"1 {'x' * 50} 640 480", "the model must be one of SIMPLE_PINHOLE, PINHOLE"),
        ("1 EQUIRECTANGULAR 640 480 640 480", "EQUIRECTANGULAR describes a panorama"),
        *(
            (
                f"1 PINHOLE {size} 1 1 1 1",
                f"the image size must be positive integers; got {size.replace(' ', ' x ')}",
            )
            for size in (
                "0 480",
                "640 0",
                "-1 480",
                "640 -1",
                "640.5 480",
                "640 480.5",
                "3e+09 480",
                "640 3e+09",
            )
        ),
        # integers of 4 bytes, which the camera itself limits further
        (f"1 PINHOLE {2**31 - 1} 480 1 1 1 1", "image width must be an integer between 1 and"),
        (f"1 PINHOLE 640 {2**31 - 1} 1 1 1 1", "image height must be an integer between 1 and"),
        (f"1 PINHOLE {2**31} 480 1 1 1 1", "the image size must be positive integers"),
    ):
        with pytest.raises(SpecError, match=f"cameras.txt line 2: {re.escape(message)}"):
            read("cameras.txt", f"# a comment\n{line}\n".encode())
    with pytest.raises(
        SpecError,
        match=r"cameras.txt must contain a camera, CAMERA_ID MODEL WIDTH HEIGHT PARAMETERS; got none",
    ):
        read("cameras.txt", b"# a comment\n")


# Numbers and parameters from the COLMAP documentation, "Camera Models", and from its
# sensor/models.h
COLMAP_MODELS = [
    (0, "SIMPLE_PINHOLE", "f cx cy"),
    (1, "PINHOLE", "fx fy cx cy"),
    (2, "SIMPLE_RADIAL", "f cx cy k1"),
    (3, "RADIAL", "f cx cy k1 k2"),
    (4, "OPENCV", "fx fy cx cy k1 k2 p1 p2"),
    (5, "OPENCV_FISHEYE", "fx fy cx cy k1 k2 k3 k4"),
    (6, "FULL_OPENCV", "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"),
    (8, "SIMPLE_RADIAL_FISHEYE", "f cx cy k1"),
    (9, "RADIAL_FISHEYE", "f cx cy k1 k2"),
    (11, "RAD_TAN_THIN_PRISM_FISHEYE", "fx fy cx cy k1 k2 k3 k4 k5 k6 p2 p1 s1 s2 s3 s4"),
    (14, "SIMPLE_FISHEYE", "f cx cy"),
    (15, "FISHEYE", "fx fy cx cy"),
    (16, "EUCM", "fx fy cx cy alpha beta"),
]


UNSUPPORTED = {
    "FOV": "fx fy cx cy omega",
    "THIN_PRISM_FISHEYE": "fx fy cx cy k1 k2 p1 p2 k3 k4 sx1 sy1",
    "SIMPLE_DIVISION": "f cx cy k",
    "DIVISION": "fx fy cx cy k",
    "EQUIRECTANGULAR": "w h",
}
"""Numbers 7, 10, 12, 13 and 17."""


def test_files_of_colmap_are_recognised_without_their_suffix():
    """A binary camera has at least 32 bytes: a header of 24, and a parameter."""
    panorama = struct.pack("<QIiQQ2d", 1, 1, 17, 640, 480, 640.0, 480.0)
    assert _colmap.recognises(CameraFile("a.dat", panorama))
    for count, is_plausible in ((0, False), (1, True), (99, True), (100, False), (2**40, False)):
        data = struct.pack("<Q", count) + bytes(3192)
        assert _colmap.recognises(CameraFile("a.dat", data)) == is_plausible
        assert _colmap.recognises(CameraFile("a.bin", data))
    for text, is_line in (
        ("# comment\n 12 FOV 640 480 1 2 3 4 5\n", True),
        ("1 PINHOLES 640", False),
        ("PINHOLE 640 480", False),
    ):
        assert _colmap.recognises(CameraFile("a.txt", text.encode())) == is_line


def test_layouts_of_colmap():
    """Names of the documentation; programs project these models up to 90 deg."""
    layouts = _colmap.FORMAT.layouts
    for infix, suffix in (("", ".txt"), ("-bin", ".bin")):
        for model in ("opencv-fisheye", "eucm", "rad-tan-thin-prism-fisheye"):
            layout = layouts[f"colmap{infix}-{model}"]
            assert (layout.suffixes, layout.is_panorama) == ((suffix,), False)
            assert layout.max_field_angle_deg == 90.0
            assert layout.description == model.upper().replace("-", "_")
        layout = layouts[f"colmap{infix}-equirectangular"]
        assert (layout.suffixes, layout.is_panorama) == ((suffix,), True)
        width, height = om.views.sphere(FISHEYE).size
        content = layout.write(FISHEYE, "")
        if infix:
            assert struct.unpack("<QIiQQ2d", content) == (1, 1, 17, *2 * (width, height))
        else:
            number, name, *sizes = content.splitlines()[-1].split()
            assert (number, name) == ("1", "EQUIRECTANGULAR")
            assert sizes[:2] == [str(width), str(height)]
            assert list(map(float, sizes[2:])) == [width, height]
    assert len(layouts) == 8


@pytest.mark.parametrize(("number", "name", "parameters"), COLMAP_MODELS)
@pytest.mark.parametrize("size", [(640, 480), (1, 1)])
def test_colmaps_models_are_read_by_number_and_by_name(number, name, parameters, size):
    values = {
        "f": 300.0,
        "fx": 300.0,
        "fy": 310.0,
        "cx": 321.5,
        "cy": 241.5,
        "alpha": 0.6,
        "beta": 1.1,
    }
    small = {word: 1e-3 * i for i, word in enumerate(parameters.split(), start=1)}
    numbers = [values.get(word, small[word]) for word in parameters.split()]
    binary = struct.pack(f"<QIiQQ{len(numbers)}d", 1, 3, number, *size, *numbers)
    text = f"3 {name} {size[0]} {size[1]} {' '.join(map(str, numbers))} # behind\n".encode()
    read = [
        _colmap.read(CameraFile(file, data), ReadOptions(file))
        for file, data in (("cameras.bin", binary), ("cameras.txt", text))
    ]
    assert read[0] == read[1]
    ((loaded,), _) = read
    assert (loaded.name, loaded.camera.image_size) == ("3", size)
    assert loaded.camera.centre_px == (321.0, 241.0)
    assert loaded.camera.focal_px == (300.0, 310.0 if "fy" in parameters else 300.0)
    for word, value in zip(parameters.split(), numbers, strict=True):
        if word not in ("f", "fx", "fy", "cx", "cy"):
            assert getattr(loaded.camera, word) == value
    if name in ("OPENCV_FISHEYE", "EUCM", "RAD_TAN_THIN_PRISM_FISHEYE"):
        assert _colmap.binary_file(size, name, _colmap.values_of(loaded.camera, name)) == (
            struct.pack("<QI", 1, 1) + binary[12:]
        )
        assert _colmap.text_file((640, 479), name, numbers).splitlines()[-1].split()[:4] == [
            "1",
            name,
            "640",
            "479",
        ]


@pytest.mark.parametrize(
    "camera",
    [
        UNSKEWED,
        OCAM,
        SKEWED,
        EnhancedUnified(alpha=0.6, beta=1.1, focal_px=F, centre_px=C, image_size=SIZE, skew_px=0.3),
    ],
)
def test_flipping_a_camera_mirrors_its_pixels(camera):
    from omnimirror.calibration.conversion import flipped

    pixels = np.random.default_rng(6).uniform(0, np.array(SIZE) - 1, (300, 2))
    _, directions, valid = camera.backproject(pixels)
    mirrored = flipped(camera).project_directions(directions[valid])
    expected = pixels[valid] * [-1, 1] + [SIZE[0] - 1, 0]
    np.testing.assert_allclose(mirrored.pixels, expected, atol=1e-9, rtol=0)
    assert flipped(flipped(camera)) == camera
    assert flipped(camera).is_image_reversed != camera.is_image_reversed
    assert Mount() == camera.mount
