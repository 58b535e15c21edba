"""Measure the frame rate of GStreamer pipelines that dewarp video, against decoding alone.

Motion JPEG of 1024 x 1024 px is decoded to I420 and dewarped to a panorama of 1440 x 360 px by the element
``omnimirrordewarp``, with and without ``keep-map``, or by ``glshader`` with the shader of ``omnimirror
maps``, including the conversions to RGBA and back. Start-up is excluded: the rate is the difference of two
lengths. All pipelines run interleaved. Requires the programs of ``make programs``.

    python benchmarks/gstreamer_rate.py -o out/benchmarks
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from measurement_conditions import describe_conditions
from timing import measure_interleaved

import omnimirror as om
from omnimirror.base.files import write_text
from omnimirror.interop.gstreamer.frames import PLUGIN_PATH

SENSOR, SIZE = "paper-spherical", (1440, 360)
LENGTHS = (20, 220)  # frames
VIEW = f"sensor={SENSOR} view=panorama width={SIZE[0]} height={SIZE[1]}"
ENVIRONMENT = os.environ | {
    "GST_PLUGIN_PATH": str(PLUGIN_PATH),
    "VIRTUAL_ENV": sys.prefix,
    "GST_GL_PLATFORM": "egl",
    "GST_GL_WINDOW": "egl-device",
}


def write_videos(folder: Path) -> None:
    """Write videos of both lengths from a rendered image."""
    image = folder / "image.png"
    om.write_image(image, om.render_image(om.load_sensor(SENSOR), om.Room(), samples=1))
    for length in LENGTHS:
        run_pipeline(
            f"gst-launch-1.0 -q filesrc location={image} ! pngdec ! videoconvert ! imagefreeze "
            f"num-buffers={length} ! jpegenc ! avimux ! filesink location={folder}/{length}.avi"
        )


def run_pipeline(command: str) -> None:
    """Run a shell command that starts a pipeline."""
    subprocess.run(command, shell=True, check=True, capture_output=True, env=ENVIRONMENT)


def pipelines(folder: Path, length: int) -> dict[str, Callable[[], None]]:
    """Return functions that run the pipelines for a video of the given length."""
    decode = f"filesrc location={folder}/{length}.avi ! avidemux ! jpegdec"
    element = f"gst-launch-1.0 -q {decode} ! omnimirrordewarp {VIEW}"
    commands = {
        "decoding alone": f"gst-launch-1.0 -q {decode} ! fakesink",
        "`omnimirrordewarp`": f"{element} ! fakesink",
        "`omnimirrordewarp keep-map=true`": f"{element} keep-map=true ! fakesink",
        "`glshader`": f"sh {folder}/view.sh '{decode}' 'video/x-raw,format=I420 ! fakesink'",
    }
    return {name: lambda c=command: run_pipeline(c) for name, command in commands.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("out/benchmarks"))
    parser.add_argument("--runs", type=int, default=7)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_videos(folder)
        sensor = om.load_sensor(SENSOR)
        om.write_maps(
            sensor, om.views.panorama(sensor, SIZE), folder / "view.sh", formats="gstreamer"
        )
        functions = {
            f"{name} {length}": function
            for length in LENGTHS
            for name, function in pipelines(folder, length).items()
        }
        times = measure_interleaved(functions, arguments.runs)
        short, long = LENGTHS
        rates = {
            name: 1e3 * (long - short) / (times[f"{name} {long}"] - times[f"{name} {short}"])
            for name in pipelines(folder, short)
        }
    lines = ["# GStreamer", "", describe_conditions(arguments.runs), ""]
    lines += ["| pipeline | frames/s | of decoding alone |", "|---|--:|--:|"]
    for name, rate in rates.items():
        lines.append(f"| {name} | {rate:.0f} | {100 * rate / rates['decoding alone']:.0f} % |")
    print("\n".join(lines))
    arguments.output.mkdir(parents=True, exist_ok=True)
    write_text(arguments.output / "gstreamer_rate.md", "\n".join(lines) + "\n")


if __name__ == "__main__":
    main()
