"""A minimal WebDriver client: the W3C protocol over HTTP to chromedriver."""

from __future__ import annotations

import base64
import json
import shutil
import socket
import subprocess
import time
import urllib.error
import urllib.request
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next(filter(None, map(shutil.which, NAMES)), None)
CHROMEDRIVER = shutil.which("chromedriver")
# a container's /dev/shm is too small for pages with a film
FLAGS = [
    "--headless", "--no-sandbox", "--disable-dev-shm-usage", "--disable-gpu", "--disable-quic",
    "--no-first-run", "--disable-background-networking", "--disable-component-update",
    "--disable-sync",
]  # fmt: skip
ELEMENT = "element-6066-11e4-a52e-4f735466cecf"  # key of an element in W3C WebDriver


class Browser:
    """One headless session; use as a context manager."""

    def __init__(self, profile: Path, width: int = 1300, height: int = 1000) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.base = f"http://127.0.0.1:{port}"
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self.process = subprocess.Popen([str(CHROMEDRIVER), f"--port={port}"], **silent)
        flags = [*FLAGS, f"--user-data-dir={profile}", f"--window-size={width},{height}"]
        logs = {"browser": "ALL", "performance": "ALL"}
        options = {"binary": CHROMIUM, "args": flags}
        wanted = {"goog:chromeOptions": options, "goog:loggingPrefs": logs}
        self._await_driver()
        answer = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self.session = f"/session/{answer['sessionId']}"

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._call("DELETE", self.session)
        finally:
            self.process.terminate()
            self.process.wait(timeout=20)

    def _await_driver(self) -> None:
        for _ in range(200):
            try:
                if self._call("GET", "/status")["ready"]:
                    return
            except (urllib.error.URLError, ConnectionError):
                time.sleep(0.1)
        self.process.terminate()
        raise RuntimeError("chromedriver did not become ready within 20 s")

    def _call(self, method: str, path: str, body: dict | None = None):
        data = None if body is None else json.dumps(body).encode()
        kind = {"Content-Type": "application/json"}
        request = urllib.request.Request(self.base + path, data, kind, method=method)
        try:
            with urllib.request.urlopen(request, timeout=60) as reply:
                return json.load(reply)["value"]
        except urllib.error.HTTPError as wrong:
            raise RuntimeError(f"{method} {path}: {wrong.read().decode()}") from wrong

    def open(self, url: str) -> None:
        self._call("POST", f"{self.session}/url", {"url": url})

    def show(self, url: str, width: int) -> None:
        """Open a page in a window of some width, px."""
        size = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self.devtools("Emulation.setDeviceMetricsOverride", **size)
        self.open(url)

    def run(self, script: str):
        """Value of a piece of JavaScript with `return`."""
        return self._call("POST", f"{self.session}/execute/sync", {"script": script, "args": []})

    def until(self, condition: str, seconds: float = 90.0) -> None:
        """Wait until an expression of JavaScript is true; AssertionError where it never is."""
        end = time.monotonic() + seconds
        while not self.run(f"return {condition}"):
            assert time.monotonic() < end, f"never true: {condition}"
            time.sleep(0.05)

    def element(self, css: str) -> str:
        wanted = {"using": "css selector", "value": css}
        answer = self._call("POST", f"{self.session}/element", wanted)
        return f"{self.session}/element/{answer[ELEMENT]}"

    def keys(self, css: str, text: str) -> None:
        self._call("POST", f"{self.element(css)}/value", {"text": text})

    def click(self, css: str) -> None:
        self._call("POST", f"{self.element(css)}/click", {})

    def log(self, kind: str) -> list[dict]:
        return self._call("POST", f"{self.session}/se/log", {"type": kind})

    def devtools(self, command: str, **parameters) -> dict:
        wanted = {"cmd": command, "params": parameters}
        return self._call("POST", f"{self.session}/goog/cdp/execute", wanted)

    def screenshot(self, path: Path) -> None:
        path.write_bytes(base64.b64decode(self._call("GET", f"{self.session}/screenshot")))
