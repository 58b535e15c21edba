"""Export of the Look tab: views and light probes from original images, at their full resolution and
bit depth.
"""

from __future__ import annotations

from dataclasses import dataclass
from inspect import Parameter, signature
from pathlib import Path

import numpy as np

from ...base.errors import InvalidParameter
from ...cameras.camera import Camera, Mount
from ...dewarp import views
from ...dewarp.image_files import DewarpRequest, ImageDewarper, SourceImage
from ...dewarp.screens import View
from ...io.image_metadata import UPRIGHT, applied
from ...io.images import encode_image
from ...optics.camera_files import AnyCamera
from ._look_cameras import Cameras
from ._uploads import safe_name, uploaded
from .look_messages import FittedCameraRequest, ImageExportRequest, ViewRequest

MAX_EXPORTED_PIXELS = 1 << 25
"""Maximum size of an exported view; linear light takes 16 bytes per pixel."""


@dataclass(frozen=True)
class ExportedImage:
    """Image file, and a description of it and of conversions."""

    data: bytes
    note: str


def camera_of(cameras: Cameras, message: FittedCameraRequest) -> AnyCamera:
    """Return the camera of a request, with its fitted image circle if there is one."""
    if message.is_fitted:
        return cameras.with_circle(message)
    return cameras.find(message.id).standing(Mount(**message.mount.model_dump()))


def export_image(
    camera: Camera, message: ImageExportRequest, data: bytes, *, stored_orientation: bool = False
) -> ExportedImage:
    """Return the requested view of an uploaded original image, or its light probe, as a file.

    Raises
    ------
    OmnimirrorError
        If the image is unreadable or belongs to another camera, or the view is invalid or outside
        the field.
    """
    from ...dewarp.radiance_maps import (
        check_probe_file,
        light_probe,
    )  # the server imports this module

    name, file = safe_name(message.name), Path(f"view.{message.format}")
    pixels, metadata = uploaded(data, name, stored_orientation=stored_orientation)
    if message.view is None:
        check_probe_file(file)
        probe = light_probe(pixels, camera)
        height, width = probe.visible.shape
        percent = f"{100 * probe.visible_fraction:.3g} % of the sphere visible"
        oriented = (
            ""
            if metadata.orientation == UPRIGHT
            else f", {applied(metadata.orientation, stored_orientation)}"
        )
        note = f"light probe, {width} x {height} px, {percent}{oriented}"
        return ExportedImage(encode_image(file, probe.radiance), note)
    view = full_size_view(camera, message.view)
    request = DewarpRequest(camera, view, stored_orientation=stored_orientation)
    dewarped = ImageDewarper(request).dewarp(SourceImage(name, pixels, metadata), file)
    depth = {"uint8": "8 bits", "uint16": "16 bits", "float32": "linear light"}
    note = f"{dewarped.notes}, {depth[dewarped.pixels.dtype.name]}"
    return ExportedImage(dewarped.encoded(file), note)


def full_size_view(camera: Camera, requested: ViewRequest) -> View:
    """Return a view at the resolution of the image at its centre, or at the requested size if larger,
    within the maximum size.
    """
    width, height = requested.size
    view = _view(camera, requested)
    scale = np.nan_to_num(views.resolution(camera, view), nan=1.0, posinf=1.0)
    maximum = np.sqrt(MAX_EXPORTED_PIXELS / (view.size[0] * view.size[1]))
    scale = min(max(1.0, float(scale)), float(maximum))
    width_px = max(1, round(scale * width))
    height_px = None if height is None else max(1, round(scale * height))
    mm_per_px = None if requested.mm_per_px is None else requested.mm_per_px * width / width_px
    return _view(
        camera, requested.model_copy(update={"size": (width_px, height_px), "mm_per_px": mm_per_px})
    )


def _view(camera: Camera, requested: ViewRequest) -> View:
    options = requested.model_dump(exclude={"view"}, exclude_none=True)
    make = views.VIEWS[requested.view]
    function = views.perspective if requested.view == "perspective" else make
    parameters = signature(function).parameters
    if unknown := set(options) - set(parameters):
        raise InvalidParameter(f"{min(unknown)} does not apply to the view {requested.view}")
    required = {name for name, value in parameters.items() if value.default is Parameter.empty}
    if missing := required - {"camera", *options}:
        raise InvalidParameter(f"{min(missing)} is required for the view {requested.view}")
    return make(camera, **options)
