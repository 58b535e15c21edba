"""Scenes from files: triangle meshes in glTF, GLB, OBJ, PLY and STL, and their validation."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import cv2
import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light, linear_from_srgb
from ...base.errors import InvalidParameter, MediaError, extra_remedy
from ...base.files import check_file, open_file, parse_json, read_bytes
from ...base.typing import Array
from ...cameras.camera import rotate_vectors
from ._painting import Surroundings
from .scene import Scene, Surfaces, Texture, combine_surfaces, facets, textured_triangles

# -- Validation ------------------------------------------------------------------------------------

MIN_EXTENT_MM, MAX_EXTENT_MM = 0.01, 1e9
ZERO_INDEX = re.compile(rb"^[ \t]*f[ \t](?:.*[ \t/])?0(?=[/ \t\r\n]|$)", re.M)
MATERIALS = re.compile(rb"^[ \t]*mtllib[ \t]+(.+?)[ \t\r]*$", re.M)
COLOURS = re.compile(rb"^[ \t]*map_Kd[ \t]+(.+?)[ \t\r]*$", re.M)
TEXTURE = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+?)[ \t\r]*$", re.M)
HEADER_BYTES = 1 << 16
MAX_MESH_BYTES = 256 << 20
"""Maximum size in bytes of a mesh, and of each file that it references."""
MAX_CORNERS = 50_000_000
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
        check_file(path, MAX_MESH_BYTES)
    except OSError as e:
        raise MediaError(f"cannot read the mesh {path}: {e.strerror or e}") from None
    suffix = path.suffix.lower()
    if suffix == ".obj":
        _check_obj(path)
    elif suffix in (".gltf", ".glb"):
        _check_gltf(path)
    elif suffix == ".ply":
        with open_file(path) as file:
            names = TEXTURE.findall(file.read(HEADER_BYTES))
        for name in names:
            _check_referenced_file(path, "texture", _text(name))


def check_faces(path: Path, faces: NDArray[np.integer], count: int) -> None:
    """Raise MediaError if triangles (n, 3) reference missing vertices."""
    if (invalid := (faces < 0) | (faces >= count)).any():
        raise MediaError(
            f"the corner indices of the mesh {path} must be between 0 and {count - 1}; got "
            f"{faces[invalid][0]}, in total {int(invalid.any(axis=1).sum())} invalid "
            "triangles"
        )


def check_corners(path: Path, corners_mm: list[Array]) -> None:
    """Raise MediaError unless triangles (n, 3, 3) mm are a visible object."""
    invalid = sum(int((~np.isfinite(corners).all(axis=(1, 2))).sum()) for corners in corners_mm)
    count = sum(len(corners) for corners in corners_mm)
    if invalid:
        raise MediaError(
            f"the corners of the mesh {path} must be finite; {invalid} of {count} triangles are not"
        )
    low, high = (
        pick([pick(corners, axis=(0, 1)) for corners in corners_mm], axis=0)
        for pick in (np.min, np.max)
    )
    extent = float(np.max(high - low))
    if not MIN_EXTENT_MM <= extent <= MAX_EXTENT_MM:
        raise MediaError(
            f"the extent of the mesh {path} must be between {MIN_EXTENT_MM:g} and "
            f"{MAX_EXTENT_MM:g} mm; got {extent:.3g} mm; specify the unit of the mesh "
            "(scene.unit_mm)"
        )
    sides = [corners[:, 1:] - corners[:, :1] for corners in corners_mm]
    if not any(np.cross(side[:, 0], side[:, 1]).any() for side in sides):
        raise MediaError(f"the mesh {path} must have an area; all {count} triangles are degenerate")


def _check_obj(path: Path) -> None:
    text = read_bytes(path, MAX_MESH_BYTES)
    if match := ZERO_INDEX.search(text):
        line = text.count(b"\n", 0, match.end()) + 1
        raise MediaError(
            f"the mesh {path}: indices of OBJ files must be nonzero; got 0 in line {line}"
        )
    for names in MATERIALS.findall(text):
        name = _text(names)
        _check_referenced_file(path, "material file", name)
        for options in COLOURS.findall(read_bytes(path.parent / name, MAX_MESH_BYTES)):
            texture = _text(options)
            if not (path.parent / texture).is_file():  # options precede the name
                texture = texture.split()[-1]
            _check_referenced_file(path, "texture", texture)


def _check_gltf(path: Path) -> None:
    content = read_bytes(path, MAX_MESH_BYTES)
    if content.startswith(b"glTF"):  # binary form: a header, and JSON in the first chunk
        content = content[20 : 20 + int.from_bytes(content[12:16], "little")]
    try:
        data: Any = parse_json(content)
        parts = [
            (kind, each.get("uri")) for kind in ("images", "buffers") for each in data.get(kind, [])
        ]
        corners = sum(each.get("count", 0) for each in data.get("accessors", []))
        too_many = (
            corners > MAX_CORNERS
        )  # accessors without a buffer are zeros, without data in the file
    except (ValueError, AttributeError, TypeError):
        return  # the reader reports the reason
    if too_many:
        raise MediaError(
            f"the mesh {path} must have at most {MAX_CORNERS} corner values; got {corners}"
        )
    for kind, uri in parts:
        if isinstance(uri, str) and not uri.startswith("data:"):
            _check_referenced_file(
                path, {"images": "texture", "buffers": "buffer"}[kind], unquote(uri)
            )


def _check_referenced_file(path: Path, kind: str, name: str) -> None:
    try:
        check_file(path.parent / name, MAX_MESH_BYTES)
    except FileNotFoundError:
        raise MediaError(
            f"cannot find the {kind} {name!r} of the mesh {path}; copy it to {path.parent}"
        ) from None
    except OSError as e:
        raise MediaError(
            f"cannot read the {kind} {name!r} of the mesh {path}: {e.strerror}"
        ) from None


def _text(name: bytes) -> str:
    return name.decode("utf-8", "replace").strip().strip('"')


# -- Loading ---------------------------------------------------------------------------------------

TO_WORLD = {"y": np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]), "z": np.eye(3)}
"""Rotation from file axes to forward, left and up: y-up files face -z, z-up files x."""
DEFAULT_CONVENTIONS = {".glb": (1000.0, "y"), ".stl": (1.0, "z")}
"""Unit (mm) and upward axis defined by file formats."""
SUN_DIRECTION = np.array([0.35, 0.5, 0.8]) / np.linalg.norm([0.35, 0.5, 0.8])
SKY_FRACTION, SUN_FRACTION = 0.55, 0.45
LINEAR_OF_BYTE = linear_from_srgb(np.arange(256, dtype=np.float32) / 255)


def load_mesh(
    path: str | Path,
    unit_mm: float | None = None,
    up: str | None = None,
    background: Scene | None = None,
) -> Surroundings:
    """Read a mesh.

    Textures are rendered unchanged, as baked light; vertex colours and uniform colours are shaded
    by a sun and a uniform sky.

    Parameters
    ----------
    path
        A .glb, .gltf, .obj, .ply or .stl file with its referenced files.
    unit_mm
        Unit of the file, mm; by default 1 m, as defined by glTF, and 1 mm for STL.
    up : "y" or "z"
        Upward axis; by default y, as defined by glTF, facing -z, and z for STL.
    background
        Background of the mesh, such as an :class:`Environment`; black by default.

    Raises
    ------
    MediaError
        If the file cannot be read, contains no visible triangles, or references missing files; or
        trimesh is not installed.
    InvalidParameter
        If the axis is unknown or the unit is not a length.
    """
    path = Path(path)
    default_unit, default_up = DEFAULT_CONVENTIONS.get(
        path.suffix.lower(), DEFAULT_CONVENTIONS[".glb"]
    )
    unit_mm, up = default_unit if unit_mm is None else unit_mm, default_up if up is None else up
    if up not in TO_WORLD:
        raise InvalidParameter(f"up must be one of {', '.join(TO_WORLD)}; got {up!r}")
    if not 0 < unit_mm < np.inf:
        raise InvalidParameter(f"unit_mm must be finite and above 0 mm; got {unit_mm:g}")
    meshes, to_world = _meshes(path), unit_mm * TO_WORLD[up]
    for mesh in meshes:
        check_faces(path, np.asarray(mesh.faces), len(mesh.vertices))
    with np.errstate(all="ignore"):  # overflows are rejected below
        corners = [
            rotate_vectors(np.asarray(mesh.vertices)[mesh.faces], to_world.T) for mesh in meshes
        ]
        check_corners(path, corners)
    corners_are_linear = path.suffix.lower() in (
        ".glb",
        ".gltf",
    )  # defined by glTF; other formats imply sRGB
    parts = [
        _surfaces_of(m, c, to_world, corners_are_linear)
        for m, c in zip(meshes, corners, strict=True)
    ]
    return Surroundings(combine_surfaces(parts), background)


def _meshes(path: Path) -> list[Any]:
    """Return the meshes of a file, placed in its scene."""
    try:
        import trimesh
    except ImportError:
        raise MediaError(
            f"reading the mesh {path.name} requires trimesh: {extra_remedy('cad')}"
        ) from None
    if not path.exists():
        raise MediaError(f"cannot read the mesh {path}: the file does not exist")
    check_mesh_file(path)
    try:
        loaded = trimesh.load_scene(path, process=False)
        meshes = [
            mesh for mesh in loaded.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)
        ]
    except Exception as e:  # readers of many formats raise arbitrary exceptions
        reason = str(e).strip().splitlines()
        raise MediaError(
            f"cannot read the mesh {path}: {reason[0] if reason else type(e).__name__}"
        ) from None
    if not meshes:
        raise MediaError(f"the mesh {path} must contain triangles")
    return meshes


def _surfaces_of(
    mesh: Any, triangles: Array, to_world: Array, corners_are_linear: bool
) -> Surfaces:
    texture, uv = _texture(mesh.visual), getattr(mesh.visual, "uv", None)
    if texture is not None and uv is not None and len(uv) == len(mesh.vertices):
        return _textured(triangles, np.asarray(uv, dtype=float)[mesh.faces], texture)
    normals = np.asarray(mesh.vertex_normals, dtype=float)[mesh.faces] @ (
        to_world.T / np.linalg.norm(to_world[0])
    )
    shade = SKY_FRACTION * (0.5 + 0.5 * normals[..., 2]) + SUN_FRACTION * np.clip(
        normals @ SUN_DIRECTION, 0, 1
    )
    return facets(
        triangles, (shade[..., None] * _corner_colours(mesh, corners_are_linear)).astype(np.float32)
    )


def _textured(triangles: Array, uv: Array, texture: Light) -> Surfaces:
    """Return triangles (n, 3, 3) with an image at coordinates (n, 3, 2), from 0 to 1 from its lower
    left corner.
    """
    height, width = texture.shape[:2]
    at = np.stack([uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5], axis=-1)
    at[:, 1:] -= at[:, :1]
    return textured_triangles(triangles, at, Texture(texture, repeats=True))


def _texture(visual: Any) -> Light | None:
    """Return texels (h, w, 4) of the material of a mesh, or None: linear colours, and transparency."""
    material = getattr(visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None:
        return None
    rgba = np.asarray(image.convert("RGBA"))
    factor = _linear_factor(getattr(material, "baseColorFactor", None))
    texels = np.asarray(cv2.LUT(rgba, LINEAR_OF_BYTE), np.float32)
    texels[..., :3] *= factor
    texels[..., 3] = 0
    if getattr(material, "alphaMode", None) not in (None, "OPAQUE"):
        alpha = rgba[..., 3:] / np.float32(255)
        texels[..., :3] *= alpha
        texels[..., 3:] = 1 - alpha
    return texels


def _linear_factor(factor: Any) -> NDArray[np.float32]:
    """Return a linear material factor, which trimesh stores in bytes."""
    if factor is None:
        return np.ones(3, np.float32)
    numbers = np.asarray(factor)
    return (numbers[:3] / (255 if numbers.dtype.kind == "u" else 1)).astype(np.float32)


def _corner_colours(mesh: Any, are_linear: bool) -> Light:
    """Return linear RGB (n, 3, 3) of the vertices of the triangles."""
    visual, shape = mesh.visual, (len(mesh.faces), 3, 3)
    if visual.kind == "vertex":
        corners = np.asarray(visual.vertex_colors)[mesh.faces][..., :3] / np.float32(255)
        return corners if are_linear else linear_from_srgb(corners)
    if visual.kind == "face":
        return np.broadcast_to(
            linear_from_srgb(np.asarray(visual.face_colors)[:, None, :3] / 255), shape
        )
    material = getattr(visual, "material", None)
    factor, diffuse = (getattr(material, name, None) for name in ("baseColorFactor", "diffuse"))
    if factor is not None:
        return np.broadcast_to(_linear_factor(factor), shape)
    if diffuse is not None:
        return np.broadcast_to(linear_from_srgb(np.asarray(diffuse)[:3] / 255), shape)
    return np.full(shape, 0.6, np.float32)
