"""Orientation of a video: the display matrix that files carry for frames taken with a turned
camera.
"""

from __future__ import annotations

import struct
from dataclasses import replace
from typing import Any

import av
import numpy as np
from av.sidedata.sidedata import Type as SideData

from ..pictures.orientation import UPRIGHT, oriented
from .formats import Kind
from .frames import FULL_RANGE, Siting, converted, empty_frame, is_full_range, planes, workable

OF_AXES = {
    ((1, 0), (0, 1)): 1,
    ((-1, 0), (0, 1)): 2,
    ((-1, 0), (0, -1)): 3,
    ((1, 0), (0, -1)): 4,
    ((0, 1), (1, 0)): 5,
    ((0, 1), (-1, 0)): 6,
    ((0, -1), (-1, 0)): 7,
    ((0, -1), (1, 0)): 8,
}
"""Orientation as in EXIF, by the directions (right, down) on the display of the stored rows and
columns.
"""
SITED_LEFT: dict[int, Siting] = {2: "right", 3: "right", 5: "top", 6: "top", 7: "bottom", 8: "bottom"}
"""Position of chroma samples after an orientation of left-sited frames, by orientation."""


def orientation_of(frame: av.VideoFrame) -> int | None:
    """Return the orientation of a frame as in EXIF, 1 to 8; None for a rotation by no multiple of
    90 deg.
    """
    beside: Any = frame.side_data
    matrix = beside.get(SideData.DISPLAYMATRIX)
    if matrix is None:
        return UPRIGHT
    values = np.array(struct.unpack("=9i", bytes(matrix)[:36])).reshape(3, 3)[:2, :2] / 65536.0
    signs = np.where(np.abs(values) > 0.02 * np.abs(values).max(), np.sign(values), 0).astype(int)
    (a, b), (c, d) = signs.tolist()
    return OF_AXES.get(((a, b), (c, d)))


def upright(frame: av.VideoFrame, orientation: int) -> av.VideoFrame:
    """Return a frame with an orientation applied; time and colour coding are kept.

    Chroma that is subsampled in one direction only, or of frames with an odd number of rows or
    columns, is interpolated to full resolution first.
    """
    if orientation == UPRIGHT:
        return frame
    frame = workable(frame)
    kind = Kind.of(frame.format.name)
    if kind.colours == "422" or (kind.colours == "420" and (frame.width % 2 or frame.height % 2)):
        frame = converted(frame, replace(kind, colours="444").name)
    turned = [oriented(part, orientation) for part in planes(frame)]
    height, width = turned[0].shape[:2]
    made, into = empty_frame((width, height), frame.format.name, like=frame)
    if is_full_range(frame):
        made.color_range = FULL_RANGE
    for part, target in zip(turned, into, strict=True):
        target[:] = part
    return made
