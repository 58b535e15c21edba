"""Images served as 8-bit PNG: files of the server, and rendered rooms."""

from __future__ import annotations

from functools import lru_cache
from hashlib import sha256
from pathlib import Path

import numpy as np

from ....base.errors import OmnimirrorError
from ....cameras.models import MirrorBall
from ....io import read_image
from ....optics.sensor import Sensor
from ..uploads import eight_bits, encoded, picture_in, safe_name
from .cameras import Known
from .messages import LevelAsk, LevelFound, RestoreAsk, RimFound

MOST_PIXELS = 4096 * 4096
"""Maximum size of a rendered image; rendering takes 60 bytes per pixel."""
RIMS_KEPT = 256
"""Maximum number of cached outlines, about 100 bytes each; a full cache is cleared."""

_rims: dict[bytes, RimFound] = {}
"""Cached mirror outlines by image digest."""


def shown_picture(path: Path) -> bytes:
    """Return an image of the server."""
    return encoded(eight_bits(read_image(path)), ".png")


def rim_in(data: bytes, name: str) -> RimFound:
    """Detect the mirror outline in an uploaded image; results are cached for reloads of the page."""
    from ....calibration.rim import find_rim

    key = sha256(data).digest()
    found = _rims.get(key)
    if found is None:
        rim = find_rim(eight_bits(picture_in(data, name)))
        found = RimFound(
            centre_px=rim.centre_px, radius_px=rim.radius_px, confidence=rim.confidence, is_sure=rim.is_sure
        )
        if len(_rims) >= RIMS_KEPT:
            _rims.clear()
        _rims[key] = found
    return found


def level_of(camera: Sensor | MirrorBall, ask: LevelAsk, data: bytes) -> LevelFound | None:
    """Estimate the camera tilt of an uploaded image; None if it has too few vertical edges."""
    from ....calibration.lines import level_in

    picture = eight_bits(picture_in(data, safe_name(ask.name)))
    level = level_in(picture, camera, camera.mount, ask.centre_px, ask.rim_radius_px)
    if level is None:
        return None
    return LevelFound(
        pitch_deg=level.pitch_deg, roll_deg=level.roll_deg, sigma_deg=level.sigma_deg, upright=level.upright,
        is_sure=level.is_sure,
    )  # fmt: skip


def restored_picture(sensor: Sensor, ask: RestoreAsk, data: bytes) -> bytes:
    """Restore an uploaded image: remove the optical blur of its sensor.

    Raises
    ------
    OmnimirrorError
        Unreadable image, or an image of another sensor.
    """
    from ....dewarp.restoration.sharpening import restore

    picture = eight_bits(picture_in(data, safe_name(ask.name)))
    distance = np.inf if ask.object_distance_mm is None else ask.object_distance_mm
    return encoded(restore(sensor, picture, object_distance_mm=distance), ".png")


@lru_cache(maxsize=8)
def room_picture(known: Known) -> bytes:
    """Render the image of a room by a camera.

    Raises
    ------
    OmnimirrorError
        Image too large.
    """
    from ....simulation.rendering.picture import SHOWN_SAMPLES, take_picture
    from ....simulation.scenes.worlds.room import Room

    width, height = known.camera.image_size
    if width * height > MOST_PIXELS:
        raise OmnimirrorError(
            f"the picture of {known.name}, {width} x {height} px, is too large to be simulated here; valid are "
            f"{MOST_PIXELS // 10**6} million pixels, and omnimirror simulate takes more"
        )
    return encoded(take_picture(known.camera, Room(), samples=SHOWN_SAMPLES), ".png")
