"""Bench data of a page without a server: parts, sensors, and the script with the compiled
evaluator."""

from __future__ import annotations

from base64 import b64encode
from pathlib import Path

from ....optics.batch.best_focus import FOCUS_SEARCH
from ....optics.mirrors import ConicAsphere, Ellipsoid, EvenPolynomial, Hyperboloid, Paraboloid, Sphere
from ....optics.sensor_files import load_sensor
from ..pages import script_text
from .designs.sensors import on_bench
from .form import bench_start
from .messages import BenchAlone, BenchSensor, PartOf

KERNEL = Path(__file__).with_name("kernel.wasm")
"""Compiled design evaluator, built by native/wasm/build.sh."""
MIRRORS = {cls.KIND for cls in (Sphere, Ellipsoid, Hyperboloid, Paraboloid, ConicAsphere, EvenPolynomial)}
"""Kinds of mirrors with an analytic profile; all others require a solver."""
LENSES = {
    "perspective": ("focal_length_mm", "f_number", "focus_distance_mm"),
    "orthographic": ("magnification", "working_f_number", "focus_distance_mm"),
}
"""Ideal lenses and their parameters."""


def bench_alone() -> BenchAlone:
    """Return the bench for analytic mirrors with ideal lenses; the compiled evaluator in the page
    computes all values.

    Examples
    --------
    >>> [part.kind for part in bench_alone().start.lenses]
    ['perspective', 'orthographic']
    """
    start = bench_start()
    known = {name: sensor for name in start.sensors if is_known(sensor := on_bench(load_sensor(name)))}
    parts = {
        "mirrors": tuple(part for part in start.mirrors if part.kind in MIRRORS),
        "lenses": tuple(_bare(part) for part in start.lenses if part.kind in LENSES),
        "secondaries": (), "sensors": tuple(known),
    }  # fmt: skip
    only = start.model_copy(update=parts)
    return BenchAlone(
        start=only, sensors=tuple(known.values()), search=tuple(map(float, FOCUS_SEARCH)),
        kernel=b64encode(KERNEL.read_bytes()).decode(), script=script_text("bench.js"),
    )  # fmt: skip


def is_known(sensor: BenchSensor) -> bool:
    """Check if the bench supports a sensor without a server."""
    tables = sensor.tables
    mirror, lens = tables["mirror"]["kind"], tables["lens"]
    is_bare = not ({"secondary", "mirror_pose", "housing"} & set(tables))
    own = LENSES.get(lens["kind"], ())
    return mirror in MIRRORS and is_bare and all(name in ("kind", *own) or not value for name, value in lens.items())


def _bare(lens: PartOf) -> PartOf:
    return lens.model_copy(update={"parameters": tuple(p for p in lens.parameters if p.name in LENSES[lens.kind])})
