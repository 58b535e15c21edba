"""Validation of mesh files before rendering."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from ...base.errors import MediaError
from ...base.files import check_file, open_file, parse_json, read_bytes
from ...base.typing import Array

SMALLEST_MM, LARGEST_MM = 0.01, 1e9
ZERO_INDEX = re.compile(rb"^[ \t]*f[ \t](?:.*[ \t/])?0(?=[/ \t\r\n]|$)", re.M)
MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.M)
COLOURS = re.compile(rb"^[ \t]*map_Kd[ \t]+(.+?)[ \t\r]*$", re.M)
TEXTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t\r]*$", re.M)
HEAD = 1 << 16
LARGEST_MESH = 256 << 20
"""Maximum size in bytes of a mesh, and of each file that it references."""
MOST_CORNERS = 50_000_000
"""Maximum number of values in the accessors of a glTF file."""


def check_mesh_file(path: Path) -> None:
    """Check the type and size of a mesh file and of its referenced files, and the text of OBJ and
    glTF files.

    Raises
    ------
    MediaError
        If a file is missing, is not a regular file, or is too large; or the text is invalid.
    """
    try:
        check_file(path, LARGEST_MESH)
    except OSError as e:
        raise MediaError(f"cannot read the mesh {path}: {e.strerror or e}") from None
    suffix = path.suffix.lower()
    if suffix == ".obj":
        _check_obj(path)
    elif suffix in (".gltf", ".glb"):
        _check_gltf(path)
    elif suffix == ".ply":
        with open_file(path) as file:
            names = TEXTURE.findall(file.read(HEAD))
        for name in names:
            _check_there(path, "texture", _text(name))


def check_faces(path: Path, faces: NDArray[np.integer], count: int) -> None:
    """Raise MediaError if triangles (n, 3) reference missing vertices."""
    if (wrong := (faces < 0) | (faces >= count)).any():
        raise MediaError(
            f"the mesh {path} has {int(wrong.any(axis=1).sum())} triangles of corners that are not there, such as "
            f"{faces[wrong][0]}; it has {count}, from 0 on"
        )


def check_corners(path: Path, corners_mm: list[Array]) -> None:
    """Raise MediaError unless triangles (n, 3, 3) mm are a visible object."""
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
    text = read_bytes(path, LARGEST_MESH)
    if found := ZERO_INDEX.search(text):
        line = text.count(b"\n", 0, found.end()) + 1
        raise MediaError(
            f"the mesh {path} has a face with the index 0 in line {line}; OBJ counts from 1, or from -1 back"
        )
    for names in MATERIALS.findall(text):
        name = _text(names)
        _check_there(path, "material file", name)
        for options in COLOURS.findall(read_bytes(path.parent / name, LARGEST_MESH)):
            texture = _text(options)
            if not (path.parent / texture).is_file():  # options precede the name
                texture = texture.split()[-1]
            _check_there(path, "texture", texture)


def _check_gltf(path: Path) -> None:
    content = read_bytes(path, LARGEST_MESH)
    if content.startswith(b"glTF"):  # binary form: a header, and JSON in the first chunk
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    try:
        data: Any = parse_json(content)
        parts = [(what, each.get("uri")) for what in ("images", "buffers") for each in data.get(what, [])]
        corners = sum(each.get("count", 0) for each in data.get("accessors", []))
        too_many = corners > MOST_CORNERS  # accessors without a buffer are zeros, without data in the file
    except (ValueError, AttributeError, TypeError):
        return  # the reader reports the reason
    if too_many:
        raise MediaError(f"the mesh {path} must not hold more than {MOST_CORNERS} values of corners; got {corners}")
    for what, uri in parts:
        if isinstance(uri, str) and not uri.startswith("data:"):
            _check_there(path, {"images": "texture", "buffers": "buffer"}[what], unquote(uri))


def _check_there(path: Path, what: str, name: str) -> None:
    try:
        check_file(path.parent / name, LARGEST_MESH)
    except FileNotFoundError:
        raise MediaError(
            f"the mesh {path} names the {what} {name!r}, which is not there; put it into {path.parent}"
        ) from None
    except OSError as e:
        raise MediaError(f"the mesh {path} names the {what} {name!r}, which cannot be read: {e.strerror}") from None


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace").strip().strip('"')
