"""Preview window: a separate program that displays images from its standard input.

    python -m omnimirror.io._preview_window WIDTH HEIGHT TITLE

In a separate process the window blocks no other thread and is independent of the thread that sends
images. Images are raw RGB; if they arrive faster than they can be drawn, the newest is shown. The
program prints ``ready`` when the window is open, and ends with its input, or when the window is
closed by Escape, q or the mouse.
"""

from __future__ import annotations

import signal
import sys
import threading

import cv2
import numpy as np

POLL_INTERVAL_MS = 5
MAX_SCREEN_FRACTION = 0.9


class Window:
    """Window with the newest image, scaled to its size."""

    def __init__(self, size: tuple[int, int], title: str) -> None:
        import tkinter  # optional in Python installations

        self.size = size
        self.newest: bytes | None = None
        self.is_finished = False
        self.root = tkinter.Tk(className=title)
        self.root.title(title)
        screen = self.root.winfo_screenwidth(), self.root.winfo_screenheight()
        scale = min(
            1.0,
            *(MAX_SCREEN_FRACTION * limit / side for limit, side in zip(screen, size, strict=True)),
        )
        width, height = (max(1, round(scale * side)) for side in size)
        self.root.geometry(f"{width}x{height}")
        self.photo = tkinter.PhotoImage(master=self.root, width=width, height=height)
        self.label = tkinter.Label(self.root, image=self.photo, borderwidth=0, background="black")
        self.label.pack(fill="both", expand=True)
        for key in ("<Escape>", "q"):
            self.root.bind(key, lambda event: self.root.destroy())

    def run(self) -> None:
        """Run until the input ends, or the window is closed."""
        threading.Thread(target=self._read, daemon=True).start()
        self._poll()
        self.root.mainloop()

    def _read(self) -> None:
        count = 3 * self.size[0] * self.size[1]
        while len(data := sys.stdin.buffer.read(count)) == count:
            self.newest = data
        self.is_finished = True

    def _poll(self) -> None:
        data, self.newest = self.newest, None
        if data is not None:
            self._show(np.frombuffer(data, np.uint8).reshape(self.size[1], self.size[0], 3))
        if data is None and self.is_finished:
            self.root.destroy()
        else:
            self.root.after(POLL_INTERVAL_MS, self._poll)

    def _show(self, image: np.ndarray) -> None:
        window = max(1, self.root.winfo_width()), max(1, self.root.winfo_height())
        scale = min(length / side for length, side in zip(window, self.size, strict=True))
        if window[0] > 1 and scale != 1:  # 1: not drawn yet
            width, height = (max(1, round(scale * side)) for side in self.size)
            image = cv2.resize(
                image, (width, height), interpolation=cv2.INTER_AREA if scale < 1 else 1
            )
        height, width = image.shape[:2]
        self.photo.configure(
            width=width, height=height, data=b"P6 %d %d 255\n" % (width, height) + image.tobytes()
        )


def main() -> None:
    """Open the window, or print the reason in one line."""
    from tkinter import TclError

    signal.signal(signal.SIGINT, signal.SIG_IGN)  # handled by the parent process
    try:
        window = Window((int(sys.argv[1]), int(sys.argv[2])), sys.argv[3])
    except TclError as e:
        sys.exit(str(e))
    print("ready", flush=True)
    window.run()


if __name__ == "__main__":
    main()
