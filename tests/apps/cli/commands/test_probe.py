"""``omnimirror probe``: light probes from image files."""

import numpy as np
import pytest

import omnimirror as om
from omnimirror.apps.cli import main
from omnimirror.base.colour import srgb_from_linear

BALL = ("--ball", "63.5,63.5,60,340", "--camera-looks", "forward")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Uniform light 4 on the ball: above the white of a long exposure, 0.5 in a short one."""
    monkeypatch.chdir(tmp_path)
    for name, share in (("long", 1.0), ("short", 1 / 8)):
        image = np.full((128, 128, 3), np.rint(255 * srgb_from_linear(4 * share)), np.uint8)
        om.write_image(f"{name}.png", image)
    om.write_image("light.exr", np.full((128, 128, 3), 4.0, np.float32))
    return tmp_path


def error_message(capsys, *args) -> str:
    with pytest.raises(SystemExit, match=r"^[12]$"):
        main(["probe", *args])
    return capsys.readouterr().err


@pytest.mark.usefixtures("folder")
def test_exposures_are_merged(capsys):
    main(
        [
            "probe",
            *("long.png", "short.png"),
            *BALL,
            *("--exposures-s", "1/4,1/32", "--width-px", "64", "-o", "probe.hdr"),
        ]
    )
    probe = om.read_image("probe.hdr")
    assert probe.shape == (32, 64, 3)
    np.testing.assert_allclose(probe, 4.0, rtol=0.01)
    assert "probe.hdr: light probe, 64 x 32 px, 9" in capsys.readouterr().out


@pytest.mark.usefixtures("folder")
def test_linear_image_with_reflectance():
    main(["probe", "light.exr", *BALL, "--reflectance", "0.5,0.8,1", "-o", "probe.exr"])
    probe = om.read_image("probe.exr")
    np.testing.assert_allclose(probe, np.broadcast_to([8.0, 5.0, 4.0], probe.shape), rtol=1e-5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("long.png", "short.png", *BALL), "2 images require --exposures-s"),
        (
            ("long.png", *BALL, "--exposures-s", "1/8,1/60"),
            "exposures_s must contain one time per image; got 2 for 1 images",
        ),
        (("long.png", *BALL, "--exposures-s", "1/0"), "must be positive numbers such as 1/60"),
        (("long.png", *BALL, "--reflectance", "0.5,0.6"), "must be R or R,G,B; got '0.5,0.6'"),
        (("long.png", *BALL, "--reflectance", "2"), "reflectance must be"),
        (("long.png",), "exactly one of --sensor and --ball must be given"),
        (
            ("light.exr", "light.exr", *BALL, "--exposures-s", "1,2"),
            "images must be uint8 or uint16",
        ),
    ],
)
@pytest.mark.usefixtures("folder")
def test_invalid_requests_write_nothing(arguments, message, capsys, folder):
    assert message in error_message(capsys, *arguments, "-o", "probe.hdr")
    assert not (folder / "probe.hdr").exists()


@pytest.mark.usefixtures("folder")
def test_formats_without_values_above_one_are_rejected(capsys):
    message = error_message(capsys, "long.png", *BALL, "-o", "probe.png")
    assert "the file of a light probe must be .hdr or .exr, for values above 1" in message
