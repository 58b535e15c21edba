"""Command ``omnimirror dewarp`` on single images."""

from pathlib import Path

import cv2
import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.formats import _scaramuzza
from omnimirror.dewarp.request import BorderColour
from omnimirror.io.video_frames import empty_frame

MIRRORBALL = Path(__file__).parents[5] / "shared/data/mirrorball"
OCAM = _scaramuzza.write_ocamcalib(
    om.OCam(polynomial=(-100.0, 0.0, 2.5e-3), centre_px=(79.5, 59.5), image_size=(160, 120))
)
SPHERE = ["--sensor", "paper-spherical"]
BALL = ["--ball", "99.5,99.5,90,260"]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with images for a bundled sensor, a ball and an OCam file only."""
    monkeypatch.chdir(tmp_path)
    om.write_image("sphere.png", np.full((1024, 1024, 3), 200, np.uint8))
    om.write_image("ball.png", np.full((200, 200), 100, np.uint8))
    om.write_image("ocam.png", np.full((120, 160, 3), 50, np.uint8))
    om.write_image("deep.png", np.full((200, 200), 50_000, np.uint16))
    Path("calib.txt").write_text(OCAM)
    om.save_camera(
        om.Unified(
            xi=0.9, focal_px=(60.0, 60.0), centre_px=(79.5, 59.5), image_size=(160, 120), k1=-0.05
        ),
        "symmetric.toml",
    )
    om.save_camera(
        om.Unified(
            xi=0.9,
            focal_px=(60.0, 61.0),
            centre_px=(79.5, 59.5),
            image_size=(160, 120),
            skew_px=0.1,
            k1=-0.05,
            p1=0.01,
        ),
        "distorted.toml",
    )
    Path("broken.txt").write_text(OCAM.replace("120 160", "120"))
    Path("note.txt").write_text("no picture")
    Path("cut.png").write_bytes(Path("sphere.png").read_bytes()[:-40])
    return tmp_path


def dewarp(*args):
    """Return the exit code of ``omnimirror dewarp args``."""
    try:
        main(["dewarp", *map(str, args)])
    except SystemExit as e:
        return e.code or 0
    return 0


def test_ball_camera_looks_up_by_default(folder):
    """This default is documented in the help and in docs/dewarp.md."""
    v, u = np.mgrid[:200, :200]
    om.write_image("ball.png", np.where(v < 100, 30 + u, 250 - u).astype(np.uint8))
    views = {}
    for name, options in {
        "default": [],
        "up": ["--camera-looks", "up"],
        "forward": ["--camera-looks", "forward"],
    }.items():
        assert (
            dewarp(
                "ball.png",
                *BALL,
                *options,
                "--size",
                "96x",
                "--set=image.transparent=false",
                "-o",
                f"{name}.png",
            )
            == 0
        )
        views[name] = om.read_image(f"{name}.png").astype(float)
    np.testing.assert_array_equal(views["default"], views["up"])
    assert (
        views["forward"].shape != views["up"].shape
        or np.abs(views["forward"] - views["up"]).max() > 50
    )


CAMERAS = [
    ("sphere.png", SPHERE),
    ("ball.png", BALL),
    ("ocam.png", ["--sensor", "calib.txt"]),
    ("ocam.png", ["--sensor", "symmetric.toml"]),
    ("ocam.png", ["--sensor", "distorted.toml"]),
    (
        "ocam.png",
        [
            "--sensor",
            "calib.txt",
            "--set",
            "camera.optics=fisheye",
            "--set",
            "camera.rim_radius_px=70",
        ],
    ),
]
VIEWS = [
    [],
    ["--view", "perspective", "--tilt-deg", "-40"],
    ["--view", "dome"],
    ["--view", "sphere"],
    ["--view", "planet"],
    ["--view", "cube", "--set", "view.layout=strip", "--distance-mm", "800"],
    ["--view", "mosaic", "--distance-mm", "800", "--set", "view.viewpoint=single"],
    ["--view", "super-wide", "--tilt-deg", "-40"],
]


@pytest.mark.parametrize(
    ("image_file", "source", "view"),
    [  # all views of two cameras; one view and one mosaic of the others
        pytest.param(*camera, view, marks=() if i in (0, 5) or k in (0, 6) else pytest.mark.full)
        for i, camera in enumerate(CAMERAS)
        for k, view in enumerate(VIEWS)
    ],
)
def test_all_views_of_all_cameras(folder, capsys, image_file, source, view):
    if "camera.optics=fisheye" in source and "--tilt-deg" in view:
        view = [*view[:-1], "40"]
    assert dewarp(image_file, *source, *view, "-o", "out.png") == 0
    output = capsys.readouterr()
    assert output.err == ""
    assert output.out.count("\n") == 1
    assert output.out.startswith("out.png: ")
    image = om.read_image("out.png")
    assert image.shape[2] == 4
    assert f"{image.shape[1]} x {image.shape[0]} px" in output.out
    value = om.read_image(image_file).flat[0]
    assert set(np.unique(image[..., 0])) <= {0, value}
    assert (image[..., 0] == value).mean() > 0.05
    np.testing.assert_array_equal(image[..., 3] == 255, image[..., 0] == value)


def test_printed_line_describes_view(folder, capsys):
    assert (
        dewarp(
            "sphere.png", *SPHERE, "--size", "720x", "--elevation-deg", "-45:90", "-o", "out.jpg"
        )
        == 0
    )
    assert (
        capsys.readouterr().out
        == "out.jpg: panorama (elevation -45 to 90 deg), 720 x 270 px, 66.7 % of the pixels inside the field\n"
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            [
                "--view",
                "perspective",
                "--pan-deg",
                "30",
                "--tilt-deg",
                "-20",
                "--set",
                "view.roll_deg=5",
                "--hfov-deg",
                "60",
            ],
            "perspective view (pan 30, tilt -20, roll 5, hfov 60 deg), 1280 x 720 px, all pixels",
        ),
        (
            [
                "--set",
                "view.span_deg=90",
                "--pan-deg",
                "10",
                "--size",
                "x100",
                "--elevation-deg=-60:30",
            ],
            "panorama (90 deg around pan 10, elevation -60 to 30 deg), 100 x 100 px",
        ),
        (
            ["--set", "view.omega_deg=30:120", "--size", "400X"],
            "panorama (elevation -60 to 30 deg), 400 x 100 px",
        ),
        (
            ["--set", "view.omega_deg=30:120", "--size", "400x100", "--camera-looks", "down"],
            "(elevation -30 to 60 deg)",
        ),
        (
            ["--view", "dome", "--set", "view.omega_deg=20:90", "--size", "300x"],
            "dome (20 to 90 deg from the nadir), 300 x 300",
        ),
        (["--view", "dome", "--camera-looks", "down", "--size", "30x"], "from the zenith"),
        (
            [
                "--set=view.wall_mm=-1200:900",
                "--distance-mm",
                "2000",
                "--set",
                "view.span_deg=90",
                "--size",
                "300x",
            ],
            "panorama (90 deg around pan 0, elevation -30.9638 to 24.2277 deg, at 2000 mm), 300 x 201 px, all",
        ),
        (
            ["--set", "view.rows=height", "--elevation-deg=-45:45", "--size", "400x"],
            "400 x 127 px, all",
        ),
        (
            [
                "--view",
                "sphere",
                "--size",
                "200x",
                "--distance-mm",
                "500",
                "--set=view.offset_mm=-10,0,25",
            ],
            "sphere (elevation -90 to 90 deg, at 500 mm, offset by (-10, 0, 25) mm), 200 x 100 px",
        ),
        (
            [
                "--view",
                "ground",
                "--set",
                "view.height_mm=1200",
                "--set",
                "view.mm_per_px=4",
                "--size",
                "300x",
                "--set",
                "view.offset_mm=900,0,0",
            ],
            "plan of the ground (1200 mm below the mirror, 4 mm per pixel, offset by (900, 0, 0) mm), 300 x 300 px",
        ),
        (
            [
                "--view",
                "planet",
                "--hfov-deg",
                "200",
                "--set",
                "view.pole=nadir",
                "--size",
                "90x60",
            ],
            "little planet (hfov 200 deg about the nadir), 90 x 60 px, all",
        ),
        (
            ["--view", "cube", "--set", "view.layout=3x2", "--size", "90x"],
            "cube map (3x2 of 30 px faces), 90 x 60 px",
        ),
        (
            ["--view", "mosaic", "--size", "400x", "--tilt-deg", "-20"],
            "mosaic of 5 views, 400 x 225 px, all",
        ),
        (
            ["--view", "distant", "--pan-deg", "20", "--size", "64x"],
            "(pan 20, tilt 0, hfov 28.0725 deg), 64 x 36",
        ),
        (
            ["--view", "super-wide", "--tilt-deg", "-10"],
            "180 deg around pan 0, elevation -46.6656 to 35.2697 deg",
        ),
        (["--view", "perspective", "--set", "view.zoom=1.5", "--size", "320x"], "hfov 67.3801 deg"),
        (
            [
                "--view",
                "ground",
                "--set",
                "view.height_mm=1200",
                "--set",
                "view.zoom=2",
                "--set",
                "view.mm_per_px=20",
                "--size",
                "99x",
            ],
            "10 mm per pixel",
        ),
        (
            [
                "--view",
                "perspective",
                "--size",
                "64x",
                "--interpolation",
                "cubic",
                "--set=camera.image_flipped=true",
            ],
            "64 x 36 px",
        ),
    ],
)
def test_view_options(folder, capsys, options, message):
    assert dewarp("sphere.png", *SPHERE, *options, "-o", "out.png") == 0
    assert message in capsys.readouterr().out


@pytest.mark.parametrize("viewpoint", ["exact", "single", "11.5"])
def test_viewpoint_option(folder, viewpoint):
    rng = np.random.default_rng(0)
    om.write_image("a.png", rng.integers(1, 255, (1024, 1024, 3), np.uint8))
    args = [
        "a.png",
        *SPHERE,
        "--view",
        "perspective",
        "--size",
        "64x48",
        "--distance-mm",
        "200",
        "--set=image.transparent=false",
    ]
    assert (
        dewarp(
            *args,
            "--set",
            f"view.viewpoint={viewpoint}",
            "--interpolation",
            "nearest",
            "-o",
            "out.png",
        )
        == 0
    )
    view = om.screens.Plane((64, 48), distance_mm=200.0)
    v = viewpoint if viewpoint.isalpha() else float(viewpoint)
    expected = om.Dewarper(om.load_sensor("paper-spherical"), view, "nearest", v)(
        om.read_image("a.png")
    )
    np.testing.assert_array_equal(om.read_image("out.png"), expected)


def test_zoom_beyond_resolution_is_reported(folder, capsys):
    args = ["sphere.png", *SPHERE, "--view", "perspective", "--size", "640x480", "-o", "out.png"]
    assert dewarp(*args, "--set", "view.zoom=50") == 0
    limited = capsys.readouterr()
    assert limited.err.startswith("omnimirror: zoom 50 exceeds the resolution of the sensor (")
    assert limited.err.endswith(
        " output pixels per source pixel); limited to 3.39; use --set view.allow_upsampling=true to remove the limit\n"
    )
    assert "hfov 32.8" in limited.out
    assert dewarp(*args, "--set", "view.zoom=50", "--set=view.allow_upsampling=true") == 0
    output = capsys.readouterr()
    assert output.err.startswith("omnimirror: zoom 50 exceeds the resolution of the sensor (59.0")
    assert output.err.endswith(" output pixels per source pixel)\n")
    assert "hfov 2.29" in output.out
    assert dewarp(*args, "--set", "view.zoom=3") == 0
    assert capsys.readouterr().err == ""


def test_mount_options_rotate_view(folder):
    rng = np.random.default_rng(0)
    image = rng.integers(1, 255, (1024, 1024, 3), np.uint8)
    om.write_image("a.png", image)
    args = [
        "a.png",
        *SPHERE,
        "--view",
        "perspective",
        "--size",
        "64x48",
        "--tilt-deg",
        "-30",
        "--set=image.transparent=false",
    ]
    assert dewarp(*args, "-o", "top.png") == 0
    assert (
        dewarp(*args, "--set", "camera.forward_azimuth_deg=0", "--pan-deg", "90", "-o", "right.png")
        == 0
    )
    # for an upward camera, pan to the right decreases the azimuth: 0 - 90 is the top again
    np.testing.assert_array_equal(om.read_image("top.png"), om.read_image("right.png"))
    om.write_image("b.png", image[:, ::-1])
    assert dewarp("b.png", *args[1:], "--set=camera.image_flipped=true", "-o", "flipped.png") == 0
    difference = np.abs(om.read_image("flipped.png").astype(int) - om.read_image("top.png"))
    assert difference.mean() < 2


@pytest.mark.parametrize(
    ("name", "channels"), [("o.png", 4), ("o.tif", 4), ("o.webp", 4), ("o.jpg", 3), ("o.bmp", 3)]
)
def test_transparency_by_file_format(folder, name, channels):
    assert (
        dewarp("sphere.png", *SPHERE, "--size", "60x40", "--elevation-deg", "-90:90", "-o", name)
        == 0
    )
    view = om.read_image(name)
    assert view.shape == (40, 60, channels)
    assert (view[:9] < 20).all()
    assert (view[12:] > 190).all()


def test_black_keeps_channels(folder):
    assert (
        dewarp(
            "deep.png",
            *BALL,
            "--size",
            "60x40",
            "--elevation-deg",
            "-90:90",
            "--set=image.transparent=false",
            "-o",
            "o.tif",
        )
        == 0
    )
    view = om.read_image("o.tif")
    assert (view.dtype, view.shape) == (np.uint16, (40, 60))
    assert (view[0, 0], view[20, 20]) == (0, 50_000)


@pytest.mark.parametrize("interpolation", ["auto", "nearest", "linear", "cubic", "area"])
def test_all_interpolations(folder, interpolation):
    args = [
        "sphere.png",
        *SPHERE,
        "--size",
        "60x40",
        "--interpolation",
        interpolation,
        "--set",
        "resampling.threads=2",
    ]
    assert dewarp(*args, "-o", "o.png") == 0
    assert (om.read_image("o.png")[20] == [200, 200, 200, 255]).all()


@pytest.mark.parametrize(
    ("image_file", "source", "border", "expected"),
    [
        ("sphere.png", SPHERE, "17", [17, 17, 17]),
        ("sphere.png", SPHERE, "1,20,255", [1, 20, 255]),
        ("sphere.png", SPHERE, "#0114ff", [1, 20, 255]),
        ("ball.png", BALL, "#111111", 17),
        ("deep.png", BALL, "40000", 40_000),
        ("deep.png", BALL, "#808080", 0x8080),
        ("clear.png", BALL, "#0114ff", [1, 20, 255, 255]),
        ("clear.png", BALL, "9", [9, 9, 9, 255]),
        ("light.tif", BALL, "#ffffff", [1.0, 1.0, 1.0]),
        ("light.tif", BALL, "0,0.5,-2", [0.0, 0.5, -2.0]),
    ],
)
def test_border_colour(folder, image_file, source, border, expected):
    om.write_image("clear.png", np.full((200, 200, 4), 200, np.uint8))
    om.write_image("light.tif", np.full((200, 200, 3), 0.3, np.float32))
    output_file = "o.tif" if image_file.endswith("tif") else "o.png"
    assert (
        dewarp(
            image_file,
            *source,
            "--size",
            "60x40",
            "--elevation-deg",
            "-90:90",
            "--border",
            border,
            "-o",
            output_file,
        )
        == 0
    )
    view = om.read_image(output_file)
    np.testing.assert_array_equal(view[0, 0], expected)
    np.testing.assert_allclose(view[30, 0], om.read_image(image_file)[100, 100], rtol=1e-6)


@pytest.mark.parametrize(
    ("border", "dtype", "channels", "expected"),
    [
        ("#0a141e", "uint8", 3, (10, 20, 30)),
        ("#0a141e", "uint8", 4, (10, 20, 30, 255)),
        ("#0A141E", "uint16", 4, (2570, 5140, 7710, 65535)),
        ("#ff0000", "float32", 4, (1, 0, 0, 1)),
        (
            "#80ff0a",
            "float32",
            3,
            [
                ((v / 255 + 0.055) / 1.055) ** 2.4 if v > 10 else v / 255 / 12.92
                for v in (128, 255, 10)
            ],
        ),
        ("0", "uint8", 3, (0, 0, 0)),
        (255, "uint8", 1, (255,)),
        (65535, "uint16", 1, (65535,)),
        ((7, 7, 7), "uint8", 1, (7,)),
        (-0.5, "float32", 3, (-0.5, -0.5, -0.5)),
        (BorderColour.of("1,2,3"), "uint8", 3, (1, 2, 3)),
    ],
)
def test_border_colour_is_converted_to_image_format(border, dtype, channels, expected):
    for shape in {(2, 2), (2, 2, 1)} if channels == 1 else {(2, 2, channels)}:
        assert BorderColour.of(border).for_image(np.zeros(shape, dtype)) == pytest.approx(
            tuple(expected), rel=1e-6
        )


@pytest.mark.parametrize(
    "border",
    [
        "#12345",
        "#1234567",
        "#1234g6",
        "1,2",
        "1,2,3,4",
        "",
        "nan",
        "1,inf,3",
        (),
        (1, 2),
        "#",
        None,
    ],
)
def test_invalid_border_colour_raises(border):
    with pytest.raises(InvalidParameter, match="border must be a grey level, R,G,B or #rrggbb"):
        BorderColour.of(border)


@pytest.mark.parametrize("border", [-1, 0.5, 256, (0, 0, 256)])
def test_border_colour_out_of_range_raises(border):
    with pytest.raises(
        InvalidParameter, match="border must contain integers from 0 to 255 for uint8 images"
    ):
        BorderColour.of(border).for_image(np.zeros((2, 2, 3), np.uint8))


@pytest.mark.parametrize(
    ("border", "coded"),
    [
        ("#ff0000", (81, 90, 240)),
        ("0,255,0", (145, 54, 34)),
        ((0, 0, 255), (41, 240, 110)),
        (255, (235, 128, 128)),
    ],
)
def test_video_border_is_encoded_as_frames(border, coded):
    """Corners of the colour cube in ITU-R BT.601."""
    assert BorderColour.of(border).for_frame(empty_frame((64, 48))[0]) == coded


def test_colour_border_of_grey_image_raises():
    with pytest.raises(
        InvalidParameter, match="border must be one value for a grey image; got 1,2,2"
    ):
        BorderColour.of("1,2,2").for_image(np.zeros((2, 2), np.uint8))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("sphere.png", "exactly one of --sensor and --ball must be given; got none"),
        ("sphere.png SPHERE BALL", "got --sensor and --ball"),
        ("sphere.png SPHERE NO-OUTPUT", "--output must be given"),
        ("-o out.png SPHERE", "Missing argument 'SOURCE...'"),
        ("none.png SPHERE", "cannot read the image none.png: the file does not exist"),
        ("note.txt SPHERE", "cannot read the image note.txt: it must be an undamaged image file"),
        ("cut.png SPHERE", "cannot read the image cut.png: the file is truncated"),
        (". SPHERE", "must be a folder for several images"),
        (
            "ball.png SPHERE",
            "1024 x 1024 px of the camera; got 200 x 200 px; the aspect ratios are equal",
        ),
        ("ocam.png SPHERE", "1024 x 1024 px of the camera; got 160 x 120 px"),
        ("sphere.png --sensor paper-sperical", "did you mean paper-spherical?"),
        ("sphere.png --sensor note.txt", "note.txt must be valid TOML"),
        ("ocam.png --sensor none.txt", "bundled sensor 'none.txt' does not exist"),
        (
            "ocam.png --sensor broken.txt",
            "broken.txt line 19: the image size (height and width) must be 2 numbers",
        ),
        ("ocam.png --sensor ocam.png", "the file must be text in UTF-8"),
        ("ocam.png --sensor calib.txt --set camera.optics=prism", "'prism'"),
        (
            "ocam.png --sensor calib.txt --set camera.rim_radius_px=-3",
            "rim_radius_px must be greater than 0 px and at most 1e+06 px; got -3",
        ),
        ("ocam.png --sensor calib.txt --set camera.rim_radius_px=big", "'big'"),
        (
            "sphere.png SPHERE --set camera.optics=mirror",
            "entries of camera require a camera file",
        ),
        ("ball.png --ball 99,99,90", "must be CX,CY,R,FOV"),
        ("ball.png --ball 99,99,90,x", "must be CX,CY,R,FOV"),
        ("ball.png --ball 99,99,90,nan", "must be CX,CY,R,FOV"),
        (
            "ball.png --ball 99,99,0,260",
            "rim_radius_px must be greater than 0 px and at most 1e+06 px; got 0.0",
        ),
        (
            "ball.png --ball 99,99,90,400",
            "field_deg must be greater than 0 and at most 360 deg; got 400",
        ),
        (
            "ball.png --ball 9999,99,90,260",
            "at least one pixel of the camera must observe the scene",
        ),
        ("sphere.png SPHERE --view globe", "'globe'"),
        (
            "sphere.png SPHERE --set view.roll_deg=3",
            "--set view.roll_deg requires --view perspective; it does not apply to --view panorama",
        ),
        ("sphere.png SPHERE --hfov-deg 3", "--hfov-deg requires"),
        ("sphere.png SPHERE --tilt-deg 3 --view dome", "it does not apply to --view dome"),
        ("sphere.png SPHERE --elevation-deg 0:9 --view dome", "--elevation-deg requires"),
        (
            "sphere.png SPHERE --set view.omega_deg=0:9 --view perspective",
            "requires --view panorama, --view dome or --view sphere",
        ),
        (
            "sphere.png SPHERE --set view.span_deg=9 --view perspective",
            "--set view.span_deg requires",
        ),
        (
            "sphere.png SPHERE --set view.omega_deg=0:9 --elevation-deg 0:9",
            "must not be given together",
        ),
        (
            "sphere.png SPHERE --set view.omega_deg=50:100 --camera-looks forward",
            "use --elevation-deg",
        ),
        ("sphere.png SPHERE --elevation-deg 9:0", "got 9 and 0 deg"),
        ("sphere.png SPHERE --elevation-deg 9", "must be a range MIN:MAX in degrees; got '9'"),
        ("sphere.png SPHERE --elevation-deg 50:80", "must overlap the field of the camera"),
        (
            "sphere.png SPHERE --set view.span_deg=400",
            "span_deg must be above 1e-06 and up to 360 deg; got 400",
        ),
        ("sphere.png SPHERE --pan-deg north", "must be an angle in degrees; got 'north'"),
        ("sphere.png SPHERE --pan-deg inf", "must be an angle in degrees; got 'inf'"),
        ("sphere.png SPHERE --view perspective --hfov-deg 180", "below 180 deg; got 180"),
        (
            "sphere.png SPHERE --view ground",
            "--view ground requires --set view.height_mm=MM, the height of the mirror",
        ),
        (
            "sphere.png SPHERE --view ground --set view.height_mm=high",
            "must be a height in mm; got 'high'",
        ),
        (
            "sphere.png SPHERE --view ground --set view.height_mm=9 --set view.mm_per_px=0",
            "must be a distance in mm above 0, or 'inf'; got '0'",
        ),
        (
            "sphere.png SPHERE --view ground --set view.height_mm=9 --set view.mm_per_px=inf",
            "mm_per_px must be finite and above 0; got inf",
        ),
        (
            "sphere.png SPHERE --view ground --set view.height_mm=0",
            "height_mm must not be 0 without mm_per_px; got 0",
        ),
        (
            "sphere.png SPHERE --view ground --set view.height_mm=9 --distance-mm 9",
            "it does not apply to --view ground",
        ),
        (
            "sphere.png SPHERE --set view.height_mm=9",
            "--set view.height_mm requires --view ground; it does not apply to --view panorama",
        ),
        (
            "sphere.png SPHERE --set view.layout=strip",
            "--set view.layout requires --view cube; it does not apply to --view panorama",
        ),
        ("sphere.png SPHERE --view cube --set view.layout=ring", "'ring'"),
        (
            "sphere.png SPHERE --view cube --size 100x100",
            "4 n x 3 n px for square faces in the layout cross",
        ),
        ("sphere.png SPHERE --view cube --set view.zoom=2", "it does not apply to --view cube"),
        ("sphere.png SPHERE --view mosaic --size x100", "the height of a mosaic must be None"),
        ("sphere.png SPHERE --view planet --hfov-deg 360", "below 360 deg; got 360"),
        ("sphere.png SPHERE --set view.pole=nadir", "it does not apply to --view panorama"),
        (
            "ball.png BALL --set camera.rim_radius_px=90",
            "--set camera.rim_radius_px requires --sensor; it does not apply to --ball",
        ),
        ("sphere.png SPHERE --view wide --hfov-deg 9", "--hfov-deg requires --view perspective"),
        ("sphere.png SPHERE --view tele", "'tele'"),
        ("sphere.png SPHERE --view super-wide --tilt-deg 90", "below 90 deg; got 90"),
        (
            "sphere.png SPHERE --distance-mm 0",
            "must be a distance in mm above 0, or 'inf'; got '0'",
        ),
        (
            "sphere.png SPHERE --set view.offset_mm=1,2,3",
            "for a screen at infinity; got (1.0, 2.0, 3.0)",
        ),
        (
            "sphere.png SPHERE --set view.offset_mm=1,2 --distance-mm 9",
            "must be X,Y,Z in mm; got '1,2'",
        ),
        (
            "sphere.png SPHERE --set view.viewpoint=single",
            "--set view.viewpoint requires --distance-mm",
        ),
        (
            "sphere.png SPHERE --set view.viewpoint=best --distance-mm 9",
            "must be 'exact', 'single' or a height",
        ),
        ("sphere.png SPHERE --set view.wall_mm=0:9", "--set view.wall_mm requires --distance-mm"),
        (
            "sphere.png SPHERE --set view.wall_mm=9:0 --distance-mm 9",
            "view.wall_mm must be LOW:HIGH",
        ),
        (
            "sphere.png SPHERE --set view.wall_mm=0:9 --distance-mm 9 --set view.rows=tilt",
            "--set view.wall_mm and --set view.rows must not be given together",
        ),
        (
            "sphere.png SPHERE --set view.rows=height",
            "above -90 and below 90 deg with rows = 'height'",
        ),
        ("sphere.png SPHERE --set view.zoom=0", "must be a factor above 0; got '0'"),
        (
            "sphere.png SPHERE --set view.allow_upsampling=true",
            "--set view.allow_upsampling requires --set view.zoom",
        ),
        (
            "sphere.png SPHERE --view perspective --tilt-deg 80 --hfov-deg 10",
            "must overlap the field of the camera",
        ),
        ("sphere.png SPHERE --size big", "must be a size in pixels"),
        ("sphere.png SPHERE --size 0x5", "size must be greater than 0 px and finite; got 0"),
        (
            "sphere.png SPHERE --size 999999x5",
            "size must be (width, height) from 1 to 100000 px; got (999999, 5)",
        ),
        ("sphere.png SPHERE --camera-looks left", "'left'"),
        ("sphere.png SPHERE --interpolation magic", "'magic'"),
        (
            "sphere.png SPHERE --border red",
            "border must be a grey level, R,G,B or #rrggbb; got 'red'",
        ),
        ("sphere.png SPHERE --border #12345g", "got '#12345g'"),
        ("sphere.png SPHERE --border 1,2", "got '1,2'"),
        ("sphere.png SPHERE --border 256", "for uint8 images; got 256"),
        ("ball.png BALL --border #ff0000", "one value for a grey image; got #ff0000"),
        (
            "sphere.png SPHERE --border 5 --set image.transparent=false",
            "--border and --set image.transparent must not be given together",
        ),
        ("sphere.png SPHERE --set resampling.threads=0", "0 is not in the range 1<=x<=1024"),
        ("sphere.png SPHERE -o out.gif", "got '.gif'"),
        ("sphere.png SPHERE -o out", "got ''"),
        (
            "sphere.png SPHERE --set image.transparent=true -o out.jpg",
            "for transparency; got a .jpg file",
        ),
        ("sphere.png SPHERE -o note.txt/out.png", "cannot write note.txt"),
        ("sphere.png SPHERE --fast", "--fast"),
        ("sphere.png SPHERE -o ./sphere.png", "the output must differ from the source image"),
    ],
)
def test_invalid_arguments_print_one_line(folder, capfd, line, message):
    """Each line is completed by ``-o out.png`` unless it contains an output or must not have one."""
    output = "" if "-o" in line.split() or "NO-OUTPUT" in line else " -o out.png"
    substitutions = {"SPHERE": SPHERE, "BALL": BALL, "NO-OUTPUT": []}
    args = [arg for word in (line + output).split() for arg in substitutions.get(word, [word])]
    before = {p: p.read_bytes() for p in folder.iterdir()}
    assert dewarp(*args) in (1, 2)
    messages = capfd.readouterr()
    assert messages.out == ""
    assert message in messages.err
    assert messages.err.startswith("omnimirror: ")
    assert messages.err.count("\n") == 1
    assert "Traceback" not in messages.err
    assert {p: p.read_bytes() for p in folder.iterdir()} == before


def test_help(capsys):
    assert dewarp("--help") == 0
    output = capsys.readouterr().out
    for word in (
        "--ball",
        "CX,CY,R,FOV",
        "--elevation-deg",
        "MIN:MAX",
        "docs/dewarp.md",
    ):
        assert word in output


def max_correlation(image, text):
    """Return the largest correlation of an image with a word drawn by OpenCV, over sizes and
    positions."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_TRIPLEX, 3, 9)
    text_image = np.zeros((height + 20, width + 20), np.uint8)
    cv2.putText(text_image, text, (10, height + 10), cv2.FONT_HERSHEY_TRIPLEX, 3, 255, 9)
    maximum = 0.0
    for w in range(100, 135, 6):
        for h in range(50, 80, 6):
            template = cv2.GaussianBlur(
                cv2.resize(text_image, (w, h), interpolation=cv2.INTER_AREA), (5, 5), 1.5
            )
            maximum = max(maximum, cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED).max())
    return maximum


@pytest.mark.skipif(not MIRRORBALL.exists(), reason=f"no photographs at {MIRRORBALL}")
def test_sign_in_store_is_legible(folder):
    """The brand name of a loudspeaker at the right rear of the camera; it is reversed in the raw
    image."""
    args = [
        MIRRORBALL / "store.jpg",
        "--ball",
        "1226,1217.5,1122.75,260",
        "--view",
        "perspective",
        "--set=image.transparent=false",
    ]
    args += ["--pan-deg", "109", "--tilt-deg", "-2.2", "--hfov-deg", "5.5", "--size", "160x90"]
    assert dewarp(*args, "-o", "sign.png") == 0
    sign = cv2.cvtColor(om.read_image("sign.png"), cv2.COLOR_RGB2GRAY)
    assert max_correlation(sign, "FOCAL") > max(
        0.55, max_correlation(sign[:, ::-1].copy(), "FOCAL") + 0.1
    )
