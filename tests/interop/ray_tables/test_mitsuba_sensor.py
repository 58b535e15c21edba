"""Images by Mitsuba 3 with the sensor plug-in against those of omnimirror, of the same room."""

from __future__ import annotations

import runpy

import numpy as np
import pytest

import omnimirror as om
from omnimirror.simulation.rendering import expose
from tests.interop.ray_tables.box import CENTRE_MM, Box, texture, walls
from tests.optics.tracing.test_mitsuba import mi  # noqa: F401 - a fixture
from tests.simulation.test_mitsuba_images import MISALIGNED, compare_images, small

PIXELS, RAYS = 80, 9


def wall(mi, corners):  # noqa: F811
    """Return a textured rectangle that emits inwards."""
    across, up = (corners[1] - corners[0]) / 2, (corners[3] - corners[0]) / 2
    normal = np.cross(across, up)
    middle = corners.mean(axis=0)
    matrix = np.eye(4)
    matrix[:3] = np.stack([across, up, normal / np.linalg.norm(normal), middle], axis=-1)
    paint = mi.Bitmap(np.ascontiguousarray(texture(corners)))
    light = {"type": "bitmap", "bitmap": paint, "raw": True, "wrap_mode": "clamp"}
    return {
        "type": "rectangle",
        "to_world": mi.ScalarTransform4f(matrix.tolist()),
        "flip_normals": bool(normal @ (CENTRE_MM - middle) < 0),
        "emitter": {"type": "area", "radiance": light},
    }


def mitsuba_image(mi, script, size):  # noqa: F811
    runpy.run_path(str(script))
    film = {
        "type": "hdrfilm",
        "width": size,
        "height": size,
        "rfilter": {"type": "box"},
        "pixel_format": "rgb",
    }
    camera = {
        "type": "omnimirror",
        "film": {**film, "component_format": "float32"},
        "sampler": {"type": "stratified", "sample_count": RAYS},
    }
    scene = {f"wall{i}": wall(mi, corners) for i, corners in enumerate(walls())}
    scene |= {"type": "scene", "integrator": {"type": "path", "max_depth": 2}, "camera": camera}
    return np.array(mi.render(mi.load_dict(scene), spp=RAYS))


@pytest.mark.full
def test_mitsuba_image(mi, tmp_path):  # noqa: F811
    """Misaligned sensor and nearby walls, for which ray origins matter."""
    sensor = small("paper-spherical", PIXELS, MISALIGNED)
    om.write_rays(sensor, tmp_path / "camera.py", formats="mitsuba")
    reference = mitsuba_image(mi, tmp_path / "camera.py", PIXELS)
    decibels, shift = compare_images(sensor, expose(sensor, Box(), samples=16), reference)
    assert decibels > 50  # 0.8 grey levels
    assert shift < 0.02


def test_film_of_another_size_raises(mi, tmp_path):  # noqa: F811
    om.write_rays(
        small("paper-spherical", 32, MISALIGNED), tmp_path / "camera.py", formats="mitsuba"
    )
    with pytest.raises(Exception, match="the film must have 32 x 32 px; got 16 x 16 px"):
        mitsuba_image(mi, tmp_path / "camera.py", 16)
