"""Lens files: field tables (.csv) and sequential Zemax prescriptions (.zmx)."""

from __future__ import annotations

import csv
from dataclasses import dataclass, field
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arguments import format_value, parse_float
from ...base.errors import OmnimirrorError, SpecError
from ...base.files import MAX_TEXT_BYTES, read_bytes, read_text
from ..materials import Glass, GlassCatalogue, glass_named, model_glass, read_agf
from ._sequential_tracing import SEARCH_TANGENTS, Sequence, Traced, chief_heights

# -- Files named in lens tables --------------------------------------------------------------------


def split_file_entry(
    table: dict[str, Any], folder: Path | None, entry: str, noun: str
) -> tuple[dict[str, Any], Path | None]:
    """Return the table without an entry that names a file, and the file; None if it names none.

    Only files named on the user's command line have a ``folder``; with None, the table must not
    name a file.

    Raises
    ------
    SpecError
        If the table must not name a file, or the name is not a string.

    Examples
    --------
    >>> split_file_entry({"file": "/etc/passwd"}, None, "file", "the surfaces")
    Traceback (most recent call last):
    ...
    omnimirror.base.errors.SpecError: lens.file must not name a file here; enter the surfaces instead
    """
    if entry not in table:
        return dict(table), None
    if folder is None:
        raise SpecError(f"lens.{entry} must not name a file here; enter {noun} instead")
    name = table[entry]
    if not isinstance(name, str):
        raise SpecError(f"lens.{entry} must be a file name in quotes; got {format_value(name)}")
    return {k: v for k, v in table.items() if k != entry}, folder / name


# -- Lens tables in CSV files ----------------------------------------------------------------------


def read_lens_table(
    table: dict[str, Any], folder: Path | None, columns: tuple[str, ...]
) -> dict[str, Any]:
    """Return a lens table with the columns of its CSV ``file`` instead of the file name.

    Raises
    ------
    OmnimirrorError
        If the table must not name a file, or the file is missing, has other columns, or has rows
        that are not numeric.
    """
    entries, path = split_file_entry(table, folder, "file", "its columns")
    if path is None:
        return entries
    text = read_text(path, "lens table", SpecError)
    lines = [
        (i, line)
        for i, line in enumerate(text.splitlines(), 1)
        if line.strip() and not line.startswith("#")
    ]
    if not lines:
        raise SpecError(f"{path} is empty; a lens table must start with a row of column names")
    rows = [
        (number, row)
        for (number, _), row in zip(lines, csv.reader(line for _, line in lines), strict=True)
    ]
    names = [name.strip() for name in rows[0][1]]
    for name in names:
        if name not in columns:
            valid = ", ".join(columns)
            raise SpecError(
                f"{path} line {rows[0][0]}: unknown column {format_value(name)}; use {valid}"
            )
    columns_by_name: dict[str, list[float]] = {name: [] for name in names}
    for number, row in rows[1:]:
        try:
            for name, cell in zip(names, row, strict=True):
                columns_by_name[name].append(parse_float(cell))
        except ValueError:
            raise SpecError(
                f"{path} line {number}: the row must contain {len(names)} numbers, one per "
                f"column; got {format_value(','.join(row))}"
            ) from None
    return columns_by_name | entries


# -- Sequential Zemax lens files (.zmx) ------------------------------------------------------------

UNITS = {"MM": 1.0, "CM": 10.0, "IN": 25.4, "METER": 1000.0}
SHAPES = ("STANDARD", "EVENASPH")
LINES_UM = (0.4861327, 0.5875618, 0.6562725)  # F, d and C, for files without wavelengths
MAX_FOCUS_MM = 1e6  # finite substitute for a focus at infinity
MODEL_GLASS = "___BLANK"
PER_SURFACE = (
    "curvature_per_mm",
    "thickness_mm",
    "index",
    "conic",
    "edge_mm",
    "clear_mm",
    "index_short",
    "index_long",
)


@dataclass
class _Surface:
    """Surface as defined in the file, in file units."""

    line: int
    curvature: float = 0.0
    thickness: float = 0.0
    conic: float = 0.0
    glass: list[str] = field(default_factory=list)
    terms: dict[int, float] = field(default_factory=dict)
    edge: float = 0.0
    clear: float = 0.0
    is_stop: bool = False
    is_asphere: bool = False


@dataclass
class _File:
    """Contents of a file."""

    path: Path
    surfaces: list[_Surface] = field(default_factory=list)
    unit: str = "MM"
    makers: tuple[str, ...] = ()
    waves: dict[int, float] = field(default_factory=dict)
    primary: int = 1
    aperture: tuple[str, float] | None = None
    field_type: int = 0
    field_count: int | None = None
    fields: dict[str, list[float]] = field(default_factory=dict)

    def error(self, message: str, line: int | None = None) -> SpecError:
        return SpecError(f"{self.path}{f' line {line}' if line else ''}: {message}")


def read_lens_file(table: dict[str, Any], folder: Path | None) -> dict[str, Any]:
    """Return a lens table with the surfaces of its .zmx ``file`` instead of the file name.

    Other entries (``focus_distance_mm``, ``f_number``, ``field_max_deg``) take precedence over the
    file.

    Raises
    ------
    OmnimirrorError
        If the table must not name a file, or the file is missing or not a supported lens.
    """
    entries, path = split_file_entry(table, folder, "file", "the surfaces")
    if path is None:
        return entries
    catalogue = None
    if "glass_catalogue" in entries:
        entries, agf = split_file_entry(entries, folder, "glass_catalogue", "the indices")
        assert agf is not None
        catalogue = read_agf(agf)
    return read_zmx(path, catalogue) | entries


def read_zmx(path: Path, catalogue: GlassCatalogue | None = None) -> dict[str, Any]:
    """Read a .zmx file as the table of a lens of kind ``surfaces``.

    Glasses of ``catalogue`` take precedence over the bundled ones.

    Raises
    ------
    OmnimirrorError
        If the file is missing, has several configurations, or has unknown glasses or surface types.
    """
    lens_file = _parse(path, _text(path))
    if len(lens_file.surfaces) < 4:
        raise lens_file.error(
            "the lens must have object, image and at least two surfaces in between "
            f"(SURF); got {len(lens_file.surfaces)} surfaces"
        )
    lens = lens_file.surfaces[1:-1]
    stops = [i for i, surface in enumerate(lens, start=1) if surface.is_stop]
    if len(stops) != 1:
        raise lens_file.error(
            f"exactly one surface between object and image must be the stop (STOP); got {len(stops)}"
        )
    scale = UNITS[lens_file.unit]
    short, primary, long = _wavelengths(lens_file)
    glasses = [_glass(lens_file, surface, catalogue) for surface in lens]
    table: dict[str, Any] = {
        "curvature_per_mm": [s.curvature / scale for s in lens],
        "thickness_mm": [s.thickness * scale for s in lens[:-1]] + [0.0],
        "conic": [s.conic for s in lens],
        "edge_mm": [s.edge * scale for s in lens],
        "clear_mm": [s.clear * scale for s in lens],
        "stop_surface": stops[0],
        "wavelengths_nm": [1e3 * w for w in (short, primary, long)],
    }
    terms = max((k for s in lens if s.is_asphere for k, v in s.terms.items() if v), default=0)
    if terms:
        powers = range(1, terms + 1)
        table["aspheres"] = [
            s.terms.get(j, 0.0) * scale ** (1 - 2 * j) if s.is_asphere else 0.0
            for s in lens
            for j in powers
        ]
    for name, wave in (("index", primary), ("index_short", short), ("index_long", long)):
        table[name] = [_index(lens_file, s, g, wave) for s, g in zip(lens, glasses, strict=True)]
    if not all(np.isfinite(table["thickness_mm"])):
        raise lens_file.error(
            "distances between lens surfaces must be finite (DISZ); only the object distance may be infinite"
        )
    return table | _opening(lens_file, table, scale)


def _opening(lens_file: _File, table: dict[str, Any], scale: float) -> dict[str, Any]:
    """Return F-number and focus, from the file's aperture and imager position."""
    count = len(table["index"])
    rows = np.reshape(table.get("aspheres", ()), (count, -1))
    sequence = Sequence(
        np.array(table["curvature_per_mm"]),
        np.array(table["conic"]),
        rows,
        np.array(table["thickness_mm"]),
        np.array([1.0, *table["index"]]),
        np.full(count, np.inf),
        np.full(count, np.inf),
        table["stop_surface"] - 1,
    )
    paraxial = sequence.paraxial()
    f = paraxial.focal_length
    a, b, c, d = paraxial.back
    to_imager = lens_file.surfaces[-2].thickness * scale
    # object distance imaged at the imager: -(a L + b)/(c L + d) = to_imager
    distance = -(b + d * to_imager) / (a + c * to_imager) if a + c * to_imager else np.inf
    if not 0 < distance < MAX_FOCUS_MM:
        distance = MAX_FOCUS_MM  # focused at infinity, or slightly beyond to balance aberrations
    kind, value = lens_file.aperture or ("", 0.0)
    if kind == "ENPD":
        diameter = value * scale
    elif kind == "FNUM":
        diameter = f / value
    else:  # limited by the edge of the stop
        diameter = (
            2 * abs(paraxial.pupil_magnification) * table["edge_mm"][table["stop_surface"] - 1]
        )
    if not (np.isfinite(f) and diameter > 0):
        raise lens_file.error(
            "the aperture is missing; define it by ENPD, FNUM, or the radius of the stop (DIAM)"
        )
    opening = {"f_number": abs(f) / diameter, "focus_distance_mm": float(distance)}
    tangent = _field_tangent(lens_file, sequence, scale, float(distance), to_imager)
    if not tangent > 0:
        return opening
    max_angle_deg = 1.05 * float(np.degrees(np.arctan(tangent)))
    return opening | {"field_max_deg": min(max(max_angle_deg, 1.0), 80.0)}


def _field_tangent(
    lens_file: _File, sequence: Sequence, scale: float, focus_mm: float, to_imager: float
) -> float:
    """Return the tangent of the largest field of the file (XFLN, YFLN); 0 if it defines none.

    Fields are angles, object heights, paraxial image heights or real image heights (FTYP 0 to 3).
    The edges of the surfaces (DIAM) do not define the field: they clip rays.
    """
    columns = [lens_file.fields.get(key, [])[: lens_file.field_count] for key in ("XFLN", "YFLN")]
    points = np.array(list(zip_longest(*columns, fillvalue=0.0)), dtype=float).reshape(-1, 2)
    if lens_file.field_type == 0:
        return float(np.hypot(*np.tan(np.radians(points)).T).max(initial=0.0))
    max_height = scale * float(np.hypot(*points.T).max(initial=0.0))
    paraxial = sequence.paraxial()
    pupil, (a, _, c, _) = paraxial.entrance_pupil, paraxial.back
    if lens_file.field_type == 1:
        return max_height / (focus_mm + pupil)
    if lens_file.field_type == 2:  # ray of unit slope through the centre of the entrance pupil
        _, b, _, d = paraxial.back
        return max_height / abs((b - a * pupil) + to_imager * (d - c * pupil))
    traced = Traced(
        sequence, to_imager, -pupil, 1e-3 * abs(paraxial.focal_length), np.inf, focus_mm
    )
    heights = traced.trace_to_imager(SEARCH_TANGENTS, chief_heights(traced, SEARCH_TANGENTS)).image[
        :, 0
    ]
    grows = np.isfinite(heights) & (np.diff(heights, prepend=0.0) > 0)
    count = len(grows) if grows.all() else int(np.argmin(grows))
    return float(np.interp(max_height, [0.0, *heights[:count]], [0.0, *SEARCH_TANGENTS[:count]]))


def _text(path: Path) -> str:
    """Read the text of a file in UTF-16, UTF-8 or an 8-bit encoding."""
    try:
        data = read_bytes(path, MAX_TEXT_BYTES)
    except OSError as e:
        raise SpecError(f"cannot read {path}: {e.strerror or e}") from None
    for code in ("utf-16",) if data[:2] in (b"\xff\xfe", b"\xfe\xff") else ("utf-8-sig", "latin-1"):
        try:
            return data.decode(code)
        except UnicodeDecodeError:
            continue
    raise SpecError(f"{path} must be a text file in UTF-8 or UTF-16")


def _parse(path: Path, text: str) -> _File:
    lens_file = _File(path)
    for number, line in enumerate(text.splitlines(), start=1):
        words = line.split()
        if not words:
            continue
        try:
            _parse_line(lens_file, number, words)
        except SpecError:
            raise
        except (ValueError, IndexError):
            raise lens_file.error(
                f"cannot parse the line {format_value(line.strip())}", number
            ) from None
    return lens_file


def _parse_line(lens_file: _File, number: int, words: list[str]) -> None:
    """Parse one line of the file."""
    key, values = words[0], words[1:]
    if key == "SURF":
        lens_file.surfaces.append(_Surface(number))
    elif key == "UNIT":
        if values[0].upper() not in UNITS:
            raise lens_file.error(
                f"UNIT must be one of {', '.join(UNITS)}; got {values[0]}", number
            )
        lens_file.unit = values[0].upper()
    elif key == "MODE" and values[0] != "SEQ":
        raise lens_file.error(f"MODE must be SEQ (sequential); got {values[0]}", number)
    elif key == "GCAT":
        lens_file.makers = tuple(values)
    elif key == "ENPD" or (key == "FNUM" and len(values) > 1 and not int(float(values[1]))):
        lens_file.aperture = key, float(values[0])
    elif key in ("FNUM", "OBNA", "FLOA") and lens_file.aperture is None:
        lens_file.aperture = ("FLOA", 0.0) if key == "FLOA" else None
    elif key == "FTYP":
        lens_file.field_type = int(values[0])
        lens_file.field_count = int(values[2]) if len(values) > 2 else None
    elif key in ("XFLN", "YFLN"):
        lens_file.fields[key] = [float(v) for v in values]
    elif key == "WAVM":
        lens_file.waves[int(values[0])] = float(values[1])
    elif key == "PWAV":
        lens_file.primary = int(values[0])
    elif key == "MNUM" and int(values[0]) > 1:
        raise lens_file.error(
            f"MNUM must be 1; got {values[0]} configurations; save one configuration separately",
            number,
        )
    elif lens_file.surfaces:
        _parse_surface_line(lens_file, lens_file.surfaces[-1], number, key, values)


def _parse_surface_line(
    lens_file: _File, surface: _Surface, number: int, key: str, values: list[str]
) -> None:
    """Parse one line of a surface."""
    if key == "TYPE":
        if values[0] not in SHAPES:
            raise lens_file.error(f"TYPE must be {' or '.join(SHAPES)}; got {values[0]}", number)
        surface.is_asphere = values[0] == "EVENASPH"
    elif key == "CURV":
        surface.curvature = float(values[0])
    elif key == "DISZ":
        surface.thickness = np.inf if values[0].upper().startswith("INF") else float(values[0])
    elif key == "CONI":
        surface.conic = float(values[0])
    elif key == "PARM":
        surface.terms[int(values[0])] = float(values[1])
    elif key == "GLAS":
        if values[0].upper() == "MIRROR":
            raise lens_file.error(
                "GLAS must be a glass: lenses with mirror surfaces are not supported; got MIRROR",
                number,
            )
        surface.glass, surface.line = values, number
    elif key == "DIAM":
        surface.edge = float(values[0])
        if len(values) > 1 and int(float(values[1])) == 1:  # fixed by the designer
            surface.clear = surface.edge
    elif key in ("CLAP", "FLAP"):
        surface.clear = float(values[1])
    elif key in ("SQAP", "ELAP", "CLAO", "UDAO"):
        raise lens_file.error(f"apertures must be circular and centred (CLAP); got {key}", number)
    elif key == "STOP":
        surface.is_stop = True


def _wavelengths(lens_file: _File) -> tuple[float, float, float]:
    """Return shortest, primary and longest wavelength, um, without the unused entries of Zemax."""
    waves = dict(lens_file.waves)
    if len(waves) == 24:  # the maximum number
        filled = waves[24]
        waves = {k: v for k, v in waves.items() if v != filled or k == lens_file.primary}
    primary = waves.get(lens_file.primary, LINES_UM[1])
    wavelengths = [*waves.values(), primary] if waves else list(LINES_UM)
    return min(wavelengths), primary, max(wavelengths)


def _glass(lens_file: _File, surface: _Surface, catalogue: GlassCatalogue | None) -> Glass | None:
    """Return the glass after a surface; None for air."""
    if not surface.glass:
        return None
    name, *numbers = surface.glass
    if name.upper() == MODEL_GLASS:
        return model_glass(float(numbers[2]), float(numbers[3]))
    try:
        return glass_named(name, lens_file.makers, catalogue)
    except OmnimirrorError as e:
        raise lens_file.error(str(e), surface.line) from None


def _index(lens_file: _File, surface: _Surface, glass: Glass | None, wavelength_um: float) -> float:
    if glass is None:
        return 1.0
    try:
        return glass.index(wavelength_um)
    except OmnimirrorError as e:
        raise lens_file.error(str(e), surface.line) from None
