"""Files with Scaramuzza's polynomial: OCamCalib, MATLAB, py-OCamCalib, py-omnicalib, MultiCol-SLAM."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ...base.arguments import parse_float
from ...base.errors import OmnimirrorError, SpecError
from ...base.typing import Array
from ...cameras.models import OCam
from ...cameras.models.ocam import parse_polynomials
from ...cameras.models.plausibility import inverse_polynomial_warnings
from ._camera_format import (
    CameraEntry,
    CameraFile,
    CameraFormat,
    Layout,
    Node,
    ReadOptions,
    number_row,
)

# -- OCamCalib ``calib_results.txt`` ---------------------------------------------------------------
#
# The model is described in :mod:`omnimirror.cameras.models.ocam`. The direct polynomial may have
# any degree; the inverse, which OCamCalib's ``world2cam`` uses for projection, is fitted when a
# file is written.

CLOSE_PX = 0.01  # tolerance of the inverse polynomial, as in OCamCalib's findinvpoly
MAX_TERMS = 30
SAMPLES = 2000


def read_ocamcalib(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of a ``calib_results.txt``."""
    camera, inverse = parse_polynomials(file.text, reading.source)
    camera = replace(camera, **reading.model_arguments)
    return [CameraEntry("", camera, tuple(inverse_polynomial_warnings(camera, inverse)))]


def write_ocamcalib(camera: OCam, name: str = "") -> str:
    """Return the text of a ``calib_results.txt``."""
    (u, v), (width, height) = camera.centre_px, camera.image_size
    inverse, _ = inverse_polynomial(camera, np.pi / 2)
    return (
        "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB). "
        "These are used by cam2world\n\n"
        f"{len(camera.polynomial)} {number_row(camera.polynomial, ' ')}\n\n"
        "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB). "
        "These are used by world2cam\n\n"
        f"{len(inverse)} {number_row(inverse, ' ')}\n\n"
        '#center: "row" and "column", starting from 0 (C convention)\n\n'
        f"{number_row((v, u), ' ')}\n\n"
        '#affine parameters "c", "d", "e"\n\n'
        f"{number_row(camera.affine, ' ')}\n\n"
        '#image size: "height" and "width"\n\n'
        f"{height} {width}\n"
    )


def inverse_polynomial(camera: OCam, start: float) -> tuple[Array, float]:
    """Return the radius in px as a polynomial of the field angle minus ``start``.

    Coefficients are in order of increasing powers.

    The degree is increased until the error is below :data:`CLOSE_PX`, as in OCamCalib's
    ``findinvpoly``.

    Parameters
    ----------
    camera
        Camera to approximate.
    start : radians
        Field angle of the origin: OCamCalib counts from the plane perpendicular to the axis,
        py-OCamCalib from the axis.

    Returns
    -------
    (n,) array, px; and the largest error, px
    """
    omega = np.linspace(0.0, camera.omega_max, SAMPLES)
    radius = camera.radius_from_omega(omega)
    coefficients, error = np.zeros(1), np.inf
    for terms in range(2, MAX_TERMS + 1):
        fitted = Polynomial.fit(omega - start, radius, terms - 1)
        coefficients = np.asarray(fitted.convert().coef, dtype=float)
        error = float(np.abs(Polynomial(coefficients)(omega - start) - radius).max())
        if error < CLOSE_PX:
            break
    return coefficients, error


def is_ocamcalib(file: CameraFile) -> bool:
    """Check that the first non-empty line is a count followed by that many numbers."""
    for line in file.data[:4000].decode("utf-8-sig", "replace").splitlines():
        words = line.split("#")[0].split()
        if words:
            return bool(re.fullmatch(r"\d{1,3}", words[0])) and len(words) == int(words[0]) + 1
    return False


OCAMCALIB = CameraFormat(
    "OCamCalib calib_results.txt",
    is_ocamcalib,
    read_ocamcalib,
    {"ocamcalib": Layout(OCam, write_ocamcalib, "Scaramuzza's polynomial")},
    ("calib_results*.txt",),
)


# -- MATLAB ``fisheyeIntrinsics`` ------------------------------------------------------------------
#
# In MATLAB the ray of a pixel is ``(u, v, a0 + a2 rho^2 + a3 rho^3 + a4 rho^4)``, with u right,
# v down, Z towards the scene and a0 above 0. The pixel is ``[c d; e 1] (u, v) + centre``, and the
# centre of the first pixel is (1, 1).
#
# A ``.m`` file is a script: ``run camera.m`` creates ``intrinsics`` in the workspace. A ``.json``
# file contains the four arguments: ``s = jsondecode(fileread("camera.json"));
# intrinsics = fisheyeIntrinsics(s.MappingCoefficients', s.ImageSize', s.DistortionCenter',
# s.StretchMatrix)``.

MATLAB_MAX = 1e100
MIN_STRETCH = 1e-3  # first element of the stretch matrix, which is near 1
MATLAB_SCRIPT = re.compile(rb"fisheyeIntrinsics\s*\(")
MATLAB_TERMS = frozenset({"a0", "a2", "a3", "a4", "cx", "cy", "c", "d", "e"})
MATLAB_NAMES = ("MappingCoefficients", "ImageSize", "DistortionCenter", "StretchMatrix")


class MatlabPolynomial(NamedTuple):
    """Scaramuzza's model as in MATLAB and py-OCamCalib: right and down, Z towards the scene."""

    coefficients: Array
    """Coefficients (n,) a0, a1, a2, ... with a0 > 0."""
    centre_px: tuple[float, float]
    """Centre (u, v), px."""
    stretch: Array
    """Matrix (2, 2) from the symmetric image to the real one, both (right, down); last element 1.
    """


def matlab_polynomial(camera: OCam) -> MatlabPolynomial:
    """Convert the parameters of an OCamCalib camera.

    OCamCalib's matrix, as (right, down), is ``[1 e; d c]``. Normalisation of its last element to 1
    scales the symmetric image by c, and ``a_n`` by ``c^(1 - n)``.

    >>> matlab_polynomial(
    ...     OCam(
    ...         polynomial=(-100.0, 0.0, 0.002),
    ...         centre_px=(5.0, 5.0),
    ...         image_size=(11, 11),
    ...         affine=(2.0, 0.0, 0.0),
    ...     )
    ... ).coefficients
    array([ 2.e+02, -0.e+00, -1.e-03])
    """
    c, d, e = camera.affine
    powers = c ** (1.0 - np.arange(len(camera.polynomial)))
    return MatlabPolynomial(
        -np.array(camera.polynomial) * powers, camera.centre_px, np.array([[1.0, e], [d, c]]) / c
    )


def ocam_of(taylor: MatlabPolynomial, image_size: tuple[int, int], reading: ReadOptions) -> OCam:
    """Convert to an OCamCalib camera, the inverse of `matlab_polynomial`."""
    (first, q), (r, last) = taylor.stretch
    if not MIN_STRETCH < abs(first) < 1 / MIN_STRETCH:
        raise SpecError(
            f"{reading.source}: the first element of the stretch matrix must be near 1; got {first:g}"
        )
    if not np.abs(taylor.coefficients).max(initial=0.0) < MATLAB_MAX:
        raise SpecError(
            f"{reading.source}: the coefficients of the polynomial must be below {MATLAB_MAX:g}"
        )
    powers = first ** (1.0 - np.arange(len(taylor.coefficients)))
    polynomial = tuple((-np.asarray(taylor.coefficients) * powers).tolist())
    affine = (float(last / first), float(r / first), float(q / first))
    try:
        return OCam(
            polynomial=polynomial,
            centre_px=taylor.centre_px,
            image_size=image_size,
            affine=affine,
            **reading.model_arguments,
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None


# -- reading ----------------------------------------------------------------------------------


def _mapping_coefficients(entry: Node, *counts: int) -> tuple[float, ...]:
    """Return coefficients a0, ... of a file whose third axis points towards the scene: a0 > 0."""
    numbers = entry.row(*counts)
    if not (numbers and numbers[0] > 0):
        value = f"{numbers[0]:g}" if numbers else "none"
        entry.fail(f"must begin with a positive number, f(0) > 0; got {value}")
    return numbers


def stretch_coefficient(entry: Node) -> float:
    """Return the coefficient c, which scales the image in one direction."""
    c = entry.number()
    if not MIN_STRETCH < abs(c) < 1 / MIN_STRETCH:
        entry.fail(f"must be near 1; got {c:g}")
    return c


def read_matlab(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of a script that calls ``fisheyeIntrinsics``, or of a JSON file."""
    is_script = MATLAB_SCRIPT.search(file.data) is not None
    table = _arguments(file.text, reading.source) if is_script else file.entries
    a0, *rest = _mapping_coefficients(table[MATLAB_NAMES[0]], 4)
    size = table[MATLAB_NAMES[1]].flat().entries()
    if len(size) != 2:
        table[MATLAB_NAMES[1]].fail("must be two numbers, rows and columns")
    height, width = (entry.integer() for entry in size)
    u, v = table[MATLAB_NAMES[2]].row(2)
    stretch = np.eye(2)
    if MATLAB_NAMES[3] in table:
        if len(table[MATLAB_NAMES[3]].entries()) != 2:  # a list of numbers is by column in MATLAB
            table[MATLAB_NAMES[3]].fail("must have 2 rows of 2 numbers")
        stretch = table[MATLAB_NAMES[3]].matrix(2, 2)
    taylor = MatlabPolynomial(np.array([a0, 0.0, *rest]), (u - 1, v - 1), stretch)
    return [CameraEntry("", ocam_of(taylor, (width, height), reading))]


BRACKETS = r"\[[^\][]*\]'?"  # numbers of a vector or matrix, also transposed
CONTINUATION = "\v"  # white space instead of the end of a continued line


def _arguments(text: str, source: str) -> Node:
    """Return the arguments of ``fisheyeIntrinsics`` in a script, each a row or matrix in brackets.

    Scripts are not executed: arithmetic, repeated assignments and several calls are rejected.
    """
    code = _without_matlab_comments(text)
    calls = list(re.finditer(r"fisheyeIntrinsics\s*\(((?:[^()]|\([^()]*\))*)\)", code))
    if not calls:
        raise SpecError(f"{source} must call fisheyeIntrinsics with numbers in brackets")
    if len(calls) > 1:
        raise SpecError(
            f"{source} must call fisheyeIntrinsics once; got {len(calls)} calls; store each camera "
            "in a file of its own"
        )
    before = code[: calls[0].start()]
    line = len(re.findall(rf"[\n{CONTINUATION}]", before)) + 1
    parts = [part.strip() for part in re.split(r",(?![^\[]*\])", calls[0][1])]
    if len(parts) not in (3, 4):
        raise SpecError(
            f"{source} line {line}: fisheyeIntrinsics must have 3 or 4 arguments in "
            f"brackets, {', '.join(MATLAB_NAMES)}; got {len(parts)}"
        )
    table = {}
    for name, part in zip(MATLAB_NAMES, parts, strict=False):
        at = f"{source} line {line}"
        numbers = _matlab_value(part, name, before, at)
        rows = [
            [_word(word, source, name, line) for word in re.split(r"[\s,]+", row.strip()) if word]
            for row in re.split(r"[;\n]", numbers.strip("[]'"))
        ]
        rows = [row for row in rows if row]
        if numbers.endswith("'") and len({len(row) for row in rows}) == 1:
            rows = [list(column) for column in zip(*rows, strict=True)]
        entries = [Node(row, source, name, line) for row in rows]
        is_row = len(entries) == 1
        table[name] = Node(rows[0] if is_row else entries, source, name, line)
    return Node(table, source, "", line)


def _without_matlab_comments(text: str) -> str:
    """Remove comments and continuations of a script, with unchanged numbers of lines."""

    def blank(match: re.Match[str]) -> str:
        return "\n" * match[0].count("\n")

    code = re.sub(r"(?ms)^[ \t]*%\{[ \t]*$.*?^[ \t]*%\}[ \t]*$", blank, text)
    code = "\n".join(line.split("%")[0] for line in code.splitlines())
    return re.sub(r"\.\.\.[^\n]*\n", CONTINUATION, code)


def _matlab_value(part: str, name: str, before: str, at: str) -> str:
    """Return the numbers in brackets of an argument: literal, identity matrix or variable."""
    if re.fullmatch(r"eye\s*\(\s*2\s*\)", part):
        return "[1 0; 0 1]"
    if re.fullmatch(BRACKETS, part):
        return part
    if not re.fullmatch(r"[A-Za-z]\w*", part):
        raise SpecError(f"{at}: {name} must be numbers in brackets; got {part[:40]!r}")
    # Assignments to the variable, to its elements, or to several variables at once.
    assignments = [
        match["value"] if match["index"] is None else None
        for match in re.finditer(
            rf"(?<![\w.]){part}[ \t]*(?P<index>\([^()]*\)|\{{[^{{}}]*\}}|\.\w+)?[ \t]*=(?!=)\s*"
            rf"(?P<value>{BRACKETS}(?=[ \t]*(?:[;,\n]|$)))?",
            before,
        )
    ]
    is_multiple = re.search(rf"\[[^\][]*\b{part}\b[^\][]*\]\s*=(?!=)", before)
    if len(assignments) != 1 or assignments[0] is None or is_multiple:
        raise SpecError(
            f"{at}: the variable {part} must be set once to numbers in brackets; write the numbers "
            "into the call of fisheyeIntrinsics"
        )
    return assignments[0]


def _word(word: str, source: str, name: str, line: int) -> Node:
    entry = Node(word, source, name, line)
    try:
        parse_float(word)
    except ValueError:
        entry.fail(f"must contain numbers; got {word[:40]!r}")
    return entry


def is_matlab(file: CameraFile) -> bool:
    """Check for a call of ``fisheyeIntrinsics``, or for its arguments."""
    return file.has(MATLAB_NAMES[0]) or (
        file.table is None and MATLAB_SCRIPT.search(file.data) is not None
    )


# -- writing ----------------------------------------------------------------------------------


def write_matlab_script(camera: OCam, name: str = "") -> str:
    """Return a script that creates the object ``intrinsics``."""
    a, (height, width), centre, stretch = _numbers(camera)
    matrix = "; ".join(number_row(r, " ") for r in stretch)
    return (
        "% Camera for MATLAB's Computer Vision Toolbox; run this file and use the variable "
        "intrinsics.\n% The centre of the first pixel is (1, 1).\nintrinsics = "
        f"fisheyeIntrinsics([{number_row(a, ' ')}], ...\n    [{height} {width}], ...  % rows "
        f"and columns\n    [{number_row(centre, ' ')}], ...\n    [{matrix}]);\n"
    )


def write_matlab_json(camera: OCam, name: str = "") -> str:
    """Return the arguments of ``fisheyeIntrinsics`` as JSON for ``jsondecode``."""
    a, size, centre, stretch = _numbers(camera)
    values = (a.tolist(), list(size), list(centre), stretch.tolist())
    return json.dumps(dict(zip(MATLAB_NAMES, values, strict=True)), indent=2) + "\n"


def _numbers(camera: OCam) -> tuple[Array, tuple[int, int], tuple[float, float], Array]:
    taylor = matlab_polynomial(camera)
    a = np.zeros(5)
    a[: min(5, len(taylor.coefficients))] = taylor.coefficients[:5]
    width, height = camera.image_size
    return (
        a[[0, 2, 3, 4]],
        (height, width),
        (taylor.centre_px[0] + 1, taylor.centre_px[1] + 1),
        taylor.stretch,
    )


def _refuses(camera: OCam) -> str:
    a1 = (*camera.polynomial, 0.0)[1]
    return f"cannot store a1 = {a1:.6g}" if a1 else ""


MATLAB_WORDS = "Scaramuzza's a0, a2, a3, a4"
MATLAB = CameraFormat(
    "MATLAB fisheyeIntrinsics",
    is_matlab,
    read_matlab,
    {
        "matlab-script": Layout(
            OCam,
            write_matlab_script,
            MATLAB_WORDS,
            MATLAB_TERMS,
            suffixes=(".m", ".txt"),
            restriction=_refuses,
        ),
        "matlab-json": Layout(
            OCam,
            write_matlab_json,
            MATLAB_WORDS,
            MATLAB_TERMS,
            suffixes=(".json",),
            restriction=_refuses,
        ),
    },
    ("*.m",),
)


# -- py-OCamCalib JSON -----------------------------------------------------------------------------
#
# Z points towards the scene; the conventions are those of its ``cam2world``. If the matrix's third
# element e is not 0, its ``world2cam`` inserts the already stretched column into the row equation,
# and differs from ``cam2world`` by ``e (c - 1)`` times the distance. The file does not contain the
# image size; this module adds ``image_size``, which py-OCamCalib ignores.


def read_py_ocamcalib(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of a calibration file."""
    table = file.entries
    coefficients = np.array(_mapping_coefficients(table["taylor_coefficient"]))
    u, v = table["distortion_center"].numbers(2)
    stretch = table["stretch_matrix"].matrix(2, 2)
    if "image_size" in table and len(table["image_size"].entries()) == 2:
        width, height = (entry.integer() for entry in table["image_size"].entries())
    else:
        width, height = reading.size()
    name = table.label("camera_name")
    camera = ocam_of(MatlabPolynomial(coefficients, (u, v), stretch), (width, height), reading)
    inverse = table["inverse_poly"].numbers() if "inverse_poly" in table else ()
    return [
        CameraEntry(
            name,
            camera,
            tuple(
                inverse_polynomial_warnings(camera, stretch[0, 0] * np.array(inverse[::-1]), 0.0)
            ),
        )
    ]


def write_py_ocamcalib(camera: OCam, name: str = "") -> str:
    """Return the text of a calibration file, without poses."""
    taylor = matlab_polynomial(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    scale = 1.0 / taylor.stretch[0, 0]  # to the symmetric image of py-OCamCalib
    values = {
        "camera_name": name or "camera",
        "taylor_coefficient": taylor.coefficients.tolist(),
        "distortion_center": list(taylor.centre_px),
        "stretch_matrix": taylor.stretch.tolist(),
        "inverse_poly": (inverse * scale)[::-1].tolist(),
        "image_size": list(camera.image_size),
    }
    return json.dumps(values, indent=4) + "\n"


PY_OCAMCALIB = CameraFormat(
    "py-OCamCalib JSON",
    lambda file: file.has("taylor_coefficient"),
    read_py_ocamcalib,
    {"py-ocamcalib": Layout(OCam, write_py_ocamcalib, "Scaramuzza's polynomial")},
    (),
)


# -- py-omnicalib YAML -----------------------------------------------------------------------------
#
# Z points towards the scene. Pixels are square and the image is rotationally symmetric: there is no
# affine matrix. The file does not contain the image size; this module adds ``image_size``, which
# py-omnicalib ignores.

INVERSE_TERMS = "poly_incident_angle_to_radius"
PY_OMNICALIB_PARAMETERS = frozenset({"cx", "cy", *(f"a{power}" for power in range(MAX_TERMS))})


def read_py_omnicalib(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of a ``calibration.yml``, without poses."""
    table = file.entries
    coefficients = np.array(_mapping_coefficients(table["poly_radius_to_z"]))
    u, v = table["principal_point"].numbers(2)
    camera = ocam_of(
        MatlabPolynomial(coefficients, (u, v), np.eye(2)),
        reading.size_in(table, "image_size"),
        reading,
    )
    inverse = table[INVERSE_TERMS].numbers() if INVERSE_TERMS in table else ()
    return [CameraEntry("", camera, tuple(inverse_polynomial_warnings(camera, inverse, 0.0)))]


def write_py_omnicalib(camera: OCam, name: str = "") -> str:
    """Return the text of a ``calibration.yml``, without poses."""
    taylor = matlab_polynomial(camera)
    inverse, _ = inverse_polynomial(camera, 0.0)
    width, height = camera.image_size
    return (
        f"extrinsics: []\n{INVERSE_TERMS}: [{number_row(inverse)}]\npoly_radius_to_z: "
        f"[{number_row(taylor.coefficients)}]\nprincipal_point: "
        f"[{number_row(taylor.centre_px)}]\nimage_size: [{width}, {height}]\n"
    )


PY_OMNICALIB = CameraFormat(
    "py-omnicalib YAML",
    lambda file: file.has("poly_radius_to_z"),
    read_py_omnicalib,
    {
        "py-omnicalib": Layout(
            OCam,
            write_py_omnicalib,
            "Scaramuzza's polynomial of a rotationally symmetric image",
            PY_OMNICALIB_PARAMETERS,
        )
    },
)


# -- MultiCol-SLAM YAML ----------------------------------------------------------------------------
#
# The affine matrix applies to (x, y): ``u = c X + d Y + u0``, ``v = e X + Y + v0``. The format is
# read-only.


def read_multicol(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file."""
    table = file.entries
    c = stretch_coefficient(table["Camera.c"])
    d, e, u, v = (table[f"Camera.{name}"].number() for name in ("d", "e", "u0", "v0"))
    size = (
        reading.size()
        if "Camera.Iw" not in table
        else (table["Camera.Iw"].integer(), table["Camera.Ih"].integer())
    )
    direct = -np.array(table.polynomial("Camera.a"))
    camera = ocam_of(MatlabPolynomial(direct, (u, v), np.array([[c, d], [e, 1.0]])), size, reading)
    inverse = table.polynomial("Camera.pol") if "Camera.pol0" in table else ()
    for name, polynomial in (("Camera.nrpol", direct), ("Camera.nrinvpol", inverse)):
        if name in table and table[name].integer() != len(polynomial):
            table[name].fail(f"must be the number of coefficients, {len(polynomial)}")
    return [
        CameraEntry("", camera, tuple(inverse_polynomial_warnings(camera, c * np.array(inverse))))
    ]


MULTICOL = CameraFormat(
    "MultiCol-SLAM YAML", lambda file: file.has("Camera.a0", "Camera.c"), read_multicol, {}
)
