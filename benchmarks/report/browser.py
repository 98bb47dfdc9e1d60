"""A headless Chromium, driven over a pipe by the DevTools protocol: needs nothing else."""

from __future__ import annotations

import base64
import io
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")

_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--hide-scrollbars",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--remote-debugging-pipe",
)

_LAUNCHER = """\
import os, sys
from fcntl import F_DUPFD, fcntl
pipes = [fcntl(int(number), F_DUPFD, 10) for number in sys.argv[1:3]]
for pipe, number in zip(pipes, (3, 4)):
    os.dup2(pipe, number)
os.execv(sys.argv[3], sys.argv[3:])
"""
"""Gives the browser its two pipes under the numbers that it expects."""


class Browser:
    """One page in a browser of its own.

    Attributes
    ----------
    problems : list of str
        Errors and warnings of the console, and exceptions, since the page was opened.
    """

    def __init__(self) -> None:
        assert CHROMIUM is not None
        self.problems: list[str] = []
        self._numbers = itertools.count(1)
        self._rest = b""
        self._folder = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        theirs_in, self._out = os.pipe()
        self._in, theirs_out = os.pipe()
        launcher = [sys.executable, "-c", _LAUNCHER, str(theirs_in), str(theirs_out)]
        self._process = subprocess.Popen(
            [*launcher, CHROMIUM, *_FLAGS, f"--user-data-dir={self._folder.name}"],
            pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log"):
            self.call(f"{domain}.enable")

    def close(self) -> None:
        """End the browser, and delete its profile."""
        self._session = None
        self.call("Browser.close")
        self._process.wait(10)
        os.close(self._in)
        os.close(self._out)
        self._folder.cleanup()

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method of the DevTools protocol; return its result."""
        number = next(self._numbers)
        message: dict[str, Any] = {"id": number, "method": method, "params": params}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._out, json.dumps(message).encode() + b"\0")
        while (answer := self._read()).get("id") != number:
            self._note(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            part = os.read(self._in, 1 << 20)
            assert part, "the browser has ended"
            self._rest += part
        text, self._rest = self._rest.split(b"\0", 1)
        return json.loads(text)

    def _note(self, event: dict[str, Any]) -> None:
        params = event.get("params", {})
        if event.get("method") == "Runtime.exceptionThrown":
            self.problems.append(json.dumps(params["exceptionDetails"])[:500])
        elif event.get("method") == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.problems.append(params["entry"]["text"])
        elif event.get("method") == "Runtime.consoleAPICalled" and params["type"] in (
            "error",
            "warning",
        ):
            self.problems.append(json.dumps(params["args"])[:500])

    def open(self, path: Path, width: int, height: int = 900, *, mobile: bool = False) -> float:
        """Open a file, and return after how many seconds it was loaded and drawn."""
        self.problems.clear()
        self.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=mobile,
        )
        self.call("Emulation.setTouchEmulationEnabled", enabled=mobile)
        begin = time.perf_counter()
        self.call("Page.navigate", url=path.resolve().as_uri())
        while self.value("document.readyState") != "complete" or "about:" in self.value(
            "location.href"
        ):
            time.sleep(0.02)
        self.settle()
        return time.perf_counter() - begin

    def value(self, expression: str) -> Any:
        """Value of an expression in the page; of a promise, what it becomes."""
        answer = self.call(
            "Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True
        )
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def settle(self, frames: int = 3) -> None:
        """Wait until some frames have been drawn."""
        self.value(
            f"new Promise(done => {{ let n = {frames};"
            " const next = () => n-- > 0 ? requestAnimationFrame(next) : done(1); next(); })"
        )

    def drag(self, start: tuple[float, float], end: tuple[float, float]) -> None:
        """Press the mouse, move it and let it go."""
        where = [
            start,
            *([a + k * (b - a) / 5 for a, b in zip(start, end, strict=True)] for k in range(1, 6)),
        ]
        self._mouse("mousePressed", *where[0], buttons=1, button="left", clickCount=1)
        for x, y in where[1:]:
            self._mouse("mouseMoved", x, y, buttons=1, button="left")
            self.settle(1)
        self._mouse("mouseReleased", *end, buttons=0, button="left", clickCount=1)
        self.settle()

    def _mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def touch(self, kind: str, points: list[tuple[float, float]]) -> None:
        """Send a touch event: touchStart, touchMove or touchEnd."""
        at = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(points)]
        self.call("Input.dispatchTouchEvent", type=kind, touchPoints=at)
        self.settle(1)

    def box(self, selector: str) -> dict[str, float]:
        """Place of an element on the screen."""
        return self.value(
            f"document.querySelector({json.dumps(selector)}).getBoundingClientRect().toJSON()"
        )

    def picture(self, selector: str | None = None, *, save: Path | None = None) -> np.ndarray:
        """Pixels (H, W, 3) of an element, or of the whole page."""
        params: dict[str, Any] = {"captureBeyondViewport": selector is None}
        if selector is not None:
            place = self.box(selector)
            place["x"] += self.value("scrollX")  # of the page, not of the screen
            place["y"] += self.value("scrollY")
            params["clip"] = {k: place[k] for k in ("x", "y", "width", "height")} | {"scale": 1}
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png", **params)["data"])
        if save is not None:
            save.write_bytes(png)
        return imread(io.BytesIO(png), format="png")[..., :3]
