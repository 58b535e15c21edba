"""Plug-in of GStreamer with the element omnimirrordewarp, loaded by its Python loader.

The interpreter of the loader is that of the system. It imports omnimirror from the active virtual environment, or
otherwise from the folder in which this file is installed.
"""

import os
import site
import sys
from dataclasses import fields
from pathlib import Path

import gi

if "VIRTUAL_ENV" in os.environ:
    version = f"python{sys.version_info.major}.{sys.version_info.minor}"
    site.addsitedir(os.path.join(os.environ["VIRTUAL_ENV"], "lib", version, "site-packages"))
site.addsitedir(str(Path(__file__).parents[4]))

gi.require_version("Gst", "1.0")
gi.require_version("GstBase", "1.0")
gi.require_version("GstVideo", "1.0")
from gi.repository import GLib, GObject, Gst, GstBase, GstVideo  # noqa: E402

from omnimirror.base.errors import OmnimirrorError  # noqa: E402
from omnimirror.interop.gstreamer.frames import (  # noqa: E402
    PLANE_CHANNELS,
    FrameLayout,
    ViewSettings,
    dewarp_buffer,
)

Gst.init(None)
NAME = "omnimirrordewarp"
CAPS = Gst.Caps.from_string(f"video/x-raw, format = (string) {{ {', '.join(PLANE_CHANNELS)} }}")
SITE = GstVideo.VideoChromaSite
SITINGS = {SITE.NONE: "center", SITE.COSITED: "topleft", SITE.V_COSITED: "top"}
FULL_RANGE = getattr(GstVideo.VideoColorRange, "0_255")  # the name is no identifier
RANGES = {"pan_deg": 360.0, "tilt_deg": 90.0, "roll_deg": 360.0, "hfov_deg": 180.0}
DESCRIPTIONS = {
    "sensor": "Name of a sensor, or sensor or camera file",
    "view": "Type of the view: perspective, panorama, ...",
    "pan_deg": "Direction of view, right of forward (deg)",
    "tilt_deg": "Direction of view, above the horizon (deg)",
    "roll_deg": "Rotation about the direction of view (deg)",
    "hfov_deg": "Horizontal field of view (deg); 0: default of the view",
    "width": "Width of the view (px); 0: default of the view",
    "height": "Height of the view (px); 0: default of the view",
    "options": "Further options of the view in TOML, for example 'span_deg = 180'",
    "interpolation": "auto, nearest, linear, cubic or area",
    "keep_map": "Compute a map of all pixels: faster for views that do not move",
}


def _property(name, default):
    """Return the declaration of a GObject property."""
    text = DESCRIPTIONS[name]
    flags = GObject.ParamFlags.READWRITE | Gst.PARAM_MUTABLE_PLAYING
    if isinstance(default, bool):
        return (bool, text, text, default, flags)
    if isinstance(default, float):
        minimum = 0.0 if name == "hfov_deg" else -RANGES[name]
        return (float, text, text, minimum, RANGES[name], default, flags)
    if isinstance(default, int):
        return (int, text, text, 0, 32767, default, flags)
    return (str, text, text, default, flags)


class OmnimirrorDewarp(GstBase.BaseTransform):
    """Element that dewarps the frames of an omnidirectional mirror sensor."""

    __gtype_name__ = "OmnimirrorDewarp"
    __gstmetadata__ = (
        "omnimirror dewarper",
        "Filter/Effect/Video",
        "Dewarp the images of omnidirectional mirror sensors",
        "omnimirror",
    )
    __gsttemplates__ = tuple(
        Gst.PadTemplate.new(name, direction, Gst.PadPresence.ALWAYS, CAPS)
        for name, direction in (("sink", Gst.PadDirection.SINK), ("src", Gst.PadDirection.SRC))
    )
    __gproperties__ = {  # noqa: RUF012 - read once when the type is registered
        f.name.replace("_", "-"): _property(f.name, f.default) for f in fields(ViewSettings)
    }

    def __init__(self):
        super().__init__()
        self._settings = ViewSettings()
        self._dewarper = self._next = None
        self._is_changed = True
        self._layouts = None

    def do_get_property(self, prop):
        return getattr(self._settings, prop.name.replace("-", "_"))

    def do_set_property(self, prop, value):
        setattr(self._settings, prop.name.replace("-", "_"), "" if value is None else value)
        self._is_changed = True

    def do_start(self):
        try:
            self._dewarper, self._is_changed = self._settings.dewarper(), False
        except OmnimirrorError as e:
            self._post(Gst.Message.new_error, e)
            return False
        return True

    def do_transform_caps(self, direction, caps, allowed):
        """Convert caps of one pad to the other: equal formats, sizes of the camera and of the view."""
        dewarper = self._next or self._dewarper
        result = Gst.Caps.new_empty()
        for i in range(caps.get_size()):
            structure = caps.get_structure(i).copy()
            if dewarper is None:
                structure.remove_field("width")
                structure.remove_field("height")
            else:
                is_sink = direction == Gst.PadDirection.SINK
                width, height = dewarper.view.size if is_sink else dewarper.camera.image_size
                structure.set_value("width", width)
                structure.set_value("height", height)
            structure.remove_field("pixel-aspect-ratio")
            result.append_structure(structure)
        if allowed is not None:
            result = allowed.intersect_full(result, Gst.CapsIntersectMode.FIRST)
        return result

    def do_get_unit_size(self, caps):
        return True, GstVideo.VideoInfo.new_from_caps(caps).size

    def do_set_caps(self, source_caps, view_caps):
        source, view = (GstVideo.VideoInfo.new_from_caps(caps) for caps in (source_caps, view_caps))
        if source.interlace_mode != GstVideo.VideoInterlaceMode.PROGRESSIVE:
            self._post(Gst.Message.new_error, "frames must be progressive; insert deinterlace")
            return False
        if self._next is not None and self._next.view.size == (view.width, view.height):
            self._dewarper, self._next = self._next, None
        self._layouts = _layout(source), _layout(view)
        self._siting = SITINGS.get(source.chroma_site, "left")
        self._is_full_range = source.colorimetry.range == FULL_RANGE
        return True

    def do_transform(self, source, view):
        try:
            if self._is_changed:
                self._update()
            with (
                source.map(Gst.MapFlags.READ) as source_memory,
                view.map(Gst.MapFlags.READ | Gst.MapFlags.WRITE) as view_memory,
            ):
                source_layout, view_layout = self._layouts
                dewarp_buffer(
                    self._dewarper,
                    source_memory.data,
                    _layout_of_buffer(source, source_layout),
                    view_memory.data,
                    view_layout,
                    self._siting,
                    self._is_full_range,
                )
        except Exception as e:  # the bindings print exceptions, and the pipeline would continue
            self._post(Gst.Message.new_error, e)
            return Gst.FlowReturn.ERROR
        return Gst.FlowReturn.OK

    def _update(self):
        """Apply changed properties: at once, or, for another size, when caps are negotiated again.

        Invalid values are reported by a warning; the previous view is continued.
        """
        self._is_changed = False
        try:
            dewarper = self._settings.dewarper()
        except OmnimirrorError as e:
            self._post(Gst.Message.new_warning, e)
            return
        before = self._dewarper
        if dewarper.camera.image_size != before.camera.image_size:
            self._next = dewarper
            self.reconfigure_sink()
        elif dewarper.view.size != before.view.size:
            self._next = dewarper
            self.reconfigure_src()
        else:
            self._dewarper, self._next = dewarper, None

    def _post(self, kind, reason):
        error = GLib.Error.new_literal(
            Gst.ResourceError.quark(), str(reason), Gst.ResourceError.SETTINGS
        )
        self.post_message(kind(self, error, ""))


def _layout(info):
    return FrameLayout(
        info.finfo.name, (info.width, info.height), list(info.offset), list(info.stride)
    )


def _layout_of_buffer(buffer, layout):
    """Return the layout of a buffer: decoders and cameras can use other strides than the caps."""
    meta = GstVideo.buffer_get_video_meta(buffer)
    if meta is None:
        return layout
    return layout._replace(offsets=list(meta.offset), strides=list(meta.stride))


GObject.type_register(OmnimirrorDewarp)
__gstelementfactory__ = (NAME, Gst.Rank.NONE, OmnimirrorDewarp)
