"""STEP files, read by OpenCASCADE: points of the face, volume, and header."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scipy.integrate import quad

from omnimirror.base.errors import InvalidParameter
from omnimirror.manufacturing import Body
from omnimirror.manufacturing.formats.step import write_step
from omnimirror.optics.mirrors import Hyperboloid
from tests.conftest import MIRRORS
from tests.everyday import few

BODIES = {
    "plain": Body(),
    "tapped, with flange": Body(8.0, thread="M6", bore_depth_mm=12.0, flange_width_mm=4.0),
    "through": Body(bore_diameter_mm=6.0, bore_depth_mm=np.inf),
}


def read(path):
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.STEPControl import STEPControl_Reader

    reader = STEPControl_Reader()
    assert reader.ReadFile(str(path)) == IFSelect_ReturnStatus.IFSelect_RetDone
    reader.TransferRoots()
    return reader.OneShape()


def faces(shape):
    """Return surface type and points (n, 3) of each face."""
    from OCP.BRep import BRep_Tool
    from OCP.BRepTools import BRepTools
    from OCP.TopAbs import TopAbs_ShapeEnum
    from OCP.TopExp import TopExp_Explorer
    from OCP.TopoDS import TopoDS

    explorer = TopExp_Explorer(shape, TopAbs_ShapeEnum.TopAbs_FACE)
    while explorer.More():
        face = TopoDS.Face(explorer.Current())
        surface = BRep_Tool.Surface_s(face)
        u0, u1, v0, v1 = BRepTools.UVBounds_s(face)
        grid = [
            surface.Value(float(u), float(v))
            for u in np.linspace(u0, u1, 17)
            for v in np.linspace(v0, v1, 101)
        ]
        yield type(surface).__name__, np.array([[p.X(), p.Y(), p.Z()] for p in grid])
        explorer.Next()


def volume(shape):
    from OCP.BRepGProp import BRepGProp
    from OCP.GProp import GProp_GProps

    properties = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, properties, 1e-10)
    return properties.Mass()


def exact_volume(mirror, body):
    """Integrate the volume by shells, with a conical drill point."""
    back = float(mirror.sag(mirror.rim_radius_mm)) + body.thickness_mm
    start, outer = body.start_mm(), mirror.rim_radius_mm + body.flange_width_mm
    shells, _ = quad(
        lambda x: 2 * np.pi * x * (back - float(mirror.sag(x))),
        start,
        mirror.rim_radius_mm,
        epsrel=1e-11,
    )
    flange = np.pi * (outer**2 - mirror.rim_radius_mm**2) * body.flange_thickness_mm
    r = body.bore_mm / 2
    bore = (
        0.0
        if start or not r
        else np.pi * r**2 * (body.bore_depth_mm + r / np.tan(np.radians(59)) / 3)
    )
    return shells + flange - bore


@pytest.mark.parametrize("body", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("kind", few(sorted(MIRRORS), "cone", "sampled"))
def test_solid_is_closed_and_its_face_matches_the_mirror(kind, body, tmp_path):
    from OCP.BRepCheck import BRepCheck_Analyzer

    mirror, _ = MIRRORS[kind]
    curve = write_step(tmp_path / "mirror.step", mirror, body, kind)
    shape = read(tmp_path / "mirror.step")
    assert BRepCheck_Analyzer(shape).IsValid()
    slack = 1e-3 * curve.deviation_um * 3 * np.pi * mirror.rim_radius_mm**2
    assert volume(shape) == pytest.approx(exact_volume(mirror, body), rel=1e-8, abs=slack)

    deviations = []
    for name, points in faces(shape):
        r = np.hypot(points[:, 0], points[:, 1])
        if r.max() > mirror.rim_radius_mm * (1 + 1e-9):
            continue
        z, slope, _ = mirror.profile(np.minimum(r, mirror.rim_radius_mm))
        distance_um = 1e3 * np.abs(points[:, 2] - z) / np.sqrt(1 + slope**2)
        if distance_um.max() < 1:
            deviations.append((name, r, distance_um.max()))
    ((name, r, worst),) = deviations
    assert worst <= max(1.02 * curve.deviation_um, 1e-5)  # the file holds 13 digits
    assert worst < 0.01
    assert r.min() == pytest.approx(body.start_mm(), abs=1e-9)
    assert r.max() == pytest.approx(mirror.rim_radius_mm, abs=1e-9)
    expected = {"sphere": "Geom_SphericalSurface", "cone": "Geom_ConicalSurface"}
    assert name == expected.get(kind, "Geom_SurfaceOfRevolution")


@pytest.mark.parametrize("kind", ["hyperboloid", "paraboloid", "ellipsoid"])
def test_conic_arc_satisfies_its_equation(kind, tmp_path):
    mirror, _ = MIRRORS[kind]
    curve = write_step(tmp_path / "mirror.step", mirror, Body(), kind)
    assert (curve.deviation_um, curve.degree, len(curve.poles)) == (0.0, 2, 3)
    assert (
        "RATIONAL_B_SPLINE_CURVE" in (tmp_path / "mirror.step").read_text() or kind == "paraboloid"
    )
    _, points = next(
        f for f in faces(read(tmp_path / "mirror.step")) if f[0] == "Geom_SurfaceOfRevolution"
    )
    x2, z = points[:, 0] ** 2 + points[:, 1] ** 2, points[:, 2]
    R, k = mirror.vertex_radius, mirror.conic
    np.testing.assert_allclose(x2 - 2 * R * z + (1 + k) * z**2, 0, atol=1e-8)


def test_file_header_states_content_and_deviation(tmp_path, capfd):
    mirror, _ = MIRRORS["equidistant"]
    curve = write_step(tmp_path / "mirror.step", mirror, BODIES["tapped, with flange"], "my mirror")
    text = (tmp_path / "mirror.step").read_text()
    head = re.sub(r"\s+", " ", text[: text.index("ENDSEC")].replace("'\n  +'", ""))
    assert f"within {curve.deviation_um:.2g} um of the mirror" in head
    assert "M6 12 mm deep" in head
    assert "'my mirror'" in head
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    assert capfd.readouterr() == ("", "")  # OpenCASCADE would otherwise print its messages


@pytest.mark.parametrize(
    ("body", "advice"),
    [
        ({"bore_diameter_mm": 5.0, "bore_depth_mm": 54.0}, "use at most 53.19"),
        ({"bore_diameter_mm": 90.0}, "less than the mirror diameter 87.8"),
        ({"thread": "M6", "bore_diameter_mm": 5.0}, "bore_diameter_mm must not be given"),
        ({"thread": "M7"}, "thread must be one of"),
        ({"flange_width_mm": 2.0, "flange_thickness_mm": 6.0}, "at most thickness_mm = 5"),
        ({"thickness_mm": -1.0}, "thickness_mm must be between 0.001 and 10000 mm; got -1"),
    ],
)
def test_invalid_body_is_rejected_with_advice(body, advice):
    mirror: Hyperboloid = MIRRORS["hyperboloid"][0]
    with pytest.raises(InvalidParameter, match=re.escape(advice)):
        Body(**body).outline(mirror)


def test_suggested_bore_depth_is_valid():
    Body(bore_diameter_mm=5.0, bore_depth_mm=53.19).outline(MIRRORS["hyperboloid"][0])
