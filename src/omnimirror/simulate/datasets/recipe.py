"""How a set was made, as its dataset.json keeps it, so that it can be made again."""

from __future__ import annotations

import json
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import InvalidParameter, MediaError
from ...files import LARGEST_TEXT, read_bytes
from ...media.keyframes import Keyframes
from ...specs import format_sensor, parse_sensor
from ..detector import Detector
from ..radiometry import Radiometry
from ..scenes.sources import record_of, source_of
from ..scenes.worlds.hall import Hall

KINDS = ("calibration", "video")


def recipe_of(kind: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """The arguments of a set's writer as JSON holds them."""
    encoders: dict[str, Any] = {
        "sensor": format_sensor,
        "hall": asdict,
        "radiometry": lambda r: r and asdict(r) | {"reflectivity": _reflectivity_text(r.reflectivity)},
        "detector": _detector_record,
        "scene": record_of,
        "path": lambda p: {
            "tracks": {n: [list(k) for k in t] for n, t in p.tracks.items()},
            "between": p.interpolation,
        },
    }
    same: Any = lambda value: value  # noqa: E731
    recipe = {name: encoders.get(name, same)(value) for name, value in arguments.items()}
    whole = {"omnimirror": version("omnimirror"), "kind": kind} | recipe
    as_read: dict[str, Any] = json.loads(json.dumps(whole, default=lambda number: number.item()))
    return as_read


def arguments_of(recipe: dict[str, Any], folder: Path) -> tuple[str, dict[str, Any]]:
    """The kind of set of a recipe, and the arguments of its writer; files of scenes may lie in a folder."""
    given = {name: value for name, value in recipe.items() if name not in ("omnimirror", "kind")}
    decoders: dict[str, Any] = {
        "sensor": parse_sensor,
        "hall": lambda r: Hall(**r),
        "radiometry": lambda r: r and Radiometry(**r | {"reflectivity": _reflectivity_of(r["reflectivity"])}),
        "detector": lambda r: Detector(**r | {"full_well_e": r["full_well_e"] or np.inf}),
        "scene": lambda r: source_of(r, folder),
        "path": lambda r: Keyframes({n: tuple((t, v) for t, v in k) for n, k in r["tracks"].items()}, r["between"]),
    }
    same: Any = lambda value: value  # noqa: E731
    return recipe["kind"], {name: decoders.get(name, same)(value) for name, value in given.items()}


def load_recipe(path: str | Path) -> dict[str, Any]:
    """The recipe of a dataset.json.

    Raises
    ------
    MediaError
        There is no such file.
    InvalidParameter
        It holds no recipe.
    """
    try:
        data = json.loads(read_bytes(path, 16 * LARGEST_TEXT))
        recipe = data["recipe"]
        kind = recipe["kind"]
    except OSError as e:
        raise MediaError(f"cannot read {path}: {e.strerror}") from None
    except (ValueError, KeyError, TypeError, RecursionError):
        raise InvalidParameter(
            f"{path} does not say how a set is made; dataset.json of this release's sets does"
        ) from None
    if kind not in KINDS:
        raise InvalidParameter(f"{path} is of a set of kind {kind!r}; valid are {', '.join(KINDS)}")
    return recipe  # type: ignore[no-any-return]


def load_arguments(path: str | Path) -> tuple[str, dict[str, Any]]:
    """Kind and arguments of the set that a dataset.json describes.

    Raises
    ------
    OmnimirrorError
        The file or the scene cannot be read, or an entry is not valid.
    """
    recipe = load_recipe(path)
    try:
        return arguments_of(recipe, Path(path).parent)
    except (TypeError, KeyError, AttributeError):
        raise InvalidParameter(f"{path} holds an entry of its recipe that is not valid") from None


def _detector_record(detector: Detector) -> dict[str, Any]:
    record = asdict(detector) | {"black_level_dn": detector.offset_dn if detector.curve == "linear" else None}
    return record | {"full_well_e": detector.full_well_e if np.isfinite(detector.full_well_e) else None}


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
