"""Dewarping of frames in the memory of GStreamer buffers, without the bindings of GStreamer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ...base.errors import InvalidParameter, OutsideField
from ...base.files import parse_toml
from ...dewarp import Dewarper
from ...dewarp.interfaces import Image, Interpolation
from ...dewarp.maps import half
from ...dewarp.views import resolution
from ...dewarp.yuv import Siting
from ...optics.camera_files import load_camera
from ..named_views import parse_view

PLUGIN_PATH = Path(__file__).parent
"""Folder for GST_PLUGIN_PATH; GStreamer loads the files of its folder ``python``."""
PLANE_CHANNELS = {"RGB": (3,), "BGR": (3,), "GRAY8": (1,), "NV12": (1, 2), "I420": (1, 1, 1)}
"""Supported formats with the channels of their planes; chroma planes are halved."""


@dataclass
class ViewSettings:
    """Properties of the element; zero and empty values select the default of the view.

    Parameters
    ----------
    sensor
        Name of a bundled sensor, or a sensor or camera file.
    view
        Type of the view: any key of :data:`omnimirror.views.VIEWS`.
    pan_deg, tilt_deg, roll_deg, hfov_deg
        Direction and horizontal field of view (deg).
    width, height
        Size of the view (px).
    options
        Further options of the view as entries of TOML, separated by commas:
        ``"span_deg = 180, elevation_deg = [-60, 20]"``.
    interpolation, keep_map
        As for :class:`omnimirror.Dewarper`.

    Examples
    --------
    >>> settings = ViewSettings("paper-spherical", pan_deg=40.0, hfov_deg=70.0, width=640, height=480)
    >>> dewarper = settings.dewarper()
    >>> print(dewarper.view, dewarper.view.size)
    perspective view (pan 40, tilt 0, hfov 70 deg) (640, 480)
    """

    sensor: str = ""
    view: str = "perspective"
    pan_deg: float = 0.0
    tilt_deg: float = 0.0
    roll_deg: float = 0.0
    hfov_deg: float = 0.0
    width: int = 0
    height: int = 0
    options: str = ""
    interpolation: Interpolation = "auto"
    keep_map: bool = False

    def dewarper(self) -> Dewarper:
        """Create the dewarper of these settings.

        Raises
        ------
        OmnimirrorError
            If the sensor, the view or an option is invalid.
        OutsideField
            If the view does not intersect the field of the camera.
        """
        if not self.sensor:
            raise InvalidParameter(
                "sensor must be the name of a sensor or the path of a camera file; got an empty text"
            )
        camera = load_camera(self.sensor)
        view = parse_view("view", self._view_table())(camera)
        if np.isnan(resolution(camera, view)):
            raise OutsideField(f"the {view} is outside the field of the camera")
        return Dewarper(camera, view, self.interpolation, keep_map=self.keep_map)

    def _view_table(self) -> dict[str, Any]:
        table = parse_toml(f"options = {{ {self.options} }}", "options")["options"]
        for name in ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg"):
            if value := getattr(self, name):
                table[name] = value
        if self.width or self.height:
            table["size"] = (self.width or None, self.height or None)
        return {"view": self.view, **table}


class FrameLayout(NamedTuple):
    """Arrangement of a frame in a buffer.

    Parameters
    ----------
    format
        Name of the format, a key of :data:`PLANE_CHANNELS`.
    size
        (width, height) px.
    offsets, strides
        Position of each plane and length of its rows (bytes).
    """

    format: str
    size: tuple[int, int]
    offsets: Sequence[int]
    strides: Sequence[int]

    def planes(self, buffer: Any) -> tuple[Image, ...]:
        """Return the planes of a buffer as arrays that share its memory.

        >>> layout = FrameLayout("NV12", (4, 2), [0, 8], [4, 4])
        >>> [plane.shape for plane in layout.planes(bytes(12))]
        [(2, 4), (1, 2, 2)]
        """
        arrays: list[Image] = []
        values = np.frombuffer(buffer, np.uint8)
        for i, channels in enumerate(PLANE_CHANNELS[self.format]):
            width, height = half(self.size) if i else self.size
            shape = (height, width) if channels == 1 else (height, width, channels)
            strides = (self.strides[i], channels, 1)[: len(shape)]
            arrays.append(np.ndarray(shape, np.uint8, values, self.offsets[i], strides))
        return tuple(arrays)


def dewarp_buffer(
    dewarper: Dewarper,
    source: Any,
    source_layout: FrameLayout,
    target: Any,
    target_layout: FrameLayout,
    siting: Siting = "left",
    full_range: bool = False,
) -> None:
    """Dewarp a frame from one buffer into another of the same format.

    Parameters
    ----------
    dewarper
        Dewarper whose camera and view have the sizes of the layouts.
    source, target
        Buffers of bytes; the target is writable.
    source_layout, target_layout
        Arrangement of the frames.
    siting, full_range
        Position of chroma samples and range of luma, as for :meth:`omnimirror.Dewarper.planes`.

    Raises
    ------
    InvalidParameter
        If a size differs from that of the camera or the view.
    """
    parts, out = source_layout.planes(source), target_layout.planes(target)
    if len(parts) == 1:
        dewarper(parts[0], out=out[0])
    else:
        dewarper.planes(parts, out=out, siting=siting, full_range=full_range)
