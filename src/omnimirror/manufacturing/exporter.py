"""One call writes what a workshop and other programs need of a sensor, all files or none."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import ExitStack
from dataclasses import dataclass, field, fields, replace
from importlib.util import find_spec
from pathlib import Path
from shutil import copyfile
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from ..analysis.comparison import compare
from ..arguments import WrongKind, checked, file_name, number, optional_number, shown, whole
from ..errors import InvalidParameter, OmnimirrorError
from ..escaping import file_stem
from ..files import replacing
from ..housing import Housing
from ..numerics.registry import Registry
from ..sensor import Sensor, check_sensor
from ..tracing.obscuration import Obscuration
from .body import Body, Part, housed, parts_of
from .drawings.drawing import Drawing, draw_sheets, write_drawing
from .drawings.sheet import scale_words
from .drawings.tables import DataFile, sag_text
from .formats.sag import table_points, write_grid_sag
from .formats.tool_path import Tool, write_tool_path
from .formats.zmx import write_zmx
from .workshop import Workshop

SECONDARY_MARK, MIRROR_MARK = "-secondary", "-mirror"  # in names of files
FOLLOWS_DEG = 0.01  # a lens file whose rays stay within this of the mirror's follows it


@dataclass(frozen=True)
class Exported:
    """A file that was written.

    Attributes
    ----------
    path
    what : what it holds, in a few words
    deviation_um : how far its surface lies from the mirror at most, 0 where it is the mirror; None for a drawing
    ray_deg : of a lens file, the largest angle between the rays that its surface and the mirror reflect; else None
    """

    path: Path
    what: str
    deviation_um: float | None
    ray_deg: float | None = None

    @property
    def follows(self) -> bool:
        """Whether rays through it go where the mirror sends them, to a hundredth of a degree."""
        return self.ray_deg is None or self.ray_deg < FOLLOWS_DEG


@dataclass(frozen=True)
class Plan:
    """All that the formats ask for: the sensor and its mirrors, and how fine each file is."""

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
    tool: Tool = field(default_factory=Tool)
    workshop: Workshop = field(default_factory=Workshop)
    page: int = 0
    """Which sheet of the drawing."""
    drawn: list[Drawing] = field(default_factory=list)
    """The drawing, once a file has asked for it."""

    @property
    def stem(self) -> str:
        """What the names of files begin with."""
        return file_stem(self.sensor.name, "sensor")

    writes_table: bool = False
    """Whether the sag table is written by the same call."""

    def data_file(self, part: Part) -> DataFile | None:
        """Return the sag table of a mirror if it is written beside the drawing."""
        if not self.writes_table:
            return None
        name = f"{self.stem}{SECONDARY_MARK if part.is_secondary else ''}-sag.csv"
        return DataFile.of(part, name, self.step_mm, self.step_deg, self.digits)


class Content(NamedTuple):
    """What a writer tells of its file, as :class:`Exported` holds it."""

    what: str
    deviation_um: float | None
    ray_deg: float | None = None


Writer = Callable[[Plan, Part, Path], Content]
"""Writes a file of one mirror, or of the sensor, to which all parts belong."""


@dataclass(frozen=True)
class Format:
    """How a format is written and named: ``suffixes`` it goes by, what is put after the sensor's name, its packages.

    Of two mirrors there is a file each, unless a file shows the whole sensor; of a drawing one of each sheet, where
    files of its kind hold no more.
    """

    write: Writer
    suffixes: tuple[str, ...]
    ending: str = ""
    packages: tuple[str, ...] = ()
    shows_sensor: bool = False
    is_one_sheet: bool = False


@checked
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
) -> list[Exported]:
    """Write CAD files, lens files, tables and the drawing of a sensor: all of them, or none.

    Parameters
    ----------
    sensor
    path
        A folder, or one file whose suffix says the format: .step, .stl, .3mf, .dxf, .zmx, .dat (grid sag),
        .csv (sag table), .pdf, .svg or .png (drawing), and .nc or .tsv (path of a tool). The file of a second mirror
        stands beside it.
    formats : optional
        Of :data:`FORMATS`, for a folder; the first eight by default.
    body : optional
        The solid behind the surface, by default as the rim of the sensor's housing says, or ``Body()``; a camera
        behind it gets the bore it looks through.
    secondary_body : optional
        The same of a second mirror.
    housing : optional
        Housing of the drawing, by default the sensor's own. Its rims are those of the bodies.
    chord_tolerance_um
        Of the triangles of STL and 3MF.
    step_mm, step_deg, digits
        Step of the sag table along x or in field angle, and decimals of a millimetre of it and of a tool's path.
    grid_points
        Of the grid sag file, along each side.
    sheet, scale
        "A3" or "A4", and the scale of the drawing's first view; by default the largest standard one that fits.
    tool : optional
        What turns the mirror on a lathe, by default ``Tool()``.
    workshop : optional
        What the drawing says beside shapes: title block, material, texture, tolerances
        (:func:`omnimirror.manufacturing.load_workshop`).
    allow_changes
        Write the files even if bodies or housing change what the evaluated sensor sees.

    Returns
    -------
    list of Exported
        A file each, with how far its surface lies from the mirror.

    Raises
    ------
    InvalidParameter
        A format or suffix that is not known, a parameter outside its range, or bodies or a housing that change the
        evaluated sensor: its field, its obscurations, or the size of its cover.
    OmnimirrorError
        A package of ``omnimirror[cad]`` is missing, or a file cannot be written.

    Examples
    --------
    >>> import tempfile, omnimirror as om
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     files = om.export(om.load_sensor("paper-spherical"), folder, formats=["csv", "zmx"], digits=4)
    >>> [(file.path.name, file.deviation_um) for file in files]
    [('paper-spherical-sag.csv', 0.05), ('paper-spherical.zmx', 0.0)]
    """
    check_sensor(sensor)
    if isinstance(formats, str) or not (formats is None or isinstance(formats, Iterable)):
        raise WrongKind(f"formats = {shown(formats)} is not a list of names, of {', '.join(FORMATS)}")
    formats = None if formats is None else list(formats)
    path = file_name("path", path)
    digits, grid_points = whole("digits", digits, 0, 15), whole("grid_points", grid_points, 3, 10_001)
    chord_tolerance_um = number("chord_tolerance_um", chord_tolerance_um, above=0.0, unit="um")
    step_mm, step_deg = optional_number("step_mm", step_mm), optional_number("step_deg", step_deg)
    scale = optional_number("scale", scale, above=0.0)
    plan = Plan(
        sensor, parts_of(sensor, body, secondary_body), housing, chord_tolerance_um, step_mm,
        step_deg, digits, grid_points, sheet, scale, tool or Tool(), workshop or Workshop(),
    )  # fmt: skip
    targets = _targets(plan, path, formats)
    if not allow_changes and (changes := changes_of(sensor, housed(plan.parts, housing))):
        raise InvalidParameter(
            f"the export parameters change the evaluated sensor {sensor.name!r}: {'; '.join(changes)}; "
            "enter these parts in the [housing] of the sensor file and evaluate it again, or set allow_changes "
            "(--allow-changes)"
        )
    names = list(dict.fromkeys(name for name, *_ in targets.values()))
    _check_packages(names)
    plan = replace(plan, writes_table="csv" in names)
    with TemporaryDirectory() as folder, ExitStack() as stack:
        made = {target: Path(folder) / _plain(target.name) for target in targets}
        written = [Exported(target, *_write(plan, *what, made[target], target)) for target, what in targets.items()]
        for target, file in made.items():
            copyfile(file, stack.enter_context(replacing(target)))
    return written


def _plain(name: str) -> str:
    """A name that libraries take which know UTF-8 alone."""
    return name.encode("utf-8", "replace").decode()


def _write(plan: Plan, name: str, part: Part, page: int, path: Path, target: Path) -> Content:
    """Write one file where it can be thrown away; ``target`` is what the user knows it as."""
    try:
        return FORMATS[name].write(replace(plan, page=page), part, path)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {target}: {e.strerror or e}") from None


def _targets(plan: Plan, path: Path, formats: list[str] | None) -> dict[Path, tuple[str, Part, int]]:
    """The files to write, each with its format, the mirror that it is of, and the sheet of the drawing."""
    for name in formats or ():
        if not isinstance(name, str) or name not in FORMATS:
            raise InvalidParameter(f"there is no format {shown(name)}; valid are {', '.join(FORMATS)}")
    by_suffix = {suffix: name for name, f in FORMATS.items() for suffix in f.suffixes}
    suffix = path.suffix.lower()
    if suffix in by_suffix and not path.is_dir():
        name = by_suffix[suffix]
        if formats and formats != [name]:
            raise InvalidParameter(f"{path.name} is a {name} file; give a folder for {', '.join(formats)}")
        return {path.with_stem(path.stem + mark): (name, part, page) for mark, part, page in _marked(plan, name)}
    if suffix and formats is None and not path.is_dir():
        raise InvalidParameter(
            f"{path.name} has no suffix that is known; valid are {', '.join(by_suffix)}, or a folder"
        )
    chosen = DEFAULT_FORMATS if formats is None else tuple(dict.fromkeys(formats))
    return {
        path / f"{plan.stem}{mark}{FORMATS[name].ending}{FORMATS[name].suffixes[0]}": (name, part, page)
        for name in chosen
        for mark, part, page in _marked(plan, name)
    }


def _marked(plan: Plan, name: str) -> list[tuple[str, Part, int]]:
    """The mirrors that a format has a file of, or the sheets, each with what its name ends in."""
    kind = FORMATS[name]
    marked = [(SECONDARY_MARK if part.is_secondary else "", part, 0) for part in plan.parts]
    if kind.is_one_sheet:
        marks = (MIRROR_MARK, SECONDARY_MARK)
        sheets = [(mark, part, i) for i, (mark, part) in enumerate(zip(marks, plan.parts, strict=False), start=1)]
        return [marked[0], *sheets]
    return marked[:1] if kind.shows_sensor else marked


def _check_packages(names: list[str]) -> None:
    lacking = {name: [p for p in FORMATS[name].packages if not _is_installed(p)] for name in names}
    missing = sorted({package for packages in lacking.values() for package in packages})
    if not missing:
        return
    without = [name for name, packages in lacking.items() if packages]
    others = [name for name, packages in lacking.items() if not packages]
    rest = f", or choose from {', '.join(others)}" if others else ""
    raise OmnimirrorError(
        f"{', '.join(without)} need{'s' * (len(without) == 1)} {', '.join(missing)}: "
        f"pip install 'omnimirror[cad]'{rest}"
    )


def _is_installed(package: str) -> bool:
    return find_spec(package) is not None


# -- the formats -----------------------------------------------------------------------------------------


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
        path, part, plan.workshop, plan.data_file(part), sheet=plan.sheet, place=(i + 2, 1 + len(plan.parts))
    )
    return Content(f"half-section with dimensions, {curve.words}", curve.deviation_um)


def _zmx(plan: Plan, part: Part, path: Path) -> Content:
    aspheres = write_zmx(path, plan.sensor)
    words = " and ".join(asphere.words() for asphere in aspheres)
    return Content(f"OpticStudio, {words}", max(a.deviation_um for a in aspheres), max(a.ray_deg for a in aspheres))


def _grid_sag(plan: Plan, part: Part, path: Path) -> Content:
    deviation = write_grid_sag(path, part.mirror, plan.grid_points)
    return Content(f"OpticStudio grid sag, {plan.grid_points} x {plan.grid_points}", deviation)


def _table(plan: Plan, part: Part, path: Path) -> Content:
    x = table_points(plan.sensor, plan.step_mm, plan.step_deg, part.is_secondary)
    path.write_text(sag_text(part, plan.step_mm, plan.step_deg, plan.digits), encoding="utf-8", newline="")
    return Content(f"sag table, {len(x)} points", 1e3 * 0.5 * 10.0**-plan.digits)


def _drawing(plan: Plan, part: Part, path: Path) -> Content:
    if not plan.drawn:
        bodies = [p.body for p in plan.parts]
        plan.drawn.append(draw_sheets(
            plan.sensor, bodies[0], plan.housing, plan.sheet, plan.scale, *bodies[1:], workshop=plan.workshop,
            data_files=[f for p in plan.parts if (f := plan.data_file(p))],
        ))  # fmt: skip
    (drawing,) = plan.drawn
    write_drawing(path, drawing, plan.page)
    shown = "drawing" if path.suffix.lower() == ".pdf" else f"drawing of the {drawing.names[plan.page]}"
    return Content(f"{shown}, {plan.sheet}, {scale_words(drawing.scales[plan.page])}", None)


def _tool_path(plan: Plan, part: Part, path: Path) -> Content:
    listed = path.suffix.lower() in OURS["points"].suffixes
    way = write_tool_path(path, part.mirror, plan.tool, part.name, plan.digits, listed)
    return Content(way.words, 1e-3 * way.deviation_nm)


MESHES = ("trimesh", "lxml", "networkx")
OURS = {
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
        raise WrongKind(f"{shown(kind)} is no omnimirror.manufacturing.Format")
    if taken := [s for s in kind.suffixes for f in OURS.values() if s in f.suffixes]:
        raise InvalidParameter(f"{taken[0]} files are written as another format; choose another suffix")


FORMATS: Registry[Format] = Registry("omnimirror.formats", "a format", OURS, _check_format)
"""Every format by the word that names it."""
DEFAULT_FORMATS = tuple(OURS)[:8]
"""What is written where nothing else is asked for."""


def register_format(name: str, kind: Format) -> None:
    """Make a format of one's own known to :func:`export` and ``omnimirror export``.

    An installed package does the same without a call, by an entry point in its ``pyproject.toml``:
    ``[project.entry-points."omnimirror.formats"]`` with ``points = "my_package:points"``.

    Parameters
    ----------
    name
        Such as ``"points"``.
    kind
        Its suffixes, and a function ``write(plan, part, path)`` that writes the file of a mirror and returns a
        :class:`~omnimirror.manufacturing.exporter.Content`: in words what it holds, and how far its surface lies from
        the mirror, um. ``part.mirror`` is the mirror, ``plan.sensor`` the sensor.

    Raises
    ------
    InvalidParameter
        Another format has this name or suffix.

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
    ...     file.path.read_text(), file.what
    ('26.122', "the rim's height")
    >>> om.manufacturing.FORMATS.withdraw("docs-rim")
    """
    FORMATS.register(name, kind)


def changes_of(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List the quantities that differ between a sensor and the one that is drawn and exported, with both values.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.manufacturing import Body
    >>> from omnimirror.manufacturing.body import housed, parts_of
    >>> sensor = om.load_sensor("paper-spherical")
    >>> changes_of(sensor, housed(parts_of(sensor, Body(thickness_mm=8.0))))
    []
    >>> changes_of(sensor, housed(parts_of(sensor, Body(flange_width_mm=5.0))))[0]
    'rim hides nothing -> 129.3 to 135 deg'
    """
    evaluated, exported = evaluated.aligned(), exported.aligned()
    found = [*_cover_changes(evaluated, exported), *_ring_changes(evaluated.obscurations, exported.obscurations)]
    if not found and _rounded(evaluated.field_deg) == _rounded(exported.field_deg):
        return []
    pair = compare([evaluated, exported])
    rows = [f"{row.name} {row.texts[0]} -> {row.texts[1]} {row.quantity.unit}".rstrip()
            for row in pair.rows if row.texts[0] != row.texts[1]]  # fmt: skip
    return [*found, *rows]


def _rounded(numbers: tuple[float, ...]) -> tuple[str, ...]:
    return tuple(f"{number:.6g}" for number in numbers)


def _cover_changes(evaluated: Sensor, exported: Sensor) -> list[str]:
    """List the differing fields of tube, dome or window, fitted to either sensor."""
    before, after = evaluated.obstructions.housing.shell, exported.obstructions.housing.shell
    if type(before) is not type(after):
        kinds = ["none" if shell is None else shell.KIND for shell in (before, after)]
        return [f"cover {kinds[0]} -> {kinds[1]}"]
    if before is None or after is None:
        return []
    values = [(f.name, getattr(before, f.name), getattr(after, f.name)) for f in fields(before)]
    return [
        f"{before.KIND} {name} {_words(old)} -> {_words(new)}"
        for name, old, new in values if _words(old) != _words(new)
    ]  # fmt: skip


def _ring_changes(before: tuple[Obscuration, ...], after: tuple[Obscuration, ...]) -> list[str]:
    """List the parts that hide another part of the field."""
    rings = [
        {part: " and ".join(_ring_words(ring) for ring in found if ring.part == part) for part in _parts(found)}
        for found in (before, after)
    ]
    names = list(dict.fromkeys([*rings[0], *rings[1]]))
    pairs = [(name, *(found.get(name, "nothing") for found in rings)) for name in names]
    return [f"{name} hides {old} -> {new}" for name, old, new in pairs if old != new]


def _parts(rings: tuple[Obscuration, ...]) -> list[str]:
    return list(dict.fromkeys(ring.part for ring in rings))


def _ring_words(ring: Obscuration) -> str:
    return f"{ring.omega_deg[0]:.4g} to {ring.omega_deg[1]:.4g} deg"


def _words(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
