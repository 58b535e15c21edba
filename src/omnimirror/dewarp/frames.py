"""Dewarping of video frames in their coded format."""

from __future__ import annotations

import av

from ..io.video.formats import Kind
from ..io.video.frames import FULL_RANGE, empty_frame, is_full_range, planes, workable
from .dewarper import Dewarper
from .yuv.planes import Siting


def dewarp_frame(
    dewarp: Dewarper, frame: av.VideoFrame, siting: Siting = "left", to_siting: Siting | None = None
) -> av.VideoFrame:
    """Dewarp a video frame to a new frame with the same timestamp and colour coding.

    Parameters
    ----------
    dewarp
        Dewarper for the camera and the view.
    frame
        Frame of any pixel format; formats other than planar YUV and NV12 are first converted to
        planes without loss of depth.
    siting, to_siting
        Position of chroma samples in the frame and in the result; see :meth:`Dewarper.planes`.
        Readers and sinks of :mod:`omnimirror.io` report theirs.

    Returns
    -------
    Frame of pixel format nv12 for nv12 input, otherwise planar YUV of the same depth and chroma
    resolution, with transparency if present: transparent outside the field unless the border is a
    colour.

    Raises
    ------
    InvalidParameter
        If the frame does not have the size of the camera.

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
