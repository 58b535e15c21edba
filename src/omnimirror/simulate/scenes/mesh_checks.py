"""What makes a mesh no scene: said of the file before anything is seen of it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ...errors import MediaError
from ...files import parse_json
from .contract import Array

SMALLEST_MM, LARGEST_MM = 0.01, 1e9
ZERO_INDEX = re.compile(rb"^[ \t]*f[ \t](?:.*[ \t/])?0(?=[/ \t\r\n]|$)", re.M)
MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.M)
COLOURS = re.compile(rb"^[ \t]*map_Kd[ \t]+(.+?)[ \t\r]*$", re.M)
TEXTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t\r]*$", re.M)
HEAD = 1 << 16


def check_file(path: Path) -> None:
    """Raise MediaError if the text of a mesh's file is wrong, or names files that are not there."""
    suffix = path.suffix.lower()
    if suffix == ".obj":
        _check_obj(path)
    elif suffix == ".gltf":
        _check_gltf(path)
    elif suffix == ".ply":
        with path.open("rb") as file:
            for name in TEXTURE.findall(file.read(HEAD)):
                _check_there(path, "texture", _text(name))


def check_faces(path: Path, faces: NDArray[np.integer], count: int) -> None:
    """Raise MediaError if triangles (n, 3) name corners that a mesh does not have."""
    if (wrong := (faces < 0) | (faces >= count)).any():
        raise MediaError(
            f"the mesh {path} has {int(wrong.any(axis=1).sum())} triangles of corners that are not there, such as "
            f"{faces[wrong][0]}; it has {count}, from 0 on"
        )


def check_corners(path: Path, corners_mm: list[Array]) -> None:
    """Raise MediaError unless triangles (n, 3, 3) mm are a thing that can be seen."""
    bad = sum(int((~np.isfinite(corners).all(axis=(1, 2))).sum()) for corners in corners_mm)
    count = sum(len(corners) for corners in corners_mm)
    if bad:
        raise MediaError(f"the mesh {path} has corners that are no finite numbers in {bad} of its {count} triangles")
    low, high = (pick([pick(corners, axis=(0, 1)) for corners in corners_mm], axis=0) for pick in (np.min, np.max))
    extent = float(np.max(high - low))
    if not SMALLEST_MM <= extent <= LARGEST_MM:
        raise MediaError(
            f"the mesh {path} is {extent:.3g} mm across, and valid are {SMALLEST_MM:g} to {LARGEST_MM:g} mm; give its "
            "unit, --unit-mm"
        )
    sides = [corners[:, 1:] - corners[:, :1] for corners in corners_mm]
    if not any(np.cross(side[:, 0], side[:, 1]).any() for side in sides):
        raise MediaError(f"the mesh {path} has no area: each of its {count} triangles is a line or a point")


def _check_obj(path: Path) -> None:
    text = path.read_bytes()
    if found := ZERO_INDEX.search(text):
        line = text.count(b"\n", 0, found.end()) + 1
        raise MediaError(
            f"the mesh {path} has a face with the index 0 in line {line}; OBJ counts from 1, or from -1 back"
        )
    for names in MATERIALS.findall(text):
        name = _text(names)
        _check_there(path, "material file", name)
        for options in COLOURS.findall((path.parent / name).read_bytes()):
            texture = _text(options)
            if not (path.parent / texture).is_file():  # options come before the name
                texture = texture.split()[-1]
            _check_there(path, "texture", texture)


def _check_gltf(path: Path) -> None:
    try:
        data: Any = parse_json(path.read_bytes())
        parts = [(what, each.get("uri")) for what in ("images", "buffers") for each in data.get(what, [])]
    except (ValueError, AttributeError):
        return  # the reader says what is wrong
    for what, uri in parts:
        if isinstance(uri, str) and not uri.startswith("data:"):
            _check_there(path, {"images": "texture", "buffers": "buffer"}[what], unquote(uri))


def _check_there(path: Path, what: str, name: str) -> None:
    if not (path.parent / name).is_file():
        raise MediaError(f"the mesh {path} names the {what} {name!r}, which is not there; put it into {path.parent}")


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace").strip().strip('"')
