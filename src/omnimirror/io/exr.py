"""OpenEXR images, with the package OpenEXR: OpenCV 5 does not support the format."""

from __future__ import annotations

import errno
import os
import struct
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..base.errors import MediaError, extra_remedy

Image = NDArray[Any]

MAGIC = b"\x76\x2f\x31\x01"
CHANNELS = {1: "Y", 3: "RGB", 4: "RGBA"}
ROWS_PER_CHUNK = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}
"""Rows per chunk, by compression number."""
TILED_OR_MANY_PARTS = 0x200 | 0x1000


def read_exr(path: Path, data: bytes) -> Image:
    """Read the first part of an OpenEXR file with the bytes ``data``; ``path`` names it in messages.

    Returns
    -------
    (h, w) or (h, w, 3) or (h, w, 4) float32 array
        Channels Y, or red, green, blue (alpha); half precision is converted to float32. Other
        channels are ignored.

    Raises
    ------
    MediaError
        If OpenEXR is not installed, the file is damaged, or it has no such channels.
    """
    library = _library(path)
    if _is_truncated(data):  # the library would fill missing rows with grey and print messages
        raise MediaError(f"cannot read the image {path}: it is damaged or truncated")
    with tempfile.TemporaryDirectory(prefix="omnimirror-") as folder:
        copy = Path(folder) / "image.exr"  # the library reads files only, and data can be an upload
        copy.write_bytes(data)
        try:
            with library.File(str(copy), separate_channels=True) as file:
                # copied, since the memory belongs to the open file
                channels = {name: np.array(part.pixels) for name, part in file.channels().items()}
        except Exception as e:  # RuntimeError, TypeError or a class of the library, by version
            reason = str(e).strip().splitlines()[0].replace(str(copy), "the file")
            raise MediaError(f"cannot read the image {path}: {reason}") from None
    names = next((n for n in ("RGBA", "RGB", "Y") if set(n) <= set(channels)), None)
    if names is None:
        raise MediaError(
            f"the image {path} must have the channels R, G, B (A) or Y; got {', '.join(channels)}"
        )
    selected = [channels[name] for name in names]
    if any(channel.dtype.kind != "f" for channel in selected):
        raise MediaError(
            f"the image {path} must have half or float channels; got {selected[0].dtype}"
        )
    image: Image = np.stack(selected, axis=-1).astype(np.float32)
    return image[..., 0] if image.shape[-1] == 1 else image


def write_exr(path: Path, image: Image) -> None:
    """Write a float32 image, (h, w) or (h, w, c) in the order red, green, blue (alpha), losslessly.

    Raises
    ------
    MediaError
        If OpenEXR is not installed.
    OSError
        If the file cannot be written.
    """
    image = image.reshape(*image.shape[:2], -1)
    names = CHANNELS[image.shape[2]]
    write_channels(
        path, {name: np.ascontiguousarray(image[..., i]) for i, name in enumerate(names)}
    )


def write_channels(
    path: Path,
    channels: Mapping[str, NDArray[np.float32]],
    attributes: Mapping[str, str | int] | None = None,
) -> None:
    """Write channels (h, w) of any names, losslessly, with additional header attributes.

    Raises
    ------
    MediaError
        If OpenEXR is not installed.
    OSError
        If the file cannot be written.
    """
    library = _library(path)
    header = {
        "compression": library.ZIP_COMPRESSION,
        "type": library.scanlineimage,
        **(attributes or {}),
    }
    plain = path.with_name(path.name.encode("ascii", "replace").decode())  # UTF-8 names only
    target = path if _is_utf8(path) else plain
    try:
        with library.File(header, dict(channels)) as file:
            file.write(str(target))
        os.replace(target, path)
    except RuntimeError as e:
        reason = (
            str(e).strip().splitlines()[0].replace(str(path), "the file")
        )  # hides the temporary name
        raise OSError(errno.EIO, reason) from None


def _is_utf8(path: Path) -> bool:
    try:
        path.name.encode()
    except UnicodeEncodeError:
        return False
    return True


def check_exr_can_be_written(path: Path) -> None:
    """Raise MediaError unless OpenEXR is installed; called before time-consuming work."""
    _library(path)


def _is_truncated(data: bytes) -> bool:
    """Return whether chunks of pixels are missing; tiled and multi-part files are not checked."""
    try:
        if struct.unpack_from("<I", data, 4)[0] & TILED_OR_MANY_PARTS:
            return False
        attributes, at = _header(data)
        _, top, _, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
        rows = ROWS_PER_CHUNK[attributes[b"compression"][0]]
        count = -(-(bottom - top + 1) // rows)
        offsets = struct.unpack_from(f"<{count}Q", data, at)
        ends = [offset + 8 + struct.unpack_from("<I", data, offset + 4)[0] for offset in offsets]
    except (struct.error, KeyError, ValueError, IndexError):
        return True
    return bool(min(offsets) == 0 or max(ends) > len(data))


def decoded_bytes(data: bytes) -> int:
    """Return the size in memory of the channels that the header declares, each of 32 bits."""
    attributes, _ = _header(data)
    left, top, right, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
    names, at, count = attributes[b"channels"], 0, 0
    while names[at] != 0:  # a name, and 16 bytes for type and sampling
        at, count = names.index(b"\0", at) + 17, count + 1
    return 4 * count * int(max(right - left + 1, 0) * max(bottom - top + 1, 0))


def _header(data: bytes) -> tuple[dict[bytes, bytes], int]:
    """Return the attributes of the first part, and the offset of its chunk table."""
    attributes, at = {}, 8
    while data[at] != 0:
        name_end = data.index(b"\0", at)
        type_end = data.index(b"\0", name_end + 1)
        (size,) = struct.unpack_from("<I", data, type_end + 1)
        attributes[data[at:name_end]] = data[type_end + 5 : type_end + 5 + size]
        at = type_end + 5 + size
    return attributes, at + 1


def _library(path: Path) -> Any:
    try:
        import OpenEXR
    except ImportError:
        raise MediaError(
            f"OpenEXR must be installed for {path.name}: {extra_remedy('exr')}"
        ) from None
    return OpenEXR
