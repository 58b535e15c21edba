"""Live views of one source: the source is read and views are dewarped only while clients watch."""

from __future__ import annotations

import asyncio
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import av
import numpy as np

from ...base.errors import InvalidParameter, OmnimirrorError, OutsideField
from ...base.native import usable_cores
from ...cameras.camera import Camera
from ...dewarp import Dewarper
from ...dewarp.interfaces import Interpolation
from ...dewarp.screens import Plane, View
from ...dewarp.video_files import dewarp_frame
from ...dewarp.views import max_zoom, resolution
from ...dewarp.yuv import Siting
from ...io.live_sources import TICKS, Playback, without_credentials
from ...io.video_frames import planar
from ..named_views import NamedView
from .publishing import publish_stream
from .stream_outputs import JpegEncoder, LatestOutput, StreamOutput, TransportOutput

MAX_VIDEO_SIDE_PX = 8192
"""Maximum side that H.264 players support."""
STEERING_ANGLES = ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg")
SOURCE_TIMEOUT_S = 10.0
"""Time without clients after which the source is closed."""
CHECK_INTERVAL_S = 1.0
RETRY_INTERVAL_S = 10.0
"""Time after which a source that ended with an error is opened again."""


class LiveView:
    """One view with its stream outputs.

    Parameters
    ----------
    named
        View and whether it is steerable.
    camera
        Camera of the source images.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    wake
        Called when a client connects.
    """

    def __init__(
        self,
        without_credentials: NamedView,
        camera: Camera,
        interpolation: Interpolation,
        wake: Callable[[], None],
    ) -> None:
        self.named, self.camera, self._interpolation = without_credentials, camera, interpolation
        self._dewarper = self._create_dewarper(without_credentials(camera))
        self.initial_view = self._dewarper.view
        _check_video_size(without_credentials.name, self.size)
        self.jpeg = LatestOutput(wake, JpegEncoder())
        self.transport = TransportOutput(self.size, wake)
        self.frames = LatestOutput(wake, lambda frame: frame)
        self.outputs: dict[Siting, list[StreamOutput]] = {
            "center": [self.jpeg],
            "left": [self.transport, self.frames],
        }
        """Outputs by siting of their chroma samples."""
        self.frames_dewarped = self.frames_dropped = 0
        self.error = ""
        """Reason why the last frame could not be dewarped."""
        self._next: tuple[av.VideoFrame, Siting] | None = None
        self._is_working = False
        self._lock = threading.Lock()

    @property
    def view(self) -> View:
        """Current view."""
        return self._dewarper.view

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px."""
        return self._dewarper.view.size

    @property
    def zoom(self) -> float:
        """Ratio of the current to the initial focal length; 1 for views without focal length."""
        if not (isinstance(self.view, Plane) and isinstance(self.initial_view, Plane)):
            return 1.0
        return self.view.focal_px / self.initial_view.focal_px

    @property
    def clients(self) -> int:
        """Number of connected clients."""
        return sum(output.clients for output in self._all_outputs())

    @property
    def is_active(self) -> bool:
        """True if any output needs frames."""
        return any(output.is_active for output in self._all_outputs())

    def steer(self, **changes: Any) -> Plane:
        """Change the viewing direction, field of view or zoom.

        Parameters
        ----------
        **changes
            ``pan_deg``, ``tilt_deg``, ``roll_deg``, and ``hfov_deg`` or ``zoom`` relative to the
            initial field of view.

        Raises
        ------
        InvalidParameter
            If the view is not steerable or a value is out of range.
        OutsideField
            If the new view is outside the field of the camera.
        """
        view, initial = self._dewarper.view, self.initial_view
        is_plane = isinstance(view, Plane) and isinstance(initial, Plane)
        if not (self.named.steerable and is_plane):
            raise InvalidParameter(
                f"the view {self.named.name!r} must be steerable; add steerable = true to its table"
            )
        assert isinstance(view, Plane)
        assert isinstance(initial, Plane)
        if "zoom" in changes and "hfov_deg" in changes:
            raise InvalidParameter("zoom and hfov_deg must not be given together")
        zoom = changes.pop("zoom", None)
        steered = replace(view, **changes)
        if zoom is not None:
            maximum = max_zoom(self.camera, replace(steered, hfov_deg=initial.hfov_deg))
            if zoom > maximum:
                raise InvalidParameter(
                    f"zoom must be at most {maximum:.3g}, the resolution of the camera; got {zoom:g}"
                )
            steered = replace(steered, hfov_deg=initial.zoomed(zoom).hfov_deg)
        self._dewarper = self._create_dewarper(steered)
        return steered

    def set_frame_rate(self, frame_rate: Fraction) -> None:
        """Set the frame rate of all outputs."""
        for output in self._all_outputs():
            output.frame_rate = frame_rate

    def submit(self, frame: av.VideoFrame, siting: Siting, pool: Executor) -> None:
        """Dewarp a frame if any output needs it; a frame that is still queued is dropped."""
        if not self.is_active:
            return
        with self._lock:
            self.frames_dropped += self._next is not None
            self._next = (frame, siting)
            if self._is_working:
                return
            self._is_working = True
        with suppress(RuntimeError):  # the pool has been shut down
            pool.submit(self._work)

    def release(self) -> None:
        """Release the encoders after a period without clients."""
        for output in self._all_outputs():
            output.release()

    def _all_outputs(self) -> list[StreamOutput]:
        return [output for outputs in self.outputs.values() for output in outputs]

    def _work(self) -> None:
        while True:
            with self._lock:
                queued, self._next = self._next, None
                if queued is None:
                    self._is_working = False
                    return
            try:
                self._dewarp(*queued)
                self.error = ""
            except Exception as e:  # any failure concerns this frame only
                self.error = str(e) or type(e).__name__

    def _dewarp(self, frame: av.VideoFrame, siting: Siting) -> None:
        """Dewarp a frame once for each chroma siting in use."""
        dewarper = self._dewarper
        for target_siting, outputs in self.outputs.items():
            active = [output for output in outputs if output.is_active]
            if not active:
                continue
            dewarped = dewarp_frame(dewarper, frame, siting, target_siting)
            self.frames_dewarped += 1
            for output in active:
                output.take(dewarped)

    def _create_dewarper(self, view: View) -> Dewarper:
        if np.isnan(resolution(self.camera, view)):
            raise OutsideField(f"the {view} is outside the field of the camera")
        return Dewarper(self.camera, view, self._interpolation, keep_map=not self.named.steerable)


def _check_video_size(name: str, size: tuple[int, int]) -> None:
    width, height = size
    if max(width, height) > MAX_VIDEO_SIDE_PX:
        raise InvalidParameter(
            f"the sides of the view {name!r} must be at most {MAX_VIDEO_SIDE_PX} px for "
            f"video; got {width} x {height} px"
        )
    if width % 2 or height % 2:
        raise InvalidParameter(
            f"the sides of the view {name!r} must be even for video with 4:2:0 chroma; got "
            f"{width} x {height} px; use for example size = [{width + width % 2}, "
            f"{height + height % 2}]"
        )


class Gateway:
    """A source and its live views.

    Parameters
    ----------
    source
        Camera, stream URL, or video file, which is repeated.
    is_live
        Whether the source is a camera or a stream.
    camera
        Camera model of the source images.
    views
        Views by name.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    on_status
        Called with a sentence when the source is lost or restored.
    workers
        Number of dewarping threads; default: one per core.
    stored_orientation
        Dewarp frames as stored, without the rotation of a display matrix.
    """

    def __init__(
        self,
        source: str,
        is_live: bool,
        camera: Camera,
        views: Mapping[str, NamedView],
        interpolation: Interpolation = "auto",
        on_status: Callable[[str], None] = lambda message: None,
        workers: int | None = None,
        *,
        stored_orientation: bool = False,
    ) -> None:
        self._stored_orientation = stored_orientation
        self._has_reported = False
        self.source, self._is_live, self._on_status = source, is_live, on_status
        self.views = {
            name: LiveView(view, camera, interpolation, self.wake) for name, view in views.items()
        }
        self.state = f"{without_credentials(source)} is idle, no clients"
        self.frames_received = 0
        self._pool = ThreadPoolExecutor(workers or usable_cores(), "dewarping")
        self._camera = camera
        self._playing: Playback | None = None
        self._opened, self._is_checking = float("-inf"), False
        self._idle_since: float | None = None
        self._start = time.monotonic()

    async def publish(self, template: str) -> None:
        """Push all views to a URL in which ``{view}`` is replaced by the name, until cancelled."""
        async with asyncio.TaskGroup() as tasks:
            for name, view in self.views.items():
                url = template.replace("{view}", name)
                tasks.create_task(publish_stream(view.transport, url, self._on_status))

    def wake(self) -> None:
        """Open the source if necessary; called in the event loop."""
        self._idle_since = None
        if self._playing is None and not self._is_checking:
            self._is_checking = True
            self._open()
            asyncio.get_running_loop().call_later(CHECK_INTERVAL_S, self._check)

    def close(self) -> None:
        """Close the source and stop the dewarping threads."""
        if self._playing is not None:
            self._playing.stop()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def _open(self) -> None:
        self.state = f"waiting for {without_credentials(self.source)}"
        self._playing = Playback(
            self.source, self._is_live, self._report, stored_orientation=self._stored_orientation
        )
        self._opened = time.monotonic()
        thread = threading.Thread(
            target=self._read, args=(self._playing,), name="gateway", daemon=True
        )
        thread.start()

    def _check(self) -> None:
        """Close an idle source, or reopen a failed one for waiting clients."""
        now = time.monotonic()
        if any(view.is_active for view in self.views.values()):
            self._idle_since = None
            if self._playing is None and now - self._opened > RETRY_INTERVAL_S:
                self._open()
        elif self._idle_since is None:
            self._idle_since = now
        elif now - self._idle_since > SOURCE_TIMEOUT_S:
            self._close_source()
            return
        asyncio.get_running_loop().call_later(CHECK_INTERVAL_S, self._check)

    def _close_source(self) -> None:
        self._is_checking = False
        if self._playing is not None:
            self._playing.stop()
            self._playing = None
        self.state = f"{without_credentials(self.source)} is idle, no clients"
        for view in self.views.values():
            view.release()

    # -- reader thread ---------------------------------------------------------------------------

    def _read(self, playing: Playback) -> None:
        try:
            for frame in playing.frames():
                if self._playing is not playing:
                    return
                self._distribute(frame, playing)
        except OmnimirrorError as e:
            self._report(str(e))
        finally:
            if self._playing is playing:
                self._playing = None

    def _distribute(self, frame: av.VideoFrame, playing: Playback) -> None:
        if (frame.width, frame.height) != self._camera.image_size:
            width, height = self._camera.image_size
            raise InvalidParameter(
                f"frames of {without_credentials(self.source)} must have the size of the "
                f"camera, {width} x {height} px; got {frame.width} x {frame.height} px"
            )
        if not self._has_reported:
            self._has_reported = True
            for note in playing.notes:
                self._on_status(note)
        self.frames_received += 1
        self.state = f"{without_credentials(self.source)} is playing"
        frame = planar(frame)  # converted once for all views
        elapsed_s = time.monotonic() - self._start
        frame.time_base, frame.pts = TICKS, round(elapsed_s / TICKS)
        for view in self.views.values():
            if playing.frame_rate:
                view.set_frame_rate(playing.frame_rate)
            view.submit(frame, playing.siting, self._pool)

    def _report(self, message: str) -> None:
        self.state = message
        self._on_status(message)
