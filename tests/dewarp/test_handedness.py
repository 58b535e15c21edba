"""Handedness of dewarped images against rays reflected in 3-D by brute force.

The brute-force side is independent of the optics of the package: world points are imaged by the
shortest path over a sphere (Fermat), with manually written camera axes for each mount.
"""

import numpy as np
import pytest
from scipy.optimize import minimize

import omnimirror as om
from omnimirror.cameras.camera import Mount
from tests.everyday import few

SIZE, CENTRE, PITCH_MM, IMAGE_DISTANCE_MM = 1024, 511.5, 0.0052, 1 / (1 / 11.6 - 1 / 212.0)
SPHERE_MM, LENS_MM = 49.9582, 180.429

# camera axes in the world (image right, image down, optical axis), by hand
IMAGE_RIGHT_IS_FORWARD = {
    "up": [(1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "down": [(1, 0, 0), (0, -1, 0), (0, 0, -1)],
}
IMAGE_TOP_IS_FORWARD = {
    "up": [(0, 1, 0), (-1, 0, 0), (0, 0, 1)],
    "down": [(0, -1, 0), (-1, 0, 0), (0, 0, -1)],
}


def shortest_path_pixel(point_mm, axes):
    """Return the pixel of a world point: the path point - sphere - lens is shortest over the front
    of the sphere."""
    right, down, forward = np.array(axes, dtype=float)
    centre, lens = SPHERE_MM * forward, -LENS_MM * forward

    def on_sphere(angles):
        a, b = angles
        normal = a * right + b * down - forward
        return centre + SPHERE_MM * normal / np.linalg.norm(normal)

    def length(angles):
        s = on_sphere(angles)
        return np.linalg.norm(point_mm - s) + np.linalg.norm(s - lens)

    towards = point_mm / np.linalg.norm(point_mm)
    best = minimize(
        length,
        [towards @ right, towards @ down],
        method="Nelder-Mead",
        options={"xatol": 1e-9, "fatol": 0},
    )
    ray = on_sphere(best.x) - lens
    scale = IMAGE_DISTANCE_MM / PITCH_MM / (ray @ forward)
    return np.array([CENTRE + scale * (ray @ right), CENTRE + scale * (ray @ down)])


def sensor_with(looks, forward_azimuth_deg, flipped=False):
    from dataclasses import replace

    return replace(
        om.load_sensor("paper-spherical"), mount=Mount(looks, forward_azimuth_deg, flipped)
    )


def azimuth_deg(pixel):
    return np.degrees(np.arctan2(pixel[1] - CENTRE, pixel[0] - CENTRE))


@pytest.mark.parametrize(("looks", "sign"), [("up", 1), ("down", -1)])
def test_numeric_example_of_conventions(looks, sign):
    """A wall at x = 3 m, point A at y = +400 mm and B at y = -400: columns 1723.55 and 1875.45."""
    sensor = sensor_with(looks, 0.0)
    coordinates = om.Dewarper(sensor, om.screens.Cylinder((3600, 9), -9.0, 9.0)).coordinates()[4]
    for y, column in ((400.0, 1723.55), (-400.0, 1875.45)):
        pixel = shortest_path_pixel(np.array([3000.0, y, 0.0]), IMAGE_RIGHT_IS_FORWARD[looks])
        assert azimuth_deg(pixel) == pytest.approx(sign * np.sign(y) * 7.595, abs=1e-3)
        columns = np.arange(3600)
        near = slice(int(column) - 5, int(column) + 6)
        azimuths = [azimuth_deg(c) for c in coordinates[near]]
        order = np.argsort(azimuths)
        interpolated = np.interp(
            azimuth_deg(pixel), np.array(azimuths)[order], columns[near][order]
        )
        assert interpolated == pytest.approx(column, abs=0.01)


@pytest.mark.parametrize("looks", ["up", "down"])
def test_projection_matches_shortest_path(looks):
    for axes, azimuth in ((IMAGE_RIGHT_IS_FORWARD, 0.0), (IMAGE_TOP_IS_FORWARD, -90.0)):
        sensor = sensor_with(looks, azimuth)
        for point in ([3000.0, 400.0, 0.0], [700.0, -900.0, 300.0], [-200.0, 300.0, -100.0]):
            expected = shortest_path_pixel(np.array(point), axes[looks])
            np.testing.assert_allclose(sensor.project([point]).pixels[0], expected, atol=2e-3)


# -- a readable sign: an L of three lamps on a wall, forward and right of the centre
# ----------------

LAMPS = {
    "corner": (3000.0, -400.0, -300.0),
    "top": (3000.0, -400.0, 500.0),
    "right": (3000.0, -900.0, -300.0),
}
VALUES = {"corner": 250, "top": 180, "right": 110}


def image_of_sign(axes, flipped):
    image = np.zeros((SIZE, SIZE), np.uint8)
    for name, point in LAMPS.items():
        u, v = np.round(shortest_path_pixel(np.array(point), axes)).astype(int)
        image[v - 1 : v + 2, u - 1 : u + 2] = VALUES[name]
    return np.ascontiguousarray(image[:, ::-1]) if flipped else image


def find(image, name):
    """Return the centre (column, row) of a lamp by its brightness."""
    rows, columns = np.nonzero(np.abs(image.astype(int) - VALUES[name]) < 3)
    assert len(rows) > 0, f"the lamp {name!r} is not in the image"
    return columns.mean(), rows.mean()


@pytest.mark.parametrize("flipped", [False, True])
@pytest.mark.parametrize("azimuth", few([0.0, -90.0], -90.0))
@pytest.mark.parametrize("looks", ["up", "down"])
@pytest.mark.parametrize("view", ["panorama", "perspective", "dome"])
def test_view_is_not_mirrored(looks, azimuth, flipped, view):
    axes = (IMAGE_RIGHT_IS_FORWARD if azimuth == 0.0 else IMAGE_TOP_IS_FORWARD)[looks]
    raw = image_of_sign(axes, flipped)
    sensor = sensor_with(looks, azimuth, flipped)
    screen = {
        "panorama": om.screens.Cylinder((1800, 500), -50.0, 50.0),
        "perspective": om.screens.Plane((1200, 900), hfov_deg=80.0),
        "dome": om.views.dome(sensor, (1000, 1000)),
    }[view]
    dewarped = om.Dewarper(sensor, screen, "nearest")(raw)
    (cu, cv), (tu, tv), (ru, rv) = (find(dewarped, name) for name in ("corner", "top", "right"))
    if view == "dome":
        up = looks == "down"  # then the dome is centred at the zenith, and right is left
        assert cv < 500
        assert (ru < cu < 500) if up else (ru > cu > 500)
        farther = np.hypot(tu - 499.5, tv - 499.5) > np.hypot(cu - 499.5, cv - 499.5)
        assert farther != up  # higher points are farther from the nadir
    else:
        width, height = screen.size
        assert cu > width / 2  # right of forward
        assert tv < height / 2 < cv  # the top is above the horizon
        assert abs(tu - cu) < 6
        assert ru > cu + 20
        assert abs(rv - cv) < 0.2 * abs(tv - cv)
