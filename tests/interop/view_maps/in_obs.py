"""Draw an image by an effect and its map with the OBS library, on a display or on Xvfb.

in_obs.py EFFECT TABLE.png IMAGE.npy WIDTH HEIGHT VIEW.npy
"""

from __future__ import annotations

import ctypes as c
import sys
from ctypes.util import find_library
from pathlib import Path

import numpy as np

RGBA, NEITHER = 3, 2  # of gs_color_format and gs_cull_mode


class Library:
    """Library functions with arguments that are pointers, numbers and strings, and a pointer as
    result."""

    def __init__(self, name):
        self._library = c.CDLL(find_library(name))

    def __getattr__(self, name):
        function = getattr(self._library, name)
        function.restype = c.c_void_p
        return function


def main(effect, table, image, width, height, view):
    x11, obs, graphics = Library("X11"), Library("obs"), c.c_void_p()
    obs.obs_set_nix_platform_display(c.c_void_p(x11.XOpenDisplay(None)))
    assert not obs.gs_create(c.byref(graphics), find_library("obs-opengl").encode(), 0)
    obs.gs_enter_context(graphics)
    Path(view).with_name("version.txt").write_text(
        c.string_at(obs.obs_get_version_string()).decode()
    )
    np.save(
        view,
        draw(obs, effect.encode(), table.encode(), np.load(image), (int(width), int(height))),
    )


def draw(obs, effect, table, source_pixels, size):
    """Draw the image (h, w, 3) by the effect; return (height, width, 4)."""
    error = c.c_char_p()
    handle = c.c_void_p(obs.gs_effect_create_from_file(effect, c.byref(error)))
    assert handle.value, error.value
    rows = np.ascontiguousarray(
        np.dstack([source_pixels, np.full_like(source_pixels[..., 0], 255)])
    )
    data = c.c_void_p(rows.ctypes.data)
    image = c.c_void_p(
        obs.gs_texture_create(rows.shape[1], rows.shape[0], RGBA, 1, c.byref(data), 0)
    )
    file = c.create_string_buffer(1 << 18)  # gs_image_file_t; its first member is the texture
    obs.gs_image_file_init(file, table)
    obs.gs_image_file_init_texture(file)
    for name, texture in ((b"image", image), (b"view_map", c.c_void_p.from_buffer(file))):
        parameter = c.c_void_p(obs.gs_effect_get_param_by_name(handle, name))
        assert parameter.value, name
        obs.gs_effect_set_texture(parameter, texture)
    target = c.c_void_p(obs.gs_texrender_create(RGBA, 0))
    assert obs.gs_texrender_begin(target, *size)
    obs.gs_enable_depth_test(False)
    obs.gs_set_cull_mode(NEITHER)
    obs.gs_ortho(*map(c.c_float, (0, size[0], 0, size[1], -100, 100)))
    while (obs.gs_effect_loop(handle, b"Draw") or 0) & 1:
        obs.gs_draw_sprite(image, 0, *size)
    obs.gs_texrender_end(target)
    stage = c.c_void_p(obs.gs_stagesurface_create(*size, RGBA))
    obs.gs_stage_texture(stage, c.c_void_p(obs.gs_texrender_get_texture(target)))
    pixels, line = c.c_void_p(), c.c_uint32()
    assert obs.gs_stagesurface_map(stage, c.byref(pixels), c.byref(line))
    return (
        np.ctypeslib.as_array((c.c_uint8 * (line.value * size[1])).from_address(pixels.value))
        .reshape(size[1], line.value // 4, 4)[:, : size[0]]
        .copy()
    )


main(*sys.argv[1:])
