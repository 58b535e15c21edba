"""A view that is offered live: dewarped for whoever watches it, and for nobody else; steered, where it may be."""

from __future__ import annotations

import threading
from collections.abc import Callable
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any

import av
import numpy as np

from ...cameras import Camera
from ...dewarp import Dewarper
from ...dewarp.contracts import Interpolation
from ...dewarp.frames import dewarp_frame
from ...dewarp.screens import Plane, View
from ...dewarp.views import largest_zoom, resolution
from ...dewarp.yuv.planes import Siting
from ...errors import InvalidParameter, OutsideField
from ..named_views import NamedView
from .coders import JpegCoder
from .outlets import NewestOutlet, Outlet, TransportOutlet

LARGEST_SIDE = 8192  # that players of H.264 show
STEERING = ("pan_deg", "tilt_deg", "roll_deg", "hfov_deg")


class LiveView:
    """One view, with its ways out.

    Parameters
    ----------
    named
        What it shows, and whether it may be steered.
    camera
        Which draws it.
    interpolation
        As for :class:`omnimirror.Dewarper`.
    wake
        Called when somebody begins to watch.
    """

    def __init__(
        self, named: NamedView, camera: Camera, interpolation: Interpolation, wake: Callable[[], None]
    ) -> None:
        self.named, self.camera, self._interpolation = named, camera, interpolation
        self._dewarp = self._dewarper(named(camera))
        self.beginning = self._dewarp.view
        width, height = self.size
        if max(width, height) > LARGEST_SIDE:
            raise InvalidParameter(
                f"the view {named.name!r} has {width} x {height} px; video is valid up to {LARGEST_SIDE} a side"
            )
        if width % 2 or height % 2:
            raise InvalidParameter(
                f"the view {named.name!r} has {width} x {height} px, and video halves the colours' resolution; valid "
                f"are even sides, such as size = [{width + width % 2}, {height + height % 2}]"
            )
        self.jpeg = NewestOutlet(wake, JpegCoder())
        self.transport = TransportOutlet(self.size, wake)
        self.frames = NewestOutlet(wake, lambda frame: frame)
        self.outlets: dict[Siting, list[Outlet]] = {"center": [self.jpeg], "left": [self.transport, self.frames]}
        """By where they take colour samples to lie."""
        self.dewarped = self.dropped = 0
        self.problem = ""
        """Why its frames cannot be drawn, in a sentence."""
        self._next: tuple[av.VideoFrame, Siting] | None = None
        self._is_working = False
        self._lock = threading.Lock()

    @property
    def view(self) -> View:
        """What is shown just now."""
        return self._dewarp.view

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) px."""
        return self._dewarp.view.size

    @property
    def zoom(self) -> float:
        """How many times longer its focal length is than at the beginning; 1 of a view that knows none."""
        if not (isinstance(self.view, Plane) and isinstance(self.beginning, Plane)):
            return 1.0
        return self.view.focal_px / self.beginning.focal_px

    @property
    def watchers(self) -> int:
        """How many watch just now."""
        return sum(outlet.watchers for outlets in self.outlets.values() for outlet in outlets)

    @property
    def is_wanted(self) -> bool:
        """Whether anyone watches."""
        return any(outlet.is_wanted for outlets in self.outlets.values() for outlet in outlets)

    def steer(self, **to: Any) -> Plane:
        """Look elsewhere: ``pan_deg``, ``tilt_deg``, ``roll_deg``, ``hfov_deg``, or ``zoom`` from the file's field.

        Raises
        ------
        InvalidParameter
            The view may not be steered, or the values are none.
        OutsideField
            Nothing would be seen there.
        """
        view, beginning = self._dewarp.view, self.beginning
        if not (self.named.steered and isinstance(view, Plane) and isinstance(beginning, Plane)):
            raise InvalidParameter(f"the view {self.named.name!r} is not steered; 'steered = true' in the file lets it")
        if "zoom" in to and "hfov_deg" in to:
            raise InvalidParameter("zoom and hfov_deg say the same thing twice; give one of them")
        zoom = to.pop("zoom", None)
        there = replace(view, **to)
        if zoom is not None:
            most = largest_zoom(self.camera, replace(there, hfov_deg=beginning.hfov_deg))
            if zoom > most:
                raise InvalidParameter(
                    f"zoom = {zoom:g} goes past what the camera resolves; it is valid up to {most:.3g}"
                )
            there = replace(there, hfov_deg=beginning.zoomed(zoom).hfov_deg)
        self._dewarp = self._dewarper(there)
        return there

    def tell_rate(self, frame_rate: Fraction) -> None:
        """How many frames a second there are."""
        for outlets in self.outlets.values():
            for outlet in outlets:
                outlet.frame_rate = frame_rate

    def offer(self, frame: av.VideoFrame, siting: Siting, pool: Executor) -> None:
        """Have a frame drawn if anyone watches; one that still waits for its turn gives way to it."""
        if not self.is_wanted:
            return
        with self._lock:
            self.dropped += self._next is not None
            self._next = (frame, siting)
            if self._is_working:
                return
            self._is_working = True
        with suppress(RuntimeError):  # the gateway is being closed
            pool.submit(self._work)

    def rest(self) -> None:
        """Nobody has watched for a while."""
        for outlets in self.outlets.values():
            for outlet in outlets:
                outlet.rest()

    def _work(self) -> None:
        while True:
            with self._lock:
                given, self._next = self._next, None
                if given is None:
                    self._is_working = False
                    return
            try:
                self._draw(*given)
                self.problem = ""
            except Exception as e:  # whatever it is, the next frame is tried
                self.problem = str(e) or type(e).__name__

    def _draw(self, frame: av.VideoFrame, siting: Siting) -> None:
        """Once for each siting that somebody takes."""
        dewarp = self._dewarp
        for to_siting, outlets in self.outlets.items():
            wanted = [outlet for outlet in outlets if outlet.is_wanted]
            if not wanted:
                continue
            drawn = dewarp_frame(dewarp, frame, siting, to_siting)
            self.dewarped += 1
            for outlet in wanted:
                outlet.take(drawn)

    def _dewarper(self, view: View) -> Dewarper:
        if np.isnan(resolution(self.camera, view)):
            raise OutsideField(f"the {view} sees nothing of the camera's field")
        return Dewarper(self.camera, view, self._interpolation, keep_map=not self.named.steered)
