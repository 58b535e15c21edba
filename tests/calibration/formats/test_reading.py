"""Files written by other programs: recognised by content, evaluated with the formula of each
program."""

import gzip
import json
import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError, OmnimirrorWarning, SpecError
from omnimirror.calibration.formats import ReadOptions, read_cameras
from omnimirror.cameras.models import OCam
from omnimirror.cameras.models.plausibility import (
    inverse_polynomial_warnings,
    plausibility_warnings,
)
from tests.calibration.formats.examples import projected_points

SIZE = (1280, 960)
K = np.array([[401.0, 0.7, 655.0], [0.0, 399.0, 475.0], [0.0, 0.0, 1.0]])
OMNIDIR = (1.31, -0.12, 0.03, 0.002, -0.001)
FISHEYE = np.array([0.05, -0.01, 0.002, -3e-4])
PINHOLE = np.array([-0.3, 0.1, 0.001, -0.002])


def read(path, text=None, optics="fisheye", from_=None, size=None):
    """Return the format, the only camera and the notes of a file."""
    if text is not None:
        path.write_text(text)
    name, (stored,) = read_cameras(path, ReadOptions(str(path), optics, image_size=size), from_)
    return name, stored.camera, stored.notes


def radtan(x, y, k1, k2, p1, p2):
    """Return Brown's distortion in the convention of OpenCV, Kalibr and camodocal."""
    r = x * x + y * y
    radial = 1 + k1 * r + k2 * r * r
    return (
        x * radial + 2 * p1 * x * y + p2 * (r + 2 * x * x),
        y * radial + p1 * (r + 2 * y * y) + 2 * p2 * x * y,
    )


def mei(points, xi, k1, k2, p1, p2):
    x, y, z = (points / np.linalg.norm(points, axis=1)[:, None]).T
    return radtan(x / (z + xi), y / (z + xi), k1, k2, p1, p2)


def check(camera, project, max_angle_deg=180.0):
    pixels, points = projected_points(camera, max_angle_deg)
    assert len(pixels) > 80
    np.testing.assert_allclose(np.stack(project(points), axis=-1), pixels, atol=1e-6, rtol=0)


# -- OpenCV storages
# ----------------------------------------------------------------------------------


def store(path, **values):
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in values.items():
        storage.write(name, value)
    storage.release()


@pytest.mark.parametrize("xi", [1.31, np.array([[1.31]])], ids=["number", "matrix"])
@pytest.mark.parametrize("name", ["a.xml", "a.yml", "a.json", "a.yml.gz", "a.xml.gz", "a.json.gz"])
def test_omnidirs_file_in_every_storage_of_opencv(tmp_path, name, xi):
    """Not as a fisheye with four coefficients, which would differ by 300 px."""
    _, k1, k2, p1, p2 = OMNIDIR
    store(
        tmp_path / name,
        image_width=SIZE[0],
        image_height=SIZE[1],
        camera_matrix=K,
        distortion_coefficients=np.array([[k1, k2, p1, p2]]),
        xi=xi,
    )
    title, camera, notes = read(tmp_path / name)
    assert (title, notes, camera.image_size) == ("opencv-omnidir", (), SIZE)

    def project(points):
        x, y = mei(points, *OMNIDIR)
        return K[0, 0] * x + K[0, 1] * y + K[0, 2], K[1, 1] * y + K[1, 2]

    check(camera, project)


QUOTED = """"camera_matrix": {"rows": 3, "cols": 3, "data": [401, 0, 655, 0, 399, 475, 0, 0, 1]}
'distortion_coefficients': [-0.12, 0.03, 0.002, -0.001]
"xi" : [1.31]
"""


@pytest.mark.parametrize(
    "text",
    [
        QUOTED,
        "%YAML:1.0\n---\n" + "".join("  " + line + "\n" for line in QUOTED.splitlines()),
        "{" + QUOTED.strip().replace("\n", ", ") + "}",
    ],
    ids=["quoted", "indented", "flow"],
)
def test_the_spelling_of_keys_does_not_change_the_model(tmp_path, text):
    title, camera, _ = read(tmp_path / "a.yaml", text, size=SIZE)
    assert (title, camera.xi, camera.p1) == ("opencv-omnidir", 1.31, 0.002)


MULTICOL_REST = [f"Camera.{name}" for name in ("d", "e", "u0", "v0", "Iw", "Ih")]
STORED = {
    "image_width": SIZE[0],
    "image_height": SIZE[1],
    "camera_matrix": K.tolist(),
    "distortion_coefficients": list(OMNIDIR[1:]),
    "xi": OMNIDIR[0],
}


@pytest.mark.parametrize(
    "text",
    [
        json.dumps(STORED | {"distortion_coefficients": [OMNIDIR[1:]], "xi": [[OMNIDIR[0]]]}),
        json.dumps(STORED | {"distortion_coefficients": [[k] for k in OMNIDIR[1:]]}),
        json.dumps(STORED | {"camera_matrix": K.ravel().tolist()}),
        json.dumps(STORED | {"camera_matrix": {"rows": 3, "cols": 3, "data": K.tolist()}}),
        "// K in px\n" + json.dumps(STORED).replace(", ", ", /* {\n */ // }\n") + "// end",
        json.dumps(STORED | {"name": '// " /* no comment'}),
        "\n# written by hand\n%YAML:1.0\n---\n" + yaml.safe_dump(STORED),
        yaml.safe_dump(STORED).replace("\n", "\r\n") + "... # end\r\n",
    ],
    ids=["row", "column", "flat", "data", "comments", "strings", "header", "end"],
)
def test_notations_of_arrays_and_comments(tmp_path, text):
    _, expected, _ = read(tmp_path / "a.json", json.dumps(STORED))
    assert (expected.xi, expected.p2, expected.skew_px) == (OMNIDIR[0], OMNIDIR[4], 0.7)
    assert read(tmp_path / "b.txt", text) == ("opencv-omnidir", expected, ())


def test_opencvs_comments_in_json(tmp_path):
    storage = cv2.FileStorage(str(tmp_path / "a.json"), cv2.FILE_STORAGE_WRITE)
    storage.writeComment("of the left camera")
    for name, value in (("camera_matrix", K), ("distortion_coefficients", PINHOLE), ("xi", 1.0)):
        storage.write(name, value)
    storage.release()
    assert "//" in (tmp_path / "a.json").read_text()
    assert read(tmp_path / "a.json", size=SIZE)[0] == "opencv-omnidir"


def test_later_documents_are_noted(tmp_path):
    second = yaml.safe_dump(STORED | {"xi": 0.5})
    _, camera, notes = read(tmp_path / "a.yaml", yaml.safe_dump(STORED) + "--- # right\n" + second)
    assert camera.xi == OMNIDIR[0]
    assert notes == ("the file contains 2 YAML documents; only the first is read",)


KALIBR = {
    "camera_model": "omni",
    "intrinsics": [1.3, 400.0, 401.0, 640.0, 480.0],
    "distortion_model": "radtan",
    "distortion_coeffs": list(OMNIDIR[1:]),
    "resolution": list(SIZE),
}


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (STORED | {"xi": None}, "xi must be a finite number; got empty"),
        (
            STORED | {"distortion_coefficients": {"rows": 1, "cols": 3, "data": OMNIDIR[1:]}},
            "distortion_coefficients must have rows x cols = 1 x 3 numbers; got 4",
        ),
        (KALIBR | {"distortion_model": None}, "distortion_model must be a word; got empty"),
        (
            {name: value for name, value in KALIBR.items() if name != "distortion_model"},
            "must contain distortion_model",
        ),
        (
            KALIBR | {"distortion_model": "none"},
            "distortion_coeffs must be empty or 0 for distortion_model none",
        ),
        (
            {"Camera.a0": -200, "Camera.a2": 1e-3, "Camera.c": 1} | dict.fromkeys(MULTICOL_REST, 0),
            r"must contain Camera\.a1",
        ),
        (
            {"Camera.a0": -200, "Camera.c": 1, "Camera.nrpol": 5} | dict.fromkeys(MULTICOL_REST, 9),
            r"Camera\.nrpol must be the number of coefficients, 1",
        ),
    ],
)
def test_contradictory_entries_are_rejected(tmp_path, table, message):
    """Instead of omitting some of the coefficients."""
    with pytest.raises(SpecError, match=message):
        read(tmp_path / "a.json", json.dumps(table))


@pytest.mark.parametrize(
    ("flag", "name"),
    [
        *((flag, "opencv-pinhole") for flag in ("0", "no", "False")),
        *((flag, "opencv-fisheye") for flag in ("1", "1.", "yes")),
    ],
)
def test_booleans_of_yaml(tmp_path, flag, name):
    text = yaml.safe_dump({k: v for k, v in STORED.items() if k != "xi"})
    assert read(tmp_path / "a.yaml", f"{text}fisheye_model: {flag}\n")[0] == name


@pytest.mark.parametrize("flag", ["2", "", "[]", "pinhole"])
def test_other_flags_are_rejected(tmp_path, flag):
    """Instead of reading a fisheye."""
    text = yaml.safe_dump({k: v for k, v in STORED.items() if k != "xi"})
    with pytest.raises(SpecError, match="fisheye_model must be 0 for a pinhole camera or 1 for a"):
        read(tmp_path / "a.yaml", f"{text}fisheye_model: {flag}\n")


def test_repeated_names_in_json_are_rejected(tmp_path):
    """Instead of the last value, as in YAML and XML."""
    with pytest.raises(SpecError, match=r"a\.json: xi must not occur twice"):
        read(tmp_path / "a.json", json.dumps(STORED)[:-1] + ', "xi": 0.5}')


def test_repeated_camera_ids_are_rejected(tmp_path):
    with pytest.raises(SpecError, match="the camera id 1 must not occur twice"):
        read(tmp_path / "cameras.txt", "1 FISHEYE 9 9 5 5 4 4\n" * 2)


@pytest.mark.parametrize("name", [None, 7, ["a"]])
def test_names_of_cameras_have_no_effect(tmp_path, name):
    _, camera, _ = read(
        tmp_path / "a.json",
        json.dumps(
            {
                "camera_name": name,
                "taylor_coefficient": [200, 0, -1e-3],
                "distortion_center": [640, 480],
                "stretch_matrix": [[1, 0], [0, 1]],
            }
        ),
        size=SIZE,
    )
    assert camera.polynomial[0] == -200


PLAIN = np.array([[500.0, 0.0, 655.0], [0.0, 498.0, 475.0], [0.0, 0.0, 1.0]])


@pytest.mark.parametrize(
    ("coefficients", "flag", "program"),
    [
        (FISHEYE, 1, "opencv-fisheye"),
        (PINHOLE, 0, "opencv-pinhole"),
        (np.append(PINHOLE, 0.01), None, "opencv-pinhole"),
        (np.concatenate([PINHOLE, [0.02, 0.3, 0.05, 0.002]]), 0, "opencv-pinhole"),
        (np.concatenate([PINHOLE, [0.02, 0, 0, 0, 0, 0, 0, 0, 0, 0]]), None, "opencv-pinhole"),
    ],
)
@pytest.mark.parametrize("name", ["a.yml", "a.json"])
def test_opencvs_calibration_sample(tmp_path, name, coefficients, flag, program):
    flags = {} if flag is None else {"fisheye_model": flag}
    store(
        tmp_path / name,
        image_width=SIZE[0],
        image_height=SIZE[1],
        **flags,
        camera_matrix=PLAIN,
        distortion_coefficients=coefficients[:, None],
    )
    title, camera, _ = read(tmp_path / name)
    assert title == program
    project = cv2.fisheye.projectPoints if flag else cv2.projectPoints
    zero = np.zeros(3)
    check(
        camera,
        lambda points: project(points[None], zero, zero, PLAIN, coefficients)[0].reshape(-1, 2).T,
        40.0,
    )


def test_four_coefficients_without_a_model_are_ambiguous(tmp_path):
    store(
        tmp_path / "a.yml",
        image_width=SIZE[0],
        image_height=SIZE[1],
        camera_matrix=PLAIN,
        distortion_coefficients=PINHOLE,
    )
    with pytest.raises(SpecError, match=r"ambiguous: .*opencv-fisheye .*opencv-pinhole .*--from"):
        read(tmp_path / "a.yml")
    for name in ("opencv-fisheye", "opencv-pinhole"):
        _, camera, _ = read(tmp_path / "a.yml", from_=name)
        assert (camera.KIND, camera.k1) == (
            "unified" if "pinhole" in name else "kannala-brandt",
            PINHOLE[0],
        )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "<!DOCTYPE a [<!ENTITY b 'cc'>]><opencv_storage><xi>&b;</xi></opencv_storage>",
            "must not declare",
        ),
        (
            "<opencv_storage>\n<xi>1</opencv_storage>",
            r"a\.xml line 2 must be valid XML: mismatched tag",
        ),
        (
            "<a>" * 100 + "</a>" * 100,
            r"a\.xml: tables and lists must be nested at most 32 levels deep",
        ),
        ("<a><xi>1</xi><xi>2</xi></a>", "xi must not occur twice in the file"),
    ],
)
def test_invalid_xml_is_rejected(tmp_path, text, message):
    with pytest.raises(SpecError, match=message):
        read(tmp_path / "a.xml", text)


def test_damaged_gzip_is_rejected(tmp_path):
    for i, data in enumerate((gzip.compress(QUOTED.encode())[:-9], b"\x1f\x8b" + b"x" * 40)):
        (tmp_path / f"{i}.yml.gz").write_bytes(data)
        with pytest.raises(SpecError, match=r"damaged|truncated"):
            read(tmp_path / f"{i}.yml.gz")


# -- camodocal, MultiCol-SLAM, Basalt
# ------------------------------------------------------------------

MEI = {
    "model_type": "MEI",
    "camera_name": "left",
    "image_width": 1280,
    "image_height": 960,
    "mirror_parameters": {"xi": 1.31},
    "distortion_parameters": {"k1": -0.12, "k2": 0.03, "p1": 0.002, "p2": -0.001},
    "projection_parameters": {"gamma1": 401.0, "gamma2": 399.0, "u0": 655.0, "v0": 475.0},
}
KB = {
    "model_type": "KANNALA_BRANDT",
    "camera_name": "c",
    "image_width": 1280,
    "image_height": 960,
    "projection_parameters": {
        "k2": 0.05,
        "k3": -0.01,
        "k4": 2e-3,
        "k5": -3e-4,
        "mu": 401.0,
        "mv": 399.0,
        "u0": 655.0,
        "v0": 475.0,
    },
}
POLY = (-209.2, 0.0, 2.13741670953883e-03, -4.2203617319086e-06, 1.77146086919594e-08)
AFFINE = (0.9996, -0.0035, 0.0039)


def test_camodocals_mei_and_kannala_brandt(tmp_path):
    """CataCamera::spaceToPlane and EquidistantCamera::spaceToPlane."""
    title, camera, _ = read(tmp_path / "a.yaml", "%YAML:1.0\n---\n" + yaml.safe_dump(MEI))
    assert title == "camodocal"

    def project(points):
        x, y = mei(points, *OMNIDIR)
        return 401.0 * x + 655.0, 399.0 * y + 475.0

    check(camera, project)
    _, camera, _ = read(tmp_path / "b.yaml", yaml.safe_dump(KB))

    def equidistant(points):
        theta, phi = (
            np.arccos(points[:, 2] / np.linalg.norm(points, axis=1)),
            np.arctan2(points[:, 1], points[:, 0]),
        )
        r = theta + 0.05 * theta**3 - 0.01 * theta**5 + 2e-3 * theta**7 - 3e-4 * theta**9
        return 401.0 * r * np.cos(phi) + 655.0, 399.0 * r * np.sin(phi) + 475.0

    check(camera, equidistant)
    assert camera.omega_max > np.pi / 2


def ocam_pixels(points, poly, affine, centre):
    """Return pixels of OCamCalib's direct polynomial in (x, y), by bisection of ``atan2(-f(rho),
    rho)``."""
    norm = np.hypot(points[:, 0], points[:, 1])
    angle = np.arctan2(points[:, 2], norm)
    low, high = np.zeros(len(points)), np.full(len(points), 900.0)
    for _ in range(60):
        rho = (low + high) / 2
        is_low = np.arctan2(-np.polynomial.polynomial.polyval(rho, poly), rho) > angle
        low, high = np.where(is_low, rho, low), np.where(is_low, high, rho)
    x, y = points[:, 0] / norm * rho, points[:, 1] / norm * rho
    c, d, e = affine
    return c * x + d * y + centre[0], e * x + y + centre[1]


@pytest.mark.parametrize("affine", [AFFINE, (0.985, 0.01, -0.004)])
@pytest.mark.parametrize("program", ["camodocal", "multicol"])
def test_ocamcalibs_polynomials_in_x_and_y(tmp_path, program, affine):
    """OCAMCamera::spaceToPlane and cCamModelGeneral_::WorldToImg, with a solution of the direct
    polynomial."""
    centre = (655.5, 470.25)
    if program == "camodocal":
        table = {
            "model_type": "scaramuzza",
            "image_width": 1280,
            "image_height": 960,
            "poly_parameters": {f"p{i}": a for i, a in enumerate(POLY)},
            "affine_parameters": dict(
                zip(("ac", "ad", "ae", "cx", "cy"), (*affine, *centre), strict=True)
            ),
        }
    else:
        names = ("Camera.c", "Camera.d", "Camera.e", "Camera.u0", "Camera.v0")
        table = {"Camera.Iw": 1280, "Camera.Ih": 960, "Camera.nrpol": 5}
        table |= {f"Camera.a{i}": a for i, a in enumerate(POLY)} | dict(
            zip(names, (*affine, *centre), strict=True)
        )
    title, camera, notes = read(tmp_path / "a.yaml", yaml.safe_dump(table))
    assert (title, notes) == (program, ())
    check(camera, lambda points: ocam_pixels(points, POLY, affine, centre))


def test_central_obscuration_is_not_a_contradiction(tmp_path):
    """Parameters of the LF-VIO camera, whose inverse polynomial was fitted from 40 to 120 deg and
    is off by 48 px at 0."""
    poly = (-244.5239, 0.0, 1.74861e-3, -1.75777e-6, 4.475965e-9)
    inverse = (376.845565, 246.746504, 19.035187, 23.840497, 18.991943, 6.066253, 1.560387, 5.85428, 3.45832,
               -1.995166, -1.509264, 1.089614, 1.340245, 0.255323)  # fmt: skip
    table = {
        "model_type": "scaramuzza",
        "image_width": 1280,
        "image_height": 960,
        "poly_parameters": {f"p{i}": a for i, a in enumerate(poly)},
        "inv_poly_parameters": {f"p{i}": a for i, a in enumerate(inverse)},
        "affine_parameters": {"ac": 1.0, "ad": 0.0, "ae": 0.0, "cx": 645.107791, "cy": 486.025172},
    }
    assert read(tmp_path / "a.yaml", yaml.safe_dump(table))[2] == ()
    table["inv_poly_parameters"]["p0"] += 3.0
    (note,) = read(tmp_path / "b.yaml", yaml.safe_dump(table))[2]
    assert "up to 3.08 px" in note  # 3 px, and the extrapolation error at 37.6 deg


def basalt(points, kind, p):
    """``project`` of basalt-headers: DoubleSphereCamera, ExtendedUnifiedCamera, UnifiedCamera,
    KannalaBrandtCamera4."""
    x, y, z = points.T
    if kind == "kb4":
        r = np.hypot(x, y)
        theta = np.arctan2(r, z)
        scale = r / (
            theta
            * (
                1
                + p["k1"] * theta**2
                + p["k2"] * theta**4
                + p["k3"] * theta**6
                + p["k4"] * theta**8
            )
        )
    elif kind == "ds":
        d1 = np.sqrt(x * x + y * y + z * z)
        k = p["xi"] * d1 + z
        scale = p["alpha"] * np.sqrt(x * x + y * y + k * k) + (1 - p["alpha"]) * k
    else:
        scale = (
            p["alpha"] * np.sqrt(p.get("beta", 1.0) * (x * x + y * y) + z * z)
            + (1 - p["alpha"]) * z
        )
    return p["fx"] * x / scale + p["cx"], p["fy"] * y / scale + p["cy"]


MATRIX = {"fx": 301.0, "fy": 299.5, "cx": 655.0, "cy": 475.0}
BASALT = [
    {"camera_type": "ds", "intrinsics": MATRIX | {"xi": -0.2, "alpha": 0.59}},
    {"camera_type": "eucm", "intrinsics": MATRIX | {"alpha": 0.6, "beta": 1.1}},
    {
        "camera_type": "kb4",
        "intrinsics": MATRIX | dict(zip(("k1", "k2", "k3", "k4"), FISHEYE.tolist(), strict=True)),
    },
    {"camera_type": "ucm", "intrinsics": MATRIX | {"alpha": 0.55}},
]


def test_basalts_rig(tmp_path):
    path = tmp_path / "calibration.json"
    path.write_text(
        json.dumps({"value0": {"T_imu_cam": [], "intrinsics": BASALT, "resolution": [SIZE] * 4}})
    )
    title, cameras = read_cameras(path, ReadOptions(str(path), "fisheye"))
    assert (title, [c.name for c in cameras]) == ("basalt", ["0", "1", "2", "3"])
    for stored, entry in zip(cameras, BASALT, strict=True):
        assert stored.camera.omega_max > np.radians(95.0)
        check(
            stored.camera, lambda points, e=entry: basalt(points, e["camera_type"], e["intrinsics"])
        )


@pytest.mark.parametrize(
    "to", ["basalt-kb4", "basalt-ds", "basalt-eucm", "camodocal-mei", "camodocal-kannala-brandt"]
)
def test_written_files_match_original_program(tmp_path, to):
    """Written file, parsed by an independent reader."""
    texts = {
        "basalt-kb4": BASALT[2],
        "basalt-ds": BASALT[0],
        "basalt-eucm": BASALT[1],
        "camodocal-mei": MEI,
        "camodocal-kannala-brandt": KB,
    }
    source = texts[to]
    table = (
        source
        if "model_type" in source
        else {"value0": {"intrinsics": [source], "resolution": [SIZE]}}
    )
    (tmp_path / "source.json").write_text(json.dumps(table))
    result = om.convert(tmp_path / "source.json", tmp_path / "target", to=to, optics="fisheye")
    assert result.exact
    text = (tmp_path / "target").read_text()
    if to.startswith("basalt"):
        entries = json.loads(text)["value0"]
        assert (entries["intrinsics"], entries["resolution"]) == ([source], [list(SIZE)])
        return
    storage = cv2.FileStorage(str(tmp_path / "target"), cv2.FILE_STORAGE_READ)
    assert storage.getNode("model_type").string() == source["model_type"]
    for title, numbers in source.items():
        for name, value in numbers.items() if isinstance(numbers, dict) else ():
            assert storage.getNode(title).getNode(name).real() == value


# -- ROS
# -----------------------------------------------------------------------------------------------

MESSAGE = {
    "header": {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": "camera"},
    "height": 960,
    "width": 1280,
    "distortion_model": "plumb_bob",
    "D": [*PINHOLE.tolist(), 0.02],
    "K": PLAIN.ravel().tolist(),
    "R": [1.0, 0, 0, 0, 1, 0, 0, 0, 1],
    "P": [500.0, 0, 655, 0, 0, 498, 475, 0, 0, 0, 1, 0],
    "binning_x": 0,
    "binning_y": 0,
    "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0},
}


@pytest.mark.parametrize("is_lower", [False, True], ids=["ROS 1", "ROS 2"])
@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
@pytest.mark.parametrize(
    "dump", [yaml.safe_dump, lambda m: yaml.safe_dump(m) + "---\n", json.dumps]
)
def test_messages_of_ros(tmp_path, dump, model, is_lower):
    k = FISHEYE if model == "equidistant" else np.append(PINHOLE, 0.02)
    message = MESSAGE | {"distortion_model": model, "D": k.tolist()}
    message = {key.lower() if is_lower else key: value for key, value in message.items()}
    title, camera, notes = read(tmp_path / "info.yaml", dump(message))
    assert (title, notes) == ("ros", ())
    project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
    zero = np.zeros(3)
    check(
        camera, lambda points: project(points[None], zero, zero, PLAIN, k)[0].reshape(-1, 2).T, 40.0
    )


def test_additional_message_fields_are_noted(tmp_path):
    message = MESSAGE | {
        "binning_x": 2,
        "roi": {"x_offset": 8, "y_offset": 4, "height": 100, "width": 200},
    }
    text = (yaml.safe_dump(message) + "---\n") * 3
    *_, notes = read(tmp_path / "info.yaml", text)
    assert [n.split(";")[0] for n in notes] == [
        "the file contains 3 YAML documents",
        "the camera bins 2 x 0 pixels",
        "the camera transmits only the region 200x100 at (8, 4)",
    ]


def test_camera_info_in_json_is_a_pinhole(tmp_path):
    table = {
        "image_width": 1280,
        "image_height": 960,
        "camera_name": "a",
        "distortion_model": "plumb_bob",
        "camera_matrix": {"rows": 3, "cols": 3, "data": PLAIN.ravel().tolist()},
        "distortion_coefficients": {"rows": 1, "cols": 4, "data": PINHOLE.tolist()},
    }
    title, camera, _ = read(tmp_path / "a.json", json.dumps(table))
    assert (title, camera.KIND, camera.xi, camera.p1) == ("ros", "unified", 0.0, PINHOLE[2])


# -- sizes, contradictions
# -----------------------------------------------------------------------------


@pytest.mark.parametrize("prefix", ["cam0:\n  ", ""], ids=["chain", "alone"])
def test_a_kalibr_file_without_resolution_uses_the_specified_size(tmp_path, prefix):
    lines = [
        "camera_model: ds",
        "intrinsics: [-0.2, 0.59, 300, 301, 655, 475]",
        "distortion_model: none",
    ]
    text = prefix + ("\n  " if prefix else "\n").join(lines) + "\n"
    title, camera, _ = read(tmp_path / "a.yaml", text, size=(1280, 960))
    assert (title, camera.image_size) == ("kalibr", (1280, 960))
    with pytest.raises(SpecError, match=r"--set camera\.image_size"):
        read(tmp_path / "a.yaml")


def test_contradicting_image_size_is_noted(tmp_path):
    *_, notes = read(tmp_path / "a.json", json.dumps(MEI), size=(640, 480))
    assert notes == ("the image size of the file is used, 1280x960",)


def test_matlab_scripts_with_variables(tmp_path):
    call = "intrinsics = fisheyeIntrinsics({}, [960 1280], [656 476]);"
    _, camera, _ = read(tmp_path / "a.m", "a = [300 -1e-3 1e-6 -1e-9];\n" + call.format("a"))
    assert camera.polynomial[0] == -300.0
    with pytest.raises(SpecError, match=r"line 1: the variable params must be set"):
        read(tmp_path / "b.m", call.format("params"))


MATLAB_CALL = "i = fisheyeIntrinsics([300 -1e-3 0 0], [960 1280], [656 476], [1 0.001; 0 1]);"


@pytest.mark.parametrize(
    "text",
    [
        "%{\ni = fisheyeIntrinsics([1 0 0 0], [9 9], [5 5]);\n%}\n" + MATLAB_CALL,
        MATLAB_CALL.replace("[1 0.001; 0 1]", "[1 0; 0.001 1]'"),
        MATLAB_CALL.replace("; 0 1]", "\n 0 1]").replace("[300 ", "[300, ... first\n "),
        "size = [960, 1280]; at=[656 476];\na = [300; -1e-3\n0; 0]';\n"
        "i = fisheyeIntrinsics(a, size, at, [1 0.001; 0 1])",
    ],
    ids=["block comment", "transposed", "lines", "variables"],
)
def test_notations_of_matlab(tmp_path, text):
    _, expected, _ = read(tmp_path / "a.m", MATLAB_CALL)
    assert (expected.polynomial[2], expected.affine[2]) == (1e-3, 0.001)
    assert read(tmp_path / "b.m", text)[1] == expected
    identity = read(tmp_path / "c.m", MATLAB_CALL.replace("[1 0.001; 0 1]", "eye(2)"))[1]
    assert identity.affine == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (MATLAB_CALL.replace("[300", "2*[300"), r"line 1: MappingCoefficients must be numbers"),
        (MATLAB_CALL.replace("[656 476]", "[656 476]-1"), r"DistortionCenter must be numbers"),
        (
            "at = [1 1];\n" * 2 + MATLAB_CALL.replace("[656 476]", "at"),
            "line 3: the variable at must",
        ),
        ("at = [9 9];at(1) = 2;" + MATLAB_CALL.replace("[656 476]", "at"), "at must be set once"),
        ("at = 2 * [9 9];" + MATLAB_CALL.replace("[656 476]", "at"), "at must be set once"),
        ("at = [9 9] + 1;" + MATLAB_CALL.replace("[656 476]", "at"), "at must be set once"),
        ("at = [9 9]; [at, b] = f(at);" + MATLAB_CALL.replace("[656 476]", "at"), "be set once"),
        (MATLAB_CALL * 2, r"must call fisheyeIntrinsics once; got 2 calls"),
        (
            '{"MappingCoefficients": [300, 0, 0, 0], "ImageSize": [9, 9], "DistortionCenter": [5, 5],'
            ' "StretchMatrix": [1, 0, 0, 1]}',
            "StretchMatrix must have 2 rows of 2 numbers",
        ),
    ],
)
def test_arithmetic_of_matlab_is_rejected(tmp_path, text, message):
    """Instead of the numbers in brackets without the arithmetic."""
    with pytest.raises(SpecError, match=message):
        read(tmp_path / "a.m", text)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "i = fisheyeIntrinsics([-200 1e-3 0 0], [960 1280], [656 476]);",
            r"a\.txt line 1: MappingCoefficients must begin with a positive number, .* got -200",
        ),
        (
            '{"taylor_coefficient": [-200, 0], "distortion_center": [5, 4]}',
            r"taylor_coefficient must begin with a positive number, f\(0\) > 0; got -200",
        ),
        (
            "poly_radius_to_z: [-200, 0]\nprincipal_point: [5, 4]",
            r"line 1: poly_radius_to_z must begin with a positive number, .* got -200",
        ),
        (
            "model_type: SCARAMUZZA\nimage_width: 9\nimage_height: 9\npoly_parameters: {p0: -200}\n"
            "affine_parameters: {ac: 0, ad: 0, ae: 0, cx: 4, cy: 4}",
            r"line 5: affine_parameters\.ac must be near 1; got 0",
        ),
        (
            "Camera.c: 0\nCamera.a0: -200\n",
            r"line 1: Camera\.c must be near 1; got 0",
        ),
    ],
)
def test_messages_quote_the_numbers_of_the_file(tmp_path, text, message):
    """Not the numbers after conversion to OCamCalib's sign and axes."""
    with pytest.raises(SpecError, match=message):
        read(tmp_path / "a.txt", text, size=(640, 480))


RIGHT = OCam(
    polynomial=(-131.4797, 0.0, 1.848991e-03, 2.251206e-07, -7.343233e-10),
    centre_px=(515.32, 382.29),
    image_size=(1024, 768),
)


def calib_results(inverse_scale=1.0, centre="382.29 515.32", affine="1 0 0", size="768 1024"):
    inverse = (266.092981, 272.489459, 148.629937, 112.702231, 82.875684, 59.965334, 62.304757, 91.439809, 57.2717,
               -59.213406, -74.159984, 78.399482, 187.931187, 138.893318, 47.348063, 6.335636)  # fmt: skip
    direct = " ".join(map(repr, RIGHT.polynomial))
    numbers = " ".join(repr(inverse_scale * p) for p in inverse)
    return f"5 {direct}\n16 {numbers}\n{centre}\n{affine}\n{size}\n"


def test_a_consistent_file_has_no_notes(tmp_path):
    assert read(tmp_path / "a.txt", calib_results(), "mirror")[2] == ()
    assert plausibility_warnings(RIGHT) == []
    assert plausibility_warnings(replace(RIGHT, centre_px=(540.0, 370.0))) == []


@pytest.mark.parametrize(
    ("changes", "magnitude"),
    [
        (
            {"inverse_scale": 1.1},
            r"inverse polynomial .* up to 38\.\d px \(110 deg",
        ),  # 10 % of 384 px
        ({"inverse_scale": 0.7}, r"inverse polynomial .* up to 115 px"),
        (
            {"centre": "515.32 382.29"},
            r"centre \(382\.3, 515\.3\) is 185 px from the centre .* 4[.\d]* px with swapped",
        ),
        (
            {"size": "1024 768"},
            r"centre \(515\.3, 382\.3\) is 185 px from the centre .* 4[.\d]* px with swapped",
        ),
        (
            {"affine": "0.884 0 0"},
            r"stretched by 13\.1 % in one direction \(c = 0\.884, .* up to 50\.4 px",
        ),
        (
            {"affine": "1 0.2 0"},
            r"stretched by 22\.1 %",
        ),  # singular values of [1 0; 0.2 1]: sqrt(1.01) +- 0.1
        (
            {"affine": "1 0.3 -0.3"},  # arctan 0.3 = 16.7 deg; chord 2 sin(8.35 deg) 384 px
            r"axes are rotated by 16\.7 deg \(c = 1, d = 0\.3, e = -0\.3\), up to 112 px",
        ),
        ({"affine": "-1 0 0"}, r"the image is mirrored \(c = -1,"),
        ({"centre": "-50 515"}, r"centre \(515, -50\) is outside the"),
    ],
)
def test_contradictions_are_reported_with_their_magnitude(tmp_path, changes, magnitude):
    text = calib_results(**changes)
    *_, notes = read(tmp_path / "a.txt", text, "mirror")
    (note,) = notes
    assert re.search(magnitude, note), note
    with pytest.warns(OmnimirrorWarning, match=magnitude):
        om.load_ocam(tmp_path / "a.txt")
    result = om.convert(tmp_path / "a.txt", tmp_path / "b.toml")
    assert note in result.notes
    with pytest.warns(OmnimirrorWarning, match=magnitude):
        om.load_camera(tmp_path / "a.txt")


def test_a_rejected_conversion_reports_contradictions(tmp_path):
    """The contradiction may be the cause of the large error."""
    (tmp_path / "a.txt").write_text(calib_results(centre="515.32 382.29"))
    with pytest.raises(OmnimirrorError, match=r"--tolerance-px .*; the centre .* with swapped"):
        om.convert(tmp_path / "a.txt", tmp_path / "b.yaml", to="kalibr")


def test_a_read_only_format_is_rejected_as_target(tmp_path):
    message = "to must be one of ocamcalib, .*; got 'multicol', a format .* for reading only"
    with pytest.raises(OmnimirrorError, match=message):
        om.convert(RIGHT, tmp_path / "a.yaml", to="multicol")


@pytest.mark.parametrize("to", ["py-ocamcalib", "py-omnicalib"])
def test_inverse_polynomials_of_other_programs(tmp_path, to):
    om.convert(RIGHT, tmp_path / "a", to=to)
    assert read(tmp_path / "a", optics="mirror")[2] == ()
    text = (tmp_path / "a").read_text()
    table = json.loads(text) if to == "py-ocamcalib" else yaml.safe_load(text)
    name = "inverse_poly" if to == "py-ocamcalib" else "poly_incident_angle_to_radius"
    table[name] = [1.1 * p for p in table[name]]
    (note,) = read(tmp_path / "b", json.dumps(table), "mirror")[2]
    assert "inverse polynomial of the file differs from the direct one by up to 38." in note


def test_the_inverse_polynomial_is_compared_as_far_as_the_field(tmp_path):
    """0.33 px is a fit residual; the comparison ends at the rim."""
    angles = np.linspace(0.0, RIGHT.omega_max, 500)
    radius = RIGHT.radius_from_omega(angles)
    inverse = np.polynomial.Polynomial.fit(angles - np.pi / 2, radius, 20).convert().coef
    assert inverse_polynomial_warnings(RIGHT, inverse) == []
    changed = inverse.copy()
    changed[0] += 0.7
    assert inverse_polynomial_warnings(RIGHT, changed) == []
    changed[0] += 0.7
    assert "up to 1.4 px" in inverse_polynomial_warnings(RIGHT, changed)[0]


def test_the_base_of_all_errors_is_at_the_top():
    assert issubclass(SpecError, om.OmnimirrorError)
