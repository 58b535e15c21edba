"""Contents and drawings of notebook cards."""

from __future__ import annotations

import re
import subprocess
import sys
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.parameters import Uncertainty
from omnimirror.base.results import LINE_STYLES, Line, card, line_drawing
from omnimirror.cameras.camera import Mount
from omnimirror.optics.housing import CameraBody, Dome, Housing, Rod
from omnimirror.optics.mirrors import Sphere
from omnimirror.optics.mirrors.mirror import MirrorPose

SPHERE = om.load_sensor("paper-spherical")
SENSORS = {
    **{
        name: om.load_sensor(name)
        for name in ("paper-spherical", "folded-hyperboloidal", "paraboloid-telecentric")
    },
    "decentred": replace(SPHERE, mirror_pose=MirrorPose(1.5, -0.5, 0.0, 0.5, 1.0)),
    "dome": replace(SPHERE, housing=Housing(CameraBody(60.0), Rod(4.0), Dome())),
}
SIZE = (640, 480)
MODELS = {
    "ball": om.MirrorBall(
        centre_px=(319.5, 240.0), rim_radius_px=230.0, field_deg=340.0, image_size=SIZE
    ),
    "unified": om.Unified(
        xi=0.9, focal_px=(300.0, 290.0), centre_px=(319.5, 239.5), image_size=SIZE
    ),
    "kannala-brandt": om.KannalaBrandt(
        focal_px=(120.0, 118.0), centre_px=(310.0, 245.0), image_size=SIZE
    ),
    "fisheye": om.Unified(
        xi=0.5, focal_px=(200.0, 200.0), centre_px=(319.5, 239.5), image_size=SIZE, optics="fisheye"
    ),
}


def rows_of(html: str) -> dict[str, str]:
    """Return the table of a card, which is valid XML."""
    table = ElementTree.fromstring(html).find(".//table")
    return {row[0].text or "": row[1].text or "" for row in table}


def paths_of(html: str) -> list[np.ndarray]:
    """Return the polylines of a drawing, (n, 2) px, right and down."""
    paths = ElementTree.fromstring(html).iter("path")
    return [np.array(re.findall(r"[ML](\S+?) ([-\d.]+)", path.get("d")), float) for path in paths]


@pytest.mark.parametrize("name", SENSORS)
def test_sensor_properties(name):
    sensor = SENSORS[name]
    html = sensor._repr_html_()
    rows, nominal = rows_of(html), sensor.aligned()
    low, high = nominal.field_deg
    assert rows["Field"] == f"{low:.4g} to {high:.4g}° from the axis"
    assert float(rows["Image of the rim"].split()[0]) == pytest.approx(
        nominal.rim_radius_px, rel=1e-3
    )
    field = np.linspace(low, high, 2001)[1:]
    rate = om.evaluate(nominal, field).dh_domega_px_per_deg
    values = [float(text) for text in re.findall(r"[\d.]+", rows["Resolution"])]
    np.testing.assert_allclose(values, [rate.min(), rate.max()], rtol=0.01)
    assert ("Misaligned" in rows) == (name == "decentred")
    assert ("Obscuration" in rows) == (name in ("dome", "folded-hyperboloidal"))
    assert sensor.notes in ElementTree.fromstring(html).findall(".//div")[-1].text


def test_cross_section_is_to_scale_and_upright():
    up, down, level = (
        paths_of(replace(SPHERE, mount=Mount(orientation))._repr_html_())
        for orientation in ("up", "down", "forward")
    )
    mirror = up[0]
    wide, high = np.ptp(mirror, axis=0)
    assert high / wide == pytest.approx(float(SPHERE.mirror.sag(43.905)) / (2 * 43.905), rel=0.01)
    lens = up[1]
    scale = 2 * SPHERE.mirror.rim_radius_mm / wide
    assert scale * (lens[0, 1] - mirror[:, 1].max()) == pytest.approx(
        SPHERE.mirror_distance_mm, rel=0.01
    )
    assert (down[1][:, 1] < down[0][:, 1].min()).all()  # the lens above
    assert (level[1][:, 0] < level[0][:, 0].min()).all()  # upwards and to the left
    folded = paths_of(SENSORS["folded-hyperboloidal"]._repr_html_())
    assert (
        folded[0].mean(axis=0)[1] < folded[1].mean(axis=0)[1]
    )  # the upper mirror observes the lower half space


@pytest.mark.parametrize("name", MODELS)
def test_camera_parameters_and_field(name):
    camera = MODELS[name]
    html = camera._repr_html_()
    rows = rows_of(html)
    for p in camera.parameters[:6]:
        assert rows[p.name] == f"{p.value:.6g} {p.unit}"
    assert rows["Image"] == "{} × {} px".format(*camera.image_size)
    frame, *rings = paths_of(html)
    assert len(rings) >= 1
    width, height = np.ptp(frame, axis=0)
    assert width / height == pytest.approx(camera.image_size[0] / camera.image_size[1], rel=0.01)


def test_standard_deviations():
    ball = om.MirrorBall(
        centre_px=(511.5, 510.0), rim_radius_px=500.0, field_deg=340.0, image_size=(1024, 1024)
    )
    calibrated = replace(ball, uncertainty=Uncertainty(("cx",), ((0.04,),)))
    assert rows_of(calibrated._repr_html_())["cx"] == "511.5 ± 0.2 px"
    assert rows_of(ball._repr_html_())["cx"] == "511.5 px"
    assert "Calibrated parameters: 1, with covariance." in calibrated._repr_html_()
    ring = max(paths_of(ball._repr_html_())[1:], key=lambda path: np.ptp(path[:, 0]))
    frame = paths_of(ball._repr_html_())[0]
    assert np.ptp(ring[:, 0]) / np.ptp(frame[:, 0]) == pytest.approx(1000 / 1024, rel=0.01)


def test_invalid_sensor():
    concave = replace(SPHERE, mirror=Sphere(46.0, 45.9), mirror_distance_mm=20.0, name="<no>")
    rows = rows_of(concave._repr_html_())
    assert rows["Invalid"]
    assert "Field" not in rows
    assert "&lt;no&gt;" in concave._repr_html_()


def test_lines_are_interrupted_at_nan():
    x = np.array([0.0, 1.0, np.nan, 3.0, 4.0])
    drawing = line_drawing([Line(x, x, style) for style in LINE_STYLES], "one & two")
    (path, *_) = ElementTree.fromstring(drawing).findall("path")
    assert [step for step in path.get("d") if step.isalpha()] == ["M", "L", "M", "L"]
    assert line_drawing([], "nothing") == ""
    assert ElementTree.fromstring(card("a", "b", drawing, {}, "")) is not None


def test_cards_do_not_import_matplotlib():
    code = """
import sys, omnimirror as om
om.load_sensor("paper-spherical")._repr_html_()
print("matplotlib" in sys.modules)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.stdout.strip() == "False", run.stderr
