"""Dataset manifest dataset.json: completed files (to resume) and recipe (to reproduce)."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields
from importlib.metadata import version
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..base.arguments import check_fields
from ..base.errors import InvalidParameter, MediaError
from ..base.files import MAX_TEXT_BYTES, parse_json, read_bytes, write_text
from ..io.keyframes import Keyframes
from ..optics.camera_files import AnyCamera, format_camera, parse_camera
from ..optics.sensor import Sensor
from .detector import Detector
from .radiometry import Radiometry
from .scenes.calibration_hall import Hall
from .scenes.moving_objects import MovingBox
from .scenes.scene import Scene
from .scenes.scene_sources import SceneSource, record_of, sha256_of, source_of
from .simulated_video import ImageSequence

# -- Manifest of completed files -------------------------------------------------------------------

MANIFEST_NAME = "dataset.json"
FRAMES = "frames"
TEMPORARY_FILE = re.compile(
    r"\.(view-\d+|frame-\d+|dataset|sensor|poses|video)-\w{8}\.(png|exr|json|toml|csv|mp4)"
)
REWRITE_FRACTION = (
    50  # dataset.json is rewritten when 1/50 of it is new: once per file for small datasets
)


class Manifest:
    """Manifest of the completed files of a dataset with their SHA-256 and metadata.

    Parameters
    ----------
    folder
        Folder of the dataset. Existing files that match its dataset.json are kept; others are
        rewritten.
    header
        Constant entries of dataset.json, including the ``recipe`` of the dataset.

    Raises
    ------
    InvalidParameter
        If the folder contains another dataset.
    """

    def __init__(self, folder: Path, header: dict[str, Any]) -> None:
        self.folder, self.header = folder, header
        self.entries: dict[str, Any] = {}
        self.files: dict[str, str] = {}
        previous = _stored_manifest(folder)
        self.is_new = previous is None
        self.is_complete = False
        if previous is not None:
            _check_same_recipe(folder, previous, header["recipe"])
            _remove_temporary_files(folder)
            listed = previous.get("files", {})
            self.files = {
                name: sha for name, sha in listed.items() if _is_unchanged(folder / name, sha)
            }
            changing = previous.keys() - header.keys() - {"files", "complete"}
            self.entries = {name: previous[name] for name in previous if name in changing}
            self.is_complete = bool(previous.get("complete")) and len(self.files) == len(listed)
        self._listed_files = len(self.files)
        if self.is_new:
            self.write()

    def has(self, *names: str) -> bool:
        """Return True if the files exist unchanged."""
        return all(name in self.files for name in names)

    def add(self, *names: str) -> None:
        """Add files that were just written."""
        self.files |= {name: sha256_of(self.folder / name) for name in names}
        if len(self.files) - self._listed_files > len(self.files) // REWRITE_FRACTION:
            self.write()

    def drop(self, names: Sequence[str]) -> None:
        """Remove files and their entries."""
        for name in names:
            self.files.pop(name, None)
        self.write()
        for name in names:
            (self.folder / name).unlink(missing_ok=True)

    def write(self) -> None:
        """Write dataset.json in its current state, atomically."""
        content = (
            self.header
            | {"complete": self.is_complete}
            | self.entries
            | {"files": dict(sorted(self.files.items()))}
        )
        write_text(self.folder / MANIFEST_NAME, json.dumps(content) + "\n")
        self._listed_files = len(self.files)

    def finish(self, complete: bool) -> None:
        """Write the final dataset.json."""
        self.is_complete = complete
        self.write()

    def end(self, initial_files: Sequence[str]) -> None:
        """Write the current state; a dataset without completed files is removed, including its
        ``beginning`` files.
        """
        if not self.is_new or self.files.keys() - {*initial_files}:
            self.write()
            return
        for name in (MANIFEST_NAME, *initial_files):
            (self.folder / name).unlink(missing_ok=True)
        if not any(self.folder.iterdir()):
            self.folder.rmdir()


def _remove_temporary_files(folder: Path) -> None:
    """Remove incomplete files of a terminated process."""
    for directory in (folder, folder / FRAMES):
        for path in directory.glob(".*") if directory.is_dir() else ():
            if TEMPORARY_FILE.fullmatch(path.name):
                path.unlink(missing_ok=True)


def _stored_manifest(folder: Path) -> dict[str, Any] | None:
    try:
        content = parse_json(read_bytes(folder / MANIFEST_NAME, 16 * MAX_TEXT_BYTES))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as e:
        raise MediaError(
            f"cannot read {folder / MANIFEST_NAME}, which is not overwritten: {e}"
        ) from None
    return content if isinstance(content, dict) else {}


def _check_same_recipe(folder: Path, previous: dict[str, Any], recipe: dict[str, Any]) -> None:
    old = previous.get("recipe", {})
    different = [
        name
        for name in (*recipe, *(old.keys() - recipe.keys()))
        if old.get(name) != recipe.get(name)
    ]
    if different:
        raise InvalidParameter(
            f"folder must be new or contain the same dataset; {folder} differs in "
            f"{', '.join(different)}; choose another folder or remove it"
        )


def _is_unchanged(path: Path, sha256: str) -> bool:
    return path.is_file() and sha256_of(path) == sha256


# -- Recipes ---------------------------------------------------------------------------------------

FORMAT = 3


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """Recipe of a dataset of any type."""

    KIND: ClassVar[str]

    sensor: AnyCamera
    """Sensor, or a calibrated camera."""
    samples: int = 16
    """Rays per pixel."""
    blur: bool | None = None
    """True to render defocus blur with the whole aperture of the lens; by default for sensors, because the
    aperture of a calibrated camera is unknown."""
    radiometry: Radiometry | None = None
    """Reflectivity of the mirror, vignetting of the lens, and appearance of the housing."""
    detector: Detector = field(default_factory=Detector)
    """Image sensor electronics; without noise by default."""
    seed: int = 0
    """Random seed, also of the poses of calibration images."""
    truth: bool = False
    """Also write EXR files with light, depth, direction and origin of every pixel."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.blur is None:
            object.__setattr__(self, "blur", isinstance(self.sensor, Sensor))


@dataclass(frozen=True, kw_only=True)
class CalibrationRecipe(Recipe):
    """Recipe of a dataset with images of the boards in the hall.

    Examples
    --------
    >>> import omnimirror as om
    >>> om.CalibrationRecipe(sensor=om.load_sensor("paper-spherical"), views=3).blur
    True
    """

    KIND: ClassVar[str] = "calibration"

    views: int = 12
    """Number of images."""
    hall: Hall = field(default_factory=Hall)
    """Hall with the boards."""


@dataclass(frozen=True, kw_only=True)
class VideoRecipe(Recipe):
    """Recipe of a video along a path through a scene.

    Examples
    --------
    >>> import omnimirror as om
    >>> from omnimirror.io.keyframes import Keyframes
    >>> path = Keyframes({"x_mm": ((0.0, 0.0), (1.0, 500.0))})
    >>> om.VideoRecipe(
    ...     sensor=om.load_sensor("paper-spherical"), scene=om.Room(texel_mm=40.0), path=path
    ... ).frame_rate
    25.0
    """

    KIND: ClassVar[str] = "video"

    scene: Scene | SceneSource
    """Scene; for a :class:`SceneSource` or a bundled scene, ``dataset.json`` records its source."""
    path: Keyframes
    """Path returned by :func:`omnimirror.load_path`."""
    bodies: Sequence[MovingBox] = ()
    """Moving bodies, such as :class:`omnimirror.MovingBox` or those returned by
    :func:`omnimirror.load_bodies`."""
    frame_rate: float = 25.0
    """Frames per second."""
    duration_s: float | None = None
    """Duration, s; up to the last pose by default."""

    def sequence(self) -> ImageSequence:
        """Return the image sequence, after loading the scene.

        Returns
        -------
        ImageSequence
            Camera, scene, path and rendering parameters.
        """
        return ImageSequence(
            camera=self.sensor,
            scene=self.scene.load() if isinstance(self.scene, SceneSource) else self.scene,
            path=self.path,
            bodies=self.bodies,
            frame_rate=self.frame_rate,
            duration_s=self.duration_s,
            samples=self.samples,
            blur=bool(self.blur),
            radiometry=self.radiometry,
            detector=self.detector,
            seed=self.seed,
        )


KINDS: dict[str, type[CalibrationRecipe] | type[VideoRecipe]] = {
    kind.KIND: kind for kind in (CalibrationRecipe, VideoRecipe)
}


def format_of(kind: str) -> str:
    """Return the format identifier of a dataset.json."""
    return f"omnimirror {kind} dataset {FORMAT}"


def recipe_record(recipe: Recipe) -> dict[str, Any]:
    """Convert a recipe to JSON data."""
    encoders: dict[str, Any] = {
        "sensor": format_camera,
        "hall": asdict,
        "radiometry": lambda r: (
            r and asdict(r) | {"reflectivity": _reflectivity_text(r.reflectivity)}
        ),
        "detector": _detector_record,
        "scene": record_of,
        "path": _path_record,
        "bodies": lambda bodies: [vars(box) | {"path": _path_record(box.path)} for box in bodies],
    }
    unchanged: Any = lambda value: value  # noqa: E731
    stored = {
        f.name: encoders.get(f.name, unchanged)(getattr(recipe, f.name)) for f in fields(recipe)
    }
    content = {"omnimirror": version("omnimirror"), "kind": recipe.KIND} | stored
    record: dict[str, Any] = json.loads(json.dumps(content, default=lambda number: number.item()))
    return record


def _recipe_of(record: dict[str, Any], folder: Path) -> CalibrationRecipe | VideoRecipe:
    """Convert JSON data to a recipe; scene files may be in a folder."""
    values = {name: value for name, value in record.items() if name not in ("omnimirror", "kind")}
    decoders: dict[str, Any] = {
        "sensor": parse_camera,
        "hall": lambda r: Hall(**r),
        "radiometry": lambda r: (
            r and Radiometry(**r | {"reflectivity": _reflectivity_of(r["reflectivity"])})
        ),
        "detector": lambda r: Detector(**r | {"full_well_e": r["full_well_e"] or np.inf}),
        "scene": lambda r: source_of(r, folder),
        "path": _path_of,
        "bodies": lambda r: tuple(map(_body_of, r)),
    }
    unchanged: Any = lambda value: value  # noqa: E731
    return KINDS[record["kind"]](
        **{name: decoders.get(name, unchanged)(value) for name, value in values.items()}
    )


class StoredRecipe(NamedTuple):
    """Recipe of a dataset, and the omnimirror version that created it."""

    recipe: CalibrationRecipe | VideoRecipe
    created_with: str | None


def load_recipe(path: str | Path) -> StoredRecipe:
    """Read the recipe of a dataset.json.

    Raises
    ------
    MediaError
        If the file does not exist, has another format, contains no recipe or an invalid entry.
    OmnimirrorError
        If the scene cannot be read.
    """
    record = _record_in(path)
    try:
        return StoredRecipe(_recipe_of(record, Path(path).parent), record.get("omnimirror"))
    except (TypeError, KeyError, AttributeError):
        raise MediaError(f"the recipe in {path} must contain valid entries") from None


def _record_in(path: str | Path) -> dict[str, Any]:
    """Read the recipe in a dataset.json of this format as JSON data."""
    try:
        data = parse_json(read_bytes(path, 16 * MAX_TEXT_BYTES))
        record = data["recipe"]
        kind, stored = record["kind"], data.get("format")
    except OSError as e:
        raise MediaError(f"cannot read {path}: {e.strerror}") from None
    except (ValueError, KeyError, TypeError, AttributeError):
        raise MediaError(f"{path} must be the dataset.json of a dataset with its recipe") from None
    if kind not in KINDS:
        raise MediaError(
            f"{path}: the kind of dataset must be one of {', '.join(KINDS)}; got {kind!r}"
        )
    if stored != format_of(kind):
        raise MediaError(
            f"{path} must have the format {format_of(kind)!r}; got {stored!r}; write the dataset again"
        )
    return record  # type: ignore[no-any-return]  # the type depends on the argument


def _path_record(path: Keyframes) -> dict[str, Any]:
    return {
        "tracks": {n: [list(k) for k in t] for n, t in path.tracks.items()},
        "interpolation": path.interpolation,
    }


def _path_of(record: dict[str, Any]) -> Keyframes:
    return Keyframes(
        {n: tuple((t, v) for t, v in k) for n, k in record["tracks"].items()},
        record["interpolation"],
    )


def _body_of(record: dict[str, Any]) -> MovingBox:
    return MovingBox(
        **record | {"size_mm": tuple(record["size_mm"]), "path": _path_of(record["path"])}
    )


def _detector_record(detector: Detector) -> dict[str, Any]:
    record = asdict(detector) | {
        "black_level_dn": detector.offset_dn if detector.curve == "linear" else None
    }
    return record | {
        "full_well_e": detector.full_well_e if np.isfinite(detector.full_well_e) else None
    }


def _reflectivity_text(value: Any) -> Any:
    if isinstance(value, tuple):
        return [_reflectivity_text(each) for each in value]
    return str(value) if isinstance(value, complex) else value


def _reflectivity_of(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(_reflectivity_of(each) for each in value)
    try:
        return complex(value) if isinstance(value, str) else value
    except ValueError:
        return value
