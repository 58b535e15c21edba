"""Programs that know panoramas alone: what they render from one place, bent by our map, is the sensor's picture."""

from __future__ import annotations

import numpy as np
import pytest

import omnimirror as om
from omnimirror.interop.colmap import rig_of
from omnimirror.simulate.rendering.exposure import expose
from tests.interop.maps.consumers import warped
from tests.interop.rays.box import Box, colours, first_hits
from tests.simulate.rendering.test_mitsuba_pictures import MISALIGNED, compared, small

WIDTH = 1024


def test_a_panorama_from_the_told_place_bends_into_the_sensors_picture(tmp_path):
    oiio = pytest.importorskip("OpenImageIO", reason="OpenImageIO is installed by `make test-full` only")
    sensor = small("paper-spherical", 192, MISALIGNED)
    view = om.views.sphere(sensor, (WIDTH, None))
    (told,) = rig_of(sensor, size=WIDTH, is_panorama=True)
    columns, rows = np.meshgrid(*(np.arange(side, dtype=float) for side in view.size))
    rendered = colours(first_hits(told.position_mm, view.targets_at(columns, rows)))
    (done,) = om.write_maps(sensor, view, tmp_path / "room.exr", formats="stmap")
    bent = warped(oiio, rendered, done.paths[1])
    decibels, shift = compared(sensor, expose(sensor, Box(), samples=4), bent.astype(np.float32))
    assert decibels > 38
    assert shift < 0.2  # of 192 px, in a room of 3 m by 2 m, where a panorama of 1024 px is told to be up to 3 px off
    assert 2.5 < told.errors_px[1000.0] < 4
