"""Methods of public objects with unusual arguments: a result, or an omnimirror error."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.cameras.camera import Mount
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Lens
from tests.conftest import MIRRORS
from tests.everyday import few

from .test_calls import ODD

SENSOR = om.load_sensor("paper-spherical")
VIEW = om.screens.Cylinder((36, 12), -40.0, 20.0)
FOCAL: Any = {"focal_px": (20.0, 21.0), "centre_px": (16.0, 15.0), "image_size": (32, 32)}
OBJECTS: dict[str, Any] = {
    "sensor": replace(SENSOR, imager=Imager(32, 32, 166.4)),
    "tilted sensor": replace(SENSOR, mirror_pose=replace(SENSOR.mirror_pose, tilt_x_deg=0.5)),
    "unified": om.Unified(xi=0.9, **FOCAL),
    "enhanced unified": om.EnhancedUnified(alpha=0.6, beta=1.1, **FOCAL),
    "double sphere": om.DoubleSphere(xi=-0.2, alpha=0.6, **FOCAL),
    "Kannala-Brandt": om.KannalaBrandt(**FOCAL),
    "ball": om.MirrorBall(
        centre_px=(16.0, 16.0), rim_radius_px=9.0, field_deg=260.0, image_size=(32, 32)
    ),
    "OCam": om.OCam(polynomial=(-100.0, 0.0, 0.001), centre_px=(16.0, 16.0), image_size=(32, 32)),
    "room": om.Room(texel_mm=40.0),
    "hall": om.Hall(texel_mm=40.0),
    "street": om.Street(texel_mm=100.0),
    "environment": om.Environment(np.ones((4, 8, 3), np.float32)),
    "cylinder": VIEW,
    "plane": om.screens.Plane((8, 6)),
    "sphere": om.screens.Equirectangular((8, 4)),
    "dome": om.screens.DomeMaster((8, 8), 90.0),
    "planet": om.screens.LittlePlanet((8, 8)),
    "ground": om.screens.Ground((8, 8), 1200.0, 100.0),
    "cube": om.screens.CubeMap((12, 8), layout="3x2"),
    "dewarper": om.Dewarper(replace(SENSOR, imager=Imager(32, 32, 166.4)), VIEW),
    "table": om.evaluate(SENSOR, [30.0, 60.0]),
    "mount": Mount(),
    "lens": SENSOR.lens,
    "telecentric lens": om.load_sensor("paraboloid-telecentric").lens,
} | {f"{kind} mirror": mirror for kind, (mirror, _) in MIRRORS.items()}
USUAL: dict[str, Any] = {  # by argument name
    "pixels": [[3.0, 4.0]],
    "pupil": [[0.5, 0.0]],
    "points_mm": [[1.0, 2.0, -3.0]],
    "directions": [[1.0, 0.0, -0.2]],
    "origins_mm": [[0.0, 0.0, 0.0]],
    "low_mm": [-1.0] * 3,
    "high_mm": [1.0] * 3,
    "u": [3.0],
    "v": [2.0],
    "omega": [0.5],
    "radius_px": [5.0],
    "h_px": [2.0],
    "pan_deg": 5.0,
    "tilt_deg": 0.0,
    "factor": 2.0,
    "first_row": 0,
    "last_row": 2,
    "size": (8, 6),
    "height_mm": (100.0, 900.0),
    "distance_mm": 2000.0,
    "elevation_deg": (-20.0, 10.0),
    "omega_deg": (20.0, 60.0),
    "names": ["h_px"],
    "path": "table.csv",
    "word": "EXIT",
    "name": "A1",
    "parts": (np.zeros((32, 32), np.uint8), np.zeros((16, 16, 2), np.uint8)),
    "rays": SENSOR.meridian.trace(np.array([5.0])),
    "lens": SENSOR.lens,
    "image": np.zeros((32, 32, 3), np.uint8),
    "camera": SENSOR,
    "computation": "a test",
    "x_mm": [5.0],
    "tau": [0.5],
    "height": np.sin,
    "omega_max_deg": 80.0,
    "theta_max_deg": 10.0,
    "mirror_distance_mm": 90.0,
    "fraction": 0.5,
    "rim_radius_mm": 20.0,
    "L": [100.0],
    "coordinate": [0.01],
    "tolerance": 0.005,
    "focus_distance_mm": 100.0,
    "wavelength_nm": 600.0,
}
UNSUPPORTED = {
    ("tilted sensor", "x_from_height_px"),
    ("environment", "load"),
    ("cube", "face"),
    ("cube", "zoomed"),
    ("sampled mirror", "from_csv"),
}
OF_LENSES = {  # the others are steps of a trace, with arrays created by it
    "blur",
    "focus_coordinate",
    "distance_of",
    "depth_of_field",
    "hyperfocal_distance",
    "focused_at",
    "at_wavelength",
    "airy_diameter",
}
INTERNAL = {"from_spec", "unchecked"}  # readers of checked files, and methods that skip the checks


def methods_of(instance: Any) -> dict[str, Callable[..., Any]]:
    """Return the public methods of an object that have arguments."""
    names = [n for n in dir(instance) if not n.startswith("_") and n not in INTERNAL]
    methods = {
        name: getattr(instance, name)
        for name in names
        if callable(getattr(type(instance), name, None))
    }
    return {
        name: method
        for name, method in methods.items()
        if inspect.ismethod(method) and inspect.signature(method).parameters
    }


CASES = [
    (owner, method)
    for owner in OBJECTS
    for method in methods_of(OBJECTS[owner])
    if not isinstance(OBJECTS[owner], Lens) or method in OF_LENSES
]


@pytest.fixture(autouse=True)
def _temporary_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(
    ("owner", "method"),
    few(CASES, *(case for case in CASES if case[0] not in ("hall", "street"))),
    ids=[" ".join(case) for case in CASES],
)
def test_unusual_arguments_are_processed_or_rejected(owner, method):
    function = methods_of(OBJECTS[owner])[method]
    parameters = [
        p
        for p in inspect.signature(function).parameters.values()
        if p.kind not in (p.VAR_KEYWORD, p.VAR_POSITIONAL)
    ]
    usual = {p.name: USUAL[p.name] for p in parameters if p.default is p.empty and p.name in USUAL}
    if "values" in {p.name for p in parameters}:
        usual["values"] = [p.value for p in OBJECTS[owner].parameters]
    try:
        function(**usual)
    except OmnimirrorError as e:  # methods not supported by objects of this kind
        assert (owner, method) in UNSUPPORTED, e  # noqa: PT017
    for name in (p.name for p in parameters):
        for odd in ODD:
            with warnings.catch_warnings():
                warnings.simplefilter(
                    "ignore", RuntimeWarning
                )  # values far outside the field may overflow to NaN
                try:
                    function(**usual | {name: odd})
                except OmnimirrorError as e:
                    assert "\n" not in str(e)  # noqa: PT017
                    assert len(str(e)) < 700, str(e)  # noqa: PT017
