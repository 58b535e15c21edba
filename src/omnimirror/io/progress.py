"""Progress of frame processing: counting and periodic reports."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from typing import NamedTuple

REPORT_INTERVAL_S = 0.2
RATE_AVERAGING_S = 5.0


class FrameProgress(NamedTuple):
    """Progress of frame processing."""

    done: int
    """Number of processed frames."""
    total: int | None
    """Expected number of frames; None if unknown."""
    rate: float
    """Recent frames per second."""
    elapsed_s: float
    remaining_s: float | None


class ProgressMeter:
    """Counter of frames with periodic reports."""

    def __init__(
        self, on_progress: Callable[[FrameProgress], None] | None, total: int | None
    ) -> None:
        self._on_progress, self._total = on_progress, total
        self._start = self._reported = time.monotonic()
        self.done = 0
        self._recent: deque[tuple[float, int]] = deque([(self._start, 0)])

    @property
    def elapsed_s(self) -> float:
        """Elapsed time since creation, s."""
        return time.monotonic() - self._start

    def step(self) -> None:
        """Count one frame."""
        self.done += 1
        now = time.monotonic()
        if now - self._reported >= REPORT_INTERVAL_S:
            self._reported = now
            self.report()

    def report(self) -> None:
        """Report the progress."""
        if self._on_progress is None:
            return
        now = time.monotonic()
        self._recent.append((now, self.done))
        while len(self._recent) > 2 and now - self._recent[0][0] > RATE_AVERAGING_S:
            self._recent.popleft()
        first_time, first_done = self._recent[0]
        rate = (self.done - first_done) / max(now - first_time, 1e-9)
        remaining = (
            None if self._total is None or rate <= 0 else max(0, self._total - self.done) / rate
        )
        self._on_progress(FrameProgress(self.done, self._total, rate, now - self._start, remaining))
