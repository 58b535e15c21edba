"""Frames of videos straightened as they are coded."""

from __future__ import annotations

import av

from ..io.video.formats import Kind
from ..io.video.frames import FULL_RANGE, empty_frame, is_full_range, planes, workable
from .dewarper import Dewarper
from .yuv.planes import Siting


def dewarp_frame(
    dewarp: Dewarper, frame: av.VideoFrame, siting: Siting = "left", to_siting: Siting | None = None
) -> av.VideoFrame:
    """A frame's view: its planes straightened into those of a new frame, with its time and colour coding.

    Parameters
    ----------
    dewarp
        The camera and the view.
    frame
        Of any pixel format; one that is not planar YUV or NV12 is converted first, to planes that hold as much.
    siting, to_siting
        Where colours lie in it, and in the result; see :meth:`Dewarper.planes`. Readers and sinks of
        :mod:`omnimirror.io` tell theirs.

    Returns
    -------
    A frame of pixel format nv12 where the given one is, and otherwise planar YUV of the same depth, with colours of the
    same resolution, and with transparency if there was any: outside the field all of it, unless the border is a colour.

    Raises
    ------
    InvalidParameter
        The frame is not of the camera's size.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.io.video.frames import empty_frame, planes
    >>> frame, parts = empty_frame((1024, 1024))
    >>> for part in parts:
    ...     part[:] = 100
    >>> dewarp = om.Dewarper(om.load_sensor("paper-spherical"), om.screens.Plane((640, 480)))
    >>> planes(dewarp_frame(dewarp, frame))[0][240, 320]
    np.uint8(100)
    """
    frame = workable(frame)
    kind = Kind.of(frame.format.name)
    made, target = empty_frame(dewarp.view.size, "nv12" if frame.format.name == "nv12" else kind.name, like=frame)
    is_full = is_full_range(frame)
    if is_full:
        made.color_range = FULL_RANGE
    dewarp.planes(planes(frame), target, siting, to_siting, is_full, kind.bits)
    return made
