"""A headless Chromium for tests of pages: opens, clicks, collects errors, takes pictures.

It is driven over two pipes with the DevTools protocol, which needs no package and no open port:
https://chromedevtools.github.io/devtools-protocol
"""

import base64
import contextlib
import io
import itertools
import json
import os
import selectors
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import matplotlib.image
import numpy as np

FLAGS = [
    "--headless=new",
    "--no-sandbox",  # Tests may run as root, for whom Chromium has no sandbox.
    "--use-gl=angle",  # With the next two, WebGL needs no graphics card.
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--force-device-scale-factor=1",
    "--hide-scrollbars",
]


def chromium() -> str | None:
    """Returns the path of Chromium, or None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next(filter(None, map(shutil.which, names)), None)


class Browser:
    """One page of a Chromium of its own.

    Attributes:
        errors: What the page complained about: console errors, exceptions, failed requests.
        requests: Addresses that it asked for, the page's own first; those of data within the page
            are left out.
    """

    def __init__(self, width: int = 1280, height: int = 720, dark: bool = False) -> None:
        """Starts the browser; ``dark`` is what a page sees as the user's preferred scheme."""
        self.errors: list[str] = []
        self.requests: list[str] = []
        self._ids = itertools.count(1)
        self._loaded = False
        self._unread = b""
        self._session = ""
        self._profile = tempfile.TemporaryDirectory(prefix="chromium-", ignore_cleanup_errors=True)
        # Chromium reads commands from descriptor 3 and answers on 4.
        pipes = 'exec "$@" 3<&0 4>&1 </dev/null >/dev/null'
        command = [chromium() or "chromium", *FLAGS, "--remote-debugging-pipe"]
        command += [f"--user-data-dir={self._profile.name}", f"--window-size={width},{height}"]
        self._process = subprocess.Popen(
            ["sh", "-c", pipes, "sh", *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self._pipe = selectors.DefaultSelector()
        self._pipe.register(self._process.stdout, selectors.EVENT_READ)
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        attached = self.call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = attached["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")
        self.resize(width, height)
        self.prefer(dark)

    def __enter__(self) -> "Browser":
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the browser and removes its profile."""
        self._session = ""
        with contextlib.suppress(OSError, TimeoutError):
            self.call("Browser.close")
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._process.stdin.close()
        self._process.stdout.close()
        self._pipe.close()
        self._profile.cleanup()

    def resize(self, width: int, height: int) -> None:
        """Sets the size of the page [pixels]."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height,
                  deviceScaleFactor=1, mobile=False)  # fmt: skip

    def prefer(self, dark: bool) -> None:
        """Sets the colour scheme that a page sees as the user's preferred one."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])

    def open(self, address: str | Path, timeout: float = 60.0) -> None:
        """Opens a page, or a file, and waits until it is loaded."""
        self._loaded = False
        url = address.resolve().as_uri() if isinstance(address, Path) else address
        self.call("Page.navigate", url=url)
        self._pump(lambda: self._loaded, timeout, f"{address} does not load")

    def evaluate(self, javascript: str) -> object:
        """Returns the value of an expression in the page; a promise is awaited.

        Raises:
            RuntimeError: when it throws.
        """
        answer = self.call(
            "Runtime.evaluate", expression=javascript, returnByValue=True, awaitPromise=True
        )
        if "exceptionDetails" in answer:
            raise RuntimeError(f"{javascript}: {_exception(answer['exceptionDetails'])}")
        return answer["result"].get("value")

    def wait_until(self, javascript: str, timeout: float = 30.0) -> None:
        """Waits until an expression in the page is true.

        Raises:
            TimeoutError: when it stays false.
        """
        end = time.monotonic() + timeout
        while not self.evaluate(f"Boolean({javascript})"):
            if time.monotonic() > end:
                raise TimeoutError(f"{javascript} is still false after {timeout} s")
            self.wait(0.1)

    def wait(self, seconds: float) -> None:
        """Lets the page go on for a while."""
        with contextlib.suppress(TimeoutError):
            self._pump(lambda: False, seconds)

    def click(self, x: float, y: float) -> None:
        """Clicks at a point of the page [pixels from the upper left corner]."""
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)

    def click_on(self, javascript: str) -> None:
        """Clicks in the middle of the element that an expression gives."""
        box = f"(() => {{const b = ({javascript}).getBoundingClientRect();"
        middle = self.evaluate(box + " return [b.x + b.width / 2, b.y + b.height / 2]})()")
        self.click(*middle)

    def screenshot(self, path: Path | None = None) -> np.ndarray:
        """Returns what is seen (height, width, 3), 0 to 1, and writes it as PNG to ``path``."""
        png = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        if path is not None:
            path.write_bytes(png)
        return matplotlib.image.imread(io.BytesIO(png), format="png")[..., :3]

    def call(self, method: str, **parameters: object) -> dict:
        """Calls a method of the DevTools protocol and returns its result.

        Raises:
            RuntimeError: when the browser refuses.
            TimeoutError: when it does not answer.
        """
        message = {"id": next(self._ids), "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        self._process.stdin.write(json.dumps(message).encode() + b"\0")
        self._process.stdin.flush()
        answer: dict = {}

        def answered() -> bool:
            return answer.get("id") == message["id"]

        self._pump(answered, 60.0, f"no answer to {method}", into=answer)
        if "error" in answer:
            raise RuntimeError(f"{method}: {answer['error']['message']}")
        return answer["result"]

    def _pump(self, done, timeout, message="", into=None) -> None:
        """Takes in what the browser says until ``done``."""
        end = time.monotonic() + timeout
        while not done():
            if not self._pipe.select(max(0.0, end - time.monotonic())):
                raise TimeoutError(message)
            read = os.read(self._process.stdout.fileno(), 1 << 20)
            if not read:
                raise OSError("Chromium has ended")
            *complete, self._unread = (self._unread + read).split(b"\0")
            for text in complete:
                said = json.loads(text)
                if "id" in said and into is not None:
                    into.update(said)
                elif "method" in said:
                    self._notice(said["method"], said["params"])

    def _notice(self, method: str, event: dict) -> None:
        match method:
            case "Page.loadEventFired":
                self._loaded = True
            case "Network.requestWillBeSent":
                if not event["request"]["url"].startswith(("data:", "blob:")):
                    self.requests.append(event["request"]["url"])
            case "Runtime.exceptionThrown":
                self.errors.append(_exception(event["exceptionDetails"]))
            case "Runtime.consoleAPICalled" if event["type"] in ("error", "assert"):
                said = [str(part.get("value", part.get("description"))) for part in event["args"]]
                self.errors.append(" ".join(said))
            case "Log.entryAdded" if event["entry"]["level"] == "error":
                entry = event["entry"]
                self.errors.append(f"{entry['text']} {entry.get('url', '')}".strip())


def _exception(details: dict) -> str:
    return details.get("exception", {}).get("description", details["text"])
