"""Report of a sensor as one self-contained page with images, figures and numbers; templates of all reports."""

from __future__ import annotations

import base64
import logging
from collections.abc import Callable
from pathlib import Path
from string import Template

import numpy as np

from ...analysis.evaluation import READ_COLUMNS, Evaluation, evaluate
from ...analysis.figures import FIGURES, draw, render
from ...analysis.focus import best_focus
from ...base.arguments import validate_arguments
from ...base.escaping import html_text, shell_word
from ...base.files import write_text
from ...base.logs import OnProgress
from ...base.quantities import QUANTITIES, describe_quantity
from ...dewarp import Dewarper, screens, views
from ...io import write_image
from ...optics.sensor import Sensor
from ...optics.tracing.obscuration import obscuration_summary
from ...simulation.rendering import SHOWN_SAMPLES, render_image
from ...simulation.scenes.room import Room

LOGGER = logging.getLogger(__name__)

# -- Page templates --------------------------------------------------------------------------------

TEMPLATES = Path(__file__).parent


def page_html(title: str, body: str, **parts: object) -> str:
    """Return a self-contained page from a named body template, filled with HTML fragments."""
    return _template("page").substitute(
        title=html_text(title), body=_template(body).substitute(parts)
    )


def figure_html(data: bytes, kind: str, caption: str, css: str = "") -> str:
    """Return an embedded image with its caption."""
    source = f"data:image/{kind};base64,{base64.b64encode(data).decode()}"
    text = html_text(caption)
    return f'<figure><img class="{css}" alt="{text}" src="{source}"><figcaption>{text}</figcaption></figure>'


def _template(name: str) -> Template:
    return Template((TEMPLATES / f"{name}.html").read_text(encoding="utf-8"))


# -- Sensor report ---------------------------------------------------------------------------------

VIEW = screens.Plane((960, 600))
StepCallback = Callable[[str, float], None]
"""Callback with the current step and the completed fraction of the total work."""
PERCENT = 100
"""Total of progress reports."""
RENDERING_FRACTION = 0.6  # fraction of the work spent on rendering
FIGURES_SHOWN = ("fig5", "fig7", "fig10", "fig4", "fig9", "fig6")
COLUMNS_SHOWN = [name for name in READ_COLUMNS if name not in ("blur_t_deg", "blur_s_deg")]


@validate_arguments
def write_demo(
    sensor: Sensor,
    folder: str | Path = "omnimirror-demo",
    *,
    blur: bool = True,
    on_progress: OnProgress | None = None,
) -> Path:
    """Evaluate a sensor, render its image of the bundled room, dewarp it to two views, and write a
    report.

    Implementation of ``omnimirror demo``.

    Parameters
    ----------
    sensor
        Sensor, for example from :func:`omnimirror.load_sensor`.
    folder
        Folder of all files.
    blur
        Whether to render through the whole lens aperture; applies to single-mirror sensors, images
        of two-mirror sensors are always sharp.
    on_progress
        Callback of the completed work and the total work, in percent. The logger ``omnimirror``
        reports the steps.

    Returns
    -------
    Path
        Report, ``report.html``. The same folder contains ``circle.png``, ``panorama.png``,
        ``view.png`` and ``evaluation.csv``.

    Raises
    ------
    OmnimirrorError
        If the sensor is not supported, or the folder cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> from dataclasses import replace
    >>> sensor = om.load_sensor("paper-spherical")
    >>> small = replace(sensor, imager=replace(sensor.imager, width_px=128, height_px=128, pixel_pitch_um=41.6))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     report = om.write_demo(small, folder, blur=False)
    ...     sorted(path.name for path in report.parent.iterdir())
    ['circle.png', 'evaluation.csv', 'panorama.png', 'report.html', 'view.png']
    """
    folder = Path(folder)
    result = evaluate(sensor)
    result.to_csv(folder / "evaluation.csv")  # first, to fail early if the folder is not writable

    def report(step: str, fraction: float) -> None:
        LOGGER.info("%s", step)
        if on_progress is not None:
            on_progress(round(PERCENT * fraction), PERCENT)

    report("Rendering the image", 0.0)
    circle = render_image(
        sensor,
        Room(),
        samples=SHOWN_SAMPLES,
        blur=blur and sensor.secondary is None,
        on_progress=lambda done, rows: report(
            "Rendering the image", RENDERING_FRACTION * done / rows
        ),
    )
    images = {
        "circle": circle,
        "panorama": Dewarper(sensor, views.panorama(sensor), interpolation="cubic")(circle),
        "view": Dewarper(sensor, VIEW, interpolation="cubic")(circle),
    }
    for name, image in images.items():
        write_image(folder / f"{name}.png", image)
    write_text(folder / "report.html", report_html(result, folder, report))
    return folder / "report.html"


def report_html(result: Evaluation, folder: Path, report: StepCallback) -> str:
    """Return the self-contained page with the images of ``folder``."""
    sensor = result.sensor
    lead = (sensor.notes.strip().splitlines() or [""])[0]
    return page_html(
        sensor.name,
        "sensor",
        heading=html_text(sensor.name),
        lead=html_text(lead),
        numbers=_numbers(result),
        images=_images(folder),
        figures=_figures(sensor, report),
        table=_table(result),
        commands=html_text(_commands(sensor.name)),
    )


def _numbers(result: Evaluation) -> str:
    sensor, best = result.sensor, best_focus(result.sensor)
    near, far = result.depth_of_field_mm
    low, high = sensor.field_deg
    solid_angle = (np.cos(np.radians(low)) - np.cos(np.radians(high))) / 2
    resolution, rate = QUANTITIES["dh_domega_px_per_deg"], result.dh_domega_px_per_deg
    area = QUANTITIES["worst_floored_area_deg2"]
    entries = {
        "Mirror": f"{sensor.mirror.KIND}, rim diameter {2 * sensor.mirror.rim_radius_mm:g} mm",
        "Field": f"{low:.3g} to {high:.4g}°, {100 * solid_angle:.0f} % of the sphere",
        "Image circle": f"diameter {2 * sensor.rim_radius_px:.0f} px",
        resolution.title: f"{rate.min():.2f} to {rate.max():.2f} {resolution.unit}",
        "Focus": f"{result.focus_mm:.1f} mm (minimum floored blur area: {best.focus_mm:.1f} mm)",
        "Depth of field": f"{near:.1f} to {far:.1f} mm",
        area.title: f"{area.text(result.floored_area_deg2.max())} {area.unit}",
        "Range of viewpoints": f"{np.ptp(result.viewpoint_z_mm):.3g} mm",
        "Obscured": obscuration_summary(sensor.obscurations, sensor.obscured_percent),
    }
    return "".join(
        f"<div><dt>{html_text(k)}</dt><dd>{html_text(v)}</dd></div>" for k, v in entries.items()
    )


def _images(folder: Path) -> str:
    panorama = _image(
        folder / "panorama.png",
        "Panorama of the whole field: 360° by the elevation range of the mirror.",
    )
    circle = _image(
        folder / "circle.png",
        "Image on the imager, of a room with signs on its walls; text is mirrored.",
    )
    view = _image(folder / "view.png", "Perspective view of the forward direction, 90° wide.")
    return f'{panorama}<div class="pair">{circle}{view}</div>'


def _image(path: Path, caption: str) -> str:
    return figure_html(path.read_bytes(), "png", caption)


def _figures(sensor: Sensor, report: StepCallback) -> str:
    """Return the figures: wide ones in a column, then the narrow ones in a row."""
    wide: list[str] = []
    upright: list[str] = []
    for i, name in enumerate(FIGURES_SHOWN):
        report(
            "Drawing figures",
            RENDERING_FRACTION + (1 - RENDERING_FRACTION) * i / len(FIGURES_SHOWN),
        )
        figure = draw(name, [sensor])
        column = wide if figure.get_figwidth() > 1.5 * figure.get_figheight() else upright
        column.append(
            figure_html(render(figure, "svg"), "svg+xml", FIGURES[name].title, css="plot")
        )
    return f'{"".join(wide)}<div class="columns">{"".join(upright)}</div>'


def _table(result: Evaluation) -> str:
    head = "".join(
        f'<th title="{html_text(describe_quantity(q))}">{html_text(q.heading)}'
        f"<small>{html_text(q.unit) or '&nbsp;'}</small></th>"
        for q in map(QUANTITIES.__getitem__, COLUMNS_SHOWN)
    )
    cells = result.texts(COLUMNS_SHOWN).values()
    rows = "".join(
        "<tr>" + "".join(f"<td>{c}</td>" for c in row) + "</tr>" for row in zip(*cells, strict=True)
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"


def _commands(name: str) -> str:
    sensor = shell_word(name)
    dewarp = f"omnimirror dewarp circle.png --sensor {sensor} --interpolation cubic --set image.transparent=false"
    width, height = VIEW.size
    return "\n".join(
        [
            f"omnimirror demo {sensor} -o .",
            f"omnimirror evaluate {sensor} --csv evaluation.csv",
            f"{dewarp} --view panorama -o panorama.png",
            f"{dewarp} --view perspective --hfov-deg {VIEW.hfov_deg:g} --size {width}x{height} -o view.png",
        ]
    )
