"""The page with a picture and its camera inside: it works from disk, with no server and nothing installed."""

from __future__ import annotations

import base64
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InvalidParameter
from .messages import Embedded
from .tables import MountedCamera, camera_model, camera_tables, title_of
from .uploads import eight_bits, encoded

PAGE = Path(__file__).parent / "page" / "index.html"
BENCH = PAGE.with_name("bench.js")
PLACE = "<!--embedded-->"
KINDS = {".png": "image/png", ".jpg": "image/jpeg", ".jpeg": "image/jpeg"}
"""Pictures that go into the page as they are."""


@cache
def page_text() -> str:
    """The studio's page, one file with everything in it."""
    return PAGE.read_text(encoding="utf-8")


@cache
def bench_text() -> str:
    """The script of the design bench, which the page fetches when it is wanted."""
    return BENCH.read_text(encoding="utf-8")


def viewer_of(
    camera: MountedCamera, name: str, options: tuple[str, ...], path: Path, image: NDArray[np.generic]
) -> str:
    """The text of a page that shows one picture, with the picture and its camera inside.

    Parameters
    ----------
    camera
    name
        Of the camera, for people.
    options
        What names the camera on the command line, which the page shows.
    path
        Where the picture came from. A PNG or JPEG goes in as it is, anything else as PNG of 8 bits.
    image : (h, w) or (h, w, 3) or (h, w, 4) array
        The picture, read.

    Raises
    ------
    InvalidParameter
        The picture is not of the camera's size.
    """
    width, height = camera.image_size
    if image.shape[:2] != (height, width):
        raise InvalidParameter(
            f"the picture has {image.shape[1]} x {image.shape[0]} px, and the camera's have {width} x {height}"
        )
    kind = KINDS.get(path.suffix.lower())
    as_it_is = kind is not None and image.dtype == np.uint8
    data = path.read_bytes() if as_it_is else encoded(eight_bits(image), ".png")
    inside = Embedded(
        camera=camera_model(name, name, title_of(camera), options, camera),
        tables=_base64(camera_tables(camera).values.astype("<f4").tobytes()),
        picture=f"data:{kind if as_it_is else 'image/png'};base64,{_base64(data)}",
        name=path.name,
    )
    json = inside.model_dump_json().replace("<", "\\u003c")  # no text in it can end the script
    return page_text().replace(PLACE, f'<script type="application/json" id="embedded">{json}</script>')


def _base64(data: bytes) -> str:
    return base64.b64encode(data).decode()
