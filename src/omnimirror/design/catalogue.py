"""Catalogues of off-the-shelf lenses, imagers, mirror balls and domes, in TOML or CSV format."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar

from ..base.arguments import format_value, parse_float, validate_arguments
from ..base.caching import cached_property
from ..base.errors import InvalidParameter, OmnimirrorError
from ..base.files import parse_toml, read_text
from ..base.parameters import Parameter
from ..base.toml_validation import did_you_mean
from ..optics.lenses import SurfaceLens
from ..optics.materials import MATERIAL_NAMES

RINGS = Parameter(
    "mm", 1e-3, 1e3, "thicknesses of available extension rings between lens and camera"
)
F_NUMBER = Parameter("", 0.1, 1e3, "F-number")


BUNDLED = Path(__file__).with_name("typical.toml")
"""Bundled catalogue of real parts, with the sources of their data."""

TYPICAL = "typical"
"""Name of the bundled catalogue."""

OUTSIDE = {
    "price": Parameter("", 0.0, 1e7, "price, in the same currency for the whole catalogue"),
    "mass_g": Parameter("g", 0.0, 1e6, "mass"),
    "diameter_mm": Parameter("mm", 0.1, 1e4, "largest diameter"),
    "length_mm": Parameter("mm", 0.1, 1e4, "length along the axis"),
}
"""Optional external properties of a part; None if unknown."""


@dataclass(frozen=True, kw_only=True)
class Component:
    """Catalogue entry.

    Parameters
    ----------
    price
        Price, in one currency for the whole catalogue.
    mass_g, diameter_mm, length_mm
        Mass and external dimensions (length along the axis); None if unknown.
    source
        Source of the data.
    """

    PARAMETERS: ClassVar[dict[str, Parameter]]
    KIND: ClassVar[str]
    name: str
    price: float | None = None
    mass_g: float | None = None
    diameter_mm: float | None = None
    length_mm: float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        for name, p in (self.PARAMETERS | OUTSIDE).items():
            value = getattr(self, name)
            if value is not None and value != ():
                p.check(f"{self.name}: {name}", value)


@dataclass(frozen=True)
class LensComponent(Component):
    """Entocentric lens.

    Parameters
    ----------
    minimum_focus_mm
        Minimum object distance without extension rings, from the principal point.
    image_circle_mm
        Image circle diameter; None if unknown.
    extension_rings_mm
        Thicknesses of the available extension rings, each usable once.
    mount
        Compatible mounts, separated by spaces, for example ``"C"`` or ``"M12"``; empty for any
        mount.
    file
        Surface data in a .zmx file; focal length and F-numbers default to those of the file.
    """

    name: str
    focal_length_mm: float
    f_number_min: float
    f_number_max: float
    minimum_focus_mm: float
    image_circle_mm: float | None = None
    extension_rings_mm: tuple[float, ...] = ()
    mount: str = ""
    file: str = ""

    KIND: ClassVar[str] = "lens"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 0.1, 1e4, "focal length"),
        "f_number_min": F_NUMBER,
        "f_number_max": F_NUMBER,
        "minimum_focus_mm": Parameter(
            "mm", 0.1, 1e6, "minimum object distance in focus, from the principal point"
        ),
        "image_circle_mm": Parameter("mm", 0.1, 1e3, "diameter of the image circle"),
        "extension_rings_mm": RINGS,
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_f_numbers(self.name, self.f_number_min, self.f_number_max)
        if self.minimum_focus_mm <= self.focal_length_mm:
            raise InvalidParameter(
                f"{self.name}: minimum_focus_mm must be greater than the focal length, "
                f"{self.focal_length_mm:g} mm; got {self.minimum_focus_mm:g}"
            )

    @cached_property
    def optics(self) -> SurfaceLens | None:
        """Lens defined by the surfaces of its file, or None."""
        return SurfaceLens.from_file(self.file) if self.file else None


@dataclass(frozen=True)
class TelecentricComponent(Component):
    """Telecentric lens; its front diameter limits the mirror diameter."""

    name: str
    magnification: float
    f_number_min: float
    f_number_max: float
    front_diameter_mm: float
    image_circle_mm: float | None = None
    mount: str = ""

    KIND: ClassVar[str] = "lens"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "magnification": Parameter("", 1e-5, 1e3, "ratio of image size to object size"),
        "f_number_min": F_NUMBER,
        "f_number_max": F_NUMBER,
        "front_diameter_mm": Parameter("mm", 0.1, 1e4, "diameter of the field of objects"),
        "image_circle_mm": Parameter("mm", 0.1, 1e3, "diameter of the image circle"),
    }

    def __post_init__(self) -> None:
        super().__post_init__()
        _check_f_numbers(self.name, self.f_number_min, self.f_number_max)


@dataclass(frozen=True)
class ImagerComponent(Component):
    """Imager or camera."""

    name: str
    width_px: int
    height_px: int
    pixel_pitch_um: float
    mount: str = ""

    KIND: ClassVar[str] = "imager"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "width_px": Parameter("px", 1, 100_000, "number of columns"),
        "height_px": Parameter("px", 1, 100_000, "number of rows"),
        "pixel_pitch_um": Parameter("um", 0.01, 1e4, "pixel pitch"),
    }


@dataclass(frozen=True)
class BallComponent(Component):
    """Mirror ball, complete or a cap."""

    name: str
    ball_diameter_mm: float

    KIND: ClassVar[str] = "ball"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "ball_diameter_mm": Parameter("mm", 0.1, 1e4, "diameter of the reflecting sphere")
    }


@dataclass(frozen=True)
class DomeComponent(Component):
    """Clear dome."""

    name: str
    dome_diameter_mm: float
    wall_mm: float
    material: str = "acrylic"

    KIND: ClassVar[str] = "dome"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "dome_diameter_mm": Parameter("mm", 1.0, 1e4, "outer diameter"),
        "wall_mm": Parameter("mm", 1e-3, 1e3, "thickness of the wall"),
        "material": Parameter("", 0.0, 0.0, "material of the wall", MATERIAL_NAMES),
    }


@dataclass(frozen=True)
class ExtraComponent(Component):
    """Accessory, for example a heater, an arm or a bracket.

    Parameters
    ----------
    use
        Purpose, a single word referenced by requirements, for example ``"heater"``.
    """

    name: str
    use: str

    KIND: ClassVar[str] = "extra"
    PARAMETERS: ClassVar[dict[str, Parameter]] = {}


def mounts_fit(lens: LensComponent | TelecentricComponent, imager: ImagerComponent) -> bool:
    """Check the compatibility of lens and imager mounts; unspecified mounts are compatible.

    >>> lens = LensComponent("8 mm", 8.0, 2.0, 2.0, 70.0, mount="M12")
    >>> mounts_fit(lens, ImagerComponent("A", 1280, 960, 3.0, mount="C CS"))
    False
    """
    return not (lens.mount and imager.mount) or bool(
        set(lens.mount.split()) & set(imager.mount.split())
    )


def _check_f_numbers(name: str, low: float, high: float) -> None:
    if high < low:
        raise InvalidParameter(
            f"{name}: f_number_max must be at least f_number_min = {low:g}; got {high:g}"
        )


@dataclass(frozen=True)
class Catalogue:
    """Available parts."""

    lenses: tuple[LensComponent | TelecentricComponent, ...]
    imagers: tuple[ImagerComponent, ...]
    balls: tuple[BallComponent, ...] = ()
    domes: tuple[DomeComponent, ...] = ()
    extras: tuple[ExtraComponent, ...] = ()


@validate_arguments
def read_catalogue(*paths: str | Path) -> Catalogue:
    """Read and merge catalogue files in TOML (``[[lens]]``, ``[[imager]]`` ...) or CSV format.

    The non-empty cells of a CSV line determine its kind: ``pixel_pitch_um`` for an imager,
    ``magnification`` for a telecentric lens, ``ball_diameter_mm`` for a mirror ball,
    ``dome_diameter_mm`` for a dome, ``use`` for an accessory. Empty cells are ignored;
    ``extension_rings_mm`` contains thicknesses separated by spaces.

    Parameters
    ----------
    *paths
        File names; without arguments, or for the name ``"typical"``, the bundled catalogue.

    Returns
    -------
    Catalogue
        Lenses, imagers, mirror balls, domes and accessories.

    Raises
    ------
    OmnimirrorError
        If the file cannot be read, or an entry is missing, unknown or out of range; with its line
        and column; duplicate name; catalogue without a lens or without an imager.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     with open(f"{folder}/shelf.toml", "w") as file:
    ...         _ = file.write(
    ...             "[[lens]]\\nname = '12 mm'\\nfocal_length_mm = 12.0\\nf_number_min = 1.4\\nf_number_max = 16.0\\n"
    ...             "minimum_focus_mm = 100.0\\n[[imager]]\\nname = '1 MP'\\nwidth_px = 1280\\nheight_px = 1024\\n"
    ...             "pixel_pitch_um = 5.2\\n")
    ...     shelf = om.read_catalogue(f"{folder}/shelf.toml")
    >>> shelf.lenses[0].focal_length_mm, shelf.imagers[0].name
    (12.0, '1 MP')
    """
    parts: list[Component] = []
    names: dict[tuple[str, str], str] = {}
    for path in paths or (TYPICAL,):
        for location, part in _read(BUNDLED if str(path) == TYPICAL else Path(path)):
            if before := names.get((part.KIND, part.name)):
                raise OmnimirrorError(
                    f"{location}: names must be unique; the {part.KIND} {format_value(part.name)} is also in {before}"
                )
            names[part.KIND, part.name] = location
            parts.append(part)
    lenses = tuple(p for p in parts if isinstance(p, LensComponent | TelecentricComponent))
    imagers = tuple(p for p in parts if isinstance(p, ImagerComponent))
    if not lenses or not imagers:
        missing = "lens" if not lenses else "imager"
        raise OmnimirrorError(f"{', '.join(map(str, paths))}: at least one {missing} is required")
    balls = tuple(p for p in parts if isinstance(p, BallComponent))
    domes = tuple(p for p in parts if isinstance(p, DomeComponent))
    return Catalogue(
        lenses, imagers, balls, domes, tuple(p for p in parts if isinstance(p, ExtraComponent))
    )


KINDS: dict[str, tuple[type[Component], ...]] = {
    "lens": (LensComponent, TelecentricComponent),
    "imager": (ImagerComponent,),
    "ball": (BallComponent,),
    "dome": (DomeComponent,),
    "extra": (ExtraComponent,),
}
KIND_BY_ENTRY: dict[str, type[Component]] = {
    "magnification": TelecentricComponent,
    "pixel_pitch_um": ImagerComponent,
    "ball_diameter_mm": BallComponent,
    "dome_diameter_mm": DomeComponent,
    "use": ExtraComponent,
}
"""Entries that identify a kind of part; the default is a lens."""
WORDS = ("name", "source", "material", "mount", "use", "file")
SAME = 0.01  # relative tolerance of the focal length with respect to the file
TABLES = ", ".join(f"[[{kind}]]" for kind in KINDS)


def _read(path: Path) -> Iterable[tuple[str, Component]]:
    """Yield the parts of a file with their locations."""
    text = read_text(path, "catalogue")
    if path.suffix.lower() == ".csv":
        yield from _read_csv(path, text.removeprefix("\ufeff"))
        return
    data = parse_toml(text, str(path))
    for kind, entries in data.items():
        if kind not in KINDS or not isinstance(entries, list):
            raise OmnimirrorError(f"{path}: tables must be {TABLES}; got {kind}")
        for number, entry in enumerate(entries, start=1):
            location = f"{path}, {kind} {number}"
            if not isinstance(entry, dict):
                raise OmnimirrorError(f"{path}: {kind} {number} must be a table, one of {TABLES}")
            part = _part(location, "", _with_file(location, entry, path.parent), KINDS[kind][0])
            if not isinstance(part, KINDS[kind]):
                raise OmnimirrorError(
                    f"{location} has the entries of a {part.KIND}; move it to a table [[{part.KIND}]]"
                )
            yield location, part


def _read_csv(path: Path, text: str) -> Iterable[tuple[str, Component]]:
    rows = csv.reader(io.StringIO(text))
    header = [cell.strip() for cell in next(rows, [])]
    names = sorted({f.name for classes in KINDS.values() for cls in classes for f in fields(cls)})
    if unknown := [name for name in header if name not in names]:
        hint = did_you_mean(unknown[0], names)
        raise OmnimirrorError(
            f"{path} line 1: unknown column {format_value(unknown[0])}{hint}; use {', '.join(names)}"
        )
    if twice := [name for i, name in enumerate(header) if name in header[:i]]:
        raise OmnimirrorError(f"{path} line 1: columns must be unique; {twice[0]} is repeated")
    for cells in rows:
        location = f"{path} line {rows.line_num}"
        if not any(cell.strip() for cell in cells):
            continue
        if len(cells) > len(header):
            raise OmnimirrorError(
                f"{location} must have {len(header)} cells, as many as the header; got {len(cells)}"
            )
        named = zip(header, (cell.strip() for cell in cells), strict=False)
        entry = {name: _number(name, cell) for name, cell in named if cell}
        yield (
            location,
            _part(location, "column ", _with_file(location, entry, path.parent), LensComponent),
        )


def _with_file(where: str, entry: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a lens entry completed with the data of its surface file, if it has one."""
    name = entry.get("file")
    if not (isinstance(name, str) and name):
        return entry
    try:
        optics = SurfaceLens.from_file(folder / name)
    except OmnimirrorError as e:
        raise OmnimirrorError(f"{where}: {e}") from None
    stop = float(optics.f_number)
    own = {"focal_length_mm": optics.focal_length_mm, "f_number_min": stop, "f_number_max": stop}
    focal = entry.get("focal_length_mm", optics.focal_length_mm)
    if _is_number(focal) and abs(focal / optics.focal_length_mm - 1) > SAME:
        raise OmnimirrorError(
            f"{where}: focal_length_mm must be that of {name}, {optics.focal_length_mm:.5g} mm; got {focal:g}; omit it"
        )
    return {**own, **entry, "focal_length_mm": optics.focal_length_mm, "file": str(folder / name)}


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _number(key: str, text: str) -> Any:
    """Parse a CSV cell: text, a list of ring thicknesses, or a number."""
    if key in WORDS:
        return text
    try:
        numbers = tuple(parse_float(part) for part in text.split())
    except ValueError:
        return text
    if key == "extension_rings_mm":
        return numbers
    return numbers[0] if len(numbers) == 1 else text


def _part(where: str, what: str, entry: dict[str, Any], plain: type[Component]) -> Component:
    """Create one part of the kind identified by its entries."""
    cls: type[Any] = next((kind for name, kind in KIND_BY_ENTRY.items() if name in entry), plain)
    field_of = {f.name: f for f in fields(cls)}
    if unknown := [k for k in entry if k not in field_of]:
        raise OmnimirrorError(
            f"{where}: unknown {what or 'entry '}{unknown[0]}; use {', '.join(field_of)}"
        )
    if missing := [k for k, f in field_of.items() if f.default is MISSING and k not in entry]:
        raise OmnimirrorError(
            f"{where}: {what}{missing[0]} is missing; the name and all dimensions of the part are required"
        )
    try:
        part: Component = cls(
            **{key: _value(f"{where}: {what}", key, value, cls) for key, value in entry.items()}
        )
    except InvalidParameter as e:
        raise OmnimirrorError(f"{where}: {e}") from None
    return part


def _value(where: str, key: str, value: Any, cls: type[Component]) -> Any:
    """Validate and convert the value of an entry."""
    if key in WORDS:
        if not (isinstance(value, str) and value):
            raise OmnimirrorError(f"{where}{key} must be a name; got {format_value(value)}")
        return value
    is_list = key == "extension_rings_mm"
    row = tuple(value) if isinstance(value, list | tuple) else (value,)
    if not all(map(_is_number, row)) or (len(row) != 1 and not is_list):
        raise OmnimirrorError(f"{where}{key} must be a number; got {format_value(value)}")
    if is_list:
        return row
    if cls is ImagerComponent and key in ("width_px", "height_px"):
        if row[0] != int(row[0]):
            raise OmnimirrorError(
                f"{where}{key} must be an integer number of pixels; got {row[0]:g}"
            )
        return int(row[0])
    return row[0]
