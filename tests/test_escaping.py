"""Hostile names in every file that is written: what real interpreters and parsers make of it."""

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
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import cv2
import ezdxf
import numpy as np
import OpenEXR
import pytest
import tomli_w
import yaml
from ezdxf.tools.text import plain_mtext, plain_text
from markdown_it import MarkdownIt
from matplotlib.cbook import is_math_text

import omnimirror as om
from omnimirror import escaping
from omnimirror.calibrate.formats.registry import FORMATS as CAMERA_FORMATS
from omnimirror.errors import InvalidParameter
from omnimirror.figures import FIGURES
from omnimirror.handoff.formats import Deviation, ProgramFormat
from omnimirror.handoff.maps import MAP_FORMATS
from omnimirror.handoff.rays import RAY_FORMATS
from omnimirror.manufacture import FORMATS, Content, Format
from omnimirror.mirrors import Sphere
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
SMALL = replace(SENSOR, imager=replace(SENSOR.imager, width_px=160, height_px=144, pixel_pitch_um=5.2 * 1024 / 160))
VIEW = om.screens.Plane((64, 48), hfov_deg=60.0)


# -- functions, one language each --------------------------------------------------------------------


def readable(name: str) -> str:
    """The name with its ordinary letters alone."""
    return "".join(re.findall(r"[A-Za-z0-9ößا-ي日本]", name))


@pytest.mark.parametrize("name", NAMES)
def test_python_source_holds_the_name_and_nothing_else(name):
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


def test_c_source_holds_all_names(tmp_path):
    """Comments end where they should, and strings have the bytes of the name, by a compiler of C99 with trigraphs."""
    lines = ["#include <stdio.h>", "int main(void) {", "int n = 0;"]
    for text in NAMES.values():
        lines += [f"// {escaping.c_comment(text)}", "++n;", f"/*{escaping.c_comment(text)}*/ ++n;"]
        lines += [f"fputs({escaping.c_string(text)}, stdout); putchar(0);"]
    source = tmp_path / "a.c"
    source.write_text("\n".join([*lines, 'printf("%d", n);', "return 0; }"]) + "\n", encoding="utf-8")
    gcc = ["gcc", "-std=c99", "-trigraphs", "-Wall", "-Werror", "-Wno-overlength-strings", "-o", str(tmp_path / "a")]
    subprocess.run([*gcc, str(source)], check=True, capture_output=True)
    *printed, count = subprocess.run([tmp_path / "a"], check=True, capture_output=True).stdout.split(b"\0")
    assert int(count) == 2 * len(NAMES)
    assert printed[:-1] == [text.encode() for text in list(NAMES.values())[:-1]]
    assert escaping.c_string("a\udcff") == '"a\\377"'


def test_shells_take_every_name_as_one_word(tmp_path):
    words = [text for text in NAMES.values() if "\ud800" not in text]
    command = escaping.shell_command(["printf", "%s\\0", *words, "\udcff", "", "a\n", "-n"])
    for shell in ("dash", "bash"):
        ran = subprocess.run([shell], input=command.encode(), capture_output=True, cwd=tmp_path, check=True)
        assert ran.stdout.split(b"\0")[:-1] == [*(w.encode() for w in words), b"\xff", b"", b"a\n", b"-n"]
        assert not ran.stderr
    assert not list(tmp_path.iterdir())
    assert escaping.visible(command, keep="\n") == command


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
def test_markup_and_data_hold_the_name(name):
    text = NAMES[name]
    shown = escaping.visible(text, keep="\n\t")
    page = Elements(f'<i title="{escaping.html_text(text)}">{escaping.html_text(text)}</i>')
    assert (page.elements, page.text, page.attributes) == (["i"], shown, {"title": shown})
    root = ElementTree.fromstring(f"<i title='{escaping.xml_text(text)}'>{escaping.xml_text(text)}</i>".encode())
    assert (root.text, len(root)) == (shown, 0)
    assert json.loads(escaping.json_text([text]).encode()) == [text]
    script = Elements(f"<script>{escaping.script_json(escaping.json_text([text]))}</script>")
    assert (script.elements, json.loads(script.text)) == (["script"], [text])
    kept = re.sub("[\ud800-\udfff]", lambda c: repr(c[0])[1:-1], text)
    document = f"# {escaping.line_comment(text)}\nname = {escaping.toml_string(text)}\n"
    assert tomllib.loads(document) == {"name": kept}
    quoted = escaping.csv_comment(escaping.toml_string(text))
    assert tomllib.loads(f"name = {quoted}") == {"name": kept}
    assert not any(re.match(r"\s*[\"']*[=+@-]", cell) for cell in re.split(r"[,;|\t]", quoted))
    assert yaml.safe_load(f"# {escaping.line_comment(text)}\nname: {escaping.yaml_string(text)}\n") == {
        "name": escaping.visible(text)
    }
    assert yaml.safe_load(f"- {escaping.yaml_string('no')}") == ["no"]
    into = io.StringIO()
    csv.writer(into).writerow(["x", escaping.csv_cell(text), "y"])
    ((_, cell, _),) = csv.reader(io.StringIO(into.getvalue()))
    assert cell.lstrip()[:1] not in ("=", "+", "-", "@", "\t", "\r")
    assert cell.removeprefix("'") == escaping.visible(text)
    tokens = MarkdownIt().enable("table").parse(f"| a |\n|---|\n| {escaping.markdown_text(text)} |\n\n# h\n")
    assert [t.type for t in tokens].count("td_open") == 1
    shown = [t for t in tokens if t.type == "inline"][1].children
    assert {t.type for t in shown} <= {"text", "text_special"}
    assert "".join(t.content for t in shown) == escaping.label(text).strip()


@pytest.mark.parametrize("name", NAMES)
def test_drawings_and_programs_hold_the_name(name):
    text = NAMES[name]
    line = escaping.label(text)
    assert re.fullmatch(r"[ -$&'*-:<->@-}]*", escaping.gcode_comment(text))
    labelled = escaping.plot_text(text)
    assert not is_math_text(labelled)
    assert escaping.label(text, escaping.MAX_PLOT_LABEL) == labelled.replace("\\$", "$")
    decoded = re.sub(r"\\U\+005C", lambda _: "\\", escaping.dxf_text(line))  # as a reader of DXF does it first
    assert plain_text(decoded.replace("%%%%%%", "\ue000")).replace("\ue000", "%%") == line.rstrip()
    multi = re.sub(r"\\U\+005C", lambda _: "\\", escaping.dxf_mtext(text))
    assert plain_mtext(multi.replace("%%%%%%", "\ue000")).replace("\ue000", "%%") == line
    assert escaping.step_string(text).isascii()
    for shown in (line, escaping.terminal_text(text), escaping.gstreamer_comment(text)):
        assert not re.search("[\x00-\x08\x0b-\x1f\x7f-\x9f\u2028-\u202e\u2066-\u2069\ud800-\udfff]", shown)
    assert not re.search(r'["\\]', escaping.gstreamer_comment(text))
    assert len(line) <= escaping.MAX_LABEL
    assert readable(line)[:40] == readable(escaping.visible(text.strip()))[:40] or name in ("controls", "newlines")


@pytest.mark.parametrize("name", NAMES)
def test_names_of_files_are_plain_and_short(name):
    stem = escaping.file_stem(NAMES[name], "sensor")
    assert re.fullmatch(r"[\w+][\w.+-]*", stem)
    assert len(stem.encode()) <= escaping.MAX_STEM
