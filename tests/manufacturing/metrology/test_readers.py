"""Measurement files: text in any unit, OpticStudio grids, and instrument formats if installed."""

from __future__ import annotations

import sys
import zipfile
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest

import omnimirror as om
from omnimirror.base.errors import OmnimirrorError
from omnimirror.manufacturing import format_grid_sag
from omnimirror.manufacturing.metrology import readers
from omnimirror.optics.mirrors import Sphere

POINTS = np.array([[1.5, 2.0, -0.25], [3.0, -4.5, 0.125]])


@pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("um", 1e-3), ("m", 1e3), ("inch", 25.4)])
@pytest.mark.parametrize(("suffix", "between"), [(".csv", ","), (".xyz", " "), (".tsv", "\t")])
def test_point_lists(suffix, between, unit, mm, tmp_path):
    lines = "\n".join(between.join(str(v) for v in point) for point in POINTS)
    path = tmp_path / f"a{suffix}"
    path.write_text(f"# probe 3\nx{between}y{between}z\n{lines}\n")
    np.testing.assert_allclose(om.read_points(path, unit), mm * POINTS)


ROWS = [(1.5, 2.25, -0.0125), (-3.0, 4.5, 0.75), (0.5, -6.0, 1e-3), (12.0, 7.125, 2.5)]


def joined(between: str, row: str = "{}", number: str = "{:.6f}", header: str = "") -> str:
    """Format rows; ``row`` formats the numbers of a row and its index i."""
    lines = [
        row.format(between.join(number.format(v) for v in r), i=i)
        for i, r in enumerate(ROWS, start=1)
    ]
    return "\n".join([*([header] if header else []), *lines])


def decimal_commas(text: str) -> str:
    return text.replace(".", ",")


@pytest.mark.parametrize(
    "text",
    {
        "decimal commas and semicolons": decimal_commas(joined(";", header="x;y;z")),
        "decimal commas and tabs": decimal_commas(joined("\t")),
        "decimal commas and blanks": decimal_commas(joined("  ", "   {}")),
        "decimal commas, commas and blanks": decimal_commas(joined(", ")),
        "row numbers": joined(" ", "{i} {}"),
        "row numbers and decimal commas": decimal_commas(
            joined(";", "{i};{};", header="Nr;X [mm];Y [mm];Z [mm]")
        ),
        "labels": joined(" ", "PT{i:03d} {}"),
        "labels of two words": joined(" ", "Point {i}: {}"),
        "labels behind": joined(",", "{},OK"),
        "labels and row numbers": joined(",", "{i},P{i},{}"),
        "Fortran": joined(" ", number="{:.8E}").replace("E", "D"),
        "Fortran in small letters and commas": joined(", ", number="{:.8e}").replace("e", "d"),
        "axes": "\n".join("X{} Y{} Z{}".format(*r) for r in ROWS),
        "report": joined(",", header="CMM 2026-11-28 10:30\nProbe 3.0 of 20\n\nX,Y,Z"),
        "columns in another order": "\n".join(
            ["z,y,x", *(",".join(map(str, r[::-1])) for r in ROWS)]
        ),
        "normals": joined(",", "{},0.0,0.1,0.99"),
        "quoted": joined('","', '"{}"'),
        "not measured": joined(",") + "\n1.0,2.0,NaN",
    }.items(),
    ids=lambda case: case[0].replace(" ", "-"),
)
def test_row_formats(text, tmp_path):
    path = tmp_path / "a.txt"
    path.write_text(text[1])
    np.testing.assert_allclose(om.read_points(path), ROWS, rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("start", "header"), [("", ""), ("{i}\t", ""), ("", "x\tz"), ("P{i}\t", "")]
)
def test_profile_with_two_columns(start, header, tmp_path):
    lines = [f"{start.format(i=i)}{x}\t{z}" for i, (x, _, z) in enumerate(ROWS)]
    (tmp_path / "a.txt").write_text("\n".join([*([header] if header else []), *lines]))
    np.testing.assert_allclose(om.read_points(tmp_path / "a.txt"), np.array(ROWS)[:, [0, 2]])


def test_grid_sag_file(tmp_path):
    path = tmp_path / "a.dat"
    path.write_text(format_grid_sag(Sphere(50.0, 20.0), 33))
    points = om.read_points(path)
    r = np.hypot(points[:, 0], points[:, 1])
    inside = r < 20.0
    assert inside.sum() > 500
    np.testing.assert_allclose(
        points[inside, 2], 50.0 - np.sqrt(2500.0 - r[inside] ** 2), atol=1e-12
    )


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.stl", b"x", r"must have one of the suffixes \.csv"),
        ("a.csv", None, "a.csv"),
        ("a.dat", None, "a.dat"),
        (
            "a.csv",
            b"x,y,z\n1,2,3\n1,2\n",
            r"line 3: the row must contain x, y, z, as the other rows; got '1,2'",
        ),
        (
            "a.csv",
            b"1,5,2,0,3,1\n1,5,2,0,3,2\n1,7,2,0,3,1",
            "must not use commas for both columns and decimals",
        ),
        (
            "a.csv",
            b"x [um],y [um],z [um]\n1.0,2.0,3.0",
            "specifies the unit um, which differs from mm",
        ),
        ("a.csv", b"probe\nA. Meier", "must contain rows of x, y, z"),
    ],
)
def test_invalid_files_are_rejected(name, content, message, tmp_path):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(OmnimirrorError, match=message):
        om.read_points(tmp_path / name)


def test_missing_package_message(tmp_path, monkeypatch):
    monkeypatch.setattr(readers, "find_spec", lambda name: None)
    (tmp_path / "a.dat").write_bytes(b"\x88\x1b\x03\x6f" + bytes(900))
    with pytest.raises(
        OmnimirrorError,
        match=r"\.dat files require SurfaceTopography: run pip install '\.\[metrology\]' in the repository",
    ):
        om.read_points(tmp_path / "a.dat")


def test_oversized_archive_is_rejected(tmp_path, monkeypatch):
    monkeypatch.setattr(readers, "MAX_MACHINE_FILE_BYTES", 1 << 20)
    with zipfile.ZipFile(tmp_path / "a.x3p", "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("bindata/data.bin", bytes(3 << 20))
    assert (tmp_path / "a.x3p").stat().st_size < 1 << 14
    with pytest.raises(OmnimirrorError, match=r"the content must be at most 1 MB"):
        om.read_points(tmp_path / "a.x3p")


class Reader:
    """Opened file with the required part of the SurfaceTopography interface; heights and positions
    in m."""

    def __init__(self, heights, points=None):
        self.heights = np.ma.masked_invalid(heights)
        self.default_channel = SimpleNamespace(nb_grid_pts=points or self.heights.shape)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        return None

    def topography(self):
        return self

    def to_unit(self, unit):
        return SimpleNamespace(positions_and_heights=lambda: self._in(unit))

    def _in(self, unit):
        per_m = {"mm": 1e3, "um": 1e6}[unit]
        x, y = np.meshgrid(
            *(1e-3 * (k + 1) * np.arange(n) for k, n in enumerate(self.heights.shape)),
            indexing="ij",
        )
        return per_m * x, per_m * y, per_m * self.heights


@pytest.fixture
def machine(monkeypatch):
    """Set what SurfaceTopography returns, or the exception that it raises, without the package."""

    def set_result(result):
        def open_topography(path):
            if isinstance(result, Exception):
                raise result
            return result

        package, reading = ModuleType("SurfaceTopography"), ModuleType("SurfaceTopography.IO")
        reading.open_topography = open_topography
        monkeypatch.setitem(sys.modules, "SurfaceTopography", package)
        monkeypatch.setitem(sys.modules, "SurfaceTopography.IO", reading)
        monkeypatch.setattr(readers, "find_spec", lambda name: package)

    return set_result


@pytest.mark.parametrize("suffix", readers.MACHINES)
def test_height_grid_in_mm_omits_unmeasured_points(suffix, machine, tmp_path):
    """Heights of a plane of known tilt, 3 by 4 points with spacings of 1 mm and 2 mm."""
    x, y = np.mgrid[:3, :4]
    heights = 1e-6 * (5 * x - 2 * y)
    heights[0, 1], heights[2, 3] = np.nan, np.inf
    machine(Reader(heights))
    path = tmp_path / f"a{suffix.upper()}"
    path.write_bytes(b"\x88\x1b\x03\x6f" + bytes(900) if suffix == ".dat" else b"text")
    expected = [
        (i, 2 * j, (5 * i - 2 * j) / 1e3)
        for i in range(3)
        for j in range(4)
        if (i, j) not in ((0, 1), (2, 3))
    ]
    np.testing.assert_allclose(om.read_points(path), expected, rtol=0, atol=1e-12)


def test_file_type_is_detected_from_first_512_bytes(machine, tmp_path):
    machine(Reader(np.zeros((2, 2))))
    path = tmp_path / "a.dat"
    path.write_bytes(b" " * 511 + b"\xff")
    assert len(om.read_points(path)) == 4
    path.write_bytes(b" " * 512 + b"\xff")
    with pytest.raises(OmnimirrorError, match=r"a\.dat"):
        om.read_points(path)


@pytest.mark.parametrize(
    ("points", "is_accepted"),
    [((4000, 5000), True), ((1, 20_000_001), False), ((5001, 4000), False)],
)
def test_grid_is_limited_to_20_million_points(points, is_accepted, machine, tmp_path):
    machine(Reader(np.zeros((2, 3)), points))
    (tmp_path / "a.opd").write_bytes(b"\1")
    if is_accepted:
        assert om.read_points(tmp_path / "a.opd").shape == (6, 3)
        return
    count = points[0] * points[1]
    with pytest.raises(
        OmnimirrorError,
        match=rf"a\.opd must not have more than 20000000 points; got {count}; reduce",
    ):
        om.read_points(tmp_path / "a.opd")


def test_instrument_file_is_limited_to_256_mb(machine, tmp_path):
    machine(Reader(np.zeros((2, 3))))
    with open(tmp_path / "a.sur", "wb") as file:
        file.truncate(256 * 1024**2)
    assert om.read_points(tmp_path / "a.sur").shape == (6, 3)
    with open(tmp_path / "a.sur", "ab") as file:
        file.write(b"\0")
    with pytest.raises(OmnimirrorError, match=r"the file must be at most 256 MB"):
        om.read_points(tmp_path / "a.sur")


@pytest.mark.parametrize(
    ("error", "reason"),
    [
        (ValueError("wrong magic number\nat byte 0"), "wrong magic number"),
        (KeyError(), "KeyError"),
        (RuntimeError("no topography"), "no topography"),
    ],
)
def test_any_error_of_the_package_is_one_line(error, reason, machine, tmp_path):
    machine(error)
    (tmp_path / "a.plux").write_bytes(b"\1")
    with pytest.raises(OmnimirrorError) as exception:
        om.read_points(tmp_path / "a.plux")
    assert str(exception.value) == f"{tmp_path / 'a.plux'} cannot be read: {reason}"


def test_missing_instrument_file_is_reported(tmp_path):
    path = tmp_path / "a.plux"
    with pytest.raises(OmnimirrorError) as exception:
        om.read_points(path)
    assert str(exception.value) == f"cannot read the points {path}: No such file or directory"


X3P = """<?xml version="1.0" encoding="UTF-8"?>
<p:ISO5436_2 xmlns:p="http://www.opengps.eu/2008/ISO5436_2">
<Record1><Revision>ISO5436 - 2000</Revision><FeatureType>SUR</FeatureType><Axes>
<CX><AxisType>I</AxisType><DataType>D</DataType><Increment>1e-3</Increment><Offset>0</Offset></CX>
<CY><AxisType>I</AxisType><DataType>D</DataType><Increment>2e-3</Increment><Offset>0</Offset></CY>
<CZ><AxisType>A</AxisType><DataType>D</DataType><Increment>1</Increment><Offset>0</Offset></CZ></Axes></Record1>
<Record2><Date>2026-01-01T00:00:00</Date><Instrument><Manufacturer>a</Manufacturer><Model>b</Model><Serial>c</Serial>
<Version>1</Version></Instrument><CalibrationDate>2026-01-01T00:00:00</CalibrationDate>
<ProbingSystem><Type>NonContacting</Type><Identification>x</Identification></ProbingSystem></Record2>
<Record3><MatrixDimension><SizeX>3</SizeX><SizeY>4</SizeY><SizeZ>1</SizeZ></MatrixDimension><DataLink>
<PointDataLink>bindata/data.bin</PointDataLink><MD5ChecksumPointData>0</MD5ChecksumPointData></DataLink></Record3>
<Record4><ChecksumFile>md5checksum.hex</ChecksumFile></Record4></p:ISO5436_2>"""


@pytest.mark.full
def test_instrument_file_is_converted_to_valid_points_in_mm(tmp_path, monkeypatch):
    pytest.importorskip("SurfaceTopography", reason="pip install '.[metrology]'")
    heights = np.arange(12.0).reshape(4, 3) * 1e-6  # m
    heights[0, 0] = np.nan
    with zipfile.ZipFile(tmp_path / "a.x3p", "w") as file:
        file.writestr("main.xml", X3P)
        file.writestr("bindata/data.bin", heights.astype("<f8").tobytes())
        file.writestr("md5checksum.hex", "")
    points = om.read_points(tmp_path / "a.x3p")
    assert len(points) == 11
    at = {(round(x), round(y)): z for x, y, z in points}
    assert at[1, 0] == pytest.approx(1e-3)
    assert at[2, 6] == pytest.approx(11e-3)
    monkeypatch.setattr(readers, "MAX_GRID_POINTS", 11)
    with pytest.raises(
        OmnimirrorError, match="must not have more than 11 points; got 12; reduce its resolution"
    ):
        om.read_points(tmp_path / "a.x3p")
    (tmp_path / "b.x3p").write_bytes(b"PK nothing")
    with pytest.raises(OmnimirrorError, match=r"b\.x3p cannot be read: "):
        om.read_points(tmp_path / "b.x3p")
