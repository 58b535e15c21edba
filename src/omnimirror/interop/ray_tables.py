"""Ray tables: origin, direction and weight of the ray of each pixel, for renderers.

Formats: OpenEXR and NumPy arrays, a custom camera of Blender Cycles in OSL, a sensor plug-in of
Mitsuba 3, and ray fields of NVIDIA Newton.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..base.arguments import instance, integer, validate_arguments
from ..base.errors import OutsideField
from ..base.escaping import c_string, escape_invisible, python_string
from ..base.results import Columns, Result, axis_columns, pixel_grid
from ..base.typing import Array
from ..cameras.camera import Camera, Rays
from ..io.exr import write_channels, write_exr
from ..optics.housing import NO_HOUSING
from ..optics.sensor import Sensor
from .export_formats import (
    Deviation,
    ExportedFiles,
    ExportFormat,
    ExportFormats,
    SourceCode,
    fill_template,
    format_registry,
    write_formats,
    write_script,
)

CHUNK_RAYS = 1 << 17
"""Rays traced at a time."""
FRAME = "x forward, y left, z up; right-handed; origin at the mirror's vertex"
BLENDER_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
"""Axes of a Cycles camera in the world frame: x right, y up, z along the optical axis."""
NEWTON_AXES = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Axes of a Newton camera in the world frame: x right, y up, -z along the optical axis (USD,
OpenGL)."""


@dataclass(frozen=True, repr=False)
class RayTable(Result):
    """Origin, direction and weight of the rays of a pixel grid.

    The frame is the world frame of the camera mount: x forward, y left, z up, in mm, with the
    origin at the mirror vertex (for a camera without a mirror, at its centre). Row i and column j
    belong to the pixel (j ``step``, i ``step``); integers are at pixel centres.

    Attributes
    ----------
    origins
        (rows, columns, 3) points on the mirror, or on the outer surface of a tube or dome, mm;
        0 without a ray.
    directions
        (rows, columns, 3) unit vectors towards the scene; 0 without a ray.
    weights
        (rows, columns) 1 for the scene, 0 outside the field and for obscured pixels.
    image_size
        (width, height) of the images, px.
    step
        Spacing of the sampled pixels, px.
    name
        Name of the camera.

    Examples
    --------
    >>> import omnimirror as om
    >>> table = om.ray_table(
    ...     om.Unified(xi=0.9, focal_px=(30.0, 30.0), centre_px=(31.5, 23.5), image_size=(64, 48))
    ... )
    >>> table, table.has_ray.all(), table.weights[24, 32]
    (RayTable(camera, 64 x 48 rays, step 1 px), np.True_, np.float64(1.0))
    """

    origins: Array
    directions: Array
    weights: Array
    image_size: tuple[int, int]
    step: int = 1
    name: str = "camera"

    def _table(self) -> Columns:
        width, height = self.size
        pixels = pixel_grid(self.step * np.arange(width), self.step * np.arange(height))
        rays = axis_columns("origin", self.origins, "_mm") | axis_columns(
            "direction", self.directions
        )
        return {**pixels, **rays, "weight": self.weights.ravel()}

    @property
    def size(self) -> tuple[int, int]:
        """(columns, rows)."""
        return self.weights.shape[1], self.weights.shape[0]

    @property
    def has_ray(self) -> NDArray[np.bool_]:
        """(rows, columns) True if there is a ray, obscured or not."""
        return np.asarray(self.directions.any(axis=-1))

    def __repr__(self) -> str:
        columns, rows = self.size
        return f"RayTable({self.name}, {columns} x {rows} rays, step {self.step} px)"


def ray_table(camera: Camera, step: int = 1) -> RayTable:
    """Trace the rays of the pixels of a camera.

    Parameters
    ----------
    camera
        Sensor, aligned or misaligned, or calibrated camera.
    step
        Spacing of the sampled pixels in both directions, px.

    Returns
    -------
    RayTable
        Origins in mm, directions and weights in the world frame of the camera mount.

    Raises
    ------
    InvalidParameter
        If ``step`` is not an integer between 1 and the smaller image side.
    OutsideField
        If no sampled pixel is inside the field.

    Examples
    --------
    >>> import omnimirror as om
    >>> table = om.ray_table(om.load_sensor("paper-spherical"), step=8)
    >>> table.size, int(table.weights.sum())
    ((128, 128), 12351)
    >>> table.origins[64, 96].round(2), table.directions[64, 96].round(3)  # right of the centre
    (array([-0.04, 20.07,  4.21]), array([-0.002,  0.805, -0.594]))
    """
    instance("camera", camera, Camera, "a camera (see om.load_sensor)")
    width, height = camera.image_size
    step = integer("step", step, 1, min(width, height))
    columns, rows = np.arange(0, width, step), np.arange(0, height, step)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2).astype(float)
    chunks = [_trace(camera, pixels[i : i + CHUNK_RAYS]) for i in range(0, len(pixels), CHUNK_RAYS)]
    origins, directions, weights = (np.concatenate(parts) for parts in zip(*chunks, strict=True))
    if not weights.any():
        raise OutsideField(
            f"all {len(columns)} x {len(rows)} sampled pixels are outside the field of the camera"
        )
    shape = len(rows), len(columns)
    return RayTable(
        origins.reshape(*shape, 3),
        directions.reshape(*shape, 3),
        weights.reshape(shape),
        (width, height),
        step,
        getattr(camera, "name", "camera"),
    )


def _trace(camera: Camera, pixels: Array) -> tuple[Array, Array, Array]:
    """Return origins, directions and weights of pixels (n, 2)."""
    rays = camera.backproject(pixels)
    weights = rays.valid.astype(float)
    if isinstance(camera, Sensor):
        weights[obscured_pixels(camera, pixels, rays)] = 0.0
    missing = ~rays.valid[:, None]
    return np.where(missing, 0.0, rays.origins), np.where(missing, 0.0, rays.directions), weights


def obscured_pixels(sensor: Sensor, pixels: Array, rays: Rays) -> NDArray[np.bool_]:
    """Return which pixels (n, 2) are obscured by a part of the sensor itself.

    Obscurations of two-mirror sensors are rings about the common axis, given by field angle.
    """
    obscured = np.zeros(len(pixels), bool)
    if sensor.secondary is None:
        if sensor.housing != NO_HOUSING:
            for mask in sensor.obscured_by(pixels).values():
                obscured |= mask
        return obscured
    with np.errstate(invalid="ignore"):  # NaN directions outside the field
        cosine = np.clip(rays.directions @ sensor.axis, -1.0, 1.0)
        omega_deg = np.degrees(np.arccos(cosine))
        for ring in sensor.obscured:
            low, high = ring.omega_deg
            obscured |= (omega_deg >= low) & (omega_deg <= high)
    return obscured


def interpolation_error_deg(table: RayTable) -> float:
    """Estimate the maximum direction error of bilinear interpolation in a table, deg.

    The mean of two neighbours two steps apart is compared with the direction between them. The
    error is quadratic in the step: the error at one step is a quarter of this difference.
    """
    d, total = table.directions, 0.0
    for ends, middle in (
        ((d[:, :-2], d[:, 2:]), d[:, 1:-1]),
        ((d[:-2], d[2:]), d[1:-1]),
    ):
        mean = ends[0] + ends[1]
        complete = ends[0].any(-1) & ends[1].any(-1) & middle.any(-1)
        sine = np.linalg.norm(np.cross(mean[complete], middle[complete]), axis=-1)
        if sine.size:
            total += float(np.degrees(np.arctan2(sine, 2.0)).max()) / 4
    return total


def _interpolation_deviation(table: RayTable) -> Deviation:
    """Return the deviation of programs that interpolate between the rays of a table."""
    error = interpolation_error_deg(table)
    return Deviation(error, "deg", "interpolation between rays")


def _rotated(table: RayTable, axes: Array) -> tuple[Array, Array]:
    """Return origins, mm, and directions in the frame whose axes are the rows of a rotation."""
    return table.origins @ axes.T, table.directions @ axes.T


# -- formats -------------------------------------------------------------------------------------


def exr_channels(table: RayTable) -> dict[str, NDArray[np.float32]]:
    """Return the OpenEXR channels (rows, columns) of a table by name."""
    layers = (("origin", table.origins), ("direction", table.directions))
    channels = {
        f"{layer}.{axis}": values[..., i]
        for layer, values in layers
        for i, axis in enumerate("XYZ")
    }
    channels["weight.Y"] = table.weights
    return {name: np.ascontiguousarray(values, np.float32) for name, values in channels.items()}


def exr_header(table: RayTable) -> dict[str, str | int]:
    """Return the header entries that define the channels."""
    width, height = table.image_size
    return {
        "omnimirror:camera": escape_invisible(table.name),
        "omnimirror:units": "origin in mm, direction of unit length, weight from 0 to 1",
        "omnimirror:frame": FRAME,
        "omnimirror:pixels": "row i, column j: pixel (j step, i step), integers at pixel centres",
        "omnimirror:step": table.step,
        "omnimirror:imageWidth": width,
        "omnimirror:imageHeight": height,
    }


def _write_exr(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    write_channels(paths[0], exr_channels(table), exr_header(table))
    return "{} x {} rays of 32-bit floats".format(*table.size), Deviation()


def _write_npz(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    np.savez_compressed(
        paths[0],
        origins_mm=table.origins,
        directions=table.directions,
        weights=table.weights,
        image_size_px=np.array(table.image_size),
        step_px=np.array(table.step),
        frame=np.array(FRAME),
        camera=np.array(table.name),
    )
    return "{} x {} rays of 64-bit floats".format(*table.size), Deviation()


def _write_newton(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write (rows, columns, 1, 2, 3) float32: origin, m, and direction of one sample per pixel."""
    origins, directions = _rotated(table, NEWTON_AXES)
    directions = directions * (table.weights > 0)[..., None]
    rays = np.stack([1e-3 * origins, directions], axis=2)[:, :, None]
    np.save(paths[0], rays.astype(np.float32))
    return "{} x {} rays in m; x right, y up, -z forward".format(*table.size), Deviation()


def _write_mitsuba(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    script, array = paths
    columns = [table.origins, table.directions, table.weights[..., None]]
    np.save(array, np.concatenate(columns, axis=-1).astype(np.float32))
    width, height = table.image_size
    text = fill_template(
        "mitsuba_sensor.py.in",
        width=width,
        height=height,
        step=table.step,
        rays=SourceCode(python_string(array.name)),
        camera=table.name,
    )
    write_script(script, text)
    description = "{} x {} rays and the sensor plug-in `omnimirror` (mm)".format(*table.size)
    return description, _interpolation_deviation(table)


def _write_blender(table: RayTable, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    """Write an OSL camera, its textures (m, camera frame) and a script that creates it."""
    script, shader, origin, direction = paths
    origins, directions = _rotated(table, BLENDER_AXES)
    origin_texture = np.concatenate([1e-3 * origins, table.weights[..., None]], axis=-1)
    direction_texture = np.concatenate([directions, table.has_ray[..., None]], axis=-1)
    write_exr(origin, origin_texture.astype(np.float32))
    write_exr(direction, direction_texture.astype(np.float32))
    width, height = table.image_size
    columns, rows = table.size
    strings = {
        "shader": shader.name,
        "origin": origin.name,
        "direction": direction.name,
        "name": table.name,
    }
    for path, quote in ((script, python_string), (shader, c_string)):
        literals = {key: SourceCode(quote(text)) for key, text in strings.items()}
        text = fill_template(
            f"blender_camera{path.suffix}.in",
            width=width,
            height=height,
            step=table.step,
            columns=columns,
            rows=rows,
            camera=table.name,
            **literals,
        )
        write_script(path, text)
    description = f"{columns} x {rows} rays, an OSL camera and a script that creates it"
    return description, _interpolation_deviation(table)


RAY_FORMATS: ExportFormats[RayTable] = format_registry(
    "omnimirror.ray_formats",
    "a format of ray tables",
    {
        "exr": ExportFormat(_write_exr, (".exr",), "programs that read OpenEXR", ("OpenEXR",)),
        "npz": ExportFormat(_write_npz, (".npz",), "NumPy"),
        "mitsuba": ExportFormat(_write_mitsuba, (".py", ".npy"), "Mitsuba 3"),
        "blender": ExportFormat(
            _write_blender,
            (".py", ".osl", "-origin.exr", "-direction.exr"),
            "Blender 4.5 and later, Cycles",
            ("OpenEXR",),
        ),
        "newton": ExportFormat(_write_newton, (".npy",), "NVIDIA Newton"),
    },
)
"""Formats of ray tables by name."""


@validate_arguments
def write_rays(
    camera: Camera,
    path: str | Path,
    *,
    formats: Iterable[str] | str | None = None,
    step: int = 1,
) -> list[ExportedFiles]:
    """Write the ray table of a camera for other programs: all files or none.

    Parameters
    ----------
    camera
        Sensor, aligned or misaligned, or calibrated camera.
    path
        Folder, or a file whose suffix selects the format (.exr or .npz) unless ``formats`` does.
    formats : optional
        Names from :data:`RAY_FORMATS`; required for a folder.
    step
        Spacing of the sampled pixels in both directions, px.

    Returns
    -------
    list of ExportedFiles
        Files, description and deviation of each format.

    Raises
    ------
    InvalidParameter
        If a format or suffix is unknown, or ``step`` is out of range.
    OutsideField
        If no sampled pixel is inside the field.
    OmnimirrorError
        If a package of ``omnimirror[interop]`` is missing or a file cannot be written.

    Examples
    --------
    >>> import tempfile, numpy as np, omnimirror as om
    >>> sensor = om.load_sensor("paper-spherical")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     (exported,) = om.write_rays(sensor, f"{folder}/rays.npz", step=16)
    ...     rays = np.load(exported.paths[0])
    >>> rays["origins_mm"].shape, str(exported.deviation)
    ((64, 64, 3), 'exact')
    """
    table = ray_table(camera, step)
    return write_formats(table, RAY_FORMATS, table.name, path, formats)
