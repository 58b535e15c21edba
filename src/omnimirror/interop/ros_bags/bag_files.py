"""Reading and writing of bag files through the library ``rosbags``.

Supported are rosbag2 folders, single MCAP and SQLite files, and bags of ROS 1.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...base.errors import MediaError, OmnimirrorError, extra_remedy
from ...base.files import TEMPORARY_MARK, check_file, compose_yaml, read_text

STORAGES = {".mcap": "MCAP", ".db3": "SQLITE3"}
"""Storage plug-ins of single files by suffix."""
READABLE = (*STORAGES, ".bag")
METADATA = "metadata.yaml"
ROSBAG2_VERSION = 8
"""Format version; read by ROS 2 Iron and later, and with a warning by Humble."""


def is_bag(source: str | Path) -> bool:
    """Return whether a name is that of a ROS bag.

    >>> is_bag("ride.mcap"), is_bag("ride.bag"), is_bag("ride.mp4")
    (True, True, False)
    """
    path = Path(source)
    return path.suffix.lower() in READABLE or (path / METADATA).is_file()


def is_ros1(path: Path) -> bool:
    """Return whether a name is that of a ROS 1 bag."""
    return path.suffix.lower() == ".bag"


def rosbags() -> Any:
    """Import and return the library ``rosbags``.

    Raises
    ------
    OmnimirrorError
        If it is not installed.
    """
    try:
        import rosbags.highlevel
        import rosbags.rosbag1
        import rosbags.rosbag2
        import rosbags.typesys
    except ModuleNotFoundError as e:
        if e.name is None or e.name.partition(".")[0] != "rosbags":
            raise
        raise OmnimirrorError(f"ROS bags require rosbags: {extra_remedy('ros')}") from None
    return rosbags


@contextmanager
def open_bag(source: Path) -> Iterator[Any]:
    """Open a bag for reading; errors of the library in the block become a MediaError.

    Raises
    ------
    MediaError
        If the bag does not exist, is damaged or truncated.
    """
    library = rosbags()
    if not source.exists():
        raise MediaError(f"cannot read {source}: the file or folder does not exist")
    if not is_bag(source):
        raise MediaError(
            f"a ROS bag must be a file {', '.join(READABLE)} or a rosbag2 folder; got {source}"
        )
    _check_files(source)
    stores = library.typesys
    default = stores.get_typestore(stores.Stores.ROS2_HUMBLE)  # SQLite bags can lack definitions
    with read_errors(source), library.highlevel.AnyReader([source], default_typestore=default) as r:
        yield r


def _check_files(source: Path) -> None:
    """Check that a bag consists of regular files, and the size and nesting of ``metadata.yaml``."""
    parts = list(source.iterdir()) if source.is_dir() else [source]
    try:
        for part in parts:
            if part.suffix.lower() in READABLE:
                check_file(part)
    except OSError as e:
        raise MediaError(f"cannot read {part}: {e.strerror or e}") from None
    if source / METADATA in parts:
        text = read_text(source / METADATA, "metadata of the bag", MediaError)
        compose_yaml(text, str(source / METADATA))


@contextmanager
def read_errors(source: Path) -> Iterator[None]:
    """Convert errors of rosbags and its dependencies for a damaged bag to MediaError."""
    try:
        yield
    except OmnimirrorError:
        raise
    except OSError as e:
        raise MediaError(f"cannot read {source}: {e.strerror or e}") from None
    except Exception as e:  # rosbags, SQLite, zstd, lz4, struct and YAML raise their own types
        reason = (str(e).strip().splitlines() or [type(e).__name__])[0].rstrip(".")
        remedy = ""
        if source.suffix.lower() == ".mcap":
            remedy = "; 'mcap recover' of the MCAP tools restores the intact part"
        raise MediaError(
            f"cannot read {source}: it is damaged or truncated ({reason}){remedy}"
        ) from None


def is_sqlite(source: Path) -> bool:
    """Return whether a bag is stored in SQLite."""
    return source.suffix.lower() == ".db3" or any(source.glob("*.db3*"))


@contextmanager
def create_bag(output: Path, source: Path) -> Iterator[Any]:
    """Open a bag for writing; it gets its name when the block ends without an error.

    A folder uses the storage plug-in of the source, SQLite or MCAP. A file ``.bag`` is a bag of
    ROS 1.

    Raises
    ------
    OmnimirrorError
        If the folder exists or the file cannot be written.
    """
    library = rosbags()
    storage = STORAGES.get(output.suffix.lower())
    is_file = storage is not None or is_ros1(output)
    if not is_file and output.exists():
        raise MediaError(f"the output folder must not exist; got {output}")
    target = Path(os.path.realpath(output))
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        prefix = f".{target.stem}{TEMPORARY_MARK}"
        with tempfile.TemporaryDirectory(prefix=prefix, dir=target.parent) as folder:
            temporary = Path(folder) / target.stem
            if is_ros1(output):
                with library.rosbag1.Writer(temporary) as writer:
                    yield writer
            else:
                name = storage or ("SQLITE3" if is_sqlite(source) else "MCAP")
                plugin = library.rosbag2.StoragePlugin[name]
                with library.rosbag2.Writer(
                    temporary, version=ROSBAG2_VERSION, storage_plugin=plugin
                ) as writer:
                    yield writer
            file = temporary / f"{temporary.name}{target.suffix.lower()}"
            os.replace(file if storage else temporary, target)
    except OSError as e:
        raise OmnimirrorError(f"cannot write {output}: {e.strerror or e}") from None
