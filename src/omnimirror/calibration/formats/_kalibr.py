"""Kalibr ``camchain.yaml``: cameras cam0, cam1, ... of a rig with four models."""

from __future__ import annotations

import re
from typing import Any

from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import DoubleSphere, EnhancedUnified, KannalaBrandt, Unified
from ._camera_format import (
    CameraEntry,
    CameraFile,
    CameraFormat,
    Layout,
    Node,
    ReadOptions,
    named_numbers,
    number_row,
)

MATRIX = frozenset({"fx", "fy", "cx", "cy"})
RADTAN = frozenset({"k1", "k2", "p1", "p2"})
DISTORTIONS = {
    "omni": ("radtan", "none"),
    "eucm": ("none",),
    "ds": ("none",),
    "pinhole": ("equidistant", "radtan", "none"),
}


def read(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the cameras of the chain in order; their relative poses are ignored."""
    chain = file.entries
    if "camera_model" in chain:  # single camera of a rig
        return [CameraEntry("", _camera(chain, reading))]
    names = [name for name in chain.names() if re.fullmatch(r"cam\d+", name)]
    if not names:
        chain.fail("must contain a camera cam0")
    return [
        CameraEntry(name, _camera(chain[name], reading))
        for name in sorted(names, key=lambda n: int(n[3:]))
    ]


def _camera(table: Node, reading: ReadOptions) -> Any:
    model = table["camera_model"].choice(*DISTORTIONS)
    distortion = "none"
    if "distortion_model" in table or "distortion_coeffs" in table:
        distortion = table["distortion_model"].choice(*DISTORTIONS[model])
    size = reading.size_in(table, "resolution")
    numbers = table["intrinsics"].row({"omni": 5, "pinhole": 4}.get(model, 6))
    *shape_parameters, fu, fv, pu, pv = numbers
    common: dict[str, Any] = {
        "focal_px": (fu, fv),
        "centre_px": (pu, pv),
        "image_size": size,
        **reading.model_arguments,
    }
    coefficients: tuple[float, ...] = ()
    if distortion != "none":
        coefficients = table["distortion_coeffs"].row(4)
    elif "distortion_coeffs" in table and any(table["distortion_coeffs"].row()):
        table["distortion_coeffs"].fail("must be empty or 0 for distortion_model none")
    try:
        if model == "eucm":
            return EnhancedUnified(**named_numbers(("alpha", "beta"), shape_parameters), **common)
        if model == "ds":
            return DoubleSphere(**named_numbers(("xi", "alpha"), shape_parameters), **common)
        if distortion == "equidistant":
            return KannalaBrandt(**common, **named_numbers(("k1", "k2", "k3", "k4"), coefficients))
        radtan = named_numbers(("k1", "k2", "p1", "p2"), coefficients)
        return Unified(xi=shape_parameters[0] if shape_parameters else 0.0, **common, **radtan)
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source} line {table.line}: {table.name}: {problem}") from None


# -- writing ----------------------------------------------------------------------------------


def _written(
    camera: Any,
    model: str,
    shape_parameters: tuple[float, ...],
    distortion: str,
    coefficients: tuple[float, ...],
) -> str:
    width, height = camera.image_size
    numbers = (*shape_parameters, *camera.focal_px, *camera.centre_px)
    return (
        "cam0:\n"
        "  cam_overlaps: []\n"
        f"  camera_model: {model}\n"
        f"  distortion_coeffs: [{number_row(coefficients)}]\n"
        f"  distortion_model: {distortion}\n"
        f"  intrinsics: [{number_row(numbers)}]\n"
        f"  resolution: [{width}, {height}]\n"
        "  rostopic: /cam0/image_raw\n"
    )


def write_omni(camera: Unified, name: str = "") -> str:
    """Return a chain of one camera ``omni`` with ``radtan`` distortion."""
    return _written(
        camera, "omni", (camera.xi,), "radtan", (camera.k1, camera.k2, camera.p1, camera.p2)
    )


def write_eucm(camera: EnhancedUnified, name: str = "") -> str:
    """Return a chain of one camera ``eucm``."""
    return _written(camera, "eucm", (camera.alpha, camera.beta), "none", ())


def write_ds(camera: DoubleSphere, name: str = "") -> str:
    """Return a chain of one camera ``ds``."""
    return _written(camera, "ds", (camera.xi, camera.alpha), "none", ())


def write_equi(camera: KannalaBrandt, name: str = "") -> str:
    """Return a chain of one camera ``pinhole`` with ``equidistant`` distortion."""
    return _written(
        camera, "pinhole", (), "equidistant", (camera.k1, camera.k2, camera.k3, camera.k4)
    )


def recognises(file: CameraFile) -> bool:
    """Check for a camera cam0 with a camera model, or a single camera."""
    if file.table is None:
        return False
    cameras = (entry for name, entry in file.table.value.items() if re.fullmatch(r"cam\d+", name))
    return any("camera_model" in camera for camera in cameras) or file.has(
        "camera_model", "intrinsics"
    )


FORMAT = CameraFormat(
    "Kalibr camchain YAML",
    recognises,
    read,
    {
        "kalibr-omni": Layout(Unified, write_omni, "omni with radtan", MATRIX | RADTAN | {"xi"}),
        "kalibr-eucm": Layout(EnhancedUnified, write_eucm, "eucm", MATRIX | {"alpha", "beta"}),
        "kalibr-ds": Layout(DoubleSphere, write_ds, "ds", MATRIX | {"xi", "alpha"}),
        "kalibr-equi": Layout(
            KannalaBrandt,
            write_equi,
            "pinhole with equidistant",
            MATRIX | {"k1", "k2", "k3", "k4"},
            90.0,
        ),
    },
    ("*camchain*.yaml", "*camchain*.yml"),
)
