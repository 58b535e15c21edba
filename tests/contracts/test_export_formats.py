"""Contract of all export formats: files are read back and deviations are stated."""

from __future__ import annotations

import runpy
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest

import omnimirror as om
from omnimirror.base.errors import InvalidParameter, OmnimirrorError
from omnimirror.base.files import TEMPORARY_MARK
from omnimirror.interop.export_formats import write_formats
from omnimirror.interop.ray_tables import RAY_FORMATS
from omnimirror.optics.mirrors.mirror import MirrorPose

SENSOR = om.load_sensor("paper-spherical")
IMAGER = replace(SENSOR.imager, width_px=48, height_px=40, pixel_pitch_um=5.2 * 1024 / 44)
CAMERAS = {
    "misaligned": replace(SENSOR, imager=IMAGER, mirror_pose=MirrorPose(1.0, -0.7, 0.5, 1.0, -1.5)),
    "calibrated": om.Unified(
        xi=0.9, focal_px=(30.0, 30.0), centre_px=(31.5, 23.5), image_size=(64, 48)
    ),
}


def exr(path):
    with OpenEXR.File(str(path), separate_channels=True) as file:
        return {name: np.array(c.pixels) for name, c in file.channels().items()}, dict(
            file.header()
        )


def of_exr(paths):
    channels, _ = exr(paths[0])
    return *(
        np.stack([channels[f"{layer}.{a}"] for a in "XYZ"], -1) for layer in ("origin", "direction")
    ), channels["weight.Y"]


def of_npz(paths):
    rays = np.load(paths[0])
    return rays["origins_mm"], rays["directions"], rays["weights"]


def of_mitsuba(paths):
    """Read the table of the plug-in."""
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    rays = runpy.run_path(str(paths[0]))["RAYS"]
    return rays[..., :3], rays[..., 3:6], rays[..., 6]


def of_blender(paths):
    """Convert from x right, y up, z forward in m."""
    origin, direction = (om.read_image(path) for path in paths[2:])
    vectors = [np.stack([v[..., 2], -v[..., 0], v[..., 1]], axis=-1) for v in (origin, direction)]
    return 1000 * vectors[0], vectors[1], origin[..., 3]


def of_newton(paths):
    """Convert from x right, y up, -z forward in m; no direction for obscured pixels."""
    rays = np.load(paths[0])[:, :, 0]
    vectors = np.stack([-rays[..., 2], -rays[..., 0], rays[..., 1]], axis=-1)
    return 1000 * vectors[:, :, 0], vectors[:, :, 1], vectors[:, :, 1].any(-1).astype(float)


READERS = {
    "exr": of_exr,
    "npz": of_npz,
    "mitsuba": of_mitsuba,
    "blender": of_blender,
    "newton": of_newton,
}


@pytest.mark.parametrize("camera", CAMERAS)
@pytest.mark.parametrize("kind", RAY_FORMATS)
def test_files_equal_the_traced_rays(kind, camera, tmp_path):
    """Within 0.001 deg and 0.001 mm."""
    camera = CAMERAS[camera]
    (exported,) = om.write_rays(camera, tmp_path, formats=kind)
    assert all(path.stat().st_size for path in exported.paths)
    origins, directions, weights = READERS[kind](exported.paths)
    width, height = camera.image_size
    pixels = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    true = camera.backproject(pixels.astype(float))
    on = true.valid.reshape(height, width)
    assert ((weights > 0) == on).all()
    assert np.abs(origins.reshape(-1, 3) - true.origins)[true.valid].max() < 1e-3
    apart = np.linalg.norm(
        np.cross(directions.reshape(-1, 3), true.directions)[true.valid], axis=-1
    )
    assert np.degrees(apart.max()) < 1e-3
    assert (directions.reshape(-1, 3)[true.valid] * true.directions[true.valid]).sum(-1).min() > 0


def test_header_states_units_and_frame(tmp_path):
    om.write_rays(SENSOR, tmp_path / "rays.exr", step=64)
    channels, header = exr(tmp_path / "rays.exr")
    assert {c.dtype for c in channels.values()} == {np.dtype("float32")}
    assert header["omnimirror:step"] == 64
    assert (header["omnimirror:imageWidth"], header["omnimirror:imageHeight"]) == (1024, 1024)
    assert "mm" in header["omnimirror:units"]
    assert "x forward, y left, z up" in header["omnimirror:frame"]


def test_files_have_the_requested_name(tmp_path):
    om.write_rays(SENSOR, tmp_path / "a.npz", step=64)
    om.write_rays(SENSOR, tmp_path / "scene" / "cam.py", step=64, formats="blender")
    names = {str(p.relative_to(tmp_path)) for p in tmp_path.rglob("*") if p.is_file()}
    files = {"cam.py", "cam.osl", "cam-origin.exr", "cam-direction.exr"}
    assert names == {"a.npz", *(f"scene/{name}" for name in files)}


@pytest.mark.parametrize(
    ("path", "formats", "message"),
    [
        ("a.foo", None, "the suffix of a.foo must be one of .exr"),
        ("a", None, "formats must be given for the folder"),
        ("a.exr", ["npz"], "the suffix of npz files must be .npz; got a.exr"),
        ("a.exr", ["exr", "npz"], "specify a folder"),
        ("a", ["obj"], "formats must be from exr.*; got 'obj'"),
        ("a", [], "formats must contain at least one of exr"),
    ],
)
def test_invalid_requests_raise(tmp_path, path, formats, message):
    with pytest.raises(InvalidParameter, match=message):
        om.write_rays(SENSOR, tmp_path / path, formats=formats, step=64)
    assert not list(tmp_path.iterdir())


def test_an_error_leaves_no_files(tmp_path, monkeypatch):
    def fail(table, paths):
        paths[0].write_text("half")
        raise OmnimirrorError("the disk is full")

    formats = {**RAY_FORMATS, "npz": replace(RAY_FORMATS["npz"], write=fail)}
    with pytest.raises(OmnimirrorError, match="the disk is full"):
        write_formats(om.ray_table(SENSOR, 64), formats, "a", tmp_path, ["exr", "npz"])
    assert not [p for p in tmp_path.rglob("*") if p.is_file() or TEMPORARY_MARK in p.name]


def test_missing_package_raises_with_remedy(tmp_path):
    formats = {"exr": replace(RAY_FORMATS["exr"], packages=("no_such_package",))}
    with pytest.raises(
        OmnimirrorError, match=r"exr requires no_such_package: run pip install '\.\[interop\]'"
    ):
        write_formats(om.ray_table(SENSOR, 64), formats, "a", tmp_path / "a.exr", None)
