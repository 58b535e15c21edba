"""Shared fixtures: one sensor per kind of mirror, and the folder of real photographs."""

from __future__ import annotations

import gc
import os
import shutil
import subprocess

# As in the commands, this precedes the import of NumPy. Test processes already share the cores, and
# BLAS threads that synchronise for each small product would triple the time of a calibration.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

import omnimirror as om
from omnimirror.base.native import backend
from omnimirror.optics.image_sensor import Imager
from omnimirror.optics.lenses import Orthographic, Perspective
from omnimirror.optics.mirrors import (
    Cone,
    Conformal,
    ConicAsphere,
    CylinderMapping,
    Ellipsoid,
    Equiangular,
    Equiareal,
    Equidistant,
    EvenPolynomial,
    GroundPlane,
    Hyperboloid,
    Mirror,
    Paraboloid,
    Rectifying,
    SampledProfile,
    SlopeSpline,
    Sphere,
    TabulatedMapping,
    UnitAspect,
)
from omnimirror.optics.mirrors.prescribed_mapping import MappingMirror
from omnimirror.optics.sensor_files import bundled_sensors

# No deadline, because shared machines stall occasionally; fixed examples, so that a failure is reproducible.
settings.register_profile("omnimirror", deadline=None, derandomize=True)
settings.load_profile("omnimirror")

# Collection of 10,000 tests creates millions of permanent objects; scanning them repeatedly takes
# 25 % of that time.
gc.disable()

SHARED = Path(__file__).parents[1].parent / "shared" / "data"
M = 43.9


def _sampled_sphere() -> SampledProfile:
    x = np.linspace(0, 46, 116)
    return SampledProfile(tuple(x), tuple(49.9582 - np.sqrt(49.9582**2 - x**2)), rim_radius_mm=M)


def _sloped_sphere() -> SlopeSpline:
    x = np.linspace(0, 44.5, 121)
    return SlopeSpline(tuple(x / np.sqrt(49.9582**2 - x**2)), rim_radius_mm=44.5)


def _table() -> TabulatedMapping:
    omega = np.linspace(0, 122, 62)
    return TabulatedMapping(tuple(omega), tuple(np.sin(np.radians(omega) / 2)), 11.0, 40.0)


GENERATED: dict[str, MappingMirror] = {
    mirror.KIND: mirror
    for mirror in (
        Equidistant(137.0, 12.2, 44.5),
        Equiangular(130.0, 14.0, M, omega_min_deg=0.0),
        Conformal(136.0, 12.0, M),
        UnitAspect(122.0, 12.0, M),
        Equiareal(139.0, 12.3, M, omega_min_deg=0.0),
        Rectifying(77.0, 12.0, M),
        GroundPlane(70.0, 12.0, M, plane_distance_mm=600.0),
        CylinderMapping(115.0, 12.0, M, omega_min_deg=50.0, cylinder_radius_mm=800.0),
        _table(),
    )
}

MIRRORS: dict[str, tuple[Mirror, float]] = {
    "sphere": (Sphere(1.138 * M, 43.905), 4.110 * M),
    "hyperboloid": (Hyperboloid(0.7407 * M, 1.698 * M, M), 3.5505227367025753 * M),
    "paraboloid": (Paraboloid(21.0, M), 4.0 * M),
    "ellipsoid": (Ellipsoid(60.0, 120.0, M), 4.0 * M),
    "cone": (Cone(50.0, M), 4.0 * M),
    "even-polynomial": (EvenPolynomial((0.6409, 0.1550, -0.01), M, M), 3.919 * M),
    "conic-asphere": (ConicAsphere(40.0, -0.6, M, (0.03, 0.01), M), 4.0 * M),
    "sampled": (_sampled_sphere(), 4.110 * M),
    "slope-spline": (_sloped_sphere(), 4.110 * M),
    **{kind: (mirror, mirror.design_distance) for kind, mirror in GENERATED.items()},
}
"""All kinds of mirrors (mm), with a usable lens distance."""

SURFACES_OF_LENS_FILES = {
    "sphere",
    "hyperboloid",
    "paraboloid",
    "ellipsoid",
    "cone",
    "even-polynomial",
    "conic-asphere",
}
"""Kinds that equal a conic with even terms; the others are fitted."""


def sensor_of(kind: str, lens: str = "perspective") -> om.Sensor:
    mirror, m = MIRRORS[kind]
    if lens == "orthographic":
        return om.Sensor(
            mirror, Orthographic(0.0592, 4.0, 22.0), Imager(1024, 1024, 5.2), name=kind
        )
    return om.Sensor(
        mirror,
        Perspective(11.6, 4.0, 210.0),
        Imager(1024, 1024, 5.2),
        mirror_distance_mm=m,
        name=kind,
    )


@pytest.fixture(params=sorted(MIRRORS))
def any_mirror(request: pytest.FixtureRequest) -> Mirror:
    return MIRRORS[request.param][0]


@pytest.fixture(
    params=[f"{k}/perspective" for k in sorted(MIRRORS)]
    + ["sphere/orthographic", "paraboloid/orthographic"]
)
def any_sensor(request: pytest.FixtureRequest) -> om.Sensor:
    """All mirrors with a perspective lens, two with an orthographic one."""
    return sensor_of(*request.param.split("/"))


@pytest.fixture(params=bundled_sensors())
def bundled(request: pytest.FixtureRequest) -> om.Sensor:
    return om.load_sensor(request.param)


@pytest.fixture
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Return a function that disables the compiled module."""
    return lambda: monkeypatch.setattr(backend, "module", None)


@pytest.fixture
def shared_data() -> Path:
    """Return the folder of real photographs; skip if missing."""
    if not SHARED.is_dir():
        pytest.skip(f"folder of real photographs is missing: {SHARED}")
    return SHARED


@pytest.hookimpl(trylast=True)
def pytest_collection_finish() -> None:
    """Exclude collected objects from garbage collection; objects of tests are collected as usual."""
    gc.collect()
    gc.freeze()
    gc.enable()


def is_long(item: pytest.Item) -> bool:
    """Check if a test takes several seconds, as all browser tests do."""
    return item.get_closest_marker("long") is not None or "browser" in getattr(
        item, "fixturenames", ()
    )


@pytest.hookimpl(trylast=True)  # after deselection
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Distribute long tests to the starts of the processes, so that none remains at the end.

    Initially, ``--dist worksteal`` gives each process an equal part of the list; later, idle
    processes take tests from the ends of other parts.
    """
    processes = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", 1))
    long, short = [i for i in items if is_long(i)], [i for i in items if not is_long(i)]
    total, items[:] = len(items), []
    for k in range(processes):
        piece = (total - len(items)) // (processes - k)
        count = max(0, piece - len(long[k::processes]))
        items += long[k::processes] + short[:count]
        del short[:count]


@pytest.fixture(scope="session")
def launched():
    """Launch a browser with given flags; one Playwright instance for all tests of a process, which
    supports only one."""
    from tests.apps.studio.browser import FAKE_CAMERA, chromium

    sync_api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed")
    executable = chromium()
    with sync_api.sync_playwright() as playwright:
        yield lambda flags, camera=FAKE_CAMERA: playwright.chromium.launch(
            executable_path=executable, args=flags + camera
        )


@pytest.fixture
def display(monkeypatch):
    """Start a virtual X server for a test."""
    program = shutil.which("Xvfb")
    if program is None or find_spec("_tkinter") is None:
        pytest.skip("Xvfb or Tk is not installed")
    read, write = os.pipe()
    command = [program, "-displayfd", str(write), "-screen", "0", "640x480x24", "-nolisten", "tcp"]
    server = subprocess.Popen(command, pass_fds=[write], stderr=subprocess.DEVNULL)
    os.close(write)
    with os.fdopen(read) as display_pipe:
        monkeypatch.setenv("DISPLAY", ":" + display_pipe.readline().strip())
    yield
    server.terminate()
    server.wait()
