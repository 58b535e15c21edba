"""Export of a sensor to CAD files, lens files, tables and drawings: all files or none."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ..analysis.comparison import compare
from ..base.arguments import (
    InvalidType,
    file_name,
    format_value,
    integer,
    number,
    optional_number,
    validate_arguments,
)
from ..base.errors import InvalidParameter, OmnimirrorError, extra_remedy
from ..base.escaping import file_stem
from ..base.files import atomic_output
from ..base.logs import OnProgress
from ..base.registry import Registry
from ..base.results import Result
from ..design.requirement_check import check_requirements
from ..design.requirement_files import load_requirements
from ..design.requirements import Requirements
from ..optics.housing import Housing
from ..optics.sensor import Sensor, check_sensor
from ..optics.tracing.obscuration import Obscuration
from .body import Body, Part, parts_of, with_housing
from .drawings.drawing import Drawing, draw_sheets, write_drawing
from .drawings.sheet import scale_words
from .drawings.tables import DataFile, sag_text
from .formats.sag import table_points, write_grid_sag
from .formats.tool_paths import Tool, write_tool_path
from .formats.zmx import write_zmx
from .workshop import Workshop

LOGGER = logging.getLogger(__name__)
DRAWING_SUFFIXES = (".pdf", ".svg", ".png", ".dxf")
"""Suffixes of files with dimensions and tolerances."""
SECONDARY_MARK, MIRROR_MARK = "-secondary", "-mirror"  # suffixes of file names
ACCURATE_RAY_DEG = 0.01  # maximum ray deviation of an accurate lens file


@dataclass(frozen=True)
class ExportedFile(Result):
    """File that :func:`export` wrote.

    Attributes
    ----------
    path
        Path of the file.
    description
        Short description of the content.
    deviation_um
        Maximum distance of its surface from the mirror; 0 if exact, None for drawings.
    ray_deg
        For lens files, the maximum angle between rays reflected by its surface and by the mirror.
    """

    path: Path
    description: str
    deviation_um: float | None
    ray_deg: float | None = None

    @property
    def follows(self) -> bool:
        """True if reflected rays deviate by less than 0.01 deg from those of the mirror."""
        return self.ray_deg is None or self.ray_deg < ACCURATE_RAY_DEG


@dataclass(frozen=True)
class Plan:
    """Data of one export call for the writers: sensor, parts and resolution of each format."""

    sensor: Sensor
    parts: list[Part]
    housing: Housing | None = None
    chord_tolerance_um: float = 10.0
    step_mm: float | None = None
    step_deg: float | None = None
    digits: int = 6
    grid_points: int = 257
    sheet: str = "A3"
    scale: float | None = None
    tool: Tool | None = None
    workshop: Workshop | None = None
    page: int = 0
    """Sheet of the drawing."""
    drawn: list[Drawing] = field(default_factory=list)
    """Cached drawing, shared by all drawing formats."""

    @property
    def stem(self) -> str:
        """Common stem of the file names."""
        return file_stem(self.sensor.name, "sensor")

    writes_table: bool = False
    """True if the same call writes the sag table."""

    def data_file(self, part: Part) -> DataFile | None:
        """Return the reference to the sag table of a mirror if the same call writes it."""
        if not self.writes_table:
            return None
        name = f"{self.stem}{SECONDARY_MARK if part.is_secondary else ''}-sag.csv"
        return DataFile.of(part, name, self.step_mm, self.step_deg, self.digits)


class Content(NamedTuple):
    """Result of a writer, as described in :class:`ExportedFile`."""

    description: str
    deviation_um: float | None
    ray_deg: float | None = None


Writer = Callable[[Plan, Part, Path], Content]
"""Function that writes the file of one mirror, or of the sensor with all its parts."""


@dataclass(frozen=True)
class Format:
    """Export format: writer, file suffixes, name ending and required packages.

    One file per mirror is written unless the format describes the whole sensor. Drawing formats
    without pages write one file per sheet.
    """

    write: Writer
    suffixes: tuple[str, ...]
    ending: str = ""
    packages: tuple[str, ...] = ()
    shows_sensor: bool = False
    is_one_sheet: bool = False


@validate_arguments
def export(
    sensor: Sensor,
    path: str | Path,
    *,
    formats: Iterable[str] | None = None,
    body: Body | None = None,
    secondary_body: Body | None = None,
    housing: Housing | None = None,
    chord_tolerance_um: float = 10.0,
    step_mm: float | None = None,
    step_deg: float | None = None,
    digits: int = 6,
    grid_points: int = 257,
    sheet: str = "A3",
    scale: float | None = None,
    tool: Tool | None = None,
    workshop: Workshop | None = None,
    allow_changes: bool = False,
    requirements: Requirements | str | Path | None = None,
    on_progress: OnProgress | None = None,
) -> list[ExportedFile]:
    """Export CAD files, lens files, tables and the drawing of a sensor: all files or none.

    Parameters
    ----------
    sensor
        Evaluated sensor.
    path
        Folder, or a file whose suffix selects the format: .step, .stl, .3mf, .dxf, .zmx, .dat (grid
        sag), .csv (sag table), .pdf, .svg or .png (drawing), .nc or .tsv (tool path). Files of a
        secondary mirror are written to the same folder.
    formats : optional
        Names from :data:`FORMATS` for a folder; the first eight by default.
    body : optional
        Body of the mirror, by default from the rim of the housing, or ``Body()``. The body of a mirror
        in front of the camera receives the required bore.
    secondary_body : optional
        Body of the secondary mirror.
    housing : optional
        Housing in the drawing, by default that of the sensor. Its rims are those of the bodies.
    chord_tolerance_um
        Chord tolerance of STL and 3MF triangles.
    step_mm, step_deg, digits
        Step of the sag table along x or in field angle; decimals of mm in the table and the tool path.
    grid_points
        Points along each side of the grid sag file.
    sheet, scale
        "A3" or "A4"; scale of the sensor view, by default the largest standard scale that fits.
    tool : optional
        Lathe tool, by default ``Tool()``.
    workshop : optional
        Title block, material, texture and tolerances for the drawing
        (:func:`omnimirror.manufacturing.load_workshop`).
    allow_changes
        Write the files even if bodies or housing change the evaluated sensor.
    requirements : optional
        Requirements to check. If bodies or housing change the sensor, the error lists the entries
        whose margin changes or fails.
    on_progress : optional
        Callback with the number of completed files and of all files, called before each file. The
        logger ``omnimirror.manufacturing.exporter`` reports the name of the file.

    Returns
    -------
    list of ExportedFile
        Written files with the deviation of their surfaces from the mirror.

    Raises
    ------
    InvalidParameter
        If a format or suffix is unknown, a parameter is out of range, or bodies or housing change the
        evaluated sensor: its field, its obscurations, or the size of its cover.
    OmnimirrorError
        If a package of ``omnimirror[cad]`` is missing or a file cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = om.export(om.load_sensor("paper-spherical"), folder, formats=["csv", "zmx"], digits=4)
    >>> [(file.path.name, file.deviation_um) for file in files]
    [('paper-spherical-sag.csv', 0.05), ('paper-spherical.zmx', 0.0)]
    """
    # More than 60 lines: 17 parameters to check and pass on; the steps are functions.
    check_sensor(sensor)
    if isinstance(formats, str) or not (formats is None or isinstance(formats, Iterable)):
        raise InvalidType(
            f"formats must be a list of names from {', '.join(FORMATS)}; got {format_value(formats)}"
        )
    formats = None if formats is None else list(formats)
    path = file_name("path", path)
    digits, grid_points = (
        integer("digits", digits, 0, 15),
        integer("grid_points", grid_points, 3, 10_001),
    )
    chord_tolerance_um = number("chord_tolerance_um", chord_tolerance_um, above=0.0, unit="um")
    step_mm, step_deg = optional_number("step_mm", step_mm), optional_number("step_deg", step_deg)
    scale = optional_number("scale", scale, above=0.0)
    plan = Plan(
        sensor,
        parts_of(sensor, body, secondary_body),
        housing,
        chord_tolerance_um,
        step_mm,
        step_deg,
        digits,
        grid_points,
        sheet,
        scale,
        tool,
        workshop,
    )
    targets = _targets(plan, path, formats)
    has_other_parts = bool(body or secondary_body or housing not in (None, sensor.housing))
    if has_other_parts and not allow_changes:
        _check_unchanged(sensor, with_housing(plan.parts, housing), requirements)
    names = list(dict.fromkeys(name for name, *_ in targets.values()))
    _check_packages(names)
    plan = replace(plan, writes_table="csv" in names)
    with TemporaryDirectory() as folder, ExitStack() as stack:
        temporary = {target: Path(folder) / _plain(target.name) for target in targets}
        written: list[ExportedFile] = []
        for target, what in targets.items():
            LOGGER.info("Writing %s", target.name)
            if on_progress is not None:
                on_progress(len(written), len(targets))
            written.append(ExportedFile(target, *_write(plan, *what, temporary[target], target)))
        for target, file in temporary.items():
            copyfile(file, stack.enter_context(atomic_output(target)))
    return written


def _check_unchanged(
    evaluated: Sensor, exported: Sensor, requirements: Requirements | str | Path | None
) -> None:
    """Check that the exported parts do not change the evaluated sensor."""
    if not (changes := sensor_changes(evaluated, exported)):
        return
    if requirements is not None:
        changes = requirement_changes(evaluated, exported, requirements)
    raise InvalidParameter(
        f"the export parameters change the evaluated sensor {evaluated.name!r}: {'; '.join(changes)}; "
        "enter these parts in the [housing] of the sensor file and evaluate it again, or set allow_changes "
        "(--allow-changes)"
    )


def _plain(name: str) -> str:
    """Return a file name without characters that UTF-8 cannot encode."""
    return name.encode("utf-8", "replace").decode()


def _write(plan: Plan, name: str, part: Part, page: int, path: Path, target: Path) -> Content:
    """Write one temporary file; ``target`` is its final path for messages."""
    try:
        return FORMATS[name].write(replace(plan, page=page), part, path)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {target}: {e.strerror or e}") from None


def _targets(
    plan: Plan, path: Path, formats: list[str] | None
) -> dict[Path, tuple[str, Part, int]]:
    """Return the files to write with format, part and sheet of the drawing."""
    for name in formats or ():
        if not isinstance(name, str) or name not in FORMATS:
            raise InvalidParameter(
                f"formats must be names from {', '.join(FORMATS)}; got {format_value(name)}"
            )
    by_suffix = {suffix: name for name, f in FORMATS.items() for suffix in f.suffixes}
    suffix = path.suffix.lower()
    if suffix in by_suffix and not path.is_dir():
        name = by_suffix[suffix]
        if formats and formats != [name]:
            raise InvalidParameter(
                f"path must be a folder for the formats {', '.join(formats)}; got the {name} file {path.name}"
            )
        return {
            path.with_stem(path.stem + mark): (name, part, page)
            for mark, part, page in _marked(plan, name)
        }
    if suffix and formats is None and not path.is_dir():
        raise InvalidParameter(
            f"path must be a folder or a file with one of the suffixes {', '.join(by_suffix)}; got {path.name}"
        )
    chosen = DEFAULT_FORMATS if formats is None else tuple(dict.fromkeys(formats))
    return {
        path / f"{plan.stem}{mark}{FORMATS[name].ending}{FORMATS[name].suffixes[0]}": (
            name,
            part,
            page,
        )
        for name in chosen
        for mark, part, page in _marked(plan, name)
    }


def _marked(plan: Plan, name: str) -> list[tuple[str, Part, int]]:
    """Return the parts or sheets of a format with the suffix of their file names."""
    kind = FORMATS[name]
    marked = [(SECONDARY_MARK if part.is_secondary else "", part, 0) for part in plan.parts]
    if kind.is_one_sheet:
        marks = (MIRROR_MARK, SECONDARY_MARK)
        sheets = [
            (mark, part, i)
            for i, (mark, part) in enumerate(zip(marks, plan.parts, strict=False), start=1)
        ]
        return [marked[0], *sheets]
    return marked[:1] if kind.shows_sensor else marked


def missing_packages(names: Iterable[str]) -> dict[str, list[str]]:
    """Return the required packages of formats that are not installed."""
    return {name: [p for p in FORMATS[name].packages if not _is_installed(p)] for name in names}


def _check_packages(names: list[str]) -> None:
    """Raise an error if a format requires a package that is not installed."""
    packages_of = missing_packages(names)
    missing = sorted({package for packages in packages_of.values() for package in packages})
    if not missing:
        return
    without = [name for name, packages in packages_of.items() if packages]
    others = [name for name, packages in packages_of.items() if not packages]
    rest = f", or select {', '.join(others)}" if others else ""
    raise OmnimirrorError(
        f"{', '.join(without)} require{'s' * (len(without) == 1)} {', '.join(missing)}: "
        f"{extra_remedy('cad')}{rest}"
    )


def _is_installed(package: str) -> bool:
    return find_spec(package) is not None


# -- formats ---------------------------------------------------------------------------------------------


def _step(plan: Plan, part: Part, path: Path) -> Content:
    from .formats.step import write_step

    curve = write_step(path, part.mirror, part.body, part.name)
    return Content(f"solid, {curve.words}", curve.deviation_um)


def _mesh(plan: Plan, part: Part, path: Path) -> Content:
    from .formats.mesh import write_mesh

    deviation, count = write_mesh(path, part.mirror, part.body, plan.chord_tolerance_um)
    return Content(f"{count} triangles", deviation)


def _dxf(plan: Plan, part: Part, path: Path) -> Content:
    from .drawings.dxf import write_dxf

    i = int(part.is_secondary)
    curve = write_dxf(
        path,
        part,
        plan.workshop or Workshop(),
        plan.data_file(part),
        sheet=plan.sheet,
        sheet_number=(i + 2, 1 + len(plan.parts)),
    )
    return Content(f"half-section with dimensions, {curve.words}", curve.deviation_um)


def _zmx(plan: Plan, part: Part, path: Path) -> Content:
    aspheres = write_zmx(path, plan.sensor)
    description = " and ".join(asphere.words() for asphere in aspheres)
    return Content(
        f"OpticStudio, {description}",
        max(a.deviation_um for a in aspheres),
        max(a.ray_deg for a in aspheres),
    )


def _grid_sag(plan: Plan, part: Part, path: Path) -> Content:
    deviation = write_grid_sag(path, part.mirror, plan.grid_points)
    return Content(f"OpticStudio grid sag, {plan.grid_points} x {plan.grid_points}", deviation)


def _table(plan: Plan, part: Part, path: Path) -> Content:
    x = table_points(plan.sensor, plan.step_mm, plan.step_deg, part.is_secondary)
    path.write_text(
        sag_text(part, plan.step_mm, plan.step_deg, plan.digits), encoding="utf-8", newline=""
    )
    return Content(f"sag table, {len(x)} points", 1e3 * 0.5 * 10.0**-plan.digits)


def _drawing(plan: Plan, part: Part, path: Path) -> Content:
    if not plan.drawn:
        bodies = [p.body for p in plan.parts]
        plan.drawn.append(
            draw_sheets(
                plan.sensor,
                bodies[0],
                plan.housing,
                plan.sheet,
                plan.scale,
                *bodies[1:],
                workshop=plan.workshop or Workshop(),
                data_files=[f for p in plan.parts if (f := plan.data_file(p))],
            )
        )
    (drawing,) = plan.drawn
    write_drawing(path, drawing, plan.page)
    description = (
        "drawing" if path.suffix.lower() == ".pdf" else f"drawing of the {drawing.names[plan.page]}"
    )
    return Content(f"{description}, {plan.sheet}, {scale_words(drawing.scales[plan.page])}", None)


def _tool_path(plan: Plan, part: Part, path: Path) -> Content:
    listed = path.suffix.lower() in BUILT_IN_FORMATS["points"].suffixes
    way = write_tool_path(path, part.mirror, plan.tool or Tool(), part.name, plan.digits, listed)
    return Content(way.words, 1e-3 * way.deviation_nm)


MESHES = ("trimesh", "lxml", "networkx")
BUILT_IN_FORMATS = {
    "step": Format(_step, (".step", ".stp"), packages=("OCP",)),
    "stl": Format(_mesh, (".stl",), packages=MESHES[:1]),
    "3mf": Format(_mesh, (".3mf",), packages=MESHES),
    "dxf": Format(_dxf, (".dxf",), packages=("ezdxf",)),
    "zmx": Format(_zmx, (".zmx",), shows_sensor=True),
    "gridsag": Format(_grid_sag, (".dat",)),
    "csv": Format(_table, (".csv",), "-sag"),
    "pdf": Format(_drawing, (".pdf",), "-drawing", shows_sensor=True),
    "svg": Format(_drawing, (".svg",), "-drawing", shows_sensor=True, is_one_sheet=True),
    "png": Format(_drawing, (".png",), "-drawing", shows_sensor=True, is_one_sheet=True),
    "gcode": Format(_tool_path, (".nc", ".ngc"), "-path"),
    "points": Format(_tool_path, (".tsv",), "-path"),
}


def _check_format(name: str, kind: Any) -> None:
    if not isinstance(kind, Format):
        raise InvalidType(
            f"kind must be an omnimirror.manufacturing.Format; got {format_value(kind)}"
        )
    if duplicates := [
        s for s in kind.suffixes for f in BUILT_IN_FORMATS.values() if s in f.suffixes
    ]:
        raise InvalidParameter(f"suffixes must not belong to another format; got {duplicates[0]}")


FORMATS: Registry[Format] = Registry(
    "omnimirror.formats", "a format", BUILT_IN_FORMATS, _check_format
)
"""Export formats by name."""
DEFAULT_FORMATS = tuple(BUILT_IN_FORMATS)[:8]
"""Formats that are written to a folder by default."""


def register_format(name: str, kind: Format) -> None:
    """Register a custom format for :func:`export` and ``omnimirror export``.

    Installed packages can register formats by an entry point in their ``pyproject.toml``:
    ``[project.entry-points."omnimirror.formats"]`` with ``points = "my_package:points"``.

    Parameters
    ----------
    name
        Name of the format, for example ``"points"``.
    kind
        Suffixes and a function ``write(plan, part, path)`` that writes the file of a mirror and returns
        a :class:`~omnimirror.manufacturing.exporter.Content`: a description and the maximum distance of
        its surface from the mirror in um. ``part.mirror`` is the mirror, ``plan.sensor`` the sensor.

    Raises
    ------
    InvalidParameter
        If another format has the same name or suffix.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> from omnimirror.manufacturing import Content, Format
    >>> def write(plan, part, path):
    ...     path.write_text(f"{float(part.mirror.sag(part.mirror.rim_radius_mm)):.3f}")
    ...     return Content("the rim's height", 0.5)
    >>> om.register_format("docs-rim", Format(write, (".rim",)))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = om.export(om.load_sensor("paper-spherical"), f"{folder}/a.rim")[0]
    ...     file.path.read_text(), file.description
    ('26.122', "the rim's height")
    >>> om.manufacturing.FORMATS.withdraw("docs-rim")
    """
    FORMATS.register(name, kind)


def sensor_changes(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List quantities that differ between the evaluated and the exported sensor, with both values.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.manufacturing import Body
    >>> from omnimirror.manufacturing.body import with_housing, parts_of
    >>> sensor = om.load_sensor("paper-spherical")
    >>> sensor_changes(sensor, with_housing(parts_of(sensor, Body(thickness_mm=8.0))))
    []
    >>> sensor_changes(sensor, with_housing(parts_of(sensor, Body(flange_width_mm=5.0))))[0]
    'rim hides nothing -> 129.3 to 135 deg'
    """
    evaluated, exported = evaluated.aligned(), exported.aligned()
    result = [
        *_cover_changes(evaluated, exported),
        *_ring_changes(evaluated.obscurations, exported.obscurations),
    ]
    if not result and _rounded(evaluated.field_deg) == _rounded(exported.field_deg):
        return []
    pair = compare([evaluated, exported])
    rows = [
        f"{row.name} {row.texts[0]} -> {row.texts[1]} {row.quantity.unit}".rstrip()
        for row in pair.rows
        if row.texts[0] != row.texts[1]
    ]
    return [*result, *rows]


def requirement_changes(
    evaluated: Sensor, exported: Sensor, requirements: Requirements | str | Path
) -> list[str]:
    """List requirement entries whose margin differs between two sensors, with both margins.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.manufacturing.body import Body, parts_of, with_housing
    >>> sensor = om.load_sensor("paper-spherical")
    >>> requirements = om.Requirements(
    ...     field=om.FieldRequirements(omega_max_deg=130.0),
    ...     mirror=om.MirrorRequirements(family="sphere", rim_radius_mm=43.9),
    ...     lens=om.LensRequirements(theta_max_deg=(5.0, 20.0)),
    ... )
    >>> with_flange = with_housing(parts_of(sensor, Body(flange_width_mm=5.0)))
    >>> requirement_changes(sensor, with_flange, requirements)
    ['omega_max_deg: margin 5.005 -> -0.6733 deg (not met)']
    """
    if not isinstance(requirements, Requirements):
        requirements = load_requirements(requirements)
    before, after = (
        check_requirements(requirements, sensor).rows for sensor in (evaluated, exported)
    )
    changes = [
        f"{old.label}: margin {old.margin:.4g} -> {new.margin:.4g} {new.unit}".rstrip()
        + " (not met)" * (not new.is_met)
        for old, new in zip(before, after, strict=True)
        if _rounded((old.margin,)) != _rounded((new.margin,)) or old.is_met != new.is_met
    ]
    if not changes:
        changes = [
            f"no margin of the requirements, but {change}"
            for change in sensor_changes(evaluated, exported)
        ]
    return changes


def _rounded(numbers: tuple[float, ...]) -> tuple[str, ...]:
    """Format numbers with six significant digits."""
    return tuple(f"{number:.6g}" for number in numbers)


def _cover_changes(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List differing parameters of the tube, dome or window, fitted to each sensor."""
    before, after = evaluated.obstructions.housing.shell, exported.obstructions.housing.shell
    if type(before) is not type(after):
        kinds = ["none" if shell is None else shell.KIND for shell in (before, after)]
        return [f"cover {kinds[0]} -> {kinds[1]}"]
    if before is None or after is None:
        return []
    values = [(f.name, getattr(before, f.name), getattr(after, f.name)) for f in fields(before)]
    return [
        f"{before.KIND} {name} {_words(old)} -> {_words(new)}"
        for name, old, new in values
        if _words(old) != _words(new)
    ]


def _ring_changes(before: tuple[Obscuration, ...], after: tuple[Obscuration, ...]) -> list[str]:
    """List components whose obscuration differs."""
    rings = [
        {
            part: " and ".join(_ring_words(ring) for ring in result if ring.part == part)
            for part in _parts(result)
        }
        for result in (before, after)
    ]
    names = list(dict.fromkeys([*rings[0], *rings[1]]))
    pairs = [(name, *(result.get(name, "nothing") for result in rings)) for name in names]
    return [f"{name} hides {old} -> {new}" for name, old, new in pairs if old != new]


def _parts(rings: tuple[Obscuration, ...]) -> list[str]:
    return list(dict.fromkeys(ring.part for ring in rings))


def _ring_words(ring: Obscuration) -> str:
    return f"{ring.omega_deg[0]:.4g} to {ring.omega_deg[1]:.4g} deg"


def _words(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
