"""Page that works without a server, from disk or any web server: cameras, images and Design tab."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Callable, Sequence
from itertools import product
from pathlib import Path
from typing import get_args

from ... import __version__
from ...base.errors import InvalidParameter
from ...cameras.camera import CameraLooks, Mount
from ...optics.batch.best_focus import FOCUS_SEARCH
from ...optics.mirrors import (
    ConicAsphere,
    Ellipsoid,
    EvenPolynomial,
    Hyperboloid,
    Paraboloid,
    Sphere,
)
from ...optics.sensor_files import load_sensor
from ...simulation.rendering import SHOWN_SAMPLES, render_image
from ...simulation.scenes.room import Room
from ._camera_tables import camera_tables
from ._design_sensors import design_start, tables_from_sensor
from ._look_cameras import Cameras, NamedCamera
from ._uploads import encoded
from .design_messages import DesignSensor, PartInfo, StandaloneDesign
from .look_messages import StandaloneCamera, StandalonePage
from .pages import base64_of, inside, page_with_messages, script_text

# -- Design tab without a server -------------------------------------------------------------------

KERNEL = Path(__file__).with_name("kernel.wasm")
"""Compiled design evaluator, built by native/wasm/build.sh."""
MIRRORS = {
    cls.KIND for cls in (Sphere, Ellipsoid, Hyperboloid, Paraboloid, ConicAsphere, EvenPolynomial)
}
"""Kinds of mirrors with an analytic profile; all others require a solver."""
LENSES = {
    "perspective": ("focal_length_mm", "f_number", "focus_distance_mm"),
    "orthographic": ("magnification", "working_f_number", "focus_distance_mm"),
}
"""Ideal lenses and their parameters."""


def standalone_design() -> StandaloneDesign:
    """Return the Design tab for analytic mirrors with ideal lenses; the compiled evaluator in the page
    computes all values.

    Examples
    --------
    >>> [part.kind for part in standalone_design().start.lenses]
    ['perspective', 'orthographic']
    """
    start = design_start()
    sensors_by_name = {
        name: sensor
        for name in start.sensors
        if is_known(sensor := tables_from_sensor(load_sensor(name)))
    }
    parts = {
        "mirrors": tuple(part for part in start.mirrors if part.kind in MIRRORS),
        "lenses": tuple(_bare_lens(part) for part in start.lenses if part.kind in LENSES),
        "secondaries": (),
        "sensors": tuple(sensors_by_name),
    }
    only = start.model_copy(update=parts)
    return StandaloneDesign(
        start=only,
        sensors=tuple(sensors_by_name.values()),
        search=tuple(map(float, FOCUS_SEARCH)),
        kernel=b64encode(KERNEL.read_bytes()).decode(),
        script=script_text("design.js"),
    )


def is_known(sensor: DesignSensor) -> bool:
    """Check if the Design tab supports a sensor without a server."""
    tables = sensor.tables
    mirror, lens = tables["mirror"]["kind"], tables["lens"]
    is_bare = not ({"secondary", "mirror_pose", "housing"} & set(tables))
    own = LENSES.get(lens["kind"], ())
    return (
        mirror in MIRRORS
        and is_bare
        and all(name in ("kind", *own) or not value for name, value in lens.items())
    )


def _bare_lens(lens: PartInfo) -> PartInfo:
    return lens.model_copy(
        update={"parameters": tuple(p for p in lens.parameters if p.name in LENSES[lens.kind])}
    )


# -- Page without a server -------------------------------------------------------------------------

BALLS = ("ball:260", "ball:160")
"""Mirror balls available on the page in addition to the first sensor."""
JPEG_QUALITY = 85


def standalone_page(
    sensors: Sequence[str] | None = None, on_progress: Callable[[int, int], None] | None = None
) -> str:
    """Return a self-contained page that dewarps images dropped on it.

    The page contains the bundled sensors and mirror balls with a rendered image of a room for each
    sensor, and the Design tab for analytic mirrors with ideal lenses. Mirror outlines are fitted
    manually; automatic outline detection, levelling, restoration, searches, tolerances and
    calibrations require the server.

    Parameters
    ----------
    sensors
        Names of bundled sensors, and balls as ``ball:340`` with a field in degrees; all by default.
    on_progress
        Called with the number of completed cameras and their total number.

    Returns
    -------
    str
        HTML, about 2 MB.

    Raises
    ------
    InvalidParameter
        If the sensor name is unknown.

    Examples
    --------
    >>> from omnimirror.apps.studio import standalone_page
    >>> from pathlib import Path
    >>> _ = Path("look.html").write_text(standalone_page(["paper-spherical"]), encoding="utf-8")  # doctest: +SKIP
    """
    named_cameras = _symmetric_cameras(sensors)
    cameras = []
    for number, each in enumerate(named_cameras):
        cameras.append(_standalone_camera(each))
        if on_progress is not None:
            on_progress(number + 1, len(named_cameras))
    return page_with_messages(
        alone=StandalonePage(version=__version__, cameras=tuple(cameras)),
        standalone_design=standalone_design(),
    )


def _symmetric_cameras(sensors: Sequence[str] | None) -> list[NamedCamera]:
    """Return the rotationally symmetric cameras; their tables take a few kilobytes each."""
    cameras = Cameras()
    everything = [*(entry.id for entry in cameras.entries()), *BALLS]
    try:
        named_cameras = [
            cameras.find(name) for name in (everything if sensors is None else sensors)
        ]
    except KeyError as e:
        raise InvalidParameter(
            f"sensors must contain names from {', '.join(everything)}; got {e.args[0]!r}"
        ) from None
    return [each for each in named_cameras if each.camera.symmetry is not None]


def _standalone_camera(named_camera: NamedCamera) -> StandaloneCamera:
    ways = product(get_args(CameraLooks), (False, True))
    is_ball = named_camera.entry.kind == "ball"
    room = (
        b""
        if is_ball
        else encoded(
            render_image(named_camera.camera, Room(), samples=SHOWN_SAMPLES), ".jpg", JPEG_QUALITY
        )
    )
    return StandaloneCamera(
        entry=named_camera.entry,
        untilted=tuple(
            named_camera.model(Mount(orientation, image_flipped=flipped))
            for orientation, flipped in ways
        ),
        tables=base64_of(camera_tables(named_camera.camera).values.astype("<f4").tobytes()),
        room=inside(room, "image/jpeg") if room else "",
    )
