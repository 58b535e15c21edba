"""Scenes from files: triangle meshes in glTF, GLB, OBJ, PLY and STL, read with trimesh."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...base.colour import Light, linear_from_srgb
from ...base.errors import InvalidParameter, MediaError
from ...base.typing import Array
from ...cameras.frames import turned
from .contract import Scene
from .mesh_checks import check_corners, check_faces, check_mesh_file
from .surfaces import Surfaces, Texture
from .triangles import combined, facets, halves
from .worlds.painted import Surroundings

TO_WORLD = {
    "y": np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotation from file axes to forward, left and up: y-up files face -z, z-up files x."""
USUAL = {".glb": (1000.0, "y"), ".stl": (1.0, "z")}
"""Unit (mm) and upward axis defined by file formats."""
SUN = np.array([0.35, 0.5, 0.8]) / np.linalg.norm([0.35, 0.5, 0.8])
FROM_SKY, FROM_SUN = 0.55, 0.45


def load_mesh(
    path: str | Path, unit_mm: float | None = None, up: str | None = None, background: Scene | None = None
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
    usual_unit, usual_up = USUAL.get(path.suffix.lower(), USUAL[".glb"])
    unit_mm, up = usual_unit if unit_mm is None else unit_mm, usual_up if up is None else up
    if up not in TO_WORLD:
        raise InvalidParameter(f"up = {up!r} is not one of {', '.join(TO_WORLD)}")
    if not 0 < unit_mm < np.inf:
        raise InvalidParameter(f"unit_mm = {unit_mm:g} is no length; it is valid above 0")
    meshes, to_world = _meshes(path), unit_mm * TO_WORLD[up]
    for mesh in meshes:
        check_faces(path, np.asarray(mesh.faces), len(mesh.vertices))
    with np.errstate(all="ignore"):  # overflows are rejected below
        corners = [turned(np.asarray(mesh.vertices)[mesh.faces], to_world.T) for mesh in meshes]
        check_corners(path, corners)
    corners_are_linear = path.suffix.lower() in (".glb", ".gltf")  # defined by glTF; other formats imply sRGB
    parts = [_surfaces_of(m, c, to_world, corners_are_linear) for m, c in zip(meshes, corners, strict=True)]
    return Surroundings(combined(parts), background)


def _meshes(path: Path) -> list[Any]:
    """Return the meshes of a file, placed in its scene."""
    try:
        import trimesh
    except ImportError:
        raise MediaError(
            f"{path.name} is a mesh, which needs one more package: pip install 'omnimirror[cad]'"
        ) from None
    if not path.exists():
        raise MediaError(f"there is no mesh {path}")
    check_mesh_file(path)
    try:
        loaded = trimesh.load_scene(path, process=False)
        meshes = [mesh for mesh in loaded.dump() if isinstance(mesh, trimesh.Trimesh) and len(mesh.faces)]
    except Exception as e:  # readers of many formats raise arbitrary exceptions
        reason = str(e).strip().splitlines()
        raise MediaError(f"the mesh {path} cannot be read: {reason[0] if reason else type(e).__name__}") from None
    if not meshes:
        raise MediaError(f"the mesh {path} holds no triangles")
    return meshes


def _surfaces_of(mesh: Any, triangles: Array, to_world: Array, corners_are_linear: bool) -> Surfaces:
    picture, uv = _texture(mesh.visual), getattr(mesh.visual, "uv", None)
    if picture is not None and uv is not None and len(uv) == len(mesh.vertices):
        return _textured(triangles, np.asarray(uv, dtype=float)[mesh.faces], picture)
    normals = np.asarray(mesh.vertex_normals, dtype=float)[mesh.faces] @ (to_world.T / np.linalg.norm(to_world[0]))
    shade = FROM_SKY * (0.5 + 0.5 * normals[..., 2]) + FROM_SUN * np.clip(normals @ SUN, 0, 1)
    return facets(triangles, (shade[..., None] * _corner_colours(mesh, corners_are_linear)).astype(np.float32))


def _textured(triangles: Array, uv: Array, picture: Light) -> Surfaces:
    """Return triangles (n, 3, 3) with an image at coordinates (n, 3, 2), from 0 to 1 from its lower
    left corner.
    """
    height, width = picture.shape[:2]
    at = np.stack([uv[..., 0] * width - 0.5, (1 - uv[..., 1]) * height - 0.5], axis=-1)
    at[:, 1:] -= at[:, :1]
    return halves(triangles, at, Texture(picture, repeats=True))


def _texture(visual: Any) -> Light | None:
    """Return texels (h, w, 4) of the material of a mesh, or None: linear colours, and transparency."""
    material = getattr(visual, "material", None)
    image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
    if image is None:
        return None
    rgba = np.asarray(image.convert("RGBA"), dtype=np.float32) / 255
    colour = linear_from_srgb(rgba[..., :3]) * _linear_factor(getattr(material, "baseColorFactor", None))
    is_opaque = getattr(material, "alphaMode", None) in (None, "OPAQUE")
    alpha = np.ones_like(rgba[..., 3:]) if is_opaque else rgba[..., 3:]
    return np.ascontiguousarray(np.concatenate([colour * alpha, 1 - alpha], axis=-1), np.float32)


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
        return np.broadcast_to(linear_from_srgb(np.asarray(visual.face_colors)[:, None, :3] / 255), shape)
    material = getattr(visual, "material", None)
    factor, diffuse = (getattr(material, name, None) for name in ("baseColorFactor", "diffuse"))
    if factor is not None:
        return np.broadcast_to(_linear_factor(factor), shape)
    if diffuse is not None:
        return np.broadcast_to(linear_from_srgb(np.asarray(diffuse)[:3] / 255), shape)
    return np.full(shape, 0.6, np.float32)
