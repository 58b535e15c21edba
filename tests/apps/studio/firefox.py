"""Firefox as packaged by Debian, controlled by WebDriver BiDi: a WebSocket to its remote agent, and
several commands."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from websockets.sync.client import ClientConnection, connect

NAMES = ("firefox-esr", "firefox")
TIMEOUT_S = 300.0  # sufficient for slow machines
PREFERENCES = {
    "webgl.force-enabled": True,
    "gfx.webrender.software": True,
    "browser.shell.checkDefaultBrowser": False,
    "datareporting.policy.dataSubmissionEnabled": False,
    "app.update.enabled": False,
    "toolkit.telemetry.enabled": False,
}
SOFTWARE = {"LIBGL_ALWAYS_SOFTWARE": "1", "MOZ_WEBGL_FORCE_EGL": "1"}
"""WebGL without a graphics card."""
ADDRESS = re.compile(r"WebDriver BiDi listening on (ws://\S+)\n")
POLL = """new Promise((done) => {{
  const look = () => {{
    let found = null;
    try {{ found = ({condition}); }} catch {{ }}
    found ? done(true) : setTimeout(look, 50);
  }};
  look();
}})"""


def firefox() -> str:
    """Return the path of Firefox; skip the test if it is missing."""
    path = os.environ.get("FIREFOX") or next(filter(None, map(shutil.which, NAMES)), None)
    if not path:
        pytest.skip("there is no firefox here (apt-get install firefox-esr)")
    return path


@contextmanager
def running(folder: Path) -> Iterator[Firefox]:
    """Run a headless browser with its profile in a folder."""
    lines = [
        f"user_pref({json.dumps(name)}, {json.dumps(value)});"
        for name, value in PREFERENCES.items()
    ]
    (folder / "user.js").write_text("\n".join(lines))
    command = [
        firefox(),
        "--headless",
        "--no-remote",
        "--remote-debugging-port=0",
        "--profile",
        str(folder),
    ]
    environment, log = {**os.environ, **SOFTWARE, "HOME": str(folder)}, folder / "log.txt"
    with (
        log.open("w") as file,
        subprocess.Popen(
            command, stdout=subprocess.DEVNULL, stderr=file, env=environment
        ) as process,
    ):
        try:
            address = _remote_address(process, log)
            with connect(f"{address}/session", max_size=None, open_timeout=TIMEOUT_S) as socket:
                page = Firefox(socket)
                yield page
                page.send("browser.close")
        finally:
            process.terminate()


def _remote_address(process: subprocess.Popen[bytes], log: Path) -> str:
    """Return the address of the remote agent from its output."""
    while process.poll() is None:
        if match := ADDRESS.search(log.read_text()):
            return match[1]
        time.sleep(0.05)
    raise AssertionError(f"firefox ended before it listened: {log.read_text()}")


class Firefox:
    """Browser with one page."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._numbers = count(1)
        self.problems: list[str] = []
        self.send("session.new", capabilities={})
        self.send("session.subscribe", events=["log.entryAdded"])
        self.context = self.send("browsingContext.getTree")["contexts"][0]["context"]

    def send(self, method: str, **parameters: Any) -> Any:
        """Send a command and return its result; error events in between are recorded."""
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters}))
        while True:
            message = json.loads(self._socket.recv(timeout=TIMEOUT_S))
            if message.get("method") == "log.entryAdded":
                entry = message["params"]
                if entry["type"] == "javascript" and entry["level"] == "error":
                    self.problems.append(entry["text"])
            elif message.get("id") == number:
                assert message["type"] == "success", f"{method}: {message}"
                return message["result"]

    def open(self, url: str) -> None:
        """Open an address and wait until its document is parsed; later requests may be pending."""
        self.send("browsingContext.navigate", context=self.context, url=url, wait="interactive")

    def size(self, width: int, height: int) -> None:
        """Set the size of the page, px."""
        viewport = {"width": width, "height": height}
        self.send("browsingContext.setViewport", context=self.context, viewport=viewport)

    def evaluate(self, script: str, *argument: Any) -> Any:
        """Return the JSON result of a script; a function receives the given argument."""
        call = f"({script})({json.dumps(argument[0])})" if argument else script
        text = f"Promise.resolve({call}).then((value) => JSON.stringify(value ?? null))"
        request = {"expression": text, "target": {"context": self.context}, "awaitPromise": True}
        response = self.send("script.evaluate", **request)
        assert response["type"] == "success", response["exceptionDetails"]["text"]
        return json.loads(response["result"]["value"])

    def wait(self, condition: str) -> None:
        """Wait until a condition is true in the page."""
        self.evaluate(POLL.format(condition=condition))

    def click(self, selector: str) -> None:
        """Click at the centre of an element."""
        node = f"document.querySelector({json.dumps(selector)})"
        box = self.evaluate(
            f"(({node}).scrollIntoView({{ block: 'center' }}), ({node}).getBoundingClientRect().toJSON())"
        )
        centre = {"x": round(box["x"] + box["width"] / 2), "y": round(box["y"] + box["height"] / 2)}
        steps = [
            {"type": "pointerMove", **centre},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        mouse = {
            "type": "pointer",
            "id": "mouse",
            "parameters": {"pointerType": "mouse"},
            "actions": steps,
        }
        self.send("input.performActions", context=self.context, actions=[mouse])

    def keys(self, *strokes: str) -> None:
        """Press keys in sequence; the keys of a stroke with an initial control key are held until
        U+E000."""
        actions: list[dict[str, Any]] = []
        for stroke in strokes:
            held = []
            for key in stroke:
                if key == "\ue000":
                    actions += [
                        {"type": "keyUp", "value": pressed_key} for pressed_key in reversed(held)
                    ]
                    held = []
                elif stroke.endswith("\ue000"):
                    actions.append({"type": "keyDown", "value": key})
                    held.append(key)
                else:
                    actions += [{"type": "keyDown", "value": key}, {"type": "keyUp", "value": key}]
        keyboard = {"type": "key", "id": "keyboard", "actions": actions}
        self.send("input.performActions", context=self.context, actions=[keyboard])

    def choose(self, selector: str, path: Path) -> None:
        """Set the file of an input element."""
        request = {
            "expression": f"document.querySelector({json.dumps(selector)})",
            "target": {"context": self.context},
        }
        response = self.send("script.evaluate", awaitPromise=False, **request)["result"]
        element = {"sharedId": response["sharedId"]}
        self.send("input.setFiles", context=self.context, element=element, files=[str(path)])
