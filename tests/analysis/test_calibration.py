"""The table of a calibrated camera, against differences of its own projection."""

import numpy as np
import pytest

import omnimirror as om
from omnimirror.errors import InvalidParameter, OutsideField
from tests.contracts.test_camera_models import MODELS

STEP = 1e-5


@pytest.mark.parametrize("camera", MODELS.values(), ids=MODELS)
def test_resolution_is_that_of_the_projection(camera):
    """Of a degree along and around, as pixels of directions have it, undistorted to one side."""
    table = om.evaluate_camera(camera)
    assert table.omega_deg[0] == 0.0
    assert np.radians(table.omega_deg[-1]) == pytest.approx(camera.omega_max)
    ahead = -1.0 if camera.optics == "mirror" else 1.0
    inside = slice(1, -1)
    omega = np.radians(table.omega_deg[inside])

    def pixels(omega, phi):
        directions = [np.sin(omega) * np.cos(phi), np.sin(omega) * np.sin(phi), ahead * np.cos(omega)]
        return camera.image(np.stack(directions, axis=-1), distant=True).pixels

    areas = []
    for phi in np.arange(8) * np.pi / 4:
        along = (pixels(omega + STEP, phi) - pixels(omega - STEP, phi)) / (2 * np.degrees(STEP))
        around = (pixels(omega, phi + STEP) - pixels(omega, phi - STEP)) / (2 * np.degrees(STEP) * np.sin(omega))[
            :, None
        ]
        areas.append(np.abs(along[:, 0] * around[:, 1] - along[:, 1] * around[:, 0]))
        if camera.symmetry is not None:
            np.testing.assert_allclose(np.linalg.norm(along, axis=1), table.dh_domega_px_per_deg[inside], rtol=1e-6)
            np.testing.assert_allclose(np.linalg.norm(around, axis=1), table.width_px_per_deg[inside], rtol=1e-6)
    np.testing.assert_allclose(np.mean(areas, axis=0), table.area_px2[inside], rtol=0.03)


def test_viewpoints_are_where_rays_meet_the_axis():
    camera = MODELS["viewpoint-spline"]
    table = om.evaluate_camera(camera, [30.0, 60.0, 90.0])
    directions = np.radians(table.omega_deg)
    d = np.stack([0 * directions, np.sin(directions), -np.cos(directions)], axis=-1)
    rays = camera.backproject(camera.image(d, distant=True).pixels)
    across, up = np.hypot(*rays.directions[:, :2].T), rays.directions[:, 2]  # it looks up: Z is the world's
    heights = rays.origins[:, 2] - np.hypot(*rays.origins[:, :2].T) / across * up
    np.testing.assert_allclose(table.viewpoint_z_mm, heights, atol=1e-9)


def test_what_is_not_seen_is_refused():
    camera = MODELS["ball"]
    with pytest.raises(OutsideField, match="omega_deg = 160 is not seen; the camera sees 0 to 150 deg"):
        om.evaluate_camera(camera, [10.0, 160.0])
    with pytest.raises(InvalidParameter, match="is not a calibrated camera"):
        om.evaluate_camera(om.load_sensor("paper-spherical"))
