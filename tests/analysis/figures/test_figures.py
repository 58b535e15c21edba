"""Figures of all sensors: contents against the analysis, and reproducible files."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from io import BytesIO
from itertools import pairwise

import cv2
import matplotlib as mpl
import numpy as np
import pytest
from click.testing import CliRunner
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Ellipse, Rectangle
from matplotlib.text import Text
from scipy.optimize import minimize

import omnimirror as om
from omnimirror.analysis import figures
from omnimirror.analysis.figures import FIGURES, PAPER, Conditions, draw, render, save_all
from omnimirror.analysis.figures.sensor_diagrams import ray_traces
from omnimirror.analysis.figures.style import (
    COLUMN,
    FORMATS,
    GREY,
    PAGE,
    PALETTE,
    STYLE,
    EndLabels,
    angle_axis,
    axis_label,
    axis_of_both,
    axis_title,
    bare,
    displayed_points,
    grid_of_axes,
    new_figure,
    panel_title,
    save_figure,
    separated_positions,
    styled,
    text_size,
    zero_line,
)
from omnimirror.analysis.figures.subjects import subjects_of
from omnimirror.apps.cli.commands.evaluate import command
from omnimirror.apps.reproduction import paper_sensors
from omnimirror.base.errors import InvalidParameter
from omnimirror.optics.housing import CameraBody, Housing, Rod
from omnimirror.optics.sensor_files import bundled_sensors
from tests.conftest import sensor_of
from tests.everyday import few

SENSORS = paper_sensors()


@cache
def drawn(name):
    """Return a figure of the three sensors with the conventions of the paper; must not be modified."""
    return draw(name, SENSORS, PAPER)


def line(figure, gid):
    """Return x and y of the line with a gid."""
    lines = [a for ax in figure.axes for a in ax.get_lines() if a.get_gid() == gid]
    assert len(lines) == 1, f"{gid}: {len(lines)} lines"
    return np.asarray(lines[0].get_xdata(), float), np.asarray(lines[0].get_ydata(), float)


def texts(figure):
    return [t.get_text() for ax in figure.axes for t in ax.texts]


@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("sensor", few(bundled_sensors(), "folded-hyperboloidal"))
def test_figures_of_all_bundled_sensors(name, sensor):
    assert draw(name, [om.load_sensor(sensor)]).axes  # the next test also renders them


@pytest.mark.parametrize("name", few(FIGURES, "fig5", "fig8", "fig11"))
def test_figures_of_cone_and_six_sensors(name):
    """A cone has a pointed apex, a hole in its image and no tangential image of distant objects."""
    render(
        draw(
            name,
            [
                sensor_of("cone"),
                sensor_of("ellipsoid"),
                *SENSORS,
                sensor_of("sphere", "orthographic"),
            ],
        )
    )


@pytest.mark.parametrize(
    ("figure", "column"),
    few(
        [
            ("fig5", "h_px"),
            ("fig5", "dh_domega_px_per_deg"),
            ("fig6", "viewpoint_z_mm"),
            ("fig7", "area_px2"),
            ("fig7", "aspect"),
            ("fig9", "blur_t_px"),
            ("fig9", "blur_s_px"),
            ("fig9", "blur_t_deg"),
            ("fig9", "blur_s_deg"),
            ("fig9", "floored_area_deg2"),
        ],
        ("fig5", "h_px"),
        ("fig5", "dh_domega_px_per_deg"),
        ("fig6", "viewpoint_z_mm"),
        ("fig7", "area_px2"),
        ("fig7", "aspect"),
    ),
)
def test_lines_match_evaluation_columns(figure, column):
    drawing = drawn(figure)
    for sensor in SENSORS:
        omega, y = line(drawing, f"{sensor.name}:{column}")
        result = om.evaluate(sensor, omega, mode="paper", image_radius_px=500)
        np.testing.assert_array_equal(y, getattr(result, column))
        assert omega[0] == 0
        assert omega[-1] == pytest.approx(135, abs=0.01)


def test_figure_4_virtual_images_and_depth_of_field():
    figure = drawn("fig4")
    for sensor in SENSORS:
        omega = np.linspace(*sensor.field_deg, 361)
        for name, distance in (("∞", np.inf), ("5M", 5 * sensor.mirror.rim_radius_mm)):
            result = om.evaluate(sensor, omega, object_distance_mm=distance)
            for orientation in "TS":
                x, z = line(figure, f"{sensor.name}:{orientation}{name}")
                np.testing.assert_allclose(
                    x, getattr(result, f"image_{orientation.lower()}_x_mm"), rtol=1e-12
                )
                np.testing.assert_allclose(
                    z, getattr(result, f"image_{orientation.lower()}_z_mm"), rtol=1e-12
                )
        bands = [
            p
            for ax in figure.axes
            for p in ax.patches
            if p.get_gid() == f"{sensor.name}:depth-of-field"
        ]
        near, far = om.evaluate(sensor, mode="paper").depth_of_field_mm
        assert [b.get_height() for b in bands] == pytest.approx([far - near] * 2)
        assert bands[0].get_y() == pytest.approx(near - sensor.mirror_distance_mm)


def test_figure_4_rays_obey_law_of_reflection():
    figure = draw("fig4", SENSORS[:1])
    (xs, x, foot), (zs, z, lens) = line(figure, "SPH:ray:75")
    slope = SENSORS[0].mirror.slope(x)
    normal = np.array([slope, -1]) / np.hypot(slope, 1)
    to_object, to_lens = (
        v / np.linalg.norm(v) for v in (np.array([xs - x, zs - z]), np.array([foot - x, lens - z]))
    )
    assert to_object @ normal == pytest.approx(to_lens @ normal, abs=1e-9)
    assert lens == -SENSORS[0].mirror_distance_mm


def test_figure_8_rectangle_size():
    figure = drawn("fig8")
    result = om.evaluate(SENSORS[0], [90.0], image_radius_px=500)
    (patch,) = [
        p
        for p in figure.axes[0].patches
        if isinstance(p, Rectangle) and p.get_gid() == "SPH:rectangle:90"
    ]
    assert patch.get_width() == pytest.approx(15 * result.dh_domega_px_per_deg[0])
    assert patch.get_height() == pytest.approx(15 * result.width_px_per_deg[0])
    assert patch.get_x() + patch.get_width() / 2 == pytest.approx(result.h_px[0])


def test_figure_11_spot_magnification():
    figure = drawn("fig11")
    result = om.evaluate(SENSORS[0], [90.0], mode="paper", image_radius_px=500)
    (spot,) = [
        p for p in figure.axes[0].patches if isinstance(p, Ellipse) and p.get_gid() == "SPH:spot:90"
    ]
    assert spot.height == pytest.approx(10 * abs(result.blur_t_deg[0]))
    assert spot.width == pytest.approx(10 * abs(result.blur_s_deg[0]))
    assert "(0.212°)²" in texts(figure)


def test_tangential_and_sagittal_line_labels():
    assert {"SPH T", "SPH S", "E-DI T", "E-DI S", "SVP T, S"} <= set(texts(drawn("fig9")))


def test_sensor_colours_consistent():
    for name in ("fig5", "fig6", "fig9"):
        lines = [a for ax in drawn(name).axes for a in ax.get_lines() if a.get_gid()]
        for i, sensor in enumerate(SENSORS):
            assert {a.get_color() for a in lines if a.get_gid().startswith(f"{sensor.name}:")} == {
                PALETTE[i]
            }


@pytest.mark.parametrize("name", few(["fig5", "fig7", "fig9", "fig12", "fig15"], "fig7", "fig12"))
def test_end_labels_do_not_overlap(name):
    figure = drawn(name)
    figure.draw_without_rendering()
    for ax in figure.axes:
        labels = [t for t in ax.texts if getattr(t, "arrow_patch", None) is not None]
        boxes = sorted((Text.get_window_extent(t) for t in labels), key=lambda b: b.y0)
        for below, above in pairwise(boxes):
            assert above.y0 >= below.y0 + 0.8 * below.height


@pytest.mark.parametrize("name", few(["fig3", "fig9"], "fig3"))
def test_figure_files_deterministic(name):
    first, second = (render(draw(name, SENSORS[:1]), "svg") for _ in range(2))
    assert first == second
    assert b"<text" in first  # text is stored as text
    assert not re.search(rb"<dc:date>", first)


def test_drawing_preserves_matplotlib_state():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    draw("fig5", SENSORS)
    assert dict(mpl.rcParams) == before


def test_save_all_writes_returned_files(tmp_path):
    progress = []
    files = save_all(
        SENSORS[:1],
        tmp_path / "new",
        names=["fig6", "fig5"],
        on_progress=lambda *n: progress.append(n),
    )
    assert [f.name for f in files] == ["fig6.svg", "fig6.png", "fig5.svg", "fig5.png"]
    assert sorted(p.name for p in (tmp_path / "new").iterdir()) == sorted(f.name for f in files)
    assert progress == [(1, 2), (2, 2)]


def test_save_all_validates_before_writing(tmp_path):
    with pytest.raises(InvalidParameter, match=r"must be one of fig3.*fig99"):
        save_all(SENSORS, tmp_path, names=["fig5", "fig99"])
    with pytest.raises(InvalidParameter, match=r"must be one of svg.*'gif'"):
        save_all(SENSORS, tmp_path, formats=["gif"])
    with pytest.raises(InvalidParameter, match="1 to 6"):
        draw("fig5", [])
    with pytest.raises(InvalidParameter, match=r"format of a figure must be one of svg.*; got gif"):
        save_figure(drawn("fig6"), tmp_path / "a.gif")
    assert list(tmp_path.iterdir()) == []


def test_special_characters_in_names():
    render(draw("fig5", [replace(s, name=f"{s.name} $_{{<&") for s in SENSORS[:2]]), "svg")


@pytest.mark.parametrize("seed", range(5))
def test_separated_positions_constraints(seed):
    rng = np.random.default_rng(seed)
    targets = rng.uniform(0, 10, 8)
    positions = separated_positions(targets, 0.9, 0.0, 10.0)
    order = np.argsort(targets)
    assert (np.diff(positions[order]) >= 0.9 - 1e-9).all()
    assert positions.min() >= 0
    assert positions.max() <= 10


def test_separated_positions_least_squares():
    """Compared with a general solver of the same problem."""
    rng = np.random.default_rng(3)
    for gap, low, high in ((0.9, 0.0, 10.0), (1.6, -2.0, 7.0), (0.0, 0.0, 10.0)):
        targets = np.sort(rng.uniform(-1, 11, 6))
        optimum = minimize(
            lambda positions, targets=targets: np.sum((positions - targets) ** 2),
            np.linspace(low, high, 6),
            jac=lambda positions, targets=targets: 2 * (positions - targets),
            bounds=[(low, high)] * 6,
            constraints={
                "type": "ineq",
                "fun": lambda positions, gap=gap: np.diff(positions) - gap,
            },
            method="SLSQP",
            options={"ftol": 1e-12},
        )
        np.testing.assert_allclose(
            separated_positions(targets, gap, low, high), optimum.x, atol=1e-5
        )


@pytest.mark.parametrize(
    ("targets", "expected"),
    [
        ([], []),
        ([5.0], [5.0]),
        ([-5.0], [0.0]),
        ([12.0], [10.0]),
        ([9.0, 1.0], [9.0, 1.0]),
        ([4.0, 4.0], [3.5, 4.5]),
        ([5.0, 5.0, 5.0], [4.0, 5.0, 6.0]),
        ([9.9, 10.0], [9.0, 10.0]),
        ([0.0] * 21, np.linspace(0, 10, 21)),
    ],
)
def test_separated_positions_few_labels(targets, expected):
    """Single, in reverse order, at equal positions, at the edge, and more than fit."""
    np.testing.assert_allclose(separated_positions(targets, 1.0, 0.0, 10.0), expected, atol=1e-12)


def test_end_labels_at_last_visible_point():
    """Without neighbours, a label is level with its point, in the colour of its line, 7 pt from the
    axes."""
    figure = Figure(dpi=144)
    ax = figure.subplots()
    ax.set(xlim=(4.0, 0.0), ylim=(0.0, 10.0))
    x = np.arange(6.0)
    curve, outside = (ax.plot(x, y, color=c)[0] for y, c in ((2 * x + 1, "red"), (x + 20, "blue")))
    assert displayed_points(ax, curve).tolist() == [True] * 5 + [False]
    assert not displayed_points(ax, outside).any()
    edges = ax.plot(
        [2.0, 2.0, 2.0, 2.0, 0.0, 4.0, -0.1, 4.1], [0.0, -0.1, 10.0, 10.1, 5.0, 5.0, 5.0, 5.0]
    )[0]
    assert displayed_points(ax, edges).tolist() == [
        True,
        False,
        True,
        False,
        True,
        True,
        False,
        False,
    ]
    labels = EndLabels(figure)
    labels.of_line(ax, curve, "up")
    labels.of_line(ax, outside, "outside")
    labels.at(ax, 1.0, 2.0, "at", "green")
    assert labels.settle() is figure
    figure.draw_without_rendering()
    assert [(t.get_text(), t.get_color(), t.xy) for t in ax.texts] == [
        ("up", "red", (4.0, 9.0)),
        ("at", "green", (1.0, 2.0)),
    ]
    for text in ax.texts:
        box = Text.get_window_extent(text)
        level = ax.transData.transform(text.xy)[1]
        assert (box.y0 + box.y1) / 2 == pytest.approx(level, abs=box.height / 4)
        assert box.x0 - ax.get_window_extent().x1 == pytest.approx(14.0, abs=0.5)
        assert text.get_fontsize() == text_size(6.5)
        # the leader line starts at the centre of the left edge of the label, with Matplotlib's
        # padding of 2 pt and 0.5 pt, and ends 1 pt before the point; 1 pt is 2 px
        start, end = text.arrow_patch.get_path().vertices[[0, -1]]
        point, edge = ax.transData.transform(text.xy), np.array([box.x0, (box.y0 + box.y1) / 2])
        direction = (point - edge) / np.hypot(*(point - edge))
        np.testing.assert_allclose(end, point - 2.0 * direction, atol=0.05)
        np.testing.assert_allclose(
            start, edge + (4.0 / abs(direction[0]) + 1.0) * direction, atol=0.05
        )
        assert text.arrow_patch.get_linewidth() == 0.4
        assert text.get_annotation_clip() is False  # drawn beyond the axes
    labels.at(ax, 1.0, 2.0, "again", "green")
    figure.draw_without_rendering()
    levels = [Text.get_window_extent(t).y0 for t in ax.texts[1:]]
    assert abs(levels[1] - levels[0]) == pytest.approx(1.18 * text_size(6.5) * 2, rel=0.01)


def test_end_labels_follow_layout():
    """A limit or size changed after the placement moves labels with their points."""
    figure = Figure(dpi=72)
    axes = figure.subplots(2, 1)
    labels = EndLabels(figure, size=9.0)
    for ax in axes:
        ax.set_ylim(0.0, 10.0)
        labels.of_line(ax, ax.plot([0.0, 1.0], [3.0, 4.0], color="red")[0], "end")
    labels.settle()
    figure.set_size_inches(3.0, 9.0)
    axes[0].set_ylim(-10.0, 10.0)
    figure.draw_without_rendering()
    for ax in axes:
        (text,) = ax.texts
        box = Text.get_window_extent(text)
        assert text.get_fontsize() == 9.0
        assert (box.y0 + box.y1) / 2 == pytest.approx(
            ax.transData.transform((1.0, 4.0))[1], abs=box.height / 4
        )
        assert box.x0 - ax.get_window_extent().x1 == pytest.approx(7.0, abs=0.5)
        assert box.x1 < figure.bbox.x1


@pytest.mark.parametrize(
    ("label", "text"),
    [
        (axis_label("distance_t_mm"), "L$_t$ (mm)"),
        (axis_label("h_px", titled=True), "Image height h (px)"),
        (axis_label("aspect"), "Δw/Δh"),
        (axis_title("blur_area_deg2"), "Blur area (deg²)"),
        (axis_title("aspect"), "Aspect"),
        (axis_of_both("blur_px", "blur_t_px", "blur_s_px"), "Blur Δ$_t$, Δ$_s$ (px)"),
    ],
)
def test_axis_labels_contain_symbols_and_units(label, text):
    assert label == text


def test_style_of_sizes_and_lines():
    """Widths of journal columns (88 and 183 mm); sizes in pt."""
    assert pytest.approx((88 / 25.4, 183 / 25.4), abs=0.005) == (COLUMN, PAGE)
    with styled():
        figure = new_figure(COLUMN, 2.0)
        ax = figure.subplots()
        ax.set(title="title", xlabel="x", ylabel="y")
        (curve,) = ax.plot([0.0, 1.0], [0.0, 1.0])
        zero_line(ax)
        free = figure.text(0.5, 0.5, "text")
        figure.draw_without_rendering()
    assert figure.get_size_inches().tolist() == [COLUMN, 2.0]
    assert (free.get_fontsize(), ax.xaxis.label.get_fontsize()) == (7.0, 7.0)
    assert ax.yaxis.label.get_fontsize() == 7.0
    title = ax.title if ax.title.get_text() else ax._left_title
    assert (title.get_text(), title.get_fontsize()) == ("title", 7.5)
    for axis in (ax.xaxis, ax.yaxis):
        tick = axis.get_major_ticks()[0]
        assert tick.label1.get_fontsize() == 6.5
        assert (tick.tick1line.get_markersize(), tick.tick1line.get_markeredgewidth()) == (2.5, 0.5)
        assert (tick.gridline.get_visible(), tick.gridline.get_linewidth()) == (True, 0.5)
    assert ax.get_axisbelow() is True
    assert curve.get_linewidth() == 1.2
    zero = ax.get_lines()[1]
    assert list(zero.get_ydata()) == [0.0, 0.0]
    assert (zero.get_color(), zero.get_linewidth(), zero.get_zorder()) == (GREY, 0.5, 1)
    edges = {name: spine.get_visible() for name, spine in ax.spines.items()}
    assert edges == {"left": True, "bottom": True, "top": False, "right": False}
    assert {spine.get_linewidth() for spine in ax.spines.values()} == {0.5}
    paddings = figure.get_layout_engine().get()
    assert (paddings["h_pad"], paddings["w_pad"]) == (0.04, 0.04)  # about 1 mm


def test_style_of_paths_and_signs():
    """Points of lines are not merged, a minus is U+2212, images have 200 dpi."""
    with styled():
        figure = new_figure(1.0, 1.0)
        ax = figure.subplots()
        ax.plot(np.linspace(-1.0, 1.0, 500), np.linspace(-1.0, 1.0, 500), gid="line")
        ax.set_xticks([-1.0, 1.0])
    svg = render(figure).decode()
    (path,) = re.findall(r'<g id="line">\s*<path d="([^"]*)"', svg)
    assert path.count("L") == 499
    assert "\u2212" in svg
    assert cv2.imdecode(np.frombuffer(render(figure, "png"), np.uint8), 0).shape == (200, 200)
    assert figure.dpi == 100


def test_style_of_text_measurements():
    """Matplotlib writes vector files at its fixed resolution, pixels at the one of the style."""
    dpi = {kind: get_registered_canvas_class(kind).fixed_dpi for kind in ("svg", "pdf")}
    assert {**dpi, "png": STYLE["savefig.dpi"]} == FORMATS


@pytest.mark.parametrize("kind", FORMATS)
def test_style_of_figures_without_layout_is_restored(kind, monkeypatch):
    """Resolution, canvas and layout are those of the figure, also after an error."""
    for figure in (Figure(dpi=50), new_figure(2.0, 1.0)):
        before = figure.dpi, figure.canvas, figure.get_layout_engine()
        figure.subplots()
        assert len(render(figure, kind)) > 100
        assert (figure.dpi, figure.canvas, figure.get_layout_engine()) == before
        with monkeypatch.context() as patch:
            patch.setattr(
                get_registered_canvas_class(kind), f"print_{kind}", lambda *_, **__: 1 / 0
            )
            with pytest.raises(ZeroDivisionError):
                render(figure, kind)
        assert (figure.dpi, figure.canvas, figure.get_layout_engine()) == before
    for unknown in ("gif", ""):
        with pytest.raises(InvalidParameter, match=f"of svg, png, pdf; got {unknown or 'none'}$"):
            render(Figure(), unknown)


@pytest.mark.parametrize(
    ("high", "step", "count"),
    [
        (3.5, 1, 4), (10.0, 1, 11), (10.1, 5, 3), (50.0, 5, 11), (50.1, 15, 4), (104.9999, 15, 8),
        (134.9, 15, 9), (150.0, 15, 11), (150.1, 30, 6), (300.0, 30, 11), (300.1, 45, 7),
    ],
)  # fmt: skip
def test_style_of_angle_axes(high, step, count):
    """At most 10 steps of a round angle; the end may be missed by rounding."""
    ax = Figure().subplots()
    angle_axis(ax, high)
    assert ax.get_xticks().tolist() == [step * i for i in range(count)]
    assert ax.get_xlim() == (0.0, max(high, step * (count - 1)))
    assert ax.get_xlabel() == axis_label("omega_deg", titled=True)


def test_style_of_panels():
    figure = Figure()
    axes = grid_of_axes(figure, 2, 3, 4)
    assert figure.axes == axes
    cells = [
        (ax.get_subplotspec().rowspan.start, ax.get_subplotspec().colspan.start) for ax in axes
    ]
    assert cells == [(0, 0), (0, 1), (0, 2), (1, 0)]
    (single,) = grid_of_axes(Figure(), 1, 1, 1)
    for ax, args, title in (
        (axes[0], (0, "A"), "(a) A"),
        (axes[1], (1, "B", 2), "(b) B"),
        (single, (0, "C", 1), "C"),
    ):
        panel_title(ax, *args)
        assert ax.get_title() == title
    bare(single)
    assert not single.axison
    assert single.get_aspect() == 1.0


def test_figures_use_evaluation_conditions():
    """Every option that changes numbers changes the lines of the figure accordingly."""
    requests = {
        "object_distance_mm": 50.0,
        "mode": "paper",
        "image_radius_px": 500,
        "wavelength_nm": 850.0,
    }
    sensor = om.load_sensor("paper-spherical")
    result = om.evaluate(sensor, [0.0, 90.0], tolerance_px=2.0, **requests)
    figure = draw("fig9", [sensor], Conditions.of(result))
    for column in ("blur_t_px", "blur_s_px", "blur_t_deg", "floored_area_deg2"):
        omega, values = line(figure, f"{sensor.name}:{column}")
        np.testing.assert_allclose(
            values, getattr(om.evaluate(sensor, omega, **requests), column), rtol=1e-12
        )
    assert "±2 px" in texts(figure)
    assert "objects at 50 mm" in figure.axes[0].get_title(loc="left")
    close_up = draw("fig4", [sensor], Conditions.of(result))
    near = om.evaluate(sensor, np.linspace(*sensor.field_deg, 361), **requests)
    np.testing.assert_allclose(
        line(close_up, f"{sensor.name}:T50mm")[1], near.distance_t_mm - 180.429, rtol=1e-9
    )


def test_command_figures_match_table(tmp_path, monkeypatch):
    results = []
    monkeypatch.setattr(
        figures, "save_all", lambda sensors, folder, conditions: results.append(conditions) or []
    )
    options = (
        "--set blur.mode=paper --set blur.image_radius_px=500 --object-distance-mm 50 "
        "--set light.wavelength_nm=850 --set blur.tolerance_px=2"
    )
    run = CliRunner().invoke(command, ["paper-spherical", *options.split(), "-o", str(tmp_path)])
    assert run.exit_code == 0, run.output
    assert results == [Conditions("paper", 500.0, 50.0, 850.0, 2.0)]


@pytest.fixture(scope="module")
def obscured():
    """One of the three sensors with camera and rod obscuring the centre."""
    return replace(SENSORS[0], housing=Housing(CameraBody(60.0), Rod(4.0)))


@pytest.mark.parametrize("name", few(["fig5", "fig6", "fig7", "fig9", "fig15"], "fig5"))
def test_obscured_angles_drawn_as_band(name, obscured):
    (ring,) = obscured.obscured
    for ax in draw(name, [obscured]).axes:
        (band,) = [p for p in ax.patches if p.get_gid() == f"{obscured.name}:hidden"]
        box = band.get_extents().transformed(ax.transData.inverted())
        np.testing.assert_allclose([box.x0, box.x1], ring.omega_deg, atol=1e-6)


@pytest.mark.parametrize("name", few(["fig3", "fig8", "fig10"], "fig8"))
def test_obscured_image_region_drawn_as_ring(name, obscured):
    (ring,) = obscured.obscured
    edge = float(om.evaluate(obscured, [ring.omega_deg[1]]).h_px[0])
    (patch,) = [
        p
        for ax in draw(name, [obscured]).axes
        for p in ax.patches
        if p.get_gid() == f"{obscured.name}:hidden"
    ]
    box = patch.get_extents().transformed(patch.axes.transData.inverted())
    np.testing.assert_allclose(
        [box.x0, box.x1], [-edge if name == "fig3" else 0.0, edge], rtol=1e-3, atol=1e-6
    )


def test_obscured_spots_labelled(obscured):
    assert [t for t in texts(draw("fig11", [obscured])) if "obscured" in t] == [
        "0°, obscured",
        "15°, obscured",
    ]


@pytest.mark.parametrize("name", few(FIGURES, "fig5", "fig11"))
def test_no_obscuration_drawn_without_housing(name):
    assert not [t for t in texts(drawn(name)) if "obscured" in t]


@pytest.mark.parametrize("kind", few(FORMATS, "pdf"))
def test_figure_rendered_once(kind, monkeypatch):
    sensors, file, draws = [om.load_sensor("paper-spherical")], BytesIO(), []
    undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}, "png": {}}[kind]
    with styled():
        draw("fig5", sensors).savefig(file, format=kind, metadata=undated)
    layouts, layout = [], ConstrainedLayoutEngine.execute
    monkeypatch.setattr(
        ConstrainedLayoutEngine,
        "execute",
        lambda self, figure: layouts.append(figure) or layout(self, figure),
    )
    figure, draw_figure = draw("fig5", sensors), Figure.draw
    monkeypatch.setattr(
        Figure, "draw", lambda self, renderer: draws.append(self) or draw_figure(self, renderer)
    )
    assert render(figure, kind) == file.getvalue()
    assert draws == layouts == [figure]
    assert figure.get_layout_engine() is not None  # for the next format


@pytest.mark.parametrize(
    "names", [["paper-hyperboloidal"], ["paper-spherical", "paper-equidistant"]]
)
def test_ray_trace_labels_not_clipped(names):
    with styled():
        figure = ray_traces(subjects_of([om.load_sensor(name) for name in names], Conditions()))
        figure.get_layout_engine().execute(figure)
        boxes = [ax.get_tightbbox(figure.canvas.get_renderer()) for ax in figure.axes]
    assert min(box.x0 for box in boxes) >= 0
    assert max(box.x1 for box in boxes) <= figure.bbox.width


# -- Axes and settings of the caller ---------------------------------------------------------------

PANELS = {"fig3": 2, "fig4": 2, "fig5": 2, "fig7": 2, "fig9": 3}


@pytest.mark.parametrize("name", figures.FIGURES)
def test_figures_in_axes_of_the_caller(name):
    sensors = [om.load_sensor("paper-spherical")]
    figure_axes = figures.draw(name, sensors)
    count = PANELS.get(name, 1)
    assert len(figure_axes.axes) == count
    figure = Figure(figsize=(9, 6), layout="constrained")
    cells = figure.subplots(2, count, squeeze=False)
    layout = figure.get_layout_engine()
    target = cells[1] if count > 1 else cells[1, 0]
    assert figures.draw(name, sensors, ax=target) is figure
    assert figure.get_layout_engine() is layout
    assert len(figure.axes) == 2 * count
    for ax, reference in zip(cells[1], figure_axes.axes, strict=True):
        lines = [line.get_xydata() for line in ax.get_lines()]
        for curve, expected in zip(lines, reference.get_lines(), strict=True):
            np.testing.assert_array_equal(curve, expected.get_xydata())
        assert [t.get_text() for t in ax.texts] == [t.get_text() for t in reference.texts]
    assert not any(ax.lines or ax.texts for ax in cells[0])
    with pytest.raises(om.OmnimirrorError, match=rf"ax must be .*{count} ax.*; got {count + 1}"):
        figures.draw(name, sensors, ax=Figure().subplots(1, count + 1))


def test_figures_retain_settings_of_the_caller():
    sensors = [om.load_sensor("paper-spherical")]
    with mpl.rc_context({"font.size": 14, "lines.linewidth": 3.0}):
        figure = figures.draw("fig6", sensors)
    (ax,) = figure.axes
    (line, *_) = ax.get_lines()
    assert line.get_linewidth() == 3.0
    assert ax.xaxis.label.get_size() == 14.0  # twice that of the style
    assert ax.texts[0].get_size() == 13.0
    assert ax.spines["left"].get_linewidth() == STYLE["axes.linewidth"]


def test_slides_have_larger_text_and_lines():
    sensors = [om.load_sensor("paper-spherical")]
    paper, slides = (figures.draw("fig5", sensors, style=style) for style in figures.STYLES)
    for small, large in zip(paper.axes, slides.axes, strict=True):
        ratio = large.xaxis.label.get_size() / small.xaxis.label.get_size()
        assert ratio == pytest.approx(10 / 7)
        assert large.texts[-1].get_size() / small.texts[-1].get_size() == pytest.approx(10 / 7)
        assert large.get_lines()[0].get_linewidth() > small.get_lines()[0].get_linewidth()
    with pytest.raises(om.OmnimirrorError, match="style must be one of paper, slides; got 'web'"):
        figures.draw("fig5", sensors, style="web")
