"""Basalt calibration JSON: cameras of a rig with the models of ``basalt-headers``."""

from __future__ import annotations

import json
from typing import Any

from ...base.errors import OmnimirrorError, SpecError
from ...cameras.models import DoubleSphere, EnhancedUnified, KannalaBrandt, RationalPinhole, Unified
from ._camera_format import CameraEntry, CameraFile, CameraFormat, Layout, Node, ReadOptions

MATRIX = ("fx", "fy", "cx", "cy")
KS = ("k1", "k2", "k3", "k4")
RADTAN8 = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
MODELS: dict[str, tuple[Any, tuple[str, ...], dict[str, float]]] = {
    "ds": (DoubleSphere, ("xi", "alpha"), {}),
    "eucm": (EnhancedUnified, ("alpha", "beta"), {}),
    "kb4": (KannalaBrandt, KS, {}),
    "ucm": (EnhancedUnified, ("alpha",), {"beta": 1.0}),
    "pinhole": (Unified, (), {"xi": 0.0}),
    "pinhole-radtan8": (RationalPinhole, RADTAN8, {}),
}
"""Camera model, its parameters in the file, and constants for missing ones, by Basalt's name."""


def read(file: CameraFile, reading: ReadOptions) -> list[CameraEntry]:
    """Read the cameras in the order of the file; their poses are ignored."""
    table = _calibration(file.entries)
    cameras = table["intrinsics"].entries()
    sizes = table["resolution"].entries() if "resolution" in table else []
    if sizes and len(sizes) != len(cameras):
        table["resolution"].fail(f"must have one size per camera, {len(cameras)}; got {len(sizes)}")
    if not cameras:
        table["intrinsics"].fail("must contain at least one camera; got none")
    stored = []
    for i, camera in enumerate(cameras):
        size = Node({"resolution": sizes[i]} if sizes else {}, table.source)
        stored.append(
            CameraEntry(str(i), _camera(camera, reading.size_in(size, "resolution"), reading))
        )
    return stored


def _calibration(entries: Node) -> Node:
    """Return the table in the wrapper ``value0`` of the library cereal."""
    return entries["value0"] if "value0" in entries else entries  # noqa: SIM401


def _camera(entry: Node, size: tuple[int, int], reading: ReadOptions) -> Any:
    model, names, fixed = MODELS[entry["camera_type"].choice(*MODELS)]
    table = entry["intrinsics"]
    fx, fy, cx, cy = (table[name].number() for name in MATRIX)
    values = {name: table[name].number() for name in names}
    try:
        return model(
            focal_px=(fx, fy),
            centre_px=(cx, cy),
            image_size=size,
            **values,
            **fixed,
            **reading.model_arguments,
        )
    except OmnimirrorError as problem:
        raise SpecError(f"{reading.source}: {entry.name}: {problem}") from None


def _layout(name: str) -> Layout:
    model, names, _ = MODELS[name]

    def write(camera: Any, title: str = "") -> str:
        matrix = dict(zip(MATRIX, (*camera.focal_px, *camera.centre_px), strict=True))
        numbers = {
            k: float(v) for k, v in (matrix | {n: getattr(camera, n) for n in names}).items()
        }
        pose = {"px": 0.0, "py": 0.0, "pz": 0.0, "qx": 0.0, "qy": 0.0, "qz": 0.0, "qw": 1.0}
        table = {
            "T_imu_cam": [pose],
            "intrinsics": [{"camera_type": name, "intrinsics": numbers}],
            "resolution": [list(camera.image_size)],
        }
        return json.dumps({"value0": table}, indent=4) + "\n"

    return Layout(model, write, name, frozenset({*MATRIX, *names}), suffixes=(".json",))


def recognises(file: CameraFile) -> bool:
    """Check for a list of intrinsics with camera types."""
    table = None if file.table is None else _calibration(file.table)
    cameras = table["intrinsics"].value if table is not None and "intrinsics" in table else None
    return isinstance(cameras, list) and any("camera_type" in camera for camera in cameras)


FORMAT = CameraFormat(
    "Basalt calibration JSON",
    recognises,
    read,
    {f"basalt-{name}": _layout(name) for name in ("ds", "eucm", "kb4")},
)
