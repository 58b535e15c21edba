"""MATLAB ``fisheyeIntrinsics``: Scaramuzza's polynomial with four coefficients.

In MATLAB the ray of a pixel is ``(u, v, a0 + a2 rho^2 + a3 rho^3 + a4 rho^4)``, with u right,
v down, Z towards the scene and a0 above 0. The pixel is ``[c d; e 1] (u, v) + centre``, and the
centre of the first pixel is (1, 1).

A ``.m`` file is a script: ``run camera.m`` creates ``intrinsics`` in the workspace. A ``.json``
file contains the four arguments: ``s = jsondecode(fileread("camera.json"));
intrinsics = fisheyeIntrinsics(s.MappingCoefficients', s.ImageSize', s.DistortionCenter',
s.StretchMatrix)``.
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

import numpy as np

from ....base.arguments import float_of
from ....base.errors import OmnimirrorError, SpecError
from ....base.typing import Array
from ....cameras.models import OCam
from ..base import CameraFile, CameraFormat, Layout, Reading, Stored, row
from ..entries import Node

LARGEST = 1e100
SCRIPT = re.compile(rb"fisheyeIntrinsics\s*\(")
TERMS = frozenset({"a0", "a2", "a3", "a4", "cx", "cy", "c", "d", "e"})
NAMES = ("MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix")


class Taylor(NamedTuple):
    """Scaramuzza's model as in MATLAB and py-OCamCalib: right and down, Z towards the scene."""

    coefficients: Array
    """Coefficients (n,) a0, a1, a2, ... with a0 > 0."""
    centre_px: tuple[float, float]
    """Matrix (2, 2) from the symmetric image to the real one, both (right, down).

    Its last element is 1.
    """
    stretch: Array
    """Matrix (2, 2) from the symmetric image to the real one, both (right, down); last element 1.
    """


def taylor_of(camera: OCam) -> Taylor:
    """Convert the parameters of an OCamCalib camera.

    OCamCalib's matrix, as (right, down), is ``[1 e; d c]``. Normalisation of its last element to 1
    scales the symmetric image by c, and ``a_n`` by ``c^(1 - n)``.

    >>> taylor_of(OCam((-100.0, 0.0, 0.002), (5.0, 5.0), (11, 11), (2.0, 0.0, 0.0))).coefficients
    array([ 2.e+02, -0.e+00, -1.e-03])
    """
    c, d, e = camera.affine
    powers = c ** (1.0 - np.arange(len(camera.polynomial)))
    return Taylor(-np.array(camera.polynomial) * powers, camera.centre_px, np.array([[1.0, e], [d, c]]) / c)


def ocam_of(taylor: Taylor, image_size: tuple[int, int], reading: Reading) -> OCam:
    """Convert to an OCamCalib camera, the inverse of `taylor_of`."""
    (first, q), (r, last) = taylor.stretch
    if not 1e-3 < abs(first) < 1e3:
        raise SpecError(f"{reading.source}: the stretch matrix begins with {first:g}; it is valid near 1")
    if not np.abs(taylor.coefficients).max(initial=0.0) < LARGEST:
        raise SpecError(
            f"{reading.source}: a coefficient of the polynomial is {LARGEST:g} or more, which is no camera's"
        )
    powers = first ** (1.0 - np.arange(len(taylor.coefficients)))
    polynomial = tuple((-np.asarray(taylor.coefficients) * powers).tolist())
    affine = (float(last / first), float(r / first), float(q / first))
    try:
        return OCam(polynomial, taylor.centre_px, image_size, affine, **reading.told)
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None


# -- reading ----------------------------------------------------------------------------------


def read(file: CameraFile, reading: Reading) -> list[Stored]:
    """Read the camera of a script that calls ``fisheyeIntrinsics``, or of a JSON file."""
    is_script = SCRIPT.search(file.data) is not None
    table = _arguments(file.text, reading.source) if is_script else file.entries
    a0, *rest = table[NAMES[0]].numbers(4)
    size = table[NAMES[1]].entries()
    if len(size) != 2:
        table[NAMES[1]].refuse("is valid as two numbers, rows and columns")
    height, width = (entry.whole() for entry in size)
    u, v = table[NAMES[2]].numbers(2)
    stretch = table[NAMES[3]].matrix(2, 2) if NAMES[3] in table else np.eye(2)
    taylor = Taylor(np.array([a0, 0.0, *rest]), (u - 1, v - 1), stretch)
    return [Stored("", ocam_of(taylor, (width, height), reading))]


def _arguments(text: str, source: str) -> Node:
    """Return the arguments of ``fisheyeIntrinsics`` in a script, each a row or matrix in brackets."""
    code = "\n".join(line.split("%")[0] for line in text.splitlines()).replace("...", "   ")
    call = re.search(r"fisheyeIntrinsics\s*\(([^()]*)\)", code)
    if not call:
        raise SpecError(f"{source} does not call fisheyeIntrinsics with its numbers in brackets")
    line = code[: call.start()].count("\n") + 1
    variables = dict(re.findall(r"(?m)^\s*([A-Za-z]\w*)\s*=\s*(\[[^\][]*\])\s*;?\s*$", code[: call.start()]))
    arguments = re.sub(r"[A-Za-z]\w*", lambda word: variables.get(word[0], word[0]), call[1])
    outside = re.sub(r"\[[^\][]*\]", "", re.sub(r"\d[eE][-+]?\d", "", arguments))
    if unknown := re.search(r"[A-Za-z]\w*", outside):
        raise SpecError(
            f"{source} line {line}: {unknown[0]} is a variable that the script does not set to numbers in brackets; "
            "write the numbers into the call of fisheyeIntrinsics"
        )
    parts = re.findall(r"\[([^\][]*)\]", arguments)
    if len(parts) not in (3, 4):
        raise SpecError(
            f"{source} line {line}: fisheyeIntrinsics has {len(parts)} arguments in brackets; it is valid with "
            f"3 or 4, {', '.join(NAMES)}"
        )
    table = {}
    for name, part in zip(NAMES, parts, strict=False):
        rows = [[_word(w, source, name, line) for w in re.split(r"[\s,]+", r.strip()) if w] for r in part.split(";")]
        entries = [Node(r, source, name, line) for r in rows]
        table[name] = Node(entries if len(entries) > 1 else rows[0], source, name, line)
    return Node(table, source, "", line)


def _word(word: str, source: str, name: str, line: int) -> Node:
    entry = Node(word, source, name, line)
    try:
        float_of(word)
    except ValueError:
        entry.refuse(f"holds {word[:40]!r}, which is not a number")
    return entry


def recognises(file: CameraFile) -> bool:
    """Check for a call of ``fisheyeIntrinsics``, or for its arguments."""
    return file.has(NAMES[0]) or (file.table is None and SCRIPT.search(file.data) is not None)


# -- writing ----------------------------------------------------------------------------------


def write_script(camera: OCam, name: str = "") -> str:
    """Return a script that creates the object ``intrinsics``."""
    a, (height, width), centre, stretch = _numbers(camera)
    matrix = "; ".join(row(r, " ") for r in stretch)
    return (
        "% Camera for MATLAB's Computer Vision Toolbox; run this file and use the variable intrinsics.\n"
        "% The centre of the picture's first pixel is (1, 1).\n"
        f"intrinsics = fisheyeIntrinsics([{row(a, ' ')}], ...\n"
        f"    [{height} {width}], ...  % rows and columns\n"
        f"    [{row(centre, ' ')}], ...\n"
        f"    [{matrix}]);\n"
    )


def write_json(camera: OCam, name: str = "") -> str:
    """Return the arguments of ``fisheyeIntrinsics`` as JSON for ``jsondecode``."""
    a, size, centre, stretch = _numbers(camera)
    values = (a.tolist(), list(size), list(centre), stretch.tolist())
    return json.dumps(dict(zip(NAMES, values, strict=True)), indent=2) + "\n"


def _numbers(camera: OCam) -> tuple[Array, tuple[int, int], tuple[float, float], Array]:
    taylor = taylor_of(camera)
    a = np.zeros(5)
    a[: min(5, len(taylor.coefficients))] = taylor.coefficients[:5]
    width, height = camera.image_size
    return a[[0, 2, 3, 4]], (height, width), (taylor.centre_px[0] + 1, taylor.centre_px[1] + 1), taylor.stretch


def _refuses(camera: OCam) -> str:
    a1 = (*camera.polynomial, 0.0)[1]
    return f"has no place for a1 = {a1:.6g}" if a1 else ""


WORDS = "Scaramuzza's a0, a2, a3, a4"
FORMAT = CameraFormat(
    "MATLAB fisheyeIntrinsics",
    recognises,
    read,
    {
        "matlab-script": Layout(OCam, write_script, WORDS, TERMS, suffixes=(".m", ".txt"), refuses=_refuses),
        "matlab-json": Layout(OCam, write_json, WORDS, TERMS, suffixes=(".json",), refuses=_refuses),
    },
    ("*.m",),
)
