"""Plots of sensors and results on Matplotlib axes, public as ``om.plot``.

Each function draws on the axes ``ax`` or on those of a new figure of pyplot, and returns the axes.
Settings in ``matplotlib.rcParams`` that differ from the defaults of Matplotlib take precedence over
the style of the package. The figures of evaluations, reports and the gallery use the same drawing
functions (:mod:`omnimirror.analysis.figures`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, Literal, TypeAlias, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from ..analysis.figures import aperture, curves, sensor_diagrams
from ..analysis.figures.calibration_results import (
    coverage_map,
    residual_histograms,
    residual_vectors,
    residuals_by_image,
    residuals_by_radius,
)
from ..analysis.figures.style import pyplot_figures, styled
from ..analysis.figures.subjects import EXACT, Conditions, Subject, subjects_of
from ..analysis.psf_mtf import Mtf, Psf
from ..analysis.spot_diagrams import Spots
from ..base.arguments import choice, format_value, instance
from ..base.errors import InvalidParameter
from ..base.typing import Array
from ..calibration.estimation.calibration_result import Calibration
from ..manufacturing.tolerancing.charts import motion_curves, plot_tornado
from ..manufacturing.tolerancing.tolerance_analysis import ToleranceReport
from ..optics.sensor import Sensor

__all__ = [
    "blur",
    "calibration",
    "mapping",
    "mtf",
    "psf",
    "section",
    "spots",
    "tolerances",
    "viewpoints",
]

AxesLike: TypeAlias = Axes | Sequence[Axes] | NDArray[Any] | None
"""Axes of the caller: one, or one per panel in reading order; None for those of a new figure."""
PlotAxes: TypeAlias = Any
"""Axes, or an array (n,) of axes if there are several panels."""

# -- Axes ------------------------------------------------------------------------------------------


def _axes_of(ax: AxesLike) -> list[Axes] | None:
    """Return the axes of the caller as a list."""
    if ax is None:
        return None
    axes = [ax] if isinstance(ax, Axes) else list(np.asarray(ax, dtype=object).ravel())
    if not axes or not all(isinstance(each, Axes) for each in axes):
        raise InvalidParameter(
            f"ax must be matplotlib axes or an array of axes; got {format_value(ax)}"
        )
    return axes


def _plot(ax: AxesLike, style: str, function: Callable[[list[Axes] | None], Figure]) -> PlotAxes:
    """Draw on axes, or on those of a new figure of pyplot, and return them."""
    axes = _axes_of(ax)
    with styled(style), pyplot_figures():
        figure = function(axes)
    result_axes = axes or [each for each in figure.axes if each.get_label() != "<colorbar>"]
    return result_axes[0] if len(result_axes) == 1 else np.array(result_axes, dtype=object)


def _plot_curves(
    ax: AxesLike,
    style: str,
    subjects: list[Subject],
    all_panels: Callable[..., Figure],
    first_panel: Callable[..., Figure],
) -> PlotAxes:
    """Draw all panels, or the first one on single axes of the caller."""

    def draw(axes: list[Axes] | None) -> Figure:
        is_single = axes is not None and len(axes) == 1
        return (first_panel if is_single else all_panels)(subjects, axes)

    return _plot(ax, style, draw)


# -- Curves of sensors -----------------------------------------------------------------------------


def mapping(
    sensors: Sensor | Sequence[Sensor],
    ax: AxesLike = None,
    *,
    conditions: Conditions = EXACT,
    style: str = "paper",
) -> PlotAxes:
    """Plot the image height against the field angle, and its derivative.

    Parameters
    ----------
    sensors
        One to six sensors.
    ax
        Two axes, or one for the image height alone; by default two of a new figure.
    conditions
        Evaluation conditions; :data:`omnimirror.analysis.figures.PAPER` for those of the paper.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes or (2,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If the number of sensors or axes is wrong, or the style is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> ax = om.plot.mapping(om.load_sensor("paper-spherical"), ax=Figure().subplots())
    >>> ax.get_xlabel(), len(ax.get_lines())
    ('Field angle Ω (deg)', 1)
    """
    return _plot_curves(
        ax, style, _subjects(sensors, conditions), curves.mapping, curves.image_height
    )


def blur(
    sensors: Sensor | Sequence[Sensor],
    ax: AxesLike = None,
    *,
    conditions: Conditions = EXACT,
    style: str = "paper",
) -> PlotAxes:
    """Plot the tangential and sagittal blur against the field angle.

    Parameters
    ----------
    sensors
        One to six sensors.
    ax
        Three axes for the blur in pixels, in degrees, and its area, or one for the blur in pixels
        alone; by default three of a new figure.
    conditions, style
        As in :func:`mapping`.

    Returns
    -------
    Axes or (3,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        As in :func:`mapping`.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> om.plot.blur(om.load_sensor("paper-spherical"), ax=Figure().subplots()).get_ylabel()
    'Blur Δ$_t$, Δ$_s$ (px)'
    """
    return _plot_curves(
        ax, style, _subjects(sensors, conditions), curves.blur, curves.blur_in_pixels
    )


def viewpoints(
    sensors: Sensor | Sequence[Sensor],
    ax: AxesLike = None,
    *,
    conditions: Conditions = EXACT,
    style: str = "paper",
) -> PlotAxes:
    """Plot the height at which chief rays meet the axis against the field angle.

    Parameters
    ----------
    sensors
        One to six sensors.
    ax
        Axes; by default those of a new figure.
    conditions, style
        As in :func:`mapping`.

    Returns
    -------
    Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        As in :func:`mapping`.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> ax = om.plot.viewpoints(om.load_sensor("paper-spherical"), ax=Figure().subplots())
    >>> [line.get_gid() for line in ax.get_lines()]
    ['paper-spherical:viewpoint_z_mm']
    """
    subjects = _subjects(sensors, conditions)
    return _plot(ax, style, lambda axes: curves.viewpoints(subjects, axes))


def section(
    sensors: Sensor | Sequence[Sensor],
    ax: AxesLike = None,
    *,
    conditions: Conditions = EXACT,
    style: str = "paper",
) -> PlotAxes:
    """Plot cross-sections with chief rays, and close-ups with the virtual images.

    Parameters
    ----------
    sensors
        One to six sensors.
    ax
        Two axes for each sensor: all cross-sections, then all close-ups; or one for the
        cross-section of one sensor alone. By default those of a new figure.
    conditions, style
        As in :func:`mapping`.

    Returns
    -------
    Axes or (n,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        As in :func:`mapping`.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> om.plot.section(om.load_sensor("paper-spherical"), ax=Figure().subplots()).get_ylabel()
    'z (mm)'
    """
    subjects = _subjects(sensors, conditions)

    def draw(axes: list[Axes] | None) -> Figure:
        if axes is not None and len(axes) == len(subjects) == 1:
            return sensor_diagrams.cross_section(subjects[0], axes)
        return sensor_diagrams.ray_traces(subjects, axes)

    return _plot(ax, style, draw)


def _subjects(sensors: Sensor | Sequence[Sensor], conditions: Conditions) -> list[Subject]:
    instance("conditions", conditions, Conditions, "conditions of om.analysis.figures")
    listed = [sensors] if isinstance(sensors, Sensor) else sensors
    if not isinstance(listed, Iterable) or not all(isinstance(each, Sensor) for each in listed):
        raise InvalidParameter(
            f"sensors must be a sensor or a list of sensors; got {format_value(sensors)}"
        )
    return subjects_of(list(listed), conditions)


# -- Whole aperture --------------------------------------------------------------------------------


def spots(result: Spots, ax: AxesLike = None, *, style: str = "paper") -> PlotAxes:
    """Plot spot diagrams with pixel grid and Airy disc.

    Parameters
    ----------
    result
        Result of :func:`omnimirror.spots`.
    ax
        Axes, one per field angle and focus with one row per focus; by default those of a new
        figure.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes or (n,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If the result is of another type, the number of axes is wrong, or the style is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> result = om.spots(om.load_sensor("paper-spherical"), [90.0])
    >>> om.plot.spots(result, ax=Figure().subplots()).get_title(loc="left")
    '90°'
    """
    instance("result", result, Spots, "a result of om.spots")
    return _plot(ax, style, lambda axes: aperture.spot_matrix(result, axes))


def psf(result: Psf | Sequence[Psf], ax: AxesLike = None, *, style: str = "paper") -> PlotAxes:
    """Plot point-spread functions with logarithmic intensity.

    Parameters
    ----------
    result
        One or several results of :func:`omnimirror.psf`.
    ax
        Axes, one per PSF; by default those of a new figure.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes or (n,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If a result is of another type, the number of axes is wrong, or the style is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> result = om.psf(om.load_sensor("paper-spherical"), 90.0, kind="geometric")
    >>> om.plot.psf(result, ax=Figure().subplots()).get_title(loc="left")
    '90°'
    """
    results = [result] if isinstance(result, Psf) else list(result)
    if not results or not all(isinstance(each, Psf) for each in results):
        raise InvalidParameter(
            f"result must be a result of om.psf or a list of such results; got {format_value(result)}"
        )
    return _plot(ax, style, lambda axes: aperture.psf_images(results, axes))


def mtf(result: Mtf, ax: AxesLike = None, *, style: str = "paper") -> PlotAxes:
    """Plot the tangential and sagittal MTF against the spatial frequency.

    Parameters
    ----------
    result
        Result of :func:`omnimirror.mtf`.
    ax
        Axes; by default those of a new figure.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If the result is of another type, the number of axes is wrong, or the style is unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> result = om.mtf(om.load_sensor("paper-spherical"), [45.0, 90.0])
    >>> om.plot.mtf(result, ax=Figure().subplots()).get_ylabel()
    'MTF'
    """
    instance("result", result, Mtf, "a result of om.mtf")
    return _plot(ax, style, lambda axes: aperture.mtf_curves(result, axes))


# -- Tolerances ------------------------------------------------------------------------------------

ToleranceKind: TypeAlias = Literal["sensitivities", "motion"]


def tolerances(
    report: ToleranceReport,
    ax: AxesLike = None,
    *,
    kind: ToleranceKind = "sensitivities",
    style: str = "paper",
) -> PlotAxes:
    """Plot the result of a tolerance analysis.

    Parameters
    ----------
    report
        Result of :func:`omnimirror.tolerance`.
    ax
        Axes; by default those of a new figure.
    kind
        ``"sensitivities"``: image motion of each error at its tolerance; ``"motion"``: cumulative
        distribution of the image motion of the simulated sensors.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If the result is of another type, the number of axes is wrong, or the kind or style is
        unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> sensor = om.load_sensor("paper-spherical")
    >>> plan = om.TolerancePlan(om.Tolerances(sensor, {"mirror.tilt_x_deg": om.Tolerance(0.1)}), {"motion_px": 2.0})
    >>> report = om.tolerance(sensor, plan, trials=100)
    >>> om.plot.tolerances(report, ax=Figure().subplots()).get_xlabel()
    'maximum image motion, px'
    """
    instance("report", report, ToleranceReport, "a result of om.tolerance")
    choice("kind", kind, get_args(ToleranceKind))

    def draw(axes: list[Axes] | None) -> Figure:
        if kind == "motion":
            return motion_curves(report.statistics, axes)
        return plot_tornado(report.sensitivities, axes)

    return _plot(ax, style, draw)


# -- Calibration -----------------------------------------------------------------------------------

CalibrationKind: TypeAlias = Literal[
    "coverage", "residuals", "residuals-by-radius", "residuals-by-image", "residual-histograms"
]
CALIBRATION_KINDS: tuple[CalibrationKind, ...] = get_args(CalibrationKind)
SIGMA_GRID = (48, 36)
"""Columns and rows of the grid of the direction uncertainty."""


def calibration(
    result: Calibration,
    ax: AxesLike = None,
    *,
    kind: CalibrationKind = "residuals",
    style: str = "paper",
) -> PlotAxes:
    """Plot the result of a calibration.

    Parameters
    ----------
    result
        Result of :func:`omnimirror.calibrate_camera`.
    ax
        Axes: two for ``"residuals-by-radius"`` and ``"residual-histograms"``; by default those of
        a new figure.
    kind
        ``"coverage"``: detected corners over the uncertainty of directions; ``"residuals"``:
        residual vectors over the image; ``"residuals-by-radius"``, ``"residuals-by-image"`` and
        ``"residual-histograms"``.
    style
        ``"paper"`` or ``"slides"``.

    Returns
    -------
    Axes or (2,) array of Axes
        Axes of the plot.

    Raises
    ------
    InvalidParameter
        If the result is of another type, the number of axes is wrong, or the kind or style is
        unknown.

    Examples
    --------
    >>> import omnimirror as om
    >>> from matplotlib.figure import Figure
    >>> camera = om.Unified(xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480))
    >>> board = om.Board("chessboard", 11, 7, 30.0)
    >>> result = om.calibrate_camera(om.simulate_detections(camera, board, 4), board, model="unified")
    >>> om.plot.calibration(result, ax=Figure().subplots()).get_ylabel()
    'v (px)'
    """
    instance("result", result, Calibration, "a result of om.calibrate_camera")
    choice("kind", kind, CALIBRATION_KINDS)
    return _plot(ax, style, lambda axes: calibration_figure(result, kind, axes))


def calibration_figure(
    result: Calibration, kind: CalibrationKind, axes: Sequence[Axes] | None = None
) -> Figure:
    """Draw one kind of plot of a calibration, on axes or in a new figure without pyplot."""
    fit = result.adjustment
    visible = fit.visible
    pixels, residuals = fit.problem.stack.pixels[visible], fit.residuals[visible]
    size, coverage = fit.model.image_size, result.coverage
    with styled():
        if kind == "coverage":
            boards = [s.pixels for s in fit.observations]
            sigmas = direction_sigmas(result)
            return coverage_map(boards, size, coverage.centre_px, coverage.radii_px, sigmas, axes)
        if kind == "residuals":
            return residual_vectors(pixels, residuals, size, axes)
        if kind == "residuals-by-radius":
            offset = pixels - coverage.centre_px
            radius = np.hypot(*offset.T)
            outward = offset / np.maximum(radius, 1e-9)[:, None]
            radial = np.sum(residuals * outward, axis=1)
            across = residuals[:, 1] * outward[:, 0] - residuals[:, 0] * outward[:, 1]
            return residuals_by_radius(radius, radial, across, axes)
        if kind == "residuals-by-image":
            names = [s.name for s in fit.observations]
            return residuals_by_image(names, *_rms_by_image(result), axes)
        return residual_histograms(residuals, fit.noise_px, axes)


def direction_sigmas(result: Calibration) -> Array:
    """Return the standard deviation (deg) of directions on a grid (rows, columns) over the image;
    NaN outside the field."""
    width, height = result.model.image_size
    columns, rows = SIGMA_GRID
    u, v = np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows)
    rays = result.model.backproject(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    sigmas = np.full(len(rays.valid), np.nan)
    ahead = rays.directions[rays.valid] @ result.model.mount.rotation()
    sigmas[rays.valid] = result.direction_sigma_deg(ahead)
    return sigmas.reshape(rows, columns)


def _rms_by_image(result: Calibration) -> tuple[Array, Array]:
    """Return the RMS residual (px) of each image, fitted and held out."""
    fit = result.adjustment
    held_out = result.held_out.residuals if result.held_out else np.full_like(fit.residuals, np.nan)
    fitted, validated = (
        np.array(
            [np.sqrt(np.mean(np.sum(e[where] ** 2, axis=1))) for where in fit.problem.stack.slices]
        )
        for e in (fit.residuals, held_out)
    )
    return fitted, validated
