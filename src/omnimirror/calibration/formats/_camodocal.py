"""camodocal camera YAML (VINS, KITTI-360, LF-VIO): MEI, KANNALA_BRANDT, SCARAMUZZA, PINHOLE."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...base.errors import OmnimirrorError, SpecError
from ...base.escaping import yaml_string
from ...cameras.models import KannalaBrandt, Unified
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
from ._opencv import image_size
from ._scaramuzza import MatlabPolynomial, ocam_of, stretch_coefficient

MATRIX = frozenset({"fx", "fy", "cx", "cy"})
KS = ("k2", "k3", "k4", "k5")
RADTAN = ("k1", "k2", "p1", "p2")
MODELS = ("MEI", "KANNALA_BRANDT", "SCARAMUZZA", "PINHOLE")
FOCAL = {"MEI": ("gamma1", "gamma2", "u0", "v0"), "KANNALA_BRANDT": ("mu", "mv", "u0", "v0")}


def read(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the camera of the file."""
    table = file.entries
    model = table["model_type"].word().upper()
    name = table.label("camera_name")
    if model not in MODELS:
        table["model_type"].choice(*MODELS)
    try:
        size = image_size(table, reading)
        if model == "SCARAMUZZA":
            return [_scaramuzza(table, name, size, reading)]
        return [CameraEntry(name, _sphere(table, model, size, reading))]
    except SpecError:
        raise
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {problem}") from None


def _sphere(table: Node, model: str, size: tuple[int, int], reading: ReadOptions) -> Any:
    projection = table["projection_parameters"]
    fu, fv, u, v = (
        projection[name].number() for name in FOCAL.get(model, ("fx", "fy", "cx", "cy"))
    )
    common: dict[str, Any] = {
        "focal_px": (fu, fv),
        "centre_px": (u, v),
        "image_size": size,
        **reading.model_arguments,
    }
    if model == "KANNALA_BRANDT":
        coefficients = {f"k{i}": projection[k].number() for i, k in enumerate(KS, 1)}
        return KannalaBrandt(**common | coefficients)
    xi = table["mirror_parameters"]["xi"].number() if model == "MEI" else 0.0
    distortion = table["distortion_parameters"]
    return Unified(xi=xi, **common | {k: distortion[k].number() for k in RADTAN})


def _scaramuzza(table: Node, name: str, size: tuple[int, int], reading: ReadOptions) -> CameraEntry:
    affine = table["affine_parameters"]
    c = stretch_coefficient(affine["ac"])
    d, e, x, y = (affine[k].number() for k in ("ad", "ae", "cx", "cy"))
    direct = -np.array(table["poly_parameters"].polynomial("p"))
    camera = ocam_of(MatlabPolynomial(direct, (x, y), np.array([[c, d], [e, 1.0]])), size, reading)
    inverse = table["inv_poly_parameters"].polynomial("p") if "inv_poly_parameters" in table else ()
    return CameraEntry(
        name, camera, tuple(inverse_polynomial_warnings(camera, c * np.array(inverse)))
    )


# -- writing ----------------------------------------------------------------------------------


def _written(camera: Any, name: str, model: str, tables: dict[str, dict[str, float]]) -> str:
    width, height = camera.image_size
    lines = [
        "%YAML:1.0",
        "---",
        f"model_type: {model}",
        f"camera_name: {yaml_string(name or 'camera')}",
        f"image_width: {width}",
        f"image_height: {height}",
    ]
    for title, numbers in tables.items():
        lines += [
            f"{title}:",
            *(f"   {key}: {number_row([value])}" for key, value in numbers.items()),
        ]
    return "\n".join(lines) + "\n"


def _projection(camera: Any, model: str) -> dict[str, float]:
    return dict(zip(FOCAL[model], (*camera.focal_px, *camera.centre_px), strict=True))


def write_mei(camera: Unified, name: str = "") -> str:
    """Return the text of a camera MEI."""
    tables = {
        "mirror_parameters": {"xi": camera.xi},
        "distortion_parameters": {k: getattr(camera, k) for k in RADTAN},
        "projection_parameters": _projection(camera, "MEI"),
    }
    return _written(camera, name, "MEI", tables)


def write_kannala_brandt(camera: KannalaBrandt, name: str = "") -> str:
    """Return the text of a camera KANNALA_BRANDT."""
    ks = {k: getattr(camera, f"k{i}") for i, k in enumerate(KS, 1)}
    return _written(
        camera,
        name,
        "KANNALA_BRANDT",
        {"projection_parameters": ks | _projection(camera, "KANNALA_BRANDT")},
    )


FORMAT = CameraFormat(
    "camodocal YAML",
    lambda file: (
        file.has("model_type")
        and (file.has("projection_parameters") or file.has("poly_parameters"))
    ),
    read,
    {
        "camodocal-mei": Layout(
            Unified, write_mei, "the unified sphere (MEI)", MATRIX | {*RADTAN, "xi"}
        ),
        "camodocal-kannala-brandt": Layout(
            KannalaBrandt,
            write_kannala_brandt,
            "Kannala and Brandt's polynomial (KANNALA_BRANDT)",
            MATRIX | {"k1", "k2", "k3", "k4"},
        ),
    },
)
