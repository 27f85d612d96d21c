"""Headless Chromium, controlled over its DevTools pipe (file descriptors 3 and 4)."""

import base64
import fcntl
import json
import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Self

import cv2
import numpy as np

from shared_model.arrays import Picture

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
# What takes longer is stuck, however busy the machine is.
LIMIT_S = 600.0
# The first of the descriptors that cannot collide with 3 and 4.
HIGH_FD = 20


def find_browser() -> str | None:
    """The path of a Chromium, None if none is installed."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


class Browser:
    """One page of a new browser.

    program: path of Chromium.  folder: for its profile.  width, height: of the window, pixels.
    more: flags.
    """

    def __init__(
        self, program: str, folder: Path, width: int = 1280, height: int = 860, *more: str
    ) -> None:
        to_browser, self._commands = os.pipe()
        self._answers, from_browser = os.pipe()
        to_browser, from_browser = (_moved(fd) for fd in (to_browser, from_browser))

        def connect() -> None:
            os.dup2(to_browser, 3)
            os.dup2(from_browser, 4)

        # Root in a container has no sandbox, a server has no GPU.
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--no-first-run"]
        where = [f"--user-data-dir={folder}", f"--window-size={width},{height}"]
        self._process = subprocess.Popen(
            [program, *flags, *where, *more, "--remote-debugging-pipe", "about:blank"],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(3, 4),
            preexec_fn=connect,
        )
        os.close(to_browser)
        os.close(from_browser)
        self._number, self._rest = 0, b""
        self._session: str | None = None
        targets = self.call("Target.getTargets")["targetInfos"]
        target = next(info["targetId"] for info in targets if info["type"] == "page")
        self._session = self._attached(target)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        # Chromium and its child processes end when the pipe is closed.
        os.close(self._commands)
        os.close(self._answers)
        try:
            self._process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            self._process.kill()

    def call(self, method: str, session: str | None = None, **parameters: Any) -> dict[str, Any]:
        """Send one DevTools command and return its result.

        session: of the tab it is for, see `tab`; None: of the one that is controlled.
        """
        self._number += 1
        message: dict[str, Any] = {"id": self._number, "method": method, "params": parameters}
        if session or self._session:
            message["sessionId"] = session or self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            if answer.get("id") == self._number:
                assert "error" not in answer, answer["error"]
                result: dict[str, Any] = answer["result"]
                return result

    @contextmanager
    def tab(self, address: str) -> Iterator[str]:
        """A further tab, at this address, which is the one that is controlled in the `with` block.

        Yields the session of the one before.
        """
        before, self._session = self._session, None
        assert before is not None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._attached(target)
        self.call("Page.navigate", url=address)
        try:
            yield before
        finally:
            self._session = None
            self.call("Target.closeTarget", targetId=target)
            self._session = before

    def value(self, expression: str) -> Any:
        """The value of a JavaScript expression on the page."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, condition: str, limit_s: float = LIMIT_S) -> None:
        """Wait until a JavaScript condition holds on a page whose scripts have been loaded."""
        deadline = time.monotonic() + limit_s
        while not self.value(f"document.readyState != 'loading' && ({condition})"):
            assert time.monotonic() < deadline, f"still not: {condition}"
            time.sleep(0.02)

    def box(self, selector: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element in the window, scrolled into view."""
        found = self.value(
            f"(e => {{ e.scrollIntoView({{block: 'center'}}); const b = e.getBoundingClientRect();"
            f" return [b.x, b.y, b.width, b.height]; }})(document.querySelector({selector!r}))"
        )
        left, top, width, height = found
        return left, top, width, height

    def mouse(self, kind: str, x: float, y: float) -> None:
        """Send a mouse event: mousePressed, mouseMoved (with the button down) or mouseReleased."""
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", buttons=1, clickCount=1
        )

    def click(self, selector: str, across: float = 0.5) -> None:
        """Click an element at this fraction of its width."""
        left, top, width, height = self.box(selector)
        for kind in ("mousePressed", "mouseReleased"):
            self.mouse(kind, left + across * width, top + height / 2)

    def screenshot(self) -> Picture:
        """The window, (h, w, 3) uint8 BGR."""
        data = base64.b64decode(self.call("Page.captureScreenshot")["data"])
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
        assert picture is not None
        return np.asarray(picture, dtype=np.uint8)

    def _attached(self, target: str) -> str:
        """The session by which a tab is controlled."""
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        return str(attached["sessionId"])

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            data = os.read(self._answers, 1 << 16)
            assert data, "the browser has gone"
            self._rest += data
        message, self._rest = self._rest.split(b"\0", 1)
        answer: dict[str, Any] = json.loads(message)
        return answer


def _moved(fd: int) -> int:
    high = fcntl.fcntl(fd, fcntl.F_DUPFD_CLOEXEC, HIGH_FD)
    os.close(fd)
    return high
