"""Bags as files: rosbag2 folders, single MCAP and SQLite files, and ROS 1 bags; read by the library ``rosbags``."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...errors import MediaError, OmnimirrorError
from ...files import MARK, check_file, compose_yaml, read_text

STORAGES = {".mcap": "MCAP", ".db3": "SQLITE3"}
"""Of single files, by suffix."""
READABLE = (*STORAGES, ".bag")
METADATA = "metadata.yaml"
VERSION = 8  # of rosbag2's files: read by ROS 2 Iron and later, and by Humble's tools with a word of warning


def is_bag(source: str | Path) -> bool:
    """Whether a name is that of a recording of a robot.

    >>> is_bag("ride.mcap"), is_bag("ride.bag"), is_bag("ride.mp4")
    (True, True, False)
    """
    path = Path(source)
    return path.suffix.lower() in READABLE or (path / METADATA).is_file()


def rosbags() -> Any:
    """The library.

    Raises
    ------
    OmnimirrorError
        It is not installed.
    """
    try:
        import rosbags.highlevel
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ModuleNotFoundError as e:
        if e.name is None or e.name.partition(".")[0] != "rosbags":
            raise
        raise OmnimirrorError("recordings of robots need rosbags: pip install 'omnimirror[robots]'") from None
    return rosbags


@contextmanager
def reading(source: Path) -> Iterator[Any]:
    """An open reader of a bag; what goes wrong in the block with the bag is a sentence.

    Raises
    ------
    MediaError
        There is no such bag, or it is damaged or cut short.
    """
    library = rosbags()
    if not source.exists():
        raise MediaError(f"there is no recording {source}")
    if not is_bag(source):
        raise MediaError(f"{source} is no recording; valid are {', '.join(READABLE)} and rosbag2's folders")
    _check_files(source)
    stores = library.typesys
    known = stores.get_typestore(stores.Stores.ROS2_HUMBLE)  # bags of SQLite may hold no definitions
    with damage_told(source), library.highlevel.AnyReader([source], default_typestore=known) as reader:
        yield reader


def _check_files(source: Path) -> None:
    """Check that a bag consists of ordinary files, and the size and nesting of its ``metadata.yaml``."""
    parts = list(source.iterdir()) if source.is_dir() else [source]
    try:
        for part in parts:
            if part.suffix.lower() in READABLE:
                check_file(part)
    except OSError as e:
        raise MediaError(f"cannot read {part}: {e.strerror or e}") from None
    if source / METADATA in parts:
        compose_yaml(read_text(source / METADATA, "metadata of the recording", MediaError), str(source / METADATA))


@contextmanager
def damage_told(source: Path) -> Iterator[None]:
    """What the library, and what it is made of, say of a damaged bag, as a sentence."""
    try:
        yield
    except OmnimirrorError:
        raise
    except OSError as e:
        raise MediaError(f"cannot read {source}: {e.strerror or e}") from None
    except Exception as e:  # of rosbags, SQLite, zstd, lz4, struct and YAML, each its own
        reason = (str(e).strip().splitlines() or [type(e).__name__])[0].rstrip(".")
        advice = "; 'mcap recover' of the MCAP tools saves what is whole" if source.suffix.lower() == ".mcap" else ""
        raise MediaError(f"cannot read {source}: it is damaged or cut short ({reason}){advice}") from None


def is_sqlite(source: Path) -> bool:
    """Whether a bag is stored by SQLite."""
    return source.suffix.lower() == ".db3" or any(source.glob("*.db3*"))


def is_ros1(path: Path) -> bool:
    """Return whether a name is that of a ROS 1 bag."""
    return path.suffix.lower() == ".bag"


@contextmanager
def writing(output: Path, source: Path) -> Iterator[Any]:
    """Open a writer of a bag; the file takes its name when the block ends without an error.

    A folder has the storage of its source: SQLite or MCAP. A ``.bag`` is a bag of ROS 1.

    Raises
    ------
    OmnimirrorError
        The folder exists, or the file cannot be written.
    """
    library = rosbags()
    storage = STORAGES.get(output.suffix.lower())
    is_file = storage is not None or is_ros1(output)
    if not is_file and output.exists():
        raise MediaError(f"{output} exists; recordings in folders are not overwritten")
    target = Path(os.path.realpath(output))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{target.stem}{MARK}", dir=target.parent) as folder:
            made = Path(folder) / target.stem
            if is_ros1(output):
                with library.rosbag1.Writer(made) as writer:
                    yield writer
            else:
                plugin = library.rosbag2.StoragePlugin[storage or ("SQLITE3" if is_sqlite(source) else "MCAP")]
                with library.rosbag2.Writer(made, version=VERSION, storage_plugin=plugin) as writer:
                    yield writer
            os.replace(made / f"{made.name}{target.suffix.lower()}" if storage else made, target)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {output}: {e.strerror or e}") from None
