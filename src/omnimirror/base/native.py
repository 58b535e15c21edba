"""Interface to the compiled extension: availability, instruction set, threads and kernels.

The environment variable ``OMNIMIRROR_NATIVE`` set to ``0`` disables the extension; set to
``plain``, ``avx2``, ``avx512``, ``avx512-gather`` or ``neon`` it selects the instruction set of the
samplers instead of the best available. native/README.md describes the compiled code, its formulas
and its tests.
"""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import DTypeLike, NDArray

from .caching import cached_property
from .errors import InvalidParameter

MAX_THREADS = 1024
CPU_QUOTA_FILE = Path(
    "/sys/fs/cgroup/cpu.max"
)  # container limit: microseconds per period, and the period
INTERFACE = 17  # version of the kernels, as in native/src/module.cpp
Array = NDArray[Any]
Colour = float | Sequence[float]


def usable_cores() -> int:
    """Return the number of cores available to this process, limited by affinity and container.

    Examples
    --------
    >>> 1 <= usable_cores() <= os.cpu_count()
    True
    """
    affinity = getattr(os, "sched_getaffinity", None)  # Linux only
    count = len(affinity(0)) if affinity else os.cpu_count() or 1
    try:
        quota, period = CPU_QUOTA_FILE.read_text(encoding="ascii").split()
        return max(1, min(count, math.ceil(int(quota) / int(period))))
    except (OSError, ValueError, ZeroDivisionError):  # no such file, or "max"
        return count


def kernel_array(values: Any, dtype: DTypeLike | None = None) -> Array:
    """Return an array as kernels accept it: contiguous, aligned, of the given type; without a copy
    if possible.

    Examples
    --------
    >>> memory = bytearray(8 * 3 + 1)
    >>> kernel_array(np.ndarray(3, float, memory, offset=1)).flags.aligned
    True
    """
    return np.require(values, dtype, ("C_CONTIGUOUS", "ALIGNED"))


class Backend:
    """Computation backend: compiled kernels, or NumPy and OpenCV without them.

    Packages with both implementations check :attr:`is_compiled` to select one, and then use
    :attr:`kernels` without further checks. The only instance is :data:`backend`.

    Examples
    --------
    >>> backend.name in ("avx512", "avx512-gather", "avx2", "neon", "plain", "opencv")
    True
    """

    @cached_property
    def module(self) -> Kernels | None:
        """Compiled module; None if it was not built or is disabled. Imported once, on first use.

        A missing or outdated module is logged: results are the same, but several times slower.
        """
        requested = os.environ.get("OMNIMIRROR_NATIVE", "")
        if requested == "0":
            return None
        try:
            module = import_module("omnimirror.base._native")  # by name, see test_architecture
        except ImportError as e:
            log = logging.getLogger(__name__)
            log.warning(
                "the compiled kernels are missing: images are dewarped by OpenCV, which is several times slower; "
                "install omnimirror again on a computer with a C++20 compiler"
            )
            log.info("%s", e)
            return None
        if getattr(module, "INTERFACE", None) != INTERFACE:
            logging.getLogger(__name__).warning(
                "the compiled kernels belong to another version and are ignored: computations are several times "
                "slower; install omnimirror again"
            )
            return None
        module.set_threads(usable_cores())
        if requested:
            try:
                module.set_instruction_set(requested)
            except ValueError:
                raise InvalidParameter(
                    f"OMNIMIRROR_NATIVE must be 0 or an instruction set of this processor; got {requested!r}"
                ) from None
        return cast(Kernels, module)

    @property
    def is_compiled(self) -> bool:
        """True if compiled kernels are available."""
        return self.module is not None

    @property
    def kernels(self) -> Kernels:
        """Compiled kernels; valid only if :attr:`is_compiled`."""
        if self.module is None:
            raise RuntimeError("the compiled kernels are missing; check backend.is_compiled first")
        return self.module

    @property
    def name(self) -> str:
        """Name of the sampler: ``"avx512"``, ``"avx512-gather"``, ``"avx2"``, ``"neon"``,
        ``"plain"`` or ``"opencv"``.
        """
        return self.module.instruction_set() if self.module is not None else "opencv"

    @property
    def threads(self) -> int:
        """Number of threads for kernels; initially the number of available cores."""
        if self.module is not None:
            return self.module.get_threads()
        import cv2

        return int(cv2.getNumThreads())

    def set_threads(self, count: int) -> None:
        """Set the number of threads for kernels, including the caller; they sleep between images.

        Raises
        ------
        InvalidParameter
            If the count is not between 1 and 1024.
        """
        if not 1 <= count <= MAX_THREADS:
            raise InvalidParameter(
                f"count must be between 1 and {MAX_THREADS} threads; got {count}"
            )
        if self.module is not None:
            self.module.set_threads(count)
        else:
            import cv2

            cv2.setNumThreads(count)


backend = Backend()
"""Backend of this process."""


class Kernels(Protocol):
    """Functions and classes of ``omnimirror.base._native``.

    Arrays must be contiguous unless noted otherwise, aligned, and of exactly the documented type:
    there are no conversions, see :func:`kernel_array`. The extension checks all arrays again, which
    prevents access outside a buffer for any arguments. Names ending in ``_out``, ``dst``,
    ``pixels`` and similar are outputs.
    """

    # -- samplers: dewarp -------------------------------------------------------------------------

    def Averages(
        self,
        taps: Array,
        step: int,
        sharp_px: float,
        annulus: tuple[float, float, float, float] | None,
    ) -> object: ...
    def PackedMap(
        self,
        coordinates: Array,
        width: int,
        height: int,
        channels: int,
        is_deep: bool,
        interpolation: int,
    ) -> PackedMap: ...
    def AxialCamera(
        self,
        frame: Array,
        x: float,
        y: float,
        width: int,
        height: int,
        first: float,
        last: float,
        radii: Array,
        origins: Array,
        viewpoint: float,
    ) -> AxialCamera: ...
    def remap(
        self,
        src: Array,
        coordinates: Array,
        dst: Array,
        interpolation: int,
        border: Colour,
        averages: object = None,
    ) -> None: ...
    def remap_polar(
        self,
        src: Array,
        radii: Array,
        cosines: Array,
        sines: Array,
        x: float,
        y: float,
        dst: Array,
        interpolation: int,
        border: Colour,
        averages: object = None,
    ) -> None: ...
    def remap_lattice(
        self,
        src: Array,
        x: Array,
        y: Array,
        weights: Array,
        row_weights: Array,
        cells: Array,
        patches: Array,
        dst: Array,
        interpolation: int,
        border: Colour,
        averages: object = None,
    ) -> None: ...
    def squared_sides_of_lattice(
        self, x: Array, y: Array, step: int, cells: Array, patches: Array, out: Array
    ) -> None: ...

    # -- batch evaluation of designs: batch -------------------------------------------------------

    def evaluate_designs(
        self,
        coefficients: Array,
        numbers: Array,
        basis: Array,
        fractions: Array,
        has_conic: bool,
        paper: bool,
        pitch: float,
        image_radius: float,
        wavelength: float,
        inverse_distance: Array,
        min_omega: float,
        search: tuple[int, float, float, int, float, int],
        lens: Array,
        lens_numbers: tuple[float, ...],
        shells: Array,
        shell: tuple[int, float, float],
        columns: Array,
        results: Array,
    ) -> None: ...

    # -- exposure and restoration of images: simulate ---------------------------------------------

    def Optics(self, **numbers: Any) -> object: ...
    def Environment(self, light: Array) -> object: ...
    def Surfaces(self, records: Array, sizes: Array, texels: Array) -> CompiledSurfaces: ...
    def BlurKernels(
        self,
        width: int,
        height: int,
        fineness: int,
        firsts: Array,
        offsets: Array,
        weights: Array,
        pixels: Array,
        block: int,
        kernels: Array,
        tiles: Array,
        concentration: Array,
    ) -> object: ...
    def Deconvolution(self, kernels: object, roots: Array, guess: Array) -> Deconvolution: ...
    def expose_environment(
        self,
        optics: object,
        environment: object,
        points: Array,
        shifted: bool,
        seed: int,
        left: int,
        top: int,
        light: Array,
    ) -> None: ...
    def expose_rays(
        self,
        optics: object,
        points: Array,
        shifted: bool,
        seed: int,
        left: int,
        top: int,
        origins: Array,
        directions: Array,
        weights: Array,
        fates: Array,
    ) -> None: ...
    def expose_surfaces(
        self,
        optics: object,
        surfaces: CompiledSurfaces,
        points: Array,
        shifted: bool,
        seed: int,
        left: int,
        top: int,
        light: Array,
        open_pixels: Array,
        open_rays: Array,
    ) -> int: ...

    def intersect_boxes(
        self, corners: Array, origins: Array, directions: Array, distances: Array, faces: Array
    ) -> None: ...
    def are_blocked(
        self, corners: Array, origins: Array, segments: Array, blocked: Array
    ) -> None: ...

    # -- sensors with errors: tolerancing ---------------------------------------------------------

    def evaluate_trials(
        self,
        numbers: Array,
        terms: int,
        is_conic: bool,
        rim: float,
        table: tuple[Array, float],
        object_field: tuple[Array | bool, ...],
        compensators: tuple[Array | int, ...],
        search: tuple[int, float, float, float, int],
        refocus: int,
        floor: float,
        merits: Array,
        displacements: Array,
    ) -> None: ...

    # -- reflection points: tracing, torch --------------------------------------------------------

    def find_reflections(
        self,
        surface: tuple[Any, ...],
        search: tuple[Any, ...],
        by_omega: Array,
        omegas: tuple[float, float],
        middle: float,
        distant: bool,
        targets: Array,
        rows: Array,
        states: Array,
    ) -> None: ...
    def shell_exit(
        self,
        shell: tuple[Any, ...],
        points: Array,
        directions: Array,
        vectors: Array,
        numbers: Array,
        flags: Array,
    ) -> None: ...
    def find_reflections_through_shell(
        self,
        mirror: tuple[Array, float, float, Array, Array],
        shell: tuple[Any, ...],
        ends: tuple[float, float],
        search: tuple[int, float, float],
        pupils: tuple[Array, bool],
        targets: tuple[Array, bool],
        xy: Array,
        converged: Array,
    ) -> None: ...
    def intersect_mirror(
        self,
        surface: tuple[Any, ...],
        search: tuple[Any, ...],
        depth: Array,
        max_tangent: float,
        directions: Array,
        rows: Array,
        states: Array,
    ) -> None: ...

    # -- all --------------------------------------------------------------------------------------

    def set_threads(self, count: int) -> None: ...
    def get_threads(self) -> int: ...
    def instruction_set(self) -> str: ...
    def set_instruction_set(self, name: str) -> None: ...


class PackedMap(Protocol):
    """Coordinates packed to 6 bytes per pixel (8 for high bit depth), for images of one size and
    type.
    """

    @property
    def nbytes(self) -> int: ...
    def sample(
        self,
        src: Array,
        dst: Array,
        border: Colour,
        coordinates: Array | None = None,
        averages: object = None,
    ) -> None: ...


class AxialCamera(Protocol):
    """Projection of a camera that is symmetric about an axis, from tables."""

    def project(
        self, targets: Array, is_near: bool, pixels: Array, excess: Array | None
    ) -> None: ...


class CompiledSurfaces(Protocol):
    """Plane textured surfaces, with the nearest intersection of a ray."""

    @property
    def records(self) -> Array: ...

    def radiance(
        self, origins: Array, directions: Array, light: Array, distances: Array
    ) -> None: ...


class Deconvolution(Protocol):
    """State of an image restoration."""

    def improve(self, costs: Array, steps: Array) -> None: ...
    def log_steepness(self, logarithms: Array) -> None: ...
    def blurred(self, light: Array) -> None: ...
    def light(self, light: Array) -> None: ...
