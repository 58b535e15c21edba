"""Pictures in three colours, each refracted by lens and cover in its own way."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter
from omnimirror.housing import Dome, Housing
from tests.commands import fails

WAVES = (650.0, 550.0, 440.0)


@pytest.fixture(scope="module")
def domed():
    """A dome of strong glass far off its middle parts colours by pixels."""
    sensor = om.load_sensor("paper-spherical")
    imager = replace(sensor.imager, width_px=256, height_px=256, pixel_pitch_um=20.8)
    return replace(sensor, imager=imager, housing=Housing(shell=Dome(material="polycarbonate", wall_mm=20.0)))


@pytest.fixture(scope="module")
def light(domed):
    return om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=WAVES)


def test_each_colour_is_the_picture_in_its_light(domed, light):
    for i, nm in enumerate(WAVES):
        alone = om.expose(om.at_wavelength(domed, nm), om.Room(texel_mm=40.0), samples=1)
        np.testing.assert_array_equal(light[..., i], alone[..., i])
    plain = om.expose(domed, om.Room(texel_mm=40.0), samples=1)
    assert np.abs(light - plain)[..., 0].max() > 0.1


class Stripes:
    """Grey rings about the axis, of some pixels each."""

    def radiance(self, origins_mm, directions):
        tilt = np.arcsin(directions[:, 2] / np.linalg.norm(directions, axis=1))
        return np.repeat((0.5 + 0.4 * np.cos(60 * tilt))[:, None], 3, axis=1).astype(np.float32)


def test_straightened_by_their_own_colours_they_lie_on_each_other(domed):
    view = om.views.panorama(domed, (256, None), elevation_deg=(-30.0, 30.0))
    taken = om.expose(domed, Stripes(), samples=4, wavelengths_nm=WAVES)
    alike, own = [domed] * 3, [om.at_wavelength(domed, nm) for nm in WAVES]
    fringes = []
    for cameras in (alike, own):
        red, _, blue = (om.Dewarper(c, view)(np.stack([taken[..., i]] * 3, -1)) for i, c in enumerate(cameras))
        fringes.append(float(np.sqrt(np.mean((red - blue) ** 2))))
    assert fringes[0] > 0.02
    assert fringes[1] < 0.3 * fringes[0]


def test_what_has_no_colours_is_refused(domed, tmp_path):
    with pytest.raises(InvalidParameter, match="300 to 1100"):
        om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=(650.0, 550.0, 44.0))
    with pytest.raises(InvalidParameter, match="wavelengths_nm"):
        om.expose(domed, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=(650.0, 550.0))
    ball = om.MirrorBall((63.5, 63.5), 50.0, 250.0, (128, 128))
    with pytest.raises(InvalidParameter, match="only a sensor has colours"):
        om.expose(ball, om.Room(texel_mm=40.0), samples=1, wavelengths_nm=WAVES)
    said = fails("simulate", "dataset", "paper-spherical", "--wavelengths-nm", "610,540,465", "-o", tmp_path / "set")
    assert "--wavelengths-nm belongs to pictures" in said
