"""Progress of frame processing: counting and periodic reports."""

from __future__ import annotations

import time

from ..base.logs import OnProgress

REPORT_INTERVAL_S = 0.2


class ProgressMeter:
    """Counter of frames with periodic reports."""

    def __init__(self, on_progress: OnProgress | None, total: int | None) -> None:
        self._on_progress, self._total = on_progress, total
        self._start = self._reported = time.monotonic()
        self.done = 0

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
        if self._on_progress is not None:
            self._on_progress(self.done, self._total)
