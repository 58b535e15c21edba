"""Page that dewarps images of the bundled sensors without a server, from disk or any web server."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import get_args

from .... import __version__
from ....base.errors import InvalidParameter
from ....cameras.frames import CameraLooks, Mount
from ....simulation.rendering.picture import SHOWN_SAMPLES, take_picture
from ....simulation.scenes.worlds.room import Room
from ..bench.alone import bench_alone
from ..uploads import encoded
from .cameras import Cameras, Known
from .messages import Alone, CameraAlone
from .tables import camera_tables
from .viewer import base64_of, inside, page_holding

BALLS = ("ball:260", "ball:160")
"""Mirror balls offered by the page in addition to the first sensor."""
JPEG_QUALITY = 85


def page_alone(sensors: Sequence[str] | None = None, progress: Callable[[int, int], None] | None = None) -> str:
    """Return a self-contained page that dewarps images dropped on it.

    The page contains the bundled sensors and mirror balls with a rendered image of a room for each
    sensor, and the design bench for analytic mirrors with ideal lenses. Mirror outlines are fitted
    manually; automatic outline detection, levelling, restoration, searches, tolerances and
    calibrations require the server.

    Parameters
    ----------
    sensors
        Names of bundled sensors, and balls as ``ball:340`` with a field in degrees; all by default.
    progress
        Called with the number of completed cameras and their total number.

    Returns
    -------
    str
        HTML, about 2 MB.

    Raises
    ------
    InvalidParameter
        Unknown sensor name.

    Examples
    --------
    >>> from omnimirror.apps.studio import page_alone
    >>> from pathlib import Path
    >>> _ = Path("look.html").write_text(page_alone(["paper-spherical"]), encoding="utf-8")  # doctest: +SKIP
    """
    known = _cameras(sensors)
    cameras = []
    for number, each in enumerate(known):
        cameras.append(_alone(each))
        if progress is not None:
            progress(number + 1, len(known))
    return page_holding(alone=Alone(version=__version__, cameras=tuple(cameras)), bench_alone=bench_alone())


def _cameras(sensors: Sequence[str] | None) -> list[Known]:
    """Return the rotationally symmetric cameras; their tables take a few kilobytes each."""
    cameras = Cameras()
    everything = [*(entry.id for entry in cameras.entries()), *BALLS]
    try:
        known = [cameras.find(name) for name in (everything if sensors is None else sensors)]
    except KeyError as e:
        raise InvalidParameter(f"sensors holds {e.args[0]!r}; it is valid with {', '.join(everything)}") from None
    return [each for each in known if each.camera.symmetry is not None]


def _alone(known: Known) -> CameraAlone:
    ways = product(get_args(CameraLooks), (False, True))
    is_ball = known.entry.kind == "ball"
    room = b"" if is_ball else encoded(take_picture(known.camera, Room(), samples=SHOWN_SAMPLES), ".jpg", JPEG_QUALITY)
    return CameraAlone(
        entry=known.entry,
        standing=tuple(known.model(Mount(looks, image_flipped=flipped)) for looks, flipped in ways),
        tables=base64_of(camera_tables(known.camera).values.astype("<f4").tobytes()),
        room=inside(room, "image/jpeg") if room else "",
    )
