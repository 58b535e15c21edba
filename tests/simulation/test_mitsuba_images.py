"""Complete images against Mitsuba 3: the same lens, aperture, mirror, environment and box filter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import binary_erosion

import omnimirror as om
from omnimirror.base.colour import srgb_from_linear
from omnimirror.cameras.camera import pan_tilt_direction
from omnimirror.optics.mirrors.mirror import MirrorPose
from omnimirror.simulation.rendering import expose
from omnimirror.simulation.scenes.environment import Environment
from tests.optics.tracing.test_mitsuba import meshed, mi  # noqa: F401 - a fixture

MISALIGNED = MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)
ROWS = 512


def small(name: str, pixels: int, pose: MirrorPose) -> om.Sensor:
    sensor = om.load_sensor(name)
    pitch = sensor.imager.pixel_pitch_um * sensor.imager.width_px / pixels
    imager = replace(sensor.imager, width_px=pixels, height_px=pixels, pixel_pitch_um=pitch)
    return replace(sensor, imager=imager, mirror_pose=pose)


def world(directions):
    """Return a world of soft stripes and spots, linear RGB of directions (..., 3)."""
    x, y, z = np.moveaxis(directions, -1, 0)
    stripes = 0.5 + 0.5 * np.tanh(4 * np.sin(9 * np.arctan2(y, x)) * np.sqrt(1 - z**2))
    bands = 0.5 + 0.5 * np.tanh(3 * np.sin(14 * z + 1))
    return np.stack(
        [0.1 + 0.7 * stripes, 0.1 + 0.7 * bands, 0.1 + 0.7 * (0.5 + 0.5 * np.sin(7 * x + 5 * y))],
        axis=-1,
    )


def maps():
    """Return the world as texels of omnimirror, with the first row half a texel off the pole, and
    of Mitsuba."""
    pan = np.radians((np.arange(2 * ROWS) + 0.5) / (2 * ROWS) * 360 - 180)
    texels = np.pi / 2 - (np.arange(ROWS) + 0.5) / ROWS * np.pi
    mitsuba_texels = np.pi / 2 - np.arange(ROWS) / (ROWS - 1) * np.pi
    return [
        world(pan_tilt_direction(*np.meshgrid(pan, tilt))).astype(np.float32)
        for tilt in (texels, mitsuba_texels)
    ]


def render_mitsuba(mi, sensor, mirror, light, rays, shapes=None):  # noqa: F811
    """Render a scene by Mitsuba."""
    return np.array(mi.render(scene_of(mi, sensor, mirror, light, rays, shapes), spp=rays))


def scene_of(mi, sensor, mirror, light, rays, shapes=None):  # noqa: F811
    """Return Mitsuba's scene in the camera frame, with the origin at the mirror vertex and optional
    other shapes."""
    lens, (width, height), m = sensor.lens, sensor.image_size, sensor.mirror_distance_mm
    half = np.degrees(np.arctan(width / 2 * sensor.imager.pitch_mm / lens.image_distance))
    rotation = np.eye(
        4
    )  # Mitsuba: columns from -z via x, rows from y; omnimirror: columns from -x via y, rows from z
    rotation[:3, :3] = sensor.mount.rotation().T @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    frame = mi.ScalarTransform4f
    return mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "path", "max_depth": 12 if shapes else 3, "rr_depth": 20},
            **(shapes or {}),
            "mirror": {**mirror, "bsdf": {"type": "conductor", "material": "none"}},
            "world": {
                "type": "envmap",
                "bitmap": mi.Bitmap(light),
                "to_world": frame(rotation.tolist()),
            },
            "camera": {
                "type": "thinlens",
                "fov": 2 * float(half),
                "fov_axis": "x",
                "aperture_radius": float(lens.aperture_radius),
                "focus_distance": float(lens.focus_distance_mm),
                "near_clip": 1.0,
                "far_clip": 1e5,
                "to_world": frame().look_at(origin=[0, 0, -m], target=[0, 0, 0], up=[0, -1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": width,
                    "height": height,
                    "rfilter": {"type": "box"},
                    "pixel_format": "rgb",
                    "component_format": "float32",
                },
                "sampler": {"type": "multijitter", "sample_count": rays},
            },
        }
    )


def ball(sensor):
    radius = sensor.mirror.radius_mm
    centre = sensor.mirror_pose.to_camera([[0.0, 0.0, radius]])[0]
    return {"type": "sphere", "radius": float(radius), "center": centre.tolist()}


def compare_images(sensor, image, reference):
    """Return PSNR in sRGB within the rim, and the largest shift (px) between corresponding blocks
    of 1/8 of the image."""
    rows, columns = np.mgrid[: len(image), : len(image)]
    rays = sensor.backproject(np.stack([columns, rows], axis=-1).reshape(-1, 2).astype(float))
    inside = rays.valid.reshape(image.shape[:2])
    inside = binary_erosion(inside, iterations=3)  # excludes the rim
    a, b = srgb_from_linear(image), srgb_from_linear(reference)
    decibels = -10 * np.log10(np.mean((a - b)[inside] ** 2))
    slopes = np.stack([np.gradient((a + b) / 2, axis=1), np.gradient((a + b) / 2, axis=0)], axis=-1)
    middle = (len(image) - 1) / 2
    sector = (np.arctan2(rows - middle, columns - middle) // (np.pi / 4)).astype(int)
    shifts = []
    for number in np.unique(sector):
        part = inside & (sector == number)
        shift, *_ = np.linalg.lstsq(slopes[part].reshape(-1, 2), (b - a)[part].ravel(), rcond=None)
        shifts.append(float(np.hypot(*shift)))
    return decibels, max(shifts)


def on_a_mesh(mi, sensor, path, rings, rays):  # noqa: F811
    """Compare a blurred image with Mitsuba's image of the mirror mesh."""
    meshed(mi, sensor, rings, 2 * rings).shapes()[0].write_ply(str(path))
    texels, mitsuba_texels = maps()
    image = expose(sensor, Environment(texels), samples=rays, blur=True)
    return compare_images(
        sensor,
        image,
        render_mitsuba(mi, sensor, {"type": "ply", "filename": str(path)}, mitsuba_texels, rays),
    )


def assert_agreement(beside, decibels, shift):
    """Check that the PSNR is at least 45 dB, which includes single precision and the noise of both images."""
    beside(
        "Mitsuba 3",
        "images with blur, RMS difference in grey levels",
        grey_levels(decibels),
        grey_levels(45),
        "",
    )
    beside("Mitsuba 3", "maximum image shift in any of eight sectors", shift, 0.02, "px")


def grey_levels(decibels):
    """Convert a PSNR of images from 0 to 1 to levels of 255."""
    return 255 * 10 ** (-decibels / 20)


@pytest.mark.full
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
def test_blurred_image_matches_mitsuba(mi, pose, beside):  # noqa: F811
    sensor = small("paper-spherical", 128, pose)
    sensor = replace(sensor, lens=replace(sensor.lens, f_number=2.0))
    texels, mitsuba_texels = maps()
    image = expose(sensor, Environment(texels), samples=256, blur=True)
    decibels, shift = compare_images(
        sensor, image, render_mitsuba(mi, sensor, ball(sensor), mitsuba_texels, 144)
    )
    assert_agreement(beside, decibels, shift)


@pytest.mark.full
@pytest.mark.parametrize(
    ("name", "pose"),
    [("paper-equidistant", MISALIGNED), ("paper-hyperboloidal", MirrorPose())],
    ids=["E-DI", "SVP"],
)
def test_blurred_mesh_image_matches_mitsuba(mi, name, pose, tmp_path, beside):  # noqa: F811
    decibels, shift = on_a_mesh(
        mi, small(name, 128, pose), tmp_path / "mirror.ply", rings=150, rays=100
    )
    assert_agreement(beside, decibels, shift)


@pytest.mark.full
@pytest.mark.parametrize("pose", [MirrorPose(), MISALIGNED], ids=["aligned", "misaligned"])
@pytest.mark.parametrize("name", ["paper-spherical", "paper-equidistant", "paper-hyperboloidal"])
def test_paper_sensors_match_fine_mesh(mi, name, pose, tmp_path, beside):  # noqa: F811
    decibels, shift = on_a_mesh(
        mi, small(name, 384, pose), tmp_path / "mirror.ply", rings=500, rays=1024
    )
    print(f"{name}: {decibels:.1f} dB, no sector shifted by more than {shift:.4f} px")
    assert_agreement(beside, decibels, shift)
