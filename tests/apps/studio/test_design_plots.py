"""Plots as files and as differences, slider marks, and content of the first screen."""

from __future__ import annotations

import csv
import io
from xml.etree import ElementTree

import numpy as np
import pytest

import omnimirror as om

from .test_design_page import design_tab, enter_value, plot_values, sensor_on, wait_for_response  # noqa: F401


def saved_text(page, name: str) -> str:
    """Return the text of a file saved by the button of a plot."""
    with page.expect_download() as download:
        page.get_by_role("button", name=name).click()
    return download.value.path().read_text()


RECORD_ELEMENTS = """() => {
  window.made = [];
  const seen = (records) => {
    const added = records.flatMap((record) => [...record.addedNodes]);
    window.made.push(...added.filter((node) => node.nodeType === Node.ELEMENT_NODE).map((node) => node.tagName));
  };
  for (const place of document.querySelectorAll("#design .compare, #design .strip, #design .marks")) {
    new MutationObserver(seen).observe(place, { childList: true, subtree: true });
  }
}"""


def test_moving_slider_reuses_elements(design_tab):  # noqa: F811
    """New elements would require style and layout by the browser at every step."""
    enter_value(
        design_tab, "F-number", "4.1"
    )  # a pinned design, and a mark at the previous slider position
    before = design_tab.locator("#design .strip").first.inner_html()
    design_tab.evaluate(RECORD_ELEMENTS)
    for number in (4.2, 4.3, 4.4):
        enter_value(design_tab, "F-number", str(number))
    assert design_tab.evaluate("window.made") == []
    assert design_tab.locator("#design .strip").first.inner_html() != before


def test_differences_to_pinned_designs_are_plotted_and_saved(design_tab):  # noqa: F811
    first = sensor_on(design_tab)
    assert design_tab.get_by_label("Difference").is_hidden()
    design_tab.get_by_role("button", name="Pin", exact=True).click()
    enter_value(design_tab, "Focal length", "12")
    design_tab.locator(".compare tbody tr").nth(1).wait_for()
    design_tab.locator(".groups label").filter(has_text="Difference").click()
    omega, difference = plot_values(design_tab, "Image height")
    current, previous = (
        om.evaluate(s, np.minimum(omega, s.field_deg[1])) for s in (sensor_on(design_tab), first)
    )
    np.testing.assert_allclose(
        difference, current.h_px - previous.h_px, atol=2e-4 * current.h_px.max()
    )
    assert np.abs(difference).max() > 10
    rows = list(csv.DictReader(io.StringIO(saved_text(design_tab, "Save Image height as CSV"))))
    assert {row["design"] for row in rows} == {"design minus paper-spherical"}
    np.testing.assert_allclose([float(row["h_px"]) for row in rows], difference, rtol=1e-6)
    drawing = ElementTree.fromstring(saved_text(design_tab, "Save Blur in the image as SVG"))
    curves = [p for p in drawing.iter("{http://www.w3.org/2000/svg}path") if p.get("clip-path")]
    assert len(curves) == 2  # T and S
    assert len({p.get("stroke-dasharray") for p in curves}) == 2
    assert "Difference of blur in the image, px" in "".join(drawing.itertext())
    section = ElementTree.fromstring(saved_text(design_tab, "Save the cross-section as SVG"))
    strokes = {p.get("stroke") for p in section.iter("{http://www.w3.org/2000/svg}path")}
    assert "none" not in strokes  # also without the style sheet of the page
    design_tab.locator(".groups label").filter(has_text="Difference").click()
    assert len(plot_values(design_tab, "Image height")) == 3


def test_object_sizes_are_plotted_at_the_object_distance(design_tab):  # noqa: F811
    design_tab.locator(".groups label").filter(has_text="Object size").click()
    cylinder = design_tab.locator("figure.plot").filter(has_text="Object size on a cylinder, mm/px")
    assert cylinder.is_visible()
    assert np.isnan(
        plot_values(design_tab, "Object size on a cylinder")[1:]
    ).all()  # of objects at infinity
    design_tab.get_by_role("checkbox", name="At infinity").uncheck()
    enter_value(design_tab, "Object distance", "700")
    sensor = sensor_on(design_tab)
    for surface in ("plane", "cylinder"):
        omega, t, s = plot_values(design_tab, f"Object size on a {surface}")
        result = om.evaluate(
            sensor, np.minimum(omega, sensor.field_deg[1]), object_distance_mm=700.0
        )
        truth = getattr(result, f"{surface}_t_mm_per_px")
        is_finite = np.isfinite(t) & (np.abs(omega - 90) > 1)  # field angles are rounded to 32 bits
        np.testing.assert_allclose(t[is_finite], truth[is_finite], rtol=1e-4)
        np.testing.assert_allclose(s, result.object_s_mm_per_px, rtol=1e-5)
        range_ = design_tab.evaluate(
            "(title) => window.omnimirror.tabs.design.plotArea.charts.find((c) => c.chart.title === title).range",
            f"Object size on a {surface}",
        )
        assert range_[1] <= 8 * np.nanmedian(np.concatenate([t, s]))  # not that of the pole
    rows = list(
        csv.DictReader(io.StringIO(saved_text(design_tab, "Save Object size on a plane as CSV")))
    )
    assert {"plane_t_mm_per_px", "object_s_mm_per_px"} <= rows[0].keys()
    design_tab.locator(".groups label").filter(has_text="Object size").click()


@pytest.mark.full
def test_zero_difference_is_labelled_and_centred(design_tab):  # noqa: F811
    design_tab.get_by_role("button", name="Pin", exact=True).click()
    enter_value(design_tab, "F-number", "5.6")  # changes blur only
    design_tab.locator(".compare tbody tr").nth(1).wait_for()
    design_tab.locator(".groups label").filter(has_text="Difference").click()

    def plot(title: str):
        return design_tab.locator("figure.plot").filter(has_text=title)

    plot("Image height").get_by_text("identical to the pinned design").wait_for()
    plot("Blur in the image").get_by_text("current minus pinned").wait_for()
    _, difference = plot_values(design_tab, "Image height")
    np.testing.assert_allclose(difference, 0.0, atol=2e-3)
    drawing = ElementTree.fromstring(saved_text(design_tab, "Save Image height as SVG"))
    marks = [
        float(text.text.replace("\N{MINUS SIGN}", "-"))
        for text in drawing.iter("{http://www.w3.org/2000/svg}text")
        if text.text and text.get("text-anchor") == "end"
    ]
    assert min(marks) < 0 < max(marks)


OVERLAPPED_PLOTS = """() => {
  const { left, width, top, height } = document.querySelector("#notice").getBoundingClientRect();
  const points = Array.from({ length: 41 }, (_, i) => left + (width * (i + 0.5)) / 41);
  const below = points.flatMap((x) => document.elementsFromPoint(x, top + height / 2));
  return [...new Set(below.map((e) => e.closest("#design .plot")))].filter((plot) => plot)
    .map((plot) => plot.innerText);
}"""
"""Plots under the notice; plots that scroll are clipped above it."""


@pytest.mark.full
def test_search_result_is_compared_with_previous_design_without_overlap(design_tab):  # noqa: F811
    first = sensor_on(design_tab)
    design_tab.get_by_label("Minimise").select_option("worst_blur_deg")
    design_tab.get_by_label("Freeform surface").select_option("polynomial")
    design_tab.get_by_label("Coefficients", exact=True).fill("3")
    design_tab.get_by_label("Number of starts").fill("1")
    design_tab.get_by_role("button", name="Optimise").click()
    design_tab.locator("#notice", has_text="the previous design is pinned").wait_for()
    for width in (900, 1280, 2560):
        design_tab.set_viewport_size({"width": width, "height": 800})
        assert design_tab.locator("#notice").bounding_box()["height"] > 10
        assert design_tab.evaluate(OVERLAPPED_PLOTS) == []
    design_tab.locator(".compare tbody tr").nth(1).wait_for()
    wait_for_response(design_tab)
    assert not design_tab.get_by_role("checkbox", name="Difference").is_checked()
    design_tab.locator(".groups label").filter(has_text="Difference").click()
    assert design_tab.get_by_role("button", name="Unpin paper-spherical, before").is_visible()
    omega, difference = plot_values(design_tab, "Image height")
    current, previous = (
        om.evaluate(s, np.minimum(omega, s.field_deg[1])) for s in (sensor_on(design_tab), first)
    )
    np.testing.assert_allclose(
        difference, current.h_px - previous.h_px, atol=2e-4 * current.h_px.max()
    )
    assert np.abs(difference).max() > 1


def test_slider_marks_and_restores_initial_value(design_tab):  # noqa: F811
    field = design_tab.locator(".field").filter(
        has=design_tab.get_by_label("Focal length", exact=True)
    )
    reset = field.locator(".back")
    assert reset.is_hidden()
    first = sensor_on(design_tab)
    enter_value(design_tab, "Focal length", "15")
    low, high = (float(text) for text in field.locator(".ends span").all_inner_texts())
    share = np.log(first.lens.focal_length_mm / low) / np.log(high / low)
    position = field.locator(".marks .first").evaluate("(mark) => parseFloat(mark.style.left)")
    assert position == pytest.approx(100 * share, abs=0.5)
    reset.click()
    wait_for_response(design_tab)
    assert sensor_on(design_tab).lens == first.lens
    assert reset.is_hidden()
    f_number_field = design_tab.locator(".field").filter(
        has=design_tab.get_by_label("F-number", exact=True)
    )
    enter_value(design_tab, "F-number", "0.1")
    assert (
        f_number_field.locator(".marks .stop").count() == 1
        or f_number_field.locator(".problem").is_visible()
    )


@pytest.mark.parametrize(
    "pin_count", [1, *(pytest.param(count, marks=pytest.mark.full) for count in (0, 4))]
)
def test_all_curves_fit_on_first_screen(pin_count, design_tab):  # noqa: F811
    for number in range(pin_count):
        design_tab.get_by_role("button", name="Pin", exact=True).click()
        enter_value(design_tab, "Focal length", str(12 + number))
        design_tab.locator(".compare tbody tr").nth(number + 1).wait_for()
    bottoms = design_tab.evaluate(
        "[...document.querySelectorAll('#design .plot:not([hidden]):has(.chart)')].map((f) "
        "=> f.getBoundingClientRect().bottom)"
    )
    assert len(bottoms) == 8
    assert max(bottoms) <= 800


MOVED = """async (count) => {
  const { design: design_tab } = window.omnimirror.tabs;
  const slider = document.querySelector("#design input[type=range]");
  const start = Number(slider.value);
  const frame = () => new Promise((done) => requestAnimationFrame(done));
  for (let i = 0; i < count; i++) {
    const before = design_tab.latencies;
    slider.value = String(start + 0.02 * Math.sin(i + 1));
    slider.dispatchEvent(new Event("input", { bubbles: true }));
    while (design_tab.latencies === before) await frame();
    await frame();
  }
}"""


@pytest.mark.full
def test_slider_and_plots_cause_one_layout_each(design_tab):  # noqa: F811
    """A size query between two plots forces a layout, five times per change."""
    session = design_tab.context.new_cdp_session(design_tab)
    session.send("Performance.enable")

    def layouts() -> int:
        return next(
            m["value"]
            for m in session.send("Performance.getMetrics")["metrics"]
            if m["name"] == "LayoutCount"
        )

    design_tab.evaluate(MOVED, 5)
    before = layouts()
    design_tab.evaluate(MOVED, 20)
    assert layouts() - before <= 2 * 20 + 5
