"""Scenes by name: bundled scenes, and scene files."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...base.arguments import validate_arguments
from ...base.errors import MediaError, OmnimirrorError
from ...base.files import open_file
from .calibration_hall import Hall
from .environment import Environment
from .room import Room
from .scene import Scene
from .street import Street

# -- Bundled scenes --------------------------------------------------------------------------------

BUNDLED: dict[str, Callable[..., Scene]] = {"room": Room, "street": Street, "hall": Hall}


# -- Scene files -----------------------------------------------------------------------------------

ENVIRONMENTS = (".hdr", ".exr", ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp")
MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl")
CHUNK_BYTES = 1 << 20


@dataclass(frozen=True)
class SceneSource:
    """Source of a scene.

    Parameters
    ----------
    name
        Name of a bundled scene, or file of an equirectangular image or a mesh.
    texel_mm
        Texel size of a bundled scene; its own by default.
    heading_deg
        Pan of the centre of an environment, also of the background of a mesh.
    unit_mm, up, background
        Properties of a mesh: its unit, the upward axis, and the file of its background environment.

    Examples
    --------
    >>> SceneSource("room", texel_mm=40.0).load()
    Room(texel_mm=40.0, other_texel_mm=None)
    """

    name: str
    texel_mm: float | None = None
    heading_deg: float = 0.0
    unit_mm: float | None = None
    up: str | None = None
    background: str | None = None

    @property
    def is_mesh(self) -> bool:
        """True for the file of a mesh."""
        return Path(self.name).suffix.lower() in MESHES

    @property
    def is_environment(self) -> bool:
        """True for the file of an equirectangular image."""
        return Path(self.name).suffix.lower() in ENVIRONMENTS

    def load(self) -> Scene:
        """Load the scene.

        Raises
        ------
        OmnimirrorError
            If the scene does not exist, or its file cannot be read.
        """
        if self.is_mesh:
            from ._mesh_files import load_mesh

            distant_scene = (
                None
                if self.background is None
                else Environment.load(self.background, self.heading_deg)
            )
            return load_mesh(self.name, self.unit_mm, self.up, distant_scene)
        if self.is_environment:
            return Environment.load(self.name, self.heading_deg)
        if self.name in BUNDLED:
            return (
                BUNDLED[self.name]() if self.texel_mm is None else BUNDLED[self.name](self.texel_mm)
            )
        raise OmnimirrorError(
            f"the scene must be one of {', '.join(BUNDLED)} or a file "
            f"{', '.join((*ENVIRONMENTS, *MESHES))}; got {self.name!r}"
        )


@validate_arguments
def load_scene(
    name: str | Path,
    *,
    texel_mm: float | None = None,
    heading_deg: float = 0.0,
    unit_mm: float | None = None,
    up: str | None = None,
    background: str | Path | None = None,
) -> Scene:
    """Load a scene by name, or from an environment or mesh file, as ``omnimirror simulate --scene``
    does.

    Parameters
    ----------
    name
        ``"room"``, ``"street"``, ``"hall"``, ...; or an equirectangular image
        (HDR, EXR, JPEG, ...); or a mesh (GLB, glTF, OBJ, PLY, STL).
    texel_mm
        Texel size of a bundled scene, mm; its own by default.
    heading_deg
        Pan of the centre of an environment, deg right of forward; also of the background of a mesh.
    unit_mm
        Unit of a mesh, mm; 1000 by default, 1 for STL.
    up
        Upward axis of a mesh, ``"y"`` or ``"z"``; y by default, z for STL.
    background
        File of the background environment of a mesh; none by default.

    Returns
    -------
    Scene
        Scene for :func:`omnimirror.render_image` and :func:`omnimirror.expose`.

    Raises
    ------
    OmnimirrorError
        If the scene does not exist, or its file cannot be read.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.load_scene("room", texel_mm=40.0)
    Room(texel_mm=40.0, other_texel_mm=None)
    """
    background_name = None if background is None else str(background)
    return SceneSource(str(name), texel_mm, heading_deg, unit_mm, up, background_name).load()


def record_of(scene: Scene | SceneSource) -> dict[str, Any] | None:
    """Convert a scene to JSON data, files with their path and SHA-256; None for scenes created in
    Python.
    """
    if not isinstance(scene, SceneSource):
        names = [name for name, kind in BUNDLED.items() if type(scene) is kind]
        return record_of(SceneSource(names[0], vars(scene)["texel_mm"])) if names else None
    record = asdict(scene)
    for entry in ("name", "background"):
        file = record[entry]
        if file is not None and file not in BUNDLED:
            record |= {entry: str(Path(file).resolve()), f"{entry}_sha256": sha256_of(Path(file))}
    return record


def source_of(record: dict[str, Any] | None, folder: Path) -> SceneSource:
    """Return the source of JSON data; files at their original path, or in a folder.

    Raises
    ------
    MediaError
        If the scene was created in Python, or a file is missing or has changed.
    """
    if record is None:
        raise MediaError(
            "the scene of the dataset was created in Python and is not stored; use the original program"
        )
    source = SceneSource(
        **{name: value for name, value in record.items() if not name.endswith("_sha256")}
    )
    for entry in ("name", "background"):
        expected = record.get(f"{entry}_sha256")
        if expected is None:
            continue
        original = Path(record[entry])
        candidates = [file for file in (original, folder / original.name) if file.is_file()]
        matches = [file for file in candidates if sha256_of(file) == expected]
        if not matches:
            problem = "has changed" if candidates else "is missing"
            raise MediaError(
                f"the scene {original} of the dataset {problem}; it must be there or in {folder}"
            )
        location = str(matches[0])
        source = (
            replace(source, name=location)
            if entry == "name"
            else replace(source, background=location)
        )
    return source


def sha256_of(path: Path) -> str:
    """Return the SHA-256 of a file in hexadecimal.

    Raises
    ------
    MediaError
        If the file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with open_file(path) as file:
            while chunk := file.read(CHUNK_BYTES):
                digest.update(chunk)
    except OSError as e:
        raise MediaError(f"cannot read {path}: {e.strerror or e}") from None
    return digest.hexdigest()
