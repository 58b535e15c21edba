"""Images in three colours, each with its own refraction by lens and cover."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import Dome, Housing
from tests.commands import fails, omnimirror

WAVES = (650.0, 550.0, 440.0)


@pytest.fixture(scope="module")
def domed():
    """A strongly decentred dome of dispersive glass, with colour shifts of pixels."""
    sensor = om.load_sensor("paper-spherical")
    imager = replace(sensor.imager, width_px=256, height_px=256, pixel_pitch_um=20.8)
    return replace(
        sensor, imager=imager, housing=Housing(shell=Dome(material="polycarbonate", wall_mm=20.0))
    )


@pytest.fixture(scope="module")
def light(domed):
    return om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=WAVES)


def test_channels_match_wavelengths(domed, light):
    for i, nm in enumerate(WAVES):
        alone = om.expose(om.at_wavelength(domed, nm), om.Room(texel_mm=40.0), samples=1)
        np.testing.assert_array_equal(light[..., i], alone[..., i])
    plain = om.expose(domed, om.Room(texel_mm=40.0), samples=1)
    assert np.abs(light - plain)[..., 0].max() > 0.1


class Stripes:
    """Grey rings about the axis with a width of several pixels."""

    def radiance(self, origins_mm, directions):
        tilt = np.arcsin(directions[:, 2] / np.linalg.norm(directions, axis=1))
        return np.repeat((0.5 + 0.4 * np.cos(60 * tilt))[:, None], 3, axis=1).astype(np.float32)


def test_colour_dewarper_aligns_channels(domed):
    view = om.views.panorama(domed, (256, None), elevation_deg=(-30.0, 30.0))
    image = om.expose(domed, Stripes(), samples=4, wavelengths_nm=WAVES)
    cameras = tuple(om.at_wavelength(domed, nm) for nm in WAVES)
    fringes = []
    for dewarp in (om.Dewarper(domed, view), om.ColourDewarper(cameras, view)):
        red, _, blue = np.moveaxis(dewarp(image), -1, 0)
        fringes.append(float(np.sqrt(np.mean((red - blue) ** 2))))
    assert fringes[0] > 0.02
    assert fringes[1] < 0.3 * fringes[0]


@pytest.mark.parametrize("channels", [3, 4])
@pytest.mark.parametrize("transparent", [False, True])
def test_channels_use_their_camera(domed, channels, transparent):
    view = om.views.panorama(
        domed, (200, None), elevation_deg=(-60.0, 60.0)
    )  # extends beyond the field
    cameras = tuple(om.at_wavelength(domed, nm) for nm in WAVES)
    image = np.random.default_rng(5).integers(0, 256, (256, 256, channels), np.uint8)
    border = (9, 8, 7, 0)[:channels]
    out = np.empty((view.size[1], view.size[0], 4 if transparent else channels), np.uint8)
    dewarp = om.ColourDewarper(cameras, view, border=border)
    assert dewarp(image, transparent, out) is out
    whole = [om.Dewarper(camera, view, border=border)(image, transparent) for camera in cameras]
    for channel, camera_index in enumerate((0, 1, 2, 1)[: out.shape[2]]):
        np.testing.assert_array_equal(out[..., channel], whole[camera_index][..., channel])
    np.testing.assert_array_equal(dewarp.valid, om.Dewarper(cameras[1], view).valid)
    assert not dewarp.valid.all()


def test_command_line_aligns_channels(domed, tmp_path):
    om.save_sensor(domed, tmp_path / "domed.toml")
    light = om.expose(domed, Stripes(), samples=4, wavelengths_nm=WAVES)
    om.write_image(tmp_path / "rings.png", np.round(255 * np.clip(light, 0, 1)).astype(np.uint8))
    fringes = []
    for i, options in enumerate(
        [(), ("--set", f"image.wavelengths_nm={','.join(map(str, WAVES))}")]
    ):
        arguments = (
            "rings.png",
            "--sensor",
            "domed.toml",
            "--elevation-deg=-30:30",
            "--size",
            "256x",
            "--set=image.transparent=false",
        )
        done = omnimirror("dewarp", *arguments, *options, "-o", f"{i}.png", cwd=tmp_path)
        assert done.returncode == 0, done.stderr
        dewarped = om.read_image(tmp_path / f"{i}.png").astype(float)
        fringes.append(float(np.sqrt(np.mean((dewarped[..., 0] - dewarped[..., 2]) ** 2))))
    assert fringes[1] < 0.4 * fringes[0]


def test_wavelengths_require_sensor(domed, tmp_path):
    view = om.views.panorama(domed, (64, None))
    with pytest.raises(InvalidParameter, match="must have 3 or 4 channels"):
        om.ColourDewarper((domed,) * 3, view)(np.zeros((256, 256), np.uint8))
    with pytest.raises(InvalidParameter, match="must be three cameras"):
        om.ColourDewarper((domed, domed), view)
    with pytest.raises(InvalidParameter, match="must have the same image size"):
        om.ColourDewarper((domed, domed, om.load_sensor("paper-spherical")), view)
    om.write_image(tmp_path / "a.png", np.zeros((128, 128, 3), np.uint8))
    arguments = ("--set", "image.wavelengths_nm=610,540,465", "-o", tmp_path / "b.png")
    assert "wavelengths_nm must be omitted unless the camera is a sensor" in fails(
        "dewarp", tmp_path / "a.png", "--ball", "63.5,63.5,50,250", *arguments
    )
    assert "--set image.wavelengths_nm requires images" in fails(
        "dewarp", "ride.mp4", "--sensor", "paper-spherical", *arguments
    )


def test_colour_dewarper_invalid_input_raises(domed, tmp_path):
    with pytest.raises(InvalidParameter, match="300 and 1100"):
        om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=(650.0, 550.0, 44.0))
    with pytest.raises(InvalidParameter, match="wavelengths_nm"):
        om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=(650.0, 550.0))
    ball = om.MirrorBall(
        centre_px=(63.5, 63.5), rim_radius_px=50.0, field_deg=250.0, image_size=(128, 128)
    )
    with pytest.raises(InvalidParameter, match="unless the camera is a sensor"):
        om.expose(ball, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=WAVES)
    stderr = fails(
        "simulate",
        "dataset",
        "paper-spherical",
        "--set",
        "rendering.wavelengths_nm=[610,540,465]",
        "-o",
        tmp_path / "set",
    )
    assert "rendering.wavelengths_nm requires a single image" in stderr
