"""STEP: exact solid of a mirror, its meridian (circle, conic, line or spline) revolved about the
axis.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...base.escaping import step_string
from ...optics.mirrors import Mirror
from ..body import Body
from ..surface_approximation import ProfileCurve, profile_curve


def solid_of(mirror: Mirror, body: Body) -> tuple[Any, ProfileCurve]:
    """Create the solid, a ``TopoDS_Shape`` in mm in the mirror frame, and the curve of its surface.

    The half-section in the plane y = 0 is revolved about z.
    """
    from OCP.BRepBuilderAPI import (
        BRepBuilderAPI_MakeEdge,
        BRepBuilderAPI_MakeFace,
        BRepBuilderAPI_MakeWire,
    )
    from OCP.BRepPrimAPI import BRepPrimAPI_MakeRevol
    from OCP.gp import gp

    curve = profile_curve(mirror, body.start_mm())
    corners = [_point(x, z) for x, z in body.outline(mirror)]
    wire = BRepBuilderAPI_MakeWire(_edge(curve))
    for start, end in pairwise(corners):
        wire.Add(BRepBuilderAPI_MakeEdge(start, end).Edge())
    face = BRepBuilderAPI_MakeFace(wire.Wire(), True).Face()
    return BRepPrimAPI_MakeRevol(face, gp.OZ_s()).Shape(), curve


def write_step(path: Path, mirror: Mirror, body: Body, name: str) -> ProfileCurve:
    """Write the solid; the file description states the deviation of its surface.

    Raises
    ------
    OSError
        If the file cannot be written.
    """
    from OCP.APIHeaderSection import APIHeaderSection_MakeHeader
    from OCP.IFSelect import IFSelect_ReturnStatus
    from OCP.Interface import Interface_Static
    from OCP.STEPControl import STEPControl_StepModelType, STEPControl_Writer
    from OCP.TCollection import TCollection_HAsciiString

    shape, curve = solid_of(mirror, body)
    with _quiet():
        writer = STEPControl_Writer()
        Interface_Static.SetCVal_s("write.step.product.name", step_string(name))
        Interface_Static.SetCVal_s("write.step.unit", "MM")
        writer.Transfer(shape, STEPControl_StepModelType.STEPControl_AsIs)
        header = APIHeaderSection_MakeHeader(writer.Model())
        header.SetDescriptionValue(
            1, TCollection_HAsciiString(step_string(_description(mirror, body, curve), 1000))
        )
        header.SetName(TCollection_HAsciiString(step_string(name)))
        header.SetAuthorValue(1, TCollection_HAsciiString(""))
        header.SetOrganizationValue(1, TCollection_HAsciiString(""))
        header.SetOriginatingSystem(TCollection_HAsciiString(f"omnimirror {__version__}"))
        status = writer.Write(str(path))
    if status != IFSelect_ReturnStatus.IFSelect_RetDone:
        raise OSError(28, "the STEP writer failed; the disk may be full")
    return curve


def _description(mirror: Mirror, body: Body, curve: ProfileCurve) -> str:
    deviation = (
        f"within {curve.deviation_um:.2g} um of the mirror" if curve.deviation_um else "exact"
    )
    return f"{mirror.KIND} mirror, meridian: {curve.words}, {deviation}; {body.words()}; z from lens to mirror, mm"


def _point(x: float, z: float) -> Any:
    from OCP.gp import gp_Pnt

    return gp_Pnt(float(x), 0.0, float(z))


def _edge(curve: ProfileCurve) -> Any:
    """Create the edge of the meridian from the axis to the rim."""
    from OCP.BRepBuilderAPI import BRepBuilderAPI_MakeEdge
    from OCP.gp import gp_Ax2, gp_Circ, gp_Dir

    ends = [_point(*end) for end in curve.ends]
    if curve.kind == "line":
        return BRepBuilderAPI_MakeEdge(*ends).Edge()
    if curve.kind == "arc":
        # angles from -z towards x
        circle = gp_Circ(
            gp_Ax2(_point(0.0, curve.radius_mm), gp_Dir(0, -1, 0), gp_Dir(0, 0, -1)),
            curve.radius_mm,
        )
        angles = [float(np.arctan2(x, curve.radius_mm - z)) for x, z in curve.ends]
        return BRepBuilderAPI_MakeEdge(circle, *angles).Edge()
    return BRepBuilderAPI_MakeEdge(_spline(curve)).Edge()


def _spline(curve: ProfileCurve) -> Any:
    from OCP.collections import Array1_double, Array1_gp_Pnt, Array1_int
    from OCP.Geom import Geom_BSplineCurve

    def filled(array: Any, values: Any) -> Any:
        for i, value in enumerate(values, start=1):
            array.SetValue(i, value)
        return array

    knots, counts = np.unique(curve.knots, return_counts=True)
    poles = filled(Array1_gp_Pnt(1, len(curve.poles)), (_point(x, z) for x, z in curve.poles))
    weights = filled(Array1_double(1, len(curve.poles)), curve.weights or (1.0,) * len(curve.poles))
    knot_array = filled(Array1_double(1, len(knots)), knots.tolist())
    count_array = filled(Array1_int(1, len(counts)), counts.tolist())
    return Geom_BSplineCurve(poles, weights, knot_array, count_array, curve.degree)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress messages of OpenCASCADE except failures."""
    from OCP.Message import Message, Message_Gravity

    printers = list(Message.DefaultMessenger_s().Printers())
    levels = [printer.GetTraceLevel() for printer in printers]
    for printer in printers:
        printer.SetTraceLevel(Message_Gravity.Message_Fail)
    try:
        yield
    finally:
        for printer, level in zip(printers, levels, strict=True):
            printer.SetTraceLevel(level)
