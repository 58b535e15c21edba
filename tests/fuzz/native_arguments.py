"""Fuzz test of the compiled module: calls of all functions with partly invalid arguments.

    python -m tests.fuzz.native_arguments [--calls 3000] [--seed 0]

Every call must return or raise a Python exception, and write only to its arrays. Run as a separate
process, since a fault ends it; `native/sanitize.sh` runs it with sanitizers.
"""

from __future__ import annotations

import argparse
import faulthandler
import os
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from omnimirror.base.native import backend
from omnimirror.dewarp.maps import node_weights
from omnimirror.optics.batch.best_focus import FOCUS_SEARCH
from tests.samplers import instructions as instructions_of_machine

Arguments = dict[str, Any]

REJECTIONS = (ValueError, TypeError, MemoryError, OverflowError)
FILL, GUARD = 0xA5, 0 if "ASAN_OPTIONS" in os.environ else 64
"""Guard bytes of each array; none with the address sanitizer, whose own guards also detect reads."""
ODD_NUMBERS = (
    np.nan, np.inf, -np.inf, 3e38, -3e38, 1e308, 1e-308, 0.0, -0.0, -1.0, 1e6, 0, 1, 2, 3, -1, 15, 2**15, 2**24 + 1,
    2**31 - 1, -(2**31), 2**40, 2**63, True, None, "x", (), (1, 2),
)  # fmt: skip
TYPES = ("uint8", "uint16", "int32", "int64", "float32", "float64", "complex64", "bool")


class Buffers:
    """Arrays of one call with guard bytes that are checked afterwards."""

    def __init__(self, random: np.random.Generator) -> None:
        self.random = random
        self._memory: list[np.ndarray] = []

    def empty(self, shape: tuple[int, ...], dtype: Any, odd: int = 0) -> np.ndarray:
        """Return an array that starts `odd` bytes after an aligned address."""
        count = int(np.prod(shape, dtype=object)) * np.dtype(dtype).itemsize
        memory = np.full(count + odd + 2 * GUARD, FILL, np.uint8)
        self._memory.append(memory)
        array = (
            np.ndarray(shape, dtype, memory.data, offset=GUARD + odd)
            if count
            else np.empty(shape, dtype)
        )
        return array

    def copy(self, values: Any, dtype: Any = None, odd: int = 0) -> np.ndarray:
        values = np.asarray(values, dtype)
        array = self.empty(values.shape, values.dtype, odd)
        array[...] = values
        return array

    def check(self) -> None:
        for memory in self._memory:
            assert not GUARD or (memory[:GUARD] == FILL).all(), "memory before an array was written"
            assert not GUARD or (memory[-GUARD:] == FILL).all(), (
                "memory behind an array was written"
            )


# -- valid arguments -------------------------------------------------------------------------------


class Recipes:
    """Small random valid arguments of all functions."""

    def __init__(self, buffers: Buffers, module: Any) -> None:
        self.b, self.module = buffers, module
        self.random = buffers.random

    def floats(
        self, *shape: int, low: float = -1.0, high: float = 1.0, dtype: str = "float64"
    ) -> np.ndarray:
        return self.b.copy(self.random.uniform(low, high, shape), dtype)

    def side(self, maximum: int = 40) -> int:
        return int(self.random.integers(1, maximum))

    # -- dewarp

    def image(self, height: int, width: int) -> np.ndarray:
        dtype, channels = (
            self.random.choice(["uint8", "uint16", "float32"]),
            int(self.random.integers(1, 5)),
        )
        gap = int(self.random.integers(0, 3))
        memory = self.b.copy(self.random.integers(0, 255, (height, width + gap, channels)), dtype)
        return memory[:, :width]

    def coordinates(self, height: int, width: int, src: np.ndarray) -> np.ndarray:
        dtype = self.random.choice(["float32", "float64"])
        maximum = max(src.shape) + 1
        return self.floats(height, width, 2, low=-1, high=maximum, dtype=dtype)

    def _remap(self, height: int, width: int) -> Arguments:
        src = self.image(self.side(), self.side())
        dst = self.b.empty((height, width, src.shape[2]), src.dtype)
        interpolation = int(self.random.integers(0, 3))
        arguments: Arguments = {
            "src": src,
            "dst": dst,
            "interpolation": interpolation,
            "border": 0.0,
        }
        if interpolation == 2 and self.random.random() < 0.5:
            arguments["averages"] = self.averages(height, width, 16)
        return arguments

    def averages(self, height: int, width: int, step: int) -> Any:
        taps = self.random.integers(1, 4, (-(-height // step), -(-width // step), 2))
        return self.module.Averages(self.b.copy(taps, "uint8"), step, 1.2, None)

    def remap(self) -> Arguments:
        arguments = self._remap(self.side(), self.side())
        return {
            **arguments,
            "coordinates": self.coordinates(*arguments["dst"].shape[:2], arguments["src"]),
        }

    def remap_polar(self) -> Arguments:
        arguments = self._remap(self.side(), self.side(200))
        height, width = arguments["dst"].shape[:2]
        angle = self.random.uniform(0, 6, width)
        return {
            **arguments,
            "radii": self.floats(height, high=20, dtype="float32"),
            "x": 20.0,
            "y": 20.0,
            "cosines": self.b.copy(np.cos(angle), "float32"),
            "sines": self.b.copy(np.sin(angle), "float32"),
        }

    def lattice(self, height: int, width: int, step: int) -> Arguments:
        down, across = -(-height // step), -(-width // step)
        cells = self.b.copy(self.random.integers(-1, 2, (down, across)), "int32")
        x, y = (self.floats(down + 3, across + 3, low=-1, high=50, dtype="float32") for _ in "xy")
        return {
            "x": x,
            "y": y,
            "cells": cells,
            "patches": self.floats(2, step, step, 2, high=40, dtype="float32"),
        }

    def remap_lattice(self) -> Arguments:
        height, width, step = (
            self.side(),
            self.side(200),
            int(self.random.choice([4, 8, 16, 32, 64])),
        )
        arguments = self._remap(height, width) | self.lattice(height, width, step)
        arguments.pop("averages", None)
        if arguments["interpolation"] == 2:
            arguments["averages"] = self.averages(height, width, step)
        if self.random.random() < 0.5:  # all cells are interpolated within the image
            arguments["cells"][...], arguments["src"] = (
                -1,
                self.b.copy(self.random.integers(0, 255, (70, 80, 3)), "uint8"),
            )
            arguments["dst"] = self.b.empty((height, width, 3), "uint8")
            for name in "xy":
                arguments[name][...] = self.random.uniform(30, 40, arguments[name].shape)
        return {
            **arguments,
            **{name: self.b.copy(node_weights(step)) for name in ("weights", "row_weights")},
        }

    def squared_sides_of_lattice(self) -> Arguments:
        arguments = self.lattice(self.side(), self.side(), 8)
        return {
            **arguments,
            "step": 8,
            "out": self.b.empty((*arguments["cells"].shape, 2), "float32"),
        }

    def Averages(self) -> Arguments:
        taps = self.b.copy(self.random.integers(1, 4, (3, 2, 2)), "uint8")
        return {"taps": taps, "step": 16, "sharp_px": 1.2, "annulus": (9.0, 9.0, 1.0, 20.0)}

    def PackedMap(self) -> Arguments:
        src = self.image(self.side(), self.side())
        height, width, channels = src.shape
        coordinates = self.coordinates(self.side(), self.side(), src)
        return {
            "coordinates": coordinates,
            "width": width,
            "height": height,
            "channels": channels,
            "is_deep": src.dtype != np.uint8,
            "interpolation": int(self.random.integers(0, 3)),
        }

    def PackedMap_sample(self) -> tuple[Any, Arguments]:
        arguments = self._remap(self.side(), self.side())
        src, dst = arguments["src"], arguments["dst"]
        coordinates = self.coordinates(*dst.shape[:2], src)
        interpolation = arguments.pop("interpolation")
        packed = self.module.PackedMap(
            coordinates,
            src.shape[1],
            src.shape[0],
            src.shape[2],
            bool(src.dtype != np.uint8),
            interpolation,
        )
        return packed, {**arguments, "coordinates": coordinates}

    def AxialCamera(self) -> Arguments:
        return {
            "frame": self.b.copy(np.eye(3)),
            "x": 20.0,
            "y": 20.0,
            "width": 40,
            "height": 40,
            "first": 0.0,
            "last": 0.9,
            "radii": self.floats(9, low=0, high=20),
            "origins": self.floats(5, 2),
            "viewpoint": 0.0,
        }

    def AxialCamera_project(self) -> tuple[Any, Arguments]:
        count = self.side(600)
        out = {"pixels": self.b.empty((count, 2), float), "excess": self.b.empty((count,), float)}
        return self.module.AxialCamera(**self.AxialCamera()), {
            "targets": self.floats(count, 3),
            "is_near": True,
            **out,
        }

    # -- batch

    def evaluate_designs(self) -> Arguments:
        designs, terms, angles, cells = self.side(80), self.side(5), self.side(20), self.side(4)
        numbers = self.b.copy(np.tile([185.0, 44.0, 11.6, 4.0, 50.0, 0.0, 0.0], (designs, 1)))
        is_lens, kind = bool(self.random.integers(0, 2)), int(self.random.integers(0, 4))
        return {
            "coefficients": self.floats(designs, terms, high=0.1),
            "numbers": numbers,
            "basis": self.floats(3, terms, angles),
            "fractions": self.floats(angles, low=0),
            "has_conic": True,
            "paper": bool(self.random.integers(0, 2)),
            "pitch": 0.08,
            "image_radius": 0.0,
            "wavelength": 550.0,
            "inverse_distance": self.b.copy(np.zeros(angles)),
            "min_omega": 0.0,
            "search": FOCUS_SEARCH,
            "lens": self.floats(cells + 1, 2, 27) if is_lens else self.b.empty((0, 2, 1), float),
            "lens_numbers": (0.5, 11.6, 4.0, 0.0, 0.0, -0.01, 0.01),
            "shells": self.floats(designs, 7, low=0.1),
            "shell": (kind, 1.5, 1.0),
            "columns": self.b.empty((10, designs, angles), float),
            "results": self.b.empty((3, designs), float),
        }

    # -- simulate

    def Optics(self) -> Arguments:
        nodes = self.floats(int(self.random.choice([0, 2, 30])), 3, high=0.1, dtype="float32")
        is_distorted = bool(self.random.integers(0, 2))
        return {
            "telecentric": False,
            "centre": (8.0, 8.0),
            "scale": (0.02, 0.02),
            "distortion": (0.1 * is_distorted, 0.0, 0.0, 0.0, 0.0),
            "fold": 100.0,
            "focus": 200.0,
            "stop": 1.0,
            "vertex": (0.0, 0.0, 180.0),
            "axes": tuple(np.eye(3).ravel()),
            "aligned": not is_distorted,
            "curvature": -0.02,
            "conic": 0.0,
            "rim": 40.0,
            "nodes": nodes,
            "reflectance": (1.0,) * 8,
            "natural_vignetting": 1.0,
            "body_z": 0.0,
            "body_radius": 20.0,
            "lens_radius": 10.0,
            "edge_z": 0.0,
            "edge_radius": 50.0 * is_distorted,
            "rod_z": (0.0, 100.0 * is_distorted),
            "rod_radius": (1.0, 1.0),
            "housing_light": (0.1,) * 3,
            "direct_view": True,
            "rotation": tuple(np.eye(3).ravel()),
            "shift": (0.0,) * 3,
            "distant": is_distorted,
        }

    def optics(self) -> Any:
        return self.module.Optics(**self.Optics())

    def Environment(self) -> Arguments:
        return {"light": self.floats(self.side(9), self.side(9), 3, dtype="float32")}

    def Surfaces(self) -> Arguments:
        count = int(self.random.integers(0, 30))
        records = self.floats(count, 16, low=-500, high=500, dtype="float32")
        records[:, 9:15] = self.random.uniform(-3, 3, (count, 6))
        records.view(np.int32)[:, 15] = self.random.integers(-2, 2, count)
        sizes = np.array([(3, 4, 1), (5, 1, 0)])
        return {
            "records": records,
            "sizes": self.b.copy(sizes, "int32"),
            "texels": self.floats(17, 4, dtype="float32"),
        }

    def Surfaces_radiance(self) -> tuple[Any, Arguments]:
        count = self.side(99)
        rays = {name: self.floats(count, 3, dtype="float32") for name in ("origins", "directions")}
        out = {
            "light": self.b.empty((count, 4), "float32"),
            "distances": self.b.empty((count,), "float32"),
        }
        return self.module.Surfaces(**self.Surfaces()), {**rays, **out}

    def exposure(self) -> Arguments:
        points = self.floats(self.side(20), 4, low=0, dtype="float32")
        return {
            "optics": self.optics(),
            "points": points,
            "shifted": True,
            "seed": 1,
            "left": 0,
            "top": 0,
        }

    def expose_environment(self) -> Arguments:
        world = self.module.Environment(**self.Environment())
        light = self.b.empty((self.side(9), self.side(20), 3), "float32")
        return {**self.exposure(), "environment": world, "light": light}

    def expose_rays(self) -> Arguments:
        arguments = self.exposure()
        shape = (self.side(9), self.side(20), len(arguments["points"]))
        vectors = {name: self.b.empty((*shape, 3), "float32") for name in ("origins", "directions")}
        weights, outcomes = self.b.empty(shape, "float32"), self.b.empty(shape, "uint8")
        return {**arguments, **vectors, "weights": weights, "fates": outcomes}

    def expose_surfaces(self) -> Arguments:
        arguments = self.exposure()
        shape = self.side(9), self.side(20)
        maximum = (
            int(np.prod(shape)) * len(arguments["points"]) if self.random.random() < 0.7 else 0
        )
        return {
            **arguments,
            "surfaces": self.module.Surfaces(**self.Surfaces()),
            "light": self.b.empty((*shape, 3), "float32"),
            "open_pixels": self.b.empty((maximum,), "int32"),
            "open_rays": self.b.empty((maximum, 7), "float32"),
        }

    def intersect_boxes(self) -> Arguments:
        count = self.side(99)
        rays = {name: self.floats(count, 3) for name in ("origins", "directions")}
        out = {"distances": self.b.empty((count,), float), "faces": self.b.empty((count,), "int32")}
        return {"corners": self.floats(2, self.side(5), 3), **rays, **out}

    def are_blocked(self) -> Arguments:
        count = self.side(99)
        rays = {name: self.floats(count, 3) for name in ("origins", "segments")}
        corners = self.floats(2, self.side(5), 3)
        return {"corners": corners, **rays, "blocked": self.b.empty((count,), "uint8")}

    def BlurKernels(self) -> Arguments:
        width, height, block = self.side(50), self.side(50), int(self.random.choice([1, 2, 4, 8]))
        blocks = -(-width // 8) * 8 // block
        start = int(self.random.integers(0, -(-width // 8))) * 8
        tiles = [[(0, height, 0, width), (0, height, start, width)]]
        kernels = self.random.integers(0, 2, (height, blocks))
        return {
            "width": width,
            "height": height,
            "fineness": int(self.random.integers(1, 5)),
            "firsts": self.b.copy([0, 2, 5], "int32"),
            "offsets": self.b.copy(self.random.integers(-9, 9, (5, 2)), "int32"),
            "weights": self.floats(5, low=0, dtype="float32"),
            "pixels": self.b.copy(np.arange(width * height), "int32"),
            "block": block,
            "kernels": self.b.copy(kernels, "int32"),
            "tiles": self.b.copy(tiles, "int32"),
            "concentration": self.b.copy(np.ones((height, width)), "float32"),
        }

    def Deconvolution(self) -> Arguments:
        arguments = self.BlurKernels()
        shape = arguments["height"], arguments["width"], int(self.random.choice([1, 3]))
        roots, guess = (self.floats(*shape, low=0, dtype="float32") for _ in range(2))
        return {"kernels": self.module.BlurKernels(**arguments), "roots": roots, "guess": guess}

    def _deconvolution(self) -> tuple[Any, tuple[int, int, int]]:
        arguments = self.Deconvolution()
        return self.module.Deconvolution(**arguments), arguments["roots"].shape

    def Deconvolution_improve(self) -> tuple[Any, Arguments]:
        deconvolution, shape = self._deconvolution()
        costs = self.floats(*shape[:2], low=0, dtype="float32")
        return deconvolution, {"costs": costs, "steps": self.b.copy([3], "int32")}

    def Deconvolution_log_steepness(self) -> tuple[Any, Arguments]:
        deconvolution, shape = self._deconvolution()
        return deconvolution, {"logarithms": self.b.empty(shape[:2], "float32")}

    def Deconvolution_blurred(self) -> tuple[Any, Arguments]:
        deconvolution, shape = self._deconvolution()
        return deconvolution, {"light": self.b.empty(shape, "float32")}

    Deconvolution_light = Deconvolution_blurred

    # -- tolerancing

    def evaluate_trials(self) -> Arguments:
        trials, n, terms, powers = (
            self.side(99),
            self.side(20),
            4,
            int(self.random.choice([1, 15, 28, 91])),
        )
        numbers = self.floats(trials, 35 + terms + powers)
        pose, basis, pieces = (
            int(self.random.integers(1, 6)),
            int(self.random.integers(1, 21)),
            self.side(5) - 1,
        )
        objects = (
            *(self.floats(n, k) for k in (3, 2, 2, 4)),
            self.floats(n, low=0.1),
            bool(self.random.integers(0, 2)),
        )
        rows = (
            self.floats(int(self.random.integers(2, 17)), 2 * n),
            self.floats(basis, 2 * n),
            self.floats(basis, pose),
            self.floats(basis, pose * (pose + 1) // 2),
            self.floats(int(self.random.integers(0, 17)), 2 * n),
            3,
        )
        return {
            "numbers": numbers,
            "terms": terms,
            "is_conic": True,
            "rim": 40.0,
            "table": (self.floats(pieces, 6), 1.0),
            "object_field": objects,
            "compensators": rows,
            "search": (20, 1e-9, 1e9, 1.0, 20),
            "refocus": int(self.random.integers(0, 3)),
            "floor": 1.0,
            "merits": self.b.empty((trials, 24), float),
            "displacements": self.b.empty((trials, 2 * n), float),
        }

    # -- tracing

    def surface(self) -> tuple[Any, ...]:
        return self.floats(self.side(30), 8), 1.0, 20.0, 0.0, 0.0, 0.0, -180.0, False

    def find_reflections(self) -> Arguments:
        count = self.side(200)
        return {
            "surface": self.surface(),
            "search": (20, 5, 1e-9, 1e-3, 0.3, 1.2, 1e-9),
            "by_omega": self.floats(self.side(20), 4, high=20),
            "omegas": (0.0, 2.0),
            "middle": 0.0,
            "distant": bool(self.random.integers(0, 2)),
            "targets": self.floats(3, count, high=300),
            "rows": self.b.empty((8, count), float),
            "states": self.b.empty((count,), "uint8"),
        }

    def intersect_mirror(self) -> Arguments:
        count = self.side(200)
        return {
            "surface": self.surface(),
            "search": (20, 5, 1e-9, 1e-3, 0.3, 1.2, 1e-9),
            "depth": self.floats(self.side(20), 4, high=200),
            "max_tangent": 0.3,
            "directions": self.floats(3, count),
            "rows": self.b.empty((6, count), float),
            "states": self.b.empty((count,), "uint8"),
        }

    def shell(self) -> tuple[Any, ...]:
        return int(self.random.integers(0, 3)), (-10.0, -12.0), (60.0, 63.0), 1.49, 1.0

    def shell_exit(self) -> Arguments:
        count = self.side(99)
        return {
            "shell": self.shell(),
            "points": self.floats(count, 3),
            "directions": self.floats(count, 3),
            "vectors": self.b.empty((5, count, 3), float),
            "numbers": self.b.empty((4, count), float),
            "flags": self.b.empty((2, count), "uint8"),
        }

    def find_reflections_through_shell(self) -> Arguments:
        count = self.side(99)
        meridian = self.floats(self.side(30), 8)
        return {
            "mirror": (meridian, 1.0, 20.0, self.b.copy(np.eye(3)), self.floats(3)),
            "shell": self.shell(),
            "ends": (-100.0, 100.0),
            "search": (20, 0.3, 1e-9),
            "pupils": (self.floats(count, 3), False),
            "targets": (self.floats(count, 3, high=300), bool(self.random.integers(0, 2))),
            "xy": self.floats(count, 2, high=20),
            "converged": self.b.empty((count,), "uint8"),
        }

    # -- all

    def set_threads(self) -> Arguments:
        return {"count": int(self.random.integers(1, 5))}

    def get_threads(self) -> Arguments:
        return {}

    def instruction_set(self) -> Arguments:
        return {}

    def set_instruction_set(self) -> Arguments:
        return {
            "name": str(
                self.random.choice(["plain", "avx2", "avx512", "avx512-gather", "neon", "mmx"])
            )
        }


def functions_of(module: Any) -> Iterator[tuple[str, Callable[..., Any]]]:
    """Yield names and functions of a module, with constructors and methods: ``PackedMap``,
    ``PackedMap.sample``, ..."""
    for name, value in vars(module).items():
        if name.startswith("_") or not callable(value):
            continue
        yield name, value
        if isinstance(value, type):
            for method, function in vars(value).items():
                if not method.startswith("_") and callable(function):
                    yield f"{name}.{method}", function


# -- invalid arguments ----------------------------------------------------------------------------


def invalid_array(array: np.ndarray, others: list[np.ndarray], b: Buffers) -> Any:
    """Return an array with one modification."""
    random = b.random
    defect = int(random.integers(0, 11))
    if defect == 0:  # some values
        changed = b.copy(array)
        if changed.size:
            at = random.integers(0, changed.size, int(random.integers(1, 1 + changed.size)))
            real = [value for value in ODD_NUMBERS if isinstance(value, float)]
            odd = real if array.dtype.kind == "f" else [-1, -2, 2**31 - 1, 9]
            with np.errstate(all="ignore"):
                changed.reshape(-1)[at] = np.asarray(random.choice(odd, len(at))).astype(
                    array.dtype
                )
        return changed
    if defect == 1:
        return b.copy(
            np.full(array.shape, np.nan) if array.dtype.kind == "f" else np.full_like(array, 127)
        )
    if defect == 2:  # another length along an axis
        shape = list(array.shape) or [1]
        shape[int(random.integers(0, len(shape)))] = int(random.choice([0, 1, 2, 3, 5, 17]))
        return b.copy(np.resize(array, shape) if array.size else np.zeros(shape), array.dtype)
    if defect == 3:
        with np.errstate(all="ignore"):
            return b.copy(array.real, str(random.choice(TYPES)))
    if defect == 4:
        return b.copy(array, odd=int(random.integers(1, 8)))
    if defect == 5:  # with gaps
        return np.repeat(b.copy(array), 2, axis=-1)[..., ::2] if array.ndim else array
    if defect == 6:
        return b.copy(array)[::-1] if array.ndim else array
    if defect == 7:  # memory of another argument
        other = others[int(random.integers(0, len(others)))]
        if other.flags.c_contiguous and other.nbytes >= array.nbytes and array.nbytes:
            return (
                other.reshape(-1)
                .view(np.uint8)[: array.nbytes]
                .view(array.dtype)
                .reshape(array.shape)
            )
        return other
    if defect == 8:
        return b.copy(array[0] if array.ndim and len(array) else array.reshape(-1))
    if defect == 9:
        changed = b.copy(array)
        changed.flags.writeable = False
        return changed
    return (
        b.copy(array)[np.newaxis] if random.random() < 0.5 else np.broadcast_to(array, array.shape)
    )


def invalid(value: Any, others: list[np.ndarray], b: Buffers) -> Any:
    """Return an argument with one modification."""
    random = b.random
    if isinstance(value, np.ndarray) and random.random() < 0.9:
        return invalid_array(value, others, b)
    if isinstance(value, tuple) and value and random.random() < 0.9:
        at = int(random.integers(0, len(value)))
        return (*value[:at], invalid(value[at], others, b), *value[at + 1 :])
    return ODD_NUMBERS[int(random.integers(0, len(ODD_NUMBERS)))]


def arrays_in(value: Any) -> list[np.ndarray]:
    if isinstance(value, tuple):
        return [array for part in value for array in arrays_in(part)]
    return [value] if isinstance(value, np.ndarray) else []


def run(calls: int, seed: int) -> dict[str, tuple[int, int]]:
    """Call functions in turn; return the numbers of completed and rejected calls of each."""
    module, instructions = backend.kernels, instructions_of_machine()
    functions = dict(functions_of(module))
    counts = dict.fromkeys(functions, (0, 0))
    names = sorted(functions)
    for number in range(calls):
        name = names[number % len(names)]
        b = Buffers(np.random.default_rng([seed, number]))
        module.set_instruction_set(str(b.random.choice(instructions)))
        recipes = Recipes(b, module)
        call = getattr(recipes, name.replace(".", "_"))()
        bound, arguments = call if isinstance(call, tuple) else (None, call)
        for _ in range(int(b.random.integers(0, 4))):
            if arguments:
                argument_name = str(b.random.choice(sorted(arguments)))
                arguments[argument_name] = invalid(
                    arguments[argument_name],
                    arrays_in(tuple(arguments.values())) or [np.zeros(3)],
                    b,
                )
        function = functions[name]
        completed, rejected = counts[name]
        try:
            result = function(**arguments) if bound is None else function(bound, **arguments)
            if name in ("PackedMap", "Surfaces"):
                result.nbytes if name == "PackedMap" else result.records.sum()
            counts[name] = completed + 1, rejected
        except REJECTIONS:
            counts[name] = completed, rejected + 1
        b.check()
        if name == "set_threads":
            module.set_threads(2)
    return counts


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=3000, help="Number of calls.")
    parser.add_argument("--seed", type=int, default=0, help="Random seed.")
    options = parser.parse_args()
    faulthandler.enable()
    for name, (completed, rejected) in run(options.calls, options.seed).items():
        print(f"{name}: {completed} completed, {rejected} rejected")


if __name__ == "__main__":
    main()
