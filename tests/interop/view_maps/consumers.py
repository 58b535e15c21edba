"""Programs that evaluate view maps: browser, FFmpeg, GStreamer, OBS, C compilers, MicroPython."""

from __future__ import annotations

import ast
import base64
import ctypes
import os
import shutil
import subprocess
import sys
from ctypes.util import find_library
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import omnimirror as om
from tests.apps.studio.browser import FLAGS, chromium

HERE = Path(__file__).parent
DRAW = """
async ([shader, table, pixels, size, source, tabled]) => {
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = size;
  const gl = canvas.getContext("webgl2", { preserveDrawingBuffer: true });
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
  const program = gl.createProgram();
  const vertex = `#version 300 es
out vec2 v_texcoord; // from the upper left, as in glshader of GStreamer
void main() {
  vec2 at = vec2[3](vec2(-1, -1), vec2(3, -1), vec2(-1, 3))[gl_VertexID];
  v_texcoord = vec2(1.0 + at.x, 1.0 - at.y) / 2.0;
  gl_Position = vec4(at, 0, 1);
}`;
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, shader]]) {
    const part = gl.createShader(kind);
    gl.shaderSource(part, text);
    gl.compileShader(part);
    if (!gl.getShaderParameter(part, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(part));
    gl.attachShader(program, part);
  }
  gl.linkProgram(program);
  gl.useProgram(program);
  gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
  const texture = (unit, filter, upload) => {
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    upload();
  };
  texture(0, gl.LINEAR, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, ...source, 0, gl.RGB, gl.UNSIGNED_BYTE, bytes(pixels)));
  texture(1, gl.NEAREST, () =>
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG32F, ...tabled, 0, gl.RG, gl.FLOAT, new Float32Array(bytes(table).buffer)));
  const at = (name) => gl.getUniformLocation(program, name);
  gl.uniform1i(at("source_image"), 0);
  gl.uniform1i(at("view_map"), 1);
  gl.uniform2f(at("resolution"), ...size);
  gl.uniform4f(at("border"), 0, 0, 0, 1);
  gl.drawArrays(gl.TRIANGLES, 0, 3);
  const out = new Uint8Array(4 * size[0] * size[1]);
  gl.readPixels(0, 0, ...size, gl.RGBA, gl.UNSIGNED_BYTE, out);
  let text = "";
  for (let i = 0; i < out.length; i += 32768) text += String.fromCharCode(...out.subarray(i, i + 32768));
  return btoa(text);
}
"""


def drawn(page, shader, image, size, table=None, table_size=(0, 0)):
    """Draw a shader with WebGL 2; return the image with the top row first."""
    tabled, pixels = (
        base64.b64encode(b).decode()
        for b in (table.read_bytes() if table else b"", image.tobytes())
    )
    text = shader if isinstance(shader, str) else shader.read_text()
    arguments = [text, tabled, pixels, list(size), list(image.shape[1::-1]), list(table_size)]
    pixels_rgba = np.frombuffer(base64.b64decode(page.evaluate(DRAW, arguments)), np.uint8)
    return pixels_rgba.reshape(size[1], size[0], 4)[::-1, :, :3]


def glsl_of(hlsl):
    """Translate HLSL to GLSL for WebGL 2 by glslang and SPIRV-Cross; None if not installed."""
    if not (shutil.which("glslangValidator") and shutil.which("spirv-cross")):
        return None
    compiled, translated = hlsl.with_suffix(".spv"), hlsl.with_suffix(".spv.frag")
    arguments = ["glslangValidator", "-D", "-V", "-S", "frag", "-e", "main", hlsl, "-o", compiled]
    run = subprocess.run(arguments, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout
    arguments = [
        "spirv-cross",
        compiled,
        "--version",
        "300",
        "--es",
        "--flatten-ubo",
        "--output",
        translated,
    ]
    subprocess.run(arguments, check=True)
    text = translated.read_text().replace(
        "uniform highp vec4 Drawing[2];", "uniform vec2 resolution; uniform vec4 border;"
    )
    for hlsl_name, glsl in {
        "Drawing[0].xy": "resolution",
        "Drawing[1]": "border",
        "SPIRV_Cross_Combinedview_mapSPIRV_Cross_DummySampler": "view_map",
        "SPIRV_Cross_Combinedsource_imagesmooth": "source_image",
    }.items():
        text = text.replace(hlsl_name, glsl)
    return text


def drawn_by_obs(effect, table, image, size, folder):
    """Draw an effect by the OBS library on Xvfb; return (h, w, 3), or None if not installed."""
    if not (shutil.which("xvfb-run") and find_library("obs") and find_library("obs-opengl")):
        return None
    source, view = folder / "source.npy", folder / "view.npy"
    np.save(source, image)
    arguments = [
        "xvfb-run",
        "-a",
        sys.executable,
        HERE / "in_obs.py",
        effect,
        table,
        source,
        *map(str, size),
        view,
    ]
    run = subprocess.run(arguments, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr
    return np.load(view)[..., :3]


def warped(oiio, image, st_map):
    """Warp an image by st_warp of OpenImageIO; t counts upwards."""
    source, st = oiio.ImageBuf(np.ascontiguousarray(image, np.float32)), oiio.ImageBuf(str(st_map))
    return oiio.ImageBufAlgo.st_warp(
        source, st, filtername="triangle", flip_t=True, roi=st.roi
    ).get_pixels("float")


def remapped(paths, image):
    """Apply the filter remap of FFmpeg with two PGM files."""
    import av

    graph = av.filter.Graph()
    frames = [av.VideoFrame.from_ndarray(image, "rgb24")]
    for path in paths:
        with av.open(str(path)) as file:
            frames.append(next(file.decode(video=0)).reformat(format="gray16le"))
    ends = [
        graph.add_buffer(width=f.width, height=f.height, format=f.format, time_base=1)
        for f in frames
    ]
    remap, sink = graph.add("remap", "fill=black"), graph.add("buffersink")
    for i, end in enumerate(ends):
        end.link_to(remap, 0, i)
    remap.link_to(sink)
    graph.configure()
    for end, frame in zip(ends, frames, strict=True):
        frame.pts, frame.time_base = 0, 1
        end.push(frame)
        end.push(None)
    return sink.pull().to_ndarray(format="rgb24")


def piped(script, image, folder):
    """Run a GStreamer script on an image without a display; None if not installed."""
    source, view = folder / "source.png", folder / "view.png"
    om.write_image(source, image)
    arguments = [
        "sh",
        script,
        f"filesrc location={source} ! pngdec",
        f"pngenc ! filesink location={view}",
    ]
    run = subprocess.run(arguments, capture_output=True, text=True, env=os.environ | SCREENLESS)
    if run.returncode and not drawable():
        return None
    assert run.returncode == 0, run.stdout + run.stderr
    return om.read_image(view)[..., :3]


SCREENLESS = {"GST_GL_PLATFORM": "egl", "GST_GL_WINDOW": "egl-device"}


def drawable():
    """Return whether GStreamer with OpenGL is installed."""
    try:
        arguments = [
            "gst-launch-1.0",
            "videotestsrc",
            "num-buffers=1",
            "!",
            "glupload",
            "!",
            "gldownload",
            "!",
            "fakesink",
        ]
        return (
            subprocess.run(arguments, capture_output=True, env=os.environ | SCREENLESS).returncode
            == 0
        )
    except FileNotFoundError:
        return False


STRICT = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Wconversion", "-Werror", "-O2"]


def compilers():
    commands = [[name] for name in ("gcc", "clang") if shutil.which(name)]
    return commands + ([[sys.executable, "-m", "ziglang", "cc"]] if find_spec("ziglang") else [])


def compiled(c_file):
    """Compile a C file without warnings by all compilers; return the library, or None without compiler."""
    built = c_file.with_suffix(".so")
    for compiler in compilers():
        run = subprocess.run(
            [*compiler, *STRICT, "-shared", "-fPIC", c_file, "-o", built],
            capture_output=True,
            text=True,
        )
        assert run.returncode == 0, run.stderr
    return ctypes.CDLL(str(built)) if built.exists() else None


def dewarped_by_c(library, name, image, view):
    """Dewarp an image by the C file into an existing array."""
    dewarp = getattr(library, f"{name}_dewarp")
    dewarp.argtypes = [
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_void_p,
        ctypes.c_size_t,
        ctypes.c_int,
    ]
    dewarp(image.ctypes.data, image.strides[0], view.ctypes.data, view.strides[0], view.shape[2])
    return view


CORTEX_M7 = "-target thumb-freestanding-eabi -mcpu=cortex_m7 -std=c99 -O2 -ffreestanding -nostdlib -ffunction-sections"
MACHINE = (
    "-M mps2-an500 -nographic -monitor none -serial none "
    "-semihosting-config enable=on,target=native -icount shift=0"
)


def on_a_cortex_m7(c_file):
    """Return instructions and checksum of the view ``ahead`` of a noise image; None without emulator."""
    if not (shutil.which("qemu-system-arm") and find_spec("ziglang")):
        return None
    program = c_file.with_suffix(".elf")
    sources = [
        "-I",
        c_file.parent,
        "-T",
        HERE / "cortex_m7.ld",
        HERE / "cortex_m7.c",
        c_file,
        "-o",
        program,
    ]
    compiler = [sys.executable, "-m", "ziglang", "cc", *CORTEX_M7.split(), "-Wl,--gc-sections"]
    subprocess.run([*compiler, *sources], check=True, capture_output=True)
    run = subprocess.run(
        ["qemu-system-arm", *MACHINE.split(), "-kernel", program], capture_output=True, text=True
    )
    instructions, total = (
        int(word, 16) for word in run.stderr.split()
    )  # semihosting writes to standard error
    return instructions, total


MICROPYTHON = Path(sys.prefix) / "node/node_modules/@micropython/micropython-webassembly-pyscript"


def by_micropython(paths, expression):
    """Evaluate an expression of the module ``view`` in MicroPython; None if not installed."""
    if not (shutil.which("node") and MICROPYTHON.exists()):
        return None
    arguments = ["node", HERE / "in_micropython.mjs", MICROPYTHON, *paths, expression]
    run = subprocess.run(arguments, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    return ast.literal_eval(run.stdout)


# -- images of the documentation -----------------------------------------------------------------------


def in_c(sensor, view, image, folder):
    (exported,) = om.write_maps(sensor, view, folder / "view.c", formats="c99")
    width, height = view.size
    return dewarped_by_c(
        compiled(exported.paths[0]), "view", image, np.zeros((height, width, 3), np.uint8)
    )


def in_browser(sensor, view, image, folder):
    from playwright.sync_api import sync_playwright

    (exported,) = om.write_maps(sensor, view, folder / "view.frag", formats="glsl")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        return drawn(
            browser.new_page(), exported.paths[0], image, view.size, exported.paths[1], view.size
        )


def in_ffmpeg(sensor, view, image, folder):
    (exported,) = om.write_maps(sensor, view, folder / "view.pgm", formats="ffmpeg")
    return remapped(exported.paths, image)


def in_gstreamer(sensor, view, image, folder):
    (exported,) = om.write_maps(sensor, view, folder / "view.sh", formats="gstreamer")
    return piped(exported.paths[0], image, folder)


def in_opencv(sensor, view, image, folder):
    import cv2

    (exported,) = om.write_maps(sensor, view, folder / "view.npz", formats="opencv")
    maps = np.load(exported.paths[0])
    return cv2.remap(image, maps["map_x"], maps["map_y"], cv2.INTER_LINEAR)


def in_obs(sensor, view, image, folder):
    (exported,) = om.write_maps(sensor, view, folder / "view.effect", formats="obs")
    return drawn_by_obs(*exported.paths, image, view.size, folder)


PROGRAMS = (in_c, in_browser, in_gstreamer, in_obs, in_opencv, in_ffmpeg)
