"""The compiled samplers; absent where they could not be built. Call them through omnimirror.dewarp.sampling.remap."""

from collections.abc import Sequence
from typing import Any

from numpy.typing import NDArray

Border = float | Sequence[float]

class Averages:
    def __init__(
        self, taps: NDArray[Any], step: int, sharp: float, ring: tuple[float, float, float, float] | None
    ) -> None: ...

def squares_of_nodes(
    x: NDArray[Any], y: NDArray[Any], step: int, cells: NDArray[Any], patches: NDArray[Any], out: NDArray[Any]
) -> None: ...
def remap(
    src: NDArray[Any],
    coordinates: NDArray[Any],
    dst: NDArray[Any],
    interpolation: int,
    border: Border,
    averages: Averages | None = None,
) -> None: ...
def remap_polar(
    src: NDArray[Any],
    radii: NDArray[Any],
    cosines: NDArray[Any],
    sines: NDArray[Any],
    x: float,
    y: float,
    dst: NDArray[Any],
    interpolation: int,
    border: Border,
    averages: Averages | None = None,
) -> None: ...
def remap_grid(
    src: NDArray[Any],
    x: NDArray[Any],
    y: NDArray[Any],
    weights: NDArray[Any],
    row_weights: NDArray[Any],
    cells: NDArray[Any],
    patches: NDArray[Any],
    dst: NDArray[Any],
    interpolation: int,
    border: Border,
    averages: Averages | None = None,
) -> None: ...
def evaluate_designs(
    coefficients: NDArray[Any],
    numbers: NDArray[Any],
    basis: NDArray[Any],
    fractions: NDArray[Any],
    has_conic: bool,
    paper: bool,
    pitch: float,
    image_radius: float,
    wavelength: float,
    inverse_distance: float,
    least_omega: float,
    columns: NDArray[Any],
    results: NDArray[Any],
) -> None: ...

class PackedMap:
    def __init__(
        self, coordinates: NDArray[Any], width: int, height: int, channels: int, deep: bool, interpolation: int
    ) -> None: ...
    def sample(
        self,
        src: NDArray[Any],
        dst: NDArray[Any],
        border: Border,
        coordinates: NDArray[Any] | None = None,
        averages: Averages | None = None,
    ) -> None: ...
    @property
    def nbytes(self) -> int: ...

class AxialCamera:
    def __init__(
        self,
        frame: NDArray[Any],
        x: float,
        y: float,
        width: int,
        height: int,
        first: float,
        last: float,
        radii: NDArray[Any],
        origins: NDArray[Any],
        eye: float,
    ) -> None: ...
    def project(
        self, targets: NDArray[Any], is_near: bool, pixels: NDArray[Any], excess: NDArray[Any] | None
    ) -> None: ...

def set_threads(count: int) -> None: ...
def get_threads() -> int: ...
def instructions() -> str: ...
def use_instructions(name: str) -> None: ...

class Optics:
    def __init__(self, **numbers: Any) -> None: ...

class Environment:
    def __init__(self, light: NDArray[Any]) -> None: ...

def expose_environment(
    optics: Optics,
    environment: Environment,
    points: NDArray[Any],
    shifted: bool,
    seed: int,
    left: int,
    top: int,
    light: NDArray[Any],
) -> None: ...
def expose_rays(
    optics: Optics,
    points: NDArray[Any],
    shifted: bool,
    seed: int,
    left: int,
    top: int,
    origins: NDArray[Any],
    directions: NDArray[Any],
    weights: NDArray[Any],
    fates: NDArray[Any],
) -> None: ...

class Surfaces:
    def __init__(
        self,
        places: NDArray[Any],
        texel_places: NDArray[Any],
        kinds: NDArray[Any],
        sizes: NDArray[Any],
        texels: NDArray[Any],
    ) -> None: ...
    def radiance(
        self, origins: NDArray[Any], directions: NDArray[Any], light: NDArray[Any], distances: NDArray[Any]
    ) -> None: ...
