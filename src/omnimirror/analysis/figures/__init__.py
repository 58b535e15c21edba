"""Figures of the paper for any list of sensors."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ...base.errors import InvalidParameter
from ...base.logs import OnProgress
from ...optics.sensor import Sensor
from . import curves, image_plane, sensor_diagrams
from .image_plane import image_and_views
from .sensor_comparison import image_sheet, side_by_side, table_sheet
from .style import FORMATS, STYLES, render, save_figure, styled
from .subjects import EXACT, PAPER, Conditions, Subject, subjects_of

LOGGER = logging.getLogger(__name__)

__all__ = [
    "EXACT",
    "FIGURES",
    "PAPER",
    "STYLES",
    "Conditions",
    "FigureSpec",
    "draw",
    "image_and_views",
    "image_sheet",
    "render",
    "save_all",
    "save_figure",
    "side_by_side",
    "table_sheet",
]


@dataclass(frozen=True)
class FigureSpec:
    """Figure with its drawing function, title and caption."""

    name: str
    title: str
    caption: str
    function: Callable[[Sequence[Subject], Sequence[Axes] | None], Figure]


FIGURES: dict[str, FigureSpec] = {
    spec.name: spec
    for spec in (
        FigureSpec(
            "fig3",
            "Viewing sphere and its image",
            "Objects of 15° × 15° every 15° of incidence on the viewing sphere, and their images in the image circle.",
            image_plane.viewing_sphere,
        ),
        FigureSpec(
            "fig4",
            "Ray traces, virtual images and depth of field",
            "Cross-section with chief rays every 15°, and a close-up of the mirror. T∞, T5M: tangential images of "
            "objects at infinity and at five rim radii from the mirror; S∞, S5M: sagittal images. DF: depth of "
            "field about L0, with the F-number of the lens.",
            sensor_diagrams.ray_traces,
        ),
        FigureSpec(
            "fig5",
            "Image height and its rate of change",
            "Image height h (Eq. 7) and dh/dΩ (Eq. 8) against the incident angle.",
            curves.mapping,
        ),
        FigureSpec(
            "fig6",
            "Viewpoints",
            "Height above the mirror vertex at which the chief ray meets the axis (Eq. 6).",
            curves.viewpoints,
        ),
        FigureSpec(
            "fig7",
            "Image area and width-to-height ratio",
            "Area Δs = Δw Δh of the image of one square degree (Eq. 11), and its aspect Δw/Δh (Eq. 12).",
            curves.area_and_aspect,
        ),
        FigureSpec(
            "fig8",
            "Image-forming characteristics",
            "Each rectangle is the image of one square degree enlarged 15 times, at its "
            "position along the image radius.",
            image_plane.image_forming,
        ),
        FigureSpec(
            "fig9",
            "Blur",
            "Tangential (solid) and sagittal (dashed) blur for distant objects in pixels (a) and in the angle of "
            "the object (b), signed: positive beyond the focus. (c) Their product, the paper's blur area (solid), "
            "and the area with a pixel and the Airy disc added to each side (dotted).",
            curves.blur,
        ),
        FigureSpec(
            "fig10",
            "Blur in the image",
            "The rectangles of Fig. 8 with their blur spots, enlarged ten times in both directions.",
            image_plane.blur_in_image,
        ),
        FigureSpec(
            "fig11",
            "Blur in object space",
            "Squares of 15° × 15° in object space with their blur spots (vertical: tangential, horizontal: "
            "sagittal) and a square with the mean solid angle of a pixel, all enlarged ten times against the squares; "
            "spots larger than their square are cut. Below each square: tangential × sagittal blur in degrees.",
            image_plane.blur_in_object_space,
        ),
        FigureSpec(
            "fig12",
            "Influence of the lens on a spherical mirror",
            "Image area Δs of spherical mirrors with the same field in the same image "
            "circle, for rim viewing angles Θ from 12° down to 0 (orthographic: exactly "
            "equiareal).",
            curves.viewing_angle,
        ),
        FigureSpec(
            "fig15",
            "Error of assuming one viewpoint",
            "Image error for objects 7, 10, 20 and 40 rim radii M from the mirror, each "
            "with the viewpoint V0 of the smallest maximum error: distance in the image "
            "between the true position and that of the single-viewpoint model.",
            curves.viewpoint_error,
        ),
    )
}
"""Figures by name, in the order of the paper."""


def draw(
    name: str,
    sensors: Sequence[Sensor],
    conditions: Conditions = EXACT,
    *,
    ax: Axes | Sequence[Axes] | NDArray[Any] | None = None,
    style: str = "paper",
) -> Figure:
    """Draw one figure.

    Settings in ``matplotlib.rcParams`` that differ from the defaults of Matplotlib take precedence
    over the style.

    Parameters
    ----------
    name
        Key of :data:`FIGURES`.
    sensors
        One to six sensors; their names are used as labels, their order determines the colours.
    conditions
        :data:`EXACT`, or :data:`PAPER` for the method of the paper.
    ax
        Axes for the panels of the figure, in reading order; by default those of a new figure.
    style
        ``"paper"`` for a journal, or ``"slides"`` with larger text and lines.

    Returns
    -------
    matplotlib.figure.Figure
        New figure, or the figure of ``ax``.

    Raises
    ------
    InvalidParameter
        If the figure or style is unknown, or the number of sensors or axes is wrong.

    Examples
    --------
    >>> from omnimirror.optics.sensor_files import load_sensor
    >>> figure = draw("fig6", [load_sensor("paper-spherical")])
    >>> figure.axes[0].get_xlabel()
    'Field angle Ω (deg)'

    A panel of a larger figure:

    >>> from matplotlib.figure import Figure
    >>> left, right = Figure(figsize=(8, 3), layout="constrained").subplots(1, 2)
    >>> draw("fig6", [load_sensor("paper-spherical")], ax=right) is right.figure
    True
    """
    if name not in FIGURES:
        raise InvalidParameter(f"the figure must be one of {', '.join(FIGURES)}; got {name!r}")
    axes = (
        None
        if ax is None
        else [ax]
        if isinstance(ax, Axes)
        else list(np.asarray(ax, dtype=object).ravel())
    )
    with styled(style):
        return FIGURES[name].function(subjects_of(sensors, conditions), axes)


def save_all(
    sensors: Sequence[Sensor],
    out_dir: str | Path,
    formats: Sequence[str] = ("svg", "png"),
    names: Iterable[str] | None = None,
    conditions: Conditions = EXACT,
    on_progress: OnProgress | None = None,
    style: str = "paper",
) -> list[Path]:
    """Draw figures and write each in every format, as ``out_dir/fig5.svg`` and so on.

    Parameters
    ----------
    names
        Names of figures; by default all of them.
    on_progress
        Callback of the number of drawn figures and their total number.
    style
        Style as in :func:`draw`.

    Returns
    -------
    Written files, in the order of the figures.

    Raises
    ------
    InvalidParameter
        If a figure, format or style is unknown, or the number of sensors is wrong; raised before any file is written.
    OmnimirrorError
        If the file cannot be written.
    """
    selected = list(FIGURES) if names is None else list(dict.fromkeys(names))
    for valid, requested, noun in (
        (FIGURES, selected, "figure"),
        (FORMATS, formats, "format"),
        (STYLES, [style], "style"),
    ):
        if unknown := [a for a in requested if a not in valid]:
            raise InvalidParameter(
                f"the {noun} must be one of {', '.join(valid)}; got {unknown[0]!r}"
            )
    files = []
    for number, name in enumerate(selected, 1):
        LOGGER.info("%s", name)
        figure = draw(name, sensors, conditions, style=style)
        files += [save_figure(figure, Path(out_dir) / f"{name}.{kind}") for kind in formats]
        if on_progress is not None:
            on_progress(number, len(selected))
    return files
