"""Warping of a rendered panorama into the image of the sensor."""

from __future__ import annotations

import contextlib

import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.pinholes import camera_rig
from omnimirror.simulation.rendering import expose
from tests.interop.documentation import unmarked_code
from tests.interop.ray_tables.box import Box, colours, first_hits
from tests.simulation.test_mitsuba_images import MISALIGNED, compare_images, small

WIDTH = 1024


def test_warped_panorama_equals_the_image_of_the_sensor(tmp_path):
    oiio = pytest.importorskip(
        "OpenImageIO", reason="OpenImageIO is installed by `make test-full` only"
    )
    sensor = small("paper-spherical", 192, MISALIGNED)
    view = om.views.sphere(sensor, (WIDTH, None))
    (virtual_camera,) = camera_rig(sensor, size=WIDTH, panorama=True)
    columns, rows = np.meshgrid(*(np.arange(side, dtype=float) for side in view.size))
    panorama = colours(first_hits(virtual_camera.position_mm, view.targets_at(columns, rows)))
    (exported,) = om.write_maps(sensor, view, tmp_path / "room.exr", formats="stmap")
    oiio.ImageBuf(panorama.astype(np.float32)).write(str(tmp_path / "panorama.exr"))
    assert exported.paths[1].name == "room-warp.exr"
    names = {"oiio": oiio}
    with contextlib.chdir(tmp_path):
        exec(unmarked_code("Panoramas", "##"), names)
    warped_image = names["image"].get_pixels("float")
    decibels, shift = compare_images(
        sensor, expose(sensor, Box(), samples=4), warped_image.astype(np.float32)
    )
    assert decibels > 38
    assert (
        shift < 0.2
    )  # 192 px image of a room of 3 m by 2 m; the reported error of the panorama is 3 of 1024 px
    assert 2.5 < virtual_camera.errors_px[1000.0] < 4
