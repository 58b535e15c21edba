"""Loader of the compiled module: selection by the environment, messages for a missing module,
threads.
"""

from __future__ import annotations

import logging
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from omnimirror.base import native
from omnimirror.base.errors import InvalidParameter
from omnimirror.base.native import INTERFACE, Backend, backend, usable_cores
from omnimirror.cameras import camera as cameras
from omnimirror.dewarp import _source_coordinates, sampling
from omnimirror.optics.batch import best_focus, evaluate
from omnimirror.simulation import pixel_rays
from omnimirror.simulation.scenes import scene
from tests.everyday import few
from tests.fuzz.native_arguments import Buffers, Recipes, functions_of

# -- Loader of the compiled module: selection by the environment, messages for a missing module, threads

NAME_SCRIPT = "from omnimirror.base.native import backend; print(backend.name)"


def selected_name(choice: str) -> tuple[str, str]:
    environment = {**os.environ, "OMNIMIRROR_NATIVE": choice}
    run = subprocess.run(
        [sys.executable, "-c", NAME_SCRIPT],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    return run.stdout.strip(), run.stderr


@pytest.mark.skipif(not backend.is_compiled, reason="there are no compiled kernels")
def test_environment_selects_instruction_set():
    assert selected_name("0") == ("opencv", "")
    assert selected_name("plain") == ("plain", "")
    assert selected_name("") == (backend.name, "")


@pytest.mark.skipif(not backend.is_compiled, reason="there are no compiled kernels")
def test_unknown_instruction_set_raises(monkeypatch):
    monkeypatch.setenv("OMNIMIRROR_NATIVE", "mmx")
    with pytest.raises(
        InvalidParameter, match=r"OMNIMIRROR_NATIVE must be 0 or an instruction set .*; got 'mmx'"
    ):
        _ = Backend().name


def test_missing_kernels_are_reported_once(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "omnimirror.base._native", None)
    monkeypatch.delattr("omnimirror.base._native", raising=False)
    monkeypatch.delenv("OMNIMIRROR_NATIVE", raising=False)
    missing = Backend()
    with caplog.at_level(logging.WARNING, "omnimirror"):
        assert missing.name == missing.name == "opencv"
        assert not missing.is_compiled
        missing.set_threads(missing.threads)
    assert [r.levelname for r in caplog.records] == ["WARNING"]
    assert "the compiled kernels are missing: images are dewarped by OpenCV" in caplog.text
    with pytest.raises(RuntimeError, match=r"check backend\.is_compiled first"):
        _ = missing.kernels


def test_kernels_of_other_version_are_ignored(monkeypatch, caplog):
    monkeypatch.setitem(
        sys.modules, "omnimirror.base._native", SimpleNamespace(INTERFACE=INTERFACE - 1)
    )
    monkeypatch.delenv("OMNIMIRROR_NATIVE", raising=False)
    with caplog.at_level(logging.WARNING, "omnimirror"):
        assert not Backend().is_compiled
    assert "another version" in caplog.text


def test_thread_count_is_checked():
    for count in (0, -1, 1025):
        with pytest.raises(
            InvalidParameter, match=f"count must be between 1 and 1024 threads; got {count}"
        ):
            backend.set_threads(count)


@pytest.mark.skipif(
    not hasattr(os, "sched_setaffinity"), reason="this platform does not support core affinity"
)
def test_threads_equal_available_cores():
    """A process with affinity to one core, as by taskset, starts no second thread that would wait
    for the first."""
    script = (
        "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))}); "
        "from omnimirror.base.native import backend, usable_cores; "
        "print(usable_cores(), backend.threads)"
    )
    run = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert run.stdout.split() == ["1", "1"]


@pytest.mark.parametrize(
    ("quota", "max_cores"),
    [
        ("max 100000\n", 10**6),
        ("150000 100000\n", 2),
        ("20000 100000\n", 1),
        ("", 10**6),
        ("0 0", 10**6),
    ],
)
def test_threads_respect_container_limit(monkeypatch, tmp_path, quota, max_cores):
    monkeypatch.setattr(native, "CPU_QUOTA_FILE", tmp_path / "cpu.max")
    without = usable_cores()  # the file does not exist
    (tmp_path / "cpu.max").write_text(quota, encoding="ascii")
    assert usable_cores() == max(1, min(without, max_cores))


# -- arguments and memory
# ----------------------------------------------------------------------------

needs_compiled = pytest.mark.skipif(not backend.is_compiled, reason="there are no compiled kernels")


@needs_compiled
@pytest.mark.parametrize("seed", few(range(8), 0))
def test_invalid_kernel_arguments_do_not_crash(seed):
    command = [
        sys.executable,
        "-m",
        "tests.fuzz.native_arguments",
        "--calls",
        "1500",
        "--seed",
        str(seed),
    ]
    run = subprocess.run(command, capture_output=True, text=True, check=False, timeout=280)
    assert run.returncode == 0, run.stdout + run.stderr
    assert all(" 0 completed" not in line for line in run.stdout.splitlines())  # passed the checks


@needs_compiled
@pytest.mark.parametrize(
    "name", sorted(dict(functions_of(backend.module))) if backend.is_compiled else []
)
def test_every_kernel_array_is_checked(name):
    """All bindings reject misaligned arrays and arrays with another number of axes."""
    function = dict(functions_of(backend.module))[name]
    recipes = Recipes(Buffers(np.random.default_rng(0)), backend.module)

    def call_arguments():
        bound_and_arguments = getattr(recipes, name.replace(".", "_"))()
        return (
            bound_and_arguments
            if isinstance(bound_and_arguments, tuple)
            else (None, bound_and_arguments)
        )

    for argument, value in call_arguments()[1].items():
        indices = range(len(value)) if isinstance(value, tuple) else (None,)
        for index in indices:
            bound, arguments = call_arguments()
            value = arguments[argument]
            array = value if index is None else value[index]
            is_unused = (name, argument) == (
                "PackedMap.sample",
                "coordinates",
            ) and "averages" not in arguments
            is_unused |= argument == "shells" and arguments["shell"][0] == 0
            if not isinstance(array, np.ndarray) or array.size == 0 or is_unused:
                continue
            odd = recipes.b.copy(array, odd=1) if array.itemsize > 1 else array
            for changed, message in ((odd, "aligned"), (np.array(array)[None], "must have shape")):
                if changed is array:
                    continue
                replacement = (
                    changed if index is None else (*value[:index], changed, *value[index + 1 :])
                )
                call = {**arguments, argument: replacement}
                # nanobind reports this for array types with a fixed number of axes
                pattern = f"{message}|incompatible function arguments"
                with pytest.raises((ValueError, TypeError), match=pattern) as refusal:
                    function(**call) if bound is None else function(bound, **call)
                assert "aligned" not in message or refusal.type is ValueError


LIMITED_MEMORY_SCRIPT = """
import resource
import numpy as np
from omnimirror.optics.batch.best_focus import FOCUS_SEARCH
from omnimirror.base.native import backend

designs, terms, angles, random = 64, 400, 8000, np.random.default_rng(0)
numbers = np.tile([185.0, 44.0, 11.6, 4.0, 50.0, 0.0, 0.0], (designs, 1))
def evaluate():
    columns = np.zeros((10, designs, angles))
    backend.kernels.evaluate_designs(
        coefficients, numbers, basis, fractions, True, False, 0.08, 0.0, 550.0, np.zeros(angles), 0.0, FOCUS_SEARCH,
        np.empty((0, 2, 1)), (0.0,) * 7, np.empty((0, 1)), (0, 1.0, 1.0), columns, np.zeros((3, designs)),
    )
    return columns
coefficients, basis = random.uniform(0, 1e-4, (designs, terms)), random.uniform(0, 1, (3, terms, angles))
fractions = np.linspace(0, 1, angles)
backend.set_threads({first})
before = evaluate()
backend.set_threads({threads})
page, unlimited = resource.getpagesize(), resource.getrlimit(resource.RLIMIT_AS)
used = int(open("/proc/self/statm").read().split()[0]) * page
resource.setrlimit(resource.RLIMIT_AS, (used + 60 * 2**20, unlimited[1]))  # the columns fit, the 77 MB of a task do not
errors = 0
for _ in range(5):
    try:
        evaluate()
    except MemoryError:
        errors += 1
resource.setrlimit(resource.RLIMIT_AS, unlimited)
print(errors, np.array_equal(evaluate(), before, equal_nan=True))
"""


@needs_compiled
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are those of Linux")
@pytest.mark.parametrize(("first", "threads"), [(4, 4), (1, 4), (1, 1)])
def test_tasks_without_memory_raise(first, threads):
    """Failure in running threads, in threads that cannot be started, and without threads; the state
    is restored afterwards."""
    script = LIMITED_MEMORY_SCRIPT.replace("{first}", str(first)).replace("{threads}", str(threads))
    run = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=280
    )
    assert (run.returncode, run.stdout.split()) == (0, ["5", "True"]), run.stderr


# -- Constants defined in both Python and the compiled module: parsed from the C++ sources, and equal

SOURCES = Path(__file__).parents[2] / "native" / "src"
SHARED = {
    "sampling/footprint.hpp": {
        "JUMP_RATIO2": sampling.JUMP_RATIO2,
        "JUMP_EXCESS_PX2": sampling.JUMP_EXCESS_PX2,
    },
    "sampling/job.hpp": {"MAX_TAPS": sampling.MAX_TAPS},
    "sampling/footprint_sides.cpp": {"SAMPLING_STEP_PX": sampling.SAMPLING_STEP_PX},
    "sampling/axial.hpp": {"EDGE_PX": 0.5 + cameras.EDGE_SLACK},
    "sampling/axial_kernel.hpp": {
        name: getattr(_source_coordinates, name)
        for name in (
            "ANGLE_TOLERANCE_RAD",
            "CONVERGENCE_TOLERANCE",
            "MAX_ROOT_RESIDUAL",
            "MAX_STEPS",
        )
    },
    "designs/designs.hpp": {
        "DESIGN_COLUMNS": len(evaluate.BATCH_COLUMNS),
        "DESIGN_NUMBERS": len(evaluate._NUMBERS),
    },
    "designs/workspace.hpp": {"DEGREE": np.pi / 180},
    "designs/focus.hpp": {"TANGENT_MARGIN": best_focus.TANGENT_MARGIN},
    "exposure/packets.hpp": {"EDGE_MARGIN": scene.EDGE_MARGIN},
    "exposure/exposure.hpp": {
        "LOST": pixel_rays.LOST,
        "REFLECTED": pixel_rays.REFLECTED,
        "DIRECT": pixel_rays.DIRECT,
        "OBSCURED": pixel_rays.OBSCURED,
    },
}


def constants_of(text: str) -> dict[str, float]:
    """Return the constants of a source that are numbers, or sums and quotients of numbers."""
    constants = {}
    for names in re.findall(r"constexpr (?:int|float|double|int64_t) ([^;{}()]*);", text):
        for one in names.split(","):
            name, _, value = one.partition("=")
            if re.fullmatch(r"[\d\s.e+/*-]+f?", value):
                constants[name.strip()] = float(eval(value.strip().removesuffix("f")))
    return constants


@pytest.mark.parametrize("file", SHARED)
def test_compiled_constants_equal_python(file):
    constants = constants_of((SOURCES / file).read_text())
    for name, value in SHARED[file].items():
        assert constants[name] == pytest.approx(value, rel=1e-15), name
