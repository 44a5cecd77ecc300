"""A visitor of the page of `piv view`: serves it, and uses its mouse and keys."""

import json
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def serving(*words) -> Iterator[str]:
    """Address of the page that `piv view WORDS` serves; Ctrl-C ends it as it should."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    server = subprocess.Popen(
        [sys.executable, "-m", "piv", "view", *map(str, words), "--no-browser", f"--port={port}"],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        # a job in the background of a shell ignores Ctrl-C, and so would what it starts
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    try:
        assert server.stdout is not None
        # alone on its line, to be copied
        found = re.match(r"http://127\.0\.0\.1:\d+/[\w-]{20,}/$", server.stdout.readline())
        assert found, server.stdout.read()
        yield found.group()
        server.send_signal(signal.SIGINT)
        rest = server.communicate(timeout=60)[0]
    finally:
        server.kill()
    # Ctrl-C: the log holds no traceback, and the usual exit code
    assert "Traceback" not in rest
    assert server.returncode == 130


def ready(browser):
    browser.until("viewer.ready()")


def until(browser, name, words):
    """Wait until the element of this name holds the words; returns all that it holds."""
    browser.until(f"$('{name}').textContent.includes({json.dumps(words)})")
    return browser.run(f"return $('{name}').textContent")


def mouse(browser, kind, x, y, clicks=1):
    browser.devtools(
        "Input.dispatchMouseEvent", type=f"mouse{kind}", x=x, y=y, clickCount=clicks,
        button="left", buttons=int(kind != "Released"),
    )  # fmt: skip


def click(browser, x, y, double=False):
    left, top = browser.run(f"return viewer.screen({x}, {y})")
    for clicks in range(1, 2 + double):
        mouse(browser, "Pressed", left, top, clicks)
        mouse(browser, "Released", left, top, clicks)


def drag(browser, start, end):
    (x, y), (left, top) = (browser.run(f"return viewer.screen({a}, {b})") for a, b in (start, end))
    mouse(browser, "Pressed", x, y)
    for part in (0.3, 0.7, 1.0):
        mouse(browser, "Moved", x + part * (left - x), y + part * (top - y))
    mouse(browser, "Released", left, top)


def tool(browser, name):
    browser.run(f"document.querySelector('[data-tool={name}]').click()")


def polygon(browser, corners):
    for corner in corners[:-1]:
        click(browser, *corner)
        time.sleep(0.6)  # not a double click
    click(browser, *corners[-1], double=True)


def key(browser, name, code):
    for kind in ("keyDown", "keyUp"):
        event = {"type": kind, "key": name, "code": name, "windowsVirtualKeyCode": code}
        browser.devtools("Input.dispatchKeyEvent", **event)
