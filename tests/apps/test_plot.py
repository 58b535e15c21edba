"""Plots on Matplotlib axes: axes of the caller and of pyplot, settings, and equality with figures."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib import pyplot
from matplotlib.figure import Figure

import omnimirror as om
from omnimirror.analysis import figures
from omnimirror.apps import plot
from omnimirror.apps.plot import CALIBRATION_KINDS
from omnimirror.apps.reports.calibration import calibration_figures
from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing.tolerancing.charts import curves, plot_tornado

SENSOR = om.load_sensor("paper-spherical")
SENSORS = [SENSOR, om.load_sensor("paper-hyperboloidal")]


@pytest.fixture(scope="module")
def results():
    camera = om.Unified(
        xi=0.95, focal_px=(160.0, 160.0), centre_px=(319.5, 239.5), image_size=(640, 480)
    )
    board = om.Board("chessboard", 11, 7, 30.0)
    detections = om.simulate_detections(camera, board, 4)
    errors = {"mirror.tilt_x_deg": om.Tolerance(0.1), "lens.focal_length_mm": om.Tolerance(0.02)}
    plan = om.TolerancePlan(om.Tolerances(SENSOR, errors), {"motion_px": 2.0})
    return {
        "mapping": SENSORS,
        "blur": SENSORS,
        "viewpoints": SENSORS,
        "section": SENSOR,
        "spots": om.spots(SENSOR, [45.0, 90.0]),
        "psf": om.psf(SENSOR, 90.0, kind="geometric"),
        "mtf": om.mtf(SENSOR, [45.0, 90.0]),
        "tolerances": om.tolerance(SENSOR, plan, trials=100),
        "calibration": om.calibrate_camera(detections, board, model="unified"),
    }


PANELS = {
    "mapping": 2,
    "blur": 3,
    "viewpoints": 1,
    "section": 2,
    "spots": 2,
    "psf": 1,
    "mtf": 1,
    "tolerances": 1,
    "calibration": 1,
}


@pytest.fixture(autouse=True)
def closed_figures():
    yield
    pyplot.close("all")


def test_all_functions_are_tested():
    assert sorted(PANELS) == sorted(plot.__all__)
    assert om.plot is plot


@pytest.mark.parametrize("name", PANELS)
def test_axes_of_caller_are_returned(results, name):
    figure = Figure()
    axes = np.atleast_1d(figure.subplots(1, PANELS[name]))
    drawn = getattr(om.plot, name)(results[name], ax=axes)
    np.testing.assert_array_equal(np.atleast_1d(drawn), axes)
    assert isinstance(drawn, mpl.axes.Axes) == (PANELS[name] == 1)
    assert all(ax.has_data() for ax in axes)
    assert pyplot.get_fignums() == []


@pytest.mark.parametrize("name", PANELS)
def test_new_figures_belong_to_pyplot(results, name):
    drawn = np.atleast_1d(getattr(om.plot, name)(results[name]))
    assert len(drawn) == PANELS[name]
    assert pyplot.gcf() is drawn[0].figure


@pytest.mark.parametrize("name", ["mapping", "blur", "section"])
def test_single_axes_show_first_panel(results, name):
    argument = results[name]
    alone = getattr(om.plot, name)(argument, ax=Figure().subplots())
    first = getattr(om.plot, name)(argument)[0]
    assert len(alone.get_lines()) == len(first.get_lines()) > 0
    for line, other in zip(alone.get_lines(), first.get_lines(), strict=True):
        np.testing.assert_array_equal(line.get_ydata(), other.get_ydata())


@pytest.mark.parametrize(
    ("name", "figure_name"),
    [("mapping", "fig5"), ("viewpoints", "fig6"), ("blur", "fig9"), ("section", "fig4")],
)
def test_plots_equal_figures(results, name, figure_name):
    sensors = results[name]
    figure = figures.draw(figure_name, sensors if isinstance(sensors, list) else [sensors])
    drawn = np.atleast_1d(getattr(om.plot, name)(sensors))
    for ax, other in zip(drawn, figure.axes, strict=True):
        assert (ax.get_title(loc="left"), ax.get_ylabel()) == (
            other.get_title(loc="left"),
            other.get_ylabel(),
        )
        for line, reference in zip(ax.get_lines(), other.get_lines(), strict=True):
            np.testing.assert_array_equal(line.get_ydata(), reference.get_ydata())


def test_changed_settings_take_precedence():
    with mpl.rc_context({"lines.linewidth": 3.3, "font.size": 14}):
        ax = om.plot.viewpoints(SENSORS)
        assert {line.get_linewidth() for line in ax.get_lines()} == {3.3}
        assert ax.xaxis.label.get_size() == 14
    assert {line.get_linewidth() for line in om.plot.viewpoints(SENSOR).get_lines()} == {1.2}


def test_slides_have_larger_text():
    sizes = [
        om.plot.viewpoints(SENSOR, style=s).xaxis.label.get_size() for s in ("paper", "slides")
    ]
    assert sizes == [7, 10]


@pytest.mark.parametrize("kind", CALIBRATION_KINDS)
def test_calibration_plots_equal_report(results, kind):
    drawn = np.atleast_1d(om.plot.calibration(results["calibration"], kind=kind))
    report = calibration_figures(results["calibration"])[kind]
    assert pyplot.fignum_exists(drawn[0].figure.number)
    for ax, other in zip(drawn, report.axes, strict=False):
        assert ax.get_xlabel() == other.get_xlabel()
        assert len(ax.get_children()) == len(other.get_children())


def test_tolerance_plots_equal_charts(results):
    report = results["tolerances"]
    bars = om.plot.tolerances(report, ax=Figure().subplots())
    (chart,) = plot_tornado(report.sensitivities).axes
    widths = [[patch.get_width() for patch in ax.patches] for ax in (bars, chart)]
    assert widths[0] == widths[1] != []
    motion = om.plot.tolerances(report, kind="motion")
    reference = curves(report.statistics).axes[0]
    for line, other in zip(motion.get_lines(), reference.get_lines(), strict=True):
        np.testing.assert_array_equal(line.get_xdata(), other.get_xdata())


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: om.plot.mapping(3), "sensors must be a sensor or a list of sensors; got 3"),
        (lambda: om.plot.mapping([]), "number of sensors in a figure must be 1 to 6; got 0"),
        (lambda: om.plot.viewpoints(SENSOR, ax=3), "ax must be matplotlib axes or an array"),
        (
            lambda: om.plot.mapping(SENSOR, ax=Figure().subplots(1, 3)),
            "ax must be an array of 2 axes, one for each panel of the figure; got 3",
        ),
        (lambda: om.plot.spots(SENSOR), "result must be a result of om.spots; got"),
        (lambda: om.plot.psf([]), "result must be a result of om.psf or a list"),
        (lambda: om.plot.viewpoints(SENSOR, style="poster"), "style must be one of paper, slides"),
    ],
)
def test_invalid_arguments_raise(call, message):
    with pytest.raises(InvalidParameter, match=message):
        call()


def test_unknown_kind_raises(results):
    with pytest.raises(InvalidParameter, match="kind must be one of sensitivities, motion"):
        om.plot.tolerances(results["tolerances"], kind="yield")
