"""Lists of lenses and imagers that can be bought: TOML with tables, or CSV with a header line."""

from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import MISSING, dataclass, fields
from math import isfinite
from pathlib import Path
from typing import Any, ClassVar

from ..arguments import checked, float_of, shown
from ..errors import InvalidParameter, OmnimirrorError
from ..files import parse_toml, read_text
from ..parameters import Parameter

RINGS = Parameter("mm", 1e-3, 1e3, "thicknesses of the extension rings that fit between lens and camera")
F_NUMBER = Parameter("", 0.1, 1e3, "F-number")


class Component:
    """A line of a catalogue."""

    PARAMETERS: ClassVar[dict[str, Parameter]]
    name: str

    def _check(self) -> None:
        for name, p in self.PARAMETERS.items():
            value = getattr(self, name)
            if value is not None and value != ():
                p.check(f"{self.name}: {name}", value)


@dataclass(frozen=True)
class LensComponent(Component):
    """An ordinary (entocentric) lens.

    Parameters
    ----------
    minimum_focus_mm
        Nearest object in focus without rings, from the lens's principal point.
    image_circle_mm
        Diameter that the lens covers; None where it is not known to matter.
    extension_rings_mm
        Thicknesses of rings at hand, which move the whole lens out, each to be used once.
    """

    name: str
    focal_length_mm: float
    f_number_min: float
    f_number_max: float
    minimum_focus_mm: float
    image_circle_mm: float | None = None
    extension_rings_mm: tuple[float, ...] = ()

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "focal_length_mm": Parameter("mm", 0.1, 1e4, "focal length"),
        "f_number_min": F_NUMBER,
        "f_number_max": F_NUMBER,
        "minimum_focus_mm": Parameter("mm", 0.1, 1e6, "nearest object in focus, from the principal point"),
        "image_circle_mm": Parameter("mm", 0.1, 1e3, "diameter of the image that the lens covers"),
        "extension_rings_mm": RINGS,
    }

    def __post_init__(self) -> None:
        self._check()
        _check_f_numbers(self.name, self.f_number_min, self.f_number_max)
        if self.minimum_focus_mm <= self.focal_length_mm:
            raise InvalidParameter(
                f"{self.name}: minimum_focus_mm = {self.minimum_focus_mm:g} is not beyond the focal length "
                f"{self.focal_length_mm:g}"
            )


@dataclass(frozen=True)
class TelecentricComponent(Component):
    """A telecentric lens; the mirror has to fit into its front."""

    name: str
    magnification: float
    f_number_min: float
    f_number_max: float
    front_diameter_mm: float
    image_circle_mm: float | None = None

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "magnification": Parameter("", 1e-5, 1e3, "image size over object size"),
        "f_number_min": F_NUMBER,
        "f_number_max": F_NUMBER,
        "front_diameter_mm": Parameter("mm", 0.1, 1e4, "diameter of the objects that the lens sees"),
        "image_circle_mm": Parameter("mm", 0.1, 1e3, "diameter of the image that the lens covers"),
    }

    def __post_init__(self) -> None:
        self._check()
        _check_f_numbers(self.name, self.f_number_min, self.f_number_max)


@dataclass(frozen=True)
class ImagerComponent(Component):
    """An imager or a camera."""

    name: str
    width_px: int
    height_px: int
    pixel_pitch_um: float

    PARAMETERS: ClassVar[dict[str, Parameter]] = {
        "width_px": Parameter("px", 1, 100_000, "number of columns"),
        "height_px": Parameter("px", 1, 100_000, "number of rows"),
        "pixel_pitch_um": Parameter("um", 0.01, 1e4, "distance of neighbouring pixels"),
    }

    def __post_init__(self) -> None:
        self._check()


def _check_f_numbers(name: str, low: float, high: float) -> None:
    if high < low:
        raise InvalidParameter(f"{name}: f_number_max = {high:g} is below f_number_min = {low:g}")


@dataclass(frozen=True)
class Catalogue:
    """What can be bought."""

    lenses: tuple[LensComponent | TelecentricComponent, ...]
    imagers: tuple[ImagerComponent, ...]


@checked
def read_catalogue(*paths: str | Path) -> Catalogue:
    """The parts of all files together: TOML files with ``[[lens]]`` and ``[[imager]]`` tables, and CSV files.

    A CSV file has one kind of part, which its columns tell: ``pixel_pitch_um`` is an imager's, ``magnification`` a
    telecentric lens's. Empty cells are left out; ``extension_rings_mm`` holds thicknesses parted by spaces.

    Parameters
    ----------
    *paths
        Names of the files.

    Returns
    -------
    Catalogue
        Its lenses and its imagers.

    Raises
    ------
    OmnimirrorError
        A file that cannot be read, an entry that is missing, unknown or out of range, or no lens or no imager at all.

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
    parts = [part for path in paths for part in _read(Path(path))]
    lenses = tuple(p for p in parts if isinstance(p, LensComponent | TelecentricComponent))
    imagers = tuple(p for p in parts if isinstance(p, ImagerComponent))
    if not lenses or not imagers:
        missing = "lens" if not lenses else "imager"
        raise OmnimirrorError(f"there is no {missing} in {', '.join(map(str, paths))}; at least one is needed")
    return Catalogue(lenses, imagers)


def _read(path: Path) -> Iterable[Component]:
    text = read_text(path, "catalogue")
    if path.suffix.lower() == ".csv":
        for number, row in enumerate(csv.DictReader(text.splitlines()), start=2):
            yield _part(f"{path} line {number}", {k: _number(k, v) for k, v in row.items() if k and v})
        return
    data = parse_toml(text, str(path))
    for kind, entries in data.items():
        if kind not in ("lens", "imager") or not isinstance(entries, list):
            raise OmnimirrorError(f"{path}: {kind} is not known; a catalogue has [[lens]] and [[imager]] tables")
        for number, entry in enumerate(entries, start=1):
            if not isinstance(entry, dict):
                raise OmnimirrorError(f"{path}: {kind} {number} is no table; a catalogue has [[lens]] and [[imager]]")
            yield _part(f"{path}, {kind} {number}", entry)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _number(key: str, text: str) -> Any:
    """A cell of a CSV file: words for the name, a list for rings, else a number."""
    if key == "name":
        return text
    try:
        numbers = tuple(float_of(part) for part in text.split())
    except ValueError:
        return text
    if key == "extension_rings_mm":
        return numbers
    return numbers[0] if len(numbers) == 1 else text


def _part(where: str, entry: dict[str, Any]) -> Component:
    """One part, of the kind that its entries tell."""
    cls: type[Any] = LensComponent
    if "magnification" in entry:
        cls = TelecentricComponent
    elif "pixel_pitch_um" in entry:
        cls = ImagerComponent
    known = {f.name: f for f in fields(cls)}
    if unknown := [k for k in entry if k not in known]:
        raise OmnimirrorError(f"{where}: {unknown[0]} is not known; valid are {', '.join(known)}")
    if missing := [k for k, f in known.items() if f.default is MISSING and k not in entry]:
        raise OmnimirrorError(f"{where}: {missing[0]} is missing; needed are name and the part's own numbers")
    values: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in entry.items()}
    for key, value in values.items():
        if key == "name":
            ok = isinstance(value, str) and bool(value)
        elif key == "extension_rings_mm":
            ok = all(map(_is_number, value if isinstance(value, tuple) else (value,)))
            values = values | {key: value if isinstance(value, tuple) else (value,)}
        else:
            ok = _is_number(value)
        if not ok:
            raise OmnimirrorError(f"{where}: {key} = {shown(value)} is not {'a name' if key == 'name' else 'a number'}")
    if cls is ImagerComponent:
        for key in ("width_px", "height_px"):
            if values[key] != int(values[key]):
                raise OmnimirrorError(f"{where}: {key} = {values[key]:g} is not a whole number of pixels")
            values[key] = int(values[key])
    try:
        part: Component = cls(**values)
    except InvalidParameter as e:
        raise OmnimirrorError(f"{where}: {e}") from None
    return part
