"""A page in a real browser: Chromium without a window, spoken to over its DevTools pipe."""

from __future__ import annotations

import base64
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = next((found for name in ("chromium", "chromium-browser") if (found := shutil.which(name))), None)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--remote-debugging-pipe",
)


class Page:
    """One tab.

    Attributes:
        complaints: Errors and warnings of its console, and exceptions, as they came.
        requests: Addresses that it asked for.
    """

    def __init__(self, to: int, back: int, seconds: float = 60.0) -> None:
        self.to, self.back, self.seconds = to, back, seconds
        self.number, self.rest, self.session = 0, b"", None
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.loaded = False
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One DevTools command and its result."""
        self.number += 1
        message = {"id": self.number, "method": method, "params": parameters}
        if self.session is not None:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._next()
            if answer.get("id") == self.number:
                assert "error" not in answer, f"{method}: {answer['error']}"
                return answer["result"]

    def screen(self, width: int, height: int, *, dark: bool = False, touch: bool = False) -> None:
        """Take the size, colours and finger of a device."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=touch,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=touch)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def open(self, path: Path) -> None:
        """Load a file and wait until every figure in sight of the reader has been drawn."""
        self.loaded = False
        self.call("Page.navigate", url=path.resolve().as_uri())
        self._wait()

    def visit(self, address: str, ready: str) -> None:
        """Load an address and wait until an expression holds."""
        self.loaded = False
        self.call("Page.navigate", url=address)
        self.wait(ready)

    def wait(self, expression: str) -> None:
        """Wait until a JavaScript expression holds in the page."""
        end = time.monotonic() + self.seconds
        while not self.run(expression):
            assert time.monotonic() < end, f"{expression}: not so after {self.seconds} s: {self.complaints}"
            time.sleep(0.1)

    def press(self, key: str, modifiers: int = 0) -> None:
        """Press and release a key; modifiers are 1 for Alt, 2 for Ctrl, 8 for Shift."""
        text = {"text": key} if len(key) == 1 and not modifiers & 2 else {}
        code = {"code": "Space"} if key == " " else {}
        for kind in ("keyDown", "keyUp"):
            self.call("Input.dispatchKeyEvent", type=kind, key=key, modifiers=modifiers, **code, **text)

    def unfold(self) -> None:
        """Open every part that is folded, and wait until its figures have been drawn."""
        self.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        self._wait()

    def _wait(self) -> None:
        """Wait until the page is loaded and every figure that is not folded away has been drawn."""
        end = time.monotonic() + self.seconds
        places = "[...document.querySelectorAll('[data-chart]')]"
        drawn = f"{places}.every(place => place.dataset.drawn || !place.clientWidth)"
        ready = f"document.readyState === 'complete' && {drawn}"
        while not (self.run(ready) and self.loaded):
            assert time.monotonic() < end, f"not drawn after {self.seconds} s: {self.complaints}"
            time.sleep(0.05)

    def run(self, expression: str) -> Any:
        """Value of a JavaScript expression in the page; waits for a promise."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def picture(self, path: Path, *, whole: bool = True) -> None:
        """Save the page, or what the screen shows of it, as PNG."""
        answer = self.call("Page.captureScreenshot", format="png", captureBeyondViewport=whole)
        path.write_bytes(base64.b64decode(answer["data"]))

    def _next(self) -> dict[str, Any]:
        """The next message; events are noted on the way."""
        end = time.monotonic() + self.seconds
        while b"\0" not in self.rest:
            assert select.select([self.back], [], [], max(0.0, end - time.monotonic()))[0], "no answer"
            chunk = os.read(self.back, 1 << 20)
            assert chunk, "the browser is gone"
            self.rest += chunk
        message, _, self.rest = self.rest.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        self._note(found.get("method", ""), found.get("params", {}))
        return found

    def _note(self, event: str, told: dict[str, Any]) -> None:
        if event == "Page.loadEventFired":
            self.loaded = True
        elif event == "Runtime.exceptionThrown":
            self.complaints.append(str(told["exceptionDetails"]))
        elif event == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning", "assert"):
            self.complaints.append(str(told["args"]))
        elif event == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
            self.complaints.append(told["entry"]["text"])
        elif event == "Network.requestWillBeSent":
            self.requests.append(told["request"]["url"])


@contextmanager
def page() -> Iterator[Page]:
    """A fresh browser with one tab; it ends with the block."""
    assert CHROMIUM is not None
    to_read, to = os.pipe()
    back, back_write = os.pipe()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:

        def take() -> None:  # the browser reads commands from descriptor 3 and answers on 4
            low, high = os.dup(to_read), os.dup(back_write)
            os.dup2(low, 3)
            os.dup2(high, 4)

        process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f"--user-data-dir={profile}"],
            preexec_fn=take,
            close_fds=False,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_read)
        os.close(back_write)
        try:
            yield Page(to, back)
        finally:
            process.terminate()
            process.wait(20)
            os.close(to)
            os.close(back)
