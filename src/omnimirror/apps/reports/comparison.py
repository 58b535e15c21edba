"""Comparison of sensors as one page or one image: table, curves, and rendered images of the same
room."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from matplotlib import image
from numpy.typing import NDArray

from ...analysis.comparison import Comparison
from ...analysis.figures import image_sheet, render, side_by_side, table_sheet
from ...base.arguments import validate_arguments
from ...base.errors import InvalidParameter
from ...base.escaping import html_text, shell_command
from ...base.files import write_text
from ...dewarp import Dewarper, views
from ...dewarp.view_geometry import field_of
from ...io import write_image
from ...io.images import encoded
from ...optics.sensor import Sensor
from ...simulation.rendering import SHOWN_SAMPLES, render_image
from ...simulation.scenes.room import Room
from ...simulation.scenes.scene import Scene
from . import figure_html, page_html

PANORAMA_PX = 1440  # width of each panorama


class RenderedImages(NamedTuple):
    """Rendered images of one scene by each sensor, (rows, columns, 3) uint8 in RGB order."""

    circles: list[NDArray[Any]]
    panoramas: list[NDArray[Any]]


@validate_arguments
def write_comparison(comparison: Comparison, path: str | Path, scene: Scene | None = None) -> Path:
    """Write a comparison as one self-contained page (``.html``) or one image (``.png``).

    Parameters
    ----------
    comparison
        Result of :func:`omnimirror.compare`.
    path
        Output file with the suffix .html or .png.
    scene
        Scene to be rendered for each sensor; the bundled room by default.

    Returns
    -------
    Path
        Path of the file.

    Raises
    ------
    InvalidParameter
        If the suffix is not supported; raised before any computation.
    OmnimirrorError
        If the sensor is not supported, or the file cannot be written.

    Examples
    --------
    >>> import omnimirror as om, tempfile
    >>> from dataclasses import replace
    >>> names = ("paper-spherical", "paper-hyperboloidal")
    >>> sensors = [om.load_sensor(name) for name in names]
    >>> small = [replace(s, imager=replace(s.imager, width_px=64, height_px=64, pixel_pitch_um=83.2)) for s in sensors]
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     om.write_comparison(om.compare(small), f"{folder}/both.html").name
    'both.html'
    """
    path = Path(path)
    kind = path.suffix.lower()
    if kind not in (".html", ".png"):
        raise InvalidParameter(f"path must have the suffix .html or .png; got {path.name}")
    images = render_images(comparison, Room() if scene is None else scene)
    if kind == ".html":
        write_text(path, comparison_html(comparison, images))
    else:
        write_image(path, comparison_sheet(comparison, images))
    return path


def render_images(comparison: Comparison, scene: Scene) -> RenderedImages:
    """Render the scene with each sensor, with panoramas over the union of their elevation ranges."""
    fields = [field_of(s) for s in comparison.sensors]
    elevations = min(f.tilt_min_deg for f in fields), max(f.tilt_max_deg for f in fields)
    circles, panoramas = [], []
    for sensor in comparison.sensors:
        circle = render_image(sensor, scene, samples=SHOWN_SAMPLES)
        view = views.panorama(sensor, (PANORAMA_PX, None), elevation_deg=elevations)
        circles.append(circle)
        panoramas.append(Dewarper(sensor, view, interpolation="cubic")(circle))
    return RenderedImages(circles, panoramas)


def comparison_html(comparison: Comparison, images: RenderedImages) -> str:
    """Return the self-contained page."""
    title = " · ".join(comparison.names)
    return page_html(
        title,
        "comparison",
        heading=html_text(title),
        count=len(comparison.sensors),
        table=_table(comparison),
        curves=figure_html(
            render(side_by_side(_aligned_sensors(comparison)), "svg"),
            "svg+xml",
            "Distant objects, each sensor at the focus of its file. Dots are lenses; thin "
            "lines connect them to the rim of the mirror.",
            css="plot",
        ),
        circles="".join(
            _image_figure(p, n) for p, n in zip(images.circles, comparison.names, strict=True)
        ),
        panoramas="".join(
            _image_figure(p, n) for p, n in zip(images.panoramas, comparison.names, strict=True)
        ),
        command=html_text(
            shell_command(["omnimirror", "compare", *comparison.names, "-o", "comparison.html"])
        ),
    )


def comparison_sheet(comparison: Comparison, images: RenderedImages) -> NDArray[np.uint8]:
    """Return the comparison as one tall image (rows, columns, 3) in RGB order."""
    lines = [[r.quantity.title, r.quantity.unit, *r.texts] for r in comparison.rows]
    figures = (
        table_sheet(comparison.names, lines, [r.best for r in comparison.rows]),
        side_by_side(_aligned_sensors(comparison)),
        image_sheet(comparison.names, images.circles, images.panoramas),
    )
    sheets = [image.imread(BytesIO(render(f, "png")), format="png")[..., :3] for f in figures]
    return np.round(255 * np.concatenate(sheets)).astype(np.uint8)


def _aligned_sensors(comparison: Comparison) -> list[Sensor]:
    """Return the sensors without misalignment; their curves over the field angle apply to all
    azimuths."""
    return [sensor.aligned() for sensor in comparison.sensors]


def _table(comparison: Comparison) -> str:
    names = "".join(f"<th>{html_text(n)}</th>" for n in comparison.names)
    rows = []
    for row in comparison.rows:
        cells = "".join(
            f'<td class="best">{html_text(text)}</td>' if best else f"<td>{html_text(text)}</td>"
            for text, best in zip(row.texts, row.best, strict=True)
        )
        q = row.quantity
        head = f'<th title="{html_text(q.meaning)}">{html_text(q.title)} <small>{html_text(q.unit)}</small></th>'
        rows.append(f"<tr>{head}{cells}</tr>")
    return f"<table><thead><tr><th></th>{names}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _image_figure(image: NDArray[Any], name: str) -> str:
    return figure_html(encoded(image, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, 90]), "jpeg", name)
