"""Generate the images of docs/interoperability.md: results of other programs next to those of
omnimirror.

python docs/images/interop.py --blender .venv/blender/bin/python --newton .venv/newton/bin/python
python docs/images/interop.py --only vlc
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import omnimirror as om
from omnimirror.base.colour import srgb_bytes
from omnimirror.simulation.rendering import expose

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))


def blender(python: Path, pixels: int = 480) -> None:
    """Render the test box with the misaligned sensor of the paper, in omnimirror and in Blender."""
    from tests.interop.ray_tables.box import Box
    from tests.simulation.test_mitsuba_images import MISALIGNED, small

    sensor = small("paper-spherical", pixels, MISALIGNED)
    with tempfile.TemporaryDirectory() as folder:
        script, image = Path(folder, "camera.py"), Path(folder, "picture.exr")
        om.write_rays(sensor, script, formats="blender")
        program = ROOT / "tests" / "interop" / "ray_tables" / "in_blender.py"
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run([python, program, script, image, "64"], check=True, env=environment)
        theirs = om.read_image(image)[..., :3]
    both = [srgb_bytes(light) for light in (expose(sensor, Box(), samples=16), theirs)]
    om.write_image(
        HERE / "interop-blender.jpg",
        np.hstack([both[0], np.full((pixels, 16, 3), 255, np.uint8), both[1]]),
    )


def newton(python: Path, pixels: int = 480) -> None:
    """Draw depths in the same box from the ray table: exact values, and those of Newton."""
    from tests.interop.ray_tables.box import first_hits
    from tests.simulation.test_mitsuba_images import MISALIGNED, small

    sensor = small("paper-spherical", pixels, MISALIGNED)
    table = om.ray_table(sensor)
    with tempfile.TemporaryDirectory() as folder:
        rays, depths = Path(folder, "rays.npy"), Path(folder, "depths.npy")
        om.write_rays(sensor, rays, formats="newton")
        program = ROOT / "tests" / "interop" / "ray_tables" / "in_newton.py"
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
        subprocess.run([python, program, rays, depths], check=True, env=environment)
        theirs = 1000 * np.load(depths)
    with np.errstate(invalid="ignore"):
        ours = np.linalg.norm(first_hits(table.origins, table.directions) - table.origins, axis=-1)
    on = table.weights > 0
    farthest = ours[on].max()
    both = [np.where(on, 255 * depth / farthest, 0).astype(np.uint8) for depth in (ours, theirs)]
    om.write_image(
        HERE / "interop-newton.png",
        np.hstack([both[0], np.full((pixels, 16), 255, np.uint8), both[1]]),
    )


def maps(left: int = 150, top: int = 60, size: tuple[int, int] = (80, 110), times: int = 3) -> None:
    """Draw a corner of a view: omnimirror, bicubic and bilinear, then C, shader, GStreamer, OBS,
    OpenCV and ffmpeg."""
    from tests.interop.view_maps import consumers

    sensor = om.load_sensor("paper-spherical")
    image = om.render_image(sensor, om.Room(), samples=4, low_pass=True)
    view = om.screens.Plane((320, 240), pan_deg=60.0, hfov_deg=60.0)
    ours = [om.Dewarper(sensor, view, interpolation)(image) for interpolation in ("auto", "linear")]
    with tempfile.TemporaryDirectory() as folder:
        theirs = [program(sensor, view, image, Path(folder)) for program in consumers.PROGRAMS]
    crops = [
        v[top : top + size[1], left : left + size[0]].repeat(times, 0).repeat(times, 1)
        for v in (*ours, *theirs)
    ]
    gap = np.full((crops[0].shape[0], 8, 3), 255, np.uint8)
    om.write_image(
        HERE / "interop-maps.jpg", np.hstack([part for crop in crops for part in (crop, gap)][:-1])
    )


def compositor() -> None:
    """Draw a view by st_warp of OpenImageIO with a word painted on its wall, and its inverse warp
    to the raw image."""
    import cv2
    import OpenImageIO as oiio

    from tests.interop.view_maps.consumers import warped

    sensor = om.load_sensor("paper-spherical")
    image = om.render_image(sensor, om.Room(), samples=4, low_pass=True)
    view = om.screens.Plane((640, 512), pan_deg=50.0, hfov_deg=95.0)
    with tempfile.TemporaryDirectory() as folder:
        (exported,) = om.write_maps(sensor, view, Path(folder, "room.exr"), formats="stmap")
        straight = warped(oiio, image, exported.paths[0])[..., :3]
        painted = np.ascontiguousarray(np.clip(straight, 0, 255).astype(np.uint8))
        cv2.putText(
            painted,
            "painted",
            (150, 110),
            cv2.FONT_HERSHEY_DUPLEX,
            2.6,
            (200, 30, 30),
            8,
            cv2.LINE_AA,
        )
        back = warped(oiio, painted, exported.paths[1])[..., :3]
        coverage = oiio.ImageBuf(str(exported.paths[1])).get_pixels("float")[..., 3]
    on = (
        cv2.erode(coverage, np.ones((5, 5)))[..., None] > 0
    )  # the filter blends pixels outside the boundary
    raw = np.where(on, back, image)[:512, 60:700].clip(0, 255).astype(np.uint8)
    om.write_image(
        HERE / "interop-compositor.jpg",
        np.hstack([painted, np.full((512, 16, 3), 255, np.uint8), raw]),
    )


def panorama(pixels: int = 360, width: int = 1440) -> None:
    """Draw the test room as a panorama of a generic renderer, its warp by OpenImageIO, and the
    image of omnimirror."""
    import cv2
    import OpenImageIO as oiio

    from omnimirror.interop.pinholes import camera_rig
    from tests.interop.ray_tables.box import Box, colours, first_hits
    from tests.interop.view_maps.consumers import warped
    from tests.simulation.test_mitsuba_images import MISALIGNED, small

    sensor = small("paper-spherical", pixels, MISALIGNED)
    view = om.views.sphere(sensor, (width, None))
    (rig_camera,) = camera_rig(sensor, size=width, panorama=True)
    columns, rows = np.meshgrid(*(np.arange(side, dtype=float) for side in view.size))
    rendered = colours(first_hits(rig_camera.position_mm, view.targets_at(columns, rows)))
    with tempfile.TemporaryDirectory() as folder:
        (exported,) = om.write_maps(sensor, view, Path(folder, "room.exr"), formats="stmap")
        raw = warped(oiio, rendered, exported.paths[1])[..., :3]
    small_one = cv2.resize(
        rendered.astype(np.float32), (2 * pixels, pixels), interpolation=cv2.INTER_AREA
    )
    parts = [
        srgb_bytes(light.astype(np.float32))
        for light in (small_one, raw, expose(sensor, Box(), samples=16))
    ]
    gap = np.full((pixels, 16, 3), 255, np.uint8)
    om.write_image(
        HERE / "interop-panorama.jpg", np.hstack([parts[0], gap, parts[1], gap, parts[2]])
    )


def mitsuba(pixels: int = 240) -> None:
    """Render the same box with the Mitsuba plug-in and with omnimirror."""
    import mitsuba as mi

    from tests.interop.ray_tables.box import Box
    from tests.interop.ray_tables.test_mitsuba_sensor import mitsuba_image
    from tests.simulation.test_mitsuba_images import MISALIGNED, small

    mi.set_variant("scalar_rgb")
    sensor = small("paper-spherical", pixels, MISALIGNED)
    with tempfile.TemporaryDirectory() as folder:
        om.write_rays(sensor, Path(folder, "camera.py"), formats="mitsuba")
        theirs = mitsuba_image(mi, Path(folder, "camera.py"), pixels)
    both = [
        srgb_bytes(light).repeat(2, 0).repeat(2, 1)
        for light in (expose(sensor, Box(), samples=16), theirs)
    ]
    gap = np.full((2 * pixels, 16, 3), 255, np.uint8)
    om.write_image(HERE / "interop-mitsuba.jpg", np.hstack([both[0], gap, both[1]]))


def colmap() -> None:
    """Draw the COLMAP reconstruction of the room from above: points, and estimated and true path."""
    import matplotlib.pyplot as plt
    import pycolmap

    from tests.full.test_colmap import in_the_room, reconstructed, walked

    with tempfile.TemporaryDirectory() as folder:
        poses, project = walked(Path(folder))
        path, truth, points = in_the_room(reconstructed(pycolmap, project.folder), poses, project)
    figure, axes = plt.subplots(figsize=(6.4, 5.0), layout="constrained")
    axes.plot(
        points[:, 0], points[:, 1], ".", color="0.45", markersize=1.5, label=f"{len(points)} points"
    )
    axes.plot(
        truth[:, 0],
        truth[:, 1],
        "-",
        color="tab:orange",
        linewidth=3,
        label="true camera path",
    )
    axes.plot(path[:, 0], path[:, 1], "k.", markersize=4, label="path estimated by COLMAP")
    low, high = np.percentile(points[:, :2], [0.5, 99.5], axis=0)
    axes.set(xlabel="x, m", ylabel="y, m", aspect="equal", xlim=(low[0] - 0.5, high[0] + 0.5))
    axes.set_ylim(low[1] - 0.5, high[1] + 0.5)
    axes.legend(loc="upper right")
    figure.savefig(HERE / "interop-colmap.png", dpi=110)


def vlc(side: int = 1024) -> None:
    """Draw a view of a served video in omnimirror and in VLC."""
    from omnimirror.interop.gateway.live_views import Gateway
    from omnimirror.interop.gateway.routes import create_app
    from omnimirror.io.video_frames import frame_of_image
    from omnimirror.io.video_writer import VideoWriter
    from tests.interop.gateway.test_gateway import shown_by_vlc
    from tests.serving import served

    sensor = om.load_sensor("paper-spherical")
    image = om.render_image(sensor, om.Room(), samples=4, low_pass=True)
    view = om.NamedView("front", options={"size": (480, 272), "hfov_deg": 70.0, "pan_deg": 40.0})
    with tempfile.TemporaryDirectory() as folder:
        film = Path(folder, "room.ts")
        with VideoWriter(
            film, (side, side), 25, crf=12, options={"g": "10", "tune": "zerolatency"}
        ) as video:
            for _ in range(50):
                video.write(frame_of_image(image))
        gateway = Gateway(str(film), False, sensor, {"front": view}, workers=2)
        with served(create_app(gateway, None)) as address:
            vlc_image = shown_by_vlc(f"{address}front.ts")[:272, :480]
    ours = om.Dewarper(sensor, view(sensor))(image)
    om.write_image(
        HERE / "interop-vlc.jpg", np.hstack([ours, np.full((272, 16, 3), 255, np.uint8), vlc_image])
    )


WITHOUT_OPTIONS = {
    "maps": maps,
    "compositor": compositor,
    "panorama": panorama,
    "mitsuba": mitsuba,
    "colmap": colmap,
    "vlc": vlc,
}

if __name__ == "__main__":
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument(
        "--blender", type=Path, default=Path(sys.prefix) / "blender" / "bin" / "python"
    )
    options.add_argument(
        "--newton", type=Path, default=Path(sys.prefix) / "newton" / "bin" / "python"
    )
    options.add_argument("--only", choices=("blender", "newton", *WITHOUT_OPTIONS))
    arguments = options.parse_args()
    figures = {
        "blender": lambda: blender(arguments.blender),
        "newton": lambda: newton(arguments.newton),
        **WITHOUT_OPTIONS,
    }
    for name in [arguments.only] if arguments.only else figures:
        figures[name]()
