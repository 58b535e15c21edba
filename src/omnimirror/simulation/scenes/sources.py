"""Scenes by name: those that come with the project, and those in files."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from ...base.arguments import checked
from ...base.errors import MediaError, OmnimirrorError
from ...base.files import open_file
from .contract import Scene
from .environment import Environment
from .worlds.bundled import BUNDLED

ENVIRONMENTS = (".hdr", ".exr", ".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp")
MESHES = (".glb", ".gltf", ".obj", ".ply", ".stl")
BYTES_AT_ONCE = 1 << 20


@dataclass(frozen=True)
class SceneSource:
    """Where a scene comes from.

    Parameters
    ----------
    name
        Of a scene of the project, or an equirectangular picture's or a mesh's file.
    texel_mm
        Fineness of a scene of the project; its own by default.
    heading_deg
        Where the middle of an environment is seen; also of the one behind a mesh.
    unit_mm, up, background
        Of a mesh: its unit, the axis that points up, and the file of the environment behind it.

    Examples
    --------
    >>> SceneSource("room", texel_mm=40.0).load()
    Room(texel_mm=40.0, elsewhere_mm=None)
    """

    name: str
    texel_mm: float | None = None
    heading_deg: float = 0.0
    unit_mm: float | None = None
    up: str | None = None
    background: str | None = None

    @property
    def is_mesh(self) -> bool:
        """Whether it is a mesh's file."""
        return Path(self.name).suffix.lower() in MESHES

    @property
    def is_environment(self) -> bool:
        """Whether it is an equirectangular picture's file."""
        return Path(self.name).suffix.lower() in ENVIRONMENTS

    def load(self) -> Scene:
        """The scene.

        Raises
        ------
        OmnimirrorError
            There is no such scene, or its file cannot be read.
        """
        if self.is_mesh:
            from .mesh import load_mesh

            far = None if self.background is None else Environment.load(self.background, self.heading_deg)
            return load_mesh(self.name, self.unit_mm, self.up, far)
        if self.is_environment:
            return Environment.load(self.name, self.heading_deg)
        if self.name in BUNDLED:
            return BUNDLED[self.name]() if self.texel_mm is None else BUNDLED[self.name](self.texel_mm)
        raise OmnimirrorError(
            f"there is no scene {self.name!r}; valid are {', '.join(BUNDLED)}, and files "
            f"{', '.join((*ENVIRONMENTS, *MESHES))}"
        )


@checked
def load_scene(
    name: str | Path,
    *,
    texel_mm: float | None = None,
    heading_deg: float = 0.0,
    unit_mm: float | None = None,
    up: str | None = None,
    background: str | Path | None = None,
) -> Scene:
    """A scene by its name, or from the file of an environment or a mesh; as ``omnimirror simulate --scene`` takes it.

    Parameters
    ----------
    name
        ``"room"``, ``"street"``, ``"hall"``, ..; or an equirectangular picture (HDR, EXR, JPEG, ..); or a mesh (GLB,
        glTF, OBJ, PLY, STL).
    texel_mm
        Fineness of a scene of the project, mm; its own by default.
    heading_deg
        Where the middle of an environment is seen, deg right of forward; also of the one behind a mesh.
    unit_mm
        Unit of a mesh, mm; 1000 by default, of an STL 1.
    up
        Axis of a mesh that points up, ``"y"`` or ``"z"``; y by default, of an STL z.
    background
        File of the environment behind a mesh; nothing by default.

    Returns
    -------
    Scene
        For :func:`omnimirror.take_picture` and :func:`omnimirror.expose`.

    Raises
    ------
    OmnimirrorError
        There is no such scene, or its file cannot be read.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.load_scene("room", texel_mm=40.0)
    Room(texel_mm=40.0, elsewhere_mm=None)
    """
    behind = None if background is None else str(background)
    return SceneSource(str(name), texel_mm, heading_deg, unit_mm, up, behind).load()


def record_of(scene: Scene | SceneSource) -> dict[str, Any] | None:
    """A scene as JSON holds it, files with their place and SHA-256; None for one that was made in Python."""
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
    """The source of a record; its files where they were, or in a folder.

    Raises
    ------
    MediaError
        The scene was made in Python, or a file is not there any more or is another one.
    """
    if record is None:
        raise MediaError("the set's scene was made in Python, and no file says how; take it with the same program")
    source = SceneSource(**{name: value for name, value in record.items() if not name.endswith("_sha256")})
    for entry in ("name", "background"):
        expected = record.get(f"{entry}_sha256")
        if expected is None:
            continue
        there = Path(record[entry])
        found = [file for file in (there, folder / there.name) if file.is_file()]
        same = [file for file in found if sha256_of(file) == expected]
        if not same:
            what = "is not the file it was" if found else "is not there"
            raise MediaError(f"the set's scene {there} {what}; it is looked for there and in {folder}")
        found_at = str(same[0])
        source = replace(source, name=found_at) if entry == "name" else replace(source, background=found_at)
    return source


def sha256_of(path: Path) -> str:
    """The SHA-256 of a file, in hexadecimal.

    Raises
    ------
    MediaError
        The file cannot be read.
    """
    digest = hashlib.sha256()
    try:
        with open_file(path) as file:
            while piece := file.read(BYTES_AT_ONCE):
                digest.update(piece)
    except OSError as e:
        raise MediaError(f"cannot read {path}: {e.strerror or e}") from None
    return digest.hexdigest()
