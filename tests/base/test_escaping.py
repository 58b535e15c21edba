"""Hostile names in all written files, checked by real interpreters and parsers."""

from __future__ import annotations

import ast
import csv
import io
import json
import re
import subprocess
import sys
import tokenize
import tomllib
import zipfile
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from tempfile import TemporaryDirectory, mkdtemp
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import cv2
import ezdxf
import numpy as np
import OpenEXR
import pytest
import tomli_w
import yaml
from ezdxf.lldxf.encoding import has_dxf_unicode, has_mif_encoding
from ezdxf.tools.text import plain_mtext, plain_text
from markdown_it import MarkdownIt
from matplotlib.cbook import is_math_text

import omnimirror as om
from omnimirror.analysis.figures import FIGURES
from omnimirror.base import escaping
from omnimirror.base.errors import InvalidParameter
from omnimirror.calibration.formats._registry import FORMATS as CAMERA_FORMATS
from omnimirror.interop.export_formats import Deviation, ExportFormat
from omnimirror.interop.ray_tables import RAY_FORMATS
from omnimirror.interop.view_maps import MAP_FORMATS
from omnimirror.manufacturing import FORMATS, Content, Format
from omnimirror.optics.mirrors import Sphere
from tests.commands import omnimirror
from tests.everyday import few

CANARY = "INJECTED"
TOUCH = f"__import__('pathlib').Path('{CANARY}').touch()"
NAMES = {
    "python": f'"""\n{TOUCH}\n"""',
    "python-single": f"'''\n{TOUCH}\n'''",
    "quotes": "\"'`\u2018\u201d",
    "c": f'*/ int {CANARY} = 1; /* "; int {CANARY}_2; // "',
    "backslash": "ends with \\",
    "trigraph": "ends with ??/",
    "escapes": "\\N{DASH} \\u12 \\x1 \\U00110000 \\U+0041 \\M+18281 \\X2\\0041\\X0\\ \\S\\D \\P {\\C1;red}",
    "newlines": f"a\nb\rc\r\nd\u2028e\u2029f\x85g\x0bh\x0c{TOUCH}\n{TOUCH}\rimport {CANARY}",
    "controls": "".join(map(chr, range(1, 32))) + "\x7f\x9b31m\x1b[31mred\x1b]0;title\x07",
    "bidirectional": "\u202e\u2066 // \u2069 \u200f\u061c\ufeff\U000e0041 \ufffe",
    "markup": "</script><script>INJECTED</script><b>&amp; ]]> --> <!-- <![CDATA[ \" onload='x'",
    "formula": f"=cmd|'/C touch {CANARY}'!A0",
    "formula-inside": "a,=1+1;@SUM(1)\t-2\t+3|=4",
    "shell": f"`touch {CANARY}` $(touch {CANARY}) $HOME; touch {CANARY} & | > x !! % *",
    "gstreamer": f'" ! filesink location={CANARY} "\\',
    "format": "%s %n %%c ^J {0} {__class__} ${camera} $$ {",
    "math": "$x^{$ _hidden $\\frac{1}$ a_b^c",
    "rich": "[red]x[/] [/b] :smile:",
    "g-code": "(A); G0 X0) M30 %\n% ! ? ~ (MSG,x",
    "encoding": "coding: utf-7 +AAo-import os",
    "letters": "Größe 日本 العربية 😀",
    "long": "long " * 2000,
    "surrogate": "a\udcffb\ud800c",
}
CODE = f'a"""\';{TOUCH}*/\n{TOUCH} \\N{{X}} ??/ ]]>\r--> $(touch {CANARY})`x`\\'
MARKUP = "=1+1,</script>&<b> $x^{$ %%c ^J \u202e\x1b[31m {0} (A) % 日本ö '\"\\"
EVERYDAY = {"code": CODE, "markup": MARKUP}
PLAIN = "plain"

SENSOR = om.load_sensor("paper-spherical")
SMALL = replace(
    SENSOR,
    imager=replace(SENSOR.imager, width_px=160, height_px=144, pixel_pitch_um=5.2 * 1024 / 160),
)
VIEW = om.screens.Plane((64, 48), hfov_deg=60.0)


# -- escaping functions by language
# -----------------------------------------------------------------


def readable(name: str) -> str:
    """Return the name reduced to its ordinary letters."""
    return "".join(re.findall(r"[A-Za-z0-9ößا-ي日本]", name))


@pytest.mark.parametrize("name", NAMES)
def test_python_source_contains_name_as_data(name):
    text = NAMES[name]
    assert ast.literal_eval(escaping.python_string(text)) == text
    for quotes in ('"""', "'''"):
        source = f"{quotes}{escaping.python_docstring(text)}{quotes}\n# {escaping.line_comment(text)}\nx = 1\n"
        (docstring, assignment) = ast.parse(source).body
        assert isinstance(docstring, ast.Expr)
        assert isinstance(assignment, ast.Assign)
        assert ast.literal_eval(docstring.value).startswith(escaping.label(text)[:150])
    comment = f"# {escaping.line_comment(text)}\n".encode()
    assert tokenize.detect_encoding(io.BytesIO(comment).readline)[0] == "utf-8"
    kinds = [token.type for token in tokenize.tokenize(io.BytesIO(comment).readline)]
    assert kinds == [tokenize.ENCODING, tokenize.COMMENT, tokenize.NL, tokenize.ENDMARKER]


def test_c_source_contains_all_names(tmp_path):
    """Comments are closed and strings contain the bytes of the name, by a C99 compiler with
    trigraphs."""
    lines = ["#include <stdio.h>", "int main(void) {", "int n = 0;"]
    for text in NAMES.values():
        lines += [f"// {escaping.c_comment(text)}", "++n;", f"/*{escaping.c_comment(text)}*/ ++n;"]
        lines += [f"fputs({escaping.c_string(text)}, stdout); putchar(0);"]
    source = tmp_path / "a.c"
    source.write_text(
        "\n".join([*lines, 'printf("%d", n);', "return 0; }"]) + "\n", encoding="utf-8"
    )
    gcc = [
        "gcc",
        "-std=c99",
        "-trigraphs",
        "-Wall",
        "-Werror",
        "-Wno-overlength-strings",
        "-o",
        str(tmp_path / "a"),
    ]
    subprocess.run([*gcc, str(source)], check=True, capture_output=True)
    *texts, count = subprocess.run([tmp_path / "a"], check=True, capture_output=True).stdout.split(
        b"\0"
    )
    assert int(count) == 2 * len(NAMES)
    assert texts[:-1] == [text.encode() for text in list(NAMES.values())[:-1]]
    assert escaping.c_string("a\udcff") == '"a\\377"'


def test_shells_parse_every_name_as_one_argument(tmp_path):
    arguments = [text for text in NAMES.values() if "\ud800" not in text]
    command = escaping.shell_command(["printf", "%s\\0", *arguments, "\udcff", "", "a\n", "-n"])
    for shell in ("dash", "bash"):
        run = subprocess.run(
            [shell], input=command.encode(), capture_output=True, cwd=tmp_path, check=True
        )
        assert run.stdout.split(b"\0")[:-1] == [
            *(w.encode() for w in arguments),
            b"\xff",
            b"",
            b"a\n",
            b"-n",
        ]
        assert not run.stderr
    assert not list(tmp_path.iterdir())
    assert escaping.escape_invisible(command, keep="\n") == command


class Elements(HTMLParser):
    """Elements, attributes, comments and text of a page."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: list[str] = []
        self.attributes: dict[str, str | None] = {}
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.elements.append(tag)
        self.attributes |= dict(attrs)

    def handle_data(self, data: str) -> None:
        self.text += data


@pytest.mark.parametrize("name", NAMES)
def test_markup_and_data_contain_name(name):
    text = NAMES[name]
    escaped = escaping.escape_invisible(text, keep="\n\t")
    page = Elements(f'<i title="{escaping.html_text(text)}">{escaping.html_text(text)}</i>')
    assert (page.elements, page.text, page.attributes) == (["i"], escaped, {"title": escaped})
    root = ElementTree.fromstring(
        f"<i title='{escaping.xml_text(text)}'>{escaping.xml_text(text)}</i>".encode()
    )
    assert (root.text, len(root)) == (escaped, 0)
    assert json.loads(escaping.json_text([text]).encode()) == [text]
    script = Elements(f"<script>{escaping.script_json(escaping.json_text([text]))}</script>")
    assert (script.elements, json.loads(script.text)) == (["script"], [text])
    expected = re.sub("[\ud800-\udfff]", lambda c: repr(c[0])[1:-1], text)
    document = f"# {escaping.line_comment(text)}\nname = {escaping.toml_string(text)}\n"
    assert tomllib.loads(document) == {"name": expected}
    quoted = escaping.csv_comment(escaping.toml_string(text))
    assert tomllib.loads(f"name = {quoted}") == {"name": expected}
    assert not any(
        re.match(r"\s*[\"']*[=+@-]", cell) for cell in re.split(r"[,;|\t]", f"# name = {quoted}")
    )
    assert yaml.safe_load(
        f"# {escaping.line_comment(text)}\nname: {escaping.yaml_string(text)}\n"
    ) == {"name": escaping.escape_invisible(text)}
    assert yaml.safe_load(f"- {escaping.yaml_string('no')}") == ["no"]
    into = io.StringIO()
    csv.writer(into).writerow(["x", escaping.csv_cell(text), "y"])
    ((_, cell, _),) = csv.reader(io.StringIO(into.getvalue()))
    assert cell.lstrip()[:1] not in ("=", "+", "-", "@", "\t", "\r")
    assert cell in (escaping.escape_invisible(text), f"'{escaping.escape_invisible(text)}")
    tokens = (
        MarkdownIt()
        .enable("table")
        .parse(f"| a |\n|---|\n| {escaping.markdown_text(text)} |\n\n# h\n")
    )
    assert [t.type for t in tokens].count("td_open") == 1
    escaped = [t for t in tokens if t.type == "inline"][1].children
    assert {t.type for t in escaped} <= {"text", "text_special"}
    assert "".join(t.content for t in escaped) == escaping.label(text).strip()


@pytest.mark.parametrize("name", NAMES)
def test_drawings_and_programs_contain_name(name):
    text = NAMES[name]
    line = escaping.label(text)
    assert re.fullmatch(r"[ -$&'*-:<->@-}]*", escaping.gcode_comment(text))
    labelled = escaping.plot_text(text)
    assert not is_math_text(labelled)
    assert escaping.label(text, escaping.MAX_PLOT_LABEL) == labelled.replace("\\$", "$")
    spaced = re.sub(r"(\\[UM])\+", r"\1 +", line)
    for escaped, parsed in (
        (escaping.dxf_text(line), plain_text),
        (escaping.dxf_mtext(text), plain_mtext),
    ):
        assert not has_dxf_unicode(escaped)
        assert not has_mif_encoding(escaped)
        assert (
            parsed(escaped.replace("%%%%%%", "\ue000")).replace("\ue000", "%%") == spaced.rstrip()
        )
    assert escaping.step_string(text).isascii()
    for output in (line, escaping.terminal_text(text), escaping.gstreamer_comment(text)):
        assert not re.search(
            "[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]", output
        )
    assert not re.search(r'["\\]', escaping.gstreamer_comment(text))
    assert len(line) <= escaping.MAX_LABEL
    assert readable(line)[:40] == readable(escaping.escape_invisible(" ".join(text.split())))[:40]


@pytest.mark.parametrize("name", NAMES)
def test_file_names_are_plain_and_short(name):
    stem = escaping.file_stem(NAMES[name], "sensor")
    assert re.fullmatch(r"[\w+][\w.+-]*", stem)
    assert len(stem.encode()) <= escaping.MAX_STEM
    header = escaping.http_attachment(f"{NAMES[name]}.csv")
    match = re.fullmatch(
        r"""attachment; filename="([\w.+-]+)"(?:; filename\*=UTF-8\'\'([\w.~%-]+))?""",
        header,
        re.ASCII,
    )
    assert unquote(match[2] or match[1]) == f"{escaping.escape_invisible(NAMES[name])}.csv"


# -- registered writers
# ------------------------------------------------------------------------------

STUBS = """
import json, runpy, sys
from unittest.mock import MagicMock
for name in ("bpy", "mathutils", "mitsuba", "drjit"):
    sys.modules[name] = MagicMock()
sys.modules["bpy"].app.version = (5, 3, 0)
found = runpy.run_path(sys.argv[1])
if "set_up" in found:
    found["set_up"]()
    calls = sys.modules["bpy"].data.cameras.new.call_args_list
    print(json.dumps([call.args[0] for call in calls]))
"""
C_LIKE = (".c", ".h", ".frag", ".hlsl", ".effect", ".osl", ".note")
PLAIN_DATA = (".npy", ".bin", ".dat", ".stl", ".tsv", ".pgm")
"""Formats that contain a name in a comment or not at all: files of two names are otherwise equal."""


def checked(path: Path, plain: Path, name: str) -> None:
    """Check the content of a file apart from the name, by the program or parser of its format,
    against a plain name."""
    kind = path.suffix
    if kind in C_LIKE:
        assert code_of(path) == code_of(plain)
        if kind == ".c":
            warned = ["-Wall", "-Wextra", "-Wbidi-chars=any", "-Werror"]
            subprocess.run(["gcc", "-std=c99", *warned, "-fsyntax-only", path], check=True)
    elif kind == ".py":
        run = subprocess.run(
            [sys.executable, "-c", STUBS, path], cwd=path.parent, capture_output=True, check=True
        )
        if run.stdout:
            assert set(json.loads(run.stdout)) == {name}
        if name.isprintable():
            assert readable(name)[:20] in readable(
                ast.get_docstring(ast.parse(path.read_text("utf-8"))) or ""
            )
    elif kind == ".sh":
        plain_output, output = (start_arguments(p) for p in (plain, path))
        assert len(plain_output) == len(output)
        shaders = [word for word in output if word.startswith("fragment=")]
        assert [(word.count('"'), "\\" in word) for word in shaders] == [(2, False)]
        assert [w for w in output if w not in shaders] == [
            w for w in plain_output if not w.startswith("fragment=")
        ]
    elif kind == ".csv":
        lines = path.read_text("utf-8").splitlines()
        head = "\n".join(line[2:] for line in lines if line.startswith("#"))
        assert tomllib.loads(head)["sensor"] == re.sub(
            "[\ud800-\udfff]", lambda c: repr(c[0])[1:-1], name
        )
        assert len(lines) == len(plain.read_text("utf-8").splitlines())
        for row in csv.reader(line for line in lines if line.startswith("# sensor")):
            assert not any(re.match(r"\s*[=+@-]", cell) for cell in row)
    elif kind == ".svg":
        assert name_of(ElementTree.parse(path)) == name_of(ElementTree.parse(plain))
    elif kind == ".zmx":
        output, plain_output = (
            p.read_bytes().decode("utf-16").split("\r\n") for p in (path, plain)
        )
        assert [line for line in output if not line.startswith("NAME")] == [
            x for x in plain_output if x[:4] != "NAME"
        ]
    elif kind == ".nc":
        output, plain_output = (
            re.sub(r"\([^()]*\)", "", p.read_text("ascii")) for p in (path, plain)
        )
        assert output == plain_output
    elif kind == ".dxf":
        document = ezdxf.readfile(path)
        assert not document.audit().errors
        assert len(list(document.modelspace())) == len(list(ezdxf.readfile(plain).modelspace()))
        (note,) = document.modelspace().query("MTEXT")
        first = note.plain_text().split("\n")[0]
        assert first.replace("%%%", "%") == re.sub(
            r"(\\[UM])\+", r"\1 +", escaping.label(name)
        ).replace("%%%", "%")
    elif kind == ".step":
        product = product_of(path).rpartition(" ")[0]
        assert product in [escaping.label(name, longest) for longest in range(4, 61)]
    elif kind == ".3mf":
        with zipfile.ZipFile(path) as archive:
            for entry in archive.namelist():
                if entry.endswith((".model", ".xml", ".rels")):
                    ElementTree.fromstring(archive.read(entry))
    elif kind == ".exr":
        with OpenEXR.File(str(path)) as file:
            assert file.header().get(
                "omnimirror:camera", escaping.escape_invisible(name)
            ) == escaping.escape_invisible(name)
    elif kind == ".npz":
        arrays = np.load(path)
        assert "camera" not in arrays or str(arrays["camera"]) == name.rstrip("\0")
    elif kind == ".json":
        assert json.loads(path.read_bytes()) == json.loads(plain.read_bytes())
    elif kind == ".yml":
        assert not cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ).getNode("map_x").empty()
    elif kind == ".png":
        assert cv2.imread(str(path)) is not None
    elif kind == ".pdf":
        assert path.read_bytes().startswith(b"%PDF-")
    else:
        assert kind in PLAIN_DATA, f"say in `checked` how files of kind {kind} are parsed"
        output, plain_output = (
            re.sub(rb"^# .*", b"", p.read_bytes(), flags=re.MULTILINE) for p in (path, plain)
        )
        assert output == plain_output


def code_of(path: Path) -> str:
    """Return preprocessed C code: without comments, with continued lines joined."""
    text = re.sub(rb"(?m)^#(version|include).*", b"", path.read_bytes())
    run = subprocess.run(
        ["gcc", "-std=c99", "-x", "c", "-E", "-P", "-"], input=text, capture_output=True, check=True
    )
    return run.stdout.decode().replace(path.stem, "")


def start_arguments(script: Path) -> list[str]:
    """Return the arguments that the script passes to GStreamer."""
    tool = script.parent / "gst-launch-1.0"
    tool.write_text("#!/bin/sh\nprintf '%s\\0' \"$@\"\n")
    tool.chmod(0o755)
    paths = {"PATH": f"{script.parent}:/usr/bin:/bin"}
    run = subprocess.run(
        ["dash", script], env=paths, cwd=script.parent, capture_output=True, check=True
    )
    assert not run.stderr
    tool.unlink()
    return run.stdout.decode().split("\0")


def name_of(tree: Any) -> list[str]:
    """Return the names of all elements of an image, except those of letters only."""
    return sorted(
        e.tag for e in tree.iter() if not e.tag.endswith(("}tspan", "}use", "}path", "}text"))
    )


def product_of(path: Path) -> str:
    """Return the product name as read by OpenCASCADE."""
    from OCP.STEPControl import STEPControl_Reader

    reader = STEPControl_Reader()
    reader.ReadFile(str(path))
    model = reader.Model()
    entities = (model.Value(i) for i in range(1, model.NbEntities() + 1))
    (product,) = (e for e in entities if e.DynamicType().Name() == "StepBasic_Product")
    return product.Name().ToCString()


def export(kind: str, name: str, folder: Path) -> list[Path]:
    path = folder / f"same{FORMATS[kind].suffixes[0]}"
    return [file.path for file in om.export(replace(SMALL, name=name), path, formats=[kind])]


def rays(kind: str, name: str, folder: Path) -> list[Path]:
    path = folder / f"same{RAY_FORMATS[kind].suffix}"
    return list(om.write_rays(replace(SMALL, name=name), path, formats=kind, step=16)[0].paths)


def maps(kind: str, name: str, folder: Path) -> list[Path]:
    path = folder / f"same{MAP_FORMATS[kind].suffix}"
    return list(om.write_maps(replace(SMALL, name=name), VIEW, path, formats=kind)[0].paths)


def figure(kind: str, name: str, folder: Path) -> list[Path]:
    return om.analysis.figures.save_all(
        [replace(SENSOR, name=name)], folder, formats=["svg"], names=[kind]
    )


WRITERS = {export: FORMATS, rays: RAY_FORMATS, maps: MAP_FORMATS, figure: FIGURES}
ALL = [(write, kind) for write, formats in WRITERS.items() for kind in formats]
EVERYDAY_WRITERS = [
    (write, kind) for write, kind in ALL if write != figure or kind in ("fig4", "fig7")
]


@cache
def plain_files(write: Any, kind: str) -> list[Path]:
    """Return files of a plain name."""
    return write(kind, PLAIN, Path(mkdtemp(dir=FOLDER.name)))


FOLDER = TemporaryDirectory()


def checks(write: Any, kind: str, name: str, folder: Path) -> None:
    """Write files of a hostile and a plain name, and compare them with their readers."""
    output, plain_output = write(kind, name, folder), plain_files(write, kind)
    assert len(output) == len(plain_output)
    for path, plain in zip(output, plain_output, strict=True):
        checked(path, plain, name)
    assert not list(folder.rglob(CANARY))


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("name", EVERYDAY)
@pytest.mark.parametrize(("write", "kind"), few(ALL, *EVERYDAY_WRITERS))
def test_every_writer_output_is_readable(write, kind, name, tmp_path):
    checks(write, kind, EVERYDAY[name], tmp_path)


@pytest.mark.full
@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(("write", "kind"), ALL)
def test_every_writer_accepts_every_name(write, kind, name, tmp_path):
    checks(write, kind, NAMES[name], tmp_path)


# -- writers of other packages, file names, mirror names
# ---------------------------------------------


def note_of(mirror: Any, paths: tuple[Path, ...]) -> tuple[str, Deviation]:
    paths[0].write_text(f'"""{escaping.python_docstring(mirror.name)}"""\n', encoding="utf-8")
    return "a note", Deviation()


def export_note(plan: Any, part: Any, path: Path) -> Content:
    path.write_text(f"/* {escaping.c_comment(part.name)} */\n", encoding="utf-8")
    return Content("a note", None)


@pytest.mark.parametrize("name", EVERYDAY)
def test_external_writers_are_checked(name, tmp_path):
    """Formats registered by other packages are covered by the preceding tests."""
    plugin = ExportFormat(note_of, (".py",), "Python")
    for write, formats, kind in (
        (rays, RAY_FORMATS, plugin),
        (maps, MAP_FORMATS, plugin),
        (export, FORMATS, Format(export_note, (".note",))),
    ):
        formats.register("a-note", kind)
        try:
            assert "a-note" in list(formats)
            checks(write, "a-note", EVERYDAY[name], tmp_path / write.__name__)
        finally:
            formats.withdraw("a-note")
            plain_files.cache_clear()


HOSTILE_STEMS = (
    f"a'b$(touch {CANARY})`touch {CANARY}`;{{x}}%s$HOME",
    'a" \\ b',
    "a\nb\u202e",
    "a\udcffb",
    "-a */ b",
    "ö 日本",
)


@pytest.mark.parametrize("stem", HOSTILE_STEMS, ids=range(len(HOSTILE_STEMS)))
@pytest.mark.parametrize(
    "kind", ["c99", "openmv", "gstreamer", "obs", "glsl", "blender", "mitsuba"]
)
def test_scripts_read_files_with_any_name(kind, stem, tmp_path):
    write, formats = (
        (om.write_rays, RAY_FORMATS) if kind in RAY_FORMATS else (om.write_maps, MAP_FORMATS)
    )
    more = {"step": 16} if kind in RAY_FORMATS else {"view": VIEW}
    path = tmp_path / f"{stem.replace('/', '|')}{formats[kind].suffix}"
    if kind == "c99" and not re.fullmatch(r'[^"\\\n\u202e\udcff]*', stem):
        with pytest.raises(
            InvalidParameter, match="the file name must not contain quotation marks"
        ):
            write(SMALL, path=path, formats=kind, **more)
        return
    (result,) = write(SMALL, path=path, formats=kind, **more)
    script = result.paths[0]
    if script.suffix == ".py":
        subprocess.run(
            [sys.executable, "-c", STUBS, script], cwd=tmp_path, capture_output=True, check=True
        )
    elif script.suffix == ".sh":
        assert any("vec2 NODES" in word for word in start_arguments(script))
    elif script.suffix == ".c":
        subprocess.run(
            ["gcc", "-std=c99", "-Werror", "-fsyntax-only", script.absolute()], check=True
        )
    else:
        assert code_of(script).count("float4 dewarped" if kind == "obs" else "void main") == 1
    assert not (tmp_path / CANARY).exists()


@pytest.mark.filterwarnings("ignore:Glyph")
@pytest.mark.parametrize("kind", few(["step", "dxf", "zmx", "csv", "svg"], "step", "csv", "zmx"))
def test_external_mirror_kind_is_escaped(kind, tmp_path):
    hostile = type("Hostile", (Sphere,), {"KIND": CODE})(
        SMALL.mirror.radius_mm, SMALL.mirror.rim_radius_mm
    )
    path = tmp_path / f"same{FORMATS[kind].suffixes[0]}"
    files = om.export(replace(SMALL, mirror=hostile, name=PLAIN), path, formats=[kind])
    if kind == "zmx":
        output, plain_output = (
            p.read_bytes().decode("utf-16") for p in (files[0].path, plain_files(export, kind)[0])
        )
        assert output.count("\n") == plain_output.count("\n")
    else:
        checked(files[0].path, plain_files(export, kind)[0], PLAIN)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", list(CAMERA_FORMATS))
def test_camera_file_round_trip_keeps_name(kind, name, tmp_path):
    """Every model of a format, under the name of a camera of another file."""
    for layout in CAMERA_FORMATS[kind].layouts.values():
        camera = next(
            (c for c in CAMERAS if isinstance(c, layout.kind) and not layout.unsupported(c)), None
        )
        if camera is None:
            continue
        output, plain_output = (layout.write(camera, each) for each in (NAMES[name], PLAIN))
        if isinstance(output, bytes):
            assert len(output) >= len(plain_output)
        else:
            assert output.count("\n") == plain_output.count("\n")
            assert escaping.escape_invisible(output, keep="\n\t") == output
        if kind in ("ros", "camodocal"):
            output = output.removeprefix("%YAML:1.0\n")  # directive of OpenCV
            assert yaml.safe_load(output)["camera_name"] == escaping.escape_invisible(NAMES[name])


CAMERAS = (
    om.KannalaBrandt(
        focal_px=(170.0, 170.0), centre_px=(319.5, 239.5), image_size=(640, 480), k1=0.01
    ),
    om.Unified(xi=0.0, focal_px=(170.0, 170.0), centre_px=(319.5, 239.5), image_size=(640, 480)),
    om.Unified(xi=0.9, focal_px=(170.0, 170.0), centre_px=(319.5, 239.5), image_size=(640, 480)),
)


@pytest.mark.parametrize("name", EVERYDAY)
def test_pages_hold_names_as_text(name, tmp_path, monkeypatch):
    """Reports, cards and the page of an image: names create no elements, attributes or scripts."""
    from omnimirror.apps.studio.pages import image_viewer
    from omnimirror.optics.sensor import sensor_card

    def pages(text: str) -> list[str]:
        sensor = replace(SMALL, name=text, notes=text)
        comparison = om.compare([sensor, replace(sensor, name=f"{text}2")])
        small = replace(
            sensor, imager=replace(sensor.imager, width_px=64, height_px=64, pixel_pitch_um=83.2)
        )
        om.write_demo(small, tmp_path / "demo", blur=False)
        om.write_comparison(comparison, tmp_path / "comparison.html", om.Room(texel_mm=100.0))
        comparison.to_csv(tmp_path / "comparison.csv")
        with (tmp_path / "comparison.csv").open(newline="") as file:
            rows = list(csv.reader(file))
        assert not any(re.match(r"[=+@\t\r]", cell) for cell in rows[0])
        view = image_viewer(
            sensor, text, ("--sensor", text), None, np.zeros((144, 160, 3), np.uint8)
        )
        files = (tmp_path / "demo" / "report.html", tmp_path / "comparison.html")
        return [*(file.read_text("utf-8") for file in files), sensor_card(sensor), view]

    for output, plain_output in zip(pages(EVERYDAY[name]), pages(PLAIN), strict=True):
        (page, plain) = Elements(output), Elements(plain_output)
        assert page.elements == plain.elements
        assert page.attributes.keys() == plain.attributes.keys()


@pytest.mark.parametrize(
    "name", few(NAMES, "python", "controls", "rich", "letters", "bidirectional")
)
def test_terminal_obeys_no_control_sequences(name, tmp_path):
    file = tmp_path / "a.toml"
    if name == "surrogate":
        pytest.skip("TOML has no surrogates")
    file.write_text(
        tomli_w.dumps(om.optics.sensor_files.tables_of(SENSOR) | {"name": NAMES[name]}),
        encoding="utf-8",
    )
    assert om.load_sensor(file).name == NAMES[name]
    run = omnimirror("compare", file, "paper-spherical")
    assert run.returncode == 0, run.stderr
    assert escaping.escape_invisible(run.stdout, keep="\n\t ") == run.stdout


def test_sensor_file_name_is_not_executed(tmp_path):
    """Regression test: ``rays`` and ``maps`` with a name that is Python code, and execution of the
    scripts."""
    (tmp_path / "a.toml").write_text(
        tomli_w.dumps(om.optics.sensor_files.tables_of(SMALL) | {"name": NAMES["python"]})
    )
    view = ("--view", "perspective", "--hfov-deg", 60, "--size", "64x48")
    for arguments in (
        ("rays", "--format", "mitsuba"),
        ("rays", "--format", "blender"),
        ("maps", "--format", "openmv", *view),
    ):
        run = omnimirror(*arguments, tmp_path / "a.toml", "-o", tmp_path / "out")
        assert run.returncode == 0, run.stderr
    scripts = list((tmp_path / "out").glob("*.py"))
    assert len(scripts) == 3
    for script in scripts:
        subprocess.run(
            [sys.executable, "-c", STUBS, script], cwd=tmp_path, capture_output=True, check=True
        )
    assert not list(tmp_path.rglob(CANARY))


@pytest.mark.parametrize(
    "character",
    ["\x00", "\x85", "\u202e", "\ufffe", "\uffff", "\U0001fffe", "\U000e0001", "\U0010ffff"],
)
def test_invisible_characters_round_trip_in_toml(character):
    code = escaping.toml_string(f"a{character}b")
    assert code.isascii()
    assert tomllib.loads(f"a = {code}") == {"a": f"a{character}b"}
    python = character.encode("unicode_escape").decode()  # as TOML, except for two digits
    assert code == f'"a{python.replace(chr(92) + "x", chr(92) + "u00")}b"'


@pytest.mark.parametrize(
    ("shorten", "longest"),
    [
        (escaping.label, 200),
        (escaping.step_string, 60),
        (lambda x: escaping.step_string(x, 300), 200),
    ],
    ids=["label", "name of STEP", "text of STEP"],
)
def test_labels_have_at_most_the_documented_length(shorten, longest):
    assert shorten("x" * longest) == "x" * longest
    assert shorten("x" * (longest + 1)) == "x" * (longest - 3) + "..."


def test_labels_examine_four_times_their_length():
    assert escaping.label("a" + "\n" * 18 + "bcdef", 6) == "a b..."
    assert escaping.label("a" + "\n" * 21 + "bcdef", 6) == "a bc"


def test_file_stems_have_at_most_100_bytes():
    assert escaping.file_stem("x" * 100, "") == "x" * 100
    assert escaping.file_stem("x" * 101, "") == "x" * 100
    assert escaping.file_stem("ö" * 51, "") == "ö" * 50


@pytest.mark.parametrize(
    ("visible", "invisible"),
    [
        ("\ufdcf", "\ufdd0"),
        ("\u200c", "\u200b"),
        ("\u200d", "\u200e"),
        ("\ufdf0", "\ufdef"),
        ("\ufffd", "\ufffe"),
        ("\U00010000", "\U0003ffff"),
    ],
)
def test_noncharacters_and_controls_are_invisible(visible, invisible):
    """Unicode, section 23.7: U+FDD0 to U+FDEF, and the last two code points of each plane; joiners
    are kept."""
    code = invisible.encode("unicode_escape").decode()
    assert escaping.escape_invisible(visible + invisible) == visible + code


@pytest.mark.parametrize(
    ("text", "codes"),
    [
        ("\udc80", r"\200"),
        ("\x01\udcff", r"\001\377"),
        ("\U000e0041\udc80", r"\363\240\201\201\200"),
        ("\ud800", r"\355\240\200"),
        ("\udfff", r"\355\277\277"),
        ("\udc7f", r"\355\261\277"),
        ("\udd00", r"\355\264\200"),
        ("\udc80\ud800", r"\355\262\200\355\240\200"),
    ],
    ids=ascii,
)
def test_octal_escapes_of_undecodable_bytes(text, codes):
    """Bytes of file names (PEP 383, U+DC80 to U+DCFF) unchanged; other surrogates as UTF-8 would
    encode them."""
    assert escaping.shell_word(text) == f"\"$(printf '{codes}')\""


def test_cells_and_indented_data():
    assert [escaping.csv_cell(text) for text in ("", "=1", " =1", "\t-1", "\tx")] == [
        "",
        "'=1",
        "' =1",
        "'\\t-1",
        "\\tx",
    ]
    assert escaping.json_text({"a": "b\x7f"}, indent=1) == '{\n "a": "b\\u007f"\n}'
    assert escaping.gstreamer_comment("a\\") == "a/ "


def test_figure_labels_have_at_most_40_characters():
    assert escaping.plot_text("x" * 40) == "x" * 40
    assert escaping.plot_text("x" * 41) == "x" * 37 + "..."


@pytest.mark.parametrize(
    ("longest", "expected"),
    [
        (27, r"\X4\0001F6000001F600\X0\..."),
        (26, r"\X4\0001F600\X0\..."),
        (19, r"\X4\0001F600\X0\..."),
        (18, "..."),
        (3, "..."),
    ],
)
def test_step_names_are_cut_between_encoded_characters(longest, expected):
    """ISO 10303-21, 6.4.3.3: eight hexadecimal digits per character in a frame of 16, from
    U+10000."""
    assert escaping.step_string("\U0001f600" * 9, longest) == expected
    assert escaping.step_string("\U00010000") == "\\X4\\00010000\\X0\\"
    assert escaping.step_string("\ufffd") == "\\X2\\FFFD\\X0\\"
